"""Samples by name: their geometry against sums over their parts, their λ against closed forms."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from cases import ROUTE, dry_and_inner
from command import Command
from jld_core import InputError, Scene, Status, build_assembly, load_scene, parse_scene, samples, solve
from jld_core.refinement import refine
from jld_masonry import bonds
from jld_masonry import voussoirs as voussoirs_of_refinement


@pytest.mark.parametrize("kind", samples.KINDS)
def test_every_sample_stands_on_its_supports_and_is_written_as_it_is_made(
    kind: str, tmp_path: Path, jld: Command
) -> None:
    """`jld new` and Python give the same scene, and every face between free elements may be searched."""
    target = tmp_path / "scene.json"
    done = jld("new", kind, "--friction", "0.7", "--most", "0", "-o", target)
    assert (done.code, done.err) == (0, "")
    made = samples.KINDS[kind](stone=samples.Stone(friction=0.7))
    assert load_scene(target).fingerprint == made.fingerprint
    assert jld("new", kind, "-o", target).code == 0
    assert load_scene(target).search.block_cells == [1, 4]
    assembly = build_assembly(made)
    assert solve(assembly).status is not Status.UNCERTIFIED
    assert assembly.strengths(ROUTE).friction == pytest.approx(0.7)


def test_an_arch_stands_from_the_thickness_of_couplet_and_heyman_on() -> None:
    """t/R = 0.1075 for a semicircle (Heyman; Cocchetti & Rizzi 2020, table 1); chords of 60 parts, no sliding."""
    stone = samples.Stone(friction=2.0)
    for thickness, stands in ((0.111, True), (0.104, False)):
        scene = samples.arch(thickness=thickness, voussoirs=60, stone=stone)
        assert solve(build_assembly(scene)).stands_at_zero is stands


def test_a_grid_of_one_column_tips_at_width_over_height() -> None:
    """One dry pile under a body load: λ = min(μ, b/h)."""
    for rows, friction in ((4, 0.6), (1, 0.6)):
        scene = samples.grid(columns=1, rows=rows, stone=samples.Stone(friction=friction))
        found = solve(build_assembly(scene), np.ones(rows, dtype=bool))
        assert found.load_factor == pytest.approx(min(friction, 1.0 / rows), rel=1e-9)


def test_a_wedge_of_a_flat_arch_is_cut_towards_the_focus() -> None:
    """Every joint's line meets x = 0 at the focus below the soffit."""
    assembly = build_assembly(samples.flat_arch(span=2.0, height=0.4, voussoirs=5, focus=1.2))
    for polygon in assembly.interfaces.polygon:
        (x0, y0), (x1, y1) = polygon
        assert x0 * (y1 + 1.2) == pytest.approx(x1 * (y0 + 1.2), abs=1e-12)


@pytest.mark.parametrize("bond", ["stack", "running"])
def test_volumes_of_shells_are_those_of_their_facets(bond: str) -> None:
    """Sum of cells = prism or frusta between chords: sectors of n chords have ½ r² n sin(2π/n)."""
    fine = 2 if bond == "running" else 1
    barrel = build_assembly(samples.vault(radius=1.5, thickness=0.3, length=2.0, voussoirs=6, courses=3, bond=bond))
    angle = math.pi / (6 * fine)
    expected = 0.5 * (1.65**2 - 1.35**2) * 6 * fine * math.sin(angle) * 2.0
    assert barrel.elements.volume[barrel.elements.free].sum() == pytest.approx(expected, rel=1e-12)
    whole = build_assembly(samples.dome(meridians=8, parallels=4, bond=bond))
    turn = 2.0 * math.pi / (8 * fine)
    heights = np.radians(np.linspace(0.0, 65.0, 5))

    def frusta(radius: float) -> float:
        """Pyramid frusta between parallels, of n-gons with circumradius r cos φ."""
        area = [0.5 * 8 * fine * math.sin(turn) * (radius * math.cos(h)) ** 2 for h in heights]
        rise = np.diff(radius * np.sin(heights))
        return sum(d / 3.0 * (a + b + math.sqrt(a * b)) for d, a, b in zip(rise, area, area[1:], strict=False))

    def cone(radius_in: float, radius_out: float) -> float:
        """What lies between the radial beds: the frustum on the outer bed ring less the one on the inner."""
        return frusta(radius_out) - frusta(radius_in)

    # beds are cones through the centre, so slabs between horizontal planes differ by the cones below and above
    def below(height: float, inner: float, outer: float) -> float:
        base = 0.5 * 8 * fine * math.sin(turn) * math.cos(height) ** 2
        return base * math.sin(height) / 3.0 * (outer**3 - inner**3)

    inner, outer = 1.375, 1.625
    expected = cone(inner, outer) + below(heights[0], inner, outer) - below(heights[-1], inner, outer)
    assert whole.elements.volume[whole.elements.free].sum() == pytest.approx(expected, rel=1e-9)


