"""A design from an outline: one clock for tessellations, searches, moved joints, checks and the page."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from jld_core import Bits, Deadline, InputError, Scene, Status, build_assembly, files, one_thread
from jld_core.models import solve_rigid
from jld_explore import Exploration, ExploreSettings, Interrupted, busy_factor, explore, search_space
from jld_explore.evaluation import Pool
from jld_explore.space import feasible, from_string
from jld_geometry import move_joints
from jld_practice.design.options import DesignOptions, read_outline
from jld_practice.design.page import write_design
from jld_practice.design.tessellations import Tessellation, tessellations, with_crushing, with_materials_of
from jld_practice.design.trials import (
    UNPROVEN,
    Bounds,
    Design,
    Trial,
    check_winner,
    faces_of,
    field_bounds,
    labelled,
    screen,
    searched_scene,
)

LAYOUTS: Final = 2  # number of layouts of one search whose joints are moved

_LEAST_MOVE: Final = 8.0  # shortest time in which the joints of one layout are moved and its λ is bounded, s

_LONGEST: Final = 60.0  # longest time for one layout in one round, s: labels are searched again before joints move on

_FIRST: Final = 0.45  # share of the time for the first round, which tries all tessellations

_ROUND: Final = 0.5  # share of the time left for each further round

_SEARCH: Final = 0.3  # share of a further round for its searches of labels

_MOVING: Final = 0.6  # share of a task's time in which joints move; bounds by fields take the rest

_SLACK: Final = 0.85  # share of a task's time that is planned: the last step, mesh and solve are finished

_BASES: Final = 2  # number of moved layouts that a further round starts from

# Factor on the strength at which faces crush, from one round to the next. At the strength of the first round, λ by
# faces is often that of another load case, which moves do not change.
_WEAKER: Final = 0.7

_GAIN: Final = 0.01  # relative rise of the lower bound below which a round improves nothing


@dataclass(frozen=True, eq=False)
class Task:
    """Layout whose joints are to be moved."""

    tessellation: str  # name of its tessellation
    scene: Scene  # scene with the materials as stated
    labels: Bits  # (m,) True = dry
    words: str  # where the layout comes from


def best_labels(exploration: Exploration, count: int) -> list[Bits]:
    """Return the labels (m,) of the best `count` layouts of a search that collapse or are locked."""
    table = exploration.results[exploration.results["status"].isin([str(Status.COLLAPSE), str(Status.LOCKED)])]
    return [from_string(str(text)) for text in table["labelling"].head(count)]


def move_in_rounds(work: Design, until: Deadline, say: Callable[[str], None]) -> None:
    """Move the joints of the best layouts in rounds, and add what is found to the trials."""
    share, strength, number = _FIRST, 1.0, 1
    tasks = _first_tasks(work)
    while tasks and until.remaining() > _LEAST_MOVE:
        before = work.winner.proven if work.winner is not None else -math.inf
        _run(work, tasks, until.within(share * until.remaining()), strength, number, say)
        best = work.winner.proven if work.winner is not None else -math.inf
        say(f"round {number}      {len(tasks)} layouts moved: by fields λ ≥ {best:.4g}")
        if number > 2 and not best > before + _GAIN * abs(before):
            strength *= _WEAKER
        share, strength, number = _ROUND, strength * _WEAKER, number + 1
        searches = until.within(_SEARCH * share * until.remaining())
        tasks = _further_tasks(work, searches, strength, number) if until.remaining() > 2.0 * _LEAST_MOVE else []


def _first_tasks(work: Design) -> list[Task]:
    """Return the layouts of the first round: best of each tessellation, second best, stated ones."""
    scenes = {
        tessellation.name: tessellation.scene for tessellation in work.tessellations if tessellation.scene is not None
    }
    tasks: list[Task] = []
    ranked = sorted(
        (entry for entry in work.ranked if entry.kind == "searched"), key=lambda entry: -entry.upper_estimate
    )
    for number in range(LAYOUTS):
        for trial in ranked:
            layouts = work.layouts.get(trial.tessellation, [])
            if number < len(layouts):
                tasks.append(Task(trial.tessellation, scenes[trial.tessellation], layouts[number], f"row {number + 1}"))
    usual = work.usual
    if usual is not None and usual.allowed and usual.stands:
        assembly = build_assembly(scenes[usual.tessellation])
        tasks.append(Task(usual.tessellation, scenes[usual.tessellation], assembly.labels, "as stated"))
    return tasks


def _further_tasks(work: Design, until: Deadline, strength: float, number: int) -> list[Task]:
    """Search labels on the best moved cells; return the layouts of a further round."""
    moved = [trial for trial in work.ranked if trial.kind == "moved"]
    bases = moved[:1]
    bases += sorted((trial for trial in moved if trial not in bases), key=lambda trial: -trial.upper_estimate)[
        : _BASES - 1
    ]
    tasks: list[Task] = []
    for k, base in enumerate(bases):
        base_labels = build_assembly(base.scene).labels
        tasks.append(Task(base.tessellation, base.scene, base_labels, f"round {number}, its own labels"))
        seconds = until.remaining() / (len(bases) - k)
        if seconds < _LEAST_MOVE / 2.0:
            continue
        settings = ExploreSettings(
            seconds=seconds, jobs=work.options.jobs, seed=work.options.seed, pictures=False, check_fields=0
        )
        folder = work.folder / "moved" / f"round-{number}-{k + 1}"
        try:
            exploration = explore(with_crushing(base.scene, strength), folder, settings)
        except InputError:  # no layout was found in the time: its own labels move on
            continue
        others = [labels for labels in best_labels(exploration, LAYOUTS) if not np.array_equal(labels, base_labels)]
        tasks += [
            Task(base.tessellation, base.scene, labels, f"round {number}, row {row}")
            for row, labels in enumerate(others, 1)
        ]
    return tasks


def _run(
    work: Design, tasks: list[Task], until: Deadline, strength: float, number: int, say: Callable[[str], None]
) -> None:
    """Move the joints of layouts in worker processes, and add each to the trials when it is done."""
    jobs = work.options.jobs
    waves = max(1, int(until.remaining() / _LEAST_MOVE))
    tasks = tasks[: jobs * waves]
    each = min(until.remaining() / max(1, math.ceil(len(tasks) / jobs)), _LONGEST)
    refused: dict[str, None] = {}
    with Pool(jobs) as pool:
        for outcome in pool.run(moved_trial, [(task, strength, _SLACK * each) for task in tasks]):
            if isinstance(outcome, Trial):
                work.trials = [*work.trials, outcome]
            else:
                refused[outcome] = None
    for words in refused:
        say(f"round {number}      joints cannot move: {words}")


@one_thread()
def moved_trial(task: Task, strength: float, seconds: float) -> Trial | str:
    """Move the joints of one layout, and bound its λ by fields."""
    try:
        weak = with_crushing(task.scene, strength)
        moved = move_joints(weak, build_assembly(weak), task.labels, seconds=_MOVING * seconds)
        scene = with_materials_of(moved.scene, task.scene)
        assembly = build_assembly(scene)
        fields = field_bounds(assembly, assembly.labels, (1.0 - _MOVING) * seconds)
    except InputError as error:
        return f"{error.where}: {error.problem}".lstrip(": ")
    result = solve_rigid(assembly)
    words = f"{task.words}, {moved.end}"
    return Trial(task.tessellation, "moved", scene, result.load_factor, faces_of(result.bracket), fields, words)


_WRITING: Final = (0.05, 2.0)  # share of the time limit, and seconds, that are kept back for page and pictures

_OVER: Final = (0.05, 2.0)  # share of the time limit, and seconds, by the larger of which a design may end late

_PICTURE: Final = 1.5  # processor time of the picture, s; it is left out where that would end late

# Share of the time limit after which no further tessellation is cut; with hundreds of cells each takes seconds
_CUTTING: Final = 0.3

# time in which layouts of one tessellation are solved once it is cut: share of the limit, at most seconds
_SCREENING, _LONGEST_SCREENING = 0.01, 1.0

# Message of a design that is stopped before it knows a layout
_NOTHING: Final = "stopped while the outline was cut into blocks; nothing was solved and nothing is written"

_SEARCHES: Final = 0.15  # share of the time for the coarse searches of all tessellations

# least time of the search of one tessellation, s, in at most this share of a short time limit
_LEAST, _SHORT = 5.0, 0.6

_USUAL: Final = 0.05  # share of the time that is left after the searches for bounds by fields of the usual layout

_LEAST_BOUNDS: Final = 0.3  # shortest time in which bounds by fields are begun, s

_CHECKS: Final = 0.12  # share of the time for the checks of the winner

_FIELDS: Final = 0.25  # share of the time of a coarse search for the bounds by fields of its best layout

_TABLES: Final = 0.85  # share of the time of a search in space for the search itself; its tables take the rest

_MOVED: Final = 12.0  # shortest time in which joints are moved, s

# Share of the time limit for bounds of the most promising layouts: one more mesh often doubles the lower bound
_REFINING: Final = 0.15

_USUAL_BONDS: Final = ("bond", "walls")  # names of the tessellations whose stated layout is the usual one

_WAVES: Final = 2  # number of times that bounds of the most promising layouts are refined

_REFINED: Final = 0.9  # share of the time of a wave that is planned: workers begin and the last mesh is finished

Say = Callable[[str], None]  # called with messages


@one_thread()
def design_outline(
    file: Path, folder: Path, options: DesignOptions, announce: Say | None = None, *, started: float | None = None
) -> Design:
    """Design the blocks of an outline, and write its files; Interrupted after a signal."""
    deadline = Deadline(options.seconds, started)
    say = announce or (lambda _: None)
    files.require_folder(folder)
    existed = folder.exists()
    if existed and any(folder.iterdir()):
        raise InputError(str(folder), "the folder is not empty", "an empty or new folder")
    try:
        work = Design(options, read_outline(file, options), folder)
    except Interrupted as stop:
        stop.words = _NOTHING
        raise
    # writing takes longer on a busy machine, by the ratio of wall-clock to processor time so far
    busy = busy_factor(deadline.elapsed(), time.process_time())
    until = deadline.earlier(_WRITING[0] * options.seconds + busy * _WRITING[1])
    try:
        _take_steps(work, deadline, until, say)
    except Interrupted as stop:
        stop.words = _write_best_so_far(work, deadline)
        raise
    work.seconds = deadline.elapsed()
    if work.winner is None:
        shutil.rmtree(folder)
        if existed:
            folder.mkdir()
        reasons = "; ".join(f"{name}: {words}" for name, words in work.search_words.items())
        remedy = "weaker limits, a longer time, or a smaller load"
        raise InputError(str(file), f"no layout keeps the limits and stands ({reasons})", remedy)
    # a picture takes seconds on a busy machine
    write_design(work, pictures=deadline.remaining() + max(_OVER[0] * options.seconds, _OVER[1]) > busy * _PICTURE)
    return work


def _take_steps(work: Design, deadline: Deadline, until: Deadline, say: Say) -> None:
    """Cut, search, move, refine and check, with a first page as soon as searches end."""
    _cut(work, deadline, say)
    work.folder.mkdir(parents=True, exist_ok=True)
    _search_all(work, until, say)
    work.seconds = deadline.elapsed()
    write_design(work, pictures=False)
    _bound_usual(work, until)
    _move_best(work, until, say)
    _refine_promising(work, until, say)
    if work.winner is not None:
        work.checks = check_winner(work, until.within(2.0 * _CHECKS * work.options.seconds), say)


def _write_best_so_far(work: Design, deadline: Deadline) -> str:
    """Write what an interrupted design has found, if anything, and say so."""
    if not work.trials and not work.folder.exists():
        return _NOTHING
    work.stop, work.seconds = "interrupted", deadline.elapsed()
    work.folder.mkdir(parents=True, exist_ok=True)
    write_design(work)
    return f"stopped; the best so far is in {work.folder}" if work.winner else "stopped; no layout was found yet"


def _cut(work: Design, deadline: Deadline, say: Say) -> None:
    """Cut the outline in every way; solve a few layouts of each tessellation once it is cut."""
    # So a layout is known early, and a search knows which tessellations promise most.
    untold: list[str] = []
    seconds = min(_SCREENING * work.options.seconds, _LONGEST_SCREENING)

    def made(tessellation: Tessellation) -> None:
        work.tessellations.append(tessellation)
        untold.append(
            f"{tessellation.name:<12} {tessellation.words if tessellation.scene is not None else tessellation.problem}"
        )
        if tessellation.scene is None:
            return
        while untold:
            say(untold.pop(0))
        if work.usual is None and tessellation.name in _USUAL_BONDS:
            _solve_usual(work)
        _screen_tessellation(work, tessellation, tessellation.scene, seconds, deadline)

    tessellations(work.outline.scene, work.options, deadline.within(_CUTTING * work.options.seconds), made)
    for words in untold:
        say(words)


def _screen_tessellation(
    work: Design, tessellation: Tessellation, scene: Scene, seconds: float, deadline: Deadline
) -> None:
    """Solve layouts of a tessellation for some seconds; the strongest of all so far becomes a trial."""
    name = tessellation.name
    try:
        screening = screen(scene, work.options.seed, seconds, deadline)
    except InputError as error:
        work.search_words[name] = f"{error.where}: {error.problem}".lstrip(": ")
        return
    work.screened[name] = screening
    outcome = ": none of them stands" if screening.labels is None else ""
    work.search_words[name] = f"{screening.count} layouts, not proven{outcome}"
    strongest = max((trial.upper_estimate for trial in work.ranked), default=-math.inf)
    if screening.labels is not None and screening.load_factor > strongest:
        _add(work, tessellation, labelled(scene, screening.assembly, screening.labels), UNPROVEN)


def _add(work: Design, tessellation: Tessellation, scene: Scene, fields: Bounds | None, seconds: float = 0.0) -> None:
    """Add the layout that a scene states to the trials in the place of a weaker one."""
    assembly = build_assembly(scene)
    result = solve_rigid(assembly)
    if fields is None:
        fields = field_bounds(assembly, assembly.labels, seconds)
    name, words = tessellation.name, work.search_words[tessellation.name]
    trial = Trial(name, "searched", scene, result.load_factor, faces_of(result.bracket), fields, words)
    others = [trial for trial in work.trials if (trial.tessellation, trial.kind) == (name, "searched")]
    if not any(other.order() < trial.order() for other in others):
        work.trials = [*(trial for trial in work.trials if trial not in others), trial]


def _solve_usual(work: Design) -> None:
    """Solve the stated layout of the usual bond by faces, and add it to the trials."""
    # Gains are measured by this layout. Nothing is added if the outline cannot be cut in a bond.
    first = next(
        (
            tessellation
            for tessellation in work.tessellations
            if tessellation.scene is not None and tessellation.name in _USUAL_BONDS
        ),
        None,
    )
    if first is None or first.scene is None:
        return
    assembly = build_assembly(first.scene)
    result = solve_rigid(assembly)
    try:
        allowed = bool(feasible(search_space(first.scene, assembly), assembly.labels[None])[0])
    except InputError:  # limits that nothing satisfies: the search says so
        allowed = False
    faces = (-math.inf, -math.inf) if result.status is Status.UNSTABLE else faces_of(result.bracket)
    work.trials.append(
        Trial(first.name, "stated", first.scene, result.load_factor, faces, UNPROVEN, "no search", allowed)
    )


def _bound_usual(work: Design, until: Deadline) -> None:
    """Bound λ of the usual layout, if any, by fields in a small share of the time."""
    usual = work.usual
    if usual is not None and _USUAL * until.remaining() > _LEAST_BOUNDS:
        assembly = build_assembly(usual.scene)
        fields = field_bounds(assembly, assembly.labels, _USUAL * until.remaining(), lower_first=False)
        work.trials = [replace(trial, fields=fields) if trial is usual else trial for trial in work.trials]


def _search_all(work: Design, until: Deadline, say: Say) -> None:
    """Search the labels of every tessellation in equal times; bound their best by fields."""
    fitting = [
        tessellation
        for tessellation in work.tessellations
        if tessellation.scene is not None and tessellation.name in work.screened
    ]
    seconds_left = until.remaining()
    total = max(_SEARCHES * seconds_left, min(_LEAST * len(fitting), _SHORT * seconds_left))
    if not _moves(work):  # searches get that time as well
        refining = _REFINING if work.outline.scene.dimension == 2 else 0.0
        total = (1.0 - _CHECKS - refining) * seconds_left
    # in a short time the most promising tessellations are searched, instead of all with a few layouts each
    fitting = sorted(fitting, key=lambda tessellation: -work.screened[tessellation.name].load_factor)
    seconds_each = max((work.screened[tessellation.name].search_seconds for tessellation in fitting), default=_LEAST)
    fitting = fitting[: max(1, round(total / min(seconds_each, _LEAST)))]
    all_searches = until.within(total)
    for number, tessellation in enumerate(fitting):
        one_search = all_searches.within(all_searches.remaining() / (len(fitting) - number))
        if one_search.remaining() < 1.0:
            continue
        try:
            _search(work, tessellation, one_search)
        except InputError as error:
            work.search_words[tessellation.name] = f"{error.where}: {error.problem}".lstrip(": ")
        except Interrupted as stop:
            if isinstance(stop.done, Exploration):
                _keep(work, tessellation, stop.done, 0.0)
            raise
        best = [trial for trial in work.trials if trial.tessellation == tessellation.name and trial.kind == "searched"]
        say(f"{tessellation.name:<12} " + (_words_of_trial(best[-1]) if best else work.search_words[tessellation.name]))


def _search(work: Design, tessellation: Tessellation, until: Deadline) -> None:
    """Search one tessellation, and keep its best layouts in the design."""
    if tessellation.scene is None:
        raise ValueError("a tessellation without a scene is not searched")
    options = work.options
    planar = tessellation.scene.dimension == 2
    # the bounds by fields take the rest; in space the tables of the search do
    seconds = ((1.0 - _FIELDS) if planar else _TABLES) * until.remaining()
    settings = ExploreSettings(seconds=seconds, jobs=options.jobs, seed=options.seed, pictures=False, check_fields=0)
    scene = searched_scene(tessellation.scene)
    exploration = explore(scene, work.folder / "searches" / tessellation.name, settings)
    _keep(work, tessellation, exploration, until.remaining())


def _keep(work: Design, tessellation: Tessellation, exploration: Exploration, seconds: float) -> None:
    """Add the first stable layout of a search to the trials, with bounds by fields."""
    facts = exploration.summary.facts
    number, proven = facts["evaluated"], "proven" if facts["proven"] else "not proven"
    work.search_words[tessellation.name] = f"{number} layout{'s' * (number != 1)}, {proven}"
    table = exploration.results[exploration.results["status"].isin([str(Status.COLLAPSE), str(Status.LOCKED)])]
    if not len(table):
        work.search_words[tessellation.name] += ": none of them stands"
        return
    labels = from_string(str(table.iloc[0]["labelling"]))
    work.layouts[tessellation.name] = best_labels(exploration, LAYOUTS)
    # the search has faces crush, the scene of the tessellation may not
    original = tessellation.scene if tessellation.scene is not None else exploration.scene
    scene = labelled(original, exploration.assembly, labels)
    _add(work, tessellation, scene, None if seconds > 0.0 else UNPROVEN, seconds)


def _words_of_trial(trial: Trial) -> str:
    """Describe λ by faces and by fields, for the terminal."""
    low, high = trial.fields
    bracket = f"at most {high:.4g}" if math.isinf(low) else f"{low:.4g} to {high:.4g}"
    bracket = "it falls under its own weight" if high < 0.0 else bracket
    by_fields = "" if trial.fields == UNPROVEN else f", by fields {bracket}"
    return f"{trial.by_faces}{by_fields}; {trial.words}"


def _move_best(work: Design, until: Deadline, say: Say) -> None:
    """Move joints of the best layouts, and search their labels again, in a share of the time."""
    if not _moves(work):
        return
    deadline = until.earlier((_CHECKS + _REFINING) * work.options.seconds)
    if deadline.remaining() > _MOVED:
        say(f"joints       move, {deadline.remaining():.0f} s")
        move_in_rounds(work, deadline, say)


def _moves(work: Design) -> bool:
    """Return whether joints may move: in the plane, without a limit on shapes or laying."""
    return work.outline.scene.dimension == 2 and work.options.shapes is None and work.options.laid is None


def _refine_promising(work: Design, until: Deadline, say: Say) -> None:
    """Refine the bounds by fields of layouts that may exceed the winner, in worker processes."""
    jobs = work.options.jobs
    deadline = until.earlier(_CHECKS * work.options.seconds)
    with Pool(jobs) as pool:
        for wave in range(_WAVES):
            proven = work.winner.proven if work.winner is not None else -math.inf
            open_trials = [entry for entry in work.ranked if entry.scene.dimension == 2 and entry.fields[1] > proven]
            # the winner, and what may carry most
            promising = (
                open_trials[:1] + sorted(open_trials[1:], key=lambda entry: -entry.upper_estimate)[: max(1, jobs) - 1]
            )
            seconds = deadline.remaining() / (_WAVES - wave)
            if seconds < 1.0 or not promising:
                return
            bounds = pool.run(refined_bounds, [(entry.scene, _REFINED * seconds) for entry in promising])
            for refined, (low, high) in zip(promising, bounds, strict=True):
                low, high = max(low, refined.fields[0]), min(high, refined.fields[1])
                better = replace(refined, fields=(low, high))
                work.trials = [better if trial is refined else trial for trial in work.trials]
                say(f"{refined.tessellation:<12} {refined.kind}: by fields {low:.4g} to {high:.4g}")


@one_thread()
def refined_bounds(scene: Scene, seconds: float) -> Bounds:
    assembly = build_assembly(scene)
    return field_bounds(assembly, assembly.labels, seconds)
