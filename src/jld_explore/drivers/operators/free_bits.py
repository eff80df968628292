"""Operators on single labels, for searches that allow slits: flip, crossover, repair."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_explore.drivers.operators.atom_graph import BufferedRandom, Parts, atom_graph, limits_of
from jld_explore.drivers.operators.cutting import Cutter, Repair
from jld_explore.space import feasible
from jld_explore.space.labelling import blocks_of
from jld_explore.space.search_space import SearchSpace


class FreeBits:
    """Operators on the labellings of a search space that allows slits."""

    offspring_factor = 2
    always_feasible = False

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.graph = atom_graph(space)
        self.limits = limits_of(space, self.graph)
        # Slits can supply dry faces that are missing between blocks, as far as each block stays connected.
        on_faces = [(terms.faces, bounds) for terms, bounds in space.limits.on_terms if terms.faces is not None]
        may_be_dry = space.candidates | space.fixed
        spare = [bounds.least - int((faces & may_be_dry).sum()) + len(self.graph) for faces, bounds in on_faces]
        fewest, greatest = self.limits.parts
        seams = tuple((seams, -inf, most) for seams, _, most in self.limits.seams)
        on_blocks = replace(self.limits, seams=seams, parts=(max(fewest, *spare, -inf), greatest))
        self._repair = Repair(self.graph, on_blocks, Cutter(self.graph, on_blocks))
        self._faces = np.flatnonzero(space.candidates).tolist()
        self._ends = list(zip(self.graph.face_a.tolist(), self.graph.face_b.tolist(), strict=True))
        self._counted = [(faces.tolist(), bounds) for faces, bounds in on_faces]
        self.keys = len(self._faces)

    def draw(self, count: int, rng: BufferedRandom) -> Bits:
        # each labelling has its own share of dry faces
        rows = np.repeat(self.space.fixed[None], count, axis=0)
        for row in rows:
            share = rng.real()
            row[self._faces] = [key < share for key in rng.reals(self.keys)]
        return self._repaired(rows, rng)

    def vary(self, parents: Bits, rng: BufferedRandom) -> Bits:
        rows = parents.copy()
        for row in rows:
            face = rng.pick(self._faces)
            row[face] = not row[face]
            while rng.real() < 0.35:
                face = rng.pick(self._faces)
                row[face] = not row[face]
        return self._repaired(rows, rng)

    def cross(self, first: Bits, second: Bits, rng: BufferedRandom) -> Bits:
        rows = first.copy()
        for row, other in zip(rows, second, strict=True):
            take = [face for face in self._faces if rng.real() < 0.5]
            row[take] = other[take]
        return self._repaired(rows, rng)

    def cross_indexed(self, first: Bits, second: Bits, rng: BufferedRandom) -> tuple[Bits, Ints]:
        rows = [self.cross(one[None], other[None], rng) for one, other in zip(first, second, strict=True)]
        return np.concatenate([first[:0], *rows]), np.repeat(np.arange(len(rows)), [len(row) for row in rows])

    def read(self, keys: Floats) -> tuple[Bits, Ints]:
        rows = np.repeat(self.space.fixed[None], len(keys), axis=0)
        rows[:, self._faces] = keys > 0.5
        seeds = [np.random.default_rng(np.frombuffer(one.tobytes(), dtype=np.uint32)) for one in keys]
        found = [self._repaired(row[None], BufferedRandom(seed)) for row, seed in zip(rows, seeds, strict=True)]
        return np.concatenate([rows[:0], *found]), np.repeat(np.arange(len(found)), [len(one) for one in found])

    def write(self, labellings: Bits) -> Floats:
        return np.where(labellings[:, self._faces], 0.75, 0.25)

    def breed(self, first: Bits, second: Bits, single: Bits, rng: BufferedRandom) -> Bits:
        return np.concatenate([self.cross(first, second, rng), self.vary(single, rng)])

    def _repaired(self, rows: Bits, rng: BufferedRandom) -> Bits:
        good = feasible(self.space, rows)
        if good.all():
            return rows
        parts: list[Parts] = blocks_of(self.space.graph, rows)[:, self.graph.first].tolist()
        kept = [
            row if fine else self._repair_part(row, part, rng)
            for row, part, fine in zip(rows, parts, good.tolist(), strict=True)
        ]
        found = [row for row in kept if row is not None]
        mended = np.array(found, dtype=bool).reshape(len(found), rows.shape[1])
        return mended[feasible(self.space, mended)]

    def _repair_part(self, row: Bits, part: Parts, rng: BufferedRandom) -> Bits | None:
        # limits refer to blocks, which inner faces determine: blocks are changed first, labels inside keep their values
        # as far as each block stays connected
        new = self._repair(part, rng)
        if new is None:
            return None
        root = list(range(len(self.graph)))

        def find(a: int) -> int:
            while root[a] != a:
                root[a] = a = root[root[a]]
            return a

        out = row.copy()
        inside: list[int] = []
        bridges: set[int] = set()
        for face in self._faces:
            a, b = self._ends[face]
            out[face] = out[face] or new[a] != new[b]
            if new[a] == new[b]:
                inside.append(face)
        # Fixed inner faces lie inside atoms. Inner faces of the row come first, then faces needed to connect each
        # block.
        for face in sorted(rng.shuffled(inside), key=lambda f: bool(row[f])):
            p, q = (find(a) for a in self._ends[face])
            if p != q:
                root[p] = q
                bridges.add(face)
                out[face] = False
        order = rng.shuffled(inside)
        for counted, bounds in self._counted:
            dry = sum(1 for face, counts in enumerate(counted) if counts and out[face])
            for face in [face for face in order if counted[face] and face not in bridges]:
                if dry > bounds.most and out[face]:
                    out[face], dry = False, dry - 1
                elif dry < bounds.least and not out[face]:
                    out[face], dry = True, dry + 1
        return out
