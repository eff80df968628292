"""Section 3.3, honestly: a layout that gives the published λ with dilation, beside ours, and what else it gives.

Source: Iannuzzo et al. 2024, section 3.3 and Table 2, for materials, cell size and load factors. The figure with its
layout is not at hand; 464 000 symmetric layouts were searched for one that gives both λ published by one procedure, and
none does.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Assembly, LimitAnalysisResult, build_assembly, parse_scene, solve
from jld_core.scene.schema import Scene
from jld_experiment import Curve, Joints, Settings, run_experiment
from jld_explore import ExploreSettings, explore
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
    without_legend,
    write,
)
from studies.scenes import leonardo_flat_arch

NAME: Final = "leonardo_section_3_3"
FOUND: Final = ["BBAATTTaabb", "BBBATTTabbb", "BBAAATaaabb", "##.......##"]
"""The simplest layout found that gives 2 152.85 N; letters are blocks, # bearings."""

STIFFNESS: Final = 1e9
"""kn = ks of Table 2, Pa/m."""

PUBLISHED: Final = (
    ("JLD, with dilation", 2153.0),
    ("JLD, without", 1312.0),
    ("3DEC, with dilation", 1911.13),
    ("3DEC, without", 2187.0),
)
KINDS: Final = (
    ("plastic, with dilation, plastic gaps", Joints(STIFFNESS, dilation="friction", inner="plastic"), "plastic"),
    ("plastic, with dilation", Joints(STIFFNESS, dilation="friction", inner="plastic"), "free"),
    ("plastic, without", Joints(STIFFNESS, inner="plastic"), "free"),
    ("brittle, with dilation", Joints(STIFFNESS, dilation="friction"), "free"),
    ("brittle, without", Joints(STIFFNESS), "free"),
)
"""Experiments: name, joints, gaps."""


def found(search: dict[str, Any] | None = None) -> Scene:
    """The layout that gives the published λ: cells, materials and three forces as in `leonardo_flat_arch`."""
    live = [{"element": f"c{k}r0", "force": [0, -1], "at": [0.1 * k + 0.05, 0.4]} for k in (4, 5, 6)]
    inner = {"tensile_strength": 2e6, "shear_strength": 2e5}
    return parse_scene(
        {
            "name": "a layout that gives 2 153 N",
            "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": FOUND},
            "materials": {"density": 1400, "dry": {"friction_angle": 30}, "inner": inner},
            "loads": {"live": live},
            "search": search or {},
        }
    )


def strongest(scene: Scene, driver: str, budget: int | None) -> tuple[LimitAnalysisResult, bool]:
    """The strongest segmentation that a search finds, and whether that is proven."""
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(driver=driver, budget=budget, pictures=False)
        done = explore(scene, Path(folder) / "search", settings)
    return solve(done.assembly, from_string(done.summary.facts["best_labelling"])), bool(done.summary.proven)


def experiments(name: str, assembly: Assembly, coarse: bool) -> tuple[list[dict[str, Any]], dict[str, Curve]]:
    """λ, the range without dilation, and the experiments of one layout."""
    span = solve(assembly, friction="zero-dilation", range=True)
    rows: list[dict[str, Any]] = [
        {"layout": name, "what": "λ, with dilation", "newton": span.facts["associative_load_factor"]},
        {"layout": name, "what": "λ, without: lowest found", "newton": span.facts["lowest_found"]},
        {"layout": name, "what": "λ, without: highest found", "newton": span.facts["highest_found"]},
    ]
    curves = {}
    for kind, joints, gaps in KINDS[3:] if coarse else KINDS:
        curve = run_experiment(assembly, joints=joints, settings=Settings(gaps=gaps))  # type: ignore[arg-type]
        curves[kind] = curve
        row = {"layout": name, "what": f"experiment, {kind}", "newton": curve.collapse_load}
        rows.append(row | {"rate_error": curve.rate_error})
    return rows, curves


