"""The standard criterion in the plane, stated as rows, against the closed forms of docs/method.md (2.2) to (3.7)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import linprog

from cases import grid_assembly
from jld_core import LimitAnalysis
from jld_core.geometry import outlines as polygons
from jld_core.mechanics import scaling_of, yield_set

STRENGTHS: dict[str, dict[str, float]] = {
    "plain": {},
    "cohesion": {"cohesion": 1e5},
    "no friction": {"friction": 0.0},
    "no shear": {"friction": 0.0, "shear": 0.0},
    "rough inside": {"inner_friction": 0.4, "shear": 9e5},
    "crushing inside": {"crush_inner": 2e6},
    "crushing": {"crush_dry": 5e6, "crush_inner": 2e6, "cohesion": 1e5},
}


def sets_of(name: str) -> Any:
    given = {"friction": 0.577, "tension": 2e6, "shear": 2e5} | STRENGTHS[name]
    assembly = grid_assembly(["ab", "##", "cd"], **given)
    return yield_set(assembly, scaling_of(assembly))


def capacity(side: Any, n: np.ndarray) -> np.ndarray:
    """c + μN, inf where V is left out of the program."""
    return np.where(side.shear + side.friction > 0.0, side.shear + side.friction * n, np.inf)


def slack(dry: Any, inner: Any, forces: np.ndarray, labels: np.ndarray) -> np.ndarray:
    n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
    of_dry = np.minimum(n - n * n / dry.crush - m, capacity(dry, n) - v)
    of_inner = np.minimum(np.minimum(n + inner.tension, inner.crush - n) / 3.0 - m, capacity(inner, n) - v)
    return np.where(labels, of_dry, of_inner)


def margin(dry: Any, inner: Any, jumps: np.ndarray, labels: np.ndarray) -> np.ndarray:
    opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
    of_dry = np.where(np.isinf(dry.crush), opening - turn - dry.friction * slip, np.inf)
    of_inner = np.where(np.isinf(inner.crush), opening - inner.friction * slip - turn / 3.0, np.inf)
    return np.where(labels, of_dry, of_inner)


def dissipation(dry: Any, inner: Any, jumps: np.ndarray, labels: np.ndarray) -> np.ndarray:
    opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
    closing, cracked = turn + dry.friction * slip - opening, opening - inner.friction * slip
    with np.errstate(all="ignore"):
        early = dry.crush * closing * closing / (4.0 * turn)
        crushed = np.where(closing < 2.0 * turn, early, dry.crush * (closing - turn))
        top = 0.5 * (inner.tension - inner.crush) * cracked + (inner.crush + inner.tension) * turn / 6.0
        bent = np.where(np.isinf(inner.crush), -np.inf, np.maximum(-inner.crush * cracked, top))
    of_dry = np.where((closing <= 0.0) | np.isinf(dry.crush), 0.0, crushed) + dry.shear * slip
    return np.where(labels, of_dry, np.maximum(inner.tension * cracked, bent) + inner.shear * slip)


@pytest.mark.parametrize("name", STRENGTHS)
def test_rows_have_the_slack_and_the_support_function_of_the_closed_forms(name: str) -> None:
    sets, rng = sets_of(name), np.random.default_rng(3)
    both = sets.numbers.side(dry=True), sets.numbers.side(dry=False)
    for _ in range(40):
        labels = rng.random(len(sets.point)) < 0.5
        forces, jumps = rng.normal(size=(2, len(labels), 3))
        jumps[:, 0] = 3.0 * rng.random(len(labels)) - 0.5
        assert sets.slack(forces, labels) == pytest.approx(slack(*both, forces, labels), rel=1e-12, abs=1e-12)
        expected = margin(*both, jumps, labels)
        assert sets.margin(jumps, labels) == pytest.approx(expected, rel=1e-12, abs=1e-12)
        finite = expected >= 0.0
        work = dissipation(*both, jumps, labels)[finite]
        assert sets.dissipation(jumps, labels)[finite] == pytest.approx(work, rel=1e-12, abs=1e-12)
        # many mechanisms at once, as proofs ask
        assert np.array_equal(sets.margin(np.stack([jumps, jumps]), labels)[1], sets.margin(jumps, labels))


@pytest.mark.parametrize("name", STRENGTHS)
def test_rows_of_undecided_faces_enclose_either_label(name: str) -> None:
    """Forces inside a set of one label, drawn by the closed forms, satisfy the linear rows of the hull."""
    sets, rng = sets_of(name), np.random.default_rng(4)
    pattern, both = sets.hull().pattern, (sets.numbers.side(dry=True), sets.numbers.side(dry=False))
    for _ in range(60):
        labels = rng.random(len(sets.point)) < 0.5
        forces = rng.normal(size=(len(labels), 3)) * rng.choice([0.1, 1.0, 5.0])
        forces[~sets.active(labels)] = 0.0
        inside = slack(*both, forces, labels) >= 0.0
        y = np.where(inside[:, None], forces, 0.0).ravel()
        product = np.bincount(pattern.row, pattern.dry * y[pattern.column], minlength=len(pattern.h_dry))
        spare = (pattern.h_dry - product)[: pattern.linear]
        assert spare.min() >= -1e-12 * max(1.0, abs(y).max())


# What encloses planar faces of either label that crush, against samples of both sets (docs/method.md (6.3)).


KINDS: dict[str, tuple[dict[str, float], float]] = {
    "little shear strength": ({}, 1.0003),
    "little of both": ({"shear": 1e4, "tension": 2e5}, 1.0003),
    "weaker inside": ({"crush_inner": 2e6}, 1.0003),
    "cohesion": ({"cohesion": 1e5}, 1.0005),
    "no tension": ({"tension": 0.0}, 1.0003),
    "shear strength beyond all friction": ({"shear": 5e6}, 1.005),
    # the top of the inner set has more shear than the dry line too, and no plane of its own
    "rough inside": ({"inner_friction": 0.3, "shear": 8e5}, 1.06),
    "most strength inside": ({"tension": 3e6, "shear": 1.5e6, "crush_inner": 4e6}, 1.06),
}
"""Strengths that differ from those of the arch of `benchmarks/exact.py`, and how much wider than the hull rows may be,
with a fiftieth of what crushes added."""


def sets_of_hull(**other: float) -> Any:
    strengths = {"friction": 0.577, "tension": 2e6, "shear": 2e5, "crush_dry": 5e6, "crush_inner": 5e6} | other
    return LimitAnalysis(grid_assembly(["a", "#"], **strengths)).template.yield_set


def planes(bow: Any, limit: float) -> np.ndarray:
    """(k, 4) planes −a N + b|V| + c|m| ≤ h of one face, tangents of what is curved among them."""
    (curve, knee), rows = bow.parabola[0], bow.rows[0]
    found = [(rows[1, 0], rows[1, 1], 0.0, rows[1, 2]), (rows[2, 0], 0.0, rows[2, 1], rows[2, 2])]
    found += [(1.0 - 2.0 * curve * n, 0.0, 1.0, curve * n * n) for n in np.linspace(knee, 1.2 * limit, 200)]
    normal, moment, more, first, last, most, friction, cohesion = bow.interaction[0, :8]
    # tangents of |m| ≤ w m₀ + N₁ − N₁²/((1 − w) N_c), N₁ = N − w n₀, where N₁ = (1 − w) n
    for n in np.linspace(first, last, 200 if more else 0):
        slope = 1.0 - 2.0 * n / most
        b = -(moment - slope * normal - n * n / most) / more
        found.append((slope + friction * b, b, 1.0, n * n / most + cohesion * b))
    return np.array(found)


def support(sets: Any, direction: np.ndarray) -> float:
    """Largest F·direction of both sets."""
    labels = np.array([True, False])
    return float(max(sets.dissipation(-direction[None], one[None])[0] for one in labels))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", KINDS)
def test_rows_enclose_either_label_and_hardly_more(name: str) -> None:
    other, wide = KINDS[name]
    sets = sets_of_hull(**other)
    bow = sets.parabolic_bending(undecided=True)
    assert bow is not None
    limit = float(sets.numbers.crush_dry[0])
    rows = planes(bow, limit)
    rng = np.random.default_rng(6)
    n = rng.uniform(-float(sets.tension[0]), limit, 4000)
    v, m = rng.uniform(0.0, 2.0 * limit, n.size), rng.uniform(0.0, limit, n.size)
    for label in np.array([[True], [False]]):
        dry = bool(label[0])
        shear = sets.capacity_of(label) + sets.friction_of(label) * n
        bend = n - n * n / limit if dry else np.minimum(n + sets.tension[0], sets.numbers.crush_inner[0] - n) / 3.0
        held = (bend >= 0.0) & (shear >= 0.0)
        # what lies outside is taken to the boundary
        points = np.column_stack([n, np.minimum(v, shear), np.minimum(m, bend)])[held]
        assert len(points) > 100
        excess = points @ np.array([-rows[:, 0], rows[:, 1], rows[:, 2]]) - rows[:, 3]
        assert excess.max() <= 1e-9 * limit
    ratios = []
    for _ in range(25):
        a, b, c = rng.normal(), abs(rng.normal()), abs(rng.normal())
        direction = np.array([-a, b, c]) / np.linalg.norm([a, b, c])
        # the largest of the rows, V and m not negative
        answer = linprog(
            -direction,
            A_ub=np.column_stack([-rows[:, 0], rows[:, 1], rows[:, 2]]),
            b_ub=rows[:, 3],
            bounds=[(None, None), (0.0, None), (0.0, None)],
        )
        assert answer.status == 0
        hull = support(sets, direction)
        assert -answer.fun >= hull - 1e-7 * limit
        ratios.append((-answer.fun + 0.02 * limit) / (hull + 0.02 * limit))
    assert max(ratios) <= wide


# Sections of polygons against quadrature, closed forms and shapely.


Array = NDArray[np.float64]

TRIANGLE = np.array([[0.0, 0.0], [3.0, 0.4], [0.7, 2.0]])
PENTAGON = np.array([[0.0, 0.0], [2.0, -0.3], [3.1, 1.0], [1.5, 2.2], [-0.4, 1.3]])
NOTCHED = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.5, 3.0], [2.5, 1.0], [1.5, 1.0], [1.5, 3.0], [0.0, 3.0]])


def disc(corners: int, radius: float = 1.0) -> Array:
    angle = 2.0 * np.pi * np.arange(corners) / corners
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rectangle(a: float, b: float) -> Array:
    return np.array([[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]])


def torsion_length_by_quadrature(polygon: Array) -> float:
    """∫ r dA / A in polar coordinates about the centroid, by casting rays; convex polygons."""
    shape = shapely.Polygon(polygon)
    centre = np.array(shape.centroid.coords[0])
    p = polygon - centre
    q = np.roll(p, -1, axis=0)

    def reach(angle: float) -> float:
        ray = np.array([np.cos(angle), np.sin(angle)])
        edge = q - p
        cross = ray[0] * edge[:, 1] - ray[1] * edge[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (p[:, 0] * edge[:, 1] - p[:, 1] * edge[:, 0]) / cross
            share = (p[:, 0] * ray[1] - p[:, 1] * ray[0]) / cross
        hit = (along > 0.0) & (share >= -1e-12) & (share <= 1.0 + 1e-12)
        return float(along[hit].max())

    # between corners the integrand is smooth
    angles = np.sort(np.arctan2(p[:, 1], p[:, 0]))
    total = 0.0
    for low, high in zip(angles, np.append(angles[1:], angles[0] + 2.0 * np.pi), strict=True):
        total += quad(lambda t: reach(t) ** 3 / 3.0, low, high, epsabs=0.0, epsrel=1e-13)[0]
    return total / shape.area


@pytest.mark.parametrize(
    "polygon", [rectangle(1, 1), rectangle(3, 0.2), TRIANGLE, PENTAGON, disc(7), disc(24, 2.5)], ids=len
)
def test_torsion_length_equals_quadrature(polygon: Array) -> None:
    """docs/method.md (1.4): c_T = (1/A) ∫ r dA about the centroid; 1e-12 relative."""
    far = polygon + np.array([3.0, -7.0])
    assert polygons.torsion_length(far[None])[0] == pytest.approx(torsion_length_by_quadrature(polygon), rel=1e-12)


def test_torsion_length_of_rectangles_in_closed_form() -> None:
    """docs/method.md (1.5): the unit square has 0.382598."""
    a, b = np.array([1.0, 2.0, 50.0]), np.array([1.0, 0.3, 0.01])
    stack = np.array([rectangle(x, y) for x, y in zip(a, b, strict=True)])
    closed = polygons.rectangle_torsion_length(a, b)
    assert closed[0] == pytest.approx(0.382598, abs=5e-7)
    np.testing.assert_allclose(polygons.torsion_length(stack), closed, rtol=1e-12)


def test_torsion_length_of_polygons_tends_to_that_of_the_disc() -> None:
    """A disc has 2R/3; regular polygons converge with the square of the number of corners."""
    counts = np.array([16, 32, 64, 128])
    error = [2.0 / 3.0 - polygons.torsion_length(disc(n)[None])[0] for n in counts]
    slope = np.polyfit(np.log(counts), np.log(error), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.05)


def test_torsion_length_where_an_edge_points_at_the_centroid() -> None:
    """An S about its centre: two edges have d = 0, and the integral is known from its halves."""
    ess = np.array([[-1, -1], [2, -1], [2, 0], [1, 0], [1, 1], [-2, 1], [-2, 0], [-1, 0]], dtype=float)

    def quarter(a: float, b: float) -> float:
        """∫ r dA over [0, a] × [0, b]: a quarter of the rectangle 2a × 2b."""
        return float(a * b * polygons.rectangle_torsion_length(np.array([2 * a]), np.array([2 * b]))[0])

    half = quarter(2.0, 1.0) + quarter(1.0, 1.0)
    for noise in (0.0, 1e-9, 1e-13, 1e-16, 1e-170):
        moved = ess + noise * np.cos(np.arange(16).reshape(8, 2))
        assert polygons.torsion_length(moved[None])[0] == pytest.approx(2.0 * half / 6.0, rel=1e-13 + 10.0 * noise)


@pytest.mark.parametrize("polygon", [TRIANGLE, PENTAGON, NOTCHED], ids=["triangle", "pentagon", "notched"])
def test_area_centroid_and_second_moments(polygon: Array) -> None:
    """Against shapely, and the midpoint rule on triangles, which is exact for second degree; 1e-12."""
    shape = shapely.Polygon(polygon)
    assert polygons.area(polygon[None])[0] == pytest.approx(shape.area, rel=1e-13)
    assert polygons.area(polygon[None, ::-1])[0] == pytest.approx(-shape.area, rel=1e-13)
    centre = polygons.centroid(polygon[None])[0]
    np.testing.assert_allclose(centre, shape.centroid.coords[0], rtol=1e-12)
    total = np.zeros((2, 2))
    for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(shape)):
        corner = shapely.get_coordinates(triangle)[:3] - centre
        for middle in 0.5 * (corner + np.roll(corner, -1, axis=0)):
            total += triangle.area / 3.0 * np.outer(middle, middle)
    np.testing.assert_allclose(polygons.second_moments(polygon[None])[0], total, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("polygon", [TRIANGLE, PENTAGON, NOTCHED, disc(9)], ids=len)
def test_hull_rows_hold_the_centre_of_pressure(polygon: Array) -> None:
    """docs/method.md (1.3): x1 = −M2/N, x2 = M1/N, within the hull exactly where all rows are ≥ 0."""
    local = polygon - polygons.centroid(polygon[None])
    outline = polygons.hull(local)
    assert shapely.Polygon(outline).equals(shapely.Polygon(local).convex_hull)
    hull = shapely.Polygon(local).convex_hull
    rows = polygons.hull_rows(outline)
    assert len(rows) == len(outline)
    rng = np.random.default_rng(1)
    for x1, x2 in rng.uniform(local.min(axis=0) - 0.3, local.max(axis=0) + 0.3, (200, 2)):
        n = rng.uniform(0.1, 5.0)
        least = (rows @ [n, x2 * n, -x1 * n]).min()
        inside = hull.contains(shapely.Point(x1, x2))
        distance = hull.exterior.distance(shapely.Point(x1, x2))
        assert (least > 0.0) == inside
        if inside:
            assert least / n == pytest.approx(distance, rel=1e-9)


def test_hulls_equal_single_hulls_and_leave_convex_polygons_alone() -> None:
    star = disc(10)
    star[::2] *= 0.4
    twice_around = disc(7)[[0, 2, 4, 6, 1, 3, 5]]
    found = polygons.hulls([PENTAGON, NOTCHED, star, twice_around])
    assert found[0] is PENTAGON
    for polygon, outline in zip([NOTCHED, star, twice_around], found[1:], strict=True):
        np.testing.assert_array_equal(outline, polygons.hull(polygon))
    assert [len(outline) for outline in found[1:]] == [4, 5, 7]


@pytest.mark.parametrize("polygon", [TRIANGLE, PENTAGON, NOTCHED], ids=["triangle", "pentagon", "notched"])
def test_kern_rows_are_edge_stresses(polygon: Array) -> None:
    """The linear stress with resultants N, M1 = ∫σ x2, M2 = −∫σ x1, at the corners, times the area."""
    local = polygon - polygons.centroid(polygon[None])
    area, moments = polygons.area(local[None])[0], polygons.second_moments(local[None])[0]
    outline = polygons.hull(local)
    rng = np.random.default_rng(2)
    mean, slope = rng.normal(), rng.normal(size=2)
    n, first = mean * area, moments @ slope
    rows = polygons.kern_rows(outline, area, moments)
    np.testing.assert_allclose(rows @ [n, first[1], -first[0]], area * (mean + outline @ slope), rtol=1e-12)


def test_kern_rows_of_a_rectangle() -> None:
    """N ± 6 M1/l2 ± 6 M2/l1."""
    a, b = 2.0, 0.5
    outline = rectangle(a, b) - [a / 2, b / 2]
    rows = polygons.kern_rows(outline, a * b, polygons.second_moments(outline[None])[0])
    np.testing.assert_allclose(np.abs(rows), np.tile([1.0, 6.0 / b, 6.0 / a], (4, 1)), rtol=1e-13)


def test_rectangles_are_distinguished_from_similar_quadrilaterals() -> None:
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    trapezoid = np.array([[0.0, 0.0], [2.0, 0.0], [1.9, 1.0], [0.1, 1.0]])
    rhombus = np.array([[0.0, 0.0], [1.0, 0.3], [1.3, 1.3], [0.3, 1.0]])
    crossed = rectangle(2, 1)[[0, 2, 1, 3]]
    stack = np.array([rectangle(3, 1) @ turn, trapezoid, rhombus, crossed])
    np.testing.assert_array_equal(polygons.is_rectangle(stack, 1e-9), [True, False, False, False])
    assert not polygons.is_rectangle(PENTAGON[None], 1e-9).any()


def test_idle_corners_are_dropped() -> None:
    """A rectangle with points on its edges, as files of single precision have them, is a rectangle."""
    points = np.array([[0, 0], [1, 1e-8], [2, 0], [2, 1], [2 - 1e-9, 1 + 1e-9], [0.3, 1], [0, 1]])
    plain = polygons.without_idle_corners([points, PENTAGON, rectangle(1, 2)], 1e-6)
    assert polygons.is_rectangle(plain[0][None], 1e-6)[0]
    np.testing.assert_array_equal(plain[1], PENTAGON)
    np.testing.assert_array_equal(plain[2], rectangle(1, 2))
    spatial = np.column_stack([points, points[:, 0]])
    assert len(polygons.corners(spatial, 1e-6)) == 4


def test_stacks_by_corner_count() -> None:
    stacks = list(polygons.by_corner_count([PENTAGON, TRIANGLE, PENTAGON + 1.0]))
    assert [(list(chosen), stack.shape) for chosen, stack in stacks] == [([1], (1, 3, 2)), ([0, 2], (2, 5, 2))]
