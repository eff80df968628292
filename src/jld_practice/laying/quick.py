"""Find an order of laying by translations alone, in seconds, where solved stages would take minutes."""

from __future__ import annotations

import numpy as np

from jld_core import Assembly, Bits, checkpoint
from jld_practice.laying.freedom import Bodies, Freedom, blocks_of_labelling
from jld_practice.laying.order import GROUP, Laying, LayingStart, Move, Step, turn_of
from jld_practice.laying.standing import Stage


def order_without_stages(
    assembly: Assembly,
    labels: Bits,
    *,
    sideways: bool = False,
    group: int = GROUP,
    start: LayingStart = "ground",
    bodies: Bodies | None = None,
) -> Laying | None:
    """Find an order whose stages are not solved, or None where blocks lock one another."""
    # arguments as of `assembly_order`; stages have no props and an infinite error
    # Of the blocks that can be removed, the first in the order of `start` is removed next.
    assembly.members.refuse("an assembly sequence")
    blocks = blocks_of_labelling(assembly, labels)
    freedom, turn = Freedom(blocks, sideways, bodies), turn_of(blocks, start)
    there = np.ones(len(blocks), dtype=bool)
    unsolved = Stage(np.zeros(len(blocks)), np.inf, 0.0)
    taken: list[Move] = []
    # sorted once: the contacts that remain, the last part of the key, count among equals alone
    left = sorted(np.flatnonzero(~blocks.fixed).tolist(), key=lambda block: turn(there, (block,)))
    while left:
        checkpoint()
        move: Move | None = None
        for block in left:
            direction = freedom.way_out(block, there)
            if direction is not None:
                move = ((block,), direction)
                break
        if move is None and group > 1 and (together := freedom.group_out(there, group)) is not None:
            move = (tuple(together[0].tolist()), together[1])
        if move is None:
            return None
        taken.append(move)
        there[list(move[0])] = False
        left = [block for block in left if there[block]]
    return Laying(blocks, tuple(Step(*move, unsolved) for move in reversed(taken)), ())
