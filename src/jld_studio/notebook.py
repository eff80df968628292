"""Show scenes, results and finished searches in notebooks as the interactive page.

The HTML of the output needs no kernel; an invisible widget, by anywidget, connects its frame with the kernel.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import uuid
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from jld_core import (
    FACTS,
    Assembly,
    InputError,
    LimitAnalysisResult,
    ParameterError,
    Result,
    Route,
    Scene,
    SolveOptions,
    build_assembly,
    parse_scene,
)
from jld_core import assembly as structures
from jld_core.build import build_geometry
from jld_core.models import CaseAnalysis, solve_by_elements
from jld_core.scene import standard
from jld_explore import Exploration
from jld_explore.report import words
from jld_explore.space import cut, from_string
from jld_views import notebook, page_contract, page_data, page_of_study, png_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_ROUTE: Final = Route("sliders of materials", frozenset(FACTS))  # faces with a criterion have none

_MOST_ANALYSES: Final = 8  # number of materials whose analyses are stored

# Field of `Strengths` of each material value that a slider may state
_STRENGTHS: Final = {(one.label, one.key): one.field for one in standard.PARAMETERS}


class Structure(Protocol):
    materials: dict[str, Any]
    """Its materials, in the form of a scene file."""

    def with_materials(self, materials: Mapping[str, Any]) -> Assembly:
        """Return its assembly under other materials; raise InputError if they are invalid."""


class SceneStructure:
    """Scene whose materials can be changed; its geometry is built once."""

    def __init__(self, scene: Scene) -> None:
        self._document = scene.model_dump(mode="json", exclude_defaults=True)
        self._geometry = build_geometry(scene)
        self.materials: dict[str, Any] = self._document.get("materials", {})

    def with_materials(self, materials: Mapping[str, Any]) -> Assembly:
        """Return the assembly of the scene under other materials; raise InputError if they are invalid."""
        return build_assembly(parse_scene({**self._document, "materials": dict(materials)}), self._geometry)


class AssemblyStructure:
    """Assembly without its scene; a slider's value is the median over faces, which keep their ratio to it."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self.materials: dict[str, Any] = {}
        strengths = assembly.strengths(_ROUTE)
        for (part, key), name in _STRENGTHS.items():
            values = getattr(strengths, name)[: assembly.faces]
            finite = values[np.isfinite(values)]
            if finite.size and float(np.median(finite)) > 0.0:
                self.materials.setdefault(part, {})[key] = float(np.median(finite))

    def with_materials(self, materials: Mapping[str, Any]) -> Assembly:
        """Return the assembly with scaled strengths; raise InputError for a value that is no number of at least 0."""
        assembly = self._assembly
        factors = {}
        for (part, key), name in _STRENGTHS.items():
            usual = self.materials.get(part, {}).get(key)
            if usual is None:
                continue
            value = materials.get(part, {}).get(key, usual)
            if not (isinstance(value, int | float) and np.isfinite(value) and value >= 0.0):
                raise InputError(f"materials.{part}.{key}", f"it is {value!r}", "a number of at least 0")
            factors[name] = float(value) / usual
        faces = np.arange(len(assembly.interfaces)) < assembly.faces
        return replace(assembly, face_strengths=assembly.face_strengths.scaled(factors, faces))


def bonded(assembly: Assembly) -> bool:
    """Return True if dry joints have a bond, which couples strengths and dead loads."""
    return assembly.members.bond is not None


def structure_of(scene: Scene | None, assembly: Assembly) -> Structure:
    """Return the structure of an assembly whose materials can be changed."""
    if scene is None or assembly.has_low_values:
        return AssemblyStructure(assembly)
    structure = SceneStructure(scene)
    values = [value for part in ("dry", "inner") for value in structure.materials.get(part, {}).values()]
    plain = all(isinstance(value, int | float) for value in values)
    return structure if plain else AssemblyStructure(assembly)


