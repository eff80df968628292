"""Least share of the capacity of all faces with which a structure carries its dead load.

Of the many states of equilibrium under a load, the one looked for has the least largest share of capacity over all
faces: the eccentricity of N over that at which a face opens, shear over its capacity, tension and compression over
theirs. docs/method.md (3.16).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.admissible import State
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.member_results import without_idle
from jld_core.mechanics import Scaling, require_materials, scaling_of, yield_set
from jld_core.mechanics.yield_set import used
from jld_core.strengths import Route
from jld_core.threads import one_thread

_ROUTE: Final = Route("the geometric reserve")

_WIDTH: Final = 2e-3  # width of the bracket of the share at which its bisection ends

_IDLE: Final = 1e-6  # shear over the largest force of the structure up to which it counts as none


@dataclass(frozen=True)
class Reserve:
    """State in which the faces use the least possible share of their capacity.

    bracket: (float, float) proven bounds on the share: with less than the first one there is no state, with the second
    one there is. forces: (m, q) resultants of this state, scene units. share: (m,) share of its capacity that each face
    uses, 0 to 1. bending: (m,) share of the eccentricity, tension or compression alone. slip: (m,) share of shear and
    torsion alone; reserve against slip is 1 minus it.
    """

    bracket: tuple[float, float]
    forces: Floats
    share: Floats
    bending: Floats
    slip: Floats


@one_thread()
def least_share(assembly: Assembly, labels: Bits) -> Reserve | None:
    """Find the state under the dead load in which faces use the least share of their capacity.

    assembly: structure with one load case; its live load does not act. labels: (m,) True = dry. Result: the state; None
    if the structure is not proven to stand. Raises InputError if a material that the labelling needs is missing.

    Bisection of θ with yield sets whose eccentricities, friction and strengths are θ times those of the faces, which
    are nested. docs/method.md (3.16).
    """
    require_materials(assembly, labels, ~labels)
    found = _state(assembly, labels, 1.0)
    if found is None:
        return None
    least, high = 0.0, 1.0
    while high - least > _WIDTH:
        middle = 0.5 * (least + high)
        one = _state(assembly, labels, middle)
        if one is None:
            least = middle
        else:
            high, found = middle, one
    refuted = least > 0.0 and LimitAnalysis(shrunk(assembly, least)).stands(labels) is False
    low = least if refuted else 0.0
    forces = found[0].forces * found[1].face
    return _reserve(assembly, labels, (low, high), forces)


def shrunk(assembly: Assembly, share: float) -> Assembly:
    """Return a structure whose faces have a share of their size, friction and strength.

    Forces act where they did; members have the share of their capacity. share: above 0, up to 1.
    """
    faces, strengths = assembly.interfaces, assembly.strengths(_ROUTE)
    members = assembly.of_members
    size = np.where(members, 1.0, share)
    area = size if assembly.dimension == 2 else size**2
    polygon = tuple(
        origin + scale * (corners - origin) if scale < 1.0 else corners
        for corners, origin, scale in zip(faces.polygon, faces.origin, size, strict=True)
    )
    smaller = replace(
        faces,
        l1=faces.l1 * size,
        l2=faces.l2 * (size if assembly.dimension == 3 else 1.0),
        area=faces.area * area,
        polygon=polygon,
    )
    stress = share / area
    stresses = {
        name: getattr(strengths, name) * stress for name in ("tension", "shear", "crush_dry", "crush_inner", "cohesion")
    }
    friction = {name: getattr(strengths, name) * share for name in ("friction", "inner_friction")}
    return replace(assembly, interfaces=smaller).with_strengths(replace(strengths, **stresses, **friction))


def _state(assembly: Assembly, labels: Bits, share: float) -> tuple[State, Scaling] | None:
    """Return an admissible state of a shrunk structure with its scaling, None if none is found."""
    analysis = LimitAnalysis(shrunk(assembly, share))
    state = analysis.repair.standing_state(labels)
    return None if state is None else (state, analysis.template.scaling)


def _reserve(assembly: Assembly, labels: Bits, bracket: tuple[float, float], forces: Floats) -> Reserve:
    """Return the shares of a state; forces: (m, q) resultants of the program, scene units, with bond."""
    scaling = scaling_of(assembly)
    yields = yield_set(assembly, scaling, "uncoupled")
    scaled, friction = forces / scaling.face, yields.associative
    turned = scaled.copy()
    turned[:, 1 : assembly.dimension] = 0.0
    turned[:, 5:] = 0.0
    share, bending = yields.utilisation(scaled, labels), yields.utilisation(turned, labels)
    if share is None or bending is None:
        raise ValueError("the yield sets of this structure define no share of capacity")
    shear = friction.shear_of(scaled)
    capacity = friction.cohesion_of(labels) + friction.friction_of(labels) * scaled[:, 0]
    slip = np.minimum(used(shear, capacity, _IDLE * float(np.abs(scaled[:, :2]).max(initial=0.0))), 1.0)
    return Reserve(bracket, without_idle(assembly, forces), share, bending, slip)
