"""Windows of a structure in which conflicts are sought first: slabs across its length.

Slabs divide the longest extent of the structure. Faces outside a window are undecided from the start, so a conflict
found in the window consists of faces close together. Such conflicts interact: soon no labelling of the window is
left, and then no labelling at all. Conflicts of faces from everywhere rule out few labellings
(benchmarks/results/exact.md, flagship with cells halved).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Bits, Floats

_WIDTHS: Final = (1, 2, 3)
"""Widths of windows in slabs, tried in this order."""

_LEAST_SLABS: Final = 5
"""Least number of slabs of a structure for which windows are used."""

_LEAST_SHARE: Final = 0.1
"""Share of labellings refuted in windows of one width below which that width is skipped."""

_RETRY_INTERVAL: Final = 20
"""A skipped width is still tried once in this number of times."""

_DECAY: Final = 0.9
"""Weight of the earlier average when the share of refuted labellings is updated."""


def windows_of(assembly: Assembly) -> tuple[Bits, ...]:
    """Return the windows (w, m) of each width, True where a face touches the window.

    A window is a set of elements. The result is empty for structures of fewer than `_LEAST_SLABS` slabs.
    """
    elements, faces = assembly.elements, assembly.interfaces
    free = elements.free
    low, high = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    size: Floats = high - low
    axis = int(size.argmax())
    # number of cells in a row, if all were alike
    count = round(float(len(free) * np.prod(size[axis] / size)) ** (1.0 / len(size)))
    if count < _LEAST_SLABS:
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
    """Running share of labellings that the windows of each width refute.

    Parameters
    ----------
    widths : int
        Number of widths.
    """

    def __init__(self, widths: int) -> None:
        self._share, self._times_skipped = np.ones(widths), np.zeros(widths, dtype=int)

    def is_worthwhile(self, width: int) -> bool:
        """Return True if windows of a width should be tried now."""
        if self._share[width] >= _LEAST_SHARE:
            return True
        self._times_skipped[width] = (self._times_skipped[width] + 1) % _RETRY_INTERVAL
        return bool(self._times_skipped[width] == 0)

    def record(self, width: int, share: float) -> None:
        """Record the share of labellings that windows of a width refuted."""
        self._share[width] = _DECAY * self._share[width] + (1.0 - _DECAY) * share
