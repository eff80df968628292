"""Labellings drawn from a formula many at a time, and ruled out with all that fall for the same reason.

Labellings drawn together would fall for one reason were they alike, so each is drawn with random preferences. Once
one has given a conflict its **neighbours**, the same labelling with one face of the conflict undecided, nearly always
fall as well, for another reason, and cost no drawing.

Shrinking is the kernel's, which other threads may call meanwhile: with several of them, labellings are drawn while what
was drawn before is shrunk. What comes of them is taken in the order in which they were drawn, so that under one load
the same is found however quick a thread is.
"""

from __future__ import annotations

import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.lanes import Shrinking
from jld_core.limit import Fallen
from jld_explore.drivers.exact.cubes import EVERYTHING, Cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.shrinking import AnyRelaxation, Conflict, conflict_of

_DRAWN: Final = 8
"""Labellings drawn together at the most."""

_NEIGHBOURS: Final = 3
"""Neighbours of each labelling that are shrunk too."""

_TRIES: Final = 4
"""Single faces tried in vain before a conflict is taken as it is."""

_INNER: Final = True
"""Whether inner faces are tried before dry ones: a quarter fewer conflicts of weak walls."""

_DRY: Final = 0.3
"""Share of faces that a labelling had better have dry, at random: long blocks are what is hard to refute."""

_SOON: Final = 5.0
"""Seconds of all threads until it is judged what they do, and over which."""

_STRAINED: Final = 0.58
"""Share of them spent drawing from which several processes, which each draw and hear of each other, are sooner done."""


@dataclass
class Catch:
    """What was found: conflicts; labellings (m,) that nothing refutes; exhausted: no labelling is left (in a cube)."""

    conflicts: list[Conflict] = field(default_factory=list)
    unrefuted: list[Bits] = field(default_factory=list)
    exhausted: bool = False


@dataclass(frozen=True)
class _Drawn:
    """Labellings (k, m) that are being shrunk, to what threshold, and what will have come of them, with the seconds."""

    labellings: Bits
    threshold: float
    fallen: Future[tuple[list[Fallen], float]]


