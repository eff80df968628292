"""How low and how high collapse without dilation can be: the ends of what a search from every side finds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from jld_core.arrays import Bits
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Proof, Status, number, result_of
from jld_core.models.zero_dilation_found import FromEverySide
from jld_core.models.zero_dilation_proof import proof_of
from jld_core.models.zero_dilation_search import Scheme


def load_range(analysis: LimitAnalysis, labels: Bits, scheme: Scheme, associative: Proof) -> Proof:
    """The lowest certified solution of one labelling, with the highest beside it.

    analysis, labels, scheme, associative: as for `zero_dilation`. The proof is that of the lowest solution found;
    `extra` also holds `lowest_found` and `highest_found` (λ, None where no solution was certified), `solutions_found`,
    and `highest`, the evidence of the highest: its λ, violation, dilation and gap, forces and mechanism.
    """
    if associative.status is Status.UNSTABLE:
        return _without_range(proof_of(associative, analysis, None, 0))
    if associative.status is Status.LOCKED:
        scheme = replace(scheme, alpha=0.0)
    side = FromEverySide(analysis, labels, scheme, associative)
    found = side.search()
    lowest, highest = found.lowest, found.highest
    if lowest is None or highest is None:
        return _without_range(proof_of(associative, analysis, found.best, side.run.solves))
    proof = proof_of(associative, analysis, lowest, side.run.solves)
    above = proof_of(associative, analysis, highest, side.run.solves)
    options = replace(analysis.options, friction="zero-dilation", effective_area=scheme.effective_area)
    unit = analysis.template.scaling.load
    ends = {
        "lowest_found": number(proof.load_factor * unit),
        "highest_found": number(above.load_factor * unit),
        "solutions_found": len(found.loads),
        "highest": _evidence(result_of(analysis.template, labels, options, above, elapsed=0.0)),
    }
    return replace(proof, extra={**proof.extra, **ends})


def _without_range(proof: Proof) -> Proof:
    none = {"lowest_found": None, "highest_found": None, "solutions_found": 0, "highest": None}
    return replace(proof, extra={**proof.extra, **none})


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
