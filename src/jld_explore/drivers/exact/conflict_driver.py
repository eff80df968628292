"""What the exact drivers prove with: relaxations, possible blocks, a formula of what is left, conflicts, hunters."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats
from jld_core.deadline import Deadline
from jld_core.limit import LimitAnalysis, relaxation_of
from jld_explore.drivers.base import Aim, Driver, DriverOptions
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.conflict_sources import ConflictSources
from jld_explore.drivers.exact.conflicts import key_of
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.drivers.exact.proof_check import Claim, ProofCheck, check_proof
from jld_explore.drivers.exact.proof_state import ProofState
from jld_explore.evaluation import Evaluation, Records
from jld_explore.space import Count, SearchSpace

if TYPE_CHECKING:
    import pandas as pd


class ExactOptions(DriverOptions):
    """Options of the exact driver."""

    aim: Aim = Field("best", description="best, or front (the best for every count)")


class ConflictDriver(Driver):
    """A driver that proves; or enumerates, which proves the same, where its space has no formula or no relaxation.

    counted: a count the formula must hold, besides those that are limited. list_blocks: list the blocks there can be,
    where they are few enough. alone: see `ConflictSources`.
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
        alone: int | None = None,
    ) -> None:
        super().__init__(space, seed)
        self._analyses = [LimitAnalysis(case) for case in space.assembly.by_case]
        self._blocks = possible_blocks(space) if list_blocks else None
        asked = [count for count, _ in space.limits.on_counts] + ([] if counted is None else [counted])
        terms = [count.terms(space.assembly) if count.terms else None for count in asked]
        listed = all(one is not None and not (one.blocks and self._blocks is None) for one in terms)
        self._relaxation = relaxation_of(space.assembly, self._analyses) if listed else None
        self._everything = Enumeration(space) if self._relaxation is None else None
        self._scale = 1.0 if self._relaxation is None else self._relaxation.unit
        self._free = space.candidates.copy()
        if self._blocks is not None:
            joined = {face for inside in self._blocks.inside for face in inside}
            self._free &= np.isin(np.arange(len(self._free)), list(joined))
        self._state = ProofState(space)
        self._formula: Formula | None = None
        self._said = 0, 0
        self._alone, self._jobs = alone, 1
        self._sources = self._make_hunters()
        self._waiting = self._none
        self._proof_check: ProofCheck | None = None
        self._contradictions: list[str] = []
        self._deadline = Deadline()
        self._heartbeat: Callable[[], None] = lambda: None
        self._began_at = time.perf_counter()

    @property
    def exhaustive(self) -> bool:
        """See `Driver.exhaustive`."""
        return self._everything is not None

    def _make_hunters(self) -> ConflictSources | None:
        if self._relaxation is None:
            return None
        return ConflictSources(
            self._relaxation, self.space, self._blocks, self._free, self.seed, self._state, self._alone
        )

    @property
    def state(self) -> ProofState:
        """The state of the proof: conflicts, and layouts that no conflict refutes."""
        return self._state

    @property
    def conflicts(self) -> int:
        """Number of conflicts found so far."""
        return len(self._state.conflicts)

    @property
    def proof_check(self) -> ProofCheck | None:
        """Result of checking the finished proof, None while it is not finished."""
        return self._proof_check

    @property
    def relaxations(self) -> int:
        """Programs solved for them, by whomever."""
        return sum(part.solves for part in (self._relaxation, self._sources) if part is not None)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """See `Driver.facts`: what the proof took, and whether it passed its check."""
        found: dict[str, Any] = {"conflicts": self.conflicts, "relaxations": self.relaxations}
        if self._proof_check is not None:
            found["proof_check"] = self._proof_check.to_dict()
        elif self._everything is not None and complete:
            # every class has an evaluation: nothing was concluded about any other
            found["proof_check"] = ProofCheck("", 0.0).to_dict()
        return found

    @property
    def complaints(self) -> list[str]:
        """See `Driver.complaints`: contradictions met, and a failed check of the proof."""
        failed = self._proof_check is not None and not self._proof_check.passed
        return [*self._contradictions, *([f"not proven: {self._proof_check.problem}"] if failed else [])]  # type: ignore[union-attr]

    def withdraw(self, reason: str) -> None:
        """See `Driver.withdraw`: forget all conflicts, and begin the proof again; a second time, give it up."""
        self._contradictions.append(reason)
        if self._sources is not None:
            self._sources.close()
        self._state.clear()
        self._formula, self._said = None, (0, 0)
        self._waiting = self._none
        self._sources = self._make_hunters()
        if self._sources is not None:
            self._sources.set_workers(self._jobs)

    @property
    def _given_up(self) -> bool:
        """Whether the proof contradicted itself again after it was begun anew."""
        return len(self._contradictions) > 1

    def set_workers(self, jobs: int) -> None:
        """See `Driver.set_workers`: they refute parts of the space."""
        self._jobs = jobs
        if self._sources is not None:
            self._sources.set_workers(jobs)

    def close(self) -> None:
        """See `Driver.close`."""
        if self._sources is not None:
            self._sources.close()
            self._state.conflicts.save()

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """See `Driver.start`."""
        # what was found last must still be evaluated
        self._deadline = Deadline() if deadline is None else deadline.earlier(0.3)
        self._heartbeat = heartbeat
        self._began_at = time.perf_counter()
        if records is not None and self._everything is None:
            templates = [analysis.template for analysis in self._analyses]
            self._state.conflicts.keep(records, key_of(templates, self.space, self._blocks))

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in what a study that is gone on with knows: labellings (k, m)."""
        self._learn(labellings, evaluations)
        self._state.note_evaluated(labellings)

    @abstractmethod
    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None: ...

    @property
    def _none(self) -> Bits:
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    @property
    def _late(self) -> bool:
        return self._deadline.passed()

    def _given(self, limit: int | None) -> Bits:
        """The next of the labellings that wait to be evaluated."""
        given = self._waiting[:limit]
        self._waiting = self._waiting[len(given) :]
        return given

    def _generate(self, hunters: ConflictSources, threshold: float) -> bool:
        """Find conflicts for a moment and put them on record; return whether no labelling is left.

        threshold: λ, scene units.
        """
        exhausted = hunters.step(threshold / self._scale)
        self._state.conflicts.save()
        self._heartbeat()
        return exhausted

    def _to_evaluate(self) -> Bits:
        """Layouts (k, m) that were handed over and wait for their evaluation."""
        self._learn_handed_over()
        return self._state.take_waiting()

    def _offer(self, labels: Bits) -> None:
        """Hand over a layout (m,) that no mechanism ruled out."""
        self._state.hand_over([labels])

    def _learn_handed_over(self) -> None:
        if self._formula is not None:
            passed = self._state.handed_over_since(self._said[1])
            self._formula.learn((), passed)
            self._said = self._said[0], self._said[1] + len(passed)

    def _told(self) -> Formula:
        """The formula, which knows all conflicts there are, and what was handed over."""
        if self._formula is None:
            self._formula = Formula(self.space, self._blocks)
        new = self._state.conflicts[self._said[0] :]
        self._formula.learn(new)
        self._said = self._said[0] + len(new), self._said[1]
        self._learn_handed_over()
        return self._formula

    def _check(self, claims: Sequence[Claim], problem: str, evaluated: tuple[Bits, Floats]) -> ProofCheck:
        """Check a finished proof: see `check_proof`.

        evaluated: the strongest layouts, and λ that each is proven to carry, scene units. problem: what the driver
        itself found wrong, "" for nothing.
        """
        if self._relaxation is None:
            raise ValueError("a space without a relaxation has no proof to check")
        seconds = time.perf_counter() - self._began_at
        scaled = evaluated[0], evaluated[1] / self._scale
        proof = self._relaxation, self.space, self._blocks, self._free, self._state
        return check_proof(*proof, claims, scaled, problem, seconds)
