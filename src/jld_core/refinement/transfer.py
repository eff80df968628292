"""Transfer of loads, labels and search from elements to the pieces that they are split into."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Assembly, Interfaces
from jld_core.build.loads import Boundary
from jld_core.errors import InputError, ParameterError
from jld_core.geometry.polyhedra import distance_from_face, distance_to, point_in_face
from jld_core.scene.loads import FaceLoad, FacePlace
from jld_core.scene.schema import Scene

_CAPACITIES: Final = ("tension", "compression", "prestress", "shear")
"""Forces of a member, of which each share has its part."""

_MOST_SHARES: Final = 64
"""Largest number of members that one member becomes."""


@dataclass(frozen=True)
class Piece:
    keys: dict[str, Any]  # geometry keys of its scene entry
    share: float  # its volume over that of the element

    @property
    def loops(self) -> tuple[tuple[int, ...], ...]:
        """Faces as loops of vertices, empty in the plane."""
        return tuple(tuple(loop) for loop in self.keys.get("faces", ()))


def loads_of(loads: dict[str, Any], assembly: Assembly, cut_up: list[list[Piece]]) -> dict[str, Any]:
    """Transfer loads to the pieces at their points; InputError for pressure on a free part with a hole."""

    def moved(entry: dict[str, Any]) -> list[dict[str, Any]]:
        between = entry.get("face", {}).get("between")
        if between is not None and len(cut_up[assembly.elements.index[between[0]]]) > 1:
            return [{**entry, "face": place} for place in _free_parts(assembly, between)]
        if "element" not in entry:
            return [entry]
        k = assembly.elements.index[entry["element"]]
        if len(cut_up[k]) == 1:
            return [entry]
        at = entry.get("at") or assembly.elements.centroid[k].tolist()
        held = _holding(cut_up[k], np.array(at), tolerances.ON_OUTLINE * assembly.size)
        more: dict[str, Any] = {}
        for key in ("force", "moment"):
            if key in entry:
                more[key] = (np.array(entry[key]) / len(held)).tolist()
        if "force" in more:
            more["at"] = at
        return [{**entry, "element": f"{entry['element']}.{number}", **more} for number in held]

    def moved_all(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [one for entry in entries for one in moved(entry)]

    found: dict[str, Any] = {key: moved_all(loads[key]) for key in ("live", "dead") if key in loads}
    found |= {key: loads[key] for key in ("moving", "pushes") if key in loads}
    if "cases" in loads:
        found["cases"] = [
            {**case, **{key: moved_all(case[key]) for key in ("live", "dead") if key in case}}
            for case in loads["cases"]
        ]
    return found


def _free_parts(assembly: Assembly, between: list[str]) -> list[dict[str, Any]]:
    """Return the free parts of an element's boundary as values of "face"; between: its id and "outside"."""
    boundary = Boundary(assembly.elements, assembly.interfaces, 1.0)
    parts = boundary.loads([FaceLoad(face=FacePlace(between=between), pressure=1.0)], "loads")
    if any(len(one.rings) > 1 for one in parts.tractions):
        raise InputError(
            "loads",
            f"a pressure acts on a free face of {between[0]!r} with a hole, and the element is split",
            '"patch" with polygons without holes',
        )
    key = "along" if assembly.dimension == 2 else "patch"
    return [{key: one.rings[0].tolist()} for one in parts.tractions]


