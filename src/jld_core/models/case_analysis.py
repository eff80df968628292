"""Analysis of labellings of one structure under each of its load cases."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, SolveOptions, governing_result, result_of
from jld_core.mechanics import require_materials
from jld_core.models.labelling import limit_analysis, require_solver_accepts, solve_labelling


class CaseAnalysis:
    """Limit analyses of one structure, one for each load case, or one for its single load.

    The analyses are set up once and serve any number of labellings. Threads may share the object; they solve in turn.

    Parameters
    ----------
    assembly : Assembly
        Structure, with or without load cases.
    model : SolveOptions, optional
        Model and solver options. Default: those of `solve`.
    reference : (m,) bool array, optional
        Labelling on which solvers are set up, True = dry. Default: that of the assembly.
    single_labelling : bool
        State that only one labelling will be solved. Each analysis is then set up for it alone where that is faster,
        when its load case is solved, and dropped afterwards, which bounds the memory.

    Raises
    ------
    InputError
        If the solver of the model does not accept programs of this structure.

    Examples
    --------
    >>> analysis = CaseAnalysis(build_assembly(load_scene("scenes/wall_in_two_winds.json")))
    >>> analysis.solve(analysis.assembly.labels).governing
    """

    def __init__(
        self,
        assembly: Assembly,
        model: SolveOptions | None = None,
        *,
        reference: Bits | None = None,
        single_labelling: bool = False,
    ) -> None:
        self.assembly, self.model = assembly, model or SolveOptions()
        self._reference = assembly.labels if reference is None else reference
        self._single = single_labelling
        self._turn = threading.Lock()  # A limit analysis may be used by one thread at a time.
        self._kept = None if single_labelling else [self._analysis(case) for case in assembly.by_case]

    def solve(self, labels: Bits, *, stands: bool = False) -> LimitAnalysisResult:
        """Solve one labelling under every load case.

        Parameters
        ----------
        labels : (m,) bool array
            Labels, True = dry.
        stands : bool
            Also decide whether the structure stands without live load, that is, at λ = 0.

        Returns
        -------
        LimitAnalysisResult
            Result in scene units. With load cases: the governing factor, with the result of each case in `cases`.

        Raises
        ------
        InputError
            If a material that the labelling needs is missing, or the solver does not accept the programs.
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
        elapsed = time.perf_counter() - start
        assemble = analysis.seconds if self._single else 0.0
        return result_of(analysis.template, labels, self.model, proof, assemble=assemble, elapsed=elapsed)

    def _analyses(self) -> Iterator[LimitAnalysis]:
        """Yield the analysis of each load case, in their order."""
        yield from map(self._analysis, self.assembly.by_case) if self._kept is None else self._kept

    def _analysis(self, case: Assembly) -> LimitAnalysis:
        """Create the analysis of one load case; raise InputError if the solver does not accept it."""
        alone = self._single and self.model.supports_bounds_over_labellings
        analysis = limit_analysis(case, self.model, reference=self._reference, single_labelling=alone)
        require_solver_accepts(analysis, self.model)
        return analysis
