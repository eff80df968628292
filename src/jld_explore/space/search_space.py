"""Which faces may change, which labels are fixed, and which relabellings are the same by symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core import tolerances
from jld_core.assembly import DRY, INNER, Assembly, Bits, Bools, Floats, Ints
from jld_core.build.elements import faces_of_pairs
from jld_core.errors import InputError
from jld_core.mechanics.yield_planar import require_materials
from jld_core.scene.reading import Scene, Search
from jld_explore.space.labelling import BlockSizes, Connectivity, above, below, block_sizes, blocks_of, connectivity


@dataclass(frozen=True)
class SymmetryGroup:
    """Isometries that map the scene onto itself, the identity first, each with another effect on the faces.

    matrices: (g, d, d) orthogonal, about the mean of the elements' centroids. elements: (g, n) and faces:
    (g, m): where each element and each face comes to lie. The images of a labelling are labelling[faces].
    """

    matrices: Floats
    elements: Ints
    faces: Ints

    def __len__(self) -> int:
        return len(self.faces)


@dataclass(frozen=True)
class SearchSpace:
    """All that decides which labellings there are.

    candidates: (m,) faces that may take either label. fixed: (m,) labels, of force where a face is no
    candidate. graph: for `blocks_of`. least: (n,) blocks through fixed inner faces alone (every labelling's
    blocks contain them). most: (n,) blocks if all candidates were inner. symmetry: maps labellings of the
    space onto labellings of the space with the same load factor and the same counts.
    """

    assembly: Assembly
    search: Search
    candidates: Bools
    fixed: Bits
    graph: Connectivity
    least: Ints
    most: Ints
    symmetry: SymmetryGroup

    @property
    def group(self) -> Ints:
        """(g, m) face permutations of the symmetry group, the identity first."""
        return self.symmetry.faces


def search_space(
    scene: Scene, assembly: Assembly, *, allow_empty: bool = False, need_materials: bool = True
) -> SearchSpace:
    """The labellings a scene's "search" asks for.

    scene, assembly: the assembly is the scene's. allow_empty: accept a space without candidates, which then
    holds the scene's own labelling alone. need_materials: refuse a label that may occur without its material;
    both are switched the other way for scenes that are described but not searched.
    Raises InputError: unknown ids, pairs without interface or kept both ways, no candidate left, fixed
    labels that contradict each other, limits that nothing satisfies, a material that lacks, no such symmetry.
    """
    search = scene.search
    candidates = _candidate_faces(scene, assembly)
    keep_dry = faces_of_pairs(search.keep.dry, assembly.elements, assembly.interfaces, "search.keep.dry")
    keep_inner = faces_of_pairs(search.keep.inner, assembly.elements, assembly.interfaces, "search.keep.inner")
    if np.any(keep_dry & keep_inner):
        pair = _pair(assembly, keep_dry & keep_inner)
        raise InputError("search.keep", f"the pair {pair} stands under both dry and inner", "each pair under one")
    fixed = np.where(keep_dry, DRY, np.where(keep_inner, INNER, assembly.labels)).astype(bool)
    chosen = candidates & ~keep_dry & ~keep_inner
    graph = connectivity(assembly)
    least, most = blocks_of(graph, np.array([chosen | fixed, ~chosen & fixed]))
    slit = ~chosen & fixed & (least[graph.a] == least[graph.b])
    if search.segmentation and slit.any():
        key = "search.keep.dry" if np.any(slit & keep_dry) else "search.segmentation"
        problem = f"the face {_pair(assembly, slit)} is fixed dry inside a block of fixed inner faces"
        raise InputError(key, problem, "fixed labels without slits")
    if not chosen.any() and not allow_empty:
        kept = " that search.keep does not fix" if candidates.any() else ""
        raise InputError("search.candidates", "no face is a candidate", f"at least one face{kept}")
    _refuse_impossible(assembly, search, chosen, fixed, least, most)
    if need_materials:
        _require_materials(assembly, search, chosen, fixed, least, graph)
    symmetry = symmetry_group(assembly, search, chosen, fixed)
    return SearchSpace(assembly, search, chosen, fixed, graph, least, most, symmetry)


def _candidate_faces(scene: Scene, assembly: Assembly) -> Bools:
    wanted, elements, faces = scene.search.candidates, assembly.elements, assembly.interfaces
    if isinstance(wanted, list):
        return faces_of_pairs(wanted, elements, faces, "search.candidates")
    if wanted == "all+supports":
        return np.ones(len(faces), dtype=bool)
    if wanted == "all":
        return assembly.free_faces.copy()
    names = [f"={name}" if name is not None else str(i) for i, name in enumerate(elements.blocks)]
    block = np.unique(np.array(names), return_inverse=True)[1]
    return np.asarray(assembly.free_faces & (block[faces.a] == block[faces.b]))


def _pair(assembly: Assembly, mask: Bools) -> str:
    face = int(np.flatnonzero(mask)[0])
    ids, faces = assembly.elements.ids, assembly.interfaces
    return f"{ids[faces.a[face]]!r}, {ids[faces.b[face]]!r}"


def _require_materials(
    assembly: Assembly, search: Search, candidates: Bools, fixed: Bits, least: Ints, graph: Connectivity
) -> None:
    """Raise InputError where a label that can occur lacks its material."""
    may_be_dry = least[graph.a] != least[graph.b] if search.segmentation else candidates
    may_be_inner = _may_join(assembly, search, least, graph)
    dry, inner = np.where(candidates, may_be_dry, fixed), np.where(candidates, may_be_inner, ~fixed)
    require_materials(assembly, dry, inner)


def _may_join(assembly: Assembly, search: Search, least: Ints, graph: Connectivity) -> Bools:
    """(m,) False where the blocks beside a face are too large to be one."""
    sizes = block_sizes(assembly, least[None])
    p, q = least[graph.a], least[graph.b]

    def joined(values: Floats | Ints) -> Floats:
        return np.asarray(np.where(p == q, values[0, p], values[0, p] + values[0, q]), dtype=float)

    too_large = above(joined(sizes.cells), search.block_cells[1])
    return ~(too_large | above(joined(sizes.weight), search.block_weight[1]))


def _refuse_impossible(
    assembly: Assembly, search: Search, candidates: Bools, fixed: Bits, least: Ints, most: Ints
) -> None:
    """Raise InputError for a limit that no labelling between `least` and `most` can meet."""
    small, large = block_sizes(assembly, least[None]), block_sizes(assembly, most[None])
    holds, whole = np.flatnonzero(small.cells[0]), np.flatnonzero(large.cells[0])
    ids = assembly.elements.ids

    def measure(sizes: BlockSizes, key: str) -> Floats:
        return np.asarray(getattr(sizes, key.removeprefix("block_"))[0], dtype=float)

    bounds: tuple[tuple[str, list[int | None] | list[float | None], str], ...] = (
        ("block_cells", search.block_cells, "free elements"),
        ("block_weight", search.block_weight, "of weight"),
        ("block_extent", search.block_extent, "of extent"),
    )
    for key, (low, high), unit in bounds:
        smallest, largest = measure(small, key)[holds], measure(large, key)[whole]
        if (heavy := above(smallest, high)).any():
            worst = int(np.argmax(np.where(heavy, smallest, -np.inf)))
            problem = f"the most is {high:g}, but the block of {ids[holds[worst]]!r} has {smallest[worst]:g} {unit}"
            raise InputError(f"search.{key}", problem, f"a most of at least {smallest[worst]:g}")
        if (light := below(largest, low)).any():
            worst = int(np.argmin(np.where(light, largest, np.inf)))
            reached = f"the block of {ids[whole[worst]]!r} has {largest[worst]:g} {unit} at most"
            problem = f"the least is {low:g}, but {reached}"
            raise InputError(f"search.{key}", problem, f"a least of at most {largest[worst]:g}")
    cells = int(small.cells.sum())
    fewest, greatest = len(whole), len(holds)
    low, high = search.block_cells
    fewest = max(fewest, -(-cells // high) if high else 0)
    greatest = min(greatest, cells // low if low else greatest)
    if search.block_weight[1]:
        fewest = max(fewest, int(np.ceil(small.weight.sum() / search.block_weight[1] * (1.0 - 1e-8))))
    _refuse_range("blocks", search.blocks, fewest, greatest)
    counted = assembly.free_faces
    _refuse_range(
        "dry_faces",
        search.dry_faces,
        int((counted & ~candidates & fixed).sum()),
        int((counted & (candidates | fixed)).sum()),
    )


def _refuse_range(key: str, bounds: list[int | None], fewest: int, greatest: int) -> None:
    """Raise InputError where [least, most] and what there can be do not meet."""
    low, high = bounds
    if fewest > greatest or (low is not None and low > greatest) or (high is not None and high < fewest):
        asked = f"[{'null' if low is None else low}, {'null' if high is None else high}] asked"
        if fewest > greatest:
            raise InputError(
                "search.block_cells",
                f"no number of blocks fits (at least {fewest}, at most {greatest})",
                "limits that agree",
            )
        raise InputError(
            f"search.{key}", f"{asked}, but there can be {fewest} to {greatest}", "a range that meets this"
        )


def symmetry_group(assembly: Assembly, search: Search, candidates: Bools, fixed: Bits) -> SymmetryGroup:
    """The group `search.symmetry` asks for. Raises InputError for "mirror-x" of an asymmetric scene."""
    d, n, m = assembly.dimension, len(assembly.elements), len(assembly.interfaces)
    identity = (np.eye(d), np.arange(n), np.arange(m))
    found = [identity]
    if search.symmetry == "mirror-x":
        mirror = np.diag([-1.0] + [1.0] * (d - 1))
        image = _image(assembly, search, candidates, fixed, mirror)
        if isinstance(image, str):
            raise InputError("search.symmetry", f"the scene has no mirror-x symmetry: {image}", '"auto" or "none"')
        found.append((mirror, *image))
    elif search.symmetry == "auto":
        for matrix in _possible_matrices(assembly):
            image = _image(assembly, search, candidates, fixed, matrix)
            if not isinstance(image, str):
                found.append((matrix, *image))
    matrices, elements, faces = (np.array(part) for part in zip(*found, strict=True))
    # isometries that move no face differently (a mirror through a column of one cell) count once
    first = np.sort(np.unique(faces, axis=0, return_index=True)[1])
    return SymmetryGroup(matrices[first], elements[first], faces[first])


def _possible_matrices(assembly: Assembly) -> list[Floats]:
    """Orthogonal matrices that may map the assembly onto itself, from few elements that are rare."""
    elements, d = assembly.elements, assembly.dimension
    reach = tolerances.SYMMETRY * assembly.size
    points, alike = elements.centroid - elements.centroid.mean(axis=0), _alike(assembly)
    if np.linalg.matrix_rank(points, tol=1e-3 * assembly.size) < d - 1:
        points = np.concatenate(elements.shape) - elements.centroid.mean(axis=0)
        owner = np.repeat(np.arange(len(elements)), [len(s) for s in elements.shape])
        alike = alike[np.ix_(owner, owner)]
    radius = np.linalg.norm(points, axis=1)
    alike = alike & (abs(radius[:, None] - radius) <= reach)
    # an anchor near the centre would magnify rounding; the rarest of the others leaves least to try
    order = np.lexsort((-radius, alike.sum(axis=1) + len(points) * (radius < 1e-3 * radius.max())))
    anchors = [int(order[0])]
    if d == 3:
        away = np.linalg.norm(np.cross(points[order], points[anchors[0]]), axis=1)
        limit = 1e-3 * radius.max() * radius[anchors[0]]
        anchors.append(int(order[np.flatnonzero(away > limit)[0]]))
    base = _frame(points[anchors])
    places = [np.flatnonzero(alike[anchor]) for anchor in anchors]
    matrices = []
    for images in np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, d - 1):
        gram = points[images] @ points[images].T - points[anchors] @ points[anchors].T
        if abs(gram).max() > 4.0 * reach * radius.max():
            continue
        for last in (1.0, -1.0):
            matrix = _frame(points[images]).T @ np.diag([1.0] * (d - 1) + [last]) @ base
            near = np.round(matrix)
            matrix = near if abs(matrix - near).max() < reach / radius.max() else matrix
            if abs(matrix - np.eye(d)).max() > 1e-6:
                matrices.append(matrix)
    return matrices


def _frame(vectors: Floats) -> Floats:
    """Rows of a right-handed orthonormal frame that starts with the d − 1 given vectors."""
    first = vectors[0] / np.linalg.norm(vectors[0])
    if len(first) == 2:
        return np.array([first, [-first[1], first[0]]])
    second = vectors[1] - (vectors[1] @ first) * first
    second = second / np.linalg.norm(second)
    return np.array([first, second, np.cross(first, second)])


def _alike(assembly: Assembly) -> Bools:
    """(n, n) True for elements of equal volume, number of corners and support flag."""
    elements = assembly.elements
    kind = 2 * np.array([len(s) for s in elements.shape]) + elements.support
    volume = elements.volume
    close = abs(volume[:, None] - volume) <= 10.0 * tolerances.SYMMETRY * np.maximum.outer(volume, volume)
    return np.asarray(close & (kind[:, None] == kind))


def _image(
    assembly: Assembly, search: Search, candidates: Bools, fixed: Bits, matrix: Floats
) -> tuple[Ints, Ints] | str:
    """Where a matrix puts elements (n,) and faces (m,), or in words what it does not map onto itself."""
    elements, faces = assembly.elements, assembly.interfaces
    centre = elements.centroid.mean(axis=0)
    reach = tolerances.SYMMETRY * assembly.size
    if search.block_extent != [None, None] and abs(matrix).max(axis=1).min() < 1.0 - 1e-9:
        return "it turns the bounding boxes that block_extent limits"
    moved = (elements.centroid - centre) @ matrix.T + centre
    to = _nearest(moved, elements.centroid, _alike(assembly), reach)
    if to is None or not _same_corners(elements.shape, elements.shape, to, matrix, centre, reach):
        return "its elements are not mapped onto elements of the same shape"
    if not _same_loads(assembly, to, matrix):
        return "its loads are not mapped onto themselves"
    weight = np.linalg.norm(elements.weight, axis=1)
    if search.block_weight != [None, None] and abs(weight[to] - weight).max() > 1e-8 * weight.max(initial=0.0):
        return "its weights are not mapped onto themselves"
    count = len(elements)
    pair = np.minimum(faces.a, faces.b) * count + np.maximum(faces.a, faces.b)
    pair_to = np.minimum(to[faces.a], to[faces.b]) * count + np.maximum(to[faces.a], to[faces.b])
    moved = (faces.origin - centre) @ matrix.T + centre
    face_to = _nearest(moved, faces.origin, pair_to[:, None] == pair, reach)
    if face_to is None or not _same_corners(faces.polygon, faces.polygon, face_to, matrix, centre, reach):
        return "its interfaces are not mapped onto interfaces"
    sign = np.where(faces.a[face_to] == to[faces.a], 1.0, -1.0)[:, None]
    if abs(faces.normal @ matrix.T - sign * faces.normal[face_to]).max(initial=0.0) > 10.0 * tolerances.SYMMETRY:
        return "its interfaces are not mapped onto interfaces"
    table = np.column_stack(list(vars(assembly.strengths).values())).reshape(len(faces), -1)
    if not np.array_equal(table[face_to], table, equal_nan=True):
        return "its strengths are not mapped onto themselves"
    if np.any(candidates[face_to] != candidates) or np.any((fixed[face_to] != fixed) & ~candidates):
        return "its candidates and fixed labels are not mapped onto themselves"
    return to, face_to


def _nearest(moved: Floats, points: Floats, allowed: Bools, reach: float) -> Ints | None:
    """(n,) the allowed point each moved one falls on; None unless it is one to one."""
    distance = np.linalg.norm(moved[:, None] - points, axis=2)
    to = np.argmin(np.where(allowed, distance, np.inf), axis=1)
    every = np.arange(len(points))
    fits = np.all(allowed[every, to]) and np.all(distance[every, to] <= reach) and len(np.unique(to)) == len(points)
    return to if fits else None


def _same_corners(
    shapes: tuple[Floats, ...],
    others: tuple[Floats, ...],
    to: Ints,
    matrix: Floats,
    centre: Floats,
    reach: float,
) -> bool:
    """Whether each moved shape has the corners of the one it falls on, in any order."""
    corners = np.array([len(s) for s in shapes])
    if np.any(corners != corners[to]):
        return False
    for size in np.unique(corners):
        group = np.flatnonzero(corners == size)
        moved = (np.array([shapes[i] for i in group]) - centre) @ matrix.T + centre
        there = np.array([others[i] for i in to[group]])
        near = np.linalg.norm(moved[:, :, None] - there[:, None], axis=3) <= 2.0 * reach
        if not (near.any(axis=1).all() and near.any(axis=2).all()):
            return False
    return True


def _same_loads(assembly: Assembly, to: Ints, matrix: Floats) -> bool:
    """Whether dead and live loads are mapped onto themselves; moments turn over in a reflection."""
    d = assembly.dimension
    reflect = np.linalg.det(matrix)
    turn = np.array([[reflect]]) if d == 2 else reflect * matrix
    for loads in (assembly.dead, assembly.live):
        for values, map_, arm in ((loads[:, :d], matrix, 1.0), (loads[:, d:], turn, assembly.size)):
            total = np.linalg.norm(loads[:, :d], axis=1).sum() * arm + np.linalg.norm(loads[:, d:], axis=1).sum() * (
                arm / assembly.size
            )
            if abs(values @ map_.T - values[to]).max(initial=0.0) > 10.0 * tolerances.SYMMETRY * total:
                return False
    return True
