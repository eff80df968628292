"""Refute load factors of partial labellings by velocity fields, docs/method.md (9.13), (9.15) and (9.16)."""

from __future__ import annotations

import hashlib
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.deadline import checkpoint
from jld_core.fields.bounds import FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import FieldMechanism
from jld_core.fields.undecided import PartialUpperBound, WeighedField
from jld_core.limit.dual_bounds import DualBound
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.space import SearchSpace

# Relative amount by which bounds are raised on a change of units, so that they stay valid
_ROUNDING: Final = 4.0 * float(np.finfo(float).eps)

_KEPT: Final = 4  # meshes, beside those that refute, whose problems are kept in memory


@dataclass(frozen=True)
class FieldProblem:
    """Mesh on which velocity fields refute load factors under one load case."""

    setting: FieldSetting  # data that all meshes of the load case share
    mesh: Mesh  # the mesh, scene units
    required: float  # required factor of the load case


class FieldRelaxation:
    """Upper bounds on the governing factor of partial labellings by velocity fields.

    A problem is a load case on one mesh. Those given first are asked for refutations, the most successful first; added
    ones only weigh mechanisms.
    """

    many = False
    unit = 1.0

    def __init__(self, problems: Sequence[FieldProblem]) -> None:
        self.problems = list(problems)
        self._order = list(range(len(problems)))
        self._asked = [PartialUpperBound(one.setting.problem(one.mesh), many=True) for one in problems]
        self._known: dict[tuple[int, bytes], FieldMechanism | None] = {}
        self._others: OrderedDict[int, PartialUpperBound] = OrderedDict()

    @property
    def solves(self) -> int:
        """Number of programs solved for refutations."""
        return sum(one.solves for one in self._asked)

    def restart(self) -> None:
        """Ask the problems in their first order again, so that answers depend on no earlier call."""
        self._order = list(range(len(self._asked)))

    def add(self, problem: FieldProblem) -> int:
        """Add a problem to weigh mechanisms on, not to refute; return its position."""
        self.problems.append(problem)
        return len(self.problems) - 1

    def refute(self, labels: Bits, undecided: Bools, threshold: float = math.inf) -> DualBound | None:
        """Refute a factor for all labellings (m,) that agree where decided; None without a proof."""
        # A factor is refuted where a velocity field proves a smaller bound. Problems are asked one by one; one that
        # succeeds is asked first the next time.
        for place, number in enumerate(self._order):
            checkpoint()
            found = self._asked[number].field(labels, undecided)
            if found is None:
                continue
            required = self.problems[number].required
            bound = raised(found.bound / required)
            if bound < threshold:
                if place:
                    self._order.remove(number)
                    self._order.insert(0, number)
                cost = np.where(undecided, 0.0, found.mechanism.costs(labels) / required)
                return DualBound(threshold - bound, cost, bound, found.velocity, number)
        return None

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Refute thresholds (k,) of partial labellings (k, m) one by one."""
        return [self.refute(*one) for one in zip(labellings, undecided, thresholds.tolist(), strict=True)]

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Find the least bound for a partial labelling (m,) over the problems asked, or None."""
        best: DualBound | None = None
        for number, partial in enumerate(self._asked):
            found = partial.field(labels, undecided)
            required = self.problems[number].required
            bound = math.inf if found is None else raised(found.bound / required)
            if found is not None and (best is None or bound < best.bound):
                cost = np.where(undecided, 0.0, found.mechanism.costs(labels) / required)
                best = DualBound(math.inf, cost, bound, found.velocity, number)
        return best

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Recompute, without a solver, the bounds (k,) that mechanisms (k, t, 3, 2) prove."""
        if not 0 <= case < len(self.problems):
            raise ValueError(f"case: there is no problem {case}; expected 0 to {len(self.problems) - 1}")
        required = self.problems[case].required
        found = [self.weighed(case, velocity) for velocity in velocities]
        rows = zip(found, labellings, undecided, strict=True)
        return np.array([math.inf if m is None else raised(m.bound_of(*part) / required) for m, *part in rows])

    def weighed(self, number: int, velocity: Floats) -> FieldMechanism | None:
        """Return the dissipation of a scaled mechanism (t, 3, 2), stored; None if it proves nothing."""
        key = number, hashlib.sha256(np.ascontiguousarray(velocity).tobytes()).digest()
        if key not in self._known:
            self._known[key] = self._of(number).weigh(velocity)
        return self._known[key]

    def forget(self) -> None:
        """Forget the stored results of `weighed`, so that a check computes them again."""
        self._known.clear()

    def _of(self, number: int) -> PartialUpperBound:
        """Return the upper bounds of problem `number`."""
        # Bounds of problems that were only added for `weigh` are kept for a while, and then set up anew.
        if number < len(self._asked):
            return self._asked[number]
        if number not in self._others:
            one = self.problems[number]
            self._others[number] = PartialUpperBound(one.setting.problem(one.mesh))
            while len(self._others) > _KEPT:
                self._others.popitem(last=False)
        return self._others[number]


def raised(bound: float) -> float:
    """Return a bound raised by the rounding that a change of units may cause."""
    return bound + abs(bound) * _ROUNDING if math.isfinite(bound) else bound


@dataclass(frozen=True)
class FieldProofContext:
    """Data that stay fixed during a proof by fields, for its check."""

    relaxation: FieldRelaxation  # relaxation that refutes labellings and evaluates mechanisms
    space: SearchSpace
    blocks: PossibleBlocks | None  # possible blocks, where they are listed
    free: Bools  # (m,) faces that may take either label in some labelling

    @property
    def labels(self) -> Bits:
        """Labels (m,) of all faces that are not free; free ones are undecided."""
        return np.asarray(self.space.fixed | (self.space.candidates & ~self.free))


_MOST_TIMES: Final = 32  # triangles at which the refinement ends, over those of the coarsest mesh

_MOST_TRIANGLES: Final = 6000  # triangles that no mesh exceeds: a program of more takes many seconds

# Triangles of the meshes on which labellings are refuted beside the coarsest, over those of the coarsest. Of the 4 × 6
# wall, near the bound, conflicts have 10.3 faces on the coarsest mesh, 7.0 and 5.7 on these.
_SHARED: Final = (3.5, 8.0)


@dataclass(frozen=True)
class CommonBound:
    """Bound on all labellings under one load case."""

    mesh: Mesh
    found: WeighedField  # velocity field with the factor that no labelling exceeds
    bound: float  # governing factor that no labelling exceeds


class CommonMeshes:
    """Sequence of meshes of one load case, each refined where all labellings dissipate most."""

    def __init__(self, setting: FieldSetting, required: float, labels: Bits, undecided: Bools) -> None:
        self._setting, self._required = setting, required
        self._labels, self._undecided = labels, undecided
        self._next: Mesh | None = setting.coarse
        self._most = min(_MOST_TRIANGLES, _MOST_TIMES * len(setting.coarse))
        self.meshes: list[Mesh] = [setting.coarse]

    @property
    def ended(self) -> bool:
        """True if no further mesh would be finer, small enough and bounded."""
        return self._next is None

    def step(self) -> CommonBound | None:
        """Bound all labellings on the next mesh, and refine it; None at the end of the sequence."""
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
        """Positions in `meshes` of those on which labellings are refuted, the coarsest first."""
        # the last mesh stands for finer ones, so that all load cases have as many
        sizes = np.array([len(mesh) for mesh in self.meshes])
        least = [int(np.searchsorted(sizes, times * len(self._setting.coarse))) for times in _SHARED]
        return 0, *(min(place, len(sizes) - 1) for place in least)
