"""Refinement of a scene: split elements into cells and transfer loads, labels and search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError, ParameterError
from jld_core.geometry import Faces
from jld_core.geometry.unions import region_of
from jld_core.refinement.arrangement import join_small, split_by_cells
from jld_core.refinement.tessellation import MOST, convex, cut, sectors, squares, voronoi
from jld_core.scene import Scene, parse_scene

KINDS: Final = ("grid", "voronoi", "radial")
"""Names of the kinds of cells; the last two are planar only."""

BY: Final = ("block", "material")
"""Names of the groups of old joints that a search must keep, for the parameter `by` of `refine`."""

_LEAST: Final = 0.05
"""Share of a cell's area below which a piece joins its neighbour."""


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


def refine(
    scene: Scene,
    cell: tuple[float, ...],
    *,
    kind: str = "grid",
    by: str | None = None,
    centre: tuple[float, float] | None = None,
    seed: int = 0,
) -> Refined:
    """Split every free element of a scene into cells; supports stay whole.

    The scene's own labelling stays the same: inner faces join the pieces of an element, and old faces keep their
    labels. Loads act on the piece at their point of application. Weights are distributed by volume.

    Parameters
    ----------
    scene : Scene
        Scene with inner material, without stated interfaces and without "materials.faces".
    cell : tuple of float
        Sizes of a cell along the axes, length; one size suffices. "radial": ring thickness, and sector angle in
        degrees.
    kind : {"grid", "voronoi", "radial"}
        Kind of cells. "voronoi" (planar): random cells of about this size. "radial" (planar): sectors of rings.
    by : {"block", "material"} or None
        Old joints that a search must keep. "block": all faces between old blocks keep their label. "material": faces
        between elements of different density stay dry. None: no joints are kept.
    centre : (float, float), optional
        Centre of radial cells.
    seed : int
        Seed of the random numbers for Voronoi cells.

    Returns
    -------
    Refined
        Scene of the pieces, and the original element of each.

    Raises
    ------
    InputError
        Sizes or kinds do not fit the scene, an element cannot be cut, or the inner material is missing.
    """
    _check(scene, cell, kind, by, centre)
    assembly = build_assembly(scene)
    cut_up = _planar(assembly, cell, kind, centre, seed) if assembly.dimension == 2 else _spatial(assembly, cell)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    entries, parent, notes = _elements(scene, assembly, cut_up)
    thickness = scene.grid.thickness if scene.grid is not None else scene.thickness
    for key in ("grid", "elements", "labels"):
        document.pop(key, None)
    if assembly.dimension == 2 and thickness is not None:
        document["thickness"] = thickness
    document |= {"elements": entries, "loads": _loads(document["loads"], assembly, cut_up)}
    if scene.members:
        document["members"] = [_anchored(one, assembly, cut_up) for one in document["members"]]
    search = document.pop("search", {})
    bare = build_assembly(parse_scene(document, scene.name))
    document["labels"] = _labels(assembly, bare, parent)
    document["search"] = _search(search, scene, assembly, bare, parent, by)
    return Refined(parse_scene(document, scene.name), parent, tuple(notes))


def _check(scene: Scene, cell: tuple[float, ...], kind: str, by: str | None, centre: Any) -> None:
    """Raise InputError for arguments that do not fit the scene."""
    if kind not in KINDS:
        raise ParameterError("kind", f"no cells are named {kind!r}", "one of " + ", ".join(KINDS))
    if by is not None and by not in BY:
        raise ParameterError("by", f"{by!r} is unknown", "one of " + ", ".join(BY))
    if not 1 <= len(cell) <= scene.dimension or not all(0.0 < size < float("inf") for size in cell):
        raise ParameterError(
            "cell", f"{','.join(f'{size:g}' for size in cell)} is wrong", "one size above 0 for each axis"
        )
    if kind != "grid" and scene.dimension == 3:
        raise ParameterError("kind", f"{kind} cells are planar and the scene is spatial", "grid")
    if kind == "radial" and (centre is None or len(cell) != 2):
        what = "it has no centre" if centre is None else "it has one size"
        raise ParameterError("kind", what, "`centre` x,y and `cell` THICKNESS,DEGREES")
    if centre is not None and not np.isfinite(centre).all():
        raise ParameterError("centre", f"{centre[0]:g},{centre[1]:g} is no point", "x,y")
    if scene.interfaces is not None:
        raise InputError("interfaces", "they are given by hand", "a scene whose interfaces are found")
    if scene.materials.faces:
        raise InputError("materials.faces", "they name elements that are split", "a scene without them")
    if scene.materials.inner is None:
        raise InputError("materials.inner", "missing, and cells are joined by inner faces", "strengths of the material")


@dataclass(frozen=True)
class _Piece:
    """Part of an element: geometry keys of the scene, share of the volume, and shape."""

    keys: dict[str, Any]
    share: float
    shape: Any


