"""Prove the strongest segmentation: refute labellings until none can be better."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits, Floats
from jld_core.deadline import Deadline
from jld_core.errors import ParameterError
from jld_core.limit import load_scale
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Aim, Driver, DriverOptions
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.block_bounds import BlockBoundTightening
from jld_explore.drivers.exact.block_tree import BlockSearch, ByBlocks
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.context import AnnealingSchedule, Heuristics, ProofContext, ScheduledStep, TargetSchedule
from jld_explore.drivers.exact.cube_workers import ConflictSources
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_check import (
    Best,
    Claim,
    Incumbents,
    ProofCheck,
    Targets,
    check_proof,
    claims_of,
    front,
    front_count,
    front_of_all,
)
from jld_explore.drivers.exact.proof_state import BlockEvidence, Conflict, Evidence, Mechanism, ProofState
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Records
from jld_explore.evaluation.protocol import Evaluation, may_meet_requirement, meets_requirement
from jld_explore.space import Count, count_named, values_of
from jld_explore.space.limits import Range
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd


_CORRECTIONS: Final = 3  # number of times that a proof goes on after its check has corrected conflicts


class ExactOptions(DriverOptions):
    # prove the largest load factor, or the largest for every value of the count
    aim: Aim = Field("best", description="best, or front (the best for every count)")


class ProvingDriver(Driver):
    """Driver that draws labellings from a formula, refutes them, and minimises and records their conflicts."""

    name = "exact"
    remembers = True
    checks = True
    Options = ExactOptions

    def __init__(self, space: SearchSpace, seed: int) -> None:
        super().__init__(space, seed)
        self._state = ProofState(space)
        self._proof_check: ProofCheck | None = None
        self._contradictions: list[str] = []
        self._deadline = Deadline()
        self._heartbeat: Callable[[], None] = lambda: None

    @property
    def state(self) -> ProofState:
        """State of the proof: conflicts, and labellings that no conflict refutes."""
        return self._state

    @property
    def conflicts(self) -> int:
        return len(self._state.conflicts)

    @property
    @abstractmethod
    def relaxations(self) -> int:
        """Number of relaxations solved in all threads and processes."""

    @property
    def proof_check(self) -> ProofCheck | None:
        return self._proof_check

    @property
    def finished(self) -> bool:
        """True if everything aimed at is proven and the proof passed its check."""
        return self._proof_check is not None and self._proof_check.passed

    @property
    def complaints(self) -> list[str]:
        """Contradictions found, and a failed check of the proof."""
        check = self._proof_check
        return [*self._contradictions, *([] if check is None or check.passed else [f"not proven: {check.problem}"])]

    @property
    def _given_up(self) -> bool:
        """True if the proof was contradicted again after its restart."""
        return len(self._contradictions) > 1

    def withdraw(self, reason: str) -> None:
        """Forget all conflicts and start again; after a second contradiction give up."""
        self._contradictions.append(reason)
        self._restart()

    @abstractmethod
    def _restart(self) -> None: ...

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """Return the cost of the proof and the result of its check."""
        facts: dict[str, Any] = {"conflicts": self.conflicts, "relaxations": self.relaxations}
        return facts if self._proof_check is None else {**facts, "proof_check": self._proof_check.to_dict()}

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        # The search stops early enough to evaluate the labellings found last.
        self._deadline = Deadline() if deadline is None else deadline.earlier(0.3)
        self._heartbeat = heartbeat

    @property
    def _time_is_up(self) -> bool:
        return self._deadline.passed()

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take over evaluations of labellings (k, m) from a resumed study."""
        self._learn(labellings, evaluations)
        self._state.note_evaluated(labellings)

    @abstractmethod
    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None: ...

    @property
    def _no_labellings(self) -> Bits:
        return np.empty((0, len(self.space.fixed)), dtype=bool)


