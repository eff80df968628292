"""The strongest segmentation of a wall with an opening under horizontal load, blocks limited for transport.

Source: none but the method (Iannuzzo et al. 2024) and this project's exact search; geometry and materials are ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import LimitAnalysisResult, build_assembly, solve
from jld_explore import Exploration, ExploreSettings
from jld_explore.space import from_string
from jld_views.figures import draw_assembly, draw_mechanism
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
from studies.scenes import wall_with_opening

NAME: Final = "wall_with_opening"
FRICTION: Final = 0.75
PLAIN: Final = ["aaaaaa", "aa..aa", "aa..aa", "aaaaaa", "######"]
BOND: Final = ["aaabbb", "cd..ef", "gg..hh", "iijjkk", "######"]
"""The usual running bond with blocks of one to three cells; two lintel blocks meet over the opening."""


def search(coarse: bool) -> Exploration:
    """The proven front: blocks of 1–3 cells by branch and bound; coarse: of 2–3 cells by enumeration."""
    wanted: dict[str, Any] = {"block_cells": [2, 3] if coarse else [1, 3]}
    settings = ExploreSettings(driver="exact", jobs=1, options={"aim": "front"})
    if coarse:
        settings = ExploreSettings(driver="enumeration", jobs=1)
    return searched(wall_with_opening(PLAIN, FRICTION, wanted), settings)


def running_bond() -> LimitAnalysisResult:
    """The usual bond."""
    return solve(build_assembly(wall_with_opening(BOND, FRICTION)))


def _joints(result: LimitAnalysisResult) -> int:
    return int((result.labels & result.assembly.free_faces).sum())


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Search, write table, picture and page into a folder; returns the table of the front and the bond."""
    done, bond = search(coarse), running_bond()
    ranked = done.results[done.results["status"] == "collapse"]
    front = ranked.sort_values("load_factor", ascending=False, kind="stable").drop_duplicates("dry_faces")
    front = front.sort_values("dry_faces", kind="stable").reset_index(drop=True)
    bounds = {part["count"]: part for part in done.summary.facts.get("front", [])}
    # of counts that tie only the best is on the front of a summary
    all_known = {"proven": done.summary.proven, "bound": np.nan}
    known = [bounds.get(k, all_known) for k in front["dry_faces"]]
    proven = [bool(part["proven"]) for part in known]
    table = front[["dry_faces", "blocks", "load_factor", "bracket_lo", "bracket_hi", "labelling"]].assign(
        bound=[part["bound"] for part in known], proven=proven, layout="strongest"
    )
    own = {"dry_faces": _joints(bond), "blocks": 11, "load_factor": bond.load_factor, "layout": "running bond"}
    table = pd.concat([table, pd.DataFrame([own])], ignore_index=True)
    top = float(front["load_factor"].max())
    most = int(front[front["load_factor"] > top * (1.0 - 1e-6)]["dry_faces"].max())
    equal = int(front[front["load_factor"] >= bond.load_factor * (1.0 - 1e-2)]["dry_faces"].max())
    same = front[front["dry_faces"] == _joints(bond)]["load_factor"]
    blocks = "2–3" if coarse else "1–3"
    evaluated = f"{done.summary.evaluated} layouts solved, driver {done.summary.driver}"
    report = Report(
        name=NAME,
        title="Wall with an opening: the strongest way to cut it",
        question="With blocks small enough to carry, which layout resists the largest horizontal load, and how far is "
        "the usual running bond from it?",
        source="No published numbers: the question of the method, answered by this project's search with proof.",
        model="Ours: cells 0.4 × 0.3 m, 0.3 m thick, six by four with an opening of two by two, 2000 kg/m³ (a cell "
        f"weighs 72 kg), dry μ = {FRICTION}, σt = τ = 0.2 MPa; horizontal body load to the right, λ in weights. Blocks "
        f"of {blocks} cells. For every number of dry faces the strongest layout ({evaluated}).",
        agrees=(
            f"The largest λ is {top:.6f}: sliding of the whole wall on its base, λ = μ, which no layout can exceed; it "
            f"is reached with up to {most} dry faces.",
            f"{sum(proven)} of {len(front)} points of the front are proven: no layout with as many dry faces is better "
            "by more than 1e-6.",
        ),
        differs=(
            f"The running bond carries λ = {bond.load_factor:.4f} with {_joints(bond)} dry faces, "
            f"{100 * (1 - bond.load_factor / float(same.iloc[0])):.1f} % less than the strongest layout with as many."
            if len(same)
            else f"The running bond carries λ = {bond.load_factor:.4f}; no layout searched has as many dry faces.",
            f"Layouts as strong as the bond, to 1 %, exist with up to {equal} dry faces, that is, with smaller blocks.",
            "Cracked blocks are allowed for, shipping damage and the joints' own cost are not; the answer holds for "
            "this load to the right. A wall shaken both ways needs both directions, which is another search.",
        ),
        pictures={
            "": "Front of λ against dry faces with the usual running bond, and layouts with their mechanisms: the "
            "three strongest points of the front that have the most joints, and the bond."
        },
    )
    write(out, report, table, {"": _picture(done, front, bond, proven)}, table.drop(columns=["labelling"]))
    return table


