"""Figures of a range of reactions: the states of equilibrium at both ends."""

from __future__ import annotations

import textwrap
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_practice.reactions import Settled
from jld_practice.reactions.force_range import Thrust
from jld_practice.reactions.thrust import ResultantRange, ThrustRanges
from jld_views import figures, look, structure


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


def figure_of_settled(found: Settled) -> Figure:
    """Return a figure of a settlement: forces at both ends of the range, and the mechanism."""
    # The axes show, from left to right, forces at the least reaction, the mechanism there, and forces at the greatest.
    # The title says where the structure falls under its dead load alone.
    if not found.settlement.load:
        found = without_live_load(found)
    figure, axes = figures.figure_for(found.assembly, 3)
    force = found.assembly.units[1]
    draw_thrust(axes[0], found, found.least, f"Least reaction {words_of(found.least, force)}")
    if found.least is not None and found.least.state is not None:
        figures.draw_mechanism(axes[1], found.least.state)
        axes[1].set_title("Mechanism that follows the supports", fontsize=10)
    else:
        draw_thrust(axes[1], found, None, "no mechanism")
    draw_thrust(axes[2], found, found.most, f"Greatest reaction {words_of(found.most, force)}")
    name = textwrap.shorten(found.assembly.name, 60, placeholder=" …")
    what = "" if found.stands is not False else "\nit falls under its dead load alone"
    figures.finish(figure, axes, f"{name}: {found.settlement.name}{what}")
    return figure


def without_live_load(found: Settled) -> Settled:
    """Return a copy of a settlement result without live loads, so that figures show none."""
    bare = replace(found.assembly, live_loads=0.0 * found.assembly.live_loads)

    def stripped(end: Thrust | None) -> Thrust | None:
        return end if end is None or end.state is None else replace(end, state=replace(end.state, assembly=bare))

    return replace(found, assembly=bare, least=stripped(found.least), most=stripped(found.most))


def draw_thrust(ax: Axes, found: Settled, end: Thrust | None, title: str) -> None:
    """Draw the forces at one end of the reaction's range, and the movement of the supports."""
    if end is None or end.state is None:
        figures.draw_assembly(ax, found.assembly, found.labels)

    else:
        figures.draw_forces(ax, end.state)
    draw_movement(ax, found)
    ax.set_title(title, fontsize=10)


def draw_movement(ax: Axes, found: Settled) -> None:
    """Draw an arrow at each translating support, along its movement."""
    assembly, velocity = found.assembly, found.settlement.velocity
    d, projection = assembly.dimension, structure.projection_of(assembly)
    size = float(np.linalg.norm(velocity[:, :d], axis=1).max())
    for k in np.flatnonzero(velocity[:, :d].any(axis=1) & (size > 0.0)).tolist():
        start = projection(assembly.elements.centroid[[k]])[0]
        along = 0.12 * assembly.size / size * projection(velocity[[k], :d])[0]
        ax.annotate(
            "", start + along, start, zorder=6.0,
            arrowprops={"arrowstyle": "-|>", "color": look.FRONT, "linewidth": 2.2, "mutation_scale": 15.0},
        )  # fmt: skip


def words_of(end: Thrust | None, force: str) -> str:
    """Describe the least or greatest reaction with its unit."""
    if end is None:
        return "none"
    if end.status == "unbounded":
        return "unbounded: confined, no movement against it"
    return f"{end.value:.5g} {force}" + ("" if end.status == "certified" else ", uncertified")
