"""Options and report of an import, and functions shared by all readers."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache, cached_property
from math import ceil, floor, log10
from pathlib import Path
from typing import Any, Final, Literal
from unicodedata import combining, normalize

import numpy as np

from jld_core import Floats, InputError, ParameterError, Scene, parameters
from jld_core.geometry import area_vector
from jld_core.scene import loads as scene_loads
from jld_core.scene import units

# Pattern of a tolerance, scene units, in messages about a scene
_TOLERANCE: Final = re.compile(r'(?:a )?"tolerance":? (above )?([0-9.e+-]*[0-9])')
_TELL: Final = 0.2  # time between two reports of a reader on how far it is, s
_ZERO: Final = 1e-12  # coordinate, relative to the size of the drawing, below which it is rounding of zero
LOWEST: Final = "lowest"  # value of `support` that makes every element at the lowest point a support
SNAP: Final = 1e-6  # default snapping tolerance of solids, and least one of drawings, relative to the size

# Default snapping tolerance of drawings, relative to the size: gaps of 1 mm in 2 m are closed.
CLOSED: Final = 5e-4
EDGE: Final = 0.02
"""Largest default snapping tolerance of drawings, relative to the median edge, so that small shapes are kept."""

FACET: Final = 1e-3  # default distance of chords from their arcs, relative to the size of the drawing

# Words of layer names by role, in English, German, Italian, French, Spanish and the codes of AIA, without accents; the
# first role with a word of a name counts. A word may stand within another one; with "." it is a whole word, with "-" as
# well the end of one.
_WORDS: Final = (
    ("skip", "blockids arrows. mechanism thrust defpoints"),
    ("dead", "dead eigengewicht. eigenlast. permanent."),
    (
        "load",
        "load -last. lasten. lastfall carico. carichi. charge. charges. carga. cargas. force. forces. kraft. kraefte.",
    ),
    ("id", "names"),
    (
        "skip",
        """dimension dims. axis. axes. axe. achse asse. assi. eje. ejes. centerline centreline center. centre. ctrl.
        mittellinie mezzeria construction. hilfslinie frame. frames. title titel border sheet. viewport vprt.
        rahmen. planrahmen plankopf zeichnungsrahmen blattrand blattrahmen schriftfeld schriftkopf cornice.
        squadratura cartiglio cadre. cartouche marco. cajetin rotulo recuadro masse. bemassung masskette vermassung
        quote. quota. quotatura cotes. cotation cota. cotas. acotacion anno. ttlb. nplt. symb. text. texts. texte.
        textes. testi. testo. texto. textos. beschriftung""",
    ),
    (
        "hole",
        """hole opening window door void. voids. glaz. glazing fenster tuer tur. turen. oeffnung offnung aussparung
        loch. loecher. locher. finestr porta. porte. portes. apertur fori. foro. fenetre ouverture baie. baies.
        trou. trous. vide. vides. ventana puerta. puertas. hueco abertura vano. vanos. opng.""",
    ),
    (
        "support",
        """support foundation footing ground. auflager widerlager lager. fundament gruendung grundung boden. appoggi
        fondazion suolo terreno vincol appui. appuis. fondation sol. terrain. suelo apoyo cimentacion cimiento zapata
        fndn. ftng.""",
    ),
    ("dry", "joint dry fuge. fugen. lagerfuge stossfuge giunt junta. juntas."),
    ("inner", "crack inner riss. risse. fessur fissur fisur grieta"),
)

# Names of ISO 13567: agent (2), element (6) by CI/SfB or Uniclass, presentation (2)
_ISO: Final = re.compile(r"[a-z][a-z0-9_-](?:(\d\d)[a-z0-9_-]{4}|(g\d\d)[a-z0-9_-]{3})([a-z_-])[a-z0-9_-].*")

_ISO_ELEMENT: Final = {
    **dict.fromkeys(("31", "32", "37", "g32"), "hole"),
    **dict.fromkeys(("11", "16", "17", "g21"), "support"),
}


def _pattern(words: str) -> re.Pattern[str]:
    """Return a pattern that finds one of the words of a role in a name whose words are divided by single spaces."""
    patterns = (word.removesuffix(".") + (r"\b" if word.endswith(".") else "") for word in words.split())
    return re.compile(
        "|".join(word[1:] if word[0] == "-" else rf"\b{word}" if word.endswith(r"\b") else word for word in patterns)
    )


_PATTERNS: Final = tuple((role, _pattern(words)) for role, words in _WORDS)


@cache
def role_by_name(layer: str) -> str | None:
    """Return the role that the name of a layer says, None for an ordinary layer."""
    plain = "".join(c for c in normalize("NFKD", layer.casefold()) if not combining(c))
    if plain == "ids":  # names of elements, written by jld
        return "id"
    if iso := _ISO.fullmatch(plain):
        # presentation: element, any, none, hatch; the others are texts, dimensions, frames and the like
        return "skip" if iso[3] not in "e_-h" else _ISO_ELEMENT.get(iso[1] or iso[2])
    if re.match(r"[a-z]{1,2}-grid\b", plain):
        return "skip"
    words = re.sub(r"[\W\d_]+", " ", plain)
    # texts at blocks, no blocks
    joined = words.replace(" ", "") if words == "block ids" else words
    return next((role for role, pattern in _PATTERNS if pattern.search(joined)), None)


@dataclass(frozen=True)
class ImportOptions:
    """Options for reading a file; all are optional.

    Attributes
    ----------
    layer, skip : tuple of str
        Layers or groups that alone are read, and that are not read, as patterns with * and ?.
    support, dry, inner, load, hole : tuple of str
        Layers or groups of a role, as such patterns; `support` may contain "lowest".
    thickness : float or None
        Out-of-plane depth of planar elements, scene units.
    tolerance : float or None
        Snapping tolerance, in the unit of the file. Default: 5e-4 of the size of a drawing and at most 0.02 of its
        median edge; 1e-6 of the size of solids.
    facet : float or None
        Largest distance of chords from arcs, in the unit of the file; default 1e-3 of the size.
    unit : str or None
        Length unit of the file ("mm", "in", …), where its header gives none or a wrong one. Lengths are converted to m.
    up : "y", "z" or None
        Axis of solids that points upwards; default z.
    like : Scene or None
        Scene that supplies materials, search and, where the file has none, loads. Loads on elements are matched by id.
    seconds : float or None
        Time in which the file must be read, s; default 60 and 5 for each megabyte.
    """

    layer: tuple[str, ...] = ()
    skip: tuple[str, ...] = ()
    support: tuple[str, ...] = ()
    dry: tuple[str, ...] = ()
    inner: tuple[str, ...] = ()
    load: tuple[str, ...] = ()
    hole: tuple[str, ...] = ()
    thickness: float | None = None
    tolerance: float | None = None
    facet: float | None = None
    unit: str | None = None
    up: Literal["y", "z"] | None = None
    like: Scene | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        for name in (*LAYER_ROLES, "layer"):
            if isinstance(given := getattr(self, name), str | list):
                object.__setattr__(self, name, (given,) if isinstance(given, str) else tuple(given))
        parameters.require_field_types(self)
        for name in ("thickness", "facet", "seconds", "tolerance"):
            value = getattr(self, name)
            if value is not None and not (0.0 <= value < float("inf") and (value > 0.0 or name == "tolerance")):
                least = "at least 0" if name == "tolerance" else "above 0"
                noun = "a number" if name == "seconds" else "a length"
                raise ParameterError(name, f"{value:g} is wrong", f"{noun} {least}")
        if self.unit is not None and self.unit not in units.METRES:
            raise ParameterError("unit", f"no unit is named {self.unit!r}", "one of " + ", ".join(units.METRES))

    def matches(self, option: str, name: str) -> bool:
        """Return True if a name matches a pattern of one of the options that name layers; letter case is ignored."""
        patterns = (pattern.casefold() for pattern in getattr(self, option) if pattern != LOWEST)
        return any(fnmatchcase(name.casefold(), pattern) for pattern in patterns)

    def role(self, layer: str) -> str | None:
        """Return the role of a layer, by options, then by words of its name; None for an ordinary layer."""
        if layer not in self._roles:
            self._roles[layer] = self._role(layer)
        return self._roles[layer]

    @cached_property
    def _roles(self) -> dict[str, str | None]:
        """Roles of the layers that were asked for: drawings ask thousands of times."""
        return {}

    def _role(self, layer: str) -> str | None:
        """Return the role of a layer by the options, else by its name."""
        named = role_by_name(layer)
        for role in LAYER_ROLES:
            if self.matches(role, layer):
                return "dead" if role == "load" and named == "dead" else role
        if self.matches("layer", layer):
            return None
        # an option replaces the words of its role
        if named not in (None, "skip", "id") and getattr(self, "load" if named == "dead" else str(named)):
            named = None
        return "skip" if self.layer and named is None else named

    def group(self, *names: str) -> str:
        """Return the name of several that decides a role: one that an option names, one with a role, else the first."""
        by_option = (
            name for name in names if name and any(self.matches(role, name) for role in (*LAYER_ROLES, "layer"))
        )
        by_role = (name for name in names if name and self.role(name) not in (None, "skip"))
        return next(by_option, None) or next(by_role, None) or next((name for name in names if name), "")

    def chosen(self, *names: str) -> bool:
        """Return True if something of these names is read by the options `layer` and `skip`, or has another role."""
        if any(self.matches("skip", name) for name in names):
            return False
        roles = [role for role in LAYER_ROLES if any(self.matches(role, name) for name in names)]
        return not self.layer or bool(roles) or any(self.matches("layer", name) for name in names)


def refuse_unknown(options: ImportOptions, names: Iterable[str], what: str) -> None:
    """Raise ParameterError for a pattern of an option that names no layer, or whatever `what` is, of a file."""
    present = sorted(set(names))
    for option in (*LAYER_ROLES, "layer"):
        for pattern in getattr(options, option) if option != "support" else ():
            if not any(fnmatchcase(name.casefold(), pattern.casefold()) for name in present):
                expected = "one of " + listed([name or "(none)" for name in present], 12)
                raise ParameterError(option, f"no {what} of the file is like {pattern!r}", expected)


LAYER_ROLES: Final = ("skip", "support", "dry", "inner", "load", "hole")
"""Options of an import that give layers a role, in the order in which they count."""


# Materials of an imported scene without others: kg/m³, friction coefficient, Pa. Users should edit them.
# Where blocks crack anywhere they are crushed at 2 τ = 10 MPa, beyond the stresses of stones under usual loads, so
# that λ by faces, which crush at no stress, means the same stone.
DEFAULT_MATERIALS: Final[dict[str, Any]] = {
    "density": 2000.0,
    "dry": {"friction_coefficient": 0.6},
    "inner": {"tensile_strength": 2e5, "shear_strength": 5e6},
}

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
    doubted : tuple of str
        Ids of the elements that may be openings.
    """

    found: tuple[str, ...] = ()
    snapped: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    largest: float = 0.0
    doubted: tuple[str, ...] = ()

    def __str__(self) -> str:
        kinds = ("found", "snapped", "assumed", "skipped", "doubtful")
        rows = [(kind, text) for kind in kinds for text in getattr(self, kind)]
        return "\n".join(f"{kind:<12} {text}" for kind, text in rows)


