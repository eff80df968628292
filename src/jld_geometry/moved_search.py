"""Search labels and geometry in turns: move the best layouts, then search again."""

from __future__ import annotations

import html
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core import (
    Assembly,
    Bits,
    Deadline,
    Floats,
    InputError,
    ParameterError,
    Scene,
    SolveOptions,
    Status,
    build_assembly,
    files,
    one_thread,
)
from jld_core.fields import governing_bounds, problem
from jld_core.limit import number
from jld_core.scene import move as scene_move
from jld_explore import Exploration, ExploreSettings, Interrupted, busy_factor, explore, search_space
from jld_explore.evaluation import Pool
from jld_explore.report import csv_of
from jld_explore.space import feasible, from_string, to_string
from jld_geometry.convex_cells import vertex_mesh
from jld_geometry.field_search import move_by_fields
from jld_geometry.moved_scene import MovedScene
from jld_geometry.search import GeometrySearch

_MOVING: Final = 0.8  # share of a task's time in which joints move; first bounds by fields take the rest

_FIRST: Final = 10.0  # longest time for the first bounds by fields of one layout, s

_REFINED: Final = 120.0  # longest time for refined bounds by fields of one layout, s

_NONE: Final = (-math.inf, math.inf)  # bounds where nothing is proven


@dataclass(frozen=True, eq=False)
class MovedLayout:
    number: int  # round, from 1
    row: int  # row of the layout in the results of that round; 0 for the layout that the scene states
    labels: Bits  # (m,) True = dry
    # start, load_factor: λ by faces before and after; NaN where the layout did not stand
    start: float
    load_factor: float
    # fields_start, fields: bounds on λ by fields before and after, with blocks that crack anywhere;
    # infinite where there are none
    fields_start: tuple[float, float]
    fields: tuple[float, float]
    end: str  # reason why the optimisation ended, or why the joints cannot move
    scene: Scene  # scene with the joints where the lower bound by fields is larger: at the end, or at the start
    # places, moved: (v, 2) positions of the vertices of this scene, and how far each moved in this round
    places: Floats
    moved: Floats

    @property
    def low(self) -> float:
        """Largest proven lower bound on λ by fields."""
        return max(self.fields_start[0], self.fields[0])

    @property
    def high(self) -> float:
        """Upper bound on λ by fields of the layout in `scene`; inf if there is none."""
        return self.fields[1] if self.moved.any() else self.fields_start[1]


@one_thread()
def move_one(
    scene: Scene, assembly: Assembly, labels: Bits, number: int, row: int, seconds: float, gap: float
) -> MovedLayout:
    """Move the joints of one layout, and bound λ by fields before, for row 0, and after."""
    # The bounds before are computed only for the layout of the scene (row 0).
    limit = min((1.0 - _MOVING) * seconds, _FIRST)
    # the layout that the scene states is what a gain is measured by
    before = _bounds(assembly, labels, limit, gap) if row == 0 else _NONE
    mesh = vertex_mesh(assembly)
    unmoved = MovedScene(scene, assembly, labels, mesh).at(mesh.places)
    still = MovedLayout(
        number, row, labels, math.nan, math.nan, before, _NONE, "", unmoved, mesh.places, np.zeros_like(mesh.places)
    )
    try:
        done = move_by_fields(scene, assembly, labels, seconds=_MOVING * seconds, starts=None)
    except InputError as error:
        # this layout stays where it is; the reason stands in the table
        return replace(still, end=f"{error.where}: {error.problem}")
    end, after = done.end, _NONE
    try:
        if done.after is not None:
            after = _bounds(done.after.assembly, labels, limit, gap)
    except InputError as error:  # a load may have lost the face on which it is spread
        end = f"{error.where}: {error.problem}"
    still = replace(still, start=done.start, load_factor=done.value, fields=after, end=end)
    if not done.moved.any() or not after > before:
        return still
    return replace(still, scene=done.scene, places=done.places, moved=done.moved)


def refine_one(layout: MovedLayout, seconds: float, gap: float) -> MovedLayout:
    """Return a layout with narrower bounds by fields."""
    assembly = build_assembly(layout.scene)
    low, high = _bounds(assembly, assembly.labels, min(seconds, _REFINED), gap)
    bracket = layout.fields if layout.moved.any() else layout.fields_start
    best = (max(bracket[0], low), min(bracket[1], high))
    return replace(layout, fields=best) if layout.moved.any() else replace(layout, fields_start=best)


