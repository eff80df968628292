"""Walls with openings, drawn as solids, and bonded corners: volumes, lintels, quoins, any position, and λ."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from cases import dry_and_inner, solid_of
from jld_core import InputError, Scene, build_assembly, parse_scene, samples, solve
from jld_core.refinement import refine
from jld_formats import ImportOptions, import_file
from jld_masonry import bonds
from jld_samples import box

_Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Least and largest coordinates of a box."""

WALL: _Box = ((0.0, 0.0, 0.0), (2.4, 0.2, 1.2))
DOOR: _Box = ((0.8, 0.0, 0.0), (1.6, 0.2, 0.8))
WINDOW: _Box = ((0.7, 0.0, 0.4), (1.5, 0.2, 0.8))

ROOM: list[_Box] = [((0.0, 0.0, 0.0), (3.0, 2.4, 1.2))]
EMPTY: list[_Box] = [
    ((0.2, 0.2, 0.0), (2.8, 2.2, 1.2)),
    ((0.9, 0.0, 0.0), (1.7, 0.2, 0.8)),  # a door
    ((0.0, 0.7, 0.4), (0.2, 1.5, 0.8)),  # windows
    ((0.6, 2.2, 0.3), (1.2, 2.4, 0.8)),
    ((1.65, 2.2, 0.3), (2.3, 2.4, 0.8)),
]


def solid(full: list[_Box], empty: list[_Box], turn: float = 0.0) -> dict[str, Any]:
    """Return the element of a union of boxes without other boxes, with faces of many coplanar quadrilaterals.

    turn: angle about the upright axis, rad.
    """
    levels = [np.unique([corner[k] for one in full + empty for corner in one]) for k in range(3)]
    middles = np.stack(np.meshgrid(*[0.5 * (a[1:] + a[:-1]) for a in levels], indexing="ij"), axis=-1)
    inside = [
        np.any([((middles > low) & (middles < high)).all(axis=-1) for low, high in boxes], axis=0)
        if boxes
        else np.zeros(middles.shape[:3], dtype=bool)
        for boxes in (full, empty)
    ]
    element = solid_of("w", inside[0] & ~inside[1], levels)
    return element | {"vertices": (np.array(element["vertices"]) @ spin(turn).T).tolist()}


def spin(turn: float) -> np.ndarray:
    """Return the rotation (3, 3) about the upright axis."""
    return np.array([[math.cos(turn), -math.sin(turn), 0.0], [math.sin(turn), math.cos(turn), 0.0], [0.0, 0.0, 1.0]])


def scene_of(walls: dict[str, Any], turn: float = 0.0, friction: float = 0.6) -> Scene:
    """Return the scene of walls on a footing, pushed along the turned x axis."""
    ground = box("ground", (-0.4, -0.4, -0.2), (4.0, 3.0, 0.0), support=True)
    ground["vertices"] = (np.array(ground["vertices"]) @ spin(turn).T).tolist()
    given = {
        "elements": [ground, walls],
        "materials": dry_and_inner(2000.0, friction, 2e5, 2e5),
        "loads": {"live": [{"body": (spin(turn) @ [1.0, 0.0, 0.0]).tolist()}]},
    }
    return parse_scene(given, "walls")


def cut(walls: dict[str, Any], **options: Any) -> list[np.ndarray]:
    """Return the corners (8, 3) of all stones of walls in a bond of stretchers of 0.4 and courses of 0.2."""
    made = refine(scene_of(walls), (0.4, 0.2), kind="bond", **options).scene
    return [np.array(one.vertices) for one in made.elements or [] if not one.support]


def dry(scene: Scene) -> float:
    """Return λ of a scene whose joints are all dry."""
    assembly = build_assembly(scene)
    found = solve(assembly, np.ones(len(assembly.interfaces), dtype=bool)).load_factor
    assert found is not None
    return found


def boxes_of(stones: list[np.ndarray]) -> np.ndarray:
    """Return the least and largest coordinates (k, 2, 3) of upright stones."""
    return np.array([[one.min(axis=0), one.max(axis=0)] for one in stones])


def head_joints(stones: np.ndarray, axis: int, middle: float) -> np.ndarray:
    """Return place, foot and top (e, 3) of both ends of all stones of a wall.

    stones: (k, 2, 3). axis: along the wall. middle: coordinate of its middle plane.
    """
    own = stones[(stones[:, 0, 1 - axis] < middle) & (stones[:, 1, 1 - axis] > middle)]
    ends = [(float(end[axis]), float(low[2]), float(high[2])) for low, high in own for end in (low, high)]
    return np.array(sorted(set(ends)))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("bond", bonds.BONDS)
