"""Routes to a raw solution, behind one interface and chosen by name. Nothing here is believed.

- `LARGE`: equations from which `schur` is the faster one
- `SOLVERS`: names of solvers
- `ClarabelSolver`: interior point, updated in place; with a proximal term on request
- `HighsSolver`: simplex and interior point, linear programs
- `LinearAnswer`: what a linear solver says of one program, not believed
- `LinearRows`: a linear program that is minimised again and again
- `RawSolution`: a solver's answer, not believed
- `RawStatus`: what a solver says of it
- `SchurSolver`: our interior point for large assemblies
- `Solver`: one way to a raw solution
- `auxiliary`: solve a program that is not a labelling's own
- `highs_of`: HiGHS with a linear program, ready to run
- `interior_point`: a linear program by HiGHS' interior point
- `is_large`: whether a program goes to `schur` by default
- `make_solver`: a solver by its name
- `require_solver`: refuses a name that is none
"""

from __future__ import annotations

from typing import Final

from jld_core.errors import InputError, SolverError
from jld_core.program import ConicProgram, Structure
from jld_core.solvers.base import RawSolution, RawStatus, Solver
from jld_core.solvers.clarabel import ClarabelSolver
from jld_core.solvers.highs import HighsSolver, highs_of
from jld_core.solvers.linear import LinearAnswer, LinearRows, interior_point
from jld_core.solvers.schur import SchurSolver

SOLVERS = ("auto", "clarabel", "schur", "highs", "highs-ipm", "cvxpy")

LARGE: Final = {False: 2000, True: 600}
"""Equations from which `schur` is the faster and more exact one, linear programs and those with cones
(benchmarks/scale.py)."""


def make_solver(
    name: str | Solver, threads: int = 1, tolerance: float | None = None, structure: Structure | None = None
) -> Solver:
    """The route handed in, or a fresh one by name.

    Names: clarabel, schur (large assemblies), highs (dual simplex), highs-ipm, cvxpy (reference).

    auto (default) takes clarabel, or schur for programs from `LARGE` equations on. tolerance: residual asked of
    these two; None leaves it to the kind of program. structure: of the programs to come, for auto.

    Raises InputError for an unknown name.
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
    from jld_core.solvers.cvxpy import CvxpySolver  # half a second that every other start would pay

    return CvxpySolver()


def require_solver(name: str) -> None:
    """Raise InputError for a name that is none of `SOLVERS`."""
    if name not in SOLVERS:
        raise InputError("--solver", f"no solver is named {name!r}", "one of " + ", ".join(SOLVERS))


def auxiliary(program: ConicProgram, gap: float = 1e-8) -> RawSolution:
    """A raw solution of a program that is not a labelling's own: by schur where it is large, else by clarabel.

    gap: relative duality gap that is enough, where schur is asked.
    """
    if is_large(program.structure):
        try:
            answer = SchurSolver(gap=gap).solve(program)
        except SolverError:
            return ClarabelSolver().solve(program)
        if answer.status is not RawStatus.FAILED:
            return answer
    return ClarabelSolver().solve(program)


def is_large(structure: Structure) -> bool:
    """Does a program of this structure go to `schur` by default?"""
    return structure.equalities >= LARGE[bool(structure.cones)]


__all__ = [
    "LARGE",
    "SOLVERS",
    "ClarabelSolver",
    "HighsSolver",
    "LinearAnswer",
    "LinearRows",
    "RawSolution",
    "RawStatus",
    "SchurSolver",
    "Solver",
    "auxiliary",
    "highs_of",
    "interior_point",
    "is_large",
    "make_solver",
    "require_solver",
]
