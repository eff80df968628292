"""Polyhedra and the interfaces between them, found and given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases_spatial import ELL, assembly, box, prism, rotation, scene, split, stools, wall
from jld_core import Assembly, InputError, build_assembly, parse_scene
from jld_core.geometry import outlines as polygons

SCENES = Path(__file__).parents[2] / "scenes"
UNIT_SQUARE = float(polygons.rectangle_torsion_length(np.ones(1), np.ones(1))[0])  # ∫ r dA of the unit square
SLAB = box("slab", [-5, -5, -1], [9, 9, 0], support=True)


def document(name: str) -> dict[str, Any]:
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
    given = document(name)
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
    given = document(name)
    stated = [(e.pop("volume"), e.pop("centroid")) for e in given["elements"]]
    built = build_assembly(parse_scene(given))
    np.testing.assert_allclose(built.elements.volume, [v for v, _ in stated], rtol=1e-12)
    np.testing.assert_allclose(built.elements.centroid, [c for _, c in stated], atol=1e-12)


def test_normals_come_from_faces_not_from_centroids() -> None:
    """docs/method.md, section 1: the difference of centroids points the wrong way on some interfaces of the shelf."""
    faces = (built := build_assembly(parse_scene(document("shelf")))).interfaces
    apart = built.elements.centroid[faces.b] - built.elements.centroid[faces.a]
    assert np.sum(np.einsum("ij,ij->i", apart, faces.normal) < 0.0) == 6


def test_frames_are_right_handed_and_orthonormal() -> None:
    turn = rotation(0.3, -0.8, 1.1)
    built = assembly([box("a", [0, 0, 0], [1, 2, 1], turn), box("s", [0, 0, -1], [1, 2, 0], turn, support=True)])
    faces = built.interfaces
    frame = np.stack([faces.normal, faces.e1, faces.e2], axis=1)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.eye(3)[None], atol=1e-14)
    np.testing.assert_allclose(np.cross(faces.normal, faces.e1), faces.e2, atol=1e-14)
    assert (faces.l1[0], faces.l2[0]) == pytest.approx((2.0, 1.0))  # e1 along the longest edge
    np.testing.assert_allclose(faces.normal[0], turn @ [0, 0, -1], atol=1e-14)


@pytest.mark.parametrize("cut", [False, True], ids=["quadrilaterals", "triangles"])
@pytest.mark.parametrize("angles", [(0, 0, 0), (0, 0, 0.4), (0.3, 0.5, 0.7)])
def test_running_bond(cut: bool, angles: tuple[float, float, float]) -> None:
    """Number and area of contacts do not depend on rotation, nor on how faces are cut."""
    turn = rotation(*angles)
    elements = wall(6, 5, 2, turn)
    built = assembly([split(e) for e in elements] if cut else elements)
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
        "u",
        [[0, 0], [5, 0], [5, 2], [4, 2], [4, 1], [1, 1], [1, 2], [0, 2]],
        0,
        1,
        rotation(-np.pi / 2, 0, 0),
    )
    slab = box("s", [-1, -1, -3], [6, 2, -2], support=True)
    faces = assembly([bridge, slab]).interfaces
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
    built = assembly([frame, SLAB])
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
    built = assembly(
        [prism("lid", lid, 0, 1), prism("drum", drum, 0, 1), box("s", [-3, -1, 0], [3, 0, 1], support=True)]
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
    support = box("s", [-0.7, -0.7, -1], [0.7, 0.7, 0], support=True)
    faces = assembly([prism("top", turned, 0, 1), support]).interfaces
    assert faces.area[0] == pytest.approx(2.0 * reach**2 - 4.0 * (reach - 0.7) ** 2, rel=1e-12)
    assert len(faces.polygon[0]) == 8


def test_small_gaps_touch_and_larger_ones_do_not() -> None:
    for gap, contacts in ((0.0, 1), (1e-6, 1), (-1e-6, 1), (1e-3, 0)):
        document_ = scene([box("a", [0, 0, gap], [1, 1, 1 + gap]), SLAB])
        if contacts:
            assert len(build_assembly(parse_scene(document_)).interfaces) == contacts
        else:
            with pytest.raises(InputError, match="no path of interfaces"):
                build_assembly(parse_scene(document_))


def test_edges_that_touch_are_no_contact() -> None:
    faces = assembly([box("a", [0, 0, 0], [1, 1, 1]), box("b", [1, 1, 0], [2, 2, 1]), SLAB]).interfaces
    assert sorted(zip(faces.a.tolist(), faces.b.tolist(), strict=True)) == [(0, 2), (1, 2)]


def test_supports_do_not_touch_each_other() -> None:
    other = box("t", [-5, -5, -2], [9, 9, -1], support=True)
    assert len(assembly([box("a", [0, 0, 0], [1, 1, 1]), SLAB, other]).interfaces) == 1


@pytest.mark.parametrize("turned", [[0], [1, 3], [0, 1, 2, 3, 4, 5]])
def test_faces_are_turned_outward(turned: list[int]) -> None:
    cube = box("a", [0, 0, 0], [1, 2, 3])
    cube["faces"] = [face[::-1] if k in turned else face for k, face in enumerate(cube["faces"])]
    built = assembly([cube, SLAB])
    assert built.elements.volume[0] == pytest.approx(6.0)
    np.testing.assert_allclose(built.elements.centroid[0], [0.5, 1.0, 1.5])
    np.testing.assert_allclose(built.interfaces.normal, [[0, 0, -1]], atol=1e-15)


def test_faces_with_vertices_of_their_own_are_welded() -> None:
    cube = box("a", [0, 0, 0], [1, 2, 3])
    points = np.array(cube["vertices"])
    cube["vertices"] = [points[i].tolist() for face in cube["faces"] for i in face]
    cube["faces"] = [[4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(6)]
    built = assembly([cube, SLAB])
    assert built.elements.volume[0] == pytest.approx(6.0)
    assert built.interfaces.area[0] == pytest.approx(2.0)


def open_cube() -> dict[str, Any]:
    cube = box("a", [0, 0, 0], [1, 1, 1])
    return {**cube, "faces": cube["faces"][:-1]}


def flat_cube() -> dict[str, Any]:
    cube = box("a", [0, 0, 0], [1, 1, 1])
    return {**cube, "vertices": [[x, y, 0.0] for x, y, _ in cube["vertices"]]}


@pytest.mark.parametrize(
    ("elements", "complaint"),
    [
        ([open_cube(), SLAB], "element 'a': its faces do not close"),
        ([flat_cube(), SLAB], "element 'a': its faces"),
        ([box("a", [0, 0, -0.5], [1, 1, 1]), SLAB], "elements 'a' and 'slab': they overlap"),
        ([box("a", [0, 0, -0.5], [1, 1, 1], rotation(0.2, 0.1, 0.3)), SLAB], "'a' and 'slab': they overlap"),
        ([box("a", [0, 0, 0], [1, 1, 1]), box("b", [0, 0, 0], [1, 1, 1]), SLAB], "'a' and 'b': they overlap"),
        ([box("a", [0, 0, 0], [1, 1, 1]), box("a", [2, 0, 0], [3, 1, 1]), SLAB], "used twice"),
        ([box("a", [0, 0, 0], [1, 1, 1])], "none of them is a support"),
    ],
)
def test_elements_that_cannot_be_used(elements: list[dict[str, Any]], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        assembly(elements)


def test_elements_apart_by_their_edges_only_do_not_overlap() -> None:
    """Two boxes crossed like knives: no face separates them, an edge pair does; boxes interpenetrate."""
    one = box("a", [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], rotation(np.pi / 4, 0, 0))
    two = box("b", [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], rotation(0, np.pi / 4, 0))
    for height, apart in ((1.42, True), (1.40, False)):
        lifted = {**two, "vertices": (np.array(two["vertices"]) + np.array([0, 0, height])).tolist()}
        ends = [box(f"s{k}", [x, -9, -9], [x + 1, 9, 9], support=True) for k, x in enumerate((-9, 9))]
        match = "no path of interfaces" if apart else "'a' and 'b': they overlap"
        with pytest.raises(InputError, match=match):
            assembly([one, lifted, *ends])


def given(polygon: list[list[float]], pair: tuple[str, str] = ("a", "slab"), **keys: Any) -> dict[str, Any]:
    entry = {"elements": list(pair), "polygon": polygon, **keys}
    return scene([box("a", [0, 0, 0], [1, 1, 1]), SLAB], interfaces=[entry])


def test_given_interfaces_are_used_as_they_are() -> None:
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
        support = box("s", [-1, -1, -1], [2, 0, 0], support=True)
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
