"""The state of a proof shared by threads, the check at its end, and bounds that are contradicted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from benchmarks.claims import run as run_claim
from benchmarks.claims import searches
from joblib.externals.loky.process_executor import TerminatedWorkerError

from cases import dry_and_inner, grid_document, replace_processes
from jld_core import Scene, build_assembly, parse_scene
from jld_core.batch import batch_solver, chosen
from jld_core.limit import case_relaxation
from jld_explore import Driver, Exploration, ExploreSettings, Progress, StopReason, explore, search_space
from jld_explore.drivers import DRIVERS, make_driver
from jld_explore.evaluation import Records
from jld_explore.report import words
from jld_explore.space import count_named, from_string, values_of
from jld_explore.verification import verify

QUIET = ExploreSettings(pictures=False, small=0)
WEAK: dict[str, Any] = {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]}
LOST = {
    "grid": {"cell": [0.113, 0.173], "thickness": 0.3, "rows": ["aaaa", "aaaa", "aaaa", "aaaa", "####"]},
    "materials": dry_and_inner(2000, 0.6, 4000.0, 4000.0),
    "loads": {"live": [{"body": [1.0, -0.1]}]},
    "search": {"block_cells": [1, 4], "front": {"count": "blocks", "sense": "max"}},
}
"""A scene of which version 0.2 proved 0.5122 with two jobs in four of five runs."""
FLIPPED = {
    "grid": {"cell": [0.3, 0.3], "thickness": 0.3, "rows": ["aaaa", "aaaa", "aaaa", "####"]},
    "materials": dry_and_inner(2000, 0.6, 2e4, 2e4),
    "loads": {"live": [{"body": [0.3, -1]}]},
    "search": {"shapes": [None, 1], "moulds": {"flip": True}, "block_cells": [3, 4]},
}
"""A scene of which version 0.2 proved 7.5509 by enumeration and 22.6526 by conflicts."""


@pytest.fixture
def _switching() -> Iterator[None]:
    """Let threads be interrupted as often as the interpreter can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def search(document: dict[str, Any], folder: Path, **options: Any) -> tuple[Exploration, Any]:
    """Prove with two jobs, unless said otherwise, and hardly any search before the proof."""
    scene = parse_scene(document)
    settings = replace(QUIET, jobs=options.pop("jobs", 2), resume=options.pop("resume", False))
    driver = DRIVERS["exact"](search_space(scene, build_assembly(scene)), **{"search": 0, **options})
    return explore(scene, folder, settings, driver=driver), driver


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A conflict of possible blocks, from which tests make others."""
    document = grid_document([*["aaa"] * 3, "###"], **WEAK)
    _, driver = search(document, tmp_path_factory.mktemp("known") / "out", jobs=1, by_blocks="on")
    return next(one for one in driver.state.conflicts if one.by_possible_blocks)


@pytest.mark.parametrize("step_after", [None, *(pytest.param(one, marks=pytest.mark.long) for one in (1, 20))])
def test_no_layout_is_lost_when_the_target_changes(step_after: int | None, tmp_path: Path) -> None:
    done, _ = search(LOST, tmp_path / "out", step_after=step_after)
    assert done.summary.proven is True
    assert done.summary.best == pytest.approx(0.522868698, rel=2e-6)
    assert done.summary.facts["proof_check"]["passed"] is True


def test_proofs_agree_with_enumeration_and_one_job(monkeypatch: pytest.MonkeyPatch) -> None:
    """A share of `python -m benchmarks.claims proofs`: three of its cases, however busy the machine is."""
    monkeypatch.setattr(searches, "EVERY", 10**9)  # real processes take seconds to start
    found = run_claim("proofs", 20_000, 3, 600.0)
    assert found.cases == 3
    assert found.disagreements == []


def test_mirrored_blocks_have_one_shape_in_every_order(tmp_path: Path) -> None:
    scene = parse_scene(FLIPPED)
    every = explore(scene, tmp_path / "every", replace(QUIET, driver="enumeration"))
    done, _ = search(FLIPPED, tmp_path / "exact")
    assert every.summary.best == pytest.approx(done.summary.best, rel=1e-9)
    rows = np.array([from_string(text) for text in every.results["labelling"]])
    for order in (rows, rows[::-1]):
        space = search_space(scene, build_assembly(scene))  # which knows no shape of a block yet
        shapes = space.limits.block_shapes
        assert set(values_of(count_named("shapes"), space.assembly, order, shapes=shapes)) == {1}


@pytest.mark.usefixtures("_switching")
def test_every_layout_handed_over_waits_for_one_evaluation(known: Any) -> None:
    """Four threads hand over the same and other layouts while a fifth takes and evaluates them."""
    scene = parse_scene(grid_document(["aaaa", "aaaa", "####"], symmetry="none", **WEAK))
    space = search_space(scene, build_assembly(scene))
    state = DRIVERS["exact"](space).state
    rng = np.random.default_rng(1)
    rows = np.where(space.candidates, rng.random((3000, len(space.fixed))) < 0.5, space.fixed)
    taken: list[bytes] = []

    def hand_over(part: int) -> None:
        for k in range(part * 500, part * 500 + 1500):
            state.hand_over([rows[k]])
            one = replace(known, faces=np.array([k % 7]), labels=np.array([True]), bound=float(-(k % 50)))
            state.add_conflicts([one])

    threads = [threading.Thread(target=hand_over, args=(part,)) for part in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads) or len(state.without_evaluation):
        found = state.take_waiting()
        taken += [row.tobytes() for row in found]
        state.note_evaluated(found)
        time.sleep(0.0)
    assert len(taken) == len(set(taken)) == len({row.tobytes() for row in rows})
    assert {row.tobytes() for row in state.handed_over} == set(taken)
    assert state.without_evaluation == []
    bounds: dict[int, list[float]] = {}
    for conflict in state.conflicts:
        bounds.setdefault(int(conflict.faces[0]), []).append(conflict.bound)
    # of each conflict only lower bounds than known are kept
    assert all(np.all(np.diff(one) < 0.0) for one in bounds.values())
    assert {min(one) for one in bounds.values()} == {-49.0}


def test_a_proof_in_which_a_bound_was_changed_is_not_proven(
    known: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every conflict claims a third less than its mechanism proves."""
    rows = [*["aaaa"] * 3, "####"]
    true_init = type(known).__init__

    def lower(self: Any, faces: Any, labels: Any, bound: float, *more: Any, **named: Any) -> None:
        true_init(self, faces, labels, bound - 0.3 * abs(bound) if len(faces) else bound, *more, **named)

    monkeypatch.setattr(type(known), "__init__", lower)
    done, driver = search(grid_document(rows, **WEAK), tmp_path / "out", jobs=1, by_blocks="off")
    assert done.summary.proven is False
    assert driver.bound is None
    # what stands in its place was bounded anew, by one mechanism for all layouts
    assert done.summary.bound >= 0.75 - 1e-9
    assert driver.finished is False
    (line,) = [one for one in done.summary.warnings if one.startswith("not proven: ")]
    assert "mechanism" in line or "conflict allows" in line
    assert done.summary.stop_reason == "unproven"
    printed = words.exploration(done)
    assert "the proof did not pass its check" in printed
    assert line in printed


