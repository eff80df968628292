"""Spatial yield sets in scaled resultants: rows, slacks and support functions.

A scaled spatial resultant is (N, V1, V2, m1, m2, mT) with m1 = M1 / (l2/2), m2 = M2 / (l1/2), mT = MT / c_T. Bending
has one form for every shape. With a list of rows c per face, a dry face requires c·m ≤ N and an inner face c·m ≤ N +
σtA. The support functions need the corners of the polygon {c·m ≤ 1}.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.mechanics.bending import Bending, InnerBending, bending_of
from jld_core.mechanics.frictional import Frictional, scaled_strengths
from jld_core.mechanics.hull import hull_rows
from jld_core.mechanics.row_yield import row_yield
from jld_core.mechanics.scaling import Scaling
from jld_core.mechanics.yield_planar import planar_yield
from jld_core.mechanics.yield_set import CoulombWedge, Hull, ParabolicBending, Rows, YieldSet, used
from jld_core.mechanics.yield_spatial_rows import spatial_rows, without_crushing
from jld_core.strengths import Route, Strengths

_ROUTE: Final = Route("the standard yield set")


@dataclass(frozen=True)
class SpatialYield(Frictional):
    """Spatial yield sets of m faces, scaled by `Scaling.face`.

    Dry: centre of pressure within the hull, |V| + |mT| ≤ c + μN; with σc also N³ ≤ N_c (N − |m1|)(N − |m2|)
    (rectangles). Inner: bending rows against N + σtA and σcA − N, |V| + |mT| ≤ τA + μN, with the μ of inner faces.

    friction, cohesion: (m,) μ and c of dry faces, scaled. inner_friction, shear: (m,) μ and τA of inner faces, scaled.
    tension: (m,) σtA of inner faces, scaled. crush_dry, crush_inner: (m,) n_c = σcA of either label, scaled; inf where
    none is given. pattern: rows of the program. point: (m,) faces that are points and have no moments
    (`point_contact_assembly`); they are always dry. bending: rows and corners of the bending sets.

    Source: Iannuzzo et al. 2024, eq. (3)–(7), as docs/method.md (2.2) to (2.12); support functions (3.4), (3.5), (3.8).
    """

    point: Bools
    bending: Bending

    def active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), False where a resultant is zero in every admissible state.

        labels: (m,) True = dry, see `Rows.active`.
        """
        mask = np.ones((len(labels), 6), dtype=bool)
        mask[:, [1, 2, 5]] = self._holds(labels)[:, None]
        mask[:, 3:] &= ~self.point[:, None]
        return mask

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) under labels (m,), see `YieldSet.slack`."""
        n, shear = forces[:, 0], self.shear_of(forces)
        slide, hold = self._capacity(n)
        dry = np.minimum(n - self.bending.most(self.bending.dry, forces[:, 3:5]), slide - shear)
        crushed = np.flatnonzero(np.isfinite(self.crush_dry))
        if crushed.size:
            dry[crushed] = np.minimum(dry[crushed], _crush_slack(forces[crushed], self.crush_dry[crushed]))
        lean = self.bending.most(self.bending.inner, forces[:, 3:5])
        other = self.bending.most(-self.bending.inner, forces[:, 3:5])
        rest = np.minimum(n + self.tension - lean, self.crush_inner - n - other) / 3.0
        return np.where(self.is_dry(labels), dry, np.minimum(rest, hold - shear))

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) in the recession cones.

        labels: (m,) True = dry, see `YieldSet.recession_slack`.
        """
        n, shear = forces[:, 0], self.shear_of(forces)
        slide = np.where(self.friction > 0.0, self.friction * n, np.inf)
        dry = np.minimum(n - self.bending.most(self.bending.dry, forces[:, 3:5]), slide - shear)
        inner = (n - self.bending.most(self.bending.inner, forces[:, 3:5])) / 3.0
        if self.has_inner_friction:
            inner = np.minimum(inner, np.where(self.inner_friction > 0.0, self.inner_friction * n, np.inf) - shear)
        dry = np.where(np.isfinite(self.crush_dry), np.inf, dry)
        inner = np.where(np.isfinite(self.crush_inner), np.inf, inner)
        return np.where(self.is_dry(labels), dry, inner)

    def recession_active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), True where a resultant may be non-zero in the recession cone.

        labels: (m,) True = dry, see `YieldSet.recession_active`.
        """
        mask, dry = np.ones((len(labels), 6), dtype=bool), self.is_dry(labels)
        mask[:, [1, 2, 5]] = (self.friction_of(labels) > 0.0)[:, None]
        mask[:, 3:] &= ~self.point[:, None]
        mask[np.isfinite(np.where(dry, self.crush_dry, self.crush_inner))] = False
        return mask

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the dissipation (m,) of scaled jumps (m, q) whose `margin` is ≥ 0.

        labels: (m,) True = dry, see `YieldSet.dissipation`.
        """
        opening, slip = jumps[:, 0], self.slip(jumps)
        dry = self.cohesion * slip if self.has_dry_cohesion else np.zeros(len(jumps))
        crushed = np.flatnonzero(np.isfinite(self.crush_dry))
        if crushed.size:
            dry[crushed] += _crush_dissipation(
                self.friction[crushed] * slip[crushed] - opening[crushed],
                jumps[crushed],
                self.crush_dry[crushed],
            )
        cracked = opening - self.inner_friction * slip if self.has_inner_friction else opening
        inner = self.tension * cracked + self.shear * slip
        crushed = self.bending.crushed
        if crushed.size:
            owner = np.repeat(crushed, np.diff(self.bending.crush_start))
            along = np.column_stack([cracked, jumps[:, 3:5]])[owner]
            work = -np.einsum("ej,ej->e", self.bending.crush_corners, along)
            most = np.maximum.reduceat(work, self.bending.crush_start[:-1])
            inner[crushed] += (self.crush_inner[crushed] + self.tension[crushed]) * most
        return np.where(self.is_dry(labels), dry, inner)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of the conditions for finite dissipation of jumps (m, q).

        labels: (m,) True = dry, see `YieldSet.margin`.
        """
        opening, turn, slip = jumps[:, 0], -jumps[:, 3:5], self.slip(jumps)
        dry = opening - self.bending.most(self.bending.dry_corners, turn) - self.friction * slip
        inner = opening - self.bending.most(self.bending.inner_corners, turn)
        if self.has_inner_friction:
            inner = inner - self.inner_friction * slip
        dry = np.where(np.isfinite(self.crush_dry), np.inf, dry)
        inner = np.where(np.isfinite(self.crush_inner), np.inf, inner)
        return np.where(self.is_dry(labels), dry, inner)

    def is_dry(self, labels: Bits) -> Bools:
        """Return a mask (m,), True for dry faces and for points, which are always dry.

        labels: (m,) True = dry.
        """
        return np.asarray(labels | self.point)

    def shear_of(self, forces: Floats) -> Floats:
        """Return the shear demand (m,) of scaled resultants (m, 6): |V| + |mT|, but |V| at points."""
        twist = np.where(self.point, 0.0, np.abs(forces[:, 5]))
        return np.asarray(np.hypot(forces[:, 1], forces[:, 2]) + twist)

    def slip(self, jumps: Floats) -> Floats:
        """Return the shear dissipation (m,) of scaled jumps (m, 6), per unit of shear capacity.

        It is max(|s|, |ω|), the support function of |V| + |mT| ≤ 1: s is the slip, ω the spin about the normal. Point
        contacts have no spin term.
        """
        turn = np.where(self.point, 0.0, np.abs(jumps[:, 5]))
        return np.asarray(np.maximum(np.hypot(jumps[:, 1], jumps[:, 2]), turn))

    def utilisation(self, forces: Floats, labels: Bits) -> Floats:
        """Return the largest ratio (m,) of a demand to its capacity on each face, 0 to 1.

        Demands are bending, shear with torsion, tension of inner faces and compression. forces: (m, 6) scaled
        resultants. labels: (m,) True = dry.
        """
        n, shear, dry = forces[:, 0], self.shear_of(forces), self.is_dry(labels)
        least = 1e-6 * max(float(abs(n).max(initial=0.0)), float(shear.max(initial=0.0)), 1e-300)
        capacity = self.cohesion_of(labels) + self.friction_of(labels) * n
        edge = used(self.bending.most(self.bending.dry, forces[:, 3:5]), n, least)
        crushed = np.flatnonzero(np.isfinite(self.crush_dry))
        edge[crushed] = _crush_use(forces[crushed], self.crush_dry[crushed], least)
        lean = used(self.bending.most(self.bending.inner, forces[:, 3:5]), n + self.tension, least)
        other = used(self.bending.most(-self.bending.inner, forces[:, 3:5]), self.crush_inner - n, least)
        pulled = np.where(dry, 0.0, used(-n, self.tension, least))
        pressed = used(n, np.where(dry, self.crush_dry, self.crush_inner), least)
        bent = np.where(dry, edge, np.maximum(lean, other))
        return np.asarray(np.clip(np.max([bent, used(shear, capacity, least), pulled, pressed], axis=0), 0.0, 1.0))

    def hull(self) -> Rows | None:
        """Return yield rows that enclose the sets of both labels of each face, see `hull_rows`.

        Where dry faces crush, the rows are wider than the convex hull: bending without crushing, and a limit on N.
        """
        every = np.ones(len(self.friction), dtype=bool)
        either, sets = np.asarray(self.active(every) | self.active(~every)), self
        if np.isfinite(self.crush_dry).any():
            sets = replace(self, pattern=without_crushing(self.pattern, self, self.point, self.bending))
        return Hull(hull_rows(sets, freedoms=6, shear=5, parabolas=False), either)

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        """Return None: parabolic sets exist in the plane only."""
        return None

    def with_strengths(self, sets: Strengths) -> SpatialYield:
        """Return the yield sets of the same faces with other scaled strengths, and their rows."""
        rows = spatial_rows(sets, self.point, self.bending)
        return SpatialYield(**vars(sets), point=self.point, bending=self.bending, pattern=rows)

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        """Return None: wedges exist in the plane only."""
        return None

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Return None: linear rows exist in the plane only."""
        return None


