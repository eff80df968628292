"""Store the scenes that pages of the studio opened or made, for undo."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from jld_core import InputError, Scene, files, load_scene, parse_scene
from jld_studio.session import StudioSession

SESSIONS: Final = 6
"""Number of scenes beside the first whose solver stays in memory; others are built again when they are asked for."""
FOLDER: Final = "scenes"
"""Folder for the scenes of kept candidates."""
_NAME: Final = re.compile(r"[0-9a-f]{16}")  # pattern of the name of a scene


class SceneStore:
    """Scenes of the pages by name, a digest of their content; thread-safe. root: kept candidates go there."""

    def __init__(self, first: StudioSession, root: Path) -> None:
        self._first, self._folder = first, root / FOLDER
        self.first_name = _digest(first.document)
        self._documents: dict[str, dict[str, Any]] = {self.first_name: first.document}
        self._sessions: OrderedDict[str, StudioSession] = OrderedDict()
        self._turn = threading.RLock()

    def add(self, scene: Scene) -> str:
        """Keep a scene and return its name; raise InputError if it cannot be built."""
        document = scene.model_dump(mode="json", exclude_defaults=True)
        name = _digest(document)
        with self._turn:
            if name not in self._documents:
                self._remember(name, StudioSession(scene))
                self._documents[name] = document
        return name

    def find(self, name: object) -> StudioSession:
        """Return the solver of a scene by name, None for the first."""
        if name is None or name == self.first_name:
            return self._first
        with self._turn:
            if name in self._sessions:
                self._sessions.move_to_end(str(name))
                return self._sessions[str(name)]
            return self._remember(str(name), StudioSession(self._scene(name)))

    def has(self, name: object) -> bool:
        return name in self._documents or self._file(name).exists()

    def write(self, name: object) -> None:
        """Write a scene into the folder of candidates, unless it is the first or exists there."""
        if name in (None, self.first_name) or self._file(name).exists():
            return
        with self._turn:
            document = self.find(name).document
        self._folder.mkdir(parents=True, exist_ok=True)
        files.write_text(self._file(name), json.dumps(document))

    def _file(self, name: object) -> Path:
        """Return the file of a stored scene; raise InputError for an invalid name."""
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise InputError("scene", f"there is none named {str(name)[:60]!r}", "one that the studio has opened")
        return self._folder / f"{name}.json"

    def _scene(self, name: object) -> Scene:
        """Return a scene by its name, from memory or disk; raise InputError where there is none."""
        path = self._file(name)
        if name in self._documents:
            return parse_scene(self._documents[str(name)])
        if not path.exists():
            raise InputError("scene", f"{name} is no longer open", "its file opened again")
        return load_scene(path)

    def _remember(self, name: str, session: StudioSession) -> StudioSession:
        """Keep a solver in memory, and let go of the one not used for longest."""
        self._sessions[name] = session
        while len(self._sessions) > SESSIONS:
            self._sessions.popitem(last=False)
        return session


def _digest(document: dict[str, Any]) -> str:
    """Return the name of a scene document: 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]


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
