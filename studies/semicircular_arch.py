"""The semicircular arch: least thickness against friction, convergence, and the joints set free.

Source: Cocchetti & Rizzi, Frattura ed Integrità Strutturale 51 (2020) 356–375, Table 3; Milankovitch 1907 and, for
vertical cuts, Makris & Alexakis, Archive of Applied Mechanics 83 (2013). The candidate grid is ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import LimitAnalysis, LimitAnalysisResult, Scene, build_assembly, solve
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_explore import ExploreSettings
from jld_explore.space import from_string
from jld_views.figures import draw_assembly, draw_mechanism
from studies.families import semicircular_arch
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
from studies.scenes import polar_grid_arch, ring_arch

NAME: Final = "semicircular_arch"
ROTATION: Final = 0.107426
"""t/R with radial joints, μ > `TRANSITION`, weight along the centreline (Cocchetti & Rizzi 2020, Table 3)."""

TRANSITION: Final = 0.395832
LIMIT: Final = (0.309215, 0.200637)
"""Least friction of all and the thickness that it takes."""

HAUNCH: Final = 54.4963
"""Hinge at the haunch, degrees from the crown."""

TRUE_WEIGHT: Final = {"radial": 0.1075, "vertical": 0.1095}
"""t/R under the true ring weight, no sliding: Milankovitch; Makris & Alexakis 2013."""

SECTORS, THICKNESS = 8, 0.16


def stands(scene: Scene) -> bool:
    """Does it stand under its own weight?"""
    assembly = build_assembly(scene)
    return LimitAnalysis(assembly).stands(assembly.labels) is True


def least_thickness(scene: Callable[[float], Scene], low: float, high: float, tolerance: float) -> float:
    """Least t/R at which the scene of a thickness stands, by bisection; NaN where it does not stand at `high`."""
    if not stands(scene(high)):
        return float("nan")
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stands(scene(middle)) else (middle, high)
    return high


def against_friction(coarse: bool) -> pd.DataFrame:
    """Least thickness of an arch of many voussoirs by friction."""
    count = 60 if coarse else 120
    above = (0.3094, 0.35, 0.6) if coarse else (0.3094, 0.311, 0.314, 0.319, 0.326, 0.336, 0.35, 0.365, 0.38)
    frictions = (0.305, *above, *(() if coarse else (0.39, 0.3955, 0.397, 0.42, 0.5, 0.7)))
    rows = []
    for friction in frictions:
        found = least_thickness(
            lambda t, mu=friction: semicircular_arch(count, t, mu),  # type: ignore[misc]
            0.09,
            0.4 if friction < LIMIT[0] else 0.23,
            1e-4 if coarse else 1e-5,
        )
        rows.append({"part": "friction", "voussoirs": count, "friction": friction, "thickness": found})
    return pd.DataFrame(rows)


def convergence(coarse: bool) -> pd.DataFrame:
    """Error of the least thickness by the number of voussoirs, μ = 0.7."""
    numbers = (8, 16, 48) if coarse else (8, 10, 12, 16, 20, 28, 36, 48, 64, 84, 112, 160, 240)
    rows = []
    for count in numbers:
        found = least_thickness(lambda t, n=count: semicircular_arch(n, t, 0.7), 0.05, 0.12, 1e-7)  # type: ignore[misc]
        step, hinge = 180.0 / count, 90.0 - HAUNCH
        offset = min(hinge % step, step - hinge % step)
        rows.append(
            {
                "part": "convergence",
                "voussoirs": count,
                "friction": 0.7,
                "thickness": found,
                "published": ROTATION,
                "error": ROTATION - found,
                "hinge_offset_degrees": offset,
            }
        )
    return pd.DataFrame(rows)


def cut_directions(coarse: bool) -> pd.DataFrame:
    """Least thickness under the true weight of the ring: radial cuts, and vertical ones that cannot slip."""
    count = 40 if coarse else 160
    rows = []
    for cuts, friction in (("radial", 0.7), ("vertical", 50.0)):
        found = least_thickness(
            lambda t, c=cuts, mu=friction: ring_arch(count, t, mu, c),  # type: ignore[misc]
            0.09,
            0.13,
            1e-5,
        )
        row = {"part": f"{cuts} cuts, true weight", "voussoirs": count, "friction": friction, "thickness": found}
        rows.append(row | {"published": TRUE_WEIGHT[cuts]})
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class Freed:
    """All segmentations of the arch under one load: table (columns of results.csv, and radial), and the assembly."""

    load: str
    unit: str
    table: pd.DataFrame
    assembly: Assembly
    proven: bool

    def best(self, radial: bool = False) -> tuple[float, str]:
        """λ and labelling of the strongest, of all or of those with radial joints only."""
        rows = self.table[self.table["radial"]] if radial else self.table
        rows = rows[rows["status"] == "collapse"].sort_values("load_factor", ascending=False, kind="stable")
        return float(rows["load_factor"].iloc[0]), str(rows["labelling"].iloc[0])


def free_joints(load: str, coarse: bool) -> Freed:
    """Every segmentation of a polar grid into blocks of 2–4 cells, by enumeration."""
    angle, radius = np.pi * 5.5 / SECTORS, 1.0 + THICKNESS / 2.0
    radius *= np.cos(0.5 * np.pi / SECTORS)
    at = [float(radius * np.cos(angle)), float(radius * np.sin(angle))]
    live: list[dict[str, Any]] = [{"element": "r1s5", "force": [0, -1], "at": at}]
    if load == "horizontal":
        live = [{"body": [1, 0]}]
    search = {"block_cells": [2, 3 if coarse else 4], "symmetry": "none", "front": {"count": "blocks", "sense": "max"}}
    scene = polar_grid_arch(2, SECTORS, THICKNESS, live, search)
    done = searched(scene, ExploreSettings(driver="enumeration", jobs=1))
    assembly = done.assembly
    across = np.array([_ring(assembly, k) for k in range(len(assembly.interfaces))])
    radial = [not (from_string(text) & across).any() for text in done.results["labelling"]]
    unit = "N" if load == "point" else "weight"
    return Freed(load, unit, done.results.assign(radial=radial), assembly, bool(done.summary.proven))


def _ring(assembly: Assembly, face: int) -> bool:
    """Is it a face between two rings?"""
    first, second = (assembly.elements.ids[side[face]] for side in (assembly.interfaces.a, assembly.interfaces.b))
    return "s" in first and "s" in second and first.split("s")[0] != second.split("s")[0]


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Solve all parts, write table, picture and page into a folder; returns the table."""
    friction, numbers, cuts = against_friction(coarse), convergence(coarse), cut_directions(coarse)
    freed = [free_joints(load, coarse) for load in (("point",) if coarse else ("point", "horizontal"))]
    rows = [
        {
            "part": f"free joints, {one.load} load",
            "segmentations": len(one.table),
            "blocks": int(one.table["blocks"].iloc[0]),
            "load_factor": one.best()[0],
            "load_factor_radial": one.best(radial=True)[0],
            "gain": one.best()[0] / one.best(radial=True)[0],
            "proven": one.proven,
        }
        for one in freed
    ]
    table = pd.concat([friction, numbers, cuts, pd.DataFrame(rows)], ignore_index=True)
    high = float(friction[friction["friction"] > TRANSITION]["thickness"].max())
    low = friction[friction["friction"] > LIMIT[0]].iloc[0]
    true = dict(zip(TRUE_WEIGHT, cuts["thickness"], strict=True))
    report = Report(
        name=NAME,
        title="Semicircular arch: least thickness, convergence, and the joints set free",
        question="How thick must the arch be at which friction, how many voussoirs does it take to see that, and are "
        "radial joints the strongest?",
        source="Cocchetti & Rizzi 2020, Table 3 (weight along the centreline); Milankovitch 0.1075 and Makris & "
        "Alexakis 2013 0.1095 (vertical cuts) under the true ring weight.",
        model="Equal voussoirs, dry joints, self-weight; least thickness by bisection on a proof of standing or "
        f"falling. Free joints: our own grid of 2 × {SECTORS} cells, R = 1 m, t = {THICKNESS} m, 0.2 m deep, "
        "2000 kg/m³, dry 30°, σt = τ = 0.2 MPa, blocks of 2–4 cells, dry springings; a vertical force on the extrados "
        "at 124° from the right springing, or a horizontal body load. Every segmentation is solved.",
        agrees=(
            f"μ > {TRANSITION}: t/R = {high:.6f} computed with {friction['voussoirs'].iloc[0]} voussoirs, "
            f"{ROTATION} published.",
            f"μ = {low['friction']:.4f}: {low['thickness']:.4f}, published {LIMIT[1]} at μ = {LIMIT[0]}; at μ = 0.305 "
            "it falls at every thickness up to 0.4, as published.",
            f"True ring weight: {true['radial']:.5f} radial (published 0.1075), {true['vertical']:.5f} vertical cuts "
            "without slip (published 0.1095).",
            "The error falls with the square of the angle between the true hinge and the nearest joint, hence at least "
            "like n⁻² in its envelope; it is never negative.",
        ),
        differs=(
            *(
                f"{one.load.capitalize()} load: the strongest of {len(one.table)} segmentations carries "
                f"λ = {one.best()[0]:.4g} {one.unit}, the strongest with radial joints only "
                f"{one.best(radial=True)[0]:.4g} {one.unit}, {one.best()[0] / one.best(radial=True)[0]:.2f} times less "
                f"({'all proven' if one.proven else 'not proven'})."
                for one in freed
            ),
            "Between the two published corners the mixed regime is computed only; no published curve is at hand.",
            "Vertical cuts reach 0.1095 only because they are not allowed to slip; the strengths of the free-joint "
            "study are an assumption, and its answer holds for this grid and block limit.",
        ),
        pictures={
            "": "Top: least thickness by friction with its three regimes; error by voussoir number by hinge offset. "
            "Middle: mechanisms in the regimes. Bottom: all segmentations of the grid, and the strongest layouts."
        },
    )
    write(out, report, table, {"": _picture(friction, numbers, freed)})
    return table


