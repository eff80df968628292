"""STEP, IFC and glTF: volumes and properties read back by other libraries; lengths in another unit."""

from __future__ import annotations

import contextlib
import json
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import box, grid_document
from cases import scene_in_space as pile
from command import SCENES, call, refused
from jld_core import InputError, Layout, ParameterError, Scene, blocks_csv, build_assembly, parse_scene, samples, solve
from jld_formats import ImportOptions, export, import_file


def layout(scene: Scene, solved: bool = False) -> Layout:
    assembly = build_assembly(scene)
    return Layout(scene, assembly, assembly.labels, solve(assembly) if solved else None)


STONES = [box("a", [0, 0, 0], [1, 1, 0.5]), box("b", [1, 0, 0], [3, 1, 0.5]), box("c", [0.5, 0, 0.5], [2, 1, 1])]

CASES = {
    "ring": lambda: parse_scene(grid_document(["aaa", "a.a", "bbb", "###"])),
    "arch": lambda: samples.arch(voussoirs=5),
    "cross": lambda: samples.vault("cross", voussoirs=4, courses=1),
    "pile": lambda: parse_scene(pile([box("g", [0, 0, -1], [3, 1, 0], support=True), *STONES])),
}


def volumes(made: Layout) -> dict[str, float]:
    """Volume of each block, by its elements."""
    pairs = zip(made.blocks, made.members, strict=True)
    return {block.name: float(made.assembly.elements.volume[own].sum()) for block, own in pairs}


def part21(text: str) -> dict[str, str]:
    """Instances of the data section by name."""
    data = text.split("DATA;", 1)[1].split("ENDSEC;")[0]
    return dict(re.findall(r"(#\d+)=(.*?);\n", data))


def step_volumes(text: str) -> dict[str, float]:
    """Volumes of the solids by the divergence theorem, from points, edges and faces of the text alone.

    Every edge has to be used once either way, and every face has to lie in its plane, seen from outside.
    """
    found = part21(text)

    def refs(name: str) -> list[str]:
        return re.findall(r"#\d+", found[name])

    def numbers(name: str) -> np.ndarray:
        return np.array([float(v) for v in found[name].split("(", 2)[2].rstrip(")").split(",")])

    result = {}
    for name, words in found.items():
        if not words.startswith("MANIFOLD_SOLID_BREP"):
            continue
        (shell,) = refs(name)
        used: dict[tuple[str, str], int] = {}
        volume = 0.0
        for face in refs(shell):
            bound, plane = refs(face)
            corners = []
            for oriented in refs(refs(bound)[0]):
                a, b, _ = refs(refs(oriented)[0])
                a, b = (b, a) if found[oriented].endswith(".F.)") else (a, b)
                used[a, b] = used.get((a, b), 0) + 1
                corners.append(numbers(refs(a)[0]))
            place, axis, _ = refs(refs(plane)[0])
            points = np.array(corners)
            area = 0.5 * np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
            assert area @ numbers(axis) == pytest.approx(np.linalg.norm(area))
            assert np.abs((points - numbers(place)) @ numbers(axis)).max() < 1e-9 * max(1.0, np.abs(points).max())
            volume += float(area @ points[0]) / 3.0
        assert all(count == 1 and used.get((b, a)) == 1 for (a, b), count in used.items())
        result[re.findall(r"'(.*?)'", words)[0]] = volume
    return result


@pytest.mark.parametrize("name", CASES)
def test_step_solids_have_the_volumes_of_the_blocks(name: str, tmp_path: Path) -> None:
    """By an own reader of the text; edges shared, planes right."""
    made = layout(CASES[name]())
    text = export(made, "step", tmp_path / "a.step").read_text("ascii")
    assert step_volumes(text) == pytest.approx(volumes(made), rel=1e-9)
    millimetres = export(made, "step", tmp_path / "mm.step", unit="mm").read_text("ascii")
    assert "SI_UNIT(.MILLI.,.METRE.)" in millimetres
    assert step_volumes(millimetres) == pytest.approx({k: 1e9 * v for k, v in volumes(made).items()}, rel=1e-9)


