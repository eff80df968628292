"""Torsion about effective areas (Iannuzzo et al. 2024, eq. 5 and 8): closed forms, fixed points, support functions."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks.claims.answers import drawn_converged as drawn
from studies.by_scheme import solve_zero_dilation

import cases
from command import SCENES
from jld_core import Assembly, InputError, LimitAnalysis, Status, build_assembly, load_scene, parse_scene, solve
from jld_core.geometry import outlines
from jld_core.mechanics import prescribed_friction
from jld_core.models import areas_under, effective_area
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver
from jld_samples import vault

FRICTION, WIDTH, DEPTH = 0.7, 1.2, 0.7


def prism(eccentric: float, axis: int = 0, moment: float = 1.0) -> Assembly:
    """A prism of weight 1 under a second unit weight, twice `eccentric` off its axis, turned by a couple."""
    elements = [
        cases.box("prism", [0, 0, 0], [WIDTH, DEPTH, 1 / (WIDTH * DEPTH)]),
        cases.box("ground", [-1, -1, -1], [2, 2, 0], support=True),
    ]
    at = [WIDTH / 2, DEPTH / 2, 0.5]
    at[axis] += 2.0 * eccentric
    document: dict[str, Any] = cases.scene_in_space(elements)
    document["loads"] = {
        "dead": [{"element": "prism", "force": [0, 0, -1], "at": at}],
        "live": [{"element": "prism", "force": [0, 0, 0], "moment": [0, 0, moment]}],
    }
    return build_assembly(parse_scene(document))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("eccentric", [0.0, 0.05, 0.15, 0.25])
def test_prism_in_torsion(eccentric: float, axis: int) -> None:
    """λ = μ N c_T of the rectangle less 2|x|; without effective area of the whole one."""
    analysis = LimitAnalysis(prism(eccentric, axis))
    result = solve(analysis.assembly, effective_area=True)
    sides = np.array([WIDTH, DEPTH])
    whole = FRICTION * 2.0 * outlines.rectangle_torsion_length(*sides[:, None])[0]
    sides[axis] -= 2.0 * eccentric
    expected = FRICTION * 2.0 * outlines.rectangle_torsion_length(*sides[:, None])[0]
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(expected, rel=1e-8)
    assert result.facts["load_factor_whole_faces"] == pytest.approx(whole, rel=1e-8)
    assert result.facts["effective_area"]["fixed_point"] <= 1e-8
    json.dumps(result.to_json(), allow_nan=False)
    if eccentric:
        assert result.load_factor < result.facts["load_factor_whole_faces"] - 1e-3
    zero = solve_zero_dilation(analysis.assembly, effective_area=True)
    assert zero.status is Status.COLLAPSE
    assert zero.load_factor == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("live", [[1, 0, 0], [0, 1, 0]])
def test_walls_reach_a_fixed_point(live: list[float]) -> None:
    assembly = cases.assembly_in_space(cases.wall_in_space(4, 3, 1), live=[{"body": live}])
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    analysis = LimitAnalysis(assembly, reference=dry)
    result = solve(assembly, dry, effective_area=True)
    assert result.status is Status.COLLAPSE
    assert result.facts["effective_area"]["fixed_point"] <= 1e-8
    scaled = result.forces / analysis.template.scaling.face
    areas = areas_under(assembly, scaled, dry)
    frozen = effective_area.frozen_areas(analysis.template, areas)
    # the forces lie in the set that they themselves ask for
    assert frozen.yield_set.slack(scaled, dry).min() >= -1e-12
    assert solve_zero_dilation(assembly, dry, effective_area=True).status is Status.COLLAPSE


def test_faces_that_are_no_rectangles_keep_their_whole_area() -> None:
    """The barrel vault of the samples: joints between its arches are wedges, joints of its arches rectangles."""
    assembly = build_assembly(vault())
    odd = int((~assembly.interfaces.rectangle).sum())
    result = solve(assembly, np.ones(len(assembly.interfaces), dtype=bool), effective_area=True)
    assert result.status is Status.COLLAPSE
    assert result.facts["effective_area"]["fixed_point"] <= 1e-8
    assert 0 < odd < len(assembly.interfaces)
    assert f"{odd} of {len(assembly.interfaces)} dry faces are no rectangles" in result.notes[0]
    assert result.notes[0] in result.to_json()["warnings"]


def test_a_load_factor_above_that_of_whole_faces_is_reported() -> None:
    """About its own centre of pressure a face bears shear that twists it about its centroid, so λ may rise."""
    assembly, labels = drawn(302)
    result = solve(assembly, labels, effective_area=True)
    whole = result.facts["load_factor_whole_faces"]
    assert result.load_factor > 1.01 * whole
    share = f"{result.load_factor / whole - 1.0:.1%}"
    assert any(f"{share} above that of whole faces" in note for note in result.notes)


def random_set(
    seed: int, alpha: float, contact: bool
) -> tuple[Template, prescribed_friction.PrescribedFriction, np.random.Generator]:
    rng = np.random.default_rng(seed)
    analysis = LimitAnalysis(build_assembly(load_scene(SCENES / "spatial_cubes.json")))
    template, count = analysis.template, len(analysis.assembly.interfaces)
    forces = np.column_stack([rng.uniform(0.5, 2.0, count), rng.uniform(-0.4, 0.4, (count, 5))])
    dry = np.ones(count, dtype=bool)
    areas = areas_under(analysis.assembly, forces, dry) if contact else None
    base = template.yield_set
    sets = prescribed_friction.PrescribedFriction(base, alpha, rng.uniform(0.0, 2.0, count), areas)
    return template.renumbered(sets), sets, rng


@pytest.mark.parametrize("contact", [False, True])
@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_rows_slack_and_dissipation_say_the_same(alpha: float, contact: bool) -> None:
    """The greatest work over the solver's rows is the closed-form dissipation; its forces have no slack left."""
    template, sets, rng = random_set(3, alpha, contact)
    count = len(template.assembly.interfaces)
    dry = np.ones(count, dtype=bool)
    jumps = rng.normal(size=(count, 6))
    # opening enough for a finite dissipation, and N held from growing
    jumps[:, 0] -= np.minimum(sets.margin(jumps, dry), 0.0) * (1.0 + 1e-6) - 1e-3
    program = template.program(dry)
    rows, s = program.matrix.tocsr(), program.structure
    keep = np.arange(s.equalities, s.shape[0])
    structure = replace(s, equalities=0, shape=(len(keep), s.shape[1]))
    part = rows[keep].tocsc()
    part.sort_indices()
    structure = replace(structure, indices=part.indices, indptr=part.indptr)
    objective = np.zeros(s.shape[1])
    objective[: 6 * count] = jumps.ravel()
    # λ is in its own bound only
    objective[-1] = 1.0
    answer = ClarabelSolver().solve(
        replace(program, structure=structure, data=part.data, rhs=program.rhs[keep], objective=objective)
    )
    forces = answer.point[: 6 * count].reshape(count, 6)
    work = -np.einsum("ij,ij->i", forces, jumps)
    assert sets.dissipation(jumps, dry) == pytest.approx(work, abs=1e-6)
    assert sets.slack(forces, dry) == pytest.approx(0.0, abs=1e-6)


