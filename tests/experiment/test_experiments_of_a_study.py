"""`jld explore --experiment K` and `--objective experiment`: a column more, once each, and what bounds what."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from command import Command
from jld_core import Scene, parse_scene
from jld_experiment import experiments as module
from jld_experiment.experiments import FILE, Experiments, with_experiments
from jld_explore import ExploreSettings, explore

Patch, Capture = pytest.MonkeyPatch, pytest.CaptureFixture[str]
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
def test_a_column_for_the_best(tmp_path: Path, monkeypatch: Patch, jld: Command) -> None:
    """K experiments, at most λ each; gone on with, none is run again and the column stays."""
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(DOCUMENT), "utf-8")
    out = tmp_path / "out"
    options = ("--experiment", "3", "--jobs", "1", "--json")
    done = jld("explore", path, "--out", out, *options)
    assert done.code == 0, done.err
    table = pd.read_csv(out / "results.csv", dtype={"labelling": str})
    assert table["experiment"].notna().tolist() == [True] * 3 + [False] * (len(table) - 3)
    best = table.head(3)
    assert (best["experiment"] <= best["load_factor_associative"] * (1.0 + 2e-3)).all()
    facts = json.loads(done.out)["experiment"]
    assert facts["runs"] == 3
    assert facts["best"] == pytest.approx(best["experiment"].max())
    kept = (out / FILE).read_bytes()

    def refuse(*_: object) -> None:
        raise AssertionError("run again")

    monkeypatch.setattr(module, "one_experiment", refuse)
    again = jld("explore", path, "--out", out, *options, "--resume")
    assert again.code == 0, again.err
    assert (out / FILE).read_bytes() == kept
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


def test_a_claim_by_experiment_states_its_assumption(tmp_path: Path, monkeypatch: Patch) -> None:
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
    tested = Experiments(done.assembly, tmp_path / "all")
    values = done.results["load_factor_associative"].fillna(0.0)
    tested.rows = {
        name: made_up(None, name, value) for name, value in zip(done.results["labelling"], values, strict=True)
    }
    every = with_experiments(done, tested, False).summary.facts["experiment"]
    assert every["none_better"]
    assert every["none_better_assumes"] is None


def test_nobody_is_experimented_on_after_time_is_up(tmp_path: Path) -> None:
    done = explore(scene(), tmp_path / "out", ExploreSettings(experiment=10_000, seconds=1e-9, pictures=False))
    assert done.summary.facts["experiment"]["runs"] == 0
