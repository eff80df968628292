"""Define the command line with `jld check`, `solve`, `explore` and `studio`.

Other modules of this sub-package add the other commands.
"""

from __future__ import annotations

import json
import math
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from jld_core._version import __version__
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch.library import described as kernel_in_use
from jld_core.build import build_assembly, build_robust
from jld_core.build.settlements import settlements_of
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.limit import (
    FLOOR_SECONDS,
    LimitAnalysisResult,
    SolveOptions,
    Status,
)
from jld_core.mechanics import require_materials
from jld_core.models import cost_estimate, require_memory, require_model
from jld_core.models import solve as solve_assembly
from jld_core.models.by_fields import FIELD_SECONDS, require_cracks
from jld_core.scene import Scene, load_scene
from jld_core.scene.cracks import FieldCracks
from jld_core.tolerances import GAP
from jld_explore import Exploration, explore
from jld_explore.cli import exchange, overview, plot, samples
from jld_explore.cli.assembly import assembly as laying
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
from jld_explore.cli.driver_options import with_driver_options
from jld_explore.cli.ending import UNCERTIFIED, raise_on_signals, run
from jld_explore.cli.experiment import experiment
from jld_explore.cli.layout import layout_of
from jld_explore.cli.model_options import (
    Bending,
    Blocks,
    Contact,
    EffectiveArea,
    First,
    Gap,
    Robust,
    Strict,
    current_bending,
)
from jld_explore.cli.moving import draw_rates, move, require_movable, with_rates
from jld_explore.cli.options import AsJson, Rank, SceneFile, refuse_itself
from jld_explore.cli.progress import ProgressBar
from jld_explore.cli.search_options import (
    Budget,
    CertificateFile,
    Certificates,
    CheckFields,
    Cluster,
    DriverName,
    ExperimentOf,
    Jobs,
    Objective,
    OutFolder,
    Resume,
    Seconds,
    Seed,
)
from jld_explore.cli.settlement import settlement
from jld_explore.cli.solve_options import FloorSeconds, FrictionModel, ResultFolder, SolutionRange, SolvedFile
from jld_explore.cli.streams import say, warn
from jld_explore.cli.verifying import verify_command
from jld_explore.report import check_folder, words, write_text
from jld_explore.report.folder import check_writable
from jld_explore.settings import (
    BudgetSettings,
    ExploreSettings,
    ModelSettings,
    OutputSettings,
    ParallelSettings,
    SearchMethod,
)
from jld_explore.space import SearchSpace, search_space
from jld_explore.study_state import Interrupted

_JOBS = 16  # Largest number of worker processes per core.


class _Group(TyperGroup):
    """Command group whose help text needs no import of the commands."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the overview as help text."""
        formatter.write(overview.text())


app = typer.Typer(
    cls=_Group,
    name="jld",
    help="Joint Layout Design: find the strongest way to cut a structure into dry-jointed blocks, with proof.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

app.add_typer(samples.commands(), name="new")
exchange.add_to(app)
plot.add_to(app)
app.command()(experiment)
app.command(name="assembly")(laying)
app.command(name="settlement")(settlement)
app.command()(move)
app.command(name="verify")(verify_command)


def _load(path: Path, strict: bool = False) -> tuple[Scene, Assembly]:
    """Return a scene and its assembly; raise InputError if it cannot be analysed."""
    scene = load_scene(path)
    with error_context(path):
        assembly = build_assembly(scene)
        require_memory(assembly)
    if assembly.warnings and strict:
        more = f" (and {len(assembly.warnings) - 1} more)" if len(assembly.warnings) > 1 else ""
        raise InputError(str(path), assembly.warnings[0] + more, "a scene without warnings, or no --strict")
    return scene, assembly


def _warn_of(path: Path, assembly: Assembly) -> None:
    """Write warnings of an assembly to stderr, after all checks that may refuse it."""
    for warning in assembly.warnings:
        warn(f"jld: warning: {path}: {warning}")


def _check_search(path: Path, scene: Scene, assembly: Assembly) -> SearchSpace:
    """Return the search space; if the scene asks for a search, check it as `jld explore` does."""
    asked = "search" in scene.model_fields_set
    with error_context(path):
        return search_space(scene, assembly, allow_empty=not asked, need_materials=asked)


@app.command()
def check(scene: SceneFile, strict: Strict = False) -> None:
    """Parse a scene, find its interfaces, and print what will be modelled."""
    parsed, assembly = _load(scene, strict)
    space = _check_search(scene, parsed, assembly)
    with error_context(scene):
        require_materials(assembly, assembly.labels, ~assembly.labels)
        settlements_of(parsed, assembly)
        require_cracks(parsed, assembly)
        of_cells(parsed, assembly, assembly.labels)
        require_movable(parsed, assembly)
    _warn_of(scene, assembly)
    say(words.assembly(parsed, assembly, space))


@app.command()
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
    """Collapse load factor of the scene's own labelling, with a two-sided bracket."""
    if out is not None:
        check_writable(out)
    options = SolveOptions(
        friction=friction,
        range=range_,
        floor_seconds=floor_seconds,
        effective_area=effective_area,
        contact=contact,
        inner_bending=current_bending(inner_bending),
        condense=condense,
        solver=solver,
        gap=gap,
    )
    own = not (scene.is_dir() or rank is not None)
    given = _own_labelling(scene, strict) if own else layout_of(scene, rank)
    parsed, assembly, labels = _checked(scene, given, options, cracks, robust=robust)
    if own and not as_json:
        _warn_of(scene, assembly)
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
    result = named(parsed, with_rates(result))
    if out is not None:
        _write_result(result, out)
    say(json.dumps(result.to_json(), indent=1) if as_json else result_in_words(parsed, result))
    if result.status is Status.UNCERTIFIED:
        raise typer.Exit(UNCERTIFIED)


def _own_labelling(path: Path, strict: bool) -> tuple[Scene, Assembly, Bits]:
    """Return a scene, its assembly and its own labelling."""
    scene, assembly = _load(path, strict)
    return scene, assembly, assembly.labels


def _checked(
    path: Path,
    given: tuple[Scene, Assembly, Bits],
    options: SolveOptions,
    cracks: str | None,
    *,
    robust: bool,
) -> tuple[Scene, Assembly, Bits]:
    """Return scene, assembly and labels as they are solved; raise InputError where the options do not fit them."""
    scene, assembly, labels = given
    if "search" in scene.model_fields_set:
        _check_search(path, scene, assembly)
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
    check_writable(out)
    from jld_core.views import figures  # importing matplotlib takes longer than most solves

    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "result.json", json.dumps(result.to_json(), indent=1))
    draw_rates(result, out)
    drawn = {"": result} if not result.cases else {f"-{k}": one for k, one in enumerate(result.cases.values(), 1)}
    for after, one in drawn.items():
        figure = figures.figure_of_result(one)
        for ending in ("png", "svg"):
            figures.save_figure(figure, out / f"result{after}.{ending}")


