"""Facial reduction: finite-dissipation motions of assemblies that a self-stress confines, docs/method.md (3.12).

Sources: Borwein & Wolkowicz, Regularizing the abstract convex program, J. Math. Anal. Appl. 83 (1981); Permenter &
Parrilo, Partial facial reduction, Math. Program. 171 (2018).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, TypeAlias

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Floats, Ints
from jld_core.limit.auxiliary_programs import (
    LARGEST,
    LargestSupport,
    interior_motion,
    largest_support,
    polygonal_support,
    project_onto_faces,
)
from jld_core.limit.bounds import (
    Motion,
    Prover,
    Reduced,
    State,
    leaning_program,
    program_of_rows,
    reduced_by,
    unreduced_rows,
    usable,
)
from jld_core.linalg.factors import ConsistentProjector
from jld_core.program import ConicProgram, Template
from jld_core.solvers import ClarabelSolver, RawStatus

DENSE: Final = 4000  # Number of velocities up to which dense algebra is used.
_REDUCTION_ROUNDS: Final = 8  # Largest number of successive self-stresses.
_ROUNDED: Final = 1e-9  # Allowed rounding of jumps per unit of live work, relative to the largest live load.
# Slip, relative to the largest velocity, above which the direction of a ray is taken from the motion.
_SLIDES: Final = 1e-4
_SAME_WAY: Final = 0.5  # Cosine between a slip and a self-stress above which the slip gives the ray.
_ALONG: Final = 1e-4  # Component of a unit vector below which it is set to zero.
_KEPT: Final = 2e-8  # Slack kept in the half-spaces of cones, scaled, to make up for (3.12a).
_LEANS: Final = (1e5, 1e7, 1e8)  # Factors by which a self-stress is added, scaled.
_CALM: Final = 1e-10  # Weight of |F|² next to λ, scaled; without it forces may grow along a self-stress.
_POSITIVE: Final = 1e-6  # Multiplier, relative to the largest, above which it counts as positive.
_LEFT_AFTER_REDUCTION: Final = 1e-12  # Size of a forbidden jump below which its row is dropped.
# Share of the largest velocity that a pseudo-inverse leaves as rounding.
_LAST_DIGIT: Final = 16.0 * float(np.finfo(float).eps)

# Faces with reduced rows (n,), and the projectors (n, q, q) onto their allowed jumps.
_Allowed: TypeAlias = tuple[Ints, Floats]


_NO_WORK: Final = 1e-9  # live work, scaled, up to which it may be zero but for the solver's residual
_SHARES: Final = np.logspace(-14.0, -3.0, 23)  # shares of a motion inside the allowed jumps, tried in turn


class FacialReduction:
    """Repair of motions and states of assemblies that a self-stress confines, docs/method.md (3.12)."""

    def __init__(self, template: Template, prover: Prover) -> None:
        self.template, self.prover = template, prover

    def repair(self, motion: Motion, labels: Bits, normalise: bool = True) -> Motion | None:
        """Move a motion inside the jumps of finite dissipation, margin ≥ 0 up to rounding; None where not found."""
        # The projection is blended with a motion strictly inside the allowed jumps, docs/method.md (3.12).
        if self.template.structure.cones and self.template.matrix.shape[0] > DENSE:
            return None
        # The sign of a live work that is zero up to the solver's residual decides the proof: make it exactly zero. Try
        # first with rays of the live load treated as self-stress.
        idle = not normalise and abs(motion.work) < _NO_WORK
        repaired = self._best_repair(motion, labels, normalise, idle=True, loaded=True) if idle else None
        return repaired or self._best_repair(motion, labels, normalise, idle=idle, loaded=False)

    def _best_repair(self, motion: Motion, labels: Bits, normalise: bool, *, idle: bool, loaded: bool) -> Motion | None:
        """Return the repaired motion of least bound; idle: no live work.

        loaded: self-stresses may balance live load.
        """
        program = self.template.program(labels)
        columns = program.structure.shape[1] - (0 if loaded else 1)
        for search in SEARCHES if program.structure.cones else SEARCHES[-1:]:
            for reduced in _rounds(program, columns, search):
                inward = interior_motion(program_of_rows(program, reduced), columns)
                if inward is None:
                    continue
                inward_motion = self.prover.motion(inward, labels, normalise=False)
                # A motion that needs a large share of the step inside is a poor bound: try all, and keep the best.
                blend = partial(
                    self._blend_inward,
                    step=inward_motion, program=program, reduced=reduced, labels=labels, normalise=normalise, idle=idle,
                )  # fmt: skip
                starts = [motion, self._motion_of_reduced(program, reduced, labels, normalise)]
                turns = (False, True) if reduced.rays else (False,)
                blended = [blend(start, turned=turned) for start in starts if start is not None for turned in turns]
                repaired = [candidate for candidate in blended if candidate is not None]
                if repaired:
                    return min(repaired, key=lambda candidate: candidate.bound)
        return None

    def of_positive_multipliers(self, motion: Motion, multipliers: Floats, labels: Bits) -> Motion | None:
        """Project a motion onto the jumps of rows with positive multipliers (rows,); linear programs only."""
        program = self.template.program(labels)
        rows = unreduced_rows(program).linear
        row_multipliers = multipliers[rows]
        reduced = Reduced(rows[row_multipliers > _POSITIVE * row_multipliers.max(initial=0.0)], ())
        return self._blend_inward(motion, None, program, reduced, labels, normalise=True, idle=False, turned=False)

    def _motion_of_reduced(
        self, program: ConicProgram, reduced: Reduced, labels: Bits, normalise: bool
    ) -> Motion | None:
        """Solve the program of the rows left by facial reduction, and return its mechanism, or None."""
        # More accurate than the mechanism of `program`, the program of all rows.
        if not reduced.rays:
            return None
        reduced_program = program_of_rows(program, reduced, right=True)
        raw = ClarabelSolver(iterative_refinement_enable=True).solve(reduced_program)
        velocity = raw.dual[: self.template.matrix.shape[0]]
        size = float(abs(velocity).max())
        # The dual of an infeasible program is a fall under dead load, wanted only where live work is not normalised.
        falls = raw.status is RawStatus.INFEASIBLE
        if falls == normalise or not (np.isfinite(size) and size > 0.0):
            return None
        return self.prover.motion(velocity if normalise else velocity / size, labels, normalise)

    def states(self, labels: Bits) -> list[State]:
        """Find states that rely on a self-stress at the boundary of cones, to be checked; empty if too large."""
        # Such states serve where no other state comes near λ. With t R added to forces F, t large, |V| ≤ μN restricts F
        # only to the half-space that touches the cone along R, up to |V across R|²/(2 t |R|) (docs/method.md (3.12a)).
        # The program of these half-spaces gives F.
        template = self.template
        if template.matrix.shape[0] > DENSE or not template.structure.cones:
            return []
        program = template.program(labels, _KEPT)
        columns, resultants = program.structure.shape[1] - 1, template.matrix.shape[1]
        states: list[State] = []
        for search in SEARCHES:
            unreduced = unreduced_rows(program)
            support = search(program_of_rows(program, unreduced), columns)
            reduced = support and reduced_by(support, program, unreduced)
            if support is None or not reduced or not reduced.rays:
                continue
            stress = project_onto_faces(program, support, np.zeros(program.structure.equalities), 0.0)
            starts = program.structure.heads[list(reduced.rays)]
            if (program.matrix.tocsr()[starts][:, :columns] @ stress).max() >= 0.0:
                continue  # After the projection the self-stress does not lie on these rays.
            for share in _LEANS:
                leaning = leaning_program(program, reduced, share * stress)
                raw = ClarabelSolver(1e-9, proximal=(resultants, _CALM)).solve(leaning)
                if raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST) and np.all(np.isfinite(raw.point)):
                    point = np.append((raw.point[:columns] + share * stress)[:resultants], raw.point[-1])
                    states.append(self.prover.state(point, labels, passes=3))
        return states

    def _blend_inward(
        self,
        motion: Motion,
        step: Motion | None,
        program: ConicProgram,
        reduced: Reduced,
        labels: Bits,
        *,
        normalise: bool,
        idle: bool,
        turned: bool,
    ) -> Motion | None:
        """Project a motion onto allowed jumps; add the least share of `step` that makes it valid."""
        # A motion is valid if its dissipation is finite.
        live = self.template.live
        velocity = motion.velocity
        for _ in range(3 if turned else 1):
            # Where faces slide, jumps stay on a curved cone: take Newton steps along its tangent at the present slip.
            jumps = (self.prover.transposed @ velocity).reshape(len(labels), -1)
            speed = float(abs(velocity).max()) if turned else np.inf
            allowed = self._allowed_jumps(program, reduced, jumps, speed)
            forbidden = self._forbidden(allowed)
            if idle:
                forbidden = sp.csr_array(sp.vstack([forbidden, sp.csr_array(live[None] / np.linalg.norm(live))]))
            projector, zeros = ConsistentProjector(forbidden), np.zeros(forbidden.shape[0])
            velocity = projector.project(velocity, zeros)
        start, inward = velocity, projector.project((step or motion).velocity, zeros)
        size = float(abs(start).max()) / max(float(abs(inward).max()), 1e-300)
        if not np.isfinite(size):
            return None
        for share in (0.0, *(_SHARES if step else ())):
            velocity = start + share * size * inward
            work = float(live @ velocity)
            if normalise:
                # Skip motions with almost no live work: jumps as small as their rounding would decide the proof.
                if not work * _ROUNDED > tolerances.ROUNDING * float(abs(live).max() * abs(velocity).max()):
                    continue
                velocity, work = velocity / work, 1.0
            result = self._measured(velocity, work, labels, allowed)
            if result.margin >= 0.0:
                return result
        return None

    def _allowed_jumps(self, program: ConicProgram, reduced: Reduced, jumps: Floats, speed: float) -> _Allowed:
        """Return faces with reduced rows (n,) and the projectors (n, q, q) onto their allowed jumps."""
        # A self-stress proves that some yield rows hold with equality: they are removed, and a cone is replaced by the
        # tangent along the self-stress. By duality a jump is a combination of the rows that are left, J = Gᵀz, so that
        # these rows span what is allowed. A face without a reduced row needs no projector. Columns of further unknowns
        # (beyond the resultants) have no jump: only combinations z that vanish there count.
        structure, q = program.structure, self.template.assembly.freedoms
        yields = program.matrix.tocsr()
        row_face = self.template.yield_set.pattern.row_face
        faces = len(self.template.assembly.interfaces)
        first_row = structure.equalities + 1
        is_kept = np.zeros(structure.shape[0], dtype=bool)
        is_kept[reduced.linear] = True
        for cone in reduced.cones:
            is_kept[structure.heads[cone] : structure.heads[cone] + structure.cones[cone]] = True
        is_kept = is_kept[first_row : first_row + len(row_face)]
        reduced_faces = np.unique(row_face[~is_kept])
        rank = np.full(faces, -1)
        rank[reduced_faces] = np.arange(len(reduced_faces))
        kept_rows = np.flatnonzero(is_kept & (rank[row_face] >= 0))
        rows, owner = [yields[first_row + kept_rows]], [rank[row_face[kept_rows]]]
        for cone, direction in reduced.rays.items():
            cone_rows = yields[structure.heads[cone] : structure.heads[cone] + structure.cones[cone]].toarray()
            face = int(row_face[structure.heads[cone] - first_row])
            tangents = _tangent(cone_rows, direction, jumps[face], q * face, speed)
            rows.append(sp.csr_array(np.array(tangents)))
            owner.append(np.full(len(tangents), rank[face]))
        stacked = sp.coo_array(sp.vstack(rows))
        return reduced_faces, _projectors(stacked, np.concatenate(owner), reduced_faces, (faces, q))

    def _forbidden(self, allowed: _Allowed) -> sp.csr_array:
        """Return E (rows, q·free) with E u = 0 if and only if reduced faces have allowed jumps."""
        faces, projectors = allowed
        q = self.template.assembly.freedoms
        jumps = sp.csr_array(self.prover.transposed[(q * faces[:, None] + np.arange(q)).ravel()])
        if not len(faces):
            return jumps
        complement = sp.bsr_array((np.eye(q) - projectors, np.arange(len(faces)), np.arange(len(faces) + 1)))
        stacked = sp.csr_array(complement @ jumps)
        return sp.csr_array(stacked[abs(stacked).max(axis=1).toarray().ravel() > _LEFT_AFTER_REDUCTION])

    def _measured(self, velocity: Floats, work: float, labels: Bits, allowed: _Allowed) -> Motion:
        """Compute margin and bound of velocities, jumps of reduced faces projected onto the allowed ones."""
        # The margin is −inf if this changes a jump by more than rounding.
        jumps = (self.prover.transposed @ velocity).reshape(len(labels), -1)
        # of each face: self-stress bounds no force here, so fast motions elsewhere excuse no closing jump
        terms = (abs(self.prover.transposed) @ abs(velocity)).reshape(jumps.shape).max(axis=1)
        noise = self.prover.exact * terms + _LAST_DIGIT * max(float(abs(velocity).max()), 1.0)
        reduced_faces, projectors = allowed
        projected = (projectors @ jumps[reduced_faces][:, :, None])[:, :, 0]
        if np.any(abs(projected - jumps[reduced_faces]).max(axis=1) > noise[reduced_faces]):
            return Motion(velocity, jumps, work, -np.inf, np.inf)
        jumps[reduced_faces] = projected
        # Set a jump to zero if it is below the rounding of the sums it comes from.
        jumps[abs(jumps).max(axis=1) <= 1e-3 * noise] = 0.0
        sets = self.template.yield_set
        margin = sets.margin(jumps, labels)
        rounding = self.prover.exact * abs(jumps[reduced_faces]).max(axis=1)
        margin[reduced_faces] = np.where(abs(margin[reduced_faces]) <= rounding, 0.0, margin[reduced_faces])
        bound = float(sets.dissipation(jumps, labels).sum() - self.template.dead @ velocity)
        return Motion(velocity, jumps, work, float(margin.min()), bound, self.prover.noise(velocity, bound))


def _projectors(rows: sp.coo_array, owner: Ints, faces: Ints, sizes: tuple[int, int]) -> Floats:
    """Return projectors (n, q, q) onto what the rows of each of the faces `faces` (n,) span.

    rows: (r, columns); owner: (r,) position in `faces`; sizes: all faces, q.
    """
    face_count, q = sizes
    order = np.argsort(owner, kind="stable")
    count = np.bincount(owner, minlength=len(faces))
    number = np.empty(len(owner), dtype=np.int64)  # of each row within its face
    number[order] = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    tables = np.zeros((len(faces), max(1, int(count.max(initial=0))), q))
    rank, column, is_extra = owner[rows.row], rows.col - q * faces[owner[rows.row]], rows.col >= q * face_count
    in_face = (column >= 0) & (column < q)
    tables[rank[in_face], number[rows.row[in_face]], column[in_face]] = rows.data[in_face]
    all_rows = sp.csr_array(rows)
    for face in np.unique(rank[is_extra & (rows.data != 0.0)]).tolist():
        extra_columns = all_rows[np.flatnonzero(owner == face)][:, q * face_count :].toarray()
        free = la.null_space(extra_columns.T)
        basis = free.T @ tables[face, : len(extra_columns)]
        tables[face] = 0.0
        tables[face, : len(basis)] = basis
    basis, singular_values, _ = np.linalg.svd(tables.transpose(0, 2, 1), full_matrices=False)
    largest = singular_values.max(axis=1, initial=0.0)
    spanning = singular_values > np.finfo(float).eps * max(tables.shape[1:]) * largest[:, None]
    return np.asarray((basis * spanning[:, None, :]) @ basis.transpose(0, 2, 1))


def _rounds(program: ConicProgram, columns: int, search: _Search) -> list[Reduced]:
    """List the yield rows that are kept after 0, 1, 2, … self-stresses, in reverse order."""
    # The search ends where no self-stress removes another row, or after `_REDUCTION_ROUNDS` of them.
    rounds = [unreduced_rows(program)]
    for _ in range(_REDUCTION_ROUNDS):
        support = search(program_of_rows(program, rounds[-1]), columns)
        remaining = support and reduced_by(support, program, rounds[-1])
        if not remaining:
            break
        rounds.append(remaining)
    return rounds[::-1]


def _along_axes(program: ConicProgram, columns: int) -> LargestSupport | None:
    """Find a self-stress, projected onto faces of the cones, with shear nearly along an axis put on it."""
    support = largest_support(program, columns, largest=LARGEST)
    point = project_onto_faces(program, support, np.zeros(program.structure.equalities), _ALONG)
    return replace(support, point=point, values=-(program.matrix[:, :columns] @ point))


def _without_projection(program: ConicProgram, columns: int) -> LargestSupport | None:
    """Find a self-stress of any size by an interior-point method, without projection."""
    return largest_support(program, columns, largest=np.inf)


# Function that finds a self-stress from a program and its number of columns
_Search = Callable[[ConicProgram, int], LargestSupport | None]
SEARCHES: Final[tuple[_Search, ...]] = (polygonal_support, _along_axes, _without_projection)
"""Searches for a self-stress in the order tried; programs without cones use the last one only."""


def _tangent(rows: Floats, direction: Floats, jump: Floats, first: int, speed: float) -> list[Floats]:
    """Return the rows that replace a cone (size, columns) on whose boundary a self-stress of `direction` lies."""
    # The first row (columns,) is the tangent plane of the cone along the ray of the self-stress. Where the face slides,
    # the slip of the motion gives the direction of the ray, and a second row rotates the plane to first order.
    tail = rows[1:]
    columns_of_row = [np.flatnonzero(row) for row in tail]
    in_jump_alone = all(len(columns) == 1 and first <= columns[0] < first + len(jump) for columns in columns_of_row)
    if in_jump_alone and len(tail) == 2:
        # In these columns J = −Gᵀz and z = κ (1, −d).
        column = [int(columns[0]) for columns in columns_of_row]
        slip = np.array([jump[k - first] / row[k] for k, row in zip(column, tail, strict=True)])
        size = float(np.linalg.norm(slip))
        if size > _SLIDES * speed:
            slip_direction = slip / size
            if slip_direction @ direction > _SAME_WAY:
                perpendicular = np.array([-slip_direction[1], slip_direction[0]])
                return [rows[0] - slip_direction @ tail, perpendicular @ tail]
    return [rows[0] - direction @ tail]


_ROUNDS: Final = 4  # Largest number of successive self-stresses.
_STRICT: Final = 1e-6  # Slack, relative to the largest force of a vector, that is no rounding.
_SNAP: Final = 1e-4  # Component of a direction on the boundary of a cone below which it is set to zero.
_LEFT: Final = 2e-9  # Slack of a state in all rows that are left, scaled.
_ACCURACIES: Final = ((1e-9, 2e-8), (1e-12, 4e-9))  # Residual to reach, and slack to keep while solving, in turn.
_TIMES: Final = np.logspace(0.0, 14.0, 57)  # Factors of a self-stress, scaled, tried in turn.
_LAST_DIGITS: Final = 4.0 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Attempt:
    """How a ray R with A R = target is sought."""

    force_limit: float  # bound on its forces, scaled; 0: by simplex, without a bound
    tight_slack: float  # slack, scaled, below which a row counts as tight; 0: the point is not projected onto such rows

    def support(self, program: ConicProgram, columns: int, target: Floats) -> LargestSupport | None:
        if self.force_limit:
            return largest_support(program, columns, target, self.force_limit)
        return polygonal_support(program, columns, target)

    def point(self, program: ConicProgram, support: LargestSupport, target: Floats) -> Floats:
        """Return a candidate (columns,) for the ray."""
        return (
            project_onto_faces(program, support, target, _SNAP, self.tight_slack) if self.tight_slack else support.point
        )


_ATTEMPTS: Final = (Attempt(0.0, 1e-5), Attempt(0.0, 0.0), Attempt(1e3, 1e-5), Attempt(1e2, 1e-4))  # in the order tried


@dataclass(frozen=True)
class _Stage:
    """Sequence of self-stresses, and the yield rows that they leave."""

    stresses: tuple[Floats, ...]  # each (columns,) scaled forces
    reduced_before: tuple[Reduced, ...]  # rows of the program in which each was found
    remaining: Reduced  # rows left by all of them


@dataclass(frozen=True)
class _RowPosition:
    linear: Floats  # (k,) slacks of the linear rows
    head: Floats  # (c,) value of the first row of each cone
    tail: Floats  # (c, 2) values of its other rows

    @property
    def inside(self) -> Floats:
        """Return the slack (c,) of each cone: its first row minus the norm of the others."""
        return np.asarray(self.head - np.linalg.norm(self.tail, axis=1))

    @property
    def least(self) -> float:
        return float(min(self.linear.min(initial=np.inf), self.inside.min(initial=np.inf)))


class SelfStress:
    """Rays and states admissible beside large self-stresses, docs/method.md (3.14a), for cones of three rows."""

    def __init__(self, prover: Prover, labels: Bits) -> None:
        self.prover, self.labels = prover, labels
        self.template = prover.template
        self.program = self.template.program(labels)
        self.columns = self.program.structure.shape[1] - 1
        applies = self.template.matrix.shape[0] <= DENSE and set(self.program.structure.cones) == {3}
        self.stages = list(self._stages())[::-1] if applies else []

    def ray(self) -> State | None:
        """Find a ray R₁, A R₁ + b_λ = 0, that is admissible in the rows which large self-stresses leave (3.14a).

        With a state that has slack in all yield sets it proves that every larger λ is admissible; None without proof.
        """
        target = -self.template.live
        for stage, attempt in itertools.product(self.stages, _ATTEMPTS):
            reduced_program = program_of_rows(self.program, stage.remaining)
            support = attempt.support(reduced_program, self.columns, target)
            if support is None:
                continue
            ray = self._as_ray(_without_last_digits(attempt.point(reduced_program, support, target)), reduced_program)
            if self.prover.is_ray(ray):
                return ray
        return None

    def _as_ray(self, point: Floats, remaining: ConicProgram) -> State:
        """Return a candidate (columns,) for a ray with its slack in the rows left, relative to forces below one."""
        forces = point[: self.template.matrix.shape[1]]  # columns after the resultants are auxiliary
        slack = min(0.0, _row_position(remaining, point).least) / min(1.0, float(abs(point).max()) or 1.0)
        return State(self._table(forces), 1.0, slack, self.prover.imbalance(forces, self.template.live))

    def states(self, inside: Floats) -> Iterator[State]:
        """Find states of large λ, from a point `inside` (columns + 1,) with slack in every yield set.

        Their error is that of their large forces: the exact forces next to them are admissible.
        """
        # Forces that are admissible in the rows that the self-stresses leave are blended with `inside`. Self-stresses
        # are then added until all rows hold.
        resultants = self.template.matrix.shape[1]
        inner = self._project_onto_equilibrium(inside)  # a point and its error, like `outer`
        for stage, (tolerance, margin) in itertools.product(self.stages, _ACCURACIES):
            program = program_of_rows(self.template.program(self.labels, margin), stage.remaining, right=True)
            outer = self._project_onto_equilibrium(
                ClarabelSolver(tolerance, proximal=(resultants, _CALM)).solve(program).point
            )
            if inner is None or outer is None:
                continue
            point = _move_inward(program_of_rows(self.program, stage.remaining, right=True), outer[0], inner[0])
            forces = None if point is None else self._with_stresses(point, stage)
            error = max(inner[1], outer[1])
            if point is not None and forces is not None and error <= 1e-3 * _LEFT:
                error = max(error, _LAST_DIGITS * float(abs(forces).max()))
                yield State(self._table(forces[:resultants]), float(point[-1]), 2.0 * error, error)

    def _project_onto_equilibrium(self, point: Floats) -> tuple[Floats, float] | None:
        """Project a point (columns + 1,) onto equilibrium, with the error left; None if unusable."""
        if not usable(point):
            return None
        resultants = self.template.matrix.shape[1]
        state = self.prover.state(np.append(point[:resultants], point[-1]), self.labels, 3)
        return np.concatenate([state.forces.ravel(), point[resultants : self.columns], [state.load]]), state.error

    def _table(self, forces: Floats) -> Floats:
        """Return scaled resultants (q·m,) as a table (m, q)."""
        return forces.reshape(len(self.labels), -1)

    def _with_stresses(self, point: Floats, stage: _Stage) -> Floats | None:
        """Add large self-stresses to a point (columns + 1,) until it is admissible in all rows; None on failure."""
        # Self-stresses are added from the last to the first, each so large that the rows it was found in hold.
        for stress, reduced in zip(stage.stresses[::-1], stage.reduced_before[::-1], strict=True):
            rows = program_of_rows(self.program, reduced, right=True)
            for factor in _TIMES:
                candidate = point + factor * np.append(stress, 0.0)
                if _row_position(rows, candidate).least >= -_LAST_DIGITS * float(abs(candidate).max()):
                    point = candidate
                    break
            else:
                return None
        return point

    def _stages(self) -> Iterator[_Stage]:
        """Find self-stresses one after the other; yield each stage with a cone reduced to a ray."""
        # The search ends where no self-stress removes another row, or after `_ROUNDS` rounds.
        stage = _Stage((), (), unreduced_rows(self.program))
        for _ in range(_ROUNDS):
            for search in SEARCHES[:2]:
                reduced_program = program_of_rows(self.program, stage.remaining)
                support = search(reduced_program, self.columns)
                if support is None:
                    continue
                stress = _without_last_digits(
                    project_onto_faces(reduced_program, support, np.zeros(reduced_program.structure.equalities), _SNAP)
                )
                remaining_rows = self._remaining_rows(stress, reduced_program, stage.remaining)
                if remaining_rows is not None:
                    stage = _Stage((*stage.stresses, stress), (*stage.reduced_before, stage.remaining), remaining_rows)
                    if remaining_rows.rays:
                        yield stage
                    break
            else:
                return

    def _remaining_rows(self, stress: Floats, program: ConicProgram, reduced: Reduced) -> Reduced | None:
        """Return the rows left beside a self-stress (columns,); None if it removes none or is no valid one."""
        position, size = _row_position(program, stress), float(abs(stress).max())
        rounding = self.prover.exact * max(1.0, size)
        imbalance = self.prover.imbalance(stress[: self.template.matrix.shape[1]], np.zeros_like(self.template.live))
        if imbalance > rounding or position.least < -rounding:
            return None
        # Rows with slack beyond `strict` are removed; linear rows come first, then those of rays.
        strict = _STRICT * size
        count = len(reduced.linear)
        linear = reduced.linear[position.linear[:count] <= strict]
        of_rays = zip(reduced.rays.items(), position.linear[count:] <= strict, strict=True)
        rays = {cone: direction for (cone, direction), tight in of_rays if tight}
        cones = []
        for cone, head, tail, slack in zip(reduced.cones, position.head, position.tail, position.inside, strict=True):
            if head <= strict:  # at the apex
                cones.append(cone)
            elif slack <= strict:  # on the boundary, along one ray
                rays[cone] = tail / np.linalg.norm(tail)
        if len(linear) == count and len(cones) == len(reduced.cones) and len(rays) == len(reduced.rays):
            return None
        return Reduced(linear, tuple(cones), rays)


def _without_last_digits(point: Floats) -> Floats:
    """Set entries to zero that are rounding errors of the largest, as of elements without load."""
    return np.where(abs(point) <= _LAST_DIGITS * abs(point).max(initial=0.0), 0.0, point)


def _move_inward(rows: ConicProgram, outer: Floats, inner: Floats) -> Floats | None:
    """Move a point towards an inner one until all rows have slack `_LEFT`; None if the inner one has less."""
    outer_slack, inner_slack = _row_position(rows, outer).least, _row_position(rows, inner).least
    if inner_slack <= _LEFT:
        return None
    share = max(0.0, (_LEFT - outer_slack) / (inner_slack - outer_slack))
    return (1.0 - share) * outer + share * inner


def _row_position(program: ConicProgram, point: Floats) -> _RowPosition:
    """Return the slacks of a vector (≤ columns,) in all linear rows and cones but that of λ."""
    structure = program.structure
    values = program.rhs - program.matrix.tocsr()[:, : len(point)] @ point
    tails = [values[structure.heads + k] for k in (1, 2)] if structure.cones else [np.zeros(0)] * 2
    return _RowPosition(
        values[structure.equalities + 1 : structure.equalities + structure.linear],
        values[structure.heads],
        np.column_stack(tails),
    )
