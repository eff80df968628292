"""Encode cardinality constraints (at least n of some literals) as clauses."""

from __future__ import annotations

from collections.abc import Sequence


def at_least(literals: Sequence[int], least: int, top: int) -> tuple[list[list[int]], int]:
    """Return clauses for "at least `least` literals are true", and the largest variable used.

    Variable (i, j) states that j of the first i literals are true. It implies (i − 1, j), or (i − 1, j − 1) together
    with literal i. One direction of the implication suffices, since the constraint is only a lower bound.

    literals: nonzero integers, negative for a negation. least: 1 or more, else ValueError is raised. top: largest
    variable used before. Source: Sinz 2005, CP, LNCS 3709, 827–831.
    """
    if least > len(literals):
        return [[]], top
    before: list[int | None] = [None] * (least + 1)  # (0, j) is false for every j > 0
    clauses: list[list[int]] = []
    for place, literal in enumerate(literals, 1):
        now: list[int | None] = [None] * (least + 1)
        for j in range(1, min(place, least) + 1):
            top += 1
            now[j] = top
            fewer = before[j]
            same = [] if fewer is None else [fewer]
            clauses.append([-top, *same, literal])
            if j > 1:
                one_less = before[j - 1]
                clauses.append([-top, *same, *([] if one_less is None else [one_less])])
        before = now
    last = before[least]
    if last is None:
        raise ValueError("a constraint on no literal needs no clauses; least must be 1 or more")
    return [*clauses, [last]], top
