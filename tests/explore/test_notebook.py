"""Results show themselves in a notebook: in a real batch solver, as Jupyter would ask them."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

from jld_core import LimitAnalysisResult, build_assembly, load_scene, parse_scene, solve
from jld_core.views import notebook
from paths import SCENES

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
