"""Measure what keys and waves gain over straight joints: ``python -m benchmarks.joint_shapes``.

Three structures pushed to either side, the worse counts: a block on a base, two courses of bricks on a base, and an
arch of nine voussoirs. Blocks of 2000 kg/m³ with σt = 0.3 MPa and τ = 0.5 MPa crack anywhere: λ is the lower bound by
fields. Straight joints are those drawn, and those that `jld move` finds, free or with the masses drawn. A wave gives
to each block what it takes; a key changes the masses at the ends of a row. Then a key in space through the command: a
block of 0.4 × 0.2 × 0.2 m on a longer one, under 4 kN, with a tooth across its whole depth.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import table, write
from jld_core import build_assembly, parse_scene, samples
from jld_core.arrays import Bits
from jld_core.assembly import Assembly, blocks_of
from jld_core.errors import InputError
from jld_core.geometry_optimisation.joint_profiles import Key, Shape, Sine
from jld_core.geometry_optimisation.optimise import move_joints
from jld_core.geometry_optimisation.shape_search import ShapedJoints, shape_joints
from jld_core.limit import LimitAnalysisResult
from jld_core.models import solve_by_fields

Document = dict[str, Any]

SECONDS: Final = 30.0
"""Time for each search, s."""

FIELDS: Final = 8.0
"""Time for the bounds by fields of each load case, s."""

SPACE: Final = (
    "\n\n## A key in space\n\nλ in kN by `jld move --joint key:DEPTH,0.35,0.05 --direction 0,1,0`, by faces: cracks at "
    "the roots of tooth and shoulders. Climbed is N tan(φ + α), up the flank; broken is μ N + (τ + μ σt) w t, the root "
    "sheared while the block slides with dilation, an upper bound. Both alone ignore that the block rocks.\n\n"
)
"""Text of the second table."""

DEPTHS: Final = (0.0125, 0.025, 0.05, 0.075, 0.1, 0.15, 0.2)
"""Depths of the key in space, shares of the length of its joint."""

_MATERIALS: Final[Document] = {
    "density": 2000.0,
    "dry": {"friction_coefficient": 0.4},
    "inner": {"tensile_strength": 3e5, "shear_strength": 5e5},
}


def _pushed() -> Document:
    """Return a push by shares of the weight to either side."""
    return {"cases": [{"name": n, "live": [{"body": [s, 0.0]}]} for n, s in (("right", 1.0), ("left", -1.0))]}


def _brick(name: str, left: float, right: float, low: float, high: float, *, support: bool = False) -> Document:
    """Return a rectangular element."""
    outline = [[left, low], [right, low], [right, high], [left, high]]
    return {"id": name, "polygon": outline, "support": support}


def structures() -> list[tuple[Document, Document, list[Shape]]]:
    """Return scenes, the key "move" for their straight joints, and shapes from which searches begin."""
    base = _brick("base", -0.2, 1.4, -0.2, 0.0, support=True)
    cuts = [0.0, 0.2, 0.6, 1.0, 1.2]
    lower = [_brick(f"a{k}", 0.4 * k, 0.4 * k + 0.4, 0.0, 0.2) for k in range(3)]
    upper = [_brick(f"b{k}", a, b, 0.2, 0.4) for k, (a, b) in enumerate(itertools.pairwise(cuts))]
    arch = json.loads(samples.arch(voussoirs=9, thickness=0.2, load="push").model_dump_json(exclude_defaults=True))
    common = {"thickness": 0.2, "materials": _MATERIALS, "loads": _pushed()}
    turning = {"along": [{"circle": [0.0, 0.0]}]}
    return [
        (
            {"name": "block", "elements": [base, _brick("up", 0.4, 0.8, 0.0, 0.2)], **common},
            {},
            [Key(0.1, 0.5, 0.05), Sine(0.06, 1)],
        ),
        (
            {"name": "two courses", "elements": [base, *lower, *upper], **common},
            {},
            [Key(0.1, 0.4, 0.04), Sine(0.06, 2)],
        ),
        ({**arch, "name": "arch", **common}, turning, [Key(0.15, 0.5, 0.05), Sine(0.1, 1)]),
    ]


def bounds(result: LimitAnalysisResult) -> tuple[str, str]:
    """Return both bounds by fields in words."""
    found = solve_by_fields(result.assembly, result.labels, gap=0.05, seconds=FIELDS).governing
    return f"{found.low:.4g}", f"{found.high:.4g}"


def mass_change(done: ShapedJoints, before: Assembly, labels: Bits) -> float:
    """Return the largest change of the mass of a block by a shape, relative to it; labels: (m,) of straight joints."""
    after = done.after.assembly
    found = [
        {
            one.elements.ids[k]: float(one.elements.mass[blocks == blocks[k]].sum())
            for k in one.elements.free.tolist()
            if blocks[k] not in set(blocks[one.elements.support].tolist())
        }
        for one, blocks in ((before, blocks_of(before, labels)), (after, blocks_of(after, done.after.labels)))
    ]
    return max(abs(found[1][name] / mass - 1.0) for name, mass in found[0].items())


def blocks_in_space(aside: float) -> Document:
    """Return a block on another in space, pressed by 4 kN, pushed at `aside` degrees from the x axis at the joint."""
    document: Document = {
        "name": "key in space",
        "elements": [
            {"id": "ground", **_cuboid((-0.5, 0.9), (-0.3, -0.2)), "support": True},
            {"id": "low", **_cuboid((-0.4, 0.8), (-0.2, 0.0))},
            {"id": "up", **_cuboid((0.0, 0.4), (0.0, 0.2))},
        ],
        "materials": {
            "density": 0.0,
            "dry": {"friction_coefficient": 0.4},
            "inner": {"tensile_strength": 2e5, "shear_strength": 4e5},
        },
        "labels": {"inner": [["ground", "low"]]},
    }
    angle = np.radians(aside)
    push = {"element": "up", "force": [float(np.cos(angle)), float(np.sin(angle)), 0.0], "at": [0.0, 0.1, 0.0]}
    dead = {"element": "up", "force": [0.0, 0.0, -4000.0], "at": [0.2, 0.1, 0.1]}
    return {**document, "loads": {"dead": [dead], "live": [push]}}


def _cuboid(across: tuple[float, float], up: tuple[float, float]) -> Document:
    """Return vertices and faces of a cuboid of 0.2 m along y by its ends along x and z."""
    corners = [[x, y, z] for x in across for y in (0.0, 0.2) for z in up]
    loops = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return {"vertices": corners, "faces": loops}


def command(document: Document, joint: str, seconds: float) -> Document:
    """Return what `jld move --joint` prints as JSON for a scene and a time limit, s."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "scene.json", Path(folder) / "out.json"
        source.write_text(json.dumps(document))
        flags = ["--joint", joint, "--direction", "0,1,0", "--seconds", f"{seconds:g}", "--json"]
        line = [sys.executable, "-m", "jld_explore", "move", str(source), "-o", str(out), *flags]
        done = subprocess.run(line, check=True, capture_output=True, text=True)
    found: Document = json.loads(done.stdout)
    return found


