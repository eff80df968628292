"""Random small scenes for `benchmarks.trust_trials`: supports, holes, materials with every strength, limits of every
kind, kept labels, slits, layouts that can be laid, load cases, and space."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_explore.space import SearchSpace, search_space

MOST: Final = 11
"""Faces that may change, at the most: 2 048 labellings."""

_FEW: Final = 6
"""Faces below which a scene is drawn again, the oftener the fewer: one or two leave little to be wrong about."""


def drawn(seed: int) -> tuple[Scene, SearchSpace, list[str], np.random.Generator, dict[str, Any]]:
    """The scene of a seed: the first that its numbers draw which is a scene, and small enough."""
    rng = np.random.default_rng(seed)
    while True:
        document, kinds = draw(rng)
        try:
            scene = parse_scene(document)
            space = search_space(scene, build_assembly(scene))
        except InputError:
            continue
        faces = int(space.candidates.sum())
        if faces <= MOST and rng.random() * _FEW < faces:
            return scene, space, kinds, rng, document


def draw(rng: np.random.Generator) -> tuple[dict[str, Any], list[str]]:
    """A scene document, and words for what it has."""
    kinds: list[str] = []
    spatial = rng.random() < 0.15
    dry: dict[str, Any] = {"friction_coefficient": float(rng.choice([0.0, 0.3, 0.75, 1.5], p=[0.05, 0.25, 0.6, 0.1]))}
    strength = float(rng.choice([0.0, 5e2, 2e3, 1e4, 1e6], p=[0.1, 0.25, 0.3, 0.25, 0.1]))
    inner: dict[str, Any] = {
        "tensile_strength": strength,
        "shear_strength": strength * float(rng.choice([0.5, 1.0, 2.0])),
    }
    if rng.random() < 0.2:
        dry["cohesion"] = 500.0
        kinds.append("cohesion")
    if rng.random() < 0.2 and strength:
        inner["friction_coefficient"] = 0.9 * inner["shear_strength"] / strength
        kinds.append("inner friction")
    if rng.random() < 0.3:
        # crushing of dry faces asks for that of inner ones nowhere
        which = rng.integers(1, 4)
        if which & 1:
            dry["compressive_strength"] = float(rng.choice([2e4, 2e5]))
        if which & 2:
            inner["compressive_strength"] = float(rng.choice([2e4, 2e5]))
        kinds.append("crushing")
    document: dict[str, Any] = {
        "name": "trial",
        "materials": {"density": 1400, "dry": dry, "inner": inner},
        "search": _limits(rng, spatial, kinds),
    }
    if spatial:
        kinds.append("space")
        cells = [(i, j, k) for i in range(2) for j in range(rng.integers(1, 3)) for k in range(rng.integers(1, 3))]
        document["elements"] = [
            _box("ground", (0, 0, -1), (2, 2, 1), True),
            *(_box(f"b{i}{j}{k}", (i, j, k)) for i, j, k in cells),
        ]
        names = [f"b{i}{j}{k}" for i, j, k in cells]
    else:
        rows = _rows(rng, kinds)
        document["grid"] = {"cell": [0.1, float(rng.choice([0.05, 0.1, 0.2]))], "thickness": 0.1, "rows": rows}
        names = [f"c{x}r{y}" for y, row in enumerate(rows) for x, letter in enumerate(row) if letter == "a"]
    document["loads"] = _loads(rng, names, spatial, kinds)
    if rng.random() < 0.2:
        document["labels"] = {"default": "inner"}
    return document, kinds


def _rows(rng: np.random.Generator, kinds: list[str]) -> list[str]:
    across, up = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    rows = [["a"] * across for _ in range(up)]
    if rng.random() < 0.25 and across > 2 and up > 1:
        rows[-1][1] = "."
        kinds.append("holes")
    foot = ["#"] * across
    if rng.random() < 0.25:
        kinds.append("between abutments")
        return ["#" + "".join(row) + "#" for row in rows]
    if rng.random() < 0.3 and across > 2:
        foot = ["#", *["."] * (across - 2), "#"]
        kinds.append("bearings")
    return ["".join(row) for row in [*rows, foot]]


def _box(
    name: str, low: tuple[int, int, int], size: tuple[int, int, int] = (1, 1, 1), support: bool = False
) -> dict[str, Any]:
    x, y, z = (0.1 * v for v in low)
    a, b, c = (0.1 * (v + s) for v, s in zip(low, size, strict=True))
    corners = [[x, y, z], [a, y, z], [a, b, z], [x, b, z], [x, y, c], [a, y, c], [a, b, c], [x, b, c]]
    faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return {"id": name, "vertices": corners, "faces": faces, "support": support}


def _loads(rng: np.random.Generator, names: list[str], spatial: bool, kinds: list[str]) -> dict[str, Any]:
    def live() -> list[dict[str, Any]]:
        if rng.random() < 0.6:
            body = [float(rng.choice([-1.0, 1.0])), float(rng.choice([0.0, 0.0, 0.4, -0.5]))]
            return [{"body": [*body, 0.0] if spatial else body}]
        force = [float(rng.choice([0.0, 1.0])), -1.0]
        return [{"element": str(rng.choice(names)), "force": [force[0], 0.0, -1.0] if spatial else force}]

    if rng.random() < 0.2:
        kinds.append("cases")
        return {
            "cases": [
                {"name": name, "live": live(), "required": float(rng.choice([1.0, 1.5]))} for name in ("one", "two")
            ]
        }
    return {"live": live()}


def _limits(rng: np.random.Generator, spatial: bool, kinds: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    low, high = sorted(int(v) for v in rng.integers(1, 5, 2))
    unit = 0.001 if spatial else 0.0005
    known: dict[str, Any] = {
        "block_cells": [None if rng.random() < 0.6 else low, high],
        "block_extent": [None, float(rng.choice([0.1, 0.2, 0.3]))],
        "block_mass": [None, 1400 * unit * high * 2.0],
        "block_weight": [9.81 * 1400 * unit * float(rng.choice([0.5, 1.5])), None],
        "block_aspect": [None, float(rng.choice([1.5, 2.0, 3.0]))],
        "convex_blocks": True,
        "blocks": [int(rng.integers(1, 4)), int(rng.integers(4, 8))],
        "dry_faces": [int(rng.integers(0, 4)), int(rng.integers(4, 12))],
        "shapes": [None, int(rng.integers(1, 4))],
    }
    for key in rng.permutation(list(known)).tolist()[: int(rng.choice([0, 1, 1, 1, 2, 2, 3]))]:
        if not (spatial and key in ("block_aspect", "convex_blocks")):
            found[key] = known[key]
            kinds.append(key)
    if rng.random() < 0.15:
        found["segmentation"] = False
        kinds.append("slits")
    if rng.random() < 0.15:
        found["candidates"] = "all+supports"
        kinds.append("supports")
    if rng.random() < 0.2:
        found["symmetry"] = "none"
    if rng.random() < 0.1 and "segmentation" not in found:
        found["assemble"] = "translation"
        kinds.append("laid")
    return found
