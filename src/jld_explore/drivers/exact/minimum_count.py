"""Prove the best count among labellings that carry a required load factor."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.errors import ParameterError
from jld_explore.drivers.base import Aim
from jld_explore.drivers.exact.context import Heuristics
from jld_explore.drivers.exact.cube_workers import ConflictSources
from jld_explore.drivers.exact.driver import ConflictDriver
from jld_explore.drivers.exact.proof_check import Claim, ProofCheck
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation
from jld_explore.evaluation.ranking import may_meet_requirement, meets_requirement
from jld_explore.space import SearchSpace, count_named, values_of
from jld_explore.space.limits import Range


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

    def _search(self) -> Iterator[Bits]:
        """Yield labellings (k, m) of the genetic driver, then those that no conflict refutes at the required λ."""
        yield from self._heuristics.run()
        self._heuristics.ended = True
        while not self._done:
            if not self._target_begun:
                self._begin_step(self.sources)
            exhausted = self._generate(self.sources, self._threshold)
            found = self._labellings_to_evaluate()
            self._done = exhausted and not len(found)
            yield found

    def _checked(self) -> ProofCheck:
        """Check the claim that no labelling of better count carries the required λ."""
        problem = "a layout that counts better may carry enough" if self._open_labelling_left else ""
        # the evaluations prove that each labelling carries the required λ, but not how much more
        claims = [Claim(self._better, self._threshold / self._scale)]
        return self._check_proof(claims, problem, self._carrying_labellings)

    def _note_check(self, check: ProofCheck, *, goes_on: bool) -> None:
        """Begin again with the best count where the proof goes on."""
        if goes_on:
            self._target_begun = self._done = False

    def _restart(self) -> None:
        """Forget all conflicts and start the proof again."""
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
