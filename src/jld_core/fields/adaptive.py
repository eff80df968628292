"""Where the two fields disagree, and the next mesh: docs/method.md (9.12)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.forms import tensors
from jld_core.fields.lower import StressField, tractions
from jld_core.fields.mesh import Mesh, bisect, refine
from jld_core.fields.problem import Problem
from jld_core.fields.upper import VelocityField, halved, jumps

# Share of the indicator that marked triangles hold together (Dörfler marking). With 0.5 the flagship needs 3500
# triangles for a bracket of 3.4 %, with 0.25 it has 3.1 % on 2400.
_SHARE = 0.25

# Share as `_SHARE` while a bound is missing, and in space: larger, since any field will do and each mesh takes time
_SHARE_WITHOUT = 0.5

_MOST_MARKED = {2: 0.4, 3: 0.3}  # largest share of simplices that one refinement marks

# Weight of the volume in the indicator, the disagreement having 1, so that no simplex stays coarse for ever
_EVERYWHERE = {2: 0.1, 3: 0.02}

_STRESSED = 0.5  # Weight of the multipliers of stresses in the indicator. By disagreement alone the lower bound stalls.

_SINGULAR = 0.7  # share of the multipliers of a triangle at one corner above which that corner is taken as singular

_FAN = np.radians(20.0)  # angle below which a triangle at a singular corner is not split further about it

_LEAST_AREA = 1e-9  # smallest area of a triangle over that of all: smaller ones are not split again

# Ratio of the numbers of tetrahedra of the next and the last mesh. Tetrahedra are marked and halved until it is
# reached.
_GROWTH = 1.5


def finer_in_plane(
    mesh: Mesh, problem: Problem, stress: StressField | None, velocity: VelocityField | None, steps: bool
) -> Mesh:
    """Refine triangles by disagreement, multipliers of yield and area; all but the smallest without a stress field."""
    small = problem.mesh.volume < _LEAST_AREA * problem.mesh.volume.sum()
    if stress is None:
        return refine(mesh, ~small)
    parts = [(_EVERYWHERE[2], problem.mesh.volume), (_STRESSED, np.maximum(stress.rate, 0.0).sum(axis=1))]
    if velocity is not None:
        parts.append((1.0, np.maximum(disagreement(problem, stress, velocity), 0.0)))
    error = np.zeros(len(mesh))
    for weight, part in parts:
        error += weight * part / max(float(part.sum()), 1e-300)
    error[small] = 0.0
    share = _SHARE if steps and velocity is not None else _SHARE_WITHOUT
    # Stresses jump at ends of loads and at corners of blocks; only a fan of triangles about such a node can follow. A
    # corner counts if it holds most of `stress.rate` of its triangle and its angle is wide.
    corners = problem.mesh.corners
    one, two = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    angle = np.arctan2(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0], (one * two).sum(axis=2))
    rate, every = np.maximum(stress.rate, 0.0), np.arange(len(mesh))
    top = rate.argmax(axis=1)
    singular = (rate[every, top] > _SINGULAR * rate.sum(axis=1)) & (angle[every, top] > _FAN)
    return refine(mesh, _leading(error, share, _MOST_MARKED[2]), np.where(singular, top, -1))


def finer_by_dissipation(mesh: Mesh, power: Floats) -> Mesh:
    """Refine a planar mesh where velocity fields dissipate most; power: (t,) with half of the edges."""
    area = mesh.volume
    error = power / max(float(power.sum()), 1e-300) + _EVERYWHERE[2] * area / float(area.sum())
    error = np.where(area < _LEAST_AREA * area.sum(), 0.0, error)
    return refine(mesh, _leading(error, _SHARE, _MOST_MARKED[2]))


def finer_in_space(
    mesh: Mesh,
    problem: Problem,
    fine: Problem,
    labels: Bits,
    stress: StressField,
    velocity: VelocityField | None,
    most: int,
) -> Mesh:
    """Bisect the tetrahedra with most dissipation less stress power, and most multipliers, up to `most`."""
    own, volume = problem.mesh, problem.mesh.volume
    rate = np.maximum(stress.rate, 0.0).reshape(-1, 4, 4)
    middle = np.diagonal(rate, axis1=1, axis2=2)
    # multipliers of yield, summed to the corners of the unsplit tetrahedra
    corner = rate.sum(axis=1) - middle + 0.25 * middle.sum(axis=1, keepdims=True)
    error = corner.sum(axis=1)
    if velocity is not None:
        parts = np.repeat(velocity.velocity[:, None], 4, axis=1)
        parts[:, np.arange(4), np.arange(4)] = velocity.velocity.mean(axis=1)[:, None]
        moved = parts.reshape(-1, 4, 3)
        power = stress_power(fine, stress, moved)
        error = error + np.maximum(velocity.dissipation - power.reshape(-1, 4).sum(axis=1), 0.0)
        corner = corner + _joint_corners(fine, stress, moved, np.flatnonzero(fine.is_dry(labels)))
    error = error + _EVERYWHERE[3] * error.sum() * volume / volume.sum()
    finer = replace(own, root=np.arange(len(own)))
    fits = True
    while fits and len(finer) < _GROWTH * len(own):
        # half of a tetrahedron keeps a quarter of its share: strips along hinges lose in proportion to their width
        left = error[finer.root] * (finer.volume / volume[finer.root]) ** 2
        away = finer.corners[:, :, None] - own.corners[finer.root][:, None]
        share = 1.0 + np.einsum("tcki,tki->tck", away, own.gradient[finer.root])
        weight = np.maximum(np.einsum("tck,tk->tc", share, corner[finer.root]), 0.0)
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
        marks = _leading(left, _SHARE_WITHOUT, _MOST_MARKED[3])
        larger = bisect(finer, marks, weight)
        fits = len(larger) <= most
        while len(larger) > most and marks.any():
            marks &= left > np.median(left[marks])
            larger = bisect(finer, marks, weight)
        finer = larger
    units = problem.units
    return replace(finer, points=finer.points * units.length + units.origin, root=mesh.root[finer.root])


def _leading(error: Floats, wanted: float, most: float) -> Bools:
    """Mark the simplices (t,) of largest error that hold a share of its sum, at most a share of all."""
    order = np.argsort(-error, kind="stable")
    share = np.cumsum(error[order])
    enough = int(np.searchsorted(share, wanted * share[-1])) + 1
    marks = np.zeros(len(error), dtype=bool)
    marks[order[: min(enough, max(1, int(most * len(error))))]] = True
    return marks


def disagreement(problem: Problem, stress: StressField, velocity: VelocityField) -> Floats:
    """Compute each simplex's share (t,) of upper less lower bound, scaled λ; both fields are of one labelling."""
    return np.asarray(velocity.dissipation - stress_power(problem, stress, velocity.velocity))


