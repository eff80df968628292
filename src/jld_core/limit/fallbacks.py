"""Solution methods for one labelling, in the order in which they are tried, each only where it is needed.

Each entry of `FALLBACKS` has a name, the condition under which it is tried, and the bounds that it may supply. `Prover`
checks every bound before it counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from jld_core.limit.proof import Proof
from jld_core.limit.proof_attempt import ProofAttempt


@dataclass(frozen=True)
class Fallback:
    """One named solution method with the condition under which it is tried."""

    name: str
    when: Callable[[ProofAttempt], bool]  # takes the `ProofAttempt`; returns True if the method is to be tried
    # takes the `ProofAttempt`, tries the method and offers its bounds to `ProofAttempt.proof`
    run: Callable[[ProofAttempt], None]
    supplies: str  # description of the bounds that the method may supply


FALLBACKS: Final = (
    Fallback(
        "batch solver",
        lambda attempt: attempt.batch_goes_first,
        ProofAttempt.try_batch_solver_first,
        "both bounds, where one labelling alone is analysed",
    ),
    Fallback(
        "first solver",
        lambda attempt: not attempt.settled_by_batch,
        ProofAttempt.solve_by_first_solver,
        "both bounds, from forces and multipliers of an interior point",
    ),
    Fallback(
        "Schur complement",
        lambda attempt: attempt.inaccurate_at_medium_size,
        ProofAttempt.solve_by_schur_complement,
        "both bounds of a linear program of some thousand equations",
    ),
    Fallback(
        "mechanism",
        lambda attempt: attempt.lacks_large_mechanism,
        ProofAttempt.find_mechanism,
        "an upper bound of a large linear program, from the signs of multipliers",
    ),
    Fallback(
        "Schur complement stopped early",
        lambda attempt: attempt.stalled_with_cones,
        ProofAttempt.solve_until_narrow,
        "both bounds of a program with cones, from an iterate before the last",
    ),
    Fallback(
        "repair",
        lambda attempt: attempt.open_with_point,
        ProofAttempt.repair_answer,
        "states blended with a strictly admissible one, opened motions, rays",
    ),
    Fallback(
        "ray by batch solver",
        lambda attempt: attempt.reported_unbounded,
        ProofAttempt.solve_by_batch_solver,
        "a ray, where some faces can only be unloaded",
    ),
    # Try a vertex before a boundary state: it separates unstable structures from those that barely stand.
    Fallback(
        "dual simplex",
        lambda attempt: attempt.open and attempt.is_small_linear,
        ProofAttempt.solve_by_dual_simplex,
        "both bounds of a linear program, exact to rounding",
    ),
    Fallback(
        "boundary state",
        lambda attempt: attempt.open_with_point,
        ProofAttempt.find_boundary_state,
        "a state in yield sets without interior",
    ),
    Fallback(
        "ray",
        lambda attempt: attempt.may_be_unbounded,
        ProofAttempt.find_ray,
        "a ray, where the solver stopped at a very large λ",
    ),
    Fallback(
        "ray with self-stress",
        lambda attempt: attempt.may_be_unbounded and bool(attempt.template.structure.cones),
        ProofAttempt.find_ray_with_self_stress,
        "a ray that is admissible together with a self-stress that grows faster",
    ),
    Fallback(
        "self-stress",
        lambda attempt: attempt.open_after_reduction,
        ProofAttempt.find_self_stress_states,
        "a state that relies on a self-stress at the boundary of the friction cones",
    ),
    Fallback(
        "no margin",
        lambda attempt: attempt.open,
        ProofAttempt.solve_without_margin,
        "both bounds, for yield sets that leave no margin",
    ),
    Fallback(
        "boundary state again",
        lambda attempt: attempt.open_with_point,
        ProofAttempt.find_boundary_state,
        "a state in yield sets without interior, from the more accurate answer",
    ),
    Fallback(
        "less margin",
        lambda attempt: attempt.wide_by_crushing,
        ProofAttempt.solve_with_less_margin,
        "a narrower bracket of crushable scenes",
    ),
    Fallback(
        "narrow bracket",
        lambda attempt: attempt.wide_for_single_labelling,
        ProofAttempt.narrow_bracket,
        "digits of λ that a wide bracket leaves open",
    ),
    Fallback(
        "small λ",
        lambda attempt: attempt.wide_relative_to_load_factor and attempt.is_small_linear,
        ProofAttempt.solve_by_dual_simplex,
        "a bracket that shows whether λ is small or zero",
    ),
    Fallback(
        "batch solver last",
        lambda attempt: attempt.open,
        ProofAttempt.try_batch_solver_last,
        "bounds where all others left some open",
    ),
)
"""Solution methods that `LimitAnalysis.prove` tries by default, in order."""


def insert_before(fallbacks: tuple[Fallback, ...], name: str, inserted: Fallback) -> tuple[Fallback, ...]:
    """Return fallbacks with one more before the one of a name; ValueError for an unknown name."""
    names = [fallback.name for fallback in fallbacks]
    if name not in names:
        raise ValueError(f"there is no fallback {name!r}; expected one of {', '.join(names)}")
    place = names.index(name)
    return (*fallbacks[:place], inserted, *fallbacks[place:])


def run_fallbacks(attempt: ProofAttempt, fallbacks: tuple[Fallback, ...]) -> Proof:
    """Run every method whose condition holds, in order, until the attempt is settled."""
    limit = attempt.analysis.options.seconds
    until = math.inf if limit is None else time.perf_counter() + limit
    for fallback in fallbacks:
        if attempt.proof.solve_log and time.perf_counter() > until:
            break
        if fallback.when(attempt) and not attempt.settled:
            fallback.run(attempt)
            if not attempt.settled:
                attempt.proof.status = attempt.analysis.status_of(attempt.proof)
    return attempt.proof
