"""Joints of the best layouts of a design: moved in rounds, with labels searched again in between."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.build import build_assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.limit import Status
from jld_core.models import solve_rigid
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_explore import ExploreSettings
from jld_explore.evaluation import Pool
from jld_explore.explore import explore
from jld_explore.report import Exploration
from jld_explore.space import from_string
from jld_geometry.optimise import move_joints
from jld_practice.design.crushing import with_crushing, with_materials_of
from jld_practice.design.trials import Design, Trial, faces_of, field_bounds

LAYOUTS: Final = 2
"""Number of layouts of one search whose joints are moved."""

_LEAST: Final = 8.0  # shortest time in which the joints of one layout are moved and its λ is bounded, s

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


def best_labels(done: Exploration, count: int) -> list[Bits]:
    """Return the labels (m,) of the best `count` layouts of a search that collapse or are locked."""
    table = done.results[done.results["status"].isin([str(Status.COLLAPSE), str(Status.LOCKED)])]
    return [from_string(str(text)) for text in table["labelling"].head(count)]


def move_in_rounds(work: Design, until: Deadline, say: Callable[[str], None]) -> None:
    """Move the joints of the best layouts in rounds, and add what is found to the trials."""
    share, strength, number = _FIRST, 1.0, 1
    tasks = _first_tasks(work)
    while tasks and until.remaining() > _LEAST:
        before = work.winner.proven if work.winner is not None else -math.inf
        _run(work, tasks, until.within(share * until.remaining()), strength, number, say)
        best = work.winner.proven if work.winner is not None else -math.inf
        say(f"round {number}      {len(tasks)} layouts moved: by fields λ ≥ {best:.4g}")
        if number > 2 and not best > before + _GAIN * abs(before):
            strength *= _WEAKER
        share, strength, number = _ROUND, strength * _WEAKER, number + 1
        searches = until.within(_SEARCH * share * until.remaining())
        tasks = _further_tasks(work, searches, strength, number) if until.remaining() > 2.0 * _LEAST else []


def _first_tasks(work: Design) -> list[Task]:
    """Return the layouts of the first round: the best of each tessellation, then the second best, then stated ones."""
    scenes = {one.name: one.scene for one in work.tessellations if one.scene is not None}
    found: list[Task] = []
    ranked = sorted((one for one in work.allowed if one.kind == "searched"), key=lambda one: -one.most)
    for number in range(LAYOUTS):
        for trial in ranked:
            layouts = work.layouts.get(trial.tessellation, [])
            if number < len(layouts):
                found.append(Task(trial.tessellation, scenes[trial.tessellation], layouts[number], f"row {number + 1}"))
    usual = work.usual
    if usual is not None and usual.allowed and usual.stands:
        assembly = build_assembly(scenes[usual.tessellation])
        found.append(Task(usual.tessellation, scenes[usual.tessellation], assembly.labels, "as stated"))
    return found


def _further_tasks(work: Design, until: Deadline, strength: float, number: int) -> list[Task]:
    """Search labels on the best moved cells; return the layouts of a further round."""
    moved = [one for one in work.allowed if one.kind == "moved"]
    bases = moved[:1]
    bases += sorted((one for one in moved if one not in bases), key=lambda one: -one.most)[: _BASES - 1]
    found: list[Task] = []
    for k, base in enumerate(bases):
        own = build_assembly(base.scene).labels
        found.append(Task(base.tessellation, base.scene, own, f"round {number}, its own labels"))
        seconds = until.remaining() / (len(bases) - k)
        if seconds < _LEAST / 2.0:
            continue
        settings = ExploreSettings(
            seconds=seconds, jobs=work.options.jobs, seed=work.options.seed, pictures=False, check_fields=0
        )
        folder = work.folder / "moved" / f"round-{number}-{k + 1}"
        try:
            done = explore(with_crushing(base.scene, strength), folder, settings)
        except InputError:  # no layout was found in the time: its own labels move on
            continue
        others = [labels for labels in best_labels(done, LAYOUTS) if not np.array_equal(labels, own)]
        found += [
            Task(base.tessellation, base.scene, labels, f"round {number}, row {row}")
            for row, labels in enumerate(others, 1)
        ]
    return found


def _run(
    work: Design, tasks: list[Task], until: Deadline, strength: float, number: int, say: Callable[[str], None]
) -> None:
    """Move the joints of layouts in worker processes, and add each to the trials when it is done."""
    jobs = work.options.jobs
    waves = max(1, int(until.remaining() / _LEAST))
    tasks = tasks[: jobs * waves]
    each = min(until.remaining() / max(1, math.ceil(len(tasks) / jobs)), _LONGEST)
    refused: dict[str, None] = {}
    with Pool(jobs) as pool:
        for found in pool.run(moved_trial, [(task, strength, _SLACK * each) for task in tasks]):
            if isinstance(found, Trial):
                work.trials = [*work.trials, found]
            else:
                refused[found] = None
    for words in refused:
        say(f"round {number}      joints cannot move: {words}")


@one_thread()
def moved_trial(task: Task, strength: float, seconds: float) -> Trial | str:
    """Move the joints of one layout, and bound its λ by fields."""
    try:
        weak = with_crushing(task.scene, strength)
        done = move_joints(weak, build_assembly(weak), task.labels, seconds=_MOVING * seconds)
        scene = with_materials_of(done.scene, task.scene)
        assembly = build_assembly(scene)
        fields = field_bounds(assembly, assembly.labels, (1.0 - _MOVING) * seconds)
    except InputError as error:
        return f"{error.where}: {error.problem}".lstrip(": ")
    found = solve_rigid(assembly)
    words = f"{task.words}, {done.end}"
    return Trial(task.tessellation, "moved", scene, found.load_factor, faces_of(found.bracket), fields, words)
