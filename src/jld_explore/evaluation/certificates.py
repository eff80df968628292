"""Store bounds that past solves prove for labellings not yet solved.

**Forces** in equilibrium at λ are a lower bound for every labelling that admits them on every face (docs/method.md
(6.1)).
A face is free if the forces are admissible as dry and as inner, so forces cover a sub-cube of labellings.
A **mechanism** is an upper bound for every labelling for which its dissipation is finite (docs/method.md (6.2)).
The bound is a constant plus one number per face and label.
A mechanism that gains energy under the dead load alone proves labellings unstable.
The **pool** keeps both as packed bits and rows of numbers and evaluates all of them for many labellings at once.
All values are scaled as in `Template`.

The bounds hold for associative friction without effective area; other models do not support them.
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
from jld_explore.space.labelling import Words, as_words

ROUND: Final = 32
"""Labellings solved between two queries of the pool, for any number of workers."""

FEW: Final = 8
"""Labellings solved between two queries for small scenes, which use no workers: small rounds avoid more solves."""

_KEPT_FORCES: Final = 6000
"""Default largest number of force states in a pool."""
_KEPT_MECHANISMS: Final = 3000
"""Default largest number of mechanisms in a pool."""
_PAIRS: Final = 1 << 21
"""Largest number of pairs (labelling, entry) compared in one step; limits temporary memory."""


@dataclass(frozen=True)
class Forces:
    """Forces in equilibrium at a load factor, with the labels that admit them.

    Attributes
    ----------
    load : float
        Load factor λ, scaled.
    dry : (m,) bool array
        Faces on which the forces are admissible when dry.
    inner : (m,) bool array
        Faces on which the forces are admissible when inner.
    """

    load: float
    dry: Bools
    inner: Bools


@dataclass(frozen=True)
class Mechanism:
    """Velocities u with b_λ·u = 1 and their dissipation under either label of each face.

    Attributes
    ----------
    constant : float
        −b·u, the negative work of the dead load, scaled.
    dry : (m,) float array
        Dissipation of each face when dry, inf without a bound.
    inner : (m,) float array
        Dissipation of each face when inner, inf without a bound.
    falls : bool
        True for velocities with b_λ·u ≥ 0 that gain energy and so prove instability.
    """

    constant: float
    dry: Floats
    inner: Floats
    falls: bool


@dataclass(frozen=True)
class Proofs:
    """Lower and upper bounds that one solve proves for other labellings.

    Attributes
    ----------
    forces : tuple of Forces
        Lower bounds.
    mechanisms : tuple of Mechanism
        Upper bounds and proofs of instability.
    """

    forces: tuple[Forces, ...] = ()
    mechanisms: tuple[Mechanism, ...] = ()


@dataclass(frozen=True)
class Bounds:
    """Bounds on λ of k labellings that a pool has proven.

    Attributes
    ----------
    low : (k,) float array
        Lower bounds on λ, scaled; −inf if unknown.
    high : (k,) float array
        Upper bounds on λ, scaled; inf if unknown.
    unstable : (k,) bool array
        True if proven that the labelling stands for no λ ≥ 0.
    """

    low: Floats
    high: Floats
    unstable: Bools

    def take(self, rows: Ints | Bools) -> Bounds:
        """Return the bounds of selected rows (indices or boolean mask)."""
        return Bounds(self.low[rows], self.high[rows], self.unstable[rows])

    def tightened(self, other: Bounds) -> Bounds:
        """Return the tighter of these and other bounds, row by row."""
        return Bounds(
            np.maximum(self.low, other.low),
            np.minimum(self.high, other.high),
            self.unstable | other.unstable,
        )


def unknown(count: int) -> Bounds:
    """Return the trivial bounds (−inf, inf) of `count` labellings."""
    return Bounds(np.full(count, -np.inf), np.full(count, np.inf), np.zeros(count, dtype=bool))


def forces_of(template: Template, state: State, labels: Bits) -> Forces:
    """Convert an admissible state of one labelling to `Forces`, with all labels that admit it."""
    own = np.asarray(labels, dtype=bool)
    other = template.yield_set.slack(state.forces, ~own) >= max(2.0 * state.error, 0.0)
    # A label that drops a resultant admits only states in which that resultant is zero.
    other &= _alike(template)
    return Forces(state.load, own | other, ~own | other)


def mechanism_of(template: Template, motion: Motion, labels: Bits, *, falls: bool = False) -> Mechanism:
    """Convert a motion of finite dissipation to a `Mechanism`, with its dissipation per label."""
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
"""Cached results of `_alike` per template."""


def _alike(template: Template) -> Bools:
    """Return an (m,) mask of the faces whose two labels keep the same resultants."""
    if template not in _ALIKE:
        every = np.ones(len(template.assembly.interfaces), dtype=bool)
        sets = template.yield_set
        _ALIKE[template] = (sets.active(every) == sets.active(~every)).all(axis=1)
    return _ALIKE[template]


def proofs_of(template: Template, proof: Proof, labels: Bits) -> Proofs:
    """Return the bounds that a finished limit analysis of one labelling proves for others.

    Parameters
    ----------
    template : Template
        Program of the assembly.
    proof : Proof
        Result of the limit analysis, with its state and motions.
    labels : (m,) bool array
        Labelling that was analysed, True = dry.

    Returns
    -------
    Proofs
        Forces and mechanisms; empty where the analysis found none.
    """
    forces = () if proof.state is None else (forces_of(template, proof.state, labels),)
    mechanisms = [] if proof.motion is None else [mechanism_of(template, proof.motion, labels)]
    if proof.collapse_below_zero is not None:
        mechanisms.append(mechanism_of(template, proof.collapse_below_zero, labels, falls=True))
    return Proofs(forces, tuple(mechanisms))


class Pool:
    """Bounds from the past solves of one study, limited in number.

    The content depends only on the additions and queries and on their order.

    Parameters
    ----------
    faces : int
        Number m of faces.
    group : (g, m) int array
        Face permutations that leave λ unchanged.
    forces : int
        Largest number of force states kept.
    mechanisms : int
        Largest number of mechanisms kept.
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
        """Return the number of entries."""
        return len(self._forces) + len(self._mechanisms)

    def add(self, proofs: Proofs) -> None:
        """Add the bounds of one solve; the least used entries are dropped when a table is full."""
        for forces in proofs.forces:
            self._forces.add(forces)
        for mechanism in proofs.mechanisms:
            self._mechanisms.add(mechanism)

    def ask(self, labellings: Bits, since: int = 0) -> Bounds:
        """Compute bounds on λ of labellings from all entries and all symmetries.

        Parameters
        ----------
        labellings : (k, m) bool array
            Labels, True = dry.
        since : int
            Time from `mark` or `tick`; entries added before it are ignored.

        Returns
        -------
        Bounds
            Bounds of the k labellings, scaled.
        """
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
        """Return the current time of the pool, for use in `ask`."""
        return max(self._forces.clock, self._mechanisms.clock)

    def tick(self) -> int:
        """Advance the time of the pool and return it; later additions have this time."""
        now = self.mark() + 1
        self._forces.clock = self._mechanisms.clock = now
        return now


