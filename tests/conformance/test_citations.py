"""Formulas are cited by numbers that docs/method.md has, and no text leans on a document outside the repository."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from command import ROOT

METHOD = ROOT / "docs" / "method.md"
NUMBER = re.compile(r"\((\d+\.\d+)\)")

OUTSIDE = ["METHOD", "STYLE", "DESIGN", "LANES", "PROOF", "EXPERIMENT", "REFERENCE_VALUES", "ZERO_DILATION", "SCENE"]
"""Names of notes that were never part of the repository, as they were once cited: NAME.md, NAME §2, (NAME, …)."""


def texts() -> list[Path]:
    """Every text of the repository: what git knows, or in an unpacked archive all that is no build."""
    known = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if known.returncode == 0:
        names = [ROOT / name for name in known.stdout.splitlines()]
    else:
        folders = ("src", "tests", "benchmarks", "studies", "docs")
        names = [*ROOT.glob("*.md"), *(path for folder in folders for path in (ROOT / folder).rglob("*"))]
    kinds = {".py", ".md", ".toml", ".yaml", ".yml", ".js", ".css", ".html", ".cff", ".txt", ""}
    return sorted(path for path in names if path.is_file() and path.suffix in kinds and path != Path(__file__))


TEXTS = texts()


def numbers() -> list[str]:
    """The numbers that begin a formula: lines of the fenced blocks."""
    blocks = re.findall(r"```text\n(.*?)```", METHOD.read_text("utf-8"), flags=re.S)
    return [found for block in blocks for found in re.findall(r"^\((\d+\.\d+)\)", block, flags=re.M)]


def test_formulas_are_numbered_without_gap_or_double() -> None:
    found = [tuple(map(int, number.split("."))) for number in numbers()]
    assert len(found) > 50
    for before, after in pairwise(found):
        following = (before[0], before[1] + 1), (before[0] + 1, 1)
        assert after in following, f"({after[0]}.{after[1]}) follows ({before[0]}.{before[1]})"


def lines() -> Iterator[tuple[str, str]]:
    """Every line of every text, and where it stands."""
    for path in TEXTS:
        for count, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
            yield f"{path.relative_to(ROOT)}:{count}", line


def test_cited_formulas_exist() -> None:
    have = set(numbers())
    cited = [(place, NUMBER.findall(line)) for place, line in lines() if "method.md" in line or "method.md" in place]
    assert [place for place, found in cited if not have.issuperset(found)] == []
    assert len({number for place, found in cited if "method.md" not in place for number in found}) > 25


def test_no_text_refers_to_documents_outside_the_repository() -> None:
    name = "|".join(OUTSIDE)
    outside = re.compile(rf"\b(?:{name})(?:\.md\b| §|, §)|[( ](?:METHOD|REFERENCE_VALUES)\)|\bshared/(?:{name})")
    assert [f"{place}: {line.strip()}" for place, line in lines() if outside.search(line)] == []
