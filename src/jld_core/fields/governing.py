"""Bounds by fields on the governing load factor of several load cases."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.fields.bounds import FieldRefinement, relative_gap


def governing_bounds(
    assembly: Assembly, labels: Bits, seconds: float, *, gap: float = 0.05, lower_first: bool = True
) -> tuple[float, float]:
    """Bound the governing load factor of a planar layout whose blocks crack anywhere.

    Raises InputError as `bounds_by_fields`.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    labels : (m,) array of bool
        True = dry.
    seconds : float
        Time after which no mesh is refined, s.
    gap : float
        Relative width to reach.
    lower_first : bool
        Begin with the lower bound.

    Returns
    -------
    (float, float)
        Proven bounds on the least λ / required of all cases, infinite where none was found.
    """
    # Each step refines the mesh of the load case with the least lower bound, since the lower bound on the governing
    # factor is that one. Cases that do not govern keep their coarse mesh.
    deadline = Deadline(seconds)
    required = assembly.required.tolist()
    cases = [FieldRefinement(case, labels, gap=gap, lower_first=lower_first) for case in assembly.by_case]
    found = [case.step() for case in cases]
    while True:
        low = np.array([one.lower / factor for one, factor in zip(found, required, strict=True)])
        high = np.array([one.upper / factor for one, factor in zip(found, required, strict=True)])
        # the upper bound of any case bounds the governing factor
        worst = int(np.lexsort((high, low))[0])
        case, left = cases[worst], deadline.remaining()
        if case.ended or high.min() < 0.0 or relative_gap(float(low.min()), float(high.min())) <= gap:
            break
        upper = case.upper_due and case.expected - case.spent <= left
        if case.expected_with(upper) - case.spent > left:
            break
        found[worst] = case.step(upper)
    return float(low.min()), float(high.min())
