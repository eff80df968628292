"""What the studies around the experiment rest on; the studies themselves take minutes and leave their tables."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import brittle_front, cracking_units, distinct_elements, leonardo_section_3_3, non_planar_faces
from studies.report import SCENES
from studies.scenes import stacked_cubes

from cases import dry_and_inner
from command import SCENES as SCENES_of_command
from command import Command, saved
from jld_core import Scene, build_assembly, load_scene, parse_scene, solve
from jld_experiment import experiments as module
from jld_explore import ExploreSettings, explore

STRONGEST = "iiidididddddiididdidiiid"
"""The proven best layout of the beam-arch by λ."""


def test_the_layout_that_gives_the_published_load_factor() -> None:
    """Iannuzzo et al. 2024, section 3.3: 2153 N with dilation; 1312 N is among its answers without."""
    assembly = build_assembly(leonardo_section_3_3.found())
    span = solve(assembly, friction="zero-dilation", range=True, floor_seconds=0.0)
    assert span.facts["associative_load_factor"] == pytest.approx(2152.85, abs=0.01)
    assert span.facts["lowest_found"] < 1312.0 < span.facts["highest_found"]


def test_bricks_that_crack() -> None:
    """λ grows with the strength of the brick up to that of rigid bricks, and no strength betters it."""
    size = {"courses": 4, "length": 2}
    rigid = solve(cracking_units.wall(1.0, rigid=True, **size)).load_factor
    found = [solve(cracking_units.wall(strength, **size)).load_factor for strength in (0.5, 1.0, 3.0, 30.0)]
    assert (np.diff(found) > -1e-9).all()
    assert found[0] < 0.8 * rigid
    assert found[-1] == pytest.approx(rigid, rel=1e-6)


@pytest.mark.long
def test_abeilles_vault_punches_through_its_cracks() -> None:
    """Rigid blocks in a fixed frame are locked. Crackable ones give way by shear of eight half middle planes: with
    every 1e5 Pa λ grows by the same, no more than τ times their area."""
    assert str(solve(non_planar_faces.abeille(3, None)).status) == "locked"
    one, two, three = (solve(non_planar_faces.abeille(3, k * 1e5)).load_factor for k in (1, 2, 3))
    # each λ is certified to 1e-6 of itself, which is 3e-6 of a step
    assert three - two == pytest.approx(two - one, rel=1e-5)
    area = 8 * non_planar_faces.CELL * non_planar_faces.DEPTH
    assert two - one == pytest.approx(1e5 * area, rel=1e-5)


@pytest.mark.parametrize("facets", [1, 3])
def test_osteomorphic_blocks(facets: int) -> None:
    """Waves lift a block that slides: λ above friction, and below straight sliding up the steepest facet."""
    rigid = solve(non_planar_faces.osteomorphic(facets, None, saddle=False)).load_factor
    assert non_planar_faces.FRICTION < rigid <= non_planar_faces.steepest(facets) * (1.0 + 1e-9)
    saddle = solve(non_planar_faces.osteomorphic(facets, None)).load_factor
    assert solve(non_planar_faces.osteomorphic(facets, non_planar_faces.WEAK)).load_factor < saddle


def test_layouts_below_what_was_carried_are_left_out() -> None:
    """The front by experiment goes from the largest λ down and stops where λ is below what was carried."""
    assembly = build_assembly(load_scene(SCENES / "flat_beam_arch.json"))
    rows = [(STRONGEST, 12, 12.6), (STRONGEST, 12, 5.0), (STRONGEST, 10, 5.0)]
    table = brittle_front.experiments(
        pd.DataFrame(rows, columns=["labelling", "dry_faces", "load_factor"]), assembly, 5
    )
    assert len(table) == 1
    assert 5.0 < table["experiment"].item() < 6.0
    assert not table["open"].item()
    assert brittle_front.front(table, "experiment")["dry_faces"].tolist() == [12]


def test_runs_of_the_study_go_on_where_they_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are written one by one; a second call makes the missing ones alone, in the same order."""
    monkeypatch.setattr(distinct_elements, "NUMERICS", {distinct_elements.DEFAULT: {"periods": 20.0}})
    monkeypatch.setattr(distinct_elements, "FIELD_SECONDS", 0.1)
    scene = stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0)
    assembly = build_assembly(scene)
    case = distinct_elements.Case("cubes", scene, assembly, (tuple(assembly.labels.tolist()),))
    monkeypatch.setattr(distinct_elements, "limit_analysis", lambda case, layout, kind: replace(_row(case), kind=kind))
    path = tmp_path / "runs.csv"
    assert distinct_elements.run_all(path, [case]) == 6
    whole = pd.read_csv(path, dtype=str)
    path.write_text("\n".join(path.read_text("utf-8").splitlines()[:4]) + "\n", "utf-8")
    assert distinct_elements.run_all(path, [case]) == 3
    again = pd.read_csv(path, dtype=str)
    assert again.drop(columns="seconds").equals(whole.drop(columns="seconds"))
    assert distinct_elements.run_all(path, [case]) == 0
    brittle = whole[whole["inner"] == "brittle"]
    # Five points have I/l² = 3/32: the face cracks at λ = (1 + σt) 3/8, and both cubes rock on at the base at 1/2.
    assert brittle["first_crack"].astype(float).to_numpy() == pytest.approx(0.45, rel=0.03)
    assert brittle["load_factor"].astype(float).to_numpy() == pytest.approx(0.5, rel=0.01)
    assert (whole[whole["kind"] == "experiment"]["energy_error"].astype(float) < 1e-2).all()


