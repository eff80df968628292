"""Planar yield sets in scaled resultants: rows for solvers, functions for proofs.

A scaled planar resultant is (N, V, m) with m = M / (l/2). Every row is of order one whatever the strengths. Both labels
of a face share one sparsity pattern, so that relabelling changes only numbers. A row that a label does not use keeps
its place with zero coefficients and slack one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.mechanics.bending import Frictional, scaled_strengths
from jld_core.mechanics.hull import hull_rows, parabolic_hull
from jld_core.mechanics.scaling import Scaling
from jld_core.mechanics.yield_set import CoulombWedge, Hull, ParabolicBending, RowPattern, Rows, used
from jld_core.strengths import Route, Strengths

_ROUTE: Final = Route("the standard yield set")


@dataclass(frozen=True)
class PlanarYield(Frictional):
    """Planar yield sets of m faces, scaled by `Scaling.face`.

    Dry: |m| ≤ N(1 − N/N_c), |V| ≤ c + μN. Inner: |m| ≤ (N + σtA)/3, |m| ≤ (N_c − N)/3, |V| ≤ τA + μN, with the μ of
    inner faces. A jump has opening δ, slip s and rotation θ. With friction it dissipates c|s|, and in bending as much
    as the jump (δ − μ|s|, θ).

    `dissipation` and `margin` also take jumps (k, m, 3) of k mechanisms and then return (k, m).

    friction, cohesion: (m,) μ and c of dry faces, scaled. inner_friction, shear: (m,) μ and τA of inner faces, scaled.
    tension: (m,) σtA of inner faces, scaled. crush_dry, crush_inner: (m,) N_c = σcA of either label, scaled; inf where
    none is given. pattern: rows of the program.

    Source: Iannuzzo et al. 2024, eq. (3)–(7), as docs/method.md (2.2) to (2.10); D(J): (3.4) to (3.7).
    """

    @cached_property
    def _endless(self) -> bool:
        """Return True if no face has a compressive strength under either label."""
        return bool(
            np.isinf(self.crush_dry).all() and np.isinf(self.crush_inner).all() and np.isfinite(self.shear).all()
        )

    def active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), False where a resultant is zero in every admissible state.

        labels: (m,) True = dry.
        """
        mask = np.ones((len(labels), 3), dtype=bool)
        mask[:, 1] = self._holds(labels)
        return mask

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Return the linear yield rows C F + d ≥ 0 of each face, or None if a face can crush.

        labels: (m,) True = dry.
        """
        # C is (m, 4, 3) and d (m, 4). Dry: N ∓ m and c + μN ∓ V. Inner: N + σtA ∓ 3m and τA + μN ∓ V. Every coefficient
        # is a given number or a small integer.
        if np.isfinite(np.where(labels, self.crush_dry, self.crush_inner)).any():
            return None
        rows, constants = np.zeros((len(labels), 4, 3)), np.zeros((len(labels), 4))
        rows[:, :2, 0] = 1.0
        rows[:, 1, 2] = np.where(labels, 1.0, 3.0)
        rows[:, 0, 2] = -rows[:, 1, 2]
        rows[:, 2:, 0] = self.friction_of(labels)[:, None]
        rows[:, 2:, 1] = (-1.0, 1.0)
        constants[:, :2] = np.where(labels, 0.0, self.tension)[:, None]
        constants[:, 2:] = self.cohesion_of(labels)[:, None]
        return rows, constants

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) under labels (m,)."""
        n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
        slide, hold = self._capacity(n)
        dry = np.minimum(n - n * n / self.crush_dry - m, slide - v)
        rest = np.minimum(n + self.tension, self.crush_inner - n) / 3.0 - m
        return np.where(labels, dry, np.minimum(rest, hold - v))

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) in the recession cones.

        labels: (m,) True = dry.
        """
        n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
        slide = np.where(self.friction > 0.0, self.friction * n, np.inf)
        dry = np.where(np.isfinite(self.crush_dry), np.inf, np.minimum(n - m, slide - v))
        lean = n / 3.0 - m
        if self.has_inner_friction:
            lean = np.minimum(lean, np.where(self.inner_friction > 0.0, self.inner_friction * n, np.inf) - v)
        inner = np.where(np.isfinite(self.crush_inner), np.inf, lean)
        return np.where(labels, dry, inner)

    def recession_active(self, labels: Bits) -> Bools:
        """Return a mask (m, q), True where a resultant may be non-zero in the recession cone.

        labels: (m,) True = dry.
        """
        mask = np.ones((len(labels), 3), dtype=bool)
        mask[:, 1] = self.friction_of(labels) > 0.0
        mask[np.isfinite(np.where(labels, self.crush_dry, self.crush_inner))] = False
        return mask

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the dissipation (m,) of scaled jumps (m, q) whose `margin` is ≥ 0.

        labels: (m,) True = dry.
        """
        opening, slip, turn = jumps[..., 0], abs(jumps[..., 1]), abs(jumps[..., 2])
        cracked = opening - self.inner_friction * slip if self.has_inner_friction else opening
        cohesive: Floats | float = self.cohesion * slip if self.has_dry_cohesion else 0.0
        if self._endless:
            return np.where(labels, cohesive, self.tension * cracked + self.shear * slip)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            p = turn + self.friction * slip - opening
            q = turn / self.crush_dry
            crushed = np.where(
                p < 2.0 * q * self.crush_dry, p * p / (4.0 * q), self.crush_dry * (p - q * self.crush_dry)
            )
            dry = np.where((p <= 0.0) | np.isinf(self.crush_dry), 0.0, crushed) + cohesive
            corner = 0.5 * (self.tension - self.crush_inner) * cracked + (self.crush_inner + self.tension) * turn / 6.0
            bent = np.maximum(-self.crush_inner * cracked, corner)
            normal = np.where(np.isinf(self.crush_inner), -np.inf, bent)
        inner = np.maximum(self.tension * cracked, normal) + np.where(slip > 0.0, self.shear * slip, 0.0)
        return np.where(labels, dry, inner)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of the conditions for finite dissipation of jumps (m, q).

        labels: (m,) True = dry.
        """
        opening, slip, turn = jumps[..., 0], abs(jumps[..., 1]), abs(jumps[..., 2])
        dry = np.where(np.isinf(self.crush_dry), opening - turn - self.friction * slip, np.inf)
        cracked = opening - self.inner_friction * slip if self.has_inner_friction else opening
        inner = np.where(np.isinf(self.crush_inner), cracked - turn / 3.0, np.inf)
        return np.where(labels, dry, inner)

    def shear_of(self, forces: Floats) -> Floats:
        """Return the shear demand |V| (m,) of scaled resultants (m, q)."""
        return np.abs(forces[:, 1])

    def slip(self, jumps: Floats) -> Floats:
        """Return the shear dissipation |s| (m,) of scaled jumps (m, q), per unit of capacity."""
        return np.abs(jumps[:, 1])

    def utilisation(self, forces: Floats, labels: Bits) -> Floats:
        """Return the largest ratio (m,) of a demand to its capacity on each face, 0 to 1.

        forces: (m, q) scaled resultants. labels: (m,) True = dry.
        """
        # Demands are bending, shear, tension of inner faces and compression.
        n, v, m = forces[:, 0], abs(forces[:, 1]), abs(forces[:, 2])
        least = 1e-6 * max(float(abs(n).max(initial=0.0)), float(v.max(initial=0.0)), 1e-300)
        capacity = self.cohesion_of(labels) + self.friction_of(labels) * n
        dry = used(m, n * (1.0 - n / self.crush_dry), least)
        inner = used(3.0 * m, np.minimum(n + self.tension, self.crush_inner - n), least)
        pulled = np.where(labels, 0.0, used(-n, self.tension, least))
        pressed = used(n, np.where(labels, self.crush_dry, self.crush_inner), least)
        shares = [np.where(labels, dry, inner), used(v, capacity, least), pulled, pressed]
        return np.asarray(np.clip(np.max(shares, axis=0), 0.0, 1.0))

    def with_strengths(self, sets: Strengths) -> PlanarYield:
        """Return the yield sets of the same faces with other scaled strengths, and their rows."""
        return PlanarYield(**vars(sets), pattern=_planar_rows(sets))

    def hull(self) -> Rows:
        """Return yield rows that enclose the sets of both labels of each face, see `hull_rows`."""
        every = np.ones(len(self.friction), dtype=bool)
        either = self.active(every) | self.active(~every)
        return Hull(hull_rows(self, freedoms=3, shear=1, parabolas=True), np.asarray(either))

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        """Return the parabolic yield sets of the faces whose dry joints crush.

        undecided: False for the sets of the dry label, |m| ≤ N − N²/N_c and |V| ≤ c + μN. True for sets that contain
        the yield sets of both labels, or None if no such sets are known.
        """
        crushed = np.flatnonzero(np.isfinite(self.crush_dry))
        one = np.ones(len(crushed))
        limit = self.crush_dry[crushed]
        friction, cohesion = self.friction[crushed], self.cohesion[crushed]
        if undecided:
            return parabolic_hull(self, crushed)
        none = 0.0 * one
        size = np.maximum(np.maximum(one, friction), cohesion)
        slide = [friction / size, one / size, cohesion / size]
        rows = np.array([[one, one, none], slide, [none, none, one]]).transpose(2, 0, 1)
        # Where nothing resists shear V is dropped; its row must stay inactive.
        rows[friction + cohesion == 0.0, 1] = (0.0, 1.0, 1.0)
        return ParabolicBending(crushed, np.column_stack([1.0 / limit, none]), rows)

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        """Return the yield sets of all faces under one label as wedges; None if any face has a compressive strength.

        dry: True for the dry label.
        """
        if not (np.isinf(self.crush_dry).all() and np.isinf(self.crush_inner).all()):
            return None
        if dry:
            return CoulombWedge(np.zeros(len(self.friction)), 1.0, self.friction, self.cohesion)
        return CoulombWedge(self.tension, 3.0, self.inner_friction, self.shear)


def planar_yield(assembly: Assembly, scaling: Scaling) -> PlanarYield:
    """Make the planar yield sets of all faces of an assembly, and their row pattern."""
    sets = scaled_strengths(assembly.strengths(_ROUTE), assembly.interfaces.area / scaling.force)
    return PlanarYield(**vars(sets), pattern=_planar_rows(sets))


# Faces, two (resultant, dry coefficient, inner coefficient), dry and inner right-hand side
_Rows = tuple[Ints, list[tuple[int, Floats, Floats]], Floats, Floats]


def _planar_rows(sets: Strengths) -> RowPattern:
    """Build the rows of planar faces with scaled strengths `sets`, linear rows first."""
    # Each face has ±m against N and ±V against N; with an inner σc also ±m against σc; with a dry σc the cones N² ≤ N_c
    # (N ∓ m).
    count = len(sets.friction)
    kinds = _linear_rows(sets)
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
    crushed = np.flatnonzero(np.isfinite(sets.crush_dry))
    none = np.zeros(crushed.size)
    limit = sets.crush_dry[crushed]
    size = np.maximum(1.0, limit)
    for turn, sign in enumerate((1.0, -1.0)):
        # With w = N − sign·m and c = N_c: N² ≤ c·w ⇔ ‖(2N, c − w)‖ ≤ c + w.
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
        capacity=np.concatenate([4 * count + np.arange(count), 6 * count + np.arange(count)]),
    )


def _linear_rows(sets: Strengths) -> list[_Rows]:
    """List the families of linear yield rows of planar faces with scaled strengths `sets`."""
    # Each entry holds the faces (k,), two terms (resultant, dry coefficients, inner coefficients), and the right-hand
    # sides (k,) of dry and of inner faces.
    friction, tension, shear, cohesion = sets.friction, sets.tension, sets.shear, sets.cohesion
    crush_inner, inner_friction = sets.crush_inner, sets.inner_friction
    count = len(friction)
    every = np.arange(count)
    zero, one = np.zeros(count), np.ones(count)
    size_v = np.maximum(np.maximum(1.0, friction), cohesion)
    size_t, size_s = np.maximum(1.0, tension / 3.0), np.maximum(np.maximum(1.0, shear), inner_friction)
    kinds: list[_Rows] = []
    for sign in (1.0, -1.0):
        kinds.append(
            (
                every,
                [(0, -one, -one / (3.0 * size_t)), (2, sign * one, sign / size_t)],
                zero,
                tension / (3.0 * size_t),
            )
        )
    # Without any shear resistance V is dropped from equilibrium; right-hand side one keeps its rows inactive.
    idle = (
        np.where(friction + cohesion > 0.0, cohesion / size_v, 1.0),
        np.where(shear + inner_friction > 0.0, shear / size_s, 1.0),
    )
    for sign in (1.0, -1.0):
        normal = (0, -friction / size_v, zero - inner_friction / size_s)
        kinds.append((every, [normal, (1, sign / size_v, sign / size_s)], *idle))
    some = np.flatnonzero(np.isfinite(crush_inner))
    if some.size:
        size_c = np.maximum(1.0, crush_inner[some] / 3.0)
        for sign in (1.0, -1.0):
            none = np.zeros(some.size)
            rows = [(0, none, 1.0 / (3.0 * size_c)), (2, none, sign / size_c)]
            kinds.append((some, rows, np.ones(some.size), crush_inner[some] / (3.0 * size_c)))
    return kinds
