"""What may be labelled, under which limits, and what is counted."""

from __future__ import annotations

from jld_explore.space.counts import counts
from jld_explore.space.labelling import (
    above,
    below,
    block_sizes,
    blocks_of,
    canonical,
    connectivity,
    from_string,
    keys,
    orbit_sizes,
    pack,
    representatives,
    slits,
    to_string,
    unpack,
)
from jld_explore.space.limits import feasible, within_limits
from jld_explore.space.search_space import SearchSpace, search_space

__all__ = [
    "SearchSpace",
    "above",
    "below",
    "block_sizes",
    "blocks_of",
    "canonical",
    "connectivity",
    "counts",
    "feasible",
    "from_string",
    "keys",
    "orbit_sizes",
    "pack",
    "representatives",
    "search_space",
    "slits",
    "to_string",
    "unpack",
    "within_limits",
]
