"""Asking the pool before solving, and feeding it with what was solved.

Labellings that a driver asks for together are settled in rounds: the pool settles what it can, then a few of
those it leaves open are solved, and what they prove is added in the order of the round. Which are solved, and
what the pool holds at any time, follows from the labellings asked alone, never from workers or clocks. What
every solve proved is on record beside its evaluation, so that a study that is gone on with has the same pool.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.limit import Status, crossed, load_scale
from jld_core.program import Template
from jld_explore.evaluation.certificates import FEW, ROUND, Bounds, Pool, Proofs, unknown
from jld_explore.evaluation.evaluation import CERTIFICATE, Evaluation
from jld_explore.evaluation.force_method import LARGEST
from jld_explore.evaluation.recorded import RecordedEvaluator, Sent

_MANY: Final = 512
"""Labellings asked together that speak for those to come: fewer do not say what forces will be good for."""

_DIGITS: Final = 9
"""Digits of a scaled bound that tell one family of labellings from another."""


class CertificateEvaluator:
    """Evaluates labellings with a pool, and by another evaluator what the pool leaves open.

    solver: evaluates with proofs. pool: what is known. template: of the assembly. gap: width of a bracket that counts
    as solved.
    """

    def __init__(self, solver: RecordedEvaluator, pool: Pool, template: Template, gap: float) -> None:
        self.solver, self.pool, self.gap = solver, pool, gap
        self.scale = template.scaling.load
        self.floor = load_scale(template.assembly) / self.scale
        self.small = is_small(template)
        self._round_size = FEW if self.small else ROUND
        self._asks = _asks(template.assembly)

    def send(self, labellings: Bits) -> Sent:
        """See `Evaluating`; the pool is asked when the turn of labellings (k, m) comes, as it knows more by then."""
        return Sent(labellings, [], np.empty(0, dtype=np.int64), None)

    def take(self, sent: Sent) -> list[Evaluation] | None:
        """See `Evaluating`."""
        labellings = sent.labellings
        found: list[Evaluation | None] = [None] * len(labellings)
        many = len(labellings) >= _MANY
        bounds = self.pool.ask(labellings)
        # those that ask most of forces first: what carries them carries others as well
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
        known = np.isfinite(bounds.low) & np.isfinite(bounds.high)
        low, high = np.where(known, bounds.low, 0.0), np.where(known, bounds.high, 0.0)
        size = np.maximum(np.maximum(abs(low), abs(high)), self.floor)
        narrow = (high - low <= self.gap * size) & ~crossed(low, high)
        return np.asarray(bounds.unstable | (known & narrow))

    def _evaluation(self, bounds: Bounds, n: int) -> Evaluation:
        if bounds.unstable[n]:
            return Evaluation(Status.UNSTABLE, math.nan, math.nan, math.nan, settled=CERTIFICATE)
        low, high = float(bounds.low[n]) * self.scale, float(bounds.high[n]) * self.scale
        return Evaluation(Status.COLLAPSE, low, high, 0.5 * (low + high), settled=CERTIFICATE)

    def _round(self, high: Floats) -> Ints:
        """Positions of those to solve next: in order, one of each upper bound, any number without one."""
        # a mechanism bounds whole families of labellings by the same number, up to rounding
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
    """Is a labelling solved sooner than it is sent to a worker? Measured on planar walls, with the pool."""
    return not template.structure.cones and len(template.assembly.interfaces) <= LARGEST


def _asks(assembly: Assembly) -> Floats:
    """(m,) what a dry face asks of forces, from 1 to 2: the more, the less the dead load presses it."""
    dead = assembly.elements.weight.sum(axis=0)
    size = float(np.linalg.norm(dead))
    if size == 0.0:
        return np.ones(len(assembly.interfaces))
    return np.asarray(2.0 - abs(assembly.interfaces.normal @ dead) / size)
