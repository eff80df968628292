"""Large programs: λ = 0 without friction, rays and instability settled by repairs, projections by sparse factors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.large import document
from scipy.optimize import linprog

from cases import box, grid_document, space_of
from jld_core import (
    Assembly,
    Deadline,
    DeadlinePassed,
    LimitAnalysis,
    SolveOptions,
    Status,
    build_assembly,
    parse_scene,
    solvers,
)
from jld_core.limit import State
from jld_core.linalg.factors import ConsistentProjector
from jld_core.models import limit_analysis, solve_labelling
from jld_explore import search_space
from jld_explore.drivers import make_driver
from jld_explore.space import from_string
from jld_practice.reactions.thrust import least_share, shrunk
from jld_samples import arch


def wall(edge: int, *, friction: float = 0.75) -> tuple[Assembly, np.ndarray]:
    """A square wall of benchmarks/large.py in blocks of 2 × 2 cells, and its labels."""
    content = document("planar", edge)
    content["materials"]["dry"]["friction_coefficient"] = friction
    built = build_assembly(parse_scene(content))
    place = np.floor(built.elements.centroid / 0.2).astype(int)
    same = np.all(place[built.interfaces.a] == place[built.interfaces.b], axis=1)
    return built, ~same | built.elements.support[built.interfaces.b] | built.elements.support[built.interfaces.a]


def test_projection_by_sparse_factors_equals_the_pseudo_inverse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dependent rows and a full column: to 1e-11 of the dense route, and the equations to rounding."""
    rng = np.random.default_rng(5)
    rows = sp.random_array((80, 200), density=0.04, rng=rng, data_sampler=rng.normal).tocsr()
    full = sp.csr_array(rng.normal(size=(80, 1)))
    once = sp.hstack([rows, full])
    equations = sp.csr_array(sp.vstack([once, once[:20] + once[20:40], once[:5]]))
    right = equations @ rng.normal(size=201)
    start = rng.normal(size=201)
    dense = ConsistentProjector(equations).project(start, right)
    monkeypatch.setattr("jld_core.linalg.factors._FEW", 0)
    found = ConsistentProjector(equations).project(start, right)
    np.testing.assert_allclose(found, dense, atol=1e-11, rtol=0.0)
    assert np.abs(equations @ found - right).max() < 1e-13


def test_what_stands_is_sought_until_a_deadline() -> None:
    """A program of over 2 000 equations is left in the midst of its iterations."""
    built, labels = wall(27)
    found = LimitAnalysis(built).repair
    with pytest.raises(DeadlinePassed):
        found.proof_at_zero(labels, Deadline(0.0))
    assert isinstance(found.proof_at_zero(labels, Deadline()), State)


def test_what_stands_without_slack_is_told_as_by_a_linear_program() -> None:
    """A wall that spans five of its seven cells: in the first labelling joints carry no force, or one alone."""
    wall = grid_document(["aaaaaaa"] * 5 + ["#.....#"], tension=2e6, shear=2e5, block_cells=[2, 6])
    space = space_of(wall)
    analysis, kinds = LimitAnalysis(space.assembly), set()
    edge = from_string("iidiiddddiiddiddiiddddiidddiddiddiidddiiidididdidddiidddiidd")
    for labels in (edge, *make_driver("random", space, 1).ask(64)):
        program, columns = analysis.template.program(labels), analysis.template.columns - 1
        rows = program.matrix.toarray()[:, :columns], program.rhs
        (equal, below), (right, sides) = (np.split(part, [program.structure.equalities]) for part in rows)
        found = linprog(np.zeros(columns), below, sides, equal, right, bounds=(None, None), method="highs")
        proof = analysis.repair.proof_at_zero(labels)
        assert isinstance(proof, State) == (found.status == 0)
        kinds.add(type(proof))
        if isinstance(proof, State):
            assert np.abs(equal @ proof.forces.ravel() - right).max() < 1e-13
            assert (sides - below @ proof.forces.ravel()).min() > -1e-13
    assert len(kinds) == 2


@pytest.mark.long
def test_a_large_wall_without_friction_is_proven() -> None:
    """Nothing holds blocks against a horizontal load: λ = 0. Over 4 000 unknowns, where no state was found before."""
    built, labels = wall(28, friction=0.0)
    assert 3 * len(built.interfaces) > 4000
    options = SolveOptions()
    proof = solve_labelling(limit_analysis(built, options), labels, options)
    assert proof.status is Status.COLLAPSE
    assert proof.bracket == pytest.approx((0.0, 0.0), abs=1e-7)


