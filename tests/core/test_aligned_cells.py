"""Cells aligned with the thrust: directions in closed form, a second route by resultants, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from jld_core import InputError, build_assembly, parse_scene
from jld_core.arrays import Floats
from jld_core.fields.problem import require_fields
from jld_core.refinement import refine
from jld_core.refinement.arrangement import squares
from jld_practice.design.aligned import TriangleStresses, aligned_cells
from jld_practice.design.crushing import stresses_of_body
from jld_practice.design.loads import with_loads
from jld_practice.design.options import DesignOptions
from jld_practice.design.outline import read_outline


def mesh(columns: int, rows: int) -> tuple[Floats, Floats]:
    """Nodes (p, 2) of the unit square and triangles (t, 3), two in each of columns × rows boxes."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    k = np.arange((columns + 1) * rows).reshape(rows, columns + 1)[:, :-1].ravel()
    above = k + columns + 1
    lower, upper = np.column_stack([k, k + 1, above]), np.column_stack([k + 1, above + 1, above])
    return np.column_stack([x.ravel(), y.ravel()]), np.concatenate([lower, upper])


def uniaxial(direction: Floats, size: float = -1e6) -> Floats:
    """Stresses (t, 3) of one principal stress along directions (t, 2)."""
    c, s = direction.T
    return np.asarray(size * np.column_stack([c * c, s * s, c * s]))


def inner_edges(cells: list[shapely.Polygon], outline: shapely.Geometry) -> Floats:
    """Edges (k, 2, 2) of cells away from the outline."""
    edges = [np.stack([r[:-1], r[1:]], axis=1) for r in (shapely.get_coordinates(one.exterior) for one in cells)]
    every = np.concatenate(edges)
    apart = shapely.distance(shapely.points(every.mean(axis=1)), outline)
    return np.asarray(every[(apart > 0.02) & (np.hypot(*(every[:, 1] - every[:, 0]).T) > 1e-6)])


@pytest.mark.parametrize(("turn", "scale"), [(0.0, 1.0), (0.6, 1.0), (2.5, 1e3)])
def test_a_strut_has_joints_across_its_axis(turn: float, scale: float) -> None:
    """A strut of 3 × 1 under axial stress is cut in 6 × 2 squares, in any position and size."""
    points, triangles = mesh(24, 8)
    c, s = np.cos(turn), np.sin(turn)
    frame = scale * np.array([[c, s], [-s, c]])
    axis = np.tile([c, s], (len(triangles), 1))
    field = TriangleStresses((points * (3.0, 1.0)) @ frame + 7.0 * scale, triangles, uniaxial(axis))
    found = aligned_cells(field, 0.5 * scale)
    assert len(found.cells) == 12
    assert found.deviation == pytest.approx(0.0, abs=1e-6)
    # cells reach beyond the outline by a thousandth of their side
    assert [one.area for one in found.cells] == pytest.approx([0.25 * scale**2] * 12, rel=5e-3)


def test_a_ring_has_radial_joints() -> None:
    """Compression along circles about a centre: joints are radial or tangential; chords and ends leave both by 4°."""
    points, triangles = mesh(60, 8)
    angle, radius = np.pi * (1.0 - points[:, 0]), 2.0 + 0.6 * points[:, 1]
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    middle = ring[triangles].mean(axis=1)
    away = middle / np.hypot(*middle.T)[:, None]
    field = TriangleStresses(ring, triangles, uniaxial(np.column_stack([-away[:, 1], away[:, 0]])))
    found = aligned_cells(field, 0.3)
    whole = shapely.union_all(shapely.polygons(ring[triangles]))
    assert shapely.union_all(found.cells).area == pytest.approx(whole.area, rel=5e-3)
    edges = inner_edges(found.cells, shapely.boundary(whole))
    along, place = edges[:, 1] - edges[:, 0], edges.mean(axis=1)
    cosine = np.abs(np.einsum("ed,ed->e", along, place)) / np.hypot(*along.T) / np.hypot(*place.T)
    assert np.minimum(np.arccos(np.minimum(cosine, 1.0)), np.arcsin(np.minimum(cosine, 1.0))).max() < np.radians(4.0)
    assert found.deviation < np.radians(1.5)
    assert 40 <= len(found.cells) <= 60


