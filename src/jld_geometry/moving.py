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

from jld_core import (
    Assembly,
    Bits,
    Deadline,
    Floats,
    InputError,
    LimitAnalysisResult,
    ParameterError,
    Scene,
    Status,
    error_context,
    files,
)
from jld_core.build import build_robust
from jld_core.limit import number
from jld_core.models import solve_by_fields, solve_rigid
from jld_core.scene import cracks as scene_cracks
from jld_explore import Interrupted
from jld_explore.cli import layout, options, streams
from jld_explore.report import csv_of
from jld_geometry.box_bound import ProvenBox, check_proof, prove_box, write_box_certificate
from jld_geometry.field_search import move_by_fields
from jld_geometry.joint_shapes import Incline, Key, Shape, ShapedJoints, Sine, shape_joints
from jld_geometry.search import GeometrySearch, MovedJoints, Point, move_joints


def write_move(
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
    import pandas as pd  # slow to import and needed for tables only

    names = ["start", "step", "value", "bracket_lo", "bracket_hi", "predicted", "radius", "solves", "seconds"]
    rows = pd.DataFrame(table)
    options.write_scene(scene, out)
    files.write_text(out.with_suffix(".csv"), csv_of(rows[[name for name in names if name in rows]]))
    if after is None:
        return
    from jld_views import figure_of_move, figures

    figures.save_figure(figure_of_move(before, after, labels, places, moved, titles), out.with_suffix(".png"))


def value_text(value: float | None) -> str:
    return "none" if value is None or math.isnan(value) else "locked" if value == math.inf else f"{value:.6g}"


# What `--joint` takes
_FORMS: Final = "key:DEPTH,WIDTH,FLANK, sine:AMPLITUDE,WAVES (shares of the length of a face) or incline:SLOPE"

_SHAPE_GAP: Final = 0.1  # relative width of the brackets by fields that check a shape

_SECONDS: Final = 10.0  # time for each of them and load case, s


def shape_of(text: str) -> Shape:
    """Return the shape that a text states; raise InputError for anything else."""
    kind, _, rest = text.partition(":")
    try:
        numbers = [float(part) for part in rest.split(",")]
        if kind == "key" and len(numbers) == 3:
            return Key(*numbers)
        if kind == "sine" and len(numbers) == 2 and numbers[1] == int(numbers[1]):
            return Sine(numbers[0], int(numbers[1]))
        if kind == "incline" and len(numbers) == 1:
            return Incline(numbers[0])
    except (ValueError, OverflowError):
        pass  # told below, with what is expected
    raise ParameterError("joint", f"{text!r} is no shape", _FORMS)


def direction_of(text: str | None) -> Floats | None:
    if text is None:
        return None
    try:
        direction = np.array([float(part) for part in text.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise ParameterError("direction", f"{text!r} is no direction", "X,Y,Z, as 0,1,0")
    return direction


def move_shape(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    text: str,
    direction: str | None,
    seconds: float,
    out: Path,
    as_json: bool,
) -> None:
    """Search the best shape of all joints, write the files and print the result."""

    def progress(shape: Shape, value: float) -> None:
        if not as_json:
            streams.say(f"{_named(shape)}  λ ≥ {value:.6g}")

    shape, run = shape_of(text), direction_of(direction)
    done = shape_joints(scene, assembly, labels, shape, run, seconds=seconds, progress=progress)
    if done.end == "interrupted":
        _write(done, out)
        stop = Interrupted()
        stop.words = f"stopped; the best so far is in {out}: {_named(done.shape)}, λ {_words_of_factor(done.after)}"
        raise stop
    facts = _shape_facts(done)
    facts["fields"] = _by_fields(assembly, labels, done)
    _write(done, out)
    before, after = (facts["fields"][name] for name in ("before", "after"))
    if facts["fields"]["skipped"] is not None:
        streams.warn(
            f"jld: warning: λ is that of cracks at the roots of teeth; no check by fields: {facts['fields']['skipped']}"
        )
    elif before is None or after is None or after <= before:
        streams.warn("jld: warning: blocks that crack anywhere gain nothing by the shape: see `fields`")
    if as_json:
        streams.say(json.dumps(facts, indent=1))
        return
    values = f"λ {_words_of_factor(done.before)} to {_words_of_factor(done.after)}"
    streams.say(f"best: {_named(done.shape)}, {values}, {len(done.trials)} shapes, {done.end}")
    if facts["fields"]["skipped"] is None:
        streams.say(f"by fields: λ ≥ {value_text(before)} before, λ ≥ {value_text(after)} after")
    streams.say(f"written to {out}, {out.with_suffix('.csv').name}, {out.with_suffix('.png').name}")


def _shape_facts(done: ShapedJoints) -> dict[str, Any]:
    """Return the object that `jld move --joint --json` prints."""
    return {
        "name": done.scene.name,
        "joint": {"kind": type(done.shape).__name__.lower(), **vars(done.shape)},
        "start": number(done.before.load_factor),
        "load_factor": number(done.after.load_factor),
        "bracket": [number(end) for end in done.after.bracket],
        "status": str(done.after.status),
        "shapes": len(done.trials),
        "end": done.end,
    }


def _by_fields(assembly: Assembly, labels: Bits, done: ShapedJoints) -> dict[str, Any]:
    """Return lower bounds on λ by fields with straight joints and the best shape, or why there are none."""
    bounds: dict[str, Any] = {"before": None, "after": None, "skipped": None}
    if assembly.dimension == 3:
        return bounds | {"skipped": "in space it takes minutes; jld solve FILE --cracks fields does it"}
    layouts = {"before": (assembly, labels), "after": (done.after.assembly, done.after.labels)}
    try:
        for name, layout_labels in layouts.items():
            low = solve_by_fields(*layout_labels, gap=_SHAPE_GAP, seconds=_SECONDS).decided.low
            bounds[name] = number(low)
    except InputError as error:
        bounds["skipped"] = f"{error.where}: {error.problem}"
    return bounds


def _write(done: ShapedJoints, out: Path) -> None:
    import pandas as pd  # slow to import and needed for tables only

    from jld_views import figures

    rows = pd.DataFrame([{**vars(shape), "load_factor": value} for shape, value in done.trials])
    options.write_scene(done.scene, out)
    files.write_text(out.with_suffix(".csv"), csv_of(rows))
    titles = [
        f"straight: λ = {_words_of_factor(done.before)}",
        f"{type(done.shape).__name__.lower()}: λ = {_words_of_factor(done.after)}",
    ]
    figures.save_figure(figures.figure_of_layouts([done.before, done.after], titles), out.with_suffix(".png"))


def _named(shape: Shape) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in vars(shape).items())


def _words_of_factor(result: LimitAnalysisResult) -> str:
    return f"{result.load_factor:.6g}" if result.status is Status.COLLAPSE else str(result.status)


def prove_positions(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    box: str,
    gap: float,
    seconds: float,
    out: Path,
    certificate: Path | None,
    as_json: bool,
) -> None:
    """Prove a bound over a box, check the proof, write the best scene and print both bounds."""

    def progress(best: float, bound: float, boxes: int) -> None:
        power_of_two = boxes & (boxes - 1) == 0  # a line at 1, 2, 4, 8, … boxes
        if not as_json and best > -math.inf and power_of_two:
            streams.say(f"{boxes:>6} boxes  {value_text(best)} ≤ λ ≤ {value_text(bound)}")

    done = prove_box(scene, assembly, labels, _box(box), gap=gap, seconds=seconds, progress=progress)
    passed, spent, reason = check_proof(done)  # None without a proof that could be checked
    facts = _proof_facts(done) | {"proof_check": {"passed": passed is True, "seconds": spent}, "warnings": []}
    if passed is False or (passed is None and done.proven):
        facts["proven"] = False
        facts["warnings"].append(f"the proof did not pass its check ({reason}): nothing is proven")
    if certificate is not None and passed:
        write_box_certificate(done, certificate)
    elif certificate is not None:
        facts["warnings"].append(f"no certificate is written: {reason}")
    row = {"start": 0, "step": 0, "value": done.load_factor, "bracket_lo": done.load_factor, "bracket_hi": done.bound}
    titles = (f"before: {value_text(facts['start'])}", f"best in the box: {value_text(facts['load_factor'])}")
    write_move(done.scene, [row], assembly, done.after.assembly, labels, done.places, done.moved, titles, out)
    for sentence in facts["warnings"]:
        streams.warn(f"jld: warning: {sentence}")
    if as_json:
        streams.say(json.dumps(facts, indent=1))
        return
    what = "proven" if facts["proven"] else "not proven"
    streams.say(f"λ {value_text(done.load_factor)} found, {value_text(done.bound)} at most, gap {done.gap:.2g}: {what}")
    checked = f", checked in {spent:.1f} s" if passed else ""
    streams.say(f"{done.boxes} boxes, {done.seconds:.1f} s{checked}, written to {out}")
    if certificate is not None and passed:
        streams.say(f"certificate written to {certificate}: jld verify {certificate}")


def _box(text: str) -> float | tuple[Floats, Floats]:
    """Convert the value of `--prove` to a length, or to both ends (p,) of a box."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not np.isfinite(numbers).all() or (len(numbers) > 1 and len(numbers) % 2):
        raise ParameterError("prove", f"{text!r} is no box", "a length, or LOW,HIGH for each parameter")
    if len(numbers) == 1:
        return numbers[0]
    return np.array(numbers[0::2]), np.array(numbers[1::2])


def _proof_facts(done: ProvenBox) -> dict[str, Any]:
    """Return the object that `jld move --prove --json` prints."""
    start = done.before.load_factor if done.before.status is Status.COLLAPSE else math.nan
    return {
        "name": done.scene.name,
        "objective": "load_factor",
        "load_factor": number(done.load_factor),
        "bracket": [number(end) for end in done.after.bracket],
        "status": str(done.after.status),
        "start": number(start),
        "steps": done.boxes,
        "bound": number(done.bound),
        "proven": done.proven,
        "gap": number(done.gap),
        "boxes": done.boxes,
        "box": [[float(low), float(high)] for low, high in zip(done.low, done.high, strict=True)],
        "parameters": [float(value) for value in done.parameters],
        "seconds": done.seconds,
    }


_FIELD_GAP: Final = 0.1  # relative width of brackets by fields, which check a gain where blocks may crack

_FIELD_SECONDS: Final = 10.0  # time for each of them, s

_CHECKING: Final = 0.2  # share of a time limit for the check by fields

_LEAST_CHECK: Final = 0.5  # shortest time in which the check by fields is begun, s

_WRITING: Final = 1.0  # processor time for table and picture, kept back from a time limit, s

_BUSY: Final = 3.0  # largest factor by which a busy machine prolongs it

_GAP: Final = 1e-3  # default of the relative distance of both bounds at which a proof ends


def require_movable(scene: Scene, assembly: Assembly) -> None:
    """Raise InputError if the key "move" of a scene does not fit the scene's own labelling."""
    if scene.move is not None:
        GeometrySearch(scene, assembly, assembly.labels)


def move(
    context: typer.Context,
    source: options.Source,
    out: options.Out,
    rank: options.Rank = None,
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
    cracks: options.Cracks = None,
    as_json: options.AsJson = False,
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
    scene, assembly, labels, model = layout.layout_of(source, rank)
    scene = options.with_cracks(scene, cracks)
    by_fields = isinstance(scene.cracks, scene_cracks.FieldCracks)
    with error_context(source):
        layout.require_whole_faces(model, "a move of joints")
        if isinstance(scene.cracks, scene_cracks.CellCracks) and prove is None:
            raise InputError("cracks", "joints do not move where blocks crack by cells", '"faces" or "fields"')
    assembly = replace(assembly, cracks=scene.cracks)
    if by_fields and robust:
        raise ParameterError("robust", "cracks by fields take one value of each strength", "cracks by faces")
    if robust and not assembly.has_low_values:
        with error_context(source):
            assembly = build_robust(scene)

    def progress(point: Point) -> None:
        if not as_json:
            streams.say(f"start {point.start} step {point.step:<3} {point.value:<14.8g} {point.seconds:.1f} s")

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
    options.write_scene(done.scene, out)
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
    done: MovedJoints, assembly: Assembly, labels: Bits, until: Deadline, out: Path, as_json: bool, *, by_fields: bool
) -> None:
    """Check a move by fields, write table and picture, and print the result."""
    facts = _facts(done)
    if assembly.has_low_values and done.after is not None:
        nominal = solve_rigid(done.after.assembly.at_nominal, labels).load_factor
        facts["load_factor_nominal"] = number(nominal)
    # a move by fields has its value proven here; one by faces only gets a second opinion
    check = _replace_by_field_bounds if by_fields else _check_by_fields
    checked = check(facts, assembly, done, labels, until)
    facts["fields"], facts["warnings"] = checked, [*done.warnings, *_doubts(checked)]
    table = [vars(point) | {"bracket_lo": point.bracket[0], "bracket_hi": point.bracket[1]} for point in done.points]
    after = None if done.after is None else done.after.assembly
    sign = {"load_factor": "λ", "least_friction": "μ", "least_thickness": "thickness"}[done.objective]
    relation = f"{sign} ≥" if by_fields else f"{sign} ="
    titles = (f"before: {relation} {value_text(facts['start'])}", f"after: {relation} {value_text(facts['value'])}")
    write_move(done.scene, table, assembly, after, labels, done.places, done.moved, titles, out)
    for sentence in facts["warnings"]:
        streams.warn(f"jld: warning: {sentence}")
    streams.say(json.dumps(facts, indent=1) if as_json else _words(facts, out))


def _check_out(source: Path, out: Path) -> None:
    """Raise InputError for a file that cannot be written."""
    if out.suffix in (".csv", ".png"):
        raise ParameterError("out", f"{out.name!r} is the name of a table or picture", "the name of a scene file")
    if out.is_dir() or not out.absolute().parent.is_dir():
        problem = "it is a folder" if out.is_dir() else "its folder does not exist"
        raise InputError(str(out), problem, "a file in a folder that is there")
    options.refuse_itself(source, out)


def _check_certificate(source: Path, out: Path, certificate: Path, prove: str | None) -> None:
    """Raise InputError for a certificate that cannot be written, or without `--prove`."""
    # Before any work, so that a long search is not in vain.
    if prove is None:
        raise ParameterError("certificate", "it holds a proof, and none is asked for", "it with `prove`")
    if certificate.is_dir() or not certificate.absolute().parent.is_dir():
        problem = "it is a folder" if certificate.is_dir() else "its folder does not exist"
        raise InputError(str(certificate), problem, "a file in a folder that is there")
    options.refuse_itself(source, certificate)
    written = [path.absolute() for path in (out, out.with_suffix(".csv"), out.with_suffix(".png"))]
    if certificate.absolute() in written:
        raise ParameterError("certificate", f"{certificate.name!r} is written already", "another file")


def _check_by_fields(
    facts: dict[str, Any], assembly: Assembly, done: MovedJoints, labels: Bits, until: Deadline
) -> dict[str, Any] | None:
    """Return lower bounds on λ by fields before and after, with blocks that crack anywhere."""
    if labels.all() or done.after is None or not done.moved.any():
        return None
    bounds: dict[str, Any] = {"before": None, "after": None, "skipped": None}
    if done.end == "interrupted" or until.remaining() < _LEAST_CHECK:
        return bounds | {"skipped": "no time was left"}
    try:
        for parts, name, structure in ((2, "before", assembly), (1, "after", done.after.assembly)):
            seconds = min(_FIELD_SECONDS, until.remaining() / parts)
            low = solve_by_fields(structure, labels, gap=_FIELD_GAP, seconds=seconds).decided.low
            bounds[name] = number(low)
    except InputError as error:
        bounds["skipped"] = f"{error.where}: {error.problem}"
    return bounds


def _replace_by_field_bounds(
    facts: dict[str, Any], assembly: Assembly, done: MovedJoints, labels: Bits, until: Deadline
) -> dict[str, Any]:
    """Put bounds by fields into the facts of a move; return the lower ones before and after."""
    seconds = min(_FIELD_SECONDS, until.remaining() / 2.0)
    before = solve_by_fields(assembly, labels, gap=_FIELD_GAP, seconds=seconds).decided
    moved = assembly if done.after is None else done.after.assembly
    after = solve_by_fields(moved, labels, gap=_FIELD_GAP, seconds=seconds)
    low, high = number(after.decided.low), number(after.decided.high)
    facts |= {"start": number(before.low), "value": low, "load_factor": low, "bracket": [low, high]}
    facts |= {"status": str(after.status), "start_bracket": [number(before.low), number(before.high)]}
    return {"before": facts["start"], "after": low, "skipped": None}


def _doubts(checked: dict[str, Any] | None) -> list[str]:
    """Return a sentence of doubt where bounds by fields do not confirm the gain."""
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
    after = done.after
    load_factor = math.nan if after is None else after.load_factor
    bracket = (math.nan, math.nan) if after is None else after.bracket
    return {
        "name": done.scene.name,
        "objective": done.objective,
        "load_factor": number(load_factor),
        "bracket": [number(end) for end in bracket],
        "status": None if after is None else str(after.status),
        "start": number(done.start),
        "value": number(done.value),
        "steps": len(done.points) - len({point.start for point in done.points}),
        "solves": done.points[-1].solves if done.points else 0,
        "end": done.end,
        "parameters": done.parameters,
        "largest_move": float(np.linalg.norm(done.moved, axis=1).max(initial=0.0)),
        "seconds": done.points[-1].seconds if done.points else 0.0,
        "warnings": done.warnings,
    }


def _crack_words(checked: dict[str, Any] | None) -> dict[str, str]:
    if checked is None or checked["skipped"] is not None:
        return {}
    return {"by fields": f"λ ≥ {value_text(checked['before'])} before, λ ≥ {value_text(checked['after'])} after"}


def _words(facts: dict[str, Any], out: Path) -> str:
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
