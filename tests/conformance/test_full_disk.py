"""A disk that takes no more: every writer says so in one line that names the file, and leaves nothing half-written."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cases import grid_document
from command import Command, command, environment, saved
from jld_core import parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.verification import certificate

PLANAR = grid_document(["aa", "ab", "##"], block_cells=[1, 3])
SETTLING: dict[str, Any] = {
    **PLANAR,
    "settlements": [{"name": "sinks", "supports": [{"elements": "c0r2", "move": [0, -1]}]}],
}
WRITERS = {
    "solve scene.json --out NEW": "result.json",
    "explore scene.json --out NEW --jobs 1 --driver random --budget 3": "records.sqlite3",
    "plot scene.json --out FILE.png": "",
    "plot scene.json --out FILE.html": "",
    "plot searched --out NEW": "best.png",
    "new wall -o FILE": "",
    "refine scene.json --cell 0.05 -o FILE": "",
    "export scene.json --format dxf -o FILE": "",
    "export scene.json --format vtk -o FILE": "",
    "export scene.json --format svg -o FILE": "",
    "export scene.json --format step -o FILE": "",
    "export scene.json --format gltf -o FILE": "",
    "export scene.json --format ifc -o FILE": "",
    "export scene.json --format 3dm -o FILE": "",
    "assembly scene.json --out NEW": "assembly.csv",
    "settlement settling.json --out NEW": "settlement.json",
}
"""Commands, and which file of a folder they begin with. FILE: a file to be made, NEW: a folder."""


@contextmanager
def no_room(size: int) -> Iterator[None]:
    """No file grows beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # a module that is first imported here would leave a compiled file that is cut off, which no later process can load
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = written


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("full")
    (place / "scene.json").write_text(json.dumps(PLANAR))
    (place / "settling.json").write_text(json.dumps(SETTLING))
    settings = ExploreSettings(driver="random", budget=3, jobs=1, pictures=False)
    explore(parse_scene(PLANAR), place / "searched", settings)
    return place


@pytest.mark.sampled(2)
@pytest.mark.parametrize("line", WRITERS)
def test_a_full_disk_is_one_line(
    line: str, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command
) -> None:
    if "dxf" in line:
        pytest.importorskip("ezdxf")
    for kind, library in (("vtk", "meshio"), ("ifc", "ifcopenshell"), ("3dm", "rhino3dm")):
        if kind in line:
            pytest.importorskip(library)
    monkeypatch.chdir(place)
    file = tmp_path / "made"
    words = [str(file) + word[4:] if word.startswith(("FILE", "NEW")) else word for word in line.split()]
    with no_room(16):
        outcome = jld(*words)
    target = next(word for word in words if word.startswith(str(file)))
    named = Path(target) / WRITERS[line] if WRITERS[line] else Path(target)
    assert (outcome.code, outcome.err.count("\n")) == (2, 1), outcome
    assert outcome.err.startswith(f"jld: {named}: "), outcome.err
    assert "; expected a place that can be read and written" in outcome.err
    # what a command announces while it is at work apart, nothing is said to be done
    assert "written" not in outcome.out
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_certificate_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    rules = [certificate.Rule("none", (1, 2))] * 9
    claim = certificate.Claim({}, 1.0)
    with no_room(16), pytest.raises(OSError, match="File too large") as error:
        certificate.write(tmp_path / "proof", claim, rules)
    assert error.value.filename == str(tmp_path / "proof")
    assert list(tmp_path.iterdir()) == []


# Where the output goes: encodings without λ, pipes nobody reads, streams that are closed or full.


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("streams") / "scene.json", {**grid_document(["aa", "##"]), "name": "汉"})


def run(*arguments: str | Path, pictures: bool = True, **streams: Any) -> subprocess.CompletedProcess[bytes]:
    env = {**environment(), "JLD_KERNEL": "off", **streams.pop("env", {})}
    streams = {"stderr": subprocess.PIPE, **streams}
    return subprocess.run(command(*arguments, pictures=pictures), env=env, timeout=240, check=False, **streams)


def test_letters_that_an_encoding_lacks_are_spelt(scene: Path) -> None:
    done = run("solve", scene, stdout=subprocess.PIPE, env={"PYTHONIOENCODING": "cp1252"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert "lambda" in done.stdout.decode("cp1252")
    done = run("check", scene, stdout=subprocess.PIPE, env={"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert rb"scene        \u6c49" in done.stdout
    odd = scene.parent / os.fsdecode(b"no\xff.json")  # the name of a file need be no text
    done = run("check", odd, stdout=subprocess.PIPE, env={"PYTHONIOENCODING": "utf-8"})
    assert done.returncode == 2
    assert b"no\xff.json: No such file" in done.stderr


def test_nobody_reads(scene: Path, tmp_path: Path) -> None:
    """Neither is a search lost, whose first line nobody takes."""
    read, write = os.pipe()
    os.close(read)
    line = ("explore", scene, "--out", tmp_path / "out", "--driver", "random", "--budget", "1", "--jobs", "1")
    done = run(*line, pictures=False, stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["evaluated"] == 1


def test_closed_streams(scene: Path, tmp_path: Path) -> None:
    """Files of ours do not get their numbers, so that nothing is written into a record."""
    out = tmp_path / "out"
    shell = f'exec "$@" --out {out} --driver random --budget 1 --jobs 1 <&- >&- 2>&-'
    done = subprocess.run(
        ["sh", "-c", shell, "sh", *command("explore", scene, pictures=False)],
        env={**environment(), "JLD_KERNEL": "off"},
        check=False,
    )
    assert done.returncode == 0
    assert json.loads((out / "summary.json").read_text())["evaluated"] == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device here")
def test_full(scene: Path) -> None:
    line = rb"jld: standard output.*: No space left on device; expected a place that can be read and written\n"
    for words in (("check", scene), ("--help",), ("new", "--help")):
        with Path("/dev/full").open("w") as full:
            done = run(*words, stdout=full)
        assert done.returncode == 2
        assert re.fullmatch(line, done.stderr)
