"""Claims of the program, tested on random cases against independent routes.

``python -m benchmarks.claims`` tests every claim and writes ``benchmarks/results/claims.md``: claim, number of cases,
number of disagreements, for each version that was tested. ``make test`` tests a small share of the same cases.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple


class Claim(NamedTuple):
    """A claim in plain words, the module of its cases, and the number of cases of a whole run."""

    module: str
    cases: int
    words: str


CLAIMS: Final = {  # every claim by the name of its function ``case_…`` or ``run_…``
    "certificates": Claim(
        "searches", 300, "jld verify accepts true claims only and refuses every other file in one line"
    ),
    "converged": Claim("answers", 3000, "Results are converged; forces and mechanisms give both ends of the bracket"),
    "digits": Claim(
        "answers",
        300,
        "ten disturbances of 1e-15 under four kernels of OpenBLAS give one status and brackets that meet",
    ),
    "fields": Claim(
        "fields",
        500,
        "Bounds by fields are in order, monotonic, below rigid blocks, independent of position and units, and hold for "
        "other labellings",
    ),
    "geometry": Claim(
        "geometry", 3000, "Contacts, sections and λ are those counted on a grid, in any position, order and unit"
    ),
    "laying": Claim("geometry", 1000, "No step of an assembly order cuts a neighbour"),
    "loads": Claim(
        "fields",
        560,
        "Bounds by fields under dead and live pressures, line loads, patches, forces with widths and self-weight agree "
        "with own fields on a uniform mesh, in the plane and in space",
    ),
    "members": Claim(
        "searches", 200, "Walls with members and bond have one optimum by proof, enumeration and certificate"
    ),
    "proofs": Claim("searches", 3000, "a layout called proven strongest is the strongest"),
    "refined": Claim("answers", 1000, "λ of refined samples has a bracket, in 99 of 100 cases narrower than 1e-6"),
    "symmetry": Claim(
        "answers",
        300,
        "Mirror images of layouts have the same λ under the model that answers, to 1e-9 by faces and by cells",
    ),
    "time_limits": Claim(
        "searches", 200, "jld explore --seconds S ends within 1.1 S + 2 s with a layout, its page and its best λ"
    ),
    "trials": Claim("searches", 2000, "what the exact driver proves of a small scene is the best of all its layouts"),
    "units": Claim(
        "answers",
        1000,
        "λ is the same in other units to 1e-9, elsewhere and in another order of elements within the bracket",
    ),
    "vertex_rates": Claim(
        "geometry",
        300,
        "derivatives of λ by vertices agree with fourth-order differences to 1e-7 in the plane, 1e-6 in space",
    ),
}


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