def test_stones_of_a_room_with_door_and_windows_add_up_and_no_joint_stands_above_another_at_jambs(bond: str) -> None:
    walls = solid(ROOM, EMPTY)
    stones = boxes_of(cut(walls, bond=bond))
    sizes = stones[:, 1] - stones[:, 0]
    whole = build_assembly(scene_of(walls)).elements.volume.sum() - 4.4 * 3.4 * 0.2
    assert sizes.prod(axis=1).sum() == pytest.approx(whole, rel=1e-9)
    # no two overlap, and none lies in an opening
    meet = np.minimum(stones[:, None, 1], stones[None, :, 1]) - np.maximum(stones[:, None, 0], stones[None, :, 0])
    assert ((meet > 1e-9).all(axis=2).sum(axis=1) == 1).all()
    for low, high in EMPTY:
        assert not (np.minimum(stones[:, 1], high) - np.maximum(stones[:, 0], low) > 1e-9).all(axis=1).any()
    # no slivers: a quarter of a stretcher at least, and courses of half their height
    assert sizes[:, :2].max(axis=1).min() > 0.1 - 1e-9
    assert sizes[:, 2].min() > 0.1 - 1e-9
    # beside each jamb, head joints of courses above one another are a quarter of a stretcher apart, or are the jamb
    for low, high in EMPTY[1:]:
        axis = int(high[1] - low[1] > 0.2 + 1e-9)
        edges = head_joints(stones, axis, 0.5 * (low[1 - axis] + high[1 - axis]))
        jambs = [one[axis] for low_, high_ in EMPTY[1:] if low_[1 - axis] == low[1 - axis] for one in (low_, high_)]
        for jamb in (low[axis], high[axis]):
            near = edges[abs(edges[:, 0] - jamb) < 0.45]
            for a, b in itertools.product(near, near):
                is_jamb = any(abs(a[0] - one) < 1e-9 for one in jambs)
                if abs(a[2] - b[1]) < 1e-9 and bond != "stack" and not (is_jamb and abs(a[0] - b[0]) < 1e-9):
                    assert abs(a[0] - b[0]) > 0.1 - 1e-9, (jamb, a, b)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("bond", ["running", "english", "flemish", "third"])
def test_each_lintel_bears_on_both_jambs_and_quoins_alternate(bond: str) -> None:
    stones = boxes_of(cut(solid(ROOM, EMPTY), bond=bond))
    for low, high in EMPTY[1:]:
        axis = int(high[1] - low[1] > 0.2 + 1e-9)
        over = (abs(stones[:, 0, 2] - high[2]) < 1e-9) & (stones[:, 0, 1 - axis] == low[1 - axis])
        over &= (stones[:, 0, axis] < high[axis] - 1e-9) & (stones[:, 1, axis] > low[axis] + 1e-9)
        assert over.sum() == 1  # one stone over the whole opening
        lintel = stones[over][0]
        assert min(low[axis] - lintel[0, axis], lintel[1, axis] - high[axis]) > 0.1 - 1e-9
    for x, y in itertools.product((0.0, 3.0), (0.0, 2.4)):
        quoins = [one for one in stones if x in one[:, 0] and y in one[:, 1]]
        along = [int(b[0] - a[0] > b[1] - a[1]) for a, b in sorted(quoins, key=lambda one: one[0, 2])]
        assert along == [k % 2 for k in range(1, 1 + len(along))] or along == [k % 2 for k in range(len(along))]


def test_a_given_bearing_is_kept_and_a_flat_arch_has_its_wedges_between_skewbacks() -> None:
    wide = boxes_of(cut(solid([WALL], [DOOR]), bearing=0.5))
    assert max(wide[:, 1, 0] - wide[:, 0, 0]) == pytest.approx(0.8 + 2 * 0.5)
    one, five = (cut(solid([WALL], [WINDOW]), lintel=number) for number in (1, 5))
    assert len(five) == len(one) + 6  # five wedges and two skewbacks in the place of one stone
    raked = [stone for stone in five if len(np.unique(stone[:, 0].round(9))) > 2]
    # joints of all wedges meet in one point on the axis of the opening: the lean is half the bearing over the course
    for stone in raked:
        for side in (0, 1):
            foot, top = stone[side], stone[4 + side]
            if abs(foot[0] - top[0]) > 1e-9:
                below = foot + (foot[0] - 1.1) * (foot - top) / (top[0] - foot[0])
                assert below[0] == pytest.approx(1.1)
                assert below[2] == pytest.approx(0.8 - 0.4 * 0.2 / 0.1)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("turn", "start"), [(0.3, 0.0), (2.0, 5.0), (4.4, -3.0)])
