"""The dry walls of section 3.1: collapse with and without dilation, and how far the latter is determined.

Source: walls 1, 2 and 4 of Ferris & Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209–224, used again by Gilbert, Casapulla,
Ahmed, Computers & Structures 84 (2006) 873–887, and by section 3.1 of Iannuzzo et al. 2024. Friction 0.65,
horizontal body load to the right. The lowest zero-dilation values are local minima of a public MPEC solver.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jld_core import LimitAnalysis, LimitAnalysisResult, build_assembly, load_scene
from jld_dilation.fixed_point_search import ProximalOptions
from jld_views.figures import draw_mechanism
from studies.by_scheme import zero_dilation
from studies.report import (
    GREY,
    PAIRED,
    SCENES,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    name_axes,
    without_legend,
    write,
)

NAME: Final = "walls_of_section_3_1"
PUBLISHED: Final = {1: (0.6428590033, 0.638981), 2: (0.5799986113, 0.562005), 4: (0.3319483952, 0.263736)}
"""λ associative (Ferris & Tin-Loi, recomputed by two linear programs) and the MPEC local minimum, by wall."""

STARTS: Final[tuple[Literal["associative", "gravity", "vertex"], ...]] = ("associative", "gravity", "vertex")


def solve_wall(wall: int, coarse: bool) -> tuple[LimitAnalysisResult, list[LimitAnalysisResult], pd.DataFrame]:
    """Associative and zero-dilation results of one wall.

    Returns the associative result, the highest and the lowest certified zero-dilation one, and a table of all.
    """
    assembly = build_assembly(load_scene(SCENES / f"ferris_tinloi_{wall}.json"))
    analysis = LimitAnalysis(assembly)
    associative, proof = analysis.solve(stands=False), analysis.prove(assembly.labels)
    dampings = (1e-2, 1e-1) if coarse else (1e-3, 1e-2, 3e-2, 1e-1)
    anchors = (1e-3,) if coarse else (1e-4, 1e-3, 1e-2)
    blocks = (5,) if coarse else (3, 5, 8)
    rows: list[dict[str, Any]] = []
    results = []
    for start, damping, anchor, block in itertools.product(STARTS, dampings, anchors, blocks):
        scheme = ProximalOptions(start=start, damping=damping, anchor=anchor, block=block)
        found = zero_dilation(analysis, None, scheme, associative=proof, stands=False)
        results.append(found)
        rows.append(
            {
                "wall": wall,
                "friction": "zero-dilation",
                "start": start,
                "damping": damping,
                "anchor": anchor,
                "block": block,
                "load_factor": found.load_factor,
                "status": str(found.status),
                "complementarity_gap": found.facts["complementarity_gap"],
                "friction_violation": found.facts["friction_violation"],
                "programs": found.iterations,
            }
        )
    certified = [found for found in results if str(found.status) == "collapse"]
    ends = [pick(certified, key=lambda found: found.load_factor) for pick in (max, min)]
    first = {"wall": wall, "friction": "associative", "load_factor": associative.load_factor}
    first |= {"status": str(associative.status), "programs": associative.iterations}
    return associative, ends, pd.DataFrame([first, *rows])


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Solve the three walls from every start, write table, picture and page into a folder; returns the table."""
    found = {wall: solve_wall(wall, coarse) for wall in PUBLISHED}
    table = pd.concat([part for _, _, part in found.values()], ignore_index=True)
    summary = _summary(table)
    report = Report(
        name=NAME,
        title="Walls of section 3.1: with and without dilation",
        question="How much of the load factor of a dry wall rests on dilating joints, and is the answer without "
        "dilation unique?",
        source="Ferris & Tin-Loi 2001, walls 1, 2, 4 (block and contact tables of a public collection); λ associative "
        "published to 3–5 digits and recomputed by two independent linear programs; the lowest zero-dilation values "
        "published are local minima found by a public MPEC solver.",
        model="All faces dry, μ = 0.65, body load to the right. Zero dilation by proximal steps and minimisation of "
        "the complementarity gap; every point is a certified solution (exact equilibrium, |V| ≤ μN, a mechanism that "
        "does not dilate, complementarity gap below 1e-3 of the dissipation) from another start, damping, anchor or "
        "block length.",
        agrees=tuple(
            f"Wall {row['wall']}: λ associative {row['associative']:.7f}, published {row['published']:.7f} "
            f"(difference {abs(row['associative'] - row['published']):.1e})."
            for row in summary
        ),
        differs=(
            *(
                f"Wall {row['wall']}: certified zero-dilation solutions lie between {row['zero_lowest']:.4f} and "
                f"{row['zero_highest']:.4f}; the lowest published is {row['published_lowest']:.6f}, the lowest found "
                f"{row['zero_lowest']:.6f} ({100 * (row['zero_lowest'] / row['published_lowest'] - 1):+.3f} %)."
                for row in summary
            ),
            "So one zero-dilation number says little without its start: from the associative forces the loss is small, "
            "from the state of least forces under gravity the values come down to the published minima, and where they "
            "fall below one, that was a local minimum indeed.",
            "None of these numbers is a bound. The only rigorous upper bound is λ associative; that no lower "
            "zero-dilation solution exists is not proven here, nor by the source.",
        ),
        pictures={
            "": "Top: collapse mechanisms, displaced blocks over their outline at rest, with the highest and lowest "
            "zero-dilation solution found. Bottom: every zero-dilation solution found, between the lowest published "
            "value and λ associative."
        },
    )
    write(out, report, table, {"": _picture(found, table)}, pd.DataFrame(summary))
    return table


