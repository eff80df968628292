"""Run a search from a scene to a results folder: choose a driver, search, write results."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from jld_core.assembly import Assembly
from jld_core.build import build_assembly, build_robust
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError
from jld_core.memory import memory_limit
from jld_core.models import cost_estimate, require_memory, require_model
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_explore.drivers import (
    DRIVERS,
    Driver,
    Enumeration,
    Exact,
    bound_of_all,
    certify,
    check_certifiable,
    driver_for,
    make_driver,
    size_up_to,
)
from jld_explore.evaluation import MakeEvaluator, VoidCellsEvaluator, evaluator_of, on_cluster
from jld_explore.experiments import DEFAULT, Experiments, add_experiments
from jld_explore.report import (
    Exploration,
    check_certificate_file,
    check_folder,
    write_pictures,
    write_report,
    write_tables,
    write_text,
)
from jld_explore.space import SearchSpace, from_string, search_space
from jld_explore.study import ExploreSettings, Interrupted, Progress, StopReason, Study

CLASSES: Final = "classes (layouts, those alike by symmetry once)"
"""Term "classes" with its explanation, used where it first appears."""

WRITING: Final = 1.0
"""Seconds reserved from a time limit for tables and page, their time at the end of a small search."""

BUSY: Final = 6.0
"""Largest factor by which a busy machine may prolong the writing of tables and page."""

OVER: Final = (0.05, 0.5)
"""Latest time of the page after a time limit: share of the limit, and seconds.

A command may end 10 % of the limit plus 2 s after it; the remainder is for busy machines.
"""

LAST: Final = (0.1, 1.0)
"""Latest time of pictures after a time limit, as `OVER`; later pictures are not drawn."""

COUNTING: Final = 0.2
"""Share of the remaining time for counting the classes of a space; a slower count means that the space is large."""

BOUNDING: Final = 5.0
"""Expected time of the bound on all labellings, as a multiple of the time of one labelling.

The bound is omitted if it would be late.
"""

STOPPING: Final = 0.5
"""Seconds after the end of a search for the bound on all labellings.

After an interrupt it also limits the solves for the page, which always shows the best layout.
"""


@one_thread()
def explore(
    scene: Scene,
    folder: Path,
    settings: ExploreSettings | None = None,
    report: Callable[[Progress], None] | None = None,
    announce: Callable[[str], None] | None = None,
    *,
    driver: str | Driver | None = None,
    started: float | None = None,
) -> Exploration:
    """Search the labellings of a scene and write all results (docs/scene.md) into a folder.

    Parameters
    ----------
    scene : Scene
        Validated scene.
    folder : Path
        Results folder, new or empty unless `settings.resume` is set.
    settings : ExploreSettings, optional
        Settings of the search.
    report : callable, optional
        Function called with each `Progress`.
    announce : callable, optional
        Function called with messages, for example the name of the chosen driver.
    driver : str or Driver, optional
        Name of a driver, or a driver made for the scene's space; overrides the settings.
    started : float, optional
        Start of the time limit on the clock `time.perf_counter`, s. Default: now.

    Returns
    -------
    Exploration
        Finished search with its tables.

    Raises
    ------
    InputError
        If the folder or the settings cannot be used, or if no layout was found.
    Interrupted
        If a signal ended the search, after tables and page were written.
    """
    settings = settings or ExploreSettings()
    deadline = Deadline(settings.seconds, started)
    if settings.cluster is not None:
        check_folder(folder, settings.resume)
        with on_cluster(settings.cluster):
            return explore(
                scene,
                folder,
                replace(settings, cluster=None),
                report,
                announce,
                driver=driver,
                started=deadline.started,
            )
    check_folder(folder, settings.resume)
    if settings.certificate is not None:
        check_certificate_file(settings.certificate, folder)
    if driver is not None:
        settings = replace(settings, driver=driver)
    assembly = build_robust(scene) if settings.robust else build_assembly(scene)
    if assembly.warnings and settings.strict:
        raise InputError("", assembly.warnings[0], "a scene without warnings, or no --strict")
    _refuse_together(settings, assembly)
    # Announce warnings only once the search begins; a refused search gives its error alone.
    said = [f"warning: {warning}" for warning in assembly.warnings]
    space = _space_of(scene, assembly, settings.driver)
    assembly = space.assembly if isinstance(settings.driver, Driver) else assembly
    settings = _affordable(assembly, settings, said)
    chosen, total = choose_driver(space, settings, deadline)
    said.append(f"driver: {chosen.name}" + (f", {total} {CLASSES}" if total is not None else ""))
    _refuse_unfit(scene, assembly, settings, chosen)
    make: MakeEvaluator = evaluator_of
    if space.void is not None:
        _refuse_beside_void(settings, chosen)
        assembly, make = space.assembly, VoidCellsEvaluator
    study = Study(
        scene,
        assembly,
        space,
        chosen,
        folder,
        settings,
        total=total,
        report=report,
        deadline=_of_search(deadline, settings),
        make=make,
    )
    if announce is not None:
        for line in said:
            announce(line)
    write_text(folder / "scene.json", scene.model_dump_json(indent=1, exclude_defaults=True))
    done = write_tables(study, _run(study, deadline))
    if settings.certificate is not None and isinstance(chosen, Exact):
        best, load = done.summary["best_labelling"], done.summary["best"]
        certify(chosen, scene, settings.certificate, None if best is None else (from_string(best), float(load)))
    if settings.experiment or settings.by_experiment:
        done = _experimented(study, done)
    if settings.pictures:
        _draw(done, deadline, settings, announce)
    return done


def _space_of(scene: Scene, assembly: Assembly, driver: str | Driver | None) -> SearchSpace:
    """Return the space of the given driver, else that of the scene.

    Raises InputError for a driver of another scene, and as `search_space` does.
    """
    if not isinstance(driver, Driver):
        return search_space(scene, assembly)
    space = driver.space
    if space.search != scene.search or space.assembly.elements.ids != assembly.elements.ids:
        raise InputError("driver", "it was made for the space of another scene", "search_space of this scene")
    return space


def _refuse_together(settings: ExploreSettings, assembly: Assembly) -> None:
    """Raise InputError for settings that exclude each other or do not support the loads."""
    if assembly.cases and settings.certificates:
        raise InputError("--certificates", "they speak of one load, and the scene has cases", "a search without them")
    if settings.robust and settings.certificates:
        raise InputError("--certificates", "they speak of one strength, not of a low and a nominal one", "one of both")
    if settings.certificate is not None and settings.robust:
        raise InputError("--certificate", "it speaks of one value of each strength", "a search without --robust")
    if settings.certificate is not None and settings.by_experiment:
        raise InputError("--certificate", "an experiment is no proof", "--objective associative")


def _refuse_unfit(scene: Scene, assembly: Assembly, settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError if driver, model, experiment or certificate do not fit the structure.

    If a certificate is requested, also restrict the exact driver to proofs that a certificate can hold.
    """
    if driver.modular and not replace(settings.model, friction="associative").modular:
        raise InputError(
            "--driver", f"{driver.name} has no bounds for this model", "convex contact on whole faces, paper bending"
        )
    space = driver.space
    dry = (space.candidates | space.fixed) & (space.assembly.interfaces.b != space.assembly.sink)
    require_model(space.assembly, settings.model, dry)
    if settings.experiment or settings.by_experiment:
        from jld_experiment import require_one_load  # optional; raises its error here if missing

        require_one_load(assembly)
    if settings.certificate is not None:
        check_certifiable(driver, settings.model, scene)
        if isinstance(driver, Exact):
            driver.prove_by_faces()


