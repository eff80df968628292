"""Cells left out: the strongest structure for its weight, of a portal that is pressed and pushed.

Source: ours. Every structure and each of its layouts is solved.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pandas as pd

from jld_core import Scene, parse_scene
from jld_explore import ExploreSettings
from jld_views.pictures import plot_pareto
from studies.report import Report, searched, write

NAME: Final = "left_out"
MOST: Final = 0.35


def wall(coarse: bool) -> Scene:
    """Eight cells over an opening, pressed and pushed at the upper left; coarse: smaller blocks."""
    return parse_scene(
        {
            "name": "portal, pressed and pushed",
            "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": ["aaa", "aaa", "a.a", "###"]},
            "materials": {
                "density": 2000,
                "dry": {"friction_coefficient": 0.65},
                "inner": {"tensile_strength": 2e4, "shear_strength": 2e4},
            },
            "loads": {"live": [{"element": "c0r0", "force": [300, -600]}]},
            "search": {
                "block_cells": [1, 2 if coarse else 3],
                "void": {"most": MOST},
                "front": {"count": "mass", "sense": "min"},
            },
        }
    )


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Enumerate, write table, picture and page into a folder; returns the table."""
    done = searched(wall(coarse), ExploreSettings(driver="enumeration"))
    ranked = done.results[done.results["status"] == "collapse"]
    strongest = ranked.groupby("mass")["load_factor"].max()
    table = pd.DataFrame({"mass": strongest.index, "load_factor": strongest.to_numpy()})
    table["per_kg"] = table["load_factor"] / table["mass"]
    table["layouts"] = ranked.groupby("mass")["load_factor"].size().to_numpy()
    budget = len(done.results) // 4
    found = searched(wall(coarse), ExploreSettings(driver="genetic", budget=budget))
    reached = sum(
        bool((found.results["load_factor"][found.results["mass"] == mass] >= value * (1.0 - 1e-6)).any())
        for mass, value in zip(done.front["mass"], done.front["load_factor"], strict=True)
    )
    light, heavy = table.iloc[0], table.iloc[-1]
    report = Report(
        name=NAME,
        title="Cells left out: the strongest structure for its weight",
        question="Which cells of a portal may be left out, and how much does it then carry?",
        source="Ours.",
        model=f"Cells of 400 × 200 × 200 mm, 2000 kg/m³, μ = 0.65, σt = τ = 0.02 MPa, blocks of at most "
        f"{2 if coarse else 3} cells; up to {100 * MOST:.0f} % of the volume may be left out, but for the cell that is "
        "loaded, as long as all that stays is joined to a support.",
        agrees=(
            f"All {len(done.results)} classes are solved, each on the structure that it leaves: the front of λ and "
            "mass is proven point by point.",
            f"The genetic driver, with {budget} evaluations, reaches {reached} of its {len(done.front)} points.",
        ),
        differs=(
            f"From {heavy['mass']:.0f} kg to {light['mass']:.0f} kg the strongest falls from λ = "
            f"{heavy['load_factor']:.4g} to {light['load_factor']:.4g}, per kilogram from {heavy['per_kg']:.4f} to "
            f"{light['per_kg']:.4f}: weight in the right place pays more than its share, and no structure gains by "
            "what is left out.",
        ),
        pictures={"": "λ of every layout against the mass of its structure; below the strongest for each mass."},
    )
    figure = plot_pareto(done.results, done.front, done.assembly, count="mass", sense="min")
    write(out, report, table, {"": figure})
    return table
