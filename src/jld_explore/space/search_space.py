"""Define which faces may change, which labels are fixed, and how labellings are symmetric."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.assembly import DRY, INNER, Assembly
from jld_core.assembly_sequence.constraint import SequenceConstraint
from jld_core.build import faces_of_pairs
from jld_core.errors import InputError
from jld_core.mechanics import require_materials
from jld_core.parameters import require_kind
from jld_core.scene import Scene, Search
from jld_explore.space.contradictions import may_join, refuse_contradictions
from jld_explore.space.counts import count_named
from jld_explore.space.labelling import Connectivity, blocks_of, canonical, connectivity
from jld_explore.space.limits import Limits
from jld_explore.space.symmetry import SymmetryGroup, symmetry_group
from jld_explore.space.void import Void, void_of, with_sink


@dataclass(frozen=True)
class SearchSpace:
    """Labellings that may be searched: candidates, fixed labels, limits and symmetry.

    Attributes
    ----------
    assembly : Assembly
        Structure; with `void` it includes the sink, and each cell that may be omitted has one more face.
    search : Search
        Section "search" of the scene.
    candidates : (m,) bool array
        Faces that may have either label.
    fixed : (m,) bool array
        Labels, True = dry, that apply to faces that are not candidates.
    graph : Connectivity
        Element graph, for `blocks_of`.
    least : (n,) int array
        Blocks through fixed inner faces alone; blocks of every labelling contain them.
    most : (n,) int array
        Blocks if all candidates are inner.
    symmetry : SymmetryGroup
        Symmetries that map the space onto itself and preserve the load factor and all counts.
    void : Void or None
        Cells that may be left out.
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
        """Limits on blocks and counts."""
        return Limits(self.assembly, self.search)

    @cached_property
    def laying(self) -> SequenceConstraint | None:
        """Assembly sequence constraint, None if the search has none.

        It is evaluated for canonical labellings, so that all images of a labelling give the same result.
        """
        if self.search.assemble is None:
            return None
        sideways = self.search.assemble_out_of_plane
        return SequenceConstraint(self.assembly, self.search.assemble, self.candidates | ~self.fixed, sideways=sideways)

    def part_of_blocks(self, cells: int | None = None) -> SearchSpace:
        """Return the part of the space without slits and large blocks, and with all cells.

        It also excludes labellings whose blocks are joined to a support. Possible blocks can be listed there more often
        than in the whole space. The part shares the results on assembly sequences.

        Parameters
        ----------
        cells : int, optional
            Largest number of cells of a block in the part. Default: as in the space.

        Returns
        -------
        SearchSpace
            Subset of this space, or this space itself where the part is all of it.
        """
        faces, support = self.assembly.interfaces, self.assembly.elements.support
        held = self.candidates & (support[faces.a] | support[faces.b])
        low, high = self.search.block_cells
        smaller = cells is not None and (high is None or cells < high)
        if self.search.segmentation and not held.any() and not smaller:
            return self
        search = self.search.model_copy(update={"segmentation": True, "block_cells": (low, cells if smaller else high)})
        part = replace(self, search=search, candidates=self.candidates & ~held, fixed=self.fixed | held)
        # cached_property keeps its value in the dictionary of the instance
        part.__dict__["laying"] = self.laying
        return part

    def can_be_laid(self, labellings: Bits) -> Bools:
        """Return (k,) True where labellings (k, m) have an assembly sequence, or none is required."""
        if self.laying is None:
            return np.ones(len(labellings), dtype=bool)
        return self.laying.possible(canonical(labellings, self.group))


def feasible(space: SearchSpace, labellings: Bits) -> Bools:
    """Return True for the labellings that are in the search space.

    A labelling must have the fixed labels, no slits unless allowed, and satisfy all limits and the assembly sequence.

    labellings: (k, m) True = dry. Returns (k,): True for labellings in the space.
    """
    graph = space.graph
    good = ~np.any((labellings != space.fixed) & ~space.candidates, axis=1)
    blocks = None
    if space.search.segmentation:
        blocks = blocks_of(graph, labellings)
        good &= ~np.any(labellings & (blocks[:, graph.a] == blocks[:, graph.b]), axis=1)
    good &= space.limits.kept(labellings, graph, blocks)
    # Check the most expensive condition last, and only where all others hold.
    good[good] = space.can_be_laid(labellings[good])
    return np.asarray(good)


