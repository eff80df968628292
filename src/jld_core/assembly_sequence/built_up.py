"""Search for an assembly order by laying single blocks, one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bools
from jld_core.assembly_sequence.freedom import Freedom
from jld_core.assembly_sequence.order import MOST_STAGES
from jld_core.assembly_sequence.standing import Standing
from jld_core.assembly_sequence.start import turn_of


@dataclass(frozen=True)
class Built:
    """Result of `built_up`: whether an order of single blocks with standing stages exists.

    possible: True where an order was found, False where none exists, None where the search reached its limit or a stage
    was undecided. seen: (n,) bool mask of the elements of all blocks that were laid or tried, and of the fixed block.
    """

    possible: bool | None
    seen: Bools


def built_up(freedom: Freedom, standing: Standing) -> Built:
    """Search an order of single blocks, each touching a laid one, whose every stage stands.

    The search goes depth first and tries the lowest block first. If single blocks can be removed until none is left, it
    finds an order wherever one exists. A block that touches no laid block cannot stand. The outcome therefore depends
    on the visited blocks alone.
    """
    blocks = freedom.blocks
    failed: set[bytes] = set()
    turn = turn_of(blocks)
    tried = blocks.fixed.copy()
    looked, settled = 0, True

    def search(laid: Bools) -> bool | None:
        """Return True if the laid blocks can be completed, False if not, None at the limit."""
        nonlocal looked, settled
        key = np.packbits(laid).tobytes()
        if laid.all():
            return True
        if key in failed:
            return False
        near = laid[blocks.first] != laid[blocks.second]
        border = np.unique(np.concatenate([blocks.first[near], blocks.second[near]]))
        moves = [((block,), freedom.bodies.up) for block in border[~laid[border]].tolist()]
        for move in sorted(moves, key=lambda move: turn(laid, move[0]), reverse=True):
            if looked >= MOST_STAGES:
                return None
            looked += 1
            tried[move[0][0]] = True
            more = laid.copy()
            more[move[0][0]] = True
            stands = standing.stage(more).stands
            settled &= stands is not None
            if not stands or freedom.way_out(move[0][0], more) is None:
                continue
            found = search(more)
            if found is not False:
                return found
        failed.add(key)
        return False

    possible = search(blocks.fixed.copy())
    return Built(possible if possible or settled else None, tried[blocks.of])
