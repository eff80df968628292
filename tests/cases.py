"""Scenes of tests: grids that meet every status and way to a proof, prisms in space, pages; and their changes."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jld_core import (
    Assembly,
    LimitAnalysisResult,
    Route,
    Scene,
    SolveOptions,
    Status,
    build_assembly,
    parse_scene,
    solve,
)

if TYPE_CHECKING:
    import pytest

Document = dict[str, Any]
ROOT_CELL = 0.1
ROUTE = Route("a test")
"""Who asks for strengths of faces."""


def dry_and_inner(density: float, friction: float, tension: float, shear: float, **keys: Any) -> Document:
    """The key "materials" of dry joints with friction and inner faces with two strengths; keys: gravity."""
    inner = {"tensile_strength": tension, "shear_strength": shear}
    return {"density": density, **keys, "dry": {"friction_coefficient": friction}, "inner": inner}


def grid_document(
    rows: list[str],
    *,
    tension: float = 2e4,
    shear: float = 2e4,
    friction: float = 0.75,
    live: list[Document] | None = None,
    crush_dry: float | None = None,
    crush_inner: float | None = None,
    cohesion: float = 0.0,
    inner_friction: float = 0.0,
    **search: Any,
) -> Document:
    """A scene document: cells of 0.1 m, 1400 kg/m³, horizontal body load unless said otherwise."""
    dry: Document = {"friction_coefficient": friction}
    inner: Document = {"tensile_strength": tension, "shear_strength": shear}
    if crush_dry is not None:
        dry["compressive_strength"] = crush_dry
    if crush_inner is not None:
        inner["compressive_strength"] = crush_inner
    if cohesion:
        dry["cohesion"] = cohesion
    if inner_friction:
        inner["friction_coefficient"] = inner_friction
    document: Document = {
        "name": "grid",
        "grid": {"cell": [ROOT_CELL, ROOT_CELL], "thickness": 0.1, "rows": rows},
        "materials": {"density": 1400, "dry": dry, "inner": inner},
        "loads": {"live": live or [{"body": [1, 0]}]},
    }
    if search:
        document["search"] = search
    return document


def all_inner(document: Document, default: str = "inner", **labels: Any) -> Document:
    """The document with all faces inner, those to supports too; with another default, or in `dry`, they stay."""
    built = build_assembly(parse_scene({**document, "labels": {"default": default, **labels}}))
    names, faces, support = built.elements.ids, built.interfaces, built.elements.support
    dry = [set(pair) for pair in labels.get("dry", [])]
    held = [[names[a], names[b]] for a, b in zip(faces.a, faces.b, strict=True) if support[a] or support[b]]
    held = [pair for pair in held if default == "inner" and set(pair) not in dry]
    return {**document, "labels": {"default": default, **labels, "inner": held}}


def grid_scene(rows: list[str], **kwargs: Any) -> Scene:
    """The same, validated."""
    return parse_scene(grid_document(rows, **kwargs))


def grid_assembly(rows: list[str], **kwargs: Any) -> Assembly:
    """The same, as an assembly."""
    return build_assembly(grid_scene(rows, **kwargs))


def solved(document: Document, **options: Any) -> LimitAnalysisResult:
    """What a scene that collapses carries, proven to 1e-6."""
    result = solve(build_assembly(parse_scene(document)), **options)
    assert result.status is Status.COLLAPSE
    assert result.gap <= 1e-6
    return result


def space_of(document: Document, **options: Any) -> Any:
    """The space of a search of a scene."""
    from jld_explore import search_space

    scene = parse_scene(document)
    return search_space(scene, build_assembly(scene), **options)


def every_layout(space: Any) -> Any:
    """All labellings (k, m) of a search space, as enumeration lists them."""
    from jld_explore.drivers import make_driver  # which tests of the core do not load

    none = np.empty((0, len(space.fixed)), dtype=bool)
    return np.concatenate([none, *(rows for rows, _ in make_driver("enumeration", space, 0).batches())])


def replace_processes(monkeypatch: pytest.MonkeyPatch, executor: Callable[..., Any] = ThreadPoolExecutor) -> None:
    """Let pools have threads, or another executor, where they would start processes, which takes seconds."""
    monkeypatch.setattr("jld_explore.evaluation.pool.make_executor", executor)


def standing_of(built: Assembly, labellings: Any, low: Any = None, *deadline: Any, **options: Any) -> Any:
    """Whether labellings (k, m) stand at λ = 0, as searches ask: 1, 0 or NaN (k,); low: λ known, (k,)."""
    from jld_explore.evaluation.cases import Standing

    known = np.full(len(labellings), np.nan) if low is None else low
    return Standing(built, SolveOptions()).of(labellings, known, *deadline, **options)


def counts_of(built: Assembly, labellings: Any, graph: Any = None, shapes: Any = None) -> dict[str, Any]:
    """Values (k,) of every count of layouts, by its name."""
    from jld_explore.space import registered, values_of

    return {one.name: values_of(one, built, np.asarray(labellings), graph, shapes) for one in registered()}


def small_blocks(built: Assembly, seed: int, most: int = 4) -> np.ndarray:
    """Labels of random blocks of at most so many elements, none of them glued to a support."""
    rng = np.random.default_rng(seed)
    faces, labels = built.interfaces, np.ones(len(built.interfaces), dtype=bool)
    size = np.ones(len(built.elements), dtype=int)
    name = np.arange(len(built.elements))
    for face in rng.permutation(np.flatnonzero(built.free_faces)):
        one, two = name[faces.a[face]], name[faces.b[face]]
        if one != two and size[one] + size[two] <= most:
            size[one] += size[two]
            name[name == two] = one
    labels[built.free_faces] = (name[faces.a] != name[faces.b])[built.free_faces]
    return labels


def canonical(labellings: Any, group: Any) -> Any:
    """Of the images (k, m) of each labelling under a group (g, m) the one whose letters are last in the alphabet."""
    best = [max((row[image] for image in group), key=lambda one: (~one).tobytes()) for row in labellings]
    return np.array(best, dtype=bool).reshape(np.shape(labellings))


DOWN = [{"element": "c2r0", "force": [0, -1]}]
CASES: dict[str, tuple[list[str], Document]] = {
    "wall": (["aaaa", "aaaa", "aaaa", "####"], {}),
    "beam": (["aaaaa", "aaaaa", "#...#"], {"live": DOWN}),
    "arch": (["#aaaaa#", "#aaaaa#"], {"live": DOWN}),
    "weak arch": (["#aaaaa#", "#aaaaa#"], {"tension": 1e3, "shear": 1e3, "live": DOWN}),
    "crushable arch": (["#aaaaa#", "#aaaaa#"], {"crush_dry": 5e4, "crush_inner": 5e4, "live": DOWN}),
    "arch with crushable joints": (["#aaaaa#", "#aaaaa#"], {"crush_dry": 5e4, "live": DOWN}),
    "crushable wall": (["aaaa", "aaaa", "aaaa", "####"], {"crush_dry": 1e4, "crush_inner": 1e5}),
    "no friction": (["aaa", "aaa", "###"], {"friction": 0.0}),
    "no shear strength": (["aaa", "aaa", "###"], {"shear": 0.0}),
    "no tensile strength": (["aaa", "aaa", "###"], {"tension": 0.0}),
    "overhang": (["aaaa", "a...", "#..."], {"live": [{"body": [0, -1]}]}),
    "lifted": (["aaa", "aaa", "###"], {"live": [{"body": [0, 1]}]}),
    "pressed": (["aaa", "aaa", "###"], {"live": [{"body": [0, -1]}]}),
    "very strong": (["aaa", "aaa", "###"], {"tension": 1e9, "shear": 1e9}),
    "mortar": (["aaa", "aaa", "###"], {"cohesion": 2e3, "friction": 0.4, "live": [{"body": [1, 0.4]}]}),
    "rough cracks": (["aaaa", "aaaa", "####"], {"inner_friction": 1.1, "tension": 4e3, "shear": 6e3, "friction": 0.5}),
    "rough arch": (["#aaaaa#", "#aaaaa#"], {"inner_friction": 0.6, "cohesion": 1e3, "crush_inner": 5e5, "live": DOWN}),
    "cantilever": (["#aaa", "#aaa"], {"tension": 3e5, "shear": 3e5, "live": [{"body": [0, -1]}]}),
}


# Polyhedra and spatial scenes for tests, made of prisms.


Array = NDArray[np.float64]

IRREGULAR = np.array([[0.0, 0.0], [2.0, -0.3], [3.1, 1.0], [1.5, 2.2], [-0.4, 1.3]])
TRIANGLE = np.array([[0.0, 0.0], [3.0, 0.4], [0.7, 2.0]])
ELL = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])
OBLONG = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.8], [0.0, 0.8]])


def prism(
    name: str, outline: ArrayLike, low: float, high: float, turn: ArrayLike | None = None, **keys: Any
) -> Document:
    """A vertical prism over a counter-clockwise outline; turn: rotation (3, 3) of the whole."""
    flat = np.asarray(outline, dtype=float)
    k = len(flat)
    points = np.concatenate([np.column_stack([flat, np.full(k, z)]) for z in (low, high)])
    if turn is not None:
        points = points @ np.asarray(turn).T
    sides = [[i, (i + 1) % k, (i + 1) % k + k, i + k] for i in range(k)]
    faces = [list(range(k))[::-1], list(range(k, 2 * k)), *sides]
    return {"id": name, "vertices": points.tolist(), "faces": faces, **keys}


def box(name: str, low: ArrayLike, high: ArrayLike, turn: ArrayLike | None = None, **keys: Any) -> Document:
    """A box between two corners."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return prism(name, [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], z0, z1, turn, **keys)


