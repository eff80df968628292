"""Mirror images have the same λ: a layout in a mirrored file, and layouts that a search merges.

Walls whose geometry is its own mirror image, under loads that are so or nearly so: patches of other widths, pressures
that rise one way, members on one side, forces at common corners of cells. Every case mirrors its file with a random
layout; layouts that the search merges as images of each other are compared besides.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from benchmarks.claims.tally import Tally, run_cases
from jld_core import Assembly, Scene, build_assembly, parse_scene, solve
from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.fields import bounds_by_fields
from jld_core.limit.bounds import apart
from jld_core.limit.options import Status
from jld_core.refinement import crack_cells
from jld_core.scene.cracks import CellCracks, FieldCracks
from jld_explore import search_space

CLAIM: Final = "Mirror images of layouts have the same λ under the model that answers, to 1e-9 by faces and by cells"

_LAYOUTS: Final = 3
"""Random layouts of one scene."""

DIGITS: Final = 1e-9
"""Largest relative difference of both bounds by faces and by cells."""

FIELD_DIGITS: Final = 1e-6
"""Largest difference of both bounds by fields, relative to the upper one, which solvers know less accurately."""

Document = dict[str, Any]


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random walls: see `run_cases`."""
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Return "" where images of a random layout have its λ, or where nothing is merged; else what differs."""
    rng = np.random.default_rng([seed, 49])
    kind = ("faces", "cells", "fields")[seed % 3]
    try:
        scene = parse_scene(wall(rng, kind))
        assembly = build_assembly(scene)
        space = search_space(scene, assembly)
    except InputError as error:
        return f"refused: {error}"
    group = space.group
    tally.count(f"{kind}: {'merged' if len(group) > 1 else 'told apart'}")
    labels = assembly.labels.copy()
    labels[: assembly.faces] = rng.random(assembly.faces) < 0.3
    problem = _differs_mirrored(scene, assembly, labels, kind, tally)
    if problem:
        return problem
    for _ in range(_LAYOUTS):
        labels = np.where(space.candidates, rng.random(len(space.fixed)) < 0.25, space.fixed)
        problem = _differs(scene, assembly, np.unique(labels[group], axis=0), kind)
        if problem:
            return problem
    return ""


def _differs(scene: Scene, assembly: Assembly, images: Bits, kind: str) -> str:
    """Return how λ of the images (k, m) of a layout differs; "" where it does not."""
    found = [_bracket(scene, assembly, labels) for labels in images]
    for status, bracket in found[1:]:
        if status != found[0][0]:
            return f"{kind}: status {found[0][0]} and {status}"
        first = found[0][1]
        if apart(bracket, first) or (kind != "fields" and abs(bracket[0] - first[0]) > DIGITS * abs(first[0])):
            return f"{kind}: {first} and {bracket}"
    return ""


def _differs_mirrored(scene: Scene, assembly: Assembly, labels: Bits, kind: str, tally: Tally) -> str:
    """Return how λ of a layout and that of its image in a mirrored file differ; "" where it does not."""
    image = parse_scene(mirrored(scene.model_dump(mode="json", exclude_defaults=True)))
    other = build_assembly(image)
    width = float(scene.grid.cell[0] * len(scene.grid.rows[0])) if scene.grid else 0.0
    place = {(round(x, 6), round(y, 6)): k for k, (x, y) in enumerate(other.interfaces.origin[: other.faces].tolist())}
    turned = other.labels.copy()
    for k, (x, y) in enumerate(assembly.interfaces.origin[: assembly.faces].tolist()):
        turned[place[round(width - x, 6), round(y, 6)]] = labels[k]
    (status, one), (same, two) = _bracket(scene, assembly, labels), _bracket(image, other, turned)
    if status != same:
        return f"{kind}, mirrored: status {status} and {same}"
    known = [abs(value) for value in (*one, *two) if np.isfinite(value)]
    away = max((abs(a - b) for a, b in zip(one, two, strict=True) if a != b), default=0.0) / max([*known, 1e-300])
    tally.count(f"{kind}, mirrored: {'beyond' if away > DIGITS else 'to'} 1e-9")
    return "" if away <= (FIELD_DIGITS if kind == "fields" else DIGITS) else f"{kind}, mirrored: {one} and {two}"


def mirrored(document: Document) -> Document:
    """Return the document of a wall with left and right exchanged."""
    rows = document["grid"]["rows"]
    across = len(rows[0])
    width = across * document["grid"]["cell"][0]

    def at(point: list[float]) -> list[float]:
        return [width - point[0], point[1]]

    def name(element: str) -> str:
        column, row = element[1:].split("r")
        return f"c{across - 1 - int(column)}r{row}"

    def load(entry: Document) -> Document:
        if "face" in entry:
            return {**entry, "face": {"along": [at(point) for point in entry["face"]["along"]]}}
        force = [-entry["force"][0], entry["force"][1]]
        return {**entry, "element": name(entry["element"]), "at": at(entry["at"]), "force": force}

    members = [
        {**one, **{key: {"element": name(one[key]["element"]), "at": at(one[key]["at"])} for key in ("from", "to")}}
        for one in document.get("members", [])
    ]
    return {
        **document,
        "grid": {**document["grid"], "rows": [row[::-1] for row in rows]},
        "loads": {"live": [load(entry) for entry in document["loads"]["live"]]},
        "members": members,
    }


def _bracket(scene: Scene, assembly: Assembly, labels: Bits) -> tuple[str, tuple[float, float]]:
    """Return status and bracket of one layout under the crack model of its scene."""
    if isinstance(scene.cracks, FieldCracks):
        bounds = bounds_by_fields(assembly, labels, gap=10.0)
        return "collapse", (bounds.lower, bounds.upper)
    if isinstance(scene.cracks, CellCracks):
        cells = crack_cells(scene, assembly, scene.cracks.cell)
        assembly, labels = cells.fine, cells.labels(labels)
    result = solve(assembly, labels)
    low, high = result.bracket
    return str(result.status), (low, high) if result.status is Status.COLLAPSE else (0.0, 0.0)


def wall(rng: np.random.Generator, kind: str) -> Document:
    """Return a lintel of 4 × 1 or 2 cells of 1 m, whose loads are their own mirror image or differ in one thing."""
    across, up = 4, int(rng.integers(1, 3))
    width, top = float(across), float(up + 1)
    odd = str(rng.choice(["nothing", "width", "size", "pressure", "member", "corner"]))
    reach = [float(rng.uniform(0.2, 0.6))] * 2
    size = [float(rng.uniform(1e3, 5e3))] * 2
    if odd == "width":
        reach[1] *= 0.05
    if odd == "size":
        size[1] *= 1.3
    live: list[Document] = []
    inset = 1.5 if odd == "corner" else 1.35  # four of the finer cells meet at 1.5
    places = [inset, width - inset]
    push = float(rng.uniform(0.1, 0.6))
    for side, x in enumerate(places):
        patch = {"width": reach[side]} if kind == "fields" else {}
        force = [push * size[side] * (1 - 2 * side), -size[side]]
        live.append({"element": f"c{int(x)}r0", "force": force, "at": [x, top], **patch})
    if kind != "fields" and (rng.random() < 0.5 or odd == "pressure"):
        value, half = float(rng.uniform(1e3, 5e3)), 0.45
        for side, (x, share) in enumerate(((1.5, 1.0), (width - 1.5, 0.2 if odd == "pressure" else 1.0))):
            # the same resultant on a shorter part of the face
            ends = [[x - share * half, top], [x + share * half, top]]
            live.append({"face": {"along": ends[:: 1 - 2 * side]}, "pressure": value / share})
    members: list[Document] = []
    if kind != "fields" and (rng.random() < 0.4 or odd == "member"):
        sides = [0] if odd == "member" else [0, 1]
        for side in sides:
            points = [[abs(side * width - x), y] for x, y in ([0.25, top - 0.25], [0.75, 0.5])]
            column = side * (across - 1)
            held = [f"c{column}r0", f"c{column}r{up}"]
            anchors = [{"element": name, "at": at} for name, at in zip(held, points, strict=True)]
            members.append({"kind": "tie", "from": anchors[0], "to": anchors[1], "tension": 3e3})
    inner = {"tensile_strength": 1e5, "shear_strength": 1.5e5}
    return {
        "grid": {"cell": [1.0, 1.0], "thickness": 1.0, "rows": ["a" * across] * up + ["#..#"]},
        "materials": {"density": 2000.0, "dry": {"friction_coefficient": float(rng.uniform(0.4, 0.8))}, "inner": inner},
        "loads": {"live": live},
        "members": members,
        "search": {"segmentation": False},
        "cracks": {"faces": "faces", "cells": {"kind": "cells", "cell": 0.5}, "fields": {"kind": "fields"}}[kind],
    }
