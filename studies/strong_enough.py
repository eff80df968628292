"""Strong enough: the most joints for a required load factor, with materials as expected and as low as they may be."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jld_core import Assembly, Scene, build_assembly, load_scene, parse_scene, solve
from jld_core.build import build_robust
from jld_core.models import sensitivities
from jld_core.strengths import Route
from jld_explore import ExploreSettings
from jld_explore.space import from_string
from jld_views.figures import draw_mechanism
from studies.report import (
    PAIRED,
    SCENES,
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

ROUTE = Route("a study")

NAME: Final = "strong_enough"
REQUIRED: Final = (1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)
QUICK: Final = (2.0, 8.0)
LOW: Final = {"friction_angle": 24.0, "tensile_strength": 5e5, "shear_strength": 1e5}
"""Values to be reckoned with; nominal ones are those of the scene."""


def scene(required: float | None = None) -> Scene:
    """The beam-arch, its materials with a low value, and what is required of λ."""
    document: dict[str, Any] = json.loads(
        load_scene(SCENES / "flat_beam_arch.json").model_dump_json(exclude_defaults=True)
    )
    for material in (document["materials"]["dry"], document["materials"]["inner"]):
        for key in material.keys() & LOW.keys():
            material[key] = {"nominal": material[key], "low": LOW[key]}
    if required is not None:
        document["search"] = {**document.get("search", {}), "require": {"load_factor": required}}
    return parse_scene(document)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Search, write table, picture and page into a folder; returns the table."""
    rows: list[dict[str, Any]] = []
    for robust in (False, True):
        for required in QUICK if coarse else REQUIRED:
            settings = ExploreSettings(pictures=False, driver="exact", jobs=1, robust=robust)
            found = searched(scene(required), settings).summary.facts["require"]
            rows.append(
                {
                    "values": "low" if robust else "nominal",
                    "required": required,
                    "dry_faces": np.nan if found["best"] is None else float(found["best"]),
                    "load_factor": found["best_load_factor"],
                    "proven": found["proven"],
                    "labelling": found["best_labelling"],
                }
            )
    table = pd.DataFrame(rows)
    nominal, robust_ = build_assembly(scene()), build_robust(scene())
    last = table[(table["values"] == "nominal") & table["dry_faces"].notna()].iloc[-1]
    result = solve(nominal, from_string(str(last.labelling)))
    rates = sensitivities(result)
    own = {
        "friction_coefficient": float(nominal.strengths(ROUTE).friction[0]),
        "shear_strength": float(nominal.strengths(ROUTE).shear[0]),
        "tensile_strength": float(nominal.strengths(ROUTE).tension[0]),
        "weight": 1.0,
    }
    shares = {name: rate.right * own[name] / result.load_factor for name, rate in rates.items()}
    low = solve(robust_, result.labels)
    report = Report(
        name=NAME,
        title="Strong enough",
        question="How many joints may a beam-arch have that carries a required load factor, and how many where "
        "materials are as poor as they may be?",
        source="No published numbers; geometry of the beam-arch as in scenes/flat_beam_arch.json.",
        model="Nominal values of the scene (friction angle 30°, σt = 2 MPa, τ = 0.2 MPa); low ones 24°, 0.5 MPa and "
        "0.1 MPa. Blocks of two to six cells. `search.require`, proven by the exact driver.",
        agrees=(
            f"{int(table['proven'].sum())} of {len(table)} answers are proven: no layout with more dry faces carries "
            "as much.",
            f"The layout with the most joints at λ ≥ {last.required:g} carries {result.load_factor:.4g}, and "
            f"{low.load_factor:.4g} at the low values. One per cent more friction, shear strength, tensile strength, "
            "weight changes its λ by "
            + ", ".join(f"{shares.get(name, 0.0):+.2f} %" for name in own)
            + " (from the multipliers of one solve).",
        ),
        differs=("All low values are taken together; how likely that is nobody says here.",),
        pictures={
            "": "Left: the most dry faces for what is required of λ. Right: the layout with the most joints at the "
            "least and at the largest λ required, and what λ of the latter depends on."
        },
    )
    write(out, report, table, {"": _picture(table, nominal, shares)}, table.drop(columns="labelling"))
    return table


def _picture(table: pd.DataFrame, assembly: Assembly, shares: dict[str, float]) -> Figure:
    figure = figure_of(12.8, 8.4)
    ax = axes_at(figure, 0.8, 4.2, 4.9, 3.4)
    for values, (colour, dash, marker) in zip(("nominal", "low"), PAIRED, strict=False):
        own = table[table["values"] == values]
        ax.plot(own["required"], own["dry_faces"], marker, ls=dash, color=colour, ms=7, label=f"{values} values")
    name_axes(ax, "λ required [–]", "most dry faces, proven")
    ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(frameon=False, fontsize=9)
    bars = axes_at(figure, 2.2, 1.1, 3.5, 1.8)
    place = np.arange(len(shares))[::-1]
    bars.barh(place, list(shares.values()), color=PAIRED[0][0], height=0.55)
    bars.axvline(0.0, color="#1B1B1B", lw=0.8)
    bars.set_yticks(place, [name.replace("_", " ") for name in shares], fontsize=9)
    bars.set_xlabel("change of λ by 1 % more of it [%]", fontsize=9)
    good = table[(table["values"] == "nominal") & table["dry_faces"].notna()]
    for row, (_, one) in enumerate(good.iloc[[0, -1]].iterrows()):
        drawing = axes_at(figure, 6.6, 4.9 - 3.85 * row, 5.7, 2.8)
        draw_mechanism(drawing, solve(assembly, from_string(str(one.labelling))))
        without_legend(drawing, f"λ ≥ {one.required:g}: {one.dry_faces:g} dry faces, carries {one.load_factor:.4g}")
    legend_at(figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack"), 5.4, 0.1, 6)
    figure.suptitle("Strong enough", fontsize=12, y=0.99)
    return figure
