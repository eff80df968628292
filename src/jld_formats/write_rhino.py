"""Writer of Rhino 3DM: blocks on layers by shape, faces, mechanism and thrust.

Uses rhino3dm. Blocks have user text.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import Floats, Layout
from jld_core.geometry import unions
from jld_core.limit import displacement
from jld_formats.facts import block_facts, facts_of, scene_of
from jld_formats.libraries import library
from jld_formats.read_mesh import solids_of
from jld_formats.read_rhino import FACTS, UNITS
from jld_formats.write_dem import weights_of
from jld_views import quantities

# Red, green and blue of the layers other than those of shapes
_COLOURS: Final = {
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
    """Rhino model under construction."""

    def __init__(self, rhino: Any, layout: Layout) -> None:
        self._rhino, self._layout = rhino, layout
        self.model = rhino.File3dm()
        named = {name: unit for unit, name in UNITS.items()}
        length = layout.assembly.units[0]
        unit = named.get(length)
        self.model.Settings.ModelUnitSystem = getattr(rhino.UnitSystem, unit) if unit else rhino.UnitSystem.Unset
        self._layers: dict[str, int] = {}
        self._facts = block_facts(layout)

    def _attributes(self, layer: str, name: str = "", facts: dict[str, Any] | None = None) -> Any:
        if layer not in self._layers:
            made = self._rhino.Layer()
            made.Name = layer
            shape = layer.rpartition("_")[2]
            colour = _COLOURS.get(layer) or _SHAPES[(int(shape) if shape.isdigit() else 0) % len(_SHAPES)]
            made.Color = (*colour, 255)
            self._layers[layer] = self.model.Layers.Add(made)
        found = self._rhino.ObjectAttributes()
        found.LayerIndex, found.Name = self._layers[layer], name
        for key, value in (facts or {}).items():
            found.SetUserString(key, f"{value:.12g}" if isinstance(value, float) else str(value))
        return found

    def _curve(self, points: Floats, closed: bool, attributes: Any) -> None:
        """Add a polyline; planar points (k, 2) lie at z = 0."""
        line = self._rhino.Polyline(len(points) + 1)
        for x, y, *z in [*points.tolist(), *(points[:1].tolist() if closed else [])]:
            line.Add(x, y, z[0] if z else 0.0)
        self.model.Objects.AddCurve(line.ToPolylineCurve(), attributes)

    def _layer_of(self, block: int) -> str:
        """Return the layer name of a block: "SUPPORTS", or that of its shape."""
        found = self._layout.blocks[block]
        return "SUPPORTS" if found.support and not found.cells else f"SHAPE_{found.shape:02d}"

    def _store(self, facts: dict[str, Any]) -> None:
        """Store scene data in the document's user text."""
        self.model.Strings[FACTS] = json.dumps(facts)

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
            self._curve(polygon, True, self._attributes("JOINTS" if dry else "CRACKS"))

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
                    self._curve(elements.shape[element], True, self._attributes(layer, elements.ids[element], facts))
                continue
            for region in layout.regions[k]:
                self._curve(region.shell, True, self._attributes(self._layer_of(k), block.name, facts))
        for hole in layout.openings:
            self._curve(hole, True, self._attributes("HOLES"))
        for polygon, dry in zip(faces.polygon, layout.labels, strict=True):
            self._curve(polygon, False, self._attributes("JOINTS" if dry else "CRACKS"))
        for name, (x, y) in zip(elements.ids, self._inside(), strict=True):
            self.model.Objects.AddTextDot(name, self._rhino.Point3d(x, y, 0.0), self._attributes("IDS"))

    def _inside(self) -> list[tuple[float, float]]:
        """Return a point inside each planar element."""
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
                    self._curve(moved, True, attributes)
                else:
                    for loop in assembly.elements.faces[element]:
                        self._curve(moved[list(loop)], True, attributes)
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
            self._curve(factor * line, False, self._attributes("THRUST"))
