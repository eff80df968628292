"""One-sided derivatives of λ where forces or mechanism are not unique.

Source: docs/method.md (11.4).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bools, Floats
from jld_core.limit import LimitAnalysis, LimitAnalysisResult
from jld_core.models.sensitivity import SolvedProgram
from jld_core.program import Template
from jld_geometry.planar_rates import face_rates, length_rates, load_rates, residual_rates
from jld_geometry.vertex_mesh import VertexMesh

_NULL: Final = 1e-8  # singular value, relative to the largest, below which a direction belongs to a null space

# Change of a rate over the optimal forces or mechanisms, relative to the largest rate, that makes a kink possible
_VARIES: Final = 1e-5

# Number of columns of a program up to which kinks are looked for; null spaces are found by dense algebra
_COLUMNS: Final = 900

_ALIKE: Final = 1e-6  # difference of both rates, relative to the largest rate, below which they count as equal


def one_sided(result: LimitAnalysisResult, mesh: VertexMesh, rates: Floats) -> tuple[Floats, Floats]:
    """Compute the rates (2v,) of λ for a decrease and for an increase of each coordinate.

    rates: (2v,) from the forces and the mechanism of the result, per length, scene units; entry 2·vertex + axis. Both
    results equal `rates` where forces and mechanism leave the rate unique. They also do for large programs and programs
    with cones, in which kinks are not looked for.
    """
    analysis = LimitAnalysis(result.assembly)
    structure = analysis.template.structure
    if structure.cones or structure.shape[1] > _COLUMNS:
        return rates, rates
    solved = SolvedProgram(analysis, result.labels)
    data = _ProgramRates(analysis.template, solved, mesh)
    left, right = rates.copy(), rates.copy()
    largest = float(abs(rates).max(initial=0.0))
    for column in np.flatnonzero(_may_jump(result, mesh, data, largest)).tolist():
        matrix, rhs = data.of(column)
        low, high = data.scale * solved.side(-matrix, -rhs), -data.scale * solved.side(matrix, rhs)
        if abs(high - low) <= _ALIKE * largest:
            low = high = rates[column] if abs(low - rates[column]) <= _ALIKE * largest else 0.5 * (low + high)
        left[column], right[column] = low, high
    return left, right


class _ProgramRates:
    """Derivatives of the data of one linear program by the coordinates of vertices."""

    def __init__(self, template: Template, solved: SolvedProgram, mesh: VertexMesh) -> None:
        self.template, self.solved, self.mesh = template, solved, mesh
        self.scale = template.scaling.load
        assembly = template.assembly
        unit = np.eye(3)
        self._faces = [face_rates(assembly, mesh, np.tile(unit[j], (len(mesh.ends), 1))) for j in range(3)]
        self._dead = load_rates(assembly, mesh, 0.0).tocsc()
        self._live = (load_rates(assembly, mesh, 1.0) - self._dead).tocsc()
        self._row = template.scaling.row.ravel()
        lengths = length_rates(mesh).tocsc()
        self.of_face = template.yield_set.pattern.row_face
        self._rhs = solved.program.rhs
        self._stretch = sp.diags_array(1.0 / assembly.interfaces.l1) @ lengths

    def of(self, column: int) -> tuple[sp.csr_array, Floats]:
        """Return the derivatives of matrix and right-hand side by one vertex coordinate.

        column: the coordinate, 2·vertex + axis. The results have the shapes of the program's data.
        """
        structure = self.solved.program.structure
        rows, columns, values = [], [], []
        active = self.template.yield_set.active(self.solved.labels)
        for j, entries in enumerate(self._faces):
            own = np.flatnonzero((entries.column == column) & active[entries.face, j])
            rows.append(entries.row[own])
            columns.append(3 * entries.face[own] + j)
            factor = self.template.scaling.face[entries.face[own], j] / self._row[entries.row[own]]
            values.append(factor * entries.value[own])
        live = self._live[:, [column]].toarray().ravel() * self.template.scaling.load / self._row
        touched = np.flatnonzero(live)
        rows.append(touched)
        columns.append(np.full(len(touched), structure.shape[1] - 1))
        values.append(live[touched])
        located = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        matrix = sp.csr_array(located, shape=structure.shape)
        stretch = np.asarray(self._stretch[:, [column]].todense()).ravel()
        rhs = np.zeros(structure.shape[0])
        rhs[: structure.equalities] = -self._dead[:, [column]].toarray().ravel() / self._row
        first = structure.equalities + 1  # after the row that bounds λ
        rhs[first:] = self._rhs[first:] * stretch[self.of_face]
        return matrix, rhs


def _may_jump(result: LimitAnalysisResult, mesh: VertexMesh, data: _ProgramRates, largest: float) -> Bools:
    """Mark the coordinates (2v,) whose rate of λ varies over optimal forces or multipliers.

    data: derivatives of the linear program. largest: greatest absolute rate, per length.
    """
    template, solved = data.template, data.solved
    structure = solved.program.structure
    held = solved.held.copy()
    held[: structure.equalities] = True
    tight = solved.program.matrix.tocsr()[np.flatnonzero(held)].toarray()
    left, values, right = np.linalg.svd(tight)
    rank = int(np.sum(values > _NULL * values.max(initial=1.0)))
    assembly, columns = template.assembly, 3 * len(mesh.ends)
    factor = data.scale
    jumps = np.zeros(mesh.places.size, dtype=bool)
    velocity = factor * solved.dual[: structure.equalities] / template.scaling.row.ravel()
    for direction in right[rank:]:
        forces = direction[:columns].reshape(-1, 3) * template.scaling.face
        change = velocity @ (residual_rates(assembly, mesh, forces, 0.0) - load_rates(assembly, mesh, 0.0))
        jumps |= abs(change) > _VARIES * largest * _size(direction, solved.point)
    point = solved.point
    forces = point[:columns].reshape(-1, 3) * template.scaling.face
    rates = residual_rates(assembly, mesh, forces, float(point[-1]) * template.scaling.load)
    lengths = sp.diags_array(1.0 / assembly.interfaces.l1) @ length_rates(mesh)
    for direction in left.T[rank:]:
        dual = np.zeros(len(held))
        dual[held] = direction
        change = -factor * dual[: structure.equalities] / template.scaling.row.ravel() @ rates
        worth = dual[structure.equalities + 1 :] * solved.program.rhs[structure.equalities + 1 :]
        change = change + factor * np.bincount(data.of_face, weights=worth, minlength=len(mesh.ends)) @ lengths
        jumps |= abs(change) > _VARIES * largest * _size(direction, solved.dual)
    return jumps


def _size(direction: Floats, values: Floats) -> float:
    """Return the Euclidean norm of a direction over the largest absolute entry of `values`."""
    return float(np.linalg.norm(direction)) / max(float(abs(values).max(initial=0.0)), tolerances.ROUNDING)