def _picture(friction: pd.DataFrame, numbers: pd.DataFrame, freed: list[Freed]) -> Figure:
    figure = figure_of(12.4, 8.5 + 3.55 * len(freed))
    top = figure.get_figheight()
    _friction(axes_at(figure, 0.75, top - 3.9, 5.2, 3.2), friction)
    _errors(axes_at(figure, 7.0, top - 3.9, 2.35, 3.2), numbers, "voussoirs", "voussoirs n [–]", -2.0)
    _errors(axes_at(figure, 9.85, top - 3.9, 2.35, 3.2), numbers, "hinge_offset_degrees", "hinge offset [°]", 2.0)
    cases = (("hinges only", 0.7, 0.111), ("hinges and sliding", 0.34, 0.168), ("near the sliding limit", 0.312, 0.205))
    for k, (name, mu, thickness) in enumerate(cases):
        ax = axes_at(figure, 0.7 + 4.05 * k, top - 7.55, 3.5, 2.5)
        draw_mechanism(ax, _crown_loaded(mu, thickness))
        without_legend(ax, f"{name}: μ = {mu}, t/R = {thickness}")
        name_axes(ax, "x/R [–]", "y/R [–]" if k == 0 else "")
    text = "mechanisms under a crown load on arches slightly thicker than the least"
    figure.text(0.5, (top - 4.6) / top, text, ha="center", va="top", fontsize=8.5, color=GREY)
    legend_at(figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "at rest"), 3.0, top - 8.35)
    for row, one in enumerate(freed):
        bottom = top - 8.3 - 3.45 * (row + 1) + 0.5
        _segmentations(axes_at(figure, 0.75, bottom, 3.6, 2.55), one)
        for k, radial in enumerate((False, True)):
            value, labelling = one.best(radial)
            ax = axes_at(figure, 5.1 + 3.65 * k, bottom - 0.1, 3.5, 2.6)
            labels: Bits = from_string(labelling)
            draw_assembly(ax, one.assembly, labels)
            kind = "strongest radial" if radial else "strongest of all"
            without_legend(ax, f"{kind}, {one.load} load: λ = {value:.4g} {one.unit}")
            name_axes(ax, "x [m]", "y [m]" if k == 0 else "")
            ax.tick_params(labelleft=k == 0)
    figure.suptitle("Semicircular arch", fontsize=12, y=1.0 - 0.1 / top)
    return figure


