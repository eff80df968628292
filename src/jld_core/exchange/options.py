"""What a reader is told, and what it reports: found, snapped, assumed, skipped."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.scene import Scene

_ZERO: Final = 1e-15
"""Coordinate, relative to the size of what is drawn, that is a zero and its rounding."""

LOWEST: Final = "lowest"
"""The word for supports that are found: whatever touches the lowest point."""

SNAP: Final = 1e-6
"""Default tolerance of snapping, relative to the size of what is drawn."""

FACET: Final = 1e-3
"""Default distance of chords from their arcs, relative to the size of what is drawn."""

ROLES: Final = {
    "support": ("*support*",),
    "dry": ("*joint*", "*dry*"),
    "inner": ("*crack*", "*inner*"),
    "load": ("*load*",),
    "dead": ("*dead*",),
    "id": ("ids", "*names*"),
    "hole": ("holes",),
    "skip": ("*dimension*", "defpoints", "arrows", "block ids"),
}
"""Layers by their names, as patterns, where no option names them; letters may be capital or not."""


@dataclass(frozen=True)
class ImportOptions:
    """How a file is read; everything may be left out.

    support, dry, inner, load: layers or groups, as patterns with * and ?; support may be "lowest". thickness: out of
    plane. tolerance: of snapping, in the units of the scene, default 1e-6 of the size. facet: largest distance of
    chords from arcs, default 1e-3 of the size. unit: of the file's lengths ("mm", "in", …), where its header says
    none or the wrong one; lengths then become metres. like: a scene whose materials, search and, where the file
    holds none, loads are taken over, those on elements by name.
    """

    support: tuple[str, ...] = ()
    dry: tuple[str, ...] = ()
    inner: tuple[str, ...] = ()
    load: tuple[str, ...] = ()
    thickness: float | None = None
    tolerance: float | None = None
    facet: float | None = None
    unit: str | None = None
    like: Scene | None = None

    def __post_init__(self) -> None:
        for name in ("thickness", "facet", "tolerance"):
            value = getattr(self, name)
            if value is not None and not (0.0 <= value < float("inf") and (value > 0.0 or name == "tolerance")):
                least = "at least 0" if name == "tolerance" else "above 0"
                raise InputError(f"--{name}", f"{value:g} is wrong", f"a length {least}")
        if self.unit is not None and self.unit not in METRES:
            raise InputError("--unit", f"no unit is named {self.unit!r}", "one of " + ", ".join(METRES))

    def role(self, layer: str) -> str | None:
        """What a layer is for: "support", "dry", "inner", "load", another key of ROLES, or None for anything else."""
        plain = layer.casefold()
        for role in ("support", "dry", "inner", "load"):
            if any(fnmatchcase(plain, pattern.casefold()) for pattern in getattr(self, role) if pattern != LOWEST):
                return role
        for role, patterns in ROLES.items():
            # an option takes the place of the names that stand for it otherwise
            if getattr(self, role, ()) or not any(fnmatchcase(plain, pattern) for pattern in patterns):
                continue
            return "dead" if role == "load" and "dead" in plain else role
        return None


METRES: Final = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "km": 1e3, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
"""Metres in a unit of length."""

DEFAULT_MATERIALS: Final[dict[str, Any]] = {
    "density": 2000.0,
    "dry": {"friction_coefficient": 0.6},
    "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
}
"""What an imported scene is made of where nothing says otherwise: kg/m³, coefficient, Pa. To be edited."""


@dataclass(frozen=True)
class Report:
    """What a reader did, in sentences. largest: farthest that any corner moved, in the units of the scene."""

    found: tuple[str, ...] = ()
    snapped: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    largest: float = 0.0

    def __str__(self) -> str:
        rows = [(kind, text) for kind in ("found", "snapped", "assumed", "skipped") for text in getattr(self, kind)]
        return "\n".join(f"{kind:<12} {text}" for kind, text in rows)


@dataclass(frozen=True)
class Imported:
    """A scene document, ready for `parse_scene`, and how it came about."""

    document: dict[str, Any]
    report: Report


@dataclass
class Notes:
    """A report while it is being written."""

    found: list[str] = field(default_factory=list)
    snapped: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    largest: float = 0.0

    def skip(self, what: str, count: int, why: str) -> None:
        """Say that things were left out, and why; nothing where there are none."""
        if count:
            self.skipped.append(f"{count} {what}: {why}")

    def report(self) -> Report:
        """What was noted."""
        return Report(tuple(self.found), tuple(self.snapped), tuple(self.assumed), tuple(self.skipped), self.largest)


def rounded(points: Floats, size: float) -> list[list[float]]:
    """Coordinates as a scene takes them: what rounding left of a zero is zero."""
    cleaned: list[list[float]] = np.where(np.abs(points) < _ZERO * size, 0.0, points).tolist()
    return cleaned


def several(count: int, word: str, plural: str | None = None) -> str:
    """A number and its noun."""
    return f"{count} {word if count == 1 else plural or word + 's'}"


def listed(names: Iterable[str], most: int = 6) -> str:
    """The first few names, and how many more there are."""
    every = list(names)
    return ", ".join(every[:most]) + (f" and {len(every) - most} more" if len(every) > most else "")


def complete(document: dict[str, Any], options: ImportOptions, notes: Notes, *, dimension: int) -> dict[str, Any]:
    """A document with materials and a live load, from the scene it is to be like or by default, and said so."""
    like = options.like.model_dump(mode="json", exclude_defaults=True) if options.like is not None else {}
    if "materials" not in document:
        document["materials"] = like.get("materials", DEFAULT_MATERIALS)
        if not like:
            notes.assumed.append("density 2000, friction 0.6, inner strengths 2e5: edit materials, or --like SCENE")
    for key in ("search", "units"):
        if key in like and key not in document:
            document[key] = like[key]
    loads = document.setdefault("loads", {})
    if not loads and like.get("loads", {}).get("cases"):
        notes.assumed.append("loads of the scene it is to be like are cases, and are not taken over")
    if not loads.get("live") and "cases" not in loads:
        ids = {entry["id"] for entry in document["elements"]}
        given = [entry for entry in like.get("loads", {}).get("live", []) if entry.get("element") in (None, *ids)]
        fitting = [entry for entry in given if len(entry.get("body") or entry.get("force") or []) in (0, dimension)]
        loads["live"] = fitting or [{"body": [1.0, 0.0, 0.0][:dimension]}]
        if not fitting:
            notes.assumed.append("a horizontal body load along x: no load was found")
    return document
