"""Derivatives of λ by the positions of all vertices, from one result without a solve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from jld_core.arrays import Floats
from jld_core.geometry_optimisation import kinks
from jld_core.geometry_optimisation.planar_rates import length_rates, residual_rates
from jld_core.geometry_optimisation.spatial_rates import spatial_rates
from jld_core.geometry_optimisation.vertex_mesh import vertex_mesh
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.limit.mechanism import face_jumps
from jld_core.parameters import require_kind
from jld_core.threads import one_thread


@dataclass(frozen=True)
class GeometrySensitivities:
    """Derivatives of λ by the positions of the v vertices of a structure.

    Elements and interfaces that share a vertex move together with it. Loads with a stated place stay there.

    vertices: (v, d) positions, scene units. derivative: (v, d) ∂λ/∂(position), 1/length; NaN where λ has a kink. left,
    right: (v, d) rates for a decrease and for an increase of each coordinate; NaN where unknown. vertices: (v, d)
    positions, scene units. derivative: (v, d) ∂λ/∂(position), 1/length; NaN where the two sides differ. left, right:
    (v, d) rates for a decrease and for an increase of each coordinate.
    """

    vertices: Floats
    derivative: Floats
    left: Floats
    right: Floats

    def to_json(self) -> dict[str, Any]:
        """Return the fields as lists, None for a rate that is not finite."""
        return {
            name: [[float(x) if math.isfinite(x) else None for x in row] for row in getattr(self, name)]
            for name in ("vertices", "derivative", "left", "right")
        }


@one_thread()
def geometry_sensitivities(result: LimitAnalysisResult, *, one_sided: bool = True) -> GeometrySensitivities | None:
    """Compute the derivatives of λ by the positions of all vertices.

    Parameters
    ----------
    result : LimitAnalysisResult
        Result under associative friction and convex contact, without effective areas; in space also with dry faces
        alone and without compressive strength. With load cases the rates are those of the governing factor.
    one_sided : bool
        Look for kinks in the plane. False: the derivative is that of the forces and the mechanism of the result, and
        rates to either side are unknown.

    Returns
    -------
    GeometrySensitivities or None
        Rates in scene units. None where the status is not collapse, for other models, or under pressure on faces.

    Notes
    -----
    docs/method.md (11.1) to (11.5). In the plane, λ has one-sided rates where forces or mechanism are not unique. In
    space the derivative is that of the forces and the mechanism of the result, and kinks are not looked for. A vertex
    of a face with more than three corners cannot move alone in space: only sums over motions that keep faces plane
    have a meaning.

    Examples
    --------
    >>> rates = geometry_sensitivities(solve("scenes/flat_beam_arch.json"))
    >>> rates.derivative[0]
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
