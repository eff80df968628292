"""DXF as AutoCAD, LibreCAD, BricsCAD and other programs write it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import ezdxf.path
import shapely
from ezdxf import disassemble

from files.make import File

Corners = list[tuple[float, float]]
Draw = Callable[[Any, Any], None]
SUPPORT = {"layer": "SUPPORTS"}
VERSIONS = ("R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018")
CODES = {"": 0, "in": 1, "ft": 2, "mm": 4, "cm": 5, "m": 6}


def box(x0: float, y0: float, x1: float, y1: float) -> Corners:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def polyline(space: Any, corners: Corners, layer: str = "0") -> None:
    if space.dxfversion == "AC1009":
        space.add_polyline2d(corners, close=True, dxfattribs={"layer": layer})
    else:
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})


def lines(space: Any, corners: Corners, layer: str = "0") -> None:
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        space.add_line(a, b, dxfattribs={"layer": layer})


def hatch(space: Any, *rings: Corners, layer: str = "STONE", style: int = 0, flags: int = 1) -> Any:
    found = space.add_hatch(dxfattribs={"layer": layer, "hatch_style": style})
    for k, ring in enumerate(rings):
        found.paths.add_polyline_path(ring, is_closed=True, flags=flags if k == 0 else 16)
    return found


def edges(space: Any, corners: Corners, turned: tuple[int, ...] = ()) -> None:
    path = space.add_hatch(dxfattribs={"layer": "STONE"}).paths.add_edge_path()
    for k, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        path.add_line(*((b, a) if k in turned else (a, b)))


def writes(draw: Draw, unit: str = "m", version: str = "R2010") -> Callable[[Path], None]:
    def write(path: Path) -> None:
        document = ezdxf.new(version, setup=True)
        if version != "R12":
            document.header["$INSUNITS"] = CODES[unit]
        draw(document, document.modelspace())
        document.saveas(path)

    return write


def whole(path: Path) -> float:
    """Return the area of all that is closed in a drawing, by ezdxf's paths."""
    areas, loose = [], []
    for entity in disassemble.recursive_decompose(ezdxf.readfile(path).modelspace()):
        if entity.dxftype() in ("HATCH", "MPOLYGON"):
            area = shapely.Polygon()
            for ring in ezdxf.path.from_hatch(entity):
                area = area.symmetric_difference(shapely.Polygon([(p.x, p.y) for p in ring.flattening(1e-4)]))
            areas.append(area)
            continue
        if entity.dxftype() in ("SOLID", "3DFACE", "TRACE"):
            areas.append(shapely.Polygon([(p.x, p.y) for p in entity.wcs_vertices()]))
            continue
        try:
            path_ = ezdxf.path.make_path(entity)
        except TypeError:
            continue
        points = [(p.x, p.y) for p in path_.flattening(1e-4)]
        if path_.is_closed and len(points) > 3:
            areas.append(shapely.Polygon(points))
        else:
            loose.append(shapely.LineString(points))
    cells = shapely.polygonize([shapely.union_all(loose, grid_size=1e-6)]).geoms if loose else []
    return float(shapely.union_all([*areas, *cells]).area)


def _wall(draw: Callable[[Any, Corners, str], None]) -> Draw:
    """Three stones of 1 × 0.5 in two courses on a support."""

    def make(_: Any, space: Any) -> None:
        for corners in (box(0, 0, 1, 0.5), box(1, 0, 2, 0.5), box(0.5, 0.5, 1.5, 1)):
            draw(space, corners, "STONE")
        polyline(space, box(0, -0.3, 2, 0), "SUPPORTS")

    return make


def _filled(space: Any, corners: Corners, layer: str) -> None:
    a, b, c, d = corners
    space.add_solid([a, b, d, c], dxfattribs={"layer": layer})


def _face(space: Any, corners: Corners, layer: str) -> None:
    space.add_3dface(corners, dxfattribs={"layer": layer})


def _hatched(space: Any, corners: Corners, layer: str) -> None:
    hatch(space, corners, layer=layer)