def test_a_proof_that_lost_a_layout_is_not_proven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Formulas leave out what was handed over, and its evaluation never comes: version 0.2 called that proven."""
    document = grid_document([*["aaa"] * 3, "###"], **WEAK)
    state = DRIVERS["exact"](search_space(parse_scene(document), build_assembly(document))).state

    def lose(self: Any) -> Any:
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    monkeypatch.setattr(type(state), "take_waiting", lose)
    monkeypatch.setattr(
        DRIVERS["exact"],
        "_lower_bound",
        lambda self, target, bound: self.found.update({target: replace(self.found[target], bound=bound)}),
    )
    done, _ = search(document, tmp_path / "out", jobs=1, by_blocks="off")
    assert done.summary.proven is False


def test_conflicts_that_refute_too_much_are_found(known: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the layouts that were evaluated; without any, each of blocks by a new program from its labels alone."""
    document = grid_document([*["aaaa"] * 3, "####"], **WEAK)
    done, driver = search(document, tmp_path / "out", jobs=1, by_blocks="on")
    assert done.summary.proven is True
    by_blocks = [one for one in driver.state.conflicts if one.by_possible_blocks]
    check = done.summary.facts["proof_check"]
    assert by_blocks
    assert check["weighed"] == check["conflicts"] >= len(by_blocks)
    best = np.array([letter == "d" for letter in done.summary.best_labelling])
    faces = np.flatnonzero(driver.space.candidates)[:5]
    driver.state.add_conflicts([replace(known, faces=faces, labels=best[faces], bound=0.1, by_blocks=())])
    assert "allows it 0.1" in driver._checked().problem
    nothing = np.empty((0, len(best)), dtype=bool), np.empty(0)
    monkeypatch.setattr(driver._incumbents, "strongest", lambda _: nothing)
    assert "a conflict of blocks that was to keep λ at 0.1 is not refuted" in driver._checked().problem


