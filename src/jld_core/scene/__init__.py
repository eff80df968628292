"""Scene files: keys, reading, validation and error messages.

- `FillLoad`: vertical load on the surface of the fill, spread over the structure below
- `NeedsImport`: error for a drawing or a file of solids where a scene is expected
- `PointLoad`: force and moment on one element
- `Search`: candidates, limits and objectives of a search
- `cracks`: crack models of a scene: along the faces of the grid, in finer cells, or by fields
- `design`: keys of the design check, and named sets of partial factors with their sources
- `loads`: define the keys of loads and of movements of supports in a scene file
- `move`: keys of a scene for `jld move`: variables, limits and objective
- `standard`: parameters of the standard criterion, stated once
- `uncertain`: values with uncertainty, such as `{"mean": 0.6, "cov": 0.1, "kind": "lognormal"}`
- `units`: units of force and length, and numbers as text with a unit: `"10 kN"`, `"2 kN/m²"`
"""

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
    {
        "materials": ["FillLoad"],
        "reading": ["NeedsImport"],
    },
    submodules=["cracks", "design", "loads", "move", "standard", "uncertain", "units"],
)
