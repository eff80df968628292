"""The outline of a design: a scene, drawing or solid, with supports, materials and loads."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, Final

import numpy as np
import shapely

from jld_core import InputError, ParameterError, Scene, build_assembly, load_scene, parse_scene
from jld_core.build import build_geometry
from jld_core.geometry import unions
from jld_formats import Notes, cells, import_file, libraries
from jld_formats import options as exchange_options
from jld_practice.design.options import LOW_FRICTION, READING, DesignOptions
from jld_practice.laying.order import LAID

# Keys of a search that speak of the cells of a scene, which a design cuts anew
_OF_CELLS: Final = ("block_cells", "dry_faces", "candidates", "keep", "except", "symmetry", "void")


@dataclass(frozen=True)
class Outline:
    """Scene of an outline to be cut, with the values that were assumed."""

    scene: Scene  # scene with the outline as its free elements, and the loads that its file states
    assumed: tuple[str, ...]  # values and choices that the file does not state, one phrase each


def read_outline(file: File, options: DesignOptions) -> Outline:
    """Read the scene, drawing or solid of an outline, and apply the options to it."""
    if _is_scene(file):
        for name in READING:
            if getattr(options, name):
                raise ParameterError(
                    name.partition("_")[0],
                    "the outline is a scene, which states this itself",
                    "a drawing, or no such option",
                )
        notes = Notes()
        with libraries.reading(file):
            scene = _united(load_scene(file), notes)
    else:
        scene, notes = _imported(file, options)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"] = _materials(document["materials"], options, notes)
    search = dict(document.get("search", {}))
    if options.block_mass is not None:
        search["block_mass"] = [None, options.block_mass]
    if options.shapes is not None:
        search["shapes"] = [1, options.shapes]
        # as moulds are counted on the page and in the cutting list; a planar stone may be turned over
        search.setdefault("moulds", {"rotate": True, "flip": scene.dimension == 2})
    if options.laid is not None:
        search["assemble"] = LAID[options.laid][0]
    if search:
        document["search"] = search
    with libraries.reading(file):
        completed = parse_scene(document, str(file))
        build_assembly(completed)
    return Outline(completed, tuple(notes.assumed))


def _is_scene(file: File) -> bool:
    """Return whether a file is a scene; broken JSON counts as one, whose reader names the error."""
    if file.suffix.lower() != ".json":
        return False
    try:
        document = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return True  # the reader of scenes says in one line what is wrong
    return not isinstance(document, dict) or "loads" in document or "elements" in document or "grid" in document


def _united(scene: Scene, notes: Notes) -> Scene:
    """Unite the free elements of a planar scene to outlines, and drop keys about its cells."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    owners = [document["loads"], *document["loads"].get("cases", [])]
    entries = [entry.model_dump(mode="json", exclude_defaults=True) for entry in build_geometry(scene).entries]
    free = [entry for entry in entries if not entry.get("support")]
    alike = not any(key in entry for entry in free for key in ("density", "weight", "volume", "centroid"))
    if scene.dimension == 3 or len(free) == 1 or scene.interfaces is not None or not alike or scene.materials.faces:
        return scene
    places = [
        entry["face"].get("between")
        for owner in owners
        for entry in owner.get("live", []) + owner.get("dead", [])
        if "face" in entry
    ]
    if scene.members or any(places):
        where = "members" if scene.members else "loads"
        problem = "they name elements, and the free ones of the scene become one outline"
        raise InputError(
            where,
            problem,
            'a pressure "along" a line' if any(places) else "a drawing or scene with one element for each part",
        )
    elements = build_assembly(scene).elements
    parts = unions.union_outlines([elements.shape[k] for k in elements.free])
    if any(part.holes for part in parts):
        return scene
    united = [{"id": f"outline{k}", "polygon": part.shell.tolist()} for k, part in enumerate(parts)]
    shapes = [shapely.Polygon(part.shell) for part in parts]

    def moved(entry: dict[str, Any]) -> dict[str, Any]:
        """Return a load that refers to the outline that its element is part of, wherever it acts."""
        if "element" not in entry:
            return entry
        k = elements.index[entry["element"]]
        inside = shapely.Polygon(elements.shape[k]).representative_point()
        number = int(np.argmin(shapely.distance(shapes, inside)))
        at = entry.get("at") or elements.centroid[k].tolist()
        return {**entry, "element": f"outline{number}", **({"at": at} if entry.get("force") is not None else {})}

    for owner in owners:
        for key in ("live", "dead"):
            if key in owner:
                owner[key] = [moved(entry) for entry in owner[key]]
    if scene.grid is not None:
        document["thickness"] = scene.grid.thickness
    left = [key for key in _OF_CELLS if document.get("search", {}).pop(key, None) is not None]
    notes.assumed.append(f"the {len(free)} elements of the scene are one outline, whose joints are chosen anew")
    if left:
        notes.assumed.append(f"search.{', search.'.join(left)} left out: they speak of the cells of the scene")
    for key in ("grid", "labels", "move"):
        document.pop(key, None)
    document["elements"] = [*united, *(entry for entry in entries if entry.get("support"))]
    return parse_scene(document, scene.name)


