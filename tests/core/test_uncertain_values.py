"""Values with uncertainty in a scene: read, written, refused, and the means that stand for them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from command import Command
from jld_core import InputError, build_assembly, parse_scene, solve
from jld_core.scene.uncertain import in_words, uncertain_values


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
    assert [in_words(path) for path, _ in uncertain_values(scene)] == keys
    again = parse_scene(json.loads(scene.model_dump_json()))
    assert again == scene
    assert [str(one) for one in uncertain_values(again)] == [str(one) for one in uncertain_values(scene)]
    assert scene.fingerprint != parse_scene(block()).fingerprint


def test_a_text_with_a_unit_may_be_a_mean() -> None:
    scene = parse_scene(block(force=[vary("6 kN"), 0.0]))
    assert scene.loads.live is not None
    assert scene.loads.live[0].force[0] == 6000.0  # type: ignore[union-attr, index]


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
    path = tmp_path / "block.json"
    path.write_text(json.dumps(block(vary(0.6))))
    for command in ("solve", "check", "thrust"):
        done = jld(command, str(path), *(["--strict"] if command != "thrust" else []))
        assert done.code == 0
        assert "the means stand for values with uncertainty (materials.dry.friction_coefficient)" in done.err


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
        drawing = tmp_path / f"{scene.stem}.dem.json"
        assert jld("export", scene, "--format", "compas_dem", "-o", drawing).code == 0
        found.append((json.loads(checked.out)["utilisation"], drawing.read_text()))
    assert found[0][0] == pytest.approx(1.2053748911 * found[1][0], rel=1e-9)
    assert '"cov"' not in found[0][1]
