"""Tables that survive a spreadsheet, and a folder that holds what the contract lists."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import dry_and_inner, grid_document
from command import Command
from jld_core import parse_scene
from jld_experiment import experiments
from jld_explore import ExploreSettings, explore, read_folder
from jld_explore.report import csv_of, tables
from jld_explore.report import tables as result_files
from jld_explore.report.tables import write_results
from jld_explore.space.labelling import to_strings
from jld_practice import reliability_study
from paths import ROOT

TEXT = (ROOT / "docs" / "scene.md").read_text("utf-8").split("## Files of a search")[1]
LISTED = {
    file
    for row in TEXT.splitlines()
    if row.startswith("| `")
    for file in re.findall(r"`(\S+\.\w+)`", row.split("|")[1])
}

ON_DEMAND = {
    file
    for row in TEXT.splitlines()
    if row.startswith("| `") and "--pictures" in row.split("|")[2]
    for file in re.findall(r"`(\S+\.\w+)`", row.split("|")[1])
}
ENDINGS = (".csv", ".parquet", ".html", ".png")


def scene(first: str = "a") -> dict[str, Any]:
    """Four blocks in two courses, one of them with an id of the asker's."""
    box = [[0, 0], [1, 0], [1, 1], [0, 1]]
    places = {first: (0, 0), "b": (1, 0), "c": (0, 1), "d": (1, 1)}
    elements: list[dict[str, Any]] = [
        {"id": name, "polygon": [[x + i, y + j] for x, y in box]} for name, (i, j) in places.items()
    ]
    ground = [[-1, -1], [3, -1], [3, 0], [-1, 0]]
    return {
        "elements": [*elements, {"id": "ground", "polygon": ground, "support": True}],
        "materials": dry_and_inner(2000, 0.7, 2e5, 2e5),
        "loads": {"live": [{"body": [1, 0]}]},
    }


@pytest.mark.parametrize(
    "settings",
    [
        ExploreSettings(driver="enumeration", jobs=1),
        ExploreSettings(driver="exact", jobs=1),
        ExploreSettings(driver="optuna", jobs=1, budget=3),
    ],
    ids=lambda settings: settings.driver,
)
def test_every_file_is_in_the_contract(settings: ExploreSettings, tmp_path: Path) -> None:
    explore(parse_scene(scene()), tmp_path / "out", settings)
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written <= LISTED, written - LISTED
    always = {file for file in LISTED if file.endswith((*ENDINGS, "scene.json", "summary.json", "columns.json"))}
    assert len(ON_DEMAND) == 3
    assert always - ON_DEMAND - {experiments.FILE, reliability_study.FILE} <= written


@pytest.mark.parametrize("name", ["=1+1", "@SUM(1)", "+1", "-1"])
def test_a_spreadsheet_keeps_labellings_and_runs_nothing(name: str, tmp_path: Path) -> None:
    settings = ExploreSettings(driver="enumeration", jobs=1, pictures=False)
    done = explore(parse_scene(scene(name)), tmp_path / "out", settings)
    read = pd.read_csv(tmp_path / "out" / "results.csv")
    assert read["labelling"].tolist() == done.results["labelling"].tolist()
    assert set("".join(read["labelling"])) == {"d", "i"}
    assert done.summary.best_labelling == read["labelling"][0]
    faces = pd.read_csv(tmp_path / "out" / "faces.csv")
    assert f"'{name}" in set(faces["element_a"]) | set(faces["element_b"])
    for file in ("faces.csv", "blocks.csv"):
        text = (tmp_path / "out" / file).read_text("utf-8")
        assert f"'{name}" in text
        assert not re.search(rf'(^|[," ]){re.escape(name)}', text, flags=re.M)


