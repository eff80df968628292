"""Prove the strongest segmentation: refute labellings until none can be better.

The driver asks a formula for labellings that no clause rules out. A mechanism that proves one labelling too weak also
refutes every labelling that agrees where the mechanism needs it. This conflict is added to the formula
(`exact.conflict_generation`). A labelling that no mechanism refutes is evaluated: it is better, or its own bracket
proves that it is not. A formula without a model proves that no labelling exceeds its λ. The next formula is made for
a lower λ (`exact.target_schedule`), down to the best λ known. Annealing searches for better labellings before the
proof and at intervals during it.

For small blocks the block relaxation bounds λ much closer than the relaxation face by face. Conflicts then first come
from a branch and bound over blocks (`exact.block_search`). The formula afterwards decides whether a labelling is
left. Where the block relaxation is cheap it bounds all labellings before the first step. Any other long proof solves
it later for a bound and for refuted blocks (`exact.block_bound_tightening`).

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
from jld_explore.drivers.exact.block_bound_tightening import BlockBoundTightening
from jld_explore.drivers.exact.block_search import BlockSearch, ByBlocks
from jld_explore.drivers.exact.conflict_driver import ConflictDriver
from jld_explore.drivers.exact.conflict_minimization import Evidence, conflict_of
from jld_explore.drivers.exact.incumbents import HeuristicSchedule, Incumbents
from jld_explore.drivers.exact.optimum import Best, claims_of, front, front_of_all
from jld_explore.drivers.exact.target_schedule import TargetSchedule
from jld_explore.drivers.exact.targets import Targets, front_count
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation
from jld_explore.space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd

_PATIENCE: Final = (6000, 500)
"""Conflicts before the bound is lowered in smaller steps, with and without batch solver.

