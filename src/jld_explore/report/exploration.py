"""A finished study, as tables and words."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.exchange import Layout
from jld_core.limit import LimitAnalysisResult, SolveOptions, Status
from jld_core.models import solve
from jld_core.scene import Scene
from jld_core.shown import Shown
from jld_explore.space import from_string
from jld_explore.study import StopReason


@dataclass(frozen=True)
class Exploration(Shown):
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

    def layout(self, rank: int = 1) -> Layout:
        """One layout as blocks, by its place among the ranked rows of the results, 1 the strongest.

        Raises InputError where there is none of this rank.
        """
        return Layout(self.scene, self.assembly, from_string(str(self._row(rank)["labelling"])))

    def result(self, rank: int = 1) -> LimitAnalysisResult:
        """The limit analysis of one layout, by the model of the search. Raises InputError as `layout`."""
        return solve(self.assembly, self.layout(rank).labels, **vars(self.model))

    def blocks(self, rank: int = 1) -> pd.DataFrame:
        """The blocks of one layout, columns as in blocks.csv. Raises InputError as `layout`."""
        return pd.DataFrame(self.layout(rank).table())

    def _row(self, rank: int) -> Any:
        ranked = self.results[self.results["status"] == str(Status.COLLAPSE)]
        if not 1 <= rank <= len(ranked):
            expected = f"1 to {len(ranked)}" if len(ranked) else "a search that found a layout that collapses"
            raise InputError("--rank", f"{self.folder} has no layout of rank {rank}", expected)
        return ranked.iloc[rank - 1]
