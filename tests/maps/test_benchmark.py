"""The benchmark that others can enter: its problems, records and certificates, and the check of submissions."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

import jld_core as jc
from command import Command, saved
from jld_explore.verification import verify

PROBLEMS = Path(str(files("jld_maps"))) / "problems"
RECORDS: dict[str, Any] = json.loads((PROBLEMS / "records.json").read_text("utf-8"))


def test_forty_problems_of_all_kinds(jld: Command) -> None:
    assert len(RECORDS) == 40
    assert {one["dimension"] for one in RECORDS.values()} == {2, 3}
    assert {one["cracks"] for one in RECORDS.values()} == {"faces", "fields"}
    faces = [one["faces"] for one in RECORDS.values()]
    assert (min(faces) <= 9, max(faces) >= 800) == (True, True)
    assert any(one["cases"] > 1 for one in RECORDS.values())
    assert any(one["limits"] for one in RECORDS.values())
    assert sum(one["certificate"] is not None for one in RECORDS.values()) >= 10
    for name, one in RECORDS.items():
        assert (PROBLEMS / f"{name}.json").exists()
        assert one["bound"] is None or one["best"] <= one["bound"] * (1 + 1e-6)
    listed = jld("benchmark", "list").out.splitlines()
    assert len(listed) == 41
    assert listed[1].split()[0] == next(iter(RECORDS))


@pytest.mark.parametrize("name", ["lintel-3x2", "cubes-2"])
def test_a_record_is_as_its_scene_and_its_certificate_say(name: str) -> None:
    one = RECORDS[name]
    assert jc.solve(PROBLEMS / f"{name}.json", one["labels"]).load_factor == pytest.approx(one["best"], rel=1e-6)
    assert verify(PROBLEMS / one["certificate"]).claim.bound == pytest.approx(one["bound"], rel=1e-6)


def submitted(jld: Command, folder: Path, *layouts: dict[str, Any]) -> tuple[int, dict[str, Any]]:
    path = saved(folder / "mine.json", {"method": "by hand", "layouts": layouts})
    found = jld("benchmark", "check", path, "--json")
    return found.code, json.loads(found.out)


def test_claims_are_solved_anew(jld: Command, tmp_path: Path) -> None:
    name = "wall-4x4"
    best = RECORDS[name]
    free = jc.build_assembly(PROBLEMS / f"{name}.json").free_faces
    slit = "".join("i" if one else "d" for one in free).replace("i", "d", 1)
    dry = {"problem": name, "labels": "d" * best["faces"], "load_factor": 1.0}
    code, told = submitted(
        jld,
        tmp_path,
        {"problem": name, "labels": best["labels"], "load_factor": best["best"]},
        dry,
        dry | {"load_factor": 1e6},
        dry | {"labels": "ddd"},
        dry | {"labels": slit},
    )
    verdicts = [one["verdict"] for one in told["layouts"]]
    assert verdicts == ["equals the record", "verified", "not carried", "refused", "refused"]
    assert (code, told["beaten"]) == (4, [])
    assert "one block on both sides" in told["layouts"][4]["why"]


def test_a_record_can_be_beaten(jld: Command, tmp_path: Path) -> None:
    folder = tmp_path / "problems"
    folder.mkdir()
    name = "wall-3x3"
    (folder / f"{name}.json").write_bytes((PROBLEMS / f"{name}.json").read_bytes())
    weaker = RECORDS[name] | {"best": 0.9 * RECORDS[name]["best"], "proven": False}
    (folder / "records.json").write_text(json.dumps({name: weaker}), "utf-8")
    mine = tmp_path / "mine.json"
    layout = {"problem": name, "labels": RECORDS[name]["labels"], "load_factor": weaker["best"]}
    mine.write_text(json.dumps({"layouts": [layout]}), "utf-8")
    found = jld("benchmark", "check", mine, "--problems", folder).done()
    assert "beats the record   +11.11% over the best known" in found.out
    assert found.out.splitlines()[-1] == f"1 records beaten: {name}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "it has no layouts"),
        ("nonsense", "it is not JSON (line 1, column 1)"),
        ("[" * 100_000, "it is nested too deeply"),
        ('{"layouts": ' + "9" * 5000 + "}", "thousands of digits"),
        ('{"layouts": [{"problem": {}, "labels": "d", "load_factor": 1}]}', "there is no {}"),
        ('{"layouts": [{"problem": "wall-4x4"}]}', "layouts[0]: its keys are wrong"),
        ('{"layouts": [{"problem": "x", "labels": "d", "load_factor": 1}]}', "there is no 'x'"),
        ('{"layouts": [{"problem": "wall-4x4", "labels": "01", "load_factor": 1}]}', "labels: they are wrong"),
        ('{"layouts": [{"problem": "wall-4x4", "labels": "d", "load_factor": "1"}]}', "'1' is wrong"),
    ],
)
def test_what_is_no_submission_is_refused(jld: Command, tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "mine.json"
    path.write_text(text, "utf-8")
    jld("benchmark", "check", path).refused(words)
