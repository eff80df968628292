"""What a stranger's package brings works without a change here: `tests/plugin`, installed into a folder of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jld_core as jc
import jld_explore as je
from command import ROOT, SCENES, Command, install
from jld_core import plugins
from jld_explore import Driver, search_space
from jld_explore.drivers import make_driver
from jld_explore.space import registered, unregister

SCENE = SCENES / "flat_beam_arch.json"


def forget() -> None:
    """Forget which plug-ins were found."""
    from jld_explore.space import counts
    from jld_formats import formats

    for function in (plugins.entry_points, plugins.load, counts._add_plugins, formats.formats):
        function.cache_clear()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


@contextmanager
def installed(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The packages of a folder beside what is installed, in this process."""
    known = {count.name for count in registered()}
    monkeypatch.syspath_prepend(site)
    forget()
    yield
    monkeypatch.undo()
    forget()
    for name in {count.name for count in registered()} - known:
        unregister(name)


@pytest.fixture
def plugged(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with installed(site, monkeypatch):
        yield


def run(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(site), str(ROOT / "src")])
    command = [sys.executable, str(ROOT / "tests" / "without_pictures.py"), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": path})


def small(**search: Any) -> dict[str, Any]:
    """A wall of nine cells that is pushed, with a search."""
    return {
        "grid": {"cell": [0.2, 0.1], "thickness": 0.1, "rows": ["abc", "def", "ghi", "###"]},
        "materials": {
            "density": 2000,
            "dry": {"friction_coefficient": 0.6},
            "inner": {"tensile_strength": 2e3, "shear_strength": 2e3, "friction_coefficient": 0.5},
        },
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"block_cells": [1, 3], **search},
    }


@pytest.mark.usefixtures("plugged")
def test_a_driver_is_found_by_its_name_with_its_options(tmp_path: Path) -> None:
    found = je.explore(SCENE, tmp_path / "out", driver="sweep", options={"step": 2}, budget=40, pictures=False)
    assert (found.summary.driver, found.summary.evaluated) == ("sweep", 40)
    space = search_space(jc.load_scene(SCENE), jc.build_assembly(jc.load_scene(SCENE)))
    with pytest.raises(jc.InputError, match="step: 0 is wrong"):
        make_driver("sweep", space, 0, step=0)
    with pytest.raises(jc.InputError, match=r"driver: no driver is named 'sweeep'; expected \"sweep\""):
        make_driver("sweeep", space, 0)


@pytest.mark.sampled(4)
@pytest.mark.usefixtures("plugged")
@pytest.mark.parametrize(
    "driver", ["enumeration", "random", "genetic", "anneal", "portfolio", "hillclimb", "exact", "sweep"]
)
def test_a_count_is_column_limit_and_front_of_every_driver(driver: str, tmp_path: Path) -> None:
    document = small(limits={"long_faces": [None, 3]}, front={"count": "long_faces"})
    found = je.explore(jc.parse_scene(document), tmp_path / "out", driver=driver, budget=25, pictures=False)
    assert found.results["long_faces"].max() <= 3
    assert {point["count"] for point in found.summary.to_json()["front"]} <= {0, 1, 2, 3}
    assert "long_faces" in (tmp_path / "out" / "pareto.csv").read_text("utf-8").splitlines()[0]


@pytest.mark.usefixtures("plugged")
def test_proofs_respect_a_limit_on_a_count(tmp_path: Path) -> None:
    """The best of the exact driver is the best of all layouts."""
    scene = jc.parse_scene(small(limits={"long_faces": [None, 2]}))
    drivers = ("enumeration", "exact")
    every, found = (je.explore(scene, tmp_path / one, driver=one, pictures=False).summary for one in drivers)
    assert every.proven
    assert found.proven
    assert found.best == pytest.approx(every.best, rel=1e-6)


@pytest.mark.usefixtures("plugged")
def test_an_objective_is_maximised_by_its_name(tmp_path: Path) -> None:
    scene = jc.parse_scene(small())
    named = je.explore(scene, tmp_path / "a", objective="strength_per_block", driver="enumeration", pictures=False)
    function = plugins.load("jld.objectives", "strength_per_block")
    given = je.explore(scene, tmp_path / "b", objective=function, driver="enumeration", pictures=False)
    assert named.summary.best == given.summary.best
    assert not named.summary.proven
    with pytest.raises(jc.InputError, match="objective: no objective is named 'stiffness'"):
        je.explore(scene, tmp_path / "c", objective="stiffness")


