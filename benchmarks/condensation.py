"""Rigid blocks, cracked on demand, against the full model: time ratio, agreement and how often the rigid λ is exact."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.common import random_segmentations, table, wall, write
from jld_core import LimitAnalysis, Status
from jld_core.models.rigid_blocks import prove_condensed

SIZES = ((4, 4, 60), (6, 8, 40), (12, 12, 8))
STRENGTHS = (1e9, 2e6, 2e5, 2e4)


def main() -> None:
    """Time both on the same segmentations, processor time, one after the other."""
    rows = []
    for height, width, count in SIZES:
        for strength in STRENGTHS:
            assembly = wall(height, width, strength, strength)
            labellings = random_segmentations(assembly, count, seed=3)
            ratios, worst, proven, apart = [], 0.0, 0, 0
            for labels in labellings:
                analysis = LimitAnalysis(assembly, reference=labels)
                analysis.prove(labels)
                start = time.process_time()
                full = analysis.solve(labels, stands=False)
                middle = time.process_time()
                rigid = prove_condensed(analysis, labels)
                ratios.append((time.process_time() - middle) / (middle - start))
                if rigid is None:
                    continue
                proven += 1
                apart += any("apart" in step for step in rigid.route)
                if full.status is Status.COLLAPSE:
                    worst = max(worst, abs(rigid.load_factor * analysis.template.scaling.load / full.load_factor - 1.0))
            rows.append(
                [
                    f"{height} × {width}",
                    str(len(assembly.interfaces)),
                    f"{strength:.0e}",
                    f"{np.median(ratios):.2f}",
                    f"{proven} of {count}",
                    str(apart),
                    f"{worst:.0e}",
                ]
            )
    head = [
        "cells",
        "faces",
        "σt = τ, Pa",
        "time / full",
        "proven",
        "with blocks taken apart",
        "largest difference of λ",
    ]
    write(
        "condensation",
        "# Condensation\n\n"
        "Random segmentations of walls under a horizontal body load, against a full analysis that is set up already. "
        "A condensed program is another one for every labelling, so on small scenes building it costs more than its "
        "size saves; it pays on large ones whose blocks are so strong that the full program is badly scaled, and there "
        "and everywhere it is the more exact of the two. `--condense auto` turns to it above a strength of 300 force "
        "scales, and where the full model could not be certified.\n\n" + table(head, rows),
    )


if __name__ == "__main__":
    main()
