"""Define proven bounds of partial labellings: refutations of a λ, and minimised conflicts."""

from __future__ import annotations

from dataclasses import dataclass

from jld_core.arrays import Bools, Floats


@dataclass(frozen=True)
class DualBound:
    """Mechanism that refutes a λ for every labelling that agrees on the decided faces.

    It is the dual certificate of a relaxation, with the work balance that it proves.

    excess: threshold · b_λ·u + b·u − Σ D, scaled, rounding deducted; positive (docs/method.md (6.4)). cost: (m,)
    reduction of the excess if a face becomes undecided, scaled; inf where no bound remains. bound: λ that no such
    labelling exceeds, scaled; −inf where none is admissible at any λ. In the unit of the governing factor if it comes
    from `CaseRelaxation`. velocity: (q·free,) the mechanism, scaled. case: index of the load case of the mechanism.
    """

    excess: float
    cost: Floats
    bound: float
    velocity: Floats
    case: int = 0


@dataclass(frozen=True)
class MinimizedConflict:
    """Result of minimising the conflict of a labelling, or of one of its neighbours.

    labelling: index of the requested labelling. drawn: True for the labelling itself, False for a neighbour. decided:
    (m,) faces whose labels are part of the conflict. bound: scaled λ that no labelling with these labels exceeds; −inf
    where none is admissible at any λ. None where nothing refuted it. In the unit of the governing factor if it comes
    from `CaseRelaxation`. carries: True if the forces found carry more than the threshold. velocity: (q·free,)
    mechanism that refuted the labelling, scaled. case: index of the load case of the mechanism.
    """

    labelling: int
    drawn: bool
    decided: Bools
    bound: float | None
    carries: bool = False
    velocity: Floats | None = None
    case: int = 0
