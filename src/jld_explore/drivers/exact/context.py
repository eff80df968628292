"""Define the data that stay fixed during a proof, and its schedules."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final, Protocol

import cloudpickle
import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.deadline import Deadline, DeadlinePassed, checkpoint, time_left
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.case_relaxation import AnyRelaxation, relaxation_of
from jld_core.limit.mechanism import DualBound
from jld_explore.drivers.base import Driver
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space import Count
from jld_explore.space.limits import SizeOf
from jld_explore.space.search_space import SearchSpace

MOST: Final = 20_000  # number of possible blocks above which they are not listed
_ROWS: Final = 512  # number of sets whose sizes are computed at once
_GROWN: Final = 4  # sets, as a multiple of `MOST`, above which sets of one size are not compared with the limits


@dataclass(frozen=True)
class PossibleBlocks:
    members: tuple[tuple[int, ...], ...]  # elements of each block, ascending
    inside: tuple[tuple[int, ...], ...]  # faces with both sides in the block, ascending

    def __len__(self) -> int:
        return len(self.members)

    def labelling(self, space: SearchSpace, chosen: Ints) -> Bits:
        """Return the labels (m,) of the segmentation into chosen blocks, True = dry."""
        labels = np.ones(len(space.fixed), dtype=bool)
        for p in chosen.tolist():
            labels[list(self.inside[p])] = False
        return labels


def possible_blocks(space: SearchSpace) -> PossibleBlocks | None:
    """List the possible blocks of a space; None above `MOST`, with slits, or if one may hold a support."""
    assembly = space.assembly
    faces, support = assembly.interfaces, assembly.elements.support
    a, b = faces.a, faces.b
    may_join = space.candidates | ~space.fixed
    to_support = support[a] | support[b]
    if not space.search.segmentation or np.any(may_join & to_support):
        return None
    must_join = ~space.candidates & ~space.fixed
    free = assembly.elements.free
    row_of = np.full(len(assembly.elements), -1)
    row_of[free] = np.arange(len(free))
    between_free = np.flatnonzero(~to_support)
    ends = np.column_stack([row_of[a[between_free]], row_of[b[between_free]]])
    connected = _connected_sets(space, ends[may_join[between_free]])
    if connected is None:
        return None
    members, inside = [], []
    for rows in np.array_split(connected, max(1, len(connected) // _ROWS)):
        checkpoint()
        first, second = rows[:, ends[:, 0]], rows[:, ends[:, 1]]
        impossible = (first & second & ~may_join[between_free]).any(axis=1)
        impossible |= ((first ^ second) & must_join[between_free]).any(axis=1)
        impossible |= space.limits.too_small(_sizes(rows, space))
        for row, links in zip(rows[~impossible], (first & second)[~impossible], strict=True):
            block = free[row].tolist()
            if not space.limits.misshapen(block):
                members.append(tuple(block))
                inside.append(tuple(between_free[links].tolist()))
    return PossibleBlocks(tuple(members), tuple(inside))


def _connected_sets(space: SearchSpace, links: Ints) -> Bools | None:
    """List the connected sets (p, f) of free elements within upper limits, by size; None above `MOST`."""
    # A set is grown by one element at a time, so that a set above a limit is not grown further.
    number = len(space.assembly.elements.free)
    neighbours = [0] * number
    for e, other in links.tolist():
        neighbours[e] |= 1 << other
        neighbours[other] |= 1 << e
    # each set as bits, with the elements that it touches
    level = _within_limits({1 << e: neighbours[e] for e in range(number)}, space)
    by_size = [np.zeros((0, number), dtype=bool)]
    total = 0
    while level:
        rows = _rows_of(list(level), number)
        by_size.append(rows[np.lexsort(~rows.T[::-1])])
        total += len(level)
        if total > MOST:
            return None
        grown: dict[int, int] = {}
        for block, touched in level.items():
            checkpoint()
            to_add = touched & ~block
            while to_add:
                added = to_add & -to_add  # the lowest bit
                to_add ^= added
                if block | added not in grown:
                    grown[block | added] = touched | neighbours[added.bit_length() - 1]
            if len(grown) > _GROWN * MOST:
                return None
        level = _within_limits(grown, space)
    return np.concatenate(by_size)


def _within_limits(sets: dict[int, int], space: SearchSpace) -> dict[int, int]:
    """Return the sets, keys as bits over the free elements, that exceed no upper limit on blocks."""
    limits, number = space.limits, len(space.assembly.elements.free)
    within: dict[int, int] = {}
    items = iter(sets.items())
    while part := list(islice(items, _ROWS)):
        checkpoint()
        above = limits.too_large(_sizes(_rows_of([block for block, _ in part], number), space))
        within.update(entry for entry, large in zip(part, np.broadcast_to(above, len(part)), strict=True) if not large)
    return within


def _rows_of(sets: list[int], count: int) -> Bools:
    """Return sets given as bits as rows (k, count), True = in the set."""
    width = -(-count // 8)
    packed = np.frombuffer(b"".join(bits.to_bytes(width, "little") for bits in sets), dtype=np.uint8)
    rows = np.unpackbits(packed.reshape(len(sets), width), axis=1, count=count, bitorder="little")
    return rows.astype(bool)


def _sizes(rows: Bools, space: SearchSpace) -> SizeOf:
    """Return a function that gives the sizes (k,) of sets of free elements (k, f)."""
    members = np.zeros((len(space.assembly.elements), len(rows)), dtype=bool)
    members[space.assembly.elements.free] = rows.T
    return space.limits.sized.together(members)


class BlockTables:
    """Tables (c, p) of the p blocks that contain, touch or are bounded by each of the c faces `faces`."""

    def __init__(self, space: SearchSpace, blocks: PossibleBlocks) -> None:
        free, a, b = space.assembly.elements.free, space.assembly.interfaces.a, space.assembly.interfaces.b
        covers = np.zeros((len(space.assembly.elements), len(blocks)), dtype=bool)
        contains = np.zeros((len(a), len(blocks)), dtype=bool)
        for p, (members, inside) in enumerate(zip(blocks.members, blocks.inside, strict=True)):
            covers[list(members), p] = True
            contains[list(inside), p] = True
        self._covering = covers[free]
        self.faces = np.flatnonzero(space.candidates & contains.any(axis=1))
        self.inside = contains[self.faces]
        self.beside = covers[a[self.faces]]
        self.separated_by = (self.beside | covers[b[self.faces]]) & ~self.inside

    def agreeing(self, faces: Ints, labels: Bits) -> Bools:
        """Return (p,) True for the blocks that labels (k,) on faces (k,) admit."""
        label = dict(zip(faces.tolist(), labels.tolist(), strict=True))
        labelled = np.isin(self.faces, faces)
        dry = np.array([label.get(face, False) for face in self.faces.tolist()], dtype=bool)
        excluded = self.inside[labelled & dry].any(axis=0) | self.separated_by[labelled & ~dry].any(axis=0)
        return np.asarray(~excluded, dtype=bool)

    def propagated(self, allowed: Bools) -> Bools | None:
        """Return (p,) the blocks left of `allowed` (p,) by propagation; None if an element has none."""
        # An element with a single block left takes that block, which excludes the blocks that overlap it.
        while True:
            covering = self._covering & allowed
            number = covering.sum(axis=1)
            if not number.all():
                return None
            sole_blocks = covering[number == 1].any(axis=0)
            covered_times = self._covering[:, sole_blocks].sum(axis=1)
            if (covered_times > 1).any():
                return None
            remaining = allowed & (sole_blocks | ~self._covering[covered_times > 0].any(axis=0))
            if (remaining == allowed).all():
                return allowed
            allowed = remaining

    def undecided(self, allowed: Bools) -> Ints:
        """Return the positions of faces inside some blocks left (p,) and on the edge of others."""
        around = (self.beside & allowed).sum(axis=1)
        holding = (self.inside & allowed).sum(axis=1)
        return np.flatnonzero((holding > 0) & (holding < around))


# Largest share of the time left for listing the possible blocks; the formula works without the list
_LISTING_SHARE: Final = 0.3
SEED_STEP: Final = 1000  # difference of the seeds of two threads or workers, so that each prefers other labels


class PartialLabellingRelaxation(Protocol):
    """Relaxation that bounds scaled λ of labellings (k, m) whose `undecided` faces are open."""

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Prove that partial labellings (k, m) do not exceed thresholds (k,); None if unproven."""
        ...

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """Prove that one partial labelling (m,) does not exceed `threshold`, or return None."""
        ...

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the least bound on scaled λ of one partial labelling (m,), or None."""
        ...

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Return bounds (k,) of mechanisms (k, q · free): inf proves nothing, −inf no λ."""
        ...