def test_cells_of_a_cross_vault_meet_along_groins_and_ridges() -> None:
    """8 half webs of r × c cells: beds r·c (the lowest to supports), slices r·(c − 1), groins 4·r, ridges 4·c."""
    r, c = 3, 2
    assembly = build_assembly(samples.vault("cross", voussoirs=2 * r, courses=c, length=0.5, springing=15.0))
    assert int((~assembly.elements.support).sum()) == 8 * r * c
    assert len(assembly.interfaces) == 8 * (r * c + r * (c - 1)) + 4 * r + 4 * c
    normal = assembly.interfaces.normal
    groins = np.isclose(np.abs(normal[:, 0]), np.abs(normal[:, 1])) & np.isclose(normal[:, 2], 0.0)
    assert int(groins.sum()) == 4 * r


def test_bonds_break_joint() -> None:
    """Where the joints of two courses stand, by bond, in stretchers; a stack bond is the one that breaks none."""
    rows = {bond: [bonds.course(bond, k, 6.0, 1.0) for k in (0, 1, 2)] for bond in bonds.BONDS}
    assert rows["running"][1].tolist() == [0.0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.0]
    assert np.diff(rows["english"][1])[1:-1].tolist() == pytest.approx([0.5] * 11)
    assert np.diff(rows["flemish"][0])[:4].tolist() == pytest.approx([1.0, 0.5, 1.0, 0.5])
    middle = [0.5 * (a + b) for a, b in zip(rows["flemish"][1], rows["flemish"][1][1:], strict=False) if b - a == 0.5]
    for header in middle[1:-1]:  # over the middle of a stretcher
        assert min(abs(header - (0.5 + 1.5 * k)) for k in range(4)) == pytest.approx(0.0, abs=1e-12)
    for bond, (low, high, _) in rows.items():
        shared = set(np.round(low[1:-1], 9)) & set(np.round(high[1:-1], 9))
        assert bool(shared) is (bond == "stack"), bond


def test_an_opening_has_a_lintel_that_bears_on_both_sides() -> None:
    scene = samples.wall(opening="1.0,0.4,0.6,0.4", bearing=0.2)
    (lintel,) = [element for element in scene.elements or [] if element.id == "lintel"]
    xs = np.array(lintel.polygon)[:, 0]
    assert (xs.min(), xs.max()) == pytest.approx((0.8, 1.8))
    assembly = build_assembly(scene)
    area = assembly.elements.volume[assembly.elements.free].sum() / 0.2
    assert area == pytest.approx(2.4 * 1.2 - 0.6 * 0.4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["arch", "--radius", "-1"], ["--radius", "above 0"]),
        (["arch", "--embrace", "400"], ["--embrace", "360"]),
        (["arch", "--bond", "flemish"], ["--bond", "stack, running"]),
        (["wall", "--bond", "dutch"], ["--bond", "flemish"]),
        (["wall", "--opening", "1,2"], ["--opening", "x,y,width,height"]),
        (["wall", "--opening", "1,0,9,0.2"], ["--opening", "inside the wall"]),
        (["wall", "--length", "1e12"], ["elements", "at most"]),
        (["vault", "--kind", "cross", "--voussoirs", "5"], ["--voussoirs", "even"]),
        (["dome", "--oculus", "95"], ["--oculus", "between"]),
        (["grid", "--load", "wind"], ["--load", "push, crown, quarter"]),
        (["grid", "--density", "-3"], ["density", "at least 0"]),
        (["arch", "--voussoirs", "1.5"], ["--voussoirs", "whole number"]),
    ],
)
def test_bad_parameters(
    arguments: list[str], words: list[str], tmp_path: Path, jld: Command) -> None:  # fmt: skip
    target = tmp_path / "scene.json"
    done = jld("new", *arguments, "-o", target)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert all(word in done.err for word in words), done.err
    assert not target.exists()


