"""Routes to a raw solution, behind one interface and chosen by name. Nothing here is believed."""

from __future__ import annotations

from typing import Final

from jld_core.errors import InputError, RouteError
from jld_core.program.conic import ConicProgram, Structure
from jld_core.solvers.base import RawSolution, RawStatus, Route
from jld_core.solvers.clarabel import ClarabelRoute
from jld_core.solvers.highs import HighsRoute
from jld_core.solvers.schur.interior_point import SchurRoute

ROUTES = ("auto", "clarabel", "schur", "highs", "highs-ipm", "cvxpy")

LARGE: Final = {False: 2000, True: 600}
"""Equations from which `schur` is the faster and more exact one, linear programs and those with cones
(benchmarks/scale.py)."""


def make_route(
    name: str, threads: int = 1, tolerance: float | None = None, structure: Structure | None = None
) -> Route:
    """A fresh route by name: clarabel, schur (large assemblies), highs (dual simplex), highs-ipm, cvxpy (reference).

    auto (default) takes clarabel, or schur for programs from `LARGE` equations on. tolerance: residual asked of
    these two; None leaves it to the kind of program. structure: of the programs to come, for auto.

    Raises InputError for an unknown name.
    """
    if name == "auto":
        name = "schur" if structure is not None and is_large(structure) else "clarabel"
    if name == "schur":
        return SchurRoute(tolerance)
    if name == "clarabel":
        return ClarabelRoute(tolerance, threads=threads)
    if name in ("highs", "highs-ipm"):
        return HighsRoute(name, threads=threads)
    if name == "cvxpy":
        from jld_core.solvers.cvxpy import CvxpyRoute  # half a second that every other start would pay

        return CvxpyRoute()
    raise InputError("--solver", f"no solver is named {name!r}", "one of " + ", ".join(ROUTES))


def auxiliary(program: ConicProgram, gap: float = 1e-8) -> RawSolution:
    """A raw solution of a program that is not a labelling's own: by schur where it is large, else by clarabel.

    gap: relative duality gap that is enough, where schur is asked.
    """
    if is_large(program.structure):
        try:
            answer = SchurRoute(gap=gap).solve(program)
        except RouteError:
            return ClarabelRoute().solve(program)
        if answer.status is not RawStatus.FAILED:
            return answer
    return ClarabelRoute().solve(program)


def is_large(structure: Structure) -> bool:
    """Does a program of this structure go to `schur` by default?"""
    return structure.equalities >= LARGE[bool(structure.cones)]


__all__ = [
    "LARGE",
    "ROUTES",
    "ClarabelRoute",
    "HighsRoute",
    "RawSolution",
    "RawStatus",
    "Route",
    "SchurRoute",
    "auxiliary",
    "is_large",
    "make_route",
]
