"""Check a finished proof: what was claimed is derived again from what is in memory, by other means than the search.

The check trusts neither the threads and processes that searched nor the formulas that they shared. It weighs every
mechanism again, and states the formula anew for another satisfiability solver (docs/guide/trust.md).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit import AnyRelaxation
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.space import Range, SearchSpace

_SOLVER: Final = "glucose42"
"""Satisfiability solver of the check: another one than that of the search."""

_WEIGHED_AGAIN: Final = 1e-9
"""Difference, relative, that a mechanism may show when it is weighed again: rounding, and a thousandth of PROVEN."""

_SHARE: Final = 0.03
"""Part of the time of the proof that may be spent on proving again conflicts whose mechanism is not in memory."""

_LEAST_SECONDS: Final = 0.2
"""Seconds that may be spent on them in any case."""

_TOGETHER: Final = 256
"""Mechanisms weighed at a time."""

_ROOM: Final = 4.0 * float(np.finfo(float).eps)
"""Relative rounding of a load factor that was scaled and scaled back."""


@dataclass(frozen=True)
class Claim:
    """No layout with a count has a scaled λ above a threshold, except those that were handed over and evaluated.

    count: value of the front's count, bounds on it, or None for all layouts.
    """

    count: int | Range | None
    threshold: float


@dataclass(frozen=True)
class ProofCheck:
    """Result of checking a proof.

    problem: one line, "" where the proof passed. seconds: time of the check. conflicts: how many the claims rest on;
    weighed: how many of them had their mechanism weighed again, or were proven again.
    """

    problem: str
    seconds: float
    conflicts: int = 0
    weighed: int = 0

    @property
    def passed(self) -> bool:
        """Whether nothing was wrong."""
        return not self.problem

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of summary.json."""
        found: dict[str, Any] = {"passed": self.passed, "seconds": self.seconds}
        found |= {"conflicts": self.conflicts, "weighed": self.weighed}
        return found if self.passed else {**found, "problem": self.problem}


def check_proof(
    relaxation: AnyRelaxation,
    space: SearchSpace,
    blocks: PossibleBlocks | None,
    free: Bools,
    state: ProofState,
    claims: Sequence[Claim],
    evaluated: tuple[Bits, Floats],
    problem: str,
    seconds: float,
) -> ProofCheck:
    """Check the claims that a proof ends with.

    Parameters
    ----------
    relaxation : Relaxation or CaseRelaxation
        Weighs mechanisms.
    space : SearchSpace
        The layouts that the claims are about.
    blocks : PossibleBlocks or None
        Possible blocks, where they are listed.
    free : (m,) bool array
        Faces that may have either label in some layout.
    state : ProofState
        Conflicts and handed-over layouts.
    claims : sequence of Claim
        What is claimed to be proven.
    evaluated : (k, m) bool array and (k,) float array
        The strongest evaluated layouts, and the scaled λ that each is proven to carry.
    problem : str
        What is known to be wrong before the check begins; "" for nothing.
    seconds : float
        Time that the proof took, s.

    Returns
    -------
    ProofCheck
        Passed only where every layout that exceeds a claim is refuted by a conflict that holds, or was evaluated.
    """
    start = time.perf_counter()
    if problem:
        return ProofCheck(problem, time.perf_counter() - start)
    highest = max((_raised(claim.threshold) for claim in claims), default=-math.inf)
    used = [one for one in state.conflicts if not one.closed and one.bound <= highest]
    weighing = _Weighing(relaxation, space, free)
    problem = (
        weighing.weigh(used)
        or weighing.prove_again(used, start + max(_LEAST_SECONDS, _SHARE * seconds))
        or _contradicted(used, space, *evaluated)
        or _left_over(space, blocks, used, state, claims)
    )
    return ProofCheck(problem, time.perf_counter() - start, len(used), weighing.done)


