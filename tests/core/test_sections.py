"""Sections of polygons against quadrature, closed forms and shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.integrate import quad

from jld_core.geometry import outlines as polygons

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
