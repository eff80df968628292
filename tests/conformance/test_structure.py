"""The direction in which wings depend on one another: no import against it, no circle, each by its face."""

from __future__ import annotations

import ast
import importlib
import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tools.imports import rewritten

from cases import grid_assembly, grid_document
from jld_core import FACTS, InputError, Route, build_assembly

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src"

# each line may use those below it, and what stands beside it in its own line only where listed later
ORDER = [
    ["jld_explore.__main__"],
    ["jld_studio"],
    ["jld_practice"],
    ["jld_maps"],
    ["jld_geometry"],
    ["jld_experiment"],
    ["jld_formats"],
    ["jld_samples"],
    ["jld_dilation"],
    ["jld_surfaces"],
    ["jld_views"],
    ["jld_masonry"],
    ["jld_tilting"],
    ["jld_cut"],
    ["jld_explore.cli"],
    ["jld_explore"],
    ["jld_explore.explore", "jld_explore.sweep"],
    ["jld_explore.steps"],
    ["jld_explore.report"],
    ["jld_explore.search"],
    ["jld_explore.drivers"],
    ["jld_explore.evaluation"],
    ["jld_explore.space"],
    ["jld_explore.verification"],
    ["jld_core"],
    ["jld_core.exchange"],
    ["jld_core.layout"],
    ["jld_core.views"],
    ["jld_core.models"],
    ["jld_core.limit"],
    ["jld_core.solvers"],
    ["jld_core.fields"],
    ["jld_core.batch"],
    ["jld_core.program"],
    ["jld_core.refinement"],
    ["jld_core.mechanics", "jld_core.build"],
    ["jld_core.geometry"],
    ["jld_core.assembly"],
    ["jld_core.strengths"],
    ["jld_core.scene"],
    ["jld_core.loads"],
    ["jld_core.samples"],
    ["jld_core.plugins", "jld_core.linalg", "jld_core.files", "jld_core.parameters"],
    [
        "jld_core.notebook_repr",
        "jld_core.arrays",
        "jld_core.deadline",
        "jld_core.errors",
        "jld_core.lazy_exports",
        "jld_core.threads",
        "jld_core.tolerances",
        "jld_core._version",
    ],
]
FLOOR = {wing: len(ORDER) - floor for floor, wings in enumerate(ORDER) for wing in wings}

# packages that are one wing: add-ons, which core and explore never import
FLAT = [
    "jld_studio",
    "jld_practice",
    "jld_geometry",
    "jld_experiment",
    "jld_dilation",
    "jld_formats",
    "jld_samples",
    "jld_maps",
    "jld_views",
    "jld_masonry",
    "jld_surfaces",
    "jld_tilting",
    "jld_cut",
]

MODULES = {path: ".".join(path.relative_to(SOURCES).with_suffix("").parts) for path in sorted(SOURCES.rglob("*.py"))}


def wing_of(module: str) -> str:
    """The wing that a module stands in: its longest listed prefix; the package itself only for its own face."""
    parts = module.split(".")
    if parts[0] in FLAT:
        return parts[0]
    named = [".".join(parts[:k]) for k in range(2, len(parts) + 1) if ".".join(parts[:k]) in FLOOR]
    return named[0] if named else module.removesuffix(".__init__")


