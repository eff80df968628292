"""A bound below which no spatial solution without dilation exists: frozen friction, products, circles, parts.

As in the plane every step excludes an interval [L, p) of λ, given that [0, L) is excluded. Where a sweep stalls, rows
y_k z_l that are violated are formed; then polygons of friction get directions where forces or slips stand out of the
circle; then the solutions are parted, for every one belongs to one of two parts: an edge that stays closed and one
that carries its resultant, a face that may slide this way and one that may slide that way. The part with the lowest
bound is taken next, and the lowest bound of all parts is the bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit import LimitAnalysis
from jld_core.models.zero_dilation.ceiling import Ceiling, Floor
from jld_core.models.zero_dilation.frozen import frozen_friction
from jld_core.models.zero_dilation.products import Region
from jld_core.models.zero_dilation.space_certificate import SpaceCertifier
from jld_core.models.zero_dilation.space_modes import SpaceModes, Way, space_modes_of, with_direction
from jld_core.models.zero_dilation.space_products import SpaceRelaxed, relax_space
from jld_core.models.zero_dilation.space_statics import SpaceStatics, space_reach

SPACE_FACES: Final = 24
"""Faces up to which products are formed; larger scenes have the cheap bound alone, unless time is given for more."""

_SLACKS: Final = (1e-8, 1e-6, 1e-5)  # λ that a unit of cost earns in the program, relative to λ or to 1: near, far,
# and where nothing is proven with less
_FAR: Final = 1e-4  # distance of a bound from the lowest solution found, relative, from which it counts as far
_ENOUGH: Final = 2e-7  # distance from it, relative, at which a certificate is fine enough
_LITTLE: Final = 0.01  # share that two steps may miss before sharper circles are given up for now
_OUTSIDE: Final = 1e-5  # part of a force or slip beyond its circle that asks for a direction
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

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: SpaceModes, ceiling: Ceiling) -> None:
        self.analysis, self.labels, self.modes, self.ceiling = analysis, labels, modes, ceiling
        self._directions = modes.directions
        everywhere = SpaceStatics(modes, 0.0, ceiling.above(0.0), np.zeros(len(modes.rows), dtype=bool))
        self._size, self._reach = everywhere.size, space_reach(everywhere)
        self._pairs = {(int(f), int(g)) for f, g in zip(*np.nonzero(modes.near), strict=True)}

    def search(self) -> Floor:
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
            if halves is None and not (self._sharpened(self._modes(part), relaxed)):
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
            relaxed = relax_space(modes, region, self._size, self._asked(modes), slack, max(ceiling.left, 1.0))
            ceiling.note(name if relaxed is not None else f"{name}: no answer", 1)
            if relaxed is None:
                return replace(part, done=True), None
            found = self._proven(modes, region, slack, relaxed)
            if certifies and found == -math.inf and step < len(_SLACKS) - 1:
                finest = step = step + 1
                ceiling.note("more slack")
                continue
            part = part.above(found, ceiling.trusted(relaxed.multipliers.bound) if relaxed.sure else -math.inf)
            ceiling.take(self._whole(modes, relaxed.states))
            reached = part.proven if certifies else part.believed
            near = max(part.proven, relaxed.multipliers.bound) >= ceiling.below(_FAR)
            if ceiling.won(low, reached) and not near:
                continue
            if near and step > finest:
                step = finest
                continue
            if ceiling.met(part.proven):
                break
            if self._more_rows(modes, relaxed):
                continue
            stalls += not ceiling.won(low, reached, _LITTLE)
            if stalls == 2 or not self._sharpened(modes, relaxed):
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
        modes = space_modes_of(self.analysis.template, self.labels, self._directions, part.ways)
        assert modes is not None
        return modes

    def _asked(self, modes: SpaceModes) -> Bools:
        """Rows y_k z_l of the pairs of faces that are formed."""
        formed = np.zeros((modes.faces, modes.faces), dtype=bool)
        formed[tuple(np.array(sorted(self._pairs)).T)] = True
        return np.asarray(formed[np.ix_(modes.face, modes.mode_face)])

    def _proven(self, modes: SpaceModes, region: Region, slack: float, relaxed: SpaceRelaxed) -> float:
        if self._reach is None:
            return -math.inf
        check = SpaceCertifier(modes, region, slack, self._size, self._reach)
        return check.bound(relaxed.multipliers, self.ceiling.below(_ENOUGH))

    def _whole(self, modes: SpaceModes, states: Floats) -> Floats:
        """Forces of all six resultants a face, (k, 6m + 1), from those that are not zero throughout."""
        full = np.zeros((len(states), modes.columns.size + 1))
        full[:, np.flatnonzero(modes.columns.ravel() >= 0)] = states[:, :-1]
        full[:, -1] = states[:, -1]
        return full

    def _sharpened(self, modes: SpaceModes, relaxed: SpaceRelaxed) -> bool:
        """More directions where slips on the mean, or forces of a mixed state, stand out of their circles."""
        before = self._directions
        directions = list(before)
        for face in np.flatnonzero(modes.slip >= 0).tolist():
            one, two, twist = modes.columns[face, [1, 2, 5]]
            outside = [
                (float(relaxed.lacking[face]) / float(np.hypot(*relaxed.slips[face]) + 1e-9), relaxed.slips[face])
            ]
            for state in relaxed.states:
                force = state[[one, two]]
                holds = float(modes.capacities[face, :-1] @ state + modes.capacities[face, -1])
                beyond = float(np.hypot(*force)) + (abs(float(state[twist])) if twist >= 0 else 0.0) - holds
                outside.append((beyond / max(abs(holds), _OUTSIDE), force))
            worst, way = max(outside, key=lambda pair: pair[0])
            if worst > _OUTSIDE and len(directions[face]) < _DIRECTIONS:
                directions[face] = with_direction(directions[face], way)
        self._directions = tuple(directions)
        sharper = any(len(a) > len(b) for a, b in zip(directions, before, strict=True))
        if sharper:
            self.ceiling.note("circles")
        return sharper

    def _more_rows(self, modes: SpaceModes, relaxed: SpaceRelaxed) -> bool:
        """Pairs of faces whose rows y_k z_l are violated most."""
        worst = np.zeros((modes.faces, modes.faces))
        np.maximum.at(worst, (modes.face[:, None], modes.mode_face[None, :]), relaxed.violation)
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
