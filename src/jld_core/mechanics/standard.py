"""The standard criterion, stated once for both labels, plane and space: friction, shear, tension and crushing.

Source: Iannuzzo et al. 2024, eq. (3)–(7), as docs/method.md (2.2) to (2.12). Dry joints crush along a curve, see
`crushing`; planar faces have the rows ±m of a line and no torsion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, Interfaces
from jld_core.errors import InputError
from jld_core.geometry import outlines as polygons
from jld_core.mechanics.equilibrium import Scaling
from jld_core.mechanics.row_yield import Crushing, LabelRows, Parabolas, Rectangles, RowYield, parabolic_hull
from jld_core.mechanics.yield_set import CoulombWedge, ParabolicBending
from jld_core.scene.standard import ENDS, key_of
from jld_core.strengths import CRITERIA, STANDARD, Route, Side, Strengths

InnerBending = Literal["uncoupled", "kern"]
"""Bending set of inner rectangles: "uncoupled" is the uncoupled form (2.5), "kern" the elastic edge stress (2.6)."""


@dataclass(frozen=True)
class Bending:
    """Bending sets of m faces in scaled x = (m1, m2): c·x ≤ N of dry faces, c·x ≤ N + σtA of inner ones.

    Face f has the rows start[f] to start[f + 1] − 1, in order of angle.
    """

    start: Ints
    # (rows, 2) c under either label
    dry: Floats
    inner: Floats
    # (rows, 2) corners of {x : c·x ≤ 1} between a row and the next
    dry_corners: Floats
    inner_corners: Floats
    crushed: Ints  # faces with c·x ≥ N − σcA also
    # corners (ν, x) (corners, 3) of their solids, from crush_start on: N = −σtA + ν (σcA + σtA), x over σcA + σtA
    crush_start: Ints
    crush_corners: Floats

    @property
    def face(self) -> Ints:
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def table(self, *, dry: bool) -> tuple[Floats, Floats, Bools]:
        """Return the rows and corners (m, e, 2) of one label by faces, and a mask (m, e) of those that a face has."""
        counts, face = np.diff(self.start), self.face
        has_row = np.arange(int(counts.max(initial=0))) < counts[:, None]
        tables = []
        for values in (self.dry, self.dry_corners) if dry else (self.inner, self.inner_corners):
            table = np.zeros((*has_row.shape, 2))
            table[face, np.arange(len(face)) - self.start[face]] = values
            tables.append(table)
        return tables[0], tables[1], has_row

    def solids(self, faces: Ints) -> Floats:
        """Return the corners (k, p, 3) of the solids of some crushed faces, filled up with the first one."""
        counts = np.diff(self.crush_start)
        number = np.arange(int(counts.max(initial=0)))
        rank = np.searchsorted(self.crushed, faces)
        position = self.crush_start[rank][:, None] + np.where(number < counts[rank][:, None], number, 0)
        return np.asarray(self.crush_corners[position])


# Rows c of a rectangle with uncoupled moments, in order of angle
_SIDES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
# Corners of the uncoupled rectangle, and rows c of its kern, in order of angle
_DIAGONALS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
# Corners of the kern of a rectangle, each between a row and the next.
_TIPS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])


def bending_of(faces: Interfaces, point: Bools, inner_bending: InnerBending, crushed: Bools) -> Bending:
    """Compute the bending rows of all faces; point, crushed: (m,) points, and inner faces of compressive strength."""
    # A point has 1 row, a rectangle 4, any other face 1 per edge of its hull.
    rectangle = faces.rectangle & ~point
    count = np.where(point, 1, 4)
    other_faces = np.flatnonzero(~rectangle & ~point)
    outlines = local_hulls(faces, other_faces)
    count[other_faces] = [len(outline) for outline in outlines]
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    dry, inner, dry_corners, inner_corners = (np.zeros((start[-1], 2)) for _ in range(4))
    rows_of_rectangle = start[:-1][rectangle][:, None] + np.arange(4)
    dry[rows_of_rectangle], dry_corners[rows_of_rectangle] = _SIDES, _DIAGONALS
    rows, corners = (_DIAGONALS, _TIPS) if inner_bending == "kern" else (_SIDES, _DIAGONALS)
    inner[rows_of_rectangle], inner_corners[rows_of_rectangle] = 3.0 * rows, corners / 3.0
    for face, outline in zip(other_faces.tolist(), outlines, strict=True):
        rows_of_face = slice(start[face], start[face + 1])
        # Moments are scaled by half the sizes of the face.
        scale = 0.5 * np.array([faces.l2[face], faces.l1[face]])
        edges = polygons.hull_rows(outline)
        dry[rows_of_face] = -edges[:, 1:] / edges[:, :1] * scale
        inner[rows_of_face] = -_kern(faces, face, outline)[:, 1:] * scale
        dry_corners[rows_of_face] = _between(dry[rows_of_face])
        inner_corners[rows_of_face] = _between(inner[rows_of_face])
    crushing = np.flatnonzero(crushed & ~point)
    solids = [
        _rectangle_solid(inner_corners[start[f] : start[f + 1]])
        if rectangle[f]
        else _solid(inner[start[f] : start[f + 1]])
        for f in crushing.tolist()
    ]
    return Bending(
        start=start,
        dry=dry,
        inner=inner,
        dry_corners=dry_corners,
        inner_corners=inner_corners,
        crushed=crushing,
        crush_start=np.concatenate([[0], np.cumsum([len(solid) for solid in solids])]).astype(np.int64),
        crush_corners=np.concatenate(solids) if solids else np.zeros((0, 3)),
    )


def _local(faces: Interfaces, face: int) -> Floats:
    """Return the corners (k, 2) of one face in its own frame, scene units."""
    return np.asarray((faces.polygon[face] - faces.origin[face]) @ np.array([faces.e1[face], faces.e2[face]]).T)


def local_hulls(faces: Interfaces, rows: Ints) -> list[Floats]:
    """Return the convex hulls of some faces in their own frames: corners, counter-clockwise, scene units."""
    corners = [_local(faces, face) for face in rows.tolist()]
    # Take the hull first: the outline of a face with a hole passes its bridges twice.
    return polygons.without_idle_corners(polygons.hulls(corners), tolerances.FACE)


def _kern(faces: Interfaces, face: int, outline: Floats) -> Floats:
    """Return the scaled rows (h, 2) that limit the elastic edge stress of one face, see `polygons.kern_rows`."""
    moments = polygons.second_moments(_local(faces, face)[None])[0]
    return polygons.kern_rows(outline, float(faces.area[face]), moments)


def _between(rows: Floats) -> Floats:
    """Return the corners (h, 2) of the polygon {m : c·m ≤ 1}, each between a row (h, 2) and the next."""
    following = np.roll(rows, -1, axis=0)
    cross = rows[:, 0] * following[:, 1] - rows[:, 1] * following[:, 0]
    return np.column_stack([following[:, 1] - rows[:, 1], rows[:, 0] - following[:, 0]]) / cross[:, None]


def _rectangle_solid(corners: Floats) -> Floats:
    """Return the corners (k, 3) of a crushing rectangle's solid, (ν, m1, m2): two tips and half of corners (4, 2)."""
    middle = np.column_stack([np.full(len(corners), 0.5), 0.5 * corners])
    return np.concatenate([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], middle])


