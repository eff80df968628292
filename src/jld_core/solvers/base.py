"""Interface of all solvers; their solutions are hints, never results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from jld_core.arrays import Floats
from jld_core.program import ConicProgram
from jld_core.program.template import Structure

Suffices = Callable[[Floats, Floats], bool]  # test whether a point and multipliers suffice for the caller of a solver

# Relative duality gap from which a solver offers its iterates, a third of `tolerances.GAP`.
# Smaller values cost the iterations with the worst linear systems.
EARLY: Final = 3e-7


class RawStatus(StrEnum):
    """Status that a solver reports of its own solution, a hint that decides which method is tried next.

    NEARLY_INFEASIBLE: iterates tend to a proof that no point is admissible, short of its tolerance.
    """

    OPTIMAL = "optimal"
    ALMOST = "almost"
    INFEASIBLE = "infeasible"
    NEARLY_INFEASIBLE = "nearly infeasible"
    UNBOUNDED = "unbounded"
    LIMIT = "limit"
    FAILED = "failed"


@dataclass(frozen=True)
class RawSolution:
    """Unverified solution of the program: minimise q·y subject to M y + s = r, s in the cones.

    Attributes
    ----------
    status : RawStatus
        Status that the solver reports.
    point : (columns,) array
        Solution y; a ray if the program is unbounded. Its values may be arbitrarily wrong.
    dual : (rows,) array
        Multipliers w with q + Mᵀw = 0, w in the dual cones; an improving ray if the program is infeasible. Its values
        may be arbitrarily wrong.
    iterations : int
        Number of iterations.
    seconds : float
        Time, s.
    note : str
        The solver's own words on its status.
    """

    status: RawStatus
    point: Floats
    dual: Floats
    iterations: int
    seconds: float
    note: str = ""


class Solver(ABC):
    """Interface of a solver; derive from it to use a solver of your own.

    A solver may keep state between calls, but its solution depends only on the program given.

    Attributes
    ----------
    name : str
        Name in the log of a solve.
    """

    name: str

    @abstractmethod
    def solve(self, program: ConicProgram) -> RawSolution:
        """Solve a program.

        Parameters
        ----------
        program : ConicProgram
            Program to solve.

        Returns
        -------
        RawSolution
            Unverified solution.

        Raises
        ------
        SolverError
            The solver does not support this program.
        """

    def solve_until(self, program: ConicProgram, suffices: Suffices | None) -> RawSolution:
        """Solve a program, or stop at an iterate that suffices for the caller.

        Interior-point methods that can stop override this method; by default the program is solved to the end.

        Parameters
        ----------
        program : ConicProgram
            Program to solve.
        suffices : callable or None
            Takes a point and multipliers, as in `RawSolution`; returns True if they suffice. None: solve to the end.

        Returns
        -------
        RawSolution
            Unverified solution.

        Raises
        ------
        SolverError
            The solver does not support this program.
        """
        return self.solve(program)

    def require(self, structure: Structure) -> None:
        """Raise SolverError if the solver does not support programs of this structure; called before any work."""
        return

    def prepare(self, structure: Structure, reference: Callable[[], ConicProgram]) -> None:
        """Prepare for programs of a structure; called before each solve.

        The default does nothing.

        Parameters
        ----------
        structure : Structure
            Structure of the programs to come.
        reference : callable
            Returns the same program of that structure at every call, for a set-up that depends on numbers.
        """
        return
