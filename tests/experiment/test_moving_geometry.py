"""Geometry that moves: the same as at rest where joints are stiff, closed forms of large movements, new contacts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.scenes import leonardo_flat_arch, stacked_cubes
from threadpoolctl import threadpool_limits

from jld_core import InputError, build_assembly, parse_scene
from jld_experiment import Joints, Push, Settings, Specimen, Standing, push, run_experiment, specimen_of
from jld_experiment.experiment import read_push, write_push
from jld_experiment.moving_spatial import angle_seen, triangles_of


@pytest.mark.long
def test_stiff_joints_move_as_at_rest() -> None:
    assembly = build_assembly(leonardo_flat_arch())
    rest = run_experiment(assembly)
    moving = run_experiment(assembly, settings=Settings(moving=True))
    assert moving.collapse_load == pytest.approx(rest.collapse_load, rel=2e-3)


def pushed(document: dict[str, Any], joints: Joints, distance: float) -> tuple[Push, float]:
    """A push up to a movement of the centroid of the only free element, of unit weight, and its elastic reach."""
    assembly = build_assembly(parse_scene(document))
    probe = specimen_of(assembly, assembly.labels, joints, Settings(moving=True))
    scale = 0.3
    settings = Settings(moving=True, length=distance / (scale * probe.system.reach), hasten=4.0)
    specimen = specimen_of(assembly, assembly.labels, joints, settings)
    settled, _ = specimen.settle()
    return push(specimen, settled, scale, 100.0, endless=True), probe.system.reach


def block(wide: float, high: float, *others: dict[str, Any]) -> dict[str, Any]:
    """A block of unit weight on a long base, pushed along x."""
    return {
        "elements": [
            {"id": "block", "polygon": [[0, 0], [wide, 0], [wide, high], [0, high]], "weight": 1.0},
            {"id": "base", "polygon": [[-1, -1], [9, -1], [9, 0], [-1, 0]], "support": True},
            *others,
        ],
        "materials": {"dry": {"friction_coefficient": 0.9 if wide < high else 0.3}},
        "loads": {"live": [{"body": [1, 0]}]},
    }


def solid(document: dict[str, Any], turn: float = 0.0) -> dict[str, Any]:
    """The same of elements one deep in space, turned about the vertical."""
    c, s = float(np.cos(turn)), float(np.sin(turn))

    def places(polygon: list[list[float]]) -> list[list[float]]:
        return [[c * x - s * y, s * x + c * y, z] for y in (0.0, 1.0) for x, z in polygon]

    elements = []
    for element in document["elements"]:
        n = len(element["polygon"])
        sides = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
        faces = [[*range(n)][::-1], [*range(n, 2 * n)], *sides]
        # a polygon about −y, seen from where y grows, runs clockwise
        outward = [face[::-1] for face in faces]
        kept = {key: value for key, value in element.items() if key != "polygon"}
        elements.append({**kept, "vertices": places(element["polygon"]), "faces": outward})
    return {**document, "elements": elements, "loads": {"live": [{"body": [c, s, 0.0]}]}}


SPACES = pytest.mark.parametrize(
    "turn", [None, pytest.param(0.0, marks=pytest.mark.long), 0.4], ids=["plane", "space", "space, turned"]
)


def in_space(document: dict[str, Any], turn: float | None) -> dict[str, Any]:
    return document if turn is None else solid(document, turn)


@pytest.mark.parametrize("turn", [None, *(pytest.param(turn, marks=pytest.mark.long) for turn in (0.0, 0.4))])
def test_a_rocking_block_gets_weaker_as_it_turns(turn: float | None) -> None:
    """About its toe: the centroid at an angle α − θ from the vertical has moved R (sin α − sin(α − θ)), and
    λ = tan(α − θ)."""
    wide, high = 0.5, 1.0
    found, _ = pushed(in_space(block(wide, high), turn), Joints(normal_stiffness=4e3), 0.1)
    reach, alpha = 0.5 * np.hypot(wide, high), np.arctan(wide / high)
    leaning = np.arcsin(np.sin(alpha) - found.distance / reach)
    late = found.distance > 0.03
    assert found.load_factor[late] == pytest.approx(np.tan(leaning[late]), rel=2e-2)
    assert found.load_factor[-1] < 0.6 * wide / high


@pytest.mark.sampled(2)
@SPACES
def test_a_corner_that_meets_another_block_presses(turn: float | None) -> None:
    """A sliding block carries μ until it reaches a step 0.02 away that is not its neighbour at rest; then it is held.

    The step leans over the block, so that it is a corner of the block that meets it."""
    step = {"id": "step", "polygon": [[1.08, 0.3], [1.6, 0.3], [1.6, 0.8], [0.98, 0.8]], "support": True}
    found, _ = pushed(in_space(block(1.0, 0.6, step), turn), Joints(normal_stiffness=1e5), 0.024)
    before = (found.distance > 0.002) & (found.distance < 0.018)
    assert found.load_factor[before] == pytest.approx(0.3, rel=2e-2)
    assert found.load_factor[found.distance < 0.0200].max() < 0.32
    assert found.load_factor[-1] > 3.0 * 0.3


@pytest.mark.sampled(2)
@SPACES
def test_a_block_that_slid_off_its_face_is_no_longer_carried(turn: float | None) -> None:
    """A block on a base as long as itself tips once its middle has slid past the end: λ falls from μ."""
    document = block(1.0, 0.2)
    document["elements"][1]["polygon"] = [[0, -1], [1, -1], [1, 0], [0, 0]]
    found, _ = pushed(in_space(document, turn), Joints(normal_stiffness=1e5), 0.7)
    assert found.load_factor[(found.distance > 0.01) & (found.distance < 0.3)] == pytest.approx(0.3, rel=3e-2)
    assert found.load_factor[found.distance > 0.6].min() < 0.15


def test_stiff_solids_move_as_at_rest() -> None:
    """Two cubes pushed askew tip about a corner of the base (section 3.2b of the source: λ = 1/2 along a side)."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=4.0, shear=4.0, direction=0.4))
    rest = run_experiment(assembly, settings=Settings(scheme="limit", periods=50.0))
    moving = run_experiment(assembly, settings=Settings(scheme="limit", periods=50.0, moving=True))
    assert moving.rates_agree
    assert moving.collapse_load == pytest.approx(rest.collapse_load, rel=2e-3)


