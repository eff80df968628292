"""Conversion of a scene to an assembly: elements, interfaces, materials, loads.

- `build_assembly`: convert a scene to an assembly
- `build_robust`: convert a scene to an assembly with the low material values
- `faces_of_pairs`: return the mask of the interfaces between pairs of elements
"""

from __future__ import annotations

from jld_core.build.assemble import build_assembly, build_robust
from jld_core.build.elements import faces_of_pairs

__all__ = [
    "build_assembly",
    "build_robust",
    "faces_of_pairs",
]
