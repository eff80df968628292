"""Whose cracks? λ of proven layouts by the faces of the grid, by finer cells, and of the blocks themselves by fields.

Every layout has a time budget of `SECONDS`, every race by fields one of `RACE`: a run takes ten to twenty minutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from jld_core import Assembly, Scene, build_assembly, load_scene
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import FieldBounds
from jld_core.scene.cracks import parse_cracks
from jld_explore import Exploration, ExploreSettings
from jld_explore.space import from_string
from jld_views.field_figures import draw_cracks, draw_stresses
from jld_views.figures import figure_for, finish
from studies.crack_models import HALVES, bridge, finer, rows_of, wall
from studies.report import GREY, PAIRED, SCENES, Report, axes_at, figure_of, name_axes, searched, write
from studies.scenes import polar_grid_arch

NAME: Final = "whose_cracks"
SECONDS: Final = 45.0
"""Time for one layout under all crack models, s."""
RACE: Final = 90.0
"""Time for one search by fields, s."""
STRENGTHS: Final = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Strengths of the blocks in brittle experiments, over those of the scene."""


@dataclass(frozen=True)
class Case:
    """One structure: its scene with limits on blocks, how it is searched by faces, and whether also by fields."""

    name: str
    scene: Scene
    settings: ExploreSettings
    raced: bool = False


def cases(coarse: bool) -> list[Case]:
    """The flagship, a bridge, three walls and an arch; coarse: a small wall and a small bridge."""
    listed = ExploreSettings(driver="enumeration", jobs=1, check_fields=0)
    exact = ExploreSettings(driver="exact", jobs=1, check_fields=0, seconds=20.0)
    if coarse:
        small = bridge({"block_cells": [2, 4], "dry_faces": [6, None]})
        return [Case("bridge", small, listed, True), Case("wall", wall(2, 3, 5e3, {"block_cells": [1, 3]}), exact)]
    limits = {"block_cells": [1, 3]}
    live = [{"element": "r1s5", "force": [0, -1000]}]
    return [
        Case("flagship", load_scene(SCENES / "flat_beam_arch.json"), listed, True),
        Case("bridge", bridge({"block_cells": [1, 4]}), listed, True),
        Case("wall 4 × 6, 5 kPa", wall(4, 6, 5e3, limits), exact),
        Case("wall 5 × 7, 5 kPa", wall(5, 7, 5e3, limits), exact),
        Case("wall 6 × 8, 20 kPa", wall(6, 8, 20e3, limits), exact),
        Case("arch 2 × 8", polar_grid_arch(2, 8, 0.3, live, {"block_cells": [1, 4]}), exact),
    ]


@dataclass(frozen=True)
class Findings:
    """What was found of one case.

    rows: of the table of crack models. layouts: labels by name. bounds: adaptive bounds by name. faces, race: tables of
    the searches, race None where there was none.
    """

    case: Case
    rows: list[dict[str, Any]]
    layouts: dict[str, Bits]
    bounds: dict[str, FieldBounds]
    faces: Exploration
    race: Exploration | None

    @property
    def assembly(self) -> Assembly:
        """The structure."""
        return self.faces.assembly


def found_of(case: Case, seconds: float) -> Findings:
    """Search one case by faces, and by fields where it is raced, and solve its layouts under every crack model."""
    faces = searched(case.scene, case.settings)
    assembly = faces.assembly
    layouts = {"best by faces": from_string(str(faces.results["labelling"].iloc[0]))}
    race = None
    if case.raced:
        scene = case.scene.model_copy(update={"cracks": parse_cracks("fields")})
        race = searched(scene, ExploreSettings(driver="enumeration", jobs=1, seconds=RACE))
        layouts["best by fields"] = from_string(str(race.results["labelling"].iloc[0]))
        layouts["uncut"] = ~assembly.free_faces
    rows: list[dict[str, Any]] = []
    bounds: dict[str, FieldBounds] = {}
    for name, labels in layouts.items():
        own, bounds[name] = rows_of(case.name, name, case.scene, labels, seconds)
        rows += [{"part": "models", **row} for row in own]
    return Findings(case, rows, layouts, bounds, faces, race)


def fronts(found: Findings) -> list[dict[str, Any]]:
    """Rows of the front by faces, with what fields say of its layouts, and of the front by fields."""
    if found.race is None:
        return []
    table = found.race.results.set_index("labelling")
    rows = []
    for name, front in (("by faces", found.faces.front), ("by fields", found.race.front)):
        for row in front.sort_values("dry_faces").to_dict("records"):
            known = table.loc[row["labelling"]] if row["labelling"] in table.index else None
            rows.append(
                {
                    "part": "front",
                    "case": found.case.name,
                    "layout": name,
                    "dry_faces": row["dry_faces"],
                    "by_faces": row["load_factor"] if name == "by faces" else math.nan,
                    "lower": math.nan if known is None else known["bracket_lo"],
                    "upper": math.nan if known is None else known["bracket_hi"],
                }
            )
    return rows


