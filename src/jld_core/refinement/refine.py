"""Refinement of a scene: split elements into cells and transfer loads, labels and search."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely

from jld_core import plugins, tolerances
from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, Interfaces, faces_of
from jld_core.build import build_robust, cases_of_scene
from jld_core.build.assemble import build_assembly
from jld_core.build.loads import Boundary
from jld_core.build.materials import direction_of_weight
from jld_core.errors import InputError, ParameterError
from jld_core.geometry import Faces
from jld_core.geometry.polyhedra import distance_from_face, distance_to, point_in_face
from jld_core.geometry.unions import region_of, union_outlines
from jld_core.parameters import typed
from jld_core.refinement.arrangement import convex, cut, join_small, refuse_more, split_by_cells, squares
from jld_core.scene.loads import FaceLoad, FacePlace
from jld_core.scene.reading import parse_scene
from jld_core.scene.schema import Scene
from jld_core.scene.uncertain import Uncertain, stated_values, uncertain_values, with_means

_CAPACITIES: Final = ("tension", "compression", "prestress", "shear")
"""Forces of a member, of which each share has its part."""

_MOST_SHARES: Final = 64  # largest number of members that one member becomes


@dataclass(frozen=True)
class Piece:
    keys: dict[str, Any]  # geometry keys of its scene entry
    share: float  # its volume over that of the element

    @property
    def loops(self) -> tuple[tuple[int, ...], ...]:
        """Faces as loops of vertices, empty in the plane."""
        return tuple(tuple(loop) for loop in self.keys.get("faces", ()))


def loads_of(loads: dict[str, Any], assembly: Assembly, pieces: list[list[Piece]]) -> dict[str, Any]:
    """Transfer loads to the pieces at their points; InputError for pressure on a free part with a hole."""

    def to_pieces(entry: dict[str, Any], where: str) -> list[dict[str, Any]]:
        """Return an entry as those of the pieces at its point, which share its force and moment."""
        between = entry.get("face", {}).get("between")
        if between is not None and len(pieces[assembly.elements.index[between[0]]]) > 1:
            return [{**entry, "face": place} for place in _free_parts(assembly, between)]
        if "element" not in entry:
            return [entry]
        k = assembly.elements.index[entry["element"]]
        if len(pieces[k]) == 1:
            return [entry]
        point = entry.get("at") or assembly.elements.centroid[k].tolist()
        indices = _holding(pieces[k], np.array(point), tolerances.ON_OUTLINE * assembly.size)
        shared: dict[str, Any] = {}
        for key in ("force", "moment"):
            if key in entry:
                shared[key] = _share(entry[key], len(indices), f"{where}.{key}")
        if "force" in shared:
            shared["at"] = point
        return [{**entry, "element": f"{entry['element']}.{number}", **shared} for number in indices]

    def transferred_of(part: dict[str, Any], where: str) -> dict[str, Any]:
        by_key: dict[str, Any] = {}
        for key in ("live", "dead"):
            if key in part:
                entries = (to_pieces(entry, f"{where}.{key}[{k}]") for k, entry in enumerate(part[key]))
                by_key[key] = list(itertools.chain(*entries))
        return by_key

    transferred = transferred_of(loads, "loads")
    transferred |= {key: loads[key] for key in ("moving", "pushes") if key in loads}
    if "cases" in loads:
        transferred["cases"] = [
            {**case, **transferred_of(case, f"loads.cases[{k}]")} for k, case in enumerate(loads["cases"])
        ]
    return transferred


def _free_parts(assembly: Assembly, between: list[str]) -> list[dict[str, Any]]:
    """Return the free parts of an element's boundary as values of "face"; between: its id and "outside"."""
    boundary = Boundary(assembly.elements, assembly.interfaces, 1.0)
    parts = boundary.loads([FaceLoad(face=FacePlace(between=between), pressure=1.0)], "loads")
    if any(len(traction.rings) > 1 for traction in parts.tractions):
        raise InputError(
            "loads",
            f"a pressure acts on a free face of {between[0]!r} with a hole, and the element is split",
            '"patch" with polygons without holes',
        )
    key = "along" if assembly.dimension == 2 else "patch"
    return [{key: traction.rings[0].tolist()} for traction in parts.tractions]


