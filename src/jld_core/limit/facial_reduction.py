"""Facial reduction: motions of assemblies in which a self-stress leaves some conditions on jumps no slack.

A motion of finite dissipation has jumps J = −Gᵀz with z in the dual cones of the yield rows. A self-stress R in the
recession cones gives z·(−G R) = 0. So z is zero in rows where R has slack, and in a second-order cone with R on its
boundary z lies on the one conjugate ray: z = κ (1, −V/|V|), κ ≥ 0. Such rows are taken out, such cones replaced by that
ray, and the search for self-stress begins again, until none is found (docs/method.md (3.12)).
Source: Borwein & Wolkowicz, Regularizing the abstract convex program, J. Math. Anal. Appl. 83 (1981); Permenter &
Parrilo, Partial facial reduction, Math. Program. 171 (2018).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit.auxiliary_programs import (
    LARGEST,
    LargestSupport,
    largest_support,
    motion_inside,
    on_faces,
    polygonal_support,
    tips_of,
)
from jld_core.limit.bounds import Motion, Prover, State
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import ClarabelSolver, RawStatus

_DENSE: Final = 4000  # velocities up to which the facial reduction is done with dense algebra
_ROUNDS: Final = 8  # self-stresses that are sought one after the other, at most
_ROUNDED: Final = 1e-9  # rounding of jumps, times the largest live load, that a motion may have for each unit of work
_SLIDES: Final = 1e-4  # slip beside the largest velocity from which the motion itself tells its direction best
_ALONG: Final = 1e-4  # component of a unit vector below which it is taken as zero where its face is an edge of the set
_KEPT: Final = 2e-8  # slack kept in the half-spaces of cones, scaled: what leaning on a self-stress has to make up for
_LEANS: Final = (1e5, 1e7, 1e8)  # how many times a self-stress is added, scaled
_CALM: Final = 1e-10  # weight of |F|² beside λ, scaled: forces could grow for ever along self-stress
_LEFT: Final = 1e-12  # size of a forbidden jump below which its row says nothing


@dataclass(frozen=True)
class _Reduced:
    """Rows of a program whose multipliers may be other than zero.

    linear: (k,) kept inequalities, rows of the program. cones: kept cones, by their number. rays: direction (size − 1,)
    of the self-stress in each cone of which one ray is kept.
    """

    linear: Ints
    cones: tuple[int, ...]
    rays: dict[int, Floats] = field(default_factory=dict)


class FacialReduction:
    """Repair of motions where self-stress leaves no motion that opens every face.

    Parameters
    ----------
    template : Template
        What is analysed, scaled.
    prover : Prover
        Measures motions of it.
    """

    def __init__(self, template: Template, prover: Prover) -> None:
        self.template, self.prover = template, prover

    def repair(self, motion: Motion, labels: Bits, normalise: bool = True) -> Motion | None:
        """Project a motion on the jumps of finite dissipation and blend it with one inside of those.

        Parameters
        ----------
        motion : Motion
            A solver's motion, scaled.
        labels : (m,) bool array
            True = dry.
        normalise : bool
            Whether the live load's work is to be 1.

        Returns
        -------
        Motion or None
            A motion whose margin is not negative but for rounding on faces without slack; None if none was found.
        """
        if self.template.matrix.shape[0] > _DENSE:
            return None
        # the sign of a work that is zero but for the solver's residual decides the proof: make it zero. What carries
        # ever more live load then stands in the way like a self-stress, if it can
        idle = not normalise and abs(motion.work) < 1e-9
        return (self._repaired(motion, labels, normalise, idle, True) if idle else None) or self._repaired(
            motion, labels, normalise, idle, False
        )

    def _repaired(self, motion: Motion, labels: Bits, normalise: bool, idle: bool, loaded: bool) -> Motion | None:
        """Repair a motion; idle: the live load does no work. loaded: self-stress is in balance with more of it."""
        program = self.template.program(labels)
        columns = program.structure.shape[1] - (0 if loaded else 1)
        for search in _SEARCHES if program.structure.cones else _SEARCHES[-1:]:
            for reduced in _rounds(program, columns, search):
                inside = motion_inside(_of_rows(program, reduced), columns)
                if inside is None:
                    continue
                step = self.prover.motion(inside, labels, normalise=False)
                for given in (motion, self._solved(program, reduced, labels, normalise)):
                    found = given and self._blended(given, step, program, reduced, labels, normalise, idle)
                    if found:
                        return found
        return None

    def _solved(self, program: ConicProgram, reduced: _Reduced, labels: Bits, normalise: bool) -> Motion | None:
        """The multipliers of the program of the rows left, whose relative interior is not empty; None without rays.

        Where a cone is left with one ray, the multipliers of the whole program are known to half their digits.
        """
        if not reduced.rays:
            return None
        left = _of_rows(program, reduced, right=True)
        raw = ClarabelSolver(iterative_refinement_enable=True).solve(left)
        velocity = raw.dual[: self.template.matrix.shape[0]]
        size = float(abs(velocity).max())
        if (raw.status is RawStatus.INFEASIBLE) is normalise or not (np.isfinite(size) and size > 0.0):
            return None
        return self.prover.motion(velocity if normalise else velocity / size, labels, normalise)

    def states(self, labels: Bits) -> list[State]:
        """States that lean on a self-stress at the boundary of friction's cones, where no other comes near λ.

        With t R added to forces F, t large, |V| ≤ μN asks of F no more than the half-space that touches the cone along
        R, but for |V across R|²/(2 t |R|): the program of these half-spaces gives F.

        labels: (m,) True dry.
        """
        template = self.template
        if template.matrix.shape[0] > _DENSE or not template.structure.cones:
            return []
        program = template.program(labels, _KEPT)
        columns, resultants = program.structure.shape[1] - 1, template.matrix.shape[1]
        found: list[State] = []
        for search in _SEARCHES:
            whole = _whole(program)
            support = search(_of_rows(program, whole), columns)
            reduced = support and _left_by(support, program, whole)
            if support is None or not reduced or not reduced.rays:
                continue
            stress = on_faces(program, support, np.zeros(program.structure.equalities), 0.0)
            starts = program.structure.heads[list(reduced.rays)]
            if (program.matrix.tocsr()[starts][:, :columns] @ stress).max() >= 0.0:
                continue  # made exact, it is not on these rays after all
            for share in _LEANS:
                stated = _leaning(program, reduced, share * stress)
                raw = ClarabelSolver(1e-9, proximal=(resultants, _CALM)).solve(stated)
                if raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST) and np.all(np.isfinite(raw.point)):
                    y = np.append((raw.point[:columns] + share * stress)[:resultants], raw.point[-1])
                    found.append(self.prover.state(y, labels, passes=3))
        return found

    def _blended(
        self,
        motion: Motion,
        step: Motion,
        program: ConicProgram,
        reduced: _Reduced,
        labels: Bits,
        normalise: bool,
        idle: bool,
    ) -> Motion | None:
        """The motion in the jumps that the rows left allow, moved inside just far enough."""
        live = self.template.live
        velocity = motion.velocity
        for _ in range(3 if reduced.rays else 1):
            # where faces slide, jumps stay on a curved cone: Newton steps by its tangent at the present slip
            jumps = (self.prover.transposed @ velocity).reshape(len(labels), -1)
            bases = self._allowed_jumps(program, reduced, jumps, float(abs(velocity).max()))
            forbid = self._forbidden(bases)
            if idle:
                forbid = np.vstack([forbid, live / np.linalg.norm(live)])
            inverse = np.asarray(np.linalg.pinv(forbid, rcond=1e-11)) if len(forbid) else np.zeros((len(live), 0))
            velocity = _projected(velocity, forbid, inverse)
        start, inward = velocity, _projected(step.velocity, forbid, inverse)
        size = float(abs(start).max()) / max(float(abs(inward).max()), 1e-300)
        for share in (0.0, *np.logspace(-14.0, -3.0, 23)):
            velocity = start + share * size * inward
            work = float(live @ velocity)
            if normalise:
                # where the live load hardly works, what decides the proof would be jumps as small as their rounding
                if not work * _ROUNDED > tolerances.ROUNDING * float(abs(live).max() * abs(velocity).max()):
                    continue
                velocity, work = velocity / work, 1.0
            found = self._measured(velocity, work, labels, bases)
            if found.margin >= 0.0:
                return found
        return None

    def _allowed_jumps(
        self, program: ConicProgram, reduced: _Reduced, jumps: Floats, speed: float
    ) -> dict[int, Floats]:
        """Per face that may not move freely: an orthonormal basis (q, k) of the jumps its rows left allow.

        jumps: (m, q) of the present motion; speed: its largest velocity.
        """
        s, q = program.structure, self.template.assembly.freedoms
        yields = program.matrix.tocsr()
        pattern = self.template.yield_set.pattern
        faces = len(self.template.assembly.interfaces)
        first = s.equalities + 1
        whole = np.zeros(s.shape[0], dtype=bool)
        whole[reduced.linear] = True
        for cone in reduced.cones:
            whole[s.heads[cone] : s.heads[cone] + s.cones[cone]] = True
        rays: dict[int, list[Floats]] = {}
        for cone, direction in reduced.rays.items():
            rows = yields[s.heads[cone] : s.heads[cone] + s.cones[cone]].toarray()
            face = int(pattern.row_face[s.heads[cone] - first])
            rays.setdefault(face, []).extend(_tangent(rows, direction, jumps[face], q * face, speed))
        bases: dict[int, Floats] = {}
        for face in range(faces):
            own = first + np.flatnonzero(pattern.row_face == face)
            if whole[own].all():
                continue
            table = np.vstack([yields[own[whole[own]]].toarray(), *(row[None] for row in rays.get(face, []))])
            extra = table[:, q * faces :]
            extra = extra[:, np.any(extra != 0.0, axis=0)]
            free = la.null_space(extra.T) if extra.size else np.eye(len(table))
            bases[face] = la.orth(table[:, q * face : q * face + q].T @ free) if free.size else np.zeros((q, 0))
        return bases

    def _forbidden(self, bases: dict[int, Floats]) -> Floats:
        """Rows E with E u = 0 ⇔ every reduced face jumps within its basis."""
        q = self.template.assembly.freedoms
        parts = []
        for face, basis in bases.items():
            jumps = self.prover.transposed[q * face : q * face + q].toarray()
            parts.append(jumps - basis @ (basis.T @ jumps))
        if not parts:
            return np.zeros((0, self.template.matrix.shape[0]))
        stacked = np.concatenate(parts)
        return np.asarray(stacked[abs(stacked).max(axis=1) > _LEFT])

    def _measured(self, velocity: Floats, work: float, labels: Bits, bases: dict[int, Floats]) -> Motion:
        """Margin and bound, the jumps of reduced faces taken on their bases, where they lie but for rounding."""
        jumps = (self.prover.transposed @ velocity).reshape(len(labels), -1)
        noise = tolerances.ROUNDING * max(float(abs(velocity).max()), 1.0)
        for face, basis in bases.items():
            snapped = basis @ (basis.T @ jumps[face])
            if abs(snapped - jumps[face]).max() > noise:
                return Motion(velocity, jumps, work, -np.inf, np.inf)
            jumps[face] = snapped
        # a jump below the rounding of the sums it comes from is none
        jumps[abs(jumps).max(axis=1) <= 1e-3 * noise] = 0.0
        sets = self.template.yield_set
        margin = sets.margin(jumps, labels)
        edge: Ints = np.array(sorted(bases), dtype=np.int64)
        margin[edge] = np.where(abs(margin[edge]) <= noise, 0.0, margin[edge])
        bound = float(sets.dissipation(jumps, labels).sum() - self.template.dead @ velocity)
        return Motion(velocity, jumps, work, float(margin.min()), bound, self.prover.noise(velocity, bound))


def _whole(program: ConicProgram) -> _Reduced:
    """All rows but that of λ."""
    s = program.structure
    return _Reduced(tips_of(s)[: s.linear - 1], tuple(range(len(s.cones))))


def _rounds(program: ConicProgram, columns: int, search: _Search) -> list[_Reduced]:
    """The rows left after each self-stress found, the last first."""
    found = [_whole(program)]
    for _ in range(_ROUNDS):
        support = search(_of_rows(program, found[-1]), columns)
        after = support and _left_by(support, program, found[-1])
        if not after:
            break
        found.append(after)
    return found[::-1]


def _projected(velocity: Floats, forbid: Floats, inverse: Floats) -> Floats:
    """The velocity without what is forbidden; inverse: the pseudo-inverse of `forbid`."""
    for _ in range(2):
        velocity = velocity - inverse @ (forbid @ velocity)
    return velocity


def _of_rows(program: ConicProgram, reduced: _Reduced, right: bool = False) -> ConicProgram:
    """The program of the rows left, rays as inequalities after the others; right-hand sides zero unless asked for."""
    s = program.structure
    first = np.concatenate([np.arange(s.equalities + 1), reduced.linear]).astype(np.int64)
    cones = [np.arange(s.heads[cone], s.heads[cone] + s.cones[cone]) for cone in reduced.cones]
    last = np.concatenate(cones or [np.empty(0)]).astype(np.int64)
    pick = [sp.eye_array(s.shape[0]).tocsr()[first]]
    if reduced.rays:
        ways = sp.lil_array((len(reduced.rays), s.shape[0]))
        for row, (cone, direction) in enumerate(reduced.rays.items()):
            ways[row, s.heads[cone]] = 1.0
            for place, value in enumerate(direction, start=1):
                ways[row, s.heads[cone] + place] = -value
        pick.append(ways.tocsr())
    chosen: sp.csr_array = sp.vstack([*pick, sp.eye_array(s.shape[0]).tocsr()[last]]).tocsr()
    rhs = np.asarray(chosen @ program.rhs) if right else np.zeros(chosen.shape[0])
    linear = 1 + len(reduced.linear) + len(reduced.rays)
    sizes = tuple(s.cones[cone] for cone in reduced.cones)
    return pack(chosen @ program.matrix.tocsr(), rhs, program.objective, s.equalities, linear, sizes, s.places)


def _leaning(program: ConicProgram, reduced: _Reduced, stress: Floats) -> ConicProgram:
    """The program of forces that are admissible once a large self-stress (columns,) is added.

    In a cone with R = stress on its boundary, along d: s (2 |R|) ≥ |V across d|², s = t − d·V.
    """
    left = _of_rows(program, reduced, right=True)
    s, matrix, own = program.structure, program.matrix.tocsr(), left.structure
    rows, ends = [left.matrix.tocsr()], [left.rhs]
    last = own.equalities + own.linear - len(reduced.rays)
    for number, (cone, way) in enumerate(reduced.rays.items()):
        at = slice(s.heads[cone], s.heads[cone] + s.cones[cone])
        touch, end = left.matrix.tocsr()[[last + number]], left.rhs[last + number]
        size = float(-(matrix[[s.heads[cone]]][:, : len(stress)] @ stress)[0])
        across = sp.csr_array(la.null_space(way[None]).T) * (2.0 / np.sqrt(2.0 * size))
        rows += [touch, across @ matrix[at][1:], touch]
        ends += [np.array([end + 1.0]), np.asarray(across @ program.rhs[at][1:]), np.array([end - 1.0])]
    sizes = own.cones + tuple(s.cones[cone] for cone in reduced.rays)
    tall = sp.vstack(rows)
    return pack(tall, np.concatenate(ends), program.objective, own.equalities, own.linear, sizes, own.places)


def _left_by(found: LargestSupport, program: ConicProgram, reduced: _Reduced) -> _Reduced | None:
    """The rows left beside a self-stress in those left so far; None if they are the same."""
    sizes = [program.structure.cones[cone] for cone in reduced.cones]
    linear = len(reduced.linear) + len(reduced.rays)
    loose: Bools = found.slack > 0.5
    kept = reduced.linear[~loose[: len(reduced.linear)]]
    turned = dict(zip(reduced.rays, loose[len(reduced.linear) : linear], strict=True))
    rays = {cone: way for cone, way in reduced.rays.items() if not turned[cone]}
    cones = []
    starts = len(found.values) - sum(sizes) + np.cumsum([0, *sizes])[:-1]
    for cone, start, size, free in zip(reduced.cones, starts, sizes, loose[linear:], strict=True):
        if free:
            continue
        way = found.ray(start, size)
        if way is None:
            cones.append(cone)
        else:
            rays[cone] = way
    if len(kept) == len(reduced.linear) and len(cones) == len(reduced.cones) and len(rays) == len(reduced.rays):
        return None
    return _Reduced(kept, tuple(cones), rays)


def _along_axes(program: ConicProgram, columns: int) -> LargestSupport | None:
    """Self-stress by interior point, its rays turned to the axes of faces where they nearly are, and made exact."""
    found = largest_support(program, columns, largest=LARGEST)
    point = on_faces(program, found, np.zeros(program.structure.equalities), _ALONG)
    return replace(found, point=point, values=-(program.matrix[:, :columns] @ point))


def _plainly(program: ConicProgram, columns: int) -> LargestSupport | None:
    """Self-stress by interior point."""
    return largest_support(program, columns, largest=np.inf)


_Search = Callable[[ConicProgram, int], LargestSupport | None]
_SEARCHES: Final[tuple[_Search, ...]] = (polygonal_support, _along_axes, _plainly)


def _tangent(rows: Floats, direction: Floats, jump: Floats, place: int, speed: float) -> list[Floats]:
    """Rows of a cone of which one ray is left: that ray, and where the face slides what turns it, to first order.

    rows: (size, columns) of the cone. direction: of the self-stress. jump: (q,) of its face, whose columns begin at
    `place`. Where the face slides the motion's own slip is known better than the self-stress.
    """
    tail = rows[1:]
    where = [np.flatnonzero(row) for row in tail]
    plain = all(len(at) == 1 and place <= at[0] < place + len(jump) for at in where)
    if plain and len(tail) == 2:
        # J = −Gᵀz and z = κ (1, −d) in these columns
        slip = np.array([jump[at[0] - place] / row[at[0]] for at, row in zip(where, tail, strict=True)])
        size = float(np.linalg.norm(slip))
        if size > _SLIDES * speed:
            own = slip / size
            if own @ direction > 0.5:
                across = np.array([-own[1], own[0]])
                return [rows[0] - own @ tail, across @ tail]
    return [rows[0] - direction @ tail]
