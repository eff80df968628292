"""What a proof by blocks asks of faces under one label, for many jumps at faces named, of any yield set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.mechanics import YieldSet
from jld_core.program import Template


class BlockFaces(Protocol):
    """Faces under one label. Jumps are scaled."""

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        """(k,) least slack of the conditions for D of jumps (k, q) at faces (k,) to be finite."""

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        """(k,) D of jumps (k, q) whose margin is not negative."""

    def strength(self, faces: Ints) -> Floats:
        """(k,) what D grows by at the most, beside the size of a jump."""


@dataclass(frozen=True)
class FacesOfSets:
    """Faces of any yield set. sets: of m faces. dry: under which label. strengths: (m,) see `BlockFaces.strength`."""

    sets: YieldSet
    dry: bool
    strengths: Floats

    @classmethod
    def of(cls, template: Template, *, dry: bool) -> FacesOfSets:
        """The faces of a template."""
        assembly, scaling = template.assembly, template.scaling
        known = assembly.strengths
        per_area = (known.cohesion, known.crush_dry) if dry else (known.tension, known.shear, known.crush_inner)
        size = sum(np.where(np.isfinite(one), one, 0.0) for one in per_area)
        return cls(template.yield_set, dry, np.asarray(size * assembly.interfaces.area / scaling.force))

    def margin(self, jumps: Floats, faces: Ints) -> Floats:
        return self._each(self.sets.margin, jumps, faces)

    def dissipation(self, jumps: Floats, faces: Ints) -> Floats:
        return self._each(self.sets.dissipation, jumps, faces)

    def strength(self, faces: Ints) -> Floats:
        return np.asarray(self.strengths[faces])

    def _each(self, measure: Callable[[Floats, Bits], Floats], jumps: Floats, faces: Ints) -> Floats:
        """Measures of jumps (k, q), as many at a time as there are faces: a yield set speaks of all of them at once."""
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
