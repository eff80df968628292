"""Derivatives of λ by the positions of all vertices, from one result without a solve."""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Floats
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.limit.mechanism import face_jumps
from jld_core.models.sensitivity import GeometrySensitivities
from jld_core.parameters import require_kind, typed
from jld_core.threads import one_thread
from jld_geometry import optimise as kinks
from jld_geometry.convex_cells import vertex_mesh
from jld_geometry.spatial_rates import length_rates, residual_rates, spatial_rates


@typed
@one_thread()
def geometry_sensitivities(result: LimitAnalysisResult, *, one_sided: bool = True) -> GeometrySensitivities | None:
    """Compute the derivatives of λ by the positions of all vertices, scene units.

    With load cases: of the governing factor. None where the status is not collapse, for strengths or models whose
    bounds do not hold for all labellings, and under pressure, members or bond. one_sided: look for kinks in the plane.
    """
    require_kind("result", result, LimitAnalysisResult)
    if result.cases:
        names = [case.name for case in result.assembly.cases]
        if result.governing is None or result.status is not Status.COLLAPSE:
            return None
        required = float(result.assembly.required[names.index(result.governing)])
        one = geometry_sensitivities(result.cases[result.governing], one_sided=one_sided)
        if one is None:
            return None
        rates = (values / required for values in (one.derivative, one.left, one.right))
        return GeometrySensitivities(one.vertices, *rates)
    plain = result.model.supports_bounds_over_labellings and result.model.inner_bending == "uncoupled"
    plain = plain and not result.assembly.pressed and not result.assembly.members
    plain = plain and result.assembly.members.bond is None
    if result.status is not Status.COLLAPSE or not plain or result.forces is None or result.mechanism is None:
        return None
    if result.assembly.dimension == 3:
        found = spatial_rates(result, result.forces, result.mechanism)
        return None if found is None else GeometrySensitivities(found[0], *[found[1]] * 3)
    return _planar(result, result.forces, result.mechanism, one_sided)


def _planar(result: LimitAnalysisResult, forces: Floats, mechanism: Floats, sided: bool) -> GeometrySensitivities:
    """Return the rates of a planar result with its forces (m, 3) and its mechanism (n, 3)."""
    assembly = result.assembly
    mesh = vertex_mesh(assembly)
    velocity = mechanism[assembly.elements.free].ravel()
    rates = -(velocity @ residual_rates(assembly, mesh, forces, result.load_factor))
    dissipation = -np.einsum("ij,ij->i", forces, face_jumps(assembly, mechanism))
    rates = rates + (dissipation / assembly.interfaces.l1) @ length_rates(mesh)
    if sided:
        left, right = kinks.one_sided(result, mesh, rates)
        derivative = np.where(left == right, left, np.nan)
    else:
        left, right, derivative = np.full_like(rates, np.nan), np.full_like(rates, np.nan), rates
    shape = mesh.places.shape
    return GeometrySensitivities(mesh.places, *(values.reshape(shape) for values in (derivative, left, right)))
