"""Iteration without dilation, step by step, beside the interval of all solutions that were found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jld_core import Assembly, Bits, InputError, Model, ParameterError, Status, files
from jld_core.limit import number
from jld_core.models import limit_analysis, solve_rigid
from jld_dilation.fixed_point_search import FixedPointSearch, ProximalOptions
from jld_dilation.sweep import initial_forces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDS = ("lowest_found", "highest_found", "lowest_proven", "associative_load_factor")


def steps_of(assembly: Assembly, labels: Bits, model: Model) -> list[dict[str, Any]]:
    """Return the steps of the fixed-point search, by named numbers in scene units.

    Raises InputError for a structure that has no state to start from, several load cases, or points as contacts.
    """
    if assembly.cases:
        raise ParameterError("history", "the iteration of several load cases is not one", "a scene with one load")
    if model.contact == "concave" and assembly.dimension == 3:
        raise ParameterError("history", "points as contacts have no friction of faces", '`contact="convex"`')
    analysis = limit_analysis(assembly, model, reference=labels)
    associative = analysis.prove(labels)
    if associative.state is None or associative.status is Status.UNSTABLE:
        raise InputError(
            "history", "with dilation the structure carries no load: nothing to start from", "one that stands"
        )
    locked = associative.status is Status.LOCKED
    options = ProximalOptions(0.0 if locked else model.alpha, start=model.start, effective_area=model.effective_area)
    search = FixedPointSearch(analysis, labels, options)
    search.history = []
    search.pair_from(initial_forces(search, associative, options.start))
    return [
        {
            "step": k,
            "kind": step.kind,
            "alpha": step.alpha,
            "load_factor": step.load * analysis.template.scaling.load,
            "friction_violation": step.violation,
            "dilation": number(step.dilation),
            "complementarity_gap": number(step.gap),
        }
        for k, step in enumerate(search.history, 1)
    ]


def interval_of(assembly: Assembly, labels: Bits, model: Model) -> dict[str, float | None]:
    """Return the ends of the interval of all solutions without dilation: found, proven, and with dilation."""
    seconds = model.floor_seconds if model.range else 0.0
    result = solve_rigid(assembly, labels, replace(model, range=True, floor_seconds=seconds, gap=Model.gap))
    return {name: result.facts.get(name) for name in ENDS}


def write_history(assembly: Assembly, labels: Bits, model: Model, path: Path) -> None:
    """Write the steps of `steps_of` as a CSV table, and a picture of the same name beside it."""
    if path.suffix != ".csv":
        raise ParameterError("history", f"{path.name!r} is no table", "a file with the ending .csv")
    import pandas as pd  # slow to import

    from jld_views import figures

    steps = steps_of(assembly, labels, model)
    files.write_text(path, pd.DataFrame(steps).to_csv(index=False))
    figures.save_figure(figure_of_history(steps, interval_of(assembly, labels, model)), path.with_suffix(".png"))


def figure_of_history(
    steps: list[dict[str, Any]], interval: dict[str, float | None], published: dict[str, float] | None = None
) -> Figure:
    """Draw λ, violation and dilation by step, with the interval beside λ; published: other values of λ by name."""
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from jld_views import look

    figure = Figure(figsize=(8.0, 7.0), dpi=110)
    FigureCanvasAgg(figure)
    top, middle, last = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (2.2, 1, 1)})
    x = np.array([step["step"] for step in steps])
    each = np.array([step["kind"] == "least gap" for step in steps])
    low, high = interval["lowest_found"], interval["highest_found"]
    if low is not None and high is not None:
        top.axhspan(low, high, color=look.TINTS[0], label=f"solutions found: {low:.5g} to {high:.5g}", lw=0)
    levels = {"with dilation": interval["associative_load_factor"], "none below, proven": interval["lowest_proven"]}
    for (name, value), dash in zip(
        (levels | (published or {})).items(), ("-", "--", ":", "-.", (0, (1, 3))), strict=False
    ):
        if value is not None:
            top.axhline(value, color=look.SOFT, ls=dash, lw=1.0, label=f"{name}: {value:.5g}")
    for ax, key, title in (
        (top, "load_factor", "load factor λ"),
        (middle, "friction_violation", "violation of friction"),
        (last, "dilation", "dilation / slip"),
    ):
        y = np.array([np.nan if step[key] is None else step[key] for step in steps], dtype=float)
        y = y if ax is top else np.maximum(y, 1e-14)
        ax.plot(x, y, color=look.PRESS, lw=1.0)
        ax.plot(x[~each], y[~each], "o", color=look.PRESS, ms=4, label="frozen friction" if ax is top else None)
        ax.plot(x[each], y[each], "D", color=look.LOAD, ms=5, label="least gap" if ax is top else None)
        ax.set_ylabel(title, fontsize=9)
        ax.tick_params(labelsize=8)
        if ax is not top:
            ax.set_yscale("log")
    top.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    last.set_xlabel("step", fontsize=9)
    figure.subplots_adjust(left=0.1, right=0.68, top=0.96, bottom=0.08, hspace=0.12)
    return figure
