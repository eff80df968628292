"""Which nodes of a graph hang together."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jld_core.arrays import Ints


def components(count: int, one: Ints, other: Ints) -> Ints:
    """(count,) the component of each node, numbered in the order of their first nodes.

    count: nodes. one, other: (k,) ends of the edges, in either direction and as often as they come.
    """
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
