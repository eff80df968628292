"""Geometric factor of safety (Heyman): thickness over the least thickness at which a structure stands."""

from __future__ import annotations

import itertools
import math
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, Floats, InputError, LimitAnalysis, Scene, build_assembly, parse_scene
from jld_core.mechanics import require_materials

_TOLERANCE: Final = 1e-6  # relative width of the bracket to aim at
_NEAR: Final = 1e-6  # distance, relative to the size of a structure, up to which points are one
_FIRST: Final = ((1.0, 2.0, 4.0, 8.0), tuple(0.5**k for k in range(11)))  # scales tried where it falls, and stands


@dataclass(frozen=True)
class GeometricSafety:
    """Thickness of a structure over its least one, as a bracket; NaN for an end that is not proven."""

    factor: tuple[float, float]
    # least scale of the thickness: it falls at the first, and stands at the second
    scale: tuple[float, float]
    thickness: tuple[float, float]  # least and largest thickness at joints, scene units

    def to_json(self) -> dict[str, Any]:
        ends = [None if math.isnan(one) else one for one in self.factor]
        least = [None if math.isnan(one) else one for one in self.scale]
        return {"factor": ends, "least_scale": least, "thickness": list(self.thickness)}

    def __str__(self) -> str:
        low, high = self.factor
        if math.isnan(high):
            return f"above {low:.6g}" if low == low else "unknown"
        return f"below {high:.6g}" if math.isnan(low) else f"{0.5 * (low + high):.6g} in [{low:.9g}, {high:.9g}]"


def geometric_safety(scene: Scene, labels: Bits) -> GeometricSafety:
    """Compute the geometric factor of safety of one labelling under its dead loads.

    The structure is scaled across its middle line or surface; volumes and weights from a density follow. Raises
    InputError where blocks have no such line or surface.
    """
    assembly = build_assembly(scene)
    middles = _middles(scene, assembly)
    document = scene.model_dump(mode="json", exclude_unset=True)

    def stands(scale: float) -> bool | None:
        scaled = deepcopy(document)
        for entry, (points, middle) in zip(scaled["elements"], middles, strict=True):
            if entry.get("support") and scale < 1.0:
                continue  # thinner blocks rest on supports as they are
            key = "polygon" if "polygon" in entry else "vertices"
            entry[key] = (middle + scale * (points - middle)).tolist()
            if "volume" in entry:
                entry["volume"] *= scale
        try:
            other = build_assembly(parse_scene(scaled))
        except InputError:
            if scale == 1.0:
                raise
            return None  # what is too thick overlaps, what is too thin has no joints left
        pairs = [(one.interfaces.a.tolist(), one.interfaces.b.tolist()) for one in (other, assembly)]
        if pairs[0] != pairs[1]:
            raise InputError("elements", "other faces touch where the thickness is scaled", "blocks with whole joints")
        require_materials(other, labels, ~labels)
        return LimitAnalysis(other, single_labelling=True).stands(labels)

    fall, stand = math.nan, math.nan
    first = stands(1.0)
    for scale in _FIRST[bool(first)]:
        found = first if scale == 1.0 else stands(scale)
        if found is None:
            break
        fall, stand = (fall, scale) if found else (scale, stand)
        if found != first:
            break
    while stand - fall > _TOLERANCE * stand:
        middle = 0.5 * (fall + stand)
        if (found := stands(middle)) is None:
            break
        fall, stand = (fall, middle) if found else (middle, stand)
    sizes = assembly.interfaces.l1 if assembly.dimension == 2 else _depths(middles)
    return GeometricSafety((1.0 / stand, 1.0 / fall), (fall, stand), (float(sizes.min()), float(sizes.max())))


def _depths(middles: list[tuple[Floats, Floats]]) -> Floats:
    """Return the distances (k,) of vertices from their opposites."""
    depths = np.concatenate([2.0 * np.linalg.norm(points - middle, axis=1) for points, middle in middles])
    return depths[depths > 0.0]


