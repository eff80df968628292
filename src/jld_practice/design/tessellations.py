"""Tessellations of an outline: ways to cut it into cells, whose joints a search can choose from."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import numpy as np
import shapely
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import spsolve

from jld_core import (
    Assembly,
    Deadline,
    Floats,
    InputError,
    Ints,
    ParameterError,
    Route,
    Scene,
    blocks_of,
    build_assembly,
    parse_scene,
)
from jld_core.build import materials
from jld_core.fields import bounds, problem
from jld_core.geometry import unions
from jld_core.refinement import arrangement, refine
from jld_masonry import voussoirs as refinement_voussoirs
from jld_practice.design.options import DesignOptions, side_of, with_loads

_SMOOTH: Final = 0.8  # length over which stresses are averaged, relative to a cell

# Weight of equal spacing of joints beside their direction: spacing may vary, as between voussoirs of an arch
_STRETCH: Final = 0.15

_FAINT: Final = 0.02  # weight of the direction where there is no stress, relative to that under the mean stress

_LITTLE: Final = 0.3  # stress, relative to the mean, whose direction counts half

_STRAIGHT: Final = 0.12  # distance, relative to a cell, by which a joint may leave its curve; joints have few corners

# Distance from the outline, relative to a cell, within which joints do not run along it: cells would be slivers
_BESIDE: Final = 0.15

_ALONG: Final = 2.5  # length of a joint near the outline, over that distance, from which on it runs along it

# Area of a cell, over the square of the wanted side, above which it is halved: few lines pass where stress is weak
_LARGEST: Final = 1.8

# Distance by which cells reach beyond the outline, relative to a cell: it cuts them, and shares no edges
_OUTSIDE: Final = 1e-3

_PAST: Final = 5.0  # length by which joints are extended beyond the outline, over that distance

_ON: Final = 1e-7  # distance from the outline, relative to the structure, up to which a line lies on it


@dataclass(frozen=True)
class AlignedCells:
    """Cells whose joints follow the principal stresses of a body."""

    cells: list[shapely.Polygon]  # cells that cover the body
    # mean angle between the normals of head joints and the compression, weighted by length and stress, radians
    deviation: float


@dataclass(frozen=True)
class TriangleStresses:
    points: Floats  # (p, 2) nodes, length
    triangles: Ints  # (t, 3) nodes of each triangle, counter-clockwise
    stress: Floats  # (t, 3) mean σx, σy, τxy in each triangle, tension positive

    @property
    def gradients(self) -> tuple[Floats, Floats]:
        """Return the gradients (t, 3, 2) of the linear shape functions, and the areas (t,)."""
        p = self.points[self.triangles]
        opposite = np.roll(p, -2, axis=1) - np.roll(p, -1, axis=1)
        first, second = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        twice = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
        return turned / twice[:, None, None], 0.5 * twice


def aligned_cells(field: TriangleStresses, size: float) -> AlignedCells:
    """Cut a planar body along the principal directions of its stresses."""
    # Head joints are level lines of a function whose gradient follows the compression, and beds those of a function
    # whose gradient is at right angles to it. Both are weighted least-squares fits; the sign of the direction is made
    # alike from triangle to triangle. Lines between two crossings become straight where they leave the curve by little.
    gradient, area = field.gradients
    deviator = _smooth(field, gradient, area, _SMOOTH * size)
    strength = np.hypot(*deviator.T)
    mean = float(strength @ area / area.sum())
    if not mean > 0.0:
        raise InputError("stresses", "they have no direction: all are 0 or alike in every direction", "a loaded body")
    weight = strength / (strength + _LITTLE * mean) + _FAINT
    # the compression is at right angles to the largest principal stress
    angle = 0.5 * np.arctan2(deviator[:, 1], deviator[:, 0]) + 0.5 * np.pi
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    part = _orient(field.triangles, direction, weight * area)
    across = np.column_stack([-direction[:, 1], direction[:, 0]])
    heads = _fit_potential(field, gradient, area * weight, direction)
    beds = _fit_potential(field, gradient, area * weight, across)
    lines: list[shapely.LineString] = []
    deviation, total = 0.0, 0.0  # sum of angles of head joints by weight, and of weights
    for number in range(int(part.max()) + 1):
        of_part = part == number
        triangles = field.triangles[of_part]
        head_joints, triangle = _level_lines(field.points, triangles, heads, size)
        bed_joints, _ = _level_lines(field.points, triangles, beds, size)
        lines += [*shapely.linestrings(head_joints), *shapely.linestrings(bed_joints)]
        if len(head_joints):
            angle, length = _deviations(head_joints, direction[of_part][triangle])
            share = length * strength[of_part][triangle]
            deviation += float(share @ angle)
            total += float(share.sum())
    if len(lines) > arrangement.MOST:
        raise InputError("cell", f"that makes {len(lines):.3g} pieces of joints", f"at most {arrangement.MOST}")
    cells = _halve(_cells(field, lines, size), field, direction, _LARGEST * size**2)
    return AlignedCells(cells, deviation / total if total > 0.0 else 0.0)


def _deviations(segments: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Return the angles (s,) between segments (s, 2, 2) and the normals of directions (s, 2), and the lengths (s,)."""
    along = segments[:, 1] - segments[:, 0]
    length = np.hypot(*along.T)
    sine = np.abs(np.einsum("sd,sd->s", along, direction)) / np.maximum(length, 1e-300)
    return np.arcsin(np.minimum(sine, 1.0)), np.asarray(length)


