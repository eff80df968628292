"""Provide `jld thrust` and `jld settlement`: ranges of forces, and movements of supports."""

from __future__ import annotations

import json
import math
import re
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Assembly, InputError, ParameterError, error_context, files
from jld_core.build import loads as built
from jld_core.models import rigid
from jld_explore.cli import ending, layout, options, streams
from jld_practice.reactions import Settled
from jld_practice.reactions.thrust import (
    Resultant,
    ResultantRange,
    Thrust,
    ThrustRanges,
    reactions_of_supports,
    resultant_of_joint,
    resultant_of_section,
    settle,
    thrust_ranges,
    words_of_range,
)
from jld_views import figures, look, structure


def thrust(
    source: Annotated[Path, typer.Argument(help="A scene file, or a folder written by jld explore.")],
    rank: options.Rank = None,
    load_factor: Annotated[float, typer.Option(help="Factor of the live load that acts beside the dead load.")] = 0.0,
    support: Annotated[
        list[str] | None, typer.Option(help="Name of a support; repeat it for several. Default: all that bear.")
    ] = None,
    joint: Annotated[
        list[str] | None, typer.Option(help="Two elements that touch, as A,B: forces that A puts on B.")
    ] = None,
    section: Annotated[
        list[str] | None,
        typer.Option(help="A line along faces, as X,Y,X,Y in the scene's unit: forces on the part to its left."),
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for thrust.json and pictures.")] = None,
    as_json: options.AsJson = False,
) -> None:
    """Bracket the least and the greatest reaction of supports, or forces across joints.

    Every state in equilibrium with the load that friction and strengths allow has its reactions in these intervals.
    The exit code is 4 if an end stays uncertified.
    """
    if out is not None:
        files.require_folder(out)
    scene, assembly, labels, model = layout.layout_of(source, rank)
    with error_context(source):
        layout.require_whole_faces(model, "a range of reactions")
        assembly, labels = rigid(assembly, labels, "a range of reactions")
        resultants = _resultants(assembly, support, joint, section)
        names: list[str | None] = [case.name for case in assembly.cases] or [None]
        ranges = [
            thrust_ranges(case, labels, resultants=resultants, load_factor=load_factor) for case in assembly.by_case
        ]
    facts: dict[str, Any] = {
        "name": scene.name,
        "units": dict(zip(("length", "force"), assembly.units, strict=True)),
        "cases": [{"case": name, **of_case.to_json()} for name, of_case in zip(names, ranges, strict=True)],
    }
    if len(ranges) == 1:
        facts |= ranges[0].to_json()
    if out is not None:
        _write(ranges, json.dumps(facts, indent=1), out)
    streams.say(json.dumps(facts, indent=1) if as_json else "\n\n".join(map(_words, ranges)))
    if any("uncertified" in (part.least.status, part.most.status) for of_case in ranges for part in of_case.ranges):
        raise typer.Exit(ending.UNCERTIFIED)


def _resultants(
    assembly: Assembly, support: list[str] | None, joint: list[str] | None, section: list[str] | None
) -> tuple[Resultant, ...]:
    """Return the resultants that the options name; those of all supports if they name none."""
    resultants: tuple[Resultant, ...] = ()
    if support or not (joint or section):
        resultants += reactions_of_supports(assembly, support or None)
    for text in joint or []:
        names = [part.strip() for part in text.split(",")]
        if len(names) != 2:
            raise ParameterError("joint", f"{text!r} is not a pair", "names of two elements, as A,B")
        resultants += resultant_of_joint(assembly, names[0], names[1])
    for text in section or []:
        try:
            numbers = [float(part) for part in text.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) != 4 or not all(abs(number) < float("inf") for number in numbers):
            raise ParameterError("section", f"{text!r} is not a line", "two points, as X,Y,X,Y")
        resultants += resultant_of_section(assembly, numbers[:2], numbers[2:])
    return resultants


def _words(ranges: ThrustRanges) -> str:
    load = f"{ranges.load_factor:g} × the live load" if ranges.load_factor else "the dead load alone"
    if ranges.stands is False:
        return f"{ranges.assembly.name}: falls under {load}, proven"
    length, force = ranges.assembly.units
    lines, support = [f"{ranges.assembly.name}: under {load}"], ""
    for range_ in ranges.ranges:
        resultant = range_.resultant
        if resultant.place != support:
            support = resultant.place
            digits = 6 - math.floor(math.log10(ranges.assembly.size))
            point = ", ".join(f"{round(x, digits) + 0.0:.6g}" for x in resultant.point.tolist())
            lines.append(f"  {support} (moments about {point})")
        lines.append(f"    {words_of_range(range_, force, length)}")
    return "\n".join(lines)


def _write(ranges: list[ThrustRanges], text: str, out: Path) -> None:
    """Write thrust.json and one picture per resultant and load case."""
    from jld_views import figures

    out.mkdir(parents=True, exist_ok=True)
    files.write_text(out / "thrust.json", text)
    number = 0
    for range_ in ranges:
        for part in range_.ranges:
            number += 1
            name = re.sub(r"[^\w-]+", "_", f"{part.resultant.place}_{part.resultant.component}")[:50]
            figures.save_figure(figure_of_range(range_, part), out / f"thrust-{number}-{name}.png")


def settlement(
    source: Annotated[
        Path,
        typer.Argument(help='A scene file with "settlements", or a folder written by jld explore.', show_default=False),
    ],
    rank: options.Rank = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for settlement.json and pictures.")] = None,
    as_json: options.AsJson = False,
) -> None:
    """Bracket the thrust along each movement of supports that a scene names.

    The output has the least and the greatest thrust, with the mechanisms at these ends. The exit code is 4 if an end
    stays uncertified.
    """
    if out is not None:
        files.require_folder(out)
    scene, assembly, labels, model = layout.layout_of(source, rank)
    if not scene.settlements:
        raise InputError(f"{source}: settlements", "the scene has none", "a list of movements of supports")
    with error_context(source):
        layout.require_whole_faces(model, "a movement of supports")
        assembly, labels = rigid(assembly, labels, "a movement of supports")
        settled = [settle(assembly, movement, labels) for movement in built.settlements_of(scene, assembly)]
    facts = {"name": scene.name, "settlements": [movement.to_json() for movement in settled]}
    if out is not None:
        _write_settlement(settled, json.dumps(facts, indent=1), out)
    streams.say(json.dumps(facts, indent=1) if as_json else "\n".join(map(_settlement_words, settled)))
    ends = [end for movement in settled for end in (movement.least, movement.most) if end is not None]
    if any(end.status == "uncertified" for end in ends):
        raise typer.Exit(ending.UNCERTIFIED)


def _settlement_words(settled: Settled) -> str:
    if settled.stands is False:
        return f"{settled.settlement.name}: it falls under its dead load alone"
    force = settled.assembly.units[1]
    return (
        f"{settled.settlement.name}\n"
        f"  least reaction    {words_of(settled.least, force)}\n"
        f"  greatest reaction {words_of(settled.most, force)}"
    )


def _write_settlement(settled: list[Settled], text: str, out: Path) -> None:
    from jld_views import figures

    out.mkdir(parents=True, exist_ok=True)
    files.write_text(out / "settlement.json", text)
    for number, movement in enumerate(settled, 1):
        name = re.sub(r"[^\w-]+", "_", movement.settlement.name)[:40]
        figures.save_figure(figure_of_settled(movement), out / f"settlement-{number}-{name}.png")


def figure_of_range(ranges: ThrustRanges, range_: ResultantRange) -> Figure:
    """Return a figure of one range: forces at its least and at its greatest value."""
    figure, axes = figures.figure_for(ranges.assembly, 2)
    moment = range_.resultant.component.startswith("M")
    length, force = ranges.assembly.units
    unit = f"{force}·{length}" if moment else force
    for ax, end, name in zip(axes, (range_.least, range_.most), ("least", "greatest"), strict=True):
        if end.state is None:
            figures.draw_assembly(ax, ranges.assembly, ranges.labels)
        else:
            state = end.state
            if not ranges.load_factor:
                bare = replace(state.assembly, live_loads=0.0 * state.assembly.live_loads)
                state = replace(state, assembly=bare)
            figures.draw_forces(ax, state)
        value = {"unbounded": "unbounded", "uncertified": "uncertified"}.get(end.status, f"{end.value:.5g} {unit}")
        ax.set_title(f"{name} {range_.resultant.component}: {value}", fontsize=10)
    name = textwrap.shorten(ranges.assembly.name, 60, placeholder=" …")
    load = f" under {ranges.load_factor:g} × the live load" if ranges.load_factor else " under its dead load"
    figures.finish(figure, axes, f"{name}: {range_.resultant.place}{load}")
    return figure


def figure_of_settled(settled: Settled) -> Figure:
    """Return a figure of a settlement: forces at both ends of the range, and the mechanism."""
    # The axes show, from left to right, forces at the least reaction, the mechanism there, and forces at the greatest.
    # The title says where the structure falls under its dead load alone.
    if not settled.settlement.load:
        settled = without_live_load(settled)
    figure, axes = figures.figure_for(settled.assembly, 3)
    force = settled.assembly.units[1]
    draw_thrust(axes[0], settled, settled.least, f"Least reaction {words_of(settled.least, force)}")
    if settled.least is not None and settled.least.state is not None:
        figures.draw_mechanism(axes[1], settled.least.state)
        axes[1].set_title("Mechanism that follows the supports", fontsize=10)
    else:
        draw_thrust(axes[1], settled, None, "no mechanism")
    draw_thrust(axes[2], settled, settled.most, f"Greatest reaction {words_of(settled.most, force)}")
    name = textwrap.shorten(settled.assembly.name, 60, placeholder=" …")
    remark = "" if settled.stands is not False else "\nit falls under its dead load alone"
    figures.finish(figure, axes, f"{name}: {settled.settlement.name}{remark}")
    return figure


def without_live_load(settled: Settled) -> Settled:
    """Return a copy of a settlement result without live loads, so that figures show none."""
    bare = replace(settled.assembly, live_loads=0.0 * settled.assembly.live_loads)

    def stripped(end: Thrust | None) -> Thrust | None:
        return end if end is None or end.state is None else replace(end, state=replace(end.state, assembly=bare))

    return replace(settled, assembly=bare, least=stripped(settled.least), most=stripped(settled.most))


def draw_thrust(ax: Axes, settled: Settled, end: Thrust | None, title: str) -> None:
    """Draw the forces at one end of the reaction's range, and the movement of the supports."""
    if end is None or end.state is None:
        figures.draw_assembly(ax, settled.assembly, settled.labels)

    else:
        figures.draw_forces(ax, end.state)
    draw_movement(ax, settled)
    ax.set_title(title, fontsize=10)


def draw_movement(ax: Axes, settled: Settled) -> None:
    """Draw an arrow at each translating support, along its movement."""
    assembly, velocity = settled.assembly, settled.settlement.velocity
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
