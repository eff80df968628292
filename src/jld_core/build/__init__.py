"""Scene → Assembly: elements, interfaces, materials, loads.

- `Resultant`: what a set of generalised forces adds up to
- `build_assembly`: Scene → Assembly
- `faces_of_pairs`: the interfaces between the elements of each pair
- `resultant`: its force, line of action and moment
"""

from __future__ import annotations

from jld_core.build.assemble import build_assembly
from jld_core.build.elements import faces_of_pairs
from jld_core.build.plausibility import Resultant, resultant

__all__ = [
    "Resultant",
    "build_assembly",
    "faces_of_pairs",
    "resultant",
]
