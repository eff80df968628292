"""Reader of IFC by ifcopenshell: faceted and extruded solids; by its kernel clipped and opened ones of plane faces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, InputError
from jld_core.geometry import Faces, unions
from jld_core.scene import units as scene_units
from jld_formats.cells import without_holes
from jld_formats.drawn_loads import MOST
from jld_formats.libraries import library, parsing, readable
from jld_formats.options import ImportOptions, Notes, several
from jld_formats.solids import Part, Solids, split, with_own_points

PROPERTIES: Final = "Pset_MaterialCommon"  # name of the standard property set of a material that holds its density
DENSITY: Final = "MassDensity"  # name of the density in that set
_GRAM: Final = 1e-3  # kilograms in the mass unit of IFC, the gram


class Densities:
    """Densities of products by their materials.

    model: IFC model of schema IFC2X3, IFC4 or IFC4X3.
    """

    def __init__(self, model: Any) -> None:
        self._materials_of = import_module("ifcopenshell.util.element").get_materials
        units = [unit for assignment in model.by_type("IfcUnitAssignment") for unit in assignment.Units]
        density = [unit for unit in units if getattr(unit, "UnitType", None) == "MASSDENSITYUNIT"]
        self._scale = _scale(density[0]) if density else 1.0
        self._of_material: dict[int, float] = {}
        if model.schema == "IFC2X3":
            for properties in model.by_type("IfcGeneralMaterialProperties"):
                if properties.MassDensity is not None:
                    self._of_material[properties.Material.id()] = self._scale * float(properties.MassDensity)

    def of(self, product: Any, title: str) -> float | None:
        """Return the density of a product, kg/m³; None where its materials state none, or several."""
        densities = {value for material in self._materials_of(product) for value in self._densities(material)}
        for value in densities:
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(title, f"the mass density of its material is {value:g}", "a positive number")
        return densities.pop() if len(densities) == 1 else None

    def _densities(self, material: Any) -> Iterator[float]:
        """Yield the densities of a material, kg/m³: from IFC2x3's general properties, then from property sets."""
        if material.id() in self._of_material:
            yield self._of_material[material.id()]
        for properties in getattr(material, "HasProperties", None) or ():
            for entry in getattr(properties, "Properties", None) or ():
                value = getattr(entry, "NominalValue", None)
                if entry.Name == DENSITY and value is not None:
                    yield (_scale(entry.Unit) if entry.Unit is not None else self._scale) * float(value.wrappedValue)


def _scale(unit: Any) -> float:
    """Return the size of a unit in SI units."""
    if unit.is_a("IfcDerivedUnit"):
        return float(np.prod([_scale(part.Unit) ** part.Exponent for part in unit.Elements]))
    if unit.is_a("IfcConversionBasedUnit"):
        factor = unit.ConversionFactor
        return float(factor.ValueComponent.wrappedValue) * _scale(factor.UnitComponent)
    prefix = getattr(unit, "Prefix", None)
    size = float(import_module("ifcopenshell.util.unit").get_prefix_multiplier(prefix)) if prefix else 1.0
    return size * (_GRAM if unit.Name == "GRAM" else 1.0)


# Largest number of clippings and openings of a product; the kernel's time grows with its square
_MOST_CUTS: Final = 300
_MOST_SOLIDS: Final = 20_000  # largest number of solids that mapped items unfold into
_FACETED: Final = ("IfcFacetedBrep", "IfcPolygonalFaceSet", "IfcTriangulatedFaceSet")
_FILLETS: Final = ("RoundingRadius", "InnerFilletRadius", "OuterFilletRadius")

# Kinds of shapes that have curved faces
_CURVED: Final = (
    *("IfcSphere", "IfcRightCircular", "IfcRevolved", "IfcSweptDisk", "IfcSurfaceCurveSwept", "IfcFixedReference"),
    *("IfcSectioned", "IfcDirectrix", "IfcCircleProfile", "IfcCircleHollow", "IfcEllipse", "IfcBSpline"),
    *("IfcRationalBSpline", "IfcCylindricalSurface", "IfcSphericalSurface", "IfcToroidalSurface", "IfcSurfaceOf"),
)

