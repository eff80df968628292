"""Kill, signal, tear and resume: what was finished is never evaluated again, and the table comes out the same.

Runs are real processes in a session of their own; the moment of a kill is a number of records on disk, so that
it does not depend on how fast the machine is.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
import pytest

from cases import grid_document
from command import Command, Outcome, command, environment, process, saved
from jld_explore.drivers import DRIVERS

EXPLORE = ("explore", "--check-fields", "0")
"""What blocks that crack anywhere carry, test_field_searches.py tests."""
CLASSES = 599  # 4×3 cells on a support row, blocks of 2 to 4 cells, counted by enumeration
KILLS = int(os.environ.get("JLD_KILLS", "4"))
"""Number of kills at random moments; each costs the start of three processes. `make bench` asks for twenty."""


@pytest.fixture(scope="module", autouse=True)
def one_by_one() -> Iterator[None]:
    """Without the batch solver, which finishes hundreds at once: the moments between are what is tested."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JLD_KERNEL", "off")
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(
        tmp_path_factory.mktemp("scene") / "wall.json",
        grid_document(["aaaa", "aaaa", "aaaa", "####"], block_cells=[2, 4]),
    )


@pytest.fixture(scope="module")
def deferred_signals(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run that nothing disturbs."""
    folder = tmp_path_factory.mktemp("undisturbed") / "out"
    facts = json.loads(process(*EXPLORE, scene, "--out", folder, "--jobs", "1", "--json").done().out)
    assert (facts["evaluated"], facts["solved"]) == (CLASSES, CLASSES)
    return folder


def table(folder: Path, name: str = "results.csv") -> pd.DataFrame:
    """A table of a folder as text, without what clocks decide."""
    return pd.read_csv(folder / name, dtype=str, keep_default_na=False).drop(columns="seconds")


Row = tuple[Any, ...]


def records(folder: Path, columns: str = "*") -> list[Row]:
    """The evaluations on record, in order; also while a run writes them, or after it was killed."""
    if not (folder / "records.sqlite3").exists():
        return []
    file = sqlite3.connect(folder / "records.sqlite3")
    try:
        return file.execute(f"SELECT {columns} FROM evaluations").fetchall()
    except sqlite3.OperationalError:  # no table yet
        return []
    finally:
        file.close()


def labellings(found: list[Row]) -> list[bytes]:
    return [row[1] for row in found]


@contextmanager
def started(*arguments: str | Path, pictures: bool = False) -> Iterator[subprocess.Popen[str]]:
    """`jld` in a session of its own; whatever is left of it is gone at the end."""
    run = subprocess.Popen(
        command(*arguments, pictures=pictures),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
    )
    family: list[psutil.Process] = []
    try:
        yield run
    finally:
        if run.poll() is None:
            family = psutil.Process(run.pid).children(recursive=True)
            run.kill()
        run.communicate()
        for child in family:
            if child.is_running():
                child.kill()


def wait_for_records(run: subprocess.Popen[str], folder: Path, count: int) -> None:
    """Until so many records are on disk, or the run is over."""
    end = time.monotonic() + 240.0
    while run.poll() is None and time.monotonic() < end:
        if folder.exists() and (records(folder, "count(*)") or [(0,)])[0][0] >= count:
            return
        time.sleep(0.005)
    raise AssertionError(f"{len(records(folder))} records, {count} wanted, exit code {run.returncode}")


def wait_until_gone(family: list[psutil.Process], seconds: float = 20.0) -> None:
    _, alive = psutil.wait_procs(family, timeout=seconds)
    for orphan in alive:
        orphan.kill()
    assert not alive, f"{len(alive)} processes outlived the run"


def resumed(jld: Command, scene: Path, folder: Path, jobs: int, deferred_signals: Path) -> None:
    """Go on to the end in this process; nothing that was on disk may have been evaluated again."""
    before = records(folder)
    outcome = jld(*EXPLORE, scene, "--out", folder, "--jobs", str(jobs), "--resume", "--json").done()
    facts: dict[str, Any] = json.loads(outcome.out)
    after = records(folder)
    assert after[: len(before)] == before
    assert len(set(labellings(after))) == len(after) == CLASSES
    assert facts["solved"] + len(before) == CLASSES
    assert facts["stop_reason"] == "exhausted"
    assert facts["proven"] is True
    pd.testing.assert_frame_equal(table(folder), table(deferred_signals))
    pd.testing.assert_frame_equal(table(folder, "pareto.csv"), table(deferred_signals, "pareto.csv"))
    assert (folder / "faces.csv").read_bytes() == (deferred_signals / "faces.csv").read_bytes()


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize(
    ("jobs", "moments"),
    [(1, (250,)), *(pytest.param(*more, marks=pytest.mark.long) for more in ((1, (1, 250)), (2, (150,))))],
)
def test_parent_killed(
    jobs: int, moments: tuple[int, ...], scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command
) -> None:
    """kill -9 of the parent, again and again in one folder; its workers do not outlive it."""
    folder = tmp_path / "out"
    for count in moments:
        with started(
            *EXPLORE, scene, "--out", folder, "--jobs", str(jobs), *(["--resume"] if folder.exists() else [])
        ) as run:
            wait_for_records(run, folder, count)
            family = psutil.Process(run.pid).children(recursive=True)
            run.send_signal(signal.SIGKILL)
            assert run.wait(timeout=120) == -signal.SIGKILL
        assert len(records(folder)) >= count
        wait_until_gone(family)
    assert 0 < len(records(folder)) < CLASSES
    resumed(jld, scene, folder, jobs, deferred_signals)


def workers_of(run: subprocess.Popen[str]) -> list[psutil.Process]:
    """Worker processes of a run, without joblib's own helpers."""
    children = psutil.Process(run.pid).children(recursive=True)
    workers = []
    for child in children:
        with contextlib.suppress(psutil.NoSuchProcess):  # one that was killed before may be a zombie still
            if "resource_tracker" not in " ".join(child.cmdline()):
                workers.append(child)
    return workers


@pytest.mark.long  # one killed worker costs nothing in tests/explore/test_workers.py
@pytest.mark.parametrize("moments", [(64,), (64, 480)], ids=["once", "twice"])
def test_workers_killed(moments: tuple[int, ...], scene: Path, deferred_signals: Path, tmp_path: Path) -> None:
    """kill -9 of one worker, once or twice: the run goes on to the end by itself, and loses nothing."""
    folder = tmp_path / "out"
    with started(*EXPLORE, scene, "--out", folder, "--jobs", "2", "--json") as run:
        for count in moments:
            wait_for_records(run, folder, count)
            victims = workers_of(run)
            assert victims
            victims[0].kill()
        out, err = run.communicate(timeout=240)
    assert run.returncode == 0, err
    facts = json.loads(out)
    assert (facts["evaluated"], facts["solved"]) == (CLASSES, CLASSES)
    assert "failed" not in facts["counts_by_status"]
    pd.testing.assert_frame_equal(table(folder), table(deferred_signals))


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.long
def test_worker_and_parent_killed(scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command) -> None:
    folder = tmp_path / "out"
    with started(*EXPLORE, scene, "--out", folder, "--jobs", "2") as run:
        wait_for_records(run, folder, 150)
        family = psutil.Process(run.pid).children(recursive=True)
        workers_of(run)[0].kill()
        run.kill()
        run.wait(timeout=120)
    wait_until_gone(family)
    resumed(jld, scene, folder, 1, deferred_signals)


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.long
def test_random_kills(scene: Path, tmp_path: Path, jld: Command) -> None:
    """kill -9 of the parent or of a worker at random moments of a search that learns: nothing finished is lost, and
    the table is that of a run that nothing disturbs."""
    budget = CLASSES - 20
    asked = (*EXPLORE, scene, "--driver", "genetic", "--budget", str(budget))
    jld(*asked, "--out", tmp_path / "alone", "--jobs", "1").done()
    folder, rng, kills = tmp_path / "out", random.Random(20), 0
    kept: list[Row] = []
    while kills < KILLS:
        more = ["--resume"] if folder.exists() else []
        with started(*asked, "--out", folder, "--jobs", "2", *more) as run:
            worker_died = False
            while kills < KILLS:
                wait_for_records(run, folder, len(records(folder)) + rng.randrange(20))
                time.sleep(0.02 * rng.random())
                family = psutil.Process(run.pid).children(recursive=True)
                workers = workers_of(run)
                # a second death of the same labellings in one run would rightly be recorded as theirs
                victim = rng.choice(workers) if workers and not worker_died and rng.random() < 0.7 else run
                victim.kill()
                kills += 1
                if victim is run:
                    run.wait(timeout=120)
                    wait_until_gone(family)
                    break
                worker_died = True
        assert records(folder)[: len(kept)] == kept
        kept = records(folder)
    done = jld(*asked, "--out", folder, "--jobs", "2", "--resume", "--json").done()
    assert records(folder)[: len(kept)] == kept
    assert len(set(labellings(records(folder)))) == len(records(folder)) == budget
    assert json.loads(done.out)["solved"] == budget - len(kept)
    pd.testing.assert_frame_equal(table(folder), table(tmp_path / "alone"))


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize(
    ("number", "jobs"),
    [*(pytest.param(one, 1, marks=pytest.mark.long) for one in (signal.SIGTERM, signal.SIGHUP)), (signal.SIGINT, 2)],
    ids=["SIGTERM-1", "SIGHUP-1", "SIGINT-2"],
)
def test_signals(
    number: signal.Signals, jobs: int, scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command
) -> None:
    """Exit code 3, one line, tables of what was finished, and a folder to go on with."""
    folder = tmp_path / "out"
    with started(*EXPLORE, scene, "--out", folder, "--jobs", str(jobs), pictures=number == signal.SIGTERM) as run:
        wait_for_records(run, folder, 100)
        family = psutil.Process(run.pid).children(recursive=True)
        if jobs == 1:
            run.send_signal(number)
        else:
            os.killpg(run.pid, number)  # as a terminal does it: to the workers as well
        _, err = run.communicate(timeout=120)
    assert run.returncode == 3, err
    assert err.count("\n") == 1
    assert "--resume" in err
    wait_until_gone(family)
    finished = records(folder)
    assert 100 <= len(finished) < CLASSES
    assert len(table(folder)) == len(finished)
    facts = json.loads((folder / "summary.json").read_text())
    assert (facts["stop_reason"], facts["evaluated"]) == ("interrupted", len(finished))
    # stopped before the end it is proven only where its best meets the bound known beforehand
    assert facts["proven"] is (facts["gap"] is not None and facts["gap"] <= 1e-6)
    resumed(jld, scene, folder, 1, deferred_signals)


def copy_of(folder: Path, target: Path) -> Path:
    target.mkdir()
    (target / "records.sqlite3").write_bytes((folder / "records.sqlite3").read_bytes())
    return target


def test_torn_or_damaged(scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command) -> None:
    """A record that is cut, overwritten or no record at all is named in one line, and left as it is."""
    content = (deferred_signals / "records.sqlite3").read_bytes()
    rng = random.Random(11)
    half = len(content) // 2
    broken = [content[:half], content[:half] + rng.randbytes(half), b"{}", rng.randbytes(5000)]
    for number, text in enumerate(broken):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "records.sqlite3").write_bytes(text)
        outcome = jld(*EXPLORE, scene, "--out", folder, "--resume", "--jobs", "1", "--json")
        assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
        assert outcome.err.startswith(f"jld: {folder / 'records.sqlite3'}: it is damaged")
        assert [path.name for path in folder.iterdir()] == ["records.sqlite3"]