class LayoutSolver:
    """Solver of layouts of one structure under changing materials.

    structure: structure with its materials. model: model of all solves.
    """

    def __init__(self, structure: Structure, model: SolveOptions | None = None) -> None:
        self._structure, self._model = structure, model
        self._analyses: OrderedDict[str, CaseAnalysis] = OrderedDict()

    def solve(self, letters: object, materials: object) -> page_contract.Solution:
        """Solve a layout (letters d, i and v) under materials of a scene file; return what a page draws."""
        if not isinstance(materials, dict):
            raise InputError("materials", "they are no JSON object", "materials as in a scene file")
        name = json.dumps(materials, sort_keys=True)
        if name not in self._analyses:
            self._analyses[name] = CaseAnalysis(self._structure.with_materials(materials), self._model)
        self._analyses.move_to_end(name)
        while len(self._analyses) > _MOST_ANALYSES:
            self._analyses.popitem(last=False)
        analysis = self._analyses[name]
        count = analysis.assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip("div"):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d, i or v")
        if "v" in letters:
            structure, labels = cut(analysis.assembly, letters)
            return page_data.within(
                page_data.solution_of(CaseAnalysis(structure, self._model).solve(labels)), analysis.assembly, letters
            )
        return page_data.solution_of(analysis.solve(structures.with_members(analysis.assembly, from_string(letters))))


# Largest size of the HTML of one output with a page, bytes, so that a search adds at most 200 kB to a notebook.
LARGEST: Final = 190_000

# Strongest rows of the table, and layouts solved besides those of the front, of which the first that fit are shown
_ROWS: Final = ((1000, 20), (300, 8), (100, 3), (30, 1))

_EXTRA: Final = "pip install 'jld[notebook]'"  # command that installs what the sliders need

_NO_KERNEL: Final = "The sliders need a running kernel: run this cell again."
_NO_LIBRARY: Final = f"The sliders need the library anywidget: {_EXTRA}, then run this cell again."
_BRIDGE: Final = "(The sliders of the page above need a running kernel.)"
_BOND: Final = (
    "The sliders do not apply: the strengths of joints with a bond change their loads as well. Show the scene."
)
_FIELDS: Final = "The sliders do not apply: the blocks of this search crack by cells or fields."


