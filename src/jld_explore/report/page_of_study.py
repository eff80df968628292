"""Make pages of finished searches and single scenes, and choose the layouts they contain."""

from __future__ import annotations

import base64
import math
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.limit import LimitAnalysisResult, governing_result, result_of
from jld_core.mechanics import require_materials
from jld_core.models import SolveOptions, limit_analysis, solve_labelling
from jld_core.scene import Scene
from jld_core.scene.cracks import FieldCracks
from jld_core.views import facts_of_assembly, facts_of_result
from jld_explore.report import words
from jld_explore.report.exploration import Exploration
from jld_explore.report.page import page
from jld_explore.report.page_contract import PageData, Picture, Solution
from jld_explore.report.page_data import cases_of, page_data, solution_of, within
from jld_explore.report.page_table import chosen_rows, curve_of, facts_of_summary, table_of
from jld_explore.report.reading import history_of
from jld_explore.space import search_space
from jld_explore.space.void import cut

if TYPE_CHECKING:
    import pandas as pd

NAME: Final = "report.html"
"""File name of the page in the folder of a study."""

SOLVED: Final = 50
"""Number of best rows whose forces and mechanism a page holds, besides those of the front."""

PATIENCE: Final = 1.5
"""Seconds after which no further row is solved for a page, since a search must end soon after its time limit."""

DEAR: Final = 1.0
"""Seconds after a deadline that solving the best row may take."""

HOW: Final = "To get them: jld solve FOLDER --rank {rank}, or jld plot FOLDER --rank {rank}."
"""Sentence of the page on how to get forces that it does not hold."""


def study_page(done: Exploration, patience: float = PATIENCE, dear: float = math.inf) -> str:
    """Make the self-contained HTML page of a finished search.

    Parameters
    ----------
    done : Exploration
        Finished search.
    patience : float
        Time limit for solving layouts, s (see `study_data`).
    dear : float
        Largest solve time of a layout, s (see `study_data`).

    Returns
    -------
    str
        HTML.
    """
    return page(study_data(done, patience, dear=dear))


def scene_page(scene: Scene, assembly: Assembly) -> str:
    """Make the HTML page of a scene with its own labels, solved.

    Parameters
    ----------
    scene : Scene
        Scene.
    assembly : Assembly
        Assembly of the scene.

    Returns
    -------
    str
        HTML.
    """
    found = CaseSolver(assembly).solve(assembly.labels, stands=True)
    facts = {**facts_of_assembly(assembly), **facts_of_result(found)}
    candidates = assembly.free_faces
    return page(
        page_data(
            kind="report",
            scene=scene,
            assembly=assembly,
            candidates=candidates,
            facts=facts,
            solutions={0: solution_of(found)},
        )
    )


def study_data(
    done: Exploration,
    patience: float = PATIENCE,
    kind: Literal["report", "studio"] = "report",
    studio: Mapping[str, Any] | None = None,
    dear: float = math.inf,
) -> PageData:
    """Assemble the data of the page of a search (see `page_data`).

    Parameters
    ----------
    done : Exploration
        Finished search.
    patience : float
        Time limit for solving layouts to be drawn, s; the best come first.
    kind : str
        "report" or "studio".
    studio : mapping, optional
        Additional data of the studio.
    dear : float
        Solve time, s, above which no layout is solved, not even the first; estimated by the time of its evaluation.

    Returns
    -------
    dict
        Data that can be written as JSON.
    """
    rows = chosen_rows(done.results, done.front)
    axes = done.scene.search.front.axes
    history = history_of(done.folder)
    curves = [] if history is None else [curve_of(str(done.summary.driver), history)]
    left_out = len(done.results) - len(rows)
    return page_data(
        kind=kind,
        scene=done.scene,
        assembly=done.assembly,
        candidates=search_space(done.scene, done.assembly).candidates[: len(done.assembly.interfaces)],
        facts={**words.facts_of_exploration(done), **facts_of_summary(done.summary.facts, done.results)},
        warnings=[str(text) for text in done.summary.warnings],
        how=HOW,
        table=table_of(rows, done.front, done.assembly, axes=axes, left_out=left_out),
        # rigid elements of the joint grid have other forces than what cracks elsewhere
        solutions=_solutions(rows, done, patience, dear) if done.scene.cracks == "faces" else {},
        convergence=curves,
        pictures=_pictures(done),
        summary=done.summary.facts,
        studio=studio,
    )


