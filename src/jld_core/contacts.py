"""Where elements touch: planar polygons to interfaces with local frames.

Contact is a matter of edges, not of areas, so it is decided by the distance and the overlap of edge pairs
within a tolerance relative to the edges; shapely finds the pairs worth looking at and judges polygons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import MultiPoint, Polygon

from jld_core import tolerances
from jld_core.assembly import Floats, Interfaces
from jld_core.errors import InputError


@dataclass(frozen=True)
class PlanarContact:
    """A straight contact: element indices, end points (2, 2), and the unit normal from a to b."""

    a: int
    b: int
    ends: Floats
    normal: Floats


def without_repeats(polygon: Floats) -> Floats:
    """(k, 2) outline without corners that repeat the one before, such as the first given again at the end."""
    step = np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1)
    return np.asarray(polygon[step > tolerances.ROUNDING * np.ptp(polygon, axis=0).max()])


def check_polygons(ids: list[str], polygons: list[Floats]) -> None:
    """Refuse polygons that are not simple, have no area, or cover one another.

    ids: (n,) names; polygons: n arrays (k, 2), any unit, either sense of rotation.
    Raises InputError naming the element or the pair.
    """
    for name, polygon in zip(ids, polygons, strict=True):
        thin = len(polygon) < 3 or not MultiPoint(polygon).convex_hull.area > 1e-14 * float(
            np.ptp(polygon, axis=0).max() ** 2
        )
        if thin:
            raise InputError(f"element {name!r}", "its polygon has no area", "three corners not in a line")
    shapes = [Polygon(p) for p in polygons]
    for name, polygon, shape in zip(ids, polygons, shapes, strict=True):
        span = float(np.ptp(polygon, axis=0).max())
        if not shape.is_valid:
            reason = shapely.is_valid_reason(shape).split("[")[0].strip().lower() or "not simple"
            raise InputError(
                f"element {name!r}",
                f"its polygon is wrong ({reason})",
                "an outline that does not meet itself",
            )
        if not shape.area > 1e-14 * span**2:
            raise InputError(f"element {name!r}", "its polygon has no area", "a polygon with an area")
    tree = shapely.STRtree(shapes)
    left, right = tree.query(shapes, predicate="intersects")
    for a, b in sorted((int(a), int(b)) for a, b in zip(left, right, strict=True) if a < b):
        shared = shapes[a].intersection(shapes[b]).area
        if shared > tolerances.OVERLAP * min(shapes[a].area, shapes[b].area):
            raise InputError(
                f"elements {ids[a]!r} and {ids[b]!r}",
                "they overlap",
                "elements that touch along edges at the most",
            )


def find_planar_contacts(polygons: list[Floats]) -> list[PlanarContact]:
    """All straight contacts between polygons, in order of (a, b) and then along the outline of a.

    polygons: n arrays (k, 2), counter-clockwise. Pieces of one contact that join end to end in a line
    (a corner hanging on the middle of an edge, a vertex without a corner) are one contact; pieces apart
    from one another or around a corner are several.
    Source: interface frame of Iannuzzo et al. 2024, normals from element faces.
    """
    shapes = [Polygon(p) for p in polygons]
    spans = np.array([np.ptp(p, axis=0).max() for p in polygons])
    tree = shapely.STRtree(shapes)
    boxes = shapely.box(
        *(np.array([s.bounds for s in shapes]) + np.outer(spans, tolerances.CONTACT * np.array([-1, -1, 1, 1]))).T
    )
    left, right = tree.query(boxes)
    near = sorted({(int(min(a, b)), int(max(a, b))) for a, b in zip(left, right, strict=True) if a != b})
    found = []
    for a, b in near:
        pieces = _touching_pieces(polygons[a], polygons[b])
        found += [PlanarContact(a, b, ends, normal) for ends, normal in _join_in_line(pieces)]
    return found


def _touching_pieces(first: Floats, second: Floats) -> list[tuple[Floats, Floats]]:
    """Overlaps of the edges of two polygons: (ends along the first's outline, outward normal of the first)."""
    start_a, start_b = first, second
    edge_a, edge_b = np.roll(first, -1, axis=0) - first, np.roll(second, -1, axis=0) - second
    length_a, length_b = np.hypot(*edge_a.T), np.hypot(*edge_b.T)
    unit_a, unit_b = edge_a / length_a[:, None], edge_b / length_b[:, None]
    outward = np.column_stack([unit_a[:, 1], -unit_a[:, 0]])
    reach = tolerances.CONTACT * np.minimum.outer(length_a, length_b)
    offset = start_b[None, :, :] - start_a[:, None, :]
    along0 = np.einsum("ijk,ik->ij", offset, unit_a)
    off0 = np.einsum("ijk,ik->ij", offset, outward)
    along1 = along0 + unit_a @ edge_b.T
    off1 = off0 + outward @ edge_b.T
    low = np.maximum(along1, 0.0)
    high = np.minimum(along0, length_a[:, None])
    opposite = unit_a @ unit_b.T < 0.0
    # the distance between the edges is measured where they face one another, so that an edge that is long
    # and turned by a hair is judged by the contact and not by its far end
    slope = (off1 - off0) / np.where(along1 == along0, 1.0, along1 - along0)
    apart = np.maximum(abs(off0 + slope * (low - along0)), abs(off0 + slope * (high - along0)))
    touching = opposite & (high - low > reach) & (apart <= reach)
    pieces = []
    for i, j in zip(*np.nonzero(touching), strict=True):
        ends = start_a[i] + np.outer([low[i, j], high[i, j]], unit_a[i])
        pieces.append((ends + 0.5 * apart[i, j] * np.sign(off0[i, j]) * outward[i], outward[i]))
    return pieces


def _join_in_line(pieces: list[tuple[Floats, Floats]]) -> list[tuple[Floats, Floats]]:
    """Join pieces that continue one another in a straight line."""
    joined: list[tuple[Floats, Floats]] = []
    for ends, normal in pieces:
        for index, (others, other) in enumerate(joined):
            reach = tolerances.CONTACT * max(np.hypot(*(ends[1] - ends[0])), np.hypot(*(others[1] - others[0])))
            # the sine of the kink: its cosine would let angles pass that are the root of the tolerance
            if normal @ other <= 0.0 or abs(normal[0] * other[1] - normal[1] * other[0]) > tolerances.CONTACT:
                continue
            if np.hypot(*(others[1] - ends[0])) <= reach:
                joined[index] = (np.array([others[0], ends[1]]), other)
                break
            if np.hypot(*(ends[1] - others[0])) <= reach:
                joined[index] = (np.array([ends[0], others[1]]), other)
                break
        else:
            joined.append((ends, normal))
    if len(joined) < len(pieces) and len(joined) > 1:  # the last piece may close the ring onto the first
        again = _join_in_line(joined)
        return again if len(again) < len(joined) else joined
    return joined


def planar_interfaces(contacts: list[PlanarContact], thickness: float) -> Interfaces:
    """Local frames of straight contacts: origin at mid-length, e1 = normal turned +90°.

    contacts: m of them; thickness: out-of-plane depth, scene units. Returns Interfaces of dimension 2.
    """
    ends = np.array([c.ends for c in contacts]).reshape(-1, 2, 2)
    normal = np.array([c.normal for c in contacts]).reshape(-1, 2)
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    count = len(contacts)
    return Interfaces(
        a=np.array([c.a for c in contacts], dtype=np.int64),
        b=np.array([c.b for c in contacts], dtype=np.int64),
        origin=ends.mean(axis=1),
        normal=normal,
        e1=np.column_stack([-normal[:, 1], normal[:, 0]]),
        e2=np.empty((count, 0)),
        l1=length,
        l2=np.full(count, thickness),
        area=length * thickness,
        c_t=np.zeros(count),
        rectangle=np.ones(count, dtype=bool),
        polygon=tuple(ends),
    )
