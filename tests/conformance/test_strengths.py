"""The numbers of strengths are read by routes that know every fact in them, and by nobody else."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import jld_core.strengths
from cases import grid_assembly
from jld_core import FACTS, InputError, Route
from jld_core.strengths import CRITERIA, STANDARD, FaceStrengths, StatedCriterion

SOURCES = Path(__file__).parents[2] / "src"
OWNER = "jld_core/strengths.py"
PRIVATE = {"_stated_numbers", "_nominal_numbers"}


def _modules(*words: str) -> Iterator[tuple[str, ast.Module]]:
    """Modules that hold one of the words."""
    for path in sorted(SOURCES.rglob("*.py")):
        if any(word in (text := path.read_text(encoding="utf-8")) for word in words):
            yield path.relative_to(SOURCES).as_posix(), ast.parse(text)


def _name(node: ast.AST) -> str:
    """Return the attribute, keyword or string that a node of a syntax tree states."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return str(node.arg if isinstance(node, ast.keyword) else node.value if isinstance(node, ast.Constant) else "")


def test_nobody_else_reads_the_numbers() -> None:
    """Private fields stand in the owner alone, and `strengths` of a structure is called with a route."""
    wrong = []
    for name, tree in _modules("strengths", *PRIVATE):
        calls = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args}
        for node in ast.walk(tree):
            if name != OWNER and _name(node) in PRIVATE:
                wrong.append(f"{name}: {_name(node)}")
            if isinstance(node, ast.Attribute) and node.attr == "strengths" and id(node) not in calls:
                owner = ast.unparse(node.value)
                wrong += [f"{name}: {owner}.strengths is no call with a route"] if "assembly" in owner else []
    assert not wrong


def test_a_route_states_facts_that_exist() -> None:
    for name, tree in _modules("_ROUTE"):
        for node in ast.walk(tree):
            if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "_ROUTE" and node.value is not None:
                route = eval(ast.unparse(node.value), vars(jld_core.strengths))
                assert set(FACTS) >= route.KNOWS, f"{name}: {route}"


@pytest.mark.parametrize("label", ["dry", "inner"])
def test_a_fact_that_a_route_does_not_know_is_refused(label: str) -> None:
    assembly = grid_assembly(["ab", "##"])
    numbers = assembly.strengths(Route("a test"))
    faces = np.ones(len(numbers.friction), dtype=bool)
    stated = FaceStrengths(numbers, criteria=(StatedCriterion(label, "hoek_brown", (), faces),))
    with pytest.raises(InputError, match=rf'^materials.{label}.criterion: "hoek_brown" is unknown to the experiment; '):
        stated.numbers(Route("the experiment"), faces)
    assert stated.numbers(Route("programs", STANDARD | CRITERIA), faces) is numbers
    # of one labelling, only the label that the criterion is for counts
    assert stated.numbers(Route("the experiment"), faces, np.full(len(faces), label == "inner")) is numbers


def test_a_standard_fact_is_refused_in_the_same_way() -> None:
    assembly = grid_assembly(["ab", "##"])
    with pytest.raises(InputError, match=r"friction of joints \(face c0r0–c1r0\) is unknown to a printer; expected"):
        assembly.strengths(Route("a printer", frozenset()))
