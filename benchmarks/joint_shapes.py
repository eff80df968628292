"""Measure what keys and waves gain over straight joints: ``python -m benchmarks.joint_shapes``.

Three structures pushed to either side, the worse counts: a block on a base, two courses of bricks on a base, and an
arch of nine voussoirs. Blocks of 2000 kg/m³ with σt = 0.3 MPa and τ = 0.5 MPa crack anywhere: λ is the lower bound by
fields. Straight joints are those drawn, and those that `jld move` finds. Then a key in space: a block on another, each
0.4 × 0.2 × 0.2 m, under 4 kN, with a tooth across its whole depth.
"""

from __future__ import annotations

import itertools
import json
from typing import Any, Final

import numpy as np

from benchmarks.common import table, write
from benchmarks.moving_joints import key
from jld_core import build_assembly, parse_scene, samples, solve
from jld_core.errors import InputError
from jld_core.geometry_optimisation.joint_shapes import Key, Shape, Sine
from jld_core.geometry_optimisation.optimise import move_joints
from jld_core.geometry_optimisation.shape_search import shape_joints
from jld_core.limit import LimitAnalysisResult
from jld_core.models import solve_by_fields

Document = dict[str, Any]

SECONDS: Final = 30.0
"""Time for each search, s."""

FIELDS: Final = 8.0
"""Time for the bounds by fields of each load case, s."""

SPACE: Final = (
    "\n\n## A key in space\n\nForce in kN that shears a key of 0.14 m at its root, with flanks of 0.01 m, by faces: "
    "crack planes at the roots of tooth and shoulders. Shallow keys are climbed, deep ones break, the best lies "
    "between.\n\n"
)
"""Text of the second table."""

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
        ({"name": "block", "elements": [base, _brick("up", 0.4, 0.8, 0.0, 0.2)], **common}, {}, [Key(0.1, 0.5, 0.05)]),
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


def _corners(outline: Any) -> np.ndarray[Any, Any]:
    """Return the corners (k, 2) of an outline, counter-clockwise, without those on straight edges."""
    ring = np.array(outline, dtype=float)
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    ring = ring[abs(turn) > 1e-12]
    return np.asarray(ring if turn.sum() > 0.0 else ring[::-1])


def in_space(document: Document, aside: float) -> Document:
    """Return the scene of `moving_joints.key` as solids, its force turned by `aside` degrees about the vertical."""
    thickness, elements = document["thickness"], []
    for entry in document["elements"]:
        ring = _corners(entry["polygon"])
        count = len(ring)
        vertices = [[float(x), y, float(z)] for y in (0.0, thickness) for x, z in ring]
        sides = [[(k + 1) % count, k, count + k, count + (k + 1) % count] for k in range(count)]
        faces = [list(range(count)), [2 * count - 1 - k for k in range(count)], *sides]
        elements.append({"id": entry["id"], "vertices": vertices, "faces": faces, "support": entry["support"]})
    angle, place = np.radians(aside), [0.0, 0.5 * thickness, 0.0]
    live = [{"element": "top", "force": [float(np.cos(angle)), float(np.sin(angle)), 0.0], "at": place}]
    loads = {"dead": [{"element": "top", "force": [0.0, 0.0, -4.0]}], "live": live}
    kept = {name: part for name, part in document.items() if name not in ("thickness", "move")}
    return {**kept, "elements": elements, "loads": loads}


def keys_in_space() -> list[list[str]]:
    """Return the rows of the table of keys of growing depth: λ in kN in the plane, in space, and pushed aside."""
    rows = []
    for depth in (0.01, 0.02, 0.03, 0.04, 0.06, 0.08):
        document = key(0.14, depth, 0.01)
        found = [solve(parse_scene(one)) for one in (document, *(in_space(document, angle) for angle in (0.0, 45.0)))]
        rows.append([f"{depth:g}", *(f"{one.load_factor:.6g}" for one in found)])
    return rows


def main() -> None:
    """Run all searches and write the table."""
    rows = []
    for document, move, shapes in structures():
        scene = parse_scene(document)
        assembly = build_assembly(scene)
        try:
            straight = move_joints(parse_scene({**document, "move": move}), assembly, assembly.labels, seconds=SECONDS)
            after = straight.after
            words = (f"{straight.value:.4g}", *bounds(after)) if after is not None else ("–", "–", "–")
        except InputError:
            words = ("no vertex moves", "–", "–")
        for k, shape in enumerate(shapes):
            done = shape_joints(scene, assembly, assembly.labels, shape, seconds=SECONDS)
            if k == 0:
                rows.append([scene.name, "as drawn", f"{done.before.load_factor:.4g}", *bounds(done.before)])
                rows.append([scene.name, "straight, moved", *words])
            values = ", ".join(f"{name} {value:.3g}" for name, value in vars(done.shape).items())
            name = f"{type(done.shape).__name__.lower()}: {values}"
            rows.append([scene.name, name, f"{done.after.load_factor:.4g}", *bounds(done.after)])
            print(rows[-1], flush=True)
    about = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    text = "# Joints with a shape\n\nWritten by `python -m benchmarks.joint_shapes`. " + about + "\n\n"
    text += table(["structure", "joints", "λ by faces", "by fields, at least", "at most"], rows)
    write(
        "joint_shapes",
        text + SPACE + table(["depth [m]", "in the plane", "in space", "pushed at 45°"], keys_in_space()),
    )


if __name__ == "__main__":
    main()
