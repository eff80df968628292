"""Small things that add up: help at once, pictures where one stands, results that say what they are in one line."""

from __future__ import annotations

import itertools
import json
import math
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib.externals.loky import process_executor
from typer.main import get_command

import jld_core as jc
import jld_explore as je
from cases import grid_document, replace_processes, scene_of_cases, small_scene
from command import ROOT, SCENES, Command, app
from jld_core import InputError, build_assembly, load_scene, parse_scene, solve
from jld_explore import Exploration, ExploreSettings, Progress, explore, read_folder, search_space
from jld_explore.cli import explore as progress
from jld_explore.drivers import DRIVERS, make_driver
from jld_explore.evaluation import Pool
from jld_explore.report import words
from jld_explore.space import from_string

SCENE = ROOT / "scenes" / "flat_beam_arch.json"

HELP = """
import sys
sys.argv = ["jld", "--help"]
from jld_explore.__main__ import main
try:
    main()
finally:
    light = {"jld_core", "jld_core._version", "jld_core.lazy_exports", "jld_core.errors", "jld_core.plugins"}
    ours = {name for name in sys.modules if name.startswith("jld_core")} - light
    loaded = [name for name in ("numpy", "scipy", "pandas", "typer", *ours) if name in sys.modules]
    assert not loaded, loaded
"""


def test_help_loads_nothing(jld: Command) -> None:
    done = subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == jld("--help").out
    assert max(map(len, done.stdout.splitlines())) <= 100


def test_commands_import_slow_modules_on_demand() -> None:
    """To solve a scene needs no tables, no pictures, no search and no other solver: they take as long as the rest.

    A search loads drivers and tables, but no statistics before there is something to rank.
    """
    slow = ("pandas", "pyarrow", "scipy.optimize", "matplotlib", "cvxpy", "optuna", "numba", "joblib", "rich", "psutil")
    slow += ("scipy.spatial", "highspy", "jld_core.fields", "jld_geometry", "jld_core.samples")
    slow += ("jld_dilation", "jld_core.refinement")
    ours = ("jld_explore.drivers", "jld_explore.evaluation", "jld_explore.report", "jld_explore.space")
    modules = "jld_explore.cli.command, jld_explore.cli.solve, jld_explore.cli.check"
    asked = f"import sys, {modules}; print([name for name in {slow + ours} if name in sys.modules]); "
    late = ("scipy.stats", "scipy.optimize", "scipy.spatial", "matplotlib", "optuna", "cvxpy", "numba")
    asked += f"import jld_explore.explore; print([name for name in {late} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["[]", "[]"]), done.stderr


def test_help_names_every_command_and_driver(jld: Command) -> None:
    group: Any = get_command(app)
    names, told = group.list_commands(None), jld("--help").out
    assert all(re.search(rf"^ +{name}\b", told, re.M) for name in (*names, *DRIVERS))
    assert all(group.get_command(None, name).callback or name == "new" for name in names)
    assert group.get_command(None, "nonsense") is None


@pytest.mark.usefixtures("without_pictures")
def test_the_example_of_the_help_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    pytest.importorskip("ezdxf")
    monkeypatch.chdir(tmp_path)
    lines = jld("--help").out.partition("Example:\n")[2].split("\n")
    commands = [line.split()[1:] for line in lines if line]
    assert [command[0] for command in commands] == ["new", "check", "explore", "export"]
    for command in commands:
        quick = ["--driver", "random", "--budget", "4", "--jobs", "1"] if command[0] == "explore" else []
        assert jld(*command, *quick).code == 0


def test_names_of_the_face_are_not_modules() -> None:
    import jld_explore.explore

    assert callable(jld_explore.explore)
    assert {"explore", "Driver"} <= set(dir(jld_explore))
    with pytest.raises(AttributeError, match="no attribute 'running'"):
        jld_explore.running  # noqa: B018


def test_a_scene_is_drawn_where_one_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    monkeypatch.chdir(tmp_path)
    assert jld("plot", SCENE).out == "flat_beam_arch.png\n"
    assert (tmp_path / "flat_beam_arch.png").exists()
    assert not SCENE.with_suffix(".png").exists()


