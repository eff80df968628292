"""Which layout of the beam-arch is strong when cracks are brittle: the front by experiment against the front by λ.

λ of limit analysis bounds every quasi-static experiment from above, so layouts are experimented on from the largest λ
down, and those below what was carried with as many joints need none.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Assembly, load_scene
from jld_experiment import Joints, run_experiment
from jld_explore import ExploreSettings, explore
from jld_explore.space import from_string
from jld_views.figures import draw_assembly
from studies.report import GREY, PAIRED, SCENES, Report, axes_at, figure_of, name_axes, without_legend, write

NAME: Final = "brittle_front"
MOST: Final = 200
"""Experiments for each number of dry joints, at the most."""


def ranked() -> tuple[pd.DataFrame, Assembly]:
    """Every class of the beam-arch's segmentations by λ."""
    with tempfile.TemporaryDirectory() as folder:
        settings = ExploreSettings(driver="enumeration", pictures=False)
        done = explore(load_scene(SCENES / "flat_beam_arch.json"), Path(folder) / "search", settings)
    return done.results[done.results["status"] == "collapse"], done.assembly


def experiments(results: pd.DataFrame, assembly: Assembly, most: int) -> pd.DataFrame:
    """Experiments from the most joints to the fewest and from the largest λ down, as long as λ leaves hope.

    Columns: labelling, dry_faces, load_factor, experiment, rate_error, open: is λ of a layout left out above the most
    carried with at least as many joints?
    """
    rows: list[dict[str, Any]] = []
    carried = 0.0
    for count in sorted(results["dry_faces"].unique(), reverse=True):
        group = results[results["dry_faces"] == count]
        tried = 0
        for layout in group.to_dict("records"):
            if layout["load_factor"] <= carried or tried == most:
                break
            curve = run_experiment(assembly, from_string(str(layout["labelling"])), joints=Joints())
            value = curve.collapse_load if curve.stands and curve.rates_agree else 0.0
            carried, tried = max(carried, value), tried + 1
            row = {"labelling": layout["labelling"], "dry_faces": int(count), "load_factor": layout["load_factor"]}
            rows.append(row | {"experiment": value, "rate_error": curve.rate_error, "stands": curve.stands})
        left = float(group["load_factor"].iloc[tried]) if tried < len(group) else 0.0
        for row in rows[len(rows) - tried :]:
            row["open"] = left > carried
    return pd.DataFrame(rows)


def front(table: pd.DataFrame, column: str) -> pd.DataFrame:
    """Rows that carry more than all with at least as many joints."""
    kept, best = [], 0.0
    for count in sorted(table["dry_faces"].unique(), reverse=True):
        row = table[table["dry_faces"] == count].nlargest(1, column).iloc[0]
        if row[column] > best:
            best = float(row[column])
            kept.append(row)
    return pd.DataFrame(kept)


def run(out: Path, coarse: bool) -> pd.DataFrame:
    """Experiments, both fronts, table, picture and page."""
    results, assembly = ranked()
    table = experiments(results, assembly, 2 if coarse else MOST)
    by_experiment = front(table, "experiment").assign(part="front by experiment")
    by_load = front(results.assign(experiment=np.nan), "load_factor")[["labelling", "dry_faces", "load_factor"]]
    known = table.set_index("labelling")["experiment"]
    values = [known[name] if name in known.index else _carried(assembly, str(name)) for name in by_load["labelling"]]
    by_load = by_load.assign(part="front by λ", experiment=values)
    whole = pd.concat([by_load, by_experiment, table.assign(part="tried")], ignore_index=True)
    shown = whole[whole["part"] != "tried"].drop(columns="labelling").dropna(axis=1, how="all")
    write(out, _report(whole, len(results)), whole, {"": _picture(whole, results, assembly)}, shown)
    return whole


def _carried(assembly: Assembly, name: str) -> float:
    curve = run_experiment(assembly, from_string(name), joints=Joints())
    return curve.collapse_load if curve.stands else 0.0


