"""Where planar elements touch, what they weigh and what pushes them: against what plain geometry says.

Lengths, places and normals are worked out by hand for each figure; tolerance 1e-12 of the figure's size unless a
figure is inexact on purpose.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import ELL, ROUTE, mirrored, prism, rotated, rotation, stools
from cases import assembly_in_space as assembly_in_space
from cases import box as box_in_space
from cases import scene_in_space as scene
from cases import split_in_triangles as split
from cases import wall_in_space as wall
from jld_core import Assembly, InputError, build_assembly, parse_scene
from jld_core.geometry import outlines as polygons
from jld_core.geometry import planar_contacts

Document = dict[str, Any]
Points = list[list[float]]


def box(x0: float, y0: float, x1: float, y1: float) -> Points:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def document(shapes: dict[str, Points], **more: Any) -> Document:
    """A scene of these elements, the first one the support, each of weight 1."""
    elements: list[Document] = [{"id": n, "polygon": p, "weight": 1.0} for n, p in shapes.items()]
    elements[0]["support"] = True
    base: Document = {
        "elements": elements,
        "materials": {"gravity": [0.0, -9.81], "dry": {"friction_coefficient": 0.5}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    return {**base, **more}


def assembly(shapes: dict[str, Points], **more: Any) -> Assembly:
    return build_assembly(parse_scene(document(shapes, **more)))


def contacts(found: Assembly) -> set[tuple[str, str, float, float, float, float, float]]:
    """Per interface its elements in alphabetical order, mid-point, length and the normal from first to second."""
    ids, faces = found.elements.ids, found.interfaces
    rows = set()
    for k in range(len(faces)):
        a, b, normal = ids[faces.a[k]], ids[faces.b[k]], faces.normal[k]
        if a > b:
            a, b, normal = b, a, -normal
        numbers = (round(float(v), 9) + 0.0 for v in (*faces.origin[k], faces.l1[k], *normal))
        rows.add((a, b, *numbers))
    return rows


FIGURES: dict[str, tuple[dict[str, Points], set[Any]]] = {
    "two boxes, edge on edge": ({"a": box(0, 0, 1, 1), "b": box(1, 0, 2, 1)}, {("a", "b", 1.0, 0.5, 1.0, 1.0, 0.0)}),
    "partial overlap": ({"a": box(0, 0, 4, 1), "b": box(3, 1, 6, 2)}, {("a", "b", 3.5, 1.0, 1.0, 0.0, 1.0)}),
    "T-junction: one above two": (
        {"a": box(0, 0, 2, 1), "b": box(2, 0, 4, 1), "c": box(1, 1, 3, 2)},
        {("a", "b", 2.0, 0.5, 1.0, 1.0, 0.0), ("a", "c", 1.5, 1.0, 1.0, 0.0, 1.0), ("b", "c", 2.5, 1.0, 1.0, 0.0, 1.0)},
    ),
    "hanging corners on both sides": (
        {"a": box(0, 0, 3, 1), "b": box(1, 1, 2, 2), "c": box(-1, 2, 1.25, 3), "d": box(1.25, 2, 4, 3)},
        {
            ("a", "b", 1.5, 1.0, 1.0, 0.0, 1.0),
            ("b", "c", 1.125, 2.0, 0.25, 0.0, 1.0),
            ("b", "d", 1.625, 2.0, 0.75, 0.0, 1.0),
            ("c", "d", 1.25, 2.5, 1.0, 1.0, 0.0),
        },
    ),
    "L around a block: two faces, the centroid of L nearly on one of them": (
        {"L": [[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]], "b": box(1, 1, 2, 2)},
        {("L", "b", 1.0, 1.5, 1.0, 1.0, 0.0), ("L", "b", 1.5, 1.0, 1.0, 0.0, 1.0)},
    ),
    "U around a block: three faces": (
        {"U": [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]], "b": box(1, 1, 2, 3)},
        {
            ("U", "b", 1.0, 1.5, 1.0, 1.0, 0.0),
            ("U", "b", 2.0, 1.5, 1.0, -1.0, 0.0),
            ("U", "b", 1.5, 1.0, 1.0, 0.0, 1.0),
        },
    ),
    # the hook reaches over the block and rests on it: its centroid lies below the face it rests with
    "normal against the difference of centroids": (
        {"b": box(0, 0, 1, 3), "hook": [[0, 3], [2, 3], [2, -9], [3, -9], [3, 4], [0, 4]]},
        {("b", "hook", 0.5, 3.0, 1.0, 0.0, 1.0)},
    ),
    "two faces in one line, a notch between them": (
        {"a": [[0, 0], [3, 0], [3, 1], [2, 1], [2, 0.5], [1, 0.5], [1, 1], [0, 1]], "b": box(0, 1, 3, 2)},
        {("a", "b", 0.5, 1.0, 1.0, 0.0, 1.0), ("a", "b", 2.5, 1.0, 1.0, 0.0, 1.0)},
    ),
    "redundant vertices in straight edges on both sides": (
        {
            "a": [[0, 0], [3, 0], [3, 1], [2.2, 1], [1, 1], [0.1, 1], [0, 1]],
            "b": [[0, 1], [0.7, 1], [1, 1], [2.9, 1], [3, 1], [3, 2], [0, 2]],
        },
        {("a", "b", 1.5, 1.0, 3.0, 0.0, 1.0)},
    ),
    "redundant vertex at the start of the outline": (
        {"a": [[1.5, 1], [0, 1], [0, 0], [3, 0], [3, 1]], "b": [[1, 1], [3, 1], [3, 2], [0, 2], [0, 1]]},
        {("a", "b", 1.5, 1.0, 3.0, 0.0, 1.0)},
    ),
    "clockwise outlines": (
        {"a": box(0, 0, 4, 1)[::-1], "b": box(3, 1, 6, 2)[::-1]},
        {("a", "b", 3.5, 1.0, 1.0, 0.0, 1.0)},
    ),
    "a bend in the contact": (
        {"a": [[0, 0], [4, 0], [4, 1], [2, 2], [0, 1]], "b": [[0, 1], [2, 2], [4, 1], [4, 3], [0, 3]]},
        {
            ("a", "b", 1.0, 1.5, round(5**0.5, 9), round(-1 / 5**0.5, 9), round(2 / 5**0.5, 9)),
            ("a", "b", 3.0, 1.5, round(5**0.5, 9), round(1 / 5**0.5, 9), round(2 / 5**0.5, 9)),
        },
    ),
    "corners that only touch": (
        {"a": box(0, 0, 4, 1), "b": box(0, 1, 1, 2), "c": box(1, 2, 2, 3), "d": box(0, 2, 1, 3)},
        {
            ("a", "b", 0.5, 1.0, 1.0, 0.0, 1.0),
            ("b", "d", 0.5, 2.0, 1.0, 0.0, 1.0),
            ("c", "d", 1.0, 2.5, 1.0, -1.0, 0.0),
        },
    ),
    # the tip stands on the middle of an edge: a point is no contact; b is held from the side
    "a corner on an edge": (
        {
            "a": box(0, 0, 4, 1),
            "b": [[2, 1], [3, 2], [1, 2]],
            "c": box(1, 2, 3, 3),
            "d": [[4, 0], [5, 0], [5, 3], [3, 3], [3, 2], [4, 2]],
        },
        {("a", "d", 4.0, 0.5, 1.0, 1.0, 0.0), ("b", "c", 2.0, 2.0, 2.0, 0.0, 1.0), ("c", "d", 3.0, 2.5, 1.0, 1.0, 0.0)},
    ),
}


@pytest.mark.parametrize("name", FIGURES)
def test_figure(name: str) -> None:
    shapes, expected = FIGURES[name]
    assert contacts(assembly(shapes)) == expected


@pytest.mark.sampled(4)
@pytest.mark.parametrize("degrees", [30.0, 45.0, 137.3, 270.0])
@pytest.mark.parametrize("name", FIGURES)
def test_turned_figure(name: str, degrees: float) -> None:
    """The figure turned and moved far away has the same contacts, turned and moved."""
    shapes, expected = FIGURES[name]
    found = build_assembly(parse_scene(rotated(document(shapes), degrees, (50.0, -20.0))))
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[c, -s], [s, c]])
    left = sorted((*row[:2], row[4]) for row in contacts(found))
    right = sorted((*row[:2], row[4]) for row in expected)
    assert [row[:2] for row in left] == [row[:2] for row in right]
    assert [row[2] for row in left] == pytest.approx([row[2] for row in right], rel=1e-9)
    for a, b, x, y, _, nx, ny in expected:
        origin, normal = turn @ [x, y] + [50.0, -20.0], turn @ [nx, ny]
        near = [
            row
            for row in contacts(found)
            if row[:2] == (a, b)
            and np.allclose(row[2:4], origin, atol=1e-8)
            and np.allclose(row[5:], normal, atol=1e-8)
        ]
        assert len(near) == 1


@pytest.mark.parametrize("name", FIGURES)
def test_mirrored_figure(name: str) -> None:
    """Mirrored outlines run the other way round; contacts are mirrored and nothing else."""
    shapes, expected = FIGURES[name]
    found = contacts(build_assembly(parse_scene(mirrored(document(shapes)))))
    assert found == {(a, b, -x + 0.0, y, length, -nx + 0.0, ny) for a, b, x, y, length, nx, ny in expected}


@pytest.mark.parametrize("name", FIGURES)
def test_frames(name: str) -> None:
    """e1 is the normal turned +90°, the origin lies mid-length, and the end points lie along e1."""
    faces = assembly(FIGURES[name][0], thickness=0.3).interfaces
    np.testing.assert_allclose(faces.e1, np.column_stack([-faces.normal[:, 1], faces.normal[:, 0]]))
    np.testing.assert_allclose(np.linalg.norm(faces.normal, axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(faces.area, 0.3 * faces.l1)
    for k, ends in enumerate(faces.polygon):
        np.testing.assert_allclose(ends.mean(axis=0), faces.origin[k], atol=1e-12)
        np.testing.assert_allclose(abs((ends[1] - ends[0]) @ faces.e1[k]), np.linalg.norm(ends[1] - ends[0]), rtol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize(("gap", "tilt"), [(1e-9, 0.0), (-1e-9, 0.0), (0.0, 1e-9), (3e-8, -3e-8), (-5e-8, 5e-8)])
def test_edges_that_coincide_only_nearly(gap: float, tilt: float, scale: float) -> None:
    """Gaps, overlaps and tilts of 1e-9 … 1e-7 of the length are what files hold; the contact is found."""
    upper = [[0, 1 + gap], [2, 1 + gap + tilt], [2, 2], [0, 2]]
    shapes = {"a": box(0, 0, 2, 1), "b": upper}
    found = assembly({n: [[scale * x, scale * y] for x, y in p] for n, p in shapes.items()})
    ((_, _, x, y, length, nx, ny),) = contacts(found)
    assert [x / scale, y / scale, length / scale] == pytest.approx([1, 1, 2], rel=1e-6)
    assert [nx, ny] == pytest.approx([0, 1], abs=1e-6)


@pytest.mark.parametrize(("gap", "touches"), [(0.9e-7, True), (1.1e-7, False)])
def test_gap_at_the_tolerance(gap: float, touches: bool) -> None:
    """Just below 1e-7 of the shorter edge two elements touch, just above they do not."""
    left = np.array(box(0, 0, 1, 1))
    right = np.array(box(1 + gap, 0, 4, 1))
    assert len(planar_contacts.find_planar_contacts([left, right])) == int(touches)


@pytest.mark.parametrize(("shared", "touches"), [(0.9e-7, False), (1.1e-7, True)])
def test_contact_as_short_as_the_tolerance(shared: float, touches: bool) -> None:
    """A contact shorter than 1e-7 of the shorter edge is a corner that touches."""
    assert len(
        planar_contacts.find_planar_contacts([np.array(box(0, 0, 1, 1)), np.array(box(1 - shared, 1, 2 - shared, 2))])
    ) == int(touches)


@pytest.mark.parametrize(("depth", "refused"), [(0.9e-7, False), (1.2e-7, True)])
def test_sliver_of_overlap(depth: float, refused: bool) -> None:
    """Up to 1e-7 of the smaller area a shared sliver is rounding; above it two elements are in one place."""
    shapes = [np.array(box(0, 0, 1, 1)), np.array(box(1 - depth, 0, 3, 1))]
    if refused:
        with pytest.raises(InputError, match="'a' and 'b': they overlap"):
            planar_contacts.check_polygons(["a", "b"], shapes)
    else:
        planar_contacts.check_polygons(["a", "b"], shapes)
        (contact,) = planar_contacts.find_planar_contacts(shapes)
        np.testing.assert_allclose(contact.normal, [1, 0], atol=1e-12)


def test_an_element_inside_another_overlaps_it() -> None:
    with pytest.raises(InputError, match="they overlap"):
        assembly({"a": box(0, 0, 9, 9), "b": box(1, 1, 2, 2)})


def test_an_element_may_fill_a_ring_that_is_cut_open() -> None:
    """A ring cannot be one outline without holes; as two halves it holds its core on four sides."""
    lower = [[0, 0], [3, 0], [3, 1.5], [2, 1.5], [2, 1], [1, 1], [1, 1.5], [0, 1.5]]
    upper = [[0, 1.5], [1, 1.5], [1, 2], [2, 2], [2, 1.5], [3, 1.5], [3, 3], [0, 3]]
    found = contacts(assembly({"lower": lower, "upper": upper, "core": box(1, 1, 2, 2)}))
    assert sum(row[4] for row in found if "core" in row[:2]) == pytest.approx(4.0)
    assert len(found) == 2 + 6


@pytest.mark.parametrize("seed", range(8))
def test_random_grids_of_uneven_cells(seed: int) -> None:
    """Contacts of a grid with uneven lines, turned: as many as inner edges, together as long, each from a to b."""
    rng = np.random.default_rng(seed)
    x, y = (np.cumsum(rng.uniform(0.1, 1.0, n)) for n in (6, 5))
    shapes = {
        f"c{i}{j}": box(x[i], y[j], x[i + 1], y[j + 1])[:: rng.choice([-1, 1])] for i in range(5) for j in range(4)
    }
    found = build_assembly(parse_scene(rotated(document(shapes), float(rng.uniform(0, 360)))))
    faces, centroid = found.interfaces, found.elements.centroid
    assert len(faces) == 4 * 4 + 5 * 3 == 31
    inner = 4 * (y[-1] - y[0]) + 3 * (x[-1] - x[0])
    assert faces.l1.sum() == pytest.approx(inner, rel=1e-9)
    across = np.einsum("ij,ij->i", faces.normal, centroid[faces.b] - centroid[faces.a])
    assert np.all(across > 0.0)  # all convex: here, and only here, centroids tell the side


# --- interfaces that the scene gives ---------------------------------------------------------------------------

STACK = {"s": box(-1, -1, 3, 0), "a": box(0, 0, 1, 1), "b": box(0, 1, 1, 2)}


def test_given_interfaces_are_used_as_they_are() -> None:
    """Fewer and shorter than geometry says; the first element's face decides the side, not the order."""
    given = [
        {"elements": ["a", "s"], "polygon": [[0.2, 0], [0.8, 0]]},
        {"elements": ["b", "a"], "polygon": [[0.3, 1], [0, 1]], "label": "inner"},
        {"elements": ["a", "b"], "polygon": [[0.4, 1], [0.6, 1]], "friction_coefficient": 0.1},
    ]
    found = assembly(STACK, interfaces=given)
    ids, faces = found.elements.ids, found.interfaces
    assert [(ids[a], ids[b]) for a, b in zip(faces.a, faces.b, strict=True)] == [("a", "s"), ("b", "a"), ("a", "b")]
    np.testing.assert_allclose(faces.normal, [[0, -1], [0, -1], [0, 1]], atol=1e-15)
    np.testing.assert_allclose(faces.l1, [0.6, 0.3, 0.2])
    np.testing.assert_allclose(faces.origin, [[0.5, 0], [0.15, 1], [0.5, 1]])
    assert found.labels.tolist() == [True, False, True]
    np.testing.assert_allclose(found.strengths(ROUTE).friction, [0.5, 0.5, 0.1])


