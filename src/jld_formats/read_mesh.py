"""Reader and writer of OBJ, STL and PLY: one solid per group or closed part.

Faces keep any number of corners: fans are wrong for those that are not convex (docs/notes/tried.md).
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path as File
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError, Layout
from jld_core.geometry import Faces, snapping, unions
from jld_formats.drawn_loads import MOST, Drawing
from jld_formats.libraries import decoded, library, parsing, readable, text_of
from jld_formats.options import ImportOptions, Notes
from jld_formats.paths import Path
from jld_formats.solids import Part, Solids, split, with_own_points


def read_mesh(path: File, options: ImportOptions, notes: Notes) -> Solids:
    """Read the solids of an OBJ, PLY or STL file: one per group or closed part."""
    kind = path.suffix.lower().lstrip(".")
    data = readable(path).read_bytes().removeprefix(codecs.BOM_UTF8)
    _refuse_counts(kind, data)
    if kind == "obj":
        points, groups = _obj(decoded(data, "replace"), options, notes)
    elif kind == "stl":
        with parsing("STL", "a file in STL"):
            points, groups = _stl(data)
    else:
        meshio = library("meshio", path)
        with parsing("PLY", "a file in PLY"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # meshio overflows where it takes a text for a count
            points, groups = _ply(meshio, data)
    if sum(len(faces) for *_, faces in groups) > MOST:
        raise InputError("", "it holds too many faces", f"at most {MOST}")
    if not np.isfinite(points).all():
        raise InputError("", "it holds a coordinate that is no number", "finite numbers only")
    parts = [
        part for name, layer, faces in groups for part in _parts(name, layer, points, _without_repeats(faces, notes))
    ]
    if not parts:
        raise InputError("", "it holds no faces", "closed surfaces, one for each block")
    comments = re.findall(rb"(?m)^comment block \d+ (.*?)\r?$", data) if kind == "ply" else []
    if len(comments) == len(parts):  # names written by jld
        words = [word.decode("utf-8", "replace") for word in comments]
        parts = [Part(word, word, part.vertices, part.faces) for word, part in zip(words, parts, strict=True)]
    notes.found.append(f"{len(groups)} groups" if len(groups) > 1 else "one group, by closed part")
    return Solids(parts, name=path.stem)


def _without_repeats(faces: Faces, notes: Notes) -> Faces:
    """Return faces without corners named twice in a row, and without those that then enclose no area."""
    short = [tuple(snapping.without_spikes(loop, closed=True)) for loop in faces]
    faces_kept = tuple(loop for loop in short if len(loop) > 2)
    notes.skip("faces", len(short) - len(faces_kept), "they name a corner twice and enclose no area")
    return faces_kept


def _parts(name: str, layer: str, points: Floats, faces: Faces) -> list[Part]:
    """Split the faces of one group into named solids; InputError for a vertex that does not exist."""
    if not faces:
        return []
    top = max(max(loop) for loop in faces)
    if top >= len(points) or min(min(loop) for loop in faces) < 0:
        raise InputError(f"group {name!r}" if name else "", f"a face names vertex {top + 1}", f"1 to {len(points)}")
    used, loops = with_own_points(points, faces)
    solids = split(used, loops, 1e-9 * float(np.ptp(used, axis=0).max()))
    parts = []
    for k, solid in enumerate(solids, 1):
        if not name:
            title = f"b{k}"
        else:
            title = name if len(solids) == 1 else f"{name}.{k}"
        parts.append(Part(title, layer, *with_own_points(points, (faces[face] for face in solid.tolist()))))
    return parts


def _cells(mesh: Any) -> list[tuple[int, ...]]:
    """Return the triangles, quadrilaterals and polygons of a meshio mesh, in file order."""
    loops_of_blocks = [block.data.tolist() for block in mesh.cells if block.type in ("triangle", "quad", "polygon")]
    return [tuple(loop) for loops in loops_of_blocks for loop in loops]


def _obj(text: str, options: ImportOptions, notes: Notes) -> tuple[Floats, list[tuple[str, str, Faces]]]:
    """Read points (n, 3), and name, layer and faces of each group of an OBJ text; InputError names the line."""
    points: list[tuple[float, float, float]] = []
    faces: dict[tuple[str, str], list[tuple[int, ...]]] = {}
    name_of = {"o": "", "g": ""}
    lines = enumerate(text.splitlines(), 1)
    for number, line in lines:
        notes.reached("lines", number)
        while line.rstrip().endswith("\\"):  # it goes on in the next line
            line = line.rstrip()[:-1] + " " + next(lines, (0, ""))[1]
        key, *words = line.partition("#")[0].split() or [""]
        try:
            if key == "v":
                x, y, z = map(float, words[:3])
                points.append((x, y, z))
            elif key == "f":
                corners = [int(word.partition("/")[0]) for word in words]
                loop = tuple(c - 1 if c > 0 else len(points) + c for c in corners)
                if len(loop) < 3 or 0 in corners or min(loop) < 0:
                    raise ValueError
                faces.setdefault((name_of["o"], name_of["g"]), []).append(loop)
            elif key in name_of:
                name_of[key] = " ".join(words)
        except ValueError:
            noun, expected = (
                ("vertex", "three numbers") if key == "v" else ("face", "at least three numbers of vertices")
            )
            raise InputError(f"line {number}", f"{' '.join(words)[:40]!r} is no {noun}", expected) from None
    # one object around all groups is the model; else objects are the blocks and groups their layers
    several_objects = len({o for o, _ in faces}) > 1
    return np.array(points, dtype=float).reshape(-1, 3), [
        (o if (several_objects and o) or not g else g, options.group(g if several_objects else o, o, g), tuple(loops))
        for (o, g), loops in faces.items()
    ]


def _ply(meshio: Any, data: bytes) -> tuple[Floats, list[tuple[str, str, Faces]]]:
    mesh = meshio.ply._ply.read_buffer(io.BytesIO(data))
    return np.asarray(mesh.points, dtype=float), [("", "", tuple(_cells(mesh)))]


def _stl(data: bytes) -> tuple[Floats, list[tuple[str, str, Faces]]]:
    """Read points (n, 3) and triangles by solid of an STL file; InputError for an incomplete text."""
    if _is_binary(data):
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        points = np.frombuffer(data, record, offset=84)["corners"].reshape(-1, 3).astype(float)
        return points, [("", "", _triples(0, len(points)))]
    text = decoded(data, "replace")
    heads = [(m.start(), m.group(1).strip()) for m in re.finditer(r"(?mi)^[ \t]*solid\b[ \t]*(.*?)\r?$", text)]
    if not heads or "\0" in text:
        count = int.from_bytes(data[80:84], "little")
        raise InputError("", f"its header promises {count} triangles in {len(data)} bytes", "a whole file")
    ends = [*(start for start, _ in heads[1:]), len(text)]
    corner = re.compile(r"(?i)\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
    words = [corner.findall(text[a:b]) for (a, _), b in zip(heads, ends, strict=True)]
    corners_expected = 3 * text.lower().count("endfacet")
    if sum(map(len, words)) != corners_expected:
        raise InputError(
            "", f"it holds {sum(map(len, words))} corners and {corners_expected // 3} whole triangles", "a whole file"
        )
    stops = [0, *accumulate(map(len, words))]
    points = np.array([corner for solid in words for corner in solid], dtype=float).reshape(-1, 3)
    return points, [(name, name, _triples(a, b)) for (_, name), a, b in zip(heads, stops, stops[1:], strict=False)]


def _triples(begin: int, end: int) -> Faces:
    """Return the triangles (k, k+1, k+2) of points `begin` to `end` − 1, three by three."""
    return tuple((k, k + 1, k + 2) for k in range(begin, end, 3))


def _is_binary(data: bytes) -> bool:
    """Return True if the data are a binary STL file, by its size."""
    return len(data) >= 84 and 84 + 50 * int.from_bytes(data[80:84], "little") == len(data)


def _refuse_counts(kind: str, data: bytes) -> None:
    """Raise InputError for too many faces, or counts in a header that the file cannot hold."""
    # Checked before memory is allocated for them.
    size = len(data)
    if kind == "obj" and max(data.count(b"\nf"), data.count(b"\nv ") // 4) > MOST:
        raise InputError("", "it holds too many faces", f"at most {MOST}")
    if kind == "ply":
        header = data[: data.find(b"end_header")] if b"end_header" in data[:65536] else b""
        counts = [int(number) for number in re.findall(rb"element\s+\w+\s+(\d{1,18})", header)]
        if not header.lower().startswith(b"ply") or not counts:
            raise InputError("", "it has no PLY header", "ply … end_header")
        if min(sum(counts), size) > 5 * MOST:
            raise InputError("", f"its header promises {sum(counts)} entries", f"at most {5 * MOST}")
        if sum(counts) > size:
            raise InputError("", f"its header promises {sum(counts)} entries in {size} bytes", "a whole file")
    if kind == "stl" and (size // 50 if _is_binary(data) else data.lower().count(b"endfacet")) > MOST:
        raise InputError("", "it holds too many triangles", f"at most {MOST}")


def solids_of(layout: Layout, *, cells: bool) -> Iterator[tuple[str, bool, unions.Surface]]:
    """Yield name, support flag and closed surface of each block, or of each element.

    Parameters
    ----------
    layout : Layout
        Layout.
    cells : bool
        True for elements. A block of several separate parts gives one solid for each, numbered from 1.

    Yields
    ------
    (str, bool, Surface)
        Name, True for a support, surface.
    """
    if not cells:
        for block, surfaces in zip(layout.blocks, layout.surfaces, strict=True):
            for number, surface in enumerate(surfaces):
                name = block.name if len(surfaces) == 1 else f"{block.name}.{number + 1}"
                yield name, block.support, surface
        return
    elements = layout.assembly.elements
    for k, name in enumerate(elements.ids):
        if layout.assembly.dimension == 2:
            (region,) = unions.union_outlines([elements.shape[k]])
            surface = unions.extrude(region, layout.thickness)
        else:
            surface = unions.union_solids([elements.shape[k]], [elements.faces[k]])
        yield name, bool(elements.support[k]), surface


def _title(name: str, support: bool) -> str:
    word = re.sub(r"\s+", "_", name)
    return word if not support or "support" in word.casefold() else f"{word}_support"


def obj_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of an OBJ file with one group of polygonal faces per solid."""
    lines = [f"# {layout.assembly.name}, lengths in {layout.assembly.units[0]}, z up; written by jld"]
    start = 1
    for name, support, surface in solids_of(layout, cells=cells):
        lines.append(f"g {_title(name, support)}")
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in surface.points.tolist()]
        lines += ["f " + " ".join(str(start + index) for index in loop) for loop in surface.faces]
        start += len(surface.points)
    return "\n".join(lines) + "\n"


