"""From a scene to a finished folder: driver chosen, study run, tables and pictures written."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
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
"""The word explained where it first appears."""

WRITING: Final = 1.0
"""Seconds that tables and page take at the end of a small search; they are kept back from a time limit."""

BUSY: Final = 3.0
"""How many times longer than on an idle machine that may take at the most."""

OVER: Final = (0.05, 0.5)
"""How far past a time limit the page is ready at the latest: share of the limit, and seconds. A command may end a
tenth of the limit and 2 s past it; the rest is for busy machines."""

LAST: Final = (0.1, 1.0)
"""The same for pictures, which are left out where they would be late."""

COUNTING: Final = 0.2
"""Share of the time left in which a space is counted beforehand; one that takes longer counts as large."""

BOUNDING: Final = 5.0
"""Times that one labelling takes, as expected, in which all of them are bounded at the end; it is left out if late."""

STOPPING: Final = 0.5
"""Seconds past the end of a search that a bound on all labellings may take, and past an interrupt the solves of the
page, which always shows the best layout."""


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
    """Search the labellings of a scene and write everything docs/scene.md lists into a folder.

    scene: validated. folder: empty or new, unless resuming. report: called with progress. announce: told which
    driver was chosen. driver: by name, or one of your own made for the scene's space; it goes before that of the
    settings. started: when the time of the search began, as `time.perf_counter` counts, s; default now. Raises
    InputError for a folder or a search that cannot be used, and where no layout was found; Interrupted after writing
    the tables and the page of what was finished.
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
    # said when the search begins: where it is refused nothing else is said
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
    """What is searched: the space of a driver that was handed in, else the scene's.

    Raises InputError for a driver of another scene, and as `search_space` does.
    """
    if not isinstance(driver, Driver):
        return search_space(scene, assembly)
    space = driver.space
    if space.search != scene.search or space.assembly.elements.ids != assembly.elements.ids:
        raise InputError("driver", "it was made for the space of another scene", "search_space of this scene")
    return space


def _refuse_together(settings: ExploreSettings, assembly: Assembly) -> None:
    """Raise InputError for settings that do not go with one another, or with the loads of an assembly."""
    if assembly.cases and settings.certificates:
        raise InputError("--certificates", "they speak of one load, and the scene has cases", "a search without them")
    if settings.robust and settings.certificates:
        raise InputError("--certificates", "they speak of one strength, not of a low and a nominal one", "one of both")
    if settings.certificate is not None and settings.robust:
        raise InputError("--certificate", "it speaks of one value of each strength", "a search without --robust")
    if settings.certificate is not None and settings.by_experiment:
        raise InputError("--certificate", "an experiment is no proof", "--objective associative")


