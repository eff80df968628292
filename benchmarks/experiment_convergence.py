"""The virtual experiment held to its own standard: steps, meshes, energy, digits, and why plastic runs leave λ.

``python -m benchmarks.experiment_convergence`` writes benchmarks/results/experiment_convergence.md.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from studies.distinct_runs import Case, cases
from studies.scenes import leonardo_flat_arch

from benchmarks.common import scene, table, write
from jld_core import Assembly, build_assembly, solve
from jld_experiment import Joints, Settings, Standing, push, specimen_of
from jld_experiment.driving import scout

ASSOCIATIVE = Joints(dilation="friction", inner="plastic")
FAR: Final = (5.0, 20.0, 100.0)
"""Elastic displacements up to which the highest λ is read."""
LAYOUTS: Final = (
    ("wall with an opening", 0),
    ("wall with an opening", 1),
    ("wall with an opening", 7),
    ("beam-arch", 6),
    ("beam-arch", 21),
)
"""Layouts of the study of distinct elements whose plastic associative runs ended furthest below λ."""
CAUSES: Final[tuple[tuple[str, dict[str, Any]], ...]] = (
    ("default", {}),
    ("damping 0.1", {"damping": 0.1}),
    ("viscous damping", {"damping_scheme": "viscous"}),
    ("a quarter of the rate", {"periods": 200.0}),
    ("half the step", {"step": 0.35}),
    ("17 points a face", {"segments": 16}),
    ("yield points of limit analysis", {"scheme": "limit"}),
    ("opening is plastic", {"gaps": "plastic"}),
    ("both of these", {"scheme": "limit", "gaps": "plastic"}),
)
"""What is changed, one at a time, beside a push at three times the usual rate and a step of 0.7."""


def highest(assembly: Assembly, labels: Any, settings: Settings, exact: float) -> list[str]:
    """Return the highest λ up to several displacements, over λ of limit analysis."""
    specimen = specimen_of(assembly, labels, ASSOCIATIVE, settings)
    settled, standing = specimen.settle()
    if standing is not Standing.RESTS:
        return [str(standing)] * len(FAR)
    found = push(specimen, settled, exact, settings.periods, endless=True)
    way = found.distance / (exact * specimen.system.reach)
    return [f"{float(found.load_factor[way <= far].max()) / exact:.4f}" for far in FAR]


def causes(found: list[Case]) -> str:
    """What brings plastic associative runs back to λ."""
    by_name = {case.name: case for case in found}
    rows = []
    for name, changed in CAUSES:
        row = [name]
        for scene_name, layout in LAYOUTS:
            case = by_name[scene_name]
            labels = np.array(case.layouts[layout])
            settings = Settings(**({"periods": 50.0, "step": 0.7, "length": FAR[-1], "hasten": 4.0} | changed))
            row.append(" / ".join(highest(case.assembly, labels, settings, solve(case.assembly, labels).load_factor)))
        rows.append(row)
    return table(["changed", *(f"{name} {layout}" for name, layout in LAYOUTS)], rows)


def convergence() -> str:
    """Collapse load and error of energy by time step, contact points, rate and damping."""
    flat, wall = build_assembly(leonardo_flat_arch()), scene("flat_beam_arch")
    rows = []
    for name, changed in (
        ("step 0.8", {"step": 0.8}),
        ("step 0.5, the default", {}),
        ("step 0.25", {"step": 0.25}),
        ("step 0.125", {"step": 0.125}),
        ("3 points a face", {"segments": 2}),
        ("9 points", {"segments": 8}),
        ("17 points", {"segments": 16}),
        ("33 points", {"segments": 32}),
        ("a third of the periods", {"periods": 50.0}),
        ("twice the periods", {"periods": 300.0}),
        ("viscous damping", {"damping_scheme": "viscous"}),
        ("combined damping", {"damping_scheme": "combined"}),
    ):
        row = [name]
        for assembly in (flat, wall):
            for joints in (Joints(inner="plastic"), Joints()):
                specimen = specimen_of(assembly, assembly.labels, joints, Settings(**changed))
                settled, _ = specimen.settle()
                found = push(specimen, settled, scout(specimen, settled), specimen.settings.periods)
                row.append(f"{found.load_factor[found.collapse]:.6g} ({found.energy_error.max():.0e})")
        rows.append(row)
    head = ["flat arch, plastic, N", "flat arch, brittle, N", "beam-arch, plastic", "beam-arch, brittle"]
    return table(["changed", *head], rows)


def main() -> None:
    """Run all parts and write the page."""
    parts = [
        "# Convergence and energy of the virtual experiment",
        "## Why plastic associative runs leave λ\n\nHighest λ up to "
        + ", ".join(f"{far:g}" for far in FAR)
        + " elastic displacements, over λ of limit analysis; layouts of `studies/distinct_runs.py`.\n\n"
        + causes(cases()),
        "## Time step, contact points, rate, damping\n\nCollapse load without dilation of one push; in brackets the "
        "largest error of its energy.\n\n" + convergence(),
    ]
    write("experiment_convergence", "\n\n".join(parts), ("numba",))


if __name__ == "__main__":
    main()
