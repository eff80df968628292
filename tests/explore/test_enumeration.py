"""Enumeration against brute force over all 2^m labellings, and against known numbers."""

from __future__ import annotations

import itertools
import json
import os
import pwd
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState
from pydantic import Field

from cases import canonical, dry_and_inner, every_layout, grid_document, space_of
from command import Command, refused, saved
from jld_core import InputError, Scene, Status, build_assembly, load_scene, parse_scene
from jld_explore import Driver, Evaluation, ExploreSettings, SearchSpace, explore, search_space
from jld_explore.drivers import DRIVERS, DriverOptions
from jld_explore.space import feasible, to_string

ROOT = Path(__file__).parents[2]
DOWN = [{"body": [0, -1]}]
CELL = 1400 * 9.81 * 0.1**3


def grid_space(rows: list[str], live: Any = None, **search: Any) -> SearchSpace:
    return space_of(grid_document(rows, live=live, **search), allow_empty=True)


def in_space(space: SearchSpace, labels: tuple[bool, ...]) -> bool:
    """The rules of docs/scene.md, one labelling at a time, in plain Python."""
    assembly, search = space.assembly, space.search
    elements, faces = assembly.elements, assembly.interfaces
    name = list(range(len(elements)))

    def root(i: int) -> int:
        while name[i] != i:
            i = name[i]
        return i

    links = [(a, b) for a, b, dry in zip(faces.a.tolist(), faces.b.tolist(), labels, strict=True) if not dry]
    for a, b in links + [tuple(pair) for pair in space.graph.touching.tolist()]:
        name[root(a)] = root(b)
    if search.segmentation and any(
        dry and root(a) == root(b) for a, b, dry in zip(faces.a.tolist(), faces.b.tolist(), labels, strict=True)
    ):
        return False
    members: dict[int, list[int]] = {}
    for element in elements.free.tolist():
        members.setdefault(root(element), []).append(element)

    def ok(value: float, bounds: Any) -> bool:
        low, high = bounds
        return (low is None or value >= low - 1e-9 * abs(low)) and (high is None or value <= high + 1e-9 * abs(high))

    for block in members.values():
        corners = np.vstack([elements.shape[i] for i in block])
        weight = sum(float(np.linalg.norm(elements.weight[i])) for i in block)
        extent = float(np.ptp(corners, axis=0).max())
        if not (ok(len(block), search.block_cells) and ok(weight, search.block_weight)):
            return False
        if not ok(extent, search.block_extent):
            return False
    dry = sum(d and f for d, f in zip(labels, assembly.free_faces.tolist(), strict=True))
    return ok(len(members), search.blocks) and ok(dry, search.dry_faces)


def brute_force(space: SearchSpace) -> list[str]:
    choices = [(False, True) if c else (bool(f),) for c, f in zip(space.candidates, space.fixed, strict=True)]
    return sorted(to_string(np.array(row)) for row in itertools.product(*choices) if in_space(space, row))


def everything(space: SearchSpace, rows: int | None = None) -> tuple[np.ndarray, list[int]]:
    parts = list(DRIVERS["enumeration"](space, rows=rows).batches())
    labellings = [labels for labels, _ in parts] or [np.empty((0, len(space.fixed)), dtype=bool)]
    return np.concatenate(labellings), [n for _, multiplicity in parts for n in multiplicity.tolist()]


def sizes(driver: Any) -> tuple[int, int]:
    """Labellings and classes that enumeration counts."""
    return driver.count().labellings, driver.count().classes


def check(space: SearchSpace) -> int:
    """Enumeration and brute force agree on labellings, classes and multiplicities; how many there are."""
    expected = brute_force(space)
    found, multiplicity = everything(space)
    assert feasible(space, found).all()
    assert np.array_equal(canonical(found, space.group), found)
    images = [sorted({to_string(row[g]) for g in space.group}) for row in found]
    assert [len(image) for image in images] == multiplicity
    assert sorted(itertools.chain(*images)) == expected
    assert sizes(DRIVERS["enumeration"](space)) == (len(expected), len(found))
    return len(expected)


