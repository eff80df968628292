"""Results show themselves in a notebook: in a real batch solver, as Jupyter would ask them."""

from __future__ import annotations

import ast
import base64
import copy
import json
import re
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

from cases import ROUTE, grid_document
from command import ROOT, SCENES
from jld_core import InputError, LimitAnalysisResult, build_assembly, load_scene, parse_scene, solve
from jld_core.scene import cracks
from jld_explore import Exploration, explore
from jld_explore.space import from_string
from jld_studio import notebook as notebook_of_page
from jld_views import notebook

CELLS = (
    "from pathlib import Path\n"
    "from jld_core import build_assembly, load_scene, solve\n"
    "from jld_explore import ExploreSettings, explore\n"
    "import sys\n"
    f"scene = load_scene({str(SCENES / 'flat_beam_arch.json')!r})\n"
    "assembly = build_assembly(scene)\n"
    "result = solve(assembly)\n"
    "assert 'matplotlib' not in sys.modules",
    "assembly",
    "result",
    "explore(scene, Path('search'), ExploreSettings(driver='random', budget=30))",
    "study = _",
    "study.show()",
)


def drawing(html: str) -> str:
    (data,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', html)
    return base64.b64decode(data).decode()


@pytest.mark.long
def test_each_shows_a_table_and_its_drawing(tmp_path: Path) -> None:
    """What the last three cells show, by media type; in one test, since the batch solver is what takes time."""
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in CELLS])
    NotebookClient(book, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [cell.outputs[-1].data for cell in book.cells[1:4]]
    assert ElementTree.fromstring(outputs[0]["image/svg+xml"]).tag.endswith("svg")
    assert drawing(outputs[0]["text/html"]).split() == outputs[0]["image/svg+xml"].split()
    for data in outputs[1:]:  # as SVG text they would be large
        assert "image/svg+xml" not in data
        assert f"data:image/png;base64,{data['image/png'].strip()}" in data["text/html"]
        assert sum(map(len, data.values())) < 140_000
    modelled, solved, searched = (data["text/html"] for data in outputs)
    assert "linear program" in modelled
    assert "collapse" in solved
    assert "relative width" in solved
    assert "not proven" in searched
    assert "30 layouts" in searched
    assert [html.count("<table") for html in (modelled, solved, searched)] == [1, 1, 3]
    assert "largest_block_cells" in searched
    _check_page(book)


def _check_page(book: nbformat.NotebookNode) -> None:
    """The interactive page of the last cell: static HTML, then a widget; 200 kB of the file at the most."""
    static, widget = book.cells[-1].outputs
    assert set(static.data) == {"text/html", "text/plain"}
    assert "<iframe" in static.data["text/html"]
    assert "application/vnd.jupyter.widget-view+json" in widget.data
    assert widget.data["text/plain"] == "(The sliders of the page above need a running kernel.)"
    whole = len(nbformat.writes(book).encode())
    states = len(str(book.metadata.get("widgets", "")))
    assert 0 < states < 10_000  # what is saved of the widget holds no page
    book.cells[-1].outputs = []
    book.metadata.pop("widgets")
    assert 50_000 < whole - len(nbformat.writes(book).encode()) < 200_000


def test_names_are_text_and_not_markup() -> None:
    scene = load_scene(SCENES / "ferris_tinloi_1.json").model_copy(update={"name": "<b>wall</b> & arch"})
    html = build_assembly(scene)._repr_html_()
    assert "<b>" not in html
    assert "&lt;b&gt;wall&lt;/b&gt; &amp; arch" in html


def locked() -> LimitAnalysisResult:
    """A cell between two supports, pressed against one of them."""
    return solve(
        build_assembly(
            parse_scene(
                {
                    "name": "wedged",
                    "grid": {"cell": [1.0, 1.0], "rows": ["#a#"]},
                    "materials": {"density": 1.0, "dry": {"friction_coefficient": 0.6}},
                    "loads": {"live": [{"element": "c1r0", "force": [1.0, 0.0]}]},
                }
            )
        )
    )


def test_results_without_numbers_show_their_status() -> None:
    result = locked()
    assert "none" in result._repr_html_()
    assert str(result.status) in result._repr_html_()
    bare = replace(result, mechanism=None, forces=None, bracket=(np.nan, np.nan))
    assert "<img" in bare._repr_html_()


def test_large_ones_are_not_drawn_unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook, "LARGEST", 2)
    result = locked()
    assert result._repr_svg_() is None
    assert "<img" not in result._repr_html_()
    assert "jld_core.views.figures" in result._repr_html_()


def test_drawing_code_is_not_imported_before_it_is_wanted() -> None:
    asked = "import sys, jld_explore.cli.command; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0


# Pages in notebooks: what is left without a kernel, and what the kernel solves again for the sliders.


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
    monkeypatch.setattr(
        notebook_of_page, "_plain", lambda title, facts, drawing, *tables: notebook_of_page.html.escape(title)
    )
    for kind in (Exploration, LimitAnalysisResult):
        monkeypatch.setattr(kind, "drawn", lambda *_: None)


@pytest.fixture(scope="module")
def shown(study: Exploration) -> Any:
    page: Any = study.show()
    return page


def ask(page: Any, labelling: str, materials: Any) -> dict[str, Any]:
    """An answer of the kernel, as it travels."""
    asked = {"kind": "solve", "labelling": labelling, "materials": materials, "revision": 3}
    answer: dict[str, Any] = json.loads(json.dumps(page.answer(asked), allow_nan=False))
    assert (answer["kind"], answer["revision"]) == ("answer", 3)
    return answer