class ConflictDriver(ProvingDriver):
    """Driver that proves its result by conflicts, or by enumeration where those do not apply."""

    modular = True

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        counted: Count | None,  # that the formula has to express beside limited counts
        *,
        list_blocks: bool = True,  # where they are few enough
        solo_relaxations: int | None = None,  # after which other processes help; None: about a second
        enumerates: bool = False,  # although conflicts apply, because no formula expresses the aim
    ) -> None:
        super().__init__(space, seed)
        self._context = None if enumerates else ProofContext.of(space, seed, counted, list_blocks=list_blocks)
        self._enumeration = Enumeration(space) if self._context is None else None
        self._scale = 1.0 if self._context is None else self._context.relaxation.unit
        self._formula: Formula | None = None
        self._conflicts_in_formula = self._handed_over_in_formula = 0
        self._solo_relaxations, self._jobs = solo_relaxations, 1
        self._sources = self._new_sources()
        self._waiting = self._no_labellings
        self._corrections = 0
        self._nothing_proposed = True
        self._steps = self._search()
        self._started_at = time.perf_counter()

    @property
    def exhaustive(self) -> bool:
        return self._enumeration is not None

    def _new_sources(self) -> ConflictSources | None:
        if self._context is None:
            return None
        return ConflictSources(self._context, self._state, self._solo_relaxations)

    @property
    def context(self) -> ProofContext:
        """Data that stay fixed during the proof; RuntimeError for an enumerated space."""
        if self._context is None:
            raise RuntimeError("an enumerated space has no proof by conflicts")
        return self._context

    @property
    def sources(self) -> ConflictSources:
        """Conflict sources of the proof; RuntimeError for an enumerated space."""
        if self._sources is None:
            raise RuntimeError("an enumerated space has no conflict sources")
        return self._sources

    @property
    def formula(self) -> Formula:
        """Formula of the present target; RuntimeError before the first target."""
        if self._formula is None:
            raise RuntimeError("the proof has no formula before its first target")
        return self._formula

    @property
    def relaxations(self) -> int:
        in_process = 0 if self._context is None else self._context.relaxation.solves
        return in_process + (0 if self._sources is None else self._sources.solves)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        # Where every symmetry class has an evaluation, nothing was inferred about labellings without one.
        facts = super().facts(results, complete)
        enumerated = self._enumeration is not None and complete
        return {"proof_check": ProofCheck("", 0.0).to_dict(), **facts} if enumerated else facts

    def _restart(self) -> None:
        self._begin_again(self._state.clear)
        self._steps = self._search()

    def _begin_again(self, change: Callable[[], None]) -> None:
        """Stop the sources of conflicts, change the state, and begin with new sources and formula."""
        if self._sources is not None:
            self._sources.close()
        change()
        self._formula, self._conflicts_in_formula, self._handed_over_in_formula = None, 0, 0
        self._waiting = self._no_labellings
        self._sources = self._new_sources()
        if self._sources is not None:
            self._sources.set_workers(self._jobs)

    def _take_up(self, check: ProofCheck) -> bool:
        """Correct conflicts that a check found wrong; return True if the proof goes on from what holds."""
        if not check.corrected:
            return False
        reason = check.problem or "a bound is corrected"
        self._begin_again(lambda: self._state.conflicts.correct(check.corrected, reason))
        self._corrections += 1
        return bool(check.holds) and self._corrections <= _CORRECTIONS

    def set_workers(self, jobs: int) -> None:
        self._jobs = jobs
        if self._sources is not None:
            self._sources.set_workers(jobs)

    def close(self) -> None:
        if self._sources is not None:
            self._sources.close()
            self._state.conflicts.save()

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        super().start(deadline, heartbeat, records)
        self._started_at = time.perf_counter()
        if records is not None and self._context is not None:
            self._state.conflicts.keep(records, self._context.key)

    def _time_is_up_after_heartbeat(self) -> bool:
        self._heartbeat()
        return self._time_is_up

    _heuristics: Heuristics

    def ask(self, limit: int | None = None) -> Bits:
        # When nothing is left to prove this method checks the proof, after which one that is corrected goes on.
        if self._enumeration is not None:
            return self._enumeration.ask(limit)
        self.sources.exchange()
        self._heuristics.limit = limit
        # the driver that begins needs no time after its last labelling: the study ends it
        while not len(self._waiting) and self.working and (self._heuristics.starting or not self._time_is_up):
            labellings = self._next_labellings()
            if labellings is None:
                break
            self._waiting = labellings
        if self._nothing_proposed and not len(self._waiting) and not self._state.has_evaluations:
            self._waiting = self._heuristics.driver.ask(1)  # even after the deadline, so that the study has one result
        proposed = self._waiting[:limit]
        self._waiting = self._waiting[len(proposed) :]
        self._nothing_proposed &= not len(proposed)
        if not len(proposed) and not self.working and self._proof_check is None and not self._given_up:
            check = self._checked()
            goes_on = self._take_up(check)
            self._note_check(check, goes_on=goes_on)
            if goes_on:
                self._steps = self._search()
                return self.ask(limit)
            self._proof_check = check
        return proposed

    def _next_labellings(self) -> Bits | None:
        """Continue the search; return labellings (k, m), maybe none, or None at its end."""
        try:
            return next(self._steps, None)
        except BaseException:
            # a generator that raised cannot continue; another one begins with all that is known
            self._steps = self._search()
            raise

    @abstractmethod
    def _search(self) -> Iterator[Bits]:
        """Yield labellings (k, m), maybe none, until nothing is left; evaluations are known by the next item."""

    @abstractmethod
    def _checked(self) -> ProofCheck:
        """Check the proof that has ended."""

    @abstractmethod
    def _note_check(self, check: ProofCheck, *, goes_on: bool) -> None:
        """Take in the result of a check; the search begins anew where the proof goes on."""

    def prepare(self) -> None:
        if self._enumeration is None and not self._heuristics.ended:
            self._heuristics.driver.prepare()

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        if self._enumeration is not None:
            self._enumeration.tell(labellings, evaluations)
            return
        self._heuristics.tell(labellings, evaluations)
        self.restore(labellings, evaluations)

    def _generate(self, sources: ConflictSources, threshold: float) -> bool:
        """Find and save conflicts for a short time; return True if no labelling exceeds λ."""
        exhausted = sources.step(threshold / self._scale)
        self._state.conflicts.save()
        self._heartbeat()
        return exhausted

    def _labellings_to_evaluate(self) -> Bits:
        """Return the labellings (k, m) that wait for evaluation, and exclude them from the formula."""
        self._exclude_handed_over()
        return self._state.take_waiting()

    def _hand_over(self, labels: Bits) -> None:
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
        """Store a bound on the scaled λ of all labellings as a conflict without faces."""
        if bound == math.inf:
            return
        nothing = np.empty(0, dtype=np.int64)
        conflict = Conflict(nothing, nothing.astype(bool), bound)
        if isinstance(proof, Mechanism):
            conflict = replace(conflict, mechanism=proof)
        else:
            conflict = replace(conflict, evidence=Evidence.BLOCKS, by_blocks=proof)
        self._state.add_conflicts([conflict])

    def _add_conflicts(self, conflicts: Sequence[Conflict]) -> None:
        self._state.add_conflicts(conflicts)
        for conflict in conflicts:
            self.formula.forbid(conflict.faces, conflict.labels, conflict.bound)

    def _bound_at_root(self) -> float:
        """Bound λ, scene units, of all labellings by one relaxation of all free faces; inf without one."""
        bound = self.context.relaxation.least_bound(self.context.labels, self.context.free)
        if bound is None:
            return math.inf
        self._bound_all(bound.bound, Mechanism(bound.case, bound.velocity))
        return bound.bound * self._scale

    def _check_proof(self, claims: Sequence[Claim], problem: str, evaluated: tuple[Bits, Floats]) -> ProofCheck:
        seconds = time.perf_counter() - self._started_at
        scaled = evaluated[0], evaluated[1] / self._scale
        return check_proof(self.context, self._state, claims, scaled, problem, seconds)


