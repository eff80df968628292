"""The journal of the optuna driver: a copy that survives a kill, and is written again where it is damaged."""

from __future__ import annotations

from pathlib import Path

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from cases import dry_and_inner
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