class Hunt:
    """Conflicts of one formula after the other. free: (m,) faces that may take either label. seed: of preferences.

    threads: how many may be in the kernel at a time; more than one pay where the kernel solves many at a time.
    """

    def __init__(self, relaxation: AnyRelaxation, free: Bools, seed: int, threads: int = 1) -> None:
        self._relaxation, self._free = relaxation, free
        self._rng = np.random.default_rng([seed, 2])
        self._many = relaxation.many
        self._formula: Formula | None = None
        self._known: set[tuple[bytes, bytes]] = set()
        self._threads = threads if self._many else 1
        self._pool = ThreadPoolExecutor(threads) if self._threads > 1 else None
        self._under_way: deque[_Drawn] = deque()
        self._drawing, self._shrinking = 0.0, 0.0

    @property
    def strained(self) -> bool:
        """Whether drawing, which is one thread's, takes so much of the time that others wait for it."""
        total = self._drawing + self._shrinking
        return total > _SOON and self._drawing > _STRAINED * total

    def begin(self, formula: Formula) -> None:
        """Go on with another formula; what was begun with the last one is forgotten."""
        self._formula = formula
        self._known = set()
        self._forget()

    def close(self) -> None:
        """Let threads go."""
        self._forget()
        if self._pool is not None:
            self._pool.shutdown(wait=False)

    def _forget(self) -> None:
        for one in self._under_way:
            one.fallen.cancel()
        self._under_way.clear()

    def step(self, threshold: float, cube: Cube = EVERYTHING) -> Catch:
        """Conflicts of some labellings. threshold: scaled λ, not lower than before in this formula. cube: labels that
        those drawn have, the same as before while threads are at work."""
        caught = Catch()
        assert self._formula is not None
        self._formula.rise(threshold)
        if self._pool is not None:
            self._step_in_threads(self._pool, threshold, cube, caught)
            return caught
        drawn = self._draw(cube)
        caught.exhausted = not len(drawn)
        if len(drawn) and self._many:
            how, seed = self._how()
            self._sort(drawn, threshold, self._shrink(drawn, threshold, how, seed)[0], caught)
        elif len(drawn):
            self._shrink_one(drawn[0], threshold, caught)
        return caught

    def _step_in_threads(self, pool: ThreadPoolExecutor, threshold: float, cube: Cube, caught: Catch) -> None:
        """Draw until there is work for all threads and one portion more, and take what was drawn first."""
        began = time.thread_time()
        ahead = self._threads + 1 if len(self._known) >= _DRAWN else 1
        while len(self._under_way) < ahead:
            drawn = self._draw(cube)
            if not len(drawn):
                break
            work = partial(self._shrink, drawn, threshold, *self._how())
            self._under_way.append(_Drawn(drawn, threshold, pool.submit(work)))
        caught.exhausted = not self._under_way
        if self._under_way:
            first = self._under_way.popleft()
            fallen, seconds = first.fallen.result()
            self._shrinking += seconds
            self._sort(first.labellings, first.threshold, fallen, caught)
        self._drawing += time.thread_time() - began
        if self._drawing + self._shrinking > 2.0 * _SOON:
            self._drawing, self._shrinking = 0.5 * self._drawing, 0.5 * self._shrinking

    def _draw(self, cube: Cube) -> Bits:
        """Labellings (k, m) of the formula, none where none is left."""
        formula = self._formula
        assert formula is not None
        # few at first: where one conflict rules out nearly all, the others were drawn in vain
        room = min(_DRAWN, 1 + len(self._known)) if self._many else 1
        drawn: list[Bits] = []
        while len(drawn) < room:
            labels = formula.next(cube.faces, cube.labels, preferred=self._preferred())
            if labels is None:
                break
            # not drawn again while it is at hand; the conflict that it gives says all that this does, and more
            formula.set_aside(np.arange(len(labels)), labels)
            drawn.append(labels)
        return np.array(drawn, dtype=bool).reshape(len(drawn), len(self._free))

    def _how(self) -> tuple[Shrinking, int]:
        """How labellings are shrunk, and the seed of their neighbours."""
        how = Shrinking(neighbours=_NEIGHBOURS if len(self._known) >= _DRAWN else 0, tries=_TRIES, inner=_INNER)
        return how, int(self._rng.integers(2**32))

    def _shrink(self, drawn: Bits, threshold: float, how: Shrinking, seed: int) -> tuple[list[Fallen], float]:
        """What becomes of labellings (k, m) and of their neighbours, all in one call; seconds of this thread."""
        began = time.thread_time()
        found = self._relaxation.shrink(drawn, self._free, np.full(len(drawn), threshold), how, seed)
        return found, time.thread_time() - began

    def _sort(self, drawn: Bits, threshold: float, fallen: list[Fallen], caught: Catch) -> None:
        """Conflicts, and labellings that nothing refutes, among what became of labellings (k, m)."""
        for one in fallen:
            labels = drawn[one.labelling]
            if one.bound is not None:
                faces = np.flatnonzero(one.decided)
                self._take(Conflict(faces, labels[faces], min(one.bound, threshold)), caught)
            elif one.drawn:
                if one.carries:
                    caught.unrefuted.append(labels)
                else:
                    # what the kernel leaves open is worth another route, since else it has to be evaluated
                    self._shrink_one(labels, threshold, caught)

    def _shrink_one(self, labels: Bits, threshold: float, caught: Catch) -> None:
        found = conflict_of(self._relaxation, labels, self._free, threshold)
        if found is None:
            caught.unrefuted.append(labels)
        else:
            self._take(found, caught)

    def _take(self, conflict: Conflict, caught: Catch) -> None:
        """Rule out what a conflict does, unless that was done before."""
        assert self._formula is not None
        name = conflict.faces.tobytes(), conflict.labels.tobytes()
        if name not in self._known:
            self._known.add(name)
            caught.conflicts.append(conflict)
            self._formula.forbid(conflict.faces, conflict.labels, conflict.bound)

    def _preferred(self) -> Bits | None:
        """Labels (m,) that a drawn labelling had better have."""
        if not self._many:
            return None
        assert self._formula is not None
        return self._rng.random(len(self._formula.space.fixed)) < _DRY
