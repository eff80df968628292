"""All layouts of parts that fit: numbers, boxes turned in space, parity with the exact driver, marks and tenons."""

from __future__ import annotations

import time
from dataclasses import replace
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from jld_core import InputError, build_assembly, parse_scene
from jld_cut import Options
from jld_cut.cells import BENT, Cutting, Joint, Limits
from jld_cut.cut import verdict
from jld_cut.fields import scene_of_parts
from jld_cut.marks import mark, tenons
from jld_cut.meshes import as_written, doubled_edges, moments, pieces_of, read_solid, solid_of, surface_of
from jld_cut.partitions import Asked, Boxes, connected_sets, covers, frames, search
from jld_cut.parts import Part, different
from jld_cut.scene import scene_of
from jld_cut.search import Family, Truth, body_of, family_of
from jld_explore import ExploreSettings, explore


def box(x: float, y: float, z: float, at: tuple[float, float, float] = (0, 0, 0)) -> Any:
    return Manifold.cube((x, y, z)).translate(at)


def chain(count: int) -> list[int]:
    return [sum(1 << j for j in (k - 1, k + 1) if 0 <= j < count) for k in range(count)]


def sets_of(cells: list[Any], around: list[int], fit: tuple[float, float, float], together: list[int]) -> list[int]:
    turned = frames(np.eye(3))
    boxes = Boxes.of([surface_of(one)[0] for one in cells], np.array([moments(one) for one in cells]), turned)
    return connected_sets(boxes, around, Limits(np.sort(np.array(fit)), np.inf), together, time.time() + 60)


@pytest.mark.parametrize(
    ("fit", "together", "most", "number"),
    [
        (
            (9.0, 1.0, 1.0),
            [],
            9,
            [comb(7, k - 1) for k in range(1, 5)],
        ),  # a row of eight cells: cuts at k − 1 of 7 places
        ((1.0, 2.0, 1.0), [], 2, [0, 0, 0, 1, 10]),  # pairs and singles
        ((1.0, 2.0, 1.0), [0b110], 2, [0, 0, 0, 0, 6]),  # 1 and 2 stay together: one, a pair, then five in three parts
        ((1.0, 0.9, 1.0), [], 0, [0, 0]),
    ],
)
def test_all_layouts_of_a_row_of_cells(
    fit: tuple[float, float, float], together: list[int], most: int, number: list[int]
) -> None:
    cells = [box(1, 1, 1, (k, 0, 0)) for k in range(8)]
    sets = sets_of(cells, chain(8), fit, together)
    assert max((one.bit_count() for one in sets), default=0) == min(most, 8)
    found = [len(list(covers(sets, 8, parts))) if sets else 0 for parts in range(1, 1 + len(number))]
    if together:
        assert found[:4] == [0, 0, 0, 0]
        assert all(any(one & 0b110 == 0b110 for one in way) for way in covers(sets, 8, 5))
    else:
        assert found == number


@pytest.mark.parametrize(("turn", "fits"), [(0.0, True), (30.0, True), (45.0, True), (82.5, True)])
def test_a_turned_bar_fits_a_box_of_three_sides(turn: float, fits: bool) -> None:
    bar = box(2.0, 0.5, 0.2).rotate((0, 0, turn)).rotate((90, 0, 0))
    assert bool(sets_of([bar], [0], (0.21, 2.01, 0.51), [])) is fits
    assert not sets_of([bar], [0], (0.21, 1.9, 0.51), [])
    # along the diagonal of a cube
    rod = box(1.6, 0.02, 0.02).rotate((0, -float(np.degrees(np.arcsin(3**-0.5))), 45))
    assert sets_of([rod], [0], (1.0, 1.0, 1.0), [])


def test_all_layouts_prove_what_the_exact_driver_proves(tmp_path: Path) -> None:
    solid = box(1.8, 0.4, 0.1, (0, 0, 0.4)) + box(0.2, 0.4, 0.41, (0.1, 0, 0)) + box(0.2, 0.4, 0.41, (1.5, 0, 0))
    load = ("0,0,-1000@0.6,-1,0.49,1.2,1,0.51",)
    wish = Options((0.95, 0.95, 0.95), load, cells=9, families=("grid",)).wish()
    family = family_of("grid", "bench", body_of(solid, wish), wish)
    assert family is not None
    end = time.time() + 60
    found = search(family.document, family.boxes(), family.around, wish.limits, [], Asked(1.0, 3, end, end))
    fewest = next(n for n, one in sorted(found.of.items()) if len(one.low))
    limits = {"block_extent": [None, 0.95], "blocks": [None, fewest]}
    document = family.document | {"search": limits}
    proven = explore(document, tmp_path / "exact", ExploreSettings(check_fields=0, pictures=False, driver="exact"))
    assert found.proven(fewest)
    assert proven.summary.proven
    assert found.of[fewest].low[0] == pytest.approx(proven.summary.best, rel=1e-5)
    assert found.bound(fewest) == pytest.approx(proven.summary.best, rel=1e-5)
    # two shapes at most: the layouts of the symmetric bench are among all
    alike = search(family.document, family.boxes(), family.around, wish.limits, [], Asked(1.0, 4, end, end, 1))
    assert all(one.solved <= found.of[n].solved for n, one in alike.of.items() if n in found.of)
    for one in alike.of.values():
        for block in one.blocks:
            wholes = [sum(family.boxes().moments[block == name]) for name in set(block.tolist())]
            assert len({round(float(whole[0]), 9) for whole in wholes}) == 1


