"""Solids in: COMPAS JSON, OBJ, PLY and STL, of other programs and of our own making; broken ones get one line."""

from __future__ import annotations

import json
import resource
import struct
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from command import call
from jld_core import Assembly, InputError, build_assembly, parse_scene, solve
from jld_core.scene import units
from jld_formats import ImportOptions, import_file

pytest.importorskip("meshio")
DATA = Path(__file__).parent / "data"
CUBE = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def corners(x: float, y: float, z: float) -> list[tuple[float, float, float]]:
    return [(x + i, y + j, z + k) for k in (0, 1) for j in (0, 1) for i in (0, 1)]


PILE = {"support": corners(0, 0, 0), "middle": corners(0.25, 0, 1), "top": corners(0, 0.25, 2)}


def built(path: Path, **options: object) -> Assembly:
    return build_assembly(parse_scene(import_file(path, ImportOptions(**options)).document))  # type: ignore[arg-type]


def obj(path: Path, mark: str = "g", faces: tuple[tuple[int, ...], ...] = CUBE) -> None:
    lines = []
    for k, (name, points) in enumerate(PILE.items()):
        lines += [f"{mark} {name}", *(f"v {x!r} {y!r} {z!r}" for x, y, z in points)]
        lines += ["f " + " ".join(str(8 * k + index + 1) for index in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def ply(path: Path) -> None:
    points = [p for c in PILE.values() for p in c]
    faces = [[8 * k + i for i in face] for k in range(3) for face in CUBE]
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points)
    path.write_text(head + body + "".join(f"{len(f)} {' '.join(map(str, f))}\n" for f in faces))


def stl(path: Path) -> None:
    """Binary: no names, no groups, triangles one after the other; the cubes share corners and coordinates."""
    triangles = []
    for points in PILE.values():
        for a, b, c, d in CUBE:
            triangles += [[points[i] for i in (a, b, c)], [points[i] for i in (a, c, d)]]
    body = b"".join(struct.pack("<12fH", *([0.0] * 3), *np.ravel(t), 0) for t in triangles)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + body)


@pytest.mark.parametrize(("make", "ending"), [(obj, "obj"), (ply, "ply"), (stl, "stl")])
def test_three_cubes_in_every_mesh_format(make: object, ending: str, tmp_path: Path) -> None:
    """One solid for each group or closed part, its twelve triangles six plane faces, and λ = 0.25 by tipping.

    The pile of the upper two tips about an edge of the lowest at (weights 1, arms 0.75 and 0.5 …): worked out by hand.
    """
    path = tmp_path / f"pile.{ending}"
    make(path)  # type: ignore[operator]
    named = ending == "obj"
    found = import_file(path, ImportOptions(support=() if named else ("lowest",)))
    assembly = build_assembly(parse_scene(found.document))
    assert assembly.elements.support.tolist() == [True, False, False]
    assert assembly.elements.volume == pytest.approx([1.0] * 3, rel=1e-6)
    assert [len(faces) for faces in assembly.elements.faces] == [6] * 3
    assert len(assembly.interfaces) == 2
    if named:
        assert assembly.elements.ids == ("support", "middle", "top")
    # about x = 1 of the lowest cube: centroids at 0.75 and 0.5, 0.5 and 1.5 above the joint
    assert solve(assembly).load_factor == pytest.approx((0.25 + 0.5) / (0.5 + 1.5), rel=1e-6)


def test_objects_of_an_obj_are_groups_too(tmp_path: Path) -> None:
    obj(tmp_path / "pile.obj", "o")
    assert built(tmp_path / "pile.obj").elements.ids == ("support", "middle", "top")


def test_inside_out_and_units(tmp_path: Path) -> None:
    """Faces the wrong way round are turned, and said; millimetres become metres."""
    path = tmp_path / "pile.obj"
    obj(path, faces=tuple(face[::-1] for face in CUBE))
    found = import_file(path, ImportOptions(unit="mm"))
    assert any("inside out" in text for text in found.report.skipped)
    assert build_assembly(parse_scene(found.document)).elements.volume == pytest.approx([1e-9] * 3)