def _pictures(done: Exploration) -> list[Picture]:
    """Return the picture of the best layout by fields, which the folder has once it was drawn."""
    path = done.folder / "best.png"
    if not isinstance(done.scene.cracks, FieldCracks) or not path.exists():
        return []
    title = "The strongest layout: labels, stress trajectories of its lower bound, cracks of its upper bound"
    return [{"title": title, "png": base64.b64encode(path.read_bytes()).decode("ascii")}]


class CaseSolver:
    """Solver of labellings of one assembly under each of its load cases.

    Templates are built once. Threads may share the solver; they solve one at a time.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    model : SolveOptions, optional
        Model. Default: associative friction, as in `solve`.
    """

    def __init__(self, assembly: Assembly, model: SolveOptions | None = None) -> None:
        """Build the limit analyses of all load cases."""
        self.assembly, self.model = assembly, model or SolveOptions()
        self._turn = threading.Lock()  # A limit analysis may be used by one thread at a time.
        self._analyses = [limit_analysis(case, self.model, reference=assembly.labels) for case in assembly.by_case]

    def solve(self, labels: Bits, stands: bool = False) -> LimitAnalysisResult:
        """Solve one labelling.

        Parameters
        ----------
        labels : (m,) bool array
            Labels, True = dry.
        stands : bool
            Also decide whether the structure stands without live load.

        Returns
        -------
        LimitAnalysisResult
            Result, with load cases that of the governing case.

        Raises
        ------
        InputError
            If a required material is missing.
        """
        require_materials(self.assembly, labels, ~labels)
        found: dict[str, LimitAnalysisResult] = {}
        with self._turn:
            for name, analysis in zip(cases_of(self.assembly), self._analyses, strict=True):
                start = time.perf_counter()
                proof = solve_labelling(analysis, labels, self.model, stands=stands)
                elapsed = time.perf_counter() - start
                found[name] = result_of(analysis.template, labels, self.model, proof, elapsed=elapsed)
        return governing_result(self.assembly, found) if self.assembly.cases else next(iter(found.values()))


def _solutions(rows: pd.DataFrame, done: Exploration, patience: float, dear: float) -> dict[int, Solution]:
    """Solve rows in order of importance until time runs out; return data by position.

    A solve that takes longer than `dear` seconds from now, unlike the evaluation of its row, is given up.
    """
    start, latest = time.perf_counter(), Deadline(dear)
    found: dict[int, Solution] = {}
    solver = CaseSolver(done.assembly, done.model)
    for place in _worth(rows, done.front):
        if (found and time.perf_counter() - start > patience) or float(rows["seconds"].iloc[place]) > dear:
            break
        text = str(rows["labelling"].iloc[place])
        rest, labels = cut(done.assembly, text)
        whole = rest is done.assembly
        try:
            with latest.enforced():
                result = (solver if whole else CaseSolver(rest, done.model)).solve(labels)
        except DeadlinePassed:
            break
        found[place] = solution_of(result) if whole else within(solution_of(result), done.assembly, text)
    return dict(sorted(found.items()))


def _worth(rows: pd.DataFrame, front: pd.DataFrame) -> Sequence[int]:
    """Return the positions of rows to solve, in order: the best, the front, the next ranks."""
    ranked = np.flatnonzero(rows["rank"].notna())[:SOLVED].tolist()
    edge = np.flatnonzero(rows.index.isin(front.index)).tolist()
    return list(dict.fromkeys([*ranked[:1], *edge, *ranked]))


def write_report(
    done: Exploration, out: Path | None = None, patience: float = PATIENCE, deadline: Deadline | None = None
) -> Path:
    """Write the page of a search.

    Parameters
    ----------
    done : Exploration
        Finished search.
    out : Path, optional
        Folder of the page. Default: the folder of the study.
    patience : float
        Time limit for solving layouts to be drawn, s; the best come first.
    deadline : Deadline, optional
        Deadline that also limits the solves.

    Returns
    -------
    Path
        File written.
    """
    dear = math.inf
    if deadline is not None and deadline.limited:
        patience, dear = min(patience, deadline.remaining()), deadline.remaining() + DEAR
    from jld_explore.report.folder import write_text

    target = (out or done.folder) / NAME
    write_text(target, study_page(done, patience, dear))
    return target
