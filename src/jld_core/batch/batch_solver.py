"""Many labellings of one assembly at once, in the lanes of a register: both bounds on λ, proven as ever.

The batch solver takes rows from the yield sets of a template and states none itself. What it leaves open is for the
routes that take one labelling at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.batch import library
from jld_core.batch.conflict_request import ConflictRequest, MinimizationResults
from jld_core.batch.rows import pattern_of, rows_of
from jld_core.mechanics import Rows
from jld_core.program import Template

OPEN: Final = 0
PROVEN: Final = 1
FALLS: Final = 2
CARRIES: Final = 3
LOCKED: Final = 4
"""Verdicts, as `JldVerdict` of source/problem.h numbers them."""

_FIRST: Final[dict[str, float]] = {
    "proximal": 1e-5,
    "margin": 1e-10,
    "target": 1e-8,
    "active": 1e-4,
    "first": 0.95,
    "last": 0.99,
    "near": 0.1,
    "relax": 1e-3,
    "jumps": 1e-8,
    "aim": 1.0,
    "press": 0.0,
    "endless": 1e300,
}
TRIES: Final = (
    library.Try(**_FIRST | {"endless": 1e4}, most=28),
    library.Try(**_FIRST | {"aim": -1.0, "press": 1e-2}, most=28),
    library.Try(**_FIRST | {"aim": 0.0, "target": 1e-6, "margin": 0.0}, most=28),
    library.Try(**_FIRST | {"proximal": 1e-6, "margin": 1e-11, "active": 1e-5, "first": 0.9, "jumps": 1e-9}, most=40),
    library.Try(**_FIRST | {"proximal": 1e-4, "margin": 1e-9, "active": 1e-3, "first": 0.9, "near": 1e-4}, most=60),
)
"""Settings of the passes over what is still open, planar: what runs away is tried for a ray, the rest for a state at
the edge. Source: measured, see benchmarks/lanes.py."""

SPATIAL_TRIES: Final = tuple(
    library.Try(**_FIRST | {"target": 3e-8, "jumps": 1e-7, "near": 1e-2} | more)
    for more in (
        {"endless": 1e4, "most": 28},
        {"aim": -1.0, "press": 1e-2, "most": 28},
        {"proximal": 1e-6, "margin": 1e-11, "first": 0.9, "most": 40},
        {"proximal": 1e-4, "most": 60},
    )
)
"""The same in space, where edges of cones are left to others."""

_UNDECIDED: Final = 2
_SAMPLES: Final = 32  # labellings whose mean is where others start
_SHARE: Final = 0.7  # of that mean; the rest is the least forces in equilibrium
_ROOM_BLIND: Final = 3.0  # least slack at the start where no such mean is known
_ROOM: Final = 1.0
_PUSH: Final = 1.0  # least multiplier there
_PUSH_SPATIAL: Final = 0.3


@dataclass(frozen=True)
class _Start:
    """Forces and jumps (m, q), velocities (q·free,) in the batch solver's order, λ, and the least slack of a row."""

    forces: Floats
    jumps: Floats
    speed: Floats
    load: float
    room: float


@dataclass(frozen=True)
class BatchResults:
    """What is proven of k labellings, scaled.

    low, high: (k,) bounds on λ, infinite where there is none. verdict: (k,) OPEN, PROVEN (both bounds, a narrow
    bracket), FALLS (no λ ≥ 0 is admissible), CARRIES (λ above its threshold) or LOCKED (λ without end: a state and a
    ray). iterations, tries: (k,) what it took. forces (k, m, q) and velocity (k, q·free) belong to the bounds and rays
    (k, m, q), for λ = 1, to what is locked, where asked for. diagnosis: (k, 4) slack, error, margin and gap at the last
    try.
    """

    low: Floats
    high: Floats
    verdict: NDArray[np.int32]
    iterations: NDArray[np.int32]
    tries: NDArray[np.int32]
    forces: Floats | None = None
    velocity: Floats | None = None
    diagnosis: Floats | None = None
    rays: Floats | None = None


