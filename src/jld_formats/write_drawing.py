"""Write layouts as DXF drawings and Rhino models."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Floats, Layout, ParameterError, files
from jld_core.geometry import outlines as polygons
from jld_core.geometry import unions
from jld_core.limit import displacement
from jld_formats.facts import block_facts, facts_of, scene_of
from jld_formats.libraries import library
from jld_formats.read_dxf import FACTS
from jld_formats.read_mesh import solids_of
from jld_formats.read_rhino import FACTS as RHINO_FACTS
from jld_formats.read_rhino import UNITS
from jld_formats.write_dem import weights_of
from jld_views import quantities

# Codes of the header variable $INSUNITS by length unit
_UNITS: Final = {"m": 6, "mm": 4, "cm": 5, "dm": 14, "km": 7, "in": 1, "ft": 2, "yd": 10}

# DXF colour numbers of the layers of block shapes, used cyclically
_COLOURS: Final = (1, 30, 50, 90, 130, 170, 210, 240)

# DXF colour numbers of the other layers
_LAYERS: Final = {
    "SUPPORTS": 8, "JOINTS": 7, "CRACKS": 1, "HOLES": 9, "IDS": 5, "BLOCK IDS": 3, "ARROWS": 1, "DIMENSIONS": 8,
}  # fmt: skip

_CHUNK: Final = 200  # largest number of characters per custom property


def write_dxf(layout: Layout, path: Path, *, cells: bool = False) -> None:
    """Write a DXF file: planar outlines and faces, or a mesh per block; InputError for "materials.faces"."""
    # A planar file also has ids, live loads and dimensions, and stores the scene's materials and loads.
    ezdxf = library("ezdxf", path)
    document = ezdxf.new(setup=True)
    document.header["$INSUNITS"] = _UNITS.get(layout.assembly.units[0], 0)
    space = document.modelspace()
    layers = {f"SHAPE_{n:02d}": _COLOURS[n % len(_COLOURS)] for n in sorted({b.shape for b in layout.blocks} - {0})}
    layers |= _LAYERS
    for name, colour in layers.items():
        document.layers.add(name, color=colour, lineweight=50 if name == "JOINTS" else 18)
    if layout.assembly.dimension == 3:
        for block, surfaces in zip(layout.blocks, layout.surfaces, strict=True):
            for surface in surfaces:
                mesh = space.add_mesh(dxfattribs={"layer": _layer(block.shape, block.support and not block.cells)})
                with mesh.edit_data() as data:
                    data.vertices = surface.points.tolist()
                    data.faces = [list(loop) for loop in surface.faces]
        document.saveas(path)
        return
    facts = json.dumps(scene_of(layout))
    for number, begin in enumerate(range(0, len(facts), _CHUNK)):
        document.header.custom_vars.append(f"{FACTS}{number:04d}", facts[begin : begin + _CHUNK])
    _draw(layout, space)
    document.saveas(path)


def _layer(shape: int, support: bool) -> str:
    return "SUPPORTS" if support else f"SHAPE_{shape:02d}"


def _draw(layout: Layout, space: Any) -> None:
    """Draw outlines, faces, names, live loads and dimensions of a planar layout."""
    elements, faces = layout.assembly.elements, layout.assembly.interfaces
    height = 0.15 * float(np.median(np.sqrt(layout.assembly.elements.volume / layout.thickness)))
    for k, block in enumerate(layout.blocks):
        if block.support:
            # draw the elements of a block joined to a support, so that supports remain recognisable
            for element in block.elements:
                layer = "SUPPORTS" if elements.support[element] else _layer(block.shape, False)
                space.add_lwpolyline(elements.shape[element].tolist(), close=True, dxfattribs={"layer": layer})
            continue
        for region in layout.regions[k]:
            space.add_lwpolyline(region.shell.tolist(), close=True, dxfattribs={"layer": _layer(block.shape, False)})
        x, y = block.centroid
        wide, tall = (high - low for low, high in zip(block.lower, block.upper, strict=True))
        words = f"stone {k + 1}, {block.name}: shape {block.shape}, {wide:.4g} × {tall:.4g}"
        _text(space, words, (x, y - 1.5 * height), 0.45 * height, "BLOCK IDS")
    for hole in layout.openings:
        space.add_lwpolyline(hole.tolist(), close=True, dxfattribs={"layer": "HOLES"})
    for polygon, dry in zip(faces.polygon, layout.labels, strict=True):
        space.add_line(*polygon.tolist(), dxfattribs={"layer": "JOINTS" if dry else "CRACKS"})
    for name, shape in zip(elements.ids, elements.shape, strict=True):
        _text(space, name, _inside(shape), height, "IDS")
    for _, point, force in layout.assembly.live_loads.arrows():
        length = float(np.linalg.norm(force))
        if length > 0.0:
            tail = point - 6.0 * height * force / length
            space.add_line(tail.tolist(), point.tolist(), dxfattribs={"layer": "ARROWS"})
            _text(space, f"{length:.6g}", (tail[0], tail[1] + 0.8 * height), 0.7 * height, "ARROWS")
    _dimensions(layout, space, height)


def _inside(outline: Floats) -> tuple[float, float]:
    """Return a point inside an outline: the centroid if it lies inside, else another point."""
    import shapely

    shape = shapely.Polygon(outline)
    point = shape.centroid if shape.contains(shape.centroid) else shape.representative_point()
    return float(point.x), float(point.y)


def _text(space: Any, words: str, at: tuple[float, float], height: float, layer: str) -> None:
    look = {"layer": layer, "height": height, "insert": at, "align_point": at, "halign": 4}
    space.add_text(files.printable(words).replace("\n", " "), dxfattribs=look)


def _dimensions(layout: Layout, space: Any, height: float) -> None:
    """Add dimensions of the overall width and height; height: of their text."""
    style = {"dimtxt": height, "dimasz": 0.6 * height, "dimexe": 0.4 * height, "dimexo": 0.4 * height}
    look = {
        "override": {**style, "dimgap": 0.4 * height, "dimlfac": 1, "dimdec": 3},
        "dxfattribs": {"layer": "DIMENSIONS"},
    }
    free = [block for block in layout.blocks if block.cells]
    x0, y0 = np.min([block.lower for block in free], axis=0).tolist()
    x1, y1 = np.max([block.upper for block in free], axis=0).tolist()
    away = 9.0 * height
    space.add_linear_dim(base=(x0, y1 + away), p1=(x0, y1), p2=(x1, y1), **look).render()
    space.add_linear_dim(base=(x0 - 0.5 * away, y0), p1=(x0, y0), p2=(x0, y1), angle=90, **look).render()


def _escaped(text: str) -> str:
    return escape(files.printable(text), quote=True)


def svg_text(layout: Layout, *, cells: bool = False) -> str:
    """Return the text of an SVG drawing of a planar layout, with one group per layer; InputError in space."""
    # Layers are block shapes, supports, joints, cracks and ids. Coordinates are in scene units with reversed y, since y
    # points down in SVG.
    if layout.assembly.dimension == 3:
        raise ParameterError("format", "the layout is spatial", "obj, ply, stl, compas, 3dec or vtk")
    elements = layout.assembly.elements
    low, high = elements.lower.min(axis=0), elements.upper.max(axis=0)
    size = float((high - low).max())
    margin, line = 0.03 * size, 0.003 * size
    box = (low[0] - margin, -high[1] - margin, high[0] - low[0] + 2 * margin, high[1] - low[1] + 2 * margin)

    def ring(points: Floats) -> str:
        return "M " + " L ".join(f"{x!r},{-y!r}" for x, y in points.tolist()) + " Z"

    groups: dict[str, list[str]] = {}
    for k, block in enumerate(layout.blocks):
        name = _escaped(block.name)
        if block.support:
            for element in block.elements:
                layer = "supports" if elements.support[element] else f"shape {block.shape}"
                own = _escaped(elements.ids[element])
                outline = ring(elements.shape[element])
                groups.setdefault(layer, []).append(f'<path data-name="{own}" d="{outline}"/>')
            continue
        for region in layout.regions[k]:
            outline = " ".join(ring(part) for part in (region.shell, *region.holes))
            groups.setdefault(f"shape {block.shape}", []).append(f'<path data-name="{name}" d="{outline}"/>')
    for polygon, dry in zip(layout.assembly.interfaces.polygon, layout.labels, strict=True):
        (x0, y0), (x1, y1) = polygon.tolist()
        layer = "joints" if dry else "cracks"
        groups.setdefault(layer, []).append(f'<path d="M {x0!r},{-y0!r} L {x1!r},{-y1!r}"/>')
    for name, shape in zip(elements.ids, elements.shape, strict=True):
        x, y = _inside(shape)
        groups.setdefault("ids", []).append(f'<text x="{x!r}" y="{-y!r}">{_escaped(name)}</text>')
    tall = 0.12 * float(np.median(np.sqrt(np.abs([polygons.area(s[None])[0] for s in elements.shape]))))
    looks = {
        "supports": f'fill="#c9c9c9" stroke="#555" stroke-width="{line:.6g}"',
        "joints": f'fill="none" stroke="#111" stroke-width="{2.0 * line:.6g}"',
        "cracks": f'fill="none" stroke="#8a3b12" stroke-width="{line:.6g}" stroke-dasharray="{3 * line:.6g}"',
        "ids": f'font-size="{tall:.6g}" text-anchor="middle" fill="#333" font-family="sans-serif"',
    }
    style = f'fill="#dfe8f2" stroke="#333" stroke-width="{line:.6g}"'
    body = [
        f'<g id="{layer}" {looks.get(layer, style)}>\n' + "\n".join(parts) + "\n</g>"
        for layer, parts in sorted(groups.items(), key=lambda item: (item[0] in looks, item[0] == "ids"))
    ]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{" ".join(f"{v:.9g}" for v in box)}" width="800">'
    return "\n".join([head, f"<title>{_escaped(layout.assembly.name)}</title>", *body, "</svg>"]) + "\n"


# Red, green and blue of the layers other than those of shapes
_RHINO_COLOURS: Final = {
    "SUPPORTS": (150, 150, 150), "JOINTS": (20, 20, 20), "CRACKS": (160, 60, 20), "HOLES": (200, 200, 200),
    "IDS": (90, 90, 160), "MECHANISM": (200, 60, 60), "THRUST": (30, 110, 60),
}  # fmt: skip

# Red, green and blue of the layers of shapes, used cyclically
_SHAPES: Final = ((223, 190, 140), (160, 190, 220), (190, 215, 160), (225, 170, 170), (200, 180, 220), (180, 215, 210))

_LENGTH: Final = 0.25  # length of the largest force line of a spatial layout, relative to the size of the assembly


def write_rhino(layout: Layout, path: Path, *, cells: bool) -> None:
    """Write a Rhino file of a layout: planar outlines in x–y, or in space a mesh per solid."""
    rhino = library("rhino3dm", path)
    file = _File(rhino, layout)
    if layout.assembly.dimension == 3:
        file.solids(cells)
    else:
        file.outlines()
    file.analysis()
    if not file.model.Write(str(path), 8):
        raise OSError(f"{path} cannot be written")


class _File:
    def __init__(self, rhino: Any, layout: Layout) -> None:
        self._rhino, self._layout = rhino, layout
        self.model = rhino.File3dm()
        rhino_units = {name: unit for unit, name in UNITS.items()}
        length = layout.assembly.units[0]
        unit = rhino_units.get(length)
        self.model.Settings.ModelUnitSystem = getattr(rhino.UnitSystem, unit) if unit else rhino.UnitSystem.Unset
        self._layers: dict[str, int] = {}
        self._facts = block_facts(layout)

    def _attributes(self, layer: str, name: str = "", facts: dict[str, Any] | None = None) -> Any:
        if layer not in self._layers:
            new_layer = self._rhino.Layer()
            new_layer.Name = layer
            shape = layer.rpartition("_")[2]
            colour = _RHINO_COLOURS.get(layer) or _SHAPES[(int(shape) if shape.isdigit() else 0) % len(_SHAPES)]
            new_layer.Color = (*colour, 255)
            self._layers[layer] = self.model.Layers.Add(new_layer)
        attributes = self._rhino.ObjectAttributes()
        attributes.LayerIndex, attributes.Name = self._layers[layer], name
        for key, value in (facts or {}).items():
            attributes.SetUserString(key, f"{value:.12g}" if isinstance(value, float) else str(value))
        return attributes

    def _curve(self, points: Floats, attributes: Any, *, closed: bool) -> None:
        """Add a polyline; planar points (k, 2) lie at z = 0."""
        line = self._rhino.Polyline(len(points) + 1)
        for x, y, *z in [*points.tolist(), *(points[:1].tolist() if closed else [])]:
            line.Add(x, y, z[0] if z else 0.0)
        self.model.Objects.AddCurve(line.ToPolylineCurve(), attributes)

    def _layer_of(self, block: int) -> str:
        block_found = self._layout.blocks[block]
        return "SUPPORTS" if block_found.support and not block_found.cells else f"SHAPE_{block_found.shape:02d}"

    def _store(self, facts: dict[str, Any]) -> None:
        """Store scene data in the document's user text."""
        self.model.Strings[RHINO_FACTS] = json.dumps(facts)

    def solids(self, cells: bool) -> None:
        """Add a mesh for each block, or each element, of a spatial layout."""
        layout = self._layout
        elements = layout.assembly.elements
        if cells:
            self._store(scene_of(layout, interfaces=True))
        else:
            self._store({**facts_of(layout, cells=False), "elements": weights_of(layout, cells)})
        owner = [int(k) for k in layout.block_of] if cells else [
            k for k, surfaces in enumerate(layout.surfaces) for _ in surfaces
        ]  # fmt: skip
        for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells)):
            block = owner[number]
            own_support = bool(elements.support[number]) if cells else support
            layer = "SUPPORTS" if own_support else self._layer_of(block)
            attributes = self._attributes(layer, name, self._facts[block].entries())
            self.model.Objects.AddMesh(self._mesh(surface), attributes)
        for polygon, dry in zip(layout.assembly.interfaces.polygon, layout.labels, strict=True):
            self._curve(polygon, self._attributes("JOINTS" if dry else "CRACKS"), closed=True)

    def _mesh(self, surface: unions.Surface) -> Any:
        """Return a closed surface as a mesh with coordinates in double precision."""
        mesh = self._rhino.Mesh()
        mesh.Vertices.UseDoublePrecisionVertices = True
        for x, y, z in surface.points.tolist():
            mesh.Vertices.AddPoint3d(x, y, z)
        small = all(len(loop) <= 4 for loop in surface.faces)
        for loop in surface.faces if small else surface.triangles:
            mesh.Faces.AddFace(*loop)
        mesh.Normals.ComputeNormals()
        return mesh

    def outlines(self) -> None:
        """Add outlines, faces and names of a planar layout, as a drawing has them."""
        layout = self._layout
        elements, faces = layout.assembly.elements, layout.assembly.interfaces
        self._store(scene_of(layout))
        for k, block in enumerate(layout.blocks):
            facts = self._facts[k].entries()
            if block.support:
                for element in block.elements:
                    layer = "SUPPORTS" if elements.support[element] else f"SHAPE_{block.shape:02d}"
                    self._curve(
                        elements.shape[element], self._attributes(layer, elements.ids[element], facts), closed=True
                    )
                continue
            for region in layout.regions[k]:
                self._curve(region.shell, self._attributes(self._layer_of(k), block.name, facts), closed=True)
        for hole in layout.openings:
            self._curve(hole, self._attributes("HOLES"), closed=True)
        for polygon, dry in zip(faces.polygon, layout.labels, strict=True):
            self._curve(polygon, self._attributes("JOINTS" if dry else "CRACKS"), closed=False)
        for name, (x, y) in zip(elements.ids, self._inside(), strict=True):
            self.model.Objects.AddTextDot(name, self._rhino.Point3d(x, y, 0.0), self._attributes("IDS"))

    def _inside(self) -> list[tuple[float, float]]:
        import shapely

        shapes = [shapely.Polygon(shape).representative_point() for shape in self._layout.assembly.elements.shape]
        return [(float(point.x), float(point.y)) for point in shapes]

    def analysis(self) -> None:
        """Add the moved blocks of the mechanism and the lines of thrust, if analysed."""
        layout, result = self._layout.drawn_from or self._layout, self._layout.result
        if result is None:
            return
        assembly = layout.assembly
        factor = self._layout.assembly.size / assembly.size
        if result.mechanism is not None:
            scale = quantities.mechanism_scale(assembly, result.mechanism)
            for element in assembly.elements.free.tolist():
                name = assembly.elements.ids[element]
                points = assembly.elements.shape[element]
                moved = factor * (points + scale * displacement(assembly, result.mechanism, element, points))
                attributes = self._attributes("MECHANISM", name)
                if assembly.dimension == 2:
                    self._curve(moved, attributes, closed=True)
                else:
                    for loop in assembly.elements.faces[element]:
                        self._curve(moved[list(loop)], attributes, closed=True)
        if result.forces is None:
            return
        vectors = quantities.face_vectors(assembly, result.forces)
        if assembly.dimension == 2:
            lines = quantities.thrust_segments(assembly, result.forces)
        else:
            points, _ = quantities.pressure_points(assembly, result.forces)
            largest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
            half = 0.5 * _LENGTH * assembly.size * vectors / largest if largest else vectors
            lines = [np.array([p - h, p + h]) for p, h in zip(points, half, strict=True) if np.any(h)]
        for line in lines:
            self._curve(factor * line, self._attributes("THRUST"), closed=False)
