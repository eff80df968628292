"""Solve non-associative friction without dilation by frozen associative problems.

A solution is a pair of forces F and velocities u. The forces are in equilibrium with the loads at λ and inside the true
cone |V| ≤ μN. The jumps of the velocities do not dilate, and the complementarity gap

    Γ(F, u) = Σ_dry [N δ + M·θ + μN slip + V·s + MT ω] + Σ_inner [D + F·J] = Σ D_N(J) − b·u − λ ≥ 0

is zero. D_N is the dissipation of the problem whose friction is frozen at μN. For given F, the frozen problem
yields the least Γ: its λ, without any dilation, minus the λ of F. For given u, an associative problem in which every N
costs μ·slip yields it. Γ is convex in either argument alone and never negative. A pair with Γ = 0 is therefore proven,
however it was found. [λ of F, bound of u] is a bracket of the frozen problem with width Γ.

Source: docs/method.md (4.1) to (4.5).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.errors import ParameterError
from jld_core.limit import LimitAnalysis, Proof, Status
from jld_core.models.effective_area import require_rectangles
from jld_core.models.zero_dilation.fixed_point_search import FixedPointSearch, ProximalOptions
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch
from jld_core.models.zero_dilation.proof import pair_proof
from jld_core.models.zero_dilation.range import RangeOptions, load_range
from jld_core.models.zero_dilation.starts import initial_forces

# Largest number of faces for which linear programs in turn are tried after proximal steps did not converge
_SEVERAL: Final = 1000


def prove_zero_dilation(
    analysis: LimitAnalysis,
    labels: Bits,
    options: ProximalOptions | None = None,
    *,
    associative: Proof | None = None,
    stands: bool = False,
    pruning_threshold: float = -math.inf,
    range: float | None = None,
) -> Proof:
    """Prove the load factor of one labelling under friction without dilation.

    analysis: analysis of associative friction, planar or spatial, of whole faces or of point contacts. labels: (m,)
    True = dry. options: parameters of the fixed-point search. associative: associative proof for these labels; computed
    if not given. stands: also decide whether the structure stands at λ = 0. pruning_threshold: λ in scene units at or
    below which the labelling is irrelevant. If the associative upper bound does not exceed this value, the result keeps
    the associative λ (`Proof.outbid`), which no λ without dilation exceeds. range: if given, search for the lowest and
    the highest solution from many starts, and spend this processor time in seconds on a lower bound, see `load_range`.
    Result: λ and the forces `found` are those of an exactly admissible state, and the motion does not dilate. The
    bracket is [λ of the state, bound of the mechanism] for the problem with friction frozen at μN of that state. Its
    width is Γ. The bracket does not bound other zero-dilation solutions, which exist. The upper bound on all solutions
    is `extra["associative_load_factor"]`. `extra` also holds `friction_violation` (max(|V| − μN)⁺ / max N),
    `complementarity_gap` (Γ / dissipation), `converged`, `dilation` (of pressed faces / largest slip), `bracket_of` and
    `zero_dilation_iterations`. The status is `uncertified` if the search did not converge, or if the bracket is wider
    than the gap of the analysis. Raises InputError if a material is missing, for the start "vertex" on a program with
    cones, or for effective areas where they do not apply.

    If the associative problem is locked, the search starts from the state of least forces. Source: Gilbert, Casapulla,
    Ahmed 2006; Iannuzzo et al. 2024, §2.4; docs/method.md (4.3).
    """
    start = time.perf_counter()
    options = options or ProximalOptions()
    if options.effective_area:
        require_rectangles(analysis.assembly, labels)
    if options.start == "vertex" and analysis.template.structure.cones:
        raise ParameterError("start", "'vertex' on a program with cones", "'associative' or 'gravity'")
    associative = associative or analysis.prove(labels, stands=stands)
    collapses = associative.status is Status.COLLAPSE
    if collapses and associative.bracket[1] * analysis.template.scaling.load <= pruning_threshold:
        known = associative.load_factor
        return replace(associative, status=Status.UNCERTIFIED, state=None, associative=known, outbid=True)
    if range is not None:
        proof = load_range(analysis, labels, options, associative, RangeOptions(range, pruning_threshold))
    elif associative.status is Status.UNSTABLE or associative.state is None:
        proof = pair_proof(associative, analysis, None, 0)
    else:
        if associative.status is Status.LOCKED:
            # With alpha > 0, friction grows with the present N and self-stress grows without limit.
            options = replace(options, alpha=0.0)
        search = FixedPointSearch(analysis, labels, options)
        pair = search.pair_from(initial_forces(search, associative, options.start))
        solves = search.solves
        if not pair.is_solution(analysis.gap) and len(labels) <= _SEVERAL:
            multi_start = MultiStartSearch(analysis, labels, options, associative)
            multi_start.close_gap(np.append(pair.state.forces.ravel(), pair.state.load))
            if multi_start.found.lowest is None:
                multi_start.search_random_mechanisms()
            pair, solves = multi_start.found.lowest or pair, solves + multi_start.fixed_point.solves
        proof = pair_proof(associative, analysis, pair, solves)
    proof.seconds = time.perf_counter() - start
    return proof
