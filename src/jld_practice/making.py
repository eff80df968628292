"""Work for the stones of a layout: saw cuts, set-ups, stock, moulds and masses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jld_core.arrays import Floats
from jld_core.exchange import Layout
from jld_core.geometry import area_vector
from jld_core.geometry import outlines as polygons
from jld_core.geometry.outlines import different_lines
from jld_core.scene.units import METRES

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Stone:
    """One block as a workshop sees it; lengths and masses in the units of the scene.

    Attributes
    ----------
    number : int
        Number that stands on the stone, from 1.
    name : str
        Name of the block.
    shape : int
        Number of its mould.
    mass, volume : float
        Mass and volume.
    size : tuple of float
        Sides of the smallest cuboid around it, the longest first; planar: of those with the thickness as one side.
        In space along the axes of the scene.
    cuts : int
        Number of sawn faces, without the two sides of a planar stone.
    set_ups : int
        Number of directions of these faces.
    sawn : float
        Area of these faces.
    outline : (k, 2) array or None
        Outline of a planar stone about its centroid, None in space.
    """

    number: int
    name: str
    shape: int
    mass: float
    volume: float
    size: tuple[float, ...]
    cuts: int
    set_ups: int
    sawn: float
    outline: Floats | None

    @property
    def stock(self) -> float:
        """Return the volume of the smallest cuboid around the stone."""
        return float(np.prod(self.size))


def stones_of(layout: Layout) -> list[Stone]:
    """Return the stones of a layout, numbered in the order of `blocks.csv`."""
    found = []
    members = {block.name: k for k, block in enumerate(layout.blocks)}
    for number, block in enumerate((one for one in layout.blocks if one.cells), 1):
        k = members[block.name]
        if layout.assembly.dimension == 2:
            rings = [ring for region in layout.regions[k] for ring in (region.shell, *region.holes)]
            edges = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in rings])
            lengths = np.hypot(*edges.T)
            directions, sawn = edges / lengths[:, None], float(lengths.sum()) * layout.thickness
            outline: Floats | None = layout.regions[k][0].shell - np.array(block.centroid)
            flat = smallest_rectangle(np.concatenate([region.shell for region in layout.regions[k]]))
            sides = [*flat, layout.thickness]
        else:
            surface = layout.surfaces[k][0]
            areas = np.array([area_vector(surface.points[list(face)]) for face in surface.faces])
            directions, sawn = (
                areas / np.linalg.norm(areas, axis=1)[:, None],
                float(np.linalg.norm(areas, axis=1).sum()),
            )
            outline = None
            sides = [high - low for low, high in zip(block.lower, block.upper, strict=True)]
        own = (len(directions), different_lines(directions), sawn, outline)
        size = tuple(sorted(sides, reverse=True))
        found.append(Stone(number, block.name, block.shape, block.mass, block.volume, size, *own))
    return found


def smallest_rectangle(points: Floats) -> tuple[float, float]:
    """Return the sides of the rectangle of least area around points (k, 2).

    One of its sides lies along an edge of the convex hull, so that no other rectangle is smaller (Freeman and Shapira
    1975, Communications of the ACM 18, 409–413).
    """
    hull = polygons.hull(points)
    edges = np.roll(hull, -1, axis=0) - hull
    along = edges / np.hypot(*edges.T)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    spans = np.ptp(hull @ along.T, axis=0), np.ptp(hull @ across.T, axis=0)
    best = int(np.argmin(spans[0] * spans[1]))
    return float(spans[0][best]), float(spans[1][best])


@dataclass(frozen=True)
class Making:
    """Sums over all stones of a layout, in the units of the scene."""

    # stones, moulds: numbers of stones and of different shapes
    stones: int
    moulds: int
    # cuts, set_ups: sawn faces, and set-ups of the saw where equal stones are sawn together
    cuts: int
    set_ups: int
    # sawn, volume, stock: sawn area, volume of stone, and volume of the smallest cuboids, one for each stone
    sawn: float
    volume: float
    stock: float
    # mass, heaviest: mass of all stones, and of the heaviest
    mass: float
    heaviest: float

    @property
    def waste(self) -> float:
        """Return the share of the stock that is lost.

        For planar stones, no other choice of one cuboid for each stone loses less.
        """
        return 1.0 - self.volume / self.stock


def making_of(stones: list[Stone]) -> Making:
    """Return the sums over stones."""
    first = {stone.shape: stone for stone in reversed(stones)}
    return Making(
        len(stones),
        len(first),
        sum(stone.cuts for stone in stones),
        sum(stone.set_ups for stone in first.values()),
        sum(stone.sawn for stone in stones),
        sum(stone.volume for stone in stones),
        sum(stone.stock for stone in stones),
        sum(stone.mass for stone in stones),
        max((stone.mass for stone in stones), default=0.0),
    )


def stones_table(layout: Layout, unit: str) -> pd.DataFrame:
    """Return the cutting list: one row per stone, as it is numbered in the printed report."""
    import pandas as pd  # slow to import and needed for tables only

    factor, metres = (factor_to(one, layout.scene.units.length) for one in (unit, "m"))
    rows = [
        {
            "stone": stone.number,
            "block": stone.name,
            "mould": stone.shape,
            "mass": stone.mass,
            **{f"side_{k}_{unit}": factor * side for k, side in enumerate(stone.size, 1)},
            "cuts": stone.cuts,
            "set_ups": stone.set_ups,
            "sawn_area": metres**2 * stone.sawn,
            "waste": 1.0 - stone.volume / stone.stock,
        }
        for stone in stones_of(layout)
    ]
    # twelve digits: sums have rounding errors in the last ones
    return pd.DataFrame(rows).map(lambda x: float(f"{x:.12g}") if isinstance(x, float) else x)


def factor_to(unit: str, own: str) -> float:
    """Return the factor from a scene's unit of length to another; 1 if the scene's is unknown."""
    return METRES[own] / METRES[unit] if own in METRES else 1.0
