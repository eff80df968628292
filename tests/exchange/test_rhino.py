"""Rhino files: round trips with labels and λ, solids of every kind, block instances, loads, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command import SCENES, call
from jld_core import InputError, Layout, build_assembly, parse_scene, samples, solve
from jld_formats import ImportOptions, export, import_file

rhino = pytest.importorskip("rhino3dm")


def test_blocks_have_layers_by_shape_and_user_text(tmp_path: Path) -> None:
    """Block, mass, mould, order of laying and λ of each block; mechanism and thrust on layers of their own."""
    scene = samples.arch(voussoirs=5)
    assembly = build_assembly(scene)
    result = solve(assembly)
    layout = Layout(scene, assembly, assembly.labels, result)
    model = rhino.File3dm.Read(str(export(layout, "3dm", tmp_path / "arch.3dm")))
    layers = {layer.Index: layer.Name for layer in model.Layers}
    assert {"SUPPORTS", "SHAPE_01", "JOINTS", "IDS", "MECHANISM", "THRUST"} <= set(layers.values())
    blocks = {b.name: b for b in layout.blocks if b.cells}
    orders = []
    for item in model.Objects:
        layer = layers[item.Attributes.LayerIndex]
        if layer.startswith("SHAPE"):
            text = dict(item.Attributes.GetUserStrings())
            block = blocks.pop(item.Attributes.Name)
            assert layer == f"SHAPE_{block.shape:02d}"
            assert float(text["mass"]) == pytest.approx(block.mass)
            assert float(text["load_factor"]) == pytest.approx(result.load_factor)
            assert text["mould"] == str(block.shape)
            assert len(text["dry_faces_to"].split()) == 2
            orders.append(int(text["order"]))
    assert blocks == {}
    assert sorted(orders) == [1, 2, 3, 4, 5]


class Model:
    """A Rhino model under construction."""

    def __init__(self, unit: str = "Meters") -> None:
        self.file = rhino.File3dm()
        self.file.Settings.ModelUnitSystem = getattr(rhino.UnitSystem, unit)
        self.layers: dict[str, int] = {}

    def attributes(self, layer: str, name: str = "", **texts: str) -> Any:
        if layer not in self.layers:
            made = rhino.Layer()
            made.Name = layer
            self.layers[layer] = self.file.Layers.Add(made)
        found = rhino.ObjectAttributes()
        found.LayerIndex, found.Name = self.layers[layer], name
        for key, value in texts.items():
            found.SetUserString(key, value)
        return found

    def brep(self, low: tuple[float, ...], high: tuple[float, ...]) -> Any:
        return rhino.Brep.CreateFromBox(rhino.Box(rhino.BoundingBox(*low, *high)))

    def box(self, layer: str, name: str, low: tuple[float, ...], high: tuple[float, ...], **texts: str) -> None:
        self.file.Objects.AddBrep(self.brep(low, high), self.attributes(layer, name, **texts))

    def curve(self, layer: str, name: str, *points: tuple[float, ...]) -> Any:
        line = rhino.Polyline(len(points))
        for point in points:
            line.Add(*point)
        found = line.ToPolylineCurve()
        self.file.Objects.AddCurve(found, self.attributes(layer, name))
        return found

    def saved(self, path: Path) -> Path:
        assert self.file.Write(str(path), 8)
        return path


def test_polysurfaces_extrusions_meshes_and_instances_are_solids(tmp_path: Path) -> None:
    """A pile in millimetres: polysurface, extrusion, mesh and a mirrored block instance; loads of three kinds."""
    model = Model("Millimeters")
    model.box("Structure::my supports", "ground", (0, 0, -100), (2000, 1000, 0))
    model.box("stones", "brep", (0, 0, 0), (1000, 1000, 1000), density="2500")
    line = rhino.Polyline(5)
    for x, y in ((1000, 0), (2000, 0), (2000, 1000), (1000, 1000), (1000, 0)):
        line.Add(x, y, 0)
    extrusion = rhino.Extrusion.Create(line.ToPolylineCurve(), 1000.0, True)
    if extrusion.GetBoundingBox().Max.Z < 1.0:
        extrusion.Translate(rhino.Vector3d(0, 0, 1000))
    model.file.Objects.AddExtrusion(extrusion, model.attributes("stones", "extrusion"))
    mesh = rhino.Mesh()
    mesh.Vertices.UseDoublePrecisionVertices = True
    corners = [(x, y, z) for z in (1000.0, 2000.0) for y in (0.0, 1000.0) for x in (0.0, 1000.0)]
    for corner in corners:
        mesh.Vertices.AddPoint3d(*corner)
    for loop in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)):
        mesh.Faces.AddFace(*loop)
    model.file.Objects.AddMesh(mesh, model.attributes("stones", "mesh"))
    prism = (model.brep((-2000, 0, 1000), (-1000, 1000, 1500)),)
    index = model.file.InstanceDefinitions.Add(
        "CAP", "", "", "", rhino.Point3d(0, 0, 0), prism, (model.attributes("stones", "cap"),)
    )
    definition = model.file.InstanceDefinitions.FindIndex(index)
    mirror = rhino.Transform.Mirror(rhino.Point3d(0, 0, 0), rhino.Vector3d(1, 0, 0))
    reference = rhino.InstanceReference(definition.Id, mirror)
    model.file.Objects.AddInstanceObject(reference, model.attributes("stones", "held"))
    model.file.Objects.AddTextDot("10 kN", rhino.Point3d(500, 500, 2000), model.attributes("LOADS"))
    model.file.Objects.AddPoint(1500, 500, 1500, model.attributes("LOADS", "", force="Fx = 1 kN; Fz = -2 kN"))
    model.curve("LOADS", "2,5 kN", (-500, 500, 500), (0, 500, 500))
    model.curve("JOINTS", "", (0, 0, 1000), (1000, 0, 1000), (1000, 1000, 1000), (0, 1000, 1000), (0, 0, 1000))
    model.curve("CRACKS", "", (1000, 0, 0), (1000, 1000, 0), (1000, 1000, 1000), (1000, 0, 1000), (1000, 0, 0))
    model.curve("notes", "", (0, 0, 0), (1, 1, 1))
    hidden = model.attributes("off")
    model.file.Layers[model.layers["off"]].Visible = False
    model.file.Objects.AddPoint(0, 0, 0, hidden)
    found = import_file(model.saved(tmp_path / "pile.3dm"))
    assembly = build_assembly(parse_scene(found.document))
    volume = dict(zip(assembly.elements.ids, assembly.elements.volume.tolist(), strict=True))
    assert volume == pytest.approx({"ground": 0.2, "brep": 1.0, "extrusion": 1.0, "mesh": 1.0, "cap": 0.5})
    assert [assembly.elements.ids[k] for k in np.flatnonzero(assembly.elements.support)] == ["ground"]
    entries = {entry["id"]: entry for entry in found.document["elements"]}
    assert entries["brep"]["density"] == 2500.0
    forces = {(load["element"], *load["force"]) for load in found.document["loads"]["live"]}
    assert forces == {("mesh", 0, 0, -1e4), ("cap", 1000, 0, -2000), ("brep", 2500, 0, 0)}
    assert found.document["labels"] == {"inner": [["brep", "extrusion"]], "dry": [["brep", "mesh"]]}
    report = str(found.report)
    for words in (
        "lengths in mm", "1 curves on layer notes", "1 objects on layer off: they or their layer are hidden",
        "live force (0, 0, -10000) N on element 'mesh' at (0.5, 0.5, 2)",
    ):  # fmt: skip
        assert words in report


@pytest.mark.parametrize("up", [1, 2])
def test_closed_planar_curves_are_planar_elements(up: int, tmp_path: Path) -> None:
    """A stone with an arc on top of a support, in the plane x–y or x–z; an opening, a text and a point as loads."""

    def at(x: float, y: float) -> tuple[float, float, float]:
        return (x, y, 0.0) if up == 1 else (x, 0.0, y)

    model = Model("Centimeters")
    model.curve("support", "base", at(0, 0), at(100, 0), at(100, -50), at(0, -50), at(0, 0))
    model.curve("stone", "arch", at(0, 0), at(100, 0), at(100, 100), at(0, 100), at(0, 0))
    model.curve("openings", "", at(40, 40), at(60, 40), at(60, 60), at(40, 60), at(40, 40))
    model.file.Objects.AddTextDot("3 kN; -4 kN", rhino.Point3d(*at(20, 100)), model.attributes("loads"))
    model.curve("loads", "2 kN", at(-50, 50), at(0, 50))
    found = import_file(model.saved(tmp_path / "a.3dm"))
    assembly = build_assembly(parse_scene(found.document))
    assert assembly.dimension == 2
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(0.96)
    assert assembly.live[:, :2].sum(axis=0) == pytest.approx([5000.0, -4000.0])
    assert f"curves in the plane x–{'xyz'[up]}" in str(found.report)
    assert "base" in assembly.elements.ids


def test_a_solid_with_an_opening(tmp_path: Path) -> None:
    """A square tube as an extrusion with an inner profile and as a polysurface: volume 9 − 1 each, on 8 of the slab."""

    def square(low: float, high: float) -> Any:
        line = rhino.Polyline(5)
        for x, y in ((low, low), (high, low), (high, high), (low, high), (low, low)):
            line.Add(x, y, 0.0)
        return line.ToPolylineCurve()

    model = Model()
    model.box("support", "g", (-1, -1, -1), (9, 4, 0))
    tube = rhino.Extrusion.Create(square(0.0, 3.0), 1.0, True)
    assert tube.AddInnerProfile(square(1.0, 2.0))
    model.file.Objects.AddExtrusion(tube, model.attributes("stones", "tube"))
    moved = tube.ToBrep(True)
    moved.Translate(rhino.Vector3d(4.0, 0.0, 0.0))
    model.file.Objects.AddBrep(moved, model.attributes("stones", "moved"))
    found = import_file(model.saved(tmp_path / "a.3dm"))
    assembly = build_assembly(parse_scene(found.document))
    volume = dict(zip(assembly.elements.ids, assembly.elements.volume.tolist(), strict=True))
    assert volume == pytest.approx({"g": 50.0, "tube": 8.0, "moved": 8.0}, rel=1e-9)
    assert assembly.interfaces.area.sum() == pytest.approx(16.0, rel=1e-9)


def ball(model: Model) -> None:
    sphere = rhino.Brep.CreateFromSphere(rhino.Sphere(rhino.Point3d(0, 0, 0), 1.0))
    model.file.Objects.AddBrep(sphere, model.attributes("stones", "ball"))


def drum(model: Model) -> None:
    base = rhino.Circle(rhino.Point3d(0, 0, 0), 1.0)
    solid = rhino.Brep.CreateFromCylinder(rhino.Cylinder(base, 2.0), True, True)
    model.file.Objects.AddBrep(solid, model.attributes("stones", "drum"))


def open_sheet(model: Model) -> None:
    line = rhino.Polyline(4)
    for point in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0)):
        line.Add(*point)
    sheet = rhino.Brep.CreateTrimmedPlane(rhino.Plane.WorldXY(), line.ToPolylineCurve())
    model.file.Objects.AddBrep(sheet, model.attributes("stones", "sheet"))


def skew(model: Model) -> None:
    model.curve("stone", "", (0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 1), (0, 0, 0))


def odd_load(model: Model) -> None:
    model.box("support", "g", (0, 0, -1), (1, 1, 0))
    model.box("stones", "s", (0, 0, 0), (1, 1, 1))
    model.file.Objects.AddTextDot("10 kN/m", rhino.Point3d(0, 0, 1), model.attributes("loads"))


def heavy(model: Model) -> None:
    model.box("stones", "s", (0, 0, 0), (1, 1, 1), density="much")


def floating(model: Model) -> None:
    model.box("stones", "s", (0, 0, 0), (1, 1, 1))


def far(model: Model) -> None:
    model.curve("stone", "", (0, 0, 0), (1e300, 0, 0), (1e300, 1e300, 0), (0, 0, 0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (ball, ["object 'ball'", "curved", "mesh it"]),
        (drum, ["object 'drum'", "curved", "mesh it"]),
        (open_sheet, ["object 'sheet'", "open"]),
        (skew, ["no plane x–y or x–z"]),
        (odd_load, ["layer 'loads'", "'10 kN/m'"]),
        (heavy, ["object 's'", "'much'"]),
        (floating, ["no support"]),
        (far, ["a.3dm"]),
        (lambda model: None, ["no solid and no curve"]),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_unreadable_files_are_refused_in_one_line(
    make: Callable[[Model], None], words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    model, out = Model(), tmp_path / "scene.json"
    make(model)
    path = model.saved(tmp_path / "a.3dm")
    done = call(monkeypatch, capsys, "import", path, "-o", out)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
    assert all(word in done.err for word in words), done.err
    assert not out.exists()


@pytest.mark.parametrize("kind", ["noise", "cut off"])
def test_broken_files(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.3dm"
    model = Model()
    floating(model)
    whole = model.saved(path).read_bytes()
    path.write_bytes(np.random.default_rng(0).bytes(5000) if kind == "noise" else whole[: len(whole) // 3])
    with pytest.raises(InputError, match=r"a\.3dm"):
        import_file(path, ImportOptions(support=("lowest",)))


def test_the_command_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import sys

    model = Model()
    floating(model)
    path = model.saved(tmp_path / "a.3dm")
    monkeypatch.setitem(sys.modules, "rhino3dm", None)
    call(monkeypatch, capsys, "import", path, "-o", tmp_path / "b.json").refused("pip install 'jld[rhino]'")
    out = tmp_path / "b.3dm"
    call(monkeypatch, capsys, "export", SCENES / "spatial_cubes.json", "--format", "3dm", "-o", out).refused(
        "pip install 'jld[rhino]'"
    )
    assert not out.exists()
