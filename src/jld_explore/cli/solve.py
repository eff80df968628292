"""Provide `jld solve`."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, cast

import numpy as np
import typer

from jld_core import plugins
from jld_core.build import build_robust
from jld_core.build.loads import settlements_of
from jld_core.errors import ParameterError, error_context
from jld_core.files import require_folder, write_text
from jld_core.limit.options import Model, Status
from jld_core.limit.result import LimitAnalysisResult, Result
from jld_core.mechanics import require_materials
from jld_core.models import cost_estimate, require_cracks, rigid, sensitivities, solve_rigid
from jld_core.models.case_analysis import solve_cracked, under
from jld_core.models.rigid_blocks import require_model
from jld_core.models.sensitivity import geometry_sensitivities
from jld_core.plugins import part
from jld_core.scene.cracks import FieldCracks
from jld_core.views import facts_of_result
from jld_core.views.facts import aligned
from jld_explore.cli.check import check_search, load, warn_of
from jld_explore.cli.ending import UNCERTIFIED
from jld_explore.cli.options import AsJson, Rank, Robust, Strict, asked, setting_options, with_options
from jld_explore.cli.streams import say, warn

if TYPE_CHECKING:
    from jld_core.arrays import Bits
    from jld_core.assembly import Assembly
    from jld_explore.cli.layout import LaidOut


_KINKS: Final = 40  # number of faces up to which `jld solve` looks for kinks of the derivatives by vertices
_UNASKED: Final = 128  # number of faces up to which `jld solve` computes rates that nobody asked for: .3 s


def with_rates(result: LimitAnalysisResult, *, asked: bool | None, vertices: bool) -> LimitAnalysisResult:
    """Add the derivatives of λ to `facts` of a result, by vertices too if asked.

    asked: compute rates by strengths and weight; None: where there are few faces.
    """
    start = time.process_time()
    faces = len(result.assembly.interfaces)
    with_strengths = faces <= _UNASKED if asked is None else asked
    rates = {name: rate.to_json() for name, rate in sensitivities(result).items()} if with_strengths else {}
    why = f"{faces} faces: ask for them with --sensitivities" if asked is None else "--no-sensitivities"
    facts: dict[str, Any] = {"sensitivities": rates} if with_strengths else {"sensitivities": {"not_computed": why}}
    if vertices:
        moves = geometry_sensitivities(result, one_sided=with_strengths and faces <= _KINKS)
        facts["geometry_sensitivities"] = None if moves is None else moves.to_json()
    seconds_of_rates = time.process_time() - start
    seconds = dict(result.seconds)
    seconds |= {"sensitivities": seconds_of_rates, "total": seconds.pop("total") + seconds_of_rates}
    return replace(result, facts=result.facts | facts, seconds=seconds)


def draw_rates(result: LimitAnalysisResult, out: Path) -> None:
    """Write `vertices.png`, the derivatives of λ by vertices, into a folder."""
    # Nothing is written for a result without them.
    rates = result.facts.get("geometry_sensitivities")
    if rates is None:
        return
    views = part("views")
    vertices, values = (np.array(rates[name], dtype=float) for name in ("vertices", "derivative"))
    figure = views.moved_joints.figure_of_vertex_rates(result.assembly, result.labels, vertices, values)
    views.figures.save_figure(figure, out / "vertices.png")


SolvedFile = Annotated[Path, typer.Argument(help="Scene file (JSON), or a folder of jld explore.", show_default=False)]
History = Annotated[
    Path | None, typer.Option(help="Without dilation: every step of the iteration as CSV, and a picture beside it.")
]
Geometric = Annotated[
    bool, typer.Option("--geometric", help="Also the thickness over the least one at which it stands (dead loads).")
]
ResultFolder = Annotated[Path | None, typer.Option("-o", "--out", help="Folder for result.json and pictures.")]
Sensitivities = Annotated[
    bool | None,
    typer.Option(
        "--sensitivities/--no-sensitivities",
        help="Rates of λ with strengths and weight; default: up to 128 faces.",
        show_default=False,
    ),
]


@with_options(setting_options(Model, group="Model"))
def solve(
    context: typer.Context,
    scene: SolvedFile,
    rank: Rank = None,
    history: History = None,
    out: ResultFolder = None,
    strict: Strict = False,
    robust: Robust = False,
    sensitivities: Sensitivities = None,
    geometric: Geometric = False,
    as_json: AsJson = False,
    **values: Any,
) -> None:
    """Compute the collapse load factor of one layout, with a two-sided bracket.

    Print status, λ, bracket and evidence. A folder's layout is solved by the model of its search, unless an option says
    otherwise. With --out also write result.json and pictures. The exit code is 4 if a bound is
    missing (uncertified).
    """
    if out is not None:
        require_folder(out)
    Model(**values)  # before any file is read
    of_scene = not (scene.is_dir() or rank is not None)
    laid = _laid_out(scene, rank, strict, of_scene)
    model = _model(laid.model, asked(context, values))
    assembly = build_robust(laid.scene) if robust and not laid.assembly.has_low_values else laid.assembly
    assembly = under(assembly, model)
    if "search" in laid.scene.model_fields_set:
        check_search(scene, laid.scene, laid.assembly)
    with error_context(scene):
        require_materials(assembly, laid.labels, ~laid.labels)
        settlements_of(laid.scene, assembly)
        require_model(assembly, model, laid.labels)
        require_cracks(assembly, model)
        by_fields = isinstance(assembly.cracks, FieldCracks)
        if robust and by_fields:
            raise ParameterError("robust", "by fields, strengths have one value", "cracks by faces or cells")
        elements, labels = rigid(assembly, laid.labels)
        if of_scene and not as_json:
            warn_of(scene, assembly)
        if not by_fields and (long := cost_estimate(elements).long) is not None and not as_json:
            warn(f"jld: {long}")
        if history is not None:
            _write_history(elements, labels, model, history, by_fields)
        begun = time.process_time()
        result: Result
        if by_fields:
            result = solve_cracked(assembly, labels, model)
        else:
            result = replace(solve_rigid(elements, labels, model), cracks=assembly.cracks)
        # with all processor time of this process since `begun`, when λ was begun, and before, s
        solving = time.process_time() - begun - result.seconds.get("assemble", 0.0)
        seconds = {"start": begun, **result.seconds, "solve": solving, "total": time.process_time()}
        result = replace(cast(Any, result), seconds=seconds)
    if isinstance(result, LimitAnalysisResult):
        result = _with_nominal(result) if elements.has_low_values else result
        result = with_rates(result, asked=sensitivities, vertices=as_json or out is not None)
    further_facts = _geometric(scene, laid, result, model, robust) if geometric else {}
    if out is not None:
        _write_result(result, out)
    say(json.dumps(result.to_json(), indent=1) if as_json else aligned(_facts(result) | further_facts))
    if result.status is Status.UNCERTIFIED:
        raise typer.Exit(UNCERTIFIED)


def _write_history(elements: Assembly, labels: Bits, model: Model, history: Path, by_fields: bool) -> None:
    if model.friction != "zero-dilation" or by_fields:
        problem = "only friction without dilation of whole faces iterates"
        raise ParameterError("history", problem, '`friction="zero-dilation"` with it')
    plugins.part("dilation_history")(elements, labels, model, history)


def _geometric(scene: Path, laid: LaidOut, result: Result, model: Model, robust: bool) -> dict[str, str]:
    if robust:
        raise ParameterError("robust", "thickness is scaled at one value of each strength", "`geometric` without it")
    with error_context(scene):
        safety = plugins.part("geometric_safety")(laid.scene, laid.labels, model)
    result.facts["geometric"] = safety.to_json()
    return {"geometric safety": str(safety)}


def _laid_out(path: Path, rank: int | None, strict: bool, of_scene: bool) -> LaidOut:
    """Return the layout that a scene states, or one of a folder of results."""
    from jld_explore.cli.layout import LaidOut, layout_of

    if not of_scene:
        return layout_of(path, rank)
    scene, assembly = load(path, strict)
    return LaidOut(scene, assembly, assembly.labels, Model())


def _model(model: Model, options: dict[str, Any]) -> Model:
    """Return a model with the options given; with associative friction those of a search without dilation go."""
    return replace(model.dilating if options.get("friction") == "associative" else model, **options)


def _facts(result: Result) -> dict[str, str]:
    if isinstance(result, LimitAnalysisResult):
        return facts_of_result(result)
    by_fields: Any = result
    facts: dict[str, str] = by_fields.facts_in_words()
    return facts


def _with_nominal(result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return the result with λ at the nominal values of materials besides."""
    nominal = solve_rigid(result.assembly.at_nominal, result.labels, result.model).load_factor
    return replace(result, facts={**result.facts, "load_factor_nominal": None if math.isnan(nominal) else nominal})


