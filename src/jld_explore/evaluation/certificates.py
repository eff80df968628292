"""What past solves prove about labellings that were never solved (docs/method.md (6.1), (6.2)).

**Forces** in equilibrium at λ bound λ from below under every labelling that admits them on every face; a face on
which they are admissible as dry and as inner is free, so they cover a sub-cube of labellings. A **mechanism**
bounds λ from above under every labelling for which its dissipation is finite, by a constant plus one number per
face and label; one that gains energy under the dead load alone proves labellings unstable. The **pool** keeps
both as packed bits and rows of numbers, and asks them all about many labellings at once. Everything is scaled as
in `Template`.

Bounds are those of associative friction without effective area; nothing else is modular.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit import Motion, Proof, State
from jld_core.program import Template
from jld_explore.space import Words, as_words

ROUND: Final = 32
"""Labellings solved between two questions to the pool, whatever the number of workers."""

FEW: Final = 8
"""The same for scenes so small that no workers are asked: the fewer, the more a solve is spared."""

_KEPT_FORCES: Final = 6000
_KEPT_MECHANISMS: Final = 3000
_PAIRS: Final = 1 << 21
"""Labellings × entries looked at in one step."""


@dataclass(frozen=True)
class Forces:
    """Forces in equilibrium at λ = load. dry, inner: (m,) faces where they are admissible under that label."""

    load: float
    dry: Bools
    inner: Bools


@dataclass(frozen=True)
class Mechanism:
    """Velocities with b_λ·u = 1, or such that gain energy with b_λ·u ≥ 0 (`falls`).

    constant: −b·u. dry, inner: (m,) dissipation of each face under either label, inf where there is no bound.
    """

    constant: float
    dry: Floats
    inner: Floats
    falls: bool


@dataclass(frozen=True)
class Proofs:
    """What one solve leaves behind."""

    forces: tuple[Forces, ...] = ()
    mechanisms: tuple[Mechanism, ...] = ()


@dataclass(frozen=True)
class Bounds:
    """What the pool knows of k labellings: λ between low and high (±inf where nothing is known).

    unstable: (k,) proven to stand for no λ ≥ 0.
    """

    low: Floats
    high: Floats
    unstable: Bools

    def take(self, rows: Ints | Bools) -> Bounds:
        """The same of some rows."""
        return Bounds(self.low[rows], self.high[rows], self.unstable[rows])

    def tightened(self, other: Bounds) -> Bounds:
        """Both taken together."""
        return Bounds(
            np.maximum(self.low, other.low),
            np.minimum(self.high, other.high),
            self.unstable | other.unstable,
        )


def unknown(count: int) -> Bounds:
    """Bounds of labellings nothing is known of."""
    return Bounds(np.full(count, -np.inf), np.full(count, np.inf), np.zeros(count, dtype=bool))


def forces_of(template: Template, state: State, labels: Bits) -> Forces:
    """An admissible state of one labelling, with every label it admits on every face."""
    own = np.asarray(labels, dtype=bool)
    other = template.yield_set.slack(state.forces, ~own) >= max(2.0 * state.error, 0.0)
    # a resultant that a label drops is zero only in the states of that label
    other &= _alike(template)
    return Forces(state.load, own | other, ~own | other)


def mechanism_of(template: Template, motion: Motion, labels: Bits, *, falls: bool = False) -> Mechanism:
    """A motion of finite dissipation under one labelling, with what it dissipates under every label."""
    own = np.asarray(labels, dtype=bool)
    every = np.ones(len(own), dtype=bool)
    sets, jumps = template.yield_set, motion.jumps
    with np.errstate(invalid="ignore"):
        known = (sets.margin(jumps, ~own) >= 0.0) & _alike(template)
        values = [sets.dissipation(jumps, label) for label in (every, ~every)]
    dry = np.where(own | known, values[0], np.inf)
    inner = np.where(~own | known, values[1], np.inf)
    return Mechanism(float(-template.dead @ motion.velocity), dry, inner, falls)


_ALIKE: WeakKeyDictionary[Template, Bools] = WeakKeyDictionary()


def _alike(template: Template) -> Bools:
    """(m,) True where both labels of a face keep the same resultants."""
    if template not in _ALIKE:
        every = np.ones(len(template.assembly.interfaces), dtype=bool)
        sets = template.yield_set
        _ALIKE[template] = (sets.active(every) == sets.active(~every)).all(axis=1)
    return _ALIKE[template]


def proofs_of(template: Template, proof: Proof, labels: Bits) -> Proofs:
    """What a finished limit analysis of one labelling proves about others."""
    forces = () if proof.state is None else (forces_of(template, proof.state, labels),)
    mechanisms = [] if proof.motion is None else [mechanism_of(template, proof.motion, labels)]
    if proof.collapse_below_zero is not None:
        mechanisms.append(mechanism_of(template, proof.collapse_below_zero, labels, falls=True))
    return Proofs(forces, tuple(mechanisms))


class Pool:
    """All certificates of one study that are worth their place.

    faces: m. group: (g, m) face permutations that leave λ as it is. What is kept depends on what was added
    and asked, in that order, and on nothing else.
    """

    def __init__(
        self,
        faces: int,
        group: Ints,
        *,
        forces: int = _KEPT_FORCES,
        mechanisms: int = _KEPT_MECHANISMS,
    ) -> None:
        self.faces, self.group = faces, group
        self._forces = _ForceTable(faces, forces)
        self._mechanisms = _MechanismTable(faces, mechanisms)

    def __len__(self) -> int:
        return len(self._forces) + len(self._mechanisms)

    def add(self, proofs: Proofs) -> None:
        """Take in what a solve left behind; the least useful entries make room."""
        for forces in proofs.forces:
            self._forces.add(forces)
        for mechanism in proofs.mechanisms:
            self._mechanisms.add(mechanism)

    def ask(self, labellings: Bits, since: int = 0) -> Bounds:
        """Bounds on λ of labellings (k, m). since: look only at what was added after `mark` returned this."""
        known = unknown(len(labellings))
        if not len(labellings):
            return known
        for permutation in self.group:
            image = labellings[:, permutation]
            words = as_words(image), as_words(~image)
            low = self._forces.bounds(words, since)
            high, unstable = self._mechanisms.bounds(image, words, since)
            known = known.tightened(Bounds(low, high, unstable))
        return known

    def mark(self) -> int:
        """A point in time for `ask`."""
        return max(self._forces.clock, self._mechanisms.clock)

    def tick(self) -> int:
        """Begin a new point in time and return it: what is added from here on is later."""
        now = self.mark() + 1
        self._forces.clock = self._mechanisms.clock = now
        return now


class _Table:
    """Entries with the time they were added and how often they were the best answer.

    most: entries at the most. layout: fields of one besides those two.
    """

    def __init__(self, most: int, layout: list[Any]) -> None:
        self.most, self.clock = most, 0
        self._count = 0
        self._room = np.zeros(64, dtype=[("born", "i8"), ("used", "i8"), *layout])

    def __len__(self) -> int:
        return self._count

    @property
    def entries(self) -> NDArray[np.void]:
        """All entries, the older first."""
        return self._room[: self._count]

    def put(self, *values: Any) -> None:
        """Add an entry; where there are too many, half of them go."""
        if len(self) >= self.most:
            # the least used, the older first
            order = np.lexsort((self.entries["born"], self.entries["used"]))
            kept = np.delete(self.entries, order[: self.most // 2])
            kept["used"] //= 2
            self._room, self._count = kept, len(kept)
        if self._count == len(self._room):
            self._room = np.concatenate([self.entries, np.zeros(max(64, self._count), dtype=self._room.dtype)])
        self._room[self._count] = (self.clock, 0, *values)
        self._count += 1

    def since(self, time: int) -> tuple[Ints, NDArray[np.void]]:
        """Positions of what was added at a time or later, and those entries."""
        rows = np.flatnonzero(self.entries["born"] >= time)
        return rows, self.entries[rows]

    def count(self, rows: Ints) -> None:
        """Note which entries were the best answers."""
        self.entries["used"] += np.bincount(rows, minlength=len(self))


class _ForceTable(_Table):
    def __init__(self, faces: int, most: int) -> None:
        words = -(-faces // 64)
        super().__init__(most, [("load", "f8"), ("not_dry", "u8", (words,)), ("not_inner", "u8", (words,))])

    def add(self, forces: Forces) -> None:
        self.put(forces.load, *as_words(~np.array([forces.dry, forces.inner])))

    def bounds(self, words: tuple[Words, Words], since: int) -> Floats:
        """(k,) highest load of forces that labellings admit. words: their dry faces, and their inner ones."""
        dry, inner = words
        low = np.full(len(dry), -np.inf)
        rows, some = self.since(since)
        if not rows.size:
            return low
        for part in _parts(len(dry), rows.size):
            fits = _covered(dry[part], inner[part], some["not_dry"], some["not_inner"])
            value = np.where(fits, some["load"], -np.inf)
            best = value.argmax(axis=1)
            low[part] = value[np.arange(len(best)), best]
            self.count(rows[best[np.isfinite(low[part])]])
        return low


class _MechanismTable(_Table):
    def __init__(self, faces: int, most: int) -> None:
        words = -(-faces // 64)
        bits = [("not_dry", "u8", (words,)), ("not_inner", "u8", (words,))]
        super().__init__(most, [("constant", "f8"), ("falls", "?"), ("gain", "f8", (faces,)), *bits])

    def add(self, mechanism: Mechanism) -> None:
        values = np.array([mechanism.dry, mechanism.inner])
        finite = np.isfinite(values)
        values[~finite] = 0.0
        # sums in another order may round differently: the bound is raised by more than that
        size = abs(mechanism.constant) + float(abs(values).max(axis=0).sum())
        constant = mechanism.constant + float(values[1].sum()) + tolerances.SUMMATION * size
        self.put(constant, mechanism.falls, values[0] - values[1], *as_words(~finite))

    def bounds(self, labellings: Bits, words: tuple[Words, Words], since: int) -> tuple[Floats, Bools]:
        """(k,) lowest bound on λ over the mechanisms, and (k,) whether one proves instability.

        labellings: (k, m); words: their dry faces, and their inner ones.
        """
        high, unstable = np.full(len(labellings), np.inf), np.zeros(len(labellings), dtype=bool)
        rows, some = self.since(since)
        if not rows.size:
            return high, unstable
        falls = some["falls"]
        (dry, inner), numbers = words, labellings.astype(np.float64)
        for part in _parts(len(labellings), rows.size):
            value = some["constant"] + numbers[part] @ some["gain"].T
            fits = _covered(dry[part], inner[part], some["not_dry"], some["not_inner"])
            below = fits & falls & (value < -tolerances.ROUNDING)
            unstable[part] = below.any(axis=1)
            value[~fits | falls] = np.inf
            best = value.argmin(axis=1)
            high[part] = value[np.arange(len(best)), best]
            unstable[part] |= high[part] < -tolerances.ROUNDING
            first = np.where(below.any(axis=1), below.argmax(axis=1), best)
            told = below.any(axis=1) | np.isfinite(high[part])
            self.count(rows[first[told]])
        return high, unstable


def _covered(dry: Words, inner: Words, not_dry: Words, not_inner: Words) -> Bools:
    """(k, p) True where no dry face of a labelling is excluded as dry, and no inner one as inner."""
    hit = np.zeros((len(dry), len(not_dry)), dtype=np.uint64)
    for word in range(dry.shape[1]):
        hit |= dry[:, word, None] & not_dry[None, :, word]
        hit |= inner[:, word, None] & not_inner[None, :, word]
    return np.asarray(hit == 0)


def _parts(rows: int, entries: int) -> list[slice]:
    step = max(1, _PAIRS // max(1, entries))
    return [slice(low, min(low + step, rows)) for low in range(0, rows, step)]
