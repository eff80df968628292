"""Speed against error: every route on every scene, processor time against true relative error of λ.

A route is timed from the assembly to λ, set-up included, in a process of its own, once it has run on a small scene.
The error is measured against the intersection of all brackets proven in the run; where it is not above three
half-widths of that reference, it is known to be at most so much and drawn so. A route takes an assembly and returns λ,
with a proven bracket or without one; solvers that `jld_core.solvers` comes to know by name are added by themselves.
"""

from __future__ import annotations

import math
import multiprocessing
import re
import resource
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, Final

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.common import RESULTS, about, scene, stated, table, write
from benchmarks.scenes import GRIDS, bonded, brick_wall, grid
from jld_core import Assembly, LimitAnalysis, Status, build_assembly
from jld_core.models.rigid_blocks import prove_condensed
from jld_core.program import Template
from jld_core.solvers import SOLVERS as KNOWN
from jld_core.solvers import ClarabelSolver, Solver
from jld_explore.evaluation import Evaluator, EvaluatorSettings
from jld_views.figures import save_figure


@dataclass(frozen=True)
class Found:
    """λ in scene units, and proven bounds on it, NaN where there are none. note: the steps taken."""

    load: float
    low: float = math.nan
    high: float = math.nan
    note: str = ""


@dataclass(frozen=True)
class Way:
    """One route: name, family (what it is drawn as), which assemblies it takes, and how it is run."""

    name: str
    family: str
    takes: Callable[[Assembly], bool]
    run: Callable[[Assembly], Found]


def any_scene(assembly: Assembly) -> bool:
    return True


def planar(assembly: Assembly) -> bool:
    return assembly.dimension == 2


def has_blocks(assembly: Assembly) -> bool:
    """Is anything glued, so that there is something to condense?"""
    return not bool(assembly.labels.all())


def default(assembly: Assembly) -> Found:
    """What is done unless something else is asked for; whether it stands at λ = 0 is another question."""
    found = Evaluator(assembly, EvaluatorSettings()).evaluate(assembly.labels)
    if found.status is Status.UNCERTIFIED and has_blocks(assembly):
        return condensed(assembly)
    return Found(found.load_factor, found.low, found.high, str(found.status))


def ours(
    assembly: Assembly, route: Solver | None = None, solver: str = "clarabel", gap: float = 1e-6, margin: Any = None
) -> Found:
    """Our path by another route, or with another width asked for; margin: see `Template.program`."""
    analysis = LimitAnalysis(assembly, solver=solver, gap=gap, margin=margin, reference=assembly.labels)
    if route is not None:
        analysis.first_solver = route
    found = analysis.solve(stands=False)
    return Found(found.load_factor, *found.bracket, " → ".join(found.solve_log))


def forced(assembly: Assembly, method: str) -> Found:
    """The default tolerance with one of Clarabel's factorisations."""
    residual = Template(assembly).precision.residual
    return ours(assembly, ClarabelSolver(residual, direct_solve_method=method))


def of_size(assembly: Assembly, size: float, gap: float, refine: bool = False) -> Found:
    return ours(assembly, ClarabelSolver(size, iterative_refinement_enable=refine), gap=gap, margin=size)


def condensed(assembly: Assembly) -> Found:
    analysis = LimitAnalysis(assembly, reference=assembly.labels)
    found = prove_condensed(analysis, assembly.labels)
    if found is None:
        return Found(math.nan, note="the full model is the way to go")
    (low, high), scale = found.bracket, analysis.template.scaling.load
    return Found(found.load_factor * scale, low * scale, high * scale, " → ".join(found.solve_log))


def bare(assembly: Assembly) -> Found:
    """Clarabel as it comes on our scaled program, believed."""
    template = Template(assembly)
    answer = ClarabelSolver(1e-8, iterative_refinement_enable=True).solve(template.program(assembly.labels))
    return Found(float(answer.point[-1]) * template.scaling.load, note=answer.note)


def by_cvxpy(assembly: Assembly, solver: str) -> Found:
    return Found(stated(assembly, assembly.labels, solver))


# what `jld_core.solvers` knows beside Clarabel, each with bracket, and what it takes: HiGHS linear programs;
# "auto" is the default's own choice
OTHERS: Final = [name for name in KNOWN if name not in ("auto", "clarabel", "cvxpy")]
NAMED: Final = {name: planar if name.startswith("highs") else any_scene for name in OTHERS}
Ways = tuple[Way, ...]
DEFAULT: Final = "jld, default"
# families whose λ comes with proven bounds
BRACKETED: Final = ("jld, default", "jld, Clarabel", "jld, other solver", "jld, condensed")

SOLVERS: Final[Ways] = (
    Way(DEFAULT, DEFAULT, any_scene, default),
    Way("jld, loose", "jld, Clarabel", any_scene, partial(of_size, size=1e-6, gap=1e-3)),
    Way("jld, tight", "jld, Clarabel", any_scene, partial(of_size, size=1e-12, gap=1e-9, refine=True)),
    Way("jld, qdldl", "jld, Clarabel", any_scene, partial(forced, method="qdldl")),
    Way("jld, faer", "jld, Clarabel", any_scene, partial(forced, method="faer")),
    *(Way(f"jld, {name}", "jld, other solver", takes, partial(ours, solver=name)) for name, takes in NAMED.items()),
    Way("jld, condensed", "jld, condensed", has_blocks, condensed),
    Way("Clarabel, bare", "Clarabel, bare", any_scene, bare),
    *(Way(f"CVXPY, {s}", "CVXPY", any_scene, partial(by_cvxpy, solver=s)) for s in ("CLARABEL", "ECOS", "SCS")),
    *(Way(f"CVXPY, {s}", "CVXPY", planar, partial(by_cvxpy, solver=s)) for s in ("HIGHS", "SCIPY", "OSQP")),
)


