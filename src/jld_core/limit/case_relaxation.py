"""Partial labellings under several load cases: a mechanism of any case rules out what is too weak under that case."""

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
from jld_core.limit.block_relaxation import Asked, BlockRelaxation, Choice
from jld_core.limit.relaxation import DualBound, MinimizedConflict, Relaxation

_ROUNDING = 4.0 * float(np.finfo(float).eps)
"""Part by which bounds are raised, and thresholds lowered, so that nothing is lost by putting them into other units."""


_Kind = TypeVar("_Kind", Relaxation, BlockRelaxation)


class _Cases(Generic[_Kind]):
    """The relaxation of every case, what its scaled λ are of the governing factor, and which case is asked first: the
    one that refuted most."""

    def __init__(self, cases: Sequence[_Kind], required: Sequence[float]) -> None:
        self._cases: list[_Kind] = list(cases)
        self._units = [one.template.scaling.load / factor for one, factor in zip(cases, required, strict=True)]
        self._order = list(range(len(self._cases)))

    @property
    def solves(self) -> int:
        """Programs solved so far."""
        return sum(one.solves for one in self._cases)

    @property
    def many(self) -> bool:
        """Whether programs of every case are solved many at a time."""
        return all(one.many for one in self._cases)

    def _reorder(self, refuted: Sequence[int]) -> None:
        """Ask those first that refuted most, (c,); as a new list: other threads may be at the last one."""
        self._order = sorted(self._order, key=lambda case: -refuted[case])


def _raised(bound: float) -> float:
    """A bound that was put into other units, no lower than it was."""
    return bound + abs(bound) * _ROUNDING if math.isfinite(bound) else bound


class CaseRelaxation(_Cases[Relaxation]):
    """Upper bounds on the governing factor, min over cases of λ / required, for partial labellings; not scaled.

    cases: the relaxation of each case. required: factor of each. The case that refuted most is asked first.
    """

    @property
    def unit(self) -> float:
        """Governing factor for each of what is bounded here: 1, as it has no scale."""
        return 1.0

    @property
    def each(self) -> tuple[Relaxation, ...]:
        """The relaxation of every case."""
        return tuple(self._cases)

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """A proof, by one case, that no labelling that agrees where decided reaches a factor; None where none is found.

        labels: (m,) True dry. undecided: (m,). threshold: governing factor.
        """
        return self.refute_all(labels[None], undecided[None], np.array([threshold]))[0]

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """The same for labellings and undecided faces (k, m), factors (k,); thorough (k,) as of one case."""
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

    def minimize_conflicts(self, asked: ConflictRequest) -> list[MinimizedConflict]:
        """See `Relaxation.minimize_conflicts`, with governing factors: each labelling under the first case that refutes
        it."""
        found: list[MinimizedConflict] = []
        left, carried = np.arange(len(asked.labellings)), np.ones(len(asked.labellings), dtype=bool)
        counts = [0] * len(self._cases)
        for case in tuple(self._order):
            if not left.size:
                break
            unit = self._units[case]
            fallen: set[int] = set()
            for one in self._cases[case].minimize_conflicts(asked.take(left).in_units(unit)):
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
        return found + [MinimizedConflict(k, True, asked.free, None, bool(carried[k])) for k in left.tolist()]

    def weigh(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Weigh known mechanisms again: see `Relaxation.weigh`; bounds (k,) are governing factors."""
        if not 0 <= case < len(self._cases):
            raise ValueError(f"case: there is no load case {case}; expected 0 to {len(self._cases) - 1}")
        bounds = self._cases[case].weigh(0, velocities, labellings, undecided) * self._units[case]
        return np.array([_raised(bound) for bound in bounds.tolist()])

    def bound(self, labels: Bits, undecided: Bools) -> float:
        """Governing factor that no labelling exceeds that agrees where decided; inf where none was found."""
        found = self.least_bound(labels, undecided)
        return np.inf if found is None else found.bound

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """The mechanism, of any case, of least governing factor; None where none was found."""
        found = [one.least_bound(labels, undecided) for one in self._cases]
        known = [
            replace(one, bound=_raised(one.bound * unit), case=case)
            for case, (one, unit) in enumerate(zip(found, self._units, strict=True))
            if one is not None
        ]
        return min(known, key=lambda one: one.bound, default=None)


class CaseBlockRelaxation(_Cases[BlockRelaxation]):
    """The relaxation by blocks under several load cases: no segmentation has more than any one case leaves it.

    cases: the relaxation of each case. required: factor of each. Bounds are of the governing factor, not scaled. The
    case that refuted most is asked first, and where one refutes the others are not asked.
    """

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """What is known of the segmentations into allowed blocks (p,); threshold, most: governing factors."""
        return self.bound_all([(allowed, threshold, most)])[0]

    def bound_all(self, asked: Sequence[Asked], pool: ThreadPoolExecutor | None = None) -> list[Choice]:
        """The same of many at a time; pool: as of one case."""
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
                if one.refuted:
                    counts[case] += 1
                    found[k] = replace(one, bound=min(most, threshold), useless=useless)
                    continue
                bound = min(most, _raised(one.bound * unit))
                if before is None or bound < before.bound:
                    found[k] = replace(one, bound=bound, useless=useless)
                else:
                    found[k] = replace(before, useless=useless)
            left = [k for k in left if (known := found[k]) is not None and not known.refuted]
        self._reorder(counts)
        return [one for one in found if one is not None]

    @staticmethod
    def _in_units(threshold: float, most: float, unit: float) -> tuple[float, float]:
        """Governing factors as scaled λ of a case, so that nothing is lost by it."""
        return (threshold - abs(threshold) * _ROUNDING) / unit, _raised(most) / unit


AnyRelaxation = Relaxation | CaseRelaxation
"""What refutes partial labellings, under one load or several."""

AnyBlockRelaxation = BlockRelaxation | CaseBlockRelaxation
"""The same of choices of blocks."""


def relaxation_of(assembly: Assembly, analyses: Sequence[LimitAnalysis] = ()) -> AnyRelaxation | None:
    """The relaxation of a structure under its load or all of its cases; None where no hull is known of its faces.

    analyses: of its cases, in their order, where they are at hand.
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
    """The relaxation by blocks of a structure under its load or all of its cases.

    members, inside, seconds: see `BlockRelaxation`. analyses: of its cases, in their order, where they are at hand.
    Raises TypeError where there is none (`applies_to`).
    """
    known = analyses or [LimitAnalysis(case) for case in assembly.by_case]
    each = [BlockRelaxation(analysis, members, inside, seconds) for analysis in known]
    return CaseBlockRelaxation(each, assembly.required.tolist()) if assembly.cases else each[0]
