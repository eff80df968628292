"""Provide `jld move --joint`: keyed, wavy and inclined joints, whose shape is searched."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError
from jld_core.files import write_text
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.models import solve_by_fields
from jld_core.scene import Scene
from jld_explore.cli.samples import write_scene
from jld_explore.cli.streams import say, warn
from jld_explore.report import csv_of
from jld_explore.search.state import Interrupted
from jld_geometry.joint_shapes import Incline, Key, Shape, ShapedJoints, Sine, shape_joints
from jld_geometry.move_output import value_text

# What `--joint` takes
_FORMS: Final = "key:DEPTH,WIDTH,FLANK, sine:AMPLITUDE,WAVES (shares of the length of a face) or incline:SLOPE"

_GAP: Final = 0.1  # relative width of the brackets by fields that check a shape

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
    """Return the vector (3,) that a text states; None for None.

    Raises ParameterError for any other text.
    """
    if text is None:
        return None
    try:
        found = np.array([float(part) for part in text.split(",")])
    except ValueError:
        found = np.zeros(0)
    if found.shape != (3,) or not np.isfinite(found).all() or not found.any():
        raise ParameterError("direction", f"{text!r} is no direction", "X,Y,Z, as 0,1,0")
    return found


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
    """Search the best shape of all joints, write the files and print the result.

    labels: (m,) True = dry.
    """

    def progress(shape: Shape, value: float) -> None:
        """Print a shape that was tried."""
        if not as_json:
            say(f"{_named(shape)}  λ ≥ {value:.6g}")

    shape, run = shape_of(text), direction_of(direction)
    done = shape_joints(scene, assembly, labels, shape, run, seconds=seconds, progress=progress)
    if done.end == "interrupted":
        _write(done, out)
        stop = Interrupted()
        stop.words = f"stopped; the best so far is in {out}: {_named(done.shape)}, λ {_said(done.after)}"
        raise stop
    facts = _facts(done)
    facts["fields"] = _by_fields(assembly, labels, done)
    _write(done, out)
    before, after = (facts["fields"][name] for name in ("before", "after"))
    if facts["fields"]["skipped"] is not None:
        warn(
            f"jld: warning: λ is that of cracks at the roots of teeth; no check by fields: {facts['fields']['skipped']}"
        )
    elif before is None or after is None or after <= before:
        warn("jld: warning: blocks that crack anywhere gain nothing by the shape: see `fields`")
    if as_json:
        say(json.dumps(facts, indent=1))
        return
    values = f"λ {_said(done.before)} to {_said(done.after)}"
    say(f"best: {_named(done.shape)}, {values}, {len(done.trials)} shapes, {done.end}")
    if facts["fields"]["skipped"] is None:
        say(f"by fields: λ ≥ {value_text(before)} before, λ ≥ {value_text(after)} after")
    say(f"written to {out}, {out.with_suffix('.csv').name}, {out.with_suffix('.png').name}")


def _facts(done: ShapedJoints) -> dict[str, Any]:
    """Return the object that `jld move --joint --json` prints."""
    return {
        "name": done.scene.name,
        "joint": {"kind": type(done.shape).__name__.lower(), **vars(done.shape)},
        "start": _number(done.before.load_factor),
        "load_factor": _number(done.after.load_factor),
        "bracket": [_number(end) for end in done.after.bracket],
        "status": str(done.after.status),
        "shapes": len(done.trials),
        "end": done.end,
    }


def _by_fields(assembly: Assembly, labels: Bits, done: ShapedJoints) -> dict[str, Any]:
    """Return lower bounds on λ by fields with straight joints and with the best shape.

    labels: (m,) True = dry. The entries are "before", "after" (None if unknown) and "skipped", the reason if nothing
    was computed: in space a single mesh may take minutes.
    """
    found: dict[str, Any] = {"before": None, "after": None, "skipped": None}
    if assembly.dimension == 3:
        return found | {"skipped": "in space it takes minutes; jld solve FILE --cracks fields does it"}
    try:
        for name, one, own in (("before", assembly, labels), ("after", done.after.assembly, done.after.labels)):
            low = solve_by_fields(one, own, gap=_GAP, seconds=_SECONDS).decided.low
            found[name] = _number(low)
    except InputError as error:
        found["skipped"] = f"{error.where}: {error.problem}"
    return found


def _write(done: ShapedJoints, out: Path) -> None:
    """Write scene, table of shapes and picture beside one another."""
    import pandas as pd  # slow to import and needed for tables only

    from jld_core.views.figures import figure_of_layouts, save_figure

    rows = pd.DataFrame([{**vars(shape), "load_factor": value} for shape, value in done.trials])
    write_scene(done.scene, out)
    write_text(out.with_suffix(".csv"), csv_of(rows))
    titles = [f"straight: λ = {_said(done.before)}", f"{type(done.shape).__name__.lower()}: λ = {_said(done.after)}"]
    save_figure(figure_of_layouts([done.before, done.after], titles), out.with_suffix(".png"))


def _named(shape: Shape) -> str:
    """Return a shape as text for the terminal."""
    return ", ".join(f"{name} {value:.4g}" for name, value in vars(shape).items())


def _said(result: LimitAnalysisResult) -> str:
    """Return λ of a result as text, or its status."""
    return f"{result.load_factor:.6g}" if result.status is Status.COLLAPSE else str(result.status)


def _number(value: float) -> float | None:
    """Return a float for JSON, None where it is not finite."""
    return float(value) if math.isfinite(value) else None
