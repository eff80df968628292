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
from jld_core.assembly_sequence.order import LAID
from jld_core.build import build_assembly
from jld_core.build.assemble import build_geometry
from jld_core.errors import InputError, ParameterError
from jld_core.exchange import ImportOptions, Notes, Part, Solids
from jld_core.exchange.cells import hardly_meant
from jld_core.exchange.drawing import planar_scene
from jld_core.exchange.drawn_loads import Drawing
from jld_core.exchange.libraries import read_content, reading
from jld_core.exchange.options import DEFAULT_MATERIALS, DEFAULT_STRENGTHS
from jld_core.exchange.paths import Path
from jld_core.exchange.solids import spatial_scene
from jld_core.geometry.snapping import straight
from jld_core.geometry.unions import union_outlines
from jld_core.scene import Scene, load_scene, parse_scene
from jld_practice.design.options import LOW_FRICTION, DesignOptions

_LEVEL: Final = 1e-6  # height above the lowest point, relative to the size, up to which an edge or a face lies there

_LEAN: Final = 0.05  # least run of the sides of a flat arch over its depth; below it an outline is a wall

# Keys of a search that speak of the cells of a scene, which a design cuts anew
_OF_CELLS: Final = ("block_cells", "dry_faces", "candidates", "keep", "except", "symmetry", "void")

_FOOT: Final = 0.05  # height of supports that are added, relative to the size


@dataclass(frozen=True)
class Outline:
    """Scene of an outline to be cut, with the values that were assumed."""

    scene: Scene  # scene with the outline as its free elements, and the loads that its file states
    assumed: tuple[str, ...]  # values and choices that the file does not state, one phrase each


def read_outline(file: File, options: DesignOptions) -> Outline:
    """Read the scene, drawing or solid of an outline, and apply the options to it.

    Raises InputError if the file is broken, has no closed outline, or lacks something that the options do not state
    either. Options that a scene file states itself are refused with ParameterError.
    """
    if _is_scene(file):
        for name in ("thickness", "unit", "support"):
            if getattr(options, name):
                raise ParameterError(
                    name, "the outline is a scene, which states this itself", "a drawing, or no such option"
                )
        notes = Notes()
        with reading(file):
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
    with reading(file):
        completed = parse_scene(document, str(file))
        build_assembly(completed)
    return Outline(completed, tuple(notes.assumed))


def _is_scene(file: File) -> bool:
    """Return True if a file is a scene: JSON with the key "loads", "elements" or "grid".

    Broken JSON counts as a scene too, so that the reader of scenes reports the error.
    """
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
    parts = union_outlines([elements.shape[k] for k in elements.free])
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
    """Convert a drawing or a file of solids to a scene, and collect what was assumed.

    Raises InputError if it cannot be read, or an outline is open.
    """
    # Supports are added below it if the file has none.
    if options.load is not None and options.force("N") == options.force("kN"):
        raise ParameterError("load", f"{options.load!r} names no unit of force", 'a force, as "10 kN"')
    how, notes = ImportOptions(support=options.support, thickness=options.thickness, unit=options.unit), Notes()
    with reading(file):
        content = read_content(file, how, notes)
        if isinstance(content, Drawing):
            _refuse_open(content, how)
            _refuse_crossing(content, how)
            found = planar_scene(_on_feet(content, how, notes), how, notes)
        elif options.thickness is not None:
            raise ParameterError(
                "thickness", "the outline is a solid, which has its own", "a drawing, or no such option"
            )
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
            if hardly_meant(float(extent.max())):
                raise ParameterError("unit", problem, f"a unit, such as {unit}")
        notes.assumed.append(f"doubtful: {problem}")


def _defaults(options: DesignOptions) -> list[str]:
    """List the default material values in words, without those that the options state."""
    given = DEFAULT_MATERIALS
    values = {
        "density": ("density", given["density"], " kg/m³"),
        "friction": ("friction", given["dry"]["friction_coefficient"], ""),
        "tension": ("tensile strength of the stone", given["inner"]["tensile_strength"] / 1e6, " N/mm²"),
        "shear": ("shear strength of the stone", given["inner"]["shear_strength"] / 1e6, " N/mm²"),
    }
    return [
        f"{words} {value:g}{unit}" for name, (words, value, unit) in values.items() if getattr(options, name) is None
    ]


