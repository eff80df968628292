"""What comes to the door of a stranger's machine: odd names, odd numbers, odd folders, closed terminals, no time."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
import sys
import xml.dom.minidom
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from command import Command, call, environment, saved
from jld_core import InputError, Layout, SolveOptions, build_assembly, files, load_scene, parse_scene, solve
from jld_core.views import facts_of_result
from jld_explore import ExploreSettings, explore, read_folder, search_space
from jld_explore.drivers import DRIVERS, make_driver
from jld_explore.evaluation import Records
from jld_explore.report import reading
from jld_formats import export
from jld_views import figures

ODD = ["wall, $5 a block {, $9 a cut", "$\\frac{$", "\x00bell\x07 and \x1f, \ufffe", "汉字 🧱", "a\nb\tc", "%$_^{}\\"]


def small(**limits: Any) -> dict[str, Any]:
    return grid_document(["aaa", "aaa", "###"], **{"block_cells": [1, 3], **limits})


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a search, without pictures."""
    folder = tmp_path_factory.mktemp("door") / "out"
    explore(parse_scene(small()), folder, ExploreSettings(driver="random", budget=6, jobs=1, pictures=False))
    return folder


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ODD)
def test_names_and_units_are_drawn_as_they_are(name: str, tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    """No formula is read in them, every SVG can be parsed, and nobody is warned of letters that a font lacks."""
    document = {**small(), "name": name, "units": {"length": name, "force": name}}
    assembly = build_assembly(parse_scene(document))
    figures.save_figure(figures.figure_of_result(solve(assembly), ids=True, values=True), tmp_path / "result.svg")
    export(Layout(parse_scene(document), assembly, assembly.labels), "svg", tmp_path / "blocks.svg")
    for file in ("result.svg", "blocks.svg"):
        xml.dom.minidom.parse(str(tmp_path / file))
    assert not recwarn.list


def test_a_search_under_an_odd_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = saved(
        tmp_path / "scene.json", {**small(), "name": ODD[0] + ODD[2], "units": {"length": ODD[1], "force": "N"}}
    )
    outcome = call(
        *(monkeypatch, capsys, "explore", file, "--out", tmp_path / "out", "--driver", "random"),
        *("--budget", "3", "--jobs", "1"),
    )
    assert (outcome.code, outcome.err) == (0, "")


def overwritten(name: str, text: str | bytes) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).write_bytes(text.encode() if isinstance(text, str) else text)

    return change


def with_summary(**more: Any) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        known = json.loads((folder / "summary.json").read_text())
        (folder / "summary.json").write_text(json.dumps({**known, **more}))

    return change


def with_results(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Callable[[Path], None]:
    def run(folder: Path) -> None:
        change(pd.read_parquet(folder / "results.parquet")).to_parquet(folder / "results.parquet")

    return run


def csv_alone(text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / "results.parquet").unlink()
        (folder / "results.csv").write_text(text)

    return change


DAMAGE: dict[str, Callable[[Path], None]] = {
    "summary.json: it is damaged": overwritten("summary.json", "{"),
    "summary.json: best: ": overwritten("summary.json", "{}"),
    "summary.json: it is damaged (it holds": overwritten("summary.json", "[]"),
    "summary.json: best_labelling: it is of another scene": with_summary(best_labelling="did"),
    "summary.json: best_labelling: it is": with_summary(best_labelling="x" * 10),
    "summary.json: stop_reason: ": with_summary(stop_reason="bored"),
    "summary.json: model: ": with_summary(model={"wings": 2}),
    "summary.json: model: friction": with_summary(model={"friction": "sticky"}),
    "results.parquet: it is damaged (Could": overwritten("results.parquet", ""),
    "results.parquet: it is damaged": overwritten("results.parquet", "no table"),
    "results.parquet: it has no column load_factor": with_results(lambda t: t.drop(columns="load_factor")),
    "results.parquet: the labelling of row 1": with_results(lambda t: t.assign(labelling="did")),
    "results.parquet: column dry_faces holds no": with_results(lambda t: t.assign(dry_faces="many")),
    "results.parquet: column status": with_results(lambda t: t.assign(status="fine")),
    "results.csv: it is damaged": csv_alone(""),
    "results.csv: it is damaged (": csv_alone("rank,labelling\nfirst,d\n"),
    "results.csv: it has no column rank": csv_alone("a,b\n1,2\n"),
    "scene.json: it is not the scene": overwritten("scene.json", json.dumps(grid_document(["aaaa", "####"]))),
    "scene.json: it is not JSON": overwritten("scene.json", "{"),
}


@pytest.mark.parametrize("words", DAMAGE)
def test_a_damaged_folder_is_named_in_one_line(words: str, searched: Path, tmp_path: Path, jld: Command) -> None:
    folder = tmp_path / "out"
    shutil.copytree(searched, folder)
    DAMAGE[words](folder)
    before = sorted(path.name for path in folder.iterdir())
    jld("plot", folder).refused(words)
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "solves,seconds,best\n1,2,x\n"])
def test_a_damaged_convergence_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "convergence.csv").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(InputError, match=r"convergence\.csv: it is damaged"):
        reading.history_of(tmp_path)


