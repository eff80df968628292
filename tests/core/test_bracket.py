"""The bracket holds whatever the solver said: noise on its answer, an unconverged answer, nonsense."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import CASES, ROUTE, Document, all_inner, grid_assembly, grid_document
from cases_spatial import assembly, box
from jld_core import LimitAnalysis, Status, build_assembly, parse_scene, solve
from jld_core.batch import chosen
from jld_core.solvers import ClarabelSolver
from noisy import noisy

NAMES = ["wall", "beam", "arch", "crushable wall", "cantilever", "no friction", "very strong"]
ANALYSES = {name: LimitAnalysis(grid_assembly(CASES[name][0], **CASES[name][1])) for name in NAMES}


@settings(max_examples=120, deadline=None, derandomize=True)
@given(st.sampled_from(NAMES), st.sampled_from([1e-2, 1e-4, 1e-6]), st.integers(0, 2**31))
def test_bracket_contains_the_true_value_under_noise(name: str, level: float, seed: int) -> None:
    analysis = ANALYSES[name]
    labels = np.random.default_rng(seed).random(len(analysis.assembly.interfaces)) < 0.5
    truth = analysis.prove(labels)
    proof = noisy(analysis, labels, level, seed)
    if truth.status is Status.COLLAPSE:
        slack = 1e-6 * max(abs(truth.high), 1e-3)
        assert proof.low <= truth.high + slack
        assert proof.high >= truth.low - slack
        assert proof.collapse_below_zero is None
    elif truth.status is Status.UNSTABLE:
        assert proof.low < 0.0 or proof.state is None
    elif truth.status is Status.LOCKED:
        assert proof.motion is None or proof.high >= proof.low


@pytest.mark.parametrize("name", NAMES)
def test_nonsense_proves_nothing(name: str) -> None:
    analysis = ANALYSES[name]
    labels = np.ones(len(analysis.assembly.interfaces), dtype=bool)
    rows, columns = analysis.template.structure.shape
    for filling in (np.nan, np.inf, 0.0):
        assert not analysis.prover.state(np.full(columns, filling), labels).admissible or filling == 0.0
        motion = analysis.prover.motion(np.full(rows, filling), labels)
        assert not (motion.margin >= 0.0 and motion.work > 0.0)


@pytest.mark.parametrize("iterations", [1, 3, 6])
def test_an_unconverged_solver_does_not_change_the_load_factor(iterations: int) -> None:
    """A solver stopped early may not change λ: fallbacks prove it, or the result says uncertified."""
    assembly = grid_assembly(*CASES["wall"][:1])
    labels = np.random.default_rng(1).random(len(assembly.interfaces)) < 0.6
    truth = LimitAnalysis(assembly).solve(labels)
    hasty = LimitAnalysis(assembly)
    hasty.first_solver = ClarabelSolver(max_iter=iterations)
    result = hasty.solve(labels)
    assert result.status in (Status.COLLAPSE, Status.UNCERTIFIED)
    if result.status is Status.COLLAPSE:
        assert result.load_factor == pytest.approx(truth.load_factor, rel=1e-6)
    assert any("limit" in step for step in result.solve_log)


def test_forces_and_mechanism_prove_the_bracket_in_scene_units() -> None:
    """What is reported is what was proven: equilibrium, yield and work balance redone from the result alone."""
    from jld_core.mechanics import equilibrium_matrix, load_vectors

    for name in ("wall", "beam", "cantilever"):
        assembly = grid_assembly(CASES[name][0], **CASES[name][1])
        labels = np.arange(len(assembly.interfaces)) % 3 == 0
        labels[~assembly.free_faces] = name != "cantilever"
        result = LimitAnalysis(assembly).solve(labels)
        if result.status is not Status.COLLAPSE:
            continue
        assert result.forces is not None
        assert result.mechanism is not None
        matrix, (dead, live) = equilibrium_matrix(assembly), load_vectors(assembly)
        left = matrix @ result.forces.ravel() + dead + result.bracket[0] * live
        assert abs(left).max() <= 1e-9 * abs(dead).max()
        faces, s = assembly.interfaces, assembly.strengths(ROUTE)
        n, v, m = result.forces.T
        dry, inner = labels, ~labels
        assert np.all(abs(m[dry]) <= n[dry] * faces.l1[dry] / 2)
        assert np.all(abs(v[dry]) <= s.friction[dry] * n[dry])
        assert np.all(abs(m[inner]) <= (n + s.tension * faces.area)[inner] * faces.l1[inner] / 6)
        assert np.all(abs(v[inner]) <= (s.shear * faces.area)[inner])
        u = result.mechanism[assembly.elements.free].ravel()
        assert live @ u == pytest.approx(1.0, rel=1e-9)
        jumps = (matrix.T @ u).reshape(-1, 3)
        opening, slip, turn = jumps[:, 0], abs(jumps[:, 1]), abs(jumps[:, 2])
        reach = faces.l1 / np.where(labels, 2.0, 6.0)
        assert np.all(opening - reach * turn - np.where(labels, s.friction, 0.0) * slip >= -1e-12 * abs(u).max())
        dissipated = np.where(labels, 0.0, faces.area * (s.tension * opening + s.shear * slip)).sum()
        assert dissipated - dead @ u == pytest.approx(result.bracket[1], rel=1e-9)


@pytest.mark.skipif(chosen() is None, reason="without a kernel nothing takes faces out that no ray presses")
@pytest.mark.parametrize("glued", [False, True])
def test_a_cube_pressed_beside_another_is_locked(glued: bool) -> None:
    """Two cubes side by side on a slab, the first pressed down through its middle: any λ goes straight into the slab.
    No ray has a force in the face between them, so none lies inside all cones."""
    cubes = [
        box("slab", [0, 0, -1], [2, 1, 0], support=True),
        box("pressed", [0, 0, 0], [1, 1, 1]),
        box("other", [1, 0, 0], [2, 1, 1]),
    ]
    live = [{"element": "pressed", "force": [0, 0, -1]}]
    labels = {"inner": [["pressed", "other"]]} if glued else {}
    assert solve(assembly(cubes, live=live, labels={"default": "dry", **labels})).status is Status.LOCKED


def of_all_inner(document: Document, dry: list[list[str]] | None = None, **loads: list[Document]) -> Status:
    scene = all_inner(document | {"loads": document["loads"] | loads}, dry=dry or [])
    return solve(build_assembly(parse_scene(scene))).status


def test_nothing_stands_though_ever_more_load_could_be_carried() -> None:
    """A cell glued to the ground, its weight W = 13.7 N pushing sideways with W/2 = 6.9 N against τA = 5 N: no λ mends
    that. The live load presses down and could grow for ever, so no motion of negative excess makes it work either."""
    document = grid_document(["a", "#"], shear=500.0, crush_dry=1e6, live=[{"element": "c0r0", "force": [0, -1]}])
    pushed = [{"body": [0.5, 0]}]
    assert of_all_inner(document, dead=pushed) is Status.UNSTABLE
    # just as much as is held: 5 N
    held = [{"body": [4.99 / (1400 * 9.81 * 0.001), 0]}]
    assert of_all_inner(document, dead=held) is Status.LOCKED


def test_a_ray_past_a_joint_that_crushes() -> None:
    """The live load goes from one cell through its inner face straight into the abutment; above it stands another on a
    joint without friction that crushes and bears no ray."""
    document = grid_document(
        ["#a.#", "#bc#", "#dd#"], friction=0.0, crush_dry=1e6, live=[{"element": "c1r1", "force": [1, 0]}]
    )
    assert of_all_inner(document, [["c1r0", "c1r1"]]) is Status.LOCKED


def test_cracks_without_strength_beside_a_joint_that_crushes() -> None:
    """Cracks with σt = τ = 0 carry no shear, so a sideways push has λ = 0; a first answer of infeasible is no end."""
    document = grid_document(
        ["a.", "bc", "##"],
        crush_dry=1.2e6,
        tension=0.0,
        shear=0.0,
        live=[{"element": "c0r0", "force": [2, -1], "at": [0.02, 0.25]}],
    )
    dry = [["c0r0", "c0r1"], ["c0r1", "c1r1"]]
    result = solve(build_assembly(parse_scene(all_inner(document, dry=dry))))
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(0.0, abs=1e-6 * 13.7)
