"""What a program of a user does with the public names: labels, many labellings, results, and old names that end."""

from __future__ import annotations

import inspect
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jld_core as jc
from cases import CASES, SPATIAL, grid_assembly, grid_document
from command import ROOT

SCENE = ROOT / "scenes" / "flat_beam_arch.json"


@pytest.fixture(scope="module")
def arch() -> jc.Assembly:
    return jc.build_assembly(jc.load_scene(SCENE))


@pytest.mark.parametrize("function", [jc.solve, jc.solve_many])
def test_signatures_state_every_option(function: Any) -> None:
    """Editors see each option with its type and default; there is one owner, `Model`."""
    shown = inspect.signature(function).parameters
    stated = {one.name: (one.default, one.type) for one in fields(jc.Model)}
    assert list(shown)[3:] == list(stated)
    for name, (default, kind) in stated.items():
        assert (shown[name].default, shown[name].annotation) == (default, kind)
        assert shown[name].kind is inspect.Parameter.KEYWORD_ONLY


def test_a_scene_file_a_scene_and_an_assembly_are_one(arch: jc.Assembly) -> None:
    values = [jc.solve(one).load_factor for one in (arch, jc.load_scene(SCENE), SCENE, str(SCENE))]
    assert values == pytest.approx([values[0]] * 4, rel=1e-12)
    with pytest.raises(jc.InputError, match=r"no_such\.json"):
        jc.solve("no_such.json")
    with pytest.raises(jc.InputError, match=r"^structure: 'int' is no structure; expected the name of a scene file"):
        jc.solve(3)


def test_labels_come_as_letters_numbers_or_truth_values(arch: jc.Assembly) -> None:
    bits = np.random.default_rng(5).random(len(arch.interfaces)) < 0.7
    text = "".join("d" if dry else "i" for dry in bits)
    forms = [bits, bits.astype(int), bits.tolist(), text, list(text), bits.astype(np.uint8), bits.astype(float)]
    for form in forms:
        assert jc.solve(arch, form).labels.tolist() == bits.tolist()
    assert jc.solve_many(arch, forms).labels.tolist() == [bits.tolist()] * len(forms)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: np.full(m, 0.5), "label 0 is 0.5; expected"),
        (lambda m: np.full(m, np.nan), "label 0 is nan; expected"),
        (lambda m: [1] * (m - 1) + [2], "is 2; expected"),
        (lambda m: [True] * (m - 1) + [None], "is None; expected"),
        (lambda m: "d" * (m - 1), "labels are given; expected"),
        (lambda m: "d" * (m - 1) + "x", "is 'x'; expected"),
        (lambda m: "dry", "3 labels are given; expected"),
        (lambda m: np.ones((2, m), dtype=bool), "an array of shape (2, "),
        (lambda m: True, "an array of shape ()"),
    ],
)
def test_invalid_labels_are_refused_in_one_line(arch: jc.Assembly, change: Any, words: str) -> None:
    labels = change(len(arch.interfaces))
    with pytest.raises(jc.InputError) as caught:
        jc.solve(arch, labels)
    assert str(caught.value).startswith("labels: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(jc.InputError, match=r"^labellings\[1\]: "):
        jc.solve_many(arch, [arch.labels, labels])


def test_invalid_lists_of_labellings_are_refused(arch: jc.Assembly) -> None:
    for wrong in ("d" * 24, 7, np.ones((3, 5), dtype=bool)):
        with pytest.raises(jc.InputError, match=r"^labellings: "):
            jc.solve_many(arch, wrong)
    assert len(jc.solve_many(arch, [])) == 0
    assert jc.solve_many(arch, []).best is None


YIELD_SETS = [(name, "planar") for name in CASES] + [(name, "spatial") for name in SPATIAL]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("name", "kind"), YIELD_SETS)
def test_batch_solver_equals_single_solve(name: str, kind: str) -> None:
    """Same statuses and brackets that meet, over all yield sets of the tests' structures."""
    if kind == "planar":
        rows, options = CASES[name]
        assembly = grid_assembly(rows, **options)
    else:
        assembly = SPATIAL[name]()
    options: Any = {"inner_bending": "kern"} if "kern" in name else {}
    labels = np.random.default_rng(8).random((4, len(assembly.interfaces))) < [[0.2], [0.5], [0.8], [1.0]]
    many = jc.solve_many(assembly, labels, **options)
    scale = max(1e-3 * assembly.total_dead / max(assembly.total_live, 1e-300), 1e-12)
    for k, row in enumerate(labels):
        one = jc.solve(assembly, row, **options)
        if jc.Status.UNCERTIFIED in (one.status, many.status[k]):
            continue
        assert many.status[k] is one.status
        if one.status is jc.Status.COLLAPSE:
            assert many.load_factor[k] == pytest.approx(one.load_factor, rel=2e-6, abs=2e-6 * scale)
            assert many.low[k] <= one.bracket[1] + 1e-9 * scale
            assert one.bracket[0] <= many.high[k] + 1e-9 * scale


