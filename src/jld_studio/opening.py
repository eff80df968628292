"""Open a file that is dropped on the page or named by a command: a scene, a drawing or a file of solids."""

from __future__ import annotations

import base64
import binascii
import copy
import itertools
import re
import shlex
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from jld_core import InputError, Scene, build_assembly, load_scene, parse_scene, plugins
from jld_core.build import build_geometry
from jld_core.scene import NeedsImport, cracks
from jld_formats import (
    Imported,
    ImportOptions,
    Notes,
    Report,
    Solids,
    drawn_loads,
    import_file,
    libraries,
    planar_scene,
    solids,
)
from jld_formats import options as exchange_options
from jld_formats import paths as exchange_paths

LAYERS: Final = (*exchange_options.LAYER_ROLES, "layer")  # options of an import that name layers
NUMBERS: Final = ("thickness", "tolerance", "facet")  # options of an import that are lengths
KNOWN: Final = (*LAYERS, *NUMBERS, "unit", "up")  # options of an import that the page may state
KINDS: Final = ("found", "snapped", "assumed", "skipped", "doubtful")
"""Kinds of sentences of a report, as its attributes."""


@dataclass(frozen=True)
class OpenedFile:
    scene: Scene  # scene of the file, its name that of the file where the file has none
    report: tuple[tuple[str, str], ...]  # what was read in sentences, each after its kind, as "found" or "skipped"
    unit: str = ""  # length unit of the file, in which tolerances are given; "" for a scene file


@contextmanager
def received(name: object, content: object) -> Iterator[Path]:
    """Write a file that the page sends in base64 into a folder, not named by errors, while it is read."""
    if not isinstance(name, str) or not name or len(name) > 200 or not name.isprintable() or set(name) & set("/\\"):
        raise InputError("name", f"it is {str(name)[:60]!r}", "the plain name of a file")
    if not isinstance(content, str):
        raise InputError("content", "it is no text", "the bytes of the file in base64")
    try:
        data = base64.b64decode(content, validate=True)
    except (binascii.Error, ValueError):
        raise InputError("content", "it is not base64", "the bytes of the file in base64") from None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        try:
            yield path
        except InputError as error:
            if error.parameter:
                raise
            where = error.where.replace(f"{folder}/", "")
            raise InputError(where, error.problem.replace(f"{folder}/", ""), error.expected) from None


def require_followed(scene: Scene, where: str) -> Scene:
    """Return a scene; raise InputError if the studio does not support it."""
    if isinstance(scene.cracks, cracks.CellCracks):
        raise InputError(
            f"{where}: cracks", "the studio supports cracks by faces and by fields only", '"faces" or "fields"'
        )
    return scene


def read_file(path: Path, options: ImportOptions) -> OpenedFile:
    """Return the scene of a scene file, drawing or file of solids; raise InputError for none."""
    scene = stated_scene(path)
    if scene is not None:
        entries = [entry.model_dump(mode="json", exclude_defaults=True) for entry in build_geometry(scene).entries]
        measured = exchange_options.measure(entries)
        supports = exchange_options.several(len(entries) - measured.free, "support")
        counted = f"{exchange_options.several(measured.free, 'element')} and {supports}"
        return OpenedFile(scene, (("found", f"{counted}, {exchange_options.in_words(measured, scene.units.length)}"),))
    imported = import_file(path, options)
    report = tuple((kind, on_page(text)) for kind, text in sentences(imported.report))
    return OpenedFile(scene_of(imported, path), report, imported.unit)


def stated_scene(path: Path) -> Scene | None:
    """Return the scene of a scene file, None for a file that is to be imported; raise InputError for a broken scene."""
    if path.suffix.lower() != ".json":
        return None
    try:
        scene = require_followed(load_scene(path), path.name)
        build_assembly(scene)
    except NeedsImport:
        return None
    except InputError as error:
        if path.read_bytes()[:1] == b"[":  # a list of meshes
            return None
        raise (error if error.where.startswith(str(path)) else error.within(path.name)) from None
    return scene


def scene_of(imported: Imported, path: Path) -> Scene:
    try:
        scene = parse_scene(imported.document, "")
        build_assembly(scene)
    except InputError as error:
        raise imported.in_unit_of_file(error, "tolerance").within(path.name) from None
    return require_followed(scene, path.name)


def sentences(report: Report) -> Iterator[tuple[str, str]]:
    """Yield the sentences of the report of an import, each after its kind."""
    yield from ((kind, text) for kind in KINDS for text in getattr(report, kind))


