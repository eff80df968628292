"""The best count among labellings that carry enough, proven: a load factor is required, and a count is optimised.

The formula holds what counts better than the best labelling known that meets the requirement. Its labellings are ruled
out many at a time by mechanisms that prove them too weak, or evaluated; one that meets the requirement counts better,
and the formula is begun again with what counts better still. When it has no model left, nothing that counts better
carries enough.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.limit import CaseRelaxation, LimitAnalysis, Relaxation
from jld_explore.drivers.base import Aim, Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.conflicts import Conflicts, key_of
from jld_explore.drivers.exact.driver import ExactOptions
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.hunting import Hunt
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation, Records, may_meet, meets
from jld_explore.space import Range, SearchSpace, canonical, count_named, values_of


class Lightest(Driver):
    """The exact driver where `search.require` asks for a load factor: its sense turned round.

    search: labellings evaluated before the proof, for each face that can change. Spaces that have no formula, counts
    that are no sum of ones among them, are enumerated, which proves the same.
    """

    name = "exact"
    remembers = True
    modular = True
    Options = ExactOptions

    def __init__(self, space: SearchSpace, seed: int = 0, aim: Aim = "best", *, search: int = 5) -> None:
        super().__init__(space, seed)
        if space.search.require is None or aim != "best":
            raise InputError("--aim", "a front is not what search.require asks for", "best")
        name, sense = space.search.front.axes[0]
        self._count, self._least = count_named(name), sense == "min"
        cases, required = space.assembly.by_case, space.assembly.required.tolist()
        analyses = [LimitAnalysis(case) for case in cases]
        self._templates = [analysis.template for analysis in analyses]
        self._scale = 1.0 if space.assembly.cases else self._templates[0].scaling.load
        self._threshold = space.search.require.threshold
        self._blocks = possible_blocks(space)
        asked = [*(count for count, _ in space.limits.on_counts), self._count]
        terms = [count.terms(space.assembly) if count.terms else None for count in asked]
        listed = all(one is not None and not (one.blocks and self._blocks is None) for one in terms)
        covered = listed and all(template.yield_set.hull() is not None for template in self._templates)
        self._everything = None if covered else Enumeration(space)
        if covered:
            each = [Relaxation(analysis) for analysis in analyses]
            self._relaxation = CaseRelaxation(each, required) if space.assembly.cases else each[0]
        self._free = space.candidates.copy()
        if self._blocks is not None:
            joined = {face for inside in self._blocks.inside for face in inside}
            self._free &= np.isin(np.arange(len(self._free)), list(joined))
        if covered:
            self._hunt = Hunt(self._relaxation, self._free, seed)
        self._genetic = Genetic(space, seed)
        self._left = search * int(space.candidates.sum())
        self._searching = True
        self._known: dict[bytes, tuple[bool, bool, float]] = {}
        self._conflicts = Conflicts(len(space.fixed))
        self._formula: Formula | None = None
        self._passed: list[Bits] = []
        self._waiting = np.empty((0, len(space.fixed)), dtype=bool)
        self._done = False
        self._deadline: float | None = None
        self._heartbeat: Callable[[], None] = lambda: None

    @property
    def finished(self) -> bool:
        """All that was asked for is proven."""
        return self._done and self._everything is None and not self._open

    @property
    def exhaustive(self) -> bool:
        """See `Driver.exhaustive`."""
        return self._everything is not None

    @property
    def working(self) -> bool:
        """See `Driver.working`."""
        return self._everything is None and not self._done

    @property
    def best(self) -> float | None:
        """The best count known of a labelling that meets the requirement."""
        found = [count for met, _, count in self._known.values() if met]
        return (min(found) if self._least else max(found)) if found else None

    @property
    def _open(self) -> bool:
        """Is a labelling known that counts better and may meet the requirement or not?"""
        best = self.best
        return any(
            may and not met and (best is None or (count < best if self._least else count > best))
            for met, may, count in self._known.values()
        )

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """See `Driver.facts`: what the proof took."""
        solves = 0 if self._everything is not None else self._relaxation.solves
        return {"conflicts": len(self._conflicts), "relaxations": solves}

    def start(self, deadline: float | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """See `Driver.start`."""
        self._deadline = None if deadline is None else deadline - 0.3
        self._heartbeat = heartbeat
        if records is not None and self._everything is None:
            self._conflicts.keep(records, key_of(self._templates, self.space, self._blocks))

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in what a study that is gone on with knows."""
        self._learn(labellings, evaluations)

    def ask(self, limit: int | None = None) -> Bits:
        if self._everything is not None:
            return self._everything.ask(limit)
        if self._left > 0:
            found = self._genetic.ask(self._left if limit is None else min(limit, self._left))
            self._left = self._left - len(found) if len(found) else 0
            if len(found):
                return found
        self._searching = False
        while not len(self._waiting) and not self._done and not self._late:
            if self._formula is None:
                self._begin()
            caught = self._hunt.step(self._threshold / self._scale)
            self._conflicts.add(caught.conflicts)
            self._heartbeat()
            self._done = caught.exhausted
            self._waiting = np.concatenate([self._waiting, *(self._offer(labels) for labels in caught.unrefuted)])
        given = self._waiting[:limit]
        self._waiting = self._waiting[len(given) :]
        return given

    @property
    def _late(self) -> bool:
        return self._deadline is not None and time.perf_counter() >= self._deadline

    def _offer(self, labels: Bits) -> Bits:
        """A labelling that no mechanism ruled out, (1, m), unless it has been evaluated before, (0, m)."""
        row = np.asarray(canonical(labels[None], self.space.group))
        self._passed.append(row[0])
        return row[:0] if np.packbits(row[0]).tobytes() in self._known else row

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        if self._everything is not None:
            self._everything.tell(labellings, evaluations)
            return
        if self._searching:
            self._genetic.tell(labellings, evaluations)
        before = self.best
        self._learn(labellings, evaluations)
        if self.best != before and self._formula is not None:
            self._formula.close()
            self._formula = None

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        count = values_of(self._count, self.space.assembly, labellings, self.space.graph)
        for labels, found, value in zip(labellings, evaluations, count.tolist(), strict=True):
            state = meets(self.space, found), may_meet(self.space, found), float(value)
            self._known[np.packbits(labels).tobytes()] = state

    def _begin(self) -> None:
        """A formula of all that counts better than the best known."""
        best = self.best
        wanted: tuple[float | None, float | None] | None = None
        if best is not None and math.isfinite(best):
            wanted = (None, best - 1) if self._least else (best + 1, None)
        self._formula = Formula(self.space, self._blocks)
        if wanted is not None:
            self._formula.limit(self._count, Range.of(wanted, whole=True))
        for conflict in self._conflicts:
            # compared as it was made: products of quotients round
            if conflict.bound <= self._threshold / self._scale:
                self._formula.forbid(conflict.faces, conflict.labels)
        for labels in self._passed:
            self._formula.forbid(np.arange(len(labels)), labels)
        self._hunt.begin(self._formula)
