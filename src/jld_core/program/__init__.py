"""The conic program of one labelling, and what a relabelling changes in it.

- `Beside`: one equation beside equilibrium, scaled: row·F + dead + λ live = 0
- `ConicProgram`: the numbers of one program
- `Structure`: what all programs of one template share
- `Template`: what does not depend on the labelling, scaled
- `beginnings`: where each of some cones begins among their rows
- `pack`: a program from sparse rows
"""

from __future__ import annotations

from jld_core.program.conic import ConicProgram, Structure, beginnings, pack
from jld_core.program.template import Beside, Template

__all__ = [
    "Beside",
    "ConicProgram",
    "Structure",
    "Template",
    "beginnings",
    "pack",
]
