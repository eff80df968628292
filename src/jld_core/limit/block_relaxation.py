"""Upper bounds on λ over all choices of blocks that cover an assembly, docs/method.md (6.5), (6.6).

Sets of wedge shape are rays (`BlockProgram`), others rows and cones (`ConeProgram`). For blocks of few elements the
bound is much tighter than that of the face-by-face `Relaxation`, because each block is one body. Bounds are computed
from the values that the solver returned, whatever its status.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bools, Floats, Ints
from jld_core.batch import chosen
from jld_core.batch.batch_solver import SOLVED, BatchBlockSolver, BlockAnswers, BlockColumns
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_program import (
    LEAST_SHARE,
    BlockFaces,
    BlockParts,
    BlockProgram,
    CappedWedge,
    ConeProgram,
    Q,
    YieldSetFaces,
    block_parts,
    columns_of,
)
from jld_core.limit.bounds import usable
from jld_core.mechanics.yield_set import CoulombWedge
from jld_core.solvers import ClarabelSolver, Solver


@dataclass(frozen=True)
class BlockMultipliers:
    """Velocities, multipliers and shares that a solver returned for one set of allowed blocks, scaled."""

    velocity: Floats  # (k, q) velocities of the parts
    wall: Floats  # (f, q) velocities of the shared faces
    # price, portion: (n,) multipliers of each element: v of its cover row, docs/method.md (6.6), and σ of its row for
    # the share of λ
    price: Floats
    portion: Floats
    share: Floats  # (p,) share x of every block
    solved: bool = True  # True if the values are final; if False, a further solve may give a better bound
    load: float = math.nan  # scaled λ of the solver; without proof


@dataclass(frozen=True)
class BlockMechanism:
    """Velocities and multipliers of one block relaxation, which prove its bound."""

    case: int  # index of the load case
    multipliers: BlockMultipliers  # values that the solver returned; `BlockRelaxation.evaluate` repairs them before use


class BatchBlockProgram:
    """Program of the block relaxation in the batch solver; several threads may use it at once."""

    def __init__(self, parts: BlockParts, blocks: Sequence[BlockColumns], places: Floats) -> None:
        self._elements = Q * (parts.shared + np.arange(parts.elements))
        rhs = np.zeros(Q * len(places))
        rhs[self._elements] = 1.0
        self._shared = parts.shared
        self._batch = BatchBlockSolver(blocks, places, rhs, self._elements + 1)
        self._balance = _balance(parts, blocks)

    @classmethod
    def of(
        cls, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge, centroids: Floats
    ) -> BatchBlockProgram | None:
        """Create the block program; None if the batch solver does not support it, or is not compiled."""
        if chosen() is None:
            return None
        blocks = columns_of(parts, dry, inner)
        if blocks is None or not BatchBlockSolver.supports(blocks):
            return None
        is_shared = parts.side_shared >= 0
        centre_sum, count = np.zeros((parts.shared, centroids.shape[1])), np.zeros(parts.shared)
        np.add.at(centre_sum, parts.side_shared[is_shared], centroids[parts.part_element[parts.side_part[is_shared]]])
        np.add.at(count, parts.side_shared[is_shared], 1.0)
        return cls(parts, blocks, np.vstack([centre_sum / np.maximum(count, 1.0)[:, None], centroids]))

    def solve(
        self, allowed: Bools, thresholds: Floats, most: Floats, pool: ThreadPoolExecutor | None = None
    ) -> list[BlockMultipliers]:
        """Solve k programs with allowed blocks (k, p) for scaled λ `thresholds` (k,) to reach, and `most` (k,).

        most: scaled λ that is not exceeded; `pool` supplies one more thread.
        """
        # Full registers are divided between two threads; a single one is not, as a partly filled register takes as
        # long.
        count, width = len(allowed), self._batch.width
        registers = -(-count // width)
        first_share = width * (registers if pool is None else -(-registers // 2))
        portions = [part for part in (np.arange(first_share)[:count], np.arange(first_share, count)) if len(part)]

        def run(rows: Ints) -> BlockAnswers:
            return self._batch.solve(allowed[rows], thresholds[rows], LEAST_SHARE * thresholds[rows], most[rows])

        pending = [] if pool is None else [pool.submit(run, rows) for rows in portions[1:]]
        portions_solved = [run(portions[0]), *(other.result() for other in pending)]
        return [self._multipliers(answers, k) for answers in portions_solved for k in range(len(answers.state))]

    def _multipliers(self, answers: BlockAnswers, k: int) -> BlockMultipliers:
        shared = answers.shared[k]
        return BlockMultipliers(
            velocity=-answers.own[k][self._balance],
            wall=-shared[: Q * self._shared].reshape(-1, Q),
            price=-shared[self._elements],
            portion=shared[self._elements + 1],
            share=answers.share[k],
            solved=answers.state[k] == SOLVED,
            load=float(answers.load[k]),
        )


def _balance(parts: BlockParts, blocks: Sequence[BlockColumns]) -> Ints:
    """Return the indices (k, q) of the equilibrium rows of all parts, the first rows of each block."""
    first_row = np.concatenate([[0], np.cumsum([block.own for block in blocks])])
    first_part = np.searchsorted(parts.part_block, parts.part_block)
    row = first_row[parts.part_block] + Q * (np.arange(len(first_part)) - first_part)
    return np.asarray(row[:, None] + np.arange(Q))


# Residual requested from the solver; bounds are computed from its answer, so it need not be exact
_RESIDUAL: Final = 1e-7

_FINE: Final = 1e-10  # residual requested for a second solve, where the bound is closer to the threshold than `_NEAR`

# Distance of a bound above the threshold, relative to max(1, |threshold|), up to which a second solve is made
_NEAR: Final = 1e-4

# Relative distance from λ up to which a bound that iterations left open is taken. A program of 16 000 sides takes
# another solver 18 times as long.
_ROUGH: Final = 3e-2

# Relative distances above the solver's λ at which a bound is tried, in order
_STEPS: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)


BlockRequest = tuple[Bools, float, float]
"""Arguments of `BlockRelaxation.choose`: allowed blocks (p,), scaled λ to reach, scaled λ that is not exceeded."""


@dataclass(frozen=True)
class Choice:
    """Result of the block relaxation for the segmentations into allowed blocks."""

    # λ that no segmentation exceeds: at most the given upper bound, scaled. In the unit of the governing factor if it
    # comes from `CaseBlockRelaxation`.
    bound: float
    refuted: bool  # True if none of them reaches the threshold
    share: Floats  # (p,) values x of the solver, in [0, 1]; without proof
    inside: Floats  # (p,) dissipation of the mechanism inside each block; without proof
    useless: Bools  # (p,) blocks that occur in no segmentation that reaches the threshold
    # proof of the bound and of the useless blocks: one mechanism for each load case that was solved
    mechanisms: tuple[BlockMechanism, ...] = ()


@dataclass(frozen=True)
class _Mechanism:
    """Work and dissipation of one mechanism per block, and its multipliers per element."""

    live: Floats  # (p,) work of the live load
    cost: Floats  # (p,) dissipation minus dead work
    inside: Floats  # (p,) dissipation inside the block
    size: Floats  # (p,) sum of absolute terms, which bounds rounding
    # price, portion: (n,) multipliers v and σ, see `BlockMultipliers`
    price: Floats
    portion: Floats


# Share of the rounding allowed for sums that a jump needs: it is a sum of six products
_ROUNDING_OF_JUMPS: Final = 1e-2

_OVERSHOOT: Final = 1.01  # factor on the opening that a mechanism lacks: a little more is added


class BlockRelaxation:
    """Upper bounds on scaled λ over the segmentations into selectable blocks.

    seconds: time limit of one program, after which the solver's last values give the bound. caps: (m,) scaled normal
    forces that no layout exceeds, planar wedges only (`NormalCaps`). Raises TypeError where `applies_to` is False,
    ArithmeticError if the opening motion does not open every face.
    """

    def __init__(
        self,
        analysis: LimitAnalysis,
        members: Sequence[Sequence[int]],
        inside: Sequence[Sequence[int]],
        seconds: float = math.inf,
        caps: Floats | None = None,
    ) -> None:
        if not applies_to(analysis):
            raise TypeError("the block relaxation does not apply to this assembly")
        self.template = analysis.template
        self.solves = 0
        self._parts = block_parts(analysis.template, members, inside)
        self._dry: BlockFaces
        self._inner: BlockFaces
        self._states: BlockProgram | ConeProgram
        dry, inner = (analysis.template.yield_set.coulomb_wedge(label) for label in (True, False))
        if dry is None or inner is None:
            self._dry, self._inner = (YieldSetFaces.of(analysis.template, dry=label) for label in (True, False))
            self._states = ConeProgram(analysis.template, self._parts)
        else:
            self._dry, self._inner = (
                (dry, inner) if caps is None else (CappedWedge(dry, caps), CappedWedge(inner, caps))
            )
            self._states = BlockProgram(self._parts, dry, inner, caps)
        strength = self._dry.strength(self._parts.side_face)
        self._cohesive_sides = np.flatnonzero(strength > 0.0)
        opening = analysis.repair.opening()
        self._opening = None if opening is None else self._parts.halved(opening)
        self._opening_margin = np.inf if self._opening is None else self._margin(*self._opening)
        if not self._opening_margin > 0.0:
            raise ArithmeticError("the opening motion does not open all faces on both sides")

        time_limit: dict[str, Any] = {} if seconds == math.inf else {"time_limit": seconds}
        self._coarse_solver = ClarabelSolver(_RESIDUAL, **time_limit)
        self._fine_solver = ClarabelSolver(_FINE, iterative_refinement_enable=True, **time_limit)

    # --- solving ----------------------------------------------------------------------------------------

    def choose(self, allowed: Bools, threshold: float, most: float) -> Choice:
        """Bound λ, within [threshold, most], over the segmentations into allowed blocks (p,)."""
        choice = self._choose(allowed, threshold, most, self._coarse_solver)
        if not self._is_close(choice, threshold):
            return choice
        # Segmentations about as strong as the best known one are refuted by a small excess: solve with a finer
        # residual.
        return self._choose(allowed, threshold, choice.bound, self._fine_solver)

    def evaluate(self, mechanism: BlockMechanism, allowed: Bools, threshold: float, most: float) -> Choice:
        """Bound λ by the mechanism of an earlier program: bound, refutation and useless blocks; no solver."""
        return self._proven_choice(mechanism.multipliers, allowed, threshold, most)

    @property
    def batched(self) -> bool:
        """Return True if the batch solver solves many programs at a time."""
        return self._batch_program is not None

    @cached_property
    def _batch_program(self) -> BatchBlockProgram | None:
        if not (isinstance(self._dry, CoulombWedge) and isinstance(self._inner, CoulombWedge)):
            return None
        elements = self.template.assembly.elements
        return BatchBlockProgram.of(self._parts, self._dry, self._inner, elements.centroid[elements.free])

    def bound_all(self, requests: Sequence[BlockRequest], pool: ThreadPoolExecutor | None = None) -> list[Choice]:
        """Bound λ for many sets of allowed blocks, by the batch solver where it applies."""
        if self._batch_program is None or not requests:
            return [self.choose(*request) for request in requests]
        allowed, threshold, upper = (np.array(column) for column in zip(*requests, strict=True))
        answers = self._batch_program.solve(allowed, threshold, upper, pool)
        self.solves += len(requests)
        choices = []
        for request, answer in zip(requests, answers, strict=True):
            choice = self._proven_choice(answer, *request)
            settled = answer.solved or choice.refuted
            if not settled and not self._is_close(choice, request[1]):
                # a large program that iterations ended too early
                settled = choice.bound <= answer.load + _ROUGH * abs(answer.load)
            choices.append(choice if settled else self.choose(*request))
        return choices

    def _is_close(self, choice: Choice, threshold: float) -> bool:
        """Return True where a finer residual may refute a threshold that is not refuted."""
        return not choice.refuted and choice.bound <= threshold + _NEAR * max(1.0, abs(threshold))

    def _choose(self, allowed: Bools, threshold: float, most: float, solver: Solver) -> Choice:
        """Solve the program of the allowed blocks by one solver, and return the proven bound."""
        program, rows, columns = self._states.of(allowed, threshold, most)
        raw = solver.solve(program)
        self.solves += 1
        dual, point = (np.zeros(size) for size in self._states.shape)
        dual[rows], point[columns] = raw.dual, raw.point
        states = self._states
        velocity, wall = dual[states.balance], dual[states.equal_forces]
        answer = BlockMultipliers(velocity, wall, dual[states.cover], -dual[states.share], point[states.x])
        return self._proven_choice(answer, allowed, threshold, most)

    def _proven_choice(self, answer: BlockMultipliers, allowed: Bools, threshold: float, most: float) -> Choice:
        """Compute the bound that the velocities and multipliers of a solver prove."""
        share = np.clip(np.nan_to_num(answer.share), 0.0, 1.0)
        mechanism = self._repair(answer, allowed, most)
        if mechanism is None:
            zeros = np.zeros(len(allowed))
            return Choice(most, refuted=False, share=share, inside=zeros, useless=zeros.astype(bool))
        # The lower bound of Σ e_p is concave in θ: if it is positive at two load factors, it is positive between them.
        at_most, spare_at_most = self._excess(mechanism, most, allowed)
        at_threshold, spare_at_threshold = self._excess(mechanism, threshold, allowed)
        useless = allowed & (at_threshold + spare_at_threshold > 0.0) & (at_most + spare_at_most > 0.0)
        refuted = at_most > 0.0 and at_threshold > 0.0
        bound = min(most, threshold) if refuted else most
        if at_most > 0.0 and not refuted:
            # the least λ near that of the mechanism from which on the bound holds
            mechanism_load = float(mechanism.price.sum())
            for step in _STEPS:
                load_factor = mechanism_load + step * max(1.0, abs(mechanism_load))
                if 0.0 <= load_factor < most and self._excess(mechanism, load_factor, allowed)[0] > 0.0:
                    bound = load_factor
                    break
        return Choice(bound, refuted, share, mechanism.inside, useless, (BlockMechanism(0, answer),))

    # --- proof ------------------------------------------------------------------------------------------

    def _margin(self, velocity: Floats, wall: Floats, allowed: Bools | None = None) -> float:
        """Return the least margin of half jumps and jumps at joints of allowed blocks (p,); inf without jumps."""
        parts = self._parts
        half, inner = parts.jumps(velocity, wall)
        margins = [self._dry.margin(half, parts.side_face), self._inner.margin(inner, parts.joint_face)]
        if allowed is not None:
            margins = [margins[0][allowed[parts.side_block]], margins[1][allowed[parts.joint_block]]]
        return float(np.concatenate(margins).min(initial=np.inf))

    def _repair(self, answer: BlockMultipliers, allowed: Bools, most: float) -> _Mechanism | None:
        """Open velocities until every dissipation is finite, and sum their work; None where that fails."""
        opened = self.opened(answer, allowed)
        if opened is None:
            return None
        parts, (velocity, wall) = self._parts, opened
        half, inner = parts.jumps(velocity, wall)
        live = self._sums((parts.live * velocity).sum(axis=1), parts.part_block)
        cost = -self._sums((parts.dead * velocity).sum(axis=1), parts.part_block)
        inside = self._sums(self._inner.dissipation(inner, parts.joint_face), parts.joint_block)
        cost += inside
        cohesive = self._cohesive_sides
        face, block = parts.side_face[cohesive], parts.side_block[cohesive]
        np.add.at(cost, block, self._dry.dissipation(half[cohesive], face))
        # Count rounding before terms cancel; a jump is a sum of six products, far fewer than ROUNDING allows for.
        work = (abs(parts.dead) + most * abs(parts.live)) * abs(velocity)
        size = self._sums(work.sum(axis=1), parts.part_block)
        joint_cost = _ROUNDING_OF_JUMPS * self._inner.strength(parts.joint_face) * parts.jump_size(velocity)
        np.add.at(size, parts.joint_block, joint_cost)
        part_size = np.einsum("kij,ki->k", abs(parts.arm[cohesive]), abs(velocity[parts.side_part[cohesive]]))
        wall_size = np.append(abs(wall).sum(axis=1), 0.0)
        side_size = part_size + wall_size[parts.side_shared[cohesive]]
        np.add.at(size, block, _ROUNDING_OF_JUMPS * self._dry.strength(face) * side_size)
        return _Mechanism(live, cost, inside, size, answer.price, answer.portion)

    @property
    def parts(self) -> BlockParts:
        """Return the parts, sides and joints of the possible blocks."""
        return self._parts

    def opened(self, answer: BlockMultipliers, allowed: Bools, share: float = 0.0) -> tuple[Floats, Floats] | None:
        """Open velocities (k, q), (f, q) until allowed blocks dissipate finitely, and by a share of their size."""
        if not all(map(usable, (answer.velocity, answer.wall, answer.price, answer.portion))):
            return None
        velocity, wall = answer.velocity, answer.wall
        margin = self._margin(velocity, wall, allowed)
        size = max(abs(velocity).max(initial=0.0), abs(wall).max(initial=0.0))
        if margin < 0.0 or share > 0.0:
            if self._opening is None:
                return None if margin < 0.0 else (velocity, wall)
            # Open by at least the rounding error of the velocities.
            step = max(-_OVERSHOOT * margin + tolerances.ROUNDING * size if margin < 0.0 else 0.0, share * size)
            step /= self._opening_margin
            velocity, wall = velocity + step * self._opening[0], wall + step * self._opening[1]
            if self._margin(velocity, wall, allowed) < 0.0:
                return None
        return velocity, wall

    def _sums(self, value: Floats, block: Ints) -> Floats:
        """Return the sums (p,) of values (k,) over the blocks they belong to."""
        total = np.zeros(self._parts.blocks)
        np.add.at(total, block, value)
        return total

    def _excess(self, mechanism: _Mechanism, load: float, allowed: Bools) -> tuple[float, Floats]:
        """Bound the total excess (6.6) of allowed blocks from below, and by how much (p,) choosing each raises it."""
        value = load * mechanism.portion - mechanism.price
        multipliers = self._sums(value[self._parts.part_element], self._parts.part_block)
        slack = load * mechanism.live - mechanism.cost - multipliers
        size = mechanism.size + abs(multipliers)
        noise = tolerances.ROUNDING * (float(size[allowed].sum()) + float(abs(value).sum()))
        excess = float(value.sum()) + float(np.minimum(slack[allowed], 0.0).sum()) - noise
        return excess, np.maximum(slack, 0.0)


def applies_to(analysis: LimitAnalysis) -> bool:
    """Return whether a structure has associative friction, known hulls, joints that open or crush, and no members."""
    # Members act on elements of several blocks at once.
    sets = analysis.template.yield_set
    if analysis.assembly.of_members.any() or sets.hull() is None:
        return False
    if analysis.repair.opening() is not None:
        return True
    dry = np.ones(len(analysis.assembly.interfaces), dtype=bool)
    return not (sets.recession_active(dry).any() or sets.recession_active(~dry).any())