def _matrix(triangles: Ints, blocks: Floats, count: int) -> csr_matrix:
    """Assemble element matrices (t, 3, 3) to a sparse matrix of all nodes."""
    rows, columns = np.repeat(triangles, 3, axis=1), np.tile(triangles, (1, 3))
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count)).tocsr()


def _lump(triangles: Ints, values: Floats, count: int) -> Floats:
    """Return the sum (count,) at each node of a third of the values (t,) of its triangles."""
    return np.asarray(np.bincount(triangles.ravel(), np.repeat(values / 3.0, 3), count), dtype=float)


def _smooth(field: TriangleStresses, gradient: Floats, area: Floats, length: float) -> Floats:
    """Return (σx − σy)/2 and τxy (t, 2) of the triangles, averaged over a length."""
    # One implicit step of diffusion: (M + l² K) v = M v0 at the nodes.
    count = len(field.points)
    raw = np.column_stack([0.5 * (field.stress[:, 0] - field.stress[:, 1]), field.stress[:, 2]])
    mass = _lump(field.triangles, area, count)
    mass = np.where(mass > 0.0, mass, 1.0)
    stiffness = _matrix(field.triangles, np.einsum("tid,tjd,t->tij", gradient, gradient, area), count)
    system = (diags(mass) + length**2 * stiffness).tocsc()
    nodal = [spsolve(system, _lump(field.triangles, component * area, count)) for component in raw.T]
    return np.asarray(np.column_stack(nodal)[field.triangles].mean(axis=1))


def _orient(triangles: Ints, direction: Floats, weight: Floats) -> Ints:
    """Give directions (t, 2) like signs in place, from the triangles of largest weight on; return the parts (t,)."""
    # Triangles that hang together over edges are one part.
    edges: dict[tuple[int, int], list[int]] = {}
    for number, (a, b, c) in enumerate(triangles.tolist()):
        for pair in ((a, b), (b, c), (c, a)):
            edges.setdefault((min(pair), max(pair)), []).append(number)
    beside: list[list[int]] = [[] for _ in triangles]
    for users in edges.values():
        if len(users) == 2:
            beside[users[0]].append(users[1])
            beside[users[1]].append(users[0])
    part = np.full(len(triangles), -1, dtype=np.int64)
    number = 0
    for root in np.argsort(-weight, kind="stable").tolist():
        if part[root] >= 0:
            continue
        heap = [(-float(weight[root]), root, root)]
        while heap:
            _, triangle, before = heapq.heappop(heap)
            if part[triangle] >= 0:
                continue
            part[triangle] = number
            if float(direction[triangle] @ direction[before]) < 0.0:
                direction[triangle] *= -1.0
            for other in beside[triangle]:
                if part[other] < 0:
                    heapq.heappush(heap, (-float(weight[other]), other, triangle))
        number += 1
    return part


