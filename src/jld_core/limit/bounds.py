"""Two-sided bounds on λ computed by us from whatever a solver returned (docs/method.md (3.3)).

A lower bound is the λ of forces that satisfy equilibrium and lie in every yield set; an upper bound is the
work balance of velocities whose dissipation is finite on every face. Neither needs the solver to be right: its
answer is repaired, checked, and bounds nothing if the check fails. All quantities here are scaled.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.linalg import Projector, quick
from jld_core.mechanics import reference_load
from jld_core.program import Template


@dataclass(frozen=True)
class State:
    """Forces (m, q) and λ, scaled, with the least slack in the yield sets and the error left in equilibrium."""

    forces: Floats
    load: float
    slack: float
    error: float

    @property
    def admissible(self) -> bool:
        """The exact solution next to these rounded numbers is inside every yield set."""
        return self.slack >= 2.0 * self.error

    @property
    def to_rounding(self) -> bool:
        """Equilibrium and cones hold to rounding: what is asked of a ray."""
        return self.slack >= -tolerances.ROUNDING and self.error <= tolerances.ROUNDING


@dataclass(frozen=True)
class Motion:
    """Velocities (q·free,) with b_λ·u = work, scaled; their least margin, dissipation minus dead work, and jumps.

    bound: Σ D(J) − b·u, meaningful where margin ≥ 0. noise: what rounding may have done to the bound.
    """

    velocity: Floats
    jumps: Floats
    work: float
    margin: float
    bound: float
    noise: float = 0.0


class Prover:
    """Turns raw points and multipliers of one template into checked bounds."""

    def __init__(self, template: Template) -> None:
        self.template = template
        self.transposed = sp.csr_array(template.matrix.T)
        self._jumps = quick(self.transposed)
        self._weight = abs(template.dead)
        self._total = float(self._weight.sum()) or reference_load(template.assembly) / template.scaling.force
        self._projectors: dict[bytes, Projector] = {}
        self._columns = template.matrix.shape[1]
        self._everything = np.ones((len(template.assembly.interfaces), template.assembly.freedoms), dtype=bool)

    def under(self, template: Template) -> Prover:
        """This prover for another template of the same matrix; projectors are shared."""
        other = copy.copy(self)
        other.template = template
        return other

    def projector(self, labels: Bits) -> tuple[Projector, Floats | None]:
        """The projector for the resultants that a labelling keeps, and their 0/1 mask (None: all)."""
        active = self.template.yield_set.active(labels)
        if active.all():
            active = self._everything
        key = np.packbits(active).tobytes()
        mask = None if active is self._everything else active.ravel().astype(float)
        if key not in self._projectors:
            matrix, places = self.template.matrix, self.template.structure.places
            if mask is not None:
                places = None
                live = sp.csc_array(self.template.live[:, None])
                matrix = sp.csc_array(sp.hstack([matrix @ sp.diags_array(mask), live]))
            if len(self._projectors) >= 16:
                self._projectors.pop(next(iter(self._projectors)))
            self._projectors[key] = Projector(sp.csc_array(matrix), places)
        return self._projectors[key], mask

    def state(self, point: Floats, labels: Bits, passes: int = 2, held: bool = False) -> State:
        """Project y = (F, …, λ) onto equilibrium and measure its slack.

        point: (≥ q·m + 1,), λ last. labels: (m,). held: λ is kept whatever happens; otherwise it moves with the
        forces where resultants are dropped.
        """
        if not usable(point):
            return self._nothing()
        return self._state(point[: self._columns], float(point[-1]), labels, passes, held)

    def ray(self, point: Floats, labels: Bits) -> State:
        """The same for a ray: A R + b_λ = 0 with R in the recession cones; `slack` refers to those."""
        if not usable(point) or not point[-1] > 0.0:
            return self._nothing()
        sets = self.template.yield_set
        mask = sets.recession_active(labels).ravel().astype(float)
        start = point[: self._columns] / point[-1] * mask
        forces, left, error = _balanced(self._of_forces(mask), start, -self.template.live, 3)
        table = forces.reshape(self._everything.shape)
        return State(table, 1.0, float(sets.recession_slack(table, labels).min()), _trusted(error, left, forces))

    def _nothing(self) -> State:
        return State(np.zeros(self._everything.shape), 0.0, -np.inf, np.inf)

    def _of_forces(self, mask: Floats) -> Projector:
        """The projector that leaves λ alone; mask: (q·m,) 1 for the resultants that are kept."""
        return Projector(sp.csc_array(self.template.matrix @ sp.diags_array(mask)), self.template.structure.places)

    def _state(self, forces: Floats, load: float, labels: Bits, passes: int, held: bool = False) -> State:
        template = self.template
        projector, mask = self.projector(labels)
        if mask is None or held:
            if mask is not None:
                projector, forces = self._of_forces(mask), forces * mask
            forces, left, error = _balanced(projector, forces, -(template.dead + load * template.live), passes)
        else:
            # with resultants dropped, equilibrium may hold at one λ alone: λ is projected with the forces
            joint, left, error = _balanced(projector, np.append(forces * mask, load), -template.dead, passes + 1)
            forces, load = joint[:-1], float(joint[-1])
        if mask is not None:
            error = _trusted(error, left, forces)
        table = forces.reshape(self._everything.shape)
        return State(table, load, float(template.yield_set.slack(table, labels).min()), error)

    def blend(self, state: State, inside: State, labels: Bits) -> State:
        """Move a state towards one well inside, just far enough to become admissible.

        Yield sets are convex and equilibrium is linear, λ included, so every blend is a state.
        """
        need = 4.0 * max(state.error, inside.error)
        if state.slack >= need or inside.slack <= need:
            return state
        share = min(1.0, (need - state.slack) / (inside.slack - state.slack))
        for _ in range(4):
            forces = (1.0 - share) * state.forces + share * inside.forces
            load = (1.0 - share) * state.load + share * inside.load
            mixed = self._state(forces.ravel(), load, labels, 1)
            if mixed.admissible:
                return mixed
            share = min(1.0, 2.0 * share)
        return mixed

    def motion(self, velocity: Floats, labels: Bits, normalise: bool = True) -> Motion:
        """Jumps, margin and bound of velocities (q·free,); normalised to b_λ·u = 1 where their work allows."""
        template = self.template
        velocity = velocity[: template.matrix.shape[0]]
        if not usable(velocity):
            return Motion(velocity, np.zeros(self._everything.shape), 0.0, -np.inf, np.inf)
        work = float(template.live @ velocity)
        if normalise and work > 0.0:
            velocity, work = velocity / work, 1.0
        jumps = (self._jumps @ velocity).reshape(self._everything.shape)
        return self.measure(velocity, jumps, work, labels)

    def measure(self, velocity: Floats, jumps: Floats, work: float, labels: Bits) -> Motion:
        """Margin and bound of velocities whose jumps are known."""
        sets = self.template.yield_set
        margin = float(sets.margin(jumps, labels).min())
        bound = float(sets.dissipation(jumps, labels).sum() - self.template.dead @ velocity)
        return Motion(velocity, jumps, work, margin, bound, self.noise(velocity, bound))

    def noise(self, velocity: Floats, bound: float) -> float:
        """Rounding that a bound may carry: of the sums that make it up, and of the velocities themselves."""
        return float(self.noises(velocity[None], np.array([bound]))[0])

    def noises(self, velocities: Floats, bounds: Floats) -> Floats:
        """The same of velocities (k, q·free) and bounds (k,)."""
        speed = abs(velocities)
        sizes = (speed * self._weight).sum(axis=1) + abs(bounds) + 1e-3 * self._total * speed.max(axis=1)
        return np.asarray(tolerances.ROUNDING * sizes)

    def jumps(self, velocities: Floats) -> Floats:
        """(k, m, q) scaled jumps of velocities (k, q·free)."""
        # one by one: a product with a matrix rounds otherwise than one with a vector
        each = [self._jumps @ velocity for velocity in velocities]
        return np.array(each).reshape(-1, *self._everything.shape)

    def open_up(self, motion: Motion, opening: Motion, labels: Bits) -> Motion:
        """Add just enough of a strictly opening motion for the dissipation to become finite."""
        opening = self.measure(opening.velocity, opening.jumps, opening.work, labels)
        if not np.isfinite(motion.margin) or motion.margin >= 0.0 or not opening.margin > 0.0:
            return motion
        share = -motion.margin / opening.margin
        for _ in range(4):
            mixed = self.motion(motion.velocity + share * opening.velocity, labels, normalise=motion.work > 0.0)
            if mixed.margin >= 0.0:
                return mixed
            share *= 2.0
        return mixed


def _balanced(projector: Projector, vector: Floats, target: Floats, passes: int) -> tuple[Floats, Floats, float]:
    """The nearest solution of rows·y = target, what is left of the equations, and how far off it may still be."""
    for _ in range(passes):
        vector = vector - projector.correction(projector.rows @ vector - target)
    left = projector.rows @ vector - target
    return vector, left, float(abs(projector.correction(left)).max())


def _trusted(error: float, left: Floats, forces: Floats) -> float:
    """An error, inf where too much is left: without the resultants that were dropped there is no equilibrium at all."""
    much = float(abs(left).max()) > tolerances.ROUNDING * max(1.0, float(abs(forces).max()))
    return np.inf if much else error


def usable(vector: Floats) -> bool:
    """Scaled answers are of order one; what a failed solve leaves behind may be anything."""
    return not vector.size or bool(abs(vector).max() < 1e30)


def relative_width(low: float, high: float, floor: float) -> float:
    """Width of a bracket over max(|lo|, |hi|, floor); inf where an end is missing (docs/method.md (3.13))."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return np.inf
    size = max(abs(low), abs(high), floor)
    return (high - low) / size if size > 0.0 else float(high > low)


