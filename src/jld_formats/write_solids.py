"""Write solids as IFC, STEP and VTK."""

from __future__ import annotations

import itertools
import json
import struct
import uuid
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError, Layout, Route, files
from jld_core.build import materials
from jld_core.geometry import area_vector, solids, unions
from jld_core.limit import displacement
from jld_core.scene import units
from jld_core.scene import units as scene_units
from jld_formats.facts import BlockFacts, block_facts
from jld_formats.libraries import library
from jld_formats.read_ifc import DENSITY
from jld_formats.read_ifc import PROPERTIES as MATERIAL_PROPERTIES
from jld_formats.read_mesh import solids_of
from jld_views import quantities

# Namespace of the name-based identifiers of written objects
_SPACE: Final = uuid.UUID("7046bc60-2e03-5556-92a4-4d5840e259ee")

# Prefixes of the metre; lengths in other units are written in metres
_PREFIX: Final = {"m": None, "mm": "MILLI", "cm": "CENTI", "dm": "DECI", "km": "KILO"}
PROPERTIES: Final = "Jld_Block"  # name of the property set of a block


def write_ifc(layout: Layout, path: Path, *, cells: bool) -> None:
    """Write an IFC 4 file with a building element proxy for each block."""
    # Each proxy has the properties mass, mould, order, λ and faces.
    ifc = library("ifcopenshell", path)
    file = _Ifc(ifc, layout)
    facts = block_facts(layout)
    owner = [int(k) for k in layout.block_of] if cells else [
        k for k, surfaces in enumerate(layout.surfaces) for _ in surfaces
    ]  # fmt: skip
    elements = [
        file.element(name, support, surface, facts[owner[number]])
        for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells))
    ]
    file.contain(elements)
    cell_elements = layout.assembly.elements if cells else None
    masses = cell_elements.mass.tolist() if cell_elements is not None else [facts[k].mass for k in owner]
    volumes = cell_elements.volume.tolist() if cell_elements is not None else [facts[k].volume for k in owner]
    file.materials(elements, masses, volumes)
    path.write_text(file.model.to_string(), encoding="ascii")  # errors of its own writer name no reason