def test_interfaces_between_supports_are_left_out() -> None:
    shapes = {**STACK, "t": box(3, -1, 5, 0)}
    scene = document(shapes)
    scene["elements"][3]["support"] = True
    found = build_assembly(parse_scene(scene))
    assert {row[:2] for row in contacts(found)} == {("a", "s"), ("a", "b")}


# --- weights ---------------------------------------------------------------------------------------------------


def weights(scene: Document) -> Any:
    found = build_assembly(parse_scene(scene))
    return found.elements.weight[found.elements.index["a"]]


def test_weight_from_density_thickness_and_gravity() -> None:
    scene = document(STACK, thickness=0.25)
    del scene["elements"][1]["weight"]
    scene["materials"] = {"density": 2000.0, "dry": {"friction_coefficient": 0.5}}
    np.testing.assert_allclose(weights(scene), [0, -2000 * 9.81 * 0.25])  # gravity's default
    scene["materials"]["gravity"] = 10.0
    np.testing.assert_allclose(weights(scene), [0, -2000 * 10 * 0.25])
    scene["materials"]["gravity"] = [3.0, -4.0]
    np.testing.assert_allclose(weights(scene), [3 * 2000 * 0.25, -4 * 2000 * 0.25])
    scene["materials"]["gravity"] = -10.0  # a number points along −y, a negative one up
    np.testing.assert_allclose(weights(scene), [0, 2000 * 10 * 0.25])
    scene["elements"][1]["density"] = 500.0  # an element's own density wins
    np.testing.assert_allclose(weights(scene), [0, 500 * 10 * 0.25])
    scene["elements"][1]["volume"] = 7.0  # a given volume is used instead of the computed one
    np.testing.assert_allclose(weights(scene), [0, 500 * 10 * 7])


