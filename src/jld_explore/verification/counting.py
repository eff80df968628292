"""At least so many of some literals: clauses with variables for how many there are among the first ones."""

from __future__ import annotations

from collections.abc import Sequence


def at_least(literals: Sequence[int], least: int, top: int) -> tuple[list[list[int]], int]:
    """Clauses that at least `least` of the literals are true, and the largest variable then. top: the largest so far.

    Variable (i, j) says that j of the first i literals are true: it only holds if (i − 1, j) does, or (i − 1, j − 1)
    and literal i. One direction is enough, since only more is asked for. Source: Sinz 2005, CP, LNCS 3709, 827–831.
    """
    if least > len(literals):
        return [[]], top
    before: list[int | None] = [None] * (least + 1)  # (0, j): false for every j > 0
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
    assert last is not None
    return [*clauses, [last]], top
