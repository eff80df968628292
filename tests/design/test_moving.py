"""Joints of designs that move: faces crush as blocks do meanwhile, and what is found is weighed as stated."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cases import ROUTE, grid_document
from jld_core import Deadline, Scene, build_assembly, parse_scene, solve
from jld_core.fields import governing_bounds
from jld_practice.design import (
    Design,
    DesignOptions,
    Outline,
    Task,
    Tessellation,
    Trial,
    run,
    uniaxial_strength,
    with_crushing,
)

FRICTION = 0.9


@pytest.fixture(scope="module")
def wall() -> Scene:
    """Two courses of two cells under a push to the side, whose joints may lean."""
    push = [{"body": [1.0, 0.0]}]
    document = grid_document(["ab", "cd", "##"], live=push, tension=3e5, shear=5e5, friction=FRICTION, blocks=[4, None])
    return parse_scene({**document, "move": {"inner": "follow", "straight": False}})


@pytest.mark.parametrize(("friction", "expected"), [(0.0, 1e6), (0.75, 2e6)])
def test_blocks_fail_in_uniaxial_compression_at_the_closed_form(wall: Scene, friction: float, expected: float) -> None:
    """2 c cos φ/(1 − sin φ) with c = 0.5 MPa (Mohr–Coulomb): 2 c without friction, 2·0.8/0.4 c with tan φ = 3/4."""
    document = json.loads(wall.model_dump_json(exclude_defaults=True))
    document["materials"]["inner"]["friction_coefficient"] = friction
    document["materials"]["inner"]["tensile_strength"] = 1e5
    scene = parse_scene(document)
    assert uniaxial_strength(scene) == pytest.approx(expected, rel=1e-12)
    for share in (1.0, 0.5):
        strengths = build_assembly(with_crushing(scene, share)).strengths(ROUTE)
        assert strengths.crush_dry == pytest.approx(share * expected, rel=1e-12)
    document["materials"]["dry"]["compressive_strength"] = 0.1 * expected
    kept = build_assembly(with_crushing(parse_scene(document))).strengths(ROUTE)
    assert kept.crush_dry == pytest.approx(0.1 * expected, rel=1e-12)


def test_a_moved_layout_is_weighed_with_its_own_materials(wall: Scene) -> None:
    """λ by fields is at most μ, by sliding of the whole wall; the layout gains over the one that stays."""
    labels = build_assembly(wall).labels
    found = run.moved_trial(Task("bond", wall, labels, "as stated"), 1.0, 2.0)
    assert isinstance(found, Trial)
    assert found.scene.materials == wall.materials
    assert found.load_factor > solve(wall).load_factor * 1.05
    assert found.fields[0] <= FRICTION * (1.0 + 1e-9)
    assembly = build_assembly(found.scene)
    again = governing_bounds(assembly, assembly.labels, 1.0)
    assert again[0] <= found.fields[1] * (1.0 + 1e-9)
    assert again[1] >= found.fields[0] * (1.0 - 1e-9)


def test_results_of_earlier_rounds_are_kept(wall: Scene, tmp_path: Path) -> None:
    """The winner after the rounds has the largest proven λ of all layouts that were moved, and more than at first."""
    assembly = build_assembly(wall)
    faces = solve(wall).bracket
    stated = Trial("bond", "stated", wall, solve(wall).load_factor, faces, (-np.inf, np.inf), "")
    options = DesignOptions(seconds=20.0, jobs=1)
    work = Design(options, Outline(wall, ()), tmp_path, [Tessellation("bond", "bond", wall)], [stated])
    work.layouts["bond"] = [assembly.labels]
    said: list[str] = []
    run.move_in_rounds(work, Deadline(9.0), said.append)
    moved = [one for one in work.trials if one.kind == "moved"]
    assert moved
    assert work.winner.proven == max(one.proven for one in moved)
    assert np.isfinite(work.winner.proven)
    assert any("layouts moved" in line for line in said)
