"""Blocks that are not decided: what bounds λ over all ways to choose blocks that cover an assembly.

Where the possible blocks p can be listed, a segmentation is a choice x_p ∈ {0, 1} with every element in exactly one.
The **relaxation by blocks** gives every block forces of its own: on the faces around it in x_p times the dry set, on
those inside in x_p times the inner one, as rays where faces are wedges (`BlockProgram`), else in the rows and cones of
the yield sets (`ConeProgram`), in equilibrium under x_p times its weight and its share of
λ; the forces on a face agree on both sides, and the shares agree on all elements (docs/method.md (6.5), (6.6)). It is
much tighter than face by face (`relaxation`) where blocks are of a few elements, as it knows that a block is one body.

Its dual is a mechanism for every block: velocities u of each element of each block, and a velocity w of each face,
that the blocks on either side open against. For a load factor θ a block then has an **excess**

    e_p = θ b_λ·u_p + b·u_p − Σ_{inside} D_inner(J) − Σ_{around} D_dry(half jump),

and a segmentation whose blocks have Σ e_p > 0 does not reach θ. Numbers v on elements bound Σ e_p from below for all
choices at once: Σ e_p ≥ Σ v + Σ_p min(0, e_p − Σ_{e ∈ p} v_e). All of it is computed here from whatever the solver
returned, with no trust in its status.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_batch import BatchBlockProgram, Multipliers
from jld_core.limit.block_cones import ConeProgram
from jld_core.limit.block_faces import BlockFaces, FacesOfSets
from jld_core.limit.block_parts import block_parts
from jld_core.limit.block_program import BlockProgram
from jld_core.limit.bounds import usable
from jld_core.mechanics import CoulombWedge
from jld_core.solvers import ClarabelSolver, Solver

_RESIDUAL: Final = 1e-7
"""Asked of the solver: bounds are computed from its answer, so that it need not be exact."""

_FINE: Final = 1e-10
"""Asked where the answer is nearer to the threshold than `_NEAR`."""

_NEAR: Final = 1e-4

_STEPS: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""How far above the solver's λ, relative, a bound is tried."""


Asked = tuple[Bools, float, float]
"""Blocks allowed (p,), scaled λ to reach, scaled λ that is not exceeded: see `BlockRelaxation.choose`."""


@dataclass(frozen=True)
class Choice:
    """What the relaxation says of the segmentations made of some blocks.

    bound: scaled λ that none of them exceeds, inf where none was found. refuted: none reaches the threshold.
    share: (p,) x of the solver in [0, 1], and inside: (p,) what its mechanism dissipates inside each block, no proof of
    anything. useless: (p,) blocks that no segmentation holds that reaches the threshold.
    """

    bound: float
    refuted: bool
    share: Floats
    inside: Floats
    useless: Bools


@dataclass(frozen=True)
class _Mechanism:
    """Per block: live work, dissipation less dead work, that inside it alone, and size of the sums; per element: dual
    numbers v, σ."""

    live: Floats
    cost: Floats
    inside: Floats
    size: Floats
    price: Floats
    portion: Floats


