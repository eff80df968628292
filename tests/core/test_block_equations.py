"""The equations of blocks, (8.6): T by hand, the same program in other equations, and walls that need them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner, grid_assembly
from cases_spatial import assembly, rotation, wall
from jld_core import Assembly, LimitAnalysis, Status, blocks_of, build_assembly, parse_scene
from jld_core.geometry import spun
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver
from jld_core.solvers.base import EARLY
from jld_core.solvers.schur.compiled_fronts import BlockEquations
from jld_core.solvers.schur.system import SchurSolver


def cubes(edge: int) -> Assembly:
    """A cube of cubes on a slab, as in benchmarks/growth.py."""

    def box(low: Any, high: Any) -> dict[str, Any]:
        corners = [[0.1 * float(v) for v in corner] for corner in itertools.product(*zip(low, high, strict=True))]
        faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        return {"id": "-".join(map(str, low)), "vertices": corners, "faces": faces}

    cells = [box(at, np.add(at, 1)) for at in itertools.product(range(edge), repeat=3)]
    document: dict[str, Any] = {
        "elements": [box((0, 0, -1), (edge, edge, 0)) | {"support": True}, *cells],
        "materials": dry_and_inner(1400, 0.75, 2e6, 2e6),
        "loads": {"live": [{"body": [1, 0, 0]}]},
    }
    return build_assembly(parse_scene(document))


def small_blocks(built: Assembly, seed: int, most: int = 4) -> np.ndarray:
    """Labels of random blocks of at most so many elements, none of them glued to a support."""
    rng = np.random.default_rng(seed)
    faces, labels = built.interfaces, np.ones(len(built.interfaces), dtype=bool)
    size = np.ones(len(built.elements), dtype=int)
    name = np.arange(len(built.elements))
    for face in rng.permutation(np.flatnonzero(built.free_faces)):
        one, two = name[faces.a[face]], name[faces.b[face]]
        if one != two and size[one] + size[two] <= most:
            size[one] += size[two]
            name[name == two] = one
    labels[built.free_faces] = (name[faces.a] != name[faces.b])[built.free_faces]
    return labels


BUILT = {
    "planar": lambda: grid_assembly(["aaaa", "aaaa", "####"]),
    "spatial": lambda: assembly(wall(3, 2)),
    "turned": lambda: assembly(wall(3, 2, turn=rotation(0.3, 0.5, 0.2))),
}


@pytest.mark.parametrize("name", BUILT)
def test_the_sums_are_those_of_virtual_work(name: str) -> None:
    """Tᵀ times a velocity of roots alone is the rigid motion of their blocks: power of forces is that of resultants."""
    built = BUILT[name]()
    template, labels = Template(built), small_blocks(built, 1)
    bodies = template.program(labels).bodies
    assert bodies is not None
    sums = bodies.sums(template.structure.equalities)
    assert sums is not None
    d, q = built.dimension, built.freedoms
    root = bodies.root
    roots = np.unique(root)
    free = built.elements.free
    assert np.array_equal(blocks_of(built, labels)[free[root]], blocks_of(built, labels)[free])
    own = np.random.default_rng(2).standard_normal((len(roots), q))
    given = np.zeros((len(free), q))
    given[roots] = own
    scale = template.scaling.row.reshape(-1, q)
    found = (sums.T @ (given * scale).ravel()).reshape(-1, q) / scale
    rigid = given[root]
    rigid[:, :d] += spun(rigid[:, d:], built.elements.centroid[free] - built.elements.centroid[free[root]])
    # elements that are no roots have an equation of their own besides, whose multiplier is zero here
    assert found == pytest.approx(rigid, abs=1e-12)


@pytest.mark.parametrize("name", BUILT)
def test_the_changed_program_is_the_same_program(name: str) -> None:
    """Clarabel finds the same λ by either equations, its multipliers satisfy the original dual, inner faces vanish."""
    built = BUILT[name]()
    template, labels = Template(built), small_blocks(built, 3)
    program = template.program(labels)
    assert program.bodies is not None
    edge = template.structure.equalities
    sums = program.bodies.sums(edge)
    assert sums is not None
    equations = BlockEquations(program, sums)
    changed = equations.changed(program)
    plain, other = ClarabelSolver().solve(program), ClarabelSolver().solve(changed)
    assert other.point[-1] == pytest.approx(plain.point[-1], rel=1e-7)
    dual = equations.multipliers(other.dual)
    assert abs(program.objective + program.matrix.T @ dual).max() < 1e-7
    dense = (sums @ program.matrix[:edge]).toarray()
    assert changed.matrix[:edge].toarray() == pytest.approx(dense, abs=1e-12)
    block, q = blocks_of(built, labels), built.freedoms
    within = np.flatnonzero(block[built.interfaces.a] == block[built.interfaces.b])
    rows = (q * np.unique(program.bodies.root)[:, None] + np.arange(q)).ravel()
    held = np.flatnonzero(np.isin(block, block[built.elements.support]))
    free_of_support = within[~np.isin(built.interfaces.a[within], held)]
    columns = (q * free_of_support[:, None] + np.arange(q)).ravel()
    assert len(columns)
    assert changed.matrix.tocsr()[rows][:, columns].count_nonzero() == 0


def test_blocks_of_a_support_and_single_elements_stay() -> None:
    built = grid_assembly(["aaaa", "aaaa", "####"])
    template = Template(built)
    for value in (True, False):
        bodies = template.program(np.full(len(built.interfaces), value)).bodies
        assert bodies is not None
        assert bodies.sums(template.structure.equalities) is None


def test_cubes_in_small_blocks_converge() -> None:
    """125 cubes prove themselves; without (8.6) forces are not admissible and the mechanism closes a joint."""
    built = cubes(5)
    labels = small_blocks(built, 1)
    analysis = LimitAnalysis(built, solver="schur")
    program = analysis.template.program(labels, analysis.margin)
    raw = SchurSolver(analysis.template.precision.residual).solve(program)
    state, motion = analysis.prover.state(raw.point, labels), analysis.prover.motion(raw.dual, labels)
    assert state.admissible
    assert motion.margin >= 0.0
    assert motion.bound - state.load < 2e-7 * motion.bound
    plain = SchurSolver(analysis.template.precision.residual).solve(replace(program, bodies=None))
    assert not analysis.prover.state(plain.point, labels).admissible
    assert analysis.prover.motion(plain.dual, labels).margin < 0.0


def test_a_run_ends_where_its_bounds_suffice() -> None:
    """The caller sees points and multipliers of the original equations, and the run ends at the first that it takes."""
    built = cubes(3)
    labels = small_blocks(built, 1)
    analysis = LimitAnalysis(built, solver="schur")
    program = analysis.template.program(labels, analysis.margin)
    seen = []

    def suffices(point: np.ndarray, dual: np.ndarray) -> bool:
        state, motion = analysis.prover.state(point, labels), analysis.prover.motion(dual, labels)
        seen.append((motion.bound - state.load) / motion.bound if state.admissible else np.inf)
        return len(seen) == 2

    solver = SchurSolver(analysis.template.precision.residual)
    early, whole = solver.solve_until(program, suffices), solver.solve(program)
    assert len(seen) == 2
    assert early.status == "optimal"
    assert early.note == "bounds narrow enough"
    assert early.iterations < whole.iterations
    assert seen[1] < 10.0 * EARLY
    assert early.point[-1] == pytest.approx(whole.point[-1], rel=1e-5)


def test_crossed_solvers_agree_on_all_statuses() -> None:
    """Clarabel, which does not change equations, and Schur: unstable, locked and collapsing layouts of small blocks."""
    seen = set()
    for built in (
        grid_assembly(["aaaa", "aaaa", "####"]),
        grid_assembly([".aaaa", ".aaaa", ".####"], tension=2e1, shear=2e1),
        grid_assembly(["aaaaa", "aaaaa", "##..."], tension=1e2, shear=1e2),
    ):
        for seed in range(3):
            labels = small_blocks(built, seed)
            one, two = (LimitAnalysis(built, solver=name).solve(labels, stands=False) for name in ("clarabel", "schur"))
            assert one.status is two.status
            seen.add(one.status)
            if one.status is Status.COLLAPSE:
                assert two.load_factor == pytest.approx(one.load_factor, rel=1e-6, abs=1e-9)
    assert Status.COLLAPSE in seen
    assert Status.UNSTABLE in seen