@cache
def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a file, parsed once for all tests."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def import_nodes(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """Return the import statements of a file, wherever they stand."""
    found, waiting = [], list(parsed(path).body)
    while waiting:  # statements alone: they are a tenth of the nodes that `ast.walk` visits
        node: Any = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.append(node)
        for part in ("body", "orelse", "finalbody"):
            waiting += getattr(node, part, [])
        for holder in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
            waiting += holder.body
    return found


@cache
def imports(path: Path) -> list[tuple[str, int, bool]]:
    """Every module that a file imports, lazily or not: name, line, whether at the top of the file."""
    return list(_imports(path))


def _imports(path: Path) -> Iterator[tuple[str, int, bool]]:
    top = set(map(id, parsed(path).body))
    for node in import_nodes(path):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: a relative import"
            module = node.module or ""
            for alias in node.names:
                full = f"{module}.{alias.name}"
                yield (full if _is_module(full) else module), node.lineno, id(node) in top
        else:
            for alias in node.names:
                yield alias.name, node.lineno, id(node) in top


@cache
def _is_module(name: str) -> bool:
    places = [root.joinpath(*name.split(".")) for root in (SOURCES, ROOT)]
    return any(place.with_suffix(".py").exists() or (place / "__init__.py").exists() for place in places)


def test_imports_run_downwards() -> None:
    against = []
    for path, name in MODULES.items():
        here = wing_of(name)
        for module, line, _ in imports(path):
            there = wing_of(module)
            if module.split(".")[0] not in ("jld_core", "jld_explore", "jld_experiment") or here in (module, there):
                continue
            assert here in FLOOR, f"{name} stands in no wing of ORDER"
            if FLOOR[there] >= FLOOR[here]:
                against.append(f"{path}:{line}: {here} may not use {there}")
    assert against == []


MOST_EXPORTED = 240
"""Exported names and modules of core and explore together: what add-ons and plug-ins may use."""


@cache
def exported(package: str) -> list[str]:
    """The names that a package exports; none of a module."""
    return list(getattr(importlib.import_module(package), "__all__", []))


@cache
def defined(module: str) -> set[str]:
    """The names that a module defines itself, imported ones left out."""
    tree = parsed(next(path for path, name in MODULES.items() if name == module))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return found


def test_names_are_imported_from_the_exporting_package_or_the_defining_module() -> None:
    """What a package exports is imported from it; any other public name is imported from its own module."""
    wrong = []
    for path, name in MODULES.items():
        for node in import_nodes(path):
            if isinstance(node, ast.ImportFrom) and wing_of(node.module or "") in FLOOR:
                wrong += [f"{path}:{node.lineno}: {problem}" for problem in _wrong_imports(node, wing_of(name))]
    assert wrong == []


def _wrong_imports(node: ast.ImportFrom, here: str) -> Iterator[str]:
    """Yield what is wrong with the names that a module of one sub-package imports from another one."""
    module = str(node.module)
    there = wing_of(module)
    if there == here:
        return
    if here in FLAT and there not in FLAT:  # as a package of a stranger: exported names only
        for name in sorted({alias.name for alias in node.names} - set(exported(module))):
            if not SOURCES.joinpath(*module.split("."), name, "__init__.py").exists():
                yield f"{name} is not exported by {module}"
        return
    for name in (alias.name for alias in node.names):
        if _is_module(f"{module}.{name}"):
            continue
        if module == there:
            if exported(there) and name not in exported(there):
                yield f"{name} is not exported by {there}; run tools/imports.py"
        elif "._" in f"{module}.{name}":
            yield f"{name} is private"
        elif name in exported(there) and not _is_module(f"{there}.{name}"):
            yield f"{name}: from {there}"
        elif name not in defined(module):
            yield f"{name} is not defined in {module}"


def test_the_tool_finds_the_home_of_a_name() -> None:
    """What to run after a merge that fails the test above."""
    text = "from jld_core.limit import Relaxation, governing\nfrom jld_core.scene.schema import Search, Dry\n"
    assert rewritten(text, "jld_explore.search.study").splitlines() == [
        "from jld_core.limit import governing",
        "from jld_core.limit.case_relaxation import Relaxation",
        "from jld_core.scene import Search",
        "from jld_core.scene.schema import Dry",
    ]
    assert rewritten(text, "jld_core.scene.reading").splitlines()[-1] == "from jld_core.scene.schema import Search, Dry"


def test_few_names_are_exported() -> None:
    names = [name.removesuffix(".__init__") for name in MODULES.values() if name.endswith("__init__")]
    packages = [name for name in names if name.split(".")[0] not in FLAT]
    assert sum(len(exported(package)) for package in packages) <= MOST_EXPORTED


def test_no_circle_of_files() -> None:
    graph: dict[str, set[str]] = {}
    for folder in (SOURCES, ROOT / "studies", ROOT / "benchmarks"):
        root = SOURCES if folder == SOURCES else ROOT
        for path in sorted(folder.rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            graph[name] = {module for module, _, _ in imports(path)}
    # a face hands names on; the circle that counts is one of rooms
    rooms = {name: {m for m in used if m in graph and m != name} for name, used in graph.items()}
    done: set[str] = set()
    while len(done) < len(rooms):
        free = {name for name, used in rooms.items() if name not in done and used <= done}
        assert free, "a circle among " + ", ".join(sorted(set(rooms) - done))
        done |= free


def test_modules_are_short() -> None:
    """A module is a concept that is read at a sitting."""
    lines = {str(path): len(path.read_text("utf-8").splitlines()) for path in MODULES}
    assert len(lines) > 200
    assert {path: count for path, count in lines.items() if count > 800} == {}


def test_functions_are_short() -> None:
    """Bodies of functions, without signature and docstring, have at most 60 lines."""
    long_functions = {}
    for path in MODULES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[1:] if ast.get_docstring(node) is not None else node.body
                lines = (node.end_lineno or 0) - body[0].lineno + 1 if body else 0
                if lines > 60:
                    long_functions[f"{path}: {node.name}"] = lines
    assert long_functions == {}


PROVING = ("fields", "limit", "models", "program", "mechanics", "drivers", "evaluation", "space", "search", "report")


def test_tolerances_that_others_may_use_stand_in_one_place() -> None:
    """A public constant of the size of a tolerance; what steers a method alone is private to its module."""
    elsewhere = []
    for path in (path for path, name in MODULES.items() if name.split(".")[1] in PROVING):
        for node in parsed(path).body:
            if not isinstance(node, ast.AnnAssign | ast.Assign) or not isinstance(node.value, ast.Constant):
                continue
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            number = node.value.value
            small = isinstance(number, float) and number <= 1e-3
            if isinstance(target, ast.Name) and small and not target.id.startswith("_"):
                elsewhere.append(f"{path}: {target.id} belongs to tolerances.py")
    assert elsewhere == []


@pytest.mark.parametrize("wing", sorted(set(FLOOR)))
def test_every_package_lists_its_exports(wing: str) -> None:
    module = importlib.import_module(wing)
    if wing.endswith("__main__") or not str(module.__file__).endswith("__init__.py") or wing == "jld_explore.cli":
        return
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is not None
    if "." not in wing:  # the face of a whole package is its table of contents
        described = re.findall(r"^- `(\w+)`: \S", str(module.__doc__), flags=re.M)
        assert described == module.__all__, f"{wing}: one line per name in the docstring of its face, in the same order"


def test_files_of_tests_have_names_of_their_own() -> None:
    """Helpers and tests are imported by their base names: of two files with one name pytest takes one for the other."""
    paths = [path for path in (ROOT / "tests").rglob("*.py") if "plugin" not in path.parts]
    names = Counter(path.name for path in paths if path.name != "conftest.py")
    assert [name for name, count in names.items() if count > 1] == []


def test_public_names() -> None:
    import jld_core
    import jld_explore

    core = """blocks_of Scene load_scene parse_scene Assembly build_assembly Model SolveOptions solve solve_many
    BatchResult geometry_sensitivities LimitAnalysis LimitAnalysisResult Result Status InputError SolverError samples
    exchange Layout blocks_csv resultants views solvers
    Bits Bools Floats Ints Elements LoadCase Loads Deadline DeadlinePassed checkpoint time_left
    ParameterError error_context FACTS Route Strengths one_thread export_lazily files parameters plugins assembly
    tolerances"""
    explore = """explore ModelSettings BudgetSettings ParallelSettings SearchMethod OutputSettings ExploreSettings
    Exploration Summary read_folder SearchSpace search_space Driver Evaluation Progress
    Step StepContext StopReason Interrupted busy_factor most_without_cuts sweep with_entries"""
    assert sorted(jld_core.__all__) == sorted(core.split())
    assert sorted(jld_explore.__all__) == sorted(explore.split())


# The numbers of strengths are read by routes that know every fact in them, and by nobody else.


OWNER = "jld_core/strengths.py"
PRIVATE = {"_stated_numbers", "_nominal_numbers"}


def _modules(*words: str) -> Iterator[tuple[str, ast.Module]]:
    """Modules that hold one of the words."""
    for path in sorted(SOURCES.rglob("*.py")):
        if any(word in path.read_text(encoding="utf-8") for word in words):
            yield path.relative_to(SOURCES).as_posix(), parsed(path)


def _name(node: ast.AST) -> str:
    """Return the attribute, keyword or string that a node of a syntax tree states."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return str(node.arg if isinstance(node, ast.keyword) else node.value if isinstance(node, ast.Constant) else "")