def test_triangles_of_faces_that_are_not_convex() -> None:
    """An L has two triangles a leg's worth of area, all within it; points are told from their solid angle."""
    ring = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    low, high = (np.column_stack([ring, np.full(6, z)]) for z in (0.0, 1.0))
    sides = [(k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k) for k in range(6)]
    table, which = triangles_of(np.vstack([low, high]), ((5, 4, 3, 2, 1, 0), (6, 7, 8, 9, 10, 11), *sides))
    normals = 0.5 * np.cross(table[:, 1] - table[:, 0], table[:, 2] - table[:, 0])
    assert np.linalg.norm(normals[which < 2], axis=1).sum() == pytest.approx(2 * 3.0)
    assert abs(normals.sum(axis=0)).max() < 1e-12
    inside = {(0.5, 0.5, 0.5): True, (0.4, 1.9, 0.9): True, (1.5, 1.5, 0.5): False, (0.5, 0.5, 1.1): False}
    for place, expected in inside.items():
        seen = sum(angle_seen(np.array(place), triangle) for triangle in table)
        assert seen == pytest.approx(2.0 * np.pi if expected else 0.0, abs=1e-9)


# Balance of energy, damping schemes, restart, and equal digits of the virtual experiment.


FRICTION, WEIGHT = 0.3, 3.0


def sliding_block(joints: Joints, settings: Settings, slope: float = 0.0) -> Specimen:
    """A flat block that slides on a support, pushed along it by its weight."""
    scene = parse_scene(
        {
            "elements": [
                {"id": "block", "polygon": [[0, 0], [2, 0], [2, 0.2], [0, 0.2]], "weight": WEIGHT},
                {"id": "base", "polygon": [[-1, -1], [3, -1], [3, 0], [-1, 0]], "support": True},
            ],
            "materials": {"dry": {"friction_coefficient": FRICTION}},
            "loads": {"live": [{"body": [1, 0]}]},
        }
    )
    assembly = build_assembly(scene)
    return specimen_of(assembly, assembly.labels, joints, settings)


def pushed_of_energy(specimen: Specimen, scale: float, periods: float = 60.0, **options: Any) -> Push:
    settled, standing = specimen.settle()
    assert standing is Standing.RESTS
    return push(specimen, settled, scale, periods, **options)


def test_energy_of_a_sliding_block() -> None:
    """Closed form: all work of the live load beyond the elastic energy is friction, μ W times the slip."""
    specimen = sliding_block(Joints(), Settings(length=20.0))
    found = pushed_of_energy(specimen, FRICTION, endless=True)
    energy = specimen.energy(found.at_end)
    # live·u is weight times movement; the elastic part is λ times the reach.
    slip = (found.distance[-1] - FRICTION * specimen.system.reach) / WEIGHT
    assert energy.friction == pytest.approx(FRICTION * WEIGHT * slip, rel=2e-3)
    assert energy.live == pytest.approx(energy.friction + 0.5 * FRICTION**2 * specimen.system.reach, rel=2e-3)
    assert found.energy_error.max() < 1e-3


