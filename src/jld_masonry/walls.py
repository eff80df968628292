"""Walls drawn as solids: courses of a masonry bond with bonded corners, openings and lintels."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core import Floats, InputError, ParameterError
from jld_core.geometry import Faces, across, facets_of, outlines, polyhedra, solids, unions
from jld_core.refinement import arrangement
from jld_masonry.bonds import FACES, Lintel, bonded_walls, levels_of, snapped
from jld_masonry.voussoirs import voussoir_cells

# Sine of the angle up to which a face is level or upright, and relative distance of nearly equal heights
_FLAT: Final = 1e-6

# Share of a course below which the rest at the foot or the top of a wall joins the course beside it
_LEAST: Final = 0.05

_THIN: Final = 0.25  # least height of a course between the sills and heads of openings, in courses


def bed_joints(shapes: Sequence[Floats], faces: Sequence[Faces], down: Floats, height: float) -> Floats:
    """Return the heights of bed joints, ascending against `down`; ParameterError if too many or too close."""
    # Courses begin at the lowest point. Sills and heads of openings, and steps of a wall, are bed joints; the courses
    # below, between and above them are equally high.
    heights = [-(vertices @ down) for vertices in shapes]
    low, high = min(float(levels.min()) for levels in heights), max(float(levels.max()) for levels in heights)
    if (high - low) / height > arrangement.MOST:
        raise ParameterError(
            "cell", f"that makes {(high - low) / height:.3g} courses", f"at most {arrangement.MOST} cells"
        )
    near = _FLAT * (high - low)
    facets = facets_of(list(shapes), list(faces))
    inner = [
        float(-origin @ down)
        for owner, origin, normal in zip(facets.element, facets.origin, facets.normal, strict=True)
        if abs(normal @ down) > 1.0 - _FLAT
        and heights[owner].min() + near < -origin @ down < heights[owner].max() - near
    ]
    if not inner:
        return np.asarray(low + height * np.arange(np.ceil((high - low) / height - 1e-9) + 1.0))
    beds = [low]
    for a, b in itertools.pairwise([low, *levels_of(np.array(inner), high - low).tolist(), high]):
        if b - a < _THIN * height * (1.0 - 1e-9):
            raise ParameterError(
                "cell",
                f"sills, heads or tops of walls are {b - a:.3g} apart, and a course is {height:g}",
                "openings whose sills and heads are equally high, or lower courses",
            )
        beds += np.linspace(a, b, max(1, round((b - a) / height)) + 1)[1:].tolist()
    return np.array(beds)


def split_walls(
    name: str, vertices: Floats, faces: Faces, down: Floats, beds: Floats, stretcher: float, bond: str, lintel: Lintel
) -> list[tuple[Floats, Faces]]:
    """Cut walls with upright and level faces into a bond with bonded corners; InputError for others."""
    # Windows and doors are rectangles through the wall; a lintel spans each.
    axes = _axes_of(name, vertices, faces, down)
    local = vertices @ axes.T
    origin = local.min(axis=0)
    extent = float(np.ptp(local, axis=0).max())
    local = np.column_stack([snapped(axis, levels_of(axis, extent)) for axis in (local - origin).T])
    beds = beds - origin[2]
    top = float(local[:, 2].max())
    slack = _LEAST * float(np.diff(beds).min())
    ends = np.array([0.0, *beds[(beds > slack) & (beds < top - slack)].tolist(), top])
    first = int(np.searchsorted(beds, 0.5 * ends[1])) - 1
    facets = facets_of([local], [faces])
    sections = _sections(name, facets, 0.5 * (ends[1:] + ends[:-1]))
    edges = sum(section.length for section in sections)
    if edges / stretcher > arrangement.MOST:
        raise ParameterError("cell", f"that makes {edges / stretcher:.3g} cells", f"at most {arrangement.MOST}")
    stones = bonded_walls(sections, ends.tolist(), bond, stretcher, first=first, lintel=lintel, name=name)
    return [((origin + stone) @ axes, FACES) for course in stones for stone in course]


def _axes_of(name: str, vertices: Floats, faces: Faces, down: Floats) -> Floats:
    """Return two level axes along walls, and the upright one (3, 3); InputError for an inclined face."""
    # The first lies along the longest edge of an upper face, anticlockwise. Of equally long ones that counts along
    # which the centroid is farthest beyond the middle, then that nearest to a level world axis, so that a solid is cut
    # alike wherever it stands.
    facets = facets_of([vertices], [faces])
    level = facets.normal @ down
    if not ((abs(level) < _FLAT) | (abs(level) > 1.0 - _FLAT)).all():
        raise InputError(
            f"element {name!r}", "it is no upright prism", "walls and rectangular openings with level and upright faces"
        )
    size = float(np.ptp(vertices, axis=0).max())
    loops = [
        outlines.corners(loops[0], _FLAT * size)
        for loops, height in zip(facets.loops, level, strict=True)
        if height < -0.5
    ]
    edges = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in loops])
    lengths = np.linalg.norm(edges, axis=1)
    longest = edges[lengths >= (1.0 - _FLAT) * lengths.max()]
    longest -= np.outer(longest @ down, down)
    longest /= np.linalg.norm(longest, axis=1)[:, None]
    centroid = solids([name], [vertices], [faces])[3][0]
    along = vertices @ longest.T
    beyond = (longest @ centroid - 0.5 * (along.min(axis=0) + along.max(axis=0))) / size
    world = longest[:, np.argsort(abs(down), kind="stable")[:2]]
    order = np.lexsort(np.column_stack([beyond, world]).round(6).T[::-1])
    first = longest[order[-1]]
    return np.stack([first, np.cross(-down, first), -down])


def _sections(name: str, facets: polyhedra.Facets, heights: Floats) -> list[shapely.Geometry]:
    """Return the plan of a solid at each of some heights, ascending; InputError if empty there."""
    level = np.flatnonzero(abs(facets.normal[:, 2]) > 0.5)
    order = level[np.argsort(facets.origin[level, 2], kind="stable")]
    section: shapely.Geometry = shapely.Polygon()
    geometries, begun = [], 0
    for height in heights:
        while begun < len(order) and facets.origin[order[begun], 2] < height:
            k = order[begun]
            shell, *holes = (loop[:, :2] for loop in facets.loops[k])
            area = shapely.Polygon(shell, holes)
            section = (shapely.union if facets.normal[k, 2] < 0.0 else shapely.difference)(section, area)
            begun += 1
        if section.is_empty:
            raise InputError(f"element {name!r}", "its parts stand apart", "walls in one piece")
        geometries.append(section)
    return geometries


@dataclass(frozen=True)
class Prism:
    """Solid between two parallel plane caps of the same outline."""

    origin: Floats  # (3,) point of the lower cap
    axes: Floats  # (3, 3) two axes of the profile and the axis of the prism, as rows
    profile: shapely.Polygon  # outline in the first two axes, from the origin
    length: float  # distance of the caps

    def part(self, outline: Floats, low: float, high: float) -> tuple[Floats, Faces]:
        """Return vertices and outward faces of the part with an outline (k, 2) in the profile."""
        count = len(outline)
        flat = self.origin + outline @ self.axes[:2]
        vertices = np.concatenate([flat + low * self.axes[2], flat + high * self.axes[2]])
        sides = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
        return vertices, (tuple(range(count))[::-1], tuple(range(count, 2 * count)), *sides)


def prism_of(vertices: Floats, faces: Faces) -> Prism | None:
    """Return a solid as a prism without holes.

    Parameters
    ----------
    vertices : (k, 3) array
        Vertices.
    faces : Faces
        Faces, as loops of vertex indices.

    Returns
    -------
    Prism or None
        None if it is no prism.
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
        lower, upper = (
            shapely.union_all(
                [
                    shapely.Polygon((vertices[list(loop)] - origin) @ axes[:2].T)
                    for loop in faces
                    if (abs(height[list(loop)] - level) <= _FLAT * size).all()
                ]
            )
            for level in (low, high)
        )
        if lower.geom_type != "Polygon" or lower.interiors or upper.hausdorff_distance(lower) > 2.0 * _FLAT * size:
            continue
        region = unions.region_of(lower)
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
    """Cut a prism into voussoirs, rings and courses along its axis; running: shifts every second by half.

    InputError: no prism, an upright axis, or a profile with neither arc nor soffit.
    """
    prism = prism_of(vertices, faces)
    if prism is None:
        raise InputError(
            f"element {name!r}", "it is no prism between two plane caps", "a barrel vault or a straight arch"
        )
    fall = prism.axes[:2] @ down
    if np.hypot(*fall) < 1e-6:
        raise InputError(f"element {name!r}", "the axis of the prism is upright", "a vault or arch whose axis lies")
    arch = voussoir_cells(prism.profile, fall / np.hypot(*fall), voussoirs, rings, None, skew)
    outline = shapely.get_coordinates(prism.profile.exterior)[:-1]
    size = min(arch.width, arch.depth)
    parts = arrangement.split_by_cells([name], [outline], [], arch.cells, size)[0]
    parts = arrangement.join_small(parts, min(_LEAST * arch.width * arch.depth, 0.2 * prism.profile.area))
    tree = shapely.STRtree(arch.cells)
    pieces = []
    for part in parts:
        number = int(min(tree.query(part.representative_point(), predicate="intersects"), default=0))
        shifted = running and courses > 1 and (number + number // voussoirs) % 2 == 1
        step = prism.length / courses
        joints = step * np.arange(1, courses) if not shifted else step * (np.arange(courses) + 0.5)
        shell = unions.region_of(part).shell
        ends = [0.0, *joints.tolist(), prism.length]
        pieces += [prism.part(shell, low, high) for low, high in itertools.pairwise(ends)]
    return pieces
