"""Scene → Assembly: elements, interfaces, materials, loads.

- `Resultant`: what a set of generalised forces adds up to
- `Settlement`: a movement of supports, known up to its size
- `build_assembly`: Scene → Assembly
- `build_geometry`: Scene → Geometry
- `build_robust`: the same at the low values of materials
- `faces_of_pairs`: the interfaces between the elements of each pair
- `gravity_vector`: gravity as a vector
- `resultant`: its force, line of action and moment
- `settlements_of`: the settlements of a scene, in their order
"""

from __future__ import annotations

from jld_core.build.assemble import build_assembly, build_geometry, build_robust
from jld_core.build.elements import faces_of_pairs
from jld_core.build.materials import gravity_vector
from jld_core.build.plausibility import Resultant, resultant
from jld_core.build.settlements import Settlement, settlements_of

__all__ = [
    "Resultant",
    "Settlement",
    "build_assembly",
    "build_geometry",
    "build_robust",
    "faces_of_pairs",
    "gravity_vector",
    "resultant",
    "settlements_of",
]
