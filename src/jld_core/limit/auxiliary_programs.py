"""Programs that repairs of a proof are made with, stated from a template's own (`Repair`)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bools, Floats, Ints
from jld_core.program import ConicProgram, Structure, pack
from jld_core.solvers import ClarabelSolver, RawStatus, auxiliary, is_large


def tips_of(structure: Structure) -> Ints:
    """Rows that carry a slack: every linear yield row (the first linear row bounds λ), then the head of each cone."""
    linear = np.arange(structure.equalities + 1, structure.equalities + structure.linear)
    return np.concatenate([linear, structure.heads]).astype(np.int64)


def with_slack(program: ConicProgram, load_fixed: bool = False) -> ConicProgram:
    """The program that maximises the least slack t ≤ 1 of all yield rows, over λ too unless it is fixed at 0."""
    s = program.structure
    matrix = program.matrix.tocsr()
    column = np.zeros(s.shape[0])
    column[tips_of(s)] = 1.0
    kept = matrix[:, :-1] if load_fixed else matrix
    edge = s.equalities + s.linear
    last = sp.csr_array(([1.0], ([0], [kept.shape[1]])), shape=(1, kept.shape[1] + 1))
    wide = sp.hstack([kept, sp.csr_array(column[:, None])]).tocsr()
    rows = sp.vstack([wide[:edge], last, wide[edge:]])
    rhs = np.concatenate([program.rhs[:edge], [1.0], program.rhs[edge:]])
    objective = np.zeros(wide.shape[1])
    objective[-1] = -1.0
    return pack(rows, rhs, objective, s.equalities, s.linear + 1, s.cones, s.places)


def of_columns(program: ConicProgram, kept: Bools) -> ConicProgram:
    """The program whose other columns are zero: inequalities and cones that ask nothing of those kept are left out.

    kept: (columns,). The first inequality, which bounds λ, stays.
    """
    s = program.structure
    matrix = program.matrix.tocsr()[:, np.flatnonzero(kept)]
    asks = np.diff(matrix.indptr) > 0
    asks[: s.equalities + 1] = True
    start = s.equalities + s.linear
    ends = start + np.cumsum(s.cones, dtype=np.int64)
    cones = tuple(size for size, end in zip(s.cones, ends, strict=True) if asks[end - size : end].any())
    for size, end in zip(s.cones, ends, strict=True):
        asks[end - size : end] = asks[end - size : end].any()
    rows = np.flatnonzero(asks)
    linear = int(asks[s.equalities : start].sum())
    return pack(matrix[rows], program.rhs[rows], program.objective[kept], s.equalities, linear, cones, s.places)


def least_multipliers(
    equations: sp.csr_array,
    yields: sp.csr_array,
    floor: Floats,
    linear: int,
    cones: tuple[int, ...],
    structure: Structure,
) -> Floats:
    """Velocities and multipliers (u, z) of least floor·z with Eᵀu + Gᵀz = 0 and z − floor in the cones.

    equations, yields: E and G, `linear` half-lines before the cones. structure: of the program they are from. NaN
    where there is none. Large ones are solved from the dual side, min floor·G y, E y = 0, G y + s = floor: a
    program in forces, whose columns fall apart into faces.
    """
    equalities, columns = equations.shape
    if is_large(structure):
        rows = sp.vstack([equations, yields])
        rhs = np.concatenate([np.zeros(equalities), floor])
        forces = pack(rows, rhs, yields.T @ floor, equalities, linear, cones, structure.places)
        raw = auxiliary(forces, 1e-2)
        dual = np.concatenate([raw.dual[:equalities], raw.dual[equalities:] + floor])
        return np.full(len(dual), np.nan) if raw.status is RawStatus.UNBOUNDED else dual
    identity = sp.csr_array(sp.hstack([sp.csr_array((len(floor), equalities)), sp.eye_array(len(floor))]))
    balance = sp.csr_array(sp.hstack([sp.csr_array(equations.T), sp.csr_array(yields.T)]))
    rows = sp.vstack([balance, -identity])
    rhs = np.concatenate([np.zeros(columns), -floor])
    objective = np.concatenate([np.zeros(equalities), floor])
    return ClarabelSolver().solve(pack(rows, rhs, objective, columns, linear, cones)).point