def exceeds(low: float, bound: float, load_scale: float) -> bool:
    """Return True if a proven lower bound on λ contradicts an upper bound by more than counts as proven.

    load_scale: λ below which differences do not matter, in the unit of the bounds.
    """
    return low - bound > tolerances.PROVEN * max(abs(low), abs(bound) if np.isfinite(bound) else 0.0, load_scale)


def crossed(low: Any, high: Any, least: float = 1.0) -> Any:
    """Do lower and upper bounds contradict each other by more than rounding? Then neither is to be relied on.

    low, high: bounds or arrays of them, NaN where there is none. least: size below which rounding is not relative, 1
    for what is scaled.
    """
    return low - high > 10.0 * tolerances.ROUNDING * np.maximum(np.maximum(abs(low), abs(high)), least)


def apart(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two brackets of one λ, in any units, have nothing in common. Ends: NaN or infinite where unknown."""
    return bool(crossed(one[0], other[1], 0.0) or crossed(other[0], one[1], 0.0))


def load_scale(assembly: Assembly) -> float:
    """Compute the load factor below which differences do not count: 1e-3 · total weight / total live load, scene units.

    Without weight `reference_load` stands in its place. Of several load cases: the least, over what each requires.
    """
    each = zip(assembly.by_case, assembly.required.tolist(), strict=True)
    return float(min(tolerances.GAP_FLOOR * reference_load(one) / one.total_live / required for one, required in each))
