"""Files of other programs: which library reads meshes right and how fast, and how long reading and writing take.

Meshes: an L-shaped prism whose ends are faces of six corners, area 14 and volume 3, and 2 000 named boxes, read by
meshio and by trimesh. A library that cuts faces into fans gets the area of faces that are not convex wrong. Then times
of import and export beside the time of the solve that they serve, processor time, in one run; λ of what comes back;
and drawings with one habit of draughtsmen each.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import about, table, write
from jld_core import Scene, build_assembly, parse_scene, samples, solve
from jld_core.exchange import FORMATS, ImportOptions, Layout, export, import_file

ELL: Final = ((1, 2), (0, 2), (0, 0), (2, 0), (2, 1), (1, 1))
BOXES: Final = 2000


def ell_obj(path: Path) -> None:
    """The prism as OBJ: two faces of six corners and six of four."""
    count = len(ELL)
    points = [(x, y, z) for y in (0, 1) for x, z in ELL]
    loops = [tuple(range(count))[::-1], tuple(range(count, 2 * count))]
    loops += [(k, (k + 1) % count, count + (k + 1) % count, count + k) for k in range(count)]
    lines = ["g L", *(f"v {x} {y} {z}" for x, y, z in points)]
    path.write_text("\n".join(lines + ["f " + " ".join(str(i + 1) for i in loop) for loop in loops]) + "\n")


def boxes_obj(path: Path, count: int) -> None:
    """A row of named boxes."""
    faces = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    lines = []
    for k in range(count):
        lines += [f"g box {k}", *(f"v {k + i} {j} {h}" for h in (0, 1) for j in (0, 1) for i in (0, 1))]
        lines += ["f " + " ".join(str(8 * k + i + 1) for i in loop) for loop in faces]
    path.write_text("\n".join(lines) + "\n")


def timed(work: Callable[..., Any], *given: Any, **options: Any) -> tuple[float, Any]:
    """Processor time and what came out."""
    start = time.process_time()
    found = work(*given, **options)
    return time.process_time() - start, found


def of_trimesh(path: Path, many: Path) -> list[str]:
    """A row: area of the prism, names kept, time of the boxes."""
    import trimesh

    mesh: Any = trimesh.load(path, process=False, force="mesh")
    options = {"process": False, "split_groups": True, "skip_materials": True}
    spent, scene = timed(trimesh.load, many, **options)
    kept = sum(name.startswith("box ") for name in scene.geometry)
    return ["trimesh", f"{mesh.area:g}", str(kept), f"{spent:.3f}"]


def of_meshio(path: Path, many: Path) -> list[str]:
    """The same of meshio; names are in the text, of which it keeps the numbers."""
    import meshio

    mesh = meshio.read(path)
    area = 0.0
    for block in mesh.cells:
        for loop in block.data:
            arm = mesh.points[loop] - mesh.points[loop[0]]
            area += 0.5 * float(np.linalg.norm(np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0)))
    spent, found = timed(meshio.read, many)
    groups = {number for block in found.cell_data["obj:group_ids"] for number in block}
    return ["meshio", f"{area:g}", f"{len(groups)} (as numbers)", f"{spent:.3f}"]


def of_jld(path: Path, many: Path) -> list[str]:
    """What jld makes of both: the faces of one element, and the ids of all."""
    corners = [(x, y, z) for z in (-1, 0) for x, y in ((-9, 0), (9, 0), (9, 1), (-9, 1))]
    ground = "\n".join(["g support", *(f"v {x} {y} {z}" for x, y, z in corners)])
    faces = ((13, 16, 15, 14), (17, 18, 19, 20), (13, 14, 18, 17), (14, 15, 19, 18), (15, 16, 20, 19), (16, 13, 17, 20))
    whole = path.with_name("ground.obj")
    whole.write_text(path.read_text() + ground + "\n" + "\n".join("f " + " ".join(map(str, f)) for f in faces) + "\n")
    element = import_file(whole).document["elements"][0]
    points = np.array(element["vertices"])
    area = 0.0
    for loop in element["faces"]:
        arm = points[loop] - points[loop[0]]
        area += 0.5 * float(np.linalg.norm(np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0)))
    spent, found = timed(import_file, many, ImportOptions(support=("box 0",)))
    return ["jld import", f"{area:g}", str(len(found.document["elements"])), f"{spent:.3f} (with planes and contacts)"]


def round_trips(folder: Path, sizes: tuple[int, int] = (20, 12)) -> list[list[str]]:
    """Rows: time of a solve, of writing and of reading again, for a wall and a dome."""
    rows = []
    for name, scene in (
        ("wall", samples.wall(courses=sizes[0], length=0.2 * sizes[0])),
        ("dome", samples.dome(meridians=sizes[1], parallels=sizes[1] // 2)),
    ):
        assembly = build_assembly(scene)
        spent, result = timed(solve, assembly)
        layout = Layout(scene, assembly, assembly.labels, result)
        first, _ = timed(getattr, layout, "blocks")
        for kind, ending in FORMATS.items():
            if kind == "svg" and assembly.dimension == 3:
                continue
            path = folder / f"{name}{ending}"
            out, _ = timed(export, layout, kind, path)
            back = "–"
            if kind not in ("3dec", "vtk", "step", "gltf") and not (kind == "dxf" and assembly.dimension == 3):
                into, found = timed(import_file, path, ImportOptions(like=scene))
                back = f"{into:.3f}"
                assert len(found.document["elements"]) == len(layout.blocks)
                parse_scene(found.document)
            size = f"{path.stat().st_size / 1024:.0f}"
            count = str(len(assembly.elements))
            rows.append([name, count, f"{spent:.3f}", f"{first:.3f}", kind, size, f"{out:.3f}", back])
    return rows


ROUND: Final[dict[str, Callable[[], Scene]]] = {
    "wall": lambda: samples.wall(bond="flemish", courses=4, length=1.2),
    "arch": lambda: samples.arch(rings=2, bond="running", load="quarter"),
    "cross vault": lambda: samples.vault("cross", voussoirs=4, courses=2),
    "dome": lambda: samples.dome(meridians=6),
    "barrel vault": lambda: samples.vault("barrel", voussoirs=6, courses=2),
}


def whole_trips(folder: Path) -> list[list[str]]:
    """Rows: names, labels and λ of scenes that come back whole, every fifth face inner where the format has labels."""
    rows = []
    for name, make in ROUND.items():
        scene = make()
        assembly = build_assembly(scene)
        for kind in ("dxf", "3dm", "compas", "compas_dem"):
            planar = assembly.dimension == 2
            if kind == "dxf" and not planar:
                continue
            labels = np.ones_like(assembly.labels)
            if kind != "compas_dem":
                labels[::5] = False
            result = solve(assembly, labels)
            layout = Layout(scene, assembly, labels, result)
            cells = kind.startswith("compas") or not planar
            path = export(layout, kind, folder / f"whole{FORMATS[kind]}", cells=cells)
            back = build_assembly(parse_scene(import_file(path).document))
            ids = set(back.elements.ids) == set(assembly.elements.ids)
            same = int(back.labels.sum()) == int(labels.sum()) and len(back.labels) == len(labels)
            apart = abs(solve(back).load_factor / result.load_factor - 1.0)
            words = [name, kind, str(len(assembly.elements)), str(len(labels)), "yes" if ids else "no"]
            rows.append([*words, "yes" if same else "no", f"{result.load_factor:.6g}", f"{apart:.0e}"])
    return rows


def _box(space: Any, x0: float, y0: float, x1: float, y1: float, layer: str = "0") -> None:
    """An outline of four corners."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})


