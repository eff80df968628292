"""Partial labellings under several load cases: a mechanism of any case rules out what is too weak under that case."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.limit.relaxation import DualBound, Relaxation


class CaseRelaxation:
    """Upper bounds on the governing factor, min over cases of λ / required, for partial labellings; not scaled.

    cases: the relaxation of each case. required: factor of each. The case that refuted last is asked first.
    """

    def __init__(self, cases: Sequence[Relaxation], required: Sequence[float]) -> None:
        self._cases = list(cases)
        self._units = [one.template.scaling.load / factor for one, factor in zip(cases, required, strict=True)]
        self._order = list(range(len(self._cases)))

    @property
    def solves(self) -> int:
        """Programs solved so far."""
        return sum(one.solves for one in self._cases)

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """A proof, by one case, that no labelling that agrees where decided reaches a factor; None where none is found.

        labels: (m,) True dry. undecided: (m,). threshold: governing factor.
        """
        for position, case in enumerate(self._order):
            unit = self._units[case]
            found = self._cases[case].refute(labels, undecided, threshold / unit)
            if found is not None:
                self._order.insert(0, self._order.pop(position))
                # rounded up: a bound must not lose by being put into other units
                bound = found.bound * unit
                return DualBound(found.excess, found.cost, bound + abs(bound) * 4.0 * np.finfo(float).eps)
        return None

    def bound(self, labels: Bits, undecided: Bools) -> float:
        """Governing factor that no labelling exceeds that agrees where decided; inf where none was found."""
        each = (one.bound(labels, undecided) * unit for one, unit in zip(self._cases, self._units, strict=True))
        return min(each, default=np.inf)