_BODY: Final = ("Body", "Facetation")  # identifiers of the representations that are read


def read_ifc(path: Path, options: ImportOptions, notes: Notes) -> Solids:
    """Return the solids of an IFC file, in metres."""
    ifc = library("ifcopenshell", path)
    readable(path)
    with parsing("IFC", "an IFC file"):
        notes.reached("bytes in its text", path.stat().st_size)
        model = ifc.open(str(path))
        products = [p for p in model.by_type("IfcProduct") if getattr(p, "Representation", None) is not None]
        if len(products) > MOST:
            raise InputError("", f"it has {len(products)} products", f"at most {MOST}")
        scale = float(import_module("ifcopenshell.util.unit").calculate_unit_scale(model))
        placement_of = import_module("ifcopenshell.util.placement").get_local_placement
        densities = Densities(model)
        parts: list[Part] = []
        empty = unfolded = 0
        unfolded_of: dict[int, int] = {}
        product_kinds: Counter[str] = Counter()
        for position, product in enumerate(products):
            notes.reached("products", position, len(products))
            if product.is_a("IfcOpeningElement") or product.is_a("IfcSpatialElement"):
                empty += 1
                continue
            title = f"{product.is_a()} {product.Name or product.GlobalId!r}"
            matrix = (
                np.array(placement_of(product.ObjectPlacement)) if product.ObjectPlacement is not None else np.eye(4)
            )
            items = [item for shape in _shapes(product) for item in shape.Items]
            if not items:
                empty += 1
                continue
            unfolded += sum(_count_unfolded(item, unfolded_of) for item in items)
            if unfolded > _MOST_SOLIDS:
                raise InputError(title, f"mapped items unfold into {unfolded:.3g} solids", f"at most {_MOST_SOLIDS}")
            if getattr(product, "HasOpenings", None) or not all(_is_simple(item) for item in items):
                solids = _by_kernel(product, items, title)
                product_kinds["by the geometry kernel"] += 1
                product_kinds["with arcs as chords"] += any(_arcs(item) for item in items)
            else:
                solids = [(scale * _moved(v, matrix), faces) for item in items for v, faces in _solids(item, title)]
            group = _group(product, options)
            density = densities.of(product, title)
            keys = {} if density is None else {"density": density}
            for number, (points, faces) in enumerate(solids, 1):
                name = str(product.Name or product.GlobalId)
                part_title = name if len(solids) == 1 else f"{name}.{number}"
                parts.append(Part(part_title, group, points, faces, keys=keys))
    notes.found.append(f"{several(len(parts), 'solid')} of {several(len(products) - empty, 'product')}")
    notes.found += [f"{several(count, 'product')} {how}" for how, count in product_kinds.items() if count]
    notes.skip("products", empty, "spaces, openings, or no body")
    unit = next((name for name, size in scene_units.METRES.items() if abs(size - scale) <= 1e-9 * size), f"{scale:g} m")
    if unit != "m":
        notes.found.append(f"lengths in {unit}, made m")
    return Solids(parts, name=path.stem, unit="m")


def _group(product: Any, options: ImportOptions) -> str:
    """Return the first of layer, object type, class and name with a role, else the class."""
    layers = [
        str(layer.Name)
        for shape in product.Representation.Representations
        for layer in getattr(shape, "LayerAssignments", ())
    ]
    kind = str(product.is_a())
    group = options.group(*layers, str(getattr(product, "ObjectType", None) or ""), kind, str(product.Name or ""))
    return group if options.role(group) or group == kind or options.matches("layer", group) else kind


def _moved(points: Floats, matrix: Floats) -> Floats:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _shapes(product: Any) -> list[Any]:
    return [s for s in product.Representation.Representations if s.RepresentationIdentifier in _BODY]


def _parts_of(item: Any) -> Iterator[Any]:
    """Yield an item and all that it is made of, each once."""
    visited = set()
    pending = [item]
    while pending:
        part = pending.pop()
        if part.id() and part.id() in visited:
            continue
        visited.add(part.id())
        yield part
        for value in part:
            pending += [
                nested
                for nested in _nested(value)
                if hasattr(nested, "is_a") and not nested.is_a("IfcPresentationItem")
            ]