def test_parameters_in_python_are_refused_alike() -> None:
    with pytest.raises(InputError, match="thickness: "):
        samples.arch(thickness=5.0)
    assert json.loads(samples.grid(rows=1).model_dump_json())["name"] == "grid of 8 × 1 cells"


@pytest.mark.parametrize("voussoirs", [3, 7, 10, 12])
def test_a_crown_load_stands_on_the_outline_whatever_the_sizes(voussoirs: int) -> None:
    """The load hangs from the extrados above the middle: a corner of an even number of chords, or a chord's middle."""
    for radius, thickness, embrace in itertools.product((0.5, 1.0, 3.0, 7.3), (0.1, 0.3), (60.0, 90.0, 120.0, 180.0)):
        scene = samples.arch(radius, thickness, embrace, voussoirs, load="crown")
        outer, half = radius + 0.5 * thickness, math.radians(0.5 * embrace / voussoirs)
        expected = outer if voussoirs % 2 == 0 else outer * math.cos(half)
        assert scene.loads.live[0].at == pytest.approx([0.0, expected], abs=1e-12 * radius)


# Voussoirs from an outline's own arcs: centres and springings are found, area, masses and λ are kept.


MATERIALS = dry_and_inner(2000.0, 0.6, 3e5, 5e5)


def arc(centre: tuple[float, float], radius: float, start: float, end: float, chords: int) -> np.ndarray:
    """Corners of an arc, angles in degrees."""
    angles = np.radians(np.linspace(start, end, chords + 1))
    return np.asarray((np.array(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])).round(12))


def wall(chords: int = 24, rise: float = 0.0) -> np.ndarray:
    """Outline of a wall of 2 × 1.2 m over a semicircular opening of radius 0.7 m, on jambs."""
    jamb = [[1.7, 0.0]] if rise else []
    left = [[0.3, 0.0]] if rise else []
    opening = arc((1.0, rise), 0.7, 180.0, 0.0, chords).tolist()
    return np.array([[0.0, 0.0], *left, *opening, *jamb, [2.0, 0.0], [2.0, 1.2 + rise], [0.0, 1.2 + rise]])


def box(x: float, y: float, width: float, height: float) -> list[list[float]]:
    """Corners of a rectangle."""
    return [[x, y], [x + width, y], [x + width, y + height], [x, y + height]]


def scene(outline: np.ndarray, supports: list[Any], turn: float = 0.0, scale: float = 1.0) -> Scene:
    """Scene of one outline with supports, turned with its gravity and scaled."""
    c, s = np.cos(turn), np.sin(turn)
    frame = scale * np.array([[c, s], [-s, c]])
    elements: list[dict[str, Any]] = [{"id": "w", "polygon": (np.asarray(outline) @ frame).tolist()}]
    for k, support in enumerate(supports):
        elements.append({"id": f"s{k}", "polygon": (np.array(support) @ frame).tolist(), "support": True})
    gravity = (9.81 * np.array([0.0, -1.0]) @ frame / scale).tolist()
    push = (np.array([1.0, 0.0]) @ frame / scale).tolist()
    document = {
        "elements": elements,
        "thickness": 0.3,
        "materials": {**MATERIALS, "gravity": gravity},
        "loads": {"live": [{"body": push}]},
    }
    return parse_scene(document)


FEET = [box(0.0, -0.1, 0.3, 0.1), box(1.7, -0.1, 0.3, 0.1)]
RING = np.concatenate([arc((0.0, 0.0), 1.1, 180.0, 0.0, 12)[::-1], arc((0.0, 0.0), 0.9, 180.0, 0.0, 12)])