def _crush_use(forces: Floats, crush: Floats, least: float) -> Floats:
    """Return the ratio 1/q (k,) of bending demand to capacity in dry rectangles that crush.

    q is the factor on moments at which the rectangle crushes: the smallest root of N³ = N_c (N − q|m1|)(N − q|m2|).
    forces: (k, 6) scaled resultants. crush: (k,) scaled N_c. least: scaled moment up to which the ratio is 0. The ratio
    is 1 where N leaves no capacity.
    """
    n, one, two = forces[:, 0], np.abs(forces[:, 3]), np.abs(forces[:, 4])
    with np.errstate(divide="ignore", invalid="ignore"):
        half, room = 0.5 * n * (one + two), n * n * (1.0 - n / crush)
        root = np.sqrt(np.maximum(half * half - one * two * room, 0.0))
        share = (half + root) / room
    return np.where(np.maximum(one, two) <= least, 0.0, np.where(room > 0.0, share, 1.0))


def _crush_slack(forces: Floats, crush: Floats) -> Floats:
    """Return the slack t (k,) of scaled forces (k, 6) in dry rectangles that crush.

    t is the largest value with (N + t)³ ≤ N_c (N − |m1| − t)(N − |m2| − t) and both factors ≥ 0, computed by bisection.
    It is concave and never changes faster than its three arguments. The plain difference of both sides would change
    faster near the apex of the set. crush: (k,) N_c.
    """
    n, p, q = forces[:, 0], forces[:, 0] - np.abs(forces[:, 3]), forces[:, 0] - np.abs(forces[:, 4])
    high = np.minimum(p, q)
    low = np.minimum(high, -n)
    for _ in range(80):
        t = 0.5 * (low + high)
        inside = np.maximum(n + t, 0.0) ** 3 <= crush * (p - t) * (q - t)
        low, high = np.where(inside, t, low), np.where(inside, high, t)
    return low


