"""Pages in notebooks: what is left without a kernel, and what the kernel solves again for the sliders."""

from __future__ import annotations

import copy
import json
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from cases import ROUTE, grid_document
from jld_core import LimitAnalysisResult, build_assembly, load_scene, parse_scene, solve
from jld_core.errors import ParameterError
from jld_core.scene.cracks import CellCracks
from jld_explore import Exploration, explore
from jld_explore.space import from_string
from jld_studio import notebook
from jld_studio.notebook import NotebookPage
from jld_studio.notebook_kernel import AssemblyStructure, LayoutSolver, structure_of
from paths import SCENES

ARCH = SCENES / "flat_beam_arch.json"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Exploration:
    folder = tmp_path_factory.mktemp("study") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("jld_explore.explore"), "plan_check", lambda *_: None)
        return explore(ARCH, folder, driver="random", budget=24, seed=1, pictures=False)


@pytest.fixture
def unpictured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out pictures, half a second each, where nobody looks at them."""
    monkeypatch.setattr(notebook, "_plain", lambda title, facts, drawing, *tables: notebook.html.escape(title))
    for kind in (Exploration, LimitAnalysisResult):
        monkeypatch.setattr(kind, "drawn", lambda *_: None)


@pytest.fixture(scope="module")
def shown(study: Exploration) -> NotebookPage:
    page: NotebookPage = study.show()
    return page


def ask(page: NotebookPage, labelling: str, materials: Any) -> dict[str, Any]:
    """An answer of the kernel, as it travels."""
    asked = {"kind": "solve", "labelling": labelling, "materials": materials, "revision": 3}
    answer: dict[str, Any] = json.loads(json.dumps(page.answer(asked), allow_nan=False))
    assert (answer["kind"], answer["revision"]) == ("answer", 3)
    return answer


def test_without_scripts_there_are_facts_picture_and_table(shown: NotebookPage) -> None:
    plain = shown.html[: shown.html.index("<iframe")]
    assert plain.count("<table") == 3
    assert plain.count('src="data:image/png;base64,') == 1
    sliders = re.findall(r"<label>([^<]*)<input type=range disabled> ([^<]*)</label>", plain)
    assert [name.strip() for name, _ in sliders] == [
        "friction angle, dry", "tensile strength, inner", "shear strength, inner",
    ]  # fmt: skip
    assert "need a running kernel: run this cell again" in plain
    assert "<script" not in shown.html


def test_an_output_keeps_below_its_limit(
    study: Exploration, shown: NotebookPage, monkeypatch: pytest.MonkeyPatch, unpictured: None
) -> None:
    """Fewer rows, and then no page at all, where they would not fit; the kernel sends the page all the same."""
    assert len(shown.html) < notebook.LARGEST
    assert shown.answer({"kind": "page"})["html"].startswith("<!doctype html>")
    whole = study.show()
    monkeypatch.setattr(notebook, "_ROWS", ((60, 20), (2, 1)))
    monkeypatch.setattr(notebook, "LARGEST", len(whole.html) - 1000)
    less = study.show()
    assert len(less.html) < notebook.LARGEST
    assert "<iframe" in less.html
    monkeypatch.setattr(notebook, "LARGEST", 40_000)
    least = study.show()
    assert "<iframe" not in least.html
    assert least.answer({"kind": "page"})["html"].startswith("<!doctype html>")


def test_without_the_library_the_output_names_the_extra(monkeypatch: pytest.MonkeyPatch, unpictured: None) -> None:
    monkeypatch.setattr(notebook, "_has_anywidget", lambda: False)
    page = load_scene(ARCH).show()
    assert "pip install &#x27;jld[notebook]&#x27;" in page.html
    assert page.widget() is None


def test_the_widget_answers_requests_of_the_page(shown: NotebookPage, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the message handler of anywidget; the widget itself holds no page, which a saved notebook would keep twice."""
    pytest.importorskip("anywidget")
    bridge = shown.widget()
    sent: list[dict[str, Any]] = []
    monkeypatch.setattr(bridge, "send", sent.append)
    for kind in ("hello", "page"):
        bridge._handle_custom_msg({"kind": kind}, [])
    assert [answer["kind"] for answer in sent] == ["hello", "page"]
    assert len(json.dumps(bridge.get_state())) < 6000
    assert f'data-jld="{bridge.page}"' in shown.html


