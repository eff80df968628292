"""Stress of the uncut solid by finite elements of equal cubes."""

from __future__ import annotations

from itertools import product
from typing import Any, Final

import numpy as np
import shapely
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import cg
from scipy.spatial import cKDTree

from jld_core import Floats, Ints, checkpoint

VOXELS: Final = 3000
_POISSON: Final = 0.2
_CORNERS: Final = np.array(list(product((0, 1), repeat=3)), dtype=np.int64)


def voxels_of(solid: Any, count: int = VOXELS) -> tuple[Ints, float, Floats]:
    """Return places (k, 3) of about `count` cubes that fill a solid, their side, and the corner of the first."""
    box = np.array(solid.bounding_box())
    side = float((solid.volume() / count) ** (1 / 3))
    numbers = np.maximum(1, np.ceil((box[3:] - box[:3]) / side)).astype(int)
    origin = (box[:3] + box[3:]) / 2 - side * numbers / 2
    x, y = np.meshgrid(*(origin[k] + side * (np.arange(numbers[k]) + 0.5) for k in (0, 1)), indexing="ij")
    found = []
    for level in range(numbers[2]):
        rings = [shapely.Polygon(ring) for ring in solid.slice(origin[2] + side * (level + 0.5)).to_polygons()]
        inside = np.zeros(x.shape, dtype=int)
        for ring in rings:
            inside += shapely.contains_xy(ring, x, y) * (1 if ring.exterior.is_ccw else -1)
        i, j = np.nonzero(inside > 0)
        found.append(np.column_stack([i, j, np.full(len(i), level)]))
    return np.concatenate(found), side, origin


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
    solid: Any, held: Floats, forces: list[tuple[Floats, Floats]], weight: Floats, count: int = VOXELS
) -> tuple[Floats, Floats, Floats]:
    """Return where the solid is compressed most.

    held: (h, 3) points at supports. forces: (3,) vectors with places. weight: (3,) of the whole solid.
    Returns middles (k, 3), magnitudes (k,) and directions (k, 3) of the largest compression.
    """
    places, side, origin = voxels_of(solid, count)
    grid = places[:, None] + _CORNERS
    flat = (grid * np.array([1, 10**4, 10**8])).sum(axis=2)
    names, node = np.unique(flat, return_inverse=True)
    node = node.reshape(flat.shape)
    middles = origin + side * (places + 0.5)
    stiffness, stress_of = _stiffness(side)
    row = (3 * node[:, :, None] + np.arange(3)).reshape(len(places), 24)
    i, j = np.repeat(row, 24, axis=1).ravel(), np.tile(row, (1, 24)).ravel()
    size = 3 * len(names)
    matrix = coo_array((np.tile(stiffness.ravel(), len(places)), (i, j)), shape=(size, size)).tocsr()
    load = np.bincount(row.ravel(), np.tile(weight / (8 * len(places)), 8 * len(places)), minlength=size)
    tree = cKDTree(middles)
    for force, at in forces:
        load[row[int(tree.query(at)[1])]] += np.tile(force / 8, 8)
    fixed = np.unique(row[np.unique(tree.query(held)[1])])
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
