"""The state of a proof shared by threads, the check at its end, and bounds that are contradicted."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.claims import proofs

from cases import dry_and_inner, grid_document
from jld_core import build_assembly, parse_scene
from jld_core.batch import chosen
from jld_core.batch.batch_solver import ConflictRequest, MinimizationOptions
from jld_core.limit.case_relaxation import Relaxation, relaxation_of
from jld_explore import Driver, Exploration, ExploreSettings, StopReason, explore, search_space
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.proof_check import Claim, check_proof
from jld_explore.drivers.exact.proof_state import Conflict, Evidence, ProofState
from jld_explore.evaluation import Records
from jld_explore.report import words
from jld_explore.search.study import Study
from jld_explore.space.counts import BlockShapes
from jld_explore.space.labelling import blocks_of

# what blocks that crack anywhere carry, test_field_searches.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

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


def search(document: dict[str, Any], folder: Path, **options: Any) -> tuple[Exploration, Exact]:
    """Prove with two jobs, unless said otherwise, and hardly any search before the proof."""
    scene = parse_scene(document)
    settings = replace(QUIET, jobs=options.pop("jobs", 2), resume=options.pop("resume", False))
    driver = Exact(search_space(scene, build_assembly(scene)), **{"search": 0, **options})
    return explore(scene, folder, settings, driver=driver), driver


@pytest.mark.parametrize("step_after", [None, 1, pytest.param(20, marks=pytest.mark.long)])
def test_no_layout_is_lost_when_the_target_changes(step_after: int | None, tmp_path: Path) -> None:
    done, _ = search(LOST, tmp_path / "out", step_after=step_after)
    assert done.summary.proven is True
    assert done.summary.best == pytest.approx(0.522868698, rel=2e-6)
    assert done.summary.facts["proof_check"]["passed"] is True


def test_proofs_agree_with_enumeration_and_one_job(monkeypatch: pytest.MonkeyPatch) -> None:
    """A share of `python -m benchmarks.claims proofs`: five of its cases, however busy the machine is."""
    monkeypatch.setattr(proofs, "EVERY", 10**9)  # real processes take seconds to start
    found = proofs.run(20_000, 5, 600.0)
    assert found.cases == 5
    assert found.disagreements == []


def test_mirrored_blocks_have_one_shape_in_every_order(tmp_path: Path) -> None:
    scene = parse_scene(FLIPPED)
    every = explore(scene, tmp_path / "every", replace(QUIET, driver="enumeration"))
    done, _ = search(FLIPPED, tmp_path / "exact")
    assert every.summary.best == pytest.approx(done.summary.best, rel=1e-9)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    text = every.results["labelling"]
    rows = np.array([[letter == "d" for letter in labels] for labels in text])
    blocks = blocks_of(space.graph, rows)
    counts = [
        BlockShapes(assembly, flip=True).different(blocks[order])[np.argsort(order)].tolist()
        for order in (np.arange(len(rows)), np.arange(len(rows))[::-1])
    ]
    assert counts[0] == counts[1]
    assert max(counts[0]) == 1


@pytest.mark.usefixtures("_switching")
def test_threads_number_shapes_alike() -> None:
    assembly = build_assembly(parse_scene(grid_document(["aaaa", "aaaa", "aaaa", "####"], **WEAK)))
    free = assembly.elements.free
    rng = np.random.default_rng(3)
    groups = [np.sort(rng.choice(free, size=int(rng.integers(1, 7)), replace=False)) for _ in range(400)]
    alone = BlockShapes(assembly, flip=True)
    expected = [alone.one(group).size for group in groups]
    shared = BlockShapes(assembly, flip=True)
    wrong: list[str] = []

    def ask(seed: int) -> None:
        try:
            for k in np.random.default_rng(seed).permutation(len(groups)).tolist():
                if abs(shared.one(groups[k]).size - expected[k]) > 1e-9 * expected[k]:
                    wrong.append(f"block {k} has another outline")
        except Exception as error:  # a thread reports to the test
            wrong.append(repr(error))

    threads = [threading.Thread(target=ask, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert len(shared.values("size")) == len({group.tobytes() for group in groups})


@pytest.mark.usefixtures("_switching")
def test_every_layout_handed_over_waits_for_one_evaluation() -> None:
    """Four threads hand over the same and other layouts while a fifth takes and evaluates them."""
    scene = parse_scene(grid_document(["aaaa", "aaaa", "####"], symmetry="none", **WEAK))
    space = search_space(scene, build_assembly(scene))
    state = ProofState(space)
    rng = np.random.default_rng(1)
    rows = np.where(space.candidates, rng.random((3000, len(space.fixed))) < 0.5, space.fixed)
    taken: list[bytes] = []

    def hand_over(part: int) -> None:
        for k in range(part * 500, part * 500 + 1500):
            state.hand_over([rows[k]])
            state.add_conflicts([Conflict(np.array([k % 7]), np.array([True]), float(-(k % 50)))])

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


def test_a_proof_in_which_a_bound_was_changed_is_not_proven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every conflict claims a third less than its mechanism proves."""
    rows = [*["aaaa"] * 3, "####"]
    true_init = Conflict.__init__

    def lower(self: Conflict, faces: Any, labels: Any, bound: float, *more: Any, **named: Any) -> None:
        true_init(self, faces, labels, bound - 0.3 * abs(bound) if len(faces) else bound, *more, **named)

    monkeypatch.setattr(Conflict, "__init__", lower)
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

    def lose(self: ProofState) -> Any:
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    monkeypatch.setattr(ProofState, "take_waiting", lose)
    monkeypatch.setattr(
        "jld_explore.drivers.exact.driver.Exact._lower_bound",
        lambda self, target, bound: self.found.update({target: replace(self.found[target], bound=bound)}),
    )
    done, _ = search(grid_document([*["aaa"] * 3, "###"], **WEAK), tmp_path / "out", jobs=1, by_blocks="off")
    assert done.summary.proven is False