# Conflicts before the bound is lowered in smaller steps, with and without batch solver. Finding so many conflicts takes
# a few seconds.
_CONFLICTS_PER_STEP: Final = (6000, 500)
_STRONGEST_COMPARED: Final = 300  # number of the strongest labellings compared with all conflicts at the end of a proof


class Exact(ConflictDriver):
    """Driver that proves the largest λ of a search space, or the front of a count."""

    def __init__(
        self,
        space: SearchSpace,
        seed: int = 0,
        aim: Aim = "best",
        *,
        search: int = 30,  # labellings evaluated before the proof, per face that can change
        by_blocks: ByBlocks = "auto",
        list_blocks: bool = True,
        step_after: int | None = None,  # conflicts after which the bound is lowered in smaller steps
        programs: int | None = None,  # after which the driver stops as if its time were over
        solo_relaxations: int | None = None,
    ) -> None:
        if space.void is not None:
            raise ParameterError("driver", "exact proves nothing where cells may be left out", "enumeration or genetic")
        self.aim, self._most_programs = aim, programs
        self._count = front_count(space) if aim == "front" else None
        super().__init__(
            space,
            seed,
            self._count,
            list_blocks=list_blocks,
            solo_relaxations=solo_relaxations,
            enumerates=aim == "front" and self._count is None,
        )
        self._load_scale = load_scale(space.assembly)
        context = self._context
        self._block_search = BlockSearch(context, by_blocks) if context else None
        self._tightening = BlockBoundTightening(context, wanted=by_blocks != "off") if context else None
        heuristic = Genetic(space, seed, aim=aim) if aim == "front" else Anneal(space, seed)
        self._heuristics = Heuristics(heuristic, search * int(space.candidates.sum()))
        self._incumbents = Incumbents(space, self._count)
        batched = context is not None and context.relaxation.batched
        self._conflicts_per_step = step_after or _CONFLICTS_PER_STEP[not batched]
        self._annealing_schedule = AnnealingSchedule(batched=batched, disabled=search == 0)
        self._targets = Targets(space, self._count, self._incumbents, self._load_scale)

    @property
    def found(self) -> dict[int | None, Best]:
        """Best λ and bound for each count; key None for all labellings."""
        return self._targets.found

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self.aim}

    @property
    def relaxations(self) -> int:
        by_blocks = sum(part.solves for part in (self._block_search, self._tightening) if part is not None)
        return super().relaxations + by_blocks

    @property
    def bound(self) -> float | None:
        # None after the proof was given up, or failed its check without a larger bound that holds
        check = self._proof_check
        if self._given_up or (check is not None and not check.passed and not check.holds):
            return None
        best = self.found[None]
        return best.bound if math.isfinite(best.bound) else None

    @property
    def working(self) -> bool:
        if self._enumeration is not None:
            return self._enumeration.working
        return bool(self._targets_left) and not self._given_up

    @property
    def _targets_left(self) -> list[int | None]:
        """Targets that are not settled; none after the proof was given up."""
        return [] if self._given_up else self._targets.left

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        facts = super().facts(results, complete)
        axes = self.space.search.front
        if self.aim == "front" and not axes.counts:
            enumerated = self._enumeration is not None
            rows = front_of_all(results, axes.count, complete) if enumerated else front(self.found.values())
            if self.proof_check is not None and not self.proof_check.passed and not self.proof_check.holds:
                rows = [{**row, "bound": None, "proven": False} for row in rows]
            facts["front"] = rows
        return facts

    def _restart(self) -> None:
        """Forget all conflicts and bounds and start the proof again."""
        super()._restart()
        self._targets.restart()
        if self._block_search is not None:
            self._block_search.abandon()

    def set_workers(self, jobs: int) -> None:
        super().set_workers(jobs)
        if self._block_search is not None:
            self._block_search.set_workers(jobs)

    def close(self) -> None:
        self._keep_open_nodes()
        if self._block_search is not None:
            self._block_search.close()
        super().close()

    def begin_with(self, starter: Genetic, labellings: int) -> None:
        """Evaluate labellings of another driver before the proof, in place of the first annealing."""
        if self._enumeration is None:
            self._heuristics.begin_with(starter, labellings)

    def _checked(self) -> ProofCheck:
        claims, problem = claims_of(self.found.values(), self._incumbents, self._scale, self._load_scale)
        return self._check_proof(claims, problem, self._incumbents.strongest(_STRONGEST_COMPARED))

    def _note_check(self, check: ProofCheck, *, goes_on: bool) -> None:
        """Raise bounds that do not hold; their targets are left where the proof goes on."""
        self._targets.raise_to(check.holds, self._scale)
        if not goes_on:
            self._targets.left.clear()

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        self._incumbents.learn(labellings, evaluations)
        self._targets.learn()

    @property
    def _time_is_up(self) -> bool:
        return super()._time_is_up or (self._most_programs is not None and self.relaxations >= self._most_programs)

    def _search(self) -> Iterator[Bits]:
        """Yield labellings (k, m) to evaluate, maybe none, until every target is settled."""
        yield from self._heuristics.start()
        yield from self._heuristics.run()
        while self._targets_left:
            target = self._targets_left[0]
            yield from self._refute(target)
            self._settle(target)
            yield self._no_labellings

    def _refute(self, target: int | None) -> Iterator[Bits]:
        """Yield labellings (k, m) to evaluate until none left may exceed a target's best λ."""
        blocks, schedule = self.block_search, TargetSchedule(self._conflicts_per_step)
        if target is None:
            self._bound_first_target(blocks)
        step = self._begin_step(target, schedule)
        while not self.found[target].proven:
            proposed = self._no_labellings
            while not (len(proposed) or self._heuristics.due or self._time_is_up):
                threshold = max(step.threshold, self.least(target))
                if blocks.active:
                    proposed = self._step_block_tree(blocks, threshold)
                    step = replace(step, conflicts=self.conflicts)
                    self._heartbeat()
                    self._heuristics.due = blocks.labellings_due()
                    continue
                if target is None and self._tighten(self._tightening):
                    if self.found[None].proven:
                        return
                    step = self._begin_step(None, schedule)
                    continue
                exhausted = self._generate(self.sources, threshold)
                proposed = self._labellings_to_evaluate()
                new_conflicts = self.conflicts - step.conflicts
                if exhausted and not len(proposed):
                    self._lower_bound(target, threshold)
                    schedule.note_proven(new_conflicts)
                    if threshold <= self.least(target):
                        return
                    step = self._begin_step(target, schedule)
                    continue
                if schedule.is_stuck(new_conflicts, self.found[target].bound, threshold):
                    step = self._begin_step(target, schedule)
                self._heuristics.due = self._annealing_schedule.labellings_due(self.relaxations)
            yield proposed
            yield from self._heuristics.run()
        self._keep_open_nodes()

    def _bound_first_target(self, blocks: BlockSearch) -> None:
        """Lower the bound on all labellings by the root relaxation, then by that of all blocks."""
        self._lower_bound(None, self._bound_at_root())
        root = blocks.start(self.least(None) / self._scale, self.found[None].bound / self._scale)
        self._bound_all(root, blocks.root_proof)
        self._lower_bound(None, root * self._scale)

    def _tighten(self, tightening: BlockBoundTightening | None) -> bool:
        """Lower the bound on all labellings by block relaxations if due; return True if they were."""
        low, high = self.least(None) / self._scale, self.found[None].bound / self._scale
        if tightening is None or not math.isfinite(high) or not tightening.is_due(self.relaxations, low):
            return False
        search, seconds_left = self.block_search, self._deadline.remaining()
        root = search.start_late(low, high)
        if root < high:
            self._bound_all(root, search.root_proof)
            self._lower_bound(None, root * self._scale)
        if search.active:
            tightening.disable()
            return True
        tightened = tightening.tighten(low, high, seconds_left, self._time_is_up_after_heartbeat)
        self._state.add_conflicts(tightened.conflicts)
        self._bound_all(tightened.bound, tightened.proof)
        self._lower_bound(None, tightened.bound * self._scale)
        return True

    @property
    def block_search(self) -> BlockSearch:
        """Branch and bound over blocks; RuntimeError for an enumerated space."""
        if self._block_search is None:
            raise RuntimeError("an enumerated space has no search over blocks")
        return self._block_search

    def _keep_open_nodes(self) -> None:
        """State the bound of every open node of the block tree as a conflict."""
        if self._block_search is not None and self._block_search.active:
            self._state.add_conflicts(self._block_search.open_conflicts)

    def _step_block_tree(self, search: BlockSearch, threshold: float) -> Bits:
        """Take one step of the block tree; return the labellings (k, m) to evaluate."""
        formula = self.formula
        formula.raise_threshold(threshold / self._scale)
        step = search.step(formula, threshold / self._scale, self._time_is_up_after_heartbeat)
        self._add_conflicts(step.conflicts)
        self._state.conflicts.save()
        if step.complete is not None and formula.next(np.arange(len(step.complete)), step.complete) is None:
            return self._no_labellings  # the tree ignores limits on counts and assembly sequences
        if step.complete is not None:
            refuting = conflict_of(self.context.relaxation, step.complete, self.context.free, threshold / self._scale)
            if refuting is None:
                self._hand_over(step.complete)
                return self._labellings_to_evaluate()
            self._add_conflicts([refuting])
            self._keep_open_nodes()
            search.note_inaccurate_bound()
            return self._no_labellings
        self._lower_bound(None, max(threshold, search.bound * self._scale))
        if step.promising is not None:
            self._hand_over(step.promising)
        return self._labellings_to_evaluate()

    def least(self, target: int | None) -> float:
        """Return the λ that a labelling must exceed to count as better."""
        return self._targets.least(target)

    def _begin_step(self, target: int | None, schedule: TargetSchedule) -> ScheduledStep:
        """Aim formula and sources at the next λ of a target, and return that step."""
        low = self.least(target)
        threshold = low if self.block_search.active else schedule.next_target(self.found[target].bound, low)
        formula = self._updated_formula()
        formula.aim(threshold / self._scale, target)
        self.sources.begin(formula, target, threshold / self._scale)
        return ScheduledStep(threshold, self.conflicts)

    def _lower_bound(self, target: int | None, bound: float) -> None:
        """Lower the bound of a target, but not below that of labellings handed over."""
        self._targets.lower_bound(target, bound, self._state.handed_over)

    def _settle(self, target: int | None) -> None:
        self._targets.settle(target)
        if self._block_search is not None:
            self._block_search.abandon()
        self.sources.end()


