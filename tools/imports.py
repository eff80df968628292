"""Import every name from the package that exports it, else from the module that defines it: `python tools/imports.py`.

Run it after a merge, or after a name was added to an `__all__` or removed from it; `ruff check --fix` and `ruff format`
then put the lines in order. `tests/conformance/test_structure.py` checks the result.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
SOURCES: Final = ROOT / "src"
FOLDERS: Final = ("src", "tests", "benchmarks", "studies", "tools")
MISSION: Final = ("jld_core", "jld_explore")
"""Packages that never import another one of this project; what add-ons import is exported by them."""


def path_of(module: str) -> Path | None:
    """Return the file of a module or package of this project, None if there is none."""
    place = SOURCES.joinpath(*module.split("."))
    found = [one for one in (place / "__init__.py", place.with_suffix(".py")) if one.exists()]
    return found[0] if found else None


@cache
def exported(package: str) -> frozenset[str]:
    """Return the names in the `__all__` of a package; empty without one."""
    path = path_of(package)
    for node in ast.parse(path.read_text("utf-8")).body if path is not None else []:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            if isinstance(target, ast.Name) and target.id == "__all__" and isinstance(node.value, ast.List):
                return frozenset(str(one.value) for one in node.value.elts if isinstance(one, ast.Constant))
    return frozenset()


@cache
def defined(path: Path) -> frozenset[str]:
    """Return the names that a file defines at its top level."""
    found: set[str] = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return frozenset(found)


def home_of(module: str, name: str, here: str) -> str:
    """Return the module from which a file `here` imports a name that it imported from `module`."""
    if here.startswith("jld_") and not here.startswith(MISSION) and module.startswith(MISSION):
        faces = [module.rsplit(".", cut)[0] for cut in range(1, module.count(".") + 1)]
        return next((face for face in (module, *faces) if name in exported(face)), module)
    path = path_of(module)
    submodule = path_of(f"{module}.{name}") is not None
    if path is None or submodule or name.startswith("__"):
        return module
    package = ".".join(module.split(".")[:2])
    inside = here == package or here.startswith(f"{package}.")
    if module == package and path.name == "__init__.py" and name not in exported(package):
        files = sorted(path.parent.rglob("*.py"))
        homes = [one for one in files if name in defined(one)]
        if homes:
            return ".".join(homes[0].relative_to(SOURCES).with_suffix("").parts).removesuffix(".__init__")
    module_too = path_of(f"{package}.{name}") is not None
    if module != package and not inside and name in exported(package) and not module_too:
        return package
    return module


def rewritten(text: str, here: str) -> str:
    """Return the text of a file with each name imported from its home."""
    lines = text.splitlines(keepends=True)
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom) and node.module]
    for node in sorted(nodes, key=lambda one: -one.lineno):
        homes: dict[str, list[str]] = defaultdict(list)
        for alias in node.names:
            name = alias.name if alias.asname is None else f"{alias.name} as {alias.asname}"
            homes[home_of(str(node.module), alias.name, here)].append(name)
        if list(homes) != [node.module]:
            indent = " " * node.col_offset
            new = [f"{indent}from {home} import {', '.join(names)}\n" for home, names in sorted(homes.items())]
            lines[node.lineno - 1 : node.end_lineno] = new
    return "".join(lines)


def main() -> None:
    """Rewrite the imports of all Python files of the project, and name the files that changed."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            text = path.read_text("utf-8")
            here = ".".join(path.relative_to(SOURCES).with_suffix("").parts) if folder == "src" else folder
            new = rewritten(text, here.removesuffix(".__init__"))
            if new != text:
                path.write_text(new, "utf-8")
                print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
