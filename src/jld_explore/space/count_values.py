"""Compute the values of counts for many labellings: in chunks, or until a deadline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_explore.space.counts import Count, Layouts, registered
from jld_explore.space.labelling import Connectivity, connectivity
from jld_explore.space.shapes import BlockShapes

Values = dict[str, Ints | Floats]
"""Values (k,) by the names of counts."""

_CHUNK: Final = 8192  # number of labellings counted together, so that arrays stay in the cache

# Number of labellings counted together where time may run out: those of an unfinished slice are lost
_SLICE: Final = 64


def values_of(
    count: Count,
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None = None,
    shapes: BlockShapes | None = None,
) -> Ints | Floats:
    """Compute the values of one count.

    Parameters
    ----------
    count : Count
        Definition of the count.
    assembly : Assembly
        Structure.
    labellings : (k, m) bool array
        Labels, True = dry.
    graph : Connectivity, optional
        Element graph of the assembly; built if missing.
    shapes : BlockShapes, optional
        Block outlines of the assembly; built if missing.

    Returns
    -------
    (k,) int or float array
        Values, scene units.
    """
    return _values([count], assembly, labellings, graph, shapes)[count.name]


def counts(
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None = None,
    shapes: BlockShapes | None = None,
    *,
    without: Sequence[Count] = (),
) -> Values:
    """Compute the values of every registered count.

    labellings: (k, m) True = dry. graph: element graph of the assembly; built if missing. shapes: block outlines of the
    assembly; built if missing. without: counts to leave out. Result: values by the name of the count, in the order of
    the columns, scene units.
    """
    return _values([count for count in registered() if count not in without], assembly, labellings, graph, shapes)


def values_until(
    count: Count,
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity,
    shapes: BlockShapes,
    deadline: Deadline,
) -> Ints | Floats:
    """Compute the values of one count for as many labellings, in order, as there is time for.

    count: definition of the count. labellings: (k, m) True = dry. graph: element graph of the assembly. shapes: block
    outlines of the assembly. deadline: time at which the computation stops; it is checked between outlines. Returns
    (k,): values, scene units; NaN from the first one on that is late. The first is always computed.
    """
    if not deadline.limited:
        return _values([count], assembly, labellings, graph, shapes)[count.name]
    # whoever has a layout also has its counts: the first one is never late
    known, done = [count.of(Layouts(assembly, labellings[:1], graph, shapes))], min(1, len(labellings))
    try:
        with deadline.enforced():
            while done < len(labellings):
                known.append(count.of(Layouts(assembly, labellings[done : done + _SLICE], graph, shapes)))
                done = min(done + _SLICE, len(labellings))
    except DeadlinePassed:
        known.append(np.full(len(labellings) - done, np.nan))
    values: Floats = np.concatenate(known)
    return values


def _values(
    wanted: Sequence[Count],
    assembly: Assembly,
    labellings: Bits,
    graph: Connectivity | None,
    shapes: BlockShapes | None,
) -> Values:
    """Compute the values of several counts in chunks of `_CHUNK` labellings."""
    graph, shapes = graph or connectivity(assembly), shapes or BlockShapes(assembly)
    starts = range(0, max(1, len(labellings)), _CHUNK)
    parts = (Layouts(assembly, labellings[low : low + _CHUNK], graph, shapes) for low in starts)
    found = [[count.of(part) for count in wanted] for part in parts]
    return {count.name: np.concatenate(column) for count, column in zip(wanted, zip(*found, strict=True), strict=True)}