class _Ifc:
    def __init__(self, ifc: Any, layout: Layout) -> None:
        from importlib import import_module

        self._compress = import_module("ifcopenshell.guid").compress
        self._name = layout.assembly.name
        self.model = ifc.file(schema="IFC4")
        header = self.model.header
        header.file_name.name = files.printable(self._name)
        header.file_name.time_stamp = "1970-01-01T00:00:00"  # the same layout gives the same file
        make = self.model.create_entity
        unit = layout.assembly.units[0]
        self._scale = 1.0 if unit in _PREFIX else scene_units.METRES.get(unit, 1.0)
        self._kilograms = layout.assembly.kilograms or 1.0
        self._cubic_metres = scene_units.METRES.get(unit, 1.0) ** 3
        mass = make("IfcSIUnit", UnitType="MASSUNIT", Prefix="KILO", Name="GRAM")
        metre = make("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")
        powers = [make("IfcDerivedUnitElement", mass, 1), make("IfcDerivedUnitElement", metre, -3)]
        units = [
            make("IfcSIUnit", UnitType="LENGTHUNIT", Prefix=_PREFIX.get(unit), Name="METRE"),
            make("IfcSIUnit", UnitType="AREAUNIT", Name="SQUARE_METRE"),
            make("IfcSIUnit", UnitType="VOLUMEUNIT", Name="CUBIC_METRE"),
            mass,
            make("IfcDerivedUnit", Elements=powers, UnitType="MASSDENSITYUNIT"),
            make("IfcSIUnit", UnitType="PLANEANGLEUNIT", Name="RADIAN"),
        ]
        self._world = make("IfcAxis2Placement3D", Location=make("IfcCartesianPoint", Coordinates=(0.0, 0.0, 0.0)))
        context = make(
            "IfcGeometricRepresentationContext",
            ContextType="Model",
            CoordinateSpaceDimension=3,
            Precision=1e-9,
            WorldCoordinateSystem=self._world,
        )
        self._body = make(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier="Body",
            ContextType="Model",
            ParentContext=context,
            TargetView="MODEL_VIEW",
        )
        self._project = make(
            "IfcProject",
            GlobalId=self._id("project"),
            Name=files.printable(self._name),
            RepresentationContexts=[context],
            UnitsInContext=make("IfcUnitAssignment", Units=units),
        )
        self._building = make(
            "IfcBuilding",
            GlobalId=self._id("building"),
            Name=files.printable(self._name),
            ObjectPlacement=self._placement(None),
            CompositionType="ELEMENT",
        )
        make(
            "IfcRelAggregates",
            GlobalId=self._id("aggregates"),
            RelatingObject=self._project,
            RelatedObjects=[self._building],
        )

    def _id(self, words: str) -> str:
        """Return the global identifier of an object, derived from its name."""
        return str(self._compress(uuid.uuid5(_SPACE, f"{self._name} {words}").hex))

    def _placement(self, relative: Any) -> Any:
        return self.model.create_entity("IfcLocalPlacement", PlacementRelTo=relative, RelativePlacement=self._world)

    def element(self, name: str, support: bool, surface: unions.Surface, facts: BlockFacts) -> Any:
        make = self.model.create_entity
        shape = make(
            "IfcShapeRepresentation",
            ContextOfItems=self._body,
            RepresentationIdentifier="Body",
            RepresentationType="Brep",
            Items=[self._brep(surface)],
        )
        element = make(
            "IfcBuildingElementProxy",
            GlobalId=self._id(f"element {name}"),
            Name=files.printable(name),
            ObjectType="SUPPORT" if support else f"SHAPE_{facts.shape:02d}",
            ObjectPlacement=self._placement(self._building.ObjectPlacement),
            Representation=make("IfcProductDefinitionShape", Representations=[shape]),
            PredefinedType="USERDEFINED",
        )
        properties = [
            make("IfcPropertySingleValue", Name=key, NominalValue=make(kind, value))
            for key, kind, value in _values(facts, self._kilograms)
        ]
        property_set = make(
            "IfcPropertySet", GlobalId=self._id(f"properties {name}"), Name=PROPERTIES, HasProperties=properties
        )
        make(
            "IfcRelDefinesByProperties",
            GlobalId=self._id(f"defines {name}"),
            RelatedObjects=[element],
            RelatingPropertyDefinition=property_set,
        )
        return element

    def _brep(self, surface: unions.Surface) -> Any:
        make = self.model.create_entity
        coordinates = (self._scale * np.asarray(surface.points)).tolist()
        points = [make("IfcCartesianPoint", Coordinates=tuple(corner)) for corner in coordinates]
        faces = []
        for loop in surface.faces:
            ring = make("IfcPolyLoop", Polygon=[points[index] for index in loop])
            faces.append(make("IfcFace", Bounds=[make("IfcFaceOuterBound", Bound=ring, Orientation=True)]))
        return make("IfcFacetedBrep", Outer=make("IfcClosedShell", CfsFaces=faces))

    def contain(self, elements: list[Any]) -> None:
        self.model.create_entity(
            "IfcRelContainedInSpatialStructure",
            GlobalId=self._id("contained"),
            RelatedElements=elements,
            RelatingStructure=self._building,
        )

    def materials(self, elements: list[Any], masses: list[float], volumes: list[float]) -> None:
        """Add a material of each mass density, kg/m³, and relate the elements to theirs."""
        make = self.model.create_entity
        by_density: dict[float, list[Any]] = {}
        for element, mass, volume in zip(elements, masses, volumes, strict=True):
            if mass > 0.0 and volume > 0.0:
                density = float(f"{mass * self._kilograms / (volume * self._cubic_metres):.12g}")
                by_density.setdefault(density, []).append(element)
        for density, of_density in by_density.items():
            material = make("IfcMaterial", Name=f"{density:.12g} kg/m3")
            property_ = make(
                "IfcPropertySingleValue", Name=DENSITY, NominalValue=make("IfcMassDensityMeasure", density)
            )
            make("IfcMaterialProperties", Name=MATERIAL_PROPERTIES, Properties=[property_], Material=material)
            make(
                "IfcRelAssociatesMaterial",
                GlobalId=self._id(f"material {density:.12g}"),
                RelatedObjects=of_density,
                RelatingMaterial=material,
            )


