"""Non-associative friction without dilation, by frozen associative problems, docs/method.md (4.1) to (4.5).

A solution is a pair: forces F in equilibrium with the loads at λ and inside the true cone |V| ≤ μN, and
velocities u whose jumps do not dilate, with the complementarity gap

    Γ(F, u) = Σ_dry [N δ + M·θ + μN slip + V·s + MT ω] + Σ_inner [D + F·J] = Σ D_N(J) − b·u − λ ≥ 0

at zero. D_N is the dissipation of the problem whose friction is frozen at μN: for given F the least Γ is found
by that problem (its λ, without any dilation, less the λ of F), and for given u by an associative problem in
which every N costs μ·slip. Γ is convex in either argument alone and never negative, so a pair that brings it to
zero is proven, whatever led there, and [λ of F, bound of u] is a bracket of the frozen problem of width Γ.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysis, Proof, Status
from jld_core.models.effective_area import require_rectangles
from jld_core.models.zero_dilation.found import MultiStartSearch
from jld_core.models.zero_dilation.proof import proof_of
from jld_core.models.zero_dilation.range import load_range
from jld_core.models.zero_dilation.search import FixedPointSearch, ProximalOptions
from jld_core.models.zero_dilation.starts import first_forces

_SEVERAL: Final = 1000  # faces up to which linear programs in turn are tried where proximal steps do not arrive


def prove_zero_dilation(
    analysis: LimitAnalysis,
    labels: Bits,
    scheme: ProximalOptions | None = None,
    *,
    associative: Proof | None = None,
    stands: bool = False,
    floor: float = -math.inf,
    range: float | None = None,
) -> Proof:
    """Collapse without dilation of one labelling, by an analysis that exists already.

    analysis: of associative friction, planar or spatial, points included. labels: (m,) True dry. associative:
    its proof for these labels where known. stands: also decide λ = 0. floor: λ, scene units, at or below which a
    labelling does not matter: it is left at its associative λ (`Proof.outbid`), which no λ without dilation exceeds.
    range: seek the lowest and the highest solution from every side, and for as many seconds of processor time a bound
    below: see `load_range`.

    The proof: λ and the forces `found` are those of an exactly admissible state, the motion does not
    dilate, and the bracket is [λ of the state, bound of the mechanism] for the problem with friction frozen at
    μN of that state, whose width is Γ; it says nothing of other zero-dilation solutions, which exist. The one
    upper bound on all of them is `extra["associative_load_factor"]`. `extra` also holds `friction_violation`
    (max(|V| − μN)⁺ / max N), `complementarity_gap` (Γ / dissipation), `converged`, `dilation` (of pressed faces
    / largest slip), `bracket_of` and `zero_dilation_iterations`. A run not converged, or a bracket wider than
    the analysis' gap, is `uncertified`. Where associative friction locks, the run starts from the state of
    least forces.
    Raises InputError: missing material; "vertex" on a spatial scene; effective areas on other than rectangles.
    Source: Gilbert, Casapulla, Ahmed 2006; Iannuzzo et al. 2024, §2.4; docs/method.md (4.3).
    """
    start = time.perf_counter()
    scheme = scheme or ProximalOptions()
    if scheme.effective_area:
        require_rectangles(analysis.assembly, labels)
    if scheme.start == "vertex" and analysis.template.structure.cones:
        raise InputError("start", "'vertex' on a program with cones", "'associative' or 'gravity'")
    associative = associative or analysis.prove(labels, stands=stands)
    collapses = associative.status is Status.COLLAPSE
    if collapses and associative.bracket[1] * analysis.template.scaling.load <= floor:
        known = associative.load_factor
        return replace(associative, status=Status.UNCERTIFIED, state=None, associative=known, outbid=True)
    if range is not None:
        proof = load_range(analysis, labels, scheme, associative, range, floor)
    elif associative.status is Status.UNSTABLE or associative.state is None:
        proof = proof_of(associative, analysis, None, 0)
    else:
        if associative.status is Status.LOCKED:
            # whatever friction follows the present N would build up self-stress without end
            scheme = replace(scheme, alpha=0.0)
        search = FixedPointSearch(analysis, labels, scheme)
        pair = search.pair_from(first_forces(search, associative, scheme.start))
        solves = search.solves
        if not pair.solves(analysis.gap) and len(labels) <= _SEVERAL:
            side = MultiStartSearch(analysis, labels, scheme, associative)
            side.close(np.append(pair.state.forces.ravel(), pair.state.load))
            if side.found.lowest is None:
                side.draw()
            pair, solves = side.found.lowest or pair, solves + side.pairs.solves
        proof = proof_of(associative, analysis, pair, solves)
    proof.seconds = time.perf_counter() - start
    return proof
