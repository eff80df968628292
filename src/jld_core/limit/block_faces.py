"""Margins and dissipation of jumps at selected faces under one label."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.mechanics import YieldSet
from jld_core.program import Template


class BlockFaces(Protocol):
    """Interface to the margins and dissipation of scaled jumps at faces under one label.

    A face may occur several times, once for each block that it touches.
    """

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the least slack (k,) of the conditions for finite dissipation of jumps.

        jumps: (k, q). faces: (k,) index of the face of each jump.
        """

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the dissipation (k,) of jumps (k, q) with non-negative margin, at faces (k,)."""

    def strength(self, faces: Ints) -> Floats:
        """Return the largest growth (k,) of the dissipation of faces (k,) per unit of jump size."""


@dataclass(frozen=True)
class YieldSetFaces:
    """Margins and dissipation at faces of any yield set under one label; see `BlockFaces`.

    sets: yield sets of m faces. dry: True for the dry label. strengths: (m,) see `BlockFaces.strength`.
    """

    sets: YieldSet
    dry: bool
    strengths: Floats

    @classmethod
    def of(cls, template: Template, *, dry: bool) -> YieldSetFaces:
        """Create the faces of a template under one label.

        dry: True for the dry label, False for the inner one.
        """
        labels = np.full(len(template.assembly.interfaces), dry)
        return cls(template.yield_set, dry, template.yield_set.strength(labels))

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the margins (k,) of jumps (k, q) at faces (k,), see `BlockFaces.margin`."""
        return self._each(self.sets.margin, jumps, faces)

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """Return the dissipation (k,) of jumps (k, q) at faces (k,), see `BlockFaces.dissipation`."""
        return self._each(self.sets.dissipation, jumps, faces)

    def strength(self, faces: Ints) -> Floats:
        """Return the strengths (k,) of faces (k,), see `BlockFaces.strength`."""
        return np.asarray(self.strengths[faces])

    def _each(self, measure: Callable[[Floats, Bits], Floats], jumps: Floats, faces: Ints) -> Floats:
        """Evaluate a margin or dissipation of jumps (k, q) at faces (k,).

        measure: function of jumps (m, q) and labels (m,). It evaluates all faces at once, so every pass holds at most
        one jump per face.
        """
        found = np.empty(len(faces))
        count = len(self.strengths)
        labels = np.full(count, self.dry)
        order = np.argsort(faces, kind="stable")
        turn = np.arange(len(faces)) - np.searchsorted(faces[order], faces[order])
        for each in range(int(turn.max(initial=-1)) + 1):
            here = order[turn == each]
            table = np.zeros((count, jumps.shape[1]))
            table[faces[here]] = jumps[here]
            found[here] = measure(table, labels)[faces[here]]
        return found
