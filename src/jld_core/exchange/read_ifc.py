"""Reader of IFC (by ifcopenshell): faceted B-reps, face sets and extruded areas with straight edges as solids."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.drawn import MOST
from jld_core.exchange.libraries import library, parsing, readable
from jld_core.exchange.options import ImportOptions, Notes, several
from jld_core.exchange.solids import Part, Solids
from jld_core.geometry import Faces
from jld_core.geometry.unions import extrude, union_outlines
from jld_core.scene.units import METRES

_BODY: Final = ("Body", "Facetation")
"""Identifiers of the representations that are read."""


def read_ifc(path: Path, options: ImportOptions, notes: Notes) -> Solids:
    """Read the solids of the products of an IFC file, in metres.

    options: layers. The name of a layer of a product, its object type, its class or its name says what it is, the first
    one with a role. notes: receives what was found and skipped. Raises InputError where the file is no IFC,
    ifcopenshell is missing, or a product has a shape that is no polyhedron.
    """
    ifc = library("ifcopenshell", path)
    readable(path)
    with parsing("IFC", "an IFC file"):
        model = ifc.open(str(path))
        products = [p for p in model.by_type("IfcProduct") if getattr(p, "Representation", None) is not None]
        if len(products) > MOST:
            raise InputError("", f"it has {len(products)} products", f"at most {MOST}")
        scale = float(import_module("ifcopenshell.util.unit").calculate_unit_scale(model))
        placed = import_module("ifcopenshell.util.placement").get_local_placement
        parts: list[Part] = []
        empty = 0
        for product in products:
            if product.is_a("IfcOpeningElement") or product.is_a("IfcSpatialElement"):
                empty += 1
                continue
            title = f"{product.is_a()} {product.Name or product.GlobalId!r}"
            matrix = np.array(placed(product.ObjectPlacement)) if product.ObjectPlacement is not None else np.eye(4)
            shapes = [s for s in product.Representation.Representations if s.RepresentationIdentifier in _BODY]
            solids = [solid for shape in shapes for item in shape.Items for solid in _solids(item, title)]
            if not solids:
                empty += 1
            group = _group(product, options)
            for number, (points, faces) in enumerate(solids, 1):
                name = str(product.Name or product.GlobalId)
                own = name if len(solids) == 1 else f"{name}.{number}"
                parts.append(Part(own, group, scale * _moved(points, matrix), faces))
    notes.found.append(f"{several(len(parts), 'solid')} of {several(len(products) - empty, 'product')}")
    notes.skip("products", empty, "spaces, openings, or no body")
    unit = next((name for name, size in METRES.items() if abs(size - scale) <= 1e-9 * size), f"{scale:g} m")
    if unit != "m":
        notes.found.append(f"lengths in {unit}, made m")
    return Solids(parts, name=path.stem, unit="m")


def _group(product: Any, options: ImportOptions) -> str:
    """Return the first of layer, object type, class and name with a role, else the class.

    product: IFC product. options: state which names have a role.
    """
    layers = [
        str(layer.Name)
        for shape in product.Representation.Representations
        for layer in getattr(shape, "LayerAssignments", ())
    ]
    names = [*layers, str(getattr(product, "ObjectType", None) or ""), str(product.is_a()), str(product.Name or "")]
    return next((name for name in names if name and options.role(name)), str(product.is_a()))


def _moved(points: Floats, matrix: Floats) -> Floats:
    """Return points (k, 3) transformed by a (4, 4) matrix."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _refused(item: Any, title: str) -> InputError:
    """Return the error for a shape that is not read."""
    return InputError(
        title, f"its shape is {item.is_a()}", "faceted B-reps, face sets, or extruded areas of straight edges"
    )


def _solids(item: Any, title: str) -> list[tuple[Floats, Faces]]:
    """Read the solids of a representation item as vertices (k, 3) and faces.

    Raises InputError for an item of another kind; title: words for the product in messages.
    """
    if item.is_a("IfcMappedItem"):
        operator = item.MappingTarget
        matrix = np.array(import_module("ifcopenshell.util.placement").get_cartesiantransformationoperator3d(operator))
        origin = _frame(item.MappingSource.MappingOrigin)
        inner = [solid for part in item.MappingSource.MappedRepresentation.Items for solid in _solids(part, title)]
        return [(_moved(points, matrix @ origin), faces) for points, faces in inner]
    if item.is_a("IfcFacetedBrep"):
        return [_of_faces(item.Outer.CfsFaces, title)]
    if item.is_a("IfcPolygonalFaceSet") or item.is_a("IfcTriangulatedFaceSet"):
        return [_of_face_set(item, title)]
    if item.is_a("IfcExtrudedAreaSolid"):
        return [_extruded(item, title)]
    raise _refused(item, title)


