"""A finished study, as tables and words."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from jld_core.assembly import Assembly
from jld_core.limit import SolveOptions
from jld_core.scene import Scene
from jld_core.shown import Shown
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
