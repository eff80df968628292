"""Spatial collapse without dilation, relaxed to products of linear forms, scaled.

A solution consists of forces F and λ, and velocities u. Each face has weights z of its bending rows and a rate of slip
t, with

    A F + b + λ b_λ = 0,   b_λ·u = 1,   J = Aᵀu = (δ, s, θ, ω)
    y_e = N + σtA − c_e·m ≥ 0,   (δ, θ) = Σ_e z_e (1, −c_e),   z_e ≥ 0,   y_e z_e = 0          one e per row of bending
    |V| ≤ R, |mT| ≤ T, R + T = C = μN (inner: τA),   t ≥ |s|, t ≥ |ω|                         each face with friction
    R t + V·s = 0,   R s + t V = 0,   V × s = 0,   (T ∓ mT)(t ∓ ω) = 0

(δ, θ) opens over edges where the resultant acts. V opposes s with all friction that the torsion T = |mT| leaves, ω
opposes torsion, and sliding does not open a face. The equations that couple friction and slip are linear in products
and are kept: both products of two complementary vectors (R, V) and (t, s) of one cone vanish. Only the two circles are
replaced by circumscribed polygons, with unit directions d and e:

    R − d·V ≥ 0,   T ∓ mT ≥ 0,   t − e·s ≥ 0,   t ∓ ω ≥ 0

Every solution satisfies these conditions, so a bound on everything that satisfies them bounds the solutions. The
relaxation may underestimate the dissipation: R t may be less than R |s| where states and motions are combined. It is
exact for slips along one of the directions. Directions may be added at any time.

Source: docs/method.md (4.9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Floats, Ints
from jld_core.mechanics.yield_spatial import SpatialYield
from jld_core.models.zero_dilation.modes import LinearModes, adjacent_faces
from jld_core.program import Template

AXES: Final = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
"""Directions that every face has; they bound |V1| and |V2|."""

_Entries = list[tuple[int, int, float]]
"""Entries of one bilinear form: state, motion, number."""

_DIGITS: Final = 2.0**50
"""Denominator, 2 to the number of binary places, to which directions are rounded."""

_SAME: Final = 1e-4
"""Angle in radians within which two directions count as the same."""


@dataclass(frozen=True)
class Forms:
    """Bilinear forms Σ number · Φ_state · J_motion, as sparse entries.

    count: number of forms. which: the form to which each entry belongs.
    """

    count: int
    which: Ints
    state: Ints
    motion: Ints
    number: Floats

    def table(self, form: int, shape: tuple[int, int]) -> Any:
        """Return one form as a sparse matrix."""
        own = self.which == form
        return sp.csr_array((self.number[own], (self.state[own], self.motion[own])), shape=shape)


@dataclass(frozen=True)
class Way:
    """Restriction of a face to slip in one sense: sign · (s1, s2 or ω) ≥ 0.

    The friction opposed to this slip then has the opposite sign or is zero. component: 0, 1, 2 for s1, s2, ω. Every
    solution satisfies the restriction for one sign or the other.
    """

    face: int
    component: int
    sign: float


@dataclass(frozen=True)
class SpaceModes(LinearModes):
    """Relaxed problem of a spatial labelling, with polygons instead of circles.

    matrix: A (6n, q) of the resultants that are not identically zero, then zero columns of every T, which also counts
    as a resultant. rows: bending of all faces first, then friction. motions: (j, w) J of w = (u, z, t): the jumps of
    those resultants, then z, then t. rates: (l, j) forms of J that are ≥ 0, bending modes z first, then slides. ties:
    (e, j) forms of J that are zero. coupled: forms in (F, λ, 1) and J that are zero. cost: one form. bending: number of
    bending rows; each has the mode of the same number. opposed: (p, 2) rows and rates whose product is zero. face:
    (k,) face of each row. mode_face: (l,) face of each rate. columns: (m, 6) columns of the resultants, −1 if absent.
    extent: (m,) largest |m_i| for N + σtA = 1. tension: (m,) σtA. share: (m,) column of T, −1 if absent. slip: (m,)
    place of t in J, −1 if absent. directions: of the friction forces of each face.
    """

    motions: Floats
    ties: Floats
    coupled: Forms
    cost: Forms
    bending: int
    opposed: Ints
    face: Ints
    mode_face: Ints
    columns: Ints
    extent: Floats
    tension: Floats
    share: Ints
    slip: Ints
    directions: tuple[Floats, ...]


def space_modes_of(
    template: Template,
    labels: Bits,
    directions: tuple[Floats, ...] | None = None,
    ways: tuple[Way, ...] = (),
    slides: tuple[Floats, ...] | None = None,
) -> SpaceModes | None:
    """Build the relaxed problem of a spatial labelling, or return None.

    None for planar scenes, crushing and frozen areas, which have no linear rows. directions: of the friction forces of
    each face, (k, 2), |d| ≤ 1, including `AXES`; default: only these. slides: of slips; default: the same. ways:
    restrictions of slip.
    """
    sets = template.yield_set
    if not isinstance(sets, SpatialYield):
        return None
    dry = sets.is_dry(labels)
    if np.isfinite(np.where(dry, sets.crush_dry, sets.crush_inner)).any():
        return None
    directions = directions or (AXES,) * len(labels)
    return _Sheet(template, sets, labels, directions, slides or directions).modes(ways)


class _Sheet:
    """Builder of rows, rates, ties and forms, face by face."""

    def __init__(
        self,
        template: Template,
        sets: SpatialYield,
        labels: Bits,
        directions: tuple[Floats, ...],
        slides: tuple[Floats, ...],
    ) -> None:
        self.template, self.sets, self.labels = template, sets, labels
        self.directions, self.slides = directions, slides
        active = sets.active(labels)
        self.kept = np.flatnonzero(active.ravel())
        columns = np.full(active.size, -1, dtype=np.int64)
        columns[self.kept] = np.arange(len(self.kept))
        self.columns = columns.reshape(active.shape)
        self.dry = sets.is_dry(labels)
        self.of_face = sets.bending.face
        self.rubs = np.flatnonzero(self.columns[:, 1] >= 0)
        turns = self.rubs[self.columns[self.rubs, 5] >= 0]
        self.count, bends = len(self.kept) + len(turns), len(self.of_face)
        self.share, self.slip = np.full((2, len(labels)), -1, dtype=np.int64)
        self.share[turns] = len(self.kept) + np.arange(len(turns))
        q = self.count
        self.slip[self.rubs] = q + bends + np.arange(len(self.rubs))
        self.width = q + bends + len(self.rubs)
        self.coupled: list[_Entries] = []
        self.costs: _Entries = []

    def modes(self, ways: tuple[Way, ...]) -> SpaceModes:
        """Build the problem with given restrictions of slip."""
        sets, q, template = self.sets, self.count, self.template
        corner = np.where(self.dry[self.of_face, None], sets.bending.dry, sets.bending.inner)
        tension = np.where(self.dry, 0.0, sets.tension)
        rows, constants, ties = self._bending(corner, tension)
        capacity = np.zeros((len(self.labels), q + 2))
        capacity[self.rubs, self.columns[self.rubs, 0]] = sets.friction_of(self.labels)[self.rubs]
        capacity[:, -1] = sets.cohesion_of(self.labels)
        rates, owners, faces = list(np.eye(self.width)[q : q + len(rows)]), list(self.of_face), list(self.of_face)
        more: list[Floats] = []
        opposed = [(row, row) for row in range(len(rows))]
        for face in self.rubs.tolist():
            above, slides = self._friction(face, capacity[face])
            if self.share[face] >= 0:
                opposed += [(len(rows) + len(more) + len(above) - k, len(rates) + len(slides) - k) for k in (2, 1)]
            more += above
            rates += slides
            owners += [face] * len(above)
            faces += [face] * len(slides)
            self._couple(face, capacity[face])
        for way in ways:
            column = int(self.columns[way.face, (1, 2, 5)[way.component]])
            against, rate = np.zeros(q + 2), np.zeros(self.width)
            against[column], rate[column] = -way.sign, way.sign
            more.append(against)
            rates.append(rate)
            owners.append(way.face)
            faces.append(way.face)
        for row in range(len(rows)):
            self.costs.append((q + 1, q + row, 1.0))
        friction = np.array(more).reshape(len(more), q + 2)
        matrix = np.zeros((template.matrix.shape[0], q))
        matrix[:, : len(self.kept)] = template.matrix.toarray()[:, self.kept]
        extra = self.width - q
        motions = np.block([[matrix.T, np.zeros((q, extra))], [np.zeros((extra, matrix.shape[0])), np.eye(extra)]])
        corners = np.where(self.dry[self.of_face, None], sets.bending.dry_corners, sets.bending.inner_corners)
        extent = np.zeros(len(self.labels))
        np.maximum.at(extent, self.of_face, np.where(sets.point[self.of_face], 0.0, abs(corners).max(axis=1)))
        return SpaceModes(
            matrix=matrix,
            dead=template.dead,
            live_rate=np.concatenate([template.live, np.zeros(motions.shape[1] - len(template.live))]),
            rows=np.vstack([rows, friction[:, :q]]),
            constants=np.concatenate([constants, friction[:, -1]]),
            motions=motions,
            rates=np.array(rates),
            ties=ties,
            coupled=_forms(self.coupled),
            cost=_forms([self.costs]),
            bending=len(rows),
            opposed=np.array(opposed, dtype=np.int64),
            face=np.array(owners, dtype=np.int64),
            mode_face=np.array(faces, dtype=np.int64),
            columns=self.columns,
            extent=extent,
            tension=tension,
            capacities=capacity,
            share=self.share,
            slip=self.slip,
            directions=self.directions,
            adjacent=adjacent_faces(template.assembly),
        )

    def _bending(self, corner: Floats, tension: Floats) -> tuple[Floats, Floats, Floats]:
        """Return rows N + σtA − c·m, their constants, and ties (δ, θ) − Σ z (1, −c) = 0."""
        q = self.count
        rows, ties = np.zeros((len(corner), q)), list[Floats]()
        for face in range(len(self.labels)):
            own = np.flatnonzero(self.of_face == face)
            n, one, two = self.columns[face, [0, 3, 4]]
            rows[own, n] = 1.0
            tie = np.zeros(self.width)
            tie[n], tie[q + own] = 1.0, -1.0
            ties.append(tie)
            for k, moment in enumerate((one, two)):
                if moment >= 0:
                    rows[own, moment] = -corner[own, k]
                    tie = np.zeros(self.width)
                    tie[moment], tie[q + own] = 1.0, corner[own, k]
                    ties.append(tie)
        return rows, tension[self.of_face], np.array(ties)

    def _friction(self, face: int, capacity: Floats) -> tuple[list[Floats], list[Floats]]:
        """Return rows C − T − d·V, T ∓ mT of (F, λ, 1), and rates t − d·s, t ∓ ω of J."""
        one, two, twist = self.columns[face, [1, 2, 5]]
        share, rows, rates = self.share[face], [], []
        for d in self.directions[face]:
            row = capacity.copy()
            row[one], row[two] = -d[0], -d[1]
            if twist >= 0:
                row[share] = -1.0
            rows.append(row)
        for d in self.slides[face]:
            rate = np.zeros(self.width)
            rate[self.slip[face]], rate[one], rate[two] = 1.0, -d[0], -d[1]
            rates.append(rate)
        for sign in (1.0, -1.0) if twist >= 0 else ():
            row, rate = np.zeros(len(capacity)), np.zeros(self.width)
            row[share], row[twist] = 1.0, -sign
            rate[self.slip[face]], rate[twist] = 1.0, -sign
            rows.append(row)
            rates.append(rate)
        return rows, rates

    def _couple(self, face: int, capacity: Floats) -> None:
        """Append the forms that couple friction and slip on a face, and its cost C t."""
        one, two, twist = (int(c) for c in self.columns[face, [1, 2, 5]])
        t, share = int(self.slip[face]), int(self.share[face])
        whole = [(state, float(capacity[state])) for state in np.flatnonzero(capacity).tolist()]
        rest = [*whole, (share, -1.0)] if twist >= 0 else whole
        self.costs += [(state, t, number) for state, number in whole]
        self.coupled.append([*((state, t, number) for state, number in rest), (one, one, 1.0), (two, two, 1.0)])
        for column in (one, two):
            self.coupled.append([*((state, column, number) for state, number in rest), (column, t, 1.0)])
        self.coupled.append([(one, two, 1.0), (two, one, -1.0)])


def _forms(entries: list[_Entries]) -> Forms:
    """Collect entries of several forms as arrays."""
    flat = [(which, *entry) for which, own in enumerate(entries) for entry in own]
    which, state, motion = (np.array([e[k] for e in flat], dtype=np.int64) for k in range(3))
    return Forms(len(entries), which, state, motion, np.array([e[3] for e in flat], dtype=np.float64))


def unit_direction(way: Floats) -> Floats:
    """Normalise a direction (2,); its length, computed exactly from the floats, is at most 1 and nearly 1."""
    return np.asarray(np.trunc(way / np.hypot(*way) * _DIGITS) / _DIGITS * (1.0 - 4.0 / _DIGITS))


def with_direction(directions: Floats, way: Floats) -> Floats:
    """Return directions with one more (2,), unless it exists already."""
    d = unit_direction(way)
    return directions if float((directions @ d).max()) >= np.cos(_SAME) else np.vstack([directions, d])


def widest(directions: Floats) -> float:
    """Return the largest angle between neighbouring directions."""
    angles = np.sort(np.arctan2(directions[:, 1], directions[:, 0]))
    return float(np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).max())
