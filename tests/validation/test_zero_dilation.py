"""Collapse without dilation: the given walls, random walls, closed forms, the certificate (docs/method.md (4.3)).

Sources: Gilbert, Casapulla, Ahmed, Computers & Structures 84 (2006) 873–887; walls of Ferris & Tin-Loi 2001 with
the local minima of a public MPEC solver as lower ends of the plausible range.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies.by_scheme import solve_zero_dilation, zero_dilation
from studies.families import halved_bond, random_wall
from studies.scenes import leonardo_flat_arch, stacked_cubes

import cases
from cases import CASES, as_elements, grid_assembly, grid_document
from command import SCENES, call
from jld_core import (
    Assembly,
    InputError,
    LimitAnalysis,
    Scene,
    SolveOptions,
    Status,
    build_assembly,
    load_scene,
    parse_scene,
    solve,
)
from jld_dilation import ProximalOptions, certificate
from jld_explore import ExploreSettings, explore
from proofs import block, certify, flow_rule, loads_without_dilation, work_balance

WALLS = {"ferris_tinloi_1": 0.638981, "ferris_tinloi_2": 0.562005, "ferris_tinloi_4": 0.263736}


def wall(name: str) -> Assembly:
    return build_assembly(load_scene(SCENES / f"{name}.json"))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("start", ["associative", "gravity", "vertex"])
@pytest.mark.parametrize("name", WALLS)
def test_given_walls(name: str, start: str) -> None:
    result = solve_zero_dilation(wall(name), start=start)
    assert result.status is Status.COLLAPSE
    assert result.friction == "zero-dilation"
    certify(result)
    assert result.facts["friction_violation"] <= 1e-4
    assert result.facts["dilation"] <= 1e-6
    assert result.facts["complementarity_gap"] <= 1e-3
    assert WALLS[name] * (1.0 - 1e-5) <= result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-8)
    assert work_balance(result).error <= 1e-7
    printed = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert printed["friction"] == "zero-dilation"
    assert printed["converged"] is True


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("damping", "block"), [(1e-3, 3), (1e-1, 8)])
@pytest.mark.parametrize("name", WALLS)
def test_given_walls_under_other_parameters(name: str, damping: float, block: int) -> None:
    """The value depends on the parameters, since solutions are not unique; that it is one does not."""
    result = solve_zero_dilation(wall(name), damping=damping, block=block, alpha=0.0)
    certify(result)
    assert WALLS[name] * (1.0 - 1e-5) <= result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-8)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(8))
def test_random_walls(seed: int) -> None:
    result = solve_zero_dilation(build_assembly(random_wall(seed)))
    assert result.status is Status.COLLAPSE
    certify(result)
    assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-8)


@pytest.mark.parametrize("name", ["wall", "beam", "arch", "crushable arch", "crushable wall", "no tensile strength"])
def test_inner_faces_are_left_alone(name: str) -> None:
    rows, options = CASES[name]
    result = solve_zero_dilation(grid_assembly(rows, **options))
    assert result.status is Status.COLLAPSE
    assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-6)
    rule = flow_rule(result)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.min() >= -1e-6 * abs(result.load_factor)


def test_statuses_of_structures_that_do_not_collapse() -> None:
    for name, status in (("overhang", Status.UNSTABLE), ("pressed", Status.LOCKED)):
        rows, options = CASES[name]
        result = solve_zero_dilation(grid_assembly(rows, **options))
        assert result.status is status
        assert np.isnan(result.load_factor)


# --- closed forms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.1, 0.4, 0.9])
def test_sliding_block_is_the_same_with_and_without_dilation(friction: float) -> None:
    result = solve_zero_dilation(block(friction, [{"body": [1, 0]}], [], 0))
    assert result.load_factor == pytest.approx(friction, rel=1e-8)
    assert result.facts["associative_load_factor"] == pytest.approx(friction, rel=1e-8)
    assert abs(result.mechanism[0, 1]) <= 1e-8 * abs(result.mechanism[0, 0])


@pytest.mark.parametrize("push", [1.0, 2.0])
def test_wedged_block(push: float) -> None:
    """A block between fixed walls, pushed to the right by H and lifted by λ.

    With dilation it cannot move: the walls would have to part, any λ is carried by self-stress. Without, it
    slides up both walls, N_right = H + N_left, and λ = W + μ (H + 2 N_left) for whatever N_left the self-stress
    is. A start from the least forces leaves little of it.
    """
    friction = 0.3
    live, dead = [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [push, 0]}]
    assembly = block(friction, live, dead, 2)
    assert LimitAnalysis(assembly).solve().status is Status.LOCKED
    result = solve_zero_dilation(assembly)
    assert result.status is Status.COLLAPSE
    assert result.facts["associative_load_factor"] is None
    certify(result)
    ids = result.assembly.elements.ids
    left = float(result.forces[[ids[b] for b in result.assembly.interfaces.b].index("left"), 0])
    assert 0.0 <= left <= 0.1 * push
    assert result.load_factor == pytest.approx(1.0 + friction * (push + 2.0 * left), rel=1e-7)


def test_block_lifted_along_one_wall() -> None:
    """With one wall N = H by statics, so dilation changes nothing: λ = W + μH."""
    live, dead = [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [0.8, 0]}]
    result = solve_zero_dilation(block(0.3, live, dead, 1))
    assert result.load_factor == pytest.approx(1.24, rel=1e-7)
    assert result.facts["associative_load_factor"] == pytest.approx(1.24, rel=1e-7)


# --- spatial ------------------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("live", [[1, 0, 0], [0, 1, 0], [0.6, 0.5, 0]])
@pytest.mark.parametrize("wythes", [1, 2])
def test_spatial_walls(wythes: int, live: list[float]) -> None:
    assembly = cases.assembly_in_space(cases.wall_in_space(3, 3, wythes), live=[{"body": live}])
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    result = solve_zero_dilation(assembly, dry)
    assert result.status is Status.COLLAPSE
    assert result.gap <= 1e-6
    assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-6)
    assert result.facts["dilation"] <= 1e-6
    rule = flow_rule(result)
    assert rule.margin.min() >= -1e-9
    assert rule.gap.min() >= -1e-7
    assert work_balance(result).error <= 1e-7


def test_given_spatial_scenes() -> None:
    for name in ("spatial_cubes", "spatial_shelf"):
        result = solve_zero_dilation(build_assembly(load_scene(SCENES / f"{name}.json")))
        assert result.status is Status.COLLAPSE, name
        assert result.load_factor <= result.facts["associative_load_factor"] * (1.0 + 1e-6)


def test_an_analysis_is_used_again_and_options_are_checked() -> None:
    assembly = wall("ferris_tinloi_1")
    analysis = LimitAnalysis(assembly)
    associative = analysis.prove(assembly.labels)
    first, again = (zero_dilation(analysis, associative=associative) for _ in range(2))
    assert first.load_factor == again.load_factor
    with pytest.raises(InputError, match="start"):
        ProximalOptions(start="other")
    with pytest.raises(InputError, match="alpha"):
        ProximalOptions(alpha=2.0)
    with pytest.raises(InputError, match="positive"):
        ProximalOptions(block=0)
    spatial = build_assembly(load_scene(SCENES / "spatial_cubes.json"))
    with pytest.raises(InputError, match="vertex"):
        solve_zero_dilation(spatial, start="vertex")


# The lowest and the highest collapse load without dilation: found from every side.
#
# Sources: local minima of a public MPEC solver for walls 1, 2 and 4 of Ferris & Tin-Loi 2001 (0.638981, 0.562005,
# 0.263736, to the digits published); walls 3 and 5 are held to what this search has found; two cubes and one block in
# closed form; the small walls against the proven floor of tests/core/test_zero_dilation_floor.py.


LOWEST = {
    "ferris_tinloi_1": 0.6390,
    "ferris_tinloi_2": 0.5604,
    "ferris_tinloi_3": 0.3559,
    "ferris_tinloi_4": 0.2638,
    "ferris_tinloi_5": 0.2080,
}


def ends(assembly: Assembly) -> tuple[float, float]:
    """Lowest and highest found, each held against its own evidence."""
    result = solve(assembly, friction="zero-dilation", range=True, floor_seconds=0.0)
    assert result.status is Status.COLLAPSE
    certify(result)
    extra = result.facts
    assert extra["lowest_found"] == result.load_factor
    highest = extra["highest"]
    assert highest["status"] == "collapse"
    assert highest["friction_violation"] <= 1e-4
    assert highest["dilation"] <= 1e-6
    assert extra["lowest_found"] <= extra["highest_found"] == highest["load_factor"]
    if extra["associative_load_factor"] is not None:
        assert extra["highest_found"] <= extra["associative_load_factor"] * (1.0 + 1e-8)
    json.dumps(result.to_json(), allow_nan=False)
    return extra["lowest_found"], extra["highest_found"]


# the command that prints the range holds the first, and the guide has the second as an example
@pytest.mark.long
@pytest.mark.parametrize("name", LOWEST)
def test_given_walls_go_as_low_as_published_minima(name: str) -> None:
    assert ends(build_assembly(load_scene(SCENES / f"{name}.json")))[0] <= LOWEST[name]


def test_forces_that_no_mechanism_completes_are_brought_to_a_solution() -> None:
    """From gravity, wall 4: in another unit of force and length the same λ."""
    loads = []
    for unit in (1.0, 1e-3):
        document = as_elements(load_scene(SCENES / "ferris_tinloi_4.json"))
        for element in document["elements"]:
            element["polygon"] = (unit * np.array(element["polygon"])).tolist()
            element["weight"] *= unit
        assembly = build_assembly(parse_scene(document))
        result = solve(assembly, friction="zero-dilation", start="gravity")
        assert result.zero_dilation.converged
        loads.append(result.load_factor)
    assert loads[1] == pytest.approx(loads[0], rel=1e-9)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("size", "lowest"), [((2, 5), 0.611295681), ((2, 6), 0.545054945), ((2, 7), 0.489795918), ((2, 8), 0.443919717)]
)
def test_small_walls(size: tuple[int, int], lowest: float) -> None:
    low, high = ends(build_assembly(halved_bond(*size)))
    assert low == pytest.approx(lowest, rel=1e-8)
    assert high > 1.01 * low


def test_flat_arch_gives_up_all_thrust_it_does_not_need() -> None:
    low, high = ends(build_assembly(leonardo_flat_arch()))
    assert low <= 1305.9
    assert high >= 2093.9


@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (2, 4)])
def test_where_the_ground_course_slides_there_is_one_value(size: tuple[int, int]) -> None:
    low, high = ends(build_assembly(halved_bond(*size)))
    assert low == pytest.approx(0.65, rel=1e-8)
    assert high == pytest.approx(0.65, rel=1e-8)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("push", [1.0, 2.0])
def test_wedged_block_is_lifted_by_least_where_nothing_is_wedged(push: float) -> None:
    """λ = W + μ(H + 2 N_left): the least has N_left = 0, and there is no most (see test_zero_dilation)."""
    friction = 0.3
    assembly = block(friction, [{"element": "block", "force": [0, 1]}], [{"element": "block", "force": [push, 0]}], 2)
    assert ends(assembly)[0] == pytest.approx(1.0 + friction * push, rel=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.long), 1])
def test_random_walls_go_no_higher_than_one_start_finds(seed: int) -> None:
    assembly = build_assembly(random_wall(seed))
    assert ends(assembly)[0] <= solve(assembly, friction="zero-dilation").load_factor * (1.0 + 1e-9)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", ["wall", "beam", "arch", "crushable arch"])
def test_inner_faces_take_part(name: str) -> None:
    rows, options = CASES[name]
    result = solve(grid_assembly(rows, **options), friction="zero-dilation", range=True, floor_seconds=0.0)
    assert result.status is Status.COLLAPSE
    assert result.facts["lowest_found"] <= result.facts["associative_load_factor"] * (1.0 + 1e-6)
    assert flow_rule(result).gap.min() >= -1e-6 * abs(result.load_factor)


def test_two_cubes_rock_at_one_half() -> None:
    """Base sliding at μ = 0.6 comes after base rocking at 1/2 (Iannuzzo et al. 2024, section 3.2b)."""
    assembly = build_assembly(stacked_cubes(2, friction=0.6, tension=2.0, shear=1.0))
    result = solve(assembly, friction="zero-dilation", range=True, floor_seconds=0.0)
    assert result.facts["lowest_found"] == pytest.approx(0.5, rel=1e-6)
    assert result.facts["highest_found"] == pytest.approx(0.5, rel=1e-6)


def test_spatial_range_is_found() -> None:
    assembly = cases.assembly_in_space(cases.wall_in_space(2, 2, 1), live=[{"body": [1, 0, 0]}])
    dry = np.ones(len(assembly.interfaces), dtype=bool)
    result = solve(assembly, dry, friction="zero-dilation", range=True, floor_seconds=0.0)
    assert result.status is Status.COLLAPSE
    assert result.facts["lowest_found"] <= result.facts["highest_found"]


def test_a_load_that_grows_from_zero_has_no_lowest_below_it() -> None:
    """The shelf stands at zero; one start ends at λ = −0.22."""
    shelf = build_assembly(load_scene(SCENES / "spatial_shelf.json"))
    result = solve(shelf, friction="zero-dilation", range=True, floor_seconds=0.0)
    assert result.stands_at_zero
    assert 0.0 < result.load_factor == result.facts["lowest_found"]


def test_a_structure_that_does_not_collapse_has_no_range() -> None:
    rows, options = CASES["overhang"]
    result = solve(grid_assembly(rows, **options), friction="zero-dilation", range=True, floor_seconds=0.0)
    assert result.status is Status.UNSTABLE
    assert result.facts["lowest_found"] is None
    with pytest.raises(InputError, match="one number"):
        solve(grid_assembly(rows, **options), range=True)


def test_the_command_prints_the_range(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    wall = SCENES / "ferris_tinloi_1.json"
    outcome = call(
        monkeypatch, capsys, "solve", wall, "--friction", "zero-dilation", "--range", "--floor-seconds", "0", "--json"
    )
    printed = json.loads(outcome.out)
    assert printed["lowest_proven"] is None
    assert printed["lowest_found"] <= 0.6390 <= 0.6428 <= printed["highest_found"]
    outcome = call(
        monkeypatch, capsys, "solve", SCENES / "spatial_cubes.json", "--friction", "zero-dilation", "--range"
    )
    assert "0.323979676 to 0.323979676" in outcome.out


# --- in a search ----------------------------------------------------------------------------------------------------

ROWS = ["aab", "#.#"]


def beam() -> Scene:
    return parse_scene(grid_document(ROWS, live=[{"body": [0.3, -1.0]}], candidates="all", block_cells=[1, 2]))


def search_by(scene: Scene, tmp_path: Path, floor_seconds: float) -> pd.DataFrame:
    """Every segmentation, ranked by the lowest λ without dilation or by its floor."""
    model = SolveOptions(friction="zero-dilation", range=True, floor_seconds=floor_seconds)
    settings = ExploreSettings(driver="enumeration", model=model, jobs=1, pictures=False)
    return explore(scene, tmp_path / f"{floor_seconds:g}", settings).results


@pytest.mark.long
def test_a_search_ranks_by_the_lowest_found_or_by_the_floor(tmp_path: Path) -> None:
    found, proven = search_by(beam(), tmp_path, 0.0), search_by(beam(), tmp_path, 2.0)
    first = found[found["settled"] == "solve"].set_index("labelling")["load_factor"].dropna()
    floors = proven[proven["settled"] == "solve"].set_index("labelling")["load_factor"].dropna()
    assert len(first) >= 2
    assert len(floors) >= 1
    for labelling, floor in floors.items():
        if labelling in first.index:
            assert floor <= first[labelling] * (1.0 + 1e-9)
    assert first.round(9).is_monotonic_decreasing


TINY = (["a", "a", "#"], ["aa", "##"], ["#a#", "###"], ["#aa#"], ["a.", "aa", "##"])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", [*range(8), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(8, 15))])
def test_all_solutions_of_tiny_scenes(seed: int) -> None:
    """Inner faces and loads at random: what is found are the ends of all solutions there are, what is proven is below
    them all, and a scene without any is not given one."""
    rng = np.random.default_rng(seed)
    rows = TINY[seed % len(TINY)]
    cells = [f"c{x}r{y}" for y, row in enumerate(rows) for x, letter in enumerate(row) if letter == "a"]
    force = rng.normal(size=2) * 20.0
    live = [{"element": str(rng.choice(cells)), "force": force.tolist(), "at": rng.uniform(0.0, 0.2, 2).tolist()}]
    strength = float(rng.choice([5e2, 2e3, 1e4]))
    friction = float(rng.choice([0.3, 0.75]))
    assembly = grid_assembly(rows, live=live, tension=strength, shear=strength, friction=friction)
    labels = rng.random(len(assembly.interfaces)) < 0.6
    every = loads_without_dilation(assembly, labels)
    result = solve(assembly, labels, friction="zero-dilation", range=True, floor_seconds=2.0)
    extra, tiny = result.facts, 1e-3 * assembly.total_dead / assembly.total_live
    lows = [max(low, 0.0) for low, high in every if high >= 0.0]
    if extra["lowest_found"] is None:
        assert result.status is not Status.COLLAPSE
        assert not lows or result.status is Status.LOCKED
        return
    assert extra["lowest_found"] == pytest.approx(min(lows), rel=1e-6, abs=1e-6 * tiny)
    most = max(high for _, high in every)
    if np.isfinite(most):
        assert extra["highest_found"] == pytest.approx(most, rel=1e-6, abs=1e-6 * tiny)
    if extra["lowest_proven"] is not None:
        assert extra["lowest_proven"] <= min(lows) * (1.0 + 1e-9)


def test_a_structure_without_loops_is_bounded_from_below() -> None:
    """Two stacked blocks, pushed down on top by λ and aside below by λ: λ = μ (W + λ), so λ = μ W / (1 − μ)."""
    document = {
        "elements": [
            {"id": "low", "polygon": [[0, 0], [2, 0], [2, 3], [0, 3]]},
            {"id": "top", "polygon": [[0, 3], [2, 3], [2, 4], [0, 4]]},
            {"id": "ground", "polygon": [[-1, -1], [3, -1], [3, 0], [-1, 0]], "support": True},
        ],
        "materials": {"density": 1400, "dry": {"friction_coefficient": 0.2}},
        "loads": {"live": [{"element": "top", "force": [0, -1]}, {"element": "low", "force": [-1, 0]}]},
    }
    result = solve(build_assembly(parse_scene(document)), friction="zero-dilation", range=True)
    expected = 0.25 * 1400.0 * 9.81 * 8.0
    assert result.load_factor == pytest.approx(expected, rel=1e-6)
    assert result.facts["lowest_proven"] == pytest.approx(expected, rel=1e-6)
    assert result.facts["lowest_proven"] <= expected


def test_fractions_of_an_empty_table_keep_its_shape() -> None:
    fractions = certificate.BinaryFractions
    for shape in ((0, 3), (3, 0), (2, 3)):
        assert fractions.of(np.ones(shape)).floats().shape == shape
    assert (fractions.of(np.zeros((0, 2))) @ fractions.of(np.ones((2, 3)))).floats().shape == (0, 3)
