"""Define the command line with `jld check`, `solve`, `explore` and `studio`.

Other modules of this sub-package add the other commands.
"""

from __future__ import annotations

import inspect
import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_type_hints

import typer
from typer.core import TyperGroup

from jld_core._version import __version__
from jld_core.assembly import Assembly
from jld_core.batch.library import described as kernel_in_use
from jld_core.build import build_assembly, build_robust
from jld_core.build.settlements import settlements_of
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.limit import (
    FLOOR_SECONDS,
    RENAMED_BENDING,
    Condense,
    Contacts,
    Friction,
    LimitAnalysisResult,
    SolveOptions,
    Status,
)
from jld_core.mechanics import InnerBending, require_materials
from jld_core.models import cost_estimate, require_memory, require_model, sensitivities
from jld_core.models import solve as solve_assembly
from jld_core.models.by_fields import FIELD_SECONDS, require_cracks
from jld_core.scene import Scene, load_scene
from jld_core.scene.cracks import FieldCracks
from jld_core.solvers import SOLVERS
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
from jld_explore.cli.ending import UNCERTIFIED, raise_on_signals, run
from jld_explore.cli.experiment import experiment
from jld_explore.cli.layout import layout_of
from jld_explore.cli.options import AsJson, Rank, SceneFile, refuse_itself
from jld_explore.cli.progress import ProgressBar
from jld_explore.cli.settlement import settlement
from jld_explore.cli.streams import say, warn
from jld_explore.cli.verifying import verify_command
from jld_explore.drivers import DRIVERS
from jld_explore.drivers.registry import owners
from jld_explore.report import check_folder, words, write_text
from jld_explore.report.folder import check_writable
from jld_explore.settings import (
    BudgetSettings,
    ExploreSettings,
    ModelSettings,
    ObjectiveName,
    OutputSettings,
    ParallelSettings,
    SearchMethod,
)
from jld_explore.space import SearchSpace, search_space
from jld_explore.study import Interrupted

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
app.command(name="verify")(verify_command)

EffectiveArea = Annotated[
    bool, typer.Option("--effective-area", help="Torsion about the area really pressed (spatial).")
]
Contact = Annotated[
    Contacts, typer.Option(help="Resultants at centres of pressure, or points at the corners of dry faces.")
]
Bending = Annotated[
    Literal["uncoupled", "kern", "paper"],
    typer.Option(
        help="Bending of spatial inner faces: uncoupled, or by elastic edge stress; paper is uncoupled by its old name."
    ),
]
Blocks = Annotated[
    Condense, typer.Option(help="Rigid blocks, cracked on demand; auto: where inner faces are very strong.")
]
First = Annotated[
    str,
    typer.Option(help="Solver asked first: " + ", ".join(SOLVERS) + "; where it proves nothing, others follow."),
]
Gap = Annotated[float, typer.Option(help="Relative width of the bracket above which λ is uncertified.")]
Strict = Annotated[bool, typer.Option("--strict", help="Take what is possible but hardly meant as an error.")]
Robust = Annotated[
    bool, typer.Option("--robust", help="λ at the low values of materials, and at the nominal ones besides.")
]


def _current_bending(given: str) -> InnerBending:
    """Return the value of --inner-bending by its present name; warn about a name of version 0.2."""
    if given not in RENAMED_BENDING:
        return cast(InnerBending, given)
    warn(f"jld: warning: --inner-bending {given} is now {RENAMED_BENDING[given]}; the old name works until version 0.4")
    return RENAMED_BENDING[given]


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
    _warn_of(scene, assembly)
    say(words.assembly(parsed, assembly, space))


@app.command()
def solve(
    scene: Annotated[Path, typer.Argument(help="Scene file (JSON), or a folder of jld explore.", show_default=False)],
    rank: Rank = None,
    friction: Annotated[Friction, typer.Option(help="Associative, or sliding without dilation.")] = "associative",
    range_: Annotated[
        bool, typer.Option("--range", help="Zero dilation: the lowest and the highest λ, sought from every side.")
    ] = False,
    floor_seconds: Annotated[
        float, typer.Option(help="With --range: processor time for the bound below the lowest λ, 0 for none.")
    ] = FLOOR_SECONDS,
    effective_area: EffectiveArea = False,
    contact: Contact = "convex",
    inner_bending: Bending = "uncoupled",
    condense: Blocks = "auto",
    solver: First = "auto",
    gap: Gap = GAP,
    out: Annotated[Path | None, typer.Option(help="Folder for result.json and pictures.")] = None,
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
        inner_bending=_current_bending(inner_bending),
        condense=condense,
        solver=solver,
        gap=gap,
    )
    own = not (scene.is_dir() or rank is not None)
    if own:
        parsed, assembly = _load(scene, strict)
        labels = assembly.labels
    else:
        parsed, assembly, labels = layout_of(scene, rank)
    if "search" in parsed.model_fields_set:
        _check_search(scene, parsed, assembly)
    if robust:
        assembly = build_robust(parsed)
    parsed = with_cracks(parsed, cracks)
    with error_context(scene):
        require_materials(assembly, labels, ~labels)
        settlements_of(parsed, assembly)
        require_model(assembly, options, labels)
        check_cracks(parsed, assembly, cracks, options, robust)
        if not isinstance(parsed.cracks, FieldCracks):
            assembly, labels = of_cells(parsed, assembly, labels)
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
        nominal = solve_assembly(assembly.at_nominal, result.labels, **vars(result.model)).load_factor
        result = replace(
            result, facts={**result.facts, "load_factor_nominal": None if math.isnan(nominal) else nominal}
        )
    rates = {name: rate.to_json() for name, rate in sensitivities(result).items()}
    result = named(parsed, replace(result, facts={**result.facts, "sensitivities": rates}))
    if out is not None:
        _write_result(result, out)
    say(json.dumps(result.to_json(), indent=1) if as_json else result_in_words(parsed, result))
    if result.status is Status.UNCERTIFIED:
        raise typer.Exit(UNCERTIFIED)


