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
from jld_explore.drivers.exact.cube_workers import ConflictSources
from jld_explore.drivers.exact.driver import ConflictDriver
from jld_explore.drivers.exact.proof_check import Claim
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation
from jld_explore.evaluation.ranking import may_meet_requirement, meets_requirement
from jld_explore.space import SearchSpace, count_named, values_of
from jld_explore.space.limits import Range


class MinimumCount(ConflictDriver):
    """Driver that proves the best count where `search.require` asks for a load factor.

    Spaces without a formula, for example with a count that is no sum of ones, are enumerated, which proves the same.

    aim: must be "best". search: labellings evaluated before the proof, per face that can change. Raises InputError if
    the space requires no load factor, or `aim` is not "best".
    """

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
        self._genetic = Genetic(space, seed)
        self._labellings_to_search = search * int(space.candidates.sum())
        self._genetic_turn = True
        self._evaluated: dict[bytes, tuple[bool, bool, float]] = {}
        self._target_begun = self._done = False

    @property
    def finished(self) -> bool:
        """True if the best count is proven and the proof passed its check."""
        return self._proof_check is not None and self._proof_check.passed

    @property
    def working(self) -> bool:
        """True if the proof is neither done nor given up."""
        if self._enumeration is not None:
            return self._enumeration.working
        return not self._done and not self._given_up

    @property
    def best(self) -> float | None:
        """Best count of a labelling that meets the requirement; None if none is known."""
        found = [count for met, _, count in self._evaluated.values() if met]
        return (min(found) if self._minimize else max(found)) if found else None

    @property
    def _open_labelling_left(self) -> bool:
        """True if a labelling of better count may meet the requirement but is not proven to."""
        best = self.best
        return any(
            may and not met and (best is None or (count < best if self._minimize else count > best))
            for met, may, count in self._evaluated.values()
        )

    def ask(self, limit: int | None = None) -> Bits:
        """Return the next labellings (k, m) to evaluate."""
        # In this order: labellings of the genetic driver, those that no conflict refutes at the required λ, and, once
        # none is left, the check of the proof, after which a proof that it corrected goes on.
        if self._enumeration is not None:
            return self._enumeration.ask(limit)
        if self._sources is not None:
            self._sources.exchange()
        if self._labellings_to_search > 0:
            found = self._genetic.ask(
                self._labellings_to_search if limit is None else min(limit, self._labellings_to_search)
            )
            self._labellings_to_search = self._labellings_to_search - len(found) if len(found) else 0
            if len(found):
                return found
        self._genetic_turn = False
        while not len(self._waiting) and not self._done and not self._time_is_up and not self._given_up:
            if not self._target_begun:
                self._begin_step(self.sources)
            exhausted = self._generate(self.sources, self._threshold)
            self._waiting = self._labellings_to_evaluate()
            self._done = exhausted and not len(self._waiting)
        given = self._take_waiting(limit)
        if self._done and not len(given) and self._proof_check is None:
            problem = "a layout that counts better may carry enough" if self._open_labelling_left else ""
            # the evaluations prove that each labelling carries the required λ, but not how much more
            carries = self._carrying_labellings
            check = self._check_proof([Claim(self._better, self._threshold / self._scale)], problem, carries)
            if self._take_up(check):
                self._target_begun = self._done = False
                return self.ask(limit)
            self._proof_check = check
        return given

    def withdraw(self, reason: str) -> None:
        """Forget all conflicts and start the proof again."""
        super().withdraw(reason)
        self._target_begun = self._done = False

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m)."""
        if self._enumeration is not None:
            self._enumeration.tell(labellings, evaluations)
            return
        if self._genetic_turn:
            self._genetic.tell(labellings, evaluations)
        before = self.best
        self._state.note_evaluated(labellings)
        self._learn(labellings, evaluations)
        if self.best != before and self._target_begun:
            if self._sources is not None:
                self._sources.end()
            self._target_begun = False

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Record for each labelling whether it meets, or may meet, the requirement, and its count."""
        count = values_of(self._count, self.space.assembly, labellings, self.space.graph)
        for labels, found, value in zip(labellings, evaluations, count.tolist(), strict=True):
            state = meets_requirement(self.space, found), may_meet_requirement(self.space, found), float(value)
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
