"""Bounds on λ over boxes of positions: above all samples, closed by branch and bound, and weighed by themselves."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from structures import HEIGHT, Document, flat_arch, flat_arch_load

from cases import ROUTE
from command import Command, saved
from jld_core import InputError, build_assembly, parse_scene
from jld_geometry import (
    BoxStructure,
    box_claim,
    boxes,
    check_boxes,
    check_proof,
    prove_box,
    verify_box,
    write_box_certificate,
)
from jld_geometry.box_bound import _Search

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
    ]


def test_one_mechanism_proves_the_bound_in_rational_arithmetic() -> None:
    """At random positions of a box: every force at an end of a face works on u, and −b·u ≤ bound · b_λ·u, exactly.

    Nothing of the program's geometry, loads or rounding enters but u, the bound and the vertices.
    """
    search, random = search_of(arch(2)), np.random.default_rng(7)
    low, high = np.array([0.05, 0.0]), np.array([0.1, 0.04])
    found = search.bound(low, high)
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
    jld("move", file, "-o", tmp_path / "out.json", f"--prove={box}").refused(said)
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]


def test_inner_faces_are_refused(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "arch.json"
    document = arch(1)
    document["materials"]["inner"] = {"tensile_strength": 1e5, "shear_strength": 1e5}
    document["labels"] = {"inner": [["pier left", "ground"]]}
    file.write_text(json.dumps(document))
    jld("move", file, "-o", tmp_path / "out.json", "--prove", "0.05").refused("dry joints alone")


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
    file = saved(tmp_path / "arch.json", {**arch(1), **more})
    jld("move", file, "-o", tmp_path / "out.json", "--prove", "0.01", *flags).refused(said)
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]


# Certificates of proofs over boxes: written, checked exactly, and refused when one number is not what it was.


ENDS = ((1.2, HEIGHT), (0.2, HEIGHT))
"""Tops of the springing and of the key's joint of the flat arch."""


def arch_of_certificate(parameters: int, phi: float = 15.0) -> Document:
    along = [{"at": [s * x, y], "direction": [s, 0]} for x, y in ENDS[:parameters] for s in (1, -1)]
    return flat_arch(phi, 1.2, 0.2, along=along, ties="mirror-x")


def proof(parameters: int, low: list[float], high: list[float], gap: float) -> Any:
    scene = parse_scene(arch_of_certificate(parameters))
    assembly = build_assembly(scene)
    return prove_box(scene, assembly, assembly.labels, (np.array(low), np.array(high)), gap=gap)


@pytest.fixture(scope="module")
def done() -> Any:
    return proof(2, [-0.1, -0.05], [0.1, 0.05], 0.1)


def whole_again(lines: list[dict[str, Any]]) -> bytes:
    """The bytes of a certificate with these lines and a digest that fits, as one who means harm would write it."""
    text = "".join(json.dumps(line) + "\n" for line in lines).encode()
    return text + json.dumps({"sha256": hashlib.sha256(text).hexdigest()}).encode() + b"\n"


def test_a_proof_passes_and_holds_the_closed_form(done: Any, tmp_path: Path) -> None:
    """λ rises with both half widths as long as hinges rule: the bound lies above (11.8) at the corner of the box."""
    passed, _, reason = check_proof(done)
    assert (passed, reason) == (True, "")
    file = tmp_path / "proof.jld"
    write_box_certificate(done, file)
    found = verify_box(file, parse_scene(arch_of_certificate(2)))
    assert found.boxes == sum(isinstance(node, boxes.Leaf) for node in boxes.read(file)[1]) > 3
    best = flat_arch_load(1.3, 0.25, 0.1)
    assert best <= found.claim.bound == pytest.approx(done.bound, rel=2e-9)
    assert found.claim.bound < 1.2 * best


