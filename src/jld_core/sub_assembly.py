"""Remove elements, or the interfaces of members, from an assembly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.assembly import INNER, Assembly


def without(assembly: Assembly, gone: Bools) -> tuple[Assembly, Ints]:
    """Remove elements, with all their interfaces and loads, from an assembly.

    gone: (n,) True for the elements to remove; no support that touches another support may be among them. Result:
    assembly of the remaining elements, in the same order, with `sink` = −1; and (k,) indices, in the given assembly, of
    the interfaces that remain.
    """
    rows = np.flatnonzero(~gone)
    place = np.cumsum(~gone) - 1
    faces = assembly.interfaces
    kept = np.flatnonzero(~(gone[faces.a] | gone[faces.b]))
    rest = faces.take(kept)
    cases = tuple(
        replace(case, dead_loads=case.dead_loads.take(rows), live_loads=case.live_loads.take(rows))
        for case in assembly.cases
    )
    left = replace(
        assembly,
        elements=assembly.elements.take(rows),
        interfaces=replace(rest, a=place[rest.a], b=place[rest.b]),
        face_strengths=assembly.face_strengths.take(kept),
        dead_loads=assembly.dead_loads.take(rows),
        live_loads=assembly.live_loads.take(rows),
        labels=assembly.labels[kept],
        cases=cases,
        touching=tuple((int(place[a]), int(place[b])) for a, b in assembly.touching),
        sink=-1,
    )
    return left, kept


def faces_of(assembly: Assembly) -> Assembly:
    """Return an assembly without the interfaces of members, for what draws or lists faces."""
    # The members stay, as constant forces. The result serves no analysis.
    rows = np.arange(assembly.faces)
    if len(rows) == len(assembly.interfaces):
        return assembly
    return replace(
        assembly,
        interfaces=assembly.interfaces.take(rows),
        face_strengths=assembly.face_strengths.take(rows),
        labels=assembly.labels[rows],
        members=replace(assembly.members, face=np.full(len(assembly.members), -1)),
    )


def with_members(assembly: Assembly, labels: Bits) -> Bits:
    """Return labels of faces with the label inner of the interfaces of members after them."""
    if assembly.faces == len(assembly.interfaces):
        return labels
    whole = np.full((*labels.shape[:-1], len(assembly.interfaces)), INNER)
    whole[..., : assembly.faces] = labels[..., : assembly.faces]
    return whole
