"""Searches by fields beside the race: the exact driver against enumeration, resuming, fronts and required factors."""

from __future__ import annotations

import base64
import json
import shutil
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pandas as pd
import pytest

from cases import grid_document, replace_processes
from command import Command, saved
from jld_core import Deadline, InputError, Status, build_assembly, parse_scene, solve, solve_many
from jld_core.fields import bounds as field_bounds
from jld_core.fields import bounds_by_fields
from jld_core.limit import CaseBounds, governing
from jld_core.refinement import crack_cells
from jld_explore import Exploration, ExploreSettings, Interrupted, Progress, explore, read_folder, search_space
from jld_explore.drivers.field_exact import FieldExact
from jld_explore.drivers.field_proof import CommonMeshes, FieldRefuter
from jld_explore.evaluation import Pool, field_evaluator
from jld_explore.report import words
from jld_explore.space import from_string
from jld_explore.steps import step
from jld_views import page_of_study

FIELDS: dict[str, Any] = {"kind": "fields", "gap": 0.15}
WIDE: dict[str, Any] = {"kind": "fields", "gap": 0.3}


def document(**more: Any) -> dict[str, Any]:
    """A wall of 2 × 2 cells of 0.1 m, weak enough to crack, pushed aside."""
    return grid_document(["aa", "aa", "##"], tension=3e3, shear=3e3, block_cells=[1, 3]) | more


def searched(folder: Path, cracks: Any = FIELDS, scene: dict[str, Any] | None = None, **more: Any) -> Exploration:
    settings = ExploreSettings(**{"jobs": 1, "pictures": False, "small": 1000, **more})
    return explore(parse_scene((scene or document()) | {"cracks": cracks}), folder, settings)


@pytest.fixture(scope="module")
def proven(tmp_path_factory: pytest.TempPathFactory) -> Exploration:
    return searched(tmp_path_factory.mktemp("proven") / "out", driver="exact")


def test_the_proof_agrees_with_the_race_of_all(proven: Exploration, tmp_path: Path) -> None:
    """Both bracket the strongest layout, so that neither lower bound exceeds the other's bound."""
    raced = searched(tmp_path / "out")
    for one, other in ((proven, raced), (raced, proven)):
        assert one.summary.best <= other.summary.bound * (1 + 1e-9)
    assert proven.summary.stop_reason == "proven"
    assert proven.summary.facts["proof_check"]["passed"]
    assert proven.summary.facts["proof_check"]["conflicts"] == proven.summary.facts["proof_check"]["weighed"] > 0
    assert proven.summary.facts["race"]["decided"]
    assert proven.summary.gap <= FIELDS["gap"]
    both = raced.results.merge(proven.results, on="labelling", suffixes=("", "_exact"))
    assert len(both) > 5
    assert (both["bracket_lo"] <= both["bracket_hi_exact"] * (1 + 1e-9)).all()
    assert (both["bracket_lo_exact"] <= both["bracket_hi"] * (1 + 1e-9)).all()
    assert proven.results["bracket_hi"].max() <= proven.summary.bound * (1 + 1e-9)


