"""Derive clauses for the labellings of a scene by graph traversal, independently of the search."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.assembly import Assembly
from jld_core.build.elements import faces_of_pairs
from jld_core.errors import InputError
from jld_core.scene import Scene
from jld_explore.verification.certificate import at_least

Clause = list[int]

# Keys under "search" from which rules follow
_STATED: Final = {
    "candidates",
    "keep",
    "segmentation",
    "block_cells",
    "block_weight",
    "block_extent",
    "block_mass",
    "dry_faces",
}

# Keys under "search" that never add labellings; a proof without them holds with them as well
_NARROWER: Final = {
    "block_aspect",
    "convex_blocks",
    "blocks",
    "shapes",
    "moulds",
    "require",
    "assemble",
    "assemble_out_of_plane",
    "sawn_length",
    "saw_cuts",
    "saw_set_ups",
}

_IDLE: Final = {"symmetry", "front"}  # keys under "search" that do not affect which labellings are admissible


class Labellings:
    """Labellings of a scene as fixed labels and clauses."""

    def __init__(self, scene: Scene, assembly: Assembly) -> None:
        # literals: face + 1 states that a face is inner, −(face + 1) that it is dry; limits that clauses cannot express
        # are ignored, so that the proof covers more labellings
        self.assembly, self.search = assembly, scene.search
        for name, field in type(scene.search).model_fields.items():
            # A key that admits more labellings, or an unknown new key, would make rules wrong.
            strange = name not in _STATED | _NARROWER | _IDLE
            if strange and getattr(scene.search, name) != field.get_default(call_default_factory=True):
                key = f"search.{field.alias or name}"
                raise InputError(key, "certificates do not support this key", "a search without it")
        faces, elements = assembly.interfaces, assembly.elements
        self._ends = list(zip(faces.a.tolist(), faces.b.tolist(), strict=True))
        self.fixed = self._fixed()
        self._around: dict[int, list[int]] = {e: [] for e in range(len(elements))}
        for face, pair in enumerate(self._ends[: assembly.faces]):  # members bound no block
            for element in pair:
                self._around[element].append(face)
        self._support = elements.support.tolist()
        self._touching: dict[int, list[int]] = {e: [] for e in range(len(elements))}
        for a, b in assembly.touching:
            self._touching[a].append(b)
            self._touching[b].append(a)
        self.beginning: list[Clause] = [[-(face + 1)] if dry else [face + 1] for face, dry in self.fixed.items()]
        low, high = self.search.dry_faces
        members = assembly.of_members.tolist()
        counted = [
            face
            for face, (a, b) in enumerate(self._ends)
            if not (self._support[a] or self._support[b] or members[face])
        ]
        top = len(self._ends)
        for bound, literals in ((low, [-(f + 1) for f in counted]), (high, [f + 1 for f in counted])):
            least = bound if literals and literals[0] < 0 else None if bound is None else len(counted) - bound
            if least is not None and least > 0:
                clauses, top = at_least(literals, int(least), top)
                self.beginning += clauses

    def _fixed(self) -> dict[int, bool]:
        """Return the labels that are fixed: of faces that are no candidates or are kept."""
        assembly, search = self.assembly, self.search
        elements, faces = assembly.elements, assembly.interfaces
        dry = faces_of_pairs(search.keep.dry, elements, faces, "search.keep.dry")
        inner = faces_of_pairs(search.keep.inner, elements, faces, "search.keep.inner")
        named = None
        if isinstance(search.candidates, list):
            named = faces_of_pairs(search.candidates, elements, faces, "search.candidates")
        found: dict[int, bool] = {}
        members = assembly.of_members.tolist()
        for face, (a, b) in enumerate(self._ends):
            inside = not (elements.support[a] or elements.support[b])
            if members[face]:
                free = False
            elif named is not None:
                free = bool(named[face])
            elif search.candidates == "all+supports":
                free = True
            elif search.candidates == "all":
                free = inside
            else:
                same = elements.blocks[a] is not None and elements.blocks[a] == elements.blocks[b]
                free = inside and same
            if dry[face] or inner[face]:
                found[face] = bool(dry[face])
            elif not free:
                found[face] = bool(assembly.labels[face])
        return found

    # --- clauses that a certificate gives ---------------------------------------------------------------

    def slit(self, face: int, through: Sequence[int]) -> Clause | None:
        """Return the clause that forbids a slit: a dry face whose sides inner faces join; None if unfounded."""
        if not self.search.segmentation or face in through or not self._are_faces([face, *through]):
            return None
        a, b = self._ends[face]
        return [face + 1, *(-(f + 1) for f in through)] if b in self._joined(a, through) else None

    def too_large(self, joined: Sequence[int]) -> Clause | None:
        """Return the clause that not all given faces, whose block is too large, are inner, or None."""
        # The inner faces must join a block that exceeds a limit.
        if not joined or not self._are_faces(joined):
            return None
        start = self._ends[joined[0]][0]
        members = self._joined(start, joined)
        if any(a not in members for face in joined for a in self._ends[face]):
            return None
        for size, (_, high), slack in self._sizes(members):
            if high is not None and size > high * (1.0 + slack):
                return [-(face + 1) for face in joined]
        return None

    def too_small(self, within: Sequence[int]) -> Clause | None:
        """Return the clause that not all faces around given elements are dry, or None."""
        members = set(within)
        known = all(0 <= e < len(self._support) for e in members) and not all(self._support[e] for e in members)
        # Supports that touch belong to one block without a face between them.
        if not known or any(other not in members for e in members for other in self._touching[e]):
            return None
        border = {f for e in members for f in self._around[e] if len(members.intersection(self._ends[f])) == 1}
        for size, (low, _), slack in self._sizes(members):
            if low is not None and size < low * (1.0 - slack):
                return [face + 1 for face in sorted(border)]
        return None

    def _are_faces(self, faces: Iterable[int]) -> bool:
        """Return whether all numbers are faces of the assembly, not interfaces of members."""
        return all(0 <= face < self.assembly.faces for face in faces)

    def _joined(self, start: int, faces: Sequence[int]) -> set[int]:
        """Return the elements reachable from one across given faces and between touching supports."""
        reached, waiting = {start}, [start]
        while waiting:
            at = waiting.pop()
            across = (b if a == at else a for a, b in (self._ends[face] for face in faces) if at in (a, b))
            for other in (*across, *self._touching[at]):
                if other not in reached:
                    reached.add(other)
                    waiting.append(other)
        return reached

    def _sizes(self, members: Iterable[int]) -> list[tuple[float, Sequence[float | None], float]]:
        """Return size, limits and relative rounding of a set of elements for each measure."""
        # Only free elements contribute to the size.
        elements, search = self.assembly.elements, self.search
        free = sorted(e for e in members if not self._support[e])
        weights = [math.sqrt(math.fsum(w * w for w in elements.weight[e].tolist())) for e in free]
        extent = 0.0
        if free:
            corners = np.concatenate([elements.shape[e] for e in free])
            extent = float((corners.max(axis=0) - corners.min(axis=0)).max())
        weight = math.fsum(weights)
        mass = weight / elements.gravity if elements.gravity else 0.0
        slack = tolerances.DECIMALS
        return [
            (float(len(free)), search.block_cells, 0.0),
            (weight, search.block_weight, slack),
            (mass, search.block_mass, slack),
            (extent, search.block_extent, slack),
        ]
