"""The virtual experiment against λ: walls, layouts of the beam-arch, unstable layouts, and the time of a step."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from studies.scenes import leonardo_flat_arch

from benchmarks.common import ROOT, scene, table, write
from jld_core import Assembly, Status, build_assembly, load_scene, solve
from jld_core.arrays import Bits
from jld_experiment import Joints, Push, Settings, Specimen, Standing, push, run_experiment, specimen_of
from jld_explore import search_space
from jld_explore.drivers.enumeration import Enumeration

LAYOUTS, UNSTABLE = 70, 100
ASSOCIATIVE, NO_DILATION = Joints(dilation="friction", inner="plastic"), Joints(inner="plastic")
WALLS = {1: (0.638981, 0.6413, 30.0, 12.0), 2: (0.562005, 0.5639, 75.0, 30.0), 4: (0.263736, 0.2638, 24.0, 12.0)}
"""Known minimum without dilation (a public MPEC solver), an earlier engine's end from gravity at 20 000 periods, and
elastic movements of a push that reaches the plateau, with and without dilation."""


def pushed(specimen: Specimen, scale: float, periods: float) -> Push:
    """A push over the length that is set, in so many slowest periods."""
    settled, standing = specimen.settle()
    assert standing is Standing.RESTS
    return push(specimen, settled, scale, periods / specimen.settings.length, endless=True)


def plateau(found: Push) -> float:
    return float(found.load_factor[found.distance > 0.75 * found.distance[-1]].mean())


def walls() -> str:
    rows = []
    for number, (lowest, expected, length, short) in WALLS.items():
        assembly = scene(f"ferris_tinloi_{number}")
        exact = solve(assembly).load_factor
        found = []
        rates = [(NO_DILATION, "free", short, periods) for periods in (1000.0, 5000.0, 20000.0)]
        for joints, gaps, most, periods in ((ASSOCIATIVE, "plastic", length, 5000.0), *rates):
            settings = Settings(scheme="limit", gaps=gaps, length=most, hasten=1e9)  # type: ignore[arg-type]
            specimen = specimen_of(assembly, assembly.labels, joints, settings)
            run = pushed(specimen, exact, periods)
            found.append(plateau(run) if joints is ASSOCIATIVE else float(run.load_factor.max()))
        shown = [f"{value:.6f}" for value in found]
        rows.append([str(number), f"{exact:.6f}", shown[0], " / ".join(shown[1:]), f"{expected:.4f}", f"{lowest:.6f}"])
    head = "wall | λ | with dilation, 5 000 periods, plateau | without, 1 000 / 5 000 / 20 000, peak"
    return table(head + " | an earlier engine | lowest known", rows)


def beam_arch() -> tuple[Assembly, Bits]:
    """The flagship, and every class of its segmentations in the order of enumeration."""
    parsed = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    assembly = build_assembly(parsed)
    return assembly, np.concatenate([rows for rows, _ in Enumeration(search_space(parsed, assembly)).batches()])


def far_plateau(assembly: Assembly, labels: Bits, scale: float) -> float:
    """Mean λ far from the start, method's own laws, in 5 000 slowest periods: 190 elastic movements in 2 000 of them,
    since some layouts take that many to their plateau, then ten in 3 000, since inertia adds what the rate is."""
    far, near = (Settings(scheme="limit", gaps="plastic", length=length, hasten=1e9) for length in (190.0, 10.0))
    specimen = specimen_of(assembly, labels, ASSOCIATIVE, far)
    there = pushed(specimen, scale, 2000.0).at_end
    slow = push(replace(specimen, settings=near), there, scale, 300.0, endless=True)
    return plateau(slow)


def layouts() -> str:
    """70 layouts under the method's own laws, and every hundredth unstable one."""
    assembly, labellings = beam_arch()
    off: list[float] = []
    unstable = tried = 0
    for labels in labellings[:: len(labellings) // (2 * LAYOUTS + 30)]:
        exact = solve(assembly, labels)
        if exact.status is Status.COLLAPSE and exact.load_factor > 0.2 and len(off) < LAYOUTS:
            off.append(abs(far_plateau(assembly, labels, exact.load_factor) / exact.load_factor - 1.0))
    for labels in labellings[::25]:
        if solve(assembly, labels).status is Status.UNSTABLE:
            tried += 1
            settings = Settings(scheme="limit", gaps="plastic")
            unstable += specimen_of(assembly, labels, ASSOCIATIVE, settings).settle()[1] is Standing.RESTS
    near = int(np.count_nonzero(np.array(off) <= 1e-3))
    return (
        f"Beam-arch, {len(off)} layouts with λ > 0.2 evenly from all, limit analysis' own laws, 5 000 periods: {near} "
        f"within 1e-3 of λ, the worst {max(off):.1e}, the median {np.median(off):.1e}. Of {tried} layouts that are "
        f"proven unstable {unstable} settled."
    )


def arch() -> str:
    assembly = build_assembly(leonardo_flat_arch())
    rows = []
    cases = [("plastic", "friction", 2094.0), ("plastic", 0.0, 1444.8)]
    cases += [("brittle", "friction", 1588.0), ("brittle", 0.0, 1443.0)]
    for inner, dilation, expected in cases:
        joints = Joints(inner=inner, dilation=dilation)  # type: ignore[arg-type]
        curve = run_experiment(assembly, joints=joints, settings=Settings(periods=400.0))
        rows.append(f"{inner} | {dilation} | {curve.collapse_load:.1f} | {expected:.1f} | {curve.rate_error:.1e}")
    return table("inner faces | dilation | collapse, N | an earlier engine, N | two rates differ by", rows)


def speed() -> str:
    rows = []
    for name, moving in (("flat_beam_arch", False), ("ferris_tinloi_2", False), ("flat_beam_arch", True)):
        assembly = scene(name)
        specimen = specimen_of(assembly, assembly.labels, Joints(inner="plastic"), Settings(moving=moving))
        state, _ = specimen.settle()
        steps, best = 20_000, np.inf
        for _ in range(5):
            start = time.process_time()
            specimen.march(state, steps)
            best = min(best, time.process_time() - start)
        points = len(specimen.points.face)
        each = 1e9 * best / steps / points
        rows.append([name, "moving" if moving else "at rest", str(points), f"{1e6 * best / steps:.2f}", f"{each:.1f}"])
    return table(["scene", "geometry", "sub-contacts", "µs a step", "ns a sub-contact and step"], rows)


if __name__ == "__main__":
    parts = [walls(), layouts(), "## Flat arch", arch(), "## Speed", speed()]
    write("experiment", "# The virtual experiment against λ", *parts, also=("numba",))
