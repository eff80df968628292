"""Measure designs from outlines: ``python -m benchmarks.designs [SECONDS [NAME...]]``.

Outlines, each under one clock with all cores. A wall of 2 × 1.2 m, 0.3 m thick, over a semicircular
opening of radius 0.7 m, with 10 kN at a quarter of its length and a push of 0.05 g to either side. A bridge of 8 m span
under 40 kN at a quarter and at the middle. A jack arch of 2 m between raked sides under 20 kN. A barrel vault of 4 m
span, drawn as one solid, under 5 kN at a quarter. λ by fields, where blocks crack anywhere, is bounded once more for
each winner and for the usual bond, 60 s each. The gain in the run is over the upper bound of the usual bond that the
run has found, the gain when refined over the refined one.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.common import table, write
from jld_core import build_assembly
from jld_core.arrays import Floats
from jld_explore.design.options import DesignOptions
from jld_explore.design.page import gain_of
from jld_explore.design.run import design_outline
from jld_explore.design.trials import NONE, Bounds, Trial, field_bounds

SECONDS, REFINED = 600.0, 60.0
"""Time limit of one design, and time for refined bounds of one layout, s."""


def arc(centre: tuple[float, float], radius: float, half: float, chords: int) -> Floats:
    """Return the corners of an arc from the left to the right springing; half: of its angle, degrees."""
    angles = np.radians(np.linspace(90.0 + half, 90.0 - half, chords + 1))
    points = np.array(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.asarray(points.round(9))


def csv_of_outline(points: list[tuple[float, float]]) -> str:
    """Return an outline as a CSV file."""
    return "id,x,y\n" + "".join(f"outline,{x},{y}\n" for x, y in points)


def outlines() -> dict[str, tuple[str, str, DesignOptions]]:
    """Return ending, text and options of each outline by its name."""
    opening = [tuple(p) for p in arc((1.0, 0.0), 0.7, 90.0, 24)]
    wall = [(0.0, 0.0), *opening, (2.0, 0.0), (2.0, 1.2), (0.0, 1.2)]
    half = math.degrees(math.asin(0.8))
    under = [tuple(p) for p in arc((0.0, -3.0), 5.0, half, 20)]
    bridge = [(-5.5, 0.0), *under, (5.5, 0.0), (5.5, 2.6), (-5.5, 2.6)]
    jack = [(-1.0, 0.0), (1.0, 0.0), (1.2, 0.4), (-1.2, 0.4)]
    seats = "".join(
        f"s{k},{side * x},{y},supports\n"
        for k, side in enumerate((-1.0, 1.0))
        for x, y in ((1.0, 0.0), (1.6, 0.0), (1.6, 0.4), (1.2, 0.4))
    )
    flat = "id,x,y,layer\n" + "".join(f"jack,{x},{y},stone\n" for x, y in jack) + seats
    ring = [*(2.3 * arc((0.0, 0.0), 1.0, 90.0, 24)).tolist(), *(2.0 * arc((0.0, 0.0), 1.0, 90.0, 24)[::-1]).tolist()]
    count = len(ring)
    lines = [f"v {x:.9f} {y} {z:.9f}" for y in (0.0, 3.0) for x, z in ring]
    lines += ["f " + " ".join(map(str, loop)) for loop in (range(count, 0, -1), range(count + 1, 2 * count + 1))]
    lines += [f"f {i + 1} {(i + 1) % count + 1} {count + (i + 1) % count + 1} {count + i + 1}" for i in range(count)]
    vault = "o vault\n" + "\n".join(lines) + "\n"

    def asked(load: str, places: str, mass: float, thickness: float | None, push: float | None = None) -> DesignOptions:
        return DesignOptions(
            block_mass=mass,
            load=load,
            places=places,
            thickness=thickness,
            push=push,
            friction=0.6,
            density=2000.0,
            tension=3e5,
            shear=5e5,
        )

    return {
        "wall": (".csv", csv_of_outline(wall), asked("10 kN", "0.25", 56.0, 0.3, 0.05)),
        "bridge": (".csv", csv_of_outline(bridge), asked("40 kN", "0.25,0.5", 2500.0, 1.0)),
        "jack arch": (".csv", flat, asked("20 kN", "0.25,0.5", 60.0, 0.3)),
        "vault": (".obj", vault, asked("5 kN", "0.25", 600.0, None)),
    }


def refined(trial: Trial | None) -> Bounds:
    """Return bounds by fields of a layout, given more time."""
    if trial is None:
        return (-math.inf, math.inf)
    assembly = build_assembly(trial.scene)
    low, high = field_bounds(assembly, assembly.labels, REFINED)
    return max(low, trial.fields[0]), min(high, trial.fields[1])


def told(bounds: Bounds) -> str:
    """Return bounds as text."""
    return "–" if bounds == NONE else f"{bounds[0]:.4g} to {bounds[1]:.4g}"


def main() -> None:
    """Design every outline and write the table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    rows = []
    known = outlines()
    for name in sys.argv[2:] or known:
        ending, text, options = known[name]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{name}{ending}"
            file.write_text(text)
            start = time.perf_counter()
            limited = DesignOptions(**(vars(options) | {"seconds": seconds}))
            done = design_outline(file, Path(folder) / "out", limited, print)
            spent = time.perf_counter() - start
        found = NONE if done.winner is None else done.winner.fields
        best, usual = refined(done.winner), refined(done.usual)
        how = "–" if done.winner is None else f"{done.winner.tessellation}, {done.winner.kind}"
        faces = "–" if done.winner is None else f"{done.winner.load_factor:.4g}"
        gain = best[0] / usual[1] if math.isfinite(best[0]) and 0.0 < usual[1] < math.inf else math.nan
        own = gain_of(done)
        in_run = "–" if own is None else f"{own:.3g}"
        rows.append([name, told(usual), how, faces, told(found), in_run, told(best), f"{gain:.3g}", f"{spent:.0f}"])
    about = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    head = ["outline", "usual bond, λ by fields, refined", "best", "by faces", "by fields in the run", "proven gain"]
    head += ["by fields, refined", "proven gain, refined", "s"]
    load = os.getloadavg()[0]
    words = (
        f"Written by `python -m benchmarks.designs`, here with {seconds:.0f} s for each, beside a load of {load:.0f}. "
    )
    write("designs", f"# Designs from outlines\n\n{words}{about}\n\n" + table(rows=rows, head=head))


if __name__ == "__main__":
    main()