def split_in_triangles(element: Document) -> Document:
    """The same element with every face cut into triangles."""
    faces = [[face[0], face[i], face[i + 1]] for face in element["faces"] for i in range(1, len(face) - 1)]
    return {**element, "faces": faces}


def scene_in_space(elements: list[Document], **keys: Any) -> Document:
    """A document: friction 0.7, strong glue, sideways body load unless said otherwise."""
    materials = dry_and_inner(1.0, 0.7, 0.5, 0.8, gravity=1.0)
    return {
        "elements": elements,
        "materials": {**materials, **keys.pop("materials", {})},
        "loads": {"live": keys.pop("live", [{"body": [1, 0, 0]}])},
        **keys,
    }


def assembly_in_space(elements: list[Document], **keys: Any) -> Assembly:
    return build_assembly(parse_scene(scene_in_space(elements, **keys)))


def stools(outlines: list[Array], height: float = 1.5, **keys: Any) -> Assembly:
    """Prisms side by side on one slab: as many interfaces as outlines, nothing else touching."""
    shift, elements = 0.0, []
    for position, outline in enumerate(outlines):
        placed = outline + np.array([shift - outline[:, 0].min(), 0.0])
        elements.append(prism(f"p{position}", placed, 0.0, height))
        shift += float(np.ptp(outline[:, 0])) + 1.0
    elements.append(box("slab", [-5, -5, -1], [shift + 5, 8, 0], support=True))
    return assembly_in_space(elements, **keys)


