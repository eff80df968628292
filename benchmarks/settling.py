"""What certificates are worth beside the batch solver: how many labellings past solves settle, and what each then
takes.

The same driver, seed and number of classes three times, one job: every labelling by the batch solver, no certificates;
with
certificates by the vertices of `ForceMethod`, as `--certificates` has them; and with certificates by what the batch
solver
leaves behind, its interior forces and mechanisms, proven by the core's own prover. Settled: the share that certificates
settle without a solve. Processor time of the whole study, set-up apart.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.search_scenes import ENUMERATED, LARGE, built
from benchmarks.spared import wall
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch.batch_solver import PROVEN
from jld_core.batch.library import described
from jld_core.limit import Batch, LimitAnalysis, Status
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_explore.drivers import make_driver
from jld_explore.evaluation import Evaluation, EvaluatorSettings, MakeEvaluator, evaluator_of
from jld_explore.evaluation.certificates import Proofs, forces_of, mechanism_of
from jld_explore.evaluation.evaluator import Evaluator
from jld_explore.settings import ExploreSettings
from jld_explore.study import Study

DRIVERS: Final = ("enumeration", "random", "genetic")
DECISION: Final = """**What follows.** Interior proofs are made sooner than vertices and settle less: they do not
replace the vertex method, which stays behind `--certificates` for machines without the batch solver. Where the batch
solver is, it
answers a layout sooner than either kind of certificate is asked, so no driver asks them by itself."""


def scenes() -> dict[str, tuple[Scene, int]]:
    """Scenes and classes asked."""
    return {
        "flagship, 24 faces": (ENUMERATED["flagship"](), 2_000),
        "wall 5 × 3, 20 kPa": (wall(), 2_000),
        "88 faces": (LARGE["planar 88 faces"](), 600),
    }


class Interior:
    """Evaluates with proofs of what the batch solver leaves behind."""

    def __init__(self, assembly: Assembly, settings: EvaluatorSettings) -> None:
        self._analysis = LimitAnalysis(assembly, gap=settings.model.gap)
        batch = Batch.of(self._analysis)
        assert batch is not None, "no kernel"
        self._batch, self._other = batch.batch, Evaluator(assembly, settings)

    def evaluate_all(self, labellings: Bits, *_: Any) -> list[Evaluation]:
        """Evaluate labellings (k, m)."""
        found = self._batch.solve(labellings, vectors=True)
        assert found.forces is not None
        assert found.velocity is not None
        scale = self._analysis.template.scaling.load
        evaluations = []
        for k, labels in enumerate(labellings):
            if found.verdict[k] != PROVEN:
                evaluations.append(self._other.evaluate(labels))
                continue
            low, high = scale * float(found.low[k]), scale * float(found.high[k])
            proofs = self._proofs(found.forces[k], float(found.low[k]), found.velocity[k], labels)
            evaluations.append(Evaluation(Status.COLLAPSE, low, high, 0.5 * (low + high), proofs=proofs))
        return evaluations

    def _proofs(self, forces: Floats, load: float, velocity: Floats, labels: Bits) -> Proofs:
        template, prover = self._analysis.template, self._analysis.prover
        state, motion = prover.state(np.append(forces.ravel(), load), labels), prover.motion(velocity, labels)
        return Proofs(
            (forces_of(template, state, labels),) if state.admissible else (),
            (mechanism_of(template, motion, labels),) if motion.margin >= 0.0 else (),
        )


def spent(scene: Scene, driver: str, count: int, make: MakeEvaluator, certificates: bool) -> tuple[float, float]:
    """Seconds of the processor for each labelling, and the share that certificates settled."""
    assembly, space = built(scene)
    with tempfile.TemporaryDirectory() as folder, one_thread():
        settings = ExploreSettings(budget=count, certificates=certificates)
        study = Study(scene, assembly, space, make_driver(driver, space, 0), Path(folder) / "out", settings, make=make)
        start = time.process_time()
        study.run()
        return (time.process_time() - start) / study.evaluated, 1.0 - study.solved / study.evaluated


def main() -> None:
    """Measure and write benchmarks/results/settling.md."""
    rows = []
    for name, (scene, count) in scenes().items():
        for driver in DRIVERS:
            spent(scene, driver, 32, evaluator_of, False)
            plain, _ = spent(scene, driver, count, evaluator_of, False)
            vertex, by_vertex = spent(scene, driver, count, evaluator_of, True)
            inside, by_inside = spent(scene, driver, count, Interior, True)
            cells = [f"{1e6 * plain:.0f}", f"{by_vertex:.0%}", f"{1e6 * vertex:.0f}", f"{by_inside:.0%}"]
            cells += [f"{1e6 * inside:.0f}", f"{vertex / plain:.1f}", f"{inside / plain:.1f}"]
            rows.append([name, driver, str(count), *cells])
            print(rows[-1], flush=True)
    head = ["scene", "driver", "classes", "kernel alone, µs", "settled by vertices", "with them, µs"]
    head += [
        "settled by interior proofs",
        "with them, µs",
        "vertices: times kernel alone",
        "interior: times kernel alone",
    ]
    text = [about(__doc__), table(head, rows), DECISION, f"{described().capitalize()}."]
    write("settling", "\n\n".join(["# Certificates beside the kernel", *text]))


if __name__ == "__main__":
    main()