def _picture(done: Exploration, front: pd.DataFrame, bond: LimitAnalysisResult, proven: list[bool]) -> Figure:
    figure = figure_of(12.8, 10.3)
    top = float(front["load_factor"].max())
    first = int(np.flatnonzero(front["load_factor"].to_numpy(dtype=float) > top * (1.0 - 1e-6))[-1])
    chosen = list(range(first, min(first + 3, len(front))))
    _front(axes_at(figure, 0.8, 5.9, 11.6, 3.9), done, front, bond, chosen, all(proven))
    shown = [("running bond", bond)]
    shown += [
        (f"{number}", solve(done.assembly, from_string(str(front["labelling"].iloc[k]))))
        for number, k in enumerate(chosen, 1)
    ]
    for k, (name, result) in enumerate(shown):
        for draw, bottom in ((draw_assembly, 3.1), (draw_mechanism, 0.75)):
            ax = axes_at(figure, 0.6 + 3.1 * k, bottom, 2.65, 1.85)
            if draw is draw_assembly:
                draw_assembly(ax, result.assembly, result.labels)
                without_legend(ax, f"{name}: {_joints(result)} dry faces, λ = {result.load_factor:.4f}")
            else:
                draw_mechanism(ax, result)
                without_legend(ax, f"{name}: mechanism")
            name_axes(ax, "x [m]", "y [m]" if k == 0 else "", size=8)
    names = ("dry face", "inner face", "hinge", "slide", "open", "crack", "at rest")
    legend_at(figure, drawing_handles(*names), 2.6, 0.0, 7)
    figure.suptitle("Wall with an opening under horizontal load", fontsize=12, y=0.99)
    return figure


def _front(
    ax: Axes, done: Exploration, front: pd.DataFrame, bond: LimitAnalysisResult, chosen: list[int], proven: bool
) -> None:
    ranked = done.results[done.results["status"] == "collapse"]
    style: dict[str, Any] = {"color": "#7C9CBF", "ms": 3.2, "mew": 0.0, "alpha": 0.7, "rasterized": True}
    ax.plot(ranked["dry_faces"], ranked["load_factor"], "o", label=f"{len(ranked)} layouts solved", **style)
    words = "strongest for each number of dry faces" + (", proven" if proven else ", not all proven")
    ax.plot(front["dry_faces"], front["load_factor"], "s", color=PAIRED[1][0], ls="solid", lw=1.2, ms=5, label=words)
    ax.plot(_joints(bond), bond.load_factor, "*", color="#1B1B1B", ms=13, label="usual running bond")
    ax.axhline(FRICTION, color=GREY, lw=1.0, ls=(0, (4, 2)), label="sliding on the base, λ = μ")
    for number, k in enumerate(chosen, 1):
        at = (float(front["dry_faces"].iloc[k]), float(front["load_factor"].iloc[k]))
        ax.annotate(str(number), at, xytext=(5, 7), textcoords="offset points", fontsize=10, fontweight="bold")
    ax.set_ylim(0.0, 1.12 * FRICTION)
    ax.locator_params(axis="x", integer=True)
    name_axes(ax, "dry faces between blocks [–]", "load factor λ, horizontal over weight [–]")
    ax.legend(frameon=False, fontsize=8.5, loc="lower left")
