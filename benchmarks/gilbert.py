"""The iteration of Gilbert, Casapulla, Ahmed 2006 for friction without dilation, as it is published: N_prev smoothed.

Kept to compare with; the package's own search (`jld_core.models.zero_dilation`) does not go round for ever.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Literal

from jld_core import LimitAnalysis, LimitAnalysisResult, tolerances
from jld_core.arrays import Floats
from jld_core.limit import Proof, result_of
from jld_core.models.zero_dilation.proof import proof_of
from jld_core.models.zero_dilation.search import FixedPointSearch, PrimalDualPair, ProximalOptions
from jld_core.models.zero_dilation.starts import first_forces


@dataclass(frozen=True)
class Smoothing:
    """alpha: share of the present N in friction until all has settled, then none. beta: share of the new N in N_prev.

    start: as of `ProximalOptions`. most: programs.
    """

    alpha: float = 0.01
    beta: float = 0.6
    start: Literal["associative", "gravity", "vertex"] = "associative"
    most: int = 60


def smoothed(analysis: LimitAnalysis, scheme: Smoothing, associative: Proof | None = None) -> LimitAnalysisResult:
    """The result of that iteration for the assembly's own labels, judged as one of the package's own search is."""
    start, labels = time.perf_counter(), analysis.assembly.labels
    associative = associative or analysis.prove(labels)
    search = FixedPointSearch(analysis, labels, ProximalOptions(start=scheme.start, most=scheme.most))
    pair = _iterate(search, scheme, first_forces(search, associative, scheme.start))
    proof = proof_of(associative, analysis, pair, search.solves)
    options = replace(analysis.options, friction="zero-dilation")
    elapsed = time.perf_counter() - start
    return result_of(analysis.template, labels, options, proof, assemble=analysis.seconds, elapsed=elapsed)


def _iterate(search: FixedPointSearch, scheme: Smoothing, forces: Floats) -> PrimalDualPair:
    """Until λ and N have settled, first with α and then without."""
    labels, alpha = search.labels, scheme.alpha
    normals, last, point = search.normals(forces), math.inf, forces
    violation, settled = math.inf, False
    for _ in range(scheme.most - 1):
        template, sets = search.frozen(alpha, normals, None)
        point = search.route.solve(template.program(labels, search.margin)).point
        search.solves += 1
        table = search.table(point)
        excess = max(0.0, float(sets.excess(table, labels).max(initial=0.0)))
        violation = excess / float(table[:, 0].max(initial=1e-300))
        settled = abs(point[-1] - last) <= tolerances.SETTLED * abs(point[-1]) and violation <= tolerances.VIOLATION
        if settled and alpha == 0.0:
            break
        alpha = 0.0 if settled else alpha
        last = float(point[-1])
        normals = scheme.beta * table[:, 0] + (1.0 - scheme.beta) * normals
    # moving these forces into the true cone would cost far more λ than they violate it by
    state = search.analysis.prover.state(point, labels, passes=3)
    pair = search.judge(state, None)
    return replace(pair, violation=violation, settled=settled and alpha == 0.0) if pair.motion is not None else pair