def test_a_bound_below_a_layout_is_withdrawn_and_proven_again(tmp_path: Path) -> None:
    """What version 0.2 left on record: a bound that a layout exceeds which is found later."""
    document = grid_document([*["aaaa"] * 3, "####"], **WEAK)
    first, driver = search(document, tmp_path / "out", jobs=1, programs=3)
    assert first.summary.proven is False
    true, _ = search(document, tmp_path / "true", jobs=1)
    records = Records(tmp_path / "out", _header(tmp_path / "out"), len(driver.space.fixed))
    records.keep_bound(0.5 * true.summary.best)
    records.close()
    again, _ = search(document, tmp_path / "out", jobs=1, resume=True)
    (line,) = [one for one in again.summary.warnings if "withdrawn" in one]
    assert "above the bound" in line
    assert again.summary.best == pytest.approx(true.summary.best, rel=1e-6)
    assert again.summary.bound == pytest.approx(true.summary.bound, rel=2e-6)
    assert again.summary.proven is True
    # the record keeps the line
    third, _ = search(document, tmp_path / "out", jobs=1, resume=True)
    assert [one for one in third.summary.warnings if "withdrawn" in one] == [line]


def _header(folder: Path) -> dict[str, Any]:
    """What a record says of itself."""
    import json
    import sqlite3

    with closing(sqlite3.connect(folder / "records.sqlite3")) as file, file:
        found = {key: json.loads(value) for key, value in file.execute("SELECT key, value FROM meta")}
    return {
        key: value for key, value in found.items() if key not in ("jld", "format", "faces", "conflicts of", "bound")
    }


@pytest.mark.skipif(chosen() is None, reason="without a compiled solver there is one thread")
def test_check_weighs_every_conflict(tmp_path: Path) -> None:
    done, _ = search(LOST, tmp_path / "out")
    assert done.summary.facts["proof_check"]["conflicts"] > 100
    assert done.summary.facts["proof_check"]["weighed"] == done.summary.facts["proof_check"]["conflicts"]


class Unproven(Driver):
    """A driver whose proof ended and did not pass its check."""

    name, checks, asked = "unproven", True, 0

    def ask(self, limit: int | None = None) -> Any:
        """Propose the layout of dry joints alone, once."""
        rows, self.asked = (self.space.fixed | self.space.candidates)[None][self.asked :], 1
        return rows

    def tell(self, labellings: Any, evaluations: Any) -> None:
        """Learn nothing."""


def test_a_bound_whose_proof_fails_its_check_is_withdrawn_at_the_end(tmp_path: Path) -> None:
    """Whoever asks before why a search ends withdraws nothing."""
    scene, folder = parse_scene(grid_document(["aa", "aa", "##"], **WEAK)), tmp_path / "out"
    space = search_space(scene, build_assembly(scene))
    withdrawn: list[list[str]] = []
    for resume in (False, True):
        if resume:
            with closing(Records(folder, _header(folder), len(space.fixed))) as records:
                withdrawn.append(records.withdrawn)
                records.keep_bound(0.7)  # above the layout's λ of 8 / 13
        done = explore(scene, folder, replace(QUIET, jobs=1, resume=resume), driver=Unproven(space))
        assert done.summary.stop_reason == StopReason.UNPROVEN
    with closing(Records(folder, _header(folder), len(space.fixed))) as records:
        assert records.bound == pytest.approx(0.75)  # of friction, for all layouts
        assert len(records.withdrawn) == len(withdrawn[0]) + 1


