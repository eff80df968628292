"""What 1 312 N is: iterations without dilation from several starts, beside the interval of all solutions.

Source: Iannuzzo et al. 2024, section 3.3, for the number; section 2.4 for the iteration with frozen friction. Layouts
as in `leonardo_section_3_3`: ours, and one that gives the λ published with dilation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Model, build_assembly
from jld_dilation.history import interval_of, steps_of
from studies.leonardo_section_3_3 import found
from studies.report import GREY, PAIRED, Report, axes_at, figure_of, name_axes, write
from studies.scenes import leonardo_flat_arch

NAME: Final = "what_is_1312"
PUBLISHED: Final = {"with dilation": 2153.0, "without": 1312.0}
STARTS: Final = ("associative", "gravity", "vertex")
ALPHAS: Final = (0.0, 0.01, 0.1, 0.3, 1.0)


def histories(name: str, scene: Any, alphas: tuple[float, ...], seconds: float) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Every step from every start and share of one layout, and the ends of its interval."""
    assembly = build_assembly(scene)
    rows: list[dict[str, Any]] = []
    for start in STARTS:
        for alpha in alphas:
            model = Model(friction="zero-dilation", start=start, alpha=alpha)
            rows += [
                {"layout": name, "start": start, "share": alpha, **one}
                for one in steps_of(assembly, assembly.labels, model)
            ]
    model = Model(friction="zero-dilation", range=True, floor_seconds=seconds)
    return pd.DataFrame(rows), interval_of(assembly, assembly.labels, model)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Both layouts: table, picture and page."""
    alphas = ALPHAS[1:2] if coarse else ALPHAS
    layouts = {"ours": leonardo_flat_arch(), "found": found()}
    each = {name: histories(name, scene, alphas, 0.0 if coarse else 20.0) for name, scene in layouts.items()}
    table = pd.concat([steps for steps, _ in each.values()], ignore_index=True)
    ends = table.groupby(["layout", "start", "share"], sort=False).last().reset_index()
    ends = ends[
        ["layout", "start", "share", "step", "load_factor", "friction_violation", "dilation", "complementarity_gap"]
    ]
    write(out, _report(ends, {name: ends for name, (_, ends) in each.items()}), table, {"": _picture(each)}, ends)
    return table


def _report(ends: pd.DataFrame, intervals: dict[str, dict[str, Any]]) -> Report:
    def words(name: str) -> str:
        own, span = ends[ends["layout"] == name]["load_factor"], intervals[name]
        floor = span["lowest_proven"]
        low = f"; none lies below {floor:.1f} N, proven" if floor else ""
        return (
            f"Layout {name}: solutions without dilation were found from {span['lowest_found']:.1f} to "
            f"{span['highest_found']:.1f} N{low}. {len(own)} iterations end at {own.min():.1f} to {own.max():.1f} N."
        )

    nearest = ends.iloc[(ends["load_factor"] - PUBLISHED["without"]).abs().argmin()]
    return Report(
        name=NAME,
        title="What 1 312 N is",
        question="Is λ without dilation one number of the structure, or one of many that an iteration may end at?",
        source="Iannuzzo et al. 2024, section 3.3: 2153 N with and 1312 N without dilation; its start, its shares of "
        "the present normal force and its layout are not at hand.",
        model="Layouts, cells and materials of the study of section 3.3. Friction frozen at the normal forces of the "
        "step before, with a share α of the present ones, tenfold smaller at each step; then the complementarity gap "
        "is minimised (docs/method.md (4.1) to (4.3)), as `jld solve --start --alpha --history` does.",
        agrees=(
            *map(words, intervals),
            "Every iteration ends at a certified solution: forces in equilibrium within friction, a mechanism that "
            f"does not dilate, a gap below {ends['complementarity_gap'].max():.0e} of the dissipation.",
            f"1312 N lies inside both intervals; the nearest end of an iteration is {nearest['load_factor']:.1f} N "
            f"(layout {nearest['layout']}, start {nearest['start']}, α = {nearest['share']:g}).",
        ),
        differs=(
            "So 1312 N is one of a continuum of solutions, and says more about start and share than about the layout; "
            "the two numbers that the structure does have are λ with dilation above and the lowest solution below.",
            "Which start and share the source took is not known; no setting here ends at its number to the digit.",
        ),
        pictures={"": "λ by step from each start (α = 0.01), on the interval of all solutions found; ends by share."},
    )


def _picture(each: dict[str, tuple[pd.DataFrame, dict[str, Any]]]) -> Figure:
    figure = figure_of(11.0, 4.3 * len(each) + 0.3)
    for k, (name, (steps, interval)) in enumerate(each.items()):
        bottom = 4.3 * (len(each) - 1 - k) + 0.75
        left = axes_at(figure, 0.8, bottom, 4.2, 3.1)
        right = axes_at(figure, 5.9, bottom, 2.6, 3.1)
        for ax in (left, right):
            _interval(ax, interval)
        for start, (colour, dash, marker) in zip(STARTS, PAIRED, strict=False):
            own = steps[steps["start"] == start]
            one = own[own["share"] == 0.01]
            left.plot(
                one["step"], one["load_factor"], color=colour, ls=dash, marker=marker, ms=4, label=f"start {start}"
            )
            last = own.groupby("share")["load_factor"].last()
            right.plot(np.arange(len(last)), last, color=colour, ls=dash, marker=marker, ms=4)
        shares = steps["share"].unique()
        right.set_xticks(np.arange(len(shares)), [f"{one:g}" for one in shares])
        name_axes(left, "step", "λ [N per force]", f"layout {name}: every step, α = 0.01")
        name_axes(right, "share α", "", "where iterations end")
        left.set_ylim(right.get_ylim()[0] - 900.0, right.get_ylim()[1] + 100.0)
        place = (8.65 / 11.0, (bottom + 1.6) / figure.get_figheight())
        figure.legend(
            *left.get_legend_handles_labels(), loc="center left", bbox_to_anchor=place, frameon=False, fontsize=8
        )
    return figure


def _interval(ax: Axes, interval: dict[str, Any]) -> None:
    """The interval of all solutions found, and the two numbers published."""
    low, high = interval["lowest_found"], interval["highest_found"]
    ax.axhspan(low, high, color="#CFE1F2", lw=0, label=f"solutions found:\n{low:.0f} to {high:.0f} N")
    if interval["lowest_proven"]:
        ax.axhline(
            interval["lowest_proven"], color=GREY, lw=1.0, ls=":", label=f"none below {interval['lowest_proven']:.0f} N"
        )
    for (name, value), dash in zip(PUBLISHED.items(), ("-", "--"), strict=True):
        ax.axhline(value, color="#1B1B1B", lw=1.1, ls=dash, label=f"published {name}: {value:.0f} N")