class MinimumCount(ConflictDriver):
    """Driver that proves the best count where `search.require` asks for a load factor."""

    def __init__(
        self,
        space: SearchSpace,
        seed: int = 0,
        aim: Aim = "best",
        *,
        search: int = 5,
        solo_relaxations: int | None = None,
    ) -> None:
        if space.search.require is None or aim != "best":
            raise ParameterError("aim", "a front is not what search.require asks for", "best")
        name, sense = space.search.front.axes[0]
        self._count, self._minimize = count_named(name), sense == "min"
        super().__init__(space, seed, self._count, solo_relaxations=solo_relaxations)
        self._threshold = space.search.require.threshold
        self._heuristics = Heuristics(Genetic(space, seed), search * int(space.candidates.sum()))
        self._evaluated: dict[bytes, tuple[bool, bool, float]] = {}
        self._target_begun = self._done = False

    @property
    def working(self) -> bool:
        if self._enumeration is not None:
            return self._enumeration.working
        return not self._done and not self._given_up

    @property
    def best(self) -> float | None:
        """Best count of a labelling that meets the requirement; None if none is known."""
        counts = [count for met, _, count in self._evaluated.values() if met]
        return (min(counts) if self._minimize else max(counts)) if counts else None

    @property
    def _open_labelling_left(self) -> bool:
        """True if a labelling of better count may meet the requirement but is not proven to."""
        best = self.best
        return any(
            may and not met and (best is None or (count < best if self._minimize else count > best))
            for met, may, count in self._evaluated.values()
        )

    def _search(self) -> Iterator[Bits]:
        """Yield labellings (k, m) of the genetic driver, then those that no conflict refutes at the required λ."""
        yield from self._heuristics.run()
        self._heuristics.ended = True
        while not self._done:
            if not self._target_begun:
                self._begin_step(self.sources)
            exhausted = self._generate(self.sources, self._threshold)
            labellings = self._labellings_to_evaluate()
            self._done = exhausted and not len(labellings)
            yield labellings

    def _checked(self) -> ProofCheck:
        """Check the claim that no labelling of better count carries the required λ."""
        problem = "a layout that counts better may carry enough" if self._open_labelling_left else ""
        # the evaluations prove that each labelling carries the required λ, but not how much more
        claims = [Claim(self._better, self._threshold / self._scale)]
        return self._check_proof(claims, problem, self._carrying_labellings)

    def _note_check(self, check: ProofCheck, *, goes_on: bool) -> None:
        if goes_on:
            self._target_begun = self._done = False

    def _restart(self) -> None:
        super()._restart()
        self._target_begun = self._done = False

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take over evaluations, and aim at better counts once a labelling meets the requirement."""
        before = self.best
        super().restore(labellings, evaluations)
        if self.best != before and self._target_begun:
            self.sources.end()
            self._target_begun = False

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Record for each labelling whether it meets, or may meet, the requirement, and its count."""
        count = values_of(self._count, self.space.assembly, labellings, self.space.graph)
        for labels, result, value in zip(labellings, evaluations, count.tolist(), strict=True):
            state = (meets_requirement(self.space, result), may_meet_requirement(self.space, result), float(value))
            self._evaluated[np.packbits(labels).tobytes()] = state

    @property
    def _carrying_labellings(self) -> tuple[Bits, Floats]:
        """Labellings (k, m) that meet the requirement, and λ (k,) that each is proven to carry."""
        packed = [np.frombuffer(key, dtype=np.uint8) for key, (met, _, _) in self._evaluated.items() if met]
        faces = len(self.space.fixed)
        table = np.array(packed, dtype=np.uint8).reshape(len(packed), (faces + 7) // 8)
        rows = np.unpackbits(table, axis=1, count=faces)
        return rows.astype(bool), np.full(len(rows), self._threshold)

    def _begin_step(self, sources: ConflictSources) -> None:
        """Aim the formula at all counts better than the best known."""
        better = self._better
        self._target_begun = True
        formula = self._updated_formula()
        formula.aim(self._threshold / self._scale, better)
        sources.begin(formula, better, self._threshold / self._scale)

    @property
    def _better(self) -> Range | None:
        """Range of counts better than the best known; None for any count."""
        best = self.best
        if best is None or not math.isfinite(best):
            return None
        return Range.of((None, best - 1) if self._minimize else (best + 1, None), whole=True)
