"""Scenes of cut solids: cells and joints; supports and loads on regions of a surface, alike for every way to cut."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import shapely
from scipy.spatial import ConvexHull

from jld_core import Bools, Floats, ParameterError
from jld_cut.cells import JOINT, Cutting, Joint, basis, convex_pieces, lifted, sides_of
from jld_cut.meshes import normals_of, surface_of, triangles_of


@dataclass(frozen=True)
class Region:
    """Part of a surface: what a box (6,) along the axes holds; None for all of it."""

    box: Floats | None = None

    def clipped(self, corners: Floats) -> tuple[Floats, Floats]:
        """Return areas (k,) and centroids (k, 3) of the parts of triangles (k, 3, 3) in the region."""
        areas, middles = np.zeros(len(corners)), corners.mean(axis=1)
        for k, triangle in enumerate(corners):
            areas[k], middles[k] = _measure(triangle if self.box is None else _clip(triangle, self.box))
        return areas, middles


@dataclass(frozen=True)
class Load:
    """Force (3,) spread over the faces in a region that it presses on, or a multiple (3,) of the weight."""

    vector: Floats
    region: Region = Region()
    body: bool = False


def parse_region(name: str, text: str, unit: float) -> Region:
    """Return the region of a text x0,y0,z0,x1,y1,z1."""
    box = unit * numbers(name, text, 6)
    if (box[3:] < box[:3]).any():
        raise ParameterError(name, f"in {text!r} an upper corner is below the lower one", "x0,y0,z0,x1,y1,z1")
    return Region(box)


def parse_load(text: str, unit: float) -> Load:
    """Return a load of a text FX,FY,FZ, FX,FY,FZ@x0,y0,z0,x1,y1,z1 or body:X,Y,Z."""
    body, words = text.startswith("body:"), text.removeprefix("body:")
    force, separator, region = words.partition("@")
    if body and separator:
        raise ParameterError("load", f"{text!r} gives a share of the weight a place", "body:X,Y,Z")
    vector = numbers("load", force, 3)
    if not np.linalg.norm(vector):
        raise ParameterError("load", f"{text!r} is no load", "a force other than 0")
    return Load(vector, parse_region("load", region, unit) if separator else Region(), body)


def numbers(name: str, text: str, count: int) -> Floats:
    """Return the numbers of an option; ParameterError unless there are so many."""
    try:
        values = np.array([float(word) for word in text.split(",")])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        raise ParameterError(name, f"{text!r} is not {count} numbers", ",".join("xyzabc"[:count]).upper())
    return values


def _clip(polygon: Floats, box: Floats) -> Floats:
    """Return the part (k, 3) of a convex polygon inside a box (6,)."""
    for axis in range(3):
        for sign, bound in ((1.0, box[axis]), (-1.0, -box[axis + 3])):
            inside = sign * polygon[:, axis] - bound
            clipped = []
            for k in range(len(polygon)):
                j = (k + 1) % len(polygon)
                if inside[k] >= 0.0:
                    clipped.append(polygon[k])
                if (inside[k] >= 0.0) != (inside[j] >= 0.0):
                    share = inside[k] / (inside[k] - inside[j])
                    clipped.append(polygon[k] + share * (polygon[j] - polygon[k]))
            if len(clipped) < 3:
                return np.zeros((0, 3))
            polygon = np.array(clipped)
    return polygon


def _measure(polygon: Floats) -> tuple[float, Floats]:
    """Return area and centroid of a plane polygon (k, 3)."""
    if len(polygon) < 3:
        return 0.0, np.zeros(3)
    first, second = polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]
    area = 0.5 * np.linalg.norm(np.cross(first, second), axis=1)
    middles = (polygon[0] + polygon[1:-1] + polygon[2:]) / 3
    total = float(area.sum())
    return total, (area @ middles / total if total else polygon.mean(axis=0))


@dataclass(frozen=True)
class Facet:
    """Triangles of the surface of one cell that were the surface of the solid."""

    corners: Floats  # (k, 3, 3)
    normals: Floats  # (k, 3) outward units


def outside(cells: list[Any], solid: Any, planes: list[Floats], size: float) -> list[Facet]:
    """Return the triangles of each cell that are of the surface of the solid."""
    sides_of_solid = cache(lambda k: sides_of(solid, planes[k], size))
    facets = []
    for cell in cells:
        points, triangles = surface_of(cell)
        cut, rings = np.zeros(len(triangles), dtype=bool), list[Floats]()
        for k, plane in enumerate(planes):
            lies = (np.abs(points @ plane[:3] - plane[3]) < 1e-8 * size)[triangles].all(axis=1)
            if not (lies & ~cut).any():
                continue
            cut |= lies
            # a cut may run along a face of the solid
            for turn, of_cell, of_solid in zip((1, -1), sides_of(cell, plane, size), sides_of_solid(k), strict=True):
                common = shapely.get_parts(shapely.intersection(of_cell, of_solid, grid_size=1e-10 * size))
                for region in common[shapely.get_type_id(common) == 3].tolist():
                    for triangle in triangles_of(region):
                        rings.append(lifted(shapely.orient_polygons(triangle), plane)[::turn])
        flat = [ring[[0, k, k + 1]] for ring in rings for k in range(1, len(ring) - 1)]
        corners = np.concatenate([points[triangles[~cut]], np.array(flat).reshape(-1, 3, 3)])
        facets.append(facet_of(corners, size))
    return facets


def facet_of(corners: Floats, size: float) -> Facet:
    """Return triangles (k, 3, 3) with their normals, without those of no area."""
    normals, length = normals_of(corners)
    is_triangle: Bools = length > 1e-14 * size**2
    return Facet(corners[is_triangle], normals[is_triangle] / length[is_triangle, None])


SLIVER: Final = 1e-6  # least share of a load that a cell bears


def shares(load: Load, facets: list[Facet]) -> list[tuple[int, Floats, Floats]]:
    """Return cell, force (3,) and place (3,) of each part of a load; ParameterError where it meets no face."""
    direction = load.vector / np.linalg.norm(load.vector)
    loaded, total = [], 0.0
    for k, facet in enumerate(facets):
        press = np.maximum(-(facet.normals @ direction), 0.0)
        press[press < 1e-6] = 0.0
        hit = press > 0.0
        area, middle = load.region.clipped(facet.corners[hit])
        weight = press[hit] * area
        if (pressure := float(weight.sum())) > 0.0:
            loaded.append((k, pressure, weight @ middle / pressure))
            total += pressure
    if not loaded:
        raise ParameterError("load", "no face of the solid lies in its region and faces it", "a region on the surface")
    # corners in single precision leave slivers of a face on the pieces beside it
    large = [entry for entry in loaded if entry[1] > SLIVER * total]
    total = sum(pressure for _, pressure, _ in large)
    return [(k, load.vector * (pressure / total), middle) for k, pressure, middle in large]


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
            "dry": {"friction_angle": self.friction_angle},  # only rectangles may crush, and cuts have any outline
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
    """Return the triangles that are supported: in the patches of the setting, or at the bottom."""
    corners, normals = facet.corners, facet.normals
    if not setting.patches:
        is_held = (corners[:, :, 2] < low + 1e-6 * size).all(axis=1) & (normals[:, 2] < -0.9)
    else:
        is_held = np.zeros(len(corners), dtype=bool)
        for patch in setting.patches:
            assert patch.box is not None
            slack = 1e-6 * size
            is_held |= ((corners >= patch.box[:3] - slack) & (corners <= patch.box[3:] + slack)).all(axis=(1, 2))
    return Facet(corners[is_held], normals[is_held])


@dataclass(frozen=True)
class Ground:
    """Plane of a support: unit normal into the solid, offset, and all held corners in it."""

    plane: Floats
    corners: Floats
    region: Any  # in the frame of the plane


def grounds_of(setting: Setting, solid: Any) -> list[Ground]:
    """Return the supports of a solid, one for each plane of held faces; ParameterError for none."""
    box = np.array(solid.bounding_box())
    size = float((box[3:] - box[:3]).max())
    points, triangles = surface_of(solid)
    supported = held_faces(setting, facet_of(points[triangles], size), float(box[2]), size)
    if not len(supported.corners):
        where = "in its box" if setting.patches else "flat on the ground"
        raise ParameterError("support", f"no face of the solid lies {where}", "x0,y0,z0,x1,y1,z1 around whole faces")
    planes = np.column_stack([-supported.normals, -np.einsum("ij,ij->i", supported.normals, supported.corners[:, 0])])
    _, first, plane_of = np.unique(
        np.round(planes / [1e-6, 1e-6, 1e-6, 1e-6 * size]), axis=0, return_index=True, return_inverse=True
    )
    plane_of = plane_of.reshape(-1)
    grounds = []
    for k, plane in enumerate(first.tolist()):
        corners = supported.corners[plane_of == k]
        region = shapely.union_all(shapely.polygons(corners @ basis(planes[plane, :3]).T))
        grounds.append(Ground(planes[plane], corners.reshape(-1, 3), region))
    return grounds


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
    """Return the scene document of the cells of a cut."""
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
            # other faces may lie in the same plane
            region = shapely.intersection(sides_of(cell, ground.plane, size)[1], ground.region, grid_size=1e-10 * size)
            for part in shapely.get_parts(region).tolist():
                if part.is_empty or part.geom_type != "Polygon" or part.area < JOINT * size**2:
                    continue
                interfaces += [
                    {"elements": [support, title], "polygon": lifted(piece, ground.plane).tolist()}
                    for piece in convex_pieces(part, 1e-7 * size, bent)
                ]
    facets = outside(cells, cutting.solid, cut_planes, size)
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