def test_given_weight_takes_its_direction_from_gravity() -> None:
    scene = document(STACK)
    scene["elements"][1].update(weight=5.0, density=1e4)
    for gravity, expected in (
        (9.81, [0, -5]),
        (1e-6, [0, -5]),
        (0.0, [0, -5]),
        ([0.0, 0.0], [0, -5]),
        ([3.0, -4.0], [3, -4]),
        ([7.0, 0.0], [5, 0]),
        (-9.81, [0, 5]),
    ):
        scene["materials"]["gravity"] = gravity
        np.testing.assert_allclose(weights(scene), expected, atol=1e-15)


def test_no_weight_and_no_density_means_no_weight() -> None:
    scene = document(STACK)
    del scene["elements"][1]["weight"]
    np.testing.assert_array_equal(weights(scene), [0, 0])


def test_supports_weigh_nothing_in_equilibrium() -> None:
    found = assembly(STACK)
    np.testing.assert_array_equal(found.dead, [[0, 0, 0], [0, -1, 0], [0, -1, 0]])
    np.testing.assert_array_equal(found.live, [[0, 0, 0], [1, 0, 0], [1, 0, 0]])
    assert (found.total_dead, found.total_live) == (2.0, 2.0)


def test_centroid_of_a_non_convex_element() -> None:
    """L of three unit squares: at 5/6 of a side; far from the origin it keeps its digits."""
    shape = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    for shift in (0.0, 1e6):
        moved = [[x + shift, y - shift] for x, y in shape]
        ground = box(shift - 1, -shift - 1, shift + 3, -shift)
        found = assembly({"s": ground, "L": moved})
        np.testing.assert_allclose(
            found.elements.centroid[1] - [shift, -shift], [5 / 6, 5 / 6], rtol=1e-9 if shift else 1e-14
        )
        assert found.elements.volume[1] == pytest.approx(3.0, rel=1e-9 if shift else 1e-14)