@pytest.mark.usefixtures("plugged")
def test_a_file_format_is_read_and_written_by_its_ending(jld: Command, tmp_path: Path) -> None:
    """A tower of two boxes: its scene, its blocks, what a file loses, and a line that is no box."""
    drawn = tmp_path / "tower.boxes"
    drawn.write_text("#s 0 0 0 1 1 1\na 0 0 1 1 1 1\nb 0 0 2 1 1 1\n", encoding="utf-8")
    done = jld("import", drawn, "-o", tmp_path / "tower.json").done()
    assert "3 boxes" in done.out + done.err
    assert [one["id"] for one in json.loads((tmp_path / "tower.json").read_text())["elements"]] == ["#s", "a", "b"]
    done = jld("export", tmp_path / "tower.json", "--format", "boxes", "-o", tmp_path / "out.boxes").done()
    assert "materials" in done.out + done.err
    assert len((tmp_path / "out.boxes").read_text().splitlines()) >= 2
    drawn.write_text("a 0 0\n", encoding="utf-8")
    jld("import", drawn, "-o", tmp_path / "wrong.json").refused("line 1: it is no box")


@pytest.mark.usefixtures("plugged")
def test_a_driver_that_asks_no_more_does_not_know_all(tmp_path: Path) -> None:
    """Unless its layouts are all that there are."""

    class Once(Driver):
        name = "once"

        def ask(self, limit: int | None = None) -> Any:
            self.rows = [[False], [True]] * (not hasattr(self, "rows"))
            return np.array(self.rows, dtype=bool).reshape(-1, 1) | self.space.fixed[None] & ~self.space.candidates

        def tell(self, labellings: Any, evaluations: Any) -> None:
            pass

    for rows, reason in ((["aba", "###"], "driver"), (["ab", "##"], "exhausted")):
        scene = jc.parse_scene(small() | {"grid": small()["grid"] | {"rows": rows}})
        space = search_space(scene, jc.build_assembly(scene))
        done = je.explore(scene, tmp_path / reason, driver=Once(space), pictures=False)
        assert done.summary.stop_reason == reason


@pytest.mark.usefixtures("plugged")
def test_a_step_adds_its_entries_to_the_summary(tmp_path: Path) -> None:
    done = je.explore(jc.parse_scene(small()), tmp_path / "out", driver="random", budget=20, pictures=False)
    assert done.summary.facts["mean_blocks"]["layouts"] == 10
    read = je.read_folder(tmp_path / "out")
    assert read.summary.facts["mean_blocks"]["blocks"] == pytest.approx(done.results["blocks"].head(10).mean())


def test_the_command_line_has_all_of_them(
    site: Path, tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    with installed(site, monkeypatch):
        overview = jld("--help").out
        done = jld("count-stones", SCENE, "--supports")
    for name in ("count-stones", "sweep", "strength_per_block", "long_faces"):
        assert f"  {name} " in overview
    assert (done.code, done.err) == (0, "")
    assert int(done.out) == len(jc.build_assembly(jc.load_scene(SCENE)).elements)
    out = tmp_path / "out"
    options = ("--driver", "sweep", "--step", "3", "--objective", "strength_per_block", "--budget", "20", "--json")
    ended = run(site, "explore", str(SCENE), "--out", str(out), "--check-fields", "0", *options)
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)["driver"] == "sweep"
    assert "long_faces" in (out / "results.csv").read_text("utf-8").splitlines()[0]


@pytest.mark.parametrize(
    ("group", "name", "value", "words"),
    [
        ("jld.drivers", "broken", "no_such_module:Driver", "cannot be loaded"),
        ("jld.drivers", "broken", "json:dumps", "is not a search driver"),
        ("jld.drivers", "genetic", "json:dumps", "jld itself has a search driver of that name"),
        ("jld.counts", "broken", "json:dumps", "is not a count of layouts"),
        ("jld.counts", "dry_faces", "json:dumps", "jld itself has a count of layouts of that name"),
        ("jld.objectives", "broken", "json:__name__", "is not an objective"),
    ],
)
def test_a_broken_plug_in_is_one_line(
    group: str, name: str, value: str, words: str, tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = tmp_path / "site" / "stranger-1.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1\n")
    (facts / "entry_points.txt").write_text(f"[{group}]\n{name} = {value}\n")
    option = "--objective" if group == "jld.objectives" else "--driver"
    with installed(facts.parent, monkeypatch):
        done = jld("explore", SCENE, "--out", tmp_path / "out", option, name)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert words in done.err
    assert "stranger" in done.err


