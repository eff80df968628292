"""Numbers of a scene: written with a unit, and with a distribution."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from cases import ROUTE
from command import Command, refused, saved
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.scene import uncertain

PLAIN: dict[str, Any] = {
    "elements": [
        {"id": "ground", "support": True, "polygon": [[0, -1], [1, -1], [1, 0], [0, 0]]},
        {"id": "b", "polygon": [[0, 0], [1, 0], [1, 2], [0, 2]]},
    ],
    "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6, "cohesion": 5000.0}},
    "loads": {"live": [{"element": "b", "force": [2500.0, 0.0], "at": [1.0, 1.5], "moment": 300.0}]},
}


def scene(units: dict[str, str] | None = None, cohesion: Any = 5000.0, **load: Any) -> dict[str, Any]:
    """Return the plain scene with other texts in its load and its cohesion."""
    live = {"element": "b", "force": [2500.0, 0.0], "at": [1.0, 1.5], "moment": 300.0, **load}
    dry = {"friction_coefficient": 0.6, "cohesion": cohesion}
    found = {**PLAIN, "materials": {"density": 2000, "dry": dry}, "loads": {"live": [live]}}
    return found if units is None else {**found, "units": units}


@pytest.mark.parametrize(
    "written",
    [
        {"force": ["2.5 kN", 0.0]},
        {"force": ["2.5kN", "0 N"], "at": ["100 cm", "1500 mm"]},
        {"moment": "0.3 kNm"},
        {"moment": "0.3 kN·m"},
        {"moment": "300 N*m", "cohesion": "5 kPa"},
        {"cohesion": "0.005 MPa"},
        {"cohesion": "5 kN/m²"},
        {"cohesion": "0.005 N/mm^2"},
        {"cohesion": "5000"},
    ],
)
def test_texts_are_the_numbers_that_they_state(written: dict[str, Any]) -> None:
    one, other = (build_assembly(parse_scene(document)) for document in (PLAIN, scene(**written)))
    assert one.live == pytest.approx(other.live, rel=1e-14)
    assert one.strengths(ROUTE).cohesion == pytest.approx(other.strengths(ROUTE).cohesion, rel=1e-14)


def test_texts_become_numbers_of_the_units_of_the_scene() -> None:
    units = {"force": "kN", "length": "mm"}
    live = build_assembly(parse_scene(scene(units, force=["2500 N", 0.0], at=[0.5, 1.0], moment="3 kN·m"))).live
    assert live[1] == pytest.approx([2.5, 0.0, 3000.0], rel=1e-14)
    one = parse_scene(scene(units, cohesion="5 kPa")).materials.dry
    assert one.cohesion == pytest.approx(5e-6, rel=1e-14)


def test_a_mass_in_place_of_a_force_is_its_weight() -> None:
    live = build_assembly(parse_scene(scene(force=[0.0, "-1 t"], at=[0.5, 1.0], moment=0.0))).live
    assert live[1] == pytest.approx([0.0, -9810.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("written", "key", "words"),
    [
        ({"force": ["2.5 kM", 0.0]}, "loads.live[0].force[0]", "'kM'"),
        ({"force": ["2.5 kN/m", 0.0]}, "loads.live[0].force[0]", "no unit of this quantity"),
        ({"force": ["2,5 kN", 0.0]}, "loads.live[0].force[0]", "no unit is named ',5 kN'"),
        ({"force": ["much", 0.0]}, "loads.live[0].force[0]", "no number with a unit"),
        ({"force": ["1e999 N", 0.0]}, "loads.live[0].force[0]", "no number with a unit"),
        ({"force": ["1 /kN", 0.0]}, "loads.live[0].force[0]", "no unit is named"),
        ({"moment": "3 kN"}, "loads.live[0].moment", "no unit of this quantity"),
        ({"cohesion": "5 kN"}, "materials.dry.cohesion", "no unit of this quantity"),
        ({"force": "10 kN"}, "loads.live[0].force", "expected a vector"),
        ({"units": {"force": "pond"}, "force": ["1 N", 0]}, "loads.live[0].force[0]", "'pond'"),
    ],
)
def test_wrong_texts_are_refused_in_one_line(written: dict[str, Any], key: str, words: str) -> None:
    with refused(key, words):
        parse_scene(scene(**written))


# Values with uncertainty in a scene: read, written, refused, and the means that stand for them.


def block(friction: Any = 0.6, force: Any = None, **materials: Any) -> dict[str, Any]:
    """A block of 1 × 2 on a support, pushed near its base so that it slides."""
    return {
        "elements": [
            {"id": "ground", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
            {"id": "block", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]]},
        ],
        "materials": {"density": 1000.0, "dry": {"friction_coefficient": friction}, **materials},
        "loads": {"live": [{"element": "block", "force": force or [6000.0, 0.0], "at": [1.0, 0.1]}]},
    }


def vary(mean: Any, cov: Any = 0.1, kind: Any = "normal", **more: Any) -> dict[str, Any]:
    return {"mean": mean, "cov": cov, "kind": kind, **more}


def test_values_are_read_and_written_again() -> None:
    scene = parse_scene(block(vary(0.6, each=True), vary([6000.0, 0.0], 0.2, "lognormal"), density=vary(1000.0)))
    keys = ["materials.density", "materials.dry.friction_coefficient", "loads.live[0].force"]
    assert [uncertain.in_words(path) for path, _ in uncertain.uncertain_values(scene)] == keys
    again = parse_scene(json.loads(scene.model_dump_json()))
    assert again == scene
    assert [str(one) for one in uncertain.uncertain_values(again)] == [
        str(one) for one in uncertain.uncertain_values(scene)
    ]
    assert scene.fingerprint != parse_scene(block()).fingerprint


def test_a_text_with_a_unit_may_be_a_mean() -> None:
    scene = parse_scene(block(force=[vary("6 kN"), 0.0]))
    assert scene.loads.live[0].force[0] == 6000.0


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"mean": 0.6}, '"cov" of its distribution is missing'),
        ({"mean": 0.6, "cov": 0.1}, '"kind" of its distribution is missing'),
        ({"cov": 0.1, "kind": "normal"}, '"mean" of its distribution is missing'),
        (vary(0.6, -0.1), "cov: -0.1 is wrong"),
        (vary(0.6, math.nan), "cov: NaN is wrong"),
        (vary(math.nan), "NaN is wrong"),
        (vary(0.0, 0.1, "lognormal"), "mean: a lognormal value of mean 0"),
        (vary(0.6, 0.1, "gumbel"), 'kind: "gumbel" is wrong'),
        (vary(0.6, 0.1, scale=2), "scale: unknown key"),
        (vary(-0.6), "-0.6 is wrong"),
        (vary(0.6, "much"), 'cov: "much" is wrong'),
        (vary(0.6, each="yes"), 'each: "yes" is wrong'),
    ],
)
def test_wrong_distributions_are_one_line(value: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_scene(block(value))
    assert str(caught.value).startswith("scene: materials.dry.friction_coefficient")
    assert said in str(caught.value)


@pytest.mark.parametrize("force", [vary(6000.0), vary([0.0, 0.0]), vary([vary(1.0), 0.0]), [vary(1.0, each=True), 0.0]])
def test_wrong_distributions_of_loads_are_one_line(force: Any) -> None:
    with pytest.raises(InputError, match=r"loads\.live"):
        parse_scene(block(force=force))


def test_uncertain_values_are_taken_at_their_means_with_a_note(jld: Command, tmp_path: Path) -> None:
    """Elsewhere than in a reliability analysis λ is that of the means: μ W / H."""
    scene = parse_scene(block(vary(0.6), [vary(6000.0), 0.0]))
    assembly = build_assembly(scene)
    assert not assembly.warnings
    assert len(assembly.notes) == 1
    assert solve(assembly).load_factor == pytest.approx(0.6 * 2000 * 9.81 / 6000, rel=1e-9)
    path = saved(tmp_path / "block.json", block(vary(0.6)))
    for command in ("solve", "check", "thrust"):
        done = jld(command, str(path), *(["--strict"] if command != "thrust" else [])).done()
        assert "the means stand for values with uncertainty (materials.dry.friction_coefficient)" in done.err


@pytest.mark.parametrize(
    "wrong", ["thrust --section 0,90,1,90", "settlement", "solve --history h.csv", "export --format x"]
)
def test_an_error_stands_without_the_note_on_means(wrong: str, jld: Command, tmp_path: Path) -> None:
    path = saved(tmp_path / "block.json", block(vary(0.6)))
    name, *options = wrong.split()
    done = jld(name, path, *options, *(["-o", tmp_path / "x"] if name == "export" else []))
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
    assert "means" not in done.err


def test_a_design_check_and_exports_take_values_for_distributions(jld: Command, tmp_path: Path) -> None:
    """Both read the scene as a document, in which a distribution is an object.

    The design check takes the mean of weights, and the 98 % fractile of the live load: 1 + 2.0537 · 0.1 times its mean.
    """
    path, plain = tmp_path / "varied.json", tmp_path / "plain.json"
    path.write_text(json.dumps(block(0.6, vary([6000.0, 0.0]), density=vary(1000.0))))
    plain.write_text(json.dumps(block(0.6, [6000.0, 0.0])))
    found = []
    for scene in (path, plain):
        checked = jld("check-design", scene, "--json")
        assert checked.code in (0, 4)
        assert "means stand" not in checked.err  # fractiles do
        drawing = tmp_path / f"{scene.stem}.dem.json"
        assert jld("export", scene, "--format", "compas_dem", "-o", drawing).code == 0
        found.append((json.loads(checked.out)["utilisation"], drawing.read_text()))
    assert found[0][0] == pytest.approx(1.2053748911 * found[1][0], rel=1e-9)
    assert '"cov"' not in found[0][1]