def stress_power(problem: Problem, stress: StressField, velocity: Floats) -> Floats:
    """Return the power (t,) of a stress field on velocities (t, d + 1, d), with half of the sides, scaled."""
    p, d, rows = problem, problem.mesh.dimension, problem.jumps
    slope = np.einsum("tki,tkj->tij", velocity, p.mesh.gradient)
    power = p.mesh.volume * np.einsum("tij,tij->t", tensors(stress.stress.mean(axis=1)), slope)
    pull, jump = tractions(p, stress.stress, rows), jumps(p, velocity, rows)
    ends = np.einsum("fki,fki->f", pull, jump) + np.einsum("fi,fi->f", pull.sum(axis=1), jump.sum(axis=1))
    return halved(p, power, rows, p.sides.area[rows] * ends / (d * (d + 1)))


def _joint_corners(fine: Problem, stress: StressField, velocity: Floats, rows: Ints) -> Floats:
    """Compute the power (t, 4) that tractions on dry triangles lose at corners of the unsplit tetrahedra."""
    s = fine.sides
    shares = np.zeros((len(fine.mesh) // 4, 4))
    pull, jump = tractions(fine, stress.stress, rows), jumps(fine, velocity, rows)
    lost = np.maximum(-np.einsum("fi,fki->fk", pull.sum(axis=1), jump), 0.0) * (s.area[rows] / 24.0)[:, None]
    both = s.b[rows] >= 0
    np.add.at(shares, (s.a[rows][:, None] // 4, s.corner_a[rows]), lost)
    np.add.at(shares, (s.b[rows][both][:, None] // 4, s.corner_b[rows][both]), lost[both])
    return shares
