"""One block and two cubes (section 3.2): λ by direction, and the map of mechanisms over (μ, τA/W).

Source: Iannuzzo et al. 2024, section 3.2, Figures 3 and 4; λ in closed form from docs/method.md (2.2) to (2.7).
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.projections.polar import PolarAxes

from jld_core import LimitAnalysisResult, build_assembly, solve
from jld_core.arrays import Floats
from jld_core.limit.mechanism import Movement, face_motions
from jld_views.figures import draw_mechanism
from studies.report import GREY, PAIRED, Report, axes_at, figure_of, fill_region, name_axes, without_legend, write
from studies.scenes import stacked_cubes

NAME: Final = "one_block_two_cubes"

SLIDE, ROCK = ("base", Movement.SLIDE), ("base", Movement.HINGE)
SHEAR, OPEN = ("inner", Movement.CRACK_SHEAR), ("inner", Movement.CRACK_TENSION)
REGIONS: Final = {
    SLIDE: ("base slides\nλ = μ", "#CFE1F2", ""),
    SHEAR: ("crack in shear\nλ = τA/W", "#FBE3B5", "//"),
    OPEN: ("crack opens\nλ = (1 + σtA/W)/3", "#F6D3D9", ".."),
    ROCK: ("base rocks\nλ = 1/2", "#D3EBCD", "\\\\"),
}
"""Mechanisms of two cubes, with words, fill and hatch."""

ONE: Final = (
    ("one block, inner base: τA/W = 0.2, σt = 0", 1, 0.5, 0.0, 0.2, "uncoupled"),
    ("τA/W = 0.9, σt = 0, paper's bending", 1, 0.5, 0.0, 0.9, "uncoupled"),
    ("τA/W = 0.9, σt = 0, kern bending", 1, 0.5, 0.0, 0.9, "kern"),
)
TWO: Final = (
    ("μ = 0.2, τA/W = 0.9, σtA = W: slides", 2, 0.2, 1.0, 0.9, "uncoupled"),
    ("μ = 0.9, τA/W = 0.27, σtA = W: shears", 2, 0.9, 1.0, 0.27, "uncoupled"),
    ("μ = 0.9, τA/W = 0.9, σt = 0: opens", 2, 0.9, 0.0, 0.9, "uncoupled"),
    ("μ = 0.9, τA/W = 0.9, σtA = W: rocks", 2, 0.9, 1.0, 0.9, "uncoupled"),
    ("as the third, kern bending: opens", 2, 0.9, 0.0, 0.9, "kern"),
)
"""Cases by direction: name, cubes, μ, σtA/W, τA/W, form of the inner bending."""


def closed_form(cubes: int, angle: float, friction: float, tension: float, shear: float, bending: str) -> float:
    """λ of one block on an inner base or two cubes on a dry one, loaded at an angle (radians) from the x axis.

    Opening: an inner face at h/2 below the centroid of the weight W above it; uncoupled about each axis, or by edge
    stress at a corner. Base rocking: about an edge of the dry base, 2 W at height 1.
    """
    along, across = abs(np.cos(angle)), abs(np.sin(angle))
    reach = max(along, across) if bending == "uncoupled" else along + across
    opening = (1.0 + tension) / 3.0 / reach
    if cubes == 1:
        return float(min(shear, opening))
    return float(min(friction, 0.5 / max(along, across), shear, opening))


def by_direction(coarse: bool) -> pd.DataFrame:
    """λ computed and in closed form, by case and direction."""
    angles = np.arange(0, 360, 30.0 if coarse else 5.0)
    rows: list[dict[str, Any]] = []
    for (name, cubes, friction, tension, shear, bending), degrees in itertools.product(ONE + TWO, angles):
        base = "inner" if cubes == 1 else "dry"
        turn = float(np.radians(degrees))
        scene = stacked_cubes(cubes, friction=friction, tension=tension, shear=shear, base=base, direction=turn)
        found = solve(build_assembly(scene), inner_bending=bending)
        exact = closed_form(cubes, turn, friction, tension, shear, bending)
        rows.append(
            {
                "part": "direction",
                "case": name,
                "cubes": cubes,
                "bending": bending,
                "degrees": degrees,
                "friction": friction,
                "tension": tension,
                "shear": shear,
                "load_factor": found.load_factor,
                "closed_form": exact,
                "status": str(found.status),
            }
        )
    return pd.DataFrame(rows)


def moving(result: LimitAnalysisResult) -> set[tuple[str, Movement]]:
    """What the base and the inner face of two cubes do."""
    return {
        ("base" if dry else "inner", motion.kind)
        for dry, motion in zip(result.labels, face_motions(result), strict=True)
        if motion.kind is not Movement.CLOSED
    }


def two_cubes(friction: float, tension: float, shear: float) -> LimitAnalysisResult:
    """Planar two cubes on a dry base."""
    return solve(build_assembly(stacked_cubes(2, friction=friction, tension=tension, shear=shear)))


def mechanism_map(tension: float, coarse: bool) -> pd.DataFrame:
    """λ and mechanism over a grid of (μ, τA/W) that avoids the borders."""
    steps = 9 if coarse else 36
    values = 0.72 * (np.arange(steps) + 0.5) / steps
    rows: list[dict[str, Any]] = []
    for friction, shear in itertools.product(values, values + 1e-4):
        found = two_cubes(float(friction), tension, float(shear))
        kinds = {SLIDE: friction, ROCK: 0.5, SHEAR: shear, OPEN: (1.0 + tension) / 3.0}
        governing = min(kinds, key=lambda kind: kinds[kind])
        seen = moving(found)
        rows.append(
            {
                "part": "map",
                "friction": friction,
                "tension": tension,
                "shear": shear,
                "load_factor": found.load_factor,
                "closed_form": kinds[governing],
                "status": str(found.status),
                "mechanism": " and ".join(sorted(f"{face}: {kind}" for face, kind in seen)),
                "expected": f"{governing[0]}: {governing[1]}",
            }
        )
    return pd.DataFrame(rows)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Solve all directions and both maps, write table, picture and page into a folder; returns the table."""
    directions = by_direction(coarse)
    maps = {tension: mechanism_map(tension, coarse) for tension in (0.0, 1.0)}
    table = pd.concat([directions, *maps.values()], ignore_index=True)
    off = (table["load_factor"] - table["closed_form"]).abs() / table["closed_form"]
    mapped = table[table["part"] == "map"]
    same = int((mapped["mechanism"] == mapped["expected"]).sum())
    circle = directions[directions["case"] == ONE[0][0]]["load_factor"]
    report = Report(
        name=NAME,
        title="One block, two cubes: which way does it fail?",
        question="How does λ depend on the direction of the load, and which of four mechanisms governs two stacked "
        "cubes on a dry base?",
        source="Iannuzzo et al. 2024, section 3.2, Figures 3 and 4. The closed forms follow from its eq. (3) and (4).",
        model="Cubes of side 1 and weight W, horizontal body load. One block on an inner base; two cubes with an inner "
        "face between them on a dry base. By direction: spatial, convex contact; maps: planar, load along x.",
        agrees=(
            f"One block with τA/W = 0.2: λ between {circle.min():.9f} and {circle.max():.9f} over all directions, the "
            "paper's λ = τA/W.",
            f"{len(table)} solves agree with the closed forms to {off.max():.1e} relative.",
            f"The mechanism read from the computed velocities is the governing one at {same} of {len(mapped)} points.",
        ),
        differs=(
            "The paper takes σt = 0 and speaks of four mechanisms. By its own eq. (3) the crack then opens at 1/3, "
            "before the base can rock at 1/2; rocking governs only for σtA > W/2 (map on the right).",
            "λ = τA/W in every direction holds only while opening stays farther away: along a face of the block the "
            "limit is (1 + σtA/W)/3, and under the uncoupled bending of the paper it rises to √2 times that on a "
            "diagonal, where edge stress (kern) would give half of that. The two forms differ by a factor of 2.",
            "An opening crack turns about a point at a third of the face, so that drawn velocities overlap on the "
            "pressed side: that is the flow rule of eq. (3), not an error of the drawing.",
        ),
        pictures={
            "": "Top: λ by direction of a horizontal load (lines: closed form, marks: computed). Middle: mechanism by "
            "friction and shear strength (fills: computed, lines: closed form). Bottom: the four mechanisms."
        },
    )
    summary = (
        table.assign(error=off, case=table["case"].fillna("map of two cubes, σtA/W = " + table["tension"].astype(str)))
        .groupby("case", sort=False)
        .agg(
            solves=("error", "size"),
            lowest=("load_factor", "min"),
            highest=("load_factor", "max"),
            largest_relative_error=("error", "max"),
        )
        .reset_index()
    )
    write(out, report, table, {"": _picture(directions, maps)}, summary)
    return table


