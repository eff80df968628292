"""Every way from an assembly to λ that the benchmark of speed against error measures.

A route takes an assembly and returns λ, with a proven bracket or without one. To measure another, add it to
`SOLVERS`; solvers that `jld_core.solvers` comes to know by name are added by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy.sparse as sp

from benchmarks.stated import stated
from jld_core import Assembly, LimitAnalysis, Status
from jld_core.models.rigid_blocks import prove_condensed
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import SOLVERS as KNOWN
from jld_core.solvers import ClarabelSolver, Solver
from jld_explore.evaluation import EvaluatorSettings
from jld_explore.evaluation.evaluator import Evaluator


@dataclass(frozen=True)
class Found:
    """λ in scene units, and proven bounds on it, NaN where there are none. note: the steps taken."""

    load: float
    low: float = math.nan
    high: float = math.nan
    note: str = ""


@dataclass(frozen=True)
class Way:
    """One route: name, family (what it is drawn as), which assemblies it takes, and how it is run.

    easier: the name of a route that is faster on every scene; where that one does not finish, this is not tried.
    """

    name: str
    family: str
    takes: Callable[[Assembly], bool]
    run: Callable[[Assembly], Found]
    easier: str = ""


def any_scene(assembly: Assembly) -> bool:
    """Whatever it is."""
    return True


def planar(assembly: Assembly) -> bool:
    """Is its program linear?"""
    return assembly.dimension == 2


def spatial(assembly: Assembly) -> bool:
    """Has its program cones?"""
    return assembly.dimension == 3


def has_blocks(assembly: Assembly) -> bool:
    """Is anything glued, so that there is something to condense?"""
    return not bool(assembly.labels.all())


def default(assembly: Assembly) -> Found:
    """What is done unless something else is asked for; whether it stands at λ = 0 is another question."""
    found = Evaluator(assembly, EvaluatorSettings()).evaluate(assembly.labels)
    if found.status is Status.UNCERTIFIED and has_blocks(assembly):
        return condensed(assembly)
    return Found(found.load_factor, found.low, found.high, str(found.status))


def ours(
    assembly: Assembly,
    route: Solver | None = None,
    solver: str = "clarabel",
    gap: float = 1e-6,
    margin: float | None = None,
) -> Found:
    """Our path by another route, or with another width asked for; margin: see `Template.program`."""
    analysis = LimitAnalysis(assembly, solver=solver, gap=gap, margin=margin, reference=assembly.labels)
    if route is not None:
        analysis.first_solver = route
    found = analysis.solve(stands=False)
    return Found(found.load_factor, *found.bracket, " → ".join(found.solve_log))


def forced(assembly: Assembly, method: str) -> Found:
    """The default tolerance with one of Clarabel's factorisations."""
    residual = Template(assembly).precision.residual
    return ours(assembly, ClarabelSolver(residual, direct_solve_method=method))


def of_size(assembly: Assembly, size: float, gap: float, refine: bool = False) -> Found:
    """Tolerance and margin of one size, and a width to go with them."""
    return ours(assembly, ClarabelSolver(size, iterative_refinement_enable=refine), gap=gap, margin=size)


def condensed(assembly: Assembly) -> Found:
    """Rigid blocks, cracked on demand."""
    analysis = LimitAnalysis(assembly, reference=assembly.labels)
    found = prove_condensed(analysis, assembly.labels)
    if found is None:
        return Found(math.nan, note="the full model is the way to go")
    (low, high), scale = found.bracket, analysis.template.scaling.load
    return Found(found.load_factor * scale, low * scale, high * scale, " → ".join(found.solve_log))


def bare(assembly: Assembly) -> Found:
    """Clarabel as it comes on our scaled program, believed."""
    template = Template(assembly)
    answer = ClarabelSolver(1e-8, iterative_refinement_enable=True).solve(template.program(assembly.labels))
    return Found(float(answer.point[-1]) * template.scaling.load, note=answer.note)


