"""What the exact drivers prove with: relaxations, possible blocks, a formula of what is left, conflicts, hunters."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits
from jld_core.deadline import Deadline
from jld_core.limit import LimitAnalysis, relaxation_of
from jld_explore.drivers.base import Aim, Driver, DriverOptions
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.conflicts import Conflicts, key_of
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.hunters import Hunters
from jld_explore.drivers.exact.hunting import Catch
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.evaluation import Evaluation, Records
from jld_explore.space import Count, SearchSpace, canonical

if TYPE_CHECKING:
    import pandas as pd


class ExactOptions(DriverOptions):
    """Options of the exact driver."""

    aim: Aim = Field("best", description="best, or front (the best for every count)")


class Proving(Driver):
    """A driver that proves; or enumerates, which proves the same, where its space has no formula or no relaxation.

    counted: a count the formula must hold, besides those that are limited. list_blocks: list the blocks there can be,
    where they are few enough. alone: see `Hunters`.
    """

    name = "exact"
    remembers = True
    modular = True
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
        self._conflicts = Conflicts(len(space.fixed))
        self._formula: Formula | None = None
        self._said = 0, 0
        self._passed: list[Bits] = []
        self._hunters: Hunters | None = None
        if self._relaxation is not None:
            proof = self._conflicts, self._passed
            self._hunters = Hunters(self._relaxation, space, self._blocks, self._free, seed, *proof, alone)
        self._waiting = self._none
        self._deadline = Deadline()
        self._heartbeat: Callable[[], None] = lambda: None

    @property
    def exhaustive(self) -> bool:
        """See `Driver.exhaustive`."""
        return self._everything is not None

    @property
    def known(self) -> Conflicts:
        """The conflicts found so far."""
        return self._conflicts

    @property
    def conflicts(self) -> int:
        """How many they are."""
        return len(self._conflicts)

    @property
    def relaxations(self) -> int:
        """Programs solved for them, by whomever."""
        return sum(part.solves for part in (self._relaxation, self._hunters) if part is not None)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """See `Driver.facts`: what the proof took."""
        return {"conflicts": self.conflicts, "relaxations": self.relaxations}

    def employ(self, jobs: int) -> None:
        """See `Driver.employ`: they refute parts of the space."""
        if self._hunters is not None:
            self._hunters.employ(jobs)

    def close(self) -> None:
        """See `Driver.close`."""
        if self._hunters is not None:
            self._conflicts.add(self._hunters.close().conflicts)

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """See `Driver.start`."""
        # what was found last must still be evaluated
        self._deadline = Deadline() if deadline is None else deadline.earlier(0.3)
        self._heartbeat = heartbeat
        if records is not None and self._everything is None:
            templates = [analysis.template for analysis in self._analyses]
            self._conflicts.keep(records, key_of(templates, self.space, self._blocks))

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in what a study that is gone on with knows: labellings (k, m)."""
        self._learn(labellings, evaluations)

    @abstractmethod
    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None: ...

    @abstractmethod
    def _is_evaluated(self, labels: Bits) -> bool:
        """Whether a canonical labelling (m,) was evaluated."""

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

    def _hunted(self, hunters: Hunters, threshold: float) -> Catch:
        """What hunters find in a moment, its conflicts kept. threshold: λ, scene units."""
        caught = hunters.step(threshold / self._scale)
        self._conflicts.add(caught.conflicts)
        self._heartbeat()
        return caught

    def _offered(self, labellings: Sequence[Bits]) -> Bits:
        """Of labellings that no mechanism ruled out, those (k, m) to be evaluated."""
        return np.concatenate([self._none, *(self._offer(labels) for labels in labellings)])

    def _offer(self, labels: Bits) -> Bits:
        """A labelling that no mechanism ruled out, (1, m), unless it has been evaluated before, (0, m)."""
        if self._formula is not None:
            self._formula.forbid(np.arange(len(labels)), labels)
        row = np.asarray(canonical(labels[None], self.space.group))
        self._passed.append(row[0])
        return self._none if self._is_evaluated(row[0]) else row

    def _told(self) -> Formula:
        """The formula, which knows all conflicts there are, and what was evaluated."""
        if self._formula is None:
            self._formula = Formula(self.space, self._blocks)
        self._formula.learn(self._conflicts[self._said[0] :], self._passed[self._said[1] :])
        self._said = len(self._conflicts), len(self._passed)
        return self._formula