# --- loads -----------------------------------------------------------------------------------------------------


def live(entries: list[Document], **more: Any) -> Any:
    scene = document(STACK, loads={"live": entries}, **more)
    found = build_assembly(parse_scene(scene))
    return found.live[[found.elements.index["a"], found.elements.index["b"]]]


def test_forces_moments_and_body_loads_add_up() -> None:
    """(p − c) × f about the centroid, counter-clockwise positive; p may lie outside the element."""
    force = {"element": "a", "force": [2, -3]}
    np.testing.assert_allclose(live([force]), [[2, -3, 0], [0, 0, 0]])
    moved = {**force, "at": [4.5, 1.5]}  # centroid at (0.5, 0.5): arm (4, 1), moment 4·(−3) − 1·2
    np.testing.assert_allclose(live([moved]), [[2, -3, -14], [0, 0, 0]])
    couple = {"element": "b", "moment": 0.25}
    body = {"body": [0.5, -2]}
    np.testing.assert_allclose(live([force, moved, couple, couple, body, body]), [[4 + 1, -6 - 4, -14], [1, -4, 0.5]])
    both = {"element": "b", "force": [0, 1], "at": [2.5, 1.5], "moment": -7}
    np.testing.assert_allclose(live([both]), [[0, 0, 0], [0, 1, 2 - 7]])


