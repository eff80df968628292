"""Dry joints that crush: the parabola of planar faces, and the effective rectangle of spatial ones.

Their sets have no finite list of rows. In the plane |m| ≤ N − N²/N_c, docs/method.md (2.9); in space N³ ≤ N_c (N −
|m1|)(N − |m2|) for rectangles (2.12). With other labels in doubt, planes enclose both sets (6.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.mechanics.sheet import Row, Sheet, Term
from jld_core.mechanics.yield_set import ParabolicBending, used
from jld_core.strengths import Side

_STEPS: Final = 257  # number of points on a parabola at which `_interaction_planes` evaluates tangent planes


class Crushing(Protocol):
    """Curved sets of the dry faces that crush; a yield set adds them to its rows."""

    @property
    def faces(self) -> Ints:
        """Return the faces (k,)."""

    @property
    def limit(self) -> Floats:
        """Return N_c (k,), scaled."""

    def slack(self, forces: Floats) -> Floats:
        """Return the slack (k,) of scaled forces (k, q)."""

    def dissipation(self, core: Floats) -> Floats:
        """Return the work (..., k) of jumps (..., k, 3) of the core, whose opening has lost that of dilation."""

    def share(self, forces: Floats, least: float) -> Floats:
        """Return the ratio (k,) of demand to capacity; demands up to `least` are none."""

    def lay_out(self, sheet: Sheet) -> list[list[Row]]:
        """Add the linear rows that the cones need, and return the rows of each kind of cone."""


@dataclass(frozen=True)
class Parabolas:
    """Planar faces that crush; wide: (k,) N_c of the parabola of both labels, inf for none, moved by shift σtA."""

    faces: Ints
    limit: Floats
    wide: Floats
    shift: Floats

    def slack(self, forces: Floats) -> Floats:
        """Return the slack (k,) of scaled forces (k, 3)."""
        n = forces[:, 0]
        return np.asarray(n - n * n / self.limit - abs(forces[:, 2]))

    def dissipation(self, core: Floats) -> Floats:
        """Return the work (..., k) of jumps (..., k, 3), docs/method.md (3.6)."""
        turn = abs(core[..., 2])
        p, q = turn - core[..., 0], turn / self.limit
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            crushed = np.where(p < 2.0 * q * self.limit, p * p / (4.0 * q), self.limit * (p - q * self.limit))
        return np.where(p <= 0.0, 0.0, crushed)

    def share(self, forces: Floats, least: float) -> Floats:
        """Return the ratio (k,) of a demand to its capacity."""
        n = forces[:, 0]
        return np.maximum(used(abs(forces[:, 2]), n * (1.0 - n / self.limit), least), used(n, self.limit, least))

    def lay_out(self, sheet: Sheet) -> list[list[Row]]:
        """Return the cones N² ≤ N_c (N ∓ m), for N + σtA where they enclose both labels."""
        face, none, found = self.faces, 0.0 * self.limit, []
        bounded = np.isfinite(self.wide)
        wide, shift = np.where(bounded, self.wide, 1.0), np.where(bounded, self.shift, 0.0)
        size = np.maximum(1.0, self.limit)
        # With w = N − sign·m and c = N_c: N² ≤ c·w ⇔ ‖(2N, c − w)‖ ≤ c + w.
        values = [1.0 / size, none, np.where(bounded, 1.0 / np.maximum(1.0, wide), 0.0)]
        ends = [self.limit / size, none, np.where(bounded, wide / np.maximum(1.0, wide), 0.0)]
        free = [none, none + 1.0, np.where(bounded, 0.0, 1.0)]
        for sign in (1.0, -1.0):
            rows: list[Row] = []
            for normal, moment, end, idle in ((-1.0, sign, 1.0, 1.0), (-2.0, 0.0, 0.0, 0.0), (1.0, -sign, 1.0, 0.0)):
                terms = [
                    (sheet.column(face, place), [factor * value for value in values])
                    for place, factor in ((0, normal), (2, moment))
                ]
                sides = [end * h + idle * one for h, one in zip(ends, free, strict=True)]
                sides[2] = sides[2] - normal * values[2] * shift
                rows.append((terms, sides))
            found.append(rows)
        return found


@dataclass(frozen=True)
class Rectangles:
    """Spatial faces (k,) that crush, all rectangles, see `Crushing`."""

    faces: Ints
    limit: Floats

    def slack(self, forces: Floats) -> Floats:
        """Return the slack t (k,) of scaled forces (k, 6)."""
        # t is the largest value with (N + t)³ ≤ N_c (N − |m1| − t)(N − |m2| − t) and both factors ≥ 0, computed by
        # bisection. It is concave and never changes faster than its three arguments. The plain difference of both sides
        # would change faster near the apex of the set.
        n, p, q = forces[:, 0], forces[:, 0] - np.abs(forces[:, 3]), forces[:, 0] - np.abs(forces[:, 4])
        high = np.minimum(p, q)
        low = np.minimum(high, -n)
        for _ in range(80):
            t = 0.5 * (low + high)
            inside = np.maximum(n + t, 0.0) ** 3 <= self.limit * (p - t) * (q - t)
            low, high = np.where(inside, t, low), np.where(inside, high, t)
        return low

    def dissipation(self, core: Floats) -> Floats:
        """Return the work (..., k) of jumps (..., k, 3), docs/method.md (3.8)."""
        # With u = 1 − |m1|/N, v = 1 − |m2|/N and ν = N/N_c ≤ uv, the work is N_c ν (drive + a1 + a2 − a1 u − a2 v),
        # where a = |θ| and drive is the opening, less than 0. For given ν the best u, v cost 2√(a1 a2 ν) while both
        # stay ≤ 1, that is for ν ≤ least a / greatest a. Beyond they cost least a + greatest a · ν. The work is concave
        # in ν, and both slopes agree at the transition.
        turn = np.abs(core[..., 1:])
        less, more = turn.min(axis=-1), turn.max(axis=-1)
        gain = less + more - core[..., 0]
        near = (gain > 0.0) & (gain <= 3.0 * less)
        first, second = np.where(near, 3.0 * less, 1.0), np.where(near, 3.0 * more, 1.0)
        small = gain / 3.0 * (gain / first) * (gain / second)
        # Beyond the transition the best ν is where the slope vanishes, but at most one.
        rest = np.maximum(gain - less, 0.0)
        full = rest >= 2.0 * more
        share = np.where(full, 1.0, rest / np.where(full, 1.0, 2.0 * more))
        large = share * (rest - more * share)
        return np.asarray(self.limit * np.where(gain <= 0.0, 0.0, np.where(near, small, large)))

    def share(self, forces: Floats, least: float) -> Floats:
        """Return 1/q (k,), q the factor on moments that crushes: least root of N³ = N_c (N − q|m1|)(N − q|m2|)."""
        n, one, two = forces[:, 0], np.abs(forces[:, 3]), np.abs(forces[:, 4])
        with np.errstate(divide="ignore", invalid="ignore"):
            half, room = 0.5 * n * (one + two), n * n * (1.0 - n / self.limit)
            root = np.sqrt(np.maximum(half * half - one * two * room, 0.0))
            share = (half + root) / room
        bent = np.where(np.maximum(one, two) <= least, 0.0, np.where(room > 0.0, share, 1.0))
        return np.maximum(bent, used(n, self.limit, least))

    def lay_out(self, sheet: Sheet) -> list[list[Row]]:
        """Add the rows p ≤ N ∓ m1 and q ≤ N ∓ m2; return a² ≤ pq, b² ≤ N and N² ≤ √N_c a b, docs/method.md (2.12)."""
        # p and q bound the sides of the effective rectangle. The cones together mean N³ ≤ N_c p q.
        face, (p, q, a, b) = self.faces, [sheet.new_columns(len(self.faces)) for _ in range(4)]
        one, none = np.ones(len(face)), np.zeros(len(face))
        normal = sheet.column(face, 0)
        for variable, moment in ((p, 3), (q, 4)):
            for sign in (1.0, -1.0):
                terms: list[Term] = [(normal, [-one, none, none])]
                terms += [(sheet.column(face, moment), [sign * one, none, none]), (variable, [one] * 3)]
                sheet.add(face, terms, [none, one, one])
        # x² ≤ y z is written as ‖(2x, y − z)‖ ≤ y + z. Where dry faces do not crush, N has no entries, and p, q, b are
        # bounded by one.
        weight = self.limit**-0.25
        size = np.maximum(1.0, weight)
        minus, zero = [-one] * 3, [none] * 3
        first: list[Row] = [
            ([(p, minus), (q, minus)], zero),
            ([(a, [-2.0 * one] * 3)], zero),
            ([(p, minus), (q, [one] * 3)], zero),
        ]
        second: list[Row] = [
            ([(normal, [-one, none, none])], [one, 2.0 * one, 2.0 * one]),
            ([(b, [-2.0 * one] * 3)], zero),
            ([(normal, [-one, none, none])], [-one, none, none]),
        ]
        third: list[Row] = [
            ([(a, [-one / size] * 3), (b, [-one / size] * 3)], zero),
            ([(normal, [-2.0 * weight / size, none, none])], zero),
            ([(a, [-one / size] * 3), (b, [one / size] * 3)], zero),
        ]
        return [first, second, third]


def parabolic_hull(dry: Side, inner: Side, crushed: Ints) -> ParabolicBending | None:
    """Return sets that enclose both labels of planar faces that crush; None if an inner face carries more N."""
    # Bending: in N and |m|, the result is the hull of two sets. Write T = σtA of the inner face, and C for its σcA. The
    # dry set is |m| ≤ N − N²/N_c. The inner set is a triangle with its foot at (−T, 0) and its top at ((C − T)/2, (C +
    # T)/6). The boundary of the hull has three pieces: the parabola from n₀ on, the tangent at n₀ through the top, and
    # the line from the foot to the top. If the tangent through the foot passes above the top, it replaces the last two.
    # The tangent from a point (x, y) touches at n₀ = x + √(x² − N_c (x − y)). Shear: in N and |V|, the bound is the
    # line through (−T, τA − μ_inner T) above all corners. Bending and shear interact, see `ParabolicBending`.
    tension, limit, inner_limit = inner.tension[crushed], dry.crush[crushed], inner.crush[crushed]
    if not np.all(inner_limit <= limit):
        return None
    foot_knee = np.sqrt(tension * (tension + limit)) - tension
    x, y = 0.5 * (inner_limit - tension), (inner_limit + tension) / 6.0
    at = np.maximum(x, foot_knee)
    above = y > at * at / limit + (1.0 - 2.0 * at / limit) * x
    knee = np.where(above, x + np.sqrt(np.maximum(x * x - limit * (x - y), 0.0)), foot_knee)
    (rough, stuck), (mu, c) = ((one.friction[crushed], one.shear[crushed]) for one in (inner, dry))
    foot = stuck - rough * tension
    # Without tensile strength the foot is at N = 0, where the dry face may resist shear.
    foot = np.where(tension > 0.0, foot, np.maximum(foot, c))
    corners = [(inner_limit, stuck + rough * inner_limit)]
    corners += [(normal, c + mu * normal) for normal in (0.0 * limit, limit)]
    slopes = [(v - foot) / np.where(n + tension > 0.0, n + tension, 1.0) for n, v in corners]
    slope = np.maximum(np.max(slopes, axis=0), 0.0)
    one, none = np.ones(len(crushed)), np.zeros(len(crushed))
    lined = above.astype(float)
    line = [lined, 3.0 * lined, np.where(above, tension, 1.0)]
    height = foot + slope * tension
    size = np.maximum(np.maximum(one, slope), height)
    rows = np.array([[one, one, none], [slope / size, one / size, height / size], line]).transpose(2, 0, 1)
    holds = stuck + rough + mu + c > 0.0
    rows[~holds, 1] = (0.0, 1.0, 1.0)
    strengths = np.column_stack([limit, mu, c, tension, inner_limit, stuck, rough])
    interaction = _interaction_planes(strengths)
    interaction[~holds] = 0.0
    return ParabolicBending(
        crushed, np.column_stack([1.0 / limit, knee]), rows, np.column_stack([interaction, strengths])
    )


def _interaction_planes(strengths: Floats) -> Floats:
    """Compute the planes that bound V and M together, from `ParabolicBending.interaction` (k, 7)."""
    # The result (k, 5) has one row per face: N and m of a corner of the inner set; how far the shear of this corner is
    # above that of the dry set; and the first and last value N₁ of an interval. For every N₁ in it, one plane touches
    # the corner, and the parabola of the dry set at N₁. It encloses the sets of both labels. A row is zero where there
    # is no such plane. Shear beyond c + μN requires a share w of inner corners, mostly of (−T, 0). The hull therefore
    # bulges between a corner (n, m) and the parabola. Planes a N − b|V| − |m| + h ≥ 0 tangent to it at N₁ have a = 1 +
    # μb − 2N₁/N_c. The one with b = −(m − n (1 − 2N₁/N_c) − N₁²/N_c) / (shear above) touches the corner too. It is a
    # plane of the hull where the other corners do not pass it. The corner is (−T, 0) where that has such planes, else
    # the one with the longest interval of N₁. Where planes of all directions meet, at the top, a single plane bounds
    # little.
    limit, mu, c, tension, inner_limit, stuck, rough = strengths.T
    top = 0.5 * (inner_limit - tension)
    normal = np.stack([-tension, top, inner_limit])[:, :, None]
    moment = np.stack([0.0 * top, (inner_limit + tension) / 6.0, 0.0 * top])[:, :, None]
    more = (stuck - c)[:, None] + (rough - mu)[:, None] * normal
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
