"""One formula for a whole proof: what it is aimed at, and what holds above some λ alone."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from cases import grid_document
from jld_core import build_assembly, parse_scene
from jld_core.arrays import Bits
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.context import possible_blocks
from jld_explore.drivers.exact.formula import Formula
from jld_explore.space import SearchSpace, count_named, search_space, values_of
from jld_explore.space.limits import Range


def space_of(count: str) -> SearchSpace:
    options = {"block_cells": [1, 3], "front": {"count": count}, "dry_faces": [4, 6]}
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], **options))
    return search_space(scene, build_assembly(scene))


def left(formula: Formula) -> list[Bits]:
    """All labellings that are left, up to symmetry, each set aside once found."""
    rows: list[Bits] = []
    while (labels := formula.next()) is not None:
        rows.append(labels)
        formula.set_aside(np.arange(len(labels)), labels)
    return rows


@pytest.mark.parametrize("count", ["dry_faces", "blocks"])
def test_a_formula_is_aimed_at_one_count_after_the_other(count: str) -> None:
    space = space_of(count)
    every = np.concatenate([rows for rows, _ in Enumeration(space).batches()])
    expected = Counter(values_of(count_named(count), space.assembly, every, space.graph).tolist())
    assert len(expected) >= 3
    formula = Formula(space, possible_blocks(space))
    assert len(left(formula)) == len(every)
    for wanted in (*sorted(expected), min(expected), 0, 100):
        formula.aim(0.0, wanted)
        found = left(formula)
        assert len(found) == expected[wanted]
        assert not formula.possible((), ())
    below = min(expected) + 1
    for bounds, number in (
        (Range.of((None, below), whole=True), sum(expected[value] for value in expected if value <= below)),
        (Range.of((below, None), whole=True), sum(expected[value] for value in expected if value >= below)),
    ):
        formula.aim(0.0, bounds)
        assert len(left(formula)) == number
    formula.aim(0.0)
    assert len(left(formula)) == len(every)


def test_conflicts_hold_above_their_bounds_in_whatever_order_these_are_aimed_at() -> None:
    space = space_of("dry_faces")
    formula = Formula(space, possible_blocks(space))
    rows = left(formula)
    everywhere = np.arange(len(space.fixed))
    bounds = np.random.default_rng(0).permutation(len(rows)).astype(float)
    told = len(rows) // 2
    for place, (labels, bound) in enumerate(zip(rows, bounds, strict=True)):
        if place == told:
            # half of them are there before anything is aimed at, the others come in between
            formula.aim(bounds[:told].mean())
        formula.forbid(everywhere, labels, bound)
    for threshold in (-1.0, len(rows) / 2, 3.5, 7.0, len(rows) / 4, 7.0, 1e3, 0.0, 6.5):
        formula.aim(threshold)
        assert len(left(formula)) == (bounds > threshold).sum()
        formula.raise_threshold(threshold - 1.0)
        assert not formula.possible((), ())
    # nothing that was set aside comes back where only the threshold rises
    formula.aim(3.0)
    labels = formula.next()
    assert labels is not None
    formula.set_aside(everywhere, labels)
    formula.raise_threshold(5.0)
    place = next(place for place, row in enumerate(rows) if (row == labels).all())
    assert len(left(formula)) == (bounds > 5.0).sum() - (bounds[place] > 5.0)
    # a conflict found anew with a smaller bound holds lower down too
    highest = int(bounds.argmax())
    formula.aim(len(rows) - 1.5)
    assert len(left(formula)) == 1
    formula.forbid(everywhere, rows[highest], 2.0)
    formula.aim(len(rows) - 1.5)
    assert left(formula) == []
