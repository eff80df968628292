"""Labellings a second and core, ours and plain, and where our time goes."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks.throughput import PARTS, Throughput

COLOURS: Final = ("#2166ac", "#92c5de", "#1b7837", "#a6dba0", "#c2a5cf", "#bdbdbd")
DEEP: Final = ("#2166ac", "#1b7837")
"""Colours on which digits are white."""


def draw(found: list[Throughput]) -> Figure:
    """Left the rates, right the shares, scenes from left to right and from top to bottom."""
    figure = Figure(figsize=(12.0, 4.6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    place = np.arange(len(found))
    for name, colour, shift, values in (
        ("ours, both bounds proven", "#b2182b", -0.2, [one.rate for one in found]),
        ("plain CVXPY, nothing proven", "#2166ac", 0.2, [one.plain for one in found]),
    ):
        bars = left.bar(place + shift, values, 0.38, color=colour, label=name)
        left.bar_label(bars, [f"{value:.0f}" for value in values], fontsize=8)
    left.set_yscale("log")
    left.set_ylim(top=4.0 * max(one.rate for one in found))
    left.set_xticks(place, [one.name.replace(", ", "\n") for one in found], fontsize=8)
    left.set_ylabel("labellings per second and core")
    left.legend(frameon=False, fontsize=8)
    start = np.zeros(len(found))
    for part, colour in zip(PARTS, COLOURS, strict=True):
        share = np.array([100.0 * one.shares[part] for one in found])
        right.barh(place, share, 0.7, left=start, color=colour, label=part)
        for y, x, value in zip(place, start, share, strict=True):
            if value >= 5.0:
                ink = "white" if colour in DEEP else "black"
                right.text(x + 0.5 * value, y, f"{value:.0f}", color=ink, ha="center", va="center", fontsize=8)
        start += share
    right.set_yticks(place, [one.name for one in found], fontsize=8)
    right.invert_yaxis()
    right.set_xlim(0.0, 100.0)
    right.set_xlabel("share of our wall time, %")
    right.legend(loc="upper center", bbox_to_anchor=(0.5, 1.17), ncols=3, frameon=False, fontsize=8)
    return figure
