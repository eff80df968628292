"""What a relaxation by whole sections bounds, and where it stops: the beam on two bearings in finer and finer cells.

A window is a column of cells, as deep as the beam, with all faces inside it and on both sides. Every labelling of it
has a share y ≥ 0, its own λ y and its own forces, in equilibrium on the window's cells; neighbouring windows agree on
share, λ and forces for every pattern of labels of the section between them. All that is relaxed is then that labellings
on either side of a section with one pattern are mixed. Besides, what is left of a window and what is right of it may
have to be in equilibrium as rigid bodies, for every labelling by itself, and the outermost two columns at either end
may be one window.

A measurement of what such a bound would be worth, by the solver's word: nothing of the project relies on it.
"""

from __future__ import annotations

import itertools
import json
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import scipy.sparse as sp

from benchmarks.common import ROOT, table, write
from jld_core import Scene, build_assembly, parse_scene
from jld_core.arrays import Bits, Floats, Ints
from jld_core.limit import LimitAnalysis
from jld_core.limit.relaxation import Relaxation
from jld_core.program import pack
from jld_core.solvers import ClarabelSolver, RawStatus
from jld_explore import ExploreSettings, explore
from jld_explore.space import search_space

BEAMS: Final = ((5, 3), (7, 3), (8, 3), (10, 2))
"""Cells along and up."""

MOST: Final = 130.0
"""λ above any bound here."""

NEAR: Final = 1.03
"""Ratio between the λ that is refuted and one that is not, or that was found."""

SECONDS: Final = 10.0
"""Of annealing, for the best λ known."""

SOME: Final = {
    "section": ("iiDDii", "iDDDDi", "iiiiii", "DDDDii", "iiDDDD", "DDDDDD", "DDiiDD"),
    "column": ("iiiii", "DDDDD", "iiDDD", "DDDii", "DiDiD", "iDiDi", "iDDDi", "DiiiD"),
}
"""Labels of faces top down, D dry, i inner, of the labellings that the beam of 10 × 6 cells is relaxed with."""

HALVED: Final = (35.0, 36.0)
"""λ that it is asked for."""


def beam(across: int, up: int) -> Scene:
    """The beam on two bearings in so many cells, in blocks of any size."""
    document = json.loads((ROOT / "scenes" / "flat_beam_arch.json").read_text(encoding="utf-8"))
    wide, high = 0.5 / across, 0.3 / up
    held = round(0.1 / wide)
    rows = ["a" * across] * up + ["#" * held + "." * (across - 2 * held) + "#" * held]
    document["grid"] |= {"cell": [wide, high], "rows": rows}
    loaded = f"c{int((0.25 - 1e-9) / wide)}r0"
    # the row of the bearings is one cell high
    loads = [load | {"element": loaded, "at": [load["at"][0], 0.3 + high]} for load in document["loads"]["live"]]
    document["loads"]["live"] = loads
    document["search"]["block_cells"] = [1, across * up]
    return parse_scene(document)


@dataclass(frozen=True)
class Window:
    """balance: equations × columns of one labelling: y, λ y, then three resultants of each face. faces: (f,).
    labels: (c, f) labellings, True dry. first: (c,) column that each begins at."""

    balance: sp.coo_array
    faces: Ints
    labels: Bits
    first: Ints


class Rows:
    """Rows of a program, gathered in groups of entries."""

    def __init__(self) -> None:
        self._entries: list[tuple[Ints, Ints, Floats]] = []
        self.count = 0

    def add(self, row: Ints, column: Ints, value: Floats | float, rows: int = 0) -> None:
        """Entries of any one shape; row: from the next free one on, of which `rows` are taken."""
        row, column, value = np.broadcast_arrays(row + self.count, column, np.asarray(value, dtype=float))
        self._entries.append((row.ravel(), column.ravel(), value.ravel()))
        self.count += rows

    def matrix(self, columns: int) -> sp.coo_array:
        """All of them."""
        row, column, value = (np.concatenate(parts) for parts in zip(*self._entries, strict=True))
        return sp.coo_array((value, (row, column)), shape=(self.count, columns))


