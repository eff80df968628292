"""Two yield criteria: a ribbed section of inner faces, and joints with another friction in each direction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jld_core.mechanics import FaceGeometry, FaceRows, Gauge, Parameter


class Ribbed:
    """Inner faces of plates with ribs on one side: bending one way is stronger than the other, shear alike.

    Rows: n + σt ∓ 3m/κ ≥ 0, with κ = 1 for tension at the flat side and κ = `ratio` at the ribs, and |v| ≤ τ.
    """

    label = "inner"
    parameters = (
        Parameter("tensile_strength", "stress", least=0.0),
        Parameter("shear_strength", "stress", least=0.0),
        Parameter("ratio", least=0.1, most=10.0, default=1.0),
    )

    def rows(self, faces: FaceGeometry, values: Mapping[str, float]) -> FaceRows:
        tension, shear, ratio = values["tensile_strength"], values["shear_strength"], values["ratio"]
        bending = faces.bending(faces.kern)
        if faces.dimension == 2:
            bending[:, 1, 2] /= ratio
            sliding = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
            both = np.concatenate([bending, np.broadcast_to(sliding, (len(faces), 2, 3))], axis=1)
            return FaceRows(both, np.array([tension, tension, shear, shear]))
        bending[:, 0, 1:] /= ratio
        idle = ~np.any(bending != 0.0, axis=2)
        return FaceRows(bending, np.where(idle, 0.0, tension), (Gauge(np.eye(2), 1.0, shear),))


class HoekBrown:
    """Inner faces of rock, Hoek–Brown made of straight lines in the plane of normal and shear stress.

    The envelope is τ(n) = ½ √(m σc (n + σt)) with σt = s σc / m, tangents at `_POINTS` normal stresses. Bending is
    that of an uncracked section, |m| ≤ (n + σt)/3.
    """

    label = "inner"
    parameters = (
        Parameter("uniaxial_strength", "stress", least=0.0),
        Parameter("m", least=0.1, most=40.0),
        Parameter("s", least=0.0, most=1.0, default=1.0),
    )
    _POINTS = (0.02, 0.1, 0.3, 1.0)

    def rows(self, faces: FaceGeometry, values: Mapping[str, float]) -> FaceRows:
        strength, m, s = values["uniaxial_strength"], values["m"], values["s"]
        tension = s * strength / m
        sliding, constants = [], []
        for share in self._POINTS:
            over = share * strength
            height = 0.5 * np.sqrt(m * strength * over)
            slope = 0.5 * height / over
            for sign in (-1.0, 1.0):
                sliding.append((slope, sign, 0.0))
                constants.append(height + slope * (tension - over))
        bending = faces.bending(faces.kern)
        return FaceRows(
            np.concatenate([bending, np.broadcast_to(sliding, (len(faces), len(sliding), 3))], axis=1),
            np.concatenate([np.full(bending.shape[1], tension), constants]),
        )


class Orthotropic:
    """Joints in space whose friction differs along two directions: (V1/μ1)² + (V2/μ2)² ≤ N², less the torsion.

    The direction of μ1 is the axis e1 of a face. Rows keep the centre of pressure within the face.
    """

    label = "dry"
    parameters = (Parameter("first", least=0.01, most=5.0), Parameter("second", least=0.01, most=5.0))

    def rows(self, faces: FaceGeometry, values: Mapping[str, float]) -> FaceRows:
        bending = faces.bending(faces.edges)
        first, second = values["first"], values["second"]
        gauge = Gauge(np.diag([1.0 / first, 1.0 / second]), 1.0 / max(first, second), 0.0, 1.0)
        return FaceRows(bending, np.zeros(bending.shape[:2]), (gauge,))
