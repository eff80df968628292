"""Few cuts: λ against sawn length and moulds, each point proven by the exact driver."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jld_core import Scene, build_assembly, load_scene, parse_scene, solve
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

NAME: Final = "few_cuts"


def proven_front(scene: Scene) -> pd.DataFrame:
    """Return the front of λ (max) against sawn length and moulds (both min).

    The exact driver evaluates every layout. The columns are load_factor, bound, proven, sawn_length, moulds and
    labelling.
    """
    document: dict[str, Any] = json.loads(scene.model_dump_json(exclude_defaults=True))
    document.setdefault("search", {})["front"] = {"counts": ["sawn_length", "shapes"], "sense": "min"}
    settings = ExploreSettings(pictures=False, driver="exact", options={"aim": "front"}, jobs=1, check_fields=0)
    found = searched(parse_scene(document), settings).front.rename(columns={"shapes": "moulds", "bracket_hi": "bound"})
    table = found.assign(proven=found["evidence"] == "proven")
    names = ["load_factor", "bound", "proven", "sawn_length", "moulds", "labelling"]
    return table[names].sort_values(["moulds", "sawn_length"], ignore_index=True)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Search, write table, picture and page into a folder; return the table. A coarse run is the same."""
    scene = load_scene(SCENES / "flat_beam_arch.json")
    table = proven_front(scene)
    best = table.iloc[int(table["load_factor"].to_numpy().argmax())]
    least = table.iloc[int(table["sawn_length"].to_numpy().argmin())]
    report = Report(
        name=NAME,
        title="Few cuts",
        question="How strong may a beam-arch be that takes little sawing and few moulds?",
        source="No published numbers; geometry of the beam-arch as in scenes/flat_beam_arch.json.",
        model="Materials and blocks of the scene. Sawn length is that of all faces of all blocks, moulds are shapes "
        "that no turn brings onto one another. The exact driver evaluates every layout, since no formula "
        "expresses both counts.",
        agrees=(
            f"{int(table['proven'].sum())} of {len(table)} points are proven: no layout with as many moulds and as "
            "little to saw carries more.",
            f"The strongest carries {best.load_factor:.4g} with {best.sawn_length:.3g} m to saw and {best.moulds:g} "
            f"moulds; the least sawing, {least.sawn_length:.3g} m, leaves {least.load_factor:.3g}.",
        ),
        differs=("Cuts through several blocks at once, as by a wire saw, would need less: each face is counted.",),
        pictures={
            "": "Left: λ against the length to saw; each line is one number of moulds. Right: the strongest layout, "
            "and the strongest with one mould."
        },
    )
    write(out, report, table, {"": _picture(table, scene)}, table.drop(columns="labelling"))
    return table


def _picture(table: pd.DataFrame, scene: Scene) -> Figure:
    """Return the picture of the front, beside two of its layouts."""
    assembly = build_assembly(scene)
    figure = figure_of(12.8, 7.0)
    ax = axes_at(figure, 0.8, 1.4, 4.9, 4.8)
    for (moulds, own), (colour, dash, marker) in zip(table.groupby("moulds"), PAIRED, strict=False):
        label = f"{moulds} mould{'s' * int(moulds != 1)}"
        ax.plot(
            own["sawn_length"],
            own["load_factor"],
            marker,
            ls=dash,
            drawstyle="steps-post",
            color=colour,
            ms=7,
            label=label,
        )
    name_axes(ax, "sawn length [m]", "largest λ [–], proven")
    ax.yaxis.set_major_locator(MaxNLocator(nbins=7))
    ax.legend(frameon=False, fontsize=9)
    single = table[table["moulds"] == table["moulds"].min()]
    chosen = [one.iloc[int(one["load_factor"].to_numpy().argmax())] for one in (table, single)]
    for row, one in enumerate(chosen):
        drawing = axes_at(figure, 6.6, 3.9 - 3.0 * row, 5.7, 2.3)
        draw_mechanism(drawing, solve(assembly, from_string(str(one.labelling))))
        words = (
            f"{one.moulds} mould{'s' * int(one.moulds != 1)}, {one.sawn_length:.3g} m to saw: λ = {one.load_factor:.4g}"
        )
        without_legend(drawing, words)
    legend_at(figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack"), 5.4, 0.1, 6)
    figure.suptitle("Few cuts", fontsize=12, y=0.99)
    return figure
