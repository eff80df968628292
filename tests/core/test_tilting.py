"""Tilting tables: angles in closed form, brackets where strengths are finite, every door, refusals."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from cases import box, grid_document
from cases import scene_in_space as scene
from command import Command, refused, saved
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_explore import ExploreSettings, explore

Document = dict[str, Any]


def block(wide: float, high: float, friction: float = 0.5, towards: float = 1.0, **dry: float) -> Document:
    """A block of weight 10 000 × area on the ground, that tilts."""
    corners = [[0, 0], [wide, 0], [wide, high], [0, high]]
    ground = {"id": "s", "polygon": [[-9, -1], [9, -1], [9, 0], [-9, 0]], "support": True}
    materials = {"density": 1000.0, "gravity": 10.0, "dry": {"friction_coefficient": friction, **dry}}
    loads = {"live": [{"tilt": {"towards": [3.0 * towards, 0]}}]}
    return {"elements": [ground, {"id": "a", "polygon": corners}], "materials": materials, "loads": loads}


def angle(found: Any) -> float:
    low, high = found.facts["tilt_bracket"]
    assert low <= found.facts["tilt_angle"] <= high <= low + 1e-4
    return math.radians(low)


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_friction_alone(towards: float) -> None:
    """A block slides at arctan μ and rocks at arctan b/h, and λ is the tangent."""
    for document, expected in ((block(1, 0.5, towards=towards), 0.5), (block(1, 4, towards=towards), 0.25)):
        found = solve(document)
        assert found.load_factor == pytest.approx(expected, rel=1e-9)
        assert angle(found) == pytest.approx(math.atan(expected), rel=1e-9)


@pytest.mark.parametrize("cohesion", [500.0, 4000.0, 9000.0])
def test_sliding_with_cohesion(cohesion: float) -> None:
    """W sin θ = μ W cos θ + c A: below the angle whose tangent is λ = μ + c A/W, and found from the table alone."""
    share, rocks = cohesion / 5000.0, 8.0
    slides = brentq(lambda x: math.sin(x) - 0.5 * math.cos(x) - share, 0.0, 2.0) if share < 1.0 else math.inf
    expected, found = min(slides, math.atan(rocks)), solve(block(4.0, 0.5, cohesion=cohesion))
    assert found.load_factor == pytest.approx(min(0.5 + share, rocks), rel=1e-9)
    assert expected >= math.atan(found.load_factor) * (1 - 1e-9)
    assert angle(found) == pytest.approx(expected, rel=1e-8)


def test_a_bond_at_the_apex_of_friction_is_no_cone() -> None:
    """c = μ σt: W sin θ = μ (W cos θ + σt A), although rows moved to the apex have no strength."""
    bond = 0.2 * 5000.0
    found = solve(block(4.0, 0.5, cohesion=0.5 * bond, tensile_strength=bond))
    expected = brentq(lambda x: math.sin(x) - 0.5 * (math.cos(x) + 0.2), 0.0, 1.5)
    assert angle(found) == pytest.approx(expected, rel=1e-8)


def test_opening_of_an_inner_face() -> None:
    """A glued block opens where W sin θ h/2 = (σt A + W cos θ) l/6."""
    document = grid_document(["a", "#"], tension=2e3, shear=1e6, live=[{"tilt": {"towards": [-1, 0]}}])
    weight = 1400 * 9.81 * 1e-3
    expected = brentq(lambda x: weight * math.sin(x) / 2 - (2e3 * 0.01 + weight * math.cos(x)) / 6, 0.0, 1.5)
    assert angle(solve(document, "i")) == pytest.approx(expected, rel=1e-8)


def test_load_cases_in_space() -> None:
    """Each case has its angle; the pivot line is a record."""
    document = scene([box("s", [-9, -9, -1], [9, 9, 0], support=True), box("a", [-1, -0.5, 0], [1, 0.5, 4])])
    pivot = [[-9, -9, 0], [-9, 9, 0]]
    cases = [
        {"name": "long", "live": [{"tilt": {"towards": [1, 0, 0], "pivot": pivot}}]},
        {"name": "short", "live": [{"tilt": {"towards": [0, -2, 0]}}]},
    ]
    document["loads"] = {"cases": cases}
    found = solve(document)
    assert "tilt_angle" not in found.facts
    told = {name: angle(one) for name, one in found.cases.items()}
    assert told == pytest.approx({"long": math.atan(0.5), "short": math.atan(0.25)}, rel=1e-9)


def test_a_bracket_holds_what_tables_show() -> None:
    """A structure of both labels, whose weights are turned by hand: it stands below the bracket and falls above."""
    document = grid_document(["abcd", "ab.d", "#..#"], tension=2e3, shear=3e3, live=[{"tilt": {"towards": [1, 0]}}])
    assembly = build_assembly(document)
    rng = np.random.default_rng(3)
    for labels in rng.random((6, len(assembly.interfaces))) < 0.3:
        found = solve(assembly, labels)
        if found.facts["tilt_bracket"] == [None, None]:
            continue
        low = angle(found)
        for theta, stands in ((low * (1 - 1e-6), True), (low * (1 + 1e-5), False)):
            turned = deepcopy(document)
            turned["materials"]["gravity"] = [9.81 * math.sin(theta), -9.81 * math.cos(theta)]
            turned["loads"] = {"live": [{"body": [0.0, -1.0]}]}
            assert solve(turned, labels).stands_at_zero is stands


PORTAL = grid_document(["ab", "cd", "##"], tension=2e3, shear=3e3, live=[{"tilt": {"towards": [1, 0]}}])


def test_searches_and_commands(jld: Command, tmp_path: Path) -> None:
    """λ and angle do not name the same layout: the objective finds the one that tilts furthest."""
    settings = ExploreSettings(check_fields=0, pictures=False, driver="enumeration")
    done = explore(PORTAL, tmp_path / "out", settings)
    columns = ["tilt_angle", "tilt_lo", "tilt_hi"]
    best = done.results.iloc[:10]
    assert best[columns].notna().all(axis=None)
    assert done.results[columns].isna().any(axis=None)
    facts = done.summary.facts
    assert facts["tilt_angle"] == pytest.approx(done.results["tilt_angle"].max(), rel=1e-9)
    low, high = facts["tilt_bracket"]
    assert facts["tilt_bound"] == pytest.approx(high, abs=1e-3)
    furthest = explore(PORTAL, settings=settings, objective="tilt_angle")
    assert low - 1e-9 <= furthest.summary.best <= high
    assert math.degrees(angle(solve(PORTAL, furthest.results["labelling"].iloc[0]))) == furthest.summary.best
    path = saved(tmp_path / "scene.json", PORTAL)
    told = json.loads(jld("solve", path, "--json").out)
    assert told["tilt_bracket"][0] <= told["tilt_angle"] <= told["tilt_bracket"][1]
    assert f"{told['tilt_angle']:.6g}" in jld("solve", path).out
    by_fields = json.loads(jld("solve", path, "--json", "--cracks", "fields:0.9").out)
    assert by_fields["tilt_bracket"][1] is None
    assert 0.0 <= by_fields["tilt_angle"] <= told["tilt_bracket"][1]


def furthest_of(document: Document, **settings: Any) -> dict[str, Any]:
    """What a search says of the layout that tilts furthest."""
    plain = ExploreSettings(check_fields=0, pictures=False)
    facts: dict[str, Any] = explore(document, settings=plain, **settings).summary.facts
    return facts


@pytest.mark.parametrize(
    "more",
    [
        {"search": {"void": {"most": 0.3}}},
        {"search": {"require": {"load_factor": 9.0}}},
        {"search": {"front": {"counts": ["blocks", "shapes"]}}},
        {"search": {"assemble": "standing"}},
        {"cracks": {"kind": "cells", "cell": 0.05}},
        {"cracks": {"kind": "fields", "gap": 0.9}},
    ],
    ids=str,
)
def test_a_tilted_search_beside_other_keys(more: Document) -> None:
    """The furthest is that of the plain search, of which no proof needs a driver that refuses the key."""
    facts = furthest_of({**PORTAL, **more})
    if "fields" in str(more):
        assert "tilt_angle" not in facts
        return
    assert facts["tilt_angle"] == pytest.approx(math.degrees(math.atan(0.75)), rel=1e-8)
    assert (facts["tilt_bound"] is None) is ("assemble" in str(more))


def test_low_values_tilt_and_are_proven_as_low_values() -> None:
    document = deepcopy(PORTAL)
    document["materials"]["dry"]["friction_coefficient"] = {"nominal": 0.75, "low": 0.3}
    facts = furthest_of(document, robust=True)
    assert facts["tilt_angle"] == pytest.approx(math.degrees(math.atan(0.3)), rel=1e-8)
    assert facts["tilt_bound"] == pytest.approx(facts["tilt_angle"], abs=1e-3)


def test_a_locked_layout_tilts_further() -> None:
    """A block that a wall holds back slides up its neighbour where their face shears; dry, it never does."""
    corners = {
        "g": [[-3, -1], [4, -1], [4, 0], [-3, 0]],
        "w": [[2, 0], [3, 0], [3, 2], [2, 2]],
        "a": [[0, 0], [0.9, 0], [1.3, 1], [0, 1]],
        "b": [[0.9, 0], [2, 0], [2, 1], [1.3, 1]],
    }
    inner = {"tensile_strength": 1e3, "shear_strength": 1e3}
    document = {
        "elements": [{"id": name, "polygon": at, "support": name in "gw"} for name, at in corners.items()],
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.7}, "inner": inner},
        "loads": {"live": [{"tilt": {"towards": [1, 0]}}]},
    }
    for settings in ({}, {"objective": "tilt_angle"}):
        facts = furthest_of(document, **settings)
        assert facts["tilt_labelling"].count("i") == 0
        assert facts["tilt_angle"] > 100.0


BAD: dict[str, tuple[Document, str]] = {
    "up": ({"live": [{"tilt": {"towards": [1, 1]}}]}, r"live\[0\].tilt.towards: it is not horizontal"),
    "in space": ({"live": [{"tilt": {"towards": [1, 0, 0]}}]}, "it has 3 numbers; expected 2"),
    "zero": ({"live": [{"tilt": {"towards": [0, 0]}}]}, "towards: it is zero"),
    "beside": ({"live": [{"tilt": {"towards": [1, 0]}}, {"body": [1, 0]}]}, "beside other live loads"),
    "dead": (
        {"dead": [{"body": [0, -1]}], "live": [{"tilt": {"towards": [1, 0]}}]},
        "a tilt turns weights alone, and there are dead loads",
    ),
    "as dead": ({"dead": [{"tilt": {"towards": [1, 0]}}], "live": [{"body": [1, 0]}]}, r"dead\[0\].tilt: unknown key"),
    "pivot": ({"live": [{"tilt": {"towards": [1, 0], "pivot": [[0, 0], [1, 1]]}}]}, "pivot: it has 2 points"),
    "no direction": ({"live": [{"tilt": {}}]}, r"live\[0\].tilt.towards: missing; expected a horizontal direction"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_tilt_is_one_line(case: str) -> None:
    loads, message = BAD[case]
    with refused(match=message):
        build_assembly(parse_scene({**block(1, 1), "loads": loads}))


def test_what_does_not_turn_is_refused() -> None:
    filled = {**block(1, 1), "fill": {"level": 2.0, "density": 1800.0, "friction_angle": 30.0}}
    with pytest.raises(InputError, match="fill: it has forces that do not turn on a tilting table"):
        parse_scene(filled)
    with pytest.raises(InputError, match="nothing is tilted"):
        explore(grid_document(["ab", "##"]), objective="tilt_angle")


def test_files_hold_a_tilt_as_a_body_load(jld: Command, tmp_path: Path) -> None:
    """A file of another program knows no table: its load is that at λ = 1, along the direction."""
    document, written = grid_document(["ab", "##"]), []
    del document["materials"]["inner"]
    for name, entry in (("tilt", {"tilt": {"towards": [-2, 0]}}), ("body", {"body": [-1, 0]})):
        document["loads"]["live"] = [entry]
        path = saved(tmp_path / f"{name}.json", document)
        assert jld("export", path, "--format", "compas", "-o", tmp_path / f"{name}.out").code == 0
        written.append((tmp_path / f"{name}.out").read_text(encoding="utf-8"))
    assert written[0] == written[1]