@pytest.mark.parametrize(("name", "unit"), [("ring", "m"), ("arch", "mm"), ("cross", "m"), ("pile", "in")])
def test_another_library_reads_step(name: str, unit: str, tmp_path: Path) -> None:
    """By gmsh with OpenCASCADE, which converts to millimetres: solids, and volumes to 1e-9."""
    gmsh = pytest.importorskip("gmsh")
    made = layout(CASES[name]())
    path = export(made, "step", tmp_path / "a.step", unit=unit)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        tags = gmsh.model.occ.importShapes(str(path))
        gmsh.model.occ.synchronize()
        found = [gmsh.model.occ.getMass(3, tag) for dimension, tag in tags if dimension == 3]
    finally:
        gmsh.finalize()
    assert sorted(found) == pytest.approx(sorted(volumes(made).values()), rel=1e-9)


def test_step_texts_are_escaped(tmp_path: Path) -> None:
    document = grid_document(["aa", "##"]) | {"name": "it's λ\\ new"}
    text = export(layout(parse_scene(document)), "step", tmp_path / "a.step").read_text("ascii")
    assert "'it''s \\X4\\000003BB\\X0\\\\\\ new'" in text


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", CASES)
def test_ifc_is_valid_and_holds_every_block(name: str, tmp_path: Path) -> None:
    """By the validator of ifcopenshell; mass, mould, order, λ and faces as properties; volumes after import."""
    pytest.importorskip("ifcopenshell")
    import ifcopenshell
    import ifcopenshell.util.element as util
    import ifcopenshell.validate

    made = layout(CASES[name](), solved=True)
    path = export(made, "ifc", tmp_path / "a.ifc")
    model = ifcopenshell.open(str(path))
    log = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(model, log, express_rules=False)
    assert log.statements == []
    elements = {element.Name: element for element in model.by_type("IfcBuildingElementProxy")}
    assert set(elements) == {block.name for block in made.blocks}
    for block in made.blocks:
        own = util.get_psets(elements[block.name])["Jld_Block"]
        assert own["Mass"] == pytest.approx(block.mass)
        assert own["Support"] == block.support
        assert own.get("Mould", 0) == block.shape
        assert made.result is not None
        assert own.get("LoadFactor", np.nan) == pytest.approx(made.result.load_factor, nan_ok=True)
        assert (own.get("Order") is None) == (not block.cells)
    back = build_assembly(parse_scene(import_file(path, ImportOptions(like=made.scene)).document))
    wanted = volumes(made)
    assert dict(zip(back.elements.ids, back.elements.volume.tolist(), strict=True)) == pytest.approx(wanted, rel=1e-9)
    assert back.elements.support.sum() == sum(block.support for block in made.blocks)


def ifc_model(tmp_path: Path, unit: str | None, *shapes: Any) -> Path:
    """An IFC file of shapes that functions make, on a slab of a faceted face set."""
    ifcopenshell = pytest.importorskip("ifcopenshell")
    import ifcopenshell.guid as guid

    model = ifcopenshell.file(schema="IFC4")
    make = model.create_entity
    origin = make("IfcAxis2Placement3D", Location=make("IfcCartesianPoint", (0.0, 0.0, 0.0)))
    context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-9, origin)
    length = make("IfcSIUnit", UnitType="LENGTHUNIT", Prefix=unit, Name="METRE")
    make("IfcProject", guid.new(), RepresentationContexts=[context], UnitsInContext=make("IfcUnitAssignment", [length]))
    for number, shape in enumerate(shapes):
        item, name, kind, place = shape(make)
        at = make("IfcAxis2Placement3D", Location=make("IfcCartesianPoint", place))
        body = make("IfcShapeRepresentation", context, "Body", "Brep", [item])
        make(
            kind, GlobalId=guid.new(), Name=name or f"s{number}",
            ObjectPlacement=make("IfcLocalPlacement", RelativePlacement=at),
            Representation=make("IfcProductDefinitionShape", Representations=[body]),
        )  # fmt: skip
    model.write(str(tmp_path / "a.ifc"))
    return tmp_path / "a.ifc"