def test_polynomials_of_outlines_are_those_of_the_moved_outline(done: Any) -> None:
    """Area and first moments at random positions against the outline itself, exactly."""
    claim, _ = box_claim(done)
    structure = BoxStructure(done.stated, claim)
    low, high = ([Fraction(ends[k]) for ends in claim.box] for k in (0, 1))
    at = [Fraction(1, 3), Fraction(5, 7)]
    y = [a + share * (b - a) for a, b, share in zip(low, high, at, strict=True)]

    def value(polynomial: dict[tuple[int, ...], Any]) -> Fraction:
        return sum(c * at[0] ** i * at[1] ** j for (i, j), c in polynomial.items())

    for element in sorted(structure.changing):
        corners = []
        for point in structure.outlines[element]:
            ways = [dict(motion).get(point, (0.0, 0.0)) for motion in claim.directions]
            corners.append(
                [Fraction(point[k]) + sum(Fraction(w[k]) * s for w, s in zip(ways, y, strict=True)) for k in (0, 1)]
            )
        turns = [a[0] * b[1] - a[1] * b[0] for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
        area, first_x, first_y = structure.moments(element, low, high)
        assert value(area) == sum(turns) / 2
        pairs = list(zip(corners, corners[1:] + corners[:1], turns, strict=True))
        assert [value(first_x), value(first_y)] == [sum((a[k] + b[k]) * t for a, b, t in pairs) / 6 for k in (0, 1)]


def test_signs_by_bernstein_coefficients() -> None:
    """(x − 1/2)² + e is positive, and proven so only where its coefficients (1/4 + e, e − 1/4, 1/4 + e) are."""
    for extra, proven in ((Fraction(1, 4), True), (Fraction(1, 5), False)):
        square = {(2,): Fraction(1), (1,): Fraction(-1), (0,): Fraction(1, 4) + extra}
        assert boxes.is_at_least_zero(square, 1, 2) is proven
    assert boxes.is_at_least_zero({}, 1, 2)
    assert not boxes.is_at_least_zero({}, 1, 2, strictly=True)
    assert not boxes.is_at_least_zero({(0, 0): -1}, 2, 2)
    assert not boxes.is_at_least_zero({(1, 1): 1, (0, 0): Fraction(-1, 100)}, 2, 3)


def wider(claim: Any) -> Any:
    return replace(claim, box=((claim.box[0][0], claim.box[0][1] + 0.02), *claim.box[1:]))


def rougher(claim: Any) -> Any:
    dry = {"friction_angle": 15.5}
    return replace(claim, scene={**claim.scene, "materials": {**claim.scene["materials"], "dry": dry}})


def heavier(claim: Any) -> Any:
    elements = [{**one, "density": 1010.0} if "pier" in one["id"] else one for one in claim.scene["elements"]]
    return replace(claim, scene={**claim.scene, "elements": elements})


def farther(claim: Any) -> Any:
    first = claim.directions[0]
    (point, way), *others = first
    return replace(claim, directions=(((point, (1.2 * way[0], way[1])), *others), *claim.directions[1:]))


CLAIMS: list[Callable[[Any], Any]] = [
    lambda claim: replace(claim, bound=0.98 * claim.bound),
    wider,
    rougher,
    heavier,
    farther,
]
"""Claims of which one number is not that of the proof."""


@pytest.mark.parametrize("change", CLAIMS)
def test_a_claim_with_another_number_is_refused(done: Any, change: Callable[[Any], Any]) -> None:
    claim, nodes = box_claim(done)
    changed = change(claim)
    with pytest.raises(InputError, match="node"):
        check_boxes(parse_scene(changed.scene), changed, nodes)


def test_a_claim_whose_scene_has_fill_is_refused() -> None:
    """A block that tips at λ = 1, under soil whose weight makes it slide at 2.7: the proof knows no soil."""
    elements = [
        {"id": "ground", "polygon": [[-1, -1], [1, -1], [1, 0], [0, 0], [-1, 0]], "support": True},
        {"id": "block", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
    ]
    scene: Document = {
        "elements": elements,
        "interfaces": [{"elements": ["ground", "block"], "polygon": [[0, 0], [1, 0]]}],
        "materials": {"density": 1000, "gravity": 10, "dry": {"friction_coefficient": 0.9}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    claim, tree = (
        boxes.BoxClaim(scene, 1.01, ((0.0, 0.01),), ((((1.0, 1.0), (0.0, 0.0)),),)),
        [boxes.Leaf(0, 0, {1: (0, 1, -1)})],
    )
    assert check_boxes(parse_scene(scene), claim, tree) == 1
    soil = {"level": 2.0, "density": 2000, "friction_angle": 30, "passive": 0, "active": 0, "passive_cohesion": 0}
    with pytest.raises(InputError, match="fill"):
        check_boxes(parse_scene(scene | {"fill": soil}), claim, tree)


def tight(scene: Any, claim: Any, nodes: list[Any]) -> int:
    """Number of the node on which the bound rests: a bound a little lower is refused there."""
    with pytest.raises(InputError) as refused:
        check_boxes(scene, replace(claim, bound=(1.0 - 1e-6) * claim.bound), nodes)
    return int(refused.value.where.removeprefix("node ")) - 1


def test_a_tree_with_another_number_is_refused(done: Any) -> None:
    """Splits, and every velocity of the leaf that the bound rests on, changed by a hundredth of the largest."""
    claim, nodes = box_claim(done)
    scene = parse_scene(claim.scene)
    splits = [k for k, node in enumerate(nodes) if isinstance(node, boxes.Split)]
    leaf = tight(scene, claim, nodes)

    def refused(changed: list[Any]) -> bool:
        try:
            check_boxes(scene, claim, changed)
        except InputError:
            return True
        return False

    assert not refused(nodes)
    for k in splits:
        one = nodes[k]
        assert isinstance(one, boxes.Split)
        assert refused([*nodes[:k], replace(one, at=10.0), *nodes[k + 1 :]])
        assert refused([*nodes[:k], replace(one, axis=7), *nodes[k + 1 :]])
    assert refused(nodes[:-1])
    assert refused([*nodes, nodes[-1]])
    one = nodes[leaf]
    assert isinstance(one, boxes.Leaf)
    assert refused([*nodes[:leaf], replace(one, case=1), *nodes[leaf + 1 :]])
    outcome = []
    for element, velocity in one.moves.items():
        for part in range(3):
            for sign in (1, -1):
                changed = list(velocity)
                changed[part] += sign * max(abs(v) for v in velocity) // 100
                moves = {**one.moves, element: tuple(changed)}
                outcome.append(refused([*nodes[:leaf], replace(one, moves=moves), *nodes[leaf + 1 :]]))
    # the search bounds load and weight apart, so that a few changes leave the exact balance below the bound
    assert outcome.count(False) <= 0.25 * len(outcome)


def test_a_file_that_was_altered_is_refused(done: Any, tmp_path: Path) -> None:
    file = tmp_path / "proof.jld"
    write_box_certificate(done, file)
    text = file.read_bytes()
    lines = [json.loads(line) for line in text.splitlines()[:-1]]
    digits = [k for k, byte in enumerate(text) if chr(byte).isdigit()]
    for k in digits[:: len(digits) // 40]:
        other = b"1" if text[k : k + 1] != b"1" else b"2"
        file.write_bytes(text[:k] + other + text[k + 1 :])
        with pytest.raises(InputError):
            verify_box(file)
    head = lines[0]
    for key, value, said in (
        ("bound", None, "no box certificate"),
        ("box", [[0.1, 0.0], [0.0, 0.1]], "no box certificate"),
        ("load_factor", None, "no box certificate"),
        ("jld box certificate", 2, "it is of version 2"),
        ("directions", [[[[9.0, 9.0], [1.0, 0.0]]], []], "is no corner of an element"),
    ):
        file.write_bytes(whole_again([{**head, key: value}, *lines[1:]]))
        with pytest.raises(InputError, match=said):
            verify_box(file)
    for changed in ({"dry": {**head["scene"]["materials"]["dry"], "cohesion": 5.0}},):
        scene = {**head["scene"], "materials": {**head["scene"]["materials"], **changed}}
        file.write_bytes(whole_again([{**head, "scene": scene}, *lines[1:]]))
        with pytest.raises(InputError, match="unknown to certificates of boxes"):
            verify_box(file)


def test_the_command_writes_and_verifies(tmp_path: Path, jld: Command) -> None:
    file, out, certificate = (tmp_path / name for name in ("arch.json", "best.json", "proof.jld"))
    file.write_text(json.dumps(arch_of_certificate(1)))
    facts = json.loads(
        jld("move", file, "-o", out, "--prove=-0.15,0.1", "--gap=0.01", "--json", "--certificate", certificate).out
    )
    assert facts["proven"] is True
    assert facts["proof_check"]["passed"] is True
    found = json.loads(jld("verify", certificate, "--scene", file, "--json").out)
    assert found["bound"] == pytest.approx(facts["bound"], rel=2e-9)
    assert found["box"] == [[-0.15, 0.1]]
    assert "no position of the joints" in jld("verify", certificate).out
    other = saved(tmp_path / "other.json", arch_of_certificate(1, 16.0))
    jld("verify", certificate, "--scene", other).refused("it is of another scene")


def test_bad_input_of_the_command_is_one_line(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "arch.json", tmp_path / "best.json"
    file.write_text(json.dumps(arch_of_certificate(1)))
    for options, said in (
        (["--certificate", tmp_path / "p.jld"], "none is asked for"),
        (["--prove=0.1", "--certificate", tmp_path], "it is a folder"),
        (["--prove=0.1", "--certificate", tmp_path / "none" / "p.jld"], "its folder does not exist"),
        (["--prove=0.1", "--certificate", file], "it is the file that is read"),
        (["--prove=0.1", "--certificate", out], "is written already"),
    ):
        jld("move", file, "-o", out, *options).refused(said)
    assert [path.name for path in tmp_path.iterdir()] == ["arch.json"]
