"""The spatial experiment against closed forms, limit analysis and the planar experiment."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from studies.scenes import stacked_cubes

from jld_core import build_assembly, parse_scene, solve
from jld_core.mechanics import equilibrium_matrix, load_vectors
from jld_experiment import Joints, Settings, Standing, run_experiment, specimen_of
from jld_experiment.subcontacts import sub_contacts

LIMIT = Settings(scheme="limit", gaps="plastic", periods=100.0)


TWO_CUBES = [(0.9, 3.0, 0.2), (0.25, 3.0, 0.6), (0.9, 0.0, 0.6), (0.9, 4.0, 0.9)]
"""Friction, tension and shear strength; each pair fails in another way."""


# all ways to fail in one direction askew, one of them in the other directions
@pytest.mark.parametrize(
    ("friction", "tension", "shear", "degrees"),
    [
        *((*each, 30.0) for each in TWO_CUBES),
        *((*TWO_CUBES[0], degrees) for degrees in (0.0, 45.0)),
        *(pytest.param(*each, degrees, marks=pytest.mark.long) for each in TWO_CUBES[1:] for degrees in (0.0, 45.0)),
    ],
)
def test_two_cubes_in_any_direction(friction: float, tension: float, shear: float, degrees: float) -> None:
    """The corners of a dry rectangle, and points at a third of them of an inner one, are the uncoupled yield sets of
    the paper as long as nothing twists: the experiment gives λ."""
    assembly = build_assembly(
        stacked_cubes(2, friction=friction, tension=tension, shear=shear, direction=float(np.radians(degrees)))
    )
    curve = run_experiment(assembly, joints=Joints(inner="plastic"), settings=LIMIT)
    assert curve.rates_agree
    assert curve.collapse_load == pytest.approx(solve(assembly).load_factor, rel=3e-3)


def prism(sides: int, live: dict[str, Any]) -> dict[str, Any]:
    """A regular prism of unit radius on a base of the same shape, weight 5, μ = 0.4."""
    turn = 2.0 * np.pi * np.arange(sides) / sides

    def solid(low: float, high: float) -> dict[str, Any]:
        ring = [[float(np.cos(a)), float(np.sin(a))] for a in turn]
        vertices = [[*p, low] for p in ring] + [[*p, high] for p in ring]
        walls = [[k, (k + 1) % sides, sides + (k + 1) % sides, sides + k] for k in range(sides)]
        return {"vertices": vertices, "faces": [[*range(sides)][::-1], [*range(sides, 2 * sides)], *walls]}

    return {
        "elements": [
            {"id": "prism", "weight": 5.0, **solid(0.0, 0.5)},
            {"id": "base", "support": True, **solid(-0.5, 0.0)},
        ],
        "materials": {"dry": {"friction_coefficient": 0.4}},
        "loads": {"live": [{"element": "prism", **live}]},
    }


@pytest.mark.parametrize("sides", [4, pytest.param(6, marks=pytest.mark.long)])
def test_torsion_of_a_prism(sides: int) -> None:
    """MT = μ N c_T under a pressure that stays even; polygons by a fan of triangles, rectangles by a product."""
    document = prism(sides, {"force": [0, 0, 0], "moment": [0, 0, 1]})
    assembly = build_assembly(parse_scene(document))
    settings = Settings(scheme="midpoint", segments=16, periods=60.0)
    curve = run_experiment(assembly, joints=Joints(inner="plastic"), settings=settings)
    faces = assembly.interfaces
    assert curve.collapse_load == pytest.approx(0.4 * 5.0 * float(faces.c_t[0]), rel=5e-3)


@pytest.mark.parametrize("scheme", ["trapezoid", "simpson", "midpoint", "limit"])
@pytest.mark.parametrize("sides", [3, 4, 5])
def test_sub_contacts_of_a_polygon(scheme: str, sides: int) -> None:
    """Areas are positive, add up, and leave the centroid where it is; Simpson's give the second moments exactly."""
    assembly = build_assembly(parse_scene(prism(sides, {"force": [1, 0, 0]})))
    points = sub_contacts(assembly, assembly.labels, scheme, 3)
    x1, x2, area = points.place.T
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(assembly.interfaces.area[0], rel=1e-12)
    assert abs(x1 @ area) + abs(x2 @ area) < 1e-12
    exact = sides / 8.0 * np.sin(2 * np.pi / sides) * (2.0 + np.cos(2 * np.pi / sides)) / 3.0
    found = np.array([(x1 * x1) @ area, (x2 * x2) @ area])
    if scheme == "simpson":
        assert found == pytest.approx(exact, rel=1e-9)
    elif scheme != "limit":
        assert found == pytest.approx(exact, rel=0.25)


def turned(document: dict[str, Any], rotation: Rotation) -> dict[str, Any]:
    """The scene turned about the origin, with its loads."""
    changed = copy.deepcopy(document)
    for element in changed["elements"]:
        element["vertices"] = rotation.apply(np.array(element["vertices"])).tolist()
    changed["materials"]["gravity"] = rotation.apply([0.0, 0.0, -9.81]).tolist()
    for entry in changed["loads"]["live"]:
        for key in ("force", "moment"):
            if key in entry:
                entry[key] = rotation.apply(np.array(entry[key], dtype=float)).tolist()
    return changed


def test_invariance_to_a_turn_in_space() -> None:
    document = prism(6, {"force": [0.3, 0.1, 0.0], "moment": [0.0, 0.0, 0.6]})
    base = run_experiment(build_assembly(parse_scene(document)), joints=Joints(inner="plastic"))
    moved = turned(document, Rotation.from_rotvec([0.3, -1.1, 0.7]))
    other = run_experiment(build_assembly(parse_scene(moved)), joints=Joints(inner="plastic"))
    assert base.rates_agree
    assert other.collapse_load == pytest.approx(base.collapse_load, rel=1e-3)


def test_forces_at_rest_are_in_equilibrium() -> None:
    """The batch solver's resultants against the equilibrium of limit analysis, which is built elsewhere."""
    assembly = build_assembly(stacked_cubes(3, friction=0.5, tension=1.0, shear=0.5, direction=0.4))
    specimen = specimen_of(assembly, assembly.labels, Joints(inner="plastic"), Settings())
    settled, standing = specimen.settle()
    assert standing is Standing.RESTS
    factor = 0.1
    specimen.march(settled, round(20 * specimen.system.period), load_factor=(0.0, factor))
    assert specimen.rest(settled, factor) is Standing.RESTS
    dead, live = load_vectors(assembly)
    residual = equilibrium_matrix(assembly) @ specimen.resultants(settled).ravel() + dead + factor * live
    assert np.abs(residual).max() < 1e-6
