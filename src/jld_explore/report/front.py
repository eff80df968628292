"""Fronts: rows that no other row beats in λ and in the scene's count."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Bools, Floats


def on_front(load_factors: Floats, counts: Floats, sense: str) -> Bools:
    """(k,) True where no other row is at least as good in both objectives and better in one.

    load_factors: (k,) λ, more is better; NaN is never on the front. counts: (k,). sense: "max" or "min".
    """
    worth = counts if sense == "max" else -counts
    mask = np.zeros(len(worth), dtype=bool)
    rows = np.flatnonzero(np.isfinite(load_factors))
    if rows.size == 0:
        return mask
    order = rows[np.lexsort((-load_factors[rows], -worth[rows]))]
    value, level = load_factors[order], worth[order]
    first = np.concatenate([[True], level[1:] != level[:-1]])
    group = np.cumsum(first) - 1
    best = value[first]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(best)[:-1]])
    mask[order] = (value == best[group]) & (value > before[group])
    return mask
