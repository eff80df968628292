"""Docstrings of exported names: a plain first line, and the NumPy sections that the signature needs.

The rules are those of CONTRIBUTING. Names that do not follow them yet are counted for each package, and no count may
grow; whoever mends one lowers the number.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import jld_core
import jld_experiment
import jld_explore

ROOT = Path(__file__).resolve().parents[2]
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
