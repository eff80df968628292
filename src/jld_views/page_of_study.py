"""Make pages of finished searches and single scenes, and choose the layouts they contain."""

from __future__ import annotations

import base64
import html
import io
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from jld_core import Assembly, Deadline, DeadlinePassed, LimitAnalysisResult, Scene, files
from jld_core.build import weight_facts
from jld_core.models import CaseAnalysis
from jld_core.scene import cracks
from jld_core.views import facts_of_assembly, facts_of_result
from jld_explore import Exploration, search_space
from jld_explore.report import reading, words
from jld_explore.space import cut
from jld_views import notebook
from jld_views.page_contract import PageData, Picture, Solution
from jld_views.page_data import (
    MOST,
    chosen_rows,
    curve_of,
    facts_of_summary,
    page,
    page_data,
    solution_of,
    table_of,
    within,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


NAME: Final = "report.html"  # file name of the page in the folder of a study

SOLVED: Final = 50  # best rows whose forces and mechanism a page holds, besides those of the front

PATIENCE: Final = 0.5  # s, after which no further row is solved for a page: a search must end soon after its time limit

DEAR: Final = 0.3  # s after a deadline that solving the best row may take

# Time of a row that is solved alone, with forces and mechanism, as a multiple of that of its evaluation
_AGAIN: Final = 2.0

# sentence of the page on how to get forces that it does not hold
HOW: Final = "To get them: jld solve FOLDER --rank {rank}, or jld plot FOLDER --rank {rank}."


def study_page(done: Exploration, patience: float = PATIENCE, dear: float = math.inf) -> str:
    """Make the self-contained HTML page of a finished search."""
    return page(study_data(done, patience, dear=dear))


def scene_page(scene: Scene, assembly: Assembly) -> str:
    """Solve a scene with its own labels, and return the HTML page that shows the result."""
    return page(result_data(scene, CaseAnalysis(assembly).solve(assembly.labels, stands=True)))


def result_data(scene: Scene | None, result: LimitAnalysisResult) -> PageData:
    assembly, solution = result.assembly, solution_of(result)
    return page_data(
        kind="report",
        scene=scene,
        assembly=assembly,
        candidates=assembly.free_faces,
        facts={
            **facts_of_assembly(assembly),
            **({} if scene is None else weight_facts(scene, assembly)),
            **facts_of_result(result),
        },
        solutions={0: solution},
        pictures=path_pictures(assembly, solution),
    )


def study_data(
    done: Exploration,
    patience: float = PATIENCE,
    kind: Literal["report", "studio"] = "report",
    studio: Mapping[str, Any] | None = None,
    dear: float = math.inf,
    most: int = MOST,
    solved: int = SOLVED,
) -> PageData:
    rows = chosen_rows(done.results, done.front, most)
    axes = done.scene.search.front.axes
    history = reading.history_of(done.folder)
    curves = [] if history is None else [curve_of(str(done.summary.driver), history)]
    left_out = len(done.results) - len(rows)
    # rigid elements of the joint grid have other forces than what cracks elsewhere
    solutions = _solutions(rows, done, patience, dear, solved) if done.scene.cracks == "faces" else {}
    best = solutions.get(int(np.flatnonzero(rows["rank"].notna())[0])) if rows["rank"].notna().any() else None
    return page_data(
        kind=kind,
        scene=done.scene,
        assembly=done.assembly,
        candidates=search_space(done.scene, done.assembly).candidates[: len(done.assembly.interfaces)],
        facts={
            **words.facts_of_exploration(done),
            **facts_of_summary(done.summary.facts, done.results),
            **weight_facts(done.scene, done.assembly),
        },
        warnings=[str(text) for text in done.summary.warnings],
        how=HOW,
        table=table_of(rows, done.front, done.assembly, axes=axes, left_out=left_out),
        solutions=solutions,
        convergence=curves,
        pictures=[*_pictures(done), *([] if best is None else path_pictures(done.assembly, best))],
        summary=done.summary.facts,
        studio=studio,
    )


def _pictures(done: Exploration) -> list[Picture]:
    """Return the picture of the best layout by fields, which the folder has once it was drawn."""
    path = done.folder / "best.png"
    if not isinstance(done.scene.cracks, cracks.FieldCracks) or not path.exists():
        return []
    title = "The strongest layout: labels, stress trajectories of its lower bound, cracks of its upper bound"
    return [{"title": title, "png": base64.b64encode(path.read_bytes()).decode("ascii")}]


def path_pictures(assembly: Assembly, solution: Solution) -> list[Picture]:
    """Return the picture of λ along the paths of moving loads, none without any."""
    if all(case.place is None for case in assembly.cases):
        return []
    from jld_views.moved_joints import PathValue, figure_of_path  # importing matplotlib takes longer than many pages

    values = []
    for case, solved in zip(assembly.cases, solution["cases"], strict=True):
        low, high = (math.nan if end is None else end for end in solved["bracket"])
        if case.place is not None:
            values.append(PathValue(*case.place, low, high, case.required))
    image = io.BytesIO()
    figure_of_path(assembly, values).savefig(image, format="png", dpi=130)
    title = "λ of the strongest layout along the paths of moving loads"
    return [{"title": title, "png": base64.b64encode(image.getvalue()).decode("ascii")}]


def _solutions(rows: pd.DataFrame, done: Exploration, patience: float, dear: float, solved: int) -> dict[int, Solution]:
    """Solve rows in order of importance until time runs out; return solutions by position."""
    # The most important row is solved even after `patience` seconds. Solving ends at the first row that is expected to
    # take longer than `dear` seconds, and `dear` seconds after the begin.
    start, latest = time.perf_counter(), Deadline(dear)
    solutions: dict[int, Solution] = {}
    solver = CaseAnalysis(done.assembly, done.model)
    for row in _worth(rows, done.front, solved):
        if (solutions and time.perf_counter() - start > patience) or _AGAIN * float(rows["seconds"].iloc[row]) > dear:
            break
        text = str(rows["labelling"].iloc[row])
        structure, labels = cut(done.assembly, text)
        is_whole = structure is done.assembly
        try:
            with latest.enforced():
                result = (solver if is_whole else CaseAnalysis(structure, done.model)).solve(labels)
        except DeadlinePassed:
            break
        solutions[row] = solution_of(result) if is_whole else within(solution_of(result), done.assembly, text)
    return dict(sorted(solutions.items()))


def _worth(rows: pd.DataFrame, front: pd.DataFrame, solved: int) -> Sequence[int]:
    """Return the positions of rows in the order of solving: best row, front, next ranks."""
    ranked = np.flatnonzero(rows["rank"].notna())[:solved].tolist()
    edge = np.flatnonzero(rows.index.isin(front.index)).tolist()
    return list(dict.fromkeys([*ranked[:1], *edge, *ranked]))


def write_report(
    done: Exploration, out: Path | None = None, patience: float = PATIENCE, deadline: Deadline | None = None
) -> Path:
    """Write the page of a search.

    Parameters
    ----------
    done : Exploration
        The finished search.
    out : Path, optional
        Default: the folder of the study.
    patience : float
        Time limit for solving layouts to be drawn, s; the best come first.
    deadline : Deadline, optional
        Also limits the solves.

    Returns
    -------
    Path
        File written.
    """
    dear = math.inf
    if deadline is not None and deadline.limited:
        patience, dear = min(patience, deadline.remaining()), deadline.remaining() + DEAR
    target = (out or done.folder) / NAME
    files.write_text(target, study_page(done, patience, dear))
    return target


class ExplorationView:
    """Notebook representation of a finished study: facts, front, and first rows of its tables."""

    def drawing(self, thing: Exploration) -> str | bytes | None:
        """Return the front with its layouts as SVG text or PNG; None above `LARGEST` elements."""
        if len(thing.assembly.elements) > notebook.LARGEST:
            return None
        from jld_views.figures import drawing_of
        from jld_views.pictures import front_picture

        return drawing_of(front_picture(thing))

    def figure(self, thing: Exploration, *, ids: bool = False, values: bool = False) -> Figure:
        """Return the figure of the front with its layouts; `ids` and `values` have no effect."""
        from jld_views.pictures import front_picture

        return front_picture(thing)

    def html(self, thing: Exploration, drawing: str | bytes | None) -> str:
        """Return the facts, the drawing and the first rows of both tables as HTML."""
        tables_of = {"strongest": words.best_rows(thing), f"front, {words.front_name(thing)}": thing.front}
        parts = [
            f"<p>{name}</p>{table[words.columns(thing)].to_html(index=False)}" for name, table in tables_of.items()
        ]
        return notebook.page(thing.scene.name, words.facts_of_exploration(thing), drawing, *parts)


@dataclass(frozen=True)
class Page:
    """Interactive page of a search, which a notebook shows in a frame."""

    text: str  # HTML of the page
    height: int = 900  # height of the frame, pixels

    def _repr_html_(self) -> str:
        frame = 'style="width: 100%; border: 1px solid #888" title="the page of a search"'
        return f'<iframe srcdoc="{html.escape(self.text)}" height="{self.height}" {frame}></iframe>'

    def __repr__(self) -> str:
        return f"Page({len(self.text)} characters)"


def show_page(done: Exploration, height: int = 900, patience: float = PATIENCE) -> Page:
    """Make the interactive page of a search for a notebook; no file is written.

    Parameters
    ----------
    done : Exploration
        The finished search.
    height : int
        Height of the frame, pixels.
    patience : float
        Time limit for solving layouts to be drawn, s.

    Returns
    -------
    Page
    """
    return Page(study_page(done, patience), height)
