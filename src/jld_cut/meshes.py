"""Closed surfaces: read and check them, join touching bodies, write parts as STL, OBJ and 3MF."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import IO, Any, Final
from xml.etree import ElementTree

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from jld_core import Bools, Floats, InputError, Ints, error_context
from jld_formats import ImportOptions, Notes, Solids, formats

_SPLITS: Final = 50  # pieces of a triangle, on average, up to which a surface is split at points on its edges
_SAME: Final = 1e-6  # difference of unit normals, and of offsets by size, of one plane


def outer_surface(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return points (n, 3) and triangles (k, 3) of what touching closed surfaces enclose together."""
    points, triangles = _sound(points, triangles, tolerance)
    points, triangles = _sound(*_without_shared(points, triangles, tolerance), tolerance)
    triangles = _split_at(points, triangles, tolerance)
    # two triangles of the same corners, back to back, enclose nothing
    turn = np.sign(np.linalg.det(np.eye(3)[np.argsort(triangles, axis=1)])) if len(triangles) else np.zeros(0)
    kinds, kind = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)
    balance = np.bincount(kind.reshape(-1), turn, len(kinds)).astype(int)
    triangles = np.repeat(np.where((balance < 0)[:, None], kinds[:, ::-1], kinds), np.abs(balance), axis=0)
    used, renumbered = np.unique(triangles, return_inverse=True)
    return points[used], renumbered.reshape(-1, 3)