def members_of(members: list[dict[str, Any]], assembly: Assembly, pieces: list[list[Piece]]) -> list[dict[str, Any]]:
    """Transfer members to the pieces that contain their points, which share them; InputError for too many shares."""
    # A pin without length is shared by the pieces that touch along the face that it crosses.
    reach = tolerances.ON_OUTLINE * assembly.size

    def on_pieces(anchor: dict[str, Any]) -> list[dict[str, Any]]:
        parts = pieces[assembly.elements.index[anchor["element"]]]
        indices = _holding(parts, np.array(anchor["at"]), reach)
        return [{**anchor, "element": f"{anchor['element']}.{k}"} for k in indices] if len(parts) > 1 else [anchor]

    shares = []
    for position, member in enumerate(members):
        anchors = [member["from"], *member.get("through", []), member["to"]]
        choices = [on_pieces(anchor) for anchor in anchors]
        count = math.prod(map(len, choices))
        if count > _MOST_SHARES:
            problem = f"its points lie at common corners of cells, which share it in {count} ways"
            raise InputError(f"members[{position}]", problem, "points inside cells, or another size of cells")
        combinations = list(itertools.product(*choices))
        if count > 1 and math.dist(anchors[0]["at"], anchors[-1]["at"]) <= reach and len(anchors) == 2:
            touching = _beside_face(assembly, pieces, anchors, reach)
            combinations = [pair for pair in combinations if (pair[0]["element"], pair[1]["element"]) in touching]
        name = member.get("name") or f"{member['kind']} {position + 1}"
        for number, (start, *through, end) in enumerate(combinations):
            share = {**member, "name": name, "from": start, "to": end}
            if through:
                share["through"] = through
            if len(combinations) > 1:
                share |= {"name": f"{name} ({number + 1} of {len(combinations)})"}
                share |= {
                    key: _share(member[key], len(combinations), f"members[{position}].{key}")
                    for key in _CAPACITIES
                    if key in member
                }
            shares.append(share)
    return shares


def _share(value: Any, count: int, where: str, fraction: float | None = None) -> Any:
    # The part of one of `count` pieces, an equal one by default; a dict has a nominal and a low value.
    if isinstance(value, list):
        return [_share(x, count, where, fraction) for x in value]
    if count == 1:
        return value
    if isinstance(value, dict) and "mean" in value:
        raise InputError(where, "it is uncertain, and several cells would share it", "larger cells, or a number")
    factor = 1.0 / count if fraction is None else fraction
    return {name: number * factor for name, number in value.items()} if isinstance(value, dict) else value * factor


def _beside_face(
    assembly: Assembly, pieces: list[list[Piece]], anchors: list[dict[str, Any]], reach: float
) -> set[tuple[str, str]]:
    """Return the pairs of pieces of two elements that touch around the common point of two anchors."""
    elements, faces, centre = assembly.elements, assembly.interfaces, np.array(anchors[0]["at"])
    first, second = (elements.index[anchor["element"]] for anchor in anchors)
    pairs: set[tuple[str, str]] = set()
    for face in faces.between(first, second).tolist():
        if assembly.dimension == 2:
            directions = np.array([faces.e1[face], -faces.e1[face]])
        else:
            # twelve directions, none of them along an edge of cells parallel to e1 or e2
            angle = 0.13 + np.arange(12) * np.pi / 6.0
            directions = np.cos(angle)[:, None] * faces.e1[face] + np.sin(angle)[:, None] * faces.e2[face]
        for point_beside in centre + 50.0 * reach * directions:
            if distance_from_face(faces, face, point_beside) > reach:
                continue
            holding = [(k, _holding(pieces[k], point_beside, reach)) for k in (first, second)]
            if all(len(indices) == 1 for _, indices in holding):
                a, b = (elements.ids[k] + (f".{indices[0]}" if len(pieces[k]) > 1 else "") for k, indices in holding)
                pairs.add((a, b))
    return pairs


def _holding(parts: list[Piece], point: Floats, reach: float) -> list[int]:
    """Return the indices of the pieces that hold a point (d,), or else are nearest to it, within `reach`."""
    corners = [np.array(part.keys.get("polygon", part.keys.get("vertices"))) for part in parts]
    distance = np.array([distance_to(shape, part.loops, point) for shape, part in zip(corners, parts, strict=True)])
    return np.flatnonzero(distance <= distance.min() + reach).tolist()


def _old_faces(assembly: Assembly) -> dict[tuple[str, str], list[int]]:
    """Return the indices of the faces between each pair of elements, by the sorted ids."""
    ids, faces = assembly.elements.ids, assembly.interfaces
    by_pair: dict[tuple[str, str], list[int]] = {}
    for k, (a, b) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        by_pair.setdefault((min(ids[a], ids[b]), max(ids[a], ids[b])), []).append(k)
    return by_pair


def face_of_piece(old: Interfaces, candidates: list[int], new: Interfaces, piece: int) -> int:
    """Return which face contains a piece's face: the one at distance zero from a point inside it."""
    # The centroid would not do: another face's may be nearer, and that of a face around a corner lies outside it.
    if len(candidates) == 1:
        return candidates[0]
    point = point_in_face(new, piece)
    return candidates[int(np.argmin([distance_from_face(old, face, point) for face in candidates]))]


