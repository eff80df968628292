"""One wall by one route in a process of its own, so that its peak memory is its own: prints one line of JSON."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from studies.families import planar_running_bond, running_bond

from jld_core import LimitAnalysis, build_assembly
from jld_core.program import ConicProgram, Template
from jld_core.scene import Scene
from jld_core.solvers import RawSolution, Solver

CASES: dict[str, Callable[[int], Scene]] = {
    "out of plane": lambda courses: running_bond(courses, direction=(0.0, 1.0, 0.0)),
    "in plane": lambda courses: running_bond(courses, direction=(1.0, 0.0, 0.0)),
    "planar": planar_running_bond,
}
PHASES = ("scene", "assembly", "program", "solve", "prove", "stands")
"""Validation of the document, geometry and contacts, the conic program, the route's own answer, what is made of
it (projections, repairs), and whether λ = 0 is admissible."""


class Timed(Solver):
    """A route whose time is kept apart."""

    def __init__(self, route: Solver) -> None:
        self.first_solver, self.name, self.seconds, self.iterations = route, route.name, 0.0, 0

    def solve(self, program: ConicProgram) -> RawSolution:
        start = time.process_time()
        answer = self.first_solver.solve(program)
        self.seconds += time.process_time() - start
        self.iterations += answer.iterations
        return answer


def peak() -> float:
    """Highest resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def measure(case: str, courses: int, solver: str) -> dict[str, Any]:
    """Processor time and memory by phase, and the bracket. solver: name of the route."""
    seconds, memory = dict.fromkeys(PHASES, 0.0), dict.fromkeys(PHASES, 0.0)

    @contextmanager
    def phase(name: str) -> Iterator[None]:
        start = time.process_time()
        yield
        seconds[name] += time.process_time() - start
        memory[name] = peak()

    wall_clock = time.perf_counter()
    with phase("scene"):
        scene = CASES[case](courses)
    with phase("assembly"):
        assembly = build_assembly(scene)
    with phase("program"):
        analysis = LimitAnalysis(assembly, solver=solver, template=Template(assembly), reference=assembly.labels)
    timed = Timed(analysis.first_solver)
    analysis.first_solver = timed
    with phase("prove"):
        result = analysis.solve(stands=False)
    seconds["solve"], memory["solve"] = timed.seconds, memory["prove"]
    seconds["prove"] -= timed.seconds
    with phase("stands"):
        stands = analysis.stands(assembly.labels)
    return {
        "case": case,
        "solver": solver,
        "blocks": len(assembly.elements.free),
        "faces": len(assembly.interfaces),
        "status": str(result.status),
        "stands": stands,
        "load_factor": result.load_factor,
        "gap": result.gap,
        "route": list(result.solve_log),
        "iterations": timed.iterations,
        "seconds": seconds,
        "memory": memory,
        "wall": time.perf_counter() - wall_clock,
    }


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
