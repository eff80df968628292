"""Velocities moved by rounding, so that active flow rules hold to the last digits."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.conic import Rows
from jld_core.fields.problem import Problem
from jld_core.fields.velocity_program import Entries, jump_entries, strain_entries

# Rate, relative to the largest velocity, below which it counts as zero: far above the residual of the solver
_ACTIVE = 1e-7

# Largest number of linearisations of flow rules with friction. Where many slide, two leave errors of 4e-9 of the
# velocities, four 1e-14.
_ROUNDS = 4


class Settling:
    """Correction of velocities of one problem, so that active flow rules hold exactly.

    Use it between a solver and a check: a solver meets flow rules up to its residual only. The matrices of all rates
    are set up once.

    problem: the scaled problem.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        p, e = problem, problem.edges
        self._cut = np.flatnonzero((e.b >= 0) | (p.face >= 0))
        along = np.column_stack([-e.normal[:, 1], e.normal[:, 0]])[self._cut]
        normal = e.normal[self._cut]
        groups: list[tuple[Entries, ...]] = [strain_entries(p, np.arange(len(p.mesh)), np.sqrt(p.mesh.area))]
        groups += [tuple(jump_entries(p, self._cut, end, way) for way in (normal, along)) for end in (0, 1)]
        rates, self._groups = Rows(), []
        for group, count in zip(groups, (len(p.mesh), len(self._cut), len(self._cut)), strict=True):
            self._groups.append([rates.add(part, 0.0, count) for part in group])
        self._rates = rates.matrix(6 * len(p.mesh))

    def settled(self, velocity: Floats, dry: Bools) -> Floats:
        """Move velocities to the nearest ones for which active flow rules hold with equality.

        A flow rule is active if it is violated, or met with a margin below a small share of the largest velocity.

        velocity: (t, 3, 2) velocities at the corners of triangles that hold flow rules up to the residual of a solver,
        scaled. dry: (e,) edges on dry interfaces. Result: (t, 3, 2) differs from what was given by about that residual.
        Nothing is proven of it: check it by `UpperBound.certify`.
        """
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
        """Return equations over velocities (6t,) that keep active flow rules at equality.

        velocity: (6t,), at which rules count as active. dry: (e,) edges on dry interfaces. None if no rule is active.
        """
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
    """Append equations for the active flow rules among head ≥ slope · |tail|.

    chosen: takes them, over the rates. rates: all opening and slip rates. head: (k,) indices of openings. tail: arrays
    (k,) of indices of slips. slope: (k,) of each rule. wanted: (k,) whether it applies. small: rate that counts as
    zero. Where head and tail vanish, both are set to zero; otherwise the tangent of the rule is. A vanishing slip is
    removed without friction as well: in strong blocks it would dissipate.
    """
    value, parts = rates[head], [rates[part] for part in tail]
    size = np.sqrt(sum((part**2 for part in parts), np.zeros(len(value))))
    active = wanted & (value - slope * size <= small)
    still = active & (size <= small)
    free = slope == 0.0
    for rows in (head[(active & free) | still], *(part[still] for part in tail)):
        chosen.add([(rows, 1.0)], 0.0, len(rows))
    sliding = np.flatnonzero(active & ~still & ~free)
    if sliding.size:
        shares = [-(slope * rate)[sliding] / size[sliding] for rate in parts]
        tangent = [(part[sliding], share) for part, share in zip(tail, shares, strict=True)]
        chosen.add([(head[sliding], 1.0), *tangent], 0.0, len(sliding))
