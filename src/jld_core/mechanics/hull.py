"""Rows of undecided faces, which enclose the sets of both labels, docs/method.md (6.3).

Without a bound on N, the closed convex hull of the dry and the inner set is the dry set moved to N = −σtA and widened
in shear: {|m| ≤ N + σtA, |V| ≤ w + μ (N + σtA)}. Here μ is the larger one of both labels and w = max(c − μ σtA, τA −
μ_inner σtA). With compressive strengths, or where inner faces have more friction, the rows enclose the hull.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.mechanics.bending import Frictional
from jld_core.mechanics.yield_set import ParabolicBending, RowPattern

_STEPS: Final = 257  # number of points on a parabola at which `_interaction_planes` evaluates tangent planes


def hull_rows(sets: Frictional, *, freedoms: int, shear: int, parabolas: bool) -> RowPattern:
    """Return yield rows that enclose the dry and the inner set, for faces of unknown label.

    shear: place of V (planar, 1) or of mT (spatial, 5) among them. parabolas: True if its cones are those of crushing.
    """
    # A relaxation with these rows bounds λ over both labels, docs/method.md (6.3). The rows are the pattern of `sets`
    # with `dry` and `h_dry` replaced.
    pattern = sets.pattern
    data, rhs = pattern.dry.copy(), pattern.h_dry.copy()
    inside = pattern.column < freedoms * len(sets.friction)
    linear = pattern.row < pattern.linear
    normal = inside & (pattern.column % freedoms == 0)
    across = inside & linear & (pattern.column % freedoms == shear) & (data != 0.0)
    # Where only the inner set resists shear, V takes part in equilibrium and its rows must bound it.
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


def parabolic_hull(sets: Frictional, crushed: Ints) -> ParabolicBending | None:
    """Return sets that enclose the yield sets of both labels, for planar faces that crush.

    crushed: (k,) indices of these faces. The result is None where an inner face carries more N than the dry one.
    """
    # Bending: in N and |m|, the result is the hull of two sets. Write T = σtA of the inner face, and C for its σcA. The
    # dry set is |m| ≤ N − N²/N_c. The inner set is a triangle with its foot at (−T, 0) and its top at ((C − T)/2, (C +
    # T)/6). The boundary of the hull has three pieces: the parabola from n₀ on, the tangent at n₀ through the top, and
    # the line from the foot to the top. If the tangent through the foot passes above the top, it replaces the last two.
    # The tangent from a point (x, y) touches at n₀ = x + √(x² − N_c (x − y)). Shear: in N and |V|, the bound is the
    # line through (−T, τA − μ_inner T) above all corners. Bending and shear interact, see `ParabolicBending`.
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
    # Without tensile strength the foot is at N = 0, where the dry face may have cohesion.
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
    strengths = np.column_stack([limit, dry, sets.cohesion[crushed], tension, inner_limit, sets.shear[crushed], inner])
    interaction = _interaction_planes(strengths)
    interaction[~holds] = 0.0
    return ParabolicBending(
        crushed, np.column_stack([1.0 / limit, knee]), rows, np.column_stack([interaction, strengths])
    )


def _interaction_planes(strengths: Floats) -> Floats:
    """Compute the planes that bound V and M together, for planar faces that crush.

    strengths: (k, 7), as the last columns of `ParabolicBending.interaction`.
    """
    # The result (k, 5) has one row per face: N and m of a corner of the inner set; how far the shear of this corner is
    # above that of the dry set; and the first and last value N₁ of an interval. For every N₁ in it, one plane touches
    # the corner, and the parabola of the dry set at N₁. It encloses the sets of both labels. A row is zero where there
    # is no such plane. Shear beyond c + μN requires a share w of inner corners, mostly of (−T, 0). The hull therefore
    # bulges between a corner (n, m) and the parabola. Planes a N − b|V| − |m| + h ≥ 0 tangent to it at N₁ have a = 1 +
    # μb − 2N₁/N_c. The one with b = −(m − n (1 − 2N₁/N_c) − N₁²/N_c) / (shear above) touches the corner too. It is a
    # plane of the hull where the other corners do not pass it. The corner is (−T, 0) where that has such planes, else
    # the one with the longest interval of N₁. Where planes of all directions meet, at the top, a single plane bounds
    # little.
    limit, friction, cohesion, tension, inner_limit, shear, inner_friction = strengths.T
    top = 0.5 * (inner_limit - tension)
    normal = np.stack([-tension, top, inner_limit])[:, :, None]
    moment = np.stack([0.0 * top, (inner_limit + tension) / 6.0, 0.0 * top])[:, :, None]
    more = (shear - cohesion)[:, None] + (inner_friction - friction)[:, None] * normal
    share = np.linspace(0.0, 1.0, _STEPS)
    touch, slope = share * limit[:, None], 1.0 - 2.0 * share
    above = moment - slope * normal - share * touch  # height of the corners above the tangent
    found, most = np.zeros((len(limit), 5)), np.zeros(len(limit), dtype=np.int64)
    for corner in range(3):
        has = more[corner] > 0.0
        b = -above[corner] / np.where(has, more[corner], 1.0)
        passed = np.max(above + b * more, axis=0) > tolerances.ROUNDING * limit[:, None]
        good = has & (b >= 0.0) & ~passed
        # Find the last range of consecutive N₁ whose planes are valid.
        last = _STEPS - 1 - np.argmax(good[:, ::-1], axis=1)
        broken = ~good & (np.arange(_STEPS) < last[:, None])
        first = np.where(broken.any(axis=1), _STEPS - np.argmax(broken[:, ::-1], axis=1), 0)
        length = np.where(good.any(axis=1), last - first, 0)
        better = length > most
        most = np.where(corner == 0, np.where(better, _STEPS, 0), np.maximum(most, length))
        own = [array[corner, :, 0] for array in (normal, moment, more)]
        found[better] = np.column_stack([*own, share[first] * limit, share[last] * limit])[better]
    return found


def _widen_crushing(sets: Frictional, data: Floats, rhs: Floats) -> None:
    """Widen the parabolas of crushing in a row pattern until they enclose both labels."""
    # The parabola |m| ≤ N (1 − N/C) stands about N = −σtA. Without a compressive strength of the inner face it is
    # dropped. With N' = N + σtA and C = max(N_c dry, N_c inner) + σtA: N'(1 − N'/C) − N (1 − N/N_c) ≥ σtA (1 − N/C')² ≥
    # 0, so the dry set is inside. N'(C − N')/C ≥ min(N', C − N')/2 is more than the third that an inner face may take.
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
