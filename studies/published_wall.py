"""A wall of 4 × 4 cells whose layouts others compared: all 10 012 tilings into blocks of at most two cells, ranked.

Source: repository qianqing-wanggg/mosek_optim (EPFL 2022), commit 581bef2: layouts and load factors of
grid4_canti_3layouts.py and of its readme, study 2. Only numbers and the corners of blocks are restated.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from jld_core import Scene, build_assembly, parse_scene, solve
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.limit.result import LimitAnalysisResult
from jld_explore import ExploreSettings
from jld_views.figures import draw_mechanism
from studies.report import (
    PAIRED,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    legend_at,
    name_axes,
    searched,
    without_legend,
    write,
)

NAME: Final = "published_wall"
CELLS: Final = 4
FRICTION: Final = 0.58

LAYOUTS: Final = {
    "classical": ("abbc", "ddee", "fggh", "iijj"),
    "efficient": ("aabb", "cdde", "ffgg", "hhii"),
    "efficientPro": ("aabb", "cdde", "cffe", "gghh"),
    "3": ("abcd", "effg", "hhii", "jklm"),
    "4": ("abcd", "ebff", "gghi", "jklm"),
    "5": ("abcd", "ebfg", "hhii", "jklm"),
    "6": ("abcd", "efgg", "hhij", "klim"),
    "7": ("abcd", "efgh", "ijjk", "llmm"),
}
"""The eight layouts of the repository by its names: one letter per cell, the same letter in cells of one block."""

PUBLISHED: Final = {
    "3": 11.419514678075792,
    "4": 11.227424439243126,
    "5": 11.251869922487803,
    "6": 11.286324310041346,
    "7": 11.554451006525497,
}
"""Load factors with friction on all joints, as that repository prints them."""

PRINTED_WITHOUT: Final = {"classical": 11.92, "efficient": 11.58, "efficientPro": 11.72}
"""What its readme prints for the other three: values without friction on vertical joints."""


STRENGTHS: Final = (100.0, 30.0, 10.0)
"""Tensile strengths of bricks that crack, in weights of a cell over its face; each may shear at twice that."""


def wall(tension: float = 1e6, shear: float = 1e6) -> Scene:
    """Return the wall: 4 × 4 cells of weight 1 under a cap of weight 96, which a horizontal load of 4 λ pushes.

    tension, shear: strengths of bricks; by default they never crack.
    """
    elements: list[dict[str, Any]] = []
    for row in range(CELLS):
        for column in range(CELLS):
            x, y = column, CELLS - 1 - row
            outline = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]]
            elements.append({"id": f"c{column}r{row}", "polygon": outline, "weight": 1.0})
    elements.append({"id": "cap", "polygon": [[0, 4], [4, 4], [4, 5], [0, 5]], "weight": 96.0})
    elements.append({"id": "base", "polygon": [[0, -1], [4, -1], [4, 0], [0, 0]], "support": True})
    pairs = [[f"c{i}r{j}", f"c{i + 1}r{j}"] for i in range(CELLS - 1) for j in range(CELLS)]
    pairs += [[f"c{i}r{j}", f"c{i}r{j + 1}"] for i in range(CELLS) for j in range(CELLS - 1)]
    return parse_scene(
        {
            "name": "wall of 4 × 4 cells",
            "units": {"length": "unit", "force": "unit weight"},
            "elements": elements,
            "materials": {
                "gravity": 1.0,
                "dry": {"friction_coefficient": FRICTION},
                "inner": {"tensile_strength": tension, "shear_strength": shear},
            },
            "loads": {"live": [{"element": "cap", "force": [4.0, 0.0]}]},
            "labels": {"default": "dry"},
            "search": {"candidates": pairs, "block_cells": [1, 2], "except": ["cap"], "symmetry": "none"},
        }
    )


def labels_of(rows: tuple[str, ...]) -> Bits:
    """Return the labels (m,), True = dry, of a layout drawn with one letter per cell."""
    assembly = build_assembly(wall())
    block = {f"c{i}r{j}": rows[j][i] for i in range(CELLS) for j in range(CELLS)}
    ids, faces = assembly.elements.ids, assembly.interfaces
    sides = [(block.get(ids[a], ids[a]), block.get(ids[b], ids[b])) for a, b in zip(faces.a, faces.b, strict=True)]
    return np.array([one != other for one, other in sides])


def layout(name: str) -> LimitAnalysisResult:
    """Solve one of the eight layouts."""
    return solve(build_assembly(wall()), labels_of(LAYOUTS[name]))


def by_fields(name: str, tension: float, gap: float = 0.03, seconds: float = 30.0) -> tuple[float, float]:
    """Bound λ of one of the eight layouts whose bricks may crack anywhere."""
    found = bounds_by_fields(
        build_assembly(wall(tension, 2.0 * tension)), labels_of(LAYOUTS[name]), gap=gap, seconds=seconds
    )
    return found.lower, found.upper


def _fields_said(bounds: dict[float, dict[str, tuple[float, float]]]) -> str:
    """Say which of the eight layouts may be the strongest by fields, for each strength of bricks."""
    said = []
    for tension, of in bounds.items():
        most = max(low for low, _ in of.values())
        left = [name for name, (_, high) in of.items() if high >= most]
        said.append(f"{most:.2f} and more at σt = {tension:g}, by {' or '.join(left)}")
    return (
        "Where bricks may crack anywhere (fields; τ = 2 σt, in weights of a cell over its face), the strongest of the "
        "eight carries " + "; ".join(said) + "."
    )


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Enumerate all tilings, place the eight layouts among them, write table, picture and page; return the table."""
    done = searched(wall(), ExploreSettings(pictures=False, driver="enumeration", jobs=1))
    found = done.results
    factors = np.sort(found["load_factor"].to_numpy(dtype=float))[::-1]
    rows: list[dict[str, Any]] = []
    bounds = {tension: {name: by_fields(name, tension) for name in LAYOUTS} for tension in STRENGTHS}
    for name in LAYOUTS:
        own = layout(name)
        rows.append(
            {
                "layout": name,
                "dry_faces": int(own.labels[build_assembly(wall()).free_faces].sum()),
                "load_factor": own.load_factor,
                "published": PUBLISHED.get(name, np.nan),
                "printed": PRINTED_WITHOUT.get(name, np.nan),
                "place": int((factors > own.load_factor * (1.0 + 1e-9)).sum()) + 1,
            }
            | {f"fields, σt = {tension:g}": "{:.3f} to {:.3f}".format(*of[name]) for tension, of in bounds.items()}
        )
    table = pd.DataFrame(rows).sort_values("load_factor", ascending=False)
    counts = sorted(set(found["dry_faces"].astype(int).tolist()))
    front = [float(found.loc[found["dry_faces"] == count, "load_factor"].max()) for count in counts]
    best = done.summary
    report = Report(
        name=NAME,
        title="A wall whose layouts others compared",
        question="Is the strongest of eight published layouts the strongest of all?",
        source="Repository qianqing-wanggg/mosek_optim (EPFL 2022), commit 581bef2, grid4_canti_3layouts.py and "
        "readme, study 2; numbers only.",
        model=f"4 × 4 cells of weight 1 under a cap of weight 96 that 4 λ pushes sideways; μ = {FRICTION}, unbreakable "
        "blocks of at most two cells, all joints of the cap and the base dry.",
        agrees=(
            f"All {len(found)} tilings are solved and proven; the strongest carries {best.best:.6f}, and classical is "
            f"one of {int((factors >= factors[0] * (1.0 - 1e-9)).sum())} with it. The best by dry faces: "
            + ", ".join(f"{count}: {value:.6f}" for count, value in zip(counts, front, strict=True))
            + ".",
            "The five load factors that the readme prints with all digits are met to "
            f"{max(abs(row['load_factor'] / row['published'] - 1.0) for row in rows if row['published'] > 0):.0e}.",
        ),
        differs=(
            "The readme prints 11.92, 11.58 and 11.72 for classical, efficient and efficientPro beside five values of "
            "the other kind: they are those without friction on vertical joints. With friction, as in that program's "
            "own matrices, they carry "
            + ", ".join(f"{layout(name).load_factor:.6f}" for name in PRINTED_WITHOUT)
            + "; the order of the three stays.",
            _fields_said(bounds),
            "The source gives no strength of bricks: these are ours. Only the eight were bounded by fields, not all "
            "tilings.",
        ),
        pictures={
            "": "Left: all tilings by the number of dry faces, and the eight layouts. Right: mechanisms of the "
            "strongest and the weakest of the eight."
        },
    )  # fmt: skip
    write(out, report, table, {"": _picture(found, table)}, table)
    return table


