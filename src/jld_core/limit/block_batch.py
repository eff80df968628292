"""Block relaxation of planar faces without crushing, solved by the batch solver.

The programs of many sets of allowed blocks are solved at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.batch import chosen
from jld_core.batch.blocks import SOLVED, BatchBlockSolver, BlockAnswers, BlockColumns
from jld_core.limit.block_columns import columns_of
from jld_core.limit.block_parts import BlockParts, Q
from jld_core.limit.block_program import LEAST
from jld_core.mechanics.yield_set import CoulombWedge


@dataclass(frozen=True)
class BlockMultipliers:
    """Velocities, multipliers and shares that a solver returned for one set of allowed blocks.

    The counts k (parts), f (shared faces), n (elements) and p (blocks) are those of `BlockParts`; all values are
    scaled.

    velocity: (k, q) velocities of the parts. wall: (f, q) velocities of the shared faces. price, portion: (n,)
    multipliers of each element: v of its cover row, docs/method.md (6.6), and σ of its row for the share of λ. share:
    (p,) share x of every block. solved: True if the values are final; if False, a further solve may give a better
    bound.
    """

    velocity: Floats
    wall: Floats
    price: Floats
    portion: Floats
    share: Floats
    solved: bool = True


@dataclass(frozen=True)
class BlockMechanism:
    """Velocities and multipliers of one block relaxation, which prove its bound.

    case: index of the load case. multipliers: values that the solver returned; `BlockRelaxation.evaluate` repairs them
    before use.
    """

    case: int
    multipliers: BlockMultipliers


class BatchBlockProgram:
    """Program of the block relaxation, in the batch solver, for any set of allowed blocks.

    It is safe for concurrent use by several threads.

    parts: parts, sides and joints of the possible blocks. blocks: columns of each block. places: (f + n, d) positions
    of the shared faces, then of the elements.
    """

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
        """Create the block program of an assembly; None if the batch solver does not support it.

        The result is also None without the compiled library. parts: parts, sides and joints of the possible blocks.
        dry, inner: yield sets of all faces under either label. centroids: (n, d) of the free elements.
        """
        if chosen() is None:
            return None
        blocks = columns_of(parts, dry, inner)
        if blocks is None or not BatchBlockSolver.supports(blocks):
            return None
        known = parts.side_shared >= 0
        middle, sides = np.zeros((parts.shared, centroids.shape[1])), np.zeros(parts.shared)
        np.add.at(middle, parts.side_shared[known], centroids[parts.part_element[parts.side_part[known]]])
        np.add.at(sides, parts.side_shared[known], 1.0)
        return cls(parts, blocks, np.vstack([middle / np.maximum(sides, 1.0)[:, None], centroids]))

    def solve(
        self, allowed: Bools, thresholds: Floats, most: Floats, pool: ThreadPoolExecutor | None = None
    ) -> list[BlockMultipliers]:
        """Solve the programs of k sets of allowed blocks.

        allowed: (k, p) blocks that may be chosen. thresholds, most: (k,) scaled λ to reach, and scaled λ that is not
        exceeded, see `AllBlocksProgram.of`. pool: supplies one more thread, which takes half of the full registers. A
        single register is not split, because a partly filled register takes as long as a full one.
        """
        width = self._batch.width
        registers = -(-len(allowed) // width)
        here = width * (registers if pool is None else -(-registers // 2))
        portions = [part for part in (np.arange(here)[: len(allowed)], np.arange(here, len(allowed))) if len(part)]

        def run(k: Ints) -> BlockAnswers:
            return self._batch.solve(allowed[k], thresholds[k], LEAST * thresholds[k], most[k])

        others = [] if pool is None else [pool.submit(run, k) for k in portions[1:]]
        found = [run(portions[0]), *(other.result() for other in others)]
        return [self._multipliers(answers, k) for answers in found for k in range(len(answers.state))]

    def _multipliers(self, answers: BlockAnswers, k: int) -> BlockMultipliers:
        """Return velocities, multipliers and shares of one set of allowed blocks.

        answers: results of the batch solver for several sets. k: index of the set among them.
        """
        shared = answers.shared[k]
        return BlockMultipliers(
            velocity=-answers.own[k][self._balance],
            wall=-shared[: Q * self._shared].reshape(-1, Q),
            price=-shared[self._elements],
            portion=shared[self._elements + 1],
            share=answers.share[k],
            solved=answers.state[k] == SOLVED,
        )


def _balance(parts: BlockParts, blocks: Sequence[BlockColumns]) -> Ints:
    """Return the indices (k, q) of the equilibrium rows of all parts.

    They count the rows of all blocks, block after block. The equilibrium rows of a block are its first rows.
    """
    begin = np.concatenate([[0], np.cumsum([one.own for one in blocks])])
    first = np.searchsorted(parts.part_block, parts.part_block)
    place = begin[parts.part_block] + Q * (np.arange(len(first)) - first)
    return np.asarray(place[:, None] + np.arange(Q))
