"""Reduce a result to faces: leave out the interfaces of members, for drawings and tables."""

from __future__ import annotations

from dataclasses import replace

from jld_core.limit.result import LimitAnalysisResult
from jld_core.sub_assembly import faces_of


def result_of_faces(result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result whose interfaces, labels and forces are those of faces, not of members.

    Figures and tables of faces use it. A result without members is returned as it is.
    """
    assembly = faces_of(result.assembly)
    if assembly is result.assembly:
        return result
    rows = slice(assembly.faces)
    forces, unbounded = (None if one is None else one[rows] for one in (result.forces, result.unbounded_forces))
    return replace(
        result,
        assembly=assembly,
        labels=result.labels[rows],
        forces=forces,
        unbounded_forces=unbounded,
        cases={name: result_of_faces(one) for name, one in result.cases.items()},
    )