def test_walls_with_openings_are_cut_alike_in_any_position(turn: float, start: float) -> None:
    placed, turned = (scene_of(solid(ROOM, EMPTY, angle), angle) for angle in (0.0, turn))
    moved = turned.model_dump(mode="json", exclude_defaults=True)
    for entry in moved["elements"]:
        entry["vertices"] = [[x + start, y - start, z] for x, y, z in entry["vertices"]]
    one, other = (refine(scene, (0.4, 0.2), kind="bond").scene for scene in (placed, parse_scene(moved, "turned")))
    volumes = [np.sort(build_assembly(scene).elements.volume) for scene in (one, other)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-9)
    assert dry(one) == pytest.approx(dry(other), rel=1e-6)


def test_a_portal_overturns_at_the_width_of_its_piers_over_their_height() -> None:
    """Both piers turn about their toes and lift the lintel alike: λ (W h/2 · 2 + L h) = W b/2 · 2 + L b."""
    portal = solid([((0.0, 0.0, 0.0), (1.6, 0.2, 0.8))], [((0.4, 0.0, 0.0), (1.2, 0.2, 0.6))])
    made = refine(scene_of(portal, friction=0.9), (0.8, 0.2), kind="bond", bearing=0.4).scene
    assert dry(made) == pytest.approx(0.4 / 0.6, rel=1e-7)


