"""State of a proof of one labelling: the bounds so far, and the conditions under which fallbacks are tried."""

from __future__ import annotations

from typing import Final, Protocol

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import BatchSolver
from jld_core.batch.verdicts import BatchResults
from jld_core.limit.admissible import State
from jld_core.limit.bounds import Prover
from jld_core.limit.brackets import apart, relative_width
from jld_core.limit.options import Model
from jld_core.limit.proof import Proof
from jld_core.limit.repair import Repair
from jld_core.limit.status import Status
from jld_core.program import Template
from jld_core.solvers import RawSolution, RawStatus, Solver, is_large
from jld_core.solvers.schur.interior_point import SchurSolver

_GROWS: Final = 1e3  # Scaled λ above which a state without an upper bound may be unbounded.
_SIMPLEX: Final = 6000  # Number of columns up to which a dual simplex is tried.
_SCHUR: Final = (
    900  # Equations from which Schur complements take less time than a dual simplex: 0.3 against 4 s at 1452.
)
EARLY_FROM: Final = 5000
"""Number of equations from which a solver may stop at a bracket of relative width `EARLY`."""


class Analysis(Protocol):
    """Interface to those members of `LimitAnalysis` that `ProofAttempt` uses.

    prover, repair: for `template`. first_solver: solver of the first attempt. reference: (m,) labelling, True = dry, on
    which solvers are set up. margin: slack kept in every yield row while solving, scaled. gap: relative width
    of brackets to aim at. load_scale: scaled λ below which differences are negligible. single_labelling: True
    if only one labelling will be analysed. options: model and solver options; `seconds` ends the attempts.
    """

    assembly: Assembly
    template: Template
    prover: Prover
    repair: Repair
    first_solver: Solver
    reference: Bits
    margin: float
    gap: float
    load_scale: float
    single_labelling: bool
    options: Model

    @property
    def batch(self) -> BatchSolver | None:
        """Return the batch solver for labellings of this analysis; None if there is none."""

    @property
    def batch_is_faster(self) -> bool:
        """Return True if the batch solver is faster for one labelling than one solver call."""

    def unloaded(self, labels: Bits) -> State | None:
        """Return the state without forces at λ = 0, or None if there is dead load.

        labels: (m,) True = dry.
        """

    def status_of(self, proof: Proof) -> Status:
        """Return the status that a proof supports."""

    def is_open(self, proof: Proof) -> bool:
        """Return True if a bound is missing, or the bracket is wider than the gap aimed at."""


