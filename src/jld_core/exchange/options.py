"""Options and report of an import, and functions shared by all readers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError, ParameterError
from jld_core.scene import Scene
from jld_core.scene.units import METRES

# Pattern of a tolerance, scene units, in messages about a scene
_TOLERANCE: Final = re.compile(r'(?:a )?"tolerance":? (above )?([0-9.e+-]*[0-9])')

_ZERO: Final = 1e-15  # coordinate, relative to the size of the drawing, below which it is rounding of zero

LOWEST: Final = "lowest"
"""Value of `support` that makes every element at the lowest point a support."""

SNAP: Final = 1e-6
"""Default snapping tolerance of solids, and least one of drawings, relative to the size."""

CLOSED: Final = 5e-4
"""Default snapping tolerance of drawings, relative to the size: gaps of 1 mm in 2 m are closed."""

EDGE: Final = 0.02
"""Largest default snapping tolerance of drawings, relative to the median edge, so that small shapes are kept."""

FACET: Final = 1e-3
"""Default distance of chords from their arcs, relative to the size of the drawing."""

ROLES: Final = {
    "support": ("*support*",),
    "dry": ("*joint*", "*dry*"),
    "inner": ("*crack*", "*inner*"),
    "load": ("*load*",),
    "dead": ("*dead*",),
    "id": ("ids", "*names*"),
    "hole": ("*hole*", "*opening*", "*window*", "*door*"),
    "skip": ("*dimension*", "defpoints", "arrows", "block ids", "mechanism", "thrust"),
}
"""Patterns of layer names by role, for roles without an option; letter case is ignored."""


@dataclass(frozen=True)
class ImportOptions:
    """Options for reading a file; all are optional.

    Attributes
    ----------
    support, dry, inner, load, hole : tuple of str
        Layers or groups, as patterns with * and ?; `support` may contain "lowest".
    thickness : float or None
        Out-of-plane depth of planar elements, scene units.
    tolerance : float or None
        Snapping tolerance, in the unit of the file. Default: 5e-4 of the size of a drawing and at most 0.02 of its
        median edge; 1e-6 of the size of solids.
    facet : float or None
        Largest distance of chords from arcs, in the unit of the file; default 1e-3 of the size.
    unit : str or None
        Length unit of the file ("mm", "in", …), where its header gives none or a wrong one. Lengths are converted to m.
    like : Scene or None
        Scene that supplies materials, search and, where the file has none, loads. Loads on elements are matched by id.
    """

    support: tuple[str, ...] = ()
    dry: tuple[str, ...] = ()
    inner: tuple[str, ...] = ()
    load: tuple[str, ...] = ()
    hole: tuple[str, ...] = ()
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
                raise ParameterError(name, f"{value:g} is wrong", f"a length {least}")
        if self.unit is not None and self.unit not in METRES:
            raise ParameterError("unit", f"no unit is named {self.unit!r}", "one of " + ", ".join(METRES))

    def role(self, layer: str) -> str | None:
        """Return the role that a layer has in an import, or None for an ordinary layer.

        Roles are "support", "dry", "inner", "load", "dead", "id", "hole" and "skip". The patterns of these options
        count first, then those of `ROLES` for roles without an option. Letter case is ignored.
        """
        plain = layer.casefold()
        for role in ("support", "dry", "inner", "load", "hole"):
            if any(fnmatchcase(plain, pattern.casefold()) for pattern in getattr(self, role) if pattern != LOWEST):
                return role
        for role, patterns in ROLES.items():
            # an option replaces the default patterns of its role
            if getattr(self, role, ()) or not any(fnmatchcase(plain, pattern) for pattern in patterns):
                continue
            return "dead" if role == "load" and "dead" in plain else role
        return None


DEFAULT_MATERIALS: Final[dict[str, Any]] = {
    "density": 2000.0,
    "dry": {"friction_coefficient": 0.6},
    "inner": {"tensile_strength": 2e5, "shear_strength": 5e6},
}
"""Materials of an imported scene without others: kg/m³, friction coefficient, Pa. Users should edit them.

