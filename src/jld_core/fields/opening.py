"""Velocity field that opens every joint and edge, to repair flow rules after rounding."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats, Ints
from jld_core.fields.conic import ConeProgram, Rows
from jld_core.fields.problem import Problem

_LEAST = 1e-9  # least room in all flow rules, at velocities of one, of a motion that counts as found


def opening_motion(problem: Problem) -> Floats | None:
    """Find velocities that open every edge and dilate every triangle: (t, 3, 2), scaled.

    A small multiple of them added to a velocity field repairs flow rules that rounding violates. Cells move apart and
    stretch, each affinely, so that interfaces open despite friction of joint and material. Inside a cell, triangles
    move by the gradient of a convex function that is linear on triangles. Such a gradient jumps along the normals of
    edges: they open without sliding. None: no such motion was found, as for enclosed cells.
    """
    mesh = problem.mesh
    cells, number = np.unique(mesh.cell, return_inverse=True)
    area = np.bincount(number, mesh.area)
    middle = mesh.corners.mean(axis=1)
    centre = np.column_stack([np.bincount(number, mesh.area * middle[:, axis]) / area for axis in (0, 1)])
    motion, apart = _cell_motion(problem, number, centre, len(cells)), _convex_gradients(problem, number)
    if motion is None or apart is None:
        return None
    values, room = motion
    away = mesh.corners - centre[number][:, None]
    slope = values[:, 2:6].reshape(-1, 2, 2)[number]
    velocity = values[number, :2][:, None] + np.einsum("tij,tkj->tki", slope, away)
    steep = 1.0 + max(float(problem.joints.friction.max(initial=0.0)), problem.material.friction)
    share = 0.25 * room / (steep * float(np.hypot(*apart.T).max(initial=1e-300)))
    return np.asarray(velocity + share * apart[:, None])


def _convex_gradients(problem: Problem, number: Ints) -> Floats | None:
    """Find gradients (t, 2) of a function that is linear on triangles, convex in each cell.

    number: (t,) cell of each triangle, counted from 0 without gaps. It exists for every mesh of fans, trees of
    triangles and their bisections, which are regular subdivisions. A linear program finds it; None where there is none.
    """
    from scipy.optimize import linprog  # takes longer to import than most commands need

    mesh, e = problem.mesh, problem.edges
    key = number[:, None] * len(mesh.points) + mesh.triangles
    unique, node = np.unique(key, return_inverse=True)
    node = node.reshape(-1, 3)
    inside = problem.inside
    rows, count = np.arange(len(inside)), len(unique)
    entries = []
    for triangle, sign in ((e.b[inside], 1.0), (e.a[inside], -1.0)):
        jump = sign * np.einsum("eki,ei->ek", mesh.gradient[triangle], e.normal[inside])
        entries += [(rows, node[triangle, k], jump[:, k]) for k in range(3)]
    row, column, value = (np.concatenate([entry[k] for entry in entries]) for k in range(3))
    matrix = sp.csr_array((value, (row, column)), shape=(len(inside), count))
    # jumps in proportion to the size of triangles, as those of |x|² are
    size = np.minimum(np.sqrt(mesh.area[e.a[inside]]), np.sqrt(mesh.area[e.b[inside]]))
    wanted = sp.hstack([-matrix, sp.csr_array(size[:, None])])
    objective = np.zeros(count + 1)
    objective[-1] = -1.0
    bounds = [(-1.0, 1.0)] * count + [(0.0, 1.0)]
    found = linprog(  # type: ignore[call-overload]  # the stubs know no sparse matrices
        objective, A_ub=wanted, b_ub=np.zeros(len(inside)), bounds=bounds, method="highs-ipm"
    )
    if found.x is None or not found.x[-1] > _LEAST:
        return None
    return np.asarray(np.einsum("tki,tk->ti", mesh.gradient, found.x[:-1][node]))


def _cell_motion(problem: Problem, number: Ints, centre: Floats, count: int) -> tuple[Floats, float] | None:
    """Find affine motions of the cells (count, 6) with the largest slack in all flow rules.

    number: (t,) cell of each triangle, counted from 0. centre: (count, 2) points that the first two coefficients move;
    the others are velocity gradients. No coefficient exceeds one. Also returns the slack. None where no motion has a
    positive one.
    """
    p, e, rows = problem, problem.edges, problem.on_faces
    width = 6 * count + 1
    linear, cones = Rows(), Rows()
    every = np.arange(6 * count)
    for sign in (1.0, -1.0):
        linear.add([(every, sign)], 1.0, len(every))
    linear.add([(np.array([width - 1]), 1.0)], 1.0, 1)
    slope = np.maximum(p.joints.friction, p.material.friction)[p.face[rows]]
    size = np.hypot(1.0, slope)
    last = np.full(len(rows), width - 1)
    for end in (0, 1):
        place = p.mesh.corners[e.a[rows], e.corner_a[rows, end]]
        for sign in (1.0, -1.0):
            normal = e.normal[rows]
            along = normal - sign * slope[:, None] * np.column_stack([-normal[:, 1], normal[:, 0]])
            entries = [(last, 1.0 * size)]
            for triangle, weight in ((e.a[rows], -1.0), (e.b[rows], 1.0)):
                cell = number[np.maximum(triangle, 0)]
                there = np.where(triangle >= 0, weight, 0.0)
                arm = place - centre[cell]
                for axis in (0, 1):
                    force = -there * along[:, axis]
                    base = np.where(triangle >= 0, 6 * cell, 6 * number[e.a[rows]])
                    entries.append((base + axis, force))
                    entries += [(base + 2 + 2 * axis + k, force * arm[:, k]) for k in (0, 1)]
            linear.add(entries, 0.0, len(rows))
    base = 6 * np.arange(count) + 2
    top = np.full(count, width - 1)
    one = np.ones(count)
    linear.add([(base, -one), (base + 3, -one), (top, one)], 0.0, count)
    if p.material.sine > 0.0:
        parts = [
            [(base, -one), (base + 3, -one), (top, one)],
            [(base, -p.material.sine * one), (base + 3, p.material.sine * one)],
            [(base + 1, -p.material.sine * one), (base + 2, -p.material.sine * one)],
        ]
        for k in range(count):
            for part in parts:
                cones.add([(column[k : k + 1], value[k : k + 1]) for column, value in part], 0.0, 1)
    blocks = [linear.matrix(width)] + ([cones.matrix(width)] if cones.count else [])
    rhs = np.concatenate([linear.right, *([cones.right] if cones.count else [])])
    objective = np.zeros(width)
    objective[-1] = -1.0
    whole = sp.csr_array(sp.vstack(blocks))
    answer = ConeProgram(objective, whole, rhs, (0, linear.count, cones.count // 3)).solve()
    room = float(answer.point[-1]) if answer.usable else 0.0
    return (answer.point[:-1].reshape(-1, 6), room) if room > _LEAST else None
