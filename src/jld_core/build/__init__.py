"""Scene → Assembly: elements, interfaces, materials, loads."""

from __future__ import annotations

from jld_core.build.assemble import build_assembly
from jld_core.build.elements import faces_of_pairs

__all__ = [
    "build_assembly",
    "faces_of_pairs",
]