def test_change_is_zero_for_equal_areas_and_bad_scenes_are_refused() -> None:
    assembly = prism(0.1)
    forces = np.array([[2.0, 0.1, 0.2, 0.3, 0.4, 0.5]])
    dry = np.ones(1, dtype=bool)
    first = areas_under(assembly, forces, dry)
    assert effective_area.largest_area_change(first, first) == 0.0
    assert effective_area.largest_area_change(first, areas_under(assembly, 0.0 * forces, dry)) > 0.1
    with pytest.raises(InputError, match="planar"):
        solve(build_assembly(load_scene(SCENES / "ferris_tinloi_1.json")), effective_area=True)
    odd = cases.stools([cases.TRIANGLE])
    with pytest.raises(InputError, match="no rectangle"):
        solve(odd, effective_area=True)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", [341, 5033, 5045, 5132, 5162, 5570])
def test_locked_is_proven_by_forces_within_their_own_areas(seed: int) -> None:
    """The ray of frozen areas need not fit the areas that it asks for; areas of proximal iteration may not settle."""
    assembly, labels = drawn(seed)
    result = solve(assembly, labels, effective_area=True)
    assert result.status is Status.LOCKED
    analysis = LimitAnalysis(assembly)
    for load in (1e2, 1e4, 1e6):
        forces = (result.forces + load * result.unbounded_forces) / analysis.template.scaling.face
        frozen = effective_area.frozen_areas(analysis.template, areas_under(assembly, forces, labels))
        assert frozen.yield_set.slack(forces, labels).min() >= -1e-12 * load


@pytest.mark.parametrize(
    ("push", "across", "status"),
    [(0.2, 0.1, Status.COLLAPSE), (0.7, 0.1, Status.UNCERTIFIED), (1.2, 0.5, Status.UNSTABLE)],
)
def test_unstable_is_proven_for_all_areas_or_not_at_all(push: float, across: float, status: Status) -> None:
    """A cube pushed where it is pressed, off its middle: whole faces twist at |V| (1 + x/c_T) = μN, effective at μN."""
    elements = [cases.box("cube", [0, 0, 0], [1, 1, 1]), cases.box("floor", [-1, -1, -1], [2, 2, 0], support=True)]
    pressed = {"element": "cube", "force": [0.0, 0.0, -1e6], "at": [0.5, across, 0.0]}
    pushed = {"element": "cube", "force": [push * 0.5e6, 0.0, 0.0], "at": [0.5, across, 0.0]}
    document = cases.scene_in_space(
        elements, materials={"dry": {"friction_coefficient": 0.5}}, live=[{"element": "cube", "force": [1.0, 0.0, 0.0]}]
    )
    document["loads"]["dead"] = [pressed, pushed]
    result = solve(build_assembly(parse_scene(document)), effective_area=True)
    assert result.status is status
    assert bool(result.reason) is (status is Status.UNCERTIFIED)