def mirrored(document: Any, space: Any) -> None:
    block = document.blocks.new("STONE")
    block.add_lwpolyline([(0, 0), (1, 0), (1, 1), (0, 0.8)], close=True)
    space.add_blockref("STONE", (0, 0))
    space.add_blockref("STONE", (2, 0), dxfattribs={"xscale": -1})


def past_start(_: Any, space: Any) -> None:
    space.add_lwpolyline([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0)])
    space.add_lwpolyline([(1, 0), (2, 0), (2, 1), (1, 1), (1, 0), (2, 0)])


def window(_: Any, space: Any) -> None:
    _box(space, 0, 0, 2, 1)
    _box(space, 0.5, 0.4, 1, 0.8, "WINDOWS")


def beside(_: Any, space: Any) -> None:
    _box(space, 0, 0, 1, 1)
    for ends in (((1, 0), (2, 0)), ((2, 0), (2, 1)), ((2, 1), (1, 1))):
        space.add_line(*ends)


def hidden(document: Any, space: Any) -> None:
    document.layers.add("OLD").freeze()
    _box(space, 0, 0, 2, 1)
    _box(space, 0, 0, 2, 2, "OLD")


def gaps(_: Any, space: Any) -> None:
    _box(space, 0, 0.0003, 0.9996, 1)
    _box(space, 1, 0, 2, 1.0004)


