"""Blocks that can be made: what few shapes of block cost in strength, on a wall in two winds.

Source: ours. The wall is `scenes/wall_in_two_winds.json`; moulds may be turned and turned over.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pandas as pd

from jld_core import Scene, parse_scene
from jld_explore import ExploreSettings
from jld_views.pictures import plot_three
from studies.report import SCENES, Report, searched, write

NAME: Final = "few_shapes"
AXES: Final = (("blocks", "max"), ("shapes", "min"))


def wall(coarse: bool, **search: Any) -> Scene:
    """The wall with a front of three objectives; coarse: of two courses, under one wind."""
    document = json.loads((SCENES / "wall_in_two_winds.json").read_text("utf-8"))
    if coarse:
        document["grid"]["rows"] = ["aaa", "a.a", "###"]
        document["loads"] = {"live": [{"body": [1, 0]}]}
    front = {"counts": [name for name, _ in AXES], "sense": [sense for _, sense in AXES]}
    document["search"] = {"block_cells": [1, 4], "moulds": {"rotate": True, "flip": True}, "front": front, **search}
    return parse_scene(document)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Enumerate, write table, picture and page into a folder; returns the table."""
    done = searched(wall(coarse), ExploreSettings(driver="enumeration"))
    ranked = done.results[done.results["status"] == "collapse"]
    strongest = ranked.groupby("shapes")["load_factor"].max()
    table = pd.DataFrame({"shapes": strongest.index, "load_factor": strongest.to_numpy()})
    table["share"] = table["load_factor"] / table["load_factor"].max()
    table["layouts"] = ranked.groupby("shapes")["load_factor"].size().to_numpy()
    # any block at all, and convex ones only
    convex = searched(wall(coarse, convex_blocks=True), ExploreSettings(driver="enumeration"))
    budget = max(20, len(done.results) // 4)
    found = searched(wall(coarse), ExploreSettings(driver="genetic", budget=budget))
    pairs = {tuple(row) for row in done.front[["blocks", "shapes"]].to_numpy().tolist()}
    own = found.front[["blocks", "shapes", "load_factor"]].merge(
        done.front[["blocks", "shapes", "load_factor"]], on=["blocks", "shapes"], suffixes=("", "_best")
    )
    equal = own["load_factor"] >= own["load_factor_best"] * (1.0 - 1e-6)
    reached = int(equal.groupby([own["blocks"], own["shapes"]]).any().sum())
    few = table.iloc[0]
    best = float(done.summary.facts["best"])
    report = Report(
        name=NAME,
        title="Few shapes of block: what moulds cost in strength",
        question="How much strength is lost when the blocks of a wall must come out of few moulds, and how many "
        "blocks does it take?",
        source="Ours; the scene comes with the program.",
        model=f"The wall of {done.scene.name!r}, blocks of one to four cells, every segmentation solved under every "
        "load case; λ is the governing factor. Moulds may be turned and turned over.",
        agrees=(
            f"All {len(done.results)} classes are solved, so the front of λ, blocks and shapes is proven point by "
            f"point: {len(pairs)} pairs of counts are on it.",
            f"The genetic driver, with {budget} evaluations, reaches {reached} of these {len(pairs)} points.",
        ),
        differs=(
            f"The strongest layout carries {best:.4g}; the strongest with {few['shapes']:.0f} shapes "
            f"{few['load_factor']:.4g}, {100.0 * few['share']:.1f} % of it: here few moulds cost next to nothing.",
            f"With convex blocks only the strongest carries {float(convex.summary.facts['best']):.4g}.",
            "Shapes are outlines: what a mould costs, or how blocks are turned in it, is not modelled.",
        ),
        pictures={
            "": "The best λ for every number of blocks and of shapes; filled: on the front, as more blocks and fewer "
            "shapes are wanted. Below: layouts on it."
        },
    )
    figure = plot_three(done.results, done.front, done.assembly, axes=AXES)
    write(out, report, table, {"": figure})
    return table