@one_thread()
def _bounds(assembly: Assembly, labels: Bits, seconds: float, gap: float) -> tuple[float, float]:
    return governing_bounds(assembly, labels, seconds, gap=gap, lower_first=False)


def rank_key(layout: MovedLayout) -> tuple[float, int, int]:
    """Return the sort key of a moved layout: by lower bound, then round, then row."""
    return -layout.low, layout.number, layout.row


_GAIN: Final = 0.01  # relative increase of the lower bound by fields below which a further round is no improvement

_ROUND: Final = 0.6  # share of the remaining time for one round of labels and geometry

_SEARCH: Final = 0.15  # share of a round's time for its search of labels

# Share of a round's time in which joints move; refined bounds of the most promising layouts take the rest
_TASKS: Final = 0.5


_SLACK: Final = 0.8  # share of a task's time that is planned: the last step, mesh and solve of each part are finished

_WRITING: Final = 2.5  # time kept back from a limit for table, picture and page, s

_LEAST: Final = 4.0  # shortest time in which a further round can find anything, s


GAP: Final = 0.05  # default of the relative width of brackets by fields at which their refinement ends


@dataclass(frozen=True)
class MovedSearch:
    first: Exploration  # search of labels on the grid of the scene
    rounds: list[Exploration]  # searches of all rounds, the first one as well
    layouts: list[MovedLayout]  # all layouts that were moved, the largest lower bound by fields first
    stop: str  # reason why the search ended

    @property
    def best(self) -> MovedLayout:
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
    """Alternate between a search of labels and the optimisation of joints, docs/method.md chapter 11.

    Raises Interrupted after a signal; once layouts were moved, its `done` is the result so far.
    """
    # docs/method.md, chapter 11
    settings = settings or ExploreSettings()
    whole = Deadline(settings.seconds, started)
    # writing takes longer on a busy machine, by the ratio of wall-clock to processor time so far
    deadline = whole.earlier(_WRITING * busy_factor(whole.elapsed(), time.process_time()))
    # a scene whose key "move" is complete: vertices follow, and masses are those of the search
    move = scene.move or scene_move.Move(inner="follow")
    if move.block_mass == [None, None]:
        move = move.model_copy(update={"block_mass": list(scene.search.block_mass)})
    scene = scene.model_copy(update={"move": move})
    _refuse(scene, layouts, settings)
    rounds = _Rounds(scene, folder, layouts, settings, deadline, gap, announce, keep)
    try:
        with Pool(settings.jobs) as pool:
            stop = rounds.run(pool)
    except Interrupted as signal:
        if rounds.searches and rounds.moved:
            signal.done = rounds.result("interrupted")
        raise
    return rounds.result(stop)


@dataclass
class _Rounds:
    """Rounds of a search of labels and a move of joints."""

    scene: Scene
    folder: Path
    layouts: int  # number of layouts that move in a round
    settings: ExploreSettings
    deadline: Deadline
    gap: float
    announce: Callable[[str], None] | None
    keep: Callable[[list[MovedLayout]], None] | None  # called with the layouts so far, ranked
    searches: list[Exploration] = field(default_factory=list)  # one of each round
    moved: list[MovedLayout] = field(default_factory=list)  # all layouts that were moved

    def result(self, stop: str) -> MovedSearch:
        return MovedSearch(self.searches[0], self.searches, sorted(self.moved, key=rank_key), stop)

    def run(self, pool: Pool) -> str:
        """Search labels and move joints until a deadline; return the reason of the end."""
        while True:
            number, before = len(self.searches) + 1, self.moved[0].low if self.moved else -math.inf
            seconds = self.deadline.remaining() * _ROUND
            try:
                self._search_labels(number, seconds)
            except InputError as error:
                if not self.searches:
                    raise
                return f"the moved grid cannot be searched: {error}"
            self._move_joints(pool, number, seconds)
            strongest = self.moved[0].low
            self._say(f"round {number}: by fields λ ≥ {strongest:.6g}")
            if strongest > before + _GAIN * abs(before) or number == 1:
                if self.deadline.remaining() > _LEAST:
                    continue
                return "time limit"
            if self.deadline.limited and self.deadline.remaining() > _LEAST:
                self.moved = _refined(self.moved, pool, self.settings.jobs, self.deadline.remaining(), self.gap)
            return "nothing improves"

    def _search_labels(self, number: int, seconds: float) -> None:
        """Search the labels of the strongest grid so far in a share of the time of a round."""
        scene = self.moved[0].scene if self.moved else self.scene
        folder = self.folder if number == 1 else self.folder / f"round-{number}"
        limit = seconds * _SEARCH if self.deadline.limited else None
        done = explore(scene, folder, replace(self.settings, seconds=limit), announce=self.announce)
        self.searches.append(done)

    def _move_joints(self, pool: Pool, number: int, seconds: float) -> None:
        """Move the joints of the best layouts of the last search, and rank all by their bounds."""
        done, jobs, limited = self.searches[-1], self.settings.jobs, self.deadline.limited
        tasks = _chosen(done, self.layouts, own=number == 1)
        self._say(f"round {number}: the joints of {len(tasks)} layouts move")
        each = _SLACK * _TASKS * seconds / max(math.ceil(len(tasks) / jobs), 1) if limited else math.inf
        arguments = [(done.scene, done.assembly, labels, number, row, each, self.gap) for row, labels in tasks]
        self.moved += pool.run(move_one, arguments)
        self._keep()
        seconds_left = min(seconds * (1.0 - _SEARCH - _TASKS) if limited else math.inf, self.deadline.remaining())
        self.moved = _refined(self.moved, pool, jobs, seconds_left, self.gap)
        if self.moved and self.moved[0].low == -math.inf:  # bounds on coarse meshes may be none: spend what is left
            self.moved = _refined(self.moved, pool, jobs, self.deadline.remaining(), self.gap)
        if not self.moved or self.moved[0].low == -math.inf:
            raise InputError("move", "no layout of the search stands by fields", "a scene that stands, or more time")
        self._keep()

    def _say(self, words: str) -> None:
        if self.announce is not None:
            self.announce(words)

    def _keep(self) -> None:
        if self.keep is not None:
            self.keep(sorted(self.moved, key=rank_key))


