"""Provide `jld move`: joints whose geometry is variable."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.files import write_text
from jld_core.geometry_optimisation.box_search import ProvenBox, prove_box
from jld_core.geometry_optimisation.optimise import MovedJoints, Point, move_joints
from jld_core.geometry_optimisation.search import GeometrySearch
from jld_core.limit import Status
from jld_core.models import solve_by_fields
from jld_core.scene import Scene
from jld_explore.cli.layout import layout_of
from jld_explore.cli.options import AsJson, Rank, Source, refuse_itself
from jld_explore.cli.samples import Out, write_scene
from jld_explore.cli.shaping import move_shape
from jld_explore.cli.streams import say, warn
from jld_explore.report import csv_of

_FIELD_GAP: Final = 0.1
"""Relative width of brackets by fields, which check a gain where blocks may crack."""

_FIELD_SECONDS: Final = 10.0
"""Time for each of them, s."""

_GAP: Final = 1e-3
"""Default of the relative distance of both bounds at which a proof ends."""


def require_movable(scene: Scene, assembly: Assembly) -> None:
    """Raise InputError if the key "move" of a scene does not fit the scene's own labelling.

    A scene without the key is accepted.
    """
    if scene.move is not None:
        GeometrySearch(scene, assembly, assembly.labels)


def move(
    source: Source,
    out: Out,
    rank: Rank = None,
    seconds: Annotated[float, typer.Option(min=0.0, help="Time limit, s.")] = math.inf,
    starts: Annotated[int, typer.Option(min=1, help="Number of starts: the scene, then shaken ones.")] = 1,
    prove: Annotated[
        str | None,
        typer.Option(
            help="Prove a bound over a box of at most 4 parameters: a length, or LOW,HIGH of each from the start.",
            show_default=False,
        ),
    ] = None,
    gap: Annotated[float, typer.Option(min=1e-9, help="With --prove: relative distance of both bounds.")] = _GAP,
    joint: Annotated[
        str | None,
        typer.Option(
            help="Give joints a shape and search its best, in shares of a face: key:DEPTH,WIDTH,FLANK or "
            "sine:AMPLITUDE,WAVES.",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Move the joints of a planar layout to raise its load factor, with each step proven.

    Write the moved scene to --out, with a table and a picture of the same name beside it. --prove bounds λ over a box
    of positions instead.
    """
    _check_out(source, out)
    if joint is not None and (prove is not None or starts > 1):
        given = "prove" if prove is not None else "starts"
        raise ParameterError(given, "it moves vertices, not the shape of joints", "one without the other")
    scene, assembly, labels = layout_of(source, rank)

    def progress(point: Point) -> None:
        """Print an accepted point."""
        if not as_json:
            say(f"start {point.start} step {point.step:<3} {point.value:<14.8g} {point.seconds:.1f} s")

    with error_context(source, str(out)):
        if prove is not None:
            _prove(scene, assembly, labels, prove, gap, seconds, out, as_json)
            return
        if joint is not None:
            move_shape(scene, assembly, labels, joint, seconds, out, as_json)
            return
        done = move_joints(scene, assembly, labels, seconds=seconds, starts=starts, progress=progress)
    facts = _facts(done)
    checked = _check_by_fields(assembly, done, labels)
    facts["fields"], facts["warnings"] = checked, [*done.warnings, *_doubts(checked)]
    table = [vars(point) | {"bracket_lo": point.bracket[0], "bracket_hi": point.bracket[1]} for point in done.points]
    after = None if done.after is None else done.after.assembly
    sign = {"load_factor": "λ", "least_friction": "μ", "least_thickness": "thickness"}[done.objective]
    titles = (f"before: {sign} = {_value(facts['start'])}", f"after: {sign} = {_value(facts['value'])}")
    _write(done.scene, table, assembly, after, labels, done.places, done.moved, titles, out)
    for sentence in facts["warnings"]:
        warn(f"jld: warning: {sentence}")
    say(json.dumps(facts, indent=1) if as_json else _words(facts, out))


