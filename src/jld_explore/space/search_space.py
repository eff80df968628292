"""Which faces may change, which labels are fixed, and which relabellings are the same by symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.assembly import DRY, INNER, Assembly
from jld_core.assembly_sequence import SequenceConstraint
from jld_core.build import faces_of_pairs
from jld_core.errors import InputError
from jld_core.mechanics import require_materials
from jld_core.scene import Scene, Search
from jld_explore.space.counts import Terms, count_named
from jld_explore.space.labelling import Connectivity, blocks_of, canonical, connectivity
from jld_explore.space.limits import CELLS, MEASURES, Limits, block_sizes
from jld_explore.space.symmetry import SymmetryGroup, symmetry_group
from jld_explore.space.void import Void, void_of, with_sink

_TOTAL = 1e-8
"""Relative rounding allowed where blocks are counted by what all elements weigh together."""


@dataclass(frozen=True)
class SearchSpace:
    """All that decides which labellings there are.

    candidates: (m,) faces that may take either label. fixed: (m,) labels, of force where a face is no
    candidate. graph: for `blocks_of`. least: (n,) blocks through fixed inner faces alone (every labelling's
    blocks contain them). most: (n,) blocks if all candidates were inner. symmetry: maps labellings of the
    space onto labellings of the space with the same load factor and the same counts. void: what may be left out; the
    assembly is then that with the sink, and labellings have a label more for each such cell.
    """

    assembly: Assembly
    search: Search
    candidates: Bools
    fixed: Bits
    graph: Connectivity
    least: Ints
    most: Ints
    symmetry: SymmetryGroup
    void: Void | None = None

    def __repr__(self) -> str:
        spots = int(np.count_nonzero(self.candidates))
        return f"SearchSpace({self.assembly.name!r}, {spots} of {len(self.fixed)} faces may change)"

    @property
    def group(self) -> Ints:
        """(g, m) face permutations of the symmetry group, the identity first."""
        return self.symmetry.faces

    @cached_property
    def limits(self) -> Limits:
        """What blocks and counts must satisfy."""
        return Limits(self.assembly, self.search)

    @cached_property
    def laying(self) -> SequenceConstraint | None:
        """Which labellings can be laid, where that is asked for; asked of canonical ones, so that images agree."""
        if self.search.assemble is None:
            return None
        sideways = self.search.assemble_out_of_plane
        return SequenceConstraint(self.assembly, self.search.assemble, self.candidates | ~self.fixed, sideways=sideways)

    def can_be_laid(self, labellings: Bits) -> Bools:
        """(k,) True where labellings (k, m) can be laid as the search asks, or it does not ask."""
        if self.laying is None:
            return np.ones(len(labellings), dtype=bool)
        return self.laying.possible(canonical(labellings, self.group))


def feasible(space: SearchSpace, labellings: Bits) -> Bools:
    """(k,) True where a labelling (k, m) is in the space: fixed labels, no slits unless allowed, all limits."""
    graph = space.graph
    good = ~np.any((labellings != space.fixed) & ~space.candidates, axis=1)
    blocks = None
    if space.search.segmentation:
        blocks = blocks_of(graph, labellings)
        good &= ~np.any(labellings & (blocks[:, graph.a] == blocks[:, graph.b]), axis=1)
    good &= space.limits.kept(labellings, graph, blocks)
    # the dearest question last, of those that are left
    good[good] = space.can_be_laid(labellings[good])
    return np.asarray(good)


def search_space(
    scene: Scene, assembly: Assembly, *, allow_empty: bool = False, need_materials: bool = True
) -> SearchSpace:
    """The labellings a scene's "search" asks for.

    scene, assembly: the assembly is the scene's. allow_empty: accept a space without candidates, which then
    holds the scene's own labelling alone. need_materials: refuse a label that may occur without its material;
    both are switched the other way for scenes that are described but not searched.
    Raises InputError: an unknown count, unknown ids, pairs without interface or kept both ways, no candidate left,
    fixed labels that contradict each other, limits that nothing satisfies, a material that lacks, no such symmetry.
    """
    search = scene.search
    for place, (name, _) in enumerate(search.front.axes):
        count_named(name, f"search.front.counts[{place}]" if search.front.counts else "search.front.count")
    void = void_of(scene, assembly)
    if void is not None:
        assembly = with_sink(void)
    candidates = _candidate_faces(scene, assembly)
    if void is not None:
        candidates[len(void.real.interfaces) :] = True
        _refuse_walls(void, assembly, candidates, search)
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
    limits = Limits(assembly, search)
    _ = limits.excepted
    _refuse_impossible(limits, chosen, fixed, least, most)
    if need_materials:
        _require_materials(limits, chosen, fixed, least, graph)
    symmetry = symmetry_group(assembly, search, chosen, fixed)
    return SearchSpace(assembly, search, chosen, fixed, graph, least, most, symmetry, void)


def _refuse_walls(void: Void, assembly: Assembly, candidates: Bools, search: Search) -> None:
    """Raise InputError for faces fixed dry between two cells that may be left out: together they are one block."""
    faces = assembly.interfaces
    may = np.isin(np.arange(len(assembly.elements)), void.cells)
    keep = faces_of_pairs(search.keep.dry, assembly.elements, faces, "search.keep.dry")
    wall = may[faces.a] & may[faces.b] & (keep | (~candidates & assembly.labels))
    if wall.any():
        problem = f"the face {_pair(assembly, wall)} between two of them is fixed dry"
        raise InputError("search.void.cells", problem, "cells whose faces to one another are candidates")


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


def _require_materials(limits: Limits, candidates: Bools, fixed: Bits, least: Ints, graph: Connectivity) -> None:
    """Raise InputError where a label that can occur lacks its material."""
    may_be_dry = least[graph.a] != least[graph.b] if limits.search.segmentation else candidates
    may_be_inner = _may_join(limits, least, graph)
    dry, inner = np.where(candidates, may_be_dry, fixed), np.where(candidates, may_be_inner, ~fixed)
    real = limits.assembly.interfaces.b != limits.assembly.sink
    require_materials(limits.assembly, dry & real, inner & real)


def _may_join(limits: Limits, least: Ints, graph: Connectivity) -> Bools:
    """(m,) False where the blocks beside a face are too large to be one."""
    p, q = least[graph.a], least[graph.b]
    joined = np.ones(len(p), dtype=bool)
    if limits.excepted.any():
        return joined
    for measure, bounds in limits.on_blocks:
        if measure.of:
            size = block_sizes(limits.assembly, least[None], [measure])[measure.key][0]
            joined &= ~bounds.above(np.where(p == q, size[p], size[p] + size[q]))
    return joined


def _refuse_impossible(limits: Limits, candidates: Bools, fixed: Bits, least: Ints, most: Ints) -> None:
    """Raise InputError for a limit that no labelling between `least` and `most` can meet."""
    assembly = limits.assembly
    small, large = block_sizes(assembly, least[None]), block_sizes(assembly, most[None])
    holds, whole = np.flatnonzero(small[CELLS.key][0]), np.flatnonzero(large[CELLS.key][0])
    ids = assembly.elements.ids
    fewest, greatest, culprit = len(whole), len(holds), CELLS.key
    for measure in MEASURES:
        bounds, where = limits.bounds(measure), f"search.{measure.key}"
        smallest, largest = small[measure.key][0, holds], large[measure.key][0, whole]
        if limits.excepted.any():
            # blocks that limits except may take in whatever is too large or too small
            continue
        if (heavy := bounds.above(smallest)).any():
            worst = int(np.argmax(np.where(heavy, smallest, -np.inf)))
            found = f"the block of {ids[holds[worst]]!r} has {smallest[worst]:g} {measure.words}"
            problem = f"the most is {bounds.high:g}, but {found}"
            raise InputError(where, problem, f"a most of at least {smallest[worst]:g}")
        if (light := bounds.below(largest)).any():
            worst = int(np.argmin(np.where(light, largest, np.inf)))
            reached = f"the block of {ids[whole[worst]]!r} has {largest[worst]:g} {measure.words} at most"
            raise InputError(
                where, f"the least is {bounds.low:g}, but {reached}", f"a least of at most {largest[worst]:g}"
            )
        if measure.of:
            total = float(smallest.sum())
            fewest = max(fewest, ceil(total / bounds.most * (1.0 - _TOTAL)) if bounds.high else 0)
            number = floor(total / bounds.least * (1.0 + _TOTAL)) if bounds.low else greatest
            if number < greatest:
                greatest, culprit = number, measure.key
    if fewest > greatest:
        problem = f"no number of blocks fits (at least {fewest}, at most {greatest})"
        raise InputError(f"search.{culprit}", problem, "limits that agree")
    for count, bounds in limits.on_counts:
        if count.terms and assembly.sink < 0:
            terms = count.terms(assembly)
            low, high = _reach(terms, candidates, fixed)
            if terms.blocks:
                low, high = low + fewest, high + greatest
            if bounds.above(low) or bounds.below(high):
                asked = ["null" if bound is None else f"{bound:g}" for bound in (bounds.low, bounds.high)]
                problem = f"[{', '.join(asked)}] asked, but there can be {low} to {high}"
                raise InputError(f"search.{count.name}", problem, "a range that meets this")


def _reach(terms: Terms, candidates: Bools, fixed: Bits) -> tuple[int, int]:
    """Fewest and most faces that a count takes in."""
    if terms.faces is None:
        return 0, 0
    return int((terms.faces & ~candidates & fixed).sum()), int((terms.faces & (candidates | fixed)).sum())
