"""From a solver's proof to lemmas that say what they follow from, and to the clauses that were needed at all.

A solver that logs its proof writes one learnt clause after the other, each of which follows by unit propagation from
those before it. Here every one is propagated once, which clauses did it is kept, and what the last one, the empty
clause, does not need is dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pysat.solvers import Solver

_LOGGING = "cadical195"


@dataclass(frozen=True)
class Refutation:
    """Why clauses contradict each other. needed: positions of those that are used, ascending. lemmas: in order, each
    with what it follows from: position of a clause, or number of clauses + position of a lemma.
    """

    needed: tuple[int, ...]
    lemmas: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def refutation(clauses: Sequence[Sequence[int]]) -> Refutation | None:
    """A refutation of clauses, None where they do not contradict each other.

    Raises ArithmeticError where the solver's proof does not hold.
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
    # deletions only save a checker time; more clauses prove no less
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
    """Only what the last lemma needs."""
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
    """Unit propagation over clauses with two watched literals; what is unit by itself stays assigned."""

    def __init__(self) -> None:
        self._clauses: list[list[int]] = []
        self._watches: dict[int, list[int]] = {}
        self._reason: dict[int, int] = {}  # literals that are true, with the clause that made them so, −1 assumed
        self._trail: list[int] = []
        self._head = 0
        self._conflict: int | None = None

    def add(self, literals: Sequence[int]) -> None:
        """Take one more clause."""
        clause = list(dict.fromkeys(literals))
        name = len(self._clauses)
        self._clauses.append(clause)
        # literals that are not false stand first, so that watches are of use
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
        """The clauses that contradict the negation of a lemma, in the order in which they do; None where none does."""
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
        self._reason[literal] = name
        self._trail.append(literal)

    def _propagate(self) -> int | None:
        """The clause that became false, if any."""
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
        """The clauses behind one that is false (or made a literal of the lemma true), each after those it needs."""
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
