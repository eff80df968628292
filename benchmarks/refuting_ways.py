"""Ways of refuting that were tried and lost, hooked onto the hunt from outside: for `python -m benchmarks.refuting`.

- Translates: a conflict moved by a cell to either side is tried, and shrunk on where it refutes too.
- Implied faces: what unit propagation derives from the other faces of a conflict is left out of it; or kept decided
  while single faces are tried, and left out in the end.
- Reachability: all cracks at once around which the uncracked part moves with one rigid motion. With a flow ψ on faces
  whose divergence is the power of each element, the excess of the part above a crack is the sum of ψ − D along it
  (docs/method.md (6.4)), so that "no such crack" says of no vertex at what sum it is reached. It rules out what
  the motion refutes: it is opened until its jumps are admissible, every element's live work has to be ≥ 0, and sums are
  rounded down.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any, Final

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import lsqr

from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit.relaxation import MinimizedConflict, Relaxation
from jld_explore.drivers.exact.conflict_generation import ConflictBatch, ConflictGenerator
from jld_explore.drivers.exact.conflict_minimization import Conflict, conflict_of
from jld_explore.drivers.exact.formula import Formula

_LEVELS: Final = 24
"""Sums that are told apart at a vertex, at the most."""

_ONE: Final = 1e-4
"""How far velocities of elements may differ, relative, and still be one rigid motion."""

_OPENED: Final = 1e-6
"""How far a motion is opened at the most, relative."""

_SURE: Final = 1e-7
"""Excess, relative to all powers, below which nothing is refuted: a hundred times what sums round."""


class Translating(ConflictGenerator):
    """Tries every conflict a cell to either side too."""

    def __init__(self, relaxation: Relaxation, free: Bools, seed: int) -> None:
        super().__init__(relaxation, free, seed)
        self.tried, self.held = 0, 0
        faces = relaxation.template.assembly.interfaces
        step = float(np.median(faces.l1))
        place = {tuple(np.round(at / step, 3) + 0.0): f for f, at in enumerate(faces.origin)}
        moved = [
            [place.get(tuple(np.round(at / step + np.array([by, 0.0]), 3) + 0.0), -1) for at in faces.origin]
            for by in (-1, 1)
        ]
        self._moved = np.array(moved)

    def _take(self, conflict: Conflict, caught: ConflictBatch) -> None:
        before = len(caught.conflicts)
        super()._take(conflict, caught)
        if len(caught.conflicts) == before:
            return
        assert self._formula is not None
        for moved in self._moved:
            faces = moved[conflict.faces]
            if (faces < 0).any() or not self._free[faces].all():
                continue
            labels = self._formula.space.fixed.copy()
            labels[faces] = conflict.labels
            decided = np.zeros(len(self._free), dtype=bool)
            decided[faces] = True
            self.tried += 1
            found = shrunk_on(self._relaxation, labels, decided, self._free, conflict.bound)
            if found is not None:
                self.held += 1
                super()._take(found, caught)


def shrunk_on(relaxation: Any, labels: Bits, decided: Bools, free: Bools, threshold: float) -> Conflict | None:
    """A conflict on no other faces than those decided, shrunk on; None where nothing refutes them."""
    # to the eyes of the shrinking only they may take either label; all others do
    part = _Part(relaxation, free & ~decided)
    return conflict_of(part, labels, decided, threshold)  # type: ignore[arg-type]


class _Part:
    """A relaxation some of whose faces are undecided whatever is asked."""

    def __init__(self, relaxation: Any, always: Bools) -> None:
        self._relaxation, self._always = relaxation, always

    def refute_all(self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools) -> Any:
        return self._relaxation.refute_all(labellings, undecided | self._always, thresholds, np.zeros_like(thorough))


class Implying(ConflictGenerator):
    """Leaves out of a conflict what follows from the rest. kept: while single faces are tried it stays decided."""

    def __init__(self, relaxation: Relaxation, free: Bools, seed: int, *, kept: bool = False) -> None:
        super().__init__(relaxation, free, seed)
        self._kept = kept

    def _take(self, conflict: Conflict, caught: ConflictBatch) -> None:
        assert self._formula is not None
        faces, labels = list(conflict.faces), dict(zip(conflict.faces.tolist(), conflict.labels.tolist(), strict=True))
        for face in list(faces):
            others = [f for f in faces if f != face]
            known = self._known_from(others, labels)
            if known is None or known.get(face) == labels[face]:
                faces = others
            elif self._kept:
                whole = self._formula.space.fixed.copy()
                decided = np.zeros(len(self._free), dtype=bool)
                for f, dry in known.items():
                    whole[f], decided[f] = dry, True
                decided &= self._free
                if self._relaxation.refute_all(
                    whole[None], (self._free & ~decided)[None], np.array([conflict.bound]), np.array([False])
                )[0]:
                    faces = others
        kept = np.array(sorted(faces), dtype=np.int64)
        super()._take(Conflict(kept, np.array([labels[f] for f in kept.tolist()], dtype=bool), conflict.bound), caught)

    def _known_from(self, faces: list[int], labels: dict[int, bool]) -> dict[int, bool] | None:
        """Labels that unit propagation derives from some, with these; None where they contradict each other."""
        formula = self._formula
        assert formula is not None
        wanted = formula._literals(faces, [labels[f] for f in faces])
        # what was set aside was drawn, and is not refuted yet
        possible, found = formula._solver.propagate(assumptions=formula._assumption_literals.assumed + wanted)
        if not possible:
            return None
        face_of = formula._candidates
        return {int(face_of[abs(v) - 1]): v < 0 for v in [*found, *wanted] if abs(v) <= len(face_of)}


class Reaching(ConflictGenerator):
    """Rules out all cracks of a rigid motion at once, wherever one motion refutes what was drawn."""

    def __init__(self, relaxation: Relaxation, free: Bools, seed: int) -> None:
        super().__init__(relaxation, free, seed)
        self._cracks = Cracks(relaxation)
        self._motions: set[tuple[int, ...]] = set()
        self.motions, self.asked = 0, 0

    def _sort(self, drawn: Bits, threshold: float, fallen: list[MinimizedConflict], caught: ConflictBatch) -> None:
        super()._sort(drawn, threshold, fallen, caught)
        assert self._formula is not None
        told = [one for one in fallen if one.bound is not None and one.drawn]
        if not told:
            return
        assert isinstance(self._relaxation, Relaxation)
        lanes = self._relaxation._batch
        assert lanes is not None
        rows = np.array([drawn[one.labelling] for one in told])
        undecided = np.array([self._free & ~one.decided for one in told])
        asked = np.full(len(told), threshold)
        velocities = lanes.solve(rows, undecided=undecided, thresholds=asked, vectors=True).velocity
        assert velocities is not None
        for velocity in velocities:
            self.asked += 1
            for motion in self._cracks.motions(velocity):
                name = tuple(np.round(1e3 * motion).astype(int).tolist())
                if name in self._motions:
                    continue
                self._motions.add(name)
                self.motions += self._cracks.rule_out(self._formula, motion, threshold)


class Cracks:
    """Cracks of a planar structure that stands on supports below and is pushed to the right."""

    def __init__(self, relaxation: Relaxation) -> None:
        self._relaxation = relaxation
        template = relaxation.template
        assembly = self._assembly = template.assembly
        faces, elements = assembly.interfaces, assembly.elements
        free = elements.free
        self._row = np.full(len(elements), -1)
        self._row[free] = np.arange(len(free))
        self._centre = elements.centroid[free]
        self._origin = self._centre.mean(axis=0)
        away = (self._centre - self._origin) / assembly.size
        # velocities of elements by one motion: two shifts, and a turn about the middle
        basis = np.zeros((len(free), 3, 3))
        basis[:, 0, 0] = basis[:, 1, 1] = 1.0
        basis[:, :, 2] = np.column_stack([-away[:, 1], away[:, 0], np.full(len(free), 1.0 / assembly.size)])
        self._basis = basis * template.scaling.row.reshape(len(free), 3)[:, :, None]
        dense = template.matrix.toarray().reshape(len(free), 3, len(faces), 3)
        # jumps of a face by the motion of one side alone, (2, m, 3, 3)
        self._jump = np.zeros((2, len(faces), 3, 3))
        for side, ends in enumerate((faces.a, faces.b)):
            for f, e in enumerate(self._row[ends].tolist()):
                if e >= 0:
                    self._jump[side, f] = dense[e, :, f, :].T @ self._basis[e]
        self._lay_out()

    def _lay_out(self) -> None:
        """Vertices, the faces between them, and where a crack may begin and end."""
        faces, elements = self._assembly.interfaces, self._assembly.elements
        step = 1e-6 * self._assembly.size
        names: dict[tuple[int, int], int] = {}
        ends = [
            [names.setdefault(tuple(np.round(p / step).astype(int).tolist()), len(names)) for p in faces.polygon[f][:2]]
            for f in range(len(faces))
        ]
        self._ends = np.array(ends)
        at = step * np.array(list(names), dtype=float)
        low, high = at.min(axis=0), at.max(axis=0)
        shapes = np.concatenate([elements.shape[e] for e in elements.free])
        low, high = shapes.min(axis=0), shapes.max(axis=0)
        right = abs(at[:, 0] - high[0]) < 1e3 * step
        self._starts = np.flatnonzero(
            ((abs(at[:, 0] - low[0]) < 1e3 * step) | (abs(at[:, 1] - high[1]) < 1e3 * step)) & ~right
        )
        self._stops = np.flatnonzero(right)
        self._vertices = len(at)
        # a face is run along with the moving element on the left: (from, to) for a moving and for b moving
        way = at[self._ends[:, 1]] - at[self._ends[:, 0]]
        self._runs = []
        for ends_ in (faces.a, faces.b):
            arm = elements.centroid[ends_] - at[self._ends[:, 0]]
            left = way[:, 0] * arm[:, 1] - way[:, 1] * arm[:, 0] > 0.0
            self._runs.append(np.where(left[:, None], self._ends, self._ends[:, ::-1]))

    def motions(self, velocity: Floats) -> list[Floats]:
        """The rigid motions (3,) of what moves, each opened; of several parts each its own."""
        each = velocity.reshape(-1, 3)
        local = np.linalg.solve(self._basis, each[:, :, None])[:, :, 0]
        size = abs(each).max(axis=1)
        left = size > 1e-3 * size.max()
        found = []
        while left.any():
            first = local[np.flatnonzero(left)[0]]
            part = left & (abs(local - first).max(axis=1) <= _ONE * abs(first).max())
            mean = local[part].mean(axis=0)
            found.append(self._opened(mean / abs(mean).max(), part))
            left &= ~part
        return found

    def _opened(self, motion: Floats, moving: Bools) -> Floats:
        """The motion with what little its jumps lack along the crack around what moves."""
        best, most = motion, self._worst(motion, moving)
        turns = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        for part in (1e-9, 1e-8, 1e-7, _OPENED):
            for turn in turns.tolist():
                if most >= 0.0:
                    return best
                tried = motion + part * np.array([np.cos(turn), np.sin(turn), 0.0])
                worst = self._worst(tried, moving)
                if worst > most:
                    best, most = tried, worst
        return best

    def _worst(self, motion: Floats, moving: Bools) -> float:
        margins = self._relaxation._measured(self._jump @ motion, margins=True).max(axis=0)
        faces = self._assembly.interfaces
        a, b = self._row[faces.a], self._row[faces.b]
        goes = np.array([(a >= 0) & moving[a], (b >= 0) & moving[b]])
        crack = goes[0] != goes[1]
        return float(np.where(goes[0], margins[0], margins[1])[crack].min(initial=np.inf))

    def rule_out(self, formula: Formula, motion: Floats, threshold: float) -> bool:
        """Say in a formula that no crack is bad under a motion; False where that says nothing."""
        template = self._relaxation.template
        speed = self._basis @ motion
        live = (template.live.reshape(-1, 3) * speed).sum(axis=1)
        if live.min() < 0.0:
            return False
        power = threshold * live + (template.dead.reshape(-1, 3) * speed).sum(axis=1)
        flow = self._flow(power)
        sure = _SURE * float(abs(power).sum())
        jumps = self._jump @ motion
        fine = self._relaxation._measured(jumps, margins=True) >= 0.0
        cost = np.where(fine, self._relaxation._measured(jumps, margins=False), np.inf)  # label, side, face
        gain = np.array([flow, -flow]) - cost
        edges = []
        for side, ends in enumerate((self._assembly.interfaces.a, self._assembly.interfaces.b)):
            for f in np.flatnonzero((self._row[ends] >= 0) & np.isfinite(gain[:, side]).any(axis=0)).tolist():
                start, stop = self._runs[side][f].tolist()
                edges.append((start, stop, f, float(gain[0, side, f]), float(gain[1, side, f])))
        return _encode(formula, edges, self._vertices, self._starts.tolist(), self._stops.tolist(), sure)

    def _flow(self, power: Floats) -> Floats:
        """(m,) from a to b: what leaves an element in all is its power; supports take what comes."""
        faces = self._assembly.interfaces
        a, b = self._row[faces.a], self._row[faces.b]
        m = np.arange(len(faces))
        rows = np.concatenate([a[a >= 0], b[b >= 0]])
        columns = np.concatenate([m[a >= 0], m[b >= 0]])
        signs = np.concatenate([np.ones((a >= 0).sum()), -np.ones((b >= 0).sum())])
        matrix = csr_matrix((signs, (rows, columns)), shape=(len(power), len(faces)))
        flow = lsqr(matrix, power, atol=1e-15, btol=1e-15)[0]
        left = power - matrix @ flow
        if abs(left).max() > 1e-9 * abs(power).max():
            raise ArithmeticError("no flow has the powers for its divergence")
        return np.asarray(flow)


class Together(Reaching, Implying, Translating):
    """Translates, faces that follow left out, and cracks of one motion."""


Edge = tuple[int, int, int, float, float]
"""From, to, face, what is gained where it is dry, and where it is inner."""


def _encode(
    formula: Formula, edges: list[Edge], vertices: int, starts: list[int], stops: list[int], sure: float
) -> bool:
    """Clauses that no walk from a start to a stop gains more than `sure`; False where none does anyway."""
    leaving: dict[int, list[Edge]] = defaultdict(list)
    for edge in edges:
        leaving[edge[0]].append(edge)
    ahead, behind = np.full(vertices, -np.inf), np.full(vertices, -np.inf)
    ahead[stops], behind[starts] = 0.0, 0.0
    for _ in range(vertices):  # the longest way; cracks of one motion never close
        before = ahead.copy(), behind.copy()
        for start, stop, _, dry, inner in edges:
            most = max(dry, inner)
            ahead[start] = max(ahead[start], ahead[stop] + most)
            behind[stop] = max(behind[stop], behind[start] + most)
        if (before[0] == ahead).all() and (before[1] == behind).all():
            break
    else:
        return False
    room = float((ahead + behind).max())
    if not room > sure:
        return False
    step = (room - sure) / _LEVELS
    # the least sum at a vertex with which a crack can still be bad, and levels above it
    least = sure - ahead

    def level(vertex: int, total: float) -> int:
        return int(np.floor((total - least[vertex]) / step + 1e-9)) if total >= least[vertex] - 1e-9 * step else -1

    variable: dict[tuple[int, int], int] = {}
    clauses: list[list[int]] = []
    waiting = []
    for start in starts:
        place = level(start, 0.0)
        if place >= 0 and np.isfinite(ahead[start]):
            variable[start, place] = formula._new()
            clauses.append([variable[start, place]])
            waiting.append((start, place))
    ends = set(stops)
    while waiting:
        at, place = waiting.pop()
        total = least[at] + place * step
        for _, stop, face, dry, inner in leaving[at]:
            for gained, label in ((dry, True), (inner, False)):
                there = level(stop, total + gained) if np.isfinite(gained) else -1
                literal = int(formula._inner[face])
                if there < 0 or (literal == 0 and bool(formula.space.fixed[face]) != label):
                    continue
                unless = [] if literal == 0 else [literal if label else -literal]
                if stop in ends and total + gained >= sure:
                    clauses.append([-variable[at, place], *unless])
                    continue
                if (stop, there) not in variable:
                    variable[stop, there] = formula._new()
                    waiting.append((stop, there))
                clauses.append([-variable[at, place], *unless, variable[stop, there]])
    formula._solver.append_formula(clauses)
    return True
