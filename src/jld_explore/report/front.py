"""Compute the Pareto front of λ and the scene's counts."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats

_TOGETHER: Final = 1 << 24  # number of comparisons made at once, which limits temporary memory

_DIGITS: Final = 12  # decimal digits to which counts are compared, relative to the largest count


def on_front(load_factors: Floats, counts: Floats, *senses: str) -> Bools:
    """Return a mask of the rows that are not dominated in λ and the counts.

    A row is dominated if another is at least as good in all objectives and better in one.

    load_factors: (k,) λ, more is better; rows with NaN are never on the front. counts: (k,) values of c counts.
    *senses: "max" or "min" for each count. Returns (k,).
    """
    signs = np.array([1.0 if sense == "max" else -1.0 for sense in senses])
    worth = np.asarray(counts, dtype=float).reshape(len(load_factors), len(senses)) * signs
    # Equal sums of lengths or masses may differ by rounding.
    worth = np.round(worth / np.maximum(abs(worth).max(axis=0, initial=0.0), 1e-300), _DIGITS)
    mask = np.zeros(len(worth), dtype=bool)
    rows = np.flatnonzero(np.isfinite(load_factors))
    if rows.size == 0:
        return mask
    # Take the best row for each combination of counts, then those that no other dominates.
    level, group = np.unique(worth[rows], axis=0, return_inverse=True)
    group = group.reshape(-1)
    best = np.full(len(level), -np.inf)
    np.maximum.at(best, group, load_factors[rows])
    kept = _unbeaten(best, level)
    mask[rows] = kept[group] & (load_factors[rows] == best[group])
    return mask


def _unbeaten(best: Floats, level: Floats) -> Bools:
    """Return a mask (p,) of the non-dominated rows among rows with different counts.

    best: (p,) largest λ of each row. level: (p, c) counts, larger is better, ascending; no two rows are equal.
    """
    if level.shape[1] == 1:
        # Levels ascend, so rows with better counts follow.
        behind = np.maximum.accumulate(best[::-1])[::-1]
        return best > np.concatenate([behind[1:], [-np.inf]])
    kept = np.empty(len(best), dtype=bool)
    step = max(1, _TOGETHER // (len(best) * level.shape[1]))
    for low in range(0, len(best), step):
        part = slice(low, low + step)
        beaten = (best >= best[part, None]) & (level >= level[part, None]).all(axis=2)
        # Each row dominates itself in this comparison.
        kept[part] = beaten.sum(axis=1) == 1
    return kept
