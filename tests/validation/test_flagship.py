"""The flagship scene and 3×3 cells on a support row, against the static problem stated independently.

12 694 labellings in 6 382 classes and 1 434 segmentations are known from counts by brute force; λ comes from CVXPY
and geometry alone (reference_planar), tolerance 1e-6, status included.
"""

from __future__ import annotations

import numpy as np
import pytest

from cases import as_elements, grid_scene
from command import SCENES
from jld_core import (
    Assembly,
    LimitAnalysis,
    LimitAnalysisResult,
    Scene,
    Status,
    build_assembly,
    load_scene,
    parse_scene,
    solve,
)
from jld_core.solvers import SOLVERS
from jld_explore import search_space
from jld_explore.drivers.enumeration import Enumeration
from proofs import reference_load_factor


def classes(scene: Scene) -> tuple[Assembly, np.ndarray, np.ndarray]:
    """The assembly, one labelling of every class, and how many labellings each stands for."""
    assembly = build_assembly(scene)
    batches = list(Enumeration(search_space(scene, assembly)).batches())
    labellings, multiplicity = (np.concatenate(part) for part in zip(*batches, strict=True))
    return assembly, labellings, multiplicity


@pytest.fixture(scope="module")
def flagship() -> tuple[Assembly, np.ndarray, np.ndarray]:
    return classes(load_scene(SCENES / "flat_beam_arch.json"))


def signed(status: Status, load_factor: float) -> float:
    """λ, or the infinity that stands for the status, as the reference gives it."""
    assert status in (Status.COLLAPSE, Status.LOCKED, Status.UNSTABLE)
    return {Status.LOCKED: np.inf, Status.UNSTABLE: -np.inf}.get(status, load_factor)


def compare(assembly: Assembly, labellings: np.ndarray, solver: str | None = None) -> dict[Status, int]:
    """Every labelling by the default route and by another (None: the independent statement), equal to 1e-6.

    Returns how often each status occurred.
    """
    analysis = LimitAnalysis(assembly)
    other = None if solver is None else LimitAnalysis(assembly, solver=solver)
    floor = 1e-3 * assembly.total_dead / assembly.total_live
    tally: dict[Status, int] = {}
    for labels in labellings:
        found = analysis.solve(labels, stands=False)
        ours = signed(found.status, found.load_factor)
        if other is None:
            theirs = reference_load_factor(assembly, labels)
        else:
            second = other.solve(labels, stands=False)
            theirs = signed(second.status, second.load_factor)
        if np.isfinite(ours) and np.isfinite(theirs):
            assert abs(ours - theirs) <= 1e-6 * max(abs(ours), abs(theirs), floor)
            low, high = found.bracket
            assert low <= found.load_factor <= high
            assert found.gap <= 1e-6
        else:
            assert ours == theirs
        tally[found.status] = tally.get(found.status, 0) + 1
    return tally


def test_flagship_counts(flagship: tuple[Assembly, np.ndarray, np.ndarray]) -> None:
    assembly, labellings, multiplicity = flagship
    assert len(assembly.elements.free) == 15
    assert len(assembly.interfaces) == 24
    assert len(labellings) == len(np.unique(labellings, axis=0)) == 6382
    assert multiplicity.sum() == 12694


def test_flagship_weight_and_load(flagship: tuple[Assembly, np.ndarray, np.ndarray]) -> None:
    """15 cells of 0.1³ m³ at 1400 kg/m³; 1000 N on the middle of the top, about its centroid no moment."""
    assembly = flagship[0]
    assert assembly.total_dead == pytest.approx(15 * 1400 * 9.81 * 1e-3, rel=1e-12)
    assert assembly.total_live == pytest.approx(1000.0, rel=1e-12)
    np.testing.assert_allclose(assembly.live.sum(axis=0), [0.0, -1000.0, 0.0], atol=1e-9)