DRIVER = """
from jld_explore import Driver
from jld_explore.drivers import Register, operators
class Plug(Driver):
    name = "plug"
    def __init__(self, space, seed=0):
        super().__init__(space, seed)
        self.register, self.moves = Register(space), operators(space)
    def ask(self, limit=None):
        {ask}
    def tell(self, labellings, evaluations):
        {tell}
"""
COUNT = """
import numpy as np
from jld_explore.space import Count, Terms
def of(layouts):
    {of}
Plug = Count("plug", of=of, axis="x", noun="y"{terms})
"""
STEP = """
from jld_explore import Step
class Plug(Step):
    name = "plug"
    def entries(self, done, context):
        {entries}
"""
FORMAT = """
from jld_formats import Format
def read(path, options, notes):
    return {{}}["solids"]
def write(layout, path, *, cells):
    {write}
Plug = Format("plug", ".plug", read, ("plug",), write=write)
"""
CRITERION = """
class Plug:
    label, parameters = {label!r}, ()
    def __init__(self{more}): pass
    def rows(self, faces, values): pass
"""
DRIES = "return layouts.labellings.sum(axis=1)"
SOLVE = ("solve", "scene.json")
EXPORT = ("export", "scene.json", "--format", "plug", "-o", "new.plug")
SEARCH = ("explore", "scene.json", "--out", "out", "--driver", "enumeration")
ASK = ("explore", "scene.json", "--out", "out", "--driver", "plug")
LIMITED = {"limits": {"plug": [0, 3]}}
CRACKED = {"criterion": "plug"}
UP = {"symmetric": True}  # the scene is its own mirror image

Faulty = tuple[str, str, tuple[str, ...], dict[str, Any], str]
FAULTY: dict[str, Faulty] = {
    "driver raises": ("drivers", DRIVER.format(ask="raise ValueError('a\\nb')", tell=""), ASK, {}, r"a\nb"),
    "driver leaves": ("drivers", DRIVER.format(ask="raise SystemExit(7)", tell=""), ASK, {}, "SystemExit(7)"),
    "nothing asked": ("drivers", DRIVER.format(ask="pass", tell=""), ASK, {}, "it asks for NoneType"),
    "numbers asked": ("drivers", DRIVER.format(ask="return 1.0 * self.space.fixed[None]", tell=""), ASK, {}, "float64"),
    "excluded": ("drivers", DRIVER.format(ask="return ~self.space.fixed[None]", tell=""), ASK, {}, "search excludes"),
    "bound": ("drivers", DRIVER.format(ask="return self.space.fixed[None][:0]", tell="") + "    bound = float('nan')",
              ASK, {}, "its bound is nan"),
    "abstract": ("drivers", "from jld_explore import Driver\nclass Plug(Driver):\n    name = 'plug'", ASK, {},
                 "abstract"),
    "count raises": ("counts", COUNT.format(of="raise KeyError('x')", terms=""), SEARCH, {}, "KeyError('x')"),
    "count is nan": ("counts", COUNT.format(of=f"{DRIES} * np.nan", terms=""), SEARCH, LIMITED, "a finite number"),
    "one count": ("counts", COUNT.format(of="return 3", terms=""), SEARCH, {}, "a finite number for each"),
    "other terms": ("counts", COUNT.format(of=DRIES, terms=", terms=lambda a: Terms(blocks=True)"), SEARCH, {},
                    "add up"),
    "short terms": ("counts", COUNT.format(of=DRIES, terms=", terms=lambda a: Terms(np.ones(1))"), SEARCH, LIMITED,
                    "for each interface"),
    "objective": ("objectives", "def Plug(evaluation): pass", (*SEARCH, "--objective", "plug"), {}, "TypeError"),
    "step raises": ("steps", STEP.format(entries="raise ValueError('a\\nb')"), SEARCH, {}, r"a\nb"),
    "step of objects": ("steps", STEP.format(entries="return {'x': object()}"), SEARCH, {}, "not JSON"),
    "command": ("commands", "def Plug(x: str): raise ValueError(x)", ("plug", "bad"), {}, "ValueError('bad')"),
    "reader": ("formats", FORMAT.format(write=""), ("import", "file.plug", "-o", "new.json"), {}, "KeyError"),
    "writer": ("formats", FORMAT.format(write="raise EOFError"), EXPORT, {}, "EOFError()"),
    "no file": ("formats", FORMAT.format(write=""), EXPORT, {}, "wrote nothing"),
    "criterion": ("criteria", CRITERION.format(label="inner", more=", x"), SOLVE, CRACKED, "TypeError"),
    "leaves": ("counts", "import sys\nsys.exit(3)", SEARCH, {}, "cannot be loaded"),
    "images": ("counts", COUNT.format(of="return layouts.labellings[:, 0] + 0", terms=""), SEARCH, UP, "mirror image"),
    "no layout": ("drivers", DRIVER.format(ask="return self.space.fixed[None][:0]", tell=""), ASK, {}, "no layout"),
    "label": ("criteria", CRITERION.format(label="both", more=""), SOLVE, CRACKED, "in place of 'both'"),
}  # fmt: skip
"""Group, code, command, what the scene has besides, and words of the line."""