def labels_of(old: Assembly, new: Assembly, parent: dict[str, str]) -> dict[str, list[list[str]]]:
    """Return the label lists of pairs of pieces under which all faces keep their old labels."""
    # New faces within one element are inner, those between elements that did not touch dry. Faces that `new` labels so
    # already are left out.
    old_faces = _old_faces(old)
    ids, faces = new.elements.ids, new.interfaces
    lists: dict[str, list[list[str]]] = {"inner": [], "dry": []}
    for k, (a, b) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        first, second = parent[ids[a]], parent[ids[b]]
        dry = False
        if first != second:
            candidates = old_faces.get((min(first, second), max(first, second)), [])
            dry = bool(old.labels[face_of_piece(old.interfaces, candidates, faces, k)]) if candidates else True
        if dry != bool(new.labels[k]):
            lists["dry" if dry else "inner"].append([ids[a], ids[b]])
    return {key: pairs for key, pairs in lists.items() if pairs}


def search_of(
    search: dict[str, Any], scene: Scene, old: Assembly, new: Assembly, parent: dict[str, str], by: str | None
) -> dict[str, Any]:
    """Change the search of a scene to refer to pieces, and keep old joints as `by` requires."""
    ids, faces = new.elements.ids, new.interfaces
    couples = [(ids[a], ids[b]) for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True)]
    by_parents: dict[tuple[str, str], list[list[str]]] = {}
    for a, b in couples:
        first, second = sorted((parent[a], parent[b]))
        by_parents.setdefault((first, second), []).append([a, b])

    def pieces_of(pairs: list[list[str]]) -> list[list[str]]:
        """Return the pairs of pieces that touch between pairs of original elements."""
        return [pair for a, b in pairs for pair in by_parents.get((min(a, b), max(a, b)), [])]

    if isinstance(search.get("candidates"), list):
        inside_elements = [pair for (first, second), pairs in by_parents.items() if first == second for pair in pairs]
        search["candidates"] = pieces_of(search["candidates"]) + inside_elements
    keep = {key: pieces_of(pairs) for key, pairs in search.get("keep", {}).items()}
    if by == "block":
        search["candidates"] = "inside-blocks"
    if by == "material":
        # weight over volume of each element by id; 0 for supports without weight
        weight = np.linalg.norm(old.elements.weight, axis=1)
        rate = weight / np.where(old.elements.volume > 0.0, old.elements.volume, 1.0)
        density = dict(zip(old.elements.ids, rate.tolist(), strict=True))
        mixed = [pairs for (a, b), pairs in by_parents.items() if not np.isclose(density[a], density[b], rtol=1e-9)]
        free = {name for name, support in zip(ids, new.elements.support, strict=True) if not support}
        pairs_kept = [pair for pairs in mixed for pair in pairs if free.issuperset(pair)]
        keep["dry"] = keep.get("dry", []) + [pair for pair in pairs_kept if pair not in keep.get("dry", [])]
    if any(keep.values()):
        search["keep"] = {key: pairs for key, pairs in keep.items() if pairs}
    if "except" in search:
        excepted = set(search["except"])
        search["except"] = [name for name in ids if parent[name] in excepted]
    return search


KINDS: Final = ("grid", "bond", "voronoi", "radial")
"""Names of the kinds of cells of a given size; the last two are planar only."""

# Names of the groups of old joints that a search must keep, for the parameter `by` of `refine`.
BY: Final = ("block", "material")
SNAP: Final = 0.4  # largest distance, relative to a cell, to which corners of cells move: beyond it cells degenerate
_MOST_LENGTH: Final = 1e100  # sizes beyond it overflow in squares


@dataclass(frozen=True)
class CellOptions:
    """Arguments of `refine`; `polygons` is its `cells`."""

    cell: tuple[float, ...]
    kind: str
    centre: tuple[float, float] | None
    seed: int
    bond: str
    voussoirs: int | None
    rings: int
    courses: int
    snap: float
    polygons: Sequence[shapely.Polygon] | None
    skew: float | None
    lintel: int
    bearing: float | None


