"""The strongest segmentation, proven: labellings are refuted many at a time until none is left that could be better.

The driver asks a formula for a labelling that nothing rules out yet. If a mechanism proves that it is too weak,
so are all labellings that agree with it where that mechanism needs them to: the conflict is added to the formula,
and the next labelling is drawn. If none does, it is evaluated: it is better, or its own bracket says that it is not.
When the formula has no model left, nothing is stronger.

Where blocks are so small that the relaxation by blocks bounds λ much closer than face by face, conflicts come from a
branch and bound over blocks first (`exact.block_search`); the formula then says whether they leave anything.

What is trusted: limit analyses with their brackets, mechanisms whose work balance is computed here (`undecided`,
`undecided_blocks`), and a satisfiability solver. No tolerance of an optimiser enters the proof.

Spaces that have no formula or no relaxation (dry compressive strengths in space, limits on a count that is no sum of
ones, blocks to be counted where they are too many to be listed) are enumerated, which proves the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pandas as pd
from pydantic import Field

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.limit import CaseRelaxation, LimitAnalysis, Relaxation, Status, load_floor
from jld_explore.drivers.base import Aim, Driver, DriverOptions
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.block_search import BlockSearch, ByBlocks
from jld_explore.drivers.exact.conflicts import Conflict, Conflicts, conflict_of, key_of
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.optimum import Best, front, front_of_all
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation, Records
from jld_explore.space import SearchSpace, canonical, count_named, registered, values_of

_STEP: Final = 0.5 * tolerances.PROVEN
"""How far above the incumbent, relative, labellings are looked for: half of what counts as proven."""

_FINE: Final = 2e-3
"""Relative gap below which the last step is taken at once."""


class ExactOptions(DriverOptions):
    """Options of the exact driver."""

    aim: Aim = Field("best", description="best, or front (the best for every count)")


class Exact(Driver):
    """Proof by conflicts.

    aim: "best", or "front": the best for every value of the scene's count. search: labellings evaluated before the
    proof, for each face that can change. by_blocks: search a tree of block choices first, "auto": where that promises
    more than conflicts of faces. list_blocks: list the blocks there can be, where they are few enough. step_after:
    conflicts after which bounds are lowered step by step, so that a proof too long to finish leaves a narrower gap.
    programs: solved at the most before it comes back as for lack of time.
    """

    name = "exact"
    remembers = True
    modular = True

    Options = ExactOptions

    def __init__(
        self,
        space: SearchSpace,
        seed: int = 0,
        aim: Aim = "best",
        *,
        search: int = 10,
        by_blocks: ByBlocks = "auto",
        list_blocks: bool = True,
        step_after: int = 1500,
        programs: int | None = None,
    ) -> None:
        super().__init__(space, seed)
        self.aim, self._step_after, self._programs = aim, step_after, programs
        if aim == "front" and space.search.front.counts:
            raise InputError("search.front.counts", "two counts have no exact front", "one count, or --driver genetic")
        self._count = count_named(space.search.front.count) if aim == "front" else None
        if self._count is not None and self._count.terms is None:
            known = " or ".join(count.name for count in registered() if count.terms)
            raise InputError("search.front.count", f"{self._count.name} has no exact front", known)
        cases, required = space.assembly.by_case, space.assembly.required.tolist()
        analyses = [LimitAnalysis(case) for case in cases]
        self._templates = [analysis.template for analysis in analyses]
        # bounds of several cases are of the governing factor, which has no scale
        self._scale = 1.0 if space.assembly.cases else analyses[0].template.scaling.load
        self._floor = min(load_floor(case) / factor for case, factor in zip(cases, required, strict=True))
        self._blocks = possible_blocks(space) if list_blocks else None
        asked = [count for count, _ in space.limits.on_counts] + ([] if self._count is None else [self._count])
        terms = [count.terms(space.assembly) if count.terms else None for count in asked]
        listed = all(one is not None and not (one.blocks and self._blocks is None) for one in terms)
        covered = all(template.yield_set.hull() is not None for template in self._templates) and listed
        self._everything = None if covered else Enumeration(space)
        self._relaxation: Relaxation | CaseRelaxation | None = None
        self._by_blocks = None
        if covered:
            each = [Relaxation(analysis) for analysis in analyses]
            self._relaxation = CaseRelaxation(each, required) if space.assembly.cases else each[0]
            self._by_blocks = BlockSearch(analyses, space, self._blocks, self._relaxation, by_blocks)
        self._free = space.candidates.copy()
        if self._blocks is not None:
            joined = {face for inside in self._blocks.inside for face in inside}
            self._free &= np.isin(np.arange(len(self._free)), list(joined))
        self._genetic = Genetic(space, seed, aim=aim)
        self._left = search * int(space.candidates.sum())
        self._searching = True
        self._known: dict[bytes, tuple[float, float, int]] = {}
        self._conflicts = Conflicts(len(space.fixed))
        self._formula: Formula | None = None
        self._passed: list[Bits] = []
        self._aimed = math.inf
        self._began = 0
        self._stepping = False
        self._targets: list[int | None] = [None]
        self._listed = aim == "best"
        self.found: dict[int | None, Best] = {None: Best(None, math.nan, math.inf, self._floor)}
        self._deadline: float | None = None
        self._heartbeat: Callable[[], None] = lambda: None

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self.aim}

    @property
    def conflicts(self) -> int:
        """Conflicts found so far."""
        return len(self._conflicts)

    @property
    def relaxations(self) -> int:
        """Programs solved for them."""
        return sum(part.solves for part in (self._relaxation, self._by_blocks) if part is not None)

    @property
    def bound(self) -> float | None:
        """Proven upper bound on λ over the whole space, scene units; None where there is none yet."""
        best = self.found[None]
        return best.bound if math.isfinite(best.bound) else None

    @property
    def finished(self) -> bool:
        """All that was aimed at is proven."""
        return self._everything is None and not self._targets and all(best.proven for best in self.found.values())

    @property
    def exhaustive(self) -> bool:
        """See `Driver.exhaustive`."""
        return self._everything is not None

    @property
    def working(self) -> bool:
        """See `Driver.working`."""
        return self._everything is None and bool(self._targets)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """See `Driver.facts`: what the proof took, and the front where that was aimed at."""
        found: dict[str, Any] = {"conflicts": self.conflicts, "relaxations": self.relaxations}
        if self._count is not None:
            enumerated = self._everything is not None
            rows = front_of_all(results, self._count.name, complete) if enumerated else front(self.found.values())
            found["front"] = rows
        return found

    def start(self, deadline: float | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """See `Driver.start`."""
        # what was found last must still be evaluated
        self._deadline = None if deadline is None else deadline - 0.3
        self._heartbeat = heartbeat
        if records is not None and self._everything is None:
            self._conflicts.keep(records, key_of(self._templates, self.space, self._blocks))

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take incumbents (k, m) from a study that is gone on with."""
        self._learn(labellings, evaluations)

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        if self._everything is not None:
            return self._everything.ask(limit)
        if self._left > 0:
            found = self._genetic.ask(self._left if limit is None else min(limit, self._left))
            self._left = self._left - len(found) if len(found) else 0
            if len(found):
                return found
        self._searching = False
        while self._targets and not self._late:
            proposed = self._pursue(self._targets[0])
            if proposed is not None:
                return proposed
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        if self._everything is not None:
            self._everything.tell(labellings, evaluations)
            return
        if self._searching:
            self._genetic.tell(labellings, evaluations)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        number = [0] * len(labellings)
        if self._count is not None:
            number = values_of(self._count, self.space.assembly, labellings, self.space.graph).tolist()
        for labels, found, count in zip(labellings, evaluations, number, strict=True):
            low = found.low if found.status is Status.COLLAPSE else -math.inf
            high = found.high if found.status is Status.COLLAPSE else -math.inf
            if found.status in (Status.UNCERTIFIED, Status.FAILED):
                high = found.high if math.isfinite(found.high) else math.inf
            if math.isfinite(found.zero_dilation):
                # there may be other solutions without dilation; the associative λ bounds them all
                high = max(high, found.associative * (1.0 + tolerances.PROVEN))
            self._known[np.packbits(labels).tobytes()] = (low, high, count)
        for target, best in self.found.items():
            low = self._incumbent(target)
            if math.isfinite(low) and not best.load_factor >= low:
                self.found[target] = replace(best, load_factor=low)

    def _incumbent(self, target: int | None) -> float:
        fitting = (low for low, _, count in self._known.values() if target is None or count == target)
        return max(fitting, default=-math.inf)

    @property
    def _late(self) -> bool:
        if self._programs is not None and self.relaxations >= self._programs:
            return True
        return self._deadline is not None and time.perf_counter() >= self._deadline

    def _late_after_heartbeat(self) -> bool:
        self._heartbeat()
        return self._late

    # --- one target -------------------------------------------------------------------------------------

    def _pursue(self, target: int | None) -> Bits | None:
        """Go on with a target: a labelling to be evaluated, (1, m), or None when it is settled or time is up."""
        assert self._by_blocks is not None
        if self._formula is None:
            if target is None:
                self._lower(target, self._root())
                self._by_blocks.start(self.least(None) / self._scale, self.found[None].bound / self._scale)
            self._began, self._stepping = self.conflicts, False
            self._begin(target)
        if self.found[target].proven:
            self._settle(target)
            return None
        while not self._late:
            threshold = max(self._aimed, self.least(target))
            assert self._formula is not None
            if self._by_blocks.active:
                proposed = self._choose(self._by_blocks, threshold)
                self._began = self.conflicts
                self._heartbeat()
                if proposed is not None:
                    return proposed
                continue
            labels = self._formula.next()
            if labels is None:
                self._lower(target, threshold)
                if threshold <= self.least(target):
                    self._settle(target)
                    return None
                self._begin(target)
                continue
            proposed = self._examine(labels, threshold)
            self._heartbeat()
            if proposed is not None:
                return proposed
            if not self._stepping and self.conflicts - self._began >= self._step_after:
                self._stepping = True
                self._begin(target)
        return None

    def _examine(self, labels: Bits, threshold: float) -> Bits | None:
        """Rule a labelling out with all that fall for the same reason; or return it, (1, m), to be evaluated."""
        assert self._formula is not None
        assert self._relaxation is not None
        conflict = conflict_of(self._relaxation, labels, self._free, threshold / self._scale)
        if conflict is not None:
            self._add(conflict)
            return None
        return self._offer(labels)

    def _add(self, conflict: Conflict) -> None:
        assert self._formula is not None
        self._conflicts.add(conflict)
        self._formula.forbid(conflict.faces, conflict.labels)

    def _offer(self, labels: Bits) -> Bits | None:
        """A labelling that no mechanism ruled out, (1, m), unless it has been evaluated before."""
        assert self._formula is not None
        self._formula.forbid(np.arange(len(labels)), labels)
        labels = np.asarray(canonical(labels[None], self.space.group)[0])
        self._passed.append(labels)
        proposed: Bits = labels[None]
        return None if np.packbits(labels).tobytes() in self._known else proposed

    def _choose(self, search: BlockSearch, threshold: float) -> Bits | None:
        """Go on with the tree of block choices: a labelling to be evaluated, (1, m), or None."""
        assert self._formula is not None
        step = search.step(self._formula, threshold / self._scale, self._late_after_heartbeat)
        for conflict in step.conflicts:
            self._add(conflict)
        if step.whole is not None and self._formula.next(np.arange(len(step.whole)), step.whole) is None:
            return None  # the tree knows nothing of counts, nor of laying
        if step.whole is not None:
            before = self.conflicts
            proposed = self._examine(step.whole, threshold)
            if self.conflicts > before:
                search.note_blunt()
            return proposed
        self._lower(None, max(threshold, search.bound * self._scale))
        return None if step.promising is None else self._offer(step.promising)

    def least(self, target: int | None) -> float:
        """λ that a labelling must exceed to be worth finding, scene units."""
        low = self._incumbent(target)
        return low + _STEP * max(abs(low), self._floor) if math.isfinite(low) else 0.0

    def _root(self) -> float:
        """Bound on all labellings at once, scene units."""
        assert self._relaxation is not None
        # candidates that no possible block contains are dry whatever the scene's own label
        labels = self.space.fixed | (self.space.candidates & ~self._free)
        bound = self._relaxation.bound(labels, self._free)
        return bound * self._scale if math.isfinite(bound) else bound

    def _far(self, target: int | None) -> bool:
        best = self.found[target]
        low = max(self._incumbent(target), 0.0)
        return math.isfinite(best.bound) and best.bound - low > _FINE * max(abs(best.bound), self._floor)

    def _begin(self, target: int | None) -> None:
        """A formula of what is left: at the incumbent, or half-way to the bound once that has proved to be long."""
        if self._formula is not None:
            self._formula.close()
        low, best = self.least(target), self.found[target]
        self._aimed = low
        if self._stepping and self._far(target):
            self._aimed = 0.5 * (low + best.bound)
        self._formula = Formula(self.space, self._blocks, target)
        for conflict in self._conflicts:
            # compared as it was made: products of quotients round
            if conflict.bound <= self._aimed / self._scale:
                self._formula.forbid(conflict.faces, conflict.labels)
        for labels in self._passed:
            self._formula.forbid(np.arange(len(labels)), labels)

    def _lower(self, target: int | None, bound: float) -> None:
        """Lower a bound on all but the labellings that no mechanism ruled out; those have bounds of their own."""
        for labels in self._passed:
            _, high, count = self._known.get(np.packbits(labels).tobytes(), (-math.inf, math.inf, target))
            if target is None or count == target:
                bound = max(bound, high)
        best = self.found[target]
        if bound < best.bound:
            self.found[target] = replace(best, bound=bound)

    def _settle(self, target: int | None) -> None:
        """Close a target; the best labelling of all says which counts are worth a look."""
        best = self.found[target]
        if math.isnan(best.load_factor) and best.bound <= 0.0:
            self.found[target] = best = replace(best, bound=-math.inf)
        self._targets.remove(target)
        if self._by_blocks is not None:
            self._by_blocks.abandon()
        if self._formula is not None:
            self._formula.close()
            self._formula = None
        if not self._listed:
            self._listed = True
            for count in self._counts():
                low = self._incumbent(count)
                known = low if math.isfinite(low) else math.nan
                self.found[count] = Best(count, known, best.bound, self._floor)
                self._targets.append(count)

    def _counts(self) -> list[int]:
        """Values that the count of the front may take."""
        assert self._count is not None
        assert self._count.terms is not None
        most = self._count.terms(self.space.assembly).most(self.space.assembly)
        bounds = next((bounds for count, bounds in self.space.limits.on_counts if count is self._count), None)
        if bounds is None:
            return list(range(most + 1))
        return list(range(int(bounds.low or 0), (most if bounds.high is None else min(int(bounds.high), most)) + 1))
