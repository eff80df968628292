"""Families of cuts: planes of a grid, planes about an axis, planes across the largest compression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from jld_core import Floats
from jld_cut.cells import Cutting, Limits, concave_edges
from jld_cut.elastic import compressed
from jld_cut.meshes import surface_of
from jld_cut.whole import normals_of

_GRID: Final = 400  # boxes of a grid above which it is not cut


@dataclass(frozen=True)
class Body:
    """Uncut solid with what acts on it."""

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
    numbers = np.maximum(1, np.ceil(sides / body.limits.fit[np.argsort(np.argsort(sides))] - 1e-9)).astype(int)
    if numbers.prod() > _GRID:
        return None
    places = np.array([one[1] for one in concave_edges(body.solid) if one[0] > 0.3]).reshape(-1, 3)
    best = None
    while True:
        cutting = Cutting(body.solid)
        for axis in range(3):
            step = sides[axis] / numbers[axis]
            for k in range(1, numbers[axis]):
                at = body.box[axis] + k * step
                near = np.unique(np.round(places[:, axis], 12))
                near = near[np.abs(near - at) < 0.25 * step]
                cutting.through(np.eye(3)[axis], float(near[np.argmin(abs(near - at))]) if len(near) else at)
        if best is None or len(cutting.cells) <= 1.5 * body.limits.aim:
            best = cutting
        if len(cutting.cells) >= body.limits.aim:
            return best
        numbers[np.argmax(sides / numbers)] += 1


def radial(body: Body) -> Cutting | None:
    """Cut by planes through an axis that the solid has, and across it; None for a solid without one."""
    found = axis_of(body.solid)
    if found is None:
        return None
    centre, axis = found
    points = surface_of(body.solid)[0] - centre
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angle = np.sort(np.arctan2(points @ second, points @ first))
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    whole = gaps[widest] < 0.5
    start, span = (0.0, 2 * np.pi) if whole else (angle[(widest + 1) % len(angle)], 2 * np.pi - gaps[widest])
    along = points @ axis
    radius = float(np.linalg.norm(points - np.outer(along, axis), axis=1).max())
    levels = max(1, int(np.ceil(np.ptp(along) / body.limits.extent - 1e-9)), 4 if whole else 1)
    sectors = max(
        int(np.ceil(span * radius / body.limits.extent)), 8 if whole else max(4, 5 * body.limits.aim // 8) // levels
    )
    sectors += sectors % 2 if whole else 0
    cutting = Cutting(body.solid)
    for k in range(1, levels):
        at = along.min() + np.ptp(along) * k / levels
        cutting.through(axis, float(axis @ centre + at))
    for k in range(sectors // 2 if whole else sectors):
        turn = start + span * (k + 0.5 * whole) / sectors if whole else start + span * k / sectors
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
    facets, first, place = np.unique(
        np.round(np.column_stack([normal, offset]), 3), axis=0, return_index=True, return_inverse=True
    )
    whole = np.bincount(place.reshape(-1), area)
    middle = np.array([np.bincount(place.reshape(-1), area * side) for side in middle.T]).T / whole[:, None]
    normal, area = normal[first], np.asarray(whole, dtype=float)
    curved = area < 0.08 * area.sum()
    if len(facets) < 12 or area[curved].sum() < 0.15 * area.sum():
        return None
    normal, area, middle = normal[curved], area[curved], middle[curved]
    best, pairs = None, np.random.default_rng(0)
    candidates = [*np.eye(3)[::-1], np.linalg.eigh((normal * area[:, None]).T @ normal)[1][:, 0]]
    for axis in candidates:
        flat = normal - np.outer(normal @ axis, axis)
        length = np.linalg.norm(flat, axis=1)
        good = length > 0.05
        if area[good].sum() < 0.3 * area.sum():
            continue
        across, at, weight = np.cross(axis, flat[good] / length[good, None]), middle[good], area[good]
        # the point that most of the surface turns about is one where two of its normals meet
        for first, second in pairs.integers(len(at), size=(200, 2)).tolist():
            two = [first, second]
            if abs(across[first] @ across[second]) > 0.99:
                continue
            centre, _ = _nearest(axis, across[two], at[two], weight[two])
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
    chosen = [int(strong[np.argmax(size[strong])])]
    away = np.linalg.norm(middles[strong] - middles[chosen[0]], axis=1)
    cutting = Cutting(body.solid)
    reach = float((body.box[3:] - body.box[:3]).max())
    for _ in range(max(1, body.limits.aim - 4)):
        at = chosen[-1]
        cutting.locally(middles[at] + 1e-6 * reach * direction[at], direction[at])
        chosen.append(int(strong[np.argmax(away)]))
        away = np.minimum(away, np.linalg.norm(middles[strong] - middles[chosen[-1]], axis=1))
    return cutting if len(cutting.cells) > 1 else None


FAMILIES: Final[dict[str, Callable[[Body], Cutting | None]]] = {"grid": grid, "radial": radial, "stress": stress}
"""Ways to cut, by name."""