class BlockRelaxation:
    """Upper bounds on λ over the segmentations of one assembly into blocks that may be chosen.

    members: elements of each block. inside: faces inside each. seconds: that one program may take; what it came to is
    then taken for what it is worth. Everything is scaled as in `Template`.
    """

    def __init__(
        self,
        analysis: LimitAnalysis,
        members: Sequence[Sequence[int]],
        inside: Sequence[Sequence[int]],
        seconds: float = math.inf,
    ) -> None:
        if not applies_to(analysis):
            raise TypeError("no relaxation by blocks is known of this assembly")
        self.template = analysis.template
        self.solves = 0
        self._parts = block_parts(analysis.template, members, inside)
        self._dry: BlockFaces
        self._inner: BlockFaces
        self._states: BlockProgram | ConeProgram
        dry, inner = (analysis.template.yield_set.wedge(label) for label in (True, False))
        if dry is None or inner is None:
            self._dry, self._inner = (FacesOfSets.of(analysis.template, dry=label) for label in (True, False))
            self._states = ConeProgram(analysis.template, self._parts)
        else:
            self._dry, self._inner = dry, inner
            self._states = BlockProgram(self._parts, dry, inner)
        strong = self._dry.strength(self._parts.side_face)
        self._stuck = np.flatnonzero(strong > 0.0)
        opening = analysis.repair.opening()
        self._opening = None if opening is None else self._parts.halved(opening)
        self._opening_margin = np.inf if self._opening is None else self._margin(*self._opening)
        if not self._opening_margin > 0.0:
            raise ArithmeticError("the motion that opens all faces does not open them on both sides")
        self._many: BatchBlockProgram | None = None
        self._asked = False
        limit: dict[str, Any] = {} if seconds == math.inf else {"time_limit": seconds}
        self._quick = ClarabelSolver(_RESIDUAL, **limit)
        self._careful = ClarabelSolver(_FINE, iterative_refinement_enable=True, **limit)

    # --- solving ----------------------------------------------------------------------------------------

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """What is known of the segmentations into allowed blocks (p,).

        threshold: scaled λ that segmentations must reach to be of interest. most: scaled λ that those allowed do not
        exceed, finite.
        """
        found = self._choose(allowed, threshold, most, self._quick)
        if not self._close(found, threshold):
            return found
        # segmentations as strong as the best one known are refuted by a hair
        return self._choose(allowed, threshold, found.bound, self._careful)

    @property
    def many(self) -> bool:
        """Whether the batch solver solves many programs at a time."""
        if not self._asked:
            self._asked = True
            if isinstance(self._dry, CoulombWedge) and isinstance(self._inner, CoulombWedge):
                elements = self.template.assembly.elements
                self._many = BatchBlockProgram.of(self._parts, self._dry, self._inner, elements.centroid[elements.free])
        return self._many is not None

    def bound_all(self, asked: Sequence[Asked], pool: ThreadPoolExecutor | None = None) -> list[Choice]:
        """`choose` of many at a time, where the batch solver can; pool: one more thread for it."""
        if not self.many or not asked:
            return [self.choose(*one) for one in asked]
        assert self._many is not None
        allowed, threshold, most = (np.array(column) for column in zip(*asked, strict=True))
        answers = self._many.solve(allowed, threshold, most, pool)
        self.solves += len(asked)
        found = []
        for one, answer in zip(asked, answers, strict=True):
            choice = self._judged(answer, *one)
            found.append(choice if answer.solved or choice.refuted else self.choose(*one))
        return found

    def _close(self, found: Choice, threshold: float) -> bool:
        """Whether a choice that is not refuted is so near to the threshold that it is worth another look."""
        return not found.refuted and found.bound <= threshold + _NEAR * max(1.0, abs(threshold))

    def _choose(self, allowed: Bools, threshold: float, most: float, route: Solver) -> Choice:
        program, rows, columns = self._states.of(allowed, threshold, most)
        raw = route.solve(program)
        self.solves += 1
        dual, point = (np.zeros(size) for size in self._states.shape)
        dual[rows], point[columns] = raw.dual, raw.point
        states = self._states
        velocity, wall = dual[states.balance], dual[states.agree]
        answer = Multipliers(velocity, wall, dual[states.cover], -dual[states.share], point[states.x])
        return self._judged(answer, allowed, threshold, most)

    def _judged(self, answer: Multipliers, allowed: Bools, threshold: float, most: float) -> Choice:
        """What a solver's answer proves."""
        share = np.clip(np.nan_to_num(answer.share), 0.0, 1.0)
        mechanism = self._repair(answer, allowed, most)
        if mechanism is None:
            return Choice(most, False, share, np.zeros(len(allowed)), np.zeros(len(allowed), dtype=bool))
        # what bounds Σ e_p is concave in θ: above zero at two load factors, it is so between them
        end, spare_end = self._excess(mechanism, most, allowed)
        excess, spare = self._excess(mechanism, threshold, allowed)
        useless = allowed & (excess + spare > 0.0) & (end + spare_end > 0.0)
        if not end > 0.0:
            return Choice(most, False, share, mechanism.inside, useless)
        if excess > 0.0:
            return Choice(min(most, threshold), True, share, mechanism.inside, useless)
        start = float(mechanism.price.sum())
        for step in _STEPS:
            tried = start + step * max(1.0, abs(start))
            if 0.0 <= tried < most and self._excess(mechanism, tried, allowed)[0] > 0.0:
                return Choice(tried, False, share, mechanism.inside, useless)
        return Choice(most, False, share, mechanism.inside, useless)

    # --- proof ------------------------------------------------------------------------------------------

    def _margin(self, velocity: Floats, wall: Floats, allowed: Bools | None = None) -> float:
        """By how much all jumps, those of allowed blocks (p,), are ones of finite dissipation."""
        parts = self._parts
        half, inner = parts.jumps(velocity, wall)
        margins = [self._dry.margin(half, parts.side_face), self._inner.margin(inner, parts.joint_face)]
        if allowed is not None:
            margins = [margins[0][allowed[parts.side_block]], margins[1][allowed[parts.joint_block]]]
        return float(np.concatenate(margins).min(initial=np.inf))

    def _repair(self, answer: Multipliers, allowed: Bools, most: float) -> _Mechanism | None:
        """Velocities from multipliers, opened until every dissipation is finite, and their sums for each block."""
        if not all(map(usable, (answer.velocity, answer.wall, answer.price, answer.portion))):
            return None
        parts, velocity, wall = self._parts, answer.velocity, answer.wall
        margin = self._margin(velocity, wall, allowed)
        if margin < 0.0:
            if self._opening is None:
                return None
            # at least by what is left of it beside the velocities
            size = max(abs(velocity).max(initial=0.0), abs(wall).max(initial=0.0))
            more = (-1.01 * margin + tolerances.ROUNDING * size) / self._opening_margin
            velocity, wall = velocity + more * self._opening[0], wall + more * self._opening[1]
            if self._margin(velocity, wall, allowed) < 0.0:
                return None
        half, inner = parts.jumps(velocity, wall)
        live = self._sums((parts.live * velocity).sum(axis=1), parts.part_block)
        cost = -self._sums((parts.dead * velocity).sum(axis=1), parts.part_block)
        inside = self._sums(self._inner.dissipation(inner, parts.joint_face), parts.joint_block)
        cost += inside
        stuck = self._stuck
        face, block = parts.side_face[stuck], parts.side_block[stuck]
        np.add.at(cost, block, self._dry.dissipation(half[stuck], face))
        # what rounding may take counts before terms cancel; a jump is six products, far fewer than ROUNDING allows for
        work = (abs(parts.dead) + most * abs(parts.live)) * abs(velocity)
        size = self._sums(work.sum(axis=1), parts.part_block)
        np.add.at(size, parts.joint_block, 1e-2 * self._inner.strength(parts.joint_face) * parts.speed(velocity))
        speed = np.einsum("kij,ki->k", abs(parts.arm[stuck]), abs(velocity[parts.side_part[stuck]]))
        still = np.append(abs(wall).sum(axis=1), 0.0)
        np.add.at(size, block, 1e-2 * self._dry.strength(face) * (speed + still[parts.side_shared[stuck]]))
        return _Mechanism(live, cost, inside, size, answer.price, answer.portion)

    def _sums(self, value: Floats, block: Ints) -> Floats:
        """(p,) sums over the blocks that values belong to."""
        total = np.zeros(self._parts.blocks)
        np.add.at(total, block, value)
        return total

    def _excess(self, mechanism: _Mechanism, load: float, allowed: Bools) -> tuple[float, Floats]:
        """Σ e_p of any choice at least, less what rounding may take; and (p,) how much more of one with block p."""
        value = load * mechanism.portion - mechanism.price
        held = self._sums(value[self._parts.part_element], self._parts.part_block)
        slack = load * mechanism.live - mechanism.cost - held
        size = mechanism.size + abs(held)
        noise = tolerances.ROUNDING * (float(size[allowed].sum()) + float(abs(value).sum()))
        excess = float(value.sum()) + float(np.minimum(slack[allowed], 0.0).sum()) - noise
        return excess, np.maximum(slack, 0.0)


def applies_to(analysis: LimitAnalysis) -> bool:
    """Whether there is a relaxation by blocks: friction is associative, and all joints can open, or give way."""
    sets = analysis.template.yield_set
    if sets.hull() is None:
        return False
    if analysis.repair.opening() is not None:
        return True
    strengths = analysis.template.assembly.strengths
    return bool(np.isfinite(strengths.crush_dry).all() and np.isfinite(strengths.crush_inner).all())
