"""Conversion of a scene to an assembly: elements, interfaces, materials, loads.

- `Resultant`: resultant of a set of generalised forces
- `Settlement`: support movement, known up to its magnitude
- `build_assembly`: convert a scene to an assembly
- `build_geometry`: compute the elements and interfaces of a scene
- `build_robust`: convert a scene to an assembly with the low material values
- `faces_of_pairs`: return the mask of the interfaces between pairs of elements
- `gravity_vector`: return gravity as a vector
- `resultant`: compute force, line of action and moment of generalised forces
- `settlements_of`: return the settlements of a scene, in the scene's order
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
