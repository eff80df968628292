"""The batch solver: bounds that the core's own prover admits, the same in whatever lane and company; honest
refusals."""

from __future__ import annotations

import itertools
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import cases
from cases import CASES, SPATIAL, grid_assembly
from command import Command
from jld_core import Assembly, InputError, LimitAnalysis
from jld_core.batch import batch_solver, build, library
from jld_core.limit import case_relaxation
from proofs import LAST_DIGITS, assert_proven, exact_margin, lanes_of

PLANAR = list(CASES)
EXTRA = {"crushable inner": (["aaaa", "aaaa", "####"], {"crush_inner": 3e4, "tension": 1e4})}


@pytest.fixture(scope="session")
def kernels() -> dict[str, str]:
    """The built libraries of this processor, the fastest first; where none is, one compiled as first use would.

    `make setup` builds the fastest and the base, `make bench` all."""
    there = library.built()
    named = os.environ.get("JLD_KERNEL", "")
    if os.sep in named:  # `make sanitize`
        return {"given": named}
    found = {name: str(there[name]) for name in filter(build.runs_here, build.variants()) if name in there}
    if not found and build.compilers():
        found[build.best()] = str(build.compile_variant(build.best(), build.cache(), build.compilers()[0]))
    if not found:
        pytest.skip("no compiler, and no kernel")
    return found


@pytest.fixture(scope="session")
def kernel(kernels: dict[str, str]) -> str:
    return next(iter(kernels.values()))


