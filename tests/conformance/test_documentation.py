"""The documentation builds without a warning, holds every public name, and its examples print what they promise."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import jld_core
import jld_explore.explore
from paths import ROOT

DOCS = ROOT / "docs"
GUIDE = sorted(DOCS.glob("guide/*.md"))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the pages, built as `make docs` does."""
    out = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", str(out / "trees")]
    done = subprocess.run([*command, str(DOCS), str(out / "html")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / "html"


def test_every_public_name_is_described(pages: Path) -> None:
    written = "".join((pages / "reference" / f"{name}.html").read_text("utf-8") for name in ("core", "explore"))
    for module in (jld_core, jld_explore.explore):
        for name in module.__all__:
            assert f'id="{module.__name__}.{name}"' in written, f"{module.__name__}.{name}"


def test_descriptions_are_the_docstrings(pages: Path) -> None:
    written = re.sub("<[^>]+>", "", (pages / "reference" / "core.html").read_text("utf-8"))
    assert "Collapse load factor of one labelling, with a two-sided bracket." in written
    assert "labels: (m,) True dry; default the scene’s own." in written


@pytest.mark.parametrize("page", GUIDE, ids=lambda page: page.stem)
def test_examples_of_the_guide(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A page's examples run from top to bottom, as a reader would paste them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    space: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), flags=re.S):
        exec(compile(block, page.name, "exec"), space)
        printed = capsys.readouterr().out
        for line in block.splitlines():
            if line.startswith("# "):
                assert line[2:] in printed
