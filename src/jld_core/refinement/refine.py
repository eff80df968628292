"""Refinement of a scene: split elements into cells and transfer loads, labels and search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely

from jld_core import plugins
from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, faces_of
from jld_core.build import build_robust, cases_of_scene
from jld_core.build.assemble import build_assembly
from jld_core.build.materials import direction_of_weight
from jld_core.errors import InputError, ParameterError
from jld_core.geometry import Faces
from jld_core.geometry.unions import region_of, union_outlines
from jld_core.parameters import typed
from jld_core.refinement.arrangement import (
    MOST,
    convex,
    cut,
    join_small,
    split_by_cells,
    squares,
)
from jld_core.refinement.transfer import (
    CellOptions,
    Piece,
    check_options,
    face_of_piece,
    labels_of,
    loads_of,
    members_of,
    search_of,
)
from jld_core.scene.reading import parse_scene
from jld_core.scene.schema import Scene
from jld_core.scene.uncertain import Uncertain

_LEAST: Final = 0.05  # share of a cell's area below which a piece joins its neighbour


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
    if cells is not None and not (len(cells) and all(isinstance(one, shapely.Polygon) for one in cells)):
        raise ParameterError("cells", "they are wrong", "a list of polygons")
    grid = CellOptions(cell, kind, centre, seed, bond, voussoirs, rings, courses, snap, cells, skew, lintel, bearing)
    check_options(scene, grid, by)
    assembly = build_assembly(scene)
    down = direction_of_weight(scene)
    cut_up = _planar(assembly, grid, down) if assembly.dimension == 2 else _spatial(assembly, grid, down)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    entries, parent, notes = _elements(scene, assembly, cut_up)
    thickness = scene.grid.thickness if scene.grid is not None else scene.thickness
    for key in ("grid", "elements", "labels"):
        document.pop(key, None)
    if assembly.dimension == 2 and thickness is not None:
        document["thickness"] = thickness
    document |= {"elements": entries, "loads": loads_of(document["loads"], assembly, cut_up)}
    if scene.members:
        document["members"] = members_of(document["members"], assembly, cut_up)
    search = document.pop("search", {})
    bare = faces_of(build_assembly(parse_scene(document, scene.name)))
    document["labels"] = labels_of(assembly, bare, parent)
    document["search"] = search_of(search, scene, assembly, bare, parent, by)
    return Refined(parse_scene(document, scene.name), parent, tuple(notes))


def _planar(assembly: Assembly, grid: CellOptions, down: Floats) -> list[list[Piece]]:
    """Cut all free planar elements into pieces; `down`: (2,) direction of weight."""
    elements = assembly.elements
    free = elements.free
    outlines = [shapely.Polygon(shape) for shape in elements.shape]
    cells, size, least = _cells(assembly, outlines, grid, down)
    shapes = [elements.shape[k] for k in free]
    fixed = [elements.shape[k] for k in np.flatnonzero(elements.support)]
    split = split_by_cells([elements.ids[k] for k in free], shapes, fixed, cells, size, grid.snap)
    found = [[Piece({"polygon": shape.tolist()}, 1.0)] for shape in elements.shape]
    for k, parts in zip(free.tolist(), split, strict=True):
        outline = outlines[k]
        parts = join_small(parts, min(least, 0.2 * outline.area))
        if len(parts) > 1:
            found[k] = [Piece({"polygon": region_of(part).shell.tolist()}, part.area / outline.area) for part in parts]
    return found


def _cells(
    assembly: Assembly, outlines: list[shapely.Polygon], grid: CellOptions, down: Floats
) -> tuple[list[shapely.Polygon], float, float]:
    """Return the cells, their shortest side, and the least area of a piece, below which it joins a neighbour."""
    elements, free = assembly.elements, assembly.elements.free
    if grid.voussoirs is not None:
        shapes = [elements.shape[k] for k in free]
        whole = shapely.MultiPolygon([shapely.Polygon(r.shell, r.holes) for r in union_outlines(shapes)])
        found = plugins.part("masonry").voussoirs.voussoir_cells(
            whole, down, grid.voussoirs, grid.rings, grid.centre, grid.skew
        )
        return found.cells, min(found.width, found.depth), _LEAST * found.width * found.depth
    lower, upper = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    sizes = (grid.cell[0], grid.cell[-1])
    if grid.own is not None:
        return list(grid.own), min(sizes), _LEAST * sizes[0] * sizes[1]
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
    parts = _cut_of(assembly, grid, down)
    found = []
    for k, (vertices, faces) in enumerate(zip(elements.shape, elements.faces, strict=True)):
        whole = [(vertices, faces)] if elements.support[k] else parts(k)
        volumes = np.array([_volume(*part) for part in whole])
        found.append(
            [
                Piece({"vertices": v.tolist(), "faces": [list(loop) for loop in f]}, float(share))
                for (v, f), share in zip(whole, volumes / volumes.sum(), strict=True)
            ]
        )
    return found


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
    if np.prod(np.array(counts, dtype=float)) > MOST:
        raise ParameterError(
            "cell", f"that makes {np.prod(np.array(counts, dtype=float)):.3g} cells", f"at most {MOST}"
        )
    planes = [(np.eye(3)[axis], lower[axis] + sizes[axis] * np.arange(1, counts[axis])) for axis in range(3)]

    def parts(k: int) -> list[tuple[Floats, Faces]]:
        vertices, faces = elements.shape[k], elements.faces[k]
        whole: list[tuple[Floats, Faces]] = [(vertices, faces)]
        for normal, offsets in planes:
            along = vertices @ normal
            inside = offsets[(offsets > along.min()) & (offsets < along.max())]
            if len(inside) and not convex(vertices, faces):
                raise InputError(f"element {elements.ids[k]!r}", "it is not convex", "convex spatial elements")
            for offset in inside.tolist():
                whole = [half for part in whole for half in cut(*part, normal, offset)]
        return whole

    return parts


def _volume(vertices: Floats, faces: Faces) -> float:
    total = 0.0
    for loop in faces:
        corners = vertices[list(loop)] - vertices[0]
        total += float(
            np.einsum("ij,ij->i", np.cross(corners[1:-1], corners[2:]), corners[[0] * (len(loop) - 2)]).sum()
        )
    return abs(total) / 6.0


def _elements(
    scene: Scene, assembly: Assembly, cut_up: list[list[Piece]]
) -> tuple[list[dict[str, Any]], dict[str, str], list[str]]:
    """Write the scene entries of all pieces, with original elements and notes; InputError for an id taken."""
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
    placed = cases_of_scene(scene, assembly.elements) if scene.loads.moving else []
    if placed:
        stated = {"cases": [one.case for one in placed], "moving": None, "pushes": None}
        scene = scene.model_copy(update={"loads": scene.loads.model_copy(update=stated)})
    try:
        refined = refine(_at_means(scene), (cell,))
    except InputError as error:
        where = "cracks" if error.where.startswith("--cell") else error.where
        raise InputError(where, error.problem, error.expected) from None
    if len(refined.parent) == len(assembly.elements):
        return CrackCells(assembly, np.arange(len(assembly.interfaces)))
    plain = refined.scene.model_copy(update={"cracks": "faces"})
    fine = build_robust(plain) if assembly.has_low_values else build_assembly(plain)
    places = [one.place for one in placed] or [None] * len(fine.cases)
    cases = tuple(replace(one, place=place) for one, place in zip(fine.cases, places, strict=True))
    return CrackCells(replace(fine, cases=cases), joint_faces(assembly, fine, refined.parent))


def _at_means(scene: Scene) -> Scene:
    """Return a scene with mean capacities of members: pieces share a number, not a distribution."""
    means = [
        {key: float(value) for key, value in vars(member).items() if isinstance(value, Uncertain)}
        for member in scene.members
    ]
    members = [member.model_copy(update=one) for member, one in zip(scene.members, means, strict=True)]
    return scene.model_copy(update={"members": members}) if any(means) else scene


def cells_of(assembly: Assembly, cell: float) -> CrackCells:
    """Split elements into cells under the assembly's loads, with joint faces; InputError if changed since built."""
    if assembly.scene is None:
        raise InputError("cracks", "cells are cut from a scene, and this assembly has none", "the scene itself")
    whole = (build_robust if assembly.has_low_values else build_assembly)(assembly.scene)
    for place, one in ((None, whole), *enumerate(whole.by_case)):
        if len(one.cases) == len(assembly.cases) and _same(one, assembly):
            found = crack_cells(assembly.scene, assembly, cell)
            return found if place is None or found.fine is assembly else replace(found, fine=found.fine.by_case[place])
    raise InputError(
        "cracks",
        "cells are cut from a scene, and this assembly was changed since it was built of it",
        "a changed scene",
    )


def _same(one: Assembly, other: Assembly) -> bool:
    """Return True if two assemblies have the same elements, loads and strengths."""
    pairs = [(one.face_strengths.table(), other.face_strengths.table())]
    for a, b in ((one, other), *zip(one.by_case, other.by_case, strict=True)):
        pairs += [(a.dead, b.dead), (a.live, b.live)]
    alike = one.elements.ids == other.elements.ids
    return alike and all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def joint_faces(joints: Assembly, fine: Assembly, parent: dict[str, str]) -> Ints:
    """Map each face of the cells to its joint-grid face (M,), −1 inside; InputError where elements do not touch."""
    element = np.array([joints.elements.index[parent[name]] for name in fine.elements.ids])
    between: dict[tuple[int, int], list[int]] = {}
    for face, pair in enumerate(zip(joints.interfaces.a.tolist(), joints.interfaces.b.tolist(), strict=True)):
        between.setdefault((min(pair), max(pair)), []).append(face)
    found = np.full(len(fine.interfaces), -1, dtype=np.int64)
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
        found[k] = face_of_piece(joints.interfaces, candidates, fine.interfaces, k)
    return found
