"""Does it pay to build the program once? Per labelling of a wall of 90 faces, paired ratios of one run.

Ours: relabel, solve at our tolerance, project, prove both bounds. Against it: one bare call of Clarabel with its
default settings on the same data, proving nothing; and the same problem stated and solved in CVXPY for each
labelling at the solver's default tolerances, once as one would write it (vectors over all faces) and once with our own
matrix handed over, which leaves CVXPY the least to do. Times are processor times, as other work may share the cores.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp

from benchmarks.common import random_segmentations, table, wall, write
from benchmarks.stated import CLARABEL_DEFAULT, stated
from jld_core import LimitAnalysis, Status
from jld_core.arrays import Bits
from jld_core.program import ConicProgram, Template
from jld_core.solvers import RawSolution
from jld_core.solvers.cvxpy import CvxpySolver

LABELLINGS, OF_CVXPY, SEED = 200, 40, 1
STRENGTHS = {
    "σt 2 MPa, τ 0.2 MPa (the paper's)": (2e6, 2e5),
    "σt = τ = 20 kPa": (2e4, 2e4),
    "σt = τ = 2 kPa": (2e3, 2e3),
}


def bare(program: ConicProgram) -> Any:
    """Clarabel as it comes: a new solver with default settings, set up and run."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    s = program.structure
    cones = [clarabel.ZeroConeT(s.equalities), clarabel.NonnegativeConeT(s.linear)]
    cones += [clarabel.SecondOrderConeT(size) for size in s.cones]
    nothing = sp.csc_matrix((s.shape[1], s.shape[1]))
    matrix = sp.csc_matrix((program.data, s.indices, s.indptr), shape=s.shape)
    return clarabel.DefaultSolver(nothing, program.objective, matrix, program.rhs, cones, settings).solve()


def handed(route: CvxpySolver, template: Template, labels: Bits) -> RawSolution:
    """The scaled program of our template, relabelled and handed to CVXPY."""
    return route.solve(template.program(labels))


def clock(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    answer = work()
    return time.process_time() - start, answer


def middle(values: list[float]) -> str:
    """Median and the middle half."""
    low, mid, high = np.quantile(values, [0.25, 0.5, 0.75])
    return f"{mid:.2f} ({low:.2f}–{high:.2f})"


def measure(tension: float, shear: float) -> list[str]:
    """One row of the table: faces, milliseconds, ratios, worst bracket, how many needed repair."""
    assembly = wall(6, 8, tension, shear)
    labellings = random_segmentations(assembly, LABELLINGS, SEED)
    template, reference = Template(assembly), CvxpySolver("CLARABEL", **CLARABEL_DEFAULT)
    analysis = LimitAnalysis(assembly, template=template)
    analysis.prove(labellings[0])
    bare(template.program(labellings[0]))
    reference.solve(template.program(labellings[0]))
    stated(assembly, labellings[0])
    ours: list[float] = []
    others: list[float] = []
    ratios: dict[str, list[float]] = {"bare": [], "stated": [], "handed": []}
    widths: list[float] = []
    off, repaired = 0.0, 0
    for number, labels in enumerate(labellings):
        # what is compared runs side by side, and takes turns in going first
        turns: dict[str, Callable[[], Any]] = {
            "ours": partial(analysis.prove, labels),
            "bare": partial(bare, template.program(labels)),
        }
        if number < OF_CVXPY:
            turns["stated"] = partial(stated, assembly, labels)
            turns["handed"] = partial(handed, reference, template, labels)
        names = list(turns) if number % 2 == 0 else list(turns)[::-1]
        found = {name: clock(turns[name]) for name in names}
        seconds = {name: spent for name, (spent, _) in found.items()}
        ours.append(1e3 * seconds["ours"])
        others.append(1e3 * seconds["bare"])
        ratios["bare"].append(seconds["ours"] / seconds["bare"])
        for name in ("stated", "handed"):
            if name in seconds:
                ratios[name].append(seconds[name] / seconds["ours"])
        status, proof = found["ours"][1]
        if status is Status.COLLAPSE and "stated" in found:
            off = max(off, abs(found["stated"][1] - proof.guess * template.scaling.load) / abs(found["stated"][1]))
        if status is Status.COLLAPSE:
            widths.append((proof.high - proof.low) / max(abs(proof.high), abs(proof.low)))
        repaired += proof.solves > 1
    return [
        str(len(assembly.interfaces)),
        f"{np.median(ours):.2f}",
        f"{np.median(others):.2f}",
        *(middle(ratios[name]) for name in ("bare", "stated", "handed")),
        f"{max(widths):.0e}",
        f"{off:.0e}",
        f"{repaired} of {LABELLINGS}",
    ]


def main() -> None:
    """Measure all strengths and write benchmarks/results/build_once.md."""
    head = [
        "inner faces",
        "faces",
        "ours, ms",
        "bare Clarabel, ms",
        "ours / bare (target ≤ 1.5)",
        "CVXPY, stated anew / ours (target ≥ 3)",
        "CVXPY, our matrix / ours",
        "widest bracket, relative",
        "CVXPY differs by, at most",
        "needed more than one solve",
    ]
    rows = [[name, *measure(*strengths)] for name, strengths in STRENGTHS.items()]
    text = (
        "# Building once\n\n"
        f"6 × 8 cells on a row of supports, horizontal body load, {LABELLINGS} random segmentations (seed {SEED}; "
        f"CVXPY on {OF_CVXPY} of them). Ours is relabelling, solving and proving both bounds; bare Clarabel is one new "
        "solver with default settings on the same data, which proves nothing; CVXPY states and solves the same "
        "problem anew at Clarabel's default tolerances, as one would write it and with our matrix handed over. Medians "
        "of paired ratios of processor times, in brackets the middle half.\n\n"
    )
    write("build_once", text + table(head, rows))


if __name__ == "__main__":
    main()