def _write_result(result: LimitAnalysisResult, out: Path) -> None:
    """Write result.json and pictures into a folder."""
    check_writable(out)
    from jld_core.views import figures  # importing matplotlib takes longer than most solves

    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "result.json", json.dumps(result.to_json(), indent=1))
    drawn = {"": result} if not result.cases else {f"-{k}": one for k, one in enumerate(result.cases.values(), 1)}
    for after, one in drawn.items():
        figure = figures.figure_of_result(one)
        for ending in ("png", "svg"):
            figures.save_figure(figure, out / f"result{after}.{ending}")


def _with_driver_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that also has the options of all drivers.

    The help texts come from the drivers, which also validate the values.
    """
    kinds = {name: list(owners(name)) for kind in DRIVERS.values() for name in kind.Options.model_fields}
    types = {name: hint for name, hint in get_type_hints(command, include_extras=True).items() if name != "own"}
    stated = inspect.signature(command).parameters
    parameters = [p.replace(annotation=types[name]) for name, p in stated.items() if name in types]
    for name, drivers in kinds.items():
        field = drivers[0].Options.model_fields[name]
        spoken = " and ".join(sorted(kind.name for kind in drivers))
        words = f"{spoken.capitalize()} driver{'s' * (len(drivers) > 1)}: {field.description}."
        types[name] = Annotated[str | None, typer.Option(help=words)]
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=types[name]))

    def run(**given: Any) -> None:
        command(**given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__, run.__doc__ = types, command.__doc__
    return run


@app.command(name="explore")
@_with_driver_options
def explore_command(
    context: typer.Context,
    scene: SceneFile,
    out: Annotated[Path, typer.Option(help="Folder for tables and pictures.", show_default=False)],
    driver: Annotated[
        str | None, typer.Option(help="Search driver; default: one that proves where the proof is in reach.")
    ] = None,
    objective: Annotated[
        ObjectiveName,
        typer.Option(
            help="What is maximised: λ; without dilation the lowest found, or a proven bound below it (-floor); or "
            "what a virtual experiment carries."
        ),
    ] = "associative",
    experiment_of: Annotated[
        int | None,
        typer.Option("--experiment", min=1, help="Put the best K to the virtual experiment: a column more."),
    ] = None,
    check_fields: Annotated[
        int, typer.Option(min=0, help="Check the best K of a search by faces by fields, 0 for none.")
    ] = 10,
    budget: Annotated[int | None, typer.Option(min=1, help="Distinct classes evaluated at the most.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="Time limit.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the driver.")] = 0,
    strict: Strict = False,
    robust: Robust = False,
    cracks: Cracks = None,
    effective_area: EffectiveArea = False,
    contact: Contact = "convex",
    inner_bending: Bending = "uncoupled",
    condense: Blocks = "auto",
    solver: First = "auto",
    gap: Gap = GAP,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a folder that holds a study.")] = False,
    certificates: Annotated[
        bool, typer.Option("--certificates", hidden=True, help="No effect; accepted until version 0.4.")
    ] = False,
    cluster: Annotated[
        str | None,
        typer.Option(help="Scheduler of dask, tcp://host:8786, whose workers evaluate."),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(help="Exact driver: file for its proof, which jld verify checks.")
    ] = None,
    as_json: AsJson = False,
    **own: Any,
) -> None:
    """Search the labellings of a scene for the strongest: ranked table, front, pictures."""
    parsed = with_cracks(load_scene(scene), cracks)
    most = _JOBS * (os.cpu_count() or 1)
    if certificates:
        warn("jld: --certificates has no effect and will be refused in version 0.4; leave it out")
    check_folder(out, resume)
    if certificate is not None:
        refuse_itself(scene, certificate)
    if jobs is not None and jobs > most:
        raise ParameterError("jobs", f"{jobs} processes would starve one another", f"at most {most} on this machine")
    raise_on_signals()
    model = SolveOptions(
        effective_area=effective_area,
        contact=contact,
        inner_bending=_current_bending(inner_bending),
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
