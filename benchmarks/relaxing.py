"""The exact driver's relaxations in the batch solver's lanes, and one at a time: times, and verdicts on the same ones.

In lanes, as the driver asks: labellings that are too weak at a threshold are shrunk to conflicts with their neighbours,
one relaxation after the other, in one call; the time of those calls, with all that it takes to trust what they say
(each motion is weighed again by the core's own support functions), over the relaxations in them. One at a time: some of
the same labellings are shrunk by the same rules without the batch solver, by Clarabel, as where there is none; the same
partial labellings by HiGHS where rows are linear, and once more in lanes, 32 at a time: verdicts are whether the
threshold is refuted. Those that are not end where the batch solver's own state is admissible and carries more:
iterations
with a threshold, and to the end. Processor time, all in one run.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.exact import wall
from benchmarks.search_scenes import ENUMERATED
from jld_core import Scene, build_assembly
from jld_core.arrays import Bits, Bools, Floats
from jld_core.batch import ConflictRequest
from jld_core.batch.library import described
from jld_core.limit import LimitAnalysis
from jld_core.limit.dual_bounds import MinimizedConflict
from jld_core.limit.relaxation import Relaxation
from jld_core.solvers import make_solver
from jld_explore.drivers.exact.conflict_generation import ConflictGenerator, conflict_of
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.space import search_space

CASES: Final[dict[str, tuple[Scene, float]]] = {
    "wall 6 × 8, s = 3, 20 kPa": (wall(6, 8, 3, 2e4), 0.7164),
    "wall 5 × 7, s = 3, 5 kPa": (wall(5, 7, 3, 5e3), 0.6495),
    "wall 8 × 10, s = 3, 20 kPa": (wall(8, 10, 3, 2e4), 0.70),
    "flagship, 24 faces": (ENUMERATED["flagship"](), 12.7),
}
"""Scene and threshold on λ."""

COUNT: Final = 4_000
ALONE: Final = 300
BY_HIGHS: Final = 50
"""Relaxations in lanes, and how many are solved one at a time."""

TOGETHER: Final = 32


@dataclass
class Asked:
    """Partial labellings: labels and undecided faces (m,) of each; refuted: by what was asked first."""

    labels: list[Bits] = field(default_factory=list)
    undecided: list[Bools] = field(default_factory=list)
    refuted: list[bool] = field(default_factory=list)


def shrunk(scene: Scene, threshold: float) -> tuple[Relaxation, Bools, list[Bits], float, float]:
    """Labellings shrunk as the driver does: relaxation, candidates, labellings, relaxations, seconds of each."""
    assembly = build_assembly(scene)
    space, relaxation = search_space(scene, assembly), Relaxation(LimitAnalysis(assembly))
    drawn: list[Bits] = []
    spent = 0.0
    minimize_conflicts = relaxation.minimize_conflicts

    def timed(asked: ConflictRequest) -> list[MinimizedConflict]:
        nonlocal spent
        drawn.extend(asked.labellings)
        start = time.process_time()
        found = minimize_conflicts(asked)
        spent += time.process_time() - start
        return found

    formula = Formula(space, possible_blocks(space))
    context = ProofContext(space, formula.blocks, space.candidates, 0, (), relaxation)
    generator = ConflictGenerator(context)
    generator.begin(formula)
    with patch.object(relaxation, "minimize_conflicts", timed):
        while relaxation.solves < COUNT and not generator.step(threshold / relaxation.template.scaling.load).exhausted:
            pass
    return relaxation, space.candidates, drawn, relaxation.solves, spent / relaxation.solves


def one_at_a_time(relaxation: Relaxation, free: Bools, drawn: list[Bits], threshold: float) -> tuple[Asked, float]:
    """What shrinking some labellings asks for, and seconds of each, by the solver."""
    asked, spent = Asked(), 0.0
    refute = relaxation.refute_all

    def listening(labels: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None) -> Any:
        nonlocal spent
        start = time.process_time()
        found = refute(labels, undecided, thresholds, thorough)
        spent += time.process_time() - start
        asked.labels.append(labels[0].copy())
        asked.undecided.append(undecided[0].copy())
        asked.refuted.append(found[0] is not None)
        return found

    with patch.object(relaxation, "_batch", None), patch.object(relaxation, "refute_all", listening):
        # from all of the search, not its beginning
        for labels in drawn[:: max(1, len(drawn) // 60)]:
            if len(asked.labels) < ALONE:
                conflict_of(relaxation, labels, free, threshold)
    return asked, spent / len(asked.labels)


def again(relaxation: Relaxation, asked: Asked, threshold: float, count: int, together: int) -> tuple[float, int]:
    """Seconds of each of the first `count`, and verdicts that are the same."""
    same, start = 0, time.process_time()
    for low in range(0, count, together):
        part = slice(low, min(low + together, count))
        labels, undecided = np.array(asked.labels[part]), np.array(asked.undecided[part])
        found = relaxation.refute_all(labels, undecided, np.full(len(labels), threshold))
        same += sum((one is not None) == known for one, known in zip(found, asked.refuted[part], strict=True))
    return (time.process_time() - start) / count, same


def iterations(relaxation: Relaxation, asked: Asked, threshold: float) -> tuple[float, float]:
    """Of those that are not refuted, on the mean: with a threshold to end at, and without."""
    kernel = relaxation._batch
    assert kernel is not None
    left = [k for k, refuted in enumerate(asked.refuted) if not refuted]
    labels, undecided = np.array([asked.labels[k] for k in left]), np.array([asked.undecided[k] for k in left])
    early = kernel.solve(labels, undecided=undecided, thresholds=np.full(len(left), threshold))
    whole = kernel.solve(labels, undecided=undecided)
    return float(early.iterations.mean()), float(whole.iterations.mean())


def measured(scene: Scene, load: float) -> list[str]:
    """A row of the table."""
    relaxation, free, drawn, count, lanes = shrunk(scene, load)
    threshold = load / relaxation.template.scaling.load
    asked, clarabel = one_at_a_time(relaxation, free, drawn, threshold)
    alone = len(asked.labels)
    batch, same = again(relaxation, asked, threshold, alone, TOGETHER)
    highs, other, some = "", "", min(BY_HIGHS, alone)
    if not relaxation.template.structure.cones:
        with patch.object(relaxation, "_batch", None), patch.object(relaxation, "_solver", make_solver("highs")):
            spent, agreed = again(relaxation, asked, threshold, some, 1)
        highs, other = f"{1e6 * spent:.0f}", f"{agreed} of {some}"
    cells = [f"{count:.0f}", f"{1e6 * lanes:.0f}", f"{1e6 * clarabel:.0f}", f"**{clarabel / lanes:.0f}**", highs]
    early, whole = iterations(relaxation, asked, threshold)
    cells += [str(alone), f"{np.mean(asked.refuted):.0%}", f"{1e6 * batch:.0f}", f"{same} of {alone}", other]
    return [*cells, f"{early:.1f}", f"{whole:.1f}"]


def main() -> None:
    """Measure all cases and write benchmarks/results/relaxing.md."""
    rows = []
    for name, (scene, load) in CASES.items():
        rows.append([name, *measured(scene, load)])
        print(rows[-1], flush=True)
    head = ["scene", "relaxations in lanes", "µs each", "Clarabel, µs each", "times", "HiGHS, µs each"]
    head += ["solved one at a time", "refuted", "the same in lanes, µs each", "same verdict", "same as HiGHS"]
    head += ["not refuted: iterations", "to the end"]
    text = ["# Relaxations in lanes", about(__doc__), table(head, rows), f"{described().capitalize()}."]
    write("relaxing", "\n\n".join(text))


if __name__ == "__main__":
    main()