class AttemptState:
    """Bounds proven so far for one labelling, and conditions under which fallbacks are tried.

    analysis: limit analysis of the assembly. labels: (m,) True = dry. proof: bounds proven so far. raw: last raw solver
    answer, from which repairs start; None before the first. settled: True if no further fallback is to be tried.
    batch_results: results of the batch solver; None before it was tried. reduction_tried: True if facial reduction was
    tried. less_margin_tried: True if the program was solved with less margin. mechanism_found: True if the mechanism of
    the last raw answer is proven without loss, so that repairs need none.
    """

    def __init__(self, analysis: Analysis, labels: Bits) -> None:
        self.analysis, self.labels = analysis, labels
        self.template, self.prover, self.repair = analysis.template, analysis.prover, analysis.repair
        self.proof = Proof()
        self.raw: RawSolution | None = None
        self.settled = self.reduction_tried = self.less_margin_tried = False
        self.mechanism_found = False
        self.batch_results: BatchResults | None = None
        unloaded = analysis.unloaded(labels)
        if unloaded is not None:
            self.proof.offer_state(unloaded)

    def adopt(self, found: Proof) -> None:
        """Adopt a finished proof of the same labelling, unless the brackets are disjoint.

        If they are disjoint, only its solve log is kept; of a proof that is open, its bounds are kept where they are
        better.

        found: finished proof, scaled.
        """
        mine = self.proof
        mine.solve_log += found.solve_log
        mine.solves += found.solves
        if apart((found.low, found.high), (mine.low, mine.high)):
            return
        if self.analysis.is_open(found):
            if found.state is not None:
                mine.offer_state(found.state)
            if found.motion is not None:
                mine.offer_motion(found.motion)
        else:
            found.solve_log, found.solves = mine.solve_log, mine.solves
            self.proof, self.settled = found, True

    @property
    def open(self) -> bool:
        """Return True if a bound is missing, or the bracket is wider than the gap aimed at."""
        return self.analysis.is_open(self.proof)

    @property
    def open_with_point(self) -> bool:
        """Return True if the attempt is open and the last solver answer has a point.

        An answer has none if the solver reports that the program is infeasible.
        """
        return self.open and self.raw is not None and self.raw.status is not RawStatus.INFEASIBLE

    @property
    def open_after_reduction(self) -> bool:
        """Return True if the attempt is open although facial reduction was tried.

        The result is False for programs without friction cones, which alone the reduction replaces by rays.
        """
        return self.open and bool(self.template.structure.cones) and self.reduction_tried

    @property
    def may_be_unbounded(self) -> bool:
        """Return True if λ may be unbounded: large (scaled, above 1000), without an upper bound."""
        state = self.proof.state
        return self.open and self.proof.motion is None and state is not None and state.load > _GROWS

    @property
    def reported_unbounded(self) -> bool:
        """Return True if a solver reports unbounded λ and the batch solver was not tried."""
        unbounded = self.raw is not None and self.raw.status is RawStatus.UNBOUNDED
        return self.open and self.batch_results is None and unbounded

    @property
    def batch_goes_first(self) -> bool:
        """Return True if only one labelling is analysed and the batch solver is faster."""
        analysis = self.analysis
        return self.open and analysis.single_labelling and analysis.batch_is_faster and analysis.batch is not None

    @property
    def settled_by_batch(self) -> bool:
        """Return True if the batch solver's bracket is conclusive and narrow enough.

        A bracket much wider than those of other solvers does not count.
        """
        if self.batch_results is None or self.open:
            return False
        return not self._narrow or self._width(0.0) <= tolerances.ALONE

    @property
    def is_small_linear(self) -> bool:
        """Return True if the program is linear and small enough for a dual simplex."""
        structure = self.template.structure
        return not structure.cones and structure.shape[1] <= _SIMPLEX

    @property
    def inaccurate_at_medium_size(self) -> bool:
        """Return True if Clarabel ended early on a linear program that Schur complements solve fast."""
        structure, raw = self.template.structure, self.raw
        medium = not structure.cones and structure.equalities >= _SCHUR and not is_large(structure)
        return self.open and medium and raw is not None and raw.status is RawStatus.ALMOST

    @property
    def lacks_large_mechanism(self) -> bool:
        """Return True if a large linear program has an answer, which is no ray, but no mechanism of its own."""
        structure, raw = self.template.structure, self.raw
        answered = raw is not None and raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST, RawStatus.LIMIT)
        linear = is_large(structure) and not structure.cones
        return self.open and linear and answered and self.proof.motion is None

    @property
    def stalled_with_cones(self) -> bool:
        """Return True if Schur complements made no further progress on a large program with cones."""
        structure, raw = self.template.structure, self.raw
        solved = bool(structure.cones) and is_large(structure) and structure.equalities < EARLY_FROM
        by_schur = isinstance(self.analysis.first_solver, SchurSolver)
        stalled = raw is not None and raw.status in (RawStatus.ALMOST, RawStatus.LIMIT)
        return self.open and solved and by_schur and stalled

    @property
    def wide_by_crushing(self) -> bool:
        """Return True if crushing leaves the bracket wider than `CRUSHING_WIDTH`.

        A smaller margin than most crushable scenes need may then narrow it.
        """
        crushing = self.template.precision is tolerances.CRUSHING
        return crushing and self._narrow and self._width(self.analysis.load_scale) > tolerances.CRUSHING_WIDTH

    @property
    def wide_relative_to_load_factor(self) -> bool:
        """Return True if the bracket is narrow relative to the load scale but wide relative to λ.

        λ may then be small, or zero.
        """
        return self._narrow and self._width(0.0) > self.analysis.gap

    @property
    def wide_for_single_labelling(self) -> bool:
        """Return True if the bracket of a single labelling is wider than `tolerances.DIGITS`.

        A narrower bracket then makes the reported λ independent of the order of elements. The result is False in
        analyses of many labellings, for a status other than collapse, for a bracket of the batch solver, and for large
        programs.
        """
        analysis = self.analysis
        if (
            not analysis.single_labelling
            or not self._narrow
            or self.settled_by_batch
            or is_large(self.template.structure)
        ):
            return False
        return self._width(analysis.load_scale) > tolerances.DIGITS

    @property
    def _narrow(self) -> bool:
        """Return True if the proof so far has a bracket as narrow as aimed at."""
        return self.proof.status is Status.COLLAPSE and not self.open

    def _width(self, load_scale: float) -> float:
        """Return the width of the bracket relative to its ends, or to `load_scale` if larger."""
        return relative_width(self.proof.low, self.proof.high, load_scale)
