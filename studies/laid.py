"""A lintel that can be laid: the strongest layout over an opening, and the strongest that stands while it is laid."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from jld_core import Assembly, Scene, build_assembly, parse_scene, solve
from jld_explore import ExploreSettings
from jld_explore.space import from_string
from jld_practice.laying import assembly_order
from jld_practice.laying.strip import figure_of_laying
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

NAME: Final = "laid"
LOADS: Final = ("c2r0", "c3r0")


def scene(assemble: str | None = None) -> Scene:
    """Two courses of six cells over an opening of two; blocks of two or three cells."""
    search: dict[str, Any] = {"block_cells": [2, 3]}
    if assemble is not None:
        search["assemble"] = assemble
    return parse_scene(
        {
            "name": "lintel over an opening",
            "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["aaaaaa", "aaaaaa", "##..##"]},
            "materials": {
                "density": 1400,
                "dry": {"friction_coefficient": 0.7},
                "inner": {"tensile_strength": 2e4, "shear_strength": 2e4},
            },
            "loads": {"live": [{"element": name, "force": [0, -1]} for name in LOADS]},
            "search": search,
        }
    )


def props(assembly: Assembly, labelling: str) -> float:
    """Most that props must carry at any stage of the order found, N."""
    laying = assembly_order(assembly, from_string(labelling))
    return max(float(step.stage.props.sum()) for step in laying.steps)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Search with and without the limit, write table, pictures and page into a folder; returns the table."""
    settings = ExploreSettings(pictures=False, driver="exact" if coarse else "enumeration", jobs=1)
    free = searched(scene(), settings)
    kept = searched(scene("standing"), settings)
    assembly = build_assembly(scene())
    rows = free.results[free.results["status"] == "collapse"][["labelling", "load_factor", "blocks", "dry_faces"]]
    rows = rows.head(3) if coarse else rows
    table = rows.assign(props=[props(assembly, str(text)) for text in rows["labelling"]]).reset_index(drop=True)
    standing = table[table["props"] < 1e-3]
    worst = table.iloc[int(table["props"].argmax())]
    cost = 1.0 - kept.summary.facts["best"] / free.summary.facts["best"]
    weight = float(-assembly.elements.weight[assembly.elements.free].sum())
    report = Report(
        name=NAME,
        title="A lintel that can be laid",
        question="The strongest layout of a lintel over an opening: does it stand while it is laid, and what do other "
        "layouts need?",
        source="No published numbers: the question of the method, answered by this project's search with proof.",
        model="Ours: cells of 0.1 m, 0.1 m thick, 1400 kg/m³, two courses of six over an opening of two cells; dry "
        "μ = 0.7, σt = τ = 20 kPa; λ newtons on each of the two upper cells over the opening. Blocks of two or three "
        'cells. `search.assemble: "standing"`: an order of laying whose every stage stands under its own weight.',
        agrees=(
            f"Asking for a layout that stands at every stage costs {100 * cost:.2f} % of λ here: the strongest, "
            f"λ = {free.summary.best:.2f} N, is one (both proven).",
            f"{len(standing)} of {len(table)} layouts that carry a load stand at every stage of the order found.",
            f"The others need props of up to {worst.props:.3g} N while they are laid, "
            f"{100 * worst.props / weight:.0f} % of all their weight; that one carries λ = {worst.load_factor:.1f} N.",
        ),
        differs=(
            "Stages are held against their own weight alone: no tools, no people on the lintel, no wedging.",
            "The order is one found block by block; another may need other props.",
        ),
        pictures={
            "": "Left: λ of layouts against the most that props must carry while they are laid. Right: the strongest "
            "layout and the one that needs most props, with their mechanisms at collapse.",
            "_stages": "The layout that needs most props, stage by stage: arrows are props.",
        },
    )
    laying = assembly_order(assembly, from_string(str(worst.labelling)))
    best = {"strongest": str(table["labelling"][0]), "most props": str(worst.labelling)}
    stages = figure_of_laying(laying, "the layout that needs most props, laid")
    write(out, report, table, {"": _picture(table, assembly, best), "_stages": stages}, table.head(12))
    return table.assign(cost=cost)


def _picture(table: pd.DataFrame, assembly: Assembly, best: dict[str, str]) -> Figure:
    figure = figure_of(12.6, 6.6)
    ax = axes_at(figure, 0.8, 0.9, 4.6, 4.9)
    ax.plot(table["props"], table["load_factor"], ".", color="#8C8C8C", ms=8, label="layouts")
    for (name, text), (colour, _, marker) in zip(best.items(), PAIRED, strict=False):
        row = table[table["labelling"] == text].iloc[0]
        ax.plot([row.props], [row.load_factor], marker, color=colour, ms=10, ls="none", label=name)
    name_axes(ax, "most that props carry while it is laid [N]", "λ, N on each of two cells")
    ax.legend(frameon=False, fontsize=8.5, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    for place, (name, text) in enumerate(best.items()):
        result = solve(assembly, from_string(text))
        drawing = axes_at(figure, 6.4, 3.95 - 2.95 * place, 5.6, 2.1)
        draw_mechanism(drawing, result)
        without_legend(drawing, f"{name}: λ = {result.load_factor:.5g} N")
    legend_at(figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack"), 5.6, 0.1, 6)
    return figure