Where blocks crack anywhere they are crushed at 2 τ = 10 MPa, beyond the stresses of stones under usual loads, so that λ
by faces, which crush at no stress, means the same stone.
"""

DEFAULT_STRENGTHS: Final = "inner strengths {tensile_strength:g} and {shear_strength:g}".format(
    **DEFAULT_MATERIALS["inner"]
)
"""Default strengths in words."""


@dataclass(frozen=True)
class Report:
    """Report of an import as sentences, for the user to check.

    Attributes
    ----------
    found : tuple of str
        Content of the file.
    snapped : tuple of str
        Number of corners moved to close gaps, and how far.
    assumed : tuple of str
        Values that the file does not state.
    skipped : tuple of str
        What was left out.
    doubtful : tuple of str
        What can hardly be meant, as a size or an opening that is filled.
    largest : float
        Largest displacement of a corner, scene units.
    """

    found: tuple[str, ...] = ()
    snapped: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    largest: float = 0.0

    def __str__(self) -> str:
        kinds = ("found", "snapped", "assumed", "skipped", "doubtful")
        rows = [(kind, text) for kind in kinds for text in getattr(self, kind)]
        return "\n".join(f"{kind:<12} {text}" for kind, text in rows)


@dataclass(frozen=True)
class Imported:
    """Scene document with a report of its import.

    Attributes
    ----------
    document : dict
        Document for `parse_scene`.
    report : Report
        What was found, snapped, assumed and skipped.
    unit : str
        Length unit of the file, in which the tolerance is given.
    scale : float
        Length of this unit in the scene's unit.
    """

    document: dict[str, Any]
    report: Report
    unit: str = "m"
    scale: float = 1.0

    def in_unit_of_file(self, error: InputError, option: str) -> InputError:
        """Convert an error about a scene's tolerance to one about the option of the import.

        The tolerance is in the unit of the file. error: raised when the document was parsed or built. option: name of
        the option for the user.
        """

        def stated(match: re.Match[str]) -> str:
            return f"{option} {match[1] or ''}{float(match[2]) / self.scale:.2g} (in {self.unit})"

        words = [_TOLERANCE.sub(stated, text) for text in (error.problem, error.expected)]
        return InputError(error.where.lstrip(": "), *words)


@dataclass
class Notes:
    """Collection of the sentences of a report while a file is read.

    Attributes
    ----------
    found, snapped, assumed, skipped, doubtful : list of str
        Sentences, as in `Report`.
    largest : float
        Largest move of a corner, as in `Report`.
    """

    found: list[str] = field(default_factory=list)
    snapped: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    doubtful: list[str] = field(default_factory=list)
    largest: float = 0.0

    def skip(self, what: str, count: int, why: str) -> None:
        """Add a sentence about things that were left out; do nothing for a count of 0."""
        if count:
            self.skipped.append(f"{count} {what}: {why}")

    def report(self) -> Report:
        """Return the sentences collected so far as a report that does not change."""
        return Report(
            tuple(self.found),
            tuple(self.snapped),
            tuple(self.assumed),
            tuple(self.skipped),
            tuple(self.doubtful),
            self.largest,
        )


def rounded(points: Floats, size: float) -> list[list[float]]:
    """Convert an array of points (k, d) to nested lists, with rounding errors set to zero."""
    cleaned: list[list[float]] = np.where(np.abs(points) < _ZERO * size, 0.0, points).tolist()
    return cleaned


def several(count: int, word: str, plural: str | None = None) -> str:
    """Return a number with its noun, such as "1 arc" or "3 arcs"."""
    return f"{count} {word if count == 1 else plural or word + 's'}"


def listed(names: Iterable[str], most: int = 6) -> str:
    """Join the first names by commas, and state how many more there are."""
    every = list(names)
    return ", ".join(every[:most]) + (f" and {len(every) - most} more" if len(every) > most else "")


def _fits(entry: dict[str, Any], ids: set[str], dimension: int) -> bool:
    """Return True if a load entry of another scene can be used in this one."""
    if "face" in entry:
        return dimension == 2 if "along" in entry["face"] else entry["face"]["between"][0] in ids
    vector = entry.get("body") or entry.get("force") or []
    return entry.get("element") in (None, *ids) and len(vector) in (0, dimension)


def complete(document: dict[str, Any], options: ImportOptions, notes: Notes, *, dimension: int) -> dict[str, Any]:
    """Add materials and a live load to a scene document that lacks them, and return it."""
    # Materials and load come from `options.like` if given, together with its search and units. Otherwise they are
    # `DEFAULT_MATERIALS` and a horizontal body load. Each assumption is added to `notes`. The document is changed in
    # place.
    like = options.like.model_dump(mode="json", exclude_defaults=True) if options.like is not None else {}
    if "materials" not in document:
        document["materials"] = like.get("materials", DEFAULT_MATERIALS)
        if not like:
            known = all("density" in element or element.get("support") for element in document["elements"])
            density = "" if known else f"density {DEFAULT_MATERIALS['density']:g}, "
            notes.assumed.append(f"{density}friction 0.6, {DEFAULT_STRENGTHS}: edit materials, or --like SCENE")
    for key in ("search", "units"):
        if key in like and key not in document:
            document[key] = like[key]
    loads = document.setdefault("loads", {})
    if not loads and like.get("loads", {}).get("cases"):
        notes.assumed.append("loads of the scene it is to be like are cases, and are not taken over")
    if not loads.get("live") and not loads.keys() & {"cases", "moving", "pushes"}:
        ids = {entry["id"] for entry in document["elements"]}
        fitting = [entry for entry in like.get("loads", {}).get("live", []) if _fits(entry, ids, dimension)]
        loads["live"] = fitting or [{"body": [1.0, 0.0, 0.0][:dimension]}]
        if not fitting:
            notes.assumed.append("a horizontal body load along x: no load was found")
    return document
