"""Planar collapse without dilation as one complementarity problem (4.6), scaled: four rows y and four modes z a face.

An opening is both hinges at once, and sliding does not open a face, docs/method.md (4.5). In every solution a face
slides one way at most: t = max(0, −s). Modes may be scaled, so the formulas hold exactly in the numbers of A.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, Bools, Floats
from jld_core.program import Template
from jld_core.solvers import highs_ends, highs_of

_POLISHED: Final = 1e-8  # relative gap to reach by the interior-point method, which ends without crossover
# Feasibility tolerances of all these programs
_FEASIBLE: Final[dict[str, Any]] = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}


@dataclass(frozen=True)
class LinearAnswer:
    """Unverified solution of a linear program."""

    found: bool  # True if the solver reports an optimum. Otherwise the other values may be arbitrarily wrong.
    value: float
    point: Floats  # (columns,) solution x
    # (rows,) multipliers with objective = Rᵀ dual on free columns; ≥ 0 where the lower bound of a row binds in a
    # minimisation
    dual: Floats


class LinearRows:
    """Program low ≤ R x ≤ high, least ≤ x ≤ most, minimised for many objectives from the last solution."""

    def __init__(self, rows: Any, low: Floats, high: Floats, least: Floats, most: Floats) -> None:
        self._highs = highs_of(rows, np.zeros(rows.shape[1]), low, high, least, most, _FEASIBLE)
        self._columns = np.arange(rows.shape[1], dtype=np.int32)

    def bound(self, rows: slice, low: Floats, high: Floats) -> None:
        """Change the bounds (k,) of consecutive rows for the minimisations that follow."""
        index = np.arange(rows.start, rows.stop, dtype=np.int32)
        self._highs.changeRowsBounds(len(index), index, highs_ends(low), highs_ends(high))

    def minimise(self, objective: Floats) -> LinearAnswer:
        self._highs.changeColsCost(len(self._columns), self._columns, np.ascontiguousarray(objective))
        return _run(self._highs)


def interior_point(
    objective: Floats,
    rows: Any,
    low: Floats,
    high: Floats,
    seconds: float = np.inf,
    threads: int = 1,
    presolve: bool = True,
) -> LinearAnswer:
    """Minimise objective·x over free x with low ≤ R x ≤ high, by HiGHS' interior-point method."""
    # No crossover follows.
    free = np.full(rows.shape[1], np.inf)
    options = {
        **_FEASIBLE,
        "solver": "ipx",
        "run_crossover": "off",
        "threads": threads,
        "presolve": "choose" if presolve else "off",
        "ipm_optimality_tolerance": _POLISHED,
    }
    if np.isfinite(seconds):
        options["time_limit"] = max(seconds, 0.1)
    return _run(highs_of(rows, objective, low, high, -free, free, options))


def _run(highs: Any) -> LinearAnswer:
    highs.run()
    solution = highs.getSolution()
    optimal = highs.getModelStatus().name == "kOptimal"
    value = float(highs.getInfo().objective_function_value)
    return LinearAnswer(optimal, value, np.array(solution.col_value), np.array(solution.row_dual))


# Relative residual up to which a sum equals its slide; also the size of coefficients that are rounding
_NOTHING: Final = 1e-9

# Largest coefficient, relative to that of the slide; larger ones come from nearly parallel faces and bound little
_LARGE: Final = 1e3
Loop = tuple[int, ...]  # numbers of the faces of one loop


