"""The guess at labellings before they are solved: what it learns, what it forgets, and that units do not matter."""

from __future__ import annotations

import numpy as np

from cases import grid_document
from jld_core import build_assembly, parse_scene
from jld_explore import SearchSpace, search_space
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.searcher import Pool
from jld_explore.drivers.surrogate import SLOTS, Surrogate
from jld_explore.space import keys


def space_of(rows: list[str]) -> SearchSpace:
    scene = parse_scene(grid_document(rows, block_cells=[1, 3]))
    return search_space(scene, build_assembly(scene))


def test_guesses_rank_as_truth_does_and_units_do_not_matter() -> None:
    space = space_of(["aaa", "aaa", "aaa", "###"])
    rows = Enumeration(space).ask(2000)
    rows = rows[np.random.default_rng(1).permutation(len(rows))]
    worth = rows @ np.random.default_rng(0).normal(size=rows.shape[1])
    one, other = Surrogate(space), Surrogate(space)
    one.learn(rows[:200], worth[:200])
    other.learn(rows[:200], np.exp(3.0 * worth[:200]))
    guess = one.predict(rows[200:])
    assert np.array_equal(guess, other.predict(rows[200:]))
    assert np.corrcoef(guess, worth[200:])[0, 1] > 0.7


def test_mirror_images_are_guessed_alike() -> None:
    scene = parse_scene(grid_document(["aaa", "aaa", "###"], live=[{"element": "c1r0", "force": [0, -1]}]))
    space = search_space(scene, build_assembly(scene))
    assert len(space.group) == 2
    rows = Enumeration(space).ask(60)
    model = Surrogate(space)
    model.learn(rows[:30], np.arange(30.0))
    assert np.abs(model.predict(rows[30:]) - model.predict(rows[30:][:, space.group[1]])).max() <= 2e-4


def test_the_best_and_the_last_are_kept() -> None:
    space = space_of(["aaa", "aaa", "aaa", "###"])
    rows = Enumeration(space).ask(3 * SLOTS)
    worth = np.random.default_rng(0).permutation(len(rows)).astype(float)
    model = Surrogate(space)
    for low in range(0, len(rows), 32):
        model.learn(rows[low : low + 32], worth[low : low + 32])
    assert model.share_below(np.array([worth.max(), -1.0])).tolist() == [1.0 - 0.5 / SLOTS, 0.0]
    last = rows[-SLOTS // 2 :]
    assert np.corrcoef(model.predict(last), worth[-SLOTS // 2 :])[0, 1] > 0.9


def test_predictions_do_not_depend_on_stored_covariances() -> None:
    """What is alike is kept from one guess to the next, while what is remembered changes."""
    space = space_of(["aaa", "aaa", "aaa", "###"])
    rows = Enumeration(space).ask(2 * SLOTS)
    worth = np.random.default_rng(0).normal(size=len(rows))
    model = Surrogate(space)
    pool = Pool(space, model)
    for low in range(0, len(rows), 48):
        part = rows[low : low + 48]
        pool.add(part, keys(part))
        model.learn(part[::2], worth[low : low + 48 : 2])
        assert np.array_equal(pool.predict(), model.predict(pool.rows))
        pool.keep(np.arange(0, len(pool), 3))
        assert pool.names.tolist() == keys(pool.rows)
        assert np.array_equal(pool.predict(), model.predict(pool.rows))