@pytest.mark.parametrize(("gravity", "status"), [([0.0, -9.81], Status.LOCKED), ([30.0, -9.81], Status.UNSTABLE)])
def test_rays_of_large_programs_are_settled_by_repairs(
    gravity: list[float], status: Status, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A push down on a corner carries any λ, or stops no fall: settled without rigid blocks and their simplex."""
    labels = wall(8)[1]
    content = document("planar", 8) | {"loads": {"live": [{"element": "c0r0", "force": [0, -1]}]}}
    content["materials"]["gravity"] = gravity
    built = build_assembly(parse_scene(content))
    monkeypatch.setitem(solvers.LARGE, False, 1)
    options = SolveOptions()
    proof = solve_labelling(limit_analysis(built, options), labels, options)
    assert proof.status is status


def test_rays_of_walls_that_a_dead_load_pushes_sideways_need_no_simplex(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weight alone fails, a load straight down carries any λ: simplex took over 100 s at 20 × 20 cells."""

    def refused(*_: object) -> None:
        raise AssertionError("simplex on a large program")

    monkeypatch.setattr("jld_core.limit.facial_reduction.polygonal_support", refused)
    content = document("planar", 16) | {"loads": {"live": [{"body": [0, -1]}]}}
    content["materials"]["gravity"] = [30.0, -9.81]
    scene = parse_scene(content)
    built = build_assembly(scene)
    labels = make_driver("random", search_space(scene, built), 0).ask(1)[0]
    proof = LimitAnalysis(built).prove(labels)
    assert proof.status is Status.LOCKED


def test_large_crushable_walls_have_narrow_brackets() -> None:
    content = document("planar", 16)
    content["materials"]["dry"]["compressive_strength"] = 2e6
    content["materials"]["inner"]["compressive_strength"] = 2e6
    built = build_assembly(parse_scene(content))
    labels = wall(16)[1]
    options = SolveOptions()
    proof = solve_labelling(limit_analysis(built, options), labels, options)
    assert proof.status is Status.COLLAPSE
    assert proof.high - proof.low <= 1e-6 * proof.high


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("edge", "status"), [(32, Status.LOCKED), (26, Status.COLLAPSE)])
def test_walls_that_supports_confine_are_settled_by_sparse_algebra(
    edge: int, status: Status, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lift between three supports: a ray found by the solver itself, and a mechanism without a pseudo-inverse."""
    content = document("planar", edge)
    content["grid"]["rows"] = ["#" + row + "#" for row in content["grid"]["rows"]]
    content["loads"] = {"live": [{"body": [0, 1]}]}
    scene = parse_scene(content)
    built = build_assembly(scene)
    labels = make_driver("random", search_space(scene, built), 0).ask(1)[0]

    def pinv(matrix: np.ndarray, rcond: float) -> np.ndarray:
        raise AssertionError("a pseudo-inverse of a large matrix")

    monkeypatch.setattr(np.linalg, "pinv", pinv)
    options = SolveOptions(condense="off")
    proof = solve_labelling(limit_analysis(built, options), labels, options)
    assert proof.status is status


def test_cubes_whose_last_iterate_proves_nothing_are_proven() -> None:
    """125 cubes slide as one at λ = 0.75."""
    scene = parse_scene(document("spatial", 5))
    built = build_assembly(scene)
    labels = make_driver("random", search_space(scene, built), 0).ask(1)[0]
    proof = solve_labelling(limit_analysis(built, SolveOptions()), labels, SolveOptions())
    assert proof.status is Status.COLLAPSE
    assert proof.high - proof.low <= 1e-6 * proof.high


def test_a_fall_whose_proof_no_iterate_reaches_exactly_is_proven() -> None:
    """An opening in a wall without friction: equations are dependent, and 100 iterations led to no exact proof."""
    content = document("planar", 13)
    content["materials"]["dry"]["friction_coefficient"] = 0.0
    content["grid"]["rows"][4:7] = ["aaaa..aaaaaaa"] * 3
    content["search"]["block_cells"] = [1, 2]
    scene = parse_scene(content)
    built = build_assembly(scene)
    labels = make_driver("random", search_space(scene, built), 0).ask(1)[0]
    options = SolveOptions(solver="schur")
    proof = solve_labelling(limit_analysis(built, options), labels, options)
    assert proof.status is Status.UNSTABLE


# Least share of the capacity of faces: closed forms in the plane, in space and for each kind of face.


def share_of(document: dict[str, Any]) -> Any:
    assembly = build_assembly(parse_scene(document))
    return least_share(assembly, assembly.labels)


def block(friction: float, force: float, **more: Any) -> dict[str, Any]:
    """A block 1 × 2 × 1 of weight 1 under a horizontal force at its centroid."""
    dry = {"friction_coefficient": friction, **more.pop("dry", {})}
    return {
        "elements": [
            {"id": "g", "support": True, "polygon": [[-2, -1], [2, -1], [2, 0], [-2, 0]]},
            {"id": "b", "polygon": [[-0.5, 0], [0.5, 0], [0.5, 2], [-0.5, 2]], "weight": 1.0},
        ],
        "materials": {"dry": dry, **more.pop("materials", {})},
        "loads": {"dead": [{"element": "b", "force": [force, 0]}], "live": [{"body": [1, 0]}]},
        **more,
    }


@pytest.mark.parametrize("friction", [0.3, 2.0])
def test_eccentricity_and_slip_of_a_block(friction: float) -> None:
    """Statics: e = H h/2 / W of l/2, and H of μW."""
    found = share_of(block(friction, 0.2))
    assert found.bending == pytest.approx([0.4], rel=1e-9)
    assert found.slip == pytest.approx([0.2 / friction], rel=1e-9)
    low, high = found.bracket
    assert low <= max(0.4, 0.2 / friction) <= high
    assert high - low < 3e-3


def test_a_block_that_falls_has_none() -> None:
    assert share_of(block(2.0, 0.6)) is None


def test_an_inner_face_uses_its_tensile_strength() -> None:
    """M = (N + σt A) l/6 · share, with N = 1, M = 0.5: 3/(1 + 5); the face is glued to the support."""
    inner = {"tensile_strength": 5.0, "shear_strength": 10.0}
    found = share_of(block(1.0, 0.5, materials={"inner": inner}, labels={"inner": [["b", "g"]]}))
    assert found.share == pytest.approx([0.5], rel=1e-9)
    # yield sets shrink in both: M = (N + θσt A) θ l/6
    root = (math.sqrt(1.0 + 4 * 5 * 3) - 1.0) / 10.0
    assert found.bracket[0] <= root <= found.bracket[1]


def test_bond_counts_from_its_apex() -> None:
    """With σt = 1 and c = 2: N' = N + 1 = 2, eccentricity share 0.4/2, shear share 0.2/(c + μN) = 0.2/3."""
    materials = {"inner": {"tensile_strength": 5.0, "shear_strength": 10.0}}
    found = share_of(block(1.0, 0.2, dry={"cohesion": 2.0, "tensile_strength": 1.0}, materials=materials))
    assert found.forces[0] == pytest.approx([1.0, 0.2, 0.2], rel=1e-6)
    assert found.bending == pytest.approx([0.2], rel=1e-6)
    assert found.slip == pytest.approx([0.2 / 3.0], rel=1e-6)


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_a_cuboid_in_space(angle: float) -> None:
    """A force H at height 1 on a 1 × 1 base: e = H/W, of 1/2 over the larger of |cos| and |sin|."""
    force = [0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.0]
    found = share_of(
        {
            "elements": [box("g", (-2, -2, -1), (3, 3, 0), support=True), box("b", (0, 0, 0), (1, 1, 2), weight=1.0)],
            "materials": {"dry": {"friction_coefficient": 0.8}},
            "loads": {"dead": [{"element": "b", "force": force}], "live": [{"body": [1, 0, 0]}]},
        }
    )
    assert found.bending == pytest.approx([0.4 * math.cos(angle)], rel=1e-6)
    assert found.slip == pytest.approx([0.25], rel=1e-6)
    assert found.bracket[0] <= 0.4 * math.cos(angle) <= found.bracket[1]


def test_an_arch_has_no_state_of_smaller_share() -> None:
    """The state found keeps its share, and with a hundredth less the arch falls, proven anew."""
    assembly = build_assembly(arch(voussoirs=8, thickness=0.24))
    found = least_share(assembly, assembly.labels)
    assert found.share.max() <= found.bracket[1] * (1 + 1e-9)
    assert np.all(np.maximum(found.bending, found.slip) <= found.share + 1e-12)
    assert LimitAnalysis(shrunk(assembly, found.bracket[0])).stands(assembly.labels) is False