LIKE = {
    "elements": [
        {"id": name, "vertices": points, "faces": CUBE, "support": name == "support"} for name, points in PILE.items()
    ],
    "materials": {
        "density": 2000.0,
        "dry": {"friction_coefficient": 0.6, "cohesion": 2e3},
        "inner": {"tensile_strength": {"nominal": 2e4, "low": 1e4}, "shear_strength": 5e4},
    },
    "labels": {"inner": [["middle", "top"]]},
    "loads": {"dead": [{"body": [0, 0, -1]}], "live": [{"element": "top", "force": [1e3, 0, 0], "at": [0.5, 0.75, 3]}]},
    "search": {"block_mass": [None, 4000], "block_extent": [None, 2.5]},
}


@pytest.mark.parametrize(
    ("force", "length", "gravity"),
    [("kN", "m", 9.81), ("N", "mm", 9.81), ("kN", "mm", 9810.0), ("kip", "ft", 9.81 / 0.3048)],
)
def test_what_is_taken_over_is_turned_to_the_units_of_the_file(
    force: str, length: str, gravity: float, tmp_path: Path
) -> None:
    """The numbers of a scene in other units mean the same in the scene of a file: λ, dead loads left out, is one."""
    n, m = units.NEWTONS[force], units.METRES[length]
    like = json.loads(json.dumps(LIKE)) | {"units": {"force": force, "length": length}}
    for element in like["elements"]:
        element["vertices"] = [[x / m for x in point] for point in element["vertices"]]
    si = gravity * n / 9.81 / m**3  # kg/m³ of a density of 1
    like["materials"] |= {"density": 2000.0 / si, "gravity": gravity}
    like["materials"]["dry"]["cohesion"] *= m**2 / n
    inner = like["materials"]["inner"]
    inner["shear_strength"] *= m**2 / n
    inner["tensile_strength"] = {key: value * m**2 / n for key, value in inner["tensile_strength"].items()}
    load = like["loads"]["live"][0]
    load |= {"force": [1e3 / n, 0, 0], "at": [x / m for x in load["at"]]}
    like["search"] = {"block_mass": [None, 4000 / si / m**3], "block_extent": [None, 2.5 / m]}
    obj(tmp_path / "pile.obj")
    read = [import_file(tmp_path / "pile.obj", ImportOptions(unit="m", like=parse_scene(one))) for one in (LIKE, like)]
    stated, found = (parse_scene(one.document) for one in read)
    assert solve(found).load_factor == pytest.approx(solve(stated).load_factor, rel=1e-9)
    assert found.materials.density == pytest.approx(2000.0)
    assert found.search.block_mass[1] == pytest.approx(4000.0)  # type: ignore[index]
    assert found.search.block_extent[1] == pytest.approx(2.5)  # type: ignore[index]
    assert any("loads.dead is not taken over" in text for text in read[1].report.assumed)
    assert any(f"turned from {force} and {length} to N and m" in text for text in read[1].report.found)


def test_units_without_a_name_are_taken_over_with_a_file_that_names_none(tmp_path: Path) -> None:
    like = parse_scene(LIKE | {"units": {"force": "blocks", "length": "cubits"}})
    obj(tmp_path / "pile.obj")
    found = import_file(tmp_path / "pile.obj", ImportOptions(like=like))
    assert found.document["units"] == {"force": "blocks", "length": "cubits"}
    assert found.report.assumed[0].startswith("lengths in cubits")
    with pytest.raises(InputError, match="its numbers are in blocks and cubits, those of the file in N and m"):
        import_file(tmp_path / "pile.obj", ImportOptions(like=like, unit="mm"))


