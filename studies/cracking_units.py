"""Running-bond walls whose bricks may crack along both axes and both diagonals: λ over the strength of the brick.

After Portioli, Cascini, Casapulla and D'Aniello, Engineering Structures 57 (2013) 232–247, who crack units
that way; the walls here are ours.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Assembly, LimitAnalysisResult, Status, build_assembly, parse_scene, solve
from jld_experiment import Joints, Settings, run_experiment
from jld_views.figures import draw_mechanism
from studies.report import (
    GREY,
    PAIRED,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    legend_at,
    name_axes,
    without_legend,
    write,
)

NAME: Final = "cracking_units"
BRICK: Final = (0.25, 0.12)
"""Length and height of a brick, m."""

DENSITY, FRICTION = 1800.0, 0.65
SHEAR_RATIO: Final = 1.0
"""Shear over tensile strength of a brick."""

COURSES, LENGTH = 8, 4
CRACKS: Final[tuple[float, ...]] = (0.0, FRICTION)
"""Friction of cracks as long as they hold: none is cohesive."""

SHOWN: Final = (0.3, 1.0, 5.0)
"""Strengths drawn, times the weight of the wall on its base per area."""


def wall(
    strength: float, friction: float = 0.0, rigid: bool = False, courses: int = COURSES, length: int = LENGTH
) -> Assembly:
    """A wall in running bond under a horizontal body load.

    strength: σt of the bricks over ρ g H, H the height of the wall. friction: coefficient of cracks, as long as they
    hold. rigid: bricks of one element each. courses, length: of bricks; every second course ends in half bricks.
    """
    wide, high = BRICK
    stress = strength * DENSITY * 9.81 * courses * high
    elements: list[dict[str, Any]] = []
    for course in range(courses):
        joints = np.arange(length + 1) * wide
        if course % 2:
            joints = np.concatenate([[0.0], joints[:-1] + 0.5 * wide, [length * wide]])
        for k, (left, right) in enumerate(itertools.pairwise(joints)):
            elements += _brick(f"c{course}b{k}", float(left), float(right), course * high, (course + 1) * high, rigid)
    total = length * wide
    base = [[0.0, -0.1], [total, -0.1], [total, 0.0], [0.0, 0.0]]
    inner = {"tensile_strength": stress, "shear_strength": SHEAR_RATIO * stress}
    if friction > 0.0:
        inner["friction_coefficient"] = friction
    return build_assembly(
        parse_scene(
            {
                "name": "wall of bricks that crack" if not rigid else "wall of rigid bricks",
                "elements": [*elements, {"id": "base", "polygon": base, "support": True}],
                "thickness": 0.12,
                "materials": {"density": DENSITY, "dry": {"friction_coefficient": FRICTION}, "inner": inner},
                "loads": {"live": [{"body": [1, 0]}]},
            }
        )
    )


def _brick(name: str, left: float, right: float, low: float, high: float, rigid: bool) -> list[dict[str, Any]]:
    """One element, or eight triangles between the middle, the corners and the middles of the sides."""
    if rigid:
        return [{"id": name, "polygon": [[left, low], [right, low], [right, high], [left, high]]}]
    x, y = 0.5 * (left + right), 0.5 * (low + high)
    ring = [[left, low], [x, low], [right, low], [right, y], [right, high], [x, high], [left, high], [left, y]]
    return [{"id": f"{name}t{k}", "polygon": [[x, y], ring[k], ring[(k + 1) % 8]], "block": name} for k in range(8)]


def run(out: Path, coarse: bool) -> pd.DataFrame:
    """λ by strength, cohesive and frictional cracks, experiments, table, picture and page."""
    size: dict[str, Any] = {"courses": 4, "length": 2} if coarse else {}
    rigid = solve(wall(1.0, rigid=True, **size))
    rows: list[dict[str, Any]] = [
        {"part": "rigid bricks", "load_factor": rigid.load_factor, "status": str(rigid.status)}
    ]
    for friction in CRACKS:
        for strength in np.geomspace(0.1, 10.0, 4 if coarse else 17):
            found = solve(wall(float(strength), friction, **size))
            row: dict[str, Any] = {"part": "frictional" if friction else "cohesive", "strength": float(strength)}
            row |= {"load_factor": found.load_factor, "status": str(found.status)}
            row["ratio"] = found.load_factor / rigid.load_factor
            rows.append(row)
    for strength in SHOWN[1:2] if coarse else SHOWN:
        assembly = wall(strength, **size)
        for joints in (Joints(residual_friction=FRICTION), Joints(inner="plastic")):
            curve = run_experiment(assembly, joints=joints, settings=Settings(periods=40.0, length=12.0, segments=2))
            row = {"part": f"experiment, {joints.inner}", "strength": strength, "status": str(curve.standing)}
            row |= {"load_factor": curve.collapse_load if curve.stands else 0.0, "rate_error": curve.rate_error}
            row["ratio"] = row["load_factor"] / rigid.load_factor
            rows.append(row)
    table = pd.DataFrame(rows)
    drawn = [solve(wall(strength, **size)) for strength in SHOWN]
    write(out, _report(table, rigid), table, {"": _picture(table, rigid, drawn)})
    return table


def weakest(table: pd.DataFrame, part: str, share: float) -> float:
    """The least strength from which λ is at least a share of that of rigid bricks."""
    rows = table[(table["part"] == part) & (table["ratio"] >= share)]
    return float(rows["strength"].min())


def _frictional(table: pd.DataFrame) -> list[str]:
    """What friction in cracks changes, where it was tried."""
    if not (table["part"] == "frictional").any():
        return []
    return [
        f"With friction μ = {FRICTION:g} in cracks besides, they reach it from "
        f"{weakest(table, 'frictional', 0.99):.2g} on, "
        f"and half of it from {weakest(table, 'frictional', 0.5):.2g} on: friction matters where bricks are weak."
    ]


def _report(table: pd.DataFrame, rigid: LimitAnalysisResult) -> Report:
    lost = table[(table["part"].isin(["cohesive", "frictional"])) & (table["status"] != str(Status.COLLAPSE))]
    tried = table[table["part"].str.startswith("experiment")]
    said = "; ".join(
        f"{row['part'].split(', ')[1]} at {row['strength']:g}: {row['ratio']:.2f}" for row in tried.to_dict("records")
    )
    return Report(
        name=NAME,
        title="Cracking units",
        question="How strong must a brick be for a wall in running bond to be a wall of rigid bricks?",
        source="After Portioli et al., Engineering Structures 57 (2013) 232–247: bricks with potential cracks along "
        "both axes and both diagonals. Their walls are not at hand; nothing is reproduced.",
        model=f"{COURSES} courses of {LENGTH} bricks of {BRICK[0]:g} × {BRICK[1]:g} m, eight triangles a brick, dry "
        f"joints μ = {FRICTION:g}, horizontal body load, associative. Strength: σt = τ of a brick over ρgH. Cracks "
        "carry τ whatever the pressure. Experiments: no dilation, three points a face, brittle cracks keep friction "
        f"{FRICTION:g}; two rates.",
        agrees=(
            f"Rigid bricks: λ = {rigid.load_factor:.4f}, which no strength of the brick betters, and which bricks "
            f"reach to 1 % from σt = τ = {weakest(table, 'cohesive', 0.99):.2g} ρgH on; half of it is left from "
            f"{weakest(table, 'cohesive', 0.5):.2g} ρgH on.",
            *_frictional(table),
        ),
        differs=(
            f"{len(lost)} of {int(table['part'].isin(['cohesive', 'frictional']).sum())} walls do not stand at all: "
            "cracks that carry too little shear slide under the weight above.",
            f"Experiments over rigid bricks: {said}. Brittle bricks need more strength than limit analysis says.",
            "Where cracks may run is given by eight triangles; another pattern gives another λ for weak bricks.",
        ),
        pictures={"": "Top: λ over that of rigid bricks by strength. Bottom: mechanisms by strength of the bricks."},
    )  # fmt: skip


def _picture(table: pd.DataFrame, rigid: LimitAnalysisResult, drawn: list[LimitAnalysisResult]) -> Figure:
    figure = figure_of(12.8, 8.6)
    ax = axes_at(figure, 0.8, 4.75, 11.4, 3.4)
    for part, (colour, dash, marker), name in (
        ("cohesive", PAIRED[0], "cohesive cracks"),
        ("frictional", PAIRED[1], f"cracks with friction {FRICTION:g} besides"),
        ("experiment, plastic", PAIRED[2], "experiment without dilation, plastic, cohesive"),
        ("experiment, brittle", PAIRED[3], "experiment without dilation, brittle with friction in cracks"),
    ):
        rows = table[table["part"] == part]
        if rows.empty:
            continue
        line = "none" if part.startswith("experiment") else dash
        ax.plot(rows["strength"], rows["ratio"], marker, color=colour, ls=line, ms=5, lw=1.3, label=name)
    ax.axhline(1.0, color=GREY, lw=0.9, ls=(0, (4, 2)), label=f"rigid bricks, λ = {rigid.load_factor:.4f}")
    ax.set_xscale("log")
    name_axes(ax, "strength of the brick σt / ρgH = τ / ρgH [–]", "λ / λ of rigid bricks [–]")
    ax.set_ylim(0.0, 1.12)
    ax.legend(frameon=False, fontsize=8, loc="lower right")
    for k, (result, strength) in enumerate(zip(drawn, SHOWN, strict=True)):
        _mechanism(axes_at(figure, 0.7 + 4.1 * k, 0.75, 3.6, 3.2), result, strength)
    legend_at(
        figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack", "at rest"), 0.7, 0.02, 7
    )
    figure.suptitle("Running-bond walls of bricks that crack along axes and diagonals", fontsize=12, y=0.985)
    return figure


def _mechanism(ax: Axes, result: LimitAnalysisResult, strength: float) -> None:
    draw_mechanism(ax, result)
    value = f"λ = {result.load_factor:.3f}" if result.status is Status.COLLAPSE else str(result.status)
    without_legend(ax, f"σt = {strength:g} ρgH, cohesive: {value}")
    name_axes(ax, "x [m]", "y [m]", size=8)
