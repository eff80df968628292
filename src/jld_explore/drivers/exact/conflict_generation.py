"""Draw labellings from a formula in batches, refute them and minimise the conflicts, docs/method.md (6.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Bits, Bools, Floats
from jld_core.batch.batch_solver import ConflictRequest, MinimizationOptions
from jld_core.limit.mechanism import DualBound, MinimizedConflict
from jld_explore.drivers.exact.context import SEED_STEP, PartialLabellingRelaxation, ProofContext
from jld_explore.drivers.exact.formula import EVERYTHING, Cube, Formula
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism

_WIDTHS: Final = (1, 2, 3)  # widths of windows in slabs, tried in this order
_LEAST_SLABS: Final = 5  # least number of slabs of a structure for which windows are used
_LEAST_SHARE: Final = 0.1  # share of labellings refuted in windows of one width below which that width is skipped
_RETRY_INTERVAL: Final = 20  # A skipped width is still tried once in this number of times
_DECAY: Final = 0.9  # weight of the earlier average when the share of refuted labellings is updated


def windows_of(assembly: Assembly) -> tuple[Bits, ...]:
    """Return the windows (w, m) of each width, True where a face touches; none for few slabs."""
    # conflicts of faces close together share faces, so few of them exclude all labellings of a window
    # (benchmarks/results/exact.md).
    # A window is a run of 1, 2 or 3 neighbouring slabs of the elements along the longest axis. A labelling that a
    # window alone refutes gives a small conflict.
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    low, high = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    size: Floats = high - low
    axis = int(size.argmax())
    # number of cells in a row, if all were alike
    count = round(float(len(free) * np.prod(size[axis] / size)) ** (1.0 / len(size)))
    if count < _LEAST_SLABS:
        return ()
    slab = np.full(len(elements), -1)
    along = (elements.centroid[free, axis] - low[axis]) / size[axis]
    slab[free] = np.clip((count * along).astype(int), 0, count - 1)
    windows = []
    for width in _WIDTHS:
        members = [(slab >= first) & (slab < first + width) for first in range(count - width + 1)]
        windows.append(np.array([inside[faces.a] | inside[faces.b] for inside in members]))
    return tuple(windows)


class WindowStatistics:
    """Running share of labellings that windows of each width refute; poor widths are tried rarely."""

    def __init__(self, widths: int) -> None:
        self._share, self._times_skipped = np.ones(widths), np.zeros(widths, dtype=int)

    def is_worthwhile(self, width: int) -> bool:
        """Return whether windows of a width should be tried now; each call counts."""
        if self._share[width] >= _LEAST_SHARE:
            return True
        self._times_skipped[width] = (self._times_skipped[width] + 1) % _RETRY_INTERVAL
        return bool(self._times_skipped[width] == 0)

    def record(self, width: int, share: float) -> None:
        """Record the share, 0 to 1, of labellings that windows of a width refuted."""
        self._share[width] = _DECAY * self._share[width] + (1.0 - _DECAY) * share


# Single faces tried without success before a conflict is accepted. Faces are tried in the order of their cost to the
# excess, least first.
_FAILED_TRIES: Final = 2


def conflict_of(
    relaxation: PartialLabellingRelaxation,
    labels: Bits,
    candidates: Bools,
    threshold: float,
    tries: int = _FAILED_TRIES,
    decided: Bools | None = None,
) -> Conflict | None:
    """Find few labels, of those `decided`, that prevent a λ of a labelling (m,); None where it may reach it."""
    decided = candidates.copy() if decided is None else decided.copy()

    def refutation(complete: bool = False) -> DualBound | None:
        # A complete labelling that is not refuted needs an evaluation, so only then is the relaxation solved
        # thoroughly.
        undecided, thorough = candidates & ~decided, np.array([complete])
        return relaxation.refute_all(labels[None], undecided[None], np.array([threshold]), thorough)[0]

    mechanism = refutation(complete=True)
    if mechanism is None:
        return None
    tried: set[int] = set()
    failed = 0
    while True:
        # the decided faces by the rise of the bound if one becomes undecided, least first
        faces = np.flatnonzero(decided)
        order = np.asarray(faces[np.argsort(mechanism.cost[faces], kind="stable")])
        # free all faces whose total cost is below the excess of the current mechanism
        freed = order[np.cumsum(mechanism.cost[order]) < mechanism.excess]
        if freed.size:
            decided[freed] = False
            weaker = refutation()
            if weaker is None:
                # the previous mechanism proves this conflict whatever the next solve gives
                return _conflict(labels, decided, threshold, mechanism)
            mechanism = weaker
            continue
        bound = min(mechanism.bound, threshold)
        face = next((f for f in order.tolist() if f not in tried), None)
        if face is None or failed >= tries:
            return _conflict(labels, decided, bound, mechanism)
        tried.add(face)
        decided[face] = False
        weaker = refutation()
        if weaker is None:
            decided[face] = True
            failed += 1
        else:
            mechanism = weaker


def _conflict(labels: Bits, decided: Bools, bound: float, mechanism: DualBound) -> Conflict:
    faces = np.flatnonzero(decided)
    return Conflict(faces, labels[faces], bound, mechanism=Mechanism(mechanism.case, mechanism.velocity))


_BATCH_SIZE: Final = 8  # largest number of labellings drawn per batch

# Number of neighbours of each labelling that are minimised too. Neighbours are used once `_BATCH_SIZE` conflicts of the
# formula are known.
_NEIGHBOURS: Final = 3

# Largest number of neighbours minimised per labelling in a window. Every window that refutes a labelling counts
# separately.
_WINDOW_NEIGHBOURS: Final = 1
_TRIES: Final = 4  # single faces tried without success before a conflict is accepted as minimal
_INNER_FIRST: Final = True  # try inner faces first when minimising a conflict (25 % fewer conflicts on weak walls)
_DRY_PROBABILITY: Final = 0.3  # probability that a drawn labelling prefers a face dry; long blocks are hard to refute


@dataclass
class ConflictBatch:
    conflicts: list[Conflict] = field(default_factory=list)  # conflicts found
    unrefuted: list[Bits] = field(default_factory=list)  # labellings that no mechanism refutes, True = dry
    exhausted: bool = False  # whether no labelling is left, in the cube if one was given


class ConflictGenerator:
    """Generator of conflicts for one formula after another, to which it adds them."""

    def __init__(self, context: ProofContext, number: int = 0) -> None:
        # similar labellings would give the same conflicts: each is drawn with random preferred labels, and its
        # neighbours have one face of its conflict undecided
        self._relaxation, self._free = context.relaxation, context.free
        self._rng = np.random.default_rng([context.seed + SEED_STEP * number, 2])
        self._batched = context.relaxation.batched
        self._formula: Formula | None = None
        self._conflict_keys: set[tuple[bytes, bytes]] = set()
        self._take_in_others: Callable[[], None] = _nothing
        self._windows: tuple[Bits, ...] = ()
        self._statistics = WindowStatistics(0)

    @property
    def formula(self) -> Formula:
        """Formula of the labellings that are left; RuntimeError before `begin`."""
        if self._formula is None:
            raise RuntimeError("there is no formula yet; call `begin` first")
        return self._formula

    def begin(self, formula: Formula, take_in_others: Callable[[], None] | None = None) -> None:
        self._formula, self._take_in_others = formula, take_in_others or _nothing
        self._conflict_keys = set()
        # Small blocks are refuted by cracks through the whole structure, so windows delay the proof: walls take 50 %
        # longer.
        self._windows = windows_of(formula.space.assembly) if self._batched and formula.blocks is None else ()
        self._statistics = WindowStatistics(len(self._windows))

    def step(self, threshold: float, cube: Cube = EVERYTHING) -> ConflictBatch:
        """Draw labellings that the formula leaves, and return conflicts that refute them."""
        batch = ConflictBatch()
        self.formula.raise_threshold(threshold)
        drawn = self._draw(cube)
        batch.exhausted = not len(drawn)
        if len(drawn) and self._batched:
            self._add_results(drawn, threshold, self._minimize(drawn, threshold), batch)
        elif len(drawn):
            self._minimize_one(drawn[0], threshold, batch)
        return batch

    def _draw(self, cube: Cube) -> Bits:
        """Draw labellings (k, m) from the formula; return (0, m) where none is left."""
        formula = self.formula
        # The first batches are small: where one conflict rules out nearly all labellings, more draws are wasted.
        draws = min(_BATCH_SIZE, 1 + len(self._conflict_keys)) if self._batched else 1
        drawn: list[Bits] = []
        while len(drawn) < draws:
            self._take_in_others()
            labels = formula.next(cube.faces, cube.labels, preferred=self._preferred())
            if labels is None:
                break
            # The labelling is set aside while it is processed. Its conflict will rule out the labelling and more.
            formula.set_aside(np.arange(len(labels)), labels)
            drawn.append(labels)
        return np.array(drawn, dtype=bool).reshape(len(drawn), len(self._free))

    def _options(self) -> tuple[MinimizationOptions, int]:
        options = MinimizationOptions(
            neighbours=_NEIGHBOURS if len(self._conflict_keys) >= _BATCH_SIZE else 0, tries=_TRIES, inner=_INNER_FIRST
        )
        return options, int(self._rng.integers(2**32))

    def _minimize(self, drawn: Bits, threshold: float) -> list[MinimizedConflict]:
        """Minimise labellings (k, m) in the narrowest windows that refute them, else as a whole."""
        options, seed = self._options()
        open_rows, conflicts = np.arange(len(drawn)), list[MinimizedConflict]()
        in_window = replace(options, neighbours=min(options.neighbours, _WINDOW_NEIGHBOURS))
        for width, windows in enumerate(self._windows):
            if not open_rows.size or not self._statistics.is_worthwhile(width):
                continue
            # every labelling in every window
            labelling, outside = np.repeat(open_rows, len(windows)), np.tile(~windows, (len(open_rows), 1))
            limits = np.full(len(labelling), threshold)
            minimized = self._relaxation.minimize_conflicts(
                ConflictRequest(drawn[labelling], self._free, limits, outside, in_window, seed)
            )
            refuted = [
                replace(conflict, labelling=int(labelling[conflict.labelling]))
                for conflict in minimized
                if conflict.bound is not None
            ]
            conflicts += refuted
            unrefuted = np.setdiff1d(open_rows, [conflict.labelling for conflict in refuted])
            self._statistics.record(width, 1.0 - len(unrefuted) / len(open_rows))
            open_rows = unrefuted
        if open_rows.size:
            limits = np.full(len(open_rows), threshold)
            request = ConflictRequest(drawn[open_rows], self._free, limits, how=options, seed=seed)
            whole_layouts = self._relaxation.minimize_conflicts(request)
            conflicts += [replace(conflict, labelling=int(open_rows[conflict.labelling])) for conflict in whole_layouts]
        return conflicts

    def _add_results(
        self, drawn: Bits, threshold: float, minimized: list[MinimizedConflict], batch: ConflictBatch
    ) -> None:
        """Add conflicts and unrefuted labellings of `drawn` (k, m); minimise open ones singly."""
        open_rows = set(range(len(drawn)))
        for result in minimized:
            labels = drawn[result.labelling]
            if result.bound is not None and result.velocity is not None:
                faces, mechanism = np.flatnonzero(result.decided), Mechanism(result.case, result.velocity)
                bound = min(result.bound, threshold)
                self._add_conflict(Conflict(faces, labels[faces], bound, mechanism=mechanism), batch)
                open_rows.discard(result.labelling)
            elif result.drawn and result.carries:
                batch.unrefuted.append(labels)
                open_rows.discard(result.labelling)
        # Labellings that the batch solver leaves open go to the conic solver, because otherwise each needs an
        # evaluation.
        for number in sorted(open_rows):
            self._minimize_one(drawn[number], threshold, batch)

    def _minimize_one(self, labels: Bits, threshold: float, batch: ConflictBatch) -> None:
        """Minimise one labelling (m,) without the batch solver, and add the result to the batch."""
        conflict = conflict_of(self._relaxation, labels, self._free, threshold)
        if conflict is None:
            batch.unrefuted.append(labels)
        else:
            self._add_conflict(conflict, batch)

    def _add_conflict(self, conflict: Conflict, batch: ConflictBatch) -> None:
        key = conflict.key
        if key not in self._conflict_keys:
            self._conflict_keys.add(key)
            batch.conflicts.append(conflict)
            self.formula.forbid(conflict.faces, conflict.labels, conflict.bound)

    def _preferred(self) -> Bits | None:
        """Return random preferred labels (m,), True = dry; None without the batch solver."""
        if not self._batched:
            return None
        return self._rng.random(len(self.formula.space.fixed)) < _DRY_PROBABILITY


def _nothing() -> None: ...
