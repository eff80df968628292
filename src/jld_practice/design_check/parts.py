"""Worst factors of the parts of permanent loads, each an individual action: EN 1990, 6.4.3.1(4).

λ is a concave function of the factors, so that it is least where each is at one of its ends. Few parts: all of these
assignments are bounded. Many: the signs of the powers of collapse mechanisms lead to a bad assignment, whose λ is an
upper bound; forces that are affine in the factors, and admissible under all of them, give a lower bound.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit import CaseBounds, SolveOptions, Status
from jld_core.loads import Loads
from jld_core.models import limit_analysis, solve_rigid
from jld_core.program import ConicProgram, Template
from jld_core.scene.design import PartialFactors
from jld_core.solvers import make_solver
from jld_core.threads import one_thread
from jld_practice.design_check.combinations import ROUTE, Combination, at_design_loads
from jld_practice.reliability.bounds import SampleBounds
from jld_practice.reliability.form import LimitFunction
from jld_practice.reliability.structure import Growth, RandomStructure
from jld_practice.reliability.variables import Variables

_ALL: Final = 10  # largest number of parts of which all assignments are bounded

_STEPS: Final = 12  # largest number of mechanisms that lead to a bad assignment

_ROUNDS: Final = 6  # rounds in which forces that answer each part follow the room that the last state leaves

# Stated dead load over all dead load on an element up to which it is rounding of the self-weight
_ROUNDING: Final = 1e-12

_SAFE: Final = 1e-6  # relative share of a lower bound from affine forces that is left for rounding


@dataclass(frozen=True)
class WorstParts:
    """Worst assignment found for one load case: its combination and structure, and proven bounds of all assignments.

    stands: True if every assignment stands without live load, False if one does not, None if undecided.
    """

    combination: Combination
    structure: Assembly
    bounds: CaseBounds
    stands: bool | None


def worst_parts(structure: Assembly, labels: Bits, factors: PartialFactors, combination: Combination) -> WorstParts:
    """Bound λ of a structure with one load case over all assignments of factors to parts of permanent loads.

    structure: at characteristic loads and design strengths. labels: (m,) True = dry.
    """
    search = _Search(structure, labels, factors, combination)
    few = len(search.names) <= _ALL
    (low, high, worst), stands = search.all_assignments() if few else search.by_mechanisms()
    chosen, loaded = search.combination_of(worst), search.loaded(worst)
    if low == high == -math.inf:
        return WorstParts(chosen, loaded, CaseBounds(Status.UNSTABLE, math.nan, math.nan, math.nan), False)
    if low == math.inf:
        return WorstParts(chosen, loaded, CaseBounds(Status.LOCKED, math.inf, math.inf, math.nan), stands)
    ends = [end if math.isfinite(end) else math.nan for end in (low, high)]
    status = Status.COLLAPSE if all(map(math.isfinite, ends)) else Status.UNCERTIFIED
    value = solve_rigid(loaded, labels).load_factor
    return WorstParts(chosen, loaded, CaseBounds(status, ends[0], ends[1], value), stands)


def parts_of(structure: Assembly, factors: PartialFactors) -> tuple[tuple[str, ...], Floats, Floats, Floats]:
    """Return the parts of the permanent loads of a structure with one load case, and the design loads beside them.

    They are the weights of free elements, and stated dead loads on elements: names (k,), loads (k, n, q), and their
    factors (k, 2), favourable and unfavourable. Beside them (n, q) are prestress and loads whose factors are equal.
    """
    elements, stress = structure.elements, structure.members.self_stress
    weight = np.zeros_like(structure.dead)
    weight[elements.free, : structure.dimension] = elements.weight[elements.free]
    stated = structure.dead - weight - (0.0 if stress is None else stress)
    size = np.abs(structure.dead) + np.abs(weight)
    stated[np.abs(stated) <= _ROUNDING * np.maximum(size, size.max(axis=1, keepdims=True))] = 0.0
    names: list[str] = []
    loads, ends, rest = [], [], np.zeros_like(weight) if stress is None else np.array(stress)
    for what, load, pair in (("", weight, factors.self_weight), ("dead load on ", stated, factors.dead)):
        if pair[0] == pair[1]:
            rest += pair[0] * load
            continue
        for element in np.flatnonzero(load.any(axis=1) & ~elements.support).tolist():
            part = np.zeros_like(load)
            part[element] = load[element]
            names.append(what + elements.ids[element])
            loads.append(part)
            ends.append(pair)
    shape = (len(names), *structure.dead.shape)
    return tuple(names), np.array(loads).reshape(shape), np.array(ends).reshape(-1, 2), rest


class _Search:
    """Assignments of one load case; factors (parts,) are values of random variables that its loads follow."""

    def __init__(self, structure: Assembly, labels: Bits, factors: PartialFactors, combination: Combination) -> None:
        self.labels, self.plain = labels, combination
        self.names, self.loads, self.ends, self.rest = parts_of(structure, factors)
        self.middle = self.ends.mean(axis=1)
        # live loads at design values; permanent loads follow by parts
        self.base = at_design_loads(structure, factors, combination)

    def loaded(self, values: Floats, direction: float = 1.0) -> Assembly:
        """Return the structure with factors (parts,); direction: −1 to reverse its live load."""
        dead, stress = self.rest + np.tensordot(values, self.loads, 1), self.base.members.self_stress
        loads = Loads.of_resultants(dead if stress is None else dead - stress)
        base = self.base.with_strengths(self.base.strengths(ROUTE))
        return replace(base, dead_loads=loads, live_loads=direction * base.live_loads)

    def combination_of(self, values: Floats) -> Combination:
        """Return the combination of factors (parts,), of which those above their mean are unfavourable."""
        heavier = tuple(name for name, up in zip(self.names, values > self.middle, strict=True) if up)
        return replace(self.plain, heavier=heavier)

    def bounds(self, direction: float = 1.0) -> SampleBounds:
        """Return bounds on the factor of the live load, or of its opposite, for given factors of the parts."""
        base, count = self.loaded(self.middle, direction), len(self.names)
        variables = Variables(self.names, self.middle, np.ones(count), np.zeros(count, dtype=bool))
        growths = tuple(Growth((k,), load, np.zeros_like(base.live)) for k, load in enumerate(self.loads))
        return SampleBounds(RandomStructure(base, variables, (), (growths,)), self.labels)

    def all_assignments(self) -> tuple[tuple[float, float, Floats], bool | None]:
        """Return least bounds of all assignments with the worst one, and whether all stand without live load."""
        grid = np.array(list(itertools.product(*self.ends))).reshape(2 ** len(self.names), -1)
        found, back = self.bounds().of(grid), self.bounds(-1.0).of(grid)
        worst = int(np.argmin(np.where(np.isnan(found.high), np.inf, found.high)))
        falls = np.isneginf(back.high) | np.isneginf(found.high)
        known = ~np.isneginf(back.low) & ~np.isneginf(found.low)
        if falls.any() and not np.isneginf(found.high).any():
            worst = int(np.flatnonzero(falls)[0])
        stands = False if falls.any() else True if known.all() else None
        return (float(found.low.min()), float(found.high.min()), grid[worst]), stands

    def by_mechanisms(self) -> tuple[tuple[float, float, Floats], bool | None]:
        """Return a lower bound of all assignments, the least λ of those met, and its assignment."""
        function = LimitFunction(self.bounds(), 1.0)
        best, worst = math.inf, self.ends[:, 1]
        for start in (self.middle, self.ends[:, 0], self.ends[:, 1]):
            values = start
            for _ in range(_STEPS):
                limit = function.at_values(values)
                if np.isin(values, self.ends).all() and limit.value < best:
                    best, worst = limit.value, values
                if limit.gradient is None:
                    break
                # The power of a part in the mechanism is minus the rate of λ with its factor.
                rate = limit.gradient
                following = np.where(rate > 0.0, self.ends[:, 0], np.where(rate < 0.0, self.ends[:, 1], values))
                if np.array_equal(following, values):
                    break
                values = following
        found = self.bounds().proven(worst[None])
        back = self.bounds(-1.0).proven(worst[None])
        low, stands = self._affine(), None
        if np.isneginf(found.high[0]) or np.isneginf(back.high[0]):
            stands = False
        elif math.isfinite(low) and math.isfinite(self._affine(-1.0)):
            stands = True
        high = float(found.high[0])
        return (-math.inf if high == -math.inf else min(low, high), high, worst), stands

    @one_thread()
    def _affine(self, direction: float = 1.0) -> float:
        """Return a factor λ ≥ 0 that affine forces carry under all factors; −inf where none is found."""
        base = self.bounds(direction).structure.assembly
        template = limit_analysis(base, SolveOptions(), reference=self.labels, single_labelling=True).template
        free = base.elements.free
        half = 0.5 * (self.ends[:, 1] - self.ends[:, 0])
        parts = (half[:, None, None] * self.loads[:, free]).reshape(len(half), -1) / template.scaling.row.ravel()
        return template.scaling.load * robust_factor(template, self.labels, parts)


def robust_factor(template: Template, labels: Bits, parts: Floats) -> float:
    """Return a scaled λ ≥ 0 at which forces affine in ξ carry the dead load plus ξ·parts for all |ξ| ≤ 1, or −inf.

    parts: (k, q·free) scaled loads. Each is carried by forces of least norm, weighted by the room that faces have; the
    yield sets of all faces are diminished by what these forces can take up together.
    """
    program = template.program(labels)
    resultants, equations = template.matrix.shape[1], program.structure.equalities
    matrix = program.matrix.tocsr()
    equilibrium, rows = matrix[:equations, :resultants], matrix[equations:, :resultants]
    weight, best = np.ones(resultants // template.assembly.freedoms), -math.inf
    for _ in range(_ROUNDS):
        spread = np.repeat(weight**2, template.assembly.freedoms)
        stiffness = sp.csc_array(equilibrium @ sp.diags_array(spread) @ equilibrium.T)
        more = 1e-13 * float(stiffness.diagonal().max()) * sp.eye_array(equations, format="csc")
        system = sp.csc_array(stiffness + more)
        answer = spread[:, None] * (equilibrium.T @ splu(system).solve(np.asfortranarray(-parts.T)))
        if not np.isfinite(answer).all() or abs(equilibrium @ answer + parts.T).max() > _SAFE * abs(parts).max():
            break
        taken = _taken(program, np.asarray(rows @ answer))
        robust = replace(program, rhs=program.rhs - np.concatenate([np.zeros(equations), taken]))
        point = make_solver("clarabel").solve(robust).point
        slack = robust.rhs - robust.matrix @ point
        least = _least_slack(program, slack)
        if abs(slack[:equations]).max() < _SAFE * abs(program.rhs[:equations]).max() and least > -_SAFE:
            best = max(best, float(point[-1]) - _SAFE * max(1.0, abs(float(point[-1]))))
        # Faces that are pressed, or strong, have room for more.
        weight = np.maximum(
            abs(point[:resultants].reshape(len(weight), -1)[:, 0]), 1e-3 * abs(point[:resultants]).max()
        )
    return best if best >= 0.0 else -math.inf


def _taken(program: ConicProgram, change: Floats) -> Floats:
    """Return what changes (rows, k) of slacks can take of each row together: of cones at their tips."""
    linear, sizes = program.structure.linear, program.structure.cones
    taken = np.zeros(len(change))
    taken[:linear] = abs(change[:linear]).sum(axis=1)
    first = linear
    for size in sizes:
        tip, body = abs(change[first]), np.linalg.norm(change[first + 1 : first + size], axis=0)
        taken[first] = float((tip + body).sum())
        first += size
    return taken


def _least_slack(program: ConicProgram, slack: Floats) -> float:
    """Return the least slack of inequalities and cones of a point; slack: (rows,)."""
    shape = program.structure
    values = [float(slack[shape.equalities : shape.equalities + shape.linear].min(initial=math.inf))]
    for head, size in zip(shape.heads.tolist(), shape.cones, strict=True):
        values.append(float(slack[head] - np.linalg.norm(slack[head + 1 : head + size])))
    return min(values)