def _crown_loaded(friction: float, thickness: float) -> LimitAnalysisResult:
    live = [{"element": "v14", "force": [0, -1], "at": [0.0, 1.0 + thickness / 2.0]}]
    return solve(build_assembly(semicircular_arch(29, thickness, friction, live)))


def _friction(ax: Axes, table: pd.DataFrame) -> None:
    shown = table[np.isfinite(table["thickness"])]
    colour, dash, marker = PAIRED[0]
    ax.axvspan(0.295, LIMIT[0], color="#DADADA", hatch="//", alpha=0.6, lw=0)
    ax.axvspan(LIMIT[0], TRANSITION, color="#FBE3B5", alpha=0.5, lw=0)
    words = f"computed, n = {int(table['voussoirs'].iloc[0])}"
    ax.plot(shown["friction"], shown["thickness"], marker, color=colour, ls=dash, ms=4.5, lw=1.2, label=words)
    ax.axhline(ROTATION, color=GREY, lw=1.0, ls=(0, (4, 2)), label=f"{ROTATION} published, hinges only")
    ax.plot([TRANSITION, LIMIT[0]], [ROTATION, LIMIT[1]], "*", ms=11, color="#B8321A", label="published corners")
    ax.set_xlim(0.295, 0.52)
    ax.set_ylim(0.09, 0.215)
    for x, words in ((0.302, "none stands"), (0.366, "hinges\nand sliding"), (0.46, "hinges only")):
        turn = 90 if x < 0.31 else 0
        ax.text(x, 0.15 if turn else 0.178, words, rotation=turn, ha="center", va="center", fontsize=9)
    name_axes(ax, "friction coefficient μ [–]", "least thickness t/R [–]")
    ax.set_title("Least thickness: three regimes", fontsize=10)
    ax.legend(frameon=True, edgecolor="none", fontsize=8, loc="upper right", bbox_to_anchor=(1.0, 0.6))


