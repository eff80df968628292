"""Tessellations of an outline: ways to cut it into cells, whose joints a search can choose from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Assembly, Deadline, Floats, InputError, ParameterError, blocks_of
from jld_core.build import build_assembly, materials
from jld_core.geometry import unions
from jld_core.refinement import refine
from jld_core.refinement import voussoirs as refinement_voussoirs
from jld_core.scene import Scene, parse_scene
from jld_practice.design.aligned import TriangleStresses, aligned_cells
from jld_practice.design.crushing import stresses_of_body
from jld_practice.design.loads import side_of, with_loads
from jld_practice.design.options import DesignOptions

_CELLS: Final = 45  # number of cells that a tessellation is to have: its search and its moves take seconds, not minutes

_MOST: Final = 400  # largest number of cells; a limit on the mass of blocks that asks for more cannot be met in minutes

_SMALLER: Final = 0.88  # factor on the size of cells while one exceeds the largest mass of a block

# Distance, relative to a cell, within which its corners move to those of the outline or to one another
_SNAP: Final = 0.25

_WEDGES: Final = 5  # number of wedges of a flat arch over an opening in a wall drawn as a solid

_TRIES: Final = 12  # number of sizes that are tried for a tessellation


@dataclass(frozen=True)
class Tessellation:
    """One way to cut an outline into cells, with its scene."""

    name: str  # short name, also of its folder
    words: str  # description
    scene: Scene | None  # scene of the cells with loads; None if the outline cannot be cut in this way
    problem: str = ""  # reason why it cannot be cut; "" if it can


def tessellations(
    outline: Scene,
    options: DesignOptions,
    until: Deadline | None = None,
    made: Callable[[Tessellation], None] = lambda _: None,
) -> list[Tessellation]:
    """Cut an outline in every known way; InputError if none fits or a load cannot act."""
    with_loads(outline, options)  # refuses loads that no tessellation can carry
    assembly = build_assembly(outline)
    planar = assembly.dimension == 2
    kinds = _planar(outline, assembly, options, until) if planar else _spatial(outline, assembly, options)
    side = side_of(assembly)
    found: list[Tessellation] = []
    for name, words, make in kinds:
        late = bool(found) and until is not None and until.passed()
        cut = Tessellation(name, words, None, "no time was left") if late else _made(name, words, make, options, side)
        alike = [one.name for one in found if cut.scene is not None and one.scene == cut.scene]
        found.append(Tessellation(name, words, None, f"the same stones as {alike[0]}") if alike else cut)
        made(found[-1])
    if all(one.scene is None for one in found):
        reasons = "; ".join(f"{one.name}: {one.problem}" for one in found)
        raise InputError(
            "the outline", f"no tessellation fits ({reasons})", "a larger `block_mass`, or another outline"
        )
    return found


_Make = Callable[[float], Scene]  # function that cuts an outline with cells of a relative size, 1 at first


def _made(name: str, words: str, make: _Make, options: DesignOptions, side: Floats) -> Tessellation:
    """Cut an outline with ever smaller cells until none exceeds the largest block mass, or say why not."""
    size, problem = 1.0, ""
    for _ in range(_TRIES):
        try:
            scene = with_loads(make(size), options, side)
        except InputError as error:
            return Tessellation(name, words, None, f"{error.where}: {error.problem}".lstrip(": "))
        assembly = build_assembly(scene)
        elements = assembly.elements
        # blocks as stated: cells, or the bricks of the usual bond
        heaviest = float(np.bincount(blocks_of(assembly, assembly.labels), elements.mass * ~elements.support).max())
        if options.block_mass is None or heaviest <= options.block_mass:
            return Tessellation(name, f"{words}, {len(elements.free)} cells", scene)
        problem = f"a block of {heaviest:.4g} exceeds the block mass"
        if len(elements.free) > _MOST:
            break
        size *= _SMALLER
    return Tessellation(name, words, None, problem)


def _planar(
    outline: Scene, assembly: Assembly, options: DesignOptions, until: Deadline | None
) -> list[tuple[str, str, _Make]]:
    """List name, description and cutting function of each planar tessellation."""
    elements, free = assembly.elements, assembly.elements.free
    lower, upper = elements.lower[free].min(axis=0), elements.upper[free].max(axis=0)
    area = float(sum(shapely.Polygon(elements.shape[k]).area for k in free))
    cell = _cell_size(assembly, area, 2, options)
    arcs = [
        arc
        for part in unions.union_outlines([elements.shape[k] for k in free])
        for arc in refinement_voussoirs.find_arcs(part.shell)
    ]

    def half_bricks(size: float) -> Scene:
        """Cut into bricks of two square cells in running bond, and these into halves."""
        width, height = _even(upper[0] - lower[0], size * cell), _fitting(upper[1] - lower[1], size * cell)
        bricks = _bare(refine(outline, (2.0 * width, height), kind="bond").scene)
        # corners that move would take cells of the usual bond off their supports
        return _ready(refine(bricks, (width, height)).scene, arcs, blocks=True)

    def stones(size: float) -> Scene:
        height = _fitting(upper[1] - lower[1], size * cell / math.sqrt(2.0))
        return _ready(refine(outline, (1.6 * size * cell, height), kind="bond", snap=_SNAP).scene, arcs)

    def voussoirs(size: float) -> Scene:
        count, rings = _voussoirs(arcs, lower, upper, size * cell)
        return _ready(refine(outline, voussoirs=count, rings=rings, snap=_SNAP).scene, arcs)

    def irregular(size: float) -> Scene:
        """Cut into Voronoi cells."""
        return _ready(refine(outline, (size * cell,), kind="voronoi", seed=options.seed, snap=_SNAP).scene, arcs)

    @cache
    def stresses() -> TriangleStresses:
        """Return the stresses of the uncut body, computed once for all sizes."""
        return stresses_of_body(build_assembly(with_loads(outline, options)), until)

    def aligned(size: float) -> Scene:
        """Cut along the principal stresses of the uncut body."""
        cells = aligned_cells(stresses(), size * cell).cells
        return _ready(refine(outline, (size * cell,), snap=_SNAP, cells=cells).scene, arcs)

    return [
        ("bond", "half bricks in running bond", half_bricks),
        ("stones", "courses of flat stones", stones),
        ("voussoirs", "voussoirs from the outline's own arcs", voussoirs),
        ("thrust", "stones whose head joints are normal to the thrust of the uncut body", aligned),
        ("voronoi", "irregular stones", irregular),
    ]


def _spatial(outline: Scene, assembly: Assembly, options: DesignOptions) -> list[tuple[str, str, _Make]]:
    """List name, description and cutting function of each spatial tessellation."""
    elements, free = assembly.elements, assembly.elements.free
    volume = float(elements.volume[free].sum())
    cell = _cell_size(assembly, volume, 3, options)
    extent = elements.upper[free].max(axis=0) - elements.lower[free].min(axis=0)
    side, height = side_of(assembly), float(extent @ abs(materials.direction_of_weight(outline)))

    def vault(bond: str) -> _Make:
        """Return the function that cuts a vault by voussoirs and courses of a bond."""

        def cut(size: float) -> Scene:
            span, length = float(extent @ side), float(extent @ (1.0 - side)) - height
            count = max(3, round(0.5 * math.pi * span / (size * cell) / 2.0) * 2 + 1)
            courses = max(2, round(length / (size * cell) / 2.0))
            return _ready(refine(outline, voussoirs=count, courses=courses, bond=bond).scene, [])

        return cut

    def grid(size: float) -> Scene:
        sizes = tuple(_fitting(float(length), size * cell) for length in extent)
        return _ready(refine(outline, sizes).scene, [])

    def walls(lintel: int) -> _Make:
        """Return the function that cuts walls into stretchers, with so many stones over an opening."""

        def cut(size: float) -> Scene:
            course = _fitting(height, size * cell / math.sqrt(2.0))
            return _ready(refine(outline, (1.6 * size * cell, course), kind="bond", lintel=lintel).scene, [])

        return cut

    return [
        ("bond", "voussoirs in shifted courses", vault("running")),
        ("courses", "voussoirs in courses in line", vault("stack")),
        ("walls", "courses of stretchers, bonded at the corners", walls(1)),
        ("arches", "the same with flat arches over openings", walls(_WEDGES)),
        ("grid", "a grid", grid),
    ]


def _cell_size(assembly: Assembly, measure: float, dimension: int, options: DesignOptions) -> float:
    """Return the side of a cell for about `_CELLS` cells, two of which weigh at most a block."""
    each = measure / _CELLS
    mass = float(assembly.elements.mass[assembly.elements.free].sum())
    if options.block_mass is not None:
        if mass <= 0.0:
            raise ParameterError("block_mass", "the structure has no weight", "a `density`")
        each = min(each, 0.5 * options.block_mass / mass * measure)
        if measure / each > _MOST:
            least = 2.0 * mass / _MOST
            kg = " kg" if assembly.units == ("m", "N") else ""
            problem = f"the structure of {mass:.4g}{kg} would be {mass / options.block_mass:.0f} blocks of that mass"
            wish = f"at least {least:.3g}{kg}, for {_MOST} cells at the most"
            if dimension == 2 and options.thickness is None:
                wish += ", or the `thickness` of the structure (1 where the outline states none)"
            raise ParameterError("block_mass", problem, wish)
    return float(each ** (1.0 / dimension))


def _fitting(length: float, size: float) -> float:
    """Return the length of equal parts of `length` whose number fits parts of about `size`."""
    return float(length / max(1, round(length / size)))


def _even(length: float, size: float) -> float:
    """Return the length of an even number of equal parts of `length`, each of about `size`."""
    return float(length / max(2, 2 * round(0.5 * length / size)))


def _voussoirs(arcs: list[refinement_voussoirs.Arc], lower: Any, upper: Any, cell: float) -> tuple[int, int]:
    """Return the numbers of voussoirs and of rings for cells of about one size."""
    hollow = [arc for arc in arcs if arc.hollow] or arcs
    if not hollow:
        return max(3, 2 * round(0.5 * (upper[0] - lower[0]) / cell) + 1), 1
    length = max(arc.sweep * arc.radius for arc in hollow)
    top = max(float(arc.centre[1]) + arc.radius for arc in hollow)
    depth = float(upper[1]) - top
    return max(3, 2 * round(0.5 * length / cell) + 1), max(1, round(depth / cell))


def _bare(scene: Scene) -> Scene:
    """Return a scene without labels and without block names of free elements."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document.pop("labels", None)
    for entry in document["elements"]:
        if not entry.get("support"):
            entry.pop("block", None)
    return parse_scene(document, scene.name)


