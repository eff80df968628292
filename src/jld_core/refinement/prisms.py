"""Spatial elements that are prisms: vaults cut by their profile and by courses, walls in bonds with bonded corners."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.errors import InputError, ParameterError
from jld_core.geometry import Faces, facets_of
from jld_core.geometry.unions import region_of
from jld_core.geometry.vectors import across
from jld_core.refinement.arrangement import join_small, split_by_cells
from jld_core.refinement.tessellation import MOST
from jld_core.refinement.voussoirs import voussoir_cells
from jld_core.samples.corner_bonds import corner_course

_FLAT: Final = 1e-6
"""Distance from one of two planes, relative to the size, up to which a corner of a prism lies in it."""

_LEAST: Final = 0.05
"""Share of a cell's area below which a piece of the profile joins its neighbour."""


@dataclass(frozen=True)
class Prism:
    """Solid between two parallel plane caps of the same outline.

    Attributes
    ----------
    origin : (3,) array
        Point of the lower cap.
    axes : (3, 3) array
        Two axes of the profile and the axis of the prism, as rows.
    profile : shapely.Polygon
        Outline in the first two axes, from the origin.
    length : float
        Distance of the caps.
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


def prism_of(vertices: Floats, faces: Faces, along: Floats | None = None) -> Prism | None:
    """Return a solid as a prism; None if it is no prism.

    vertices: (k, 3). faces: outward loops of vertex indices. along: (3,) unit axis that the prism must have, whose
    profile may have holes. None: of several possible axes, that whose profile has the most corners, without holes.
    """
    size = float(np.ptp(vertices, axis=0).max())
    best: Prism | None = None
    for axis in facets_of([vertices], [faces]).normal if along is None else along[None]:
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
        if whole.geom_type != "Polygon" or other.hausdorff_distance(whole) > 2.0 * _FLAT * size:
            continue
        if along is None and whole.interiors:
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


def split_walls(
    name: str, vertices: Floats, faces: Faces, down: Floats, bottom: float, cell: tuple[float, float], bond: str
) -> list[tuple[Floats, Faces]]:
    """Cut an upright prism, such as the walls of a room, into courses of a masonry bond with bonded corners.

    name: of the element, for messages. vertices: (k, 3). faces: outward loops of vertex indices. down: (3,) direction
    of weight. bottom: height at which the first course begins, against `down`. cell: length of a stretcher and height
    of a course. bond: one of `BONDS`. Returns vertices and faces of each stone, course by course from below. A course
    lower than a twentieth of its height joins the one beside it. Raises InputError if the solid is no upright prism or
    its walls do not meet at right angles, and ParameterError for more than `MOST` stones.
    """
    prism = prism_of(vertices, faces, -down)
    if prism is None:
        raise InputError(f"element {name!r}", "it is no upright prism", "walls of one height, without openings")
    edges = np.diff(shapely.get_coordinates(prism.profile.exterior), axis=0)
    lengths = np.hypot(*edges.T)
    expected = prism.length / cell[1] * (lengths.sum() / cell[0] + 1.0)
    if expected > MOST:
        raise ParameterError("cell", f"that makes {expected:.3g} cells", f"at most {MOST}")
    # first axis along the longest edge, anticlockwise; of equally long ones that nearest to a level world axis
    longest = edges[lengths >= (1.0 - _FLAT) * lengths.max()] @ prism.axes[:2] / lengths.max()
    if not prism.profile.exterior.is_ccw:
        longest = -longest
    first = longest[longest[:, abs(down).argmin()].argmax()]
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(prism.axes[2], first), prism.axes[2]])
    turned = shapely.transform(prism.profile, lambda points: points @ prism.axes[:2] @ axes[:2].T)
    walls = Prism(prism.origin, axes, turned, prism.length)
    base = float(prism.origin @ axes[2]) - bottom
    joints = cell[1] * np.arange(np.floor(base / cell[1]), np.ceil((base + prism.length) / cell[1]) + 1.0) - base
    joints = joints[(joints > _LEAST * cell[1]) & (joints < prism.length - _LEAST * cell[1])]
    pieces = []
    for low, high in itertools.pairwise([0.0, *joints.tolist(), prism.length]):
        number = int(np.floor((base + 0.5 * (low + high)) / cell[1]))
        for x0, y0, x1, y1 in corner_course(turned, number, bond, cell[0], name):
            pieces.append(walls.part(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), low, high))
    return pieces
