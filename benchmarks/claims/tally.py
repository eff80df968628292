"""Count how often a claim of the program was tested on random cases, and how often it was wrong."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class Tally:
    """Result of testing one claim on random cases.

    Parameters
    ----------
    claim : str
        The claim in plain words, without a full stop.
    cases : int
        Number of random cases tested so far.
    disagreements : list of str
        One line per case in which the claim was wrong: how to reproduce the case, what was expected, what was found.
    notes : dict of str to int
        Further counts, for example the number of uncertified results by cause.
    seconds : float
        Elapsed time, s.
    """

    claim: str
    cases: int = 0
    disagreements: list[str] = field(default_factory=list)
    notes: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    def count(self, name: str, number: int = 1) -> None:
        """Add to one of the further counts."""
        self.notes[name] = self.notes.get(name, 0) + int(number)


Family = Callable[[int, int, float], Tally]
"""Function ``run(first_seed, cases, seconds)``: test a claim on at most ``cases`` seeds from ``first_seed`` on.

It stops early once ``seconds`` have passed."""


def run_cases(claim: str, case: Callable[[int, Tally], str], first_seed: int, cases: int, seconds: float) -> Tally:
    """Test a claim on one random case per seed.

    Parameters
    ----------
    claim : str
        The claim in plain words.
    case : callable
        ``case(seed, tally)`` returns "" where the claim held, otherwise one line that describes the disagreement.
        It may add to ``tally.notes``.
    first_seed, cases : int
        Seeds ``first_seed`` to ``first_seed + cases - 1`` are tested.
    seconds : float
        Time after which no further case begins, s.

    Returns
    -------
    Tally
        Number of cases, and every disagreement.
    """
    tally = Tally(claim)
    start = time.perf_counter()
    for seed in range(first_seed, first_seed + cases):
        if time.perf_counter() - start > seconds:
            break
        problem = case(seed, tally)
        tally.cases += 1
        if problem:
            tally.disagreements.append(f"seed {seed}: {problem}")
    tally.seconds = time.perf_counter() - start
    return tally
