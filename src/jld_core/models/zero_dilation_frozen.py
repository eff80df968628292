"""A cheap bound without dilation: λ with friction frozen at the least N of each face, again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from jld_core.arrays import Bits, Floats
from jld_core.limit import LimitAnalysis
from jld_core.mechanics import PrescribedFriction

_ROUNDS: Final = 8


def frozen_friction(
    analysis: LimitAnalysis, labels: Bits, least: Callable[[float], Floats]
) -> Iterator[tuple[float, int]]:
    """Bounds, scaled, each with the programs that it took; every next one asks for the least N above the last.

    least: λ → (m,) least N of each face in states of λ no lower. Every solution has the λ of its own frozen friction,
    which rises with N. Each bound is the proven lower end of a bracket.
    """
    base, bound = analysis.template.yield_set.associative, 0.0
    for _ in range(_ROUNDS):
        template = analysis.template.renumbered(PrescribedFriction(base, 0.0, least(bound)))
        known = LimitAnalysis(analysis.assembly, template=template, gap=analysis.gap, reference=labels)
        proof = known.prove(labels)
        yield proof.low, proof.solves
        bound = max(bound, proof.low)