def _row(case: distinct_elements.Case) -> distinct_elements.Row:
    return distinct_elements.started(case, 0, "cells", "", "plastic", "friction")


# `jld explore --experiment K` and `--objective experiment`: a column more, once each, and what bounds what.


DOCUMENT = {
    "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": ["aaaa", "aaaa", "#..#"]},
    "materials": {
        "density": 1400,
        "dry": {"friction_angle": 30},
        "inner": {"tensile_strength": 2e5, "shear_strength": 1e5},
    },
    "loads": {"live": [{"element": "c1r0", "force": [0, -100], "at": [0.2, 0.3]}]},
    "search": {"block_cells": [2, 4]},
}


def scene() -> Scene:
    return parse_scene(DOCUMENT)


@pytest.mark.usefixtures("without_pictures")
def test_a_column_for_the_best(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    """K experiments, at most λ each; gone on with, none is run again and the column stays."""
    path = saved(tmp_path / "scene.json", DOCUMENT)
    out = tmp_path / "out"
    options = ("--experiment", "3", "--jobs", "1", "--json")
    done = jld("explore", path, "--out", out, *options).done()
    table = pd.read_csv(out / "results.csv", dtype={"labelling": str})
    assert table["experiment"].notna().tolist() == [True] * 3 + [False] * (len(table) - 3)
    best = table.head(3)
    assert (best["experiment"] <= best["load_factor_associative"] * (1.0 + 2e-3)).all()
    facts = json.loads(done.out)["experiment"]
    assert facts["runs"] == 3
    assert facts["best"] == pytest.approx(best["experiment"].max())
    kept = (out / "experiments.csv").read_bytes()

    def refuse(*_: object) -> None:
        raise AssertionError("run again")

    monkeypatch.setattr(module, "one_experiment", refuse)
    jld("explore", path, "--out", out, *options, "--resume").done()
    assert (out / "experiments.csv").read_bytes() == kept
    assert pd.read_csv(out / "results.csv", dtype={"labelling": str})["experiment"].notna().sum() == 3


@pytest.mark.long
def test_search_by_experiment(tmp_path: Path) -> None:
    """The genetic driver by experiments finds what experiments on all layouts whose λ is above it cannot better."""
    settings = ExploreSettings(by_experiment=True, experiment=30, pictures=False)
    found = explore(scene(), tmp_path / "search", settings)
    facts = found.summary.facts["experiment"]
    assert facts["searched"]
    assert 10 <= facts["runs"] <= 30
    every = explore(scene(), tmp_path / "all", ExploreSettings(experiment=10_000, pictures=False))
    assert every.summary.facts["experiment"]["none_better"]
    assert facts["best"] == pytest.approx(every.summary.facts["experiment"]["best"], rel=1e-9)
    carried = every.results[every.results["status"] == "collapse"]
    assert len(carried) > facts["runs"]


def test_a_claim_by_experiment_states_its_assumption(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """λ of untested layouts bounds them only by assumption; one tested layout above its λ ends the claim."""
    carried = {"share": 0.999}

    def made_up(_: object, name: str, load_factor: float) -> dict[str, object]:
        row = dict.fromkeys(module.COLUMNS, 0.0) | {"labelling": name, "load_factor": load_factor}
        return row | {"experiment": carried["share"] * load_factor, "status": "collapse", "stands": True}

    monkeypatch.setattr(module, "one_experiment", made_up)

    def facts(name: str, count: int) -> dict[str, object]:
        found = explore(scene(), tmp_path / name, ExploreSettings(experiment=count, pictures=False, check_fields=0))
        return found.summary.facts["experiment"]

    some = facts("some", 12)
    assert some["none_better"]
    assert some["none_better_assumes"] == module.ASSUMPTION
    assert some["most_over_load_factor"] == pytest.approx(0.999)
    carried["share"] = 1.02
    above = facts("above", 12)
    assert not above["none_better"]
    assert above["none_better_assumes"] is None
    # With all layouts tested, also those that do not stand by limit analysis, nothing is assumed.
    done = explore(scene(), tmp_path / "all", ExploreSettings(pictures=False, check_fields=0))
    tested = module.Experiments(done.assembly, tmp_path / "all")
    values = done.results["load_factor_associative"].fillna(0.0)
    tested.rows = {
        name: made_up(None, name, value) for name, value in zip(done.results["labelling"], values, strict=True)
    }
    every = module.with_experiments(done, tested, False).summary.facts["experiment"]
    assert every["none_better"]
    assert every["none_better_assumes"] is None


def test_nobody_is_experimented_on_after_time_is_up(tmp_path: Path) -> None:
    done = explore(scene(), tmp_path / "out", ExploreSettings(experiment=10_000, seconds=1e-9, pictures=False))
    assert done.summary.facts["experiment"]["runs"] == 0


# `jld experiment`: what it prints and writes, and what it refuses.


KEYS = {"collapse_load", "load_factor", "ratio", "stands", "rate_error", "status", "first_crack", "inner", "dilation"}


def scene_of_command(tmp_path: Path, rows: list[str], live: list[dict[str, object]]) -> Path:
    path = tmp_path / "scene.json"
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
        "materials": dry_and_inner(1400, 0.5, 2e4, 2e4),
        "loads": {"live": live},
    }
    path.write_text(json.dumps(document), "utf-8")
    return path


def test_an_experiment_writes_its_folder(tmp_path: Path, jld: Command) -> None:
    path = scene_of_command(tmp_path, ["aab", "acc", "###"], [{"body": [1, 0]}])
    out = tmp_path / "out"
    options = ("--inner", "plastic", "--dilation", "friction", "--out", out, "--json")
    found = json.loads(jld("experiment", path, *options).done().out)
    assert set(found) >= KEYS
    assert found["status"] == "collapse"
    assert found["stands"] is True
    assert found["ratio"] == pytest.approx(1.0, abs=5e-3)
    assert 0.0 <= found["rate_error"] <= 5e-3
    assert json.loads((out / "summary.json").read_text("utf-8")) == found
    table = pd.read_csv(out / "curve.csv")
    assert set(table["push"]) == {"slow", "fast"}
    assert table[table["push"] == "slow"]["load_factor"].max() >= found["collapse_load"] * (1.0 - 1e-9)
    assert (out / "experiment.png").stat().st_size > 20_000


def test_structures_that_do_not_stand(tmp_path: Path, jld: Command) -> None:
    path = scene_of_command(tmp_path, ["aa", "#."], [{"element": "c1r0", "force": [0, -1]}])
    path.write_text(path.read_text("utf-8").replace("20000.0", "10.0"), "utf-8")
    found = json.loads(jld("experiment", path, "--json", "--out", tmp_path / "out").done().out)
    assert found["stands"] is False
    assert found["status"] in ("falls", "creeps")
    assert found["collapse_load"] is None
    assert (tmp_path / "out" / "experiment.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--dilation", "much"], "--dilation"),
        (["--dilation", "-1"], "--dilation"),
        (["--rank", "3"], "--rank"),
        (["--segments", "1", "--scheme", "midpoint"], "--segments"),
        (["--inner-ratio", "0"], "--inner-ratio"),
        (["--inner-ratio", "1e308"], "--inner-ratio"),
        (["--shear-stiffness", "1e308"], "--shear-stiffness"),
    ],
)
def test_bad_options_are_one_line(arguments: list[str], words: str, jld: Command) -> None:
    jld("experiment", SCENES_of_command / "ferris_tinloi_1.json", *arguments).refused(words)
