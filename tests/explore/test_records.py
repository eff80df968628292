"""The record of a study: what was written is found, whatever becomes of the process; damage and company are named."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import dry_and_inner, grid_document
from command import ROOT, Command, ended, refused
from jld_core import InputError, Status, parse_scene
from jld_explore import Evaluation, ExploreSettings, explore, read_folder
from jld_explore.evaluation import Records
from jld_explore.report import csv_of

HEADER = {"scene": "a", "seed": 1}
FACES = 11


def labellings(count: int, faces: int = FACES) -> np.ndarray:
    return ((np.arange(count)[:, None] >> np.arange(faces)) & 1).astype(bool)


def evaluations(count: int) -> list[Evaluation]:
    nan = float("nan")
    kinds = [
        lambda n: Evaluation(Status.COLLAPSE, n - 0.5, n + 0.5, float(n), seconds=0.001),
        lambda n: Evaluation(Status.LOCKED, float(n), nan, nan),
        lambda n: Evaluation(Status.UNSTABLE, nan, nan, nan, settled="bound"),
        lambda n: Evaluation(Status.COLLAPSE, nan, float("inf"), n + 1.0, zero_dilation=float(n)),
    ]
    return [kinds[n % 4](n) for n in range(count)]


def filled(folder: Path, count: int = 6) -> Path:
    records = Records(folder, HEADER, FACES)
    records.append(labellings(count)[:2], [1, 2], evaluations(count)[:2])
    records.append(labellings(count)[2:], [1] * (count - 2), evaluations(count)[2:])
    records.close()
    return folder / "records.sqlite3"


def change(path: Path, statement: str, *values: object) -> None:
    file = sqlite3.connect(path)
    with file:
        file.execute(statement, values)
    file.close()


def test_written_records_are_found(tmp_path: Path) -> None:
    filled(tmp_path)
    records = Records(tmp_path, HEADER, FACES)
    for labels, expected in zip(labellings(6), evaluations(6), strict=True):
        assert repr(records.find(labels)) == repr(expected)
    assert records.find(labellings(7)[6]) is None
    assert len(records) == 6
    assert records.rows["multiplicity"].tolist() == [1, 2, 1, 1, 1, 1]
    records.close()
    assert [path.name for path in tmp_path.iterdir()] == ["records.sqlite3"]


def test_records_are_readable_by_sqlite_alone(tmp_path: Path) -> None:
    """With nothing but SQLite, also while the study runs."""
    records = Records(tmp_path, HEADER, FACES)
    records.append(labellings(3), [1, 1, 1], evaluations(3))
    file = sqlite3.connect(f"file:{tmp_path / 'records.sqlite3'}?mode=ro", uri=True)
    rows = file.execute("SELECT hex(labelling), status, low, settled FROM evaluations ORDER BY id").fetchall()
    assert rows == [
        ("0000", "collapse", -0.5, "solve"),
        ("8000", "locked", 1.0, "solve"),
        ("4000", "unstable", None, "bound"),
    ]
    assert dict(file.execute("SELECT key, value FROM meta"))["seed"] == "1"
    file.close()
    records.close()


def test_records_are_never_changed(tmp_path: Path) -> None:
    filled(tmp_path)
    records = Records(tmp_path, HEADER, FACES)
    twice = labellings(8)[[7, 1, 7]]
    records.append(twice, [9, 9, 9], [Evaluation(Status.COLLAPSE, 7.0, 7.0, 7.0)] * 3)
    assert len(records) == 7
    assert repr(records.find(twice[1])) == repr(evaluations(2)[1])
    records.close()
    records = Records(tmp_path, HEADER, FACES)
    assert len(records) == 7
    records.close()


def test_another_header_is_refused_by_name(tmp_path: Path) -> None:
    filled(tmp_path)
    before = (tmp_path / "records.sqlite3").read_bytes()
    with pytest.raises(InputError, match="seed 1, not 2"):
        Records(tmp_path, HEADER | {"seed": 2}, FACES)
    with pytest.raises(InputError, match="faces 11, not 12"):
        Records(tmp_path, HEADER, 12)
    assert (tmp_path / "records.sqlite3").read_bytes() == before


def said_or_held(folder: Path) -> str | list[str]:
    """What is said of a file that is refused, or what one that is taken says of six labellings."""
    try:
        records = Records(folder, HEADER, FACES)
    except InputError as error:
        return str(error)
    assert len(records) == 6
    found = [repr(records.find(labels)) for labels in labellings(6)]
    records.close()
    return found


def test_cut_anywhere_or_full_of_garbage(tmp_path: Path) -> None:
    """Every damaged file is named in one line, or holds what it held: never other numbers."""
    content = filled(tmp_path / "whole").read_bytes()
    rng = np.random.default_rng(5)
    damaged = [content[:cut] for cut in rng.integers(1, len(content), 40).tolist()]
    for place in rng.integers(0, len(content), 400).tolist():
        damaged.append(content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :])
    damaged += [b"\0" * 4096, b"no database at all", content[:100] + rng.bytes(len(content) - 100)]
    refused = 0
    folder = tmp_path / "damaged"
    folder.mkdir()
    for text in damaged:
        (folder / "records.sqlite3").write_bytes(text)
        found = said_or_held(folder)
        if isinstance(found, str):
            refused += 1
            assert found.startswith(f"{folder / 'records.sqlite3'}: ")
            assert "\n" not in found
        else:
            assert found == [repr(expected) for expected in evaluations(6)]
    assert refused > 40


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE evaluations SET low = 0.25 WHERE id = 3",
        "UPDATE evaluations SET status = 'splendid' WHERE id = 2",
        "UPDATE evaluations SET labelling = x'ff' WHERE id = 2",
        "UPDATE evaluations SET labelling = 'text' WHERE id = 2",
        "UPDATE evaluations SET multiplicity = -1",
        "UPDATE evaluations SET labelling = (SELECT labelling FROM evaluations WHERE id = 1)",
        "DROP TABLE conflicts",
    ],
)
def test_forged_records_are_refused(statement: str, tmp_path: Path) -> None:
    change(filled(tmp_path), statement)
    with refused(match="it is damaged"):
        Records(tmp_path, HEADER, FACES)


def test_a_forged_status_with_a_right_checksum_is_refused(tmp_path: Path) -> None:
    """Whoever can compute the checksum still cannot make a status that is none."""
    path = filled(tmp_path)
    for value in ("200", "", 200):
        change(path, "UPDATE evaluations SET status = ?", value)
        with pytest.raises(InputError, match="holds an impossible value"):
            Records(tmp_path, HEADER, FACES)


def test_an_empty_record_beside_a_scene_is_refused(tmp_path: Path) -> None:
    (tmp_path / "records.sqlite3").touch()
    records = Records(tmp_path, HEADER, FACES)
    assert records.began_anew  # killed before anything was finished; the summary says so
    records.close()
    (tmp_path / "records.sqlite3").unlink()
    (tmp_path / "records.sqlite3").touch()
    (tmp_path / "scene.json").touch()
    with pytest.raises(InputError, match="it is empty"):
        Records(tmp_path, HEADER, FACES)
    assert (tmp_path / "records.sqlite3").stat().st_size == 0
    (tmp_path / "records.sqlite3").unlink()
    (tmp_path / "scene.json").unlink()
    filled(tmp_path)
    (tmp_path / "scene.json").write_text("{}")
    (tmp_path / "records.sqlite3").unlink()
    with closing(sqlite3.connect(tmp_path / "records.sqlite3")) as file:
        file.execute("PRAGMA journal_mode=WAL")
    with pytest.raises(InputError, match="no tables"):
        Records(tmp_path, HEADER, FACES)


def test_one_process_at_a_time(tmp_path: Path) -> None:
    records = Records(tmp_path, HEADER, FACES)
    with pytest.raises(InputError, match="another process is at work in it") as error:
        Records(tmp_path, HEADER, FACES)
    assert str(error.value).startswith(str(tmp_path))
    records.close()
    records.close()
    Records(tmp_path, HEADER, FACES).close()


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    """What was finished before stays; what does not fit is not there at all."""
    filled(tmp_path)
    records = Records(tmp_path, HEADER, FACES)
    file = records._file
    file.execute(f"PRAGMA max_page_count={file.execute('PRAGMA page_count').fetchone()[0]}")
    rows = labellings(2000)
    with pytest.raises(OSError, match="No space left on device") as error:
        records.append(rows, [1] * 2000, evaluations(2000))
    assert error.value.filename == str(tmp_path / "records.sqlite3")
    assert len(records) == 6
    records.close()
    records = Records(tmp_path, HEADER, FACES)
    assert len(records) == 6
    records.close()


WRITER = """
import sys
from pathlib import Path
sys.path[:0] = {paths!r}
from test_records import FACES, HEADER, evaluations, labellings
from jld_explore.evaluation import Records
records, rows = Records(Path(sys.argv[1]), HEADER, FACES), labellings(2048)
for n, found in enumerate(evaluations(2048)):
    if records.find(rows[n]) is None:
        records.append(rows[n : n + 1], [1], [found])
        records.add_conflicts(rows[n : n + 1], rows[n : n + 1], [float(n)], [0])
        print(n, flush=True)
