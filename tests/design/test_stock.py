"""Stones in stock cuboids: places are valid, the number of cuboids is proven from below, bad input is one line."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cases import grid_document
from command import Command
from jld_core import parse_scene
from jld_core.errors import ParameterError
from jld_practice.printed import Stone
from jld_practice.printing import Placed, least_number, stock_of


def stone(number: int, *sides: float) -> Stone:
    """A cuboid."""
    size = tuple(sorted(sides, reverse=True))
    return Stone(number, f"s{number}", 1, 1.0, math.prod(sides), size, 6, 3, 1.0, None)


def apart(one: Placed, other: Placed, kerf: float) -> bool:
    """Return True if two stones of one cuboid leave room for a cut."""
    sides = zip(one.corner, one.sides, other.corner, other.sides, strict=True)
    return any(p + a + kerf <= q + 1e-9 or q + b + kerf <= p + 1e-9 for p, a, q, b in sides)


@pytest.mark.parametrize("kerf", [0.0, 0.01])
def test_stones_lie_in_the_stock_and_apart(kerf: float) -> None:
    """No stone leaves its cuboid, none meets another, sides are those of the stone; the bound is never exceeded."""
    rng = np.random.default_rng(1)
    for _ in range(8):
        stones = [stone(k, *rng.uniform(0.1, 0.9, 3)) for k in range(1, 15)]
        found = stock_of(stones, (1.0, 1.2, 0.95), kerf)
        assert sorted(one.stone for one in found.placed) == list(range(1, 15))
        for one in found.placed:
            assert sorted(one.sides, reverse=True) == pytest.approx(stones[one.stone - 1].size)
            ends = [at + side for at, side in zip(one.corner, one.sides, strict=True)]
            assert all(end <= side * (1.0 + 1e-9) for end, side in zip(ends, found.size, strict=True))
        for one, other in itertools.combinations(found.placed, 2):
            assert one.cuboid != other.cuboid or apart(one, other, kerf)
        assert found.least <= found.cuboids
        assert found.least_waste <= found.waste


def test_known_packings() -> None:
    """Eight half cubes fill one cube, four slabs of a quarter too; with a kerf the fourth slab has no room."""
    cubes = stock_of([stone(k, 0.5, 0.5, 0.5) for k in range(8)], (1.0, 1.0, 1.0))
    assert (cubes.cuboids, cubes.least) == (1, 1)
    assert cubes.waste == pytest.approx(0.0, abs=1e-12)
    slabs = [stone(k, 1.0, 1.0, 0.25) for k in range(4)]
    assert stock_of(slabs, (1.0, 1.0, 1.0)).cuboids == 1
    assert stock_of(slabs, (1.0, 1.0, 1.0), 0.01).cuboids == 2


@pytest.mark.parametrize(
    ("volumes", "expected"),
    [([0.6] * 5, 5), ([0.5] * 5, 3), ([0.7, 0.7, 0.35, 0.35, 0.35], 4), ([0.2] * 10, 2), ([], 0)],
)
def test_the_least_number_of_known_cases(volumes: list[float], expected: int) -> None:
    """Martello and Toth's L2; no assignment of volumes to fewer cuboids exists, by trying all of them."""
    assert least_number(volumes, 1.0) == expected
    owners = itertools.product(range(expected - 1), repeat=len(volumes)) if 0 < len(volumes) < 8 else ()
    for owner in owners:
        assert max(np.bincount(owner, volumes, minlength=1)) > 1.0 + 1e-9


def test_the_command_writes_where_stones_lie(jld: Command, tmp_path: Path) -> None:
    """The table holds every stone in millimetres; the line says number, bound and waste."""
    scene = tmp_path / "wall.json"
    scene.write_text(parse_scene(grid_document(["aab", "ccb", "###"])).model_dump_json(exclude_defaults=True))
    done = jld("report", scene, "--pdf", "--stock", "10000,10000,10000", "--kerf", "5")
    assert done.code == 0, done.err
    assert "1 stock cuboid, the least number; waste" in done.out
    table = pd.read_csv(tmp_path / "wall.stock.csv")
    assert len(table) == 3
    assert (table["at_1_mm"] + table["side_1_mm"]).max() <= 10000.0


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--pdf", "--stock", "1,2"], "--stock: '1,2' is wrong"),
        (["--pdf", "--stock", "1,2,x"], "--stock: '1,2,x' is wrong"),
        (["--zip", "--stock", "1,2,3"], "--stock: stones are placed beside the cutting list"),
        (["--pdf", "--kerf", "3"], "--kerf: it is given without"),
        (["--pdf", "--stock", "1,1,1"], "mm does not fit into 1 × 1 × 1 mm"),
        (["--pdf", "--stock=-1,1,1"], "--stock: a side is not above 0"),
        (["--pdf", "--stock", "9000,9000,9000", "--kerf=-1"], "--kerf: it is no width of a cut"),
        (["--pdf", "--stock", "1e300,1e300,1e300"], "--stock: the volume of a cuboid is out of range"),
    ],
)
def test_bad_stock_is_one_line(jld: Command, tmp_path: Path, flags: list[str], words: str) -> None:
    """Exit code 2, one line, nothing written."""
    scene = tmp_path / "wall.json"
    scene.write_text(parse_scene(grid_document(["aab", "ccb", "###"])).model_dump_json(exclude_defaults=True))
    done = jld("report", scene, *flags)
    assert done.code == 2
    assert words in done.err
    assert done.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["wall.json"]


def test_a_stone_that_does_not_fit_is_named() -> None:
    """The message has the stone and its sides."""
    with pytest.raises(ParameterError, match="stone 3 of 2 × 1 × 1 does not fit into"):
        stock_of([stone(3, 1.0, 2.0, 1.0)], (1.5, 1.5, 1.5))
    with pytest.raises(ParameterError, match="of 200 × 100 × 100 cm does not fit into 150 × 150 × 150 cm"):
        stock_of([stone(3, 1.0, 2.0, 1.0)], (1.5, 1.5, 1.5), said=(100.0, " cm"))
