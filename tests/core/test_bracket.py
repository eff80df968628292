"""The bracket holds whatever the solver said: noise on its answer, an unconverged answer, nonsense."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pandas as pd
import pytest
from benchmarks.claims import run as run_claim
from benchmarks.claims.answers import GROUPS, weighed
from benchmarks.claims.answers import drawn_converged as drawn
from hypothesis import given, settings
from hypothesis import strategies as st

import cases
from cases import CASES, ROUTE, Document, all_inner, box, grid_assembly, grid_document
from cases import assembly_in_space as assembly
from jld_core import Assembly, LimitAnalysis, Status, build_assembly, parse_scene, solve, solve_many
from jld_core.batch import chosen
from jld_core.solvers import ClarabelSolver
from jld_core.views import facts_of_result
from jld_explore.report import tables
from proofs import noisy

NAMES = ["wall", "beam", "arch", "crushable wall", "cantilever", "no friction", "very strong"]


@cache
def analysis_of(name: str) -> LimitAnalysis:
    return LimitAnalysis(grid_assembly(CASES[name][0], **CASES[name][1]))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(NAMES), st.sampled_from([1e-2, 1e-4, 1e-6]), st.integers(0, 2**31))
def test_bracket_contains_the_true_value_under_noise(name: str, level: float, seed: int) -> None:
    analysis = analysis_of(name)
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
    analysis = analysis_of(name)
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


# A bracket is a proof whatever its width: what is finite is a collapse, ranked by its lower end.


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", [28, 42, 76, 134, 147])
def test_strong_refined_samples_have_narrow_brackets(seed: int) -> None:
    """Tensile strengths of 1e8 Pa and more, beside weights of some kilonewtons."""
    tally = run_claim("refined", seed, 1, 600.0)
    assert tally.disagreements == []
    assert tally.notes == {"collapse": 1}


@pytest.mark.parametrize(
    ("cell", "crush", "push"),
    [
        ((0.103, 0.505), 51157847.475701064, (-0.29868210051896954, -0.45822670143651395)),
        ((0.11, 0.4), 3e7, (-0.3, -0.4)),
        ((0.2, 0.3), 1e8, (0.3, -0.2)),
        ((0.3, 0.5), 2e8, (0.4, -0.5)),
    ],
)
def test_one_layout_is_known_as_well_as_many(
    cell: tuple[float, float], crush: float, push: tuple[float, float]
) -> None:
    """Cells whose dry joints crush: `solve` is as narrow as `solve_many`, which asks the batch solver first."""
    document = grid_document(["aa", "##"], live=[{"body": list(push)}])
    document["grid"].update(cell=list(cell), thickness=0.13)
    document["materials"] = {
        "density": 2000.0,
        "dry": {"friction_coefficient": 0.75, "compressive_strength": crush},
        "inner": {"tensile_strength": 1083198.151321064, "shear_strength": 108768.34980765745},
    }
    document["labels"] = {"default": "dry"}
    assembly = build_assembly(parse_scene(document))
    alone, many = solve(assembly), solve_many(assembly, [assembly.labels])
    assert alone.status is many.status[0] is Status.COLLAPSE
    assert alone.gap <= 1e-6
    assert alone.bracket[0] <= many.high[0]
    assert many.low[0] <= alone.bracket[1]


def test_a_wide_bracket_is_a_collapse_that_says_how_wide_it_is() -> None:
    """λ is the lower end of a wide bracket; advice names solvers that accept the scene."""
    # cones of crushing: HiGHS refuses them
    document = grid_document(["ab", "##"])
    document["materials"]["dry"]["compressive_strength"] = 1e6
    result = solve(build_assembly(parse_scene(document)), gap=1e-17)
    facts = facts_of_result(result)
    assert result.status is Status.COLLAPSE
    assert any("apart, relative" in warning for warning in result.warnings)
    assert "may narrow" in facts["next"]
    assert "highs" not in facts["next"]


def test_ranks_count_what_is_proven_stronger() -> None:
    """A wide bracket shares the rank of all that it overlaps, and keeps nothing else from its place."""
    narrow, rest = [[2.0] * 3, [1.5] * 3, [0.2, 0.2, 3.4], [1.5, 1.5 - 1e-9, 1.5 + 1e-9]], [[1.0, 1.0, 1.2]]
    value, low, high = np.array([*narrow, *rest, [math.nan] * 3]).T
    group, level = tables._ties(value, low, high)
    assert group.tolist() == [1, 2, 1, 2, 4, 0]
    assert level.tolist() == [1, 2, 4, 2, 3, 0]
    # chains share no rank: a tie is with the best of its group; a missing end is λ itself
    value = np.array([5.0, 4.9, 4.8, 3.0, np.nan, 3.0])
    low = np.array([4.85, 4.75, 4.7, 3.0, np.nan, np.nan])
    high = np.array([5.1, 4.95, 4.84, 3.0, np.nan, np.nan])
    assert tables._ties(value, low, high)[0].tolist() == [1, 1, 2, 4, 0, 4]
    table = pd.DataFrame({"rank": [1, 1, 3], "bracket_lo": [2.0, 0.2, 1.5], "bracket_hi": [2.0, 3.4, 1.5]})
    assert not tables.is_ahead(table, None, 1e-6)
    assert tables.is_ahead(table, 2.0, 1e-6)
    assert tables.is_ahead(table.assign(rank=[1, 2, 3]), None, 1e-6)


# Locked is a claim about every part of a structure, however small its share of the live load (docs/method.md (3.14)).
#
# A block on the floor is pushed along the direction s (1, −1), another pressed down by 1. With friction μ < 1 the first
# slides at s λ = μ (W + s λ), λ = μ W / ((1 − μ) s), however small s is; with μ ≥ 1 both carry any load.


Make = Callable[[float, float], Assembly]


def planar(share: float, friction: float) -> Assembly:
    loads = [
        {"element": "pushed", "force": [share, -share], "at": [0.5, 0.0]},
        {"element": "pressed", "force": [0, -1]},
    ]
    return build_assembly(
        parse_scene(
            {
                "elements": [
                    {"id": "pushed", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
                    {"id": "pressed", "polygon": [[2, 0], [3, 0], [3, 1], [2, 1]]},
                    {"id": "floor", "polygon": [[-1, -1], [4, -1], [4, 0], [-1, 0]], "support": True},
                ],
                "materials": {"density": 1000, "dry": {"friction_coefficient": friction}},
                "loads": {"live": loads},
            }
        )
    )


def spatial(share: float, friction: float) -> Assembly:
    elements = [
        cases.box("pushed", [0, 0, 0], [1, 1, 1]),
        cases.box("pressed", [2, 0, 0], [3, 1, 1]),
        cases.box("floor", [-1, -1, -1], [4, 2, 0], support=True),
    ]
    loads = [{"element": "pushed", "force": [share, 0, -share], "at": [0.5, 0.5, 0.0]}]
    loads.append({"element": "pressed", "force": [0, 0, -1]})
    return cases.assembly_in_space(elements, materials={"dry": {"friction_coefficient": friction}}, live=loads)


SHARES = [(1e-4, 1.0 - 1e-9), (1e-6, 1.0 - 1e-7), (1e-8, 1.0 - 1e-5), (1e-10, 0.999), (1e-12, 0.5), (1e-13, 0.5)]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize(("share", "friction"), SHARES)
def test_small_share_of_the_live_load_is_not_taken_as_rounding(make: Make, share: float, friction: float) -> None:
    """Ten of these twelve were locked while the slack of a ray was judged beside the whole live load."""
    assembly = make(share, friction)
    result = solve(assembly)
    assert result.status in (Status.COLLAPSE, Status.UNCERTIFIED)
    weight = -float(assembly.dead[assembly.elements.free][0, assembly.dimension - 1])
    exact = friction * weight / ((1.0 - friction) * share)
    low, high = result.bracket
    assert not low > exact * (1.0 + 1e-9)
    assert not high < exact * (1.0 - 1e-9)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize(("share", "friction"), SHARES)
def test_batch_solver_takes_no_small_share_as_rounding(make: Make, share: float, friction: float) -> None:
    """Shares of 1e-12 and less were locked by the compiled batch solver."""
    assembly = make(share, friction)
    found = solve_many(assembly, np.ones((1, len(assembly.interfaces)), dtype=bool))
    assert found.status[0] is not Status.LOCKED


@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize("share", [1.0, 1e-3, 1e-6])
def test_small_share_that_carries_any_load_is_locked(make: Make, share: float) -> None:
    assert solve(make(share, 1.1)).status is Status.LOCKED


@pytest.mark.parametrize("make", [planar, spatial])
def test_friction_counts_as_45_degrees_within_rounding_alone(make: Make) -> None:
    """As docs/method.md (3.14) says: 1e-12 of the forces of a face."""
    assert solve(make(1.0, 1.0)).status is Status.LOCKED
    assert solve(make(1.0, 1.0 - 1e-11)).status is not Status.LOCKED


# A share of the family `converged` of random scenes: brackets hold when weighed again, and few stay open.


def test_random_scenes_are_converged_and_hold_when_weighed_again() -> None:
    tally = run_claim("converged", 12, 16, 600.0)
    assert tally.disagreements == []
    opened = {group: sum(n for name, n in tally.notes.items() if name.startswith(f"{group} unc")) for group in GROUPS}
    assert opened["space"] == 0
    assert opened["plane"] == 0


def test_weighing_tells_wrong_bounds() -> None:
    """A bracket that is moved, or forces that are, do not pass."""
    assembly, labels = drawn(4)
    result = solve(assembly, labels)
    assert weighed(assembly, labels, result, False) == ""
    low, high = result.bracket
    wrong = type(result)(**{**result.__dict__, "bracket": (low, 1.001 * high + 1e-3)})
    assert "upper end" in weighed(assembly, labels, wrong, False)
    forces = type(result)(**{**result.__dict__, "forces": 1.01 * result.forces})
    assert "out of balance" in weighed(assembly, labels, forces, False)


@pytest.mark.parametrize("seed", [1690, 2152, 2725, 2869])
def test_crushing_faces_without_force(seed: int) -> None:
    """Forces of zero lie on the boundary of crushing's cones, away from their tips: at 0.2 these were uncertified."""
    assembly, labels = drawn(seed)
    result = solve(assembly, labels)
    assert str(result.status) == "collapse"
    assert weighed(assembly, labels, result, False) == ""


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("seed", "status"), [(31395, "locked"), (32469, "collapse"), (30156, "collapse")])
def test_stepped_joints_at_45_degrees(seed: int, status: str) -> None:
    """Uncertified at first: locked by forces that grow as λ², and upper bounds by a poor projection of the motion."""
    assembly, labels = drawn(seed)
    result = solve(assembly, labels)
    assert str(result.status) == status
    assert weighed(assembly, labels, result, False) == ""


def test_contacts_that_are_no_rectangles_are_weighed_by_their_hull() -> None:
    """A face of six corners counted as its bounding rectangle, turned into a false alarm."""
    assembly, labels = drawn(32295)
    assert not assembly.interfaces.rectangle.all()
    assert weighed(assembly, labels, solve(assembly, labels), False) == ""
