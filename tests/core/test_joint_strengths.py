"""Strengths of joints: bond, cohesion, friction inside, values of single faces, by closed forms and second routes."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.by_scheme import solve_zero_dilation

import cases
from cases import CASES, ROUTE, grid_assembly, grid_document, solved
from command import refused
from jld_core import (
    Assembly,
    InputError,
    Layout,
    LimitAnalysis,
    Scene,
    SolveOptions,
    Status,
    build_assembly,
    parse_scene,
    solve,
)
from jld_core.build import build_robust
from jld_core.limit import result_of
from jld_core.mechanics import scaling_of, yield_set
from jld_core.refinement import refine
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import DRIVERS
from jld_explore.verification import verify
from jld_formats import export, import_file
from jld_views import quantities
from proofs import flow_rule, load_factor_in_space, reference_load_factor

Document = dict[str, Any]


def cantilever(count: int, live: list[Document], weight: float = 0.0, **dry: float) -> Document:
    """`count` blocks of 1 × 2 that stick out of a wall at x = 0, bonded by vertical joints."""
    blocks = [
        {"id": f"b{k}", "polygon": [[k, 0], [k + 1, 0], [k + 1, 2], [k, 2]], "weight": weight} for k in range(count)
    ]
    wall = {"id": "w", "polygon": [[-1, -1], [0, -1], [0, 3], [-1, 3]], "support": True}
    return {
        "elements": [*blocks, wall],
        "thickness": 0.5,
        "materials": {"dry": {"friction_coefficient": 0.5, "cohesion": 8.0, "tensile_strength": 6.0, **dry}},
        "loads": {"live": live},
    }


def test_bonded_joint_pulls_as_much_as_its_strength() -> None:
    """λ F = σt A; N of the result is the tension."""
    result = solved(cantilever(2, [{"element": "b1", "force": [2.0, 0.0]}]))
    assert result.load_factor == pytest.approx(6.0 * 1.0 / 2.0, rel=1e-8)
    assert result.forces[:, 0] == pytest.approx(-6.0, rel=1e-6)
    assert quantities.utilisation(result).max() == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("weight", [0.0, 0.4])
def test_bonded_cantilever(count: int, weight: float) -> None:
    """Pure bending at the root turns about its lower edge: λ F L + W L/2 = σt b h²/2 with b h² / 2 = 1."""
    result = solved(cantilever(count, [{"element": f"b{count - 1}", "force": [0, -1], "at": [count, 1.0]}], weight))
    expected = (6.0 * 0.5 * 2.0**2 / 2.0 - count * weight * count / 2.0) / count
    assert result.load_factor == pytest.approx(min(expected, 8.0 - count * weight), rel=1e-8)


def test_bonded_joint_that_crushes() -> None:
    """Stress blocks at σt and σc: N' = σt A, M = (l/2) N' (1 − N'/(σc + σt) A) = (l/2) A σt σc/(σc + σt)."""
    pull = [{"element": "b0", "moment": -1.0}]
    result = solved(cantilever(1, pull, compressive_strength=18.0))
    assert result.load_factor == pytest.approx(1.0 * 6.0 * 18.0 / 24.0, rel=1e-6)


@pytest.mark.parametrize("pull", [0.0, 2.0, 5.9])
def test_shear_of_a_bonded_joint_under_tension(pull: float) -> None:
    """|V| = c A + μ N with N < 0."""
    document = cantilever(1, [{"element": "b0", "force": [0, -1], "at": [0.0, 1.0]}])
    document["loads"]["dead"] = [{"element": "b0", "force": [pull, 0.0]}]
    result = solved(document)
    assert result.load_factor == pytest.approx(8.0 - 0.5 * pull, rel=1e-7)


def test_bonded_cantilever_in_space() -> None:
    """As in the plane, about the lower edge of the root."""
    x, y, z = (0, 1), (0, 0.5), (0, 2)

    def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Document:
        corners = [[x[i], y[j], z[k]] for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        return {"vertices": corners, "faces": faces}

    document = {
        "elements": [
            {"id": "b", **box(x, y, z), "weight": 0.0},
            {"id": "w", **box((-1, 0), (-1, 2), (-1, 3)), "support": True},
        ],
        "materials": {"dry": {"friction_coefficient": 0.5, "cohesion": 8.0, "tensile_strength": 6.0}},
        "loads": {"live": [{"element": "b", "force": [0, 0, -1], "at": [1, 0.25, 1]}]},
    }
    assert solved(document).load_factor == pytest.approx(6.0, rel=1e-6)


def wall(**more: Any) -> Document:
    return {
        "name": "wall",
        "grid": {"cell": [1, 1], "thickness": 1.0, "rows": ["aab", "cdd", "###"]},
        "materials": {
            "density": 1000,
            "dry": {"friction_coefficient": 0.5, "cohesion": 2e3, "tensile_strength": 3e3},
            "inner": {"tensile_strength": 9e3, "shear_strength": 6e3},
            "faces": [{"between": ["c0r0", "c0r1"], "dry": {"tensile_strength": 0.0}}],
        },
        "loads": {"live": [{"body": [1, 0]}]},
        **more,
    }


def test_load_factor_is_that_of_an_independent_statement() -> None:
    """Layouts drawn at random, dry faces with and without bond beside inner ones."""
    document = wall()
    without = wall()
    without["materials"] = {**without["materials"], "dry": {**without["materials"]["dry"], "tensile_strength": 0.0}}
    assembly, plain = build_assembly(parse_scene(document)), build_assembly(parse_scene(without))
    rng = np.random.default_rng(2)
    for row in rng.random((2, len(assembly.interfaces))) < 0.6:
        expected = reference_load_factor(plain, row, bond=assembly.members.bond)
        for options in ({"solver": "clarabel"}, {"solver": "highs"}, {"condense": "on"}):
            assert solve(assembly, row, **options).load_factor == pytest.approx(expected, rel=1e-7)
    assert assembly.total_dead == plain.total_dead


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_proof_with_bond_is_that_of_enumeration_and_is_verified(tmp_path: Any) -> None:
    document = wall(search={"block_cells": [1, 2]})
    document["grid"] = {**document["grid"], "rows": ["ab", "cd", "ef", "##"]}
    document["materials"]["dry"]["cohesion"] = 2e4
    document["materials"]["inner"] = {"tensile_strength": 9e3, "shear_strength": 3e4}
    scene = parse_scene(document)
    every = explore(scene, out=tmp_path / "every", driver="enumeration")
    proof = explore(scene, out=tmp_path / "exact", driver="exact", certificate=tmp_path / "proof")
    assert proof.summary.proven
    assert proof.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    assert float(verify(tmp_path / "proof").claim.bound) >= float(every.summary.best or 0.0)
    document["materials"]["dry"]["tensile_strength"] = 0.0
    less = explore(parse_scene(document), out=tmp_path / "weak", driver="enumeration")
    assert float(less.summary.best or 0.0) < 0.99 * float(every.summary.best or 0.0)


def test_without_dilation_bond_holds() -> None:
    """The cantilever turns without sliding: λ is that of associative friction."""
    push = [{"element": "b0", "force": [0, -1], "at": [1, 1.0]}]
    assert solved(cantilever(1, push), friction="zero-dilation").load_factor == pytest.approx(6.0, rel=1e-5)


def thin_arch(bond: float) -> Document:
    """Arch "US" of Oliveira: intrados span 1.467 m, rise 0.593 m, t 0.05 m, width 0.45 m, 59 bricks, 18 kN/m³.

    A vertical force acts on the extrados at the middle of brick 19, near a quarter of the span. Friction 20 stands for
    joints that do not slide.
    """
    span, rise, depth, count = 1.467, 0.593, 0.05, 59
    radius = (span**2 / 4 + rise**2) / (2 * rise)
    centre, half = np.array([0.0, rise - radius]), np.arcsin(span / 2 / radius)
    turn = np.linspace(-half, half, count + 1)
    turn = np.concatenate([[2 * turn[0] - turn[1]], turn, [2 * turn[-1] - turn[-2]]])
    out = np.column_stack([np.sin(turn), np.cos(turn)])
    inside, outside = centre + radius * out, centre + (radius + depth) * out
    blocks = [
        {"id": f"v{k - 1}", "polygon": [one.tolist() for one in (inside[k], inside[k + 1], outside[k + 1], outside[k])]}
        for k in range(count + 2)
    ]
    for end in (blocks[0], blocks[-1]):
        end["support"] = True
    at = 0.5 * (turn[19] + turn[20])
    place = centre + (radius + depth) * np.array([np.sin(at), np.cos(at)])
    return {
        "elements": blocks,
        "thickness": 0.45,
        "units": {"length": "m", "force": "kN"},
        "materials": {
            "density": 18,
            "gravity": 1.0,
            "dry": {"friction_coefficient": 20, "cohesion": 20 * bond, "tensile_strength": bond},
        },
        "loads": {"live": [{"element": "v18", "force": [0, -1], "at": place.tolist()}]},
    }


def test_bonded_arch_lies_within_the_scatter_of_its_tests() -> None:
    """Two arches failed at 1.43 and 1.92 kN, 70 times what they carry without tension, .020993168300677757.

    The value and the tests are those of claudiopagani/structural-checks-ts, benchmarks/masonry-arches. The bond is
    stated here, not measured there: 0.15 MPa; from 0.13 to 0.16 MPa λ lies within the scatter.
    """
    assert solved(thin_arch(0.0)).load_factor == pytest.approx(0.020993168300677757, rel=1e-8)
    assert 1.43 < solved(thin_arch(150.0)).load_factor < 1.92


@pytest.mark.parametrize(
    ("dry", "inner", "words"),
    [
        ({"tensile_strength": -1.0}, None, "tensile_strength: -1.0 is wrong"),
        ({"tensile_strength": 17.0}, None, "17 is beyond the apex of its friction"),
        ({"tensile_strength": {"nominal": 2.0, "low": 1.0}}, None, "tensile_strength: .* is wrong"),
        ({}, {"tensile_strength": 5.0, "shear_strength": 9.0}, "6 is above the tensile strength of the same face"),
    ],
)
def test_bad_bond_is_one_line(dry: Document, inner: Document | None, words: str) -> None:
    document = cantilever(2, [{"element": "b1", "force": [1, 0]}], **dry)
    if inner is not None:
        document["materials"]["inner"] = inner
    with refused(match=words):
        build_assembly(parse_scene(document))


def test_models_without_tension_refuse_bond() -> None:
    from jld_practice.laying import assembly_order

    assembly = build_assembly(parse_scene(wall()))
    with pytest.raises(InputError, match=r"materials\.dry\.tensile_strength: an assembly sequence does not model it"):
        assembly_order(assembly, assembly.labels)


# Cohesion of dry faces and friction of inner ones, against closed forms and statements of their own.
#
# Shear |V| (in space |V| + |MT| / c_T) ≤ c A + μN under either label, as in multi-surface plasticity: Mohr–Coulomb
# friction with a tension cut-off (Lourenço & Rots 1997, J. Eng. Mech. 123(7), eq. 2–4), with dilation of friction or
# without.


WEIGHT, AREA = 40.0, 2.0


def block(live: list[float], *, label: str = "dry", planar: bool = True, **materials: Any) -> Assembly:
    """A block of 2 × 1 (× 1) and weight 40 on the ground: low enough to slide before it tips."""
    document: dict[str, Any] = {
        "materials": {
            "dry": {"friction_coefficient": 0.5, **materials.pop("dry", {})},
            "inner": {"tensile_strength": 5.0, "shear_strength": 6.0, **materials.pop("inner", {})},
        },
        "loads": {"live": materials.pop("loads", [{"body": live}])},
        "labels": {label: [["block", "ground"]]},
    }
    if planar:
        base = {"id": "ground", "polygon": [[-1, -1], [3, -1], [3, 0], [-1, 0]], "support": True}
        document["elements"] = [
            base,
            {"id": "block", "polygon": [[0, 0], [2, 0], [2, 0.2], [0, 0.2]], "weight": WEIGHT},
        ]
    else:
        ground = cases.box("ground", [-1, -1, -1], [3, 2, 0], support=True)
        document["elements"] = [ground, cases.box("block", [0, 0, 0], [2, 1, 0.2], weight=WEIGHT)]
    return build_assembly(parse_scene(document))


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("friction", ["associative", "zero-dilation"])
def test_sliding(planar: bool, friction: str) -> None:
    """λ W = c A + μ W, whatever sliding opens."""
    push = [1.0, 0.0] if planar else [1.0, 0.0, 0.0]
    dry = solve(block(push, planar=planar, dry={"cohesion": 3.0}), friction=friction)
    assert dry.load_factor == pytest.approx(3.0 * AREA / WEIGHT + 0.5, rel=1e-7)
    inner = solve(block(push, label="inner", planar=planar, inner={"friction_coefficient": 0.4}), friction=friction)
    assert inner.load_factor == pytest.approx(6.0 * AREA / WEIGHT + 0.4, rel=1e-7)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("across", [0.1, 0.3, 0.8])
def test_pulled_and_sheared(planar: bool, across: float) -> None:
    """N = W (1 − λ) ≥ −σt A, λ W across ≤ τ A + μ N; a dry face never pulls, whatever its cohesion."""
    pull = [across, 1.0] if planar else [across, 0.0, 1.0]
    # towards the middle of the face, so that nothing bends
    at = [1.0, 0.0] if planar else [1.0, 0.5, 0.0]
    loads = [{"element": "block", "force": [WEIGHT * part for part in pull], "at": at}]
    found = solve(block([], label="inner", planar=planar, inner={"friction_coefficient": 0.4}, loads=loads))
    expected = min(1.0 + 5.0 * AREA / WEIGHT, (6.0 * AREA + 0.4 * WEIGHT) / (WEIGHT * (across + 0.4)))
    assert found.load_factor == pytest.approx(expected, rel=1e-7)
    found = solve(block([], planar=planar, dry={"cohesion": 3.0}, loads=loads))
    assert found.load_factor == pytest.approx(min(1.0, (3.0 * AREA + 20.0) / (WEIGHT * (across + 0.5))), rel=1e-7)


def test_twisting() -> None:
    """M_T = c_T (c A + μ W) about the normal."""
    loads = [{"element": "block", "moment": [0.0, 0.0, 1.0]}]
    built = block([], planar=False, dry={"cohesion": 3.0}, loads=loads)
    c_t = float(built.interfaces.c_t[0])
    assert solve(built).load_factor == pytest.approx(c_t * (3.0 * AREA + 0.5 * WEIGHT), rel=1e-7)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("bending", ["uncoupled", "kern"])
@pytest.mark.parametrize("concave", [False, True])
def test_space_against_an_independent_statement(bending: str, concave: bool) -> None:
    inner = {"tensile_strength": 0.3, "shear_strength": 0.5, "friction_coefficient": 0.8}
    dry = {"friction_coefficient": 0.4} | ({} if concave else {"cohesion": 0.2})
    document = cases.scene_in_space(cases.wall_in_space(3, 2), materials={"dry": dry, "inner": inner})
    built = build_assembly(parse_scene(document))
    built = replace(built, labels=np.arange(len(built.interfaces)) % 3 > 0)
    document = cases.spelt_out(document, built)
    expected = load_factor_in_space(document, concave=concave, kern=bending == "kern")
    found = solve(built, contact="concave" if concave else "convex", inner_bending=bending)
    assert found.load_factor == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("name", ["mortar", "rough cracks", "rough arch"])
def test_without_dilation(name: str) -> None:
    """Both friction parts slide without opening; λ stays below the associative one, which allows for more work."""
    rows, options = CASES[name]
    assembly = grid_assembly(rows, **options)
    labels = np.random.default_rng(4).random(len(assembly.interfaces)) < 0.6
    found = solve_zero_dilation(assembly, labels)
    assert found.status is Status.COLLAPSE
    assert found.load_factor <= solve(assembly, labels).load_factor * (1.0 + 1e-9)
    assert found.facts["dilation"] <= 1e-6
    rule = flow_rule(found)
    assert rule.margin.min() >= -1e-9
    scaling = scaling_of(assembly)
    assert yield_set(assembly, scaling).slack(found.forces / scaling.face, labels).min() >= -1e-9


def test_a_wedged_block_slides_out_without_dilation_alone() -> None:
    """Inner faces with friction between supports: with dilation nothing can move; without, what presses them does not
    grow by sliding, and λ W = 2 τ A at least, friction on top as far as forces press."""
    document = grid_document(["#a#", "#.#"], inner_friction=0.7, live=[{"body": [0, -1]}], tension=0.0, shear=2e4)
    assembly = build_assembly(parse_scene(document))
    labels = np.zeros(len(assembly.interfaces), dtype=bool)
    assert solve(assembly, labels).status is Status.LOCKED
    found = solve_zero_dilation(assembly, labels)
    assert found.status is Status.COLLAPSE
    area, weight = 0.1 * 0.1, assembly.total_dead
    assert (found.load_factor + 1.0) * weight >= 2.0 * 2e4 * area * (1.0 - 1e-6)


def test_nothing_is_guessed_where_a_set_does_not_answer() -> None:
    crushed = LimitAnalysis(grid_assembly(["aa", "##"], crush_dry=1e5)).template.yield_set
    assert crushed.coulomb_wedge(True) is None
    assert crushed.hull() is not None
    spatial = LimitAnalysis(cases.assembly_in_space(cases.wall_in_space(2, 2)))
    assert spatial.template.yield_set.coulomb_wedge(True) is None


@pytest.mark.parametrize("options", [SolveOptions(contact="concave"), SolveOptions(effective_area=True)])
def test_cohesion_needs_an_area(options: SolveOptions) -> None:
    built = block([1.0, 0.0, 0.0], planar=False, dry={"cohesion": 3.0})
    with pytest.raises(
        InputError, match=r"cohesion of joints \(face ground–block\) is unknown to (contact at points|effective areas)"
    ):
        solve(built, **vars(options))
    assert solve(built, np.zeros(1, dtype=bool), **vars(options)).status is Status.COLLAPSE


@pytest.mark.parametrize(
    ("materials", "said"),
    [
        ({"dry": {"cohesion": -1.0}}, "materials.dry.cohesion"),
        ({"inner": {"friction_coefficient": -0.2}}, "materials.inner.friction_coefficient"),
        ({"inner": {"friction_coefficient": 0.2, "friction_angle": 10.0}}, "friction is given twice"),
        ({"inner": {"friction_angle": 90.0}}, "materials.inner.friction_angle"),
        ({"inner": {"friction_coefficient": 2.0}}, "tensile_strength 5 lies beyond the apex .* over friction, 3$"),
    ],
)
def test_bad_materials(materials: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        block([1.0, 0.0], **materials)


def test_an_interface_of_its_own() -> None:
    """Keys of one interface: its cohesion under dry, its friction under inner; and what contradicts itself there."""
    document = grid_document(["a", "#"], tension=0.0, shear=1e4)
    entry = {"elements": ["c0r0", "c0r1"], "polygon": [[0.0, 0.1], [0.1, 0.1]]}
    document["interfaces"] = [{**entry, "cohesion": 2e3, "inner_friction_angle": 45.0}]
    strengths = build_assembly(parse_scene(document)).strengths(ROUTE)
    assert strengths.cohesion.tolist() == [2e3]
    assert strengths.inner_friction == pytest.approx([1.0])
    document["interfaces"] = [{**entry, "inner_friction_coefficient": 1.0, "tensile_strength": 2e4}]
    with pytest.raises(InputError, match=r"interface c0r0–c0r1.*beyond the apex"):
        build_assembly(parse_scene(document))
    document["interfaces"] = [{**entry, "inner_friction_coefficient": 1.0, "inner_friction_angle": 45.0}]
    with pytest.raises(InputError, match="given twice"):
        parse_scene(document)


def test_utilisation_is_that_of_the_model() -> None:
    """Kern bending: 3 (|m1| + |m2|) against N + σt A; the uncoupled form has the larger of both."""
    built = block([1.0, 0.0, 0.0], planar=False, label="inner")
    labels = np.zeros(1, dtype=bool)
    forces = np.array([[WEIGHT, 0.0, 0.0, 4.0, 6.0, 0.0]])
    scaled = forces / scaling_of(built).face
    one, two = abs(forces[0, 3]) / 0.5, abs(forces[0, 4]) / 1.0
    for bending, share in (("kern", one + two), ("uncoupled", max(one, two))):
        analysis = LimitAnalysis(built, inner_bending=bending)
        found = result_of(analysis.template, labels, analysis.options, analysis.prove(labels), elapsed=0.0)
        expected = 3.0 * share / (WEIGHT + 5.0 * AREA)
        assert analysis.template.yield_set.utilisation(scaled, labels) == pytest.approx([expected])
        used = quantities.utilisation(found)
        assert used.max() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("bending", ["uncoupled", "kern"])
def test_utilisation_is_one_on_the_boundary(bending: str) -> None:
    """Forces grown until they leave the set: used up there, less before."""
    materials = {"dry": {"friction_coefficient": 0.6, "cohesion": 0.2, "compressive_strength": 4.0}}
    built = cases.assembly_in_space(cases.wall_in_space(2, 2), materials=materials)
    sets = yield_set(built, scaling_of(built), bending)
    rng, m = np.random.default_rng(2), len(built.interfaces)
    for labels in (np.ones(m, dtype=bool), np.zeros(m, dtype=bool)):
        start = np.zeros((m, 6))
        start[:, 0] = 0.1
        way = rng.standard_normal((m, 6)) * (0.0, 1.0, 1.0, 1.0, 1.0, 1.0)
        low, high = np.zeros(m), np.full(m, 10.0)
        for _ in range(80):
            middle = 0.5 * (low + high)
            inside = sets.slack(start + middle[:, None] * way, labels) >= 0.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        used = sets.utilisation(start + low[:, None] * way, labels)
        assert used == pytest.approx(np.ones(m), abs=1e-9)
        before = sets.utilisation(start + 0.9 * low[:, None] * way, labels)
        assert before.max() < 1.0 - 1e-3


def test_exact_with_cohesion_and_inner_friction_in_space(tmp_path: Path) -> None:
    materials = {
        "dry": {"friction_coefficient": 0.4, "cohesion": 0.1},
        "inner": {"tensile_strength": 0.2, "shear_strength": 0.3, "friction_coefficient": 0.7},
    }
    cubes = [cases.box(f"{i}{k}", [i, 0, k], [i + 1, 1, k + 1], support=k == 0) for i in (0, 1) for k in (0, 1, 2)]
    scene = parse_scene(cases.scene_in_space(cubes, materials=materials, live=[{"body": [1.0, 0.3, 0.0]}]))
    assert DRIVERS["exact"](search_space(scene, build_assembly(scene)), 0).name == "exact"
    every = explore(scene, tmp_path / "every", ExploreSettings(driver="enumeration", pictures=False))
    found = explore(scene, tmp_path / "exact", ExploreSettings(driver="exact", pictures=False))
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    assert math.isfinite(found.summary.bound)


# Materials of the faces between two elements, beside interfaces that are found.


FACES: list[dict[str, Any]] = [
    {"between": ["c0r0", "c1r0"], "inner": {"tensile_strength": 1e3}},
    {"between": ["c1r1", "c1r0"], "dry": {"friction_coefficient": 0.2, "cohesion": 50.0}},
    {
        "between": ["c0r1", "c0r2"],
        "dry": {"friction_angle": 20, "compressive_strength": 1e5},
        "inner": {
            "tensile_strength": 9e2,
            "shear_strength": 7e3,
            "compressive_strength": 2e5,
            "friction_coefficient": 0.1,
        },
    },
]


def document(faces: list[dict[str, Any]], **changes: Any) -> dict[str, Any]:
    found = grid_document(["aa", "aa", "##"], tension=5e3, shear=5e3, friction=0.6)
    found["materials"]["faces"] = faces
    return {**found, **changes}


def listed(faces: list[dict[str, Any]]) -> Scene:
    """The same scene with elements and all interfaces listed one by one."""
    plain = build_assembly(parse_scene(document([])))
    elements, found = plain.elements, plain.interfaces
    names = {"friction_coefficient": "inner_friction_coefficient", "friction_angle": "inner_friction_angle"}
    interfaces = []
    for a, b, polygon in zip(found.a, found.b, found.polygon, strict=True):
        pair = [elements.ids[a], elements.ids[b]]
        own: dict[str, Any] = {}
        for entry in faces:
            if set(entry["between"]) == set(pair):
                own |= entry.get("dry", {})
                own |= {names.get(key, key): value for key, value in entry.get("inner", {}).items()}
        interfaces.append({"elements": pair, "polygon": polygon.tolist(), **own})
    shapes = [
        {"id": name, "polygon": shape.tolist(), "support": bool(support), "block": None if support else "a"}
        for name, shape, support in zip(elements.ids, elements.shape, elements.support, strict=True)
    ]
    found_document = document([], elements=shapes, interfaces=interfaces, thickness=0.1)
    del found_document["grid"]
    return parse_scene(found_document)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "entries", [FACES[:1], FACES[:2], [FACES[0], FACES[1]][::-1]], ids=["inner", "both", "reversed"]
)
def test_the_load_factor_is_that_of_all_interfaces_listed(entries: list[dict[str, Any]]) -> None:
    assembly, other = build_assembly(parse_scene(document(entries))), build_assembly(listed(entries))
    for name, values in vars(assembly.strengths(ROUTE)).items():
        assert np.array_equal(values, getattr(other.strengths(ROUTE), name), equal_nan=True), name
    plain, changed = build_assembly(parse_scene(document([]))), []
    for number in range(0, 2 ** len(assembly.interfaces), 5):
        labels = (number >> np.arange(len(assembly.interfaces))) & 1 > 0
        found, expected = solve(assembly, labels), solve(other, labels)
        assert found.status == expected.status
        if found.load_factor is not None:
            assert found.load_factor == pytest.approx(expected.load_factor, rel=1e-9)
            changed.append(abs(found.load_factor / solve(plain, labels).load_factor - 1.0) > 1e-3)
    assert any(changed)


def test_crushing_is_stated_for_each_label_alone() -> None:
    """An interface that is listed has one compressive strength; an entry of faces has one for either label."""
    assembly = build_assembly(parse_scene(document(FACES)))
    ids, faces = assembly.elements.ids, assembly.interfaces
    pairs = [{ids[a], ids[b]} for a, b in zip(faces.a, faces.b, strict=True)]
    face, strengths = pairs.index({"c0r1", "c0r2"}), assembly.strengths(ROUTE)
    assert (strengths.crush_dry[face], strengths.crush_inner[face]) == (1e5, 2e5)
    assert strengths.friction[face] == pytest.approx(np.tan(np.radians(20)))
    assert (strengths.tension[face], strengths.shear[face], strengths.inner_friction[face]) == (9e2, 7e3, 0.1)
    assert np.isinf(np.delete(strengths.crush_dry, face)).all()


def test_a_block_on_a_face_of_its_own_slides_at_its_friction() -> None:
    """A block under its weight and a horizontal body load slides at λ = μ of its joint."""
    scene = grid_document(["a", "#"], friction=0.9)
    scene["materials"]["faces"] = [{"between": ["c0r1", "c0r0"], "dry": {"friction_coefficient": 0.25}}]
    assert solve(build_assembly(parse_scene(scene))).load_factor == pytest.approx(0.25, rel=1e-9)


def test_low_values_of_faces_are_those_of_a_robust_search() -> None:
    low = {"nominal": 1e3, "low": 4e2}
    scene = parse_scene(document([{"between": ["c0r0", "c1r0"], "inner": {"tensile_strength": low}}]))
    robust = build_robust(scene)
    assert (robust.strengths(ROUTE).tension.min(), robust.at_nominal.strengths(ROUTE).tension.min()) == (4e2, 1e3)
    assert parse_scene(json.loads(scene.model_dump_json(exclude_defaults=True))) == scene


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"between": ["c0r0", "c9r9"], "dry": {"cohesion": 1.0}}, "materials.faces[0].between[0]: no element"),
        ({"between": ["c0r0", "c1r1"], "dry": {"cohesion": 1.0}}, "share no interface"),
        ({"between": ["c0r0", "c1r0"]}, "materials.faces[0]: it states no value"),
        ({"between": ["c0r0"], "dry": {}}, "materials.faces[0].between"),
        ({"between": ["c0r0", "c1r0"], "dry": {"shear_strength": 1.0}}, "materials.faces[0].dry"),
        (
            {"between": ["c0r0", "c1r0"], "dry": {"tensile_strength": 1.0}},
            "materials.faces of c0r0–c1r0: dry.tensile_strength: 1 is beyond the apex",
        ),
        ({"between": ["c0r0", "c1r0"], "dry": {"friction_angle": 1, "friction_coefficient": 1}}, "given twice"),
        (
            {"between": ["c0r0", "c1r0"], "inner": {"friction_coefficient": 2.0}},
            "materials.faces of c0r0–c1r0: tensile_strength 5000 lies beyond the apex",
        ),
    ],
)
def test_bad_entries_are_named(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words).replace(r"between\[0\]", "between.*")):
        build_assembly(parse_scene(document([entry])))


def test_a_pair_has_one_entry() -> None:
    twice = [FACES[0], {**FACES[0], "between": FACES[0]["between"][::-1]}]
    with pytest.raises(InputError, match=r"materials\.faces\[1\]\.between: .* twice"):
        build_assembly(parse_scene(document(twice)))


def test_operations_that_would_lose_them_are_refused_and_drawings_keep_them(tmp_path: Any) -> None:
    scene = parse_scene(document(FACES))
    with pytest.raises(InputError, match=r"materials\.faces"):
        refine(scene, (0.05, 0.05))
    assembly = build_assembly(scene)
    path = export(Layout(scene, assembly, assembly.labels, None), "dxf", tmp_path / "a.dxf")
    assert import_file(path).document["materials"]["faces"] == document(FACES)["materials"]["faces"]
