"""Labels and geometry searched together: `jld explore --move`, its table, scene and page, and its bad input."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cases import grid_document
from command import Command
from jld_core import InputError, parse_scene, solve
from jld_core.models import solve_by_fields
from jld_explore import ExploreSettings, Interrupted
from jld_geometry import explore_and_move, write_moved

FRICTION = 0.9


def wall(**keys: Any) -> dict[str, Any]:
    """Two courses of two cells under a push to the side, whose joints may lean; all faces stay dry."""
    push: list[dict[str, Any]] = [{"body": [1.0, 0.0]}]
    document = grid_document(["ab", "cd", "##"], live=push, tension=3e5, shear=5e5, friction=FRICTION, blocks=[4, None])
    return {**document, **keys}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("moved") / "out"
    settings = ExploreSettings(driver="enumeration", pictures=False, check_fields=0)
    found = explore_and_move(parse_scene(wall()), folder, 1, settings, gap=0.4)
    write_moved(found, folder, pictures=False)
    return found


def test_moved_layouts_gain_by_fields(done: Any) -> None:
    """λ ≤ μ since the base joints stay (sliding of the whole wall), and the best layout reaches it by faces."""
    assert done.stop == "nothing improves"
    assert len(done.rounds) == 2
    stated = next(one for one in done.layouts if one.row == 0)
    assert stated.start == pytest.approx(0.78125, rel=1e-6)
    assert stated.load_factor == pytest.approx(FRICTION, rel=1e-6)
    assert 0.0 < stated.fields_start[0] < done.best.low <= FRICTION * (1.0 + 1e-9)
    again = solve_by_fields(solve(done.best.scene).assembly, gap=0.4, seconds=5.0).decided
    assert again.low <= done.best.high * (1.0 + 1e-9)
    assert again.high >= done.best.low * (1.0 - 1e-9)


def test_tables_of_moved_layouts(done: Any) -> None:
    table = pd.read_csv(done.first.folder / "moved.csv")
    assert table["rank"].tolist() == list(range(1, len(done.layouts) + 1))
    assert table["fields_lo"].fillna(table["fields_lo_start"]).is_monotonic_decreasing
    facts = json.loads((done.first.folder / "summary.json").read_text())["moved"]
    assert facts["fields_lo"] == pytest.approx(done.best.low)
    assert (done.first.folder / "round-2" / "results.csv").exists()
    written = parse_scene(json.loads((done.first.folder / "moved.json").read_text()))
    assert solve(written).load_factor == pytest.approx(solve(done.best.scene).load_factor, rel=1e-9)


def test_the_command_keeps_one_clock(tmp_path: Path, jld: Command, without_pictures: None) -> None:
    file, folder = tmp_path / "wall.json", tmp_path / "out"
    file.write_text(json.dumps(wall()))
    start = time.process_time()  # where others use the machine, this is what the process can answer for
    found = jld("explore", file, "--out", folder, "--move", "1", "--seconds", "6", "--jobs", "1", "--json")
    assert time.process_time() - start <= 1.1 * 6.0 + 2.0
    assert found.code == 0
    facts = json.loads(found.out)["moved"]
    assert facts["fields_lo"] > 0.0
    assert "moved.png" in (folder / "moved.html").read_text()
    assert (folder / "moved.png").stat().st_size > 1000


def test_a_signal_leaves_the_best_moved_layout(
    tmp_path: Path, jld: Command, without_pictures: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped while bounds are refined, the search writes table, scene and page of the layouts moved so far."""

    def stop(*_: object) -> None:
        raise Interrupted

    monkeypatch.setattr("jld_geometry.moved_search._refined", stop)
    file, folder = tmp_path / "wall.json", tmp_path / "out"
    file.write_text(json.dumps(wall()))
    found = jld("explore", file, "--out", folder, "--move", "1", "--seconds", "4", "--jobs", "1")
    assert (found.code, found.err) == (3, f"stopped; the best so far is in {folder}\n")
    facts = json.loads((folder / "summary.json").read_text())
    assert facts["moved"]["stop"] == "interrupted"
    assert facts["best"] > 0.0
    assert (folder / "moved.json").exists()
    assert "moved.png" in (folder / "moved.html").read_text()


@pytest.mark.parametrize(
    ("keys", "flags", "said"),
    [
        ({"cracks": {"kind": "fields"}}, [], "--move: the search of labels needs cracks by faces"),
        ({"move": {"maximise": "least_friction"}}, [], "move.maximise"),
        ({"move": {"along": [{"at": [9.0, 9.0], "direction": [1, 0]}]}}, [], "no vertex lies at"),
        ({}, ["--robust"], "--robust: layouts whose joints move do not support it"),
        ({}, ["--effective-area"], "layouts whose joints move"),
        ({}, ["--certificate", "proof.json"], "--certificate: layouts whose joints move"),
    ],
)
def test_bad_input(tmp_path: Path, jld: Command, keys: dict[str, Any], flags: list[str], said: str) -> None:
    file, folder = tmp_path / "wall.json", tmp_path / "out"
    file.write_text(json.dumps(wall(**keys)))
    found = jld("explore", file, "--out", folder, "--move", "2", *flags)
    assert found.code == 2
    assert said in found.err
    assert found.err.count("\n") == 1
    assert not folder.exists()


def test_less_than_one_layout_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 is no number of layouts"):
        explore_and_move(parse_scene(wall()), tmp_path / "out", 0)