def slab(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
    """A rectangle of 2000 × 1000 × 300, extruded downwards from z = 0."""
    profile = make("IfcRectangleProfileDef", ProfileType="AREA", XDim=2000.0, YDim=1000.0)
    down = make("IfcDirection", (0.0, 0.0, -1.0))
    return make("IfcExtrudedAreaSolid", profile, None, down, 300.0), "my support", "IfcSlab", (1000.0, 500.0, 0.0)


def wall(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
    """An L of 1000 × 500 with a notch, extruded upright from a local placement turned into x–z."""
    corners = [(0, 0), (1000, 0), (1000, 500), (500, 500), (500, 250), (0, 250), (0, 0)]
    line = make("IfcPolyline", [make("IfcCartesianPoint", (float(x), float(y))) for x, y in corners])
    profile = make("IfcArbitraryClosedProfileDef", "AREA", None, line)
    position = make(
        "IfcAxis2Placement3D", make("IfcCartesianPoint", (0.0, 1000.0, 0.0)),
        make("IfcDirection", (0.0, -1.0, 0.0)), make("IfcDirection", (1.0, 0.0, 0.0)),
    )  # fmt: skip
    up = make("IfcDirection", (0.0, 0.0, 1.0))
    return make("IfcExtrudedAreaSolid", profile, position, up, 1000.0), "ell", "IfcWall", (0.0, 0.0, 0.0)


def block(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
    """A cube of 500 as a polygonal face set, beside the L."""
    corners = [(x, y, z) for z in (0.0, 500.0) for y in (0.0, 500.0) for x in (0.0, 500.0)]
    loops = ((1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6))
    faces = [make("IfcIndexedPolygonalFace", loop) for loop in loops]
    item = make("IfcPolygonalFaceSet", make("IfcCartesianPointList3D", corners), True, faces)
    return item, "cube", "IfcBuildingElementProxy", (1000.0, 0.0, 0.0)


def drum(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
    profile = make("IfcCircleProfileDef", ProfileType="AREA", Radius=100.0)
    up = make("IfcDirection", (0.0, 0.0, 1.0))
    return make("IfcExtrudedAreaSolid", profile, None, up, 300.0), "drum", "IfcColumn", (0.0, 0.0, 0.0)


def ball(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
    at = make("IfcAxis2Placement3D", Location=make("IfcCartesianPoint", (0.0, 0.0, 0.0)))
    return make("IfcSphere", at, 5.0), "ball", "IfcColumn", (0.0, 0.0, 0.0)


def test_ifc_solids_of_other_programs(tmp_path: Path) -> None:
    """Extruded areas and a face set in millimetres, placed and turned; volumes by hand."""
    path = ifc_model(tmp_path, "MILLI", slab, wall, block)
    found = import_file(path)
    assembly = build_assembly(parse_scene(found.document))
    volume = dict(zip(assembly.elements.ids, assembly.elements.volume.tolist(), strict=True))
    assert volume == pytest.approx({"my support": 0.6, "ell": 0.375, "cube": 0.125}, rel=1e-9)
    assert [assembly.elements.ids[k] for k in np.flatnonzero(assembly.elements.support)] == ["my support"]
    assert len(assembly.interfaces) == 3
    assert "lengths in mm, made m" in str(found.report)


def ring(make: Any, low: float, high: float, z: float) -> list[Any]:
    """Corners of a square in the plane z."""
    return [
        make("IfcCartesianPoint", (x, y, z)) for x, y in ((low, low), (high, low), (high, high), (low, high))
    ]  # fmt: skip


def voided(make: Any) -> Any:
    """A square of 3 with a square hole of 1, extruded by 1."""
    outer, inner = (
        make("IfcPolyline", [make("IfcCartesianPoint", c) for c in corners])
        for corners in (
            [(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0), (0.0, 0.0)],
            [(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0), (1.0, 1.0)],
        )
    )
    profile = make("IfcArbitraryProfileDefWithVoids", "AREA", None, outer, [inner])
    return make("IfcExtrudedAreaSolid", profile, None, make("IfcDirection", (0.0, 0.0, 1.0)), 1.0)


def hollow(make: Any) -> Any:
    """The same as a hollow rectangle, in the middle of its axes."""
    axes = make("IfcAxis2Placement2D", make("IfcCartesianPoint", (1.5, 1.5)))
    profile = make("IfcRectangleHollowProfileDef", "AREA", None, axes, 3.0, 3.0, 1.0)
    return make("IfcExtrudedAreaSolid", profile, None, make("IfcDirection", (0.0, 0.0, 1.0)), 1.0)


def frame_faces() -> tuple[list[tuple[float, float, float]], list[list[tuple[int, ...]]]]:
    """Corners and faces of a square frame; top and bottom are faces with a hole."""
    square = {0: ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0)), 1: ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0))}
    points = [(x, y, z) for z in (0.0, 1.0) for k in (0, 1) for x, y in square[k]]
    faces: list[list[tuple[int, ...]]] = [[(3, 2, 1, 0), (4, 5, 6, 7)], [(8, 9, 10, 11), (15, 14, 13, 12)]]
    for begin, sense in ((0, 1), (4, -1)):
        for k in range(4):
            a, b = begin + k, begin + (k + 1) % 4
            faces.append([(a, b, b + 8, a + 8)[::sense]])
    return points, faces


def brep(make: Any) -> Any:
    """The same as a faceted B-rep."""
    points, faces = frame_faces()
    placed = [make("IfcCartesianPoint", point) for point in points]
    made = []
    for outline, *holes in faces:
        loops = [make("IfcPolyLoop", [placed[k] for k in loop]) for loop in (outline, *holes)]
        bounds = [make("IfcFaceOuterBound", loops[0], True), *(make("IfcFaceBound", loop, True) for loop in loops[1:])]
        made.append(make("IfcFace", bounds[::-1]))
    return make("IfcFacetedBrep", make("IfcClosedShell", made))


def face_set(make: Any) -> Any:
    """The same as a polygonal face set."""
    points, faces = frame_faces()
    made = [
        make("IfcIndexedPolygonalFaceWithVoids", [k + 1 for k in outline], [[k + 1 for k in hole] for hole in holes])
        if holes
        else make("IfcIndexedPolygonalFace", [k + 1 for k in outline])
        for outline, *holes in faces
    ]
    return make("IfcPolygonalFaceSet", make("IfcCartesianPointList3D", points), True, made)


@pytest.mark.parametrize("shape", [voided, hollow, brep, face_set])
def test_ifc_faces_with_holes_are_openings(shape: Any, tmp_path: Path) -> None:
    """A frame of volume 9 − 1 on a slab that covers 3 × 3: the contact has the area 8."""

    def below(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
        profile = make("IfcRectangleProfileDef", ProfileType="AREA", XDim=4.0, YDim=4.0)
        down = make("IfcDirection", (0.0, 0.0, -1.0))
        return make("IfcExtrudedAreaSolid", profile, None, down, 1.0), "my support", "IfcSlab", (1.5, 1.5, 0.0)

    def frame(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
        return shape(make), "frame", "IfcWall", (0.0, 0.0, 0.0)

    assembly = build_assembly(parse_scene(import_file(ifc_model(tmp_path, None, below, frame)).document))
    volume = dict(zip(assembly.elements.ids, assembly.elements.volume.tolist(), strict=True))
    assert volume == pytest.approx({"my support": 16.0, "frame": 8.0}, rel=1e-9)
    assert assembly.interfaces.area.sum() == pytest.approx(8.0, rel=1e-9)


def test_openings_of_ifc_products_are_cut_out(tmp_path: Path) -> None:
    """A block of 2000 × 1000 × 300 less an opening of 500 × 400 right through it; a round opening is refused."""
    ifcopenshell = pytest.importorskip("ifcopenshell")
    import ifcopenshell.guid as guid

    def opening(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
        profile = make("IfcRectangleProfileDef", ProfileType="AREA", XDim=500.0, YDim=400.0)
        up = make("IfcDirection", (0.0, 0.0, 1.0))
        return (
            make("IfcExtrudedAreaSolid", profile, None, up, 900.0),
            "void",
            "IfcOpeningElement",
            (900.0, 450.0, -600.0),
        )

    def round_one(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
        item, name, _, place = drum(make)
        return item, name, "IfcOpeningElement", place

    for shape in (opening, round_one):
        model = ifcopenshell.open(str(ifc_model(tmp_path, "MILLI", slab, wall, shape)))
        (cut,), (void,) = model.by_type("IfcSlab"), model.by_type("IfcOpeningElement")
        model.create_entity(
            "IfcRelVoidsElement", guid.new(), RelatingBuildingElement=cut, RelatedOpeningElement=void
        )  # fmt: skip
        model.write(str(tmp_path / "a.ifc"))
        if shape is round_one:
            with pytest.raises(InputError, match="an opening of IfcSlab 'my support': its shape is IfcCircle"):
                import_file(tmp_path / "a.ifc")
            continue
        assembly = build_assembly(parse_scene(import_file(tmp_path / "a.ifc").document))
        volume = dict(zip(assembly.elements.ids, assembly.elements.volume.tolist(), strict=True))
        assert volume == pytest.approx({"my support": 0.6 - 0.06, "ell": 0.375}, rel=1e-9)


def test_a_hole_across_the_outline_of_an_ifc_face_is_refused(tmp_path: Path) -> None:
    def crossed(make: Any) -> tuple[Any, str, str, tuple[float, ...]]:
        points, faces = frame_faces()
        points = [(x + 2.5, y, z) if k % 8 > 3 else (x, y, z) for k, (x, y, z) in enumerate(points)]
        made = [make("IfcIndexedPolygonalFaceWithVoids", [k + 1 for k in faces[0][0]], [[k + 1 for k in faces[0][1]]])]
        item = make("IfcPolygonalFaceSet", make("IfcCartesianPointList3D", points), True, made)
        return item, "frame", "IfcWall", (0.0, 0.0, 0.0)

    with pytest.raises(InputError, match="IfcWall 'frame': a hole of a face crosses its outline"):
        import_file(ifc_model(tmp_path, None, slab, crossed))


def test_densities_of_ifc_materials_come_back(tmp_path: Path) -> None:
    """Two densities and an element without mass, in kN and mm: written in kg/m³ and read to 1e-9."""
    stones = [dict(stone, density=density) for stone, density in zip(STONES, (2.0, 2.0, 2.7), strict=True)]
    document = pile([box("g", [0, 0, -1], [3, 1, 0], support=True), *stones])
    document |= {"units": {"length": "m", "force": "kN"}}
    made = layout(parse_scene(document))
    for unit in ("m", "mm", "ft"):
        path = export(made, "ifc", tmp_path / f"{unit}.ifc", cells=True, unit=unit)
        found = import_file(path)
        known = {element["id"]: element.get("density") for element in found.document["elements"]}
        assert known == {name: pytest.approx(value, rel=1e-9) for name, value in
                         {"a": 2000.0, "b": 2000.0, "c": 2700.0}.items()} | {"g": known["g"]}  # fmt: skip
        back = build_assembly(parse_scene(found.document))
        own = made.assembly.elements
        assert back.elements.mass[back.elements.free] == pytest.approx(1e3 * own.mass[own.free], rel=1e-9)
        assert "density" not in str(found.report)


def test_masses_are_kilograms_in_millimetres_and_tonnes(tmp_path: Path) -> None:
    """A stone of 1 m³ and 2 t, gravity 9810 mm/s²: IFC and glTF hold 2000 kg, in the property, material and extras."""
    pytest.importorskip("ifcopenshell")
    document = pile([box("g", [0, 0, -1e3], [1e3, 1e3, 0], support=True), box("a", [0, 0, 0], [1e3, 1e3, 1e3])])
    document |= {"units": {"length": "mm", "force": "N"}}
    document["materials"] |= {"density": 2e-9, "gravity": 9810.0}
    made = layout(parse_scene(document))
    read = import_file(export(made, "ifc", tmp_path / "a.ifc")).document
    assert [one["density"] for one in read["elements"] if not one.get("support")] == [pytest.approx(2000.0)]
    assert "IFCMASSMEASURE(2000.)" in (tmp_path / "a.ifc").read_text().upper()
    nodes = {node["name"]: node["extras"] for node in glb(export(made, "gltf", tmp_path / "a.glb"))[0]["nodes"]}
    assert (nodes["a"]["mass"], nodes["a"]["volume"]) == pytest.approx((2000.0, 1.0))


def test_ifc_densities_in_other_units(tmp_path: Path) -> None:
    """A density unit of the project in t/m³; several densities of one product are left out."""
    ifcopenshell = pytest.importorskip("ifcopenshell")
    import ifcopenshell.guid as guid

    model = ifcopenshell.open(str(ifc_model(tmp_path, "MILLI", slab, wall, block)))
    make = model.create_entity
    tonne = make("IfcSIUnit", UnitType="MASSUNIT", Prefix="MEGA", Name="GRAM")
    metre = make("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")
    powers = [make("IfcDerivedUnitElement", tonne, 1), make("IfcDerivedUnitElement", metre, -3)]
    (units,) = model.by_type("IfcUnitAssignment")
    units.Units = [*units.Units, make("IfcDerivedUnit", powers, "MASSDENSITYUNIT")]

    def material(density: float) -> Any:
        found = make("IfcMaterial", f"of {density}")
        value = make("IfcPropertySingleValue", "MassDensity", None, make("IfcMassDensityMeasure", density))
        make("IfcMaterialProperties", "Pset_MaterialCommon", None, [value], found)
        return found

    both = make("IfcMaterialList", [material(1.0), material(2.0)])
    for product, stuff in (("IfcWall", material(2.3)), ("IfcBuildingElementProxy", both)):
        make("IfcRelAssociatesMaterial", guid.new(), RelatedObjects=model.by_type(product), RelatingMaterial=stuff)
    model.write(str(tmp_path / "a.ifc"))
    found = import_file(tmp_path / "a.ifc")
    known = {element["id"]: element.get("density") for element in found.document["elements"]}
    assert known == {"my support": None, "ell": pytest.approx(2300.0), "cube": None}
    assert "density 2000" in str(found.report)


@pytest.mark.parametrize(
    ("shape", "words"), [(drum, "IfcColumn 'drum': its shape is IfcCircleProfileDef"), (ball, "IfcSphere")]
)
def test_curved_ifc_shapes_are_named(shape: Any, words: str, tmp_path: Path) -> None:
    with refused(match=words):
        import_file(ifc_model(tmp_path, None, slab, shape))


@pytest.mark.parametrize("content", [b"nonsense", b"ISO-10303-21;\nHEADER;\n", b"\xff\x00" * 100])
def test_broken_ifc(content: bytes, tmp_path: Path) -> None:
    pytest.importorskip("ifcopenshell")
    path = tmp_path / "a.ifc"
    path.write_bytes(content)
    with contextlib.ExitStack(), pytest.raises(InputError, match=r"a\.ifc") as caught:
        import_file(path)
    assert "\n" not in str(caught.value)


def glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """Document and buffer of a .glb file; its lengths have to be right."""
    data = path.read_bytes()
    magic, version, total = struct.unpack_from("<4sII", data)
    assert (magic, version, total) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    length, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    buffer = data[28 + size :]
    assert len(buffer) == length
    return json.loads(data[20 : 20 + size]), buffer


@pytest.mark.parametrize("name", CASES)
def test_gltf_has_a_mesh_for_each_block(name: str, tmp_path: Path) -> None:
    """Names, extras and closed meshes, whose volumes are those of the blocks to single precision; y is up."""
    made = layout(CASES[name](), solved=True)
    document, buffer = glb(export(made, "gltf", tmp_path / "a.glb"))
    assert document["asset"]["version"] == "2.0"
    found = {}
    low = np.full(3, np.inf)
    for node in document["nodes"]:
        attributes = document["meshes"][node["mesh"]]["primitives"][0]["attributes"]
        arrays = []
        for key in ("POSITION", "NORMAL"):
            accessor = document["accessors"][attributes[key]]
            view = document["bufferViews"][accessor["bufferView"]]
            arrays.append(np.frombuffer(buffer, "<f4", 3 * accessor["count"], view["byteOffset"]).reshape(-1, 3))
        points, normals = arrays
        corners = (points.astype(float) + node["translation"]).reshape(-1, 3, 3)
        crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", crossed, normals[::3]) > 0.0).all()
        found[node["name"]] = float(np.einsum("ij,ij->i", corners[:, 0], crossed).sum()) / 6.0
        low = np.minimum(low, corners.min(axis=(0, 1)))
        facts = node["extras"]
        assert facts["block"] == node["name"]
        assert made.result is not None
        assert facts["load_factor"] == pytest.approx(made.result.load_factor)
    assert found == pytest.approx(volumes(made), rel=1e-4)
    # the lowest point along y is the lowest along the scene's vertical axis
    assert low[1] == pytest.approx(made.assembly.elements.lower[:, -1].min(), abs=1e-5)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("kind", "ending"), [("dxf", "dxf"), ("obj", "obj"), ("stl", "stl"), ("ply", "ply"), ("3dm", "3dm")]
)
@pytest.mark.parametrize("name", ["arch", "pile"])
def test_lengths_in_another_unit(kind: str, ending: str, name: str, tmp_path: Path) -> None:
    """Written in inches and read again: the same volumes in metres; the table of blocks keeps the scene's unit."""
    pytest.importorskip({"dxf": "ezdxf", "3dm": "rhino3dm"}.get(kind, "meshio"))
    made = layout(CASES[name](), solved=True)
    table = blocks_csv(made)
    path = export(made, kind, tmp_path / f"a.{ending}", unit="in")
    given = {} if kind in ("dxf", "3dm") else {"unit": "in"}  # whose headers state it
    back = build_assembly(parse_scene(import_file(path, ImportOptions(**given, like=made.scene)).document))
    total = made.assembly.elements.volume.sum()
    assert back.elements.volume.sum() == pytest.approx(total, rel=1e-7)
    assert blocks_csv(made) == table
    if kind in ("dxf", "3dm") and name == "arch":
        assert made.result is not None
        assert solve(back).load_factor == pytest.approx(made.result.load_factor, rel=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--format", "gltf", "--unit", "mm"], "--unit: gltf has metres"),
        (["--format", "vtk", "--unit", "mm"], "--unit: vtk has the units"),
        (["--format", "step", "--unit", "ell"], "--unit: no unit is named 'ell'"),
        (["--format", "stepp"], "--format: no format is named 'stepp'"),
    ],
)
def test_wrong_units_and_formats(
    options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.out"
    done = call(monkeypatch, capsys, "export", SCENES / "spatial_cubes.json", *options, "-o", out)
    assert (done.code, done.out, done.err.count("\n"), out.exists()) == (2, "", 1, False)
    assert words in done.err


def test_a_scene_without_a_known_unit(tmp_path: Path) -> None:
    document = grid_document(["aa", "##"]) | {"units": {"length": "ell", "force": "N"}}
    made = layout(parse_scene(document))
    with pytest.raises(ParameterError, match="lengths of the scene are in 'ell'"):
        export(made, "step", tmp_path / "a.step", unit="mm")
    assert step_volumes(export(made, "step", tmp_path / "a.step").read_text()) == pytest.approx(volumes(made))


@pytest.mark.parametrize("kind", ["gltf", "step"])
def test_blocks_of_a_scene_with_members_are_written_without_them(tmp_path: Path, kind: str) -> None:
    """Orders of laying refuse members; the files leave the order out instead."""
    document = grid_document(["ab", "ab", "##"])
    ends = [{"element": name, "at": [x, 0.5]} for name, x in (("c0r1", 0.5), ("c1r1", 1.5))]
    cell = document["grid"]["cell"]
    for end in ends:
        end["at"] = [end["at"][0] * cell[0], 1.5 * cell[1]]
    document["members"] = [{"kind": "tie", "from": ends[0], "to": ends[1], "tension": 1.0}]
    scene = parse_scene(document)
    bare = parse_scene({key: value for key, value in document.items() if key != "members"})
    sizes = [export(layout(one), kind, tmp_path / f"{k}.out").stat().st_size for k, one in enumerate((bare, scene))]
    assert sizes[1] > 0.5 * sizes[0]
