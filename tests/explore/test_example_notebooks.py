"""The example notebooks run from top to bottom, and what they show stays small."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from paths import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MOST = 200_000  # bytes that one output may add to a notebook


def read(path: Path) -> nbformat.NotebookNode:
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    return book


def test_they_are_committed_without_outputs() -> None:
    assert [path.stem for path in NOTEBOOKS] == [
        "1_first_load_factor", "2_search_and_front", "3_moving_joints", "4_spatial_vault", "5_drawing_to_blocks",
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
    """In this process; all five in kernels of their own are run by `make bench`."""
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
    (page,) = [o for o in book.cells[-1].outputs if "text/html" in o.data]
    assert re.search("<div data-jld=", page.data["text/html"])
