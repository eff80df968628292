"""A finished study, as tables and words."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.exchange import Layout
from jld_core.limit import LimitAnalysisResult, SolveOptions, Status
from jld_core.models import solve
from jld_core.notebook_repr import NotebookRepr
from jld_core.scene import Scene
from jld_explore.space import cut
from jld_explore.study import StopReason

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Exploration(NotebookRepr):
    """A finished study: its tables (columns as in results.csv), its summary and its folder.

    results: one row per class, ranked. front: those of its rows that are on the front. summary: as in summary.json.
    model: what was modelled. In a notebook it shows what was found, the front with its layouts, and the first rows
    of both tables.
    """

    scene: Scene
    assembly: Assembly
    results: pd.DataFrame
    front: pd.DataFrame
    summary: dict[str, Any]
    folder: Path
    stop_reason: StopReason
    model: SolveOptions = field(default_factory=SolveOptions)

    def __repr__(self) -> str:
        best = self.summary["best"]
        found = (
            "none ranked" if best is None else f"best λ = {best:.9g}" + (", proven" if self.summary["proven"] else "")
        )
        return f"Exploration({self.scene.name!r}, {len(self.results)} classes, {found}, in {self.folder})"

    def layout(self, rank: int | None = None) -> Layout:
        """One layout as blocks: that of the N-th row of the results, default the strongest.

        Rows that tie share a rank and keep their order, so that N tells them apart; rows without a rank, those that
        are locked, uncertified or unstable, follow after. Raises InputError where there is no such row.
        """
        return Layout(self.scene, *cut(self.assembly, str(self.row(rank)["labelling"])))

    def result(self, rank: int | None = None) -> LimitAnalysisResult:
        """The limit analysis of one layout, by the model of the search; rank as in `layout`."""
        layout = self.layout(rank)
        return solve(layout.assembly, layout.labels, **vars(self.model))

    def blocks(self, rank: int | None = None) -> pd.DataFrame:
        """The blocks of one layout, columns as in blocks.csv; rank as in `layout`."""
        import pandas as pd  # slow to import, and for tables alone

        return pd.DataFrame(self.layout(rank).table())

    def row(self, rank: int | None = None) -> pd.Series[Any]:
        """The N-th row of the results, default the strongest layout. Raises InputError where there is none."""
        ranked = int(np.count_nonzero(self.results["status"] == str(Status.COLLAPSE)))
        if rank is None and not ranked:
            problem = f"no layout of {self.folder} has a load factor to be ranked by"
            raise InputError("--rank", problem, f"a row of results.csv, 1 to {len(self.results)}")
        number = 1 if rank is None else rank
        if not 1 <= number <= len(self.results):
            expected = (
                f"1 to {len(self.results)}, the rows of results.csv" if len(self.results) else "a search with rows"
            )
            raise InputError("--rank", f"{self.folder} has no layout of rank {number}", expected)
        return self.results.iloc[number - 1]
