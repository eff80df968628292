"""Unary representation of the number of true literals, bounded by assumptions."""

from __future__ import annotations

from collections.abc import Sequence

from pysat.card import ITotalizer

from jld_explore.space.measures import Range


class UnaryCounter:
    """Number of true literals among some, plus a constant, as a unary number.

    Two totalizers (Bailleux and Boufkhad 2003) encode the literals and their negations, because each totalizer
    implies only upper bounds.

    Parameters
    ----------
    literals : sequence of int
        Literals to count.
    constant : int
        Constant added to the number.
    top : int
        Largest variable in use.

    Attributes
    ----------
    clauses : list of list of int
        Clauses that define the digits.
    top : int
        Largest variable in use afterwards.
    """

    def __init__(self, literals: Sequence[int], constant: int, top: int) -> None:
        self._size, self._constant = len(literals), constant
        self._false = top = top + 1
        self.clauses: list[list[int]] = [[-self._false]]
        self._digits: list[list[int]] = []
        for chosen in (list(literals), [-literal for literal in literals]):
            if chosen:
                with ITotalizer(chosen, ubound=len(chosen), top_id=top) as made:
                    top = max(top, made.top_id)
                    self.clauses += made.cnf.clauses
                    self._digits.append(list(made.rhs))
        self.top = top

    def within(self, bounds: Range) -> list[int]:
        """Return the literals to assume so that the number is within bounds."""
        low = 0 if bounds.low is None else int(bounds.low) - self._constant
        high = self._size if bounds.high is None else int(bounds.high) - self._constant
        if low > self._size or high < 0:
            return [self._false]
        most = [-self._digits[0][high]] if high < self._size else []
        return most + ([-self._digits[1][self._size - low]] if low > 0 else [])
