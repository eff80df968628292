"""Run a search from a scene to a results folder: choose a driver, search, write results."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import replace
from functools import partial
from inspect import signature
from pathlib import Path
from types import NoneType
from typing import Any, Final, Literal, cast

from jld_core.assembly import Assembly, with_members
from jld_core.build import build_robust
from jld_core.build.assemble import build_assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.files import write_text
from jld_core.limit.options import Model
from jld_core.models import cost_estimate
from jld_core.models.costs import require_memory
from jld_core.parameters import near, require_kind, typed
from jld_core.plugins import of_strangers, part
from jld_core.refinement import crack_cells
from jld_core.scene.cracks import CellCracks, FieldCracks, cracks_in_words
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_core.threads import one_thread
from jld_explore.drivers.base import Driver
from jld_explore.drivers.choice import bound_of_all, driver_kinds, first_layout
from jld_explore.drivers.exact.certifying import certify
from jld_explore.drivers.exact.driver import Exact
from jld_explore.evaluation import evaluator_of
from jld_explore.evaluation.cases import OwnObjectiveEvaluator, VoidCellsEvaluator
from jld_explore.evaluation.field_evaluator import FieldEvaluator, MakeCellEvaluator
from jld_explore.evaluation.pool import beside, deferred_signals, on_cluster
from jld_explore.evaluation.protocol import MakeEvaluator
from jld_explore.evaluation.records import RECORDS_FILE, recorded
from jld_explore.report import folder as folders
from jld_explore.report.folder import check_certificate_file, check_folder, save_tables, write_tables
from jld_explore.report.reading import Exploration
from jld_explore.search.driver_choice import (
    CLASSES,
    affordable_settings,
    choose_driver,
    no_layout_error,
    refuse_beside_void,
    refuse_together,
    refuse_unfit,
)
from jld_explore.search.field_study import FieldStudy
from jld_explore.search.settings import ExploreSettings, Objective
from jld_explore.search.state import Interrupted, Progress, StopReason
from jld_explore.search.study import Study
from jld_explore.space import from_string
from jld_explore.space.labelling import orbit_sizes
from jld_explore.space.search_space import SearchSpace, search_space
from jld_explore.steps.step import (
    PAGE,
    PICTURES,
    TABLES,
    FieldCheck,
    Step,
    StepContext,
    Uncut,
    busy_factor,
    field_seconds,
    later,
    plan_check,
    run_steps,
    search_deadline,
    steps_of,
)

# Expected time of the bound on all labellings, as a multiple of the time of one labelling. The bound is omitted if it
# would be late.
_BOUND_COST: Final = 5.0

# Seconds after the end of a search for the bound on all labellings. After an interrupt it also limits the solves for
# the page, which shows forces of the best layout unless solving it takes long.
_STOPPING_SECONDS: Final = 0.5
_FIRST_LAYOUT_SECONDS: Final = 1.2  # time to find and evaluate a first layout after a signal, s


@typed
def explore(
    scene: str | Path | Mapping[str, Any] | Scene,
    out: str | Path | None = None,
    settings: ExploreSettings | None = None,
    report: Callable[[Progress], None] | None = None,
    announce: Callable[[str], None] | None = None,
    *,
    driver: str | Driver | None = None,
    objective: Objective | None = None,
    seconds: float | None = None,
    budget: int | None = None,
    jobs: int | None = None,
    seed: int | None = None,
    model: Model | None = None,
    options: Mapping[str, Any] | None = None,
    robust: bool | None = None,
    experiment: int | None = None,
    resume: bool | None = None,
    pictures: bool | Literal["all"] | None = None,
    certificate: str | Path | None = None,
    cluster: str | None = None,
    strict: bool | None = None,
    started: float | None = None,
    **driver_options: Any,
) -> Exploration:
    """Search the labellings of a scene and write all results (docs/scene.md) into a folder.

    Parameters
    ----------
    scene : str, Path, dict or Scene
        Scene file, dict as in such a file, or scene.
    out : str or Path, optional
        Results folder, new or empty unless `resume` is set. Default: a new temporary folder, which the result names.
    settings : ExploreSettings, optional
        Settings of the search; keywords below that are given replace its fields.
    report, announce : callable, optional
        Called with each `Progress`, and with messages such as the name of the chosen driver.
    driver : str or Driver, optional
        Its name, or one made for the scene's space. Default: one that proves where a proof is in reach.
    objective : str or callable, optional
        "associative" (default), "zero-dilation", "zero-dilation-floor", "experiment" or "reliability"; or a function of
        an `Evaluation` with λ, the assembly and the labels (m,), whose value is maximised. Then nothing is proven.
    seconds, budget : float, int, optional
        Time limit, s, and largest number of classes to evaluate.
    jobs, seed : int, optional
        Number of worker processes, default 1, and seed of the driver, default 0.
    model : Model, optional
        Crack model, model and solver; the objective sets `friction`, `range` and `floor_seconds`.
    robust, experiment, resume, pictures, certificate, cluster, strict : optional
        As the fields of `ExploreSettings`.
    started : float, optional
        Start of the time limit on the clock `time.perf_counter`, s. Default: now.
    options, **driver_options
        Options of a named driver, as in ``driver="genetic", population=50``.

    Returns
    -------
    Exploration
        Finished search with its tables.

    Raises
    ------
    InputError
        If scene, folder or settings cannot be used, or if no layout was found.
    Interrupted
        If a signal ended the search, after tables and page were written.

    Examples
    --------
    >>> found = explore("scenes/flat_beam_arch.json", driver="exact", seconds=60)
    >>> found.summary.best, found.summary.proven
    """
    arguments: dict[str, Any] = {
        "driver": driver,
        "seconds": seconds,
        "budget": budget,
        "jobs": jobs,
        "seed": seed,
        "model": model,
        "options": _driver_options(options, driver_options),
        "robust": robust,
        "experiment": experiment,
        "resume": resume,
        "pictures": pictures,
        "certificate": None if certificate is None else _path("certificate", certificate),
        "cluster": cluster,
        "strict": strict,
    }
    changes = {name: value for name, value in arguments.items() if value is not None}
    for name, value, kind in (("settings", settings, ExploreSettings), ("report", report, Callable)):
        require_kind(name, value, kind, NoneType)
    require_kind("announce", announce, Callable, NoneType)
    settings = replace(settings or ExploreSettings(), **changes)
    if objective is not None:
        settings = settings.maximising(objective)
    if out is None and settings.resume:
        raise ParameterError("out", "a search is resumed in its own folder", "the name of that folder")
    parsed = scene if isinstance(scene, Scene) else load_scene(scene)
    if isinstance(out, str) and out in driver_kinds():
        raise ParameterError("out", f"{out!r} is the name of a driver", f'`driver="{out}"`, or "./{out}" for a folder')
    folder = Path(tempfile.mkdtemp(prefix="jld-")) if out is None else _path("out", out)
    if (cracks := settings.model.cracks) is not None:
        parsed = parsed.model_copy(update={"cracks": cracks})
        settings = replace(settings, model=replace(settings.model, cracks=None))
    has_records = (folder / RECORDS_FILE).exists()
    # code of strangers may fail at any time, and an error stands alone
    pending: list[str] = []
    announce_message = pending.append if announce is not None and of_strangers(*_AT_WORK) else announce
    try:
        with error_context(scene, str(folder)) if isinstance(scene, str | Path) else nullcontext():
            return _search(parsed, folder, settings, report, announce_message, started)
    except InputError as error:
        pending.clear()
        if out is None:
            with suppress(OSError):  # removes the temporary folder only if nothing was written into it
                folder.rmdir()
        if has_records or not (folder / RECORDS_FILE).exists():
            raise
        expected = f"{error.expected}; what was found until then is in {folder}"
        if error.parameter:
            raise ParameterError(error.parameter, error.problem, expected) from error
        raise InputError(error.where, error.problem, expected) from error
    finally:
        for line in pending:
            cast(Callable[[str], None], announce)(line)


_AT_WORK: Final = ("jld.drivers", "jld.counts", "jld.objectives", "jld.steps")  # plug-ins that a search calls


def _path(parameter: str, value: Any) -> Path:
    """Return what a caller names as a path; raise ParameterError for anything but a name."""
    require_kind(parameter, value, os.PathLike)
    return Path(value)


def _driver_options(options: Any, keywords: dict[str, Any]) -> dict[str, Any] | None:
    """Return options and keywords of a driver together; ParameterError for an unknown keyword."""
    require_kind("options", options, dict, NoneType)
    option_names = sorted({name for kind in driver_kinds().values() for name in kind.Options.model_fields})
    for key in keywords:
        if key not in option_names:
            parameters = [name for name in signature(explore).parameters if name != "driver_options"]
            raise ParameterError(
                key, "explore has no such parameter, and no driver such an option", near(key, parameters + option_names)
            )
    return {**(options or {}), **keywords} or None


@one_thread()
def _search(
    scene: Scene,
    folder: Path,
    settings: ExploreSettings,
    report: Callable[[Progress], None] | None,
    announce: Callable[[str], None] | None,
    started: float | None,
) -> Exploration:
    deadline = Deadline(settings.seconds, started)
    check_folder(folder, settings.resume)
    if settings.cluster is not None:
        with on_cluster(settings.cluster):
            return _search(scene, folder, replace(settings, cluster=None), report, announce, deadline.started)
    if settings.certificate is not None:
        check_certificate_file(settings.certificate, folder)
    require_memory(scene)  # before contacts are built, which may take minutes
    assembly = build_robust(scene) if settings.robust else build_assembly(scene)
    refuse_together(scene, settings, assembly)
    # Announce messages only once a layout is found; a refused search and an empty space give their error alone.
    messages = _messages(scene, assembly)
    space = _space_of(scene, assembly, settings)
    assembly = space.assembly if isinstance(settings.driver, Driver) else assembly
    settings = affordable_settings(assembly, settings, messages)
    driver, total = _choose_driver(scene, space, settings, deadline, folder)
    messages.append(f"driver: {driver.name}" + (f", {total} {CLASSES}" if total is not None else ""))
    refuse_unfit(scene, assembly, settings, driver)
    if space.void is not None:
        refuse_beside_void(settings, driver)
        assembly = space.assembly
    study_class, make_evaluator = _makers(scene, assembly, settings, void=space.void is not None)
    plan = plan_check(scene, assembly, space, settings)
    table_steps: list[Step] = [] if plan is None else [FieldCheck(plan)]  # results are written with their columns
    steps = steps_of(settings, scene, space.assembly, [Uncut()])

    def announce_messages() -> None:
        while messages and announce is not None:
            announce(messages.pop(0))

    steps_deadline = search_deadline(deadline, settings, assembly, fields=isinstance(scene.cracks, FieldCracks))
    study = study_class(
        scene,
        assembly,
        space,
        driver,
        folder,
        settings,
        total=total,
        report=report,
        before_first_evaluation=announce_messages,
        make=make_evaluator,
        deadline=steps_deadline.earlier(sum(step.seconds(settings) for step in [*table_steps, *steps])),
    )
    write_text(folder / "scene.json", scene.model_dump_json(indent=1, exclude_defaults=True))
    reason = _run_study(study, deadline)
    context = StepContext(space, settings, steps_deadline)
    return _write_results(study, reason, (table_steps, steps), context, deadline, announce_messages, announce)


def _write_results(
    study: Study,
    reason: StopReason,
    steps: tuple[list[Step], list[Step]],
    context: StepContext,
    deadline: Deadline,
    announce_messages: Callable[[], None],
    announce: Callable[[str], None] | None,
) -> Exploration:
    """Write tables, pictures and certificate of a study, and run its steps: those that add to tables, and others."""
    settings, driver = context.settings, study.driver
    try:
        with ExitStack() as drawing:
            with deferred_signals():  # a signal waits until the tables are whole
                exploration = write_tables(study, reason, later(deadline, settings, TABLES))
                announce_messages()  # of a resumed search without a new layout
                if settings.pictures:
                    draw = _picture_writer(exploration, deadline, settings)
                    wait_for_pictures = drawing.enter_context(beside(draw))
                for step in steps[0]:
                    exploration = step.run(exploration, context)
                save_tables(exploration, csv=settings.csv)
            if settings.certificate is not None and isinstance(driver, Exact):
                _certify(driver, study.scene, settings.certificate, exploration)
            exploration = run_steps(exploration, steps[1], context)
            if settings.pictures:
                _draw(exploration, deadline, settings, wait_for_pictures, announce)
            return exploration
    except Interrupted as stop:
        if settings.pictures:
            with deferred_signals():
                part("views").write_report(exploration, patience=_STOPPING_SECONDS, deadline=Deadline(0.0))
        stop.done = exploration
        raise


def _messages(scene: Scene, assembly: Assembly) -> list[str]:
    """Return the warnings and notes of a scene, and how it cracks if not at faces alone."""
    messages = [f"warning: {warning}" for warning in assembly.warnings] + [f"note: {note}" for note in assembly.notes]
    return messages if scene.cracks == "faces" else [*messages, f"cracks: {cracks_in_words(scene.cracks)}"]


def _choose_driver(
    scene: Scene, space: SearchSpace, settings: ExploreSettings, deadline: Deadline, folder: Path
) -> tuple[Driver, int | None]:
    """Choose the driver of a search, and count the classes of its space if it is small."""
    # a search that goes on without a named driver keeps the one on record: what is small depends on the time limit
    fields = scene.cracks if isinstance(scene.cracks, FieldCracks) else None
    choice = choose_driver(space, settings, deadline, bounded=scene.cracks == "faces", cracks_by_fields=fields)
    if settings.resume and settings.driver is None:
        recorded_driver = str(recorded(folder / RECORDS_FILE).get("driver"))
        if recorded_driver in driver_kinds() and recorded_driver != choice[0].name:
            return choose_driver(space, replace(settings, driver=recorded_driver), deadline, cracks_by_fields=fields)
    return choice


def _space_of(scene: Scene, assembly: Assembly, settings: ExploreSettings) -> SearchSpace:
    """Return the space of the given driver, else that of the scene; InputError if they do not fit."""
    # An objective of the user may tell mirror images apart, unless its attribute `symmetric` is true.
    objective, driver = settings.own_objective, settings.driver
    why = (
        ""
        if objective is None or getattr(objective, "symmetric", False)
        else "an objective of your own may not have it"
    )
    if not isinstance(driver, Driver):
        return search_space(scene, assembly, tells_apart=why)
    space = driver.space
    if space.search != scene.search or space.assembly.elements.ids != assembly.elements.ids:
        raise ParameterError("driver", "it was made for the space of another scene", "search_space of this scene")
    if why and len(space.group) > 1:
        expected = 'search.symmetry "none", or an objective with the attribute symmetric = True'
        raise ParameterError("driver", f"its space merges mirror images, and {why}", expected)
    return space


def _certify(driver: Exact, scene: Scene, path: Path, exploration: Exploration) -> None:
    """Write the certificate of a proof, with the best labelling found."""
    best, load = exploration.summary.best_labelling, exploration.summary.best
    strongest = None if best is None or load is None else (with_members(exploration.assembly, from_string(best)), load)
    bound = exploration.summary.bound
    if strongest is None and bound is not None:  # where no layout stands, what refutes each one refutes every λ ≥ 0
        bound = max(bound, 0.0)
    certify(driver, scene, path, strongest, bound)


def _makers(
    scene: Scene, assembly: Assembly, settings: ExploreSettings, *, void: bool
) -> tuple[type[Study], MakeEvaluator]:
    """Return the class of the study and the maker of its evaluators, for crack model, cells left out and objective."""
    kind: type[Study] = Study
    make: MakeEvaluator = evaluator_of
    if isinstance(scene.cracks, FieldCracks):
        kind, make = FieldStudy, FieldEvaluator
    elif isinstance(scene.cracks, CellCracks):
        cells = crack_cells(scene, assembly, scene.cracks.cell)
        # where no element is larger than a cell, the evaluators of the joint grid are the same and faster
        make = evaluator_of if cells.fine is assembly else MakeCellEvaluator(cells)
    if settings.own_objective is not None:
        make = partial(OwnObjectiveEvaluator, settings.own_objective)
    return kind, VoidCellsEvaluator if void else make


Pictures = tuple[list[Path], list[str]]  # pictures that were written, and those that were left out for lack of time


def _picture_writer(exploration: Exploration, deadline: Deadline, settings: ExploreSettings) -> Callable[[], Pictures]:
    """Return the function that draws as many pictures as time allows; no picture depends on what steps find."""
    return partial(
        part("views").write_pictures,
        exploration,
        deadline=later(deadline, settings, PICTURES),
        busy=busy_factor(deadline.elapsed(), time.process_time()) if settings.jobs == 1 else 1.0,
        fields=field_seconds(settings.seconds),
        names=folders.PICTURES if settings.pictures == "all" else folders.SHOWN,
    )


def _draw(
    exploration: Exploration,
    deadline: Deadline,
    settings: ExploreSettings,
    wait_for_pictures: Callable[[], Pictures],
    announce: Callable[[str], None] | None,
) -> None:
    """Write the page, and wait for the pictures that are drawn beside it."""
    # The page of a search by fields shows the picture of the best layout. Pictures that are missing are announced.
    fields = isinstance(exploration.scene.cracks, FieldCracks)
    if not fields:
        part("views").write_report(exploration, deadline=later(deadline, settings, PAGE))
    missing = wait_for_pictures()[1]
    if fields:
        part("views").write_report(exploration, deadline=later(deadline, settings, PAGE))
    if missing and announce is not None:
        announce(f"not drawn for lack of time: {', '.join(missing)}; jld plot {exploration.folder} draws them")


def _run_study(study: Study, deadline: Deadline) -> StopReason:
    """Run a study and bound all labellings if no other bound is known; return why it ended."""
    # If the search is interrupted, its tables are written before the exception continues.
    try:
        reason = study.run()
        cost = _BOUND_COST * cost_estimate(study.assembly).seconds
        if len(study.records) and reason not in (StopReason.PROVEN, StopReason.EXHAUSTED) and study.bound is None:
            _bound_all(study, in_time=cost < deadline.remaining() + _STOPPING_SECONDS)
    except BaseException as stop:
        # A signal may arrive between writing to disk and updating memory, so reopen the record on disk.
        study.records.close()
        if isinstance(stop, InputError) and not len(study.records):
            _remove_files(study)
            raise
        solved_first = False
        if isinstance(stop, Interrupted):
            study.records = study.open_records()
            solved_first = _solve_first(study)
            study.records.close()
        _bound_all(study, in_time=_BOUND_COST * cost_estimate(study.assembly).seconds < _STOPPING_SECONDS)
        exploration = save_tables(
            write_tables(study, StopReason.INTERRUPTED, Deadline(_STOPPING_SECONDS)), csv=study.settings.csv
        )
        if study.settings.pictures:
            part("views").write_report(exploration, patience=_STOPPING_SECONDS, deadline=Deadline(0.0))
        if solved_first:
            study.records = study.open_records()
            study.records.forget_evaluations()
            study.records.close()
        if isinstance(stop, Interrupted):
            stop.done = exploration
            if not len(exploration.results):
                stop.words = "stopped before a layout was solved; --resume begins with the first"
        raise
    if not len(study.records) and reason is not StopReason.BUDGET:
        # The space, too large to count beforehand, is empty, or no labelling was found in time.
        _remove_files(study)
        if reason is StopReason.DRIVER:
            raise InputError(f"driver {study.driver.name!r}", "it asks for no layout", "one that its Register admits")
        raise no_layout_error(study.space, study.settings.seconds if reason is StopReason.TIME else None)
    return reason


def _remove_files(study: Study) -> None:
    for path in (study.records.path, study.folder / "scene.json"):
        path.unlink(missing_ok=True)
    if not any(study.folder.iterdir()):
        study.folder.rmdir()


def _solve_first(study: Study) -> bool:
    """Evaluate one layout without the driver if none is on record, and record it; return True if it was."""
    # The record must be open. Nothing happens where one layout is not found and evaluated within a second. The caller
    # forgets the layout again, so that the search resumes as if it had not been stopped.
    seconds = _FIRST_LAYOUT_SECONDS - study.evaluation_seconds
    if len(study.records) or seconds <= 0.0:
        return False
    with suppress(DeadlinePassed), Deadline(seconds).enforced():
        labellings = first_layout(study.space, study.settings.seed)
        evaluations = study.worker_spec.evaluator().evaluate_all(labellings)
        study.records.append(labellings, orbit_sizes(labellings, study.space.group).tolist(), evaluations)
    return len(study.records) > 0


def _bound_all(study: Study, *, in_time: bool) -> None:
    """Record a bound on λ of all labellings if the study has none and there is time for it."""
    study.records = study.open_records()
    if study.bound is None and in_time and study.scene.cracks == "faces" and study.settings.own_objective is None:
        study.keep_bound(bound_of_all(study.space, study.settings.model), "face by face")
    study.records.close()