def _nested(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple):
        for entry in value:
            yield from _nested(entry)
    else:
        yield value


def _arcs(item: Any) -> bool:
    return any(part.is_a() in ("IfcArcIndex", "IfcCircle") for part in _parts_of(item))


def _is_simple(item: Any) -> bool:
    """Return whether a solid is read here, without the geometry kernel."""
    if item.is_a("IfcMappedItem"):
        return all(_is_simple(part) for part in item.MappingSource.MappedRepresentation.Items)
    if not item.is_a("IfcExtrudedAreaSolid"):
        return bool(item.is_a() in _FACETED)
    area = item.SweptArea
    if area.is_a() in ("IfcRectangleProfileDef", "IfcRectangleHollowProfileDef"):
        return not any(getattr(area, name, None) for name in _FILLETS)
    return bool(area.is_a("IfcArbitraryClosedProfileDef")) and not any(
        part.is_a() in ("IfcArcIndex", "IfcCompositeCurve", "IfcTrimmedCurve") for part in _parts_of(area)
    )


def _by_kernel(product: Any, items: list[Any], title: str) -> list[tuple[Floats, Faces]]:
    """Return the solids of a product by the geometry kernel, with clippings and openings, in m."""
    owners = [(title, items)]
    for relation in getattr(product, "HasOpenings", None) or ():
        opening = relation.RelatedOpeningElement
        if opening.Representation is not None:
            owners.append((f"an opening of {title}", [item for shape in _shapes(opening) for item in shape.Items]))
    cuts = len(owners) - 1
    for words, items_of_owner in owners:
        for part in (part for item in items_of_owner for part in _parts_of(item)):
            cuts += part.is_a("IfcBooleanResult")
            if part.is_a().startswith(_CURVED):
                raise _refused(part, words)
    if cuts > _MOST_CUTS:
        raise InputError(title, f"it is cut {cuts} times", f"at most {_MOST_CUTS}")
    geometry = import_module("ifcopenshell.geom")
    settings = geometry.settings()
    settings.set("use-world-coords", True)
    try:
        geometry_found = geometry.create_shape(settings, product).geometry
    except RuntimeError:
        raise InputError(title, "its shape cannot be computed", "a valid solid") from None
    points = np.array(geometry_found.verts, dtype=float).reshape(-1, 3)
    if not len(points):
        raise InputError(title, "its openings leave nothing of it", "openings smaller than the product")
    triangles = [(int(a), int(b), int(c)) for a, b, c in np.array(geometry_found.faces).reshape(-1, 3)]
    owner = np.array(geometry_found.item_ids)
    solids = []
    for item in dict.fromkeys(owner.tolist()):
        faces = tuple(triangles[k] for k in np.flatnonzero(owner == item).tolist())
        for part in split(points, faces, 1e-9 * float(np.ptp(points, axis=0).max())):
            solids.append(with_own_points(points, (faces[k] for k in part.tolist())))
    return solids


def _refused(item: Any, title: str) -> InputError:
    expected = "plane faces: faceted or extruded solids, clipped by planes or solids"
    return InputError(title, f"its shape is {item.is_a()}", expected)


def _count_unfolded(item: Any, counts: dict[int, int]) -> int:
    """Return the number of solids that an item unfolds into, by its mapped items."""
    if not item.is_a("IfcMappedItem"):
        return 1
    if item.id() not in counts:
        parts = item.MappingSource.MappedRepresentation.Items
        counts[item.id()] = sum(_count_unfolded(part, counts) for part in parts)
    return counts[item.id()]


def _solids(item: Any, title: str) -> list[tuple[Floats, Faces]]:
    """Read the solids of a representation item as vertices (k, 3) and faces."""
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
    """Convert the faces of a closed shell to vertices (k, 3) and loops of vertex indices."""
    # A face with holes becomes triangles.
    number: dict[tuple[float, ...], int] = {}
    bounds: list[list[tuple[int, ...]]] = []
    for face in faces:
        loops = []
        for bound in face.Bounds:
            corners = [tuple(float(x) for x in point.Coordinates) for point in bound.Bound.Polygon]
            loop = tuple(number.setdefault(corner, len(number)) for corner in corners)
            loops.append(loop if bound.Orientation else loop[::-1])
        bounds.append(loops)
    points = np.array(list(number)).reshape(-1, 3)
    return points, tuple(loop for loops in bounds for loop in without_holes(points, loops, title))


