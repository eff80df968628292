"""Few cuts: λ against sawn length and moulds, each point proven by the exact driver under stepped limits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jld_core import InputError, Scene, build_assembly, load_scene, parse_scene, solve
from jld_core.views.figures import draw_mechanism
from jld_explore import ExploreSettings
from jld_explore.space import from_string
from studies.report import (
    PAIRED,
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

NAME: Final = "few_cuts"

STEP: Final = 1e-6
"""Share of a sawn length by which the next limit lies below it."""


def best_under(scene: Scene, moulds: int, sawn: float | None) -> dict[str, Any] | None:
    """Return the strongest layout with so many moulds and so much sawn length at the most, None if there is no layout.

    sawn: length; None for any. The entries are load_factor, bound, proven, sawn_length, moulds and labelling.
    """
    document: dict[str, Any] = json.loads(scene.model_dump_json(exclude_defaults=True))
    document["search"] = {**document.get("search", {}), "shapes": [None, moulds], "sawn_length": [None, sawn]}
    settings = ExploreSettings(pictures=False, driver="exact", jobs=1, check_fields=0)
    try:
        done = searched(parse_scene(document), settings)
    except InputError as error:
        if "no labelling satisfies" not in str(error):
            raise
        return None
    first = done.results.iloc[0]
    return {
        "load_factor": float(first["load_factor"]),
        "bound": done.summary.bound,
        "proven": done.summary.proven,
        "sawn_length": float(first["sawn_length"]),
        "moulds": int(first["shapes"]),
        "labelling": str(first["labelling"]),
    }


def proven_front(scene: Scene, most: int) -> pd.DataFrame:
    """Return the front of λ (max) against sawn length and moulds (both min), with 1 to `most` moulds.

    For each number of moulds the strongest layout is proven, then the strongest with less to saw, until none is left.
    A point is left out where another one is at least as strong with no more of either.
    """
    rows: list[dict[str, Any]] = []
    for moulds in range(1, most + 1):
        sawn: float | None = None
        while (found := best_under(scene, moulds, sawn)) is not None:
            rows.append(found)
            sawn = found["sawn_length"] * (1.0 - STEP)
    table = pd.DataFrame(rows).drop_duplicates("labelling", ignore_index=True)
    values = table[["load_factor", "sawn_length", "moulds"]].to_numpy(dtype=float) * [1.0, -1.0, -1.0]
    values[:, :2] = np.round(values[:, :2] / np.abs(values[:, :2]).max(axis=0), 6)
    beaten = [bool(np.any((values >= row).all(axis=1) & (values > row).any(axis=1))) for row in values]
    kept = table[~np.array(beaten)].drop_duplicates(["sawn_length", "moulds"])
    return kept.sort_values(["moulds", "sawn_length"], ignore_index=True)


def run(out: Path, quick: bool = False) -> pd.DataFrame:
    """Search, write table, picture and page into a folder; return the table."""
    scene = load_scene(SCENES / "flat_beam_arch.json")
    table = proven_front(scene, 2 if quick else 4)
    best, least = table.loc[table["load_factor"].idxmax()], table.loc[table["sawn_length"].idxmin()]
    report = Report(
        name=NAME,
        title="Few cuts",
        question="How strong may a beam-arch be that takes little sawing and few moulds?",
        source="No published numbers; geometry of the beam-arch as in scenes/flat_beam_arch.json.",
        model="Materials and blocks of the scene. Sawn length is that of all faces of all blocks, moulds are shapes "
        "that no turn brings onto one another. The exact driver proves the strongest layout under each limit on both; "
        "the limit on the length is stepped down from what the last layout took.",
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
    ax.set_xlabel("sawn length [m]", fontsize=9)
    ax.set_ylabel("largest λ [–], proven", fontsize=9)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=7))
    ax.legend(frameon=False, fontsize=9)
    single = table[table["moulds"] == table["moulds"].min()]
    chosen = (table.loc[table["load_factor"].idxmax()], single.loc[single["load_factor"].idxmax()])
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