def _picture(directions: pd.DataFrame, maps: dict[float, pd.DataFrame]) -> Figure:
    figure = figure_of(11.4, 14.4)
    for k, (cases, top) in enumerate(((ONE, 0.5), (TWO, 0.75))):
        title = "One block on an inner base" if k == 0 else "Two cubes on a dry base"
        ax = axes_at(figure, 0.6 + 5.7 * k, 10.05, 4.2, 3.3, projection="polar")
        _polar(ax, directions, cases, top, title)
    for k, (tension, table) in enumerate(maps.items()):
        ax = axes_at(figure, 0.85 + 5.6 * k, 4.3, 4.6, 3.8)
        _map(ax, tension, table)
    examples = (
        ("base slides", 0.2, 1.0, 0.5),
        ("crack in shear", 0.6, 1.0, 0.2),
        ("crack opens", 0.6, 0.0, 0.6),
        ("base rocks", 0.8, 1.0, 0.8),
    )
    for k, (name, friction, tension, shear) in enumerate(examples):
        ax = axes_at(figure, 0.65 + 2.75 * k, 0.5, 2.2, 2.35)
        found = two_cubes(friction, tension, shear)
        draw_mechanism(ax, found)
        without_legend(ax, f"{name}, λ = {found.load_factor:.4f}\nμ {friction}, σtA/W {tension:g}, τA/W {shear}")
        name_axes(ax, "x [cube side]" if k == 0 else "", "y [cube side]" if k == 0 else "")
    figure.suptitle("Section 3.2: one block and two cubes under a horizontal body load", fontsize=12, y=0.993)
    return figure