def test_repr_of_objects_is_one_line(tmp_path: Path) -> None:
    scene = load_scene(SCENE)
    assembly = build_assembly(scene)
    done = explore(scene, tmp_path / "out", ExploreSettings(driver="random", budget=3, jobs=1, pictures=False))
    for thing in (scene, assembly, solve(assembly), search_space(scene, assembly), done):
        text = repr(thing)
        assert text.startswith(f"{type(thing).__name__}({scene.name!r}, ")
        assert len(text.splitlines()) == 1
        assert len(text.replace(str(tmp_path), "")) < 140


def test_findings_are_reported_unchanged(tmp_path: Path) -> None:
    """Nothing stands, which is proven; the best that meets the bound known beforehand is; cases go by λ / required."""
    overhang = {**small_scene(rows=["abc", "#.."]), "loads": {"live": [{"body": [1, 0]}]}}
    overhang["materials"]["inner"] = {"tensile_strength": 1.0, "shear_strength": 1.0}
    slides = {**small_scene(), "loads": {"live": [{"body": [1, 0]}]}}
    slides["materials"]["dry"] = {"friction_coefficient": 0.3}
    said = {}
    for name, scene, driver in (
        ("nothing", overhang, "enumeration"),
        ("slides", slides, "random"),
        ("cases", scene_of_cases(), "random"),
    ):
        done = explore(
            parse_scene(scene), tmp_path / name, ExploreSettings(driver=driver, budget=5, jobs=1, pictures=False)
        )
        said[name] = (words.facts_of_exploration(done), done.summary.facts)
    assert said["nothing"][0]["best λ"] == "none (proven: no layout stands)"
    assert said["nothing"][0]["stopped"].startswith("nothing left to evaluate after")
    facts, summary = said["slides"]
    assert (summary["stop_reason"], summary["proven"], summary["next"]) == ("budget", True, None)
    assert summary["gap"] <= 1e-6
    assert facts["best λ"].startswith("0.3")
    assert facts["best λ"].endswith("(proven strongest)")
    assert "best λ / required" in said["cases"][0]


def test_a_folder_of_another_scene_or_a_killed_search_is_refused(tmp_path: Path) -> None:
    scene = parse_scene(small_scene())
    out = tmp_path / "out"
    explore(scene, out, ExploreSettings(driver="random", budget=3, jobs=1, pictures=False))
    own = (out / "scene.json").read_text()
    heavier = json.loads(own)
    heavier["materials"]["density"] = 9.0
    (out / "scene.json").write_text(json.dumps(heavier))
    with pytest.raises(InputError, match=r"not the scene of the search in this folder"):
        read_folder(out)
    (out / "scene.json").write_text(own)
    for name in ("results.parquet", "summary.json"):
        (out / name).unlink()
    with pytest.raises(InputError, match=r"killed, or is still running; expected .* --resume"):
        read_folder(out)


@pytest.mark.usefixtures("without_pictures")
def test_terminal_tables_shorten_long_labellings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    monkeypatch.chdir(tmp_path)
    assert jld("new", "wall", "-o", "wall.json").code == 0
    options = ("--driver", "random", "--budget", "3", "--jobs", "1")
    shown = jld("explore", "wall.json", "--out", "out", *options).out
    assert "…" in shown
    assert max(map(len, shown.splitlines())) < 160


def test_progress_shows_incumbent_bound_and_gap(tmp_path: Path) -> None:
    seen: list[Progress] = []
    settings = ExploreSettings(driver="exact", jobs=1, pictures=False)
    done = explore(load_scene(SCENE), tmp_path / "out", settings, seen.append)
    bar = progress.ProgressBar("arch")
    bar(seen[-1])
    shown = bar._bar.tasks[0].fields["best"]
    assert shown.startswith(f"best λ {done.summary.best:.6g} ≤ ")
    assert shown.endswith("%")
    assert ", gap " in shown
    assert 0.0 <= seen[-1].gap <= seen[0].gap or np.isnan(seen[0].gap)


