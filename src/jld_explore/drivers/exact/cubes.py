"""Parts of a space that are refuted by themselves: labels that some faces have, and the face that parts one in two."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from jld_core.arrays import Bits, Floats

if TYPE_CHECKING:
    from jld_explore.drivers.exact.formula import Formula

_LOOKED_AT: Final = 16
"""Faces that are looked ahead at before a cube is parted: those most in the conflicts of late."""


@dataclass(frozen=True)
class Cube:
    """All labellings with `labels` (k,) on `faces` (k,), True dry."""

    faces: tuple[int, ...] = ()
    labels: tuple[bool, ...] = ()

    def and_face(self, face: int, *, dry: bool) -> Cube:
        """The part of it with a label on one more face."""
        return Cube((*self.faces, face), (*self.labels, dry))

    def holds(self, labels: Bits) -> bool:
        """Whether a labelling (m,) is in it."""
        return bool((labels[list(self.faces)] == np.array(self.labels, dtype=bool)).all())


EVERYTHING: Final = Cube()


def split_cube(cube: Cube, formula: Formula, weight: Floats) -> Iterator[Cube]:
    """Two parts of a cube, or what is left of it where unit propagation leaves one, or itself where no face is left.

    The face is taken of which both labels say most about others: the product of what propagation derives from each.
    weight: (m,) how much faces are in the conflicts of late.
    """
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
