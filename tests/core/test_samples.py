"""Samples by name: their geometry against sums over their parts, their λ against closed forms."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from cases import ROUTE
from command import Command
from jld_core import InputError, Status, build_assembly, load_scene, samples, solve
from jld_core.refinement import bonds


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