def _inserted(space: Any, corners: Corners, layer: str) -> None:
    if "STEIN" not in space.doc.blocks:
        block = space.doc.blocks.new("STEIN")
        polyline(block, box(0, 0, 1, 0.5))
    space.add_blockref("STEIN", corners[0], dxfattribs={"layer": layer})


KINDS: dict[str, Callable[[Any, Corners, str], None]] = {
    "polylines": polyline,
    "lines": lines,
    "hatches": _hatched,
    "edges": lambda space, corners, _: edges(space, corners),
    "filled": _filled,
    "faces": _face,
    "blocks": _inserted,
}


def _versions() -> list[File]:
    found = []
    for version in VERSIONS:
        for kind, draw in KINDS.items():
            if version == "R12" and kind in ("hatches", "edges"):
                continue
            program = {"R12": "AutoCAD R12", "R2007": "LibreCAD 2.2", "R2018": "AutoCAD 2024"}.get(version, "BricsCAD")
            unit = "m"
            file = writes(_wall(draw), unit, version)
            found.append(File(f"wall_{kind}_{version}.dxf", program, file, 3, 1.5, unit, whole=whole))
    return found


def _hatches() -> list[File]:
    def many(_: Any, space: Any) -> None:
        hatch(space, *(box(x, y, x + 1, y + 0.5) for y in (0, 0.5, 1) for x in (0, 1, 2)), box(0.5, 1.5, 1.5, 2))
        hatch(space, box(0, -0.3, 3, 0), layer="SUPPORTS")

    def window(style: int, flags: int = 1) -> Draw:
        def make(_: Any, space: Any) -> None:
            hatch(space, box(0, 0, 3, 2), box(1, 0.8, 2, 1.4), style=style, flags=flags)
            hatch(space, box(0, -0.3, 3, 0), layer="SUPPORTS")

        return make

    def island(_: Any, space: Any) -> None:
        hatch(space, box(0, 0, 3, 2), box(1, 0.5, 2, 1.5), box(1, 0.5, 1.5, 1.5))
        hatch(space, box(0, -0.3, 3, 0), layer="SUPPORTS")

    def text_box(_: Any, space: Any) -> None:
        stone = hatch(space, box(0, 0, 3, 2))
        stone.paths.add_polyline_path(box(1, 0.9, 2, 1.1), is_closed=True, flags=8 | 16)
        hatch(space, box(0, -0.3, 3, 0), layer="SUPPORTS")

    def turned(which: tuple[int, ...]) -> Draw:
        def make(_: Any, space: Any) -> None:
            edges(space, box(0, 0, 1, 0.5), which)
            edges(space, box(0, 0.5, 1, 1))
            hatch(space, box(0, -0.3, 1, 0), layer="SUPPORTS")

        return make

    def arc(_: Any, space: Any) -> None:
        path = space.add_hatch(dxfattribs={"layer": "STONE"}).paths.add_edge_path()
        path.add_line((0, 0), (2, 0))
        path.add_arc((1, 0), 1.0, 0, 180)
        hatch(space, box(0, -0.3, 2, 0), layer="SUPPORTS")

    def ellipse(_: Any, space: Any) -> None:
        path = space.add_hatch(dxfattribs={"layer": "STONE"}).paths.add_edge_path()
        path.add_line((0, 0), (4, 0))
        path.add_ellipse((2, 0), (2, 0), 0.5, 0, 180)
        hatch(space, box(0, -0.3, 4, 0), layer="SUPPORTS")

    def spline(_: Any, space: Any) -> None:
        path = space.add_hatch(dxfattribs={"layer": "STONE"}).paths.add_edge_path()
        path.add_spline(control_points=[(2, 0), (2, 2), (0, 2), (0, 0)], degree=3, knot_values=[0, 0, 0, 0, 1, 1, 1, 1])
        path.add_line((0, 0), (2, 0))
        hatch(space, box(0, -0.3, 2, 0), layer="SUPPORTS")

    def mpolygon(_: Any, space: Any) -> None:
        stone = space.add_mpolygon(dxfattribs={"layer": "STONE"})
        stone.paths.add_polyline_path(box(0, 0, 3, 2), is_closed=True)
        stone.paths.add_polyline_path(box(1, 0.8, 2, 1.4), is_closed=True)
        polyline(space, box(0, -0.3, 3, 0), "SUPPORTS")

    def drawn_twice(_: Any, space: Any) -> None:
        polyline(space, box(0, 0, 3, 2), "OUTLINE")
        hatch(space, box(0, 0, 3, 2), box(1, 0.8, 2, 1.4))
        polyline(space, box(0, -0.3, 3, 0), "SUPPORTS")

    def region(_: Any, space: Any) -> None:
        space.add_region(dxfattribs={"layer": "STONE"})
        polyline(space, box(0, -0.3, 3, 0), "SUPPORTS")

    table: list[tuple[str, Draw, int, float]] = [
        ("hatch_of_ten", many, 10, 5.0),
        ("hatch_window", window(0), 2, 5.4),
        ("hatch_window_outer_style", window(1, 16), 2, 5.4),
        ("hatch_island", island, 3, 5.5),
        ("hatch_first_edge_reversed", turned((0,)), 2, 1.0),
        ("hatch_one_edge_reversed", turned((2,)), 2, 1.0),
        ("hatch_two_edges_reversed", turned((1, 3)), 2, 1.0),
        ("hatch_with_an_arc", arc, 1, math.pi / 2),
        ("hatch_with_an_ellipse", ellipse, 1, math.pi),
        ("hatch_with_a_spline", spline, 1, 2.4),
        ("mpolygon_window", mpolygon, 2, 5.4),
    ]
    second = [File(f"{n}.dxf", "AutoCAD", writes(d), count, area, whole=whole) for n, d, count, area in table]
    return [
        *second,
        File("outline_and_hatch.dxf", "AutoCAD", writes(drawn_twice), 2, 5.4),
        File("hatch_ignore_style.dxf", "AutoCAD", writes(window(2)), 1, 6.0),
        File("hatch_text_box.dxf", "AutoCAD", writes(text_box), 1, 6.0),
        File("region_without_data.dxf", "AutoCAD", writes(region), refused="all it holds are supports"),
    ]


