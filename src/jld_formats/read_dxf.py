"""Reader of DXF by ezdxf: outlines, lines, arcs, hatches, regions, texts, meshes, blocks."""

from __future__ import annotations

import codecs
import io
import json
import re
from collections import Counter
from importlib import import_module
from pathlib import Path as File
from typing import Any, Final

import numpy as np
import shapely

from jld_core import InputError
from jld_formats.drawn_loads import MOST, Drawing, Mark
from jld_formats.facts import STORED
from jld_formats.libraries import decoded, library, parsing, readable
from jld_formats.options import FACET, ImportOptions, Notes, listed
from jld_formats.paths import Path, arc_points, flatten
from jld_formats.solids import Part, Solids

_MOST_COPIES: Final = 50_000  # largest number of entities that blocks unfold into; some 10 000 are copied in a second

_DEPTH: Final = 16  # largest depth of nested blocks

# Length units by the code of the header variable $INSUNITS
_UNITS: Final = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km", 10: "yd", 14: "dm"}

# Kinds of entities beside the structure, and line types of axes
_BESIDE: Final = (
    "DIMENSION",
    "LEADER",
    "MULTILEADER",
    "MLEADER",
    "VIEWPORT",
    "ATTDEF",
    "IMAGE",
    "WIPEOUT",
    "XLINE",
    "RAY",
)
_AXIS: Final = re.compile(
    r"(CENTER|DASHDOT|MITTE|STRICHPUNKT|ACAD_ISO(04|08|10|12)|ASSE|AXE|EJE|MEZZERIA)", re.IGNORECASE
)

_TEXT_BOX: Final = 8  # flag of a boundary of a hatch that keeps a text free

# Gaps of a boundary of a hatch, relative to its size: up to which its ends are one, and beyond which it is open
_JOINED, _OPEN = 1e-6, 0.02

# Prefix of numbered custom properties in drawings written by jld: scene keys that a drawing does not show.
FACTS: Final = "jld"


