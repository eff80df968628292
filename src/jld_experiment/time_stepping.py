"""Advance an assembly in time by central differences with a time step of one, for which masses are scaled."""

from __future__ import annotations

import numpy as np

from jld_core import Floats
from jld_experiment.moving_spatial import (
    Plane,
    Space,
    corner_forces,
    corner_forces_in_space,
    moving_forces,
    moving_forces_in_space,
    near_pairs,
    near_pairs_in_space,
    turn_along,
)
from jld_experiment.subcontacts import (
    CORNERS,
    DAMPING,
    DEAD,
    HALF,
    LIVE,
    Bench,
    Drive,
    Motion,
    compiled,
    numbers_of,
    record_loss,
    sub_contact,
)


@compiled
def planar_forces(bench: Bench, motion: Motion, force: Floats) -> None:
    """Advance every planar sub-contact by one step and add its forces to `force` (n, 3)."""
    step, ends, frame = motion.velocity, bench.ends, bench.frame
    first, place, law, brittle, gaps = bench.first, bench.place, bench.law, bench.brittle, bench.gaps
    overlap, pressure, shear, broken, dry = motion.overlap, motion.pressure, motion.shear, motion.broken, bench.dry
    for f in range(len(ends)):
        a, b = ends[f, 0], ends[f, 1]
        nx, ny = frame[f, 0], frame[f, 1]
        dx, dy = step[b, 0] - step[a, 0], step[b, 1] - step[a, 1]
        turn = step[b, 2] - step[a, 2]
        opening = dx * nx + dy * ny + step[b, 2] * frame[f, 4] - step[a, 2] * frame[f, 2]
        slip = dy * nx - dx * ny + step[b, 2] * frame[f, 5] - step[a, 2] * frame[f, 3]
        ks, numbers = law[f, 1], numbers_of(law, f)
        normal, tangent, moment = 0.0, 0.0, 0.0
        for k in range(first[f], first[f + 1]):
            s, area = place[k, 0], place[k, 1]
            e = overlap[k] - opening + s * turn
            q = shear[k, 0] - ks * slip
            trial, was_broken = (numbers[0] * e, abs(q)), broken[k]
            e, p, size, broken[k] = sub_contact(e, abs(q), numbers, brittle[f], gaps[f], was_broken)
            if size < trial[1] or p != trial[0]:
                start = (pressure[k], shear[k, 0] if q > 0.0 else -shear[k, 0])
                record_loss(motion.work, numbers, area, (dry[f], was_broken, broken[k]), start, trial, (p, size))
            q = size if q > 0.0 else -size
            overlap[k], pressure[k], shear[k, 0] = e, p, q
            part = p * area
            normal += part
            moment -= s * part
            tangent += q * area
        fx, fy = normal * nx - tangent * ny, normal * ny + tangent * nx
        force[b, 0] += fx
        force[b, 1] += fy
        force[b, 2] += normal * frame[f, 4] + tangent * frame[f, 5] + moment
        force[a, 0] -= fx
        force[a, 1] -= fy
        force[a, 2] -= normal * frame[f, 2] + tangent * frame[f, 3] + moment


