"""Spatial yield sets: rows, slacks and support functions against each other and a second statement."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.common import random_segmentations
from benchmarks.scenes import column, cubes
from numpy.typing import NDArray

from cases import ELL, IRREGULAR, OBLONG, TRIANGLE, stools
from jld_core import Assembly, InputError, build_assembly, parse_scene, solve, solve_many
from jld_core.mechanics import scaling_of, yield_set
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver, RawStatus
from proofs import cp, face_constraints, load_factor_in_space, make_face

Array = NDArray[np.float64]
SCENES = Path(__file__).parents[2] / "scenes"
DIRECTIONS = {"px": [1.0, 0.0, 0.0], "mx": [-1.0, 0.0, 0.0], "py": [0.0, 1.0, 0.0], "my": [0.0, -1.0, 0.0]}
TURNED = OBLONG @ np.array([[0.8, 0.6], [-0.6, 0.8]])
SHAPES = [OBLONG, TRIANGLE, IRREGULAR, ELL, TURNED]

MATERIALS: dict[str, dict[str, dict[str, float]]] = {
    "plain": {},
    "no tension": {"inner": {"tensile_strength": 0.0, "shear_strength": 0.8}},
    "crushable inside": {"inner": {"tensile_strength": 0.5, "shear_strength": 0.8, "compressive_strength": 3.0}},
    "crushable": {
        "dry": {"friction_coefficient": 0.7, "compressive_strength": 2.0},
        "inner": {"tensile_strength": 0.5, "shear_strength": 0.8, "compressive_strength": 3.0},
    },
    "rough": {
        "dry": {"friction_coefficient": 0.4, "cohesion": 0.3},
        "inner": {"tensile_strength": 0.5, "shear_strength": 0.8, "friction_coefficient": 0.9},
    },
    "rough, crushable": {
        "dry": {"friction_coefficient": 0.0, "cohesion": 0.3},
        "inner": {
            "tensile_strength": 0.2,
            "shear_strength": 0.4,
            "friction_coefficient": 0.7,
            "compressive_strength": 3.0,
        },
    },
    "no shear": {"dry": {"friction_coefficient": 0.0}, "inner": {"tensile_strength": 0.5, "shear_strength": 0.0}},
}
CASES = [(name, bending) for name in MATERIALS for bending in ("uncoupled", "kern")]


COPIES = 20
"""Number of prisms of one shape where a test draws many tables: one call answers for all of them."""


@cache
def faces_under(name: str, bending: Any, copies: int = 1) -> tuple[Assembly, Any]:
    """Prisms of every shape on a slab; rectangles only where dry faces can be crushed."""
    shapes = [OBLONG, TURNED, 0.3 * OBLONG] if name == "crushable" else SHAPES
    built = stools(shapes * copies, materials=MATERIALS[name])
    return built, yield_set(built, scaling_of(built), bending)


def labellings(count: int) -> list[NDArray[np.bool_]]:
    return [np.ones(count, dtype=bool), np.zeros(count, dtype=bool), np.arange(count) % 2 == 0]


def random_forces(rng: np.random.Generator, sets: Any, labels: NDArray[np.bool_]) -> Array:
    """Forces on either side of the boundary, dropped resultants zero."""
    forces = rng.normal(size=(len(labels), 6)) * rng.uniform(0.02, 0.6, size=6)
    forces[:, 0] = rng.uniform(-0.3, 2.5, size=len(labels))
    return forces * sets.active(labels)


def random_jumps(rng: np.random.Generator, sets: Any, labels: NDArray[np.bool_]) -> Array:
    """Jumps of finite dissipation, some of them just."""
    jumps = rng.normal(size=(len(labels), 6)) * rng.choice([0.0, 1.0], p=[0.2, 0.8], size=(len(labels), 6))
    short = sets.margin(jumps, labels)
    extra = rng.choice([0.0, 0.5], size=len(labels)) + 1e-12
    jumps[:, 0] += np.where(np.isfinite(short), np.maximum(-short, 0.0) + extra, 0.0)
    return jumps


def row_slacks(sets: Any, forces: Array, labels: NDArray[np.bool_]) -> Array:
    """(m,) least s = h − G y of the rows of each face, cones as s0 − |s1…|, extra variables at their best."""
    p = sets.pattern
    best = [np.hypot(forces[:, 1], forces[:, 2])[~sets.point]]
    crushed = np.isfinite(sets.numbers.crush_dry)
    n, m1, m2 = (np.where(labels[crushed], forces[crushed, j], 0.0) for j in (0, 3, 4))
    one, two = n - abs(m1), n - abs(m2)
    best += [one, two, np.sqrt(np.maximum(one * two, 0.0)), np.sqrt(np.maximum(n, 0.0))]
    y = np.concatenate([forces.ravel(), *best])
    assert len(y) == forces.size + p.extra
    data = np.where(labels[p.face], p.dry, p.inner)
    s = np.where(labels[p.row_face], p.h_dry, p.h_inner)
    s = s - sp.coo_array((data, (p.row, p.column)), shape=(len(s), len(y))).tocsr() @ y
    assert set(p.cones) <= {3}
    cones = s[p.linear :].reshape(-1, 3)
    values = np.concatenate([s[: p.linear], cones[:, 0] - np.hypot(cones[:, 1], cones[:, 2])])
    owner = np.concatenate([p.row_face[: p.linear], p.row_face[p.linear :: 3]])
    least = np.full(len(labels), np.inf)
    np.minimum.at(least, owner, values)
    return least


def draws(name: str, bending: Any, seed: int, count: int) -> Iterator[tuple[Any, np.ndarray, Any]]:
    """The sets of copies of some faces, each of their labellings, and a source of random forces and jumps."""
    built, sets = faces_under(name, bending, COPIES)
    rng = np.random.default_rng(seed)
    for labels in labellings(len(built.interfaces)):
        for _ in range(count // COPIES):
            yield sets, labels, rng


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("name", "bending"), CASES)
def test_rows_hold_exactly_where_slack_is_not_negative(name: str, bending: Any) -> None:
    seen = np.zeros(2, dtype=int)
    for sets, labels, rng in draws(name, bending, 3, 300):
        forces = random_forces(rng, sets, labels)
        slack, rows = sets.slack(forces, labels), row_slacks(sets, forces, labels)
        clear = abs(slack) > 1e-9
        np.testing.assert_array_equal(slack[clear] > 0.0, rows[clear] >= -1e-12)
        seen += [np.sum(slack > 0.0), np.sum(slack < 0.0)]
    assert seen.min() > 50


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("name", "bending"), CASES)
def test_slack_is_concave_and_never_steeper_than_its_arguments(name: str, bending: Any) -> None:
    """What blending and the comparison with the projection error rely on."""
    for sets, labels, rng in draws(name, bending, 4, 100):
        one, two = random_forces(rng, sets, labels), random_forces(rng, sets, labels)
        middle = sets.slack(0.5 * (one + two), labels)
        assert np.all(middle >= 0.5 * (sets.slack(one, labels) + sets.slack(two, labels)) - 1e-12)
        moved = one + 1e-6 * rng.uniform(-1.0, 1.0, size=one.shape) * sets.active(labels)
        assert abs(sets.slack(moved, labels) - sets.slack(one, labels)).max() <= 1e-6 * 6.0


@pytest.mark.parametrize(("name", "bending"), CASES)
def test_weak_duality(name: str, bending: Any) -> None:
    """−F·J ≤ D(J) for admissible F and jumps of finite dissipation."""
    tried = 0
    for sets, labels, rng in draws(name, bending, 5, 300):
        forces, jumps = random_forces(rng, sets, labels), random_jumps(rng, sets, labels)
        inside = sets.slack(forces, labels) >= 0.0
        work = -np.einsum("ij,ij->i", forces, jumps)
        assert np.all(work[inside] <= sets.dissipation(jumps, labels)[inside] + 1e-12)
        tried += int(inside.sum())
    assert tried > 200


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("name", "bending"), CASES)
def test_dissipation_is_the_support_function(name: str, bending: Any) -> None:
    """D(J) = sup −F·J with the set stated a second time in CVXPY; 1e-6. Beyond the margin it is unbounded."""
    built, sets = faces_under(name, bending)
    faces, scaling = built.interfaces, scaling_of(built)
    rng = np.random.default_rng(6)
    materials = {
        "dry": {"friction_coefficient": 0.7},
        "inner": {"tensile_strength": 0.5, "shear_strength": 0.8},
        **MATERIALS[name],
    }
    for dry in (True, False):
        labels = np.full(len(faces), dry)
        named = materials["dry" if dry else "inner"]
        material = {
            "friction": named.get("friction_coefficient", 0.0),
            "cohesion": named.get("cohesion", 0.0),
            "tension": named.get("tensile_strength", 0.0),
            "shear": named.get("shear_strength", 0.0),
        }
        if "compressive_strength" in named:
            material["crush"] = named["compressive_strength"]
        jumps = [random_jumps(rng, sets, labels) for _ in range(3)]
        beyond = jumps[0].copy()
        beyond[:, 0] -= sets.margin(beyond, labels) + 0.05
        for k in range(len(faces)):
            face = make_face(faces.polygon[k], faces.normal[k])
            f = cp.Variable((1, 6))
            turn = np.eye(6)
            turn[1:3, 1:3] = turn[3:5, 3:5] = face.frame[1:] @ np.array([faces.e1[k], faces.e2[k]]).T
            weights = cp.Parameter(6)
            # forces in units of the force scale, so that the objective is D as the program knows it
            constraints = face_constraints([face], f, dry, [material], bending == "kern", scaling.force)
            problem = cp.Problem(cp.Maximize(-weights @ f[0]), constraints)
            for table in jumps:
                weights.value = turn @ (table[k] * scaling.force / scaling.face[k])
                value = problem.solve(solver="CLARABEL")
                expected = sets.dissipation(table, labels)[k]
                assert value == pytest.approx(expected, rel=1e-6, abs=1e-6), (k, dry, table[k])
            if np.isfinite(sets.margin(beyond, labels)[k]):
                weights.value = turn @ (beyond[k] * scaling.force / scaling.face[k])
                problem.solve(solver="CLARABEL")
                assert "unbounded" in problem.status


@pytest.mark.parametrize(("name", "bending"), CASES)
def test_recession_cone_contains_the_directions_without_a_bound(name: str, bending: Any) -> None:
    for sets, labels, rng in draws(name, bending, 7, 100):
        free = sets.recession_active(labels)
        assert not np.any(free & ~sets.active(labels))
        ray = random_forces(rng, sets, labels) * free
        slack, far = sets.recession_slack(ray, labels), sets.slack(1e8 * ray, labels)
        clear = abs(slack) > 1e-6
        np.testing.assert_array_equal(slack[clear] > 0.0, far[clear] > -1e-3)


def test_strengths_of_any_size_leave_rows_of_order_one() -> None:
    for size in (1e-9, 1.0, 1e9):
        inner = {"tensile_strength": size, "shear_strength": size, "compressive_strength": 10.0 * size}
        dry = {"friction_coefficient": 0.7, "compressive_strength": size}
        built = stools([OBLONG, TURNED], materials={"inner": inner, "dry": dry})
        pattern = yield_set(built, scaling_of(built)).pattern
        for values in (pattern.dry, pattern.inner, pattern.h_dry, pattern.h_inner):
            assert abs(values).max() <= 4.0


def test_dry_crushing_wants_rectangles() -> None:
    dry = {"friction_coefficient": 0.5, "compressive_strength": 1.0}
    built = stools([TRIANGLE], materials={"dry": dry})
    with pytest.raises(InputError, match=r"p0.slab is no rectangle; expected rectangles only"):
        yield_set(built, scaling_of(built))


def template(built: Assembly, bending: Any = "uncoupled") -> Template:
    scaling = scaling_of(built)
    return Template(built, scaling, yield_set(built, scaling, bending))


def solved(built: Assembly, bending: Any = "uncoupled") -> float:
    """λ through the program of the package."""
    made = template(built, bending)
    answer = ClarabelSolver().solve(made.program(built.labels))
    return float(answer.point[-1] * made.scaling.load)


def document(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((SCENES / f"spatial_{name}.json").read_text(encoding="utf-8"))
    return found


VARIANTS: dict[str, tuple[list[str], list[float], float | None, Any]] = {
    # labels; tensile, shear, compressive strength of glue (0: none); compressive strength of joints; form
    "glued": (["inner", "dry"], [3.0, 6.0, 0.0], None, "uncoupled"),
    "glued, kern": (["inner", "inner"], [9.0, 4.0, 0.0], None, "kern"),
    "all glued": (["inner", "inner"], [12.0, 18.0, 0.0], None, "uncoupled"),
    "soft": (["dry", "dry"], [0.0, 0.0, 0.0], 40.0, "uncoupled"),
    "softer": (["dry", "dry"], [0.0, 0.0, 0.0], 18.0, "uncoupled"),
    "soft and glued": (["inner", "dry"], [6.0, 12.0, 72.0], 60.0, "uncoupled"),
    "soft and glued, kern": (["inner", "inner"], [12.0, 9.0, 90.0], None, "kern"),
}


def variant_document(name: str) -> dict[str, Any]:
    """The cubes, obliquely loaded, with the faces and materials of a variant."""
    labels, (tension, shear, crush), crush_dry, _ = VARIANTS[name]
    scene = document("cubes")
    for entry, label in zip(scene["interfaces"], labels, strict=True):
        entry["label"] = label
    scene["materials"]["inner"] = {"tensile_strength": tension, "shear_strength": shear}
    if crush:
        scene["materials"]["inner"]["compressive_strength"] = crush
    if crush_dry is not None:
        scene["materials"]["dry"]["compressive_strength"] = crush_dry
    scene["loads"] = {"live": [{"body": [0.8, 0.5, 0.1]}]}
    return scene


@pytest.mark.parametrize("variant", VARIANTS)
def test_program_equals_second_statement(variant: str) -> None:
    """Every kind of face in a solve, obliquely loaded; 1e-7 relative."""
    scene, bending = variant_document(variant), VARIANTS[variant][3]
    value = solved(build_assembly(parse_scene(scene)), bending)
    assert value == pytest.approx(load_factor_in_space(scene, kern=bending == "kern"), rel=1e-7)


def test_structures_that_stand_by_strength_fall_without_it() -> None:
    """The strengths above are at work: kern form and less strength give less, or nothing that stands."""
    built = build_assembly(parse_scene(variant_document("glued")))
    assert ClarabelSolver().solve(template(built, "kern").program(built.labels)).status is RawStatus.INFEASIBLE
    with pytest.raises(AssertionError, match="infeasible"):
        load_factor_in_space(variant_document("glued"), kern=True)
    soft, softer = (solved(build_assembly(parse_scene(variant_document(name)))) for name in ("soft", "softer"))
    hard = variant_document("soft")
    del hard["materials"]["dry"]["compressive_strength"]
    assert softer < soft - 1e-3 < solved(build_assembly(parse_scene(hard))) - 2e-3


@pytest.mark.parametrize("shape", range(len(SHAPES)))
def test_prism_in_pure_torsion(shape: int) -> None:
    """Closed form: MT = μ N c_T, on a shape whose prism is loaded by a couple about its axis alone."""
    built = stools([SHAPES[shape]], live=[{"element": "p0", "moment": [0.0, 0.0, 1.0]}])
    weight = float(built.elements.weight[0, 2])
    expected = 0.7 * abs(weight) * float(built.interfaces.c_t[0])
    assert solved(built) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("label", ["dry", "inner"])
def test_without_shear_strength_any_push_moves(label: str) -> None:
    """μ = 0 or τ = 0: shear and torsion are dropped, and sideways loads find nothing; upwards ones do."""
    for live, expected in (([{"body": [1, 0, 0]}], 0.0), ([{"body": [0, 0, 1]}], None)):
        built = stools([OBLONG], materials=MATERIALS["no shear"], labels={label: [["p0", "slab"]]}, live=live)
        weight, strength = abs(built.elements.weight[0, 2]), 0.5 * built.interfaces.area[0]
        lift = 1.0 + (strength / weight if label == "inner" else 0.0)
        value = lift if expected is None else expected
        assert solved(built) == pytest.approx(value, abs=1e-8)


@pytest.mark.parametrize("bending", ["uncoupled", "kern"])
def test_updated_programs_equal_programs_set_up_anew(bending: Any) -> None:
    """One structure for all labellings, strengths of every kind: 1e-8."""
    scene = document("cubes")
    scene["materials"] = {
        "gravity": 1.0,
        "dry": {"friction_coefficient": 0.84, "compressive_strength": 60.0},
        "inner": {"tensile_strength": 9.0, "shear_strength": 12.0, "compressive_strength": 90.0},
    }
    built = build_assembly(parse_scene(scene))
    made, route = template(built, bending), ClarabelSolver()
    for bits in ([1, 1], [0, 1], [1, 0], [0, 0], [1, 1]):
        program = made.program(np.array(bits, dtype=bool))
        one, two = route.solve(program).point[-1], ClarabelSolver().solve(program).point[-1]
        assert one == pytest.approx(two, rel=1e-8)
    assert (route.rebuilds, route.updates) == (1, 4)


def test_points_cannot_be_crushed() -> None:
    built = stools([OBLONG], materials=MATERIALS["crushable"])
    with pytest.raises(InputError, match=r"strength of joints \(face p0.slab\) is unknown to contact at points"):
        solve(built, contact="concave")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("strength", [3e2, 1e3, 1e6])
def test_many_layouts_whose_inner_faces_crush_equal_a_solve_of_each(strength: float) -> None:
    """At 300 Pa some fall and none is as strong as without crushing, at 1 MPa all are."""
    document = json.loads(cubes(2).model_dump_json(exclude_defaults=True))
    free = build_assembly(parse_scene(document))
    document["materials"]["inner"]["compressive_strength"] = strength
    assembly = build_assembly(parse_scene(document))
    labellings = random_segmentations(assembly, 12, seed=1)
    together, without = solve_many(assembly, labellings), solve_many(free, labellings)
    for labels, status, load in zip(labellings, together.status, together.load_factor, strict=True):
        alone = solve(assembly, labels)
        assert str(status) == str(alone.status)
        assert load == pytest.approx(alone.load_factor, rel=1e-6, nan_ok=True)
    share = together.load_factor / without.load_factor
    assert np.nanmax(share) < 1.0 + 1e-6
    assert bool(np.nanmin(share) > 1.0 - 1e-6) == (strength == 1e6)
    assert bool(np.isnan(share).any()) == (strength == 3e2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("corners", [5, 8, 12, 16, 17])
def test_many_columns_of_drums_equal_a_solve_of_each(corners: int) -> None:
    """Faces of up to sixteen corners are solved in batches, others one at a time."""
    assembly = build_assembly(parse_scene(column(corners, drums=5)))
    labellings = random_segmentations(assembly, 6, seed=2)
    together = solve_many(assembly, labellings)
    for labels, load in zip(labellings, together.load_factor, strict=True):
        assert load == pytest.approx(solve(assembly, labels).load_factor, rel=1e-6)