def test_a_library_of_other_sources_is_not_taken(kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after an update of a clone in which the extension was built before."""
    assert build.is_current(Path(kernel))
    monkeypatch.setattr(build, "digest", lambda: "made of something else")
    assert not build.is_current(Path(kernel))
    assert library.built() == {}


def analysis_of(name: str) -> LimitAnalysis:
    if name in SPATIAL:
        return LimitAnalysis(SPATIAL[name](), inner_bending="kern" if "kern" in name else "uncoupled")
    rows, options = (CASES | EXTRA)[name]
    return LimitAnalysis(grid_assembly(rows, **options))


def labellings(assembly: Assembly, count: int, seed: int = 0) -> np.ndarray:
    dice = np.random.default_rng(seed)
    return dice.random((count, len(assembly.interfaces))) < dice.random((count, 1))


@pytest.mark.parametrize(("cells", "friction", "expected"), [(1, 0.75, 0.75), (2, 0.75, 0.5), (3, 0.2, 0.2)])
def test_a_tower_slides_or_rocks(kernel: str, cells: int, friction: float, expected: float) -> None:
    """Pushed sideways by λ times its weight a tower b wide and h high falls at λ = min(μ, b / h)."""
    assembly = grid_assembly([*["a"] * cells, "#"], friction=friction, tension=2e6, shear=2e6)
    labels = np.zeros((1, len(assembly.interfaces)), dtype=bool)
    labels[0, ~assembly.free_faces] = True
    analysis = LimitAnalysis(assembly)
    found = lanes_of(analysis, kernel).solve(labels)
    scale = analysis.template.scaling.load
    assert found.verdict[0] == batch_solver.PROVEN
    assert found.low[0] * scale <= expected + 1e-12
    assert found.high[0] * scale == pytest.approx(expected, rel=2e-8)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", [*PLANAR, *EXTRA, *SPATIAL])
def test_bounds_are_those_of_the_core(kernel: str, name: str) -> None:
    analysis = analysis_of(name)
    asked = labellings(analysis.assembly, 24)
    found = lanes_of(analysis, kernel).solve(asked, vectors=True)
    # strengths of 1e9 turn the last digit of a jump into 1e-10 of λ
    assert_proven(analysis, asked, found, 1e-9 if "strong" in name else LAST_DIGITS)


@pytest.mark.parametrize("name", ["wall", "no tensile strength"])
def test_mechanisms_open_every_face_without_rounding(kernels: dict[str, str], name: str) -> None:
    """No dissipation of an upper bound is infinite: margins in whole numbers are not negative, in every variant.

    The prover sums the same jumps in another order and finds down to −4e-17 of the velocity.
    """
    analysis = analysis_of(name)
    asked = labellings(analysis.assembly, 40, seed=7)
    for path in kernels.values():
        found = lanes_of(analysis, path).solve(asked, vectors=True)
        for k in np.flatnonzero(np.isfinite(found.high)):
            assert exact_margin(analysis, found.velocity[k], asked[k]) >= 0


SETTLED = {
    "wall": 24,
    "beam": 24,
    "overhang": 24,
    "lifted": 24,
    "very strong": 24,
    "cantilever": 24,
    "crushable inner": 24,
    "no tensile strength": 24,
    "no friction": 24,
    "no shear strength": 24,
    "crushable wall": 24,
    "crushable arch": 24,
    "arch": 24,
    "weak arch": 23,
    "rough arch": 24,
    "pressed": 24,
    "stools": 24,
    "running bond": 23,
    "turned bond": 23,
    "hulls": 24,
    "kern bond": 24,
    "pressed bond": 24,
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("name", "expected"), SETTLED.items())
def test_the_batch_solver_settles_scenes_of_its_kind(kernel: str, name: str, expected: int) -> None:
    analysis = analysis_of(name)
    found = lanes_of(analysis, kernel).solve(labellings(analysis.assembly, 24))
    assert int((found.verdict != batch_solver.OPEN).sum()) >= expected


def answers(kernel: batch_solver.BatchSolver, asked: np.ndarray) -> list[np.ndarray]:
    found = kernel.solve(asked, vectors=True)
    assert found.forces is not None
    assert found.velocity is not None
    return [found.low, found.high, found.verdict, found.iterations, found.forces, found.velocity]


@pytest.mark.parametrize("name", ["wall", "overhang", "no shear strength", "running bond"])
def test_either_start_bounds_the_opposite_load(kernel: str, name: str) -> None:
    """Of λ under the opposite load both starts prove brackets that share a number, and never verdicts that differ."""
    analysis = analysis_of(name)
    made = lanes_of(analysis, kernel)
    asked = labellings(analysis.assembly, 40, seed=5)
    slow, near = (made.reversed(sampled=sampled).solve(asked) for sampled in (False, True))
    both = (slow.verdict != batch_solver.OPEN) & (near.verdict != batch_solver.OPEN)
    assert both.any()
    np.testing.assert_array_equal(slow.verdict[both], near.verdict[both])
    assert (near.low <= slow.high + 1e-9).all()
    assert (slow.low <= near.high + 1e-9).all()


@pytest.mark.parametrize("name", ["wall", "beam", "no shear strength", "weak arch", "running bond", "hulls"])
def test_an_answer_sees_neither_lane_nor_company(kernel: str, name: str) -> None:
    analysis = analysis_of(name)
    made = lanes_of(analysis, kernel)
    asked = labellings(analysis.assembly, 37, seed=3)
    together = answers(made, asked)
    order = np.random.default_rng(1).permutation(len(asked))
    for one, other in zip(together, answers(made, asked[order]), strict=True):
        np.testing.assert_array_equal(one[order], other)
    for k in (0, 7, 36):
        for one, other in zip(together, answers(made, asked[k : k + 1]), strict=True):
            np.testing.assert_array_equal(one[k], other[0])
    # threads share the problem and nothing else
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(lambda part: answers(made, part), (asked[:18], asked[18:])))
    for k, one in enumerate(together):
        np.testing.assert_array_equal(one, np.concatenate([part[k] for part in parts]))


@pytest.mark.parametrize("name", ["wall", "arch", "crushable wall", "running bond"])
def test_a_labelling_that_carries_enough_is_left_early(kernel: str, name: str) -> None:
    """Above a threshold the state at hand is the proof: admissible by the core's own prover, and no lane goes on."""
    analysis = analysis_of(name)
    made = lanes_of(analysis, kernel)
    asked = labellings(analysis.assembly, 16)
    known = made.solve(asked)
    assert (known.verdict == batch_solver.PROVEN).sum() > 3
    asked, whole = asked[known.verdict == batch_solver.PROVEN], known.low[known.verdict == batch_solver.PROVEN]
    thresholds = whole - 0.5 * abs(whole)
    found = made.solve(asked, thresholds=thresholds, vectors=True)
    assert (found.verdict == batch_solver.CARRIES).all()
    assert (found.low > thresholds).all()
    assert (found.low <= whole + 1e-6 * abs(whole)).all()
    assert found.iterations.sum() < known.iterations[known.verdict == batch_solver.PROVEN].sum()
    for labels, forces, low in zip(asked, found.forces, found.low, strict=True):
        state = analysis.prover.state(np.append(forces.ravel(), low), labels, fixed_load=True)
        assert state.admissible
        assert state.load == pytest.approx(low, abs=1e-9)


@pytest.mark.parametrize("name", ["wall", "crushable inner", "running bond"])
def test_a_shrinking_sees_neither_lane_nor_company(kernel: str, name: str) -> None:
    """What begins where an earlier relaxation stood begins at its own."""
    analysis = analysis_of(name)
    hull = analysis.template.yield_set.hull()
    assert hull is not None
    made = lanes_of(analysis, kernel, undecided=hull)
    asked = labellings(analysis.assembly, 21, seed=5)
    thresholds = np.full(len(asked), 1.05 * float(np.median(made.solve(asked).low)))
    free, how = np.ones(asked.shape[1], dtype=bool), batch_solver.MinimizationOptions(tries=3, inner=True)

    def shrunk(rows: np.ndarray) -> list[np.ndarray]:
        found = made.minimize_conflicts(batch_solver.ConflictRequest(rows, free, thresholds[: len(rows)], how=how))
        return [found.fate, found.decided, found.velocity, found.relaxations]

    together = shrunk(asked)
    assert (together[0] == batch_solver.REFUTED).any()
    assert (together[0] == batch_solver.CARRIED).any()
    assert together[3].max() > 2
    order = np.random.default_rng(1).permutation(len(asked))
    for one, other in zip(together, shrunk(asked[order]), strict=True):
        np.testing.assert_array_equal(one[order], other)
    for k in (0, 9, 20):
        for one, other in zip(together, shrunk(asked[k : k + 1]), strict=True):
            np.testing.assert_array_equal(one[k], other[0])


@pytest.mark.parametrize("name", ["wall", "arch", "running bond", "kern bond"])
def test_variants_agree(kernels: dict[str, str], name: str) -> None:
    """To what is asked of a bracket: which products are fused the compiler chooses, so a study keeps its variant."""
    if len(kernels) < 2:
        pytest.skip("one variant alone")
    analysis = analysis_of(name)
    asked = labellings(analysis.assembly, 40)
    found = [answers(lanes_of(analysis, path), asked) for path in kernels.values()]
    for one, other in itertools.combinations(found, 2):
        np.testing.assert_array_equal(one[2], other[2])
        np.testing.assert_allclose(one[0], other[0], rtol=1e-6)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", PLANAR)
def test_settings_for_large_assemblies_give_the_same_bounds(kernel: str, name: str) -> None:
    analysis = analysis_of(name)
    asked = labellings(analysis.assembly, 12, seed=3)
    plain = lanes_of(analysis, kernel, tries=library.TRIES).solve(asked)
    found = lanes_of(analysis, kernel, tries=library.LARGE_TRIES).solve(asked, vectors=True)
    assert_proven(analysis, asked, found, 1e-9 if "strong" in name else LAST_DIGITS)
    both = (plain.verdict == batch_solver.PROVEN) & (found.verdict == batch_solver.PROVEN)
    assert both.sum() >= 0.9 * (plain.verdict == batch_solver.PROVEN).sum()
    np.testing.assert_array_less(plain.low[both], found.high[both] + 1e-9)
    np.testing.assert_array_less(found.low[both], plain.high[both] + 1e-9)


def test_many_cells_need_one_pass(kernel: str) -> None:
    """Of 24 layouts of 22 x 22 cells in blocks of up to four all but one converge in the first pass.

    Passes that begin where it ended need few iterations for the others, and a factor that breaks down ends nothing.
    """
    analysis = LimitAnalysis(grid_assembly(["a" * 22] * 22 + ["#" * 22], tension=2e6, shear=2e6, friction=0.75))
    asked = np.array([cases.small_blocks(analysis.assembly, seed) for seed in range(24)])
    made = lanes_of(analysis, kernel, tries=library.LARGE_TRIES[:5], sampled_start=False)
    found = made.solve(asked, vectors=True)
    once = (found.verdict == batch_solver.PROVEN) & (found.tries == 1)
    assert int((found.verdict == batch_solver.PROVEN).sum()) >= 22
    assert_proven(analysis, asked[~once], made.solve(asked[~once], vectors=True), LAST_DIGITS)


@pytest.mark.parametrize("name", ["wall", "arch", "crushable inner"])
def test_half_the_lanes_give_the_same_bounds(kernel: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As large assemblies are solved; whatever shares a batch."""
    analysis = analysis_of(name)
    made = lanes_of(analysis, kernel)
    asked = labellings(analysis.assembly, 21)
    plain = made.solve(asked)
    monkeypatch.setattr(library, "NARROW", 0)
    found = answers(made, asked)
    np.testing.assert_array_equal(found[2], plain.verdict)
    np.testing.assert_allclose(found[0], plain.low, rtol=1e-6)
    np.testing.assert_allclose(found[1], plain.high, rtol=1e-6)
    for k in (0, 3, 20):
        for one, other in zip(found, answers(made, asked[k : k + 1]), strict=True):
            np.testing.assert_array_equal(one[k], other[0])


@pytest.mark.parametrize("name", ["wall", "running bond"])
@pytest.mark.parametrize("most", [1, 3, 5, 7])
def test_answers_given_too_early_bound_all_the_same(kernel: str, most: int, name: str) -> None:
    analysis = analysis_of(name)
    asked = labellings(analysis.assembly, 16)
    hasty = library.Try.from_buffer_copy(library.TRIES[0])
    hasty.most = most
    found = lanes_of(analysis, kernel, tries=(hasty,)).solve(asked)
    assert (found.verdict == batch_solver.OPEN).any()
    for k, labels in enumerate(asked):
        proof = analysis.prove(labels)
        assert found.low[k] <= proof.high
        assert found.high[k] >= proof.low


def test_rows_of_another_shape_are_left_to_other_solvers(kernel: str) -> None:
    angles = np.arange(17) * 2.0 * np.pi / 17.0
    round_hull = LimitAnalysis(cases.stools([np.column_stack([np.cos(angles), np.sin(angles)])]))
    crushed = LimitAnalysis(
        cases.stools([cases.OBLONG], materials={"dry": {"friction_coefficient": 0.7, "compressive_strength": 50.0}})
    )
    for other in (round_hull, crushed):
        with pytest.raises(ValueError, match="another shape"):
            batch_solver.BatchSolver(other.template, variant=kernel)
    # undecided faces whose inner set carries more N than the dry one
    crushable = LimitAnalysis(grid_assembly(*[CASES["crushable wall"][0]], crush_dry=1e4))
    batch_solver.BatchSolver(crushable.template, variant=kernel)
    with pytest.raises(ValueError, match="another shape"):
        batch_solver.BatchSolver(crushable.template, undecided=crushable.template.yield_set.hull(), variant=kernel)


def test_switch(monkeypatch: pytest.MonkeyPatch, kernel: str) -> None:
    monkeypatch.setenv("JLD_KERNEL", "off")
    assert library.chosen() is None
    assert library.described() == "no kernel"
    with pytest.raises(ValueError, match="no kernel"):
        batch_solver.BatchSolver(LimitAnalysis(grid_assembly(CASES["wall"][0])).template)
    monkeypatch.setenv("JLD_KERNEL", "mmx")
    with pytest.raises(InputError, match="mmx"):
        library.chosen()
    monkeypatch.setenv("JLD_KERNEL", kernel)
    assert library.chosen() == kernel
    assert "labellings at a time" in library.described()


def test_version_names_the_kernel(kernel: str, jld: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    spoken = {}
    for wish in ("off", kernel):
        monkeypatch.setenv("JLD_KERNEL", wish)
        spoken[wish] = jld("--version").out
    assert "no kernel" in spoken["off"]
    assert "labellings at a time" in spoken[kernel]


@pytest.mark.parametrize("name", ["wall", "no tensile strength", "running bond", "hulls"])
def test_relaxations_in_lanes_have_the_bounds_of_the_conic_solver(
    kernel: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Undecided faces in lanes: the bounds of the conic solver, alone and in company."""
    analysis = analysis_of(name)
    asked = labellings(analysis.assembly, 12)
    loose = np.random.default_rng(4).random(asked.shape) < 0.5
    everything = np.full(len(asked), 1e12)
    monkeypatch.setenv("JLD_KERNEL", kernel)
    relaxation = case_relaxation.Relaxation(analysis)
    together = relaxation.refute_all(asked, loose, everything)
    monkeypatch.setenv("JLD_KERNEL", "off")
    plain = case_relaxation.Relaxation(analysis).refute_all(asked, loose, everything)
    for k, (one, other) in enumerate(zip(together, plain, strict=True)):
        assert one.bound == pytest.approx(other.bound, rel=1e-5 if name == "hulls" else 1e-6, abs=1e-9)
        alone = relaxation.refute(asked[k], loose[k], 1e12)
        assert alone.bound == one.bound
        assert relaxation.refute(asked[k], loose[k], 0.9 * other.bound) is None
        refuted = relaxation.refute(asked[k], loose[k], 1.1 * other.bound)
        assert refuted.bound <= 1.1 * other.bound


def joined(pairs: list[tuple[int, int]], sizes: list[int], most: float, small: int = 0) -> list[set[int]]:
    """Parts as sets, joined in the order of pairs; where a least size is given, only what falls short of it."""
    parts = [{k} for k in range(len(sizes))]
    for p, q in pairs:
        one, two = (next(part for part in parts if atom in part) for atom in (p, q))
        cells = [sum(sizes[k] for k in part) for part in (one, two)]
        if one is not two and sum(cells) <= most and (not small or min(cells) < small):
            one |= two
            parts.remove(two)
    return parts


def test_undecided_joints_that_crush_are_bounded_by_rows_that_enclose_their_hull(
    kernel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Undecided joints that may crush: in lanes a little above the hull itself, and never below."""
    analysis = analysis_of("crushable arch")
    asked = labellings(analysis.assembly, 12)
    loose = np.random.default_rng(4).random(asked.shape) < 0.5
    everything = np.full(len(asked), 1e12)
    monkeypatch.setenv("JLD_KERNEL", kernel)
    batched = case_relaxation.Relaxation(analysis)
    assert batched.batched
    together = batched.refute_all(asked, loose, everything)
    monkeypatch.setenv("JLD_KERNEL", "off")
    hull = case_relaxation.Relaxation(analysis).refute_all(asked, loose, everything)
    finite = 0
    for k, (one, other) in enumerate(zip(together, hull, strict=True)):
        if one is None or other is None:
            continue
        finite += 1
        assert other.bound * (1.0 - 1e-6) <= one.bound <= 1.01 * other.bound
        assert batched.bound(asked[k], loose[k]) == pytest.approx(min(one.bound, other.bound), rel=1e-9)
    assert finite > 6