def run(out: Path, coarse: bool) -> pd.DataFrame:
    """Both layouts, table, picture and page."""
    own, other = leonardo_flat_arch(), found()
    rows: list[dict[str, Any]] = [{"layout": "published", "what": what, "newton": value} for what, value in PUBLISHED]
    curves: dict[str, dict[str, Curve]] = {}
    best: dict[str, LimitAnalysisResult] = {}
    limits: dict[str, Any] = {"block_cells": [6, 7], "blocks": [5, 5]}
    searches = {
        "ours": (own, leonardo_flat_arch(search={"block_cells": [3, 4] if coarse else [2, 4]}), "enumeration", None),
        "found": (other, found(limits), "genetic", 60 if coarse else 6000),
    }
    for name, (scene, wanted, driver, budget) in searches.items():
        more, curves[name] = experiments(name, build_assembly(scene), coarse)
        rows += more
        best[name], proven = strongest(wanted, driver, budget)
        what = f"λ, strongest segmentation ({'proven' if proven else 'found'})"
        rows.append({"layout": name, "what": what, "newton": best[name].load_factor})
    table = pd.DataFrame(rows)
    solved = {"ours": solve(build_assembly(own)), "found": solve(build_assembly(other))}
    write(out, _report(table), table, {"": _picture(table, curves, solved, best)})
    return table


def value(table: pd.DataFrame, layout: str, start: str) -> float:
    """One number of the table, by layout and by how its row begins; NaN where it was not computed."""
    rows = table[(table["layout"] == layout) & table["what"].str.startswith(start)]["newton"]
    return float(rows.iloc[0]) if len(rows) else float("nan")


def _report(table: pd.DataFrame) -> Report:
    low, high = value(table, "found", "λ, without: lowest"), value(table, "found", "λ, without: highest")
    free = value(table, "found", "experiment, plastic, with dilation")
    gaps = table[(table["layout"] == "found") & (table["what"] == "experiment, plastic, with dilation")]["newton"]
    free = float(gaps.iloc[0]) if len(gaps) else float("nan")
    brittle = [value(table, "found", f"experiment, brittle, {end}") for end in ("with dilation", "without")]
    return Report(
        name=NAME,
        title="Section 3.3 of the source, honestly",
        question="Is there a layout that gives the four published load factors?",
        source="Iannuzzo et al. 2024, section 3.3: 2153 N and 1312 N by JLD, with and without dilation, 1911.13 N and "
        "2187 N by 3DEC, in the order of the text; Table 2: kn = ks = 1e9 Pa/m, cracks without friction.",
        model="Cells of 0.1 m, 1400 kg/m³, dry 30°, σt = 2 MPa, τ = 0.2 MPa; λ N on each of three cells of the T. "
        f"Ours: nine by two cells on bearings of three. Found: {' / '.join(FOUND[:3])} on bearings of two cells, the "
        "simplest of the symmetric layouts searched that gives 2153 N. Experiments: five points a face, geometry at "
        "rest, from gravity.",
        agrees=(
            f"The layout found gives λ = {value(table, 'found', 'λ, with'):.2f} N with dilation, beside 2153 N.",
            f"Without dilation its solutions reach from {low:.1f} to {high:.1f} N, and 1312 N lies among them. So it "
            f"does among those of our own layout, {value(table, 'ours', 'λ, without: lowest'):.1f} to "
            f"{value(table, 'ours', 'λ, without: highest'):.1f} N: 1312 N identifies no layout.",
            "An experiment on it with dilation, lasting strength and gaps that close without resistance, as in a "
            f"distinct-element program, ends at {free:.1f} N, beside 1911.13 N by 3DEC; with gaps that are plastic, as "
            "the theorems of limit analysis ask, at "
            f"{value(table, 'found', 'experiment, plastic, with dilation, plastic'):.1f} N. One agreement to 0.2 % may "
            "be chance.",
        ),
        differs=(
            "464 000 symmetric layouts were searched for one that gives 2153 N and 1312 N by one procedure: none does. "
            "That this one is the source's is not known.",
            "2187 N by 3DEC without dilation is above λ with dilation, which bounds every state at rest of that "
            f"layout: no experiment here comes near it ({value(table, 'found', 'experiment, plastic, without'):.0f} N "
            f"with lasting strength, {brittle[1]:.0f} N brittle). Either it is of another layout, of another load, or "
            "not at rest.",
            f"With Table 2's brittle cracks the experiment carries {brittle[0]:.0f} N with and {brittle[1]:.0f} N "
            f"without dilation on the layout found, {value(table, 'ours', 'experiment, brittle, with dilation'):.0f} "
            f"and {value(table, 'ours', 'experiment, brittle, without'):.0f} N on ours: less with brittle cracks, and "
            "more with dilation than without.",
            f"The strongest segmentation of the same cells carries {value(table, 'found', 'λ, strongest'):.0f} N (five "
            f"blocks of six or seven cells, genetic search), of ours {value(table, 'ours', 'λ, strongest'):.0f} N.",
        ),
        pictures={"": "Left: both layouts, their mechanisms. Right: experiments, published values, strongest cuts."},
    )  # fmt: skip


