"""List the fallbacks by which bounds for one labelling are proven, tried only as far as needed.

Each entry of `FALLBACKS` states when it is tried and what it offers. Everything offered is checked by `Prover` before
it counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from jld_core.limit.proof import Proof
from jld_core.limit.proof_attempt import ProofAttempt


@dataclass(frozen=True)
class Fallback:
    """One named solution method with the condition under which it is tried.

    Attributes
    ----------
    name : str
        Name of the fallback.
    when : callable
        Takes the `ProofAttempt`; returns True if the fallback is to be tried.
    take : callable
        Takes the `ProofAttempt` and tries the fallback.
    offers : str
        Bounds that the fallback may supply.
    """

    name: str
    when: Callable[[ProofAttempt], bool]
    take: Callable[[ProofAttempt], None]
    offers: str


FALLBACKS: Final = (
    Fallback(
        "lanes", lambda c: c.alone, ProofAttempt.alone_in_lanes, "both sides by the kernel, of one labelling alone"
    ),
    Fallback(
        "first", lambda c: not c.settled_by_batch, ProofAttempt.solve, "forces and multipliers of an interior point"
    ),
    Fallback(
        "repair",
        lambda c: c.open_inside,
        ProofAttempt.repair_answer,
        "states blended with one well inside, opened motions, rays",
    ),
    Fallback(
        "ray in lanes", lambda c: c.runs_away, ProofAttempt.batched, "a ray where some faces can only be unpressed"
    ),
    # Try a vertex before an edge state: it separates unstable structures from those that barely stand.
    Fallback(
        "vertex",
        lambda c: c.open and c.linear,
        ProofAttempt.vertex,
        "both sides of a linear program, exact to rounding",
    ),
    Fallback("edge", lambda c: c.open_inside, ProofAttempt.edge, "a state where yield sets leave no room"),
    Fallback("ray", lambda c: c.grows, ProofAttempt.ray, "a ray where the solver stopped on its way to infinity"),
    Fallback(
        "ray beside self-stress",
        lambda c: c.grows and bool(c.template.structure.cones),
        ProofAttempt.ray_beside_self_stress,
        "a ray that is admissible beside a self-stress that grows faster",
    ),
    Fallback(
        "self-stress",
        lambda c: c.reduced,
        ProofAttempt.lean,
        "a state that leans on self-stress at friction's boundary",
    ),
    Fallback(
        "unshrunk",
        lambda c: c.open,
        ProofAttempt.unshrunk,
        "an interior point without margin, for sets that leave none",
    ),
    Fallback("last edge", lambda c: c.open_inside, ProofAttempt.edge, "the same, from the better answer"),
    Fallback(
        "less margin", lambda c: c.crushed_wide, ProofAttempt.less_margin, "a narrower bracket of crushable scenes"
    ),
    Fallback("narrow", lambda c: c.wide_alone, ProofAttempt.narrow, "digits of λ that a wide bracket leaves open"),
    Fallback("small λ", lambda c: c.wide_beside_load and c.linear, ProofAttempt.vertex, "whether λ is small or zero"),
)
"""Solution methods that `LimitAnalysis.prove` tries by default, in order."""


def run_fallbacks(attempt: ProofAttempt, fallbacks: tuple[Fallback, ...]) -> Proof:
    """Try all fallbacks whose condition holds, in order.

    Parameters
    ----------
    attempt : ProofAttempt
        Attempt to prove bounds for one labelling; it changes.
    fallbacks : tuple of Fallback
        Solution methods, in the order in which they are tried.

    Returns
    -------
    Proof
        Bounds and status after the last fallback.
    """
    for fallback in fallbacks:
        if fallback.when(attempt) and not attempt.settled:
            fallback.take(attempt)
            if not attempt.settled:
                attempt.proof.status = attempt.analysis.judge(attempt.proof)
    return attempt.proof
