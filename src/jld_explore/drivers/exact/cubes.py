"""Cubes of a search space, given by labels of some faces, and the face that splits a cube."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from jld_core.arrays import Bits, Floats

if TYPE_CHECKING:
    from jld_explore.drivers.exact.formula import Formula

# Number of faces compared by unit propagation before a cube is split. The faces most frequent in recent conflicts are
# compared.
_LOOKED_AT: Final = 16


@dataclass(frozen=True)
class Cube:
    """Set of all labellings with `labels` (k,) on `faces` (k,), True = dry."""

    faces: tuple[int, ...] = ()
    labels: tuple[bool, ...] = ()

    def and_face(self, face: int, *, dry: bool) -> Cube:
        """Return the part of the cube with the label `dry` on one more face."""
        return Cube((*self.faces, face), (*self.labels, dry))

    def holds(self, labels: Bits) -> bool:
        """Return whether a labelling (m,) lies in the cube."""
        return bool((labels[list(self.faces)] == np.array(self.labels, dtype=bool)).all())


EVERYTHING: Final = Cube()  # cube of all labellings


def split_cube(cube: Cube, formula: Formula, weight: Floats) -> Iterator[Cube]:
    """Yield the parts of a cube; weight: (m,) scores of the faces, high for recent conflicts."""
    # The cube is split by the face with the largest product of numbers of literals that unit propagation derives from
    # each label. If propagation refutes a part, only the other part follows, or none. A cube without a further face is
    # returned itself.
    taken = set(cube.faces)
    order = np.argsort(-weight, kind="stable").tolist()
    faces = [face for face in order if formula.space.candidates[face] and face not in taken][:_LOOKED_AT]
    best, most = None, -1
    for face in faces:
        parts = [cube.and_face(face, dry=dry) for dry in (True, False)]
        derived = [formula.derived(part.faces, part.labels) for part in parts]
        if None in derived:
            yield from (part for part, count in zip(parts, derived, strict=True) if count is not None)
            return
        score = int(np.prod([1 + (count or 0) for count in derived]))
        if score > most:
            best, most = parts, score
    yield from best or (cube,)
