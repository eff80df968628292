"""Parts of a structure in which a labelling is looked at by itself: slabs across its longest extent.

Faces outside a window are undecided from the start, so that a conflict found there is of faces that lie together.
Conflicts that lie together meet: soon no labelling of a window is left, and with it none at all, where conflicts of
faces from everywhere rule out little of what there is (benchmarks/results/exact.md, flagship with cells halved).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Bits, Floats

_WIDTHS: Final = (1, 2, 3)
"""Slabs of a window, tried in turn."""

_LEAST: Final = 5
"""Slabs from which windows are of use."""

_IDLE: Final = 0.1
"""Share of labellings refuted in windows of one width below which that width is left out."""

_AGAIN: Final = 20
"""Every so many times it is tried all the same."""

_FADING: Final = 0.9


def windows_of(assembly: Assembly) -> tuple[Bits, ...]:
    """Windows (w, m) for each width: True where a face touches an element of the window. None of short structures."""
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    low, high = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    size: Floats = high - low
    axis = int(size.argmax())
    # as many as there are cells in a row, were all alike
    count = round(float(len(free) * np.prod(size[axis] / size)) ** (1.0 / len(size)))
    if count < _LEAST:
        return ()
    place = np.full(len(elements), -1)
    along = (elements.centroid[free, axis] - low[axis]) / size[axis]
    place[free] = np.clip((count * along).astype(int), 0, count - 1)
    found = []
    for width in _WIDTHS:
        within = [(place >= first) & (place < first + width) for first in range(count - width + 1)]
        found.append(np.array([inside[faces.a] | inside[faces.b] for inside in within]))
    return tuple(found)


class WindowStatistics:
    """How much windows of each width are worth, by the share of labellings that they refute. widths: how many."""

    def __init__(self, widths: int) -> None:
        self._share, self._left_out = np.ones(widths), np.zeros(widths, dtype=int)

    def wanted(self, width: int) -> bool:
        """Whether windows of a width are to be tried now."""
        if self._share[width] >= _IDLE:
            return True
        self._left_out[width] = (self._left_out[width] + 1) % _AGAIN
        return bool(self._left_out[width] == 0)

    def tell(self, width: int, share: float) -> None:
        """What share of labellings they refuted."""
        self._share[width] = _FADING * self._share[width] + (1.0 - _FADING) * share
