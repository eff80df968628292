"""Reader of STEP (ISO 10303-21, AP203, AP214, AP242): solids with plane faces, placed in assemblies."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError
from jld_core.geometry import Faces
from jld_core.scene import units
from jld_formats.cells import without_holes
from jld_formats.libraries import decoded, parsing, readable
from jld_formats.options import ImportOptions, Notes, several
from jld_formats.solids import Part, Solids

_TOKEN: Final = re.compile(
    r"\s+|/\*.*?\*/|(?P<text>'(?:[^']|'')*')|(?P<word>[^\s'(),;=]+)|(?P<mark>[(),;=])", re.DOTALL
)

_MOST_ENTITIES: Final = 2_000_000  # largest number of instances of a file

_MOST_SOLIDS: Final = 20_000  # largest number of solids that assemblies unfold into

_MOST_VISITS: Final = 100_000  # largest number of parts that assemblies unfold into, with those that are empty

_DEPTH: Final = 32  # largest depth of assemblies

_STRAIGHT: Final = 1e-9  # distance of control points from a line or plane, relative to their size, that counts as none

_PREFIX: Final = {"MILLI": 1e-3, "CENTI": 1e-2, "DECI": 0.1, "KILO": 1e3, "MICRO": 1e-6}

_UNNAMED: Final = ("", "SOLID", "NONE", "BREP", "COMPOUND", "OPEN CASCADE STEP TRANSLATOR")  # names that say nothing

Call = tuple[str, list[Any]]
"""Type and values of an instance; a value is a `Call`, a list, a number, a text, or a reference as a `Ref`."""


class Ref(int):
    """Number of an instance."""


class _File:
    """Instances of a file.

    calls: by number, one `Call`, or several where an instance has several types.
    """

    def __init__(self, text: str, notes: Notes) -> None:
        self.calls: dict[int, list[Call]] = {}
        self._tokens = self._read(text)
        self._next()
        while self._token:
            if self._token[0] == "#":
                number = int(self._token[1:])
                self._next("=")
                self._next()
                self.calls[number] = self._instances()
                notes.reached("instances", len(self.calls))
                if len(self.calls) > _MOST_ENTITIES:
                    raise InputError("", "it holds too many instances", f"at most {_MOST_ENTITIES}")
            while self._token not in ("", ";"):
                self._next()
            self._next()
        self.by_kind: dict[str, list[int]] = {}
        for number, calls in self.calls.items():
            for kind, _ in calls:
                self.by_kind.setdefault(kind, []).append(number)

    def _read(self, text: str) -> Iterator[str]:
        begin = re.search(r"\bDATA\s*(\([^;]*\))?\s*;", text)
        for match in _TOKEN.finditer(text, begin.end() if begin else len(text)):
            if match.lastgroup:
                yield match[match.lastgroup]

    def _next(self, expected: str = "") -> None:
        """Go to the next token; raise InputError where it is another than expected."""
        self._token = next(self._tokens, "")
        if expected and self._token != expected:
            raise InputError("", f"{self._token[:20]!r} stands where {expected!r} is due", "a whole STEP file")

    def _instances(self) -> list[Call]:
        if self._token != "(":
            return [self._call()]
        self._next()
        calls = []
        while self._token not in (")", ""):
            calls.append(self._call())
        return calls

    def _call(self) -> Call:
        kind = self._token.upper()
        self._next("(")
        return kind, self._values()

    def _values(self) -> list[Any]:
        values: list[Any] = []
        self._next()
        while self._token not in (")", ""):
            token = self._token
            if token == ",":
                self._next()
                continue
            if token == "(":
                values.append(self._values())
            elif token[0] == "'":
                values.append(_plain(token))
                self._next()
            elif token[0] == "#":
                values.append(Ref(token[1:]))
                self._next()
            elif token[0].isalpha():
                values.append(self._call())
            else:
                values.append(_value(token))
                self._next()
        self._next()
        return values

    def first_values(self, number: int) -> list[Any]:
        """Return the values of the first type of an instance."""
        return self.calls[number][0][1]

    def of(self, number: int, kind: str) -> list[Any] | None:
        return next((values for name, values in self.calls.get(number, ()) if name == kind), None)

    def every(self, kind: str) -> Iterator[tuple[int, list[Any]]]:
        """Yield number and values of all instances of a type."""
        for number in self.by_kind.get(kind, ()):
            yield number, self.of(number, kind) or []

    def kind(self, number: int) -> str:
        return self.calls[number][0][0] if number in self.calls else "nothing"


def _plain(token: str) -> str:
    words = token[1:-1].replace("''", "'")
    words = re.sub(r"\\X4\\([0-9A-F]+)\\X0\\", lambda m: bytes.fromhex(m[1]).decode("utf-32-be", "replace"), words)
    words = re.sub(r"\\X2\\([0-9A-F]+)\\X0\\", lambda m: bytes.fromhex(m[1]).decode("utf-16-be", "replace"), words)
    words = re.sub(r"\\X\\([0-9A-F]{2})", lambda m: chr(int(m[1], 16)), words)
    return words.replace("\\\\", "\\")


def _value(token: str) -> float | str | None:
    """Return a number, an enumeration without its dots, or None for a value that is left out."""
    if token in ("$", "*"):
        return None
    return token.strip(".") if token[0] == "." and not token[1:2].isdigit() else float(token)


def read_step(path: Path, options: ImportOptions, notes: Notes) -> Solids:
    text = decoded(readable(path).read_bytes(), "replace")
    if "ISO-10303-21" not in text[:4096]:
        raise InputError("", "it is no STEP file", "ISO-10303-21; …")
    with parsing("STEP", "a STEP file"):
        file = _File(text, notes)
        unit, scale = _unit(file)
        parts = _Reader(file, scale, options, notes).parts()
    notes.found.append(f"{several(len(parts), 'solid')} of {several(len(file.by_kind.get('PRODUCT', ())), 'product')}")
    if not parts:
        raise InputError(
            "", "it holds no solid of faces", "solids with plane faces (MANIFOLD_SOLID_BREP, FACETED_BREP)"
        )
    return Solids(parts, name=path.stem, unit=unit)


def _unit(file: _File) -> tuple[str, float]:
    """Return the unit of lengths of a file and 1, or "m" and the metres of a unit without a name."""
    sizes: dict[float, None] = {}
    for _, values in file.every("GLOBAL_UNIT_ASSIGNED_CONTEXT"):
        for number in values[0]:
            if file.of(number, "LENGTH_UNIT") is not None:
                sizes[_length(file, number)] = None
    if len(sizes) != 1:
        names = ", ".join(f"{size:g} m" for size in sizes) or "none"
        raise InputError("", f"its units of length are {names}", "one unit in the whole file")
    (size,) = sizes
    near = [name for name, metres in units.METRES.items() if abs(metres - size) <= 1e-9 * size]
    return (near[0], 1.0) if near else ("m", size)


def _length(file: _File, number: int) -> float:
    """Return the size of a unit of length, m."""
    converted = file.of(number, "CONVERSION_BASED_UNIT")
    if converted is None:
        prefix = (file.of(number, "SI_UNIT") or [None])[0]
        return _PREFIX[str(prefix)] if prefix else 1.0
    (_, (value,)), base = (file.of(converted[1], "LENGTH_MEASURE_WITH_UNIT") or _measure(file, converted[1]))[:2]
    return float(value) * _length(file, base)


def _measure(file: _File, number: int) -> list[Any]:
    return next(values for name, values in file.calls[number] if name.endswith("MEASURE_WITH_UNIT"))


class _Reader:
    """State of one pass over the products of a file."""

    def __init__(self, file: _File, scale: float, options: ImportOptions, notes: Notes) -> None:
        self._file, self._scale, self._options, self._notes = file, scale, options, notes
        self._layers = {
            int(item): str(values[0]) for _, values in file.every("PRESENTATION_LAYER_ASSIGNMENT") for item in values[2]
        }
        self._parts: list[Part] = []
        self._count = self._visits = 0

    def _visit(self, depth: int) -> None:
        """Count a use of a product or shape; raise InputError for too many, or too deep ones."""
        self._visits += 1
        self._notes.reached("solids", self._count)
        if depth > _DEPTH:
            raise InputError("", "its assemblies are nested too deeply", f"at most {_DEPTH} levels")
        if self._visits > _MOST_VISITS:
            raise InputError("", "its assemblies hold too many parts", f"at most {_MOST_VISITS}")

    def parts(self) -> list[Part]:
        """Return the solids of all products that are part of no other one; without products all representations."""
        file = self._file
        owner = {n: values[2] for n, values in file.every("PRODUCT_DEFINITION_SHAPE")}
        shapes_of: dict[int, list[int]] = {}
        for _, (form, shape, *_) in file.every("SHAPE_DEFINITION_REPRESENTATION"):
            shapes_of.setdefault(owner.get(form, 0), []).append(shape)
        # representations that state the same shape, as one of axes and one of solids
        same_shape: dict[int, list[int]] = {}
        for number, calls in file.calls.items():
            values = dict(calls).get("SHAPE_REPRESENTATION_RELATIONSHIP")
            if (
                values
                and len(values) >= 4
                and file.of(number, "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION") is None
            ):
                for first, second in (values[2:4], values[3:1:-1]):
                    same_shape.setdefault(first, []).append(second)
        placements = dict(self._places(owner))
        inside: dict[int, list[tuple[int, Floats]]] = {}
        used = set()
        for number, values in file.every("NEXT_ASSEMBLY_USAGE_OCCURRENCE"):
            parent, child = values[3:5]
            inside.setdefault(parent, []).append(
                (child, self._move(placements.get(number), shapes_of.get(child, []), same_shape))
            )
            used.add(child)

        def walk(product: int, matrix: Floats, depth: int) -> None:
            self._visit(depth)
            visited: set[int] = set()
            pending = list(shapes_of.get(product, []))
            while pending:
                shape = pending.pop(0)
                if shape not in visited:
                    visited.add(shape)
                    pending += same_shape.get(shape, [])
                    self._representation(shape, matrix, self._name(product), depth)
            for child, move in inside.get(product, []):
                walk(child, matrix @ move, depth + 1)

        products = [
            number
            for kind in ("PRODUCT_DEFINITION", "PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS")
            for number, _ in file.every(kind)
        ]
        for product in products:
            if product not in used:
                walk(product, np.eye(4), 0)
        if not self._parts:
            for kind in [kind for kind in file.by_kind if kind.endswith("SHAPE_REPRESENTATION")]:
                for shape, _ in file.every(kind):
                    self._representation(shape, np.eye(4), "", 0)
        return self._parts

    def _places(self, owner: dict[int, int]) -> Iterator[tuple[int, tuple[int, int, int]]]:
        """Yield for each use of a product its first representation and the two axes of its placement."""
        for _, (relation, form) in self._file.every("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"):
            calls = dict(self._file.calls[relation])
            pair = calls.get("REPRESENTATION_RELATIONSHIP") or calls["SHAPE_REPRESENTATION_RELATIONSHIP"]
            moved = self._file.of(
                calls["REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION"][0], "ITEM_DEFINED_TRANSFORMATION"
            )
            if moved is not None:
                yield owner[form], (pair[2], moved[2], moved[3])

    def _move(self, placement: tuple[int, int, int] | None, shapes: list[int], alike: dict[int, list[int]]) -> Floats:
        """Return the motion (4, 4) of a child with these shapes; placement: first shape, and a frame of either."""
        if placement is None:
            return np.eye(4)
        first, frame_of_first, frame_of_second = placement
        of_child = {*shapes, *(other for shape in shapes for other in alike.get(shape, []))}
        # the relation may name child or parent first
        inner, outer = (frame_of_first, frame_of_second) if first in of_child else (frame_of_second, frame_of_first)
        return np.asarray(self._frame(outer) @ np.linalg.inv(self._frame(inner)))

    def _name(self, product: int) -> str:
        definition = self._file.first_values(product)
        formation = self._file.calls.get(definition[2], [("", [None] * 3)])[0][1]
        values = self._file.of(formation[2], "PRODUCT") if formation[2] is not None else None
        return str((values[1] or values[0]) if values else "")

    def _point(self, number: int) -> Floats:
        return np.array(self._file.first_values(number)[1], dtype=float)

    def _frame(self, number: int) -> Floats:
        """Return the matrix (4, 4) of an axis placement."""
        values = self._file.of(number, "AXIS2_PLACEMENT_3D") or []
        axis = self._point(values[2]) if values[2] is not None else np.array([0.0, 0.0, 1.0])
        axis = axis / np.linalg.norm(axis)
        along = self._point(values[3]) if values[3] is not None else np.eye(3)[int(np.argmin(np.abs(axis)))]
        along = along - (along @ axis) * axis
        along = along / np.linalg.norm(along)
        matrix = np.eye(4)
        matrix[:3, :3] = np.column_stack([along, np.cross(axis, along), axis])
        matrix[:3, 3] = self._point(values[1])
        return matrix

    def _representation(self, shape: int, matrix: Floats, title: str, depth: int) -> None:
        self._visit(depth)
        values = next((v for name, v in self._file.calls[shape] if name.endswith("REPRESENTATION")), None)
        for item in values[1] if values else ():
            kind = self._file.kind(item)
            content = self._file.first_values(item) if item in self._file.calls else []
            if kind == "MAPPED_ITEM":
                origin, mapped = self._file.of(content[1], "REPRESENTATION_MAP") or [None, None]
                if origin is not None and mapped is not None:
                    move = self._frame(content[2]) @ np.linalg.inv(self._frame(origin))
                    self._representation(mapped, matrix @ move, title, depth + 1)
            elif kind in ("MANIFOLD_SOLID_BREP", "FACETED_BREP"):
                self._solid(item, content[1], matrix, title)
            elif kind == "SHELL_BASED_SURFACE_MODEL":
                for shell in content[1]:
                    self._solid(item, shell, matrix, title)
            elif kind == "BREP_WITH_VOIDS":
                raise InputError(title, "it is a solid with a void inside", "solids without voids")

    def _solid(self, item: int, shell: int, matrix: Floats, title: str) -> None:
        self._count += 1
        if self._count > _MOST_SOLIDS:
            raise InputError("", "its assemblies hold too many solids", f"at most {_MOST_SOLIDS}")
        own = str(self._file.calls[item][0][1][0] or "")
        name = title if own.upper() in _UNNAMED or own == title else own
        name = name or f"b{self._count}"
        points, faces = self._faces(shell, name)
        points = self._scale * (points @ matrix[:3, :3].T + matrix[:3, 3])
        group = self._options.group(self._layers.get(item, ""), title, name)
        self._parts.append(Part(name, group, points, faces))

    def _faces(self, shell: int, title: str) -> tuple[Floats, Faces]:
        """Return corners (k, 3) and plane faces of a shell, without holes."""
        index_of: dict[int, int] = {}
        loops_of_face = []
        _, faces = self._file.first_values(shell)[:2]  # after a label, here and below
        for face in faces:
            values = next(v for name, v in self._file.calls[face] if name in ("ADVANCED_FACE", "FACE_SURFACE", "FACE"))
            _, bounds, *surface = values
            if surface and not self._flat(surface[0]):
                kind = self._file.kind(surface[0])
                raise InputError(title, f"it has a curved face ({kind})", "plane faces with straight edges")
            loops = []
            for bound in bounds:
                _, loop, sense = self._file.first_values(bound)[:3]
                corners = self._corners(loop, title)
                if len(corners) > 2:
                    indices = [index_of.setdefault(corner, len(index_of)) for corner in corners]
                    loops.append(indices if sense != "F" else indices[::-1])
            loops_of_face.append(loops)
        points = np.array([self._place(vertex) for vertex in index_of]).reshape(-1, 3)
        outlines = (without_holes(points, loops, title) for loops in loops_of_face if loops)
        return points, tuple(itertools.chain(*outlines))

    def _place(self, vertex: int) -> Floats:
        values = self._file.of(vertex, "VERTEX_POINT")
        return self._point(values[1] if values else vertex)

    def _corners(self, loop: int, title: str) -> list[int]:
        polygon = self._file.of(loop, "POLY_LOOP")
        if polygon is not None:
            return [int(point) for point in polygon[1]]
        corners = []
        for oriented in (self._file.of(loop, "EDGE_LOOP") or [None, []])[1]:
            _, _, _, edge, sense = self._file.of(oriented, "ORIENTED_EDGE") or []
            _, start, end, curve, *_ = self._file.of(edge, "EDGE_CURVE") or []
            if not self._flat(curve, line=True):
                raise InputError(
                    title, f"it has a curved edge ({self._file.kind(self._bare(curve))})", "straight edges"
                )
            corners.append(int(end if sense == "F" else start))
        return corners

    def _bare(self, number: int) -> int:
        """Return the curve that a curve on a surface, or a part of a curve, is of."""
        while self._file.kind(number) in ("SURFACE_CURVE", "SEAM_CURVE", "TRIMMED_CURVE"):
            number = self._file.calls[number][0][1][1]
        return number

    def _flat(self, number: int, *, line: bool = False) -> bool:
        """Return True if a surface is plane, or a curve straight; splines by their control points."""
        number = self._bare(number)
        if self._file.kind(number) in ("PLANE", "LINE"):
            return True
        controls = [v for name, v in self._file.calls[number] if name.startswith(("B_SPLINE", "POLYLINE"))]
        point_refs = [ref for v in controls for ref in _references(v) if self._file.kind(ref) == "CARTESIAN_POINT"]
        if len(point_refs) < 2:
            return False
        points = np.array([self._point(ref) for ref in point_refs])
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        return bool(spread[(1 if line else 2) :].max(initial=0.0) <= _STRAIGHT * spread[0])


def _references(values: list[Any]) -> Iterator[int]:
    for value in values:
        if isinstance(value, Ref):
            yield value
        elif isinstance(value, list):
            yield from _references(value)
