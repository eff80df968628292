"""An order of laying, found by taking the structure apart: what leaves last was laid first.

Taking a block away never puts another in the way, so a structure that single blocks can be taken from until nothing
is left has an order whichever is taken first; only what must stand at every stage needs a search.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.assembly_sequence.blocks import Blocks, blocks_of_labelling
from jld_core.assembly_sequence.freedom import Bodies, Freedom
from jld_core.assembly_sequence.standing import Parts, Stage, Standing

SequenceRule = Literal["translation", "standing"]

GROUP: Final = 3
"""Blocks that are moved together at the most, where single ones fail."""

_STAGES: Final = 400
"""Stages looked at in the search for an order that stands."""


@dataclass(frozen=True)
class Step:
    """One step of laying: these blocks come along −direction, (d,) or (3,) out of the plane; then the stage is that.

    blocks: numbers, more than one where they can only be moved together. stage: after the step.
    """

    blocks: tuple[int, ...]
    direction: Floats
    stage: Stage


@dataclass(frozen=True)
class Laying:
    """How a labelling is laid, block by block.

    steps: in the order of laying; empty where there is none. locked: blocks that hold one another so that none of
    them, and no group up to the size looked for, can be moved; empty where an order was found. searched: True where
    the search was ended by its limit, so that another order may exist.
    """

    blocks: Blocks
    steps: tuple[Step, ...]
    locked: tuple[int, ...]
    searched: bool = False

    @property
    def possible(self) -> bool:
        """Whether an order was found."""
        return not self.locked and not self.searched

    @property
    def stands(self) -> bool | None:
        """Whether every stage stands without a prop; None where a stage was not settled."""
        verdicts = [step.stage.stands for step in self.steps]
        return False if False in verdicts else None if None in verdicts else True


def assembly_order(
    assembly: Assembly,
    labels: Bits,
    *,
    wish: SequenceRule = "translation",
    sideways: bool = False,
    group: int = GROUP,
    bodies: Bodies | None = None,
    parts: Parts | None = None,
) -> Laying:
    """An order in which the blocks of a labelling can be laid by translations, and how its stages stand.

    labels: (m,) True dry. wish: "standing" asks for an order in which every stage stands under its own weight without
    props; "translation" takes any, those that need least props before others. sideways: a planar wall may be laid out
    of its plane. group: blocks moved together at the most where single ones fail. bodies: what is known of the
    assembly's translations already. parts: of stages solved already.
    """
    blocks = blocks_of_labelling(assembly, labels)
    freedom, standing = Freedom(blocks, sideways, bodies), Standing(blocks, labels, parts)
    taken, there = _apart(freedom, standing, group)
    if taken is None:
        return Laying(blocks, (), _smallest_lock(freedom, there, group))
    steps = _steps(blocks, standing, taken)
    if wish == "translation" or all(step.stage.stands for step in steps):
        return Laying(blocks, steps, ())
    found = _standing_order(freedom, standing, group)
    if found is None:
        return Laying(blocks, steps, (), searched=True)
    return Laying(blocks, _steps(blocks, standing, found), ())


def locked_blocks(
    assembly: Assembly,
    labels: Bits,
    *,
    sideways: bool = False,
    group: int = GROUP,
    bodies: Bodies | None = None,
) -> tuple[int, ...]:
    """Elements of the blocks that lock one another, ascending; empty where the labelling can be laid by translations.

    They lock one another wherever these very blocks are, whatever stands beside them. bodies: what is known of the
    assembly's translations already.
    """
    blocks = blocks_of_labelling(assembly, labels)
    freedom = Freedom(blocks, sideways, bodies)
    there = emptied(freedom, np.ones(len(blocks), dtype=bool), group)
    if not np.any(there & ~blocks.fixed):
        return ()
    lock = _smallest_lock(freedom, there, group)
    return tuple(int(e) for e in np.flatnonzero(np.isin(blocks.of, lock)))


Move = tuple[tuple[int, ...], Floats]


def _moves(freedom: Freedom, there: Bools, group: int) -> list[Move]:
    """What can be taken away now: single blocks; where there is none, the smallest group."""
    blocks = freedom.blocks
    found: list[Move] = []
    for block in np.flatnonzero(there & ~blocks.fixed).tolist():
        direction = freedom.way_out(block, there)
        if direction is not None:
            found.append(((block,), direction))
    if not found and group > 1:
        together = freedom.group_out(there, group)
        if together is not None:
            found.append((tuple(together[0].tolist()), together[1]))
    return found


def _without(there: Bools, move: Move) -> Bools:
    left = there.copy()
    left[list(move[0])] = False
    return left


def _apart(freedom: Freedom, standing: Standing, group: int) -> tuple[list[Move] | None, Bools]:
    """Moves that take everything apart, those that leave most standing first; None, and what is left, where stuck."""
    blocks = freedom.blocks
    there = np.ones(len(blocks), dtype=bool)
    taken: list[Move] = []
    while np.any(there & ~blocks.fixed):
        moves = _moves(freedom, there, group)
        if not moves:
            return None, there
        moves.sort(key=lambda move: _turn(blocks, there, move))
        choice = next((m for m in moves[:6] if standing.stage(_without(there, m)).stands), None)
        if choice is None:
            choice = min(moves[:6], key=lambda m: float(standing.stage(_without(there, m)).props.sum()))
        taken.append(choice)
        there = _without(there, choice)
    return taken, there


def emptied(freedom: Freedom, there: Bools, group: int) -> Bools:
    """What is left when everything that can be taken away is."""
    blocks = freedom.blocks
    there = there.copy()
    while np.any(there & ~blocks.fixed):
        progress = False
        for block in np.flatnonzero(there & ~blocks.fixed).tolist():
            if freedom.way_out(block, there) is not None:
                there[block] = False
                progress = True
        if not progress:
            together = freedom.group_out(there, group) if group > 1 else None
            if together is None:
                return there
            there[together[0]] = False
    return there


def _smallest_lock(freedom: Freedom, there: Bools, group: int) -> tuple[int, ...]:
    """Blocks that lock one another, none of which can be missed."""
    there = emptied(freedom, there, group)
    blocks = freedom.blocks
    for block in np.flatnonzero(there & ~blocks.fixed).tolist():
        if not there[block]:
            continue
        tried = there.copy()
        tried[block] = False
        left = emptied(freedom, tried, group)
        if np.any(left & ~blocks.fixed):
            there = left
    return tuple(np.flatnonzero(there & ~blocks.fixed).tolist())


def _standing_order(freedom: Freedom, standing: Standing, group: int) -> list[Move] | None:
    """Moves whose every stage stands, depth first with what failed remembered; None where none was found."""
    blocks = freedom.blocks
    failed: set[bytes] = set()
    looked = 0

    def search(there: Bools, taken: list[Move]) -> list[Move] | None:
        nonlocal looked
        if not np.any(there & ~blocks.fixed):
            return taken
        key = np.packbits(there).tobytes()
        if key in failed or looked >= _STAGES:
            return None
        for move in sorted(_moves(freedom, there, group), key=lambda m: _turn(blocks, there, m)):
            looked += 1
            left = _without(there, move)
            if standing.stage(left).stands:
                found = search(left, [*taken, move])
                if found is not None:
                    return found
        failed.add(key)
        return None

    return search(np.ones(len(blocks), dtype=bool), [])


@dataclass(frozen=True)
class Built:
    """What came of building a labelling up block by block, every stage standing.

    possible: None where the search was ended by its limit, or a stage was not settled. seen: (n,) elements of all
    blocks that were laid or tried.
    """

    possible: bool | None
    seen: Bools


def built_up(freedom: Freedom, standing: Standing) -> Built:
    """Lay single blocks, each where it touches what is laid and the stage stands, depth first, the lowest first.

    It finds an order wherever there is one, if single blocks can be taken away until nothing is left. Whether it
    does follows from the blocks that were seen alone: a block that touches nothing that is laid cannot stand.
    """
    blocks = freedom.blocks
    failed: set[bytes] = set()
    tried = blocks.fixed.copy()
    looked, settled = 0, True

    def search(laid: Bools) -> bool | None:
        nonlocal looked, settled
        key = np.packbits(laid).tobytes()
        if laid.all():
            return True
        if key in failed:
            return False
        near = laid[blocks.first] != laid[blocks.second]
        border = np.unique(np.concatenate([blocks.first[near], blocks.second[near]]))
        moves = [((block,), freedom.bodies.up) for block in border[~laid[border]].tolist()]
        for move in sorted(moves, key=lambda move: _turn(blocks, laid, move), reverse=True):
            if looked >= _STAGES:
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


def _turn(blocks: Blocks, there: Bools, move: Move) -> tuple[float, int]:
    """What is taken away first: what lies highest, and of that what touches least: gaps grow from their edges."""
    touching = sum(int(np.count_nonzero(there[blocks.contacts_of(block)[0]])) for block in move[0])
    return -round(_height(blocks, move) / blocks.assembly.size, 6), touching


def _height(blocks: Blocks, move: Move) -> float:
    """How high against the weight the centre of what is moved lies."""
    elements = blocks.assembly.elements
    total = elements.weight[elements.free].sum(axis=0)
    if not np.any(total):
        total = -np.eye(blocks.assembly.dimension)[-1]
    chosen = np.isin(blocks.of, move[0])
    up = -total / np.linalg.norm(total)
    return float(np.average(elements.centroid[chosen], axis=0, weights=elements.volume[chosen]) @ up)


def _steps(blocks: Blocks, standing: Standing, taken: list[Move]) -> tuple[Step, ...]:
    laid = blocks.fixed.copy()
    steps = []
    for move in reversed(taken):
        laid = laid.copy()
        laid[list(move[0])] = True
        steps.append(Step(move[0], move[1], standing.stage(laid)))
    return tuple(steps)
