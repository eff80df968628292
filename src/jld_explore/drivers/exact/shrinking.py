"""From one labelling that is too weak to all labellings that are too weak for the same reason, many side by side.

A mechanism bounds λ of every labelling by a sum over faces (docs/method.md (6.2)), so faces whose label changes
that sum by less than what is to spare are free. Solving again with those undecided moves
the mechanism to the faces that are left; what cannot be freed any more is the **conflict**: labels that no labelling
worth finding has together. Such a shrinking asks for one relaxation after the other; a pool of them asks for one of
each at a time, which the kernel solves in one call.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.limit import CaseRelaxation, DualBound, Relaxation

AnyRelaxation = Relaxation | CaseRelaxation
"""What refutes partial labellings, under one load or several."""

_TRIES: Final = 2
"""Single faces tried in vain, the most promising first, before a conflict is taken as it is."""


@dataclass(frozen=True)
class Conflict:
    """No labelling with `labels` (k,) on `faces` (k,) has a scaled λ above `bound`."""

    faces: Ints
    labels: Bits
    bound: float


Shrinking = Generator[Bools, DualBound | None, Conflict | None]
"""Yields which faces (m,) are decided, is sent what refutes that or None, and returns a conflict or None."""


def shrinking(labels: Bits, decided: Bools, threshold: float) -> Shrinking:
    """A conflict that a labelling is one example of; None where it may reach the threshold.

    labels: (m,) True dry. decided: (m,) faces that matter at first. threshold: scaled λ.
    """
    decided = decided.copy()
    found = yield decided
    if found is None:
        return None
    tried: set[int] = set()
    vain = 0
    while True:
        order = _order(found, decided)
        # what the mechanism at hand can do without, all together
        freed = order[np.cumsum(found.cost[order]) < found.excess]
        if freed.size:
            decided[freed] = False
            sent = yield decided
            if sent is None:
                # the mechanism at hand proves this much whatever comes of the next solve
                return _conflict(labels, decided, threshold)
            found = sent
            continue
        bound = min(found.bound, threshold)
        face = next((f for f in order.tolist() if f not in tried), None)
        if face is None or vain >= _TRIES:
            return _conflict(labels, decided, bound)
        tried.add(face)
        decided[face] = False
        sent = yield decided
        if sent is None:
            decided[face] = True
            vain += 1
        else:
            found = sent


def _conflict(labels: Bits, decided: Bools, bound: float) -> Conflict:
    faces = np.flatnonzero(decided)
    return Conflict(faces, labels[faces], bound)


def _order(found: DualBound, decided: Bools) -> Ints:
    """Decided faces in the order of what the mechanism would lose by them."""
    faces = np.flatnonzero(decided)
    return np.asarray(faces[np.argsort(found.cost[faces], kind="stable")])


@dataclass
class _Running:
    """One shrinking: what it asks for now; drawn: it began with a whole labelling, not with a neighbour of one."""

    labels: Bits
    threshold: float
    drawn: bool
    work: Shrinking
    asked: Bools
    first: bool = True


@dataclass(frozen=True)
class Finished:
    """labels (m,) a shrinking began with, whether they were drawn whole, and its conflict, None where none stands."""

    labels: Bits
    drawn: bool
    conflict: Conflict | None


class Shrinkings:
    """Shrinkings side by side. candidates: (m,) faces that may take either label."""

    def __init__(self, relaxation: AnyRelaxation, candidates: Bools) -> None:
        self._relaxation, self._candidates = relaxation, candidates
        self._running: list[_Running] = []

    def __len__(self) -> int:
        return len(self._running)

    def clear(self) -> None:
        """Forget all that are not finished."""
        self._running = []

    def begin(self, labels: Bits, threshold: float, undecided: int | None = None) -> None:
        """Begin one. labels: (m,) True dry; threshold: scaled λ; undecided: a face that is, from the start."""
        decided = self._candidates.copy()
        if undecided is not None:
            decided[undecided] = False
        work = shrinking(labels, decided, threshold)
        self._running.append(_Running(labels, threshold, undecided is None, work, next(work)))

    def step(self) -> list[Finished]:
        """One relaxation of each; what is finished with it, in the order in which it was begun."""
        running, ended = self._running, []
        if not running:
            return []
        answers = self._relaxation.refute_all(
            np.array([one.labels for one in running]),
            np.array([self._candidates & ~one.asked for one in running]),
            np.array([one.threshold for one in running]),
            # a whole labelling that nothing refutes has to be evaluated; elsewhere a face less is freed, no more
            thorough=np.array([one.first and one.drawn for one in running]),
        )
        self._running = []
        for one, answer in zip(running, answers, strict=True):
            one.first = False
            try:
                one.asked = one.work.send(answer)
                self._running.append(one)
            except StopIteration as stop:
                ended.append(Finished(one.labels, one.drawn, stop.value))
        return ended


def conflict_of(relaxation: AnyRelaxation, labels: Bits, candidates: Bools, threshold: float) -> Conflict | None:
    """A conflict that the labelling is one example of; None where it may reach the threshold.

    labels: (m,) True dry. candidates: (m,) faces that may take either label. threshold: scaled λ.
    """
    alone = Shrinkings(relaxation, candidates)
    alone.begin(labels, threshold)
    while True:
        for finished in alone.step():
            return finished.conflict