@pytest.mark.parametrize("kind", ["study", "scene", "result", "assembly"])
def test_sliders_are_solved_as_a_scene_with_these_materials(kind: str, study: Exploration, unpictured: None) -> None:
    """λ and its forces against `solve` of a scene file with the changed materials."""
    scene = load_scene(ARCH)
    thing = {
        "study": study, "scene": scene, "result": solve(scene), "assembly": build_assembly(scene),
    }[kind]  # fmt: skip
    page = thing.show()
    letters = str(study.results["labelling"].iloc[0])
    materials = copy.deepcopy(page._solver._structure.materials)
    materials["dry"].pop("friction_angle", None)
    materials["dry"]["friction_coefficient"] = 0.35
    materials["inner"]["tensile_strength"] = 7.5e5
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"]["dry"] = {"friction_coefficient": 0.35}
    document["materials"]["inner"]["tensile_strength"] = 7.5e5
    known = solve(parse_scene(document), from_string(letters))
    solution = ask(page, letters, materials)["solution"]
    assert solution["load_factor"] == pytest.approx(known.load_factor, rel=1e-6)
    assert solution["labelling"] == letters
    assert abs(known.load_factor / solve(scene, from_string(letters)).load_factor - 1.0) > 0.05


def test_values_of_single_faces_keep_their_ratio() -> None:
    document = grid_document(["aab", "acc", "###"])
    document["materials"]["faces"] = [{"between": ["c0r0", "c2r0"], "dry": {"friction_coefficient": 0.9}}]
    document["materials"]["faces"][0]["between"] = ["c1r0", "c2r0"]
    assembly = build_assembly(parse_scene(document))
    structure = AssemblyStructure(assembly)
    usual = structure.materials["dry"]["friction_coefficient"]
    changed = structure.with_materials({"dry": {"friction_coefficient": 0.5 * usual}})
    assert changed.strengths(ROUTE).friction == pytest.approx(0.5 * assembly.strengths(ROUTE).friction)
    assert changed.strengths(ROUTE).tension == pytest.approx(assembly.strengths(ROUTE).tension)
    assert len(set(assembly.strengths(ROUTE).friction.tolist())) == 2


def test_bond_fixes_the_sliders_of_a_result(unpictured: None) -> None:
    """The strength of bonded joints is part of their loads: only the scene says what a change does."""
    document = grid_document(["ab", "##"])
    document["materials"]["dry"] = {"friction_coefficient": 0.6, "cohesion": 2e3, "tensile_strength": 1e3}
    scene = parse_scene(document)
    assert "joints with a bond" in solve(scene).show().html
    assert "joints with a bond" not in scene.show().html


def test_omitted_cells_are_shown_as_omitted() -> None:
    wall = parse_scene(grid_document(["ab", "cd", "##"]))
    solver = LayoutSolver(structure_of(wall, build_assembly(wall)))
    assembly = build_assembly(wall)
    gone = assembly.elements.ids.index("c0r0")
    beside = (assembly.interfaces.a == gone) | (assembly.interfaces.b == gone)
    letters = "".join("v" if one else "d" for one in beside)
    found = solver.solve(letters, wall.model_dump(mode="json", exclude_defaults=True)["materials"])
    assert found["labelling"] == letters
    assert found["cases"][0]["mechanism"] is not None
    assert found["cases"][0]["mechanism"][gone] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("letters", "materials", "words"),
    [
        ("ddd", {}, "letters d, i or v"),
        (7, {}, "letters d, i or v"),
        (None, [], "materials as in a scene file"),
        (None, {"dry": {"friction_coefficient": -1.0}}, "friction_coefficient"),
        (None, {"dry": {"colour": 1.0}}, "colour"),
    ],
)
def test_unsolvable_requests_are_refused_in_one_line(
    shown: NotebookPage, letters: Any, materials: Any, words: str
) -> None:
    own = shown._data["solutions"]["0"]["labelling"]
    if materials == {}:
        materials = shown._solver._structure.materials
    answer = ask(shown, own if letters is None else letters, materials)
    assert words in answer["error"]
    assert "\n" not in answer["error"]


def test_blocks_that_crack_by_cells_fix_the_sliders(study: Exploration, unpictured: None) -> None:
    cells = replace(study, scene=study.scene.model_copy(update={"cracks": CellCracks(kind="cells", cell=0.05)}))
    assert "crack by cells or fields" in cells.show().html


@pytest.mark.parametrize("height", [5, 1e3, "tall"])
def test_bad_heights(height: Any) -> None:
    with pytest.raises(ParameterError, match="height"):
        load_scene(ARCH).show(height=height)


def test_the_frame_unpacks_to_the_page(shown: NotebookPage, tmp_path: Path) -> None:
    import base64
    import gzip
    import html

    text = html.unescape(shown.html)
    (packed,) = re.findall(r'atob\("([^"]+)"\)', text)
    assert gzip.decompress(base64.b64decode(packed)).decode() == shown.answer({"kind": "page"})["html"]