def check_options(scene: Scene, grid: CellOptions, by: str | None) -> None:
    """Raise an error for arguments of `refine` that are invalid or do not fit the scene."""
    # ParameterError: `grid` or `by` is wrong. InputError: the scene cannot be refined.
    if by is not None and by not in BY:
        raise ParameterError("by", f"{by!r} is unknown", "one of " + ", ".join(BY))
    if grid.voussoirs is None:
        _check_sizes(scene, grid)
    elif grid.cell or grid.kind != "grid" or grid.polygons is not None:
        raise ParameterError("voussoirs", "it does not go with `cell` or `kind`", "one or the other")
    elif grid.bond not in ("running", "stack"):
        raise ParameterError("bond", f"{grid.bond!r} is no bond of voussoirs", "running or stack")
    elif grid.courses < 1:
        raise ParameterError("courses", f"{grid.courses} is wrong", "a whole number from 1")
    elif scene.dimension == 2 and grid.courses != 1:
        raise ParameterError("courses", "the scene is planar and has no axis", "a spatial scene, or no `courses`")
    elif scene.dimension == 3 and grid.centre is not None:
        raise ParameterError("centre", "the scene is spatial", "a planar scene, or a vault with an arc")
    if grid.skew is not None and (grid.voussoirs is None or grid.centre is not None):
        raise ParameterError("skew", "it is that of a flat arch without a centre", "`voussoirs`, and no `centre`")
    if grid.skew is not None and not 1.0 <= grid.skew < 90.0:
        raise ParameterError("skew", f"{grid.skew:g} is no inclination of joints", "from 1 to below 90 degrees")
    if (grid.lintel != 1 or grid.bearing is not None) and (grid.kind != "bond" or scene.dimension == 2):
        name = "lintel" if grid.lintel != 1 else "bearing"
        raise ParameterError(name, "it is that of openings in walls drawn as solids", "`kind` bond, of a spatial scene")
    if grid.lintel < 1:
        raise ParameterError("lintel", f"{grid.lintel} is no number of stones", "1, or more for a flat arch")
    if grid.bearing is not None and not 0.0 < grid.bearing < float("inf"):
        raise ParameterError("bearing", f"{grid.bearing:g} is wrong", "a length above 0")
    if grid.centre is not None and not np.isfinite(grid.centre).all():
        raise ParameterError("centre", f"{grid.centre[0]:g},{grid.centre[1]:g} is no point", "x,y")
    if not 0.0 <= grid.snap <= SNAP:
        raise ParameterError("snap", f"{grid.snap:g} of a cell is wrong", f"0 to {SNAP:g}")
    if grid.snap and scene.dimension == 3:
        raise ParameterError("snap", "the scene is spatial", "a planar scene, or 0")
    if scene.interfaces is not None:
        raise InputError("interfaces", "they are given by hand", "a scene whose interfaces are found")
    if scene.materials.faces:
        raise InputError("materials.faces", "they name elements that are split", "a scene without them")
    if scene.materials.inner is None:
        raise InputError("materials.inner", "missing, and cells are joined by inner faces", "strengths of the material")


def _check_sizes(scene: Scene, grid: CellOptions) -> None:
    """Raise ParameterError for options of a grid that are invalid or contradict each other."""
    cell, kind = grid.cell, grid.kind
    if grid.polygons is not None and (kind != "grid" or scene.dimension == 3):
        raise ParameterError("cells", "own cells are planar and of no kind", "a planar scene, without `kind`")
    if kind not in KINDS:
        raise ParameterError("kind", f"no cells are named {kind!r}", "one of " + ", ".join(KINDS))
    if not cell:
        raise ParameterError("cell", "missing", "the size of a cell, or `voussoirs` with their number")
    if not 1 <= len(cell) <= scene.dimension or not all(0.0 < size < _MOST_LENGTH for size in cell):
        raise ParameterError(
            "cell", f"{','.join(f'{size:g}' for size in cell)} is wrong", "one size above 0 for each axis"
        )
    if grid.rings != 1 or grid.courses != 1:
        name = "rings" if grid.rings != 1 else "courses"
        raise ParameterError(name, "it goes with `voussoirs` only", "`voussoirs` with their number")
    if kind not in ("grid", "bond") and scene.dimension == 3:
        raise ParameterError("kind", f"{kind} cells are planar and the scene is spatial", "grid or bond")
    if grid.bond != "running" and kind != "bond":
        raise ParameterError("bond", f"{grid.bond!r} does nothing to cells of kind {kind}", "`kind` bond")
    if kind == "radial" and (grid.centre is None or len(cell) != 2):
        what = "it has no centre" if grid.centre is None else "it has one size"
        raise ParameterError("kind", what, "`centre` x,y and `cell` THICKNESS,DEGREES")


_LEAST: Final = 0.05  # share of a cell's area below which a piece joins its neighbour,
_LARGEST_LEAST: Final = 0.2  # but at most this share of its element's area


