"""Checked bounds on λ, computed from raw solver output, all scaled, and the record of what is proven.

An answer is repaired and checked, and gives no bound if the check fails: lower bounds are λ of forces in equilibrium
and in every yield set, upper ones the work balance of velocities of finite dissipation (docs/method.md (3.3)).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import LOCKED, BatchResults
from jld_core.limit.auxiliary_programs import LargestSupport, slack_rows
from jld_core.limit.options import Status
from jld_core.linalg.factors import Projector, dense_if_small
from jld_core.mechanics import reference_load
from jld_core.program import ConicProgram, Template, pack


@dataclass(frozen=True)
class Reduced:
    """Yield rows left after facial reduction, which alone may have multipliers beside a self-stress."""

    linear: Ints  # (k,) linear inequalities that are kept, as rows of the program
    cones: tuple[int, ...]  # indices of the cones that are kept
    # for each cone, by index, whose multipliers are only a ray: the direction of the self-stress in it, a unit vector
    rays: dict[int, Floats] = field(default_factory=dict)


def unreduced_rows(program: ConicProgram) -> Reduced:
    """Return all yield rows but that of λ, from which facial reduction starts."""
    structure = program.structure
    return Reduced(slack_rows(structure)[: structure.linear - 1], tuple(range(len(structure.cones))))


def program_of_rows(program: ConicProgram, reduced: Reduced, right: bool = False) -> ConicProgram:
    """Return a program with the yield rows of `reduced` alone; right: False sets their right-hand sides to zero."""
    # The new rows are the equations, the row that bounds λ, the kept inequalities, one inequality s₀ ≥ d·s for each ray
    # of direction d, and the kept cones. Here s₀ is the first slack of the cone, s are the others.
    structure = program.structure
    first = np.concatenate([np.arange(structure.equalities + 1), reduced.linear]).astype(np.int64)
    cones = [np.arange(structure.heads[cone], structure.heads[cone] + structure.cones[cone]) for cone in reduced.cones]
    last = np.concatenate(cones or [np.empty(0)]).astype(np.int64)
    selection = [sp.eye_array(structure.shape[0]).tocsr()[first]]
    if reduced.rays:
        ray_rows = sp.lil_array((len(reduced.rays), structure.shape[0]))
        for row, (cone, direction) in enumerate(reduced.rays.items()):
            ray_rows[row, structure.heads[cone]] = 1.0
            for offset, value in enumerate(direction, start=1):
                ray_rows[row, structure.heads[cone] + offset] = -value
        selection.append(ray_rows.tocsr())
    selection_matrix: sp.csr_array = sp.vstack([*selection, sp.eye_array(structure.shape[0]).tocsr()[last]]).tocsr()
    rhs = np.asarray(selection_matrix @ program.rhs) if right else np.zeros(selection_matrix.shape[0])
    linear = 1 + len(reduced.linear) + len(reduced.rays)
    sizes = tuple(structure.cones[cone] for cone in reduced.cones)
    matrix = selection_matrix @ program.matrix.tocsr()
    return pack(matrix, rhs, program.objective, structure.equalities, linear, sizes, structure.places)


def leaning_program(program: ConicProgram, reduced: Reduced, stress: Floats) -> ConicProgram:
    """Return the program of forces that are admissible once a large self-stress (columns,) is added."""
    # The program is `program_of_rows` with one more cone for each ray, docs/method.md (3.12a). In a cone on whose
    # boundary the self-stress R lies, along d, let V be the shear and t its bound. The forces then keep s (2 |R|) ≥ |V
    # across d|², where s = t − d·V.
    reduced_program = program_of_rows(program, reduced, right=True)
    cone_structure, matrix, structure = program.structure, program.matrix.tocsr(), reduced_program.structure
    rows, sides = [reduced_program.matrix.tocsr()], [reduced_program.rhs]
    first_ray = structure.equalities + structure.linear - len(reduced.rays)
    for k, (cone, direction) in enumerate(reduced.rays.items()):
        rows_of_cone = slice(cone_structure.heads[cone], cone_structure.heads[cone] + cone_structure.cones[cone])
        bound_row, bound_side = rows[0][[first_ray + k]], reduced_program.rhs[first_ray + k]
        size = float(-(matrix[[cone_structure.heads[cone]]][:, : len(stress)] @ stress)[0])
        perpendicular = sp.csr_array(la.null_space(direction[None]).T) * (2.0 / np.sqrt(2.0 * size))
        rows += [bound_row, perpendicular @ matrix[rows_of_cone][1:], bound_row]
        perpendicular_sides = np.asarray(perpendicular @ program.rhs[rows_of_cone][1:])
        sides += [np.array([bound_side + 1.0]), perpendicular_sides, np.array([bound_side - 1.0])]
    sizes = structure.cones + tuple(cone_structure.cones[cone] for cone in reduced.rays)
    matrix, rhs = sp.vstack(rows), np.concatenate(sides)
    return pack(matrix, rhs, program.objective, structure.equalities, structure.linear, sizes, structure.places)


def reduced_by(support: LargestSupport, program: ConicProgram, reduced: Reduced) -> Reduced | None:
    """Return the yield rows that are left once a large self-stress acts; None if all are."""
    # Rows in which the self-stress has slack are removed. A cone on whose boundary it lies becomes a ray.
    sizes = [program.structure.cones[cone] for cone in reduced.cones]
    # rows in order: linear rows, one for each ray, cones
    first_ray, first_cone = len(reduced.linear), len(reduced.linear) + len(reduced.rays)
    has_slack: Bools = support.slack > 0.5  # slacks are 0 or 1, up to the solver's residual
    linear = reduced.linear[~has_slack[:first_ray]]
    of_rays = zip(reduced.rays.items(), has_slack[first_ray:first_cone], strict=True)
    rays = {cone: direction for (cone, direction), removed in of_rays if not removed}
    cones = []
    starts = len(support.values) - sum(sizes) + np.cumsum([0, *sizes])[:-1]
    for cone, start, size, removed in zip(reduced.cones, starts, sizes, has_slack[first_cone:], strict=True):
        if removed:
            continue
        direction = support.boundary_direction(start, size)
        if direction is None:
            cones.append(cone)
        else:
            rays[cone] = direction
    if len(linear) == len(reduced.linear) and len(cones) == len(reduced.cones) and len(rays) == len(reduced.rays):
        return None
    return Reduced(linear, tuple(cones), rays)


def rows_by_element(rows: Floats, freedoms: int) -> Floats:
    """Reshape a vector (q·free,) to (free, q); each further entry gets a row of its own."""
    count = len(rows) // freedoms * freedoms
    extra_rows = np.zeros((len(rows) - count, freedoms))
    extra_rows[:, 0] = rows[count:]
    return np.concatenate([rows[:count].reshape(-1, freedoms), extra_rows])


def projected_onto(projector: Projector, vector: Floats, target: Floats, passes: int) -> tuple[Floats, Floats, float]:
    """Project a vector (columns,) onto rows·y = target: vector, residual (rows,), error estimate."""
    for _ in range(passes):
        vector = vector - projector.correction(projector.rows @ vector - target)
    residual = projector.rows @ vector - target
    return vector, residual, float(abs(projector.correction(residual)).max())


def error_or_inf(error: float, residual: Floats, forces: Floats) -> float:
    """Return an error estimate, or inf if the residual (rows,) exceeds rounding, so no equilibrium exists."""
    inconsistent = float(abs(residual).max()) > tolerances.ROUNDING * max(1.0, float(abs(forces).max()))
    return np.inf if inconsistent else error


# Relative amount by which the lower bound exceeds the upper one where they contradict each other
_CROSSED: Final = 10.0 * tolerances.ROUNDING

DIVERGED: Final = 1e30  # size that values of a failed solve may have


def usable(vector: Floats) -> bool:
    """Return True if a vector is below 1e30, unlike those that a failed solve may leave."""
    return not vector.size or bool(abs(vector).max() < DIVERGED)


class EquilibriumProjectors:
    """Cached projectors onto the equilibrium of one template, for each set of kept resultants."""

    def __init__(self, template: Template) -> None:
        self.template = template
        self._cache: dict[bytes, Projector] = {}
        self._all_active = np.ones((len(template.assembly.interfaces), template.assembly.freedoms), dtype=bool)

    def with_template(self, template: Template) -> EquilibriumProjectors:
        """Return these projectors for another template of the same equilibrium matrix, cache shared."""
        copied = copy.copy(self)
        copied.template = template
        return copied

    def with_load(self, labels: Bits) -> tuple[Projector, Floats | None]:
        """Return the projector of the resultants that a labelling keeps, and their mask (q·m,); None: all."""
        active = self.template.yield_set.active(labels)
        if active.all():
            active = self._all_active
        key = np.packbits(active).tobytes()
        mask = None if active is self._all_active else active.ravel().astype(float)
        if key not in self._cache:
            matrix, places = self.template.matrix, self.template.structure.places
            if mask is not None:
                places = None
                live = sp.csc_array(self.template.live[:, None])
                matrix = sp.csc_array(sp.hstack([matrix @ sp.diags_array(mask), live]))
            if len(self._cache) >= 16:
                self._cache.pop(next(iter(self._cache)))
            self._cache[key] = Projector(sp.csc_array(matrix), places)
        return self._cache[key], mask

    def of_forces(self, mask: Floats) -> Projector:
        """Return a new projector onto equilibrium at fixed λ, of the kept resultants (q·m,)."""
        return Projector(sp.csc_array(self.template.matrix @ sp.diags_array(mask)), self.template.structure.places)


@dataclass(frozen=True)
class State:
    """Forces and λ of one labelling, with their slack and their equilibrium error.

    Attributes
    ----------
    forces : (m, q) float array
        Resultants of each face, scaled.
    load : float
        λ, scaled.
    slack : float
        Least slack over all yield rows, scaled; of a ray, over the recession cones.
    error : float
        Estimate of the force error left in equilibrium, scaled.
    """

    forces: Floats
    load: float
    slack: float
    error: float

    @property
    def admissible(self) -> bool:
        """Return True if the exact solution next to the rounded forces lies in every yield set."""
        return self.slack >= 2.0 * self.error


@dataclass(frozen=True)
class Motion:
    """Velocities of all free elements, with the upper bound on λ that they prove.

    Attributes
    ----------
    velocity : (q·free,) float array
        Velocities, scaled.
    jumps : (m, q) float array
        Velocity jumps of the faces, scaled.
    work : float
        Work b_λ·u of the live load, scaled.
    margin : float
        Least margin of the conditions for finite dissipation; the bound holds if it is ≥ 0.
    bound : float
        Dissipation minus dead work, Σ D(J) − b·u, scaled.
    noise : float
        Rounding error that the bound may contain.
    """

    velocity: Floats
    jumps: Floats
    work: float
    margin: float
    bound: float
    noise: float = 0.0


# Share of the largest force up to which the forces of a ray are taken out, in turn, where it is none otherwise
_FAINT_SHARES: Final = (1e-12, 1e-9)

# Rounding of a difference of two coordinates, relative to the larger one
_LAST_DIGITS: Final = 4.0 * float(np.finfo(float).eps)

# Share of the largest force of a ray up to which those of a face are zero
_LAST_DIGIT: Final = 8.0 * float(np.finfo(float).eps)


class Prover:
    """Compute checked bounds from raw points and multipliers of one template.

    Parameters
    ----------
    template : Template
        Scaled programs of one assembly.
    """

    def __init__(self, template: Template) -> None:
        self.template = template
        self.transposed = sp.csr_array(template.matrix.T)
        self._jumps = dense_if_small(self.transposed)
        self._magnitudes = abs(template.matrix)
        self._dead_sizes = abs(template.dead)  # (q·free,)
        self._total_dead = float(self._dead_sizes.sum()) or reference_load(template.assembly) / template.scaling.force
        self._projectors = EquilibriumProjectors(template)
        self._columns = template.matrix.shape[1]
        self._all_active = np.ones((len(template.assembly.interfaces), template.assembly.freedoms), dtype=bool)

    @cached_property
    def exact(self) -> float:
        """Return the violation of a face that counts as rounding: `EXACT`, or the last digits of coordinates."""
        elements = self.template.assembly.elements
        largest = max(float(abs(elements.lower).max()), float(abs(elements.upper).max()))
        return max(tolerances.EXACT, _LAST_DIGITS * largest / self.template.assembly.size)

    def is_ray(self, ray: State) -> bool:
        """Return True if equilibrium and recession cones hold to `exact`, or to `ROUNDING` where slack absorbs it."""
        allowed = tolerances.ROUNDING if ray.slack >= 2.0 * tolerances.ROUNDING else self.exact
        return ray.slack >= -self.exact and ray.error <= allowed

    def with_template(self, template: Template) -> Prover:
        """Return this prover for another template of the same matrix, with shared projectors."""
        copied = copy.copy(self)
        copied.template = template
        copied._projectors = self._projectors.with_template(template)
        return copied

    def state(self, point: Floats, labels: Bits, passes: int = 2, fixed_load: bool = False) -> State:
        """Project a point (≥ q·m + 1,), λ last, onto equilibrium, by `_state`; slack −inf and error inf if unusable."""
        if not usable(point):
            return self._no_state()
        return self._state(point[: self._columns], float(point[-1]), labels, passes, fixed_load)

    def projector(self, labels: Bits) -> Projector | None:
        """Return the projector onto equilibrium at fixed λ; None where labels (m,) drop resultants."""
        projector, mask = self._projectors.with_load(labels)
        return projector if mask is None else None

    def state_within(self, forces: Floats, labels: Bits, inside: Bools) -> State:
        """Project forces (m, q) at λ = 0 onto equilibrium, with forces on the faces `inside` (m,) alone."""
        # Faces without forces are exactly at the apex of their sets: only the slack of the others must exceed rounding.
        mask = np.repeat(inside, forces.shape[1]).astype(float)
        dead, projector = self.template.dead, self._projectors.of_forces(mask)
        projected, residual, error = projected_onto(projector, forces.ravel() * mask, -dead, 3)
        table = projected.reshape(forces.shape)
        slack = self.template.yield_set.slack(table, labels)
        outside = float(slack[~inside].min(initial=np.inf))
        room = float(slack[inside].min(initial=np.inf))
        return State(table, 0.0, room if outside >= 0.0 else outside, error_or_inf(error, residual, projected))

    def ray(self, point: Floats, labels: Bits) -> State:
        """Project a point, λ > 0 last, onto A R + b_λ = 0 and measure its recession slack per unit of λ."""
        # Slack of a face is divided by its largest resultant where that is below 1: rounding of large loads elsewhere
        # must not hide the forces that a small load needs. Resultants that are rounding of others become zero where
        # that makes a ray.
        if not usable(point) or not point[-1] > 0.0:
            return self._no_state()
        active = self.template.yield_set.recession_active(labels)
        state = self._ray(point[: self._columns] / point[-1], active, labels)
        for share in _FAINT_SHARES:
            if self.is_ray(state):
                break
            # forces that are rounding of others are taken out, where the live load can do without them
            largest = abs(state.forces).max(axis=1)
            significant = active & (largest > share * largest.max(initial=0.0))[:, None]
            state = self._ray(state.forces.ravel(), significant, labels)
        return state

    def _ray(self, forces: Floats, active: Bools, labels: Bits) -> State:
        """Project forces (q·m,) onto A R + b_λ = 0, only `active` ones (m, q) not zero, and measure them."""
        mask, live = active.ravel().astype(float), self.template.live
        forces, residual, error = projected_onto(self._projectors.of_forces(mask), forces * mask, -live, 3)
        table = forces.reshape(self._all_active.shape)
        # what elements that bear nothing show is the last digit of the factors
        table[abs(table).max(axis=1) <= _LAST_DIGIT * abs(table).max(initial=0.0)] = 0.0
        forces = table.ravel()
        residual = self.template.matrix @ forces + live
        # a face with small forces must hold as exactly as others: its slack counts relative to them
        largest = abs(table).max(axis=1)
        size = np.where(largest > 0.0, np.minimum(largest, 1.0), 1.0)
        slack = self.template.yield_set.recession_slack(table, labels) / size
        error = max(error_or_inf(error, residual, forces), self.imbalance(forces, live))
        return State(table, 1.0, float(slack.min()), error)

    def imbalance(self, forces: Floats, load: Floats) -> float:
        """Return the largest residual of A F + load of an element, relative to its terms but at most 1."""
        # A small load is thus not taken for the rounding error of a large one elsewhere.
        freedoms = self._all_active.shape[1]
        residual, terms = self.template.matrix @ forces + load, self._magnitudes @ abs(forces) + abs(load)
        # Judge element by element: a moment that is zero may be rounding of forces times arms.
        terms = np.minimum(rows_by_element(terms, freedoms).max(axis=1, initial=0.0), 1.0)
        imbalance = rows_by_element(abs(residual), freedoms).max(axis=1, initial=0.0)
        return float((imbalance / np.where(terms > 0.0, terms, 1.0)).max(initial=0.0))

    def _no_state(self) -> State:
        """Return a state that proves no bound: slack −inf and error inf."""
        return State(np.zeros(self._all_active.shape), 0.0, -np.inf, np.inf)

    def _state(self, forces: Floats, load: float, labels: Bits, passes: int, fixed_load: bool = False) -> State:
        """Project forces (q·m,) at a given λ onto equilibrium, and measure their slack.

        fixed_load: keep λ even where resultants are dropped. passes: corrections of the projection.
        """
        template = self.template
        projector, mask = self._projectors.with_load(labels)
        if mask is None or fixed_load:
            if mask is not None:
                projector, forces = self._projectors.of_forces(mask), forces * mask
            forces, residual, error = projected_onto(projector, forces, -(template.dead + load * template.live), passes)
        else:
            # With resultants dropped, equilibrium may hold at one λ alone: project λ with the forces.
            forces_and_load, residual, error = projected_onto(
                projector, np.append(forces * mask, load), -template.dead, passes + 1
            )
            forces, load = forces_and_load[:-1], float(forces_and_load[-1])
        if mask is not None:
            error = error_or_inf(error, residual, forces)
        table = forces.reshape(self._all_active.shape)
        return State(table, load, float(template.yield_set.slack(table, labels).min()), error)

    def blend(self, state: State, inside: State, labels: Bits) -> State:
        """Move a state towards one with slack until admissible (3.10); it may still not be after four attempts."""
        # Yield sets are convex and equilibrium is linear, λ included, so every blend is a state.
        needed = 4.0 * max(state.error, inside.error)
        if state.slack >= needed or inside.slack <= needed:
            return state
        share = min(1.0, (needed - state.slack) / (inside.slack - state.slack))
        for _ in range(4):
            forces = (1.0 - share) * state.forces + share * inside.forces
            load = (1.0 - share) * state.load + share * inside.load
            blended = self._state(forces.ravel(), load, labels, 1)
            if blended.admissible:
                return blended
            share = min(1.0, 2.0 * share)
        return blended

    def motion(self, velocity: Floats, labels: Bits, normalise: bool = True) -> Motion:
        """Compute jumps, margin and bound of velocities (≥ q·free,), of live work 1 if positive and asked.

        Or margin −inf.
        """
        template = self.template
        velocity = velocity[: template.matrix.shape[0]]
        if not usable(velocity):
            return Motion(velocity, np.zeros(self._all_active.shape), 0.0, -np.inf, np.inf)
        work = float(template.live @ velocity)
        if normalise and work > 0.0:
            velocity, work = velocity / work, 1.0
        jumps = (self._jumps @ velocity).reshape(self._all_active.shape)
        return self.measure(velocity, jumps, work, labels)

    def measure(self, velocity: Floats, jumps: Floats, work: float, labels: Bits) -> Motion:
        """Compute margin and bound of velocities (q·free,) with known jumps (m, q) and live work."""
        sets = self.template.yield_set
        margin = float(sets.margin(jumps, labels).min())
        bound = float(sets.dissipation(jumps, labels).sum() - self.template.dead @ velocity)
        return Motion(velocity, jumps, work, margin, bound, self.noise(velocity, bound))

    def noise(self, velocity: Floats, bound: float) -> float:
        """Estimate the rounding error of the bound of one motion, scaled."""
        return float(self.noises(velocity[None], np.array([bound]))[0])

    def noises(self, velocities: Floats, bounds: Floats) -> Floats:
        """Estimate the rounding errors (k,) of the bounds of k motions, scaled."""
        speed = abs(velocities)
        sizes = (speed * self._dead_sizes).sum(axis=1) + abs(bounds) + 1e-3 * self._total_dead * speed.max(axis=1)
        return np.asarray(tolerances.ROUNDING * sizes)

    def jumps(self, velocities: Floats) -> Floats:
        """Compute the jumps (k, m, q) of velocities (k, q·free), scaled."""
        # Multiply one by one: a matrix product rounds differently from a matrix-vector product.
        jumps = [self._jumps @ velocity for velocity in velocities]
        return np.array(jumps).reshape(-1, *self._all_active.shape)

    def add_opening(self, motion: Motion, opening: Motion, labels: Bits) -> Motion:
        """Add an opening motion until the dissipation is finite (3.11); it may still not be after four attempts."""
        opening = self.measure(opening.velocity, opening.jumps, opening.work, labels)
        if not np.isfinite(motion.margin) or motion.margin >= 0.0 or not opening.margin > 0.0:
            return motion
        share = -motion.margin / opening.margin
        for _ in range(4):
            opened = self.motion(motion.velocity + share * opening.velocity, labels, normalise=motion.work > 0.0)
            if opened.margin >= 0.0:
                return opened
            share *= 2.0
        return opened


def relative_width(low: float, high: float, load_scale: float) -> float:
    """Compute the relative width of a bracket, docs/method.md (3.13).

    Parameters
    ----------
    low, high : float
        Bounds on λ, in any one unit; NaN or infinite where missing.
    load_scale : float
        λ below which differences are negligible, in the same unit (see `load_scale`).

    Returns
    -------
    float
        Width over max(|low|, |high|, load_scale); inf where a bound is missing.
    """
    if not (np.isfinite(low) and np.isfinite(high)):
        return np.inf
    size = max(abs(low), abs(high), load_scale)
    return (high - low) / size if size > 0.0 else float(high > low)


def exceeds(low: float, bound: float, load_scale: float) -> bool:
    """Return whether a proven lower bound on λ contradicts an upper one by more than `tolerances.PROVEN`."""
    return low - bound > tolerances.PROVEN * max(abs(low), abs(bound) if np.isfinite(bound) else 0.0, load_scale)


def crossed(low: Any, high: Any, least: float = 1.0) -> Any:
    """Return whether lower bounds exceed upper bounds by more than rounding, so that neither is reliable.

    Parameters
    ----------
    low, high : float or array
        Bounds.
    least : float
        Size of a bound that is not small.

    Returns
    -------
    bool or array of bool
        False where one is NaN.
    """
    return low - high > _CROSSED * np.maximum(np.maximum(abs(low), abs(high)), least)


def are_disjoint(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Return True if two brackets of the same λ, in one unit, are disjoint by more than rounding."""
    return bool(crossed(a[0], b[1], 0.0) or crossed(b[0], a[1], 0.0))


