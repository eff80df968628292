"""A bound below which no spatial solution without dilation exists: frozen friction, products, circles, parts.

As in the plane every step excludes an interval [L, p) of λ, given that [0, L) is excluded. Where a sweep wins little,
rows y_k z_l that are violated are formed, and polygons of friction get directions where forces, as some motion weighs
them, or slips, as some force weighs them, stand out of the circle; then the solutions are parted, for every one belongs
to one of two parts: an edge that stays closed and one that carries its resultant, a face that may slide this way and
one that may slide that way. The part with the lowest bound is taken next, and the lowest bound of all parts is the
bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit import LimitAnalysis
from jld_core.models.zero_dilation.frozen import frozen_friction
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from jld_core.models.zero_dilation.rlt_relaxation import Region
from jld_core.models.zero_dilation.spatial_certificate import SpaceCertifier
from jld_core.models.zero_dilation.spatial_modes import SpaceModes, Way, space_modes_of, with_direction
from jld_core.models.zero_dilation.spatial_rlt_relaxation import SpaceRelaxed, relax_space
from jld_core.models.zero_dilation.spatial_statics import SpaceStatics, space_reach

SPACE_FACES: Final = 24
"""Faces up to which products are formed; larger scenes have the cheap bound alone, unless time is given for more."""

_SLACKS: Final = (1e-8, 1e-6, 1e-5)  # λ that a unit of cost earns in the program, relative to λ or to 1: near, far,
# and where nothing is proven with less
_FAR: Final = 1e-4  # distance of a bound from the lowest solution found, relative, from which it counts as far
_ENOUGH: Final = 2e-7  # distance from it, relative, at which a certificate is fine enough
_AT_ONCE: Final = 18  # faces up to which all rows are formed from the first
_LITTLE: Final = 0.01  # share of the distance that a step must win to be certified
_MUCH: Final = 0.3  # the same to go on with the rows there are
_SOME: Final = 0.15  # the same of steps with sharper circles, of which
_PATIENCE: Final = 2  # in a row may miss it before solutions are parted
_OUTSIDE: Final = 1e-6  # part of a force or slip beyond its circle that asks for a direction, and
_SHARP: Final = 0.2  # share of the worst from which it does
_DIRECTIONS: Final = 16  # of one face
_VIOLATED: Final = 1e-7  # product below zero by more than this asks for its row, and what disagrees by more is parted
_MANY: Final = 0.1  # share of the worst from which rows are formed


@dataclass(frozen=True)
class _Part:
    """Some of the solutions: with modes of bending that are still (b,), rows of bending that are zero (b,), and ways in
    which faces slide. proven, believed: below which none of them is, with certificates and by the solver's word. done:
    nothing more is to be had."""

    still: Bools
    held: Bools
    ways: tuple[Way, ...]
    proven: float
    believed: float
    done: bool = False

    def above(self, proven: float, believed: float) -> _Part:
        low = max(self.proven, proven)
        return replace(self, proven=low, believed=max(self.believed, believed, low))


class SpaceFloorSearch:
    """One labelling of a spatial scene."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: SpaceModes, ceiling: LowerBoundProblem) -> None:
        self.analysis, self.labels, self.modes, self.ceiling = analysis, labels, modes, ceiling
        self._directions, self._slides = list(modes.directions), list(modes.directions)
        everywhere = SpaceStatics(modes, 0.0, ceiling.above(0.0), np.zeros(len(modes.rows), dtype=bool))
        self._size, self._reach = everywhere.size, space_reach(everywhere)
        first = modes.near if modes.faces > _AT_ONCE else np.ones_like(modes.near)
        self._pairs = {(int(f), int(g)) for f, g in zip(*np.nonzero(first), strict=True)}

    def search(self) -> LowerBound:
        """The bound."""
        modes, ceiling, none = self.modes, self.ceiling, np.zeros(self.modes.bending, dtype=bool)
        if self._reach is None:
            ceiling.note("no certificate: velocities are not bounded")
        low = frozen_friction(self.analysis, self.labels, modes, modes.columns[:, 0], self._size, ceiling)
        parts = [_Part(none, none, (), low, low)]
        if ceiling.allows(modes.faces, SPACE_FACES, self._size):
            parts = self._parted(parts[0])
        return ceiling.floor(min(part.proven for part in parts), min(part.believed for part in parts))

    # --- pieces -------------------------------------------------------------------------------------------

    def _parted(self, whole: _Part) -> list[_Part]:
        """Parts of all solutions, each bounded, until the lowest bound meets the lowest solution or time is out."""
        first, relaxed = self._swept(whole, "products")
        parts: list[tuple[_Part, SpaceRelaxed | None]] = [(first, relaxed)]
        while self.ceiling.left > 0.0:
            lowest = min(range(len(parts)), key=lambda k: (parts[k][0].proven, parts[k][0].believed))
            part, relaxed = parts[lowest]
            if self.ceiling.met(part.proven) or relaxed is None or part.done:
                break
            halves = self._halves(part, relaxed)
            if halves is None and not self._sharpened(*self._region(part, part.proven), relaxed):
                break
            parts[lowest : lowest + 1] = [self._swept(half, "part") for half in halves or (part,)]
        return [part for part, _ in parts]

    def _swept(self, part: _Part, name: str) -> tuple[_Part, SpaceRelaxed | None]:
        """A part bounded step by step, until no step wins much, and what the last program made of it."""
        step, finest, stalls, ceiling = 1, 0, 0, self.ceiling
        certifies = self._reach is not None
        relaxed: SpaceRelaxed | None = None
        while not ceiling.met(part.proven) and ceiling.left > 0.0:
            low = part.proven if certifies else part.believed
            modes, region = self._region(part, low)
            slack = ceiling.earns(_SLACKS[step]) if certifies else 0.0
            relaxed = relax_space(modes, region, self._size, self._asked(modes, region), slack, max(ceiling.left, 1.0))
            ceiling.note(name if relaxed is not None else f"{name}: no answer", 1)
            if relaxed is None:
                return replace(part, done=True), None
            wins = not certifies or ceiling.won(low, relaxed.multipliers.bound, _LITTLE)
            near = relaxed.multipliers.bound >= ceiling.below(_FAR)
            enough = ceiling.below(_ENOUGH) if near else -math.inf
            found = self._proven(modes, region, slack, relaxed, enough) if wins else low
            if certifies and found == -math.inf and step < len(_SLACKS) - 1:
                finest = step = step + 1
                ceiling.note("more slack")
                continue
            if wins:
                part = part.above(found, ceiling.trusted(relaxed.multipliers.bound) if relaxed.sure else -math.inf)
            ceiling.take(self._whole(modes, relaxed.states))
            reached = part.proven if certifies else part.believed
            near = max(part.proven, relaxed.multipliers.bound) >= ceiling.below(_FAR)
            if ceiling.won(low, reached, _MUCH) and not near:
                continue
            if near and step > finest:
                step = finest
                continue
            if ceiling.met(part.proven):
                break
            more = self._more_rows(modes, region, relaxed)
            stalls = 0 if ceiling.won(low, reached, _SOME) else stalls + 1
            # what a program says that was given up is no guide
            sharper = (wins or relaxed.sure) and self._sharpened(modes, region, relaxed)
            if not (more or sharper or ceiling.won(low, reached)) or (stalls >= _PATIENCE and not more):
                break
        return part, relaxed

    def _region(self, part: _Part, low: float) -> tuple[SpaceModes, Region]:
        modes = self._modes(part)
        held, still = np.zeros(len(modes.rows), dtype=bool), np.zeros(len(modes.rates), dtype=bool)
        held[: modes.bending], still[: modes.bending] = part.held, part.still
        high = self.ceiling.above(low)
        closed = SpaceStatics(modes, low, high, held, self._size).closed()
        return modes, Region(low, high, closed | still, held)

    def _modes(self, part: _Part) -> SpaceModes:
        modes = space_modes_of(
            self.analysis.template, self.labels, tuple(self._directions), part.ways, tuple(self._slides)
        )
        assert modes is not None
        return modes

    def _asked(self, modes: SpaceModes, region: Region) -> Bools:
        """Rows y_k z_l of the pairs of faces that are formed."""
        formed = np.zeros((modes.faces, modes.faces), dtype=bool)
        formed[tuple(np.array(sorted(self._pairs)).T)] = True
        formed[self._spared(modes, region)] = False
        return np.asarray(formed[np.ix_(modes.face, modes.mode_face)])

    def _spared(self, modes: SpaceModes, region: Region) -> Bools:
        """(m,) inner faces that never move: what they carry is not asked, for they have strength to spare."""
        moving = np.zeros(modes.faces, dtype=bool)
        moving[modes.mode_face[~region.closed]] = True
        return (modes.tension > 0.0) & ~moving

    def _proven(self, modes: SpaceModes, region: Region, slack: float, relaxed: SpaceRelaxed, enough: float) -> float:
        if self._reach is None:
            return -math.inf
        check = SpaceCertifier(modes, region, slack, self._size, self._reach)
        return check.bound(relaxed.multipliers, enough)

    def _whole(self, modes: SpaceModes, states: Floats) -> Floats:
        """Forces of all six resultants a face, (k, 6m + 1), from those that are not zero throughout."""
        full = np.zeros((len(states), modes.columns.size + 1))
        kept = modes.columns.ravel() >= 0
        full[:, np.flatnonzero(kept)] = states[:, modes.columns.ravel()[kept]]
        full[:, -1] = states[:, -1]
        return full

    def _sharpened(self, modes: SpaceModes, region: Region, relaxed: SpaceRelaxed) -> bool:
        """More directions where forces or slips, as what is known of the other side sees them, stand out of their
        circles."""
        sharper = False
        spared = self._spared(modes, region)
        for side, known in enumerate((self._directions, self._slides)):
            beyond = np.where(spared, 0.0, relaxed.beyond[side])
            least = max(_SHARP * float(beyond.max(initial=0.0)), _OUTSIDE)
            for face in np.flatnonzero(beyond > least).tolist():
                more = with_direction(known[face], relaxed.toward[side, face])
                if len(known[face]) < len(more) <= _DIRECTIONS:
                    known[face], sharper = more, True
        if sharper:
            self.ceiling.note("circles")
        return sharper

    def _more_rows(self, modes: SpaceModes, region: Region, relaxed: SpaceRelaxed) -> bool:
        """Pairs of faces whose rows y_k z_l are violated most."""
        worst = np.zeros((modes.faces, modes.faces))
        np.maximum.at(worst, (modes.face[:, None], modes.mode_face[None, :]), relaxed.violation)
        worst[self._spared(modes, region)] = 0.0
        chosen = np.argwhere(worst > max(_MANY * float(worst.max()), _VIOLATED))
        fresh = {(int(f), int(g)) for f, g in chosen} - self._pairs
        self._pairs |= fresh
        if fresh:
            self.ceiling.note("rows added")
        return bool(fresh)

    def _halves(self, part: _Part, relaxed: SpaceRelaxed) -> tuple[_Part, _Part] | None:
        """Both sides of what disagrees most with itself on the mean: an edge, or the way in which a face slides."""
        edges = np.where(part.still | part.held, 0.0, relaxed.disagreeing)
        ways = relaxed.torn.copy()
        for way in part.ways:
            ways[way.face, way.component] = 0.0
        if max(edges.max(initial=0.0), ways.max(initial=0.0)) <= _VIOLATED:
            return None
        if edges.max(initial=0.0) >= ways.max(initial=0.0):
            one = np.arange(len(edges)) == int(np.argmax(edges))
            return replace(part, still=part.still | one), replace(part, held=part.held | one)
        face, component = (int(k) for k in np.unravel_index(np.argmax(ways), ways.shape))
        to, back = (replace(part, ways=(*part.ways, Way(face, component, sign))) for sign in (1.0, -1.0))
        return to, back
