"""The linear program of the relaxation by blocks under many choices of allowed blocks, in the lanes of a register.

The batch solver takes columns as they are and knows nothing of mechanics: of each block its own rows, which are
eliminated
block by block, and those that it shares with others, three to a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bools, Floats, Ints
from jld_core.batch import library
from jld_core.batch.pattern import factor_pattern

SOLVED: Final = 1
"""State of a choice of which a bound can be expected."""

_Q: Final = 3
_ROWS: Final = 96
"""Rows of one block at the most: `MOST` of source/blocks.h."""

_GAP: Final = 1e-5
"""Relative gap that is asked for: bounds that are compared with one another."""

_NEAR: Final = 1e-4
_FINE: Final = 1e-8
"""Gap that is asked for where the answer is nearer than that to the threshold, relative."""

_ROOM: Final = 1e-6
"""Error of the multipliers that is left for others to repair."""

_MOST: Final = 50
"""Iterations of one; from the same start it takes 15 to 30."""


@dataclass(frozen=True)
class BlockColumns:
    """Columns of one block. shared: (s,) rows that it shares. row, entry: of each column, rows of the block: its own
    `own` ones, then the shared ones. of_x, of_load: (own + s,) entries of its share, and of its λ times its share."""

    own: int
    shared: Ints
    columns: tuple[tuple[Ints, Floats], ...]
    of_x: Floats
    of_load: Floats


@dataclass(frozen=True)
class BlockAnswers:
    """Of k choices: own (k, own rows of all blocks), shared (k, shared rows): multipliers of the rows; share (k, p);
    load (k,) λ; iterations (k,); state (k,) 0 open, 1 solved, 2 below the threshold."""

    own: Floats
    shared: Floats
    share: Floats
    load: Floats
    iterations: NDArray[np.int32]
    state: NDArray[np.uint8]


class BlockLanes:
    """min −λ over choices of blocks, by the batch solver, `width` at a time. places: (nodes, d), three shared rows
    each. rhs:
    (3 nodes,). load: shared rows that λ enters, with −1.

    Raises ValueError where there is no batch solver.
    """

    def __init__(self, blocks: Sequence[BlockColumns], places: Floats, rhs: Floats, load: Ints) -> None:
        name = library.chosen()
        if name is None:
            raise ValueError("no kernel is built or in use")
        self._library = library.library(name)
        self.width = int(self._library.jld_lanes_width())
        self._blocks = len(blocks)
        nodes = len(places)
        pairs = {pair for one in blocks for pair in combinations(np.unique(one.shared // _Q).tolist(), 2)}
        a, b = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2).T
        self.pattern = pattern = factor_pattern(a, b, places)
        place = np.empty(nodes, dtype=np.int64)
        place[pattern.order] = np.arange(nodes)
        self._back = (_Q * place[:, None] + np.arange(_Q)).ravel()
        entries = [column for one in blocks for column in one.columns]
        self._arrays: dict[str, Any] = {
            "own_start": _starts([one.own for one in blocks]),
            "shared_start": _starts([len(one.shared) for one in blocks]),
            "shared": _flat([self._back[one.shared] for one in blocks]),
            "column_start": _starts([len(one.columns) for one in blocks]),
            "entry_start": _starts([len(rows) for rows, _ in entries]),
            "entry_row": _flat([rows for rows, _ in entries]),
            "entry": np.concatenate([values for _, values in entries]),
            "of_x": np.concatenate([one.of_x for one in blocks]),
            "of_load": np.concatenate([one.of_load for one in blocks]),
        }
        put = [self._places(self._back[one.shared]) for one in blocks]
        self._arrays |= {"place_start": _starts([len(one) for one in put]), "place": _flat(put)}
        right = np.zeros(_Q * nodes)
        right[self._back] = rhs
        self._rhs, self._load = right, self._back[load].astype(np.int32)
        self._own, self._shared = int(self._arrays["own_start"][-1]), _Q * nodes

    @staticmethod
    def takes(blocks: Sequence[BlockColumns]) -> bool:
        """Whether no block has more rows than the batch solver takes."""
        return max((one.own + len(one.shared) for one in blocks), default=0) <= _ROWS

    def _places(self, rows: Ints) -> Ints:
        """Where the pairs of some rows stand in the matrix, lower triangle."""
        starts, below = self.pattern.column_start, self.pattern.row
        found = []
        for k, one in enumerate(rows.tolist()):
            for other in rows[: k + 1].tolist():
                (high, r), (low, c) = divmod(max(one, other), _Q), divmod(min(one, other), _Q)
                if high == low:
                    found.append(6 * high + r * (r + 1) // 2 + c)
                else:
                    block = starts[low] + np.searchsorted(below[starts[low] : starts[low + 1]], high)
                    found.append(-1 - (9 * int(block) + 3 * r + c))
        return np.array(found, dtype=np.int64)

    def solve(self, allowed: Bools, thresholds: Floats, least: Floats, most: Floats) -> BlockAnswers:
        """Choices (k, p) of allowed blocks. thresholds: (k,) λ, an answer below which need say no more. least, most:
        (k,) range of the λ of every block."""
        count = len(allowed)
        chosen = np.ascontiguousarray(allowed, dtype=np.uint8)
        dual, share, load = (
            np.zeros((count, self._own + self._shared)),
            np.zeros((count, self._blocks)),
            np.zeros(count),
        )
        spent, state = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.uint8)
        problem = library.Blocks(
            blocks=self._blocks,
            nodes=len(self.pattern.order),
            pattern=self.pattern.handed_over(),
            loads=len(self._load),
            **library.pointers(**self._arrays, rhs=self._rhs, load=self._load),
        )
        bounds = {"thresholds": thresholds, "least": least, "most": most}
        known = {name: np.ascontiguousarray(one, dtype=float) for name, one in bounds.items()}
        task = library.BlockTask(
            count=count,
            gap=_GAP,
            near=_NEAR,
            fine=_FINE,
            room=_ROOM,
            iterations=_MOST,
            **library.pointers(allowed=chosen, **known),
            **library.pointers(dual=dual, share=share, load=load, spent=spent, state=state),
        )
        failed = self._library.jld_lanes_blocks(problem, task)
        if failed:
            raise MemoryError("the kernel's workspace") if failed == 1 else ValueError("a block of too many rows")
        shared = dual[:, self._own :][:, self._back]
        return BlockAnswers(dual[:, : self._own], shared, share, load, spent, state)


def _starts(counts: Sequence[int]) -> NDArray[np.int32]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)


def _flat(lists: Sequence[Ints]) -> NDArray[np.int32]:
    return np.concatenate(list(lists)).astype(np.int32)
