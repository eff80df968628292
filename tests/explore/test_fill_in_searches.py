"""Fill in searches, proofs and certificates, and the one line of every computation that does not model it."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from cases import dry_and_inner
from jld_core import InputError, build_assembly, parse_scene
from jld_core.models import solve_by_fields
from jld_explore import explore
from jld_explore.verification import verify


def arch(fill: dict[str, Any] | None, **more: Any) -> dict[str, Any]:
    """A ring of two courses, three pieces each, on two supports; weak blocks of at most two cells."""
    angles = [math.pi * (0.05 + 0.9 * k / 3) for k in range(4)]
    radii = [1.0, 1.12, 1.24]

    def piece(name: str, course: int, one: float, two: float, **keys: Any) -> dict[str, Any]:
        corners = [(radii[course], one), (radii[course + 1], one), (radii[course + 1], two), (radii[course], two)]
        return {"id": name, "polygon": [[-r * math.cos(a), r * math.sin(a)] for r, a in corners][::-1], **keys}

    elements = [
        piece(f"r{course}v{k}", course, one, two) for course in (0, 1) for k, (one, two) in enumerate(pairwise(angles))
    ]
    for side, one, two in (("left", 0.0, angles[0]), ("right", angles[-1], math.pi)):
        elements += [piece(f"{side}{course}", course, one, two, support=True) for course in (0, 1)]
    return {
        "name": "arch",
        "elements": elements,
        "materials": dry_and_inner(2000, 0.7, 1e5, 2e5),
        "loads": {"live": [{"element": "r1v0", "force": [0, -1e3], "at": [-0.6, 1.08]}]},
        "search": {"block_cells": [1, 2]},
        **({} if fill is None else {"fill": fill}),
        **more,
    }


SOIL = {"level": 1.5, "density": 1800.0, "friction_angle": 30.0, "passive": 1.0}


def searched(document: dict[str, Any], out: Path, driver: str, **options: Any) -> dict[str, Any]:
    explore(parse_scene(document), out=out, driver=driver, seconds=30, seed=1, **options)
    return dict(json.loads((out / "summary.json").read_text()))


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_proof_with_fill_is_that_of_the_enumeration_and_verified(tmp_path: Path) -> None:
    listed = searched(arch(SOIL), tmp_path / "all", "enumeration")
    file = tmp_path / "proof"
    proven = searched(arch(SOIL), tmp_path / "exact", "exact", certificate=file)
    assert proven["proven"]
    assert listed["proven"]
    assert proven["best"] == pytest.approx(listed["best"], rel=1e-6)
    assert proven["best"] <= float(verify(file).claim.bound) <= proven["best"] * (1 + 1e-5)
    plain = searched(arch(None), tmp_path / "plain", "enumeration")
    assert plain["best"] < 0.5 * listed["best"]


def test_fill_without_variable_pressure_is_a_dead_load_of_fields() -> None:
    """By fields fill is accepted where its pressure is known, and refused in one line where it varies."""
    still = SOIL | {"active": 0.0, "passive": 0.0}
    filled, bare = (solve_by_fields(build_assembly(parse_scene(arch(fill))), gap=0.8) for fill in (still, None))
    assert filled.decided.low > bare.decided.low
    with pytest.raises(InputError, match=r"fill.*does not model its variable pressure"):
        solve_by_fields(build_assembly(parse_scene(arch(SOIL))), gap=0.3)


def test_spatial_scenes_and_cells_left_out_refuse_fill(tmp_path: Path) -> None:
    cube = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    upper = [[x, y, z + 1] for x, y, z in cube]
    elements = [{"id": "a", "vertices": cube, "faces": faces, "support": True}]
    elements.append({"id": "b", "vertices": upper, "faces": faces})
    solid = arch(SOIL, elements=elements, loads={"live": [{"element": "b", "force": [1, 0, 0]}]})
    with pytest.raises(InputError, match=r"fill.*planar"):
        build_assembly(parse_scene(solid))
    void = arch(SOIL | {"active": 0.0, "passive": 0.0}, search={"void": {"cells": "all"}, "segmentation": False})
    with pytest.raises(InputError, match=r"search\.void|fill"):
        explore(parse_scene(void), out=tmp_path / "void", driver="enumeration")
