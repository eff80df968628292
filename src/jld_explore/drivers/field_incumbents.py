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
    """Return True for labellings that a conflict, or its mirror image, rules out, (k,).

    labellings: (k, m), True = dry. group: (g, m) permutations of faces, the symmetries of the scene.
    """
    images = labellings[:, group[:, conflict.faces]]
    return np.asarray((images == conflict.labels).all(axis=2).any(axis=1))


class FieldIncumbents:
    """Bounds of all evaluated labellings, and a pool of those that are refined.

    A proof by fields asks it for the best lower bounds, and for labellings to refine.

    aim: aim of the proof, whose count tells labellings apart. pool: labellings that are refined, with their bounds.
    counts: (k,) counts of the labellings of the pool, 0 where the aim has none.
    """

    def __init__(self, space: SearchSpace, aim: ProofAim) -> None:
        self._space, self._aim = space, aim
        self.pool = FieldPool(space.assembly, np.empty((0, len(space.fixed)), dtype=bool))
        self.counts: Floats = np.empty(0)
        self._known: dict[bytes, tuple[float, float, int]] = {}
        self._rows: dict[bytes, int] = {}

    def counts_of(self, labellings: Bits) -> Floats:
        """Return the value (k,) of the aim's count for each labelling.

        labellings: (k, m), True = dry. All are 0 where the aim has no count.
        """
        count = self._aim.count
        if count is None or not len(labellings):
            return np.zeros(len(labellings))
        return np.asarray(values_of(count, self._space.assembly, labellings, self._space.graph), dtype=float)

    def learn(self, labellings: Bits, low: Sequence[float], high: Sequence[float]) -> None:
        """Store the bounds on the governing factor of evaluated labellings.

        labellings: (k, m), canonical, True = dry. low, high: k bounds each, −inf and inf where there is none. Bounds of
        an earlier call are replaced.
        """
        for labels, *bounds, count in zip(labellings, low, high, self.counts_of(labellings).tolist(), strict=True):
            self._known[labels.tobytes()] = bounds[0], bounds[1], int(count)

    def is_known(self, labels: Bits) -> bool:
        """Return True if `learn` has stored bounds of exactly this labelling (m,)."""
        return labels.tobytes() in self._known

    def in_pool(self, labels: Bits) -> bool:
        """Return True if exactly this labelling (m,) is in the pool."""
        return labels.tobytes() in self._rows

    def join(self, labellings: Sequence[Bits]) -> Bits:
        """Add labellings to the pool with their stored bounds, and return the new ones (k, m).

        labellings: (m,) each, distinct; those in the pool already are skipped. Raises KeyError for one without bounds
        from `learn`.
        """
        new = [labels for labels in labellings if not self.in_pool(labels)]
        added = np.array(new, dtype=bool).reshape(len(new), len(self._space.fixed))
        known = np.array([self._known[labels.tobytes()] for labels in new]).reshape(-1, 3)
        for labels in new:
            self._rows[labels.tobytes()] = len(self._rows)
        self.pool.add(added, known[:, 0], known[:, 1])
        self.counts = np.concatenate([self.counts, known[:, 2]])
        return added

    def best(self) -> dict[int, float]:
        """Return the largest proven governing factor of a layout of each count.

        Counts of evaluated labellings are the keys. −inf: no such layout is proven to stand.
        """
        found: dict[int, float] = {}
        for low, _, count in self._known.values():
            found[count] = max(low, found.get(count, -math.inf))
        for low, count in zip(self.pool.low().tolist(), self.counts.tolist(), strict=True):
            found[int(count)] = max(low, found.get(int(count), -math.inf))
        return found

    def promising(self, target: int | Range | None, over: float, number: int, alike: float) -> list[Bits]:
        """Choose evaluated labellings of a target to refine, greatest lower bounds first.

        Only those with a lower bound above 0 are taken.

        target: as `ProofAim.target` returns it. over: governing factor that the upper bound of each must exceed.
        number: largest number of labellings. alike: relative difference of lower bounds below which only the first of
        two is taken.
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
        """Return at most `number` labellings (k, m) of greatest lower bounds, with these (k,).

        Only finite bounds count, those of the pool included; the greatest is first. The check of a proof compares its
        claims with them.
        """
        lows = {key: low for key, (low, *_) in self._known.items()}
        for key, low in zip(self._rows, self.pool.low().tolist(), strict=True):
            lows[key] = max(low, lows.get(key, -math.inf))
        stands = sorted((-low, key) for key, low in lows.items() if math.isfinite(low))[:number]
        rows = np.frombuffer(b"".join(key for _, key in stands), dtype=bool)
        return rows.reshape(len(stands), len(self._space.fixed)), np.array([-low for low, _ in stands])