def four_columns(dry: Document) -> Document:
    """Four columns of two cubes, alike under turns by 90° and mirrors where their joints are."""
    cells = [box(f"{x}{y}{z}", [x, y, z], [x + 1, y + 1, z + 1]) for x in (-2, 1) for y in (-2, 1) for z in (0, 1)]
    slab = box("s", [-3, -3, -1], [3, 3, 0], support=True)
    return scene_in_space([slab, *cells], live=[{"body": [0, 0, -1]}], materials={"dry": dry})


def wall_in_space(rows: int, columns: int, wythes: int = 2, turn: ArrayLike | None = None) -> list[Document]:
    """Running bond, wythes out of step, on a wide slab."""
    length, width, height = 0.2, 0.1, 0.06
    elements = []
    for r in range(rows):
        for w in range(wythes):
            ends = np.arange(columns + 1) * length
            if (r + w) % 2:
                ends = np.concatenate([[0.0], ends[:-1] + 0.5 * length, [columns * length]])
            for c in range(len(ends) - 1):
                low = [ends[c], w * width, r * height]
                elements.append(box(f"b{r}.{w}.{c}", low, [ends[c + 1], (w + 1) * width, (r + 1) * height], turn))
    high = [columns * length + 1.0, wythes * width + 1.0, 0.0]
    elements.append(box("slab", [-1.0, -1.0, -0.3], high, turn, support=True))
    return elements


