"""Rows of faces whose label is not decided: what either label admits, docs/method.md (6.3).

The closed hull of the dry and the inner set is, without a bound on N, the dry set moved to N = −σtA and widened in
shear: {|m| ≤ N + σtA, |V| ≤ w + μ (N + σtA)} with the larger μ of both labels and w = max(c − μ σtA, τA − μ_inner σtA).
With compressive strengths, or where inner faces have the more friction, the rows enclose the hull.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jld_core.arrays import Floats, Ints
from jld_core.mechanics.frictional import Frictional
from jld_core.mechanics.yield_set import Bow, RowPattern


def hull_rows(sets: Frictional, *, freedoms: int, shear: int, parabolas: bool) -> RowPattern:
    """The pattern with the numbers of undecided faces in the place of those of dry ones.

    shear: which resultant stands in the linear rows that limit shear. parabolas: are the cones those of crushing?
    """
    pattern = sets.pattern
    data, rhs = pattern.dry.copy(), pattern.h_dry.copy()
    inside = pattern.column < freedoms * len(sets.friction)
    linear = pattern.row < pattern.linear
    normal = inside & (pattern.column % freedoms == 0)
    across = inside & linear & (pattern.column % freedoms == shear) & (data != 0.0)
    # where only the inner set has shear resistance, V is back in equilibrium and its rows must bound it
    held = (sets.friction + sets.cohesion == 0.0) & (sets.shear + sets.inner_friction > 0.0)
    holds = held | (sets.friction + sets.cohesion > 0.0)
    rhs[pattern.row[across & holds[pattern.face]]] = 0.0
    if parabolas:
        _widen_crushing(sets, data, rhs)
    else:
        rhs[pattern.linear :][held[pattern.row_face[pattern.linear :]]] = 0.0
    size = np.zeros(len(rhs))
    size[pattern.row[across]] = abs(data[across])
    steeper = pattern.capacity[(sets.inner_friction > sets.friction)[pattern.face[pattern.capacity]]]
    data[steeper] = -size[pattern.row[steeper]] * sets.inner_friction[pattern.face[steeper]]
    most = np.maximum(sets.friction, sets.inner_friction)
    wide = np.maximum(sets.shear - sets.inner_friction * sets.tension, sets.cohesion - most * sets.tension)
    np.subtract.at(rhs, pattern.row[normal], data[normal] * sets.tension[pattern.face[normal]])
    np.add.at(rhs, pattern.row[across], abs(data[across]) * wide[pattern.face[across]])
    return replace(pattern, dry=data, h_dry=rhs)


def bow_of_hull(sets: Frictional, crushed: Ints) -> Bow | None:
    """What encloses either label of planar faces (k,) that crush; None where inner ones carry more N than dry ones.

    In N and m it is the hull of the parabola N − N²/N_c and of the triangle of the inner set with its foot (−T, 0),
    T = σtA, and its top ((C − T)/2, (C + T)/6): the parabola from the point n₀ on where the tangent through the top
    touches it, that tangent, and the line from the foot to the top; or the tangent through the foot where that passes
    above the top. From (x, y) it touches at n₀ = x + √(x² − N_c (x − y)). In N and V it is the line through
    (−T, τA − μ_inner T) that all corners are below.
    """
    tension, limit, inner_limit = sets.tension[crushed], sets.crush_dry[crushed], sets.crush_inner[crushed]
    if not np.all(inner_limit <= limit):
        return None
    foot_knee = np.sqrt(tension * (tension + limit)) - tension
    x, y = 0.5 * (inner_limit - tension), (inner_limit + tension) / 6.0
    at = np.maximum(x, foot_knee)
    above = y > at * at / limit + (1.0 - 2.0 * at / limit) * x
    knee = np.where(above, x + np.sqrt(np.maximum(x * x - limit * (x - y), 0.0)), foot_knee)
    inner, dry = sets.inner_friction[crushed], sets.friction[crushed]
    foot = sets.shear[crushed] - inner * tension
    # without tension a dry face may have cohesion where an inner one has its foot
    foot = np.where(tension > 0.0, foot, np.maximum(foot, sets.cohesion[crushed]))
    corners = [(inner_limit, sets.shear[crushed] + inner * inner_limit)]
    corners += [(normal, sets.cohesion[crushed] + dry * normal) for normal in (0.0 * limit, limit)]
    slopes = [(v - foot) / np.where(n + tension > 0.0, n + tension, 1.0) for n, v in corners]
    slope = np.maximum(np.max(slopes, axis=0), 0.0)
    one, none = np.ones(len(crushed)), np.zeros(len(crushed))
    lined = above.astype(float)
    line = [lined, 3.0 * lined, np.where(above, tension, 1.0)]
    height = foot + slope * tension
    size = np.maximum(np.maximum(one, slope), height)
    rows = np.array([[one, one, none], [slope / size, one / size, height / size], line]).transpose(2, 0, 1)
    holds = (sets.shear + sets.inner_friction + sets.friction + sets.cohesion)[crushed] > 0.0
    rows[~holds, 1] = (0.0, 1.0, 1.0)
    return Bow(crushed, np.column_stack([1.0 / limit, knee]), rows)


def _widen_crushing(sets: Frictional, data: Floats, rhs: Floats) -> None:
    """The parabola |m| ≤ N (1 − N/C) about N = −σtA with C as large as holds both sets; none where inner has no σc.

    With N' = N + σtA and C = max(N_c dry, N_c inner) + σtA: N'(1 − N'/C) − N (1 − N/N_c) ≥ σtA (1 − N/C')² ≥ 0, and
    N'(C − N')/C ≥ min(N', C − N')/2 is more than the third that an inner face may take.
    """
    pattern = sets.pattern
    old = np.where(np.isfinite(sets.crush_dry), sets.crush_dry, 1.0)
    new = np.maximum(sets.crush_dry, sets.crush_inner) + sets.tension
    ratio = np.where(
        np.isfinite(new), np.maximum(1.0, old) / np.maximum(1.0, np.where(np.isfinite(new), new, 1.0)), 0.0
    )
    cones = pattern.row >= pattern.linear
    data[cones] *= ratio[pattern.face[cones]]
    rows = np.arange(pattern.linear, len(rhs))
    face, offset = pattern.row_face[rows], (rows - pattern.linear) % 3
    size = np.maximum(1.0, np.where(np.isfinite(new), new, 1.0))[face]
    limit = np.where(np.isfinite(new), new, 1.0)[face] / size
    rhs[rows] = np.where(np.isfinite(new[face]), np.where(offset == 1, 0.0, limit), np.where(offset == 0, 1.0, 0.0))
