"""Conversion of a scene to an assembly: elements, interfaces, materials, loads.

- `build_geometry`: compute the elements and interfaces of a scene
- `build_robust`: convert a scene to an assembly with the low material values
- `cases_of_scene`: return the load cases of a scene, stated ones and those of moving loads and pushes
- `loads`: loads, load cases and settlements of a scene
- `materials`: conversion of materials to strengths per interface and self-weights per element
- `weight_facts`: return thickness, density and weight of all free elements as texts with units
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.build.assemble import build_robust
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.build import loads, materials
    from jld_core.build.assemble import build_geometry, cases_of_scene
    from jld_core.build.plausibility import weight_facts

__all__ = [
    "build_geometry",
    "build_robust",
    "cases_of_scene",
    "loads",
    "materials",
    "weight_facts",
]

export_lazily(
    __name__,
    {
        "assemble": ["build_geometry", "cases_of_scene"],
        "plausibility": ["weight_facts"],
    },
    submodules=["loads", "materials"],
)