def _check_out(source: Path, out: Path) -> None:
    """Raise InputError for a file that cannot be written, before any work."""
    if out.suffix in (".csv", ".png"):
        raise ParameterError("out", f"{out.name!r} is the name of a table or picture", "the name of a scene file")
    if out.is_dir() or not out.absolute().parent.is_dir():
        problem = "it is a folder" if out.is_dir() else "its folder does not exist"
        raise InputError(str(out), problem, "a file in a folder that is there")
    refuse_itself(source, out)


def _prove(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    box: str,
    gap: float,
    seconds: float,
    out: Path,
    as_json: bool,
) -> None:
    """Prove a bound over a box, write the best scene and print both bounds."""

    def progress(best: float, bound: float, boxes: int) -> None:
        """Print the bounds now and then."""
        if not as_json and boxes & (boxes - 1) == 0:
            say(f"{boxes:>6} boxes  {_value(best)} ≤ λ ≤ {_value(bound)}")

    done = prove_box(scene, assembly, labels, _box(box), gap=gap, seconds=seconds, progress=progress)
    facts = _proof_facts(done)
    row = {"start": 0, "step": 0, "value": done.load_factor, "bracket_lo": done.load_factor, "bracket_hi": done.bound}
    titles = (f"before: {_value(facts['start'])}", f"best in the box: {_value(facts['load_factor'])}")
    _write(done.scene, [row], assembly, done.after.assembly, labels, done.places, done.moved, titles, out)
    if as_json:
        say(json.dumps(facts, indent=1))
        return
    what = "proven" if done.proven else "not proven"
    say(f"λ {_value(done.load_factor)} found, {_value(done.bound)} at most, gap {done.gap:.2g}: {what}")
    say(f"{done.boxes} boxes, {done.seconds:.1f} s, written to {out}")


def _box(text: str) -> float | tuple[Floats, Floats]:
    """Return a length, or the ends (p,), (p,) of a box; raise InputError for anything else."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not np.isfinite(numbers).all() or (len(numbers) > 1 and len(numbers) % 2):
        raise ParameterError("prove", f"{text!r} is no box", "a length, or LOW,HIGH for each parameter")
    if len(numbers) == 1:
        return numbers[0]
    return np.array(numbers[0::2]), np.array(numbers[1::2])


def _check_by_fields(assembly: Assembly, done: MovedJoints, labels: Bits) -> dict[str, Any] | None:
    """Return lower bounds on λ by fields before and after, with blocks that crack anywhere.

    None without inner faces, and where nothing moved.

    λ by faces may be false where blocks moved away from their crack planes.
    """
    if labels.all() or done.after is None or not done.moved.any():
        return None
    found: dict[str, Any] = {"before": None, "after": None, "skipped": None}
    try:
        for name, one in (("before", assembly), ("after", done.after.assembly)):
            low = solve_by_fields(one, labels, gap=_FIELD_GAP, seconds=_FIELD_SECONDS).governing.low
            found[name] = _number(low)
    except InputError as error:
        found["skipped"] = f"{error.where}: {error.problem}"
    return found


def _doubts(checked: dict[str, Any] | None) -> list[str]:
    """Return the warnings of a check by fields."""
    if checked is None:
        return []
    if checked["skipped"] is not None:
        return [f"λ is that of the crack planes drawn; no check by fields ({checked['skipped']})"]
    before, after = (checked[name] for name in ("before", "after"))
    if before is not None and after is not None and after > before:
        return []
    said = " to ".join("none" if value is None else f"{value:.6g}" for value in (before, after))
    return [f"blocks that crack anywhere gain nothing: lower bounds by fields from {said}"]


def _number(value: float) -> float | None:
    """Return a float for JSON, None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def _facts(done: MovedJoints) -> dict[str, Any]:
    """Return the object that `jld move --json` prints."""
    after = done.after
    load_factor = math.nan if after is None else after.load_factor
    bracket = (math.nan, math.nan) if after is None else after.bracket
    return {
        "name": done.scene.name,
        "objective": done.objective,
        "load_factor": _number(load_factor),
        "bracket": [_number(end) for end in bracket],
        "status": None if after is None else str(after.status),
        "start": _number(done.start),
        "value": _number(done.value),
        "steps": len(done.points) - len({point.start for point in done.points}),
        "solves": done.points[-1].solves if done.points else 0,
        "end": done.end,
        "parameters": done.parameters,
        "largest_move": float(np.linalg.norm(done.moved, axis=1).max(initial=0.0)),
        "seconds": done.points[-1].seconds if done.points else 0.0,
        "warnings": done.warnings,
    }


