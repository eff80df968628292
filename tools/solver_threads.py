"""One compiled problem asked from four threads, for the sanitizer of threads: `python -m tools.solver_threads`."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from benchmarks.common import random_segmentations
from benchmarks.scenes import wall

from jld_core.arrays import Floats
from jld_core.batch.batch_solver import ConflictRequest
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.case_relaxation import relaxation_of


def main() -> None:
    """Bound and shrink labellings of a wall in four threads that share one compiled problem; exit 1 where an answer
    differs from that of one thread. `make sanitize` runs this with a batch solver that reports data races."""
    assembly = wall(4, 5, 5e3, 5e3)
    relaxation = relaxation_of(assembly, [LimitAnalysis(assembly)])
    if relaxation is None or not relaxation.batched:
        sys.exit("no kernel to test")
    free = assembly.free_faces
    labellings = random_segmentations(assembly, 160, 0)

    def work(part: int) -> tuple[Floats, list[float | None]]:
        mine = labellings[part * 40 : part * 40 + 40]
        thresholds = np.full(len(mine), 0.5)
        found = relaxation.refute_all(mine, np.zeros_like(mine), thresholds)
        shrunk = relaxation.minimize_conflicts(ConflictRequest(mine, free, thresholds))
        return np.array([np.nan if one is None else one.bound for one in found]), [one.bound for one in shrunk]

    alone = [work(part) for part in range(4)]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(5):
            together = list(pool.map(work, range(4)))
            for one, other in zip(alone, together, strict=True):
                if not np.array_equal(one[0], other[0], equal_nan=True) or one[1] != other[1]:
                    sys.exit("four threads have other answers than one")
    print("four threads have the answers of one")


if __name__ == "__main__":
    main()