def _of_face_set(item: Any, title: str) -> tuple[Floats, Faces]:
    """Convert a tessellated shape to vertices (k, 3) and loops of vertex indices."""
    # A face with holes becomes triangles.
    points = np.array(item.Coordinates.CoordList, dtype=float)
    if item.is_a("IfcTriangulatedFaceSet"):
        return points, tuple(tuple(int(k) - 1 for k in loop) for loop in item.CoordIndex)
    loops_of_faces = [(face.CoordIndex, *(getattr(face, "InnerCoordIndices", None) or ())) for face in item.Faces]
    bounds = [[tuple(int(k) - 1 for k in loop) for loop in loops] for loops in loops_of_faces]
    for loop in (loop for loops in bounds for loop in loops):
        if min(loop) < 0 or max(loop) >= len(points):
            raise InputError(title, f"a face names vertex {max(loop) + 1}", f"1 to {len(points)}")
    return points, tuple(loop for loops in bounds for loop in without_holes(points, loops, title))


def _extruded(item: Any, title: str) -> tuple[Floats, Faces]:
    profile = item.SweptArea
    rings = _rectangles(profile, title) if profile.is_a("IfcRectangleProfileDef") else _curves(profile, title)
    area = shapely.Polygon(rings[0], rings[1:])
    if not area.is_valid or area.area == 0.0:
        raise InputError(title, "the outline of its profile crosses itself or a hole", "holes inside, apart")
    region = unions.region_of(area)
    along = np.array([float(x) for x in item.ExtrudedDirection.DirectionRatios])
    along *= float(item.Depth) / float(np.linalg.norm(along))
    surface = unions.extrude(region, 1.0)
    # the prism lies in x–z with unit depth along y: its section becomes x–y, its depth the direction
    points = np.column_stack([surface.points[:, 0], surface.points[:, 2], np.zeros(len(surface.points))])
    points = points + surface.points[:, 1:2] * along
    frame = np.eye(4) if item.Position is None else _frame(item.Position)
    return _moved(points, frame), surface.faces


def _frame(placement: Any) -> Floats:
    return np.array(import_module("ifcopenshell.util.placement").get_axis2placement(placement))


def _rectangles(profile: Any, title: str) -> list[Floats]:
    halves = [(0.5 * float(profile.XDim), 0.5 * float(profile.YDim))]
    if profile.is_a("IfcRectangleHollowProfileDef"):
        wall = float(profile.WallThickness)
        halves.append((halves[0][0] - wall, halves[0][1] - wall))
        if min(halves[1]) <= 0.0:
            raise InputError(title, f"its walls are {wall:g} thick", f"less than {min(halves[0]):g}")
    frame = np.eye(4) if profile.Position is None else _frame(profile.Position)
    rings = [np.array([(-x, -y), (x, -y), (x, y), (-x, y)]) for x, y in halves]
    return [np.asarray(ring @ frame[:2, :2].T + frame[:2, 3]) for ring in rings]


def _curves(profile: Any, title: str) -> list[Floats]:
    if not profile.is_a("IfcArbitraryClosedProfileDef"):
        raise _refused(profile, title)
    return [_corners(curve, title) for curve in (profile.OuterCurve, *(getattr(profile, "InnerCurves", None) or ()))]


def _corners(curve: Any, title: str) -> Floats:
    if curve.is_a("IfcPolyline"):
        corners = np.array([[float(x) for x in point.Coordinates[:2]] for point in curve.Points])
    elif curve.is_a("IfcIndexedPolyCurve") and not any(s.is_a("IfcArcIndex") for s in curve.Segments or ()):
        corners = np.array(curve.Points.CoordList, dtype=float)[:, :2]
    else:
        raise _refused(curve, title)
    corners = corners[:-1] if np.allclose(corners[0], corners[-1]) else corners
    if len(corners) < 3:
        raise InputError(title, f"a curve of its profile has {len(corners)} corners", "at least 3")
    return corners
