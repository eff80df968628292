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
        came = self._reach(labels, start, lambda seen: end in seen)
        path, at = [], end
        while at != start:
            at, face = came[at]
            if face >= 0:
                path.append(face)
        return path

    def tree(self, labels: Bits, start: int) -> list[int]:
        """Return inner faces, from an element on, that join elements to a block above the limits."""
        limits = self._limits
        came = self._reach(labels, start, lambda seen: bool(limits.too_large(limits.sized.one(seen & self._free))))
        return [face for _, face in came.values() if face >= 0]

    def _reach(self, labels: Bits, start: int, enough: Callable[[set[int]], bool]) -> dict[int, tuple[int, int]]:
        """Search breadth first through inner faces until `enough`; return the search tree.

        The tree maps each element to the element before it and the face between them.
        """
        came = {start: (start, -1)}
        waiting = deque([start])
        while waiting:
            at = waiting.popleft()
            for face, other in self._links[at]:
                if other not in came and (face < 0 or not labels[face]):
                    came[other] = (at, face)
                    waiting.append(other)
                    if enough(set(came)):
                        return came
        return came