def keys_in_space() -> list[list[str]]:
    """Return the rows of the table of keys of growing depth: λ in kN pushed along x and aside, and its limits."""
    rows, press, friction = [], 4.0, 0.4
    for depth in DEPTHS:
        found = [
            command(blocks_in_space(angle), f"key:{depth:g},0.35,0.05", 0.0)["load_factor"] for angle in (0.0, 45.0)
        ]
        slope = depth / 0.05
        climbed = press * (friction + slope) / (1.0 - friction * slope) if friction * slope < 1.0 else np.inf
        broken = friction * press + (400.0 + friction * 200.0) * 0.35 * 0.4 * 0.2
        values = [f"{0.4 * depth:g}", *(f"{0.001 * one:.5g}" for one in found)]
        rows.append([*values, f"{climbed:.5g}" if climbed < np.inf else "∞", f"{broken:.5g}"])
        print(rows[-1], flush=True)
    best = command(blocks_in_space(0.0), "key:0.05,0.35,0.05", SECONDS)
    words = ", ".join(f"{name} {best['joint'][name]:.3g}" for name in ("depth", "width", "flank"))
    return [*rows, [f"searched ({words})", f"{0.001 * best['load_factor']:.5g}", "–", "–", "–"]]


def straight(document: Document, move: Document, mass: bool) -> tuple[str, ...]:
    """Return λ by faces and both bounds by fields of straight joints that `jld move` finds, in words.

    mass: True keeps each block within 0.1 % of the range of the masses drawn.
    """
    assembly = build_assembly(parse_scene(document))
    free = assembly.elements.mass[assembly.elements.free]
    limits = {"block_mass": [float(0.999 * free.min()), float(1.001 * free.max())]} if mass else {}
    scene = parse_scene({**document, "move": {**move, **limits}})
    try:
        found = move_joints(scene, assembly, assembly.labels, seconds=SECONDS)
    except InputError:
        return "no vertex moves", "–", "–"
    return ("–", "–", "–") if found.after is None else (f"{found.value:.4g}", *bounds(found.after))


def main() -> None:
    """Run all searches and write the table."""
    rows = []
    for document, move, shapes in structures():
        scene = parse_scene(document)
        assembly = build_assembly(scene)
        for k, shape in enumerate(shapes):
            done = shape_joints(scene, assembly, assembly.labels, shape, seconds=SECONDS)
            if k == 0:
                rows.append([scene.name, "as drawn", f"{done.before.load_factor:.4g}", *bounds(done.before), "0"])
                rows.append([scene.name, "straight, moved", *straight(document, move, mass=False), "free"])
                rows.append([scene.name, "straight, moved", *straight(document, move, mass=True), "< 0.1 %"])
            values = ", ".join(f"{name} {value:.3g}" for name, value in vars(done.shape).items())
            name = f"{type(done.shape).__name__.lower()}: {values}"
            change = f"{mass_change(done, assembly, assembly.labels):.2g}"
            rows.append([scene.name, name, f"{done.after.load_factor:.4g}", *bounds(done.after), change])
            print(rows[-1], flush=True)
    about = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    text = "# Joints with a shape\n\nWritten by `python -m benchmarks.joint_shapes`. " + about + "\n\n"
    head = ["structure", "joints", "λ by faces", "by fields, at least", "at most", "largest change of a block's mass"]
    text += table(head, rows)
    last = ["depth [m]", "along x", "pushed at 45°", "climbed", "broken, at most"]
    write("joint_shapes", text + SPACE + table(last, keys_in_space()))


if __name__ == "__main__":
    main()
