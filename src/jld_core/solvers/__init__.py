"""Routes to a raw solution, behind one interface and chosen by name. Nothing here is believed."""

from __future__ import annotations

from jld_core.errors import InputError
from jld_core.solvers.clarabel_ import ClarabelRoute
from jld_core.solvers.highs_ import HighsRoute
from jld_core.solvers.status import RawSolution, RawStatus, Route

ROUTES = ("clarabel", "highs", "highs-ipm", "cvxpy")


def make_route(name: str, threads: int = 1, tolerance: float | None = None) -> Route:
    """A fresh route by name: clarabel (default), highs (dual simplex), highs-ipm, cvxpy (reference).

    tolerance: residual asked of clarabel; None leaves it to the kind of program.

    Raises InputError for an unknown name.
    """
    if name == "clarabel":
        return ClarabelRoute(tolerance, threads=threads)
    if name in ("highs", "highs-ipm"):
        return HighsRoute(name, threads=threads)
    if name == "cvxpy":
        from jld_core.solvers.cvxpy_ import CvxpyRoute  # half a second that every other start would pay

        return CvxpyRoute()
    raise InputError("--solver", f"no solver is named {name!r}", "one of " + ", ".join(ROUTES))


__all__ = [
    "ROUTES",
    "ClarabelRoute",
    "HighsRoute",
    "RawSolution",
    "RawStatus",
    "Route",
    "make_route",
]
