"""Speed against error: every route on every scene, processor time against true relative error of λ.

A route is timed from the assembly to λ, set-up included, in a process of its own, once it has run on a small scene.
The error is measured against the intersection of all brackets proven in the run; where it is not above three
half-widths of that reference, it is known to be at most so much and drawn so.
"""

from __future__ import annotations

import math
import multiprocessing
import resource
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Final

from benchmarks.common import RESULTS, scene, table, write
from benchmarks.scenes import GRIDS, bonded, brick_wall, grid
from benchmarks.speed_routes import BRACKETED, DEFAULT, SOLVERS, Found, Way
from jld_core import Assembly, build_assembly

LIMIT: Final = 60
"""Processor seconds that a route gets on one scene."""
REPEATED: Final = 1.0
"""Processor seconds up to which a run is repeated, for a mean; the clock may tick in hundredths."""
PATIENCE: Final = 1800
"""Seconds on the wall clock after which a route is taken to hang; other work may share the cores."""
NOISE: Final = 1.15
"""Ratio of two times from which one is called faster."""


@dataclass(frozen=True)
class Measured:
    """One route on one scene: seconds (NaN where it did not finish), what it found, and why there is nothing."""

    way: Way
    seconds: float
    found: Found
    failure: str = ""


@dataclass(frozen=True)
class Reference:
    """Intersection of proven brackets."""

    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Relative."""
        return 0.5 * (self.high - self.low) / abs(self.high)

    def error(self, load: float) -> float:
        """Relative distance of λ from the middle."""
        middle = 0.5 * (self.low + self.high)
        return abs(load - middle) / abs(middle)


def scenes() -> dict[str, Callable[[], Assembly]]:
    """Planar grids in running bond of two-cell blocks (inner faces of the paper's strength), the three walls of
    section 3.1, and dry brick walls pushed out of plane."""
    push = [{"element": "c0r0", "force": [1, 0]}]
    made: dict[str, Callable[[], Assembly]] = {
        "planar, 33 faces": lambda: build_assembly(grid(bonded(GRIDS[33]), push)),
    }
    for faces in (88, 278, 2025):
        made[f"planar, {faces} faces"] = lambda faces=faces: build_assembly(grid(bonded(GRIDS[faces])))  # type: ignore[misc]
    for number in (1, 2, 4):
        made[f"wall {number} of section 3.1"] = lambda number=number: scene(f"ferris_tinloi_{number}")  # type: ignore[misc]
    for courses, bricks, blocks in ((10, 5, 110), (20, 10, 420), (40, 20, 1640)):
        made[f"spatial, {blocks} blocks"] = lambda c=courses, b=bricks: build_assembly(brick_wall(c, b))  # type: ignore[misc]
    return made


def _child(way: Way, assembly: Assembly, small: Assembly, pipe: Connection, limit: int) -> None:
    """Run a route until a second is filled, and send the mean time and the last answer."""
    resource.setrlimit(resource.RLIMIT_CPU, (limit + 1, limit + 1))
    warnings.simplefilter("ignore")
    try:
        way.run(small)
        start, runs, spent = time.process_time(), 0, 0.0
        while not runs or spent < REPEATED:
            found = way.run(assembly)
            runs, spent = runs + 1, time.process_time() - start
        pipe.send((spent / runs, found, ""))
    except Exception as error:  # whatever another package raises is its answer
        pipe.send((math.nan, Found(math.nan), f"{type(error).__name__}: {error}".splitlines()[0][:80]))


def measure(way: Way, assembly: Assembly, small: Assembly, limit: int = LIMIT) -> Measured:
    """One route on one scene, killed at the limit. small: of the same dimension, run first."""
    fork = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe(duplex=False)
    child = fork.Process(target=_child, args=(way, assembly, small, theirs, limit))
    child.start()
    theirs.close()
    answer = None
    try:
        if ours.poll(PATIENCE):
            answer = ours.recv()
    except EOFError:
        pass  # the limit on processor time has ended it
    child.kill()
    child.join()
    if answer is None or answer[0] > limit:
        return Measured(way, math.nan, Found(math.nan), f"not in {limit} s")
    return Measured(way, *answer)


def measure_all(
    assembly: Assembly, small: Assembly, ways: tuple[Way, ...] = SOLVERS, limit: int = LIMIT
) -> list[Measured]:
    """All routes that take the assembly, in order."""
    found: list[Measured] = []
    late: set[str] = set()
    for way in ways:
        if not way.takes(assembly):
            continue
        if way.easier in late:
            one = Measured(way, math.nan, Found(math.nan), f"not in {limit} s ({way.easier} was not)")
        else:
            one = measure(way, assembly, small, limit)
        if math.isnan(one.seconds) and one.failure.startswith("not in"):
            late.add(way.name)
        found.append(one)
    return found


def reference_of(found: list[Measured]) -> Reference:
    """The intersection of all proven brackets. AssertionError if two of them exclude each other."""
    lows = [one.found.low for one in found if math.isfinite(one.found.low)]
    highs = [one.found.high for one in found if math.isfinite(one.found.high)]
    low, high = max(lows), min(highs)
    assert low <= high * (1.0 + 1e-12), "two proven brackets exclude each other"
    return Reference(low, max(low, high))


def certain_error(one: Measured, reference: Reference) -> tuple[float, bool]:
    """Relative error of λ, and whether it is only known to be at most that."""
    error, unknown = reference.error(one.found.load), max(reference.half_width, 1e-15)
    return (error + unknown, True) if not error > 3.0 * unknown else (error, False)


def better(found: list[Measured], reference: Reference, bracketed: bool) -> list[str]:
    """Routes that are faster than the default and no less accurate; bracketed: among those with proof only."""
    chosen = next(one for one in found if one.way.name == DEFAULT)
    error, seconds = max(certain_error(chosen, reference)[0], 4.0 * reference.half_width), chosen.seconds
    names = []
    for one in found:
        if one is chosen or not math.isfinite(one.seconds * one.found.load):
            continue
        if bracketed and one.way.family not in BRACKETED:
            continue
        if NOISE * one.seconds < seconds and certain_error(one, reference)[0] <= error:
            names.append(one.way.name)
    return names


def rows_of(found: list[Measured], reference: Reference) -> list[list[str]]:
    """One row per route."""
    rows = []
    for one in found:
        family = one.way.family in BRACKETED
        if not math.isfinite(one.seconds) or math.isnan(one.found.load):
            rows.append([one.way.name, "", "", "", one.failure or one.found.note or "no answer"])
            continue
        error, most = certain_error(one, reference)
        width = (one.found.high - one.found.low) / abs(one.found.high) if family else math.nan
        proven = f"{width:.0e}" if math.isfinite(width) else "none"
        note = one.found.note if one.found.note != "collapse" else ""
        rows.append([one.way.name, f"{one.seconds:.3g}", f"{'≤ ' if most else ''}{error:.0e}", proven, note])
    return rows


def main() -> None:
    """Measure everything and write benchmarks/results/speed_error.md and .png."""
    from benchmarks.speed_plot import draw
    from jld_core.views.figures import save_figure

    small = {2: build_assembly(grid(bonded(GRIDS[33]))), 3: build_assembly(brick_wall(2, 2))}
    results: dict[str, tuple[list[Measured], Reference]] = {}
    fronts, parts = [], []
    for name, make in scenes().items():
        assembly = make()
        found = measure_all(assembly, small[assembly.dimension])
        reference = reference_of(found)
        results[name] = found, reference
        beaten = [better(found, reference, bracketed) for bracketed in (True, False)]
        fronts.append([name, *("yes" if not names else "no: " + ", ".join(names) for names in beaten)])
        head = ["route", "s", "error of λ", "bracket", "steps, or why not"]
        parts.append(
            f"## {name}\n\nReference {0.5 * (reference.low + reference.high):.12g}, known to "
            f"{reference.half_width:.0e}.\n\n{table(head, rows_of(found, reference))}"
        )
        print(parts[-1], flush=True)
    save_figure(draw(results), RESULTS / "speed_error.png")
    text = " ".join((__doc__ or "").split("\n\n", 1)[1].split())
    question = ["scene", "among routes with a bracket", "among all routes"]
    summary = (
        f"# Speed against error\n\n{text} Limit {LIMIT} s. Loose: tolerance and margin 1e-6, bracket 1e-3 asked; "
        "tight: 1e-12 with refinement, 1e-9; qdldl, faer: Clarabel's factorisations. CVXPY and bare Clarabel at their "
        "own tolerances.\n\n![Time against error](speed_error.png)\n\n"
        f"## Is the default on the front?\n\nNo faster route is as accurate; errors below four half-widths of the "
        f"reference count as equal, times within {NOISE - 1.0:.0%} too.\n\n{table(question, fronts)}"
    )
    write("speed_error", "\n\n".join([summary, *parts]), also=("ecos", "scs", "osqp"))


if __name__ == "__main__":
    main()
