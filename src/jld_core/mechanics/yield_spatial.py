"""Yield sets of spatial faces in scaled resultants: slacks and support functions for a proof, rows for a
solver.

A scaled spatial resultant is (N, V1, V2, m1, m2, mT) with m1 = M1 / (l2/2), m2 = M2 / (l1/2), mT = MT / c_T.
Bending is the same for every shape and form: with a list of rows c per face, a dry face asks for c·m ≤ N and
an inner one for c·m ≤ N + σtA. The polygon {c·m ≤ 1} has corners, and those are what the support functions
need.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.mechanics.bending import Bending, InnerBending, bending_of
from jld_core.mechanics.scaling import Scaling
from jld_core.mechanics.yield_set import RowPattern
from jld_core.mechanics.yield_spatial_rows import spatial_rows


@dataclass(frozen=True)
class SpatialYield:
    """Spatial yield sets of m faces, scaled by `Scaling.face`.

    friction: μ. tension, shear: σtA and τA; crush_dry, crush_inner: σcA (inf where none); all over the force
    scale. point: faces that are points and have no moments (`point_contact_assembly`), always dry.
    Dry: centre of pressure within the hull, |V| + |mT| ≤ μN; with σc N³ ≤ N_c (N − |m1|)(N − |m2|)
    (rectangles). Inner: bending rows against N + σtA and σcA − N, |V| + |mT| ≤ τA.
    Source: Iannuzzo et al. 2024, eq. (3)–(7), as docs/method.md (2.2) to (2.12); support functions (3.4), (3.5), (3.8).
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
        dry = np.minimum(n - self.bending.most(self.bending.dry, forces[:, 3:5]), self._slide(n) - self._shear(forces))
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


def spatial_yield(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "paper") -> SpatialYield:
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
        raise InputError("compressive_strength of dry faces", f"face {pair} is no rectangle", "rectangles only")
    unit = faces.area / scaling.force
    sets = {
        "friction": np.nan_to_num(strengths.friction, nan=0.0),
        "tension": np.nan_to_num(strengths.tension, nan=0.0) * unit,
        "shear": np.nan_to_num(strengths.shear, nan=0.0) * unit,
        "crush_dry": _bounded(strengths.crush_dry, unit),
        "crush_inner": _bounded(strengths.crush_inner, unit),
    }
    bending = bending_of(faces, point, inner_bending, np.isfinite(sets["crush_inner"]))
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
