"""Lower bound on λ over all non-dilatant spatial solutions.

The steps are frozen friction, relaxations, sharper friction polygons, and splitting. As in the plane, every step
excludes an interval [L, p) of λ, given that [0, L) is excluded. Where a step gains little, violated rows y_k z_l are
added. Friction polygons receive directions where forces or slips, multiplied by forms of the other factor, violate
the circle.

Then the solutions are split in two parts, at an edge or at a slip; every solution belongs to one part. At an edge,
either the edge does not open (z = 0), or the resultant acts on the edge (y = 0). At a slip, a face may slide in one
sense only, or in the opposite sense only. The part with the lowest bound is treated next. The lowest bound of all
parts is the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit import LimitAnalysis
from jld_core.models.zero_dilation.bounded_modes import Region
from jld_core.models.zero_dilation.frozen_friction import frozen_friction_bound
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from studies.spatial_bound.certificate import SpaceCertifier
from studies.spatial_bound.modes import SpaceModes, Way, space_modes_of, with_direction
from studies.spatial_bound.rlt_relaxation import SpaceRltSolution, solve_space_rlt
from studies.spatial_bound.statics import SpaceStatics, bound_space_velocities

SPACE_FACES: Final = 24
"""Number of faces up to which products are formed; larger scenes have only the cheap bound, unless given more time."""

_SLACKS: Final = (1e-8, 1e-6, 1e-5)
"""Slacks σ: decrease of λ per unit of cost, relative to λ or to 1.

The first is used near the solution, the second far from it, the third where nothing is proven with less.
"""

_FAR: Final = 1e-4
"""Relative distance of a bound from the lowest solution found above which it counts as far."""

_ENOUGH: Final = 2e-7
"""Relative distance from that solution below which a certificate is not refined further."""

_AT_ONCE: Final = 18
"""Number of faces up to which all rows are formed from the start."""

_LITTLE: Final = 0.01
"""Fraction of the distance that the solver's bound must gain for its certificate to be computed."""

_MUCH: Final = 0.3
"""Fraction of the distance that a step must gain to continue with the same rows."""

_SOME: Final = 0.15
"""Fraction of the distance that a step with sharper polygons must gain."""

_PATIENCE: Final = 2
"""Number of consecutive steps below `_SOME` after which the solutions are split."""

_OUTSIDE: Final = 1e-6
"""Relative violation of a circle from which a direction is added."""

_SHARP: Final = 0.2
"""Fraction of the largest violation from which a direction is added."""

_DIRECTIONS: Final = 16
"""Maximum number of directions of one face."""

_VIOLATED: Final = 1e-7
"""Size of a negative product from which its row is added, and of a disagreement from which solutions are split."""

_MANY: Final = 0.1
"""Fraction of the largest violation from which rows are added."""


@dataclass(frozen=True)
class _Part:
    """Part of the solutions, with its bounds.

    still: (b,) bending modes that do not move. held: (b,) bending rows that are zero. ways: restrictions of slip.
    proven, believed: lower bounds of the part, by certificates and from the solver. done: True if no further gain is
    possible.
    """

    still: Bools
    held: Bools
    ways: tuple[Way, ...]
    proven: float
    believed: float
    done: bool = False

    def above(self, proven: float, believed: float) -> _Part:
        """Return the part with its bounds raised to given values where these are higher."""
        low = max(self.proven, proven)
        return replace(self, proven=low, believed=max(self.believed, believed, low))