def linearised(program: ConicProgram, facets: int, inside: bool) -> ConicProgram:
    """The program with every cone |V| ≤ t replaced by a regular polygon in it or around it.

    facets: ≥ 3 sides. Cones of three rows only (spatial faces without compressive strength).
    """
    s = program.structure
    # turned by a quarter of a side: with a corner or a side along the load one of the two would be exact by chance
    angles = 2.0 * np.pi * (np.arange(facets) + 0.25) / facets
    reach = math.cos(math.pi / facets) if inside else 1.0
    side = np.column_stack([np.full(facets, reach), -np.cos(angles), -np.sin(angles)])
    turn = sp.block_diag([sp.eye_array(s.equalities + s.linear), sp.kron(sp.eye_array(len(s.cones)), side)])
    rows = turn.tocsr() @ program.matrix
    linear = s.linear + facets * len(s.cones)
    return pack(rows, turn @ program.rhs, program.objective, s.equalities, linear, ())


def polygons(assembly: Assembly, facets: int, inside: bool) -> Found:
    """A linear program with polygons for cones, by Clarabel, which is quicker at these than HiGHS; believed."""
    template = Template(assembly)
    program = linearised(template.program(assembly.labels), facets, inside)
    answer = ClarabelSolver(1e-8).solve(program)
    return Found(float(answer.point[-1]) * template.scaling.load, note=answer.note)


def by_cvxpy(assembly: Assembly, solver: str) -> Found:
    """Stated in CVXPY as one would write it, at the solver's own tolerances."""
    return Found(stated(assembly, assembly.labels, solver))


def _named() -> list[Way]:
    """What `jld_core.solvers` knows beside Clarabel, each with bracket; HiGHS takes linear programs only.

    "auto" is the default's own choice.
    """
    return [
        Way(f"jld, {name}", "jld, other solver", planar if name.startswith("highs") else any_scene, _by_name(name))
        for name in KNOWN
        if name not in ("auto", "clarabel", "cvxpy")
    ]


def _by_name(name: str) -> Callable[[Assembly], Found]:
    return lambda assembly: ours(assembly, solver=name)


def _polygonal() -> list[Way]:
    ways = []
    for side, inside in (("inside", True), ("outside", False)):
        before = ""
        for facets in (4, 8, 16, 32):
            name = f"{facets} facets {side}"
            ways.append(Way(name, f"cones as polygons, {side}", spatial, _polygons(facets, inside), before))
            before = name
    return ways


def _polygons(facets: int, inside: bool) -> Callable[[Assembly], Found]:
    return lambda assembly: polygons(assembly, facets, inside)


DEFAULT: Final = "jld, default"
BRACKETED: Final = ("jld, default", "jld, Clarabel", "jld, other solver", "jld, condensed")
"""Families whose λ comes with proven bounds."""

SOLVERS: Final[tuple[Way, ...]] = (
    Way(DEFAULT, DEFAULT, any_scene, default),
    Way("jld, loose", "jld, Clarabel", any_scene, partial(of_size, size=1e-6, gap=1e-3)),
    Way("jld, tight", "jld, Clarabel", any_scene, partial(of_size, size=1e-12, gap=1e-9, refine=True)),
    Way("jld, qdldl", "jld, Clarabel", any_scene, partial(forced, method="qdldl")),
    Way("jld, faer", "jld, Clarabel", any_scene, partial(forced, method="faer")),
    *_named(),
    Way("jld, condensed", "jld, condensed", has_blocks, condensed),
    Way("Clarabel, bare", "Clarabel, bare", any_scene, bare),
    *(Way(f"CVXPY, {s}", "CVXPY", any_scene, partial(by_cvxpy, solver=s)) for s in ("CLARABEL", "ECOS", "SCS")),
    *(Way(f"CVXPY, {s}", "CVXPY", planar, partial(by_cvxpy, solver=s)) for s in ("HIGHS", "SCIPY", "OSQP")),
    *_polygonal(),
)
