"""Mixed-integer programs for the strongest segmentation of a planar scene without dry crushing.

Both choose blocks among the polyominoes x_p ∈ {0, 1}, Σ_{p ∋ i} x_p = 1. A face is inner where a chosen block
holds both its sides, y_f = Σ_{p ⊇ f} x_p, else dry.

**F**, face by face: F_f = D_f + I_f with D_f ∈ (1 − y_f) K_dry and I_f ∈ y_f K_inner, the convex hull of both sets.
**P**, block by block: each polyomino carries forces on its own faces, its own equilibrium and its share of λ, all
in x_p times their sets; the forces on a face agree on both sides. Larger, but its relaxation is much tighter.

Both need bounds on N that no admissible state of a labelling worth finding exceeds (`caps`). Source: METHOD §6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.assembly import Floats, Ints
from jld_core.program import Template
from jld_core.yield_sets import PlanarYield
from jld_explore.candidates import SearchSpace
from jld_explore.exact.milp import INF, Program
from jld_explore.exact.polyominoes import Polyominoes

_Q: Final = 3
_NONE: Final = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class Caps:
    """Upper bounds on N of each face (m,), scaled, as dry and as inner, and on λ; lower bound on λ."""

    dry: Floats
    inner: Floats
    least: float
    most: float


@dataclass(frozen=True)
class Formulation:
    """A program, and where to find in it: x (one column per polyomino), λ, rows of λ ≥ and of the two counts.

    normals: (dry, inner) columns of N of each face, −1 where it has none (formulation F only).
    """

    program: Program
    x: range
    load: int
    least_row: int
    dry_row: int
    blocks_row: int
    normals: tuple[Ints, Ints]


class Builder:
    """Builds either program for one space. template: of its assembly; blocks: its polyominoes."""

    def __init__(self, template: Template, space: SearchSpace, blocks: Polyominoes) -> None:
        sets = template.yield_set
        if not isinstance(sets, PlanarYield):
            raise TypeError("planar yield sets are needed")
        self.template, self.space, self.blocks, self.sets = template, space, blocks, sets
        faces, elements = template.assembly.interfaces, template.assembly.elements
        self.a, self.b = faces.a, faces.b
        self.count = len(faces)
        self.row_of = np.full(len(elements), -1, dtype=np.int64)
        self.row_of[elements.free] = np.arange(len(elements.free))
        self.matrix = template.matrix.toarray()
        self.around: dict[int, list[int]] = {int(e): [] for e in elements.free}
        for face in range(self.count):
            for e in (int(self.a[face]), int(self.b[face])):
                if e in self.around:
                    self.around[e].append(face)
        self.holds: list[list[int]] = [[] for _ in range(self.count)]
        for p, inside in enumerate(blocks.inside):
            for face in inside:
                self.holds[face].append(p)

    # --- what both share --------------------------------------------------------------------------------

    def _start(self, caps: Caps) -> tuple[Program, range, int, int, int, int]:
        program, blocks, space = Program(), self.blocks, self.space
        x = program.columns(len(blocks), 0.0, 1.0, whole=True)
        load = program.columns(1, -INF, caps.most)[0]
        program.cost[load] = 1.0
        of: dict[int, list[int]] = {e: [] for e in self.around}
        for p, members in enumerate(blocks.members):
            for e in members:
                of[e].append(x[p])
        for columns in of.values():
            program.row(columns, [1.0] * len(columns), 1.0, 1.0)
        least_row = program.row([load], [1.0], caps.least, INF)
        free = self.template.assembly.free_faces
        # dry faces: all of them but those inside blocks
        sizes = [float(sum(free[face] for face in inside)) for inside in blocks.inside]
        total = float(free.sum())
        low, high = space.search.dry_faces
        dry_row = program.row(
            list(x), sizes, -INF if high is None else total - high, INF if low is None else total - low
        )
        low, high = space.search.blocks
        blocks_row = program.row(list(x), [1.0] * len(x), -INF if low is None else low, INF if high is None else high)
        self._break_symmetry(program, x)
        return program, x, load, least_row, dry_row, blocks_row

    def _break_symmetry(self, program: Program, x: range) -> None:
        """Of the images of a segmentation, the one of largest weight for weights that differ."""
        place = {members: p for p, members in enumerate(self.blocks.members)}
        weights = np.random.default_rng(7).random(len(x))
        for to in self.space.symmetry.elements[1:]:
            images = [place[tuple(sorted(to[list(m)].tolist()))] for m in self.blocks.members]
            gain = np.zeros(len(x))
            np.add.at(gain, np.arange(len(x)), weights)
            np.add.at(gain, np.array(images), -weights)
            kept = np.flatnonzero(gain)
            if kept.size:
                program.row([x[p] for p in kept.tolist()], gain[kept].tolist(), 0.0, INF)

    def _dry(
        self, program: Program, face: int, forces: range, switch: list[tuple[int, float]], at: float, cap: float
    ) -> None:
        """Rows of a dry face in s·K_dry, s = at + Σ switch, N ≤ cap·s."""
        n, v, m = forces
        mu = float(self.sets.friction[face])
        for sign in (1.0, -1.0):
            program.row([m, n], [sign, -1.0], -INF, 0.0)
            program.row([v, n], [sign, -mu], -INF, 0.0)
        if cap < INF:
            columns, values = [n] + [c for c, _ in switch], [1.0] + [-cap * w for _, w in switch]
            program.row(columns, values, -INF, cap * at)

    def _inner(self, program: Program, face: int, forces: range, switch: list[tuple[int, float]], cap: float) -> None:
        """Rows of an inner face in s·K_inner, s = Σ switch, N ≤ cap·s."""
        n, v, m = forces
        sets = self.sets
        tension, shear, crush = (float(t[face]) for t in (sets.tension, sets.shear, sets.crush_inner))
        columns = [c for c, _ in switch]

        def bound(force: list[int], factor: list[float], strength: float) -> None:
            program.row(force + columns, factor + [-strength * w for _, w in switch], -INF, 0.0)

        for sign in (1.0, -1.0):
            bound([m, n], [sign, -1.0 / 3.0], tension / 3.0)
            bound([v], [sign], shear)
            if np.isfinite(crush):
                bound([m, n], [sign, 1.0 / 3.0], crush / 3.0)
        if cap < INF:
            bound([n], [1.0], cap)

    # --- formulation F ----------------------------------------------------------------------------------

    def faces(self, caps: Caps) -> Formulation:
        """Formulation F."""
        program, x, load, least_row, dry_row, blocks_row = self._start(caps)
        own: list[list[range]] = [[] for _ in range(self.count)]
        normals = (np.full(self.count, -1), np.full(self.count, -1))
        always = {face for face in range(self.count) if not self.space.candidates[face] and not self.space.fixed[face]}
        for face in range(self.count):
            inner = [(x[p], 1.0) for p in self.holds[face]]
            if face not in always:
                forces = program.columns(_Q, -INF, INF)
                self._dry(program, face, forces, [(c, -1.0) for c, _ in inner], 1.0, float(caps.dry[face]))
                own[face].append(forces)
                normals[0][face] = forces[0]
            if inner:
                forces = program.columns(_Q, -INF, INF)
                self._inner(program, face, forces, inner, float(caps.inner[face]))
                own[face].append(forces)
                normals[1][face] = forces[0]
        for e, around in self.around.items():
            for j in range(_Q):
                row = _Q * int(self.row_of[e]) + j
                columns, values = [load], [float(self.template.live[row])]
                for face in around:
                    for forces in own[face]:
                        for k in range(_Q):
                            columns.append(forces[k])
                            values.append(float(self.matrix[row, _Q * face + k]))
                dead = -float(self.template.dead[row])
                program.row(columns, values, dead, dead)
        return Formulation(program, x, load, least_row, dry_row, blocks_row, normals)

    # --- formulation P ----------------------------------------------------------------------------------

    def pieces(self, caps: Caps) -> Formulation:
        """Formulation P; needs finite caps."""
        program, x, load, least_row, dry_row, blocks_row = self._start(caps)
        share: dict[int, list[int]] = {e: [load] for e in self.around}
        sides: list[tuple[list[range], list[range]]] = [([], []) for _ in range(self.count)]
        for p, members in enumerate(self.blocks.members):
            own = program.columns(1, -INF, INF)[0]
            # λ of a block that is not chosen is 0, of one that is it is λ
            program.row([own, x[p]], [1.0, -caps.most], -INF, 0.0)
            program.row([own, x[p]], [1.0, -caps.least], 0.0, INF)
            inside = set(self.blocks.inside[p])
            forces: dict[int, range] = {}
            for e in members:
                share[e].append(own)
                for face in self.around[e]:
                    if face in forces:
                        continue
                    forces[face] = program.columns(_Q, -INF, INF)
                    switch = [(x[p], 1.0)]
                    if face in inside:
                        self._inner(program, face, forces[face], switch, float(caps.inner[face]))
                    else:
                        self._dry(program, face, forces[face], switch, 0.0, float(caps.dry[face]))
                        sides[face][0 if int(self.a[face]) == e else 1].append(forces[face])
            for e in members:
                for j in range(_Q):
                    row = _Q * int(self.row_of[e]) + j
                    columns = [own, x[p]]
                    values = [float(self.template.live[row]), float(self.template.dead[row])]
                    for face in self.around[e]:
                        columns += list(forces[face])
                        values += self.matrix[row, _Q * face : _Q * face + _Q].tolist()
                    program.row(columns, values, 0.0, 0.0)
        for columns in share.values():
            program.row(columns, [-1.0] + [1.0] * (len(columns) - 1), 0.0, 0.0)
        for one, other in sides:
            if one and other:
                for k in range(_Q):
                    columns = [forces[k] for forces in one] + [forces[k] for forces in other]
                    program.row(columns, [1.0] * len(one) + [-1.0] * len(other), 0.0, 0.0)
        return Formulation(program, x, load, least_row, dry_row, blocks_row, (_NONE, _NONE))