def _values(facts: BlockFacts, kilograms: float) -> list[tuple[str, str, Any]]:
    """Return name, IFC type and value of each property of a block that is known."""
    values: list[tuple[str, str, Any]] = [
        ("Block", "IfcLabel", files.printable(facts.block)),
        ("Elements", "IfcText", files.printable(" ".join(facts.elements))),
        ("Support", "IfcBoolean", facts.support),
        ("Mass", "IfcMassMeasure", float(f"{kilograms * facts.mass:.12g}")),
        ("DryFacesTo", "IfcText", files.printable(" ".join(facts.dry))),
        ("InnerFaces", "IfcInteger", facts.inner),
    ]
    if facts.shape:
        values.append(("Mould", "IfcInteger", facts.shape))
    if facts.order is not None:
        values.append(("Order", "IfcInteger", facts.order))
    if facts.load_factor is not None:
        values.append(("LoadFactor", "IfcReal", facts.load_factor))
    return values


# Prefixes of the metre; other units are conversion based
_SI_PREFIX: Final = {"m": "$", "mm": ".MILLI.", "cm": ".CENTI.", "dm": ".DECI.", "km": ".KILO."}
_SCHEMA: Final = "AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }"  # schema of AP214
_UNCERTAINTY: Final = 1e-9  # stated uncertainty of lengths, relative to the size


