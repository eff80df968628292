"""Base of the drivers with random proposals: no class twice, and enumeration once proposals become rare."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import sposv

from jld_core.arrays import Bits, Floats, Ints
from jld_core.deadline import checkpoint
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import Operators, operators
from jld_explore.drivers.standing_start import StandingStart
from jld_explore.evaluation.protocol import Evaluation, front_counts
from jld_explore.space import feasible, keys
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import SearchSpace

CORRELATION_LENGTH: Final = 0.1  # share of differing candidate faces at which the covariance is 1 / e

NOISE: Final = 0.01  # noise variance on the diagonal of the covariance matrix

SLOTS: Final = 192  # number of labellings remembered: half the best ones known, half the latest ones

_DIGITS: Final = 4  # decimal digits of a prediction, so that rounding errors do not decide an order

_SHARE: Final = SLOTS // 2  # number of labellings learned at a time, equal to the number of latest ones remembered

Single = NDArray[np.float32]


class Surrogate:
    """Gaussian process that predicts which share of known labellings a labelling exceeds."""

    def __init__(self, space: SearchSpace) -> None:
        # The covariance of two labellings is exp(−d / CORRELATION_LENGTH), d the share of candidate faces that differ,
        # summed over symmetric images of one. Shares in place of λ make units and outliers irrelevant.
        self._faces = np.flatnonzero(space.candidates)
        self._group = space.group
        self._images = np.zeros((len(space.group), SLOTS, len(self._faces)), dtype=np.float32)
        self._matrix = np.zeros((SLOTS, SLOTS), dtype=np.float32)
        self._values = np.empty(SLOTS)
        self._order = np.empty(0, dtype=np.int64)  # slots in the order in which they were filled
        self._weights: Single | None = None
        self._mean = 0.0
        self.filled_at = np.zeros(SLOTS, dtype=np.int64)
        self.batches_learned = 0

    def learn(self, labellings: Bits, values: Floats) -> None:
        """Remember labellings (k, m) with objective values (k,), larger is better."""
        for low in range(0, len(labellings), _SHARE):
            self._take_in(labellings[low : low + _SHARE], values[low : low + _SHARE])

    def _take_in(self, labellings: Bits, values: Floats) -> None:
        """Remember at most `_SHARE` labellings; full slots are taken from the worst of older ones."""
        count, known = len(labellings), self._order
        lacking = max(0, len(known) + count - SLOTS)
        if lacking:
            # keep the latest labellings, and the best of the older ones
            older = known[: len(known) + count - _SHARE]
            worst = np.argsort(-self._values[older], kind="stable")[len(older) - lacking :]
            slots = older[worst]
            stay = np.ones(len(known), dtype=bool)
            stay[worst] = False
            self._order = known[stay]
        else:
            slots = np.empty(0, dtype=np.int64)
        slots = np.concatenate([slots, np.arange(len(known), len(known) + count - lacking)])
        self._order = np.concatenate([self._order, slots])
        signs = self.signs(labellings)
        for image, permutation in zip(self._images, self._group, strict=True):
            image[slots] = self.signs(labellings[:, permutation])
        self._values[slots] = values
        covariance = self.covariance(signs, np.arange(len(self._order)))
        self._matrix[slots, : len(self._order)] = covariance
        self._matrix[: len(self._order), slots] = covariance.T
        self._weights = None
        self.batches_learned += 1
        self.filled_at[slots] = self.batches_learned

    def __len__(self) -> int:
        return len(self._order)

    def share_below(self, values: Floats) -> Floats:
        """Return the share of remembered labellings below each value (k,); ties count half."""
        known = np.sort(self._values[: len(self)])
        below = np.searchsorted(known, values, "left") + np.searchsorted(known, values, "right")
        return np.asarray(below / (2.0 * max(1, len(known))))

    def predict(self, labellings: Bits) -> Floats:
        """Predict the share of remembered labellings below each labelling: (k,), not limited to [0, 1]."""
        return self.predict_from(self.covariance(self.signs(labellings), np.arange(len(self))))

    def predict_from(self, covariance: Single) -> Floats:
        """Predict from covariances (k, ≥ n) with the n remembered labellings: (k,)."""
        if not len(self):
            return np.zeros(len(covariance))
        weights = self._fit() if self._weights is None else self._weights
        found = covariance[:, : len(self)] @ weights
        return np.asarray(np.round(found.astype(np.float64) + self._mean, _DIGITS))

    def _fit(self) -> Single:
        """Fit the process to the remembered labellings; return and keep its weights (n,)."""
        count = len(self)
        matrix = self._matrix[:count, :count].copy()
        matrix[np.diag_indices(count)] += NOISE * len(self._group)
        shares = self.share_below(self._values[:count])
        self._mean = float(shares.mean())
        # the transpose of the symmetric matrix has the column order that LAPACK needs
        _, weights, failed = sposv(matrix.T, (shares - self._mean).astype(np.float32), lower=True, overwrite_a=True)
        if failed:
            raise ArithmeticError("the covariance matrix of labellings is not positive definite")
        self._weights = np.asarray(weights, dtype=np.float32)
        return self._weights

    def signs(self, labellings: Bits) -> Single:
        """Convert labels (k, m) to signs (k, f) of candidate faces: 1 for dry, −1 for inner."""
        found: Single = labellings[:, self._faces].astype(np.float32)
        found *= np.float32(2.0)
        found -= np.float32(1.0)
        return found

    def covariance(self, signs: Single, slots: Ints) -> Single:
        """Compute covariances (k, n) of labellings, by signs (k, f), with those in n slots."""
        total: Single | None = None
        faces = signs.shape[1]
        for image in self._images:
            # faces − 2 × number of differing faces: an integer, hence exact in any order of summation
            product = signs @ image[slots].T
            product -= np.float32(faces)
            product *= np.float32(0.5 / (CORRELATION_LENGTH * faces))
            np.exp(product, out=product)
            total = product if total is None else np.add(total, product, out=total)
        return np.empty((len(signs), len(slots)), dtype=np.float32) if total is None else total


PATIENCE: Final = 12  # proposals per new labelling wanted after which `Searcher.fresh` gives up

_ROUND: Final = 16  # least number of proposals per batch; the cost of a check hardly depends on its size


class Register:
    """Set of the classes that a driver has proposed.

    Parameters
    ----------
    space : SearchSpace
        Also an attribute.

    Attributes
    ----------
    seen : set of bytes
        Keys of the canonical labellings proposed.
    """

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.seen: set[bytes] = set()

    def admit(self, rows: Bits, most: int | None = None, *, all_feasible: bool = False) -> Bits:
        """Register the new feasible classes among rows (k, m), at most `most`, and return them, canonical (j, m)."""
        return self.admitted(rows, most, all_feasible=all_feasible)[0]

    def admitted(
        self, rows: Bits, most: int | None = None, *, all_feasible: bool = False
    ) -> tuple[Bits, list[bytes], Ints]:
        """Register new classes as `admit` does; return them, their keys, and their rows (j,) among k."""
        rows = canonical(rows, self.space.group)
        fresh: dict[bytes, int] = {}
        # A converging search proposes mostly known classes. They are not checked again.
        for number, key in enumerate(keys(rows)):
            if key not in self.seen:
                fresh.setdefault(key, number)
        named, places = list(fresh), np.fromiter(fresh.values(), dtype=np.int64, count=len(fresh))
        if not all_feasible:
            good = feasible(self.space, rows[places])
            places = places[good]
            named = [key for key, fine in zip(named, good.tolist(), strict=True) if fine]
        named, places = named[:most], places[:most]
        self.seen.update(named)
        return rows[places], named, places

    def forget(self, names: Iterable[bytes]) -> None:
        """Remove classes by their keys, so that they may be proposed again."""
        self.seen.difference_update(names)


class Searcher(Driver):
    """Driver with random proposals, about `size` at a time (abstract base class)."""

    def __init__(self, space: SearchSpace, seed: int, size: int) -> None:
        super().__init__(space, seed)
        self.size = size
        self.rng = BufferedRandom(np.random.default_rng(seed))
        self.operators: Operators = operators(space)
        self.register = Register(space)
        self._unreturned = self._no_labellings
        self._enumeration: Iterator[Bits] | None = None
        self.standing_start = StandingStart(space, self.like)

    @property
    def exhaustive(self) -> bool:
        return True

    @property
    def _no_labellings(self) -> Bits:
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    def ask(self, limit: int | None = None) -> Bits:
        if limit is not None and limit <= 0:
            return self._no_labellings
        if not len(self._unreturned):
            self._unreturned = self._batch()
        given, self._unreturned = (
            self._unreturned[:limit],
            self._unreturned[len(self._unreturned) if limit is None else limit :],
        )
        return given

    def _batch(self) -> Bits:
        """Return the next proposals, or enumerated classes once proposals have become rare."""
        if self._enumeration is None:
            if len(rows := self.register.admit(self.standing_start.rows())):
                self.go_on_from(rows)
                return rows
            rows = self.propose()
            if len(rows) < max(1, self.size // 8):
                self._enumeration = self._remaining()
            if len(rows):
                return rows
        return next(self._enumeration, self._no_labellings) if self._enumeration is not None else self._no_labellings

    @abstractmethod
    def propose(self) -> Bits:
        """Propose up to `size` new canonical labellings (k, m), and register them."""

    def like(self, space: SearchSpace) -> Driver | None:
        """Return a driver of the largest value that looks for what stands; None for none."""
        return None

    def go_on_from(self, rows: Bits) -> None:
        """Go on from labellings (k, m), asked next, which should be the first that stand."""

    def fresh(self, make: Callable[[int], Bits], count: int) -> Bits:
        """Register up to `count` new classes (k, m) out of batches that `make` returns for a number."""
        found = self._no_labellings
        tries = PATIENCE * max(count, _ROUND)
        while len(found) < count and tries > 0:
            checkpoint()
            wanted = max(_ROUND, count - len(found))
            tries -= wanted
            admitted = self.register.admit(
                make(wanted), count - len(found), all_feasible=self.operators.always_feasible
            )
            found = np.concatenate([found, admitted])
        return found

    def draw(self, count: int) -> Bits:
        return self.operators.draw(count, self.rng)

    def _remaining(self) -> Iterator[Bits]:
        """Yield the classes that were not proposed yet, in batches of `size`, by enumeration."""
        waiting = self._no_labellings
        for rows, _ in Enumeration(self.space).batches():
            waiting = np.concatenate([waiting, self.register.admit(rows)])
            while len(waiting) >= self.size:
                yield waiting[: self.size]
                waiting = waiting[self.size :]
        if len(waiting):
            yield waiting


Names = NDArray[Any]  # keys (bytes objects) of labellings


class Pool:
    """Labellings that wait for evaluation, with keys, counts and covariances."""

    def __init__(self, space: SearchSpace, surrogate: Surrogate) -> None:
        self._space, self._surrogate = space, surrogate
        self.rows: Bits = np.empty((0, len(space.fixed)), dtype=bool)
        self.counts: Floats = np.empty((0, len(space.search.front.axes)))
        self.names: Names = np.empty(0, dtype=object)
        self._signs = surrogate.signs(self.rows)
        self._covariances = np.empty((0, SLOTS), dtype=np.float32)
        self._clock = surrogate.batches_learned

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, rows: Bits, names: list[bytes]) -> None:
        """Add labellings (k, m) with their k keys at the end."""
        own = np.empty(len(names), dtype=object)
        own[:] = names
        self._refresh()
        signs = self._surrogate.signs(rows)
        covariance = np.empty((len(rows), SLOTS), dtype=np.float32)
        known = len(self._surrogate)
        covariance[:, :known] = self._surrogate.covariance(signs, np.arange(known))
        self.rows = np.concatenate([self.rows, rows])
        self.counts = np.concatenate([self.counts, front_counts(self._space, rows)])
        self.names = np.concatenate([self.names, own])
        self._signs = np.concatenate([self._signs, signs])
        self._covariances = np.concatenate([self._covariances, covariance])

    def keep(self, places: Ints) -> None:
        """Remove all labellings except those at the positions `places` (k,), in this order."""
        self.rows, self.counts, self.names = self.rows[places], self.counts[places], self.names[places]
        self._signs, self._covariances = self._signs[places], self._covariances[places]

    def predict(self) -> Floats:
        self._refresh()
        return self._surrogate.predict_from(self._covariances)

    def _refresh(self) -> None:
        """Update the covariances with labellings that the surrogate has learned since."""
        fresh = np.flatnonzero(self._surrogate.filled_at > self._clock)
        self._clock = self._surrogate.batches_learned
        if fresh.size and len(self):
            self._covariances[:, fresh] = self._surrogate.covariance(self._signs, fresh)


# Labels of one batch; 512 labellings of 256 faces. A batch of 10 000 cells takes a fifth of a second.
_MOST_LABELS: Final = 1 << 17


class Random(Searcher):
    """Driver that draws labellings at random, each class once."""

    name = "random"
    ahead: int = 4  # evaluations have no influence, so asking ahead is free

    def __init__(self, space: SearchSpace, seed: int, size: int = 256) -> None:
        super().__init__(space, seed, min(size, max(1, _MOST_LABELS // max(1, len(space.candidates)))))

    def propose(self) -> Bits:
        return self.fresh(self.draw, self.size)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None: ...
