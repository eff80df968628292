"""Conic program of one labelling, and the template that a relabelling changes.

- `ConicProgram`: numbers of one conic program
- `Structure`: sparsity and cones that all programs of one template share
- `Template`: scaled data of an assembly that do not depend on the labelling
- `beginnings`: return the first row of each cone
- `pack`: make a conic program from sparse rows
"""

from __future__ import annotations

from jld_core.program.conic import ConicProgram, Structure, beginnings, pack
from jld_core.program.template import Template

__all__ = [
    "ConicProgram",
    "Structure",
    "Template",
    "beginnings",
    "pack",
]
