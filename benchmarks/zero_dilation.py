"""Plain and robust zero-dilation loops: the given walls by start and damping, and random walls.

Plain is the iteration of Gilbert, Casapulla, Ahmed 2006 as it is published (N_prev smoothed), kept to compare with; the
package's own search (`jld_core.models.zero_dilation`) does not go round for ever.

`python -m benchmarks.zero_dilation [COUNT]` writes benchmarks/results/zero_dilation.md; COUNT random walls (100).
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from studies.by_scheme import zero_dilation
from studies.families import random_wall

from jld_core import Assembly, LimitAnalysis, LimitAnalysisResult, build_assembly, load_scene, tolerances
from jld_core.arrays import Floats
from jld_core.limit import Proof, result_of
from jld_core.models.zero_dilation.fixed_point_search import FixedPointSearch, ProximalOptions
from jld_core.models.zero_dilation.primal_dual_pair import PrimalDualPair
from jld_core.models.zero_dilation.proof import pair_proof
from jld_core.models.zero_dilation.starts import initial_forces

ROOT = Path(__file__).resolve().parent
WALLS = tuple(f"ferris_tinloi_{number}" for number in (1, 2, 3, 4, 5))
STARTS: tuple[Literal["associative", "gravity", "vertex"], ...] = ("associative", "gravity", "vertex")
SMOOTHING = (0.3, 0.6, 1.0)
DAMPING = (1e-3, 1e-2, 1e-1)


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
    pair = _iterate(search, scheme, initial_forces(search, associative, scheme.start))
    proof = pair_proof(associative, analysis, pair, search.solves)
    options = replace(analysis.options, friction="zero-dilation")
    elapsed = time.perf_counter() - start
    return result_of(analysis.template, labels, options, proof, assemble=analysis.seconds, elapsed=elapsed)


def _iterate(search: FixedPointSearch, scheme: Smoothing, forces: Floats) -> PrimalDualPair:
    """Until λ and N have settled, first with α and then without."""
    labels, alpha = search.labels, scheme.alpha
    normals, last, point = search.normals(forces), math.inf, forces
    violation, settled = math.inf, False
    for _ in range(scheme.most - 1):
        template, sets = search.freeze_friction(alpha, normals, None)
        point = search.solver.solve(template.program(labels, search.margin)).point
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
    pair = search.evaluate_pair(state, None)
    return replace(pair, violation=violation, settled=settled and alpha == 0.0) if pair.motion is not None else pair


@dataclass(frozen=True)
class Row:
    """One run: what was asked, what came out."""

    load: float
    associative: float
    programs: int
    violation: float
    dilation: float
    gap: float
    converged: bool
    certified: bool
    seconds: float


def run(assembly: Assembly, scheme: ProximalOptions | Smoothing) -> Row:
    """Solve one wall; the associative solution is not counted in the time."""
    analysis = LimitAnalysis(assembly)
    associative = analysis.prove(assembly.labels)
    start = time.perf_counter()
    if isinstance(scheme, Smoothing):
        result = smoothed(analysis, scheme, associative)
    else:
        result = zero_dilation(analysis, scheme=scheme, associative=associative, stands=False)
    extra = result.facts
    return Row(
        load=result.load_factor,
        associative=associative.load_factor * analysis.template.scaling.load,
        programs=extra["zero_dilation_iterations"],
        violation=extra["friction_violation"] or 0.0,
        dilation=np.inf if extra["dilation"] is None else extra["dilation"],
        gap=np.inf if extra["complementarity_gap"] is None else extra["complementarity_gap"],
        converged=extra["converged"],
        certified=bool(result.gap <= analysis.gap and extra["converged"]),
        seconds=time.perf_counter() - start,
    )


def schemes() -> Iterator[tuple[str, float, ProximalOptions | Smoothing]]:
    """Variant, its damping and the scheme, for every start."""
    for start in STARTS:
        for beta in SMOOTHING:
            yield "plain", beta, Smoothing(start=start, beta=beta)
        for damping in DAMPING:
            yield "robust", damping, ProximalOptions(start=start, damping=damping)


def table_of_walls() -> list[str]:
    """Markdown table: the given walls under every start and damping."""
    lines = [
        "| wall | start | variant | β or ε | λ | programs | violation | dilation | Γ/D | converged | s |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in WALLS:
        assembly = build_assembly(load_scene(ROOT.parent / "scenes" / f"{name}.json"))
        for variant, damping, scheme in schemes():
            row = run(assembly, scheme)
            lines.append(
                f"| {name[-1]} | {scheme.start} | {variant} | {damping:g} | {row.load:.6f} | {row.programs} "
                f"| {row.violation:.0e} | {row.dilation:.0e} | {row.gap:.0e} "
                f"| {'yes' if row.converged else 'no'} | {row.seconds:.2f} |"
            )
    return lines


def random_walls(count: int, first: int = 0) -> dict[str, list[Row]]:
    """Rows per variant over `count` random walls, seeds from `first` on."""
    rows: dict[str, list[Row]] = {"plain": [], "robust": []}
    for seed in range(first, first + count):
        assembly = build_assembly(random_wall(seed))
        rows["plain"].append(run(assembly, Smoothing()))
        rows["robust"].append(run(assembly, ProximalOptions()))
    return rows


def table_of_random_walls(rows: dict[str, list[Row]]) -> list[str]:
    """Markdown table: shares and medians per variant."""
    lines = [
        "| variant | walls | converged | bracket ≤ 1e-6 too | programs: median, most | violation: worst "
        "| Γ/D: worst | λ / λ associative: least | s: median |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for variant, found in rows.items():
        programs = [row.programs for row in found]
        lines.append(
            f"| {variant} | {len(found)} | {sum(row.converged for row in found)} "
            f"| {sum(row.certified for row in found)} | {np.median(programs):.0f}, {max(programs)} "
            f"| {max(row.violation for row in found):.0e} | {max(row.gap for row in found):.0e} "
            f"| {min(row.load / row.associative for row in found if row.converged):.4f} "
            f"| {np.median([row.seconds for row in found]):.3f} |"
        )
    return lines


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    text = [
        "# Zero dilation: plain and robust",
        "",
        "Converged: violation ≤ 1e-4 of the largest N, dilation ≤ 1e-6 of the slip, Γ ≤ 1e-3 of the dissipation D, "
        "λ settled to 1e-6. Zero-dilation solutions are not unique, so λ depends on start and damping. "
        "Plain: β is the share of the new N; robust: ε is the weight of the proximal term.",
        "",
        "## Walls of Ferris and Tin-Loi",
        "",
        *table_of_walls(),
        "",
        "## Random running-bond walls",
        "",
        *table_of_random_walls(random_walls(count)),
        "",
    ]
    target = ROOT / "results" / "zero_dilation.md"
    target.parent.mkdir(exist_ok=True)
    target.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
