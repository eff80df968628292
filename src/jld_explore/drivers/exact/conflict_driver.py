"""Common base of the exact drivers: relaxations, possible blocks, formula and conflicts."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats
from jld_core.deadline import Deadline
from jld_explore.drivers.base import Aim, Driver, DriverOptions
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.conflict_sources import ConflictSources
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_check import Claim, ProofCheck, check_proof
from jld_explore.drivers.exact.proof_state import BlockEvidence, Conflict, Evidence, Mechanism, ProofState
from jld_explore.evaluation import Evaluation, Records
from jld_explore.space import Count, SearchSpace

if TYPE_CHECKING:
    import pandas as pd


_CORRECTIONS: Final = 3  # number of times that a proof goes on after its check has corrected conflicts


class ExactOptions(DriverOptions):
    """Options of the exact driver.

    aim: prove the largest load factor, or the largest for every value of the count.
    """

    aim: Aim = Field("best", description="best, or front (the best for every count)")


class ConflictDriver(Driver):
    """Driver that proves its result by conflicts, or by enumeration where those do not apply.

    A conflict is labels on some faces that no labelling above a λ has together. Enumeration proves the same. It is
    used where the space has no formula or no relaxation.

    counted: count that the formula must express besides the limited counts. list_blocks: whether to list the possible
    blocks where they are few enough. enumerates: whether to enumerate although conflicts apply, because no formula
    expresses the aim.
    """

    name = "exact"
    remembers = True
    modular = True
    checks = True
    Options = ExactOptions

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        counted: Count | None,
        *,
        list_blocks: bool = True,
        solo_relaxations: int | None = None,
        enumerates: bool = False,
    ) -> None:
        super().__init__(space, seed)
        self._context = None if enumerates else ProofContext.of(space, seed, counted, list_blocks=list_blocks)
        self._enumeration = Enumeration(space) if self._context is None else None
        self._scale = 1.0 if self._context is None else self._context.relaxation.unit
        self._state = ProofState(space)
        self._formula: Formula | None = None
        self._conflicts_in_formula = self._handed_over_in_formula = 0
        self._solo_relaxations, self._jobs = solo_relaxations, 1
        self._sources = self._new_sources()
        self._waiting = self._no_labellings
        self._proof_check: ProofCheck | None = None
        self._contradictions: list[str] = []
        self._corrections = 0
        self._deadline = Deadline()
        self._heartbeat: Callable[[], None] = lambda: None
        self._started_at = time.perf_counter()

    @property
    def exhaustive(self) -> bool:
        """True if the driver enumerates its space; see `Driver.exhaustive`."""
        return self._enumeration is not None

    def _new_sources(self) -> ConflictSources | None:
        """Return new conflict sources, or None for an enumerated space."""
        if self._context is None:
            return None
        return ConflictSources(self._context, self._state, self._solo_relaxations)

    @property
    def context(self) -> ProofContext:
        """Data that stay fixed during the proof; raises RuntimeError for an enumerated space."""
        if self._context is None:
            raise RuntimeError("an enumerated space has no proof by conflicts")
        return self._context

    @property
    def sources(self) -> ConflictSources:
        """Conflict sources of the proof; raises RuntimeError for an enumerated space."""
        if self._sources is None:
            raise RuntimeError("an enumerated space has no conflict sources")
        return self._sources

    @property
    def formula(self) -> Formula:
        """Formula of the present target; raises RuntimeError before the first target."""
        if self._formula is None:
            raise RuntimeError("the proof has no formula before its first target")
        return self._formula

    @property
    def state(self) -> ProofState:
        """State of the proof: conflicts, and labellings that no conflict refutes."""
        return self._state

    @property
    def conflicts(self) -> int:
        """Number of conflicts found."""
        return len(self._state.conflicts)

    @property
    def proof_check(self) -> ProofCheck | None:
        """Result of checking the finished proof; None before the check."""
        return self._proof_check

    @property
    def relaxations(self) -> int:
        """Number of relaxations solved in all threads and processes."""
        here = 0 if self._context is None else self._context.relaxation.solves
        return here + (0 if self._sources is None else self._sources.solves)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """Return the cost of the proof and the result of its check; see `Driver.facts`."""
        found: dict[str, Any] = {"conflicts": self.conflicts, "relaxations": self.relaxations}
        if self._proof_check is not None:
            found["proof_check"] = self._proof_check.to_dict()
        elif self._enumeration is not None and complete:
            # Every symmetry class has an evaluation, so nothing was inferred about labellings that were not
            # evaluated.
            found["proof_check"] = ProofCheck("", 0.0).to_dict()
        return found

    @property
    def complaints(self) -> list[str]:
        """Contradictions found, and a failed check of the proof; see `Driver.complaints`."""
        failed = self._proof_check is not None and not self._proof_check.passed
        return [*self._contradictions, *([f"not proven: {self._proof_check.problem}"] if failed else [])]  # type: ignore[union-attr]

    def withdraw(self, reason: str) -> None:
        """Forget all conflicts and start the proof again; see `Driver.withdraw`.

        After a second contradiction the proof is given up.
        """
        self._contradictions.append(reason)
        self._begin_again(self._state.clear)

    def _begin_again(self, change: Callable[[], None]) -> None:
        """Stop the sources of conflicts, change the state of the proof, and begin with new sources and formula."""
        if self._sources is not None:
            self._sources.close()
        change()
        self._formula, self._conflicts_in_formula, self._handed_over_in_formula = None, 0, 0
        self._waiting = self._no_labellings
        self._sources = self._new_sources()
        if self._sources is not None:
            self._sources.set_workers(self._jobs)

    def _take_up(self, check: ProofCheck) -> bool:
        """Correct conflicts that a check found wrong; return True if the proof goes on from what holds.

        It does unless the check found another problem, or conflicts were corrected `_CORRECTIONS` times already.
        """
        if not check.corrected:
            return False
        reason = check.problem or "a bound is corrected"
        self._begin_again(lambda: self._state.conflicts.correct(check.corrected, reason))
        self._corrections += 1
        return bool(check.holds) and self._corrections <= _CORRECTIONS

    @property
    def _given_up(self) -> bool:
        """True if the proof was contradicted again after its restart."""
        return len(self._contradictions) > 1

    def set_workers(self, jobs: int) -> None:
        """Set the number of workers that refute parts of the space; see `Driver.set_workers`."""
        self._jobs = jobs
        if self._sources is not None:
            self._sources.set_workers(jobs)

    def close(self) -> None:
        """Stop all workers and save the conflicts; see `Driver.close`."""
        if self._sources is not None:
            self._sources.close()
            self._state.conflicts.save()

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """Set deadline, heartbeat and records of the search; see `Driver.start`."""
        # The search stops early enough to evaluate the labellings found last.
        self._deadline = Deadline() if deadline is None else deadline.earlier(0.3)
        self._heartbeat = heartbeat
        self._started_at = time.perf_counter()
        if records is not None and self._context is not None:
            self._state.conflicts.keep(records, self._context.key)

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take over evaluations of labellings (k, m) from a resumed study; see `Driver.restore`."""
        self._learn(labellings, evaluations)
        self._state.note_evaluated(labellings)

    @abstractmethod
    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None: ...

    @property
    def _no_labellings(self) -> Bits:
        """Empty array of labellings (0, m)."""
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    @property
    def _time_is_up(self) -> bool:
        """True if the deadline has passed."""
        return self._deadline.passed()

    def _time_is_up_after_heartbeat(self) -> bool:
        """Report progress, then return True if time is up."""
        self._heartbeat()
        return self._time_is_up

    def _take_waiting(self, limit: int | None) -> Bits:
        """Remove and return at most `limit` of the labellings that wait for evaluation."""
        given = self._waiting[:limit]
        self._waiting = self._waiting[len(given) :]
        return given

    def _generate(self, sources: ConflictSources, threshold: float) -> bool:
        """Find and save conflicts for a short time; return True if no labelling is left.

        `threshold` is a λ in scene units.
        """
        exhausted = sources.step(threshold / self._scale)
        self._state.conflicts.save()
        self._heartbeat()
        return exhausted

    def _labellings_to_evaluate(self) -> Bits:
        """Return the labellings (k, m) that wait for evaluation; empty their queue.

        They are also excluded from the formula.
        """
        self._exclude_handed_over()
        return self._state.take_waiting()

    def _hand_over(self, labels: Bits) -> None:
        """Hand over a labelling (m,) that no mechanism refuted."""
        self._state.hand_over([labels])

    def _exclude_handed_over(self) -> None:
        """Exclude from the formula the labellings handed over since the last call."""
        if self._formula is not None:
            new = self._state.handed_over_since(self._handed_over_in_formula)
            self._formula.learn((), new)
            self._handed_over_in_formula += len(new)

    def _updated_formula(self) -> Formula:
        """Return the formula with all conflicts and handed-over labellings added."""
        if self._formula is None:
            self._formula = Formula(self.space, self.context.blocks)
        new = self._state.conflicts[self._conflicts_in_formula :]
        self._formula.learn(new)
        self._conflicts_in_formula += len(new)
        self._exclude_handed_over()
        return self._formula

    def _bound_all(self, bound: float, proof: Mechanism | tuple[BlockEvidence, ...]) -> None:
        """Store a bound on the scaled λ of all labellings as a conflict without faces.

        proof: a mechanism over faces, or those of block relaxations. An infinite bound is not stored.
        """
        if bound == math.inf:
            return
        nothing = np.empty(0, dtype=np.int64)
        one = Conflict(nothing, nothing.astype(bool), bound)
        if isinstance(proof, Mechanism):
            one = replace(one, mechanism=proof)
        else:
            one = replace(one, evidence=Evidence.BLOCKS, by_blocks=proof)
        self._state.add_conflicts([one])

    def _add_conflicts(self, conflicts: Sequence[Conflict]) -> None:
        """Add conflicts to the state of the proof and to the formula."""
        self._state.add_conflicts(conflicts)
        for one in conflicts:
            self.formula.forbid(one.faces, one.labels, one.bound)

    def _bound_at_root(self) -> float:
        """Bound all labellings by one relaxation with all free faces undecided.

        Returns λ, scene units. The bound is also stored as a conflict; inf if there is none.
        """
        found = self.context.relaxation.least_bound(self.context.labels, self.context.free)
        if found is None:
            return math.inf
        self._bound_all(found.bound, Mechanism(found.case, found.velocity))
        return found.bound * self._scale

    def _check_proof(self, claims: Sequence[Claim], problem: str, evaluated: tuple[Bits, Floats]) -> ProofCheck:
        """Check a finished proof; see `check_proof`.

        problem: problem that the driver itself found; "" for none. evaluated: the strongest labellings, and the λ that
        each is proven to carry, scene units.
        """
        seconds = time.perf_counter() - self._started_at
        scaled = evaluated[0], evaluated[1] / self._scale
        return check_proof(self.context, self._state, claims, scaled, problem, seconds)