class _Table:
    """Table of entries with the time of their addition and the number of queries they decided.

    Parameters
    ----------
    most : int
        Largest number of entries.
    layout : list
        NumPy fields of an entry besides `born` and `used`.
    """

    def __init__(self, most: int, layout: list[Any]) -> None:
        self.most, self.clock = most, 0
        self._count = 0
        self._room = np.zeros(64, dtype=[("born", "i8"), ("used", "i8"), *layout])

    def __len__(self) -> int:
        """Return the number of entries."""
        return self._count

    @property
    def entries(self) -> NDArray[np.void]:
        """All entries, oldest first."""
        return self._room[: self._count]

    def put(self, *values: Any) -> None:
        """Add an entry; if the table is full, first drop the least used half."""
        if len(self) >= self.most:
            # Drop the least used entries first, and the older ones among equals.
            order = np.lexsort((self.entries["born"], self.entries["used"]))
            kept = np.delete(self.entries, order[: self.most // 2])
            kept["used"] //= 2
            self._room, self._count = kept, len(kept)
        if self._count == len(self._room):
            self._room = np.concatenate([self.entries, np.zeros(max(64, self._count), dtype=self._room.dtype)])
        self._room[self._count] = (self.clock, 0, *values)
        self._count += 1

    def since(self, time: int) -> tuple[Ints, NDArray[np.void]]:
        """Return positions and content of the entries added at a given time or later."""
        rows = np.flatnonzero(self.entries["born"] >= time)
        return rows, self.entries[rows]

    def count(self, rows: Ints) -> None:
        """Increase the use count of the entries that gave the best bounds."""
        self.entries["used"] += np.bincount(rows, minlength=len(self))


class _ForceTable(_Table):
    """Table of force states as lower bounds on λ."""

    def __init__(self, faces: int, most: int) -> None:
        words = -(-faces // 64)
        super().__init__(most, [("load", "f8"), ("not_dry", "u8", (words,)), ("not_inner", "u8", (words,))])

    def add(self, forces: Forces) -> None:
        """Add one force state."""
        self.put(forces.load, *as_words(~np.array([forces.dry, forces.inner])))

    def bounds(self, words: tuple[Words, Words], since: int) -> Floats:
        """Return (k,) lower bounds: the highest load of forces that each labelling admits.

        `words` holds the dry faces and the inner faces of the labellings as 64-bit words.
        """
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
    """Table of mechanisms as upper bounds on λ and proofs of instability."""

    def __init__(self, faces: int, most: int) -> None:
        words = -(-faces // 64)
        bits = [("not_dry", "u8", (words,)), ("not_inner", "u8", (words,))]
        super().__init__(most, [("constant", "f8"), ("falls", "?"), ("gain", "f8", (faces,)), *bits])

    def add(self, mechanism: Mechanism) -> None:
        """Add one mechanism."""
        values = np.array([mechanism.dry, mechanism.inner])
        finite = np.isfinite(values)
        values[~finite] = 0.0
        # Summation order affects rounding; raising the constant by more than the rounding keeps the bound safe.
        size = abs(mechanism.constant) + float(abs(values).max(axis=0).sum())
        constant = mechanism.constant + float(values[1].sum()) + tolerances.SUMMATION * size
        self.put(constant, mechanism.falls, values[0] - values[1], *as_words(~finite))

    def bounds(self, labellings: Bits, words: tuple[Words, Words], since: int) -> tuple[Floats, Bools]:
        """Return (k,) upper bounds on λ and a (k,) mask of labellings proven unstable.

        `labellings` is (k, m); `words` holds their dry faces and inner faces as 64-bit words.
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
    """Return (k, p) True where entry p covers every dry and every inner face of labelling k."""
    hit = np.zeros((len(dry), len(not_dry)), dtype=np.uint64)
    for word in range(dry.shape[1]):
        hit |= dry[:, word, None] & not_dry[None, :, word]
        hit |= inner[:, word, None] & not_inner[None, :, word]
    return np.asarray(hit == 0)


def _parts(rows: int, entries: int) -> list[slice]:
    """Split rows into slices of at most `_PAIRS` pairs of row and entry."""
    step = max(1, _PAIRS // max(1, entries))
    return [slice(low, min(low + step, rows)) for low in range(0, rows, step)]