@compiled
def spatial_forces(bench: Bench, motion: Motion, force: Floats) -> None:
    """Advance every spatial sub-contact by one step and add its forces to `force` (n, 6)."""
    # All is as in `planar_forces`, with `force` (n, 6).
    step, ends, frame = motion.velocity, bench.ends, bench.frame
    first, place, law, brittle, gaps = bench.first, bench.place, bench.law, bench.brittle, bench.gaps
    overlap, pressure, shear, broken, dry = motion.overlap, motion.pressure, motion.shear, motion.broken, bench.dry
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
        ks, numbers = law[f, 1], numbers_of(law, f)
        normal, along1, along2, moment1, moment2, torsion = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(first[f], first[f + 1]):
            x1, x2, area = place[k, 0], place[k, 1], place[k, 2]
            e = overlap[k] - opening - turn1 * x2 + turn2 * x1
            q1 = shear[k, 0] - ks * (slip1 - twist * x2)
            q2 = shear[k, 1] - ks * (slip2 + twist * x1)
            sheared, was_broken = np.sqrt(q1 * q1 + q2 * q2), broken[k]
            trial = (numbers[0] * e, sheared)
            e, p, size, broken[k] = sub_contact(e, sheared, numbers, brittle[f], gaps[f], was_broken)
            if size < sheared or p != trial[0]:
                start = (pressure[k], (shear[k, 0] * q1 + shear[k, 1] * q2) / max(sheared, 1e-300))
                record_loss(motion.work, numbers, area, (dry[f], was_broken, broken[k]), start, trial, (p, size))
            if size < sheared:
                q1 *= size / sheared
                q2 *= size / sheared
            overlap[k], pressure[k] = e, p
            shear[k, 0], shear[k, 1] = q1, q2
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
def drag_on(part: int, i: int, bench: Bench, motion: Motion, force: Floats, drive: Drive, drag: Floats) -> None:
    """Set the damping forces `drag` (n, q) on the translation (part 0) or rotation (part 1) of element i."""
    velocity, before = motion.velocity, motion.before
    q = velocity.shape[1]
    d = 2 if q == 3 else 3
    low, high = (0, d) if part == 0 else (d, q)
    scheme, damping = drive[4], drive[5]
    size, speed, change = 0.0, 0.0, 0.0
    for j in range(low, high):
        size += force[i, j] * force[i, j]
        speed += velocity[i, j] * velocity[i, j]
        change += (force[i, j] - before[i, j]) ** 2
    size, speed, change = np.sqrt(size), np.sqrt(speed), np.sqrt(change)
    for j in range(low, high):
        if scheme == 1:
            drag[i, j] = damping * velocity[i, j] / bench.inverse[i, part]
            continue
        drag[i, j] = damping * size * velocity[i, j] / speed if speed > 0.0 else 0.0
        if scheme == 2:
            along = (force[i, j] - before[i, j]) / change if change > 0.0 else 0.0
            drag[i, j] = 0.5 * (drag[i, j] - damping * size * along)
            before[i, j] = force[i, j]


@compiled
def driven(
    bench: Bench, motion: Motion, force: Floats, drive: Drive, share: float, drag: Floats
) -> tuple[float, float, float]:
    """Update velocities by one step; return λ, largest unbalanced force and displacement per step.

    force: (n, q) without live loads, changed. drag: (n, q), set to the damping forces.
    """
    # λ is prescribed, or the multiplier that gives live·u its prescribed rate. Moments and rotations are compared with
    # forces and displacements by `bench.radius`.
    velocity, live, inverse, radius = motion.velocity, bench.live, bench.inverse, bench.radius
    count, q = velocity.shape
    d = 2 if q == 3 else 3
    push, dead, factors, rates = drive[0], drive[1], drive[2], drive[3]
    dead_share = dead[0] + (dead[1] - dead[0]) * share
    factor = factors[0] + (factors[1] - factors[0]) * share
    rate = rates[0] + (rates[1] - rates[0]) * share
    live_mass, live_force, live_speed = 0.0, 0.0, 0.0
    if push:
        for i in range(count):
            for j in range(q):
                velocity_per_load = live[i, j] * inverse[i, 0 if j < d else 1]
                live_mass += live[i, j] * velocity_per_load
                live_force += velocity_per_load * force[i, j]
                live_speed += live[i, j] * velocity[i, j]
        factor = (rate - live_speed - live_force) / live_mass
    damped, worst, fastest = 0.0, 0.0, 0.0
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
            drag_on(part, i, bench, motion, force, drive, drag)
            for j in range(low, high):
                force[i, j] -= drag[i, j]
                damped += live[i, j] * drag[i, j] * inverse[i, part]
    # damping changes the rate of live·u: a change of λ by `correction` restores the prescribed one
    correction = damped / live_mass if push else 0.0
    dead_work, live_work, damping_work, half_work = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        for j in range(q):
            change = (force[i, j] + correction * live[i, j]) * inverse[i, 0 if j < d else 1]
            mean = velocity[i, j] + 0.5 * change
            velocity[i, j] += change
            contact = force[i, j] + drag[i, j] - factor * live[i, j] - dead_share * bench.dead[i, j]
            half_work += 0.5 * contact * velocity[i, j]
            dead_work += bench.dead[i, j] * mean
            live_work += live[i, j] * mean
            damping_work += drag[i, j] * mean
    motion.work[DEAD] += dead_share * dead_work
    motion.work[HALF] = half_work
    motion.work[LIVE] += factor * live_work
    motion.work[DAMPING] += damping_work - correction * live_work
    return factor, worst, fastest


