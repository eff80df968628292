"""jld as a solver of compas_dem (0.6), results as of its own solvers.

`problem.set_solver(jld_solver())` and `problem.solve()`, or `dem_solve(problem, model)`. Boundary conditions act
with the factor λ, a group whose name begins with "dead" with the factor 1; gravity acts on every block.
"""

from __future__ import annotations

import json
from functools import wraps
from importlib import import_module
from typing import Any, Final

from jld_core import InputError, Layout, Model, ParameterError, build_assembly, parse_scene
from jld_core.models import solve_rigid
from jld_formats.options import ImportOptions, Notes
from jld_formats.read_dem import data_of, model_and_problems, solids_of
from jld_formats.solids import spatial_scene
from jld_formats.write_dem import Dem

NAME: Final = "JLD"  # name of the solver in compas_dem


def solve_document(document: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Solve an `Analysis` of compas_dem in JSON; return its `Results` in JSON; options: as of `Model`."""
    notes = Notes()
    solids = solids_of(document, "analysis", notes)
    written = spatial_scene(solids, ImportOptions(), notes).document
    if "settlements" in written:
        raise InputError(
            "displacements", "limit analysis knows no prescribed movement", "loads alone, or jld settlement"
        )
    cases = written["loads"].pop("cases", [])
    written["loads"].setdefault("live", []).extend(
        entry for case in cases for entry in case["live"]
    )  # all act together
    scene = parse_scene(written, "the model")
    assembly = build_assembly(scene)
    labels = assembly.labels | True
    layout = Layout(scene, assembly, labels, solve_rigid(assembly, labels, Model(**options)))
    nodes = {part.name: part.group for part in solids.parts}
    results = Dem(layout, cells=True, nodes=nodes).results()
    model, problems = model_and_problems(document)
    results["data"]["model_id"] = str(model.get("guid", ""))
    stated = data_of(document).get("problems") or [{}]
    results["data"]["problem_id"] = str(stated[0].get("guid", "")) if problems else ""
    results["data"]["metadata"]["assumed"] = list(notes.assumed)
    return results


def dem_solve(problem: Any, model: Any = None, **options: Any) -> Any:
    """Solve a problem of compas_dem on a model, by default its own; return its `Results`; options: as of `Model`."""
    compas, models = _package("compas"), _package("compas_dem.models")
    analysis = models.Analysis(model or problem.model)
    analysis.problems = [problem]
    results = solve_document(json.loads(compas.json_dumps(analysis)), **options)
    return compas.json_loads(json.dumps(results))


def jld_solver(**options: Any) -> Any:
    """Return a `Solver` of compas_dem that lets `problem.solve()` call jld; options: as of `Model`."""
    Model(**options)  # refuses a wrong one now
    problem, solver = _package("compas_dem.problem").Problem, _package("compas_dem.problem").Solver()
    plain = problem.solve
    if not hasattr(plain, "without_jld"):  # compas_dem knows its solvers by name, and has no list to add one to

        @wraps(plain)
        def solve(self: Any, **runtime: Any) -> Any:
            own = self._solver
            if getattr(own, "name", None) != NAME:
                return plain(self, **runtime)
            self._check_model_validity(self.model)
            return dem_solve(self, self.model, **own.parameters, **runtime)

        solve.without_jld = plain  # type: ignore[attr-defined]
        problem.solve = solve
    solver.name, solver.parameters = NAME, options
    return solver


def _package(name: str) -> Any:
    """Import a module of compas or compas_dem; raise ParameterError that names the extra where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise ParameterError("solver", "compas_dem is not installed", "pip install 'jld[compas]'") from None
