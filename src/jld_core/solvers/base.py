"""The one shape in which every solver answers; its status is a hint, never a result."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from jld_core.arrays import Floats
from jld_core.program import ConicProgram, Structure


class RawStatus(StrEnum):
    """What a solver says of its own answer; a hint for the order of proofs, never a result."""

    OPTIMAL = "optimal"
    ALMOST = "almost"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    LIMIT = "limit"
    FAILED = "failed"


@dataclass(frozen=True)
class RawSolution:
    """A route's answer to min q·y, M y + s = r.

    point: (columns,) y, or a ray of it where the program is unbounded. dual: (rows,) multipliers w with
    q + Mᵀw = 0, w in the dual cones, or an improving ray where it is infeasible. Both may be anything.
    """

    status: RawStatus
    point: Floats
    dual: Floats
    iterations: int
    seconds: float
    note: str = ""


class Solver(ABC):
    """One way to a raw solution; derive from it to hand in a way of your own.

    It may keep state between calls, but its answer depends on its argument alone. name: as shown in routes.
    """

    name: str

    @abstractmethod
    def solve(self, program: ConicProgram) -> RawSolution:
        """Solve; SolverError where this route does not take such a program."""

    def require(self, structure: Structure) -> None:
        """Raise SolverError where this route takes no programs of a structure: asked before anything is begun."""
        return

    def prepare(self, structure: Structure, reference: Callable[[], ConicProgram]) -> None:
        """Make ready for programs of a structure; called before each.

        reference: makes a program of that structure which is always the same one, for a set-up that looks at
        numbers. Most routes have nothing to do here.
        """
        return
