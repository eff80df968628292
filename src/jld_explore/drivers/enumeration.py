"""Enumerate every labelling of a space, one class after the other, face by face."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Ints
from jld_core.deadline import Deadline, DeadlinePassed, checkpoint
from jld_explore.drivers.base import Driver
from jld_explore.evaluation import Records
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space.labelling import representatives
from jld_explore.space.search_space import SearchSpace


def breadth_first(space: SearchSpace) -> Ints:
    """Return the indices of the free elements in breadth-first order, (free,)."""
    # Neighbours are elements that share a candidate face. Each component starts at a far end, so that few elements are
    # half decided at a time in an enumeration.
    assembly, graph = space.assembly, space.graph
    count = len(assembly.elements)
    links: list[list[int]] = [[] for _ in range(count)]
    joined = space.candidates & assembly.free_faces
    for a, b in zip(graph.a[joined].tolist(), graph.b[joined].tolist(), strict=True):
        links[a].append(b)
        links[b].append(a)

    def visit(start: int, seen: set[int]) -> list[int]:
        queue, visited, seen = deque([start]), [], {*seen, start}
        while queue:
            element = queue.popleft()
            visited.append(element)
            for other in sorted(set(links[element])):
                if other not in seen:
                    seen.add(other)
                    queue.append(other)
        return visited

    order: list[int] = []
    for element in assembly.elements.free.tolist():
        if element not in order:
            seen = set(order)
            order += visit(visit(visit(element, seen)[-1], seen)[-1], seen)
    return np.array(order, dtype=np.int64)


Names = NDArray[np.unsignedinteger[Any]]

PORTION: Final = 8192  # most labellings that one call of `ask` returns
_BYTES: Final = 256 << 20  # memory for the stack of frontiers, bytes

# Largest number of rows of a frontier. A frontier of this size stays in a cache level while a face is decided.
_ROWS: Final = 1024
_QUICK_ROWS: Final = 64  # number of rows of a frontier in a quick count of a space
_QUICK_FRONTIERS: Final = 150  # number of frontiers in a quick count of a space
# Largest number of frontiers times elements in a count of a space. A count of 2 000 frontiers of 300 elements takes
# some 2 s.
_MOST_ELEMENTS_EXAMINED: Final = 600_000

# Relative rounding error allowed, beyond that of the limits, where rows are excluded. Rows are excluded by partial sums
# of their block sizes.
_SLACK: Final = 1e-9


@dataclass(frozen=True)
class Tally:
    labellings: int  # number of labellings
    classes: int  # number of labellings that differ by more than symmetry


@dataclass(frozen=True)
class _Frontier:
    """Partial labellings of one level, stored by columns."""

    level: int  # number of faces decided
    block: Names  # (n, r) block of each place, named by its smallest place
    label: Bits  # (c, r) decided labels, True = dry; only where they do not follow from the blocks
    closed: Ints  # (r,) number of blocks that can no longer grow
    dry: Ints  # (c, r) number of dry faces that each limit on a number of faces counts

    def take(self, rows: Ints | slice) -> _Frontier:
        return _Frontier(self.level, self.block[:, rows], self.label[:, rows], self.closed[rows], self.dry[:, rows])


class Enumeration(Driver):
    """Driver that enumerates all classes of a space, in an order of the space alone."""

    name = "enumeration"
    ahead: int = 1

    def __init__(self, space: SearchSpace, seed: int = 0, *, rows: int | None = None) -> None:
        # Faces are decided so that one element after the other is complete. In a segmentation a face within a block is
        # inner; one between two blocks is dry, or merges them unless a dry face lies between. Without limits on sizes
        # every row has a completion, so work is proportional to labellings found.
        super().__init__(space, seed)
        self.search = space.search
        graph, elements = space.graph, space.assembly.elements
        # Places are the free elements in the order of decision, then the supports. The name of a block is its
        # smallest place. A block contains a free element exactly where its name is below the number of free elements.
        self._order = np.concatenate([breadth_first(space), np.flatnonzero(elements.support)])
        position = np.argsort(self._order)
        self._free = len(elements.free)
        self._sink = int(position[space.assembly.sink]) if space.assembly.sink >= 0 else -1
        ends = np.sort(np.column_stack([position[graph.a], position[graph.b]]), axis=1)
        rank = np.where(ends < self._free, ends, -1)
        rank = np.sort(rank, axis=1)
        candidates = np.flatnonzero(space.candidates)
        self._faces = candidates[np.lexsort((candidates, rank[candidates, 0], rank[candidates, 1]))]
        self._ends = ends[self._faces]
        fixed_dry = ends[~space.candidates & space.fixed]
        self._dry_ends = np.concatenate([fixed_dry, self._ends])
        self._fixed_dry_count = len(fixed_dry)
        self._limits, on_terms = space.limits, space.limits.on_terms
        self._sized = self._limits.sized.take(self._order[: self._free])
        on_faces = [(terms.faces, bounds) for terms, bounds in on_terms if terms.faces is not None and not terms.blocks]
        self._counted = [(faces[self._faces].astype(np.int64), bounds) for faces, bounds in on_faces]
        fixed_dry_faces = ~space.candidates & space.fixed
        self._dry_at_start = np.array([[(faces & fixed_dry_faces).sum()] for faces, _ in on_faces], dtype=np.int64)
        on_blocks = [bounds for terms, bounds in on_terms if terms.blocks and terms.faces is None]
        self._fewest = max((bounds.least for bounds in on_blocks), default=-np.inf)
        self._greatest = min((bounds.most for bounds in on_blocks), default=np.inf)
        least = space.least[self._order]
        first = np.full(len(elements), len(elements))
        np.minimum.at(first, least, np.arange(len(elements)))
        self._start = first[least]
        share = _BYTES // max(1, (2 * len(elements) + len(candidates)) * (len(candidates) + 1))
        self._rows = rows or int(np.clip(share, 64, _ROWS))
        # number of rows checked together where assembly sequences take long to find; 0 without such a check
        self._rows_per_check = 0 if space.laying is None else max(1, space.laying.counted // 4)
        self._deadline: Deadline | None = None
        self._ended = self._interrupted = False
        self._portions = self.batches()
        self._unreturned = np.empty((0, len(space.fixed)), dtype=bool)

    @property
    def exhaustive(self) -> bool:
        return True

    def ask(self, limit: int | None = None) -> Bits:
        number = PORTION if limit is None else min(limit, PORTION)
        while len(self._unreturned) < number and not self._interrupted:
            try:
                portion = next(self._portions, None)
            except DeadlinePassed:
                # a generator that raised cannot continue, so only the classes found before are returned
                self._interrupted = True
                break
            self._ended = portion is None
            if portion is None:
                break
            self._unreturned = np.concatenate([self._unreturned, portion[0]])
            if self._rows_per_check and (len(self._unreturned) or self._late):
                break
        if self._interrupted and not len(self._unreturned):
            raise DeadlinePassed
        labellings, self._unreturned = self._unreturned[:number], self._unreturned[number:]
        return labellings

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        self._deadline = deadline

    @property
    def working(self) -> bool:
        return not self._ended

    @property
    def _late(self) -> bool:
        return self._deadline is not None and self._deadline.passed()

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None: ...

    def batches(self) -> Iterator[tuple[Bits, Ints]]:
        """Yield canonical labellings (k, m), and how many labellings each stands for (k,)."""
        for rows in self._walk():
            if rows is not None:
                representative, multiplicity = representatives(rows, self.space.group)
                for low in range(0, len(representative), self._rows_per_check or max(1, len(representative))):
                    part = representative[low : low + (self._rows_per_check or len(representative))]
                    laid = self.space.can_be_laid(rows[part])
                    yield rows[part[laid]], multiplicity[low : low + len(part)][laid]

    def count(self) -> Tally:
        labellings = classes = 0
        for _, multiplicity in self.batches():
            labellings += int(multiplicity.sum())
            classes += len(multiplicity)
        return Tally(labellings, classes)

    def size_up_to(self, limit: int, most_frontiers: int = 2000) -> int | None:
        """Count classes up to a limit; None above it, or if `most_frontiers` do not suffice."""
        # With assembly sequences to check the limit is at most `space.laying.counted`, since the time per frontier
        # grows with the number of elements.
        most_frontiers = min(most_frontiers, _MOST_ELEMENTS_EXAMINED // max(len(self._start), 1))
        if len(self._faces) >= most_frontiers:  # the first labelling needs one frontier per face
            return None
        classes, batches = 0, []
        if self.space.laying is not None:
            limit = min(limit, self.space.laying.counted)
        for frontiers, rows in enumerate(self._walk()):
            if rows is not None:
                batches.append(rows[representatives(rows, self.space.group)[0]])
                classes += len(batches[-1])
            if classes > limit or frontiers >= most_frontiers:
                return None
        return sum(int(self.space.can_be_laid(rows).sum()) for rows in batches)

    def _walk(self) -> Iterator[Bits | None]:
        """Examine frontiers depth first; yield labellings (k, m) of a complete one, else None."""
        start = np.ascontiguousarray(self._start[:, None])
        name_type = np.uint8 if len(start) <= 256 else np.uint16 if len(start) <= 65536 else np.uint32
        label_rows = 0 if self.search.segmentation else len(self._faces)
        zero, dry = np.zeros(1, dtype=np.int64), self._dry_at_start.reshape(len(self._counted), 1)
        stack = [_Frontier(0, start.astype(name_type), np.zeros((label_rows, 1), dtype=bool), zero, dry)]
        while stack:
            checkpoint()
            frontier = stack.pop()
            if frontier.level == len(self._faces):
                yield self._complete(frontier)
                continue
            frontier = self._decide(frontier)
            total = len(frontier.closed)
            cuts = range(0, total, self._rows)
            stack += [frontier.take(slice(i, i + self._rows)) for i in reversed(cuts)]
            yield None

    def _complete(self, frontier: _Frontier) -> Bits:
        """Return the labellings (k, m) of complete rows that keep all limits."""
        labels = np.repeat(self.space.fixed[None], len(frontier.closed), axis=0)
        if self.search.segmentation:
            labels[:, self._faces] = (frontier.block[self._ends[:, 0]] != frontier.block[self._ends[:, 1]]).T
        else:
            labels[:, self._faces] = frontier.label.T
        if self._limits.given:
            blocks = np.empty((len(labels), len(self._order)), dtype=np.int64)
            blocks[:, self._order] = self._order[frontier.block.T.astype(np.int64)]
            labels = labels[self._limits.kept(labels, self.space.graph, blocks)]
        return labels

    def _decide(self, rows: _Frontier) -> _Frontier:
        """Decide one more face: return each row with it inner and dry, if limits can still hold."""
        level, search = rows.level, self.search
        i, j = self._ends[level]
        p, q = rows.block[i], rows.block[j]
        apart = p != q
        inner = ~apart | ~self._violates_limit(rows, (p, q), most=True)
        dry = np.ones_like(apart)
        if search.segmentation:
            inner &= ~apart | ~self._separates(rows, p, q)
            dry = apart
        for number, (counted, bounds) in zip(rows.dry, self._counted, strict=True):
            dry = dry & ~bounds.above(number + counted[level])
            inner = inner & ~bounds.below(number + counted[level + 1 :].sum())
        # child 2r is row r with the face inner, child 2r + 1 with it dry
        child = np.flatnonzero(np.column_stack([inner, dry]))
        parent, is_dry = child >> 1, (child & 1).astype(bool)
        new = rows.take(parent)
        label = new.label
        if not search.segmentation:
            label[level] = is_dry
        p, q, apart = p[parent], q[parent], apart[parent]
        low = np.minimum(p, q)  # an inner face merges both blocks, under the smaller name
        merged = np.where(is_dry, p, np.maximum(p, q))
        merged_into = np.where(is_dry, p, low)
        block = np.where(new.block == merged, merged_into, new.block)
        added = np.array([counted[level] for counted, _ in self._counted], dtype=np.int64)
        new = _Frontier(level + 1, block, label, new.closed, new.dry + added[:, None] * is_dry)
        return self._prune(new, np.where(is_dry, p, low), np.where(is_dry & apart, q, low), apart, is_dry)

    def _separates(self, rows: _Frontier, p: Names, q: Names) -> Bools:
        """Return (r,) True where a dry face decided before lies between blocks p and q, both (r,)."""
        before = self._dry_ends[: self._fixed_dry_count + rows.level]
        first, second = rows.block[before[:, 0]], rows.block[before[:, 1]]
        return np.asarray((((first == p) & (second == q)) | ((first == q) & (second == p))).any(axis=0))

    def _violates_limit(self, rows: _Frontier, names: tuple[Names, ...], *, most: bool) -> Bools:
        """Return (r,) True where the union of named blocks, (r,) each, is too large, or too small."""
        limits, free = self._limits, rows.block[: self._free]
        # a block that is too large may still merge with an exempt one
        if (not limits.has_most or limits.mendable) if most else not limits.has_least:
            return np.zeros(rows.block.shape[1], dtype=bool)
        members = np.zeros(free.shape, dtype=bool)
        for name in names:
            members |= free == name
        size = self._sized.together(members)
        bad = limits.too_large(size, _SLACK) if most else limits.too_small(size, _SLACK)
        if self._sink >= 0:
            # cells left out form no block, and the remaining cells are separated from them before that part grows
            bad = bad & ~np.logical_or.reduce([rows.block[self._sink] == name for name in names])
        return np.asarray(bad & members.any(axis=0))

    def _prune(self, rows: _Frontier, p: Names, q: Names, apart: Bools, is_dry: Bools) -> _Frontier:
        """Remove rows that no completion can bring within the limits, after the face between p and q (r,)."""
        # A block beside the face just decided may be closed and too small, or the number of blocks out of bounds.
        small, greatest = self._limits.has_least, self._greatest
        good = np.ones(len(apart), dtype=bool)
        closed = rows.closed
        if small or greatest < np.inf:
            shut_p = apart & self._cannot_grow(rows, p)
            shut_q = apart & is_dry & self._cannot_grow(rows, q)
            if small:
                good &= ~(shut_p & self._violates_limit(rows, (p,), most=False))
                good &= ~(shut_q & self._violates_limit(rows, (q,), most=False))
            closed = closed + (shut_p & (p < self._free)) + (shut_q & (q < self._free))
            good &= closed <= greatest
        if self._fewest > -np.inf:
            free = rows.block[: self._free]
            good &= (free == np.arange(self._free)[:, None]).sum(axis=0) >= self._fewest
        rows = _Frontier(rows.level, rows.block, rows.label, closed, rows.dry)
        return rows if good.all() else rows.take(np.flatnonzero(good))

    def _cannot_grow(self, rows: _Frontier, name: Names) -> Bools:
        """Return (r,) True where no undecided face leaves the named block."""
        after = self._ends[rows.level :]
        leaves = (rows.block[after[:, 0]] == name) != (rows.block[after[:, 1]] == name)
        return np.asarray(~leaves.any(axis=0))


def size_up_to(space: SearchSpace, limit: int, *, quick: bool = False) -> int | None:
    """Count the classes of a space; None above a limit, or if the count takes too long."""
    if quick:
        return Enumeration(space, rows=_QUICK_ROWS).size_up_to(limit, most_frontiers=_QUICK_FRONTIERS)
    return Enumeration(space).size_up_to(limit)
