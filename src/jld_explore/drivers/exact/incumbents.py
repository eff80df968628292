"""What is known of the labellings that were evaluated, and the best of them with each count."""

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

_EACH: Final = 4000
"""Relaxations after which annealing is given another chance for the first time; later after twice as many as before."""

_SHARE: Final = (0.025, 0.15)
"""Labellings annealed then for each relaxation since, with the batch solver and without: some 10 to 15 % of the
time."""

_LASTING: Final = 60_000
_LATER: Final = 0.06
"""Relaxations by which a proof is one of those that last, and the share from then on: there a relaxation takes half as
long as a labelling (0.24 and 0.5 ms of the crushable arch), in small walls a seventh."""


class HeuristicSchedule:
    """When annealing has another chance beside a proof. quick: the batch solver solves relaxations; never: not at
    all."""

    def __init__(self, *, quick: bool, never: bool) -> None:
        self._share = _SHARE[not quick]
        self._again = math.inf if never else _EACH
        self._last = 0

    def due(self, relaxations: int) -> int:
        """Labellings to be annealed now, 0 until it is time again. relaxations: solved so far."""
        since = relaxations - self._last
        if since < self._again:
            return 0
        self._last, self._again = relaxations, 2 * self._again
        return int(since * (max(self._share, _LATER) if relaxations >= _LASTING else self._share))


class Incumbents:
    """Bounds of labellings that were evaluated. count: by which the best are told apart, None for the best of all."""

    def __init__(self, space: SearchSpace, count: Count | None) -> None:
        self._space, self._count = space, count
        self._known: dict[bytes, tuple[float, float, int]] = {}
        self._best: dict[int | None, float] = {}

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m)."""
        number = [0] * len(labellings)
        if self._count is not None:
            number = values_of(self._count, self._space.assembly, labellings, self._space.graph).tolist()
        for labels, found, count in zip(labellings, evaluations, number, strict=True):
            low = found.low if found.status is Status.COLLAPSE else -math.inf
            high = found.high if found.status is Status.COLLAPSE else -math.inf
            if found.status in (Status.UNCERTIFIED, Status.FAILED):
                high = found.high if math.isfinite(found.high) else math.inf
            if math.isfinite(found.zero_dilation):
                # there may be other solutions without dilation; the associative λ bounds them all
                high = max(high, found.associative * (1.0 + tolerances.PROVEN))
            self._known[np.packbits(labels).tobytes()] = (low, high, count)
            for target in (None, count):
                self._best[target] = max(low, self._best.get(target, -math.inf))

    def __bool__(self) -> bool:
        """Return True if any labelling was evaluated."""
        return bool(self._known)

    def __contains__(self, labels: Bits) -> bool:
        """Whether a canonical labelling (m,) was evaluated."""
        return np.packbits(labels).tobytes() in self._known

    def strongest(self, count: int) -> tuple[Bits, Floats]:
        """Layouts (k, m) of the largest proven λ, at most `count`, and that λ (k,), scene units."""
        stands = [(low, key) for key, (low, _, _) in self._known.items() if math.isfinite(low)]
        stands.sort(key=lambda one: (-one[0], one[1]))
        faces = len(self._space.fixed)
        packed = np.frombuffer(b"".join(key for _, key in stands[:count]), dtype=np.uint8)
        rows = np.unpackbits(packed.reshape(-1, (faces + 7) // 8), axis=1, count=faces).astype(bool)
        return rows, np.array([low for low, _ in stands[:count]])

    def best(self, target: int | None) -> float:
        """Largest proven λ with a count, or of all; −inf where there is none."""
        return self._best.get(target, -math.inf)

    def high(self, labels: Bits, target: int | None) -> float:
        """λ that a canonical labelling (m,) does not exceed; −inf where it has another count than the target's."""
        _, high, count = self._known.get(np.packbits(labels).tobytes(), (-math.inf, math.inf, target))
        return high if target is None or count == target else -math.inf