def _refined(layouts: list[MovedLayout], pool: Pool, count: int, seconds: float, gap: float) -> list[MovedLayout]:
    """Refine the bounds of layouts that may still be best, greatest upper bounds first; rank all."""
    proven = max((layout.low for layout in layouts), default=-math.inf)
    open_ones = [layout for layout in layouts if layout.high > proven + gap * abs(proven)]
    promising = sorted(open_ones, key=lambda layout: (-layout.high, *rank_key(layout)))[:count]
    refined = pool.run(refine_one, [(layout, _SLACK * seconds, gap) for layout in promising])
    return sorted([*(layout for layout in layouts if layout not in promising), *refined], key=rank_key)


def _refuse(scene: Scene, layouts: int, settings: ExploreSettings) -> None:
    """Raise InputError for scenes and settings that exclude a move of joints."""
    if layouts < 1:
        raise ParameterError("move", f"{layouts} is no number of layouts", "a whole number from 1")
    plain = SolveOptions(gap=settings.model.gap, solver=settings.model.solver, condense=settings.model.condense)
    for name, is_set in (
        ("resume", settings.resume),
        ("certificate", settings.certificate is not None),
        ("robust", settings.robust),
        ("experiment", settings.experiment is not None or settings.by_experiment),
        ("reliability", settings.reliability is not None),
        ("cluster", settings.cluster is not None),
        ("objective", settings.own_objective is not None or settings.model.friction != "associative"),
        ("contact", settings.model != plain),
    ):
        if is_set:
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
    problem.require_planar_fields(assembly)
    # paths, ties and limits are checked with every candidate dry, where most vertices move
    space = search_space(scene, assembly)
    GeometrySearch(scene, assembly, space.fixed | space.candidates)


def _chosen(done: Exploration, count: int, *, own: bool) -> list[tuple[int, Bits]]:
    """Return row and labels (m,) of the best layouts of a round; own: also row 0, the scene's own."""
    chosen: list[tuple[int, Bits]] = []
    labels = done.assembly.labels
    if own and feasible(search_space(done.scene, done.assembly), labels[None])[0]:
        chosen.append((0, labels))
    table = done.results[done.results["status"].isin([str(Status.COLLAPSE), str(Status.LOCKED)])]
    for row, text in zip(table.index[:count].tolist(), table["labelling"].head(count).tolist(), strict=True):
        labels = from_string(str(text))
        if not any(np.array_equal(labels, other) for _, other in chosen):
            chosen.append((int(row) + 1, labels))
    return chosen


# files that a search of labels and geometry adds to the folder of its first round
FILES: Final = ("moved.csv", "moved.json", "moved.png", "moved.html")

