"""Where laying starts: the ground, a side or the springings; and the first stage that falls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases import grid_assembly
from command import Command
from jld_core import Assembly, InputError, build_assembly, samples
from jld_practice.laying import Laying, assembly_order


def places(laying: Laying) -> list[float]:
    """x of the blocks in the order in which they are laid."""
    blocks = laying.blocks
    centroid = blocks.assembly.elements.centroid
    return [round(float(centroid[blocks.elements(step.blocks[0])][:, 0].mean()), 9) for step in laying.steps]


def row() -> Assembly:
    """Five blocks side by side on the ground, in two courses."""
    return grid_assembly(["fghij", "abcde", "#####"])


def test_a_row_is_laid_from_a_side() -> None:
    """Columns follow one another from the left or the right; from the ground the lower course comes first."""
    assembly = row()
    order = {
        start: places(assembly_order(assembly, assembly.labels, start=start)) for start in ("left", "right", "ground")
    }
    assert order["left"] == sorted(order["left"])
    assert order["right"] == sorted(order["right"], reverse=True)
    ground = assembly_order(assembly, assembly.labels)
    first = [int(ground.blocks.elements(step.blocks[0])[0]) for step in ground.steps]
    heights = assembly.elements.centroid[first, 1].round(9).tolist()
    assert heights == sorted(heights)


WINDOWS = [
    ["aabbbbcc", "ddbeefff", "ghh..iij", "kkk..llm", "nnn..oom", "########"],
    ["aaabbbcc", "addefggg", "hhh..iij", "hkk..llj", "mnnoolpp", "########"],
    ["aaabbbbc", "addbefff", "ggh..iij", "kkh..ill", "mmmnnopq", "########"],
]
"""Walls with a window or a door, of stones some of which need a prop until the next course loads them."""


@pytest.mark.parametrize("rows", WINDOWS, ids=["window", "door", "high window"])
def test_a_wall_with_a_window_grows_by_courses(rows: list[str]) -> None:
    """No stone is laid before the courses below are complete, whatever props its own course needs."""
    assembly = grid_assembly(rows)
    found = assembly_order(assembly, assembly.labels)
    assert found.possible
    bottoms = [
        min(float(assembly.elements.lower[e, 1]) for e in found.blocks.elements(step.blocks[0])) for step in found.steps
    ]
    assert [round(bottom, 6) for bottom in bottoms] == sorted(round(bottom, 6) for bottom in bottoms)


def test_an_arch_is_laid_from_its_springings() -> None:
    """Voussoirs come in pairs from both springings, and the keystone last, by symmetry in this order only."""
    assembly = build_assembly(samples.arch(voussoirs=7))
    found = assembly_order(assembly, assembly.labels, start="springings")
    assert found.possible
    distance = [abs(x) for x in places(found)]
    assert all(a >= b - 1e-9 for a, b in zip(distance, distance[2:], strict=False))
    assert distance[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("start", ["left", "right", "springings", "ground"])
def test_every_start_is_an_order_of_all_blocks(start: str) -> None:
    """Each free block is laid once, in a direction that is free: the same blocks whatever the start."""
    assembly = build_assembly(samples.wall(courses=3, length=1.2))
    found = assembly_order(assembly, assembly.labels, start=start)  # type: ignore[arg-type]
    laid = [block for step in found.steps for block in step.blocks]
    assert sorted(laid) == np.flatnonzero(~found.blocks.fixed).tolist()
    assert found.stands


def test_another_start_is_refused() -> None:
    """A name that is no start is one line."""
    assembly = row()
    with pytest.raises(InputError, match="'middle' is no start of laying"):
        assembly_order(assembly, assembly.labels, start="middle")  # type: ignore[arg-type]


def test_the_first_stage_that_falls_is_named(jld: Command, tmp_path: Path) -> None:
    """An arch without centring: the answer to `standing` names step, stone and prop, and draws every stage."""
    scene = tmp_path / "arch.json"
    assert jld("new", "arch", "--voussoirs", "3", "--embrace", "120", "-o", scene).code == 0
    done = jld("assembly", scene, "--wish", "standing", "--start", "springings", "--out", tmp_path / "out", "--stages")
    assert done.code == 0, done.err
    assert "none whose every stage stands" in done.out
    assert "the first that falls is step " in done.out
    assert sorted(path.name for path in (tmp_path / "out").glob("stage-*.png")) == [
        f"stage-{k}.png" for k in range(1, 4)
    ]
    refused = jld("assembly", scene, "--stages")
    assert refused.code == 2
    assert refused.err.startswith("jld: --stages: there is no folder")
