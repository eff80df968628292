"""Scene → Assembly: elements, interfaces, materials, loads.

- `Geometry`: elements and interfaces, before materials and loads
- `Resultant`: what a set of generalised forces adds up to
- `build_assembly`: Scene → Assembly
- `build_geometry`: Scene → Geometry
- `faces_of_pairs`: the interfaces between the elements of each pair
- `resultant`: its force, line of action and moment
"""

from __future__ import annotations

from jld_core.build.assemble import build_assembly, build_geometry
from jld_core.build.elements import Geometry, faces_of_pairs
from jld_core.build.plausibility import Resultant, resultant

__all__ = [
    "Geometry",
    "Resultant",
    "build_assembly",
    "build_geometry",
    "faces_of_pairs",
    "resultant",
]
