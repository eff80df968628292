"""Derivatives of λ by vertices of spatial structures with dry faces.

Source: docs/method.md (11.5).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.geometry import area_vector, spun
from jld_core.geometry.polygons import centroid, torsion_length
from jld_core.limit import LimitAnalysisResult
from jld_core.solvers.highs import highs_of
from jld_core.strengths import Route
from jld_geometry.planar_rates import shape_loads
from jld_geometry.spatial_mesh import spatial_mesh

_ROUTE: Final = Route("rates by the vertices of solids")

# Step of central differences of explicit functions of a polygon, relative to its size; their error is its square
_STEP: Final = 1e-5

# Share of the force of a face by which corner forces may miss its resultants before they are corrected
_ROUNDED: Final = 1e-9


def spatial_rates(result: LimitAnalysisResult, forces: Floats, mechanism: Floats) -> tuple[Floats, Floats] | None:
    """Return vertices (v, 3) and the derivatives (v, 3) of λ by their positions, scene units.

    None for a labelling with inner faces, or for dry faces that crush.

    forces: (m, 6) of the result; mechanism: (n, 6), scaled to live power 1.
    """
    assembly = result.assembly
    if not result.labels.all() or np.isfinite(assembly.strengths(_ROUTE).crush_dry).any():
        return None
    mesh = spatial_mesh(assembly)
    rates = np.zeros_like(mesh.places)
    for element in assembly.elements.free.tolist():
        own = _element_rates(assembly, element, mechanism[element], result.load_factor)
        np.add.at(rates, mesh.corners[element], own)
    for face, polygon in enumerate(mesh.polygons):
        np.add.at(rates, polygon, _face_rates(assembly, face, forces[face], mechanism))
    return mesh.places, rates


def _element_rates(assembly: Assembly, element: int, motion: Floats, load_factor: float) -> Floats:
    """Return minus the derivatives of an element's load power by its vertices, (k, 3).

    motion: (6,) velocity of the centroid, then rotation. load_factor: λ of the live loads. Scene units.
    """
    loads = assembly.dead_loads + load_factor * assembly.live_loads
    growing, riding = (load[element] for load in shape_loads(loads, assembly.elements))
    volume, by_volume, by_moment = volume_rates(assembly, element)
    # moments are about the centroid, so that the first moment of the whole vanishes
    lever = np.cross(riding, motion[3:])
    return np.asarray(-(float(growing @ motion[:3]) * by_volume + np.einsum("j,ijk->ik", lever, by_moment)) / volume)


def volume_rates(assembly: Assembly, element: int) -> tuple[float, Floats, Floats]:
    """Return the volume of an element, and the rates of volume and first moment by corners.

    The rates are (k, 3) and (k, 3, 3). The first moment is about the present centroid. Its rate [corner, i, j] is that
    of component i by coordinate j.
    """
    corner = assembly.elements.shape[element] - assembly.elements.centroid[element]
    volume, by_volume, by_moment = 0.0, np.zeros_like(corner), np.zeros((len(corner), 3, 3))
    for ring in assembly.elements.faces[element]:
        for second, third in itertools.pairwise(ring[1:]):
            own = [ring[0], second, third]
            x, y, z = corner[own]
            part = float(x @ np.cross(y, z)) / 6.0
            slopes = np.array([np.cross(y, z), np.cross(z, x), np.cross(x, y)]) / 6.0
            volume += part
            by_volume[own] += slopes
            by_moment[own] += np.einsum("j,ik->ijk", (x + y + z) / 4.0, slopes) + part / 4.0 * np.eye(3)
    return volume, by_volume, by_moment


@dataclass(frozen=True)
class HeldForces:
    """Forces of one face, held while its polygon changes.

    corner: (k,) normal forces at the corners. shear: (3,) force in the plane. normal: (3,) present normal. twist:
    torque over the torsion length.
    """

    corner: Floats
    shear: Floats
    normal: Floats
    twist: float

    def wrench(self, polygon: Floats) -> Floats:
        """Return force and moment about the origin (6,) of the held forces on the second element.

        polygon: (k, 3) present corners of the face.
        """
        vector = area_vector(polygon) if area_vector(polygon) @ self.normal > 0.0 else -area_vector(polygon)
        normal = vector / float(np.linalg.norm(vector))
        frame = plane_frame(normal, self.normal)
        flat = ((polygon - polygon[0]) @ frame.T)[None]
        middle = polygon[0] + centroid(flat)[0] @ frame + float(np.mean((polygon - polygon[0]) @ normal)) * normal
        shear = self.shear - (self.shear @ (normal - self.normal)) * self.normal
        ordered = flat if np.linalg.det(np.vstack([frame, normal])) > 0.0 else flat[:, ::-1]
        length = float(torsion_length(ordered)[0]) if self.twist else 0.0
        moment = np.cross(self.corner @ polygon, normal) + np.cross(middle, shear) + self.twist * length * normal
        return np.concatenate([float(self.corner.sum()) * normal + shear, moment])

    def rates(self, polygon: Floats) -> Floats:
        """Return the derivatives (k, 3, 6) of `wrench` by the corners of a polygon (k, 3)."""
        step = _STEP * float(np.ptp(polygon, axis=0).max())
        rates: Floats = np.empty((*polygon.shape, 6))
        for place in np.ndindex(*polygon.shape):
            more, less = polygon.copy(), polygon.copy()
            more[place] += step
            less[place] -= step
            rates[place] = (self.wrench(more) - self.wrench(less)) / (2.0 * step)
        return rates


def plane_frame(normal: Floats, beside: Floats) -> Floats:
    """Return two axes (2, 3) of the plane of a normal; they change smoothly with the normal.

    beside: unit normal nearby, which chooses the first axis.
    """
    first = np.eye(3)[int(np.argmin(abs(beside)))]
    first = first - (first @ normal) * normal
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def face_motion(assembly: Assembly, face: int, mechanism: Floats) -> tuple[Floats, Floats]:
    """Return the relative velocity (3,) at a face's origin and relative spin (3,).

    Both are those of its second element less those of the first. mechanism: (n, 6) velocities of the elements.
    """
    faces = assembly.interfaces
    velocity, spin = np.zeros(3), np.zeros(3)
    for element, sign in ((int(faces.a[face]), -1.0), (int(faces.b[face]), 1.0)):
        motion = mechanism[element]
        velocity += sign * (motion[:3] + spun(motion[3:], faces.origin[face] - assembly.elements.centroid[element]))
        spin += sign * motion[3:]
    return velocity, spin


def held_forces(assembly: Assembly, face: int, polygon: Floats, forces: Floats, gaps: Floats) -> HeldForces:
    """Convert the resultants of a face to corner forces, shear and twist that are held.

    polygon: (k, 3) corners about the origin of the face. forces: (6,) resultants. gaps: (k,) opening rates at the
    corners. Where corner forces are not unique, those of least power on the gaps are taken.
    """
    faces = assembly.interfaces
    axes = np.array([faces.e1[face], faces.e2[face]])
    corner = corner_forces(polygon @ axes.T, forces, gaps)
    shear = forces[1] * axes[0] + forces[2] * axes[1]
    return HeldForces(corner, shear, faces.normal[face], float(forces[5] / faces.c_t[face]))


def _face_rates(assembly: Assembly, face: int, forces: Floats, mechanism: Floats) -> Floats:
    """Return the derivatives (k, 3) of a face's dissipation minus power by its k corners.

    forces: (6,) of the face. mechanism: (n, 6) velocities of the elements. Both are in scene units.
    """
    faces = assembly.interfaces
    velocity, spin = face_motion(assembly, face, mechanism)
    # coordinates about the centroid keep all digits far from the origin
    polygon = faces.polygon[face] - faces.origin[face]
    if not velocity.any() and not spin.any():
        return np.zeros_like(polygon)
    normal, axes = faces.normal[face], np.array([faces.e1[face], faces.e2[face]])
    held = held_forces(assembly, face, polygon, forces, (velocity + spun(spin, polygon)) @ normal)
    rates = -held.rates(polygon) @ np.concatenate([velocity, spin])
    slip = max(float(np.linalg.norm(axes @ velocity)), float(faces.c_t[face] * abs(normal @ spin)))
    stuck = float(assembly.strengths(_ROUTE).cohesion[face]) * slip
    # dA/dx_i = ½ (x_{i+1} − x_{i−1}) × n, with the polygon counter-clockwise about n
    sign = np.sign(area_vector(polygon) @ normal)
    after = np.roll(polygon, -1, axis=0) - np.roll(polygon, 1, axis=0)
    return np.asarray(rates + 0.5 * stuck * sign * np.cross(after, normal))


def corner_forces(corner: Floats, forces: Floats, gaps: Floats) -> Floats:
    """Return the normal forces (k,) at corners that have a face's N, M1 and M2 as resultants.

    Of all such forces they have the least power on the gaps. corner: (k, 2) coordinates about the centroid. forces:
    (6,) resultants of the face. gaps: (k,) opening rates.
    """
    size = float(abs(corner).max())
    rows = np.vstack([np.ones(len(corner)), corner[:, 0] / size, corner[:, 1] / size])
    total = np.array([forces[0], -forces[4] / size, forces[3] / size])
    scale = float(abs(total).max())
    if scale == 0.0:
        return np.zeros(len(corner))
    most = float(abs(gaps).max()) or 1.0
    # a centre of pressure on an edge may lie outside by rounding: the rest is shared by all corners
    slack = np.full(3, _ROUNDED)
    none, free = np.zeros(len(corner)), np.full(len(corner), np.inf)
    program = highs_of(
        sp.csc_array(rows),
        gaps / most,
        total / scale - slack,
        total / scale + slack,
        none,
        free,
        {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    program.run()
    found = np.array(program.getSolution().col_value)
    left = total / scale - rows @ found
    return np.asarray(scale * (found + np.linalg.pinv(rows) @ left))
