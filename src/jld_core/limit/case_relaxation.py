"""Relaxations under several load cases.

A mechanism of any one case refutes a governing factor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.batch import ConflictRequest
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_batch import BlockMechanism
from jld_core.limit.block_relaxation import Asked, BlockRelaxation, Choice
from jld_core.limit.dual_bounds import DualBound, MinimizedConflict
from jld_core.limit.partial_labellings import PartialLabellingBounds
from jld_core.limit.relaxation import Relaxation

# Relative amount by which bounds are raised and thresholds lowered on a change of units, so that bounds stay valid
_ROUNDING = 4.0 * float(np.finfo(float).eps)


_Kind = TypeVar("_Kind", Relaxation, BlockRelaxation)  # kind of relaxation of the single load cases


class _Cases(Generic[_Kind]):
    """Relaxations of all load cases, with their units, in the order in which they are asked.

    A unit is the governing factor per scaled λ of a case. The case that refuted most comes first.
    """

    def __init__(self, cases: Sequence[_Kind], required: Sequence[float]) -> None:
        self._cases: list[_Kind] = list(cases)
        self._units = [one.template.scaling.load / factor for one, factor in zip(cases, required, strict=True)]
        self._order = list(range(len(self._cases)))

    @property
    def solves(self) -> int:
        """Return the number of programs solved so far."""
        return sum(one.solves for one in self._cases)

    @property
    def batched(self) -> bool:
        """Return True if the batch solver solves the programs of every case many at a time."""
        return all(one.batched for one in self._cases)

    def _reorder(self, refuted: Sequence[int]) -> None:
        """Sort the load cases by their numbers of refutations (c,), most first.

        The order is a new list, as other threads may iterate over the old one.
        """
        self._order = sorted(self._order, key=lambda case: -refuted[case])


def _raised(bound: float) -> float:
    """Raise a bound by the rounding error of a change of units."""
    return bound + abs(bound) * _ROUNDING if math.isfinite(bound) else bound


class CaseRelaxation(_Cases[Relaxation], PartialLabellingBounds):
    """Upper bounds on the governing factor of partial labellings under several load cases.

    The governing factor is the minimum over cases of λ / required. Bounds and thresholds are governing factors, not
    scaled. The case that refuted most is tried first. Methods are documented in `PartialLabellingBounds`.

    cases: relaxation of each load case. required: required factor of each case.
    """

    @property
    def unit(self) -> float:
        """Return the governing factor per unit of the bounds: 1, as they are not scaled."""
        return 1.0

    @property
    def each(self) -> tuple[Relaxation, ...]:
        """Return the relaxations of all load cases, in the order of the cases."""
        return tuple(self._cases)

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Refute governing factors of partial labellings, case by case.

        labellings, undecided: (k, m) labels, True = dry, and faces that may have either. thresholds: (k,) governing
        factors. thorough: (k,) True where another solver is tried if the batch solver finds no proof; None: everywhere.
        The result has, for each labelling, the mechanism of the first case that refutes its threshold, or None.
        """
        found: list[DualBound | None] = [None] * len(labellings)
        left = np.arange(len(labellings))
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not left.size:
                break
            unit = self._units[case]
            careful = None if thorough is None else thorough[left]
            answers = self._cases[case].refute_all(labellings[left], undecided[left], thresholds[left] / unit, careful)
            for k, one in zip(left.tolist(), answers, strict=True):
                if one is not None:
                    found[k] = replace(one, bound=_raised(one.bound * unit), case=case)
                    counts[case] += 1
            left = np.array([k for k in left.tolist() if found[k] is None], dtype=np.int64)
        self._reorder(counts)
        return found

    def minimize_conflicts(self, request: ConflictRequest) -> list[MinimizedConflict]:
        """Minimise conflicts of labellings, each under the first case that refutes it.

        Labellings that no case refutes come last, without bound. Parameters: see
        `PartialLabellingBounds.minimize_conflicts`.
        """
        found: list[MinimizedConflict] = []
        left, carried = np.arange(len(request.labellings)), np.ones(len(request.labellings), dtype=bool)
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not left.size:
                break
            unit = self._units[case]
            fallen: set[int] = set()
            for one in self._cases[case].minimize_conflicts(request.take(left).in_units(unit)):
                labelling = int(left[one.labelling])
                if one.bound is None:
                    carried[labelling] &= one.carries or not one.drawn
                    continue
                found.append(replace(one, labelling=labelling, bound=_raised(one.bound * unit), case=case))
                if one.drawn:
                    fallen.add(labelling)
            counts[case] = len(fallen)
            left = np.array([k for k in left.tolist() if k not in fallen], dtype=np.int64)
        self._reorder(counts)
        return found + [MinimizedConflict(k, True, request.free, None, bool(carried[k])) for k in left.tolist()]

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Bound governing factors (k,) by known mechanisms of one case.

        case: index of the case. velocities: (k, q·free) scaled. labellings, undecided: (k, m) labels, True = dry, and
        faces that may have either. The result is inf where a mechanism proves nothing. Raises ValueError for an unknown
        case.
        """
        if not 0 <= case < len(self._cases):
            raise ValueError(f"case: there is no load case {case}; expected 0 to {len(self._cases) - 1}")
        bounds = self._cases[case].evaluate_mechanisms(0, velocities, labellings, undecided) * self._units[case]
        return np.array([_raised(bound) for bound in bounds.tolist()])

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the mechanism of the least bound over all load cases; None if no case has one.

        labels, undecided: (m,) labels, True = dry, and faces that may have either.
        """
        found = [one.least_bound(labels, undecided) for one in self._cases]
        known = [
            replace(one, bound=_raised(one.bound * unit), case=case)
            for case, (one, unit) in enumerate(zip(found, self._units, strict=True))
            if one is not None
        ]
        return min(known, key=lambda one: one.bound, default=None)