LIMIT: Final = 60  # processor seconds that a route gets on one scene
REPEATED: Final = 1.0  # processor seconds up to which a run is repeated, for a mean; the clock may tick in hundredths
PATIENCE: Final = 1800  # seconds on the wall clock after which a route is taken to hang; other work may share the cores
NOISE: Final = 1.15  # ratio of two times from which one is called faster


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
        return 0.5 * (self.high - self.low) / abs(self.high)

    def error(self, load: float) -> float:
        middle = 0.5 * (self.low + self.high)
        return abs(load - middle) / abs(middle)


def scenes() -> dict[str, Callable[[], Assembly]]:
    """Planar grids in running bond of two-cell blocks (inner faces of the paper's strength), the three walls of
    section 3.1, and dry brick walls pushed out of plane."""
    push = [{"element": "c0r0", "force": [1, 0]}]
    made: dict[str, Callable[[], Assembly]] = {
        "planar, 33 faces": lambda: build_assembly(grid(bonded(GRIDS[33]), push))
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


def measure_all(assembly: Assembly, small: Assembly, ways: Ways = SOLVERS, limit: int = LIMIT) -> list[Measured]:
    return [measure(way, assembly, small, limit) for way in ways if way.takes(assembly)]


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
    known = [one for one in found if one is not chosen and math.isfinite(one.seconds * one.found.load)]
    known = [one for one in known if one.way.family in BRACKETED or not bracketed]
    quick = [one for one in known if NOISE * one.seconds < seconds]
    return [one.way.name for one in quick if certain_error(one, reference)[0] <= error]


def rows_of(found: list[Measured], reference: Reference) -> list[list[str]]:
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


MARKS: Final = {  # marker, colour and size by family; bracketed families are filled and warm
    "jld, default": ("*", "#b2182b", 190),
    "jld, Clarabel": ("o", "#d6604d", 55),
    "jld, other solver": ("D", "#e08214", 45),
    "jld, condensed": ("s", "#8c510a", 48),
    "Clarabel, bare": ("X", "#4d4d4d", 60),
    "CVXPY": ("P", "#2166ac", 60),
}


def draw(results: dict[str, tuple[list[Measured], Reference]]) -> Figure:
    columns = min(3, len(results))
    figure = Figure(figsize=(5.6 * columns, 4.3 * -(-len(results) // columns) + 1.0), dpi=110, layout="constrained")
    handles: dict[str, Any] = {}
    for place, (name, (found, reference)) in enumerate(results.items()):
        ax = figure.add_subplot(-(-len(results) // columns), columns, place + 1, xscale="log", yscale="log")
        best, steps = math.inf, []
        shown = [one for one in found if math.isfinite(one.seconds) and math.isfinite(one.found.load)]
        for k, one in enumerate(sorted(shown, key=lambda one: one.seconds)):
            (marker, colour, size), (error, most) = MARKS[one.way.family], certain_error(one, reference)
            proven = one.way.family in BRACKETED
            words = f"{one.way.family} ({'bracket proven' if proven else 'no bracket'})"
            look: dict[str, Any] = {"facecolor": colour if proven else "white", "edgecolor": colour}
            handles[words] = ax.scatter(one.seconds, error, size, marker=marker, linewidth=1.3, zorder=3, **look)
            if most:
                ax.plot([one.seconds] * 2, [error, error / 4.0], ":|", color="0.3", lw=1.0, zorder=2)
            text = re.sub("jld, |CVXPY, ", "", one.way.name)
            at = (6.0, (3.0, -8.0, 13.0, -18.0)[k % 4])
            ax.annotate(text, (one.seconds, error), at, textcoords="offset points", fontsize=6.5, color=colour)
            if error < best:
                steps.append((one.seconds, best := error))
        if steps:
            (handles["front of all routes"],) = ax.step(*zip(*steps, strict=True), where="post", color="0.7", lw=1.0)
        ax.axhline(reference.half_width, color="0.6", lw=0.7, ls="--", zorder=1)
        ax.grid(True, which="major", color="0.92", lw=0.6)
        ax.set(title=name, ylabel="relative error of λ", xlabel="processor time, s")
        late = [one.way.name for one in found if one.failure.startswith("not in")]
        if late:
            text = f"not in {LIMIT} s:\n" + "\n".join(late)
            ax.text(0.98, 0.97, text, transform=ax.transAxes, ha="right", va="top", fontsize=7.0, color="0.35")
    figure.legend(
        [*handles.values(), Line2D([], [], marker="|", color="0.3", ls=":")],
        [*handles, "error at most so much (dashed: half-width of the reference)"],
        loc="outside lower center", ncols=3, frameon=False, fontsize=10,
    )  # fmt: skip
    return figure


def main() -> None:
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
    question = "scene | among routes with a bracket | among all routes"
    summary = (
        f"# Speed against error\n\n{about(__doc__)} Limit {LIMIT} s. Loose: tolerance and margin 1e-6, bracket 1e-3 "
        "asked; tight: 1e-12 with refinement, 1e-9; qdldl, faer: Clarabel's factorisations. CVXPY and bare Clarabel at "
        "their own tolerances.\n\n![Time against error](speed_error.png)\n\n"
        f"## Is the default on the front?\n\nNo faster route is as accurate; errors below four half-widths of the "
        f"reference count as equal, times within {NOISE - 1.0:.0%} too.\n\n{table(question, fronts)}"
    )
    write("speed_error", summary, *parts, also=("ecos", "scs", "osqp"))


if __name__ == "__main__":
    main()
