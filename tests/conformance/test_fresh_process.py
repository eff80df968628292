"""What the public names promise works in a process that has imported nothing else."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import jld_core
import jld_experiment
import jld_explore
from command import ROOT

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


OFTEN = ("plot of a result", "notebook output of an assembly", "plot of a search", "table of many")
"""What each kind of object is asked first; the others wait for `make bench`."""


@pytest.mark.parametrize(
    "program", [pytest.param(SHORT[n], id=n, marks=[] if n in OFTEN else pytest.mark.long) for n in SHORT]
)
def test_first_use(program: str, tmp_path: Path) -> None:
    _run(program, tmp_path)


def _examples() -> dict[str, str]:
    """Return the examples in docstrings of public objects and their methods, as programs by name."""
    found = {}
    for module, name in NAMES:
        thing = getattr(sys.modules[module], name)
        members: list[tuple[str, Any]] = [(name, thing)]
        if inspect.isclass(thing):
            members += [(f"{name}.{key}", one) for key, one in vars(thing).items() if callable(one)]
        for key, one in members:
            lines = re.findall(r"^\s*(?:>>>|\.\.\.) (.*)$", inspect.getdoc(one) or "", flags=re.M)
            if lines:
                found[f"{module}.{key}"] = f"from {module} import *\nimport {module}\n" + "\n".join(lines)
    return found


@pytest.mark.long
@pytest.mark.parametrize(("module", "name"), NAMES)
def test_each_name_alone(module: str, name: str, tmp_path: Path) -> None:
    _run(f"import {module}\n{module}.{name}", tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("program", _examples().values(), ids=_examples())
def test_each_example_of_a_docstring_alone(program: str, tmp_path: Path) -> None:
    _run(program, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_of_the_guide_alone(page: Path, tmp_path: Path) -> None:
    """A page's examples run one after the other, as a reader would paste them into a new session."""
    _run("\n".join(re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), flags=re.S)), tmp_path)
