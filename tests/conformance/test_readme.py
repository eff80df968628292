"""Every Python example of the README runs, and prints what the README says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from jld_core import parse_scene
from paths import ROOT

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


def test_scene_example_is_a_scene() -> None:
    (text,) = re.findall(r"```json\n(.*?)```", TEXT, flags=re.S)
    assert parse_scene(json.loads(text)).name == "flat arch"


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target
