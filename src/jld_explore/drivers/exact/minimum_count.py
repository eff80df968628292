"""Prove the best count among labellings that carry a required load factor.

The formula holds the labellings with a better count than the best known one that meets the requirement. Its
labellings are refuted by mechanisms that prove them too weak, or evaluated. A labelling that meets the requirement
improves the count, and the formula then aims at better counts still. A formula without a model proves that no
labelling with a better count carries the required load.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.errors import ParameterError
from jld_explore.drivers.base import Aim
from jld_explore.drivers.exact.conflict_driver import ConflictDriver
from jld_explore.drivers.exact.conflict_sources import ConflictSources
from jld_explore.drivers.exact.proof_check import Claim
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation
from jld_explore.evaluation.ranking import may_meet, meets
from jld_explore.space import SearchSpace, count_named, values_of
from jld_explore.space.measures import Range


class MinimumCount(ConflictDriver):
    """Driver that proves the best count where `search.require` asks for a load factor.

    Spaces without a formula, for example with a count that is no sum of ones, are enumerated, which proves the same.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    seed : int
        Seed of the random choices.
    aim : {"best", "front"}
        Must be "best".
    search : int
        Labellings evaluated before the proof, per face that can change.
    alone : int, optional
        See `Exact`.

    Raises
    ------
    InputError
        If the space requires no load factor, or `aim` is not "best".
    """

    def __init__(
        self, space: SearchSpace, seed: int = 0, aim: Aim = "best", *, search: int = 5, alone: int | None = None
    ) -> None:
        if space.search.require is None or aim != "best":
            raise ParameterError("aim", "a front is not what search.require asks for", "best")
        name, sense = space.search.front.axes[0]
        self._count, self._least = count_named(name), sense == "min"
        super().__init__(space, seed, self._count, alone=alone)
        self._threshold = space.search.require.threshold
        self._genetic = Genetic(space, seed)
        self._left = search * int(space.candidates.sum())
        self._searching = True
        self._known: dict[bytes, tuple[bool, bool, float]] = {}
        self._begun = self._done = False

    @property
    def finished(self) -> bool:
        """Whether the best count is proven and the proof passed its check."""
        return self._proof_check is not None and self._proof_check.passed

    @property
    def working(self) -> bool:
        """Whether the proof is neither done nor given up; see `Driver.working`."""
        if self._everything is not None:
            return self._everything.working
        return not self._done and not self._given_up

    @property
    def best(self) -> float | None:
        """Best count of a labelling that meets the requirement; None if none is known."""
        found = [count for met, _, count in self._known.values() if met]
        return (min(found) if self._least else max(found)) if found else None

    @property
    def _open(self) -> bool:
        """Whether a labelling of better count may meet the requirement but is not proven to."""
        best = self.best
        return any(
            may and not met and (best is None or (count < best if self._least else count > best))
            for met, may, count in self._known.values()
        )

    def ask(self, limit: int | None = None) -> Bits:
        """Return the next labellings (k, m) to evaluate; see `Driver.ask`."""
        if self._everything is not None:
            return self._everything.ask(limit)
        if self._sources is not None:
            self._sources.pump()
        if self._left > 0:
            found = self._genetic.ask(self._left if limit is None else min(limit, self._left))
            self._left = self._left - len(found) if len(found) else 0
            if len(found):
                return found
        self._searching = False
        while not len(self._waiting) and not self._done and not self._late and not self._given_up:
            if not self._begun:
                self._begin(self.sources)
            exhausted = self._generate(self.sources, self._threshold)
            self._waiting = self._to_evaluate()
            self._done = exhausted and not len(self._waiting)
        given = self._given(limit)
        if self._done and not len(given) and self._proof_check is None:
            problem = "a layout that counts better may carry enough" if self._open else ""
            # the evaluations prove that each labelling carries the required λ, but not how much more
            carries = self._carrying
            self._proof_check = self._check([Claim(self._better, self._threshold / self._scale)], problem, carries)
        return given

    def withdraw(self, reason: str) -> None:
        """Forget all conflicts and start the proof again; see `Driver.withdraw`."""
        super().withdraw(reason)
        self._begun = self._done = False

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m); see `Driver.tell`."""
        if self._everything is not None:
            self._everything.tell(labellings, evaluations)
            return
        if self._searching:
            self._genetic.tell(labellings, evaluations)
        before = self.best
        self._state.note_evaluated(labellings)
        self._learn(labellings, evaluations)
        if self.best != before and self._begun:
            if self._sources is not None:
                self._sources.end()
            self._begun = False

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Record for each labelling whether it meets, or may meet, the requirement, and its count."""
        count = values_of(self._count, self.space.assembly, labellings, self.space.graph)
        for labels, found, value in zip(labellings, evaluations, count.tolist(), strict=True):
            state = meets(self.space, found), may_meet(self.space, found), float(value)
            self._known[np.packbits(labels).tobytes()] = state

    @property
    def _carrying(self) -> tuple[Bits, Floats]:
        """Labellings (k, m) that meet the requirement, and λ (k,) that each is proven to carry."""
        packed = [np.frombuffer(key, dtype=np.uint8) for key, (met, _, _) in self._known.items() if met]
        faces = len(self.space.fixed)
        table = np.array(packed, dtype=np.uint8).reshape(len(packed), (faces + 7) // 8)
        rows = np.unpackbits(table, axis=1, count=faces)
        return rows.astype(bool), np.full(len(rows), self._threshold)

    def _begin(self, hunters: ConflictSources) -> None:
        """Aim the formula at all counts better than the best known."""
        better = self._better
        self._begun = True
        formula = self._told()
        formula.aim(self._threshold / self._scale, better)
        hunters.begin(formula, better, self._threshold / self._scale)

    @property
    def _better(self) -> Range | None:
        """Range of counts better than the best known; None for any count."""
        best = self.best
        if best is None or not math.isfinite(best):
            return None
        return Range.of((None, best - 1) if self._least else (best + 1, None), whole=True)
