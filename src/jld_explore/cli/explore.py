"""Provide `jld explore`."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Collection
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Final, Self

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from jld_core import plugins
from jld_core.errors import ParameterError, error_context
from jld_core.limit.options import SolveOptions
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_explore import Exploration, explore
from jld_explore.cli.ending import raise_on_signals
from jld_explore.cli.options import AsJson, Option, SceneFile, refuse_itself, setting_options, with_cracks, with_options
from jld_explore.cli.streams import say
from jld_explore.drivers.choice import driver_kinds, drivers_with
from jld_explore.report import words
from jld_explore.report.folder import check_folder
from jld_explore.report.words import speed
from jld_explore.search import state
from jld_explore.search.settings import (
    BudgetSettings,
    ExploreSettings,
    ModelSettings,
    OutputSettings,
    ParallelSettings,
    SearchMethod,
)
from jld_explore.search.state import Interrupted

OutFolder = Annotated[Path, typer.Option("-o", "--out", help="Folder for tables and pictures.", show_default=False)]
Objective = Annotated[
    str,
    typer.Option(
        metavar="[associative|zero-dilation|zero-dilation-floor|experiment|reliability|PLUG-IN]",
        help="Value to maximise: λ; the lowest λ found without dilation, or a proven bound below it (-floor); the "
        "load carried in a virtual experiment; or the reliability index of the best by λ.",
    ),
]
MoveBest = Annotated[
    int | None,
    typer.Option("--move", min=1, help="Move joints of the best K, search labels anew there, rank by fields."),
]


def driver_options(other_options: Collection[str]) -> dict[str, Option]:
    """Return the options of all search drivers, texts or None: the drivers state them and validate their values."""
    kinds = {name: list(drivers_with(name)) for kind in driver_kinds().values() for name in kind.Options.model_fields}
    options = {}
    for name, drivers in kinds.items():
        if name in other_options:
            remedy = f"other options than {name!r}, which every search has"
            raise plugins.refuse_type("jld.drivers", drivers[0].name, remedy)
        spoken = " and ".join(sorted(kind.name for kind in drivers))
        field = drivers[0].Options.model_fields[name]
        words = f"{spoken.capitalize()} driver{'s' * (len(drivers) > 1)}: {field.description}."
        options[name] = (Annotated[str | None, typer.Option(help=words, rich_help_panel="Options of a driver")], None)
    return options


class ProgressBar:
    """Progress bar of a search on stderr, if that is a terminal; call it with each report."""

    def __init__(self, label: str) -> None:
        console = Console(file=sys.stderr)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TextColumn("{task.fields[best]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._bar.add_task(label, total=None, rate="", best="", left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def __call__(self, progress: state.Progress) -> None:
        best = "no λ yet" if math.isnan(progress.best) else f"best λ {progress.best:.6g}"
        if math.isfinite(progress.bound):
            best += f" ≤ {progress.bound:.6g}"
        if math.isfinite(progress.gap):
            best += f", gap {progress.gap:.2%}"
        rates = speed(progress.solved / progress.seconds if progress.seconds > 0.0 else None).lstrip(", ")
        left = _time_left(progress)
        self._bar.update(self._task, completed=progress.done, total=progress.total, rate=rates, best=best, left=left)


def _time_left(progress: state.Progress) -> str:
    """Return in words how long a search goes on at most; "" if nothing is known."""
    seconds, done = progress.left, progress.done
    if progress.total and done:
        seconds = min(seconds, progress.seconds * (progress.total - done) / done)
    return f"{seconds:.0f} s left" if math.isfinite(seconds) else ""


_MOST_JOBS_PER_CORE = 16  # Largest number of worker processes per core.

# What `SolveOptions` says besides is a matter of the objective
_MODEL: Final = ("contact", "effective_area", "inner_bending", "condense", "solver", "gap")

_AllPictures = Annotated[
    bool,
    typer.Option(
        "--pictures", help="Draw distribution, frequency of dry faces and convergence too.", rich_help_panel="Files"
    ),
]

_Jobs = Annotated[
    int | None, typer.Option(min=1, help="Worker processes; default: one per core.", rich_help_panel="Processes")
]

_SEARCH: Final = (
    setting_options(SearchMethod, "driver", "seed", group="Search")
    | setting_options(BudgetSettings, group="Limits")
    | setting_options(ParallelSettings, group="Processes")
    | {"jobs": (_Jobs, None)}
    | setting_options(ModelSettings, "robust", "experiment", "check_fields", "reliability", group="Model")
    | setting_options(SolveOptions, "cracks", *_MODEL, group="Model")
    | setting_options(OutputSettings, group="Files")
    | {"pictures": (_AllPictures, False)}
)
_DRIVER_OPTIONS: Final = driver_options({*_SEARCH, "scene", "out", "objective", "move", "as_json"})


@with_options(_SEARCH | _DRIVER_OPTIONS)
def explore_command(
    context: typer.Context,
    scene: SceneFile,
    out: OutFolder,
    objective: Objective = "associative",
    move: MoveBest = None,
    as_json: AsJson = False,
    *,
    cracks: str | None,
    jobs: int | None,
    pictures: bool,
    resume: bool,
    certificate: Path | None,
    **values: Any,
) -> None:
    """Search the layouts of a scene for the strongest, and write a folder of results.

    The folder holds ranked tables, the front, pictures, a page and a summary. After a signal it holds what was found
    until then, and --resume goes on.
    """
    parsed = with_cracks(load_scene(scene), cracks)
    check_folder(out, resume)
    if certificate is not None:
        refuse_itself(scene, certificate)
    most = _MOST_JOBS_PER_CORE * (os.cpu_count() or 1)
    if jobs is not None and jobs > most:
        raise ParameterError("jobs", f"{jobs} processes are too many", f"at most {most} on this machine")
    raise_on_signals()
    model = SolveOptions(**{name: values.pop(name) for name in _MODEL})
    driver_values = {name: values.pop(name) for name in _DRIVER_OPTIONS}
    settings = ExploreSettings(
        model=model,
        options=driver_values,
        jobs=jobs or os.cpu_count() or 1,
        resume=resume,
        certificate=certificate,
        pictures="all" if pictures else True,
        **values,
    ).maximising(objective)
    announce = None if as_json else say
    if move is not None:
        _move(parsed, scene, out, move, settings, as_json, context.obj)
        return
    try:
        with ProgressBar(parsed.name) as bar, error_context(scene, str(out)):
            exploration = explore(parsed, out, settings, bar, announce, started=context.obj)
    except Interrupted as stop:
        if stop.done is None:
            stop.words = "stopped before the search began"
        else:
            _say_found(stop.done, as_json)
        raise
    _say_found(exploration, as_json)


def _move(
    parsed: Scene, source: Path, out: Path, layouts: int, settings: ExploreSettings, as_json: bool, started: float
) -> None:
    """Search labels and geometry together, write all files and print what was found."""
    search = plugins.part("moved_search")
    with error_context(source, str(out)):
        try:
            moved = search.explore_and_move(parsed, out, layouts, settings, None if as_json else say, started=started)
        except Interrupted as stop:
            if isinstance(stop.done, search.MovedSearch):
                search.write_moved(stop.done, out, pictures=bool(settings.pictures))
                stop.words = f"stopped; the best so far is in {out}"
            raise
        facts = search.write_moved(moved, out, pictures=bool(settings.pictures))
    if as_json:
        say(json.dumps({**moved.first.summary.to_json(), "moved": facts}, indent=1))
        return
    _say_found(moved.first, as_json)
    say(search.words_of_move(facts))


def _say_found(exploration: Exploration, as_json: bool) -> None:
    say(json.dumps(exploration.summary.to_json(), indent=1) if as_json else words.exploration(exploration))