def stranger(folder: Path, group: str, name: str, code: str) -> Path:
    """A place where a package stands whose only plug-in, of a group, is the name Plug of a module of this code."""
    facts, module = folder / "site" / "stranger-1.dist-info", f"stranger_{name.replace(' ', '_')}"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1\n")
    (facts / "entry_points.txt").write_text(f"[jld.{group}]\nplug = {module}:Plug\n")
    (facts.parent / f"{module}.py").write_text(
        code.replace("        \n", "        pass\n").replace("    \n", "    pass\n")
    )
    return facts.parent


LATER = """from jld_explore.drivers import BufferedRandom
calls = []
def late():
    calls.append(0)
    if len(calls) == 4: raise ValueError('late')
"""
DRAW = "return self.register.admit(self.moves.draw(4, BufferedRandom(np.random.default_rng(len(calls)))), limit)"
OWN = "def Plug(evaluation, assembly, labels):\n    late()\n    return evaluation.load_factor"
LATE = {
    "objective": ("objectives", OWN, ("--objective", "plug", "--driver", "hillclimb")),
    "driver": ("drivers", DRIVER.format(ask=DRAW, tell="late()"), ("--driver", "plug")),
    "enumeration": ("objectives", OWN, ("--objective", "plug", "--driver", "enumeration")),
}


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("case", LATE)
def test_what_was_found_before_a_plug_in_failed_is_kept(
    case: str, tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line says so; the tables hold it, and a search goes on once the code is mended."""
    group, code, options = LATE[case]
    place = stranger(tmp_path, group, f"late {case}", "import numpy as np\n" + LATER + code)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(small()))
    line = ("explore", "scene.json", "--out", "out", "--jobs", "1", "--check-fields", "0", *options)
    with installed(place, monkeypatch):
        done = jld(*line)
        kept = len(je.read_folder("out").results)
        again = jld(*line, "--resume", "--budget", "60")
        then = len(je.read_folder("out").results)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert "ValueError('late')" in done.err
    assert "what was found until then is in out" in done.err
    assert again.code == 0
    assert then > kept >= 3


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", FAULTY)
def test_what_a_strangers_code_does_wrong_is_one_line(
    case: str, tmp_path: Path, jld: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And its package is named: it raises, ends the process, returns what nobody can use, or contradicts itself."""
    group, code, line, more, words = FAULTY[case]
    place = stranger(tmp_path, group, case, code)
    scene = small() if "criterion" in more else small(**more)
    scene["grid"] |= {"rows": ["aa", "##"]}
    if scene["search"].pop("symmetric", False):
        scene |= {"grid": scene["grid"] | {"rows": ["aaa", "###"]}, "loads": {"live": [{"body": [0, 1]}]}}
    if "criterion" in more:
        scene["materials"]["inner"] = more
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    (tmp_path / "file.plug").write_text("x")
    with installed(place, monkeypatch):
        done = jld(*line)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done
    assert words in done.err
    assert (tmp_path / "out").exists() == ("what was found until then is in out" in done.err)
    assert (
        case in ("nothing asked", "numbers asked", "excluded", "bound", "no file", "no layout")
        or "stranger" in done.err
    )
