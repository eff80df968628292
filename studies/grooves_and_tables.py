"""Yield surfaces as data and tilting tables: grooved joints in every direction, a ribbed section, a glued block tilted.

Source: closed forms, stated beside the numbers; no published number of an orthotropic joint was to be had.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import brentq

from jld_core import Floats, solve
from studies.report import PAIRED, Report, axes_at, figure_of, name_axes, write

NAME: Final = "grooves_and_tables"
ALONG, ACROSS, LOCKS = 0.6, 0.35, 0.3
TEE: Final = [[0, 0], [0.35, 0], [0.35, 0.4], [1, 0.4], [1, 0.6], [0.35, 0.6], [0.35, 1], [0, 1]]
CONES: Final = {"elliptic cone": ("elliptic", 0.0), "product cone": ("product", 0.0), "with locks": ("product", LOCKS)}


def _box(name: str, low: list[float], high: list[float], **keys: Any) -> dict[str, Any]:
    (a, b, c), (x, y, z) = low, high
    corners = [[a, b, c], [x, b, c], [x, y, c], [a, y, c], [a, b, z], [x, b, z], [x, y, z], [a, y, z]]
    sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return {"id": name, "vertices": corners, "faces": sides, **keys}


def slid(angle: float, cone: str, locks: float) -> float:
    """λ of a plate of weight 1 per area on grooves along x, pushed at an angle; locks resist `locks` of its weight."""
    friction = {"coefficients": [ALONG, ACROSS], "cohesion": [0.01 * locks, 0.0], "direction": [1, 0, 0], "cone": cone}
    plate, ground = _box("a", [-1, -1, 0], [1, 1, 0.01]), _box("s", [-3, -3, -1], [3, 3, 0], support=True)
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"surface": {"friction": friction, "bending": {}}}}
    live = [{"body": [math.cos(angle), math.sin(angle), 0.0]}]
    return solve({"elements": [ground, plate], "materials": materials, "loads": {"live": live}}).load_factor


def slid_in_closed_form(angle: Floats | float, cone: str, locks: float) -> Any:
    """1/√((cos/μ1)² + (sin/μ2)²), and of a product cone the weaker of (μ1 + c)/|cos| and μ2/|sin|."""
    along, across = abs(np.cos(angle)), abs(np.sin(angle))
    if cone == "elliptic":
        return 1.0 / np.hypot(along / ALONG, across / ACROSS)
    with np.errstate(divide="ignore"):
        return np.minimum((ALONG + locks) / along, ACROSS / across)


def bent(way: float, weight: float) -> float:
    """λ of a block glued by a tee (strengths 2 and 20, flange at its left), bent one way or the other."""
    section = {
        "polygons": [TEE],
        "direction": [1, 0],
        "tensile_strength": 2.0,
        "compressive_strength": 20.0,
        "shear_strength": 1e3,
    }
    corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
    ground = {"id": "s", "polygon": [[0, -1], [1, -1], [1, 0], [0, 0]], "support": True}
    return solve(
        {
            "elements": [ground, {"id": "a", "polygon": corners, "weight": weight}],
            "labels": {"default": "inner"},
            "materials": {"inner": {"surface": {"section": section}}},
            "loads": {"live": [{"body": [way, 0.0]}]},
        }
    ).load_factor


def tilted(cohesion: float) -> tuple[float, float, float]:
    """Arc tangent of λ and both ends of the angle, degrees: a flat block, μ = 0.5, c A = cohesion × weight."""
    ground = {"id": "s", "polygon": [[-9, -1], [9, -1], [9, 0], [-9, 0]], "support": True}
    block = {"id": "a", "polygon": [[-2, 0], [2, 0], [2, 0.4], [-2, 0.4]], "weight": 4.0}
    materials = {"dry": {"friction_coefficient": 0.5, "cohesion": cohesion}}
    loads = {"live": [{"tilt": {"towards": [1, 0]}}]}
    found = solve({"elements": [ground, block], "materials": materials, "loads": loads})
    low, high = found.facts["tilt_bracket"]
    return math.degrees(math.atan(found.load_factor)), low, high


def tilted_in_closed_form(cohesion: float) -> float:
    """Angle θ of sin θ = μ cos θ + c A/W, degrees."""
    return math.degrees(brentq(lambda x: math.sin(x) - 0.5 * math.cos(x) - cohesion, 0.0, 2.0))


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Compute all numbers, and write table, page and picture."""
    rows: list[dict[str, Any]] = []
    for name, (cone, locks) in CONES.items():
        for angle in np.linspace(0.0, 2.0 * np.pi, 8 if coarse else 36, endpoint=False):
            known = float(slid_in_closed_form(angle, cone, locks))
            row = {"part": name, "at": math.degrees(angle), "found": slid(float(angle), cone, locks)}
            rows.append({**row, "closed_form": known})
    for weight in np.linspace(0.5, 5.5, 3 if coarse else 11):
        rows += [{"part": f"tee {way:+.0f}", "at": float(weight), "found": bent(way, float(weight))} for way in (-1, 1)]
    for cohesion in np.linspace(0.0, 0.9, 3 if coarse else 10):
        level, low, high = tilted(float(cohesion))
        known = tilted_in_closed_form(float(cohesion))
        row = {"part": "table", "at": float(cohesion), "found": 0.5 * (low + high), "closed_form": known}
        rows.append({**row, "level": level, "width": high - low})
    table = pd.DataFrame(rows)
    worst = float((abs(table["found"] / table["closed_form"] - 1.0)).max())
    report = Report(
        name=NAME,
        title="Grooved joints, ribbed sections, tilting tables",
        question="Do yield surfaces that a scene states as data slide, bend and tilt as closed forms say?",
        source="closed forms alone: no published number of an orthotropic or interlocked joint was to be had.",
        model=f"A plate on grooves, μ = {ALONG} along and {ACROSS} across, locks of {LOCKS} of its weight; a block of "
        "1 × 1 glued by a tee of strengths 2 and 20; a flat block with μ = 0.5 and cohesion, on a table.",
        agrees=(
            f"Sliding in every direction, and angles of the table, agree with the closed forms within {worst:.0e}.",
            f"The bracket of an angle is at most {table['width'].max():.0e} degrees wide.",
            "With friction alone the angle is the arc tangent of λ; cohesion makes the table tilt further than λ says, "
            "since what presses becomes less with what pulls.",
        ),
        differs=("The polytope of a section lies inside its curved surface: λ of the tee is on the safe side.",),
        pictures={
            "": "Left: λ of a plate by the direction of the push; marks computed, lines in closed form. Middle: λ of a "
            "block on a tee by its weight, bent either way. Right: angle of a tilting table by cohesion."
        },
    )
    write(out, report, table, {"": _picture(table)})
    return table


