"""HiGHS on every class of the flagship: statuses, and the largest differences from the default route.

Dual simplex shares the program with the default route but neither its algorithm nor its tolerances; a statement that
shares nothing is compared on a sample in tests/validation/test_flagship.py.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from benchmarks.common import ROOT, table, write
from jld_core import LimitAnalysis, Status, build_assembly, load_scene
from jld_core.limit import Proof, load_scale
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.space import search_space, to_string

SHOWN = 10


def main() -> None:
    """Compare all classes and write benchmarks/results/flagship.md."""
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    batches = list(Enumeration(search_space(scene, assembly)).batches())
    labellings = np.concatenate([labels for labels, _ in batches])
    multiplicity = int(sum(weights.sum() for _, weights in batches))
    routes = {name: LimitAnalysis(assembly, solver=name) for name in ("clarabel", "highs")}
    scale, floor = routes["clarabel"].template.scaling.load, load_scale(assembly)
    seconds = dict.fromkeys(routes, 0.0)
    tally: Counter[tuple[str, str]] = Counter()
    differences: list[tuple[float, str, float, float, str]] = []
    for labels in labellings:
        found: dict[str, Proof] = {}
        for name, analysis in routes.items():
            start = time.process_time()
            found[name] = analysis.prove(labels)
            seconds[name] += time.process_time() - start
        proof, theirs = found["clarabel"], found["highs"]
        status, other = proof.status, theirs.status
        tally[str(status), str(other)] += 1
        if status is other is Status.COLLAPSE:
            ours, its = (0.5 * scale * (p.low + p.high) for p in (proof, theirs))
            size = max(abs(ours), abs(its), floor)
            differences.append((abs(ours - its) / size, to_string(labels), ours, its, " → ".join(proof.solve_log)))
    differences.sort(reverse=True)
    off = np.array([d[0] for d in differences])
    rows = [[f"{d:.1e}", f"`{bits}`", f"{a:.9g}", f"{b:.9g}", route] for d, bits, a, b, route in differences[:SHOWN]]
    counted = [[ours, its, str(number)] for (ours, its), number in sorted(tally.items())]
    parts = [
        "# The flagship against HiGHS",
        f"{len(labellings)} classes of {multiplicity} labellings. Processor time: "
        + ", ".join(f"{name} {spent:.1f} s" for name, spent in seconds.items())
        + f". Where both collapse λ differs by {np.median(off):.1e} in the median, {np.quantile(off, 0.99):.1e} for 99 "
        f"of 100, {off.max():.1e} at most (relative, or to 1e-3 of weight over live load where λ is smaller).",
        "## Statuses\n\n" + table(["default route", "HiGHS", "classes"], counted),
        "## Largest differences\n\n" + table(["difference", "labelling", "default", "HiGHS", "route"], rows),
    ]
    write("flagship", "\n\n".join(parts))


if __name__ == "__main__":
    main()
