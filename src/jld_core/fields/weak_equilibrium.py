"""Dual of the upper bound (11.9): stresses in weak equilibrium, and derivatives by nodes.

Yield does not depend on the geometry and equilibrium is polynomial in the positions of nodes, which makes this the form
for steps over positions. It proves nothing: `UpperBound` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Floats, Ints
from jld_core.fields.cones import ConeProgram, ConeSizes, Rows
from jld_core.fields.problem import Problem
from jld_core.fields.upper import UpperBound


@dataclass(frozen=True)
class ConeRows:
    """Rows A x + s = b of a cone program."""

    matrix: sp.csr_array  # A
    right: Floats  # (rows,) b
    sizes: ConeSizes


class WeakEquilibrium:
    """Stresses in weak equilibrium of one labelling on one mesh.

    The columns are (m, d, s) of each of n panels, their radii r ≥ √(d² + s²), tractions (N, S) at the ends of dry
    edges, and λ last. Panels are the t triangles, then the first ends of all edges in the material, then their second
    ends. m, d, s are those of `StressField`; at edges they refer to the normal and the tangent.

    Parameters
    ----------
    problem : Problem
        Scaled problem on one mesh.
    labels : (m,) array of bool
        True = dry.
    """

    def __init__(self, problem: Problem, labels: Bits) -> None:
        self.problem, self._labels = problem, labels
        sides, dry = problem.sides, problem.is_dry(labels)
        jumps = (sides.b >= 0) | (problem.face >= 0)
        self._material: Ints = np.flatnonzero(jumps & ~dry)
        self._dry: Ints = np.flatnonzero(dry)
        self._panels = len(problem.mesh) + 2 * len(self._material)
        self.width = 4 * self._panels + 4 * len(self._dry) + 1

    @cached_property
    def _loads(self) -> tuple[Floats, Floats]:
        """Nodal forces (t, 3, 2) of live and dead loads, scaled."""
        upper = UpperBound(self.problem)
        return upper.live, upper.dead

    def _traction_columns(self) -> list[tuple[Ints, int, Ints, Ints]]:
        """Return edges, ends and columns of N and S for each kind of edge end; two of N, to be added, at panels."""
        count, kinds = len(self.problem.mesh), []
        for end in (0, 1):
            panel = 3 * (count + end * len(self._material) + np.arange(len(self._material)))
            kinds.append((self._material, end, panel, panel + 2))
            joint = 4 * self._panels + 2 * (end * len(self._dry) + np.arange(len(self._dry)))
            kinds.append((self._dry, end, joint, joint + 1))
        return kinds

    def rows(self) -> ConeRows:
        # weak equilibrium of all triangles, 6 equations each, then linear yield rows and cones
        count = len(self.problem.mesh)
        (balance, right), linear = self._balance(), self._yield()
        cones, panels = Rows(), np.arange(self._panels)
        radius_then_deviator = np.stack([3 * self._panels + panels, 3 * panels + 1, 3 * panels + 2], axis=1)
        cones.add([(radius_then_deviator.reshape(-1), -1.0)], 0.0, 3 * self._panels)
        matrix = sp.csr_array(sp.vstack([balance, linear.matrix(self.width), cones.matrix(self.width)]))
        sizes = ConeSizes(6 * count, linear.count, self._panels)
        return ConeRows(matrix, np.concatenate([right, linear.right, cones.right]), sizes)

    def _balance(self) -> tuple[sp.csr_array, Floats]:
        """Return the equations (6t, width) of nodal forces, row 6·triangle + 2·corner + axis, and their right side."""
        problem, mesh = self.problem, self.problem.mesh
        count, load_column = len(mesh), self.width - 1
        live, dead = self._loads
        loads = Rows()
        loads.add([(np.full(6 * count, load_column), -live.ravel())], dead.ravel(), 6 * count)
        entries = _Entries()
        row, stress_column = 6 * np.arange(count), 3 * np.arange(count)
        for k in range(3):
            gradient = mesh.volume[:, None] * mesh.gradient[:, k]
            gx, gy = gradient.T
            for axis, coefficients in enumerate(((gx, gx, gy), (gy, -gy, gx))):
                for j, value in enumerate(coefficients):
                    entries.add(row + 2 * k + axis, stress_column + j, value)
        sides = problem.sides
        for edges, end, first, shear in self._traction_columns():
            half = 0.5 * sides.area[edges]
            nx, ny = sides.normal[edges].T
            normals = [first, first + 1] if edges is self._material else [first]
            for axis, (n, t) in enumerate(((nx, -ny), (ny, nx))):
                for rows, sign, index in self._corners(edges, end, axis):
                    for column in normals:
                        entries.add(rows, column[index], sign * (half * n)[index])
                    entries.add(rows, shear[index], sign * (half * t)[index])
        return sp.csr_array(loads.matrix(self.width) + entries.matrix((6 * count, self.width))), loads.right

    def _corners(self, edges: Ints, end: int, axis: int) -> list[tuple[Ints, float, Ints]]:
        """Return rows, signs and positions in `edges` (k,) for the triangles on both sides of edges at one end."""
        sides = self.problem.sides
        two_sided = np.flatnonzero(sides.b[edges] >= 0)
        first = 6 * sides.a[edges] + 2 * sides.corner_a[edges, end] + axis
        second = 6 * sides.b[edges[two_sided]] + 2 * sides.corner_b[edges[two_sided], end] + axis
        return [(first, -1.0, np.arange(len(edges))), (second, 1.0, two_sided)]

    def _yield(self) -> Rows:
        """Return the linear rows of material and dry joints."""
        problem, linear, panels = self.problem, Rows(), np.arange(self._panels)
        for a, b in problem.material.lines:
            linear.add([(3 * self._panels + panels, 1.0), (3 * panels, -b)], a, self._panels)
        face = problem.face[self._dry]
        mu, c, crush = problem.joints.friction[face], problem.joints.shear[face], problem.joints.crushing[face]
        size = np.maximum(1.0, mu)
        crushable = np.flatnonzero(np.isfinite(crush))
        for edges, _, normal, shear in self._traction_columns():
            if edges is not self._dry:
                continue
            linear.add([(normal, 1.0)], 0.0, len(edges))
            for sign in (1.0, -1.0):
                linear.add([(normal, mu / size), (shear, sign / size)], c / size, len(edges))
            linear.add([(normal[crushable], -1.0)], crush[crushable], len(crushable))
        return linear

    def solve(self) -> tuple[Floats, float] | None:
        """Return the stresses (width,) of largest λ, and λ, scaled, inf where unlimited; None without an answer."""
        rows = self.rows()
        objective = np.zeros(self.width)
        objective[-1] = -1.0
        answer = ConeProgram(objective, rows.matrix, rows.right, rows.sizes).solve()
        if answer.status == "DualInfeasible":
            return answer.point, math.inf
        return (answer.point, float(answer.point[-1])) if answer.usable else None

    def stands(self) -> bool:
        """Return False if the mesh proves that the dead load alone cannot be carried, else True."""
        problem = self.problem
        if not problem.loaded:
            return True
        stresses_and_multiple = WeakEquilibrium(problem.under_dead_load(), self._labels).solve()
        # a program without a largest multiple of the dead load has no answer, and stands
        return stresses_and_multiple is None or stresses_and_multiple[1] >= 1.0

    def rates(self, point: Floats) -> sp.csr_array:
        """Return the derivatives (6t, 2p) of A x − b by the positions of p nodes, at a point (width,)."""
        # Stresses and λ, loads per volume and nodal forces of tractions are held constant; column 2·node + axis.
        problem, mesh = self.problem, self.problem.mesh
        count, entries = len(mesh), _Entries()
        m, d, s = point[: 3 * count].reshape(-1, 3).T
        row, nodes = 6 * np.arange(count), mesh.simplices
        load = problem.dead + float(point[-1]) * problem.live
        for axis, (sx, sy) in enumerate(((m + d, s), (s, m - d))):
            for k in range(3):
                rows = row + 2 * k + axis
                # area times the gradient at corner k is half the opposite edge, turned
                entries.add_vector(rows, nodes[:, (k + 2) % 3], 0.5 * np.column_stack([sy, -sx]))
                entries.add_vector(rows, nodes[:, (k + 1) % 3], -0.5 * np.column_stack([sy, -sx]))
                for j in range(3):
                    of_load = mesh.volume[:, None] * mesh.gradient[:, j] * (-load[:, axis] / 3.0)[:, None]
                    entries.add_vector(rows, nodes[:, j], of_load)
        sides = problem.sides
        ends = nodes[sides.a[:, None], sides.corner_a]
        for edges, end, first, shear in self._traction_columns():
            normal = point[first] + (point[first + 1] if edges is self._material else 0.0)
            slide = point[shear]
            for axis, vector in enumerate(((slide, normal), (-normal, slide))):
                # half a length times the traction is half of the edge times (S, N), (−N, S)
                half = 0.5 * np.column_stack(vector)
                for rows, sign, index in self._corners(edges, end, axis):
                    entries.add_vector(rows, ends[edges[index], 1], sign * half[index])
                    entries.add_vector(rows, ends[edges[index], 0], -sign * half[index])
        return entries.matrix((6 * count, 2 * len(mesh.points)))


class _Entries:
    """Entries of a sparse matrix, collected; duplicates are summed."""

    def __init__(self) -> None:
        self._rows: list[Ints] = []
        self._columns: list[Ints] = []
        self._values: list[Floats] = []

    def add(self, rows: Ints, columns: Ints, values: Floats) -> None:
        self._rows.append(rows)
        self._columns.append(columns)
        self._values.append(values)

    def add_vector(self, rows: Ints, nodes: Ints, vectors: Floats) -> None:
        """Add vectors (k, 2) as derivatives by the positions of nodes (k,)."""
        for axis in (0, 1):
            self.add(rows, 2 * nodes + axis, vectors[:, axis])

    def matrix(self, shape: tuple[int, int]) -> sp.csr_array:
        entries = (np.concatenate(self._values), (np.concatenate(self._rows), np.concatenate(self._columns)))
        return sp.csr_array(entries, shape=shape)
