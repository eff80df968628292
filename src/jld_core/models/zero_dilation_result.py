"""The result of a search without dilation, in scene units."""

from __future__ import annotations

import math
import time

from jld_core import tolerances
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Status, element_velocities, number, relative_width
from jld_core.models.zero_dilation_search import Pair


def result_of(
    associative: LimitAnalysisResult,
    analysis: LimitAnalysis,
    pair: Pair | None,
    solves: int,
    start: float,
) -> LimitAnalysisResult:
    """The result in scene units; where there is no pair, associative friction has decided."""
    scaling, nan = analysis.template.scaling, math.nan
    status, load, bracket, gap = associative.status, nan, (nan, nan), nan
    forces = mechanism = None
    converged = pair is not None and bool(pair.converged)
    if pair is not None:
        low = pair.state.load * scaling.load if pair.state.admissible else nan
        high = pair.motion.bound * scaling.load if pair.motion is not None else nan
        bracket, load, status = (low, high), pair.state.load * scaling.load, Status.UNCERTIFIED
        floor = tolerances.GAP_FLOOR * analysis.assembly.total_dead / analysis.assembly.total_live
        gap = relative_width(low, high, floor)
        forces = pair.state.forces * scaling.face
        if pair.motion is not None:
            mechanism = element_velocities(analysis.template, pair.motion.velocity)
        if pair.locked:
            status, load, bracket, gap = Status.LOCKED, nan, (low, nan), nan
        elif converged and pair.state.admissible and gap <= analysis.gap:
            status = Status.COLLAPSE
    elapsed = time.perf_counter() - start
    return LimitAnalysisResult(
        assembly=analysis.assembly,
        labels=associative.labels,
        status=status,
        load_factor=load,
        bracket=bracket,
        gap=gap,
        stands_at_zero=associative.stands_at_zero,
        forces=forces,
        mechanism=mechanism,
        iterations=solves + associative.iterations,
        route=(*associative.route, f"zero dilation ({solves})"),
        seconds={"assemble": analysis.seconds, "solve": elapsed, "total": analysis.seconds + elapsed},
        friction="zero-dilation",
        contact=associative.contact,
        extra={
            "associative_load_factor": number(associative.load_factor),
            "friction_violation": None if pair is None else number(pair.violation),
            "complementarity_gap": None if pair is None else number(pair.relative_gap),
            "dilation": None if pair is None else number(pair.dilation),
            "converged": converged or status in (Status.LOCKED, Status.UNSTABLE),
            "bracket_of": "problem with friction frozen at μN of these forces",
            "zero_dilation_iterations": solves,
        },
    )
