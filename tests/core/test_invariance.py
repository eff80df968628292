"""λ is a property of the structure: units, rotation, numbering and mirror leave it alone, to 1e-9 relative."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from benchmarks.claims import run as run_claim
from numpy.typing import NDArray

from cases import as_elements, box, grid_document, in_units, mirrored, prism, renumbered, rotated, rotation
from cases import scene_in_space as scene
from command import SCENES
from jld_core import InputError, LimitAnalysisResult, Status, build_assembly, load_scene, parse_scene, solve
from jld_core.geometry import outlines as polygons

ARCH = grid_document(
    ["#aabbcc#", "#aaabcc#"], friction=0.6, live=[{"element": "c3r0", "force": [0, -1]}, {"body": [0.2, 0]}]
)
SCENES_TO_MOVE: dict[str, Any] = {
    "wall 1": load_scene(SCENES / "ferris_tinloi_1.json"),
    "wall 2": load_scene(SCENES / "ferris_tinloi_2.json"),
    "wall 4": load_scene(SCENES / "ferris_tinloi_4.json"),
    "beam": load_scene(SCENES / "flat_beam_arch.json"),
    "confined arch": parse_scene(ARCH),
}
MOVES = {
    "metres to millimetres": lambda d: in_units(d, 1e3, 1.0),
    "N to MN": lambda d: in_units(d, 1.0, 1e-6),
    "µN and km": lambda d: in_units(d, 1e-3, 1e6),
    "turned by 37.3°": lambda d: rotated(d, 37.3),
    "turned by 90° and moved far away": lambda d: rotated(d, 90.0, (1000.0, -500.0)),
    "turned by 201.7°": lambda d: rotated(d, 201.7, (0.3, 0.1)),
    "renumbered": lambda d: renumbered(d, 7),
    "mirrored": mirrored,
}


@cache
def unmoved(name: str) -> tuple[Any, LimitAnalysisResult]:
    document = as_elements(SCENES_TO_MOVE[name])
    return document, solve(build_assembly(parse_scene(document)))


@pytest.mark.sampled(5)
@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("name", SCENES_TO_MOVE)
def test_load_factor_is_invariant(name: str, move: str) -> None:
    document, before = unmoved(name)
    after = solve(build_assembly(parse_scene(MOVES[move](document))))
    assert before.status is after.status is Status.COLLAPSE
    assert after.load_factor == pytest.approx(before.load_factor, rel=1e-9)
    assert after.gap < 1e-7


# Contacts and sections in any position: spikes, holes, hulls, and faces that are not quite parallel.


ELL = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]) * [1.0, 1.0]
RING = {"outer": [[0, 0], [3, 0], [3, 3], [0, 3]], "inner": [[1, 1], [1, 2], [2, 2], [2, 1]]}


def misfits(document: dict[str, Any]) -> list[str]:
    """Warnings about geometry, not about numbers in other units."""
    found = build_assembly(parse_scene(document)).warnings
    return [text for text in found if text.startswith("interfaces[") or "nearly touch" in text]


@pytest.mark.long
def test_random_assemblies_have_the_contacts_of_their_grid() -> None:
    """A share of `python -m benchmarks.claims geometry`, which tests 3 000."""
    found = run_claim("geometry", 100_000, 25, 600.0)
    assert found.disagreements == []
    assert found.notes["contacts"] > 100


def test_assembly_steps_cut_no_neighbour() -> None:
    """A share of `python -m benchmarks.claims laying`."""
    assert run_claim("laying", 100_000, 20, 600.0).disagreements == []


@pytest.mark.parametrize("degrees", [0.0, 10.0, 20.0, 33.0, 47.0, 71.0])
def test_overhanging_solid_rocks_about_its_contact_at_any_angle(degrees: float) -> None:
    """An L-shaped block half beside its support: λ is that of rocking about the edge of the contact alone."""
    turn = rotation(0.0, 0.0, np.radians(degrees))
    ground = box("g", [1.0, 0.0, -1.0], [3.0, 2.0, 0.0], turn, support=True)
    live = [{"body": (turn @ [0.0, -1.0, 0.0]).tolist()}]
    elements = [prism("b", ELL, 0.0, 1.0, turn), ground]
    built = build_assembly(parse_scene(scene(elements, live=live, materials={"dry": {"friction_coefficient": 5.0}})))
    assert len(built.interfaces) == 1
    assert built.interfaces.area[0] == pytest.approx(2.0, rel=1e-12)
    assert len(polygons.corners(built.interfaces.polygon[0], 1e-9)) == 4
    # contact 1 ≤ x ≤ 3, 0 ≤ y ≤ 1; centroid of the block (1.25, 0.75) at height 0.5; it rocks about y = 0
    assert solve(built).load_factor == pytest.approx(0.75 / 0.5, rel=1e-8)


def test_spikes_slivers_and_necks_are_no_part_of_a_region() -> None:
    thin = 1e-13
    square = [[0, 0], [1, 0], [1, 0.5], [4, 0.5], [1, 0.5 + thin], [1, 1], [0, 1]]
    ((shell, holes),) = polygons.clean_parts(shapely.Polygon(square), 1e-5)
    assert (len(shell), holes) == (4, ())
    assert np.ptp(shell, axis=0) == pytest.approx([1.0, 1.0], abs=1e-12)
    dumbbell = [[0, 0], [1, 0], [1, 0.5], [3, 0.5], [3, 0], [4, 0], [4, 1], [3, 1], [3, 0.5 + thin], [1, 0.5 + thin]]
    parts = polygons.clean_parts(shapely.Polygon([*dumbbell, [1, 1], [0, 1]]), 1e-5)
    assert [len(ring) for ring, _ in parts] == [4, 4]
    assert [float(polygons.area(ring[None])[0]) for ring, _ in parts] == pytest.approx([1.0, 1.0], rel=1e-9)
    assert polygons.clean_parts(shapely.box(0.0, 0.0, 1.0, 1e-7), 1e-5) == []


def test_corners_do_not_depend_on_where_the_outline_begins() -> None:
    """A spike whose foot lies 3e-6 beside a corner: the corner stays, whichever point comes first."""
    outline = np.array([[0, 0], [1, 0], [1, 1], [0.5, 1], [0.5 + 3e-6, 1 - 1e-15], [0.5, 1.0], [0.5, 0.5], [0, 0.5]])
    for first in range(len(outline)):
        kept = polygons.corners(np.roll(outline, first, axis=0), 1e-5)
        assert float(polygons.area(kept[None])[0]) == pytest.approx(0.75, rel=1e-12)
        assert len(kept) == 6


def test_hull_keeps_corners_of_a_turned_step() -> None:
    """Four points in one line, in any order up to rounding: the hull has both ends of the line."""
    steps = np.array([[0.0, 0.4], [0.3, 0.4], [0.3, 0.3], [0.0, 0.3], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for degrees in range(0, 360, 7):
        turn = rotation(0.0, 0.0, np.radians(degrees))[:2, :2]
        for noise in (0.0, 1e-16, -1e-16):
            points = steps @ turn.T
            found = polygons.hull(points + noise * np.arange(16).reshape(8, 2) @ turn.T @ turn)
            assert float(polygons.area(found[None])[0]) == pytest.approx(1.0, rel=1e-12)
    upright = steps + np.array([[1e-16 * k, 0.0] for k in (1, 0, 0, 2, 4, 0, 0, 3)])
    assert float(polygons.area(polygons.hull(upright)[None])[0]) == pytest.approx(1.0, rel=1e-12)


def test_polygons_that_share_an_edge_up_to_rounding_share_no_area() -> None:
    """Two outlines of which GEOS 3.14 returns the whole second one as their intersection."""
    one = [
        [-0.8697794142926436, 0.3478176494391975],
        [-3.6244431228362552, -1.9477809994493562],
        [-2.7546637085436116, -2.295598648888554],
        [-0.6886659271359029, -0.5738996622221385],
        [0.0, 0.0],
    ]
    other = [
        [-1.5584453414285466, -0.2260820127829411],
        [-0.8697794142926436, 0.3478176494391975],
        [-1.7395588285852872, 0.695635298878395],
        [-2.609338242877931, 1.0434529483175925],
        [-3.298004170013834, 0.46955328609545405],
    ]
    assert polygons.intersections([shapely.Polygon(one)], [shapely.Polygon(other)])[0].area <= 1e-12
    elements = [{"id": "a", "polygon": other}, {"id": "g", "polygon": one, "support": True}]
    built = build_assembly(parse_scene(scene(elements, live=[{"body": [1, 0]}])))
    assert built.interfaces.l1[0] == pytest.approx(np.hypot(0.68866592713, 0.57389966222), rel=1e-9)


def ring_on(turn: NDArray[np.float64], order: list[int], *, bridged: bool) -> dict[str, Any]:
    """A ring 3 × 3 with a hole 1 × 1, glued to a slab: its top as one face with a bridge, or as four trapezia."""
    corners = RING["outer"] + RING["inner"]
    points = np.array([[x, y, z] for z in (-1.0, 0.0) for x, y in corners], dtype=float) @ turn.T
    if bridged:
        faces = [[8, 9, 10, 11, 8, 12, 13, 14, 15, 12], [0, 4, 7, 6, 5, 4, 0, 3, 2, 1]]
    else:
        quads = [[8, 9, 15, 12], [9, 10, 14, 15], [10, 11, 13, 14], [11, 8, 12, 13]]
        faces = quads + [[index - 8 for index in quad[::-1]] for quad in quads]
    faces += [[0, 1, 9, 8], [1, 2, 10, 9], [2, 3, 11, 10], [3, 0, 8, 11]]
    faces += [[4, 5, 13, 12], [5, 6, 14, 13], [6, 7, 15, 14], [7, 4, 12, 15]]
    ring = {"id": "r", "vertices": points.tolist(), "faces": faces, "support": True}
    slab = box("s", [0, 0, 0], [3, 3, 1], turn)
    strength = {"tensile_strength": 1e5, "shear_strength": 5e4}
    return scene(
        [(ring, slab)[k] for k in order],
        live=[{"element": "s", "moment": (turn @ [1.0, 0.0, 0.0]).tolist()}],
        materials={"density": 2000.0, "gravity": (turn @ [0.0, 0.0, -9.81]).tolist(), "inner": strength},
        labels={"default": "inner"},
    )


@pytest.mark.parametrize("bridged", [True, False])
@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, -0.8, 1.1)])
def test_glued_ring_bends_as_one_section(bridged: bool, order: list[int], angles: tuple[float, ...]) -> None:
    """Kern of the hollow square, docs/method.md (2.6): M = (N + σt A) I / (A c), I = (3⁴ − 1)/12, c = 1.5, A = 8."""
    built = build_assembly(parse_scene(ring_on(rotation(*angles), order, bridged=bridged)))
    assert len(built.interfaces) == 1
    assert not built.interfaces.rectangle[0]
    assert built.interfaces.area[0] == pytest.approx(8.0, rel=1e-12)
    weight, inertia = 9.0 * 2000.0 * 9.81, (81.0 - 1.0) / 12.0
    expected = (weight + 1e5 * 8.0) * inertia / (8.0 * 1.5)
    assert solve(built).load_factor == pytest.approx(expected, rel=1e-7)


def test_stated_interface_with_a_hole_is_its_outline_with_a_bridge() -> None:
    """What is found can be stated: the same section, without warnings."""
    document = ring_on(rotation(0.3, -0.8, 1.1), [0, 1], bridged=True)
    found = build_assembly(parse_scene(document))
    entry = {"elements": ["r", "s"], "polygon": found.interfaces.polygon[0].tolist()}
    stated_again = {**document, "interfaces": [entry]}
    assert misfits(stated_again) == []
    again = build_assembly(parse_scene(stated_again)).interfaces
    for name in ("area", "c_t", "origin"):
        np.testing.assert_allclose(getattr(again, name), getattr(found.interfaces, name), rtol=1e-12)
    assert solve(build_assembly(parse_scene(stated_again))).load_factor == pytest.approx(542544.44444, rel=1e-7)


def test_keyhole_has_the_integrals_of_the_area_without_its_holes() -> None:
    holes = [np.array(RING["inner"], dtype=float), np.array(RING["inner"], dtype=float) * 0.3 + 0.2]
    outline = polygons.keyhole(np.array(RING["outer"], dtype=float), [holes[0]])[None]
    assert polygons.area(outline)[0] == pytest.approx(8.0)
    np.testing.assert_allclose(polygons.centroid(outline)[0], [1.5, 1.5])
    np.testing.assert_allclose(polygons.second_moments(outline)[0], np.eye(2) * 80.0 / 12.0, atol=1e-12)
    assert len(polygons.hull(outline[0])) == 4
    both = polygons.keyhole(np.array(RING["outer"], dtype=float), holes)
    assert polygons.area(both[None])[0] == pytest.approx(8.0 - 0.09)


def half_open(opening: float, **keys: Any) -> dict[str, Any]:
    """A block on another, whose joint is closed along half of its length and opens along the rest."""
    top = [[0, 1], [0.5, 1], [1, 1 + opening], [1, 2], [0, 2]]
    return scene(
        [
            {"id": "b", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
            {"id": "t", "polygon": top},
            {"id": "g", "polygon": [[-5, -1], [5, -1], [5, 0], [-5, 0]], "support": True},
        ],
        live=[{"body": [1, 0]}],
        **keys,
    )


def test_joint_that_opens_from_one_end_is_a_warning_with_angle_and_opening() -> None:
    assert "'b' and 't' touch at one end and open by 0.004 m (0.46°)" in misfits(half_open(0.004))[0]
    closed = build_assembly(parse_scene(half_open(0.004, tolerance=0.0044)))
    assert misfits(half_open(0.004, tolerance=0.0044)) == []
    assert closed.interfaces.l1.tolist() == pytest.approx([1.0, 1.0])
    assert misfits(half_open(0.1)) == []


def test_spatial_joint_that_opens_from_one_end_is_a_warning() -> None:
    turn = rotation(0.2, 0.5, -0.4)
    outline = [[0, 1], [0.5, 1], [1, 1.004], [1, 2], [0, 2]]
    upright = rotation(np.pi / 2, 0.0, 0.0)
    elements = [
        prism("t", outline, 0.0, 1.0, turn @ upright),
        prism("b", [[0, 0], [1, 0], [1, 1], [0, 1]], 0.0, 1.0, turn @ upright),
        prism("g", [[-5, -1], [5, -1], [5, 0], [-5, 0]], -1.0, 2.0, turn @ upright, support=True),
    ]
    assert "'t' and 'b' touch at one end and open by 0.004 m (0.46°)" in misfits(scene(elements))[0]
    whole = [box("g", [0, 0, -1], [1, 1, 0], support=True), box("b", [0, 0, 0], [1, 1, 1])]
    assert misfits(scene(whole)) == []


def stated(polygon: list[list[float]], *more: list[list[float]], **keys: Any) -> dict[str, Any]:
    """A block 1 × 2 on the ground with stated interfaces."""
    elements = [
        {"id": "b", "polygon": [[0, 0], [1, 0], [1, 2], [0, 2]]},
        {"id": "g", "polygon": [[-5, -1], [5, -1], [5, 0], [-5, 0]], "support": True},
    ]
    entries = [{"elements": ["b", "g"], "polygon": each} for each in (polygon, *more)]
    return scene(elements, interfaces=entries, live=[{"body": [1, 0]}], **keys)


@pytest.mark.parametrize(
    ("polygons_", "complaint"),
    [
        ([[[-3, 0], [4, 0]]], "reaches 6 m beyond the face of element 'b'"),
        ([[[0, 0], [1.02, 0]]], r"reaches 0.02 m beyond the face of element 'b'.*\"tolerance\" above 0.02"),
        ([[[0, 0], [1, 0.3]]], "reaches 0.6974 m beyond the face of element 'b'|has no face there"),
        ([[[0, 0.02], [1, 0.02]]], "lies up to 0.02 m inside element 'b'"),
        ([[[0, 0], [0.6, 0]], [[0.5, 0], [1, 0]]], r"interfaces\[1\]: it covers interfaces\[0\]"),
        ([[[0, 0], [1, 0]], [[1, 0], [0, 0]]], r"interfaces\[1\]: it covers interfaces\[0\]"),
    ],
)
def test_stated_interfaces_that_cannot_be_meant_are_refused(polygons_: list[list[list[float]]], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        build_assembly(parse_scene(stated(*polygons_)))


def test_stated_interfaces_that_fit_nearly_are_warnings() -> None:
    assert misfits(stated([[0, 0], [0.5, 0]], [[0.5, 0], [1, 0]])) == []
    found = misfits(stated([[0, 0], [1.005, 0]]))
    assert found == ["interfaces[0].polygon: it reaches 0.005 m beyond the face of element 'b'"]
    assert misfits(stated([[0, 0], [1.005, 0]], tolerance=0.01)) == []


@pytest.mark.parametrize(
    ("corners", "complaint"),
    [
        ([[0, 0], [1.5, 0], [1.5, 1], [0, 1]], "reaches 0.5 m beyond the face of element 'b'"),
        ([[3, 3], [4, 3], [4, 4], [3, 4]], "element 'b' has no face there"),
        ([[0, 0], [1, 0], [0.2, 1], [1, 1]], "its outline crosses itself"),
    ],
)
def test_stated_spatial_interfaces_that_cannot_be_meant_are_refused(corners: list[list[float]], complaint: str) -> None:
    turn = rotation(0.3, -0.8, 1.1)
    elements = [box("b", [0, 0, 0], [1, 1, 1], turn), box("g", [-2, -2, -1], [5, 5, 0], turn, support=True)]
    polygon = (np.column_stack([np.array(corners, dtype=float), np.zeros(4)]) @ turn.T).tolist()
    entry = {"elements": ["b", "g"], "polygon": polygon}
    with pytest.raises(InputError, match=complaint):
        build_assembly(parse_scene(scene(elements, interfaces=[entry])))
    square = (np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) @ turn.T).tolist()
    twice = [{"elements": ["b", "g"], "polygon": square}, {"elements": ["g", "b"], "polygon": square[::-1]}]
    with pytest.raises(InputError, match=r"interfaces\[1\]: it covers interfaces\[0\]"):
        build_assembly(parse_scene(scene(elements, interfaces=twice)))
    assert misfits(scene(elements, interfaces=twice[:1])) == []


def test_a_warped_face_bounds_both_solids_alike() -> None:
    """Wherever the loops of its corners begin: the volumes of two solids beside it add up to that of both."""
    pair = [box("a", (0, 0, 0), (1, 1, 1)), box("b", (0, 0, 1), (1, 1, 2))]
    pair[0]["vertices"][4][2] = pair[1]["vertices"][0][2] = 1.2
    found = []
    for turn in range(4):
        turned = pair[1] | {"faces": [face[turn:] + face[:turn] for face in pair[1]["faces"]]}
        document = scene([box("g", (0, 0, -1), (1, 1, 0), support=True), pair[0], turned])
        assembly = build_assembly(parse_scene(document))
        assert assembly.elements.volume[1:].sum() == pytest.approx(2.0, rel=1e-12)
        found.append(solve(assembly).load_factor)
    assert found == pytest.approx([found[0]] * 4, rel=1e-9)
