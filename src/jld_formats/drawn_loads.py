"""Loads from a drawing: arrows, lines along edges, points and texts on load layers."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, InputError
from jld_core.scene import units
from jld_formats.forces import WrittenForce, closest_first, parse_force, refuse_mixed
from jld_formats.options import ImportOptions, Notes, listed
from jld_formats.paths import Path

MOST: Final = 200_000  # largest number of corners, lines or cells of a drawing; more indicate a wrong or malicious file


@dataclass(frozen=True)
class Mark:
    """Point, text or arrow on a layer of a drawing."""

    at: tuple[float, float]  # its place, drawing units
    layer: str
    text: str | None = None  # None for a bare point
    end: tuple[float, float] | None = None  # end of an arrow, for a line on a load layer

    def scaled(self, factor: float) -> Mark:
        end = None if self.end is None else (self.end[0] * factor, self.end[1] * factor)
        return Mark((self.at[0] * factor, self.at[1] * factor), self.layer, self.text, end)


@dataclass(frozen=True)
class SolidMark:
    """Point, text or arrow on a layer of a spatial file."""

    at: Floats  # (3,) its place, the tip of an arrow, file units
    layer: str
    text: str | None = None  # None for a bare point
    tail: Floats | None = None  # (3,) start of an arrow

    def scaled(self, factor: float) -> SolidMark:
        return SolidMark(factor * self.at, self.layer, self.text, None if self.tail is None else factor * self.tail)


@dataclass(frozen=True)
class Drawing:
    """Content of a planar file before it is converted to elements."""

    paths: list[Path]  # outlines and lines in the file's unit
    marks: list[Mark]  # points and texts
    unit: str | None = None  # unit of length, such as "mm"; None if unknown
    facts: dict[str, Any] = field(default_factory=dict)  # keys of a scene that an earlier export stored in the file
    name: str = "drawing"  # name of the scene
    unread: int = 0  # entities that no reader understood
    layers: tuple[str, ...] = ()  # names of layers that the file knows, also of those without a path


@dataclass
class Cell:
    """Future planar element, before it is written to a scene document."""

    points: Floats  # (k, 2) corners, scene units
    layer: str
    name: str | None  # id in the scene, None where not yet known
    support: bool = False
    # cell with which it is one block, as parts of one stone around an opening; None where it is a block by itself
    joined: Cell | None = None


# Pattern of the layers of a load case: a name with a number, or a name after "load case"
# Names of layers of load cases: with a number, or with a name behind words for one
_CASE: Final = re.compile(
    r".*[^\W\d_][\s_.:-]*\d+|.*(?:load\W?case|lastfall|cas de charge|caso di carico|caso de carga)[\s_.:-]+\S.*",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Structure:
    """Future elements that loads act on; reach: distance within which a line lies along an edge; scene units."""

    cells: list[Cell]
    thickness: float
    unit: str
    reach: float


def drawn_loads(
    paths: list[Path], marks: list[Mark], structure: Structure, options: ImportOptions, drawing: Drawing, notes: Notes
) -> dict[str, Any]:
    """Return the entry "loads" of a scene from the lines, points and texts of a drawing.

    Raises InputError for a text that is no force.
    """
    # A line on a load layer is a force that ends at its point of application. The nearest text states its magnitude;
    # without one it is 1. A text with a load per length or area makes the line a pressure along the edge that it lies
    # on. Any other text is a force at its place: two components, or one magnitude downwards. A force acts on the
    # nearest free cell; equally near ones share it. Two or more numbered load layers are load cases.
    unit = str(drawing.facts.get("units", {}).get("force", "N"))
    loads = _Loads(structure, unit, notes)
    live = [layer for layer in _layers(paths, marks) if options.role(layer) == "load"]
    dead = [layer for layer in _layers(paths, marks) if options.role(layer) == "dead"]
    cases = [layer for layer in live if _CASE.fullmatch(layer)]
    if len(cases) < 2:
        cases = []
    refuse_mixed([(mark.layer, mark.text) for mark in marks if mark.text and mark.layer in (*live, *dead)])
    common = loads.of(paths, marks, [layer for layer in live if layer not in cases], "live")
    loads_found: dict[str, Any] = {"live": common, "dead": loads.of(paths, marks, dead, "dead")}
    of_case = {layer: loads.of(paths, marks, [layer], f"load case {layer!r}:") for layer in cases}
    of_case = {layer: entries for layer, entries in of_case.items() if entries}
    if of_case:
        notes.found.append(f"load cases by layer: {listed(of_case)}")
        if common:
            notes.assumed.append("live forces on layers without a number act in every load case")
        loads_found["live"] = []
        loads_found["cases"] = [{"name": layer, "live": entries + common} for layer, entries in of_case.items()]
    stored = drawing.facts.get("loads", {})
    has_live = bool(loads_found["live"] or loads_found.get("cases"))
    for key in ("live", "dead"):
        loads_found[key] = loads_found[key] + list(stored.get(key, []))
    loads_found = {key: value for key, value in loads_found.items() if value}
    # loads drawn anew replace stored cases, paths and directions
    return loads_found if has_live else {**stored, **loads_found}


def _layers(paths: list[Path], marks: list[Mark]) -> list[str]:
    """Return the layers of lines, points and texts in natural order: LOAD 2 before LOAD 10."""
    layers = {path.layer for path in paths} | {mark.layer for mark in marks}

    def parts(layer: str) -> list[tuple[int, str]]:
        """Split a name into numbers and words, as a key for natural order."""
        return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", layer)]

    return sorted(layers, key=parts)


class _Loads:
    """Load entries of the lines, points and texts on some layers."""

    def __init__(self, structure: Structure, unit: str, notes: Notes) -> None:
        self._structure, self._unit, self._notes = structure, unit, notes
        self._cells = structure.cells
        self._shapes = np.array([shapely.Polygon(cell.points) for cell in structure.cells])
        self._free = np.array([k for k, cell in enumerate(structure.cells) if not cell.support], dtype=np.int64)

    def of(self, paths: list[Path], marks: list[Mark], layers: list[str], kind: str) -> list[dict[str, Any]]:
        """Return the entries of lines, points and texts on some layers, and note each."""
        texts = [mark for mark in marks if mark.layer in layers and mark.text]
        entries: list[dict[str, Any]] = []
        lines = [path for path in paths if path.layer in layers and len(path.points) > 1]
        long = [path for path in lines if (path.points[0, :2] != path.points[-1, :2]).any()]
        self._notes.skip("loads", len(lines) - len(long), "a line without length")
        beside = self._beside(long, texts)
        for number, path in enumerate(long):
            entries += self._along(path, texts[beside[number]] if number in beside else None, kind)
        for number in sorted(set(range(len(texts))) - set(beside.values())):
            mark = texts[number]
            written = self._written(mark, distributed=False)
            force = written.values if written.components else (0.0, -written.values[0])
            entries += self._force(np.array(mark.at), force, repr(mark.text), kind)
        for mark in (mark for mark in marks if mark.layer in layers and not mark.text):
            self._notes.skip("loads", 1, f"a point on layer {mark.layer} without a text that says its force")
        return entries

    def _beside(self, lines: list[Path], texts: list[Mark]) -> dict[int, int]:
        """Return the number of the text of each line, at most its length away; InputError where ambiguous."""
        chords = shapely.linestrings(np.array([path.points[[0, -1], :2] for path in lines]).reshape(-1, 2, 2))
        points = shapely.points(np.array([mark.at for mark in texts]).reshape(-1, 2))
        line, text = shapely.STRtree(points).query(chords, predicate="dwithin", distance=shapely.length(chords))
        distance = shapely.distance(chords[line], points[text])
        return closest_first(
            line, text, distance, self._structure.reach, [(mark.layer, str(mark.text)) for mark in texts]
        )

    def _along(self, path: Path, mark: Mark | None, kind: str) -> list[dict[str, Any]]:
        """Return the entries of a line: a pressure for a load per length or area, else a force."""
        start, end = path.points[0, :2], path.points[-1, :2]
        if mark is None:
            self._notes.assumed.append(f"a force of 1 {self._unit} along a line on layer {path.layer}: it has no text")
            size, source = 1.0, "an arrow without a text"
        else:
            written = self._written(mark, distributed=True)
            if written.per is not None:
                return [self._pressure(path, mark, written, kind)]
            if written.components:
                problem = f"the text {mark.text!r} beside an arrow states components"
                raise InputError(f"layer {mark.layer!r}", problem, "the size alone: the arrow is the direction")
            size, source = written.values[0], f"{mark.text!r} along an arrow"
        return self._force(end, tuple((size * (end - start) / np.hypot(*(end - start))).tolist()), source, kind)

    def _written(self, mark: Mark, *, distributed: bool) -> WrittenForce:
        """Parse the text of a mark, and note a missing unit; InputError if it is no force."""
        try:
            written = parse_force(mark.text or "", self._unit, distributed=distributed)
        except InputError as error:
            raise error.within(f"layer {mark.layer!r}") from None
        if not written.has_unit:
            self._notes.assumed.append(f"the text {mark.text!r} is in {self._unit}: it names no unit")
        return written

    def _force(self, at: Floats, force: tuple[float, ...], source: str, kind: str) -> list[dict[str, Any]]:
        """Return the load entries of a point force on the nearest free elements, which share it; report it."""
        distance = shapely.distance(self._shapes[self._free], shapely.Point(at))
        chosen = self._free[distance <= distance.min() + self._structure.reach].tolist()
        names = [str(self._cells[k].name) for k in chosen]
        # adding 0.0 turns a negative zero into zero
        vector, point = ([float(v) + 0.0 for v in values] for values in (force, at))
        size, point_text = (", ".join(f"{value:.9g}" for value in values) for values in (vector, point))
        on = f"element {names[0]!r}" if len(names) == 1 else f"elements {listed(names)}, which share it equally,"
        self._notes.found.append(f"{kind} force ({size}) {self._unit} on {on} at ({point_text}), {source}")
        share = [value / len(names) for value in vector]
        return [{"element": name, "force": share, "at": point} for name in names]

    def _pressure(self, path: Path, mark: Mark, written: WrittenForce, kind: str) -> dict[str, Any]:
        """Return the noted entry of a load per length or area; InputError for a line along no free edge."""
        size, power = written.per or (1.0, 1)
        metres = units.METRES.get(self._structure.unit, 1.0)
        pressure = written.values[0] * (metres / size) ** power
        if power == 1:
            pressure /= self._structure.thickness
        points = path.points[:, :2]
        probes = np.concatenate([points, 0.5 * (points[1:] + points[:-1])])
        edges = shapely.union_all(shapely.get_exterior_ring(self._shapes[self._free]))
        if shapely.distance(shapely.points(probes), edges).max() > self._structure.reach or path.points[:, 2].any():
            problem = f"the text {mark.text!r} is a load per length or area, and its line lies along no free edge"
            raise InputError(f"layer {mark.layer!r}", problem, "a line on the edge that it acts on")
        ends = [[float(v) + 0.0 for v in points[k]] for k in (0, -1)]
        reach = self._structure.reach
        along = shapely.buffer(shapely.LineString(points), reach, cap_style="flat")
        touched = [
            str(self._cells[k].name)
            for k in self._free.tolist()
            if shapely.length(shapely.intersection(shapely.get_exterior_ring(self._shapes[k]), along)) > 4.0 * reach
        ]
        where = " to ".join(f"({x:.9g}, {y:.9g})" for x, y in ends)
        text = f"{kind} pressure {pressure:.9g} {self._unit}/{self._structure.unit}² on elements {listed(touched)}"
        self._notes.found.append(f"{text} from {where}, {mark.text!r} along a line")
        return {"face": {"along": points.tolist()}, "pressure": pressure}
