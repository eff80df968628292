"""Certificate of a lower bound in space, with the forms that couple friction and slip.

The identity is that of `certificate` with additional terms:

    (λ − p)(b_λ·u) − σ cost = Σ M_kl ŷ_k z_l + Σ g_k ŷ_k (b_λ·u) + Σ ν_j B_j(Φ, w) + (K Φ)ᵀ Q w + Φᵀ Ψ w_still + Φᵀ R w

with B_j = 0 in every solution, ν of either sign, and w_still the ties and closed modes. Rows, directions and yield
surfaces enter as the doubles that they are, and jumps as those of A: no number in the identity is rounded
(docs/method.md (4.9)).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Floats
from jld_core.models.zero_dilation.binary_fractions import BITS, BinaryFractions, round_to_bits
from jld_core.models.zero_dilation.bounded_modes import Region
from jld_core.models.zero_dilation.certificate import Certifier, drop_rounding, least_change_solver, reduce_residual
from jld_core.models.zero_dilation.rlt_relaxation import null_space, product_rows, region_forms, row_maxima
from studies.spatial_bound.modes import Forms, SpaceModes
from studies.spatial_bound.rlt_relaxation import equal_of, still

_FREE: Final = 1e-7
"""Size above which a multiplier may change without limit in a correction; smaller ones change in proportion."""

_GONE: Final = 1e-14
"""Size below which a multiplier counts as zero."""


class SpaceCertifier(Certifier):
    """Certifier of one spatial region: makes multipliers exact and checks the bound they prove.

    Multipliers of the coupling forms follow those of (y, λ − L, U − λ) in `live_work`. velocity_bounds: from
    `bound_space_velocities`.
    """

    def __init__(
        self, modes: SpaceModes, region: Region, slack: float, force_bounds: Floats, velocity_bounds: Floats
    ) -> None:
        self.space, self.region, self.slack = modes, region, slack
        self.force_bounds, self.velocity_bounds = force_bounds, velocity_bounds
        self.facts = region_forms(modes, region)
        self.states = force_bounds[:, None] * null_space(modes.statics * force_bounds)
        self.motions = null_space(still(modes, region))
        self.free, self.closed_forms, self.loop_errors = equal_of(modes, region), region.closed, np.zeros(0)
        self.unbalanced = np.zeros(modes.motions.shape[1], dtype=bool)
        count = modes.coupled.count
        self.sign_free = np.concatenate([region.held, [False, False], np.ones(count, dtype=bool)])
        self.largest = row_maxima(self.facts * self.force_bounds)
        self.prices = np.concatenate([self.largest[:-1], np.ones(count)])
        self._motions = BinaryFractions.of(modes.motions)
        self._zero_forms = BinaryFractions.of(np.vstack([modes.ties, modes.rates[region.closed]])) @ self._motions

    def _correction(self, of_products: Floats, price: Floats) -> Any:
        """Return a function from the residual R to the change of multipliers that reduces R."""
        modes, largest, bounds = self.space, self.largest, len(self.largest) - 1
        jumps = drop_rounding(modes.motions @ self.motions)
        facts, rates = drop_rounding((self.facts / largest[:, None]) @ self.states), drop_rounding(modes.rates @ jumps)
        live = modes.live_rate @ self.motions
        weight = np.where(self.free, 1.0, np.minimum(of_products * largest[:, None] / _FREE, 1.0))
        weight = np.where(weight < _GONE / _FREE, 0.0, weight)
        weight[:, self.region.closed] = 0.0
        i, j = np.nonzero(weight)
        movable = np.where(self.sign_free, 1.0, np.minimum(price * self.prices / _FREE, 1.0))[:bounds]
        g = np.flatnonzero(movable >= _GONE / _FREE)
        last = np.append(g, bounds)
        coupled = [self._coupled(form, jumps) for form in range(modes.coupled.count)]
        by_live = product_rows(facts, live[None], last, np.zeros(len(last), dtype=np.int64))
        rows = sp.vstack([product_rows(facts, rates, i, j), by_live, *coupled], format="csr")
        solve = least_change_solver(rows, np.concatenate([weight[i, j], movable[g], np.ones(1 + len(coupled))]))
        scales = 1.0 / np.concatenate([largest[i], largest[last], np.ones(len(coupled))])

        def change(rest: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            """Return the changes of `over`, `live` and `bound` for a residual."""
            residual_size = float(abs(rest).max(initial=0.0)) or 1.0
            found = solve((self.states.T @ (rest / residual_size) @ self.motions).ravel()) * residual_size * scales
            more, paid = np.zeros(of_products.shape), np.zeros((len(price), 1))
            more[i, j], paid[g, 0] = found[: len(i)], found[len(i) : len(i) + len(g)]
            raised = found[len(i) + len(g)]
            paid[bounds:, 0] = found[len(i) + len(g) + 1 :]
            tables = (more, paid, np.array([[raised]]))
            one, two, three = (BinaryFractions.of(round_to_bits(table, 2 * BITS)) for table in tables)
            return one, two, three

        return change

    def _coupled(self, form: int, jumps: Floats) -> Any:
        """Return one form over products of free states and motions, (1, states · motions)."""
        table = self.space.coupled.table(form, (len(self.states), len(jumps)))
        return sp.csr_array((self.states.T @ (table @ jumps)).reshape(1, -1))

    # --- in integers --------------------------------------------------------------------------------------

    def _residual(
        self, of_products: BinaryFractions, live_work: BinaryFractions, bound: BinaryFractions, slack: float
    ) -> Floats:
        """Return R: the residual of the identity after two reductions by Q and Ψ."""
        modes, bounds = self.space, len(self.largest) - 1
        facts, unit = BinaryFractions.of(self.facts), np.eye(self.facts.shape[1])
        load = BinaryFractions.of(unit[:, -2:-1]) - BinaryFractions.of(unit[:, -1:]) @ bound
        by_live = (load - facts.rows(slice(-1)).transposed() @ live_work.rows(slice(bounds))) @ BinaryFractions.of(
            modes.live_rate[None]
        )
        shape = self.facts.shape[1], len(modes.motions)
        one = BinaryFractions.of(np.ones((1, 1)))
        taken = _weighted(modes.cost, one, shape).times(slack) + _weighted(
            modes.coupled, live_work.rows(slice(bounds, None)), shape
        )
        taken = taken + facts.transposed() @ (of_products @ BinaryFractions.of(modes.rates))
        return reduce_residual(by_live - taken @ self._motions, modes.statics, self._zero_forms, self.unbalanced)


def _weighted(forms: Forms, weights: BinaryFractions, shape: tuple[int, int]) -> BinaryFractions:
    """Return Σ ν_j B_j(Φ, J) for weights ν (forms, 1)."""
    numbers = BinaryFractions.of(forms.number)
    out = np.zeros(shape, dtype=object)
    np.add.at(out, (forms.state, forms.motion), numbers.values * weights.values[forms.which, 0])
    return BinaryFractions(out, numbers.scale + weights.scale)
