"""The proof of a bound as a file that others can check: `jld_explore.verification` reads it and believes none of this.

The search keeps conflicts and no mechanisms, so each mechanism is found again, rounded to whole numbers, and weighed
as the check will weigh it. The conflicts of a search are hints here: the formula is stated anew from rules that the
check knows, and what the hints leave open is refuted as in the search. Only what a refutation of the formula needs is
written.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from pysat.solvers import Solver

from jld_core._version import __version__
from jld_core.arrays import Bits, Floats
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysis, SolveOptions, load_scale, relaxation_of
from jld_core.scene import Scene
from jld_core.solvers import make_solver
from jld_explore.drivers.base import Driver
from jld_explore.drivers.exact.conflict_minimization import Conflict, conflict_of
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.inner_paths import InnerPaths
from jld_explore.drivers.exact.trimming import refutation
from jld_explore.space import SearchSpace, blocks_of, to_string
from jld_explore.verification import Balances, Checker, Claim, Labellings, Lemma, Mechanism, Reason, Rule, write

_SLACK: Final = 2e-7
"""How far above the bound of a search, relative, a certificate claims its own: a fifth of what counts as proven, for
mechanisms that are found again to the accuracy of a solver, and rounded."""

_DIGITS: Final = 44
"""Binary digits of the velocities of a certificate, below the largest one."""

_OPENED: Final = (0.0, *(10.0**-k for k in range(13, 2, -1)))
"""How much of a motion that opens all faces is added to a mechanism, relative: as little as makes whole numbers stand,
and much where a solver gave up far from the bound."""

_OPEN: Final = "a search whose proof has a certificate"


def check_certifiable(driver: Driver, model: SolveOptions, scene: Scene) -> None:
    """Raise InputError, one line, where the proof of a driver, for the space of a scene, has no certificate."""
    search = driver.space.search
    for key, given in (("assemble", search.assemble), ("require", search.require)):
        if given is not None:
            raise InputError("--certificate", f"search.{key} is no rule of it", "a search without that")
    if driver.space.assembly.nominal is not None:
        raise InputError("--certificate", "it holds the values of the scene, not the low ones", "no --robust")
    if not isinstance(driver, Exact):
        raise InputError("--certificate", f"the driver {driver.name} has no proof to write", "--driver exact")
    assembly, limits = driver.space.assembly, driver.space.limits
    if limits.on_shapes:
        raise InputError("--certificate", "limits on the shape of blocks are no rules of it", "a search without them")
    Labellings(scene, assembly)  # says what it does not know
    for count, _ in limits.on_counts:
        terms = count.terms(assembly) if count.terms else None
        if terms is None or terms.blocks:
            raise InputError("--certificate", f"search.{count.name} is no rule of it", "a search without that limit")
    if driver.aim != "best":
        raise InputError("--certificate", "a whole front has none", "--aim best")
    if not model.modular or model.friction != "associative":
        raise InputError("--certificate", "it speaks of associative friction alone", "--objective associative")
    for case in assembly.by_case:
        Balances(case)  # says what has no balance
    if driver.exhaustive:
        raise InputError("--certificate", "of this space there is no proof but enumeration", _OPEN)


def certify(driver: Exact, scene: Scene, path: Path, found: tuple[Bits, float] | None) -> None:
    """Write the certificate of what an exact driver has proven.

    found: the best labelling (m,) and its λ. Raises InputError where there is no bound, or none that stands in whole
    numbers; OSError where it cannot be written.
    """
    if driver.bound is None:
        raise InputError("--certificate", "the search ended without any bound", _OPEN)
    Certifier(scene, driver.space, driver.bound).write(path, driver.state.conflicts, found)


class Certifier:
    """Finds reasons for a bound on λ over a space (with load cases: on the governing factor), scene units."""

    def __init__(self, scene: Scene, space: SearchSpace, bound: float) -> None:
        self._scene, self._space = scene, space
        assembly = space.assembly
        self.bound = bound + _SLACK * max(abs(bound), load_scale(assembly))
        self._claim = Claim(
            scene.model_dump(mode="json", exclude_defaults=True), self.bound, made_by=f"jld {__version__}"
        )
        self._analyses = [LimitAnalysis(case) for case in assembly.by_case]
        relaxation = relaxation_of(assembly, self._analyses)
        assert relaxation is not None  # or the search would have proven nothing
        self._relaxation, self._scale = relaxation, relaxation.unit
        self._checker = Checker(scene, assembly, self._claim)
        self._paths = InnerPaths(space)
        self._clauses: list[list[int]] = list(self._checker.labellings.beginning)
        self._reasons: list[Reason | None] = [None] * len(self._clauses)
        self._hints: dict[int, tuple[Bits, Bits]] = {}
        self._route = make_solver("clarabel", tolerance=1e-10)
        rules = self._checker.labellings
        candidates = np.flatnonzero(space.candidates).tolist()
        split_cube = [face for face in candidates if rules.too_large([face]) is not None]
        self._free = space.candidates.copy()
        self._free[split_cube] = False  # a formula knows that these are dry
        self._units = [_Units(analysis) for analysis in self._analyses]

    def write(self, path: Path, hints: Iterable[Conflict], found: tuple[Bits, float] | None) -> None:
        """Write the certificate of the bound.

        hints: conflicts that a search found, no proof needed. found: the best labelling (m,) and its λ. Raises
        InputError where a labelling stands above the bound, or for one of which no mechanism in whole numbers is found.
        """
        root = self._mechanism(*self._parted())
        if root is not None:  # one mechanism bounds all labellings
            faces = [*(face + 1 for face in root.dry), *(-(face + 1) for face in root.inner)]
            self._add(faces, root)
        self._take_hints(hints if root is None else ())
        while True:
            self._exhaust()
            proof = refutation(self._clauses)
            if proof is None:
                raise ArithmeticError("two satisfiability solvers disagree")
            lacking = [place for place in proof.needed if place in self._hints]
            good = [self._certify_hint(place) for place in lacking]
            if all(good):
                break
        beginning = len(self._checker.labellings.beginning)
        kept = [place for place in proof.needed if place >= beginning]
        number = {place: place + 1 for place in range(beginning)}
        number |= {place: beginning + 1 + k for k, place in enumerate(kept)}
        number |= {len(self._clauses) + k: beginning + 1 + len(kept) + k for k in range(len(proof.lemmas))}
        reasons = [reason for place in kept if (reason := self._reasons[place]) is not None]
        lemmas = [Lemma(literals, tuple(number[name] for name in by)) for literals, by in proof.lemmas]
        claim = self._claim
        if found is not None:
            labels, load = found
            claim = Claim(claim.scene, claim.bound, to_string(labels), load, claim.made_by)
        write(path, claim, [*reasons, *lemmas])

    # --- what is ruled out ------------------------------------------------------------------------------

    def _add(self, clause: Sequence[int], reason: Reason | None) -> int:
        self._clauses.append(list(clause))
        self._reasons.append(reason)
        return len(self._clauses) - 1

    def _take_hints(self, hints: Iterable[Conflict]) -> None:
        group = np.unique(np.argsort(self._space.group, axis=1), axis=0)
        for hint in hints:
            if hint.closed or not len(hint.faces) or hint.bound * self._scale > self.bound:
                continue
            for image in group:
                decided, labels = self._parted()
                decided[image[hint.faces]], labels[image[hint.faces]] = True, hint.labels
                place = self._add(_clause(decided, labels), None)
                self._hints[place] = decided, labels

    def _parted(self) -> tuple[Bits, Bits]:
        """Faces decided, and their labels, where only those are that every labelling has dry."""
        decided = self._space.candidates & ~self._free
        return decided, decided.copy()

    def _certify_hint(self, place: int) -> bool:
        """Give a hint its mechanism; one that has none, or rests on others, is dropped."""
        decided, labels = self._hints.pop(place)
        reason = self._mechanism(decided, labels)
        if reason is None:
            self._clauses[place] = [1, -1]  # says nothing
        self._reasons[place] = reason
        return reason is not None

    def _exhaust(self) -> None:
        """Rule out labellings until none is left."""
        with Solver("cadical195", bootstrap_with=self._clauses) as solver:
            faces = len(self._space.fixed)
            while solver.solve():
                inner = {v for v in solver.get_model() if 0 < v <= faces}
                labels = np.array([face + 1 not in inner for face in range(faces)])
                rules = list(self._broken(labels))
                if rules:
                    for rule in rules:
                        clause = self._checker.clause(rule)
                        if clause is None or any((literal < 0) == labels[abs(literal) - 1] for literal in clause):
                            raise ArithmeticError(f"a rule that the check does not know as broken: {rule}")
                        self._add(clause, rule)
                        solver.add_clause(clause)
                    continue
                reason = self._refuted(labels)
                clause = [*(face + 1 for face in reason.dry), *(-(face + 1) for face in reason.inner)]
                self._add(clause, reason)
                solver.add_clause(clause)

    def _refuted(self, labels: Bits) -> Mechanism:
        """Why a labelling of the space, and others with it, carries no more than the bound."""
        conflict = conflict_of(self._relaxation, labels, self._free, self.bound / self._scale)
        if conflict is not None:
            decided, _ = self._parted()
            decided[conflict.faces] = True
            reason = self._mechanism(decided, labels)
            if reason is not None:
                return reason
        reason = self._mechanism(self._space.candidates, labels) or self._own_mechanism(labels)
        if reason is None:
            problem = f"of the layout {to_string(labels)} no mechanism in whole numbers keeps λ below {self.bound:.9g}"
            raise InputError("--certificate", problem, _OPEN)
        return reason

    # --- mechanisms -------------------------------------------------------------------------------------

    def _mechanism(self, decided: Bits, labels: Bits) -> Mechanism | None:
        """A mechanism, in whole numbers, that proves the bound for all labellings that agree where decided."""
        labels = np.where(self._space.candidates, labels, self._space.fixed)
        undecided = self._space.candidates & ~decided
        for case, relaxation in enumerate(self._relaxation.each):
            raw = self._route.solve(relaxation.program(labels, undecided))
            velocity = raw.dual[: relaxation.template.matrix.shape[0]]
            reason = self._rounded(case, velocity, self._space.candidates & decided, labels)
            if reason is not None:
                return reason
        return None

    def _own_mechanism(self, labels: Bits) -> Mechanism | None:
        """The same of one labelling, by its own limit analysis."""
        for case, analysis in enumerate(self._analyses):
            mechanism = analysis.solve(labels).mechanism
            if mechanism is not None:
                velocity = mechanism[analysis.template.assembly.elements.free] * self._units[case].row
                reason = self._rounded(case, velocity.ravel(), self._space.candidates, labels)
                if reason is not None:
                    return reason
        return None

    def _rounded(self, case: int, velocity: Floats, decided: Bits, labels: Bits) -> Mechanism | None:
        size = float(abs(velocity).max(initial=0.0))
        if not 0.0 < size < 1e30:
            return None
        units = self._units[case]
        dry = tuple(np.flatnonzero(decided & labels).tolist())
        inner = tuple(np.flatnonzero(decided & ~labels).tolist())
        for share in _OPENED:
            opened = units.opened(velocity / size, share)
            if opened is None:
                break
            digits, moves = units.whole(opened)
            reason = Mechanism(dry, inner, case, digits, moves)
            if self._checker.clause(reason) is not None:
                return reason
        return None

    # --- rules of a segmentation ------------------------------------------------------------------------

    def _broken(self, labels: Bits) -> Iterable[Rule]:
        """Rules that a labelling (m,) breaks."""
        space, graph = self._space, self._space.graph
        blocks, limits = blocks_of(graph, labels), space.limits
        if space.search.segmentation:
            for face in np.flatnonzero(labels & (blocks[graph.a] == blocks[graph.b])).tolist():
                path = self._paths.path(labels, int(graph.a[face]), int(graph.b[face]))
                if path:
                    yield Rule("slit", (face, *path))
        free = set(space.assembly.elements.free.tolist())
        sized = limits.sized
        for name in np.unique(blocks[space.assembly.elements.free]).tolist():
            block = np.flatnonzero(blocks == name).tolist()
            members = frozenset(block) & free
            if limits.too_large(sized.one(members)):
                yield Rule("large", tuple(self._paths.tree(labels, min(members))))
            elif limits.too_small(sized.one(members)):
                yield Rule("small", tuple(block))


class _Units:
    """Scaled velocities of one load case, as whole numbers of scene units."""

    def __init__(self, analysis: LimitAnalysis) -> None:
        template = analysis.template
        self._free = template.assembly.elements.free
        self.row = template.scaling.row
        self._size = template.assembly.size
        opening = analysis.repair.opening()
        self._opening = None if opening is None else opening.velocity / float(abs(opening.velocity).max())

    def opened(self, velocity: Floats, share: float) -> Floats | None:
        """Velocities with a share of a motion that opens all faces; None where there is no such motion."""
        if share == 0.0:
            return velocity
        return None if self._opening is None else velocity + share * self._opening

    def whole(self, velocity: Floats) -> tuple[int, dict[int, tuple[int, ...]]]:
        """Digits, and velocities in scene units over 2**digits of the elements that move."""
        table = velocity.reshape(self.row.shape) / self.row
        # a turn moves what is far away, in whatever units that is
        exponent = np.floor(np.log2(float(abs(table).max()))) - np.ceil(max(0.0, np.log2(self._size)))
        digits = max(_DIGITS - int(exponent), 0)
        moves = {}
        for element, values in zip(self._free.tolist(), table.tolist(), strict=True):
            numbers = tuple(round(Fraction(value) * (1 << digits)) for value in values)
            if any(numbers):
                moves[element] = numbers
        return digits, moves


def _clause(decided: Bits, labels: Bits) -> list[int]:
    """Not all of these labels together."""
    return [face + 1 if labels[face] else -(face + 1) for face in np.flatnonzero(decided).tolist()]
