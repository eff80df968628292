"""How λ changes with strengths and weight: from the multipliers of one program, one-sided where they differ.

λ is the value of a program max λ, M(p) y + s = r(p). With optimal y and multipliers w, and Δ the derivative by p,

    dλ/dp = w·(Δr − ΔM y)

wherever both are unique. Else λ has a derivative to either side; in the plane each is the value of a linear program
over all optimal y and the directions z in which they may move,

    λ'(p+) = max −q·z   subject to   M_E z = Δr_E − ΔM_E y,   M_B z ≤ Δr_B − ΔM_B y,   y optimal

E the equations, B the rows that hold with equality in every optimal y. With cones (in space, and where joints crush)
both sides come from programs solved two steps away, extrapolated. Source: Gal, Postoptimal analyses, parametric
programming, and related topics (1995), chapter 2; Golshtein's theorem on the marginal values of convex programs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Status
from jld_core.program import ConicProgram, Template, pack
from jld_core.solvers import ClarabelSolver, HighsSolver, RawStatus, is_large
from jld_core.threads import one_thread

_STEP: Final = 1e-7
"""Step of parameters, relative to what they are, by which programs are differentiated."""

_FAR: Final = 1e-3
"""Step at which programs with cones are solved again, relative to the parameter."""

_NEARER: Final = 0.1
"""Second step of these over the first. Kinks stay as steps shrink, curvature (crushing, friction's circle) does not."""

_FAINT: Final = 1e-4
"""Rate over λ/p below which programs with cones, solved to 1e-10, do not tell a kink by such steps."""

_SLACK: Final = 1e-7
"""By how much rows may be missed where both sides are sought: optimal points are known to rounding."""

_ALIKE: Final = 1e-3
_BENT: Final = 1e-2
"""Relative difference of the two sides below which they are one; where they are chords, λ bends between their ends."""


@dataclass(frozen=True)
class Sensitivity:
    """Rate of λ by one number. unit: what it is by. left, right: for less and for more of it, NaN where not known.

    derivative: of both sides where they agree, else NaN: λ then has a kink at what the scene says.
    """

    derivative: float
    left: float
    right: float
    unit: str

    def to_json(self) -> dict[str, float | str | None]:
        """Plain numbers, None where there is none."""
        plain = {name: getattr(self, name) for name in ("derivative", "left", "right")}
        return {**{name: value if math.isfinite(value) else None for name, value in plain.items()}, "unit": self.unit}


@one_thread()
def sensitivities(result: LimitAnalysisResult) -> dict[str, Sensitivity]:
    """∂λ by friction, shear and tensile strength and weight, by name; empty where the result has no λ or no program.

    result: of convex contact and associative friction without effective areas. With load cases: of the governing
    factor, by the case that governs. friction_coefficient: of all dry faces together; shear_strength, tensile_strength:
    of all inner ones, by scene stress; weight: by a factor on self-weight, live loads left as they are.
    """
    if result.cases:
        names = [case.name for case in result.assembly.cases]
        required = float(result.assembly.required[names.index(str(result.governing))])
        one = sensitivities(result.cases[str(result.governing)])
        return {
            name: Sensitivity(s.derivative / required, s.left / required, s.right / required, s.unit)
            for name, s in one.items()
        }
    model = result.model
    plain = model.modular and model.inner_bending == "paper"
    if result.status is not Status.COLLAPSE or not plain:
        return {}
    analysis = LimitAnalysis(result.assembly)
    if is_large(analysis.template.structure):
        return {}
    base = _Base(analysis, result.labels)
    found = {}
    for name, change, unit in _parameters(result.assembly, result.labels):
        found[name] = base.sensitivity(change, unit)
    return found


@dataclass(frozen=True)
class _Change:
    """One number and what it is in an assembly. size: what steps are relative to."""

    size: float
    strength: str = ""

    def of(self, assembly: Assembly, step: float) -> Assembly:
        """The assembly with more of it, by a step."""
        if self.strength:
            values = getattr(assembly.strengths, self.strength) + step
            return replace(assembly, strengths=replace(assembly.strengths, **{self.strength: values}))
        more = np.zeros_like(assembly.dead)
        free = assembly.elements.free
        more[free, : assembly.dimension] = step * assembly.elements.weight[free]
        return replace(assembly, dead=assembly.dead + more)


def _parameters(assembly: Assembly, labels: Bits) -> list[tuple[str, _Change, str]]:
    """What λ may be differentiated by: what the labelling has, and is not zero already."""
    stress = f"{assembly.units[1]}/{assembly.units[0]}²"
    found = []
    for name, strength, faces, unit in (
        ("friction_coefficient", "friction", labels, ""),
        ("shear_strength", "shear", ~labels, stress),
        ("tensile_strength", "tension", ~labels, stress),
    ):
        values = getattr(assembly.strengths, strength)[faces]
        if len(values) and np.isfinite(values).all() and values.min() > 0.0:
            found.append((name, _Change(float(values.min()), strength), unit))
    if np.any(assembly.elements.weight[assembly.elements.free]):
        found.append(("weight", _Change(1.0), "of itself"))
    return found


class _Base:
    """The program of one labelling, solved, and what changes of it do."""

    def __init__(self, analysis: LimitAnalysis, labels: Bits) -> None:
        self._analysis, self._labels = analysis, labels
        self._template = analysis.template
        self.program = self._template.program(labels)
        self._solver = ClarabelSolver(1e-10, iterative_refinement_enable=True)
        raw = self._solver.solve(self.program)
        self.point, self.dual = raw.point, raw.dual
        slack = self.program.rhs - self.program.matrix @ self.point
        structure = self.program.structure
        self._first, self._last = structure.equalities, structure.equalities + structure.linear
        held = np.zeros(len(slack), dtype=bool)
        held[self._first : self._last] = (self.dual > slack)[self._first : self._last]
        self._held: Bools = held

    def sensitivity(self, change: _Change, unit: str) -> Sensitivity:
        """The rate of λ by one number, scene units."""
        step = _STEP * change.size
        more, less = self._moved(change, step), self._moved(change, -step)
        matrix = sp.csr_array((more.matrix - less.matrix) / (2.0 * step))
        rhs = (more.rhs - less.rhs) / (2.0 * step)
        scale = self._template.scaling.load
        value = scale * float(self.dual @ (rhs - matrix @ self.point))
        if self.program.structure.cones:
            left, right, bent = self._by_steps(change)
        else:
            right, left = -self._side(matrix, rhs), self._side(-matrix, -rhs)
            bent = abs(right - left)
        left, right, bent = scale * left, scale * right, scale * bent
        # rates that do not change λ by more than rounding, whatever is done, are none
        cones = bool(self.program.structure.cones)
        faint = _FAINT if cones else tolerances.GAP
        least = faint * scale * max(abs(float(self.point[-1])), 1.0) / change.size
        largest = max(abs(left), abs(right), abs(value), least)
        if math.isnan(left) or math.isnan(right):
            return Sensitivity(value, left, right, unit)
        if bent > (_BENT if cones else _ALIKE) * largest:
            return Sensitivity(math.nan, left, right, unit)
        return Sensitivity(value, value, value, unit) if cones else Sensitivity(value, left, right, unit)

    def _moved(self, change: _Change, step: float) -> ConicProgram:
        """The program with more of a number, in the units of the first."""
        assembly = change.of(self._template.assembly, step)
        return Template(assembly, self._template.scaling).program(self._labels)

    def _by_steps(self, change: _Change) -> tuple[float, float, float]:
        """One-sided rates by chords of two steps, and by how much they differ beyond curvature and rounding.

        A kink stays as steps shrink, curvature does not. Primal and dual values of a program say how well λ is known.
        """
        here, noise = self._value(self.program)
        chords, kinks = [], []
        for step in (_FAR * change.size, _NEARER * _FAR * change.size):
            (below, low), (above, high) = (self._value(self._moved(change, by)) for by in (-step, step))
            left, right = (here - below) / step, (above - here) / step
            chords.append((left, right))
            kinks.append(abs(right - left) - (2.0 * noise + low + high) / step)
        (far_left, far_right), (left, right) = chords
        # f(x + h) = f + f' h + f'' h²/2: chords differ from f' by a share of h
        share = _NEARER / (1.0 - _NEARER)
        bent = max(0.0, min(kinks[0], kinks[1] + share * (kinks[1] - kinks[0])))
        return left + share * (left - far_left), right + share * (right - far_right), bent

    def _value(self, program: ConicProgram) -> tuple[float, float]:
        """λ of a program by the solver, and the difference of its primal and dual values."""
        raw = self._solver.solve(program)
        primal, dual = float(raw.point[-1]), float(program.rhs @ raw.dual)
        return 0.5 * (primal + dual), abs(primal - dual)

    def _side(self, matrix: sp.csr_array, rhs: Floats) -> float:
        """Rate of −λ to one side, scaled: matrix, rhs change at these rates; NaN where no program says so."""
        equal = np.arange(self._first)
        held = np.flatnonzero(self._held)
        loose = np.setdiff1d(np.arange(self._first, self._last), held)
        rows, count = sp.csr_array(self.program.matrix), len(self.point)
        tight = np.concatenate([equal, held])
        none = sp.csr_array((len(tight), count))
        stated = pack(
            sp.vstack(
                [
                    sp.hstack([rows[tight], none]),
                    sp.hstack([matrix[equal], rows[equal]]),
                    sp.hstack([rows[loose], sp.csr_array((len(loose), count))]),
                    sp.hstack([matrix[held], rows[held]]),
                ]
            ),
            np.concatenate([self.program.rhs[tight], rhs[equal], self.program.rhs[loose], rhs[held]]),
            np.concatenate([np.zeros(count), self.program.objective]),
            len(tight) + len(equal),
            len(loose) + len(held),
            (),
        )
        answer = HighsSolver(tolerance=_SLACK).solve(stated)
        return float(stated.objective @ answer.point) if answer.status is RawStatus.OPTIMAL else math.nan