LIMITS: list[dict[str, Any]] = [
    {},
    {"segmentation": False},
    {"candidates": "all+supports"},
    {"candidates": "all+supports", "block_cells": [1, 3], "blocks": [2, 3]},
    {"candidates": "all+supports", "segmentation": False, "blocks": [2, 4]},
    {"block_cells": [2, None]},
    {"block_cells": [2, 4]},
    {"block_cells": [3, 3]},
    {"block_cells": [2, 3], "segmentation": False},
    {"blocks": [None, 2]},
    {"blocks": [3, 4]},
    {"dry_faces": [3, 5]},
    {"dry_faces": [1, 3], "segmentation": False},
    {"block_weight": [2 * CELL, 4 * CELL]},
    {"block_extent": [None, 0.2]},
    {"block_extent": [0.2, 0.2]},
    {"block_extent": [0.2, None], "blocks": [2, 3], "dry_faces": [2, 6]},
    {"candidates": "inside-blocks"},
    {"candidates": [["c0r0", "c1r0"], ["c0r0", "c0r1"], ["c0r1", "c0r2"], ["c1r1", "c1r2"]]},
    {"keep": {"dry": [["c1r0", "c1r1"]], "inner": [["c0r0", "c0r1"]]}},
    {"keep": {"dry": [["c1r0", "c1r1"]], "inner": [["c0r1", "c0r2"]]}, "candidates": "all+supports"},
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("live", [None, DOWN], ids=["asymmetric", "symmetric"])
@pytest.mark.parametrize("search", LIMITS, ids=str)
def test_brute_force_on_a_wall(search: dict[str, Any], live: Any) -> None:
    assert check(grid_space(["aab", "cab", "###"], live, **search)) > 0


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "search", [s for s in LIMITS if "keep" not in s and not isinstance(s.get("candidates"), list)], ids=str
)
def test_brute_force_on_a_bridge(search: dict[str, Any]) -> None:
    space = grid_space(["aaaa", "b..b", "#..#"], DOWN, **search)
    assert len(space.group) == 2
    assert check(space) > 0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.data())
def test_brute_force_on_random_shapes_and_limits(data: st.DataObject) -> None:
    rows = ["".join(data.draw(st.sampled_from("ab.#"), label="cell") for _ in range(3)) for _ in range(3)]
    bound = st.none() | st.integers(0, 5)

    def limits() -> list[int | None]:
        low, high = data.draw(bound), data.draw(bound)
        return sorted((low, high)) if low is not None and high is not None else [low, high]

    search: dict[str, Any] = {
        key: limits() for key in ("block_cells", "blocks", "dry_faces") if data.draw(st.booleans())
    }
    search["segmentation"] = data.draw(st.booleans())
    search["candidates"] = data.draw(st.sampled_from(["all", "all+supports", "inside-blocks"]))
    live = data.draw(st.sampled_from([None, DOWN]))
    plain = {k: v for k, v in search.items() if k in ("segmentation", "candidates")}
    try:
        loose = grid_space(rows, live, **plain)
    except InputError:
        return
    try:
        check(grid_space(rows, live, **search))
    except InputError:
        # refused limits are those that nothing satisfies
        strict = parse_scene(grid_document(rows, live=live, **search)).search
        space = SearchSpace(**{**vars(loose), "search": strict})
        assert brute_force(space) == []


