"""What is modelled, and the one policy how."""

from __future__ import annotations

from jld_core.models.effective_area import change, contact_of, frozen_contact, solve_effective_area
from jld_core.models.point_contacts import point_contact_assembly
from jld_core.models.rigid_blocks import rigid_blocks, solve_condensed, worth_condensing
from jld_core.models.solve import SolveOptions, solve
from jld_core.models.zero_dilation import solve_zero_dilation, zero_dilation
from jld_core.models.zero_dilation_search import Scheme

__all__ = [
    "Scheme",
    "SolveOptions",
    "change",
    "contact_of",
    "frozen_contact",
    "point_contact_assembly",
    "rigid_blocks",
    "solve",
    "solve_condensed",
    "solve_effective_area",
    "solve_zero_dilation",
    "worth_condensing",
    "zero_dilation",
]