def _blocks() -> list[File]:
    def with_block(draw: Callable[[Any], None]) -> Draw:
        def make(document: Any, space: Any) -> None:
            block = document.blocks.new("STEIN")
            polyline(block, [(0, 0), (1, 0), (1, 0.5), (0.2, 0.5)])
            draw(space)
            polyline(space, box(-3, -0.3, 3, 0), "SUPPORTS")

        return make

    def mirrored(space: Any) -> None:
        space.add_blockref("STEIN", (0, 0))
        space.add_blockref("STEIN", (0, 0), dxfattribs={"xscale": -1})

    def uneven(space: Any) -> None:
        space.add_blockref("STEIN", (0, 0), dxfattribs={"xscale": 2, "yscale": 0.5})

    def turned(space: Any) -> None:
        space.add_blockref("STEIN", (1, 0.5), dxfattribs={"rotation": 180})

    def grid(space: Any) -> None:
        space.add_blockref("STEIN", (-2, 0), dxfattribs={"column_count": 4, "column_spacing": 1})

    def nested(space: Any) -> None:
        pair = space.doc.blocks.new("PAAR")
        pair.add_blockref("STEIN", (0, 0))
        pair.add_blockref("STEIN", (1, 0))
        space.add_blockref("PAAR", (-2, 0))
        space.add_blockref("PAAR", (0, 0), dxfattribs={"yscale": 2})

    table = [("mirrored", mirrored, 2, 0.9), ("uneven", uneven, 1, 0.45), ("turned", turned, 1, 0.45)]
    table += [("grid", grid, 4, 1.8), ("nested", nested, 4, 2.7)]
    return [
        File(f"insert_{name}.dxf", "AutoCAD", writes(with_block(draw)), count, area, whole=whole)
        for name, draw, count, area in table
    ]


