"""The outline of a design: a scene, drawing or solid, with supports, materials and loads."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path as File
from typing import Any, Final

import numpy as np
import shapely

from jld_core.arrays import Floats
from jld_core.build import build_assembly
from jld_core.errors import InputError, ParameterError
from jld_core.exchange import ImportOptions
from jld_core.exchange.drawing import planar_scene
from jld_core.exchange.drawn import Drawing
from jld_core.exchange.options import DEFAULT_MATERIALS, Notes
from jld_core.exchange.paths import Path
from jld_core.exchange.readers import read_content, reading
from jld_core.exchange.solids import Part, Solids, spatial_scene
from jld_core.scene import Scene, load_scene, parse_scene
from jld_explore.design.options import LAID, LOW_FRICTION, DesignOptions

_LEVEL: Final = 1e-6
"""Height above the lowest point, relative to the size, up to which an edge or a face lies there."""

_FOOT: Final = 0.05
"""Height of supports that are added, relative to the size."""


@dataclass(frozen=True)
class Outline:
    """Outline of a structure, ready to be cut.

    Attributes
    ----------
    scene : Scene
        Scene with the outline as its free elements, and the loads that its file states.
    assumed : tuple of str
        What the file does not say, in sentences.
    """

    scene: Scene
    assumed: tuple[str, ...]


def read_outline(file: File, options: DesignOptions) -> Outline:
    """Read the outline of a design, and complete it by the options.

    file: scene, drawing or solid. Raises InputError where the file is broken, has no closed outline, or lacks something
    that the options do not say.
    """
    if _is_scene(file):
        for name in ("thickness", "unit", "support"):
            if getattr(options, name):
                raise ParameterError(
                    name, "the outline is a scene, which says so itself", "a drawing, or no such option"
                )
        scene, notes = load_scene(file), Notes()
    else:
        scene, notes = _imported(file, options)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"] = _materials(document["materials"], options, notes)
    search = dict(document.get("search", {}))
    if options.block_mass is not None:
        search["block_mass"] = [None, options.block_mass]
    if options.shapes is not None:
        search["shapes"] = [1, options.shapes]
    if options.laid is not None:
        search["assemble"] = LAID[options.laid][0]
    if search:
        document["search"] = search
    with reading(file):
        completed = parse_scene(document, str(file))
        build_assembly(completed)
    return Outline(completed, tuple(notes.assumed))


def _is_scene(file: File) -> bool:
    """Return True if a file holds a scene; a JSON file of COMPAS holds other keys."""
    if file.suffix.lower() != ".json":
        return False
    try:
        document = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return True  # the reader of scenes says in one line what is wrong
    return not isinstance(document, dict) or "loads" in document or "elements" in document or "grid" in document


def _imported(file: File, options: DesignOptions) -> tuple[Scene, Notes]:
    """Return the scene of a drawing or of solids, with supports below it where the file has none."""
    how, notes = ImportOptions(support=options.support, thickness=options.thickness, unit=options.unit), Notes()
    with reading(file):
        content = read_content(file, how, notes)
        if isinstance(content, Drawing):
            _refuse_open(content, how)
            found = planar_scene(_on_feet(content, how, notes), how, notes)
        else:
            found = spatial_scene(_solids_on_feet(content, how, notes), how, notes)
        # the options say what was assumed instead
        said = ("no load was found", "edit materials")
        loadless = any(said[0] in note for note in notes.assumed)
        notes.assumed = [note for note in notes.assumed if not any(words in note for words in said)]
        if loadless and options.load is None and options.push is None:
            notes.assumed.append("the live load is the weight acting sideways: no load was given or drawn")
        if found.document["materials"] == DEFAULT_MATERIALS:
            notes.assumed += _defaults(options)
        return parse_scene(found.document, str(file)), notes


def _defaults(options: DesignOptions) -> list[str]:
    """Return a sentence for each default value of a material that the options leave."""
    given = DEFAULT_MATERIALS
    values = {
        "density": ("density", given["density"]),
        "friction": ("friction", given["dry"]["friction_coefficient"]),
        "tension": ("tensile strength of the stone", given["inner"]["tensile_strength"]),
        "shear": ("shear strength of the stone", given["inner"]["shear_strength"]),
    }
    return [f"{words} {value:g}" for name, (words, value) in values.items() if getattr(options, name) is None]


def _refuse_open(drawing: Drawing, how: ImportOptions) -> None:
    """Raise InputError for an outline whose ends do not meet."""
    paths = [path for path in drawing.paths if how.role(path.layer) in (None, "support")]
    if any(path.closed for path in paths) or not paths:
        return
    lines = [shapely.LineString(path.points[:, :2]) for path in paths if len(path.points) > 1]
    whole = shapely.node(shapely.MultiLineString(lines))
    if shapely.polygonize([whole]).geoms:
        return
    ends = np.concatenate([np.array(line.coords)[[0, -1]] for line in lines])
    apart = np.hypot(*(ends[:, None] - ends[None]).transpose(2, 0, 1)) + np.diag(np.full(len(ends), np.inf))
    k = int(np.argmax(apart.min(axis=1)))
    problem = f"its outline is not closed: no other end lies at ({ends[k][0]:.6g}, {ends[k][1]:.6g})"
    raise InputError("", problem, "one closed line, or lines whose ends meet")


def _on_feet(drawing: Drawing, how: ImportOptions, notes: Notes) -> Drawing:
    """Add supports below the lowest straight edges of a drawing that has none."""
    named = {how.role(layer) for layer in [*(p.layer for p in drawing.paths), *(m.layer for m in drawing.marks)]}
    if "support" in named or how.support:
        return drawing
    shown = [path for path in drawing.paths if how.role(path.layer) is None and len(path.points) > 1]
    if not shown:
        return drawing
    points = np.concatenate([path.points[:, :2] for path in shown])
    size, low = float(np.ptp(points, axis=0).max()), float(points[:, 1].min())
    feet = []
    for path in shown:
        ring = np.concatenate([path.points, path.points[:1]]) if path.closed else path.points
        for a, b in itertools.pairwise(ring):
            level = max(a[1], b[1]) - low <= _LEVEL * size
            if level and a[2] == 0.0 and abs(b[0] - a[0]) > _LEVEL * size:
                feet.append(sorted((float(a[0]), float(b[0]))))
    boxes = [
        Path(
            np.array([[x0, low - _FOOT * size, 0.0], [x1, low - _FOOT * size, 0.0], [x1, low, 0.0], [x0, low, 0.0]]),
            True,
            "supports",
        )
        for x0, x1 in feet
    ]
    if boxes:
        notes.assumed.append(f"supports below the {len(boxes)} lowest edges: the drawing has no layer of supports")
    return replace(drawing, paths=[*drawing.paths, *boxes])


def _solids_on_feet(solids: Solids, how: ImportOptions, notes: Notes) -> Solids:
    """Add supports below the lowest faces of solids that have none."""
    if how.support or any(part.support or how.role(part.group) == "support" for part in solids.parts):
        return solids
    every = np.concatenate([part.vertices for part in solids.parts])
    size, low = float(np.ptp(every, axis=0).max()), float(every[:, 2].min())
    down = np.array([0.0, 0.0, _FOOT * size])
    level = [
        part.vertices[list(loop)]
        for part in solids.parts
        for loop in part.faces
        if (part.vertices[list(loop), 2] <= low + _LEVEL * size).all()
    ]
    if not level:
        return solids
    # triangles of one face are one foot
    whole = shapely.union_all([shapely.Polygon(face[:, :2]) for face in level])
    feet = []
    for k, foot in enumerate(part for part in shapely.get_parts(whole) if part.geom_type == "Polygon"):
        plan = shapely.get_coordinates(shapely.geometry.polygon.orient(foot).exterior)[:-1]
        top: Floats = np.column_stack([plan, np.full(len(plan), low)])
        count = len(top)
        sides = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
        loops = (tuple(range(count))[::-1], tuple(range(count, 2 * count)), *sides)
        feet.append(Part(f"foot{k}", "supports", np.concatenate([top - down, top]), loops, support=True))
    notes.assumed.append(f"supports below the {len(feet)} lowest faces: the file names none")
    return replace(solids, parts=[*solids.parts, *feet])


def _materials(materials: dict[str, Any], options: DesignOptions, notes: Notes) -> dict[str, Any]:
    """Return materials with the values of the options, and with what a search and its checks need."""
    found = {**materials}
    if options.density is not None:
        found["density"] = options.density
    dry = dict(found.get("dry") or DEFAULT_MATERIALS["dry"])
    inner = dict(found.get("inner") or DEFAULT_MATERIALS["inner"])
    if not found.get("dry") and options.friction is None:
        notes.assumed.append(f"friction {DEFAULT_MATERIALS['dry']['friction_coefficient']:g}")
    if not found.get("inner") and (options.tension is None or options.shear is None):
        strength = DEFAULT_MATERIALS["inner"]["tensile_strength"]
        notes.assumed.append(f"tensile and shear strength of the stone {strength:g}, where not given")
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