def test_every_column_has_its_unit(tmp_path: Path) -> None:
    explore(parse_scene(scene()), tmp_path / "out", ExploreSettings(driver="enumeration", jobs=1, pictures=False))
    columns = json.loads((tmp_path / "out" / "columns.json").read_text("utf-8"))
    for file, known in columns.items():
        assert file in LISTED
        if file in (experiments.FILE, reliability_study.FILE):
            own = experiments.COLUMNS if file == experiments.FILE else reliability_study.COLUMNS
            assert list(known) == list(own)
            continue
        assert set(pd.read_csv(tmp_path / "out" / file).columns) <= set(known), file
        assert all(set(column) == {"unit", "meaning"} and column["meaning"] for column in known.values())
    assert columns["results.csv"]["dry_length"]["unit"] == "m"
    assert columns["results.csv"]["seconds"]["unit"] == "s"
    assert columns["faces.csv"]["x0"]["unit"] == "m"


def test_numbers_are_left_as_they_are() -> None:
    table = pd.DataFrame({"a": [-1.5, 2.0], "b": ["-x", "y"], "c": ["@", None]})
    text = csv_of(table)
    assert text.splitlines() == ["a,b,c", "-1.5,'-x,'@", "2.0,y,"]
    assert pd.read_csv(io.StringIO(text))["a"].tolist() == [-1.5, 2.0]


def test_large_tables_have_no_csv_unless_it_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A table that is written again keeps to the first choice, and no CSV of fewer rows stays behind."""
    table = pd.DataFrame({"rank": [1, 2, 3], "labelling": ["dd", "di", "id"]})
    path = tmp_path / "results.csv"
    write_results(tmp_path, table)
    assert len(pd.read_csv(path)) == 3
    monkeypatch.setattr(result_files, "CSV_ROWS", 2)
    write_results(tmp_path, table.head(2), csv=False)
    assert len(pd.read_csv(path)) == 2
    write_results(tmp_path, table, csv=False)
    assert not path.exists()
    write_results(tmp_path, table)
    assert not path.exists()
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "results.parquet"), table)
    write_results(tmp_path, table, csv=True)
    write_results(tmp_path, table.iloc[::-1])
    assert pd.read_csv(path)["rank"].tolist() == [3, 2, 1]


def test_texts_made_from_bytes_are_those_of_the_labellings() -> None:
    """More labellings than one slice holds, none at all, and labels behind the faces, which members have."""
    labels = np.random.default_rng(1).random((tables._SLICE + 5, 11)) < 0.5
    packed = np.packbits(labels, axis=1)
    assert tables._texts(packed, 11, 11).tolist() == to_strings(labels)
    assert tables._texts(packed, 11, 9).tolist() == to_strings(labels[:, :9])
    assert tables._texts(packed[:0], 11, 11).tolist() == []


def test_a_folder_without_parquet_is_written_and_read(
    tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names of load cases that a spreadsheet would run come back; the same rows as with Parquet, of the same types."""
    document = grid_document(["aaa", "bbb", "###"])
    document["loads"] = {"cases": [{"name": n, "live": [{"body": [x, 0]}]} for n, x in (("=left", -1), ("@right", 1))]}
    scene, out = tmp_path / "scene.json", tmp_path / "out"
    scene.write_text(json.dumps(document))
    program = "import sys; sys.modules['pyarrow'] = None; from jld_explore.__main__ import main; main()"
    search = ("explore", scene, "--driver", "random", "--budget", 9, "--jobs", 1, "--check-fields", 0, "--out", out)
    for asked in (search, ("solve", out, "--rank", 2, "--json")):
        command = [sys.executable, "-c", program, *map(str, asked)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
    assert not (out / "results.parquet").exists()
    alone = read_folder(out).results
    write_results(out, alone)
    pd.testing.assert_frame_equal(read_folder(out).results, alone)
    assert set(alone["governing"]) <= {"=left", "@right"}
    (out / "results.csv").unlink()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    told = jld("solve", out)
    assert (told.code, told.err.count("\n")) == (2, 1)
    assert "results.parquet: it needs pyarrow, which is not installed" in told.err
    assert "pip install 'jld[parquet]'" in told.err
