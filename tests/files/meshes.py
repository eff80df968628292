"""OBJ, STL and PLY as Blender, Rhino, SketchUp, MeshLab and scanners write them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import trimesh

from files.buildings import CUBE, corners
from files.make import File

Points = list[tuple[float, float, float]]
PILE: dict[str, Points] = {
    "support": corners((0, 0, -0.3), (1, 1, 0)),
    "b1": corners((0, 0, 0), (1, 1, 0.5)),
    "b2": corners((0, 0, 0.5), (1, 1, 1)),
}


def whole(path: Path) -> float:
    """Return the volume of all solids of a file by trimesh."""
    found = trimesh.load(path, process=False)
    parts = found.geometry.values() if isinstance(found, trimesh.Scene) else [found]
    return float(sum(abs(part.volume) for part in parts))


def obj(
    mark: str = "o",
    vertex: Callable[[Points], Iterator[str]] | None = None,
    face: Callable[[list[int]], str] | None = None,
    extra: str = "",
    size: float = 1.0,
    up: str = "z",
) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        lines, start = ["# Blender 4.2.0", "# www.blender.org", "mtllib pile.mtl"], 1
        for name, points in PILE.items():
            places = [tuple(size * v for v in (p if up == "z" else (p[0], p[2], -p[1]))) for p in points]
            lines += [mark.format(name) if "{" in mark else f"{mark} {name}"]
            lines += list(vertex(places)) if vertex else [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in places]
            lines += ["s off", "usemtl Stone", *extra.splitlines()]
            for loop in CUBE:
                numbers = [start + index for index in loop]
                lines.append(face(numbers) if face else "f " + " ".join(map(str, numbers)))
            start += len(points)
        path.write_text("\n".join(lines) + "\n")

    return write


def _triangles() -> Iterator[tuple[str, Points]]:
    for name, points in PILE.items():
        for a, b, c, d in CUBE:
            yield name, [points[a], points[b], points[c]]
            yield name, [points[a], points[c], points[d]]


def _stl(path: Path) -> None:
    lines, last = [], ""
    for name, triangle in _triangles():
        if name != last:
            lines += [f"endsolid {last}"] * bool(last) + [f"solid {name}"]
            last = name
        lines += ["facet normal 0 0 0", "  outer loop", *(f"    vertex {x:e} {y:e} {z:e}" for x, y, z in triangle)]
        lines += ["  endloop", "endfacet"]
    path.write_text("\n".join([*lines, f"endsolid {last}"]) + "\n")


def _binary(path: Path) -> None:
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(triangle), 0) for _, triangle in _triangles())
    path.write_bytes(b"Exported from Blender-4.2.0".ljust(80, b"\0") + struct.pack("<I", len(body) // 50) + body)


def _part(path: Path) -> None:
    """One solid alone, with the rounding of a plane cut."""
    points = [tuple(1.9e-32 if v == 0 else v for v in p) for p in PILE["b1"]]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points]
    path.write_text("\n".join([*lines, *("f " + " ".join(str(k + 1) for k in loop) for loop in CUBE)]) + "\n")


def _ply(*, binary: bool) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        points = [p for places in PILE.values() for p in places]
        faces = [[8 * k + i for i in loop] for k in range(3) for loop in CUBE]
        kind = "binary_little_endian" if binary else "ascii"
        head = f"ply\nformat {kind} 1.0\ncomment Created in Blender version 4.2.0\nelement vertex {len(points)}\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz")
        head += f"element face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
        if binary:
            body = b"".join(struct.pack("<3f", *p) for p in points)
            path.write_bytes(head.encode() + body + b"".join(struct.pack("<B4I", 4, *f) for f in faces))
        else:
            text = "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in points)
            path.write_text(head + text + "".join(f"4 {' '.join(map(str, f))}\n" for f in faces))

    return write


def files() -> list[File]:
    def coloured(points: Points) -> Iterator[str]:
        return (f"v {x} {y} {z} 0.8 0.8 0.8" for x, y, z in points)

    def weighted(points: Points) -> Iterator[str]:
        return (f"v {x} {y} {z} 1.0" for x, y, z in points)

    def spiked(n: list[int]) -> str:
        return f"f {n[0]} {n[1]} {n[2]} {n[3]}\nf {n[3]} {n[3]} {n[0]}\nf {n[0]} {n[1]} {n[0]}"

    normals = "\n".join(f"vn {n}" for n in ("0 0 -1", "0 0 1", "0 -1 0", "1 0 0", "0 1 0", "-1 0 0"))
    textures = "\n".join(f"vt {u} {v}" for u in (0, 1) for v in (0, 1, 0.5))
    both = f"{normals}\n{textures}"
    table: list[tuple[str, str, Callable[[Path], None]]] = [
        ("plain", "Blender 4.2", obj()),
        ("normals", "Blender 4.2", obj(extra=normals, face=lambda n: "f " + " ".join(f"{k}//1" for k in n))),
        ("textures", "Blender 4.2", obj(extra=textures, face=lambda n: "f " + " ".join(f"{k}/1" for k in n))),
        ("both", "Blender 4.2", obj(extra=both, face=lambda n: "f " + " ".join(f"{k}/1/1" for k in n))),
        ("continued", "Rhino 8", obj(face=lambda n: f"f {n[0]} {n[1]} \\\n{n[2]} {n[3]}")),
        ("comments", "SketchUp", obj(face=lambda n: "f " + " ".join(map(str, n)) + " # a face")),
        ("relative", "SketchUp", obj(face=lambda n: "f " + " ".join(str((k - 1) % 8 - 8) for k in n))),
        ("groups", "Rhino 8", obj(mark="g")),
        ("layers", "Rhino 8", obj(mark="g LAYER\no {}")),
        ("one_object", "3ds Max", obj(mark="o model\ng {}")),
        ("coloured", "MeshLab", obj(vertex=coloured)),
        ("weighted", "MeshLab", obj(vertex=weighted)),
        ("repeated", "Blender 4.2", obj(face=lambda n: f"f {n[0]} {n[0]} {n[1]} {n[2]} {n[3]}")),
        ("spiked", "Blender 4.2", obj(face=spiked)),
        ("triangles", "SketchUp", obj(face=lambda n: f"f {n[0]} {n[1]} {n[2]}\nf {n[0]} {n[2]} {n[3]}")),
        ("inside_out", "SketchUp", obj(face=lambda n: "f " + " ".join(map(str, n[::-1])))),
    ]  # fmt: skip
    quiet = (
        "comments",
        "continued",
        "repeated",
        "spiked",
        "relative",
        "layers",
        "groups",
        "one_object",
    )  # trimesh reads them otherwise
    found = [
        File(f"{name}.obj", program, write, 2, 1.0, whole=None if name in quiet else whole)
        for name, program, write in table
    ]
    y_up = obj(up="y")
    return [
        *found,
        File("y_up.obj", "Blender 4.2", y_up, 2, 1.0, options={"up": "y"}),
        File("y_up_unsaid.obj", "Blender 4.2", y_up, 2, 1.0, doubtful="--up y"),
        File("millimetres.obj", "SketchUp", obj(size=1000.0), 2, 1e9, doubtful="--unit mm"),
        File("named.stl", "FreeCAD", _stl, 2, 1.0),
        File("binary.stl", "Blender 4.2", _binary, 2, 1.0, options={"support": ("lowest",)}, whole=whole),
        File("ascii.ply", "Blender 4.2", _ply(binary=False), 2, 1.0, options={"support": ("lowest",)}, whole=whole),
        File("binary.ply", "Blender 4.2", _ply(binary=True), 2, 1.0, options={"support": ("lowest",)}, whole=whole),
        File("part.obj", "Blender 4.2", _part, 1, 0.5, options={"support": ("lowest",)}),
    ]
