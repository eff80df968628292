"""Keep the bounds proven so far for one labelling, and say which fallbacks may improve them."""

from __future__ import annotations

from typing import Final, Protocol

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import BatchSolver
from jld_core.limit.admissible import State
from jld_core.limit.bounds import Prover
from jld_core.limit.brackets import apart, relative_width
from jld_core.limit.proof import Proof
from jld_core.limit.repair import Repair
from jld_core.limit.status import Status
from jld_core.program import Template
from jld_core.solvers import RawSolution, RawStatus, Solver, is_large

_GROWS: Final = 1e3  # Scaled λ above which a state without an upper bound may be unbounded.
_SIMPLEX: Final = 6000  # Number of columns up to which a dual simplex is tried.


class Analysis(Protocol):
    """Interface of `LimitAnalysis` that `ProofAttempt` needs."""

    assembly: Assembly
    template: Template
    prover: Prover
    repair: Repair
    route: Solver
    reference: Bits
    margin: float
    gap: float
    floor: float
    single: bool

    @property
    def batch(self) -> BatchSolver | None:
        """Return the batch solver for labellings of this analysis."""

    @property
    def quick(self) -> bool:
        """Return True if the batch solver is faster for one labelling than one solver call."""

    def unloaded(self, labels: Bits) -> State | None:
        """Return the state without forces at λ = 0, where there is no dead load."""

    def judge(self, proof: Proof) -> Status:
        """Return the status that a proof supports."""


class AttemptState:
    """Bounds proven so far for one labelling, and the conditions under which fallbacks are tried.

    Parameters
    ----------
    analysis : Analysis
        Limit analysis of the assembly.
    labels : (m,) bool array
        Labels, True = dry.

    Attributes
    ----------
    proof : Proof
        Bounds proven so far.
    raw : RawSolution or None
        Last raw solver answer, from which repairs start.
    settled : bool
        True if no further fallback is to be tried.
    """

    def __init__(self, analysis: Analysis, labels: Bits) -> None:
        self.analysis, self.labels = analysis, labels
        self.template, self.prover, self.repair = analysis.template, analysis.prover, analysis.repair
        self.proof = Proof()
        self.raw: RawSolution | None = None
        self.settled = False
        unloaded = analysis.unloaded(labels)
        if unloaded is not None:
            self.proof.offer_state(unloaded)

    def take(self, found: Proof) -> None:
        """Adopt a finished proof of the same labelling, unless the brackets are disjoint.

        If they are disjoint, only the solve log of the finished proof is kept.

        Parameters
        ----------
        found : Proof
            Finished proof, scaled.
        """
        mine = self.proof
        mine.route += found.route
        mine.solves += found.solves
        if not apart((found.low, found.high), (mine.low, mine.high)):
            found.route, found.solves = mine.route, mine.solves
            self.proof, self.settled = found, True

    @property
    def open(self) -> bool:
        """Return True if the status is still uncertified."""
        return self.proof.status is Status.UNCERTIFIED

    @property
    def open_inside(self) -> bool:
        """Return True if the status is uncertified and the last raw answer is not infeasible."""
        return self.open and self.raw is not None and self.raw.status is not RawStatus.INFEASIBLE

    @property
    def reduced(self) -> bool:
        """Return True if the bracket is open although facial reduction was tried.

        It applies only to programs with friction cones, which the reduction replaces by rays.
        """
        return self.open and bool(self.template.structure.cones) and "facial reduction" in self.proof.route

    @property
    def grows(self) -> bool:
        """Return True if λ is so large without an upper bound that it may be unbounded."""
        state = self.proof.state
        return self.open and self.proof.motion is None and state is not None and state.load > _GROWS

    @property
    def runs_away(self) -> bool:
        """Return True if the last raw answer is unbounded and the batch solver has not been tried."""
        unasked = "lanes" not in self.proof.route
        return self.open and unasked and self.raw is not None and self.raw.status is RawStatus.UNBOUNDED

    @property
    def alone(self) -> bool:
        """Return True if only one labelling is analysed and the batch solver is faster."""
        analysis = self.analysis
        return self.open and analysis.single and analysis.quick and analysis.batch is not None

    @property
    def settled_by_batch(self) -> bool:
        """Return True if the batch solver's bracket is conclusive and narrow enough.

        A bracket much wider than those of other solvers does not count.
        """
        if "lanes" not in self.proof.route or self.open:
            return False
        return not self._collapses or self._width(0.0) <= tolerances.ALONE

    @property
    def linear(self) -> bool:
        """Return True if the program is linear and small enough for a dual simplex."""
        structure = self.template.structure
        return not structure.cones and structure.shape[1] <= _SIMPLEX

    @property
    def crushed_wide(self) -> bool:
        """Return True if crushing leaves the bracket wider than `CRUSHING_WIDTH`.

        A smaller margin than most crushable scenes need may then narrow it.
        """
        crushing = self.template.precision is tolerances.CRUSHING
        return crushing and self._collapses and self._width(self.analysis.floor) > tolerances.CRUSHING_WIDTH

    @property
    def wide_beside_load(self) -> bool:
        """Return True if the bracket is narrow relative to the load scale but wide relative to λ.

        λ may then be small, or zero.
        """
        return self._collapses and self._width(0.0) > self.analysis.gap

    @property
    def wide_alone(self) -> bool:
        """Return True if the bracket of a labelling solved alone leaves digits of λ open.

        Where λ is in a wide bracket depends on the order of the elements. Searches do not need these digits.
        """
        analysis = self.analysis
        if not analysis.single or not self._collapses or self.settled_by_batch or is_large(self.template.structure):
            return False
        return self._width(analysis.floor) > tolerances.DIGITS

    @property
    def _collapses(self) -> bool:
        """Return True if the status is collapse."""
        return self.proof.status is Status.COLLAPSE

    def _width(self, floor: float) -> float:
        """Return the width of the bracket relative to its ends, or to `floor` if larger."""
        return relative_width(self.proof.low, self.proof.high, floor)
