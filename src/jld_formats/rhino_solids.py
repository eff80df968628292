"""Conversion of meshes, extrusions and polysurfaces of Rhino to polyhedra."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.exchange.holes import without_holes
from jld_core.geometry import Faces

# Largest distance from a plane or a line, relative to the size of the object, of what counts as plane or straight
_PLANE: Final = 1e-6


def polyhedron(geometry: Any, title: str) -> tuple[Floats, Faces]:
    """Return vertices (k, 3) and faces of a mesh, extrusion or polysurface of rhino3dm.

    title: words for the object in messages. Raises InputError for an object that is open or has a curved face. A face
    with holes becomes triangles.
    """
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
    """Return the vertices and faces of a mesh; vertices at one place become one."""
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
