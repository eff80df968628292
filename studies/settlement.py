"""A semicircular arch on abutments that give way: thrust between its least and its greatest, against statics.

Source: closed forms by moments about hinges (Heyman 1969, The safety of masonry arches, Int. J. Mech. Sci. 11), weight
along the centreline; least thickness at which both meet, t/R = 0.107426: Cocchetti & Rizzi 2020, Table 3.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import build_assembly
from jld_core.build.loads import Settlement
from jld_practice.reactions import Settled, settle
from jld_practice.reactions.thrust import Thrust
from jld_practice.reactions.thrust_command import without_live_load
from jld_views.figures import draw_forces, draw_mechanism
from studies.families import semicircular_arch
from studies.report import GREY, PAIRED, Report, axes_at, figure_of, name_axes, without_legend, write

NAME: Final = "settlement"
LEAST_THICKNESS: Final = 0.107426
"""t/R at which one thrust only is left, hinges alone (Cocchetti & Rizzi 2020, Table 3)."""


def closed_form(thickness: float, sign: float) -> float:
    """Least (sign 1) or greatest (−1) thrust over the weight of half a ring of endlessly many voussoirs, R = 1."""
    above, below = 1.0 + sign * thickness / 2.0, 1.0 - sign * thickness / 2.0
    centre, reach = np.array([0.65, 0.8]), np.array([0.65, 0.78])
    found = np.nan
    for _ in range(7):
        # a grid of both hinges, then finer ones about the best
        low, high = (np.clip(centre + side * reach, 0.0, np.pi / 2.0) for side in (-1.0, 1.0))
        sides = [np.linspace(low[k], high[k], 61) for k in range(2)]
        upper, lower = np.meshgrid(sides[0], sides[1], indexing="ij")
        x1, y1, x2, y2 = above * np.sin(upper), above * np.cos(upper), below * np.sin(lower), below * np.cos(lower)
        moment = x2 * (lower - upper) - (np.cos(upper) - np.cos(lower)) + upper * (x2 - x1)
        sound = (lower > upper + 1e-6) & (y1 > y2 + 1e-9)
        value = np.where(sound, sign * moment / np.where(sound, y1 - y2, 1.0) / (np.pi / 2.0), -np.inf)
        at = np.unravel_index(int(np.argmax(value)), value.shape)
        found, centre, reach = float(sign * value[at]), np.array([upper[at], lower[at]]), reach / 12.0
    return found


def spread(count: int, thickness: float, friction: float = 0.9) -> Settled:
    """The arch on abutments of which each gives way by a half."""
    live = [{"element": "v0", "force": [0, -1]}]
    assembly = build_assembly(semicircular_arch(count, thickness, friction, live))
    velocity = np.zeros((len(assembly.elements), 3))
    velocity[assembly.elements.index["left"], 0] = -0.5
    velocity[assembly.elements.index["right"], 0] = 0.5
    return settle(assembly, Settlement("spread", velocity))


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Solve all thicknesses, write table, picture and page into a folder; returns the table."""
    count = 60 if coarse else 240
    thicknesses = (0.12, 0.2) if coarse else (0.1085, 0.11, 0.113, 0.117, 0.12, 0.13, 0.14, 0.16, 0.18, 0.2, 0.25, 0.3)
    rows = []
    for thickness in thicknesses:
        found = spread(count, thickness)
        half = 0.5 * found.assembly.total_dead
        for name, end, sign in (("least", found.least, 1.0), ("greatest", found.most, -1.0)):
            assert end is not None
            rows.append(
                {
                    "voussoirs": count,
                    "thickness": thickness,
                    "end": name,
                    "thrust": end.value / half,
                    "closed_form": closed_form(thickness, sign),
                    "gap": end.gap,
                    "status": end.status,
                }
            )
    table = pd.DataFrame(rows)
    table["error"] = table["thrust"] / table["closed_form"] - 1.0
    worst = float(table["error"].abs().max())
    shown = without_live_load(spread(24, 0.16))
    assert shown.least is not None
    assert shown.most is not None
    half = 0.5 * shown.assembly.total_dead
    report = Report(
        name=NAME,
        title="Semicircular arch on abutments that give way",
        question="How much thrust is left when the abutments spread, how much can they be pushed with, and how does "
        "the arch follow?",
        source="Closed forms by moments about hinges, after Heyman 1969; least thickness 0.107426 from Cocchetti & "
        "Rizzi 2020, Table 3.",
        model=f"{count} equal voussoirs, dry joints, μ = 0.9, weight along the centreline; each abutment gives way by "
        "a half, so that the reaction along the movement is the thrust H. W is the weight of half the ring.",
        agrees=(
            f"Least and greatest thrust agree with the closed form of the endless ring within {worst:.1e} at {count} "
            "voussoirs; the fewer joints, the less the least falls.",
            f"At t/R = 0.16 and 24 voussoirs H lies between {shown.least.value / half:.4f} W and "
            f"{shown.most.value / half:.4f} W: spreading abutments cannot rid the arch of its thrust.",
            "Both ends meet where the arch can stand in one way only, at the published least thickness.",
            f"Every end is certified by two bounds of our own (gap at most {table['gap'].max():.0e}).",
        ),
        differs=(
            "The movement is a direction, not a distance: geometry is that before any movement, so how far abutments "
            "may spread until the arch falls is not computed.",
        ),
        pictures={
            "": "Left: thrust against thickness, computed and in closed form. Right: the arch of 24 voussoirs at its "
            "least thrust, the mechanism that follows the abutments, and its greatest thrust."
        },
    )
    write(out, report, table, {"": _picture(table, shown, half)})
    return table