def on_page(text: str) -> str:
    """Return a sentence of an import with the fields of the page in place of flags."""
    return re.sub(r"--([a-z]+)", r'"\1"', text.replace(", or --like SCENE", ""))


def options_of(options: object) -> ImportOptions:
    """Return the options of an import that a request states; raise InputError for others."""
    if not isinstance(options, Mapping):
        raise InputError("options", "they are no JSON object", "an object")
    chosen: dict[str, Any] = {}
    for key, value in options.items():
        if key not in KNOWN:
            raise InputError(str(key)[:40], "an import has no such option", "one of " + ", ".join(KNOWN))
        if value is None or value == "":
            continue
        if key in NUMBERS:
            if type(value) not in (int, float):
                raise InputError(key, f"{str(value)[:40]!r} is wrong", "a length as a number")
            chosen[key] = float(value)
        elif key in LAYERS and isinstance(value, list) and all(isinstance(part, str) for part in value):
            chosen[key] = tuple(value)
        elif not isinstance(value, str):
            raise InputError(key, f"{str(value)[:40]!r} is wrong", "a text")
        else:
            chosen[key] = (
                value if key in ("unit", "up") else tuple(part.strip() for part in value.split(",") if part.strip())
            )
    return ImportOptions(**chosen)


def stated(options: ImportOptions) -> dict[str, Any]:
    """Return the options of an import that differ from those of none, as a request states them."""
    values = {key: getattr(options, key) for key in KNOWN}
    return {key: list(value) if key in LAYERS else value for key, value in values.items() if value not in (None, ())}


DESIGNED: Final = {"mass": "block-mass", "force": "load", "seconds": "seconds"}
"""Settings of a design that the page states, and the options of `jld design`."""