def test_loads_on_patches_are_not_asked_for_their_elements(tmp_path: Path) -> None:
    patch = [[0.25, 0.0, 1.1], [0.25, 1.0, 1.1], [0.25, 1.0, 1.9], [0.25, 0.0, 1.9]]
    live = [{"face": {"patch": patch}, "pressure": 500.0}]
    like = parse_scene(LIKE | {"loads": {"live": live}})
    obj(tmp_path / "pile.obj")
    assert import_file(tmp_path / "pile.obj", ImportOptions(like=like)).document["loads"]["live"] == live


def test_shapes_of_trimesh_are_read(tmp_path: Path) -> None:
    """A cylinder on a box, as trimesh writes them: the curved side faceted, the ends one plane face each."""
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((3.0, 3.0, 1.0))
    drum = trimesh.creation.cylinder(1.0, 2.0, sections=24)
    drum.apply_translation((0.0, 0.0, 1.5))
    for ending in ("obj", "ply", "stl", "stl_ascii"):
        path = tmp_path / f"drum.{ending[:3]}"
        (box + drum).export(path, file_type=ending)
        assembly = built(path, support=("lowest",))
        assert [len(faces) for faces in assembly.elements.faces] == [6, 26]
        exact = 0.5 * 24 * np.sin(2.0 * np.pi / 24)
        assert assembly.interfaces.area == pytest.approx([exact], rel=1e-5)


def test_a_curved_contact_is_facets_that_a_label_holds_together(tmp_path: Path) -> None:
    """A half drum in its trough: one pair, as many facets as the drum has, all labelled by the pair."""
    angles = np.linspace(np.pi, 2.0 * np.pi, 9)
    arc = np.column_stack([np.cos(angles), np.sin(angles)])
    bowl = np.vstack([arc, [[1.5, 0.0], [1.5, -1.5], [-1.5, -1.5], [-1.5, 0.0]]])
    drum = arc

    def prism(outline: np.ndarray, start: int) -> tuple[list[str], list[str]]:
        n = len(outline)
        points = [f"v {x!r} {y!r} {z!r}" for y in (0.0, 1.0) for x, z in outline.tolist()]
        sides = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
        loops = [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides]
        return points, ["f " + " ".join(str(start + i + 1) for i in loop) for loop in loops]

    first, second = prism(bowl, 0), prism(drum, 2 * len(bowl))
    text = ["g support", *first[0], *first[1], "g drum", *second[0], *second[1]]
    path = tmp_path / "drum.obj"
    path.write_text("\n".join(text))
    found = import_file(path)
    assert any("1 pair touches along 8 facets" in text for text in found.report.found)
    found.document["labels"] = {"inner": [["support", "drum"]]}
    assembly = build_assembly(parse_scene(found.document))
    assert len(assembly.interfaces) == 8
    assert not assembly.labels.any()


def test_compas_dem_models_with_their_contacts() -> None:
    """Written by compas_dem 0.6: three unit cubes, the lowest a support, contacts as FrictionContact."""
    path = DATA / "compas_dem_pile.json"
    found = import_file(path)
    assert "2 interfaces as the file gives them" in found.report.found
    assembly = build_assembly(parse_scene(found.document))
    assert assembly.elements.support.tolist() == [True, False, False]
    # sides of 1, two of them: λ = ½ / 1
    assert solve(assembly).load_factor == pytest.approx(0.5, rel=1e-8)


SAMPLES = {
    "cubes": (3, 2), "bridge": (16, 37), "H": (3, 2), "A": (3, 2), "shelf": (11, 19), "shelf-stable": (9, 15),
    "snake": (4, 6), "armadillo_cra": (399, 1014),
    "cube-curve-short": (2, 72), "curve-3-blocks": (3, 40), "type-a": (3, 2),
}  # fmt: skip
"""Blocks and interfaces of what compas_cra ships; where it stores interfaces, as many as it stores."""


