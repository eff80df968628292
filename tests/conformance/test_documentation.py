"""The documentation builds without a warning, holds every public name, and its examples print what they promise."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import jld_core
import jld_experiment
import jld_explore
from command import ROOT

DOCS = ROOT / "docs"
GUIDE = sorted(DOCS.glob("guide/*.md"))


def test_documentation_builds_without_a_warning_and_describes_every_public_name(tmp_path: Path) -> None:
    """Built as `make docs` does, but without its look; in one test, since building is what takes time."""
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "xml", "-d", str(tmp_path / "trees")]
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


@pytest.mark.usefixtures("without_pictures")
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