class BatchSolver:
    """The batch solver for one template.

    template: its yield sets in pairs of linear rows, in space edges of hulls and one cone of shear a face. opening:
    (q·free,) velocities that open every face under any labelling, None where there are none. zero: scaled λ beside
    which a bracket around zero may be narrow. undecided: rows of faces whose label is not decided, in the place of
    those of dry ones. variant: see `library`; default the one in use. tries: settings of the passes over what is still
    open. drawn: iterations start near the answers of a few random labellings, whose share that is settled `settles`
    tells; else, for a few labellings alone, near the least forces in equilibrium.
    Raises ValueError where the template's rows have not the batch solver's shape (ask `fits` first).
    """

    def __init__(
        self,
        template: Template,
        opening: Floats | None = None,
        *,
        zero: float = 0.0,
        undecided: Rows | None = None,
        variant: str | None = None,
        tries: Sequence[library.Try] = (),
        drawn: bool = True,
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
        self._rows, self._pairs, self._keep, self._bows = rows.rows, rows.pairs, rows.keep, rows.bows
        self._meets = rows.meets
        usual = TRIES if template.assembly.dimension == 2 else SPATIAL_TRIES
        if rows.bows is not None:
            usual = tuple(one for one in usual if one.aim > 0.0)  # edges and rays of parabolas are left to others
        chosen_tries = tries or usual
        self._tries = tuple(chosen_tries)
        self.pattern, a, b = pattern_of(template.assembly)
        self._lay_out(template, a, b)
        ends = np.concatenate([q * e + np.arange(q) for e in self.pattern.order]).astype(np.int64)
        self._ends = ends
        self._dead, self._live = template.dead[ends].copy(), template.live[ends].copy()
        self._opening = None if opening is None else opening[ends].copy()
        self._floor = template.floor
        self.settles, self._zero = 0.0, zero
        self._start = self._starting(template, drawn)

    def _starting(self, template: Template, sampled: bool) -> _Start:
        """Where iterations start: between the least forces in equilibrium and the mean answer of a few labellings."""
        matrix = template.matrix
        least = -(matrix.T @ spsolve(matrix @ matrix.T, template.dead)).reshape(self.faces, self._q)
        nothing = np.zeros(self.size)
        self._start = _Start(np.ascontiguousarray(least), np.zeros((self.faces, self._q)), nothing, 0.0, _ROOM_BLIND)
        if not np.isfinite(least).all():
            self._start = replace(self._start, forces=np.zeros((self.faces, self._q)))
            return self._start
        if not sampled:
            return self._start
        dice = np.random.default_rng(0)
        drawn = dice.random((_SAMPLES, self.faces)) < dice.random((_SAMPLES, 1))
        found = self.solve(drawn, vectors=True)
        good = found.verdict == PROVEN
        self.settles = float((found.verdict != OPEN).mean())
        if not good.any() or found.forces is None or found.velocity is None:
            return self._start
        forces = (1.0 - _SHARE) * least + _SHARE * found.forces[good].mean(axis=0)
        speed = found.velocity[good].mean(axis=0)
        jumps = np.ascontiguousarray((matrix.T @ speed).reshape(self.faces, self._q))
        return _Start(forces, jumps, speed[self._ends], _SHARE * float(found.low[good].mean()), _ROOM)

    def _lay_out(self, template: Template, a: Ints, b: Ints) -> None:
        place = np.full(len(self.pattern.order) + 1, -1, dtype=np.int64)
        place[self.pattern.order] = np.arange(len(self.pattern.order))
        a, b = place[a], place[b]  # −1 stays −1
        # a support is nobody's: the free side stands first
        swap = (a < 0) | ((b >= 0) & (b < a))
        low, high = np.where(swap, b, a), np.where(swap, a, b)
        self._low, self._high = low.astype(np.int32), high.astype(np.int32)
        starts, rows = self.pattern.column_start, self.pattern.row
        block = np.full(self.faces, -1, dtype=np.int32)
        for face in np.flatnonzero((low >= 0) & (high >= 0)).tolist():
            begin, end = starts[low[face]], starts[low[face] + 1]
            block[face] = begin + np.searchsorted(rows[begin:end], high[face])
        self._block = block
        q, d = self._q, template.assembly.dimension
        sides = np.zeros((self.faces, 2, 7 if d == 2 else 27))
        matrix = template.matrix.tocsr()
        for face in range(self.faces):
            for side, end in enumerate((low[face], high[face])):
                if end >= 0:
                    element = q * self.pattern.order[end]
                    dense = matrix[element : element + q, q * face : q * face + q].toarray()
                    sides[face, side] = [*dense[:, :d].ravel(), *dense[d:, d:].ravel()]
        self._sides = sides

    def solve(
        self,
        labellings: Bits,
        *,
        undecided: Bools | None = None,
        thresholds: Floats | None = None,
        vectors: bool = False,
    ) -> BatchResults:
        """Bounds for labellings (k, m), True dry; an answer depends on its own labelling alone.

        undecided: (k, m) faces of no label. thresholds: (k,) scaled λ above which nothing more need be known. vectors:
        also hand back forces and velocities.
        """
        labels = np.ascontiguousarray(labellings, dtype=np.uint8)
        if undecided is not None:
            labels = np.where(undecided, np.uint8(_UNDECIDED), labels)
        least = None if thresholds is None else np.ascontiguousarray(thresholds, dtype=float)
        count = len(labels)
        low, high = np.empty(count), np.empty(count)
        verdict, iterations, tries = (np.zeros(count, dtype=np.int32) for _ in range(3))
        forces = np.zeros((count, self.faces, self._q)) if vectors else None
        velocity = np.zeros((count, self.size)) if vectors else None
        diagnosis = np.zeros((count, 4)) if vectors else None
        rays = np.zeros((count, self.faces, self._q)) if vectors else None
        problem = self._problem()
        settings = (library.Try * len(self._tries))(*self._tries)
        asked = library.pointers(labels=labels, thresholds=least)
        places = library.pointers(low=low, high=high, verdict=verdict, iterations=iterations, tries=tries)
        more = library.pointers(forces=forces, velocity=velocity, diagnosis=diagnosis, rays=rays)
        failed = self._library.jld_lanes_solve(
            problem,
            settings,
            len(self._tries),
            count,
            asked["labels"],
            asked.get("thresholds"),
            library.Answers(**places, **more),
        )
        if failed:
            raise MemoryError("the kernel's workspace")
        if velocity is not None:
            velocity = self._as_elements(velocity)
        return BatchResults(low, high, verdict, iterations, tries, forces, velocity, diagnosis, rays)

    def reversed(self) -> BatchSolver:
        """The same structure under the opposite live load, for a few labellings alone."""
        other = copy(self)
        other._live = -self._live
        nothing = np.zeros((self.faces, self._q))
        other._start = replace(self._start, jumps=nothing, speed=np.zeros(self.size), load=0.0)
        return other

    def minimize_conflicts(self, asked: ConflictRequest) -> MinimizationResults:
        """Each labelling with as few faces decided as still keep λ at its threshold, which is a scaled one.

        What is said to refute is a hint, to be weighed by who uses it.
        """
        count, how = len(asked.labellings), asked.how
        wide = 1 + how.neighbours
        begun = asked.labellings
        if asked.undecided is not None:
            begun = np.where(asked.undecided & asked.free, np.uint8(_UNDECIDED), begun)
        labels, matters = (np.ascontiguousarray(array, dtype=np.uint8) for array in (begun, asked.free))
        least = np.ascontiguousarray(asked.thresholds, dtype=float)
        fate, relaxations = np.zeros(count * wide, dtype=np.uint8), np.zeros(count * wide, dtype=np.int32)
        conflict = np.zeros((count * wide, self.faces), dtype=np.uint8)
        velocity = np.zeros((count * wide, self.size))
        given = library.pointers(labels=labels, free=matters, thresholds=least)
        places = library.pointers(fate=fate, conflict=conflict, velocity=velocity, relaxations=relaxations)
        task = library.MinimizationOptions(
            count=count,
            neighbours=how.neighbours,
            tries=how.tries,
            inner=int(how.inner),
            balance=how.balance,
            seed=asked.seed,
            **given,
            **places,
        )
        if self._library.jld_lanes_shrink(self._problem(), self._tries[0], task):
            raise MemoryError("the kernel's workspace")
        return MinimizationResults(
            np.arange(count).repeat(wide), fate, conflict.astype(bool), self._as_elements(velocity), relaxations
        )

    def _as_elements(self, velocity: Floats) -> Floats:
        """Velocities (k, q·free) in the order of elements, from that of elimination."""
        back = np.empty_like(velocity)
        back[:, self._ends] = velocity
        return back

    def _problem(self) -> library.Problem:
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
            speed=start.speed,
            bows=self._bows,
        )
        return library.Problem(
            elements=len(self.pattern.order),
            faces=self.faces,
            pairs=self._pairs,
            labels=len(self._rows),
            freedoms=self._q,
            dropping=int(not self._keep.all()),
            pattern=self.pattern.handed_over(),
            floor=self._floor,
            noise=tolerances.ROUNDING,
            load=start.load,
            room=start.room,
            push=_PUSH if self._q == 3 else _PUSH_SPATIAL,
            zero=self._zero,
            gap=tolerances.GAP,
            meets=int(self._meets),
            **arrays,
        )
