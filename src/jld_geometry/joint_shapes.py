"""Replace straight joints by shaped ones, with crack planes at the roots of teeth."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import shapely

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly, blocks_of
from jld_core.build import build_assembly
from jld_core.build.assemble import build_geometry
from jld_core.errors import InputError, ParameterError
from jld_core.scene import Scene, parse_scene
from jld_geometry.joint_profiles import Key, Shape
from jld_geometry.moved_scene import MovedScene
from jld_geometry.solid_joints import solids_with_shape
from jld_geometry.vertex_mesh import vertex_mesh

_SAME: Final = 1e-9  # area, relative to that of a tooth or an element, below which a difference is rounding

# Depth beyond the root of a tooth to which its outline is cut, relative to the face; it lies in the other element
_BEYOND: Final = 1e-3

# Height above the top of a key to which shoulders are cut, relative to the face; far below the reach of contacts
_THREAD: Final = 1e-9

_PLAIN: Final = {"elements", "polygon", "label"}  # keys of stated interfaces that say nothing about strengths


def shaped_scene(
    scene: Scene, assembly: Assembly, labels: Bits, shape: Shape, direction: Floats | None = None
) -> Scene:
    """Return a scene whose dry faces have a shape.

    Teeth are elements of their own, joined to their block by an inner face at the root. What lies beside a key is cut
    off its block by an inner face at the depth of the key. Crack planes elsewhere stay as they are.

    scene: scene; in space the elements that receive teeth are convex. labels: (m,) True = dry. shape: shape of each
    joint; the key of a face belongs to its first element. direction: (3,) in space, direction along which shapes run
    unchanged, projected on each joint; joints across it stay straight. Planar scenes take None. Result: scene with
    stated interfaces; faces between the cells of a block are inner, all others dry. Raises InputError: the scene has
    strengths or pressures of single faces or slits, a tooth does not fit into its element, or an element that receives
    one in space is not convex. Raises ParameterError: the shape is none, or the direction is missing, given in the
    plane or across all joints.
    """
    shape.check()
    assembly.members.refuse("a shape of joints")
    geometry = build_geometry(scene)
    given = any(one is not None and set(one.model_dump(exclude_defaults=True)) > _PLAIN for one in geometry.given)
    if given or scene.materials.faces:
        raise InputError("interfaces", "single faces state strengths", "strengths in materials")
    if assembly.pressed:
        raise InputError("loads", "pressure on faces does not follow the shape of joints", "point loads and body loads")
    blocks, faces, elements = blocks_of(assembly, labels), assembly.interfaces, assembly.elements
    if (labels & (blocks[faces.a] == blocks[faces.b])).any():
        raise InputError("labels", "a dry face ends inside a block", "blocks without slits")
    if assembly.dimension == 3:
        return solids_with_shape(scene, assembly, labels, shape, direction)
    if direction is not None:
        raise ParameterError("direction", "the joints of a planar scene have none", "it for scenes in space alone")
    cells = [[shapely.Polygon(outline)] for outline in elements.shape]
    for face in np.flatnonzero(labels).tolist():
        _shape_face(assembly, face, shape, cells)
    document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
    for key in ("grid", "labels", "interfaces", "move", "search"):
        document.pop(key, None)
    document["thickness"] = float(faces.l2[0]) if len(faces) else 1.0
    document["elements"], owner = [], []
    for k, entry in enumerate(geometry.entries):
        own = entry.model_dump(mode="json", exclude_defaults=True)
        area = sum(cell.area for cell in cells[k])
        for number, cell in enumerate(cells[k]):
            part = {**own, "polygon": _corners(cell)}
            if number:
                part.pop("support", None)  # what is cut off a support may break off
                part["id"] = f"{own['id']}~{number}"
            if "weight" in own:
                part["weight"] = own["weight"] * cell.area / area
            document["elements"].append(part)
            owner.append(blocks[k])
    found = parse_scene(document, "the scene with shaped joints")
    shaped, block = build_assembly(found), np.array(owner)
    own = block[shaped.interfaces.a] != block[shaped.interfaces.b]
    mesh = vertex_mesh(shaped)
    return MovedScene(found, shaped, own, mesh).at(mesh.places)


def _shape_face(assembly: Assembly, face: int, shape: Shape, cells: list[list[shapely.Polygon]]) -> None:
    """Cut each tooth of a face out of one element's cells, and add it to the other's.

    cells: polygons of each element, changed in place. For a key, the receiving block is also cut at the depth of the
    key. Raises InputError for a tooth that does not fit.
    """
    faces = assembly.interfaces
    first, last = faces.polygon[face][0], faces.polygon[face][1]
    along = last - first
    across = np.array([-along[1], along[0]])
    inside = np.asarray(shapely.Polygon(assembly.elements.shape[faces.a[face]]).representative_point().coords[0])
    if (inside - first) @ across > 0.0:  # positive teeth reach from the first element into the second
        across = -across
    for outline, side in shape.teeth():
        giver, receiver = (int(faces.a[face]), int(faces.b[face]))[:: 1 if side > 0 else -1]
        tooth = shapely.Polygon(first + outline @ np.array([along, across]))
        if shapely.union_all(cells[receiver]).intersection(tooth).area < tooth.area * (1.0 - _SAME):
            one, other = (assembly.elements.ids[k] for k in (giver, receiver))
            problem = f"a tooth of {one!r} does not fit into {other!r}"
            raise InputError("joint", problem, "a smaller depth or amplitude, or fewer joints")
        body, *others = cells[receiver]
        if isinstance(shape, Key):
            ends = np.array([[-50.0, -0.01], [51.0, -0.01], [51.0, shape.depth], [-50.0, shape.depth]])
            strip = shapely.Polygon(first + ends @ np.array([along, across]))
            others.append(body.intersection(strip))
            body = body.difference(strip)
        # a root that lies inside the receiver by rounding would leave a hole: cut a little beyond it
        start = np.array([[outline[0, 0], 0.0], [outline[0, 0], -_BEYOND * side]])
        stop = np.array([[outline[-1, 0], -_BEYOND * side], [outline[-1, 0], 0.0]])
        if isinstance(shape, Key):
            stop[:, 0] = outline[1, 0]
        root = shapely.Polygon(first + np.concatenate([start, stop]) @ np.array([along, across]))
        cutter = shapely.union_all([tooth, root])
        if isinstance(shape, Key):
            # the body ends at the top of the key; rounding there must not leave a thread between both shoulders
            top = first + outline[2:] @ np.array([along, across])
            above = first + (outline[:1:-1] + np.array([0.0, _THREAD])) @ np.array([along, across])
            cutter = shapely.union_all([cutter, shapely.Polygon(np.concatenate([top, above]))])
            kept = _pieces(body)
        else:
            kept = _pieces(body.difference(cutter))
        cells[receiver] = kept + [piece for cell in others for piece in _pieces(cell.difference(cutter))]
        cells[giver].append(tooth)


def _pieces(found: Any) -> list[shapely.Polygon]:
    """Return the polygons in a shapely geometry, without slivers due to rounding."""
    parts = [one for one in getattr(found, "geoms", [found]) if one.geom_type == "Polygon"]
    most = max((one.area for one in parts), default=0.0)
    return [one for one in parts if one.area > _SAME * most]


def _corners(cell: shapely.Polygon) -> list[list[float]]:
    """Return the corners of a polygon, counter-clockwise, without those on straight edges."""
    ring = np.array(shapely.geometry.polygon.orient(cell).exterior.coords)[:-1]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    bent = abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) > _SAME * size
    return [[float(x), float(y)] for x, y in ring[bent]]