def test_body_loads_take_the_magnitude_of_the_weight() -> None:
    """Whichever way gravity points, a body load is its positive magnitude times the vector."""
    for gravity in ([0.0, -9.81], [9.81, 0.0], [0.0, 9.81]):
        materials = {"gravity": gravity, "dry": {"friction_coefficient": 0.5}}
        np.testing.assert_allclose(live([{"body": [0.3, -0.4]}], materials=materials), [[0.3, -0.4, 0]] * 2)


def test_dead_loads_stand_beside_self_weight() -> None:
    loads = {
        "live": [{"body": [1, 0]}],
        "dead": [{"element": "b", "force": [0, -5], "at": [1.5, 2]}, {"body": [0, -1]}],
    }
    found = assembly(STACK, loads=loads)
    np.testing.assert_allclose(found.dead[1:], [[0, -2, 0], [0, -7, -5]])
    np.testing.assert_allclose(found.live[1:], [[1, 0, 0], [1, 0, 0]])


def test_a_given_centroid_is_where_weight_acts_and_moments_refer_to() -> None:
    scene = document(STACK, loads={"live": [{"element": "a", "force": [0, -1], "at": [0.5, 0.5]}]})
    scene["elements"][1]["centroid"] = [0.25, 0.5]
    found = build_assembly(parse_scene(scene))
    np.testing.assert_allclose(found.elements.centroid[1], [0.25, 0.5])
    np.testing.assert_allclose(found.live[1], [0, -1, -0.25])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("opening", [0.1, 0.5, 1.0, 1.7])
def test_a_wedge_is_named_however_the_scene_is_turned(opening: float) -> None:
    """A block that touches its support along one edge and opens by degrees: no joint, and a warning in every turn."""
    rise = math.tan(math.radians(opening))
    shapes = {
        "s": [[-1.0, -1.0], [3.0, -1.0], [3.0, 0.0], [-1.0, 0.0]],
        "a": box(0, 0, 1, 1),
        "b": [[1.0, 0.0], [2.0, rise], [2.0, 1.0], [1.0, 1.0]],
    }
    upright = document(shapes, labels={"inner": [["a", "b"]]})
    rng = np.random.default_rng(7)
    for degrees in [0.0, 39.01534, *rng.uniform(0.0, 360.0, 40)]:
        found = build_assembly(parse_scene(rotated(upright, degrees, tuple(rng.uniform(-3.0, 3.0, 2)))))
        assert sorted(found.pair(face) for face in range(len(found.interfaces))) == ["a–b", "s–a"]
        assert len(found.warnings) == 1, degrees
        assert f"({opening:.2g}°)" in found.warnings[0]


def test_a_plate_that_fills_a_gap_leaves_no_warning_however_the_scene_is_turned() -> None:
    """Between faces 0.9 % of their length apart lies a third element."""
    plate = document({"s": box(0, -1, 1, 0), "p": box(0, 0, 1, 0.009), "a": box(0, 0.009, 1, 1)})
    for degrees in np.random.default_rng(3).uniform(0.0, 360.0, 20):
        assert build_assembly(parse_scene(rotated(plate, degrees))).warnings == ()


# Polyhedra and the interfaces between them, found and given.


SCENES = Path(__file__).parents[2] / "scenes"
UNIT_SQUARE = float(polygons.rectangle_torsion_length(np.ones(1), np.ones(1))[0])  # ∫ r dA of the unit square
SLAB = box_in_space("slab", [-5, -5, -1], [9, 9, 0], support=True)


