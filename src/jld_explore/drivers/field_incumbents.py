"""Bounds of evaluated layouts that a proof by fields knows, by their counts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_explore.drivers.exact.proof_state import Conflict
from jld_explore.drivers.field_aims import ProofAim, holds
from jld_explore.evaluation.field_pool import FieldPool
from jld_explore.space import SearchSpace, values_of
from jld_explore.space.measures import Range


def has_conflict(conflict: Conflict, labellings: Bits, group: Ints) -> Bools:
    """Return (k,) which labellings (k, m) have a conflict, or are mirror images of one that has, by a group (g, m)."""
    images = labellings[:, group[:, conflict.faces]]
    return np.asarray((images == conflict.labels).all(axis=2).any(axis=1))


class FieldIncumbents:
    """Bounds of evaluated labellings, and a pool of those that are refined.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    aim : ProofAim
        Aim of the proof, whose count tells labellings apart.

    Attributes
    ----------
    pool : FieldPool
        Labellings that are refined, with their bounds.
    counts : (k,) float array
        Counts of the labellings of the pool, 0 where the aim has none.
    """

    def __init__(self, space: SearchSpace, aim: ProofAim) -> None:
        self._space, self._aim = space, aim
        self.pool = FieldPool(space.assembly, np.empty((0, len(space.fixed)), dtype=bool))
        self.counts: Floats = np.empty(0)
        self._known: dict[bytes, tuple[float, float, int]] = {}
        self._rows: dict[bytes, int] = {}

    def counts_of(self, labellings: Bits) -> Floats:
        """Return the counts (k,) of labellings (k, m), 0 where the aim has none."""
        count = self._aim.count
        if count is None or not len(labellings):
            return np.zeros(len(labellings))
        return np.asarray(values_of(count, self._space.assembly, labellings, self._space.graph), dtype=float)

    def learn(self, labellings: Bits, low: Sequence[float], high: Sequence[float]) -> None:
        """Take bounds (k,) of evaluated labellings (k, m), infinite where there is none."""
        for labels, *bounds, count in zip(labellings, low, high, self.counts_of(labellings).tolist(), strict=True):
            self._known[labels.tobytes()] = bounds[0], bounds[1], int(count)

    def is_known(self, labels: Bits) -> bool:
        """Return whether a labelling (m,) was evaluated."""
        return labels.tobytes() in self._known

    def in_pool(self, labels: Bits) -> bool:
        """Return whether a labelling (m,) is in the pool."""
        return labels.tobytes() in self._rows

    def join(self, labellings: Sequence[Bits]) -> Bits:
        """Add evaluated labellings (m,) to the pool; return those (k, m) that were not in it."""
        new = [labels for labels in labellings if not self.in_pool(labels)]
        added = np.array(new, dtype=bool).reshape(len(new), len(self._space.fixed))
        known = np.array([self._known[labels.tobytes()] for labels in new]).reshape(-1, 3)
        for labels in new:
            self._rows[labels.tobytes()] = len(self._rows)
        self.pool.add(added, known[:, 0], known[:, 1])
        self.counts = np.concatenate([self.counts, known[:, 2]])
        return added

    def best(self) -> dict[int, float]:
        """Return the largest proven lower bound for each count, −inf where none stands."""
        found: dict[int, float] = {}
        for low, _, count in self._known.values():
            found[count] = max(low, found.get(count, -math.inf))
        for low, count in zip(self.pool.low().tolist(), self.counts.tolist(), strict=True):
            found[int(count)] = max(low, found.get(int(count), -math.inf))
        return found

    def promising(self, target: int | Range | None, over: float, number: int, alike: float) -> list[Bits]:
        """Return evaluated labellings (m,) of a target that may carry a factor, of greatest lower bounds first.

        Parameters
        ----------
        target : int, Range or None
            Counts of the target.
        over : float
            Factor that the upper bounds exceed.
        number : int
            Most labellings.
        alike : float
            Relative difference of lower bounds below which one of two labellings is taken.
        """
        rows = [(-low, key, count) for key, (low, high, count) in self._known.items() if low > 0.0 and high > over]
        rows.sort()
        inside = holds(target, np.array([count for *_, count in rows]))
        chosen: list[Bits] = []
        last = -math.inf
        for (weaker, key, _), within in zip(rows, inside.tolist(), strict=True):
            if within and weaker - last > alike * abs(weaker):
                chosen.append(np.frombuffer(key, dtype=bool))
                last = weaker
        return chosen[:number]

    def strongest(self, number: int) -> tuple[Bits, Floats]:
        """Return the labellings (k, m) of greatest lower bounds (k,)."""
        lows = {key: low for key, (low, *_) in self._known.items()}
        for key, low in zip(self._rows, self.pool.low().tolist(), strict=True):
            lows[key] = max(low, lows.get(key, -math.inf))
        stands = sorted((-low, key) for key, low in lows.items() if math.isfinite(low))[:number]
        rows = np.frombuffer(b"".join(key for _, key in stands), dtype=bool)
        return rows.reshape(len(stands), len(self._space.fixed)), np.array([-low for low, _ in stands])
