"""Analysis of labellings of one structure under each of its load cases."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Model, Proof, Status, governing_result, result_of
from jld_core.mechanics import require_materials
from jld_core.models.labelling import limit_analysis, require_solver_accepts, solve_labelling


class CaseAnalysis:
    """Limit analyses of one structure, one for each load case, or one for its single load.

    The analyses are set up once and serve any number of labellings. Threads may share the object; they solve in turn.

    assembly: structure, with or without load cases. model: model and solver options. Default: those of `solve`.
    reference: (m,) labelling on which solvers are set up, True = dry. Default: that of the assembly. single_labelling:
    state that only one labelling will be solved. Each analysis is then set up for it alone where that is faster, when
    its load case is solved, and dropped afterwards, which bounds the memory. Raises InputError if the solver of the
    model does not accept programs of this structure.

    Examples
    --------
    >>> analysis = CaseAnalysis(build_assembly(load_scene("scenes/wall_in_two_winds.json")))
    >>> analysis.solve(analysis.assembly.labels).governing
    """

    def __init__(
        self,
        assembly: Assembly,
        model: Model | None = None,
        *,
        reference: Bits | None = None,
        single_labelling: bool = False,
    ) -> None:
        self.assembly, self.model = assembly, model or Model()
        self._reference = assembly.labels if reference is None else reference
        self._single = single_labelling
        self._turn = threading.Lock()  # A limit analysis may be used by one thread at a time.
        self._kept = None if single_labelling else [self._analysis(case) for case in assembly.by_case]

    def solve(self, labels: Bits, *, stands: bool = False) -> LimitAnalysisResult:
        """Solve one labelling under every load case.

        labels: (m,) True = dry. stands: also decide whether the structure stands without live load, that is, at λ = 0.
        Result: result in scene units. With load cases: the governing factor, with the result of each case in `cases`.
        Raises InputError if a material that the labelling needs is missing, or the solver does not accept the programs.
        """
        require_materials(self.assembly, labels, ~labels)
        with self._turn:
            found = [self._solve_case(analysis, labels, stands) for analysis in self._analyses()]
        if not self.assembly.cases:
            return found[0]
        names = [case.name for case in self.assembly.cases]
        return governing_result(self.assembly, dict(zip(names, found, strict=True)))

    def _solve_case(self, analysis: LimitAnalysis, labels: Bits, stands: bool) -> LimitAnalysisResult:
        """Solve one labelling under the load case of an analysis.

        labels, stands: as in `solve`. With `single_labelling`, the time of the result includes that of building the
        analysis.
        """
        start = time.perf_counter()
        proof = solve_labelling(analysis, labels, self.model, stands=stands)
        least = least_bracket(analysis, labels, self.model, proof)
        elapsed = time.perf_counter() - start
        assemble = analysis.seconds if self._single else 0.0
        found = result_of(analysis.template, labels, self.model, proof, assemble=assemble, elapsed=elapsed)
        return replace(found, least_bracket=least)

    def _analyses(self) -> Iterator[LimitAnalysis]:
        """Yield the analysis of each load case, in their order."""
        yield from map(self._analysis, self.assembly.by_case) if self._kept is None else self._kept

    def _analysis(self, case: Assembly) -> LimitAnalysis:
        """Create the analysis of one load case; raise InputError if the solver does not accept it."""
        alone = self._single and self.model.supports_bounds_over_labellings
        analysis = limit_analysis(case, self.model, reference=self._reference, single_labelling=alone)
        require_solver_accepts(analysis, self.model)
        return analysis


# Factor between a λ at which a structure stands and the least one, above which the least is sought once more
_FAR: Final = 4.0


def least_bracket(analysis: LimitAnalysis, labels: Bits, model: Model, proof: Proof) -> tuple[float, float]:
    """Bound the least λ from which on a structure stands: λ is minimised by the program that maximises it.

    The structure carries its dead load with a live load λ₀ that it stands under, and reversed live load is added: of
    that, it takes λ₀ less the least λ.

    labels: (m,) True = dry. proof: proof of the labelling, with `stands` decided. Returns (float, float): proven bounds
    in scene units; zeros where the structure stands without live load. NaN where unknown, and where friction has no
    dilation or areas are effective, since the states under such models are not convex.
    """
    unknown = math.nan, math.nan
    if proof.stands:
        return 0.0, 0.0
    convex = model.friction == "associative" and not model.effective_area
    if proof.stands is None or proof.state is None or proof.status is Status.UNSTABLE or not convex:
        return unknown
    assembly, at, found = analysis.assembly, proof.state.load * analysis.template.scaling.load, unknown
    for _ in range(2):
        dead = assembly.dead_loads + at * assembly.live_loads
        back = replace(assembly, dead_loads=dead, live_loads=-1.0 * assembly.live_loads)
        other = limit_analysis(back, model, reference=labels, single_labelling=True)
        less = solve_labelling(other, labels, model)
        scale = other.template.scaling.load
        ends = at - scale * less.high, at - scale * less.low
        if not math.isfinite(ends[1]):
            break
        found = max(ends[0], 0.0) if math.isfinite(ends[0]) else math.nan, ends[1]
        if at <= _FAR * ends[1]:
            break
        at = 2.0 * ends[1]
    return found
