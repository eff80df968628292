"""One load and two: what a layout that is best under one load carries under its mirror image."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from jld_core import Assembly, Scene, build_assembly, load_scene, parse_scene, solve
from jld_explore import ExploreSettings
from jld_explore.space import from_string
from jld_views.figures import draw_mechanism
from studies.report import (
    SCENES,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    legend_at,
    searched,
    without_legend,
    write,
)

NAME: Final = "two_loads"
NAMES: Final = ("left", "right")


def scene(both: bool) -> Scene:
    """The beam-arch with a load left of its middle, or with that and its mirror image as load cases."""
    document = json.loads(load_scene(SCENES / "flat_beam_arch.json").model_dump_json(exclude_defaults=True))
    width = len(document["grid"]["rows"][0])
    half = [1]
    loads: list[list[dict[str, Any]]] = [
        [{"element": f"c{c}r0", "force": [0, -100]} for c in columns]
        for columns in (half, [width - 1 - c for c in half])
    ]
    cases = [{"name": name, "live": live} for name, live in zip(NAMES, loads, strict=True)]
    return parse_scene({**document, "loads": {"cases": cases} if both else {"live": loads[0]}})


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Search under one load and under both, write table, picture and page into a folder; returns the table."""
    settings = ExploreSettings(pictures=False, driver="enumeration", jobs=1)
    assembly, rows, ties = build_assembly(scene(True)), [], []
    for layout, both in (("best under one", False), ("best under both", True)):
        done = searched(scene(both), settings)
        best = done.results.loc[done.results["rank"] == 1, "labelling"]
        # many tie: who asks for one load only may get the one that the other load harms most
        tied = {text: solve(assembly, from_string(text)) for text in best}
        pick = max if both else min
        text, result = pick(tied.items(), key=lambda pair: (round(pair[1].load_factor, 6), pair[0]))
        ties.append([one.load_factor for one in tied.values()])
        each = {f"load_factor[{name}]": result.cases[name].load_factor for name in NAMES}
        proven = bool(done.summary.proven)
        rows.append({"layout": layout, "load_factor": result.load_factor, **each, "proven": proven, "labelling": text})
    table = pd.DataFrame(rows)
    one, both = table["load_factor"]
    report = Report(
        name=NAME,
        title="One load and two",
        question="The strongest layout under a load left of the middle of a beam-arch: what does it carry when the "
        "load stands right of it, and what does asking for both bring?",
        source="No published numbers; geometry and materials of the beam-arch as in scenes/flat_beam_arch.json.",
        model="Ours: 100 N on the second of five upper cells; the same on the fourth as a second load case. "
        "Blocks of two to six cells. All segmentations are solved.",
        agrees=(
            f"Best under the left load alone: λ = {table['load_factor[left]'][0]:.4g} there. {len(ties[0])} layouts "
            f"tie; under the mirror image they carry {min(ties[0]):.4g} to {max(ties[0]):.4g}, the first is in the "
            "table.",
            f"Best under both: λ = {both:.4g} wherever it stands, {both / one:.2f} times what is sure if only one load "
            "is asked for.",
        ),
        differs=("Two cases are two: a load in the middle, or a moving one, is not among them.",),
        pictures={"": "Both layouts of the table under both loads, with their mechanisms at collapse."},
    )
    write(out, report, table, {"": _picture(table, assembly)}, table.drop(columns="labelling"))
    return table


def _picture(table: pd.DataFrame, assembly: Assembly) -> Figure:
    figure = figure_of(11.4, 9.8)
    for row, (layout, text) in enumerate(zip(table["layout"], table["labelling"], strict=True)):
        result = solve(assembly, from_string(str(text)))
        for column, name in enumerate(NAMES):
            ax = axes_at(figure, 0.6 + 5.5 * column, 5.6 - 4.5 * row, 4.9, 3.5)
            draw_mechanism(ax, result.cases[name])
            governs = ", governs" if result.governing == name else ""
            without_legend(ax, f"{layout}, loaded {name}: λ = {result.cases[name].load_factor:.4g}{governs}")
    legend_at(figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack"), 1.4, 0.1, 6)
    figure.suptitle("One load and two", fontsize=12, y=0.99)
    return figure