Finding so many conflicts takes a few seconds.
"""

_COMPARED: Final = 300
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
    alone : int, optional
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
        alone: int | None = None,
    ) -> None:
        if space.void is not None:
            raise ParameterError("driver", "exact proves nothing where cells may be left out", "enumeration or genetic")
        self.aim, self._programs = aim, programs
        self._count = front_count(space) if aim == "front" else None
        super().__init__(space, seed, self._count, list_blocks=list_blocks, alone=alone)
        self._floor = load_scale(space.assembly)
        self._by_blocks: BlockSearch | None = None
        self._tightening: BlockBoundTightening | None = None
        if self._relaxation is not None:
            self._by_blocks = BlockSearch(self._analyses, space, self._blocks, self._relaxation, by_blocks)
            many, wanted = self._relaxation.batched, by_blocks != "off"
            self._tightening = BlockBoundTightening(self._analyses, space, self._blocks, many=many, wanted=wanted)
        self._search = Genetic(space, seed, aim=aim) if aim == "front" else Anneal(space, seed)
        self._left = search * int(space.candidates.sum())
        self._incumbents = Incumbents(space, self._count)
        quick = self._relaxation is not None and self._relaxation.batched
        self._patience = step_after or _PATIENCE[not quick]
        self._schedule = TargetSchedule(self._patience)
        self._heuristics = HeuristicSchedule(quick=quick, never=search == 0)
        self._none_asked = self._by_more_than_faces = True
        self._aimed = math.inf
        self._began = 0
        self._begun = False
        self._targets = Targets(space, self._count, self._incumbents, self._floor)

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
        by_blocks = sum(part.solves for part in (self._by_blocks, self._tightening) if part is not None)
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
        if self._everything is not None:
            return self._everything.working
        return bool(self._open_targets) and not self._given_up

    @property
    def _open_targets(self) -> list[int | None]:
        """Targets that are not settled; none after the proof was given up."""
        return [] if self._given_up else self._targets.left

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """Return the cost of the proof, and the front if it is the aim; see `Driver.facts`."""
        found = super().facts(results, complete)
        if self._count is not None:
            enumerated = self._everything is not None
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
        self._schedule = TargetSchedule(self._patience)
        self._begun = False
        if self._by_blocks is not None:
            self._by_blocks.abandon()

    def set_workers(self, jobs: int) -> None:
        """Set the number of workers that refute parts of the space; see `Driver.set_workers`."""
        super().set_workers(jobs)
        if self._by_blocks is not None:
            self._by_blocks.set_workers(jobs)

    def close(self) -> None:
        """Stop all workers and save the conflicts; see `Driver.close`."""
        if self._by_blocks is not None:
            self._by_blocks.close()
        super().close()

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        """Return the next labellings (k, m) to evaluate; see `Driver.ask`.

        When nothing is left to prove this method checks the proof.
        """
        if self._everything is not None:
            return self._everything.ask(limit)
        if self._sources is not None:
            self._sources.pump()
        while not len(self._waiting) and self._open_targets and not self._late:
            if self._left > 0:
                self._waiting = self._search.ask(self._left if limit is None else min(limit, self._left))
                self._left = self._left - len(self._waiting) if len(self._waiting) else 0
            else:
                self._waiting = self._pursue(self._open_targets[0])
        if self._none_asked and not len(self._waiting) and not self._incumbents:
            self._waiting = self._search.ask(1)  # even after the deadline, so that the study has one result
        given = self._given(limit)
        self._none_asked &= not len(given)
        if not len(given) and not self._open_targets and self._proof_check is None and not self._given_up:
            claims, problem = claims_of(self.found.values(), self._incumbents, self._scale, self._floor)
            self._proof_check = self._check(claims, problem, self._incumbents.strongest(_COMPARED))
        return given

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m); see `Driver.tell`."""
        if self._everything is not None:
            self._everything.tell(labellings, evaluations)
            return
        self._search.tell(labellings, evaluations)
        self._state.note_evaluated(labellings)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations and raise the best λ of each target."""
        self._incumbents.learn(labellings, evaluations)
        self._targets.learn()

    @property
    def _late(self) -> bool:
        """Whether the deadline has passed or `programs` programs are solved."""
        return super()._late or (self._programs is not None and self.relaxations >= self._programs)

    # --- one target -------------------------------------------------------------------------------------

    def _pursue(self, target: int | None) -> Bits:
        """Work on a target; return labellings (k, m) to evaluate.

        No labelling is returned if the target is settled or time is up.
        """
        blocks, sources = self.block_search, self.sources
        if not self._begun:
            if target is None:
                self._lower(target, self._root())
                root = blocks.start(self.least(None) / self._scale, self.found[None].bound / self._scale)
                if self._by_more_than_faces:
                    self._bound_all(root, Evidence.BLOCKS)
                    self._lower(target, root * self._scale)
            self._begin(target)
        if self.found[target].proven:
            self._keep_open_nodes()
            self._settle(target)
            return self._none
        while not self._late:
            threshold = max(self._aimed, self.least(target))
            if blocks.active:
                proposed = self._choose(blocks, threshold)
                self._began = self.conflicts
                self._heartbeat()
                self._left = blocks.annealed()
                if len(proposed) or self._left:
                    return proposed
                continue
            if target is None and self._tighten(self._tightening):
                if self.found[None].proven:
                    self._settle(None)
                    return self._none
                self._begin(None)
                continue
            exhausted = self._generate(sources, threshold)
            proposed = self._to_evaluate()
            if exhausted and not len(proposed):
                self._lower(target, threshold)
                self._schedule.proven(self.conflicts - self._began)
                if threshold <= self.least(target):
                    self._settle(target)
                    return self._none
                self._begin(target)
                continue
            if self._schedule.stuck(self.conflicts - self._began, self.found[target].bound, threshold):
                self._begin(target)
            self._left = self._heuristics.due(self.relaxations)
            if len(proposed) or self._left:
                return proposed
        return self._none

    def _tighten(self, tightening: BlockBoundTightening | None) -> bool:
        """Bound all labellings by the block relaxation if that is due; return whether it was."""
        low, high = self.least(None) / self._scale, self.found[None].bound / self._scale
        if tightening is None or not math.isfinite(high) or not tightening.due(self.relaxations, low):
            return False
        left = self._deadline.remaining()
        found = tightening.tighten(low, high, left, self._late_after_heartbeat)
        self._state.add_conflicts(found.conflicts)
        self._bound_all(found.bound, Evidence.BLOCKS)
        self._lower(None, found.bound * self._scale)
        return True

    @property
    def block_search(self) -> BlockSearch:
        """Branch and bound over blocks; raises RuntimeError for an enumerated space."""
        if self._by_blocks is None:
            raise RuntimeError("an enumerated space has no search over blocks")
        return self._by_blocks

    def _keep_open_nodes(self) -> None:
        """State the bound of every open node of the block tree as a conflict."""
        if self._by_blocks is not None and self._by_blocks.active:
            self._state.add_conflicts(self._by_blocks.open_conflicts)

    def prove_by_faces(self) -> None:
        """Do without bounds from the block relaxation, which a certificate cannot express.

        Call this method before the search.
        """
        self._by_more_than_faces = False
        if self._tightening is not None:
            self._tightening.leave()

    def _choose(self, search: BlockSearch, threshold: float) -> Bits:
        """Take one step of the block tree; return the labellings (k, m) to evaluate."""
        formula = self.formula
        formula.rise(threshold / self._scale)
        step = search.step(formula, threshold / self._scale, self._late_after_heartbeat)
        for conflict in step.conflicts:
            self._add(conflict)
        self._state.conflicts.save()
        if step.whole is not None and formula.next(np.arange(len(step.whole)), step.whole) is None:
            return self._none  # the tree ignores limits on counts and assembly sequences
        if step.whole is not None:
            fallen = conflict_of(self.relaxation, step.whole, self._free, threshold / self._scale)
            if fallen is None:
                self._offer(step.whole)
                return self._to_evaluate()
            self._add(fallen)
            self._keep_open_nodes()
            search.note_blunt()
            return self._none
        self._lower(None, max(threshold, search.bound * self._scale))
        if step.promising is not None:
            self._offer(step.promising)
        return self._to_evaluate()

    def least(self, target: int | None) -> float:
        """Return the λ that a labelling must exceed to count as better, see `Targets.least`."""
        return self._targets.least(target)

    def _begin(self, target: int | None) -> None:
        """Aim the formula at the next λ of a target."""
        low = self.least(target)
        self._aimed = low if self.block_search.active else self._schedule.aim(self.found[target].bound, low)
        self._began = self.conflicts
        self._begun = True
        formula = self._told()
        formula.aim(self._aimed / self._scale, target)
        self.sources.begin(formula, target, self._aimed / self._scale)

    def _lower(self, target: int | None, bound: float) -> None:
        """Lower the bound of a target, see `Targets.lower`."""
        self._targets.lower(target, bound, self._state.handed_over)

    def _settle(self, target: int | None) -> None:
        """Close a target, its formula and its block tree, see `Targets.settle`."""
        self._targets.settle(target)
        self._schedule = TargetSchedule(self._patience)
        if self._by_blocks is not None:
            self._by_blocks.abandon()
        if self._begun:
            self.sources.end()
            self._begun = False
