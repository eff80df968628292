"""All ways to join cells to parts within limits, by the number of parts, and the strongest of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import islice, product
from typing import Any, Final, Protocol

import numpy as np

from jld_core import (
    Assembly,
    Bits,
    Bools,
    Deadline,
    DeadlinePassed,
    Floats,
    InputError,
    Ints,
    LimitAnalysis,
    build_assembly,
    checkpoint,
    one_thread,
    parse_scene,
    solve_many,
)
from jld_core.batch import batch_solver
from jld_core.limit import case_relaxation
from jld_cut.cells import Limits
from jld_cut.meshes import kind_of

# sets of cells are whole numbers with one bit for each cell

SETS: Final = 60_000  # connected sets above which they are not listed
GROUPS: Final = 14  # groups to which cells are joined then
_LISTED: Final = 0.4  # share of the time for listing them
LAYOUTS: Final = 20_000  # layouts and branches of one number of parts that are solved at most
_EACH: Final = 1.0  # processor time of a layout that the batch solver does not settle, s
_FURTHER: Final = 600  # the same of more parts than the fewest, and after the strongest is proven
BEST: Final = 10  # layouts of one number of parts that are judged on convex cells
_SAME: Final = 1e-6  # relative difference of λ that is none
_PLENTY: Final = 1e12  # scaled λ above all
KEPT: Final = 40  # strongest layouts of each number of parts that are kept
_CHUNK: Final = 256  # layouts solved together
_MORE: Final = 3  # numbers of parts above the fewest that the front holds
_TURNS: Final = 12  # turns about each axis at which a box is tried


def frames(normals: Floats) -> Floats:
    """Return rotations (k, 3, 3) in which a part may lie in a box: along the axes, turned, and along cuts (c, 3)."""
    rotations = [np.eye(3)]
    for axis, turn in product(range(3), np.arange(1, _TURNS) * np.pi / (2 * _TURNS)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turned = np.eye(3)
        turned[np.ix_((i, j), (i, j))] = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        rotations.append(turned)
    for first, second in product(normals[:_TURNS], repeat=2):
        across = np.cross(first, second)
        if np.linalg.norm(across) > 0.1:
            across /= np.linalg.norm(across)
            rotations.append(np.array([first, across, np.cross(first, across)]))
    # a long part lies along the diagonal of a box
    rotations.append(np.linalg.qr(np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]).T)[0].T)
    return np.array(rotations)


@dataclass(frozen=True)
class Boxes:
    """Cells as boxes in several frames; parts are those of their cells."""

    low: Floats  # (n, k, 3) in k frames
    high: Floats
    moments: Floats  # (n, 13) of `meshes.moments`

    @property
    def volume(self) -> Floats:
        return np.asarray(self.moments[:, 0])

    @classmethod
    def of(cls, points: list[Floats], moments: Floats, rotations: Floats) -> Boxes:
        rotated = [np.einsum("kij,cj->cki", rotations, corners) for corners in points]
        return cls(
            np.array([corners.min(axis=0) for corners in rotated]),
            np.array([corners.max(axis=0) for corners in rotated]),
            moments,
        )

    def grouped(self, groups: list[int]) -> Boxes:
        """Return the boxes of groups of cells, given as bits."""
        cells = [[e for e in range(len(self.low)) if group >> e & 1] for group in groups]
        low = np.array([self.low[members].min(axis=0) for members in cells])
        high = np.array([self.high[members].max(axis=0) for members in cells])
        return Boxes(low, high, np.array([self.moments[members].sum(axis=0) for members in cells]))

    def fit(self, low: Floats, high: Floats, limits: Limits) -> Any:
        """Return whether boxes (s, k, 3) of sets fit the limits in some frame, (s,)."""
        sides = np.sort(high - low, axis=-1)
        return (sides <= limits.fit * (1 + 1e-9)).all(axis=-1).any(axis=-1)


def connected_sets(boxes: Boxes, around: list[int], limits: Limits, together: list[int], until: float) -> list[int]:
    """Return all connected sets of cells within limits, none of which parts a set of `together`; none above `SETS`."""
    count = len(around)
    level, sets = [1 << e for e in range(count)], list[int]()
    touched, low, high, volume = list(around), boxes.low, boxes.high, boxes.volume
    while level:
        within_limits = boxes.fit(low, high, limits) & (volume <= limits.volume * (1 + 1e-9))
        rows = np.flatnonzero(within_limits).tolist()
        sets += [level[k] for k in rows]
        if len(sets) > SETS or time.time() > until:
            return []
        grown: dict[int, tuple[int, int]] = {}
        for k in rows:
            candidates = touched[k] & ~level[k]
            while candidates:
                bit = candidates & -candidates
                candidates ^= bit
                grown.setdefault(level[k] | bit, (k, bit.bit_length() - 1))
        if len(grown) > 4 * SETS:
            return []
        parent, added = np.array(list(grown.values()), dtype=np.int64).reshape(-1, 2).T
        touched = [touched[k] | around[e] for k, e in zip(parent.tolist(), added.tolist(), strict=True)]
        level = list(grown)
        low, high = np.minimum(low[parent], boxes.low[added]), np.maximum(high[parent], boxes.high[added])
        volume = volume[parent] + boxes.volume[added]
    return [group for group in sets if all(group & kept_together in (0, kept_together) for kept_together in together)]


def _join_groups(boxes: Boxes, around: list[int], limits: Limits, least: int) -> Iterator[list[int]]:
    """Yield groups of cells, joined pair by pair, down to `least` or as few as fit."""
    groups = [1 << e for e in range(len(around))]
    while len(groups) > least:
        merged = boxes.grouped(groups)
        neighbours_of = _neighbours_of_groups(groups, around)
        pairs = [(a, b) for a, neighbours in enumerate(neighbours_of) for b in range(a) if neighbours >> b & 1]
        first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        low, high = (
            np.minimum(merged.low[first], merged.low[second]),
            np.maximum(merged.high[first], merged.high[second]),
        )
        volume = merged.volume[first] + merged.volume[second]
        fits = boxes.fit(low, high, limits) & (volume <= limits.volume * (1 + 1e-9))
        if not fits.any():
            break
        # the smallest first, of pairs alike the most compact one
        size = np.where(fits, np.round(volume / boxes.volume.sum(), 6) + 1e-9 * (high - low)[:, 0].sum(axis=-1), np.inf)
        a, b = pairs[int(np.argmin(size))]
        groups[b] |= groups.pop(a)
        yield list(groups)


def _neighbours_of_groups(groups: list[int], around: list[int]) -> list[int]:
    """Return as bits which groups touch each group; around: the cells that touch each cell."""
    cells = [[e for e in range(len(around)) if group >> e & 1] for group in groups]
    reach = [int(np.bitwise_or.reduce(np.array([around[e] for e in members], dtype=object))) for members in cells]
    return [
        sum(1 << k for k, group in enumerate(groups) if k != j and reached & group) for j, reached in enumerate(reach)
    ]


def _sets_of_groups(
    groups: list[int], boxes: Boxes, around: list[int], limits: Limits, together: list[int], until: float
) -> list[int]:
    """Return the connected sets of groups within limits, as bits of cells."""
    sets_of_groups = connected_sets(boxes.grouped(groups), _neighbours_of_groups(groups, around), limits, [], until)
    sets = [sum(cells for k, cells in enumerate(groups) if chosen >> k & 1) for chosen in sets_of_groups]
    return [cells for cells in sets if all(cells & pair in (0, pair) for pair in together)]


class Partitions:
    """Ways to choose disjoint sets that hold all cells; at most `alike` of their kinds differ."""

    def __init__(
        self, sets: list[int], count: int, kind: Callable[[int], Hashable] = hash, alike: int | None = None
    ) -> None:
        self.count, self.allowed, self._kind, self._alike = count, set(sets), kind, alike
        self._holding = [[group for group in sets if group >> e & 1] for e in range(count)]
        self._order = sorted(range(count), key=lambda e: len(self._holding[e]))
        self._largest = max((group.bit_count() for group in sets), default=0)
        self._reach = [0] * count  # cells that may be in one part with this one
        self._fewest: dict[int, int] = {0: 0}
        for e, holding in enumerate(self._holding):
            for group in holding:
                self._reach[e] |= group

    def fewest(self, left: int) -> int:
        """Return how many cells no two of which may be in one part are left, at least."""
        if left not in self._fewest:
            near = min((e for e in self._order if left >> e & 1), key=lambda e: (self._reach[e] & left).bit_count())
            self._fewest[left] = 1 + self.fewest(left & ~self._reach[near])
        return self._fewest[left]

    def extensions(self, chosen: tuple[int, ...], left: int, parts: int) -> Iterator[tuple[tuple[int, ...], int]]:
        """Yield the chosen sets with one more, and the cells left; parts: number to choose yet, from 2."""
        e = next(e for e in self._order if left >> e & 1)
        for group in self._holding[e]:
            checkpoint()
            rest = left & ~group
            if group & ~left or not rest or not self.keeps_kinds((*chosen, group, *(() if parts > 2 else (rest,)))):
                continue
            if parts == 2:
                possible = rest in self.allowed
            else:
                possible = rest.bit_count() <= (parts - 1) * self._largest and self.fewest(rest) < parts
            if possible:
                yield (*chosen, group), rest

    def keeps_kinds(self, chosen: tuple[int, ...]) -> bool:
        # at most `alike` kinds
        return self._alike is None or len({self._kind(group) for group in chosen}) <= self._alike

    def blocks(self, rows: list[tuple[int, ...]]) -> Ints:
        """Return the part (k, n) of each cell for layouts given by their sets."""
        bits = 1 << np.arange(self.count, dtype=object)
        part = [sum(k * ((group & bits) > 0).astype(int) for k, group in enumerate(row)) for row in rows]
        return np.array(part, dtype=np.int64).reshape(-1, self.count)


@dataclass
class Layouts:
    """Solved layouts of so many parts, the strongest first."""

    complete: bool  # none that was not solved is stronger than the strongest
    solved: int
    branches: int  # choices of some parts that were bounded
    blocks: Ints  # (k, n) part of each cell
    low: Floats  # (k,) infinite where no load makes the layout collapse
    high: float  # no layout of so many parts carries more, solved or not


@dataclass
class SearchResult:
    """What a search of all layouts found, by the number of parts."""

    of: dict[int, Layouts] = field(default_factory=dict)
    sets: int = 0  # sets of cells that fit
    problem: str = ""  # why the search found little, "" if nothing hindered it
    joined: bool = False  # cells were joined, since too many sets of them fit
    require: float = 0.0  # load factor that parts must carry
    whole: float = np.inf  # no joining of the cells carries more, within the limits or not

    def proven(self, parts: int) -> bool:
        # no fewer carry what is required, and none of so many are stronger than the strongest
        if self.kind(parts) == "joints":
            return False
        fewer = all(self.of[n].complete or self.of[n].high < self.require for n in range(1, parts))
        return fewer and self.of[parts].complete

    def kind(self, parts: int) -> str:
        # what bounds λ of at most so many parts: "branches", or "joints" where these are not known for all
        return "joints" if self.joined or any(n not in self.of for n in range(1, parts + 1)) else "branches"

    def bound(self, parts: int) -> float:
        """Return what no layout of at most so many parts exceeds; infinite where that is not known."""
        if self.kind(parts) == "joints":
            return self.whole
        return max(self.of[n].high for n in range(1, parts + 1))


@dataclass(frozen=True)
class SearchGoal:
    require: float  # load factor that the parts must carry
    most: int  # parts
    until: float  # end of the search once a layout carries it, s since the epoch
    last: float  # end of the search otherwise
    alike: int | None = None  # most different shapes of parts


class Bounds:
    """Bounds on λ of layouts by the parts of the first n elements; without crushing unless `crush`."""

    # few: that there will be few of them, so that the mean solution of samples is no start worth its time.

    def __init__(self, document: dict[str, Any], *, crush: bool = False, few: bool = False) -> None:
        kinds = {k: dict(v) if isinstance(v, dict) else v for k, v in document["materials"].items()}
        for kind in () if crush else ("dry", "inner"):
            kinds[kind].pop("compressive_strength", None)
        self.assembly = build_assembly(parse_scene(document | {"materials": kinds}))
        self.analysis = LimitAnalysis(self.assembly, single_labelling=few)

    def __call__(self, blocks: Ints) -> tuple[Floats, Floats, Bools]:
        """Return lower and upper bounds (k,) for parts (k, n), and where no load makes a layout collapse."""
        # Lower bounds are −inf where a layout is not proven to stand for some λ ≥ 0; upper ones are −inf where it falls
        # by itself, and inf where nothing is proven.
        labels, batch = labels_of(self.assembly, blocks), self.analysis.batch
        if batch is None:
            results = solve_many(self.assembly, labels, seconds=_EACH)
            status = np.array([str(state) for state in results.status])
            low, high, falls, locked = results.low, results.high, status == "unstable", status == "locked"
        else:
            raw, scale = batch.solve(labels), self.analysis.template.scaling.load
            low, high = scale * raw.low, scale * raw.high
            falls, locked = raw.verdict == batch_solver.FALLS, raw.verdict == batch_solver.LOCKED
        low = np.where(np.isfinite(low) & ~falls & (low >= 0.0), low, -np.inf)
        return low, np.where(falls, -np.inf, np.where(np.isfinite(high) & ~locked, high, np.inf)), locked

    @cached_property
    def _relaxation(self) -> Any:
        return case_relaxation.relaxation_of(self.assembly, [self.analysis])

    def relaxed(self, blocks: Ints, free: Bools, *, thorough: bool = False) -> Floats:
        """Return upper bounds (k,) for parts (k, n) whose joints between free cells (k, n) may open or not."""
        if self._relaxation is None:
            return np.full(len(blocks), np.inf)
        faces, undecided = self.assembly.interfaces, np.zeros((len(blocks), len(self.assembly.elements)), dtype=bool)
        undecided[:, : free.shape[1]] = free
        undecided = undecided[:, faces.a] & undecided[:, faces.b]
        labels, plenty = labels_of(self.assembly, blocks), np.full(len(blocks), _PLENTY)
        bounds = self._relaxation.refute_all(labels, undecided, plenty, np.full(len(free), thorough))
        return np.array([np.inf if bound is None else self._relaxation.unit * bound.bound for bound in bounds])


def labels_of(assembly: Assembly, blocks: Ints) -> Bits:
    """Return labels (k, m), True = dry, for parts (k, n) of the first n elements."""
    part = np.full((len(blocks), len(assembly.elements)), -1)
    part[:, : blocks.shape[1]] = blocks
    faces = assembly.interfaces
    return np.asarray(part[:, faces.a] != part[:, faces.b])


@one_thread()
def search(
    document: dict[str, Any], boxes: Boxes, around: list[int], limits: Limits, together: list[int], goal: SearchGoal
) -> SearchResult:
    """Solve all layouts of the fewest parts that fit and carry, and of some more while time lasts."""
    result = SearchResult(require=goal.require * (1 - 1e-6))
    try:
        bounds = Bounds(document)
    except InputError as error:  # splinters may leave joints that no face bears out
        result.problem = str(error)
        return result
    count = len(around)

    @cache
    def kind(group: int) -> tuple[int, ...]:
        members = [k for k in range(count) if group >> k & 1]
        return kind_of(boxes.moments[members].sum(axis=0), float(boxes.volume.max()))

    cells, everything = np.zeros((1, count), dtype=np.int64), np.ones((1, count), dtype=bool)
    result.whole = float(bounds.relaxed(cells, everything)[0])
    start = time.time()
    sets = connected_sets(boxes, around, limits, together, start + _LISTED * (goal.last - start))
    if not sets and time.time() < goal.last and (chain := list(_join_groups(boxes, around, limits, GROUPS))):
        result.joined, sets = True, _sets_of_groups(chain[-1], boxes, around, limits, together, goal.last)
    result.sets = len(sets)
    if sets:
        _search(result, Partitions(sets, count, kind, goal.alike), bounds, goal)
    else:
        result.problem = "too many sets of cells fit the box" if time.time() < goal.last else "time ended"
    if not any(len(layouts.low) for layouts in result.of.values()) and time.time() > goal.until:
        chain = [[1 << e for e in range(count)], *_join_groups(boxes, around, limits, 1)]
        chain = [groups for groups in chain if len(groups) <= goal.most]
        _add_joined(result, Partitions([], count, kind, goal.alike), chain, bounds, together)
    if np.isposinf(result.whole) and time.time() < goal.until:
        result.whole = float(bounds.relaxed(cells, everything, thorough=True)[0])
    return result


def _search(result: SearchResult, partitions: Partitions, bounds: Bounds, goal: SearchGoal) -> None:
    """Search the strongest layouts of 1, 2, … parts, up to a few more than needed."""
    fewest = partitions.count + 1
    for parts in range(1, min(goal.most, partitions.count) + 1):
        if parts > fewest + _MORE:
            break
        last = goal.last if parts < fewest else goal.until
        layouts = strongest(
            partitions, parts, bounds, result.whole, replace(goal, last=last), LAYOUTS if parts < fewest else _FURTHER
        )
        result.of[parts] = layouts
        if len(layouts.low) and layouts.low[0] >= result.require:
            fewest = min(fewest, parts)
        if time.time() > (goal.until if fewest <= partitions.count else goal.last):
            result.problem = "" if fewest <= partitions.count else "time ended"
            break


def _add_joined(
    result: SearchResult, partitions: Partitions, chain: list[list[int]], bounds: Bounds, together: list[int]
) -> None:
    """Add layouts of a chain that stand, where time ended the search; sets are bits of cells."""

    def joins(groups: list[int]) -> bool:
        """Return whether cells that must stay together are in one group."""
        return all(any(group & cells == cells for group in groups) for cells in together)

    rows = [tuple(groups) for groups in chain if partitions.keeps_kinds(tuple(groups)) and joins(groups)]
    if not rows:
        return
    blocks = partitions.blocks(rows)
    low, _, locked = bounds(blocks)
    for row, block, load_factor in zip(rows, blocks, np.where(locked, np.inf, low), strict=True):
        if load_factor >= 0.0:
            before = result.of.get(len(row))
            high = result.whole if before is None else before.high
            result.of[len(row)] = Layouts(False, 1, 0, block[None], np.array([load_factor]), high)


class Solver(Protocol):
    def __call__(self, blocks: Ints) -> tuple[Floats, Floats, Bools]: ...

    def relaxed(self, blocks: Ints, free: Bools) -> Floats: ...


@dataclass(eq=False)
class _Branch:
    chosen: tuple[int, ...]  # parts
    high: float  # no layout with them exceeds it
    extensions: Iterator[tuple[tuple[int, ...], int]]


class _LayoutSearch:
    """Branch and bound over the layouts of one number of parts; whole: bound on λ of all."""

    def __init__(self, partitions: Partitions, parts: int, solve: Solver, bound: float) -> None:
        self._partitions, self._parts, self._solve = partitions, parts, solve
        self.solved, self.branches, self._most = 0, 0, -np.inf
        self.blocks, self.low = np.zeros((0, partitions.count), dtype=np.int64), np.zeros(0)
        self._open: list[_Branch] = []
        cells = (1 << partitions.count) - 1
        if parts > 1:
            self._add((), cells, bound)
        elif cells in partitions.allowed:
            self._solve_leaves([((), cells, bound)])

    @property
    def top(self) -> float:
        # what no layout that was not solved exceeds
        return max((branch.high for branch in self._open), default=-np.inf)

    @property
    def best(self) -> float:
        return float(self.low[0]) if len(self.low) else -np.inf

    @property
    def complete(self) -> bool:
        return not self._open or self.top <= self.best * (1 + _SAME)

    def layouts(self) -> Layouts:
        high = max(self._most, self.top)
        return Layouts(self.complete, self.solved, self.branches, self.blocks, self.low, high)

    def _add(self, chosen: tuple[int, ...], left: int, high: float) -> None:
        if high >= 0.0:
            extensions = self._partitions.extensions(chosen, left, self._parts - len(chosen))
            self._open.append(_Branch(chosen, high, extensions))

    def expand(self, size: int, deep: bool) -> None:
        """Bound or solve `size` extensions of the branches of highest bounds, or of the deepest."""
        # DeadlinePassed leaves what is bounded
        order = sorted(
            self._open,
            key=lambda branch: (len(branch.chosen), branch.high) if deep else (branch.high, len(branch.chosen)),
        )
        nodes: list[tuple[tuple[int, ...], int, float]] = []
        ended: set[_Branch] = set()
        while order and len(nodes) < size:
            extensions = list(islice(order[-1].extensions, size - len(nodes)))
            nodes += [(chosen, left, order[-1].high) for chosen, left in extensions]
            if len(nodes) < size:
                ended.add(order.pop())
        is_leaf = [len(chosen) == self._parts - 1 for chosen, _, _ in nodes]
        inner = [branch for branch, last in zip(nodes, is_leaf, strict=True) if not last]
        if inner:
            free = self._partitions.blocks([(0, left) for _, left, _ in inner]) > 0
            high = self._solve.relaxed(self._partitions.blocks([(*chosen, left) for chosen, left, _ in inner]), free)
        self._solve_leaves([branch for branch, last in zip(nodes, is_leaf, strict=True) if last])
        for (chosen, left, most), bound in zip(inner, high if inner else (), strict=True):
            self._add(chosen, left, min(most, float(bound)))
        self._open = [branch for branch in self._open if branch not in ended]
        self.branches += len(inner)

    def _solve_leaves(self, leaves: list[tuple[tuple[int, ...], int, float]]) -> None:
        """Solve complete layouts and keep the strongest: chosen sets, the last set, and a bound of each."""
        if not leaves:
            return
        part = self._partitions.blocks([(*chosen, left) for chosen, left, _ in leaves])
        least, most, locked = self._solve(part)
        least, most = np.where(locked, np.inf, least), np.minimum(most, [high for _, _, high in leaves])
        self._most, self.solved = (
            max(self._most, float(np.where(locked, np.inf, most).max())),
            self.solved + len(part),
        )
        stands = least >= 0.0
        low = np.concatenate([self.low, least[stands]])
        best = np.argsort(-low, kind="stable")[:KEPT]
        self.blocks, self.low = np.concatenate([self.blocks, part[stands]])[best], low[best]


def strongest(
    partitions: Partitions, parts: int, solve: Solver, bound: float, goal: SearchGoal, number: int
) -> Layouts:
    """Return the strongest layouts of so many parts by branch and bound; number: of solves at most."""
    search_tree, size, last_step = _LayoutSearch(partitions, parts, solve, bound), 8, number
    while search_tree.top >= 0.0:
        require, steps_before = goal.require * (1 - 1e-6), search_tree.solved + search_tree.branches
        end = goal.until if search_tree.best >= require else goal.last
        if search_tree.complete or search_tree.top < require:
            last_step = min(last_step, steps_before + _FURTHER)
            if len(search_tree.low) >= BEST and search_tree.low[BEST - 1] >= search_tree.top:
                break
        if steps_before >= last_step or (steps_before and time.time() > end):
            break
        began = time.perf_counter()
        try:
            with Deadline(max(0.1, end - time.time())).enforced():
                # layouts and branches in turn: where bounds are far from λ, those of the highest lead to no layout
                search_tree.expand(size, search_tree.solved < search_tree.branches)
        except DeadlinePassed:
            break
        new = search_tree.solved + search_tree.branches - steps_before
        size = int(np.clip(new / (time.perf_counter() - began), 8, _CHUNK))  # a second each
    return search_tree.layouts()