def _curves() -> list[File]:
    def arch(_: Any, space: Any) -> None:
        for radius in (1.0, 1.3):
            space.add_arc((0, 0), radius, 0, 180)
        for x in (-1.3, 1.0):
            space.add_line((x, 0), (x + 0.3, 0))
            polyline(space, box(x, -0.3, x + 0.3, 0), "AUFLAGER")

    def bulges(_: Any, space: Any) -> None:
        space.add_lwpolyline([(1, 0, 1), (-1, 0, 0), (-1.3, 0, -1), (1.3, 0, 0)], format="xyb", close=True)
        for x in (-1.3, 1.0):
            polyline(space, box(x, -0.3, x + 0.3, 0), "APPUIS")

    def ellipse(_: Any, space: Any) -> None:
        space.add_ellipse((0, 0), (2, 0), 0.5, 0, math.pi)
        space.add_line((-2, 0), (2, 0))
        polyline(space, box(-2, -0.3, 2, 0), "APPOGGI")

    def spline(_: Any, space: Any) -> None:
        space.add_spline(degree=3).control_points = [(2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 0)]
        space.query("SPLINE")[0].knots = [0, 0, 0, 0, 1, 1, 1, 1]
        space.add_line((0, 0), (2, 0))
        polyline(space, box(0, -0.3, 2, 0), "FUNDAMENT")

    def unclamped(_: Any, space: Any) -> None:  # from (2, 0) to (0, 0), as closed splines of CAD have their knots
        points = [(2, -1), (2, 0), (2, 1), (1, 2), (0, 1), (0, 0), (0, -1)]
        space.add_spline(degree=3).control_points = [(x, y, 0) for x, y in points]
        space.query("SPLINE")[0].knots = list(range(-3, 8))
        space.add_line((0, 0), (2, 0))
        polyline(space, box(0, -0.3, 2, 0), "FUNDAMENT")

    ring = math.pi / 2 * (1.3**2 - 1)
    table: list[tuple[str, Draw, float]] = [("arcs_and_lines", arch, ring), ("bulges", bulges, ring)]
    table += [("ellipse", ellipse, math.pi), ("spline", spline, 2.4), ("unclamped", unclamped, 2.672222)]
    # ezdxf, by which `whole` measures, runs beyond the ends of the last one
    return [
        File(f"curve_{n}.dxf", "AutoCAD", writes(draw), 1, area, whole=None if n == "unclamped" else whole)
        for n, draw, area in table
    ]


ROLES = {  # opening, support, axis, frame
    "english": ("WINDOWS", "FOUNDATION", "AXIS", "TITLEBLOCK"),
    "german": ("FENSTER", "AUFLAGER", "ACHSEN", "RAHMEN"),
    "italian": ("FINESTRE", "APPOGGI", "ASSI", "SQUADRATURA"),
    "french": ("FENÊTRES", "APPUIS", "AXES", "CARTOUCHE"),
    "spanish": ("VENTANAS", "CIMENTACIÓN", "EJES", "CAJETÍN"),
    "aia": ("A-GLAZ", "S-FNDN", "S-GRID", "A-ANNO-TTLB"),
    "iso13567": ("A-31----E-", "S-16----E-", "A-21----G-", "A-------B-"),
    "german_2": ("Öffnungen", "Gründung", "Mittellinie", "Plankopf"),
    "french_2": ("OUVERTURES", "FONDATIONS", "axe", "CADRE"),
    "spanish_2": ("HUECOS", "ZAPATAS", "EJE_1", "MARCO"),
    "italian_2": ("APERTURE", "FONDAZIONI", "ASSE", "CORNICE"),
    "english_2": ("DOOR OPENINGS", "GROUND", "Centerline", "Border"),
}