def _solid(rows: Floats) -> Floats:
    """Return the corners (k, 3) of {(ν, m1, m2) : ν − 1 ≤ c·m ≤ ν} for rows (h, 2), of any inner face that crushes."""
    ones = np.ones(len(rows))
    lower = np.column_stack([-ones, rows, 0.0 * ones])
    upper = np.column_stack([ones, -rows, -ones])
    from scipy.spatial import HalfspaceIntersection  # slow to import, and only spatial scenes need it

    intersections = HalfspaceIntersection(np.concatenate([lower, upper]), np.array([0.5, 0.0, 0.0])).intersections
    return np.asarray(intersections[np.all(np.isfinite(intersections), axis=1)])


_ROUTE: Final = Route("the standard yield set")

ROUTE_OF_ROWS: Final = Route("yield sets stated as rows", STANDARD - {"dry crushing"} | CRITERIA)
"""Reader of the standard criterion beside those of plug-ins, which are rows alone."""


# Rows of the moment of a planar face, as (m1, m2) of a spatial one; corners of the set of an inner face that crushes
_PAIR: Final = np.array([[0.0, 1.0], [0.0, -1.0]])
_SOLID: Final = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 1.0 / 6.0], [0.5, 0.0, -1.0 / 6.0]])


def standard_rows(side: Side, bending: Bending | None, point: Bools, late: int, *, dry: bool) -> LabelRows:
    """Return the standard criterion under one label as rows; the last `late` of each limit compression."""
    count, ones = len(side.tension), np.ones(len(side.tension))
    scale = np.where(point, 1.0, 1.0 if dry else 3.0)
    curved = dry & np.isfinite(side.crush)
    acting = np.ones((count, 3), dtype=bool)
    if bending is None:
        edges = scale[:, None, None] * _PAIR
        corners, used = _PAIR / scale[:, None, None], np.ones((count, 2), dtype=bool)
        is_row, acting[:, 1] = used, False
    else:
        edges, corners, used = bending.table(dry=dry)
        # The effective rectangle of a face that crushes implies its rows.
        is_row, acting[point, 1:] = used & ~curved[:, None], False
    # Rows are divided by the factor of the moments, so that coefficients are about 1.
    C, d = _lines(1.0, -edges, is_row, scale), is_row * (side.tension / scale)[:, None]
    vertices = np.zeros((count, 1, 3))
    if late:
        capped = np.flatnonzero(np.isfinite(side.crush) & ~curved)
        cap_edges, solids = (edges[:, ::-1], _SOLID) if bending is None else (edges, bending.solids(capped))
        is_cap, constants_of_caps = np.zeros((count, late), dtype=bool), np.zeros((count, late))
        is_cap[capped] = used[capped]
        constants_of_caps[capped] = used[capped] * (side.crush / scale)[capped, None]
        C = np.concatenate([C, _lines(-1.0, cap_edges, is_cap, scale)], axis=1)
        d = np.concatenate([d, constants_of_caps], axis=1)
        if capped.size:
            vertices = np.zeros((count, solids.shape[-2], 3))
            vertices[capped] = (side.crush + side.tension)[capped, None, None] * solids
    vertices[..., 0] -= side.tension[:, None]
    return LabelRows(
        C=C,
        d=d,
        B=np.broadcast_to(np.eye(2), (count, 2, 2)),
        k=np.column_stack([ones, np.where(point, 0.0, ones)]),
        c=np.repeat(side.shear[:, None], 2, axis=1),
        mu=np.repeat(side.friction[:, None], 2, axis=1),
        coupled=np.ones(count, dtype=bool),
        vertices=vertices,
        rays=_lines(1.0, corners, used & np.isinf(side.crush)[:, None], ones),
        kind=np.zeros(count, dtype=np.int64),
        acting=acting,
    )


