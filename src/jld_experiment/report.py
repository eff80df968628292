"""Report an experiment beside limit analysis: numbers, table and picture."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jld_core import LimitAnalysisResult
from jld_core.limit import number
from jld_experiment.experiment import Curve
from jld_views import figures

PUSHED, FASTER, LIMIT = "#1B1B1B", "#D55E00", "#0072B2"


def status_of(curve: Curve) -> str:
    """Return the status of an experiment: collapse, uncertified, locked, falls or creeps."""
    if not curve.stands:
        return str(curve.standing)
    if curve.rising:
        return "locked"
    return "collapse" if curve.rates_agree else "uncertified"


def summary(curve: Curve, load_factor: float) -> dict[str, Any]:
    """Return the data of `jld experiment --json`: status, loads, their accuracy and settings."""
    # Numbers that are not finite are None.
    found = curve.collapse_load
    joints, settings = curve.joints, curve.settings
    return {
        "name": curve.assembly.name,
        "status": status_of(curve),
        "collapse_load": number(found),
        "load_factor": number(load_factor),
        "ratio": number(found / load_factor if load_factor > 0.0 else np.nan),
        "stands": curve.stands,
        "rate_error": number(curve.rate_error) if curve.stands and np.isfinite(found) else None,
        "accuracy": number(curve.accuracy) if curve.stands and np.isfinite(found) else None,
        "first_crack": number(curve.first_crack),
        "unbalanced": number(float(curve.unbalanced[curve.collapse])) if len(curve.unbalanced) else None,
        "cracked_faces": int(np.count_nonzero(curve.cracked > 0.0)),
        "energy": None if curve.energy is None else asdict(curve.energy),
        "energy_error": number(float(curve.energy_error.max())) if len(curve.energy_error) else None,
        "inner": joints.inner,
        "dilation": joints.dilation,
        "inner_ratio": joints.inner_ratio,
        "residual_friction": joints.residual_friction,
        "scheme": settings.scheme,
        "segments": settings.segments,
        "damping_scheme": settings.damping_scheme,
        "moving": settings.moving,
        "periods": round(curve.periods),
    }


def table(curve: Curve) -> pd.DataFrame:
    """Return both pushes as a table with one row per record."""
    # Columns are push (slow, fast), distance (live·u), elastic, load_factor, unbalanced, broken and energy_error.
    # `elastic` is the distance over that of the elastic structure at the collapse load. The columns unbalanced, broken
    # and energy_error are NaN for the fast push. The table is empty if the structure does not stand.
    slow = pd.DataFrame(
        {
            "push": "slow",
            "distance": curve.distance,
            "load_factor": curve.load_factor,
            "unbalanced": curve.unbalanced,
            "broken": curve.broken,
            "energy_error": curve.energy_error,
        }
    )
    fast = pd.DataFrame({"push": "fast", "distance": curve.faster[:, 0], "load_factor": curve.faster[:, 1]})
    both = pd.concat([slow, fast], ignore_index=True) if len(slow) else slow
    both.insert(2, "elastic", both["distance"] / (curve.reach * curve.collapse_load))
    return both


def end_state(curve: Curve, result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result of limit analysis with the displacements of an experiment as mechanism."""
    # scaled to live power 1, or to a largest entry of 1 where it does not stand or the loads do not advance
    moved = curve.at_end
    power = float((curve.assembly.live * moved).sum())
    scale = power if curve.stands and power > 0.0 else float(np.abs(moved).max()) or 1.0
    return replace(result, mechanism=moved / scale)


def draw_curve(
    ax: Axes,
    curve: Curve,
    load_factor: float,
    band: tuple[float, float] | None = None,
    proven: float | None = None,
) -> None:
    """Plot λ over displacement of an experiment, with λ of limit analysis as a line."""
    # The displacement is relative to the elastic one at collapse.
    unit = curve.reach * (curve.collapse_load or np.nan)
    if band is not None:
        low, high = band
        name = f"zero dilation: {low:.5g}" + (f" – {high:.5g}" if high > low * (1.0 + 1e-4) else "")
        ax.axhspan(
            low, max(high, low * 1.004), facecolor="#FBE3B5", edgecolor="#C9A55A", hatch="///", lw=0.6, label=name
        )
    if proven is not None:
        ax.axhline(proven, color=PUSHED, lw=1.1, ls=(0, (1, 1.5)), label=f"proven, none below: {proven:.5g}")
    if len(curve.distance):
        ax.plot(
            curve.faster[:, 0] / unit, curve.faster[:, 1], color=FASTER, lw=1.0, ls=(0, (4, 2)), label="faster push"
        )
        ax.plot(curve.distance / unit, curve.load_factor, color=PUSHED, lw=1.3, label="slower push")
        at = curve.collapse
        name = f"collapse: {curve.collapse_load:.5g}"
        ax.plot(curve.distance[at] / unit, curve.load_factor[at], "v", color=PUSHED, ms=7, label=name)
    if np.isfinite(load_factor):
        name = f"limit analysis: λ = {load_factor:.5g}"
        ax.axhline(load_factor, color=LIMIT, lw=1.2, ls=(0, (6, 1.5, 1, 1.5)), label=name)
    top = np.nanmax([load_factor, curve.load_factor.max(initial=0.0), 1e-300])
    ax.set_ylim(min(0.0, float(np.clip(curve.load_factor.min(initial=0.0), -0.15 * top, 0.0))), 1.45 * top)
    ax.set_xlim(left=0.0)
    ax.set_xlabel("movement of the live loads / elastic one at collapse [–]", fontsize=9)
    ax.set_ylabel("λ [–]", fontsize=9)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, fontsize=8, loc="upper right")
    if not curve.stands:
        ax.text(0.5, 0.5, "does not stand under its dead loads", transform=ax.transAxes, ha="center", fontsize=10)
    ax.tick_params(labelsize=8)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def figure_of(
    curve: Curve,
    result: LimitAnalysisResult,
    band: tuple[float, float] | None = None,
    proven: float | None = None,
) -> Figure:
    # The figure is not saved.
    figure = Figure(figsize=(14.4, 5.7), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3, width_ratios=(1.15, 1.0, 1.0))
    draw_curve(axes[0], curve, result.load_factor, band, proven)
    titles = ("end of the experiment", "mechanism of limit analysis")
    for ax, shown, title in zip(axes[1:], (end_state(curve, result), result), titles, strict=True):
        figures.draw_mechanism(ax, shown)
        ax.set_title(title, fontsize=10)
    joints = curve.joints
    dilation = "dilation = friction" if joints.dilation == "friction" else f"dilation {joints.dilation:g}"
    figure.suptitle(f"{curve.assembly.name}: {status_of(curve)} · {joints.inner} inner faces, {dilation}", fontsize=11)
    return figure
