"""Bounds on λ over boxes of positions: above all samples, closed by branch and bound, and weighed by themselves."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from structures import HEIGHT, Document, flat_arch, flat_arch_load

from cases import ROUTE
from command import Command
from jld_core import build_assembly, parse_scene
from jld_core.arrays import Floats
from jld_geometry.box_bound import _Search, prove_box

PATHS = [{"at": [s * x, HEIGHT], "direction": [s, 0]} for x in (1.2, 0.2) for s in (1, -1)]
"""Paths of the tops of springings, then of the key's joints."""


def arch(count: int, **keys: object) -> Document:
    """The flat arch at 15° with tops that move by pairs."""
    return flat_arch(15.0, 1.2, 0.2, along=PATHS[: 2 * count], ties="mirror-x", **keys)


def search_of(document: Document) -> _Search:
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return _Search(scene, assembly, assembly.labels)


def test_a_bound_holds_for_every_position_of_its_box() -> None:
    """Random boxes of two parameters: no sample has a λ above the bound, and small boxes are tight."""
    search, random = search_of(arch(2)), np.random.default_rng(3)
    for width in (0.1, 0.01, 1e-3):
        low = random.uniform([0.0, 0.0], [0.15, 0.1])
        high = low + width
        bound = search.bound(low, high).value
        values = []
        for _ in range(4):
            result = search.try_position(random.uniform(low, high))
            assert result is not None
            values.append(result.load_factor)
        assert max(values) <= bound
    assert bound == pytest.approx(max(values), rel=1e-2)


def outline_of(search: _Search, loop: list[int], parameters: list[Fraction]) -> list[tuple[Fraction, Fraction]]:
    """Exact positions of the vertices of a loop."""
    places, directions = search.mesh.places, search.directions
    return [
        tuple(
            Fraction(float(places[v, k]))
            + sum(y * Fraction(float(d[v, k])) for y, d in zip(parameters, directions, strict=True))
            for k in (0, 1)
        )
        for v in loop
    ]  # type: ignore[misc]