def _fit_potential(field: TriangleStresses, gradient: Floats, weight: Floats, direction: Floats) -> Floats:
    """Return the function (p,) at nodes whose gradient is parallel to directions (t, 2), and about as long.

    weight: (t,).
    """
    # Minimises Σ w [(∇φ·d⊥)² + η (∇φ·d − 1)²], with a small part of w alike in all directions.
    count = len(field.points)
    along = np.einsum("tid,td->ti", gradient, direction)
    across = np.einsum("tid,td->ti", gradient, np.column_stack([-direction[:, 1], direction[:, 0]]))
    blocks = np.einsum("ti,tj->tij", across, across) + _STRETCH * np.einsum("ti,tj->tij", along, along)
    matrix = _matrix(field.triangles, blocks * weight[:, None, None], count)
    right = np.bincount(field.triangles.ravel(), (_STRETCH * weight[:, None] * along).ravel(), count)
    # the mean is free: a small mass fixes it, far below the stiffness
    scale = float(matrix.diagonal().mean())
    return np.asarray(spsolve((matrix + diags(np.full(count, 1e-9 * scale))).tocsc(), right))


def _level_lines(points: Floats, triangles: Ints, values: Floats, size: float) -> tuple[Floats, Ints]:
    """Return the segments (s, 2, 2) of level lines at about a distance, and the triangle (s,) of each.

    points: (p, 2). triangles: (t, 3). values: (p,).
    """
    # The levels divide the range of the values in equal parts.
    at_corners = values[triangles]
    low, high = float(at_corners.min()), float(at_corners.max())
    levels = np.linspace(low, high, max(1, round((high - low) / size)) + 1)[1:-1]
    segments, owner = [np.zeros((0, 2, 2))], [np.zeros(0, dtype=np.int64)]
    for level in levels.tolist():
        # a level through a node passes beside it
        distance = at_corners - level
        distance = np.where(np.abs(distance) < _GRID * (high - low), _GRID * (high - low), distance)
        cut = np.flatnonzero((distance.min(axis=1) < 0.0) & (distance.max(axis=1) > 0.0))
        # the corner that lies alone on its side of the level: the line crosses both of its edges
        d = distance[cut]
        lone = np.where((d > 0.0).sum(axis=1) == 1, (d > 0.0).argmax(axis=1), (d < 0.0).argmax(axis=1))
        row = np.arange(len(cut))
        ends = []
        for step in (1, 2):
            other = (lone + step) % 3
            share = d[row, lone] / (d[row, lone] - d[row, other])
            p, q = points[triangles[cut, lone]], points[triangles[cut, other]]
            # the same point from both triangles of an edge
            ends.append(p + share[:, None] * (q - p))
        segments.append(np.stack(ends, axis=1))
        owner.append(cut)
    return np.concatenate(segments), np.concatenate(owner)


_GRID: Final = 1e-9  # grid of joints, relative to the body; levels keep as far from nodes, relative to their range


def _cells(field: TriangleStresses, lines: list[shapely.LineString], size: float) -> list[shapely.Polygon]:
    """Return the polygons that joints and the outline enclose; joints straightened between crossings."""
    # Cells reach a little beyond the outline.
    body = shapely.union_all(shapely.polygons(field.points[field.triangles]))
    extent = float(np.ptp(field.points, axis=0).max())
    outline = shapely.boundary(body)
    joined = shapely.line_merge(shapely.union_all([outline, *lines], grid_size=_GRID * extent))
    near, beside = outline.buffer(_ON * extent), outline.buffer(_BESIDE * size)
    chains = []
    for chain in shapely.get_parts(joined):
        if near.covers(chain):
            continue
        straight = shapely.simplify(chain, _STRAIGHT * size)
        along = [
            piece
            for piece in shapely.get_parts(shapely.intersection(straight, beside))
            if piece.length > _ALONG * _BESIDE * size
        ]
        # what is left of such a joint ends in a cell, and is no border of cells
        unjoined = shapely.difference(straight, shapely.union_all(along)) if along else straight
        pieces = [piece for piece in shapely.get_parts(unjoined) if not piece.is_empty]
        chains += [_extend(piece, near, _PAST * _OUTSIDE * size) for piece in pieces]
    around = shapely.boundary(body.buffer(_OUTSIDE * size, join_style="mitre"))
    noded = shapely.union_all([around, *chains], grid_size=_GRID * extent)
    polygons = shapely.get_parts(shapely.polygonize(list(shapely.get_parts(noded))))
    return [polygon for polygon in polygons if body.contains(polygon.representative_point())]


