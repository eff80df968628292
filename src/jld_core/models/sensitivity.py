"""Compute how λ changes with strengths and weight, with one-sided rates where they differ.

λ is the value of a program max λ subject to M(p) y + s = r(p). With optimal y and multipliers w, and Δ the derivative
by the parameter p,

    dλ/dp = w·(Δr − ΔM y)

where y and w are unique. Elsewhere λ has a derivative to either side. In the plane each side is the value of a linear
program over all optimal y and the directions z in which y may move,

    λ'(p+) = max −q·z   subject to   M_E z = Δr_E − ΔM_E y,   M_B z ≤ Δr_B − ΔM_B y,   y optimal

with E the equations and B the rows that hold with equality in every optimal y.

Source: Gal, Postoptimal analyses, parametric programming, and related topics (1995), chapter 2; Golshtein's theorem on
the marginal values of convex programs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from jld_core import plugins, tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import Status
from jld_core.limit.result import LimitAnalysisResult
from jld_core.parameters import typed
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import ClarabelSolver, HighsSolver, RawStatus, is_large
from jld_core.strengths import CRITERIA, STANDARD, Route
from jld_core.threads import one_thread

_ROUTE: Final = Route("rates of λ with strengths", STANDARD | CRITERIA)  # faces with a criterion have none

_STEP: Final = 1e-7  # step of the finite difference of program data, relative to the parameter

# Programs with cones (in space, and where joints crush) are solved at two steps to either side, and the rates
# extrapolated. This is the larger step, relative to the parameter.
_LARGER_STEP: Final = 1e-3

# Ratio of the smaller step to the larger. A kink stays as steps shrink; curvature (crushing, friction cone) vanishes.
_STEP_RATIO: Final = 0.1

# Rate relative to λ/p below which no kink is reported for programs with cones, which are solved to 1e-10
_SMALL_RATE: Final = 1e-4

_DOUBT: Final = 1e-3  # difference of the rates by multipliers and by steps, over λ/p, below which the first are taken

_SLACK: Final = 1e-7  # row tolerance of the programs for one-sided rates, as optimal points are known only to rounding

# Relative difference of the two one-sided rates of a linear program below which they count as equal
_EQUAL: Final = 1e-3

_KINK: Final = 1e-2  # relative difference of the two chord slopes of a program with cones above which λ has a kink


@dataclass(frozen=True)
class Sensitivity:
    derivative: float  # two-sided rate; NaN where λ has a kink, or where the rate is not known well enough
    left: float  # rate for a decrease of the parameter, NaN where unknown
    right: float  # rate for an increase of the parameter, NaN where unknown
    unit: str

    def to_json(self) -> dict[str, float | str | None]:
        """Return the fields as plain numbers, None for a rate that is not finite."""
        rates = {name: getattr(self, name) for name in ("derivative", "left", "right")}
        return {**{name: value if math.isfinite(value) else None for name, value in rates.items()}, "unit": self.unit}


@typed
@one_thread()
def sensitivities(result: LimitAnalysisResult) -> dict[str, Sensitivity]:
    """Compute the rates of λ with friction, shear strength, tensile strength and weight.

    Parameters
    ----------
    result : LimitAnalysisResult
        Result under convex contact and associative friction, without effective areas. With load cases, the rates are
        those of the governing factor, by the case that governs.

    Returns
    -------
    dict of str to Sensitivity
        Rates by name: `friction_coefficient` of all dry faces together; `shear_strength` and `tensile_strength` of all
        inner faces together, per stress in units of the scene; `weight` by a factor on self-weight, with live loads
        unchanged. Parameters that are zero or not used by the labelling are omitted. The dict is empty if the status is
        not collapse, for other models (kern bending among them), and for programs that are large for their solver.

    Notes
    -----
    The module docstring states the formulas.
    """
    if result.cases:
        names = [case.name for case in result.assembly.cases]
        required = float(result.assembly.required[names.index(str(result.governing))])
        rates = sensitivities(result.cases[str(result.governing)])
        return {
            name: Sensitivity(rate.derivative / required, rate.left / required, rate.right / required, rate.unit)
            for name, rate in rates.items()
        }
    model = result.model
    supported = model.supports_bounds_over_labellings and model.inner_bending == "uncoupled"
    # With bond the strengths of the program depend on one another.
    if result.status is not Status.COLLAPSE or not supported or result.assembly.members.bond is not None:
        return {}
    analysis = LimitAnalysis(result.assembly)
    if is_large(analysis.template.structure):
        return {}
    base = SolvedProgram(analysis, result.labels)
    rates_by_name = {}
    for name, change, unit in _parameters(result.assembly, result.labels):
        rates_by_name[name] = base.sensitivity(change, unit)
    return rates_by_name


@dataclass(frozen=True)
class _Change:
    """One parameter of an assembly that can be increased by a step."""

    size: float  # scale of the parameter, to which steps are relative: the least strength, or 1 for weight
    strength: str = ""  # field of `Strengths`; "" for weight

    def of(self, assembly: Assembly, step: float) -> Assembly:
        """Return an assembly with a strength of all faces but members, or the share of weight, increased by `step`."""
        if self.strength:
            strengths = assembly.strengths(_ROUTE)
            values = getattr(strengths, self.strength) + step * ~assembly.of_members
            return assembly.with_strengths(replace(strengths, **{self.strength: values}))
        body = np.where(assembly.elements.support[:, None], 0.0, step * assembly.elements.weight)
        dead = assembly.dead_loads
        return replace(assembly, dead_loads=replace(dead, body=dead.body + body))


def _parameters(assembly: Assembly, labels: Bits) -> list[tuple[str, _Change, str]]:
    """List name, change and unit of each parameter that is not zero and that a labelling uses."""
    stress = f"{assembly.units[1]}/{assembly.units[0]}²"
    parameters = []
    for name, strength, faces, unit in (
        ("friction_coefficient", "friction", labels, ""),
        ("shear_strength", "shear", ~labels, stress),
        ("tensile_strength", "tension", ~labels, stress),
    ):
        values = getattr(assembly.strengths(_ROUTE), strength)[faces & ~assembly.of_members]
        if len(values) and np.isfinite(values).all() and values.min() > 0.0:
            parameters.append((name, _Change(float(values.min()), strength), unit))
    if np.any(assembly.elements.weight[assembly.elements.free]):
        parameters.append(("weight", _Change(1.0), "of itself"))
    return parameters


class SolvedProgram:
    """Solved program of one labelling, from which rates of λ with parameters are computed.

    The constructor solves the program and does not check the outcome: the labelling must be known to collapse. The
    module docstring states the formulas.

    Parameters
    ----------
    analysis : LimitAnalysis
        Analysis of associative friction.
    labels : (m,) array of bool
        True = dry.

    Attributes
    ----------
    program : ConicProgram
        The program, scaled.
    point, dual : (columns,) array
        Solution y and multipliers w of the program.
    held : (rows,) array of bool
        Linear rows that count as tight: multiplier larger than slack, as the solver gives both.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits) -> None:
        self._analysis, self.labels = analysis, labels
        self._template = analysis.template
        self.program = self._template.program(labels)
        self._solver = ClarabelSolver(1e-10, iterative_refinement_enable=True)
        raw = self._solver.solve(self.program)
        self.point, self.dual = raw.point, raw.dual
        slack = self.program.rhs - self.program.matrix @ self.point
        structure = self.program.structure
        self.first, self.last = structure.equalities, structure.equalities + structure.linear
        held = np.zeros(len(slack), dtype=bool)
        held[self.first : self.last] = (self.dual > slack)[self.first : self.last]
        self.held: Bools = held

    def sensitivity(self, change: _Change, unit: str) -> Sensitivity:
        """Return dλ per unit of a change; NaN where both sides differ or are unsure."""
        step = _STEP * change.size
        above, below = self._program_at(change, step), self._program_at(change, -step)
        matrix = sp.csr_array((above.matrix - below.matrix) / (2.0 * step))
        rhs = (above.rhs - below.rhs) / (2.0 * step)
        scale = self._template.scaling.load
        value = scale * float(self.dual @ (rhs - matrix @ self.point))
        if self.program.structure.cones:
            left, right, kink, noise = self._by_steps(change)
        else:
            right, left = -self.side(matrix, rhs), self.side(-matrix, -rhs)
            kink, noise = abs(right - left), 0.0
        left, right, kink, noise = scale * left, scale * right, scale * kink, scale * noise
        # Rates too small to change λ by more than rounding count as zero.
        cones = bool(self.program.structure.cones)
        share = _SMALL_RATE if cones else tolerances.GAP
        least = share * scale * max(abs(float(self.point[-1])), 1.0) / change.size
        largest = max(abs(left), abs(right), abs(value), least)
        if math.isnan(left) or math.isnan(right):
            # with cones a side without end, beyond which the scene is locked, leaves multipliers without one too
            return Sensitivity(math.nan if cones else value, left, right, unit)
        if kink > (_KINK if cones else _EQUAL) * largest:
            return Sensitivity(math.nan, left, right, unit)
        if not cones:
            return Sensitivity(value, left, right, unit)
        # at friction of 45° multipliers are not unique, and chords are known to few digits: neither is to be believed
        doubt = max(_KINK * largest, _DOUBT / _SMALL_RATE * least, noise)
        unknown = abs(value - 0.5 * (left + right)) > doubt
        return Sensitivity(math.nan, left, right, unit) if unknown else Sensitivity(value, value, value, unit)

    def _program_at(self, change: _Change, step: float) -> ConicProgram:
        """Build the program with a parameter increased by `step`, in the original scaling."""
        assembly = change.of(self._template.assembly, step)
        return Template(assembly, self._template.scaling).program(self.labels)

    def _by_steps(self, change: _Change) -> tuple[float, float, float, float]:
        """Compute left and right rate of scaled λ, size of the kink, rounding error, from chords at two steps."""
        # The size of the kink excludes curvature, which vanishes as steps shrink, and rounding, which is estimated from
        # the difference of primal and dual values.
        value, noise = self._value(self.program)
        chords, kinks, noises = [], [], []
        for step in (_LARGER_STEP * change.size, _STEP_RATIO * _LARGER_STEP * change.size):
            (below, low), (above, high) = (self._value(self._program_at(change, by)) for by in (-step, step))
            left, right = (value - below) / step, (above - value) / step
            chords.append((left, right))
            noises.append((2.0 * noise + low + high) / step)
            kinks.append(abs(right - left) - noises[-1])
        (far_left, far_right), (left, right) = chords
        # f(x + h) = f + f' h + f'' h²/2: chords differ from f' by a share of h
        share = _STEP_RATIO / (1.0 - _STEP_RATIO)
        kink = max(0.0, min(kinks[0], kinks[1] + share * (kinks[1] - kinks[0])))
        return left + share * (left - far_left), right + share * (right - far_right), kink, min(noises)

    def _value(self, program: ConicProgram) -> tuple[float, float]:
        """Return λ of a program and primal less dual λ, scaled; NaN without a solution."""
        raw = self._solver.solve(program)
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            return math.nan, math.nan
        primal, dual = float(raw.point[-1]), float(program.rhs @ raw.dual)
        return 0.5 * (primal + dual), abs(primal - dual)

    def side(self, matrix: sp.csr_array, rhs: Floats) -> float:
        """Compute the rate of −λ for rates ΔM (rows, columns), Δr (rows,) of the program, scaled; NaN without."""
        # The rate is the value of the linear program in the module docstring.
        equal = np.arange(self.first)
        held_rows = np.flatnonzero(self.held)
        loose = np.setdiff1d(np.arange(self.first, self.last), held_rows)
        rows, count = sp.csr_array(self.program.matrix), len(self.point)
        tight = np.concatenate([equal, held_rows])
        zeros = sp.csr_array((len(tight), count))
        program = pack(
            sp.vstack(
                [
                    sp.hstack([rows[tight], zeros]),
                    sp.hstack([matrix[equal], rows[equal]]),
                    sp.hstack([rows[loose], sp.csr_array((len(loose), count))]),
                    sp.hstack([matrix[held_rows], rows[held_rows]]),
                ]
            ),
            np.concatenate([self.program.rhs[tight], rhs[equal], self.program.rhs[loose], rhs[held_rows]]),
            np.concatenate([np.zeros(count), self.program.objective]),
            len(tight) + len(equal),
            len(loose) + len(held_rows),
            (),
        )
        answer = self._solver.solve(program)
        if answer.status not in (RawStatus.OPTIMAL, RawStatus.UNBOUNDED, RawStatus.INFEASIBLE):
            # a simplex ends at a vertex, but takes minutes where an interior point takes a second
            answer = HighsSolver(tolerance=_SLACK).solve(program)
        return float(program.objective @ answer.point) if answer.status is RawStatus.OPTIMAL else math.nan


