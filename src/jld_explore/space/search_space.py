"""Define which faces may change, which labels are fixed, and how labellings are symmetric."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import DRY, INNER, Assembly
from jld_core.build.elements import faces_of_pairs
from jld_core.errors import InputError
from jld_core.mechanics import require_materials
from jld_core.parameters import require_kind, typed
from jld_core.plugins import part
from jld_core.scene import Search
from jld_core.scene.schema import Scene
from jld_explore.space.counts import Terms, count_named, refuse_unlike_images, values_of
from jld_explore.space.labelling import Connectivity, Void, blocks_of, canonical, connectivity, void_of, with_sink
from jld_explore.space.limits import CELLS, MEASURES, Limits, Measure, Range, block_sizes
from jld_explore.space.symmetry import SymmetryGroup, symmetry_group

_TOTAL: Final = 1e-8  # relative rounding allowed where the number of blocks follows from the total size of all elements


@dataclass(frozen=True)
class _Numbers:
    """Least and largest number of blocks that limits allow, and the limits that decide them."""

    least: int
    most: int
    # least_key, most_key: keys under "search", "" where elements and fixed labels alone decide
    least_key: str = ""
    most_key: str = ""


def may_join(limits: Limits, least: Ints, graph: Connectivity) -> Bools:
    """Return (m,) False where the union of the two blocks beside a face exceeds a limit.

    least: (n,) block of each element by fixed inner faces alone.
    """
    # Only measures that add up over elements are tested. Blocks with an exempt element have no limits, and any block
    # may come to hold one.
    p, q = least[graph.a], least[graph.b]
    joined = np.ones(len(p), dtype=bool)
    if limits.excepted.any():
        return joined
    for measure, bounds in limits.on_blocks:
        if measure.of:
            size = block_sizes(limits.assembly, least[None], [measure])[measure.key][0]
            joined &= ~bounds.above(np.where(p == q, size[p], size[p] + size[q]))
    return joined


def refuse_contradictions(
    limits: Limits, candidates: Bools, fixed: Bits, least: Ints, most: Ints, graph: Connectivity
) -> None:
    """Raise InputError for a limit that provably excludes every labelling."""
    numbers = _numbers_of_blocks(limits, least, most)
    if numbers.least > numbers.most:
        problem = f"no number of blocks fits (at least {numbers.least}, at most {numbers.most})"
        if numbers.least_key and numbers.most_key and numbers.least_key != numbers.most_key:
            problem += f": search.{numbers.least_key} contradicts it"
        raise InputError(f"search.{numbers.most_key or CELLS.key}", problem, "limits that agree")
    _refuse_counts(limits, candidates, fixed, numbers)
    if limits.assembly.sink < 0 and not limits.excepted.any():
        _refuse_shapes_and_sawing(limits, candidates, fixed, least, graph, numbers)


def _numbers_of_blocks(limits: Limits, least: Ints, most: Ints) -> _Numbers:
    """Return the numbers of blocks that limits on single blocks leave; InputError for none."""
    assembly = limits.assembly
    # sizes by the first element of each block, of the most blocks that there can be and of the fewest
    small, large = block_sizes(assembly, least[None]), block_sizes(assembly, most[None])
    smallest_blocks, largest_blocks = np.flatnonzero(small[CELLS.key][0]), np.flatnonzero(large[CELLS.key][0])
    numbers = _Numbers(len(largest_blocks), len(smallest_blocks))
    for measure in MEASURES if not limits.excepted.any() else ():
        # exempt blocks may contain anything that is too large or too small
        bounds = limits.bounds(measure)
        smallest = small[measure.key][0, smallest_blocks]
        largest = large[measure.key][0, largest_blocks]
        _refuse_sizes(limits, measure, bounds, smallest_blocks, smallest, largest_blocks, largest)
        if measure.of:
            total, low, high = float(smallest.sum()), numbers.least, numbers.most
            fewest = ceil(total / bounds.most * (1.0 - _TOTAL)) if bounds.high else 0
            greatest = floor(total / bounds.least * (1.0 + _TOTAL)) if bounds.low else high
            numbers = _Numbers(
                max(low, fewest),
                min(high, greatest),
                measure.key if fewest > low else numbers.least_key,
                measure.key if greatest < high else numbers.most_key,
            )
    return numbers


def _refuse_sizes(
    limits: Limits,
    measure: Measure,
    bounds: Range,
    smallest_blocks: Ints,
    smallest_sizes: Floats,
    largest_blocks: Ints,
    largest_sizes: Floats,
) -> None:
    """Raise InputError if a smallest block is too large, or a largest one too small; blocks by an element of each."""
    where, ids = f"search.{measure.key}", limits.assembly.elements.ids
    if (too_large := bounds.above(smallest_sizes)).any():
        worst = int(np.argmax(np.where(too_large, smallest_sizes, -np.inf)))
        size = smallest_sizes[worst]
        reached = f"the block of {ids[smallest_blocks[worst]]!r} has {size:g} {measure.words}"
        raise InputError(where, f"the most is {bounds.high:g}, but {reached}", f"a largest value of at least {size:g}")
    if (too_small := bounds.below(largest_sizes)).any():
        worst = int(np.argmin(np.where(too_small, largest_sizes, np.inf)))
        size = largest_sizes[worst]
        reached = f"the block of {ids[largest_blocks[worst]]!r} has {size:g} {measure.words} at most"
        raise InputError(where, f"the least is {bounds.low:g}, but {reached}", f"a least value of at most {size:g}")


def _refuse_counts(limits: Limits, candidates: Bools, fixed: Bits, numbers: _Numbers) -> None:
    """Raise InputError if no layout can keep a limit on a count of faces or blocks."""
    assembly = limits.assembly
    for count, bounds in limits.on_counts:
        if not count.terms or assembly.sink >= 0:
            continue
        terms, why = count.terms(assembly), ""
        low, high = _reach(terms, candidates, fixed)
        if terms.faces is not None and not limits.excepted.any():
            fewest = int(terms.faces.sum()) - _most_inner(limits, terms.faces & (candidates | ~fixed))
            low, why = (fewest, CELLS.key) if fewest > low else (low, why)
        if terms.blocks:
            low, high = low + numbers.least, high + numbers.most
            why = numbers.least_key if bounds.above(low) else numbers.most_key
        elif not bounds.above(low):
            why = ""
        if bounds.above(low) or bounds.below(high):
            because = f", since search.{why} is {_bounds_words(getattr(limits.search, why))}" if why else ""
            remedy = "a range that meets this" + (f", or a wider search.{why}" if why else "")
            problem = f"{_range_words(bounds)} asked, but there can be {low} to {high}{because}"
            raise InputError(f"search.{count.name}", problem, remedy)


def _refuse_shapes_and_sawing(
    limits: Limits, candidates: Bools, fixed: Bits, least: Ints, graph: Connectivity, numbers: _Numbers
) -> None:
    """Raise InputError if limits on shapes or on sawing leave no value."""
    # Blocks that can be joined to no other stand alone in every labelling: their shapes must exist. Sawn faces are at
    # least those of triangles or tetrahedra. Sawn length is least where all candidates are inner, and most where none
    # is.
    limited = [(count, bounds) for count, bounds in limits.on_counts if not count.terms]
    if not limited:
        return
    assembly = limits.assembly
    ends = np.array([~candidates & fixed, candidates | fixed])
    # the number of shapes of blocks that no face can join to others, at least 1
    joins = candidates & may_join(limits, least, graph) & (least[graph.a] != least[graph.b])
    joinable = np.unique(np.concatenate([least[graph.a[joins]], least[graph.b[joins]]]))
    free = limits.assembly.elements.free
    names = [int(name) for name in np.unique(least[free]) if name not in joinable]
    members = [free[least[free] == name].tolist() for name in names]
    fewest = max(1, len(np.unique(limits.block_shapes.kinds(members)))) if members else 1
    dimension = assembly.dimension
    ranges: dict[str, tuple[float, float, str]] = {}
    for count, _ in limited:
        why = f"at least {numbers.least} blocks" + (f" by search.{numbers.least_key}" if numbers.least_key else "")
        if count.kinds:
            words = f"{fewest} must exist, of {numbers.most} blocks at most"
            ranges[count.name] = (float(fewest), float(numbers.most), words)
        elif count.least_of_block:
            ranges[count.name] = (float(max(numbers.least, 1) * count.least_of_block[dimension]), np.inf, f"of {why}")
        elif count.least_of_shape:
            ranges[count.name] = (
                float(fewest * count.least_of_shape[dimension]),
                np.inf,
                f"of at least {fewest} shapes",
            )
        elif count.monotone:
            low, high = (float(value) for value in values_of(count, assembly, ends, graph))
            ranges[count.name] = (low, high, "from all faces inner to all faces dry")
    for count, bounds in limited:
        low, high, words = ranges.get(count.name, (-np.inf, np.inf, ""))
        if bounds.above(low) or bounds.below(high):
            most = f"to {high:.6g}" if np.isfinite(high) else "and more"
            problem = f"{_range_words(bounds)} asked, but there can be {low:.6g} {most} ({words})"
            raise InputError(f"search.{count.name}", problem, "a range that meets this, or other limits on blocks")


def _range_words(bounds: Range) -> str:
    return _bounds_words([bounds.low, bounds.high])


def _bounds_words(bounds: list[float | None]) -> str:
    return "[" + ", ".join("null" if bound is None else f"{bound:g}" for bound in bounds) + "]"


def _reach(terms: Terms, candidates: Bools, fixed: Bits) -> tuple[int, int]:
    """Return the least and largest number of faces that a count of dry faces can include."""
    if terms.faces is None:
        return 0, 0
    return int((terms.faces & ~candidates & fixed).sum()), int((terms.faces & (candidates | fixed)).sum())


def _most_inner(limits: Limits, faces: Bools) -> int:
    """Return an upper bound on the number of faces, of those counted (m,), that can be inner together."""
    # an element in a block of c cells shares faces with at most c − 1 others of the block
    assembly, most = limits.assembly, limits.bounds(CELLS).high
    faces = faces & assembly.free_faces
    if most is None or not faces.any():
        return int(faces.sum())
    ends = np.sort(np.column_stack([assembly.interfaces.a[faces], assembly.interfaces.b[faces]]), axis=1)
    per_pair = int(np.unique(ends, axis=0, return_counts=True)[1].max())
    return int(np.minimum(np.bincount(ends.ravel()), per_pair * (int(most) - 1)).sum()) // 2


@dataclass(frozen=True)
class SearchSpace:
    """Labellings that may be searched: candidates, fixed labels, limits and symmetry.

    Attributes
    ----------
    assembly : Assembly
        With `void` it includes the sink, and a face to it for each cell that may be omitted.
    search : Search
        Search.
    candidates : (m,) bool array
        Faces that may have either label.
    fixed : (m,) bool array
        Labels of the other faces.
    graph : Connectivity
        Element graph.
    least, most : (n,) int array
        Block of each element by fixed inner faces alone, and with all candidates inner.
    symmetry : SymmetryGroup
        Symmetries that preserve λ and all counts.
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
        return Limits(self.assembly, self.search)

    @cached_property
    def laying(self) -> Any:
        """Constraint of `jld_practice.laying` on canonical labellings, None if the search has none."""
        if self.search.assemble is None:
            return None
        sideways = self.search.assemble_out_of_plane
        return part("laying_constraint")(
            self.assembly, self.search.assemble, self.candidates | ~self.fixed, sideways=sideways
        )

    def part_of_blocks(self, cells: int | None = None) -> SearchSpace:
        """Return the part, maybe all, without slits, omitted cells and blocks of more than `cells`."""
        # blocks joined to supports are excluded too: there possible blocks can be listed more often
        faces, support = self.assembly.interfaces, self.assembly.elements.support
        at_supports = self.candidates & (support[faces.a] | support[faces.b])
        low, high = self.search.block_cells
        smaller = cells is not None and (high is None or cells < high)
        if self.search.segmentation and not at_supports.any() and not smaller:
            return self
        search = self.search.model_copy(update={"segmentation": True, "block_cells": (low, cells if smaller else high)})
        part = replace(self, search=search, candidates=self.candidates & ~at_supports, fixed=self.fixed | at_supports)
        # cached_property keeps its value in the dictionary of the instance
        part.__dict__["laying"] = self.laying
        return part

    def can_be_laid(self, labellings: Bits) -> Bools:
        """Return (k,) whether labellings (k, m) have an assembly sequence, or none is required."""
        if self.laying is None:
            return np.ones(len(labellings), dtype=bool)
        possible: Bools = self.laying.possible(canonical(labellings, self.group))
        return possible


