"""Which faces may change, which labels are fixed, and which relabellings are the same by symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import DRY, INNER, Assembly
from jld_core.build import faces_of_pairs
from jld_core.errors import InputError
from jld_core.mechanics import require_materials
from jld_core.scene import Scene, Search
from jld_explore.space.labelling import BlockSizes, Connectivity, above, below, block_sizes, blocks_of, connectivity
from jld_explore.space.symmetry import SymmetryGroup, symmetry_group


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
