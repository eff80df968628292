"""Balance of energy, damping schemes, restart, and equal digits of the virtual experiment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.scenes import leonardo_flat_arch, stacked_cubes
from threadpoolctl import threadpool_limits

from jld_core import InputError, build_assembly, parse_scene
from jld_experiment import Joints, Push, Settings, Specimen, Standing, push, specimen_of
from jld_experiment.driving import read_push, write_push

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


def pushed(specimen: Specimen, scale: float, periods: float = 60.0, **options: Any) -> Push:
    settled, standing = specimen.settle()
    assert standing is Standing.RESTS
    return push(specimen, settled, scale, periods, **options)


def test_energy_of_a_sliding_block() -> None:
    """Closed form: all work of the live load beyond the elastic energy is friction, μ W times the slip."""
    specimen = sliding_block(Joints(), Settings(length=20.0))
    found = pushed(specimen, FRICTION, endless=True)
    energy = specimen.energy(found.at_end)
    # live·u is weight times movement; the elastic part is λ times the reach.
    slip = (found.distance[-1] - FRICTION * specimen.system.reach) / WEIGHT
    assert energy.friction == pytest.approx(FRICTION * WEIGHT * slip, rel=2e-3)
    assert energy.live == pytest.approx(energy.friction + 0.5 * FRICTION**2 * specimen.system.reach, rel=2e-3)
    assert found.energy_error.max() < 1e-3


def test_sliding_with_full_dilation_loses_nothing() -> None:
    """An associative dry joint without cohesion does no plastic work: the weight is lifted instead."""
    specimen = sliding_block(Joints(dilation="friction"), Settings(length=20.0))
    found = pushed(specimen, FRICTION, endless=True)
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
    found = pushed(specimen, 0.4)
    energy = specimen.energy(found.at_end)
    assert found.energy_error.max() < 1e-2
    assert (energy.fracture > 0.0) == (inner == "brittle")
    assert (energy.flow > 0.0) == (inner == "plastic")


def test_the_balance_sees_a_missing_part() -> None:
    """A loss that is left out shows as an error of its size."""
    specimen = sliding_block(Joints(), Settings(length=20.0))
    energy = specimen.energy(pushed(specimen, FRICTION, endless=True).at_end)
    assert replace(energy, friction=0.0).error > 0.4


@pytest.mark.long
def test_the_balance_of_moving_geometry() -> None:
    """Gaps and normals that follow the elements: the same balance, with contacts of corners as a part."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0))
    settings = Settings(moving=True, length=6.0)
    joints = Joints(inner="plastic", normal_stiffness=1e4)
    found = pushed(specimen_of(assembly, assembly.labels, joints, settings), 0.4)
    assert found.energy_error.max() < 1e-2


@pytest.mark.parametrize("moving", [False, True])
def test_a_continued_push_gives_the_same_digits(moving: bool, tmp_path: Path) -> None:
    """Stopped, written, read by another specimen and continued: bit by bit the push without a stop."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0))
    settings = Settings(moving=moving, length=6.0, damping_scheme="combined")
    joints = Joints(normal_stiffness=1e4)

    def fresh() -> Specimen:
        return specimen_of(assembly, assembly.labels, joints, settings)

    whole = pushed(fresh(), 0.4)
    count = len(whole.distance) // 2
    part = pushed(fresh(), 0.4, records=count)
    assert part.stopped
    assert len(part.distance) == count
    write_push(tmp_path / "push.npz", part)
    specimen = fresh()
    read = read_push(tmp_path / "push.npz", specimen)
    rest = pushed(specimen, 0.4, continued=read)
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
        Settings(damping_scheme="kinetic")  # type: ignore[arg-type]