def test_seeds_of_any_size() -> None:
    scene = parse_scene(grid_document(["aa", "##"]))
    space = search_space(scene, build_assembly(scene))
    assert all(len(make_driver("optuna", space, seed).ask(1)) for seed in (2**32, 2**32 + 1, 2**62))


def test_a_number_too_small_to_be_held_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(small()).replace('"tensile_strength": ', '"tensile_strength": 1e-400, "x": '))
    with pytest.raises(InputError, match="it holds the number 1e-400; expected 0 or a magnitude from 1e-30"):
        load_scene(file)
    file.write_text(json.dumps(small())[:-1] + ', "expected": {"zero": 0e-400, "more": -0.000}}')
    assert load_scene(file).expected == {"zero": 0.0, "more": 0.0}


def test_files_are_written_whole_or_not_at_all(tmp_path: Path) -> None:
    """A full disk is told with the name of the file, links stay, and what is no file is left alone."""

    def fill() -> None:
        with files.whole_file(tmp_path / "a.csv") as fresh:
            fresh.write_text("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space left on device") as error:
        fill()
    assert error.value.filename == str(tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "link").symlink_to("target")
    with files.whole_file(tmp_path / "link") as fresh:
        fresh.write_text("all")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "all"
    with pytest.raises(OSError, match="no file that can be written anew"), files.whole_file(Path("/dev/null")):
        pass