class SpaceLowerBoundSearch:
    """Lower-bound search of one spatial labelling."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: SpaceModes, problem: LowerBoundProblem) -> None:
        self.analysis, self.labels, self.modes, self.problem = analysis, labels, modes, problem
        self._directions, self._slides = list(modes.directions), list(modes.directions)
        everywhere = SpaceStatics(modes, 0.0, problem.interval_end(0.0), np.zeros(len(modes.rows), dtype=bool))
        self._force_bounds, self._velocity_bounds = everywhere.force_bounds, bound_space_velocities(everywhere)
        first = modes.adjacent if modes.faces > _AT_ONCE else np.ones_like(modes.adjacent)
        self._pairs = {(int(f), int(g)) for f, g in zip(*np.nonzero(first), strict=True)}

    def search(self) -> LowerBound:
        """Compute the lower bound."""
        modes, problem, none = self.modes, self.problem, np.zeros(self.modes.bending, dtype=bool)
        if self._velocity_bounds is None:
            problem.record("no certificate: velocities are not bounded")
        low = frozen_friction_bound(self.analysis, self.labels, modes, modes.columns[:, 0], self._force_bounds, problem)
        parts = [_Part(none, none, (), low, low)]
        if problem.allows_products(modes.faces, SPACE_FACES, self._force_bounds):
            parts = self._parted(parts[0])
        return problem.result(min(part.proven for part in parts), min(part.believed for part in parts))

    # --- pieces -------------------------------------------------------------------------------------------

    def _parted(self, whole: _Part) -> list[_Part]:
        """Split the solutions until the lowest bound meets the solution or time is up.

        Return all parts, each with its bounds.
        """
        first, relaxed = self._swept(whole, "products")
        parts: list[tuple[_Part, SpaceRltSolution | None]] = [(first, relaxed)]
        while self.problem.seconds_left > 0.0:
            lowest = min(range(len(parts)), key=lambda k: (parts[k][0].proven, parts[k][0].believed))
            part, relaxed = parts[lowest]
            if self.problem.closes_gap(part.proven) or relaxed is None or part.done:
                break
            halves = self._halves(part, relaxed)
            if halves is None and not self._sharpened(*self._region(part, part.proven), relaxed):
                break
            parts[lowest : lowest + 1] = [self._swept(half, "part") for half in halves or (part,)]
        return [part for part, _ in parts]

    def _swept(self, part: _Part, name: str) -> tuple[_Part, SpaceRltSolution | None]:
        """Raise the bound of a part until steps gain little; return it and the last relaxation."""
        step, finest, stalls, problem = 1, 0, 0, self.problem
        certifies = self._velocity_bounds is not None
        relaxed: SpaceRltSolution | None = None
        while not problem.closes_gap(part.proven) and problem.seconds_left > 0.0:
            low = part.proven if certifies else part.believed
            modes, region = self._region(part, low)
            slack = problem.scaled_slack(_SLACKS[step]) if certifies else 0.0
            relaxed = solve_space_rlt(
                modes, region, self._force_bounds, self._asked(modes, region), slack, max(problem.seconds_left, 1.0)
            )
            problem.record(name if relaxed is not None else f"{name}: no answer", 1)
            if relaxed is None:
                return replace(part, done=True), None
            wins = not certifies or problem.gains_enough(low, relaxed.multipliers.bound, _LITTLE)
            near = relaxed.multipliers.bound >= problem.load_below(_FAR)
            sufficient_bound = problem.load_below(_ENOUGH) if near else -math.inf
            found = self._proven(modes, region, slack, relaxed, sufficient_bound) if wins else low
            if certifies and found == -math.inf and step < len(_SLACKS) - 1:
                finest = step = step + 1
                problem.record("more slack")
                continue
            if wins:
                part = part.above(
                    found, problem.less_solver_tolerance(relaxed.multipliers.bound) if relaxed.accurate else -math.inf
                )
            problem.offer_states(self._whole(modes, relaxed.states))
            reached = part.proven if certifies else part.believed
            near = max(part.proven, relaxed.multipliers.bound) >= problem.load_below(_FAR)
            if problem.gains_enough(low, reached, _MUCH) and not near:
                continue
            if near and step > finest:
                step = finest
                continue
            if problem.closes_gap(part.proven):
                break
            more = self._more_rows(modes, region, relaxed)
            stalls = 0 if problem.gains_enough(low, reached, _SOME) else stalls + 1
            # A relaxation that was stopped early does not show where circles are violated.
            sharper = (wins or relaxed.accurate) and self._sharpened(modes, region, relaxed)
            if not (more or sharper or problem.gains_enough(low, reached)) or (stalls >= _PATIENCE and not more):
                break
        return part, relaxed

    def _region(self, part: _Part, low: float) -> tuple[SpaceModes, Region]:
        """Return modes and region of a part, with the modes closed that are proven not to move."""
        modes = self._modes(part)
        held, still = np.zeros(len(modes.rows), dtype=bool), np.zeros(len(modes.rates), dtype=bool)
        held[: modes.bending], still[: modes.bending] = part.held, part.still
        high = self.problem.interval_end(low)
        closed = SpaceStatics(modes, low, high, held, self._force_bounds).closed_modes()
        return modes, Region(low, high, closed | still, held)

    def _modes(self, part: _Part) -> SpaceModes:
        """Build the relaxed problem of a part with the current directions."""
        modes = space_modes_of(
            self.analysis.template, self.labels, tuple(self._directions), part.ways, tuple(self._slides)
        )
        assert modes is not None
        return modes

    def _asked(self, modes: SpaceModes, region: Region) -> Bools:
        """Return a mask of the rows y_k z_l for the pairs of faces formed so far."""
        formed = np.zeros((modes.faces, modes.faces), dtype=bool)
        formed[tuple(np.array(sorted(self._pairs)).T)] = True
        formed[self._spared(modes, region)] = False
        return np.asarray(formed[np.ix_(modes.face, modes.mode_face)])

    def _spared(self, modes: SpaceModes, region: Region) -> Bools:
        """Return a mask (m,) of inner faces that never move, whose rows are omitted.

        Their strength usually exceeds their load, so that these rows gain nothing.
        """
        moving = np.zeros(modes.faces, dtype=bool)
        moving[modes.mode_face[~region.closed]] = True
        return (modes.tension > 0.0) & ~moving

    def _proven(
        self, modes: SpaceModes, region: Region, slack: float, relaxed: SpaceRltSolution, sufficient_bound: float
    ) -> float:
        """Return the bound proven by the multipliers of a relaxation, −inf if none."""
        if self._velocity_bounds is None:
            return -math.inf
        check = SpaceCertifier(modes, region, slack, self._force_bounds, self._velocity_bounds)
        return check.bound(relaxed.multipliers, sufficient_bound)

    def _whole(self, modes: SpaceModes, states: Floats) -> Floats:
        """Return all six resultants per face, (k, 6m + 1) with λ, from those not identically zero."""
        full = np.zeros((len(states), modes.columns.size + 1))
        kept = modes.columns.ravel() >= 0
        full[:, np.flatnonzero(kept)] = states[:, modes.columns.ravel()[kept]]
        full[:, -1] = states[:, -1]
        return full

    def _sharpened(self, modes: SpaceModes, region: Region, relaxed: SpaceRltSolution) -> bool:
        """Add directions where forces or slips violate their circles; return True if any."""
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
            self.problem.record("circles")
        return sharper

    def _more_rows(self, modes: SpaceModes, region: Region, relaxed: SpaceRltSolution) -> bool:
        """Add the pairs of faces whose rows y_k z_l are violated most; return True if any is new."""
        worst = np.zeros((modes.faces, modes.faces))
        np.maximum.at(worst, (modes.face[:, None], modes.mode_face[None, :]), relaxed.violation)
        worst[self._spared(modes, region)] = 0.0
        chosen = np.argwhere(worst > max(_MANY * float(worst.max()), _VIOLATED))
        fresh = {(int(f), int(g)) for f, g in chosen} - self._pairs
        self._pairs |= fresh
        if fresh:
            self.problem.record("rows added")
        return bool(fresh)

    def _halves(self, part: _Part, relaxed: SpaceRltSolution) -> tuple[_Part, _Part] | None:
        """Split a part at the edge or slip that most violates its complementarity, or return None."""
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