def _crush_dissipation(drive: Floats, jumps: Floats, crush: Floats) -> Floats:
    """Return the dissipation (k,) of dry rectangles that crush, docs/method.md (3.8).

    drive: (k,) friction work minus opening, μ max(|s|, c_T|ω|) − δ. jumps: (k, 6) scaled. crush: (k,) N_c.

    With u = 1 − |m1|/N, v = 1 − |m2|/N and ν = N/N_c ≤ uv, the work is N_c ν (drive + a1 + a2 − a1 u − a2 v), where a =
    |θ|. For given ν the best u, v cost 2√(a1 a2 ν) while both stay ≤ 1, that is for ν ≤ least a / greatest a. Beyond
    they cost least a + greatest a · ν. The work is concave in ν, and both slopes agree at the transition.
    """
    turn = np.abs(jumps[:, 3:5])
    less, more = turn.min(axis=1), turn.max(axis=1)
    gain = drive + less + more
    near = (gain > 0.0) & (gain <= 3.0 * less)
    first, second = np.where(near, 3.0 * less, 1.0), np.where(near, 3.0 * more, 1.0)
    small = gain / 3.0 * (gain / first) * (gain / second)
    # Beyond the transition the best ν is where the slope vanishes, but at most one.
    rest = np.maximum(gain - less, 0.0)
    full = rest >= 2.0 * more
    share = np.where(full, 1.0, rest / np.where(full, 1.0, 2.0 * more))
    large = share * (rest - more * share)
    return np.asarray(crush * np.where(gain <= 0.0, 0.0, np.where(near, small, large)))