@pytest.mark.parametrize("turn", [0.0, 0.7, 3.0])
def test_arcs_are_found_in_any_position_and_size(turn: float) -> None:
    """Centre and radius of the opening come back to 1e-9 of the size; straight and stepped outlines have no arc."""
    c, s = np.cos(turn), np.sin(turn)
    frame = 1e3 * np.array([[c, s], [-s, c]])
    outline = wall(rise=0.5) @ frame + 5e3
    (found,) = voussoirs_of_refinement.find_arcs(outline)
    assert found.hollow
    assert found.centre == pytest.approx(np.array([1.0, 0.5]) @ frame + 5e3, rel=1e-9)
    assert found.radius == pytest.approx(700.0, rel=1e-9)
    assert found.sweep == pytest.approx(np.pi, rel=1e-9)
    for shift in range(0, len(outline), 5):
        again = voussoirs_of_refinement.find_arcs(np.roll(outline, shift, axis=0))
        assert [one.radius for one in again] == pytest.approx([700.0])
    for plain in (box(0, 0, 1, 2), arc((0.0, 0.0), 1.0, 0.0, 300.0, 5).tolist()):
        assert voussoirs_of_refinement.find_arcs(np.array(plain, dtype=float)) == []


@pytest.mark.parametrize(
    ("outline", "supports", "voussoirs", "rings", "cells"),
    [
        (RING, [box(-1.2, -0.1, 0.4, 0.1), box(0.8, -0.1, 0.4, 0.1)], 9, 2, 18),
        (np.array([[-1, 0], [1, 0], [1.3, 0.4], [-1.3, 0.4]]), [box(-1.0, -0.1, 2.0, 0.1)], 7, 2, 14),
        (wall(), FEET, 11, 2, None),
        (wall(chords=15, rise=0.4), FEET, 9, 1, None),
    ],
    ids=["ring", "flat", "wall", "jambs"],
)
def test_voussoirs_keep_area_and_share_corners(
    outline: np.ndarray, supports: list[Any], voussoirs: int, rings: int, cells: int | None
) -> None:
    """Area is kept to 1e-12, no corner moves to meet another, and turned, scaled scenes have the same cells."""
    found = []
    for turn, scale in ((0.0, 1.0), (0.4, 1e-3)):
        old = build_assembly(scene(outline, supports, turn, scale))
        new = build_assembly(refine(scene(outline, supports, turn, scale), voussoirs=voussoirs, rings=rings).scene)
        free = ~new.elements.support
        assert new.elements.volume[free].sum() == pytest.approx(
            old.elements.volume[~old.elements.support].sum(), rel=1e-12
        )
        assert new.elements.weight.sum(axis=0) == pytest.approx(old.elements.weight.sum(axis=0), rel=1e-9)
        assert new.moved == 0.0
        corners = np.unique(np.concatenate(new.elements.shape), axis=0)
        apart = np.sqrt(((corners[:, None] - corners[None]) ** 2).sum(axis=2)) + np.eye(len(corners)) * scale
        assert apart.min() > 1e-6 * scale
        found.append((len(new.elements), np.sort(new.elements.volume[free]) / scale**2))
        assert cells in (None, int(free.sum()))
    assert found[0][0] == found[1][0]
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-9)


def test_a_ring_in_voussoirs_is_the_arch_of_voussoirs() -> None:
    """A drawn ring of 12 chords in 12 voussoirs has the λ of the sample arch, another route to the same joints."""
    sample = samples.arch(radius=1.0, thickness=0.2, voussoirs=12, depth=0.3)
    document = sample.model_dump(mode="json", exclude_defaults=True)
    supports = [one for one in document["elements"] if one.get("support")]
    document["elements"] = [{"id": "ring", "polygon": RING.tolist()}, *supports]
    ring = refine(parse_scene(document), voussoirs=12)
    ours, theirs = build_assembly(ring.scene), build_assembly(sample)
    assert len(ours.interfaces) == len(theirs.interfaces)
    dry = [np.ones(len(one.interfaces), dtype=bool) for one in (ours, theirs)]
    assert solve(ours, dry[0]).load_factor == pytest.approx(solve(theirs, dry[1]).load_factor, rel=1e-8)


