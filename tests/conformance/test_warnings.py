"""What is possible and hardly meant: one sentence each, an error with --strict, and nothing where units are others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import assembly_in_space as spatial_assembly
from cases import box, dry_and_inner, grid_document
from command import SCENES, Command, refused, saved
from jld_core import build_assembly, load_scene, parse_scene
from jld_core.views import facts


def with_(path: str, value: object) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(json.dumps(grid_document(["aa", "ab", "##"])))
    target = document
    *keys, last = path.split(".")
    for key in keys:
        target = target[key]
    if path == "materials.dry.friction_angle":
        target.pop("friction_coefficient", None)
    if path == "materials.dry.friction_coefficient":
        target.pop("friction_angle", None)
    target[last] = value
    return document


ODD = [
    ("materials.dry.friction_coefficient", 35.0, "friction_coefficient is 35", '"friction_angle": 35'),
    ("materials.dry.friction_angle", 0.6, "friction_angle is 0.6°", "34.38° if it is in radians"),
    ("materials.density", 2.4, "density is 2.4 kg/m³; usual is 300 to 9000", "2400 if t/m³"),
    ("materials.density", 24.0, "density is 24 kg/m³", "2446 if a unit weight in kN/m³"),
    ("materials.density", 24000.0, "density is 24000 kg/m³", "2446 if a unit weight in N/m³"),
    ("materials.inner.tensile_strength", 2.0, "tensile_strength is 2 Pa, below the", "2e+06 if MPa are meant"),
    (
        "materials.inner.tensile_strength",
        500.0,
        "tensile_strength is 500 Pa, below the",
        "5e+08 if MPa are meant; 5e+05 if k",
    ),
    ("materials.inner.shear_strength", 2e12, "shear_strength is 2e+12 Pa", "2e+06 if it was turned into Pa twice"),
    ("materials.gravity", -9.81, "materials.gravity is -9.81", "so 9.81 was probably meant"),
    ("grid.cell", [400.0, 200.0], None, None),
    ("grid.cell", [4000.0, 2000.0], "measures 4000 m", "lengths in mm were probably meant"),
    ("grid.cell", [4e-4, 2e-4], "measures 0.0004 m", "lengths in a larger unit were probably meant"),
    (
        "loads.live",
        [{"element": "c0r0", "force": [0, -1], "at": [350.0, 0.0]}],
        "the line of action of the live load passes 349",
        "m beside the structure (through 350",
    ),
]


@pytest.mark.parametrize(("path", "value", "what", "meant"), ODD, ids=[f"{o[0]}={o[1]}" for o in ODD])
def test_implausible_values_are_warnings(path: str, value: object, what: str | None, meant: str | None) -> None:
    assembly = build_assembly(parse_scene(with_(path, value)))
    about = [warning for warning in assembly.warnings if what is not None and what in warning]
    if what is None:
        assert not [w for w in assembly.warnings if path.rpartition(".")[2] in w]
        return
    assert len(about) == 1, assembly.warnings
    assert str(meant) in about[0]
    assert "usual is" in about[0] or "acts downwards" in about[0]


def test_a_load_beside_the_structure_is_told_in_the_unit_of_the_scene() -> None:
    document = with_("loads.live", [{"element": "c0r0", "force": [0, -1], "at": [350.0, 0.0]}])
    warnings = build_assembly(parse_scene({**document, "units": {"length": "cm", "force": "N"}})).warnings
    (told,) = [warning for warning in warnings if "line of action" in warning]
    assert " cm beside the structure" in told
    assert " m " not in told


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.json")), ids=lambda path: path.stem)
def test_real_scenes_are_plausible(path: Path) -> None:
    assert build_assembly(load_scene(path)).warnings == ()


UNITS = {("m", "kN"): (1.0, 1e3), ("mm", "N"): (1e-3, 1.0), ("cm", "MN"): (1e-2, 1e6), ("ft", "lbf"): (0.3048, 4.44822)}
"""Metres and newtons of units of scenes."""


def in_units(length: str, force: str, density: Any, factor: float = 1.0) -> dict[str, Any]:
    """A wall in other units, with a density as it stands; strengths of 2 MPa times `factor`."""
    metres, newtons = UNITS.get((length, force), (1.0, 1.0))
    stress = factor * 2e6 * metres**2 / newtons
    return {
        "units": {"length": length, "force": force},
        "grid": {"cell": [0.4 / metres, 0.2 / metres], "thickness": 0.3 / metres, "rows": ["aa", "ab", "##"]},
        "materials": dry_and_inner(density, 0.6, stress, stress),
        "loads": {"live": [{"body": [1, 0]}]},
    }


@pytest.mark.parametrize(("length", "force"), UNITS)
@pytest.mark.parametrize("text", ["2000 kg/m³", "2 t/m^3", "19.62 kN/m³", "2 g/cm³", "19.62 N/dm³", "124.856 lb/ft³"])
def test_densities_are_texts_with_units_in_every_system(length: str, force: str, text: str) -> None:
    metres, newtons = UNITS[length, force]
    assembly = build_assembly(parse_scene(in_units(length, force, text)))
    assert assembly.warnings == ()
    own = np.linalg.norm(assembly.elements.weight[assembly.elements.free], axis=1).sum()
    assert own * newtons == pytest.approx(4 * 0.4 * 0.2 * 0.3 * 2000 * 9.81, rel=1e-5)
    assert metres > 0


@pytest.mark.parametrize(("length", "force"), UNITS)
def test_a_density_in_kg_per_cubic_metre_is_a_warning_in_other_units(length: str, force: str) -> None:
    metres, newtons = UNITS[length, force]
    (warning,) = build_assembly(parse_scene(in_units(length, force, 2000.0))).warnings
    assert warning.startswith(f"materials.density is 2000, which is {2000 * newtons / metres**3:.4g} kg/m³ in")
    assert 'write "density": "2000 kg/m³", or' in warning
    remedy = float(warning.rpartition("or ")[2])
    assert build_assembly(parse_scene(in_units(length, force, remedy))).warnings == ()


@pytest.mark.parametrize(("length", "force"), [("m", "kN"), ("mm", "N")])
def test_strengths_of_surfaces_and_of_single_faces_are_judged(length: str, force: str) -> None:
    """Pascals in a scene of other units, wherever a strength is stated."""
    metres, newtons = UNITS[length, force]
    pascals = newtons / metres**2
    scene = in_units(length, force, "2000 kg/m³")
    own = {key: value / pascals for key, value in (("tensile_strength", 2e5), ("shear_strength", 2e5))}
    scene["materials"]["inner"] = own
    scene["materials"]["faces"] = [{"between": ["c0r0", "c1r0"], "inner": {"tensile_strength": 2e9 / pascals}}]
    (warning,) = build_assembly(parse_scene(scene)).warnings
    assert warning.startswith("materials.faces[0].inner.tensile_strength is ")
    friction = {"coefficients": 0.3, "cohesion": 2e5 / pascals}
    bending = {"within": "kern", "tensile_strength": 2e5 / pascals}
    for strength, number in ((2e5, 0), (2e10, 1), (2.0, 1)):
        bending["tensile_strength"] = strength / pascals
        scene["materials"] |= {"faces": [], "inner": {"surface": {"friction": friction, "bending": bending}}}
        warnings = build_assembly(parse_scene(scene)).warnings
        assert [one.partition(" is ")[0] for one in warnings] == [
            "materials.inner.surface.bending.tensile_strength"
        ] * number


@pytest.mark.parametrize(("length", "force"), UNITS)
def test_strengths_and_sizes_are_judged_in_every_system(length: str, force: str) -> None:
    warnings = build_assembly(parse_scene(in_units(length, force, "2000 kg/m³", 1e6))).warnings
    assert len(warnings) == 2
    assert all("usual is below 1e+09 Pa" in one for one in warnings)
    large = in_units(length, force, "2000 kg/m³")
    large["grid"]["cell"] = [1e5 * side for side in large["grid"]["cell"]]
    assert any("more are above 1 km" in one for one in build_assembly(parse_scene(large)).warnings)


@pytest.mark.parametrize("name", ["inner", "dry"])
@pytest.mark.parametrize(("length", "force"), UNITS)
def test_a_scene_that_contradicts_itself_in_compression_is_warned_about(length: str, force: str, name: str) -> None:
    """Mohr–Coulomb bears 2 τ (μ + √(1 + μ²)) in uniaxial compression: 2 τ without friction, 6 τ at μ = 4/3."""
    document = in_units(length, force, "2000 kg/m³")
    inner = document["materials"]["inner"]
    document["materials"][name]["compressive_strength"] = 1.999 * inner["shear_strength"]
    assert build_assembly(parse_scene(document)).warnings == ()
    document["materials"][name]["compressive_strength"] = 5.99 * inner["shear_strength"]
    (warning,) = build_assembly(parse_scene(document)).warnings
    assert warning.startswith(f"materials.{name}.compressive_strength is")
    remedy = float(warning.rpartition("at least ")[2])
    assert remedy == pytest.approx(5.99 / 2.0 * inner["shear_strength"], rel=1e-3)
    inner["tensile_strength"] *= 0.5
    inner["friction_coefficient"] = 4.0 / 3.0
    assert build_assembly(parse_scene(document)).warnings == ()


def test_gravity_of_the_unit_of_length_is_known() -> None:
    """9810 mm/s², with tonnes per mm³: 2e-9 of these are 2000 kg/m³."""
    document = in_units("mm", "N", 2e-9)
    document["materials"]["gravity"] = 9810
    told = {**document, "materials": {**document["materials"], "density": "2000 kg/m³"}}
    for one in (document, told):
        assembly = build_assembly(parse_scene(one))
        assert assembly.warnings == ()
        assert parse_scene(one).materials.density == pytest.approx(2e-9)


def test_units_of_unknown_names_are_a_note() -> None:
    document = with_("materials.dry.friction_coefficient", 35.0)
    assembly = build_assembly(parse_scene({**document, "units": {"length": "ell", "force": "N"}}))
    assert [one[:40] for one in assembly.warnings] == ["materials.dry.friction_coefficient is 35"]
    assert assembly.notes == ("no unit is named 'ell', so that densities, strengths and sizes could not be judged",)


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        ("2000 kg", {}, "'kg' is no unit of this quantity"),
        ("2000 kg/m²", {}, "no unit of this quantity"),
        ("20 kN/m³", {"gravity": 0}, "without gravity '20 kN/m³' is no density"),
    ],
)
def test_wrong_densities_are_refused_in_one_line(text: str, more: dict[str, Any], words: str) -> None:
    document = with_("materials.density", text)
    document["materials"] |= more
    with refused(words, match=r"materials\.density: "):
        parse_scene(document)


def test_check_echoes_thickness_density_and_weight(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "scene.json", in_units("m", "kN", "2000 kg/m³"))
    out = jld("check", file).out
    assert "thickness    0.3 m" in out
    assert "density      2, 2000 kg/m³ in m and kN" in out
    assert "weight       1.884 kN" in out


@pytest.mark.usefixtures("without_pictures")
def test_they_reach_whoever_asks(tmp_path: Path, jld: Command) -> None:
    file = saved(tmp_path / "scene.json", with_("materials.density", 2.4))
    line = f"jld: warning: {file}: materials.density is 2.4 kg/m³"
    for command in ("check", "solve"):
        outcome = jld(command, file).done()
        assert outcome.err.startswith(line)
        strict = jld(command, file, "--strict")
        assert (strict.code, strict.out) == (2, "")
        assert strict.err.startswith(f"jld: {file}: materials.density is 2.4")
    told = json.loads(jld("solve", file, "--json").out)["warnings"]
    assert told[0].startswith("materials.density is 2.4")
    options = ("--driver", "random", "--budget", "3", "--jobs", "1")
    assert jld("explore", file, "--out", tmp_path / "no", *options, "--strict").code == 2
    assert not (tmp_path / "no").exists()
    found = json.loads(jld("explore", file, "--out", tmp_path / "out", *options, "--json").out)
    assert found["warnings"] == told[: len(found["warnings"])] != []


def test_check_prints_the_resultant_of_the_load(tmp_path: Path, jld: Command) -> None:
    """1000 N at x = 1.7: not moment over size, which is no force."""
    file = saved(
        tmp_path / "scene.json", with_("loads.live", [{"element": "c0r0", "force": [0, -1000], "at": [1.7, 0.0]}])
    )
    out = jld("check", file).out
    (line,) = [line for line in out.splitlines() if line.startswith("live load")]
    assert "λ × (0, -1000) N through (1.7, " in line


def test_check_refuses_what_explore_would_refuse(tmp_path: Path, jld: Command) -> None:
    document = with_("search", {"block_cells": [9, 9]})
    file = saved(tmp_path / "scene.json", document)
    outcomes = [jld(command, file) for command in ("check", "solve")]
    outcomes.append(jld("explore", file, "--out", tmp_path / "out"))
    assert [outcome.code for outcome in outcomes] == [2, 2, 2]
    assert len({outcome.err for outcome in outcomes}) == 1


def test_resultants() -> None:
    """A wrench in space: force along z through (1, 2), couple of 3 about it; a planar couple."""
    pair = [box("base", (0, 0, -1), (1, 1, 0), support=True), box("top", (0, 0, 0), (1, 1, 1))]

    assembly = spatial_assembly(pair)
    loads = np.zeros((2, 6))
    loads[1, 2] = 5.0
    centre = assembly.elements.centroid[1]
    loads[1, 3:] = np.cross([1.0 - centre[0], 2.0 - centre[1], 0.0], [0.0, 0.0, 5.0])
    loads[1, 5] += 3.0
    found = facts.resultant(loads, assembly.elements)
    assert found.force == pytest.approx([0, 0, 5])
    assert found.moment == pytest.approx(3.0)
    assert found.point[:2] == pytest.approx([1.0, 2.0])
    flat = build_assembly(parse_scene(with_("loads.live", [{"element": "c0r0", "moment": 7.0}])))
    couple = facts.resultant(flat.live, flat.elements)
    assert couple.cancels
    assert couple.moment == pytest.approx(7.0)
