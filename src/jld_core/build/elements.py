"""Conversion of a scene's element entries to `Elements`, and look-up of elements by id."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.build import materials
from jld_core.errors import InputError
from jld_core.scene import Scene
from jld_core.scene.schema import Contact, Element


def collect_elements(
    scene: Scene,
    entries: list[Element],
    centroid: Floats,
    volume: Floats,
    shape: list[Floats],
    faces: tuple[tuple[tuple[int, ...], ...], ...],
) -> Elements:
    """Build the elements of a scene from its entries and computed geometry, without weights.

    centroid: (n, d) and volume: (n,), computed; values that an entry states replace them. shape, faces: as in
    `Elements`. Raises InputError where all or none of the elements are supports.
    """
    volume = np.array([e.volume if e.volume is not None else v for e, v in zip(entries, volume, strict=True)])
    centroid = np.array([e.centroid if e.centroid is not None else c for e, c in zip(entries, centroid, strict=True)])
    support = np.array([entry.support for entry in entries])
    if support.all():
        raise InputError("elements", "all of them are supports", "at least one free element")
    if not support.any():
        if scene.grid is not None:
            raise InputError("grid.rows", "no cell is a support", "at least one '#'")
        raise InputError("elements", "none of them is a support", 'at least one with "support": true')
    return Elements(
        ids=tuple(entry.id for entry in entries),
        blocks=tuple(entry.block for entry in entries),
        support=support,
        centroid=centroid,
        volume=volume,
        weight=np.zeros_like(centroid),
        shape=tuple(shape),
        faces=faces,
        stated=tuple(
            frozenset(key for key in ("weight", "volume", "centroid") if getattr(entry, key) is not None)
            for entry in entries
        ),
    )


def weighed(elements: Elements, entries: list[Element], scene: Scene) -> Elements:
    """Compute the self-weights of all elements, and return the elements with them.

    entries: the scene's entry for each element, in the same order; it may state weight or density.
    """
    direction = materials.direction_of_weight(scene)
    gravity = float(np.linalg.norm(materials.gravity_vector(scene.materials, scene.dimension)))
    weight = [
        materials.self_weight(entry, size, scene.materials, direction, gravity)
        for entry, size in zip(entries, elements.volume, strict=True)
    ]
    return replace(elements, weight=np.array(weight), gravity=gravity)


@dataclass(frozen=True)
class Geometry:
    """Elements and interfaces of a scene, independent of materials and loads.

    elements: elements without weights. entries: the scene's entry for each element. interfaces: interfaces, except
    those between two supports. given: the scene's entry for each interface; None for a detected interface. touching:
    pairs of supports that share a face, whether or not the scene states an interface there. moved: largest displacement
    of a corner when gaps and overlaps were closed, length. warnings: near misses of faces, or poor fits of stated
    interfaces.
    """

    elements: Elements
    entries: list[Element]
    interfaces: Interfaces
    given: list[Contact | None]
    touching: tuple[tuple[int, int], ...]
    moved: float = 0.0
    warnings: tuple[str, ...] = ()


def snapping(scene: Scene, edges: Floats) -> tuple[float, float]:
    """Return the snapping tolerance of a scene and its shortest edge, both lengths.

    edges: lengths of all edges. Gaps and overlaps up to the tolerance are closed. It is the scene's own, or a small
    share of the shortest edge; without edges the results are 0 and inf.
    """
    shortest = float(edges[edges > 0.0].min(initial=np.inf))
    tolerance = scene.tolerance if scene.tolerance is not None else tolerances.SNAP * shortest
    return (tolerance if tolerance < np.inf else 0.0), shortest


def refuse_twins(ids: list[str]) -> None:
    """Raise InputError if an element id is used twice."""
    seen: set[str] = set()
    for position, name in enumerate(ids):
        if name in seen:
            raise InputError(f"elements[{position}].id", f"{name!r} is used twice", "an id of its own for each element")
        seen.add(name)


def pair_index(pair: list[str], elements: Elements, where: str) -> tuple[int, int]:
    """Return the indices of two elements that are named by their ids.

    where: key of the pair in the scene, for the message. Raises InputError for an unknown id, or for one id given
    twice.
    """
    for name in pair:
        if name not in elements.index:
            raise InputError(where, f"no element is named {name!r}", "ids of two elements")
    if pair[0] == pair[1]:
        raise InputError(where, f"{pair[0]!r} is named twice", "ids of two elements")
    return elements.index[pair[0]], elements.index[pair[1]]


def faces_of_pairs(pairs: list[list[str]], elements: Elements, interfaces: Interfaces, where: str) -> Bits:
    """Return the mask of all interfaces between the elements of each pair.

    Parameters
    ----------
    pairs : list of [str, str]
        Ids of two elements each.
    elements : Elements
        Elements of the assembly.
    interfaces : Interfaces
        The m interfaces of the assembly.
    where : str
        Key of the list in the scene, for error messages.

    Returns
    -------
    (m,) bool array
        True for interfaces between the elements of a pair.

    Raises
    ------
    InputError
        An id is unknown, or two elements share no interface.
    """
    chosen = np.zeros(len(interfaces), dtype=bool)
    if not pairs:
        return chosen
    count = len(elements)
    keys = np.minimum(interfaces.a, interfaces.b) * count + np.maximum(interfaces.a, interfaces.b)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    for position, pair in enumerate(pairs):
        a, b = sorted(pair_index(pair, elements, f"{where}[{position}]"))
        first, last = np.searchsorted(keys, a * count + b, "left"), np.searchsorted(keys, a * count + b, "right")
        if first == last:
            raise InputError(
                f"{where}[{position}]",
                f"{pair[0]!r} and {pair[1]!r} share no interface",
                "two elements that touch",
            )
        chosen[order[first:last]] = True
    return chosen
