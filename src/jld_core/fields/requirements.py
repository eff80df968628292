"""Check that an assembly, labels and options allow bounds by fields."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.loads import loaded_mesh
from jld_core.fields.material import material_of
from jld_core.strengths import Route

_ROUTE: Final = Route("cracks by fields")


def require_fields(assembly: Assembly) -> None:
    """Raise InputError if λ of an assembly cannot be bounded by fields, whatever its labels.

    assembly: assembly, with or without load cases. Raises InputError: members, spatial scenes, inner strengths that are
    missing, zero or different, loads without room for their patch, and outlines or interfaces that no mesh fits.
    """
    require_planar(assembly)
    material_of(assembly)
    for case in assembly.by_case:
        loaded_mesh(case)


def require_planar(assembly: Assembly) -> None:
    """Raise InputError for a spatial assembly; do nothing for a planar one."""
    if assembly.dimension != 2:
        raise InputError("cracks", "fields are for planar scenes, and this one is spatial", '"faces"')


def require_labels(assembly: Assembly, labels: Bits | None) -> Bits:
    """Check labels of an assembly, and return them as a (m,) bool array.

    labels: (m,) bool, True = dry; None: those of the scene. Raises InputError for another shape or type, and for a dry
    face without a friction coefficient.
    """
    given = np.asarray(assembly.labels if labels is None else labels)
    if given.shape != (len(assembly.interfaces),) or given.dtype != bool:
        raise InputError("labels", f"shape {given.shape} of {given.dtype}", f"({len(assembly.interfaces)},) of bool")
    missing = np.flatnonzero(given & np.isnan(assembly.strengths(_ROUTE).friction))
    if missing.size:
        raise InputError("materials.dry", f"face {assembly.pair(int(missing[0]))} is dry", "a friction coefficient")
    return given


def require_refinement(assembly: Assembly, labels: Bits | None, gap: float, patch: float | None) -> Bits:
    """Check the arguments of a bound by fields, and return the labels (m,).

    labels: as for `require_labels`. gap: relative, above 0. patch: length above 0, or None. Raises InputError for
    several load cases, and for an argument that is out of bounds or refused by `require_labels`.
    """
    if len(assembly.cases) > 1:
        raise InputError("loads.cases", "fields take one load case", "one of Assembly.by_case")
    if not gap > 0.0:
        raise InputError("gap", f"{gap:g} is no relative gap", "a number above 0")
    if patch is not None and not patch > 0.0:
        raise InputError("patch", f"{patch:g} is wrong", "a length above 0")
    return require_labels(assembly, labels)