def loops_of(assembly: Assembly, rates: Floats) -> Floats:
    """Return coefficients (2e, 4m) of sums of mode rates (4m, w) around loops, ≥ 0 in solutions."""
    # There are two rows for each face of each loop, docs/method.md (4.7). They bound the slides s⁺ and s⁻ of the face
    # by the modes of the other faces, provided one slide of each face is zero. The difference of both rows is the
    # identity of the loop, which is zero up to rounding. Faces whose slip is no such sum have no rows.
    # two hinge rates and the slip of each face (m, 3, w), from rates of modes (4m, w)
    of_face = rates.reshape(len(rates) // 4, 4, -1)
    jumps = np.stack([of_face[:, 0], of_face[:, 1], of_face[:, 3] - of_face[:, 2]], axis=1)
    rows = []
    for loop in face_loops(assembly):
        for face in loop:
            others = np.array([other for other in loop if other != face])
            table = jumps[others].reshape(3 * len(others), -1)
            used = np.flatnonzero((table != 0.0).any(axis=0) | (jumps[face, 2] != 0.0))
            slide = jumps[face, 2, used]
            coefficients = np.linalg.lstsq(table[:, used].T, slide, rcond=None)[0]
            size = np.linalg.norm(slide)
            if (
                np.linalg.norm(coefficients @ table[:, used] - slide) > _NOTHING * size
                or abs(coefficients).max() > _LARGE
            ):
                continue
            shares = np.zeros(len(rates))
            coefficients = np.where(abs(coefficients) < _NOTHING, 0.0, coefficients).reshape(-1, 3)
            for other, (first, second, slip) in zip(others, coefficients, strict=True):
                shares[4 * other : 4 * other + 4] = first, second, -slip, slip
            pair = np.maximum([shares, -shares], 0.0)
            pair[0, 4 * face + 3] = pair[1, 4 * face + 2] = -1.0
            rows.append(pair)
    return np.vstack([np.zeros((0, len(rates))), *rows])


def has_opening(assembly: Assembly) -> bool:
    """Return True if a loop of blocks is not spanned, modulo 2, by loops of two to four faces."""
    between = _between(assembly)
    cycles = len(between) - _rank((1 << a) ^ (1 << b) for a, b in between)
    return _rank(sum(1 << face for face in loop) for loop in face_loops(assembly)) < cycles


def _rank(rows: Iterable[int]) -> int:
    """Return the rank modulo 2 of binary rows, each given as the bits of one integer."""
    pivots: dict[int, int] = {}
    for row in rows:
        while row and row.bit_length() in pivots:
            row ^= pivots[row.bit_length()]
        if row:
            pivots[row.bit_length()] = row
    return len(pivots)


def _between(assembly: Assembly) -> list[tuple[int, int]]:
    """Return two nodes of each face, the lower first; all supports are node 0."""
    number = np.where(assembly.elements.support, 0, 1 + np.arange(len(assembly.elements)))
    sides = np.sort(np.column_stack([number[assembly.interfaces.a], number[assembly.interfaces.b]]), axis=1)
    return [(a, b) for a, b in sides.tolist()]


def face_loops(assembly: Assembly) -> Iterator[Loop]:
    """Yield every loop of two to four faces around blocks in contact, as tuples of faces."""
    # Loops of four blocks that a face shortens are left out. All supports count as one block.
    between: dict[tuple[int, int], list[int]] = {}
    near: dict[int, set[int]] = {}
    for face, (a, b) in enumerate(_between(assembly)):
        between.setdefault((a, b), []).append(face)
        near.setdefault(a, set()).add(b)
        near.setdefault(b, set()).add(a)
    for faces_of_pair in between.values():
        yield from combinations(faces_of_pair, 2)
    for ring in _rings(near):
        choices = [between[min(a, b), max(a, b)] for a, b in zip(ring, (*ring[1:], ring[0]), strict=True)]
        yield from product(*choices)


def _rings(near: dict[int, set[int]]) -> Iterator[tuple[int, ...]]:
    """Yield the blocks of each loop of three, and of four without contact of opposite ones."""
    for a in sorted(near):
        later = sorted(b for b in near[a] if b > a)
        for b, c in combinations(later, 2):
            if c in near[b]:
                yield a, b, c
            else:
                yield from ((a, b, d, c) for d in sorted(near[b] & near[c]) if d > a and d not in near[a])


@dataclass(frozen=True)
class LinearModes:
    """Complementarity problem of one labelling with linear rows in plane or space (4.6), scaled, no crushing."""

    # Wanted are forces F, λ and velocities w = (u, t): A F + b + λ b_λ = 0, y = C F + d ≥ 0, b_λ·u = 1, z = H w ≥ 0,
    # y_k z_k = 0.

    matrix: Floats  # (equations, q) A
    dead: Floats  # (equations,) b
    live_rate: Floats  # (w,) coefficients of b_λ·u in w
    # rows, constants: (k, q) C and (k,) d
    rows: Floats
    constants: Floats
    rates: Floats  # (k, w) H
    capacities: Floats  # (m, q + 2) shear capacity of each face, μN or τA, as a linear form of (F, λ, 1)
    adjacent: Bools  # (m, m) True for faces that meet at an element, and on the diagonal

    @property
    def faces(self) -> int:
        return len(self.adjacent)

    @property
    def live(self) -> Floats:
        return self.live_rate[: len(self.dead)]

    @property
    def statics(self) -> Floats:
        """Return the equilibrium matrix K (equations, q + 2), with K (F, λ, 1) = 0."""
        return np.column_stack([self.matrix, self.live, self.dead])

    @property
    def slacks(self) -> Floats:
        """Return the matrix (k, q + 2) that maps (F, λ, 1) to the slacks of the yield rows."""
        return np.column_stack([self.rows, np.zeros(len(self.rows)), self.constants])


@dataclass(frozen=True)
class Modes(LinearModes):
    """Complementarity problem of a planar labelling: mode 4f + j of face f."""

    # j = 0, 1: hinges βδ ∓ θ; j = 2, 3: slides t and t + s. A is (3n, 3m), C (4m, 3m), H (4m, 3n + m).

    assembly: Assembly

    @cached_property
    def loops(self) -> Floats:
        """Return coefficients (2e, 4m) of sums around loops, ≥ 0 in solutions, see `loops_of`."""
        return loops_of(self.assembly, self.rates)

    @cached_property
    def forms(self) -> Floats:
        """Return the forms (4m + 2e, 3n + m) ≥ 0 in every solution: mode rates z, then sums around loops."""
        return np.vstack([self.rates, self.loops @ self.rates])

    @property
    def hinges(self) -> Bools:
        """Return a mask (4m,), True for hinge modes, False for slides."""
        return np.arange(len(self.rows)) % 4 < 2

    @property
    def near_pairs(self) -> Bools:
        """Return a mask (4m, 4m + 2e) of rows and forms whose faces meet at an element, or at a common face."""
        near = self.adjacent.astype(int)
        used = np.vstack([np.eye(len(self.rows)), self.loops]).reshape(-1, self.faces, 4).any(axis=2)
        return np.repeat((near @ near @ used.T) > 0, 4, axis=0)

    def slacks_of(self, forces: Floats) -> Floats:
        """Return the slacks y (4m,) of the yield rows under scaled forces (3m,)."""
        return np.asarray(self.rows @ forces + self.constants)


def modes_of(template: Template, labels: Bits) -> Modes | None:
    """Build the planar complementarity problem; None in space, and where a face may crush."""
    facets = template.yield_set.associative.facets(labels)
    if facets is None:
        return None
    of_face, constants = facets
    count = len(labels)
    matrix = np.asarray(template.matrix.toarray())
    rows = np.zeros((count, 4, count, 3))
    rows[np.arange(count), :, np.arange(count)] = of_face
    jumps = matrix.T.reshape(count, 3, -1)
    # Rates of the four rows of each face: β δn ∓ δθ of bending, then slip s⁻, a variable of its own, and s⁺ = δs + s⁻.
    beta = of_face[:, 1, 2][:, None]  # 1 for dry faces, 3 for inner ones
    rates = np.zeros((count, 4, matrix.shape[0] + count))
    rates[:, 0, : matrix.shape[0]] = beta * jumps[:, 0] - jumps[:, 2]
    rates[:, 1, : matrix.shape[0]] = beta * jumps[:, 0] + jumps[:, 2]
    rates[:, 3, : matrix.shape[0]] = jumps[:, 1]
    rates[np.arange(count), 2, matrix.shape[0] + np.arange(count)] = 1.0
    rates[np.arange(count), 3, matrix.shape[0] + np.arange(count)] = 1.0
    slides = np.zeros((count, 2, 3 * count + 2))
    slides[:, :, :-2], slides[:, :, -1] = rows[:, 2:].reshape(count, 2, -1), constants[:, 2:]
    rates = rates.reshape(4 * count, -1)
    return Modes(
        matrix=matrix,
        dead=template.dead,
        live_rate=np.concatenate([template.live, np.zeros(count)]),
        rows=rows.reshape(4 * count, 3 * count),
        constants=constants.ravel(),
        rates=rates,
        capacities=0.5 * (slides[:, 0] + slides[:, 1]),
        adjacent=adjacent_faces(template.assembly),
        assembly=template.assembly,
    )


def adjacent_faces(assembly: Assembly) -> Bools:
    """Return a mask (m, m) of faces that meet at an element; each face meets itself."""
    faces, near = assembly.interfaces, np.eye(len(assembly.interfaces), dtype=bool)
    for element in range(len(assembly.elements)):
        of_element = (faces.a == element) | (faces.b == element)
        near |= np.outer(of_element, of_element)
    return near


_SUMS: Final = 1e-13  # rounding error of a sum of a few hundred products, relative to the sum of their absolute values
_MOVES_NOT: Final = 1e-6  # least scaled slack that proves that a mode cannot move
_SEEN: Final = 1e-8  # slack of a known state below which a form is not tested, as its minimum cannot be positive enough


class Statics:
    """States A F + b + λ b_λ = 0, C F + d ≥ 0, low ≤ λ ≤ high, and proven bounds on them.

    held: (4m,) rows that are equations. force_bounds: (3m + 2,) if already known.
    """

    def __init__(
        self, modes: LinearModes, low: float, high: float, held: Bools, force_bounds: Floats | None = None
    ) -> None:
        self.modes, self.low, self.high, self.held = modes, low, high, held
        self._force_bounds = force_bounds
        count, columns = modes.rows.shape
        rows = np.block([[modes.matrix, modes.live[:, None]], [modes.rows, np.zeros((count, 1))]])
        least, most = np.full(columns + 1, -np.inf), np.full(columns + 1, np.inf)
        least[-1], most[-1] = low, high
        below = np.concatenate([-modes.dead, -modes.constants])
        above = np.concatenate([-modes.dead, np.where(held, -modes.constants, np.inf)])
        self._rows = LinearRows(rows, below, above, least, most)
        self._equations = len(modes.dead)

    def least(self, objective: Floats) -> float:
        """Prove a lower bound on an objective (3m + 2,) over all states; −inf if none is proven."""
        if not np.isfinite(self.force_bounds).all():
            return -np.inf
        value, residual = self._bound(objective)
        return value - float(residual @ self.force_bounds[:-2])

    @cached_property
    def force_bounds(self) -> Floats:
        """Return upper bounds (3m + 2,) on |F|, |λ| and 1; inf where none is proven."""
        # Nothing is proven if self-stress is unbounded.
        if self._force_bounds is not None:
            return self._force_bounds
        modes = self.modes
        strong = float(modes.constants.max(initial=0.0))
        total = -np.append(modes.rows.sum(axis=0), [0.0, modes.constants.sum()])
        value, residual = self._bound(total)
        missed = float(residual.sum())
        force_bounds = np.full(len(total), np.inf)
        force_bounds[-2:] = max(abs(self.low), abs(self.high)), 1.0
        if not np.isfinite(value) or missed > 0.5:
            return force_bounds
        # Every |F| is at most the sum of all slacks plus one strength, so this sum bounds itself.
        force_bounds[:-2] = (strong - value + missed * strong) / (1.0 - missed) + strong
        coarse = force_bounds.copy()
        for face in range(modes.faces):
            pressed = np.zeros(len(total))
            pressed[3 * face] = -1.0
            value, residual = self._bound(pressed)
            most = -(value - float(residual @ coarse[:-2])) + strong
            slides = modes.rows[4 * face + 2, 3 * face] * most + modes.constants[4 * face + 2]
            force_bounds[3 * face : 3 * face + 3] = np.minimum((most, slides, most), coarse[3 * face])
        return force_bounds

    def proven_positive(self, forms: Floats, tested: Bools) -> Bools:
        """Return which `tested` (k,) forms (k, 3m + 2) are proven positive in every state."""
        proven, bound = np.zeros(len(forms), dtype=bool), np.where(tested, np.inf, 0.0)
        for row in range(len(forms)):
            if bound[row] > _SEEN:
                answer = self._rows.minimise(forms[row, :-1])
                bound = np.minimum(bound, forms @ np.append(answer.point, 1.0)) if answer.found else bound
                proven[row] = answer.found and bound[row] > _MOVES_NOT and self.least(forms[row]) > _MOVES_NOT / 2
        return proven

    def _bound(self, objective: Floats) -> tuple[float, Floats]:
        """Prove objective ≥ value − r·|F| for all states: value, −inf on failure, and r (3m,)."""
        modes = self.modes
        answer = self._rows.minimise(objective[:-1])
        if not answer.found:
            return -np.inf, np.zeros(modes.rows.shape[1])
        q, p = answer.dual[: self._equations], answer.dual[self._equations :]
        p = np.where(self.held, p, np.maximum(p, 0.0))
        residual = objective[:-2] - modes.matrix.T @ q - modes.rows.T @ p
        noise = abs(objective[:-2]) + abs(modes.matrix).T @ abs(q) + abs(modes.rows).T @ abs(p)
        price = float(objective[-2] - modes.live @ q)
        blur = abs(objective[-2]) + float(abs(modes.live) @ abs(q))
        value = float(objective[-1] - modes.constants @ p - modes.dead @ q) + min(price * self.low, price * self.high)
        total = abs(objective[-1]) + float(modes.constants @ abs(p) + abs(modes.dead) @ abs(q))
        total += blur * max(abs(self.low), abs(self.high))
        return value - _SUMS * total, abs(residual) + _SUMS * noise


def bound_velocities(statics: Statics) -> Floats | None:
    """Bound velocities |u| and slides t of any mechanism per unit of its cost, (3n + m,)."""
    # Cost as in docs/method.md (4.8): openings and rotations, plus capacity times slip. Openings bound every motion but
    # the loose ones, which open nothing: these are bounded by the slips of some faces. Openings with these slips
    # determine the velocities, so that the inverse of both bounds them. None where no bound is proven.
    if not np.isfinite(statics.force_bounds).all():
        return None  # self-stress is unbounded
    modes, faces = statics.modes, statics.modes.faces
    width = len(modes.dead)
    jumps = modes.matrix.T.reshape(faces, 3, width)
    openings = np.concatenate([jumps[:, 0], jumps[:, 2]])
    bounded = _bounded_slips(statics, jumps, openings)
    if bounded is None:
        return None
    stacked = np.vstack([openings, jumps[bounded.faces, 1]])
    inverse = np.linalg.pinv(stacked, rcond=1e-12)
    if abs(inverse @ stacked - np.eye(width)).sum(axis=1).max() > 1e-6:
        return None  # rounding has spoiled the inverse
    # The openings and rotations of all faces together cost at most one. The factor 2 covers rounding, which the test
    # below keeps small.
    by_openings, by_slips = abs(inverse[:, : 2 * faces]).max(axis=1), abs(inverse[:, 2 * faces :])
    velocity = 2.0 * (by_openings + by_slips @ bounded.per_cost)
    if bounded.drift * float(velocity.max(initial=0.0)) > 1e-3:
        return None
    slips = abs(jumps[:, 1]) @ velocity
    return np.asarray(np.concatenate([velocity, slips]))


@dataclass(frozen=True)
class _BoundedSlips:
    faces: list[int]  # whose slips determine the loose motions
    per_cost: Floats  # largest slip of each of them for a cost of 1
    drift: float  # what rounding adds to the cost, for a velocity of 1


def _bounded_slips(statics: Statics, jumps: Floats, openings: Floats) -> _BoundedSlips | None:
    """Bound independent slips of loose motions by jumps (m, 3, 3n) and openings (2m, 3n); None if one costs nothing."""
    # A group of faces that slide alike in loose motions bounds one of them: its capacities together are at least
    # `least`, so that slip ≤ cost (1 + spread) / least. `spread` is what openings add to the differences of slips in
    # the group, `drift` what rounding does.
    _, values, basis = np.linalg.svd(openings)
    loose = basis[int((values > 1e-9 * values.max(initial=0.0)).sum()) :].T
    inverse = np.linalg.pinv(openings, rcond=1e-10)
    capacities = statics.modes.capacities
    largest_capacity = abs(capacities) @ statics.force_bounds
    slips = jumps[:, 1] @ loose
    chosen: list[int] = []
    chosen_slips: list[Floats] = []
    per_cost, drift = [], 0.0
    # faces by the size of their slip in loose motions, largest first
    for face in np.argsort(-np.linalg.norm(slips, axis=1), kind="stable").tolist():
        if len(chosen) == loose.shape[1]:
            break
        slip = jumps[face, 1] @ loose
        if np.linalg.matrix_rank(np.vstack([*chosen_slips, slip]), tol=1e-9) == len(chosen):
            continue
        sign = np.where(slips @ slip >= 0.0, 1.0, -1.0)
        group = np.abs(slips - sign[:, None] * slip).max(axis=1) <= 1e-9
        least = statics.least(capacities[group].sum(axis=0))
        if not least > 1e-6:
            continue
        group_capacity = largest_capacity[group].sum()
        difference = jumps[group, 1] - sign[group, None] * jumps[face, 1]
        by_openings = difference @ inverse
        rounding = abs(difference - by_openings @ openings).sum(axis=1).max()
        drift = max(drift, float(group_capacity * rounding / least))
        spread = float(group_capacity * abs(by_openings).max(initial=0.0))
        chosen.append(face)
        chosen_slips.append(slip)
        per_cost.append((1.0 + spread) / least)
    return _BoundedSlips(chosen, np.array(per_cost), drift) if len(chosen) == loose.shape[1] else None


@dataclass(frozen=True)
class Region:
    # low, high: ends of the interval of scaled λ
    low: float
    high: float
    closed: Bools  # (4m,) closed modes, with the rate z = 0
    held: Bools  # (4m,) held modes, with the yield slack y = 0

    def split(self, rates: Floats, slacks: Floats) -> tuple[Region, Region] | None:
        """Split the region at the mode that most violates y z = 0 by mean rates and slacks (4m,); or None."""
        # The measure of a mode is min(z, 1) y. In the first part, the mode is closed. In the second part, it is held;
        # if it is a slide, the other slide of its face is closed.
        products = np.where(self.closed | self.held, 0.0, np.minimum(rates, 1.0) * slacks)
        if not products.max() > 0.0:
            return None
        mode = int(np.argmax(products))
        number = np.arange(len(products))
        lower = number == mode
        other = (number == mode ^ 1) & (mode % 4 > 1)
        return replace(self, closed=self.closed | lower), replace(
            self, closed=self.closed | other, held=self.held | lower
        )


@dataclass(frozen=True)
class BoundedModes:
    """Planar complementarity problem with bounds that all its solutions keep, the same for every step."""

    modes: Modes  # the complementarity problem
    force_bounds: Floats  # (3m + 2,) upper bounds on |F|, |λ| and 1, see `Statics.force_bounds`
    # (3n + m,) upper bounds on velocities and slides per unit of cost, see `bound_velocities`; None if not proven
    velocity_bounds: Floats | None

    @classmethod
    def up_to(cls, modes: Modes, high: float) -> BoundedModes:
        statics = Statics(modes, 0.0, high, np.zeros(len(modes.rows), dtype=bool))
        return cls(modes, statics.force_bounds, bound_velocities(statics))

    def region(self, low: float, high: float, closed: Bools, held: Bools) -> Region:
        """Return the region low ≤ λ ≤ high of closed (z = 0) and held (y = 0) modes (4m,); proven ones close too."""
        statics = Statics(self.modes, low, high, held, self.force_bounds)
        still = statics.proven_positive(self.modes.slacks, ~held)  # y > 0 in every state
        return Region(low, high, closed | still, held)