def test_without_a_direction_nothing_is_cut() -> None:
    """Hydrostatic stress has no direction."""
    points, triangles = mesh(4, 4)
    with pytest.raises(InputError, match="no direction"):
        aligned_cells(TriangleStresses(points, triangles, np.tile([-1.0, -1.0, 0.0], (len(triangles), 1))), 0.5)


def test_own_cells_are_planar_and_of_no_kind() -> None:
    """Own cells replace a kind, and do not go with voussoirs."""
    scene = parse_scene(
        {
            "elements": [{"id": "w", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]]}],
            "materials": {"density": 1.0, "inner": {"tensile_strength": 1.0, "shear_strength": 1.0}},
            "loads": {"live": [{"body": [1, 0]}]},
            "labels": {"default": "inner"},
        }
        | {
            "elements": [
                {"id": "w", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]]},
                {"id": "s", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
            ]
        }
    )
    halves = [shapely.box(-1, -1, 0.5, 2), shapely.box(0.5, -1, 3, 2)]
    refined = build_assembly(refine(scene, (1.0,), cells=halves).scene)
    assert refined.elements.volume[refined.elements.free] == pytest.approx([0.5, 1.5])
    with pytest.raises(InputError, match="cells"):
        refine(scene, (1.0,), kind="voronoi", cells=halves)
    with pytest.raises(InputError, match="voussoirs"):
        refine(scene, voussoirs=3, cells=halves)


def shear_share(field: TriangleStresses, cells: list[shapely.Polygon]) -> float:
    """Sum of |V| over the sum of |N| of all inner edges of cells: resultants of the stresses, sampled along them."""
    triangles = shapely.polygons(field.points[field.triangles])
    tree, whole = shapely.STRtree(triangles), shapely.union_all(triangles)
    edges = inner_edges(cells, shapely.boundary(whole))
    shares = (np.arange(8) + 0.5) / 8
    points = edges[:, None, 0] + shares[:, None] * (edges[:, None, 1] - edges[:, None, 0])
    x, y, xy = field.stress[tree.nearest(shapely.points(points).ravel())].reshape(*points.shape[:2], 3).mean(axis=1).T
    along = edges[:, 1] - edges[:, 0]
    tangent = along / np.hypot(*along.T)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    force = np.column_stack([x * normal[:, 0] + xy * normal[:, 1], xy * normal[:, 0] + y * normal[:, 1]])
    force *= np.hypot(*along.T)[:, None]
    pressed, slid = (np.abs(np.einsum("ed,ed->e", force, one)).sum() for one in (normal, tangent))
    return float(slid / pressed)


def test_joints_are_normal_to_the_resultant_of_the_stresses(tmp_path: Path) -> None:
    """Second route: the stresses, integrated along joints, have less than half the shear of a grid, 0.15 of N.

    The thrust of a jack arch of 2 m under a load at its quarter is inclined. Fields can mesh its cells.
    """
    outline = tmp_path / "jack.csv"
    jack, seats = [(-1.0, 0.0), (1.0, 0.0), (1.2, 0.4), (-1.2, 0.4)], [(1.0, 0.0), (1.6, 0.0), (1.6, 0.4), (1.2, 0.4)]
    rows = [f"jack,{x},{y},stone" for x, y in jack]
    rows += [f"s{k},{side * x},{y},supports" for k, side in enumerate((-1.0, 1.0)) for x, y in seats]
    outline.write_text("id,x,y,layer\n" + "\n".join(rows) + "\n")
    options = DesignOptions(load="20 kN", places="0.25", thickness=0.3, friction=0.6)
    scene = read_outline(outline, options).scene
    field = stresses_of_body(build_assembly(with_loads(scene, options)))
    found = aligned_cells(field, 0.15)
    assert found.deviation < np.radians(3.0)
    grid = squares(np.array([-1.2, 0.0]), np.array([1.2, 0.4]), (0.15, 0.15))
    share = shear_share(field, found.cells)
    assert share < 0.15
    assert share < 0.5 * shear_share(field, grid)
    require_fields(build_assembly(with_loads(refine(scene, (0.15,), cells=found.cells, snap=0.25).scene, options)))
