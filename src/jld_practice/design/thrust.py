"""Stresses of the uncut body of an outline, which the tessellation along the thrust follows."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.fields.bounds import FieldBounds, FieldRefinement
from jld_core.refinement.aligned import TriangleStresses
from jld_core.strengths import Route

_ROUTE: Final = Route("the stresses of an uncut body")

# Shares of the tensile strength that are tried: a weak body shows its thrust, but may not stand
_TENSION: Final = (0.1, 1.0)

_TRIANGLES: Final = 600  # number of triangles from which on a mesh is fine enough, as cells are several triangles wide


def stresses_of_body(assembly: Assembly, until: Deadline | None = None) -> TriangleStresses:
    """Compute the stresses of an uncut body under its governing load case at collapse.

    Stresses are those of the lower bound by fields, of a body with a tenth of its tensile strength: its compression is
    the thrust that joints have to carry. If none is found, the strength is as stated.

    assembly: planar, with loads; labels as stated. until: deadline, after which no further mesh is begun. Raises
    InputError if fields do not apply, or no stresses in equilibrium with the loads are found.
    """
    strengths = assembly.strengths(_ROUTE)
    for share in _TENSION:
        weak = assembly.with_strengths(replace(strengths, tension=share * strengths.tension))
        found = [_refined(case, until) for case in weak.by_case]
        # the case with the least lower bound governs
        lower = [one.lower / factor for one, factor in zip(found, assembly.required.tolist(), strict=True)]
        stresses = found[int(np.argmin([low if np.isfinite(low) else np.inf for low in lower]))].stresses
        if stresses is not None:
            mesh = stresses.mesh
            return TriangleStresses(mesh.points, mesh.triangles, stresses.stress.mean(axis=1))
    raise InputError("", "no stresses of the uncut body keep equilibrium with the loads", "a stronger stone")


def _refined(assembly: Assembly, until: Deadline | None) -> FieldBounds:
    """Return the bounds by fields of a structure under one load case, with their stresses.

    until: deadline, after which no further mesh is begun.
    """
    refinement = FieldRefinement(assembly, assembly.labels, lower_first=True)
    found = refinement.step()
    while not refinement.ended and refinement.triangles <= _TRIANGLES and not (until is not None and until.passed()):
        found = refinement.step(False)
    return found
