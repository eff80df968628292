"""The plain C interface of the batch solver is stated twice, in C and for ctypes: here both are held against each
other.

A field out of its place would make no noise: the batch solver would take one array for another.
"""

from __future__ import annotations

import ctypes
import re
from typing import Any, Final

import pytest

from jld_core.batch import batch_solver, blocks, build, library
from jld_core.batch.batch_solver import CARRIES, FALLS, LOCKED, OPEN, PROVEN
from jld_core.batch.conflict_request import CARRIED, REFUTED

SOURCES: Final = {
    name: re.sub(r"//[^\n]*", "", (build.SOURCE / name).read_text(encoding="utf-8"))
    for name in ("problem.h", "blocks.h", "cholesky.h")
}

KINDS: Final[dict[str, Any]] = {
    "int32_t": ctypes.c_int32,
    "int64_t": ctypes.c_int64,
    "uint64_t": ctypes.c_uint64,
    "uint8_t": ctypes.c_uint8,
    "double": ctypes.c_double,
    "jld::FactorPattern": library.FactorPattern,
}

STRUCTURES: Final = {
    "FactorPattern": ("cholesky.h", library.FactorPattern),
    "JldProblem": ("problem.h", library.Problem),
    "JldTry": ("problem.h", library.Try),
    "JldShrinking": ("problem.h", library.MinimizationOptions),
    "JldAnswers": ("problem.h", library.Answers),
    "JldBlocks": ("blocks.h", library.Blocks),
    "JldBlockTask": ("blocks.h", library.BlockTask),
}


def stated(source: str, name: str) -> list[tuple[str, Any]]:
    """Fields of a structure in C, by name and the ctypes kind that their type is."""
    found = re.search(rf"struct {name} \{{(.*?)\}};", SOURCES[source], re.DOTALL)
    assert found is not None
    fields = []
    for line in filter(None, (part.strip() for part in found.group(1).split(";"))):
        declared = re.fullmatch(r"(?:const )?([\w:]+)(\*?) ([\w, ]+)", line)
        assert declared is not None, line
        kind, star, names = declared.groups()
        made = ctypes.POINTER(KINDS[kind]) if star else KINDS[kind]
        fields += [(own.strip(), made) for own in names.split(",")]
    return fields


@pytest.mark.parametrize("name", STRUCTURES)
def test_structures_are_the_same_field_by_field(name: str) -> None:
    source, made = STRUCTURES[name]
    fields = stated(source, name)
    assert len(fields) > 5
    assert list(made._fields_) == fields


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("JldVerdict", {"OPEN": OPEN, "PROVEN": PROVEN, "FALLS": FALLS, "CARRIES": CARRIES, "LOCKED": LOCKED}),
        ("JldFate", {"LEFT": 0, "REFUTED": REFUTED, "CARRIED": CARRIED}),
        ("JldLabel", {"INNER": int(False), "DRY": int(True), "UNDECIDED": batch_solver._UNDECIDED}),
    ],
)
def test_codes_are_the_same(name: str, numbers: dict[str, int]) -> None:
    found = re.search(rf"enum {name} : \w+ \{{(.*?)\}};", SOURCES["problem.h"])
    assert found is not None
    assert {key: int(value) for key, value in re.findall(r"JLD_(\w+) = (\d+)", found.group(1))} == numbers


def test_both_know_how_many_rows_a_block_may_have() -> None:
    assert f"MOST = {blocks._ROWS};" in SOURCES["blocks.h"]