def feasible(space: SearchSpace, labellings: Bits) -> Bools:
    """Return which labellings are in the search space.

    Parameters
    ----------
    space : SearchSpace
        Search space.
    labellings : (k, m) array of bool
        True = dry.

    Returns
    -------
    (k,) array of bool
        True for those in the space.
    """
    # A labelling must have the fixed labels, no slits unless allowed, and satisfy all limits and the assembly sequence.
    graph = space.graph
    inside = ~np.any((labellings != space.fixed) & ~space.candidates, axis=1)
    blocks = None
    if space.search.segmentation:
        blocks = blocks_of(graph, labellings)
        inside &= ~np.any(labellings & (blocks[:, graph.a] == blocks[:, graph.b]), axis=1)
    inside &= space.limits.kept(labellings, graph, blocks)
    # Check the most expensive condition last, and only where all others hold.
    inside[inside] = space.can_be_laid(labellings[inside])
    return np.asarray(inside)


@typed
def search_space(
    scene: Scene, assembly: Assembly, *, allow_empty: bool = False, need_materials: bool = True, tells_apart: str = ""
) -> SearchSpace:
    """Build the search space of a scene from its "search" section.

    Parameters
    ----------
    scene : Scene
        The scene.
    assembly : Assembly
        The structure.
    allow_empty : bool
        Accept a space without candidates, which holds the scene's own labelling alone.
    need_materials : bool
        Refuse a label that may occur but has no material.
    tells_apart : str
        Reason why mirror images may rank differently; then none are merged.

    Returns
    -------
    SearchSpace

    Raises
    ------
    InputError
        If the section names something unknown, contradicts itself or leaves no labelling.
    """
    require_kind("scene", scene, Scene)
    require_kind("assembly", assembly, Assembly)
    search = scene.search
    for position, (name, _) in enumerate(search.front.axes):
        count_named(name, f"search.front.counts[{position}]" if search.front.counts else "search.front.count")
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
        exception = " that search.keep does not fix" if candidates.any() else ""
        raise InputError("search.candidates", "no face is a candidate", f"at least one face{exception}")
    limits = Limits(assembly, search)
    _ = limits.excepted
    refuse_contradictions(limits, chosen, fixed, least, most, graph)
    if need_materials:
        _require_materials(limits, chosen, fixed, least, graph)
    symmetry = symmetry_group(assembly, scene, chosen, fixed, unknown=tells_apart)
    if len(symmetry) > 1:
        refuse_unlike_images(assembly, graph, symmetry.faces, chosen, fixed)
    return SearchSpace(assembly, search, chosen, fixed, graph, least, most, symmetry, void)


