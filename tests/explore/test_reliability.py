"""Reliability of layouts: closed forms, samples beside rebuilt scenes, the same numbers whatever the jobs."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from cases import ROUTE, dry_and_inner, grid_document
from command import Command, saved
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.scene import uncertain
from jld_practice.reliability import (
    Form,
    GoverningBounds,
    Limit,
    LimitFunction,
    ReliabilityOptions,
    SampleBounds,
    Variables,
    analyse,
    compare,
    design_point,
    estimate,
    explore_failures,
    random_structure,
    simulate,
    structure_of,
)
from jld_practice.reliability.monte_carlo import _Drawing

WEIGHT = 2000.0 * 9.81
"""Weight of the sliding block, N."""


def vary(mean: Any, cov: float = 0.1, kind: str = "normal", **more: Any) -> dict[str, Any]:
    return {"mean": mean, "cov": cov, "kind": kind, **more}


def block(friction: Any, force: Any, scale: float = 1.0, **loads: Any) -> dict[str, Any]:
    """A block of 1 × 2 on a support, pushed near its base so that it slides. scale: unit of length, in metres."""
    s = 1.0 / scale

    def box(low: float, high: float) -> list[list[float]]:
        return [[0, low * s], [2 * s, low * s], [2 * s, high * s], [0, high * s]]

    elements = [
        {"id": "ground", "polygon": box(-1, 0), "support": True, "weight": 0.0},
        {"id": "block", "polygon": box(0, 1), "weight": WEIGHT},
    ]
    live = [{"element": "block", "force": force, "at": [s, 0.1 * s]}]
    return {
        "elements": elements,
        "materials": {"dry": {"friction_coefficient": friction}},
        "loads": {"live": live, **loads},
    }


def structure(document: dict[str, Any]) -> Any:
    return random_structure(parse_scene(document))


def sample_bounds(document: dict[str, Any]) -> SampleBounds:
    found = structure(document)
    return SampleBounds(found, found.assembly.labels)


def normal_index(mean: float) -> float:
    """β = (μR − μS)/√(σR² + σS²), R = μ W with cov 0.1, S with cov 0.2 (Hasofer and Lind 1974, linear limit state)."""
    resistance = 0.6 * WEIGHT
    return (resistance - mean) / math.hypot(0.1 * resistance, 0.2 * mean)


def lognormal_index(mean: float) -> float:
    """β = ln(mR/mS)/√(ζR² + ζS²) with the medians m = μ/√(1 + v²) (Rackwitz and Fiessler 1978, product form)."""
    squares = math.log(1.01), math.log(1.04)
    medians = 0.6 * WEIGHT / math.exp(0.5 * squares[0]), mean / math.exp(0.5 * squares[1])
    return math.log(medians[0] / medians[1]) / math.sqrt(sum(squares))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("load", [6000.0, 9000.0])
@pytest.mark.parametrize(("kind", "exact"), [("normal", normal_index), ("lognormal", lognormal_index)])
def test_both_methods_give_the_index_of_a_sliding_block(kind: str, exact: Any, load: float) -> None:
    found = structure(block(vary(0.6, 0.1, kind), [vary(load, 0.2, kind), 0.0]))
    result = analyse(found, found.assembly.labels, ReliabilityOptions(samples=8_000))
    assert result.form.beta == pytest.approx(exact(load), rel=1e-6)
    assert result.simulation.beta == pytest.approx(exact(load), rel=0.01)
    low, high = result.simulation.interval
    assert low < norm.cdf(-exact(load)) < high
    assert result.simulation.undecided == 0


def test_the_index_is_negative_where_the_means_fail() -> None:
    found = sample_bounds(block(vary(0.6), [vary(14000.0, 0.2), 0.0]))
    form = design_point(LimitFunction(found, 1.0))
    assert form.beta == pytest.approx(normal_index(14000.0), rel=1e-6)
    assert form.beta < 0.0


def test_a_load_far_below_the_capacity_has_a_reliability_index() -> None:
    """β = (μ W − m)/s, where λ = μ W/H is far from linear between the mean and the design point."""
    form = design_point(LimitFunction(sample_bounds(block(0.6, [vary(1000.0, 0.2), 0.0])), 1.0))
    assert form.beta == pytest.approx((0.6 * WEIGHT - 1000.0) / 200.0, rel=1e-6)


def test_the_index_does_not_depend_on_units() -> None:
    forms = []
    for scale in (1.0, 1e-3):
        document = block(vary(0.6), [vary(7000.0, 0.2), 0.0], scale)
        forms.append(design_point(LimitFunction(sample_bounds(document), 1.0)).beta)
    assert forms[0] == pytest.approx(forms[1], rel=1e-9)


def test_a_force_of_certain_direction_is_one_variable() -> None:
    one = sample_bounds(block(vary(0.6), vary([6000.0, -300.0], 0.2)))
    assert one.structure.variables.names == ("materials.dry.friction_coefficient", "loads.live[0].force")
    values = np.array([[0.6, 1.5]])
    assert np.array_equal(one.structure.loads(values, 0)[1][0, 1, :2], [9000.0, -450.0])


def wall(**changes: Any) -> dict[str, Any]:
    """A wall of which everything is uncertain: two courses of bricks, a body load and a pressure."""
    document = grid_document(["aabb", "cddc", "####"], tension=4e3, shear=5e3, cohesion=500.0, inner_friction=0.3)
    document["materials"] |= {
        "density": vary(1400.0, 0.1),
        "dry": {"friction_angle": vary(35.0, 0.1, each=True), "cohesion": vary(500.0, 0.2, "lognormal")},
        "inner": {
            "tensile_strength": vary(4e3, 0.2, "lognormal", each=True),
            "shear_strength": vary(5e3, 0.2),
            "friction_coefficient": vary(0.3, 0.1),
        },
    }
    document["loads"] = {
        "dead": [{"element": "c0r0", "force": [0.0, vary(-5.0)]}],
        "live": [
            {"body": vary([1.0, 0.0], 0.2)},
            {"face": {"between": ["c0r1", "outside"]}, "pressure": vary(20.0, 0.3, "lognormal")},
            {"element": "c1r0", "moment": vary(0.1)},
        ],
    }
    document["materials"] |= changes
    return document


def crushing() -> dict[str, Any]:
    document = grid_document(["aabb", "cddc", "####"], tension=4e3, shear=5e3, crush_dry=1e5, crush_inner=2e5)
    document["materials"]["dry"]["compressive_strength"] = vary(1e5, 0.2, "lognormal")
    document["materials"]["inner"]["compressive_strength"] = vary(2e5, 0.2, "lognormal", each=True)
    document["materials"]["density"] = vary(1400.0)
    return document


def cubes() -> dict[str, Any]:
    """Two cubes on a support, in space: pushed across, both labels, a load case each."""

    def box(name: str, low: float, support: bool = False) -> dict[str, Any]:
        corners = [[x, y, z] for z in (low, low + 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        return {"id": name, "vertices": corners, "faces": faces, "support": support}

    return {
        "elements": [box("g", -1.0, True), box("a", 0.0), box("b", 1.0)],
        "materials": dry_and_inner(
            vary(2000.0, 0.1, each=True), vary(0.5, 0.1, "lognormal"), vary(4e3, 0.2), vary(3e3, 0.2, "lognormal")
        ),
        "labels": {"inner": [["a", "b"]]},
        "loads": {
            "cases": [
                {"name": "push", "live": [{"element": "b", "force": [vary(3000.0, 0.2), 500.0, 0.0]}]},
                {"name": "twist", "live": [{"element": "b", "moment": [0.0, 0.0, vary(2000.0)]}], "required": 1.5},
            ]
        },
    }


def tied() -> dict[str, Any]:
    document = grid_document(["aabb", "cddc", "####"], tension=4e3, shear=5e3, friction=3.0)
    document["members"] = [
        {
            "kind": "tie",
            "from": {"element": "c0r0", "at": [0.05, 0.25]},
            "to": {"element": "c0r2", "at": [0.05, 0.05]},
            "tension": vary(15.0, 0.2),
            "prestress": 5.0,
        }
    ]
    return document


def put(document: Any, path: tuple[str | int, ...], value: Any) -> None:
    for key in path[:-1]:
        document = document[key]
    document[path[-1]] = value


SCENES = {"wall": wall, "crushing": crushing, "cubes": cubes, "tied": tied}


@pytest.mark.parametrize("name", list(SCENES))
def test_samples_are_the_scene_with_other_numbers(name: str) -> None:
    """The structure at a sample is what `build_assembly` makes of the scene with the same numbers (each off)."""
    document = json.loads(json.dumps(SCENES[name]()).replace('"each": true', '"each": false'))
    scene = parse_scene(document)
    found = random_structure(scene)
    values = found.variables.values(np.random.default_rng(5).standard_normal(len(found.variables)))
    plain = scene.model_dump(mode="json", exclude_defaults=True)
    for (path, value), number in zip(uncertain.uncertain_values(scene), values.tolist(), strict=True):
        put(plain, path, [number * one for one in value] if isinstance(value, list) else number)
    rebuilt = build_assembly(parse_scene(plain))
    for case, expected in enumerate(rebuilt.by_case):
        own = found.at(values, case)
        for field, numbers in vars(expected.strengths(ROUTE)).items():
            assert getattr(own.strengths(ROUTE), field) == pytest.approx(numbers, rel=1e-12, nan_ok=True), field
        scale = abs(expected.dead).max()
        assert own.dead == pytest.approx(expected.dead, rel=1e-9, abs=1e-12 * scale)
        assert own.live == pytest.approx(expected.live, rel=1e-9, abs=1e-12 * scale)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", list(SCENES))
def test_the_batch_solver_bounds_what_solve_finds(name: str) -> None:
    """Bounds of samples in the batch solver agree with `solve` on the same structure, to the width of both brackets."""
    found = sample_bounds(SCENES[name]())
    assert found.batched
    points = np.random.default_rng(2).standard_normal((5, len(found.structure.variables)))
    values = found.structure.variables.values(points)
    bounds, proven = found.of(values), found.proven(values)
    assert bounds.low == pytest.approx(proven.low, rel=3e-6)
    assert bounds.high == pytest.approx(proven.high, rel=3e-6)
    one = found.structure.at(values[0], 0)
    asked = float(found.structure.assembly.required[0])
    assert solve(one, found.labels).load_factor / asked >= bounds.low[0] * (1.0 - 1e-9)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", list(SCENES))
def test_gradients_are_rates_of_the_load_factor(name: str) -> None:
    """Rates by mechanism and forces, (12.4), against central differences of λ."""
    found = sample_bounds(SCENES[name]())
    function = LimitFunction(found, 1.0)
    count = len(found.structure.variables)
    point = 0.3 * np.random.default_rng(7).standard_normal(count)
    here = function.at(point)
    largest = np.argsort(-abs(here.gradient))[:4]
    for k in largest:
        step = np.zeros(count)
        step[k] = 1e-3
        rate = (function.at(point + step).value - function.at(point - step).value) / 2e-3
        assert here.gradient[k] == pytest.approx(rate, rel=2e-3, abs=1e-4 * abs(here.gradient).max())


def test_results_do_not_depend_on_jobs_and_follow_the_seed() -> None:
    found = sample_bounds(wall())
    runs = [simulate(found, 0.8, 600, seed, jobs) for seed, jobs in ((1, 1), (1, 3), (2, 1))]
    assert runs[0].failures == runs[1].failures
    assert runs[0].nearest is not None
    assert np.array_equal(runs[0].nearest, runs[1].nearest)
    assert runs[0].failures != runs[2].failures
    assert 0 < runs[0].failures < 600


def test_importance_sampling_agrees_with_plain_sampling() -> None:
    found = sample_bounds(block(vary(0.6), [vary(9500.0, 0.2), 0.0]))
    form = design_point(LimitFunction(found, 1.0))
    plain = simulate(found, 1.0, 4000, 3)
    weighted = simulate(found, 1.0, 4000, 3, points=[form])
    assert weighted.importance
    assert not plain.importance
    exact = norm.cdf(-normal_index(9500.0))
    assert weighted.probability == pytest.approx(exact, rel=0.06)
    assert plain.probability == pytest.approx(exact, rel=0.2)
    assert weighted.interval[1] - weighted.interval[0] < plain.interval[1] - plain.interval[0]


def test_samples_behind_the_means_are_neither_too_many_nor_too_few() -> None:
    """Φ(−1.5) behind the design point at 3, over 100 runs; plain samples in the first of ten strata gave half more."""
    point = Form(3.0, np.array([3.0]), 1)
    runs = [_Drawing.around([point], 200, seed, 1, rare=True).part(0) for seed in range(100)]
    shares = [float(weights[points[:, 0] < -1.5].sum()) / 200 for points, weights in runs]
    assert np.mean(shares) == pytest.approx(norm.cdf(-1.5), rel=0.05)


def test_failing_means_are_no_rare_failure() -> None:
    """β = −1.45: failures are the rule, and plain samples tell more than those around the design point."""
    found = structure(block(vary(0.6), [vary(17000.0, 0.2), 0.0]))
    result = analyse(found, found.assembly.labels, ReliabilityOptions(samples=2000)).simulation
    assert not result.importance
    assert result.interval[1] - result.interval[0] < 0.03
    assert result.probability == pytest.approx(norm.cdf(-normal_index(17000.0)), abs=1e-3)


def test_a_simulation_without_failures_claims_no_certainty() -> None:
    """At most 3.7 / 400 at 97.5 %, from 400 samples around the means without a failure (Clopper and Pearson 1934)."""
    found = sample_bounds(block(0.6, [vary(1000.0, 0.1), 0.0]))
    none = simulate(found, 1.0, 4000, 0, points=[Form(4.0, np.array([-4.0]), 1)])
    assert none.importance
    assert none.failures == 0
    assert none.interval == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / 400.0)))


def test_samples_left_open_by_the_batch_solver_are_solved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    found = sample_bounds(block(vary(0.6), [vary(9500.0, 0.2), 0.0]))
    before = simulate(found, 1.0, 40, 0)
    nothing = GoverningBounds(np.full(40, -np.inf), np.full(40, np.inf))
    monkeypatch.setattr(found, "of", lambda values, required=None: nothing)
    again = simulate(found, 1.0, 40, 0)
    assert again.resolved == 40
    assert again.failures == before.failures
    monkeypatch.setattr(found, "proven", lambda values: nothing)
    left = simulate(found, 1.0, 40, 0)
    assert (left.undecided, left.failures, left.interval[0]) == (40, 0, 0.0)


@dataclass(frozen=True)
class Planes:
    """Limit function of linear mechanisms: the least (a series system) or the largest (a parallel one) of them."""

    slopes: np.ndarray
    sides: np.ndarray
    series: bool
    required: float = 0.0

    @property
    def variables(self) -> Variables:
        count = self.slopes.shape[1]
        return Variables(("",) * count, np.ones(count), np.ones(count), np.zeros(count, dtype=bool))

    @property
    def bounds(self) -> Any:
        """Bounds of samples, whose values are 1 + u."""

        def of(values: np.ndarray, required: float = 0.0) -> GoverningBounds:
            sides = self.sides - (values - 1.0) @ self.slopes.T
            found = sides.min(axis=1) if self.series else sides.max(axis=1)
            return GoverningBounds(found, found)

        return SimpleNamespace(of=of, batched=False, structure=SimpleNamespace(variables=self.variables))

    def at(self, point: np.ndarray) -> Limit:
        values = self.sides - self.slopes @ point
        chosen = int(np.argmin(values) if self.series else np.argmax(values))
        return Limit(float(values[chosen]), -self.slopes[chosen])


@pytest.mark.parametrize(("series", "point"), [(True, (0.0, 1.5)), (False, (2.0, 1.5))])
def test_a_kink_of_the_failure_surface_has_a_design_point(series: bool, point: tuple[float, float]) -> None:
    """u₁ ≥ 2 or u₂ ≥ 1.5 fails at (0, 1.5); u₁ ≥ 2 and u₂ ≥ 1.5 at the corner (2, 1.5)."""
    function: Any = Planes(np.eye(2), np.array([2.0, 1.5]), series)
    form = design_point(function)
    assert form.found
    assert form.kink is not series
    assert form.point == pytest.approx(point, abs=1e-6)
    assert form.beta == pytest.approx(math.hypot(*point), rel=1e-9)


def beside(count: int, p: float, cov: float = 0.1) -> tuple[dict[str, Any], float]:
    """Blocks side by side, each with its own friction, that slide with the probability p each; and 1 − (1 − p)ⁿ."""
    spread = math.sqrt(math.log1p(cov**2))
    mean = 0.4 / math.exp(norm.ppf(p) * spread - 0.5 * spread**2)
    elements: list[dict[str, Any]] = [
        {"id": "g", "support": True, "polygon": [[-1, -1], [3 * count, -1], [3 * count, 0], [-1, 0]]}
    ]
    for k in range(count):
        corners = [[3 * k, 0], [3 * k + 2, 0], [3 * k + 2, 0.2], [3 * k, 0.2]]
        elements.append({"id": f"b{k}", "polygon": corners, "weight": 1.0})
    live = [{"element": f"b{k}", "force": [0.4, 0], "at": [3 * k + 1, 0.1]} for k in range(count)]
    dry = {"friction_coefficient": vary(mean, cov, "lognormal", each=True)}
    return {"elements": elements, "materials": {"dry": dry}, "loads": {"live": live}}, -math.expm1(
        count * math.log1p(-p)
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("count", "p"), [(4, 1e-7), (10, 7.28e-7), (3, 1e-4)])
def test_rare_failures_of_several_mechanisms_are_all_counted(count: int, p: float) -> None:
    document, exact = beside(count, p)
    found = structure(document)
    result = analyse(found, found.assembly.labels, ReliabilityOptions(samples=8_000))
    low, high = result.simulation.interval
    assert low <= exact <= high
    assert high < 1.5 * exact
    assert len(result.points) == count
    assert result.simulation.probability == pytest.approx(exact, rel=0.1)


def test_what_no_design_point_explains_widens_the_interval() -> None:
    """A mechanism that no search finds: the exploration counts its samples, and the interval holds it."""
    function: Any = Planes(np.eye(2), np.array([4.0, 4.1]), series=True)
    seen: Any = Planes(np.eye(2), np.array([4.0, 99.0]), series=True)
    result = simulate(function.bounds, 0.0, 20_000, 0, points=[design_point(seen)])
    exact = norm.cdf(-4.0) + norm.cdf(-4.1)
    assert result.interval[1] < exact  # blind to the other mechanism
    explored = explore_failures(function, design_point(seen), 10_000, 0, 1)
    assert [one.beta for one in explored.points] == pytest.approx([4.0, 4.1])
    blind: Any = replace(function)
    object.__setattr__(blind, "at", lambda point: Limit(math.nan, None))
    left = explore_failures(blind, design_point(seen), 10_000, 0, 1)
    assert len(left.points) == 1
    assert left.unseen > norm.cdf(-4.1)


@pytest.mark.parametrize("seed", range(3))
def test_intervals_hold_the_probability_of_series_systems(seed: int) -> None:
    """Mechanisms of variables of their own: P = 1 − Π Φ(β_i); three of the 200 systems of the benchmark."""
    dice = np.random.default_rng(seed)
    count = int(dice.integers(2, 13))
    sides = 4.0 + 0.8 * dice.random(count)
    slopes = np.zeros((count, 2 * count))
    for k in range(count):
        slopes[k, 2 * k : 2 * k + 2] = dice.standard_normal(2)
    slopes /= np.linalg.norm(slopes, axis=1)[:, None]
    function: Any = Planes(slopes, sides, series=True)
    result = estimate(function, function.variables, ReliabilityOptions(samples=10_000, seed=seed))
    low, high = result.simulation.interval
    assert low <= -math.expm1(float(norm.logcdf(sides).sum())) <= high


@pytest.mark.sampled(2)
@pytest.mark.parametrize("required", [0.5, 1.25, 3.0])
@pytest.mark.parametrize("cov", [1e-5, 1e-3, 0.5])
def test_values_that_hardly_matter_give_an_answer(required: float, cov: float) -> None:
    """λ of a block pushed by its own weight does not depend on its density, λ of one that crushes hardly does."""
    document = grid_document(["aab", "dcc", "###"], tension=4e3, shear=4e3, crush_dry=3e4, crush_inner=3e4)
    document["materials"]["density"] = vary(2000.0, cov, "lognormal")
    document["loads"] = {"pushes": {"of_weight": 0.5, "directions": 2, "required": 1.25}}
    found = structure(document)
    result = analyse(found, found.assembly.labels, ReliabilityOptions(required, samples=200))
    low, high = result.simulation.interval
    assert 0.0 <= low <= result.simulation.probability <= high <= 1.0


def test_a_stronger_layout_wins_every_sample_and_none_against_itself() -> None:
    found = structure(wall())
    labels = found.assembly.labels
    strong, weak = SampleBounds(found, labels & ~found.assembly.free_faces), SampleBounds(found, labels)
    better = compare(strong, weak, 300, 0, jobs=2)
    assert better.stronger > 0.9 * 300
    assert (better.weaker, better.stronger + better.undecided) == (0, 300)
    alike = compare(weak, weak, 40, 0)
    assert (alike.stronger, alike.weaker, alike.undecided) == (0, 0, 40)


def bonded() -> dict[str, Any]:
    document = grid_document(["aabb", "####"])
    document["materials"]["dry"] = {"friction_coefficient": vary(0.5), "cohesion": 2e3, "tensile_strength": 1e3}
    return document


def without_distribution() -> dict[str, Any]:
    return grid_document(["aabb", "####"])


def by_fields() -> dict[str, Any]:
    return wall() | {"cracks": {"kind": "fields"}}


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (bonded, "materials.dry.friction_coefficient: it acts on a bond"),
        (without_distribution, "no value of the scene has uncertainty"),
        (by_fields, "cracks: reliability supports cracks by faces only"),
    ],
)
def test_scenes_without_reliability_are_refused_in_one_line(scene: Any, said: str) -> None:
    parsed = parse_scene(scene())
    assembly = build_assembly(parsed)
    with pytest.raises(InputError, match=said):
        structure_of(parsed, assembly, assembly.labels)


def test_the_command_prints_the_keys_and_refuses_wrong_options(jld: Command, tmp_path: Path) -> None:
    path = saved(tmp_path / "block.json", block(vary(0.6), [vary(9500.0, 0.2), 0.0]))
    done = jld("reliability", path, "--json", "--samples", 500, "--jobs", 2)
    assert (done.code, done.err) == (0, "")
    told = json.loads(done.out)
    assert told["beta_form"] == pytest.approx(normal_index(9500.0), rel=1e-6)
    assert abs(told["beta_monte_carlo"] - told["beta_form"]) < 0.2
    assert told["samples"] == 500
    assert 0 < told["failures"] < 500
    assert sum(one**2 for one in told["importance"].values()) == pytest.approx(1.0)
    design = told["design_point"]
    assert design["materials.dry.friction_coefficient"] * WEIGHT == pytest.approx(design["loads.live[0].force[0]"])
    assert "design point" in jld("reliability", path, "--samples", 10).out
    for option, value in (("--required", "-1"), ("--against", "1"), ("--rank", "1")):
        jld("reliability", path, option, value).refused(option)


def test_a_search_ranks_its_best_layouts_by_reliability(
    jld: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, without_pictures: None
) -> None:
    monkeypatch.setattr("jld_practice.reliability_study.SAMPLES", 150)
    path, out = tmp_path / "wall.json", tmp_path / "out"
    document = grid_document(["ab", "cd", "##"], tension=4e3, shear=5e3, block_cells=[1, 2])
    document["materials"]["dry"] = {"friction_coefficient": vary(0.75, each=True)}
    document["loads"]["live"] = [{"body": vary([0.3, 0.0], 0.2)}]
    path.write_text(json.dumps(document))
    done = jld(
        "explore", path, "--out", out, "--objective", "reliability", "--reliability", 2, "--jobs", 1, "--json"
    ).done()
    told = json.loads(done.out)["reliability"]
    assert told["left_out"] == 0
    indices = [row["beta_monte_carlo"] for row in told["layouts"]]
    assert len(indices) == 2
    assert indices == sorted(indices, reverse=True)
    best = told["layouts"][0]
    assert told["best_labelling"] == best["labelling"]
    alone = jld("reliability", out, "--rank", best["row"], "--samples", best["samples"], "--json")
    assert json.loads(alone.out)["beta_monte_carlo"] == best["beta_monte_carlo"]
    against = jld("reliability", out, "--rank", 1, "--against", 1, "--samples", 20, "--json")
    assert json.loads(against.out)["against"]["undecided"] == 20


def test_a_search_without_distributions_is_refused_before_it_begins(jld: Command, tmp_path: Path) -> None:
    path, out = tmp_path / "wall.json", tmp_path / "out"
    path.write_text(json.dumps(grid_document(["ab", "##"])))
    done = jld("explore", path, "--out", out, "--objective", "reliability")
    assert (done.code, done.out, out.exists()) == (2, "", False)
    assert "no value of the scene has uncertainty" in done.err
    path.write_text(json.dumps(grid_document(["ab", "##"], live=[{"body": vary([1.0, 0.0])}])))
    done = jld("explore", path, "--out", out, "--objective", "zero-dilation", "--reliability", 2)
    assert (done.code, out.exists()) == (2, False)
    assert "--objective" in done.err