class NotebookPage:
    """Interactive page of a scene, a result or a search; pages: data, the largest first; height: pixels."""

    def __init__(
        self, title: str, plain: str, pages: Iterator[page_contract.PageData], solver: LayoutSolver, height: int
    ) -> None:
        self._title, self._solver, self._height = title, solver, height
        self._identifier = uuid.uuid4().hex
        self._plain = plain
        # A frame that makes the output larger than LARGEST gives way to that of the next smaller page, or to none.
        first = next(pages)
        data: page_contract.PageData | None = first
        frame: str | None = _frame(first, height)
        while frame is not None and len(plain) + len(frame) > LARGEST:
            data = next(pages, None)
            frame = None if data is None else _frame(data, height)
        self._data = data or first
        self._frame_html = frame or ""
        self.html = self._html()
        """HTML of the first part of the output."""

    def __repr__(self) -> str:
        return f"NotebookPage({self._title!r})"

    def _html(self) -> str:
        data = self._data["notebook"]
        assert data is not None
        rows = "".join(
            f"<label>{html.escape(name)} <input type=range disabled> {value:.4g}</label><br>"
            for name, value in _sliders(data["materials"])
        )
        sliders = f"<p>{rows}{html.escape(data['why'])}</p>"
        plain = f"<div data-plain>{self._plain}{sliders}</div>"
        return f'<div data-jld="{self._identifier}">{plain}{self._frame_html}</div>'

    def _repr_html_(self) -> str:
        """Return the first part of the output, as programs call for it that show HTML."""
        return self.html

    def _ipython_display_(self) -> None:
        from IPython.display import display  # a notebook has it

        display({"text/html": self.html, "text/plain": repr(self)}, raw=True)
        if (bridge := self.widget()) is not None:
            display(bridge)

    def widget(self) -> Any:
        if not _has_anywidget():
            return None
        import anywidget
        import traitlets

        members = {
            "_esm": page_data.asset("bridge.js"),
            "page": traitlets.Unicode("").tag(sync=True),
            "__repr__": lambda _: _BRIDGE,  # what is seen of it where nothing shows widgets
        }
        bridge = type("PageBridge", (anywidget.AnyWidget,), members)(page=self._identifier)
        bridge.on_msg(lambda widget, message, buffers: widget.send(self.answer(message)))
        return bridge

    def answer(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Answer a message of the page by one of its kind: page, solution, or "error", one line."""
        kind = message.get("kind")
        if kind == "page":
            return {"kind": "page", "html": page_data.page(self._data), "height": self._height}
        if kind != "solve":
            return {"kind": "hello"}
        try:
            content = {"solution": self._solver.solve(message.get("labelling"), message.get("materials"))}
        except InputError as error:
            content = {"error": str(error)}  # type: ignore[dict-item]
        return {"kind": "answer", "revision": message.get("revision"), **content}


def make_page(thing: object, height: int | None = None) -> NotebookPage:
    """Make the page of a scene, an assembly, a result or a finished search, shown as the last line of a cell."""
    if height is not None and (not isinstance(height, int) or not 100 <= height <= 10_000):
        raise ParameterError("height", f"it is {height!r}", "pixels, a whole number from 100 to 10000")
    if isinstance(thing, Exploration):
        return _study_page(thing, height or 950)
    if isinstance(thing, Scene | Assembly):
        scene, assembly = (thing, build_assembly(thing)) if isinstance(thing, Scene) else (None, thing)
        result = solve_by_elements(assembly, assembly.labels, what="the page of a notebook")
        # of cells no sliders know the scene: they scale the strengths of the cells
        return _result_page(scene if assembly.cracks == "faces" else None, result, height or 700)
    if isinstance(thing, LimitAnalysisResult):
        return _result_page(None, thing, height or 700)
    if isinstance(thing, Result):
        raise InputError("cracks", "the page of a notebook needs rigid cells, and fields have none", "`result.plot()`")
    raise TypeError(f"{type(thing).__name__} has no page")


def _result_page(scene: Scene | None, result: LimitAnalysisResult, height: int) -> NotebookPage:
    """Return the page of one layout; `scene` is None where only its assembly is known."""
    structure = structure_of(scene, result.assembly)
    data = page_of_study.result_data(scene, result)
    data["notebook"] = _slider_data(structure, _BOND if scene is None and bonded(result.assembly) else None)
    facts = {fact["name"]: fact["value"] for fact in data["facts"]}
    drawing = None if len(result.assembly.elements) > notebook.LARGEST else result.drawn()
    plain = _plain(result.assembly.name, facts, drawing)
    solver = LayoutSolver(structure, result.model)
    return NotebookPage(result.assembly.name, plain, iter([data]), solver, height)


def _slider_data(structure: Structure, obstacle: str | None) -> page_contract.Notebook:
    """Return what the sliders of a page need; obstacle: why they never apply."""
    return {
        "materials": structure.materials,
        "why": _why() if obstacle is None else obstacle,
        "fixed": obstacle is not None,
    }


def _study_page(done: Exploration, height: int) -> NotebookPage:
    structure = structure_of(done.scene, done.assembly)
    obstacle = None if done.scene.cracks == "faces" else _FIELDS

    def pages() -> Iterator[page_contract.PageData]:
        for most_rows, solved_rows in _ROWS:
            data = page_of_study.study_data(done, most=most_rows, solved=solved_rows)
            data["notebook"] = _slider_data(structure, obstacle)
            yield data

    tables = {"strongest": words.best_rows(done), f"front, {words.front_name(done)}": done.front.head(30)}
    tables_html = [
        f"<p>{html.escape(name)}</p>{table[words.columns(done)].to_html(index=False)}" for name, table in tables.items()
    ]
    drawing = None if len(done.assembly.elements) > notebook.LARGEST else done.drawn()
    plain = _plain(done.scene.name, words.facts_of_exploration(done), drawing, *tables_html)
    return NotebookPage(done.scene.name, plain, pages(), LayoutSolver(structure, done.model), height)


def _plain(title: str, facts: Mapping[str, str], drawing: Figure | None, *tables: str) -> str:
    """Return facts, picture and tables as HTML without scripts."""
    return notebook.page(title, facts, None if drawing is None else png_of(drawing), *tables)


def _frame(data: page_contract.PageData, height: int) -> str:
    packed = base64.b64encode(gzip.compress(page_data.page(data).encode("utf-8"), compresslevel=9, mtime=0)).decode(
        "ascii"
    )
    text = page_data.asset("frame.html").replace("{{packed}}", packed)
    style = f"width: 100%; height: {height}px; border: 1px solid #888"
    return f'<iframe title="interactive page" style="{style}" srcdoc="{html.escape(text)}"></iframe>'


def _sliders(materials: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    for part in ("dry", "inner"):
        for key, value in materials.get(part, {}).items():
            if isinstance(value, int | float):
                yield f"{key.replace('_', ' ')}, {part}", float(value)


def _has_anywidget() -> bool:
    from importlib.util import find_spec

    return find_spec("anywidget") is not None


def _why() -> str:
    """Say why sliders do nothing where no kernel is connected."""
    return _NO_KERNEL if _has_anywidget() else _NO_LIBRARY