def test_a_conflict_that_refutes_an_evaluated_layout_is_found(tmp_path: Path) -> None:
    document = grid_document([*["aaaa"] * 3, "####"], **WEAK)
    done, driver = search(document, tmp_path / "out", jobs=1, by_blocks="off")
    assert done.summary.proven is True
    best = np.array([letter == "d" for letter in done.summary.best_labelling])
    faces = np.flatnonzero(driver.space.candidates)[:5]
    driver.state.add_conflicts([Conflict(faces, best[faces], 0.1, Evidence.BLOCKS)])
    claims = [Claim(None, driver.found[None].bound / driver._scale)]
    check = driver._check_proof(claims, "", driver._incumbents.strongest(100))
    assert not check.passed
    assert "allows it 0.1" in check.problem


def test_conflicts_of_blocks_are_refuted_again(tmp_path: Path) -> None:
    """Each by a new program from its labels alone; one that refutes too much is found without any evaluation."""
    document = grid_document([*["aaaa"] * 3, "####"], **WEAK)
    done, driver = search(document, tmp_path / "out", jobs=1, by_blocks="on")
    assert done.summary.proven is True
    by_blocks = [one for one in driver.state.conflicts if one.evidence is Evidence.BLOCKS]
    check = done.summary.facts["proof_check"]
    assert by_blocks
    assert check["weighed"] == check["conflicts"] >= len(by_blocks)
    best = np.array([letter == "d" for letter in done.summary.best_labelling])
    faces = np.flatnonzero(driver.space.candidates)[:5]
    driver.state.add_conflicts([Conflict(faces, best[faces], 0.1, Evidence.BLOCKS)])
    claims = [Claim(None, driver.found[None].bound / driver._scale)]
    nothing = np.empty((0, len(best)), dtype=bool), np.empty(0)
    problem = check_proof(driver._context, driver.state, claims, nothing, "", 100.0).problem
    assert "a conflict of blocks that was to keep λ at 0.1 is not refuted" in problem


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

    name, checks = "unproven", True

    def ask(self, limit: int | None = None) -> Any:
        """Propose nothing."""
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    def tell(self, labellings: Any, evaluations: Any) -> None:
        """Learn nothing."""


def test_to_ask_why_a_study_ends_changes_nothing(tmp_path: Path) -> None:
    """The question alone withdrew the bound on record; now the end of a run does."""
    scene = parse_scene(grid_document(["aa", "aa", "##"], **WEAK))
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    study = Study(scene, assembly, space, Unproven(space), tmp_path / "out", ExploreSettings(jobs=1))
    study.keep_bound(2.0)
    for _ in range(2):
        assert study._reason(True) is StopReason.UNPROVEN
        assert (study.records.bound, study.records.withdrawn) == (2.0, [])
    assert study.run() is StopReason.UNPROVEN
    study.records = study.open_records()
    assert study.records.bound is None
    study.records.close()


@pytest.mark.parametrize("lowered", [40, 10**9])
def test_a_bound_recorded_too_low_is_corrected(lowered: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest recomputed bound counts, and the search goes on from it to the end."""
    left, sound = [lowered], Relaxation._refutations

    def low(
        self: Relaxation, velocities: np.ndarray, labels: np.ndarray, undecided: np.ndarray, limits: np.ndarray
    ) -> Any:
        found = sound(self, velocities, labels, undecided, limits)
        for k, one in enumerate(found):
            if one is not None and left[0] > 0 and 0.0 < one.bound < 1e6 and not undecided[k].all():
                left[0] -= 1
                found[k] = replace(one, bound=0.99 * one.bound)
        return found

    monkeypatch.setattr(Relaxation, "_refutations", low)
    done, driver = search(LOST, tmp_path / "out", jobs=1, by_blocks="off")
    best = 0.522868698
    assert driver._corrections
    assert done.summary.proven
    assert done.summary.best == pytest.approx(best, rel=2e-6)
    assert done.summary.bound == pytest.approx(best, rel=2e-6)


@pytest.mark.parametrize("seed", range(6))
def test_recorded_bounds_are_recomputed_alike(seed: int) -> None:
    """Random boxes in space with inner friction: what refutes a labelling says the same when it is weighed again."""
    rng = np.random.default_rng(seed)
    assembly = build_assembly(parse_scene(boxes(rng)))
    relaxation = relaxation_of(assembly)
    free = assembly.free_faces
    labels = rng.random((40, len(free))) < rng.random((40, 1))
    labels[:, ~free] = assembly.labels[~free]
    whole = np.zeros_like(labels)
    known = [one for one in relaxation.refute_all(labels, whole, np.full(40, 1e12)) if one is not None]
    thresholds = np.array([one.bound * rng.uniform(1.02, 2.0) for one in known])
    request = ConflictRequest(labels[: len(known)], free, thresholds, how=MinimizationOptions(neighbours=2, tries=4))
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
