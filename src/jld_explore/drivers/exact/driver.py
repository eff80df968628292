"""Prove the strongest segmentation: refute labellings until none can be better.

The driver asks a formula for labellings that no clause rules out. A mechanism that proves one labelling too weak also
refutes every labelling that agrees where the mechanism needs it. This conflict is added to the formula
(`exact.conflict_generation`). A labelling that no mechanism refutes is evaluated: it is better, or its own bracket
proves that it is not. A formula without a model proves that no labelling exceeds its λ. The next formula is made for
a lower λ (`exact.schedules`), down to the best λ known. Annealing searches for better labellings before the
proof and at intervals during it.

For small blocks the block relaxation bounds λ much closer than the relaxation face by face. Conflicts then first come
from a branch and bound over blocks (`exact.block_search`). The formula afterwards decides whether a labelling is
left. Where the block relaxation is cheap it bounds all labellings before the first step. Any other long proof solves
it later for a bound and for refuted blocks (`exact.block_bounds`).

The proof relies on limit analyses with their brackets, on mechanisms whose work balance is computed here
(`relaxation`, `block_relaxation`), and on a satisfiability solver. No tolerance of an optimiser enters the proof.

Spaces without a formula or a relaxation are enumerated, which proves the same. They have limits on a count that is no
sum of ones, or limits on the number of blocks where the blocks are too many to list.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.errors import ParameterError
from jld_core.limit import load_scale
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Aim
from jld_explore.drivers.exact.block_bounds import BlockBoundTightening
from jld_explore.drivers.exact.block_search import BlockSearch, ByBlocks
from jld_explore.drivers.exact.conflict_driver import ConflictDriver
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.proof_state import Evidence
from jld_explore.drivers.exact.schedules import AnnealingSchedule, TargetSchedule
from jld_explore.drivers.exact.targets import Best, Incumbents, Targets, claims_of, front, front_count, front_of_all
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation
from jld_explore.space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd

_CONFLICTS_PER_STEP: Final = (6000, 500)
"""Conflicts before the bound is lowered in smaller steps, with and without batch solver.