def _refuse_open(drawing: Drawing, how: ImportOptions) -> None:
    """Raise InputError if the lines of a drawing enclose no area, naming the loosest end."""
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


def _refuse_crossing(drawing: Drawing, how: ImportOptions) -> None:
    """Raise InputError if a closed outline of a drawing crosses itself, naming the place."""
    # Crossings that enclose less than a thousandth of the area are left to the import, which closes gaps.
    for path in drawing.paths:
        if not path.closed or how.role(path.layer) is not None or len(path.points) < 4:
            continue
        outline = shapely.Polygon(path.points[:, :2])
        covered = shapely.make_valid(outline).area
        if outline.is_valid or abs(covered - outline.area) <= 1e-3 * covered:
            continue
        x, y = shapely.is_valid_reason(outline).rstrip("]").rpartition("[")[2].split()[:2]
        problem = f"its outline crosses itself at ({float(x):.6g}, {float(y):.6g})"
        raise InputError("", problem, "corners in the order in which one walks round the outline")


def _on_feet(drawing: Drawing, how: ImportOptions, notes: Notes) -> Drawing:
    """Add supports below the lowest straight edges of a drawing without a layer of supports."""
    # The drawing is returned as it is if it has supports.
    named = {how.role(layer) for layer in [*(p.layer for p in drawing.paths), *(m.layer for m in drawing.marks)]}
    if "support" in named or how.support:
        return drawing
    shown = [path for path in drawing.paths if how.role(path.layer) is None and len(path.points) > 1]
    if not shown:
        return drawing
    points = np.concatenate([path.points[:, :2] for path in shown])
    size, low = float(np.ptp(points, axis=0).max()), float(points[:, 1].min())
    skewbacks = _skewbacks(shown[0].points, size) if len(shown) == 1 and shown[0].closed else []
    if skewbacks:
        notes.assumed.append("supports beside the raked sides of a flat arch: the drawing names none")
        return replace(drawing, paths=[*drawing.paths, *skewbacks])
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
        notes.assumed.append("supports below the lowest edges: the drawing names none")
    return replace(drawing, paths=[*drawing.paths, *boxes])


def _skewbacks(points: Floats, size: float) -> list[Path]:
    """Return supports beside both sides of an outline that is a flat arch; none for any other outline.

    points: (k, 3) x, y and bulge of a closed path.
    """
    # A flat arch has four corners, a level soffit at least as long as it is deep, and sides that lean outwards.
    corners = straight(points[:, :2])
    if len(corners) != 4 or points[:, 2].any():
        return []
    order = np.lexsort((corners[:, 0], corners[:, 1]))
    (x0, y0), (x1, y1), *upper = corners[order].tolist()
    (x2, y2), (x3, y3) = sorted(upper)
    level = abs(y1 - y0) <= _LEVEL * size
    deep = min(y2, y3) - y0
    if not (level and 0.0 < deep <= x1 - x0 and x0 - x2 > _LEAN * deep and x3 - x1 > _LEAN * deep):
        return []
    out = _FOOT * size
    return [
        Path(
            np.array([[xs, y0, 0.0], [xt + way * out, y0, 0.0], [xt + way * out, yt, 0.0], [xt, yt, 0.0]]),
            True,
            "supports",
        )
        for xs, xt, yt, way in ((x0, x2, y2, -1.0), (x1, x3, y3, 1.0))
    ]


def _solids_on_feet(solids: Solids, how: ImportOptions, notes: Notes) -> Solids:
    """Add supports below the lowest faces of solids, if no solid is a support."""
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
    notes.assumed.append("supports below the lowest faces: the file names none")
    return replace(solids, parts=[*solids.parts, *feet])


def _materials(materials: dict[str, Any], options: DesignOptions, notes: Notes) -> dict[str, Any]:
    """Return the value of the key "materials" with those of the options and with defaults."""
    # Default strengths and friction replace missing ones, and a low friction is added.
    found = {**materials}
    if options.density is not None:
        found["density"] = options.density
    dry = dict(found.get("dry") or DEFAULT_MATERIALS["dry"])
    inner = dict(found.get("inner") or DEFAULT_MATERIALS["inner"])
    if not found.get("dry") and options.friction is None:
        notes.assumed.append(f"friction {DEFAULT_MATERIALS['dry']['friction_coefficient']:g}")
    if not found.get("inner") and (options.tension is None or options.shear is None):
        notes.assumed.append(f"{DEFAULT_STRENGTHS}, where not given")
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