def stronger(scene: Scene, factor: float) -> Scene:
    """Return a scene whose blocks have `factor` times the strength."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    inner = document["materials"]["inner"]
    for key in ("tensile_strength", "shear_strength", "compressive_strength"):
        if key in inner:
            inner[key] = factor * inner[key]
    return type(scene).model_validate(document)


def brittle(found: Findings, names: tuple[str, ...], strengths: tuple[float, ...]) -> list[dict[str, Any]]:
    """Experiments on halved cells with brittle cracks, by strength of the blocks, beside the lower bound by fields."""
    from jld_experiment import Joints, run_experiment  # needs numba, which the rest does not

    rows = []
    for factor in strengths:
        scene = stronger(found.case.scene, factor)
        assembly = build_assembly(scene)
        cells = finer(scene, assembly, HALVES)
        for name in names:
            labels = found.layouts[name]
            bounds = bounds_by_fields(assembly, labels, gap=0.05, seconds=0.25 * SECONDS)
            curve = run_experiment(cells.fine, cells.labels(labels), joints=Joints(dilation="friction"))
            carried = curve.collapse_load if curve.stands and curve.rates_agree else math.nan
            rows.append(
                {
                    "part": "brittle",
                    "case": found.case.name,
                    "layout": name,
                    "strength": factor,
                    "lower": bounds.lower,
                    "upper": bounds.upper,
                    "experiment": carried,
                    "certified": curve.rates_agree,
                    "ratio": carried / bounds.lower if bounds.lower > 0.0 else math.nan,
                }
            )
    return rows


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Searches, bounds, experiments, table, pictures and page; return the whole table."""
    found = [found_of(case, 4.0 if coarse else SECONDS) for case in cases(coarse)]
    rows = [row for one in found for row in [*one.rows, *fronts(one)]]
    tried = (found[0], found[1]) if coarse else (found[0], found[2])
    for one in tried:
        rows += brittle(one, tuple(one.layouts)[:2], STRENGTHS[1:2] if coarse else STRENGTHS)
    table = pd.DataFrame(rows)
    figures = {
        "": _models(table),
        "_fronts": _fronts([one for one in found if one.race is not None], table),
        "_winners": _winners(found[0]),
        "_brittle": _brittle(table),
    }
    shown = summary(table)
    write(out, _report(found, table, shown), table, figures, shown)
    return table


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """One row for each layout: λ by every crack model, bounds by fields, and what brittle cracks leave."""
    rows = []
    models = table[table["part"] == "models"]
    tests = table[(table["part"] == "brittle") & (table.get("strength") == 1.0)]
    for (case, layout), own in models.groupby(["case", "layout"], sort=False):
        cells = own[~own["cracks"].str.startswith("fields")]
        last = own[own["cracks"] == "fields, adaptive"]
        row: dict[str, Any] = {"case": case, "layout": layout}
        row |= {str(name): float(value) for name, value in zip(cells["cracks"], cells["lower"], strict=True)}
        lower = last["lower"].replace(-np.inf, np.nan).max()
        row |= {"fields, lower": float(lower), "fields, upper": float(last["upper"].min())}
        tried = tests[(tests["case"] == case) & (tests["layout"] == layout)]
        row["brittle / 2"] = float(tried["experiment"].iloc[0]) if len(tried) else math.nan
        rows.append(row)
    return pd.DataFrame(rows)


def _unsafe(table: pd.DataFrame) -> list[str]:
    """Where brittle blocks carry less than the lower bound, in sentences."""
    found = []
    tried = table[(table["part"] == "brittle") & table["ratio"].notna()]
    for (case, layout), own in tried.groupby(["case", "layout"], sort=False):
        low = own[own["ratio"] < 1.0]
        ratios = f"{own['ratio'].min():.2f} to {own['ratio'].max():.2f}"
        if len(low) == len(own):
            text = f"at every strength tried ({own['strength'].min():g} to {own['strength'].max():g} times the scene's)"
        elif len(low):
            text = "at " + ", ".join(f"{factor:g}" for factor in low["strength"]) + " times the strength of the scene"
        else:
            text = "at no strength tried"
        found.append(
            f"{case}, {layout}: brittle blocks carry {ratios} of the lower bound; it is unsafe for them {text}."
        )
    return found


def _left(low: float, high: float, faces: float) -> str:
    """λ of the blocks over λ by faces, in words."""
    if high < 0.0:
        return "nothing, the blocks fall under their own weight"
    return f"{low / faces:.2f} to {high / faces:.2f}" if math.isfinite(low) else f"at most {high / faces:.2f}"