def _picture(table: pd.DataFrame) -> Figure:
    figure = figure_of(13.2, 4.6)
    polar = axes_at(figure, 0.4, 0.5, 3.7, 3.5, projection="polar")
    dense = np.linspace(0.0, 2.0 * np.pi, 400)
    for (name, (cone, locks)), (colour, dash, marker) in zip(CONES.items(), PAIRED, strict=False):
        own = table[table["part"] == name]
        polar.plot(dense, slid_in_closed_form(dense, cone, locks), color=colour, ls=dash, lw=1.2)
        polar.plot(np.radians(own["at"]), own["found"], marker, color=colour, ms=4, label=name)
    polar.set_title("λ by the direction of the push; grooves run from 0° to 180°", fontsize=9)
    polar.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(-0.1, -0.12))
    ax = axes_at(figure, 5.1, 0.7, 3.4, 3.3)
    for way, (colour, dash, marker) in zip((-1, 1), PAIRED, strict=False):
        own = table[table["part"] == f"tee {way:+d}"]
        ax.plot(own["at"], own["found"], marker=marker, color=colour, ls=dash, ms=4, label=f"pushed {way:+d}")
    name_axes(ax, "weight [–]", "λ [–]", "a tee bends one way more easily")
    ax.legend(frameon=False, fontsize=8)
    ax = axes_at(figure, 9.4, 0.7, 3.4, 3.3)
    own = table[table["part"] == "table"]
    (blue, _, first), (orange, dash, second) = PAIRED[:2]
    ax.plot(own["at"], own["found"], first, color=blue, ms=5, label="angle at which it falls")
    ax.plot(own["at"], own["closed_form"], color=blue, lw=1.2, label="sin θ = μ cos θ + c A/W")
    ax.plot(own["at"], own["level"], marker=second, color=orange, ls=dash, ms=4, label="arctan λ")
    name_axes(ax, "cohesion c A/W [–]", "angle [degrees]", "a table tilts further than λ says")
    ax.legend(frameon=False, fontsize=8)
    return figure
