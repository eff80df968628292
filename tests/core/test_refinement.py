"""Refinement: nothing of the structure changes but what may be cut, and old joints stay where they are asked to."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from cases import assembly_in_space as spatial_assembly
from cases import box, dry_and_inner, grid_assembly, grid_document
from cases import wall_in_space as spatial_wall
from command import Command, saved
from jld_core import (
    Assembly,
    InputError,
    LimitAnalysis,
    LimitAnalysisResult,
    Scene,
    Status,
    build_assembly,
    load_scene,
    parse_scene,
    samples,
    solve,
)
from jld_core.fields import problem
from jld_core.refinement import arrangement, crack_cells, refine
from jld_core.scene import uncertain
from jld_explore import search_space
from jld_practice.design import DesignOptions, read_outline, tessellations, with_loads

BODY = {"live": [{"body": [1.0, 0.0]}]}
WALL = samples.wall(courses=4, length=1.6, opening="0.6,0.2,0.4,0.2", load="crown")
STONE = samples.Stone(tension=1e9, shear=1e9)
KINDS: list[tuple[Scene, dict[str, Any]]] = [
    (samples.arch(voussoirs=6, load="quarter", stone=STONE), {"cell": (0.12,)}),
    (
        samples.arch(voussoirs=6, load="quarter", stone=STONE),
        {"cell": (0.1, 7.5), "kind": "radial", "centre": (0.0, 0.0)},
    ),
    (samples.buttress(courses=4, stone=STONE), {"cell": (0.4, 0.3), "kind": "voronoi"}),
    (samples.vault(voussoirs=4, courses=2, length=1.0, stone=STONE), {"cell": (0.6, 0.4, 0.6)}),
    (parse_scene(grid_document(["aab", "ccb", "###"])), {"cell": (0.05,)}),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("scene", "how"), KINDS, ids=lambda value: "-".join(map(str, value.values())) if isinstance(value, dict) else ""
)
def test_a_refined_structure_is_the_same_structure(scene: Scene, how: dict[str, Any]) -> None:
    """Volumes and loads are those of the parents, and with strong cells λ is that of the blocks, to 1e-6."""
    found = refine(scene, **how)
    old, new = build_assembly(scene), build_assembly(found.scene)
    assert len(new.elements) > 1.5 * len(old.elements)
    parent = np.array([old.elements.index[found.parent[name]] for name in new.elements.ids])
    assert np.bincount(parent, new.elements.volume) == pytest.approx(old.elements.volume, rel=1e-9)
    for field in ("dead", "live"):
        ours, theirs = getattr(new, field), getattr(old, field)
        d = old.dimension
        for axis in range(d):
            assert np.bincount(parent, ours[:, axis]) == pytest.approx(theirs[:, axis], abs=1e-6 * np.abs(theirs).max())
    inside = parent[new.interfaces.a] == parent[new.interfaces.b]
    assert not new.labels[inside].any()
    length = np.bincount(inside, new.interfaces.area)
    assert length[0] == pytest.approx(old.interfaces.area.sum(), rel=1e-6)
    expected, result = solve(old), solve(found.scene and new)
    assert result.status is expected.status
    if np.isfinite(expected.load_factor) and scene.materials.inner and scene.materials.inner.tensile_strength > 1e8:
        assert result.load_factor == pytest.approx(expected.load_factor, rel=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "how",
    [
        {"cell": (0.1,)},
        {"cell": (0.25, 0.4)},
        {"cell": (0.4,), "kind": "voronoi"},
        {"cell": (0.3, 15.0), "kind": "radial", "centre": (1.2, 0.0)},
    ],
)
def test_cells_share_corners_and_old_joints_keep_their_lengths(how: dict[str, Any]) -> None:
    """Irregular stones (found by a fuzzer): corners 1e-10 apart once lost 0.3 mm of a joint of 2.4 m."""
    scene = load_scene(Path(__file__).parent / "scenes" / "irregular_stones.json")
    found = refine(scene, **how)
    old, new = build_assembly(scene), build_assembly(found.scene)
    assert new.moved == 0.0
    corners = np.unique(np.concatenate(new.elements.shape), axis=0)
    apart = np.sqrt(((corners[:, None] - corners[None]) ** 2).sum(axis=2)) + np.eye(len(corners))
    assert apart.min() > 1e-6 * min(how["cell"])
    lengths = []
    for assembly, parent in ((old, {name: name for name in old.elements.ids}), (new, found.parent)):
        names, faces, total = assembly.elements.ids, assembly.interfaces, {}
        for a, b, length in zip(faces.a, faces.b, faces.l1, strict=True):
            pair = tuple(sorted((parent[names[a]], parent[names[b]])))
            total[pair] = total.get(pair, 0.0) + length
        lengths.append({pair: length for pair, length in total.items() if pair[0] != pair[1]})
    assert lengths[0].keys() == lengths[1].keys()
    for pair, length in lengths[0].items():
        assert lengths[1][pair] == pytest.approx(length, rel=1e-12)


def test_refining_again_with_the_same_seed_is_the_same() -> None:
    one, two, other = (refine(WALL, (0.15,), kind="voronoi", seed=seed).scene for seed in (3, 3, 4))
    assert one.fingerprint == two.fingerprint != other.fingerprint


def test_labels_of_old_joints_follow_the_option() -> None:
    """By block: only cells within old blocks are open. By material: faces between densities stay dry."""
    document = WALL.model_dump(mode="json", exclude_defaults=True)
    for k, entry in enumerate(document["elements"]):
        if not entry.get("support"):
            entry["density"] = 2000.0 if k % 2 else 1500.0
    scene = parse_scene(document)
    spaces = {}
    for by in (None, "block", "material"):
        found = refine(scene, (0.15, 0.1), by=by)
        assembly = build_assembly(found.scene)
        space = search_space(found.scene, assembly)
        ids, faces = assembly.elements.ids, assembly.interfaces
        one, two = ([found.parent[ids[k]] for k in side.tolist()] for side in (faces.a, faces.b))
        old_joint = np.array([a != b for a, b in zip(one, two, strict=True)])
        density = {e.id: e.density for e in scene.elements or []}
        mixed = np.array([density[a] != density[b] for a, b in zip(one, two, strict=True)]) & assembly.free_faces
        spaces[by] = (space.candidates, old_joint, mixed, assembly)
    candidates, old_joint, mixed, assembly = spaces[None]
    assert np.array_equal(candidates, assembly.free_faces)
    candidates, old_joint, _, assembly = spaces["block"]
    assert np.array_equal(candidates, assembly.free_faces & ~old_joint)
    candidates, _, mixed, assembly = spaces["material"]
    assert mixed.any()
    assert np.array_equal(candidates, assembly.free_faces & ~mixed)
    assert assembly.labels[mixed].all()


def test_pairs_of_the_search_and_labels_follow_their_pieces() -> None:
    document = grid_document(["aab", "ccb", "###"])
    document["labels"] = {"inner": [["c0r0", "c0r1"]]}
    document["search"] = {"keep": {"inner": [["c1r0", "c1r1"]]}, "candidates": [["c0r0", "c1r0"]], "blocks": [1, None]}
    scene = parse_scene(document)
    found = refine(scene, (0.05,))
    assembly = build_assembly(found.scene)
    ids, faces = assembly.elements.ids, assembly.interfaces
    couples = [{found.parent[ids[a]], found.parent[ids[b]]} for a, b in zip(faces.a, faces.b, strict=True)]
    old = build_assembly(scene)
    for couple, dry in zip(couples, assembly.labels, strict=True):
        if len(couple) == 2:
            rows = zip(old.interfaces.a, old.interfaces.b, old.labels, strict=True)
            (was,) = [d for a, b, d in rows if {old.elements.ids[a], old.elements.ids[b]} == couple]
            assert dry == was
    kept = [{found.parent[a], found.parent[b]} for a, b in found.scene.search.keep.inner]
    assert kept == [{"c1r0", "c1r1"}] * len(kept) != []
    assert found.scene.search.blocks == [1, None]
    opened = [{found.parent[a], found.parent[b]} for a, b in found.scene.search.candidates]
    assert {"c0r0", "c1r0"} in opened
    assert {"c1r0", "c1r1"} not in opened


def test_the_command(tmp_path: Path, jld: Command) -> None:
    scene, out = tmp_path / "wall.json", tmp_path / "fine.json"
    scene.write_text(WALL.model_dump_json(exclude_defaults=True))
    done = jld("refine", scene, "--cell", "0.2,0.1", "-o", out)
    assert (done.code, done.err) == (0, "")
    assert load_scene(out).fingerprint == refine(WALL, (0.2, 0.1)).scene.fingerprint
    spatial = saved(tmp_path / "vault.json", samples.vault())
    bare = saved(
        tmp_path / "bare.json", WALL.model_copy(update={"materials": WALL.materials.model_copy(update={"inner": None})})
    )
    bad = tmp_path / "bad.json"
    for arguments, words in (
        ([scene, "--cell", "0"], ["--cell", "above 0"]),
        ([scene, "--cell", "1e308"], ["--cell", "above 0"]),
        ([scene, "--cell", "0.1", "--bond", "flemish"], ["--bond", "--kind bond"]),
        ([scene, "--cell", "a"], ["--cell", "numbers"]),
        ([scene, "--cell", "1e-9"], ["--cell", "at most"]),
        ([scene, "--cell", "0.1,0.1,0.1"], ["--cell"]),
        ([scene, "--cell", "0.1", "--kind", "hexagon"], ["--kind", "voronoi"]),
        ([scene, "--cell", "0.1,10", "--kind", "radial"], ["centre"]),
        ([scene, "--cell", "0.1", "--by", "colour"], ["--by", "block, material"]),
        ([spatial, "--cell", "0.1", "--kind", "voronoi"], ["--kind", "planar"]),
        ([bare, "--cell", "0.1"], ["materials.inner"]),
        ([tmp_path / "none.json", "--cell", "0.1"], ["none.json"]),
    ):
        wrong = jld("refine", *arguments, "-o", bad)
        assert (wrong.code, wrong.out, wrong.err.count("\n")) == (2, "", 1), arguments
        assert all(word in wrong.err for word in words), wrong.err
    assert not bad.exists()
    before = scene.read_text()
    jld("refine", scene, "--cell", "0.2", "-o", scene).refused("it is the file that is read")
    assert scene.read_text() == before


def test_scenes_that_cannot_be_refined_are_refused() -> None:
    ell = [[0, 0, 0], [2, 0, 0], [2, 0, 1], [1, 0, 1], [1, 0, 2], [0, 0, 2]]
    ell += [[x, 1, z] for x, _, z in ell]
    faces = [[0, 1, 2, 3, 4, 5], [11, 10, 9, 8, 7, 6], *[[(k + 1) % 6, k, 6 + k, 6 + (k + 1) % 6] for k in range(6)]]
    ground = [[x, y, z] for z in (-1, 0) for y in (0, 1) for x in (0, 2)]
    boxes = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    document = {
        "elements": [
            {"id": "L", "vertices": ell, "faces": faces},
            {"id": "ground", "vertices": ground, "faces": boxes, "support": True},
        ],
        "materials": dry_and_inner(1, 1, 1, 1),
        "loads": {"live": [{"body": [1, 0, 0]}]},
    }
    with pytest.raises(InputError, match="'L': it is not convex"):
        refine(parse_scene(document), (0.5,))


UNCERTAIN = {"cov": 0.1, "kind": "normal"}


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("stone", "load", "where"),
    [
        ({}, {"force": {"mean": [2.0, -1.0], **UNCERTAIN}}, r"loads\.live\[0\]\.force"),
        ({}, {"force": [{"mean": 2.0, **UNCERTAIN}, -1.0]}, r"loads\.live\[0\]\.force"),
        ({}, {"force": [2.0, 0.0], "moment": {"mean": 0.5, **UNCERTAIN}}, r"loads\.live\[0\]\.moment"),
        ({"weight": {"mean": 40.0, **UNCERTAIN}}, {"force": [2.0, 0.0]}, "element 'b'.weight"),
        ({"density": {"mean": 3.0, **UNCERTAIN}}, {"force": [2.0, 0.0]}, "element 'b'.density"),
    ],
    ids=["force", "component", "moment", "weight", "density"],
)
def test_what_is_uncertain_is_shared_by_its_mean(stone: dict[str, Any], load: dict[str, Any], where: str) -> None:
    """By cells λ is that at the means; a refined scene would count one value as several, and is refused."""
    ground, block = ([[x, y] for x, y in ((0, y0), (1, y0), (1, y1), (0, y1))] for y0, y1 in ((-1, 0), (0, 2)))
    document = {
        "elements": [
            {"id": "g", "polygon": ground, "support": True},
            {"id": "b", "polygon": block, "weight": 40.0, **stone},
        ],
        "materials": dry_and_inner(2.0, 0.5, 100.0, 100.0),
        "loads": {"live": [{"element": "b", **load}]},
    }
    document["materials"]["inner"]["tensile_strength"] = {"mean": 100.0, **UNCERTAIN, "each": True}
    if "density" in stone:
        del document["elements"][1]["weight"]
    means, stated = parse_scene(uncertain.with_means(document)), parse_scene(document)
    assert solve(document, cracks="cells:0.5").load_factor == solve(means, cracks="cells:0.5").load_factor
    with pytest.raises(InputError, match=f"{where}: it is uncertain"):
        refine(stated, (0.5,))
    assert any(
        "for 1 with" in note for note in refine(means.model_copy(update={"materials": stated.materials}), (0.5,)).notes
    )
    assert refine(stated, (2.0,)).notes == ()
    whole = refine(stated, (2.0,)).scene
    assert [value for _, value in uncertain.uncertain_values(whole)] == [
        value for _, value in uncertain.uncertain_values(stated)
    ]


def test_moving_loads_stay_and_pressure_is_split_with_its_element() -> None:
    def rectangle(name: str, left: float, low: float, right: float, high: float, **more: Any) -> dict[str, Any]:
        return {"id": name, "polygon": [[left, low], [right, low], [right, high], [left, high]], **more}

    def scene_of(loads: dict[str, Any]) -> Scene:
        elements = [rectangle("s", 0, -1, 4, 0, support=True), rectangle("a", 0, 0, 2, 1), rectangle("b", 2, 0, 4, 1)]
        stone = {"tensile_strength": 1e5, "shear_strength": 1e5}
        materials = {"density": 2000, "dry": {"friction_angle": 30}, "inner": stone}
        return parse_scene({"elements": elements, "materials": materials, "loads": loads})

    moving = [{"axles": [{"weight": 1e3}], "path": [[0, 1], [4, 1]], "steps": 3}]
    push: dict[str, Any] = {"pushes": {"directions": 1}}
    for more in ({}, push, {"cases": [{"name": "push", "live": [{"element": "a", "force": [1, 0]}]}]}):
        scene = scene_of({"moving": moving, **more})
        refined = refine(scene, (1.0,)).scene
        assert (refined.loads.moving, refined.loads.pushes) == (scene.loads.moving, scene.loads.pushes)
        # in the middle the axle stands on a joint, with a case for either side
        assert len(build_assembly(refined).cases) == len(build_assembly(scene).cases) == 4 + len(more)
    for face in ({"along": [[0, 0], [0, 1]]}, {"between": ["a", "outside"]}):
        pressed = scene_of({"live": [{"face": face, "pressure": 10.0}]})
        one, other = build_assembly(pressed), build_assembly(refine(pressed, (0.5,)).scene)
        assert np.allclose(one.live.sum(axis=0)[:2], other.live.sum(axis=0)[:2], rtol=1e-12)


def test_pressure_on_a_split_solid_acts_on_the_free_faces_of_its_pieces() -> None:
    document: dict[str, Any] = {
        "elements": [
            box("ground", [0, 0, -1], [2, 1, 0], support=True),
            box("a", [0, 0, 0], [1, 1, 1]),
            box("b", [1, 0, 0], [2, 1, 1]),
        ],
        "materials": dry_and_inner(1, 0.6, 1e3, 1e3),
        "loads": {"live": [{"face": {"between": ["a", "outside"]}, "pressure": 10.0}]},
    }
    scene = parse_scene(document)
    one, other = build_assembly(scene), build_assembly(refine(scene, (0.5,)).scene)
    assert other.live.sum(axis=0)[:3] == pytest.approx(one.live.sum(axis=0)[:3], abs=1e-9)
    document["elements"].append(box("c", [0.25, 0.25, 1], [0.75, 0.75, 2]))
    with pytest.raises(InputError, match="free face of 'a' with a hole"):
        refine(parse_scene(document), (0.5,))


def test_cells_that_reach_beyond_two_elements_are_snapped_past_the_corner_between_them() -> None:
    """The lower edge of the middle cell, moved onto the outline, would pass the corner of both elements."""
    ground = {"id": "g", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True}
    halves = [{"id": f"h{x}", "polygon": [[x, 0], [x + 1, 0], [x + 1, 1], [x, 1]], "block": "b"} for x in (0, 1)]
    scene = parse_scene(grid_document(["a", "#"]) | {"grid": None, "elements": [ground, *halves], "loads": BODY}, "two")
    ends, over = [-4e-4, 0.9, 1.1, 2.0 + 4e-4], 4e-4
    cells = [shapely.box(a, -over, b, 1.0 + over) for a, b in itertools.pairwise(ends)]
    found = build_assembly(refine(scene, (0.35,), cells=cells, snap=0.25).scene).elements
    assert found.volume[found.free] == pytest.approx([0.9, 0.1, 0.1, 0.9])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rows", [["#abc#"], ["#abcde#"], ["#ab#"], ["#abc#", "#abc#"]])
@pytest.mark.parametrize("at", [None, "edge"])
def test_a_force_at_a_common_corner_of_cells_is_shared(rows: list[str], at: str | None) -> None:
    """A layout and its mirror image carry the same: the force stands in the middle, on a corner or edge of cells."""
    wide, tall = len(rows[0]), len(rows)
    place = [0.1 * wide, 0.1 * tall + (0.05 if at else 0.0)]
    column = min((wide - 1) // 2, wide - 2)
    loads = [{"element": f"c{column}r0", "force": [0.0, 1.0], "at": place}]
    if wide % 2 == 0:
        loads = [{**loads[0], "element": f"c{k}r0"} for k in (wide // 2 - 1, wide // 2)]
    document = {
        "grid": {"cell": [0.2, 0.2], "thickness": 0.1, "rows": rows},
        "materials": dry_and_inner(300, 0.6, 1000.0, 3000.0),
        "loads": {"live": loads},
        "labels": {"default": "inner"},
    }
    scene = parse_scene(document)
    joints = build_assembly(scene)
    cells = crack_cells(scene, joints, 0.1)
    middle = joints.interfaces.origin
    mirror = np.array([0.2 * wide, 0.0]) + middle * [-1.0, 1.0]
    image = np.linalg.norm(middle[:, None] - mirror[None], axis=2).argmin(axis=0)
    upright = np.flatnonzero(joints.free_faces & (abs(joints.interfaces.normal[:, 0]) > 0.5))
    for face in upright.tolist():
        factors = []
        for dry in (face, int(image[face])):
            labels = np.zeros(len(joints.interfaces), dtype=bool)
            labels[dry] = True
            factors.append(solve(cells.fine, cells.labels(labels)).load_factor)
        assert factors[0] == pytest.approx(factors[1], rel=1e-6)


def test_in_space_a_force_at_a_common_corner_of_cells_is_shared() -> None:
    document = {
        "elements": [box("ground", [0, 0, -1], [1, 1, 0], support=True), box("b", [0, 0, 0], [1, 1, 1])],
        "materials": dry_and_inner(1, 0.6, 1e3, 1e3),
        "loads": {"live": [{"element": "b", "force": [8.0, 0, 0], "moment": [0, 0, 0.8]}]},
    }
    refined = build_assembly(refine(parse_scene(document), (0.5,)).scene)
    assert refined.live[1:, :3] == pytest.approx(np.tile([1.0, 0.0, 0.0], (8, 1)), abs=1e-12)
    total = refined.live[:, 3:] + np.cross(refined.elements.centroid - 0.5, refined.live[:, :3])
    assert total.sum(axis=0) == pytest.approx([0.0, 0.0, 0.8], abs=1e-12)


# By cells, layouts under a load that only presses are locked, though their rays lie at the edges of joints.


WEAK, ROUGH = {"tensile_strength": 1e3, "shear_strength": 2e3}, {"friction_coefficient": 1.0}
STRONG = {"tensile_strength": 1e5, "shear_strength": 2e5}
LAYOUTS: list[tuple[list[str], str, list[float], dict[str, float], dict[str, float], str]] = [
    # rows, element and force, dry and inner material, labels of the joints
    (["abc", "###"], "c0r0", [0, -1e3], {"friction_coefficient": 0.0}, STRONG | ROUGH, "iiiid"),
    (
        ["abc", "###"],
        "c0r0",
        [0, -1e3],
        {"friction_coefficient": 0.6, "compressive_strength": 1e6},
        STRONG | ROUGH,
        "iidid",
    ),
    (
        ["abc", "###"],
        "c2r0",
        [0, -1e3],
        {"friction_coefficient": 1.2, "compressive_strength": 1e6},
        WEAK | ROUGH,
        "ddiii",
    ),
    (
        ["abc", "###"],
        "c1r0",
        [0, -1e3],
        {"friction_coefficient": 1.2, "compressive_strength": 1e5},
        STRONG | ROUGH,
        "iiiii",
    ),
]


def pressed(rows: list[str], element: str, force: list[float], dry: dict[str, float], inner: dict[str, float]) -> Any:
    """A wall of cells of 0.2 m, which crack along cells of 0.1 m."""
    return parse_scene(
        {
            "grid": {"cell": [0.2, 0.2], "thickness": 0.1, "rows": rows},
            "materials": {"density": 1800, "dry": dry, "inner": inner},
            "loads": {"live": [{"element": element, "force": force}]},
            "cracks": {"kind": "cells", "cell": 0.1},
        }
    )


@pytest.mark.parametrize(("rows", "element", "force", "dry", "inner", "labels"), LAYOUTS)
def test_pressed_layouts_are_locked(
    rows: list[str], element: str, force: list[float], dry: dict[str, float], inner: dict[str, float], labels: str
) -> None:
    scene = pressed(rows, element, force, dry, inner)
    joints = build_assembly(scene)
    cells = crack_cells(scene, joints, 0.1)
    result = solve(cells.fine, cells.labels(np.array([letter == "d" for letter in labels])))
    assert result.status == "locked"


@pytest.mark.parametrize("size", [0.2, 1.0, 0.7, 123.4])
def test_cells_of_a_grid_have_its_coordinates(size: float) -> None:
    """Corners of the cells lie where whole multiples of half a cell lie, to the last digits."""
    scene = pressed(["abc", "###"], "c0r0", [0, -1], {"friction_coefficient": 0.5}, WEAK)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["grid"]["cell"] = [size, size]
    scaled = parse_scene(document)
    cells = crack_cells(scaled, build_assembly(scaled), 0.5 * size)
    corners = np.concatenate(cells.fine.elements.shape) / (0.5 * size)
    assert abs(corners - np.round(corners)).max() <= 2e-15 * abs(corners).max()


# Cells aligned with the thrust: directions in closed form, a second route by resultants, and what is refused.


def mesh(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p, 2) of the unit square and triangles (t, 3), two in each of columns × rows boxes."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    k = np.arange((columns + 1) * rows).reshape(rows, columns + 1)[:, :-1].ravel()
    above = k + columns + 1
    lower, upper = np.column_stack([k, k + 1, above]), np.column_stack([k + 1, above + 1, above])
    return np.column_stack([x.ravel(), y.ravel()]), np.concatenate([lower, upper])


def uniaxial(direction: np.ndarray, size: float = -1e6) -> np.ndarray:
    """Stresses (t, 3) of one principal stress along directions (t, 2)."""
    c, s = direction.T
    return np.asarray(size * np.column_stack([c * c, s * s, c * s]))


def inner_edges(cells: list[shapely.Polygon], outline: shapely.Geometry) -> np.ndarray:
    """Edges (k, 2, 2) of cells away from the outline."""
    edges = [np.stack([r[:-1], r[1:]], axis=1) for r in (shapely.get_coordinates(one.exterior) for one in cells)]
    every = np.concatenate(edges)
    apart = shapely.distance(shapely.points(every.mean(axis=1)), outline)
    return np.asarray(every[(apart > 0.02) & (np.hypot(*(every[:, 1] - every[:, 0]).T) > 1e-6)])


@pytest.mark.parametrize(("turn", "scale"), [(0.0, 1.0), (0.6, 1.0), (2.5, 1e3)])
def test_a_strut_has_joints_across_its_axis(turn: float, scale: float) -> None:
    """A strut of 3 × 1 under axial stress is cut in 6 × 2 squares, in any position and size."""
    points, triangles = mesh(24, 8)
    c, s = np.cos(turn), np.sin(turn)
    frame = scale * np.array([[c, s], [-s, c]])
    axis = np.tile([c, s], (len(triangles), 1))
    field = tessellations.TriangleStresses((points * (3.0, 1.0)) @ frame + 7.0 * scale, triangles, uniaxial(axis))
    found = tessellations.aligned_cells(field, 0.5 * scale)
    assert len(found.cells) == 12
    assert found.deviation == pytest.approx(0.0, abs=1e-6)
    # cells reach beyond the outline by a thousandth of their side
    assert [one.area for one in found.cells] == pytest.approx([0.25 * scale**2] * 12, rel=5e-3)


def test_a_ring_has_radial_joints() -> None:
    """Compression along circles about a centre: joints are radial or tangential; chords and ends leave both by 4°."""
    points, triangles = mesh(60, 8)
    angle, radius = np.pi * (1.0 - points[:, 0]), 2.0 + 0.6 * points[:, 1]
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    middle = ring[triangles].mean(axis=1)
    away = middle / np.hypot(*middle.T)[:, None]
    field = tessellations.TriangleStresses(ring, triangles, uniaxial(np.column_stack([-away[:, 1], away[:, 0]])))
    found = tessellations.aligned_cells(field, 0.3)
    whole = shapely.union_all(shapely.polygons(ring[triangles]))
    assert shapely.union_all(found.cells).area == pytest.approx(whole.area, rel=5e-3)
    edges = inner_edges(found.cells, shapely.boundary(whole))
    along, place = edges[:, 1] - edges[:, 0], edges.mean(axis=1)
    cosine = np.abs(np.einsum("ed,ed->e", along, place)) / np.hypot(*along.T) / np.hypot(*place.T)
    assert np.minimum(np.arccos(np.minimum(cosine, 1.0)), np.arcsin(np.minimum(cosine, 1.0))).max() < np.radians(4.0)
    assert found.deviation < np.radians(1.5)
    assert 40 <= len(found.cells) <= 60


def test_without_a_direction_nothing_is_cut() -> None:
    """Hydrostatic stress has no direction."""
    points, triangles = mesh(4, 4)
    with pytest.raises(InputError, match="no direction"):
        tessellations.aligned_cells(
            tessellations.TriangleStresses(points, triangles, np.tile([-1.0, -1.0, 0.0], (len(triangles), 1))), 0.5
        )


def test_own_cells_are_planar_and_of_no_kind() -> None:
    """Own cells replace a kind, and do not go with voussoirs."""
    scene = parse_scene(
        {
            "elements": [{"id": "w", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]]}],
            "materials": {"density": 1.0, "inner": {"tensile_strength": 1.0, "shear_strength": 1.0}},
            "loads": {"live": [{"body": [1, 0]}]},
            "labels": {"default": "inner"},
        }
        | {
            "elements": [
                {"id": "w", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]]},
                {"id": "s", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
            ]
        }
    )
    halves = [shapely.box(-1, -1, 0.5, 2), shapely.box(0.5, -1, 3, 2)]
    refined = build_assembly(refine(scene, (1.0,), cells=halves).scene)
    assert refined.elements.volume[refined.elements.free] == pytest.approx([0.5, 1.5])
    with pytest.raises(InputError, match="cells"):
        refine(scene, (1.0,), kind="voronoi", cells=halves)
    with pytest.raises(InputError, match="voussoirs"):
        refine(scene, voussoirs=3, cells=halves)


def shear_share(field: tessellations.TriangleStresses, cells: list[shapely.Polygon]) -> float:
    """Sum of |V| over the sum of |N| of all inner edges of cells: resultants of the stresses, sampled along them."""
    triangles = shapely.polygons(field.points[field.triangles])
    tree, whole = shapely.STRtree(triangles), shapely.union_all(triangles)
    edges = inner_edges(cells, shapely.boundary(whole))
    shares = (np.arange(8) + 0.5) / 8
    points = edges[:, None, 0] + shares[:, None] * (edges[:, None, 1] - edges[:, None, 0])
    x, y, xy = field.stress[tree.nearest(shapely.points(points).ravel())].reshape(*points.shape[:2], 3).mean(axis=1).T
    along = edges[:, 1] - edges[:, 0]
    tangent = along / np.hypot(*along.T)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    force = np.column_stack([x * normal[:, 0] + xy * normal[:, 1], xy * normal[:, 0] + y * normal[:, 1]])
    force *= np.hypot(*along.T)[:, None]
    pressed, slid = (np.abs(np.einsum("ed,ed->e", force, one)).sum() for one in (normal, tangent))
    return float(slid / pressed)


def test_joints_are_normal_to_the_resultant_of_the_stresses(tmp_path: Path) -> None:
    """Second route: the stresses, integrated along joints, have less than half the shear of a grid, 0.15 of N.

    The thrust of a jack arch of 2 m under a load at its quarter is inclined. Fields can mesh its cells.
    """
    outline = tmp_path / "jack.csv"
    jack, seats = [(-1.0, 0.0), (1.0, 0.0), (1.2, 0.4), (-1.2, 0.4)], [(1.0, 0.0), (1.6, 0.0), (1.6, 0.4), (1.2, 0.4)]
    rows = [f"jack,{x},{y},stone" for x, y in jack]
    rows += [f"s{k},{side * x},{y},supports" for k, side in enumerate((-1.0, 1.0)) for x, y in seats]
    outline.write_text("id,x,y,layer\n" + "\n".join(rows) + "\n")
    options = DesignOptions(load="20 kN", places="0.25", thickness=0.3, friction=0.6)
    scene = read_outline(outline, options).scene
    field = tessellations.stresses_of_body(build_assembly(with_loads(scene, options)))
    found = tessellations.aligned_cells(field, 0.15)
    assert found.deviation < np.radians(3.0)
    grid = arrangement.squares(np.array([-1.2, 0.0]), np.array([1.2, 0.4]), (0.15, 0.15))
    share = shear_share(field, found.cells)
    assert share < 0.15
    assert share < 0.5 * shear_share(field, grid)
    problem.require_fields(
        build_assembly(with_loads(refine(scene, (0.15,), cells=found.cells, snap=0.25).scene, options))
    )


# Rigid blocks, cracked on demand, give the full model's λ and brackets (docs/method.md (7.2)).


def condensed(assembly: Assembly, labels: np.ndarray) -> LimitAnalysisResult | None:
    """The result by rigid blocks alone."""
    result = solve(assembly, labels, condense="on")
    return result if "rigid_blocks" in result.facts else None


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


@pytest.mark.sampled(3)
@pytest.mark.parametrize("strength", STRENGTHS)
def test_condensed_equals_full_on_random_segmentations(strength: float) -> None:
    """20 segmentations at each of four strengths, λ to 1e-7 and brackets as narrow as asked; a force off the middle."""
    live = [{"body": [1, 0]}, {"element": "c2r0", "force": [3, -1], "at": [0.27, 0.39]}]
    assembly = grid_assembly(["aaaa", "aaaa", "aaaa", "####"], tension=strength, shear=strength, live=live)
    analysis = LimitAnalysis(assembly)
    rng = np.random.default_rng(int(strength))
    exact = 0
    for _ in range(20):
        labels = random_segmentation(assembly, int(rng.integers(2, 7)), rng)
        full = analysis.solve(labels, stands=False)
        rigid = condensed(assembly, labels)
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
        full, rigid = analysis.solve(labels), condensed(assembly, labels)
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