@pytest.mark.parametrize("options", [{}, {"lintel": 5}, {"bond": "flemish"}])
def test_a_wall_with_openings_pushed_in_its_plane_carries_what_its_elevation_does(options: dict[str, Any]) -> None:
    """By reflection about its middle plane, the wall in space is the planar one of the outlines of its stones."""
    made = refine(scene_of(solid([WALL], [DOOR])), (0.4, 0.2), kind="bond", **options).scene
    document = made.model_dump(mode="json", exclude_defaults=True)
    planar = []
    for entry in document["elements"]:
        corners = np.array(entry["vertices"])
        front = corners[corners[:, 1] == corners[:, 1].min()][:, [0, 2]]
        about = front - front.mean(axis=0)
        around = front[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
        planar.append({"id": entry["id"], "polygon": around.tolist(), "support": entry.get("support", False)})
    flat = {
        "elements": planar,
        "thickness": 0.2,
        "materials": document["materials"],
        "loads": {"live": [{"body": [1.0, 0.0]}]},
    }
    assert dry(made) == pytest.approx(dry(parse_scene(flat, "elevation")), rel=1e-6)


def test_the_room_of_jld_new_is_that_of_jld_refine() -> None:
    door, window = ((0.8, 0.0, 0.0), (1.4, 0.2, 0.8)), ((0.0, 0.6, 0.4), (0.2, 1.2, 0.8))
    inside = ((0.2, 0.2, 0.0), (2.2, 1.8, 1.2))
    walls = solid([((0.0, 0.0, 0.0), (2.4, 2.0, 1.2))], [inside, door, window])
    made, sample = refine(scene_of(walls), (0.4, 0.2), kind="bond").scene, samples.KINDS["room"]()
    counts = [len(build_assembly(scene).elements.free) for scene in (made, sample)]
    assert counts[0] == counts[1]
    assert dry(made) == pytest.approx(dry(sample), rel=1e-6)


def test_a_solid_of_triangles_is_cut_as_one_of_whole_faces(tmp_path: Path) -> None:
    walls = solid(ROOM, EMPTY)
    lines, shift = [], 1
    for one in (walls, box("ground", (-0.4, -0.4, -0.2), (4.0, 3.0, 0.0))):
        lines += [f"o {one['id']}", *(f"v {x} {y} {z}" for x, y, z in one["vertices"])]
        triangles = [part for loop in one["faces"] for part in (loop[:3], [loop[0], *loop[2:]])]
        lines += ["f " + " ".join(str(index + shift) for index in part) for part in triangles]
        shift += len(one["vertices"])
    (tmp_path / "room.obj").write_text("\n".join(lines) + "\n")
    scene = parse_scene(import_file(tmp_path / "room.obj", ImportOptions(support=("lowest",))).document, "room")
    made = refine(scene, (0.4, 0.2), kind="bond").scene
    assert len([one for one in made.elements or [] if not one.support]) == len(cut(walls))


@pytest.mark.parametrize(
    ("full", "empty", "options", "words"),
    [
        ([WALL], [((0.05, 0.0, 0.0), (1.6, 0.2, 0.8))], {}, "an opening leaves 0.05 of wall beside it"),
        (ROOM, [EMPTY[0], ((0.25, 0.0, 0.4), (1.0, 0.2, 0.8))], {}, "an opening leaves 0.05 of wall beside it"),
        ([WALL], [DOOR], {"bearing": 0.9}, "an opening leaves 0.8 of wall beside it"),
        ([WALL], [((0.0, 0.0, 0.0), (1.6, 0.2, 0.8))], {}, "an opening leaves 0 of wall beside it"),
        ([WALL], [((0.8, 0.1, 0.4), (1.6, 0.2, 0.8))], {}, "an opening is no rectangle through its wall"),
        ([WALL], [DOOR, ((1.0, 0.0, 0.8), (1.4, 0.2, 1.0))], {}, "an opening is narrower above"),
        ([WALL], [((0.8, 0.0, 0.4), (1.2, 0.2, 0.8)), ((1.6, 0.0, 0.4), (2.0, 0.2, 0.83))], {}, "0.03 apart"),
    ],
)
def test_openings_that_cannot_be_spanned_are_refused_in_one_line(
    full: list[_Box], empty: list[_Box], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        cut(solid(full, empty), **options)


def test_faces_with_holes_are_windows() -> None:
    """Front and back of the wall are single loops that reach the window by a bridge and go back along it."""
    outline = [(0.0, 0.0), (2.4, 0.0), (2.4, 1.2), (0.0, 1.2)]
    hole = [(0.7, 0.4), (1.5, 0.4), (1.5, 0.8), (0.7, 0.8)]
    vertices = [[x, y, z] for part in (outline, hole) for y in (0.0, 0.2) for x, z in part]
    faces = [[0, 1, 2, 3, 0, 8, 11, 10, 9, 8], [12, 13, 14, 15, 12, 4, 7, 6, 5, 4]]
    faces += [[1, 0, 4, 5], [2, 1, 5, 6], [3, 2, 6, 7], [0, 3, 7, 4]]
    faces += [[11, 8, 12, 15], [10, 11, 15, 14], [9, 10, 14, 13], [8, 9, 13, 12]]
    bridged = boxes_of(cut({"id": "w", "vertices": vertices, "faces": faces}))
    assert bridged == pytest.approx(boxes_of(cut(solid([WALL], [WINDOW]))))


# Bonded corners in space: stones of a plan, `jld refine --kind bond` as `jld new corner`, and what a bond adds.


ROOM_OF_CORNER = shapely.box(0.0, 0.0, 3.0, 2.0).difference(shapely.box(0.2, 0.2, 2.8, 1.8))
CROSS = shapely.union(shapely.box(0.0, 0.0, 3.0, 0.2), shapely.box(1.4, -1.0, 1.6, 1.2))
CORNER = shapely.Polygon([(0.0, 0.0), (1.6, 0.0), (1.6, 0.2), (0.2, 0.2), (0.2, 1.2), (0.0, 1.2)])


def solid_of_corner(plan: shapely.Polygon, height: float, turn: float = 0.0, start: int = 0) -> dict[str, Any]:
    """Return an element over a plan without holes that is turned about the upright axis.

    height: of the solid, m. turn: angle, rad. start: corner at which the outline begins.
    """
    points = np.roll(shapely.get_coordinates(shapely.geometry.polygon.orient(plan).exterior)[:-1], -start, axis=0)
    points = points @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    count = len(points)
    sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    vertices = [[*point, z] for z in (0.0, height) for point in points.tolist()]
    return {"id": "w", "vertices": vertices, "faces": [[*range(count)][::-1], [*range(count, 2 * count)], *sides]}


def document(free: list[dict[str, Any]], turn: float = 0.0) -> dict[str, Any]:
    """Return a scene of elements on a footing, pushed along the turned x axis."""
    spin = np.array([[math.cos(turn), -math.sin(turn), 0.0], [math.sin(turn), math.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    ground = box("ground", (-0.4, -0.4, -0.2), (2.0, 1.6, 0.0), support=True)
    ground["vertices"] = (np.array(ground["vertices"]) @ spin.T).tolist()
    return {
        "elements": [ground, *free],
        "materials": dry_and_inner(2000.0, 0.6, 2e5, 2e5),
        "loads": {"live": [{"body": (spin @ [1.0, 0.0, 0.0]).tolist()}]},
    }


def dry_load_factor(given: dict[str, Any]) -> float:
    """Return λ of a scene whose joints are all dry."""
    assembly = build_assembly(parse_scene(given, "corner"))
    found = solve(assembly, np.ones(len(assembly.interfaces), dtype=bool)).load_factor
    assert found is not None
    return found


@pytest.mark.parametrize("plan", [ROOM_OF_CORNER, CROSS, CORNER], ids=["room", "cross", "corner"])
@pytest.mark.parametrize("bond", bonds.BONDS)
def test_stones_of_a_course_fill_the_plan_and_no_head_joint_runs_through_a_corner(
    bond: str, plan: shapely.Polygon
) -> None:
    """Areas add up, no stone is a sliver, and no joint at a corner lies above one of the course below."""
    courses = [[shapely.box(*stone) for stone in bonds.corner_course(plan, k, bond, 0.4)] for k in range(6)]
    for stones in courses:
        assert sum(stone.area for stone in stones) == pytest.approx(plan.area, rel=1e-12)
        assert shapely.union_all(stones).symmetric_difference(plan).area < 1e-12
        assert min(min(s.bounds[2] - s.bounds[0], s.bounds[3] - s.bounds[1]) for s in stones) > 0.1 - 1e-9
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (plan.exterior, *plan.interiors)]
    for below, above in itertools.pairwise(courses):
        joints = [
            shapely.union_all([s.exterior for s in stones]).difference(plan.boundary) for stones in (below, above)
        ]
        shared = joints[0].intersection(joints[1])
        for corner in np.concatenate(rings):
            near = shapely.Point(corner).buffer(0.05)
            assert shared.intersection(near).length == 0.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("turn", "start"), [(0.0, 0), (0.3, 2), (0.9, 1), (2.0, 5)])
def test_a_solid_corner_in_any_position_is_cut_as_the_sample_is(turn: float, start: int) -> None:
    made = refine(
        parse_scene(document([solid_of_corner(CORNER, 0.8, turn, start)], turn), "c"), (0.4, 0.2), kind="bond"
    )
    assembly, sample = build_assembly(made.scene), build_assembly(samples.corner())
    assert len(assembly.elements.free) == len(sample.elements.free)
    found = solve(assembly, np.ones(len(assembly.interfaces), dtype=bool)).load_factor
    assert found == pytest.approx(solve(sample).load_factor, rel=1e-9)


def test_a_bonded_corner_carries_more_than_walls_that_only_touch() -> None:
    """Pushed along x. Apart, the wall along y overturns: thickness over height. Touching, friction holds it."""

    def walls(gap: float) -> float:
        """Return λ of two walls in courses with a gap between them, m."""
        rows = [0.2 * k for k in range(4)]
        along_x = [box(f"x{k}", (0.0, 0.0, z), (1.6, 0.2, z + 0.2)) for k, z in enumerate(rows)]
        along_y = [box(f"y{k}", (0.0, 0.2 + gap, z), (0.2, 1.2, z + 0.2)) for k, z in enumerate(rows)]
        return dry_load_factor(document(along_x + along_y))

    bonded = solve(build_assembly(samples.corner())).load_factor
    assert walls(0.05) == pytest.approx(0.2 / 0.8, rel=1e-9)
    assert walls(0.0) < 0.8 * bonded


def test_solids_that_are_no_wall_are_refused_in_one_line() -> None:
    skew = shapely.Polygon([(0.0, 0.0), (1.6, 0.3), (1.5, 0.5), (0.0, 0.2)])
    with pytest.raises(InputError, match="element 'w': an edge of its plan is at no right angle"):
        refine(parse_scene(document([solid_of_corner(skew, 0.8)]), "c"), (0.4, 0.2), kind="bond")
    tapered = solid_of_corner(CORNER, 0.8)
    tapered["vertices"][6:] = [[0.9 * x, 0.9 * y, z] for x, y, z in tapered["vertices"][6:]]
    with pytest.raises(InputError, match="element 'w': it is no upright prism"):
        refine(parse_scene(document([tapered]), "c"), (0.4, 0.2), kind="bond")
    with pytest.raises(InputError, match="cells"):
        refine(parse_scene(document([solid_of_corner(CORNER, 0.8)]), "c"), (1e-3, 1e-3), kind="bond")
