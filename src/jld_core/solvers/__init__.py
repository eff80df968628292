"""Solvers of conic and linear programs behind one interface, chosen by name.

Every solution is a hint: bounds on λ are proven elsewhere, whatever a solver reports.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from jld_core.deadline import Deadline
from jld_core.errors import ParameterError, SolverError
from jld_core.lazy_exports import export_lazily
from jld_core.program import ConicProgram
from jld_core.program.template import Structure
from jld_core.solvers.base import RawSolution, RawStatus, Solver
from jld_core.solvers.clarabel import ClarabelSolver
from jld_core.solvers.highs import HighsSolver
from jld_core.solvers.schur import SchurSolver

if TYPE_CHECKING:
    from jld_core.solvers.highs import highs_ends, highs_of

SOLVERS = ("auto", "clarabel", "schur", "highs", "highs-ipm", "cvxpy")
"""Names that `make_solver` takes."""

# Number of equations from which `schur` is faster than Clarabel, without cones (False) and with cones (True); at 1 450
# twice as fast, with brackets of 2e-9 instead of 1e-10. Source: measured in benchmarks/large.py.
LARGE: Final = {False: 1400, True: 600}


def make_solver(
    name: str | Solver, threads: int = 1, tolerance: float | None = None, structure: Structure | None = None
) -> Solver:
    """Return the given solver, or make one by name.

    Parameters
    ----------
    name : str or Solver
        "clarabel", "schur" (large assemblies), "highs" (dual simplex), "highs-ipm", "cvxpy" (reference), or "auto":
        schur for structures from `LARGE` equations on, else clarabel. A `Solver` is returned as it is.
    threads : int
        Number of threads of clarabel and HiGHS.
    tolerance : float, optional
        Residual to reach, of clarabel and schur only; None: the precision of the kind of program.
    structure : Structure, optional
        Structure of the programs to come, for "auto"; None counts as small.

    Returns
    -------
    Solver
        The solver.

    Raises
    ------
    InputError
        No solver has this name, or its library is not installed.
    """
    if isinstance(name, Solver):
        return name
    require_solver(name)
    if name == "auto":
        name = "schur" if structure is not None and is_large(structure) else "clarabel"
    if name == "schur":
        return SchurSolver(tolerance)
    if name == "clarabel":
        return ClarabelSolver(tolerance, threads=threads)
    if name in ("highs", "highs-ipm"):
        return HighsSolver(name, threads=threads)
    from jld_core.solvers.cvxpy import CvxpySolver  # the import takes half a second, so only its users pay for it

    return CvxpySolver()


def require_solver(name: str) -> None:
    """Raise InputError for an unknown solver, or one whose library is not installed.

    Parameters
    ----------
    name : str
        Name to check against `SOLVERS`.

    Raises
    ------
    InputError
        `SOLVERS` does not contain the name, or CVXPY is asked for and not installed.
    """
    if name not in SOLVERS:
        raise ParameterError("solver", f"no solver is named {name!r}", "one of " + ", ".join(SOLVERS))
    if name not in installed_solvers():
        raise ParameterError("solver", f"{name} is not installed", "pip install 'jld[reference]'")


def installed_solvers() -> tuple[str, ...]:
    """Return the names of the solvers whose libraries are installed.

    Returns
    -------
    tuple of str
        `SOLVERS`, without "cvxpy" where that optional library is missing.
    """
    return tuple(name for name in SOLVERS if name != "cvxpy" or find_spec(name) is not None)


def solve_auxiliary(program: ConicProgram, gap: float = 1e-8, until: Deadline | None = None) -> RawSolution:
    """Solve a program other than that of a labelling: by schur if large, else clarabel.

    Clarabel also solves large programs on which schur fails.

    Parameters
    ----------
    program : ConicProgram
        Any program.
    gap : float
        Relative duality gap to reach, of schur only.
    until : Deadline, optional
        End, of schur only: DeadlinePassed is raised after it.

    Returns
    -------
    RawSolution
        Unverified solution.
    """
    if is_large(program.structure):
        try:
            answer = SchurSolver(gap=gap, until=until).solve(program)
        except SolverError:
            return ClarabelSolver().solve(program)
        if answer.status is not RawStatus.FAILED:
            return answer
    return ClarabelSolver().solve(program)


def is_large(structure: Structure) -> bool:
    """Return True if `auto` chooses `schur` for a structure.

    Parameters
    ----------
    structure : Structure
        Structure of a program.

    Returns
    -------
    bool
        True from `LARGE` equations on.
    """
    return structure.equalities >= LARGE[bool(structure.cones)]


__all__ = [
    "SOLVERS",
    "ClarabelSolver",
    "HighsSolver",
    "RawSolution",
    "RawStatus",
    "Solver",
    "highs_ends",
    "highs_of",
    "installed_solvers",
    "is_large",
    "make_solver",
    "require_solver",
    "solve_auxiliary",
]

export_lazily(__name__, {"highs": ["highs_of", "highs_ends"]})