def _planar(
    assembly: Assembly, cell: tuple[float, ...], kind: str, centre: tuple[float, float] | None, seed: int
) -> list[list[_Piece]]:
    """Cut all free planar elements into pieces."""
    elements = assembly.elements
    free = elements.free
    lower, upper = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    sizes = (cell[0], cell[-1])
    outlines = [shapely.Polygon(shape) for shape in elements.shape]
    least = _LEAST * sizes[0] * sizes[1]
    if kind == "radial":
        if centre is None:
            raise ValueError("radial cells need a centre")
        cells = sectors(lower, upper, sizes, centre)
        least = _LEAST * sizes[0] ** 2
    elif kind == "voronoi":
        cells = voronoi(shapely.union_all([outlines[k] for k in free]), sizes, seed)
    else:
        cells = squares(lower, upper, sizes)
    shapes = [elements.shape[k] for k in free]
    fixed = [elements.shape[k] for k in np.flatnonzero(elements.support)]
    split = split_by_cells([elements.ids[k] for k in free], shapes, fixed, cells, min(sizes[0], _width(kind, sizes)))
    found = [[_Piece({"polygon": shape.tolist()}, 1.0, outlines[k])] for k, shape in enumerate(elements.shape)]
    for k, parts in zip(free.tolist(), split, strict=True):
        outline = outlines[k]
        parts = join_small(parts, min(least, 0.2 * outline.area))
        if len(parts) > 1:
            found[k] = [
                _Piece({"polygon": region_of(part).shell.tolist()}, part.area / outline.area, part) for part in parts
            ]
    return found


def _width(kind: str, sizes: tuple[float, float]) -> float:
    """Return the second cell size that is a length.

    Of radial cells this is the ring thickness, because their second size is an angle.
    """
    return sizes[0] if kind == "radial" else sizes[1]


def _spatial(assembly: Assembly, cell: tuple[float, ...]) -> list[list[_Piece]]:
    """Cut all free spatial elements into pieces by planes along the axes."""
    elements = assembly.elements
    sizes = (cell[0], cell[min(1, len(cell) - 1)], cell[-1])
    lower = elements.lower[elements.free].min(axis=0)
    upper = elements.upper[elements.free].max(axis=0)
    counts = [int(np.ceil((upper[axis] - lower[axis]) / sizes[axis] - 1e-9)) for axis in range(3)]
    if np.prod(np.array(counts, dtype=float)) > MOST:
        raise ParameterError(
            "cell", f"that makes {np.prod(np.array(counts, dtype=float)):.3g} cells", f"at most {MOST}"
        )
    planes = [(np.eye(3)[axis], lower[axis] + sizes[axis] * np.arange(1, counts[axis])) for axis in range(3)]
    found = []
    for k, (vertices, faces) in enumerate(zip(elements.shape, elements.faces, strict=True)):
        whole: list[tuple[Floats, Faces]] = [(vertices, faces)]
        if not elements.support[k]:
            for normal, offsets in planes:
                along = vertices @ normal
                inside = offsets[(offsets > along.min()) & (offsets < along.max())]
                if len(inside) and not convex(vertices, faces):
                    raise InputError(f"element {elements.ids[k]!r}", "it is not convex", "convex spatial elements")
                for offset in inside.tolist():
                    whole = [half for part in whole for half in cut(*part, normal, offset)]
        volumes = np.array([_volume(*part) for part in whole])
        found.append(
            [
                _Piece({"vertices": v.tolist(), "faces": [list(loop) for loop in f]}, float(share), v)
                for (v, f), share in zip(whole, volumes / volumes.sum(), strict=True)
            ]
        )
    return found


def _volume(vertices: Floats, faces: Faces) -> float:
    """Compute the volume of a polyhedron."""
    total = 0.0
    for loop in faces:
        corners = vertices[list(loop)] - vertices[0]
        total += float(
            np.einsum("ij,ij->i", np.cross(corners[1:-1], corners[2:]), corners[[0] * (len(loop) - 2)]).sum()
        )
    return abs(total) / 6.0


def _elements(
    scene: Scene, assembly: Assembly, cut_up: list[list[_Piece]]
) -> tuple[list[dict[str, Any]], dict[str, str], list[str]]:
    """Return scene entries of all pieces, the original element of each, and notes."""
    elements = assembly.elements
    given = {e.id: e.model_dump(mode="json", exclude_defaults=True) for e in scene.elements or []}
    entries, parent = [], {}
    moved = 0
    for k, parts in enumerate(cut_up):
        name = elements.ids[k]
        old = given.get(name, {})
        for number, part in enumerate(parts):
            fresh = name if len(parts) == 1 else f"{name}.{number}"
            keys: dict[str, Any] = {key: old[key] for key in ("density",) if key in old}
            for key in ("weight", "volume"):
                if key in old:
                    keys[key] = old[key] * part.share
            if "centroid" in old and len(parts) == 1:
                keys["centroid"] = old["centroid"]
            if elements.support[k]:
                keys["support"] = True
                if elements.blocks[k] is not None:
                    keys["block"] = elements.blocks[k]
            else:
                keys["block"] = elements.blocks[k] if elements.blocks[k] is not None else name
            entries.append({"id": fresh, **part.keys, **keys})
            parent[fresh] = name
        moved += "centroid" in old and len(parts) > 1
    notes = [f"{moved} given centroids are gone: pieces have those of their outlines"] if moved else []
    taken = [entry["id"] for entry in entries]
    if len(set(taken)) < len(taken):
        twice = next(name for name in taken if taken.count(name) > 1)
        raise InputError(f"element {twice!r}", "a piece would have the name of another element", "other ids")
    return entries, parent, notes


