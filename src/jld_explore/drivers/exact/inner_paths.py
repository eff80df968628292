"""Search paths and trees of inner faces in the element graph of a labelling."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from jld_core.arrays import Bits
from jld_explore.space import SearchSpace


class InnerPaths:
    """Element graph of a space, searched under one labelling after another."""

    def __init__(self, space: SearchSpace) -> None:
        graph = space.graph
        # per element pairs (face, neighbour); face −1 for supports that touch without a face
        self._links: list[list[tuple[int, int]]] = [[] for _ in range(len(graph.start))]
        pairs = [(face, a, b) for face, (a, b) in enumerate(zip(graph.a, graph.b, strict=True))]
        for face, a, b in pairs + [(-1, a, b) for a, b in graph.touching]:
            self._links[int(a)].append((face, int(b)))
            self._links[int(b)].append((face, int(a)))
        self._free = frozenset(space.assembly.elements.free.tolist())
        self._limits = space.limits

    def path(self, labels: Bits, start: int, end: int) -> list[int]:
        """Return the inner faces of a shortest path between two elements of one block.

        `labels` is (m,), True = dry.
        """
        previous = self._reach(labels, start, lambda seen: end in seen)
        path, element = [], end
        while element != start:
            element, face = previous[element]
            if face >= 0:
                path.append(face)
        return path

    def tree(self, labels: Bits, start: int) -> list[int]:
        """Return inner faces, from an element on, that join elements to a block above the limits."""
        limits = self._limits
        previous = self._reach(labels, start, lambda seen: bool(limits.too_large(limits.sized.one(seen & self._free))))
        return [face for _, face in previous.values() if face >= 0]

    def _reach(self, labels: Bits, start: int, found: Callable[[set[int]], bool]) -> dict[int, tuple[int, int]]:
        """Search breadth first through inner faces until `found`; return the search tree.

        The tree maps each element to the element before it and the face between them.
        """
        previous = {start: (start, -1)}
        waiting = deque([start])
        while waiting:
            element = waiting.popleft()
            for face, other in self._links[element]:
                if other not in previous and (face < 0 or not labels[face]):
                    previous[other] = (element, face)
                    waiting.append(other)
                    if found(set(previous)):
                        return previous
        return previous
