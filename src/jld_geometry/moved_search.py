"""Search labels and geometry in turns: move the best layouts, then search again."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import joblib
import numpy as np

from jld_core.arrays import Bits
from jld_core.build import build_assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError, ParameterError
from jld_core.fields.requirements import require_fields
from jld_core.limit import SolveOptions, Status
from jld_core.scene import Scene
from jld_core.scene.move import Move
from jld_core.threads import one_thread
from jld_explore.explore import explore
from jld_explore.report import Exploration
from jld_explore.settings import ExploreSettings
from jld_explore.space import from_string, search_space
from jld_explore.space.search_space import feasible
from jld_explore.study_state import Interrupted
from jld_explore.writing_time import busy_factor
from jld_geometry.moved_layout import MovedLayout, move_one, rank_key, refine_one
from jld_geometry.search import GeometrySearch

_GAIN: Final = 0.01  # relative increase of the lower bound by fields below which a further round is no improvement

_ROUND: Final = 0.6  # share of the remaining time for one round of labels and geometry

_SEARCH: Final = 0.15  # share of a round's time for its search of labels

# Share of a round's time in which joints move; refined bounds of the most promising layouts take the rest
_TASKS: Final = 0.5


_SLACK: Final = 0.8  # share of a task's time that is planned: the last step, mesh and solve of each part are finished

_WRITING: Final = 2.5  # time kept back from a limit for table, picture and page, s

_LEAST: Final = 4.0  # shortest time in which a further round can find anything, s


GAP: Final = 0.05
"""Default of the relative width of brackets by fields at which their refinement ends."""


@dataclass(frozen=True)
class MovedSearch:
    """Result of a search of labels and geometry.

    first: search of labels on the grid of the scene. rounds: searches of all rounds, the first one as well. layouts:
    all layouts that were moved, the largest lower bound by fields first. stop: reason why the search ended.
    """

    first: Exploration
    rounds: list[Exploration]
    layouts: list[MovedLayout]
    stop: str

    @property
    def best(self) -> MovedLayout:
        """Return the layout with the largest lower bound by fields."""
        return self.layouts[0]


@one_thread()
def explore_and_move(
    scene: Scene,
    folder: Path,
    layouts: int = 3,
    settings: ExploreSettings | None = None,
    announce: Callable[[str], None] | None = None,
    *,
    gap: float = GAP,
    started: float | None = None,
    keep: Callable[[list[MovedLayout]], None] | None = None,
) -> MovedSearch:
    """Alternate between a search of labels and the optimisation of joints.

    scene: planar scene; its key "move" states variables and limits. Without it, vertices of inner faces follow. folder:
    folder of the first search; later ones lie in `round-2`, ... within it. layouts: number of best layouts of each
    round whose joints are moved. settings: settings of each search of labels; its time limit is that of the whole.
    announce: called with messages. gap: relative width of brackets by fields at which their refinement ends. started:
    start of the time limit, as `time.perf_counter` counts, s. Default: now. keep: called with all moved layouts,
    ranked, whenever some were added or bounded; a signal may end the search later. Result: all searches and moved
    layouts, ranked by the lower bound by fields. Raises InputError if the scene or a setting does not fit, or no layout
    stands by fields. Raises Interrupted: after a signal; once layouts were moved, `done` is the result so far.

    docs/method.md, chapter 11.
    """
    settings = settings or ExploreSettings()
    whole = Deadline(settings.seconds, started)
    # writing takes longer on a busy machine, by the ratio of wall-clock to processor time so far
    deadline = whole.earlier(_WRITING * busy_factor(whole.elapsed(), time.process_time()))
    scene = _movable(scene)
    _refuse(scene, layouts, settings)
    say = announce or (lambda _: None)
    rounds: list[Exploration] = []
    found: list[MovedLayout] = []
    try:
        stop = _in_rounds(scene, folder, layouts, settings, deadline, gap, rounds, found, say, announce, keep)
    except Interrupted as signal:
        if rounds and found:
            signal.done = MovedSearch(rounds[0], rounds, sorted(found, key=rank_key), "interrupted")
        raise
    return MovedSearch(rounds[0], rounds, found, stop)


def _in_rounds(
    scene: Scene,
    folder: Path,
    layouts: int,
    settings: ExploreSettings,
    deadline: Deadline,
    gap: float,
    rounds: list[Exploration],
    found: list[MovedLayout],
    say: Callable[[str], None],
    announce: Callable[[str], None] | None,
    keep: Callable[[list[MovedLayout]], None] | None,
) -> str:
    """Search labels and move joints in rounds until a deadline; return the reason of the end.

    rounds, found: receive the searches and the moved layouts, ranked. say: called with messages. The other parameters
    are those of `explore_and_move`, whose errors are raised.
    """
    while True:
        number = len(rounds) + 1
        share = deadline.remaining() * _ROUND
        place = folder if number == 1 else folder / f"round-{number}"
        limit = share * _SEARCH if deadline.limited else None
        try:
            done = explore(
                found[0].scene if found else scene, place, replace(settings, seconds=limit), announce=announce
            )
        except InputError as error:
            if not rounds:
                raise
            return f"the moved grid cannot be searched: {error}"
        rounds.append(done)
        tasks = _chosen(done, layouts, own=number == 1)
        say(f"round {number}: the joints of {len(tasks)} layouts move")
        before = found[0].low if found else -math.inf
        workers = joblib.Parallel(n_jobs=settings.jobs)
        each = _SLACK * _TASKS * share / max(math.ceil(len(tasks) / settings.jobs), 1) if deadline.limited else math.inf
        found += workers(
            joblib.delayed(move_one)(done.scene, done.assembly, labels, number, row, each, gap) for row, labels in tasks
        )
        if keep is not None:
            keep(sorted(found, key=rank_key))
        left = share * (1.0 - _SEARCH - _TASKS) if deadline.limited else math.inf
        found[:] = _refined(found, workers, settings.jobs, min(left, deadline.remaining()), gap)
        if found and found[0].low == -math.inf:  # bounds on coarse meshes may be none: spend what time is left
            found[:] = _refined(found, workers, settings.jobs, deadline.remaining(), gap)
        if not found or found[0].low == -math.inf:
            raise InputError("move", "no layout of the search stands by fields", "a scene that stands, or more time")
        if keep is not None:
            keep(found)
        say(f"round {number}: by fields λ ≥ {found[0].low:.6g}")
        if found[0].low > before + _GAIN * abs(before) or number == 1:
            if deadline.remaining() > _LEAST:
                continue
            return "time limit"
        if deadline.limited and deadline.remaining() > _LEAST:
            found[:] = _refined(found, workers, settings.jobs, deadline.remaining(), gap)
        return "nothing improves"


def _refined(
    found: list[MovedLayout], workers: joblib.Parallel, count: int, seconds: float, gap: float
) -> list[MovedLayout]:
    """Refine the bounds of the most promising layouts, and return all layouts ranked.

    Promising are layouts whose upper bound exceeds the largest lower bound, the greatest upper bounds first. count:
    number of layouts to refine. seconds: time for all of them.
    """
    most = max((one.low for one in found), default=-math.inf)
    open_ones = [one for one in found if one.high > most + gap * abs(most)]
    promising = sorted(open_ones, key=lambda one: (-one.high, *rank_key(one)))[:count]
    refined = workers(joblib.delayed(refine_one)(one, _SLACK * seconds, gap) for one in promising)
    return sorted([*(one for one in found if one not in promising), *refined], key=rank_key)


def _movable(scene: Scene) -> Scene:
    """Return a scene whose key "move" is complete.

    Without the key, vertices of inner faces follow. Without limits of masses, those of the search apply.
    """
    move = scene.move or Move(inner="follow")
    if move.block_mass == [None, None]:
        move = move.model_copy(update={"block_mass": list(scene.search.block_mass)})
    return scene.model_copy(update={"move": move})


def _refuse(scene: Scene, layouts: int, settings: ExploreSettings) -> None:
    """Raise InputError for scenes and settings that exclude the movement of joints."""
    if layouts < 1:
        raise ParameterError("move", f"{layouts} is no number of layouts", "a whole number from 1")
    plain = SolveOptions(gap=settings.model.gap, solver=settings.model.solver, condense=settings.model.condense)
    for name, asked in (
        ("resume", settings.resume),
        ("certificate", settings.certificate is not None),
        ("robust", settings.robust),
        ("experiment", settings.experiment is not None or settings.by_experiment),
        ("reliability", settings.reliability is not None),
        ("cluster", settings.cluster is not None),
        ("objective", settings.own_objective is not None or settings.model.friction != "associative"),
        ("contact", settings.model != plain),
    ):
        if asked:
            raise ParameterError(name, "layouts whose joints move do not support it", "a search without it or `move`")
    if scene.cracks != "faces":
        raise ParameterError("move", "the search of labels needs cracks by faces", '"cracks": "faces"')
    if scene.search.void is not None:
        raise ParameterError("move", "search.void leaves cells out, whose vertices have no place", "a search without")
    if scene.move is not None and scene.move.maximise != "load_factor":
        raise InputError("move.maximise", f'"{scene.move.maximise}" ranks no layouts', '"load_factor"')
    assembly = build_assembly(scene)
    assembly.members.refuse("a move of joints")
    if assembly.dimension != 2:
        raise InputError("elements", "they are spatial", "a planar scene; in space `jld move` moves one layout")
    require_fields(assembly)
    # paths, ties and limits are checked with every candidate dry, where most vertices move
    space = search_space(scene, assembly)
    GeometrySearch(scene, assembly, space.fixed | space.candidates)


def _chosen(done: Exploration, count: int, *, own: bool) -> list[tuple[int, Bits]]:
    """Return row and labels (m,) of the best `count` layouts of a round.

    own: True also includes the layout that the scene states, as row 0, if it is in the search space.
    """
    found: list[tuple[int, Bits]] = []
    labels = done.assembly.labels
    if own and feasible(search_space(done.scene, done.assembly), labels[None])[0]:
        found.append((0, labels))
    table = done.results[done.results["status"].isin([str(Status.COLLAPSE), str(Status.LOCKED)])]
    for row, text in zip(table.index[:count].tolist(), table["labelling"].head(count).tolist(), strict=True):
        one = from_string(str(text))
        if not any(np.array_equal(one, other) for _, other in found):
            found.append((int(row) + 1, one))
    return found
