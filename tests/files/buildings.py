"""IFC as Revit, ArchiCAD and BlenderBIM write it, STEP as FreeCAD and OCC write it, 3DM of Rhino, JSON of COMPAS."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.guid
import numpy as np
import rhino3dm

from files.make import File

CUBE = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def corners(low: tuple[float, ...], high: tuple[float, ...]) -> list[tuple[float, float, float]]:
    (a, b, c), (d, e, f) = low, high
    return [(x, y, z) for z in (c, f) for x, y in ((a, b), (d, b), (d, e), (a, e))]


class Ifc:
    """An IFC model in millimetres, or another prefix, with a footing of 3 × 0.3 × 0.3 below z = 0."""

    def __init__(self, schema: str = "IFC4", prefix: str | None = "MILLI") -> None:
        self.model = ifcopenshell.file(schema=schema)
        self.size = 1000.0 if prefix == "MILLI" else 1.0
        make = self.model.create_entity
        self.context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-6, self.axes(), None)
        length = make("IfcSIUnit", UnitType="LENGTHUNIT", Prefix=prefix, Name="METRE")
        unit = make("IfcUnitAssignment", [length])
        history = {}
        if schema == "IFC2X3":
            person = make(
                "IfcPersonAndOrganization", make("IfcPerson", FamilyName="a"), make("IfcOrganization", Name="b")
            )
            application = make("IfcApplication", person.TheOrganization, "1", "Revit", "Revit")
            history = {
                "OwnerHistory": make("IfcOwnerHistory", person, application, ChangeAction="ADDED", CreationDate=0)
            }
        self.history = history
        make(
            "IfcProject", ifcopenshell.guid.new(), RepresentationContexts=[self.context], UnitsInContext=unit, **history
        )
        self.product("IfcFooting", "support", self.extruded(self.rectangle(3, 0.3, 1.5, 0.15), 0.3, z=-0.3))

    def point(self, *values: float) -> Any:
        return self.model.create_entity("IfcCartesianPoint", [self.size * float(v) for v in values])

    def direction(self, *values: float) -> Any:
        return self.model.create_entity("IfcDirection", [float(v) for v in values])

    def axes(
        self, at: tuple[float, ...] = (0, 0, 0), z: tuple[float, ...] = (0, 0, 1), x: tuple[float, ...] = (1, 0, 0)
    ) -> Any:
        return self.model.create_entity("IfcAxis2Placement3D", self.point(*at), self.direction(*z), self.direction(*x))

    def rectangle(self, wide: float, deep: float, x: float = 0.0, y: float = 0.0) -> Any:
        at = self.model.create_entity("IfcAxis2Placement2D", self.point(x, y))
        return self.model.create_entity("IfcRectangleProfileDef", "AREA", None, at, self.size * wide, self.size * deep)

    def extruded(self, profile: Any, height: float, z: float = 0.0) -> Any:
        up = self.direction(0, 0, 1)
        return self.model.create_entity("IfcExtrudedAreaSolid", profile, self.axes((0, 0, z)), up, self.size * height)

    def wall(self) -> Any:
        """A wall of 3 × 0.3 × 2."""
        return self.extruded(self.rectangle(3, 0.3, 1.5, 0.15), 2)

    def plane(self, at: tuple[float, ...], normal: tuple[float, ...]) -> Any:
        along = (normal[2], 0.0, -normal[0])
        return self.model.create_entity("IfcPlane", self.axes(at, normal, along))

    def product(self, kind: str, name: str, *items: Any, representation: str = "SweptSolid") -> Any:
        make = self.model.create_entity
        body = make("IfcShapeRepresentation", self.context, "Body", representation, items)
        return make(
            kind,
            ifcopenshell.guid.new(),
            Name=name,
            ObjectPlacement=make("IfcLocalPlacement", None, self.axes()),
            Representation=make("IfcProductDefinitionShape", None, None, [body]),
            **self.history,
        )


def ifc_volume(path: Path) -> float:
    """Return the volume of all products of an IFC file by its geometry kernel, m³."""
    model = ifcopenshell.open(str(path))
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    total = 0.0
    for product in model.by_type("IfcElement"):
        if product.is_a("IfcOpeningElement") or product.Representation is None:
            continue
        shape = ifcopenshell.geom.create_shape(settings, product).geometry
        points = np.array(shape.verts).reshape(-1, 3)
        a, b, c = points[np.array(shape.faces).reshape(-1, 3).T]
        total += abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6.0
    return total


def _ifc() -> list[File]:
    def clipped(f: Ifc) -> Any:
        half = f.model.create_entity("IfcHalfSpaceSolid", f.plane((0, 0, 1.5), (0.1, 0, 1)), False)
        return f.model.create_entity("IfcBooleanClippingResult", "DIFFERENCE", f.wall(), half)

    def bounded(f: Ifc) -> Any:
        line = [f.point(x, y) for x, y in ((0, -1), (1, -1), (1, 1), (0, 1), (0, -1))]
        boundary = f.model.create_entity("IfcPolyline", line)
        half = f.model.create_entity(
            "IfcPolygonalBoundedHalfSpace", f.plane((0, 0, 1), (0, 0, 1)), False, f.axes(), boundary
        )
        return f.model.create_entity("IfcBooleanClippingResult", "DIFFERENCE", f.wall(), half)

    def twice(f: Ifc) -> Any:
        half = f.model.create_entity("IfcHalfSpaceSolid", f.plane((2, 0, 0), (1, 0, 0)), False)
        return f.model.create_entity("IfcBooleanClippingResult", "DIFFERENCE", clipped(f), half)

    def minus(f: Ifc) -> Any:
        hole = f.extruded(f.rectangle(1, 1, 1.5, 0.15), 0.5, z=0.5)
        return f.model.create_entity("IfcBooleanResult", "DIFFERENCE", f.wall(), hole)

    def plus(f: Ifc) -> Any:
        pier = f.extruded(f.rectangle(0.5, 0.3, 0.25, 0.45), 1)
        return f.model.create_entity("IfcBooleanResult", "UNION", f.wall(), pier)

    def common(f: Ifc) -> Any:
        return f.model.create_entity(
            "IfcBooleanResult", "INTERSECTION", f.wall(), f.extruded(f.rectangle(2, 2, 1, 0), 1)
        )

    def arched(f: Ifc) -> Any:
        points = f.model.create_entity(
            "IfcCartesianPointList2D", [[f.size * v for v in p] for p in ((0, 0), (3, 0), (1.5, 1.5))]
        )
        segments = [f.model.create_entity("IfcLineIndex", (1, 2)), f.model.create_entity("IfcArcIndex", (2, 3, 1))]
        curve = f.model.create_entity("IfcIndexedPolyCurve", points, segments, False)
        profile = f.model.create_entity("IfcArbitraryClosedProfileDef", "AREA", None, curve)
        upright = f.axes((0, 0.3, 0), (0, -1, 0), (1, 0, 0))
        return f.model.create_entity("IfcExtrudedAreaSolid", profile, upright, f.direction(0, 0, 1), 0.3 * f.size)

    def composite(f: Ifc) -> Any:
        make = f.model.create_entity
        circle = make("IfcCircle", make("IfcAxis2Placement2D", f.point(1.5, 0)), 1.5 * f.size)
        arc = make("IfcTrimmedCurve", circle, [f.point(3, 0)], [f.point(0, 0)], True, "CARTESIAN")
        line = make("IfcPolyline", [f.point(0, 0), f.point(3, 0)])
        parts = [make("IfcCompositeCurveSegment", "CONTINUOUS", True, curve) for curve in (line, arc)]
        profile = make("IfcArbitraryClosedProfileDef", "AREA", None, make("IfcCompositeCurve", parts, False))
        return make(
            "IfcExtrudedAreaSolid", profile, f.axes((0, 0.3, 0), (0, -1, 0)), f.direction(0, 0, 1), 0.3 * f.size
        )

    def steel(f: Ifc) -> Any:
        at = f.model.create_entity("IfcAxis2Placement2D", f.point(1.5, 0.15))
        sizes = [f.size * v for v in (0.3, 0.3, 0.1, 0.1)]
        return f.extruded(f.model.create_entity("IfcIShapeProfileDef", "AREA", None, at, *sizes), 2)

    def tilted(f: Ifc) -> Any:
        line = f.model.create_entity("IfcPolyline", [f.point(*p) for p in ((0, 0), (1, 0), (1, 0.3), (0, 0.3), (0, 0))])
        profile = f.model.create_entity("IfcArbitraryClosedProfileDef", "AREA", None, line)
        return f.model.create_entity("IfcExtrudedAreaSolid", profile, f.axes(), f.direction(0.6, 0, 0.8), 1 * f.size)

    def triangles(f: Ifc) -> Any:
        points = [[f.size * v for v in p] for p in corners((0, 0, 0), (3, 0.3, 2))]
        faces = [(a + 1, b + 1, c + 1) for q in CUBE for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
        coordinates = f.model.create_entity("IfcCartesianPointList3D", points)
        return f.model.create_entity("IfcTriangulatedFaceSet", coordinates, None, True, faces)

    def drum(f: Ifc) -> Any:
        return f.extruded(f.model.create_entity("IfcCircleProfileDef", "AREA", None, None, 0.5 * f.size), 2)

    table: list[tuple[str, Callable[[Ifc], Any], float]] = [
        ("plain", Ifc.wall, 1.8), ("clipped", clipped, 0.3 * (1.5 * 3 - 0.45)), ("bounded", bounded, 1.5),
        ("clipped_twice", twice, 0.3 * (1.5 * 2 - 0.2)), ("minus", minus, 1.65), ("plus", plus, 1.95),
        ("common", common, 0.6), ("arc_index", arched, 0.3375 * math.pi), ("composite", composite, 0.3375 * math.pi),
        ("steel", steel, 2 * 0.07), ("tilted", tilted, 0.24), ("triangles", triangles, 1.8),
    ]  # fmt: skip
    found = []
    for name, shape, volume in table:
        for schema, prefix in (("IFC4", "MILLI"), ("IFC2X3", None)):
            if schema == "IFC2X3" and name in ("arc_index", "triangles"):
                continue

            def write(path: Path, shape: Any = shape, schema: str = schema, prefix: str | None = prefix) -> None:
                file = Ifc(schema, prefix)
                file.product("IfcWallStandardCase" if schema == "IFC2X3" else "IfcWall", "wall", shape(file))
                file.model.write(str(path))

            program = "Revit 2016" if schema == "IFC2X3" else "ArchiCAD 27"
            found.append(File(f"{name}_{schema}.ifc", program, write, 1, volume, "m", whole=ifc_volume))

    def layers(path: Path) -> None:
        file = Ifc()
        skins = [file.extruded(file.rectangle(3, 0.15, 1.5, y), 2) for y in (0.075, 0.225)]
        file.product("IfcWall", "wall", *skins)
        file.model.write(str(path))

    def opened(path: Path) -> None:
        file = Ifc()
        wall = file.product("IfcWall", "wall", clipped(file), representation="Clipping")
        hole = file.product("IfcOpeningElement", "hole", file.extruded(file.rectangle(1, 1, 1, 0.15), 0.5, z=0.5))
        file.model.create_entity(
            "IfcRelVoidsElement", ifcopenshell.guid.new(), RelatingBuildingElement=wall, RelatedOpeningElement=hole
        )
        file.model.write(str(path))

    def mapped(path: Path) -> None:
        file = Ifc()
        make = file.model.create_entity
        stone = make(
            "IfcShapeRepresentation",
            file.context,
            "Body",
            "SweptSolid",
            [file.extruded(file.rectangle(1, 0.3, 0.5, 0.15), 1)],
        )
        source = make("IfcRepresentationMap", file.axes(), stone)
        for k in range(3):
            target = make("IfcCartesianTransformationOperator3D", None, None, file.point(k, 0, 0), 1.0, None)
            file.product(
                "IfcBuildingElementProxy",
                f"stone{k}",
                make("IfcMappedItem", source, target),
                representation="MappedRepresentation",
            )
        file.model.write(str(path))

    def round_(path: Path) -> None:
        file = Ifc()
        file.product("IfcColumn", "drum", drum(file))
        file.model.write(str(path))

    return [
        *found,
        File("layers.ifc", "Revit 2024", layers, 2, 1.8, "m"),
        File("opened.ifc", "Revit 2024", opened, 1, 0.3 * (4.5 - 0.45 - 0.5), "m"),
        File("mapped.ifc", "Revit 2024", mapped, 3, 0.9, "m"),
        File("round.ifc", "Revit 2024", round_, refused="IfcCircleProfileDef"),
    ]


class Step:
    """A STEP file as OCC writes it: edges on curves of surfaces, several names, assemblies by placements."""

    def __init__(
        self, length: str = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))", schema: str = "AUTOMOTIVE_DESIGN"
    ) -> None:
        self.lines: list[str] = []
        self.schema = schema
        unit = self.add(length) if isinstance(length, str) else ""
        self.context = self.add(
            f"( GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT(({unit})) "
            "REPRESENTATION_CONTEXT('Context #1','3D Context') )"
        )

    def add(self, words: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1} = {words};")
        return f"#{len(self.lines)}"

    def triple(self, kind: str, values: Any) -> str:
        texts = [f"{float(v):.15G}" for v in values]
        return self.add(f"{kind}('',({','.join(text if '.' in text else text + '.' for text in texts)}))")

    def axes(self, at: Any = (0, 0, 0), z: Any = (0, 0, 1), x: Any = (1, 0, 0)) -> str:
        names = self.triple("CARTESIAN_POINT", at), self.triple("DIRECTION", z), self.triple("DIRECTION", x)
        return self.add(f"AXIS2_PLACEMENT_3D('',{','.join(names)})")

    def solid(
        self, points: list[tuple[float, float, float]], faces: Any = CUBE, name: str = "", curve: str = "LINE"
    ) -> str:
        vertices = [self.add(f"VERTEX_POINT('',{self.triple('CARTESIAN_POINT', p)})") for p in points]
        edges: dict[tuple[int, int], str] = {}
        made = []
        for face in faces:
            oriented = []
            for a, b in zip(face, [*face[1:], face[0]], strict=True):
                key = (min(a, b), max(a, b))
                if key not in edges:
                    along = np.subtract(points[key[1]], points[key[0]])
                    vector = self.add(f"VECTOR('',{self.triple('DIRECTION', along / np.linalg.norm(along))},1.)")
                    line = self.add(f"{curve}('',{self.triple('CARTESIAN_POINT', points[key[0]])},{vector})")
                    line = self.add(f"SURFACE_CURVE('',{line},($),.PCURVE_S1.)")
                    edges[key] = self.add(f"EDGE_CURVE('',{vertices[key[0]]},{vertices[key[1]]},{line},.T.)")
                oriented.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[key]},{'.T.' if (a, b) == key else '.F.'})"))
            loop = self.add(f"EDGE_LOOP('',({','.join(oriented)}))")
            a, b, c = (np.array(points[k], dtype=float) for k in face[:3])
            plane = self.add(f"PLANE('',{self.axes(a, np.cross(b - a, c - a), b - a)})")
            made.append(self.add(f"ADVANCED_FACE('',({self.add(f'''FACE_BOUND('',{loop},.T.)''')}),{plane},.T.)"))
        return self.add(f"MANIFOLD_SOLID_BREP('{name}',{self.add(f'''CLOSED_SHELL('',({','.join(made)}))''')})")

    def product(self, name: str, *items: str, kind: str = "ADVANCED_BREP_SHAPE_REPRESENTATION") -> tuple[str, str]:
        """Add a product, and return its definition and its representation."""
        shape = self.add(f"{kind}('{name}',({','.join([self.axes(), *items])}),{self.context})")
        formation = self.add(
            f"PRODUCT_DEFINITION_FORMATION('','',{self.add(f'''PRODUCT('{name}','{name}','',($))''')})"
        )
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},$)")
        self.add(
            f"SHAPE_DEFINITION_REPRESENTATION({self.add(f'''PRODUCT_DEFINITION_SHAPE('','',{definition})''')},{shape})"
        )
        return definition, shape

    def place(self, parent: tuple[str, str], child: tuple[str, str], at: Any, x: Any = (1, 0, 0)) -> None:
        use = self.add(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','','',{parent[0]},{child[0]},$)")
        move = self.add(f"ITEM_DEFINED_TRANSFORMATION('','',{self.axes()},{self.axes(at, x=x)})")
        relation = self.add(
            f"( REPRESENTATION_RELATIONSHIP('','',{child[1]},{parent[1]}) "
            f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION({move}) "
            "SHAPE_REPRESENTATION_RELATIONSHIP() )"
        )
        form = self.add(f"PRODUCT_DEFINITION_SHAPE('Placement','',{use})")
        self.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION({relation},{form})")

    def write(self, path: Path) -> None:
        head = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('FreeCAD Model'),'2;1');\n"
        head += f"FILE_SCHEMA(('{self.schema}'));\nENDSEC;\nDATA;\n"
        path.write_text(head + "\n".join(self.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n")


def _step() -> list[File]:
    stone, low = corners((0, 0, 0), (1000, 300, 500)), corners((0, 0, -300), (2000, 300, 0))
    inch = (
        "(CONVERSION_BASED_UNIT('INCH',#2)LENGTH_UNIT()NAMED_UNIT(#3))",
        "LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#4)",
        "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))",
    )

    def parts(path: Path) -> None:
        file = Step()
        file.product("support", file.solid(low))
        file.product("Box", file.solid(stone))
        file.product("Box001", file.solid([(x + 1000, y, z) for x, y, z in stone]))
        file.write(path)

    def one(path: Path) -> None:
        file = Step(schema="CONFIG_CONTROL_DESIGN")
        file.product("all", file.solid(low, name="support"), file.solid(stone, name="stone"))
        file.write(path)

    def assembly(path: Path) -> None:
        file = Step()
        whole = file.product("Assembly", kind="SHAPE_REPRESENTATION")
        ground, block = file.product("support", file.solid(low)), file.product("Stein", file.solid(stone))
        file.place(whole, ground, (0, 0, 0))
        file.place(whole, block, (0, 0, 0))
        file.place(whole, block, (2000, 300, 0), x=(-1, 0, 0))
        file.place(whole, block, (500, 0, 500))
        file.write(path)

    def nested(path: Path) -> None:
        file = Step()
        whole = file.product("Assembly", kind="SHAPE_REPRESENTATION")
        pair = file.product("Pair", kind="SHAPE_REPRESENTATION")
        ground, block = file.product("support", file.solid(low)), file.product("Stein", file.solid(stone))
        file.place(pair, block, (0, 0, 0))
        file.place(pair, block, (1000, 0, 0))
        file.place(whole, ground, (0, 0, 0))
        file.place(whole, pair, (0, 0, 0))
        file.place(whole, pair, (0, 0, 500))
        file.write(path)

    def inches(path: Path) -> None:
        file = Step.__new__(Step)
        file.lines, file.schema = [], "AUTOMOTIVE_DESIGN"
        file.add(inch[0]), file.add(inch[1]), file.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)"), file.add(inch[2])
        file.context = file.add(
            "( GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT((#1)) REPRESENTATION_CONTEXT('','') )"
        )
        file.product("support", file.solid([tuple(v / 25.4 for v in p) for p in low]))
        file.product("Box", file.solid([tuple(v / 25.4 for v in p) for p in stone]))
        file.write(path)

    def curved(path: Path) -> None:
        file = Step()
        file.product("support", file.solid(low))
        file.product("Drum", file.solid(stone, curve="CIRCLE"))
        file.write(path)

    def bomb(path: Path) -> None:
        file = Step()
        level = file.product("support", file.solid(low))
        for k in range(9):
            above = file.product(f"level{k}", kind="SHAPE_REPRESENTATION")
            for j in range(10):
                file.place(above, level, (0, 0, 10 * j))
            level = above
        file.write(path)

    return [
        File("parts.step", "FreeCAD 1.0", parts, 2, 0.3, "mm"),
        File("one_part.stp", "OCC 7.8", one, 1, 0.15, "mm"),
        File("assembly.step", "FreeCAD 1.0", assembly, 3, 0.45, "mm"),
        File("nested.step", "SolidWorks", nested, 4, 0.6, "mm"),
        File("inches.stp", "SolidWorks", inches, 1, 0.15, "in"),
        File("curved.step", "FreeCAD 1.0", curved, refused="curved edge (CIRCLE)"),
        File("bomb.step", "nobody", bomb, refused="at most 20000"),
        File(
            "model.dae", "SketchUp", lambda path: path.write_text("<COLLADA/>") and None, refused="an OBJ, STL or PLY"
        ),
        File(
            "model.skp", "SketchUp", lambda path: path.write_bytes(b"\xff\xfe") and None, refused="an OBJ, STL or PLY"
        ),
    ]


def _rhino() -> list[File]:
    def model(unit: str, size: float, draw: Callable[[Any, Any, float], None]) -> Callable[[Path], None]:
        def write(path: Path) -> None:
            file = rhino3dm.File3dm()
            file.Settings.ModelUnitSystem = getattr(rhino3dm.UnitSystem, unit)
            layers = {name: file.Layers.AddLayer(name, (0, 0, 0, 255)) for name in ("STONE", "SUPPORTS", "OLD")}
            file.Layers[layers["OLD"]].Visible = False
            draw(file, layers, size)
            file.Write(str(path), 8)

        return write

    def box(file: Any, layer: int, low: tuple[float, ...], high: tuple[float, ...]) -> None:
        attributes = rhino3dm.ObjectAttributes()
        attributes.LayerIndex = layer
        bounds = rhino3dm.BoundingBox(rhino3dm.Point3d(*low), rhino3dm.Point3d(*high))
        file.Objects.AddBrep(rhino3dm.Brep.CreateFromBox(rhino3dm.Box(bounds)), attributes)

    def mesh(file: Any, layer: int, low: tuple[float, ...], high: tuple[float, ...]) -> None:
        attributes = rhino3dm.ObjectAttributes()
        attributes.LayerIndex = layer
        made = rhino3dm.Mesh()
        for point in corners(low, high):
            made.Vertices.Add(*point)
        for face in CUBE:
            made.Faces.AddFace(*face)
        file.Objects.AddMesh(made, attributes)

    def pile(add: Any, hidden: bool = False) -> Callable[[Any, Any, float], None]:
        def draw(file: Any, layers: Any, s: float) -> None:
            add(file, layers["SUPPORTS"], (0, 0, -0.3 * s), (s, s, 0))
            add(file, layers["STONE"], (0, 0, 0), (s, s, 0.5 * s))
            add(file, layers["OLD" if hidden else "STONE"], (0, 0, 0.5 * s), (s, s, s))

        return draw

    def curves(file: Any, layers: Any, s: float) -> None:
        for layer, y0, y1 in (("SUPPORTS", -0.3, 0), ("STONE", 0, 0.5)):
            attributes = rhino3dm.ObjectAttributes()
            attributes.LayerIndex = layers[layer]
            line = [(0, y0), (1, y0), (1, y1), (0, y1), (0, y0)]
            points = rhino3dm.Point3dList([rhino3dm.Point3d(s * x, s * y, 0) for x, y in line])
            file.Objects.AddPolyline(points, attributes)

    return [
        File("breps.3dm", "Rhino 8", model("Meters", 1.0, pile(box)), 2, 1.0, "m"),
        File("meshes.3dm", "Rhino 8", model("Millimeters", 1000.0, pile(mesh)), 2, 1.0, "mm"),
        File("hidden.3dm", "Rhino 8", model("Centimeters", 100.0, pile(box, True)), 1, 0.5, "cm"),
        File("template_mm.3dm", "Rhino 8", model("Millimeters", 1.0, pile(box)), 2, 1e-9, "mm", doubtful="--unit m"),
        File("curves.3dm", "Rhino 8", model("Feet", 4.0, curves), 1, 8 * 0.3048**2, "ft"),
    ]


def _compas() -> list[File]:
    def block(low: float, high: float) -> dict[str, Any]:
        points = corners((0, 0, low), (1, 1, high))
        vertex = {str(k): dict(zip("xyz", point, strict=True)) for k, point in enumerate(points)}
        data = {"vertex": vertex, "face": {str(k): list(face) for k, face in enumerate(CUBE)}}
        return {"dtype": "compas_assembly.datastructures/Block", "data": data}

    def assembly(path: Path) -> None:
        node = {"0": {"block": block(-0.3, 0), "is_support": True}, "1": {"block": block(0, 1)}}
        data = {"attributes": {"name": "pile"}, "graph": {"node": node, "edge": {}}}
        path.write_text(json.dumps({"dtype": "compas_assembly.datastructures/Assembly", "data": data}))

    def writes(document: Any) -> Callable[[Path], None]:
        return lambda path: path.write_text(json.dumps(document)) and None

    lower, upper = block(-0.3, 0), block(0, 1)
    meshes = [{"dtype": "compas.datastructures/Mesh", "data": one["data"]} for one in (lower, upper)]

    def element(mesh: Any, guid: str, support: bool) -> dict[str, Any]:
        data = {"name": "BlockElement", "shape": mesh, "transformation": None, "is_support": support}
        return {"dtype": "compas_dem.elements/BlockElement", "data": data, "guid": guid}

    def old(value: Any, kind: str = "Block") -> dict[str, Any]:
        name = f"compas_assembly.datastructures/{kind}"
        return {"dtype": name, "value": {"datatype": name, "compas": "0.18.1", "data": value}}

    model = {
        "elements": [element(meshes[0], "g0", True), element(meshes[1], "g1", False)],
        "graph": {"node": {"0": {"element": "g0"}, "1": {"element": "g1"}}, "edge": {}},
        "materials": [],
        "element_material": {},
    }
    nodes = {"0": {"block": old(lower["data"]), "is_support": True}, "1": {"block": old(upper["data"])}}
    half = {
        **upper["data"],
        "face": {
            k: dict(zip(map(str, f), map(str, [*f[1:], f[0]]), strict=True)) for k, f in upper["data"]["face"].items()
        },
    }
    square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    first = {
        "assembly": {
            "node": {"0": {"is_support": True}, "1": {}},
            "node_attributes": {"is_support": False},
            "edge": {"0": {"1": {"interface_points": square}}},
        },
        "blocks": {"0": lower["data"], "1": half},
    }
    lowest = {"support": ("lowest",)}
    return [
        File("assembly.json", "COMPAS 2", assembly, 1, 1.0),
        File(
            "model_of_a_list.json",
            "compas_dem 0.4",
            writes({"dtype": "compas_dem.models/BlockModel", "data": model}),
            1,
            1.0,
        ),
        File("before_1.json", "COMPAS 0.18", writes(old({"node": nodes, "edge": {}}, "Assembly")), 1, 1.0),
        File("first_versions.json", "compas_assembly 0.1", writes(first), 1, 1.0),
        File("meshes.json", "COMPAS 2", writes(meshes), 1, 1.0, options=lowest),
        File("meshes_in_lists.json", "COMPAS 1", writes([[one] for one in meshes]), 1, 1.0, options=lowest),
        File(
            "no_assembly.json",
            "COMPAS 2",
            writes({"dtype": "x/Assembly", "data": {}}),
            refused="it is no COMPAS assembly",
        ),
    ]


def files() -> list[File]:
    return [*_ifc(), *_step(), *_rhino(), *_compas()]
