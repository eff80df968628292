"""Space of products X = Φ wᵀ of forces with velocities, where a velocity may use near forces only.

u_j multiplies a state in equilibrium of the elements around, all of them or those within a distance: smaller programs,
whose bound is lower but still valid, as they only omit rows. Slides that are multiplied with their own face only have
four products instead of a column.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from jld_core import Bools, Floats, Ints, tolerances
from jld_core.limit import Motion, State
from jld_dilation.modes import Modes
from jld_dilation.rlt_relaxation import null_space, row_maxima

_NOTHING: Final = 1e-11  # size of coefficients that are rounding errors of an elimination

Point = tuple[Floats, Floats]
"""(Z, T): coefficients of the states by velocities (k, w), and own products of slides of lone faces (f, 4)."""


@dataclass(frozen=True)
class ProductSpace:
    """Linear map from (Z, T) to the products y_k z_l of yield slacks and mode rates."""

    # X (p, w) holds products of (F, λ, 1) with w velocities, each column a state in equilibrium with coefficients Z (k,
    # w) in a basis. T (f, 4) holds the products of a lone face's slip t with its N, V, m and 1; its modes 4f + 2, 4f +
    # 3 are t and t + s.

    facts: Floats  # (r, p) linear forms of Φ: the yield slacks y, then others, the last of them 1
    rates: Floats  # (forms, w) linear forms of the velocities: the mode rates z, then the sums around loops
    bases: tuple[Floats, ...]  # bases of the states that velocities multiply. Z has as many rows as the widest.
    of: Ints  # (w,) basis of each velocity
    lone: Ints  # (f,) lone faces
    own: Floats  # (f, 5, 4) matrix from the products of each lone face in T to those of t with its four slacks and 1
    at: Ints  # (f, 4) places of its N, V, m and of 1 in Φ
    live: Floats  # (w,) coefficients of b_λ·u

    def expand(self, z: Floats) -> Floats:
        """Return the products X (p, w) of coefficients Z (k, w)."""
        x = np.zeros((self.facts.shape[1], len(self.of)))
        for basis, columns in zip(self.bases, self._columns, strict=True):
            x[:, columns] = basis @ z[: basis.shape[1], columns]
        return x

    def gather(self, form: Floats) -> Floats:
        """Convert a form of X (p, w) to one of Z (k, w): the transpose of `expand`."""
        out = np.zeros((max(basis.shape[1] for basis in self.bases), len(self.of)))
        for basis, columns in zip(self.bases, self._columns, strict=True):
            out[: basis.shape[1], columns] = basis.T @ form[:, columns]
        return out

    def values(self, point: Point) -> Floats:
        """Return the products y_k z_l (r, forms) at (Z, T); slides of lone faces by own slacks and 1 only."""
        z, t = point
        out = np.asarray(self.facts @ self.expand(z) @ self.rates.T)
        more = np.einsum("frc,fc->rf", self.own, t)
        for slide in (2, 3):
            out[self.rows, self.ones * (4 * self.lone + slide)] += more
        return out

    def adjoint(self, table: Floats) -> Point:
        """Return all products, weighted by a table (r, forms), as a form of (Z, T): the transpose of `values`."""
        slides = self.ones * (4 * self.lone)
        both = table[self.rows, slides + 2] + table[self.rows, slides + 3]
        return self.gather(self.facts.T @ (table @ self.rates)), np.einsum("frc,rf->fc", self.own, both)

    @cached_property
    def unit(self) -> Floats:
        """Return the coefficients (k, w) of the live work b_λ·u as a linear form of Z."""
        return self.gather(np.outer(self.facts[-1], self.live))

    @cached_property
    def rows(self) -> Ints:
        """Return indices (5, f) in `facts` of the four slacks of each lone face, and of 1."""
        return np.vstack([4 * self.lone + k for k in range(4)] + [np.full(len(self.lone), len(self.facts) - 1)])

    @property
    def ones(self) -> Ints:
        """Return a column (5, 1) of ones, which broadcasts mode numbers (f,) to the shape of `rows`."""
        return np.ones((5, 1), dtype=np.int64)

    @cached_property
    def _columns(self) -> list[Ints]:
        """Return the indices of the velocities that use each basis, one array per basis."""
        return [np.flatnonzero(self.of == basis) for basis in range(len(self.bases))]


class LocalProductSpace:
    """Sets of elements whose forces are multiplied with each velocity of a region."""

    # Velocities tied by closed modes share a set. distance: faces up to which forces count; None: all. basis: (3n + m,
    # w) of free velocities, in `forms` (4m + 2e, w); groups: (w,) element of each.

    def __init__(self, modes: Modes, closed: Bools, distance: int | None) -> None:
        self.modes, self.closed = modes, closed
        self.basis = null_space(modes.rates[closed])
        self.forms = modes.forms @ self.basis
        self.forms[abs(self.forms) < _NOTHING] = 0.0
        self.rates = self.forms[: len(modes.rows)]
        width = len(modes.dead)
        first = np.array([int(np.flatnonzero(column)[0]) for column in self.basis.T], dtype=np.int64)
        self.groups = np.where(first < width, first // 3, first)
        self.touches = (modes.matrix.reshape(width // 3, 3, modes.faces, 3) != 0.0).any(axis=(1, 3))
        self.elements, self._of = self._sets(distance)
        self.of = self._of[first]

    def _sets(self, distance: int | None) -> tuple[list[Bools], Ints]:
        """Return the distinct sets, masks (n,) of elements, and the set (3n + m,) of each velocity."""
        count, faces = self.touches.shape
        if distance is None:
            return [np.ones(count, dtype=bool)], np.zeros(3 * count + faces, dtype=np.int64)
        node = np.concatenate([np.repeat(np.arange(count), 3), count + np.arange(faces)])
        row, column = np.nonzero(self.modes.rates[self.closed])
        ties = sp.csr_array((np.ones(len(row)), (row, node[column])), shape=(int(self.closed.sum()), count + faces))
        name = connected_components(ties.T @ ties, directed=False)[1]
        meets = (self.touches.astype(int) @ self.touches.T) > 0
        near = np.linalg.matrix_power(meets.astype(float), distance) > 0.0
        of_face = self.touches.T @ near.astype(int) > 0
        sets: dict[bytes, int] = {}
        elements: list[Bools] = []
        at = np.empty(count + faces, dtype=np.int64)
        for part in range(int(name.max()) + 1):
            members = np.flatnonzero(name == part)
            members_by_side = [near[members[members < count]], of_face[members[members >= count] - count]]
            inside = np.asarray(np.vstack(members_by_side).any(axis=0))
            number = sets.setdefault(inside.tobytes(), len(sets))
            if number == len(elements):
                elements.append(inside)
            at[members] = number
        return elements, at[node]

    @cached_property
    def allowed_products(self) -> Bools:
        """Return a mask (4m + 3, 4m + 2e) of the products that the local sets can represent.

        Rows: slacks, λ above and below the ends of the region, 1, which are always available.
        """
        faces = [self.touches[inside].any(axis=0) for inside in self.elements]
        allowed = np.ones((self.modes.faces, len(self.forms)), dtype=bool)
        for number, faces_of_form in enumerate(faces):
            allowed[:, (self.forms[:, self.of == number] != 0.0).any(axis=1)] &= faces_of_form[:, None]
        return np.vstack([np.repeat(allowed, 4, axis=0), np.ones((3, len(self.forms)), dtype=bool)])

    def forces(self, number: int) -> tuple[Ints, Ints]:
        """Return a set's equilibrium equations, and the indices of its forces, λ and 1."""
        inside = self.elements[number]
        used = np.append(np.repeat(self.touches[inside].any(axis=0), 3), [True, True])
        return np.flatnonzero(np.repeat(inside, 3)), np.flatnonzero(used)

    def bases(self, statics: Floats) -> tuple[Floats, ...]:
        """Return, for each set, a basis (3m + 2, k) of its states in equilibrium."""
        # A state holds (F, λ, 1); forces that the set does not use are zero.
        out = []
        for number in range(len(self.elements)):
            rows, columns = self.forces(number)
            part = statics[np.ix_(rows, columns)]
            free = null_space(part / row_maxima(part)[:, None])
            basis = np.zeros((statics.shape[1], free.shape[1]))
            basis[columns] = free
            out.append(basis)
        return tuple(out)

    def equilibrium(self, statics: Floats, residual: Floats) -> Floats:
        """Return multipliers of equilibrium (3n, 3n + m) that reduce a residual the most, set by set."""
        multipliers = np.zeros((len(statics), residual.shape[1]))
        for number in range(len(self.elements)):
            rows, positions = self.forces(number)
            columns = np.flatnonzero(self._of == number)
            multipliers[np.ix_(rows, columns)] = self._inverse(number, statics) @ residual[np.ix_(positions, columns)]
        return multipliers

    def _inverse(self, number: int, statics: Floats) -> Floats:
        """Return the cached pseudo-inverse of the transposed equilibrium of one set."""
        if number not in self._inverses:
            rows, columns = self.forces(number)
            self._inverses[number] = np.asarray(np.linalg.pinv(statics[np.ix_(rows, columns)].T, rcond=1e-12))
        return self._inverses[number]

    @cached_property
    def _inverses(self) -> dict[int, Floats]:
        """Return the cache of pseudo-inverses, keyed by the number of the set."""
        return {}