def spatial_yield(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "uncoupled") -> SpatialYield:
    """Make the yield sets of all faces of a spatial assembly, and their row pattern.

    assembly: a spatial structure; for concave contact its `point_contact_assembly`. scaling: scales of the assembly.
    inner_bending: "uncoupled": each moment of a rectangle is limited by itself, docs/method.md (2.5). "kern": elastic
    edge stress for all faces, (2.6). Faces that are no rectangles always have the kern form. Raises InputError: a dry
    compressive strength is given for a face that is no rectangle.
    """
    faces, strengths = assembly.interfaces, assembly.strengths(_ROUTE)
    point = np.array([len(polygon) == 1 for polygon in faces.polygon], dtype=bool)
    odd = np.flatnonzero(np.isfinite(strengths.crush_dry) & ~np.isnan(strengths.friction) & ~faces.rectangle)
    if odd.size:
        problem = f"face {assembly.pair(odd[0])} is no rectangle"
        raise InputError("compressive_strength of dry faces", problem, "rectangles only")
    sets = scaled_strengths(strengths, faces.area / scaling.force)
    bending = bending_of(faces, point, inner_bending, np.isfinite(sets.crush_inner))
    return SpatialYield(**vars(sets), point=point, bending=bending, pattern=spatial_rows(sets, point, bending))


def yield_set(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "uncoupled") -> YieldSet:
    """Make the yield sets of all faces of a planar or spatial assembly.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.
    scaling : Scaling
        Scales of the assembly.
    inner_bending : {"uncoupled", "kern"}
        Bending form of inner faces in space (see `spatial_yield`); ignored in the plane.

    Returns
    -------
    YieldSet
        `PlanarYield` or `SpatialYield`; `RowYield` where plug-ins state a criterion.

    Raises
    ------
    InputError
        A dry compressive strength is given for a spatial face that is no rectangle, or a criterion is unusable.
    """
    if assembly.face_strengths.criteria:
        return row_yield(assembly, scaling, inner_bending)
    if assembly.dimension == 2:
        return planar_yield(assembly, scaling)
    return spatial_yield(assembly, scaling, inner_bending)