def _picture(
    table: pd.DataFrame,
    curves: dict[str, dict[str, Curve]],
    solved: dict[str, LimitAnalysisResult],
    best: dict[str, LimitAnalysisResult],
) -> Figure:
    figure = figure_of(13.2, 9.0)
    for k, name in enumerate(("found", "ours")):
        bottom = 4.95 - 4.15 * k
        title = "layout found" if name == "found" else "our layout"
        _drawing(axes_at(figure, 0.7, bottom + 1.95, 3.7, 1.55), draw_assembly, solved[name], title)
        text = f"mechanism, λ = {solved[name].load_factor:.1f} N"
        _drawing(axes_at(figure, 0.7, bottom + 0.05, 3.7, 1.35), draw_mechanism, solved[name], text)
        _curves(axes_at(figure, 5.2, bottom + 0.25, 4.2, 3.2), table, name, curves[name])
        text = f"strongest cut: λ = {best[name].load_factor:.0f} N"
        _drawing(axes_at(figure, 10.1, bottom + 1.1, 3.0, 1.6), draw_assembly, best[name], text)
    handles = drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack", "at rest")
    legend_at(figure, handles, 0.5, 0.02, 7)
    figure.suptitle("Section 3.3: λ, range without dilation, experiments and published values", fontsize=12, y=0.985)
    return figure


def _drawing(ax: Axes, draw: Any, result: LimitAnalysisResult, title: str) -> None:
    if draw is draw_assembly:
        draw_assembly(ax, result.assembly, result.labels)
    else:
        draw(ax, result)
    without_legend(ax, title)
    name_axes(ax, "x [m]", "y [m]", size=8)


def _curves(ax: Axes, table: pd.DataFrame, name: str, curves: dict[str, Curve]) -> None:
    low, high = value(table, name, "λ, without: lowest"), value(table, name, "λ, without: highest")
    ax.axhspan(low, high, facecolor="#FBE3B5", hatch="//", edgecolor="#C9A55A", lw=0.0, label="without dilation, found")
    for (kind, curve), (colour, dash, _) in zip(curves.items(), PAIRED, strict=False):
        unit = curve.reach * value(table, name, "λ, with")
        ax.plot(curve.distance / unit, curve.load_factor, color=colour, ls=dash, lw=1.1, label=kind)
    for what, newton in PUBLISHED:
        ax.axhline(newton, color=GREY, lw=0.7, ls=(0, (1, 2)))
        ax.text(9.9 if what.startswith("3DEC") else 7.2, newton + 15.0, what, fontsize=6.5, color=GREY, ha="right")
    ax.set_xlim(0.0, 10.0)
    ax.set_ylim(0.0, 3300.0)
    name_axes(ax, "movement of the live loads / elastic one at λ [–]", "λ per force [N]")
    ax.legend(frameon=False, fontsize=7.5, loc="upper left", ncols=2)
    ax.set_title("experiments", fontsize=9)
