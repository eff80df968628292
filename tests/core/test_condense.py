"""Rigid blocks, cracked on demand, give the full model's λ and brackets (docs/method.md (7.2))."""

from __future__ import annotations

import numpy as np
import pytest

from cases import assembly_in_space as spatial_assembly
from cases import grid_assembly
from cases import wall_in_space as spatial_wall
from jld_core import Assembly, LimitAnalysis, LimitAnalysisResult, Status, solve
from jld_core.limit import result_of
from jld_core.models.rigid_blocks import prove_condensed, rigid_blocks, worth_condensing


def condensed(analysis: LimitAnalysis, labels: np.ndarray) -> LimitAnalysisResult | None:
    """The result by rigid blocks alone."""
    proof = prove_condensed(analysis, labels)
    return None if proof is None else result_of(analysis.template, labels, analysis.options, proof, elapsed=0.0)


def random_segmentation(assembly: Assembly, blocks: int, rng: np.random.Generator) -> np.ndarray:
    """Blocks grown from random cells at random faces; faces to supports dry."""
    faces, free = assembly.interfaces, ~assembly.elements.support
    owner = np.full(len(assembly.elements), -1)
    owner[rng.choice(np.flatnonzero(free), blocks, replace=False)] = np.arange(blocks)
    while np.any(owner[free] < 0):
        face = rng.integers(len(faces))
        a, b = faces.a[face], faces.b[face]
        if free[a] and free[b] and (owner[a] < 0) != (owner[b] < 0):
            owner[a] = owner[b] = max(owner[a], owner[b])
    return (owner[faces.a] != owner[faces.b]) | ~free[faces.a] | ~free[faces.b]


STRENGTHS = (2e6, 2e5, 2e4, 4e3)


@pytest.mark.parametrize("strength", STRENGTHS)
def test_condensed_equals_full_on_random_segmentations(strength: float) -> None:
    """20 segmentations at each of four strengths, λ to 1e-7 and brackets as narrow as asked."""
    assembly = grid_assembly(["aaaa", "aaaa", "aaaa", "####"], tension=strength, shear=strength)
    analysis = LimitAnalysis(assembly)
    rng = np.random.default_rng(int(strength))
    exact = 0
    for _ in range(20):
        labels = random_segmentation(assembly, int(rng.integers(2, 7)), rng)
        full = analysis.solve(labels, stands=False)
        rigid = condensed(analysis, labels)
        if rigid is None:
            continue
        exact += 1
        assert rigid.status is full.status
        if full.status is Status.COLLAPSE:
            assert rigid.load_factor == pytest.approx(full.load_factor, rel=1e-7)
            assert rigid.gap < analysis.gap
    assert exact > 14


def test_condensed_equals_full_in_space() -> None:
    assembly = spatial_assembly(
        spatial_wall(2, 3), materials={"inner": {"tensile_strength": 1.0, "shear_strength": 1.0}}
    )
    analysis = LimitAnalysis(assembly)
    rng = np.random.default_rng(2)
    proven = 0
    for _ in range(10):
        labels = random_segmentation(assembly, 5, rng)
        full, rigid = analysis.solve(labels), condensed(analysis, labels)
        if rigid is not None and full.status is Status.COLLAPSE:
            proven += 1
            assert rigid.load_factor == pytest.approx(full.load_factor, rel=1e-6)
            assert rigid.mechanism.shape == (len(assembly.elements), 6)
    assert proven > 5


@pytest.mark.parametrize("strength", [1e9, 1e12, 1e15])
def test_very_large_strengths_keep_brackets_narrow(strength: float) -> None:
    """A block that cannot crack is rigid: λ does not depend on by how much, and brackets stay narrow."""
    assembly = grid_assembly(["aaaa", "aaaa", "aaaa", "####"], tension=strength, shear=strength)
    labels = random_segmentation(assembly, 5, np.random.default_rng(8))
    result = solve(assembly, labels)
    assert worth_condensing(LimitAnalysis(assembly).template, labels)
    assert "rigid_blocks" in result.facts
    assert result.gap < 1e-8
    moderate = grid_assembly(["aaaa", "aaaa", "aaaa", "####"], tension=2e6, shear=2e6)
    assert result.load_factor == pytest.approx(solve(moderate, labels, condense="off").load_factor, rel=1e-8)


def test_mechanism_of_blocks_is_rigid_and_does_unit_work() -> None:
    from jld_core.mechanics import equilibrium_matrix, load_vectors

    assembly = grid_assembly(["aaaa", "aaaa", "aaaa", "####"], tension=1e9, shear=1e9)
    labels = random_segmentation(assembly, 5, np.random.default_rng(8))
    result = solve(assembly, labels, condense="on")
    u = result.mechanism[assembly.elements.free].ravel()
    jumps = (equilibrium_matrix(assembly).T @ u).reshape(-1, 3)
    assert abs(jumps[~labels]).max() < 1e-12 * abs(u).max()
    assert load_vectors(assembly)[1] @ u == pytest.approx(1.0, rel=1e-9)


def test_loads_of_a_block_are_those_of_its_elements() -> None:
    assembly = grid_assembly(["aaa", "aaa", "###"], live=[{"element": "c2r0", "force": [3, -1], "at": [0.7, 0.9]}])
    rigid = rigid_blocks(assembly, assembly.labels, np.zeros(0, dtype=np.int64))
    assert len(rigid.assembly.elements.free) == 1
    block = rigid.assembly.elements.free[0]
    centre = rigid.assembly.elements.centroid[block]
    arm = np.array([0.7, 0.9]) - centre
    assert rigid.assembly.live[block] == pytest.approx([3.0, -1.0, arm[0] * -1.0 - arm[1] * 3.0])
    assert rigid.assembly.dead[block] == pytest.approx([0.0, assembly.dead[:, 1].sum(), 0.0], abs=1e-12)