def _report(found: list[Findings], table: pd.DataFrame, shown: pd.DataFrame) -> Report:
    first = shown.iloc[0]
    best = shown[shown["layout"] == "best by faces"].to_dict("records")
    left = "; ".join(f"{row['case']} {_left(row['fields, lower'], row['fields, upper'], row['faces'])}" for row in best)
    models = table[(table["part"] == "models") & table["cracks"].str.startswith("fields", na=False)]
    order = int((models["lower"] > models["upper"] * (1.0 + 1e-9)).sum())
    agrees = [f"{order} of {len(models)} meshes have a lower bound by fields above the upper one."]
    differs = [f"λ of the blocks over λ by faces, of the best layout by faces: {left}."]
    below = [
        f"{row['case']}, {row['layout']}" for row in shown.to_dict("records") if row["faces"] < row["fields, lower"]
    ]
    if below:
        differs.append(
            "λ by faces is below what blocks carry for " + "; ".join(below) + ": an inner face that bends exhausts its "
            "section at L/6 from the middle, where blocks in the plane of stress find another way."
        )
    for one in found:
        if one.race is None:
            continue
        facts = one.race.summary
        own = shown[shown["case"] == one.case.name].set_index("layout")
        most = float(own["fields, upper"].to_dict()["best by faces"])
        least = float(own["fields, lower"].to_dict()["uncut"])
        ends = ", ".join("none" if end is None else f"{end:.4g}" for end in (facts.best, facts.bound))
        differs.append(
            f"{one.case.name}: the race by fields ends at [{ends}] over {len(one.race.results)} layouts; the best by "
            f"faces carries at most {most:.4g}, the uncut structure at least {least:.4g}."
        )
    differs += _unsafe(table)
    differs.append(
        "Experiments prove nothing: they follow one path of loading on halved cells, whose own faces may be stronger "
        "than blocks that crack anywhere."
    )
    return Report(
        name=NAME,
        title="Whose cracks?",
        question="How much of λ of a proven layout belongs to the grid of faces, and how much to the blocks?",
        source="Question and walls of this project's own trials; formulas of method, section 9.",
        model=f"Each layout within {SECONDS:g} s, each race by fields within {RACE:g} s: what would begin later is "
        "left out. Cells / 2 and / 4: elements cut along both axes into as many parts, Voronoi cells of half an "
        "element. Fields: uniform meshes up to 1000 triangles, adaptive ones to a gap of 5 %. Flagship of this "
        "project; bridge of 6 × 2 cells of 0.3 m, μ = μi = 0.6, σt = 0.2, τ = 0.4 MPa; walls of 0.4 × 0.2 m cells, μ = "
        "0.75, σt = τ; arch of 2 × 8 cells. Brittle experiments on halved cells, joints that dilate, cracks that lose "
        f"all strength. The first row: λ by faces {first['faces']:.4g}, by fields {first['fields, lower']:.4g} to "
        f"{first['fields, upper']:.4g}.",
        agrees=tuple(agrees),
        differs=tuple(differs),
        pictures={
            "": "λ against the number of cells or triangles, by crack model, for each layout; the band lies "
            "between both bounds by fields.",
            "_fronts": "Front by faces, what its blocks carry at most, and the front by fields between both bounds.",
            "_winners": "Best layout by faces (top) and by fields (bottom): stress trajectories of the lower bound and "
            "cracks of the upper bound.",
            "_brittle": "What brittle blocks carry in experiments on halved cells over the lower bound by fields, by "
            "strength.",
        },
    )


def _models(table: pd.DataFrame) -> Figure:
    """λ against the number of cells or triangles, one panel for each layout."""
    models = table[table["part"] == "models"]
    panels = list(dict.fromkeys(zip(models["case"], models["layout"], strict=True)))
    columns = min(5, len(panels))
    lines = math.ceil(len(panels) / columns)
    figure = figure_of(2.65 * columns + 0.4, 2.6 * lines + 0.8)
    for k, (case, layout) in enumerate(panels):
        line, column = divmod(k, columns)
        ax = axes_at(figure, 0.6 + 2.65 * column, 0.95 + 2.6 * (lines - 1 - line), 2.0, 1.75)
        _panel(ax, models[(models["case"] == case) & (models["layout"] == layout)])
        ax.set_title(f"{case}\n{layout}", fontsize=8)
        if column == 0:
            ax.set_ylabel("λ [–]", fontsize=8)
        if line == lines - 1:
            ax.set_xlabel("cells or triangles [–]", fontsize=8)
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="lower center", ncols=6, frameon=False, fontsize=8)
    return figure


