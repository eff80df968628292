"""Cohesion of dry faces and friction of inner ones, against closed forms and statements of their own.

Shear |V| (in space |V| + |MT| / c_T) ≤ c A + μN under either label, as in multi-surface plasticity: Mohr–Coulomb
friction with a tension cut-off (Lourenço & Rots 1997, J. Eng. Mech. 123(7), eq. 2–4), with dilation of friction or
without.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.by_scheme import solve_zero_dilation

import cases_spatial
import reference_spatial
from balances import flow_rule
from cases import CASES, grid_assembly, grid_document
from jld_core import Assembly, InputError, LimitAnalysis, SolveOptions, Status, build_assembly, parse_scene, solve
from jld_core.limit import result_of
from jld_core.mechanics import scaling_of, yield_set
from jld_core.strengths import Route
from jld_core.views import quantities
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers.exact.driver import Exact

ROUTE = Route("a test")

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
        ground = cases_spatial.box("ground", [-1, -1, -1], [3, 2, 0], support=True)
        document["elements"] = [ground, cases_spatial.box("block", [0, 0, 0], [2, 1, 0.2], weight=WEIGHT)]
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


@pytest.mark.parametrize("bending", ["uncoupled", "kern"])
@pytest.mark.parametrize("concave", [False, True])
def test_space_against_an_independent_statement(bending: str, concave: bool) -> None:
    inner = {"tensile_strength": 0.3, "shear_strength": 0.5, "friction_coefficient": 0.8}
    dry = {"friction_coefficient": 0.4} | ({} if concave else {"cohesion": 0.2})
    document = cases_spatial.scene(cases_spatial.wall(3, 2), materials={"dry": dry, "inner": inner})
    document["interfaces"] = spelt_out(build_assembly(parse_scene(document)))
    for element in document["elements"]:
        element.setdefault("support", False)
    built = build_assembly(parse_scene({**document, "elements": [plain(e) for e in document["elements"]]}))
    for element, volume, centroid in zip(
        document["elements"], built.elements.volume, built.elements.centroid, strict=True
    ):
        element |= {"volume": float(volume), "centroid": centroid.tolist()}
    expected = reference_spatial.load_factor(document, concave=concave, kern=bending == "kern")
    found = solve(built, contact="concave" if concave else "convex", inner_bending=bending)
    assert found.load_factor == pytest.approx(expected, rel=1e-7)


def plain(element: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in element.items() if key not in ("volume", "centroid")}


def spelt_out(assembly: Assembly) -> list[dict[str, Any]]:
    """Interfaces as a scene gives them, every third one inner."""
    faces, ids = assembly.interfaces, assembly.elements.ids
    return [
        {
            "elements": [ids[faces.a[k]], ids[faces.b[k]]],
            "polygon": faces.polygon[k].tolist(),
            "label": "inner" if k % 3 == 0 else "dry",
        }
        for k in range(len(faces))
    ]


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
    assert found.forces is not None
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
    spatial = LimitAnalysis(cases_spatial.assembly(cases_spatial.wall(2, 2)))
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
        analysis = LimitAnalysis(built, inner_bending=bending)  # type: ignore[arg-type]
        found = result_of(analysis.template, labels, analysis.options, analysis.prove(labels), elapsed=0.0)
        expected = 3.0 * share / (WEIGHT + 5.0 * AREA)
        assert analysis.template.yield_set.utilisation(scaled, labels) == pytest.approx([expected])
        used = quantities.utilisation(found)
        assert used.max() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("bending", ["uncoupled", "kern"])
def test_utilisation_is_one_on_the_boundary(bending: str) -> None:
    """Forces grown until they leave the set: used up there, less before."""
    materials = {"dry": {"friction_coefficient": 0.6, "cohesion": 0.2, "compressive_strength": 4.0}}
    built = cases_spatial.assembly(cases_spatial.wall(2, 2), materials=materials)
    sets = yield_set(built, scaling_of(built), bending)  # type: ignore[arg-type]
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
        assert used is not None
        assert used == pytest.approx(np.ones(m), abs=1e-9)
        before = sets.utilisation(start + 0.9 * low[:, None] * way, labels)
        assert before is not None
        assert before.max() < 1.0 - 1e-3


def test_exact_with_cohesion_and_inner_friction_in_space(tmp_path: Path) -> None:
    materials = {
        "dry": {"friction_coefficient": 0.4, "cohesion": 0.1},
        "inner": {"tensile_strength": 0.2, "shear_strength": 0.3, "friction_coefficient": 0.7},
    }
    cubes = [
        cases_spatial.box(f"{i}{k}", [i, 0, k], [i + 1, 1, k + 1], support=k == 0) for i in (0, 1) for k in (0, 1, 2)
    ]
    scene = parse_scene(cases_spatial.scene(cubes, materials=materials, live=[{"body": [1.0, 0.3, 0.0]}]))
    assert Exact(search_space(scene, build_assembly(scene)), 0).name == "exact"
    every = explore(scene, tmp_path / "every", ExploreSettings(driver="enumeration", pictures=False))
    found = explore(scene, tmp_path / "exact", ExploreSettings(driver="exact", pictures=False))
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    assert math.isfinite(found.summary.bound)