def test_nobody_else_reads_the_numbers() -> None:
    """Private fields stand in the owner alone, and `strengths` of a structure is called with a route."""
    wrong = []
    for name, tree in _modules("strengths", *PRIVATE):
        calls = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args}
        for node in ast.walk(tree):
            if name != OWNER and _name(node) in PRIVATE:
                wrong.append(f"{name}: {_name(node)}")
            if isinstance(node, ast.Attribute) and node.attr == "strengths" and id(node) not in calls:
                owner = ast.unparse(node.value)
                wrong += [f"{name}: {owner}.strengths is no call with a route"] if "assembly" in owner else []
    assert not wrong


def test_a_route_states_facts_that_exist() -> None:
    for name, tree in _modules("_ROUTE"):
        for node in ast.walk(tree):
            if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "_ROUTE" and node.value is not None:
                route = eval(ast.unparse(node.value), vars(sys.modules[Route.__module__]))
                assert set(FACTS) >= route.KNOWS, f"{name}: {route}"


@pytest.mark.parametrize("label", ["dry", "inner"])
def test_a_fact_that_a_route_does_not_know_is_refused(label: str) -> None:
    document = grid_document(["ab", "##"])
    document["materials"][label] = {"surface": {"hoek_brown": {"compressive_strength": 1e6, "m": 7.0, "s": 0.1}}}
    assembly = build_assembly(document)
    route, other = Route("the experiment"), np.full(len(assembly.interfaces), label == "inner")
    with pytest.raises(InputError, match=rf'^materials.{label}.surface: "surface" is unknown to the experiment; '):
        assembly.strengths(route)
    numbers = assembly.strengths(Route("programs", frozenset(FACTS)))
    # of one labelling, only the label that the surface is for counts
    assert assembly.strengths(route, other) is numbers


def test_a_standard_fact_is_refused_in_the_same_way() -> None:
    assembly = grid_assembly(["ab", "##"])
    with pytest.raises(InputError, match=r"friction of joints \(face c0r0–c1r0\) is unknown to a printer; expected"):
        assembly.strengths(Route("a printer", frozenset()))