class CaseBlockRelaxation(_Cases[BlockRelaxation]):
    """Block relaxation under several load cases, with bounds on the governing factor.

    Bounds and thresholds are governing factors, not scaled. The least bound of all cases holds. The case that refuted
    most is asked first, and after a refutation the remaining cases are skipped.

    cases: block relaxation of each load case. required: required factor of each case.
    """

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """Bound the governing factor over the segmentations into allowed blocks.

        allowed: (p,) blocks that may be chosen. threshold: governing factor that segmentations must reach to be of
        interest. most: upper bound on the governing factor of these segmentations, finite.
        """
        return self.bound_all([(allowed, threshold, most)])[0]

    def evaluate(self, mechanism: BlockMechanism, allowed: Bools, threshold: float, most: float) -> Choice:
        """Bound the governing factor by the mechanism of an earlier program.

        Parameters and result: see `BlockRelaxation.evaluate`; values are governing factors.
        """
        unit = self._units[mechanism.case]
        scaled = self._in_units(threshold, most, unit)
        found = self._cases[mechanism.case].evaluate(mechanism, allowed, *scaled)
        bound = threshold if found.refuted else _raised(found.bound * unit)
        return replace(found, bound=min(most, bound), mechanisms=(mechanism,))

    def bound_all(self, asked: Sequence[Asked], pool: ThreadPoolExecutor | None = None) -> list[Choice]:
        """Bound the governing factor for many sets of allowed blocks.

        asked: arguments of `choose` for each set. pool: supplies one more thread for the batch solver.
        """
        found: list[Choice | None] = [None] * len(asked)
        left, counts = list(range(len(asked))), [0] * len(self._cases)
        for case in tuple(self._order):
            unit = self._units[case]
            scaled = [(allowed, *self._in_units(threshold, most, unit)) for allowed, threshold, most in asked]
            answers = self._cases[case].bound_all([scaled[k] for k in left], pool)
            for k, one in zip(left, answers, strict=True):
                _, threshold, most = asked[k]
                before = found[k]
                useless = one.useless if before is None else one.useless | before.useless
                proof = tuple(replace(mechanism, case=case) for mechanism in one.mechanisms)
                proof = proof if before is None else (*before.mechanisms, *proof)
                if one.refuted:
                    counts[case] += 1
                    found[k] = replace(one, bound=min(most, threshold), useless=useless, mechanisms=proof)
                    continue
                bound = min(most, _raised(one.bound * unit))
                if before is None or bound < before.bound:
                    found[k] = replace(one, bound=bound, useless=useless, mechanisms=proof)
                else:
                    found[k] = replace(before, useless=useless, mechanisms=proof)
            left = [k for k in left if (known := found[k]) is not None and not known.refuted]
        self._reorder(counts)
        return [one for one in found if one is not None]

    @staticmethod
    def _in_units(threshold: float, most: float, unit: float) -> tuple[float, float]:
        """Convert two governing factors to scaled λ of a case, rounded so that bounds stay valid.

        threshold is rounded down, most is rounded up. unit: governing factor per scaled λ of the case.
        """
        return (threshold - abs(threshold) * _ROUNDING) / unit, _raised(most) / unit


AnyRelaxation = Relaxation | CaseRelaxation
"""Relaxation of partial labellings under one load or several load cases."""

AnyBlockRelaxation = BlockRelaxation | CaseBlockRelaxation
"""Block relaxation under one load or several load cases."""


def relaxation_of(assembly: Assembly, analyses: Sequence[LimitAnalysis] = ()) -> AnyRelaxation | None:
    """Create the relaxation of a structure, for its load or for all its load cases.

    assembly: the structure. analyses: analyses of its load cases, in their order, if they exist already. Result: the
    relaxation; None where no hull of the yield sets is known.
    """
    known = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    if any(analysis.template.yield_set.hull() is None for analysis in known):
        return None
    each = [Relaxation(analysis) for analysis in known]
    return CaseRelaxation(each, assembly.required.tolist()) if assembly.cases else each[0]


def block_relaxation_of(
    assembly: Assembly,
    members: Sequence[Sequence[int]],
    inside: Sequence[Sequence[int]],
    analyses: Sequence[LimitAnalysis] = (),
    seconds: float = math.inf,
) -> AnyBlockRelaxation:
    """Create the block relaxation of a structure, for its load or for all its load cases.

    assembly: the structure. members: elements of each possible block. inside: faces inside each block. analyses:
    analyses of its load cases, in their order, if they exist already. seconds: time limit of one program, seconds, see
    `BlockRelaxation`. Raises TypeError if there is no block relaxation of the structure (`applies_to`).
    """
    known = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    each = [BlockRelaxation(analysis, members, inside, seconds) for analysis in known]
    return CaseBlockRelaxation(each, assembly.required.tolist()) if assembly.cases else each[0]
