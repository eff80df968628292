"""The documentation builds without a warning, holds every public name, and its examples print what they promise."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

import jld_core
import jld_experiment
import jld_explore
from command import ROOT, app
from jld_explore.drivers import DRIVERS

DOCS = ROOT / "docs"
GUIDE = sorted(DOCS.glob("guide/*.md"))


def test_documentation_builds_without_a_warning_and_describes_every_public_name(tmp_path: Path) -> None:
    """Built as `make docs` does, but without its look; in one test, since building is what takes time."""
    # a quarter of the processor time was to look for garbage among the nodes, of which there is none
    build = "import gc, sys, sphinx.cmd.build as make; gc.disable(); sys.exit(make.main(sys.argv[1:]))"
    command = [sys.executable, "-c", build, "-W", "--keep-going", "-q", "-b", "xml", "-d", str(tmp_path / "trees")]
    done = subprocess.run([*command, str(DOCS), str(tmp_path / "xml")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = [tmp_path / "xml" / "reference" / f"{name}.xml" for name in ("core", "explore", "experiment")]
    written = "".join(page.read_text("utf-8") for page in pages)
    described = {one for ids in re.findall('ids="([^"]*)"', written) for one in ids.split()}
    for module in (jld_core, jld_explore, jld_experiment):
        for name in (f"{module.__name__}.{name}" for name in module.__all__):
            assert {name, f"module-{name}"} & described, name
    text = re.sub("<[^>]+>", "", written)
    assert "Compute the collapse load factor of one labelling, with a two-sided bracket." in text
    assert "True or 1 = dry, False or 0 = inner, or a text of the letters d and i." in text
    assert "--------" not in text  # titles of sections are no plain text


@pytest.mark.usefixtures("without_pictures", "without_field_check")
@pytest.mark.parametrize("page", GUIDE, ids=lambda page: page.stem)
def test_examples_of_the_guide(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A page's examples run from top to bottom, as a reader would paste them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    space: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), flags=re.S):
        exec(compile(block, page.name, "exec"), space)
        printed = capsys.readouterr().out
        for line in block.splitlines():
            if line.startswith("# "):
                assert line[2:] in printed


# Every Python example of the README runs, and prints what the README says.


TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, flags=re.S)


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_example(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    exec(compile(BLOCKS[number], f"README.md example {number}", "exec"), {})
    promised = [line[2:] for line in BLOCKS[number].splitlines() if line.startswith("# ")]
    assert promised
    printed = capsys.readouterr().out
    for line in promised:
        assert line.removesuffix(" …") in printed


def test_readme_is_short_and_has_its_parts() -> None:
    """One screen and a half: what it is, a picture, two commands, Python, the command line, where to read on."""
    assert len(TEXT.splitlines()) <= 90
    code = [line for line in BLOCKS[0].splitlines() if line and not line.startswith("#")]
    assert len(code) <= 15
    (own,) = re.findall(r"```sh\n(jld .*?)```", TEXT, flags=re.S)
    assert len(own.splitlines()) == 5


def test_commands_named_in_the_readme_exist() -> None:
    for name in re.findall(r"^jld (\w+)", TEXT, flags=re.M):
        assert name in get_command(app).list_commands(None)
    assert set(re.findall(r"`(\w+)`", TEXT.split("| driver |")[1].split("## ")[0])) == set(DRIVERS)


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target


# What the public names promise works in a process that has imported nothing else.


PAGES = sorted((ROOT / "docs" / "guide").glob("*.md"))
START = "import jld_core as jc\n"
SEARCH = "from jld_explore import explore; r = explore('scenes/flat_beam_arch.json', driver='random', budget=3"
SHORT = {
    "plot of a result": START + "print(jc.solve('scenes/flat_beam_arch.json').plot())",
    "notebook output of a result": START + "assert '<table' in jc.solve('scenes/flat_beam_arch.json')._repr_html_()",
    "notebook output of an assembly": START
    + "a = jc.build_assembly(jc.load_scene('scenes/spatial_shelf.json'))\nassert a._repr_svg_() or a._repr_png_()",
    "plot of an assembly": START + "print(jc.build_assembly(jc.load_scene('scenes/spatial_shelf.json')).drawn())",
    "plot of a search": SEARCH + ", pictures=False); print(r.plot())",
    "table of many": START
    + "a = jc.build_assembly(jc.load_scene('scenes/flat_beam_arch.json'))\n"
    + "print(jc.solve_many(a, [a.labels]).to_frame())",
}
MODULES = (jld_core, jld_explore, jld_experiment)
NAMES = [(module.__name__, name) for module in MODULES for name in module.__all__]


def _run(program: str, folder: Path) -> None:
    """Run a program in a new process whose current folder has the shipped scenes."""
    for name in ("scenes", "notebooks"):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.long
@pytest.mark.parametrize("program", SHORT.values(), ids=SHORT)
def test_first_use(program: str, tmp_path: Path) -> None:
    _run(program, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize(("module", "name"), NAMES)
def test_each_name_and_each_example_of_its_docstrings_alone(module: str, name: str, tmp_path: Path) -> None:
    _run(f"import {module}\n{module}.{name}", tmp_path)
    thing = getattr(sys.modules[module], name)
    for one in (thing, *(filter(callable, vars(thing).values()) if inspect.isclass(thing) else ())):
        lines = re.findall(r"^\s*(?:>>>|\.\.\.) (.*)$", inspect.getdoc(one) or "", flags=re.M)
        if lines:
            _run(f"from {module} import *\nimport {module}\n" + "\n".join(lines), tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_of_the_guide_alone(page: Path, tmp_path: Path) -> None:
    """A page's examples run one after the other, as a reader would paste them into a new session."""
    _run("\n".join(re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), flags=re.S)), tmp_path)
