"""Which of the fallbacks for one labelling decide: a census over hard, random and large cases.

`python -m benchmarks.fallbacks [SECONDS]` writes the table; SECONDS of the clock for each group of cases (400). Tried:
attempts in which the condition of a fallback held. Status: the status changed in it. Narrower: the bracket did, by more
than a tenth of it. Decides: without that fallback alone the status of the attempt is another one, or its bracket wider
than the gap; not asked of large cases, where each answer takes many seconds.
"""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks import large
from benchmarks.batch_solver import HARD, SEGMENTED, SPATIAL, labellings_of
from benchmarks.claims.answers import drawn_converged
from benchmarks.common import about, table, write
from benchmarks.hard_cases import hard_cases
from benchmarks.scenes import strength
from jld_core import Assembly, build_assembly, parse_scene
from jld_core.arrays import Bits
from jld_core.limit import Proof, analysis
from jld_core.limit.analysis import Fallback, ProofAttempt, run_fallbacks
from jld_core.limit.options import SolveOptions
from jld_core.models import limit_analysis
from jld_core.models.case_analysis import solve
from jld_core.models.rigid_blocks import FALLBACKS_BY_CONDENSE
from jld_explore import search_space
from jld_explore.drivers import make_driver

SECONDS: Final = 400.0
NAMES: Final = tuple(fallback.name for fallback in FALLBACKS_BY_CONDENSE["auto"])
Case = tuple[Assembly, Bits, SolveOptions]


def hard() -> Iterator[Case]:
    """Hard cases, and a few labellings of each hard scene of the batch solver, some by bending in the kern form."""
    for case in hard_cases():
        assembly = case.make()
        if len(assembly.elements) < 1000:
            yield assembly, assembly.labels if case.labels is None else case.labels(assembly), SolveOptions()
    for scene in (SEGMENTED | HARD | SPATIAL).values():
        assembly = scene.make()
        model = SolveOptions(inner_bending="kern" if scene.kern else "uncoupled")
        for labels in labellings_of(assembly, scene)[:5]:
            yield assembly, labels, model


def random() -> Iterator[Case]:
    """Scenes of the claim `converged`: friction of 45°, crushing, weak and strong cracks, without weight."""
    for seed in range(3000):
        assembly, labels = drawn_converged(seed)
        yield assembly, labels, SolveOptions()


def large_ones() -> Iterator[Case]:
    """Walls of 900 and 3 025 cells with each change of benchmarks/large.py, cubes, and dry walls with cones."""
    kinds = (*large.KINDS.values(), strong)
    for kind, edge, changes in (("planar", 30, kinds), ("spatial", 5, (large.plain, strong)), ("planar", 55, kinds)):
        for change in changes:
            content = large.document(kind, edge)
            change(content)
            scene = parse_scene(content)
            assembly = build_assembly(scene)
            for labels in make_driver("random", search_space(scene, assembly), 0).ask(2)[:2]:
                yield assembly, labels, SolveOptions()
    for name, courses in (("out of plane", 20), ("in plane", 20), ("out of plane", 40), ("in plane", 40)):
        assembly = build_assembly(large.DRY_WALLS[name](courses))
        yield assembly, assembly.labels, SolveOptions()


def strong(content: dict[str, Any]) -> None:
    """Inner faces a thousand times as strong."""
    content["materials"]["inner"] = strength(2e9)


class Census:
    """Counts of one group of cases."""

    def __init__(self) -> None:
        self.attempts, self.last, self.proof = 0, list[str](), Proof()
        self.tried: Counter[str] = Counter()
        self.status: Counter[str] = Counter()
        self.narrower: Counter[str] = Counter()
        self.decides: Counter[str] = Counter()

    def run(self, attempt: ProofAttempt, fallbacks: tuple[Fallback, ...]) -> Proof:
        """Run fallbacks as `run_fallbacks` does, and count."""
        self.attempts += 1
        mine: list[str] = []
        for fallback in fallbacks:
            if fallback.when(attempt) and not attempt.settled:
                before, width = attempt.proof.status, _width(attempt.proof)
                fallback.run(attempt)
                if not attempt.settled:
                    attempt.proof.status = attempt.analysis.status_of(attempt.proof)
                mine.append(fallback.name)
                self.status[fallback.name] += before is not attempt.proof.status
                self.narrower[fallback.name] += _width(attempt.proof) < 0.9 * width
        self.tried.update(dict.fromkeys(mine, 1))
        self.last, self.proof = mine, attempt.proof
        return attempt.proof

    def ablate(self, case: Case) -> None:
        """Solve a case, and again without each of the fallbacks that were tried but the first solver."""
        assembly, labels, model = case
        with patch.object(analysis, "run_fallbacks", self.run):
            solve(assembly, labels, **model.facts())
        whole = self.proof
        for name in {*self.last} - {"first solver"}:
            kept = tuple(one for one in FALLBACKS_BY_CONDENSE["auto"] if one.name != name)
            analysed = limit_analysis(assembly, model, reference=labels, single_labelling=True)
            proof = run_fallbacks(ProofAttempt(analysed, labels), kept)
            wider = _width(whole) <= model.gap < _width(proof)
            self.decides[name] += proof.status is not whole.status or wider


def _width(proof: Proof) -> float:
    """Relative width of a bracket, infinite where a bound is missing."""
    width = (proof.high - proof.low) / max(abs(proof.low), abs(proof.high), 1e-6)
    return width if math.isfinite(width) else math.inf


GROUPS: Final[dict[str, Callable[[], Iterator[Case]]]] = {"hard": hard, "random": random, "large": large_ones}


def main() -> None:
    """Take the census and write the table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    found: dict[str, Census] = {}
    for name, cases in GROUPS.items():
        census, start = found.setdefault(name, Census()), time.perf_counter()
        for case in cases():
            if time.perf_counter() - start > seconds:
                break
            if name == "large":
                with patch.object(analysis, "run_fallbacks", census.run):
                    solve(case[0], case[1])
            else:
                census.ablate(case)
        print(name, census.attempts, census.tried, census.decides, flush=True)
    head = ["fallback"]
    for name, census in found.items():
        head += [f"{name} ({census.attempts}): tried", "status", "narrower", *(["decides"] if name != "large" else [])]
    rows = []
    for fallback in NAMES:
        row = [fallback]
        for name, census in found.items():
            counts = [census.tried, census.status, census.narrower, *([census.decides] if name != "large" else [])]
            row += [str(count[fallback]) for count in counts]
        rows.append(row)
    write("fallbacks", "\n\n".join(["# Fallbacks that decide", about(__doc__), table(head, rows)]))


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        main()