@pytest.mark.parametrize(
    "content",
    [b"axes.facecolor: red\nfigure.dpi: none\nbogus line\n", pytest.param(b"\xff\xfe no text", marks=pytest.mark.long)],
)
def test_a_matplotlibrc_in_the_current_folder_does_not_matter(content: bytes, tmp_path: Path, jld: Command) -> None:
    """Pictures are the same bytes, whatever the file says."""
    drawn = ("plot", str(SCENE))
    assert jld(*drawn, "-o", tmp_path / "a.png").code == 0
    (tmp_path / "matplotlibrc").write_bytes(content)
    command = [sys.executable, "-m", "jld_explore", *drawn, "-o", "b.png"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_parts_of_numpy_that_the_command_line_leaves_out_load_when_named() -> None:
    code = (
        "import sys; sys.argv = ['jld', '--version']\n"
        "from jld_explore.__main__ import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "left = {'numpy.f2py', 'numpy.testing'} & set(sys.modules)\n"
        "import numpy\n"
        "kept = {'f2py', 'ma', 'testing'} <= set(numpy.__all__) & set(dir(numpy))\n"
        "print(sorted(left), kept, numpy.ma.masked is not None)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "[] True True"


# A cut layout that is stronger than the uncut structure: said where it is proven, and nowhere else.


def searched(folder: Path, shear: float) -> Exploration:
    """Search a pressed column that is pushed sideways: a crack has its shear strength alone, a joint has friction."""
    pushed: list[dict[str, Any]] = [{"element": "c0r0", "force": [1, 0]}]
    document = grid_document(["a", "a", "#"], live=pushed, tension=1e9, shear=shear)
    settings = ExploreSettings(driver="enumeration", jobs=1, pictures=False, check_fields=0)
    return explore(parse_scene(document), folder, settings)


def test_a_stronger_layout_is_reported_where_it_is_proven(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", 1.0)
    space = search_space(done.scene, done.assembly)
    alone = solve(done.assembly, space.fixed & ~space.candidates)
    high = json.loads((tmp_path / "a" / "summary.json").read_text("utf-8"))["uncut_at_most"]
    assert high == pytest.approx(alone.load_factor, rel=1e-6)
    assert done.summary.facts["best"] > high
    assert words.facts_of_exploration(read_folder(tmp_path / "a"))["cuts"] == words.STRONGER_CUT.format(
        high=f"{high:.4g}"
    )


def test_silent_where_cuts_gain_nothing(tmp_path: Path) -> None:
    done = searched(tmp_path / "a", 1e9)
    assert "uncut_at_most" not in done.summary.facts
    assert "cuts" not in words.facts_of_exploration(done)
    assert build_assembly(done.scene).labels.shape == done.assembly.labels.shape


# What a running search reports: the best layout so far.


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("driver", ["enumeration", "exact", "hillclimb"])
def test_progress_names_the_layout_of_its_best(driver: str, tmp_path: Path) -> None:
    """Solved here, the layout reported last has the λ reported with it, which is the best of the search."""
    scene = parse_scene(small_scene())
    told: list[Progress] = []
    settings = ExploreSettings(driver=driver, jobs=1, pictures=False)
    done = explore(scene, tmp_path / "out", settings, report=told.append)
    assert told[-1].best == pytest.approx(done.summary.best, rel=1e-6)
    labels = from_string(told[-1].labelling)
    assert solve(build_assembly(scene), labels).load_factor == pytest.approx(told[-1].best, rel=1e-6)
    firsts = [one for one in told if one.labelling]
    assert all(a.best <= b.best for a, b in itertools.pairwise(firsts))


@pytest.mark.usefixtures("without_pictures")
def test_cells_left_out_are_letters_of_their_own(tmp_path: Path) -> None:
    document = small_scene()
    document["search"] = {"void": {"cells": ["c2r0"], "most": 0.3}}
    told: list[Progress] = []
    explore(parse_scene(document), tmp_path / "out", ExploreSettings(jobs=1, pictures=False), report=told.append)
    faces = build_assembly(parse_scene(document)).faces
    assert {len(one.labelling) for one in told if one.labelling} == {faces}
    assert all(set(one.labelling) <= set("div") for one in told)


@pytest.mark.parametrize(
    ("done", "total", "left", "words"),
    [(50, 100, 7.0, "7 s left"), (50, 100, 700.0, "10 s left"), (0, 100, 3.0, "3 s left"), (9, None, math.inf, "")],
)
def test_progress_says_how_much_time_is_left(done: int, total: int | None, left: float, words: str) -> None:
    """That of the limit, or of the layouts that are left if they end earlier; it was that of the layouts alone."""
    assert progress._time_left(Progress(done, total, done, 1.0, 10.0, left=left)) == words


@pytest.mark.usefixtures("without_pictures")
def test_the_bar_shows_time_left_bound_and_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Progress] = []
    explore(parse_scene(small_scene()), tmp_path / "out", driver="enumeration", seconds=100.0, report=told.append)
    assert all(0.0 < one.left < 100.0 for one in told)
    bar = progress.ProgressBar("wall")
    shown: dict[str, object] = {}
    monkeypatch.setattr(bar._bar, "update", lambda _, **fields: shown.update(fields))
    bar(Progress(9, None, 9, 1.5, 10.0, 2.0, 0.25, "", 40.0))
    assert (shown["best"], shown["left"]) == ("best λ 1.5 ≤ 2, gap 25.00%", "40 s left")


# Settings of the whole process are as they were once the pools that need them are closed.


def settings() -> tuple[float, list[Any]]:
    return sys.getswitchinterval(), list(warnings.filters)


def test_searches_of_several_jobs_leave_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Batches in threads, and evaluations in what stands here for processes."""
    scene = parse_scene(small_scene())
    explore(scene, tmp_path / "first", ExploreSettings(driver="random", budget=8, jobs=1, pictures=False))
    before = settings()  # with what libraries set when they are loaded
    for switch in ("", "off"):
        monkeypatch.setenv("JLD_KERNEL", switch)
        replace_processes(monkeypatch)
        explore(scene, tmp_path / f"out{switch}", ExploreSettings(driver="random", budget=8, jobs=2, pictures=False))
        assert settings() == before
    pool = Pool(1)
    assert pool.submit(divmod, 7, 2).result() == (3, 1)
    pool.close()
    assert settings() == before


def test_the_limit_of_memory_that_workers_lift_is_one_of_loky() -> None:
    """A private constant: where a version of loky renames it, workers are restarted while their state grows."""
    assert process_executor._MAX_MEMORY_LEAK_SIZE > 0


# Wrong values of parameters are one line that names them; what a guide promises of parameters works.


ARCH = SCENES / "flat_beam_arch.json"
FLAT_BEAM = jc.load_scene(ARCH)
ASSEMBLY = jc.build_assembly(FLAT_BEAM)
SPACE = je.search_space(FLAT_BEAM, ASSEMBLY)
SOLVE = {"gap": ["small", None, -1], "floor_seconds": ["x"], "effective_area": ["yes"], "condense": [1], "solver": [3]}
EXPLORE = {
    "jobs": [1.5, "two", 0, True],
    "budget": [2.5, "x"],
    "seconds": ["x"],
    "seed": ["x", 1.5, -1],
    "driver": ["exat", 3],
    "options": [[1]],
    "model": [{"gap": 1}],
    "settings": [{"gap": 1}],
    "report": [3],
    "certificate": [3],
    "experiment": ["x"],
    "popultion": [10],
    "population": ["x"],
    "out": [3, "exact"],
}
CALLS: dict[str, Callable[[], Any]] = {
    **{f"{key}={v!r}": lambda key=key, v=v: jc.solve(ASSEMBLY, **{key: v}) for key in SOLVE for v in SOLVE[key]},
    **{
        f"{key}={v!r} of a search": lambda key=key, v=v: je.explore(
            FLAT_BEAM, **{"budget": 2, "driver": "genetic", "pictures": False, key: v}
        )
        for key in EXPLORE
        for v in EXPLORE[key]
    },
    "driver=exat": lambda: make_driver("exat", SPACE, 0),
    "seed=x": lambda: make_driver("random", SPACE, "x"),
    "space=3": lambda: make_driver("random", 3, 0),
    "assembly=3": lambda: je.search_space(FLAT_BEAM, 3),
    "result=3": lambda: jc.geometry_sensitivities(3),
    "number=9": lambda: jc.solve_many(ASSEMBLY, [ASSEMBLY.labels]).result(9),
}


@pytest.mark.parametrize("name", CALLS)
def test_one_line_that_names_the_parameter(name: str) -> None:
    with pytest.raises(jc.InputError) as caught:
        CALLS[name]()
    text = str(caught.value)
    assert text.startswith(name.partition("=")[0] + ": ")
    assert "\n" not in text
    assert "object" not in text


def test_the_name_that_was_meant_is_offered() -> None:
    with pytest.raises(jc.InputError, match='expected "exact", one of enumeration'):
        make_driver("exat", SPACE, 0)
    with pytest.raises(jc.InputError, match='expected "population"'):
        je.explore(FLAT_BEAM, driver="genetic", popultion=3)


@pytest.mark.parametrize(
    "name", ["random", "hillclimb", "anneal", "genetic", "portfolio", "optuna", "exact", "enumeration"]
)
def test_a_driver_is_told_what_solve_many_returns(name: str) -> None:
    """Five rounds of a program's own loop give the proposals that evaluations of a search would."""
    driver, other = (make_driver(name, SPACE, 3) for _ in range(2))
    for _ in range(3):
        labels = driver.ask(6)
        assert labels.tolist() == other.ask(6).tolist()
        found = jc.solve_many(ASSEMBLY, labels)
        driver.tell(labels, found)
        rows = zip(found.status, found.low, found.high, found.load_factor, strict=True)
        other.tell(labels, [je.Evaluation(*row) for row in rows])


@pytest.mark.usefixtures("without_pictures")
def test_options_of_a_driver_are_keywords() -> None:
    same = {"driver": "genetic", "budget": 40, "seed": 2}
    one = je.explore(FLAT_BEAM, **same, population=10).results.drop(columns="seconds")
    assert one.equals(je.explore(FLAT_BEAM, **same, options={"population": 10}).results.drop(columns="seconds"))


def test_arrays_and_tuples_are_lists_of_a_scene() -> None:
    document: dict[str, Any] = {
        "name": "block",
        "elements": [
            {"id": "s", "support": True, "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]]},
            {"id": "b", "polygon": [[0, 1], [1, 1], [1, 2], [0, 2]]},
        ],
        "materials": {"density": 1.0, "dry": {"friction_coefficient": 0.5}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    other = json.loads(json.dumps(document))
    other["elements"][0]["polygon"] = np.array(other["elements"][0]["polygon"])
    other["elements"][1]["polygon"] = tuple(map(tuple, other["elements"][1]["polygon"]))
    other["loads"]["live"][0]["body"] = np.array([1.0, 0.0])
    other["materials"]["density"] = np.int64(1)
    assert jc.parse_scene(other).fingerprint == jc.parse_scene(document).fingerprint


@pytest.mark.usefixtures("without_pictures")
def test_a_resumed_search_without_solves_names_no_speed(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"driver": "random", "budget": 5}
    first = je.explore(FLAT_BEAM, tmp_path / "a", **settings)
    again = je.explore(FLAT_BEAM, tmp_path / "a", **settings, resume=True)
    said = [words.facts_of_exploration(one)["stopped"] for one in (first, again)]
    assert "solves/s" in said[0]
    assert "solves/s" not in said[1]


def test_steps_of_installed_packages_load_nothing_that_draws() -> None:
    """Every search loads them before it begins."""
    code = "import sys; from jld_core.plugins import load_all; load_all('jld.steps', ())\n"
    code += "print(sorted({'matplotlib', 'numba', 'pandas'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
