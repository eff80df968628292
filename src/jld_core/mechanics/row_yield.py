"""Yield sets stated as rows, one class for plane and space: what every route needs follows from rows and gauges.

x are the scaled resultants of the core of a face: (N, V, m) in the plane; in space (N, m1, m2), or all six. Sets and
dissipation: docs/method.md (2.19), (2.20). Dry joints that crush have a curved core, see `crushing`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.errors import InputError
from jld_core.mechanics.yield_set import (
    CoulombWedge,
    FrictionSet,
    Hull,
    ParabolicBending,
    Row,
    RowPattern,
    Rows,
    Sheet,
    Term,
    used,
)
from jld_core.strengths import Side, StatedCriterion

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
    """Planar faces that crush: |m| ≤ N (1 − N/N_c) of dry ones, and a wider parabola that encloses both labels."""

    faces: Ints  # (k,)
    limit: Floats  # (k,) N_c
    wide: Floats  # (k,) N_c of the wider parabola, inf for none
    shift: Floats  # (k,) σtA, by which it is moved

    def slack(self, forces: Floats) -> Floats:
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
        n = forces[:, 0]
        return np.maximum(used(abs(forces[:, 2]), n * (1.0 - n / self.limit), least), used(n, self.limit, least))

    def lay_out(self, sheet: Sheet) -> list[list[Row]]:
        """Return the cones N² ≤ N_c (N ∓ m), for N + σtA where they enclose both labels."""
        face, zeros, cones = self.faces, 0.0 * self.limit, []
        bounded = np.isfinite(self.wide)
        wide, shift = np.where(bounded, self.wide, 1.0), np.where(bounded, self.shift, 0.0)
        size = np.maximum(1.0, self.limit)
        # With w = N − sign·m and c = N_c: N² ≤ c·w ⇔ ‖(2N, c − w)‖ ≤ c + w.
        values = [1.0 / size, zeros, np.where(bounded, 1.0 / np.maximum(1.0, wide), 0.0)]
        constants = [self.limit / size, zeros, np.where(bounded, wide / np.maximum(1.0, wide), 0.0)]
        free = [zeros, zeros + 1.0, np.where(bounded, 0.0, 1.0)]
        for sign in (1.0, -1.0):
            rows: list[Row] = []
            for normal, moment, end, idle in ((-1.0, sign, 1.0, 1.0), (-2.0, 0.0, 0.0, 0.0), (1.0, -sign, 1.0, 0.0)):
                terms = [
                    (sheet.column(face, resultant), [factor * value for value in values])
                    for resultant, factor in ((0, normal), (2, moment))
                ]
                sides = [end * h + idle * h_free for h, h_free in zip(constants, free, strict=True)]
                sides[2] = sides[2] - normal * values[2] * shift
                rows.append((terms, sides))
            cones.append(rows)
        return cones


@dataclass(frozen=True)
class Rectangles:
    """Spatial faces (k,) that crush, all rectangles, see `Crushing`."""

    faces: Ints
    limit: Floats

    def slack(self, forces: Floats) -> Floats:
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
        smaller, larger = turn.min(axis=-1), turn.max(axis=-1)
        gain = smaller + larger - core[..., 0]
        before_transition = (gain > 0.0) & (gain <= 3.0 * smaller)
        first, second = np.where(before_transition, 3.0 * smaller, 1.0), np.where(before_transition, 3.0 * larger, 1.0)
        below = gain / 3.0 * (gain / first) * (gain / second)
        # Beyond the transition the best ν is where the slope vanishes, but at most one.
        excess = np.maximum(gain - smaller, 0.0)
        fully_crushed = excess >= 2.0 * larger
        share = np.where(fully_crushed, 1.0, excess / np.where(fully_crushed, 1.0, 2.0 * larger))
        beyond = share * (excess - larger * share)
        return np.asarray(self.limit * np.where(gain <= 0.0, 0.0, np.where(before_transition, below, beyond)))

    def share(self, forces: Floats, least: float) -> Floats:
        """Return 1/q (k,), q the factor on moments that crushes: least root of N³ = N_c (N − q|m1|)(N − q|m2|)."""
        n, moment1, moment2 = forces[:, 0], np.abs(forces[:, 3]), np.abs(forces[:, 4])
        with np.errstate(divide="ignore", invalid="ignore"):
            half, product = 0.5 * n * (moment1 + moment2), n * n * (1.0 - n / self.limit)
            root = np.sqrt(np.maximum(half * half - moment1 * moment2 * product, 0.0))
            share = (half + root) / product
        bending_share = np.where(np.maximum(moment1, moment2) <= least, 0.0, np.where(product > 0.0, share, 1.0))
        return np.maximum(bending_share, used(n, self.limit, least))

    def lay_out(self, sheet: Sheet) -> list[list[Row]]:
        """Add the rows p ≤ N ∓ m1 and q ≤ N ∓ m2; return a² ≤ pq, b² ≤ N and N² ≤ √N_c a b, docs/method.md (2.12)."""
        # p and q bound the sides of the effective rectangle. The cones together mean N³ ≤ N_c p q.
        face, (p, q, a, b) = self.faces, [sheet.new_columns(len(self.faces)) for _ in range(4)]
        ones, zeros = np.ones(len(face)), np.zeros(len(face))
        normal = sheet.column(face, 0)
        for variable, moment in ((p, 3), (q, 4)):
            for sign in (1.0, -1.0):
                terms: list[Term] = [(normal, [-ones, zeros, zeros])]
                terms += [(sheet.column(face, moment), [sign * ones, zeros, zeros]), (variable, [ones] * 3)]
                sheet.add(face, terms, [zeros, ones, ones])
        # x² ≤ y z is written as ‖(2x, y − z)‖ ≤ y + z. Where dry faces do not crush, N has no entries, and p, q, b are
        # bounded by one.
        weight = self.limit**-0.25
        size = np.maximum(1.0, weight)
        minus, zero = [-ones] * 3, [zeros] * 3
        first: list[Row] = [
            ([(p, minus), (q, minus)], zero),
            ([(a, [-2.0 * ones] * 3)], zero),
            ([(p, minus), (q, [ones] * 3)], zero),
        ]
        second: list[Row] = [
            ([(normal, [-ones, zeros, zeros])], [ones, 2.0 * ones, 2.0 * ones]),
            ([(b, [-2.0 * ones] * 3)], zero),
            ([(normal, [-ones, zeros, zeros])], [-ones, zeros, zeros]),
        ]
        third: list[Row] = [
            ([(a, [-ones / size] * 3), (b, [-ones / size] * 3)], zero),
            ([(normal, [-2.0 * weight / size, zeros, zeros])], zero),
            ([(a, [-ones / size] * 3), (b, [ones / size] * 3)], zero),
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
    touch_point = np.maximum(x, foot_knee)
    above = y > touch_point * touch_point / limit + (1.0 - 2.0 * touch_point / limit) * x
    knee = np.where(above, x + np.sqrt(np.maximum(x * x - limit * (x - y), 0.0)), foot_knee)
    (inner_friction, inner_shear), (mu, c) = ((label.friction[crushed], label.shear[crushed]) for label in (inner, dry))
    foot = inner_shear - inner_friction * tension
    # Without tensile strength the foot is at N = 0, where the dry face may resist shear.
    foot = np.where(tension > 0.0, foot, np.maximum(foot, c))
    corners = [(inner_limit, inner_shear + inner_friction * inner_limit)]
    corners += [(normal, c + mu * normal) for normal in (0.0 * limit, limit)]
    slopes = [(v - foot) / np.where(n + tension > 0.0, n + tension, 1.0) for n, v in corners]
    slope = np.maximum(np.max(slopes, axis=0), 0.0)
    ones, zeros = np.ones(len(crushed)), np.zeros(len(crushed))
    has_line = above.astype(float)
    line = [has_line, 3.0 * has_line, np.where(above, tension, 1.0)]
    height = foot + slope * tension
    size = np.maximum(np.maximum(ones, slope), height)
    rows = np.array([[ones, ones, zeros], [slope / size, ones / size, height / size], line]).transpose(2, 0, 1)
    resists_shear = inner_shear + inner_friction + mu + c > 0.0
    rows[~resists_shear, 1] = (0.0, 1.0, 1.0)
    strengths = np.column_stack([limit, mu, c, tension, inner_limit, inner_shear, inner_friction])
    interaction = _interaction_planes(strengths)
    interaction[~resists_shear] = 0.0
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
    limit, mu, c, tension, inner_limit, inner_shear, inner_friction = strengths.T
    top = 0.5 * (inner_limit - tension)
    normal = np.stack([-tension, top, inner_limit])[:, :, None]
    moment = np.stack([0.0 * top, (inner_limit + tension) / 6.0, 0.0 * top])[:, :, None]
    shear_excess = (inner_shear - c)[:, None] + (inner_friction - mu)[:, None] * normal
    share = np.linspace(0.0, 1.0, _STEPS)
    touch_point, slope = share * limit[:, None], 1.0 - 2.0 * share
    above = moment - slope * normal - share * touch_point  # height of the corners above the tangent
    planes, longest = np.zeros((len(limit), 5)), np.zeros(len(limit), dtype=np.int64)
    for corner in range(3):
        is_above = shear_excess[corner] > 0.0
        b = -above[corner] / np.where(is_above, shear_excess[corner], 1.0)
        violated = np.max(above + b * shear_excess, axis=0) > tolerances.ROUNDING * limit[:, None]
        valid = is_above & (b >= 0.0) & ~violated
        # Find the last range of consecutive N₁ whose planes are valid.
        last = _STEPS - 1 - np.argmax(valid[:, ::-1], axis=1)
        interrupted = ~valid & (np.arange(_STEPS) < last[:, None])
        first = np.where(interrupted.any(axis=1), _STEPS - np.argmax(interrupted[:, ::-1], axis=1), 0)
        length = np.where(valid.any(axis=1), last - first, 0)
        longer = length > longest
        longest = np.where(corner == 0, np.where(longer, _STEPS, 0), np.maximum(longest, length))
        corner_values = [array[corner, :, 0] for array in (normal, moment, shear_excess)]
        planes[longer] = np.column_stack([*corner_values, share[first] * limit, share[last] * limit])[longer]
    return planes


@dataclass(frozen=True)
class LabelRows:
    """Yield sets of m faces under one label: core rows C x + d ≥ 0, and gauges of shear and torsion."""

    C: Floats  # (m, r, q) rows of the core; zeros are idle
    d: Floats  # (m, r) constants
    B: Floats  # (m, 2, 2) of the gauge of shear; 0: none
    # (m, 2) of the gauges of shear and of torsion: factor of torsion (0: no such gauge), capacity without N, friction
    k: Floats
    c: Floats
    mu: Floats
    coupled: Bools  # (m,) one gauge limits shear and torsion; its numbers stand twice
    vertices: Floats  # (m, p, q) of the core, filled up
    rays: Floats
    kind: Ints  # (m,) class of faces with the same rows of stresses
    acting: Bools | None = None  # (m, q) resultants that may be non-zero; None: those of vertices and rays
    sized: LabelRows | None = None  # set whose rows have the scale of the program's; None: this one

    def scaled(self, unit: Floats) -> LabelRows:
        """Return the sets of resultants from those of stresses; unit: (m,) area over the force scale."""
        return replace(
            self, d=self.d * unit[:, None], c=self.c * unit[:, None], vertices=self.vertices * unit[:, None, None]
        )

    @cached_property
    def idle(self) -> Bools:
        """Return a mask (m, r) of rows that limit no resultant that may be non-zero."""
        return np.asarray(~np.any((self.C != 0.0) & self.acts[:, None, :], axis=2))

    @cached_property
    def acts(self) -> Bools:
        """Return a mask (m, q) of the core resultants that may be non-zero."""
        if self.acting is not None:
            return self.acting
        return np.asarray(np.any(self.vertices != 0.0, axis=1) | np.any(self.rays != 0.0, axis=1))

    @cached_property
    def grows(self) -> Bools:
        """Return a mask (m, q) of the core resultants that may be non-zero in the recession cone."""
        return np.asarray(np.any(self.rays != 0.0, axis=1))

    @cached_property
    def endless(self) -> Bools:
        """Return a mask (m,) of faces that can be loaded without limit in some direction."""
        return np.asarray(np.any(self.rays != 0.0, axis=(1, 2)))

    @cached_property
    def resists(self) -> Bools:
        """Return a mask (m, 2) of faces that resist shear, and torsion."""
        return np.asarray((self.c + self.mu > 0.0) & ((self.k > 0.0) | [True, False]))

    @cached_property
    def inverse(self) -> Floats:
        """Return the matrices B⁻ᵀ (m, 2, 2) of the dual gauge of shear."""
        has_gauge = np.any(self.B, axis=(1, 2), keepdims=True)
        return np.swapaxes(np.linalg.inv(np.where(has_gauge, self.B, np.eye(2))), 1, 2)

    @cached_property
    def is_simple_gauge(self) -> bool:
        """Return True if one gauge |V| + k|mT| limits shear and torsion of every face, with k = 1 or 0."""
        return bool(np.all(self.coupled) and np.all(np.eye(2) == self.B) and np.isin(self.k, (0.0, 1.0)).all())

    @cached_property
    def sides(self) -> Floats:
        """Return d (m, r), with inf in idle rows."""
        return np.where(self.idle, np.inf, self.d)

    @cached_property
    def capacity(self) -> Floats:
        """Return the limit c (m, 2) of gauges without N; inf where a label has no resistance and V is left out."""
        return np.where(self.resists, self.c, np.inf)

    @cached_property
    def missing_rays(self) -> Floats:
        """Return 0 for each ray (m, q), and inf where there is none."""
        return np.where(np.any(self.rays != 0.0, axis=2), 0.0, np.inf)

    @cached_property
    def recession_sides(self) -> Floats:
        """Return the sides (m, r) of the recession cone: 0, and inf where a row does not limit it."""
        limits = np.any((self.C != 0.0) & self.grows[:, None, :], axis=2) & self.endless[:, None]
        return np.where(limits, 0.0, np.inf)

    @cached_property
    def recession_capacity(self) -> Floats:
        """Return the limits (m, 2) of gauges in the recession cone: 0, and inf where V does not act."""
        return np.where((self.mu > 0.0) & self.endless[:, None], 0.0, np.inf)

    @cached_property
    def row_sizes(self) -> Floats:
        """Return the divisors (m, r) of the rows of the core in a program."""
        return np.maximum(1.0, self.d) if self.sized is None else self.sized.row_sizes

    @cached_property
    def program_rows(self) -> tuple[Floats, Floats]:
        """Return coefficients (m, r, q) of G and right-hand sides (m, r) of the core's rows in a program."""
        # An idle row keeps its coefficients with side one, so that a resultant that cannot act stays bounded.
        entry_kept = self.idle[:, :, None] | self.acts[:, None, :]
        rows = np.where(entry_kept, -self.C / self.row_sizes[:, :, None], 0.0)
        return rows, np.where(self.idle, 1.0, self.d / self.row_sizes)

    @cached_property
    def gauge_sizes(self) -> Floats:
        return np.maximum(np.maximum(1.0, self.mu), self.c) if self.sized is None else self.sized.gauge_sizes


