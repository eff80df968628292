"""Yield sets of dry and inner faces, in scaled resultants: rows for a solver, slacks and support functions
for a proof.

A scaled planar resultant is (N, V, m) with m = M / (l/2). Every row is of order one whatever the strengths.
Both labels of a face share one sparsity pattern, so that relabelling changes numbers only; a row that a label
does not use keeps its place with zero coefficients and slack one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.mechanics.scaling import Scaling
from jld_core.mechanics.yield_set import RowPattern


@dataclass(frozen=True)
class PlanarYield:
    """Planar yield sets of m faces, scaled by `Scaling.face`.

    friction: μ. tension, shear: σt A and τ A; crush_dry, crush_inner: σc A (inf where none); all over the
    force scale. Dry: |m| ≤ N(1 − N/N_c), |V| ≤ μN. Inner: |m| ≤ (N + σtA)/3, |m| ≤ (N_c − N)/3, |V| ≤ τA.
    Source: Iannuzzo et al. 2024, eq. (3)–(7), as docs/method.md (2.2) to (2.10); D(J): (3.4) to (3.7).
    """

    friction: Floats
    tension: Floats
    shear: Floats
    crush_dry: Floats
    crush_inner: Floats
    pattern: RowPattern

    @cached_property
    def _endless(self) -> bool:
        """Are there no compressive strengths?"""
        return bool(
            np.isinf(self.crush_dry).all() and np.isinf(self.crush_inner).all() and np.isfinite(self.shear).all()
        )

    def active(self, labels: Bits) -> Bools:
        mask = np.ones((len(labels), 3), dtype=bool)
        mask[:, 1] = np.where(labels, self.friction, self.shear) > 0.0
        return mask

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Rows C F + d ≥ 0 of each face, (m, 4, 3) and (m, 4): two of bending, then two of shear; None with crushing.

        Dry: N ∓ m, μN ∓ V. Inner: N + σtA ∓ 3m, τA ∓ V: every coefficient is a number given or a small integer.
        """
        if np.isfinite(np.where(labels, self.crush_dry, self.crush_inner)).any():
            return None
        rows, constants = np.zeros((len(labels), 4, 3)), np.zeros((len(labels), 4))
        rows[:, :2, 0] = 1.0
        rows[:, 1, 2] = np.where(labels, 1.0, 3.0)
        rows[:, 0, 2] = -rows[:, 1, 2]
        rows[:, 2:, 0] = np.where(labels, self.friction, 0.0)[:, None]
        rows[:, 2:, 1] = (-1.0, 1.0)
        constants[:, :2] = np.where(labels, 0.0, self.tension)[:, None]
        constants[:, 2:] = np.where(labels, 0.0, self.shear)[:, None]
        return rows, constants

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
        # a resultant that a label drops is zero by construction and limits nothing
        slide = np.where(self.friction > 0.0, self.friction * n, np.inf)
        dry = np.minimum(n - n * n / self.crush_dry - m, slide - v)
        rest = np.minimum(n + self.tension, self.crush_inner - n) / 3.0 - m
        inner = np.minimum(rest, np.where(self.shear > 0.0, self.shear, np.inf) - v)
        return np.where(labels, dry, inner)

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
        slide = np.where(self.friction > 0.0, self.friction * n, np.inf)
        dry = np.where(np.isfinite(self.crush_dry), np.inf, np.minimum(n - m, slide - v))
        inner = np.where(np.isfinite(self.crush_inner), np.inf, n / 3.0 - m)
        return np.where(labels, dry, inner)

    def recession_active(self, labels: Bits) -> Bools:
        mask = self.active(labels)
        mask[~labels, 1] = False
        mask[np.isfinite(np.where(labels, self.crush_dry, self.crush_inner))] = False
        return mask

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
        if self._endless:
            return np.where(labels, 0.0, self.tension * opening + self.shear * slip)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            p = turn + self.friction * slip - opening
            q = turn / self.crush_dry
            crushed = np.where(
                p < 2.0 * q * self.crush_dry, p * p / (4.0 * q), self.crush_dry * (p - q * self.crush_dry)
            )
            dry = np.where((p <= 0.0) | np.isinf(self.crush_dry), 0.0, crushed)
            corner = 0.5 * (self.tension - self.crush_inner) * opening + (self.crush_inner + self.tension) * turn / 6.0
            bent = np.maximum(-self.crush_inner * opening, corner)
            normal = np.where(np.isinf(self.crush_inner), -np.inf, bent)
        inner = np.maximum(self.tension * opening, normal) + np.where(slip > 0.0, self.shear * slip, 0.0)
        return np.where(labels, dry, inner)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
        dry = np.where(np.isinf(self.crush_dry), opening - turn - self.friction * slip, np.inf)
        inner = np.where(np.isinf(self.crush_inner), opening - turn / 3.0, np.inf)
        return np.where(labels, dry, inner)