"""


def test_a_kill_loses_nothing_that_was_finished(tmp_path: Path) -> None:
    """Every labelling that was told to be finished is on record as it was told."""
    rng, rows = np.random.default_rng(2), labellings(2048)
    told = 0
    for wait in rng.integers(1, 120, int(os.environ.get("JLD_KILLS", "1"))).tolist():
        code = WRITER.format(paths=[str(Path(__file__).parent), str(Path(__file__).parents[1])])
        started = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        with ended(started) as run:
            for _ in range(wait):
                told = int(run.stdout.readline())
            os.kill(run.pid, signal.SIGKILL)
            rest = run.stdout.read().split()
            told = int(rest[-1]) if rest and rest[-1].isdigit() else told
        records = Records(tmp_path, HEADER, FACES)
        count = len(records)
        assert count in (told, told + 1, told + 2)
        for n in range(count):
            assert repr(records.find(rows[n])) == repr(evaluations(n + 1)[n])
        records.close()


def test_a_conflict_and_a_bound_of_minus_zero_come_back(tmp_path: Path) -> None:
    """SQLite keeps no sign of a zero, and the checksum must not tell the two apart."""
    faces = np.zeros(FACES, dtype=bool)
    records = Records(tmp_path, HEADER, FACES)
    records.append(faces[None], [1], [Evaluation(Status.COLLAPSE, 0.0, 0.0, 0.0)])
    records.add_conflicts(~faces[None], faces[None], [-0.0], [0])
    records.keep_bound(-0.0)
    records.close()
    again = Records(tmp_path, HEADER, FACES)
    assert again.bound == 0.0
    again.conflicts("key")
    again.close()


def test_conflicts_are_those_of_one_proof(tmp_path: Path) -> None:
    records = Records(tmp_path, HEADER, FACES)
    rows = labellings(9)
    assert len(records.conflicts("one scene")[0]) == 0
    records.add_conflicts(rows[:2], rows[1:3], [0.5, 1.5], [False, True])
    records.add_conflicts(rows[2:3], rows[3:4], [2.5], [0])
    records.close()
    records = Records(tmp_path, HEADER, FACES)
    decided, labels, bounds, closed = records.conflicts("one scene")
    assert np.array_equal(decided, rows[:3])
    assert np.array_equal(labels, rows[1:4])
    assert bounds.tolist() == [0.5, 1.5, 2.5]
    assert closed.tolist() == [False, True, False]
    assert len(records.conflicts("another scene")[0]) == len(records.conflicts("one scene")[0]) == 0
    records.close()


# Tables that survive a spreadsheet, and a folder that holds what the contract lists.


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
OF_STEPS = {"experiments.csv", "reliability.csv"}
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


@pytest.mark.parametrize("driver", ["enumeration", "exact", "optuna"])
def test_every_file_is_in_the_contract(driver: str, tmp_path: Path) -> None:
    """Pictures of one driver are those of all."""
    drawn = driver == "enumeration"
    explore(parse_scene(scene()), tmp_path / "out", driver=driver, jobs=1, budget=20, pictures=drawn)
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written <= LISTED, written - LISTED
    endings = (*ENDINGS[: None if drawn else 2], "scene.json", "summary.json", "columns.json")
    always = {file for file in LISTED if file.endswith(endings)}
    assert len(ON_DEMAND) == 3
    assert always - ON_DEMAND - OF_STEPS <= written


@pytest.mark.sampled(2)
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
        if file in OF_STEPS:
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
    for name, csv, written in (("small", False, [True, False]), ("asked", True, [True, True])):
        found = []
        for budget in (2, 4):
            monkeypatch.setattr("jld_explore.report.tables.CSV_ROWS", 2)
            settings = ExploreSettings(
                driver="random", budget=budget, jobs=1, pictures=False, csv=csv, resume=budget > 2
            )
            done = explore(parse_scene(scene()), tmp_path / name, settings)
            found.append((done.folder / "results.csv").exists())
            assert len(pd.read_parquet(done.folder / "results.parquet")) == budget
        assert found == written


WITHOUT_PARQUET = """
import json, sys
sys.modules["pyarrow"] = None
sys.path.insert(0, sys.argv[1])
from jld_explore.__main__ import main
from without_pictures import leave_out_pictures
leave_out_pictures()
for line in json.loads(sys.argv[2]):
    sys.argv = ["jld", *line]
    try:
        main()
    except SystemExit as end:
        assert end.code == 0, end.code
"""


def test_a_folder_without_parquet_is_written_and_read(
    tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names of load cases that a spreadsheet would run come back; the same rows as with Parquet, of the same types."""
    document = grid_document(["aaa", "bbb", "###"])
    document["loads"] = {"cases": [{"name": n, "live": [{"body": [x, 0]}]} for n, x in (("=left", -1), ("@right", 1))]}
    scene, out = tmp_path / "scene.json", tmp_path / "out"
    scene.write_text(json.dumps(document))
    search = ("explore", scene, "--driver", "random", "--budget", 9, "--jobs", 1, "--check-fields", 0, "--out", out)
    lines = [list(map(str, line)) for line in (search, ("solve", out, "--rank", 2, "--json"))]
    command = [sys.executable, "-c", WITHOUT_PARQUET, str(ROOT / "tests"), json.dumps(lines)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (out / "results.parquet").exists()
    alone = read_folder(out).results
    alone.to_parquet(out / "results.parquet")
    pd.testing.assert_frame_equal(read_folder(out).results, alone)
    assert set(alone["governing"]) <= {"=left", "@right"}
    (out / "results.csv").unlink()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    jld("solve", out).refused("results.parquet: it needs pyarrow, which is not installed", "pip install 'jld[parquet]'")
