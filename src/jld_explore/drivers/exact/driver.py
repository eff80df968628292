"""The strongest segmentation, proven: labellings are refuted many at a time until none is left that could be better.

The driver asks a formula for labellings that nothing rules out yet. Where a mechanism proves that one is too weak,
so are all labellings that agree with it where that mechanism needs them to: the conflict is added to the formula
(`exact.hunting`). If none does, it is evaluated: it is better, or its own bracket says that it is not. When the
formula has no model left, nothing is stronger than the λ it was made for, and the next is made for a lower one
(`exact.ladder`), down to the best that is known, which annealing looks for before the proof and now and then beside it.

Where blocks are so small that the relaxation by blocks bounds λ much closer than face by face, conflicts come from a
branch and bound over blocks first (`exact.block_search`); the formula then says whether they leave anything. Where it
is cheap it bounds all labellings before the first step, and any other proof that lasts asks it once for a bound, and
for blocks that are ruled out (`exact.tightening`).

What is trusted: limit analyses with their brackets, mechanisms whose work balance is computed here (`relaxation`,
`block_relaxation`), and a satisfiability solver. No tolerance of an optimiser enters the proof.

Spaces that have no formula or no relaxation (limits on a count that is no sum of ones, blocks to be counted where they
are too many to be listed) are enumerated, which proves the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.limit import load_scale
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Aim
from jld_explore.drivers.exact.block_bound_tightening import BlockBoundTightening
from jld_explore.drivers.exact.block_search import BlockSearch, ByBlocks
from jld_explore.drivers.exact.conflict_driver import ConflictDriver
from jld_explore.drivers.exact.conflict_minimization import Conflict, Evidence, Mechanism, conflict_of
from jld_explore.drivers.exact.incumbents import HeuristicSchedule, Incumbents
from jld_explore.drivers.exact.optimum import Best, claims_of, counts_of, front, front_of_all
from jld_explore.drivers.exact.target_schedule import TargetSchedule
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation
from jld_explore.space import SearchSpace, count_named, registered

if TYPE_CHECKING:
    import pandas as pd

_STEP: Final = 0.5 * tolerances.PROVEN
"""How far above the incumbent, relative, labellings are looked for: half of what counts as proven."""

_PATIENCE: Final = (6000, 500)
"""Conflicts after which a bound is lowered in smaller steps, with the batch solver and without: a few seconds."""


_COMPARED: Final = 300
"""Strongest evaluated layouts that are held against all conflicts when a proof ends."""


class Exact(ConflictDriver):
    """Proof by conflicts.

    aim: "best", or "front": the best for every value of the scene's count. search: labellings evaluated before the
    proof, for each face that can change. by_blocks: search a tree of block choices first, "auto": where that promises
    more than conflicts of faces. list_blocks: list the blocks there can be, where they are few enough. step_after:
    conflicts after which a bound is lowered in smaller steps, so that a proof too long to finish leaves a narrower gap;
    None for a few seconds' worth. programs: solved at the most before it comes back as for lack of time. alone:
    relaxations after which other processes help, where there are any, 0: it is left to them; None for a second's worth.
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
            raise InputError("--driver", "exact proves nothing where cells may be left out", "enumeration or genetic")
        self.aim, self._programs = aim, programs
        if aim == "front" and space.search.front.counts:
            raise InputError("search.front.counts", "two counts have no exact front", "one count, or --driver genetic")
        self._count = count_named(space.search.front.count) if aim == "front" else None
        if self._count is not None and self._count.terms is None:
            known = " or ".join(count.name for count in registered() if count.terms)
            raise InputError("search.front.count", f"{self._count.name} has no exact front", known)
        super().__init__(space, seed, self._count, list_blocks=list_blocks, alone=alone)
        self._floor = load_scale(space.assembly)
        self._by_blocks: BlockSearch | None = None
        self._tightening: BlockBoundTightening | None = None
        if self._relaxation is not None:
            self._by_blocks = BlockSearch(self._analyses, space, self._blocks, self._relaxation, by_blocks)
            many, wanted = self._relaxation.many, by_blocks != "off"
            self._tightening = BlockBoundTightening(self._analyses, space, self._blocks, many=many, wanted=wanted)
        self._search = Genetic(space, seed, aim=aim) if aim == "front" else Anneal(space, seed)
        self._left = search * int(space.candidates.sum())
        self._incumbents = Incumbents(space, self._count)
        quick = self._relaxation is not None and self._relaxation.many
        self._patience = step_after or _PATIENCE[not quick]
        self._schedule = TargetSchedule(self._patience)
        self._heuristics = HeuristicSchedule(quick=quick, never=search == 0)
        self._none_asked = self._by_more_than_faces = True
        self._aimed = math.inf
        self._began = 0
        self._begun = False
        self._targets: list[int | None] = [None]
        self._listed = aim == "best"
        self.found: dict[int | None, Best] = {None: Best(None, math.nan, math.inf, self._floor)}

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self.aim}

    @property
    def relaxations(self) -> int:
        """See `ConflictDriver.relaxations`."""
        by_blocks = sum(part.solves for part in (self._by_blocks, self._tightening) if part is not None)
        return super().relaxations + by_blocks

    @property
    def bound(self) -> float | None:
        """Proven upper bound on λ over the whole space, scene units; None where there is none yet, or none any more."""
        if self._given_up or (self._proof_check is not None and not self._proof_check.passed):
            return None
        best = self.found[None]
        return best.bound if math.isfinite(best.bound) else None

    @property
    def finished(self) -> bool:
        """All that was aimed at is proven, and the proof passed its check."""
        return self._proof_check is not None and self._proof_check.passed

    @property
    def working(self) -> bool:
        """See `Driver.working`."""
        if self._everything is not None:
            return self._everything.working
        return bool(self._targets) and not self._given_up

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """See `Driver.facts`: what the proof took, and the front where that was aimed at."""
        found = super().facts(results, complete)
        if self._count is not None:
            enumerated = self._everything is not None
            rows = front_of_all(results, self._count.name, complete) if enumerated else front(self.found.values())
            if self.proof_check is not None and not self.proof_check.passed:
                rows = [{**row, "bound": None, "proven": False} for row in rows]
            found["front"] = rows
        return found

    def withdraw(self, reason: str) -> None:
        """See `Driver.withdraw`."""
        super().withdraw(reason)
        self._forget_bounds()

    def _forget_bounds(self) -> None:
        """Begin the proof again at its first target, with what was evaluated."""
        low = self._incumbents.best(None)
        self.found = {None: Best(None, low if math.isfinite(low) else math.nan, math.inf, self._floor)}
        self._targets = [] if self._given_up else [None]
        self._listed = self.aim == "best"
        self._schedule = TargetSchedule(self._patience)
        self._begun = False
        if self._by_blocks is not None:
            self._by_blocks.abandon()

    def set_workers(self, jobs: int) -> None:
        """See `Driver.set_workers`: they refute parts of the space."""
        super().set_workers(jobs)
        if self._by_blocks is not None:
            self._by_blocks.set_workers(jobs)

    def close(self) -> None:
        """See `Driver.close`."""
        if self._by_blocks is not None:
            self._by_blocks.close()
        super().close()

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        if self._everything is not None:
            return self._everything.ask(limit)
        if self._sources is not None:
            self._sources.pump()
        while not len(self._waiting) and self._targets and not self._late:
            if self._left > 0:
                self._waiting = self._search.ask(self._left if limit is None else min(limit, self._left))
                self._left = self._left - len(self._waiting) if len(self._waiting) else 0
            else:
                self._waiting = self._pursue(self._targets[0])
        if self._none_asked and not len(self._waiting) and not self._incumbents:
            self._waiting = self._search.ask(1)  # however late it is: there is something to show
        given = self._given(limit)
        self._none_asked &= not len(given)
        if not len(given) and not self._targets and self._proof_check is None and not self._given_up:
            strongest = self._incumbents.strongest(_COMPARED)
            self._proof_check = self._check(
                *claims_of(self.found.values(), self._incumbents, self._scale, self._floor), strongest
            )
        return given

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        if self._everything is not None:
            self._everything.tell(labellings, evaluations)
            return
        self._search.tell(labellings, evaluations)
        self._state.note_evaluated(labellings)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        self._incumbents.learn(labellings, evaluations)
        for target, best in self.found.items():
            low = self._incumbents.best(target)
            if math.isfinite(low) and not best.load_factor >= low:
                self.found[target] = replace(best, load_factor=low)

    @property
    def _late(self) -> bool:
        return super()._late or (self._programs is not None and self.relaxations >= self._programs)

    def _late_after_heartbeat(self) -> bool:
        self._heartbeat()
        return self._late

    # --- one target -------------------------------------------------------------------------------------

    def _pursue(self, target: int | None) -> Bits:
        """Go on with a target: labellings to be evaluated, (k, m), or none when it is settled or time is up."""
        assert self._by_blocks is not None
        assert self._sources is not None
        if not self._begun:
            if target is None:
                self._lower(target, self._root())
                root = self._by_blocks.start(self.least(None) / self._scale, self.found[None].bound / self._scale)
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
            assert self._formula is not None
            if self._by_blocks.active:
                proposed = self._choose(self._by_blocks, threshold)
                self._began = self.conflicts
                self._heartbeat()
                self._left = self._by_blocks.annealed()
                if len(proposed) or self._left:
                    return proposed
                continue
            if target is None and self._tighten(self._tightening):
                if self.found[None].proven:
                    self._settle(None)
                    return self._none
                self._begin(None)
                continue
            exhausted = self._generate(self._sources, threshold)
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
        """Have the relaxation by blocks bound all labellings, where its time has come; whether it has."""
        low, high = self.least(None) / self._scale, self.found[None].bound / self._scale
        if tightening is None or not math.isfinite(high) or not tightening.due(self.relaxations, low):
            return False
        left = self._deadline.remaining()
        found = tightening.tighten(low, high, left, self._late_after_heartbeat)
        self._state.add_conflicts(found.conflicts)
        self._bound_all(found.bound, Evidence.BLOCKS)
        self._lower(None, found.bound * self._scale)
        return True

    def _bound_all(self, bound: float, evidence: Evidence, mechanism: Mechanism | None = None) -> None:
        """State a bound on all labellings, scaled λ, as a conflict of no faces."""
        if bound != math.inf:
            nothing = np.empty(0, dtype=np.int64)
            self._state.add_conflicts([Conflict(nothing, nothing.astype(bool), bound, evidence, mechanism)])

    def _keep_open_nodes(self) -> None:
        """State the bound of every open node of the tree of blocks as a conflict."""
        if self._by_blocks is not None and self._by_blocks.active:
            self._state.add_conflicts(self._by_blocks.open_conflicts)

    def prove_by_faces(self) -> None:
        """Do without what a certificate cannot say: a bound that mechanisms of blocks prove together."""
        self._by_more_than_faces = False
        if self._tightening is not None:
            self._tightening.leave()

    def _add(self, conflict: Conflict) -> None:
        assert self._formula is not None
        self._state.add_conflicts([conflict])
        self._formula.forbid(conflict.faces, conflict.labels, conflict.bound)

    def _choose(self, search: BlockSearch, threshold: float) -> Bits:
        """Go on with the tree of block choices: a labelling to be evaluated, (1, m), or none."""
        assert self._formula is not None
        assert self._relaxation is not None
        self._formula.rise(threshold / self._scale)
        step = search.step(self._formula, threshold / self._scale, self._late_after_heartbeat)
        for conflict in step.conflicts:
            self._add(conflict)
        self._state.conflicts.save()
        if step.whole is not None and self._formula.next(np.arange(len(step.whole)), step.whole) is None:
            return self._none  # the tree knows nothing of counts, nor of laying
        if step.whole is not None:
            fallen = conflict_of(self._relaxation, step.whole, self._free, threshold / self._scale)
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
        """λ that a labelling must exceed to be worth finding, scene units."""
        low = self._incumbents.best(target)
        return low + _STEP * max(abs(low), self._floor) if math.isfinite(low) else 0.0

    def _root(self) -> float:
        """Bound on all labellings at once, scene units."""
        assert self._relaxation is not None
        # candidates that no possible block contains are dry whatever the scene's own label
        labels = self.space.fixed | (self.space.candidates & ~self._free)
        found = self._relaxation.least_bound(labels, self._free)
        if found is None:
            return math.inf
        self._bound_all(found.bound, Evidence.MECHANISM, Mechanism(found.case, found.velocity))
        return found.bound * self._scale

    def _begin(self, target: int | None) -> None:
        """Aim at what is left at the next step down."""
        assert self._by_blocks is not None
        assert self._sources is not None
        low = self.least(target)
        self._aimed = low if self._by_blocks.active else self._schedule.aim(self.found[target].bound, low)
        self._began = self.conflicts
        self._begun = True
        formula = self._told()
        formula.aim(self._aimed / self._scale, target)
        self._sources.begin(formula, target, self._aimed / self._scale)

    def _lower(self, target: int | None, bound: float) -> None:
        """Lower a bound on all but the labellings that no mechanism ruled out; those have bounds of their own."""
        for labels in self._state.handed_over:
            bound = max(bound, self._incumbents.high(labels, target))
        best = self.found[target]
        if bound < best.bound:
            self.found[target] = replace(best, bound=bound)

    def _settle(self, target: int | None) -> None:
        """Close a target; the best labelling of all says which counts are worth a look."""
        best = self.found[target]
        if math.isnan(best.load_factor) and best.bound <= 0.0:
            self.found[target] = best = replace(best, bound=-math.inf)
        self._targets.remove(target)
        self._schedule = TargetSchedule(self._patience)
        if self._by_blocks is not None:
            self._by_blocks.abandon()
        if self._begun:
            assert self._sources is not None
            self._sources.end()
            self._begun = False
        if not self._listed:
            self._listed = True
            assert self._count is not None
            for count in counts_of(self.space, self._count):
                low = self._incumbents.best(count)
                known = low if math.isfinite(low) else math.nan
                self.found[count] = Best(count, known, best.bound, self._floor)
                self._targets.append(count)
