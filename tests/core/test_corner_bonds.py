"""Bonded corners in space: stones of a plan, `jld refine --kind bond` as `jld new corner`, and what a bond adds."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely

from cases import dry_and_inner
from jld_core import InputError, build_assembly, parse_scene, samples, solve
from jld_core.errors import ParameterError
from jld_core.refinement import refine
from jld_core.samples import box
from jld_core.samples.bonds import BONDS
from jld_core.samples.bonds import corner_course

ROOM = shapely.box(0.0, 0.0, 3.0, 2.0).difference(shapely.box(0.2, 0.2, 2.8, 1.8))
CROSS = shapely.union(shapely.box(0.0, 0.0, 3.0, 0.2), shapely.box(1.4, -1.0, 1.6, 1.2))
CORNER = shapely.Polygon([(0.0, 0.0), (1.6, 0.0), (1.6, 0.2), (0.2, 0.2), (0.2, 1.2), (0.0, 1.2)])


def solid(plan: shapely.Polygon, height: float, turn: float = 0.0, start: int = 0) -> dict[str, Any]:
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


@pytest.mark.parametrize("plan", [ROOM, CROSS, CORNER], ids=["room", "cross", "corner"])
@pytest.mark.parametrize("bond", BONDS)
def test_stones_of_a_course_fill_the_plan_and_no_head_joint_runs_through_a_corner(
    bond: str, plan: shapely.Polygon
) -> None:
    """Areas add up, no stone is a sliver, and no joint at a corner lies above one of the course below."""
    courses = [[shapely.box(*stone) for stone in corner_course(plan, k, bond, 0.4)] for k in range(6)]
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


@pytest.mark.parametrize(("turn", "start"), [(0.0, 0), (0.3, 2), (0.9, 1), (2.0, 5)])
def test_a_solid_corner_in_any_position_is_cut_as_the_sample_is(turn: float, start: int) -> None:
    made = refine(parse_scene(document([solid(CORNER, 0.8, turn, start)], turn), "c"), (0.4, 0.2), kind="bond")
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
    assert bonded is not None
    assert walls(0.05) == pytest.approx(0.2 / 0.8, rel=1e-9)
    assert walls(0.0) < 0.8 * bonded


def test_solids_that_are_no_wall_are_refused_in_one_line() -> None:
    skew = shapely.Polygon([(0.0, 0.0), (1.6, 0.3), (1.5, 0.5), (0.0, 0.2)])
    with pytest.raises(InputError, match="element 'w': an edge of its plan is at no right angle"):
        refine(parse_scene(document([solid(skew, 0.8)]), "c"), (0.4, 0.2), kind="bond")
    tapered = solid(CORNER, 0.8)
    tapered["vertices"][6:] = [[0.9 * x, 0.9 * y, z] for x, y, z in tapered["vertices"][6:]]
    with pytest.raises(InputError, match="element 'w': it is no upright prism"):
        refine(parse_scene(document([tapered]), "c"), (0.4, 0.2), kind="bond")
    with pytest.raises(ParameterError, match="cells"):
        refine(parse_scene(document([solid(CORNER, 0.8)]), "c"), (1e-3, 1e-3), kind="bond")
