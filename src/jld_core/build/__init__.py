"""Conversion of a scene to an assembly: elements, interfaces, materials, loads."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.build.assemble import build_robust
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.build import loads, materials
    from jld_core.build.assemble import build_geometry, cases_of_scene
    from jld_core.build.plausibility import weight_facts

__all__ = ["build_geometry", "build_robust", "cases_of_scene", "loads", "materials", "weight_facts"]

export_lazily(
    __name__,
    {"assemble": ["build_geometry", "cases_of_scene"], "plausibility": ["weight_facts"]},
    submodules=["loads", "materials"],
)
