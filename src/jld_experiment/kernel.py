"""Time steps of an assembly: the loop that everything else waits for, and faces whose geometry stays at rest.

Central differences with a step of one; masses are scaled by the caller so that one is stable.
"""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_experiment.compiled import compiled
from jld_experiment.laws import contact_stress
from jld_experiment.moving import Geometry, corner_forces, moving_forces, near_pairs

Drive = tuple[bool, float, float, float]

# columns of `law`, one row a face
KN, KS, FRICTION, DILATION, COHESION, TENSION, CRUSHING, RESIDUAL = range(8)


@compiled
def planar_forces(
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
    pressure: Floats,
    shear: Floats,
    broken: Bools,
) -> None:
    """Move every planar sub-contact by one step and add the forces of all faces to the elements.

    step: (n, 3) movement of the elements. force: (n, 3), added to. ends: (m, 2) elements a and b. frame: (m, 6)
    normal x, y, then r × n and r × t for the arms to the middle of the face from a and from b. first: (m + 1,) where
    the sub-contacts of each face begin. place: (s, 2) coordinate along t, and area. law: (m, 8), columns as named
    above. brittle, gaps: (m,). overlap, pressure, shear (s, 1), broken: (s,) state, changed in place.
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
            q = shear[k, 0] - ks * slip
            mu, psi, cohesion, tension = law[f, 2], law[f, 3], law[f, 4], law[f, 5]
            if broken[k]:
                mu, psi, cohesion, tension = law[f, 7], 0.0, 0.0, 0.0
            failing = p < -tension or abs(q) > cohesion + mu * p
            if failing or p > law[f, 6]:
                if failing and brittle[f] and not broken[k]:
                    broken[k] = True
                    mu, psi, cohesion, tension = law[f, 7], 0.0, 0.0, 0.0
                kept = gaps[f] or broken[k]
                e, p, size = contact_stress(e, abs(q), kn, ks, mu, psi, cohesion, tension, law[f, 6], kept)
                q = size if q > 0.0 else -size
            overlap[k], pressure[k], shear[k, 0] = e, p, q
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


@compiled
def spatial_forces(
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
    pressure: Floats,
    shear: Floats,
    broken: Bools,
) -> None:
    """The same in space. step, force: (n, 6). frame: (m, 15) normal, e1, e2, then the arms to the middle of the face
    from a and from b. place: (s, 3) coordinates along e1 and e2, and area. shear: (s, 2) along e1 and e2.
    """
    jump = np.empty((3, 2))
    for f in range(len(ends)):
        a, b = ends[f, 0], ends[f, 1]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            far = step[b, i] + step[b, 3 + j] * frame[f, 12 + k] - step[b, 3 + k] * frame[f, 12 + j]
            near = step[a, i] + step[a, 3 + j] * frame[f, 9 + k] - step[a, 3 + k] * frame[f, 9 + j]
            jump[i, 0] = far - near
            jump[i, 1] = step[b, 3 + i] - step[a, 3 + i]
        opening, slip1, slip2, turn1, turn2, twist = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            opening += jump[i, 0] * frame[f, i]
            slip1 += jump[i, 0] * frame[f, 3 + i]
            slip2 += jump[i, 0] * frame[f, 6 + i]
            twist += jump[i, 1] * frame[f, i]
            turn1 += jump[i, 1] * frame[f, 3 + i]
            turn2 += jump[i, 1] * frame[f, 6 + i]
        kn, ks = law[f, 0], law[f, 1]
        normal, along1, along2, moment1, moment2, torsion = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(first[f], first[f + 1]):
            x1, x2, area = place[k, 0], place[k, 1], place[k, 2]
            e = overlap[k] - opening - turn1 * x2 + turn2 * x1
            p = kn * e
            q1 = shear[k, 0] - ks * (slip1 - twist * x2)
            q2 = shear[k, 1] - ks * (slip2 + twist * x1)
            mu, psi, cohesion, tension = law[f, 2], law[f, 3], law[f, 4], law[f, 5]
            if broken[k]:
                mu, psi, cohesion, tension = law[f, 7], 0.0, 0.0, 0.0
            trial = np.sqrt(q1 * q1 + q2 * q2)
            failing = p < -tension or trial > cohesion + mu * p
            if failing or p > law[f, 6]:
                if failing and brittle[f] and not broken[k]:
                    broken[k] = True
                    mu, psi, cohesion, tension = law[f, 7], 0.0, 0.0, 0.0
                kept = gaps[f] or broken[k]
                e, p, size = contact_stress(e, trial, kn, ks, mu, psi, cohesion, tension, law[f, 6], kept)
                share = size / trial if trial > 0.0 else 0.0
                q1 *= share
                q2 *= share
            overlap[k], pressure[k], shear[k, 0], shear[k, 1] = e, p, q1, q2
            normal += p * area
            along1 += q1 * area
            along2 += q2 * area
            moment1 += p * area * x2
            moment2 -= p * area * x1
            torsion += (x1 * q2 - x2 * q1) * area
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            part = normal * frame[f, i] + along1 * frame[f, 3 + i] + along2 * frame[f, 6 + i]
            after = normal * frame[f, j] + along1 * frame[f, 3 + j] + along2 * frame[f, 6 + j]
            last = normal * frame[f, k] + along1 * frame[f, 3 + k] + along2 * frame[f, 6 + k]
            couple = torsion * frame[f, i] + moment1 * frame[f, 3 + i] + moment2 * frame[f, 6 + i]
            force[b, i] += part
            force[a, i] -= part
            force[b, 3 + i] += frame[f, 12 + j] * last - frame[f, 12 + k] * after + couple
            force[a, 3 + i] -= frame[f, 9 + j] * last - frame[f, 9 + k] * after + couple


@compiled
def driven(
    force: Floats, velocity: Floats, live: Floats, inverse: Floats, radius: Floats, drive: Drive
) -> tuple[float, float, float]:
    """Velocities after one step under given forces. drive: is it pushed, λ, live velocity, damping.

    Returns λ, the largest out-of-balance force, and the largest speed.
    """
    count, q = velocity.shape
    d = 2 if q == 3 else 3
    push, factor, rate, damping = drive
    weight, given, speed = 0.0, 0.0, 0.0
    if push:
        for i in range(count):
            for j in range(q):
                share = live[i, j] * inverse[i, 0 if j < d else 1]
                weight += live[i, j] * share
                given += share * force[i, j]
                speed += live[i, j] * velocity[i, j]
        factor = (rate - speed - given) / weight
    lost, worst, fastest = 0.0, 0.0, 0.0
    for i in range(count):
        if inverse[i, 0] == 0.0:
            continue
        for part in range(2):
            low, high = (0, d) if part == 0 else (d, q)
            size, speed = 0.0, 0.0
            for j in range(low, high):
                force[i, j] += factor * live[i, j]
                size += force[i, j] * force[i, j]
                speed += velocity[i, j] * velocity[i, j]
            size, speed = np.sqrt(size), np.sqrt(speed)
            length = 1.0 if part == 0 else radius[i]
            worst = max(worst, size / length)
            fastest = max(fastest, speed * length)
            if speed > 0.0:
                for j in range(low, high):
                    drag = damping * size * velocity[i, j] / speed
                    force[i, j] -= drag
                    lost += live[i, j] * drag * inverse[i, part]
    held = lost / weight if push else 0.0
    for i in range(count):
        for j in range(q):
            velocity[i, j] += (force[i, j] + held * live[i, j]) * inverse[i, 0 if j < d else 1]
    return factor, worst, fastest


@compiled
def march(
    steps: int,
    push: bool,
    dead_ends: tuple[float, float],
    factor_ends: tuple[float, float],
    rate_ends: tuple[float, float],
    damping: float,
    dead: Floats,
    live: Floats,
    inverse: Floats,
    radius: Floats,
    moved: Floats,
    velocity: Floats,
    ends: Ints,
    frame: Floats,
    first: Ints,
    place: Floats,
    law: Floats,
    brittle: Bools,
    gaps: Bools,
    overlap: Floats,
    pressure: Floats,
    shear: Floats,
    broken: Bools,
) -> tuple[float, float, float]:
    """Advance by a number of steps under dead loads and either a live load factor or a live velocity, at rest geometry.

    push: hold live·velocity at a rate and find λ as the multiplier of that constraint; otherwise λ runs as factor_ends
    says. dead_ends, factor_ends, rate_ends: share of the dead loads, λ and rate, from the first step to the last,
    linear. damping: share of the out-of-balance force that acts against the movement, forces and moments apart, so
    that no direction is preferred. dead, live: (n, q) loads. inverse: (n, 2) one over mass and over inertia, 0 on
    supports. radius: (n,) by which moments are compared with forces. moved, velocity: (n, q) state, changed in place;
    the rest as in `planar_forces`. Returns the mean of λ, the largest out-of-balance force and the largest speed.
    """
    force = np.empty(velocity.shape)
    mean, worst, fastest = 0.0, 0.0, 0.0
    for turn in range(steps):
        share = (turn + 1.0) / steps
        begin(moved, velocity, force, dead, dead_ends[0] + (dead_ends[1] - dead_ends[0]) * share)
        if velocity.shape[1] == 3:
            planar_forces(
                velocity, force, ends, frame, first, place, law, brittle, gaps, overlap, pressure, shear, broken
            )
        else:
            spatial_forces(
                velocity, force, ends, frame, first, place, law, brittle, gaps, overlap, pressure, shear, broken
            )
        factor = factor_ends[0] + (factor_ends[1] - factor_ends[0]) * share
        rate = rate_ends[0] + (rate_ends[1] - rate_ends[0]) * share
        found, size, speed = driven(force, velocity, live, inverse, radius, (push, factor, rate, damping))
        mean, worst, fastest = mean + found, max(worst, size), max(fastest, speed)
    return mean / steps, worst, fastest


@compiled
def march_moving(
    steps: int,
    push: bool,
    dead_ends: tuple[float, float],
    factor_ends: tuple[float, float],
    rate_ends: tuple[float, float],
    damping: float,
    dead: Floats,
    live: Floats,
    inverse: Floats,
    radius: Floats,
    moved: Floats,
    velocity: Floats,
    ends: Ints,
    frame: Floats,
    first: Ints,
    place: Floats,
    law: Floats,
    brittle: Bools,
    gaps: Bools,
    overlap: Floats,
    pressure: Floats,
    shear: Floats,
    broken: Bools,
    geometry: Geometry,
) -> tuple[float, float, float]:
    """`march` in the plane with faces that follow the geometry, and corners that meet other elements."""
    force = np.empty(velocity.shape)
    mean, worst, fastest = 0.0, 0.0, 0.0
    pairs = near_pairs(moved, geometry)
    for turn in range(steps):
        share = (turn + 1.0) / steps
        begin(moved, velocity, force, dead, dead_ends[0] + (dead_ends[1] - dead_ends[0]) * share)
        moving_forces(
            moved, force, ends, frame, first, place, law, brittle, gaps, overlap, pressure, shear, broken, geometry
        )
        corner_forces(pairs, moved, force, geometry)
        factor = factor_ends[0] + (factor_ends[1] - factor_ends[0]) * share
        rate = rate_ends[0] + (rate_ends[1] - rate_ends[0]) * share
        found, size, speed = driven(force, velocity, live, inverse, radius, (push, factor, rate, damping))
        mean, worst, fastest = mean + found, max(worst, size), max(fastest, speed)
    return mean / steps, worst, fastest


@compiled
def begin(moved: Floats, velocity: Floats, force: Floats, dead: Floats, share: float) -> None:
    """Move the elements by one step, and begin its forces with a share of the dead loads."""
    for i in range(len(moved)):
        for j in range(moved.shape[1]):
            moved[i, j] += velocity[i, j]
            force[i, j] = share * dead[i, j]
