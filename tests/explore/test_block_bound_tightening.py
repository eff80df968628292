"""A proof that lasts asks the relaxation by blocks: the same optimum, and nothing ruled out is better than it says."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import grid_document
from jld_core import Scene, build_assembly, parse_scene
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers.exact.block_bounds import BlockBoundTightening, TightenedBound
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.driver import Exact

# what blocks that crack anywhere carry, test_field_check.py tests
pytestmark = pytest.mark.usefixtures("without_field_check")

WEAK: dict[str, Any] = {"tension": 2e3, "shear": 2e3, "block_cells": [1, 3]}
WINDS = {"loads": {"cases": [{"name": "a", "live": [{"body": [1, 0]}]}, {"name": "b", "live": [{"body": [-1, 0]}]}]}}


def scenes() -> dict[str, Scene]:
    weak = grid_document(["aaa", "aaa", "###"], **WEAK)
    return {
        "weak": parse_scene(weak),
        "cases": parse_scene(weak | WINDS),
        "crushing": parse_scene(grid_document(["aaa", "aaa", "###"], **WEAK, crush_dry=5e4, crush_inner=1e5)),
        "in space": parse_scene(_cubes()),
    }


def _cubes() -> dict[str, Any]:
    """Two by two by two cubes on a slab, in blocks of up to two."""
    document = grid_document(["a"], tension=2e3, shear=2e3, live=[{"body": [1, 0.3, 0]}], block_cells=[1, 2])
    del document["grid"]
    places = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    boxes = {f"c{x}{y}{z}": ([0.1 * x, 0.1 * y, 0.1 * z], 0.1, 0.1) for x, y, z in places}
    boxes["base"] = ([0.0, 0.0, -0.1], 0.2, 0.1)
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    elements = []
    for name, (low, wide, high) in boxes.items():
        size = (wide, wide, high)
        corners = [[low[axis] + size[axis] * (k >> axis & 1) for axis in range(3)] for k in range(8)]
        elements.append({"id": name, "support": name == "base", "vertices": corners, "faces": faces})
    return {**document, "elements": elements}


@pytest.mark.parametrize("name", ["weak", "cases", "crushing", "in space"])
def test_what_blocks_rule_out_is_no_better_and_the_optimum_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scenes()[name]
    space = search_space(scene, build_assembly(scene))
    every = explore(scene, tmp_path / "every", ExploreSettings(pictures=False, driver="enumeration"))
    monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._RELAXATIONS", (0.0, 0.0))
    monkeypatch.setattr("jld_explore.drivers.exact.block_tree._BLOCKS_PER_ELEMENT", 0)  # no tree
    driver = Exact(space, search=0)
    found = explore(scene, tmp_path / "found", ExploreSettings(pictures=False, small=0), driver=driver)
    assert driver._tightening is not None
    assert driver._tightening.solves > 0
    assert found.summary.proven is True
    assert found.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    table = every.results[every.results["status"] == "collapse"]
    for text, load in zip(table["labelling"], table["bracket_lo"], strict=True):
        for image in np.array([letter == "d" for letter in text])[space.group]:
            for one in driver.state.conflicts:
                if (image[one.faces] == one.labels).all():
                    assert load <= one.bound * driver._scale * (1.0 + 1e-9)


@pytest.mark.parametrize("late", [False, True])
def test_a_long_program_is_solved_elsewhere_and_given_up_in_time(late: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jld_explore.evaluation.worker_pool._start_process", lambda: ThreadPoolExecutor(1))
    monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._DEADLINE_CHECK_SECONDS", 0.0)
    scene = scenes()["in space"]
    space = search_space(scene, build_assembly(scene))
    context = ProofContext.of(space, 0)
    assert context is not None
    found = []
    for here in (10**9, 0):
        monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._SIDES_HERE", here)
        narrowing = BlockBoundTightening(context, wanted=True)
        answers = chain([False], repeat(here == 0 and late))
        found.append(narrowing.tighten(0.1, 1e3, math.inf, answers.__next__))
    if late:
        assert found[1] == TightenedBound(1e3, ())
    else:
        assert found[1].bound == found[0].bound < 1e3


def test_a_certificate_is_of_faces_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes()["weak"]
    monkeypatch.setattr("jld_explore.drivers.exact.block_bounds._RELAXATIONS", (0.0, 0.0))
    driver = Exact(search_space(scene, build_assembly(scene)), search=0)
    settings = ExploreSettings(pictures=False, small=0, certificate=tmp_path / "proof.jld")
    found = explore(scene, tmp_path / "out", settings, driver=driver)
    assert driver._tightening is not None
    assert driver._tightening.solves == 0
    assert found.summary.proven is True
