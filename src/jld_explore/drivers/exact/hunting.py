"""Labellings drawn from a formula many at a time, and ruled out with all that fall for the same reason.

Labellings drawn together would fall for one reason were they alike, so each is drawn with random preferences. Once
one has given a conflict its **neighbours**, the same labelling with one face of the conflict undecided, nearly always
fall as well, for another reason, and cost no drawing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.shrinking import AnyRelaxation, Conflict, Shrinkings

_WIDTH: Final = 32
"""Shrinkings side by side where the kernel solves many at once."""

_DRAWN: Final = 8
"""Labellings drawn together at the most."""

_NEIGHBOURS: Final = 3
"""Neighbours of each labelling that are shrunk too."""

_DRY: Final = 0.3
"""Share of faces that a labelling had better have dry, at random: long blocks are what is hard to refute."""


@dataclass
class Catch:
    """What a step found: conflicts; labellings (m,) that nothing refutes; exhausted: no labelling is left."""

    conflicts: list[Conflict] = field(default_factory=list)
    unrefuted: list[Bits] = field(default_factory=list)
    exhausted: bool = False


class Hunt:
    """Conflicts of one formula after the other. free: (m,) faces that may take either label. seed: of preferences."""

    def __init__(self, relaxation: AnyRelaxation, free: Bools, seed: int) -> None:
        self._pool = Shrinkings(relaxation, free)
        self._rng = np.random.default_rng([seed, 2])
        self._many = relaxation.many
        self._formula: Formula | None = None
        self._known: set[tuple[bytes, bytes]] = set()
        self._most = 1

    def begin(self, formula: Formula) -> None:
        """Go on with another formula; what was begun with the last one is forgotten."""
        self._pool.clear()
        self._formula = formula
        self._known, self._most = set(), 1

    def step(self, threshold: float) -> Catch:
        """One relaxation of each labelling at hand. threshold: scaled λ, not lower than before in this formula."""
        formula, caught = self._formula, Catch()
        assert formula is not None
        # few at first: where one conflict rules out nearly all, the others were drawn in vain
        room = min(_DRAWN, self._most, _WIDTH - len(self._pool)) if self._many else 1 - len(self._pool)
        for _ in range(room):
            labels = formula.next(preferred=self._preferred())
            if labels is None:
                break
            # not drawn again while it is at hand; the conflict that it gives says all that this does, and more
            formula.forbid(np.arange(len(labels)), labels)
            self._pool.begin(labels, threshold)
        if not len(self._pool):
            caught.exhausted = True
            return caught
        for finished in self._pool.step():
            conflict = finished.conflict
            if conflict is None:
                if finished.drawn:
                    caught.unrefuted.append(finished.labels)
                continue
            name = conflict.faces.tobytes(), conflict.labels.tobytes()
            if name in self._known:
                continue
            self._known.add(name)
            self._most += 1
            caught.conflicts.append(conflict)
            formula.forbid(conflict.faces, conflict.labels)
            if finished.drawn and self._many and self._most > _DRAWN:
                count = min(_NEIGHBOURS, len(conflict.faces))
                for face in self._rng.choice(conflict.faces, count, replace=False).tolist():
                    self._pool.begin(finished.labels, threshold, face)
        return caught

    def _preferred(self) -> Bits | None:
        """Labels (m,) that a drawn labelling had better have."""
        if not self._many:
            return None
        assert self._formula is not None
        return self._rng.random(len(self._formula.space.fixed)) < _DRY