def test_sliding_with_full_dilation_loses_nothing() -> None:
    """An associative dry joint without cohesion does no plastic work: the weight is lifted instead."""
    specimen = sliding_block(Joints(dilation="friction"), Settings(length=20.0))
    found = pushed_of_energy(specimen, FRICTION, endless=True)
    energy = specimen.energy(found.at_end)
    assert abs(energy.friction) < 1e-6 * energy.live
    assert energy.elastic - energy.dead == pytest.approx(energy.live, rel=5e-3)


@pytest.mark.parametrize("scheme", ["local", "viscous", "combined"])
@pytest.mark.parametrize("inner", ["plastic", "brittle"])
def test_the_balance_closes(scheme: Any, inner: Any) -> None:
    """Two cubes whose inner face opens: below 1 % at every record, whatever the damping, and after the fall too."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0))
    settings = Settings(damping_scheme=scheme, length=10.0)
    specimen = specimen_of(assembly, assembly.labels, Joints(inner=inner), settings)
    found = pushed_of_energy(specimen, 0.4)
    energy = specimen.energy(found.at_end)
    assert found.energy_error.max() < 1e-2
    assert (energy.fracture > 0.0) == (inner == "brittle")
    assert (energy.flow > 0.0) == (inner == "plastic")


def test_the_balance_sees_a_missing_part() -> None:
    """A loss that is left out shows as an error of its size."""
    specimen = sliding_block(Joints(), Settings(length=20.0))
    energy = specimen.energy(pushed_of_energy(specimen, FRICTION, endless=True).at_end)
    assert replace(energy, friction=0.0).error > 0.4


@pytest.mark.long
def test_the_balance_of_moving_geometry() -> None:
    """Gaps and normals that follow the elements: the same balance, with contacts of corners as a part."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0))
    settings = Settings(moving=True, length=6.0)
    joints = Joints(inner="plastic", normal_stiffness=1e4)
    found = pushed_of_energy(specimen_of(assembly, assembly.labels, joints, settings), 0.4)
    assert found.energy_error.max() < 1e-2


@pytest.mark.parametrize("moving", [False, True])
def test_a_continued_push_gives_the_same_digits(moving: bool, tmp_path: Path) -> None:
    """Stopped, written, read by another specimen and continued: bit by bit the push without a stop."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0))
    settings = Settings(moving=moving, length=6.0, damping_scheme="combined")
    joints = Joints(normal_stiffness=1e4)

    def fresh() -> Specimen:
        return specimen_of(assembly, assembly.labels, joints, settings)

    whole = pushed_of_energy(fresh(), 0.4)
    count = len(whole.distance) // 2
    part = pushed_of_energy(fresh(), 0.4, records=count)
    assert part.stopped
    assert len(part.distance) == count
    write_push(tmp_path / "push.npz", part)
    specimen = fresh()
    read = read_push(tmp_path / "push.npz", specimen)
    rest = pushed_of_energy(specimen, 0.4, continued=read)
    assert not rest.stopped
    for name in ("distance", "load_factor", "unbalanced", "broken", "energy_error"):
        assert np.array_equal(getattr(rest, name), getattr(whole, name)), name
    for state in ("at_collapse", "at_end"):
        assert np.array_equal(getattr(rest, state).moved, getattr(whole, state).moved)
        assert np.array_equal(getattr(rest, state).work, getattr(whole, state).work)
    other = sliding_block(joints, settings)
    with pytest.raises(InputError, match="does not fit"):
        read_push(tmp_path / "push.npz", other)


def test_threads_do_not_change_digits() -> None:
    """Eigenvalues and linear equations are rounded, the steps are summed in order: 1 and 2 threads agree bit by bit."""
    assembly = build_assembly(leonardo_flat_arch())
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            specimen = specimen_of(assembly, assembly.labels, Joints(), Settings())
            state, _ = specimen.settle()
        found.append((specimen.system.period, specimen.system.reach, state.moved))
    assert found[0][:2] == found[1][:2]
    assert np.array_equal(found[0][2], found[1][2])


def test_last_digits_of_eigenvalues_are_rounded_away() -> None:
    """Changes of 1e-14, as between two BLAS libraries, leave rounded numbers as they are."""
    from jld_experiment.specimen import rounded

    values = np.random.default_rng(1).uniform(0.1, 9.0, 2000) * np.logspace(-6, 6, 2000)
    kept = rounded(values)
    assert np.abs(kept / values - 1.0).max() < 2.5e-10
    assert (rounded(values * (1.0 + 1e-14)) == kept).mean() > 0.99


def test_a_damping_scheme_that_does_not_exist() -> None:
    with pytest.raises(InputError, match="local or viscous or combined"):
        Settings(damping_scheme="kinetic")
