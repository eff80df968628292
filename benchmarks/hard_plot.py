"""Width of the bracket and processor time of every hard case."""

from __future__ import annotations

import math
from typing import Final

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.hard_cases import WIDE, Verdict
from jld_core import Status

LEAST: Final = 1e-16
"""Width at which an exact bracket is drawn."""
LOOKS: Final = {
    "bracket, first solve": ("o", "#2166ac"),
    "bracket, after fallbacks": ("D", "#e08214"),
    "locked or unstable, proven": ("s", "#1b7837"),
    "uncertified": ("X", "#b2182b"),
}


def look_of(verdict: Verdict) -> str:
    """How a case is drawn."""
    if verdict.found.status is Status.UNCERTIFIED:
        return "uncertified"
    if verdict.found.status is not Status.COLLAPSE:
        return "locked or unstable, proven"
    return "bracket, first solve" if len(verdict.found.route) == 1 else "bracket, after fallbacks"


def draw(verdicts: list[Verdict]) -> Figure:
    """Cases from top to bottom; left the relative width of the bracket, right the time."""
    figure = Figure(figsize=(11.0, 0.19 * len(verdicts) + 1.6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    for place, verdict in enumerate(verdicts):
        marker, colour = LOOKS[look_of(verdict)]
        gap = verdict.found.gap
        at = max(gap, LEAST) if math.isfinite(gap) else LEAST
        left.plot(at, place, marker, color=colour, ms=6, alpha=1.0 if math.isfinite(gap) else 0.6)
        right.plot(verdict.seconds, place, marker, color=colour, ms=6)
    for ax in (left, right):
        ax.set_xscale("log")
        ax.grid(True, color="0.92", lw=0.6)
    left.axvline(WIDE, color="0.4", lw=0.8, ls="--")
    left.set_yticks(range(len(verdicts)), [str(verdict.case) for verdict in verdicts], fontsize=7)
    left.invert_yaxis()
    left.set_ylim(len(verdicts) - 0.4, -0.6)
    left.set_xlabel(f"relative width of the bracket ({LEAST:.0e}: exact, or none)")
    right.set_xlabel("processor time, s")
    handles = [Line2D([], [], ls="", marker=m, color=c, label=name) for name, (m, c) in LOOKS.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    return figure
