"""How low and how high collapse without dilation can be: the ends of what a search from every side finds."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from jld_core.arrays import Bits
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Status, number
from jld_core.models.zero_dilation_found import FromEverySide
from jld_core.models.zero_dilation_result import result_of
from jld_core.models.zero_dilation_search import Scheme


def load_range(
    analysis: LimitAnalysis, labels: Bits, scheme: Scheme, associative: LimitAnalysisResult
) -> LimitAnalysisResult:
    """The lowest certified solution of one labelling, with the highest beside it.

    analysis, labels, scheme, associative: as for `zero_dilation`. The result is that of the lowest solution found;
    `extra` also holds `lowest_found` and `highest_found` (λ, None where no solution was certified), `solutions_found`,
    and `highest`, the evidence of the highest: its λ, violation, dilation and gap, forces and mechanism.
    """
    start = time.perf_counter()
    if associative.status is Status.UNSTABLE:
        return _without_range(result_of(associative, analysis, None, 0, start))
    if associative.status is Status.LOCKED:
        scheme = replace(scheme, alpha=0.0)
    side = FromEverySide(analysis, labels, scheme, associative)
    found = side.search()
    lowest, highest = found.lowest, found.highest
    if lowest is None or highest is None:
        return _without_range(result_of(associative, analysis, found.best, side.run.solves, start))
    result = result_of(associative, analysis, lowest, side.run.solves, start)
    above = result_of(associative, analysis, highest, side.run.solves, start)
    ends = {
        "lowest_found": number(result.load_factor),
        "highest_found": number(above.load_factor),
        "solutions_found": len(found.loads),
        "highest": _evidence(above),
    }
    return replace(result, extra={**result.extra, **ends})


def _without_range(result: LimitAnalysisResult) -> LimitAnalysisResult:
    none = {"lowest_found": None, "highest_found": None, "solutions_found": 0, "highest": None}
    return replace(result, extra={**result.extra, **none})


def _evidence(result: LimitAnalysisResult) -> dict[str, Any]:
    """What a solution is known by, as in the JSON of a result."""
    printed = result.to_json()
    keys = (
        "load_factor",
        "status",
        "gap",
        "friction_violation",
        "dilation",
        "complementarity_gap",
        "forces",
        "mechanism",
    )
    return {key: printed[key] for key in keys}