def _refuse_walls(void: Void, assembly: Assembly, candidates: Bools, search: Search) -> None:
    """Raise InputError for faces fixed dry between two cells that may be left out."""
    # two omitted cells are one block with the sink, so the face between them cannot be dry
    faces = assembly.interfaces
    may = np.isin(np.arange(len(assembly.elements)), void.cells)
    keep = faces_of_pairs(search.keep.dry, assembly.elements, faces, "search.keep.dry")
    wall = may[faces.a] & may[faces.b] & (keep | (~candidates & assembly.labels))
    if wall.any():
        problem = f"the face {_pair(assembly, wall)} between two of them is fixed dry"
        raise InputError("search.void.cells", problem, "cells whose faces to one another are candidates")


def _candidate_faces(scene: Scene, assembly: Assembly) -> Bools:
    """Return (m,) mask of the faces that `search.candidates` selects."""
    selection, elements, faces = scene.search.candidates, assembly.elements, assembly.interfaces
    if isinstance(selection, list):
        return faces_of_pairs(selection, elements, faces, "search.candidates")
    if selection == "all+supports":
        return ~assembly.of_members
    if selection == "all":
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
    """Raise InputError if a label that can occur has no material."""
    may_be_dry = least[graph.a] != least[graph.b] if limits.search.segmentation else candidates
    may_be_inner = may_join(limits, least, graph)
    dry, inner = np.where(candidates, may_be_dry, fixed), np.where(candidates, may_be_inner, ~fixed)
    real = limits.assembly.interfaces.b != limits.assembly.sink
    require_materials(limits.assembly, dry & real, inner & real)


