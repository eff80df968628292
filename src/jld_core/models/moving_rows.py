"""Solver rows whose torsion coefficients follow the effective areas of the forces, with their derivatives.

In the rows t ± ρ (mT + a·V) ≤ μN of dry rectangles, ρ, ρ a1 and ρ a2 are functions of N, m1 and m2 of the same face.
The rows are linear in these three parameters. Source: docs/method.md (2.14) to (2.18).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.geometry.outlines import rectangle_torsion_length
from jld_core.mechanics.prescribed_friction import EffectiveAreas, PrescribedFriction
from jld_core.program import Template

_FAINT = 1e-5  # scaled N below which x tends to zero: M / N is computed as M N / (N² + _FAINT²)

_NARROW = 1e-6  # least side of an effective rectangle, relative to the side of the face

_OWN = (0, 3, 4)  # resultants on which the effective area of a face depends: N, m1, m2

# Resultants whose coefficients depend on the effective area: mT, V1, V2, in the order of the parameters
_TWISTING = (5, 1, 2)


def areas_under(assembly: Assembly, forces: Floats, labels: Bits) -> EffectiveAreas:
    """Compute the torsion factors of the effective areas of faces under given forces.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    forces : (m, 6) array
        Scaled forces N, V1, V2, M1, M2, MT.
    labels : (m,) array of bool
        True = dry.

    Returns
    -------
    EffectiveAreas
        Ratio (m,) = c_T / c_T,e: torsion length of the whole face over that of its effective rectangle. Arm (m, 2) =
        (x2, −x1) / c_T, with centre of pressure x. Inner faces, faces without normal force and faces that are not
        rectangles have ratio 1 and arm 0.
    """
    # Source: docs/method.md (2.14), (2.15).
    faces = assembly.interfaces
    labels = labels & faces.rectangle
    # M1 is scaled by l2 / 2 and M2 by l1 / 2, so x1 and x2 below are relative to l1 / 2 and l2 / 2.
    share = np.where(labels, forces[:, 0] / (forces[:, 0] ** 2 + _FAINT**2), 0.0)
    x1 = np.clip(-forces[:, 4] * share, -1.0, 1.0)
    x2 = np.clip(forces[:, 3] * share, -1.0, 1.0)
    side1 = faces.l1 * np.maximum(1.0 - np.abs(x1), _NARROW)
    side2 = faces.l2 * np.maximum(1.0 - np.abs(x2), _NARROW)
    ratio = np.where(labels, faces.c_t / rectangle_torsion_length(side1, side2), 1.0)
    arm = np.column_stack([0.5 * faces.l2 * x2, -0.5 * faces.l1 * x1]) / faces.c_t[:, None]
    return EffectiveAreas(ratio, arm)


def area_derivatives(assembly: Assembly, forces: Floats, labels: Bits) -> tuple[Floats, Floats]:
    """Differentiate the areas by N, m1, m2 of forces (m, 6): c_T / c_T,e (m, 3) and x / c_T (m, 2, 3).

    Mean at kinks.
    """
    faces = assembly.interfaces
    labels = labels & faces.rectangle
    normal = forces[:, 0]
    square = normal**2 + _FAINT**2
    share = np.where(labels, normal / square, 0.0)
    slope = np.where(labels, (_FAINT**2 - normal**2) / square**2, 0.0)
    none = np.zeros(len(normal))
    x1, x2 = -forces[:, 4] * share, forces[:, 3] * share
    of_x1 = np.column_stack([-forces[:, 4] * slope, none, -share]) * (np.abs(x1) < 1.0)[:, None]
    of_x2 = np.column_stack([forces[:, 3] * slope, share, none]) * (np.abs(x2) < 1.0)[:, None]
    room1, room2 = 1.0 - np.abs(x1), 1.0 - np.abs(x2)
    side1, side2 = faces.l1 * np.maximum(room1, _NARROW), faces.l2 * np.maximum(room2, _NARROW)
    ratio = faces.c_t / rectangle_torsion_length(side1, side2)
    along1 = -np.sign(x1) * faces.l1 * (room1 > _NARROW) * _torsion_length_slope(side1, side2)
    along2 = -np.sign(x2) * faces.l2 * (room2 > _NARROW) * _torsion_length_slope(side2, side1)
    of_length = along1[:, None] * of_x1 + along2[:, None] * of_x2
    of_ratio = -(ratio**2 / faces.c_t)[:, None] * of_length
    scale1, scale2 = (0.5 * faces.l1 / faces.c_t)[:, None], (0.5 * faces.l2 / faces.c_t)[:, None]
    return np.where(labels[:, None], of_ratio, 0.0), np.stack([scale2 * of_x2, -scale1 * of_x1], axis=1)


def _torsion_length_slope(one: Floats, other: Floats) -> Floats:
    """Return the derivative (n,) of the torsion length c_T of rectangles by side `one`."""
    diagonal = np.hypot(one, other)
    ends = one / (6.0 * other) * np.arcsinh(other / one) - other**2 / (12.0 * one**2) * np.arcsinh(one / other)
    return np.asarray(one / (12.0 * diagonal) + other**2 / (12.0 * one * diagonal) + ends)


def frozen_areas(template: Template, areas: EffectiveAreas) -> Template:
    """Build the template of associative friction with torsion about given effective areas."""
    base = template.yield_set.associative
    none = np.zeros(len(template.assembly.interfaces))
    return template.renumbered(PrescribedFriction(base, 1.0, none, areas))


class MovingRows:
    """Program min q·y, E y = e, G(y) y + s = r, s in a cone, whose torsion rows follow the effective areas.

    G depends on y through ρ, ρ a1, ρ a2 of each dry rectangle, see `EffectiveAreas`. rows: G of whole faces. linear:
    number of linear rows, before cones of size three. face: (rows,); 0 for the row λ ≥ −c. torsion: (k,) rows that
    depend on the areas.
    """

    def __init__(self, template: Template, labels: Bits) -> None:
        self.assembly, self.labels = template.assembly, labels
        count = len(labels)
        frozen = frozen_areas(template, EffectiveAreas(np.ones(count), np.zeros((count, 2))))
        program = frozen.program(labels)
        structure, first = program.structure, program.structure.equalities
        matrix = self._matrix(template, labels, 1.0, (0.0, 0.0))
        self.objective = program.objective
        self.balance, self.load = matrix[:first], program.rhs[:first]
        self.rows, self.rhs = matrix[first:], program.rhs[first:]
        self.linear = structure.linear
        self.face = np.concatenate([[0], frozen.yield_set.pattern.row_face])
        # Halving ρ doubles what the rows are divided by: only torsion rows of dry faces show a difference.
        halved = self._matrix(template, labels, 0.5, (0.0, 0.0))[first:]
        self.torsion = np.flatnonzero(abs(halved - self.rows).sum(axis=1) > 0.0)
        self.torsion = self.torsion[(labels & self.assembly.interfaces.rectangle)[self.face[self.torsion]]]
        self._coefficients = self._torsion_coefficients(template)

    def _torsion_coefficients(self, template: Template) -> Floats:
        """Return coefficients (3, k) by which ρ, ρ a1 and ρ a2 enter the torsion rows."""
        # Entry [i, j] is the derivative of the entry of G in torsion row j and column `_columns[i, j]` (mT, V1, V2) by
        # parameter i. G is linear in the parameters.
        labels, first = self.labels, self.balance.shape[0]
        shifted = [self._matrix(template, labels, 1.0, arm)[first:] - self.rows for arm in ((1.0, 0.0), (0.0, 1.0))]
        parts = [self.rows, *shifted]
        if not self.torsion.size:
            return np.zeros((3, 0))
        return np.stack(
            [np.asarray(sp.csr_matrix(part)[self.torsion, self._columns[k]]).ravel() for k, part in enumerate(parts)]
        )

    def _matrix(self, template: Template, labels: Bits, ratio: float, arm: tuple[float, float]) -> sp.csr_array:
        """Return the matrix with one and the same area of all faces; arm: (x2, −x1) / c_T."""
        count = len(labels)
        areas = EffectiveAreas(np.full(count, ratio), np.tile(np.array(arm), (count, 1)))
        program = frozen_areas(template, areas).program(labels)
        s = program.structure
        return sp.csr_array(sp.csc_array((program.data, s.indices, s.indptr), shape=s.shape))

    @property
    def size(self) -> int:
        """Return the number n of columns of the program."""
        return len(self.objective)

    @cached_property
    def _columns(self) -> Ints:
        """Return the columns (3, k) of mT, V1, V2 of the faces of the torsion rows."""
        return np.asarray(6 * self.face[self.torsion][None] + np.array(_TWISTING)[:, None])

    @cached_property
    def own(self) -> Ints:
        """Return the columns (3, k) of N, m1, m2 of the faces of the torsion rows."""
        return np.asarray(6 * self.face[self.torsion][None] + np.array(_OWN)[:, None])

    def parameters(self, y: Floats) -> tuple[Floats, Floats]:
        """Compute ρ, ρ a1, ρ a2 (3, k) of the torsion rows at y (n,), and slopes (3, 3, k) by N, m1, m2."""
        forces, face = y[: 6 * len(self.labels)].reshape(-1, 6), self.face[self.torsion]
        areas = areas_under(self.assembly, forces, self.labels)
        of_ratio, of_arm = area_derivatives(self.assembly, forces, self.labels)
        ratio, arm = areas.ratio[face], areas.arm[face]
        slopes = of_arm[face] * ratio[:, None, None] + arm[:, :, None] * of_ratio[face][:, None, :]
        values = np.vstack([ratio[None], (ratio[:, None] * arm).T])
        return values, np.concatenate([of_ratio[face].T[None], slopes.transpose(1, 2, 0)])

    def entries(self, values: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the changes of G from whole faces to parameters (3, k): rows, columns, values (3k,)."""
        coefficients = self._coefficients * (values - np.array([1.0, 0.0, 0.0])[:, None])
        return np.tile(self.torsion, 3), self._columns.ravel(), coefficients.ravel()

    def matrix(self, values: Floats) -> sp.csr_array:
        """Return the sparse matrix G for parameters (3, k) of the torsion rows."""
        row, column, data = self.entries(values)
        return self.rows + sp.csr_array((data, (row, column)), shape=self.rows.shape)

    def row_slopes(self, y: Floats, slopes: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the derivative of G(y) v by y, at v = y held fixed, for Newton steps: sparse (rows, n)."""
        work = self._coefficients * y[self._columns]
        data = np.einsum("kr,kjr->jr", work, slopes)
        return np.tile(self.torsion, 3), self.own.ravel(), data.ravel()

    def column_slopes(self, z: Floats, slopes: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the derivative of G(y)ᵀ z by y, at fixed multipliers z (rows,): sparse (n, n)."""
        work = self._coefficients * z[self.torsion]
        data = work[:, None] * slopes
        row = np.broadcast_to(self._columns[:, None], data.shape)
        column = np.broadcast_to(self.own[None], data.shape)
        return row.ravel(), column.ravel(), data.ravel()
