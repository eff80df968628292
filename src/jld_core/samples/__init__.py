"""Parametric structures of use to anyone, by name: `jld new NAME` and the same in Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from jld_core.samples.gallery import (
    leonardo_flat_arch,
    polar_grid_arch,
    random_wall,
    ring_arch,
    semicircular_arch,
    stacked_cubes,
    t_block,
    wall_with_opening,
)
from jld_core.samples.planar import arch, buttress, flat_arch, grid, wall
from jld_core.samples.stone import Stone
from jld_core.samples.vaults import dome, vault
from jld_core.samples.walls import planar_running_bond, running_bond
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
    "buttress",
    "dome",
    "flat_arch",
    "grid",
    "leonardo_flat_arch",
    "planar_running_bond",
    "polar_grid_arch",
    "random_wall",
    "ring_arch",
    "running_bond",
    "semicircular_arch",
    "stacked_cubes",
    "t_block",
    "vault",
    "wall",
    "wall_with_opening",
]