def rotation(x: float, y: float, z: float) -> Array:
    """Rotation (3, 3) by angles about x, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([x, y, z]), np.sin([x, y, z])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


SPATIAL: dict[str, Callable[[], Assembly]] = {
    # one structure for each spatial yield set that the batch solver knows
    "stools": lambda: stools([OBLONG, OBLONG[::-1] * 0.9]),
    "running bond": lambda: assembly_in_space(wall_in_space(2, 2)),
    "rough bond": lambda: assembly_in_space(
        wall_in_space(2, 1),
        materials={
            "dry": {"friction_coefficient": 0.4, "cohesion": 0.2},
            "inner": {"tensile_strength": 0.3, "shear_strength": 0.5, "friction_coefficient": 0.8},
        },
    ),
    "turned bond": lambda: assembly_in_space(
        wall_in_space(3, 1, 1, turn=rotation(0.3, -0.2, 0.5)), loads={"live": [{"body": [0.3, 1, 0.2]}]}
    ),
}
SPATIAL |= {
    "hulls": lambda: stools([IRREGULAR, TRIANGLE, ELL]),
    "kern bond": SPATIAL["rough bond"],
    "pressed bond": lambda: assembly_in_space(wall_in_space(2, 1), loads={"live": [{"body": [0.1, 0, -1]}]}),
    "slippery bond": lambda: assembly_in_space(wall_in_space(2, 1), materials={"dry": {"friction_coefficient": 0.0}}),
}


# Solids for tests: unions of boxes of a grid, such as walls with openings.


def solid_of(name: str, cells: NDArray[np.bool_], levels: Sequence[Any]) -> dict[str, Any]:
    """Return the element of the full cells of a grid, whose faces are many coplanar rectangles.

    cells: (i, j, k), True for full ones. levels: coordinates of the grid along each axis, ascending.
    """
    taken = np.pad(cells, 1)
    points: dict[tuple[int, ...], int] = {}
    faces = []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        for cell in np.argwhere(taken & ~np.roll(taken, -sign, axis=axis)) - 1:
            loop = []
            for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1))[::sign]:
                corner = cell.copy()
                corner[axis] += sign > 0
                corner[(axis + 1) % 3] += du
                corner[(axis + 2) % 3] += dv
                loop.append(points.setdefault(tuple(corner.tolist()), len(points)))
            faces.append(loop)
    vertices = [[float(levels[k][key[k]]) for k in range(3)] for key in points]
    return {"id": name, "vertices": vertices, "faces": faces}


# Transformations of a planar scene that must leave λ as it is.


def spelt_out(document: Document, assembly: Assembly) -> Document:
    """The document with volumes, centroids and interfaces of its assembly, for a statement that finds none itself."""
    faces, elements = assembly.interfaces, assembly.elements
    bodies = dict(
        zip(elements.ids, zip(elements.volume.tolist(), elements.centroid.tolist(), strict=True), strict=True)
    )
    keys = ({"volume": bodies[e["id"]][0], "centroid": bodies[e["id"]][1]} for e in document["elements"])
    stated = [{"support": False, **e, **own} for e, own in zip(document["elements"], keys, strict=True)]
    interfaces = [
        {"elements": [elements.ids[a], elements.ids[b]], "polygon": ring.tolist(), "label": ("inner", "dry")[int(dry)]}
        for a, b, ring, dry in zip(faces.a, faces.b, faces.polygon, assembly.labels, strict=True)
    ]
    return {**document, "elements": stated, "interfaces": interfaces}


def as_elements(scene: Scene) -> Document:
    """The scene as a document with general elements, interfaces found from geometry, labels by pairs."""
    assembly = build_assembly(scene)
    elements, faces = assembly.elements, assembly.interfaces
    document = scene.model_dump(mode="json", exclude_none=True)
    thickness = scene.grid.thickness if scene.grid is not None else scene.thickness or 1.0
    document.pop("grid", None)
    document["thickness"] = thickness
    document["elements"] = [
        {"id": name, "polygon": shape.tolist(), "weight": float(np.hypot(*weight)), "support": bool(support)}
        for name, shape, weight, support in zip(
            elements.ids, elements.shape, elements.weight, elements.support, strict=True
        )
    ]
    pairs: dict[str, list[list[str]]] = {"dry": [], "inner": []}
    for a, b, dry in zip(faces.a, faces.b, assembly.labels, strict=True):
        pairs["dry" if dry else "inner"].append([elements.ids[a], elements.ids[b]])
    document["labels"] = pairs
    gravity = document["materials"].get("gravity", 9.81)
    document["materials"]["gravity"] = [0.0, -gravity] if isinstance(gravity, int | float) else gravity
    return document


def _map(document: Document, point: Any, vector: Any, moment: float) -> Document:
    changed = copy.deepcopy(document)
    for element in changed["elements"]:
        element["polygon"] = [point(p) for p in element["polygon"]]
        if "centroid" in element:
            element["centroid"] = point(element["centroid"])
    changed["materials"]["gravity"] = vector(changed["materials"]["gravity"])
    for entry in changed["loads"].get("dead", []) + changed["loads"]["live"]:
        for key in ("force", "body"):
            if key in entry:
                entry[key] = vector(entry[key])
        if "at" in entry:
            entry["at"] = point(entry["at"])
        if "moment" in entry:
            entry["moment"] = moment * entry["moment"]
    return changed


def rotated(document: Document, degrees: float, shift: tuple[float, float] = (0.0, 0.0)) -> Document:
    """The whole scene turned about the origin and moved, gravity and loads with it."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))

    def turn(v: list[float]) -> list[float]:
        return [c * v[0] - s * v[1], s * v[0] + c * v[1]]

    def move(p: list[float]) -> list[float]:
        x, y = turn(p)
        return [x + shift[0], y + shift[1]]

    return _map(document, move, turn, 1.0)


