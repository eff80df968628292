"""Labellings drawn from a formula many at a time, and ruled out with all that fall for the same reason.

Labellings drawn together would fall for one reason were they alike, so each is drawn with random preferences. Once
one has given a conflict its **neighbours**, the same labelling with one face of the conflict undecided, nearly always
fall as well, for another reason, and cost no drawing. Before all of a labelling is shrunk, parts of it are (`windows`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.batch import ConflictRequest, MinimizationOptions
from jld_core.limit import AnyRelaxation, MinimizedConflict
from jld_explore.drivers.exact.conflict_minimization import Conflict, Mechanism, conflict_of
from jld_explore.drivers.exact.cubes import EVERYTHING, Cube
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.windows import WindowStatistics, windows_of

_DRAWN: Final = 8
"""Labellings drawn together at the most."""

_NEIGHBOURS: Final = 3
"""Neighbours of each labelling that are shrunk too."""

_INSIDE: Final = 1
"""The same of labellings that are refuted in a window, where all that refute them are taken."""

_TRIES: Final = 4
"""Single faces tried in vain before a conflict is taken as it is."""

_INNER: Final = True
"""Whether inner faces are tried before dry ones: a quarter fewer conflicts of weak walls."""

_DRY: Final = 0.3
"""Share of faces that a labelling had better have dry, at random: long blocks are what is hard to refute."""

_OTHER_ROUTE: Final = Lock()
"""The batch solver may be called by several threads, the conic solver by one at a time."""


@dataclass
class ConflictBatch:
    """What was found: conflicts; labellings (m,) that nothing refutes; exhausted: no labelling is left (in a cube)."""

    conflicts: list[Conflict] = field(default_factory=list)
    unrefuted: list[Bits] = field(default_factory=list)
    exhausted: bool = False


class ConflictGenerator:
    """Conflicts of one formula after the other. free: (m,) faces that may take either label. seed: of preferences."""

    def __init__(self, relaxation: AnyRelaxation, free: Bools, seed: int) -> None:
        self._relaxation, self._free = relaxation, free
        self._rng = np.random.default_rng([seed, 2])
        self._many = relaxation.many
        self._formula: Formula | None = None
        self._known: set[tuple[bytes, bytes]] = set()
        self._hear: Callable[[], None] = _nothing
        self._windows: tuple[Bits, ...] = ()
        self._statistics = WindowStatistics(0)

    def begin(self, formula: Formula, hear: Callable[[], None] | None = None) -> None:
        """Go on with another formula. hear: called before each draw, to take in what others have found."""
        self._formula, self._hear = formula, hear or _nothing
        self._known = set()
        # small blocks fall for cracks through the whole, which windows only delay: walls take half as long again
        self._windows = windows_of(formula.space.assembly) if self._many and formula.blocks is None else ()
        self._statistics = WindowStatistics(len(self._windows))

    def step(self, threshold: float, cube: Cube = EVERYTHING) -> ConflictBatch:
        """Conflicts of some labellings. threshold: scaled λ, not lower than before in this formula. cube: labels that
        those drawn have."""
        caught = ConflictBatch()
        assert self._formula is not None
        self._formula.rise(threshold)
        drawn = self._draw(cube)
        caught.exhausted = not len(drawn)
        if len(drawn) and self._many:
            self._sort(drawn, threshold, self._minimize(drawn, threshold), caught)
        elif len(drawn):
            self._minimize_one(drawn[0], threshold, caught)
        return caught

    def _draw(self, cube: Cube) -> Bits:
        """Labellings (k, m) of the formula, none where none is left."""
        formula = self._formula
        assert formula is not None
        # few at first: where one conflict rules out nearly all, the others were drawn in vain
        room = min(_DRAWN, 1 + len(self._known)) if self._many else 1
        drawn: list[Bits] = []
        while len(drawn) < room:
            self._hear()
            labels = formula.next(cube.faces, cube.labels, preferred=self._preferred())
            if labels is None:
                break
            # not drawn again while it is at hand; the conflict that it gives says all that this does, and more
            formula.set_aside(np.arange(len(labels)), labels)
            drawn.append(labels)
        return np.array(drawn, dtype=bool).reshape(len(drawn), len(self._free))

    def _how(self) -> tuple[MinimizationOptions, int]:
        """How labellings are shrunk, and the seed of their neighbours."""
        how = MinimizationOptions(
            neighbours=_NEIGHBOURS if len(self._known) >= _DRAWN else 0, tries=_TRIES, inner=_INNER
        )
        return how, int(self._rng.integers(2**32))

    def _minimize(self, drawn: Bits, threshold: float) -> list[MinimizedConflict]:
        """What becomes of labellings (k, m): in the smallest windows that refute them, else as a whole."""
        how, seed = self._how()
        left, found = np.arange(len(drawn)), list[MinimizedConflict]()
        inside = replace(how, neighbours=min(how.neighbours, _INSIDE))
        for width, windows in enumerate(self._windows):
            if not left.size or not self._statistics.wanted(width):
                continue
            of, outside = np.repeat(left, len(windows)), np.tile(~windows, (len(left), 1))
            limits = np.full(len(of), threshold)
            fallen = self._relaxation.minimize_conflicts(
                ConflictRequest(drawn[of], self._free, limits, outside, inside, seed)
            )
            refuted = [replace(one, labelling=int(of[one.labelling])) for one in fallen if one.bound is not None]
            found += refuted
            rest = np.setdiff1d(left, [one.labelling for one in refuted])
            self._statistics.tell(width, 1.0 - len(rest) / len(left))
            left = rest
        if left.size:
            asked = ConflictRequest(drawn[left], self._free, np.full(len(left), threshold), how=how, seed=seed)
            whole = self._relaxation.minimize_conflicts(asked)
            found += [replace(one, labelling=int(left[one.labelling])) for one in whole]
        return found

    def _sort(self, drawn: Bits, threshold: float, fallen: list[MinimizedConflict], caught: ConflictBatch) -> None:
        """Conflicts, and labellings that nothing refutes, among what became of labellings (k, m)."""
        left = set(range(len(drawn)))
        for one in fallen:
            labels = drawn[one.labelling]
            if one.bound is not None and one.velocity is not None:
                faces, mechanism = np.flatnonzero(one.decided), Mechanism(one.case, one.velocity)
                self._take(Conflict(faces, labels[faces], min(one.bound, threshold), mechanism=mechanism), caught)
                left.discard(one.labelling)
            elif one.drawn and one.carries:
                caught.unrefuted.append(labels)
                left.discard(one.labelling)
        # what the batch solver leaves open is worth another route, since else it has to be evaluated
        for number in sorted(left):
            self._minimize_one(drawn[number], threshold, caught)

    def _minimize_one(self, labels: Bits, threshold: float, caught: ConflictBatch) -> None:
        with _OTHER_ROUTE:
            found = conflict_of(self._relaxation, labels, self._free, threshold)
        if found is None:
            caught.unrefuted.append(labels)
        else:
            self._take(found, caught)

    def _take(self, conflict: Conflict, caught: ConflictBatch) -> None:
        """Rule out what a conflict does, unless that was done before."""
        assert self._formula is not None
        name = conflict.name
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


def _nothing() -> None:
    """Nobody else has found anything."""