@dataclass(frozen=True)
class Refined:
    """Refined scene, with the origin of its elements.

    Attributes
    ----------
    scene : Scene
        Scene of the pieces.
    parent : dict of str to str
        Id of the original element of each piece.
    notes : tuple of str
        Data of the original scene that could not be kept.
    """

    scene: Scene
    parent: dict[str, str]
    notes: tuple[str, ...]


@typed
def refine(
    scene: Scene,
    cell: tuple[float, ...] = (),
    *,
    kind: str = "grid",
    by: str | None = None,
    centre: tuple[float, float] | None = None,
    seed: int = 0,
    bond: str = "running",
    voussoirs: int | None = None,
    rings: int = 1,
    courses: int = 1,
    snap: float = 0.0,
    cells: Sequence[shapely.Polygon] | None = None,
    skew: float | None = None,
    lintel: int = 1,
    bearing: float | None = None,
) -> Refined:
    """Split every free element of a scene into cells; supports stay whole.

    The scene's own labelling stays the same: inner faces join the pieces of an element, and old faces keep their
    labels. Loads act on the pieces that hold their point of application, which share them; moving loads and pressure
    along a polyline stay.
    Weights are distributed by volume.

    Parameters
    ----------
    scene : Scene
        Scene with inner material, without stated interfaces and without "materials.faces".
    cell : tuple of float
        Sizes of a cell along the axes, length; one size suffices. "radial": ring thickness, and sector angle in
        degrees. "bond": length of a stretcher, and height of a course. Empty with `voussoirs`.
    kind : {"grid", "bond", "voronoi", "radial"}
        Kind of cells. "bond": courses of masonry from the lowest point; in space, walls that meet at right angles,
        bonded at their corners, with lintels over rectangular openings. "voronoi" (planar): random cells of about this
        size. "radial" (planar): sectors of rings.
    by : {"block", "material"} or None
        Old joints that a search must keep. "block": all faces between old blocks keep their label. "material": faces
        between elements of different density stay dry. None: no joints are kept.
    centre : (float, float), optional
        Centre of radial cells; with `voussoirs`, the point where the joints of a flat arch meet.
    seed : int
        Seed of the random numbers for Voronoi cells.
    bond : {"running", "third", "stack", "english", "flemish"}
        Masonry bond of the kind "bond". With `voussoirs` in space: "stack" for courses in line, "running" for every
        second voussoir shifted by half a course.
    voussoirs : int or None
        Number of voussoirs between the springings of each opening. Centres and springings are those of the outline's
        arcs; an outline without an arc is a flat arch whose sides meet below it. None: cells of the size `cell`.
    rings : int
        Number of rings of voussoirs over the depth of an arch, or of the crown where spandrels lie above it.
    courses : int
        Number of voussoirs along the axis of a vault, of spatial scenes.
    snap : float
        Distance, relative to the shortest side of a cell, within which corners of cells move to a corner of the outline
        or to one another (planar). Cells without short edges have narrower bounds by fields. 0: corners stay.
    cells : sequence of shapely.Polygon, optional
        Own cells of about the size `cell`, which cover the structure (planar), instead of a kind.
    skew : float, optional
        Angle between the outer joints of a flat arch and the normal of its soffit, with `voussoirs`, degrees below 90.
    lintel : int
        Stones over an opening of walls in a bond in space: 1 for a lintel, more for a flat arch of so many wedges
        between two skewbacks.
    bearing : float, optional
        Least length by which lintels reach beyond the jambs, with skewbacks that of these. None: half a stretcher, or
        what is left of a shorter pier.

    Returns
    -------
    Refined
        Scene of the pieces, and the original element of each.

    Raises
    ------
    InputError
        If sizes or kinds do not fit the scene, an element cannot be cut, the inner material is missing, or a pressure
        acts on a free face with a hole of a solid that is split.
    """
    cell = tuple(cell)
    if cells is not None and not (len(cells) and all(isinstance(polygon, shapely.Polygon) for polygon in cells)):
        raise ParameterError("cells", "they are wrong", "a list of polygons")
    grid = CellOptions(cell, kind, centre, seed, bond, voussoirs, rings, courses, snap, cells, skew, lintel, bearing)
    check_options(scene, grid, by)
    assembly = build_assembly(scene)
    down = direction_of_weight(scene)
    pieces = _planar(assembly, grid, down) if assembly.dimension == 2 else _spatial(assembly, grid, down)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    entries, parent, notes = _elements(scene, assembly, pieces)
    thickness = scene.grid.thickness if scene.grid is not None else scene.thickness
    for key in ("grid", "elements", "labels"):
        document.pop(key, None)
    if assembly.dimension == 2 and thickness is not None:
        document["thickness"] = thickness
    document |= {"elements": entries, "loads": loads_of(document["loads"], assembly, pieces)}
    if scene.members:
        document["members"] = members_of(document["members"], assembly, pieces)
    search = document.pop("search", {})
    unlabelled = faces_of(build_assembly(parse_scene(document, scene.name)))
    document["labels"] = labels_of(assembly, unlabelled, parent)
    document["search"] = search_of(search, scene, assembly, unlabelled, parent, by)
    count = sum(value.each for _, value in uncertain_values(scene) if isinstance(value, Uncertain))
    if count and any(len(parts) > 1 for parts in pieces):
        notes.append(f'each piece has values of its own for {count} with "each": jld reliability counts more of them')
    return Refined(parse_scene(document, scene.name), parent, tuple(notes))