@dataclass(frozen=True, eq=False)
class RowYield:
    """Yield sets of m faces of either dimension, stated as rows; the interface is that of `YieldSet`."""

    dimension: int
    dry: LabelRows
    inner: LabelRows
    enclosing: LabelRows | None  # sets that enclose both labels; None: `_enclosed` makes them
    criteria: tuple[StatedCriterion, ...] = ()
    late: int = 0  # number of core rows that stand after those of gauges
    crushing: Crushing | None = None  # dry faces that crush

    @property
    def _core(self) -> list[int]:
        """Return the places of the core resultants among all of a face."""
        return [0, 3, 4] if self.dimension == 3 and self.dry.C.shape[2] == 3 else list(range(self._freedoms))

    @property
    def _freedoms(self) -> int:
        return 3 if self.dimension == 2 else 6

    @cached_property
    def _simple_gauges(self) -> bool:
        return self.dry.is_simple_gauge and self.inner.is_simple_gauge

    @cached_property
    def _cache(self) -> list[tuple[bytes, dict[str, NDArray[Any]]]]:
        return [(b"", {})]

    def _by_label(self, labels: Bits, name: str) -> NDArray[Any]:
        """Return an array of `LabelRows` by name, for the label of each face; do not write to it."""
        # A proof asks for several arrays of one labelling. A pair is replaced as a whole, so that threads may share it.
        key, cached = labels.tobytes(), self._cache[0]
        if cached[0] != key:
            cached = self._cache[0] = (key, {})
        array = cached[1].get(name)
        if array is None:
            dry, inner = getattr(self.dry, name), getattr(self.inner, name)
            array = cached[1][name] = np.where(labels.reshape(-1, *([1] * (dry.ndim - 1))), dry, inner)
        return array

    def _full(self, labels: Bits, core: str, shear: Bools) -> Bools:
        """Return a mask (m, q) from one of core resultants, and from masks (m, 2) of shear and torsion."""
        mask = np.zeros((len(labels), self._freedoms), dtype=bool)
        mask[:, self._core] = self._by_label(labels, core)
        mask[:, [1, 2, 5] if self.dimension == 3 else [1]] |= shear[:, [0, 0, 1] if self.dimension == 3 else [0]]
        return mask

    def active(self, labels: Bits) -> Bools:
        """Return the mask (m, q) of resultants that may be non-zero, see `Rows.active`."""
        return self._full(labels, "acts", self._by_label(labels, "resists"))

    def recession_active(self, labels: Bits) -> Bools:
        """Return the mask (m, q) of resultants in recession cones, see `YieldSet.recession_active`."""
        grows = (self._by_label(labels, "mu") > 0.0) & self._by_label(labels, "endless")[:, None]
        return self._full(labels, "grows", grows & ((self._by_label(labels, "k") > 0.0) | [True, False]))

    def _demands(self, forces: Floats, labels: Bits) -> Floats:
        """Return the values (m, g) of the gauge of shear and torsion, or of one of each."""
        if self.dimension == 2:
            return abs(forces[:, 1:2])
        if self._simple_gauges:
            shear = np.hypot(forces[:, 1], forces[:, 2])
            return (shear + self._by_label(labels, "k")[:, 1] * abs(forces[:, 5]))[:, None]
        shear = np.linalg.norm(np.einsum("mij,mj->mi", self._by_label(labels, "B"), forces[:, 1:3]), axis=1)
        k, coupled = self._by_label(labels, "k"), self._by_label(labels, "coupled")
        torsion = k[:, 1] * abs(forces[:, 5])
        sum_of_both = shear + torsion
        return np.column_stack([np.where(coupled, sum_of_both, shear), np.where(coupled, sum_of_both, torsion)])

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q), see `YieldSet.slack`."""
        slack = self._slack(forces, labels, "sides", "capacity")
        if self.crushing is not None:
            faces = self.crushing.faces
            with_crushing = np.minimum(slack[faces], self.crushing.slack(forces[faces]))
            slack[faces] = np.where(labels[faces], with_crushing, slack[faces])
        return slack

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) in recession cones, see `YieldSet.recession_slack`."""
        return self._slack(forces, labels, "recession_sides", "recession_capacity")

    def _slack(self, forces: Floats, labels: Bits, sides: str, capacity: str) -> Floats:
        """Return the least slack (m,) of rows and gauges, with sides and capacity of these names."""
        rows = np.einsum("mrj,mj->mr", self._by_label(labels, "C"), forces[:, self._core])
        rows = rows + self._by_label(labels, sides)
        demands = self._demands(forces, labels)
        capacities, mu = (self._by_label(labels, name)[:, : demands.shape[1]] for name in (capacity, "mu"))
        room = capacities + mu * forces[:, :1] - demands
        return np.asarray(np.minimum(rows.min(axis=1), room.min(axis=1)))

    def _slips(self, jumps: Floats, labels: Bits) -> tuple[Floats, Floats | float]:
        """Return what jumps (..., m, q) do on the gauge of shear, and on one of torsion alone, per unit of capacity."""
        if self.dimension == 2:
            return abs(jumps[..., 1]), 0.0
        if self._simple_gauges:
            spin = np.where(self._by_label(labels, "k")[:, 1] > 0.0, abs(jumps[..., 5]), 0.0)
            return np.maximum(np.hypot(jumps[..., 1], jumps[..., 2]), spin), 0.0
        in_gauge = np.einsum("mij,...mj->...mi", self._by_label(labels, "inverse"), jumps[..., 1:3])
        slip = np.linalg.norm(in_gauge, axis=-1)
        k, coupled = self._by_label(labels, "k")[:, 1], self._by_label(labels, "coupled")
        spin = abs(jumps[..., 5]) / np.where(k > 0.0, k, 1.0)
        # A coupled gauge is dual to the larger of slip and spin; two gauges add.
        return np.where(coupled, np.maximum(slip, spin), slip), np.where(coupled, 0.0, spin)

    def _reduced(self, jumps: Floats, labels: Bits) -> tuple[Floats, Floats]:
        """Return the core jumps (..., m, q), less dilation, and the work on the capacity without N (..., m)."""
        first, second = self._slips(jumps, labels)
        c, mu, core = self._by_label(labels, "c"), self._by_label(labels, "mu"), jumps[..., self._core]
        core[..., 0] -= mu[:, 0] * first + mu[:, 1] * second
        return core, np.asarray(c[:, 0] * first + c[:, 1] * second)

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the dissipation of scaled jumps (m, q) or (k, m, q), see `YieldSet.dissipation`."""
        core, shear_work = self._reduced(jumps, labels)
        work = -np.einsum("mpj,...mj->...mp", self._by_label(labels, "vertices"), core).min(axis=-1)
        if self.crushing is not None:
            faces = self.crushing.faces
            work[..., faces] += np.where(labels[faces], self.crushing.dissipation(core[..., faces, :]), 0.0)
        return np.asarray(work + shear_work)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the margin of scaled jumps (m, q) or (k, m, q), see `YieldSet.margin`."""
        core, _ = self._reduced(jumps, labels)
        along_rays = np.einsum("mpj,...mj->...mp", self._by_label(labels, "rays"), core)
        return np.asarray((along_rays + self._by_label(labels, "missing_rays")).min(axis=-1, initial=np.inf))

    def strength(self, labels: Bits) -> Floats:
        """Estimate the largest dissipation (m,) of a jump of size 1, see `YieldSet.strength`."""
        # Sum of the largest coordinate of the core's vertices and the gauges' capacities without N; a coupled gauge
        # counts once.
        vertices, capacity = self._by_label(labels, "vertices"), self._by_label(labels, "c")
        torsion = np.where(self._by_label(labels, "coupled"), 0.0, capacity[:, 1])
        strength = abs(vertices).max(axis=(1, 2)) + capacity[:, 0] + torsion
        if self.crushing is not None:
            faces = self.crushing.faces
            strength[faces] += np.where(labels[faces], self.crushing.limit, 0.0)
        return np.asarray(strength)

    def utilisation(self, forces: Floats, labels: Bits) -> Floats:
        """Return the largest ratio (m,) of a demand to its capacity, see `YieldSet.utilisation`."""
        core, c, d = forces[:, self._core], self._by_label(labels, "C"), self._by_label(labels, "d")
        shears = self._demands(forces, labels)
        negligible = 1e-6 * max(float(abs(forces[:, 0]).max(initial=0.0)), float(shears.max(initial=0.0)), 1e-300)
        # Rows C x + d ≥ 0: moments and shear use what N and d give; N < 0 or > 0 alone uses d.
        from_normal = c[:, :, 0] * core[:, :1]
        from_others = -np.einsum("mrj,mj->mr", c[:, :, 1:], core[:, 1:])
        ratios = np.maximum(used(from_others, d + from_normal, negligible), used(-from_normal, d, negligible))
        shares = np.where(self._by_label(labels, "idle"), 0.0, ratios).max(axis=1)
        # shear and torsion use c + μ N
        capacity, mu = (self._by_label(labels, name)[:, : shears.shape[1]] for name in ("c", "mu"))
        shares = np.maximum(shares, used(shears, capacity + mu * forces[:, :1], negligible).max(axis=1))
        if self.crushing is not None:
            faces = self.crushing.faces
            crushed = np.maximum(shares[faces], self.crushing.share(forces[faces], negligible))
            shares[faces] = np.where(labels[faces], crushed, shares[faces])
        return np.asarray(np.clip(shares, 0.0, 1.0))

    @cached_property
    def _program_patterns(self) -> tuple[RowPattern, ...]:
        """Return the rows of both labels, and the same with enclosing rows in place of the dry ones."""
        return _patterns(self, (self.dry, self.inner, self._enclosed()))

    def _enclosed(self) -> LabelRows:
        """Return the sets that enclose both labels; a subclass without `enclosing` makes them."""
        assert self.enclosing is not None
        return self.enclosing

    @cached_property
    def pattern(self) -> RowPattern:
        """Return the sparsity and numbers of the yield rows of all faces, see `Rows.pattern`."""
        return self._program_patterns[0] if self.enclosing is not None else _patterns(self, (self.dry, self.inner))[0]

    def hull(self) -> Rows:
        all_dry = np.ones(len(self.dry.d), dtype=bool)
        return Hull(self._program_patterns[1], self.active(all_dry) | self.active(~all_dry))

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        return None

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        return None

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        return None

    @property
    def associative(self) -> FrictionSet:
        """Raise InputError: friction is not stated apart from the other rows."""
        criterion = self.criteria[0]
        problem = f'"{criterion.name}" is unknown to prescribed friction, and to all that asks for friction apart'
        raise InputError(f"materials.{criterion.label}.criterion", problem, "standard strengths in place of it")