def test_one_mechanism_proves_the_bound_in_rational_arithmetic() -> None:
    """At random positions of a box: every force at an end of a face works on u, and −b·u ≤ bound · b_λ·u, exactly.

    Nothing of the program's geometry, loads or rounding enters but u, the bound and the vertices.
    """
    search, random = search_of(arch(2)), np.random.default_rng(7)
    low, high = np.array([0.05, 0.0]), np.array([0.1, 0.04])
    found = search.bound(low, high)
    assert found.velocity is not None
    assembly, mesh = search.problems[0]._assembly, search.mesh
    elements, faces = assembly.elements, assembly.interfaces
    velocity = {int(e): found.velocity[3 * k : 3 * k + 3] for k, e in enumerate(elements.free)}
    size = Fraction(assembly.size)

    def speed(element: int, point: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
        """Exact velocity of a point of an element; u turns by its third component over the size."""
        if element not in velocity:
            return Fraction(0), Fraction(0)
        x, y, turn = (Fraction(float(v)) for v in velocity[element])
        centre = [Fraction(float(v)) for v in elements.centroid[element]]
        return x - turn / size * (point[1] - centre[1]), y + turn / size * (point[0] - centre[0])

    for _ in range(5):
        at = [Fraction(float(y)) for y in random.uniform(low, high)]
        for face in range(len(faces)):
            p, q = outline_of(search, mesh.ends[face].tolist(), at)
            edge = (q[0] - p[0], q[1] - p[1])
            friction = Fraction(float(assembly.strengths(ROUTE).friction[face]))
            for end in (p, q):
                jumps = [speed(int(side[face]), end) for side in (faces.a, faces.b)]
                gap = (jumps[1][0] - jumps[0][0], jumps[1][1] - jumps[0][1])
                for sign in (-1, 1):
                    force = (edge[1] + sign * friction * edge[0], -edge[0] + sign * friction * edge[1])
                    assert force[0] * gap[0] + force[1] * gap[1] >= 0
        weight = Fraction(0)
        for element in velocity:
            corners = outline_of(search, mesh.loops[element].tolist(), at)
            pairs = list(zip(corners, corners[1:] + corners[:1], strict=True))
            turns = [a[0] * b[1] - a[1] * b[0] for a, b in pairs]
            area = sum(turns) / 2
            centre = tuple(
                sum((a[k] + b[k]) * t for (a, b), t in zip(pairs, turns, strict=True)) / (6 * area) for k in (0, 1)
            )
            weight += area * Fraction(1000.0 * 9.81) * speed(element, centre)[1]
        live = -speed(elements.index["key"], (Fraction(0), Fraction(HEIGHT)))[1]
        assert 0 < weight <= Fraction(found.value) * live


def test_springing_of_the_flat_arch_is_proven() -> None:
    """One parameter to 1e-3: λ rises with the skew, so that the end of the box is best, with λ of (11.8)."""
    scene = parse_scene(arch(1))
    assembly = build_assembly(scene)
    done = prove_box(scene, assembly, assembly.labels, (np.array([-0.15]), np.array([0.1])))
    assert done.proven
    assert done.gap <= 1e-3
    assert done.load_factor <= done.bound
    best = max(flat_arch_load(1.2 + y, 0.2, 0.1) for y in np.linspace(-0.15, 0.1, 11))
    assert done.bound >= best * (1.0 - 1e-9)
    assert done.load_factor == pytest.approx(best, rel=1e-3)


def test_boxes_without_a_position_that_stands_are_closed() -> None:
    """At 10° flat springings slide under the dead load alone: the bound says that nothing stands there."""
    document = flat_arch(10.0, 1.05, 0.2, along=[{"at": [s * 1.05, HEIGHT], "direction": [s, 0]} for s in (1, -1)])
    document["move"] |= {"ties": "mirror-x"}
    assert search_of(document).bound(np.array([-0.005]), np.array([0.005])).value == -math.inf


def points(values: Floats) -> str:
    return ",".join(map(str, values))


@pytest.mark.parametrize(
    ("count", "box", "said"),
    [
        (1, "2.0", "turns element"),
        (1, "0", "the box has no width"),
        (1, "a,b", "is no box"),
        (2, "-0.1,0.1", "1 pairs of ends are given for 2 parameters"),
        (0, "0.1", "parameters are too many"),
    ],
)
def test_bad_boxes_are_one_line(count: int, box: str, said: str, tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "arch.json"
    document = arch(count)
    if not count:
        document["move"]["ties"] = "none"
    file.write_text(json.dumps(document))
    done = jld("move", file, "-o", tmp_path / "out.json", f"--prove={box}")
    assert (done.code, done.out) == (2, "")
    assert said in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]


def test_inner_faces_are_refused(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "arch.json"
    document = arch(1)
    document["materials"]["inner"] = {"tensile_strength": 1e5, "shear_strength": 1e5}
    document["labels"] = {"inner": [["pier left", "ground"]]}
    file.write_text(json.dumps(document))
    done = jld("move", file, "-o", tmp_path / "out.json", "--prove", "0.05")
    assert done.code == 2
    assert "dry joints alone" in done.err


def test_the_command_prints_both_bounds(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "arch.json", tmp_path / "best.json"
    file.write_text(json.dumps(arch(1)))
    facts = json.loads(jld("move", file, "-o", out, "--prove=-0.15,0.1", "--gap", "0.01", "--json").out)
    assert facts["load_factor"] <= facts["bound"] <= 1.01 * facts["load_factor"]
    assert facts["proven"] is True
    assert facts["start"] == pytest.approx(flat_arch_load(1.2, 0.2, 0.1), rel=1e-6)
    assert out.exists()


@pytest.mark.parametrize(
    ("more", "flags", "said"),
    [
        ({}, ["--cracks", "fields"], "it bounds λ of blocks that crack along faces alone"),
        ({"cracks": {"kind": "cells", "cell": 0.1}}, [], "it bounds λ of blocks that crack along faces alone"),
        ({"fill": {"level": 2.0, "density": 1.0, "friction_angle": 0.0, "active": 0, "passive": 0}}, [], "fill"),
        ({"materials": {"density": 1e3, "dry": {"friction_coefficient": 1e-3}}}, [], "no position in the box"),
    ],
)
def test_a_refused_proof_prints_nothing(
    more: Document, flags: list[str], said: str, tmp_path: Path, jld: Command
) -> None:
    """Nothing on stdout, one line on stderr and no file, also where the search finds no position that stands."""
    file = tmp_path / "arch.json"
    file.write_text(json.dumps({**arch(1), **more}))
    done = jld("move", file, "-o", tmp_path / "out.json", "--prove", "0.01", *flags)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert said in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]
