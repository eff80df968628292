"""Time steps of a planar assembly with its geometry at rest: the loop that everything else waits for."""

from __future__ import annotations

import numpy as np

from jld_core.assembly import Bools, Floats, Ints
from jld_experiment.compiled import compiled
from jld_experiment.laws import contact_stress


@compiled
def face_forces(
    step: Floats,
    force: Floats,
    ends: Ints,
    frame: Floats,
    first: Ints,
    place: Floats,
    law: Floats,
    brittle: Bools,
    gaps: Bools,
    overlap: Floats,
    shear: Floats,
    pressure: Floats,
    broken: Bools,
) -> None:
    """Move every sub-contact by one step and add the forces of all faces to the elements.

    step: (n, 3) movement of the elements. force: (n, 3), added to. ends: (m, 2) elements a and b. frame: (m, 6)
    normal x, y, then r × n and r × t for the arms to the face's middle from a and from b. first: (m + 1,) where each
    face's sub-contacts begin. place: (s, 2) coordinate along t, and area. law: (m, 8) kn, ks, friction, dilation,
    cohesion, tension, crushing, friction once broken. brittle, gaps: (m,). overlap, shear, pressure, broken: (s,)
    state, changed in place.
    """
    for f in range(len(ends)):
        a, b = ends[f, 0], ends[f, 1]
        nx, ny = frame[f, 0], frame[f, 1]
        dx, dy = step[b, 0] - step[a, 0], step[b, 1] - step[a, 1]
        turn = step[b, 2] - step[a, 2]
        opening = dx * nx + dy * ny + step[b, 2] * frame[f, 4] - step[a, 2] * frame[f, 2]
        slip = dy * nx - dx * ny + step[b, 2] * frame[f, 5] - step[a, 2] * frame[f, 3]
        kn, ks = law[f, 0], law[f, 1]
        normal, tangent, moment = 0.0, 0.0, 0.0
        for k in range(first[f], first[f + 1]):
            s = place[k, 0]
            e = overlap[k] - opening + s * turn
            p = kn * e
            q = shear[k] - ks * slip
            mu, tension, cohesion = law[f, 2], law[f, 5], law[f, 4]
            if broken[k]:
                mu, tension, cohesion = law[f, 7], 0.0, 0.0
            if p < -tension or p > law[f, 6] or abs(q) > cohesion + mu * p:
                psi = 0.0 if broken[k] else law[f, 3]
                if brittle[f] and not broken[k] and (p < -tension or abs(q) > cohesion + mu * p):
                    broken[k] = True
                    mu, psi, tension, cohesion = law[f, 7], 0.0, 0.0, 0.0
                open_ = gaps[f] or broken[k]
                e, p, q = contact_stress(e, shear[k], slip, kn, ks, mu, psi, cohesion, tension, law[f, 6], open_)
            overlap[k], shear[k], pressure[k] = e, q, p
            part = p * place[k, 1]
            normal += part
            moment -= s * part
            tangent += q * place[k, 1]
        fx, fy = normal * nx - tangent * ny, normal * ny + tangent * nx
        force[b, 0] += fx
        force[b, 1] += fy
        force[b, 2] += normal * frame[f, 4] + tangent * frame[f, 5] + moment
        force[a, 0] -= fx
        force[a, 1] -= fy
        force[a, 2] -= normal * frame[f, 2] + tangent * frame[f, 3] + moment