def _loads(loads: dict[str, Any], assembly: Assembly, cut_up: list[list[_Piece]]) -> dict[str, Any]:
    """Transfer loads on elements to the pieces at their points of application."""

    def moved(entry: dict[str, Any]) -> dict[str, Any]:
        """Return a load entry that refers to a piece."""
        if "element" not in entry:
            return entry
        k = assembly.elements.index[entry["element"]]
        if len(cut_up[k]) == 1:
            return entry
        at = entry.get("at") or assembly.elements.centroid[k].tolist()
        number = _nearest(cut_up[k], np.array(at))
        more = {"at": at} if entry.get("force") is not None else {}
        return {**entry, "element": f"{entry['element']}.{number}", **more}

    found: dict[str, Any] = {key: [moved(entry) for entry in loads[key]] for key in ("live", "dead") if key in loads}
    if "cases" in loads:
        found["cases"] = [
            {**case, **{key: [moved(e) for e in case[key]] for key in ("live", "dead") if key in case}}
            for case in loads["cases"]
        ]
    return found


def _anchored(member: dict[str, Any], assembly: Assembly, cut_up: list[list[_Piece]]) -> dict[str, Any]:
    """Return a member that holds on to the pieces of its elements at its points."""

    def moved(anchor: dict[str, Any]) -> dict[str, Any]:
        """Return an anchor that refers to a piece."""
        k = assembly.elements.index[anchor["element"]]
        if len(cut_up[k]) == 1:
            return anchor
        return {**anchor, "element": f"{anchor['element']}.{_nearest(cut_up[k], np.array(anchor['at']))}"}

    ends = {key: moved(member[key]) for key in ("from", "to")}
    through = {"through": [moved(one) for one in member["through"]]} if "through" in member else {}
    return {**member, **ends, **through}


def _nearest(parts: list[_Piece], at: Floats) -> int:
    """Return the piece that contains a place, or is nearest to it."""
    if len(at) == 2:
        away = [part.shape.distance(shapely.Point(at)) for part in parts]
        return int(np.argmin(np.round(away, 12)))
    low = np.array([part.shape.min(axis=0) for part in parts])
    high = np.array([part.shape.max(axis=0) for part in parts])
    outside = np.linalg.norm(np.maximum(0.0, np.maximum(low - at, at - high)), axis=1)
    middle = np.linalg.norm(0.5 * (low + high) - at, axis=1)
    return int(np.lexsort((middle, np.round(outside, 12)))[0])


def _old_faces(assembly: Assembly) -> dict[tuple[str, str], list[int]]:
    """Return the faces between each pair of elements, by the sorted ids."""
    ids, faces = assembly.elements.ids, assembly.interfaces
    found: dict[tuple[str, str], list[int]] = {}
    for k, (a, b) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        found.setdefault((min(ids[a], ids[b]), max(ids[a], ids[b])), []).append(k)
    return found


def _labels(old: Assembly, new: Assembly, parent: dict[str, str]) -> dict[str, list[list[str]]]:
    """Return the pairs of pieces to label "inner" and "dry", so that faces keep their labels.

    New faces within one element are inner. Pairs that the new scene labels so already are left out.
    """
    known = _old_faces(old)
    ids, faces = new.elements.ids, new.interfaces
    lists: dict[str, list[list[str]]] = {"inner": [], "dry": []}
    for k, (a, b) in enumerate(zip(faces.a.tolist(), faces.b.tolist(), strict=True)):
        one, two = parent[ids[a]], parent[ids[b]]
        dry = False
        if one != two:
            candidates = known.get((min(one, two), max(one, two)), [])
            away = [float(np.linalg.norm(old.interfaces.origin[j] - faces.origin[k])) for j in candidates]
            dry = bool(old.labels[candidates[int(np.argmin(away))]]) if candidates else True
        if dry != bool(new.labels[k]):
            lists["dry" if dry else "inner"].append([ids[a], ids[b]])
    return {key: pairs for key, pairs in lists.items() if pairs}


def _search(
    search: dict[str, Any], scene: Scene, old: Assembly, new: Assembly, parent: dict[str, str], by: str | None
) -> dict[str, Any]:
    """Transfer the search to the pieces, and keep old joints as `by` requires."""
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