def _patterns(sets: RowYield, labels: tuple[LabelRows, ...]) -> tuple[RowPattern, ...]:
    """Return the rows of a program for both labels, and with enclosing rows, if asked for, in place of dry ones."""
    sheet = Sheet(len(sets.dry.d), 3 if sets.dimension == 2 else 6, len(labels))
    early = sets.dry.C.shape[1] - sets.late
    _core_rows(sheet, sets, labels, slice(0, early))
    if sets.dimension == 2:
        cones: list[tuple[Ints, list[Row]]] = []
        if any(label.k.any() for label in labels):
            _shear_rows(sheet, labels)
    else:
        cones = _gauge_rows(sheet, labels)
    if sets.late:
        _core_rows(sheet, sets, labels, slice(early, None))
    crushed = [] if sets.crushing is None else sets.crushing.lay_out(sheet)
    linear = sheet.rows
    for (face, rows), limits_shear in zip(cones, (False, True), strict=False):
        sheet.cones(face, rows, limits_shear=limits_shear)
    if sets.crushing is not None:
        for rows in crushed:
            sheet.cones(sets.crushing.faces, rows)
    return sheet.patterns(linear)


def _core_rows(sheet: Sheet, sets: RowYield, labels: tuple[LabelRows, ...], part: slice) -> None:
    """Add the core's rows of some places, for the faces that have them under any label."""
    exists = np.any([np.any(label.C[:, part] != 0.0, axis=2) for label in labels], axis=0)
    if sets.dimension == 3:
        face, row = np.nonzero(exists)
    else:
        row, face = np.nonzero(exists.T)
    program_rows = [label.program_rows for label in labels]
    values = [rows[:, part][face, row] for rows, _ in program_rows]
    terms = [
        (sheet.column(face, resultant), [value[:, j] for value in values]) for j, resultant in enumerate(sets._core)
    ]
    sheet.add(face, terms, [sides[:, part][face, row] for _, sides in program_rows])


