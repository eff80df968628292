"""Reader of Rhino 3DM: solids, or closed curves in one plane, with their user text.

Uses rhino3dm. Layers and names are read as well.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path as File
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError
from jld_core.geometry import Faces
from jld_formats.cells import without_holes
from jld_formats.drawn_loads import MOST, Drawing, Mark, SolidMark
from jld_formats.facts import STORED
from jld_formats.libraries import library, parsing, readable
from jld_formats.options import FACET, ImportOptions, Notes, listed
from jld_formats.paths import Path
from jld_formats.solids import Part, Solids

# Largest distance from a plane or a line, relative to the size of the object, of what counts as plane or straight
_PLANE: Final = 1e-6


def polyhedron(geometry: Any, title: str) -> tuple[Floats, Faces]:
    """Return vertices (k, 3) and faces of a rhino3dm object; a face with holes becomes triangles."""
    if type(geometry).__name__ == "Mesh":
        return _of_mesh(geometry)
    solid = geometry if type(geometry).__name__ == "Brep" else geometry.ToBrep(True)
    if solid is None or not len(solid.Faces):
        raise InputError(title, "it holds no faces", "a closed polysurface")
    points = np.array([(p.X, p.Y, p.Z) for p in (vertex.Location for vertex in solid.Vertices)])
    near = _PLANE * float(np.ptp(points, axis=0).max())
    if any(not edge.IsLinear(near) for edge in solid.Edges):
        raise InputError(title, "it has a curved edge or face", "plane faces with straight edges; mesh it in Rhino")
    faces: list[tuple[int, ...]] = []
    for face in solid.Faces:
        if not face.IsPlanar(near):
            raise InputError(title, "it has a curved face", "plane faces with straight edges; mesh it in Rhino")
        loops = [_corners(loop.Trims) for loop in face.Loops]
        short = min(len(set(loop)) for loop in loops)
        if short < 3:
            raise InputError(title, f"a face has {short} corners", "at least 3")
        turned = [loop[::-1] if face.OrientationIsReversed else loop for loop in loops]
        faces += without_holes(points, turned, title)
    if not solid.IsSolid:
        raise InputError(title, "it is open", "a closed polysurface")
    return points, tuple(faces)


def _corners(trims: Any) -> tuple[int, ...]:
    """Return the indices of the vertices along a loop of a face."""
    return tuple(int(trims[k].StartVertexIndex) for k in range(len(trims)))


def _of_mesh(mesh: Any) -> tuple[Floats, Faces]:
    points = np.array([(p.X, p.Y, p.Z) for p in mesh.Vertices.ToPoint3dArray()], dtype=float).reshape(-1, 3)
    unique, number = np.unique(points, axis=0, return_inverse=True)
    number = number.reshape(-1)
    faces = []
    for k in range(len(mesh.Faces)):
        loop = [int(number[index]) for index in mesh.Faces[k]]
        short = [index for position, index in enumerate(loop) if index != loop[position - 1]]
        if len(set(short)) > 2:
            faces.append(tuple(short))
    return unique, tuple(faces)


# Key of the document's user text in files written by jld: scene keys that the model does not show.
FACTS: Final = "jld"

UNITS: Final = {
    "Millimeters": "mm", "Centimeters": "cm", "Decimeters": "dm", "Meters": "m", "Kilometers": "km", "Inches": "in",
    "Feet": "ft", "Yards": "yd",
}  # fmt: skip
"""Length units by their names in Rhino."""

_MOST_COPIES: Final = 20_000  # largest number of objects that block instances unfold into

_DEPTH: Final = 16  # largest depth of nested block instances

_LABELS: Final = ("dry", "inner")  # roles of layers whose closed curves label the contacts of solids

_FORCE: Final = ("force", "load")  # keys of user text that state the force of a point or of an arrow

_FLAT: Final = 1e-6  # largest height of curves over their common plane, relative to their size


def read_rhino(path: File, options: ImportOptions, notes: Notes) -> Drawing | Solids:
    """Read a Rhino file as solids, or as a drawing where it holds curves alone, in its unit."""
    rhino = library("rhino3dm", path)
    readable(path)
    with parsing("3DM", "a Rhino file"):
        model = rhino.File3dm.Read(str(path))
        if model is None:
            raise InputError("", "it is no 3DM that can be read", "a Rhino file")
        return _Reader(rhino, model, options, notes).content(path.stem)


class _Reader:
    def __init__(self, rhino: Any, model: Any, options: ImportOptions, notes: Notes) -> None:
        self._rhino, self._model, self._options, self._notes = rhino, model, options, notes
        self._layers = {layer.Index: layer for layer in model.Layers}
        self._by_id = {str(item.Attributes.Id): item for item in model.Objects}
        self._parts: list[Part] = []
        self._curves: list[tuple[Floats, bool, str, str]] = []
        self._marks: list[SolidMark] = []
        self._unread: Counter[tuple[str, str]] = Counter()
        self._hidden: Counter[str] = Counter()

    def _count_unfolded(self, item: Any, amount_of: dict[str, int], depth: int = 0) -> int:
        """Return how many objects an object holds; amount_of: in definitions. InputError for deep nesting."""
        if type(item.Geometry).__name__ != "InstanceReference":
            return 1
        if depth >= _DEPTH:
            raise InputError("", "its blocks are nested too deeply", f"at most {_DEPTH} levels, none inside itself")
        key = str(item.Geometry.ParentIdefId)
        if key not in amount_of:
            definition = self._model.InstanceDefinitions.FindId(item.Geometry.ParentIdefId)
            objects = (
                [self._by_id.get(str(object_id)) for object_id in definition.GetObjectIds()]
                if definition is not None
                else []
            )
            amount_of[key] = 1 + sum(
                self._count_unfolded(part, amount_of, depth + 1) for part in objects if part is not None
            )
        return amount_of[key]

    def content(self, title: str) -> Drawing | Solids:
        unfolded: dict[str, int] = {}
        items = [item for item in self._model.Objects if not item.Attributes.IsInstanceDefinitionObject]
        if len(items) > MOST or sum(self._count_unfolded(item, unfolded) for item in items) - len(items) > _MOST_COPIES:
            raise InputError("", "its blocks unfold into too many objects", f"at most {_MOST_COPIES}")
        for position, item in enumerate(items):
            self._notes.reached("objects", position, len(items))
            self._read(item, None, [])
        for (kind, layer), count in sorted(self._unread.items()):
            self._notes.skip(f"{kind} objects on layer {layer}", count, "no solid, curve, point or text")
        for layer, count in sorted(self._hidden.items()):
            self._notes.skip(f"objects on layer {layer}", count, "they or their layer are hidden")
        facts = self._facts()
        unit = UNITS.get(str(self._model.Settings.ModelUnitSystem).rpartition(".")[2])
        name = str(facts.pop("name", "") or title)
        layers = {part.group for part in self._parts} | {layer for _, _, layer, _ in self._curves}
        self._notes.found.append(f"layers {listed(sorted(layers | {mark.layer for mark in self._marks}), 12)}")
        if not self._parts:
            return self._drawing(unit, facts, name)
        keys = facts.pop("elements", {})
        parts = [
            Part(p.name, p.group, p.vertices, p.faces, p.support, {**p.keys, **keys.get(p.name, {})})
            for p in self._parts
        ]
        arrows = [
            SolidMark(points[-1], layer, text or None, points[0])
            for points, closed, layer, text in self._curves
            if not closed and self._options.role(layer) in ("load", "dead")
        ]
        role = {layer: self._options.role(layer) for _, _, layer, _ in self._curves}
        rings = [(role[layer], points[:-1]) for points, closed, layer, _ in self._curves if closed]
        labelled = [(str(word), points) for word, points in rings if word in _LABELS]
        other_layers = [
            la for _, closed, la, _ in self._curves if role[la] not in (_LABELS if closed else ("load", "dead"))
        ]
        for layer, count in sorted(Counter(other_layers).items()):
            self._notes.skip(f"curves on layer {layer}", count, "the file holds solids, which are read")
        return Solids(parts, facts=facts, name=name, unit=unit, marks=[*self._marks, *arrows], drawn=labelled)

    def _facts(self) -> dict[str, Any]:
        """Return the scene keys stored in the document's user text."""
        strings = self._model.Strings
        stored = dict(strings[k] for k in range(len(strings)))
        if FACTS not in stored:
            return {}
        facts = json.loads(stored[FACTS])
        if not isinstance(facts, dict):
            raise InputError(FACTS, "the user text holds no JSON object", "what jld export wrote")
        return {key: value for key, value in facts.items() if key in STORED}

    def _layer(self, index: int, parent: str | None) -> tuple[str, bool]:
        """Return the name of an object's layer, in a path the last with a role, and whether it is shown."""
        layer = self._layers.get(index)
        if layer is None:
            return parent or "", True
        names = [name for name in str(layer.FullPath).split("::") if name] or [str(layer.Name)]
        with_role = [name for name in reversed(names) if self._options.role(name)]
        chosen = with_role[0] if with_role else names[-1]
        return (parent if parent is not None and not with_role else chosen), bool(layer.Visible)

    def _read(self, item: Any, parent: str | None, moves: list[Any]) -> None:
        """Read one object: a solid, a mark, a curve or the objects of an instance."""
        # Hidden objects and other kinds are counted.
        attributes, geometry = item.Attributes, item.Geometry
        layer, is_visible = self._layer(attributes.LayerIndex, parent)
        if not is_visible or not attributes.Visible:
            self._hidden[layer] += 1
            return
        kind = type(geometry).__name__
        if kind == "InstanceReference":
            self._instance(geometry, layer, moves)
            return
        for move in moves:
            geometry = geometry.Duplicate()
            geometry.Transform(move)
        texts = {str(key).casefold(): str(value) for key, value in attributes.GetUserStrings()}
        name = str(attributes.Name or "")
        if self._options.role(layer) == "skip":
            return
        if kind in ("Mesh", "Brep", "Extrusion"):
            title = f"object {name!r}" if name else f"an object on layer {layer!r}"
            vertices, faces = polyhedron(geometry, title)
            self._parts.append(Part(name, layer, vertices, faces, keys=_element_keys(texts, title)))
        elif kind == "Point" or kind == "TextDot":
            at = geometry.Location if kind == "Point" else geometry.Point
            text = geometry.Text if kind == "TextDot" else _force(texts) or name
            self._marks.append(SolidMark(np.array([at.X, at.Y, at.Z]), layer, text or None))
        elif isinstance(geometry, self._rhino.AnnotationBase) and hasattr(geometry, "PlainText"):
            at = geometry.Plane.Origin
            self._marks.append(SolidMark(np.array([at.X, at.Y, at.Z]), layer, str(geometry.PlainText)))
        elif isinstance(geometry, self._rhino.Curve):
            loaded = self._options.role(layer) in ("load", "dead")
            self._curves.append(
                (self._points(geometry), bool(geometry.IsClosed), layer, _force(texts) or name if loaded else name)
            )
        else:
            self._unread[kind, layer] += 1

    def _instance(self, reference: Any, layer: str, moves: list[Any]) -> None:
        definition = self._model.InstanceDefinitions.FindId(reference.ParentIdefId)
        for identity in definition.GetObjectIds() if definition is not None else ():
            if str(identity) in self._by_id:
                self._read(self._by_id[str(identity)], layer, [reference.Xform, *moves])

    def _points(self, curve: Any) -> Floats:
        """Return the corners (k, 3) of a curve, with chords within the facet tolerance."""
        if isinstance(curve, self._rhino.PolylineCurve):
            corners = [curve.Point(k) for k in range(curve.PointCount)]
            return np.array([(p.X, p.Y, p.Z) for p in corners])
        if isinstance(curve, self._rhino.PolyCurve):
            pieces = [self._points(curve.SegmentCurve(k)) for k in range(curve.SegmentCount)]
            return np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
        low, high = curve.Domain.T0, curve.Domain.T1
        number = 1 if curve.IsLinear(1e-9) else 8
        while True:
            at = np.linspace(low, high, 2 * number + 1)
            points = np.array([(p.X, p.Y, p.Z) for p in (curve.PointAt(float(t)) for t in at)])
            size = float(np.ptp(points, axis=0).max())
            facet = FACET * size if self._options.facet is None else self._options.facet
            middle = 0.5 * (points[:-1:2] + points[2::2])
            if number >= 2048 or np.linalg.norm(points[1::2] - middle, axis=1).max() <= facet:
                return np.asarray(points[::2])
            number *= 2

    def _drawing(self, unit: str | None, facts: dict[str, Any], name: str) -> Drawing:
        """Project curves, points and texts onto their plane x–y or x–z, as a drawing."""
        every = [points for points, _, _, _ in self._curves] + [mark.at[None] for mark in self._marks]
        if not every:
            raise InputError("", "it holds no solid and no curve", "closed curves, meshes or polysurfaces")
        spread = np.ptp(np.concatenate(every), axis=0)
        if not np.isfinite(spread).all():
            raise InputError("", "it holds a coordinate that is no number", "finite numbers only")
        up = 1 if spread[2] <= _FLAT * spread.max() else 2
        if up == 2 and spread[1] > _FLAT * spread.max():
            raise InputError("", "it holds no solid, and its curves lie in no plane x–y or x–z", "one such plane")
        self._notes.found.append(f"curves in the plane x–{'xyz'[up]}")
        paths = []
        for points, closed, layer, title in self._curves:
            flat = np.column_stack([points[:, [0, up]], np.zeros(len(points))])
            if closed and len(flat) > 1 and np.allclose(flat[0], flat[-1], rtol=0.0, atol=1e-9 * spread.max()):
                flat = flat[:-1]
            if len(flat) > (2 if closed else 1):
                loaded = self._options.role(layer) in ("load", "dead")
                paths.append(Path(flat, closed, layer, title if closed and not loaded else None))
                if loaded and title:
                    middle = 0.5 * (flat[0, :2] + flat[-1, :2])
                    self._marks.append(SolidMark(np.insert(middle, 3 - up, 0.0), layer, title))
        marks = [Mark((float(m.at[0]), float(m.at[up])), m.layer, m.text) for m in self._marks]
        return Drawing(paths, marks, unit, facts, name)


def _force(texts: dict[str, str]) -> str:
    """Return the force stated by user text, as text for `parse_force`; "" without one."""
    forces = [texts[key] for key in _FORCE if key in texts]
    parts = [f"{key} = {texts[key]}" for key in ("fx", "fy", "fz") if key in texts]
    return forces[0] if forces else "; ".join(parts)


def _element_keys(texts: dict[str, str], title: str) -> dict[str, Any]:
    """Return density and block of an element from the user text of its object."""
    # The block is left out where the text lists exactly one element.
    keys: dict[str, Any] = {}
    if texts.get("block") and len(texts.get("elements", "").split()) != 1:
        keys["block"] = texts["block"]
    if "density" in texts:
        try:
            keys["density"] = float(texts["density"])
        except ValueError:
            raise InputError(title, f"its density {texts['density']!r} is no number", "kg/m³") from None
    return keys
