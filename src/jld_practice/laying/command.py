"""Provide `jld assembly`: order and direction in which blocks are placed, and props."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np
import typer

from jld_core import Deadline, DeadlinePassed, Ints, Layout, ParameterError, error_context, files
from jld_core.models import rigid
from jld_core.scene import units
from jld_explore.cli import layout, options, streams
from jld_explore.report import csv_of
from jld_practice.laying import Laying, assembly_order
from jld_practice.laying.freedom import Bodies, Stations, stations_below
from jld_practice.laying.order import LAID, LayingStart, order_without_stages, words_of_fall
from jld_practice.laying.standing import Parts

if TYPE_CHECKING:
    import pandas as pd

# Share of the time left, once an order by translations is known, that is kept back for table and pictures
_WRITING: Final = 0.3


def start_of_design(source: Path) -> LayingStart:
    """Return from where the stones of a design are laid as its options say; "ground" of any other source."""
    if layout.best_of_design(source) == source:
        return "ground"
    facts = json.loads((source / "summary.json").read_text(encoding="utf-8"))
    return LAID[facts.get("options", {}).get("laid", "translation")][1]


def assembly(
    context: typer.Context,
    source: options.Source,
    rank: options.Rank = None,
    wish: Annotated[
        Literal["translation", "standing"],
        typer.Option(help="Require single translations only, or that every stage stands."),
    ] = "translation",
    group: Annotated[int, typer.Option(min=1, help="Most blocks moved together, where one alone cannot.")] = 3,
    start: Annotated[
        Literal["ground", "left", "right", "springings"] | None,
        typer.Option(
            help="Where laying starts: by courses, from a side, or from all supports alike; default ground, or as a "
            "design says."
        ),
    ] = None,
    props: Annotated[
        float | None,
        typer.Option(help="Props along the underside at this horizontal distance, in the scene's length (planar)."),
    ] = None,
    stages: Annotated[bool, typer.Option("--stages", help="With --out: one picture per stage as well.")] = False,
    animation: Annotated[bool, typer.Option("--animation", help="With --out: the stages as an animated GIF.")] = False,
    seconds: Annotated[float | None, typer.Option(help="Time limit of order and pictures, s.")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for assembly.csv and pictures.")] = None,
) -> None:
    """Find an order in which the blocks of a layout can be laid, with directions and props.

    Print one row per step, or the blocks that lock one another. With --out also write assembly.csv and assembly.png.
    """
    if out is not None:
        files.require_folder(out)
    elif stages or animation:
        name = "stages" if stages else "animation"
        raise ParameterError(name, "there is no folder for the pictures", "`out` with a folder")
    if seconds is not None and not seconds > 0.0:
        raise ParameterError("seconds", f"{seconds:g} s are no time", "a number above 0")
    deadline = Deadline(seconds, context.obj)
    scene, structure, labels, model = layout.layout_of(source, rank)
    begun = start or start_of_design(source)
    sideways = scene.search.assemble_out_of_plane
    with error_context(source):
        layout.require_whole_faces(model, "an order of laying")
        structure, labels = rigid(structure, labels, "an order of laying")
        stations = None if props is None else stations_below(structure, props)
        bodies, parts = Bodies(structure, sideways), Parts(structure, stations)
        quick: Laying | None = None
        try:
            with deadline.enforced():
                if seconds is not None:  # kept for the case that solving the stages takes longer
                    quick = order_without_stages(
                        structure, labels, sideways=sideways, group=group, start=begun, bodies=bodies
                    )
            with deadline.earlier(0.0 if quick is None else _WRITING * deadline.remaining()).enforced():
                laying = assembly_order(
                    structure,
                    labels,
                    wish=wish,
                    sideways=sideways,
                    group=group,
                    start=begun,
                    bodies=bodies,
                    parts=parts,
                )
        except DeadlinePassed:
            if quick is None:
                raise ParameterError("seconds", f"no order was found in {seconds:g} s", "a longer time") from None
            laying = quick
    table = table_of(laying, Layout(scene, structure, labels).block_of + 1, stations)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        files.write_text(out / "assembly.csv", csv_of(table))
        late = _draw(laying, out, f"{scene.name}: order of laying", stages, animation, deadline)
    streams.say(words_of(laying))
    if stations is not None and laying.steps and not _unsolved(laying):
        streams.say(_words_along(laying, stations))
    if len(table):
        # the forces along a line say in short what stands below the blocks
        unsaid = ["elements"] if stations is None else ["elements", "propped"]
        streams.say(f"\n{table.drop(columns=unsaid).to_string(index=False)}")
    if out is not None:
        left_out = f"; not drawn for lack of time: {', '.join(late)}" if late else ""
        streams.say(f"\nwritten to   {out}{left_out}")


def _draw(laying: Laying, out: Path, title: str, stages: bool, animation: bool, deadline: Deadline) -> list[str]:
    """Draw an assembly sequence into a folder; return pictures left out for lack of time."""
    from jld_practice.laying.strip import figure_of_laying, save_laying_animation
    from jld_views import figures

    makes: dict[str, Callable[[Path], None]] = {
        "assembly.png": lambda path: figures.save_figure(figure_of_laying(laying, title), path)
    }
    if animation and laying.steps:
        makes["assembly.gif"] = lambda path: save_laying_animation(laying, path)
    digits = len(str(len(laying.steps)))
    for number in range(1, len(laying.steps) + 1) if stages else ():
        makes[f"stage-{number:0{digits}}.png"] = partial(_save_stage, laying, number)
    late = []
    for name, make in makes.items():
        try:
            with deadline.enforced():
                deadline.check()
                make(out / name)
        except DeadlinePassed:
            late.append(name)
    return late


def _save_stage(laying: Laying, number: int, path: Path) -> None:
    from jld_practice.laying.strip import figure_of_stage
    from jld_views import figures

    figures.save_figure(figure_of_stage(laying, number), path)


def _words_along(laying: Laying, stations: Stations) -> str:
    """Describe props along a line: number, largest force, stages that they do not hold."""
    length, force = laying.blocks.assembly.units
    forces = np.array([step.stage.along for step in laying.steps])
    step, position = (int(k) for k in np.unravel_index(int(forces.argmax()), forces.shape))
    where = ", ".join(f"{x:.4g}" for x in stations.points[position])
    count, loaded = len(stations.points), int((forces > 0.0).any(axis=0).sum())
    text = f"props along  {count} place{'s' * (count != 1)}, {loaded} of them loaded"
    if forces[step, position] > 0.0:
        largest = units.force_in_words(forces[step, position], force)
        text += f"; the largest force is {largest} at ({where}) {length}, step {step + 1}"
    beside = [k for k, step in enumerate(laying.steps, 1) if step.stage.elsewhere > 1e-5 * step.stage.weight]
    if beside:
        most = units.force_in_words(max(laying.steps[k - 1].stage.elsewhere for k in beside), force)
        text += f"\nprops beside {most} at most, first in step {beside[0]}: the places alone do not hold it"
    return text


def table_of(laying: Laying, stone_of: Ints, stations: Stations | None = None) -> pd.DataFrame:
    """Return one row per step; stone_of: (n,) number of the stone of each element, from 1."""
    import pandas as pd  # slow to import and needed for tables only

    blocks = laying.blocks
    ids, force = blocks.assembly.elements.ids, blocks.assembly.units[1]
    rows = []
    for number, step in enumerate(laying.steps, 1):
        comes = -np.asarray(step.direction) + 0.0
        stands = step.stage.stands
        propped = np.flatnonzero(step.stage.props > 0.0).tolist()
        rows.append(
            {
                "step": number,
                "stone": " + ".join(str(stone_of[blocks.elements(block)[0]]) for block in step.blocks),
                "block": " + ".join(blocks.name(block) for block in step.blocks),
                "elements": " ".join(ids[e] for block in step.blocks for e in blocks.elements(block)),
                "moves_along": "(" + ", ".join(f"{x:.4g}" for x in comes) + ")",
                "stands": "" if stands is None else "yes" if stands else "no",
                f"props_{force}": float(step.stage.props.sum()) if np.isfinite(step.stage.error) else np.nan,
                "propped": " ".join(f"{blocks.name(block)}:{step.stage.props[block]:.4g}" for block in propped),
            }
        )
        if stations is not None:
            at = stations.points[:, 0]
            loaded = np.flatnonzero(step.stage.along > 0.0).tolist()
            rows[-1]["props_along"] = " ".join(f"{at[k]:.4g}:{step.stage.along[k]:.4g}" for k in loaded)
    columns = ["step", "stone", "block", "elements", "moves_along", "stands", f"props_{force}", "propped"]
    columns += [] if stations is None else ["props_along"]
    return pd.DataFrame(rows, columns=columns)


def _unsolved(laying: Laying) -> bool:
    return bool(laying.steps) and not any(np.isfinite(step.stage.error) for step in laying.steps)


def words_of(laying: Laying) -> str:
    """Describe an order of laying, or why there is none, in one line for the terminal."""
    blocks = laying.blocks
    if laying.locked:
        names = ", ".join(blocks.name(block) for block in laying.locked)
        how = "lock one another" if len(laying.locked) > 1 else "is locked between supports"
        return f"order        none: {names} {how} (blocks named by their first elements)"
    if laying.searched:
        none = "none found" if laying.undecided else "none"
        return f"order        {none} whose every stage stands; the one below takes props\n{_first_fall(laying)}"
    free = int(np.count_nonzero(~blocks.fixed))
    steps = len(laying.steps)
    counts = f"{free} block{'s' * (free != 1)} in {steps} step{'s' * (steps != 1)}"
    if _unsolved(laying):
        return f"order        {counts}, props not known and not minimal: no time was left to solve its stages"
    if laying.stands:
        return f"order        {counts}, every stage stands without props"
    worst = max(step.stage.props.sum() for step in laying.steps)
    force = blocks.assembly.units[1]
    text = f"order        {counts}, props of {units.force_in_words(worst, force)} at most\n{_first_fall(laying)}"
    return "\n".join([text, *_centring(laying)])


def _centring(laying: Laying) -> list[str]:
    """Describe during which steps props stand; no line where none is needed."""
    # A stage that was not solved counts as one that needs props.
    needed = [number for number, step in enumerate(laying.steps, 1) if not step.stage.stands]
    if not needed:
        return []
    blocks = laying.blocks
    below = sorted({int(b) for k in needed for b in np.flatnonzero(laying.steps[k - 1].stage.props > 0.0)})
    first, last = needed[0], needed[-1]
    standing = f"centring     from step {first}, in turn below {', '.join(blocks.name(block) for block in below)}"
    if last < len(laying.steps):
        return [f"{standing}; it may be struck after step {last + 1}: no stage from there on needs it"]
    if laying.steps[-1].stage.stands is None:
        return [f"{standing}; that the finished structure stands without it is not proven"]
    return [f"{standing}; the finished structure does not stand without it"]


def _first_fall(laying: Laying) -> str:
    """Describe the first stage of an order that does not stand, and the props that it needs."""
    fall = laying.first_fall
    if fall is None:
        return "stages       none is proven to fall, some are undecided"
    return f"stages       the first that falls is {words_of_fall(laying, *fall)}"