class CheckedProof(Protocol):
    """Data that the check of a proof needs, of a proof by rigid blocks or by fields."""

    @property
    def space(self) -> SearchSpace:
        """Search space."""

    @property
    def blocks(self) -> PossibleBlocks | None:
        """Possible blocks, None where they are not listed."""

    @property
    def free(self) -> Bools:
        """Faces (m,), True where some labelling of the space has either label."""

    @property
    def relaxation(self) -> PartialLabellingRelaxation:
        """Relaxation that refutes labellings and evaluates mechanisms."""

    @property
    def labels(self) -> Bits:
        """Labels (m,) of faces that are not free; entries of free faces are unused."""


@dataclass(frozen=True)
class ProofContext:
    """Space of a proof by conflicts, with its possible blocks, analyses and relaxation."""

    space: SearchSpace
    blocks: PossibleBlocks | None  # possible blocks, where they are listed
    free: Bools  # (m,) faces that may take either label in some labelling
    seed: int
    analyses: tuple[LimitAnalysis, ...]  # analyses of the load cases, in their order
    # relaxation face by face, which refutes labellings and evaluates mechanisms. It counts its solves.
    relaxation: AnyRelaxation

    @classmethod
    def of(
        cls, space: SearchSpace, seed: int, counted: Count | None = None, *, list_blocks: bool = True
    ) -> ProofContext | None:
        analyses = tuple(LimitAnalysis(case) for case in space.assembly.by_case)
        blocks = listed_blocks(space) if list_blocks else None
        if without_formula(space, blocks, counted) is not None:
            return None
        relaxation = relaxation_of(space.assembly, analyses)
        if relaxation is None:
            return None
        free = free_faces(space, blocks)
        return cls(space, blocks, free, seed, analyses, relaxation)

    @property
    def labels(self) -> Bits:
        """Labels (m,) of faces that are not free: candidates outside every possible block are dry."""
        return np.asarray(self.space.fixed | (self.space.candidates & ~self.free))

    def packed(self, seed: int) -> bytes:
        # cloudpickle, because limits hold lambdas; the worker makes a relaxation of its own
        content: bytes = cloudpickle.dumps((self.space, self.blocks, self.free, seed))
        return content

    @classmethod
    def unpacked(cls, content: bytes) -> ProofContext:
        """Make the context, with new analyses and relaxation, in a worker from the bytes of `packed`."""
        unpickled: tuple[SearchSpace, PossibleBlocks | None, Bools, int] = cloudpickle.loads(content)
        space, blocks, free, seed = unpickled
        analyses = tuple(LimitAnalysis(case) for case in space.assembly.by_case)
        relaxation = relaxation_of(space.assembly, analyses)
        if relaxation is None:
            raise RuntimeError("a proof by conflicts needs a relaxation, and the assembly has none")
        return cls(space, blocks, free, seed, analyses, relaxation)

    @property
    def key(self) -> str:
        """Digest of all on which conflicts depend; recorded ones hold for an equal key only."""
        # It covers the numbers of the programs, the free faces, the symmetry group and the possible blocks.
        space = self.space
        parts = [
            space.candidates.tobytes(),
            space.fixed.tobytes(),
            space.group.tobytes(),
            space.assembly.required.tobytes(),
        ]
        for analysis in self.analyses:
            template = analysis.template
            pattern = template.yield_set.pattern
            numbers = (template.matrix.data, template.dead, template.live, pattern.dry, pattern.inner)
            parts += [part.tobytes() for part in (*numbers, pattern.h_dry, pattern.h_inner)]
        names = repr(None if self.blocks is None else self.blocks.members).encode()
        return hashlib.sha256(b"".join([*parts, names])).hexdigest()