def test_the_other_labellings_do_not_matter(arch: jc.Assembly) -> None:
    labels = np.random.default_rng(1).random((9, len(arch.interfaces))) < 0.7
    many, last = jc.solve_many(arch, labels), jc.solve_many(arch, labels[::-1][:3])
    np.testing.assert_allclose(last.load_factor, many.load_factor[::-1][:3], rtol=1e-9, equal_nan=True)


def cases_document() -> dict[str, Any]:
    document = grid_document(["aab", "abb", "###"])
    document["loads"] = {
        "cases": [
            {"name": "right", "live": [{"body": [1, 0]}], "required": 0.5},
            {"name": "left", "live": [{"body": [-1, 0]}], "required": 0.8},
        ]
    }
    return document


@pytest.mark.parametrize("options", [{}, {"friction": "zero-dilation"}, {"solver": "highs", "condense": "off"}])
def test_load_cases_and_other_models(options: dict[str, Any]) -> None:
    assembly = jc.build_assembly(jc.parse_scene(cases_document()))
    labels = np.random.default_rng(2).random((3, len(assembly.interfaces))) < 0.7
    many = jc.solve_many(assembly, labels, **options)
    assert list(many.cases) == ["right", "left"]
    for k, row in enumerate(labels):
        one = jc.solve(assembly, row, **options)
        assert (many.status[k], many.governing[k]) == (one.status, one.governing)
        assert many.load_factor[k] == pytest.approx(one.load_factor, rel=2e-6)
    table = many.to_frame()
    assert list(table) == [
        *("labelling", "load_factor", "bracket_lo", "bracket_hi", "status", "governing"),
        *("load_factor[right]", "load_factor[left]"),
    ]
    if many.best is not None:
        again = many.result(many.best)
        assert again.load_factor == pytest.approx(many.load_factor[many.best], rel=2e-6)


def test_forces_as_a_table(arch: jc.Assembly) -> None:
    result = jc.solve(arch)
    table = result.to_frame()
    assert table.index.name == "face"
    assert list(table) == ["element_a", "element_b", "label", "length", "N", "V", "M"]
    length, force = arch.units
    assert table.attrs["units"] == {"length": length, "N": force, "V": force, "M": f"{force}·{length}"}
    np.testing.assert_array_equal(table[["N", "V", "M"]].to_numpy(), result.forces)
    assert (table["label"] == "dry").tolist() == result.labels.tolist()
    solid = jc.solve(SPATIAL["stools"]()).to_frame()
    assert list(solid)[3:] == ["area", "N", "V1", "V2", "M1", "M2", "MT"]
    assert solid.attrs["units"]["area"].endswith("²")


def test_a_result_draws_itself(arch: jc.Assembly, tmp_path: Path) -> None:
    figure = jc.solve(arch).plot(ids=True)
    assert len(figure.axes) == 3
    figure.savefig(tmp_path / "result.png")
    assert (tmp_path / "result.png").stat().st_size > 1000


def test_evidence_has_named_fields() -> None:
    scene = jc.parse_scene(grid_document(["ab", "##"]))
    assert jc.solve(scene).zero_dilation is None
    found = jc.solve(scene, friction="zero-dilation").zero_dilation
    assert found.converged
    assert found.lowest_found is None
    span = jc.solve(scene, friction="zero-dilation", range=True, floor_seconds=1.0)
    assert span.zero_dilation.lowest_found <= span.zero_dilation.associative_load_factor * (1.0 + 1e-9)
    assert span.zero_dilation.lowest_found == span.to_json()["lowest_found"]
