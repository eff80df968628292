"""Sample assemblies of compas_cra 0.8.0 (MIT), values by two independent implementations, in four directions.

`spatial_cubes`: convex and concave contact agree, tolerance 1e-6. `spatial_shelf`: tolerance 1e-5.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import as_elements, dry_and_inner
from cases import assembly_in_space as spatial_assembly
from cases import wall_in_space as spatial_wall
from command import SCENES
from jld_core import Assembly, LimitAnalysis, Status, build_assembly, load_scene, parse_scene, solve
from jld_core.mechanics import equilibrium_matrix, load_vectors
from proofs import load_factor_in_space, noisy

DIRECTIONS = {"px": [1, 0, 0], "mx": [-1, 0, 0], "py": [0, 1, 0], "my": [0, -1, 0]}


def sample(name: str, direction: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((SCENES / f"{name}.json").read_text())
    document["loads"]["live"] = [{"body": DIRECTIONS[direction]}]
    return document


@pytest.mark.parametrize("contact", ["convex", "concave"])
@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize(("name", "tolerance"), [("spatial_cubes", 1e-6), ("spatial_shelf", 1e-5)])
def test_spatial_samples_have_their_expected_load_factors(
    name: str, tolerance: float, direction: str, contact: str
) -> None:
    document = sample(name, direction)
    expected = document["expected"].get("load_factor") or document["expected"][f"load_factor_{contact}"]
    assembly = build_assembly(parse_scene(document))
    result = solve(assembly, contact=contact)
    assert result.status is Status.COLLAPSE
    assert result.contact == contact
    assert result.load_factor == pytest.approx(expected[direction], rel=tolerance)
    assert result.gap < 1e-6
    assert result.load_factor == pytest.approx(load_factor_in_space(document, concave=contact == "concave"), rel=1e-6)
    matrix, (dead, live) = equilibrium_matrix(assembly), load_vectors(assembly)
    left = matrix @ result.forces.ravel() + dead + result.bracket[0] * live
    assert abs(left).max() <= 1e-10 * abs(dead).max()


@pytest.mark.parametrize("name", ["ferris_tinloi_1", "ferris_tinloi_2", "ferris_tinloi_4"])
def test_extruded_wall_is_the_planar_one(name: str) -> None:
    """A planar wall given depth and loaded in its plane collapses at the same λ, to 1e-6."""
    scene = load_scene(SCENES / f"{name}.json")
    planar = solve(build_assembly(scene))
    document = as_elements(scene)
    depth = 1.7
    elements = []
    for element in document["elements"]:
        base = np.array(element["polygon"])
        count = len(base)
        vertices = [[x, y, z] for y in (0.0, depth) for x, z in base]
        around = [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
        faces = [list(range(count))[::-1], list(range(count, 2 * count)), *around]
        elements.append(
            {
                "id": element["id"],
                "vertices": vertices,
                "faces": faces,
                "weight": element["weight"],
                "support": element["support"],
            }
        )
    extruded = build_assembly(
        parse_scene(
            {
                "elements": elements,
                "materials": {"dry": document["materials"]["dry"]},
                "loads": {"live": [{"body": [1, 0, 0]}]},
            }
        )
    )
    assert len(extruded.interfaces) == scene.expected["interfaces"]
    result = solve(extruded)
    assert result.load_factor == pytest.approx(planar.load_factor, rel=1e-6)
    assert result.gap < 1e-6


def random_pile(seed: int) -> tuple[dict[str, Any], Assembly]:
    """A small two-wythe wall, its bricks jittered in weight, some faces glued, loaded in a random direction."""
    rng = np.random.default_rng(seed)
    elements = spatial_wall(int(rng.integers(2, 4)), int(rng.integers(2, 4)))
    for element in elements:
        if not element.get("support"):
            element["density"] = float(rng.uniform(500.0, 2000.0))
    direction = rng.normal(size=3) * np.array([1.0, 1.0, 0.3])
    document: dict[str, Any] = {
        "elements": elements,
        "materials": dry_and_inner(
            1.0, float(rng.uniform(0.3, 0.9)), float(rng.uniform(0, 100)), float(rng.uniform(10, 200)), gravity=1.0
        ),
        "loads": {"live": [{"body": direction.tolist()}]},
    }
    assembly = build_assembly(parse_scene(document))
    faces, ids = assembly.interfaces, assembly.elements.ids
    pairs = [[ids[a], ids[b]] for a, b in zip(faces.a, faces.b, strict=True)]
    document["labels"] = {"default": "dry", "inner": [pair for pair in pairs if rng.random() < 0.3]}
    return document, build_assembly(parse_scene(document))


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
@pytest.mark.filterwarnings("ignore")
def test_random_assemblies_against_an_independent_statement(seed: int) -> None:
    document, assembly = random_pile(seed)
    result = solve(assembly)
    faces, ids = assembly.interfaces, assembly.elements.ids
    bodies = {
        name: (volume, centre)
        for name, volume, centre in zip(ids, assembly.elements.volume, assembly.elements.centroid, strict=True)
    }
    stated = {
        **document,
        "elements": [
            {"support": False, **e, "volume": float(bodies[e["id"]][0]), "centroid": bodies[e["id"]][1].tolist()}
            for e in document["elements"]
        ],
        "interfaces": [
            {"elements": [ids[a], ids[b]], "polygon": polygon.tolist(), "label": "dry" if dry else "inner"}
            for a, b, polygon, dry in zip(faces.a, faces.b, faces.polygon, assembly.labels, strict=True)
        ],
    }
    if result.status is Status.COLLAPSE:
        assert result.gap < 1e-6
        assert result.load_factor == pytest.approx(load_factor_in_space(stated), rel=1e-6, abs=1e-7)
    else:
        assert result.status in (Status.LOCKED, Status.UNSTABLE)


def test_a_spatial_bracket_holds_under_noise() -> None:
    """Whatever the solver says: the answer spoilt by 1e-2 to 1e-6, the bracket still contains λ."""
    analysis = LimitAnalysis(spatial_assembly(spatial_wall(3, 3)))
    labels = analysis.assembly.labels
    truth = analysis.prove(labels)
    for level in (1e-2, 1e-4, 1e-6):
        for seed in range(10):
            proof = noisy(analysis, labels, level, seed)
            assert proof.low <= truth.high + 1e-9
            assert proof.high >= truth.low - 1e-9