def document_in_space(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((SCENES / f"spatial_{name}.json").read_text(encoding="utf-8"))
    return found


def described(built: Assembly) -> list[tuple[Any, ...]]:
    """Per interface: the pair in alphabetical order, the normal from first to second, sizes."""
    rows = []
    faces, ids = built.interfaces, built.elements.ids
    for k in range(len(faces)):
        pair, sign = (ids[faces.a[k]], ids[faces.b[k]]), 1.0
        if pair[0] > pair[1]:
            pair, sign = pair[::-1], -1.0
        numbers = np.concatenate([faces.origin[k], sign * faces.normal[k], [faces.area[k], faces.c_t[k]]])
        rows.append((*pair, *np.round(numbers, 6) + 0.0, numbers))
    return sorted(rows, key=lambda row: row[:-1])


@pytest.mark.parametrize("name", ["cubes", "shelf"])
def test_interfaces_found_equal_those_given(name: str) -> None:
    """Data of compas_cra: areas, centroids, normals, rectangles; 1e-7, coordinates being single precision."""
    given = document_in_space(name)
    found = {key: value for key, value in given.items() if key != "interfaces"}
    one, two = build_assembly(parse_scene(given)), build_assembly(parse_scene(found))
    assert len(one.interfaces) == len(two.interfaces) == len(given["interfaces"])
    for left, right in zip(described(one), described(two), strict=True):
        assert left[:2] == right[:2]
        np.testing.assert_allclose(left[-1], right[-1], atol=1e-7)
    assert one.interfaces.rectangle.all()
    assert two.interfaces.rectangle.all()


@pytest.mark.parametrize("name", ["cubes", "shelf"])
def test_volumes_and_centroids_equal_those_given(name: str) -> None:
    given = document_in_space(name)
    stated = [(e.pop("volume"), e.pop("centroid")) for e in given["elements"]]
    built = build_assembly(parse_scene(given))
    np.testing.assert_allclose(built.elements.volume, [v for v, _ in stated], rtol=1e-12)
    np.testing.assert_allclose(built.elements.centroid, [c for _, c in stated], atol=1e-12)


def test_normals_come_from_faces_not_from_centroids() -> None:
    """docs/method.md, section 1: the difference of centroids points the wrong way on some interfaces of the shelf."""
    faces = (built := build_assembly(parse_scene(document_in_space("shelf")))).interfaces
    apart = built.elements.centroid[faces.b] - built.elements.centroid[faces.a]
    assert np.sum(np.einsum("ij,ij->i", apart, faces.normal) < 0.0) == 6


def test_frames_are_right_handed_and_orthonormal() -> None:
    turn = rotation(0.3, -0.8, 1.1)
    built = assembly_in_space(
        [box_in_space("a", [0, 0, 0], [1, 2, 1], turn), box_in_space("s", [0, 0, -1], [1, 2, 0], turn, support=True)]
    )
    faces = built.interfaces
    frame = np.stack([faces.normal, faces.e1, faces.e2], axis=1)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.eye(3)[None], atol=1e-14)
    np.testing.assert_allclose(np.cross(faces.normal, faces.e1), faces.e2, atol=1e-14)
    assert (faces.l1[0], faces.l2[0]) == pytest.approx((2.0, 1.0))  # e1 along the longest edge
    np.testing.assert_allclose(faces.normal[0], turn @ [0, 0, -1], atol=1e-14)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("cut", [False, True], ids=["quadrilaterals", "triangles"])
@pytest.mark.parametrize("angles", [(0, 0, 0), (0, 0, 0.4), (0.3, 0.5, 0.7)])
def test_running_bond(cut: bool, angles: tuple[float, float, float]) -> None:
    """Number and area of contacts do not depend on rotation, nor on how faces are cut."""
    turn = rotation(*angles)
    elements = wall(6, 5, 2, turn)
    built = assembly_in_space([split(e) for e in elements] if cut else elements)
    faces, bricks = built.interfaces, len(elements) - 1
    assert bricks == 12 * 5 + 6
    # wythes between (bricks of either beginning at every half length), heads, beds with 2·5 halves each,
    # ground
    between, heads, beds, ground = 6 * 10, 6 * (4 + 5), 2 * 5 * 10, 5 + 6
    assert len(faces) == between + heads + beds + ground
    area = 6 * 0.06 * 1.0 + 6 * (4 + 5) * 0.06 * 0.1 + 2 * 5 * 0.1 * 1.0 + 0.2 * 1.0
    assert faces.area.sum() == pytest.approx(area, rel=1e-12)
    assert faces.rectangle.all()
    order = np.lexsort((faces.b, faces.a))
    np.testing.assert_array_equal(order, np.arange(len(faces)))


def test_contact_in_two_parts_is_two_interfaces() -> None:
    bridge = prism(
        "u", [[0, 0], [5, 0], [5, 2], [4, 2], [4, 1], [1, 1], [1, 2], [0, 2]], 0, 1, rotation(-np.pi / 2, 0, 0)
    )
    slab = box_in_space("s", [-1, -1, -3], [6, 2, -2], support=True)
    faces = assembly_in_space([bridge, slab]).interfaces
    assert len(faces) == 2
    np.testing.assert_allclose(faces.area, [1.0, 1.0])
    np.testing.assert_allclose(np.abs(faces.origin[:, 0] - 2.5), [2.0, 2.0])


def test_contact_with_a_hole_is_one_interface() -> None:
    """A frame cut into triangles: one facet with a hole, and contact all around it."""
    outer, inner = [[0, 0], [3, 0], [3, 3], [0, 3]], [[1, 1], [2, 1], [2, 2], [1, 2]]
    points = [[x, y, z] for z in (0.0, 1.0) for x, y in outer + inner]
    faces = []
    for i in range(4):
        j = (i + 1) % 4
        faces += [[i, 4 + i, 4 + j], [i, 4 + j, j], [8 + i, 8 + j, 12 + j, 12 + i]]
        faces += [[i, j, 8 + j, 8 + i], [4 + j, 4 + i, 12 + i, 12 + j]]
    frame = {"id": "ring", "vertices": points, "faces": faces}
    built = assembly_in_space([frame, SLAB])
    assert built.elements.volume[0] == pytest.approx(8.0)
    assert built.interfaces.area.sum() == pytest.approx(8.0)
    assert len(built.interfaces) == 1
    np.testing.assert_allclose(built.interfaces.origin[0], [1.5, 1.5, 0.0], atol=1e-12)
    outer_part, inner_part = 9.0 * 3.0 * UNIT_SQUARE, UNIT_SQUARE
    assert built.interfaces.c_t[0] == pytest.approx((outer_part - inner_part) / 8.0, rel=1e-12)