def triangles() -> dict[str, Any]:
    """A square of four triangles on two supports that share a corner only, and a lid with two faces to it."""
    shapes = {
        "west": [[0, 0], [1, 1], [0, 2]],
        "south": [[0, 0], [2, 0], [1, 1]],
        "east": [[2, 0], [2, 2], [1, 1]],
        "north": [[0, 2], [1, 1], [2, 2]],
        "lid": [[-1, 1], [0, 1], [0, 2], [2, 2], [2, 1], [3, 1], [3, 3], [-1, 3]],
        "left": [[-1, 0], [0, 0], [0, 1], [-1, 1]],
        "right": [[2, 0], [3, 0], [3, 1], [2, 1]],
        "base": [[0, -1], [2, -1], [2, 0], [0, 0]],
    }
    document = grid_document(["a", "#"], live=DOWN)
    del document["grid"]
    supports = ("left", "right", "base")
    document["elements"] = [{"id": k, "polygon": v, "support": k in supports} for k, v in shapes.items()]
    return document


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "search",
    [
        {},
        {"candidates": "all+supports"},
        {"candidates": "all+supports", "segmentation": False},
        {"block_weight": [None, 9e4], "block_cells": [1, 3]},
        {"block_extent": [2.5, 4.0], "candidates": "all+supports"},
        {"blocks": [2, 3], "candidates": "all+supports", "keep": {"dry": [["lid", "north"]]}},
    ],
    ids=str,
)
def test_brute_force_on_polygons(search: dict[str, Any]) -> None:
    space = space_of(triangles() | {"search": search})
    assert len(space.group) == 2
    assert check(space) > 0


@pytest.mark.parametrize("segmentation", [True, False])
def test_several_faces_between_two_elements(segmentation: bool) -> None:
    shapes = {
        "corner": [[0, 1], [3, 1], [3, 2], [1, 2], [1, 3], [0, 3]],
        "fill": [[1, 2], [3, 2], [3, 3], [1, 3]],
        "base": [[0, 0], [3, 0], [3, 1], [0, 1]],
    }
    document = grid_document(["a", "#"], live=DOWN, segmentation=segmentation)
    del document["grid"]
    document["elements"] = [{"id": k, "polygon": v, "support": k == "base"} for k, v in shapes.items()]
    space = space_of(document)
    assert space.candidates.sum() == 2
    assert check(space) == (2 if segmentation else 4)


@pytest.mark.parametrize(
    ("side", "number"), [(1, 1), (2, 12), (3, 1434), pytest.param(4, 1691690, marks=pytest.mark.long)]
)
def test_connected_partitions_of_square_grids(side: int, number: int) -> None:
    space = grid_space(["a" * side] * side + ["#" * side], DOWN)
    tally = DRIVERS["enumeration"](space).count()
    assert tally.labellings == number
    plain = grid_space(["a" * side] * side + ["#" * side], DOWN, symmetry="none")
    assert sizes(DRIVERS["enumeration"](plain)) == (number, number)


@pytest.mark.parametrize(
    ("rows", "cells", "number"),
    [
        (["a" * 4] * 6, 2, 281),
        (["a" * 6] * 6, 2, 6728),
        (["a" * 5] * 5, 5, 4006),
        pytest.param(["a" * 6] * 6, 3, 80092, marks=pytest.mark.long),
    ],
)
def test_known_partitions_into_equal_blocks(rows: list[str], cells: int, number: int) -> None:
    space = grid_space([*rows, "#" * len(rows[0])], block_cells=[cells, cells])
    assert DRIVERS["enumeration"](space).count().labellings == number


def flagship() -> SearchSpace:
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    return search_space(scene, build_assembly(scene))


def test_flagship_counts() -> None:
    driver = DRIVERS["enumeration"](flagship())
    assert sizes(driver) == (12694, 6382)
    assert driver.size_up_to(6382) == 6382
    assert driver.size_up_to(6381) is None


def test_order_depends_on_the_space_alone() -> None:
    space = flagship()
    whole = everything(space)[0]
    assert np.array_equal(everything(space, rows=97)[0], whole)
    for portions in ([1, 3, 500, 10000, 1], [None], [6382]):
        driver, parts = DRIVERS["enumeration"](space), []
        for limit in itertools.cycle(portions):
            driver.count()  # looking at the whole does not disturb the asking
            part = driver.ask(limit)
            assert limit is None or len(part) <= limit
            driver.tell(part, [Evaluation(Status.FAILED, *[np.nan] * 3)] * len(part))
            if len(part) == 0:
                break
            parts.append(part)
            if sum(map(len, parts)) > 3000 and portions != [None]:
                break
        got = np.concatenate(parts)
        assert np.array_equal(got, whole[: len(got)])
        if portions == [None]:
            assert len(got) == len(whole)
    assert len(driver.ask(0)) == 0


