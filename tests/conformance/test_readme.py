"""Every Python example of the README runs, and prints what the README says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from command import ROOT
from jld_explore.cli import overview

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
        assert name in overview.COMMANDS
    assert set(re.findall(r"`(\w+)`", TEXT.split("| driver |")[1].split("## ")[0])) == set(overview.DRIVERS)


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target