def _planar(assembly: Assembly, grid: CellOptions, down: Floats) -> list[list[Piece]]:
    """Cut all free planar elements into pieces; `down`: (2,) direction of weight."""
    elements = assembly.elements
    free = elements.free
    outlines = [shapely.Polygon(shape) for shape in elements.shape]
    cells, size, least = _cells(assembly, outlines, grid, down)
    shapes = [elements.shape[k] for k in free]
    fixed = [elements.shape[k] for k in np.flatnonzero(elements.support)]
    parts_of = split_by_cells([elements.ids[k] for k in free], shapes, fixed, cells, size, grid.snap)
    pieces = [[Piece({"polygon": shape.tolist()}, 1.0)] for shape in elements.shape]
    for k, parts in zip(free.tolist(), parts_of, strict=True):
        area = outlines[k].area
        joined = join_small(parts, min(least, _LARGEST_LEAST * area))
        if len(joined) > 1:
            pieces[k] = [Piece({"polygon": region_of(part).shell.tolist()}, part.area / area) for part in joined]
    return pieces


def _cells(
    assembly: Assembly, outlines: list[shapely.Polygon], grid: CellOptions, down: Floats
) -> tuple[list[shapely.Polygon], float, float]:
    """Return the cells, their shortest side, and the least area of a piece, below which it joins a neighbour."""
    elements, free = assembly.elements, assembly.elements.free
    if grid.voussoirs is not None:
        shapes = [elements.shape[k] for k in free]
        outline = shapely.MultiPolygon([shapely.Polygon(r.shell, r.holes) for r in union_outlines(shapes)])
        layout = plugins.part("masonry").voussoirs.voussoir_cells(
            outline, down, grid.voussoirs, grid.rings, grid.centre, grid.skew
        )
        return layout.cells, min(layout.width, layout.depth), _LEAST * layout.width * layout.depth
    lower, upper = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    sizes = (grid.cell[0], grid.cell[-1])
    if grid.polygons is not None:
        return list(grid.polygons), min(sizes), _LEAST * sizes[0] * sizes[1]
    if grid.kind == "grid":
        return squares(lower, upper, sizes), min(sizes), _LEAST * sizes[0] * sizes[1]
    patterns = plugins.part("masonry").patterns
    if grid.kind == "radial":
        if grid.centre is None:
            raise ValueError("radial cells need a centre")
        # the second size of radial cells is an angle
        return patterns.sectors(lower, upper, sizes, grid.centre), sizes[0], _LEAST * sizes[0] ** 2
    if grid.kind == "voronoi":
        cells = patterns.voronoi(shapely.union_all([outlines[k] for k in free]), sizes, grid.seed)
    else:
        cells = patterns.courses_of(lower, upper, sizes, grid.bond)
    return cells, min(sizes), _LEAST * sizes[0] * sizes[1]


def _spatial(assembly: Assembly, grid: CellOptions, down: Floats) -> list[list[Piece]]:
    """Cut all free spatial elements into pieces; `down`: (3,) direction of weight."""
    elements = assembly.elements
    cut_element = _cut_of(assembly, grid, down)
    pieces = []
    for k, (vertices, faces) in enumerate(zip(elements.shape, elements.faces, strict=True)):
        solids = [(vertices, faces)] if elements.support[k] else cut_element(k)
        volumes = np.array([_volume(*part) for part in solids])
        pieces.append(
            [
                Piece({"vertices": v.tolist(), "faces": [list(loop) for loop in f]}, float(share))
                for (v, f), share in zip(solids, volumes / volumes.sum(), strict=True)
            ]
        )
    return pieces