def _lines(normal: float, moments: Floats, is_used: Bools, scale: Floats) -> Floats:
    """Return vectors (normal, moments) / scale (m, e, 3) from moments (m, e, 2); zeros where not `used` (m, e)."""
    vectors = np.empty((*is_used.shape, 3))
    vectors[..., 0], vectors[..., 1:] = normal, moments
    vectors *= (is_used / scale[:, None])[..., None]
    return vectors


@dataclass(frozen=True, eq=False)
class StandardYield(RowYield):
    """Standard criterion of m faces; bending: None in the plane; point: (m,) spatial points, always dry."""

    numbers: Strengths = field(kw_only=True)
    bending: Bending | None = field(kw_only=True)
    point: Bools = field(kw_only=True)

    def _enclosed(self) -> LabelRows:
        """Return the sets that enclose both labels, docs/method.md (6.3), scaled as dry ones."""
        # Without a bound on N, the closed convex hull of the dry and the inner set is the dry set moved to N = −σtA and
        # widened in shear: {|m| ≤ N + σtA, |V| ≤ w + μ (N + σtA)}. Here μ is the larger one of both labels and w =
        # max(c − μ σtA, τA − μ_inner σtA). With compressive strengths, or where inner faces have more friction, the
        # rows enclose the hull: bending without crushing, and in space a limit on N where both labels have one.
        (dry, inner), late = _sides(self.numbers, self.point), self.late
        friction = np.maximum(dry.friction, inner.friction)
        shear = np.maximum(inner.shear - inner.friction * inner.tension, dry.shear - friction * inner.tension)
        side = Side(inner.tension, shear + friction * inner.tension, friction, np.full(len(friction), np.inf))
        rows = standard_rows(side, self.bending, self.point, late, dry=True)
        if late and self.dimension == 3:
            capped = np.flatnonzero(np.isfinite(dry.crush) & np.isfinite(inner.crush))
            has_cap = np.any(rows.C[capped, :-late] != 0.0, axis=2)
            rows.C[capped, -late:, 0] = -(has_cap / np.maximum(dry.crush, inner.crush)[capped, None])
            rows.d[capped, -late:] = has_cap
        return replace(rows, sized=self.dry)

    @cached_property
    def has_inner_friction(self) -> bool:
        return bool((self.numbers.side(dry=False).friction > 0.0).any())

    @cached_property
    def has_dry_shear(self) -> bool:
        """Return True if any dry face resists shear without N."""
        return bool((self.numbers.side(dry=True).shear > 0.0).any())

    @property
    def tension(self) -> Floats:
        """Return the scaled tensile strength σtA (m,) of each face under the inner label."""
        return self.numbers.tension

    @property
    def associative(self) -> StandardYield:
        return self

    def is_dry(self, labels: Bits) -> Bools:
        """Return the dry faces (m,), and points, which are always dry."""
        return np.asarray(labels | self.point)

    def friction_of(self, labels: Bits) -> Floats:
        return np.array(self._by_label(labels, "mu")[:, 0])

    def capacity_of(self, labels: Bits) -> Floats:
        """Return the scaled shear capacity (m,) of each face at N = 0."""
        return np.array(self._by_label(labels, "c")[:, 0])

    def shear_of(self, forces: Floats) -> Floats:
        """Return the shear demand (m,) of resultants (m, q): |V|, in space |V| + |mT|, but |V| at points."""
        return self._demands(forces, self.point)[:, 0]

    def slip(self, jumps: Floats) -> Floats:
        return self._slips(jumps, self.point)[0]

    def with_strengths(self, sets: Strengths) -> StandardYield:
        """Return the yield sets of the same faces with other scaled strengths."""
        return _standard_yield(sets, self.bending, self.point)

    def with_friction(self, share: float) -> StandardYield:
        """Return a copy with all friction coefficients multiplied by `share`, for proofs alone."""
        return self._with_shear(lambda rows: replace(rows, mu=share * rows.mu))

    def without_shear_limit(self) -> StandardYield:
        """Return a copy without any limit on shear, for proofs of bending alone."""
        return self._with_shear(lambda rows: replace(rows, c=0.0 * rows.c, mu=0.0 * rows.mu))

    def _with_shear(self, change: Callable[[LabelRows], LabelRows]) -> StandardYield:
        return replace(self, dry=change(self.dry), inner=change(self.inner))

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        """Return the parabolic yield sets of planar faces whose dry joints crush, see `YieldSet`."""
        if self.dimension == 3 or self.crushing is None:
            return None
        crushed, limit = self.crushing.faces, self.crushing.limit
        if undecided:
            return parabolic_hull(*_sides(self.numbers, self.point), crushed)
        c, mu = self.dry.c[crushed, 0], self.dry.mu[crushed, 0]
        ones, zeros, size = np.ones(len(crushed)), np.zeros(len(crushed)), self.dry.gauge_sizes[crushed, 0]
        shear_row = [mu / size, ones / size, c / size]
        rows = np.array([[ones, ones, zeros], shear_row, [zeros, zeros, ones]]).transpose(2, 0, 1)
        # Where nothing resists shear V is dropped; its row must stay inactive.
        rows[~self.dry.resists[crushed, 0], 1] = (0.0, 1.0, 1.0)
        return ParabolicBending(crushed, np.column_stack([1.0 / limit, zeros]), rows)

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        """Return the planar sets of one label as wedges; None if any face has a limit on N."""
        rows = self.dry if dry else self.inner
        if self.dimension == 3 or not (self.dry.endless.all() and self.inner.endless.all()):
            return None
        return CoulombWedge(-rows.vertices[:, 0, 0], 1.0 if dry else 3.0, rows.mu[:, 0], rows.c[:, 0])

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        # C is (m, 4, 3) and d (m, 4). Dry: N ∓ m and c + μN ∓ V. Inner: N + σtA ∓ 3m and τA + μN ∓ V. Every coefficient
        # is a given number or a small integer.
        if self.dimension == 3 or not self._by_label(labels, "endless").all():
            return None
        rows, constants = np.zeros((len(labels), 4, 3)), np.zeros((len(labels), 4))
        rows[:, :2, 0] = 1.0
        rows[:, 1, 2] = np.where(labels, 1.0, 3.0)
        rows[:, 0, 2] = -rows[:, 1, 2]
        rows[:, 2:, 0] = self.friction_of(labels)[:, None]
        rows[:, 2:, 1] = (-1.0, 1.0)
        constants[:, :2] = np.where(labels, 0.0, self.numbers.tension)[:, None]
        constants[:, 2:] = self.capacity_of(labels)[:, None]
        return rows, constants