@dataclass(frozen=True)
class Velocities:
    """Free velocities of a region, split into columns of X and slips of lone faces."""

    # The bounds on a lone face's slides need its own forces only: four products instead of a column of X. On walls this
    # removes a third of X, and no case was found where it lowers the bound.

    space: ProductSpace  # products of the velocities that have columns, and of the lone faces
    basis: Floats  # (3n + m, v) basis of all v free velocities
    whole: Bools  # (v,) True for the w velocities that have columns in `space`
    at: Ints  # (f,) free velocity that is the t of each lone face
    groups: Ints  # (w,) number of the group in which each velocity with a column is eliminated

    def split(self, form: Floats) -> Point:
        """Convert a form of X (3m + 2, v) to one of (Z, T): the transpose of `assemble`."""
        return self.space.gather(form[:, self.whole]), form[self.space.at, self.at[:, None]]

    def assemble(self, point: Point) -> Floats:
        """Return the products X (3m + 2, v) of a point (Z, T) with all free velocities."""
        x = np.zeros((self.space.facts.shape[1], self.basis.shape[1]))
        x[:, self.whole] = self.space.expand(point[0])
        x[self.space.at, self.at[:, None]] = point[1]
        return x


def velocities_of(local_space: LocalProductSpace, facts: Floats, statics: Floats, lone: Bools) -> Velocities:
    """Build product space and free velocities of a region; lone: (m,) from `lone_faces`."""
    modes, basis = local_space.modes, local_space.basis
    faces, count, width = np.flatnonzero(lone), len(modes.rows), len(modes.dead)
    at = np.array([np.flatnonzero(basis[width + face])[0] for face in faces], dtype=np.int64)
    untouched = ~np.isin(np.arange(basis.shape[1]), at)
    columns = np.column_stack([3 * faces, 3 * faces + 1, 3 * faces + 2, np.full(len(faces), facts.shape[1] - 1)])
    rows = np.column_stack([*(4 * faces + k for k in range(4)), np.full(len(faces), count + 2)])
    space = ProductSpace(
        facts=facts,
        rates=local_space.forms[:, untouched],
        bases=local_space.bases(statics),
        of=local_space.of[untouched],
        lone=faces,
        own=facts[rows[:, :, None], columns[:, None, :]],
        at=columns,
        live=(modes.live_rate @ basis)[untouched],
    )
    return Velocities(space, basis, untouched, at, np.unique(local_space.groups[untouched], return_inverse=True)[1])