def _errors(ax: Axes, table: pd.DataFrame, column: str, label: str, slope: float) -> None:
    shown = table[table["error"] > 2e-7].sort_values(column)
    x, y = shown[column].to_numpy(dtype=float), shown["error"].to_numpy(dtype=float)
    ax.loglog(x, y, PAIRED[0][2], color=PAIRED[0][0], ms=4.5)
    through = float(np.exp(np.mean(np.log(y) - slope * np.log(x))))
    if slope < 0.0:
        through = float(np.max(y / x**slope))
    name = "n⁻² envelope" if slope < 0.0 else "offset²"
    ends = np.array([x.min(), x.max()])
    ax.loglog(ends, through * ends**slope, color=GREY, lw=1.0, ls=(0, (4, 2)), label=name)
    name_axes(ax, label, "error of t/R [–]" if slope < 0.0 else "")
    ax.set_title("Error, μ = 0.7", fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="lower left" if slope < 0.0 else "upper left")


def _segmentations(ax: Axes, one: Freed) -> None:
    shown = one.table[one.table["status"] == "collapse"]
    for radial, look, shift in ((False, PAIRED[0], -0.1), (True, PAIRED[1], 0.1)):
        part = shown[shown["radial"] == radial]
        name = f"radial joints only ({len(part)})" if radial else f"stepped joints ({len(part)})"
        style: dict[str, Any] = {"color": look[0], "ms": 4.5 if radial else 3.0, "label": name, "rasterized": True}
        style |= {"fillstyle": "full" if radial else "none", "mew": 0.6}
        ax.plot(part["blocks"] + shift, part["load_factor"], look[2], **style)
    ax.set_xlabel("blocks [–]", fontsize=9)
    name = "λ [N]" if one.unit == "N" else "λ, horizontal over weight [–]"
    ax.set_ylabel(name, fontsize=9)
    ax.locator_params(axis="x", integer=True)
    ax.set_ylim(bottom=0.0)
    ax.set_title(f"Every segmentation, {one.load} load", fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="upper right", handletextpad=0.2)