def _panel(ax: Axes, own: pd.DataFrame) -> None:
    """λ of one layout by every crack model."""
    rigid = own[own["cracks"] == "faces"]
    ax.axhline(float(rigid["lower"].iloc[0]), color=GREY, lw=0.9, ls=(0, (4, 2)), label="faces of the grid")
    for names, (colour, _, marker), text in (
        (("cells / 2", "cells / 4"), PAIRED[1], "cells / 2, / 4"),
        (("Voronoi cells / 2",), PAIRED[3], "Voronoi cells"),
    ):
        rows = own[own["cracks"].isin(names)]
        ax.plot(rows["cells"], rows["lower"], marker, color=colour, ms=4.5, label=text)
    for name, dash in (("fields, uniform", PAIRED[2][1]), ("fields, adaptive", PAIRED[0][1])):
        rows, colour = own[own["cracks"] == name], PAIRED[0][0]
        look: dict[str, Any] = {"color": colour, "ls": dash, "lw": 1.2, "marker": ".", "ms": 3.5}
        ax.plot(rows["cells"], rows["upper"], label=name, **look)
        ax.plot(rows["cells"], rows["lower"].replace(-np.inf, np.nan), **look)
        if name == "fields, adaptive":
            finite = rows[np.isfinite(rows["lower"])]
            ax.fill_between(finite["cells"], finite["lower"], finite["upper"], color=colour, alpha=0.15, lw=0.0)
    ax.set_xscale("log")
    ax.xaxis.set_minor_formatter(NullFormatter())
    finite = own[["lower", "upper"]].replace([-np.inf, np.inf], np.nan)
    ax.set_ylim(min(0.0, 1.1 * float(finite.min().min())), 1.15 * float(finite.max().max()))


def _fronts(found: list[Findings], table: pd.DataFrame) -> Figure:
    """Fronts by faces and by fields, one panel for each case."""
    figure = figure_of(6.0 * len(found) + 0.4, 4.3)
    part = table[table["part"] == "front"]
    for k, one in enumerate(found):
        ax = axes_at(figure, 0.7 + 6.0 * k, 0.6, 5.1, 3.1)
        own = part[part["case"] == one.case.name]
        faces, fields = (own[own["layout"] == name] for name in ("by faces", "by fields"))
        for rows, column, (colour, dash, marker), text in (
            (faces, "by_faces", PAIRED[1], "front by faces: λ by faces"),
            (faces, "upper", PAIRED[4], "front by faces: blocks carry at most"),
            (fields, "lower", PAIRED[0], "front by fields: at least"),
            (fields, "upper", PAIRED[2], "front by fields: at most"),
        ):
            ax.plot(rows["dry_faces"], rows[column], marker, color=colour, ls=dash, ms=4.5, lw=1.2, label=text)
        uncut = one.bounds["uncut"]
        ax.axhspan(uncut.lower, uncut.upper, color="#D5D5D5", lw=0.0, label="uncut, between both bounds")
        ax.set_ylim(0.0, 1.35 * float(own[["by_faces", "upper"]].max().max()))
        name_axes(ax, "dry joints [–]", "λ [–]", one.case.name)
        ax.legend(frameon=False, fontsize=7.5, ncols=2, loc="upper right")
    return figure


def _winners(found: Findings) -> Figure:
    """Stress trajectories and cracks of the best layouts by faces and by fields."""
    names = [name for name in ("best by faces", "best by fields") if name in found.layouts]
    figure, axes = figure_for(found.assembly, 2 * len(names), columns=2)
    for k, name in enumerate(names):
        labels, bounds = found.layouts[name], found.bounds[name]
        draw_stresses(axes[2 * k], found.assembly, labels, bounds.stresses)
        draw_cracks(axes[2 * k + 1], found.assembly, labels, bounds.velocities)
        axes[2 * k].set_title(f"{name}: stress trajectories, λ ≥ {bounds.lower:.4g}", fontsize=10)
        axes[2 * k + 1].set_title(f"{name}: cracks, λ ≤ {bounds.upper:.4g}", fontsize=10)
    finish(figure, axes, found.assembly.name, columns=2)
    return figure


def _brittle(table: pd.DataFrame) -> Figure:
    """Brittle experiments over the lower bound by fields, by strength of the blocks."""
    figure = figure_of(7.6, 3.9)
    ax = axes_at(figure, 0.8, 0.65, 6.5, 2.9)
    groups = table[table["part"] == "brittle"].groupby(["case", "layout"], sort=False)
    for ((case, layout), own), (colour, dash, marker) in zip(groups, PAIRED, strict=False):
        ax.plot(own["strength"], own["ratio"], marker, color=colour, ls=dash, ms=5, lw=1.3, label=f"{case}, {layout}")
    ax.axhline(1.0, color=GREY, lw=0.9, label="lower bound of plastic blocks")
    ax.set_xscale("log", base=2)
    name_axes(ax, "strength of the blocks over that of the scene [–]", "carried when brittle / lower bound [–]")
    ax.set_ylim(0.0, 1.6)
    ax.legend(frameon=False, fontsize=8, ncols=2)
    return figure