def _cut_of(assembly: Assembly, grid: CellOptions, down: Floats) -> Callable[[int], list[tuple[Floats, Faces]]]:
    """Return the function that cuts a spatial element, by index, into vertices and faces of pieces."""
    elements = assembly.elements
    if grid.voussoirs is None and grid.kind == "grid":
        return _by_planes(assembly, grid.cell)
    walls = plugins.part("masonry").walls
    if grid.voussoirs is None:
        free = elements.free.tolist()
        lintel = walls.Lintel(grid.lintel, grid.bearing)
        beds = walls.bed_joints(
            [elements.shape[k] for k in free], [elements.faces[k] for k in free], down, grid.cell[-1]
        )
        return lambda k: walls.split_walls(
            elements.ids[k], elements.shape[k], elements.faces[k], down, beds, grid.cell[0], grid.bond, lintel
        )
    count = (grid.voussoirs, grid.rings, grid.courses)
    running = grid.bond == "running"
    return lambda k: walls.split_prism(
        elements.ids[k], elements.shape[k], elements.faces[k], down, *count, running=running, skew=grid.skew
    )


def _by_planes(assembly: Assembly, cell: tuple[float, ...]) -> Callable[[int], list[tuple[Floats, Faces]]]:
    """Return the function that cuts a convex element, by index, by planes along the axes."""
    elements = assembly.elements
    sizes = (cell[0], cell[min(1, len(cell) - 1)], cell[-1])
    lower = elements.lower[elements.free].min(axis=0)
    upper = elements.upper[elements.free].max(axis=0)
    counts = [int(np.ceil((upper[axis] - lower[axis]) / sizes[axis] - 1e-9)) for axis in range(3)]
    refuse_more(math.prod(map(float, counts)))
    planes = [(np.eye(3)[axis], lower[axis] + sizes[axis] * np.arange(1, counts[axis])) for axis in range(3)]

    def cut_element(k: int) -> list[tuple[Floats, Faces]]:
        vertices, faces = elements.shape[k], elements.faces[k]
        pieces: list[tuple[Floats, Faces]] = [(vertices, faces)]
        for normal, offsets in planes:
            height = vertices @ normal
            crossing = offsets[(offsets > height.min()) & (offsets < height.max())]
            if len(crossing) and not convex(vertices, faces):
                raise InputError(f"element {elements.ids[k]!r}", "it is not convex", "convex spatial elements")
            for offset in crossing.tolist():
                pieces = [half for piece in pieces for half in cut(*piece, normal, offset)]
        return pieces

    return cut_element


def _volume(vertices: Floats, faces: Faces) -> float:
    total = 0.0
    for loop in faces:
        corners = vertices[list(loop)] - vertices[0]
        total += float(
            np.einsum("ij,ij->i", np.cross(corners[1:-1], corners[2:]), corners[[0] * (len(loop) - 2)]).sum()
        )
    return abs(total) / 6.0


def _elements(
    scene: Scene, assembly: Assembly, pieces: list[list[Piece]]
) -> tuple[list[dict[str, Any]], dict[str, str], list[str]]:
    """Write the scene entries of all pieces, with original elements and notes; InputError for an id taken."""
    elements = assembly.elements
    entry_of = {e.id: e.model_dump(mode="json", exclude_defaults=True) for e in scene.elements or []}
    entries, parent = [], {}
    lost = 0  # number of stated centroids
    for k, parts in enumerate(pieces):
        name = elements.ids[k]
        original = entry_of.get(name, {})
        for number, part in enumerate(parts):
            piece_id = name if len(parts) == 1 else f"{name}.{number}"
            keys: dict[str, Any] = {}
            for key, share in (("density", 1.0), ("weight", part.share), ("volume", part.share)):
                if key in original:
                    keys[key] = _share(original[key], len(parts), f"element {name!r}.{key}", share)
            if "centroid" in original and len(parts) == 1:
                keys["centroid"] = original["centroid"]
            if elements.support[k]:
                keys["support"] = True
                if elements.blocks[k] is not None:
                    keys["block"] = elements.blocks[k]
            else:
                keys["block"] = elements.blocks[k] if elements.blocks[k] is not None else name
            entries.append({"id": piece_id, **part.keys, **keys})
            parent[piece_id] = name
        lost += "centroid" in original and len(parts) > 1
    notes = [f"{lost} given centroids are gone: pieces have those of their outlines"] if lost else []
    names = [entry["id"] for entry in entries]
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise InputError(f"element {repeated!r}", "a piece would have the name of another element", "other ids")
    return entries, parent, notes


@dataclass(frozen=True)
class CrackCells:
    """Assembly of finer cells, with the joint-grid face that each of its faces is part of."""

    # the cells, with M interfaces; the assembly of the joint grid itself where no element is larger than a cell
    fine: Assembly
    face: Ints  # (M,) face of the joint grid that each face of the cells is a piece of, −1 inside an element

    def labels(self, labels: Bits) -> Bits:
        return np.asarray(np.where(self.face >= 0, labels[..., np.maximum(self.face, 0)], False))


