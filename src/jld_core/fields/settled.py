"""Velocities moved by rounding only, so that flow rules that hold with equality do so to the last digits."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.conic import Rows
from jld_core.fields.problem import Problem
from jld_core.fields.velocity_program import Entries, jump_entries, strain_entries

_ACTIVE = 1e-7
"""Rates over the largest velocity below which they count as zero: far above what the solver leaves."""

_ROUNDS = 4
"""Most linearisations of flow rules with friction: two leave 4e-9 of the velocities where many slide, four 1e-14."""


def settled(problem: Problem, velocity: Floats, dry: Bools) -> Floats:
    """Return the nearest velocities (t, 3, 2) for which active flow rules hold with equality.

    Parameters
    ----------
    problem : Problem
        The scaled problem.
    velocity : (t, 3, 2) array
        Velocities that hold flow rules up to the residual of a solver.
    dry : (e,) bool array
        Edges on dry interfaces.

    Returns
    -------
    (t, 3, 2) array
        Differs from what was given by about that residual; nothing is proven of it.
    """
    moved = velocity.ravel()
    for _ in range(_ROUNDS if problem.material.sine or problem.joints.friction.any() else 1):
        matrix = _active(problem, moved, dry)
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


def _active(problem: Problem, velocity: Floats, dry: Bools) -> sp.csr_array | None:
    """Rows of rates that should be zero: of those that stand still, and of those at the edge of a flow rule."""
    p, e = problem, problem.edges
    small = _ACTIVE * float(abs(velocity).max())
    rows = Rows()
    every = np.arange(len(p.mesh))
    rigid = bool(np.isinf(p.material.crushing))
    if rigid:
        trace, *shear = strain_entries(p, every, np.sqrt(p.mesh.area))
        _add(rows, velocity, trace, shear, np.full(len(every), p.material.sine), small, len(every))
    cut = np.flatnonzero(~dry & ((e.b >= 0) | (p.face >= 0)))
    joint = np.flatnonzero(dry)
    joint = joint[np.isinf(p.joints.crushing[p.face[joint]])]
    for end in (0, 1):
        for own, sine, wanted in (
            (cut, np.full(len(cut), p.material.sine), rigid),
            (joint, p.joints.friction[p.face[joint]], True),
        ):
            if wanted and len(own):
                normal = e.normal[own]
                opening = jump_entries(p, own, end, normal)
                slip = jump_entries(p, own, end, np.column_stack([-normal[:, 1], normal[:, 0]]))
                # of a joint the flow rule is δn ≥ μ|δs|, of the material δn ≥ sin φ √(δn² + δs²), so δn ≥ tan φ |δs|
                slope = sine if own is joint else np.full(len(cut), p.material.friction)
                _add(rows, velocity, opening, [slip], slope, small, len(own))
    return rows.matrix(velocity.size) if rows.count else None


def _add(
    rows: Rows, velocity: Floats, head: Entries, tail: list[Entries], slope: Floats, small: float, count: int
) -> None:
    """Append active rows of head ≥ slope · |tail|: head and tail where both vanish, else the tangent."""
    value = _value(velocity, head, count)
    parts = [_value(velocity, part, count) for part in tail]
    size = np.sqrt(sum((part**2 for part in parts), np.zeros(count)))
    active = value - slope * size <= small
    still = active & (size <= small)
    free = slope == 0.0
    plain = np.flatnonzero((active & free) | still)
    _take(rows, head, plain)
    for part in tail:
        _take(rows, part, np.flatnonzero(still))
    sliding = np.flatnonzero(active & ~still & ~free)
    if sliding.size:
        entries = [(column[sliding], number[sliding]) for column, number in head]
        for part, rate in zip(tail, parts, strict=True):
            share = -(slope * rate)[sliding] / size[sliding]
            entries += [(column[sliding], share * number[sliding]) for column, number in part]
        rows.add(entries, 0.0, len(sliding))


def _value(velocity: Floats, entries: Entries, count: int) -> Floats:
    return sum((velocity[column] * number for column, number in entries), np.zeros(count))


def _take(rows: Rows, entries: Entries, chosen: Ints) -> None:
    rows.add([(column[chosen], number[chosen]) for column, number in entries], 0.0, len(chosen))
