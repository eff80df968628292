"""Parametric structures of use to anyone, by name: `jld new NAME` and the same in Python.

- `KINDS`: what `jld new` makes, by name
- `Stone`: material of a sample
- `arch`: an arch of voussoirs in rings
- `box`: a spatial element between two corners
- `buttress`: a buttress under a thrust
- `dome`: a faceted dome
- `flat_arch`: a flat arch of wedges
- `grid`: a rectangle of equal cells
- `vault`: a vault over a semicircle
- `wall`: a wall of courses in a bond
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from jld_core.samples.planar import arch, buttress, flat_arch, grid, wall
from jld_core.samples.stone import Stone, box
from jld_core.samples.vaults import dome, vault
from jld_core.scene import Scene

KINDS: Final[dict[str, Callable[..., Scene]]] = {
    "arch": arch,
    "wall": wall,
    "vault": vault,
    "dome": dome,
    "flat-arch": flat_arch,
    "buttress": buttress,
    "grid": grid,
}
"""What `jld new` makes, by name."""

__all__ = [
    "KINDS",
    "Stone",
    "arch",
    "box",
    "buttress",
    "dome",
    "flat_arch",
    "grid",
    "vault",
    "wall",
]
