"""All λ without dilation of a tiny planar assembly, docs/method.md (4.6), by its mechanisms one after another.

A mechanism is a sum of extreme rays of the cone z = H (u, t) ≥ 0, and where forces go with it, y_k z_k = 0, they go
with each of these rays. So the λ of all solutions are those of two linear programs for each ray on which the live load
works. Nothing of equilibrium.py, scaling.py, yield sets or of zero_dilation is used: a fault there cannot hide here.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from scipy.optimize import linprog

from cases import ROUTE
from jld_core import Assembly
from jld_core.arrays import Bits, Floats

_ZERO = 1e-9
_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def loads_without_dilation(assembly: Assembly, labels: Bits) -> list[tuple[float, float]]:
    """Intervals of λ, scene units, whose union is λ of all solutions; labels: (m,) True dry."""
    faces, elements, s = assembly.interfaces, assembly.elements, assembly.strengths(ROUTE)
    count, free, reach = len(faces), elements.free, assembly.size
    force = assembly.total_dead
    live_unit = assembly.total_live
    balance = np.zeros((3 * len(free), 3 * count))
    rows, constants, widths = np.zeros((4 * count, 3 * count)), np.zeros(4 * count), np.zeros(count)
    for k in range(count):
        along = np.array([-faces.normal[k][1], faces.normal[k][0]])
        middle = faces.polygon[k].mean(axis=0)
        for element, sign in ((int(faces.a[k]), -1.0), (int(faces.b[k]), 1.0)):
            for row in np.flatnonzero(free == element):
                arm = (middle - elements.centroid[element]) / reach
                for column, way in ((3 * k, faces.normal[k]), (3 * k + 1, along)):
                    balance[3 * row : 3 * row + 2, column] = sign * way
                    balance[3 * row + 2, column] = sign * (arm[0] * way[1] - arm[1] * way[0])
                balance[3 * row + 2, 3 * k + 2] = sign
        length = float(np.hypot(*(faces.polygon[k][1] - faces.polygon[k][0])))
        area = length * float(faces.l2[k]) / force
        widths[k] = length / reach / (2.0 if labels[k] else 6.0)
        tension, slope, stuck = (
            (0.0, s.friction[k], s.cohesion[k] * area)
            if labels[k]
            else (s.tension[k] * area, s.inner_friction[k], s.shear[k] * area)
        )
        for j, sign in enumerate((1.0, -1.0)):
            rows[4 * k + j, 3 * k], rows[4 * k + j, 3 * k + 2], constants[4 * k + j] = 1.0, -sign / widths[k], tension
            rows[4 * k + 2 + j, 3 * k], rows[4 * k + 2 + j, 3 * k + 1] = slope, -sign
            constants[4 * k + 2 + j] = stuck
    live = (assembly.live[free] / live_unit / [1.0, 1.0, reach]).ravel()
    dead = (assembly.dead[free] / force / [1.0, 1.0, reach]).ravel()
    modes = np.zeros((4 * count, balance.shape[0] + count))
    jumps = balance.T
    for k in range(count):
        modes[4 * k, : len(dead)] = 0.5 * (jumps[3 * k] - jumps[3 * k + 2] * widths[k])
        modes[4 * k + 1, : len(dead)] = 0.5 * (jumps[3 * k] + jumps[3 * k + 2] * widths[k])
        modes[4 * k + 3, : len(dead)] = jumps[3 * k + 1]
        modes[4 * k + 2 : 4 * k + 4, len(dead) + k] = 1.0
    rays = extreme_rays(modes)
    moving = {tuple(np.flatnonzero(modes @ ray > _ZERO)) for ray in rays if ray[: len(dead)] @ live > _ZERO}
    found = []
    for some in sorted(moving):
        pick = list(some)
        ends = []
        for sign in (1.0, -1.0):
            answer = linprog(
                np.append(np.zeros(3 * count), sign),
                A_ub=np.column_stack([-rows, np.zeros(4 * count)]),
                b_ub=constants,
                A_eq=np.block([[balance, live[:, None]], [rows[pick], np.zeros((len(pick), 1))]]),
                b_eq=np.concatenate([-dead, -constants[pick]]),
                bounds=(None, None),
                options=_EXACT,
            )
            ends.append(-sign * np.inf if answer.status == 3 else np.nan if answer.status else float(answer.x[-1]))
        if not np.isnan(ends).any():
            found.append((ends[0] * force / live_unit, ends[1] * force / live_unit))
    return sorted(found)


def extreme_rays(rows: Floats) -> Floats:
    """(k, d) extreme rays of the pointed cone rows x ≥ 0, by the double description method (Motzkin et al. 1953)."""
    rows = rows / np.linalg.norm(rows, axis=1)[:, None]
    width = rows.shape[1]
    first = la.qr(rows.T, pivoting=True)[2][:width]
    rays = np.linalg.inv(rows[first]).T
    done, left = list(first), [k for k in range(len(rows)) if k not in set(first)]
    while left:
        k = left.pop(0)
        value = rays @ rows[k]
        zero = (abs(rays @ rows[done].T) < _ZERO).astype(int)
        above, below = np.flatnonzero(value > _ZERO), np.flatnonzero(value < -_ZERO)
        fresh = []
        for i in above:
            common = zero[below] & zero[i]
            size = common.sum(axis=1)
            # two rays are neighbours where no third lies on all that both lie on
            for j in np.flatnonzero((size >= width - 2) & (((common @ zero.T) == size[:, None]).sum(axis=1) == 2)):
                fresh.append(value[i] * rays[below[j]] - value[below[j]] * rays[i])
        rays = np.vstack([rays[value >= -_ZERO], *fresh])
        rays = rays / np.linalg.norm(rays, axis=1)[:, None]
        done.append(k)
    return rays
