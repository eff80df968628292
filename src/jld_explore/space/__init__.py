"""What may be labelled, under which limits, and what is counted."""

from __future__ import annotations

from jld_explore.space.counts import (
    Count,
    Layouts,
    Terms,
    count_named,
    counts,
    register,
    registered,
    unregister,
    values_of,
)
from jld_explore.space.labelling import (
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
    to_strings,
    unpack,
)
from jld_explore.space.limits import CELLS, MEASURES, Limits, Measure, Range, Sized, block_sizes
from jld_explore.space.search_space import SearchSpace, feasible, search_space

__all__ = [
    "CELLS",
    "MEASURES",
    "Count",
    "Layouts",
    "Limits",
    "Measure",
    "Range",
    "SearchSpace",
    "Sized",
    "Terms",
    "block_sizes",
    "blocks_of",
    "canonical",
    "connectivity",
    "count_named",
    "counts",
    "feasible",
    "from_string",
    "keys",
    "orbit_sizes",
    "pack",
    "register",
    "registered",
    "representatives",
    "search_space",
    "slits",
    "to_string",
    "to_strings",
    "unpack",
    "unregister",
    "values_of",
]