def crack_cells(scene: Scene, assembly: Assembly, cell: float) -> CrackCells:
    """Split the elements of a scene into cells along which blocks may crack.

    Raises InputError if `refine` does not accept the scene, or if two cells touch although their elements do not.

    Parameters
    ----------
    scene : Scene
        Scene.
    assembly : Assembly
        Its structure.
    cell : float
        Size of a cell, scene units.

    Returns
    -------
    CrackCells
        Finer assembly, and the joint face of each of its faces.
    """
    # moving loads are stated case by case, on elements of the joint grid
    load_cases = cases_of_scene(scene, assembly.elements) if scene.loads.moving else []
    if load_cases:
        stated_cases = {"cases": [placement.case for placement in load_cases], "moving": None, "pushes": None}
        scene = scene.model_copy(update={"loads": scene.loads.model_copy(update=stated_cases)})
    try:
        refined = refine(_at_means(scene), (cell,))
    except InputError as error:
        where = "cracks" if error.where.startswith("--cell") else error.where
        raise InputError(where, error.problem, error.expected) from None
    if len(refined.parent) == len(assembly.elements):
        return CrackCells(assembly, np.arange(len(assembly.interfaces)))
    cells_alone = refined.scene.model_copy(update={"cracks": "faces"})
    fine = build_robust(cells_alone) if assembly.has_low_values else build_assembly(cells_alone)
    path_places = [placement.place for placement in load_cases] or [None] * len(fine.cases)
    cases = tuple(replace(case, place=place) for case, place in zip(fine.cases, path_places, strict=True))
    return CrackCells(replace(fine, cases=cases), joint_faces(assembly, fine, refined.parent))


def _at_means(scene: Scene) -> Scene:
    # of what cells may share: loads, capacities of members, weights
    shared = {"loads", "members", "elements"}
    if not any(any(True for _ in stated_values(getattr(scene, name))) for name in shared):
        return scene
    means = with_means(scene.model_dump(mode="json", exclude_defaults=True, include=shared))
    at_means = parse_scene(scene.model_dump(mode="json", exclude_defaults=True) | means, scene.name)
    return scene.model_copy(update={name: getattr(at_means, name) for name in shared})


def cells_of(assembly: Assembly, cell: float) -> CrackCells:
    """Split elements into cells under the assembly's loads, with joint faces; InputError if changed since built."""
    if assembly.scene is None:
        raise InputError("cracks", "cells are cut from a scene, and this assembly has none", "the scene itself")
    rebuilt = (build_robust if assembly.has_low_values else build_assembly)(assembly.scene)
    # the assembly is that of the scene, or of one of its load cases
    for case, candidate in ((None, rebuilt), *enumerate(rebuilt.by_case)):
        if len(candidate.cases) == len(assembly.cases) and _same(candidate, assembly):
            cells = crack_cells(assembly.scene, assembly, cell)
            return cells if case is None or cells.fine is assembly else replace(cells, fine=cells.fine.by_case[case])
    raise InputError(
        "cracks",
        "cells are cut from a scene, and this assembly was changed since it was built of it",
        "a changed scene",
    )


def _same(first: Assembly, second: Assembly) -> bool:
    """Return True if two assemblies have the same elements, loads and strengths."""
    pairs = [(first.face_strengths.table(), second.face_strengths.table())]
    for a, b in ((first, second), *zip(first.by_case, second.by_case, strict=True)):
        pairs += [(a.dead, b.dead), (a.live, b.live)]
    same_ids = first.elements.ids == second.elements.ids
    return same_ids and all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def joint_faces(joints: Assembly, fine: Assembly, parent: dict[str, str]) -> Ints:
    """Map each face of the cells to its joint-grid face (M,), −1 inside; InputError where elements do not touch."""
    element = np.array([joints.elements.index[parent[name]] for name in fine.elements.ids])
    between: dict[tuple[int, int], list[int]] = {}
    for face, pair in enumerate(zip(joints.interfaces.a.tolist(), joints.interfaces.b.tolist(), strict=True)):
        between.setdefault((min(pair), max(pair)), []).append(face)
    joint_of_face = np.full(len(fine.interfaces), -1, dtype=np.int64)
    for k, (a, b) in enumerate(zip(element[fine.interfaces.a], element[fine.interfaces.b], strict=True)):
        if a == b:
            continue
        candidates = between.get((int(min(a, b)), int(max(a, b))), [])
        if not candidates:
            ids = joints.elements.ids
            raise InputError(
                "cracks",
                f"cells of {ids[a]!r} and {ids[b]!r} touch, and these elements do not",
                "another size of cells",
            )
        joint_of_face[k] = face_of_piece(joints.interfaces, candidates, fine.interfaces, k)
    return joint_of_face
