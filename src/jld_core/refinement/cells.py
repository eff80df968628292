"""Finer rigid cells inside the joint grid, along whose faces blocks may crack.

Pieces of one joint face share its label; all other faces are inner.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_core.assembly import Assembly
from jld_core.build import build_assembly, build_robust, cases_of_scene
from jld_core.errors import InputError
from jld_core.refinement.refine import refine
from jld_core.refinement.transfer import face_of_piece
from jld_core.scene import Scene
from jld_core.scene.uncertain import Uncertain


@dataclass(frozen=True)
class CrackCells:
    """Assembly of finer cells, with the joint-grid face that each of its faces is part of."""

    # the cells, with M interfaces; the assembly of the joint grid itself where no element is larger than a cell
    fine: Assembly
    face: Ints  # (M,) face of the joint grid that each face of the cells is a piece of, −1 inside an element

    def labels(self, labels: Bits) -> Bits:
        return np.asarray(np.where(self.face >= 0, labels[..., np.maximum(self.face, 0)], False))


def crack_cells(scene: Scene, assembly: Assembly, cell: float) -> CrackCells:
    """Split the elements of a scene into cells along which blocks may crack.

    Raises InputError if `refine` does not accept the scene, or if two cells touch although their elements do not.

    Parameters
    ----------
    scene : Scene
        Scene.
    assembly : Assembly
        Its structure.
    cell : float
        Size of a cell, scene units.

    Returns
    -------
    CrackCells
        Finer assembly, and the joint face of each of its faces.
    """
    # moving loads are stated case by case, on elements of the joint grid
    placed = cases_of_scene(scene, assembly.elements) if scene.loads.moving else []
    if placed:
        stated = {"cases": [one.case for one in placed], "moving": None, "pushes": None}
        scene = scene.model_copy(update={"loads": scene.loads.model_copy(update=stated)})
    try:
        refined = refine(_at_means(scene), (cell,))
    except InputError as error:
        where = "cracks" if error.where.startswith("--cell") else error.where
        raise InputError(where, error.problem, error.expected) from None
    if len(refined.parent) == len(assembly.elements):
        return CrackCells(assembly, np.arange(len(assembly.interfaces)))
    plain = refined.scene.model_copy(update={"cracks": "faces"})
    fine = build_robust(plain) if assembly.has_low_values else build_assembly(plain)
    places = [one.place for one in placed] or [None] * len(fine.cases)
    cases = tuple(replace(one, place=place) for one, place in zip(fine.cases, places, strict=True))
    return CrackCells(replace(fine, cases=cases), joint_faces(assembly, fine, refined.parent))


def _at_means(scene: Scene) -> Scene:
    """Return a scene with mean capacities of members: pieces share a number, not a distribution."""
    means = [
        {key: float(value) for key, value in vars(member).items() if isinstance(value, Uncertain)}
        for member in scene.members
    ]
    members = [member.model_copy(update=one) for member, one in zip(scene.members, means, strict=True)]
    return scene.model_copy(update={"members": members}) if any(means) else scene


def cells_of(assembly: Assembly, cell: float) -> CrackCells:
    """Split elements into cells under the assembly's loads, with joint faces; InputError if changed since built."""
    if assembly.scene is None:
        raise InputError("cracks", "cells are cut from a scene, and this assembly has none", "the scene itself")
    whole = (build_robust if assembly.has_low_values else build_assembly)(assembly.scene)
    for place, one in ((None, whole), *enumerate(whole.by_case)):
        if len(one.cases) == len(assembly.cases) and _same(one, assembly):
            found = crack_cells(assembly.scene, assembly, cell)
            return found if place is None or found.fine is assembly else replace(found, fine=found.fine.by_case[place])
    raise InputError(
        "cracks",
        "cells are cut from a scene, and this assembly was changed since it was built of it",
        "a changed scene",
    )


def _same(one: Assembly, other: Assembly) -> bool:
    """Return True if two assemblies have the same elements, loads and strengths."""
    pairs = [(one.face_strengths.table(), other.face_strengths.table())]
    for a, b in ((one, other), *zip(one.by_case, other.by_case, strict=True)):
        pairs += [(a.dead, b.dead), (a.live, b.live)]
    alike = one.elements.ids == other.elements.ids
    return alike and all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def joint_faces(joints: Assembly, fine: Assembly, parent: dict[str, str]) -> Ints:
    """Map each face of the cells to its joint-grid face (M,), −1 inside; InputError where elements do not touch."""
    element = np.array([joints.elements.index[parent[name]] for name in fine.elements.ids])
    between: dict[tuple[int, int], list[int]] = {}
    for face, pair in enumerate(zip(joints.interfaces.a.tolist(), joints.interfaces.b.tolist(), strict=True)):
        between.setdefault((min(pair), max(pair)), []).append(face)
    found = np.full(len(fine.interfaces), -1, dtype=np.int64)
    for k, (a, b) in enumerate(zip(element[fine.interfaces.a], element[fine.interfaces.b], strict=True)):
        if a == b:
            continue
        candidates = between.get((int(min(a, b)), int(max(a, b))), [])
        if not candidates:
            ids = joints.elements.ids
            raise InputError(
                "cracks",
                f"cells of {ids[a]!r} and {ids[b]!r} touch, and these elements do not",
                "another size of cells",
            )
        found[k] = face_of_piece(joints.interfaces, candidates, fine.interfaces, k)
    return found
