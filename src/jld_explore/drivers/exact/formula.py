"""Boolean formula of the labellings of a search space that no conflict rules out, docs/method.md (5.2)."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from pysat.card import CardEnc, EncType, ITotalizer
from pysat.solvers import Solver

from jld_core.arrays import Bits, Floats, Ints
from jld_core.deadline import checkpoint
from jld_explore.drivers.exact.context import PossibleBlocks
from jld_explore.drivers.exact.proof_state import Conflict
from jld_explore.space import Count, count_named
from jld_explore.space.labelling import blocks_of, canonical
from jld_explore.space.limits import Range
from jld_explore.space.search_space import SearchSpace

Pairs = tuple[tuple[int, bool], ...]  # faces and labels (True = dry) that no labelling above some scaled λ has together


class AssumptionLiterals:
    """Assumption literals, one per threshold level: true where labellings sought exceed the level."""

    def __init__(self, new: Callable[[], int], rule_out: Callable[[Pairs, tuple[int, ...]], None]) -> None:
        # a clause that holds above a bound is guarded by the lowest level not below it, and waits while there is none;
        # a new level takes over the clauses that hold at it
        self._new, self._rule_out = new, rule_out
        self._levels: list[float] = []
        self._literals: list[int] = []
        self._waiting: list[list[tuple[float, Pairs]]] = [[]]
        self._least_bounds: dict[Pairs, float] = {}
        self.threshold = -math.inf  # scaled λ that labellings must exceed at present
        self.assumed: list[int] = []  # in every call of the solver

    def forbid_above(self, pairs: Pairs, bound: float) -> None:
        """Forbid labels at every level not below a bound (scaled λ); −inf forbids them always."""
        # A call has no effect where the same labels are forbidden under the same or a lower bound already.
        if self._least_bounds.get(pairs, math.inf) <= bound:
            return
        self._least_bounds[pairs] = bound
        if bound == -math.inf:
            self._rule_out(pairs, ())
            return
        index = bisect_left(self._levels, bound)
        self._waiting[index].append((bound, pairs))
        if index < len(self._levels):
            self._rule_out(pairs, (-self._literals[index],))

    def aim(self, threshold: float) -> None:
        """Set the scaled λ that labellings must exceed, and update `assumed`."""
        self.threshold = threshold
        index = bisect_left(self._levels, threshold)
        if index == len(self._levels) or self._levels[index] != threshold:
            self._insert(index, threshold)
        above = [-self._literals[index + 1]] if index + 1 < len(self._literals) else []
        self.assumed = [self._literals[index], *above]

    def _insert(self, index: int, level: float) -> None:
        """Insert a level, order its literal between its neighbours and add its clauses."""
        literal = self._new()
        if index > 0:
            self._rule_out((), (-literal, self._literals[index - 1]))
        if index < len(self._literals):
            self._rule_out((), (-self._literals[index], literal))
        above_previous = self._waiting[index]
        holding = [entry for entry in above_previous if entry[0] <= level]
        self._levels.insert(index, level)
        self._literals.insert(index, literal)
        self._waiting.insert(index, holding)
        self._waiting[index + 1] = [entry for entry in above_previous if entry[0] > level]
        for _, pairs in holding:
            self._rule_out(pairs, (-literal,))


class UnaryCounter:
    """Number of true literals among some, plus a constant, as a unary number."""

    def __init__(self, literals: Sequence[int], constant: int, top: int) -> None:
        # totalizers (Bailleux and Boufkhad 2003) imply upper bounds alone, hence one of literals and one of negations
        self._size, self._constant = len(literals), constant
        self._false = top = top + 1
        self.clauses: list[list[int]] = [[-self._false]]  # they define the digits, once the solver has them
        self._digits: list[list[int]] = []
        for chosen in (list(literals), [-literal for literal in literals]):
            if chosen:
                with ITotalizer(chosen, ubound=len(chosen), top_id=top) as totalizer:
                    top = max(top, totalizer.top_id)
                    self.clauses += totalizer.cnf.clauses
                    self._digits.append(list(totalizer.rhs))
        self.top = top  # largest variable in use

    def within(self, bounds: Range) -> list[int]:
        """Return the literals to assume so that the number, with the constant, is within bounds."""
        low = 0 if bounds.low is None else int(bounds.low) - self._constant
        high = self._size if bounds.high is None else int(bounds.high) - self._constant
        if low > self._size or high < 0:
            return [self._false]
        most = [-self._digits[0][high]] if high < self._size else []
        return most + ([-self._digits[1][self._size - low]] if low > 0 else [])


class InnerPaths:
    """Graph of the elements of a space, to search along the inner faces of labellings."""

    def __init__(self, space: SearchSpace) -> None:
        graph = space.graph
        # per element pairs (face, neighbour); face −1 for supports that touch without a face
        self._links: list[list[tuple[int, int]]] = [[] for _ in range(len(graph.start))]
        pairs = [(face, a, b) for face, (a, b) in enumerate(zip(graph.a, graph.b, strict=True))]
        for face, a, b in pairs + [(-1, a, b) for a, b in graph.touching]:
            self._links[int(a)].append((face, int(b)))
            self._links[int(b)].append((face, int(a)))
        self._free = frozenset(space.assembly.elements.free.tolist())
        self._limits = space.limits

    def path(self, labels: Bits, start: int, end: int) -> list[int]:
        """Return the inner faces of labels (m,) on a shortest path between two elements of one block."""
        previous = self._reach(labels, start, lambda visited: end in visited)
        path, element = [], end
        while element != start:
            element, face = previous[element]
            if face >= 0:
                path.append(face)
        return path

    def tree(self, labels: Bits, start: int) -> list[int]:
        """Return inner faces of labels (m,) that join enough elements to exceed a limit on blocks."""
        limits = self._limits
        previous = self._reach(
            labels, start, lambda nodes: bool(limits.too_large(limits.sized.one(nodes & self._free)))
        )
        return [face for _, face in previous.values() if face >= 0]

    def _reach(self, labels: Bits, start: int, reached: Callable[[set[int]], bool]) -> dict[int, tuple[int, int]]:
        """Search breadth first from element `start` until `reached` or to the end; return the tree."""
        # Steps go through inner faces of `labels` (m,) and contacts without a face.
        previous = {start: (start, -1)}
        waiting = deque([start])
        while waiting:
            element = waiting.popleft()
            for face, other in self._links[element]:
                if other not in previous and (face < 0 or not labels[face]):
                    previous[other] = (element, face)
                    waiting.append(other)
                    if reached(set(previous)):
                        return previous
        return previous


# Satisfiability solver of the search. It accepts new preferred labels before every call, and releases the interpreter
# lock while it solves.
_SOLVER: Final = "minisat22"

# Conflicts of the satisfiability solver between two checks of the deadline, about 0.2 s
_CONFLICTS_PER_CHECK: Final = 10_000


class Formula:
    """Boolean formula whose models are the labellings that no clause rules out."""

    def __init__(
        self, space: SearchSpace, blocks: PossibleBlocks | None, solver: str = _SOLVER, *, partial: bool = False
    ) -> None:
        # A variable for each candidate face, true where inner, and one for each possible block if these are listed:
        # then every element is in one chosen block. Otherwise slits and limits are ruled out as they occur. One formula
        # serves a whole proof, so the solver keeps its learnt clauses. partial: counts that the formula cannot express
        # are not limited, instead of a ValueError. undecided: labellings ruled out though an order of laying may exist.
        self.space, self.blocks, self.undecided = space, blocks, 0
        self._solver = Solver(solver)
        self._interruptible = solver == _SOLVER
        candidates = np.flatnonzero(space.candidates)
        self._variable = np.zeros(len(space.fixed), dtype=np.int64)
        self._variable[candidates] = 1 + np.arange(candidates.size)
        self._candidates = candidates
        self._last_variable = candidates.size
        self._images = np.unique(np.argsort(space.group, axis=1), axis=0)
        self._limits, self._sized = space.limits, space.limits.sized
        self._paths = InnerPaths(space)
        self._assumption_literals = AssumptionLiterals(self._new, self._rule_out)
        self._counter: UnaryCounter | None = None
        self._assumed_count: list[int] = []
        self._set_aside: int | None = None
        self._chosen: list[int] = []
        self._first_elements: list[int] = []
        if blocks is not None:
            self._add_blocks(blocks)
        for limited, bounds in self._limits.on_counts:
            if not partial or self._can_express(limited):
                self._limit_sum(*self._terms(limited), bounds)
        for lock in space.laying.locks if space.laying is not None else ():
            self.forbid(lock.faces, lock.labels)

    def aim(self, threshold: float, count: int | Range | None = None) -> None:
        """Seek labellings above a scaled λ from now on, and forget all calls of `set_aside`."""
        if self._set_aside is not None:
            self._solver.add_clause([-self._set_aside])
            self._set_aside = None
        self._assumed_count = (
            []
            if count is None
            else self._unary_counter().within(Range.of((count, count), whole=True) if isinstance(count, int) else count)
        )
        self._assumption_literals.aim(threshold)

    def raise_threshold(self, threshold: float) -> None:
        """Raise the scaled λ that labellings must exceed; a lower threshold has no effect."""
        if threshold > self._assumption_literals.threshold:
            self._assumption_literals.aim(threshold)

    def possible(self, faces: Iterable[int], labels: Iterable[bool]) -> bool:
        """Return whether the clauses so far admit labels (k,) on faces (k,)."""
        return self._solve(self._assumed + self._face_literals(faces, labels))

    def derived(self, faces: Iterable[int], labels: Iterable[bool]) -> int | None:
        """Count the literals that unit propagation derives from labels (k,) on faces (k,); None: contradiction."""
        assumed = self._assumed
        assumptions = self._face_literals(faces, labels)
        _, propagated = self._solver.propagate(assumptions=assumed)
        possible, propagated_further = self._solver.propagate(assumptions=assumed + assumptions)
        return len(propagated_further) - len(propagated) - len(assumptions) if possible else None

    def next(
        self, faces: Iterable[int] = (), labels: Iterable[bool] = (), preferred: Bits | None = None
    ) -> Bits | None:
        """Return a labelling (m,) that no clause rules out, preferred labels first; None if none is left."""
        assumptions = self._assumed + self._face_literals(faces, labels)
        if preferred is not None:
            signs = np.where(preferred[self._candidates], -1, 1)
            self._solver.set_phases((signs * self._variable[self._candidates]).tolist())
        while self._solve(assumptions):
            checkpoint()
            # variables in no clause may be missing from the model and are free
            inner = {v for v in self._solver.get_model() if 0 < v <= self._candidates.size}
            labels = self.space.fixed.copy()
            labels[self._candidates] = [v not in inner for v in range(1, self._candidates.size + 1)]
            broken = ([] if self.blocks is not None else self._broken_rules(labels)) or self._assembly_locks(labels)
            if not broken:
                return labels
            for faces_of_rule, labels_of_rule in broken:
                self.forbid(faces_of_rule, labels_of_rule)
        return None

    def _solve(self, assumptions: list[int]) -> bool:
        """Return whether the formula has a model under assumptions; check the deadline."""
        if not self._interruptible:
            return bool(self._solver.solve(assumptions=assumptions))
        while True:
            self._solver.conf_budget(_CONFLICTS_PER_CHECK)
            # with expect_interrupt the solver releases the interpreter lock; None means that the budget is used up
            verdict = self._solver.solve_limited(assumptions=assumptions, expect_interrupt=True)
            if verdict is not None:
                return bool(verdict)
            checkpoint()

    def _face_literals(self, faces: Iterable[int], labels: Iterable[bool]) -> list[int]:
        """Return the literals of labels (k,) on faces (k,), without faces that are no candidates."""
        pairs = zip(faces, labels, strict=True)
        return [int(self._variable[f]) * (-1 if dry else 1) for f, dry in pairs if self._variable[f] > 0]

    def forbid(self, faces: Iterable[int], labels: Iterable[bool], bound: float = -math.inf) -> None:
        """Rule out labels (k,) on faces (k,), and their images under symmetry, above a bound."""
        pairs = tuple((int(f), bool(dry)) for f, dry in zip(faces, labels, strict=True) if self._variable[f] > 0)
        self._assumption_literals.forbid_above(pairs, bound)

    def learn(self, conflicts: Iterable[Conflict], handed_over: Iterable[Bits] = ()) -> None:
        """Rule out conflicts above their bounds, and labellings that need no further treatment."""
        for conflict in conflicts:
            self.forbid(conflict.faces, conflict.labels, conflict.bound)
        for labels in handed_over:
            self.forbid(np.arange(len(labels)), labels)

    def set_aside(self, faces: Iterable[int], labels: Iterable[bool]) -> None:
        """Rule out labels (k,) on faces (k,), and their images, until the next call of `aim`."""
        if self._set_aside is None:
            self._set_aside = self._new()
        pairs = tuple((int(f), bool(dry)) for f, dry in zip(faces, labels, strict=True) if self._variable[f] > 0)
        self._rule_out(pairs, (-self._set_aside,))

    @property
    def _assumed(self) -> list[int]:
        """Literals to assume: for the threshold, the count, and the labels set aside."""
        return (
            self._assumption_literals.assumed
            + self._assumed_count
            + ([] if self._set_aside is None else [self._set_aside])
        )

    def _new(self) -> int:
        self._last_variable += 1
        return self._last_variable

    def _rule_out(self, pairs: tuple[tuple[int, bool], ...], unless: tuple[int, ...]) -> None:
        """Forbid labels on faces, and their images, unless a literal of `unless` is true."""
        for image in self._images:
            self._solver.add_clause(
                [*unless, *(int(self._variable[image[f]]) * (1 if dry else -1) for f, dry in pairs)]
            )

    # --- what a segmentation is -------------------------------------------------------------------------

    def _add_blocks(self, blocks: PossibleBlocks) -> None:
        """Add a variable for each block that implies its labels; every element needs one."""
        graph = self.space.graph
        faces_of: dict[int, set[int]] = {}
        for face, (a, b) in enumerate(zip(graph.a.tolist(), graph.b.tolist(), strict=True)):
            faces_of.setdefault(a, set()).add(face)
            faces_of.setdefault(b, set()).add(face)
        chosen_of: dict[int, list[int]] = {int(e): [] for e in self.space.assembly.elements.free}
        for block, (members, inside) in enumerate(zip(blocks.members, blocks.inside, strict=True)):
            self._last_variable += 1
            self._chosen.append(self._last_variable)
            inner_faces = set(inside)
            for e in members:
                chosen_of[e].append(self._last_variable)
            for face in set().union(*(faces_of.get(e, set()) for e in members)):
                if self._variable[face] > 0:
                    sign = 1 if face in inner_faces else -1
                    self._solver.add_clause([-self._chosen[block], sign * int(self._variable[face])])
        for variables in chosen_of.values():
            self._solver.add_clause(variables)

    def limit_kinds(self, kinds: Sequence[int], bounds: Range) -> None:
        """Limit the number of different kinds among the chosen blocks."""
        of: dict[int, list[int]] = {}
        for chosen, kind in zip(self._chosen, kinds, strict=True):
            of.setdefault(int(kind), []).append(chosen)
        literals = [self._any_of(chosen) for chosen in of.values()]
        self._limit_sum(literals, 0, bounds)

    def _any_of(self, literals: list[int]) -> int:
        """Return a new variable that is true exactly where one of the literals is."""
        any_literal = self._new()
        self._solver.append_formula([[-any_literal, *literals], *([any_literal, -literal] for literal in literals)])
        return any_literal

    def _can_express(self, count: Count) -> bool:
        """Return whether the formula can count this, with the blocks as they are listed."""
        terms = None if count.terms is None else count.terms(self.space.assembly)
        return terms is not None and not (terms.blocks and self.blocks is None)

    def _terms(self, count: Count) -> tuple[list[int], int]:
        """Return the literals that a count adds up where they are true, and its constant part."""
        if count.terms is None:
            raise ValueError(f"{count.name} is no sum of ones")
        terms, space = count.terms(self.space.assembly), self.space
        literals, constant = [], 0
        if terms.faces is not None:
            literals += [-int(v) for v in self._variable[self._candidates[terms.faces[self._candidates]]]]
            constant += int((terms.faces & space.fixed & ~space.candidates).sum())
        if terms.blocks:
            literals += self._first_element_literals()
        return literals, constant

    def _first_element_literals(self) -> list[int]:
        """Return one variable per free element: true if a chosen block has it as first element."""
        # The number of true variables is the number of blocks.
        if self.blocks is None:
            raise ValueError("blocks can be counted where they are listed only")
        if not self._first_elements:
            of: dict[int, list[int]] = {int(e): [] for e in self.space.assembly.elements.free}
            for p, members in enumerate(self.blocks.members):
                of[members[0]].append(self._chosen[p])
            self._first_elements += [self._any_of(begun) for begun in of.values()]
        return self._first_elements

    def _limit_sum(self, literals: list[int], constant: int, bounds: Range) -> None:
        """Keep the number of true literals, plus `constant`, within bounds."""
        low = 0 if bounds.low is None else int(bounds.low) - constant
        high = len(literals) if bounds.high is None else int(bounds.high) - constant
        if low > len(literals) or high < 0:
            self._solver.add_clause([])
            return
        for make, bound, idle in ((CardEnc.atleast, low, low <= 0), (CardEnc.atmost, high, high >= len(literals))):
            if not idle:
                encoding = make(lits=literals, bound=bound, top_id=self._last_variable, encoding=EncType.totalizer)
                self._last_variable = max(self._last_variable, encoding.nv)
                self._solver.append_formula(encoding.clauses)

    def _unary_counter(self) -> UnaryCounter:
        """Return the unary counter of the count of the front, created at the first call."""
        if self._counter is None:
            literals, constant = self._terms(count_named(self.space.search.front.axes[0][0]))
            self._counter = UnaryCounter(literals, constant, self._last_variable)
            self._last_variable = self._counter.top
            self._solver.append_formula(self._counter.clauses)
        return self._counter

    # --- what is ruled out as it occurs -----------------------------------------------------------------

    def _assembly_locks(self, labels: Bits) -> list[tuple[Ints, Bits]]:
        """Return labels (k,) on faces (k,) that make a labelling impossible to assemble, if any."""
        if self.space.laying is None:
            return []
        lock = self.space.laying.lock(canonical(labels[None], self.space.group)[0])
        if lock is None:
            return []
        self.undecided += not lock.proven
        return [(lock.faces, lock.labels)]

    def _broken_rules(self, labels: Bits) -> list[tuple[Ints, Bits]]:
        """Return for each rule of the space that a labelling (m,) breaks the labels that break it."""
        blocks = blocks_of(self.space.graph, labels)
        graph, broken = self.space.graph, []
        if self.space.search.segmentation:
            for face in np.flatnonzero(labels & (blocks[graph.a] == blocks[graph.b])).tolist():
                path = self._paths.path(labels, int(graph.a[face]), int(graph.b[face]))
                broken.append((np.array([face, *path]), np.array([True] + [False] * len(path))))
        free = self.space.assembly.elements.free
        for name in np.unique(blocks[free]).tolist():
            members = frozenset(free[blocks[free] == name].tolist())
            large = bool(self._limits.too_large(self._sized.one(members)))
            if large and not self._limits.mendable:
                tree = self._paths.tree(labels, min(members))
                broken.append((np.array(tree, dtype=np.int64), np.zeros(len(tree), dtype=bool)))
            elif self._limits.too_small(self._sized.one(members)):
                border = np.flatnonzero((blocks[graph.a] == name) != (blocks[graph.b] == name))
                broken.append((border, np.ones(len(border), dtype=bool)))
            elif large or self._limits.misshapen(members):
                # exclude exactly this block: all faces inside it inner, all around it dry
                touched = np.flatnonzero((blocks[graph.a] == name) | (blocks[graph.b] == name))
                broken.append((touched, labels[touched]))
        return broken


# Number of faces compared by unit propagation before a cube is split. The faces most frequent in recent conflicts are
# compared.
_LOOKED_AT: Final = 16


@dataclass(frozen=True)
class Cube:
    """Set of all labellings with `labels` (k,) on `faces` (k,), True = dry."""

    faces: tuple[int, ...] = ()
    labels: tuple[bool, ...] = ()

    def and_face(self, face: int, *, dry: bool) -> Cube:
        return Cube((*self.faces, face), (*self.labels, dry))

    def holds(self, labels: Bits) -> bool:
        """Return True if a labelling (m,) lies in the cube."""
        return bool((labels[list(self.faces)] == np.array(self.labels, dtype=bool)).all())


EVERYTHING: Final = Cube()  # cube of all labellings


def split_cube(cube: Cube, formula: Formula, weight: Floats) -> Iterator[Cube]:
    """Yield the parts of a cube, split by the face whose labels propagate most.

    weight: (m,) recent conflicts of each face, which preselect the faces.
    """
    # The best face has the largest product of numbers of literals that unit propagation derives from each label. If
    # propagation refutes a part, only the other part follows, or none. A cube without a further face is its only part.
    decided = set(cube.faces)
    order = np.argsort(-weight, kind="stable").tolist()
    faces = [face for face in order if formula.space.candidates[face] and face not in decided][:_LOOKED_AT]
    best, best_score = None, -1
    for face in faces:
        parts = [cube.and_face(face, dry=dry) for dry in (True, False)]
        derived = [formula.derived(part.faces, part.labels) for part in parts]
        if None in derived:
            yield from (part for part, count in zip(parts, derived, strict=True) if count is not None)
            return
        score = int(np.prod([1 + (count or 0) for count in derived]))
        if score > best_score:
            best, best_score = parts, score
    yield from best or (cube,)
