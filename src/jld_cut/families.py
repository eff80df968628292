"""Families of cuts: planes of a grid, about an axis, and across the largest compression of the uncut solid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Final

import numpy as np
import shapely
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import cg
from scipy.spatial import cKDTree

from jld_core import Floats, Ints, checkpoint
from jld_cut.cells import Cutting, Limits, concave_edges
from jld_cut.meshes import normals_of, surface_of

VOXELS: Final = 3000
_POISSON: Final = 0.2
_CORNERS: Final = np.array(list(product((0, 1), repeat=3)), dtype=np.int64)


def voxels_of(solid: Any, count: int = VOXELS) -> tuple[Ints, float, Floats]:
    """Return grid indices (k, 3) of about `count` cubes that fill a solid, their side, and the corner of the first."""
    box = np.array(solid.bounding_box())
    side = float((solid.volume() / count) ** (1 / 3))
    numbers = np.maximum(1, np.ceil((box[3:] - box[:3]) / side)).astype(int)
    origin = (box[:3] + box[3:]) / 2 - side * numbers / 2
    x, y = np.meshgrid(*(origin[k] + side * (np.arange(numbers[k]) + 0.5) for k in (0, 1)), indexing="ij")
    cubes = []
    for level in range(numbers[2]):
        rings = [shapely.Polygon(ring) for ring in solid.slice(origin[2] + side * (level + 0.5)).to_polygons()]
        inside = np.zeros(x.shape, dtype=int)
        for ring in rings:
            inside += shapely.contains_xy(ring, x, y) * (1 if ring.exterior.is_ccw else -1)
        i, j = np.nonzero(inside > 0)
        cubes.append(np.column_stack([i, j, np.full(len(i), level)]))
    return np.concatenate(cubes), side, origin


def _stiffness(side: float) -> tuple[Floats, Floats]:
    """Return stiffness (24, 24), and stress per displacement (6, 24) at the middle, of a cube of modulus 1."""
    lame, shear = _POISSON / ((1 + _POISSON) * (1 - 2 * _POISSON)), 1 / (2 * (1 + _POISSON))
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lame

    def strain(at: Floats) -> Floats:
        sign = 2.0 * _CORNERS - 1.0
        slope = np.array(
            [sign[:, k] * np.prod([1 + at[j] * sign[:, j] for j in range(3) if j != k], axis=0) for k in range(3)]
        ) / (4.0 * side)
        rows = np.zeros((6, 8, 3))
        for k in range(3):
            rows[k, :, k] = slope[k]
        for k, (i, j) in enumerate(((1, 2), (0, 2), (0, 1)), 3):
            rows[k, :, i], rows[k, :, j] = slope[j], slope[i]
        return rows.reshape(6, 24)

    points = np.array(list(product((-(3**-0.5), 3**-0.5), repeat=3)))
    stiffness = sum(strain(at).T @ law @ strain(at) for at in points) * side**3 / 8
    return np.asarray(stiffness), law @ strain(np.zeros(3))


def compressed(
    solid: Any, supports: Floats, forces: list[tuple[Floats, Floats]], weight: Floats, count: int = VOXELS
) -> tuple[Floats, Floats, Floats]:
    """Return where the solid is compressed most."""
    # supports: (h, 3) points that are held. forces: (3,) vectors with places. weight: (3,) of the whole solid. Returns
    # middles (k, 3), magnitudes (k,) and directions (k, 3) of the largest compression.
    cubes, side, origin = voxels_of(solid, count)
    grid = cubes[:, None] + _CORNERS
    flat = (grid * np.array([1, 10**4, 10**8])).sum(axis=2)
    names, node = np.unique(flat, return_inverse=True)
    node = node.reshape(flat.shape)
    middles = origin + side * (cubes + 0.5)
    stiffness, stress_of = _stiffness(side)
    row = (3 * node[:, :, None] + np.arange(3)).reshape(len(cubes), 24)
    i, j = np.repeat(row, 24, axis=1).ravel(), np.tile(row, (1, 24)).ravel()
    size = 3 * len(names)
    matrix = coo_array((np.tile(stiffness.ravel(), len(cubes)), (i, j)), shape=(size, size)).tocsr()
    load = np.bincount(row.ravel(), np.tile(weight / (8 * len(cubes)), 8 * len(cubes)), minlength=size)
    tree = cKDTree(middles)
    for force, at in forces:
        load[row[int(tree.query(at)[1])]] += np.tile(force / 8, 8)
    fixed = np.unique(row[np.unique(tree.query(supports)[1])])
    free = np.setdiff1d(np.arange(size), fixed)
    # cubes that hang on nothing are held by a little
    part = matrix[free][:, free]
    part = part + diags_array(1e-7 * part.diagonal())
    moved = np.zeros(size)
    scale = diags_array(1.0 / part.diagonal())
    moved[free] = cg(part, load[free], rtol=1e-4, maxiter=1500, M=scale, callback=lambda _: checkpoint())[0]
    xx, yy, zz, yz, xz, xy = (moved[row] @ stress_of.T).T
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    values, vectors = np.linalg.eigh(tensor)
    return middles, -values[:, 0], vectors[:, :, 0]


_GRID: Final = 400  # boxes of a grid above which it is not cut


@dataclass(frozen=True)
class Body:
    solid: Any
    held: Floats  # (h, 3) points at supports
    forces: list[tuple[Floats, Floats]]
    weight: Floats
    limits: Limits
    box: Floats = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "box", np.array(self.solid.bounding_box()))


def grid(body: Body) -> Cutting | None:
    """Cut by planes across the axes, at concave edges where these are near."""
    sides = body.box[3:] - body.box[:3]
    fit = body.limits.fit[np.argsort(np.argsort(sides))]
    fewest = np.maximum(1, np.ceil(sides / fit - 1e-9)).astype(int)
    numbers = fewest.copy()
    if numbers.prod() > _GRID:
        return None
    edges = np.array([edge[1] for edge in concave_edges(body.solid) if edge[0] > 0.3]).reshape(-1, 3)
    best = None
    while True:
        cutting = Cutting(body.solid)
        for axis in range(3):
            step = sides[axis] / numbers[axis]
            for k in range(1, numbers[axis]):
                at = body.box[axis] + k * step
                near = np.unique(np.round(edges[:, axis], 12))
                near = near[np.abs(near - at) < 0.25 * step]
                cutting.through(np.eye(3)[axis], float(near[np.argmin(abs(near - at))]) if len(near) else at)
        if best is None or len(cutting.cells) <= 1.5 * body.limits.aim:
            best = cutting
        if len(cutting.cells) >= body.limits.aim:
            return best
        axis = int(np.argmax(sides / numbers))
        numbers[axis] += 1
        # cells that only more parts than needed could be made of are none for a box
        while fewest[axis] * int(fit[axis] * numbers[axis] / sides[axis] + 1e-9) < numbers[axis]:
            numbers[axis] += 1


def radial(body: Body) -> Cutting | None:
    """Cut by planes through an axis that the solid has, and across it; None for a solid without one."""
    axis_found = axis_of(body.solid)
    if axis_found is None:
        return None
    centre, axis = axis_found
    points = surface_of(body.solid)[0] - centre
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angle = np.sort(np.arctan2(points @ second, points @ first))
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    closed_ring = gaps[widest] < 0.5
    start, span = (0.0, 2 * np.pi) if closed_ring else (angle[(widest + 1) % len(angle)], 2 * np.pi - gaps[widest])
    along = points @ axis
    radius = float(np.linalg.norm(points - np.outer(along, axis), axis=1).max())
    levels = max(1, int(np.ceil(np.ptp(along) / body.limits.extent - 1e-9)), 4 if closed_ring else 1)
    sectors = max(
        int(np.ceil(span * radius / body.limits.extent)),
        8 if closed_ring else max(4, 5 * body.limits.aim // 8) // levels,
    )
    sectors += sectors % 2 if closed_ring else 0
    cutting = Cutting(body.solid)
    for k in range(1, levels):
        at = along.min() + np.ptp(along) * k / levels
        cutting.through(axis, float(axis @ centre + at))
    for k in range(sectors // 2 if closed_ring else sectors):
        turn = start + span * (k + 0.5 * closed_ring) / sectors if closed_ring else start + span * k / sectors
        normal = -np.sin(turn) * first + np.cos(turn) * second
        cutting.through(normal, float(normal @ centre))
    return cutting if len(cutting.cells) > 1 else None


def axis_of(solid: Any) -> tuple[Floats, Floats] | None:
    """Return centre and direction of the axis of most of the curved surface; None for plane faces or spheres."""
    points, triangles = surface_of(solid)
    corners = points[triangles]
    normal, area = normals_of(corners)
    keep = area > 1e-12 * area.max()
    corners, area = corners[keep], area[keep]
    normal = normal[keep] / area[:, None]
    middle, size = corners.mean(axis=1), float(np.ptp(points, axis=0).max())
    offset = np.einsum("ij,ij->i", normal, middle) / size
    facets, first, facet_of = np.unique(
        np.round(np.column_stack([normal, offset]), 3), axis=0, return_index=True, return_inverse=True
    )
    area_of_facet = np.bincount(facet_of.reshape(-1), area)
    middle = np.array([np.bincount(facet_of.reshape(-1), area * side) for side in middle.T]).T / area_of_facet[:, None]
    normal, area = normal[first], np.asarray(area_of_facet, dtype=float)
    curved = area < 0.08 * area.sum()
    if len(facets) < 12 or area[curved].sum() < 0.15 * area.sum():
        return None
    normal, area, middle = normal[curved], area[curved], middle[curved]
    best, pairs = None, np.random.default_rng(0)
    candidates = [*np.eye(3)[::-1], np.linalg.eigh((normal * area[:, None]).T @ normal)[1][:, 0]]
    for axis in candidates:
        flat = normal - np.outer(normal @ axis, axis)
        length = np.linalg.norm(flat, axis=1)
        slanted = length > 0.05
        if area[slanted].sum() < 0.3 * area.sum():
            continue
        across, at, weight = np.cross(axis, flat[slanted] / length[slanted, None]), middle[slanted], area[slanted]
        # the point that most of the surface turns about is one where two of its normals meet
        for first, second in pairs.integers(len(at), size=(200, 2)).tolist():
            pair = [first, second]
            if abs(across[first] @ across[second]) > 0.99:
                continue
            centre, _ = _nearest(axis, across[pair], at[pair], weight[pair])
            close = np.abs(np.einsum("ij,ij->i", across, at - centre)) < 0.005 * size
            share = float(weight[close].sum() / area.sum())
            turns = len(np.unique(np.round(across[close], 2), axis=0))
            if turns > 5 and (best is None or share > 1.15 * best[0]):
                best = share, _nearest(axis, across[close], at[close], weight[close])[0], axis
    return None if best is None or best[0] < 0.25 else (best[1], best[2])


def _nearest(axis: Floats, across: Floats, at: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Return the point nearest to lines seen along an axis, and their distances; across: (k, 3) their normals."""
    matrix = (across * weight[:, None]).T @ across + np.outer(axis, axis) * weight.sum()
    right = (across * (weight * np.einsum("ij,ij->i", across, at))[:, None]).sum(axis=0)
    centre = np.linalg.solve(matrix + 1e-12 * np.eye(3) * weight.sum(), right)
    return centre, np.abs(np.einsum("ij,ij->i", across, at - centre))


def stress(body: Body) -> Cutting | None:
    """Cut locally across the largest compression of the uncut solid, at points far from each other."""
    middles, size, direction = compressed(body.solid, body.held, body.forces, body.weight)
    strong = np.flatnonzero(size >= np.quantile(size, 0.3))
    points = [int(strong[np.argmax(size[strong])])]
    distance = np.linalg.norm(middles[strong] - middles[points[0]], axis=1)
    cutting = Cutting(body.solid)
    reach = float((body.box[3:] - body.box[:3]).max())
    for _ in range(max(1, body.limits.aim - 4)):
        point = points[-1]
        cutting.locally(middles[point] + 1e-6 * reach * direction[point], direction[point])
        points.append(int(strong[np.argmax(distance)]))
        distance = np.minimum(distance, np.linalg.norm(middles[strong] - middles[points[-1]], axis=1))
    return cutting if len(cutting.cells) > 1 else None


FAMILIES: Final[dict[str, Callable[[Body], Cutting | None]]] = {"grid": grid, "radial": radial, "stress": stress}
"""Ways to cut, by name."""
