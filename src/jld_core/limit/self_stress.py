"""Forces beside self-stresses that may be as large as they need to be (docs/method.md (3.14a)).

At friction of exactly 45° a self-stress R may lie on the boundary of friction cones. With t R added, t large, such a
cone restricts other forces to the half-space that touches it along R: |V across|²/(2 t |R|) ≤ slack. Rows in which R
has slack do not restrict other forces. The rows that are left may have a self-stress of their own, and so on. In them

- a ray carries every λ, by forces that grow with a power of λ: no ray (3.14) may exist
- forces with slack prove a lower bound on λ, which is reached by no forces of a given size

Every self-stress and every row that it removes is checked here.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.limit.admissible import State
from jld_core.limit.auxiliary_programs import largest_support, polygonal_support, project_onto_faces
from jld_core.limit.bounds import Prover
from jld_core.limit.equilibrium import usable
from jld_core.limit.facial_reduction import DENSE, SEARCHES
from jld_core.limit.reduced_rows import Reduced, kept_rows, program_of_rows
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver

_ROUNDS: Final = 4  # Largest number of successive self-stresses.
_STRICT: Final = 1e-6  # Slack, relative to the largest force of a vector, that is no rounding.
_SNAP: Final = 1e-4  # Component of a direction on the boundary of a cone below which it is set to zero.
_LEFT: Final = 2e-9  # Slack of a state in all rows that are left, scaled.
_ACCURACIES: Final = ((1e-9, 2e-8), (1e-12, 4e-9))  # Residual to reach, and slack to keep while solving, in turn.
_CALM: Final = 1e-10  # Weight of |F|² next to λ, scaled; without it forces may grow along a self-stress.
_TIMES: Final = np.logspace(0.0, 14.0, 57)  # Factors of a self-stress, scaled, tried in turn.
_LAST_DIGITS: Final = 4.0 * float(np.finfo(float).eps)
# Bounds on the forces, scaled, and slacks below which a row counts as tight, in the order tried; 0: by simplex
_RAYS: Final = ((0.0, 1e-5), (0.0, 0.0), (1e3, 1e-5), (1e2, 1e-4))


@dataclass(frozen=True)
class _Stage:
    """Sequence of self-stresses, and the yield rows that they leave.

    stresses: each (columns,) scaled forces. before: rows of the program in which each was found. left: rows left by all
    of them.
    """

    stresses: tuple[Floats, ...]
    before: tuple[Reduced, ...]
    left: Reduced


@dataclass(frozen=True)
class _RowPosition:
    """Slacks of a vector in a set of yield rows.

    linear: (k,) slacks of the linear rows. head: (c,) value of the first row of each cone. tail: (c, 2) values of its
    other rows.
    """

    linear: Floats
    head: Floats
    tail: Floats

    @property
    def inside(self) -> Floats:
        """Return the slack (c,) of each cone: its first row minus the norm of the others."""
        return np.asarray(self.head - np.linalg.norm(self.tail, axis=1))

    @property
    def least(self) -> float:
        """Return the least slack of all linear rows and cones."""
        return float(min(self.linear.min(initial=np.inf), self.inside.min(initial=np.inf)))


class SelfStress:
    """Rays and states of one labelling that are admissible together with large self-stresses.

    A self-stress is a set of forces in equilibrium without any load. Added in a large multiple, it leaves only some
    yield rows that restrict other forces, docs/method.md (3.14a). Small programs whose cones have three rows are
    treated; for others nothing is found.

    prover: checks forces of one assembly in space. labels: (m,) True = dry.
    """

    def __init__(self, prover: Prover, labels: Bits) -> None:
        self.prover, self.labels = prover, labels
        self.template = prover.template
        self.program = self.template.program(labels)
        self.columns = self.program.structure.shape[1] - 1
        small = self.template.matrix.shape[0] <= DENSE and set(self.program.structure.cones) == {3}
        self.stages = list(self._reduced())[::-1] if small else []

    def ray(self) -> State | None:
        """Find a ray that is admissible together with self-stresses that grow faster than it.

        Result: R₁ with A R₁ + b_λ = 0, its slack measured in the rows that the self-stresses leave; None where no proof
        is found. With a state that has slack in all yield sets, it proves that every larger λ is admissible.
        """
        for stage in self.stages:
            left = program_of_rows(self.program, stage.left)
            for largest, least in _RAYS:
                target = -self.template.live
                found = (
                    largest_support(left, self.columns, target, largest)
                    if largest
                    else polygonal_support(left, self.columns, target)
                )
                if found is None:
                    continue
                ray = _without_last_digits(
                    project_onto_faces(left, found, target, _SNAP, least) if least else found.point
                )
                size = min(1.0, float(abs(ray).max()) or 1.0)
                forces = ray[: self.template.matrix.shape[1]]
                slack = min(0.0, _row_position(left, ray).least) / size
                state = State(self._table(forces), 1.0, slack, self.prover.imbalance(forces, self.template.live))
                if self.prover.is_ray(state):
                    return state
        return None

    def states(self, inside: Floats) -> Iterator[State]:
        """Find states of large λ that self-stresses of sufficient size make admissible.

        Forces that are admissible in the rows that the self-stresses leave are blended with `inside`. Self-stresses are
        then added until all rows hold.

        inside: (columns + 1,) forces with slack in every yield set, further variables, and λ as the last entry, scaled.
        Result: admissible state. Its error is that of its large forces: the exact forces next to them are admissible.
        """
        resultants = self.template.matrix.shape[1]
        inner = self._balanced(inside)
        for stage, (tolerance, kept) in itertools.product(self.stages, _ACCURACIES):
            stated = program_of_rows(self.template.program(self.labels, kept), stage.left, right=True)
            outer = self._balanced(ClarabelSolver(tolerance, proximal=(resultants, _CALM)).solve(stated).point)
            if inner is None or outer is None:
                continue
            point = _blended(program_of_rows(self.program, stage.left, right=True), outer[0], inner[0])
            forces = None if point is None else self._with_stresses(point, stage)
            error = max(inner[1], outer[1])
            if point is not None and forces is not None and error <= 1e-3 * _LEFT:
                error = max(error, _LAST_DIGITS * float(abs(forces).max()))
                yield State(self._table(forces[:resultants]), float(point[-1]), 2.0 * error, error)

    def _balanced(self, point: Floats) -> tuple[Floats, float] | None:
        """Project a point onto equilibrium; return it with the error left, None if it is unusable.

        point: (columns + 1,) forces, further variables, and λ, scaled. The further variables stay as they are.
        """
        if not usable(point):
            return None
        resultants = self.template.matrix.shape[1]
        state = self.prover.state(np.append(point[:resultants], point[-1]), self.labels, 3)
        return np.concatenate([state.forces.ravel(), point[resultants : self.columns], [state.load]]), state.error

    def _table(self, forces: Floats) -> Floats:
        """Return scaled resultants (q·m,) as a table (m, q)."""
        return forces.reshape(len(self.labels), -1)

    def _with_stresses(self, point: Floats, stage: _Stage) -> Floats | None:
        """Add large self-stresses to a point until it is admissible in all rows; None on failure.

        They are added from the last to the first, each so large that the rows it was found in hold. point: (columns +
        1,) forces, further variables and λ, scaled.
        """
        for stress, before in zip(stage.stresses[::-1], stage.before[::-1], strict=True):
            rows = program_of_rows(self.program, before, right=True)
            for times in _TIMES:
                tried = point + times * np.append(stress, 0.0)
                if _row_position(rows, tried).least >= -_LAST_DIGITS * float(abs(tried).max()):
                    point = tried
                    break
            else:
                return None
        return point

    def _reduced(self) -> Iterator[_Stage]:
        """Find self-stresses one after the other; yield each stage with a cone reduced to a ray.

        The search ends where no self-stress removes another row, or after `_ROUNDS` rounds.
        """
        stage = _Stage((), (), kept_rows(self.program))
        for _ in range(_ROUNDS):
            for search in SEARCHES[:2]:
                left = program_of_rows(self.program, stage.left)
                support = search(left, self.columns)
                if support is None:
                    continue
                stress = _without_last_digits(
                    project_onto_faces(left, support, np.zeros(left.structure.equalities), _SNAP)
                )
                after = self._remaining_rows(stress, left, stage.left)
                if after is not None:
                    stage = _Stage((*stage.stresses, stress), (*stage.before, stage.left), after)
                    if after.rays:
                        yield stage
                    break
            else:
                return

    def _remaining_rows(self, stress: Floats, left: ConicProgram, reduced: Reduced) -> Reduced | None:
        """Return the yield rows left beside a self-stress; None if it removes none or is invalid.

        stress: (columns,) scaled forces, invalid if out of equilibrium or not admissible. left: program of the rows so
        far. reduced: these rows.
        """
        position, size = _row_position(left, stress), float(abs(stress).max())
        exact = self.prover.exact * max(1.0, size)
        balance = self.prover.imbalance(stress[: self.template.matrix.shape[1]], np.zeros_like(self.template.live))
        if balance > self.prover.exact * max(1.0, size) or position.least < -exact:
            return None
        strict = _STRICT * size
        count = len(reduced.linear)
        kept = reduced.linear[position.linear[:count] <= strict]
        tight = position.linear[count:] <= strict
        rays = {cone: way for (cone, way), holds in zip(reduced.rays.items(), tight, strict=True) if holds}
        cones = []
        for cone, head, tail, slack in zip(reduced.cones, position.head, position.tail, position.inside, strict=True):
            if head > strict and slack <= strict:
                rays[cone] = tail / np.linalg.norm(tail)
            elif head <= strict:
                cones.append(cone)
        if len(kept) == count and len(cones) == len(reduced.cones) and len(rays) == len(reduced.rays):
            return None
        return Reduced(kept, tuple(cones), rays)


def _without_last_digits(point: Floats) -> Floats:
    """Set entries of a vector to zero that are rounding errors of its largest entry.

    Elements that carry nothing have such entries.
    """
    return np.where(abs(point) <= _LAST_DIGITS * abs(point).max(initial=0.0), 0.0, point)


def _blended(rows: ConicProgram, outer: Floats, inner: Floats) -> Floats | None:
    """Move a point towards an inner one until all rows have the slack `_LEFT`.

    The result is None if the inner point has less slack. rows: program of the rows. outer, inner: (columns + 1,)
    points.
    """
    out, within = _row_position(rows, outer).least, _row_position(rows, inner).least
    if within <= _LEFT:
        return None
    share = max(0.0, (_LEFT - out) / (within - out))
    return (1.0 - share) * outer + share * inner


def _row_position(program: ConicProgram, point: Floats) -> _RowPosition:
    """Return the slacks of a scaled vector in all linear rows and cones, but that of λ.

    program: whose cones have three rows. point: (columns,); if it is shorter, its last columns are zero.
    """
    s = program.structure
    values = program.rhs - program.matrix.tocsr()[:, : len(point)] @ point
    tails = [values[s.heads + k] for k in (1, 2)] if s.cones else [np.zeros(0)] * 2
    return _RowPosition(values[s.equalities + 1 : s.equalities + s.linear], values[s.heads], np.column_stack(tails))
