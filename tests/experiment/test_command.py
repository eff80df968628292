"""`jld experiment`: what it prints and writes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from cases import dry_and_inner
from command import Command
from paths import SCENES

KEYS = {"collapse_load", "load_factor", "ratio", "stands", "rate_error", "status", "first_crack", "inner", "dilation"}


def scene(tmp_path: Path, rows: list[str], live: list[dict[str, object]]) -> Path:
    path = tmp_path / "scene.json"
    document = {
        "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
        "materials": dry_and_inner(1400, 0.5, 2e4, 2e4),
        "loads": {"live": live},
    }
    path.write_text(json.dumps(document), "utf-8")
    return path


Patch, Capture = pytest.MonkeyPatch, pytest.CaptureFixture[str]


def test_an_experiment_writes_its_folder(tmp_path: Path, jld: Command) -> None:
    path = scene(tmp_path, ["aab", "acc", "###"], [{"body": [1, 0]}])
    out = tmp_path / "out"
    options = ("--inner", "plastic", "--dilation", "friction", "--out", out, "--json")
    done = jld("experiment", path, *options)
    assert done.code == 0, done.err
    found = json.loads(done.out)
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
    path = scene(tmp_path, ["aa", "#."], [{"element": "c1r0", "force": [0, -1]}])
    path.write_text(path.read_text("utf-8").replace("20000.0", "10.0"), "utf-8")
    done = jld("experiment", path, "--json", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    found = json.loads(done.out)
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
    ],
)
def test_bad_options_are_one_line(arguments: list[str], words: str, jld: Command) -> None:
    done = jld("experiment", SCENES / "ferris_tinloi_1.json", *arguments)
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert words in done.err
