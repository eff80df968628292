"""Collapse without dilation by a scheme that is handed in, for measurements and tests; `solve` takes its own."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from jld_core import Assembly, LimitAnalysis, LimitAnalysisResult, tolerances
from jld_core.arrays import Bits
from jld_core.limit import Proof, result_of
from jld_dilation.fixed_point_search import ProximalOptions
from jld_dilation.range import prove_zero_dilation


def zero_dilation(
    analysis: LimitAnalysis,
    labels: Bits | None = None,
    scheme: ProximalOptions | None = None,
    *,
    associative: Proof | None = None,
    stands: bool = True,
) -> LimitAnalysisResult:
    """The result of `prove_zero_dilation`; labels: (m,) True dry, default the assembly's own."""
    start = time.perf_counter()
    labels = analysis.assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    scheme = scheme or ProximalOptions()
    proof = prove_zero_dilation(analysis, labels, scheme, associative=associative, stands=stands)
    options = replace(analysis.options, friction="zero-dilation", effective_area=scheme.effective_area)
    elapsed = time.perf_counter() - start
    return result_of(analysis.template, labels, options, proof, assemble=analysis.seconds, elapsed=elapsed)


def solve_zero_dilation(
    assembly: Assembly, labels: Bits | None = None, *, gap: float = tolerances.GAP, **options: Any
) -> LimitAnalysisResult:
    """Zero-dilation limit analysis of one labelling in one call; options: fields of `ProximalOptions`. See
    `zero_dilation`."""
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    return zero_dilation(LimitAnalysis(assembly, gap=gap, reference=own), own, ProximalOptions(**options))
