"""Figures of a range of reactions: the states of equilibrium at both ends."""

from __future__ import annotations

import textwrap
from dataclasses import replace

from matplotlib.figure import Figure

from jld_core.views import figures
from jld_practice.reactions.thrust import ResultantRange, ThrustRanges


def figure_of_range(found: ThrustRanges, one: ResultantRange) -> Figure:
    """Return a figure of one range: forces at its least and at its greatest value."""
    figure, axes = figures.figure_for(found.assembly, 2)
    moment = one.resultant.component.startswith("M")
    length, force = found.assembly.units
    unit = f"{force}·{length}" if moment else force
    for ax, end, name in zip(axes, (one.least, one.most), ("least", "greatest"), strict=True):
        if end.state is None:
            figures.draw_assembly(ax, found.assembly, found.labels)
        else:
            state = end.state
            if not found.load_factor:
                bare = replace(state.assembly, live_loads=0.0 * state.assembly.live_loads)
                state = replace(state, assembly=bare)
            figures.draw_forces(ax, state)
        value = {"unbounded": "unbounded", "uncertified": "uncertified"}.get(end.status, f"{end.value:.5g} {unit}")
        ax.set_title(f"{name} {one.resultant.component}: {value}", fontsize=10)
    name = textwrap.shorten(found.assembly.name, 60, placeholder=" …")
    load = f" under {found.load_factor:g} × the live load" if found.load_factor else " under its dead load"
    figures.finish(figure, axes, f"{name}: {one.resultant.place}{load}")
    return figure