def _refuse_unfit(scene: Scene, assembly: Assembly, settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError for a driver whose bounds do not hold for a model or have not the certificate that is asked for,
    and for a structure that the model or the experiment does not know; else tell the driver to prove by what a
    certificate can say."""
    if driver.modular and not replace(settings.model, friction="associative").modular:
        raise InputError(
            "--driver", f"{driver.name} has no bounds for this model", "convex contact on whole faces, paper bending"
        )
    space = driver.space
    dry = (space.candidates | space.fixed) & (space.assembly.interfaces.b != space.assembly.sink)
    require_model(space.assembly, settings.model, dry)
    if settings.experiment or settings.by_experiment:
        from jld_experiment import require_one_load  # an extra, refused here where it is not installed

        require_one_load(assembly)
    if settings.certificate is not None:
        check_certifiable(driver, settings.model, scene)
        if isinstance(driver, Exact):
            driver.prove_by_faces()


def _of_search(deadline: Deadline, settings: ExploreSettings) -> Deadline:
    """When the search itself must end, so that tables and page are ready in time."""
    # a busy machine has shown in what it took to get here, and takes as much longer at the end
    busy = min(max(1.0, deadline.elapsed() / time.process_time()), BUSY)
    return deadline.earlier(max(0.0, busy * WRITING - OVER[0] * (settings.seconds or 0.0) - OVER[1]))


def _later(deadline: Deadline, settings: ExploreSettings, over: tuple[float, float]) -> Deadline:
    """The deadline later by a share of the time limit and some seconds."""
    return deadline.earlier(-over[0] * (settings.seconds or 0.0) - over[1])


def _run(study: Study, deadline: Deadline) -> StopReason:
    """Search, and bound all labellings where nothing else has; of a search that is interrupted the tables are written.

    Raises InputError where no labelling was found, and leaves nothing behind then.
    """
    try:
        reason = study.run()
    except BaseException as stop:
        # a signal may come between the disk and the memory: what is on disk is what was finished
        study.records.close()
        _bound_all(study, sure=BOUNDING * cost_estimate(study.assembly).seconds < STOPPING)
        done = write_tables(study, StopReason.INTERRUPTED)
        if study.settings.pictures and len(done.results):
            write_report(done, patience=STOPPING)
        if isinstance(stop, Interrupted):
            stop.done = done
        raise
    if not len(study.records) and reason in (StopReason.EXHAUSTED, StopReason.PROVEN, StopReason.TIME):
        # a space too large to see through beforehand has turned out empty, or hides what it holds
        for path in (study.records.path, study.folder / "scene.json"):
            path.unlink(missing_ok=True)
        if not any(study.folder.iterdir()):
            study.folder.rmdir()
        raise _nothing_found(study.space, study.settings.seconds if reason is StopReason.TIME else None)
    if reason not in (StopReason.PROVEN, StopReason.EXHAUSTED) and study.bound is None:
        _bound_all(study, sure=BOUNDING * cost_estimate(study.assembly).seconds < deadline.remaining() + STOPPING)
    return reason


def _experimented(study: Study, done: Exploration) -> Exploration:
    """What was found, with what a virtual experiment says of the best, or of what a search by it finds."""
    settings = study.settings
    experiments = Experiments(study.assembly, study.folder, settings.jobs, study.deadline)
    objective = (settings.model, settings.seed) if settings.by_experiment else None
    return add_experiments(done, study.space, experiments, settings.experiment or DEFAULT, objective)


def _draw(
    done: Exploration, deadline: Deadline, settings: ExploreSettings, announce: Callable[[str], None] | None
) -> None:
    """Write the page, then the pictures there is time for."""
    write_report(done, deadline=_later(deadline, settings, OVER))
    missing = write_pictures(done, deadline=_later(deadline, settings, LAST))[1]
    if missing and announce is not None:
        announce(f"not drawn for lack of time: {', '.join(missing)}; jld plot {done.folder} draws them")


def _affordable(assembly: Assembly, settings: ExploreSettings, said: list[str]) -> ExploreSettings:
    """The settings with as many jobs as there is memory for; what takes long joins what is said.

    Raises InputError for a scene that there is not the memory for.
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
    """Open the records of a study once more, and put a bound on all labellings there, where none is known yet.

    sure: there is the time for a bound.
    """
    study.records = study.open_records()
    if study.bound is None and sure:
        study.keep_bound(bound_of_all(study.space, study.settings.model))
    study.records.close()


def _refuse_beside_void(settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError for what speaks of one structure, where cells may be left out."""
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
    """The driver and the number of classes where it is known.

    deadline: of the search; a space that is not counted in a share of it counts as large. Raises InputError for an
    unknown name or option, and for a space that provably holds no labelling.
    """
    wanted = settings.driver
    if isinstance(wanted, str) and wanted not in DRIVERS:
        raise InputError("--driver", f"no driver is named {wanted!r}", "one of " + ", ".join(DRIVERS))
    # who chooses a search wants the size for its progress at the most
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
        chosen = driver_for(space, settings.seed, settings.model, known, settings.options, many=many)
        return chosen, known
    return make_driver(wanted, space, settings.seed, **settings.options), known


def _nothing_found(space: SearchSpace, seconds: float | None = None) -> InputError:
    """What is said where no layout was found. seconds: the time limit that ended the search, None: there is none."""
    if space.laying is not None and space.laying.refused:
        wish = "stands at every stage without props" if space.search.assemble == "standing" else "can be laid"
        where = "search.assemble"
        within = "" if seconds is None else f" of {space.laying.refused} that were looked at"
        aside = space.assembly.dimension == 2 and not space.search.assemble_out_of_plane
        remedy = "assemble_out_of_plane, or no such limit" if aside else "no such limit"
        remedy = '"translation", with centring' if space.search.assemble == "standing" else remedy
        problem = f"no layout{within} {wish}"
    else:
        where, problem, remedy = (
            "search",
            "no labelling satisfies the constraints",
            "constraints that some labelling meets",
        )
        if seconds is not None:
            problem = "no layout that satisfies the constraints was found"
    if seconds is None:
        return InputError(where, problem, remedy)
    return InputError(where, f"{problem} within --seconds {seconds:g}", f"{remedy}, or more seconds")