def _standard_yield(numbers: Strengths, bending: Bending | None, point: Bools) -> StandardYield:
    dry, inner = _sides(numbers, point)
    capped = np.isfinite(inner.crush).any()
    late = 0 if not capped else 2 if bending is None else int(np.diff(bending.start).max(initial=0))
    return StandardYield(
        2 if bending is None else 3,
        standard_rows(dry, bending, point, late, dry=True),
        standard_rows(inner, bending, point, late, dry=False),
        None,
        late=late,
        crushing=_crushing(dry, inner, plane=bending is None),
        numbers=numbers,
        bending=bending,
        point=point,
    )


def _sides(numbers: Strengths, point: Bools) -> tuple[Side, Side]:
    """Return the numbers of dry and of inner faces; points (m,) are dry under either label."""
    dry, inner = (numbers.side(dry=label) for label in (True, False))
    if point.any():
        inner = Side(*(np.where(point, getattr(dry, f.name), getattr(inner, f.name)) for f in fields(Side)))
    return dry, inner


def _crushing(dry: Side, inner: Side, *, plane: bool) -> Crushing | None:
    """Return the curved sets of dry faces that crush, planar ones with those of undecided faces."""
    faces = np.flatnonzero(np.isfinite(dry.crush))
    if not faces.size:
        return None
    if not plane:
        return Rectangles(faces, dry.crush[faces])
    # |m| ≤ N'(1 − N'/C), N' = N + σtA, C = M + σtA, M = max(N_c dry, N_c inner), encloses both labels. M is
    # inf, no bound, where the inner face never crushes. Dry: N'(1 − N'/C) − N (1 − N/M) = σtA (1 − N/M)² M/C ≥ 0.
    # Inner: N'(C − N')/C ≥ min(N', C − N')/2, and an inner face takes |m| up to a third of that minimum.
    shift = inner.tension[faces]
    return Parabolas(faces, dry.crush[faces], np.maximum(dry.crush, inner.crush)[faces] + shift, shift)