def _imported(file: File, options: DesignOptions) -> tuple[Scene, Notes]:
    """Convert a drawing or a file of solids to a scene, and collect what was assumed."""
    # Supports are added below it if the file has none.
    if options.load is not None and options.force("N") == options.force("kN"):
        raise ParameterError("load", f"{options.load!r} names no unit of force", 'a force, as "10 kN"')
    found = import_file(file, options.reading, feet=True)
    report = found.report
    notes = Notes(found=list(report.found), assumed=list(report.assumed), doubtful=list(report.doubtful))
    with libraries.reading(file):
        # the options say what was assumed instead
        said = ("no load was found", "edit materials")
        loadless = any(said[0] in note for note in notes.assumed)
        notes.assumed = [note for note in notes.assumed if not any(words in note for words in said)]
        if loadless and options.load is None and options.push is None:
            notes.assumed.append("the live load is the weight acting sideways: no load was given or drawn")
        if found.document["materials"] == exchange_options.DEFAULT_MATERIALS:
            notes.assumed += _defaults(options)
        scene = parse_scene(found.document, str(file))
    if scene.dimension == 3 and options.thickness is not None:
        raise ParameterError("thickness", "the outline is a solid, which has its own", "a drawing, or no such option")
    _refuse_size(scene, options, notes)
    return scene, notes


def _refuse_size(scene: Scene, options: DesignOptions, notes: Notes) -> None:
    """Raise ParameterError for an outline of a size that no structure has, if no unit is stated."""
    elements = build_geometry(scene).elements if scene.units.length == "m" else None
    for doubt in notes.doubtful:
        problem, _, unit = doubt.partition(", --unit ")
        if unit and options.unit is None and elements is not None:
            free = elements.free
            extent = elements.upper[free].max(axis=0) - elements.lower[free].min(axis=0)
            if cells.hardly_meant(float(extent.max())):
                raise ParameterError("unit", problem, f"a unit, such as {unit}")
        notes.assumed.append(f"doubtful: {problem}")


def _defaults(options: DesignOptions) -> list[str]:
    """List the default material values in words, without those that the options state."""
    given = exchange_options.DEFAULT_MATERIALS
    values = {
        "density": ("density", given["density"], " kg/m³"),
        "friction": ("friction", given["dry"]["friction_coefficient"], ""),
        "tension": ("tensile strength of the stone", given["inner"]["tensile_strength"] / 1e6, " N/mm²"),
        "shear": ("shear strength of the stone", given["inner"]["shear_strength"] / 1e6, " N/mm²"),
    }
    return [
        f"{words} {value:g}{unit}" for name, (words, value, unit) in values.items() if getattr(options, name) is None
    ]


def _materials(materials: dict[str, Any], options: DesignOptions, notes: Notes) -> dict[str, Any]:
    """Return the value of the key "materials" with those of the options and with defaults."""
    # Default strengths and friction replace missing ones, and a low friction is added.
    found = {**materials}
    if options.density is not None:
        found["density"] = options.density
    dry = dict(found.get("dry") or exchange_options.DEFAULT_MATERIALS["dry"])
    inner = dict(found.get("inner") or exchange_options.DEFAULT_MATERIALS["inner"])
    if not found.get("dry") and options.friction is None:
        notes.assumed.append(f"friction {exchange_options.DEFAULT_MATERIALS['dry']['friction_coefficient']:g}")
    if not found.get("inner") and (options.tension is None or options.shear is None):
        notes.assumed.append(f"{exchange_options.DEFAULT_STRENGTHS}, where not given")
    if options.friction is not None:
        dry.pop("friction_angle", None)
        dry["friction_coefficient"] = {"nominal": options.friction, "low": options.friction_low or 0.0}
    value = dry.get("friction_coefficient")
    if options.friction_low is None and (options.friction is not None or isinstance(value, float | int)):
        nominal = float(options.friction if options.friction is not None else value)  # type: ignore[arg-type]
        dry["friction_coefficient"] = {"nominal": nominal, "low": LOW_FRICTION * nominal}
        notes.assumed.append(f"low friction {LOW_FRICTION * nominal:.3g}, {LOW_FRICTION:g} of {nominal:g}")
    for name, key in (("tension", "tensile_strength"), ("shear", "shear_strength")):
        if getattr(options, name) is not None:
            inner[key] = getattr(options, name)
    return {**found, "dry": dry, "inner": inner}