def planar_yield(assembly: Assembly, scaling: Scaling) -> PlanarYield:
    """Planar yield sets of all faces of an assembly, both labels, and their row pattern.

    A material the scene does not name becomes a face without strength: `require_materials` has refused the
    labellings that would need it.
    """
    unit = assembly.interfaces.area / scaling.force
    strengths = assembly.strengths
    sets = {
        "friction": np.nan_to_num(strengths.friction, nan=0.0),
        "tension": np.nan_to_num(strengths.tension, nan=0.0) * unit,
        "shear": np.nan_to_num(strengths.shear, nan=0.0) * unit,
        "crush_dry": strengths.crush_dry * unit,
        "crush_inner": strengths.crush_inner * unit,
    }
    return PlanarYield(**sets, pattern=_planar_rows(**sets))


def _planar_rows(
    friction: Floats, tension: Floats, shear: Floats, crush_dry: Floats, crush_inner: Floats
) -> RowPattern:
    """Rows per face: ±m against N, ±V against N; ±m against σc where an inner σc is given; then, where a dry σc is
    given, the cones N² ≤ N_c (N ∓ m)."""
    count = len(friction)
    every = np.arange(count)
    zero, one = np.zeros(count), np.ones(count)
    size_v = np.maximum(1.0, friction)
    size_t, size_s = np.maximum(1.0, tension / 3.0), np.maximum(1.0, shear)
    # (resultant, coefficient dry, coefficient inner) twice per row, right-hand sides dry and inner
    kinds = []
    for sign in (1.0, -1.0):
        kinds.append(
            (
                every,
                [(0, -one, -one / (3.0 * size_t)), (2, sign * one, sign / size_t)],
                zero,
                tension / (3.0 * size_t),
            )
        )
    # where a label has no shear resistance at all V is dropped from equilibrium, and its rows idle
    idle = np.where(friction > 0.0, 0.0, 1.0), np.where(shear > 0.0, shear / size_s, 1.0)
    for sign in (1.0, -1.0):
        kinds.append((every, [(0, -friction / size_v, zero), (1, sign / size_v, sign / size_s)], *idle))
    some = np.flatnonzero(np.isfinite(crush_inner))
    if some.size:
        size_c = np.maximum(1.0, crush_inner[some] / 3.0)
        for sign in (1.0, -1.0):
            none = np.zeros(some.size)
            rows = [(0, none, 1.0 / (3.0 * size_c)), (2, none, sign / size_c)]
            kinds.append((some, rows, np.ones(some.size), crush_inner[some] / (3.0 * size_c)))
    entries: list[tuple[Ints, Ints, Ints, Floats, Floats]] = []
    h_dry, h_inner, row_face = [], [], []
    linear = 0
    for faces, coefficients, dry, inner in kinds:
        place = linear + np.arange(len(faces))
        entries += [(place, 3 * faces + j, faces, d, i) for j, d, i in coefficients]
        h_dry.append(dry)
        h_inner.append(inner)
        row_face.append(faces)
        linear += len(faces)
    crushed = np.flatnonzero(np.isfinite(crush_dry))
    none = np.zeros(crushed.size)
    limit = crush_dry[crushed]
    size = np.maximum(1.0, limit)
    for turn, sign in enumerate((1.0, -1.0)):
        # with w = N − sign·m and c = N_c: N² ≤ c·w ⇔ ‖(2N, c − w)‖ ≤ c + w
        head = linear + 3 * (turn * crushed.size + np.arange(crushed.size))
        for offset, resultant, value in ((0, 0, -1.0), (0, 2, sign), (1, 0, -2.0), (2, 0, 1.0), (2, 2, -sign)):
            entries.append((head + offset, 3 * crushed + resultant, crushed, value / size, none))
        h_dry.append(np.column_stack([limit / size, none, limit / size]).ravel())
        h_inner.append(np.tile([1.0, 0.0, 0.0], crushed.size))
        row_face.append(np.repeat(crushed, 3))
    rows_, columns, owners, for_dry, for_inner = zip(*entries, strict=True)
    return RowPattern(
        row=np.concatenate(rows_),
        column=np.concatenate(columns),
        face=np.concatenate(owners),
        dry=np.concatenate(for_dry),
        inner=np.concatenate(for_inner),
        h_dry=np.concatenate(h_dry),
        h_inner=np.concatenate(h_inner),
        row_face=np.concatenate(row_face),
        linear=linear,
        cones=(3,) * (2 * len(crushed)),
    )
