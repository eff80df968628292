"""Convert the proof of a satisfiability solver to the lemmas it needs, with reasons.

A solver that logs its proof writes learnt clauses, each of which follows from earlier clauses by unit propagation.
This module propagates each learnt clause once and records which clauses were used. It then drops everything that the
last learnt clause, the empty one, does not need.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pysat.solvers import Solver

_LOGGING = "cadical195"  # satisfiability solver that logs its proof


@dataclass(frozen=True)
class Refutation:
    """Proof that clauses contradict each other.

    needed: positions of the clauses that are used, ascending. lemmas: literals of each lemma, and its reasons:
    positions of clauses, or number of clauses + position of a lemma.
    """

    needed: tuple[int, ...]
    lemmas: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def refutation(clauses: Sequence[Sequence[int]]) -> Refutation | None:
    """Return a refutation of clauses.

    clauses: clauses of nonzero literals. Result: the refutation; None if the clauses have a model. Raises
    ArithmeticError if the proof of the solver does not hold.
    """
    empty = next((k for k, clause in enumerate(clauses) if not clause), None)
    if empty is not None:
        return Refutation((empty,), (((), (empty,)),))
    with Solver(_LOGGING, with_proof=True) as solver:
        for clause in clauses:
            solver.add_clause(list(clause))
        if solver.solve():
            return None
        lines = solver.get_proof()
    # deletions only speed up a checker; additional clauses do not invalidate the proof
    learnt = [[int(word) for word in line.split()[:-1]] for line in lines if not line.startswith("d")]
    propagation = _Propagation()
    for clause in clauses:
        propagation.add(clause)
    reasons: list[tuple[int, ...]] = []
    lemmas: list[tuple[int, ...]] = []
    for literals in [*learnt, []]:
        by = propagation.follows(literals)
        if by is None:
            raise ArithmeticError("a solver's proof does not hold")
        reasons.append(by)
        lemmas.append(tuple(dict.fromkeys(literals)))
        propagation.add(literals)
        if not literals:
            break
    return _trimmed(len(clauses), lemmas, reasons)


def _trimmed(count: int, lemmas: list[tuple[int, ...]], reasons: list[tuple[int, ...]]) -> Refutation:
    """Return the refutation with only the clauses and lemmas that the last lemma needs.

    count: number of clauses. reasons: for each lemma positions as in `Refutation.lemmas`.
    """
    used = {count + len(lemmas) - 1}
    for place in range(len(lemmas) - 1, -1, -1):
        if count + place in used:
            used.update(reasons[place])
    kept = [place for place in range(len(lemmas)) if count + place in used]
    number = {count + place: count + k for k, place in enumerate(kept)}
    return Refutation(
        tuple(sorted(name for name in used if name < count)),
        tuple((lemmas[place], tuple(number.get(name, name) for name in reasons[place])) for place in kept),
    )


class _Propagation:
    """Unit propagation with two watched literals; unit clauses stay assigned."""

    def __init__(self) -> None:
        self._clauses: list[list[int]] = []
        self._watches: dict[int, list[int]] = {}
        self._reason: dict[int, int] = {}  # true literals with the clause that implies each, −1 for assumed ones
        self._trail: list[int] = []
        self._head = 0
        self._conflict: int | None = None

    def add(self, literals: Sequence[int]) -> None:
        """Add a clause and propagate it."""
        clause = list(dict.fromkeys(literals))
        name = len(self._clauses)
        self._clauses.append(clause)
        # literals that are not false come first, because watched literals must not be false
        clause.sort(key=lambda literal: -literal in self._reason)
        for literal in clause[:2]:
            self._watches.setdefault(literal, []).append(name)
        if self._conflict is None and (len(clause) < 2 or -clause[1] in self._reason):
            if not clause or -clause[0] in self._reason:
                self._conflict = name
            elif clause[0] not in self._reason:
                self._assign(clause[0], name)
                self._conflict = self._propagate()

    def follows(self, literals: Sequence[int]) -> tuple[int, ...] | None:
        """Return the clauses by whose propagation a lemma follows, in order; None if it does not."""
        if self._conflict is not None:
            return self._why(self._conflict)
        mark = len(self._trail)
        conflict: int | None = None
        for literal in literals:
            if literal in self._reason:
                conflict = self._reason[literal]
                if conflict < 0:
                    conflict = None
                    continue
                break
            if -literal not in self._reason:
                self._assign(-literal, -1)
        if conflict is None:
            conflict = self._propagate()
        found = None if conflict is None else self._why(conflict)
        for literal in self._trail[mark:]:
            del self._reason[literal]
        del self._trail[mark:]
        self._head = mark
        return found

    def _assign(self, literal: int, name: int) -> None:
        """Make a literal true, with the clause that implies it as reason (−1: assumed)."""
        self._reason[literal] = name
        self._trail.append(literal)

    def _propagate(self) -> int | None:
        """Propagate all assigned literals; return the clause that became false, or None."""
        reason, clauses, trail = self._reason, self._clauses, self._trail
        while self._head < len(trail):
            false = -trail[self._head]
            self._head += 1
            watching = self._watches.get(false)
            if not watching:
                continue
            kept: list[int] = []
            for place, name in enumerate(watching):
                clause = clauses[name]
                if clause[0] == false:
                    clause[0], clause[1] = clause[1], clause[0]
                first = clause[0]
                if first in reason:
                    kept.append(name)
                    continue
                for k in range(2, len(clause)):
                    if -clause[k] not in reason:
                        clause[1], clause[k] = clause[k], false
                        self._watches.setdefault(clause[1], []).append(name)
                        break
                else:
                    kept.append(name)
                    if -first in reason:
                        self._watches[false] = kept + watching[place + 1 :]
                        return name
                    reason[first] = name
                    trail.append(first)
            self._watches[false] = kept
        return None

    def _why(self, conflict: int) -> tuple[int, ...]:
        """Return the clauses that imply a false clause, each after those it needs; it is last."""
        place = {literal: k for k, literal in enumerate(self._trail)}
        seen = {conflict}
        needed: list[tuple[int, int]] = []
        pending = [conflict]
        while pending:
            for literal in self._clauses[pending.pop()]:
                name = self._reason.get(-literal, -1)
                if name >= 0 and name not in seen:
                    seen.add(name)
                    needed.append((place[-literal], name))
                    pending.append(name)
        return (*(name for _, name in sorted(needed)), conflict)
