"""Writer of VTK for ParaView (by meshio): surfaces of elements, interfaces, and fields."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.exchange.layout import Layout
from jld_core.exchange.libraries import library
from jld_core.exchange.write_mesh import solids_of
from jld_core.limit import displacement
from jld_core.views.quantities import face_vectors, utilisation

# Cell fields of one number each
_NAMES: Final = ("part", "element", "block", "shape", "support", "label", "utilisation", "normal_force")


class _Polygons:
    """Polygons of a layout with their fields, collected one element or interface at a time."""

    def __init__(self, layout: Layout) -> None:
        self.layout, self.result = layout, layout.result
        self.planar = layout.assembly.dimension == 2
        self.points: list[Floats] = []
        self.faces: list[tuple[int, ...]] = []
        self.rows: dict[str, list[float]] = {name: [] for name in _NAMES}
        self.forces: list[list[float]] = []
        self.motion: list[Floats] = []
        count = len(layout.assembly.interfaces)
        self._used, self._normal, self._vectors = np.zeros(count), np.zeros(count), np.zeros((count, 3))
        if self.result is not None and self.result.forces is not None:
            self._used, self._normal = utilisation(self.result), self.result.forces[:, 0]
            plain = face_vectors(layout.assembly, self.result.forces)
            self._vectors = np.column_stack([plain[:, 0], np.zeros(len(plain)), plain[:, 1]]) if self.planar else plain

    def add(self, corners: Floats, loops: list[tuple[int, ...]], element: int, part: int, face: int | None) -> None:
        """Add faces of an element or an interface with their fields.

        corners: (k, 3). loops: corner indices of each face. part: 0 for a surface, 1 for an interface. face: the
        interface, None for a surface.
        """
        start = sum(map(len, self.points))
        self.points.append(corners)
        self.motion.append(self._velocity(element, corners))
        block = int(self.layout.block_of[element])
        own = {
            "part": part,
            "element": element,
            "block": block,
            "shape": self.layout.blocks[block].shape,
            "support": float(self.layout.assembly.elements.support[element]),
            "label": -1.0 if face is None else float(self.layout.labels[face]),
            "utilisation": 0.0 if face is None else float(self._used[face]),
            "normal_force": 0.0 if face is None else float(self._normal[face]),
        }
        for loop in loops:
            self.faces.append(tuple(start + index for index in loop))
            for name, value in own.items():
                self.rows[name].append(value)
            self.forces.append([0.0, 0.0, 0.0] if face is None else self._vectors[face].tolist())

    def _velocity(self, element: int, corners: Floats) -> Floats:
        """Return the velocities (k, 3) of corners by the mechanism."""
        if self.result is None or self.result.mechanism is None:
            return np.zeros((len(corners), 3))
        flat = corners[:, [0, 2]] if self.planar else corners
        moved = displacement(self.layout.assembly, self.result.mechanism, element, flat)
        return np.column_stack([moved[:, 0], np.zeros(len(moved)), moved[:, 1]]) if self.planar else moved


def write_vtk(layout: Layout, path: Path, *, cells: bool = False) -> None:
    """Write a layout and its analysis as a VTK grid of polygons, for ParaView.

    A file that ends in .vtk has the older format. Raises InputError if meshio is missing.

    Each polygon is part 0 (surface of an element) or part 1 (interface). Its further fields are: element, block, shape,
    support, label, utilisation, force and normal_force. Label is 1 dry, 0 inner, and −1 on surfaces; force is the
    vector on element b, scene units. The field of the points is mechanism, the velocity that gives the live load power
    1. Without an analysis its fields are zero.
    """
    meshio = library("meshio", path)
    found = _polygons_of(layout)
    faces = found.faces
    order = sorted(range(len(faces)), key=lambda k: len(faces[k]))
    groups: list[tuple[str, list[tuple[int, ...]]]] = []
    for k in order:
        if not groups or len(groups[-1][1][0]) != len(faces[k]):
            groups.append(({3: "triangle", 4: "quad"}.get(len(faces[k]), "polygon"), []))
        groups[-1][1].append(faces[k])
    stops = np.cumsum([0, *(len(block) for _, block in groups)])

    def by_block(values: Floats) -> list[Floats]:
        """Split values (k, …) of polygons by cell type, in the order of the file."""
        return [values[order[a:b]] for a, b in itertools.pairwise(stops)]

    fields = {name: by_block(np.array(values)) for name, values in found.rows.items()}
    fields["force"] = by_block(np.array(found.forces))
    mesh = meshio.Mesh(
        np.concatenate(found.points),
        [(kind, np.array(block)) for kind, block in groups],
        point_data={"mechanism": np.concatenate(found.motion)},
        cell_data=fields,
    )
    if path.suffix == ".vtk":
        meshio.vtk.write(path, mesh, binary=True)
    else:
        meshio.vtu.write(path, mesh, binary=True)


def _polygons_of(layout: Layout) -> _Polygons:
    """Collect the surfaces of all elements, then the interfaces."""
    found = _Polygons(layout)
    interfaces = layout.assembly.interfaces
    for element, (_, _, surface) in enumerate(solids_of(layout, cells=True)):
        found.add(surface.points, list(surface.faces), element, 0, None)
    for face, polygon in enumerate(interfaces.polygon):
        corners = polygon
        if found.planar:
            (x0, z0), (x1, z1) = polygon.tolist()
            depth = layout.thickness
            corners = np.array([[x0, 0.0, z0], [x1, 0.0, z1], [x1, depth, z1], [x0, depth, z0]])
        found.add(corners, [tuple(range(len(corners)))], int(interfaces.a[face]), 1, face)
    return found
