"""Scene files: keys, reading, validation and error messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.scene.loads import PointLoad
from jld_core.scene.search import Search

if TYPE_CHECKING:
    from jld_core.scene import cracks, design, loads, move, standard, uncertain, units
    from jld_core.scene.materials import FillLoad
    from jld_core.scene.reading import NeedsImport

__all__ = [
    "FillLoad",
    "NeedsImport",
    "PointLoad",
    "Search",
    "cracks",
    "design",
    "loads",
    "move",
    "standard",
    "uncertain",
    "units",
]

export_lazily(
    __name__,
    {"materials": ["FillLoad"], "reading": ["NeedsImport"]},
    submodules=["cracks", "design", "loads", "move", "standard", "uncertain", "units"],
)
