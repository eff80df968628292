"""Plug-ins: what packages beside jld add, by their entry points (docs/guide/plugins.md)."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jld_core.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUPS: Final = {  # group of entry points → what an object of it is
    "jld.drivers": "a search driver",
    "jld.counts": "a count of layouts",
    "jld.objectives": "an objective of a search",
    "jld.criteria": "a yield criterion",
    "jld.commands": "a command",
    "jld.steps": "a step after a search",
    "jld.formats": "a file format",
    "jld.parts": "a part of jld",
}


@cache
def entry_points(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, sorted; raise InputError for a name given twice."""
    points = list(_installed_entry_points(tuple(sys.path)).select(group=group))
    checkout = _of_checkout()
    if checkout is not None:
        from importlib import metadata

        points = [p for p in points if p.dist is None or p.dist.name != "jld"]
        points += [metadata.EntryPoint(name, value, group) for name, value in checkout.get(group, {}).items()]
    by_name: dict[str, EntryPoint] = {}
    for point in sorted(points, key=lambda point: (point.name, point.value)):
        same_name = by_name.setdefault(point.name, point)
        if same_name.value != point.value:
            packages = " and ".join(f"{package(p)} ({p.value})" for p in (same_name, point))
            problem = f"two packages name {GROUPS[group]} so: {packages}"
            raise InputError(f"plug-in {point.name!r}", problem, "one of them uninstalled")
    return by_name


@cache
def _installed_entry_points(path: tuple[str, ...]) -> Any:
    """Return the entry points of all packages on a path, whose metadata are read once."""
    from importlib import metadata  # takes as long to import as a small scene to solve

    return metadata.entry_points()


@cache
def _of_checkout() -> dict[str, dict[str, str]] | None:
    """Return the entry points of jld's own pyproject.toml, by group and name; None outside a checkout."""
    # What was installed of a checkout may be older than its files.
    path = Path(__file__).parents[2] / "pyproject.toml"
    if not path.exists():
        return None
    import tomllib

    project = tomllib.loads(path.read_text(encoding="utf-8")).get("project", {})
    return project.get("entry-points", {}) if project.get("name") == "jld" else None


@cache
def load(group: str, name: str) -> Any:
    """Import the object of an entry point; raise InputError where that fails."""
    point = entry_points(group)[name]
    try:
        return point.load()
    except InputError:  # it says what it needs
        raise
    except (Exception, SystemExit) as error:  # whatever the code of a stranger raises
        where = f"plug-in {name!r} of the package {package(point)}"
        remedy = f"a package that imports; python -c 'import {point.module}' shows why"
        raise InputError(where, f"{GROUPS[group]} at {point.value} cannot be loaded", remedy) from error


def load_all(group: str, built_in: tuple[str, ...] = ()) -> dict[str, Any]:
    """Import all objects of a group by name; raise InputError where one has the name of a built-in object."""
    for name, point in entry_points(group).items():
        if name in built_in:
            where = f"plug-in {name!r} of the package {package(point)}"
            raise InputError(where, f"jld itself has {GROUPS[group]} of that name", "another name")
    return {name: load(group, name) for name in entry_points(group)}


def refuse_type(group: str, name: str, expected: str, problem: str = "") -> InputError:
    """Return the InputError for an object of a group that is not, or does not do, what it must."""
    point = entry_points(group)[name]
    where = f"plug-in {name!r} of the package {package(point)}"
    return InputError(where, problem or f"{point.value} is not {GROUPS[group]}", expected)


_OWN_WORDS: Final = ("jld_core", "jld_explore", "typer", "click")  # packages whose errors say what is wrong
_LONGEST: Final = 200  # characters of what a stranger's error says


@contextmanager
def guarded(group: str, which: Any) -> Iterator[None]:
    """Make one line that names the package of what its code raises; which: the name of the plug-in, or its object."""
    try:
        yield
    except (InputError, OSError, MemoryError):  # they have lines of their own
        raise
    except (Exception, SystemExit) as error:
        names = (name for name in entry_points(group) if which == name or load(group, name) is which)
        point = entry_points(group).get(next(names, ""))
        is_exit_of_command = group == "jld.commands" and isinstance(error, SystemExit)
        if is_exit_of_command or type(error).__module__.partition(".")[0] in _OWN_WORDS or point is None:
            raise
        if point.dist is None or point.dist.name == "jld":
            raise
        calls = list(traceback.extract_tb(error.__traceback__))
        module = point.module.partition(".")[0]
        calls = [c for c in calls if module in (Path(c.filename).stem, *Path(c.filename).parts)] or calls
        place = f"{Path(calls[-1].filename).name}, line {calls[-1].lineno}"
        problem = f"it raises {repr(error)[:_LONGEST]} ({place})"
        raise refuse_type(group, point.name, f"{GROUPS[group]} that ends without an error", problem) from error


def of_strangers(*groups: str) -> bool:
    """Return whether packages beside jld add to any of the groups."""
    points = [point for group in groups for point in entry_points(group).values()]
    return any(point.dist is not None and point.dist.name != "jld" for point in points)


def package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.module


def part(name: str) -> Any:
    """Import a part of jld that a package beside the core brings; raise InputError where it is not installed."""
    if name not in entry_points("jld.parts"):
        raise InputError(f"part {name!r} of jld", "no package that is installed brings it", "pip install jld, whole")
    return load("jld.parts", name)


def door(name: str) -> Callable[[str], Any]:
    """Return the `__getattr__` of a module with the attributes of a part of jld."""

    def attribute_of_part(attribute: str) -> Any:
        if attribute.startswith("__"):  # as Python asks modules for, without a need for the part
            raise AttributeError(attribute)
        return getattr(part(name), attribute)

    return attribute_of_part
