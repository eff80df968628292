"""The T block of Figure 1: one rigid block against five elements with four inner faces and one dry.

Source: Iannuzzo et al. 2024, Figure 1, for the idea; the measures, the loads and the closed forms are ours.
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
from matplotlib.ticker import FixedLocator, NullLocator

from jld_core import LimitAnalysisResult, Status, build_assembly, solve
from jld_core.limit.mechanism import Movement, face_motions
from jld_views.figures import draw_assembly, draw_mechanism
from studies.report import (
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    fill_region,
    legend_at,
    name_axes,
    without_legend,
    write,
)
from studies.scenes import t_block

NAME: Final = "t_block"
CELL: Final = 1400 * 9.81 * 1e-3
"""Weight of one cell, N."""

SIDE, AREA, FRICTION = 0.1, 0.01, float(np.tan(np.radians(30.0)))

WORDS: Final = {
    "base": ("as one rigid block", "#CFE1F2", ""),
    "arm in tension": ("arm breaks off", "#F6D3D9", ".."),
    "arm in shear": ("arm shears off", "#FBE3B5", "//"),
    "stem in tension": ("stem breaks", "#D3EBCD", "\\\\"),
    "stem in shear": ("stem shears", "#E3D9EE", "++"),
    "falls": ("cannot carry itself", "#DADADA", "xx"),
}
"""What gives way: words, fill, hatch."""


def closed_form(load: str, tension: float, shear: float) -> tuple[float, str]:
    """λ in N and what gives way, by statics of a tree of five cells; NaN where it cannot carry its own weight.

    An arm is a cantilever; the faces of the stem are loaded eccentrically; each face can open, |M| ≤ (N + σt A) l/6, or
    shear, |V| ≤ τ A; the base can tip, |M| ≤ N l/2, or slide. For "arm", P acts at the end of an arm, 0.15 m off the
    stem's axis; for "top", horizontally, 0.25 m above the base.
    """
    w, pull, cut = CELL, tension * AREA, shear * AREA
    kern = SIDE / 6.0
    if cut < w or pull * kern < w * SIDE / 2.0:
        return float("nan"), "falls"
    if load == "arm":
        limits = {
            "base": 5 * w * 0.05 / (0.15 - 0.05),
            "arm in tension": (pull * kern - w * SIDE / 2.0) / SIDE,
            "arm in shear": cut - w,
            "stem in tension": (3 * w + pull) * kern / (0.15 - kern),
        }
    else:
        limits = {
            "base": min(5 * w * 0.05 / 0.25, FRICTION * 5 * w),
            "stem in tension": min((3 * w + pull) * kern / 0.05, (4 * w + pull) * kern / 0.15),
            "stem in shear": cut,
        }
    weakest = min(limits, key=lambda name: limits[name])
    return limits[weakest], weakest


def gives_way(result: LimitAnalysisResult) -> str:
    """What the computed mechanism says gives way; several joined by "+"."""
    if result.status is Status.UNSTABLE:
        return "falls"
    found = set()
    ids, faces = result.assembly.elements.ids, result.assembly.interfaces
    for k, motion in enumerate(face_motions(result)):
        if motion.kind is Movement.CLOSED:
            continue
        arm = "middle" in (ids[faces.a[k]], ids[faces.b[k]]) and "stem" not in (ids[faces.a[k]], ids[faces.b[k]])
        how = "shear" if motion.kind is Movement.CRACK_SHEAR else "tension"
        found.add("base" if result.labels[k] else f"{'arm' if arm else 'stem'} in {how}")
    return "+".join(sorted(found))


def solved(load: str, tension: float, shear: float) -> LimitAnalysisResult:
    """The five-element model."""
    return solve(build_assembly(t_block(tension, shear, load)))


def rigid(load: str) -> LimitAnalysisResult:
    """The T as one element."""
    return solve(build_assembly(t_block(1.0, 1.0, load, rigid=True)))


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Solve both maps, write table, picture and page into a folder; returns the table."""
    steps = 6 if coarse else 30
    tensions, shears = np.geomspace(2e3, 9e4, steps), np.geomspace(7e2, 3e4, steps)
    rows: list[dict[str, Any]] = []
    for load, tension, shear in itertools.product(("arm", "top"), tensions, shears):
        found = solved(load, float(tension), float(shear))
        exact, weakest = closed_form(load, float(tension), float(shear))
        rows.append(
            {
                "load": load,
                "tension_Pa": tension,
                "shear_Pa": shear,
                "load_factor_N": found.load_factor,
                "closed_form_N": exact,
                "status": str(found.status),
                "gives_way": gives_way(found),
                "expected": weakest,
            }
        )
    table = pd.DataFrame(rows)
    whole = {load: rigid(load).load_factor for load in ("arm", "top")}
    standing = table[table["expected"] != "falls"]
    off = (standing["load_factor_N"] / standing["closed_form_N"] - 1.0).abs()
    same = int((table["gives_way"] == table["expected"]).sum())
    need = {load: _needed(load, whole[load]) for load in whole}
    report = Report(
        name=NAME,
        title="T block of Figure 1: when does it crack?",
        question="When is a block that may crack as strong as the same block taken to be rigid?",
        source="Figure 1 of Iannuzzo et al. 2024: a T block as one rigid element, or as five elements with four inner "
        "faces and one dry. The figure's measures are not at hand.",
        model="Ours: a T of five cells of 0.1 m, 0.1 m deep, 1400 kg/m³, on a dry base with 30°; loaded by a vertical "
        "force on the tip of an arm, or a horizontal one at mid-height of the top. λ is the force in N.",
        agrees=(
            f"Rigid block: {whole['arm']:.4f} N on the arm (closed form {2.5 * CELL:.4f}), {whole['top']:.4f} N at the "
            f"top (closed form {CELL:.4f}); the five elements reach the same value wherever the base governs.",
            f"{len(standing)} standing points agree with statics by hand to {off.max():.1e} relative; what gives way "
            f"is as expected at {same} of {len(table)} points.",
            f"Under the force on the arm it stays whole for σt ≥ {need['arm'][0] / 1e3:.1f} kPa and τ ≥ "
            f"{need['arm'][1] / 1e3:.2f} kPa; under the force at the top for σt ≥ {need['top'][0] / 1e3:.1f} kPa and "
            f"τ ≥ {need['top'][1] / 1e3:.2f} kPa.",
        ),
        differs=(
            "Nothing of the source's numbers is compared: Figure 1 gives none that are at hand.",
            "At the strengths of section 3.3 (σt = 2 MPa, τ = 0.2 MPa) a T of this size never cracks under these "
            "loads: the rigid block is exact, and the cells cost computing time only.",
            "Below σt = 4.1 kPa or τ = 1.4 kPa the arms break off under their own weight; a rigid block cannot know.",
        ),
        pictures={
            "": "Left: the two models under both loads. Middle: what gives way by σt and τ (fills: computed; lines: λ "
            "over λ of the rigid block). Right: mechanisms at the lettered points."
        },
    )
    summary = (
        table.groupby(["load", "gives_way"], sort=False)
        .agg(points=("status", "size"), lowest_N=("load_factor_N", "min"), highest_N=("load_factor_N", "max"))
        .reset_index()
    )
    write(out, report, table, {"": _picture(table, whole)}, summary)
    return table