def reasons_against(space: SearchSpace, labels: Bits) -> tuple[str, ...]:
    """Explain why a labelling is not in a search space.

    Parameters
    ----------
    space : SearchSpace
        Search space.
    labels : (m,) array of bool
        True = dry.

    Returns
    -------
    tuple of str
        One sentence per violated condition; empty if `feasible` accepts the labelling.
    """
    blocks = blocks_of(space.graph, labels[None])
    return (*_of_faces(space, labels, blocks[0]), *_of_blocks(space, blocks), *_of_counts(space, labels))


def _of_faces(space: SearchSpace, labels: Bits, block: Ints) -> list[str]:
    """Return violations of fixed labels and of `search.segmentation`; block: (n,) of each element."""
    violations = []
    for label, name in ((True, "dry"), (False, "inner")):
        violated = (labels != space.fixed) & ~space.candidates & (space.fixed == label)
        if violated.any():
            violations.append(f"{_faces(space, violated)} must be {name}")
    slits = labels & (block[space.graph.a] == block[space.graph.b])
    if space.search.segmentation and slits.any():
        violations.append(f"{_faces(space, slits)} dry with one block on both sides")
    return violations


def _of_blocks(space: SearchSpace, blocks: Ints) -> list[str]:
    """Say which limits on blocks a labelling, by its blocks (1, n), violates."""
    limits, violations = space.limits, []
    names = np.unique(blocks[0][space.assembly.elements.free])
    excepted = np.isin(names, blocks[0][limits.excepted])
    for measure, bounds in limits.on_blocks:
        sizes = block_sizes(space.assembly, blocks, [measure])[measure.key][0][names]
        wrong = bounds.outside(sizes) & ~excepted
        if wrong.any():
            worst = int(np.argmax(np.where(wrong, sizes, -1.0)))
            size = f"{_block(space, blocks[0], int(names[worst]), wrong)} has {sizes[worst]:.6g} {measure.words}"
            violations.append(f"{size}; {measure.key} allows {_limit_words(bounds)}")
    if limits.on_shapes:
        wrong = np.array([limits.misshapen(_members(space, blocks[0], int(name)).tolist()) for name in names])
        if wrong.any():
            first = int(names[np.argmax(wrong)])
            allowed = ", ".join(f"{name} {_limit_words(bounds)}" for name, bounds in limits.on_shapes)
            violations.append(f"{_block(space, blocks[0], first, wrong)} has a shape that is not allowed ({allowed})")
    return violations