def _write_result(result: Result, out: Path) -> None:
    require_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "result.json", json.dumps(result.to_json(), indent=1))
    if not isinstance(result, LimitAnalysisResult):
        _draw_fields(result, out)
        return
    draw_rates(result, out)
    views = part("views")
    if any(case.place is not None for case in result.assembly.cases):
        path = views.moved_joints.figure_of_path(result.assembly, views.moved_joints.path_values(result))
        for ending in ("png", "svg"):
            views.figures.save_figure(path, out / f"path.{ending}")
    results = {"": result}
    if result.cases:  # of the positions of moving loads, the one that governs is drawn
        places = {case.name: case.place for case in result.assembly.cases}
        is_drawn = [places[name] is None or name == result.governing for name in result.cases]
        results = {f"-{k}": case_result for k, case_result in enumerate(result.cases.values(), 1) if is_drawn[k - 1]}
    for after, case_result in results.items():
        figure = views.figures.figure_of_result(case_result)
        for ending in ("png", "svg"):
            views.figures.save_figure(figure, out / f"result{after}.{ending}")


def _draw_fields(result: Any, out: Path) -> None:
    """Draw labels, stresses and cracks under each load case into a folder, as png and svg."""
    from jld_core.fields.bounds import FieldBounds

    views, several = part("views"), len(result.cases) > 1
    for k, (case, bounds) in enumerate(zip(result.assembly.by_case, result.cases.values(), strict=True), 1):
        if not isinstance(bounds, FieldBounds):
            continue  # fields in space have no picture
        figure = views.field_figures.figure_of_fields(case, result.labels, bounds)
        for ending in ("png", "svg"):
            views.figures.save_figure(figure, out / f"result{f'-{k}' if several else ''}.{ending}")