@pytest.mark.parametrize("lowered", [40, pytest.param(10**9, marks=pytest.mark.long)])
def test_a_bound_recorded_too_low_is_corrected(lowered: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest recomputed bound counts, and the search goes on from it to the end."""
    left, sound = [lowered], case_relaxation.Relaxation._refutations

    def low(
        self: case_relaxation.Relaxation,
        velocities: np.ndarray,
        labels: np.ndarray,
        undecided: np.ndarray,
        limits: np.ndarray,
    ) -> Any:
        found = sound(self, velocities, labels, undecided, limits)
        for k, one in enumerate(found):
            if one is not None and left[0] > 0 and 0.0 < one.bound < 1e6 and not undecided[k].all():
                left[0] -= 1
                found[k] = replace(one, bound=0.99 * one.bound)
        return found

    monkeypatch.setattr(case_relaxation.Relaxation, "_refutations", low)
    done, driver = search(LOST, tmp_path / "out", jobs=1, by_blocks="off")
    best = 0.522868698
    assert driver._corrections
    assert done.summary.proven
    assert done.summary.best == pytest.approx(best, rel=2e-6)
    assert done.summary.bound == pytest.approx(best, rel=2e-6)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(6))
def test_recorded_bounds_are_recomputed_alike(seed: int) -> None:
    """Random boxes in space with inner friction: what refutes a labelling says the same when it is weighed again."""
    rng = np.random.default_rng(seed)
    assembly = build_assembly(parse_scene(boxes(rng)))
    relaxation = case_relaxation.relaxation_of(assembly)
    free = assembly.free_faces
    labels = rng.random((40, len(free))) < rng.random((40, 1))
    labels[:, ~free] = assembly.labels[~free]
    whole = np.zeros_like(labels)
    known = [one for one in relaxation.refute_all(labels, whole, np.full(40, 1e12)) if one is not None]
    thresholds = np.array([one.bound * rng.uniform(1.02, 2.0) for one in known])
    request = batch_solver.ConflictRequest(
        labels[: len(known)], free, thresholds, how=batch_solver.MinimizationOptions(neighbours=2, tries=4)
    )
    conflicts = [one for one in relaxation.minimize_conflicts(request) if one.velocity is not None]
    assert conflicts
    for one in conflicts:
        partial = labels[one.labelling][None], (free & ~one.decided)[None]
        again = relaxation.evaluate_mechanisms(one.case, np.array([one.velocity]), *partial)[0]
        assert again == pytest.approx(one.bound, rel=1e-9)


def boxes(rng: np.random.Generator) -> dict[str, Any]:
    """A stack of boxes of random sizes on supports; inner faces have friction."""
    size, (rows, columns, courses) = rng.uniform(0.15, 0.35, 3), rng.integers([2, 1, 2], [4, 3, 4])
    elements = []
    for place in np.ndindex(int(rows), int(columns), int(courses) + 1):
        low = size * place
        corners = [(low + size * corner).tolist() for corner in np.ndindex(2, 2, 2)]
        faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        name = "e" + "".join(map(str, place))
        elements.append({"id": name, "vertices": corners, "faces": faces, "support": place[2] == 0})
    tension, shear = 10.0 ** rng.uniform(3.5, 5.5), rng.uniform(1, 4)
    inner = {"tensile_strength": tension, "shear_strength": tension * shear}
    inner["friction_coefficient"] = rng.uniform(0.2, 0.9)
    return {
        "elements": elements,
        "materials": {"density": 2000, "dry": {"friction_coefficient": rng.uniform(0.4, 0.8)}, "inner": inner},
        "loads": {"live": [{"body": [1.0, 0.2, -0.1]}]},
    }


# A proof in several processes: the same optimum and bound as by one, whoever joins, leaves or is killed on the way.


WEAKER: dict[str, Any] = {"tension": 2e3, "shear": 2e3, "block_cells": [1, 3]}
SCENES: dict[str, tuple[list[str], dict[str, Any]]] = {
    "weak": (["aaaa", "aaaa", "####"], WEAKER),
    "counts": (["aaa", "aaa", "###"], {"block_cells": [1, 3], "blocks": [3, 4], "dry_faces": [4, 6]}),
    "sizes ruled out as they occur": (["aaa", "aaa", "###"], {"block_extent": [None, 0.2], "tension": 5e3}),
    "crushing": (["aaa", "aaa", "###"], {"block_cells": [1, 3], "crush_inner": 1e5}),
    "nothing stands": (["aa.", ".aa", "..#"], {"block_cells": [1, 2], "tension": 0.0, "shear": 0.0}),
}
SOLO_PROGRAMS = ExploreSettings(pictures=False, small=0)
TWO = replace(SOLO_PROGRAMS, jobs=2)


def scene_of(rows: list[str], options: dict[str, Any]) -> Scene:
    return parse_scene(grid_document(rows, **options))


def prove(scene: Scene, folder: Path, settings: ExploreSettings = TWO, **options: Any) -> tuple[Exploration, Any]:
    """By others from the first, where there are several."""
    driver = DRIVERS["exact"](
        search_space(scene, build_assembly(scene)), **{"solo_relaxations": 0, "search": 0, **options}
    )
    return explore(scene, folder, settings, driver=driver), driver


@pytest.fixture
def _in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads in the place of processes: each takes a second or two to start."""
    replace_processes(monkeypatch)
    monkeypatch.setattr("jld_explore.drivers.exact.cube_workers.TASK_SECONDS", 0.0)


@pytest.mark.sampled(4)
@pytest.mark.usefixtures("_in_threads")
@pytest.mark.parametrize("name", SCENES)
def test_two_processes_prove_the_same_as_one(name: str, tmp_path: Path) -> None:
    scene = scene_of(*SCENES[name])
    for aim in ("best", "front"):
        one, _ = prove(scene, tmp_path / f"one {aim}", SOLO_PROGRAMS, aim=aim, by_blocks="off")
        two, driver = prove(scene, tmp_path / f"two {aim}", aim=aim, by_blocks="off")
        # the bound at the root alone may prove all
        assert driver._sources.solves > 0 or one.summary.facts["relaxations"] <= 1
        assert two.summary.proven is one.summary.proven is True
        if one.summary.best is None:
            assert two.summary.best is None
            continue
        assert two.summary.best == pytest.approx(one.summary.best, rel=1e-6)
        assert two.summary.bound == pytest.approx(one.summary.bound, rel=2e-6)
        if aim == "front":
            fronts = [
                {row["count"]: row["load_factor"] for row in done.summary.facts["best_by_count"]} for done in (one, two)
            ]
            assert fronts[1] == pytest.approx(fronts[0], rel=1e-6)


@pytest.mark.usefixtures("_in_threads")
def test_two_find_the_same_count_of_what_is_required(tmp_path: Path) -> None:
    require = {"front": {"count": "blocks", "sense": "min"}, "require": {"load_factor": 0.6}}
    scene = scene_of([*["aaaa"] * 2, "####"], {"tension": 8e3, "shear": 8e3, "block_cells": [1, 3], **require})
    found = []
    for name, settings in (("one", SOLO_PROGRAMS), ("two", TWO)):
        space = search_space(scene, build_assembly(scene))
        driver = type(make_driver("exact", space, 0))(space, search=0, solo_relaxations=0)
        found.append(explore(scene, tmp_path / name, settings, driver=driver).summary.facts["require"])
        assert (driver._sources.solves > 0) is (settings is TWO)
    assert found[0]["proven"] is found[1]["proven"] is True
    assert found[0]["best"] == found[1]["best"] is not None


@pytest.mark.usefixtures("_in_threads")
@pytest.mark.skipif(chosen() is None, reason="without a kernel one thread draws and shrinks")
def test_two_threads_prove_the_same_and_hand_over_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of([*["aaaa"] * 4, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    how: dict[str, Any] = {"solo_relaxations": None, "by_blocks": "off"}
    one, _ = prove(scene, tmp_path / "one", SOLO_PROGRAMS, **how)
    for called, jobs in ((False, 2), (True, 3)):
        if called:
            monkeypatch.setattr("jld_explore.drivers.exact.cube_workers.SOLO_RELAXATIONS", (60, 1))
        certificate = tmp_path / f"proof-{jobs}"
        two, driver = prove(scene, tmp_path / f"{jobs}", replace(TWO, jobs=jobs, certificate=certificate), **how)
        assert (driver._sources.solves > 0) is called
        assert driver.context.relaxation.solves > 60  # by threads, before others were called
        assert two.summary.proven is True
        assert two.summary.best == pytest.approx(one.summary.best, rel=1e-6)
        assert two.summary.bound == pytest.approx(one.summary.bound, rel=2e-6)
        names = [(conflict.faces.tobytes(), conflict.labels.tobytes()) for conflict in driver.state.conflicts]
        assert len(names) > 50
        assert called or len(set(names)) == len(names)  # what both threads found is kept once
        assert verify(certificate, scene).claim.bound == pytest.approx(one.summary.best, rel=2e-6)


@pytest.mark.skipif(chosen() is None, reason="without a kernel there is one thread")
def test_an_exception_in_a_thread_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise ArithmeticError("of a thread")

    monkeypatch.setattr("jld_explore.drivers.exact.conflict_generation.ConflictGenerator._add_results", broken)
    with pytest.raises(ArithmeticError, match="of a thread"):
        prove(scene_of(*SCENES["weak"]), tmp_path, solo_relaxations=None, by_blocks="off")


@pytest.mark.usefixtures("_in_threads")
def test_what_is_closed_is_on_record_and_spares_the_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # many small cubes: of the few large ones of so short a proof it is chance whether any is closed before its end
    monkeypatch.setattr("jld_explore.drivers.exact.cube_workers._CUBES_PER_WORKER", 12)
    scene = scene_of([*["aaaa"] * 4, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    whole, driver = prove(scene, tmp_path / "whole", replace(TWO, certificate=tmp_path / "proof"), by_blocks="off")
    known = driver.state.conflicts[:]
    from_cubes = [one for one in known if one.from_cube]
    assert from_cubes
    assert whole.summary.facts["conflicts"] == len(known)
    # nothing of what is closed is above its bound, by the table of all that was evaluated
    table = whole.results[whole.results["status"] == "collapse"]
    scale = driver._scale
    for text, load in zip(table["labelling"], table["bracket_lo"], strict=True):
        labels = np.array([letter == "d" for letter in text])
        for image in labels[driver.space.group]:
            for one in from_cubes:
                if (image[one.faces] == one.labels).all():
                    assert load <= one.bound * scale * (1.0 + 1e-9)
    again, _ = prove(scene, tmp_path / "whole", replace(TWO, resume=True), by_blocks="off")
    assert again.summary.proven is True
    assert again.summary.facts["relaxations"] < 0.1 * whole.summary.facts["relaxations"]
    assert again.summary.bound == pytest.approx(whole.summary.bound, rel=1e-9)
    assert verify(tmp_path / "proof", scene).claim.bound == pytest.approx(whole.summary.best, rel=2e-6)


class Mortal(ThreadPoolExecutor):
    """The first two of these die of their second task."""

    made = 0

    def __init__(self) -> None:
        super().__init__(1)
        Mortal.made += 1
        self.left = 1 if Mortal.made <= 2 else 10**9

    def submit(self, *task: Any) -> Future[Any]:
        if self.left == 0:
            dead: Future[Any] = Future()
            dead.set_exception(TerminatedWorkerError("killed"))
            return dead
        self.left -= 1
        return super().submit(*task)


def mortal(jobs: int) -> ThreadPoolExecutor:
    """Those of one worker die; those that evaluate do not."""
    return Mortal() if jobs == 1 else ThreadPoolExecutor(jobs)


@pytest.mark.usefixtures("_in_threads")
def test_processes_that_die_cost_a_moment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Mortal, "made", 0)
    replace_processes(monkeypatch, mortal)
    scene = scene_of([*["aaaa"] * 4, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    one, _ = prove(scene, tmp_path / "one", SOLO_PROGRAMS)
    two, _ = prove(scene, tmp_path / "two")
    assert Mortal.made >= 3
    assert two.summary.proven is True
    assert two.summary.best == pytest.approx(one.summary.best, rel=1e-6)


PROVE = """
import sys
sys.path[:0] = {paths!r}
from pathlib import Path
from test_proof_state import prove
from jld_core import load_scene
prove(load_scene(Path(sys.argv[1]) / "scene.json"), Path(sys.argv[1]) / "out")
"""


@pytest.mark.long
def test_a_kill_loses_nothing_proven(tmp_path: Path) -> None:
    """A worker is killed, and when another is at work in its place the search itself."""
    scene = scene_of([*["aaaa"] * 5, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    (tmp_path / "scene.json").write_text(scene.model_dump_json(exclude_defaults=True), encoding="utf-8")
    code = PROVE.format(paths=[str(Path(__file__).parent), str(Path(__file__).parents[1])])
    run = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])

    def await_conflicts(more: int) -> None:
        journal = tmp_path / "out" / "records.sqlite3-wal"
        before = journal.stat().st_size if journal.exists() else 0
        while run.poll() is None and not (journal.exists() and journal.stat().st_size > before + more):
            time.sleep(0.01)

    await_conflicts(100_000)
    helpers = psutil.Process(run.pid).children(recursive=True)
    os.kill(next(one.pid for one in helpers if "popen_loky" in " ".join(one.cmdline())), signal.SIGKILL)
    await_conflicts(50_000)
    helpers += psutil.Process(run.pid).children(recursive=True)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    assert psutil.wait_procs(helpers, timeout=120.0)[1] == []  # they do not outlive it
    driver = DRIVERS["exact"](search_space(scene, build_assembly(scene)), search=0)
    rest = explore(scene, tmp_path / "out", replace(SOLO_PROGRAMS, resume=True), driver=driver)
    assert rest.summary.proven is True
    assert len(driver.state.conflicts) > 50


@pytest.fixture
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    found = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, worker_dashboard_address=None
    )
    yield found
    found.close()


@pytest.mark.filterwarnings("ignore")
def test_workers_of_a_cluster_prove(cluster: Any, tmp_path: Path) -> None:
    """One at first, a second joins, the first leaves: the same optimum."""
    scene = scene_of([*["aaaa"] * 5, "####"], {"tension": 5e3, "shear": 5e3, "block_cells": [1, 3]})
    one, _ = prove(scene, tmp_path / "one", SOLO_PROGRAMS)
    driver = DRIVERS["exact"](search_space(scene, build_assembly(scene)), solo_relaxations=0, search=0)
    events: list[str] = []
    (first,) = cluster.scheduler.workers

    def raise_deferred(_: Progress) -> None:
        cube_workers = driver._sources and driver._sources.cube_workers
        if cube_workers and cube_workers.started and not events:
            cluster.scale(2)
            events.append("joined")
        if cube_workers and events == ["joined"] and len(cube_workers._pool) == 2:
            cluster.sync(cluster.scheduler.retire_workers, workers=[first], close_workers=True)
            events.append("left")

    settings = replace(SOLO_PROGRAMS, cluster=cluster.scheduler_address)
    away = explore(scene, tmp_path / "away", settings, report=raise_deferred, driver=driver)
    assert driver._sources.solves > 0
    assert events == ["joined", "left"]
    assert away.summary.proven is True
    assert away.summary.best == pytest.approx(one.summary.best, rel=1e-6)
    assert away.summary.bound == pytest.approx(one.summary.bound, rel=2e-6)
