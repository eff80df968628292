"""What is modelled, and the one policy how."""

from __future__ import annotations

from jld_core.limit import SolveOptions
from jld_core.models.effective_area import change, contact_of, frozen_contact, prove_effective_area
from jld_core.models.point_contacts import point_contact_assembly
from jld_core.models.rigid_blocks import prove_condensed, rigid_blocks, worth_condensing
from jld_core.models.solve import LADDERS, limit_analysis, solve, solve_labelling
from jld_core.models.zero_dilation import prove_zero_dilation, solve_zero_dilation, zero_dilation
from jld_core.models.zero_dilation_search import Scheme

__all__ = [
    "LADDERS",
    "Scheme",
    "SolveOptions",
    "change",
    "contact_of",
    "frozen_contact",
    "limit_analysis",
    "point_contact_assembly",
    "prove_condensed",
    "prove_effective_area",
    "prove_zero_dilation",
    "rigid_blocks",
    "solve",
    "solve_labelling",
    "solve_zero_dilation",
    "worth_condensing",
    "zero_dilation",
]