def _of_search(deadline: Deadline, settings: ExploreSettings) -> Deadline:
    """Return the deadline of the search itself, so that tables and page are ready in time."""
    # The ratio of wall-clock to CPU time so far estimates how much longer writing takes on a busy machine.
    busy = min(max(1.0, deadline.elapsed() / time.process_time()), BUSY)
    return deadline.earlier(max(0.0, busy * WRITING - OVER[0] * (settings.seconds or 0.0) - OVER[1]))


def _later(deadline: Deadline, settings: ExploreSettings, over: tuple[float, float]) -> Deadline:
    """Return the deadline moved later by a share of the time limit and some seconds."""
    return deadline.earlier(-over[0] * (settings.seconds or 0.0) - over[1])


def _run(study: Study, deadline: Deadline) -> StopReason:
    """Run the study and bound all labellings if no other bound is known.

    If the search is interrupted, its tables are written before the exception continues.
    Raises InputError if no labelling was found, and removes the files of the search.
    """
    try:
        reason = study.run()
    except BaseException as stop:
        # A signal may arrive between writing to disk and updating memory, so reopen the record on disk.
        study.records.close()
        _bound_all(study, sure=BOUNDING * cost_estimate(study.assembly).seconds < STOPPING)
        done = write_tables(study, StopReason.INTERRUPTED)
        if study.settings.pictures and len(done.results):
            write_report(done, patience=STOPPING)
        if isinstance(stop, Interrupted):
            stop.done = done
        raise
    if not len(study.records) and reason in (StopReason.EXHAUSTED, StopReason.PROVEN, StopReason.TIME):
        # The space, too large to count beforehand, is empty, or no labelling was found in time.
        for path in (study.records.path, study.folder / "scene.json"):
            path.unlink(missing_ok=True)
        if not any(study.folder.iterdir()):
            study.folder.rmdir()
        raise _nothing_found(study.space, study.settings.seconds if reason is StopReason.TIME else None)
    if reason not in (StopReason.PROVEN, StopReason.EXHAUSTED) and study.bound is None:
        _bound_all(study, sure=BOUNDING * cost_estimate(study.assembly).seconds < deadline.remaining() + STOPPING)
    return reason


def _experimented(study: Study, done: Exploration) -> Exploration:
    """Add virtual experiments on the best layouts, or a search by experiment, to a study."""
    settings = study.settings
    experiments = Experiments(study.assembly, study.folder, settings.jobs, study.deadline)
    objective = (settings.model, settings.seed) if settings.by_experiment else None
    return add_experiments(done, study.space, experiments, settings.experiment or DEFAULT, objective)


