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
    """Complementarity problem of one labelling with linear yield rows, in plane or space.

    Wanted are forces F, λ and velocities w = (u, t), where t are rates of slip, docs/method.md (4.6): A F + b + λ b_λ =
    0, y = C F + d ≥ 0, b_λ·u = 1, z = H w ≥ 0, and y_k z_k = 0. A row y is the slack of a yield condition, and its mode
    z the rate of a hinge or a slide. Crushing is excluded. There are q resultants, k rows, m faces. All values are
    scaled.

    matrix: (equations, q) a. dead: (equations,) b. live_rate: (w,) coefficients of b_λ·u in w. rows, constants: (k, q)
    c and d. rates: (k, w) h. capacities: (m, q + 2) shear capacity of each face, μN or τA, as a linear form of (F, λ,
    1). adjacent: (m, m) True for faces that meet at an element, and on the diagonal.
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
        """Return the scaled live load b_λ (equations,)."""
        return self.live_rate[: len(self.dead)]

    @property
    def statics(self) -> Floats:
        """Return the equilibrium matrix K (equations, q + 2), with K (F, λ, 1) = 0."""
        return np.column_stack([self.matrix, self.live, self.dead])

    @property
    def slacks(self) -> Floats:
        """Return the matrix (k, q + 2) that maps (F, λ, 1) to the slacks of the yield rows."""
        return np.column_stack([self.rows, np.zeros(len(self.rows)), self.constants])


@dataclass(frozen=True)
class Modes(LinearModes):
    """Complementarity problem of a planar labelling: four yield rows and modes per face.

    Mode 4f + j belongs to face f. j = 0, 1: hinges βδ ∓ θ, with β = 1 for dry and 3 for inner faces. j = 2, 3: slides t
    and t + s. With n free elements, A is (3n, 3m), C is (4m, 3m), and H is (4m, 3n + m).
    """

    assembly: Assembly

    @cached_property
    def loops(self) -> Floats:
        """Return coefficients (2e, 4m) of the sums of mode rates around loops of blocks.

        The sums are ≥ 0 in every solution. There are two for each of e slides that a loop bounds, see `loops_of`.
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
        """Return a mask (4m, 4m + 2e) of the yield rows and forms whose faces are near each other.

        Two faces are near if they meet at an element, or if some face meets both of them. Forms are those of `forms`. A
        program with these products only is smaller than one with all of them.
        """
        near = self.adjacent.astype(int)
        used = np.vstack([np.eye(len(self.rows)), self.loops]).reshape(-1, self.faces, 4).any(axis=2)
        return np.repeat((near @ near @ used.T) > 0, 4, axis=0)

    def slacks_of(self, forces: Floats) -> Floats:
        """Return the slacks y (4m,) of the yield rows under scaled forces (3m,)."""
        return np.asarray(self.rows @ forces + self.constants)


def modes_of(template: Template, labels: Bits) -> Modes | None:
    """Build the complementarity problem of a planar labelling.

    template: of the assembly. labels: (m,) True = dry. The result is None for spatial assemblies, and for labels under
    which a face may crush.
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
