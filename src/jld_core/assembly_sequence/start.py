"""Start of laying: the order in which blocks are removed when a structure is taken apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Literal, get_args

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.assembly_sequence.blocks import Blocks
from jld_core.errors import ParameterError

LayingStart = Literal["ground", "left", "right", "springings"]
"""Where laying starts: at the ground, from a side, or from all supports alike."""

LAID: Final[dict[str, tuple[str, LayingStart]]] = {
    "translation": ("translation", "ground"),
    "standing": ("standing", "ground"),
    "left-to-right": ("translation", "left"),
    "right-to-left": ("translation", "right"),
    "springings": ("translation", "springings"),
}
"""Wishes for laying: the limit `search.assemble` of each, and where laying starts."""

_EQUAL: Final = 6  # decimals, relative to the size of the structure, to which two places are the same

Turn = Callable[[Bools, Sequence[int]], tuple[float, ...]]
"""Sort key of a removal: of the blocks present and those removed; the least is removed first."""


def turn_of(blocks: Blocks, start: LayingStart = "ground") -> Turn:
    """Return the sort key by which removals are tried, so that laying begins at `start`.

    ground: highest first, then fewest contacts, so that gaps grow from their edges. left, right: farthest from that
    side first. springings: farthest from the supports first, in blocks between them. Raises InputError for another
    start.
    """
    if start not in get_args(LayingStart):
        raise ParameterError("start", f"{start!r} is no start of laying", "one of " + ", ".join(get_args(LayingStart)))
    elements, up = blocks.assembly.elements, upwards(blocks)
    if start == "springings":
        far: Floats | None = _steps_from_supports(blocks)
    elif start == "ground":
        far = None
    else:
        far = elements.centroid @ _to_the_right(blocks, up) * (1.0 if start == "left" else -1.0)

    def key(there: Bools, removed: Sequence[int]) -> tuple[float, ...]:
        """Return the sort key of removing some blocks: distance from the start, height, contacts.

        there: (k,) mask of the blocks present. removed: indices of the blocks.
        """
        touching = sum(int(np.count_nonzero(there[blocks.contacts_of(block)[0]])) for block in removed)
        chosen = np.isin(blocks.of, removed)
        weights = elements.volume[chosen]
        height = float(np.average(elements.centroid[chosen], axis=0, weights=weights) @ up)
        place = () if far is None else (-round(float(np.average(far[chosen], weights=weights)) / scale, _EQUAL),)
        return (*place, -round(height / blocks.assembly.size, _EQUAL), float(touching))

    scale = 1.0 if start == "springings" else blocks.assembly.size
    return key


def upwards(blocks: Blocks) -> Floats:
    """Return the unit vector (d,) against the weight of all blocks."""
    elements = blocks.assembly.elements
    total = elements.weight[elements.free].sum(axis=0)
    if not np.any(total):
        total = -np.eye(blocks.assembly.dimension)[-1]
    return np.asarray(-total / np.linalg.norm(total))


def _to_the_right(blocks: Blocks, up: Floats) -> Floats:
    """Return the horizontal unit direction (d,) from left to right.

    In space it runs along the longer side of the plan. up: (d,) unit vector.
    """
    if blocks.assembly.dimension == 2:
        return np.array([up[1], -up[0]])
    elements = blocks.assembly.elements
    extent = elements.upper.max(axis=0) - elements.lower.min(axis=0)
    axis = max((k for k in range(3) if abs(up[k]) < 0.5), key=lambda k: extent[k])
    return np.asarray(np.eye(3)[axis])


def _steps_from_supports(blocks: Blocks) -> Floats:
    """Return for each element (n,) the least number of contacts from its block to a support.

    Elements of fixed blocks have 0; without a connection the number is that of all blocks.
    """
    steps = np.where(blocks.fixed, 0.0, np.inf)
    while True:
        across = np.concatenate([steps[blocks.first], steps[blocks.second]])
        reached = steps.copy()
        np.minimum.at(reached, np.concatenate([blocks.second, blocks.first]), across + 1.0)
        if np.array_equal(reached, steps):
            return np.asarray(np.where(np.isfinite(steps), steps, len(steps))[blocks.of])
        steps = reached
