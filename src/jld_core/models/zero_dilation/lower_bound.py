"""Lower bound on λ over all non-dilatant planar solutions, by relaxation and branching.

The relaxations are linear programs over products (RLT). Every step excludes an interval [L, p) of λ, given that [0, L)
is excluded already. Where progress stalls on a mode, the solutions are split: either the mode does not move, or its
slack is zero. Every solution belongs to one of the two parts. A step counts as proven if its certificate is valid, see
`certificate`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools
from jld_core.limit import LimitAnalysis
from jld_core.models.zero_dilation.certificate import Certifier
from jld_core.models.zero_dilation.frozen import frozen_friction
from jld_core.models.zero_dilation.loops import opened
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from jld_core.models.zero_dilation.modes import Modes
from jld_core.models.zero_dilation.rlt_relaxation import Region, RltSolution, relax
from jld_core.models.zero_dilation.statics import Statics, reach
from jld_core.models.zero_dilation.sweep import BlockSweep

FACES: Final = 60
"""Number of faces up to which products are formed; larger scenes have only cheap bounds, unless given more time."""

_ENOUGH: Final = 2e-7
"""Distance from the lowest solution found, relative, below which a certificate is not refined further."""

_SLACK: Final = 1e-8
"""Least slack σ: decrease of λ per unit of cost in the program, relative to λ or to 1."""

_MORE: Final = 1e-6
"""Slack σ while the bound is far from the solution: the bound is lower, but its certificate is exact at once."""

_FINER: Final = 0.1
"""Factor by which the slack decreases again near the solution, and the inverse by which it grows."""

_FAR: Final = 1e-4
"""Relative distance from the lowest solution found up to which the slack, not the rows, limits the bound."""

_BLOCKS: Final = 25
"""Number of faces from which programs are solved by matrix blocks."""

_AT_ONCE: Final = 45
"""Number of faces up to which the first program by matrix blocks is solved to full accuracy."""

_DEPTH: Final = 6
"""Maximum depth of branching."""


@dataclass(frozen=True)
class _Bounds:
    """Lower bounds of one region: with certificates (proven), and from the solver (believed)."""

    proven: float
    believed: float

    def with_(self, proven: float, believed: float) -> _Bounds:
        """Return the bounds raised to given values where these are higher."""
        return _Bounds(max(self.proven, proven), max(self.believed, believed, proven))

    def least(self, other: _Bounds) -> _Bounds:
        """Return the lower of both bounds with another region."""
        return _Bounds(min(self.proven, other.proven), min(self.believed, other.believed))


class FloorSearch:
    """Search for a lower bound on λ without dilation, for one labelling of a planar assembly."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: Modes, ceiling: LowerBoundProblem) -> None:
        self.analysis, self.labels, self.modes, self.ceiling = analysis, labels, modes, ceiling
        none = np.zeros(len(modes.rows), dtype=bool)
        everywhere = Statics(modes, 0.0, ceiling.above(0.0), none)
        self._size, self._reach = everywhere.size, reach(everywhere)

    def search(self) -> LowerBound:
        """Compute the lower bound."""
        modes, ceiling, none = self.modes, self.ceiling, np.zeros(len(self.modes.rows), dtype=bool)
        if self._reach is None:
            ceiling.note("no certificate: velocities are not bounded")
        normals = np.arange(0, modes.matrix.shape[1], 3)
        low = frozen_friction(self.analysis, self.labels, modes, normals, self._size, ceiling)
        bounds = _Bounds(low, low)
        if ceiling.allows(modes.faces, FACES, self._size):
            if self._reach is not None and modes.faces >= _BLOCKS and not ceiling.met(low):
                # Programs by matrix blocks count only if proven; walls usually end here.
                steps = BlockSweep(modes, self._size, self._reach, ceiling)
                # Around openings, products with hinges alone prove nothing.
                stage = len(steps.stages) - 1 if opened(modes.assembly) else 0
                if modes.faces <= _AT_ONCE and stage == 0:
                    low = max(low, steps.at_once(low))
                if modes.faces > FACES:
                    low = steps.first(low, stage)
                low = steps.sweep(low, none, none, stage)
            bounds = self._sweep(_Bounds(low, low), none, none, modes.close, 0)
        return ceiling.floor(bounds.proven, bounds.believed)

    # --- pieces -------------------------------------------------------------------------------------------

    def _sweep(self, bounds: _Bounds, closed: Bools, held: Bools, pairs: Bools, depth: int) -> _Bounds:
        """Solve relaxations of one region, each from the last bound; branch where they stall."""
        name, slack, ceiling = "products" if depth == 0 else f"branch {depth}", _SLACK, self.ceiling
        while not ceiling.met(bounds.believed) and ceiling.left > 0.0:
            low = bounds.believed
            statics = Statics(self.modes, low, ceiling.above(low), held, self._size)
            region = Region(low, ceiling.above(low), closed | statics.closed(), held)
            earned = ceiling.earns(slack) if self._reach is not None else 0.0
            relaxed = relax(self.modes, region, self._size, pairs, earned, max(ceiling.left, 1.0))
            ceiling.note(name if relaxed is not None else f"{name}: no answer", 1)
            if relaxed is None:
                return bounds
            certifies = self._reach is not None and bounds.proven >= low * (1.0 - tolerances.GAP)
            if certifies and slack < _MORE and relaxed.multipliers.bound < ceiling.below(_FAR):
                # Another step follows in any case, so its certificate may use more slack.
                slack = _MORE
                ceiling.note("more slack")
                continue
            found = self._proven(region, relaxed, slack) if certifies else -math.inf
            if certifies and found == -math.inf and slack < _MORE:
                slack = min(slack / _FINER, _MORE)
                ceiling.note("more slack")
                continue
            bounds = bounds.with_(found, ceiling.trusted(relaxed.multipliers.bound) if relaxed.sure else -math.inf)
            if depth == 0:
                ceiling.take(relaxed.states)
            if ceiling.won(low, bounds.believed) or ceiling.met(bounds.believed):
                continue
            if slack > _SLACK and bounds.believed >= ceiling.below(_FAR):
                slack = max(slack * _FINER, _SLACK)
                ceiling.note("less slack")
                continue
            fresh = relaxed.violated & ~pairs
            if fresh.any():
                pairs = pairs | fresh
                ceiling.note("rows added")
                continue
            halves = region.halves(relaxed.rates, relaxed.slacks) if depth < _DEPTH else None
            if halves is None:
                break
            first, second = (self._sweep(bounds, half.closed, half.held, pairs, depth + 1) for half in halves)
            return first.least(second)
        return bounds

    def _proven(self, region: Region, relaxed: RltSolution, slack: float) -> float:
        """Return the bound proven by the multipliers of a relaxation, −inf if none."""
        assert self._reach is not None
        # With more than the least slack another step follows, so the first valid certificate is enough.
        enough = self.ceiling.below(_ENOUGH) if slack == _SLACK else -math.inf
        check = Certifier(self.modes, region, self.ceiling.earns(slack), self._size, self._reach)
        return check.bound(relaxed.multipliers, enough)
