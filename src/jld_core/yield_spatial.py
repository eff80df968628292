"""Yield sets of spatial faces in scaled resultants: slacks and support functions for a proof, rows for a
solver.

A scaled spatial resultant is (N, V1, V2, m1, m2, mT) with m1 = M1 / (l2/2), m2 = M2 / (l1/2), mT = MT / c_T.
Bending is the same for every shape and form: with a list of rows c per face, a dry face asks for c·m ≤ N and
an inner one for c·m ≤ N + σtA. The polygon {c·m ≤ 1} has corners, and those are what the support functions
need.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import HalfspaceIntersection

from jld_core import sections, tolerances
from jld_core.assembly import DRY, INNER, Assembly, Bits, Bools, Floats, Interfaces, Ints, Strengths
from jld_core.errors import InputError
from jld_core.rows_spatial import spatial_rows
from jld_core.scaling import Scaling
from jld_core.yield_sets import RowPattern

InnerBending = Literal["paper", "kern"]


@dataclass(frozen=True)
class Bending:
    """Rows and corners of the bending sets of m faces, ragged: face f has rows start[f] to start[f + 1].

    dry, inner: (rows, 2) coefficients c of (m1, m2), in order of angle. dry_corners, inner_corners: (rows, 2)
    corners of {c·m ≤ 1}, the one between a row and the next. crushed: faces whose inner set has an upper end
    too, c·m ≥ N − σcA; their sets are solids with corners (ν, m) = crush_corners[crush_start[i] :
    crush_start[i + 1]], where N = −σtA + ν (σcA + σtA) and m is over σcA + σtA.
    """

    start: Ints
    dry: Floats
    inner: Floats
    dry_corners: Floats
    inner_corners: Floats
    crushed: Ints
    crush_start: Ints
    crush_corners: Floats

    @property
    def face(self) -> Ints:
        """(rows,) face of each row."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def most(self, rows: Floats, pair: Floats) -> Floats:
        """(m,) greatest c·x over the rows of each face, for x = pair (m, 2)."""
        product = np.einsum("ej,ej->e", rows, pair[self.face])
        return np.asarray(np.maximum.reduceat(product, self.start[:-1]))


