"""Batch solver: proven bounds on λ for many labellings of one assembly, several in the SIMD lanes at once."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch import interface, library
from jld_core.batch.library import dry_shares, narrow, samples, tries_of
from jld_core.batch.rows import BatchRows, factor_pattern, pattern_of, rows_of
from jld_core.mechanics.yield_set import Rows
from jld_core.program import Template

_FATES: Final = interface.codes("JldFate")
REFUTED: Final = _FATES["REFUTED"]  # fate of a labelling that a mechanism refutes at its threshold
CARRIED: Final = _FATES["CARRIED"]  # fate of a labelling whose forces carry more than its threshold


@dataclass(frozen=True)
class MinimizationOptions:
    """Options of conflict minimisation: faces become undecided while λ is proven below the threshold."""

    # further minimisations per refuted labelling; each starts with one face of its conflict undecided
    neighbours: int = 0
    tries: int = 2  # number of single faces tried without success after which a conflict is accepted as minimal
    inner: bool = False  # True to make inner faces undecided before dry ones
    # equilibrium error (scaled) up to which forces that carry more than the threshold end a relaxation
    balance: float = 1e-6


@dataclass(frozen=True)
class ConflictRequest:
    """Labellings (k, m) whose conflicts are to be minimised, of the batch solver and of relaxations."""

    labellings: Bits
    free: Bools  # (m,) faces that may take either label
    thresholds: Floats  # (k,) λ to stay below, in the unit of the solver asked
    undecided: Bools | None = None  # (k, m) free faces that are undecided from the start
    how: MinimizationOptions = MinimizationOptions()
    seed: int = 0  # of the face that a neighbour leaves undecided

    def take(self, rows: Ints) -> ConflictRequest:
        undecided = None if self.undecided is None else self.undecided[rows]
        return replace(self, labellings=self.labellings[rows], thresholds=self.thresholds[rows], undecided=undecided)

    def in_units(self, unit: float) -> ConflictRequest:
        """Return the same request with thresholds divided by `unit`, a value of λ.

        For example, thresholds in scene units over `Scaling.load` are scaled.
        """
        return replace(self, thresholds=self.thresholds / unit)


@dataclass(frozen=True)
class MinimizationResults:
    """Minimised conflicts of k labellings, each followed by its neighbours: r = k · (1 + neighbours) rows."""

    labelling: Ints  # (r,) index of the labelling among the k
    fate: NDArray[np.uint8]  # (r,) 0 (open, or never begun), `REFUTED` or `CARRIED`
    decided: Bools  # (r, m) faces of the conflict, that is, the faces that stay decided
    velocity: Floats  # (r, q·free) velocities of the mechanism
    relaxations: NDArray[np.int32]  # (r,) number of relaxations solved


_VERDICTS: Final = interface.codes("JldVerdict")
OPEN: Final = _VERDICTS["OPEN"]  # verdict: nothing proven yet
PROVEN: Final = _VERDICTS["PROVEN"]  # verdict: both bounds are proven and the bracket is narrow
FALLS: Final = _VERDICTS["FALLS"]  # verdict: no λ ≥ 0 is admissible
CARRIES: Final = _VERDICTS["CARRIES"]  # verdict: λ is above its threshold
LOCKED: Final = _VERDICTS["LOCKED"]  # verdict: λ is unbounded


@dataclass(frozen=True)
class BatchResults:
    """Proven bounds on λ of k labellings, scaled."""

    # low, high: (k,) lower and upper bound on λ; infinite where there is none
    low: Floats
    high: Floats
    # (k,) `OPEN`; `PROVEN` (both bounds, a narrow bracket); `FALLS` (no λ ≥ 0 is admissible); `CARRIES` (λ above its
    # threshold); or `LOCKED` (λ is unbounded, proven by an admissible state and a ray)
    verdict: NDArray[np.int32]
    iterations: NDArray[np.int32]  # (k,) iterations of all passes
    tries: NDArray[np.int32]  # (k,) number of passes
    forces: Floats | None = None  # (k, m, q) forces of the lower bound; only with `vectors=True`, as all that follow
    velocity: Floats | None = None  # (k, q·free) velocities of the upper bound, in the order of the elements
    # (k, 4) slack, equilibrium error, margin of the jumps (before the opening motion is added) and gap at the last pass
    diagnosis: Floats | None = None
    rays: Floats | None = None  # (k, m, q) rays of `LOCKED` labellings, for λ = 1

    @property
    def velocities(self) -> Floats:
        """Return the velocities (k, q·free) of the upper bounds; raise ValueError without `vectors=True`."""
        if self.velocity is None:
            raise ValueError("the batch solver was asked for no velocities; solve with `vectors=True`")
        return self.velocity

    def take(self, rows: slice) -> BatchResults:
        fields: dict[str, Any] = {name: None if values is None else values[rows] for name, values in vars(self).items()}
        return BatchResults(**fields)

    @classmethod
    def joined(cls, results: Sequence[BatchResults]) -> BatchResults:
        lists = {name: [getattr(result, name) for result in results] for name in vars(results[0])}
        fields: dict[str, Any] = {}
        for name, values in lists.items():
            fields[name] = None if values[0] is None else np.concatenate(values)
        return cls(**fields)


_UNDECIDED: Final = interface.codes("JldLabel")["UNDECIDED"]  # label of a face that may be dry or inner
# Largest number of samples of one call: the values that a label of the compiled solver can take.
SAMPLES_OF_A_CALL: Final = 256

# Weight of the mean solution of random labellings at the start; the least-norm forces in equilibrium have the rest
_SHARE: Final = 0.7
_SLACK_UNSAMPLED: Final = 3.0  # least slack at the starting point without such a mean, scaled
_SLACK: Final = 1.0  # least slack at the starting point with such a mean, scaled
_LEAST_MULTIPLIER: Final = 1.0  # least multiplier at the starting point, planar, scaled
_LEAST_MULTIPLIER_SPATIAL: Final = 0.3  # least multiplier at the starting point, spatial, scaled


@dataclass(frozen=True)
class _Start:
    # forces, jumps: (m, q) resultants, and jumps of the velocities
    forces: Floats
    jumps: Floats
    velocity: Floats  # (q·free,) velocities, in the batch solver's order of elimination
    load: float  # load factor λ
    least_slack: float


class BatchSolver:
    """Batch solver for the labellings of one template; ValueError without a library or for unsupported rows (`fits`).

    opening: (q·free,) velocities that open every face. load_scale: scaled λ relative to which a bracket about zero is
    narrow. undecided: rows of undecided faces. sampled_start: start near the mean solution of random labellings, of
    which `settled_fraction` got a verdict; False: from least-norm forces, cheaper for a few labellings.
    """

    def __init__(
        self,
        template: Template,
        opening: Floats | None = None,
        *,
        load_scale: float = 0.0,
        undecided: Rows | None = None,
        variant: str | None = None,
        tries: Sequence[library.Try] = (),
        sampled_start: bool = True,
    ) -> None:
        name = variant or library.chosen()
        if name is None:
            raise ValueError("no kernel is built or in use")
        rows = rows_of(template, undecided)
        if rows is None:
            raise ValueError("rows of another shape than the kernel's")
        self.variant, self._library = name, library.library(name)
        self.faces, self.size = len(template.assembly.interfaces), template.structure.equalities
        self._q = q = template.assembly.freedoms
        self._rows, self._pairs, self._keep, self._parabolas = rows.rows, rows.pairs, rows.keep, rows.parabolas
        self._interacts = rows.interacts
        # Relaxations skip the correction of equilibrium that the settings for large assemblies need.
        self._relaxation_try = tries[0] if tries else tries_of(template.assembly.dimension, 0, parabolas=False)[0]
        self._tries = tuple(tries) or tries_of(template.assembly.dimension, self.faces, rows.parabolas is not None)
        self.pattern, a, b = pattern_of(template.assembly)
        self._lay_out(template, a, b)
        # rows of equilibrium in the order of elimination, by their numbers in the order of elements
        eliminated = np.concatenate([q * e + np.arange(q) for e in self.pattern.order]).astype(np.int64)
        self._element_rows = eliminated
        self._dead, self._live = template.dead[eliminated].copy(), template.live[eliminated].copy()
        self._loads_by_label = False
        self._opening = None if opening is None else opening[eliminated].copy()
        self._floor = template.floor
        self.settled_fraction, self._load_scale = 0.0, load_scale
        sampled = samples(2 if q == 3 else 3, self.faces) if sampled_start else 0
        self._start = self._starting(template, sampled)

    def _random_labellings(self, count: int) -> Bits:
        """Return labellings (count, faces) with shares of dry faces in `dry_shares`."""
        rng = np.random.default_rng(0)
        low, high = dry_shares(2 if self._q == 3 else 3, self.faces)
        return np.asarray(rng.random((count, self.faces)) < low + (high - low) * rng.random((count, 1)))

    def _starting(self, template: Template, samples_wanted: int) -> _Start:
        """Return the starting point of the iterations; store `_start` and `settled_fraction`."""
        # The point lies between the least-norm forces in equilibrium and the mean solution of `samples_wanted` random
        # labellings. Their solves start from `_start`, and set `settled_fraction`.
        matrix = self._matrix = template.matrix
        least_norm = -(matrix.T @ spsolve(matrix @ matrix.T, template.dead)).reshape(self.faces, self._q)
        finite = bool(np.isfinite(least_norm).all())
        self._sampled = samples_wanted if finite else 0
        self._least = np.ascontiguousarray(least_norm) if finite else np.zeros((self.faces, self._q))
        zeros = np.zeros(self.size)
        self._start = _Start(self._least, np.zeros((self.faces, self._q)), zeros, 0.0, _SLACK_UNSAMPLED)
        return self._between_samples() if self._sampled else self._start

    def _between_samples(self) -> _Start:
        """Return the start near the mean solution of samples, the present one without any."""
        answers = self.solve(self._random_labellings(self._sampled), vectors=True)
        proven = answers.verdict == PROVEN
        self.settled_fraction = float((answers.verdict != OPEN).mean())
        if not proven.any() or answers.forces is None or answers.velocity is None:
            return self._start
        forces = (1.0 - _SHARE) * self._least + _SHARE * answers.forces[proven].mean(axis=0)
        velocity = answers.velocity[proven].mean(axis=0)
        jumps = np.ascontiguousarray((self._matrix.T @ velocity).reshape(self.faces, self._q))
        return _Start(forces, jumps, velocity[self._element_rows], _SHARE * float(answers.low[proven].mean()), _SLACK)

    def _lay_out(self, template: Template, a: Ints, b: Ints) -> None:
        """Store ends, matrix block and equilibrium entries of each face, in elimination order."""
        rank = np.full(len(self.pattern.order) + 1, -1, dtype=np.int64)
        rank[self.pattern.order] = np.arange(len(self.pattern.order))
        a, b = rank[a], rank[b]  # −1 stays −1
        # supports have index −1, so the free element of such an interface comes first
        swap = (a < 0) | ((b >= 0) & (b < a))
        low, high = np.where(swap, b, a), np.where(swap, a, b)
        self._low, self._high = low.astype(np.int32), high.astype(np.int32)
        starts, rows = self.pattern.column_start, self.pattern.row
        blocks = np.full(self.faces, -1, dtype=np.int32)
        for face in np.flatnonzero((low >= 0) & (high >= 0)).tolist():
            first, end = starts[low[face]], starts[low[face] + 1]
            blocks[face] = first + np.searchsorted(rows[first:end], high[face])
        self._block = blocks
        q, d = self._q, template.assembly.dimension
        matrix = template.matrix.tocoo()
        column = matrix.col // q
        side = (rank[matrix.row // q] == high[column]).astype(int)
        dense = np.zeros((self.faces, 2, q, q))
        dense[column, side, matrix.row % q, matrix.col % q] = matrix.data
        sides = dense[..., :d].reshape(self.faces, 2, -1), dense[..., d:, d:].reshape(self.faces, 2, -1)
        self._sides = np.ascontiguousarray(np.concatenate(sides, axis=2))

    def solve(
        self,
        labellings: Bits | NDArray[np.uint8],
        *,
        undecided: Bools | None = None,
        thresholds: Floats | None = None,
        vectors: bool = False,
    ) -> BatchResults:
        """Compute bounds on λ of labellings (k, m), each by its own alone, until above thresholds (k,).

        vectors: return forces, velocities, rays and the diagnosis as well.
        """
        labels = np.ascontiguousarray(labellings, dtype=np.uint8)
        if undecided is not None:
            labels = np.where(undecided, np.uint8(_UNDECIDED), labels)
        limits = None if thresholds is None else np.ascontiguousarray(thresholds, dtype=float)
        count = len(labels)
        low, high = np.empty(count), np.empty(count)
        verdict, iterations, tries = (np.zeros(count, dtype=np.int32) for _ in range(3))
        forces = np.zeros((count, self.faces, self._q)) if vectors else None
        velocity = np.zeros((count, self.size)) if vectors else None
        diagnosis = np.zeros((count, 4)) if vectors else None
        rays = np.zeros((count, self.faces, self._q)) if vectors else None
        problem = self._problem()
        settings = (library.Try * len(self._tries))(*self._tries)
        inputs = library.pointers(labels=labels, thresholds=limits)
        outputs = library.pointers(low=low, high=high, verdict=verdict, iterations=iterations, tries=tries)
        vectors_out = library.pointers(forces=forces, velocity=velocity, diagnosis=diagnosis, rays=rays)
        outcome = self._library.jld_solve(
            problem,
            settings,
            len(self._tries),
            count,
            inputs["labels"],
            inputs.get("thresholds"),
            library.Answers(**outputs, **vectors_out),
        )
        library.require_success(outcome)
        if velocity is not None:
            velocity = self._as_elements(velocity)
        return BatchResults(low, high, verdict, iterations, tries, forces, velocity, diagnosis, rays)

    def solve_samples(
        self, rows: BatchRows, dead: Floats, live: Floats, thresholds: Floats | None, *, vectors: bool = False
    ) -> BatchResults:
        """Compute bounds on λ of one labelling for scaled samples of strengths and loads (k, q·free)."""
        copied = copy(self)
        copied._rows, copied._keep, copied._parabolas = rows.rows, rows.keep, rows.parabolas
        copied._dead, copied._live = (np.ascontiguousarray(loads[:, self._element_rows]) for loads in (dead, live))
        copied._loads_by_label = True
        label = np.arange(len(dead), dtype=np.uint8)  # the compiled solver looks rows and loads up by label
        return copied.solve(np.repeat(label[:, None], self.faces, axis=1), thresholds=thresholds, vectors=vectors)

    def reversed(self, *, sampled: bool = False) -> BatchSolver:
        """Return a solver under the opposite live load; sampled: begun at samples, else slower."""
        copied = copy(self)
        copied._live = -self._live
        zeros = np.zeros((self.faces, self._q))
        copied._start = replace(self._start, jumps=zeros, velocity=np.zeros(self.size), load=0.0)
        if sampled and self._sampled:
            copied._start = copied._between_samples()
        return copied

    def minimize_conflicts(self, request: ConflictRequest) -> MinimizationResults:
        # A conflict keeps as few faces decided as still prove λ below the threshold. The fate `REFUTED` is a hint: the
        # caller must verify the work balance of the mechanism, docs/method.md (6.4).
        count, options = len(request.labellings), request.how
        start = request.labellings
        if request.undecided is not None:
            start = np.where(request.undecided & request.free, np.uint8(_UNDECIDED), start)
        labels, free = (np.ascontiguousarray(array, dtype=np.uint8) for array in (start, request.free))
        thresholds = np.ascontiguousarray(request.thresholds, dtype=float)
        rows = count * (1 + options.neighbours)
        fate, relaxations = np.zeros(rows, dtype=np.uint8), np.zeros(rows, dtype=np.int32)
        conflict, velocity = np.zeros((rows, self.faces), dtype=np.uint8), np.zeros((rows, self.size))
        inputs = library.pointers(labels=labels, free=free, thresholds=thresholds)
        outputs = library.pointers(fate=fate, conflict=conflict, velocity=velocity, relaxations=relaxations)
        task = library.MinimizationOptions(
            count=count,
            neighbours=options.neighbours,
            tries=options.tries,
            inner=int(options.inner),
            balance=options.balance,
            seed=request.seed,
            **inputs,
            **outputs,
        )
        library.require_success(self._library.jld_minimize(self._problem(), self._relaxation_try, task))
        labelling = np.arange(count).repeat(1 + options.neighbours)
        return MinimizationResults(labelling, fate, conflict.astype(bool), self._as_elements(velocity), relaxations)

    def _as_elements(self, velocity: Floats) -> Floats:
        """Reorder velocities (k, q·free) from the order of elimination to that of elements."""
        by_element = np.empty_like(velocity)
        by_element[:, self._element_rows] = velocity
        return by_element

    def _problem(self) -> library.Problem:
        # The structure points to arrays of this solver, and is valid while the solver exists.
        start = self._start
        arrays = library.pointers(
            low=self._low,
            high=self._high,
            block=self._block,
            sides=self._sides,
            rows=self._rows,
            keep=self._keep,
            dead=self._dead,
            live=self._live,
            opening=self._opening,
            forces=start.forces,
            jumps=start.jumps,
            velocity=start.velocity,
            parabolas=self._parabolas,
        )
        return library.Problem(
            elements=len(self.pattern.order),
            faces=self.faces,
            pairs=self._pairs,
            labels=len(self._rows),
            freedoms=self._q,
            drops_shear=int(not self._keep.all()),
            pattern=self.pattern.as_ctypes(),
            floor=self._floor,
            noise=tolerances.ROUNDING,
            load=start.load,
            least_slack=start.least_slack,
            least_multiplier=_LEAST_MULTIPLIER if self._q == 3 else _LEAST_MULTIPLIER_SPATIAL,
            zero=self._load_scale,
            gap=tolerances.GAP,
            coupled=int(self._interacts),
            narrow=int(narrow(2 if self._q == 3 else 3, self.faces)),
            own_loads=int(self._loads_by_label),
            **arrays,
        )


SOLVED: Final = interface.codes("JldBlockState")["SOLVED"]
"""State of a choice whose multipliers are accurate enough to give a bound (`BlockAnswers.state`)."""

_Q: Final = 3  # shared rows of one node
_GAP: Final = 1e-5  # relative gap at which iterations end; the bounds are only compared with one another
_NEAR: Final = 1e-4  # relative distance of λ from its threshold below which `_FINE` replaces `_GAP`
_FINE: Final = 1e-8  # relative gap at which iterations end close to the threshold
_MULTIPLIER_ERROR: Final = 1e-6  # error of multipliers at which iterations end; the caller repairs what remains

# Largest number of iterations of one choice from the common starting point: 15 to 30 were measured for walls. After 50
# the bound of 16 000 sides is 2e-3 above λ, that of 74 000 sides 7e-2, which takes 100 to close.
_MOST: Final = 80


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
        pairs = {pair for block in blocks for pair in combinations(np.unique(block.shared // _Q).tolist(), 2)}
        a, b = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2).T
        self.pattern = pattern = factor_pattern(a, b, places)
        rank = np.empty(nodes, dtype=np.int64)
        rank[pattern.order] = np.arange(nodes)
        self._sorted_rows = (_Q * rank[:, None] + np.arange(_Q)).ravel()  # of each shared row in order of elimination
        entries = [column for block in blocks for column in block.columns]
        self._arrays: dict[str, Any] = {
            "own_start": _starts([block.own for block in blocks]),
            "shared_start": _starts([len(block.shared) for block in blocks]),
            "shared": _flat([self._sorted_rows[block.shared] for block in blocks]),
            "column_start": _starts([len(block.columns) for block in blocks]),
            "entry_start": _starts([len(rows) for rows, _ in entries]),
            "entry_row": _flat([rows for rows, _ in entries]),
            "entry": np.concatenate([values for _, values in entries]),
            "of_x": np.concatenate([block.of_x for block in blocks]),
            "of_load": np.concatenate([block.of_load for block in blocks]),
        }
        positions = [self._product_positions(self._sorted_rows[block.shared]) for block in blocks]
        self._arrays |= {"place_start": _starts([len(part) for part in positions]), "place": _flat(positions)}
        sorted_rhs = np.zeros(_Q * nodes)
        sorted_rhs[self._sorted_rows] = rhs
        self._rhs, self._load = sorted_rhs, self._sorted_rows[load].astype(np.int32)
        self._own_rows, self._shared_rows = int(self._arrays["own_start"][-1]), _Q * nodes

    @staticmethod
    def supports(blocks: Sequence[BlockColumns]) -> bool:
        """Return True if no block has more rows than the compiled solver can hold."""
        return max((block.own + len(block.shared) for block in blocks), default=0) <= interface.BLOCK_ROWS

    def _product_positions(self, rows: Ints) -> Ints:
        """Return the factor positions of products of shared rows (r,); −1 − position off the diagonal blocks."""
        starts, nodes = self.pattern.column_start, len(self.pattern.order)
        first, second = np.tril_indices(len(rows))
        (high, r), (low, c) = (divmod(choose(rows[first], rows[second]), _Q) for choose in (np.maximum, np.minimum))
        keys = np.repeat(np.arange(nodes), np.diff(starts)) * nodes + self.pattern.row
        block = np.searchsorted(keys, low * nodes + high)
        return np.asarray(np.where(high == low, 6 * high + r * (r + 1) // 2 + c, -1 - (9 * block + 3 * r + c)))

    def solve(self, allowed: Bools, thresholds: Floats, least: Floats, most: Floats) -> BlockAnswers:
        """Solve the programs of choices (k, p), least ≤ λ ≤ most (k,), until λ stays below thresholds (k,)."""
        count = len(allowed)
        allowed_bytes = np.ascontiguousarray(allowed, dtype=np.uint8)
        dual = np.zeros((count, self._own_rows + self._shared_rows))
        share, load = np.zeros((count, self._blocks)), np.zeros(count)
        iterations, state = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.uint8)
        problem = library.Blocks(
            blocks=self._blocks,
            nodes=len(self.pattern.order),
            pattern=self.pattern.as_ctypes(),
            loads=len(self._load),
            **library.pointers(**self._arrays, rhs=self._rhs, load=self._load),
        )
        bounds = {"thresholds": thresholds, "least_load": least, "most_load": most}
        inputs = {name: np.ascontiguousarray(values, dtype=float) for name, values in bounds.items()}
        task = library.BlockTask(
            count=count,
            gap=_GAP,
            near=_NEAR,
            fine_gap=_FINE,
            error=_MULTIPLIER_ERROR,
            iterations=_MOST,
            **library.pointers(allowed=allowed_bytes, **inputs),
            **library.pointers(dual=dual, share=share, load=load, iterations_used=iterations, state=state),
        )
        library.require_success(self._library.jld_solve_blocks(problem, task))
        shared = dual[:, self._own_rows :][:, self._sorted_rows]
        return BlockAnswers(dual[:, : self._own_rows], shared, share, load, iterations, state)


def _starts(counts: Sequence[int]) -> NDArray[np.int32]:
    """Return where each of several consecutive ranges starts, then where the last one ends."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)


def _flat(lists: Sequence[Ints]) -> NDArray[np.int32]:
    return np.concatenate(list(lists)).astype(np.int32)
