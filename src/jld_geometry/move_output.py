"""Write the result of `jld move`: scene, table, picture, and text."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.files import write_text
from jld_core.scene import Scene
from jld_explore.cli.samples import write_scene
from jld_explore.report import csv_of


def write_move(
    scene: Scene,
    table: list[dict[str, Any]],
    before: Assembly,
    after: Assembly | None,
    labels: Bits,
    places: Floats,
    moved: Floats,
    titles: tuple[str, str],
    out: Path,
) -> None:
    """Write scene, table and picture of moved joints to files of one name.

    labels: (m,) True = dry. places, moved: (v, 2) vertices after the move and their displacements, scene units.
    """
    import pandas as pd  # slow to import and needed for tables only

    names = ["start", "step", "value", "bracket_lo", "bracket_hi", "predicted", "radius", "solves", "seconds"]
    rows = pd.DataFrame(table)
    write_scene(scene, out)
    write_text(out.with_suffix(".csv"), csv_of(rows[[name for name in names if name in rows]]))
    if after is None:
        return
    from jld_core.views.figures import save_figure
    from jld_core.views.moved_joints import figure_of_move

    save_figure(figure_of_move(before, after, labels, places, moved, titles), out.with_suffix(".png"))


def value_text(value: float | None) -> str:
    """Return a number as text for the terminal."""
    return "none" if value is None or math.isnan(value) else "locked" if value == math.inf else f"{value:.6g}"


def json_number(value: float) -> float | None:
    """Return a float for JSON, None where it is not finite."""
    return float(value) if math.isfinite(value) else None
