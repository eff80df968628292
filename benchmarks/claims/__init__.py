"""Claims of the program, tested on random cases against independent routes.

``python -m benchmarks.claims`` tests every claim and writes ``benchmarks/results/claims.md``: claim, number of cases,
number of disagreements, for each version that was tested. ``make test`` tests a small share of the same cases.
"""

from __future__ import annotations

import importlib
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple


class Claim(NamedTuple):
    """A claim in plain words, the module of its cases, and the number of cases of a whole run."""

    module: str
    cases: int
    words: str


_TEXT: Final = (Path(__file__).parent / "claims.toml").read_text(encoding="utf-8")
CLAIMS: Final = {name: Claim(*values) for name, values in tomllib.loads(_TEXT).items()}


@dataclass
class Tally:
    """Cases of one claim: how many, a line for each that disagrees, further counts, and the time by the clock, s."""

    claim: str
    cases: int = 0
    disagreements: list[str] = field(default_factory=list)
    notes: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    def count(self, name: str, number: int = 1) -> None:
        self.notes[name] = self.notes.get(name, 0) + int(number)


def run_cases(claim: str, case: Callable[[int, Tally], str], first_seed: int, cases: int, seconds: float) -> Tally:
    """Test a claim on one random case per seed, until a time has passed.

    ``case(seed, tally)`` returns "" where the claim held, otherwise one line that says what disagrees and how the case
    is made again.
    """
    tally, start = Tally(claim), time.perf_counter()
    for seed in range(first_seed, first_seed + cases):
        if time.perf_counter() - start > seconds:
            break
        problem = case(seed, tally)
        tally.cases += 1
        if problem:
            tally.disagreements.append(f"seed {seed}: {problem}")
    tally.seconds = time.perf_counter() - start
    return tally


def run(name: str, first_seed: int, cases: int, seconds: float) -> Tally:
    """Test a claim by its name: by its own ``run_…`` if it has one, otherwise by its cases one after another."""
    claim = CLAIMS[name]
    module = importlib.import_module(f"benchmarks.claims.{claim.module}")
    if hasattr(module, f"run_{name}"):
        tally: Tally = getattr(module, f"run_{name}")(claim.words, first_seed, cases, seconds)
        return tally
    return run_cases(claim.words, getattr(module, f"case_{name}"), first_seed, cases, seconds)


__all__ = ["CLAIMS", "Tally", "run", "run_cases"]
