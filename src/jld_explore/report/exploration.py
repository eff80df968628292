"""Represent a finished study by its tables and its summary."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.errors import ParameterError
from jld_core.exchange import Layout
from jld_core.limit import LimitAnalysisResult, SolveOptions, Status
from jld_core.models import solve_by_elements, solve_by_fields
from jld_core.models.by_fields import FieldResult
from jld_core.notebook_repr import NotebookRepr
from jld_core.parameters import require_kind
from jld_core.scene import Scene
from jld_core.scene.cracks import FieldCracks, cracks_in_short
from jld_explore.report.summary import Summary
from jld_explore.space.void import cut
from jld_explore.study_state import StopReason

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

FIELD_PICTURE: Final = 2.0
"""Default time for bounds by fields that are drawn, for each load case, s."""


@dataclass(frozen=True)
class Exploration(NotebookRepr):
    """Finished study with its tables, summary and folder.

    A notebook shows facts, the front with its layouts, and the first rows of both tables.

    Attributes
    ----------
    scene : Scene
        Scene of the search.
    assembly : Assembly
        Structure without the sink of void cells.
    results : DataFrame
        One row per class, ranked, with the columns of results.csv.
    front : DataFrame
        Rows of `results` on the front, with a column `evidence`.
    summary : Summary
        Best layout, proof and course of the search, as in summary.json.
    folder : Path
        Results folder.
    stop_reason : StopReason
        Reason why the search ended.
    model : SolveOptions
        Model of the search.
    """

    shown_by: ClassVar[str] = "jld_explore.report.notebook:ExplorationView"

    scene: Scene
    assembly: Assembly
    results: pd.DataFrame
    front: pd.DataFrame
    summary: Summary
    folder: Path
    stop_reason: StopReason
    model: SolveOptions = field(default_factory=SolveOptions)

    def __repr__(self) -> str:
        best, proven = self.summary.best, ", proven" if self.summary.proven else ""
        found = (
            "none ranked"
            if best is None
            else f"best λ = {best:.9g}{proven}, cracks {cracks_in_short(self.scene.cracks)}"
        )
        if best is not None and self.scene.cracks == "faces" and self.summary.by_fields is not None:
            low, high = ("none" if end is None else f"{end:.4g}" for end in self.summary.by_fields)
            found += f", [{low}, {high}] by fields"
        found += ", falls without live load" if self.summary.stands_at_zero is False else ""
        return f"Exploration({self.scene.name!r}, {len(self.results)} classes, {found}, in {self.folder})"

    def plot(self) -> Figure:
        """Draw λ against the counts of the front, with the layouts on the front.

        Returns
        -------
        matplotlib.figure.Figure
            Figure; save it by `savefig`.
        """
        figure: Figure = self.drawn()
        return figure

    def layout(self, rank: int | None = None) -> Layout:
        """Return one layout as blocks.

        Rows that tie share a rank but keep their order, so `rank` is the number of the row.
        Rows without a rank (locked, uncertified or unstable) follow after those with one.

        Parameters
        ----------
        rank : int, optional
            Number of the row of the results, from 1. Default: the strongest layout.

        Returns
        -------
        Layout
            Blocks of the layout.

        Raises
        ------
        InputError
            If there is no such row.
        """
        return Layout(self.scene, *cut(self.assembly, str(self.row(rank)["labelling"])))

    def result(self, rank: int | None = None) -> LimitAnalysisResult:
        """Return the limit analysis of one layout, solved by the model of the search.

        Parameters
        ----------
        rank : int, optional
            Number of the row of the results, from 1. Default: the strongest layout.

        Returns
        -------
        LimitAnalysisResult
            Result, on finer cells where the scene's blocks crack by cells.

        Raises
        ------
        InputError
            If there is no such row, or blocks crack by fields.
        """
        layout = self.layout(rank)
        return solve_by_elements(layout.assembly, layout.labels, self.model, "a picture of forces")

    def field_result(self, rank: int | None = None, seconds: float = FIELD_PICTURE) -> FieldResult:
        """Return both bounds by fields on λ of one layout, with stresses and velocities.

        Parameters
        ----------
        rank : int, optional
            Number of the row of the results, from 1. Default: the strongest layout.
        seconds : float
            Time for each load case, s; one mesh is always solved.

        Returns
        -------
        FieldResult
            Bounds refined to the gap of the scene, or to 0.05 where the search was by faces or cells.

        Raises
        ------
        InputError
            If there is no such row, or fields do not apply to the scene.
        """
        layout, cracks = self.layout(rank), self.scene.cracks
        gap = cracks.gap if isinstance(cracks, FieldCracks) else FieldCracks(kind="fields").gap
        return solve_by_fields(layout.assembly, layout.labels, gap=gap, seconds=seconds)

    def blocks(self, rank: int | None = None) -> pd.DataFrame:
        """Return the blocks of one layout as a table, with the columns of blocks.csv.

        `rank`, and the errors, are as in `layout`.
        """
        import pandas as pd  # slow to import and needed for tables only

        return pd.DataFrame(self.layout(rank).table())

    def row(self, rank: int | None = None) -> pd.Series[Any]:
        """Return one row of the results: the strongest layout, or the row number `rank` from 1.

        Parameters
        ----------
        rank : int, optional
            Number of the row. Default: the strongest layout.

        Returns
        -------
        Series
            Values by column of results.csv.

        Raises
        ------
        InputError
            If there is no such row, or without `rank` no layout has a load factor.
        """
        ranked = int(np.count_nonzero(self.results["status"] == str(Status.COLLAPSE)))
        if rank is None and not ranked:
            problem = f"no layout of {self.folder} has a load factor to be ranked by"
            raise ParameterError("rank", problem, f"a row of results.csv, 1 to {len(self.results)}")
        number = 1 if rank is None else rank
        require_kind("rank", number, int)
        if not 1 <= number <= len(self.results):
            expected = (
                f"1 to {len(self.results)}, the rows of results.csv" if len(self.results) else "a search with rows"
            )
            raise ParameterError("rank", f"{self.folder} has no layout of rank {number}", expected)
        return self.results.iloc[number - 1]