def test_without_scripts_there_are_facts_picture_and_table(shown: Any) -> None:
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
    study: Exploration, shown: Any, monkeypatch: pytest.MonkeyPatch, unpictured: None
) -> None:
    """Fewer rows, and then no page at all, where they would not fit; the kernel sends the page all the same."""
    assert len(shown.html) < notebook_of_page.LARGEST
    assert shown.answer({"kind": "page"})["html"].startswith("<!doctype html>")
    whole = study.show()
    monkeypatch.setattr(notebook_of_page, "_ROWS", ((60, 20), (2, 1)))
    monkeypatch.setattr(notebook_of_page, "LARGEST", len(whole.html) - 2000)
    less = study.show()
    assert len(less.html) < len(whole.html)
    assert "<iframe" in less.html
    monkeypatch.setattr(notebook_of_page, "LARGEST", 40_000)
    least = study.show()
    assert "<iframe" not in least.html
    assert least.answer({"kind": "page"})["html"].startswith("<!doctype html>")


def test_without_the_library_the_output_names_the_extra(monkeypatch: pytest.MonkeyPatch, unpictured: None) -> None:
    monkeypatch.setattr(notebook_of_page, "_has_anywidget", lambda: False)
    page = load_scene(ARCH).show()
    assert "pip install &#x27;jld[notebook]&#x27;" in page.html
    assert page.widget() is None


def test_the_widget_answers_requests_of_the_page(shown: Any, monkeypatch: pytest.MonkeyPatch) -> None:
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
    structure = notebook_of_page.AssemblyStructure(assembly)
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
    solver = notebook_of_page.LayoutSolver(notebook_of_page.structure_of(wall, build_assembly(wall)))
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
def test_unsolvable_requests_are_refused_in_one_line(shown: Any, letters: Any, materials: Any, words: str) -> None:
    own = shown._data["solutions"]["0"]["labelling"]
    if materials == {}:
        materials = shown._solver._structure.materials
    answer = ask(shown, own if letters is None else letters, materials)
    assert words in answer["error"]
    assert "\n" not in answer["error"]


def test_blocks_that_crack_by_cells_fix_the_sliders(study: Exploration, unpictured: None) -> None:
    cells = replace(study, scene=study.scene.model_copy(update={"cracks": cracks.CellCracks(kind="cells", cell=0.05)}))
    assert "crack by cells or fields" in cells.show().html


@pytest.mark.parametrize("height", [5, 1e3, "tall"])
def test_bad_heights(height: Any) -> None:
    with pytest.raises(InputError, match="height"):
        load_scene(ARCH).show(height=height)


def test_the_frame_unpacks_to_the_page(shown: Any, tmp_path: Path) -> None:
    import base64
    import gzip
    import html

    text = html.unescape(shown.html)
    (packed,) = re.findall(r'atob\("([^"]+)"\)', text)
    assert gzip.decompress(base64.b64decode(packed)).decode() == shown.answer({"kind": "page"})["html"]


# The example notebooks run from top to bottom, and what they show stays small.


NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MOST = 200_000  # bytes that one output may add to a notebook


def read(path: Path) -> nbformat.NotebookNode:
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    return book


def test_they_are_committed_without_outputs() -> None:
    assert [path.stem for path in NOTEBOOKS] == [
        "1_first_load_factor", "2_search_and_front", "3_moving_joints", "4_spatial_vault", "5_drawing_to_blocks",
        "6_cut_a_solid",
    ]  # fmt: skip
    guide = (ROOT / "docs" / "guide" / "notebooks.md").read_text("utf-8")
    for path in NOTEBOOKS:
        assert path.stat().st_size < 8_000
        assert all(cell.get("outputs", []) == [] for cell in read(path).cells)
        assert f"`{path.name}`" in guide


def run(book: nbformat.NotebookNode) -> list[Any]:
    """The values that end cells, as a kernel would have them, in this process."""
    space: dict[str, Any] = {}
    shown = []
    for number, cell in enumerate(book.cells):
        if cell.cell_type != "code":
            continue
        tree = ast.parse(cell.source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"cell {number}", "exec"), space)
        if last is not None:
            shown.append(eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), space))
    return [value for value in shown if value is not None]


def test_the_first_one_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """In this process; all six in kernels of their own are run by `make bench`."""
    result, table, page = run(read(NOTEBOOKS[0]))
    assert f"λ = {result.load_factor:.6f}, proven between" in capsys.readouterr().out
    assert len(table) == len(result.assembly.interfaces)
    assert "<iframe" in page.html


@pytest.mark.long
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_all_of_them_run_in_a_kernel(path: Path, tmp_path: Path) -> None:
    book = read(path)
    NotebookClient(book, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells for output in cell.get("outputs", [])]
    assert not [output for output in outputs if output.output_type == "error"]
    assert max(len(nbformat.writes(nbformat.v4.new_notebook(cells=[cell]))) for cell in book.cells) < MOST
    if path.stem == "6_cut_a_solid":  # its parts have a page of their own
        assert [o for o in book.cells[-1].outputs if "image/png" in o.data]
        return
    (page,) = [o for o in book.cells[-1].outputs if "text/html" in o.data]
    assert re.search("<div data-jld=", page.data["text/html"])