def standard_yield(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "uncoupled") -> StandardYield:
    """Make the standard yield sets; InputError: dry compressive strength of a spatial face that is no rectangle."""
    faces, strengths = assembly.interfaces, assembly.strengths(_ROUTE)
    numbers = scaled_strengths(strengths, faces.area / scaling.force)
    if assembly.dimension == 2:
        return _standard_yield(numbers, None, np.zeros(len(faces), dtype=bool))
    point = np.array([len(polygon) == 1 for polygon in faces.polygon], dtype=bool)
    dry = strengths.side(dry=True)
    irregular = np.flatnonzero(np.isfinite(dry.crush) & ~np.isnan(dry.friction) & ~faces.rectangle)
    if irregular.size:
        problem = f"face {assembly.pair(irregular[0])} is no rectangle"
        raise InputError(f"{key_of('dry', 'crush')} of dry faces", problem, "rectangles only")
    return _standard_yield(
        numbers, bending_of(faces, point, inner_bending, np.isfinite(numbers.side(dry=False).crush)), point
    )


def scaled_strengths(strengths: Strengths, unit: Floats) -> Strengths:
    """Convert strengths to forces, by the area of each face over the force scale; materials not named have none."""

    def scaled(stress: Floats) -> Floats:
        # A face without area has no limit, as one without compressive strength.
        free = np.isinf(stress)
        return np.where(free, np.inf, np.nan_to_num(np.where(free, 0.0, stress)) * unit)

    result = strengths.changed(scaled, np.nan_to_num)
    ends = {name: np.where(unit > 0.0, value, np.inf) for name, value in result.stresses.items() if name in ENDS}
    return replace(result, **ends)
