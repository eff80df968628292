"""A driver: random layouts, each followed by those with one more run of faces dry, in the order of the faces."""

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from jld_explore import Driver, Evaluation, SearchSpace
from jld_explore.drivers import BufferedRandom, DriverOptions, Register, operators


class SweepOptions(DriverOptions):
    step: int = Field(1, ge=1, description="faces that become dry at once")


class Sweep(Driver):
    name = "sweep"
    Options = SweepOptions

    def __init__(self, space: SearchSpace, seed: int = 0, *, step: int = 1) -> None:
        super().__init__(space, seed)
        self.step, self.random = step, BufferedRandom(np.random.default_rng(seed))
        self.moves, self.register = operators(space), Register(space)

    def ask(self, limit: int | None = None) -> np.ndarray:
        faces = np.flatnonzero(self.space.candidates)
        for _ in range(50):
            rows = self.moves.draw(1, self.random)
            if not len(rows):
                continue
            for start in range(0, len(faces), self.step):
                rows = np.vstack([rows, rows[-1]])
                rows[-1, faces[start : start + self.step]] = True
            if len(new := self.register.admit(rows, limit)):
                return new
        return rows[:0]

    def tell(self, labellings: np.ndarray, evaluations: Sequence[Evaluation]) -> None:
        """Proposals do not depend on what was found."""