def groups(pairs: Ints, count: int) -> Ints:
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _sound(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return a surface whose near corners are one, without triangles lower than the tolerance."""
    group = groups(cKDTree(points).query_pairs(tolerance, output_type="ndarray"), len(points))
    _, first = np.unique(group, return_index=True)
    points, triangles = points[first], group[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    return points, triangles[normals_of(corners)[1] > tolerance * longest]


def normals_of(corners: Floats) -> tuple[Floats, Floats]:
    """Return normals (k, 3) of triangles (k, 3, 3), twice their area long, and these lengths."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normal, np.linalg.norm(normal, axis=1)


def _without_shared(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return a surface without the regions in which faces of a plane lie back to back."""
    corners = points[triangles]
    normal, length = normals_of(corners)
    normal = normal / length[:, None]
    size = float(np.ptp(points, axis=0).max())
    planes = np.column_stack([normal, np.einsum("ij,ij->i", normal, corners.mean(axis=1)) / size])
    tree = cKDTree(planes)
    back = cKDTree(-planes).sparse_distance_matrix(tree, _SAME, output_type="coo_matrix")
    like = tree.query_pairs(_SAME, output_type="ndarray")
    group = groups(np.concatenate([like, np.column_stack([back.row, back.col])]), len(triangles))
    remaining = np.ones(len(triangles), dtype=bool)
    new_triangles = [np.zeros((0, 3, 3))]
    for plane in np.unique(group[back.row]).tolist():
        members = np.flatnonzero(group == plane)
        largest = members[np.argmax(length[members])]
        up, offset = normal[largest], float(planes[largest, 3]) * size
        first = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
        first /= np.linalg.norm(first)
        frame = np.array([first, np.cross(up, first)])
        faces_up = normal[members] @ up > 0.0
        plan = shapely.polygons(corners[members] @ frame.T)
        grid = 0.01 * tolerance
        above, below = (shapely.union_all(plan[side], grid_size=grid) for side in (faces_up, ~faces_up))
        if shapely.intersection(above, below, grid_size=grid).area < tolerance**2:
            continue
        remaining[members] = False
        for this, other, sign in ((above, below, 1), (below, above, -1)):
            surplus = shapely.get_parts(shapely.difference(this, other, grid_size=grid))
            surplus = surplus[shapely.get_type_id(surplus) == 3]
            flat = [triangle for region in surplus for triangle in triangles_of(region)]
            if flat:
                ring = shapely.get_coordinates(shapely.orient_polygons(flat)).reshape(-1, 4, 2)[:, :3][:, ::sign]
                new_triangles.append(ring @ frame + offset * up)
    new = np.concatenate(new_triangles)
    numbers = np.arange(3 * len(new)).reshape(-1, 3) + len(points)
    return np.concatenate([points, new.reshape(-1, 3)]), np.concatenate([triangles[remaining], numbers])


def triangles_of(region: Any) -> list[Any]:
    try:
        return list(shapely.get_parts(shapely.constrained_delaunay_triangles(region)))
    except shapely.errors.GEOSException:  # a ring that touches itself
        within = shapely.intersection(shapely.get_parts(shapely.delaunay_triangles(region)), region)
        return [part for part in shapely.get_parts(within) if part.geom_type == "Polygon"]


def _split_at(points: Floats, triangles: Ints, tolerance: float) -> Ints:
    """Return triangles split at the points that lie on their edges."""
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    start, ray = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    length = np.linalg.norm(ray, axis=1)
    used = np.unique(triangles)
    near = cKDTree(points[used]).query_ball_point(start + ray / 2, length / 2 + tolerance)
    points_on: dict[tuple[int, int], list[int]] = {}
    for k, close in enumerate(near):
        arm = points[used[close]] - start[k]
        along = arm @ ray[k] / length[k]
        distance = np.linalg.norm(arm - np.outer(along, ray[k] / length[k]), axis=1)
        between_ends = (distance <= tolerance) & (along > 0.0) & (along < length[k])
        between_ends &= ~np.isin(used[close], edges[k])
        if between_ends.any():
            points_on[int(edges[k, 0]), int(edges[k, 1])] = used[close][between_ends][
                np.argsort(along[between_ends])
            ].tolist()
    finished, waiting = [], [tuple(triangle) for triangle in triangles.tolist()]
    splits_left = _SPLITS * (len(triangles) + 10)  # two points just apart may each lie on an edge to the other
    while waiting:
        splits_left -= 1
        if splits_left < 0:
            raise ValueError("edges that cannot be split")
        a, b, c = waiting.pop()
        for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
            if between := points_on.get((min(p, q), max(p, q)), []):
                # Both halves of the edge keep the points on them. A half triangle whose third corner is the middle
                # encloses nothing.
                chain = [min(p, q), *between, max(p, q)]
                middle = len(chain) // 2
                for part in (chain[: middle + 1], chain[middle:]):
                    end_points, inner = (part[0], part[-1]), part[1:-1]
                    points_on[min(end_points), max(end_points)] = (
                        inner if end_points[0] < end_points[1] else inner[::-1]
                    )
                waiting += [half for half in ((p, chain[middle], r), (chain[middle], q, r)) if len(set(half)) == 3]
                break
        else:
            finished.append((a, b, c))
    return np.array(finished, dtype=np.int64).reshape(-1, 3)


ENDINGS: Final = ("stl", "obj", "3mf")
MOST: Final = 200_000  # triangles of a solid
_RECORD: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])  # of STL
_NAMESPACE: Final = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_DEEP: Final = 20  # components within components of a 3MF file
_SIZES: Final = (1e-3, 1e4)  # lengths of a solid, m
_UNITS: Final = {
    "micron": "micron",
    "millimeter": "mm",
    "centimeter": "cm",
    "inch": "in",
    "foot": "ft",
    "meter": "m",
}  # of 3MF
UNITS: Final = {"micron": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}


def manifold3d() -> Any:
    """Import the library that cuts; InputError where it is missing."""
    try:
        return import_module("manifold3d")
    except ImportError:
        raise InputError("jld cut", "it needs manifold3d, which is not installed", "pip install 'jld[cut]'") from None


def solid_of(points: Floats, triangles: Ints) -> Any:
    library = manifold3d()
    corners, faces = np.ascontiguousarray(points, dtype=np.float64), np.ascontiguousarray(triangles, dtype=np.uint64)
    return library.Manifold(library.Mesh64(corners, faces))


def surface_of(solid: Any) -> tuple[Floats, Ints]:
    """Return points (n, 3) and triangles (k, 3) of a manifold."""
    mesh = solid.to_mesh64()
    points = np.array(mesh.vert_properties[:, :3], dtype=float)
    points[np.abs(points) < 1e-15] = 0.0  # cuts leave the dust of rounding beside planes through the origin
    return points, np.array(mesh.tri_verts, dtype=np.int64)


def pieces_of(solid: Any) -> list[Any]:
    """Return the connected pieces of a manifold, each with its closed cavities."""
    components = solid.decompose()
    solids = [component for component in components if component.volume() > 0.0]
    for void in (component for component in components if component.volume() < 0.0):
        points, triangles = surface_of(void)
        body = solid_of(points, triangles[:, ::-1])
        for k, component in enumerate(solids):
            if (component ^ body).volume() > 0.5 * body.volume():
                solids[k] = component - body
                break
    return solids


def moments(solid: Any) -> Floats:
    """Return volume, first (3,) and second moments (9,) of a solid about the origin: those of parts add up."""
    points, triangles = surface_of(solid)
    corners = points[triangles]
    volume, total = np.linalg.det(corners) / 6.0, corners.sum(axis=1)
    second = np.einsum("k,ki,kj->ij", volume, total, total) + np.einsum("k,kci,kcj->ij", volume, corners, corners)
    return np.concatenate([[volume.sum()], volume @ total / 4.0, second.ravel() / 20.0])


def kind_of(moment: Floats, scale: float) -> tuple[int, ...]:
    """Return what parts of one shape, turned or mirrored, have in common; scale: a volume."""
    volume, first, second = moment[0], moment[1:4], moment[4:].reshape(3, 3)
    spread = np.linalg.eigvalsh(second - np.outer(first, first) / volume)
    sizes = np.array([volume ** (1 / 3), *np.maximum(spread, 0.0) ** 0.2])
    return tuple(np.round(sizes / (1e-4 * scale ** (1 / 3))).astype(int).tolist())


def read_solid(path: Path, unit: float, shown: float = 1.0) -> Any:
    """Read one closed solid, lengths × `unit`; InputError says where it is open or crosses itself, by `shown`."""
    manifold3d()
    kind = path.suffix.lower().lstrip(".")
    if kind not in ENDINGS:
        raise InputError(str(path), "it is no STL, OBJ or 3MF file", "a file of one of these")
    with error_context(path):
        pieces = _read_3mf(path) if kind == "3mf" else _read(path, kind)
        if sum(len(faces) for _, faces in pieces) > MOST:
            raise InputError("", "it holds too many triangles", f"at most {MOST}, as `simplify` of a modeller leaves")
        corners = unit * np.concatenate([points for points, _ in pieces])
        size = float(np.ptp(corners, axis=0).max())
        if not _SIZES[0] <= size <= _SIZES[1]:
            raise InputError("", f"the solid is {size:.3g} m long", f"{_SIZES[0]:g} to {_SIZES[1]:g} m: another unit")
        solids = [_checked(unit * points, faces, shown) for points, faces in pieces]
        # surfaces that are turned inwards are cavities, but a file whose outermost ones are is turned inside out
        bodies = [solid for solid, _ in solids]
        outer = [
            outwards
            for body, outwards in solids
            if not any(_within(body, other) for other in bodies if other is not body)
        ]
        turned = bool(outer) and not any(outer)
        hollow = [outwards == turned for _, outwards in solids]
        solid_body = manifold3d().Manifold()
        cavities = [body for body, empty in zip(bodies, hollow, strict=True) if empty]
        depths = [sum(_within(body, other) for other in cavities if other is not body) for body in bodies]
        for _, empty, body in sorted(zip(depths, hollow, bodies, strict=True), key=lambda entry: entry[:2]):
            for piece in pieces_of(body):  # bodies that touch share corners
                solid_body = solid_body - piece if empty else solid_body + piece
        if (number := len(pieces_of(solid_body))) > 1:
            raise InputError("", f"it holds {number} solids that share no face", "one solid")
    return solid_body


def _within(body: Any, other: Any) -> bool:
    inner, outer = np.array(body.bounding_box()), np.array(other.bounding_box())
    inside = (inner[:3] >= outer[:3]).all() and (inner[3:] <= outer[3:]).all()
    return bool(inside and (body - other).is_empty())


def _read(path: Path, kind: str) -> list[tuple[Floats, Ints]]:
    """Read the surfaces of an STL or OBJ file as points (p, 3) and triangles (t, 3), in its unit."""
    # triangles of a binary STL file that share corners are one surface; otherwise each part that the reader finds is
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError("", f"it cannot be read ({error.strerror})", "a file") from None
    if not data:
        raise InputError("", "it is empty", "a closed solid")
    if kind == "stl" and len(data) > 84 and len(data) == 84 + _RECORD.itemsize * int.from_bytes(data[80:84], "little"):
        # corners that nearly meet, as modellers leave them, are merged: only what shares no corner is another solid
        points, triangles = as_read(data)
        if np.isfinite(points).all():
            points, triangles = merged(points, triangles, 1e-7 * float(np.ptp(points, axis=0).max()))
            name = groups(triangles[:, [0, 1, 1, 2]].reshape(-1, 2), len(points))[triangles[:, 0]]
            return [(points, triangles[name == number]) for number in np.unique(name)]
    read = formats.readers()[kind].read
    assert read is not None
    solids = read(path, ImportOptions(), Notes())
    assert isinstance(solids, Solids)
    return [
        (
            np.asarray(part.vertices, dtype=float),
            np.array([(f[0], f[k], f[k + 1]) for f in part.faces for k in range(1, len(f) - 1)]),
        )
        for part in solids.parts
    ]


def unit_of(path: Path) -> str | None:
    """Return the unit that a 3MF file states, None for others."""
    if path.suffix.lower() != ".3mf":
        return None
    with error_context(path), _readable(), _model(path) as stream:
        _, root = next(ElementTree.iterparse(stream, ("start",)))  # the rest is read with the meshes
        return _UNITS[root.get("unit", "millimeter")]


@contextmanager
def _model(path: Path) -> Iterator[IO[bytes]]:
    with zipfile.ZipFile(path) as archive:
        name = next(name for name in archive.namelist() if name.lower().endswith(".model"))
        with archive.open(name) as stream:
            yield stream


@contextmanager
def _readable() -> Iterator[None]:
    try:
        yield
    except (OSError, zipfile.BadZipFile, StopIteration, ElementTree.ParseError, KeyError, ValueError):
        raise InputError(
            "", "it is no 3MF file that can be read", "a zip archive with a model: its objects, transforms and unit"
        ) from None


def _read_3mf(path: Path) -> list[tuple[Floats, Ints]]:
    """Read the meshes of a 3MF file in metres, as points and triangles."""
    with _readable(), _model(path) as stream:
        root = ElementTree.fromstring(stream.read())
        scale = UNITS[_UNITS[root.get("unit", "millimeter")]]
        objects = {node.get("id", ""): node for node in root.iter(f"{{{_NAMESPACE}}}object")}
        items = root.findall(f"{{{_NAMESPACE}}}build/{{{_NAMESPACE}}}item")
        # what is not built is not part of the model; a file that builds nothing holds it all
        placings = [(item.get("objectid", ""), _placing(item)) for item in items] or [
            (name, np.eye(4)) for name in objects
        ]
        meshes = [mesh for name, placing in placings for mesh in _meshes_of(objects, name, placing, _DEEP)]
        meshes = [(scale * points, faces) for points, faces in meshes]
    if not meshes or not all(len(faces) and faces.max() < len(points) for points, faces in meshes):
        raise InputError("", "it holds no whole mesh", "one closed mesh")
    return meshes


def _placing(item: ElementTree.Element) -> Floats:
    """Return the matrix (4, 4), for rows of points, of an item or component of a 3MF file."""
    matrix = np.eye(4)
    if item.get("transform") is not None:
        matrix[:, :3] = np.array([float(word) for word in item.get("transform", "").split()]).reshape(4, 3)
    return matrix


def _meshes_of(
    objects: dict[str, ElementTree.Element], name: str, placing: Floats, deep: int
) -> Iterator[tuple[Floats, Ints]]:
    """Yield the meshes of an object of a 3MF file and of its components, as points and triangles."""
    if not deep:
        raise ValueError("components of components without end")
    for mesh in objects[name].findall(f"{{{_NAMESPACE}}}mesh"):
        points = [[float(v.get(k, "")) for k in "xyz"] for v in mesh.iter(f"{{{_NAMESPACE}}}vertex")]
        faces = [[int(t.get(f"v{k}", "")) for k in (1, 2, 3)] for t in mesh.iter(f"{{{_NAMESPACE}}}triangle")]
        # a mirrored mesh is turned inside out
        turn = 1 if np.linalg.det(placing[:3, :3]) > 0.0 else -1
        yield np.array(points).reshape(-1, 3) @ placing[:3, :3] + placing[3, :3], np.array(faces)[:, ::turn]
    for component in objects[name].iterfind(f"{{{_NAMESPACE}}}components/{{{_NAMESPACE}}}component"):
        yield from _meshes_of(objects, component.get("objectid", ""), _placing(component) @ placing, deep - 1)


def _checked(points: Floats, triangles: Ints, shown: float) -> tuple[Any, bool]:
    """Return the solid in a surface, and whether its faces look outwards; InputError for an open or crossed one."""
    size = float(np.ptp(points, axis=0).max())
    points, triangles = merged(points, triangles, 1e-7 * size)
    open_at = open_edges(triangles)
    if len(open_at):
        spot = ", ".join(f"{x:.6g}" for x in points[open_at].mean(axis=1)[0] / shown)
        problem = f"it is open, or its faces turn against each other, along {len(open_at)} edges, one at ({spot})"
        raise InputError(
            "", problem, "a closed surface: fill holes and turn faces in the modeller, then write it again"
        )
    crossing = _crossing(points, triangles)
    if crossing is not None:
        spot = ", ".join(f"{x:.6g}" for x in crossing / shown)
        raise InputError("", f"its surface crosses itself at ({spot})", "its parts joined by a union in the modeller")
    solid = solid_of(points, triangles)
    outwards = solid.volume() >= 0.0
    solid = solid if outwards else solid_of(points, triangles[:, ::-1])
    volume = abs(volume_of(points, triangles))
    if solid.status().name == "NoError" and abs(solid.volume() - volume) > 1e-6 * volume:
        problem = f"its volume changes from {volume:.6g} to {solid.volume():.6g} where it is read"
        raise InputError("", problem, "its smallest faces joined in the modeller")
    if solid.is_empty() or solid.volume() <= 1e-12 * size**3:
        raise InputError("", "it encloses no volume", "a closed surface around a solid")
    return solid, outwards


def merged(points: Floats, triangles: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Return a surface whose equal corners are one, without triangles that then enclose no area."""
    _, first, group = np.unique(np.round(points / tolerance), axis=0, return_index=True, return_inverse=True)
    triangles = group.reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    # a triangle that is there again, seen from the same side, is one
    start = triangles.argmin(axis=1)[:, None] if len(triangles) else np.zeros((0, 1), dtype=np.int64)
    turned = np.take_along_axis(triangles, (start + np.arange(3)) % 3, axis=1)
    return points[first], triangles[np.sort(np.unique(turned, axis=0, return_index=True)[1])]


def open_edges(triangles: Ints) -> Ints:
    """Return edges (k, 2) that are not used once in each direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    width = int(triangles.max(initial=0)) + 1
    forwards, backwards = edges[:, 0] * width + edges[:, 1], edges[:, 1] * width + edges[:, 0]
    # an edge at which four faces meet is used as often in both directions: it stays closed
    names, counts = np.unique(forwards, return_counts=True)
    opposite = np.minimum(np.searchsorted(names, backwards), len(names) - 1)
    used = counts[np.searchsorted(names, forwards)]
    return np.asarray(edges[(names[opposite] != backwards) | (counts[opposite] != used)])


def as_single(points: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Return a surface as a binary STL file holds it: single precision, equal corners merged, no faces back to back."""
    single = points.astype(np.float32).astype(float)
    _, first, group = np.unique(single, axis=0, return_index=True, return_inverse=True)
    triangles = group.reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, kind, count = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True, return_counts=True)
    return single[first], triangles[count[kind.reshape(-1)] != 2]


def as_written(solid: Any, unit: float) -> tuple[Floats, Ints]:
    """Return the surface of a solid as a file of lengths × `unit` holds it."""
    points, triangles = surface_of(solid)
    return as_single(points / unit, triangles)


def volume_of(points: Floats, triangles: Ints) -> float:
    """Return the volume in a closed surface, summed over its triangles."""
    # A library that reads the surface may turn an edge between two faces that are no degenerate ones.
    a, b, c = (points - points.mean(axis=0))[triangles.T]
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def doubled_edges(points: Floats, triangles: Ints) -> int:
    """Return the number of edges that other than two faces of a surface meet at."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] != 2).sum()) if len(points) else 1


def _crossing(points: Floats, triangles: Ints) -> Floats | None:
    """Return a point (3,) at which an edge passes through a face that it shares no corner with; None if none."""
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    first, second = shapely.STRtree(boxes).query(boxes)
    near = (low[first, 2] < high[second, 2]) & (low[second, 2] < high[first, 2])
    first, second = first[near], second[near]
    disjoint = ~(triangles[first][:, :, None] == triangles[second][:, None, :]).any(axis=(1, 2))
    first, second = first[disjoint], second[disjoint]
    for k in range(3):
        start, end = corners[first, k], corners[first, (k + 1) % 3]
        hit, at = _passes(start, end, corners[second])
        if hit.any():
            return np.asarray(at[hit][0])
    return None


def _passes(start: Floats, end: Floats, face: Floats) -> tuple[Bools, Floats]:
    """Return whether segments (k, 3) pass through triangles (k, 3, 3), and where."""
    ray, first, second = end - start, face[:, 1] - face[:, 0], face[:, 2] - face[:, 0]
    across = np.cross(ray, second)
    det = np.einsum("ij,ij->i", first, across)
    scale = np.linalg.norm(ray, axis=1) * np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    inverse = 1.0 / np.where(np.abs(det) > 1e-9 * scale, det, np.inf)
    offset = start - face[:, 0]
    u = np.einsum("ij,ij->i", offset, across) * inverse
    turned = np.cross(offset, first)
    v, t = np.einsum("ij,ij->i", ray, turned) * inverse, np.einsum("ij,ij->i", second, turned) * inverse
    eps = 1e-6
    hit = (inverse != 0.0) & (u > eps) & (v > eps) & (u + v < 1 - eps) & (t > eps) & (t < 1 - eps)
    return hit, start + t[:, None] * ray


def stl_bytes(points: Floats, triangles: Ints) -> bytes:
    record = np.zeros(len(triangles), _RECORD)
    corners = points[triangles]
    normal, length = normals_of(corners)
    record["normal"] = normal / np.maximum(length, 1e-300)[:, None]
    record["corners"] = corners
    return b"written by jld".ljust(80) + len(triangles).to_bytes(4, "little") + record.tobytes()


def as_read(data: bytes) -> tuple[Floats, Ints]:
    """Return the surface in a binary STL file, equal corners merged."""
    corners = np.frombuffer(data, _RECORD, offset=84)["corners"].reshape(-1, 3)
    points, group = np.unique(corners, axis=0, return_inverse=True)
    return points.astype(float), group.reshape(-1, 3)


def obj_text(points: Floats, triangles: Ints, name: str) -> str:
    lines = [f"g {name}", *(f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist())]
    return "\n".join(lines + [f"f {a} {b} {c}" for a, b, c in (triangles + 1).tolist()]) + "\n"


def write_3mf(path: Path, parts: list[tuple[str, Floats, Ints]]) -> None:
    """Write named surfaces, lengths in mm."""
    objects, items = [], []
    for number, (name, points, triangles) in enumerate(parts, 1):
        corners = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in points.tolist())
        faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in triangles.tolist())
        mesh = f"<mesh><vertices>{corners}</vertices><triangles>{faces}</triangles></mesh>"
        objects.append(f'<object id="{number}" type="model" name="{name}">{mesh}</object>')
        items.append(f'<item objectid="{number}"/>')
    head = '<?xml version="1.0" encoding="UTF-8"?>'
    model = f'{head}<model unit="millimeter" xmlns="{_NAMESPACE}"><resources>{"".join(objects)}</resources>'
    package = "http://schemas.openxmlformats.org/package/2006"
    types = f'{head}<Types xmlns="{package}/content-types">' + "".join(
        f'<Default Extension="{ending}" ContentType="{kind}"/>'
        for ending, kind in (
            ("rels", "application/vnd.openxmlformats-package.relationships+xml"),
            ("model", "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"),
        )
    )
    kind = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
    relation = f'<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="{kind}"/>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", types + "</Types>")
        archive.writestr(
            "_rels/.rels", f'{head}<Relationships xmlns="{package}/relationships">{relation}</Relationships>'
        )
        archive.writestr("3D/3dmodel.model", f"{model}<build>{''.join(items)}</build></model>")
