"""Meshes for all labellings, refined where the velocity field that bounds all of them dissipates most.

One program in which every face is undecided bounds all labellings. Its velocity field shows where many of them fail,
and meshes refined there refute many labellings by conflicts of few faces. On the 4 × 6 wall of
benchmarks/results/fields_search.md 438 such triangles bound all labellings as closely as 1 280 of one size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.fields.adaptive import FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.undecided import PartialUpperBound, WeighedField
from jld_explore.drivers.field_relaxation import raised

_MOST_TIMES: Final = 32  # triangles at which the refinement ends, over those of the coarsest mesh

_MOST_TRIANGLES: Final = 6000  # triangles that no mesh exceeds: a program of more takes many seconds

# Triangles of the meshes on which labellings are refuted beside the coarsest, over those of the coarsest. Of the 4 × 6
# wall, near the bound, conflicts have 10.3 faces on the coarsest mesh, 7.0 and 5.7 on these.
_SHARED: Final = (3.5, 8.0)


@dataclass(frozen=True)
class CommonBound:
    """Bound on all labellings under one load case.

    found: velocity field with the factor that no labelling exceeds. bound: governing factor that no labelling exceeds.
    """

    mesh: Mesh
    found: WeighedField
    bound: float


class CommonMeshes:
    """Sequence of meshes of one load case, each refined where all labellings dissipate most.

    `step` bounds all labellings on one mesh; `shared` chooses those on which single labellings are refuted.

    required: required factor of the load case; a governing factor is λ over it. labels, undecided: (m,) labels, True =
    dry, and the faces that may have either. meshes: meshes that were bounded, the coarsest first.
    """

    def __init__(self, setting: FieldSetting, required: float, labels: Bits, undecided: Bools) -> None:
        self._setting, self._required = setting, required
        self._labels, self._undecided = labels, undecided
        self._next: Mesh | None = setting.coarse
        self._most = min(_MOST_TRIANGLES, _MOST_TIMES * len(setting.coarse))
        self.meshes: list[Mesh] = [setting.coarse]

    @property
    def ended(self) -> bool:
        """True if `step` has no further mesh.

        No finite bound was found, or the next mesh would be no finer or too large.
        """
        return self._next is None

    def step(self) -> CommonBound | None:
        """Bound all labellings on the next mesh, and refine it for another step.

        None: no mesh is left, or no field with a finite bound was found; the sequence then ends.
        """
        mesh, self._next = self._next, None
        if mesh is None:
            return None
        if len(mesh) > len(self.meshes[-1]):
            self.meshes.append(mesh)
        partial = PartialUpperBound(self._setting.problem(mesh))
        found = partial.field(self._labels, self._undecided)
        if found is None or not math.isfinite(found.bound):
            return None
        finer = partial.finer(mesh, found.velocity, self._labels, self._undecided)
        if len(mesh) < len(finer) <= self._most:
            self._next = finer
        return CommonBound(mesh, found, raised(found.bound / self._required))

    @property
    def shared(self) -> tuple[int, ...]:
        """Positions in `meshes` of those on which labellings are refuted, the coarsest first.

        They are chosen by their numbers of triangles. Where refinement ended earlier, the last mesh stands for finer
        ones, so that all load cases have as many. Positions may repeat.
        """
        sizes = np.array([len(mesh) for mesh in self.meshes])
        least = [int(np.searchsorted(sizes, times * len(self._setting.coarse))) for times in _SHARED]
        return 0, *(min(place, len(sizes) - 1) for place in least)
