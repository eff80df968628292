"""A bound below which no solution without dilation exists: cheap bounds, products, sweeps in λ, branches.

Every step excludes an interval [L, p) of λ, given that [0, L) is excluded already; where a sweep stalls on a mode, the
solutions in which it does not move and those in which its slack is zero are bounded apart, for every solution is one
or the other. A step counts as proven if its certificate says so, `certificate`.
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
"""Faces up to which products are formed; larger scenes have the cheap bounds alone, unless time is given for more."""

_ENOUGH: Final = 2e-7  # distance from the lowest solution found, relative, at which a certificate is fine enough
_SLACK: Final = 1e-8  # λ that a unit of cost earns in the program, relative to λ or to 1, and
_MORE: Final = 1e-6  # the same where the bound is far yet: it costs λ, and the certificate is exact at once
_FINER: Final = 0.1  # steps in which it goes back
_FAR: Final = 1e-4  # distance of a bound from the lowest solution found, relative, up to which slack is what lacks
_BLOCKS: Final = 25  # faces from which programs are solved by blocks
_AT_ONCE: Final = 45  # faces up to which the first of them is followed to its end
_DEPTH: Final = 6  # branches above one another


@dataclass(frozen=True)
class _Bounds:
    """What is excluded below: with certificates, and as the solver has it."""

    proven: float
    believed: float

    def with_(self, proven: float, believed: float) -> _Bounds:
        return _Bounds(max(self.proven, proven), max(self.believed, believed, proven))

    def least(self, other: _Bounds) -> _Bounds:
        return _Bounds(min(self.proven, other.proven), min(self.believed, other.believed))


class FloorSearch:
    """One labelling."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits, modes: Modes, ceiling: LowerBoundProblem) -> None:
        self.analysis, self.labels, self.modes, self.ceiling = analysis, labels, modes, ceiling
        none = np.zeros(len(modes.rows), dtype=bool)
        everywhere = Statics(modes, 0.0, ceiling.above(0.0), none)
        self._size, self._reach = everywhere.size, reach(everywhere)

    def search(self) -> LowerBound:
        """The bound."""
        modes, ceiling, none = self.modes, self.ceiling, np.zeros(len(self.modes.rows), dtype=bool)
        if self._reach is None:
            ceiling.note("no certificate: velocities are not bounded")
        normals = np.arange(0, modes.matrix.shape[1], 3)
        low = frozen_friction(self.analysis, self.labels, modes, normals, self._size, ceiling)
        bounds = _Bounds(low, low)
        if ceiling.allows(modes.faces, FACES, self._size):
            if self._reach is not None and modes.faces >= _BLOCKS and not ceiling.met(low):
                # of programs by blocks only what is proven counts: walls end here
                steps = BlockSweep(modes, self._size, self._reach, ceiling)
                # beside openings hinges alone prove nothing
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
        """Relaxations of one region, each from the bound of the last; branches where they stall."""
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
                # another step follows whatever this one proves
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
        assert self._reach is not None
        # what another step follows need not be proven with the least slack
        enough = self.ceiling.below(_ENOUGH) if slack == _SLACK else -math.inf
        check = Certifier(self.modes, region, self.ceiling.earns(slack), self._size, self._reach)
        return check.bound(relaxed.multipliers, enough)
