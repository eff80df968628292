"""Projection of raw points onto equilibrium, and checks of residuals and sizes of vectors."""

from __future__ import annotations

import copy

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.linalg.projection import Projector
from jld_core.program import Template


def rows_by_element(rows: Floats, freedoms: int) -> Floats:
    """Reshape a vector with q entries per free element to a table (free, q).

    rows: (q·free,) values, in the order of the equilibrium equations. freedoms: q. Entries of further equations, such
    as that of a settlement, get a row each, filled up with zeros.
    """
    whole = len(rows) // freedoms * freedoms
    more = np.zeros((len(rows) - whole, freedoms))
    more[:, 0] = rows[whole:]
    return np.concatenate([rows[:whole].reshape(-1, freedoms), more])


def projected_onto(projector: Projector, vector: Floats, target: Floats, passes: int) -> tuple[Floats, Floats, float]:
    """Project a vector (columns,) onto the solutions y of the equations rows·y = target.

    projector: holds the matrix `rows`. target: (rows,) right-hand side. passes: number of projections. Returns the
    projected vector, its residual (rows,), and an estimate of the error left in its entries.
    """
    for _ in range(passes):
        vector = vector - projector.correction(projector.rows @ vector - target)
    left = projector.rows @ vector - target
    return vector, left, float(abs(projector.correction(left)).max())


def error_or_inf(error: float, left: Floats, forces: Floats) -> float:
    """Return an error estimate, or inf if the residual of equilibrium exceeds rounding.

    A large residual means that the kept resultants cannot reach equilibrium. error: estimate. left: (rows,) residual.
    forces: (columns,) forces with this residual. All values are scaled.
    """
    much = float(abs(left).max()) > tolerances.ROUNDING * max(1.0, float(abs(forces).max()))
    return np.inf if much else error


def usable(vector: Floats) -> bool:
    """Return True if a scaled vector is of plausible size (below 1e30).

    A failed solve may leave any values behind.
    """
    return not vector.size or bool(abs(vector).max() < 1e30)


class EquilibriumProjectors:
    """Projectors onto the equilibrium of one template, one for each set of kept resultants.

    A labelling drops the resultants that its faces do not resist. Projectors are computed when first needed and kept.

    template: scaled programs of one assembly.
    """

    def __init__(self, template: Template) -> None:
        self.template = template
        self._known: dict[bytes, Projector] = {}
        self._everything = np.ones((len(template.assembly.interfaces), template.assembly.freedoms), dtype=bool)

    def with_template(self, template: Template) -> EquilibriumProjectors:
        """Return these projectors for another template with the same equilibrium matrix.

        Both objects share the projectors computed so far.
        """
        other = copy.copy(self)
        other.template = template
        return other

    def with_load(self, labels: Bits) -> tuple[Projector, Floats | None]:
        """Return the projector onto equilibrium for the resultants that a labelling keeps.

        labels: (m,) True = dry. Result: projector: projector of the kept resultants; with dropped resultants it has λ
        as its last column; mask: (q·m,) 1 for each kept resultant, 0 for the others; None if all are kept.
        """
        active = self.template.yield_set.active(labels)
        if active.all():
            active = self._everything
        key = np.packbits(active).tobytes()
        mask = None if active is self._everything else active.ravel().astype(float)
        if key not in self._known:
            matrix, places = self.template.matrix, self.template.structure.places
            if mask is not None:
                places = None
                live = sp.csc_array(self.template.live[:, None])
                matrix = sp.csc_array(sp.hstack([matrix @ sp.diags_array(mask), live]))
            if len(self._known) >= 16:
                self._known.pop(next(iter(self._known)))
            self._known[key] = Projector(sp.csc_array(matrix), places)
        return self._known[key], mask

    def of_forces(self, mask: Floats) -> Projector:
        """Return a new projector onto equilibrium at fixed λ.

        mask: (q·m,) 1 for each resultant that is kept, 0 for the others.
        """
        return Projector(sp.csc_array(self.template.matrix @ sp.diags_array(mask)), self.template.structure.places)
