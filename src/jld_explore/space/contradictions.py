"""Refuse limits of a search that contradict one another, before anything is searched.

Each refusal is proven by sizes alone: no labelling satisfies the limits. A space that passes may still be empty.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.errors import InputError
from jld_explore.space.count_values import values_of
from jld_explore.space.counts import Terms
from jld_explore.space.labelling import Connectivity
from jld_explore.space.limits import Limits
from jld_explore.space.measures import CELLS, MEASURES, Measure, Range, block_sizes

_TOTAL: Final = 1e-8  # relative rounding allowed where the number of blocks follows from the total size of all elements


@dataclass(frozen=True)
class _Numbers:
    """Least and largest number of blocks that limits allow, and the limits that decide them.

    least_key, most_key: keys under "search", "" where elements and fixed labels alone decide.
    """

    least: int
    most: int
    least_key: str = ""
    most_key: str = ""


def may_join(limits: Limits, least: Ints, graph: Connectivity) -> Bools:
    """Return (m,) False where the union of the two blocks beside a face exceeds a limit.

    least: (n,) block of each element through fixed inner faces.
    """
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
    """Raise InputError for a limit that provably excludes every labelling.

    candidates, fixed: (m,), least, most: (n,), graph: all as in `SearchSpace`.
    """
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
    """Return the numbers of blocks that limits on single blocks leave.

    least, most: (n,) as in `SearchSpace`. Raises InputError if the smallest blocks are too large, or the largest ones
    too small.
    """
    assembly = limits.assembly
    small, large = block_sizes(assembly, least[None]), block_sizes(assembly, most[None])
    holds, whole = np.flatnonzero(small[CELLS.key][0]), np.flatnonzero(large[CELLS.key][0])
    found = _Numbers(len(whole), len(holds))
    for measure in MEASURES if not limits.excepted.any() else ():
        # exempt blocks may contain anything that is too large or too small
        bounds = limits.bounds(measure)
        smallest = small[measure.key][0, holds]
        _refuse_sizes(limits, measure, bounds, (holds, smallest), (whole, large[measure.key][0, whole]))
        if measure.of:
            total, low, high = float(smallest.sum()), found.least, found.most
            fewest = ceil(total / bounds.most * (1.0 - _TOTAL)) if bounds.high else 0
            number = floor(total / bounds.least * (1.0 + _TOTAL)) if bounds.low else high
            found = _Numbers(
                max(low, fewest),
                min(high, number),
                measure.key if fewest > low else found.least_key,
                measure.key if number < high else found.most_key,
            )
    return found


def _refuse_sizes(
    limits: Limits, measure: Measure, bounds: Range, small: tuple[Ints, Floats], large: tuple[Ints, Floats]
) -> None:
    """Raise InputError if a smallest block is too large, or a largest one too small.

    small, large: first elements and sizes of the smallest and of the largest possible blocks.
    """
    where, ids = f"search.{measure.key}", limits.assembly.elements.ids
    (holds, smallest), (whole, largest) = small, large
    if (heavy := bounds.above(smallest)).any():
        worst = int(np.argmax(np.where(heavy, smallest, -np.inf)))
        found = f"the block of {ids[holds[worst]]!r} has {smallest[worst]:g} {measure.words}"
        problem = f"the most is {bounds.high:g}, but {found}"
        raise InputError(where, problem, f"a largest value of at least {smallest[worst]:g}")
    if (light := bounds.below(largest)).any():
        worst = int(np.argmin(np.where(light, largest, np.inf)))
        reached = f"the block of {ids[whole[worst]]!r} has {largest[worst]:g} {measure.words} at most"
        raise InputError(
            where, f"the least is {bounds.low:g}, but {reached}", f"a least value of at most {largest[worst]:g}"
        )


def _refuse_counts(limits: Limits, candidates: Bools, fixed: Bits, numbers: _Numbers) -> None:
    """Raise InputError if no layout can keep a limit on a count of faces or blocks.

    candidates, fixed: (m,) as in `SearchSpace`. numbers: smallest and largest number of blocks under the other limits.
    """
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
            because = f", since search.{why} is {_written(getattr(limits.search, why))}" if why else ""
            remedy = "a range that meets this" + (f", or a wider search.{why}" if why else "")
            problem = f"{_asked(bounds)} asked, but there can be {low} to {high}{because}"
            raise InputError(f"search.{count.name}", problem, remedy)


def _refuse_shapes_and_sawing(
    limits: Limits, candidates: Bools, fixed: Bits, least: Ints, graph: Connectivity, numbers: _Numbers
) -> None:
    """Raise InputError if limits on shapes or on sawing leave no value.

    Blocks that can be joined to no other stand alone in every labelling: their shapes must exist. Sawn faces are at
    least those of triangles or tetrahedra. Sawn length is least where all candidates are inner, and most where none is.
    """
    asked = [(count, bounds) for count, bounds in limits.on_counts if not count.terms]
    if not asked:
        return
    assembly = limits.assembly
    ends = np.array([~candidates & fixed, candidates | fixed])
    alone = _shapes_alone(limits, candidates, least, graph)
    dimension = assembly.dimension
    known: dict[str, tuple[float, float, str]] = {}
    for count, _ in asked:
        why = f"at least {numbers.least} blocks" + (f" by search.{numbers.least_key}" if numbers.least_key else "")
        if count.kinds:
            words = f"{alone} must exist, of {numbers.most} blocks at most"
            known[count.name] = (float(alone), float(numbers.most), words)
        elif count.least_of_block:
            known[count.name] = (float(max(numbers.least, 1) * count.least_of_block[dimension]), np.inf, f"of {why}")
        elif count.least_of_shape:
            known[count.name] = (float(alone * count.least_of_shape[dimension]), np.inf, f"of at least {alone} shapes")
        elif count.monotone:
            low, high = (float(value) for value in values_of(count, assembly, ends, graph))
            known[count.name] = (low, high, "from all faces inner to all faces dry")
    for count, bounds in asked:
        low, high, words = known.get(count.name, (-np.inf, np.inf, ""))
        if bounds.above(low) or bounds.below(high):
            most = f"to {high:.6g}" if np.isfinite(high) else "and more"
            problem = f"{_asked(bounds)} asked, but there can be {low:.6g} {most} ({words})"
            raise InputError(f"search.{count.name}", problem, "a range that meets this, or other limits on blocks")


def _shapes_alone(limits: Limits, candidates: Bools, least: Ints, graph: Connectivity) -> int:
    """Return the number of shapes of blocks that no face can join to others, at least 1.

    candidates: (m,), least: (n,), as in `SearchSpace`.
    """
    joins = candidates & may_join(limits, least, graph) & (least[graph.a] != least[graph.b])
    open_ones = np.unique(np.concatenate([least[graph.a[joins]], least[graph.b[joins]]]))
    free = limits.assembly.elements.free
    names = [int(name) for name in np.unique(least[free]) if name not in open_ones]
    members = [free[least[free] == name].tolist() for name in names]
    return max(1, len(np.unique(limits.block_shapes.kinds(members)))) if members else 1


def _asked(bounds: Range) -> str:
    """Return the bounds of a limit as they are written in a scene."""
    return _written([bounds.low, bounds.high])


def _written(bounds: list[float | None]) -> str:
    """Return [least, most] as in a scene."""
    return "[" + ", ".join("null" if bound is None else f"{bound:g}" for bound in bounds) + "]"


def _reach(terms: Terms, candidates: Bools, fixed: Bits) -> tuple[int, int]:
    """Return the least and largest number of faces that a count of dry faces can include.

    candidates, fixed: (m,) as in `SearchSpace`.
    """
    if terms.faces is None:
        return 0, 0
    return int((terms.faces & ~candidates & fixed).sum()), int((terms.faces & (candidates | fixed)).sum())


def _most_inner(limits: Limits, faces: Bools) -> int:
    """Return an upper bound on the number of faces that can be inner at the same time.

    faces: (m,) those counted; only faces between free elements are. An element in a block of c cells shares faces with
    at most c − 1 others of the block.
    """
    assembly, most = limits.assembly, limits.bounds(CELLS).high
    faces = faces & assembly.free_faces
    if most is None or not faces.any():
        return int(faces.sum())
    ends = np.sort(np.column_stack([assembly.interfaces.a[faces], assembly.interfaces.b[faces]]), axis=1)
    per_pair = int(np.unique(ends, axis=0, return_counts=True)[1].max())
    return int(np.minimum(np.bincount(ends.ravel()), per_pair * (int(most) - 1)).sum()) // 2
