"""How time and memory grow with the size of a wall: phase by phase, our own route beside Clarabel."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
from studies.families import planar_running_bond, running_bond

from benchmarks.common import apart, table, write
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


RUNS: Final = {
    ("out of plane", "schur"): (10, 20, 40, 60, 100),
    ("in plane", "schur"): (10, 20, 40, 60, 100),
    ("planar", "schur"): (20, 60, 100, 140),
    ("out of plane", "clarabel"): (10, 20, 40, 60),
    ("in plane", "clarabel"): (10, 20, 40),
    ("planar", "clarabel"): (20, 60, 100),
}
"""Courses of the walls. Clarabel's are as far as the whole stays within a quarter of an hour."""
Found = dict[str, Any]


def run(case: str, courses: int, solver: str) -> Found:
    """Measure one wall in a process of its own."""
    found: Found = apart("scale.measure", case, courses, solver)
    print(f"{case}, {found['blocks']} blocks, {solver}: {proof_time(found):.1f} s, {found['gap']:.0e}", flush=True)
    return found


def proof_time(found: Found) -> float:
    """Processor seconds from the document to the bracket."""
    return float(sum(found["seconds"][name] for name in PHASES if name != "stands"))


def set_up(found: Found) -> float:
    """Processor seconds from the document to the program."""
    return float(sum(found["seconds"][name] for name in ("scene", "assembly", "program")))


def exponent(series: list[Found], value: Any) -> float:
    """Slope of log value over log blocks, by least squares, from 400 blocks up."""
    large = [one for one in series if one["blocks"] >= 400]
    if len(large) < 2:
        return float("nan")
    return float(np.polyfit(np.log([o["blocks"] for o in large]), np.log([value(o) for o in large]), 1)[0])


def main() -> None:
    """Measure all walls; write the tables and the picture."""
    results = {key: [run(key[0], courses, key[1]) for courses in sizes] for key, sizes in RUNS.items()}
    write("scale", "\n\n".join([_text(), _walls(results), _exponents(results)]))


def _text() -> str:
    return (
        "# Scale\n\nWalls in running bond (bricks 0.2 × 0.1 × 0.06 m, μ 0.65, every face dry; spatial ones of two "
        "wythes) under a horizontal body load. Each wall and route in a process of its own, one BLAS thread; processor "
        "seconds, and the highest resident memory after the phase. *schur* is our interior point on the Schur "
        "complement, which large assemblies get by default; *clarabel* the same program by Clarabel. Scene: validation "
        "of the document. Assembly: geometry and contacts. Prove: projection, bounds, and repairs where an answer does "
        "not prove itself (for both routes, those are solved by *schur* where the program is large). λ = 0: is the "
        "wall standing unpushed? It is not part of the time to the bracket. A second BLAS thread could help the dense "
        "kernels alone, about half of the factorisation at 10 100 blocks and less below; it was not measured, since "
        "the machine was shared."
    )


def _walls(results: dict[tuple[str, str], list[Found]]) -> str:
    head = ["wall", "route", "blocks", "faces", *(f"{p} s" if p != "stands" else "λ = 0 s" for p in PHASES)]
    head += ["to the bracket, s", "set-up share", "MB: program", "MB: proven", "iterations", "λ", "width", "repairs"]
    rows = []
    for (case, solver), series in results.items():
        for one in series:
            rows.append(
                [case, solver, str(one["blocks"]), str(one["faces"])]
                + [f"{one['seconds'][p]:.2f}" for p in PHASES]
                + [
                    f"{proof_time(one):.2f}",
                    f"{100.0 * set_up(one) / proof_time(one):.1f} %",
                    f"{one['memory']['program']:.0f}",
                    f"{one['memory']['prove']:.0f}",
                    str(one["iterations"]),
                    f"{one['load_factor']:.9f}",
                    f"{one['gap']:.0e}" + ("" if one["status"] == "collapse" else f" ({one['status']})"),
                    ", ".join(one["route"][1:]) or "none",
                ]
            )
    return table(head, rows)


def _exponents(results: dict[tuple[str, str], list[Found]]) -> str:
    """Growth of time and memory as powers of the number of blocks."""
    head = ["wall", "route", "set-up", "solve", "prove", "memory"]
    rows = [
        [case, solver]
        + [
            f"{exponent(series, value):.2f}"
            for value in (
                set_up,
                lambda one: one["seconds"]["solve"],
                lambda one: max(one["seconds"]["prove"], 1e-3),
                lambda one: one["memory"]["prove"],
            )
        ]
        for (case, solver), series in results.items()
    ]
    return "Exponents of blocks, fitted from 400 blocks up:\n\n" + table(head, rows)


if __name__ == "__main__":
    main()