def _needed(load: str, whole: float) -> tuple[float, float]:
    """Least σt and τ, Pa, each with the other ample, at which the T is as strong as the rigid one."""
    ends = []
    for axis in (0, 1):
        low, high = 1e2, 1e6
        while high / low > 1.0 + 1e-6:
            middle = (low * high) ** 0.5
            value, _ = closed_form(load, *((middle, 1e9) if axis == 0 else (1e9, middle)))
            low, high = (low, middle) if value >= whole * (1.0 - 1e-9) else (middle, high)
        ends.append(high)
    return ends[0], ends[1]


POINTS: Final = {
    "arm": {"A": (6e4, 1.5e4), "B": (1.2e4, 1.5e4), "C": (6e4, 3e3)},
    "top": {"D": (6e4, 1.5e4), "E": (4.6e3, 1.5e4)},
}
"""(σt, τ) in Pa of the mechanisms drawn."""


def _picture(table: pd.DataFrame, whole: dict[str, float]) -> Figure:
    figure = figure_of(14.2, 10.0)
    for row, load in enumerate(("arm", "top")):
        bottom = 5.6 - 4.8 * row
        kinds = (("one rigid block", rigid(load)), ("five elements, four inner faces", solved(load, 2e6, 2e5)))
        for k, (name, result) in enumerate(kinds):
            ax = axes_at(figure, 0.6, bottom + 2.3 * (1 - k), 1.9, 1.5)
            draw_assembly(ax, result.assembly, result.labels)
            without_legend(ax, f"{name}\nλ = {result.load_factor:.2f} N")
            ax.set_xlabel("x [m]" if k else "", fontsize=8)
            ax.tick_params(labelbottom=k == 1)
            ax.set_ylabel("y [m]", fontsize=8)
        ax = axes_at(figure, 3.45, bottom, 4.4, 3.8)
        _map(ax, load, table[table["load"] == load], whole[load])
        for k, (name, (tension, shear)) in enumerate(POINTS[load].items()):
            ax.plot(tension / 1e3, shear / 1e3, "o", ms=13, mfc="white", mec="#1B1B1B", mew=0.9, zorder=5)
            ax.text(tension / 1e3, shear / 1e3, name, ha="center", va="center", fontsize=8, zorder=6)
            found = solved(load, tension, shear)
            small = axes_at(figure, 8.35 + 1.95 * k, bottom + 0.9, 1.75, 2.2)
            draw_mechanism(small, found)
            without_legend(small, f"{name}: λ = {found.load_factor:.2f} N")
            small.set_xlabel("x [m]", fontsize=8)
            small.set_ylabel("")
            small.tick_params(labelleft=False)
    handles = [
        *drawing_handles("dry face", "inner face"),
        Line2D([], [], color="#1B1B1B", lw=0.8, label="λ over λ of the rigid block"),
        *drawing_handles("crack", "hinge", "at rest"),
    ]
    legend_at(figure, handles, 3.2, 0.05)
    figure.suptitle("T block: rigid, or free to crack", fontsize=12, y=0.99)
    return figure


