"""Places of props at equal horizontal distances below the lowest free elements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import ParameterError

_MOST: Final = 500  # largest number of places; more indicate a spacing in another unit


@dataclass(frozen=True)
class Stations:
    """Places at which props push upwards along the underside of a planar structure.

    points: (s, 2) places, scene units. element: (s,) element above each, which has to be laid for the prop to act.
    """

    points: Floats
    element: Ints


def stations_below(assembly: Assembly, spacing: float) -> Stations:
    """Return places below a planar structure at equal horizontal distances.

    They are the same on both sides of its middle. Places above a support are left out. spacing: scene units of length.
    Raises ParameterError for a spacing that is not above 0, leaves no place or more than 500, and for a spatial
    structure.
    """
    if assembly.dimension != 2:
        raise ParameterError("props", "props along a line are for planar scenes", "a search without it")
    if not 0.0 < spacing < math.inf:
        raise ParameterError("props", f"a spacing of {spacing:g} is wrong", "a length above 0")
    elements = assembly.elements
    total = elements.weight[elements.free].sum(axis=0)
    up = -total / np.linalg.norm(total) if np.any(total) else np.array([0.0, 1.0])
    right = np.array([up[1], -up[0]])
    along = np.concatenate([elements.shape[e] @ right for e in elements.free])
    low, high = float(along.min()), float(along.max())
    count = math.floor((high - low) / spacing * (1.0 + 1e-9))
    if count + 1 > _MOST:
        raise ParameterError("props", f"a spacing of {spacing:g} gives {count + 1} places", f"at most {_MOST} places")
    first = low + 0.5 * (high - low - count * spacing)
    points, owner = [], []
    for place in first + spacing * np.arange(count + 1):
        below = {
            e: _lowest(elements.shape[e] @ right, elements.shape[e] @ up, float(place)) for e in range(len(elements))
        }
        known = {e: height for e, height in below.items() if height is not None}
        held = any(elements.support[e] for e in known)
        if known and not held:
            element = min(known, key=lambda e: (known[e], e))
            points.append(place * right + known[element] * up)
            owner.append(element)
    if not points:
        ends = [elements.shape[e] @ right for e in range(len(elements)) if elements.support[e]]
        grounds = shapely.union_all([shapely.LineString([(one.min(), 0.0), (one.max(), 0.0)]) for one in ends])
        whole = shapely.LineString([(low, 0.0), (high, 0.0)])
        if shapely.difference(whole, shapely.buffer(grounds, 1e-9 * assembly.size)).is_empty:
            problem = "the structure stands on supports along its whole length: places lie below a free underside only"
            raise ParameterError("props", problem, "no such option; each stage then says which blocks need props")
        raise ParameterError("props", f"a spacing of {spacing:g} leaves no place below the structure", "a shorter one")
    return Stations(np.array(points), np.array(owner, dtype=np.int64))


def _lowest(across: Floats, height: Floats, place: float) -> float | None:
    """Return the lowest height of a polygon at a horizontal place; None beside it.

    across, height: (k,) of corners.
    """
    after, above = np.roll(across, -1), np.roll(height, -1)
    crossed = (np.minimum(across, after) <= place) & (place <= np.maximum(across, after)) & (across != after)
    if not crossed.any():
        return None
    share = (place - across[crossed]) / (after - across)[crossed]
    return float((height[crossed] + share * (above - height)[crossed]).min())
