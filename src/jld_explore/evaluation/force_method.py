"""Bound λ of one labelling from both sides at a vertex whose proofs cover many labellings.

The forces and the mechanism that prove one λ are seldom unique.
Interior points choose the centre of the optimal set, where few faces are exactly at rest or exactly free.
A linear program chooses the solutions that leave most faces free (docs/method.md (6.7)).
The program is stated by the force method: a tree of faces carries all loads, F = F₀ + λ F₁ + Z x.
The redundants x, three for each further face, are all that equilibrium leaves open.
With rows G F ≤ h of both labels of every face, its dual is

    minimise (h − G F₀)·z   subject to   Zᵀ Gᵀ z = 0,   F₁·Gᵀ z = 1,   0 ≤ z ≤ z_max

A labelling changes only z_max: large for its own rows, small for those of the other labels.
The rows of other labels are then satisfied where this does not reduce λ.
One HiGHS object serves all labellings. Only planar programs without cones are supported.
Each labelling starts from the same basis, so that its result depends on that labelling alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import highspy
import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.limit import Motion, Prover, State, load_scale
from jld_core.limit.repair import Repair
from jld_core.mechanics import RowPattern
from jld_core.program import Template
from jld_core.solvers.highs import highs_of
from jld_explore.evaluation.certificates import Mechanism, Proofs, forces_of, mechanism_of

LARGEST: Final = 64
"""Largest number of faces for the force method. At 88 faces a vertex takes 4.7 ms, an interior point with proofs 2.2
ms.
"""


@dataclass(frozen=True)
class VertexSettings:
    """Parameters of the choice of vertices, dimensionless.

    Forces and jumps are scaled to order one.

    Attributes
    ----------
    margin : float
        Slack required of every row, so that a vertex is admissible after rounding.
    tie : float
        Cost of motion where rows have no spare slack, which excludes idle motions.
    unit : float
        Scale factor of costs. HiGHS resolves forces to 1e-10, which is more than `margin`.
    most : float
        Largest move of a row of the labelling itself.
        A move above half of it shows that no forces carry the loads, and no vertex is returned.
    most_of_others : float
        Largest move of a row of another label; small enough that λ is not reduced for it.
    passes : int
        Number of times the weights of other labels are updated from the previous result.
    excess : float
        Violation below which another label is nearly satisfied.
    met : float
        Violation that counts as rounding.
    given_up : float
        Share of λ that may be lost to satisfy other labels.
    same : float
        Relative difference up to which bounds identify labellings of one family.
    unbounded : float
        Finite value that replaces an unbounded dissipation.
    """

    margin: float = 1e-12
    tie: float = 1e-9
    unit: float = 1e3
    most: float = 1e3
    most_of_others: float = 1e-5
    passes: int = 2
    excess: float = 1e-2
    met: float = 1e-9
    given_up: float = 1e-8
    same: float = 1e-7
    unbounded: float = 1e6


@dataclass(frozen=True)
class Vertex:
    """Result of the force method for one labelling.

    Attributes
    ----------
    state : State or None
        Statically admissible forces; None if the labelling stands for no λ ≥ 0.
    motion : Motion
        Mechanism.
    proofs : Proofs
        Bounds that state and motion prove for other labellings.
    """

    state: State | None
    motion: Motion
    proofs: Proofs


class ForceMethod:
    """Linear program of the force method for one template.

    Parameters
    ----------
    template : Template
        Program of the assembly.
    prover : Prover
        Computes proven bounds from forces and velocities.
    repair : Repair
        Provides the motion that opens all joints.
    settings : VertexSettings, optional
        Parameters of the choice of vertices.

    Attributes
    ----------
    usable : bool
        True if the template has such a program: planar, no cones, at most `LARGEST` faces, all elements connected.
    """

    def __init__(
        self, template: Template, prover: Prover, repair: Repair, settings: VertexSettings | None = None
    ) -> None:
        self.template, self.prover, self.repair = template, prover, repair
        self.settings = settings or VertexSettings()
        assembly, sets = template.assembly, template.yield_set
        faces = len(assembly.interfaces)
        every = np.ones(faces, dtype=bool)
        self._floor = load_scale(template.assembly) / template.scaling.load
        self._asked: tuple[Bits | None, Floats] = (None, np.empty((0, faces)))
        self.usable = False
        if template.structure.cones or faces > LARGEST:
            return
        tree = _tree(assembly)
        if tree is not None and sets.active(every).all() and sets.active(~every).all():
            self._state(tree)
            self.usable = True

    def _state(self, tree: Ints) -> None:
        """Set up the program with a tree (t,) of faces as the base structure."""
        template, pattern, q = self.template, self.template.yield_set.pattern, self.template.assembly.freedoms
        self._matrix = matrix = template.matrix.toarray()
        self._base = (q * tree[:, None] + np.arange(q)).ravel()
        self._inverse = np.linalg.inv(matrix[:, self._base])
        rest = np.setdiff1d(np.arange(matrix.shape[1]), self._base)
        self._dead, self._live = np.zeros(matrix.shape[1]), np.zeros(matrix.shape[1])
        self._dead[self._base], self._live[self._base] = -self._inverse @ template.dead, -self._inverse @ template.live
        self._by_redundants = np.zeros((matrix.shape[1], len(rest)))
        self._by_redundants[self._base] = -self._inverse @ matrix[:, rest]
        self._by_redundants[rest, np.arange(len(rest))] = 1.0
        below = np.append(np.zeros(len(rest)), 1.0)
        self._table = np.vstack([np.column_stack([self._by_redundants, self._live]), below])
        self._dead_point = np.append(self._dead, 0.0)
        shape = (len(pattern.h_dry), matrix.shape[1])
        tables = [sp.csr_array((data, (pattern.row, pattern.column)), shape=shape) for data in _both(pattern)]
        table = sp.csr_array(sp.vstack(tables)).toarray()
        used = abs(table).sum(axis=1) > 0.0
        self._rows = table[used]
        self._tree_rows = self._rows[:, self._base]
        self._limit = np.concatenate([pattern.h_dry, pattern.h_inner])[used]
        self._face = np.tile(pattern.row_face, 2)[used]
        self._dry = np.repeat([True, False], len(pattern.h_dry))[used]
        program = np.vstack([self._by_redundants.T @ self._rows.T, self._rows @ self._live])
        program[abs(program) < tolerances.VERTEX_ROUNDING] = 0.0
        self._program = program
        self._cost = self._limit - self._rows @ self._dead
        self._places = np.arange(len(self._cost), dtype=np.int32)
        self._nothing = np.zeros(len(self._cost))
        one, free = np.append(np.zeros(len(program) - 1), 1.0), np.full(len(self._cost), np.inf)
        price = self.settings.unit * (self._cost - self.settings.margin)
        self._highs = highs_of(program, price, one, one, self._nothing, free, _OPTIONS)
        # Solve with the rows of both labels, the most restrictive program; all labellings start from its basis.
        self._highs.run()
        self._start = self._highs.getBasis()

    # --- one labelling ----------------------------------------------------------------------------------

    def solve(self, labels: Bits, waiting: Bits | None = None) -> Vertex | None:
        """Compute forces and mechanism of one labelling, or None if they prove no bounds.

        Parameters
        ----------
        labels : (m,) bool array
            Labels, True = dry.
        waiting : (k, m) bool array, optional
            Other labellings that the forces should satisfy as well.

        Returns
        -------
        Vertex or None
            State, motion and their proofs.
        """
        found = self._solve(labels, waiting, self.settings.margin)
        if found is not None and (found.state is None or found.state.admissible):
            return found
        # No margin can be kept where the yield sets have no interior; use costs on motion instead.
        try:
            self._price(self.settings.tie)
            return self._solve(labels, waiting, 0.0)
        finally:
            self._price(-self.settings.margin)

    def _solve(self, labels: Bits, waiting: Bits | None, margin: float) -> Vertex | None:
        """Compute a vertex of one labelling with a given margin of the rows, or None."""
        chosen = self.settings
        own = labels[self._face] == self._dry
        if not self._run(np.where(own, chosen.most, 0.0), anew=bool(margin)):
            return None
        moves = self._moves()
        motion = self._checked(self._velocity(moves), labels)
        if not motion.margin >= 0.0:
            return None
        falls = motion.bound < -max(tolerances.ROUNDING, motion.noise)
        if not falls and moves.max() > 0.5 * chosen.most:
            return None
        mechanism = mechanism_of(self.template, motion, labels)
        if falls:
            return Vertex(None, motion, Proofs((), (mechanism,)))
        if not margin:
            # Remove the extra cost of idle motions, since it also relaxed the limits of the forces.
            self._price(0.0)
            if not self._run(np.where(own, chosen.most, 0.0)):
                return None
        family = self._family(mechanism, motion.bound, labels, waiting)
        points = [self._point()]
        # If no waiting labelling belongs to the family, other forces bring no gain.
        for _ in range(chosen.passes if waiting is None or family is not None else 0):
            weights = self._weights(points[-1], labels, own, family)
            if weights is None or not self._run(np.where(own, chosen.most, chosen.most_of_others * weights)):
                break
            points.append(self._point())
        least = points[0][-1] - chosen.given_up * max(abs(points[0][-1]), self._floor)
        for point in reversed(points):
            state = self._admitted(point, labels, exact=not margin)
            if point[-1] >= least and state.admissible:
                break
        forces = (forces_of(self.template, state, labels),) if state.admissible else ()
        return Vertex(state, motion, Proofs(forces, (mechanism,)))

    def _price(self, extra: float) -> None:
        """Set the cost of each row to its limit plus an extra cost."""
        self._highs.changeColsCost(len(self._places), self._places, self.settings.unit * (self._cost + extra))

    def _run(self, most: Floats, *, anew: bool = False) -> bool:
        """Solve with upper bounds (k,) on the moves of the rows; return False without an optimum.

        With `anew` the solver starts from the common basis of all labellings, else from its last basis.
        """
        self._highs.changeColsBounds(len(self._places), self._places, self._nothing, most)
        if anew:
            self._highs.clearSolver()
            self._highs.setBasis(self._start)
        self._highs.run()
        return bool(self._highs.getModelStatus() == highspy.HighsModelStatus.kOptimal)

    def _point(self) -> Floats:
        """Return forces and λ of the current solution, (q·m + 1,)."""
        free = np.array(self._highs.getSolution().row_dual) / self.settings.unit
        return np.asarray(self._table @ free + self._dead_point)

    def _moves(self) -> Floats:
        """Return how far each row moves in the current solution, (k,)."""
        return np.array(self._highs.getSolution().col_value)

    def _velocity(self, moves: Floats) -> Floats:
        """Return the velocities (q·free,) of given row moves, using the faces of the tree."""
        return np.asarray(-(moves @ self._tree_rows) @ self._inverse)

    # --- other labels -----------------------------------------------------------------------------------

    def _family(self, mechanism: Mechanism, bound: float, labels: Bits, waiting: Bits | None) -> Bits | None:
        """Return the waiting labellings with the same bound by the mechanism, or None."""
        if waiting is None:
            return None
        if self._asked[0] is not waiting:
            self._asked = waiting, waiting.astype(np.float64)
        dry, inner = (np.minimum(each, self.settings.unbounded) for each in (mechanism.dry, mechanism.inner))
        value = mechanism.constant + inner.sum() + self._asked[1] @ (dry - inner)
        family = waiting[abs(value - bound) <= self.settings.same * max(abs(bound), self._floor)]
        family = family[(family != labels).any(axis=1)]
        return family if len(family) else None

    def _weights(self, point: Floats, labels: Bits, own: Bools, family: Bits | None) -> Floats | None:
        """Return (k,) weights for satisfying each row of other labels, None if all are satisfied.

        A weight is large where the violation is small or where many labellings depend on the row.
        """
        excess = np.maximum(self._rows @ point[:-1] - self._limit, 0.0)
        lacking = np.bincount(self._face[~own], excess[~own], len(labels))
        if not lacking.any():
            return None
        weight = np.ones(len(labels))
        if family is not None:
            other = family != labels
            left = other @ (lacking > self.settings.met).astype(np.float64)
            weight = (1.0 + left) ** -2 @ other
            weight = weight / weight.max() + 1e-6
        weight /= lacking + self.settings.excess
        return np.asarray((weight / weight.max())[self._face])

    # --- proofs -----------------------------------------------------------------------------------------

    def _admitted(self, point: Floats, labels: Bits, *, exact: bool) -> State:
        """Return the state of a point; with `exact`, remove violations of the size of rounding."""
        state = self.prover.state(point, labels)
        if exact and not state.admissible:
            noise = tolerances.ROUNDING * max(1.0, float(abs(state.forces).max()))
            if state.slack >= -noise and state.error <= noise:
                # Relaxing the rows by the noise raises λ at most by the work of their moves.
                given = 2.0 * noise * float(self._moves().sum())
                return State(state.forces, state.load - given, 0.0, 0.0)
        return state

    def _checked(self, velocity: Floats, labels: Bits) -> Motion:
        """Return the motion corrected for rounding, so that its dissipation is finite.

        If the joints can open, every joint opens by more than rounding. In confined assemblies rounding is set to
        zero.
        """
        opening = self.repair.opening()
        size = float(abs(velocity).max())
        if opening is not None and np.isfinite(size):
            jumps = (velocity @ self._matrix).reshape(len(labels), -1)
            margin = float(self.template.yield_set.margin(jumps, labels).min())
            share = max(tolerances.VERTEX_ROUNDING * size, -1.001 * margin) / opening.margin
            motion = self.prover.motion(velocity + share * opening.velocity, labels)
            return motion if motion.margin >= 0.0 else self.prover.open_up(motion, opening, labels)
        motion = self.prover.motion(velocity, labels)
        if not np.isfinite(motion.margin):
            return motion
        rest = tolerances.VERTEX_ROUNDING * float(abs(motion.velocity).max())
        # A vertex satisfies its equations exactly, so residuals of the size of rounding are zero.
        jumps = np.where(abs(motion.jumps) < rest, 0.0, motion.jumps)
        margins = [self.template.yield_set.margin(jumps, label) for label in (labels, ~labels)]
        tight = [(margin < 0.0) & (margin > -rest) for margin in margins]
        jumps[:, 0] += np.where(tight[0] | tight[1], rest, 0.0)
        return self.prover.measure(motion.velocity, jumps, motion.work, labels)


def _both(pattern: RowPattern) -> tuple[Floats, Floats]:
    """Return the row coefficients of a yield set for the labels dry and inner."""
    return pattern.dry, pattern.inner


def _tree(assembly: Assembly) -> Ints | None:
    """Return faces that connect each element to the supports in one way, with few faces.

    Return None if some elements are not connected.
    """
    faces, free = assembly.interfaces, assembly.elements.free
    node = np.zeros(len(assembly.elements), dtype=np.int64)
    node[free] = np.arange(1, len(free) + 1)
    ends = np.column_stack([node[faces.a], node[faces.b]])
    reached, tree = np.arange(len(free) + 1) == 0, []
    while not reached.all():
        first = reached.copy()
        for face in np.flatnonzero(first[ends[:, 0]] != first[ends[:, 1]]).tolist():
            if not reached[ends[face]].all():
                reached[ends[face]] = True
                tree.append(face)
        if (first == reached).all():
            return None
    return np.array(sorted(tree), dtype=np.int64)


_OPTIONS: Final[dict[str, bool | int | float | str]] = {
    "solver": "simplex",
    "simplex_iteration_limit": 20_000,  # About a hundred times the iterations of one labelling.
    "presolve": "off",  # These programs are too small to profit from presolve.
    "simplex_scale_strategy": 0,  # Rows and columns are already of order one.
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}
"""Options of HiGHS for the small linear programs of `ForceMethod`."""
