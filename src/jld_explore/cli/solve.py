"""Define `jld solve`."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import typer

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_robust
from jld_core.build.settlements import settlements_of
from jld_core.errors import error_context
from jld_core.files import require_folder, write_text
from jld_core.limit import FLOOR_SECONDS, LimitAnalysisResult, SolveOptions, Status
from jld_core.mechanics import require_materials
from jld_core.models import cost_estimate, require_model
from jld_core.models import solve as solve_assembly
from jld_core.models.crack_models import FIELD_SECONDS
from jld_core.scene import Scene
from jld_core.scene.cracks import FieldCracks
from jld_core.tolerances import GAP
from jld_explore.cli.check import check_search, load, warn_of
from jld_explore.cli.cracks import (
    Cracks,
    FieldSeconds,
    check_cracks,
    named,
    of_cells,
    result_in_words,
    say_by_fields,
    with_cracks,
)
from jld_explore.cli.ending import UNCERTIFIED
from jld_explore.cli.model_options import (
    Bending,
    Blocks,
    Contact,
    EffectiveArea,
    First,
    Gap,
    Robust,
    Strict,
)
from jld_explore.cli.options import AsJson, Rank
from jld_explore.cli.rates import draw_rates, with_rates
from jld_explore.cli.solve_options import FloorSeconds, FrictionModel, ResultFolder, SolutionRange, SolvedFile
from jld_explore.cli.streams import say, warn


def solve(
    scene: SolvedFile,
    rank: Rank = None,
    friction: FrictionModel = "associative",
    range_: SolutionRange = False,
    floor_seconds: FloorSeconds = FLOOR_SECONDS,
    effective_area: EffectiveArea = False,
    contact: Contact = "convex",
    inner_bending: Bending = "uncoupled",
    condense: Blocks = "auto",
    solver: First = "auto",
    gap: Gap = GAP,
    out: ResultFolder = None,
    strict: Strict = False,
    robust: Robust = False,
    cracks: Cracks = None,
    field_seconds: FieldSeconds = FIELD_SECONDS,
    as_json: AsJson = False,
) -> None:
    """Compute the collapse load factor of one layout, with a two-sided bracket.

    Print status, λ, bracket and evidence. With --out also write result.json and pictures. The exit code is 4 if the
    bracket stays too wide (uncertified).
    """
    if out is not None:
        require_folder(out)
    options = SolveOptions(
        friction=friction,
        range=range_,
        floor_seconds=floor_seconds,
        effective_area=effective_area,
        contact=contact,
        inner_bending=inner_bending,
        condense=condense,
        solver=solver,
        gap=gap,
    )
    own = not (scene.is_dir() or rank is not None)
    given = _own_labelling(scene, strict) if own else _layout_of(scene, rank)
    parsed, assembly, labels = _checked(scene, given, options, cracks, robust=robust)
    if own and not as_json:
        warn_of(scene, assembly)
    if isinstance(parsed.cracks, FieldCracks):
        with error_context(scene):
            say_by_fields(parsed, assembly, labels, field_seconds, out, as_json)
        return
    if (long := cost_estimate(assembly).long) is not None and not as_json:
        warn(f"jld: {long}")
    with error_context(scene):
        result = solve_assembly(assembly, labels, **vars(options))
    if robust:
        result = _with_nominal(assembly, result)
    result = named(parsed, with_rates(result, vertices=as_json or out is not None))
    if out is not None:
        _write_result(result, out)
    say(json.dumps(result.to_json(), indent=1) if as_json else result_in_words(parsed, result))
    if result.status is Status.UNCERTIFIED:
        raise typer.Exit(UNCERTIFIED)


def _own_labelling(path: Path, strict: bool) -> tuple[Scene, Assembly, Bits]:
    """Return the scene, the assembly and the labelling (m,) that a scene file states."""
    scene, assembly = load(path, strict)
    return scene, assembly, assembly.labels


def _layout_of(folder: Path, rank: int | None) -> tuple[Scene, Assembly, Bits]:
    """Return a scene, its assembly and a labelling of a results folder."""
    from jld_explore.cli.layout import layout_of  # reading a folder needs pandas, a scene does not

    return layout_of(folder, rank)


def _checked(
    path: Path,
    given: tuple[Scene, Assembly, Bits],
    options: SolveOptions,
    cracks: str | None,
    *,
    robust: bool,
) -> tuple[Scene, Assembly, Bits]:
    """Check that a layout can be solved under the options; return it as it is solved.

    given: scene, assembly and labels (m,) of the layout; the result has the same form. Raises InputError for options
    that do not fit.
    """
    scene, assembly, labels = given
    if "search" in scene.model_fields_set:
        check_search(path, scene, assembly)
    if robust:
        assembly = build_robust(scene)
    scene = with_cracks(scene, cracks)
    with error_context(path):
        require_materials(assembly, labels, ~labels)
        settlements_of(scene, assembly)
        require_model(assembly, options, labels)
        check_cracks(scene, assembly, cracks, options, robust)
        if not isinstance(scene.cracks, FieldCracks):
            assembly, labels = of_cells(scene, assembly, labels)
    return scene, assembly, labels


def _with_nominal(assembly: Assembly, result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return the result with λ at the nominal values of materials besides."""
    nominal = solve_assembly(assembly.at_nominal, result.labels, **vars(result.model)).load_factor
    return replace(result, facts={**result.facts, "load_factor_nominal": None if math.isnan(nominal) else nominal})


def _write_result(result: LimitAnalysisResult, out: Path) -> None:
    """Write result.json and pictures into a folder."""
    require_folder(out)
    from jld_core.views import figures  # importing matplotlib takes longer than most solves

    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "result.json", json.dumps(result.to_json(), indent=1))
    draw_rates(result, out)
    if any(case.place is not None for case in result.assembly.cases):
        from jld_core.views.path import figure_of_path, path_values

        path = figure_of_path(result.assembly, path_values(result))
        for ending in ("png", "svg"):
            figures.save_figure(path, out / f"path.{ending}")
    drawn = {"": result}
    if result.cases:  # of the positions of moving loads, the one that governs is drawn
        places = {case.name: case.place for case in result.assembly.cases}
        shown = [places[name] is None or name == result.governing for name in result.cases]
        drawn = {f"-{k}": one for k, one in enumerate(result.cases.values(), 1) if shown[k - 1]}
    for after, one in drawn.items():
        figure = figures.figure_of_result(one)
        for ending in ("png", "svg"):
            figures.save_figure(figure, out / f"result{after}.{ending}")