@pytest.mark.long
def test_large_spaces_are_called_large_at_once() -> None:
    space = grid_space(["a" * 7] * 7 + ["#" * 7], block_cells=[2, 3])
    assert DRIVERS["enumeration"](space).size_up_to(2000) is None
    assert len(DRIVERS["enumeration"](space).ask(5)) == 5


def test_a_space_with_one_labelling() -> None:
    space = grid_space(["a", "#"])
    driver = DRIVERS["enumeration"](space)
    assert sizes(driver) == (1, 1)
    assert np.array_equal(driver.ask(), space.fixed[None])
    assert len(driver.ask()) == 0


# A driver of one's own: handed in or by name, with options, facts and a record to go on with.


class BackwardsOptions(DriverOptions):
    step: int = Field(5, ge=1, description="labellings asked at a time")


class Backwards(Driver):
    """Enumeration from its far end, some at a time."""

    name = "backwards"
    Options = BackwardsOptions

    def __init__(self, space: SearchSpace, seed: int = 0, step: int = 5) -> None:
        super().__init__(space, seed)
        self.left = every_layout(space)[::-1]
        self.step, self.told = step, 0

    @property
    def settings(self) -> dict[str, Any]:
        return {"step": self.step}

    def ask(self, limit: int | None = None) -> np.ndarray:
        count = self.step if limit is None else min(limit, self.step)
        rows, self.left = self.left[:count], self.left[count:]
        return rows

    def tell(self, labellings: np.ndarray, evaluations: Sequence[Evaluation]) -> None:
        self.told += len(evaluations)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        return {"told": self.told, "rows": len(results), "complete": complete}


def scene() -> Scene:
    return parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))


def own_space(found: Scene) -> SearchSpace:
    return search_space(found, build_assembly(found))


def run(folder: Path, driver: Any, **settings: Any) -> Any:
    return explore(scene(), folder, ExploreSettings(pictures=False, **settings), driver=driver)


def plain(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=["seconds", "driver"])


@pytest.fixture
def named() -> Iterator[None]:
    DRIVERS[Backwards.name] = Backwards
    yield
    del DRIVERS[Backwards.name]


def test_a_driver_object_can_be_given_to_explore(tmp_path: Path) -> None:
    every = run(tmp_path / "every", "enumeration")
    done = run(tmp_path / "own", Backwards(own_space(scene())))
    pd.testing.assert_frame_equal(plain(done.results), plain(every.results))
    assert set(done.results["driver"]) == {"backwards"}
    facts = done.summary.facts
    assert (facts["driver"], facts["told"], facts["rows"]) == ("backwards", *[len(every.results)] * 2)
    # it has never said that it goes through everything, but every class that was counted is known
    assert (facts["stop_reason"], facts["proven"], facts["complete"]) == ("exhausted", True, True)


def test_a_search_with_an_own_driver_is_resumed(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", Backwards(own_space(scene())), budget=40)
    run(tmp_path / "part", Backwards(own_space(scene())), budget=15)
    rest = run(tmp_path / "part", Backwards(own_space(scene())), budget=40, resume=True)
    assert rest.summary.solved == 25
    pd.testing.assert_frame_equal(plain(rest.results), plain(whole.results))
    with pytest.raises(InputError, match="driver's step 5, not 6"):
        run(tmp_path / "part", Backwards(own_space(scene()), step=6), resume=True)


def test_a_driver_of_another_scene_is_refused(tmp_path: Path) -> None:
    other = parse_scene(grid_document(["aaaa", "####"], block_cells=[1, 3]))
    with pytest.raises(InputError, match="made for the space of another scene"):
        run(tmp_path / "out", Backwards(own_space(other)))
    assert not (tmp_path / "out").exists()


def test_a_registered_driver_is_used_by_its_name(named: None, tmp_path: Path) -> None:
    done = run(tmp_path / "out", "backwards", options={"step": 7})
    assert done.summary.driver == "backwards"
    for options, words in (
        ({"step": 0}, "step: 0 is wrong; expected a whole number greater than or equal to 1"),
        ({"step": "many"}, "step: 'many' is wrong; expected a whole number"),
        ({"aim": "best"}, 'aim: the driver backwards has no such option; expected `driver="genetic"` or `driver='),
        ({"stride": 2}, "stride: the driver backwards has no such option"),
    ):
        with refused(words):
            run(tmp_path / "bad", "backwards", options=options)
    assert not (tmp_path / "bad").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--driver", "genetic", "--population", "2"], ("--population: '2' is wrong", "greater than or equal to 4")),
        (["--driver", "genetic", "--population", "few"], ("--population: 'few' is wrong", "a whole number")),
        (["--driver", "exact", "--aim", "both"], ("--aim: 'both' is wrong", "one of best or front")),
        (["--driver", "random", "--sampler", "TPE"], ("--sampler", "no such option", "--driver optuna")),
        (["--driver", "optuna", "--sampler", "dice"], ("--sampler: no sampler is named 'dice'",)),
        (["--driver", "hillclimb", "--start", "dd"], ("letters d or i",)),
    ],
)
def test_errors_of_options_follow_from_the_driver(
    options: list[str], words: tuple[str, ...], tmp_path: Path, jld: Command
) -> None:
    file = saved(tmp_path / "scene.json", scene())
    outcome = jld("explore", file, "--out", tmp_path / "out", *options)
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    for word in words:
        assert word in outcome.err
    assert not (tmp_path / "out").exists()