def _extend(line: shapely.LineString, near: shapely.Geometry, length: float) -> shapely.LineString:
    """Return a line whose ends on the outline are moved beyond it by a length."""
    points = shapely.get_coordinates(line)
    for end, before in ((0, 1), (-1, -2)):
        if near.covers(shapely.Point(points[end])):
            away = points[end] - points[before]
            points[end] = points[end] + length * away / max(float(np.hypot(*away)), 1e-300)
    return shapely.LineString(points)


def _halve(
    cells: list[shapely.Polygon], field: TriangleStresses, direction: Floats, largest: float
) -> list[shapely.Polygon]:
    """Cut cells across their longer principal direction until none is larger than an area.

    direction: (t, 2) of compression in each triangle.
    """
    tree = shapely.STRtree(shapely.polygons(field.points[field.triangles]))
    finished: list[shapely.Polygon] = []
    waiting = cells[::-1]
    while waiting:
        cell = waiting.pop()
        if cell.area <= largest:
            finished.append(cell)
            continue
        along = direction[int(tree.nearest(cell.representative_point()))]
        across = np.array([-along[1], along[0]])
        points = shapely.get_coordinates(cell)
        normal, other = (along, across) if np.ptp(points @ along) >= np.ptp(points @ across) else (across, along)
        middle, far = shapely.get_coordinates(cell.centroid)[0], 2.0 * float(np.ptp(points, axis=0).sum())
        halves = [
            shapely.Polygon(
                [
                    middle - far * other,
                    middle + far * other,
                    middle + far * (other + side),
                    middle + far * (side - other),
                ]
            )
            for side in (normal, -normal)
        ]
        parts = [
            part
            for half in halves
            for part in shapely.get_parts(shapely.intersection(cell, half))
            if part.geom_type == "Polygon"
        ]
        waiting += parts[::-1]
    return finished


def uniaxial_strength(scene: Scene) -> float:
    """Return the stress at which blocks fail in uniaxial compression, docs/method.md (9.1)."""
    # 2 c (μi + √(1 + μi²)), c and μi of inner faces, or the compressive strength if less
    material = problem.material_of(build_assembly(scene))
    sheared = 2.0 * material.shear * (material.friction + math.hypot(1.0, material.friction))
    return min(sheared, material.crushing)


def why_no_fields(assembly: Assembly) -> str:
    """Return why bounds by fields do not apply to a structure; "" where they do."""
    try:
        problem.require_planar_fields(assembly)
    except InputError as error:
        return error.problem
    return ""


def with_crushing(scene: Scene, share: float = 1.0) -> Scene:
    """Return a planar scene whose faces crush at a share of the uniaxial strength of its blocks."""
    # By faces a hinge is a point, which carries any force. Where blocks crack anywhere it needs a width, and a layout
    # that is chosen without it may lose half of its load factor. A lower compressive strength of the scene stays.
    strength = share * uniaxial_strength(scene)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    for name in ("dry", "inner"):
        material: dict[str, Any] = document["materials"].setdefault(name, {})
        own_strength = material.get("compressive_strength")
        low = own_strength.get("nominal", strength) if isinstance(own_strength, dict) else own_strength
        material["compressive_strength"] = strength if low is None else min(strength, float(low))
    return parse_scene(document, scene.name)


def with_materials_of(scene: Scene, source: Scene) -> Scene:
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"] = source.model_dump(mode="json", exclude_defaults=True)["materials"]
    return parse_scene(document, scene.name)


_ROUTE: Final = Route("the stresses of an uncut body")

# Shares of the tensile strength that are tried: a weak body shows its thrust, but may not stand
_TENSION: Final = (0.1, 1.0)

_CRUSHING_TRIANGLES: Final = (
    600  # number of triangles from which on a mesh is fine enough, as cells are several triangles wide
)


def stresses_of_body(assembly: Assembly, until: Deadline | None = None) -> TriangleStresses:
    """Compute the stresses of an uncut body under its governing load case at collapse."""
    # Stresses are those of the lower bound by fields, of a body with a tenth of its tensile strength: its compression
    # is the thrust that joints have to carry. If none is found, the strength is as stated.
    strengths = assembly.strengths(_ROUTE)
    for share in _TENSION:
        weak = assembly.with_strengths(replace(strengths, tension=share * strengths.tension))
        bounds = [_refine_bounds(case, until) for case in weak.by_case]
        # the case with the least lower bound governs
        lower = [bracket.lower / factor for bracket, factor in zip(bounds, assembly.required.tolist(), strict=True)]
        stresses = bounds[int(np.argmin([low if np.isfinite(low) else np.inf for low in lower]))].stresses
        if stresses is not None:
            mesh = stresses.mesh
            return TriangleStresses(mesh.points, mesh.simplices, stresses.stress.mean(axis=1))
    raise InputError("", "no stresses of the uncut body keep equilibrium with the loads", "a stronger stone")