@pytest.mark.parametrize("number", [3, 12])
def test_a_number_is_engraved_in_a_closed_part(number: int) -> None:
    whole = box(0.3, 0.4, 0.5)
    part = Part(number, [0], whole, whole, 1.0)
    assert mark(part, 1.0)
    taken = 1.0 - part.solid.volume() / whole.volume()
    assert 1e-4 < taken < 0.02
    assert doubled_edges(*as_written(part.solid, 1.0)) == 0


def test_a_tenon_fits_its_mortise_and_the_box() -> None:
    low, high = box(1, 1, 1), box(1, 1, 1, (0, 0, 1))
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
    joint = Joint(0, 1, square, np.array([0, 0, 1.0]), 1.0)
    for fit, clearance, number in ((1.0, 0.004, 0), (1.5, 0.004, 1), (1.5, 0.0, 1)):
        below = Part(1, [0], low, low, 1.0, step=1)
        above = Part(2, [1], high, high, 1.0, step=2, direction=np.array([0, 0, -1.0]))
        made = tenons([below, above], np.array([0, 1]), [joint], clearance, np.full(3, fit), 1.0)
        assert made == number
        if not made:
            continue
        assert above.solid.volume() == pytest.approx(1.0 + 0.2**3, rel=1e-6)
        assert below.solid.volume() == pytest.approx(1.0 - (0.2 + clearance) ** 2 * (0.2 + clearance), rel=1e-6)
        for height in (0.0, 0.1, 0.3):
            assert (above.solid.translate((0, 0, height)) ^ below.solid).volume() < 1e-12
        assert above.box.max() == pytest.approx(1.2)


def test_parts_alike_are_counted_once() -> None:
    corner = box(1, 1, 1) + box(2, 1, 0.5)
    bodies = [corner, corner.rotate((0, 0, 90)).translate((5, 0, 0)), corner.mirror((1, 0, 0)), box(1, 1, 2)]
    assert different([Part(k, [k], one, one, 1.0) for k, one in enumerate(bodies, 1)]) == 2


def test_cells_keep_closed_cavities() -> None:
    hollow = box(3, 1, 1) - box(0.4, 0.4, 0.4, (0.3, 0.3, 0.3))
    assert [one.volume() for one in pieces_of(hollow)] == [pytest.approx(3.0 - 0.4**3)]
    cutting = Cutting(hollow)
    cutting.through(np.array([1.0, 0, 0]), 2.0)
    assert sum(one.volume() for one in cutting.cells) == pytest.approx(3.0 - 0.4**3, rel=1e-12)


def _of(*bodies: Any) -> Any:
    return trimesh.util.concatenate([trimesh.Trimesh(*surface_of(one), process=False) for one in bodies])


def _void() -> Any:
    points, triangles = surface_of(box(1, 1, 1, (0.5, 0.5, 0.5)))
    return trimesh.util.concatenate([_of(box(2, 2, 2)), trimesh.Trimesh(points, triangles[:, ::-1], process=False)])


@pytest.mark.parametrize("kind", ["stl", "obj"])
@pytest.mark.parametrize(
    ("made", "volume"),
    [
        (lambda: trimesh.creation.torus(2.0, 0.5), 9.7434),
        (lambda: _of(box(1, 1, 1), box(1, 1, 1, (1, 0, 0))), 2.0),  # they touch
        (lambda: _of(box(1, 1, 1), box(1, 1, 1, (0.5, 0.2, 0.1))), 2.0 - 0.5 * 0.8 * 0.9),  # they overlap
        (_void, 7.0),
        (lambda: _of(box(2, 2, 2), box(1, 1, 1, (0.5, 0.5, 0.5))), 8.0),  # one within the other, both outwards
        (lambda: _of(box(1, 1, 1), box(1, 1, 1, (3, 0, 0))), None),
    ],
)
def test_meshes_of_other_makes(tmp_path: Path, kind: str, made: Any, volume: float | None) -> None:
    path = tmp_path / f"a.{kind}"
    made().export(path)
    if volume is None:
        with pytest.raises(InputError, match="2 solids that do not touch"):
            read_solid(path, 1.0)
        return
    assert read_solid(path, 1.0).volume() == pytest.approx(volume, rel=1e-4)
    assert read_solid(path, 1e-3).volume() == pytest.approx(1e-9 * volume, rel=1e-4)


