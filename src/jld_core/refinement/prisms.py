"""Spatial elements that are prisms: vaults cut by their profile and by courses."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.geometry import Faces, facets_of
from jld_core.geometry.unions import region_of
from jld_core.geometry.vectors import across
from jld_core.refinement.arrangement import join_small, split_by_cells
from jld_core.refinement.voussoirs import voussoir_cells

_FLAT: Final = 1e-6  # distance from one of two planes, relative to the size, up to which a corner of a prism lies in it

_LEAST: Final = 0.05  # share of a cell's area below which a piece of the profile joins its neighbour


@dataclass(frozen=True)
class Prism:
    """Solid between two parallel plane caps of the same outline.

    origin: (3,) point of the lower cap. axes: (3, 3) two axes of the profile and the axis of the prism, as rows.
    profile: outline in the first two axes, from the origin. length: distance of the caps.
    """

    origin: Floats
    axes: Floats
    profile: shapely.Polygon
    length: float

    def part(self, outline: Floats, low: float, high: float) -> tuple[Floats, Faces]:
        """Return vertices and outward faces of a part of the prism.

        outline: (k, 2) outline of the part in the profile. low, high: distances of both ends of the part from the lower
        cap.
        """
        count = len(outline)
        flat = self.origin + outline @ self.axes[:2]
        vertices = np.concatenate([flat + low * self.axes[2], flat + high * self.axes[2]])
        sides = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
        return vertices, (tuple(range(count))[::-1], tuple(range(count, 2 * count)), *sides)


def prism_of(vertices: Floats, faces: Faces) -> Prism | None:
    """Return a solid as a prism without holes; None if it is none.

    vertices: (k, 3). faces: outward loops of vertex indices. Of several possible axes the prism has that whose profile
    has the most corners.
    """
    size = float(np.ptp(vertices, axis=0).max())
    best: Prism | None = None
    for axis in facets_of([vertices], [faces]).normal:
        height = vertices @ axis
        low, high = float(height.min()), float(height.max())
        if (np.minimum(height - low, high - height) > _FLAT * size).any():
            continue
        axes = np.stack([*across(axis), axis])
        origin = vertices[int(np.argmin(height))]
        whole, other = (
            shapely.union_all(
                [
                    shapely.Polygon((vertices[list(loop)] - origin) @ axes[:2].T)
                    for loop in faces
                    if (abs(height[list(loop)] - level) <= _FLAT * size).all()
                ]
            )
            for level in (low, high)
        )
        if whole.geom_type != "Polygon" or whole.interiors or other.hausdorff_distance(whole) > 2.0 * _FLAT * size:
            continue
        region = region_of(whole)
        profile = shapely.Polygon(region.shell, region.holes)
        if best is None or len(profile.exterior.coords) > len(best.profile.exterior.coords):
            best = Prism(origin, axes, profile, high - low)
    return best


def split_prism(
    name: str,
    vertices: Floats,
    faces: Faces,
    down: Floats,
    voussoirs: int,
    rings: int,
    courses: int,
    running: bool,
    skew: float | None = None,
) -> list[tuple[Floats, Faces]]:
    """Cut a prism into voussoirs, rings and courses along its axis.

    name: of the element, for messages. vertices: (k, 3). faces: outward loops of vertex indices. down: (3,) direction
    of weight. voussoirs, rings, skew: as in `voussoir_cells`. courses: number of equal lengths. running: True shifts
    every second voussoir by half a course. Returns vertices and faces of each piece. Raises InputError if the solid is
    no prism, its axis is upright, or its profile has neither an arc nor a soffit.
    """
    prism = prism_of(vertices, faces)
    if prism is None:
        raise InputError(
            f"element {name!r}", "it is no prism between two plane caps", "a barrel vault or a straight arch"
        )
    fall = prism.axes[:2] @ down
    if np.hypot(*fall) < 1e-6:
        raise InputError(f"element {name!r}", "the axis of the prism is upright", "a vault or arch whose axis lies")
    found = voussoir_cells(prism.profile, fall / np.hypot(*fall), voussoirs, rings, None, skew)
    outline = shapely.get_coordinates(prism.profile.exterior)[:-1]
    size = min(found.width, found.depth)
    parts = split_by_cells([name], [outline], [], found.cells, size)[0]
    parts = join_small(parts, min(_LEAST * found.width * found.depth, 0.2 * prism.profile.area))
    tree = shapely.STRtree(found.cells)
    pieces = []
    for part in parts:
        number = int(min(tree.query(part.representative_point(), predicate="intersects"), default=0))
        shifted = running and courses > 1 and (number + number // voussoirs) % 2 == 1
        step = prism.length / courses
        joints = step * np.arange(1, courses) if not shifted else step * (np.arange(courses) + 0.5)
        shell = region_of(part).shell
        ends = [0.0, *joints.tolist(), prism.length]
        pieces += [prism.part(shell, low, high) for low, high in itertools.pairwise(ends)]
    return pieces