Finding so many conflicts takes a few seconds.
"""

_STRONGEST_COMPARED: Final = 300
"""Number of the strongest labellings compared with all conflicts at the end of a proof."""


class Exact(ConflictDriver):
    """Driver that proves the largest λ of a search space, or the front of a count.

    The proof rests on conflicts: labels that no labelling above some λ has together.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    seed : int
        Seed of the random choices.
    aim : {"best", "front"}
        Prove the largest λ, or the largest λ for every value of the count of the scene.
    search : int
        Labellings evaluated before the proof, per face that can change.
    by_blocks : {"auto", "on", "off"}
        Whether to search a tree of block choices first; "auto": where it promises more than conflicts of faces.
    list_blocks : bool
        Whether to list the possible blocks where they are few enough.
    step_after : int, optional
        Conflicts after which the bound is lowered in smaller steps. A proof too long to finish then leaves a narrower
        gap. Default: as many as take a few seconds.
    programs : int, optional
        Number of programs after which the driver stops as if the deadline had passed. Default: no limit.
    solo_relaxations : int, optional
        Relaxations after which other processes help where they are allowed; 0: from the start. Default: as many as
        take about a second.

    Attributes
    ----------
    aim : str
        As the parameter.
    found : dict
        Best labelling and bound (`Best`) for each count; key None for all labellings.

    Raises
    ------
    InputError
        If cells may be left out of the structure, or the count of the front has no exact front.
    """

    def __init__(
        self,
        space: SearchSpace,
        seed: int = 0,
        aim: Aim = "best",
        *,
        search: int = 30,
        by_blocks: ByBlocks = "auto",
        list_blocks: bool = True,
        step_after: int | None = None,
        programs: int | None = None,
        solo_relaxations: int | None = None,
    ) -> None:
        if space.void is not None:
            raise ParameterError("driver", "exact proves nothing where cells may be left out", "enumeration or genetic")
        self.aim, self._most_programs = aim, programs
        self._count = front_count(space) if aim == "front" else None
        super().__init__(space, seed, self._count, list_blocks=list_blocks, solo_relaxations=solo_relaxations)
        self._load_scale = load_scale(space.assembly)
        self._block_search: BlockSearch | None = None
        self._tightening: BlockBoundTightening | None = None
        if self._context is not None:
            self._block_search = BlockSearch(self._context, by_blocks)
            self._tightening = BlockBoundTightening(self._context, wanted=by_blocks != "off")
        self._heuristic = Genetic(space, seed, aim=aim) if aim == "front" else Anneal(space, seed)
        self._labellings_to_anneal = search * int(space.candidates.sum())
        self._incumbents = Incumbents(space, self._count)
        batched = self._context is not None and self._context.relaxation.many
        self._conflicts_per_step = step_after or _CONFLICTS_PER_STEP[not batched]
        self._target_schedule = TargetSchedule(self._conflicts_per_step)
        self._annealing_schedule = AnnealingSchedule(batched=batched, disabled=search == 0)
        self._nothing_proposed = self._use_block_bounds = True
        self._threshold = math.inf
        self._conflicts_at_begin = 0
        self._target_begun = False
        self._targets = Targets(space, self._count, self._incumbents, self._load_scale)

    @property
    def found(self) -> dict[int | None, Best]:
        """Best labelling and bound for each count; key None for all labellings."""
        return self._targets.found

    @property
    def settings(self) -> dict[str, Any]:
        """Options that the sequence of proposals depends on; see `Driver.settings`."""
        return {"aim": self.aim}

    @property
    def relaxations(self) -> int:
        """Number of relaxations solved, including those by blocks."""
        by_blocks = sum(part.solves for part in (self._block_search, self._tightening) if part is not None)
        return super().relaxations + by_blocks

    @property
    def bound(self) -> float | None:
        """Proven upper bound on λ over the whole space, scene units; None if there is none.

        The bound is also None after the proof was given up or failed its check.
        """
        if self._given_up or (self._proof_check is not None and not self._proof_check.passed):
            return None
        best = self.found[None]
        return best.bound if math.isfinite(best.bound) else None

    @property
    def finished(self) -> bool:
        """Whether everything aimed at is proven and the proof passed its check."""
        return self._proof_check is not None and self._proof_check.passed

    @property
    def working(self) -> bool:
        """Whether targets are left and the proof is not given up; see `Driver.working`."""
        if self._enumeration is not None:
            return self._enumeration.working
        return bool(self._targets_left) and not self._given_up

    @property
    def _targets_left(self) -> list[int | None]:
        """Targets that are not settled; none after the proof was given up."""
        return [] if self._given_up else self._targets.left

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """Return the cost of the proof, and the front if it is the aim; see `Driver.facts`."""
        found = super().facts(results, complete)
        if self._count is not None:
            enumerated = self._enumeration is not None
            rows = front_of_all(results, self._count.name, complete) if enumerated else front(self.found.values())
            if self.proof_check is not None and not self.proof_check.passed:
                rows = [{**row, "bound": None, "proven": False} for row in rows]
            found["front"] = rows
        return found

    def withdraw(self, reason: str) -> None:
        """Forget all conflicts and bounds and start the proof again; see `Driver.withdraw`."""
        super().withdraw(reason)
        self._forget_bounds()

    def _forget_bounds(self) -> None:
        """Restart the proof at its first target, keeping the evaluations."""
        self._targets.restart()
        self._target_schedule = TargetSchedule(self._conflicts_per_step)
        self._target_begun = False
        if self._block_search is not None:
            self._block_search.abandon()

    def set_workers(self, jobs: int) -> None:
        """Set the number of workers that refute parts of the space; see `Driver.set_workers`."""
        super().set_workers(jobs)
        if self._block_search is not None:
            self._block_search.set_workers(jobs)

    def close(self) -> None:
        """Stop all workers and save the conflicts; see `Driver.close`."""
        if self._block_search is not None:
            self._block_search.close()
        super().close()

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        """Return the next labellings (k, m) to evaluate; see `Driver.ask`.

        When nothing is left to prove this method checks the proof.
        """
        if self._enumeration is not None:
            return self._enumeration.ask(limit)
        if self._sources is not None:
            self._sources.exchange()
        while not len(self._waiting) and self._targets_left and not self._time_is_up:
            if self._labellings_to_anneal > 0:
                self._waiting = self._heuristic.ask(
                    self._labellings_to_anneal if limit is None else min(limit, self._labellings_to_anneal)
                )
                self._labellings_to_anneal = (
                    self._labellings_to_anneal - len(self._waiting) if len(self._waiting) else 0
                )
            else:
                self._waiting = self._work_on(self._targets_left[0])
        if self._nothing_proposed and not len(self._waiting) and not self._incumbents:
            self._waiting = self._heuristic.ask(1)  # even after the deadline, so that the study has one result
        given = self._take_waiting(limit)
        self._nothing_proposed &= not len(given)
        if not len(given) and not self._targets_left and self._proof_check is None and not self._given_up:
            claims, problem = claims_of(self.found.values(), self._incumbents, self._scale, self._load_scale)
            self._proof_check = self._check_proof(claims, problem, self._incumbents.strongest(_STRONGEST_COMPARED))
        return given

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m); see `Driver.tell`."""
        if self._enumeration is not None:
            self._enumeration.tell(labellings, evaluations)
            return
        self._heuristic.tell(labellings, evaluations)
        self._state.note_evaluated(labellings)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations and raise the best λ of each target."""
        self._incumbents.learn(labellings, evaluations)
        self._targets.learn()

    @property
    def _time_is_up(self) -> bool:
        """Whether the deadline has passed or `programs` programs are solved."""
        return super()._time_is_up or (self._most_programs is not None and self.relaxations >= self._most_programs)

    # --- one target -------------------------------------------------------------------------------------

    def _work_on(self, target: int | None) -> Bits:
        """Work on a target; return labellings (k, m) to evaluate.

        No labelling is returned if the target is settled or time is up.
        """
        blocks, sources = self.block_search, self.sources
        if not self._target_begun:
            if target is None:
                self._lower_bound(target, self._bound_at_root())
                root = blocks.start(self.least(None) / self._scale, self.found[None].bound / self._scale)
                if self._use_block_bounds:
                    self._bound_all(root, Evidence.BLOCKS)
                    self._lower_bound(target, root * self._scale)
            self._begin_step(target)
        if self.found[target].proven:
            self._keep_open_nodes()
            self._settle(target)
            return self._no_labellings
        while not self._time_is_up:
            threshold = max(self._threshold, self.least(target))
            if blocks.active:
                proposed = self._step_block_tree(blocks, threshold)
                self._conflicts_at_begin = self.conflicts
                self._heartbeat()
                self._labellings_to_anneal = blocks.labellings_due()
                if len(proposed) or self._labellings_to_anneal:
                    return proposed
                continue
            if target is None and self._tighten(self._tightening):
                if self.found[None].proven:
                    self._settle(None)
                    return self._no_labellings
                self._begin_step(None)
                continue
            exhausted = self._generate(sources, threshold)
            proposed = self._labellings_to_evaluate()
            if exhausted and not len(proposed):
                self._lower_bound(target, threshold)
                self._target_schedule.note_proven(self.conflicts - self._conflicts_at_begin)
                if threshold <= self.least(target):
                    self._settle(target)
                    return self._no_labellings
                self._begin_step(target)
                continue
            if self._target_schedule.is_stuck(
                self.conflicts - self._conflicts_at_begin, self.found[target].bound, threshold
            ):
                self._begin_step(target)
            self._labellings_to_anneal = self._annealing_schedule.labellings_due(self.relaxations)
            if len(proposed) or self._labellings_to_anneal:
                return proposed
        return self._no_labellings

    def _tighten(self, tightening: BlockBoundTightening | None) -> bool:
        """Bound all labellings by the block relaxation if that is due; return whether it was."""
        low, high = self.least(None) / self._scale, self.found[None].bound / self._scale
        if tightening is None or not math.isfinite(high) or not tightening.is_due(self.relaxations, low):
            return False
        left = self._deadline.remaining()
        found = tightening.tighten(low, high, left, self._time_is_up_after_heartbeat)
        self._state.add_conflicts(found.conflicts)
        self._bound_all(found.bound, Evidence.BLOCKS)
        self._lower_bound(None, found.bound * self._scale)
        return True

    @property
    def block_search(self) -> BlockSearch:
        """Branch and bound over blocks; raises RuntimeError for an enumerated space."""
        if self._block_search is None:
            raise RuntimeError("an enumerated space has no search over blocks")
        return self._block_search

    def _keep_open_nodes(self) -> None:
        """State the bound of every open node of the block tree as a conflict."""
        if self._block_search is not None and self._block_search.active:
            self._state.add_conflicts(self._block_search.open_conflicts)

    def disable_block_bounds(self) -> None:
        """Do without bounds from the block relaxation, which a certificate cannot express.

        Call this method before the search.
        """
        self._use_block_bounds = False
        if self._tightening is not None:
            self._tightening.disable()

    def _step_block_tree(self, search: BlockSearch, threshold: float) -> Bits:
        """Take one step of the block tree; return the labellings (k, m) to evaluate."""
        formula = self.formula
        formula.raise_threshold(threshold / self._scale)
        step = search.step(formula, threshold / self._scale, self._time_is_up_after_heartbeat)
        for conflict in step.conflicts:
            self._add_conflict(conflict)
        self._state.conflicts.save()
        if step.complete is not None and formula.next(np.arange(len(step.complete)), step.complete) is None:
            return self._no_labellings  # the tree ignores limits on counts and assembly sequences
        if step.complete is not None:
            refuting = conflict_of(self.context.relaxation, step.complete, self.context.free, threshold / self._scale)
            if refuting is None:
                self._hand_over(step.complete)
                return self._labellings_to_evaluate()
            self._add_conflict(refuting)
            self._keep_open_nodes()
            search.note_inaccurate_bound()
            return self._no_labellings
        self._lower_bound(None, max(threshold, search.bound * self._scale))
        if step.promising is not None:
            self._hand_over(step.promising)
        return self._labellings_to_evaluate()

    def least(self, target: int | None) -> float:
        """Return the λ that a labelling must exceed to count as better, see `Targets.least`."""
        return self._targets.least(target)

    def _begin_step(self, target: int | None) -> None:
        """Aim the formula at the next λ of a target."""
        low = self.least(target)
        self._threshold = (
            low if self.block_search.active else self._target_schedule.next_target(self.found[target].bound, low)
        )
        self._conflicts_at_begin = self.conflicts
        self._target_begun = True
        formula = self._updated_formula()
        formula.aim(self._threshold / self._scale, target)
        self.sources.begin(formula, target, self._threshold / self._scale)

    def _lower_bound(self, target: int | None, bound: float) -> None:
        """Lower the bound of a target, see `Targets.lower_bound`."""
        self._targets.lower_bound(target, bound, self._state.handed_over)

    def _settle(self, target: int | None) -> None:
        """Close a target, its formula and its block tree, see `Targets.settle`."""
        self._targets.settle(target)
        self._target_schedule = TargetSchedule(self._conflicts_per_step)
        if self._block_search is not None:
            self._block_search.abandon()
        if self._target_begun:
            self.sources.end()
            self._target_begun = False
