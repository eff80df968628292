"""What the pool says of labellings, against solving every one of them."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cases import DOWN, grid_document
from jld_core.build import build_assembly
from jld_core.limit import LimitAnalysis, Status
from jld_core.scene import parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.evaluation.certificates import Bounds, Forces, Mechanism, Pool, Proofs, proofs_of
from jld_explore.evaluation.records import RECORDS_FILE
from jld_explore.evaluation.with_certificates import CertificateEvaluator
from jld_explore.space import search_space

SCENES: dict[str, tuple[list[str], dict[str, Any]]] = {
    "wall": (["aaa", "aaa", "###"], {}),
    "weak wall": (["aaaa", "aaaa", "####"], {"tension": 2e3, "shear": 2e3, "block_cells": [1, 4]}),
    "bridge": (["aaaaa", "a...a", "#...#"], {"live": DOWN, "candidates": "all+supports"}),
    "crushing arch": (["#aaaaa#"], {"live": DOWN, "crush_dry": 5e5, "crush_inner": 5e5}),
    "no friction": (["aaa", "aaa", "###"], {"friction": 0.0}),
    "slits": (["aaa", "aa.", "###"], {"segmentation": False}),
    "mortar and rough cracks": (
        ["aaa", "aaa", "###"],
        {"cohesion": 1e3, "inner_friction": 0.8, "tension": 2e3, "shear": 3e3, "friction": 0.5},
    ),
    "overhang": (["aaaa", "aa..", "#..."], {"live": [{"body": [0, -1]}]}),
}


def table(rows: list[str], options: dict[str, Any], folder: Path, **settings: Any) -> pd.DataFrame:
    settings = {"certificates": True, **settings}
    scene = parse_scene(grid_document(rows, **options))
    done = explore(scene, folder, ExploreSettings(pictures=False, driver="enumeration", **settings))
    return done.results.drop(columns=["seconds"])


@pytest.mark.parametrize("name", SCENES)
def test_settled_is_solved(name: str, tmp_path: Path) -> None:
    rows, options = SCENES[name]
    with_pool = table(rows, options, tmp_path / "pool").set_index("labelling").sort_index()
    without = table(rows, options, tmp_path / "plain", certificates=False).set_index("labelling").sort_index()
    assert list(with_pool.index) == list(without.index)
    assert (with_pool["status"] == without["status"]).all()
    one, other = with_pool["load_factor"].to_numpy(float), without["load_factor"].to_numpy(float)
    known = np.isfinite(other)
    assert np.array_equal(np.isfinite(one), known)
    size = np.maximum(abs(other[known]), 1e-3)
    assert np.all(abs(one[known] - other[known]) <= 1e-6 * size)
    both = known & (with_pool["status"] == "collapse").to_numpy()
    rounding = 1e-9 * np.maximum(abs(one[both]), 1e-3)
    assert np.all(with_pool["bracket_lo"][both] <= without["bracket_hi"][both] + rounding)
    assert np.all(with_pool["bracket_hi"][both] >= without["bracket_lo"][both] - rounding)


def test_most_are_settled(tmp_path: Path) -> None:
    found = table(["aaaa", "aaaa", "####"], {"tension": 2e5, "shear": 2e5}, tmp_path / "a")
    assert (found["settled"] == "certificate").mean() > 0.5


@pytest.mark.parametrize(("jobs", "share"), [(1, 0.5), (2, 0.5), (1, 0.05)])
def test_interrupted_and_resumed(jobs: int, share: float, tmp_path: Path) -> None:
    rows, options = SCENES["weak wall"]
    whole = table(rows, options, tmp_path / "whole")
    scene = parse_scene(grid_document(rows, **options))
    folder = tmp_path / "part"
    explore(scene, folder, ExploreSettings(pictures=False, driver="enumeration", jobs=jobs, certificates=True))
    # as if it had been killed: the last records are not there, and their proofs neither
    file = sqlite3.connect(folder / RECORDS_FILE)
    with file:
        last = int(share * file.execute("SELECT max(id) FROM evaluations").fetchone()[0])
        file.execute("DELETE FROM evaluations WHERE id > ?", (last,))
        file.execute("DELETE FROM proofs WHERE evaluation > ?", (last,))
    file.close()
    settings = ExploreSettings(pictures=False, driver="enumeration", jobs=jobs, resume=True, certificates=True)
    again = explore(scene, folder, settings)
    pd.testing.assert_frame_equal(again.results.drop(columns=["seconds"]), whole)


@pytest.mark.parametrize("rows", [["aaaa", "aaaa", "####"], ["#aaaa#"]])
def test_every_bound_holds(rows: list[str]) -> None:
    scene = parse_scene(grid_document(rows, tension=5e3, shear=5e3, live=DOWN))
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    labellings = np.concatenate([part for part, _ in Enumeration(space).batches()])
    analysis = LimitAnalysis(assembly)
    proven = [analysis.prove(labels) for labels in labellings]
    pool = Pool(len(assembly.interfaces), space.group)
    for labels, proof in list(zip(labellings, proven, strict=True))[::5]:
        pool.add(proofs_of(analysis.template, proof, labels))
    bounds = pool.ask(labellings)
    for n, proof in enumerate(proven):
        if proof.status is Status.UNSTABLE:
            assert bounds.low[n] < 1e-9
        else:
            assert not bounds.unstable[n]
            assert bounds.low[n] <= proof.high + 1e-9
            assert bounds.high[n] >= proof.low - 1e-9
        if n % 5 == 0 and proof.status is Status.COLLAPSE:
            assert bounds.low[n] >= proof.low - 1e-12
            assert bounds.high[n] <= proof.high + 1e-9


def test_bounds_that_contradict_each_other_settle_nothing(tmp_path: Path) -> None:
    assembly = build_assembly(parse_scene(grid_document(["aa", "##"])))
    template = LimitAnalysis(assembly).template
    faces = len(assembly.interfaces)
    identity = np.arange(faces)[None]
    consultant = CertificateEvaluator(None, Pool(faces, identity), template, 1e-6)
    low, high = np.array([0.5, 0.5, 0.5 + 1e-13]), np.array([0.5, 0.4, 0.5])
    assert consultant._settled(Bounds(low, high, np.zeros(3, dtype=bool))).tolist() == [True, False, True]


def test_pool_answers_as_plain_python_does() -> None:
    rng = np.random.default_rng(3)
    m = 70  # more than one word of bits
    pool = Pool(m, np.arange(m)[None])
    forces = [Forces(float(n), rng.random(m) < 0.97, rng.random(m) < 0.97) for n in range(40)]
    moves = []
    for n in range(40):
        dry, inner = rng.random(m), rng.random(m)
        dry[rng.random(m) < 0.03] = np.inf
        inner[rng.random(m) < 0.03] = np.inf
        moves.append(Mechanism(-float(n), dry, inner, n % 7 == 0))
    pool.add(Proofs(tuple(forces), tuple(moves)))
    labellings = rng.random((50, m)) < 0.5
    found = pool.ask(labellings)
    for n, labels in enumerate(labellings):
        fits = [f.load for f in forces if np.where(labels, f.dry, f.inner).all()]
        costs = [(move.constant + np.where(labels, move.dry, move.inner).sum(), move.falls) for move in moves]
        high = min([c for c, falls in costs if not falls], default=np.inf)
        assert found.low[n] == max(fits, default=-np.inf)
        assert np.isclose(found.high[n], high) or found.high[n] == high
        assert found.unstable[n] == (high < 0.0 or any(c < 0.0 for c, falls in costs if falls))


def test_pool_keeps_what_settles() -> None:
    m = 8
    pool = Pool(m, np.arange(m)[None], forces=10)
    every = np.ones(m, dtype=bool)
    pool.add(Proofs((Forces(100.0, every, every),)))
    for n in range(50):
        pool.ask(np.zeros((3, m), dtype=bool))
        pool.add(Proofs((Forces(float(n), every, ~every),)))
    assert len(pool) <= 10
    assert pool.ask(np.zeros((1, m), dtype=bool)).low[0] == 100.0
