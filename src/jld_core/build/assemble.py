"""Scene → Assembly: the one place where a validated file becomes geometry, loads and labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jld_core.arrays import Bits
from jld_core.assembly import DRY, INNER, Assembly, Elements, Interfaces
from jld_core.build import loads, materials
from jld_core.build.elements import faces_of_pairs
from jld_core.build.planar import planar_geometry
from jld_core.build.plausibility import implausible
from jld_core.build.spatial import spatial_geometry
from jld_core.errors import InputError
from jld_core.scene import Contact, Scene

LABELS = {"dry": DRY, "inner": INNER}


def build_assembly(scene: Scene) -> Assembly:
    """Elements, interfaces, loads, strengths and own labels of a scene, in scene units.

    Raises InputError: geometry, references, loads or materials that cannot be used, each by name.
    """
    geometry = spatial_geometry(scene) if scene.dimension == 3 else planar_geometry(scene)
    elements, interfaces, given = geometry.elements, geometry.interfaces, geometry.given
    _check_paths(elements, interfaces)
    dead = loads.generalised(scene.loads.dead, elements, "loads.dead")
    dead[:, : scene.dimension] += np.where(elements.support[:, None], 0.0, elements.weight)
    live = loads.generalised(scene.loads.live, elements, "loads.live")
    if not np.any(live):
        raise InputError("loads.live", "the live load is zero", "at least one load that acts on a free element")
    assembly = Assembly(
        name=scene.name,
        dimension=scene.dimension,
        units=(scene.units.length, scene.units.force),
        elements=elements,
        interfaces=interfaces,
        strengths=materials.strengths(scene.materials, given),
        dead=dead,
        live=live,
        labels=_own_labels(scene, elements, interfaces, given),
        live_points=_points(scene, elements),
        moved=geometry.moved,
    )
    return replace(assembly, warnings=(*geometry.warnings, *implausible(scene, assembly)))


def _check_paths(elements: Elements, interfaces: Interfaces) -> None:
    """Every free element must reach a support through interfaces, or its equilibrium has no solution."""
    count = len(elements)
    links = coo_array((np.ones(len(interfaces)), (interfaces.a, interfaces.b)), shape=(count, count))
    _, part = connected_components(links, directed=False)
    reached = np.isin(part, part[elements.support])
    if not reached.all():
        lost = elements.ids[int(np.flatnonzero(~reached)[0])]
        raise InputError(
            f"element {lost!r}",
            "no path of interfaces leads from it to a support",
            "every free element joined to a support through faces that touch",
        )


def _own_labels(scene: Scene, elements: Elements, interfaces: Interfaces, given: list[Contact | None]) -> Bits:
    """Labels by the scene's precedence: interface, lists, default, then block membership."""
    number = {name: n for n, name in enumerate(dict.fromkeys(elements.blocks))}
    block = np.array([-1 if name is None else number[name] for name in elements.blocks])
    same = (block[interfaces.a] == block[interfaces.b]) & (block[interfaces.a] >= 0)
    support = elements.support[interfaces.a] | elements.support[interfaces.b]
    labels = np.where(same & ~support, INNER, DRY)
    if scene.labels.default is not None:
        labels = np.full(len(interfaces), LABELS[scene.labels.default])
    inner = faces_of_pairs(scene.labels.inner, elements, interfaces, "labels.inner")
    dry = faces_of_pairs(scene.labels.dry, elements, interfaces, "labels.dry")
    if np.any(inner & dry):
        face = int(np.flatnonzero(inner & dry)[0])
        pair = f"{elements.ids[interfaces.a[face]]!r}, {elements.ids[interfaces.b[face]]!r}"
        raise InputError("labels", f"the pair {pair} stands under both inner and dry", "each pair under one")
    labels = np.where(inner, INNER, np.where(dry, DRY, labels))
    for face, contact in enumerate(given):
        if contact is not None and contact.label is not None:
            labels[face] = LABELS[contact.label]
    return labels.astype(bool)


def _points(scene: Scene, elements: Elements) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
    points = []
    for entry in scene.loads.live:
        force = getattr(entry, "force", None)
        if force is not None:
            index = elements.index[entry.element]  # type: ignore[union-attr]
            at = entry.at or elements.centroid[index].tolist()  # type: ignore[union-attr]
            points.append((tuple(at), tuple(force)))
    return tuple(points)