class Sections:
    """The relaxation of one beam. groups: columns of cells of each window, left to right. rigid: whether the rest of
    the beam is in equilibrium too. some: labels that sections and columns may have, as in `SOME`, default all."""

    def __init__(
        self,
        scene: Scene,
        across: int,
        groups: Sequence[Sequence[int]],
        *,
        rigid: bool = False,
        some: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        assembly = build_assembly(scene)
        self.across, self.rigid, self.some = across, rigid, some
        self.space, self.template = search_space(scene, assembly), LimitAnalysis(assembly).template
        self.cells = len(assembly.elements.free)  # they come first, row by row from the top
        self.a, self.b = assembly.interfaces.a, assembly.interfaces.b
        self.upright, self.bearing = (self.b == self.a + 1) & (self.b < self.cells), self.b >= self.cells
        self.groups, self.windows, self.columns = groups, list[Window](), 0
        for group in groups:
            self._add_window(group[0], group[-1])
        self.labellings = sum(len(window.labels) for window in self.windows)

    def _add_window(self, left: int, right: int) -> None:
        """The window of columns from left to right."""
        column = np.arange(self.cells) % self.across
        inside = (column >= left) & (column <= right)
        cells, rest = np.flatnonzero(inside), [np.flatnonzero(column < left), np.flatnonzero(column > right)]
        touched = np.isin(self.a, cells) | np.isin(self.b, cells)
        labels = self._labels(np.flatnonzero(touched), left, right)
        faces = np.flatnonzero(touched | (self.bearing & self.rigid))
        whole = np.tile(self.space.fixed[faces], (len(labels), 1))
        whole[:, touched[faces]] = labels
        wanted = (3 * cells[:, None] + np.arange(3)).ravel()
        moves = [sp.eye_array(3 * self.cells, format="csr")[wanted]]
        moves += [self._rigid(body) for body in rest if self.rigid and body.size]
        loads = np.column_stack([self.template.dead, self.template.live])
        forces = sp.csc_array(self.template.matrix)[:, (3 * faces[:, None] + np.arange(3)).ravel()]
        balance = sp.coo_array(sp.vstack(moves) @ sp.hstack([sp.csr_array(loads), forces]))
        size = balance.shape[1]
        self.windows.append(Window(balance, faces, whole, self.columns + size * np.arange(len(whole))))
        self.columns += size * len(whole)

    def _rigid(self, body: Ints) -> sp.csr_array:
        """(3, 3·cells) velocities of cells, all of a body and nothing else, in its three rigid motions."""
        scaling, elements = self.template.scaling, self.template.assembly.elements
        row, (x, y) = scaling.row[body] / scaling.force, elements.centroid[body].T
        still, one = np.zeros(len(body)), np.ones(len(body))
        motions = np.array([[one, still, still], [still, one, still], [-y, x, one]])
        values = motions * row.T
        place = np.broadcast_to(3 * body + np.arange(3)[:, None], values.shape)
        motion = np.broadcast_to(np.arange(3)[:, None, None], values.shape)
        entries = values.ravel(), (motion.ravel(), place.ravel())
        return sp.csr_array(entries, shape=(3, 3 * self.cells))

    def _labels(self, faces: Ints, left: int, right: int) -> Bits:
        """(c, f) labellings of a window's faces, without those with one dry face alone around a vertex inside."""
        free = self.space.candidates[faces]
        count = int(free.sum())
        labels = np.tile(self.space.fixed[faces], (2**count, 1))
        labels[:, free] = np.array(list(itertools.product((False, True), repeat=count)))
        place = {(int(self.a[f]), bool(self.upright[f])): k for k, f in enumerate(faces) if not self.bearing[f]}
        for cell in range(self.cells - self.across):
            if left <= cell % self.across < right:
                around = (cell, True), (cell, False), (cell + self.across, True), (cell + 1, False)
                labels = labels[labels[:, [place[face] for face in around]].sum(axis=1) != 1]
        if self.some is not None:
            before, upright = self.a[faces] % self.across < left, self.upright[faces]
            for part, kind in (
                (upright & before, "section"),
                (upright & ~before, "section"),
                (~upright & free, "column"),
            ):
                if part.any():
                    allowed = [[letter == "D" for letter in text][: int(part.sum())] for text in self.some[kind]]
                    labels = labels[(labels[:, None, part] == np.array(allowed)).all(axis=2).any(axis=1)]
        return labels

    def highest(self, least: float, most: float) -> float | None:
        """The largest λ where that of every labelling is in a range; None where the solver says that there is none."""
        equations, others = Rows(), Rows()
        head, scale = self.windows[0], self.template.scaling.load
        equations.add(np.zeros(len(head.first), dtype=int), head.first, 1.0, 1)
        for window in self.windows:
            rows, count = window.balance.shape[0], len(window.labels)
            row, column = (np.asarray(part, dtype=int) for part in window.balance.coords)
            each = np.arange(count)[:, None]
            equations.add(rows * each + row, window.first[:, None] + column, window.balance.data, rows * count)
            self._sets(others, window)
            for sign, end in ((1.0, most / scale), (-1.0, least / scale)):
                others.add(each[:, 0], window.first + 1, sign)
                others.add(each[:, 0], window.first, -sign * end, count)
            others.add(each[:, 0], window.first, -1.0, count)
        for number, group in enumerate(self.groups[:-1]):
            self._agree(equations, number, np.flatnonzero(self.upright & (self.a % self.across == group[-1])))
        objective = np.zeros(self.columns)
        objective[head.first + 1] = -1.0
        right = np.zeros(equations.count + others.count)
        right[0] = 1.0
        matrix = sp.vstack([equations.matrix(self.columns), others.matrix(self.columns)])
        raw = ClarabelSolver(1e-6).solve(pack(matrix, right, objective, equations.count, others.count, ()))
        if raw.status is RawStatus.INFEASIBLE:
            return None
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            raise ArithmeticError(f"the solver says {raw.status}")
        return float(raw.point[head.first + 1].sum()) * scale

    def _sets(self, others: Rows, window: Window) -> None:
        """Bending and friction of every face in y times its set."""
        sets, faces = self.template.yield_set, window.faces
        dry, inner = sets.wedge(True), sets.wedge(False)
        assert dry is not None
        assert inner is not None
        count, force = window.labels.size, window.first[:, None] + 2 + 3 * np.arange(len(faces))
        y, row = window.first[:, None], np.arange(count).reshape(window.labels.shape)
        bending, tension, friction, cohesion = (
            np.where(window.labels, *(np.broadcast_to(getattr(one, name), self.a.shape)[faces] for one in (dry, inner)))
            for name in ("bending", "tension", "friction", "cohesion")
        )
        for way in (1.0, -1.0):
            for place, turn, leans, strength in ((2, bending, 1.0, tension), (1, 1.0, friction, cohesion)):
                size = np.maximum(1.0, strength)
                others.add(row, force + place, way * turn / size)
                others.add(row, force, -leans / size)
                others.add(row, y, -strength / size, count)

    def _agree(self, equations: Rows, number: int, shared: Ints) -> None:
        """Windows `number` and the next agree on shared faces, for every pattern of labels of these."""
        pair = self.windows[number : number + 2]
        codes = [one.labels[:, np.isin(one.faces, shared)] @ (1 << np.arange(len(shared))) for one in pair]
        known = np.unique(np.concatenate(codes))
        rows = 2 + 3 * len(shared)
        for sign, window, code in zip((1.0, -1.0), pair, codes, strict=True):
            begin = 2 + 3 * np.searchsorted(window.faces, shared)
            taken = np.concatenate([[0, 1], (begin[:, None] + np.arange(3)).ravel()])
            row = rows * np.searchsorted(known, code)[:, None] + np.arange(rows)
            equations.add(row, window.first[:, None] + taken, sign)
        equations.count += rows * len(known)

    def bound(self, best: float) -> float:
        """λ that it does not reach, to `NEAR`. best: λ of a labelling."""
        high = self.highest(0.0, MOST)
        assert high is not None
        low = best
        while high > NEAR * low:
            middle = math.sqrt(low * high)
            found = self.highest(middle, high)
            low, high = (low, middle) if found is None else (middle, min(high, found))
        return high


def annealed(scene: Scene) -> float:
    """λ that annealing finds."""
    settings = ExploreSettings(jobs=1, pictures=False, driver="anneal", seconds=SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        return float(explore(scene, Path(folder) / "out", settings).summary.facts["best"])


def beams() -> list[list[str]]:
    """Rows of the table."""
    rows = []
    for across, up in BEAMS:
        scene = beam(across, up)
        assembly = build_assembly(scene)
        space, analysis = search_space(scene, assembly), LimitAnalysis(assembly)
        best = annealed(scene)
        faces = Relaxation(analysis).bound(space.fixed, space.candidates) * analysis.template.scaling.load
        single, pairs = [[j] for j in range(across)], [[0, 1], [across - 2, across - 1]]
        pairs[1:1] = single[2:-2]
        row = [f"{across} × {up}", f"{best:.2f}", f"{faces:.2f}"]
        for groups, rigid in ((single, False), (single, True), (pairs, True)):
            begin = time.process_time()
            relaxation = Sections(scene, across, groups, rigid=rigid)
            bound = relaxation.bound(best)
            row.append(f"{bound:.2f} ({relaxation.labellings}, {time.process_time() - begin:.0f} s)")
        rows.append(row)
        print(row, flush=True)
    return rows


def main() -> None:
    """Measure beams, then what the halved flagship's relaxation reaches with a few of its labellings."""
    head = ["cells", "best λ found", "face by face", "sections", "rest rigid", "and ends in pairs"]
    begin = time.process_time()
    relaxation = Sections(beam(10, 6), 10, [[j] for j in range(10)], rigid=True, some=SOME)
    reached, every = relaxation.highest(*HALVED), 2 * 2**11 + 8 * 2**17
    said = "none is reached" if reached is None else f"{reached:.4g} is reached, so that all of them bound no less"
    words = (
        "The flagship's beam in cells of other sizes, in blocks of any number of them: what no labelling exceeds by "
        "the solver's word, with labellings of windows and seconds of one processor. Bearings are 0.1 m wide: one cell "
        "of 5 and 7 along, two of 8 and 10."
    )
    halved = (
        f"In 10 × 6 cells windows have {every} labellings. With {relaxation.labellings} of them alone, the rest of the "
        f"beam rigid and every λ between {HALVED[0]:g} and {HALVED[1]:g}, {said} "
        f"({time.process_time() - begin:.0f} s)."
    )
    write("sections", "\n\n".join(["# Relaxed by sections", words, table(head, beams()), halved]))


if __name__ == "__main__":
    main()