def test_the_verdict_says_what_limits_and_what_is_proven() -> None:
    told = {"parts": 3, "bracket": [2.0, 2.0], "locked": False, "uncut": [1.5, 1.5], "require": 1.0, "meets": True}
    told |= {"too_large": [], "can_be_laid": True, "coarse_truth": "", "faulty_files": [], "proven": True}
    assert "no fewer parts" in verdict(told)
    assert "opens over its whole depth" in verdict(told)
    assert "crushing" not in verdict(told)
    assert "only crushing limits it" in verdict(told | {"only_crushing": True})
    locked_ones = told | {"load_factor_of_cells": 2.0, "bound": 3.0}
    assert "no layout of as many exceeds 3 on them" in verdict(locked_ones)
    assert "no fewer parts" not in verdict(told | {"proven": False, "uncut": [2.0, 2.0]})


def test_a_part_within_another_is_named() -> None:
    """A core within a shell of one part has no way out; a shell of two parts lets it in."""
    wish = Options((1.0, 1.0, 1.0), ("0,0,-1000",), cells=27, families=("grid",)).wish()
    family = family_of("grid", "cube", body_of(box(3, 3, 3), wish), wish)
    assert family is not None
    middles = np.array([np.array(one.bounding_box()).reshape(2, 3).mean(axis=0) for one in family.cutting.cells])
    core = np.abs(middles - 1.5).max(axis=1) < 0.1
    truth = Truth(family, wish.setting)
    assert truth.order(core.astype(np.int64), 60.0) is False
    assert int(np.flatnonzero(core)[0]) in truth.locking(core.astype(np.int64), 60.0)
    assert len(truth.order(np.where(core, 1, np.where(middles[:, 2] > 2.0, 2, 0)), 60.0).steps) == 3


def test_a_part_with_a_hook_slides_out() -> None:
    """A rail of T section within two other parts, one on each side, leaves along itself although its hull would not."""
    solid = box(3, 3, 2)
    wish = Options((3.0,) * 3, ("0,0,-1000",), cells=8, families=("grid",)).wish()
    cutting = Cutting(solid, [(box(1, 3, 1, (1, 0, 0)) + box(2, 3, 0.5, (0.5, 0, 1)))])
    cutting.cells.append(solid - cutting.cells[0])
    cutting.planes = [np.array(p) for p in ((1.0, 0, 0, 1), (1, 0, 0, 2), (0, 0, 1, 1), (1, 0, 0, 0.5), (1, 0, 0, 2.5))]
    cutting.planes.append(np.array([0, 0, 1, 1.5]))
    joints = cutting.tidy(wish.limits)
    document = scene_of("rail", cutting, joints, wish.setting, BENT, cutting.planes)
    truth = Truth(Family("grid", cutting, joints, document, []), wish.setting)
    assert truth.convex
    steps = truth.order(np.array([0, 1]), 60.0).steps
    assert abs(steps[-1].direction @ [0, 1, 0]) == pytest.approx(1.0)


def test_parts_are_a_few_convex_pieces_for_fields() -> None:
    """An L of two parts is three pieces that hold its volume, joined along one bisector; a bowl is none of a few."""
    solid = box(3, 1, 1) + box(1, 1, 3)
    wish = Options((3.0,) * 3, ("0,0,-1000",)).wish()
    cutting = Cutting(solid)
    cutting.through(np.array([1.0, 0, 0]), 2.0)
    scene = scene_of_parts("L", cutting, cutting.cells, wish.setting)
    assembly = build_assembly(parse_scene(scene))
    free = assembly.elements.free
    assert len(free) == 3
    assert assembly.elements.volume[free].sum() == pytest.approx(5.0, rel=1e-9)
    assert sorted(assembly.interfaces.area.round(9).tolist())[:2] == [1.0, 1.0]
    bowl = (Manifold.sphere(1.6, 24) - Manifold.sphere(1.4, 24)) ^ box(4, 4, 2, (-2, -2, 0))
    with pytest.raises(InputError, match="convex pieces"):
        scene_of_parts("bowl", Cutting(bowl), [bowl], wish.setting)


def test_regions_stay_whole() -> None:
    wish = Options((1.2,) * 3, ("0,0,-1000",), cells=6, families=("grid",), keep_whole=("0,0,0.5,0.4,0.4,1.5",)).wish()
    pillar = box(0.4, 0.4, 2.0)
    family = family_of("grid", "pillar", body_of(pillar, wish), wish)
    assert family is not None
    assert family.together
    free = replace(wish, whole=())
    assert not family_of("grid", "pillar", body_of(pillar, free), free).together  # type: ignore[union-attr]
    assert solid_of(*surface_of(pillar)).volume() == pytest.approx(0.32)