def _of_counts(space: SearchSpace, labels: Bits) -> list[str]:
    """Return the violations of limits on counts, and of the order of assembly, in words."""
    limits, violations = space.limits, []
    for count, bounds in limits.on_counts:
        value = values_of(count, space.assembly, labels[None], space.graph, limits.block_shapes)[0]
        if bounds.outside(value):
            violations.append(f"{count.name} is {value:.6g}; the search allows {_limit_words(bounds)}")
    if not space.can_be_laid(labels[None])[0]:
        violations.append(f"it cannot be laid as assemble: {space.search.assemble} asks")
    return violations


def _limit_words(bounds: Range) -> str:
    if bounds.low is None:
        return f"at most {bounds.high:.6g}"
    return f"at least {bounds.low:.6g}" if bounds.high is None else f"{bounds.low:.6g} to {bounds.high:.6g}"


def _members(space: SearchSpace, block: Ints, name: int) -> Ints:
    return np.flatnonzero((block == name) & ~space.assembly.elements.support)


def _block(space: SearchSpace, block: Ints, name: int, wrong: Bools) -> str:
    """Name a block for a message, with the number of blocks (n,) that violate the limit."""
    first, more = space.assembly.elements.ids[_members(space, block, name)[0]], int(wrong.sum()) - 1
    return f"the block of {first!r}" + (f" (one of {more + 1})" if more else "")


def _faces(space: SearchSpace, chosen: Bools) -> str:
    pair, count = space.assembly.pair(int(np.argmax(chosen))), int(chosen.sum())
    return f"face {pair}" if count == 1 else f"{count} faces, the first {pair},"
