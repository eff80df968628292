"""Fronts: rows that no other row beats in λ and in the scene's counts."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats

_TOGETHER: Final = 1 << 24
"""Comparisons made at once."""

_DIGITS: Final = 12
"""Digits of counts that are compared, beside the largest."""


def on_front(load_factors: Floats, counts: Floats, *senses: str) -> Bools:
    """(k,) True where no other row is at least as good in all objectives and better in one.

    load_factors: (k,) λ, more is better; NaN is never on the front. counts: (k,), or (k, c) for several counts. senses:
    "max" or "min" for each count.
    """
    signs = np.array([1.0 if sense == "max" else -1.0 for sense in senses])
    worth = np.asarray(counts, dtype=float).reshape(len(load_factors), len(senses)) * signs
    # sums of lengths and masses that are one differ by rounding
    worth = np.round(worth / np.maximum(abs(worth).max(axis=0, initial=0.0), 1e-300), _DIGITS)
    mask = np.zeros(len(worth), dtype=bool)
    rows = np.flatnonzero(np.isfinite(load_factors))
    if rows.size == 0:
        return mask
    # the best of all that count alike, and of those what none beats
    level, group = np.unique(worth[rows], axis=0, return_inverse=True)
    group = group.reshape(-1)
    best = np.full(len(level), -np.inf)
    np.maximum.at(best, group, load_factors[rows])
    kept = _unbeaten(best, level)
    mask[rows] = kept[group] & (load_factors[rows] == best[group])
    return mask


def _unbeaten(best: Floats, level: Floats) -> Bools:
    """(p,) rows that no other is as good as in every number; levels (p, c) differ."""
    if level.shape[1] == 1:
        # ascending, so what counts more stands behind
        behind = np.maximum.accumulate(best[::-1])[::-1]
        return best > np.concatenate([behind[1:], [-np.inf]])
    kept = np.empty(len(best), dtype=bool)
    step = max(1, _TOGETHER // (len(best) * level.shape[1]))
    for low in range(0, len(best), step):
        part = slice(low, low + step)
        beaten = (best >= best[part, None]) & (level >= level[part, None]).all(axis=2)
        # each is as good as itself
        kept[part] = beaten.sum(axis=1) == 1
    return kept