@pytest.mark.usefixtures("without_pictures")
def test_begun_and_nothing_more(scene: Path, tmp_path: Path, jld: Command) -> None:
    """Killed before anything was written: nothing was finished, and --resume begins."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "records.sqlite3").write_bytes(b"")
    outcome = jld(*(*EXPLORE, scene, "--out", folder, "--resume"), *("--jobs", "1", "--budget", "5", "--json")).done()
    assert json.loads(outcome.out)["solved"] == 5


def test_a_second_process_is_refused(scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command) -> None:
    """While one is at work in a folder, another one is told so in one line; the first does not notice."""
    folder = tmp_path / "out"
    with started(*EXPLORE, scene, "--out", folder, "--jobs", "1", "--json") as run:
        wait_for_records(run, folder, 20)
        run.send_signal(signal.SIGSTOP)
        second = jld(*EXPLORE, scene, "--out", folder, "--jobs", "1", "--resume", "--json")
        run.send_signal(signal.SIGCONT)
        out, err = run.communicate(timeout=240)
    assert (second.code, second.out, second.err.count("\n")) == (2, "", 1)
    assert f"{folder}: another process is at work in it" in second.err
    assert run.returncode == 0, err
    assert json.loads(out)["evaluated"] == CLASSES
    pd.testing.assert_frame_equal(table(folder), table(deferred_signals))


@pytest.mark.usefixtures("without_pictures")
def test_budget(scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command) -> None:
    """Distinct classes evaluated at the most; raised step by step it gives what it gives at once."""

    def run(folder: Path, *options: str) -> dict[str, Any]:
        outcome = jld(*EXPLORE, scene, "--out", folder, "--jobs", "1", "--json", *options).done()
        facts: dict[str, Any] = json.loads(outcome.out)
        return facts

    steps, once = tmp_path / "steps", tmp_path / "once"
    first = run(steps, "--budget", "70")
    assert (first["stop_reason"], first["evaluated"], first["solved"]) == ("budget", 70, 70)
    # stopped before the end it is proven only where its best meets the bound known beforehand
    assert first["proven"] is (first["gap"] is not None and first["gap"] <= 1e-6)
    again = run(steps, "--budget", "70", "--resume")
    assert (again["stop_reason"], again["evaluated"], again["solved"]) == ("budget", 70, 0)
    more = run(steps, "--budget", "201", "--resume")
    assert (more["evaluated"], more["solved"]) == (201, 131)
    assert run(once, "--budget", "201")["solved"] == 201
    pd.testing.assert_frame_equal(table(steps), table(once))
    last = run(steps, "--resume", "--budget", str(10 * CLASSES))
    assert (last["stop_reason"], last["evaluated"], last["proven"]) == ("exhausted", CLASSES, True)
    pd.testing.assert_frame_equal(table(steps), table(deferred_signals))


def other_scene(scene: Path, tmp_path: Path) -> Path:
    document = json.loads(scene.read_text())
    document["materials"]["density"] += 1
    return saved(tmp_path / "other.json", document)


def test_another_study_is_refused(scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command) -> None:
    """--resume with another seed, scene or driver names what differs, and leaves the folder as it is."""
    folder = copy_of(deferred_signals, tmp_path / "out")
    content = (folder / "records.sqlite3").read_bytes()
    tries: list[tuple[str, list[str | Path]]] = [
        ("seed", [scene, "--seed", "4"]),
        ("scene", [other_scene(scene, tmp_path)]),
        ("objective", [scene, "--objective", "zero-dilation"]),  # not times that follow from it
    ]
    tries += [("driver", [scene, "--driver", name]) for name in DRIVERS if name != "enumeration"][:1]
    for word, arguments in tries:
        outcome: Outcome = jld(*EXPLORE, *arguments, "--out", folder, "--resume", "--jobs", "1")
        assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
        assert f"{folder / 'records.sqlite3'}: it was made with {word} " in outcome.err
        assert f"expected the same {word} to resume" in outcome.err
        assert [path.name for path in folder.iterdir()] == ["records.sqlite3"]
        assert (folder / "records.sqlite3").read_bytes() == content
    jld(*EXPLORE, scene, "--out", folder).refused("--resume")


@pytest.mark.usefixtures("without_pictures")
def test_notes_may_change_between_runs(scene: Path, deferred_signals: Path, tmp_path: Path, jld: Command) -> None:
    """What the numbers do not depend on does not stand in the way of going on."""
    folder = copy_of(deferred_signals, tmp_path / "out")
    document = {**json.loads(scene.read_text()), "name": "renamed", "notes": "seen again"}
    file = saved(tmp_path / "renamed.json", document)
    outcome = jld(*EXPLORE, file, "--out", folder, "--resume", "--jobs", "1", "--json")
    assert (outcome.code, json.loads(outcome.out)["solved"]) == (0, 0)


def test_nothing_but_the_summary_is_printed(deferred_signals: Path) -> None:
    """What --json printed is what summary.json holds, and pictures are there."""
    facts = json.loads((deferred_signals / "summary.json").read_text())
    assert facts["classes"] == facts["evaluated"] == CLASSES
    for name in ("pareto.png", "best.png"):
        assert (deferred_signals / name).read_bytes().startswith(b"\x89PNG")
    parquet = pd.read_parquet(deferred_signals / "results.parquet")
    numbers = pd.read_csv(deferred_signals / "results.csv")
    assert parquet["labelling"].tolist() == numbers["labelling"].tolist()
    assert parquet["load_factor"].tolist() == pytest.approx(numbers["load_factor"].tolist(), rel=1e-12)
