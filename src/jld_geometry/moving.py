"""Provide `jld move`: joints whose geometry is variable."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_robust
from jld_core.deadline import Deadline
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.models import solve_by_fields, solve_rigid
from jld_core.scene import Scene
from jld_core.scene.cracks import CellCracks, FieldCracks
from jld_explore.cli.cracks import Cracks, with_cracks
from jld_explore.cli.layout import layout_of, require_whole_faces
from jld_explore.cli.options import AsJson, Rank, Source, refuse_itself
from jld_explore.cli.samples import Out, write_scene
from jld_explore.cli.streams import say, warn
from jld_explore.search.state import Interrupted
from jld_geometry.field_search import move_by_fields
from jld_geometry.move_output import json_number, value_text, write_move
from jld_geometry.optimise import MovedJoints, move_joints
from jld_geometry.proving_boxes import prove_positions
from jld_geometry.search import GeometrySearch, Point
from jld_geometry.shaping import move_shape

_FIELD_GAP: Final = 0.1  # relative width of brackets by fields, which check a gain where blocks may crack

_FIELD_SECONDS: Final = 10.0  # time for each of them, s

_CHECKING: Final = 0.2  # share of a time limit for the check by fields

_LEAST_CHECK: Final = 0.5  # shortest time in which the check by fields is begun, s

_WRITING: Final = 1.0  # processor time for table and picture, kept back from a time limit, s

_BUSY: Final = 3.0  # largest factor by which a busy machine prolongs it

_GAP: Final = 1e-3  # default of the relative distance of both bounds at which a proof ends


def require_movable(scene: Scene, assembly: Assembly) -> None:
    """Raise InputError if the key "move" of a scene does not fit the scene's own labelling.

    A scene without the key is accepted.
    """
    if scene.move is not None:
        GeometrySearch(scene, assembly, assembly.labels)


def move(
    context: typer.Context,
    source: Source,
    out: Out,
    rank: Rank = None,
    seconds: Annotated[float, typer.Option(min=0.0, help="Time limit, s.")] = math.inf,
    starts: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Starts: the scene as drawn, then disturbed copies. Default: as many as --seconds allows, else 1.",
            show_default=False,
        ),
    ] = None,
    prove: Annotated[
        str | None,
        typer.Option(
            help="Prove a bound over a box of at most 4 parameters: a length, or LOW,HIGH of each from the start.",
            show_default=False,
        ),
    ] = None,
    gap: Annotated[float, typer.Option(min=1e-9, help="With --prove: relative distance of both bounds.")] = _GAP,
    certificate: Annotated[
        Path | None, typer.Option(help="With --prove: file for the proof, which jld verify checks.", show_default=False)
    ] = None,
    joint: Annotated[
        str | None,
        typer.Option(
            help="Give joints a shape and search its best: key:DEPTH,WIDTH,FLANK or sine:AMPLITUDE,WAVES in shares "
            "of a face, or incline:SLOPE, the tangent of the angle by which joints turn.",
            show_default=False,
        ),
    ] = None,
    direction: Annotated[
        str | None,
        typer.Option(
            help="With --joint in space: X,Y,Z of the direction along which shapes run unchanged, in any unit.",
            show_default=False,
        ),
    ] = None,
    robust: Annotated[bool, typer.Option("--robust", help="Raise λ at the low values of materials.")] = False,
    cracks: Cracks = None,
    as_json: AsJson = False,
) -> None:
    """Move the joints of a layout to raise its load factor, with each step proven.

    Write the moved scene to --out, with a table and a picture of the same name beside it. After a signal they hold the
    best so far. --prove bounds λ over a box of positions instead.
    """
    deadline = Deadline(None if seconds == math.inf else seconds, context.obj)
    _check_out(source, out)
    if certificate is not None:
        _check_certificate(source, out, certificate, prove)
    if joint is not None and (prove is not None or (starts or 1) > 1):
        given = "prove" if prove is not None else "starts"
        raise ParameterError(given, "it applies to moved vertices, not to shaped joints", "one without the other")
    if direction is not None and joint is None:
        raise ParameterError("direction", "it is that of shaped joints, and none are asked for", "it with `joint`")
    if robust and (joint is not None or prove is not None):
        given = "joint" if joint is not None else "prove"
        raise ParameterError(given, "it supports nominal values of materials only", "one without `robust`")
    scene, assembly, labels, model = layout_of(source, rank)
    scene = with_cracks(scene, cracks)
    by_fields = isinstance(scene.cracks, FieldCracks)
    with error_context(source):
        require_whole_faces(model, "a move of joints")
        if isinstance(scene.cracks, CellCracks) and prove is None:
            raise InputError("cracks", "joints do not move where blocks crack by cells", '"faces" or "fields"')
    assembly = replace(assembly, cracks=scene.cracks)
    if by_fields and robust:
        raise ParameterError("robust", "cracks by fields take one value of each strength", "cracks by faces")
    if robust and not assembly.has_low_values:
        with error_context(source):
            assembly = build_robust(scene)

    def progress(point: Point) -> None:
        """Print an accepted point."""
        if not as_json:
            say(f"start {point.start} step {point.step:<3} {point.value:<14.8g} {point.seconds:.1f} s")

    with error_context(source, str(out)):
        if prove is not None:
            prove_positions(scene, assembly, labels, prove, gap, deadline.remaining(), out, certificate, as_json)
            return
        if joint is not None:
            move_shape(scene, assembly, labels, joint, direction, deadline.remaining(), out, as_json)
            return
        mover = move_by_fields if by_fields else move_joints
        # writing takes longer on a busy machine, by the ratio of wall-clock to processor time so far
        busy = min(max(1.0, deadline.elapsed() / time.process_time()), _BUSY)
        until = deadline.earlier(busy * _WRITING)
        time_to_move = (1.0 - _CHECKING) * until.remaining()
        done = mover(scene, assembly, labels, seconds=time_to_move, starts=starts, progress=progress)
    # a signal in the checks leaves the scene
    write_scene(done.scene, out)
    stopped = done.end == "interrupted"
    try:
        _finish(done, assembly, labels, until, out, as_json, by_fields=by_fields)
    except KeyboardInterrupt:
        stopped = True
    if stopped:
        stop = Interrupted()
        stop.words = f"stopped; the best so far is in {out}"
        raise stop


def _finish(
    done: MovedJoints,
    assembly: Assembly,
    labels: Bits,
    until: Deadline,
    out: Path,
    as_json: bool,
    *,
    by_fields: bool,
) -> None:
    """Check a move by fields, write table and picture, and print the result.

    labels: (m,) True = dry.
    """
    facts = _facts(done)
    if assembly.has_low_values and done.after is not None:
        nominal = solve_rigid(done.after.assembly.at_nominal, labels).load_factor
        facts["load_factor_nominal"] = json_number(nominal)
    check = _bounded if by_fields else _check_by_fields
    checked = check(facts, assembly, done, labels, until)
    facts["fields"], facts["warnings"] = checked, [*done.warnings, *_doubts(checked)]
    table = [vars(point) | {"bracket_lo": point.bracket[0], "bracket_hi": point.bracket[1]} for point in done.points]
    after = None if done.after is None else done.after.assembly
    sign = {"load_factor": "λ", "least_friction": "μ", "least_thickness": "thickness"}[done.objective]
    relation = f"{sign} ≥" if by_fields else f"{sign} ="
    titles = (f"before: {relation} {value_text(facts['start'])}", f"after: {relation} {value_text(facts['value'])}")
    write_move(done.scene, table, assembly, after, labels, done.places, done.moved, titles, out)
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


def _check_certificate(source: Path, out: Path, certificate: Path, prove: str | None) -> None:
    """Raise InputError for a certificate that cannot be written, or without `--prove`."""
    # Before any work, so that a long search is not in vain.
    if prove is None:
        raise ParameterError("certificate", "it holds a proof, and none is asked for", "it with `prove`")
    if certificate.is_dir() or not certificate.absolute().parent.is_dir():
        problem = "it is a folder" if certificate.is_dir() else "its folder does not exist"
        raise InputError(str(certificate), problem, "a file in a folder that is there")
    refuse_itself(source, certificate)
    written = [path.absolute() for path in (out, out.with_suffix(".csv"), out.with_suffix(".png"))]
    if certificate.absolute() in written:
        raise ParameterError("certificate", f"{certificate.name!r} is written already", "another file")


def _check_by_fields(
    facts: dict[str, Any], assembly: Assembly, done: MovedJoints, labels: Bits, until: Deadline
) -> dict[str, Any] | None:
    """Return lower bounds on λ by fields before and after, with blocks that crack anywhere.

    labels: (m,) True = dry.
    """
    if labels.all() or done.after is None or not done.moved.any():
        return None
    found: dict[str, Any] = {"before": None, "after": None, "skipped": None}
    if done.end == "interrupted" or until.remaining() < _LEAST_CHECK:
        return found | {"skipped": "no time was left"}
    try:
        for left, name, one in ((2, "before", assembly), (1, "after", done.after.assembly)):
            seconds = min(_FIELD_SECONDS, until.remaining() / left)
            low = solve_by_fields(one, labels, gap=_FIELD_GAP, seconds=seconds).decided.low
            found[name] = json_number(low)
    except InputError as error:
        found["skipped"] = f"{error.where}: {error.problem}"
    return found


def _bounded(
    facts: dict[str, Any], assembly: Assembly, done: MovedJoints, labels: Bits, until: Deadline
) -> dict[str, Any]:
    """Put bounds by fields into the facts of a move; return the lower ones before and after.

    labels: (m,) True = dry.
    """
    seconds = min(_FIELD_SECONDS, until.remaining() / 2.0)
    before = solve_by_fields(assembly, labels, gap=_FIELD_GAP, seconds=seconds).decided
    moved = assembly if done.after is None else done.after.assembly
    after = solve_by_fields(moved, labels, gap=_FIELD_GAP, seconds=seconds)
    low, high = json_number(after.decided.low), json_number(after.decided.high)
    facts |= {"start": json_number(before.low), "value": low, "load_factor": low, "bracket": [low, high]}
    facts |= {"status": str(after.status), "start_bracket": [json_number(before.low), json_number(before.high)]}
    return {"before": facts["start"], "after": low, "skipped": None}


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


def _facts(done: MovedJoints) -> dict[str, Any]:
    """Return the object that `jld move --json` prints."""
    after = done.after
    load_factor = math.nan if after is None else after.load_factor
    bracket = (math.nan, math.nan) if after is None else after.bracket
    return {
        "name": done.scene.name,
        "objective": done.objective,
        "load_factor": json_number(load_factor),
        "bracket": [json_number(end) for end in bracket],
        "status": None if after is None else str(after.status),
        "start": json_number(done.start),
        "value": json_number(done.value),
        "steps": len(done.points) - len({point.start for point in done.points}),
        "solves": done.points[-1].solves if done.points else 0,
        "end": done.end,
        "parameters": done.parameters,
        "largest_move": float(np.linalg.norm(done.moved, axis=1).max(initial=0.0)),
        "seconds": done.points[-1].seconds if done.points else 0.0,
        "warnings": done.warnings,
    }


def _crack_words(checked: dict[str, Any] | None) -> dict[str, str]:
    """Return the line on the check by fields for the terminal, by name."""
    if checked is None or checked["skipped"] is not None:
        return {}
    return {"by fields": f"λ ≥ {value_text(checked['before'])} before, λ ≥ {value_text(checked['after'])} after"}


def _words(facts: dict[str, Any], out: Path) -> str:
    """Describe the result of a move for the terminal."""
    ends = {
        "stationary": "stationary: no small movement raises it (a local statement; try --starts or --seconds)",
        "locked": 'locked: no live load is too large; limit "block_mass", "angle" or "box"',
        "time": "time limit",
        "points": "limit on points",
        "interrupted": "a signal: the best so far",
    }
    lines = {
        "objective": facts["objective"].replace("_", " "),
        "start": value_text(facts["start"]) if facts["start"] is not None else "does not stand",
        "end": value_text(facts["value"]) if facts["end"] != "locked" else "locked",
        "bracket": "[" + ", ".join("unproven" if end is None else f"{end:.9g}" for end in facts["bracket"]) + "]",
        "ended": ends[facts["end"]],
        **({"nominal": value_text(facts["load_factor_nominal"])} if "load_factor_nominal" in facts else {}),
        **_crack_words(facts["fields"]),
        "effort": f"{facts['steps']} steps, {facts['solves']} proven solves, {facts['parameters']} parameters",
        "written to": f"{out}, {out.with_suffix('.csv').name}, {out.with_suffix('.png').name}",
    }
    return "\n".join(f"{name:<12} {value}" for name, value in lines.items())