def _proof_facts(done: ProvenBox) -> dict[str, Any]:
    """Return the object that `jld move --prove --json` prints."""
    start = done.before.load_factor if done.before.status is Status.COLLAPSE else math.nan
    return {
        "name": done.scene.name,
        "objective": "load_factor",
        "load_factor": _number(done.load_factor),
        "bracket": [_number(end) for end in done.after.bracket],
        "status": str(done.after.status),
        "start": _number(start),
        "steps": done.boxes,
        "bound": _number(done.bound),
        "proven": done.proven,
        "gap": _number(done.gap),
        "boxes": done.boxes,
        "box": [[float(low), float(high)] for low, high in zip(done.low, done.high, strict=True)],
        "parameters": [float(value) for value in done.parameters],
        "seconds": done.seconds,
    }


def _value(value: float | None) -> str:
    """Return a number in words."""
    return "none" if value is None or math.isnan(value) else "locked" if value == math.inf else f"{value:.6g}"


def _write(
    scene: Scene,
    table: list[dict[str, Any]],
    before: Assembly,
    after: Assembly | None,
    labels: Bits,
    places: Floats,
    moved: Floats,
    titles: tuple[str, str],
    out: Path,
) -> None:
    """Write scene, table and picture beside one another."""
    import pandas as pd  # slow to import and needed for tables only

    names = ["start", "step", "value", "bracket_lo", "bracket_hi", "predicted", "radius", "solves", "seconds"]
    rows = pd.DataFrame(table)
    write_scene(scene, out)
    write_text(out.with_suffix(".csv"), csv_of(rows[[name for name in names if name in rows]]))
    if after is None:
        return
    from jld_core.views.figures import save_figure
    from jld_core.views.moved_joints import figure_of_move

    save_figure(figure_of_move(before, after, labels, places, moved, titles), out.with_suffix(".png"))


def _crack_words(checked: dict[str, Any] | None) -> dict[str, str]:
    """Return the line of a check by fields."""
    if checked is None or checked["skipped"] is not None:
        return {}
    return {"by fields": f"λ ≥ {_value(checked['before'])} before, λ ≥ {_value(checked['after'])} after"}


def _words(facts: dict[str, Any], out: Path) -> str:
    """Describe the result of a move for the terminal."""
    ends = {
        "stationary": "stationary: no small movement raises it (a local statement; try --starts)",
        "locked": 'locked: no live load is too large; limit "block_mass", "angle" or "box"',
        "time": "time limit",
        "points": "limit on points",
    }
    lines = {
        "objective": facts["objective"].replace("_", " "),
        "start": _value(facts["start"]) if facts["start"] is not None else "does not stand",
        "end": _value(facts["value"]) if facts["end"] != "locked" else "locked",
        "bracket": "[" + ", ".join("unproven" if end is None else f"{end:.9g}" for end in facts["bracket"]) + "]",
        "ended": ends[facts["end"]],
        **_crack_words(facts["fields"]),
        "effort": f"{facts['steps']} steps, {facts['solves']} proven solves, {facts['parameters']} parameters",
        "written to": f"{out}, {out.with_suffix('.csv').name}, {out.with_suffix('.png').name}",
    }
    return "\n".join(f"{name:<12} {value}" for name, value in lines.items())