@pytest.mark.skipif(find_spec("compas_cra") is None, reason="compas_cra is not installed")
@pytest.mark.parametrize("name", SAMPLES)
def test_samples_of_compas_cra(name: str) -> None:
    place = find_spec("compas_cra")
    assert place is not None
    path = Path(str(place.origin)).parent / "data" / "samples" / f"{name}.json"
    found = import_file(path, ImportOptions(support=("lowest",)))
    assembly = build_assembly(parse_scene(found.document))
    assert (len(assembly.elements), len(assembly.interfaces)) == SAMPLES[name]
    assert found.report.largest < 1e-3


def triangle(path: Path) -> None:
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")


def moebius(path: Path) -> None:
    """Non-manifold: three faces at one edge."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 0 -1\nf 1 2 3\nf 1 2 4\nf 1 2 5\nf 1 3 4\nf 2 3 4\n"
    path.write_text(text)


def out_of_range(path: Path) -> None:
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n")


def nan(path: Path) -> None:
    obj(path)
    path.write_text(path.read_text().replace("v 0 0 0", "v nan 0 0", 1))


def overlapping(path: Path) -> None:
    obj(path)
    path.write_text(path.read_text().replace("1.25", "1.5").replace("0.25", "0.5"))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line.replace(" 2", " 1.5") if line.endswith(" 2") else line for line in lines))


def promising(path: Path) -> None:
    """Four thousand million triangles in a file of a hundred bytes."""
    path.write_bytes(b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 16)


def boasting(path: Path) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty double x\nend_header\n"
    path.write_text(head)


def cut_off(path: Path) -> None:
    stl(path)
    path.write_bytes(path.read_bytes()[:-70])


def endless(path: Path) -> None:
    path.write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 250_000)


def noise(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(5_000))


@pytest.mark.parametrize(
    ("make", "ending", "words"),
    [
        (triangle, "obj", ["do not close"]),
        (moebius, "obj", ["do not close"]),
        (out_of_range, "obj", ["names vertex 99", "1 to 3"]),
        (nan, "obj", ["no number"]),
        (overlapping, "obj", ["overlap"]),
        (endless, "obj", ["too many faces"]),
        (noise, "obj", ["bad.obj"]),
        (noise, "ply", ["PLY header"]),
        (noise, "stl", ["promises"]),
        (boasting, "ply", ["promises 99999999999"]),
        (promising, "stl", ["promises 4000000000"]),
        (cut_off, "stl", ["a whole file"]),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_hostile_meshes(
    make: object, ending: str, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    path, out = tmp_path / f"bad.{ending}", tmp_path / "scene.json"
    make(path)  # type: ignore[operator]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    done = call(monkeypatch, capsys, "import", path, "-o", out, "--support", "lowest", "--support", "support")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
    assert all(word in done.err for word in words), done.err
    assert not out.exists()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # KiB


def graph(**node: object) -> dict[str, object]:
    data = {"attributes": {"name": "x"}, "graph": {"node": {"0": node}, "edge": {}}}
    return {"dtype": "compas_assembly.datastructures/Assembly", "data": data}


BLOCK = {"data": {"vertex": {"0": {"x": 0, "y": 0, "z": 0}}, "face": {"0": [0, 1, 2]}}, "dtype": "Block"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", ["not JSON", "line 1"]),
        ("[]", ["COMPAS"]),
        ('{"data": NaN}', ["NaN"]),
        ("[" * 100_000, ["nested too deeply"]),
        (json.dumps({"name": "a scene"}), ["no COMPAS assembly"]),
        (json.dumps(graph()), ["no COMPAS assembly"]),
        (json.dumps(graph(block=None)), ["node 0", "no block"]),
        (json.dumps(graph(block=BLOCK)), ["no COMPAS assembly"]),
        (b"\x81\xfe{}", ["UTF-8"]),
    ],
)
def test_hostile_compas(text: str | bytes, words: list[str], tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        import_file(path, ImportOptions(support=("lowest",)))
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    ply(tmp_path / "pile.ply")
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(InputError, match=r"pip install 'jld\[mesh\]'"):
        import_file(tmp_path / "pile.ply")