@dataclass(frozen=True)
class Measures:
    """Sizes of the elements of a scene: amount: area or volume of free ones; size, block: extents of all, median."""

    free: int
    planar: bool
    amount: float
    size: list[float]
    block: list[float]


def measure(entries: list[dict[str, Any]]) -> Measures:
    """Return the sizes of the elements of a scene document, given by polygons or by vertices and faces."""
    planar = "polygon" in entries[0]
    corners = [np.array(entry["polygon" if planar else "vertices"], dtype=float) for entry in entries]
    free = [k for k, entry in enumerate(entries) if not entry.get("support")]
    amount = 0.0
    for k in free:
        points = corners[k] - corners[k].mean(axis=0)
        if planar:
            following = np.roll(points, -1, axis=0)
            amount += 0.5 * abs(float((points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]).sum()))
        else:
            loops = [points[list(loop)] for loop in entries[k]["faces"]]
            amount += sum(float(area_vector(loop) @ loop[0]) for loop in loops) / 3.0
    every = np.concatenate(corners)
    block = np.median([np.ptp(corners[k], axis=0) for k in free], axis=0) if free else np.zeros(every.shape[1])
    return Measures(len(free), planar, amount, np.ptp(every, axis=0).tolist(), block.tolist())


def in_words(measured: Measures, unit: str) -> str:
    """Return number, sizes and area or volume of what was read, with their unit."""
    structure, block = (" × ".join(f"{value:.3g}" for value in sides) for sides in (measured.size, measured.block))
    amount = f"area {measured.amount:.6g} {unit}²" if measured.planar else f"volume {measured.amount:.6g} {unit}³"
    return f"{amount}; {structure} {unit} in all, a typical element {block} {unit}"


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

    def facts(self) -> dict[str, Any]:
        """Return what was read as data, for `jld import --json`.

        Returns
        -------
        dict
            `elements` and `supports` (their numbers), `area` or `volume` of the elements and `size` (extents of all, x,
            y and z), in the scene's `length`; `unit` of the file; `found`, `snapped`, `assumed`, `dropped` and
            `doubtful`, lists of sentences.
        """
        measured = measure(self.document["elements"])
        report = self.report
        return {
            "elements": measured.free,
            "supports": len(self.document["elements"]) - measured.free,
            ("area" if measured.planar else "volume"): measured.amount,
            "size": measured.size,
            "length": self.document.get("units", {}).get("length", "m"),
            "unit": self.unit,
            "found": list(report.found),
            "snapped": list(report.snapped),
            "assumed": list(report.assumed),
            "dropped": list(report.skipped),
            "doubtful": list(report.doubtful),
        }

    def in_unit_of_file(self, error: InputError, option: str) -> InputError:
        """Convert an error about a scene's tolerance to one about the option, in the unit of the file."""

        def stated(match: re.Match[str]) -> str:
            value = float(match[2]) / self.scale
            return f"{option} {round_up(value) if match[1] else format(value, '.2g')} (in {self.unit})"

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
    doubted : list of str
        Ids of elements, as in `Report`.
    told : Path or None
        File that says how far the reader is, for the process that waits for it.
    """

    found: list[str] = field(default_factory=list)
    snapped: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    doubtful: list[str] = field(default_factory=list)
    largest: float = 0.0
    doubted: list[str] = field(default_factory=list)
    told: Path | None = None
    _next: float = -1.0

    def reached(self, subject: str, done: int, total: int = 0) -> None:
        """Tell how many things of a kind were read so far, and of how many, 0 if unknown; readers call it often."""
        if self.told is not None and (now := time.monotonic()) >= self._next:
            self._next = now + _TELL
            with suppress(OSError):
                self.told.write_text(f"{subject}\t{done}\t{total}", encoding="utf-8")

    def last_told(self) -> tuple[str, int, int]:
        with suppress(OSError, ValueError):
            subject, done, total = self.told.read_text(encoding="utf-8").split("\t") if self.told else ("", "0", "0")
            return subject, int(done), int(total)
        return "", 0, 0

    def skip(self, subject: str, count: int, why: str) -> None:
        """Add a sentence about things that were left out; do nothing for a count of 0."""
        if count:
            self.skipped.append(f"{count} {subject}: {why}")

    def report(self) -> Report:
        """Return the sentences collected so far as a report that does not change."""
        return Report(
            tuple(self.found),
            tuple(self.snapped),
            tuple(self.assumed),
            tuple(self.skipped),
            tuple(self.doubtful),
            self.largest,
            tuple(self.doubted),
        )


def rounded(points: Floats, size: float) -> list[list[float]]:
    """Convert an array of points (k, d) to nested lists, with rounding errors set to zero."""
    cleaned: list[list[float]] = np.where(np.abs(points) < _ZERO * size, 0.0, points).tolist()
    return cleaned


def round_up(value: float) -> str:
    """Return a positive number as text of two digits that is larger, by a hundredth at least."""
    step = 10.0 ** (floor(log10(1.01 * value)) - 1)
    return f"{ceil(1.01 * value / step) * step:.2g}"


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
        face = entry["face"]
        return face["between"][0] in ids if "between" in face else dimension == (2 if "along" in face else 3)
    vector = scene_loads.body_of(entry) or entry.get("force") or entry.get("tilt", {}).get("towards") or []
    return "on_fill" not in entry and entry.get("element") in (None, *ids) and len(vector) in (0, dimension)


def _like(document: dict[str, Any], options: ImportOptions, notes: Notes) -> dict[str, Any]:
    """Return the scene that a document is to be like, in the units of the document if it has any."""
    if options.like is None:
        return {}
    like: dict[str, Any] = options.like.model_dump(mode="json", exclude_defaults=True)
    theirs = {"length": options.like.units.length, "force": options.like.units.force}
    file_units = {"length": "m", "force": "N"} | document.get("units", theirs)
    if file_units == theirs:
        return like
    if not all(pair["length"] in units.METRES and pair["force"] in units.NEWTONS for pair in (file_units, theirs)):
        problem = "its numbers are in {force} and {length}, those of the file in ".format(**theirs)
        raise ParameterError("like", problem + "{force} and {length}".format(**file_units), "units of known names")
    sentence = "numbers of the scene that it is to be like turned from {force} and {length} to ".format(**theirs)
    notes.found.append(sentence + "{force} and {length}".format(**file_units))
    return units.in_units(like, file_units, options.like.dimension)


def complete(document: dict[str, Any], options: ImportOptions, notes: Notes, *, dimension: int) -> dict[str, Any]:
    """Add materials and a live load to a scene document that lacks them, and return it."""
    # Materials and load come from `options.like` if given, together with its search and units. Otherwise they are
    # `DEFAULT_MATERIALS` and a horizontal body load. Each assumption is added to `notes`. The document is changed in
    # place.
    like = _like(document, options, notes)
    if "materials" not in document:
        document["materials"] = like.get("materials", DEFAULT_MATERIALS)
        if not like:
            all_weighed = all("density" in element or element.get("support") for element in document["elements"])
            density = "" if all_weighed else f"density {DEFAULT_MATERIALS['density']:g}, "
            notes.assumed.append(f"{density}friction 0.6, {DEFAULT_STRENGTHS}: edit materials, or --like SCENE")
    for key in ("search", "units"):
        if key in like and key not in document:
            document[key] = like[key]
    loads, others = document.setdefault("loads", {}), like.get("loads", {})
    if not loads and (unused := [key for key in others if key != "live"]):
        notes.assumed.append(f"of the scene it is to be like, loads.{', '.join(unused)} is not taken over")
    if not loads.get("live") and not loads.keys() & {"cases", "moving", "pushes"}:
        ids = {entry["id"] for entry in document["elements"]}
        fitting = [entry for entry in others.get("live", []) if _fits(entry, ids, dimension)]
        loads["live"] = fitting or [{"body": [1.0, 0.0, 0.0][:dimension]}]
        if not fitting:
            notes.assumed.append("a horizontal body load along x: no load was found")
    return document
