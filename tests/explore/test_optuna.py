"""The optuna driver: its journal survives a kill, and processes share a server."""

from __future__ import annotations

import json
import os
import pwd
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from cases import dry_and_inner, grid_document
from jld_core import Status, build_assembly, parse_scene
from jld_explore import Evaluation, ExploreSettings, explore, search_space
from jld_explore.drivers.optuna import FILE, Optuna

SCENE = {
    "grid": {"cell": [1, 1], "thickness": 1, "rows": ["aab", "ccb", "###"]},
    "materials": dry_and_inner(2000, 0.6, 1e5, 1e5),
    "loads": {"live": [{"body": [1, 0]}]},
}


def searched(folder: Path, budget: int) -> None:
    settings = ExploreSettings(driver="optuna", jobs=1, budget=budget, resume=folder.exists(), pictures=False)
    explore(parse_scene(SCENE), folder, settings)


def trials(folder: Path) -> list[tuple[int, str | None, dict[str, float]]]:
    study = optuna.load_study(study_name=None, storage=JournalStorage(JournalFileBackend(str(folder / FILE))))
    return [(trial.number, trial.user_attrs.get("labelling"), trial.params) for trial in study.trials]


@pytest.mark.long
def test_a_torn_line_and_a_lock_left_behind_are_made_good(tmp_path: Path) -> None:
    searched(tmp_path / "whole", 40)
    torn = tmp_path / "torn"
    searched(torn, 20)
    journal = torn / FILE
    journal.write_bytes(journal.read_bytes()[:-40])
    journal.with_name(f"{FILE}.lock").write_text("")
    searched(torn, 40)
    assert not journal.with_name(f"{FILE}.lock").exists()
    assert trials(torn) == trials(tmp_path / "whole")


@pytest.mark.parametrize("content", [b"\x00\xffnot json\n{}\n", pytest.param(b"{}\n", marks=pytest.mark.long)])
def test_a_damaged_journal_is_written_again(content: bytes, tmp_path: Path) -> None:
    """It is a copy of what is on record, and does not stand in the way of going on."""
    searched(tmp_path / "whole", 20)
    searched(tmp_path / "a", 10)
    (tmp_path / "a" / FILE).write_bytes(content)
    searched(tmp_path / "a", 20)
    assert trials(tmp_path / "a") == trials(tmp_path / "whole")


def test_every_trial_of_a_class_is_finished() -> None:
    """Trials of a class that were asked for while another of it was evaluated stayed running for ever."""
    scene = parse_scene(SCENE)
    space = search_space(scene, build_assembly(scene))
    driver = Optuna(space, 0, size=16)  # few classes: many trials propose one that is waiting
    rows = driver.propose()
    waiting = driver._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))
    assert len(waiting) > len(driver._waiting)
    driver.tell(rows, [Evaluation(Status.COLLAPSE, 1.0, 1.0, 1.0)] * len(rows))
    assert driver._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)) == []


# Optuna's storage on a PostgreSQL server that several processes share: a real server, started here.


def _program(name: str) -> str | None:
    places = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return shutil.which(name) or (str(places[-1]) if places else None)


@pytest.fixture
def server() -> Iterator[str]:
    """The URL of a database on a server of its own, which is stopped afterwards."""
    pytest.importorskip("psycopg")
    initdb, postgres = _program("initdb"), _program("postgres")
    if initdb is None or postgres is None:
        pytest.skip("no PostgreSQL server is installed")
    owner: dict[str, Any] = {}
    folder = Path(tempfile.mkdtemp(prefix="jld-"))
    if os.geteuid() == 0:  # the server refuses to run as root
        if "postgres" not in {one.pw_name for one in pwd.getpwall()}:
            pytest.skip("a server does not run as root, and there is no user postgres")
        owner = {"user": "postgres", "group": pwd.getpwnam("postgres").pw_gid, "extra_groups": []}
        shutil.chown(folder, "postgres")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    data = folder / "data"
    subprocess.run(
        [initdb, "-D", data, "-A", "trust", "-U", "jld", "--no-sync"],
        check=True,
        capture_output=True,
        cwd=folder,
        **owner,
    )
    running = subprocess.Popen(
        [postgres, "-D", data, "-p", str(port), "-k", folder, "-c", "listen_addresses=127.0.0.1", "-c", "fsync=off"],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        **owner,
    )
    try:
        _wait(port)
        yield f"postgresql+psycopg://jld@127.0.0.1:{port}/postgres"
    finally:
        running.terminate()
        running.wait(20)
        shutil.rmtree(folder, ignore_errors=True)


def _wait(port: int) -> None:
    import time

    import psycopg

    for _ in range(200):
        try:
            psycopg.connect(f"host=127.0.0.1 port={port} user=jld dbname=postgres", connect_timeout=2).close()
        except psycopg.OperationalError:
            time.sleep(0.05)
        else:
            return
    raise TimeoutError("the server does not answer")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.long
def test_two_processes_share_a_server(server: str, tmp_path: Path) -> None:
    """Two searches at once, each its own study there; what both found is read by whoever asks the server."""
    import optuna

    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3])), encoding="utf-8")
    command = [sys.executable, "-m", "jld_explore", "explore", scene, "--driver", "optuna", "--storage", server]
    command += ["--sampler", "Random", "--budget", "6", "--jobs", "1", "--json"]
    both = [
        subprocess.Popen([*command, "--seed", str(seed), "--out", tmp_path / str(seed)], stdout=subprocess.PIPE)
        for seed in (1, 2)
    ]
    found = []
    for one in both:
        text, _ = one.communicate(timeout=120)
        assert one.returncode == 0
        found.append(json.loads(text))
    storage = optuna.storages.RDBStorage(server)
    names = optuna.get_all_study_names(storage)
    assert len(names) == 2
    best = []
    for name in names:
        trials = optuna.load_study(study_name=name, storage=storage).trials
        assert len(trials) >= 6
        best.append(max(-trial.values[0] for trial in trials if trial.values))  # what is minimised
    storage.remove_session()
    storage.engine.dispose()
    assert sorted(best) == pytest.approx(sorted(one["best"] for one in found), rel=1e-9)
