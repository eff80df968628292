"""Define proven bounds of partial labellings: refutations of a λ, and minimised conflicts."""

from __future__ import annotations

from dataclasses import dataclass

from jld_core.arrays import Bools, Floats


@dataclass(frozen=True)
class DualBound:
    """Mechanism whose work balance refutes a λ for every labelling that agrees on the decided faces."""

    excess: float  # threshold · b_λ·u + b·u − Σ D, scaled, rounding deducted; positive (docs/method.md (6.4))
    cost: Floats  # (m,) reduction of the excess if a face becomes undecided, scaled; inf where no bound remains
    # λ that no such labelling exceeds, scaled; −inf where none is admissible at any λ. In the unit of the governing
    # factor if it comes from `CaseRelaxation`.
    bound: float
    velocity: Floats  # (q·free,) the mechanism, scaled
    case: int = 0  # index of the load case of the mechanism


@dataclass(frozen=True)
class MinimizedConflict:
    """Result of minimising the conflict of a labelling, or of one of its neighbours."""

    labelling: int  # index of the requested labelling
    drawn: bool  # True for the labelling itself, False for a neighbour
    decided: Bools  # (m,) faces whose labels are part of the conflict
    # scaled λ that no labelling with these labels exceeds; −inf where none is admissible at any λ. None where nothing
    # refuted it. In the unit of the governing factor if it comes from `CaseRelaxation`.
    bound: float | None
    carries: bool = False  # True if the forces found carry more than the threshold
    velocity: Floats | None = None  # (q·free,) mechanism that refuted the labelling, scaled
    case: int = 0  # index of the load case of the mechanism