def _draw(
    done: Exploration, deadline: Deadline, settings: ExploreSettings, announce: Callable[[str], None] | None
) -> None:
    """Write the page, then the pictures for which there is time."""
    write_report(done, deadline=_later(deadline, settings, OVER))
    missing = write_pictures(done, deadline=_later(deadline, settings, LAST))[1]
    if missing and announce is not None:
        announce(f"not drawn for lack of time: {', '.join(missing)}; jld plot {done.folder} draws them")


def _affordable(assembly: Assembly, settings: ExploreSettings, said: list[str]) -> ExploreSettings:
    """Reduce the number of jobs to the available memory and add messages on long solves.

    Raises InputError if the scene needs more memory than there is.
    """
    effort = require_memory(assembly)
    jobs = max(1, min(settings.jobs, int(memory_limit() / effort.memory))) if settings.jobs > 1 else 1
    if jobs < settings.jobs:
        said.append(f"jobs: {jobs} of {settings.jobs}, as each takes some {effort.memory / 1e9:.1f} GB of memory")
    if effort.long is not None:
        limit = "" if settings.seconds is None else "; the time limit may be passed by that"
        said.append(f"{effort.long}{limit}")
    return replace(settings, jobs=jobs)


def _bound_all(study: Study, *, sure: bool) -> None:
    """Record a bound on all labellings if none is known and `sure` says that there is time."""
    study.records = study.open_records()
    if study.bound is None and sure:
        study.keep_bound(bound_of_all(study.space, study.settings.model))
    study.records.close()


def _refuse_beside_void(settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError for options that need a single structure if cells may be left out."""
    for option, asked in (
        ("--certificates", settings.certificates),
        ("--experiment", settings.experiment is not None or settings.by_experiment),
        ("--driver", driver.modular),
    ):
        if asked:
            raise InputError(option, "it speaks of one structure, and search.void leaves cells out", "a search without")


def choose_driver(
    space: SearchSpace, settings: ExploreSettings, deadline: Deadline | None = None
) -> tuple[Driver, int | None]:
    """Choose the driver and count the classes of the space if it is small.

    Parameters
    ----------
    space : SearchSpace
        Search space.
    settings : ExploreSettings
        Settings with the wanted driver and its options.
    deadline : Deadline, optional
        Deadline of the search; a count that exceeds a share of it means a large space.

    Returns
    -------
    driver : Driver
        Driver of the search.
    total : int or None
        Number of classes if known.

    Raises
    ------
    InputError
        If the driver or an option is unknown, or the space provably holds no labelling.
    """
    wanted = settings.driver
    if isinstance(wanted, str) and wanted not in DRIVERS:
        raise InputError("--driver", f"no driver is named {wanted!r}", "one of " + ", ".join(DRIVERS))
    # A driver chosen by name needs the size of the space for progress reports only.
    quick = isinstance(wanted, str) and wanted != Enumeration.name
    deadline = Deadline() if deadline is None else deadline
    known = None
    with suppress(DeadlinePassed), deadline.within(COUNTING * deadline.remaining()).enforced():
        known = size_up_to(space, settings.small, quick=quick) if settings.small else None
    if known == 0:
        raise _nothing_found(space)
    if isinstance(wanted, Driver):
        return wanted, known
    if wanted is None:
        many = settings.by_experiment or settings.experiment is not None
        make = partial(driver_for, space, settings.seed, settings.model, known, settings.options, many=many)
    else:
        make = partial(make_driver, wanted, space, settings.seed, **settings.options)
    try:
        with deadline.enforced():  # The exact driver prepares for its space, in a share of the time left.
            return make(), known
    except DeadlinePassed:
        return make(), known


def _nothing_found(space: SearchSpace, seconds: float | None = None) -> InputError:
    """Return the error for a search without any layout, ended by `seconds` or by exhaustion.

    It says whether the space is proven empty.
    """
    where, problem, remedy = "search", "no labelling satisfies the constraints", "constraints that some labelling meets"
    if seconds is not None:
        problem = "no layout that satisfies the constraints was found"
    open_question = "" if seconds is None else f" within --seconds {seconds:g}, nor a proof that there is none"
    if space.laying is not None and space.laying.refused:
        standing = space.search.assemble == "standing"
        wish = "stands at every stage without props" if standing else "can be laid"
        where = "search.assemble"
        within = "" if seconds is None else f" of {space.laying.refused} that were looked at"
        aside = space.assembly.dimension == 2 and not space.search.assemble_out_of_plane
        remedy = "assemble_out_of_plane, or no such limit" if aside else "no such limit"
        remedy = '"translation", with centring' if standing else remedy
        problem = f"no layout{within} {wish}"
        if seconds is None and space.laying.undecided:
            problem = f"no layout was found that {wish}"
            open_question = f", and for {space.laying.undecided} of them the search for an order stopped at its limit"
    return InputError(where, problem + open_question, remedy if seconds is None else f"{remedy}, or more seconds")