def _report(whole: pd.DataFrame, classes: int) -> Report:
    tried = whole[whole["part"] == "tried"]
    best = tried.nlargest(1, "experiment").iloc[0]
    strongest = whole[whole["part"] == "front by λ"].nlargest(1, "load_factor").iloc[0]
    place = int((whole[whole["part"] == "tried"]["load_factor"] > best["load_factor"]).sum()) + 1
    open_ = tried.groupby("dry_faces")["open"].last()
    both = set(whole[whole["part"] == "front by λ"]["labelling"])
    same = len(both & set(whole[whole["part"] == "front by experiment"]["labelling"]))
    count = int((whole["part"] == "front by experiment").sum())
    return Report(
        name=NAME,
        title="Strong when cracks are brittle",
        question="Is the layout with the largest λ also the one that carries most when cracks break?",
        source="The beam-arch of this project; materials of section 3.3 of Iannuzzo et al. 2024.",
        model=f"All {classes} classes of segmentations with a λ, ranked by it; experiments with brittle inner faces, "
        "without dilation, equal stiffness of all faces, no friction in cracks. From the most joints to the fewest and "
        f"from the largest λ down, until λ is below what was carried with at least as many joints, or {MOST} were "
        "tried.",
        agrees=(
            "No experiment carries more than λ, so λ orders the search: "
            f"{len(tried)} experiments instead of {classes}, and for "
            f"{int((~open_.astype(bool)).sum())} of {len(open_)} numbers of joints no layout left out can be better.",
        ),
        differs=(
            f"The strongest by λ ({strongest['load_factor']:.2f}) carries {strongest['experiment']:.2f}; the most is "
            f"carried by one of λ = {best['load_factor']:.2f}: {best['experiment']:.2f}, "
            f"{best['experiment'] / strongest['experiment']:.2f} times as much. It is number {place} by λ among those "
            "tried.",
            f"{same} of the {count} layouts on the front by experiment are on the front by λ.",
            f"For {int(open_.astype(bool).sum())} numbers of joints layouts were left out whose λ leaves hope: there "
            "the front by experiment is found, not bounded. What is carried depends on the stiffness of inner faces "
            "over that of joints.",
        ),
        pictures={"": "Left: λ, and what brittle cracks leave of it, by dry joints. Right: the strongest of each."},
    )  # fmt: skip


def _picture(whole: pd.DataFrame, results: pd.DataFrame, assembly: Assembly) -> Figure:
    figure = figure_of(12.8, 5.6)
    ax = axes_at(figure, 0.7, 0.7, 7.2, 4.3)
    ax.plot(results["dry_faces"], results["load_factor"], ".", color="#D5D5D5", ms=4, label="λ, all layouts")
    tried = whole[whole["part"] == "tried"]
    ax.plot(tried["dry_faces"], tried["experiment"], "x", color=GREY, ms=4, mew=0.7, label="carried, brittle, tried")
    for part, column, (colour, dash, marker), name in (
        ("front by λ", "load_factor", PAIRED[0], "front by λ: λ"),
        ("front by λ", "experiment", PAIRED[2], "front by λ: carried, brittle"),
        ("front by experiment", "experiment", PAIRED[1], "front by experiment: carried, brittle"),
    ):
        rows = whole[whole["part"] == part].sort_values("dry_faces")
        ax.plot(rows["dry_faces"], rows[column], marker, color=colour, ls=dash, ms=6, lw=1.3, label=name)
    name_axes(ax, "dry joints [–]", "load factor [–]")
    ax.set_ylim(0.0, 1.3 * float(results["load_factor"].max()))
    ax.legend(frameon=False, fontsize=8, ncols=2, loc="upper right")
    for k, (part, column, name) in enumerate(
        (
            ("front by λ", "load_factor", "strongest by λ"),
            ("front by experiment", "experiment", "strongest by experiment"),
        )
    ):
        row = whole[whole["part"] == part].nlargest(1, column).iloc[0]
        drawing = axes_at(figure, 8.7, 3.15 - 2.6 * k, 3.6, 1.95)
        _layout(drawing, assembly, str(row["labelling"]), name, row)
    figure.suptitle("The beam-arch: strong by λ, and strong when cracks are brittle", fontsize=12, y=0.98)
    return figure


def _layout(ax: Axes, assembly: Assembly, labelling: str, name: str, row: pd.Series) -> None:
    draw_assembly(ax, assembly, from_string(labelling))
    without_legend(ax, f"{name}: λ = {row['load_factor']:.2f}, carries {row['experiment']:.2f}")
    name_axes(ax, "x [m]", "y [m]", size=8)
