"""Provide `jld move --prove`: bounds on λ over a box of positions, checked and certified."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import ParameterError
from jld_core.limit import Status
from jld_core.scene import Scene
from jld_explore.cli.streams import say, warn
from jld_geometry.box_bound import ProvenBox, prove_box
from jld_geometry.box_proof import check_proof, write_box_certificate
from jld_geometry.move_output import json_number, value_text, write_move


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
    """Prove a bound over a box, check the proof, write the best scene and print both bounds.

    labels: (m,) True = dry.
    """

    def progress(best: float, bound: float, boxes: int) -> None:
        """Print the bounds at intervals, once a position that stands is found."""
        if not as_json and best > -math.inf and boxes & (boxes - 1) == 0:
            say(f"{boxes:>6} boxes  {value_text(best)} ≤ λ ≤ {value_text(bound)}")

    done = prove_box(scene, assembly, labels, _box(box), gap=gap, seconds=seconds, progress=progress)
    passed, spent, reason = check_proof(done)
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
        warn(f"jld: warning: {sentence}")
    if as_json:
        say(json.dumps(facts, indent=1))
        return
    what = "proven" if facts["proven"] else "not proven"
    say(f"λ {value_text(done.load_factor)} found, {value_text(done.bound)} at most, gap {done.gap:.2g}: {what}")
    checked = f", checked in {spent:.1f} s" if passed else ""
    say(f"{done.boxes} boxes, {done.seconds:.1f} s{checked}, written to {out}")
    if certificate is not None and passed:
        say(f"certificate written to {certificate}: jld verify {certificate}")


def _box(text: str) -> float | tuple[Floats, Floats]:
    """Convert the value of `--prove` to a length, or to both ends (p,) of a box.

    Raises InputError for anything else.
    """
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
        "load_factor": json_number(done.load_factor),
        "bracket": [json_number(end) for end in done.after.bracket],
        "status": str(done.after.status),
        "start": json_number(start),
        "steps": done.boxes,
        "bound": json_number(done.bound),
        "proven": done.proven,
        "gap": json_number(done.gap),
        "boxes": done.boxes,
        "box": [[float(low), float(high)] for low, high in zip(done.low, done.high, strict=True)],
        "parameters": [float(value) for value in done.parameters],
        "seconds": done.seconds,
    }