def twice(_: Any, space: Any) -> None:
    for _k in range(2):
        _box(space, 0, 0, 2, 1)


def cases(_: Any, space: Any) -> None:
    _box(space, 0, 0, 2, 1)
    for k in (1, 2):
        space.add_line((k - 0.5, 2), (k - 0.5, 1), dxfattribs={"layer": f"LOAD {k}"})
        space.add_text(f"{k},5 kN", dxfattribs={"layer": f"LOAD {k}", "insert": (k - 0.5, 1.5)})


HABITS: Final[dict[str, tuple[Callable[[Any, Any], None], float]]] = {
    "mirrored block": (mirrored, 1.8),
    "outlines past their start": (past_start, 2.0),
    "window on a layer": (window, 1.8),
    "stone of single lines": (beside, 2.0),
    "frozen layer": (hidden, 2.0),
    "gaps of 0.4 mm": (gaps, 2.0),
    "drawn twice": (twice, 2.0),
    "load cases by layer": (cases, 2.0),
}
"""Drawings with one habit each, and the area of the stones that is meant."""


def habits(folder: Path) -> list[list[str]]:
    """Rows: elements, area and faces that are read of each drawing, and what the report says of it."""
    ezdxf: Any = import_module("ezdxf")

    rows = []
    for name, (make, area) in HABITS.items():
        document = ezdxf.new()
        document.header["$INSUNITS"] = 6
        _box(document.modelspace(), 0, -1, 2, 0, "SUPPORT")
        make(document, document.modelspace())
        path = folder / "habit.dxf"
        document.saveas(path)
        spent, found = timed(import_file, path)
        assembly = build_assembly(parse_scene(found.document))
        free = assembly.elements.free
        read = assembly.elements.volume[free].sum()
        told = [*found.report.snapped, *found.report.skipped, *(s for s in found.report.found if "case" in s)]
        faces = str(len(assembly.interfaces))
        rows.append([name, str(len(free)), f"{read:.4g} ({area:g})", faces, f"{spent:.3f}", "; ".join(told[:2]) or "–"])
    return rows


def main() -> None:
    """Measure both and write benchmarks/results/exchange.md."""
    parts = ["# Files of other programs", about(__doc__)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ell, many = folder / "ell.obj", folder / "boxes.obj"
        ell_obj(ell)
        boxes_obj(many, BOXES)
        readers = [of_meshio(ell, many), of_jld(ell, many)]
        if find_spec("trimesh") is not None:
            readers.insert(1, of_trimesh(ell, many))
        head = ["reader", "area of the L (14)", "names of 2 000 boxes", "2 000 boxes, s"]
        parts.append(table(head, readers))
        note = (
            "jld takes the names from the text and the faces from meshio. STL it reads itself: meshio loses the names "
            "of solids and fails on the ASCII files that trimesh writes."
        )
        parts.append(note)
        head = ["scene", "elements", "solve, s", "blocks and shapes, s", "format", "size, KiB", "write, s", "read, s"]
        parts.append(table(head, round_trips(folder)))
        parts.append("Scenes that come back whole, spatial ones with `--cells`, nothing told to the reader:")
        head = ["scene", "format", "elements", "faces", "names kept", "labels kept", "λ", "λ back / λ − 1"]
        parts.append(table(head, whole_trips(folder)))
        parts.append("Drawings as they are made, read without options:")
        head = ["drawing", "elements", "area (meant)", "faces", "read, s", "report"]
        parts.append(table(head, habits(folder)))
    write("exchange", "\n\n".join(parts), also=("ezdxf", "meshio", "trimesh", "rhino3dm", "ifcopenshell"))


if __name__ == "__main__":
    main()
