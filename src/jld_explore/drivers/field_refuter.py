"""Refute labellings by velocity fields on meshes that all of them share."""

from __future__ import annotations

import math
import uuid
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.fields.adaptive import FieldSetting
from jld_core.fields.mesh import Mesh
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.drivers.exact.proof_state import Conflict
from jld_explore.drivers.field_meshes import CommonMeshes
from jld_explore.drivers.field_relaxation import FieldProblem, FieldProofContext, FieldRelaxation
from jld_explore.drivers.field_tasks import ProofSetup, level_conflict
from jld_explore.evaluation.task_pool import TaskPool
from jld_explore.space import SearchSpace

_FADING: Final = 0.1  # weight of the last labelling in the share of labellings that a mesh refutes

_RARELY: Final = 0.1  # share of labellings refuted by a mesh below which it is left out

_AGAIN: Final = 8  # A mesh that is left out is still tried once in this number of batches


class FieldRefuter:
    """Refuter of the labellings of one search space by velocity fields on common meshes.

    `refute` solves for a velocity field on the coarsest mesh of each load case and on those added by `refute_on`. It
    returns a conflict for each refuted labelling. `weigh` recomputes the bound that the mechanism of a conflict proves,
    without a solver. A **problem** is one mesh of one load case.

    space: the search space, of a planar assembly. blocks: possible blocks; None where they are not listed: all
    candidates are then free. free: (m,) faces that may take either label in some labelling. relaxation: evaluates
    mechanisms on all problems. programs: number of programs solved for conflicts.
    """

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks | None) -> None:
        self._space, self._blocks = space, blocks
        self.free = space.candidates.copy()
        if blocks is not None:
            joined = {face for inside in blocks.inside for face in inside}
            self.free &= np.isin(np.arange(len(self.free)), list(joined))
        # candidates outside every possible block are dry
        self._labels = space.fixed | (space.candidates & ~self.free)
        assembly = space.assembly
        settings = tuple(FieldSetting.of(case) for case in assembly.by_case)
        coarsest = (tuple(setting.coarse for setting in settings),)
        required = tuple(assembly.required.tolist())
        self._setup = ProofSetup(uuid.uuid4().hex, settings, required, self.free, coarsest)
        self.programs = self._batches = 0
        self.restart()

    def restart(self) -> None:
        """Forget all problems but those on the coarsest mesh of each load case."""
        # the problems of each level follow each other; the finer levels are added as the proof begins
        self._setup = replace(self._setup, name=uuid.uuid4().hex, levels=self._setup.levels[:1])
        self.relaxation, self._first = FieldRelaxation(self._setup.problems(0)), [0]
        self._share = [1.0]

    @property
    def cases(self) -> int:
        """Number of load cases."""
        return len(self._setup.settings)

    def load_case(self, problem: FieldProblem) -> int:
        """Return the index of the load case of a problem.

        The setting of the problem must be one of this object; else StopIteration is raised.
        """
        return next(case for case, setting in enumerate(self._setup.settings) if setting is problem.setting)

    def add_problem(self, case: int, mesh: Mesh) -> int:
        """Add a mesh (scene units) of load case number `case`, to weigh mechanisms on it.

        Returns the position of the problem, for `Mechanism.case`. No labelling is refuted on it.
        """
        return self.relaxation.add(FieldProblem(self._setup.settings[case], mesh, self._setup.required[case]))

    def weigh(self, conflict: Conflict) -> float:
        """Compute the bound that the mechanism of a conflict proves, without a solver.

        It is the governing factor that no labelling with the labels of the conflict exceeds; inf without a mechanism,
        or where it proves none.
        """
        if conflict.mechanism is None:
            return math.inf
        labels, undecided = self._labels.copy(), self.free.copy()
        labels[conflict.faces], undecided[conflict.faces] = conflict.labels, False
        one = conflict.mechanism
        return float(
            self.relaxation.evaluate_mechanisms(one.case, one.velocity[None], labels[None], undecided[None])[0]
        )

    def common(self, case: int) -> CommonMeshes:
        """Make new meshes of load case number `case`, to bound all labellings on."""
        return CommonMeshes(self._setup.settings[case], self._setup.required[case], self._labels, self.free)

    def refute_on(self, meshes: Sequence[CommonMeshes]) -> None:
        """Refute labellings on some finer meshes too from now on, beside the coarsest.

        meshes: one for each load case, whose `CommonMeshes.shared` are taken.
        """
        places = dict.fromkeys(zip(*(one.shared for one in meshes), strict=True))
        levels = tuple(tuple(one.meshes[k] for one, k in zip(meshes, row, strict=True)) for row in places)
        self._setup = replace(self._setup, levels=levels)
        self._share = [1.0] * len(levels)
        for level in range(1, len(levels)):
            self._first.append(len(self.relaxation.problems))
            for problem in self._setup.problems(level):
                self.relaxation.add(problem)

    def refute(self, labellings: Sequence[Bits], threshold: float, tasks: TaskPool) -> list[Conflict | None]:
        """Refute a factor for labellings, and minimise each refuted one to a conflict.

        threshold: governing factor to refute. tasks: processes that solve. Result: one for each labelling, None where
        no mesh refutes it.
        """
        levels = self._levels()
        found = tasks.run(level_conflict, [(self._setup, labels, threshold, levels) for labels in labellings])
        self.programs += sum(one.solves for one in found)
        conflicts: list[Conflict | None] = []
        for one in found:
            for level in levels[: levels.index(one.first) + 1 if one.first >= 0 else None]:
                self._share[level] += _FADING * ((level == one.first) - self._share[level])
            conflict = one.conflict
            if conflict is not None and conflict.mechanism is not None:
                number = conflict.mechanism.case + self._first[one.level]
                conflict = replace(conflict, mechanism=replace(conflict.mechanism, case=number))
            conflicts.append(conflict)
        return conflicts

    def _levels(self) -> tuple[int, ...]:
        """Return the levels of meshes to try first; levels that rarely refute are tried at intervals only."""
        self._batches += 1
        again = not self._batches % _AGAIN
        return tuple(level for level, share in enumerate(self._share) if share >= _RARELY or again)

    def context(self) -> FieldProofContext:
        """Return the data that the check of a proof needs, and forget stored results of weighing.

        All mechanisms are therefore weighed again by the check.
        """
        self.relaxation.forget()
        return FieldProofContext(self.relaxation, self._space, self._blocks, self.free)