def members_of(members: list[dict[str, Any]], assembly: Assembly, cut_up: list[list[Piece]]) -> list[dict[str, Any]]:
    """Transfer members to the pieces that contain their points, which share them; InputError for too many shares."""
    # A pin without length is shared by the pieces that touch along the face that it crosses.
    reach = tolerances.ON_OUTLINE * assembly.size

    def on_pieces(anchor: dict[str, Any]) -> list[dict[str, Any]]:
        parts = cut_up[assembly.elements.index[anchor["element"]]]
        held = _holding(parts, np.array(anchor["at"]), reach)
        return [{**anchor, "element": f"{anchor['element']}.{k}"} for k in held] if len(parts) > 1 else [anchor]

    found = []
    for position, member in enumerate(members):
        anchors = [member["from"], *member.get("through", []), member["to"]]
        places = [on_pieces(anchor) for anchor in anchors]
        count = math.prod(map(len, places))
        if count > _MOST_SHARES:
            problem = f"its points lie at common corners of cells, which share it in {count} ways"
            raise InputError(f"members[{position}]", problem, "points inside cells, or another size of cells")
        ways = list(itertools.product(*places))
        if count > 1 and math.dist(anchors[0]["at"], anchors[-1]["at"]) <= reach and len(anchors) == 2:
            touching = _beside_face(assembly, cut_up, anchors, reach)
            ways = [way for way in ways if (way[0]["element"], way[1]["element"]) in touching]
        name = member.get("name") or f"{member['kind']} {position + 1}"
        for number, (start, *through, end) in enumerate(ways):
            one = {**member, "name": name, "from": start, "to": end}
            if through:
                one["through"] = through
            if len(ways) > 1:
                one |= {"name": f"{name} ({number + 1} of {len(ways)})"}
                one |= {key: _share(member[key], len(ways), position, key) for key in _CAPACITIES if key in member}
            found.append(one)
    return found


def _share(value: Any, count: int, position: int, key: str) -> Any:
    """Return a capacity over a count; a dict has a nominal and a low value."""
    if not isinstance(value, dict):
        return value / count
    if "mean" in value:
        problem = "it is uncertain, and cells with a common corner would share it"
        raise InputError(f"members[{position}].{key}", problem, "points inside cells, or a number")
    return {name: number / count for name, number in value.items()}


def _beside_face(
    assembly: Assembly, cut_up: list[list[Piece]], anchors: list[dict[str, Any]], reach: float
) -> set[tuple[str, str]]:
    """Return the pairs of pieces of two elements that touch around the common point of two anchors."""
    elements, faces, at = assembly.elements, assembly.interfaces, np.array(anchors[0]["at"])
    one, two = (elements.index[anchor["element"]] for anchor in anchors)
    between = np.flatnonzero(
        (np.minimum(faces.a, faces.b) == min(one, two)) & (np.maximum(faces.a, faces.b) == max(one, two))
    )
    found: set[tuple[str, str]] = set()
    for face in between.tolist():
        if assembly.dimension == 2:
            around = np.array([faces.e1[face], -faces.e1[face]])
        else:
            angle = 0.13 + np.arange(12) * np.pi / 6.0
            around = np.cos(angle)[:, None] * faces.e1[face] + np.sin(angle)[:, None] * faces.e2[face]
        for point in at + 50.0 * reach * around:
            if distance_from_face(faces, face, point) > reach:
                continue
            pair = []
            for k in (one, two):
                held = _holding(cut_up[k], point, reach)
                pair += [elements.ids[k] + (f".{held[0]}" if len(cut_up[k]) > 1 else "")] if len(held) == 1 else []
            if len(pair) == 2:
                found.add((pair[0], pair[1]))
    return found


def _holding(parts: list[Piece], at: Floats, reach: float) -> list[int]:
    """Return the indices of the pieces that hold a point (d,), or else are nearest to it, within `reach`."""
    away = np.array(
        [distance_to(np.array(part.keys.get("polygon", part.keys.get("vertices"))), part.loops, at) for part in parts]
    )
    return np.flatnonzero(away <= away.min() + reach).tolist()