def _ready(scene: Scene, arcs: list[refinement_voussoirs.Arc], *, blocks: bool = False) -> Scene:
    """Complete a planar scene by the key "move"; without `blocks` remove labels and block names."""
    kept = scene if blocks else _bare(scene)
    document = kept.model_dump(mode="json", exclude_defaults=True)
    limit = document.get("search", {}).get("block_mass")
    if scene.dimension == 2 and "move" not in document:
        centres = np.array([arc.centre for arc in arcs]).reshape(-1, 2)
        apart = [c for k, c in enumerate(centres) if all(np.hypot(*(c - d)) > 1e-6 for d in centres[:k])]
        along = [{"circle": centre.tolist()} for centre in apart]
        document["move"] = {"inner": "follow", "straight": False, "along": along}
    if limit is not None and "move" in document:
        document["move"].setdefault("block_mass", limit)
    return parse_scene(document, scene.name)


def region_words(scene: Scene) -> str:
    """Describe the free elements: area and arcs in the plane, number and volume of solids in space."""
    assembly = build_assembly(scene)
    if assembly.dimension == 3:
        elements, unit = assembly.elements, assembly.units[0]
        count, volume = len(elements.free), float(elements.volume[elements.free].sum())
        return f"{count} solid{'s' * (count != 1)}, volume {volume:.4g} {unit}³"
    shapes = [assembly.elements.shape[k] for k in assembly.elements.free]
    parts = unions.union_outlines(shapes)
    arcs = [
        arc
        for part in parts
        for arc in refinement_voussoirs.find_arcs(unions.region_of(shapely.Polygon(part.shell)).shell)
    ]
    unit = assembly.units[0]
    told = ", ".join(f"an arc of radius {arc.radius:.4g} {unit} over {math.degrees(arc.sweep):.4g}°" for arc in arcs)
    area = sum(shapely.Polygon(part.shell, part.holes).area for part in parts)
    return f"area {area:.4g} {unit}², {told or 'no arcs'}"
