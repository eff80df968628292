"""Where the output goes: encodings without λ, pipes nobody reads, streams that are closed or full."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from cases import grid_document
from command import command, environment


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams") / "scene.json"
    path.write_text(json.dumps({**grid_document(["aa", "##"]), "name": "汉"}))
    return path


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
    with Path("/dev/full").open("w") as full:
        done = run("check", scene, stdout=full)
    line = b"jld: standard output: No space left on device; expected a place that can be read and written\n"
    assert (done.returncode, done.stderr) == (2, line)