@compiled
def begin(bench: Bench, motion: Motion, force: Floats, drive: Drive, share: float) -> None:
    """Move the elements by one step and set `force` (n, q) to the dead loads of that step."""
    dead_share = drive[1][0] + (drive[1][1] - drive[1][0]) * share
    for i in range(len(force)):
        for j in range(force.shape[1]):
            motion.moved[i, j] += motion.velocity[i, j]
            force[i, j] = dead_share * bench.dead[i, j]


@compiled
def march(steps: int, drive: Drive, bench: Bench, motion: Motion) -> tuple[float, float, float]:
    """Advance by steps with fixed geometry: mean λ, largest unbalanced force and displacement per step."""
    force, drag = np.empty_like(motion.velocity), np.zeros_like(motion.velocity)
    mean, worst, fastest = 0.0, 0.0, 0.0
    for step in range(steps):
        share = (step + 1.0) / steps
        begin(bench, motion, force, drive, share)
        if motion.shear.shape[1] == 1:
            planar_forces(bench, motion, force)
        else:
            spatial_forces(bench, motion, force)
        factor, size, speed = driven(bench, motion, force, drive, share, drag)
        mean, worst, fastest = mean + factor, max(worst, size), max(fastest, speed)
    return mean / steps, worst, fastest


@compiled
def power_of_rest(force: Floats, part: Floats, velocity: Floats) -> float:
    """Return the power at a velocity of the forces added after `part`, all (n, q)."""
    power = 0.0
    for i in range(force.shape[0]):
        for j in range(force.shape[1]):
            power += (force[i, j] - part[i, j]) * velocity[i, j]
    return power


@compiled
def march_in_plane(steps: int, drive: Drive, bench: Bench, motion: Motion, plane: Plane) -> tuple[float, float, float]:
    """Advance as `march` planar faces that follow the geometry, with contacts of corners."""
    shape = motion.velocity.shape
    force, drag, faces = np.empty(shape), np.zeros(shape), np.empty(shape)
    mean, worst, fastest = 0.0, 0.0, 0.0
    pairs = near_pairs(motion.moved, plane)
    for step in range(steps):
        share = (step + 1.0) / steps
        begin(bench, motion, force, drive, share)
        moving_forces(bench, motion, force, plane)
        for i in range(len(force)):
            for j in range(3):
                faces[i, j] = force[i, j]
        corner_forces(pairs, motion.moved, force, plane)
        # Work up to the present position: driven() will change the force.
        motion.work[CORNERS] -= power_of_rest(force, faces, motion.velocity)
        factor, size, speed = driven(bench, motion, force, drive, share, drag)
        mean, worst, fastest = mean + factor, max(worst, size), max(fastest, speed)
    return mean / steps, worst, fastest


@compiled
def march_in_space(steps: int, drive: Drive, bench: Bench, motion: Motion, space: Space) -> tuple[float, float, float]:
    """Advance as `march` spatial faces that follow the geometry, with contacts of corners."""
    shape = motion.velocity.shape
    force, drag, faces = np.empty(shape), np.zeros(shape), np.empty(shape)
    mean, worst, fastest = 0.0, 0.0, 0.0
    pairs = near_pairs_in_space(motion.moved, space)
    for step in range(steps):
        share = (step + 1.0) / steps
        begin(bench, motion, force, drive, share)
        turn_along(motion.velocity, space)
        moving_forces_in_space(bench, motion, force, space)
        for i in range(len(force)):
            for j in range(6):
                faces[i, j] = force[i, j]
        corner_forces_in_space(pairs, motion.moved, force, space)
        motion.work[CORNERS] -= power_of_rest(force, faces, motion.velocity)
        factor, size, speed = driven(bench, motion, force, drive, share, drag)
        mean, worst, fastest = mean + factor, max(worst, size), max(fastest, speed)
    return mean / steps, worst, fastest