def test_two_may_write_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is last wins; neither finds what it wrote under gone."""
    with files.whole_file(tmp_path / "a.csv") as mine:
        mine.write_text("mine")
        monkeypatch.setattr("os.getpid", lambda: 7)
        with files.whole_file(tmp_path / "a.csv") as other:
            other.write_text("other")
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
    assert (tmp_path / "a.csv").read_text() == "mine"


def test_a_link_to_nothing_is_no_folder(tmp_path: Path, jld: Command) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(small()))
    (tmp_path / "out").symlink_to("nowhere")
    for command in ("solve", "explore"):
        jld(command, tmp_path / "scene.json", "--out", tmp_path / "out").refused(
            f"{tmp_path / 'out'}: it is a link to nowhere, which is not there"
        )


def test_the_gap_at_zero_is_beside_the_weight(tmp_path: Path) -> None:
    """λ = 0 without friction: the gap is measured as brackets are, and is none."""
    done = explore(
        parse_scene(grid_document(["aa", "##"], friction=0.0)),
        tmp_path / "out",
        ExploreSettings(driver="enumeration", jobs=1, pictures=False),
    )
    assert done.summary.best == pytest.approx(0.0, abs=1e-9)
    assert done.summary.proven is True
    assert done.summary.gap <= 1e-6


def test_the_best_bound_outlives_whatever_stops_a_search(tmp_path: Path) -> None:
    """A driver without bounds gets that of one relaxation; a bound on record stays, and a changed one is found."""
    settings = ExploreSettings(driver="random", budget=3, jobs=1, pictures=False)
    done = explore(parse_scene(small()), tmp_path / "out", settings)
    every = explore(parse_scene(small()), tmp_path / "every", ExploreSettings(jobs=1, pictures=False))
    bound = done.summary.bound
    assert every.summary.best <= bound
    assert done.summary.gap > 0.0
    assert done.summary.next == "--resume goes on to a proof, 3 of 51 classes so far"
    assert every.summary.next is None
    records = Records(tmp_path / "r", {}, 10)
    for value in (3.0, 2.0, 5.0):
        records.keep_bound(value)
    records.close()
    again = Records(tmp_path / "r", {}, 10)
    assert again.bound == 2.0
    again._file.execute("UPDATE meta SET value = replace(value, '2.0', '1.0') WHERE key = 'bound'")
    again.close()
    with pytest.raises(InputError, match="the bound is not as it was written"):
        Records(tmp_path / "r", {}, 10)


def test_the_driver_that_proves_is_taken_where_the_proof_is_in_reach() -> None:
    def chosen(rows: list[str], keys: dict[str, Any] | None = None, **settings: Any) -> str:
        document = {**grid_document(rows, block_cells=[1, 3]), **(keys or {})}
        few = ExploreSettings(budget=1, small=50, jobs=1, pictures=False, check_fields=0, **settings)
        return str(explore(parse_scene(document), settings=few).summary.facts["driver"])

    wall = ["aaaa", "aaaa", "aaaa", "####"]
    assert chosen(["aa", "aa", "##"]) == "enumeration"
    assert chosen(wall) == "exact"
    assert chosen(["aaaaaa"] * 6 + ["######"]) == "portfolio"  # too many faces
    # what has no bounds is not asked for any
    crushing = {"materials": grid_document(wall, crush_dry=1e5)["materials"]}
    assert chosen(wall, crushing) in ("portfolio", "exact")
    assert chosen(wall, model=SolveOptions(friction="zero-dilation", range=True, floor_seconds=0.0)) in (
        "genetic",
        "portfolio",
    )
    assert chosen(wall, options={"population": "8"}) == "genetic"
    assert chosen(wall, {"cracks": {"kind": "cells", "cell": 0.05}}) == "genetic"


def test_brackets_that_overlap_share_a_rank(searched: Path) -> None:
    done = read_folder(searched)
    ranked = done.results[done.results["rank"].notna()]
    for place, (rank, lo) in enumerate(zip(ranked["rank"], ranked["bracket_lo"], strict=True)):
        first = ranked.iloc[int(rank) - 1]
        assert int(first["rank"]) == rank <= place + 1
        assert (ranked["bracket_hi"].iloc[place] >= first["bracket_lo"]) == (rank == first["rank"])
        assert np.isfinite(lo)


def test_rows_are_found_by_number_whatever_they_tie_with(searched: Path) -> None:
    done = read_folder(searched)
    for number in range(1, len(done.results) + 1):
        text = "".join("d" if dry else "i" for dry in done.layout(number).labels)
        assert text == done.results["labelling"].iloc[number - 1]
    with pytest.raises(InputError, match=f"no layout of rank {len(done.results) + 1}"):
        done.layout(len(done.results) + 1)


# test_drivers.py tests the ends by time and budget of every driver as well
@pytest.mark.parametrize(
    "kind", [*(pytest.param(one, marks=pytest.mark.long) for one in ("time", "budget")), "interrupt"]
)
def test_every_driver_ends_quietly(kind: str, tmp_path: Path) -> None:
    """Nothing on stderr but our own line, and the exit code it should be."""
    scene = tmp_path / "scene.json"
    # a space that none of them is through with in the time, one labelling at a time
    rows = ["aaaa"] * 4 + ["####"] if kind == "budget" else ["aaaaaa"] * 6 + ["######"]
    scene.write_text(json.dumps(grid_document(rows, block_cells=[1, 3])))
    done = subprocess.run(
        [sys.executable, str(Path(__file__).parents[1] / "every_driver.py"), kind, str(scene), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=240,
        env={**environment(), "JLD_KERNEL": "off"},
        check=False,
    )
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    assert [name for name, _ in ends] == list(DRIVERS), done.stderr
    said = done.stderr.splitlines()
    assert len(said) == (len(DRIVERS) if kind == "interrupt" else 0)
    solved = "stopped; everything finished is on disk, go on with --resume"
    assert set(said) <= {solved, "stopped before a layout was solved; --resume begins with the first"}
    assert [code for _, code in ends] == [3 if kind == "interrupt" else 0] * len(DRIVERS)
    for name in DRIVERS:
        facts = json.loads((tmp_path / f"{kind}-{name}" / "summary.json").read_text())
        assert facts["stop_reason"] == {"time": "time", "budget": "budget", "interrupt": "interrupted"}[kind]
        assert facts["bound"] is not None


def test_falling_elements_are_named_and_drawn(tmp_path: Path) -> None:
    """A cantilever of dry blocks: its velocities gain energy under the dead load alone, whatever λ ≥ 0."""
    document = grid_document(["aabc", "a...", "#..."], live=[{"element": "c1r0", "force": [0, -1]}])
    result = solve(build_assembly(parse_scene(document)))
    assert (str(result.status), result.mechanism) == ("unstable", None)
    elements = result.assembly.elements
    assert np.linalg.norm(result.instability_mechanism[:, :2], axis=1).max() == pytest.approx(1.0)
    dead = float((result.assembly.dead * result.instability_mechanism)[elements.free].sum())
    live = float((result.assembly.live * result.instability_mechanism)[elements.free].sum())
    assert dead > 0.0
    assert live >= -1e-9
    facts = facts_of_result(result)
    assert facts["falls"].startswith("c3r0, c2r0")
    assert "support what falls" in facts["next"]
    assert json.loads(json.dumps(result.to_json()))["instability_mechanism"]["c0r2"] == [0.0, 0.0, 0.0]
    figure = figures.figure_of_result(result)
    assert any("Falls whatever the live load" in ax.get_title() for ax in figure.axes)


def test_the_cause_of_a_locked_structure_is_named() -> None:
    """A row between two abutments, pushed along itself: nothing crushes, so nothing brings it down."""
    result = solve(build_assembly(parse_scene(grid_document(["#abc#"], live=[{"element": "c1r0", "force": [1, 0]}]))))
    facts = facts_of_result(result)
    assert str(result.status) == "locked"
    assert "c4r0" in facts["confined"]
    assert "compressive_strength" in facts["next"]
