"""Remove elements from an assembly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jld_core.arrays import Bools, Ints
from jld_core.assembly import Assembly
from jld_core.shape_loads import ShapeLoads


def without(assembly: Assembly, gone: Bools) -> tuple[Assembly, Ints]:
    """Remove elements, with all their interfaces and loads, from an assembly.

    Parameters
    ----------
    assembly : Assembly
        Assembly with n elements.
    gone : (n,) bool array
        True for the elements to remove; no support that touches another support may be among them.

    Returns
    -------
    assembly : Assembly
        Assembly of the remaining elements, in the same order, with `sink` = −1.
    faces : (k,) int array
        Indices, in the given assembly, of the interfaces that remain.
    """
    rows = np.flatnonzero(~gone)
    place = np.cumsum(~gone) - 1
    faces = assembly.interfaces
    kept = np.flatnonzero(~(gone[faces.a] | gone[faces.b]))
    rest = faces.take(kept)
    cases = tuple(
        replace(case, dead=case.dead[rows], live=case.live[rows], shape_loads=_of(case.shape_loads, rows))
        for case in assembly.cases
    )
    left = replace(
        assembly,
        elements=assembly.elements.take(rows),
        interfaces=replace(rest, a=place[rest.a], b=place[rest.b]),
        strengths=assembly.strengths.take(kept),
        nominal=None if assembly.nominal is None else assembly.nominal.take(kept),
        dead=assembly.dead[rows],
        live=assembly.live[rows],
        shape_loads=_of(assembly.shape_loads, rows),
        labels=assembly.labels[kept],
        cases=cases,
        touching=tuple((int(place[a]), int(place[b])) for a, b in assembly.touching),
        sink=-1,
    )
    return left, kept


def _of(loads: ShapeLoads | None, rows: Ints) -> ShapeLoads | None:
    """Return the loads that change with shape on some elements; None if they are unknown.

    rows: (k,) indices of the elements.
    """
    return None if loads is None else loads.take(rows)