@app.command(name="explore")
@with_driver_options
def explore_command(
    context: typer.Context,
    scene: SceneFile,
    out: OutFolder,
    driver: DriverName = None,
    objective: Objective = "associative",
    experiment_of: ExperimentOf = None,
    check_fields: CheckFields = 10,
    budget: Budget = None,
    seconds: Seconds = None,
    jobs: Jobs = None,
    seed: Seed = 0,
    strict: Strict = False,
    robust: Robust = False,
    cracks: Cracks = None,
    effective_area: EffectiveArea = False,
    contact: Contact = "convex",
    inner_bending: Bending = "uncoupled",
    condense: Blocks = "auto",
    solver: First = "auto",
    gap: Gap = GAP,
    resume: Resume = False,
    certificates: Certificates = False,
    cluster: Cluster = None,
    certificate: CertificateFile = None,
    as_json: AsJson = False,
    **own: Any,
) -> None:
    """Search the labellings of a scene for the strongest: ranked table, front, pictures."""
    parsed = with_cracks(load_scene(scene), cracks)
    if certificates:
        warn("jld: --certificates has no effect and will be refused in version 0.4; leave it out")
    check_folder(out, resume)
    if certificate is not None:
        refuse_itself(scene, certificate)
    _check_jobs(jobs)
    raise_on_signals()
    model = SolveOptions(
        effective_area=effective_area,
        contact=contact,
        inner_bending=current_bending(inner_bending),
        condense=condense,
        solver=solver,
        gap=gap,
    )
    settings = ExploreSettings.of(
        ModelSettings(model, robust=robust, experiment=experiment_of, check_fields=check_fields).maximising(objective),
        BudgetSettings(budget, seconds),
        ParallelSettings(jobs or os.cpu_count() or 1, cluster),
        SearchMethod(driver, own, seed),
        OutputSettings(resume, certificate=certificate, strict=strict),
    )
    announce = None if as_json else say
    try:
        with ProgressBar(parsed.name) as bar, error_context(scene, str(out)):
            done = explore(parsed, out, settings, bar, announce, started=context.obj)
    except Interrupted as stop:
        if stop.done is not None:
            _say_found(stop.done, as_json)
        raise
    _say_found(done, as_json)


def _check_jobs(jobs: int | None) -> None:
    """Raise InputError for more worker processes than the machine can serve."""
    most = _JOBS * (os.cpu_count() or 1)
    if jobs is not None and jobs > most:
        raise ParameterError("jobs", f"{jobs} processes would starve one another", f"at most {most} on this machine")


def _say_found(done: Exploration, as_json: bool) -> None:
    """Print the results of a search."""
    say(json.dumps(done.summary.to_json(), indent=1) if as_json else words.exploration(done))


@app.command()
def studio(
    source: Annotated[
        Path | None,
        typer.Argument(help="A scene file, or a folder written by jld explore; default: a wall to begin with."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on this machine; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
) -> None:
    """Move joints by hand and see the proven collapse load follow: a page on this machine, for you alone."""
    from jld_explore.studio import open_studio

    open_studio(source, port, say, browser)


def _version(wanted: bool) -> None:
    """Print the version and exit if the option is given."""
    if wanted:
        say(f"jld {__version__}, {kernel_in_use()}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def main(started: float | None = None) -> None:
    """Run the command line; every error ends in one line and an exit code.

    `started` is the start of the process on the clock `time.perf_counter`, s, from which time limits count.
    """
    run(app, time.perf_counter() if started is None else started)


if __name__ == "__main__":
    main()
