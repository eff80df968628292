"""Pictures of stress and velocity fields: trajectories against fields whose lines are known, cracks against motions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from cases import grid_document
from command import Command
from jld_core import Assembly, Floats, build_assembly, parse_scene
from jld_core.fields import bounds, bounds_by_fields
from jld_core.fields import mesh as field_mesh
from jld_views import field_figures

PUSHED = [{"element": "c1r0", "force": [0, -1], "at": [0.15, 0.3]}]


@pytest.fixture(scope="module")
def assembly() -> Assembly:
    """Six cells of 0.1 m on two bearings, all faces inner."""
    return build_assembly(parse_scene(grid_document(["aaa", "aaa", "#.#"], live=PUSHED, tension=2e6, shear=2e5)))


@pytest.fixture(scope="module")
def mesh(assembly: Assembly) -> field_mesh.Mesh:
    return field_mesh.subdivide(bounds.FieldSetting.of(assembly).coarse, 6)


def radial(points: Floats, pole: Floats) -> Floats:
    """Simple radial compression cos θ / r about a pole (Flamant 1892): σx, σy, τxy (..., 3)."""
    arm = points - pole
    square = (arm**2).sum(axis=-1)
    size = arm[..., 1] / square**2
    return size[..., None] * np.stack([arm[..., 0] ** 2, arm[..., 1] ** 2, arm[..., 0] * arm[..., 1]], axis=-1)


def test_trajectories_of_a_radial_field_are_rays(assembly: Assembly, mesh: field_mesh.Mesh) -> None:
    """Compression runs along straight lines through the pole, to the width of the grid; there is no tension."""
    pole = np.array([0.15, 0.45])
    grid = field_figures.averaged(assembly, bounds.Stresses(mesh, radial(mesh.corners, pole)))
    found = field_figures.trajectories(grid, "compression", 0.02)
    assert len(found) > 8
    for one in found:
        first, last = one.points[0], one.points[-1]
        along = (last - first) / np.hypot(*(last - first))
        off = (one.points - pole) @ np.array([-along[1], along[0]])
        assert abs(off).max() < grid.spacing
    assert (
        not field_figures.trajectories(grid, "tension", 0.02)
        or field_figures.principal(grid.at(mesh.points), "tension")[0].max() < 0.1
    )


def test_bending_is_drawn_with_both_signs(assembly: Assembly, mesh: field_mesh.Mesh) -> None:
    """σx in proportion to height: horizontal tension below the middle, horizontal compression above it."""
    middle = mesh.corners[..., 1].mean()
    stress = np.zeros((len(mesh), 3, 3))
    stress[..., 0] = middle - mesh.corners[..., 1]
    grid = field_figures.averaged(assembly, bounds.Stresses(mesh, stress))
    for kind, sign in (("compression", 1.0), ("tension", -1.0)):
        found = field_figures.trajectories(grid, kind, 0.02)  # type: ignore[arg-type]
        assert len(found) >= 3
        for one in found:
            assert np.ptp(one.points[:, 1]) < 1e-3 * np.ptp(one.points[:, 0])
            assert (sign * (one.points[:, 1] - middle) > 0.0).all()
            assert one.stress == pytest.approx(abs(one.points[:, 1] - middle), abs=1.5 * grid.spacing)


def test_trajectories_keep_their_distance(assembly: Assembly, mesh: field_mesh.Mesh) -> None:
    """Points of different lines are at least half the distance apart."""
    grid = field_figures.averaged(assembly, bounds.Stresses(mesh, radial(mesh.corners, np.array([0.15, 0.45]))))
    found = [one.points for one in field_figures.trajectories(grid, "compression", 0.03)]
    for k, one in enumerate(found):
        for other in found[k + 1 :]:
            gap = np.hypot(*(one[:, None] - other[None]).transpose(2, 0, 1))
            assert gap.min() > 0.4 * 0.03


def test_cracks_are_where_velocity_jumps(assembly: Assembly) -> None:
    """One cell moves: the lines are its faces, joints where they are dry and cracks where they are inner."""
    coarse = bounds.FieldSetting.of(assembly).coarse
    moving = coarse.cell == assembly.elements.index["c2r0"]
    velocity = np.zeros((len(coarse), 3, 2))
    velocity[moving] = [1.0, 1.0]
    labels = np.zeros(len(assembly.interfaces), dtype=bool)
    faces = [k for k in range(len(labels)) if "c2r0" in assembly.pair(k)]
    labels[faces[0]] = True
    drawn = field_figures.draw_cracks(
        Figure().add_subplot(), assembly, labels, bounds.Velocities(coarse, velocity, np.zeros(len(coarse)))
    )
    joints, cracks = (drawn[name][0].get_segments() for name in ("joints", "cracks"))  # type: ignore[attr-defined]
    assert len(joints) == 2
    assert len(cracks) == 2 * (len(faces) - 1)
    (own, other) = (np.asarray(side) for side in joints)
    assert np.hypot(*(own - other).T) == pytest.approx(np.full(2, 0.06 * assembly.size), rel=1e-9)
    assert "deforming" not in drawn


def test_a_missing_field_is_reported(assembly: Assembly) -> None:
    ax, other = Figure().subplots(1, 2)
    field_figures.draw_stresses(ax, assembly, assembly.labels, None)
    field_figures.draw_cracks(other, assembly, assembly.labels, None)
    assert "no stress field" in ax.get_title()
    assert "no velocity field" in other.get_title()


def test_a_figure_names_bounds_units_and_signs(assembly: Assembly) -> None:
    """Both bounds in the title, the unit of stress and both signs in words in the legend."""
    found = bounds_by_fields(assembly, gap=0.5)
    figure = field_figures.figure_of_fields(assembly, assembly.labels, found)
    text = figure.get_suptitle()
    assert f"{found.lower:.4g}" in text
    assert f"{found.upper:.4g}" in text
    legend = figure.axes[1].get_legend()
    assert legend is not None
    words = " ".join(one.get_text() for one in legend.get_texts())
    assert "compression (solid)" in words
    assert "tension (dashed)" in words
    assert "N/m²" in words
    assert "[m]" in figure.axes[1].get_xlabel()


def test_solve_writes_the_picture(jld: Command, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    document = grid_document(["aaa", "aaa", "#.#"], live=PUSHED, tension=2e6, shear=2e5)
    path.write_text(json.dumps(document), encoding="utf-8")
    assert jld("solve", path, "--cracks", "fields:0.5", "--out", tmp_path / "out").code == 0
    assert {entry.name for entry in (tmp_path / "out").iterdir()} == {"result.json", "result.png", "result.svg"}
