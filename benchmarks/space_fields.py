"""Bounds by fields in space: how wide after which time, for one layout of four structures, on one core.

The cube and the cantilever have closed forms, which the brackets must hold. The corner and the arch have dry joints.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.scenes import box
from jld_core import Assembly, build_assembly, parse_scene, samples, solve
from jld_core.fields.space_bounds import SpatialBounds, spatial_bounds
from jld_core.threads import one_thread

GAP: Final = 0.15
"""Relative width at which refinement ends."""


@dataclass(frozen=True)
class Case:
    """One structure: name, what it is, how it is built, λ in closed form, and tetrahedra that no mesh exceeds."""

    name: str
    what: str
    build: Callable[[], Assembly]
    exact: str
    most: int


def assembled(elements: list[dict[str, Any]], live: list[Any], inner: dict[str, float], label: str) -> Assembly:
    """An assembly of elements of 2000 kg/m³."""
    document = {
        "elements": elements,
        "materials": {"density": 2000.0, "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "loads": {"live": live},
    }
    built = build_assembly(parse_scene(document))
    return replace(built, labels=np.full(len(built.interfaces), label == "dry"))


def cube() -> Assembly:
    """A flat stone glued to its support under a horizontal body load: λ W = τ A where it shears off."""
    parts = [box("base", (0, 0, -1), (1, 1, 0), support=True), box("stone", (0, 0, 0), (1, 1, 0.1))]
    strength = {"tensile_strength": 5e4, "shear_strength": 1e4}
    return assembled(parts, [{"body": [1, 0, 0]}], strength, "inner")


def cantilever() -> Assembly:
    """A cantilever of 2.0 × 0.25 × 0.5 m under a force at its end: λ between M/l and M/(l − h/2), M = σt b h²/4."""
    parts = [box("wall", (-0.5, 0, 0), (0, 0.25, 0.5), support=True)]
    parts.append(box("beam", (0, 0, 0), (2.0, 0.25, 0.5), weight=0.0))
    strength = {"tensile_strength": 2e5, "shear_strength": 1e5}
    return assembled(parts, [{"element": "beam", "force": [0, 0, -1], "at": [2.0, 0.125, 0.25]}], strength, "inner")


def corner() -> Assembly:
    """A corner of two walls of five courses, two and a half stones long, bonded in turn, pushed along its bisector."""
    long, wide, high, reach = 0.4, 0.2, 0.2, 0.8
    parts = [box("ground", (-0.2, -0.2, -0.2), (1.0, 1.0, 0.0), support=True)]
    for course in range(5):
        low, top = course * high, (course + 1) * high
        for axis in (0, 1):
            # the wall along x has the corner in even courses, the wall along y in odd ones
            ends = [0.0 if course % 2 == axis else wide]
            while reach - ends[-1] > 1.5 * long - 1e-9:
                ends.append(ends[-1] + long)
            for k, (start, end) in enumerate(zip(ends, [*ends[1:], reach], strict=True)):
                lower, upper = [start, 0.0, low], [end, wide, top]
                if axis:
                    lower[:2], upper[:2] = lower[1::-1], upper[1::-1]
                parts.append(box(f"{'xy'[axis]}{course}.{k}", tuple(lower), tuple(upper)))
    strength = {"tensile_strength": 2e5, "shear_strength": 5e5, "friction_coefficient": 0.5}
    return assembled(parts, [{"body": [0.7071, 0.7071, 0.0]}], strength, "dry")


def arch() -> Assembly:
    """A semicircular arch of seven voussoirs, 0.3 m thick and 0.5 m deep, under a horizontal body load."""
    stone = samples.Stone(tension=1e6, shear=2e6)
    made = samples.vault(voussoirs=7, courses=1, length=0.5, radius=1.5, thickness=0.3, load="push", stone=stone)
    return build_assembly(made)


CASES: Final = (
    Case("cube under shear", "a stone 1 × 1 × 0.1 m glued to its support", cube, "5.0968", 250),
    Case("cantilever", "2.0 × 0.25 × 0.5 m, plastic bending", cantilever, "1562.5 to 1785.7", 250),
    Case("corner", "25 stones in five courses, dry joints", corner, "–", 1700),
    Case("arch", "seven voussoirs, dry joints, σt = 1 MPa, τ = 2 MPa", arch, "–", 500),
)


@one_thread()
def bounds_of(assembly: Assembly, most: int) -> tuple[SpatialBounds, float]:
    """Bounds of the labelling of a scene, and the processor time that they took."""
    start = time.process_time()
    found = spatial_bounds(assembly, gap=GAP, most_tetrahedra=most)
    return found, time.process_time() - start


def main() -> None:
    """Bound all structures, print the table and write it."""
    rows, steps = [], []
    for case in CASES:
        assembly = case.build()
        faces = solve(assembly).load_factor
        found, seconds = bounds_of(assembly, case.most)
        rows.append(
            [
                case.name,
                case.what,
                f"{faces:.5g}",
                case.exact,
                f"{found.lower:.5g}",
                f"{found.upper:.5g}",
                f"{100.0 * found.gap:.1f} %",
                str(found.tetrahedra),
                f"{seconds:.0f}",
            ]
        )
        print(rows[-1], flush=True)
        steps += [[case.name, str(s.tetrahedra), f"{s.lower:.5g}", f"{s.upper:.5g}"] for s in found.history]
    head = ["structure", "what", "λ by faces", "closed form", "lower", "upper", "gap", "tetrahedra", "processor s"]
    text = [
        "# Bounds by fields in space",
        about(__doc__),
        f"One layout each, refined to a gap of {100 * GAP:.0f} % or the most tetrahedra of its case.",
        table(head, rows),
        "All meshes:",
        table(["structure", "tetrahedra", "lower", "upper"], steps),
    ]
    write("space_fields", "\n\n".join(text))


if __name__ == "__main__":
    main()
