"""Writer of VTK for ParaView (by meshio): surfaces of elements, interfaces, and fields."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from jld_core.arrays import Floats
from jld_core.exchange.layout import Layout
from jld_core.exchange.libraries import library
from jld_core.exchange.write_mesh import solids_of
from jld_core.limit import displacement
from jld_core.views.quantities import face_vectors, utilisation


def write_vtk(layout: Layout, path: Path, *, legacy: bool = False) -> None:
    """Write a layout and its analysis as an unstructured grid of polygons.

    Cell fields: part (0 surface of an element, 1 interface), element, block, shape, support, label (1 dry, 0 inner, −1
    on surfaces), utilisation, force (vector on b, scene units), normal_force. Point field: mechanism (velocity for live
    power 1). Fields of an analysis are zero where the layout has none. legacy: write the older format of files that end
    in .vtk. Raises InputError without meshio.
    """
    meshio = library("meshio", path)
    assembly, result = layout.assembly, layout.result
    points: list[Floats] = []
    faces: list[tuple[int, ...]] = []
    rows: dict[str, list[float]] = {
        name: [] for name in ("part", "element", "block", "shape", "support", "label", "utilisation", "normal_force")
    }
    forces: list[list[float]] = []
    motion: list[Floats] = []
    planar = assembly.dimension == 2

    def flat(corners: Floats) -> Floats:
        """Return planar coordinates of corners in a planar scene."""
        return corners[:, [0, 2]] if planar else corners

    def velocity(element: int, corners: Floats) -> Floats:
        """Return the velocities (k, 3) of corners by the mechanism."""
        if result is None or result.mechanism is None:
            return np.zeros((len(corners), 3))
        moved = displacement(assembly, result.mechanism, element, flat(corners))
        return np.column_stack([moved[:, 0], np.zeros(len(moved)), moved[:, 1]]) if planar else moved

    def add(corners: Floats, loops: list[tuple[int, ...]], element: int, part: int, face: int | None) -> None:
        """Add faces of an element or an interface with their fields."""
        start = sum(map(len, points))
        points.append(corners)
        motion.append(velocity(element, corners))
        block = int(layout.block_of[element])
        for loop in loops:
            faces.append(tuple(start + index for index in loop))
            rows["part"].append(part)
            rows["element"].append(element)
            rows["block"].append(block)
            rows["shape"].append(layout.blocks[block].shape)
            rows["support"].append(float(assembly.elements.support[element]))
            rows["label"].append(-1.0 if face is None else float(layout.labels[face]))
            known = face is not None and result is not None and result.forces is not None
            rows["utilisation"].append(float(used[face]) if known else 0.0)
            rows["normal_force"].append(float(result.forces[face, 0]) if known else 0.0)  # type: ignore[index,union-attr]
            forces.append(vectors[face].tolist() if known else [0.0, 0.0, 0.0])

    used = utilisation(result) if result is not None and result.forces is not None else np.zeros(0)
    vectors = np.zeros((len(assembly.interfaces), 3))
    if result is not None and result.forces is not None:
        plain = face_vectors(assembly, result.forces)
        vectors = np.column_stack([plain[:, 0], np.zeros(len(plain)), plain[:, 1]]) if planar else plain
    for element, (_, _, surface) in enumerate(solids_of(layout, cells=True)):
        add(surface.points, list(surface.faces), element, 0, None)
    for face, polygon in enumerate(assembly.interfaces.polygon):
        corners = polygon
        if planar:
            (x0, z0), (x1, z1) = polygon.tolist()
            depth = layout.thickness
            corners = np.array([[x0, 0.0, z0], [x1, 0.0, z1], [x1, depth, z1], [x0, depth, z0]])
        add(corners, [tuple(range(len(corners)))], int(assembly.interfaces.a[face]), 1, face)
    order = sorted(range(len(faces)), key=lambda k: len(faces[k]))
    cells: list[tuple[str, list[tuple[int, ...]]]] = []
    for k in order:
        if not cells or len(cells[-1][1][0]) != len(faces[k]):
            cells.append(({3: "triangle", 4: "quad"}.get(len(faces[k]), "polygon"), []))
        cells[-1][1].append(faces[k])
    stops = np.cumsum([0, *(len(block) for _, block in cells)])

    def by_block(values: Floats) -> list[Floats]:
        """Split values by cell type, in the order of the file."""
        return [values[order[a:b]] for a, b in itertools.pairwise(stops)]

    fields = {name: by_block(np.array(values)) for name, values in rows.items()}
    fields["force"] = by_block(np.array(forces))
    mesh = meshio.Mesh(
        np.concatenate(points),
        [(kind, np.array(block)) for kind, block in cells],
        point_data={"mechanism": np.concatenate(motion)},
        cell_data=fields,
    )
    if legacy:
        meshio.vtk.write(path, mesh, binary=True)
    else:
        meshio.vtu.write(path, mesh, binary=True)
