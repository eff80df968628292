"""Table of loads of the printed report: case, load in words, and λ times it."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from jld_core.build.assemble import cases_of_scene
from jld_core.exchange import Layout
from jld_core.scene.uncertain import with_means
from jld_core.scene.units import NEWTONS
from jld_explore.report.languages import digits, phrase_in
from jld_practice.making import Stone

_PARALLEL: Final = 1e-9  # sine of the angle between forces up to which they are printed as one


def load_rows(
    layout: Layout, factor: float, words: dict[str, str], stones: Sequence[Stone], language: str
) -> list[list[str]]:
    """Return the rows of the table of loads: case, load, and λ times it.

    Parallel forces of a case, as those of a load that is spread, are one force at their common line of action. factor:
    λ. words: texts of the language. stones: numbered stones of the layout, by which the place of a force is named.
    """
    scene, rows = layout.scene, []
    cases = cases_of_scene(scene, layout.assembly.elements)
    for name, live in [(one.case.name, one.case.live) for one in cases] or [("", scene.loads.live or [])]:
        entries = [with_means(one.model_dump(mode="json", exclude_defaults=True)) for one in live]
        for group in _groups(layout, entries):
            told, times = _load(layout, group, factor, words, stones)
            rows.append([textwrap.shorten(phrase_in(language, name), 24, placeholder="…"), told, times])
    return rows


def force_words(layout: Layout, value: float) -> str:
    """Write a force in kN, or in the scene's unit where that is unknown."""
    own = layout.scene.units.force
    if own not in NEWTONS:
        return f"{digits(value)} {own}"
    return f"{digits(value * NEWTONS[own] / NEWTONS['kN'])} kN"


def finite(value: float, write: Callable[[float], str]) -> str:
    """Return a number as text by the function `write`, or a dash if it is not finite."""
    return write(value) if math.isfinite(value) else "–"


def _groups(layout: Layout, entries: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Return the entries of a case, parallel forces on elements in one group, the others alone."""
    found: list[list[dict[str, Any]]] = []
    for entry in entries:
        alike = next((group for group in found if _parallel(layout, group[0], entry)), None)
        if alike is None:
            found.append([entry])
        else:
            alike.append(entry)
    return found


def _parallel(layout: Layout, one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return True if two loads are forces on elements in one direction, without a moment."""
    if not all("force" in entry and "moment" not in entry and _element(layout, entry) >= 0 for entry in (one, other)):
        return False
    a, b = (np.array(entry["force"], dtype=float) for entry in (one, other))
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0.0 and float(a @ b) >= (1.0 - _PARALLEL) * size


def _element(layout: Layout, entry: dict[str, Any]) -> int:
    """Return the index of the element of a load, -1 if it names none."""
    return layout.assembly.elements.index.get(str(entry.get("element")), -1)


def _load(
    layout: Layout, group: list[dict[str, Any]], factor: float, words: dict[str, str], stones: Sequence[Stone]
) -> tuple[str, str]:
    """Describe one load or a group of parallel forces, and λ times it."""
    entry = group[0]
    if "body" in entry:
        value = float(np.linalg.norm(entry["body"]))
        vector = ", ".join(f"{one + 0.0:.4g}" for one in entry["body"])
        return f"({vector}) {words['body']}", finite(factor * value, lambda x: f"{x:.4g}")
    if "force" in entry:
        value = sum(float(np.linalg.norm(one["force"])) for one in group)
        told = f"{force_words(layout, value)} {_carriers(layout, group, words, stones)}"
        where = _place(layout, group)
        if where is not None:
            told += f" {words['at']} ({', '.join(f'{x:.4g}' for x in where)}) {layout.scene.units.length}"
        return textwrap.shorten(told, 66, placeholder="…"), finite(factor * value, lambda x: force_words(layout, x))
    for key in ("pressure", "line", "traction"):
        if key in entry:
            return f"{words[key]} {entry[key]}", ""
    return f"{words['moment']} {entry.get('moment')}", ""


def _carriers(layout: Layout, group: list[dict[str, Any]], words: dict[str, str], stones: Sequence[Stone]) -> str:
    """Name the stones on which forces act by their numbers, other elements by their ids."""
    numbers = {stone.name: stone.number for stone in stones}
    known, others = set[int](), set[str]()
    for entry in group:
        k = _element(layout, entry)
        block = layout.blocks[int(layout.block_of[k])].name if k >= 0 else ""
        if block in numbers:
            known.add(numbers[block])
        else:
            others.add(str(entry.get("element", "")))
    if others:
        return f"{words['on']} {', '.join(sorted(others))}"
    return words["on_stone" if len(known) == 1 else "on_stones"].format(numbers=", ".join(map(str, sorted(known))))


def _place(layout: Layout, group: list[dict[str, Any]]) -> list[float] | None:
    """Return the point at which forces act together, None where an entry states none."""
    if any("at" not in entry for entry in group):
        return None
    sizes = np.array([float(np.linalg.norm(entry["force"])) for entry in group])
    places = np.array([entry["at"] for entry in group], dtype=float)
    return [float(x) + 0.0 for x in sizes @ places / sizes.sum()] if sizes.sum() > 0.0 else None
