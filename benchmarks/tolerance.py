"""Which tolerance gives a λ that units and rotation leave alone to 1e-9, and what it costs.

Every labelling goes the usual way, solve, project, prove and repair where that is needed, with tolerance × margin (the
distance kept from the boundary of the yield sets, see Template.program) in place of the usual ones. Error: of
the middle of the bracket, against dual simplex at 1e-10. Change: of that λ when the assembly is turned by 37.3° and
put in mm and MN. Repaired: the first answer did not prove both bounds. Times are processor times, repairs included.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.common import about, random_segmentations, scene, table, wall, write
from jld_core import Assembly, LimitAnalysis
from jld_core.arrays import Bits, Floats
from jld_core.limit import Proof, load_scale, relative_width
from jld_core.program import Template
from jld_core.solvers import ClarabelSolver, HighsSolver, RawStatus

TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
MARGINS = (0.0, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8)
SEED = 3
INVARIANCE = 1e-9


@dataclass(frozen=True)
class Case:
    """An assembly, the same one moved, labellings that collapse, and their λ by simplex."""

    template: Template
    moved: Template
    labellings: Bits
    load_factors: Floats


def moved(assembly: Assembly, degrees: float = 37.3, length: float = 1e3, force: float = 1e-6) -> Assembly:
    """The assembly turned and in other units; λ does not change, for body loads and unit forces in those units."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[c, -s], [s, c]]).T
    stress = force / length**2
    e, f, m = assembly.elements, assembly.interfaces, assembly.strengths

    def loads(values: Floats) -> Floats:
        return np.column_stack([values[:, :2] @ turn * force, values[:, 2] * force * length])

    return replace(
        assembly,
        elements=replace(
            e,
            centroid=e.centroid @ turn * length,
            volume=e.volume * length**3,
            weight=e.weight @ turn * force,
            shape=tuple(shape @ turn * length for shape in e.shape),
        ),
        interfaces=replace(
            f,
            origin=f.origin @ turn * length,
            normal=f.normal @ turn,
            e1=f.e1 @ turn,
            l1=f.l1 * length,
            l2=f.l2 * length,
            area=f.area * length**2,
            polygon=tuple(ends @ turn * length for ends in f.polygon),
        ),
        strengths=replace(
            m,
            tension=m.tension * stress,
            shear=m.shear * stress,
            crush_dry=m.crush_dry * stress,
            crush_inner=m.crush_inner * stress,
        ),
        dead=loads(assembly.dead),
        live=loads(assembly.live),
    )


def case(assembly: Assembly, labellings: Bits) -> Case:
    """Keep the labellings that simplex finds to collapse at a λ that is not zero."""
    template, kept, values = Template(assembly), [], []
    for labels in labellings:
        raw = HighsSolver().solve(template.program(labels))
        if raw.status is RawStatus.OPTIMAL and raw.point[-1] * template.scaling.load > load_scale(template.assembly):
            kept.append(labels)
            values.append(float(raw.point[-1]) * template.scaling.load)
    return Case(template, Template(moved(assembly)), np.array(kept), np.array(values))


def prove(analysis: LimitAnalysis, labels: Bits) -> tuple[float, float, Proof, float]:
    """λ in scene units, relative width of its bracket, the proof, seconds."""
    start = time.process_time()
    proof = analysis.prove(labels)
    spent = time.process_time() - start
    scale, floor = (
        analysis.template.scaling.load,
        load_scale(analysis.template.assembly) / analysis.template.scaling.load,
    )
    middle = 0.5 * (proof.low + proof.high) if math.isfinite(proof.high - proof.low) else proof.guess
    return middle * scale, relative_width(proof.low, proof.high, floor), proof, spent


def measure(cases: list[Case], tolerance: float, margin: float) -> tuple[list[str], float, float]:
    """One row of a table (error, width, change, shares repaired and solved again, ms), largest change, ms."""
    errors: list[float] = []
    widths: list[float] = []
    changes: list[float] = []
    seconds: list[float] = []
    repaired = again = 0
    for given in cases:
        pair = []
        for template in (given.template, given.moved):
            analysis = LimitAnalysis(template.assembly, template=template, margin=margin)
            analysis.route = ClarabelSolver(tolerance)
            analysis.prove(given.labellings[0])  # what is made once per assembly is not what is measured
            analysis.repair.opening()
            pair.append([prove(analysis, labels) for labels in given.labellings])
        for here, there, exact in zip(*pair, given.load_factors, strict=True):
            errors.append(abs(here[0] - exact) / exact)
            changes.append(abs(here[0] - there[0]) / exact)
            widths.append(here[1])
            repaired += len(here[2].route) > 1
            again += here[2].solves > 1
            seconds.append(here[3])
    count = len(errors)
    row = [
        f"{tolerance:.0e}",
        f"{margin:.0e}" if margin else "0",
        f"{np.median(errors):.0e} / {max(errors):.0e}",
        f"{np.median(widths):.0e} / {max(widths):.0e}",
        f"{np.median(changes):.0e} / {max(changes):.0e}",
        f"{100 * repaired / count:.0f} %",
        f"{100 * again / count:.0f} %",
        f"{1e3 * np.mean(seconds):.2f}",
    ]
    return row, max(changes), 1e3 * float(np.mean(seconds))


def sets() -> dict[str, list[Case]]:
    """Walls by their own labels; grids under random segmentations, inner faces from strong to weak."""
    walls = [scene(f"ferris_tinloi_{n}") for n in (1, 2, 4)]
    beam = scene("flat_beam_arch")
    grids = [(wall(6, 8, strength, strength), 8) for strength in (2e6, 2e4, 2e3)] + [(beam, 16)]
    return {
        "Ferris–Tin-Loi walls 1, 2 and 4": [case(assembly, assembly.labels[None]) for assembly in walls],
        "6 × 8 cells (σt = τ from 2 MPa to 2 kPa) and the flagship": [
            case(assembly, random_segmentations(assembly, count, SEED)) for assembly, count in grids
        ],
    }


def main() -> None:
    """Measure all pairs and write benchmarks/results/tolerance.md."""
    head = [
        "tolerance",
        "margin",
        "error of λ, median / most",
        "bracket, median / most",
        "change of λ when moved, median / most",
        "repaired",
        "solved again",
        "ms",
    ]
    parts = ["# Tolerance and margin\n\n" + about(__doc__)]
    for name, cases in sets().items():
        count = sum(len(given.labellings) for given in cases)
        diagonal = [measure(cases, size, size) for size in TOLERANCES]
        parts.append(f"## {name}: {count} labellings\n\nBoth of one size:\n\n{table(head, [d[0] for d in diagonal])}")
        still = [(size, d[2]) for size, d in zip(TOLERANCES, diagonal, strict=True) if d[1] <= INVARIANCE]
        sizes = ", ".join(f"{size:.0e} ({spent / diagonal[0][2]:.2f} times the time at 1e-08)" for size, spent in still)
        parts.append(f"Not changed by more than {INVARIANCE:.0e} at: {sizes or 'none of them'}.")
        across = [measure(cases, 1e-12, margin) for margin in MARGINS]
        parts.append(f"The margin alone, at a tolerance of 1e-12:\n\n{table(head, [a[0] for a in across])}")
        plain = [measure(cases, size, 0.0) for size in TOLERANCES]
        parts.append(f"The tolerance alone, without margin:\n\n{table(head, [p[0] for p in plain])}")
    write("tolerance", "\n\n".join(parts))


if __name__ == "__main__":
    main()
