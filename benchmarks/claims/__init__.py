"""Claims of the program, tested on random cases against independent routes.

``python -m benchmarks.claims`` tests every claim and writes ``benchmarks/results/claims.md``: claim, number of cases,
number of disagreements, for each version that was tested. ``make test`` tests a small share of the same cases.

Each family of claims is a module with a function ``run(first_seed, cases, seconds)`` that returns a `Tally`; `FAMILIES`
lists them with the number of cases of a whole run.
"""

from __future__ import annotations

from typing import Final

from benchmarks.claims.tally import Family, Tally, run_cases

FAMILIES: Final[dict[str, int]] = {
    "certificates": 300,
    "converged": 3000,
    "digits": 300,
    "fields": 500,
    "geometry": 3000,
    "laying": 1000,
    "loads": 560,
    "members": 200,
    "proofs": 3000,
    "refined": 1000,
    "symmetry": 300,
    "time_limits": 200,
    "trials": 2000,
    "units": 1000,
    "vertex_rates": 300,
}
"""Module of this package → number of cases of a whole run."""

__all__ = ["FAMILIES", "Family", "Tally", "run_cases"]