def lone_faces(used: Bools, closed: Bools, loops: Floats) -> Bools:
    """Return faces (m,) with free slides that are multiplied with own slacks and 1 only, by a mask of products."""
    faces = len(closed) // 4
    around = loops[used[:, 4 * faces :].any(axis=0)].reshape(-1, faces, 4)[:, :, 2:].any(axis=(0, 2))
    used = used[:, : 4 * faces]
    other: Bools = np.any(used[: 4 * faces].reshape(faces, 4, faces, 4)[:, :, :, 2:], axis=(1, 3))
    np.fill_diagonal(other, False)
    bounded = used[4 * faces : -1].reshape(-1, faces, 4)[:, :, 2:].any(axis=(0, 2))
    return np.asarray(~other.any(axis=0) & ~bounded & ~around & ~closed.reshape(faces, 4)[:, 2:].any(axis=1))


@dataclass(frozen=True)
class PrimalDualPair:
    """Forces and velocities as one candidate, scaled; friction frozen at μN of the state (4.1)."""

    state: State  # forces in equilibrium. They lie inside the true friction cone if repairs succeeded.
    motion: Motion | None  # mechanism of the frozen problem; None if none has finite dissipation
    locked: bool  # True if the frozen problem has no finite λ
    violation: float  # largest excess of friction (|V| − μN)⁺ over the largest N
    dilation: float  # largest dilation of pressed faces over the largest slip; inf without a mechanism
    gap: float  # complementarity gap Γ, docs/method.md (4.3); inf without a mechanism
    dissipation: float  # Σ D_N(J), docs/method.md (4.5)
    area_change: float  # change of effective areas that the forces require; 0 without effective areas
    load_scale: float  # scaled λ below which λ counts as zero
    settled: bool  # True if λ of the last two programs agree: minimisation of Γ, and frozen problem

    @property
    def relative_gap(self) -> float:
        """Return Γ over the dissipation, or over the loads' work where nothing dissipates; inf if none."""
        if self.motion is None:
            return math.inf
        work = max(abs(self.state.load), abs(self.motion.bound), self.load_scale)
        size = self.dissipation if self.dissipation > 1e-6 * work else work
        return abs(self.gap) / size if size > 0.0 else math.inf

    def bracket_within(self, width: float) -> bool:
        """Return True if λ of forces and of velocities agree within a relative width."""
        if self.motion is None:
            return False
        size = max(abs(self.state.load), abs(self.motion.bound), self.load_scale)
        return abs(self.motion.bound - self.state.load) <= width * size

    def is_solution(self, width: float) -> bool:
        """Return True if the pair is an admissible, converged solution with a narrow bracket."""
        return not self.locked and self.state.admissible and self.converged and self.bracket_within(width)

    @property
    def converged(self) -> bool:
        """Return True if the pair meets all tolerances of a solution, docs/method.md (4.3), (4.5)."""
        if self.motion is None:
            return False
        return (
            self.violation <= tolerances.VIOLATION
            and self.dilation <= tolerances.DILATION
            and self.relative_gap <= tolerances.COMPLEMENTARITY
            and self.settled
            and self.area_change <= tolerances.FIXED_POINT
        )


def rank(pair: PrimalDualPair) -> tuple[bool, bool, float]:
    """Return a sort key: solutions, then admissible pairs, then others; small Γ before large."""
    return pair.is_solution(tolerances.GAP), pair.state.admissible, -pair.gap