def test_a_flat_arch_converges_where_its_sides_meet() -> None:
    """The trapezoid of the sample flat arch, cut again, has its wedges; `centre` says the same."""
    sample = build_assembly(samples.flat_arch(voussoirs=5, focus=1.5))
    outline = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0 * 1.9 / 1.5, 0.4], [-1.0 * 1.9 / 1.5, 0.4]])
    own = scene(outline, [box(-1.0, -0.1, 2.0, 0.1)])
    for how in ({}, {"centre": (0.0, -1.5)}):
        new = build_assembly(refine(own, voussoirs=5, **how).scene)
        expected = np.sort(sample.elements.volume[~sample.elements.support])
        assert np.sort(new.elements.volume[~new.elements.support]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("skew", [20.0, 45.0])
def test_the_skew_of_a_flat_arch_is_that_of_its_outer_joints(skew: float) -> None:
    """A lintel of 2 × 0.4 m: the outer joints leave the soffit's ends at the angle, the middle stone is upright."""
    own = scene(np.array(box(-1.0, 0.0, 2.0, 0.4)), [box(-1.0, -0.1, 2.0, 0.1)])
    elements = build_assembly(refine(own, voussoirs=3, skew=skew).scene).elements
    assert elements.volume[elements.free].sum() == pytest.approx(2.0 * 0.4 * 0.3, rel=1e-9)
    # joints from x = ±1/3 of the soffit meet the outer ones at half of the span over tan θ below it
    below = 1.0 / np.tan(np.radians(skew))
    top = (below + 0.4) / below / 3.0
    corners = np.concatenate([elements.shape[k] for k in elements.free])
    assert np.hypot(*(corners - [top, 0.4]).T).min() < 1e-9
    assert np.hypot(*(corners - [1.0 / 3.0, 0.0]).T).min() < 1e-9


def test_a_vault_is_cut_by_voussoirs_and_courses() -> None:
    """Volume is kept to 1e-9; every second voussoir of running courses is cut at its middle."""
    ring = RING.tolist()

    def prism(outline: list[list[float]]) -> dict[str, Any]:
        n = len(outline)
        vertices = [[x, y, z] for y in (0.0, 2.0) for x, z in outline]
        sides = [[i, n + i, n + (i + 1) % n, (i + 1) % n] for i in range(n)]
        return {"vertices": vertices, "faces": [list(range(n)), list(range(n, 2 * n))[::-1], *sides]}

    document = {
        "elements": [
            {"id": "vault", **prism(ring)},
            *({"id": f"s{x}", **prism(box(x, -0.1, 0.4, 0.1)), "support": True} for x in (-1.2, 0.8)),
        ],
        "materials": MATERIALS,
        "loads": {"live": [{"body": [1.0, 0.0, 0.0]}]},
    }
    vault = parse_scene(document)
    old = build_assembly(vault)
    for bond, count in (("stack", 6 * 2), ("running", 6 * 2 + 3)):
        new = build_assembly(refine(vault, voussoirs=6, courses=2, bond=bond).scene)
        free = ~new.elements.support
        assert int(free.sum()) == count
        assert new.elements.volume[free].sum() == pytest.approx(old.elements.volume[0], rel=1e-9)


def test_a_frustum_is_refused_as_a_prism() -> None:
    """A solid whose two caps differ has no profile, and is refused by its name."""
    vertices = [[x, y, z] for z, r in ((0.0, 1.0), (1.0, 0.5)) for x, y in ((-r, -r), (r, -r), (r, r), (-r, r))]
    sides = [[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    faces = [[3, 2, 1, 0], [4, 5, 6, 7], *sides]
    below = [[x, y, z - 1.0] for x, y, z in vertices[:4]] + vertices[:4]
    elements = [
        {"id": "w", "vertices": vertices, "faces": faces},
        {"id": "s", "vertices": below, "faces": faces, "support": True},
    ]
    loads = {"live": [{"body": [1.0, 0.0, 0.0]}]}
    with pytest.raises(InputError, match="'w': it is no prism"):
        refine(parse_scene({"elements": elements, "materials": MATERIALS, "loads": loads}), voussoirs=3)


def test_courses_of_a_bond_shift_their_head_joints() -> None:
    """A wall of four courses in running bond: 4 + 5 + 4 + 5 stones, the half ones at the ends of odd courses."""
    new = refine(scene(np.array(box(0.0, 0.0, 1.6, 0.8)), [box(0.0, -0.1, 1.6, 0.1)]), (0.4, 0.2), kind="bond")
    elements = build_assembly(new.scene).elements
    volume = np.round(elements.volume[~elements.support] / (0.08 * 0.3), 9)
    assert len(volume) == 18
    assert (volume == 0.5).sum() == 4


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ([], "--cell: missing"),
        (["--voussoirs", "0"], "--voussoirs"),
        (["--voussoirs", "3", "--cell", "0.1"], "it does not go with --cell or --kind"),
        (["--cell", "0.1", "--rings", "2"], "it goes with --voussoirs only"),
        (["--voussoirs", "3", "--courses", "2"], "the scene is planar"),
        (["--voussoirs", "3", "--bond", "english"], "no bond of voussoirs"),
        (["--voussoirs", "3"], "the outline has no arc"),
        (["--voussoirs", "3", "--skew", "90"], "--skew: 90 is no inclination"),
        (["--cell", "0.1", "--skew", "20"], "--skew: it is that of a flat arch"),
        (["--cell", "0.4,0.2", "--kind", "bond", "--bond", "herring"], "no bond is named"),
    ],
)
def test_bad_voussoirs_are_one_line(jld: Command, tmp_path: Path, flags: list[str], words: str) -> None:
    """Every wrong flag is one line with exit code 2, and nothing is written."""
    plain = scene(np.array(box(0.0, 0.0, 1.6, 0.8)), [box(0.0, -0.1, 1.6, 0.1)])
    (tmp_path / "wall.json").write_text(json.dumps(plain.model_dump(mode="json", exclude_defaults=True)))
    jld("refine", tmp_path / "wall.json", *flags, "-o", tmp_path / "out.json").refused(words)
    assert not (tmp_path / "out.json").exists()


@pytest.mark.parametrize(
    "how", [{"voussoirs": 11, "rings": 2}, {"cell": (0.3, 0.2), "kind": "bond"}, {"cell": (0.2,), "kind": "voronoi"}]
)
def test_snapped_corners_keep_the_outline_and_leave_fewer_short_edges(how: dict[str, Any]) -> None:
    """Area, and boundary of the union, stay; no edge that ends at a moved corner is shorter than before."""
    whole = scene(wall(), [box(-0.1, -0.1, 0.5, 0.1), box(1.6, -0.1, 0.5, 0.1)])
    shortest = []
    for snap in (0.0, 0.25):
        assembly = build_assembly(refine(whole, snap=snap, **how).scene)
        free = assembly.elements.free
        shapes = [shapely.Polygon(assembly.elements.shape[k]) for k in free]
        assert sum(shape.area for shape in shapes) == pytest.approx(2.4 - whole_opening(), rel=1e-9)
        union = shapely.union_all(shapes, grid_size=1e-9)
        assert union.hausdorff_distance(shapely.Polygon(wall())) < 1e-6
        assert all(shape.is_valid for shape in shapes)
        lengths = np.concatenate([np.hypot(*np.diff(np.vstack([s, s[:1]]), axis=0).T) for s in map(corners, shapes)])
        shortest.append(int((lengths < 0.02).sum()))
    assert shortest[1] < shortest[0]


def whole_opening() -> float:
    """Area of the opening of `wall`, a polygon of 24 chords."""
    return 0.5 * 24 * 0.7**2 * float(np.sin(np.pi / 24))


def corners(shape: shapely.Polygon) -> np.ndarray:
    """Corners of a polygon, each once."""
    return np.asarray(shape.exterior.coords)[:-1]


@pytest.mark.parametrize("snap", [-0.1, 0.5, float("nan")])
def test_a_wrong_snap_is_one_line(snap: float) -> None:
    """Shares of a cell outside 0 to 0.4 are refused."""
    with pytest.raises(InputError, match=r"snap: .* is wrong"):
        refine(scene(wall(), []), (0.2,), snap=snap)
