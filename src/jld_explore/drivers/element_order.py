"""Order the free elements for an enumeration, one component after the other."""

from __future__ import annotations

from collections import deque

import numpy as np

from jld_core.arrays import Ints
from jld_explore.space import SearchSpace


def breadth_first(space: SearchSpace) -> Ints:
    """Return the indices of the free elements in breadth-first order, (free,).

    Neighbours are elements that share a candidate face. Each component starts at a far end, so that few elements are
    half decided at a time in an enumeration.
    """
    assembly, graph = space.assembly, space.graph
    count = len(assembly.elements)
    links: list[list[int]] = [[] for _ in range(count)]
    joined = space.candidates & assembly.free_faces
    for a, b in zip(graph.a[joined].tolist(), graph.b[joined].tolist(), strict=True):
        links[a].append(b)
        links[b].append(a)

    def from_(start: int, seen: set[int]) -> list[int]:
        """Return the elements reached from `start` outside `seen`, in breadth-first order."""
        queue, found, seen = deque([start]), [], {*seen, start}
        while queue:
            element = queue.popleft()
            found.append(element)
            for other in sorted(set(links[element])):
                if other not in seen:
                    seen.add(other)
                    queue.append(other)
        return found

    order: list[int] = []
    for element in assembly.elements.free.tolist():
        if element not in order:
            seen = set(order)
            order += from_(from_(from_(element, seen)[-1], seen)[-1], seen)
    return np.array(order, dtype=np.int64)
