"""Connected components of a graph."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jld_core.arrays import Ints


def components(count: int, one: Ints, other: Ints) -> Ints:
    """Return the connected component of each node, numbered in the order of their first nodes.

    Parameters
    ----------
    count : int
        Number of nodes.
    one, other : (k,) int arrays
        Ends of the edges, in either direction; repetitions are allowed.

    Returns
    -------
    (count,) int array
        Component of each node.
    """
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
