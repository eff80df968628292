"""Nesterov–Todd scaling of products of half-lines and second-order cones of one size.

Source: Nesterov & Todd, Math. Oper. Res. 22 (1997) 1–42; Vandenberghe, The CVXOPT linear and quadratic cone program
solvers (2010), section 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Floats


@dataclass(frozen=True)
class Cones:
    """Product of `linear` half-lines and `count` second-order cones of `size` dimensions each.

    Vectors in this order.
    """

    linear: int
    count: int
    size: int

    @property
    def degree(self) -> int:
        """Barrier parameter: one per half-line and one per cone."""
        return self.linear + self.count

    def parts(self, vector: Floats) -> tuple[Floats, Floats]:
        """Split a vector into views (linear,) and (count, size)."""
        return vector[: self.linear], vector[self.linear :].reshape(self.count, self.size)

    def join(self, linear: Floats, cones: Floats) -> Floats:
        return np.concatenate([linear, cones.ravel()])

    def unit(self) -> Floats:
        """Return the identity of the Jordan product: 1 on half-lines, (1, 0, …, 0) in cones."""
        cones = np.zeros((self.count, self.size))
        cones[:, :1] = 1.0
        return self.join(np.ones(self.linear), cones)

    def product(self, u: Floats, v: Floats) -> Floats:
        """Return the Jordan product u ∘ v: u v on half-lines, (u·v, u₀v₁ + v₀u₁) in cones."""
        (ul, uc), (vl, vc) = self.parts(u), self.parts(v)
        out = uc[:, :1] * vc + vc[:, :1] * uc
        out[:, :1] = np.einsum("ij,ij->i", uc, vc)[:, None]
        return self.join(ul * vl, out)

    def quotient(self, u: Floats, v: Floats) -> Floats:
        (ul, uc), (vl, vc) = self.parts(u), self.parts(v)
        u0, u1, v0, v1 = uc[:, 0], uc[:, 1:], vc[:, 0], vc[:, 1:]
        cross = np.einsum("ij,ij->i", u1, v1)
        first = (u0 * v0 - cross) / _determinant(uc)
        rest = (v1 - first[:, None] * u1) / u0[:, None]
        return self.join(vl / ul, np.column_stack([first, rest]))

    def slack(self, vector: Floats) -> float:
        """Return the least eigenvalue of a vector: positive inside the cones, negative outside."""
        linear, cones = self.parts(vector)
        inside = cones[:, 0] - np.sqrt(np.einsum("ij,ij->i", cones[:, 1:], cones[:, 1:]))
        return float(min(linear.min(initial=np.inf), inside.min(initial=np.inf)))

    def step(self, vector: Floats, direction: Floats) -> float:
        """Return the step length α ≤ 1e10 to the boundary of the cones, from a vector inside."""
        # α is the largest number for which vector + α·direction lies in the cones.
        (vl, vc), (dl, dc) = self.parts(vector), self.parts(direction)
        ratio = 1e-10
        if self.linear:
            ratio = max(ratio, float((-dl / vl).max()))
        if self.count:
            # In the frame of the vector the least eigenvalue of the direction limits the step.
            root = np.sqrt(_determinant(vc))
            v0, v1 = vc[:, 0] / root, vc[:, 1:] / root[:, None]
            first = (v0 * dc[:, 0] - np.einsum("ij,ij->i", v1, dc[:, 1:])) / root
            tail = dc[:, 1:] / root[:, None] - ((first + dc[:, 0] / root) / (v0 + 1.0))[:, None] * v1
            ratio = max(ratio, float((np.sqrt(np.einsum("ij,ij->i", tail, tail)) - first).max()))
        return 1.0 / ratio


def _determinant(cones: Floats) -> Floats:
    """Return v₀² − ‖v₁‖² of each cone (k, size), as a product that keeps digits near the boundary."""
    norm = np.sqrt(np.einsum("ij,ij->i", cones[:, 1:], cones[:, 1:]))
    return np.asarray(np.maximum((cones[:, 0] - norm) * (cones[:, 0] + norm), 1e-300))


class NesterovTodd:
    """Scaling W of the cones at slack s and multiplier z inside them: symmetric, with W z = W⁻¹ s = `point`."""

    def __init__(self, cones: Cones, s: Floats, z: Floats) -> None:
        self.cones = cones
        (sl, sc), (zl, zc) = cones.parts(s), cones.parts(z)
        self.linear = np.sqrt(sl / zl)
        s_root, z_root = np.sqrt(_determinant(sc)), np.sqrt(_determinant(zc))
        s_bar, z_bar = sc / s_root[:, None], zc / z_root[:, None]
        gamma = np.sqrt(0.5 * (1.0 + np.einsum("ij,ij->i", s_bar, z_bar)))
        w = s_bar - z_bar
        w[:, 0] += 2.0 * z_bar[:, 0]
        w /= 2.0 * gamma[:, None]
        eta = np.sqrt(s_root / z_root)
        self.blocks = _blocks(w) * eta[:, None, None]
        w[:, 1:] *= -1.0
        self.inverse = _blocks(w) / eta[:, None, None]
        self.point = self.times(z)

    def times(self, vector: Floats) -> Floats:
        linear, cones = self.cones.parts(vector)
        return self.cones.join(self.linear * linear, np.einsum("nij,nj->ni", self.blocks, cones))

    def divide(self, vector: Floats) -> Floats:
        linear, cones = self.cones.parts(vector)
        return self.cones.join(linear / self.linear, np.einsum("nij,nj->ni", self.inverse, cones))


def _blocks(w: Floats) -> Floats:
    """Return the symmetric square-root matrices (k, size, size) of unit vectors w (k, size)."""
    # The matrices are [w₀, w₁ᵀ; w₁, I + w₁ w₁ᵀ / (1 + w₀)], where w₀² − ‖w₁‖² = 1.
    count, size = w.shape
    blocks = np.zeros((count, size, size))
    if size:
        first = np.sqrt(1.0 + np.einsum("ij,ij->i", w[:, 1:], w[:, 1:]))
        blocks[:, 0, 0] = first
        blocks[:, 0, 1:] = blocks[:, 1:, 0] = w[:, 1:]
        blocks[:, 1:, 1:] = np.eye(size - 1)
        blocks[:, 1:, 1:] += w[:, 1:, None] * (w[:, None, 1:] / (1.0 + first)[:, None, None])
    return blocks