def test_contact_that_is_not_convex_stays_one_polygon() -> None:
    faces = stools([ELL]).interfaces
    assert len(faces) == 1
    assert not faces.rectangle[0]
    assert faces.area[0] == pytest.approx(4.0)
    assert (faces.l1[0], faces.l2[0]) == pytest.approx((3.0, 2.0))


def test_curved_contact_is_one_interface_per_facet() -> None:
    angle = np.linspace(0.0, np.pi, 9)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    lid = np.concatenate([[[1.5, 0.0], [1.5, 2.0], [-1.5, 2.0], [-1.5, 0.0]], rim[::-1]])
    drum = rim
    built = assembly_in_space(
        [prism("lid", lid, 0, 1), prism("drum", drum, 0, 1), box_in_space("s", [-3, -1, 0], [3, 0, 1], support=True)]
    )
    faces, ids = built.interfaces, built.elements.ids
    curved = [k for k in range(len(faces)) if {ids[faces.a[k]], ids[faces.b[k]]} == {"lid", "drum"}]
    assert len(curved) == 8
    outward = np.einsum("ij,ij->i", faces.normal[curved][:, :2], faces.origin[curved][:, :2])
    assert np.all(outward < 0.0)  # from the lid to the drum: inwards


def test_partial_overlap_of_turned_faces() -> None:
    """A square turned by 45° on a square: an octagon of known area."""
    reach = 0.97
    turned = reach * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    support = box_in_space("s", [-0.7, -0.7, -1], [0.7, 0.7, 0], support=True)
    faces = assembly_in_space([prism("top", turned, 0, 1), support]).interfaces
    assert faces.area[0] == pytest.approx(2.0 * reach**2 - 4.0 * (reach - 0.7) ** 2, rel=1e-12)
    assert len(faces.polygon[0]) == 8


def test_small_gaps_touch_and_larger_ones_do_not() -> None:
    for gap, contacts in ((0.0, 1), (1e-6, 1), (-1e-6, 1), (1e-3, 0)):
        document_ = scene([box_in_space("a", [0, 0, gap], [1, 1, 1 + gap]), SLAB])
        if contacts:
            assert len(build_assembly(parse_scene(document_)).interfaces) == contacts
        else:
            with pytest.raises(InputError, match="no path of interfaces"):
                build_assembly(parse_scene(document_))


def test_edges_that_touch_are_no_contact() -> None:
    faces = assembly_in_space(
        [box_in_space("a", [0, 0, 0], [1, 1, 1]), box_in_space("b", [1, 1, 0], [2, 2, 1]), SLAB]
    ).interfaces
    assert sorted(zip(faces.a.tolist(), faces.b.tolist(), strict=True)) == [(0, 2), (1, 2)]


def test_supports_do_not_touch_each_other() -> None:
    other = box_in_space("t", [-5, -5, -2], [9, 9, -1], support=True)
    assert len(assembly_in_space([box_in_space("a", [0, 0, 0], [1, 1, 1]), SLAB, other]).interfaces) == 1


@pytest.mark.parametrize("turned", [[0], [1, 3], [0, 1, 2, 3, 4, 5]])
def test_faces_are_turned_outward(turned: list[int]) -> None:
    cube = box_in_space("a", [0, 0, 0], [1, 2, 3])
    cube["faces"] = [face[::-1] if k in turned else face for k, face in enumerate(cube["faces"])]
    built = assembly_in_space([cube, SLAB])
    assert built.elements.volume[0] == pytest.approx(6.0)
    np.testing.assert_allclose(built.elements.centroid[0], [0.5, 1.0, 1.5])
    np.testing.assert_allclose(built.interfaces.normal, [[0, 0, -1]], atol=1e-15)


