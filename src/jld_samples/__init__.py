"""Parametric sample structures, for `jld new NAME` and for Python.

- `KINDS`: functions that make samples, by name
- `Stone`: material of a sample
- `arch`: make a circular arch of voussoirs in rings
- `box`: make a spatial box element between two corners
- `buttress`: make a buttress under a thrust
- `corner`: make two walls that meet at a bonded corner
- `dome`: make a faceted dome
- `flat_arch`: make a flat arch of wedges
- `grid`: make a rectangle of equal cells
- `vault`: make a barrel vault or a cross vault
- `wall`: make a wall of courses in a bond
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from jld_core import Scene
from jld_samples.stone import Stone, box
from jld_samples.structures import arch, buttress, corner, dome, flat_arch, grid, room, vault, wall

KINDS: Final[dict[str, Callable[..., Scene]]] = {
    "arch": arch,
    "wall": wall,
    "corner": corner,
    "room": room,
    "vault": vault,
    "dome": dome,
    "flat-arch": flat_arch,
    "buttress": buttress,
    "grid": grid,
}
"""Functions that make samples, by the name used in `jld new`."""

__all__ = ["KINDS", "Stone", "arch", "box", "buttress", "corner", "dome", "flat_arch", "grid", "vault", "wall"]