def stl_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of an ASCII STL file with one named solid of triangles per block."""
    lines = []
    for name, support, surface in solids_of(layout, cells=cells):
        title = _title(name, support)
        lines.append(f"solid {title}")
        for triangle in surface.triangles:
            a, b, c = surface.points[list(triangle)]
            normal = np.cross(b - a, c - a)
            size = float(np.linalg.norm(normal))
            normal = normal / size if size > 0.0 else normal
            lines.append(f" facet normal {normal[0]:.9g} {normal[1]:.9g} {normal[2]:.9g}\n  outer loop")
            lines += [f"   vertex {x!r} {y!r} {z!r}" for x, y, z in (a.tolist(), b.tolist(), c.tolist())]
            lines.append("  endloop\n endfacet")
        lines.append(f"endsolid {title}")
    return "\n".join(lines) + "\n"


def ply_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of an ASCII PLY file of polygonal faces, solid after solid."""
    points: list[str] = []
    faces: list[str] = []
    names = []
    for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells)):
        names.append(f"comment block {number} {_title(name, support)}")
        begin = len(points)
        points += [f"{x!r} {y!r} {z!r}" for x, y, z in surface.points.tolist()]
        faces += [f"{len(f)} {' '.join(str(begin + index) for index in f)}" for f in surface.faces]
    head = ["ply", "format ascii 1.0", f"comment {layout.assembly.name}, written by jld", *names]
    head += [f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    return "\n".join([*head, *points, *faces]) + "\n"


_COLUMNS: Final = ("id", "x", "y", "layer", "support")  # allowed columns

# Texts of the column support, in English, German, French, Italian and Spanish
_TRUE: Final = ("1", "true", "yes", "x", "ja", "wahr", "oui", "vrai", "sì", "si", "vero", "sí", "verdadero")
_FALSE: Final = ("", "0", "false", "no", "nein", "falsch", "non", "faux", "falso")


def _rows(text: str, mark: str) -> Iterator[list[str]]:
    """Yield the rows of a CSV text; InputError with the line number for an invalid one."""
    reader = csv.reader(io.StringIO(text), delimiter=mark)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(f"line {reader.line_num}", f"it is no row ({error})", "a name and numbers") from None
        yield row


def read_csv(path: File, options: ImportOptions, notes: Notes) -> Drawing:
    """Read the polygons of a CSV file, one corner per line, as closed paths; InputError names line or element."""
    # Columns are id, x, y and optionally layer and support, separated by commas, semicolons or tabs. Lines of one id
    # form a polygon; it is on layer "support" where its column support means true.
    text = text_of(path)
    first = text.splitlines()[0]
    mark = max(",;\t", key=first.count)
    rows = _rows(text, mark)
    head = [name.strip().casefold() for name in next(rows)]
    missing = [name for name in ("id", "x", "y") if name not in head]
    unknown = [name for name in head if name not in _COLUMNS]
    if missing or unknown:
        fault = f"no column {missing[0]!r}" if missing else f"an unknown column {unknown[0]!r}"
        raise InputError("line 1", fault, "columns id, x, y, and if wanted layer and support")
    corners: dict[str, list[tuple[float, float]]] = {}
    layers: dict[str, str] = {}
    signs: set[str] = set()  # decimal signs so far
    for number, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(head):
            raise InputError(f"line {number}", f"it has {len(row)} fields", f"{len(head)} as in line 1")
        if number > MOST:
            raise InputError("", "it holds too many corners", f"at most {MOST}")
        entry = {name: cell.strip() for name, cell in zip(head, row, strict=True)}
        if not entry["id"]:
            raise InputError(f"line {number}", "its id is empty", "the name of an element")
        texts = [entry["x"], entry["y"]]
        signs |= set("".join(texts)) & {",", "."}
        try:
            if len(signs) > 1 or "_" in "".join(texts):  # the points may be those of thousands
                raise ValueError
            if mark == ";":  # as spreadsheets write where the comma is the decimal sign
                texts = [text.replace(",", ".") for text in texts]
            point = (float(texts[0]), float(texts[1]))
        except ValueError:
            problem = f"{row[head.index('x')]!r}, {row[head.index('y')]!r} is no point"
            expected = (
                "two numbers, with decimal points, or with decimal commas everywhere and semicolons between fields"
            )
            raise InputError(f"line {number}", problem, expected) from None
        if not np.isfinite(point).all():
            raise InputError(f"line {number}", "it holds a coordinate that is no number", "finite numbers only")
        corners.setdefault(entry["id"], []).append(point)
        support = entry.get("support", "").casefold()
        if support not in (*_TRUE, *_FALSE):
            raise InputError(f"line {number}", f"support is {entry['support']!r}", "yes or no")
        layer = "support" if support in _TRUE else entry.get("layer", "")
        layers[entry["id"]] = layer or layers.get(entry["id"], "")
    paths = []
    for name, points in corners.items():
        if len(points) > 1 and points[0] == points[-1]:
            points = points[:-1]
        if len(points) < 3:
            raise InputError(f"element {name!r}", f"it has {len(points)} corners", "at least 3")
        outline = np.column_stack([points, np.zeros(len(points))])
        paths.append(Path(outline, closed=True, layer=layers[name], name=name))
    notes.found.append(f"{len(paths)} polygons")
    return Drawing(paths, [], None, {}, path.stem)
