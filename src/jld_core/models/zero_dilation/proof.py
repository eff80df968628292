"""Convert the result of a zero-dilation search into a proof."""

from __future__ import annotations

from jld_core.limit import LimitAnalysis, Proof, Status, number, relative_width
from jld_core.models.zero_dilation.primal_dual_pair import PrimalDualPair


def pair_proof(associative: Proof, analysis: LimitAnalysis, pair: PrimalDualPair | None, solves: int) -> Proof:
    """Convert a pair of forces and velocities into a proof of its load factor.

    associative: associative proof of the same labels. pair: best pair of the search. Without one, the proof keeps the
    status of the associative analysis. A pair that has not converged gives an uncertified proof. solves: number of
    programs of the search.
    """
    converged = pair is not None and bool(pair.converged)
    proof = Proof(
        status=associative.status,
        stands=associative.stands,
        associative=associative.load_factor,
        solves=solves + associative.solves,
        solve_log=[*associative.solve_log, f"zero dilation ({solves})"],
    )
    if pair is not None:
        proof.status, proof.motion, proof.found = Status.UNCERTIFIED, pair.motion, pair.state
        proof.offer_state(pair.state)
        if pair.locked:
            proof.status = Status.LOCKED
        elif converged and relative_width(*proof.bracket, analysis.load_scale) <= analysis.gap:
            proof.status = Status.COLLAPSE
    proof.extra = {
        "associative_load_factor": number(associative.load_factor * analysis.template.scaling.load),
        "friction_violation": None if pair is None else number(pair.violation),
        "complementarity_gap": None if pair is None else number(pair.relative_gap),
        "dilation": None if pair is None else number(pair.dilation),
        "converged": converged or proof.status in (Status.LOCKED, Status.UNSTABLE),
        "bracket_of": "problem with friction frozen at μN of these forces",
        "zero_dilation_iterations": solves,
    }
    return proof