def test_help_follows_from_the_drivers(tmp_path: Path, jld: Command) -> None:
    said = " ".join(jld("explore", "--help").out.split())
    for kind in DRIVERS.values():
        for name, field in kind.Options.model_fields.items():
            assert f"--{name}" in said
            assert str(field.description) in said


# The optuna driver: its journal survives a kill, and processes share a server.


SCENE = {
    "grid": {"cell": [1, 1], "thickness": 1, "rows": ["aab", "ccb", "###"]},
    "materials": dry_and_inner(2000, 0.6, 1e5, 1e5),
    "loads": {"live": [{"body": [1, 0]}]},
}


def searched(folder: Path, budget: int) -> None:
    settings = ExploreSettings(driver="optuna", jobs=1, budget=budget, resume=folder.exists(), pictures=False)
    explore(parse_scene(SCENE), folder, settings)


def trials(folder: Path) -> list[tuple[int, str | None, dict[str, float]]]:
    study = optuna.load_study(
        study_name=None, storage=JournalStorage(JournalFileBackend(str(folder / "optuna.journal")))
    )
    return [(trial.number, trial.user_attrs.get("labelling"), trial.params) for trial in study.trials]


@pytest.mark.long
def test_a_torn_line_and_a_lock_left_behind_are_made_good(tmp_path: Path) -> None:
    searched(tmp_path / "whole", 40)
    torn = tmp_path / "torn"
    searched(torn, 20)
    journal = torn / "optuna.journal"
    journal.write_bytes(journal.read_bytes()[:-40])
    journal.with_name(f"{'optuna.journal'}.lock").write_text("")
    searched(torn, 40)
    assert not journal.with_name(f"{'optuna.journal'}.lock").exists()
    assert trials(torn) == trials(tmp_path / "whole")


@pytest.mark.parametrize("content", [b"\x00\xffnot json\n{}\n", pytest.param(b"{}\n", marks=pytest.mark.long)])
def test_a_damaged_journal_is_written_again(content: bytes, tmp_path: Path) -> None:
    """It is a copy of what is on record, and does not stand in the way of going on."""
    searched(tmp_path / "whole", 20)
    searched(tmp_path / "a", 10)
    (tmp_path / "a" / "optuna.journal").write_bytes(content)
    searched(tmp_path / "a", 20)
    assert trials(tmp_path / "a") == trials(tmp_path / "whole")


def test_every_trial_of_a_class_is_finished() -> None:
    """Trials of a class that were asked for while another of it was evaluated stayed running for ever."""
    scene = parse_scene(SCENE)
    space = search_space(scene, build_assembly(scene))
    driver = DRIVERS["optuna"](space, 0, size=16)  # few classes: many trials propose one that is waiting
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
        running.wait(120)
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

    scene = saved(tmp_path / "scene.json", grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))
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
