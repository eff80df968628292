"""What Python hands to a page: it fits the schema, it is what the results say, and nothing in a scene can break out."""

from __future__ import annotations

import base64
import gzip
import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pandas as pd
import pytest
from tools.page_contract import FILE
from tools.page_contract import joined as with_contract

from cases import HOSTILE, scene_of_cases, small_scene, spatial_scene
from command import SCENES
from jld_core import build_assembly, load_scene, parse_scene, solve
from jld_explore import ExploreSettings, explore, read_folder
from jld_explore.report import columns as columns_of_report
from jld_explore.space import from_string
from jld_views import page_contract, page_data, page_of_study, quantities

page_schema = cache(page_contract.page_schema)


def check(data: dict[str, Any]) -> None:
    """Data against the schema, as JSON makes it."""
    jsonschema.Draft202012Validator(page_schema()).validate(json.loads(json.dumps(data, allow_nan=False)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("page") / "study"
    explore(parse_scene(small_scene()), where, ExploreSettings(jobs=1))
    return where


def embedded(html: str) -> dict[str, Any]:
    """The data inside a page."""
    text = re.search(r'<script type="text/plain" id="data">([A-Za-z0-9+/=]*)</script>', html)
    assert text is not None
    return dict(json.loads(gzip.decompress(base64.b64decode(text[1]))))


def test_contract_js_equals_the_contract() -> None:
    """Types and keys of contract.js are those of the contract: else run `python -m tools.page_contract`."""
    content = FILE.read_text(encoding="utf-8")
    assert with_contract(content) == content
    assert with_contract(content.replace('"touching"', '"touches"')) == content


def test_the_schema_is_one_and_strict() -> None:
    jsonschema.Draft202012Validator.check_schema(page_schema())
    for name, part in page_schema()["$defs"].items():
        if part.get("type") == "object":
            assert part["additionalProperties"] is False, name
            assert set(part["required"]) == set(part["properties"]), name


@pytest.mark.parametrize("make", [small_scene, spatial_scene, scene_of_cases])
def test_data_of_a_study_fits_the_schema(make: Any, tmp_path: Path) -> None:
    explore(parse_scene(make()), tmp_path / "s", ExploreSettings(jobs=1, budget=12, pictures=False))
    data = page_of_study.study_data(read_folder(tmp_path / "s"))
    check(data)
    assert data["solutions"]


def test_the_page_of_every_search_agrees_with_its_tables(folder: Path) -> None:
    data = embedded((folder / "report.html").read_text(encoding="utf-8"))
    check(data)
    results = pd.read_parquet(folder / "results.parquet")
    table = data["table"]
    columns = {column["name"]: column["values"] for column in table["columns"]}
    assert table["rows"] == len(results)
    np.testing.assert_allclose(np.array(columns["load_factor"], float), results["load_factor"], rtol=1e-9)
    assert columns["dry_faces"] == results["dry_faces"].tolist()
    faces = len(data["structure"]["faces"])
    bits = np.frombuffer(base64.b64decode(table["labellings"]), dtype=np.uint8).reshape(len(results), -1)
    labellings = np.unpackbits(bits, axis=1)[:, :faces].astype(bool)
    assert [from_string(text).tolist() for text in results["labelling"]] == labellings.tolist()
    front = pd.read_csv(folder / "pareto.csv")
    assert sum(evidence != "visited" for evidence in table["evidence"]) == len(front)
    assert data["summary"] == json.loads((folder / "summary.json").read_text())


def test_solutions_of_a_page_are_those_of_solve(folder: Path) -> None:
    done = read_folder(folder)
    data = embedded(page_of_study.study_page(done, patience=60.0))
    best = data["solutions"]["0"]["cases"][0]
    labels = from_string(str(done.results["labelling"].iloc[0]))
    proven = solve(done.assembly, labels)
    own = page_of_study.CaseAnalysis(done.assembly).solve(labels)  # forces are not unique: those of the same templates
    assert own.load_factor == pytest.approx(proven.load_factor, rel=1e-8)
    assert own.forces is not None
    assert own.mechanism is not None
    assert best["load_factor"] == pytest.approx(own.load_factor, rel=1e-8)
    np.testing.assert_allclose(best["forces"], own.forces, rtol=1e-5, atol=1e-9 * abs(own.forces).max())
    np.testing.assert_allclose(best["mechanism"], own.mechanism, rtol=1e-5, atol=1e-9)
    assert best["scale"] == pytest.approx(quantities.mechanism_scale(done.assembly, own.mechanism), rel=1e-5)


def test_the_page_has_every_load_case_and_the_governing_one() -> None:
    scene = parse_scene(scene_of_cases())
    assembly = build_assembly(scene)
    data = embedded(page_of_study.scene_page(scene, assembly))
    check(data)
    found, own = data["solutions"]["0"], solve(assembly)
    assert data["cases"] == ["right", "<b>left</b>"]
    assert {load["case"] for load in data["loads"]} == set(data["cases"])
    assert data["cases"][found["governing"]] == own.governing == "right"
    assert found["load_factor"] == pytest.approx(own.load_factor, rel=1e-8)
    for case, required in zip(found["cases"], (2.0, 1.0), strict=True):
        assert case["required"] == required
        assert case["load_factor"] == pytest.approx(own.cases[case["name"]].load_factor, rel=1e-8)
    assert found["load_factor"] == pytest.approx(
        min(c["load_factor"] / c["required"] for c in found["cases"]), rel=1e-6
    )


def test_titles_and_units_of_columns(tmp_path: Path) -> None:
    """With load cases what ranks is no λ, and what is a length in the plane is an area in space."""
    titles = {}
    for name, scene in (("cases", scene_of_cases()), ("space", spatial_scene())):
        settings = ExploreSettings(driver="random", budget=3, jobs=1, pictures=False)
        done = explore(parse_scene(scene), tmp_path / name, settings)
        columns = page_of_study.study_data(done)["table"]["columns"]
        titles[name] = {column["name"]: column["title"] for column in columns}
        assert done.results["load_factor"].notna().any()
    assert titles["cases"]["load_factor"] == "λ / required"
    assert titles["cases"]["load_factor[right]"] == "λ, right"
    assert (titles["space"]["load_factor"], titles["space"]["dry_length"]) == ("λ", "dry area")


def test_edges_and_faces_together_are_the_outlines() -> None:
    """The pieces of outline that touch nothing, with the faces, are as long as all outlines together."""
    assembly = build_assembly(load_scene(SCENES / "flat_beam_arch.json"))
    found = page_data.structure_of(assembly, assembly.free_faces)
    bare = sum(float(np.hypot(*np.subtract(edge["to"], edge["from"]))) for edge in found["edges"])
    free = assembly.elements.free
    shapes = [assembly.elements.shape[k] for k in free]
    around = sum(float(np.linalg.norm(np.roll(s, -1, axis=0) - s, axis=1).sum()) for s in shapes)
    faces = assembly.interfaces
    touched = [int(np.isin([a, b], free).sum()) for a, b in zip(faces.a, faces.b, strict=True)]
    assert bare + float(faces.l1 @ np.array(touched)) == pytest.approx(around, rel=1e-9)


def test_a_page_loads_nothing_and_runs_nothing_else(folder: Path) -> None:
    html = (folder / "report.html").read_text(encoding="utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    assert policy[1].startswith("default-src 'none'; script-src 'sha256-")
    for word in ("unsafe", "http:", "https:", "*"):
        assert word not in policy[1]
    assert not re.search(r'(?:src|href)="(?!#)', html)
    assert not re.search(r"<[^>]* (?:style|on\w+)=", html.partition("<script")[0])


def test_names_in_a_scene_stay_text() -> None:
    scene = parse_scene(small_scene(name=HOSTILE))
    html = page_of_study.scene_page(scene, build_assembly(scene))
    assert HOSTILE not in html
    assert html.count("</script>") == 2
    assert embedded(html)["title"] == HOSTILE
    check(embedded(html))


@pytest.mark.long
def test_twenty_thousand_layouts_stay_below_five_megabytes() -> None:
    """Rows as long as those of a wall of 100 cells, with brackets that share no digits."""
    rng = np.random.default_rng(1)
    assembly = build_assembly(parse_scene(small_scene(rows=["a" * 10] * 10 + ["#" * 10])))
    rows, faces = page_data.MOST + 500, len(assembly.interfaces)
    value = np.sort(rng.random(rows))[::-1] * 10
    letters = np.where(rng.random((rows, faces)) < 0.4, "d", "i")
    results = pd.DataFrame(
        {
            "rank": pd.array(np.arange(1, rows + 1), dtype="Int64"),
            "labelling": ["".join(row) for row in letters],
            "multiplicity": 2,
            "load_factor": value,
            "bracket_lo": value * (1 - 1e-8),
            "bracket_hi": value * (1 + 1e-8),
            "status": "collapse",
            "dry_faces": rng.integers(10, 90, rows),
            "dry_length": rng.random(rows),
            "blocks": rng.integers(2, 40, rows),
            "largest_block_cells": rng.integers(1, 40, rows),
            "load_factor_associative": value,
            "settled": "solve",
            "seconds": rng.random(rows),
            "driver": "genetic",
        }
    )
    front = results.iloc[[0, rows - 1]].assign(evidence="found")
    kept = page_data.chosen_rows(results, front)
    assert len(kept) == page_data.MOST + 1
    table = page_data.table_of(kept, front, assembly, axes=[("dry_faces", "max")], left_out=rows - len(kept))
    assert table["evidence"][-1] == "found"
    solution = page_data.solution_of(solve(assembly))
    data = page_data.page_data(
        kind="report",
        scene=parse_scene(small_scene()),
        assembly=assembly,
        candidates=assembly.free_faces,
        facts={},
        table=table,
        solutions=dict.fromkeys(range(60), solution),
    )
    # one row is checked as well as twenty thousand, which take five seconds
    short = page_data.table_of(kept.tail(1), front, assembly, axes=[("dry_faces", "max")], left_out=rows - 1)
    check({**data, "table": short})
    assert len(page_data.page(data).encode()) < 5_000_000


def test_rounding_keeps_digits_and_writes_null_for_nan() -> None:
    values = np.array([0.1 + 0.2, 123456.789, -1e-300, 1e300, 0.0, np.nan, np.inf, 2.5e-7])
    assert columns_of_report.rounded(values, 6) == [0.3, 123457.0, -1e-300, 1e300, 0.0, None, None, 2.5e-7]
    assert columns_of_report.rounded(np.pi, 4) == 3.142
    assert columns_of_report.rounded(np.nan) is None


def test_modules_that_import_one_another_in_a_circle_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = {
        "a.js": 'import { b } from "./b.js";\nexport const a = 1;\n',
        "b.js": 'import { a } from "./a.js";\nexport const b = 1;\n',
    }
    monkeypatch.setattr(page_data, "asset", texts.__getitem__)
    with pytest.raises(ValueError, match=r"a\.js → b\.js → a\.js"):
        page_data.linked("a.js")


def test_a_module_that_would_end_its_script_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_data, "asset", lambda name: 'export const a = "</script>";\n')
    with pytest.raises(ValueError, match="would end its script"):
        page_data.linked("a.js")


def test_braces_in_a_title_are_no_places_of_the_template() -> None:
    assert page_data.filled("{{title}} {{data}}", {"title": "{{data}}", "data": "x"}) == "{{data}} x"