def _map(ax: Axes, load: str, table: pd.DataFrame, whole: float) -> None:
    x, y = (np.unique(table[name].to_numpy(dtype=float)) / 1e3 for name in ("tension_Pa", "shear_Pa"))
    ax.set_xscale("log")
    ax.set_yscale("log")
    kinds = table["gives_way"].to_numpy().reshape(len(x), len(y)).T
    for kind, (words, fill, hatch) in WORDS.items():
        mask = kinds == kind
        if not mask.any():
            continue
        fill_region(ax, x, y, mask, fill, hatch)
        rows, columns = np.nonzero(mask)
        if kind == "falls":
            place = (float(x[len(x) // 2]), float(y[1]))
        else:
            low, high = float(y[rows].min()), float(y[rows].max())
            place = (float(np.exp(np.log(x[columns]).mean())), low**0.7 * high**0.3)
        if mask.sum() > 0.01 * mask.size:
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
            # a column too narrow for its words gets them upright
            upright = np.ptp(np.log(x[columns])) < 0.2 * np.ptp(np.log(x))
            turn = 90 if upright else 0
            ax.text(*place, words, ha="center", va="center", rotation=turn, fontsize=8.5, bbox=box, zorder=4)
    share = table["load_factor_N"].to_numpy(dtype=float).reshape(len(x), len(y)).T / whole
    lines = ax.contour(x, y, share, levels=[0.25, 0.5, 0.75, 0.999], colors="#1B1B1B", linewidths=0.8)
    ax.clabel(lines, fmt={0.25: "1/4", 0.5: "1/2", 0.75: "3/4", 0.999: "1"}, fontsize=7.5)
    name_axes(ax, "tensile strength σt [kPa]", "shear strength τ [kPa]")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 50]))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(lambda value, _: f"{value:g}")
    name = "force on the tip of the arm" if load == "arm" else "horizontal force at the top"
    ax.set_title(f"What gives way: {name}", fontsize=10)