def listed_blocks(space: SearchSpace) -> PossibleBlocks | None:
    """List the possible blocks of a space; None also if that takes too long."""
    try:
        with Deadline(_LISTING_SHARE * time_left()).enforced():
            return possible_blocks(space)
    except DeadlinePassed:
        return None


def free_faces(space: SearchSpace, blocks: PossibleBlocks | None) -> Bools:
    """Return the faces (m,) that may take either label in some labelling."""
    if blocks is None:
        return space.candidates.copy()
    joined = {face for inside in blocks.inside for face in inside}
    return np.asarray(space.candidates & np.isin(np.arange(len(space.candidates)), list(joined)))


def without_formula(space: SearchSpace, blocks: PossibleBlocks | None, aimed: Count | None) -> Count | None:
    """Return the first count, of the limits or the one aimed at, that no formula expresses; None if all have one."""
    for count in [*(count for count, _ in space.limits.on_counts), *([] if aimed is None else [aimed])]:
        terms = count.terms(space.assembly) if count.terms else None
        if terms is None or (terms.blocks and blocks is None):
            return count
    return None


class Heuristics:
    """Heuristic drivers of a proof: one that may begin it, and one that runs whenever it is due."""

    def __init__(self, driver: Driver, due: int) -> None:
        self.driver, self.due = driver, due
        self.limit: int | None = None
        self.ended = False
        self._starter: Driver | None = None
        self._starter_due = 0

    @property
    def starting(self) -> bool:
        """True if labellings of the driver that begins are due."""
        return self._starter_due > 0

    def begin_with(self, starter: Driver, due: int) -> None:
        """Let another driver begin the proof with `due` labellings, in place of the usual driver."""
        self._starter, self._starter_due = starter, due
        self.due = 0

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        if self.ended:
            return
        self.driver.tell(labellings, evaluations)
        if self._starter is not None:
            self._starter.tell(labellings, evaluations)

    def start(self) -> Iterator[Bits]:
        """Yield labellings (k, m) of the driver that begins, until none is due."""
        while self._starter is not None and self._starter_due > 0:
            labellings = self._starter.ask(self._limit_count(self._starter_due))
            self._starter_due -= len(labellings) or self._starter_due
            yield labellings
        self._starter = None

    def run(self) -> Iterator[Bits]:
        """Yield labellings (k, m) of the usual driver, until none is due."""
        while self.due > 0:
            labellings = self.driver.ask(self._limit_count(self.due))
            self.due -= len(labellings) or self.due
            yield labellings

    def _limit_count(self, due: int) -> int:
        """Return the number of labellings to ask for, if `due` are due."""
        return due if self.limit is None else min(self.limit, due)