def _roles() -> list[File]:
    def office(names: tuple[str, str, str, str]) -> Draw:
        window, support, axis, frame = names

        def make(_: Any, space: Any) -> None:
            polyline(space, box(0, 0, 3, 2), "WALL")
            polyline(space, box(1, 0.8, 2, 1.4), window)
            polyline(space, box(0, -0.3, 3, 0), support)
            space.add_line((1.5, -1), (1.5, 3), dxfattribs={"layer": axis})
            polyline(space, box(-2, -2, 5, 4), frame)

        return make

    def plain(draw: Callable[[Any], None]) -> Draw:
        def make(_: Any, space: Any) -> None:
            polyline(space, box(0, 0, 3, 2), "WALL")
            polyline(space, box(0, -0.3, 3, 0), "SUPPORTS")
            draw(space)

        return make

    def frame(space: Any) -> None:
        polyline(space, box(-2, -2, 5, 4), "0")

    def sheet(space: Any) -> None:
        polyline(space, box(-2, -2, 5, -2 + 7 / 2**0.5), "0")
        polyline(space, box(-2.1, -2.1, 5.1, -1.9 + 7 / 2**0.5), "0")

    def by_linetype(space: Any) -> None:
        space.add_line((1.5, -1), (1.5, 3), dxfattribs={"layer": "0", "linetype": "CENTER"})

    def dimensioned(space: Any) -> None:
        space.add_linear_dim(base=(0, -1), p1=(0, 0), p2=(3, 0), dxfattribs={"layer": "BEMASSUNG"}).render()

    def window(layer: str) -> Callable[[Any], None]:
        return lambda space: polyline(space, box(1, 0.8, 2, 1.4), layer)

    def off(space: Any) -> None:
        polyline(space, box(3, 0, 4, 1), "ALT")
        space.doc.layers.add("ALT").off()

    def beside(space: Any) -> None:
        polyline(space, box(0, 2, 3, 3), "DACH")

    found = [
        File(f"office_{name}.dxf", "AutoCAD", writes(office(names)), 2, 5.4, dropped="frame")
        for name, names in ROLES.items()
    ]
    table: list[tuple[str, Callable[[Any], None], int, float, dict[str, Any], str]] = [
        ("frame_on_layer_0", frame, 1, 6.0, {}, ""),
        ("sheet_on_layer_0", sheet, 1, 6.0, {}, ""),
        ("axis_by_linetype", by_linetype, 1, 6.0, {}, ""),
        ("dimensions", dimensioned, 1, 6.0, {}, ""),
        ("window_asked_about", window("X1"), 3, 6.0, {}, "--hole X1"),
        ("window_by_option", window("X1"), 2, 5.4, {"hole": ("X1",)}, ""),
        ("layer_off", off, 1, 6.0, {}, ""),
        ("layer_chosen", beside, 1, 6.0, {"layer": ("WALL",)}, ""),
        ("layer_skipped", beside, 1, 6.0, {"skip": ("DA*",)}, ""),
    ]
    found += [
        File(f"{name}.dxf", "AutoCAD", writes(plain(draw)), count, area, options=options, doubtful=doubtful)
        for name, draw, count, area, options, doubtful in table
    ]
    return found


def _units() -> list[File]:
    def scaled(factor: float) -> Draw:
        def make(_: Any, space: Any) -> None:
            for k in range(4):
                corners = box(k * factor, 0, (k + 1) * factor, 0.5 * factor)
                polyline(space, corners, "STONE" if k else "SUPPORTS")

        return make

    table = [("mm", 400.0, "", 0.24), ("cm", 40.0, "", 0.24), ("in", 16.0, "", 0.24774), ("ft", 2.0, "", 0.55742)]
    table += [("in", 0.4, "--unit m", 1.5484e-4), ("mm", 0.4, "--unit m", 2.4e-7), ("", 400.0, "--unit mm", 2.4e5)]
    table += [("in", 400.0, "--unit mm", 154.84), ("ft", 400.0, "--unit mm", 22296.7), ("m", 40.0, "--unit cm", 2400.0)]
    return [
        File(
            f"unit_{unit or 'none'}_{size:g}.dxf",
            "AutoCAD",
            writes(scaled(size), unit),
            3,
            area,
            unit or "m",
            doubtful=doubtful,
            whole=whole,
        )
        for unit, size, doubtful, area in table
    ]


def files() -> list[File]:
    return [*_versions(), *_hatches(), *_blocks(), *_curves(), *_roles(), *_units()]