@pytest.mark.filterwarnings("ignore")  # CVXPY says where its own solver was inexact; the comparison is ours
def test_flagship_sample(flagship: tuple[Assembly, np.ndarray, np.ndarray]) -> None:
    """40 classes, seeded; all of them were compared with HiGHS once (docs/notes/tried.md)."""
    assembly, labellings, _ = flagship
    sample = np.random.default_rng(20240501).choice(len(labellings), 40, replace=False)
    tally = compare(assembly, labellings[sample])
    # a quarter of the classes fall under their own weight: both kinds are in the sample
    assert tally[Status.COLLAPSE] > 20
    assert tally[Status.UNSTABLE] > 4


@pytest.mark.parametrize(("step", "number"), [(4, 359), pytest.param(1, 1434, marks=pytest.mark.long)])
def test_all_segmentations_of_three_by_three_cells(step: int, number: int) -> None:
    """All 1 434, or every fourth, weak strengths, horizontal body load, blocks glued to nothing below: default route
    against HiGHS."""
    assembly, labellings, multiplicity = classes(
        grid_scene(["aaa", "aaa", "aaa", "###"], tension=2e3, shear=1.5e3, symmetry="none")
    )
    assert len(labellings) == multiplicity.sum() == 1434
    tally = compare(assembly, labellings[::step], solver="highs")
    assert tally == {Status.COLLAPSE: number}


@pytest.mark.filterwarnings("ignore")  # as above
def test_segmentations_of_three_by_three_cells_by_the_independent_statement() -> None:
    """Every sixteenth of them once more, by the statement that shares no code with either route."""
    assembly, labellings, _ = classes(
        grid_scene(["aaa", "aaa", "aaa", "###"], tension=2e3, shear=1.5e3, symmetry="none")
    )
    assert compare(assembly, labellings[::16]) == {Status.COLLAPSE: 90}


# Dry walls of Ferris & Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209–224, friction 0.65, horizontal body load.
#
# λ as in the scenes' own `expected` (published to 3–5 digits, recomputed by two independent linear programs);
# tolerance 1e-6. The walls are symmetric about a vertical line, so both directions give the same value. Blocks and
# contacts are counted as in MPECLib: its complementarity problem of n blocks and m contacts has 3n + 7m + 2 equations.


WALLS = tuple(f"ferris_tinloi_{n}" for n in range(1, 7))
EQUATIONS = (682, 1154, 854, 979, 1025, 2855)
"""Of frictionalblock_1 … 6 in MPECLib."""


def wall(name: str, direction: float = 1.0) -> tuple[Scene, Assembly]:
    document = as_elements(load_scene(SCENES / f"{name}.json"))
    document["loads"]["live"] = [{"body": [direction, 0.0]}]
    scene = parse_scene(document)
    return scene, build_assembly(scene)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("name", WALLS)
def test_wall(name: str, direction: float) -> None:
    scene, assembly = wall(name, direction)
    assert len(assembly.interfaces) == scene.expected["interfaces"]
    assert len(assembly.elements) == scene.expected["elements"]
    result = solve(assembly)
    published = scene.expected["load_factor_associative"]
    assert result.status is Status.COLLAPSE
    assert result.load_factor == pytest.approx(published, rel=1e-6)
    low, high = result.bracket
    assert low <= result.load_factor <= high
    assert (high - low) / published < 1e-7
    assert result.stands_at_zero is True


@pytest.mark.parametrize(("name", "equations"), list(zip(WALLS, EQUATIONS, strict=True)))
def test_blocks_and_contacts_are_those_of_mpeclib(name: str, equations: int) -> None:
    _, assembly = wall(name)
    blocks = int((~assembly.elements.support).sum())
    assert 3 * blocks + 7 * len(assembly.interfaces) + 2 == equations


@pytest.mark.parametrize("route", SOLVERS)
def test_every_route_gives_the_same_wall(route: str) -> None:
    scene, assembly = wall("ferris_tinloi_4")
    result: LimitAnalysisResult = solve(assembly, solver=route)
    assert result.load_factor == pytest.approx(scene.expected["load_factor_associative"], rel=1e-7)
    assert result.gap < 1e-7
