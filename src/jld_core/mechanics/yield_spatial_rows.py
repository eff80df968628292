"""Solver rows of spatial yield sets: linear rows, then cones, for both labels.

A row that a label does not use keeps its place. Some rows hold variables that no other row would hold under that label.
They keep their coefficients with right-hand side one, so that no direction is unbounded.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.mechanics.bending import Bending, Frictional, InnerBending, bending_of, scaled_strengths
from jld_core.mechanics.hull import hull_rows
from jld_core.mechanics.row_yield import row_yield
from jld_core.mechanics.scaling import Scaling
from jld_core.mechanics.yield_planar import planar_yield
from jld_core.mechanics.yield_set import CoulombWedge, Hull, ParabolicBending, RowPattern, Rows, YieldSet, used
from jld_core.strengths import Route, Strengths

Coefficient = tuple[Ints, Floats, Floats]
"""Columns of a family of rows, and their coefficients under dry and under inner."""


@dataclass
class _RowCollector:
    """Builder of a `RowPattern`, to which yield rows are added family by family."""

    faces: int  # number m of faces
    # rows, extra: numbers of rows and of columns beyond the resultants so far
    rows: int = 0
    extra: int = 0
    # for each family its positions of rows, columns and faces, then dry and inner coefficients
    entries: list[tuple[Ints, Ints, Ints, Floats, Floats]] = field(default_factory=list)
    # right-hand sides (k, 2) with their rows and faces
    sides: list[tuple[Floats, Ints, Ints]] = field(default_factory=list)
    length: int = 0  # number of entries so far
    capacity: list[Ints] = field(default_factory=list)  # positions of entries that hold −μ

    def column(self, face: Ints, resultant: int) -> Ints:
        """Return the columns of one resultant of the faces (k,)."""
        return 6 * face + resultant

    def new_columns(self, count: int) -> Ints:
        """Return the columns of `count` new variables beyond the resultants."""
        columns = 6 * self.faces + self.extra + np.arange(count)
        self.extra += count
        return columns

    def add(
        self,
        face: Ints,
        coefficients: list[Coefficient],
        h_dry: Floats,
        h_inner: Floats,
        place: Ints | None = None,
        *,
        limits_shear: bool = False,
    ) -> None:
        """Add one family of rows, one row per face.

        face: (k,) faces. h_dry, h_inner: (k,) right-hand sides. place: (k,) positions of the rows, by default after the
        present ones. limits_shear: True if the first of the coefficients is −μ.
        """
        if place is None:
            place = self.rows + np.arange(len(face))
            self.rows += len(face)
        for number, (column, dry, inner) in enumerate(coefficients):
            used = (dry != 0.0) | (inner != 0.0)
            self.entries.append((place[used], column[used], face[used], dry[used], inner[used]))
            if limits_shear and number == 0:
                self.capacity.append(self.length + np.arange(int(used.sum())))
            self.length += int(used.sum())
        self.sides.append((np.column_stack([h_dry, h_inner]), place, face))

    def cones(
        self, face: Ints, rows: list[tuple[list[Coefficient], Floats, Floats]], *, limits_shear: bool = False
    ) -> int:
        """Add one second-order cone per face, and return the number of cones.

        face: (k,) faces. limits_shear: True if the first row of the cone is μN.
        """
        size = len(rows)
        for offset, (coefficients, h_dry, h_inner) in enumerate(rows):
            place, limits = self.rows + size * np.arange(len(face)) + offset, limits_shear and offset == 0
            self.add(face, coefficients, h_dry, h_inner, place, limits_shear=limits)
        self.rows += size * len(face)
        return len(face)

    def pattern(self, linear: int, cones: tuple[int, ...]) -> RowPattern:
        """Return the collected rows as a pattern."""
        row, column, face, dry, inner = (np.concatenate(part) for part in zip(*self.entries, strict=True))
        sides = np.concatenate([side for side, _, _ in self.sides])
        order = np.argsort(np.concatenate([place for _, place, _ in self.sides]))
        row_face = np.concatenate([faces for _, _, faces in self.sides])
        return RowPattern(
            row=row,
            column=column,
            face=face,
            dry=dry,
            inner=inner,
            h_dry=sides[order, 0],
            h_inner=sides[order, 1],
            row_face=row_face[order],
            linear=linear,
            cones=cones,
            capacity=np.concatenate(self.capacity).astype(np.int64),
            extra=self.extra,
        )


def spatial_rows(sets: Strengths, point: Bools, bending: Bending) -> RowPattern:
    """Build the yield rows of m spatial faces under both labels.

    point: (m,) True for faces that are points.
    """
    # Columns: six resultants per face, as in A_eq; t, a bound on shear, per face with moments; p, q, a, b per face with
    # a dry compressive strength. Linear rows, in this order: bending per hull edge; t ± mT ≤ c + μN; bending of inner
    # faces against σc; p ≤ N ∓ m1 and q ≤ N ∓ m2. Cones: |V| ≤ t, or |V| ≤ μN at a point; then a² ≤ pq, b² ≤ N, N² ≤
    # √N_c a b, which together mean N³ ≤ N_c p q. Source: docs/method.md (2.8), (2.12).
    sheet = _RowCollector(len(sets.friction))
    crushed = np.flatnonzero(np.isfinite(sets.crush_dry))
    _bending_rows(sheet, sets.tension, sets.crush_dry, point, bending)
    plane, points = np.flatnonzero(~point), np.flatnonzero(point)
    bound = sheet.new_columns(len(plane))
    _torsion_rows(sheet, plane, bound, (sets.friction, sets.cohesion), (sets.inner_friction, sets.shear))
    _inner_crush_rows(sheet, sets.crush_inner, bending)
    some = _Crush(crushed, *(sheet.new_columns(crushed.size) for _ in range(4)))
    _effective_rows(sheet, some)
    linear = sheet.rows
    shearing = sets.shear + sets.inner_friction
    cones = _shear_cones(sheet, plane, bound, points, sets.friction, sets.cohesion, shearing)
    return sheet.pattern(linear, (3,) * (cones + _crush_cones(sheet, some, sets.crush_dry)))


def without_crushing(pattern: RowPattern, sets: Strengths, point: Bools, bending: Bending) -> RowPattern:
    """Return rows of spatial faces in which dry faces bend without crushing."""
    # `hull_rows` takes them and moves N by −σtA; then they enclose both labels. N ≤ max(N_c, σcA) takes the place of
    # crushing, in the rows of inner σc, where a face has those. The variables of crushing keep their inner rows.
    crushed = np.isfinite(sets.crush_dry)
    data, rhs = pattern.dry.copy(), pattern.h_dry.copy()
    size, resultants = len(bending.face), 6 * len(sets.friction)
    bends = pattern.row < size
    bends[bends] = crushed[bending.face[pattern.row[bends]]]
    own = pattern.column[bends] % 6
    coefficients = np.column_stack([-np.ones(size), np.zeros((size, 2)), bending.dry])
    data[bends] = coefficients[pattern.row[bends], own]
    rhs[np.flatnonzero(crushed[bending.face])] = 0.0
    first = size + 2 * int((~point).sum())
    capped = bending.face[np.isin(bending.face, bending.crushed)]
    last = first + len(capped)
    limit = np.maximum(sets.crush_dry, sets.crush_inner)[capped]
    inside = (pattern.row >= first) & (pattern.row < last) & (pattern.column < resultants) & (pattern.column % 6 == 0)
    bounded = np.isfinite(limit)
    data[inside] = np.where(bounded, 1.0 / np.where(bounded, limit, 1.0), 0.0)[pattern.row[inside] - first]
    rhs[first:last] = 1.0 + np.where(bounded, sets.tension[capped] / np.where(bounded, limit, 1.0), 0.0)
    effective = (pattern.row >= last) & (pattern.row < pattern.linear)
    effective |= pattern.row >= len(rhs) - 9 * int(crushed.sum())
    data[effective] = pattern.inner[effective]
    rows = np.arange(len(rhs))
    of_crushing = (rows >= last) & (rows < pattern.linear) | (rows >= len(rhs) - 9 * int(crushed.sum()))
    rhs[of_crushing] = pattern.h_inner[of_crushing]
    return replace(pattern, dry=data, h_dry=rhs)


@dataclass(frozen=True)
class _Crush:
    """Faces (k,) that crush, and the columns (k,) of their variables p, q, a and b.

    The variables are those of `spatial_rows`.
    """

    face: Ints
    p: Ints
    q: Ints
    a: Ints
    b: Ints


def _bending_rows(sheet: _RowCollector, tension: Floats, crush_dry: Floats, point: Bools, bending: Bending) -> None:
    """Add the bending rows c·m ≤ N and c·m ≤ N + σtA of all hull edges.

    tension, crush_dry: (m,) scaled strengths.
    """
    face = bending.face
    size = np.maximum(1.0, tension / 3.0)[face]
    # The effective rectangle of a crushed face implies these rows. A point is dry under either label.
    used = np.where(np.isfinite(crush_dry), 0.0, 1.0)[face]
    third = np.where(point[face], 1.0, 1.0 / (3.0 * size))
    coefficients = [(sheet.column(face, 0), -used, -third)]
    coefficients += [(sheet.column(face, 3 + j), used * bending.dry[:, j], third * bending.inner[:, j]) for j in (0, 1)]
    sheet.add(face, coefficients, 1.0 - used, np.where(point[face], 0.0, tension[face] * third))


def _torsion_rows(
    sheet: _RowCollector, face: Ints, bound: Ints, of_dry: tuple[Floats, Floats], of_inner: tuple[Floats, Floats]
) -> None:
    """Add the rows t ± mT ≤ c + μN, which limit torsion, for faces (k,).

    bound: (k,) columns of t, the bound on shear.
    """
    (mu, cohesive), (inner_mu, cap) = ((friction[face], cohesion[face]) for friction, cohesion in (of_dry, of_inner))
    size_v, size_s = np.maximum(np.maximum(1.0, mu), cohesive), np.maximum(np.maximum(1.0, cap), inner_mu)
    # Where a label has no shear resistance V and MT are dropped from equilibrium; these rows then only bound
    # the variables.
    h_dry = np.where(mu + cohesive > 0.0, cohesive / size_v, 1.0)
    h_inner = np.where(cap + inner_mu > 0.0, cap / size_s, 1.0)
    for sign in (1.0, -1.0):
        coefficients = [
            (sheet.column(face, 0), -mu / size_v, -inner_mu / size_s),
            (sheet.column(face, 5), sign / size_v, sign / size_s),
            (bound, 1.0 / size_v, 1.0 / size_s),
        ]
        sheet.add(face, coefficients, h_dry, h_inner, limits_shear=True)


def _inner_crush_rows(sheet: _RowCollector, crush: Floats, bending: Bending) -> None:
    """Add the bending rows c·m ≤ σcA − N of inner faces with a compressive strength σc.

    crush: (m,) scaled σcA.
    """
    rows = np.flatnonzero(np.isin(bending.face, bending.crushed))
    face = bending.face[rows]
    nothing = np.zeros(len(rows))
    third = 1.0 / (3.0 * np.maximum(1.0, crush[face] / 3.0))
    coefficients = [(sheet.column(face, 0), nothing, third)]
    coefficients += [(sheet.column(face, 3 + j), nothing, -third * bending.inner[rows, j]) for j in (0, 1)]
    sheet.add(face, coefficients, np.ones(len(rows)), crush[face] * third)


def _effective_rows(sheet: _RowCollector, crush: _Crush) -> None:
    """Add the rows p ≤ N ∓ m1 and q ≤ N ∓ m2 of dry faces that crush."""
    # p and q bound the sides of the effective rectangle.
    one, nothing = np.ones(len(crush.face)), np.zeros(len(crush.face))
    for variable, moment in ((crush.p, 3), (crush.q, 4)):
        for sign in (1.0, -1.0):
            coefficients = [
                (sheet.column(crush.face, 0), -one, nothing),
                (sheet.column(crush.face, moment), sign * one, nothing),
                (variable, one, one),
            ]
            sheet.add(crush.face, coefficients, nothing, one)


def _shear_cones(
    sheet: _RowCollector, plane: Ints, bound: Ints, points: Ints, friction: Floats, cohesion: Floats, inner: Floats
) -> int:
    """Add the shear cones |V| ≤ t, at points |V| ≤ μN, and return the number of cones.

    friction, cohesion: (m,) of dry faces. inner: (m,) positive where an inner face resists shear.
    """
    one, nothing = np.ones(len(plane)), np.zeros(len(plane))
    held = friction[plane] + cohesion[plane]
    idle = np.where(held > 0.0, 0.0, 1.0), np.where(inner[plane] > 0.0, 0.0, 1.0)
    rows: list[tuple[list[Coefficient], Floats, Floats]] = [([(bound, -one, -one)], *idle)]
    rows += [([(sheet.column(plane, j), -one, -one)], nothing, nothing) for j in (1, 2)]
    count = sheet.cones(plane, rows)
    mu = friction[points]
    size, nothing = np.maximum(1.0, mu), np.zeros(len(points))
    smooth = np.where(mu > 0.0, 0.0, 1.0)
    rows = [([(sheet.column(points, 0), -mu / size, -mu / size)], smooth, smooth)]
    rows += [([(sheet.column(points, j), -1.0 / size, -1.0 / size)], nothing, nothing) for j in (1, 2)]
    return count + sheet.cones(points, rows, limits_shear=True)


def _crush_cones(sheet: _RowCollector, crush: _Crush, crush_dry: Floats) -> int:
    """Add the cones (2.12) of docs/method.md for dry faces that crush; return their number.

    crush_dry: (m,) scaled N_c.
    """
    # x² ≤ y z is written as ‖(2x, y − z)‖ ≤ y + z. Under inner, N has no entries in them, and p, q, b are bounded by
    # one.
    face = crush.face
    one, nothing = np.ones(len(face)), np.zeros(len(face))
    normal = sheet.column(face, 0)
    minus = (-one, -one)
    first: list[tuple[list[Coefficient], Floats, Floats]] = [
        ([(crush.p, *minus), (crush.q, *minus)], nothing, nothing),
        ([(crush.a, -2.0 * one, -2.0 * one)], nothing, nothing),
        ([(crush.p, *minus), (crush.q, one, one)], nothing, nothing),
    ]
    second: list[tuple[list[Coefficient], Floats, Floats]] = [
        ([(normal, -one, nothing)], one, 2.0 * one),
        ([(crush.b, -2.0 * one, -2.0 * one)], nothing, nothing),
        ([(normal, -one, nothing)], -one, nothing),
    ]
    weight = crush_dry[face] ** -0.25
    size = np.maximum(1.0, weight)
    third: list[tuple[list[Coefficient], Floats, Floats]] = [
        ([(crush.a, -one / size, -one / size), (crush.b, -one / size, -one / size)], nothing, nothing),
        ([(normal, -2.0 * weight / size, nothing)], nothing, nothing),
        ([(crush.a, -one / size, -one / size), (crush.b, one / size, one / size)], nothing, nothing),
    ]
    return sum(sheet.cones(face, rows) for rows in (first, second, third))


_ROUTE: Final = Route("the standard yield set")


@dataclass(frozen=True)
class SpatialYield(Frictional):
    """Spatial yield sets of m faces, scaled by `Scaling.face`.

    Dry: centre of pressure within the hull, |V| + |mT| ≤ c + μN; with σc also N³ ≤ N_c (N − |m1|)(N − |m2|)
    (rectangles). Inner: bending rows against N + σtA and σcA − N, |V| + |mT| ≤ τA + μN, with the μ of inner faces.
    friction, cohesion: (m,) μ and c of dry faces, scaled. inner_friction, shear: (m,) μ and τA of inner faces, scaled.
    tension: (m,) σtA of inner faces, scaled. crush_dry, crush_inner: (m,) N_c = σcA of either label, scaled; inf where
    none is given. pattern: rows of the program. Source: Iannuzzo et al. 2024, eq. (3)–(7), as docs/method.md (2.2) to
    (2.12); support functions (3.4), (3.5), (3.8).
    """

    point: Bools  # (m,) faces that are points and have no moments (`point_contact_assembly`); they are always dry
    bending: Bending  # rows and corners of the bending sets

    def active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), False where a resultant is zero in every admissible state.

        labels: (m,) True = dry.
        """
        mask = np.ones((len(labels), 6), dtype=bool)
        mask[:, [1, 2, 5]] = self._holds(labels)[:, None]
        mask[:, 3:] &= ~self.point[:, None]
        return mask

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) under labels (m,)."""
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

        labels: (m,) True = dry.
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

        labels: (m,) True = dry.
        """
        mask, dry = np.ones((len(labels), 6), dtype=bool), self.is_dry(labels)
        mask[:, [1, 2, 5]] = (self.friction_of(labels) > 0.0)[:, None]
        mask[:, 3:] &= ~self.point[:, None]
        mask[np.isfinite(np.where(dry, self.crush_dry, self.crush_inner))] = False
        return mask

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the dissipation (m,) of scaled jumps (m, q) whose `margin` is ≥ 0.

        labels: (m,) True = dry.
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

        labels: (m,) True = dry.
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

        forces: (m, 6) scaled resultants. labels: (m,) True = dry.
        """
        # Demands are bending, shear with torsion, tension of inner faces and compression.
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
    forces: (k, 6) scaled resultants. crush: (k,) scaled N_c.
    """
    n, one, two = forces[:, 0], np.abs(forces[:, 3]), np.abs(forces[:, 4])
    with np.errstate(divide="ignore", invalid="ignore"):
        half, room = 0.5 * n * (one + two), n * n * (1.0 - n / crush)
        root = np.sqrt(np.maximum(half * half - one * two * room, 0.0))
        share = (half + root) / room
    return np.where(np.maximum(one, two) <= least, 0.0, np.where(room > 0.0, share, 1.0))


def _crush_slack(forces: Floats, crush: Floats) -> Floats:
    """Return the slack t (k,) of scaled forces (k, 6) in dry rectangles that crush.

    crush: (k,) N_c.
    """
    # t is the largest value with (N + t)³ ≤ N_c (N − |m1| − t)(N − |m2| − t) and both factors ≥ 0, computed by
    # bisection. It is concave and never changes faster than its three arguments. The plain difference of both sides
    # would change faster near the apex of the set.
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
    """
    # With u = 1 − |m1|/N, v = 1 − |m2|/N and ν = N/N_c ≤ uv, the work is N_c ν (drive + a1 + a2 − a1 u − a2 v), where a
    # = |θ|. For given ν the best u, v cost 2√(a1 a2 ν) while both stay ≤ 1, that is for ν ≤ least a / greatest a.
    # Beyond they cost least a + greatest a · ν. The work is concave in ν, and both slopes agree at the transition.
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

    Raises InputError: a dry compressive strength is given for a face that is no rectangle.
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