def step_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of a STEP file with a solid of plane faces for each block."""
    assembly = layout.assembly
    return step_of_solids(assembly.name, assembly.units[0], assembly.size, solids_of(layout, cells=cells))


def step_of_solids(name: str, unit: str, size: float, bodies: Iterable[tuple[str, bool, unions.Surface]]) -> str:
    """Return the text of a STEP file of solids with plane faces.

    Parameters
    ----------
    name : str
        Title of the file.
    unit : str
        Unit of lengths.
    size : float
        Size of all, in that unit.
    bodies : iterable of (str, bool, Surface)
        Name, True for a support, closed surface.

    Returns
    -------
    str
        Solids are `MANIFOLD_SOLID_BREP`.
    """
    file = _Part21()
    context = file.context(unit, size)
    supports = []
    for body, support, surface in bodies:
        solid = file.solid(body, surface)
        file.product(body, solid, context)
        supports += [solid] * support
    if supports:
        file.add(f"PRESENTATION_LAYER_ASSIGNMENT('supports','',({','.join(supports)}))")
    title = _text(name)
    head = [
        "ISO-10303-21;",
        "HEADER;",
        f"FILE_DESCRIPTION(({title}),'2;1');",
        f"FILE_NAME({title},'1970-01-01T00:00:00',(''),(''),'jld','jld','');",  # the same layout gives the same file
        f"FILE_SCHEMA(('{_SCHEMA}'));",
        "ENDSEC;",
        "DATA;",
    ]
    return "\n".join([*head, *file.lines, "ENDSEC;", "END-ISO-10303-21;"]) + "\n"


def _text(words: str) -> str:
    """Quote a string for ISO 10303-21: apostrophes doubled, non-ASCII characters escaped."""
    plain = files.printable(words).replace("\\", "\\\\").replace("'", "''").replace("\n", " ")
    return "'" + "".join(c if " " <= c <= "~" else f"\\X4\\{ord(c):08X}\\X0\\" for c in plain) + "'"


def _real(value: float) -> str:
    """Return a real number with all digits and a decimal point."""
    text = repr(float(value) + 0.0).upper()
    mantissa, mark, exponent = text.partition("E")
    return (mantissa if "." in mantissa else mantissa + ".") + mark + exponent


def _triple(values: Floats) -> str:
    return "(" + ",".join(_real(value) for value in values.tolist()) + ")"


class _Part21:
    def __init__(self) -> None:
        self.lines: list[str] = []
        self._product_context = ""

    def add(self, words: str) -> str:
        """Add an instance, given as text, and return its reference, such as "#12"."""
        self.lines.append(f"#{len(self.lines) + 1}={words};")
        return f"#{len(self.lines)}"

    def context(self, unit: str, size: float) -> str:
        application = self.add("APPLICATION_CONTEXT('core data for automotive mechanical design processes')")
        self.add(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000," + application + ")"
        )
        self._product_context = self.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        self._definition_context = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
        angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        solid = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        if unit in units.METRES and unit not in _SI_PREFIX:
            metre = self.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))")
            measure = self.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE({_real(units.METRES[unit])}),{metre})")
            size_of = self.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
            length = self.add(f"(CONVERSION_BASED_UNIT({_text(unit)},{measure})LENGTH_UNIT()NAMED_UNIT({size_of}))")
        else:
            length = self.add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({_SI_PREFIX.get(unit, '$')},.METRE.))")
        near = self.add(
            f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE({_real(_UNCERTAINTY * size)}),{length},"
            "'distance_accuracy_value','')"
        )
        return self.add(
            f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({near}))"
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))REPRESENTATION_CONTEXT('',''))"
        )

    def product(self, name: str, solid: str, context: str) -> None:
        origin = self._placement(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
        title = _text(name)
        shape = self.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION({title},({origin},{solid}),{context})")
        product = self.add(f"PRODUCT({title},{title},'',({self._product_context}))")
        self.add(f"PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,({product}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{self._definition_context})")
        form = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({form},{shape})")

    def _point(self, point: Floats) -> str:
        return self.add(f"CARTESIAN_POINT('',{_triple(point)})")

    def _direction(self, vector: Floats) -> str:
        return self.add(f"DIRECTION('',{_triple(vector / np.linalg.norm(vector))})")

    def _placement(self, origin: Floats, axis: Floats, along: Floats) -> str:
        """Add a frame by origin, axis and first direction, (3,) each; return its reference."""
        return self.add(
            f"AXIS2_PLACEMENT_3D('',{self._point(origin)},{self._direction(axis)},{self._direction(along)})"
        )

    def solid(self, name: str, surface: unions.Surface) -> str:
        # Each edge is shared by the two faces that meet in it.
        points = [self._point(point) for point in surface.points]
        vertices = [self.add(f"VERTEX_POINT('',{place})") for place in points]
        edges: dict[tuple[int, int], str] = {}
        faces = []
        for loop in surface.faces:
            ring = list(loop)
            oriented = []
            for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
                key = (min(a, b), max(a, b))
                if key not in edges:
                    along = surface.points[key[1]] - surface.points[key[0]]
                    length = float(np.linalg.norm(along))
                    vector = self.add(f"VECTOR('',{self._direction(along)},{_real(length)})")
                    line = self.add(f"LINE('',{points[key[0]]},{vector})")
                    edges[key] = self.add(f"EDGE_CURVE('',{vertices[key[0]]},{vertices[key[1]]},{line},.T.)")
                sense = ".T." if (a, b) == key else ".F."
                oriented.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[key]},{sense})"))
            corners = surface.points[ring]
            bound = self.add(
                f"FACE_OUTER_BOUND('',{self.add('EDGE_LOOP(' + chr(39) * 2 + ',(' + ','.join(oriented) + '))')},.T.)"
            )
            frame = self._placement(corners[0], area_vector(corners), corners[1] - corners[0])
            plane = self.add(f"PLANE('',{frame})")
            faces.append(self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
        shell = self.add(f"CLOSED_SHELL('',({','.join(faces)}))")
        return self.add(f"MANIFOLD_SOLID_BREP({_text(name)},{shell})")


_ROUTE: Final = Route("files of 3DEC")


def command_text(layout: Layout, *, cells: bool = False) -> str:
    """Return 3DEC commands that create elements, join those of a block, and set properties."""
    # Joint stiffnesses are no part of a scene; the first lines define them for the user to edit.
    assembly = layout.assembly
    elements, strengths = assembly.elements, assembly.strengths(_ROUTE)
    length, force = assembly.units
    vector = materials.gravity_vector(layout.scene.materials, assembly.dimension).tolist()
    vector = [vector[0], 0.0, vector[1]] if assembly.dimension == 2 else vector
    lines = [
        f"; {assembly.name}",
        f"; lengths in {length}, forces in {force}; written by jld",
        "; stiffnesses are no part of the model: set them to those of your joints",
        "model new",
        "fish define joint_stiffness",
        "  global _kn = 1e10",
        "  global _ks = 5e9",
        "end",
        "[joint_stiffness]",
        "",
    ]
    for k, name in enumerate(elements.ids):
        surface = _surface(layout, k)
        if not _convex(surface):
            raise InputError(f"element {name!r}", "it is not convex, as a block of 3DEC must be", "jld refine first")
        block = layout.blocks[int(layout.block_of[k])]
        lines.append(f"block create polyhedron group '{_word(block.name)}' ...")
        loops = [[surface.points[index] for index in loop[::-1]] for loop in surface.faces]
        rows = ["  face " + " ".join(f"({x:.12g},{y:.12g},{z:.12g})" for x, y, z in loop) for loop in loops]
        lines += [row + " ..." for row in rows[:-1]] + [rows[-1]]
    lines.append("")
    for block in layout.blocks:
        if len(block.elements) > 1:
            lines.append(f"block join range group '{_word(block.name)}'")
    for block in layout.blocks:
        if block.cells and block.volume > 0.0:
            density = block.mass / block.volume
            lines.append(f"block property density {density:.9g} range group '{_word(block.name)}'")
        else:
            lines.append(f"block fix range group '{_word(block.name)}'")
    usual = {field: _median(getattr(strengths, field)) for field in ("friction", "tension", "shear")}
    lines += [
        "",
        "block contact jmodel assign mohr",
        "block contact property stiffness-normal [_kn] stiffness-shear [_ks] ...",
        f"  friction {np.degrees(np.arctan(usual['friction'])):.9g} cohesion 0 tension 0",
        "block contact material-table default property stiffness-normal [_kn] stiffness-shear [_ks] ...",
        f"  friction {np.degrees(np.arctan(usual['friction'])):.9g} cohesion 0 tension 0",
        "; cells of one block are joined for good; to let inner faces crack, leave out the joins and give them",
        f";   tension {usual['tension']:.9g}, cohesion {usual['shear']:.9g}, friction 0",
        f"model gravity ({vector[0]:.9g},{vector[1]:.9g},{vector[2]:.9g})",
    ]
    return "\n".join(lines) + "\n"


def _surface(layout: Layout, k: int) -> unions.Surface:
    elements = layout.assembly.elements
    if layout.assembly.dimension == 2:
        return unions.extrude(unions.union_outlines([elements.shape[k]])[0], layout.thickness)
    vertices, faces, _, _ = solids([elements.ids[k]], [elements.shape[k]], [elements.faces[k]])
    return unions.union_solids(vertices, faces)


def _convex(surface: unions.Surface) -> bool:
    """Return True if all points of a surface lie behind each of its faces."""
    points = surface.points
    size = float(np.ptp(points, axis=0).max())
    for loop in surface.faces:
        corners = points[list(loop)]
        normal = area_vector(corners)
        normal /= np.linalg.norm(normal)
        if ((points - corners.mean(axis=0)) @ normal).max() > 1e-5 * size:
            return False
    return True


def _median(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else 0.0


def _word(name: str) -> str:
    return name.replace("'", "_")


# Cell fields of one number each
_NAMES: Final = ("part", "element", "block", "shape", "support", "label", "utilisation", "normal_force")


class _Polygons:
    """Polygons of a layout with their fields, collected one element or interface at a time."""

    def __init__(self, layout: Layout) -> None:
        self.layout, self.result = layout, layout.result
        self.planar = layout.assembly.dimension == 2
        self.points: list[Floats] = []
        self.faces: list[tuple[int, ...]] = []
        self.rows: dict[str, list[float]] = {name: [] for name in _NAMES}
        self.forces: list[list[float]] = []
        self.motion: list[Floats] = []
        count = len(layout.assembly.interfaces)
        self._used, self._normal, self._vectors = np.zeros(count), np.zeros(count), np.zeros((count, 3))
        if self.result is not None and self.result.forces is not None:
            self._used, self._normal = quantities.utilisation(self.result), self.result.forces[:, 0]
            plain = quantities.face_vectors(layout.assembly, self.result.forces)
            self._vectors = np.column_stack([plain[:, 0], np.zeros(len(plain)), plain[:, 1]]) if self.planar else plain

    def add(self, corners: Floats, loops: list[tuple[int, ...]], element: int, part: int, face: int | None) -> None:
        """Add faces of an element or an interface with their fields.

        corners: (k, 3).
        """
        start = sum(map(len, self.points))
        self.points.append(corners)
        self.motion.append(self._velocity(element, corners))
        block = int(self.layout.block_of[element])
        mesh = {
            "part": part,
            "element": element,
            "block": block,
            "shape": self.layout.blocks[block].shape,
            "support": float(self.layout.assembly.elements.support[element]),
            "label": -1.0 if face is None else float(self.layout.labels[face]),
            "utilisation": 0.0 if face is None else float(self._used[face]),
            "normal_force": 0.0 if face is None else float(self._normal[face]),
        }
        for loop in loops:
            self.faces.append(tuple(start + index for index in loop))
            for name, value in mesh.items():
                self.rows[name].append(value)
            self.forces.append([0.0, 0.0, 0.0] if face is None else self._vectors[face].tolist())

    def _velocity(self, element: int, corners: Floats) -> Floats:
        if self.result is None or self.result.mechanism is None:
            return np.zeros((len(corners), 3))
        flat = corners[:, [0, 2]] if self.planar else corners
        moved = displacement(self.layout.assembly, self.result.mechanism, element, flat)
        return np.column_stack([moved[:, 0], np.zeros(len(moved)), moved[:, 1]]) if self.planar else moved


def write_vtk(layout: Layout, path: Path, *, cells: bool = False) -> None:
    """Write a layout and its analysis as a VTK grid of polygons, for ParaView."""
    # A file that ends in .vtk has the older format. Each polygon is part 0 (surface of an element) or part 1
    # (interface). Its further fields are: element, block, shape, support, label, utilisation, force and normal_force.
    # Label is 1 dry, 0 inner, and −1 on surfaces; force is the vector on element b, scene units. The field of the
    # points is mechanism, the velocity that gives the live load power 1. Without an analysis its fields are zero.
    meshio = library("meshio", path)
    polygons = _polygons_of(layout)
    faces = polygons.faces
    order = sorted(range(len(faces)), key=lambda k: len(faces[k]))
    groups: list[tuple[str, list[tuple[int, ...]]]] = []
    for k in order:
        if not groups or len(groups[-1][1][0]) != len(faces[k]):
            groups.append(({3: "triangle", 4: "quad"}.get(len(faces[k]), "polygon"), []))
        groups[-1][1].append(faces[k])
    stops = np.cumsum([0, *(len(block) for _, block in groups)])

    def by_block(values: Floats) -> list[Floats]:
        """Split values (k, …) of polygons by cell type, in the order of the file."""
        return [values[order[a:b]] for a, b in itertools.pairwise(stops)]

    fields = {name: by_block(np.array(values)) for name, values in polygons.rows.items()}
    fields["force"] = by_block(np.array(polygons.forces))
    mesh = meshio.Mesh(
        np.concatenate(polygons.points),
        [(kind, np.array(block)) for kind, block in groups],
        point_data={"mechanism": np.concatenate(polygons.motion)},
        cell_data=fields,
    )
    if path.suffix == ".vtk":
        meshio.vtk.write(path, mesh, binary=True)
    else:
        meshio.vtu.write(path, mesh, binary=True)


def _polygons_of(layout: Layout) -> _Polygons:
    """Collect the surfaces of all elements, then the interfaces."""
    polygons = _Polygons(layout)
    interfaces = layout.assembly.interfaces
    for element, (_, _, surface) in enumerate(solids_of(layout, cells=True)):
        polygons.add(surface.points, list(surface.faces), element, 0, None)
    for face, polygon in enumerate(interfaces.polygon):
        corners = polygon
        if polygons.planar:
            (x0, z0), (x1, z1) = polygon.tolist()
            depth = layout.thickness
            corners = np.array([[x0, 0.0, z0], [x1, 0.0, z1], [x1, depth, z1], [x0, depth, z0]])
        polygons.add(corners, [tuple(range(len(corners)))], int(interfaces.a[face]), 1, face)
    return polygons


_FLOAT: Final = 5126  # glTF code of numbers of four bytes with a sign and an exponent
_VERTICES: Final = 34962  # glTF code of a buffer of vertices

# Red, green and blue of the shapes, used cyclically; supports are grey
_COLOURS: Final = ((0.87, 0.72, 0.5), (0.6, 0.73, 0.86), (0.72, 0.83, 0.6), (0.88, 0.64, 0.64), (0.76, 0.68, 0.86))


def gltf_bytes(layout: Layout, *, cells: bool) -> bytes:
    """Return the content of a .glb file: a node with a mesh of flat triangles for each block."""
    facts = block_facts(layout)
    scale = units.METRES.get(layout.assembly.units[0], 1.0)
    owner = [int(k) for k in layout.block_of] if cells else [
        k for k, surfaces in enumerate(layout.surfaces) for _ in surfaces
    ]  # fmt: skip
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, Any]] = []
    buffer = bytearray()

    def stored(values: np.ndarray, *, bounds: bool) -> int:
        """Add an array (k, 3) to the buffer and return the number of its accessor."""
        data = values.astype("<f4")
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": data.nbytes, "target": _VERTICES})
        buffer.extend(data.tobytes())
        entry = {"bufferView": len(views) - 1, "componentType": _FLOAT, "count": len(data), "type": "VEC3"}
        if bounds:
            entry |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        accessors.append(entry)
        return len(accessors) - 1

    for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells)):
        fact = facts[owner[number]]
        # positions relative to the node keep the digits of large coordinates; z up becomes y up
        middle = surface.points.mean(axis=0)
        corners = (scale * (surface.points - middle))[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
        triangles = corners[np.array(surface.triangles)]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1)
        proper = length > 0.0
        normals = np.repeat(normals[proper] / length[proper, None], 3, axis=0)
        points = triangles[proper].reshape(-1, 3)
        attributes = {"POSITION": stored(points, bounds=True), "NORMAL": stored(normals, bounds=False)}
        material = 0 if support else 1 + fact.shape % len(_COLOURS)
        meshes.append({"name": name, "primitives": [{"attributes": attributes, "material": material, "mode": 4}]})
        position = (scale * middle)[[0, 2, 1]] * [1.0, 1.0, -1.0]
        sizes = {"mass": (layout.assembly.kilograms or 1.0) * fact.mass, "volume": scale**3 * fact.volume}
        extras = fact.entries() | {name: float(f"{size:.12g}") for name, size in sizes.items()}
        nodes.append({"name": name, "mesh": number, "translation": position.tolist(), "extras": extras})
    materials = [_material("supports", (0.6, 0.6, 0.6))]
    materials += [_material(f"shape {k}", colour) for k, colour in enumerate(_COLOURS)]
    document = {
        "asset": {"version": "2.0", "generator": "jld"},
        "scene": 0,
        "scenes": [{"name": layout.assembly.name, "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(buffer)}],
    }
    return _glb(json.dumps(document, separators=(",", ":")).encode(), bytes(buffer))


def _glb(text: bytes, binary: bytes) -> bytes:
    """Return a .glb file of two chunks, each after its head and padded to 4 bytes."""
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    head, total = struct.Struct("<I4s"), 12 + 8 + len(text) + 8 + len(binary)
    parts = [struct.pack("<4sII", b"glTF", 2, total), head.pack(len(text), b"JSON"), text]
    return b"".join([*parts, head.pack(len(binary), b"BIN\0"), binary])


def _material(name: str, colour: tuple[float, float, float]) -> dict[str, Any]:
    surface = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}
    return {"name": name, "pbrMetallicRoughness": surface}
