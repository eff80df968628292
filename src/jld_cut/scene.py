"""Scenes of cut solids: cells, joints, supports and loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.spatial import ConvexHull

from jld_core import Floats, ParameterError
from jld_cut.cells import JOINT, Cutting, Joint, basis, convex_pieces, lifted, sides_of
from jld_cut.loads import Facet, Load, Region, facet_of, outside, shares
from jld_cut.meshes import surface_of

_DEPTH: Final = 0.05  # of supports, by size


@dataclass(frozen=True)
class Matter:
    """Material of a solid, in kg, m, N and degrees."""

    density: float = 2400.0
    friction_angle: float = 35.0
    tensile: float = 2e6
    shear: float = 2e6
    compressive: float | None = None

    def document(self) -> dict[str, Any]:
        crushing = {} if self.compressive is None else {"compressive_strength": self.compressive}
        return {
            "density": self.density,
            "dry": {"friction_angle": self.friction_angle},  # those that crush must be rectangles
            "inner": {
                "tensile_strength": self.tensile,
                "shear_strength": self.shear,
                "friction_angle": self.friction_angle,
                **crushing,
            },
        }


@dataclass(frozen=True)
class Setting:
    """What stands below a solid, and what acts on it."""

    matter: Matter
    loads: list[Load]
    patches: list[Region]  # faces that are held; none for what lies on the ground


def held_faces(setting: Setting, facet: Facet, low: float, size: float) -> Facet:
    corners, normals = facet.corners, facet.normals
    if not setting.patches:
        held = (corners[:, :, 2] < low + 1e-6 * size).all(axis=1) & (normals[:, 2] < -0.9)
    else:
        held = np.zeros(len(corners), dtype=bool)
        for patch in setting.patches:
            assert patch.box is not None
            slack = 1e-6 * size
            held |= ((corners >= patch.box[:3] - slack) & (corners <= patch.box[3:] + slack)).all(axis=(1, 2))
    return Facet(corners[held], normals[held])


@dataclass(frozen=True)
class Ground:
    """Plane of a support: unit normal into the solid, offset, and all held corners in it."""

    plane: Floats
    corners: Floats


def grounds_of(setting: Setting, solid: Any) -> list[Ground]:
    """Return the supports of a solid, one for each plane of held faces; ParameterError for none."""
    box = np.array(solid.bounding_box())
    size = float((box[3:] - box[:3]).max())
    points, triangles = surface_of(solid)
    held = held_faces(setting, facet_of(points[triangles], size), float(box[2]), size)
    if not len(held.corners):
        where = "in its box" if setting.patches else "flat on the ground"
        raise ParameterError("support", f"no face of the solid lies {where}", "x0,y0,z0,x1,y1,z1 around whole faces")
    planes = np.column_stack([-held.normals, -np.einsum("ij,ij->i", held.normals, held.corners[:, 0])])
    _, first, place = np.unique(
        np.round(planes / [1e-6, 1e-6, 1e-6, 1e-6 * size]), axis=0, return_index=True, return_inverse=True
    )
    place = place.reshape(-1)
    return [Ground(planes[at], held.corners[place == k].reshape(-1, 3)) for k, at in enumerate(first.tolist())]


def _prism(ground: Ground, depth: float) -> dict[str, Any]:
    """Return vertices and faces of the support behind a plane."""
    normal = ground.plane[:3]
    hull = ConvexHull(ground.corners @ basis(normal).T)
    top = ground.corners[hull.vertices]
    count = len(top)
    below = top - depth * normal
    sides = [[k, k + count, (k + 1) % count + count, (k + 1) % count] for k in range(count)]
    faces = [list(range(count)), list(range(2 * count - 1, count - 1, -1)), *sides]
    return {"vertices": np.concatenate([top, below]).tolist(), "faces": faces}


def scene_of(
    name: str, cutting: Cutting, joints: list[Joint], setting: Setting, bent: float, cut_planes: list[Floats]
) -> dict[str, Any]:
    size, cells = cutting.size, cutting.cells
    names = [f"c{k + 1}" for k in range(len(cells))]
    elements: list[dict[str, Any]] = []
    for title, cell in zip(names, cells, strict=True):
        points, triangles = surface_of(cell)
        elements.append({"id": title, "vertices": points.tolist(), "faces": triangles.tolist()})
    interfaces = [
        {"elements": [names[joint.a], names[joint.b]], "polygon": joint.polygon.tolist()}
        for joint in joints
        if joint.area > JOINT * size**2
    ]
    for k, ground in enumerate(grounds_of(setting, cutting.solid)):
        support = f"ground{k + 1}"
        elements.append({"id": support, "support": True, **_prism(ground, _DEPTH * size)})
        for title, cell in zip(names, cells, strict=True):
            region = sides_of(cell, ground.plane, size)[1]
            for part in getattr(region, "geoms", [region]):
                if part.is_empty or part.geom_type != "Polygon" or part.area < JOINT * size**2:
                    continue
                interfaces += [
                    {"elements": [support, title], "polygon": lifted(piece, ground.plane).tolist()}
                    for piece in convex_pieces(part, 1e-7 * size, bent)
                ]
    facets = [outside(cell, cutting.solid, cut_planes, size) for cell in cells]
    live: list[dict[str, Any]] = []
    for load in setting.loads:
        if load.body:
            live.append({"body": load.vector.tolist()})
            continue
        live += [
            {"element": names[k], "force": force.tolist(), "at": at.tolist()} for k, force, at in shares(load, facets)
        ]
    return {
        "name": name,
        "units": {"length": "m", "force": "N"},
        "elements": elements,
        "interfaces": interfaces,
        "materials": setting.matter.document(),
        "loads": {"live": live},
    }