def load_scale(assembly: Assembly) -> float:
    """Compute the load factor below which differences are negligible.

    It is 1e-3 · total weight / total live load. Without weight, `reference_load` takes its place.

    Parameters
    ----------
    assembly : Assembly
        Structure; of several load cases the least value over the required factor counts.

    Returns
    -------
    float
        Load factor in scene units.
    """
    scales = [tolerances.GAP_FLOOR * reference_load(case) / case.total_live for case in assembly.by_case]
    return float(min(scale / required for scale, required in zip(scales, assembly.required.tolist(), strict=True)))


@dataclass
class Proof:
    """Bounds proven so far for one labelling of a template, scaled as in the template.

    Attributes
    ----------
    state : State or None
        Admissible forces of the lower bound.
    motion : Motion or None
        Mechanism of the upper bound.
    ray : State or None
        Ray that carries the live load for every larger λ, docs/method.md (3.14).
    collapse_below_zero : Motion or None
        Mechanism that proves that no λ ≥ 0 is admissible, docs/method.md (3.15).
    solve_log : list of str
        Names of the methods tried, in order.
    solves : int
        Number of programs solved.
    guess : float
        λ without proof, NaN where there is none.
    status : Status
        Outcome that the proof supports.
    stands : bool or None
        True if λ = 0 is admissible, False if not; None where undecided.
    found : State or None
        Forces to report where they differ from those of the lower bound. With zero dilation they may violate friction.
    associative : float
        λ with associative friction, of a zero-dilation proof.
    outbid : bool
        True if a zero-dilation proof stopped at its associative λ, because that is too low to be of interest.
    seconds : float
        Wall-clock time.
    extra : dict
        Further facts of the model, as in the JSON output.
    notes : list of str
        The same facts in sentences.
    """

    state: State | None = None
    motion: Motion | None = None
    ray: State | None = None
    collapse_below_zero: Motion | None = None
    solve_log: list[str] = field(default_factory=list)
    solves: int = 0
    guess: float = math.nan
    status: Status = Status.UNCERTIFIED
    stands: bool | None = None
    found: State | None = None
    associative: float = math.nan
    outbid: bool = False
    seconds: float = 0.0
    extra: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def offer_state(self, state: State) -> None:
        """Keep an admissible state if its λ is the highest so far, by more than rounding."""
        # A λ above that of an exact state (error zero) by less than rounding proves no more than the exact state.
        if not state.admissible:
            return
        best = self.state
        exact = best is not None and best.error == 0.0
        if best is None or state.load > best.load + (tolerances.ROUNDING if exact else 0.0):
            self.state = state

    def offer_motion(self, motion: Motion) -> None:
        """Keep a motion of live work 1 and margin ≥ 0 if its bound is the lowest so far."""
        if motion.margin >= 0.0 and motion.work > 0.0 and (self.motion is None or motion.bound < self.motion.bound):
            self.motion = motion

    @property
    def crossed(self) -> bool:
        """Return True if the bounds contradict each other by more than rounding: neither is reliable then."""
        if self.state is None or self.motion is None:
            return False
        # Same test as `brackets.crossed`, which accepts arrays and takes ten times as long.
        low, high = self.state.load, self.motion.bound
        return bool(low - high > _CROSSED * max(abs(low), abs(high), 1.0))

    @property
    def low(self) -> float:
        """Return the proven lower bound on λ, scaled; −inf where there is none."""
        if self.state is None or self.crossed:
            return -math.inf
        return self.state.load if self.motion is None else min(self.state.load, self.motion.bound)

    @property
    def high(self) -> float:
        """Return the proven upper bound on λ, scaled; +inf where there is none."""
        if self.motion is None or self.crossed:
            return math.inf
        if self.state is None:
            return self.motion.bound
        width = self.motion.bound - self.state.load
        # Next to the state without forces at λ = 0, the rounding of a bound proves no width.
        without_forces = self.state.error == 0.0 and self.state.load == 0.0
        at_state = width < 0.0 or (without_forces and width <= self.motion.noise)
        return self.state.load if at_state else self.motion.bound

    @property
    def bracket(self) -> tuple[float, float]:
        """Return the proven bounds on λ, scaled; NaN if unproven or infinite, or if no λ exists."""
        low = self.low if math.isfinite(self.low) else math.nan
        high = self.high if math.isfinite(self.high) else math.nan
        if self.status is Status.UNSTABLE:
            return math.nan, math.nan
        return (low, math.nan) if self.status is Status.LOCKED else (low, high)

    @property
    def load_factor(self) -> float:
        """Return λ of the forces found, else of the bracket: its middle if narrow, its lower end; else the guess."""
        if self.status in (Status.UNSTABLE, Status.LOCKED):
            return math.nan
        if self.found is not None:
            return self.found.load
        low, high = self.bracket
        if math.isnan(low) or math.isnan(high):
            return self.guess if self.status is Status.UNCERTIFIED else math.nan
        is_wide = relative_width(low, high, tolerances.GAP_FLOOR) > tolerances.GAP
        return low if is_wide else 0.5 * (low + high)


# Least and largest number of faces of a spatial assembly for which the batch solver is faster for one labelling.
# Its setup is included. Source: benchmarks/results/batch_solver_single.md.
FACES_WHERE_BATCH_IS_FASTER: Final = (48, 400)


def offer_results(
    results: BatchResults, labels: Bits, proof: Proof, prover: Prover, opening: Callable[[], Motion | None]
) -> None:
    """Check the batch solver's bounds of one labelling, and add the valid ones to a proof."""
    if results.forces is None:
        return
    if np.isfinite(results.low[0]):
        proof.offer_state(prover.state(np.append(results.forces[0], results.low[0]), labels))
    if results.verdict[0] == LOCKED and results.rays is not None:
        ray = prover.ray(np.append(results.rays[0], 1.0), labels)
        proof.ray = ray if prover.is_ray(ray) else proof.ray
    elif results.velocity is not None and results.velocity[0].any():
        motion = prover.motion(results.velocity[0], labels)
        widening = opening() if motion.margin < 0.0 else None
        proof.offer_motion(motion if widening is None else prover.add_opening(motion, widening, labels))
