"""An interlocking flat arch after Leonardo (section 3.3): λ, how it depends on strengths, and what beats it.

Source: Iannuzzo et al. 2024, section 3.3, for materials, cell size and load factors; the figure with its layout is not
at hand, so the layout is ours and nothing is claimed as reproduced.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import LimitAnalysisResult, build_assembly, solve
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.limit.mechanism import Movement, face_motions
from jld_explore import ExploreSettings
from jld_explore.space import from_string
from jld_views.figures import draw_assembly, draw_forces, draw_mechanism
from studies.report import (
    GREY,
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
from studies.scenes import leonardo_flat_arch

NAME: Final = "leonardo_flat_arch"
PUBLISHED: Final = {
    "with dilation, JLD": 2153.0,
    "without dilation, JLD": 1312.0,
    "with dilation, 3DEC": 1911.13,
    "without dilation, 3DEC": 2187.0,
}
"""Load factors of section 3.3 in N, in the order in which they stand there."""

FRICTION, TENSION, SHEAR = float(np.tan(np.radians(30.0))), 2e6, 2e5
FLOOR: Final = 20.0
"""Processor time for a floor, s."""

LIMITS: Final = (2, 4)
"""Least and most cells in a block of the search: those of the blocks of the arch itself."""


def without_dilation(assembly: Assembly, labels: Bits, seconds: float = 0.0) -> LimitAnalysisResult:
    """The lowest solution without dilation; `extra` has the highest, and a floor where it is given time, s."""
    return solve(assembly, labels, friction="zero-dilation", range=True, floor_seconds=seconds)


def facts_of(part: str, result: LimitAnalysisResult, blocks: int) -> dict[str, Any]:
    """One row of the table from a result of `without_dilation`."""
    extra = result.facts
    return {
        "part": part,
        "friction": FRICTION,
        "tension": TENSION,
        "shear": SHEAR,
        "associative_N": extra["associative_load_factor"],
        "zero_lowest_N": extra["lowest_found"],
        "zero_highest_N": extra["highest_found"],
        "zero_proven_N": extra["lowest_proven"],
        "status": str(result.status),
        "blocks": blocks,
    }


def sensitivity(coarse: bool) -> pd.DataFrame:
    """λ of the arch by σt, τ and μ, one at a time."""
    steps = 2 if coarse else 13
    ways = {
        "tension": np.geomspace(2e4, 4e6, steps),
        "shear": np.geomspace(2e3, 4e6, steps),
        "friction": np.linspace(0.15, 0.9, steps),
    }
    rows: list[dict[str, Any]] = []
    for name, values in ways.items():
        for value in values:
            given = {"friction": FRICTION, "tension": TENSION, "shear": SHEAR} | {name: float(value)}
            assembly = build_assembly(leonardo_flat_arch(given["friction"], given["tension"], given["shear"]))
            result = solve(assembly)
            row: dict[str, Any] = {"part": f"by {name}", **given, "associative_N": result.load_factor}
            row["status"] = str(result.status)
            if row["status"] == "collapse":
                span = without_dilation(assembly, assembly.labels).facts
                row |= {"zero_lowest_N": span["lowest_found"], "zero_highest_N": span["highest_found"]}
            rows.append(row)
    return pd.DataFrame(rows)


def search(coarse: bool) -> tuple[pd.DataFrame, Assembly, bool]:
    """Every segmentation of the arch into blocks of as many cells as its own; table, assembly, proven."""
    wanted = {"block_cells": [3, 4] if coarse else list(LIMITS), "front": {"count": "blocks", "sense": "max"}}
    done = searched(leonardo_flat_arch(search=wanted), ExploreSettings(driver="enumeration", jobs=1))
    return done.results, done.assembly, bool(done.summary.proven)


def _proven(extra: dict[str, Any]) -> str:
    """What is proven of the lower end."""
    if extra["lowest_proven"] is None:
        return "no floor is proven"
    return f"none lies below {extra['lowest_proven']:.1f} N, proven"


def _cracks(result: LimitAnalysisResult) -> int:
    kinds = (Movement.CRACK_SHEAR, Movement.CRACK_TENSION)
    return sum(motion.kind in kinds for motion in face_motions(result))


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Solve all parts, write table, picture and page into a folder; returns the table."""
    assembly = build_assembly(leonardo_flat_arch())
    own = solve(assembly)
    lowest = without_dilation(assembly, assembly.labels, FLOOR)
    moved = sensitivity(coarse)
    results, _, proven = search(coarse)
    ranked = results[results["status"] == "collapse"]
    best = solve(assembly, from_string(str(ranked["labelling"].iloc[0])))
    five = ranked[ranked["blocks"] <= 5].iloc[0]
    counts = results["status"].value_counts()
    better = int((ranked["load_factor"] > own.load_factor * (1.0 + 1e-6)).sum())
    best_zero = without_dilation(assembly, best.labels, 0.0 if coarse else FLOOR)
    held = build_assembly(leonardo_flat_arch(abutments=True))
    confined = without_dilation(held, held.labels, 0.0 if coarse else FLOOR)
    blocks = int(ranked["blocks"].iloc[0])
    rows = [
        facts_of("this arch", lowest, 5),
        facts_of("strongest segmentation", best_zero, blocks),
        facts_of("this arch between abutments", confined, 5),
    ]
    zero, zero_best, zero_held = (row.facts for row in (lowest, best_zero, confined))
    published = [{"part": f"published, {name}", "associative_N": value} for name, value in PUBLISHED.items()]
    table = pd.concat([pd.DataFrame(rows), pd.DataFrame(published), moved], ignore_index=True)
    gain = best.load_factor / own.load_factor
    report = Report(
        name=NAME,
        title="Interlocking flat arch after Leonardo",
        question="How much does it carry, with and without dilation, and is there a stronger way to cut it?",
        source="Iannuzzo et al. 2024, section 3.3: 2153 N and 1312 N by JLD, with and without dilation, 1911.13 N and "
        "2187 N by 3DEC, in the order of the text.",
        model="Cells of 0.1 m, 1400 kg/m³, dry 30°, σt = 2 MPa, τ = 0.2 MPa as there. The layout is ours: nine by two "
        "cells, five blocks of 3–4 cells, a T in the middle, on two dry bearings of three cells, 0.3 m apart, free to "
        "slide; λ N on top of each of the three upper cells of the T, 3 λ in all. Between rigid abutments the same "
        "arch would carry whatever its cells withstand in shear, and without dilation whatever thrust is there "
        "beforehand; bearings make the thrust a result.",
        agrees=(
            f"With dilation λ = {own.load_factor:.1f} N per force ({3 * own.load_factor:.0f} N in all), beside 2153 N: "
            "of the same size, for the same reason. A cell face carries τA = 2000 N in shear, and "
            f"{_cracks(own)} faces crack in the mechanism.",
            f"Without dilation the lowest solution found is {zero['lowest_found']:.1f} N, "
            f"{zero['lowest_found'] / own.load_factor:.2f} of the value with dilation, beside 1312/2153 = 0.61; "
            f"{_proven(zero)}.",
        ),
        differs=(
            "None of this reproduces section 3.3: its layout, and whether λ is per force or in all, are not known.",
            f"Without dilation, certified solutions reach from {zero['lowest_found']:.0f} to "
            f"{zero['highest_found']:.0f} N: the arch is confined, and the thrust that is there beforehand decides. "
            "One number without its start is not an answer; 1312 N can be no exception.",
            f"Between rigid abutments the same five blocks carry {zero_held['associative_load_factor']:.0f} N with "
            f"dilation, and without it anything from {max(zero_held['lowest_found'], 0.0):.3g} to "
            f"{zero_held['highest_found']:.0f} N was found: only the thrust that is there beforehand holds them.",
            "Two faces that shear at τA, less the weight of six cells, would give (4000 − 82)/3 = 1306 N: the crack "
            "beside the bearings with next to no friction, which the lowest solution is.",
            f"Of {len(results)} classes of segmentations into blocks of {LIMITS[0]}–{LIMITS[1]} cells, "
            f"{int(counts.get('unstable', 0))} do not stand and {better} beat this arch. The strongest carries "
            f"{best.load_factor:.0f} N, {gain:.2f} times as much (associative friction, "
            f"{'every class solved: proven' if proven else 'not proven'}); with at most five blocks "
            f"{five['load_factor']:.0f} N. Without dilation it was found between {zero_best['lowest_found']:.0f} and "
            f"{zero_best['highest_found']:.0f} N; {_proven(zero_best)}.",
        ),
        pictures={
            "": "Top: our layout, forces and mechanism with dilation, and the mechanism of the lowest one without. "
            "Middle: λ by tensile strength, shear strength and friction. Bottom: all segmentations, and the strongest."
        },
    )
    figure = _picture(own, lowest, moved, results, best, best_zero)
    write(out, report, table, {"": figure}, table[~table["part"].str.startswith("by ")].dropna(axis=1, how="all"))
    return table


