"""Settle labellings by bounds from past solves, solve the others, and add their bounds.

Labellings that a driver requests together are settled in rounds.
The pool settles what it can, then a few of the remaining labellings are solved.
The bounds they prove are added in the order of the round.
The content of the pool and the choice of labellings depend only on the requested labellings.
They do not depend on workers or clocks.
The bounds of every solve are recorded with its evaluation, so that a resumed study has the same pool.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.limit import Status, load_scale
from jld_core.limit.bounds import crossed
from jld_core.program import Template
from jld_explore.evaluation.certificates import FEW, ROUND, Bounds, Pool, Proofs, unknown
from jld_explore.evaluation.evaluation import CERTIFICATE, Evaluation
from jld_explore.evaluation.force_method import LARGEST
from jld_explore.evaluation.recorded import RecordedEvaluator, Sent

_MANY: Final = 512
"""Number of labellings requested together from which they count as representative of later ones."""

_DIGITS: Final = 9
"""Decimal digits of a scaled bound that distinguish one family of labellings from another."""


class CertificateEvaluator:
    """Evaluator that uses bounds from past solves, and another evaluator for the remainder.

    Parameters
    ----------
    solver : RecordedEvaluator
        Evaluator that solves and returns proofs.
    pool : Pool
        Bounds from past solves.
    template : Template
        Program of the assembly.
    gap : float
        Relative width of a bracket that counts as solved.
    """

    def __init__(self, solver: RecordedEvaluator, pool: Pool, template: Template, gap: float) -> None:
        self.solver, self.pool, self.gap = solver, pool, gap
        self.scale = template.scaling.load
        self.floor = load_scale(template.assembly) / self.scale
        self.small = is_small(template)
        self._round_size = FEW if self.small else ROUND
        self._asks = _asks(template.assembly)

    def send(self, labellings: Bits) -> Sent:
        """Store labellings (k, m) for `take`, which queries the pool as late as possible."""
        return Sent(labellings, [], np.empty(0, dtype=np.int64), None)

    def take(self, sent: Sent) -> list[Evaluation] | None:
        """Return the evaluations in the order sent; None if time ran out."""
        labellings = sent.labellings
        found: list[Evaluation | None] = [None] * len(labellings)
        many = len(labellings) >= _MANY
        bounds = self.pool.ask(labellings)
        # Solve the labellings that constrain forces most first, since their forces also carry other labellings.
        left = np.lexsort((*labellings.T[::-1], -np.round(labellings @ self._asks, _DIGITS)))
        while left.size:
            known = self._settled(bounds.take(left))
            if known.any():
                evaluations = [self._evaluation(bounds, n) for n in left[known].tolist()]
                evaluations = self.solver.settle(labellings[left[known]], evaluations)
                for n, evaluation in zip(left[known].tolist(), evaluations, strict=True):
                    found[n] = evaluation
                left = left[~known]
            chosen = self._round(bounds.high[left])
            if not chosen.size:
                break
            picked = left[chosen]
            solved = self.solver.take(self.solver.send(labellings[picked], labellings[left] if many else None))
            if solved is None:
                return None
            now = self.pool.tick()
            for n, evaluation in zip(picked.tolist(), solved, strict=True):
                found[n] = evaluation
                self.pool.add(evaluation.proofs or Proofs())
            left = np.delete(left, chosen)
            news = self.pool.ask(labellings[left], now)
            fresh = unknown(len(labellings))
            fresh.low[left], fresh.high[left], fresh.unstable[left] = news.low, news.high, news.unstable
            bounds = bounds.tightened(fresh)
        return [evaluation for evaluation in found if evaluation is not None]

    def _settled(self, bounds: Bounds) -> Bools:
        """Return a mask of the labellings that are unstable or have a narrow bracket."""
        known = np.isfinite(bounds.low) & np.isfinite(bounds.high)
        low, high = np.where(known, bounds.low, 0.0), np.where(known, bounds.high, 0.0)
        size = np.maximum(np.maximum(abs(low), abs(high)), self.floor)
        narrow = (high - low <= self.gap * size) & ~crossed(low, high)
        return np.asarray(bounds.unstable | (known & narrow))

    def _evaluation(self, bounds: Bounds, n: int) -> Evaluation:
        """Convert the bounds of labelling n to an evaluation in scene units."""
        if bounds.unstable[n]:
            return Evaluation(Status.UNSTABLE, math.nan, math.nan, math.nan, settled=CERTIFICATE)
        low, high = float(bounds.low[n]) * self.scale, float(bounds.high[n]) * self.scale
        return Evaluation(Status.COLLAPSE, low, high, 0.5 * (low + high), settled=CERTIFICATE)

    def _round(self, high: Floats) -> Ints:
        """Return the positions of the labellings to solve next, in order.

        Each finite upper bound is represented once; labellings without an upper bound are not limited.
        The round has at most `_round_size` labellings.
        """
        # A mechanism gives all labellings of a family the same bound, up to rounding.
        value = np.where(np.isfinite(high), np.round(high, _DIGITS), np.inf)
        chosen: list[int] = []
        seen: set[float] = set()
        for position, bound in enumerate(value.tolist()):
            if bound in seen:
                continue
            if math.isfinite(bound):
                seen.add(bound)
            chosen.append(position)
            if len(chosen) == self._round_size:
                break
        return np.array(chosen, dtype=np.int64)


def is_small(template: Template) -> bool:
    """Return True if solving a labelling is faster than sending it to a worker.

    Parameters
    ----------
    template : Template
        Program of the assembly.

    Returns
    -------
    bool
        True for programs without cones and at most `LARGEST` faces; measured on planar walls with the pool.
    """
    return not template.structure.cones and len(template.assembly.interfaces) <= LARGEST


def _asks(assembly: Assembly) -> Floats:
    """Return (m,) weights from 1 to 2 of how much a dry face constrains forces.

    The weight is larger where the dead load presses the face less.
    """
    dead = assembly.elements.weight.sum(axis=0)
    size = float(np.linalg.norm(dead))
    if size == 0.0:
        return np.ones(len(assembly.interfaces))
    return np.asarray(2.0 - abs(assembly.interfaces.normal @ dead) / size)
