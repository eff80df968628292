"""The relaxation by blocks of planar wedges in the batch solver: mechanisms for many choices of allowed blocks at
once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.batch import SOLVED, BlockAnswers, BlockColumns, BlockLanes, chosen
from jld_core.limit.block_columns import columns_of
from jld_core.limit.block_parts import BlockParts, Q
from jld_core.limit.block_program import LEAST
from jld_core.mechanics import CoulombWedge


@dataclass(frozen=True)
class Multipliers:
    """What a solver says of one choice. velocity: (k, q) of parts. wall: (f, q) of shared faces. price, portion: (n,)
    of elements. share: (p,) x of every block. solved: whether a bound can be
    expected of it, as good as it gets; else it may be that it is below the threshold."""

    velocity: Floats
    wall: Floats
    price: Floats
    portion: Floats
    share: Floats
    solved: bool = True


class BatchBlockProgram:
    """The program of all possible blocks in the batch solver, for any number of threads at once."""

    def __init__(self, parts: BlockParts, blocks: Sequence[BlockColumns], places: Floats) -> None:
        self._elements = Q * (parts.shared + np.arange(parts.elements))
        rhs = np.zeros(Q * len(places))
        rhs[self._elements] = 1.0
        self._shared = parts.shared
        self._batch = BlockLanes(blocks, places, rhs, self._elements + 1)
        self._balance = _balance(parts, blocks)

    @classmethod
    def of(
        cls, parts: BlockParts, dry: CoulombWedge, inner: CoulombWedge, centroids: Floats
    ) -> BatchBlockProgram | None:
        """centroids: (n, d) of the elements. None where there is no batch solver, or the program has another shape."""
        if chosen() is None:
            return None
        blocks = columns_of(parts, dry, inner)
        if blocks is None or not BlockLanes.takes(blocks):
            return None
        known = parts.side_shared >= 0
        middle, sides = np.zeros((parts.shared, centroids.shape[1])), np.zeros(parts.shared)
        np.add.at(middle, parts.side_shared[known], centroids[parts.part_element[parts.side_part[known]]])
        np.add.at(sides, parts.side_shared[known], 1.0)
        return cls(parts, blocks, np.vstack([middle / np.maximum(sides, 1.0)[:, None], centroids]))

    def solve(
        self, allowed: Bools, thresholds: Floats, most: Floats, pool: ThreadPoolExecutor | None = None
    ) -> list[Multipliers]:
        """Of choices (k, p) of allowed blocks. thresholds, most: (k,) scaled λ, see `WholeProgram.of`. pool: one more
        thread, which takes half of what is more than a register has lanes: fewer would take it as long as all."""
        width = self._batch.width
        registers = -(-len(allowed) // width)
        here = width * (registers if pool is None else -(-registers // 2))
        portions = [part for part in (np.arange(here)[: len(allowed)], np.arange(here, len(allowed))) if len(part)]

        def run(k: Ints) -> BlockAnswers:
            return self._batch.solve(allowed[k], thresholds[k], LEAST * thresholds[k], most[k])

        others = [] if pool is None else [pool.submit(run, k) for k in portions[1:]]
        found = [run(portions[0]), *(other.result() for other in others)]
        return [self._multipliers(answers, k) for answers in found for k in range(len(answers.state))]

    def _multipliers(self, answers: BlockAnswers, k: int) -> Multipliers:
        shared = answers.shared[k]
        return Multipliers(
            velocity=-answers.own[k][self._balance],
            wall=-shared[: Q * self._shared].reshape(-1, Q),
            price=-shared[self._elements],
            portion=shared[self._elements + 1],
            share=answers.share[k],
            solved=answers.state[k] == SOLVED,
        )


def _balance(parts: BlockParts, blocks: Sequence[BlockColumns]) -> Ints:
    """(k, q) own rows, of all blocks, in which parts are in equilibrium: the first ones of their block."""
    begin = np.concatenate([[0], np.cumsum([one.own for one in blocks])])
    first = np.searchsorted(parts.part_block, parts.part_block)
    place = begin[parts.part_block] + Q * (np.arange(len(first)) - first)
    return np.asarray(place[:, None] + np.arange(Q))