def _refine_bounds(assembly: Assembly, until: Deadline | None) -> bounds.FieldBounds:
    """Return the bounds by fields of a structure under one load case, with their stresses."""
    refinement = bounds.FieldRefinement(assembly, assembly.labels, lower_first=True)
    refined = refinement.step()
    while (
        not refinement.ended
        and refinement.simplices <= _CRUSHING_TRIANGLES
        and not (until is not None and until.passed())
    ):
        refined = refinement.step(False)
    return refined


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
    options = options.of(outline)
    with_loads(outline, options)  # refuses loads that no tessellation can carry
    assembly = build_assembly(outline)
    planar = assembly.dimension == 2
    kinds = _planar(outline, assembly, options, until) if planar else _spatial(outline, assembly, options)
    side = side_of(assembly)
    made_so_far: list[Tessellation] = []
    for name, words, make in kinds:
        late = bool(made_so_far) and until is not None and until.passed()
        cut = (
            Tessellation(name, words, None, "no time was left")
            if late
            else _cut_to_mass(name, words, make, options, side)
        )
        alike = [
            tessellation.name
            for tessellation in made_so_far
            if cut.scene is not None and tessellation.scene == cut.scene
        ]
        made_so_far.append(Tessellation(name, words, None, f"the same stones as {alike[0]}") if alike else cut)
        made(made_so_far[-1])
    if all(tessellation.scene is None for tessellation in made_so_far):
        reasons = "; ".join(f"{tessellation.name}: {tessellation.problem}" for tessellation in made_so_far)
        raise InputError(
            "the outline", f"no tessellation fits ({reasons})", "a larger `block_mass`, or another outline"
        )
    return made_so_far


_Make = Callable[[float], Scene]  # function that cuts an outline with cells of a relative size, 1 at first


def _cut_to_mass(name: str, words: str, make: _Make, options: DesignOptions, side: Floats) -> Tessellation:
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


_STRETCHER: Final = 1.6  # length of a stretcher over the side of a cell


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
        return _ready(refine(outline, (_STRETCHER * size * cell, height), kind="bond", snap=_SNAP).scene, arcs)

    def voussoirs(size: float) -> Scene:
        count, rings = _voussoirs(arcs, lower, upper, size * cell)
        return _ready(refine(outline, voussoirs=count, rings=rings, snap=_SNAP).scene, arcs)

    def irregular(size: float) -> Scene:
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
            return _ready(refine(outline, (_STRETCHER * size * cell, course), kind="bond", lintel=lintel).scene, [])

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
            least_mass = 2.0 * mass / _MOST
            kg = " kg" if assembly.units == ("m", "N") else ""
            problem = f"the structure of {mass:.4g}{kg} would be {mass / options.block_mass:.0f} blocks of that mass"
            expected = f"at least {least_mass:.3g}{kg}, for {_MOST} cells at the most"
            if dimension == 2 and options.thickness is None:
                expected += ", or the `thickness` of the structure (1 where the outline states none)"
            raise ParameterError("block_mass", problem, expected)
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
    """Add the key "move" to a planar scene, and to any its limit on mass; without `blocks` remove labels and blocks."""
    prepared = scene if blocks else _bare(scene)
    document = prepared.model_dump(mode="json", exclude_defaults=True)
    limit = document.get("search", {}).get("block_mass")
    if scene.dimension == 2 and "move" not in document:
        centres = np.array([arc.centre for arc in arcs]).reshape(-1, 2)
        different = [c for k, c in enumerate(centres) if all(np.hypot(*(c - d)) > 1e-6 for d in centres[:k])]
        along = [{"circle": centre.tolist()} for centre in different]
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
    text = ", ".join(f"an arc of radius {arc.radius:.4g} {unit} over {math.degrees(arc.sweep):.4g}°" for arc in arcs)
    area = sum(shapely.Polygon(part.shell, part.holes).area for part in parts)
    return f"area {area:.4g} {unit}², {text or 'no arcs'}"
