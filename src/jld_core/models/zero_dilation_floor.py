"""A bound below which no solution without dilation exists: cheap bounds, products, sweeps in λ, branches.

Every step excludes an interval [L, p) of λ, given that [0, L) is excluded already; where a sweep stalls on a mode, the
solutions in which it does not move and those in which its slack is zero are bounded apart, for every solution is one
or the other. A step counts as proven if its certificate says so, `zero_dilation_certificate`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit import LimitAnalysis
from jld_core.models.zero_dilation_certificate import Certifier
from jld_core.models.zero_dilation_frozen import frozen_friction
from jld_core.models.zero_dilation_modes import Modes
from jld_core.models.zero_dilation_products import Region, Relaxed, relax
from jld_core.models.zero_dilation_statics import Statics, reach
from jld_core.models.zero_dilation_sweep import BlockSweep

FACES: Final = 60
"""Faces up to which products are formed; larger scenes have the cheap bounds alone, unless time is given for more."""

PATIENT: Final = 600.0
"""Seconds of processor time from which products are tried on any number of faces."""

_ENOUGH: Final = 2e-7  # distance from the lowest solution found, relative, at which a certificate is fine enough
_SLACK: Final = 1e-8  # λ that a unit of cost earns in the program, relative to λ or to 1, and
_MORE: Final = 1e-6  # the same where the bound is far yet: it costs λ, and the certificate is exact at once
_FINER: Final = 0.1  # steps in which it goes back
_FAR: Final = 1e-4  # distance of a bound from the lowest solution found, relative, up to which slack is what lacks
_ROOM: Final = 0.02  # room above the lowest solution found, relative to what is not excluded, and
_LEAST_ROOM: Final = 1e-3  # to λ itself: an interval of no width leaves an interior point no interior
_STALL: Final = 0.05  # share of the distance that a sweep must win, else rows are added or the region is branched
_TRUSTED: Final = 1e-7  # what an unproven bound is lowered by, relative: more than the solver's own tolerance
_BLOCKS: Final = 25  # faces from which programs are solved by blocks
_AT_ONCE: Final = 45  # faces up to which the first of them is followed to its end
_DEPTH: Final = 6  # branches above one another


@dataclass(frozen=True)
class Floor:
    """Bounds on λ ≥ 0 of every solution, scaled.

    proven: with certificates throughout. bound: the highest there is, true within `tolerance`, relative: 0 where it is
    the proven one, else what a solver's word is trusted to. closed: it meets the lowest solution found. programs:
    solved. seconds: of processor time. route: what was done.
    """

    proven: float
    bound: float
    tolerance: float
    closed: bool
    programs: int
    seconds: float
    route: tuple[str, ...]


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
    """One labelling. ceiling: λ of the lowest solution found, scaled. seconds: of processor time, after which no
    further program begins. offer: takes forces and λ (k, 3m + 1) that may lead lower, and returns the ceiling then."""

    def __init__(
        self,
        analysis: LimitAnalysis,
        labels: Bits,
        modes: Modes,
        ceiling: float,
        seconds: float,
        offer: Callable[[Floats], float] | None = None,
    ) -> None:
        self.analysis, self.labels, self.modes = analysis, labels, modes
        self.ceiling, self.offer = ceiling, offer
        self.start, self.seconds = time.process_time(), seconds
        self.programs, self.route = 0, list[str]()
        self._size: Floats | None = None
        self._reach: Floats | None = None

    def search(self) -> Floor:
        """The bound."""
        none = np.zeros(len(self.modes.rows), dtype=bool)
        everywhere = Statics(self.modes, 0.0, self._above(0.0), none)
        self._size, self._reach = everywhere.size, reach(everywhere)
        if self._reach is None:
            self.route.append("no certificate: velocities are not bounded")
        bounds = self._frozen(_Bounds(0.0, 0.0), none)
        if self.modes.faces > FACES and self.seconds < PATIENT:
            self.route.append(f"no products: {self.modes.faces} faces")
        elif not np.isfinite(self._size).all():
            self.route.append("no products: self-stress is not bounded")
        else:
            bounds = self._by_blocks(bounds, none)
            bounds = self._sweep(bounds, none, none, self._first_pairs(), 0)
        sure = bounds.proven >= bounds.believed - tolerances.GAP * max(abs(self.ceiling), _SLACK)
        return Floor(
            proven=bounds.proven,
            bound=bounds.proven if sure else bounds.believed,
            tolerance=0.0 if sure else _TRUSTED,
            closed=self._met(bounds.proven if sure else bounds.believed),
            programs=self.programs,
            seconds=time.process_time() - self.start,
            route=tuple(self.route),
        )

    # --- pieces -------------------------------------------------------------------------------------------

    def _above(self, low: float) -> float:
        room = _ROOM * (self.ceiling - low) + _LEAST_ROOM * max(abs(self.ceiling), _SLACK)
        return self.ceiling + room

    def _met(self, bound: float) -> bool:
        return bound >= self.ceiling - tolerances.GAP * max(abs(self.ceiling), _SLACK)

    @property
    def _left(self) -> float:
        return self.seconds - (time.process_time() - self.start)

    def _first_pairs(self) -> Bools:
        """Rows y_k z_l of faces that meet at an element, or at two next to one another."""
        near = self.modes.near.astype(int)
        return np.kron((near @ near) > 0, np.ones((4, 4), dtype=bool)).astype(bool)

    def _frozen(self, bounds: _Bounds, none: Bools) -> _Bounds:
        """λ with friction frozen at the least N of each face: every solution has more, and it rises with them."""

        def least(low: float) -> Floats:
            statics = Statics(self.modes, low, self._above(low), none, self._size)
            self.programs += self.modes.faces
            return np.array([statics.least(row) for row in np.eye(self.modes.matrix.shape[1] + 2)[:-2:3]])

        for turn, (low, solves) in enumerate(frozen_friction(self.analysis, self.labels, least), start=1):
            self.programs += solves
            if not low - bounds.proven > _STALL * (self.ceiling - bounds.proven):
                break
            bounds = bounds.with_(low, low)
            self.route.append(f"frozen friction {turn}")
            if self._met(bounds.proven):
                break
        return bounds

    def _by_blocks(self, bounds: _Bounds, none: Bools) -> _Bounds:
        """Programs by blocks, of which only what is proven counts: walls end here."""
        if self._reach is None or self.modes.faces < _BLOCKS or self._met(bounds.proven):
            return bounds
        assert self._size is not None

        def note(step: str) -> None:
            self.route.append(step)
            self.programs += 1

        steps = BlockSweep(self.modes, self._size, self._reach, self.ceiling, lambda: self._left, note, self.offer)
        low = bounds.proven
        if self.modes.faces <= _AT_ONCE:
            low = max(low, steps.at_once(low))
        low = steps.sweep(low, none, none)
        self.ceiling = steps.ceiling
        return bounds.with_(low, low)

    def _sweep(self, bounds: _Bounds, closed: Bools, held: Bools, pairs: Bools, depth: int) -> _Bounds:
        """Relaxations of one region, each from the bound of the last; branches where they stall."""
        name, slack = "products" if depth == 0 else f"branch {depth}", _SLACK
        while not self._met(bounds.believed) and self._left > 0.0:
            low = bounds.believed
            statics = Statics(self.modes, low, self._above(low), held, self._size)
            region = Region(low, self._above(low), closed | statics.closed(), held)
            relaxed = self._relaxed(region, pairs, slack)
            if relaxed is None:
                self.route.append(f"{name}: no answer")
                return bounds
            self.route.append(name)
            certifies = self._reach is not None and bounds.proven >= low * (1.0 - tolerances.GAP)
            if certifies and slack < _MORE and not self._near(relaxed.multipliers.bound):
                # another step follows whatever this one proves
                slack = _MORE
                self.route.append("more slack")
                continue
            found = self._proven(region, relaxed, slack) if certifies else -math.inf
            if certifies and found == -math.inf and slack < _MORE:
                slack = min(slack / _FINER, _MORE)
                self.route.append("more slack")
                continue
            believed = -math.inf
            if relaxed.sure:
                believed = min(relaxed.multipliers.bound, self.ceiling * (1.0 + tolerances.GAP)) - _TRUSTED * abs(
                    self.ceiling
                )
            better = bounds.with_(found, believed)
            gained, bounds = better.believed - low, better
            if self.offer is not None and depth == 0:
                self.ceiling = min(self.ceiling, self.offer(relaxed.states))
            if gained > _STALL * (self.ceiling - low) or self._met(bounds.believed):
                continue
            if slack > _SLACK and self._near(bounds.believed):
                slack = max(slack * _FINER, _SLACK)
                self.route.append("less slack")
                continue
            more = _worst(relaxed.violated, pairs)
            if more is not None:
                pairs = pairs | more
                self.route.append("rows added")
            elif depth < _DEPTH:
                return self._branch(bounds, region, relaxed, pairs, depth)
            else:
                return bounds
        return bounds

    def _branch(self, bounds: _Bounds, region: Region, relaxed: Relaxed, pairs: Bools, depth: int) -> _Bounds:
        """Both sides of the mode that disagrees most with itself: on the mean it moves, and has slack."""
        apart = np.where(region.closed | region.held, 0.0, np.minimum(relaxed.rates, 1.0) * relaxed.slacks)
        mode = int(np.argmax(apart))
        if not apart[mode] > 0.0:
            return bounds
        one = np.arange(len(apart)) == mode
        still = self._sweep(bounds, region.closed | one, region.held, pairs, depth + 1)
        touching = self._sweep(bounds, region.closed, region.held | one, pairs, depth + 1)
        return still.least(touching)

    def _near(self, bound: float) -> bool:
        return bound >= self.ceiling - _FAR * max(abs(self.ceiling), _SLACK)

    def _relaxed(self, region: Region, pairs: Bools, slack: float) -> Relaxed | None:
        assert self._size is not None
        self.programs += 1
        earned = slack * max(abs(self.ceiling), 1.0) if self._reach is not None else 0.0
        return relax(self.modes, region, self._size, pairs, earned, max(self._left, 1.0))

    def _proven(self, region: Region, relaxed: Relaxed, slack: float) -> float:
        assert self._reach is not None
        assert self._size is not None
        earned = slack * max(abs(self.ceiling), 1.0)
        # what another step follows need not be proven with the least slack
        enough = self.ceiling - _ENOUGH * abs(self.ceiling) if slack == _SLACK else -math.inf
        return Certifier(self.modes, region, earned, self._size, self._reach).bound(relaxed.multipliers, enough)


def _worst(violated: Bools, pairs: Bools) -> Bools | None:
    """Violated rows that are not there yet; None where there are none."""
    fresh = violated & ~pairs
    return fresh if fresh.any() else None