def _picture(table: pd.DataFrame, shown: Settled, half: float) -> Figure:
    figure = figure_of(13.2, 7.6)
    ax = axes_at(figure, 0.8, 0.9, 5.2, 5.9)
    _range(ax, table)
    _state(axes_at(figure, 6.9, 4.35, 2.9, 2.5), shown.least, half, "least thrust")
    _state(axes_at(figure, 10.1, 4.35, 2.9, 2.5), shown.most, half, "greatest thrust")
    ax = axes_at(figure, 7.6, 0.6, 4.6, 3.2)
    assert shown.least is not None
    assert shown.least.state is not None
    draw_mechanism(ax, shown.least.state)
    without_legend(ax, "abutments spread: the crown sinks between hinges")
    for axis in figure.axes[1:]:
        name_axes(axis, "x/R [–]", "" if axis is figure.axes[2] else "y/R [–]")
    figure.suptitle("Semicircular arch on abutments that give way", fontsize=12, y=0.985)
    return figure


def _state(ax: Axes, end: Thrust | None, half: float, name: str) -> None:
    assert end is not None
    assert end.state is not None
    draw_forces(ax, end.state)
    without_legend(ax, f"{name}: H = {end.value / half:.4f} W")


def _range(ax: Axes, table: pd.DataFrame) -> None:
    dense = np.linspace(LEAST_THICKNESS + 2e-4, float(table["thickness"].max()), 40)
    ends: list[Any] = [[closed_form(t, sign) for t in dense] for sign in (1.0, -1.0)]
    ax.fill_between(dense, *ends, color="#DCE8F4", lw=0, label="thrusts in equilibrium")
    for name, look, line in zip(("least", "greatest"), PAIRED, ends, strict=False):
        colour, dash, marker = look
        ax.plot(dense, line, color=colour, ls=dash, lw=1.3, label=f"{name}, closed form")
        own = table[table["end"] == name]
        ax.plot(own["thickness"], own["thrust"], marker, color=colour, ms=5.0, label=f"{name}, computed")
    ax.axvline(
        LEAST_THICKNESS, color=GREY, lw=1.0, ls=(0, (4, 2)), label=f"{LEAST_THICKNESS}: least thickness, published"
    )
    name_axes(ax, "thickness t/R [–]", "thrust over weight of half the ring, H/W [–]")
    ax.legend(frameon=False, fontsize=8, loc="upper left")