_SECONDS: Final = 60.0, 10.0  # time in which a file is read and understood, s, and further time for each megabyte
_REACH: Final = 2e-3  # distance, relative to the size, within which a path lies on the boundary of an element
_MOST_FACES: Final = 6_000  # number of faces above which the page draws solids as boxes
_REMEDY: Final = re.compile(r"--(hole|unit|up|tolerance) (.+)")  # what the sentence of a report advises
_LACKING: Final = "it has no support"  # problem of a file that stands on nothing
_Y_UP: Final = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))  # rows by which y becomes z
_BOX: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def understood(path: Path, options: ImportOptions, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an import understands of a file: "report", "layers", "shapes", "elements", "commands".

    "refused", "undesigned": why it opens as no scene, why no design can start.
    """
    libraries.reader_of(path)  # there is such a file
    seconds = _SECONDS[0] + _SECONDS[1] * path.stat().st_size / 2**20
    with libraries.reading(path):
        answer: dict[str, Any] = libraries.in_own_process(
            _understood, path.absolute(), options, settings, seconds=seconds
        )
    return answer


def _understood(path: Path, options: ImportOptions, settings: Mapping[str, Any]) -> dict[str, Any]:
    notes, read = Notes(), libraries.reader_of(path).read
    assert read is not None
    with libraries.reading(path), libraries.without_collection():
        content = drawing = read(path, options, notes)
        if options.skip or options.layer:  # some readers leave out what is not to be read
            drawing = read(path, replace(options, skip=(), layer=("*",) if options.layer else ()), Notes())
    imported, import_notes, refused = _import_content(path, content, options, notes, feet=False)
    undesigned = refused
    if refused is not None and _LACKING in refused.problem:  # a design adds supports
        imported, notes_with_feet, undesigned = _import_content(path, content, options, notes, feet=True)
        import_notes = notes_with_feet if undesigned is None else import_notes
    if "design" not in plugins.entry_points("jld.commands"):
        undesigned = InputError("jld design", "it is not installed", "pip install jld, whole")
    parts = (
        _planar(drawing, options, imported)
        if isinstance(drawing, drawn_loads.Drawing)
        else _spatial(drawing, options, imported)
    )
    layers = _layers(drawing, options)
    facts = {} if imported is None else imported.facts()
    return {
        "report": [[kind, *_advised(text, layers)] for kind, text in sentences(import_notes.report())],
        "refused": None if refused is None else [_line(refused), _remedy(str(refused), layers)],
        "undesigned": None if undesigned is None else _line(undesigned),
        "planar": isinstance(drawing, drawn_loads.Drawing),
        "layers": list(layers.values()),
        **parts,
        "size": facts.get("size"),
        "length": facts.get("length", "m"),
        "unit": facts.get("unit", drawing.unit or "m"),
        "options": stated(options),
        "commands": {
            "import": shlex.join(["jld", "import", path.name, "-o", f"{path.stem}_scene.json", *flags(options)]),
            "design": shlex.join(design_command(path.name, f"{path.stem}_design", options, settings)),
        },
    }


def flags(options: ImportOptions) -> list[str]:
    pairs = [(key, item) for key, value in stated(options).items() for item in (value if key in LAYERS else [value])]
    return [text for key, item in pairs for text in (f"--{key}", f"{item:.12g}" if type(item) is float else item)]


def design_command(file: str, out: str, options: ImportOptions, settings: Mapping[str, Any]) -> list[str]:
    """Return the command line of a design, as words.

    Raises InputError for settings that the page does not state.
    """
    for key, value in settings.items():
        kinds = (str,) if key == "force" else (int, float)
        if key not in DESIGNED or type(value) not in kinds:
            expected = "mass and seconds as numbers, force as a text"
            raise InputError(str(key)[:40], f"{str(value)[:40]!r} is wrong", expected)
    if options.facet is not None:
        raise InputError("facet", "jld design has no such option", "the field left empty")
    words = [word for key, value in settings.items() for word in (f"--{DESIGNED[key]}", str(value))]
    return ["jld", "design", file, "-o", out, *flags(options), *words]


def _import_content(
    path: Path, content: drawn_loads.Drawing | Solids, options: ImportOptions, notes: Notes, *, feet: bool
) -> tuple[Imported | None, Notes, InputError | None]:
    """Import the content of a file; return the result, the notes, and why it makes no scene; feet: add supports."""
    import_notes, imported = copy.deepcopy(notes), None
    try:
        with libraries.reading(path), libraries.without_collection():
            if isinstance(content, drawn_loads.Drawing):
                imported = planar_scene(content, options, import_notes, feet=feet)
            else:
                imported = solids.spatial_scene(content, options, import_notes, feet=feet)
        scene_of(imported, path)  # it may refuse
    except InputError as error:
        if error.parameter:
            raise  # a wrong option is the user's, not the file's
        return imported, import_notes, error
    return imported, import_notes, None


def _line(error: InputError) -> str:
    """Return an error in one line, without the folder of its file and the quotes of parameters."""
    plain = re.sub(r'`(\w+)(?:=("?\w*"?))?`', r"\1 \2", re.sub(r"/\S*/", "", str(error)))
    return " ".join(on_page(plain).split())


def _advised(text: str, layers: Mapping[str, Any]) -> tuple[str, dict[str, Any] | None]:
    """Return a sentence for the page, and the option that it advises, which then is no part of it."""
    remedy = _remedy(text, layers)
    return (on_page(text), None) if remedy is None else (_REMEDY.sub("", text).rstrip(" ,:"), remedy)


def _remedy(text: str, layers: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the option that a sentence advises, as {"option", "value"}, None without one."""
    advice = _REMEDY.search(text)
    if advice is None:
        return {"option": "support", "value": "lowest"} if _LACKING in text else None
    option, value = advice[1], advice[2].split()[0].rstrip(".,;:")
    if option == "hole":
        return {"option": option, "value": advice[2]} if advice[2] in layers else None
    if option != "tolerance":
        return {"option": option, "value": value}
    try:
        return {"option": option, "value": float(value)}
    except ValueError:
        return None


def _layers(drawn: drawn_loads.Drawing | Solids, options: ImportOptions) -> dict[str, dict[str, Any]]:
    """Return name, role, role by its name alone, and number of shapes of each layer of a file."""
    planar, no_options = isinstance(drawn, drawn_loads.Drawing), ImportOptions()
    shapes = (
        [p.layer for p in drawn.paths] if isinstance(drawn, drawn_loads.Drawing) else [p.group for p in drawn.parts]
    )
    marks = [mark.layer for mark in drawn.marks]
    layers: dict[str, dict[str, Any]] = {}
    for layer in [*shapes, *marks]:
        role = _role(layer, "" if planar else layer, options, planar=planar or layer not in shapes)
        named = _role(layer, "", no_options, planar=planar or layer not in shapes)
        entry = layers.setdefault(layer, {"name": layer, "role": role, "named": named, "count": 0})
        entry["count"] += 1
    return layers


def _role(layer: str, name: str, options: ImportOptions, *, planar: bool) -> str:
    """Return the role of a layer, "block" for an ordinary one; solids are blocks, supports or not read."""
    if planar:
        return options.role(layer) or "block"
    return "support" if options.role(layer) == "support" else "block" if options.chosen(layer, name) else "skip"


def _planar(drawn: drawn_loads.Drawing, options: ImportOptions, imported: Imported | None) -> dict[str, Any]:
    entries = [] if imported is None else imported.document["elements"]
    scale, doubted = (1.0, ()) if imported is None else (imported.scale, imported.report.doubted)
    elements = [
        {
            "id": entry["id"],
            "outline": (np.array(entry["polygon"]) / scale).tolist(),
            "support": bool(entry.get("support")),
            "doubtful": entry["id"] in doubted,
        }
        for entry in entries
    ]
    shapes = [
        {
            "points": path.points.tolist(),
            "holes": [hole.tolist() for hole in path.holes],
            "closed": path.closed,
            "layer": path.layer,
            "role": role if (role := options.role(path.layer) or "block") != "block" or used else "unused",
        }
        for path, used in zip(drawn.paths, _used(drawn.paths, elements), strict=True)
    ]
    marks = [_mark(mark, mark.at, mark.end, options) for mark in drawn.marks]
    return {"shapes": shapes, "elements": elements, "marks": marks}


def _mark(
    mark: drawn_loads.Mark | drawn_loads.SolidMark, start: Any, end: Any, options: ImportOptions
) -> dict[str, Any]:
    ends = {name: None if at is None else [float(v) for v in at] for name, at in (("at", start), ("end", end))}
    return {**ends, "text": mark.text or "", "layer": mark.layer, "role": options.role(mark.layer) or "block"}


def _used(paths: Sequence[exchange_paths.Path], elements: Sequence[Mapping[str, Any]]) -> Sequence[bool]:
    """Return for each path whether at least half of its corners and middles lie on outlines of elements."""
    if not elements:
        return [True] * len(paths)
    rings = shapely.STRtree([shapely.LinearRing(element["outline"]) for element in elements])
    straight = [path.points[:-1, 2] == 0.0 for path in paths]
    middles = [
        0.5 * (path.points[1:, :2] + path.points[:-1, :2])[is_straight]
        for path, is_straight in zip(paths, straight, strict=True)
    ]
    probes = [np.concatenate([path.points[:, :2], middle]) for path, middle in zip(paths, middles, strict=True)]
    owner, points = np.repeat(np.arange(len(paths)), list(map(len, probes))), np.concatenate(probes)
    reach = _REACH * float(np.ptp(np.concatenate([element["outline"] for element in elements]), axis=0).max())
    near = np.zeros(len(points))
    near[rings.query(shapely.points(points), predicate="dwithin", distance=reach)[0]] = 1.0
    used: list[bool] = (np.bincount(owner, near, len(paths)) >= 0.5 * np.bincount(owner)).tolist()
    return used


def _spatial(drawn: Solids, options: ImportOptions, imported: Imported | None) -> dict[str, Any]:
    """Return "shapes" of solids, in the unit of the file with z upwards; "elements" is empty."""
    entries, scale = ([], 1.0) if imported is None else (list(imported.document["elements"]), imported.scale)
    boxes = sum(len(part.faces) for part in drawn.parts) > _MOST_FACES
    turn = np.array(_Y_UP) if options.up == "y" else np.eye(3)
    shapes = []
    for part in drawn.parts:
        role = _role(part.group, part.name, options, planar=False)
        entry = entries.pop(0) if entries and role != "skip" else None
        role = "support" if part.support or (entry and entry.get("support")) else role
        corners, faces = part.vertices @ turn, part.faces
        if entry is not None:  # turned outward and merged
            corners, faces = np.array(entry["vertices"]) / scale, entry["faces"]
        if boxes:
            x, y, z = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
            corners, faces = np.array(list(itertools.product(x, y, z))), _BOX
        shapes.append(_solid(part.name, part.group, role, corners, faces, outward=boxes or entry is not None))
    # entries without a part are supports that reading added
    feet = [
        _solid(entry["id"], None, "support", np.array(entry["vertices"]) / scale, entry["faces"], outward=True)
        for entry in entries
    ]
    marks = []
    for mark in drawn.marks:
        start, tip = (mark.at, None) if mark.tail is None else (mark.tail, mark.at @ turn)
        marks.append(_mark(mark, start @ turn, tip, options))
    return {"shapes": shapes + feet, "elements": [], "marks": marks}


def _solid(name: str, layer: str | None, role: str, corners: Any, faces: Any, *, outward: bool) -> dict[str, Any]:
    loops = [list(map(int, loop)) for loop in faces]
    return {"name": name, "layer": layer, "role": role, "corners": corners.tolist(), "faces": loops, "outward": outward}
