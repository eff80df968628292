"""Docstrings of exported names: a plain first line, and the NumPy sections that the signature needs.

The rules are those of CONTRIBUTING. Names that do not follow them yet are counted for each package, and no count may
grow; whoever mends one lowers the number.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import jld_core
import jld_experiment
import jld_explore
from command import ROOT

LEFT: dict[str, int] = {}
"""Exported names, by package, whose docstrings do not follow the rules yet."""


def packages() -> list[str]:
    """Every package and sub-package, by its dotted name."""
    found = []
    for top in (jld_core, jld_experiment, jld_explore):
        found.append(top.__name__)
        found += [one.name for one in pkgutil.walk_packages(top.__path__, f"{top.__name__}.") if one.ispkg]
    return found


def lacks(thing: Any) -> str:
    """What the docstring of an exported function or class lacks, "" for nothing."""
    text = inspect.getdoc(thing) or ""
    first = text.split("\n", 1)[0]
    if not first.endswith((".", ":")) or len(first) > 110:
        return "a first line that is one short sentence"
    if not callable(thing):
        return ""
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    if inspect.isclass(thing) and issubclass(thing, (BaseException, str, int)):
        return ""
    named = [name for name in signature.parameters if name not in ("self", "args", "kwargs", "options")]
    if named and not re.search(r"^(Parameters|Attributes)\n-+$", text, flags=re.M):
        return "a section Parameters or Attributes"
    returns = signature.return_annotation
    if inspect.isclass(thing) or returns in (None, "None", inspect.Signature.empty):
        return ""
    return "" if re.search(r"^(Returns|Yields)\n-+$", text, flags=re.M) else "a section Returns"


def lacking(package: str) -> Counter[str]:
    """Exported names of a package, owned by it, with what their docstrings lack."""
    module = importlib.import_module(package)
    found: Counter[str] = Counter()
    for name in getattr(module, "__all__", ()):
        thing = getattr(module, name)
        owner = getattr(thing, "__module__", "") or ""
        if not (inspect.isclass(thing) or inspect.isfunction(thing)) or not owner.startswith(package):
            continue
        if what := lacks(thing):
            found[f"{name} lacks {what}"] += 1
    return found


@pytest.mark.parametrize("package", packages())
def test_exported_names_are_described(package: str) -> None:
    found = lacking(package)
    assert len(found) <= LEFT.get(package, 0), sorted(found)


def test_the_numbers_of_names_left_are_true() -> None:
    """A number that is too high would let others slip in."""
    assert {package: len(lacking(package)) for package in LEFT} == LEFT


def test_terms_of_the_glossary_are_used() -> None:
    """Each term stands somewhere else in the documentation or the code."""
    rows = re.findall(r"^\| ([^|]+) \|", (ROOT / "docs" / "glossary.md").read_text("utf-8"), flags=re.M)
    terms = [term.strip() for row in rows for term in row.split(",") if not row.startswith(("term", "---"))]
    files = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("src/**/*.py")]
    text = "\n".join(path.read_text("utf-8") for path in files if path.name != "glossary.md").lower()
    assert [term for term in terms if term.lower() not in text] == []


# Formulas are cited by numbers that docs/method.md has, and no text leans on a document outside the repository.


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
        name = path.relative_to(ROOT)  # once: it takes as long as to search a line
        for count, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
            yield f"{name}:{count}", line


def test_cited_formulas_exist() -> None:
    have = set(numbers())
    cited = [(place, NUMBER.findall(line)) for place, line in lines() if "method.md" in line or "method.md" in place]
    assert [place for place, found in cited if not have.issuperset(found)] == []
    assert len({number for place, found in cited if "method.md" not in place for number in found}) > 25


def test_no_text_refers_to_documents_outside_the_repository() -> None:
    name = "|".join(OUTSIDE)
    outside = re.compile(rf"\b(?:{name})(?:\.md\b| §|, §)|[( ](?:METHOD|REFERENCE_VALUES)\)|\bshared/(?:{name})")
    named = ((place, line) for place, line in lines() if any(one in line for one in OUTSIDE))
    assert [f"{place}: {line.strip()}" for place, line in named if outside.search(line)] == []