def _picture(
    own: LimitAnalysisResult,
    lowest: LimitAnalysisResult,
    moved: pd.DataFrame,
    results: pd.DataFrame,
    best: LimitAnalysisResult,
    best_zero: LimitAnalysisResult,
) -> Figure:
    figure = figure_of(12.8, 13.6)
    size = (5.6, 2.0)
    panels = (
        (draw_assembly, "our layout: five blocks", own),
        (draw_forces, f"with dilation: forces at λ = {own.load_factor:.1f} N", own),
        (draw_mechanism, f"with dilation: λ = {own.load_factor:.1f} N (paper's layout: 2153 N)", own),
        (draw_mechanism, f"without, lowest found: λ = {lowest.load_factor:.1f} N (paper's layout: 1312 N)", lowest),
    )
    for k, (draw, title, result) in enumerate(panels):
        ax = axes_at(figure, 0.6 + 6.2 * (k % 2), 10.85 - 2.7 * (k // 2), *size)
        _draw(ax, draw, result, title)
    for k, name in enumerate(("tension", "shear", "friction")):
        _sensitivity(axes_at(figure, 0.75 + 4.2 * k, 5.25, 3.35, 2.1), name, moved)
    _search(axes_at(figure, 0.75, 0.75, 3.6, 3.3), results, own.load_factor)
    _draw(axes_at(figure, 5.25, 2.85, 3.2, 1.5), draw_assembly, best, "strongest of all segmentations")
    title = f"its mechanism, λ = {best.load_factor:.1f} N"
    _draw(axes_at(figure, 9.3, 2.85, 3.2, 1.5), draw_mechanism, best, title)
    _draw(axes_at(figure, 5.25, 0.75, 3.2, 1.5), draw_forces, best, "its forces")
    title = f"without dilation, lowest: λ = {best_zero.load_factor:.1f} N"
    _draw(axes_at(figure, 9.3, 0.75, 3.2, 1.5), draw_mechanism, best_zero, title)
    forces = drawing_handles("dry face", "inner face", "pressing", "yield dry", "yield inner")
    legend_at(figure, [*forces, *drawing_handles("hinge", "slide", "open", "crack", "at rest")], 0.75, 0.02, 10)
    figure.suptitle("Interlocking flat arch after Leonardo, on two bearings", fontsize=12, y=0.993)
    return figure


def _draw(ax: Axes, draw: Any, result: LimitAnalysisResult, title: str) -> None:
    if draw is draw_assembly:
        draw_assembly(ax, result.assembly, result.labels)
    else:
        draw(ax, result)
    without_legend(ax, title)
    name_axes(ax, "x [m]", "y [m]", size=8)


def _sensitivity(ax: Axes, name: str, moved: pd.DataFrame) -> None:
    part = moved[moved["part"] == f"by {name}"]
    scale, label, own = {
        "tension": (1e-6, "tensile strength σt [MPa]", TENSION),
        "shear": (1e-6, "shear strength τ [MPa]", SHEAR),
        "friction": (1.0, "friction coefficient μ [–]", FRICTION),
    }[name]
    x = part[name].to_numpy(dtype=float) * scale
    low, high, top = (
        part[column].to_numpy(dtype=float) / 1e3 for column in ("zero_lowest_N", "zero_highest_N", "associative_N")
    )
    ax.fill_between(
        x, low, high, color="#FBE3B5", hatch="//", edgecolor="#C9A55A", lw=0.0, label="without, range found"
    )
    ax.plot(x, top, PAIRED[0][2], color=PAIRED[0][0], ls="solid", ms=4, lw=1.3, label="with dilation")
    ax.axvline(own * scale, color=GREY, lw=0.9, ls=(0, (4, 2)), label="section 3.3")
    if name != "friction":
        ax.set_xscale("log")
    if name == "shear":
        ax.set_yscale("log")
        ax.set_ylim(0.3 * float(np.nanmin(low[low > 0.0])), 10.0 * float(np.nanmax(top)))
    else:
        ax.set_ylim(0.0, 1.4 * float(np.nanmax(top)))
    ax.set_xlabel(label, fontsize=9)
    if name == "tension":
        ax.set_ylabel("λ per force [kN]", fontsize=9)
    ax.legend(frameon=False, fontsize=7.5, loc="upper left")


def _search(ax: Axes, results: pd.DataFrame, own: float) -> None:
    ranked = results[results["status"] == "collapse"]
    ax.plot(ranked["blocks"], ranked["load_factor"] / 1e3, "o", color=PAIRED[0][0], ms=3, mfc="none", mew=0.6)
    ax.plot(5, own / 1e3, "*", color="#B8321A", ms=12, label="this arch")
    ax.plot(
        ranked["blocks"].iloc[0], ranked["load_factor"].iloc[0] / 1e3, "D", color="#1B1B1B", ms=6, label="strongest"
    )
    name_axes(ax, "blocks [–]", "λ per force with dilation [kN]")
    ax.locator_params(axis="x", integer=True)
    ax.set_ylim(0.0, 1.25e-3 * float(ranked["load_factor"].max()))
    ax.set_title(f"{len(ranked)} classes of segmentations that stand", fontsize=9)
    ax.legend(frameon=False, fontsize=8, loc="upper right")