def _summary(table: pd.DataFrame) -> list[dict[str, Any]]:
    """One row for each wall: values found and published."""
    rows: list[dict[str, Any]] = []
    for wall, (published, lowest) in PUBLISHED.items():
        own = table[(table["wall"] == wall) & (table["status"] == "collapse")]
        zero = own[own["friction"] == "zero-dilation"]["load_factor"]
        rows.append(
            {
                "wall": wall,
                "associative": float(own[own["friction"] == "associative"]["load_factor"].iloc[0]),
                "published": published,
                "zero_highest": float(zero.max()),
                "zero_lowest": float(zero.min()),
                "published_lowest": lowest,
                "solutions": len(zero),
                "runs": int(((table["wall"] == wall) & (table["friction"] == "zero-dilation")).sum()),
            }
        )
    return rows


def _picture(
    found: dict[int, tuple[LimitAnalysisResult, list[LimitAnalysisResult], pd.DataFrame]], table: pd.DataFrame
) -> Figure:
    tall = {1: 2.1, 2: 2.9, 4: 2.9}
    figure = figure_of(12.4, 0.55 + sum(tall.values()) + 3 * 0.55 + 2.75)
    top = figure.get_figheight() - 0.55
    for wall, (associative, ends, _) in found.items():
        top -= tall[wall]
        kinds = ("associative", "no dilation, highest found", "no dilation, lowest found")
        for k, (result, kind) in enumerate(zip((associative, *ends), kinds, strict=True)):
            ax = axes_at(figure, 0.6 + 4.0 * k, top, 3.6, tall[wall])
            draw_mechanism(ax, result)
            known = "" if k else f", published {PUBLISHED[wall][0]:.4f}"
            without_legend(ax, f"wall {wall} · {kind} · λ = {result.load_factor:.4f}{known}")
            name_axes(ax, "length [1/4 block length]" if wall == 4 else "", "" if k else "height [1/4 block length]")
        top -= 0.55
    for k, wall in enumerate(PUBLISHED):
        ax = axes_at(figure, 0.95 + 4.0 * k, 1.15, 3.15, 1.35)
        _range(ax, wall, table[table["wall"] == wall])
    handles = [
        *drawing_handles("hinge", "slide", "open", "at rest"),
        Line2D([], [], color="#1B1B1B", lw=1.4, label="λ associative, published"),
        Line2D([], [], color=GREY, lw=1.4, ls=(0, (4, 2)), label="lowest published (MPEC local minimum)"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=6, frameon=False, fontsize=8.5)
    figure.suptitle("Dry walls of Ferris & Tin-Loi, μ = 0.65, horizontal body load", fontsize=12, y=0.992)
    return figure


def _range(ax: Axes, wall: int, table: pd.DataFrame) -> None:
    """Every certified solution by its start, with the two published values."""
    certified = table[(table["friction"] == "zero-dilation") & (table["status"] == "collapse")]
    for row, (start, (colour, _, marker)) in enumerate(zip(STARTS, PAIRED, strict=False)):
        own = certified[certified["start"] == start]["load_factor"].to_numpy(dtype=float)
        height = row + np.linspace(-0.22, 0.22, len(own)) if len(own) > 1 else np.full(len(own), float(row))
        ax.plot(own, height, marker, color=colour, markersize=4.0, markeredgewidth=0.0, alpha=0.7)
    ax.axvline(PUBLISHED[wall][0], color="#1B1B1B", lw=1.4)
    ax.axvline(PUBLISHED[wall][1], color=GREY, lw=1.4, ls=(0, (4, 2)))
    ax.set_yticks(range(3), ["associative", "gravity", "vertex"] if wall == 1 else [""] * 3, fontsize=8)
    if wall == 1:
        ax.set_ylabel("start", fontsize=9)
    ax.set_ylim(2.6, -0.6)
    ax.margins(x=0.06)
    ax.locator_params(axis="x", nbins=5)
    ax.ticklabel_format(axis="x", useOffset=False)
    ax.set_xlabel("load factor λ [–]", fontsize=9)
    ax.set_title(f"wall {wall}: {len(certified)} solutions without dilation", fontsize=9)