def _of_faces(faces: Any, title: str) -> tuple[Floats, Faces]:
    """Convert the faces of a closed shell to vertices (k, 3) and loops of vertex indices.

    Raises InputError for a face with a hole; title: words for the product.
    """
    number: dict[tuple[float, ...], int] = {}
    loops = []
    for face in faces:
        if len(face.Bounds) != 1:
            raise InputError(title, "it has a face with a hole", "faces without holes")
        bound = face.Bounds[0]
        corners = [tuple(float(x) for x in point.Coordinates) for point in bound.Bound.Polygon]
        loop = tuple(number.setdefault(corner, len(number)) for corner in corners)
        loops.append(loop if bound.Orientation else loop[::-1])
    return np.array(list(number)).reshape(-1, 3), tuple(loops)


def _of_face_set(item: Any, title: str) -> tuple[Floats, Faces]:
    """Convert a tessellated shape to vertices (k, 3) and loops of vertex indices.

    Raises InputError for a face with a hole; title: words for the product.
    """
    points = np.array(item.Coordinates.CoordList, dtype=float)
    if item.is_a("IfcTriangulatedFaceSet"):
        return points, tuple(tuple(int(k) - 1 for k in loop) for loop in item.CoordIndex)
    if any(face.is_a("IfcIndexedPolygonalFaceWithVoids") for face in item.Faces):
        raise InputError(title, "it has a face with a hole", "faces without holes")
    return points, tuple(tuple(int(k) - 1 for k in face.CoordIndex) for face in item.Faces)


def _extruded(item: Any, title: str) -> tuple[Floats, Faces]:
    """Return vertices and faces of an extruded area."""
    outline = _outline(item.SweptArea, title)
    along = np.array([float(x) for x in item.ExtrudedDirection.DirectionRatios])
    along *= float(item.Depth) / float(np.linalg.norm(along))
    surface = extrude(union_outlines([outline])[0], 1.0)
    # the prism lies in x–z with unit depth along y: its section becomes x–y, its depth the direction
    points = np.column_stack([surface.points[:, 0], surface.points[:, 2], np.zeros(len(surface.points))])
    points = points + surface.points[:, 1:2] * along
    frame = np.eye(4) if item.Position is None else _frame(item.Position)
    return _moved(points, frame), surface.faces


def _frame(placement: Any) -> Floats:
    """Return the (4, 4) matrix of an axis placement."""
    return np.array(import_module("ifcopenshell.util.placement").get_axis2placement(placement))


def _outline(profile: Any, title: str) -> Floats:
    """Return the corners (k, 2) of a profile with straight edges and without holes."""
    if profile.is_a("IfcRectangleProfileDef") and not profile.is_a("IfcRoundedRectangleProfileDef"):
        x, y = 0.5 * float(profile.XDim), 0.5 * float(profile.YDim)
        corners = np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
        if profile.Position is None:
            return corners
        frame = _frame(profile.Position)
        return np.asarray(corners @ frame[:2, :2].T + frame[:2, 3])
    if not profile.is_a("IfcArbitraryClosedProfileDef") or profile.is_a("IfcArbitraryProfileDefWithVoids"):
        raise _refused(profile, title)
    curve = profile.OuterCurve
    if curve.is_a("IfcPolyline"):
        corners = np.array([[float(x) for x in point.Coordinates[:2]] for point in curve.Points])
    elif curve.is_a("IfcIndexedPolyCurve") and not any(s.is_a("IfcArcIndex") for s in curve.Segments or ()):
        corners = np.array(curve.Points.CoordList, dtype=float)[:, :2]
    else:
        raise _refused(curve, title)
    return corners[:-1] if np.allclose(corners[0], corners[-1]) else corners
