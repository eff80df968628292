"""Remove elements, or the interfaces of members, from an assembly; check labels that a caller gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jld_core.arrays import Bits, Bools, Ints
from jld_core.assembly import INNER, Assembly
from jld_core.errors import ParameterError


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


Labels = str | ArrayLike
"""One labelling: m letters d and i, or m values True or 1 (dry) and False or 0 (inner)."""

_LETTERS: Final = {"d": True, "i": False}  # labels by their letters, as in results.csv


def labels_of(assembly: Assembly, labels: Labels | None) -> Bits:
    """Return one labelling as a checked bool array.

    labels: (m,) true, 1 or "d" = dry; False, 0 or "i" = inner. Default: the labels of the scene. Returns (m,). Raises
    InputError if the number of labels is wrong, or a label has another value.
    """
    if labels is None:
        return assembly.labels
    return with_members(assembly, checked_labels(labels, assembly, "labels"))


def _values(labels: Labels) -> NDArray[np.generic]:
    """Return labels as an array of numbers, truth values or letters, without any check."""
    if isinstance(labels, str):
        return np.array(list(labels), dtype="U1")
    try:
        return np.asarray(labels)
    except ValueError:  # rows of different lengths
        return np.asarray(labels, dtype=object)


def checked_labels(labels: Labels, assembly: Assembly, parameter: str) -> Bits:
    """Return labels as truth values (m,); raise InputError for a wrong number or value."""
    values, faces = _values(labels), assembly.faces
    expected = f"{faces} labels, one per interface: True, 1 or d = dry; False, 0 or i = inner"
    if values.ndim != 1 or len(values) not in (faces, len(assembly.interfaces)):
        found = f"{len(values)} labels are given" if values.ndim == 1 else f"an array of shape {values.shape} is given"
        raise ParameterError(parameter, found, expected)
    if values.dtype == np.bool_:
        return np.asarray(values, dtype=bool)
    items: Sequence[object] = values.tolist()
    for place, item in enumerate(items):
        if item not in ((*_LETTERS,) if isinstance(item, str) else (0, 1)):
            raise ParameterError(parameter, f"label {place} is {item!r}", expected)
    return np.array([_LETTERS[item] if isinstance(item, str) else bool(item) for item in items], dtype=bool)