def _picture(found: pd.DataFrame, table: pd.DataFrame) -> Figure:
    """Draw all tilings with the eight layouts among them, and two mechanisms."""
    figure = figure_of(12.8, 6.4)
    ax = axes_at(figure, 0.8, 1.0, 5.2, 4.6)
    spread = np.random.default_rng(1).uniform(-0.3, 0.3, len(found))
    ax.plot(found["dry_faces"] + spread, found["load_factor"], ".", ms=1.5, color="#9A9A9A", label="all tilings")
    ax.plot(table["dry_faces"], table["load_factor"], "o", mfc="none", ms=8, color=PAIRED[0][0], label="published")
    for row in table.itertuples():
        ax.annotate(str(row.layout), (row.dry_faces, row.load_factor), (6, 4), textcoords="offset points", fontsize=8)
    name_axes(ax, "dry faces between cells", "λ [–]")
    ax.legend(frameon=False, fontsize=9, loc="lower left")
    for column, name in enumerate((str(table["layout"].iloc[0]), str(table["layout"].iloc[-1]))):
        drawing = axes_at(figure, 6.6 + 3.1 * column, 1.4, 2.8, 3.8)
        result = layout(name)
        draw_mechanism(drawing, result)
        without_legend(drawing, f"{name}: λ = {result.load_factor:.4g}")
    legend_at(figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open"), 6.6, 0.3, 5)
    figure.suptitle("Eight published layouts among all tilings", fontsize=12, y=0.98)
    return figure