_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1b1b1b; }}
table {{ border-collapse: collapse; }} td, th {{ padding: .2rem .8rem; text-align: right; }}
thead th {{ border-bottom: 1px solid #888; }} img {{ max-width: 100%; }}
td:last-child, th:last-child {{ text-align: left; }}
</style></head><body>
<h1>{title}</h1>
<p>{words}</p>
<p><a href="moved.json">Scene of the best layout</a>, <a href="moved.csv">table</a>, searches of labels: {rounds}.</p>
<img src="moved.png" alt="Best layout before and after its joints moved">
<p>Layouts whose joints moved, ranked by the lower bound of λ by fields (blocks may crack anywhere). Row 0 is the
layout that the scene states; a dash means that nothing is proven.</p>
{table}
</body></html>
"""


def moved_table(done: MovedSearch) -> pd.DataFrame:
    """Return one row per moved layout, ranked by the lower bound of λ by fields."""
    rows = []
    for rank, layout in enumerate(done.layouts, 1):
        low, high = layout.fields_start
        moved_low, moved_high = layout.fields
        rows.append(
            {
                "rank": rank,
                "round": layout.number,
                "row": layout.row,
                "start": layout.start,
                "load_factor": layout.load_factor,
                "fields_lo_start": low if math.isfinite(low) else math.nan,
                "fields_hi_start": high if math.isfinite(high) else math.nan,
                "fields_lo": moved_low if math.isfinite(moved_low) else math.nan,
                "fields_hi": moved_high if math.isfinite(moved_high) else math.nan,
                "end": layout.end,
                "labelling": to_string(layout.labels),
            }
        )
    return pd.DataFrame(rows)


def moved_facts(done: MovedSearch) -> dict[str, Any]:
    """Return the entry "moved" of summary.json and of the terminal's JSON."""
    best = done.best
    unmoved = next((layout for layout in done.layouts if layout.row == 0), None)
    bounds = best.fields if best.moved.any() else best.fields_start
    return {
        "rounds": len(done.rounds),
        "layouts": len(done.layouts),
        "stated": None if unmoved is None else [number(end) for end in unmoved.fields_start],
        "fields_lo": number(bounds[0]),
        "fields_hi": number(bounds[1]),
        "round": best.number,
        "row": best.row,
        "labelling": to_string(best.labels),
        "load_factor": number(best.load_factor),
        "stop": done.stop,
        "scene": FILES[1],
    }


def words_of_move(facts: dict[str, Any]) -> str:
    """Return what a search with moved joints found, as a line."""
    low, high = (_decimals(facts[name]) for name in ("fields_lo", "fields_hi"))
    text = f"best with moved joints: {low} ≤ λ ≤ {high} by fields (round {facts['round']}, row {facts['row']})"
    if facts["stated"] is not None:
        least, most = (_decimals(end) for end in facts["stated"])
        text += f"; the layout of the scene: {least} ≤ λ ≤ {most}"
    return f"{text}; rounds: {facts['rounds']}, layouts moved: {facts['layouts']}, ended: {facts['stop']}"


def write_moved(done: MovedSearch, folder: Path, *, pictures: bool = True) -> dict[str, Any]:
    """Write table, scene, picture and page of moved layouts; return the entry "moved"."""
    table, facts, best = moved_table(done), moved_facts(done), done.best
    files.write_text(folder / FILES[0], csv_of(table))
    files.write_text(folder / FILES[1], best.scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
    summary = {**done.first.summary.to_json(), "moved": facts}
    files.write_text(folder / "summary.json", json.dumps(summary, indent=1))
    if not pictures:
        return facts
    from jld_views import figure_of_move, figures

    before, after = done.first.assembly, build_assembly(best.scene)
    # vertices of later rounds start where the former round left them
    moved = best.moved if best.number == 1 else np.zeros_like(best.moved)
    bounds = f"{_decimals(facts['fields_lo'])} ≤ λ ≤ {_decimals(facts['fields_hi'])} by fields"
    titles = ("layout of the scene", f"best moved layout: {bounds}")
    figure = figure_of_move(before, after, best.labels, best.places, moved, titles, before.labels)
    figures.save_figure(figure, folder / FILES[2])
    links = ", ".join(
        f'<a href="{"" if k == 1 else f"round-{k}/"}report.html">round {k}</a>' for k in range(1, len(done.rounds) + 1)
    )
    shown = table.drop(columns=["labelling"]).to_html(index=False, float_format=_decimals, na_rep="–", border=0)
    title = html.escape(f"{done.first.scene.name}: layouts with moved joints")
    page = _PAGE.format(title=title, words=html.escape(words_of_move(facts)), rounds=links, table=shown)
    files.write_text(folder / FILES[3], page)
    return facts


def _decimals(value: float | None) -> str:
    return "none" if value is None else f"{value:.5g}"