def _polar(ax: Axes, table: pd.DataFrame, cases: tuple[Any, ...], top: float, title: str) -> None:
    fine = np.radians(np.arange(0.0, 360.5, 0.5))
    for (name, cubes, friction, tension, shear, bending), look in zip(cases, PAIRED, strict=False):
        colour, dash, marker = look
        exact = [closed_form(cubes, float(a), friction, tension, shear, bending) for a in fine]
        ax.plot(fine, exact, color=colour, linestyle=dash, linewidth=1.3)
        own = table[(table["case"] == name)].iloc[::2]
        angle: Floats = np.radians(own["degrees"].to_numpy(dtype=float))
        ax.plot(angle, own["load_factor"], marker, color=colour, markersize=3.2, label=name)
    ax.set_ylim(0.0, top)
    ax.set_yticks(np.arange(0.1, top + 0.01, 0.1))
    ax.tick_params(axis="y", labelsize=7)
    assert isinstance(ax, PolarAxes)
    ax.set_rlabel_position(112.5)
    handles = [
        Line2D([], [], color=colour, linestyle=dash, marker=marker, markersize=4.0, label=case[0])
        for case, (colour, dash, marker) in zip(cases, PAIRED, strict=False)
    ]
    place: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.07)}
    ax.legend(handles=handles, frameon=False, fontsize=8, handlelength=3.2, **place)
    ax.set_title(f"{title}: λ [–] by direction of the load", fontsize=10, pad=10)


def _map(ax: Axes, tension: float, table: pd.DataFrame) -> None:
    steps = round(len(table) ** 0.5)
    values = table["friction"].to_numpy(dtype=float).reshape(steps, steps)[:, 0]
    half = 0.5 * (values[1] - values[0])
    kinds = table["mechanism"].to_numpy().reshape(steps, steps).T
    for (face, kind), (words, fill, hatch) in REGIONS.items():
        mask = kinds == f"{face}: {kind}"
        if not mask.any():
            continue
        fill_region(ax, values, values, mask, fill, hatch)
        rows, columns = np.nonzero(mask)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.0}
        ax.text(values[columns].mean(), values[rows].mean(), words, ha="center", va="center", fontsize=9, bbox=box)
    cap, end = min(0.5, (1.0 + tension) / 3.0), float(values[-1] + half)
    for x, y in (([0.0, cap], [0.0, cap]), ([cap, cap], [cap, end]), ([cap, end], [cap, cap])):
        ax.plot(x, y, color="#1B1B1B", linewidth=1.6)
    ax.plot([], [], color="#1B1B1B", linewidth=1.6, label="border in closed form")
    ax.set_xlim(0.0, end)
    ax.set_ylim(0.0, end)
    name_axes(ax, "friction μ of the base [–]", "shear strength τA/W [–]")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.13), frameon=False, fontsize=8)
    ax.set_title(f"Two cubes, σtA/W = {tension:g}", fontsize=10)
    ax.text(
        1.0, -0.155, "every cell is one solve", transform=ax.transAxes, ha="right", va="top", fontsize=8, color=GREY
    )