@dataclass(frozen=True)
class SpatialYield:
    """Spatial yield sets of m faces, scaled by `Scaling.face`.

    friction: μ. tension, shear: σtA and τA; crush_dry, crush_inner: σcA (inf where none); all over the force
    scale. point: faces that are points and have no moments (`point_contact_assembly`), always dry.
    Dry: centre of pressure within the hull, |V| + |mT| ≤ μN; with σc N³ ≤ N_c (N − |m1|)(N − |m2|)
    (rectangles). Inner: bending rows against N + σtA and σcA − N, |V| + |mT| ≤ τA.
    Source: Iannuzzo et al. 2024, eq. (3)–(7), with the corrections of METHOD §2; support functions METHOD §3.
    """

    friction: Floats
    tension: Floats
    shear: Floats
    crush_dry: Floats
    crush_inner: Floats
    point: Bools
    bending: Bending
    pattern: RowPattern

    def active(self, labels: Bits) -> Bools:
        mask = np.ones((len(labels), 6), dtype=bool)
        mask[:, [1, 2, 5]] = (np.where(self._dry(labels), self.friction, self.shear) > 0.0)[:, None]
        mask[:, 3:] &= ~self.point[:, None]
        return mask

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        n, shear = forces[:, 0], self._shear(forces)
        dry = np.minimum(n - self.bending.most(self.bending.dry, forces[:, 3:5]), self._slide(n) - shear)
        crushed = np.flatnonzero(np.isfinite(self.crush_dry))
        if crushed.size:
            dry[crushed] = np.minimum(dry[crushed], _crush_slack(forces[crushed], self.crush_dry[crushed]))
        lean = self.bending.most(self.bending.inner, forces[:, 3:5])
        other = self.bending.most(-self.bending.inner, forces[:, 3:5])
        rest = np.minimum(n + self.tension - lean, self.crush_inner - n - other) / 3.0
        inner = np.minimum(rest, np.where(self.shear > 0.0, self.shear, np.inf) - shear)
        return np.where(self._dry(labels), dry, inner)

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        n = forces[:, 0]
        dry = np.minimum(
            n - self.bending.most(self.bending.dry, forces[:, 3:5]), self._slide(n) - self._shear(forces)
        )
        inner = (n - self.bending.most(self.bending.inner, forces[:, 3:5])) / 3.0
        dry = np.where(np.isfinite(self.crush_dry), np.inf, dry)
        inner = np.where(np.isfinite(self.crush_inner), np.inf, inner)
        return np.where(self._dry(labels), dry, inner)

    def recession_active(self, labels: Bits) -> Bools:
        mask, dry = self.active(labels), self._dry(labels)
        for resultant in (1, 2, 5):
            mask[:, resultant] &= dry
        mask[np.isfinite(np.where(dry, self.crush_dry, self.crush_inner))] = False
        return mask

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        opening, slip = jumps[:, 0], self._slip(jumps)
        dry = np.zeros(len(jumps))
        crushed = np.flatnonzero(np.isfinite(self.crush_dry))
        if crushed.size:
            dry[crushed] = _crush_dissipation(
                self.friction[crushed] * slip[crushed] - opening[crushed],
                jumps[crushed],
                self.crush_dry[crushed],
            )
        inner = self.tension * opening + self.shear * slip
        crushed = self.bending.crushed
        if crushed.size:
            owner = np.repeat(crushed, np.diff(self.bending.crush_start))
            work = -np.einsum("ej,ej->e", self.bending.crush_corners, jumps[owner][:, [0, 3, 4]])
            most = np.maximum.reduceat(work, self.bending.crush_start[:-1])
            inner[crushed] += (self.crush_inner[crushed] + self.tension[crushed]) * most
        return np.where(self._dry(labels), dry, inner)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        opening, turn = jumps[:, 0], -jumps[:, 3:5]
        dry = opening - self.bending.most(self.bending.dry_corners, turn) - self.friction * self._slip(jumps)
        inner = opening - self.bending.most(self.bending.inner_corners, turn)
        dry = np.where(np.isfinite(self.crush_dry), np.inf, dry)
        inner = np.where(np.isfinite(self.crush_inner), np.inf, inner)
        return np.where(self._dry(labels), dry, inner)

    def _dry(self, labels: Bits) -> Bools:
        return np.asarray(labels | self.point)

    def _slide(self, normal: Floats) -> Floats:
        # resultants that a label drops are zero by construction and limit nothing
        return np.asarray(np.where(self.friction > 0.0, self.friction * normal, np.inf))

    def _shear(self, forces: Floats) -> Floats:
        twist = np.where(self.point, 0.0, np.abs(forces[:, 5]))
        return np.asarray(np.hypot(forces[:, 1], forces[:, 2]) + twist)

    def _slip(self, jumps: Floats) -> Floats:
        """max(|s|, c_T |ω|): what a cone with |V| + |mT| on its left makes of a slip and a turn."""
        turn = np.where(self.point, 0.0, np.abs(jumps[:, 5]))
        return np.asarray(np.maximum(np.hypot(jumps[:, 1], jumps[:, 2]), turn))


