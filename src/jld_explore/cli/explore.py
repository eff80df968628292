"""Define `jld explore`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import typer

from jld_core import plugins
from jld_core.errors import ParameterError, error_context
from jld_core.limit import SolveOptions
from jld_core.scene import Scene, load_scene
from jld_core.tolerances import GAP
from jld_explore import Exploration, explore
from jld_explore.cli.cracks import Cracks, with_cracks
from jld_explore.cli.driver_options import with_driver_options
from jld_explore.cli.ending import raise_on_signals
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
from jld_explore.cli.options import AsJson, SceneFile, refuse_itself
from jld_explore.cli.progress import ProgressBar
from jld_explore.cli.search_options import (
    AllPictures,
    Budget,
    CertificateFile,
    CheckFields,
    Cluster,
    DriverName,
    ExperimentOf,
    Jobs,
    MoveBest,
    Objective,
    OutFolder,
    ReliabilityOf,
    Resume,
    Seconds,
    Seed,
    WriteCsv,
)
from jld_explore.cli.streams import say
from jld_explore.report import check_folder, words
from jld_explore.search.settings import (
    BudgetSettings,
    ExploreSettings,
    ModelSettings,
    OutputSettings,
    ParallelSettings,
    SearchMethod,
)
from jld_explore.search.state import Interrupted

_JOBS = 16  # Largest number of worker processes per core.


@with_driver_options
def explore_command(
    context: typer.Context,
    scene: SceneFile,
    out: OutFolder,
    driver: DriverName = None,
    objective: Objective = "associative",
    experiment_of: ExperimentOf = None,
    reliability_of: ReliabilityOf = None,
    check_fields: CheckFields = 10,
    move: MoveBest = None,
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
    csv: WriteCsv = False,
    pictures: AllPictures = False,
    cluster: Cluster = None,
    certificate: CertificateFile = None,
    as_json: AsJson = False,
    **own: Any,
) -> None:
    """Search the layouts of a scene for the strongest, and write a folder of results.

    The folder holds ranked tables, the front, pictures, a page and a summary. After a signal it holds what was found
    until then, and --resume goes on.
    """
    parsed = with_cracks(load_scene(scene), cracks)
    check_folder(out, resume)
    if certificate is not None:
        refuse_itself(scene, certificate)
    _check_jobs(jobs)
    raise_on_signals()
    model = SolveOptions(
        effective_area=effective_area,
        contact=contact,
        inner_bending=inner_bending,
        condense=condense,
        solver=solver,
        gap=gap,
    )
    settings = ExploreSettings.of(
        ModelSettings(
            model, robust=robust, experiment=experiment_of, check_fields=check_fields, reliability=reliability_of
        ).maximising(objective),
        BudgetSettings(budget, seconds),
        ParallelSettings(jobs or os.cpu_count() or 1, cluster),
        SearchMethod(driver, own, seed),
        OutputSettings(resume, "all" if pictures else True, certificate, strict, csv),
    )
    announce = None if as_json else say
    if move is not None:
        _move(parsed, scene, out, move, settings, as_json, context.obj)
        return
    try:
        with ProgressBar(parsed.name) as bar, error_context(scene, str(out)):
            done = explore(parsed, out, settings, bar, announce, started=context.obj)
    except Interrupted as stop:
        if stop.done is None:
            stop.words = "stopped before the search began"
        else:
            _say_found(stop.done, as_json)
        raise
    _say_found(done, as_json)


def _move(
    parsed: Scene, source: Path, out: Path, layouts: int, settings: ExploreSettings, as_json: bool, started: float
) -> None:
    """Search labels and geometry together, write all files and print what was found."""
    search = plugins.part("moved_search")
    with error_context(source, str(out)):
        try:
            done = search.explore_and_move(parsed, out, layouts, settings, None if as_json else say, started=started)
        except Interrupted as stop:
            if isinstance(stop.done, search.MovedSearch):
                search.write_moved(stop.done, out, pictures=bool(settings.pictures))
                stop.words = f"stopped; the best so far is in {out}"
            raise
        facts = search.write_moved(done, out, pictures=bool(settings.pictures))
    if as_json:
        say(json.dumps({**done.first.summary.to_json(), "moved": facts}, indent=1))
        return
    _say_found(done.first, as_json)
    say(search.words_of_move(facts))


def _check_jobs(jobs: int | None) -> None:
    """Raise InputError for more worker processes than the machine can serve."""
    most = _JOBS * (os.cpu_count() or 1)
    if jobs is not None and jobs > most:
        raise ParameterError("jobs", f"{jobs} processes are too many", f"at most {most} on this machine")


def _say_found(done: Exploration, as_json: bool) -> None:
    """Print the results of a search."""
    say(json.dumps(done.summary.to_json(), indent=1) if as_json else words.exploration(done))
