"""Make an element of a scene a support, or a free element."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from jld_core import InputError

_CELL: Final = re.compile(r"c(\d+)r(\d+)")  # pattern of the name of a cell of a grid: column and row
_LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"  # letters from which a cell that is no longer a support takes its own


def with_support(document: Mapping[str, Any], element: object, support: object) -> dict[str, Any]:
    """Return a document in which an element is a support, or none; labels of pairs of supports are left out."""
    if not isinstance(support, bool):
        raise InputError("support", f"it is {str(support)[:40]!r}", "true or false")
    if "grid" in document:
        rows = _rows(document["grid"]["rows"], element, support)
        found = {**document, "grid": {**document["grid"], "rows": rows}}
        held = {f"c{c}r{r}" for r, row in enumerate(rows) for c, cell in enumerate(row) if cell == "#"}
    else:
        names = [entry["id"] for entry in document["elements"]]
        if element not in names:
            raise _unknown(element)
        changed = [dict(entry) for entry in document["elements"]]
        changed[names.index(element)].pop("support", None)
        if support:
            changed[names.index(element)]["support"] = True
        found = {**document, "elements": changed}
        held = {entry["id"] for entry in changed if entry.get("support")}
    if "labels" in found:
        free = {
            label: [pair for pair in pairs if not set(pair) <= held] if isinstance(pairs, list) else pairs
            for label, pairs in found["labels"].items()
        }
        found["labels"] = free
    return found


def _rows(rows: list[str], element: object, support: bool) -> list[str]:
    """Return the rows of a grid with a cell as support or free."""
    place = _CELL.fullmatch(element) if isinstance(element, str) else None
    column, row = (int(place[1]), int(place[2])) if place else (-1, -1)
    if not (0 <= row < len(rows) and 0 <= column < len(rows[row]) and rows[row][column] != "."):
        raise _unknown(element)
    if support == (rows[row][column] == "#"):
        return list(rows)
    near = {
        rows[r][c]
        for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1))
        if 0 <= r < len(rows) and 0 <= c < len(rows[r])
    }
    letter = "#" if support else next(letter for letter in _LETTERS if letter not in near)
    changed = rows[row][:column] + letter + rows[row][column + 1 :]
    return [*rows[:row], changed, *rows[row + 1 :]]


def _unknown(element: object) -> InputError:
    return InputError("element", f"there is none named {str(element)[:60]!r}", "the id of an element of the scene")