def _crush_slack(forces: Floats, crush: Floats) -> Floats:
    """(k,) greatest t with (N + t)³ ≤ N_c (N − |m1| − t)(N − |m2| − t) and both factors ≥ 0.

    It is concave and never changes faster than its three arguments, which the plain difference of the two
    sides does near the tip of the set. By bisection.
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
    """(k,) exact support function of the dry rectangle with compressive strength.

    drive: μ max(|s|, c_T|ω|) − δ. With u = 1 − |m1|/N, v = 1 − |m2|/N and ν = N/N_c ≤ uv the work is
    N_c ν (drive + a1 + a2 − a1 u − a2 v), a = |θ|; the best u, v for given ν cost 2√(a1 a2 ν) while
    both stay ≤ 1 (ν ≤ least a / greatest a) and least a + greatest a · ν beyond; concave in ν, slopes equal
    where the two meet.
    """
    turn = np.abs(jumps[:, 3:5])
    less, more = turn.min(axis=1), turn.max(axis=1)
    gain = drive + less + more
    near = (gain > 0.0) & (gain <= 3.0 * less)
    first, second = np.where(near, 3.0 * less, 1.0), np.where(near, 3.0 * more, 1.0)
    small = gain / 3.0 * (gain / first) * (gain / second)
    # beyond, the share of N_c is where the slope vanishes, or all of it
    rest = np.maximum(gain - less, 0.0)
    full = rest >= 2.0 * more
    share = np.where(full, 1.0, rest / np.where(full, 1.0, 2.0 * more))
    large = share * (rest - more * share)
    return np.asarray(crush * np.where(gain <= 0.0, 0.0, np.where(near, small, large)))


def spatial_yield(
    assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "paper"
) -> SpatialYield:
    """Spatial yield sets of all faces of an assembly, both labels, and their row pattern.

    inner_bending: "paper" takes the uncoupled form for rectangles, "kern" the elastic edge stress for all;
    faces that are no rectangles have the kern form in either case. A material the scene does not name becomes
    a face without strength: `require_materials` has refused the labellings that would need it. Concave
    contact is this on `point_contact_assembly`.
    Raises InputError: a dry compressive strength on a face that is no rectangle.
    """
    faces, strengths = assembly.interfaces, assembly.strengths
    point = np.array([len(polygon) == 1 for polygon in faces.polygon], dtype=bool)
    odd = np.flatnonzero(np.isfinite(strengths.crush_dry) & ~np.isnan(strengths.friction) & ~faces.rectangle)
    if odd.size:
        pair = f"{assembly.elements.ids[faces.a[odd[0]]]}–{assembly.elements.ids[faces.b[odd[0]]]}"
        raise InputError(
            "compressive_strength of dry faces", f"face {pair} is no rectangle", "rectangles only"
        )
    unit = faces.area / scaling.force
    sets = {
        "friction": np.nan_to_num(strengths.friction, nan=0.0),
        "tension": np.nan_to_num(strengths.tension, nan=0.0) * unit,
        "shear": np.nan_to_num(strengths.shear, nan=0.0) * unit,
        "crush_dry": _bounded(strengths.crush_dry, unit),
        "crush_inner": _bounded(strengths.crush_inner, unit),
    }
    bending = _bending(faces, point, inner_bending, np.isfinite(sets["crush_inner"]))
    return SpatialYield(
        **sets, point=point, bending=bending, pattern=spatial_rows(**sets, point=point, bending=bending)
    )


def _bounded(strength: Floats, unit: Floats) -> Floats:
    return np.asarray(
        np.where(
            np.isfinite(strength) & (unit > 0.0),
            np.where(np.isfinite(strength), strength, 0.0) * unit,
            np.inf,
        )
    )


_SIDES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
_DIAGONALS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
# corners of the kern of a rectangle: between a row and the next
_TIPS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])


def _bending(faces: Interfaces, point: Bools, inner_bending: InnerBending, crushed: Bools) -> Bending:
    """Bending rows of all faces: one for a point, four for a rectangle, one per hull edge otherwise."""
    rectangle = faces.rectangle & ~point
    count = np.where(point, 1, 4)
    general = np.flatnonzero(~rectangle & ~point)
    outlines = _local_hulls(faces, general)
    count[general] = [len(outline) for outline in outlines]
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    dry, inner, dry_corners, inner_corners = (np.zeros((start[-1], 2)) for _ in range(4))
    place = start[:-1][rectangle][:, None] + np.arange(4)
    dry[place], dry_corners[place] = _SIDES, _DIAGONALS
    rows, corners = (_SIDES, _DIAGONALS) if inner_bending == "paper" else (_DIAGONALS, _TIPS)
    inner[place], inner_corners[place] = 3.0 * rows, corners / 3.0
    for position, outline in zip(general.tolist(), outlines, strict=True):
        part = slice(start[position], start[position + 1])
        # moments are scaled by half the extents
        scale = 0.5 * np.array([faces.l2[position], faces.l1[position]])
        edges = sections.hull_rows(outline)
        dry[part] = -edges[:, 1:] / edges[:, :1] * scale
        inner[part] = -_kern(faces, position, outline)[:, 1:] * scale
        dry_corners[part], inner_corners[part] = _between(dry[part]), _between(inner[part])
    chosen = np.flatnonzero(crushed & ~point)
    solids = [
        _rectangle_solid(inner_corners[start[f] : start[f + 1]])
        if rectangle[f]
        else _solid(inner[start[f] : start[f + 1]])
        for f in chosen.tolist()
    ]
    return Bending(
        start=start,
        dry=dry,
        inner=inner,
        dry_corners=dry_corners,
        inner_corners=inner_corners,
        crushed=chosen,
        crush_start=np.concatenate([[0], np.cumsum([len(solid) for solid in solids])]).astype(np.int64),
        crush_corners=np.concatenate(solids) if solids else np.zeros((0, 3)),
    )


def _local(faces: Interfaces, face: int) -> Floats:
    """Polygon of a face in its own frame (k, 2)."""
    return np.asarray(
        (faces.polygon[face] - faces.origin[face]) @ np.array([faces.e1[face], faces.e2[face]]).T
    )


def _local_hulls(faces: Interfaces, which: Ints) -> list[Floats]:
    local = [_local(faces, face) for face in which.tolist()]
    return sections.hulls(sections.without_idle_corners(local, tolerances.FACE))


def _kern(faces: Interfaces, face: int, outline: Floats) -> Floats:
    moments = sections.second_moments(_local(faces, face)[None])[0]
    return sections.kern_rows(outline, float(faces.area[face]), moments)


def _between(rows: Floats) -> Floats:
    """Corners (h, 2) of {c·m ≤ 1}: where a row and the next, in order of angle, are both equal to one."""
    onward = np.roll(rows, -1, axis=0)
    cross = rows[:, 0] * onward[:, 1] - rows[:, 1] * onward[:, 0]
    return np.column_stack([onward[:, 1] - rows[:, 1], rows[:, 0] - onward[:, 0]]) / cross[:, None]


def _rectangle_solid(corners: Floats) -> Floats:
    """Corners (ν, m) of a double pyramid: its two tips, and the middle section."""
    middle = np.column_stack([np.full(len(corners), 0.5), 0.5 * corners])
    return np.concatenate([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], middle])


def _solid(rows: Floats) -> Floats:
    """Corners (ν, m) of {c·m ≤ ν, c·m ≥ ν − 1}; where the hull is not symmetric this is no double pyramid."""
    one = np.ones(len(rows))
    lower = np.column_stack([-one, rows, 0.0 * one])
    upper = np.column_stack([one, -rows, -one])
    found = HalfspaceIntersection(np.concatenate([lower, upper]), np.array([0.5, 0.0, 0.0])).intersections
    return np.asarray(found[np.all(np.isfinite(found), axis=1)])


def point_contact_assembly(assembly: Assembly, labels: Bits) -> tuple[Assembly, Ints]:
    """The assembly of concave contact: every dry face becomes one point face per corner of its hull.

    labels: (m,) True dry. Returns the assembly, whose own labels say dry for the points and inner for the
    rest, and the face each of its faces comes from, sorted. Point faces have no area and no moments, a
    polygon of one point, and the sizes of their parent (scales of moments that are never used).
    Corners within the hull add nothing: their cones are sums of those of the hull's corners.
    Raises InputError: a compressive strength on a dry face, since a point has no area to be crushed.
    Source: Livesley 1992; METHOD §2.
    """
    faces = assembly.interfaces
    hard = np.flatnonzero(labels & np.isfinite(assembly.strengths.crush_dry))
    if hard.size:
        pair = f"{assembly.elements.ids[faces.a[hard[0]]]}–{assembly.elements.ids[faces.b[hard[0]]]}"
        raise InputError(
            "--contact concave", f"dry face {pair} has a compressive strength", "convex contact there"
        )
    points: list[Floats] = [faces.polygon[face].mean(axis=0)[None] for face in range(len(faces))]
    dry = np.flatnonzero(labels)
    for face, outline in zip(dry.tolist(), _local_hulls(faces, dry), strict=True):
        points[face] = faces.origin[face] + outline @ np.array([faces.e1[face], faces.e2[face]])
    parent = np.repeat(np.arange(len(faces)), [len(p) for p in points])
    place = np.concatenate(points) if points else np.zeros((0, 3))
    is_point = labels[parent]
    polygon = tuple(place[[k]] if is_point[k] else faces.polygon[parent[k]] for k in range(len(parent)))
    spread = Interfaces(
        a=faces.a[parent],
        b=faces.b[parent],
        origin=np.where(is_point[:, None], place, faces.origin[parent]),
        normal=faces.normal[parent],
        e1=faces.e1[parent],
        e2=faces.e2[parent],
        l1=faces.l1[parent],
        l2=faces.l2[parent],
        area=np.where(is_point, 0.0, faces.area[parent]),
        c_t=faces.c_t[parent],
        rectangle=faces.rectangle[parent] & ~is_point,
        polygon=polygon,
    )
    s = assembly.strengths
    strengths = Strengths(*(v[parent] for v in (s.friction, s.tension, s.shear, s.crush_dry, s.crush_inner)))
    expanded = replace(
        assembly, interfaces=spread, strengths=strengths, labels=np.where(is_point, DRY, INNER).astype(bool)
    )
    return expanded, parent