def search_space(
    scene: Scene,
    assembly: Assembly,
    *,
    allow_empty: bool = False,
    need_materials: bool = True,
    tells_apart: str = "",
) -> SearchSpace:
    """Build the search space of a scene from its "search" section.

    Parameters
    ----------
    scene : Scene
        Validated scene.
    assembly : Assembly
        Assembly of the scene.
    allow_empty : bool
        Accept a space without candidates, which holds the scene's own labelling alone.
    need_materials : bool
        Refuse a label that may occur but has no material.
        Scenes that are described but not searched use the opposite of both defaults.
    tells_apart : str
        Reason why what ranks layouts may tell mirror images apart; then none are merged.

    Returns
    -------
    SearchSpace
        Search space.

    Raises
    ------
    InputError
        If a count or an id is unknown, a pair has no interface or is kept with both labels, or no candidate is left.
        Also if fixed labels contradict each other, no labelling satisfies the limits, a material is missing, or the
        scene lacks the requested symmetry.
    """
    require_kind("scene", scene, Scene)
    require_kind("assembly", assembly, Assembly)
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
        raise InputError("search.keep", f"the pair {pair} is listed under both dry and inner", "each pair under one")
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
    refuse_contradictions(limits, chosen, fixed, least, most, graph)
    if need_materials:
        _require_materials(limits, chosen, fixed, least, graph)
    symmetry = symmetry_group(assembly, scene, chosen, fixed, unknown=tells_apart)
    return SearchSpace(assembly, search, chosen, fixed, graph, least, most, symmetry, void)


def _refuse_walls(void: Void, assembly: Assembly, candidates: Bools, search: Search) -> None:
    """Raise InputError for faces fixed dry between two cells that may be left out.

    Two omitted cells are one block with the sink, so the face between them cannot be dry.
    """
    faces = assembly.interfaces
    may = np.isin(np.arange(len(assembly.elements)), void.cells)
    keep = faces_of_pairs(search.keep.dry, assembly.elements, faces, "search.keep.dry")
    wall = may[faces.a] & may[faces.b] & (keep | (~candidates & assembly.labels))
    if wall.any():
        problem = f"the face {_pair(assembly, wall)} between two of them is fixed dry"
        raise InputError("search.void.cells", problem, "cells whose faces to one another are candidates")


def _candidate_faces(scene: Scene, assembly: Assembly) -> Bools:
    """Return (m,) mask of the faces that `search.candidates` selects."""
    wanted, elements, faces = scene.search.candidates, assembly.elements, assembly.interfaces
    if isinstance(wanted, list):
        return faces_of_pairs(wanted, elements, faces, "search.candidates")
    if wanted == "all+supports":
        return ~assembly.of_members
    if wanted == "all":
        return assembly.free_faces.copy()
    names = [f"={name}" if name is not None else str(i) for i, name in enumerate(elements.blocks)]
    block = np.unique(np.array(names), return_inverse=True)[1]
    return np.asarray(assembly.free_faces & (block[faces.a] == block[faces.b]))


def _pair(assembly: Assembly, mask: Bools) -> str:
    """Return the ids of the two elements of the first face in a mask."""
    face = int(np.flatnonzero(mask)[0])
    ids, faces = assembly.elements.ids, assembly.interfaces
    return f"{ids[faces.a[face]]!r}, {ids[faces.b[face]]!r}"


def _require_materials(limits: Limits, candidates: Bools, fixed: Bits, least: Ints, graph: Connectivity) -> None:
    """Raise InputError if a label that can occur has no material.

    candidates, fixed: (m,) as in `SearchSpace`. least: (n,) block of each element if only faces that are inner in every
    labelling join elements.
    """
    may_be_dry = least[graph.a] != least[graph.b] if limits.search.segmentation else candidates
    may_be_inner = may_join(limits, least, graph)
    dry, inner = np.where(candidates, may_be_dry, fixed), np.where(candidates, may_be_inner, ~fixed)
    real = limits.assembly.interfaces.b != limits.assembly.sink
    require_materials(limits.assembly, dry & real, inner & real)
