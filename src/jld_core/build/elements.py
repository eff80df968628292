"""Element entries of a scene → Elements, and the names by which a scene refers to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.build import materials
from jld_core.errors import InputError
from jld_core.scene import Contact, Element, Scene


def collect_elements(
    scene: Scene,
    entries: list[Element],
    centroid: Floats,
    volume: Floats,
    shape: list[Floats],
    faces: tuple[tuple[tuple[int, ...], ...], ...],
) -> Elements:
    """Elements without weight yet, given volumes and centroids put in place of computed ones.

    centroid: (n, d); volume: (n,); shape, faces: as in Elements.
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
    )


def weighed(elements: Elements, entries: list[Element], scene: Scene) -> Elements:
    """Elements with the self-weights that their entries and the scene's materials give them."""
    direction = materials.direction_of_weight(scene)
    gravity = float(np.linalg.norm(materials.gravity_vector(scene.materials, scene.dimension)))
    weight = [
        materials.self_weight(entry, size, scene.materials, direction, gravity)
        for entry, size in zip(entries, elements.volume, strict=True)
    ]
    return replace(elements, weight=np.array(weight), gravity=gravity)


@dataclass(frozen=True)
class Geometry:
    """Elements and interfaces of a scene, and what had to be done to them; neither materials nor loads change them.

    elements: without weights. entries: the scene's own entry for each. given: the scene's own entry for each interface,
    None where it was found. touching: pairs of supports that share a face, whatever interfaces the scene states. moved:
    farthest that a corner moved to close gaps and overlaps, length. warnings: what was found near enough to be meant as
    contact, and is none.
    """

    elements: Elements
    entries: list[Element]
    interfaces: Interfaces
    given: list[Contact | None]
    touching: tuple[tuple[int, int], ...]
    moved: float = 0.0
    warnings: tuple[str, ...] = ()


def snapping(scene: Scene, edges: Floats) -> tuple[float, float]:
    """Length up to which gaps and overlaps are closed, 0 for none, and the shortest of the edges, inf without any."""
    shortest = float(edges[edges > 0.0].min(initial=np.inf))
    tolerance = scene.tolerance if scene.tolerance is not None else tolerances.SNAP * shortest
    return (tolerance if tolerance < np.inf else 0.0), shortest


def refuse_twins(ids: list[str]) -> None:
    """Raise InputError for an id that two elements share."""
    seen: set[str] = set()
    for position, name in enumerate(ids):
        if name in seen:
            raise InputError(f"elements[{position}].id", f"{name!r} is used twice", "an id of its own for each element")
        seen.add(name)


def pair_index(pair: list[str], elements: Elements, where: str) -> tuple[int, int]:
    """Element indices of a pair of ids. Raises InputError for an unknown id or twice the same one."""
    for name in pair:
        if name not in elements.index:
            raise InputError(where, f"no element is named {name!r}", "ids of two elements")
    if pair[0] == pair[1]:
        raise InputError(where, f"{pair[0]!r} is named twice", "ids of two elements")
    return elements.index[pair[0]], elements.index[pair[1]]


def faces_of_pairs(pairs: list[list[str]], elements: Elements, interfaces: Interfaces, where: str) -> Bits:
    """(m,) mask of all interfaces between the elements of each pair.

    where: the key, for complaints. Raises InputError for unknown ids and for elements that do not touch.
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
