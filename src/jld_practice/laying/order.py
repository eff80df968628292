"""Search for an order of laying by disassembly: the block removed last is laid first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from jld_core import Assembly, Bits, Bools, Floats, ParameterError, checkpoint, parameters
from jld_core import assembly as structures
from jld_core.scene import units
from jld_practice.laying.freedom import Blocks, Bodies, Freedom, blocks_of_labelling
from jld_practice.laying.standing import Parts, Stage, Standing

# where laying starts: at the ground, from a side, or from all supports alike
LayingStart = Literal["ground", "left", "right", "springings"]

# wishes for laying: the limit `search.assemble` of each, and where laying starts
LAID: Final[dict[str, tuple[str, LayingStart]]] = {
    "translation": ("translation", "ground"),
    "standing": ("standing", "ground"),
    "left-to-right": ("translation", "left"),
    "right-to-left": ("translation", "right"),
    "springings": ("translation", "springings"),
}

_EQUAL: Final = 6  # decimals, relative to the size of the structure, to which two places are the same

# sort key of a removal, by the blocks present and those removed; the least is removed first
Turn = Callable[[Bools, Sequence[int]], tuple[float, ...]]


def turn_of(blocks: Blocks, start: LayingStart = "ground") -> Turn:
    """Return the sort key by which removals are tried, so that laying begins at `start`."""
    # ground: highest first, then fewest contacts, so that gaps grow from their edges. left, right:
    # farthest from that side first. springings: farthest from the supports first, in blocks between them.
    if start not in get_args(LayingStart):
        raise ParameterError("start", f"{start!r} is no start of laying", "one of " + ", ".join(get_args(LayingStart)))
    elements, up = blocks.assembly.elements, upwards(blocks)
    if start == "springings":
        far: Floats | None = _steps_from_supports(blocks)
    elif start == "ground":
        far = None
    else:
        far = elements.centroid @ _to_the_right(blocks, up) * (1.0 if start == "left" else -1.0)

    def key(there: Bools, removed: Sequence[int]) -> tuple[float, ...]:
        """Return the sort key of a removal: distance from the start, height, contacts."""
        touching = sum(int(np.count_nonzero(there[blocks.contacts_of(block)[0]])) for block in removed)
        chosen = np.isin(blocks.of, removed)
        weights = elements.volume[chosen]
        height = float(np.average(elements.centroid[chosen], axis=0, weights=weights) @ up)
        distance = () if far is None else (-round(float(np.average(far[chosen], weights=weights)) / scale, _EQUAL),)
        return (*distance, -round(height / blocks.assembly.size, _EQUAL), float(touching))

    scale = 1.0 if start == "springings" else blocks.assembly.size
    return key


def upwards(blocks: Blocks) -> Floats:
    """Return the unit vector (d,) against the weight of all blocks."""
    elements = blocks.assembly.elements
    total = elements.weight[elements.free].sum(axis=0)
    if not np.any(total):
        total = -np.eye(blocks.assembly.dimension)[-1]
    return np.asarray(-total / np.linalg.norm(total))


def _to_the_right(blocks: Blocks, up: Floats) -> Floats:
    """Return the horizontal unit direction (d,) to the right, in space along the longer side."""
    if blocks.assembly.dimension == 2:
        return np.array([up[1], -up[0]])
    elements = blocks.assembly.elements
    extent = elements.upper.max(axis=0) - elements.lower.min(axis=0)
    axis = max((k for k in range(3) if abs(up[k]) < 0.5), key=lambda k: extent[k])
    return np.asarray(np.eye(3)[axis])


def _steps_from_supports(blocks: Blocks) -> Floats:
    """Return for each element (n,) the least number of contacts to a support; without any, of blocks."""
    steps = np.where(blocks.fixed, 0.0, np.inf)
    while True:
        across = np.concatenate([steps[blocks.first], steps[blocks.second]])
        reached = steps.copy()
        np.minimum.at(reached, np.concatenate([blocks.second, blocks.first]), across + 1.0)
        if np.array_equal(reached, steps):
            return np.asarray(np.where(np.isfinite(steps), steps, len(steps))[blocks.of])
        steps = reached


# an order by translations alone, or one whose stages also stand without props
SequenceRule = Literal["translation", "standing"]

GROUP: Final = 3  # largest number of blocks that are moved together where single blocks are locked

MOST_STAGES: Final = 400  # largest number of stages examined in the search for an order whose stages stand

_TRIED: Final = 6  # number of removals, the first in order, of which one is chosen

_SAME: Final = 1e-6  # difference of prop forces, relative to the weight, below which two stages need the same


@dataclass(frozen=True)
class Step:
    """Blocks laid together, and the direction, (d,) or (3,) out of the plane, in which they could be removed."""

    blocks: tuple[int, ...]
    direction: Floats
    stage: Stage


@dataclass(frozen=True)
class Laying:
    """Order of laying of a labelling, or the blocks that make one impossible.

    Attributes
    ----------
    blocks : Blocks
        Blocks of the labelling.
    steps : tuple of Step
        In the order of laying; empty where there is none.
    locked : tuple of int
        Blocks that lock one another, empty where an order exists.
    searched : bool
        True where no order with standing stages was found; `steps` are then an order by translations.
    undecided : bool
        True where one may exist, because the search stopped at its limit or at an undecided stage.
    """

    blocks: Blocks
    steps: tuple[Step, ...]
    locked: tuple[int, ...]
    searched: bool = False
    undecided: bool = False

    @property
    def possible(self) -> bool:
        """True if an order by the rule asked for was found."""
        return not self.locked and not self.searched

    @property
    def stands(self) -> bool | None:
        """Whether every stage stands without props; None if one is undecided."""
        verdicts = [step.stage.stands for step in self.steps]
        return False if False in verdicts else None if None in verdicts else True

    @property
    def first_fall(self) -> tuple[int, Step] | None:
        """Number, from 1, and step of the first stage proven to fall without props; None if none is."""
        return next(((k, step) for k, step in enumerate(self.steps, 1) if step.stage.stands is False), None)


def words_of_fall(laying: Laying, number: int, step: Step) -> str:
    """Describe a stage that falls without props: what is laid, and the props that it needs."""
    blocks = laying.blocks
    laid = " + ".join(blocks.name(block) for block in step.blocks)
    propped = " and ".join(blocks.name(block) for block in np.flatnonzero(step.stage.props > 0.0).tolist())
    need = f"props of {units.force_in_words(step.stage.props.sum(), blocks.assembly.units[1])} below {propped}"
    return f"step {number} of {len(laying.steps)}, when {laid} is laid: it needs {need}"


@parameters.typed
def assembly_order(
    assembly: Assembly,
    labels: Bits,
    *,
    wish: SequenceRule = "translation",
    sideways: bool = False,
    group: int = GROUP,
    start: LayingStart = "ground",
    bodies: Bodies | None = None,
    parts: Parts | None = None,
) -> Laying:
    """Find an order in which the blocks of a labelling can be laid by translations.

    Parameters
    ----------
    assembly : Assembly
        The structure.
    labels : (m,) bool array
        True = dry.
    wish : {"translation", "standing"}
        "standing": every stage stands without props. "translation": any order, with little prop force where possible.
    sideways : bool
        Allow a planar wall to be assembled out of its plane.
    group : int
        Largest number of blocks that are moved together where single blocks are locked.
    start : {"ground", "left", "right", "springings"}
        Where laying starts, if directions and stages allow it.
    bodies : Bodies, optional
        Bodies.
    parts : Parts, optional
        Data of the assembly, for reuse.

    Returns
    -------
    Laying

    Raises
    ------
    InputError
        For another start.
    """
    # removing a block never obstructs another: any choice of single blocks succeeds, only stages need a search
    assembly.members.refuse("an assembly sequence")
    labels = structures.labels_of(assembly, labels)
    blocks = blocks_of_labelling(assembly, labels)
    freedom, standing = Freedom(blocks, sideways, bodies), Standing(blocks, labels, parts)
    turn = turn_of(blocks, start)
    moves, there = _disassembly(freedom, standing, group, turn, by_courses=start == "ground")
    if moves is None:
        return Laying(blocks, (), _smallest_lock(freedom, there, group))
    steps = _steps(blocks, standing, moves)
    if wish == "translation" or all(step.stage.stands for step in steps):
        return Laying(blocks, steps, ())
    standing_moves, settled = _standing_order(freedom, standing, group, turn)
    if standing_moves is None:
        return Laying(blocks, steps, (), searched=True, undecided=not settled)
    return Laying(blocks, _steps(blocks, standing, standing_moves), ())


def locked_blocks(
    assembly: Assembly, labels: Bits, *, group: int = GROUP, bodies: Bodies | None = None
) -> tuple[int, ...]:
    """Return the elements of blocks that prevent any order by translations, ascending."""
    # The blocks found lock one another in every labelling that has them.
    assembly.members.refuse("an assembly sequence")
    blocks = blocks_of_labelling(assembly, labels)
    freedom = Freedom(blocks, sideways=False, bodies=bodies)
    there = emptied(freedom, np.ones(len(blocks), dtype=bool), group)
    if not np.any(there & ~blocks.fixed):
        return ()
    lock = _smallest_lock(freedom, there, group)
    return tuple(int(e) for e in np.flatnonzero(np.isin(blocks.of, lock)))


Move = tuple[tuple[int, ...], Floats]  # step of disassembly: blocks, and the direction in which they are removed


def _moves(freedom: Freedom, there: Bools, group: int) -> list[Move]:
    """List the blocks of `there` (k,) that can be removed now, with directions; else the smallest group."""
    blocks = freedom.blocks
    moves: list[Move] = []
    for block in np.flatnonzero(there & ~blocks.fixed).tolist():
        direction = freedom.way_out(block, there)
        if direction is not None:
            moves.append(((block,), direction))
    if not moves and group > 1:
        together = freedom.group_out(there, group)
        if together is not None:
            moves.append((tuple(together[0].tolist()), together[1]))
    return moves


def _without(there: Bools, move: Move) -> Bools:
    remaining = there.copy()
    remaining[list(move[0])] = False
    return remaining


def _course(blocks: Blocks, moves: list[Move]) -> list[Move]:
    """Return the first moves, sorted from above, that belong to the course of the highest one."""
    # A wall that grows from the ground needs its props when a course needs them: to put off a removal that needs one
    # would leave a tower of it, which needs the same prop at the end.
    elements, up = blocks.assembly.elements, upwards(blocks)
    reach = (np.maximum(elements.lower @ up, elements.upper @ up), np.minimum(elements.lower @ up, elements.upper @ up))

    def middle_and_half(move: Move) -> tuple[float, float]:
        chosen = np.isin(blocks.of, move[0])
        top, bottom = float(reach[0][chosen].max()), float(reach[1][chosen].min())
        return 0.5 * (top + bottom), 0.5 * (top - bottom)

    highest, half = middle_and_half(moves[0])
    return [move for move in moves[:_TRIED] if middle_and_half(move)[0] >= highest - half]


def _disassembly(
    freedom: Freedom, standing: Standing, group: int, turn: Turn, *, by_courses: bool
) -> tuple[list[Move] | None, Bools]:
    """Take a structure apart; return the moves in order, and the blocks (k,) that remain."""
    # The moves are None if the remaining blocks lock one another. At each step the first few moves in the order of
    # `turn` are tried. The first whose remaining stage stands is taken, else the one that needs the least prop force.
    blocks = freedom.blocks
    there = np.ones(len(blocks), dtype=bool)
    removed: list[Move] = []
    while np.any(there & ~blocks.fixed):
        moves = _moves(freedom, there, group)
        if not moves:
            return None, there
        moves.sort(key=lambda move: turn(there, move[0]))
        first = _course(blocks, moves) if by_courses else moves[:_TRIED]
        choice = next((m for m in first if standing.stage(_without(there, m)).stands), None)
        if choice is None:
            stages = [standing.stage(_without(there, m)) for m in first]
            least = min(float(stage.props.sum()) for stage in stages)
            # of removals that need the same props up to rounding the first in order is taken
            pairs = zip(first, stages, strict=True)
            choice = next(m for m, stage in pairs if float(stage.props.sum()) <= least + _SAME * stage.weight)
        removed.append(choice)
        there = _without(there, choice)
    return removed, there


def emptied(freedom: Freedom, there: Bools, group: int) -> Bools:
    """Return the blocks of `there` (k,) that remain when all that can leave are removed."""
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
    """Return an irreducible set of blocks that lock one another, moved by up to `group` at a time."""
    locked = emptied(freedom, there, group)
    movable = ~freedom.blocks.fixed
    for block in np.flatnonzero(locked & movable).tolist():
        if not locked[block]:
            continue
        # a block is needed only if nothing stays locked without it
        without = locked.copy()
        without[block] = False
        remaining = emptied(freedom, without, group)
        if np.any(remaining & movable):
            locked = remaining
    return tuple(np.flatnonzero(locked & movable).tolist())


def _standing_order(freedom: Freedom, standing: Standing, group: int, turn: Turn) -> tuple[list[Move] | None, bool]:
    """Search moves of disassembly whose every stage stands, depth first."""
    blocks = freedom.blocks
    failed: set[bytes] = set()
    looked, settled = 0, True

    def search(there: Bools, removed: list[Move]) -> list[Move] | None:
        """Return moves that take the remaining blocks away with standing stages, or None."""
        nonlocal looked, settled
        if not np.any(there & ~blocks.fixed):
            return removed
        key = np.packbits(there).tobytes()
        if key in failed:
            return None
        if looked >= MOST_STAGES:
            settled = False
            return None
        for move in sorted(_moves(freedom, there, group), key=lambda m: turn(there, m[0])):
            looked += 1
            remaining = _without(there, move)
            stands = standing.stage(remaining).stands
            settled &= stands is not None
            if stands:
                moves = search(remaining, [*removed, move])
                if moves is not None:
                    return moves
        failed.add(key)
        return None

    return search(np.ones(len(blocks), dtype=bool), []), settled


def _steps(blocks: Blocks, standing: Standing, moves: list[Move]) -> tuple[Step, ...]:
    """Reverse moves of disassembly to steps of laying, each with the stage after it."""
    laid = blocks.fixed.copy()
    steps = []
    for move in reversed(moves):
        laid = laid.copy()
        laid[list(move[0])] = True
        steps.append(Step(move[0], move[1], standing.stage(laid)))
    return tuple(steps)


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
    moves: list[Move] = []
    # sorted once: the contacts that remain, the last part of the key, count among equals alone
    waiting = sorted(np.flatnonzero(~blocks.fixed).tolist(), key=lambda block: turn(there, (block,)))
    while waiting:
        checkpoint()
        move: Move | None = None
        for block in waiting:
            direction = freedom.way_out(block, there)
            if direction is not None:
                move = ((block,), direction)
                break
        if move is None and group > 1 and (together := freedom.group_out(there, group)) is not None:
            move = (tuple(together[0].tolist()), together[1])
        if move is None:
            return None
        moves.append(move)
        there[list(move[0])] = False
        waiting = [block for block in waiting if there[block]]
    return Laying(blocks, tuple(Step(*move, unsolved) for move in reversed(moves)), ())
