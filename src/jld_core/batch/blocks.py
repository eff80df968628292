"""Batch solver for the linear program of the relaxation by blocks under many choices of allowed blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bools, Floats, Ints
from jld_core.batch import interface, library
from jld_core.batch.rows import factor_pattern

SOLVED: Final = interface.codes("JldBlockState")["SOLVED"]
"""State of a choice whose multipliers are accurate enough to give a bound (`BlockAnswers.state`)."""

_Q: Final = 3  # shared rows of one node
_GAP: Final = 1e-5  # relative gap at which iterations end; the bounds are only compared with one another

_NEAR: Final = 1e-4  # relative distance of λ from its threshold below which `_FINE` replaces `_GAP`
_FINE: Final = 1e-8  # relative gap at which iterations end close to the threshold

_ROOM: Final = 1e-6  # error of the multipliers at which iterations end; the caller repairs the remaining error

_MOST: Final = 50  # largest number of iterations of one choice; 15 to 30 were measured from the common starting point


@dataclass(frozen=True)
class BlockColumns:
    """Coefficients of one block p in the linear program of the relaxation by blocks (6.5).

    Variables: share x_p, load λ x_p, a multiplier ≥ 0 per column. Rows: its own, then three of each shared node.
    """

    own: int  # number of rows that belong to this block alone
    shared: Ints  # (s,) rows that the block shares with others: 3·node + row, numbered over all nodes
    columns: tuple[tuple[Ints, Floats], ...]  # row numbers and entries of each column
    of_x: Floats  # (own + s,) coefficients of x_p in all rows of the block
    of_load: Floats  # (own + s,) coefficients of λ x_p in all rows of the block


@dataclass(frozen=True)
class BlockAnswers:
    """Results for k choices of allowed blocks."""

    own: Floats  # (k, own rows of all blocks) multipliers of the blocks' own rows
    shared: Floats  # (k, shared rows) multipliers of the shared rows
    share: Floats  # (k, p) shares of the blocks
    load: Floats  # (k,) load factor λ
    iterations: NDArray[np.int32]  # (k,) iterations
    state: NDArray[np.uint8]  # (k,) 0 open, 1 `SOLVED`, 2 below the threshold


class BatchBlockSolver:
    """Batch solver that maximises λ over the variables of the allowed blocks; ValueError without one.

    Shared rows sum to `rhs` (3·nodes,), those of `load` with −λ. places: (nodes, d).
    """

    def __init__(self, blocks: Sequence[BlockColumns], places: Floats, rhs: Floats, load: Ints) -> None:
        name = library.chosen()
        if name is None:
            raise ValueError("no kernel is built or in use")
        self._library = library.library(name)
        self.width = int(self._library.jld_width())
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
    def supports(blocks: Sequence[BlockColumns]) -> bool:
        """Return True if no block has more rows than the compiled solver can hold."""
        return max((one.own + len(one.shared) for one in blocks), default=0) <= interface.BLOCK_ROWS

    def _places(self, rows: Ints) -> Ints:
        """Return the factor positions of products of shared rows (r,); −1 − position off the diagonal blocks."""
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
        """Solve the programs of choices (k, p), least ≤ λ ≤ most (k,), until λ stays below thresholds (k,)."""
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
            pattern=self.pattern.as_ctypes(),
            loads=len(self._load),
            **library.pointers(**self._arrays, rhs=self._rhs, load=self._load),
        )
        bounds = {"thresholds": thresholds, "least_load": least, "most_load": most}
        known = {name: np.ascontiguousarray(one, dtype=float) for name, one in bounds.items()}
        task = library.BlockTask(
            count=count,
            gap=_GAP,
            near=_NEAR,
            fine_gap=_FINE,
            error=_ROOM,
            iterations=_MOST,
            **library.pointers(allowed=chosen, **known),
            **library.pointers(dual=dual, share=share, load=load, iterations_used=spent, state=state),
        )
        library.require_success(self._library.jld_solve_blocks(problem, task))
        shared = dual[:, self._own :][:, self._back]
        return BlockAnswers(dual[:, : self._own], shared, share, load, spent, state)


def _starts(counts: Sequence[int]) -> NDArray[np.int32]:
    """Return where each of several consecutive ranges starts, then where the last one ends."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)


def _flat(lists: Sequence[Ints]) -> NDArray[np.int32]:
    return np.concatenate(list(lists)).astype(np.int32)