def _middles(scene: Scene, assembly: Assembly) -> list[tuple[Floats, Floats]]:
    """Return vertices and their points on the middle line or surface, by element."""
    if scene.elements is None or scene.interfaces is not None:
        raise InputError("elements", "grids and stated interfaces have no thickness to scale", "elements alone")
    found: list[tuple[Floats, Floats]] = []
    for k, entry in enumerate(scene.elements):
        points = np.array(entry.polygon if assembly.dimension == 2 else entry.vertices, dtype=float)
        if entry.support:
            found.append((points, points.copy()))
            continue
        own = np.flatnonzero((assembly.interfaces.a == k) | (assembly.interfaces.b == k)).tolist()
        joints = [assembly.interfaces.polygon[face] for face in own if face < assembly.faces]
        where = f"element {entry.id!r}"
        near = _NEAR * assembly.size
        if assembly.dimension == 2:
            found.append((points, _middle_line(points, joints, near, where)))
        else:
            faces = [list(one) for one in entry.faces or ()]
            found.append((points, _middle_surface(points, faces, joints, near, where)))
    free = [one for one, entry in zip(found, scene.elements, strict=True) if not entry.support]
    vertices, middles = (np.concatenate(part) for part in zip(*free, strict=True))
    for (points, middle), entry in zip(found, scene.elements, strict=True):
        if entry.support:  # where they meet a block they grow with it
            away = np.linalg.norm(points[:, None] - vertices, axis=2)
            meets = away.min(axis=1) <= _NEAR * assembly.size
            middle[meets] = middles[away.argmin(axis=1)][meets]
    return found


def _middle_line(points: Floats, joints: list[Floats], near: float, where: str) -> Floats:
    """Return the points (k, 2) of a block between two joints that are halfway to its other side."""
    count = len(points)
    edges = [
        i
        for joint in joints
        for i in range(count)
        if {0, 1} == {int(np.argmin(np.linalg.norm(joint - p, axis=1))) for p in (points[i], points[(i + 1) % count])}
        and all(np.linalg.norm(joint - p, axis=1).min() <= near for p in (points[i], points[(i + 1) % count]))
    ]
    if len(edges) == len(joints) == 1 and count == 4:
        edges.append((edges[0] + 2) % 4)  # a free end
    if len(edges) != 2 or len(joints) > 2:
        problem = f"it has {len(joints)} joints, {len(edges)} of which are whole sides of it: no middle line"
        raise InputError(where, problem, "blocks one after the other, each between two joints across the thickness")
    first, second = edges
    one = [(first + 1 + j) % count for j in range((second - first - 1) % count + 1)]
    two = [(first - j) % count for j in range((first - second - 1) % count + 1)]
    places = []
    for side in (one, two):
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[side], axis=0), axis=1))])
        places.append(length / (length[-1] or 1.0))
    middle = points.copy()
    for (side, own), (other, far) in itertools.permutations(zip((one, two), places, strict=True)):
        across = np.column_stack([np.interp(own, far, points[other][:, axis]) for axis in (0, 1)])
        middle[side] = 0.5 * (points[side] + across)
    return middle


def _middle_surface(points: Floats, faces: list[list[int]], joints: list[Floats], near: float, where: str) -> Floats:
    """Return the points (k, 3) halfway to the opposite free face; of several pairs of faces the nearest."""
    free = []
    for face in faces:
        corner, normal = points[face[0]], np.zeros(3)
        for one, two in itertools.pairwise(face[1:]):
            normal += np.cross(points[one] - corner, points[two] - corner)
        normal /= np.linalg.norm(normal)
        if not any(abs((joint - corner) @ normal).max() <= near for joint in joints):
            free.append(face)
    edges = {frozenset(pair) for face in faces for pair in zip(face, face[1:] + face[:1], strict=True)}
    best: tuple[float, Floats] | None = None
    for inside, outside in itertools.combinations(free, 2):
        if set(inside) & set(outside) or len(inside) + len(outside) != len(points):
            continue
        links = [[b for b in outside if frozenset((a, b)) in edges] for a in inside]
        if any(len(link) != 1 for link in links) or len({link[0] for link in links}) != len(outside):
            continue
        middle = points.copy()
        for a, (b,) in zip(inside, links, strict=True):
            middle[[a, b]] = 0.5 * (points[a] + points[b])
        size = float(np.linalg.norm(points - middle, axis=1).mean())
        if best is None or size < best[0]:
            best = size, middle
    if best is None:
        problem = "no two free faces lie opposite each other: no middle surface"
        raise InputError(where, problem, "prisms across the thickness")
    return best[1]