def _old_faces(assembly: Assembly) -> dict[tuple[str, str], list[int]]:
    """Return the indices of the faces between each pair of elements, by the sorted ids."""
    ids, faces = assembly.elements.ids, assembly.interfaces
    found: dict[tuple[str, str], list[int]] = {}
    for k, (a, b) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        found.setdefault((min(ids[a], ids[b]), max(ids[a], ids[b])), []).append(k)
    return found


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
    known = _old_faces(old)
    ids, faces = new.elements.ids, new.interfaces
    lists: dict[str, list[list[str]]] = {"inner": [], "dry": []}
    for k, (a, b) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        one, two = parent[ids[a]], parent[ids[b]]
        dry = False
        if one != two:
            candidates = known.get((min(one, two), max(one, two)), [])
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
        one, two = sorted((parent[a], parent[b]))
        by_parents.setdefault((one, two), []).append([a, b])

    def pieces_of(pairs: list[list[str]]) -> list[list[str]]:
        """Return the pairs of pieces that touch between pairs of original elements."""
        return [pair for one, two in pairs for pair in by_parents.get((min(one, two), max(one, two)), [])]

    if isinstance(search.get("candidates"), list):
        within = [pair for (one, two), pairs in by_parents.items() if one == two for pair in pairs]
        search["candidates"] = pieces_of(search["candidates"]) + within
    keep = {key: pieces_of(pairs) for key, pairs in search.get("keep", {}).items()}
    if by == "block":
        search["candidates"] = "inside-blocks"
    if by == "material":
        density = _densities(scene, old)
        across = [pairs for (a, b), pairs in by_parents.items() if not np.isclose(density[a], density[b], rtol=1e-9)]
        free = {name for name, support in zip(ids, new.elements.support, strict=True) if not support}
        kept = [pair for pairs in across for pair in pairs if free.issuperset(pair)]
        keep["dry"] = keep.get("dry", []) + [pair for pair in kept if pair not in keep.get("dry", [])]
    if any(keep.values()):
        search["keep"] = {key: pairs for key, pairs in keep.items() if pairs}
    if "except" in search:
        wanted = set(search["except"])
        search["except"] = [name for name in ids if parent[name] in wanted]
    return search


def _densities(scene: Scene, assembly: Assembly) -> dict[str, float]:
    """Compute weight over volume of each element by id; 0 for supports without weight."""
    weight = np.linalg.norm(assembly.elements.weight, axis=1)
    rate = weight / np.where(assembly.elements.volume > 0.0, assembly.elements.volume, 1.0)
    return dict(zip(assembly.elements.ids, rate.tolist(), strict=True))


KINDS: Final = ("grid", "bond", "voronoi", "radial")
"""Names of the kinds of cells of a given size; the last two are planar only."""

BY: Final = ("block", "material")
"""Names of the groups of old joints that a search must keep, for the parameter `by` of `refine`."""

SNAP: Final = 0.4
"""Largest distance, relative to a cell, to which corners of cells move: beyond it cells degenerate."""


@dataclass(frozen=True)
class CellOptions:
    cell: tuple[float, ...]
    kind: str
    centre: tuple[float, float] | None
    seed: int
    bond: str
    voussoirs: int | None
    rings: int
    courses: int
    snap: float
    own: Sequence[shapely.Polygon] | None
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
    elif grid.cell or grid.kind != "grid" or grid.own is not None:
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
    if grid.own is not None and (kind != "grid" or scene.dimension == 3):
        raise ParameterError("cells", "own cells are planar and of no kind", "a planar scene, without `kind`")
    if kind not in KINDS:
        raise ParameterError("kind", f"no cells are named {kind!r}", "one of " + ", ".join(KINDS))
    if not cell:
        raise ParameterError("cell", "missing", "the size of a cell, or `voussoirs` with their number")
    if not 1 <= len(cell) <= scene.dimension or not all(0.0 < size < float("inf") for size in cell):
        raise ParameterError(
            "cell", f"{','.join(f'{size:g}' for size in cell)} is wrong", "one size above 0 for each axis"
        )
    if grid.rings != 1 or grid.courses != 1:
        name = "rings" if grid.rings != 1 else "courses"
        raise ParameterError(name, "it goes with `voussoirs` only", "`voussoirs` with their number")
    if kind not in ("grid", "bond") and scene.dimension == 3:
        raise ParameterError("kind", f"{kind} cells are planar and the scene is spatial", "grid or bond")
    if kind == "radial" and (grid.centre is None or len(cell) != 2):
        what = "it has no centre" if grid.centre is None else "it has one size"
        raise ParameterError("kind", what, "`centre` x,y and `cell` THICKNESS,DEGREES")
