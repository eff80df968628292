"""Pages of finished searches and of single scenes: which rows and which forces they hold."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.limit import LimitAnalysisResult, governing_result, result_of
from jld_core.mechanics import require_materials
from jld_core.models import SolveOptions, limit_analysis, solve_labelling
from jld_core.scene import Scene
from jld_core.views import facts_of_assembly, facts_of_result
from jld_explore.report import words
from jld_explore.report.exploration import Exploration
from jld_explore.report.page import page
from jld_explore.report.page_data import cases_of, page_data, solution_of, within
from jld_explore.report.page_table import chosen_rows, curve_of, facts_of_summary, table_of
from jld_explore.report.reading import history_of
from jld_explore.space import cut, search_space

if TYPE_CHECKING:
    import pandas as pd

NAME: Final = "report.html"
"""The page in a study's folder."""

SOLVED: Final = 50
"""Rows from the top whose forces and mechanism a page holds, besides those of the front."""

PATIENCE: Final = 1.5
"""Seconds after which no further row is solved for a page: a search with a time limit must end soon after it."""

DEAR: Final = 1.0
"""Seconds past a deadline that solving the best row may take."""

HOW: Final = "To get them: jld solve FOLDER --rank {rank}, or jld plot FOLDER --rank {rank}."


def study_page(done: Exploration, patience: float = PATIENCE, dear: float = math.inf) -> str:
    """HTML of a finished search, self-contained. patience, dear: see `study_data`."""
    return page(study_data(done, patience, dear=dear))


def scene_page(scene: Scene, assembly: Assembly) -> str:
    """HTML of a scene with its own labels, solved."""
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
    kind: str = "report",
    studio: Mapping[str, Any] | None = None,
    dear: float = math.inf,
) -> dict[str, Any]:
    """The data of the page of a search, as `page_data` has it.

    patience: seconds for solving what is drawn; the best come first. dear: seconds above which even the first is left
    out, by what its evaluation took.
    """
    rows = chosen_rows(done.results, done.front)
    axes = done.scene.search.front.axes
    history = history_of(done.folder)
    curves = [] if history is None else [curve_of(str(done.summary["driver"]), history)]
    left_out = len(done.results) - len(rows)
    return page_data(
        kind=kind,
        scene=done.scene,
        assembly=done.assembly,
        candidates=search_space(done.scene, done.assembly).candidates[: len(done.assembly.interfaces)],
        facts={**words.facts_of_exploration(done), **facts_of_summary(done.summary, done.results)},
        warnings=[str(text) for text in done.summary.get("warnings", [])],
        how=HOW,
        table=table_of(rows, done.front, done.assembly, axes=axes, left_out=left_out),
        solutions=_solutions(rows, done, patience, dear),
        convergence=curves,
        summary=done.summary,
        studio=studio,
    )


class CaseSolver:
    """Solves labellings of one assembly under each of its load cases, on templates that are built once.

    Threads may share it: they take turns.
    """

    def __init__(self, assembly: Assembly, model: SolveOptions | None = None) -> None:
        """model: default associative friction, as `solve` has it."""
        self.assembly, self.model = assembly, model or SolveOptions()
        self._turn = threading.Lock()  # an analysis holds one solver, which is one thread's at a time
        self._analyses = [limit_analysis(case, self.model, reference=assembly.labels) for case in assembly.by_case]

    def solve(self, labels: Bits, stands: bool = False) -> LimitAnalysisResult:
        """One labelling (m,). stands: also decide whether it stands without live load.

        Raises InputError where a material that it needs is missing.
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


def _solutions(rows: pd.DataFrame, done: Exploration, patience: float, dear: float) -> dict[int, dict[str, Any]]:
    start = time.perf_counter()
    found: dict[int, dict[str, Any]] = {}
    solver = CaseSolver(done.assembly, done.model)
    for place in _worth(rows, done.front):
        if (found and time.perf_counter() - start > patience) or float(rows["seconds"].iloc[place]) > dear:
            break
        text = str(rows["labelling"].iloc[place])
        rest, labels = cut(done.assembly, text)
        whole = rest is done.assembly
        result = (solver if whole else CaseSolver(rest, done.model)).solve(labels)
        found[place] = solution_of(result) if whole else within(solution_of(result), done.assembly, text)
    return dict(sorted(found.items()))


def _worth(rows: pd.DataFrame, front: pd.DataFrame) -> Sequence[int]:
    """Positions of the rows whose forces are worth most: the best, the front, the following."""
    ranked = np.flatnonzero(rows["rank"].notna())[:SOLVED].tolist()
    edge = np.flatnonzero(rows.index.isin(front.index)).tolist()
    return list(dict.fromkeys([*ranked[:1], *edge, *ranked]))


def write_report(
    done: Exploration, out: Path | None = None, patience: float = PATIENCE, deadline: Deadline | None = None
) -> Path:
    """Write the page of a search into its folder, or into `out`. Returns the file.

    patience: seconds for solving what is drawn, the best first; no more than is left to the deadline.
    """
    dear = math.inf
    if deadline is not None and deadline.limited:
        patience, dear = min(patience, deadline.remaining()), deadline.remaining() + DEAR
    from jld_explore.report.folder import write_text

    target = (out or done.folder) / NAME
    write_text(target, study_page(done, patience, dear))
    return target
