"""Velocity field that opens every joint and edge, to repair flow rules after rounding."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.cones import ConeProgram, Rows
from jld_core.fields.forms import across
from jld_core.fields.problem import Problem
from jld_core.fields.velocity_program import jump_entries, strain_entries

_LEAST = 1e-9  # least room in all flow rules, at velocities of one, of a motion that counts as found


def opening_motion(problem: Problem) -> Floats | None:
    """Find scaled velocities (t, 3, 2) that open every edge and dilate every triangle; None as for enclosed cells."""
    # A small multiple of them added to a velocity field repairs flow rules that rounding violates. Cells move apart and
    # stretch, each affinely, so that interfaces open despite friction of joint and material. Inside a cell, triangles
    # move by the gradient of a convex function that is linear on triangles. Such a gradient jumps along the normals of
    # edges: they open without sliding.
    mesh = problem.mesh
    cells, number = np.unique(mesh.cell, return_inverse=True)
    area = np.bincount(number, mesh.volume)
    middle = mesh.corners.mean(axis=1)
    centre = np.column_stack([np.bincount(number, mesh.volume * middle[:, axis]) / area for axis in (0, 1)])
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
    """Find gradients (t, 2) of a function linear on triangles and convex in each cell, by a linear program; or None."""
    # One exists for every mesh of fans, trees of triangles and their bisections, which are regular subdivisions.
    from scipy.optimize import linprog  # takes longer to import than most commands need

    mesh, e = problem.mesh, problem.sides
    key = number[:, None] * len(mesh.points) + mesh.simplices
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
    size = np.minimum(np.sqrt(mesh.volume[e.a[inside]]), np.sqrt(mesh.volume[e.b[inside]]))
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
    """Find motions of the cells (count, 6), coefficients ≤ 1, of the largest slack in all flow rules; or None."""
    p, e, rows = problem, problem.sides, problem.on_faces
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


# Rate, relative to the largest velocity, below which it counts as zero: far above the residual of the solver
_ACTIVE = 1e-7

# Largest number of linearisations of flow rules with friction. Where many slide, two leave errors of 4e-9 of the
# velocities, four 1e-14.
_ROUNDS = 4


class Settling:
    """Correction of velocities of one problem, so that active flow rules hold exactly, between solver and check."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        p, self._cut = problem, problem.jumps
        normal, count = p.sides.normal[self._cut], len(p.mesh)
        columns, strain, _ = strain_entries(p)
        rates = Rows()
        self._groups = [[rates.add([(columns, strain[:, j])], 0.0, count) for j in range(strain.shape[1])]]
        for end in (0, 1):
            columns, jump = jump_entries(p, self._cut, end)
            values = (np.einsum("ki,kij->kj", way, jump) for way in (normal, *across(normal)))
            self._groups.append([rates.add([(columns, value)], 0.0, len(self._cut)) for value in values])
        self._rates = rates.matrix(6 * count)

    def settled(self, velocity: Floats, dry: Bools) -> Floats:
        """Move velocities (t, 3, 2) by about the solver's residual so that active flow rules hold.

        Nothing is proven.
        """
        # A flow rule is active if it is violated, or met with a margin below a small share of the largest velocity.
        moved = velocity.ravel()
        for _ in range(_ROUNDS if self.problem.material.sine or self.problem.joints.friction.any() else 1):
            matrix = self._active(moved, dry)
            if matrix is None:
                break
            square = sp.csc_matrix(matrix @ matrix.T + 1e-10 * sp.eye_array(matrix.shape[0]))
            solver = splu(square, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            before = moved
            for _ in range(4):
                moved = moved - matrix.T @ solver.solve(matrix @ moved)
            if float(abs(moved - before).max()) <= tolerances.ROUNDING * float(abs(moved).max()):
                break
        return np.asarray(moved.reshape(velocity.shape))

    def _active(self, velocity: Floats, dry: Bools) -> sp.csr_array | None:
        """Return equations over velocities (6t,) that keep active flow rules at equality; None if none is active."""
        p, small = self.problem, _ACTIVE * float(abs(velocity).max())
        rates = self._rates @ velocity
        rigid = bool(np.isinf(p.material.crushing))
        joint, face = dry[self._cut], p.face[self._cut]
        # of a joint the flow rule is δn ≥ μ|δs|, of the material δn ≥ sin φ √(δn² + δs²), so δn ≥ tan φ |δs|
        slope = np.full(len(face), p.material.friction)
        slope[joint] = p.joints.friction[face[joint]]
        wanted = np.full(len(face), rigid)
        wanted[joint] = np.isinf(p.joints.crushing[face[joint]])
        count = len(p.mesh)
        rules = [(np.full(count, p.material.sine), np.full(count, rigid)), (slope, wanted), (slope, wanted)]
        chosen = Rows()
        for (head, *tail), (steep, asked) in zip(self._groups, rules, strict=True):
            _choose(chosen, rates, head, tail, steep, asked, small)
        return sp.csr_array(chosen.matrix(len(rates)) @ self._rates) if chosen.count else None


def _choose(
    chosen: Rows, rates: Floats, head: Ints, tail: list[Ints], slope: Floats, wanted: Bools, small: float
) -> None:
    """Append equations for the active flow rules among head ≥ slope · |tail|; small: rate that counts as zero."""
    value, parts = rates[head], [rates[part] for part in tail]
    size = np.sqrt(sum((part**2 for part in parts), np.zeros(len(value))))
    active = wanted & (value - slope * size <= small)
    still = active & (size <= small)
    free = slope == 0.0
    # opening 0 where nothing resists slip or nothing slips, slip 0 where nothing slips, else the tangent of the cone
    for rows in (head[(active & free) | still], *(part[still] for part in tail)):
        chosen.add([(rows, 1.0)], 0.0, len(rows))
    sliding = np.flatnonzero(active & ~still & ~free)
    if sliding.size:
        shares = [-(slope * rate)[sliding] / size[sliding] for rate in parts]
        tangent = [(part[sliding], share) for part, share in zip(tail, shares, strict=True)]
        chosen.add([(head[sliding], 1.0), *tangent], 0.0, len(sliding))
