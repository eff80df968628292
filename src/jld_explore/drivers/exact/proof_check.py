"""Proof check: derive the claims of a finished proof again by other means than the search.

The check trusts neither the threads and processes of the search nor their formulas. It evaluates the work balance of
every mechanism again. It states the formula anew for another satisfiability solver (docs/guide/trust.md). Where a
mechanism keeps λ at more than was recorded, the conflict is corrected and the claims are raised to what it does prove.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_explore.drivers.exact.block_check import BlockConflictCheck
from jld_explore.drivers.exact.context import CheckedProof
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import Conflict, Evidence, Mechanism, ProofState
from jld_explore.space import SearchSpace
from jld_explore.space.measures import Range

_SOLVER: Final = "glucose42"  # satisfiability solver of the check, another one than that of the search

# Relative difference allowed when the bound of a mechanism is evaluated again. It covers rounding and is a thousandth
# of `tolerances.PROVEN`.
_BOUND_TOLERANCE: Final = 1e-9

# Share of the time of the proof allowed for refuting conflicts again. Only conflicts whose mechanism is no longer in
# memory are refuted again.
_REFUTATION_SHARE: Final = 0.03

_REFUTATION_SECONDS: Final = 0.2  # time, s, that is allowed for refuting such conflicts again in any case

_MECHANISMS_PER_CALL: Final = 256  # number of mechanisms evaluated in one call

# Relative rounding error of a load factor that was scaled and scaled back
_SCALING_ERROR: Final = 4.0 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Claim:
    """Claim that no labelling with a count exceeds a threshold.

    Labellings that were handed over and evaluated are excepted.

    count: value of the count of the front, bounds on it, or None for all labellings. threshold: scaled λ.
    """

    count: int | Range | None
    threshold: float


@dataclass(frozen=True)
class ProofCheck:
    """Result of checking a proof.

    problem: problem in one line, "" if the proof passed. seconds: time of the check, s. conflicts: number of conflicts
    that the claims rest on. weighed: number of those whose mechanism was evaluated, or that were refuted, again.
    corrected: conflicts whose mechanism keeps λ at more than was recorded, with the bound that it does prove. holds:
    claims that the corrected conflicts prove in place of those checked; empty where nothing is corrected, or where they
    do not prove these either.
    """

    problem: str
    seconds: float
    conflicts: int = 0
    weighed: int = 0
    corrected: tuple[Conflict, ...] = ()
    holds: tuple[Claim, ...] = ()

    @property
    def passed(self) -> bool:
        """True if the check found no problem."""
        return not self.problem

    def to_dict(self) -> dict[str, Any]:
        """Return the check as the entry `proof_check` of summary.json."""
        found: dict[str, Any] = {"passed": self.passed, "seconds": self.seconds}
        found |= {"conflicts": self.conflicts, "weighed": self.weighed}
        return found if self.passed else {**found, "problem": self.problem}


def check_proof(
    context: CheckedProof,
    state: ProofState,
    claims: Sequence[Claim],
    evaluated: tuple[Bits, Floats],
    problem: str,
    seconds: float,
) -> ProofCheck:
    """Check the claims of a finished proof by deriving them again from its conflicts.

    Mechanisms over faces that are in memory are all evaluated again. Other conflicts are refuted again in random
    order, for a limited time.
    The result names the first problem found; nothing is raised for a proof that fails.

    context: space, possible blocks, free faces and relaxation of the proof. state: conflicts, and labellings that no
    conflict refutes. claims: claims to check. evaluated: (k, m) the strongest evaluated labellings, and the scaled λ
    that each is proven to carry. problem: problem known before the check; "" for none. seconds: time that the proof
    took, s. Result: passed only if the conflicts, as far as checked, are valid and leave no labelling that exceeds a
    claim, except evaluated ones.
    """
    start = time.perf_counter()
    if problem:
        return ProofCheck(problem, time.perf_counter() - start)
    highest = max((_with_scaling_error(claim.threshold) for claim in claims), default=-math.inf)
    used = [one for one in state.conflicts if not one.from_cube and one.bound <= highest]
    conflict_check, block_check = _ConflictCheck(context), BlockConflictCheck(context)
    end = start + max(_REFUTATION_SECONDS, _REFUTATION_SHARE * seconds)
    conflict_check.weigh(used)
    conflict_check.refute_again(used, end)
    better = conflict_check.corrected
    left = [better.get(one.key, one) for one in used]
    raised = [_raised(claim, used, left) for claim in claims] if better else list(claims)
    problem = (
        _find_contradiction(left, context.space, *evaluated)
        or block_check.refute_again(left, end)
        or _find_open_labelling(context.space, context.blocks, left, state, raised)
    )
    holds = () if problem or not better else tuple(raised)
    higher = any(one.threshold > claim.threshold for one, claim in zip(raised, claims, strict=True))
    problem = problem or (conflict_check.problem if higher else "")
    done = conflict_check.done + block_check.done
    return ProofCheck(problem, time.perf_counter() - start, len(used), done, tuple(better.values()), holds)


def _raised(claim: Claim, used: Sequence[Conflict], left: Sequence[Conflict]) -> Claim:
    """Return a claim raised to the largest bound of the conflicts `used` for it, as corrected in `left`."""
    highest = _with_scaling_error(claim.threshold)
    bounds = [new.bound for old, new in zip(used, left, strict=True) if old.bound <= highest < new.bound]
    return replace(claim, threshold=max([claim.threshold, *bounds]))


class _ConflictCheck:
    """Repeated evaluation of conflicts.

    `done` counts those that were evaluated again. `corrected` has those that are wrong, by their keys, with the bound
    that holds; `problem` names the first of them.
    """

    def __init__(self, context: CheckedProof) -> None:
        self._relaxation, self._free, self._labels = context.relaxation, context.free, context.labels
        self.done, self.problem = 0, ""
        self.corrected: dict[tuple[bytes, bytes], Conflict] = {}

    def weigh(self, conflicts: Sequence[Conflict]) -> None:
        """Evaluate every mechanism in memory again."""
        cases = sorted({one.mechanism.case for one in conflicts if one.mechanism is not None})
        for case in cases:
            mine = [one for one in conflicts if one.mechanism is not None and one.mechanism.case == case]
            for some in _parts(mine):
                velocities = np.array([one.mechanism.velocity for one in some if one.mechanism is not None])
                found = self._relaxation.evaluate_mechanisms(case, velocities, *self._partial(some))
                claimed = np.array([one.bound for one in some])
                tolerance = _BOUND_TOLERANCE * np.maximum(1.0, abs(np.where(np.isfinite(claimed), claimed, 0.0)))
                for k in np.flatnonzero(~(found <= claimed + tolerance)).tolist():
                    problem = f"a mechanism that was to keep λ at {claimed[k]:.9g} keeps it at {found[k]:.9g} (scaled)"
                    self._correct(some[k], float(found[k]), problem)
                self.done += len(some)

    def _correct(self, conflict: Conflict, bound: float, problem: str) -> None:
        """Record that a conflict keeps λ at `bound`, or at less if a new mechanism does."""
        self.problem = self.problem or problem
        labels, undecided = self._partial([conflict])
        found = self._relaxation.least_bound(labels[0], undecided[0])
        if found is not None:
            weighed = self._relaxation.evaluate_mechanisms(found.case, found.velocity[None], labels, undecided)[0]
            if weighed < bound:
                bound = max(float(weighed), conflict.bound)
                conflict = replace(conflict, mechanism=Mechanism(found.case, found.velocity))
        self.corrected[conflict.key] = replace(conflict, bound=bound)

    def refute_again(self, conflicts: Sequence[Conflict], end: float) -> None:
        """Refute conflicts without a mechanism again, in random order, until a time.

        end: time to stop, on the clock of `time.perf_counter`, s.
        """
        lacking = [one for one in conflicts if one.mechanism is None and one.evidence is Evidence.MECHANISM]
        order = np.random.default_rng(len(lacking)).permutation(len(lacking))
        for some in _parts([lacking[k] for k in order.tolist()]):
            if time.perf_counter() >= end:
                break
            claimed = np.array([one.bound for one in some])
            tolerance = tolerances.PROVEN * np.maximum(1.0, abs(np.where(np.isfinite(claimed), claimed, 0.0)))
            thresholds = np.where(np.isfinite(claimed), claimed, 0.0) + tolerance
            found = self._relaxation.refute_all(*self._partial(some), thresholds)
            for k, one in enumerate(found):
                if one is None:
                    problem = f"a conflict on record that was to keep λ at {claimed[k]:.9g} is not refuted (scaled)"
                    self._correct(some[k], math.inf, problem)
            self.done += len(some)

    def _partial(self, conflicts: Sequence[Conflict]) -> tuple[Bits, Bools]:
        """Return labels (k, m), True = dry, and undecided faces (k, m) of k conflicts."""
        labels = np.tile(self._labels, (len(conflicts), 1))
        undecided = np.tile(self._free, (len(conflicts), 1))
        for k, one in enumerate(conflicts):
            labels[k, one.faces] = one.labels
            undecided[k, one.faces] = False
        return labels, undecided


def _parts(conflicts: Sequence[Conflict]) -> Iterator[Sequence[Conflict]]:
    """Yield conflicts in groups of at most `_MECHANISMS_PER_CALL`."""
    for first in range(0, len(conflicts), _MECHANISMS_PER_CALL):
        yield conflicts[first : first + _MECHANISMS_PER_CALL]


def _find_contradiction(conflicts: Sequence[Conflict], space: SearchSpace, labellings: Bits, loads: Floats) -> str:
    """Return a problem if an evaluated labelling carries more than a conflict allows, else "".

    labellings: (k, m) True = dry. loads: (k,) scaled λ that each is proven to carry.
    """
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


def _find_open_labelling(
    space: SearchSpace,
    blocks: PossibleBlocks | None,
    conflicts: Sequence[Conflict],
    state: ProofState,
    claims: Sequence[Claim],
) -> str:
    """Return a problem if a formula stated anew leaves a labelling above a claim, else "".

    A labelling that was handed over and has no evaluation must be refuted by a conflict like any other.
    """
    formula = Formula(space, blocks, _SOLVER)
    formula.learn(conflicts, filter(state.is_evaluated, state.handed_over))
    for claim in claims:
        formula.aim(_with_scaling_error(claim.threshold), claim.count)
        if formula.next() is not None:
            waiting = len(state.without_evaluation)
            return (
                "a layout is left that no conflict refutes and that was not evaluated"
                f" ({waiting} were handed over and wait for their evaluation)"
            )
    if formula.undecided:
        number = f"for {formula.undecided} layouts that no conflict refutes"
        return f"{number} the search for an order whose stages stand stopped at its limit"
    return ""


def _with_scaling_error(threshold: float) -> float:
    """Return a scaled λ raised by the rounding of scaling."""
    return threshold + _SCALING_ERROR * abs(threshold) if math.isfinite(threshold) else threshold