def test_a_proof_does_not_depend_on_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same labellings are asked for, and the same bound is proven, whatever the number of jobs."""
    replace_processes(monkeypatch)
    scene = parse_scene(document())
    assembly = build_assembly(scene)
    space, told = search_space(scene, assembly), []
    for jobs in (1, 2):
        driver, evaluator, asked = FieldExact(space, gap=0.2, search=1), field_evaluator.FieldEvaluator(assembly), []
        driver.set_workers(jobs)
        driver.start(None, lambda: None)
        while len(labellings := driver.ask()):
            asked += labellings.tolist()
            driver.tell(labellings, evaluator.evaluate_all(labellings))
        assert driver.finished
        told.append((asked, driver.bound, driver.facts(pd.DataFrame(), False)["conflicts"]))
    assert told[0] == told[1]


def test_an_interrupted_proof_is_resumed(proven: Exploration, tmp_path: Path) -> None:
    """What was found before the interrupt is kept: evaluations, and conflicts with their velocity fields."""
    told: list[Progress] = []

    def stop(state: Progress) -> None:
        told.append(state)
        if len(told) > 1 and not np.isnan(state.bound):
            raise Interrupted

    settings = ExploreSettings(jobs=1, pictures=False, small=1000, driver="exact")
    scene = parse_scene(document() | {"cracks": FIELDS})
    with pytest.raises(Interrupted):
        explore(scene, tmp_path / "out", settings, stop)
    assert (tmp_path / "out" / "conflicts.npz").exists()
    done = searched(tmp_path / "out", driver="exact", resume=True)
    assert done.summary.facts["race"]["decided"]
    assert done.summary.best <= proven.summary.bound * (1 + 1e-9)
    assert done.summary.facts["proof_check"]["passed"]
    again = searched(tmp_path / "out", driver="exact", resume=True)
    assert again.summary.bound <= done.summary.bound * (1 + 1e-9)


def test_a_damaged_file_of_conflicts_is_named(proven: Exploration, tmp_path: Path) -> None:
    shutil.copytree(proven.folder, tmp_path / "out")
    path = tmp_path / "out" / "conflicts.npz"
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError, match=r"conflicts\.npz.*damaged"):
        searched(tmp_path / "out", driver="exact", resume=True)


def test_conflicts_on_disk_are_weighed_and_not_believed(proven: Exploration, tmp_path: Path) -> None:
    """A velocity field that was scaled down in one triangle proves less, or nothing; it never proves more."""
    shutil.copytree(proven.folder, tmp_path / "out")
    path = tmp_path / "out" / "conflicts.npz"
    with np.load(path) as file:
        content = {name: file[name] for name in file.files}
    content["velocity"][::7] *= 0.5
    np.savez(path, **content)
    done = searched(tmp_path / "out", driver="exact", resume=True)
    assert done.summary.facts["proof_check"]["passed"]
    assert done.summary.bound >= proven.summary.best * (1 - 1e-9)


def test_a_race_is_resumed(tmp_path: Path) -> None:
    """A race that time ended goes on from the bounds on record, and ends where one in one piece does."""
    searched(tmp_path / "out", WIDE, seconds=0.0, driver="enumeration")
    done = searched(tmp_path / "out", WIDE, resume=True, driver="enumeration")
    whole = searched(tmp_path / "whole", WIDE, driver="enumeration")
    assert (tmp_path / "out" / "refined.npz").exists()
    assert done.summary.facts["race"]["decided"]
    assert done.summary.best <= whole.summary.bound * (1 + 1e-9)
    assert len(done.results) == len(whole.results)


def test_load_cases_are_proven_by_the_governing_factor(tmp_path: Path) -> None:
    """The proof and the race of a small wall that is pushed either way, one way twice as hard."""
    there, back = ({"name": name, "live": [{"body": [push, 0]}]} for name, push in (("there", 1), ("back", -1)))
    scene = document(loads={"cases": [there | {"required": 2.0}, back]})
    raced, done = (searched(tmp_path / driver, WIDE, scene=scene, driver=driver) for driver in ("enumeration", "exact"))
    single = searched(tmp_path / "single", WIDE, driver="exact")
    for one, other in ((raced, done), (done, raced)):
        assert one.summary.best <= other.summary.bound * (1 + 1e-9)
    assert done.summary.facts["proof_check"]["passed"]
    # the wall is symmetric, so that the case that is asked for twice governs
    assert 2.0 * done.summary.best <= single.summary.bound * (1 + 1e-9)
    assert single.summary.best <= 2.0 * done.summary.bound * (1 + 1e-9)


@pytest.mark.long
def test_a_required_factor_counts_by_the_lower_bound(tmp_path: Path) -> None:
    """Layouts meet what their lower bound reaches; the best count among them is the least of all that meet it."""
    plain = searched(tmp_path / "plain", WIDE)
    middle, found = float(plain.results["bracket_lo"].median()), []
    required = document(search={"block_cells": [1, 3], "require": {"load_factor": middle}})
    for driver in ("enumeration", "genetic", "exact"):
        done = searched(tmp_path / driver, WIDE, scene=required, driver=driver, budget=None)
        table, facts = done.results, done.summary.facts["require"]
        assert (table["meets"] == (table["bracket_lo"] >= middle * (1 - 1e-6))).all()
        assert facts["met"] == int(table["meets"].sum()) > 0
        counts = table[table["meets"]][facts["count"]]
        assert facts["best"] == (counts.min() if facts["sense"] == "min" else counts.max())
        assert facts["proven"]
        found.append(facts["best"])
    assert len(set(found)) == 1
    assert done.summary.facts["proof_check"]["passed"]
    assert done.summary.facts["count_bound"] == found[0]


def test_no_layout_carries_more_than_all_are_bounded_by(tmp_path: Path) -> None:
    """A required factor beyond the bound on all layouts: proven at once that none carries it, by its conflicts."""
    required = document(search={"block_cells": [1, 3], "require": {"load_factor": 50.0}})
    done = searched(tmp_path / "out", WIDE, scene=required, driver="exact")
    assert done.summary.facts["require"]["proven"]
    assert done.summary.facts["require"]["best"] is None
    assert done.summary.facts["count_bound"] is None
    assert done.summary.facts["proof_check"]["passed"]


def test_the_proven_front_agrees_with_the_race_of_all(tmp_path: Path) -> None:
    """Each count is bracketed as by all its layouts, and counts on the front to the gap."""
    for sense in ("max", "min"):
        scene = document(search={"block_cells": [1, 3], "front": {"count": "dry_faces", "sense": sense}})
        raced = searched(tmp_path / f"all-{sense}", WIDE, scene=scene, driver="enumeration")
        done = searched(tmp_path / sense, WIDE, scene=scene, driver="exact", options={"aim": "front"})
        assert done.summary.stop_reason == "proven"
        assert done.summary.facts["proof_check"]["passed"]
        rows = {row["count"]: row for row in done.summary.facts["best_by_count"]}
        assert set(rows) == set(raced.results["dry_faces"])
        best = -np.inf
        for count in sorted(rows, reverse=sense == "max"):
            own = raced.results[raced.results["dry_faces"] == count]
            row = rows[count]
            assert row["bound"] >= own["bracket_lo"].max() * (1 - 1e-9)
            if row["load_factor"] is not None:
                best = max(best, row["load_factor"])
                assert row["load_factor"] <= own["bracket_hi"].max() * (1 + 1e-9)
            assert row["proven"]
            assert row["bound"] <= best / (1 - WIDE["gap"]) * (1 + 1e-9)


def test_a_front_is_refined_for_every_count(tmp_path: Path) -> None:
    done = searched(tmp_path / "out", WIDE, driver="genetic", options={"aim": "front"}, seed=3, budget=12)
    table = done.results
    for count in sorted(set(table["dry_faces"])):
        rivals = table[table["dry_faces"] <= count]
        low = rivals["bracket_lo"].max()
        own = table[table["dry_faces"] == count]["bracket_hi"].max()
        assert own <= low / (1 - WIDE["gap"]) * (1 + 1e-9) or np.isnan(low)


def test_a_target_that_time_leaves_open_is_not_proven() -> None:
    """Layouts given up for lack of time: other counts are bounded nevertheless, and the proof has not ended."""
    scene = parse_scene(document())
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    driver, evaluator = FieldExact(space, aim="front", gap=0.1, search=1), field_evaluator.FieldEvaluator(assembly)
    driver.start(None, lambda: None)
    driver.pool.deadline = Deadline(0.0)  # no mesh of a single layout is begun
    while len(labellings := driver.ask()):
        driver.tell(labellings, evaluator.evaluate_all(labellings))
    assert driver.pool.late
    assert driver.working
    assert not driver.finished
    rows = driver.facts(pd.DataFrame(), False)["front"]
    assert len(rows) == 3
    assert all(row["load_factor"] <= row["bound"] <= driver.bound for row in rows)
    assert not all(row["proven"] for row in rows)


def test_low_values_are_searched(tmp_path: Path) -> None:
    """λ is that of the scene with low strengths; the best has its bound at nominal values beside."""
    scene = document()
    scene["materials"]["inner"]["tensile_strength"] = {"nominal": 4e3, "low": 3e3}
    done = searched(tmp_path / "low", WIDE, scene=scene, robust=True, driver="enumeration")
    plain = searched(tmp_path / "plain", WIDE, driver="enumeration")
    assert done.summary.best == pytest.approx(plain.summary.best, rel=1e-9)
    assert done.summary.facts["best_nominal"] >= done.summary.best * (1 - 1e-9)


def test_partial_bounds_enclose_those_of_every_labelling() -> None:
    """Undecided faces: the bound of a partial labelling is no less than the lower bound of any that completes it."""
    rng = np.random.default_rng(5)
    for more in ({}, {"cohesion": 500.0}, {"crush_dry": 2e4}, {"inner_friction": 0.5, "crush_inner": 4e4}):
        scene = parse_scene(grid_document(["aa", "aa", "##"], tension=3e3, shear=3e3, block_cells=[1, 4], **more))
        assembly = build_assembly(scene)
        space = search_space(scene, assembly)
        setting = field_bounds.FieldSetting.of(assembly)
        partial, coarse = (
            field_bounds.PartialUpperBound(setting.problem(setting.coarse)),
            field_bounds.CoarseBounds(setting),
        )
        labels = rng.random(len(space.fixed)) < 0.5
        labels[~space.candidates] = space.fixed[~space.candidates]
        undecided = space.candidates & (rng.random(len(labels)) < 0.5)
        found = partial.field(labels, undecided)
        whole = partial.field(labels, np.zeros_like(undecided))
        # a whole labelling has the bound that the other route gives
        assert whole.bound == pytest.approx(coarse.upper(labels)[0], rel=2e-3)
        assert found.bound >= whole.bound * (1 - 2e-3)
        assert partial.weigh(found.velocity).bound_of(labels, undecided) == found.bound
        for _ in range(4):
            other = np.where(undecided, rng.random(len(labels)) < 0.5, labels)
            assert coarse.lower(other)[0] <= found.bound * (1 + 1e-9)
            assert found.mechanism.bounds(other[None])[0] <= found.bound * (1 + 1e-12)
            # the rise by one more undecided face is what was said
            face = int(rng.choice(np.flatnonzero(space.candidates & ~undecided)))
            more_open = undecided | (np.arange(len(labels)) == face)
            rise = found.mechanism.bound_of(labels, more_open) - found.bound
            assert rise == pytest.approx(found.mechanism.costs(labels)[face], abs=1e-9 * abs(found.bound)) or np.isinf(
                rise
            )


def test_bounds_on_all_layouts_fall_as_meshes_adapt() -> None:
    """Every mesh holds the fields of the one before: bounds fall, and stay above what a layout carries."""
    scene = parse_scene(document())
    assembly = build_assembly(scene)
    space, setting = search_space(scene, assembly), field_bounds.FieldSetting.of(assembly)
    meshes = CommonMeshes(setting, 1.0, space.fixed, space.candidates)
    bounds, sizes = [], []
    while not meshes.ended and len(bounds) < 6:
        found = meshes.step()
        bounds.append(found.bound)
        sizes.append(len(found.mesh))
        # the sum over triangles and faces is that of the mechanism, by another route
        assert found.found.mechanism.bound_of(space.fixed, space.candidates) == pytest.approx(found.bound, rel=1e-12)
    assert (np.diff(bounds) <= 1e-6 * bounds[0]).all()
    assert bounds[-1] < 0.98 * bounds[0]
    assert (np.diff(sizes) > 0).all()
    carried = field_bounds.CoarseBounds(setting).lower(space.fixed & ~space.candidates)[0]
    assert bounds[-1] >= carried * (1 - 1e-9)
    assert [len(meshes.meshes[place]) for place in meshes.shared] == sorted(
        len(meshes.meshes[place]) for place in meshes.shared
    )


def test_conflicts_of_finer_meshes_hold_for_all_layouts_that_have_them() -> None:
    """Layouts with the labels of a conflict, and their mirror images, carry no more than its bound, weighed anew."""
    scene = parse_scene(document())
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    refuter, tasks = FieldRefuter(space, None), Pool(1)
    meshes = refuter.common(0)
    threshold = 0.9 * [meshes.step() for _ in range(6)][-1].bound
    refuter.refute_on([meshes])
    rng = np.random.default_rng(2)
    drawn = [np.where(space.candidates, rng.random(len(space.fixed)) < 0.6, space.fixed) for _ in range(4)]
    found = [one for one in refuter.refute(drawn, threshold, tasks) if one is not None]
    assert len(found) > 1
    coarse = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly))
    for conflict in found:
        assert refuter.weigh(conflict) <= conflict.bound * (1 + 1e-12) <= threshold * (1 + 1e-12)
        other = np.where(space.candidates, rng.random(len(space.fixed)) < 0.5, space.fixed)
        other[conflict.faces] = conflict.labels
        for image in other[space.group]:
            assert (image[space.group][:, conflict.faces] == conflict.labels).all(axis=1).any()
            assert coarse.lower(image)[0] <= conflict.bound * (1 + 1e-9)


def test_an_undecided_joint_bears_what_the_better_label_bears() -> None:
    """Two cells lifted at the upper one: a dry joint leaves one weight to lift, an inner one both; undecided, both."""
    lift = [{"element": "c0r0", "force": [0, 1]}]
    scene = parse_scene(grid_document(["a", "a", "#"], tension=1e7, shear=1e7, live=lift, block_cells=[1, 2]))
    assembly = build_assembly(scene)
    space, setting = search_space(scene, assembly), field_bounds.FieldSetting.of(assembly)
    partial = field_bounds.PartialUpperBound(setting.problem(setting.coarse))
    weight, none = 1400.0 * 9.81 * 0.1**3, np.zeros_like(space.candidates)
    for labels, undecided, cells in (
        (space.fixed | space.candidates, none, 1.0),
        (space.fixed & ~space.candidates, none, 2.0),
        (space.fixed, space.candidates, 2.0),
    ):
        found = partial.field(labels, undecided)
        assert found.bound == pytest.approx(cells * weight, rel=1e-5)


def test_a_wall_slides_on_its_support_whatever_its_labels() -> None:
    """Strong cells under a horizontal body load: μ bounds all labellings, by one mechanism."""
    scene = parse_scene(grid_document(["aa", "##"], tension=1e6, shear=1e6, friction=0.6, block_cells=[1, 2]))
    assembly = build_assembly(scene)
    space, setting = search_space(scene, assembly), field_bounds.FieldSetting.of(assembly)
    found = field_bounds.PartialUpperBound(setting.problem(setting.coarse)).field(space.fixed, space.candidates)
    assert found.bound == pytest.approx(0.6, rel=1e-6)


def test_a_task_whose_process_died_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    class Dying(ThreadPoolExecutor):
        def submit(self, work: Any, *task: Any) -> Any:
            future: Future[Any] = Future()
            future.set_exception(TimeoutError())
            return future

    replace_processes(monkeypatch, Dying)
    pool = Pool(2)
    assert list(pool.run(divmod, [(7, 2), (9, 4)])) == [(3, 1), (2, 1)]
    replace_processes(monkeypatch)
    with pytest.raises(ZeroDivisionError):
        list(pool.run(divmod, [(7, 0), (9, 4)]))
    pool.close()


def test_a_structure_that_falls_has_a_bound_below_zero() -> None:
    """Blocks too weak for their own weight: one mechanism proves it for every labelling."""
    scene = parse_scene(grid_document(["aa"] * 5 + ["##"], tension=100.0, shear=100.0, block_cells=[1, 3]))
    assembly = build_assembly(scene)
    space, setting = search_space(scene, assembly), field_bounds.FieldSetting.of(assembly)
    found = field_bounds.PartialUpperBound(setting.problem(setting.coarse)).field(space.fixed, space.candidates)
    assert found.bound < 0.0


def test_labellings_evaluated_together_have_the_bounds_of_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Groups grow to what fits in their time; time that is up ends between groups."""
    assembly = build_assembly(parse_scene(document()))
    labellings = np.random.default_rng(4).random((9, len(assembly.labels))) < 0.5
    alone = [field_evaluator.FieldEvaluator(assembly).evaluate(labels) for labels in labellings]
    evaluator, sizes = field_evaluator.FieldEvaluator(assembly), list[int]()
    together = field_bounds.CoarseBounds.both

    def watched(self: field_bounds.CoarseBounds, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sizes.append(len(some))
        return together(self, some)

    monkeypatch.setattr(field_bounds.CoarseBounds, "both", watched)
    monkeypatch.setattr(field_evaluator, "_SECONDS", 1e9)
    found = evaluator.evaluate_all(labellings)
    assert sizes == [1, 2, 4, 2]
    assert [one.status for one in found] == [one.status for one in alone]
    bounds, expected = (np.array([(one.low, one.high) for one in some]) for some in (found, alone))
    assert np.array_equal(bounds, expected, equal_nan=True)
    monkeypatch.setattr(field_evaluator, "_SECONDS", 0.0)
    sizes.clear()
    evaluator.evaluate_all(labellings)
    evaluator.evaluate_all(labellings)
    assert sizes == [9, 8, 1]
    assert evaluator.evaluate_all(labellings, deadline=Deadline(0.0)) == []


# Searches with cracks by fields and by cells: the race against bounds of each layout, cells against refined scenes.


PUSHED: list[dict[str, Any]] = [{"element": "c1r0", "force": [0, -1], "at": [0.15, 0.3]}]
FIELDS_OF_CRACKS: dict[str, Any] = {"kind": "fields", "gap": 0.25}


def document_of_cracks(**more: Any) -> dict[str, Any]:
    """Six cells on two bearings under a force: 38 layouts."""
    return grid_document(["aaa", "aaa", "#.#"], live=PUSHED, tension=2e6, shear=2e5, block_cells=[1, 4]) | more


def searched_of_cracks(folder: Path, cracks: Any, **more: Any) -> Exploration:
    settings = ExploreSettings(**{"jobs": 1, "pictures": False, "small": 100, **more})
    return explore(parse_scene(document_of_cracks(cracks=cracks)), folder, settings)


@pytest.fixture(scope="module")
def raced(tmp_path_factory: pytest.TempPathFactory) -> Exploration:
    return searched_of_cracks(tmp_path_factory.mktemp("raced") / "out", FIELDS_OF_CRACKS)


def test_the_race_is_right(raced: Exploration) -> None:
    """Every bracket of the table agrees with the bounds of the layout alone, and none is stronger than said."""
    table, summary = raced.results, raced.summary.facts
    assert summary["cracks"] == FIELDS_OF_CRACKS
    assert summary["race"]["decided"]
    assert summary["gap"] <= 0.25
    assert len(table) == summary["evaluated"] == 38
    best = table["bracket_lo"].max()
    assert summary["best"] == best == table["load_factor"][0]
    assert summary["bound"] == pytest.approx(table["bracket_hi"].max(), rel=1e-12)
    assert (table["load_factor"].dropna() == table["bracket_lo"][table["load_factor"].notna()]).all()
    ranked = table[table["rank"].notna()]
    # shared is the first rank by all that nothing is proven to be stronger than
    assert ((ranked["rank"] == 1) == (ranked["bracket_hi"] >= best)).all()
    some = table.iloc[[0, 1, *range(2, len(table), 6)]]
    for text, low, high in zip(some["labelling"], some["bracket_lo"], some["bracket_hi"], strict=True):
        alone = bounds_by_fields(raced.assembly, from_string(str(text)), gap=1e-9, most=1)
        assert np.isnan(low) or low <= alone.upper * (1 + 1e-9)
        if np.isfinite(alone.lower):
            assert alone.lower <= high * (1 + 1e-9)
            assert alone.lower <= summary["bound"] * (1 + 1e-9)
    # the front is that of the lower ends, with the best on it
    front = raced.front.sort_values("load_factor", ascending=False)
    assert front["load_factor"].iloc[0] == best
    assert front["dry_faces"].is_monotonic_increasing
    pruned = table[table["settled"] == "bound"]
    assert len(pruned) > 10
    assert (pruned["bracket_hi"] < best).all()


def test_summary_text_of_a_race(raced: Exploration) -> None:
    facts = words.facts_of_exploration(read_folder(raced.folder))
    assert "by fields" in facts["cracks"]
    assert "proven to within" in facts["best λ"]
    assert "discretisation" in facts["next"] or raced.summary.proven


def test_jobs_do_not_matter(raced: Exploration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace_processes(monkeypatch)
    other = searched_of_cracks(tmp_path / "out", FIELDS_OF_CRACKS, jobs=2)
    columns = [name for name in raced.results.columns if name != "seconds"]
    pd.testing.assert_frame_equal(raced.results[columns], other.results[columns])


def test_data_for_processes_can_be_pickled(raced: Exploration) -> None:
    setting = field_bounds.FieldSetting.of(raced.assembly)
    again = cloudpickle.loads(cloudpickle.dumps(setting))
    labels = from_string(str(raced.results["labelling"][0]))
    bounds = [field_bounds.Fields.on(one, one.coarse, labels).bounds for one in (setting, again)]
    assert bounds[0] == bounds[1]


def test_no_time_leaves_one_layout(tmp_path: Path) -> None:
    done = searched_of_cracks(tmp_path / "out", FIELDS_OF_CRACKS, seconds=0.0, driver="enumeration")
    assert done.summary.stop_reason == "time"
    assert done.summary.best is not None
    assert not done.summary.proven
    assert "of the search" in done.summary.next


def test_no_mesh_is_begun_that_would_be_late(raced: Exploration) -> None:
    """Where every mesh would take longer than what is left, bounds of the coarsest mesh remain, with any jobs."""
    labellings = np.array([from_string(str(text)) for text in raced.results["labelling"][:4]])
    pool = field_evaluator.FieldPool(raced.assembly, labellings, Deadline(60.0), jobs=2)
    pool.rate = 1e9
    found = field_evaluator.FieldRace(pool, 1e-3).run()
    assert found.refined == 0
    assert found.gap > 0.01
    assert np.isfinite(pool.low()).all()


def test_load_cases_race_by_the_governing_factor() -> None:
    """The race under two cases against the least over cases of bounds of each alone."""
    down = {"name": "down", "live": PUSHED, "required": 2.0}
    aside = {"name": "aside", "live": [{"body": [0.5, -1]}]}
    scene = parse_scene(document_of_cracks(loads={"cases": [down, aside]}))
    assembly = build_assembly(scene)
    rng = np.random.default_rng(1)
    labellings = rng.random((6, len(assembly.interfaces))) < 0.4
    pool = field_evaluator.FieldPool(assembly, labellings)
    field_evaluator.FieldRace(pool, 0.2).run()
    low, high = pool.low(), pool.high()
    assert (low <= high * (1 + 1e-9)).all()
    for row, labels in enumerate(labellings):
        alone = [bounds_by_fields(one, labels, gap=1e-9, most=1) for one in assembly.by_case]
        least = min(one.lower / factor for one, factor in zip(alone, assembly.required, strict=True))
        most = min(one.upper / factor for one, factor in zip(alone, assembly.required, strict=True))
        assert least <= high[row] * (1 + 1e-9)
        assert low[row] <= most * (1 + 1e-9)
    found = field_evaluator.field_evaluation(np.array([4.0, 3.0]), np.array([6.0, 3.5]), np.array([2.0, 1.0]))
    assert (found.low, found.high, found.governing) == (2.0, 3.0, 0)
    assert found.cases == (4.0, 3.0)


def test_other_drivers_race_the_best_of_what_they_found(tmp_path: Path) -> None:
    """Brackets are no wider than those of the coarsest mesh, agree with them, and the best is refined to the gap."""
    done = searched_of_cracks(tmp_path / "out", FIELDS_OF_CRACKS, driver="random", budget=4)
    ranked = done.results[done.results["rank"].notna()]
    assert len(ranked)
    for row in ranked.itertuples():
        alone = bounds_by_fields(done.assembly, from_string(str(row.labelling)), gap=1e-9, most=1)
        assert row.bracket_lo >= alone.lower * (1 - 1e-9)
        assert row.bracket_hi <= alone.upper * (1 + 1e-9)
        assert row.load_factor == row.bracket_lo
    best, rivals = ranked["bracket_lo"].max(), ranked["bracket_hi"].max()
    assert (rivals - best) / rivals <= FIELDS_OF_CRACKS["gap"]
    assert done.summary.bound is None
    assert "exact" in done.summary.next


@pytest.mark.parametrize("driver", ["enumeration", "genetic"])
def test_searches_by_cells(driver: str, tmp_path: Path) -> None:
    """λ of each layout is that of the finer scene with the same labels on the pieces."""
    cracks = {"kind": "cells", "cell": 0.05}
    done = searched_of_cracks(tmp_path / "out", cracks, driver=driver, budget=None if driver == "enumeration" else 12)
    cells = crack_cells(done.scene, done.assembly, 0.05)
    for row in done.results.head(5).itertuples():
        alone = solve(cells.fine, cells.labels(from_string(str(row.labelling))))
        assert row.load_factor == pytest.approx(alone.load_factor, rel=1e-6)
    assert done.summary.facts["cracks"] == cracks
    assert done.result(1).load_factor == pytest.approx(done.results["load_factor"][0], rel=1e-6)


def test_a_candidate_of_one_face_changes_nothing(tmp_path: Path) -> None:
    """Cells as large as those of the joint grid: the table of a search by faces, bit for bit."""
    cells = searched_of_cracks(tmp_path / "cells", {"kind": "cells", "cell": 0.1})
    faces = searched_of_cracks(tmp_path / "faces", "faces", check_fields=0)
    columns = [name for name in faces.results.columns if name != "seconds"]
    pd.testing.assert_frame_equal(cells.results[columns], faces.results[columns], check_exact=True)


def test_options_for_cracks_by_faces_alone_are_refused(tmp_path: Path) -> None:
    cells = {"kind": "cells", "cell": 0.05}
    for cracks, more in (
        (cells, {"driver": "exact"}),
        (FIELDS_OF_CRACKS, {"experiment": 1}),
        (FIELDS_OF_CRACKS, {"certificate": tmp_path / "proof.jldcert"}),
    ):
        with pytest.raises(InputError) as refused:
            searched_of_cracks(tmp_path / "out", cracks, **more)
        assert "\n" not in str(refused.value)
        assert refused.value.parameter in {*more, "aim"}
    assert not (tmp_path / "proof.jldcert").exists()
    assert not (tmp_path / "out").exists()


def test_the_command_line_searches_by_fields(jld: Command, tmp_path: Path) -> None:
    path = saved(tmp_path / "scene.json", document_of_cracks())
    told = jld("explore", path, "--out", tmp_path / "out", "--cracks", "fields:0.4", "--jobs", "1", "--json").done()
    assert json.loads(told.out)["cracks"] == {"kind": "fields", "gap": 0.4}
    # the folder remembers its crack model
    rank = json.loads(jld("solve", tmp_path / "out", "--rank", "1", "--json").out)
    assert rank["cracks"]["kind"] == "fields"
    assert (tmp_path / "out" / "best.png").exists()
    assert jld("plot", tmp_path / "out", "--rank", "1").code == 0
    assert (tmp_path / "out" / "layouts_1.png").stat().st_size > 10_000
    jld("plot", tmp_path / "out", "--format", "gif").refused("rigid elements")
    # the page shows the picture of the best layout
    data = page_of_study.study_data(read_folder(tmp_path / "out"))
    assert [base64.b64decode(one["png"]) for one in data["pictures"]] == [(tmp_path / "out" / "best.png").read_bytes()]
    assert len((tmp_path / "out" / "report.html").read_text(encoding="utf-8")) > len(data["pictures"][0]["png"])


# Load cases by fields: a table names the case that governs, as `solve` does, and keeps what is known of the others.


SCENE: dict[str, Any] = {
    "grid": {"cell": [1.0, 1.0], "thickness": 0.5, "rows": ["abc", "#.#"]},
    "materials": {
        "density": 2000,
        "dry": {"friction_coefficient": 0.6},
        "inner": {"tensile_strength": 2e5, "shear_strength": 3e5, "friction_coefficient": 0.5},
    },
    "loads": {
        "cases": [
            {"name": "down", "live": [{"element": "c1r0", "force": [0, -1e4], "at": [1.5, 2.0]}]},
            {"name": "side", "live": [{"body": [1, 0]}], "required": 0.5},
        ]
    },
    "cracks": {"kind": "fields", "gap": 0.9},
}


@pytest.mark.sampled(2)
@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("driver", ["random", "enumeration"])
def test_searches_by_fields_name_the_case_that_governs(driver: str, back: bool) -> None:
    cases = SCENE["loads"]["cases"]
    document = {**SCENE, "loads": {"cases": cases[::-1] if back else cases}}
    assembly = build_assembly(parse_scene(document))
    best = explore(document, driver=driver, seconds=20, budget=3).results.iloc[0]
    labels = np.array([letter == "d" for letter in best["labelling"]])
    assert best["governing"] == "side"
    # beside a weak bound of the case that governs stands the first one of the other
    assert best["load_factor[down]"] > 2.0 * best["load_factor[side]"]
    alone = solve(document, labels)
    assert alone.governing == "side"
    assert solve_many(assembly, [labels]).governing == ("side",)


@pytest.mark.parametrize("back", [False, True])
def test_a_wide_bracket_does_not_govern_before_a_lower_one(back: bool) -> None:
    """What is known to be at most 1.2 governs before what is between 1.1 and 47."""
    cases = [CaseBounds(Status.COLLAPSE, 1.1, 47.0, 1.1), CaseBounds(Status.COLLAPSE, 1.1, 1.2, 1.1)]
    found = governing(cases[::-1] if back else cases, [1.0, 1.0])
    assert (found.low, found.high, found.case) == (1.1, 1.2, 0 if back else 1)


# The check by fields at the end of a search by faces: columns, findings, and what it leaves alone.


def checked_by_fields(folder: Path, **more: Any) -> Exploration:
    """Six cells on two bearings under a force, of which every layout is evaluated."""
    document = grid_document(["aaa", "aaa", "#.#"], live=PUSHED, tension=2e6, shear=2e5)
    settings = ExploreSettings(driver="enumeration", jobs=1, pictures=False, **more)
    return explore(parse_scene(document), folder, settings)


def test_the_best_are_bounded_by_fields(tmp_path: Path) -> None:
    done = checked_by_fields(tmp_path / "a", check_fields=3)
    table = pd.read_csv(tmp_path / "a" / "results.csv")
    known = table["fields_lo"].notna()
    assert known.tolist() == [True] * 3 + [False] * (len(table) - 3)
    for row in range(3):
        labels = from_string(str(table["labelling"][row]))
        alone = bounds_by_fields(done.assembly, labels, gap=1e-9, most=1)
        assert table["fields_lo"][row] == pytest.approx(alone.lower, rel=1e-9)
        assert table["fields_hi"][row] == pytest.approx(alone.upper, rel=1e-9)
    space = search_space(done.scene, done.assembly)
    whole = bounds_by_fields(done.assembly, space.fixed & ~space.candidates, gap=1e-9, most=1)
    assert done.summary.facts["fields"]["uncut"] == pytest.approx([whole.lower, whole.upper], rel=1e-9)
    facts = words.facts_of_exploration(read_folder(tmp_path / "a"))
    assert done.summary.facts["fields"]["findings"]
    assert facts["by fields"].endswith("--cracks fields --out DIR searches by fields")
    assert json.loads((tmp_path / "a" / "columns.json").read_text("utf-8"))["results.csv"]["fields_hi"]


def test_without_a_check_there_are_no_columns(tmp_path: Path) -> None:
    done = checked_by_fields(tmp_path / "a", check_fields=0)
    assert "fields_lo" not in done.results
    assert "fields" not in done.summary.facts


def test_a_time_limit_skips_the_check_by_fields_with_a_sentence(tmp_path: Path) -> None:
    done = checked_by_fields(tmp_path / "a", seconds=0.0)
    assert done.summary.facts["fields"]["skipped"]
    assert done.results["fields_lo"].isna().all()
    assert "not checked" in words.facts_of_exploration(done)["by fields"]


def test_large_scenes_are_checked_less() -> None:
    """The expected time decides before anything is solved, so that a table does not depend on the machine."""
    counts = []
    for columns in (3, 12, 40):
        scene = parse_scene(grid_document(["a" * columns] * 8 + ["#" * columns]))
        assembly = build_assembly(scene)
        plan = step.plan_check(scene, assembly, search_space(scene, assembly), ExploreSettings())
        counts.append(plan.count)
        assert plan.seconds <= 2.0
    assert counts[0] == 10 > counts[1] > counts[2] == 0
    assert "1280 triangles" in plan.skipped


def test_scenes_beyond_fields_are_left_alone() -> None:
    document = grid_document(["aaa", "aaa", "###"])
    for change in ({"cracks": {"kind": "cells", "cell": 0.05}}, {"search": {"void": {"cells": ["c0r0"]}}}):
        scene = parse_scene({**document, **change})
        assembly = build_assembly(scene)
        assert step.plan_check(scene, assembly, search_space(scene, assembly), ExploreSettings()) is None


def test_findings() -> None:
    """Said is what the bounds prove: a fall of more than 5 %, another order, and that no cut is better."""
    values, low, high = np.array([10.0, 9.0, 8.0]), np.array([9.0, 8.0, 7.0]), np.array([9.8, 8.9, 8.0])
    assert step._findings(values, low, high, (8.0, 12.0)) == []
    fallen = step._findings(values, low, np.array([9.2, 8.9, 5.0]), None)
    assert fallen == [
        "the blocks of the best carry at most 9.2, 8% less than by faces, and 1 more of the best 3 fall by over 5%"
    ]
    falling = step._findings(values, low, np.array([-73.48, 8.9, -5.0]), None)
    assert (
        falling[0] == "wherever its blocks crack, the best falls under its own weight, and so do 1 more of the best 3"
    )
    later = step._findings(values, low, np.array([9.8, 8.9, 5.0]), None)
    assert later == ["1 of the best 3 carry over 5% less than by faces"]
    order = step._findings(values, np.array([9.0, 8.0, 9.9]), np.array([9.8, 8.9, 10.0]), None)
    assert order == ["row 3 carries at least 9.9, more than the best can"]
    assert step._findings(values, low, high, (9.9, 12.0)) == [
        "without cuts it carries at least 9.9, more than any of the best 3"
    ]


def test_time_of_a_mesh_follows_from_that_of_another() -> None:
    """The measured times of a wall of 12 × 9 cells, 432 and 3 315 triangles, on the safe side by less than twice."""
    expected = field_evaluator.mesh_seconds(field_evaluator.time_rate(0.42, 432), 3315)
    assert 5.3 < expected < 2.0 * 5.3
    assert field_evaluator.mesh_seconds(field_evaluator.COARSE_RATE, 60) == pytest.approx(0.024)