def mirrored(document: Document) -> Document:
    """The scene reflected in the vertical axis."""
    return _map(document, lambda p: [-p[0], p[1]], lambda v: [-v[0], v[1]], -1.0)


def in_units(document: Document, length: float, force: float) -> Document:
    """The scene in other units: numbers of length times `length`, forces times `force`."""
    changed = _map(document, lambda p: [length * x for x in p], lambda v: v, 1.0)
    changed["thickness"] *= length
    for element in changed["elements"]:
        element["weight"] *= force
    for entry in changed["loads"].get("dead", []) + changed["loads"]["live"]:
        if "force" in entry:
            entry["force"] = [force * x for x in entry["force"]]
        if "moment" in entry:
            entry["moment"] *= force * length
    for material in ("dry", "inner"):
        for key, value in changed["materials"].get(material, {}).items():
            if key.endswith("strength"):
                changed["materials"][material][key] = value * force / length**2
    return changed


def renumbered(document: Document, seed: int) -> Document:
    """The same elements in another order."""
    changed = copy.deepcopy(document)
    order = np.random.default_rng(seed).permutation(len(changed["elements"]))
    changed["elements"] = [changed["elements"][i] for i in order]
    return changed


# Small scenes whose pages the tests look at.


HOSTILE = "<script>document.title='broken'</script> & \"$\\frac{1}{2}$\" </script><img src=x onerror=alert(1)>"
"""A name that a careless page would run."""


def small_scene(name: str = "two courses", rows: list[str] | None = None) -> dict[str, Any]:
    """Four cells on a base, pushed sideways and from above: some forty layouts, searched in a moment."""
    return {
        "name": name,
        "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": rows or ["abb", "ccd", "###"]},
        "materials": dry_and_inner(2000, 0.65, 2e4, 2e4),
        "loads": {"live": [{"body": [1, 0]}, {"element": "c1r0", "force": [0, -100], "at": [0.6, 0.4]}]},
    }


def cube(name: str, x: float, z: float, wide: float = 1.0, **more: Any) -> dict[str, Any]:
    """A box of height 1 at a place."""
    corners = [[x + i * wide, j, z + k] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return {"id": name, "vertices": corners, "faces": faces, **more}


def spatial_scene(name: str = "four cubes") -> dict[str, Any]:
    """Four cubes on a slab, pushed sideways."""
    return {
        "name": name,
        "elements": [
            cube("slab", -0.5, -1.0, 3.0, support=True),
            cube("a", 0.0, 0.0),
            cube("b", 1.0, 0.0),
            cube("c", 0.0, 1.0),
            cube("d", 1.0, 1.0),
        ],
        "materials": dry_and_inner(2000, 0.5, 2e4, 2e4),
        "loads": {"live": [{"body": [1, 0, 0]}]},
    }


def scene_of_cases(name: str = "two courses, two winds") -> dict[str, Any]:
    """The small scene pushed to the right, of which twice as much is required, and to the left."""
    scene = small_scene(name)
    right, left = [{"body": [1, 0]}], [{"body": [-1, 0]}]
    scene["loads"] = {
        "cases": [{"name": "right", "live": right, "required": 2.0}, {"name": "<b>left</b>", "live": left}]
    }
    return scene
