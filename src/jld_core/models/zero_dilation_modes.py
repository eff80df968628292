"""Planar collapse without dilation as one complementarity problem, scaled: y ≥ 0, z ≥ 0, y_k z_k = 0.

    A F + b + λ b_λ = 0,   y = C F + d            four rows a face: N ∓ m, μN ∓ V; inner N + σtA ∓ 3m, τA ∓ V
    b_λ·u = 1,             z = H (u, t)           four modes a face: hinge either way, slide either way

An opening is both hinges at once, and sliding opens nothing, docs/method.md (4.5) and (4.6): with the jumps
(δ, s, θ) = Aᵀu the hinge modes are z = βδ ∓ θ (β = 1 dry, 3 inner) and the slides t and t + s with t ≥ 0. Modes may be
scaled at will, so these hold exactly in the numbers of A. Every solution is one whose face slides one way at most,
t = max(0, −s).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.program import Template


@dataclass(frozen=True)
class Modes:
    """One labelling of one planar assembly, nothing of it crushing.

    matrix: A (3n, 3m). dead, live: b, b_λ (3n,). rows, constants: C (4m, 3m), d (4m,). rates: H (4m, 3n + m).
    near: (m, m) faces that meet at an element, themselves included. Mode 4f + j belongs to face f.
    """

    matrix: Floats
    dead: Floats
    live: Floats
    rows: Floats
    constants: Floats
    rates: Floats
    near: Bools

    @property
    def faces(self) -> int:
        """m"""
        return int(self.matrix.shape[1] // 3)

    @property
    def hinges(self) -> Bools:
        """(4m,) True for hinge modes, False for slides."""
        return np.arange(len(self.rows)) % 4 < 2

    @property
    def statics(self) -> Floats:
        """K (3n, 3m + 2): K (F, λ, 1) = 0 is equilibrium."""
        return np.column_stack([self.matrix, self.live, self.dead])

    @property
    def slacks(self) -> Floats:
        """(4m, 3m + 2): y of (F, λ, 1)."""
        return np.column_stack([self.rows, np.zeros(len(self.rows)), self.constants])

    @property
    def capacities(self) -> Floats:
        """(m, 3m + 2): what friction μN or shear strength τA carries, of (F, λ, 1)."""
        slacks = self.slacks
        return np.asarray(0.5 * (slacks[2::4] + slacks[3::4]))

    @property
    def live_rate(self) -> Floats:
        """(3n + m,): b_λ·u of (u, t)."""
        return np.concatenate([self.live, np.zeros(self.faces)])

    def of(self, forces: Floats) -> Floats:
        """y (4m,) of scaled forces (3m,)."""
        return np.asarray(self.rows @ forces + self.constants)


def modes_of(template: Template, labels: Bits) -> Modes | None:
    """The complementarity problem of a labelling; None where it is not one of linear rows (spatial, crushing)."""
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
    faces, near = template.assembly.interfaces, np.eye(count, dtype=bool)
    for element in range(len(template.assembly.elements)):
        own = (faces.a == element) | (faces.b == element)
        near |= np.outer(own, own)
    return Modes(
        matrix=matrix,
        dead=template.dead,
        live=template.live,
        rows=rows.reshape(4 * count, 3 * count),
        constants=constants.ravel(),
        rates=rates.reshape(4 * count, -1),
        near=near,
    )
