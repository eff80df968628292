"""Limit analysis of labelled assemblies: proven bounds on λ, results and relaxations.

- `FIELD_SECONDS`: default time for the bounds of one load case by fields, seconds
- `CaseBounds`: status and bounds of one load case
- `Motion`: velocities with their jumps, margin and upper bound on λ
- `Proof`: bounds, status and solve log of one labelling
- `Prover`: turns raw solver points and multipliers into checked bounds
- `SampleAnalysis`: batch solver of one labelling under samples of strengths and loads
- `State`: forces and λ with their slack and equilibrium error
- `crossed`: return whether lower bounds exceed upper bounds by more than rounding
- `displacement`: compute velocities of points that move with an element
- `effects`: return a force (k,) per member for pictures: tension of bars, shear of pins
- `face_jumps`: compute the velocity jumps J = A_eqᵀ u of all faces in a mechanism
- `governing`: compute the governing factor of a labelling from its load cases
- `load_scale`: compute the λ below which differences are negligible
- `mechanism`: mechanisms: movements of faces, and results without the faces of members
- `movements`: classify the movements of all faces in several mechanisms
- `number`: convert a float to a JSON number or null
- `relative_width`: compute the relative width of a bracket
- `result_of`: convert a proof to a result in scene units
- `without_idle`: set the resultants that a member cannot carry to zero, and subtract the bond from N
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.limit.bounds import Motion, Prover, State, load_scale, relative_width
from jld_core.limit.mechanism import displacement
from jld_core.limit.options import FIELD_SECONDS, CaseBounds, governing
from jld_core.limit.proof import Proof
from jld_core.limit.result import number, result_of

if TYPE_CHECKING:
    from jld_core.limit import mechanism
    from jld_core.limit.bounds import crossed
    from jld_core.limit.mechanism import face_jumps, movements
    from jld_core.limit.result import effects, without_idle
    from jld_core.limit.samples import SampleAnalysis

__all__ = [
    "FIELD_SECONDS",
    "CaseBounds",
    "Motion",
    "Proof",
    "Prover",
    "SampleAnalysis",
    "State",
    "crossed",
    "displacement",
    "effects",
    "face_jumps",
    "governing",
    "load_scale",
    "mechanism",
    "movements",
    "number",
    "relative_width",
    "result_of",
    "without_idle",
]

export_lazily(
    __name__,
    {
        "bounds": ["crossed"],
        "mechanism": ["face_jumps", "movements"],
        "result": ["effects", "without_idle"],
        "samples": ["SampleAnalysis"],
    },
)
