"""Convert what a caller gives to an assembly and labels, or raise one clear error."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import ParameterError, error_context
from jld_core.scene import Scene, load_scene
from jld_core.sub_assembly import with_members

Structure = str | Path | Mapping[str, Any] | Scene | Assembly
"""What can be solved: a scene file, a dict as in the file, a scene or an assembly."""

Labels = str | ArrayLike
"""One labelling: m letters d and i, or m values True or 1 (dry) and False or 0 (inner)."""

_LETTERS: Final = {"d": True, "i": False}  # labels by their letters, as in results.csv


def assembly_of(structure: Structure) -> Assembly:
    """Return the assembly of a scene file, of a dict or a scene, or an assembly itself.

    structure: a text is the name of a scene file. Raises InputError if the file or the scene cannot be used, or the
    object is none of these.
    """
    if isinstance(structure, Assembly):
        return structure
    if isinstance(structure, Scene):
        return build_assembly(structure)
    if isinstance(structure, Mapping):
        return build_assembly(structure)
    if not isinstance(structure, str | Path):
        problem = f"{type(structure).__name__!r} is no structure"
        raise ParameterError("structure", problem, "the name of a scene file, a dict, a Scene or an Assembly")
    scene = load_scene(Path(structure))
    with error_context(structure):
        return build_assembly(scene)


def labels_of(assembly: Assembly, labels: Labels | None) -> Bits:
    """Return one labelling as a checked bool array.

    labels: (m,) true, 1 or "d" = dry; False, 0 or "i" = inner. Default: the labels of the scene. Returns (m,). Raises
    InputError if the number of labels is wrong, or a label has another value.
    """
    if labels is None:
        return assembly.labels
    return with_members(assembly, _checked(_values(labels), assembly, "labels"))


def labellings_of(assembly: Assembly, labellings: ArrayLike | Iterable[Labels]) -> Bits:
    """Return several labellings as a checked bool array.

    labellings: (k, m) each row as in `labels_of`. Returns (k, m). Raises InputError if a row has a wrong number of
    labels, or a label has another value.
    """
    expected = f"rows of {assembly.faces} labels"
    if isinstance(labellings, np.ndarray) and labellings.ndim == 2 and labellings.dtype == np.bool_:
        if labellings.shape[1] not in (assembly.faces, len(assembly.interfaces)):
            raise ParameterError("labellings", f"rows have {labellings.shape[1]} labels", expected)
        return with_members(assembly, labellings)
    if isinstance(labellings, str) or not isinstance(labellings, Iterable):
        raise ParameterError("labellings", f"{labellings!r} is no sequence of labellings", expected)
    rows = [_checked(_values(row), assembly, f"labellings[{k}]") for k, row in enumerate(labellings)]
    return with_members(assembly, np.array([row[: assembly.faces] for row in rows]).reshape(len(rows), assembly.faces))


def _values(labels: Labels) -> NDArray[np.generic]:
    """Return labels as an array of numbers, truth values or letters, without any check."""
    if isinstance(labels, str):
        return np.array(list(labels), dtype="U1")
    try:
        return np.asarray(labels)
    except ValueError:  # rows of different lengths
        return np.asarray(labels, dtype=object)


def _checked(values: NDArray[np.generic], assembly: Assembly, parameter: str) -> Bits:
    """Return labels as truth values (m,); raise InputError for a wrong number or value.

    values: labels as given. parameter: name of the parameter, for the message.
    """
    faces = assembly.faces
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