def test_faces_with_vertices_of_their_own_are_welded() -> None:
    cube = box_in_space("a", [0, 0, 0], [1, 2, 3])
    points = np.array(cube["vertices"])
    cube["vertices"] = [points[i].tolist() for face in cube["faces"] for i in face]
    cube["faces"] = [[4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(6)]
    built = assembly_in_space([cube, SLAB])
    assert built.elements.volume[0] == pytest.approx(6.0)
    assert built.interfaces.area[0] == pytest.approx(2.0)


def open_cube() -> dict[str, Any]:
    cube = box_in_space("a", [0, 0, 0], [1, 1, 1])
    return {**cube, "faces": cube["faces"][:-1]}


def flat_cube() -> dict[str, Any]:
    cube = box_in_space("a", [0, 0, 0], [1, 1, 1])
    return {**cube, "vertices": [[x, y, 0.0] for x, y, _ in cube["vertices"]]}


@pytest.mark.parametrize(
    ("elements", "complaint"),
    [
        ([open_cube(), SLAB], "element 'a': its faces do not close"),
        ([flat_cube(), SLAB], "element 'a': its faces"),
        ([box_in_space("a", [0, 0, -0.5], [1, 1, 1]), SLAB], "elements 'a' and 'slab': they overlap"),
        ([box_in_space("a", [0, 0, -0.5], [1, 1, 1], rotation(0.2, 0.1, 0.3)), SLAB], "'a' and 'slab': they overlap"),
        (
            [box_in_space("a", [0, 0, 0], [1, 1, 1]), box_in_space("b", [0, 0, 0], [1, 1, 1]), SLAB],
            "'a' and 'b': they overlap",
        ),
        ([box_in_space("a", [0, 0, 0], [1, 1, 1]), box_in_space("a", [2, 0, 0], [3, 1, 1]), SLAB], "used twice"),
        ([box_in_space("a", [0, 0, 0], [1, 1, 1])], "none of them is a support"),
    ],
)
def test_elements_that_cannot_be_used(elements: list[dict[str, Any]], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        assembly_in_space(elements)


def test_elements_apart_by_their_edges_only_do_not_overlap() -> None:
    """Two boxes crossed like knives: no face separates them, an edge pair does; boxes interpenetrate."""
    one = box_in_space("a", [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], rotation(np.pi / 4, 0, 0))
    two = box_in_space("b", [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], rotation(0, np.pi / 4, 0))
    for height, apart in ((1.42, True), (1.40, False)):
        lifted = {**two, "vertices": (np.array(two["vertices"]) + np.array([0, 0, height])).tolist()}
        ends = [box_in_space(f"s{k}", [x, -9, -9], [x + 1, 9, 9], support=True) for k, x in enumerate((-9, 9))]
        match = "no path of interfaces" if apart else "'a' and 'b': they overlap"
        with pytest.raises(InputError, match=match):
            assembly_in_space([one, lifted, *ends])


def given(polygon: list[list[float]], pair: tuple[str, str] = ("a", "slab"), **keys: Any) -> dict[str, Any]:
    entry = {"elements": list(pair), "polygon": polygon, **keys}
    return scene([box_in_space("a", [0, 0, 0], [1, 1, 1]), SLAB], interfaces=[entry])


def test_given_interfaces_are_used_as_they_are_in_space() -> None:
    """Smaller than the contact, either sense, either element first; the normal leaves the first element."""
    corners = [[0.1, 0.1, 0.0], [0.9, 0.1, 0.0], [0.9, 0.6, 0.0], [0.1, 0.6, 0.0]]
    for polygon in (corners, corners[::-1]):
        for pair, normal in ((("a", "slab"), -1.0), (("slab", "a"), 1.0)):
            faces = build_assembly(parse_scene(given(polygon, pair, friction_coefficient=0.1))).interfaces
            assert faces.area[0] == pytest.approx(0.4)
            np.testing.assert_allclose(faces.normal[0], [0, 0, normal], atol=1e-15)
            np.testing.assert_allclose(faces.origin[0], [0.5, 0.35, 0.0], atol=1e-15)


def test_given_interface_in_a_plane_that_the_element_faces_both_ways() -> None:
    """A stair whose treads and undersides lie in one plane: the face below the polygon decides.

    The support lies elsewhere, which only so wide a tolerance allows.
    """
    stair = [[0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [-1, 2], [-1, 1], [0, 1]]
    comb = prism("a", stair, 0.0, 1.0, rotation(np.pi / 2, 0, 0))
    for x0, up in ((-1.0, -1.0), (1.0, -1.0)):
        polygon = [[x0, -1.0, 1.0], [x0 + 1, -1.0, 1.0], [x0 + 1, 0.0, 1.0], [x0, 0.0, 1.0]]
        entries = [{"elements": ["a", "s"], "polygon": polygon}]
        support = box_in_space("s", [-1, -1, -1], [2, 0, 0], support=True)
        built = build_assembly(parse_scene(scene([comb, support], interfaces=entries, tolerance=5.0)))
        assert built.interfaces.normal[0] @ [0, 0, 1] == pytest.approx(up)
    ess = [[0, 0], [2, 0], [2, 2], [1, 2], [1, 1], [0, 1]]
    both = prism("a", [*ess[:2], [2, 1], [3, 1], [3, 2], [1, 2], [1, 1], [0, 1]], 0.0, 1.0, rotation(np.pi / 2, 0, 0))
    for x0, up in ((0.0, 1.0), (2.0, -1.0)):
        polygon = [[x0, -1.0, 1.0], [x0 + 1, -1.0, 1.0], [x0 + 1, 0.0, 1.0], [x0, 0.0, 1.0]]
        entries = [{"elements": ["a", "s"], "polygon": polygon}]
        built = build_assembly(parse_scene(scene([both, support], interfaces=entries, tolerance=5.0)))
        assert built.interfaces.normal[0] @ [0, 0, 1] == pytest.approx(up)


@pytest.mark.parametrize(
    ("polygon", "complaint"),
    [
        (
            [[0, 0, 0], [1, 0, 0], [1, 1, 0.01], [0, 1, 0]],
            r"interfaces\[0\].polygon: its corners do not lie in a plane",
        ),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], r"interfaces\[0\].polygon: it has no area"),
        ([[0, 0, 0], [1, 0, 0]], r"interfaces\[0\].polygon: it is not a spatial contact"),
        ([[0, 0], [1, 0], [1, 1]], r"interfaces\[0\].polygon: it is not a spatial contact"),
    ],
)
def test_given_interfaces_that_cannot_be_used(polygon: list[list[float]], complaint: str) -> None:
    floats = [[float(x) for x in point] for point in polygon]
    with pytest.raises(InputError, match=complaint):
        build_assembly(parse_scene(given(floats)))
