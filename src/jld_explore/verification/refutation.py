"""Check lemma by lemma that clauses are contradictory, using unit propagation alone.

The format is LRAT without deletions and without lemmas that only preserve satisfiability.
Source: Cruz-Filipe, Heule, Hunt, Kaufmann, Schneider-Kamp 2017, CADE 26, LNCS 10395, 220–236.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def follows(lemma: Sequence[int], by: Sequence[int], clauses: Mapping[int, Sequence[int]]) -> bool:
    """Return True if a lemma follows by reverse unit propagation from given clauses in order.

    With the lemma false, each of these clauses in turn must have one literal left, and the last one none.

    lemma: literals of the clause to prove. by: numbers of the clauses used, in order. clauses: literals of all known
    clauses by number. False also for a number that is unknown.
    """
    false = set(lemma)
    if any(-literal in false for literal in lemma):
        return True
    for name in by:
        clause = clauses.get(name)
        if clause is None:
            return False
        left = [literal for literal in clause if literal not in false]
        if not left:
            return True
        if len(set(left)) > 1:
            return False
        false.add(-left[0])
    return False