# Gap, relative to the bound, up to which the whole gap is tried at once. Intermediate steps would need a third more
# conflicts in total.
_WHOLE_GAP: Final = 0.2
_FIRST_FRACTION: Final = 0.5  # first step of a wider gap, as a fraction of the gap
_LAST_FRACTION: Final = 0.75  # fraction of the gap from which a step covers the whole gap
_LEAST_STEP: Final = 2e-3  # smallest step, relative to the bound
_GROWTH: Final = 1.5  # factor by which the fraction grows after a step that needed few conflicts
_QUICK_SHARE: Final = 0.25  # share of the allowed conflicts below which a step counts as quick

# Factor on the allowed conflicts of the next step after a step that exceeded them. On the 8 × 10 wall in blocks of
# three 22 thousand conflicts leave nothing above 0.723, and 26 thousand nothing above 0.70.
_MORE_CONFLICTS: Final = 4


@dataclass(frozen=True)
class ScheduledStep:
    """One λ to refute on the way to the best λ of a target."""

    threshold: float  # the λ, scene units
    conflicts: int  # number of conflicts known when the step began


class TargetSchedule:
    """Sequence of λ targets from a bound down to the best λ known, by fractions of the gap."""

    def __init__(self, conflicts_allowed: int) -> None:
        self._conflicts_allowed = conflicts_allowed
        self._fraction: float | None = None

    def next_target(self, bound: float, low: float) -> float:
        """Return the next λ to refute, between `low` and `bound`; `low` covers the whole gap."""
        gap = bound - low
        if not math.isfinite(bound) or gap <= 0.0:
            return low
        if self._fraction is None:
            self._fraction = 1.0 if gap <= _WHOLE_GAP * abs(bound) else _FIRST_FRACTION
        return low if self._fraction >= _LAST_FRACTION else bound - self._fraction * gap

    def note_proven(self, conflicts: int) -> None:
        """Record a proven step and its number of conflicts; after few of them steps grow."""
        if self._fraction is not None and conflicts < _QUICK_SHARE * self._conflicts_allowed:
            self._fraction *= _GROWTH

    def is_stuck(self, conflicts: int, bound: float, aimed: float) -> bool:
        """Return whether the current step should be replaced by one half as wide."""
        if conflicts < self._conflicts_allowed or not bound - aimed > _LEAST_STEP * abs(bound):
            return False
        self._fraction = _FIRST_FRACTION * min(1.0 if self._fraction is None else self._fraction, 1.0)
        self._conflicts_allowed *= _MORE_CONFLICTS
        return True


_FIRST_INTERVAL: Final = 4000  # relaxations before annealing first runs during a proof; the interval then doubles

# Labellings annealed per relaxation since the last run, with and without batch solver. Annealing then takes some 10 to
# 15 % of the time.
_LABELLINGS_PER_RELAXATION: Final = (0.025, 0.15)
_LONG_PROOF: Final = 60_000  # number of relaxations from which a proof counts as long
# Least number of labellings annealed per relaxation in a long proof. There a relaxation takes half as long as the
# evaluation of a labelling (0.24 and 0.5 ms for the crushable arch), in small walls a seventh.
_LABELLINGS_IN_LONG_PROOF: Final = 0.06


class AnnealingSchedule:
    def __init__(self, *, batched: bool, disabled: bool) -> None:
        self._share = _LABELLINGS_PER_RELAXATION[not batched]
        self._interval = math.inf if disabled else _FIRST_INTERVAL
        self._last_run = 0

    def labellings_due(self, relaxations: int) -> int:
        """Return how many labellings to anneal now; a number above 0 starts the next interval."""
        since = relaxations - self._last_run
        if since < self._interval:
            return 0
        self._last_run, self._interval = relaxations, 2 * self._interval
        return int(since * (max(self._share, _LABELLINGS_IN_LONG_PROOF) if relaxations >= _LONG_PROOF else self._share))
