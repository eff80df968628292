"""All ways to join cells to parts within limits, by the number of parts, and the strongest of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import islice, product
from typing import Any, Final

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
from jld_cut.cells import Limits
from jld_cut.meshes import kind_of

# sets of cells are whole numbers with one bit for each cell

SETS: Final = 60_000  # connected sets above which they are not listed
GROUPS: Final = 14  # groups to which cells are joined then
_LISTED: Final = 0.4  # share of the time for listing them
LAYOUTS: Final = 20_000  # layouts of one number of parts above which they are not all solved
_EACH: Final = 1.0  # processor time of a layout that the batch solver does not settle, s
_FURTHER: Final = 600  # the same of more parts than the fewest
KEPT: Final = 40  # strongest layouts of each number of parts that are kept
_CHUNK: Final = 256  # layouts solved together
_MORE: Final = 3  # numbers of parts above the fewest that the front holds
_TURNS: Final = 12  # turns about each axis at which a box is tried


def frames(normals: Floats) -> Floats:
    """Return rotations (k, 3, 3) in which a part may lie in a box: along the axes, turned, and along cuts (c, 3)."""
    found = [np.eye(3)]
    for axis, turn in product(range(3), np.arange(1, _TURNS) * np.pi / (2 * _TURNS)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[i, i], one[i, j], one[j, i], one[j, j] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
        found.append(one)
    for first, second in product(normals[:_TURNS], repeat=2):
        across = np.cross(first, second)
        if np.linalg.norm(across) > 0.1:
            across /= np.linalg.norm(across)
            found.append(np.array([first, across, np.cross(first, across)]))
    # a long part lies along the diagonal of a box
    found.append(np.linalg.qr(np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]).T)[0].T)
    return np.array(found)


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
    def of(cls, points: list[Floats], moments: Floats, turned: Floats) -> Boxes:
        seen = [np.einsum("kij,cj->cki", turned, corners) for corners in points]
        return cls(np.array([one.min(axis=0) for one in seen]), np.array([one.max(axis=0) for one in seen]), moments)

    def grouped(self, groups: list[int]) -> Boxes:
        cells = [[e for e in range(len(self.low)) if one >> e & 1] for one in groups]
        low = np.array([self.low[own].min(axis=0) for own in cells])
        high = np.array([self.high[own].max(axis=0) for own in cells])
        return Boxes(low, high, np.array([self.moments[own].sum(axis=0) for own in cells]))

    def fit(self, low: Floats, high: Floats, limits: Limits) -> Any:
        """Return whether boxes (s, k, 3) of sets fit the limits in some frame, (s,)."""
        sides = np.sort(high - low, axis=-1)
        return (sides <= limits.fit * (1 + 1e-9)).all(axis=-1).any(axis=-1)


def connected_sets(boxes: Boxes, around: list[int], limits: Limits, together: list[int], until: float) -> list[int]:
    """Return all connected sets of cells within limits, none of which parts a set of `together`; none above `SETS`."""
    count = len(around)
    level, found = [1 << e for e in range(count)], list[int]()
    touched, low, high, volume = list(around), boxes.low, boxes.high, boxes.volume
    while level:
        good = boxes.fit(low, high, limits) & (volume <= limits.volume * (1 + 1e-9))
        rows = np.flatnonzero(good).tolist()
        found += [level[k] for k in rows]
        if len(found) > SETS or time.time() > until:
            return []
        grown: dict[int, tuple[int, int]] = {}
        for k in rows:
            left = touched[k] & ~level[k]
            while left:
                bit = left & -left
                left ^= bit
                grown.setdefault(level[k] | bit, (k, bit.bit_length() - 1))
        if len(grown) > 4 * SETS:
            return []
        parent, added = np.array(list(grown.values()), dtype=np.int64).reshape(-1, 2).T
        touched = [touched[k] | around[e] for k, e in zip(parent.tolist(), added.tolist(), strict=True)]
        level = list(grown)
        low, high = np.minimum(low[parent], boxes.low[added]), np.maximum(high[parent], boxes.high[added])
        volume = volume[parent] + boxes.volume[added]
    return [one for one in found if all(one & whole in (0, whole) for whole in together)]


def _joined(boxes: Boxes, around: list[int], limits: Limits) -> list[int]:
    # the smallest neighbours first; none for few cells
    groups = [1 << e for e in range(len(around))]
    if len(groups) <= GROUPS:
        return []
    while len(groups) > GROUPS:
        known = boxes.grouped(groups)
        near = _around(groups, around)
        pairs = [(a, b) for a, one in enumerate(near) for b in range(a) if one >> b & 1]
        first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        low, high = np.minimum(known.low[first], known.low[second]), np.maximum(known.high[first], known.high[second])
        volume = known.volume[first] + known.volume[second]
        fits = boxes.fit(low, high, limits) & (volume <= limits.volume * (1 + 1e-9))
        if not fits.any():
            break
        # of pairs alike the most compact one
        size = np.where(fits, np.round(volume / boxes.volume.sum(), 6) + 1e-9 * (high - low)[:, 0].sum(axis=-1), np.inf)
        a, b = pairs[int(np.argmin(size))]
        groups[b] |= groups.pop(a)
    return groups


def _around(groups: list[int], around: list[int]) -> list[int]:
    cells = [[e for e in range(len(around)) if one >> e & 1] for one in groups]
    reach = [int(np.bitwise_or.reduce(np.array([around[e] for e in own], dtype=object))) for own in cells]
    return [sum(1 << k for k, two in enumerate(groups) if k != j and one & two) for j, one in enumerate(reach)]


def _sets_of_groups(
    groups: list[int], boxes: Boxes, around: list[int], limits: Limits, together: list[int], until: float
) -> list[int]:
    found = connected_sets(boxes.grouped(groups), _around(groups, around), limits, [], until)
    sets = [sum(one for k, one in enumerate(groups) if name >> k & 1) for name in found]
    return [one for one in sets if all(one & whole in (0, whole) for whole in together)]


def covers(sets: list[int], count: int, parts: int) -> Iterator[list[int]]:
    """Yield all ways to choose so many disjoint sets that hold all cells."""
    holding = [[one for one in sets if one >> e & 1] for e in range(count)]
    order = sorted(range(count), key=lambda e: len(holding[e]))
    reach = [0] * count  # cells that may be in one part with this one
    for e, own in enumerate(holding):
        for one in own:
            reach[e] |= one

    @cache
    def fewest(left: int) -> int:
        """Return how many cells no two of which may be in one part are left, at least."""
        number = 0
        while left:
            e = min((e for e in order if left >> e & 1), key=lambda e: (reach[e] & left).bit_count())
            number, left = number + 1, left & ~reach[e]
        return number

    known, largest = set(sets), max(one.bit_count() for one in sets)

    def rest(left: int, parts: int) -> Iterator[list[int]]:
        checkpoint()
        if parts == 1:
            if left in known:
                yield [left]
            return
        if left.bit_count() > parts * largest or fewest(left) > parts:
            return
        e = next(e for e in order if left >> e & 1)
        for one in holding[e]:
            if not one & ~left and one != left:
                yield from ([one, *more] for more in rest(left & ~one, parts - 1))

    yield from rest((1 << count) - 1, parts)


@dataclass
class Layouts:
    """Layouts of the parts of one number that were solved, the strongest first."""

    complete: bool  # every layout was solved
    solved: int
    blocks: Ints  # (k, n) part of each cell
    low: Floats  # (k,) infinite where no load makes the layout collapse
    high: float  # no layout of the complete list carries more
    open: int = 0  # layouts without an upper bound that are not known to be locked


@dataclass
class Found:
    """What a search of all layouts found, by the number of parts."""

    of: dict[int, Layouts] = field(default_factory=dict)
    sets: int = 0
    problem: str = ""
    joined: bool = False  # cells were joined, since too many sets of them fit

    def proven(self, parts: int) -> bool:
        """Return whether all layouts of at most so many parts were solved, with proven bounds."""
        known = all(n in self.of and self.of[n].complete and not self.of[n].open for n in range(1, parts + 1))
        return known and not self.joined

    def bound(self, parts: int) -> float:
        """Return what no layout of at most so many parts exceeds; infinite where that is not known."""
        return max(self.of[n].high for n in range(1, parts + 1)) if self.proven(parts) else np.inf


@dataclass(frozen=True)
class Asked:
    """What parts must carry, how many they may be, and when a search ends: after layouts that carry, and without."""

    require: float
    most: int
    until: float
    last: float
    alike: int | None = None  # most different shapes of parts


class Bounds:
    """Bounds on λ of layouts by the parts of the first n elements; without crushing unless `crush`."""

    def __init__(self, document: dict[str, Any], *, crush: bool = False) -> None:
        kinds = {k: dict(v) if isinstance(v, dict) else v for k, v in document["materials"].items()}
        for kind in () if crush else ("dry", "inner"):
            kinds[kind].pop("compressive_strength", None)
        self.assembly = build_assembly(parse_scene(document | {"materials": kinds}))
        self.analysis = LimitAnalysis(self.assembly)

    def __call__(self, blocks: Ints) -> tuple[Floats, Floats, Bools]:
        """Return lower and upper bounds (k,) for parts (k, n), and where no load makes a layout collapse.

        Lower bounds are −inf where a layout is not proven to stand for some λ ≥ 0; upper ones are −inf where it falls
        by itself, and inf where nothing is proven.
        """
        labels, batch = labels_of(self.assembly, blocks), self.analysis.batch
        if batch is None:
            found = solve_many(self.assembly, labels, seconds=_EACH)
            status = np.array([str(one) for one in found.status])
            low, high, falls, locked = found.low, found.high, status == "unstable", status == "locked"
        else:
            raw, scale = batch.solve(labels), self.analysis.template.scaling.load
            low, high = scale * raw.low, scale * raw.high
            falls, locked = raw.verdict == batch_solver.FALLS, raw.verdict == batch_solver.LOCKED
        low = np.where(np.isfinite(low) & ~falls & (low >= 0.0), low, -np.inf)
        return low, np.where(falls, -np.inf, np.where(np.isfinite(high) & ~locked, high, np.inf)), locked


def labels_of(assembly: Assembly, blocks: Ints) -> Bits:
    """Return labels (k, m), True = dry, for parts (k, n) of the first n elements."""
    part = np.full((len(blocks), len(assembly.elements)), -1)
    part[:, : blocks.shape[1]] = blocks
    faces = assembly.interfaces
    return np.asarray(part[:, faces.a] != part[:, faces.b])


@one_thread()
def search(
    document: dict[str, Any],
    boxes: Boxes,
    around: list[int],
    limits: Limits,
    together: list[int],
    asked: Asked,
) -> Found:
    """Solve all layouts of the fewest parts that fit and carry, and of some more while time lasts."""
    require, count = asked.require * (1 - 1e-6), len(around)
    found, fewest = Found(), count + 1
    start = time.time()
    sets = connected_sets(boxes, around, limits, together, start + _LISTED * (asked.last - start))
    if not sets and time.time() < asked.last and (groups := _joined(boxes, around, limits)):
        found.joined, sets = True, _sets_of_groups(groups, boxes, around, limits, together, asked.last)
    found.sets = len(sets)
    if not sets:
        found.problem = "too many sets of cells fit the box" if time.time() < asked.last else "time ended"
        return found
    try:
        bounds = Bounds(document)
    except InputError as error:  # splinters may leave joints that no face bears out
        found.problem = str(error)
        return found

    @cache
    def kind(one: int) -> tuple[int, ...]:
        members = [k for k in range(count) if one >> k & 1]
        return kind_of(boxes.moments[members].sum(axis=0), float(boxes.volume.max()))

    for parts in range(1, min(asked.most, count) + 1):
        if parts > fewest + _MORE:
            break
        first, found_ways = parts < fewest, covers(sets, count, parts)
        if asked.alike is not None:
            found_ways = (way for way in found_ways if len({kind(one) for one in way}) <= (asked.alike or 0))
        ways, most, end = found_ways, *((LAYOUTS, asked.last) if first else (_FURTHER, asked.until))
        one = solved_layouts(ways, count, bounds, most, end)
        found.of[parts] = one
        if len(one.low) and one.low[0] >= require:
            fewest = min(fewest, parts)
        if time.time() > (asked.until if fewest <= count else asked.last):
            found.problem = "" if fewest <= count else "time ended"
            break
    return found


def solved_layouts(
    choices: Iterator[list[int]],
    count: int,
    solve: Callable[[Ints], tuple[Floats, Floats, Bools]],
    number: int,
    until: float,
) -> Layouts:
    """Return the strongest of at most so many layouts (sets of cells for each part), solved until the time ends."""
    bits = 1 << np.arange(count, dtype=object)
    blocks, low, high, solved, unknown = np.zeros((0, count), dtype=np.int64), np.zeros(0), -np.inf, 0, 0
    size = 8
    while True:
        try:
            with Deadline(max(0.1, until - time.time())).enforced():
                rows = list(islice(choices, size))
        except DeadlinePassed:
            return Layouts(False, solved, blocks, low, np.inf)
        if not rows:
            return Layouts(True, solved, blocks, low, high, unknown)
        if solved + len(rows) > number or (solved and time.time() > until):
            return Layouts(False, solved, blocks, low, np.inf)
        began = time.perf_counter()
        part = np.array([sum(k * ((one & bits) > 0).astype(int) for k, one in enumerate(row)) for row in rows])
        least, most, locked = solve(part.astype(np.int64))
        least = np.where(locked, np.inf, least)
        high, solved = max(high, float(most.max())), solved + len(rows)
        unknown += int((np.isposinf(most) & ~locked).sum())
        stands = least >= 0.0
        blocks, low = np.concatenate([blocks, part[stands]]), np.concatenate([low, least[stands]])
        best = np.argsort(-low, kind="stable")[:KEPT]
        blocks, low = blocks[best].astype(np.int64), low[best]
        size = int(np.clip(len(rows) / (time.perf_counter() - began), 8, _CHUNK))  # a second each