def read_dxf(path: File, options: ImportOptions, notes: Notes) -> Drawing | Solids:
    """Read the model space of a DXF file as a drawing, or as solids where it holds meshes, in its unit."""
    ezdxf = library("ezdxf", path)
    readable(path)
    with parsing("DXF", "a DXF file, ASCII or binary"):
        notes.reached("bytes in its text", path.stat().st_size)
        data = path.read_bytes()
        marked = data.startswith((codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        document = ezdxf.read(io.StringIO(decoded(data))) if marked else ezdxf.readfile(path)
        space = document.modelspace()
        _refuse_large_blocks(document, space)
        return _Reader(document, options, notes).drawing(space, path.stem)


def _refuse_large_blocks(document: Any, space: Any) -> None:
    """Raise InputError if nested blocks hold too many entities; count them without expanding."""
    amount_of: dict[str, int] = {}
    open_blocks: list[str] = []

    def amount(layout: Any, depth: int) -> int:
        if depth > _DEPTH:
            raise InputError("", "its blocks are nested too deeply", f"at most {_DEPTH} levels")
        total = 0
        for entity in layout:
            if entity.dxftype() != "INSERT":
                total += 1
                continue
            name = entity.dxf.name
            copies = max(1, int(entity.dxf.get("row_count", 1))) * max(1, int(entity.dxf.get("column_count", 1)))
            if name in open_blocks:
                raise InputError(f"block {name!r}", "it stands inside itself", "blocks within blocks without a circle")
            if name not in amount_of:
                open_blocks.append(name)
                amount_of[name] = amount(document.blocks.get(name), depth + 1) if name in document.blocks else 0
                open_blocks.pop()
            total += copies * (1 + amount_of[name])
            if total > MOST:
                break
        return total

    if amount(space, 0) - len(space) > _MOST_COPIES:
        raise InputError("", "its nested blocks hold too many entities", f"at most {_MOST_COPIES} entities")


class _Reader:
    def __init__(self, document: Any, options: ImportOptions, notes: Notes) -> None:
        self.document, self.options, self.notes = document, options, notes
        self.paths: list[Path] = []
        self.marks: list[Mark] = []
        self.unread: Counter[tuple[str, str]] = Counter()
        self.hidden: Counter[str] = Counter()
        self.axes: Counter[str] = Counter()
        self._solids: list[Part] = []

    def drawing(self, space: Any, title: str) -> Drawing | Solids:
        code = int(self.document.header.get("$INSUNITS", 0))
        unit = _UNITS.get(code, None if code == 0 else f"$INSUNITS {code}")
        for number, entity in enumerate(space):
            self.notes.reached("entities", number, len(space))
            self._read(entity, None, 0)
        lost = 0  # entities not read that may be part of the structure
        for (kind, layer), count in sorted(self.unread.items()):
            lost += count * (kind not in _BESIDE and self.options.role(layer) != "skip")
            words = f"{kind} entities on layer {layer}"
            self.notes.skip(words, count, "no outline, line, arc, text or point in the plane")
        for layer, count in sorted(self.hidden.items()):
            self.notes.skip(f"entities on layer {layer}", count, "it is off or frozen")
        for layer, count in sorted(self.axes.items()):
            self.notes.skip(f"lines on layer {layer}", count, "axes by their line type")
        if self._solids:
            self.notes.skip("paths", len(self.paths), "the file holds solids, which are read")
            return Solids(self._solids, name=title, unit=unit)
        facts = self._facts()
        name = str(facts.pop("name", "") or title)
        layers = sorted({path.layer for path in self.paths} | {mark.layer for mark in self.marks})
        self.notes.found.append(f"layers {listed(layers, 12)}")
        return Drawing(
            self.paths,
            self.marks,
            unit,
            facts,
            name,
            lost,
            tuple(str(layer.dxf.name) for layer in self.document.layers),
        )

    def _facts(self) -> dict[str, Any]:
        """Return the scene keys stored in the custom properties."""
        parts = sorted((str(key), str(value)) for key, value in self.document.header.custom_vars)
        text = "".join(value for key, value in parts if key[: len(FACTS)] == FACTS and key[len(FACTS) :].isdigit())
        if not text:
            return {}
        facts = json.loads(text)
        if not isinstance(facts, dict):
            raise InputError(FACTS, "the property holds no JSON object", "what jld export wrote")
        return {key: value for key, value in facts.items() if key in STORED}

    def _read(self, entity: Any, layer: str | None, depth: int) -> None:
        """Read one entity; count it as unread if there is no reader or nothing usable in it."""
        own_layer = str(entity.dxf.get("layer", "0"))
        layer = layer if layer is not None and own_layer == "0" else own_layer
        kind = entity.dxftype()
        off, frozen = self._switched(layer)
        if frozen or entity.dxf.get("invisible", 0) or (off and kind != "INSERT"):
            self.hidden[layer] += 1
            return
        if kind == "INSERT":
            self._insert(entity, layer, depth)
            return
        if kind in ("LINE", "LWPOLYLINE", "POLYLINE", "XLINE", "RAY") and self._is_axis(entity, layer):
            self.axes[layer] += 1
            return
        reader = getattr(self, f"_{kind.lower()}", None)
        if reader is None or not reader(entity, layer):
            self.unread[kind, layer] += 1

    def _is_axis(self, entity: Any, layer: str) -> bool:
        """Return True if a line is drawn in a line type of axes, its own or that of its layer."""
        name = str(entity.dxf.get("linetype", "BYLAYER"))
        if name.casefold() == "bylayer" and layer in self.document.layers:
            name = str(self.document.layers.get(layer).dxf.get("linetype", "CONTINUOUS"))
        return _AXIS.match(name) is not None and self.options.role(layer) is None

    def _switched(self, layer: str) -> tuple[bool, bool]:
        """Return whether a layer is off, and whether frozen: inside a block, only frozen hides other layers."""
        if layer not in self.document.layers:
            return False, False
        found_layer = self.document.layers.get(layer)
        return bool(found_layer.is_off()), bool(found_layer.is_frozen())

    def _insert(self, entity: Any, layer: str, depth: int) -> None:
        """Read a block reference: as a mark on a load layer, else by the entities of its block."""
        # An attribute id or name names the outline if the block has only one.
        if depth > _DEPTH:
            raise InputError("", "its blocks are nested too deeply", f"at most {_DEPTH} levels")
        attributes = [(str(a.dxf.tag).casefold(), str(a.dxf.text)) for a in entity.attribs]
        at = entity.dxf.insert  # in the system of the block, mirrored where its normal points down
        force = [text for tag, text in attributes if tag in ("force", "f", "load")]
        parts = dict(attributes)
        if "fx" in parts or "fy" in parts:
            force = ["; ".join(f"{tag} = {parts[tag]}" for tag in ("fx", "fy") if tag in parts)]
        if self.options.role(layer) in ("load", "dead"):
            self.marks.append(Mark((_side(entity) * at.x, at.y), layer, force[0] if force else None))
            return
        before = len(self.paths)
        for copy in entity.multi_insert() if entity.mcount > 1 else (entity,):
            for part in copy.virtual_entities():
                self.notes.reached("paths of blocks", len(self.paths))
                self._read(part, layer, depth + 1)
        names = [text for tag, text in attributes if tag in ("id", "name")]
        fresh = [k for k in range(before, len(self.paths)) if self.paths[k].closed]
        if names and len(fresh) == 1:
            path = self.paths[fresh[0]]
            self.paths[fresh[0]] = Path(path.points, path.closed, path.layer, names[0], path.holes)

    def _add(self, points: Any, layer: str, holes: tuple[Any, ...] = (), side: int = 1, *, closed: bool) -> bool:
        """Add a path (k, 3); False if inclined or of too few points. InputError: not finite, or too many lines."""
        if side == 0:
            return False
        mirror = np.array([side, 1, side], dtype=float)
        points = mirror * np.asarray(points, dtype=float).reshape(-1, 3)
        holes = tuple(mirror * hole for hole in holes)
        if not np.isfinite(points).all():
            raise InputError(f"layer {layer!r}", "it holds a coordinate that is no number", "finite numbers only")
        if len(points) > 1 and np.hypot(*(points[0] - points[-1])[:2]) <= 1e-9 * float(
            np.ptp(points[:, :2], axis=0).max()
        ):
            # closed by an end point at the first point
            points, closed = points[:-1], True
        # a closed path of two points has an area only with an arc
        if len(points) < 2 or (closed and len(points) < 3 and not points[:, 2].any()):
            return False
        self.paths.append(Path(points, closed, layer, holes=holes))
        if len(points) > MOST or len(self.paths) > MOST:
            raise InputError("", "it holds too many lines", f"at most {MOST}")
        return True

    def _lwpolyline(self, entity: Any, layer: str) -> bool:
        """Read a polyline with bulges; return False if it is unusable, see `_add`."""
        points = np.array(entity.get_points("xyb"), dtype=float).reshape(-1, 3)
        return self._add(points, layer, side=_side(entity), closed=bool(entity.closed))

    def _polyline(self, entity: Any, layer: str) -> bool:
        """Read an old-style polyline; return False for a mesh, or if it is unusable."""
        if not (entity.is_2d_polyline or entity.is_3d_polyline):
            return False
        points = [(v.dxf.location.x, v.dxf.location.y, v.dxf.get("bulge", 0.0)) for v in entity.vertices]
        side = _side(entity) if entity.is_2d_polyline else 1
        return self._add(points, layer, side=side, closed=bool(entity.is_closed))

    def _line(self, entity: Any, layer: str) -> bool:
        """Read a line; return False if it has no length in the plane."""
        start, end = entity.dxf.start, entity.dxf.end
        return self._add([(start.x, start.y, 0.0), (end.x, end.y, 0.0)], layer, closed=False)

    def _arc(self, entity: Any, layer: str) -> bool:
        """Read an arc; return False if it is unusable, see `_add`."""
        first = np.radians(entity.dxf.start_angle)
        sweep = np.mod(np.radians(entity.dxf.end_angle) - first, 2.0 * np.pi) or 2.0 * np.pi
        centre = entity.dxf.center
        points = arc_points((centre.x, centre.y), entity.dxf.radius, first, sweep)
        return self._add(points, layer, side=_side(entity), closed=False)

    def _circle(self, entity: Any, layer: str) -> bool:
        """Read a circle; return False if it is unusable, see `_add`."""
        centre = entity.dxf.center
        points = arc_points((centre.x, centre.y), entity.dxf.radius, 0.0, 2.0 * np.pi)[:-1]
        return self._add(points, layer, side=_side(entity), closed=True)

    def _curve(self, entity: Any, layer: str) -> bool:
        """Read an ellipse or spline as chords; return False if it is unusable, see `_add`."""
        points = self._chords(entity.construction_tool(), 8)
        flat = np.column_stack([points, 0.0 * points[:, 0]])
        return self._add(flat, layer, closed=bool(getattr(entity, "closed", False)))

    def _chords(self, curve: Any, pieces: int) -> Any:
        """Return points (k, 2) of a curve whose chords are a facet off; pieces: at least between two knots."""
        size = float(np.ptp(_flatten(curve, 1e30, 2 * pieces), axis=0).max())
        facet = FACET * size if self.options.facet is None else self.options.facet
        return _flatten(curve, max(facet, 1e-6 * size), pieces)

    _ellipse = _spline = _curve

    def _solid(self, entity: Any, layer: str) -> bool:
        """Read a filled triangle or quadrilateral; return False if it is unusable, see `_add`."""
        side = 1 if entity.dxftype() == "3DFACE" else _side(entity)
        corners = entity.wcs_vertices() if side == 1 else entity.vertices()
        return self._add([(p.x, p.y, 0.0) for p in corners], layer, side=side, closed=True)

    _trace = _3dface = _solid

    def _hatch(self, entity: Any, layer: str) -> bool:
        """Read the areas of a hatch, each with its holes; return False if it has none."""
        loops = [loop for path in entity.paths if not path.path_type_flags & _TEXT_BOX for loop in self._loop(path)]
        lost = sum(loop is None for loop in loops)
        self.notes.skip(f"boundaries of hatches on layer {layer}", lost, "open, or of other curves")
        areas = _areas([loop for loop in loops if loop is not None], int(entity.dxf.get("hatch_style", 0)))
        side = _side(entity)
        return bool(areas) and all(
            self._add(outline, layer, tuple(holes), side, closed=True) for outline, holes in areas
        )

    _mpolygon = _hatch

    def _region(self, entity: Any, layer: str) -> bool:
        """Read the plane faces of a region, of straight edges, as closed paths; return False if there are none."""
        any_read = False
        for body in import_module("ezdxf.acis.api").load_dxf(entity):
            for mesh in import_module("ezdxf.acis.api").mesh_from_body(body):
                for face in mesh.faces:
                    corners = [mesh.vertices[index] for index in face]
                    any_read |= self._add([(p.x, p.y, 0.0) for p in corners], layer, closed=True)
        return any_read

    def _mesh(self, entity: Any, layer: str) -> bool:
        """Read a mesh as a solid; return False without faces or with a wrong vertex number."""
        vertices = np.array([tuple(vertex) for vertex in entity.vertices], dtype=float).reshape(-1, 3)
        faces = tuple(tuple(int(index) for index in face) for face in entity.faces)
        if not faces or max(map(max, faces)) >= len(vertices):
            return False
        self._solids.append(Part("", layer, vertices, faces))
        return True

    def _3dsolid(self, entity: Any, layer: str) -> bool:
        """Read ACIS solids with plane faces and straight edges; return False if there are none."""
        before = len(self._solids)
        for body in import_module("ezdxf.acis.api").load_dxf(entity):
            for mesh in import_module("ezdxf.acis.api").mesh_from_body(body):
                points = np.array([tuple(vertex) for vertex in mesh.vertices], dtype=float)
                faces = tuple(tuple(face) for face in mesh.faces)
                self._solids.append(Part("", layer, points, faces))
        return len(self._solids) > before

    def _loop(self, path: Any) -> list[Any]:
        """Return the rings of a hatch boundary, (k, 3) rows x, y, bulge; None in the place of an open one."""
        # The bulge is the tangent of a quarter of the angle of the arc to the next point.
        if hasattr(path, "vertices"):
            ring = np.array([(v[0], v[1], v[2] if len(v) > 2 else 0.0) for v in path.vertices], dtype=float)
            return [ring] if len(ring) > 1 else []
        pieces: list[Any] = []
        for edge in path.edges:
            kind = type(edge).__name__
            if kind == "LineEdge":
                pieces.append(np.array([(*tuple(end)[:2], 0.0) for end in (edge.start, edge.end)]))
            elif kind == "ArcEdge":
                first = np.radians(edge.start_angle)
                sweep = np.mod(np.radians(edge.end_angle) - first, 2.0 * np.pi) or 2.0 * np.pi
                pieces.append(arc_points(tuple(edge.center)[:2], edge.radius, first, sweep))
            else:
                points = self._chords(edge.construction_tool(), 16)
                pieces.append(np.column_stack([points, np.zeros(len(points))]))
        return _rings(pieces)

    def _point(self, entity: Any, layer: str) -> bool:
        at = entity.dxf.location
        self.marks.append(Mark((at.x, at.y), layer))
        return True

    def _text(self, entity: Any, layer: str) -> bool:
        """Read a single-line text as a mark at its alignment point."""
        at = entity.dxf.insert
        if entity.dxf.get("halign", 0) or entity.dxf.get("valign", 0):
            at = entity.dxf.get("align_point", at)
        self.marks.append(Mark(((_side(entity) or 1) * at.x, at.y), layer, str(entity.dxf.text)))
        return True

    def _mtext(self, entity: Any, layer: str) -> bool:
        at = entity.dxf.insert
        self.marks.append(Mark((at.x, at.y), layer, str(entity.plain_text())))
        return True


_MOST_CHORDS: Final = 4096  # of a spline whose ends are not clamped


def _flatten(curve: Any, facet: float, pieces: int) -> Any:
    """Return points (k, 2) of a curve whose chords are `facet` off."""
    knots = curve.knots() if hasattr(curve, "knots") else ()
    low, high = (knots[curve.order - 1], knots[curve.count]) if knots else (0.0, 0.0)
    if not knots or (low, high) == (knots[0], knots[-1]):
        return np.array([tuple(point)[:2] for point in curve.flattening(facet, pieces)], dtype=float)
    while True:  # ezdxf flattens splines over all their knots, beyond the ends of those that are not clamped
        parameters = np.linspace(low, high, 4 * pieces + 1).tolist()
        points = np.array([tuple(point)[:2] for point in curve.points(parameters)], dtype=float)
        off = np.linalg.norm(0.5 * (points[:-2:2] + points[2::2]) - points[1::2], axis=1).max()
        if off < 4.0 * facet or 4 * pieces >= _MOST_CHORDS:
            return points
        pieces *= 2


def _backwards(piece: Any) -> Any:
    return np.column_stack([piece[::-1, :2], np.append(-piece[-2::-1, 2], 0.0)])


def _rings(pieces: list[Any]) -> list[Any]:
    """Join pieces (k, 3) of a boundary, in any order and direction, to closed rings; None for an open one."""
    if not pieces:
        return []
    size = float(np.ptp(np.concatenate(pieces)[:, :2], axis=0).max())
    free, rings = np.ones(len(pieces), dtype=bool), []
    ends = np.array([(piece[0, :2], piece[-1, :2]) for piece in pieces])

    def nearest(at: Any) -> tuple[int, int, float]:
        away = np.where(free[:, None], np.hypot(*np.moveaxis(ends - at, 2, 0)), np.inf)
        k, end = divmod(int(np.argmin(away)), 2)
        return k, end, float(away[k, end])

    for first in range(len(pieces)):
        if not free[first]:
            continue
        free[first], ring = False, [pieces[first]]
        while free.any() and np.hypot(*(ring[0][0] - ring[-1][-1])[:2]) > _JOINED * size:
            k, end, away = nearest(ring[-1][-1, :2])
            other = nearest(ring[0][0, :2])
            if other[2] < away:
                ring, (k, end, away) = [_backwards(piece) for piece in ring[::-1]], other
            if away > _OPEN * size:
                break
            free[k] = False
            ring[-1] = ring[-1][:-1]
            ring.append(_backwards(pieces[k]) if end else pieces[k])
        corners = np.concatenate(ring)
        open_ = np.hypot(*(corners[0] - corners[-1])[:2]) > _OPEN * size
        rings.append(None if open_ or len(corners) < 3 else corners[:-1])
    return rings


def _areas(rings: list[Any], style: int) -> list[tuple[Any, list[Any]]]:
    """Return the outlines of a hatch with holes by depth."""
    # style: 0 fills every second depth, 1 the outermost, 2 all that the outermost rings enclose.
    chords = [
        flatten([Path(ring, closed=True, layer="")], 1e-3 * float(np.ptp(ring[:, :2])), 0.0).points[0] for ring in rings
    ]
    shapes = [shapely.make_valid(shapely.Polygon(points)) for points in chords]
    inside = [shape.representative_point() for shape in shapes]
    around: list[list[int]] = [[] for _ in rings]
    within: list[list[int]] = [[] for _ in rings]
    for k, j in shapely.STRtree(shapes).query(inside, predicate="within").T.tolist() if shapes else ():
        if shapes[j].area > shapes[k].area:
            around[k].append(j)
            within[j].append(k)
    areas = []
    for k, outer in enumerate(around):
        if len(outer) % 2 or (style and outer):
            continue
        holes = [j for j in sorted(within[k]) if len(around[j]) == len(outer) + 1]
        areas.append((rings[k], [] if style == 2 else [rings[j] for j in holes]))
    return areas


def _side(entity: Any) -> int:
    """Return 1 for an entity in the plane, −1 for one seen from below (x reversed), 0 for an inclined one."""
    height = float(entity.dxf.get("extrusion", (0.0, 0.0, 1.0))[2])
    return 0 if abs(height) < 0.999 else 1 if height > 0.0 else -1
