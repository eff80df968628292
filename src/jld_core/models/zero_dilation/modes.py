"""Planar collapse without dilation as one complementarity problem, scaled.

    A F + b + λ b_λ = 0,   y = C F + d            four rows a face: N ∓ m, μN ∓ V; inner N + σtA ∓ 3m, τA ∓ V
    b_λ·u = 1,             z = H (u, t)           four modes a face: hinge either way, slide either way

with y ≥ 0, z ≥ 0, y_k z_k = 0. An opening is both hinges at once, and sliding does not open a face, docs/method.md
(4.5) and (4.6). With the jumps (δ, s, θ) = Aᵀu, the hinge modes are z = βδ ∓ θ (β = 1 dry, 3 inner) and the slides are
t and t + s with t ≥ 0. Modes may be scaled arbitrarily, so these formulas hold exactly in the numbers of A. In every
solution a face slides one way at most: t = max(0, −s).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.models.zero_dilation.loops import loops_of
from jld_core.program import Template


@dataclass(frozen=True)
class LinearModes:
    """Complementarity problem of one labelling with linear yield rows, in the plane or in space.

    Crushing is excluded. matrix: A (·, q) of q resultants. dead: b. live_rate: (w,) b_λ·u of (u, further velocities).
    rows, constants: C (k, q), d (k,), with y = C F + d. rates: of modes, one per row. capacities: (m, q + 2) friction
    capacity μN or shear capacity τA as forms of (F, λ, 1). adjacent: (m, m) True for faces that meet at an element, and
    on the diagonal.
    """

    matrix: Floats
    dead: Floats
    live_rate: Floats
    rows: Floats
    constants: Floats
    rates: Floats
    capacities: Floats
    adjacent: Bools

    @property
    def faces(self) -> int:
        """Return the number of faces m."""
        return len(self.adjacent)

    @property
    def live(self) -> Floats:
        """Return the scaled live load b_λ."""
        return self.live_rate[: len(self.dead)]

    @property
    def statics(self) -> Floats:
        """Return the equilibrium matrix K (·, q + 2), with K (F, λ, 1) = 0 for forces F."""
        return np.column_stack([self.matrix, self.live, self.dead])

    @property
    def slacks(self) -> Floats:
        """Return the matrix (k, q + 2) that maps (F, λ, 1) to the slacks of the yield rows."""
        return np.column_stack([self.rows, np.zeros(len(self.rows)), self.constants])


@dataclass(frozen=True)
class Modes(LinearModes):
    """Complementarity problem of a planar labelling.

    A is (3n, 3m), C is (4m, 3m), and rates are H (4m, 3n + m). Mode 4f + j belongs to face f.
    """

    assembly: Assembly

    @cached_property
    def loops(self) -> Floats:
        """Return sums of mode rates that are ≥ 0 in every solution, as coefficients (2e, 4m).

        See `loops_of`.
        """
        return loops_of(self.assembly, self.rates)

    @cached_property
    def forms(self) -> Floats:
        """Return the forms of velocities (4m + 2e, 3n + m) that are ≥ 0 in every solution.

        They are the mode rates z, then the sums around loops.
        """
        return np.vstack([self.rates, self.loops @ self.rates])

    @property
    def hinges(self) -> Bools:
        """Return a mask (4m,), True for hinge modes, False for slides."""
        return np.arange(len(self.rows)) % 4 < 2

    @property
    def near_pairs(self) -> Bools:
        """Return a mask (4m, 4m + 2e) of the slacks and forms whose faces are near each other.

        Two faces are near if they meet at an element, or if some face meets both of them. Forms are those of `forms`.
        """
        near = self.adjacent.astype(int)
        used = np.vstack([np.eye(len(self.rows)), self.loops]).reshape(-1, self.faces, 4).any(axis=2)
        return np.repeat((near @ near @ used.T) > 0, 4, axis=0)

    def slacks_of(self, forces: Floats) -> Floats:
        """Return the slacks y (4m,) of the yield rows under scaled forces (3m,)."""
        return np.asarray(self.rows @ forces + self.constants)


def modes_of(template: Template, labels: Bits) -> Modes | None:
    """Build the complementarity problem of a planar labelling.

    labels: (m,) True = dry. The result is None for spatial assemblies and with crushing.
    """
    facets = template.yield_set.associative.facets(labels)
    if facets is None:
        return None
    of_face, constants = facets
    count = len(labels)
    matrix = np.asarray(template.matrix.toarray())
    rows = np.zeros((count, 4, count, 3))
    rows[np.arange(count), :, np.arange(count)] = of_face
    jumps = matrix.T.reshape(count, 3, -1)
    beta = of_face[:, 1, 2][:, None]
    rates = np.zeros((count, 4, matrix.shape[0] + count))
    rates[:, 0, : matrix.shape[0]] = beta * jumps[:, 0] - jumps[:, 2]
    rates[:, 1, : matrix.shape[0]] = beta * jumps[:, 0] + jumps[:, 2]
    rates[:, 3, : matrix.shape[0]] = jumps[:, 1]
    rates[np.arange(count), 2, matrix.shape[0] + np.arange(count)] = 1.0
    rates[np.arange(count), 3, matrix.shape[0] + np.arange(count)] = 1.0
    slides = np.zeros((count, 2, 3 * count + 2))
    slides[:, :, :-2], slides[:, :, -1] = rows[:, 2:].reshape(count, 2, -1), constants[:, 2:]
    rates = rates.reshape(4 * count, -1)
    return Modes(
        matrix=matrix,
        dead=template.dead,
        live_rate=np.concatenate([template.live, np.zeros(count)]),
        rows=rows.reshape(4 * count, 3 * count),
        constants=constants.ravel(),
        rates=rates,
        capacities=0.5 * (slides[:, 0] + slides[:, 1]),
        adjacent=adjacent_faces(template.assembly),
        assembly=template.assembly,
    )


def adjacent_faces(assembly: Assembly) -> Bools:
    """Return a mask (m, m) of faces that meet at an element; each face meets itself."""
    faces, near = assembly.interfaces, np.eye(len(assembly.interfaces), dtype=bool)
    for element in range(len(assembly.elements)):
        own = (faces.a == element) | (faces.b == element)
        near |= np.outer(own, own)
    return near