def _shear_rows(sheet: Sheet, labels: tuple[LabelRows, ...]) -> None:
    """Add the rows ±V ≤ c + μN of planar faces."""
    face = np.arange(sheet.faces)
    for sign in (1.0, -1.0):
        terms = [
            (sheet.column(face, 0), [-label.mu[:, 0] / label.gauge_sizes[:, 0] for label in labels]),
            (sheet.column(face, 1), [sign / label.gauge_sizes[:, 0] for label in labels]),
        ]
        sheet.add(face, terms, _capacities(labels, face, 0), limits_shear=True)


def _capacities(labels: tuple[LabelRows, ...], face: Ints, gauge: int) -> list[Floats]:
    """Return the right-hand sides of gauges; 1 keeps rows of a resultant idle that a label leaves out."""
    capacities = [(label, label.c[face, gauge] / label.gauge_sizes[face, gauge]) for label in labels]
    return [np.where(label.resists[face, gauge], c, 1.0) for label, c in capacities]


def _gauge_rows(sheet: Sheet, labels: tuple[LabelRows, ...]) -> list[tuple[Ints, list[Row]]]:
    """Add the linear rows of shear and torsion of spatial faces; return faces and rows of the cones of shear."""
    # A variable t of each face bounds shear: |B V| ≤ t, and t ± k mT ≤ c + μN where one gauge limits both, else t and ±
    # k mT have rows of their own. Where nothing twists, |B V| ≤ c + μN needs no variable.
    twists = np.any([label.k[:, 1] > 0.0 for label in labels], axis=0)
    shears = np.any([label.B.any(axis=(1, 2)) for label in labels], axis=0)
    face, shear_only = np.flatnonzero(twists), np.flatnonzero(~twists & shears)
    bound = sheet.new_columns(len(face))
    separate_gauges = not all(label.coupled.all() for label in labels)
    for gauge, sign in [(1, 1.0), (1, -1.0)] + [(0, 0.0)] * separate_gauges:
        sizes = [(label, label.gauge_sizes[face, gauge]) for label in labels]
        terms = [
            (sheet.column(face, 0), [-label.mu[face, gauge] / size for label, size in sizes]),
            (sheet.column(face, 5), [sign * label.k[face, 1] / size for label, size in sizes]),
            (bound, [np.where(label.coupled[face] | (gauge == 0), 1.0, 0.0) / size for label, size in sizes]),
        ]
        sheet.add(face, terms, _capacities(labels, face, gauge), limits_shear=True)
    cones: list[tuple[Ints, list[Row]]] = []
    minus = [-np.ones(len(face))] * len(labels)
    right_sides = [np.where(label.resists[face, 0], 0.0, 1.0) for label in labels]
    for faces, scale, first in (
        (face, [1.0] * len(labels), ([(bound, minus)], right_sides)),
        (shear_only, [label.gauge_sizes[shear_only, 0] for label in labels], None),
    ):
        if first is None:
            values = [-label.mu[faces, 0] / size for label, size in zip(labels, scale, strict=True)]
            first = [(sheet.column(faces, 0), values)], _capacities(labels, faces, 0)
        rows: list[Row] = [first]
        for i in (0, 1):
            pairs = list(zip(labels, scale, strict=True))
            by_axis = [[-label.B[faces, i, j] / size for label, size in pairs] for j in (0, 1)]
            terms = [(sheet.column(faces, 1 + j), values) for j, values in enumerate(by_axis)]
            rows.append((terms, [np.zeros(len(faces))] * len(labels)))
        cones.append((faces, rows))
    return cones
