"""Upper bounds c_f on the normal force of planar faces in all layouts that reach a load factor T (6.7).

A block relaxation averages the forces of a face over many blocks, each of which may be pressed without limit. The dual
is a mechanism with a unit dislocation at f; c_f is computed from the velocities that the solver returned.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.deadline import Deadline
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_program import CappedWedge
from jld_core.limit.case_relaxation import Relaxation
from jld_core.solvers import highs_of

_SOLVER = {"threads": 1, "solver": "simplex", "presolve": "off"}


class NormalCaps:
    """Caps (m,) on the scaled normal forces of the faces of all labellings that agree where `undecided` is False.

    TypeError where joints may crush or are spatial.
    """

    def __init__(self, analysis: LimitAnalysis, labels: Bits, undecided: Bools) -> None:
        self._template, self._prover = analysis.template, analysis.prover
        self._labels, self._undecided = labels, undecided
        dry, inner = (self._template.yield_set.coulomb_wedge(label) for label in (True, False))
        if dry is None or inner is None:
            raise TypeError("normal forces are bounded for planar joints that do not crush")
        self._wedges = (dry, inner)
        self._opening = analysis.repair.opening()
        self._program = Relaxation(analysis).program(labels, undecided)
        self.caps = np.full(len(labels), math.inf)

    @property
    def unit(self) -> float:
        """Return λ in scene units per scaled λ."""
        return self._template.scaling.load

    def tighten(self, threshold: float, most: float, deadline: Deadline) -> None:
        """Lower the caps for labellings whose scaled λ is from `threshold` to `most`, as far as time allows."""
        program, s = self._program, self._program.structure
        faces = len(self._labels)
        place = 3 * np.arange(faces)  # columns of N
        pick = sp.csr_array((np.ones(faces), (np.arange(faces), place)), shape=(faces, s.shape[1]))
        rows = sp.vstack([program.matrix.tocsr(), pick]).tocsc()
        low = np.full(rows.shape[0], -np.inf)
        low[: s.equalities] = program.rhs[: s.equalities]
        high = np.concatenate([program.rhs, self.caps])
        high[s.equalities] = -threshold
        free = np.full(s.shape[1], np.inf)
        highs = highs_of(rows, np.zeros(s.shape[1]), low, high, -free, free, _SOLVER)
        for f in range(faces):
            if deadline.passed():
                break
            highs.changeColCost(int(place[f]), -1.0)
            highs.run()
            dual = -np.array(highs.getSolution().row_dual)
            highs.changeColCost(int(place[f]), 0.0)
            cap = self._cap(dual[: s.equalities], f, threshold, most)
            if cap < self.caps[f]:
                self.caps[f] = max(cap, 0.0)
                highs.changeRowBounds(int(s.shape[0] + f), -np.inf, self.caps[f])

    def _cap(self, velocity: Floats, face: int, threshold: float, most: float) -> float:
        """Return the bound on N of a face that velocities prove; inf where they prove none."""
        if not np.isfinite(velocity).all():
            return math.inf
        velocities = [velocity]
        if self._opening is not None:
            step = 1e-9 * float(abs(velocity).max(initial=1.0)) / float(abs(self._opening.velocity).max())
            velocities.append(velocity + step * self._opening.velocity)
        return min(self._value(one, face, threshold, most) for one in velocities)

    def _value(self, velocity: Floats, face: int, threshold: float, most: float) -> float:
        template, every = self._template, np.arange(len(self._labels))
        jumps = self._prover.jumps(velocity[None])[0].copy()
        jumps[face, 0] -= 1.0
        dry, inner = (CappedWedge(wedge, self.caps).dissipation(jumps, every) for wedge in self._wedges)
        cost = np.where(self._undecided, np.maximum(dry, inner), np.where(self._labels, dry, inner))
        work = float(template.live @ velocity)
        load = threshold if work >= 0.0 else most
        size = float(
            abs(cost).sum() + abs(template.dead) @ abs(velocity) + abs(load) * abs(template.live) @ abs(velocity)
        )
        return float(cost.sum() - template.dead @ velocity - load * work) + tolerances.ROUNDING * size
