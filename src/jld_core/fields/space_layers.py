"""Long and flat cells, cut in layers by planes before they are filled with tetrahedra.

Fans about the centroid of a long or flat cell have no planes at 45° to its edges, where blocks shear, and none in the
middle of its depth, where bending changes sign. Bricks of its smallest width at its ends have both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from jld_core.arrays import Floats, Ints
from jld_core.fields.space_surface import Facet, Surface

_TWICE = 2.0 - 1e-6  # least ratio of the width of a cell to the size of its end at which it is cut in the middle

# Least ratio of the width of a cell to the size of its end at which it is cut at that size from both ends
_THRICE = 3.0 - 1e-6

_SNAP = 0.3  # distance, relative to the size of the end, within which a plane is moved to a node

_OPPOSITE = -0.7  # cosine between outward normals of two facets below which they are ends of their cell

_DIGITS = 9  # decimal digits to which relative positions of nodes are compared


@dataclass(frozen=True)
class Part:
    """Convex part of a cell that planes cut.

    side: (k,) True where the part lies beyond a plane, in the direction of its normal. skin: pairs of facet and outline
    (c, 3), for faces on facets of the cell. caps: pairs of plane and outline (c, 3), for faces on planes. Outlines are
    in scene units.
    """

    side: tuple[bool, ...]
    skin: tuple[tuple[int, Floats], ...]
    caps: tuple[tuple[int, Floats], ...]


@dataclass(frozen=True)
class Layers:
    """Planes that cut one cell into layers, and the parts between them.

    normal: (k, 3) unit normals n. offset: (k,) distances d of the planes n·x = d, scene units. parts: the convex parts,
    which fill the cell.
    """

    normal: Floats
    offset: Floats
    parts: tuple[Part, ...]

    def side(self, place: Floats) -> tuple[bool, ...]:
        """Return for each of the k planes True if a place (3,) lies beyond it.

        For a place inside the cell, the result equals `Part.side` of the part that holds it.
        """
        return tuple((self.normal @ place > self.offset).tolist())


def layers_of(surface: Surface, cell: int) -> Layers | None:
    """Choose the planes that cut a long or flat cell into layers, and cut it.

    surface: surfaces of all cells, with load patches. cell: element. Result: between two opposite facets whose smaller
    sides are s, a cell of width w ≥ 3 s has planes at s from both; one of w ≥ 2 s has one half way. None for a cell
    without such facets.
    """
    own = [index for index, facet in enumerate(surface.facets) if facet.cell == cell]
    normals = np.array([surface.facets[index].normal for index in own])
    cosine = normals @ normals.T
    across = cosine.argmin(axis=1)
    nodes = _nodes(surface, own)
    planes: list[tuple[Floats, float]] = []
    for i, j in enumerate(across.tolist()):
        if i < j and across[j] == i and cosine[i, j] < _OPPOSITE:
            planes += _planes(surface, surface.facets[own[i]], surface.facets[own[j]], nodes)
    if not planes:
        return None
    parts = [Part((), tuple((k, surface.points[surface.facets[k].ring]) for k in own), ())]
    for number, (normal, offset) in enumerate(planes):
        parts = [half for part in parts for half in _halves(part, number, normal, offset, surface.reach)]
    return Layers(np.array([n for n, _ in planes]), np.array([d for _, d in planes]), tuple(parts))


def corners_of(surface: Surface, layers: dict[int, Layers]) -> Floats:
    """Return the points (k, 3) where layered cells need nodes, scene units; some repeat.

    They are the corners of the cells' parts, and of the pieces of interfaces, load patches and free regions on their
    facets. surface: surfaces of all cells. layers: by cell, at least one; cells without an entry stay whole.
    """
    places = [outline for one in layers.values() for part in one.parts for _, outline in (*part.skin, *part.caps)]
    for index, facet in enumerate(surface.facets):
        if facet.cell not in layers:
            continue
        found = [
            piece
            for face, region in zip(facet.faces, surface.covered(facet), strict=True)
            for piece in pieces(surface, index, region, layers, face)
        ]
        for region in (*surface.free(facet), *surface.loaded(index)):
            found += pieces(surface, index, region, layers)
        places += [facet.placed(shapely.get_coordinates(piece)) for piece in found]
    return np.concatenate(places)


def pieces(
    surface: Surface, index: int, region: shapely.Polygon, layers: dict[int, Layers], face: int | None = None
) -> list[shapely.Polygon]:
    """Cut a region of a facet along the parts of its cell, in the plane of the facet.

    surface: surfaces of all cells. index: facet. region: interface, load patch or free region in the plane of the
    facet. layers: layers by cell, for the cells that are cut. face: interface that the region is: the cells on both of
    its sides cut it. By default only the cell of the facet does. Result: pieces without slivers; the region itself
    where no cell is cut.
    """
    facet, found = surface.facets[index], [region]
    both = [k for k, one in enumerate(surface.facets) if face is not None and face in one.faces]
    for place in both or [index]:
        cell = surface.facets[place].cell
        if cell not in layers:
            continue
        outlines = [outline for part in layers[cell].parts for name, outline in part.skin if name == place]
        cutters = [shapely.Polygon(facet.flat(outline)) for outline in outlines]
        parts = [shapely.intersection(one, cutter) for one in found for cutter in cutters]
        found = [
            _without_straight_corners(one, surface.reach)
            for part in parts
            for one in shapely.get_parts(part).tolist()
            if one.geom_type == "Polygon" and one.area > surface.reach * one.length
        ]
    return found


def _without_straight_corners(region: shapely.Polygon, reach: float) -> shapely.Polygon:
    """Return a polygon without corners on straight edges, which rounding may cross.

    reach: distance within which a corner lies on an edge.
    """
    plain = shapely.simplify(region, reach)
    corners = shapely.get_coordinates(plain.exterior)[:-1]
    along = corners[1] - corners[-1]
    off = abs(float(np.linalg.det([along, corners[0] - corners[-1]]))) / float(np.linalg.norm(along))
    # the first corner is never simplified away
    return shapely.Polygon(corners[1:], plain.interiors) if off <= reach and len(corners) > 3 else plain


def _nodes(surface: Surface, own: list[int]) -> Floats:
    """Return the nodes (k, 3) of facets `own`, and of the interfaces and load patches on them."""
    rings: list[Ints] = []
    for index in own:
        facet = surface.facets[index]
        rings += [facet.ring, *(ring for f in facet.faces if (ring := surface.faces[f]) is not None)]
        rings += [ring for place, loops in surface.patches if place == index for ring in loops]
    return surface.points[np.unique(np.concatenate(rings))]


def _planes(surface: Surface, one: Facet, other: Facet, nodes: Floats) -> list[tuple[Floats, float]]:
    """Return the planes, as unit normal (3,) and offset, that cut a cell between two facets.

    one, other: opposite facets. nodes: (k, 3) of the surface of the cell; a plane close to one is moved to it. Where
    the facets lean, all planes meet in one line. Empty unless the cell is long or flat.
    """

    def share(places: Floats) -> Floats:
        """Return the distance (k,) of places (k, 3) from `one`, over the sum of both distances."""
        near, far = (one.origin - places) @ one.normal, (other.origin - places) @ other.normal
        return np.asarray(near / (near + far))

    middle = nodes.mean(axis=0)
    width = float((one.origin - middle) @ one.normal + (other.origin - middle) @ other.normal)
    side = max(_smaller_side(surface, one), _smaller_side(surface, other))
    if width >= _THRICE * side:
        places = [side / width, 1.0 - side / width]
    else:
        places = [0.5] if width >= _TWICE * side else []
    known = np.unique(np.round(share(nodes), _DIGITS))
    planes = []
    for place in places:
        nearest = float(known[np.argmin(np.round(abs(known - place), _DIGITS))])
        t = nearest if abs(nearest - place) * width <= _SNAP * side else place
        lean = t * other.normal - (1.0 - t) * one.normal
        size = float(np.linalg.norm(lean))
        offset = t * float(other.origin @ other.normal) - (1.0 - t) * float(one.origin @ one.normal)
        planes.append((lean / size, offset / size))
    return planes


def _smaller_side(surface: Surface, facet: Facet) -> float:
    """Return the smaller side of the smallest rectangle around a facet."""
    frame = shapely.minimum_rotated_rectangle(shapely.Polygon(facet.flat(surface.points[facet.ring])))
    corners = shapely.get_coordinates(frame)
    return float(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1).min())


def _halves(part: Part, number: int, normal: Floats, offset: float, reach: float) -> list[Part]:
    """Cut a part by plane `number`: return its two halves, or the part alone if on one side.

    normal: (3,) and offset of the plane. reach: distance within which a corner lies on it. `Part.side` grows by one
    entry.
    """
    skins: tuple[list[tuple[int, Floats]], ...] = ([], [])
    caps: tuple[list[tuple[int, Floats]], ...] = ([], [])
    on: list[Floats] = []
    for source, target in ((part.skin, skins), (part.caps, caps)):
        for name, outline in source:
            for half, (piece, edge) in enumerate(_clipped(outline, normal, offset, reach)):
                on.append(edge)
                if len(piece) > 2:
                    target[half].append((name, piece))
    for half in (0, 1):
        if not skins[half] and not caps[half]:
            return [Part((*part.side, half == 0), part.skin, part.caps)]
    cap = _convex(np.concatenate(on), normal, reach)
    return [Part((*part.side, bool(half)), tuple(skins[half]), (*caps[half], (number, cap))) for half in (0, 1)]


def _clipped(outline: Floats, normal: Floats, offset: float, reach: float) -> list[tuple[Floats, Floats]]:
    """Cut a convex outline (c, 3) by a plane into the pieces before and beyond it.

    normal: (3,) and offset of the plane. Points within `reach` lie on it. Each of the two results is a piece (c, 3)
    with its points on the plane (j, 3). A piece is empty if nothing of the outline lies strictly on its side.
    """
    height = outline @ normal - offset
    height = np.where(abs(height) <= reach, 0.0, height)
    after, next_height = np.roll(outline, -1, axis=0), np.roll(height, -1)
    found = []
    for sign in (-1.0, 1.0):
        piece, edge = [], []
        for a, b, h, k in zip(outline, after, height, next_height, strict=True):
            if sign * h >= 0.0:
                piece.append(a)
                if h == 0.0:
                    edge.append(a)
            if h * k < 0.0:
                piece.append(a + (b - a) * (h / (h - k)))
                edge.append(piece[-1])
        inside = bool((sign * height > 0.0).any())
        found.append((np.array(piece) if inside else np.zeros((0, 3)), np.array(edge).reshape(-1, 3)))
    return found


def _convex(places: Floats, normal: Floats, reach: float) -> Floats:
    """Order the corners of a convex polygon counter-clockwise and merge repeated ones, (c, 3).

    places: (k, 3) corners in any order. normal: (3,) of their plane. reach: distance within which places are one
    corner.
    """
    one = np.eye(3)[np.argmin(abs(normal))]
    one = np.cross(normal, one)
    one /= np.linalg.norm(one)
    two = np.cross(normal, one)
    middle = places.mean(axis=0)
    angle = np.arctan2((places - middle) @ two, (places - middle) @ one)
    ordered = places[np.argsort(angle)]
    apart = np.linalg.norm(ordered - np.roll(ordered, 1, axis=0), axis=1) > reach
    return ordered[apart] if apart.any() else ordered[:1]