class _Weighing:
    """Conflicts that are weighed again. `done`: how many were."""

    def __init__(self, relaxation: AnyRelaxation, space: SearchSpace, free: Bools) -> None:
        self._relaxation, self._free = relaxation, free
        # candidates that no possible block contains are dry
        self._labels = space.fixed | (space.candidates & ~free)
        self.done = 0

    def weigh(self, conflicts: Sequence[Conflict]) -> str:
        """Weigh again every mechanism in memory; return what is wrong, "" for nothing."""
        cases = sorted({one.mechanism.case for one in conflicts if one.mechanism is not None})
        for case in cases:
            mine = [one for one in conflicts if one.mechanism is not None and one.mechanism.case == case]
            for some in _parts(mine):
                velocities = np.array([one.mechanism.velocity for one in some if one.mechanism is not None])
                found = self._relaxation.weigh(case, velocities, *self._partial(some))
                claimed = np.array([one.bound for one in some])
                room = _WEIGHED_AGAIN * np.maximum(1.0, abs(np.where(np.isfinite(claimed), claimed, 0.0)))
                wrong = np.flatnonzero(~(found <= claimed + room))
                if wrong.size:
                    k = int(wrong[0])
                    return f"a mechanism that was to keep λ at {claimed[k]:.9g} keeps it at {found[k]:.9g} (scaled)"
                self.done += len(some)
        return ""

    def prove_again(self, conflicts: Sequence[Conflict], end: float) -> str:
        """Refute again, at random, conflicts whose mechanism is not in memory; return what is wrong, "" for nothing.

        end: when to stop, as `time.perf_counter` counts.
        """
        lacking = [one for one in conflicts if one.mechanism is None and one.evidence is Evidence.MECHANISM]
        order = np.random.default_rng(len(lacking)).permutation(len(lacking))
        for some in _parts([lacking[k] for k in order.tolist()]):
            if time.perf_counter() >= end:
                break
            claimed = np.array([one.bound for one in some])
            room = tolerances.PROVEN * np.maximum(1.0, abs(np.where(np.isfinite(claimed), claimed, 0.0)))
            thresholds = np.where(np.isfinite(claimed), claimed, 0.0) + room
            found = self._relaxation.refute_all(*self._partial(some), thresholds)
            for k, one in enumerate(found):
                if one is None:
                    return f"a conflict on record that was to keep λ at {claimed[k]:.9g} is not refuted (scaled)"
            self.done += len(some)
        return ""

    def _partial(self, conflicts: Sequence[Conflict]) -> tuple[Bits, Bools]:
        """Labels (k, m), and which faces are undecided, (k, m)."""
        labels = np.tile(self._labels, (len(conflicts), 1))
        undecided = np.tile(self._free, (len(conflicts), 1))
        for k, one in enumerate(conflicts):
            labels[k, one.faces] = one.labels
            undecided[k, one.faces] = False
        return labels, undecided


def _parts(conflicts: Sequence[Conflict]) -> Iterator[Sequence[Conflict]]:
    for first in range(0, len(conflicts), _TOGETHER):
        yield conflicts[first : first + _TOGETHER]


def _contradicted(conflicts: Sequence[Conflict], space: SearchSpace, labellings: Bits, loads: Floats) -> str:
    """What is wrong where an evaluated layout carries more than a conflict allows it, "" for nothing."""
    if not len(conflicts) or not len(labellings):
        return ""
    dry, inner = np.zeros((2, len(conflicts), len(space.fixed)), dtype=np.float32)
    for k, one in enumerate(conflicts):
        dry[k, one.faces[one.labels]] = 1.0
        inner[k, one.faces[~one.labels]] = 1.0
    bounds = np.array([one.bound for one in conflicts])
    for labels, load in zip(labellings, loads.tolist(), strict=True):
        weaker = np.flatnonzero(load > bounds + tolerances.PROVEN * np.maximum(1.0, abs(load)))
        if not weaker.size:
            continue
        images = labels[space.group].astype(np.float32)
        differing = dry[weaker] @ (1.0 - images.T) + inner[weaker] @ images.T
        matching = np.flatnonzero((differing == 0.0).any(axis=1))
        if matching.size:
            bound = bounds[weaker[matching[0]]]
            return f"a layout carries {load:.9g}, and a conflict allows it {bound:.9g} (scaled)"
    return ""


def _left_over(
    space: SearchSpace,
    blocks: PossibleBlocks | None,
    conflicts: Sequence[Conflict],
    state: ProofState,
    claims: Sequence[Claim],
) -> str:
    """What is wrong where a formula that is stated anew leaves a layout, "" for nothing.

    A layout that was handed over and has no evaluation must be refuted by a conflict, as any other.
    """
    formula = Formula(space, blocks, _SOLVER)
    formula.learn(conflicts, filter(state.is_evaluated, state.handed_over))
    for claim in claims:
        formula.aim(_raised(claim.threshold), claim.count)
        if formula.next() is not None:
            waiting = len(state.without_evaluation)
            return (
                "a layout is left that no conflict refutes and that was not evaluated"
                f" ({waiting} were handed over and wait for their evaluation)"
            )
    return ""


def _raised(threshold: float) -> float:
    """A scaled λ with the rounding of scaling on top."""
    return threshold + _ROOM * abs(threshold) if math.isfinite(threshold) else threshold