@dataclass(frozen=True)
class GeometrySensitivities:
    """Derivatives of λ by the positions of the v vertices of a structure.

    Elements and interfaces that share a vertex move together with it. Loads with a stated place stay there.

    Parameters
    ----------
    vertices : (v, d) array
        Positions, scene units.
    derivative : (v, d) array
        ∂λ/∂(position), 1/length; NaN where λ has a kink.
    left, right : (v, d) array
        Rates for a decrease and for an increase of each coordinate; NaN where unknown.
    """

    vertices: Floats
    derivative: Floats
    left: Floats
    right: Floats

    def to_json(self) -> dict[str, Any]:
        """Return the fields as lists, None for a rate that is not finite."""
        return {
            name: [[float(x) if math.isfinite(x) else None for x in row] for row in getattr(self, name)]
            for name in ("vertices", "derivative", "left", "right")
        }


@typed
def geometry_sensitivities(result: LimitAnalysisResult, *, one_sided: bool = True) -> GeometrySensitivities | None:
    """Compute the derivatives of λ by the positions of all vertices.

    Parameters
    ----------
    result : LimitAnalysisResult
        Result under associative friction and convex contact, without effective areas; in space also with dry faces
        alone and without compressive strength. With load cases the rates are those of the governing factor.
    one_sided : bool
        Look for kinks in the plane. False: the derivative is that of the forces and the mechanism of the result, and
        rates to either side are unknown.

    Returns
    -------
    GeometrySensitivities or None
        Rates in scene units. None where the status is not collapse, for other models, or under pressure on faces.

    Notes
    -----
    docs/method.md (11.1) to (11.5). In the plane, λ has one-sided rates where forces or mechanism are not unique. In
    space the derivative is that of the forces and the mechanism of the result, and kinks are not looked for. A vertex
    of a face with more than three corners cannot move alone in space: only sums over motions that keep faces plane
    have a meaning.

    Examples
    --------
    >>> rates = geometry_sensitivities(solve("scenes/flat_beam_arch.json"))
    >>> rates.derivative[0]
    """
    rates: GeometrySensitivities | None = plugins.part("geometry_sensitivities")(result, one_sided=one_sided)
    return rates
