"""Vertices of the force method against the limit analysis, which knows nothing of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import CASES, grid_assembly
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysis, Status
from jld_explore.evaluation.certificates import Pool
from jld_explore.evaluation.force_method import ForceMethod, Vertex

SIDEWAYS = [{"element": "c0r0", "force": [1, 0]}]
LINEAR = [name for name, (_, options) in CASES.items() if "crush_dry" not in options]
DROPPING = ("no friction", "no shear strength")


def labellings(assembly: Assembly, count: int = 40) -> Bits:
    """Random labellings, and the two pure ones."""
    m = len(assembly.interfaces)
    rows = np.random.default_rng(5).random((count, m)) < np.linspace(0.1, 0.9, count)[:, None]
    return np.concatenate([rows, np.ones((1, m), dtype=bool), np.zeros((1, m), dtype=bool)])


def force_method(analysis: LimitAnalysis) -> ForceMethod:
    return ForceMethod(analysis.template, analysis.prover, analysis.repair)


@pytest.mark.parametrize("name", LINEAR)
def test_is_the_limit_analysis(name: str) -> None:
    rows, options = CASES[name]
    assembly = grid_assembly(rows, **options)
    analysis = LimitAnalysis(assembly)
    method = force_method(analysis)
    assert method.usable == (name not in DROPPING)
    if not method.usable:
        return
    proven = 0
    for labels in labellings(assembly):
        vertex = method.solve(labels)
        if vertex is None:
            continue
        proof = analysis.prove(labels)
        low, high, size = proof.low, proof.high, max(1.0, abs(proof.low)) if np.isfinite(proof.low) else 1.0
        assert (vertex.state is None) == (proof.status is Status.UNSTABLE)
        assert vertex.motion.bound >= low - 1e-9 * size
        if vertex.state is not None and vertex.state.admissible:
            assert vertex.state.load <= high + 1e-9 * size
            if proof.status is Status.COLLAPSE and vertex.motion.bound - vertex.state.load <= 1e-9 * size:
                assert abs(vertex.state.load - 0.5 * (low + high)) <= 1e-9 * size + 0.5 * (high - low)
                proven += 1
    if name in ("wall", "beam", "arch", "lifted", "cantilever"):
        assert proven > 10


@pytest.mark.parametrize(
    "options",
    [{"tension": 2e3, "shear": 2e3}, {"tension": 3e5, "shear": 3e5}, {"live": SIDEWAYS}],
)
def test_every_bound_holds(options: dict[str, Any]) -> None:
    assembly = grid_assembly(["aaaaa", "a.aaa", "#####"], **options)
    analysis = LimitAnalysis(assembly)
    method = force_method(analysis)
    rows = labellings(assembly, 120)
    pool = Pool(rows.shape[1], np.arange(rows.shape[1])[None])
    for labels in rows[::3]:
        vertex = method.solve(labels, rows)
        if vertex is not None:
            pool.add(vertex.proofs)
    bounds = pool.ask(rows)
    assert np.isfinite(bounds.high).all()
    for labels, low, high, unstable in zip(rows, bounds.low, bounds.high, bounds.unstable, strict=True):
        proof = analysis.prove(labels)
        assert not unstable or proof.status is Status.UNSTABLE
        if proof.status is Status.COLLAPSE:
            size = 1e-9 * max(1.0, abs(proof.high))
            assert low <= proof.high + size
            assert high >= proof.low - size


def test_answers_do_not_depend_on_what_was_asked_before() -> None:
    assembly = grid_assembly(["aaaa", "aaaa", "####"], tension=2e3, shear=2e3)
    analysis = LimitAnalysis(assembly)
    rows = labellings(assembly, 60)

    def numbers(vertex: Vertex | None) -> object:
        if vertex is None:
            return None
        forces = None if vertex.state is None else (vertex.state.load, vertex.state.forces.tobytes())
        return forces, vertex.motion.bound, vertex.motion.velocity.tobytes()

    method = force_method(analysis)
    forwards = [numbers(method.solve(labels, rows)) for labels in rows]
    backwards = [numbers(method.solve(labels, rows)) for labels in rows[::-1]][::-1]
    alone = [numbers(force_method(analysis).solve(labels, rows)) for labels in rows]
    assert forwards == backwards == alone


def test_forces_carry_more_of_their_company() -> None:
    assembly = grid_assembly(["aaaaa", "aaaaa", "#####"])
    method = force_method(LimitAnalysis(assembly))
    rows = np.random.default_rng(2).random((400, len(assembly.interfaces))) < 0.6

    def carried(company: Bits | None) -> int:
        total = 0
        for labels in rows[:10]:
            vertex = method.solve(labels, company)
            assert vertex is not None
            for forces in vertex.proofs.forces:
                total += int(np.where(rows, forces.dry, forces.inner).all(axis=1).sum())
        return total

    assert carried(rows) >= carried(None)
