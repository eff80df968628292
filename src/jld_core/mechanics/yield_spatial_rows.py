"""Solver rows of spatial yield sets: linear rows, then cones, for both labels.

A row that a label does not use keeps its place. Some rows hold variables that no other row would hold under that label.
They keep their coefficients with right-hand side one, so that no direction is unbounded.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.mechanics.bending import Bending
from jld_core.mechanics.yield_set import RowPattern
from jld_core.strengths import Strengths

Coefficient = tuple[Ints, Floats, Floats]
"""Columns of a family of rows, and their coefficients under dry and under inner."""


@dataclass
class _RowCollector:
    """Builder of a `RowPattern`, to which yield rows are added family by family.

    faces: number m of faces. rows, extra: numbers of rows and of columns beyond the resultants so far. entries: for
    each family its positions of rows, columns and faces, then dry and inner coefficients. sides: right-hand sides (k,
    2) with their rows and faces. length: number of entries so far. capacity: positions of entries that hold −μ.
    """

    faces: int
    rows: int = 0
    extra: int = 0
    entries: list[tuple[Ints, Ints, Ints, Floats, Floats]] = field(default_factory=list)
    sides: list[tuple[Floats, Ints, Ints]] = field(default_factory=list)
    length: int = 0
    capacity: list[Ints] = field(default_factory=list)

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

        face: (k,) faces. coefficients: columns with their dry and inner coefficients. h_dry, h_inner: (k,) right-hand
        sides. place: (k,) positions of the rows, by default after the present ones. limits_shear: True if the first of
        the coefficients is −μ.
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

        face: (k,) faces. rows: coefficients and both right-hand sides of each row of a cone. limits_shear: True if the
        first row of the cone is μN.
        """
        size = len(rows)
        for offset, (coefficients, h_dry, h_inner) in enumerate(rows):
            place, limits = self.rows + size * np.arange(len(face)) + offset, limits_shear and offset == 0
            self.add(face, coefficients, h_dry, h_inner, place, limits_shear=limits)
        self.rows += size * len(face)
        return len(face)

    def pattern(self, linear: int, cones: tuple[int, ...]) -> RowPattern:
        """Return the collected rows as a pattern.

        linear: number of linear rows, which come first. cones: sizes of the cones after them.
        """
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

    sets: scaled strengths. point: (m,) True for faces that are points. bending: rows of the bending sets.

    Columns: six resultants per face, as in A_eq; t, a bound on shear, per face with moments; p, q, a, b per face with a
    dry compressive strength.

    Linear rows, in this order: bending per hull edge; t ± mT ≤ c + μN; bending of inner faces against σc; p ≤ N ∓ m1
    and q ≤ N ∓ m2. Cones: |V| ≤ t, or |V| ≤ μN at a point; then a² ≤ pq, b² ≤ N, N² ≤ √N_c a b, which together mean N³
    ≤ N_c p q. Source: docs/method.md (2.8), (2.12).
    """
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
    """Return rows of spatial faces in which dry faces bend without crushing.

    `hull_rows` takes them and moves N by −σtA; then they enclose both labels. N ≤ max(N_c, σcA) takes the place of
    crushing, in the rows of inner σc, where a face has those. The variables of crushing keep their inner rows. pattern:
    rows with crushing. sets, point, bending: as in `spatial_rows`.
    """
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

    sheet: receives the rows. tension, crush_dry: (m,) scaled strengths. point, bending: as in `spatial_rows`.
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

    bound: (k,) columns of t, the bound on shear. of_dry, of_inner: friction and cohesion of all faces under either
    label. sheet: receives the rows.
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

    sheet: receives the rows. crush: (m,) scaled σcA. bending: rows c of all faces.
    """
    rows = np.flatnonzero(np.isin(bending.face, bending.crushed))
    face = bending.face[rows]
    nothing = np.zeros(len(rows))
    third = 1.0 / (3.0 * np.maximum(1.0, crush[face] / 3.0))
    coefficients = [(sheet.column(face, 0), nothing, third)]
    coefficients += [(sheet.column(face, 3 + j), nothing, -third * bending.inner[rows, j]) for j in (0, 1)]
    sheet.add(face, coefficients, np.ones(len(rows)), crush[face] * third)


def _effective_rows(sheet: _RowCollector, crush: _Crush) -> None:
    """Add the rows p ≤ N ∓ m1 and q ≤ N ∓ m2 of dry faces that crush.

    p and q bound the sides of the effective rectangle. sheet: receives the rows. crush: columns of these faces.
    """
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

    plane: faces with moments. bound: their columns of t. points: faces that are points. friction, cohesion: (m,) of dry
    faces. inner: (m,) positive where an inner face resists shear. sheet: receives the rows.
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

    x² ≤ y z is written as ‖(2x, y − z)‖ ≤ y + z. Under inner, N has no entries in them, and p, q, b are bounded by one.
    sheet: receives the rows. crush: columns of these faces. crush_dry: (m,) scaled N_c.
    """
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
