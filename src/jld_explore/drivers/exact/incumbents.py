"""Bounds of the evaluated labellings, the best of them for each count, and when to anneal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.limit import Status
from jld_explore.evaluation import Evaluation
from jld_explore.space import Count, SearchSpace, values_of

_FIRST_INTERVAL: Final = 4000
"""Relaxations before annealing first runs during a proof; the interval then doubles."""

_LABELLINGS_PER_RELAXATION: Final = (0.025, 0.15)
"""Labellings annealed per relaxation since the last run, with and without batch solver.

Annealing then takes some 10 to 15 % of the time.
"""

_LONG_PROOF: Final = 60_000
"""Number of relaxations from which a proof counts as long."""
_LABELLINGS_IN_LONG_PROOF: Final = 0.06
"""Least number of labellings annealed per relaxation in a long proof.

There a relaxation takes half as long as the evaluation of a labelling (0.24 and 0.5 ms for the crushable arch), in
small walls a seventh.
"""


class AnnealingSchedule:
    """Schedule for interleaving annealing with the proof.

    Parameters
    ----------
    batched : bool
        Whether the batch solver solves the relaxations.
    disabled : bool
        Whether to do without annealing.
    """

    def __init__(self, *, batched: bool, disabled: bool) -> None:
        self._share = _LABELLINGS_PER_RELAXATION[not batched]
        self._interval = math.inf if disabled else _FIRST_INTERVAL
        self._last_run = 0

    def labellings_due(self, relaxations: int) -> int:
        """Return the number of labellings to anneal now, 0 if annealing is not due.

        `relaxations` is the number of relaxations solved so far.
        """
        since = relaxations - self._last_run
        if since < self._interval:
            return 0
        self._last_run, self._interval = relaxations, 2 * self._interval
        return int(since * (max(self._share, _LABELLINGS_IN_LONG_PROOF) if relaxations >= _LONG_PROOF else self._share))


class Incumbents:
    """Bounds of all evaluated labellings, and the best λ for each value of a count.

    Parameters
    ----------
    space : SearchSpace
        The search space.
    count : Count or None
        Count that distinguishes the targets; None for a single target.
    """

    def __init__(self, space: SearchSpace, count: Count | None) -> None:
        self._space, self._count = space, count
        self._bounds: dict[bytes, tuple[float, float, int]] = {}
        self._best: dict[int | None, float] = {}

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Record the bounds of evaluated labellings (k, m)."""
        number = [0] * len(labellings)
        if self._count is not None:
            number = values_of(self._count, self._space.assembly, labellings, self._space.graph).tolist()
        for labels, found, count in zip(labellings, evaluations, number, strict=True):
            low = found.low if found.status is Status.COLLAPSE else -math.inf
            high = found.high if found.status is Status.COLLAPSE else -math.inf
            if found.status in (Status.UNCERTIFIED, Status.FAILED):
                high = found.high if math.isfinite(found.high) else math.inf
            if math.isfinite(found.zero_dilation):
                # other solutions without dilation may exist; the associative λ bounds all of them
                high = max(high, found.associative * (1.0 + tolerances.PROVEN))
            self._bounds[np.packbits(labels).tobytes()] = (low, high, count)
            for target in (None, count):
                self._best[target] = max(low, self._best.get(target, -math.inf))

    def __bool__(self) -> bool:
        """Return True if any labelling was evaluated."""
        return bool(self._bounds)

    def __contains__(self, labels: Bits) -> bool:
        """Return True if a canonical labelling (m,) was evaluated."""
        return np.packbits(labels).tobytes() in self._bounds

    def strongest(self, count: int) -> tuple[Bits, Floats]:
        """Return the labellings (k, m) with the largest proven λ, and that λ (k,), scene units.

        `count` is the largest number of labellings.
        """
        stands = [(low, key) for key, (low, _, _) in self._bounds.items() if math.isfinite(low)]
        stands.sort(key=lambda one: (-one[0], one[1]))
        faces = len(self._space.fixed)
        packed = np.frombuffer(b"".join(key for _, key in stands[:count]), dtype=np.uint8)
        rows = np.unpackbits(packed.reshape(-1, (faces + 7) // 8), axis=1, count=faces).astype(bool)
        return rows, np.array([low for low, _ in stands[:count]])

    def best(self, target: int | None) -> float:
        """Return the largest proven λ, scene units, for a value of the count or None for all.

        The value is −inf if no labelling has a proven λ.
        """
        return self._best.get(target, -math.inf)

    def high(self, labels: Bits, target: int | None) -> float:
        """Return the λ, scene units, that a canonical labelling (m,) does not exceed.

        The value is inf for a labelling without evaluation, and −inf where `target` is another count than that of the
        labelling.
        """
        _, high, count = self._bounds.get(np.packbits(labels).tobytes(), (-math.inf, math.inf, target))
        return high if target is None or count == target else -math.inf
