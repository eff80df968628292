"""Hard cases: scenes that break solvers, and the status, bracket, solves and route that each one took.

Every case must end with a bracket no wider than 1e-6 or say `uncertified`, and none with a wrong number. λ to compare
with: a closed form, or else the same problem stated in CVXPY and solved by simplex (spatial: published). Tests share
the scenes.
"""

from __future__ import annotations

import math
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.common import about, stated, table, write
from benchmarks.scenes import brick_wall, grid, stones, strength
from jld_core import Assembly, LimitAnalysisResult, Status, build_assembly, parse_scene, solve
from jld_core.arrays import Bits
from jld_core.strengths import Route
from jld_samples import box

ROUTE: Final = Route("a benchmark")
Entry = dict[str, Any]
PUSH: Final[list[Entry]] = [{"body": [1, 0]}]


@dataclass(frozen=True)
class HardCase:
    """One scene under one labelling, and what must come out.

    kind: what is hard; name: which of the kind. make: the assembly. labels: (m,) from it, None for its own. status:
    what must be said. expected: λ, None where no closed form gives it. rel, floor: how near λ must be, relative or
    absolute. simplex: an independent statement needs simplex too.
    """

    kind: str
    name: str
    make: Callable[[], Assembly]
    labels: Callable[[Assembly], Bits] | None = None
    status: Status = Status.COLLAPSE
    expected: float | None = None
    rel: float = 1e-6
    floor: float = 0.0
    simplex: bool = False

    def __str__(self) -> str:
        return f"{self.kind}: {self.name}"


def block(name: str, x0: float, y0: float, x1: float, y1: float, **keys: Any) -> Entry:
    return {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], **keys}


def ground(x0: float = -1.0, x1: float = 5.0, name: str = "ground") -> Entry:
    return block(name, x0, -1, x1, 0, support=True)


def structure(elements: list[Entry], friction: float = 0.5, live: list[Entry] | None = None, **keys: Any) -> Assembly:
    """Dry blocks, pushed sideways by their weight unless said otherwise. keys: further ones of the document."""
    return build_assembly(parse_scene(stones(elements, live or PUSH, friction) | keys))


def cells(rows: list[str], strong: float = 2e4, length: float = 1.0, force: float = 1.0) -> Assembly:
    """Cells of 0.1 m, 1400 kg/m³, μ 0.75, σt = τ = strong, Pa; length, force: of one m and one N in other units."""
    edge, inner = 0.1 * length, strength(strong * force / length**2)
    stone = {"cell": (edge, edge), "thickness": edge, "density": 1400.0 * force / length**3}
    return build_assembly(grid(rows, inner=inner, dry={"friction_coefficient": 0.75}, **stone))


def ell(friction: float) -> Assembly:
    corners = {"a": (0, 0), "b": (0, 1), "c": (1, 0)}
    return structure([*(block(k, x, y, x + 1, y + 1, weight=1.0) for k, (x, y) in corners.items()), ground()], friction)


def mixed_strengths(seed: int) -> Assembly:
    """Cells whose strengths are drawn from 1 to 1e12 Pa, some without any; labels drawn too."""
    assembly = cells(["aaaa", "aaaa", "aaaa", "####"])
    rng = np.random.default_rng(seed)
    count = len(assembly.interfaces)
    tension, shear = 10.0 ** rng.uniform(0, 12, (2, count))
    tension[::7] = 0.0
    strengths = replace(assembly.strengths(ROUTE), tension=tension, shear=shear)
    return replace(assembly.with_strengths(strengths), labels=rng.random(count) < 0.5)


def mixed_weights(seed: int) -> Assembly:
    """A wall of twelve blocks whose weights are drawn over six decades."""
    weights = 10.0 ** np.random.default_rng(seed).uniform(-3, 3, 12)
    wall = []
    for k, weight in enumerate(weights.tolist()):
        j, i = divmod(k, 3)
        wall.append(block(f"b{i}{j}", i + 0.5 * (j % 2), j, i + 1 + 0.5 * (j % 2), j + 1, weight=weight))
    return structure([*wall, ground()])


def weightless(force: list[float]) -> Assembly:
    pair = [block("a", 0, 0, 1, 1), block("b", 0, 1, 1, 2), ground()]
    return structure(pair, live=[{"element": "b", "force": force}])


def wedged(force: list[float], friction: float = 0.5) -> Assembly:
    walls = [block("left", -1, 0, 0, 1, support=True), block("right", 1, 0, 2, 1, support=True)]
    live = [{"element": "a", "force": force}]
    return structure([block("a", 0, 0, 1, 1, weight=1.0), *walls, ground()], friction, live)


def bricks(courses: int, wide: int, length: float, force: float) -> Assembly:
    """The dry brick wall of two wythes, pushed out of plane, in other units: of one m and one N."""
    return build_assembly(brick_wall(courses, wide, length, force))


def slippery_cubes() -> Assembly:
    """Frictionless cubes side by side: no force can pass between them; one is lifted."""
    cubes = [box("a", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), box("b", (1.0, 0.0, 0.0), (2.0, 1.0, 1.0))]
    slab = box("slab", (-5.0, -5.0, -1.0), (5.0, 5.0, 0.0), support=True)
    lift = [{"element": "a", "force": [0, 0, 1]}]
    return build_assembly(parse_scene(stones([*cubes, slab], lift, 0.0, density=1.0, gravity=1.0)))


def every(dry: bool) -> Callable[[Assembly], Bits]:
    return lambda assembly: np.full(len(assembly.interfaces), dry)


def alternating(assembly: Assembly) -> Bits:
    return np.asarray(np.arange(len(assembly.interfaces)) % 2 == 0)


# length and force of one m and one N
UNITS: Final = {"µN, mm": (1e3, 1e6), "N, mm": (1e3, 1.0), "kN, m": (1.0, 1e-3), "MN, km": (1e-3, 1e-6)}
LARGE: Final = 0.0465844456  # λ of the wall of 1 640 bricks out of plane; found by two independent prototypes


def hard_cases() -> Iterator[HardCase]:
    unit = block("a", 0, 0, 1, 1, weight=1.0)
    make: partial[Assembly]
    for name, (length, force) in UNITS.items():
        make = partial(cells, ["aaaa"] * 3 + ["####"], 2e4, length, force)
        yield HardCase("units", name, make, alternating)
    for height in (1e-6, 1e-3, 1e3, 1e6):
        answer = min(0.5, 0.5 / height)
        pair = [block("a", 0, 0, 1, height, weight=1.0), block("b", 0, height, 1, 2 * height, weight=1.0)]
        make = partial(structure, [*pair, block("ground", -1, -height, 2, 0, support=True)])
        yield HardCase("aspect ratio", f"{height:.0e}", make, expected=answer, floor=1e-9)
    for count in (10, 100, 1000):
        make = partial(structure, [*(block(f"b{k}", 0, k, 1, k + 1, weight=1.0) for k in range(count)), ground()])
        yield HardCase("column", f"{count} blocks", make, expected=1.0 / count)
    for friction in (0.0, 1e-6, 1e-3, 1.0, 10.0, 1e3):
        yield HardCase("friction", f"{friction:g}", partial(ell, friction), floor=1e-9)
    for seed in range(6):
        make = partial(mixed_strengths, seed)
        yield HardCase("strengths 0 to 1e12", f"seed {seed}", make, rel=1e-5, floor=1e-6)
    for seed in range(4):
        yield HardCase("weights over six decades", f"seed {seed}", partial(mixed_weights, seed), simplex=True)
    yield HardCase("no self-weight", "slides", partial(weightless, [1.0, 0.0]), expected=0.0)
    yield HardCase("no self-weight", "just outside the cone", partial(weightless, [0.9, -1.0]), expected=0.0)
    yield HardCase("no self-weight", "inside the cone", partial(weightless, [0.1, -1.0]), status=Status.LOCKED)
    for gap in (1e-5, 1e-7, 1e-9, -1e-9):
        make = partial(structure, [unit, block("b", 1 + gap, 0, 2, 1, weight=1.0), ground()])
        yield HardCase("nearly coincident faces", f"{gap:g}", make, expected=0.5)
    for width in (1e-2, 1e-4, 1e-6):
        legs = [block("thin", 0, 0, width, 1, weight=width), block("thick", 1, 0, 2, 1, weight=1.0)]
        make = partial(structure, [block("beam", 0, 1, 2, 2, weight=1.0), *legs, ground()])
        yield HardCase("sliver", f"{width:g}", make, simplex=True)
    pieces = [block(f"g{k}", 0.25 * k, -1, 0.25 * (k + 1), 0, support=True) for k in range(4)]
    make = partial(structure, [unit, *pieces])
    yield HardCase("redundant supports", "four under one block", make, expected=0.5)
    bearings: list[Entry] = [{"elements": [name, "a"], "polygon": [[0, 0], [1, 0]]} for name in ("g0", "g1")]
    elements = [unit, ground(0, 1, "g0"), block("g1", 2, -1, 3, 0, support=True)]
    # the second support stands elsewhere: a tolerance that covers the distance says that it is meant
    make = partial(structure, elements, interfaces=bearings, tolerance=5.0)
    yield HardCase("duplicate supports", "one bearing twice", make, expected=0.5)
    two = [block("low", 0, 0, 1, 1, weight=1.0), block("tall", 10, 0, 11, 3, weight=1.0)]
    make = partial(structure, [*two, ground(-1, 2), ground(9, 12, "far ground")])
    yield HardCase("separate structures", "both pushed", make, expected=1.0 / 3.0)
    make = partial(make, live=[{"element": "low", "force": [1, 0]}])
    yield HardCase("separate structures", "one pushed", make, expected=0.5)
    make = partial(wedged, [1.0, 0.0], 0.0)
    yield HardCase("live load without work", "against an abutment", make, status=Status.LOCKED)
    for force_ in ([1.0, 0.0], [0.0, 1.0], [0.0, -1.0]):
        yield HardCase("load that locks", f"wedged, {force_}", partial(wedged, force_), status=Status.LOCKED)
    # a support that ends so far beyond the centroid: just short of it the block falls
    for edge in (0.0, 1e-12, 1e-10, 1e-9, 1e-6, -1e-12, -1e-10, -1e-9, -1e-6):
        two = [block("a", 0, 0, 2, 1, weight=1.0), ground(-1, 1 + edge)]
        make = partial(structure, two, live=[{"element": "a", "force": [1, 0]}])
        out: Any = {"status": Status.UNSTABLE} if edge < 0.0 else {"expected": 2.0 * edge, "floor": 1e-9}
        yield HardCase("edge of standing", f"{edge:g}", make, **out)
    make = partial(bricks, 40, 20, *UNITS["µN, mm"])
    yield HardCase("1 640 blocks in bad units", "µN, mm", make, expected=LARGE)
    yield HardCase("rank-deficient equilibrium", "no friction", partial(ell, 0.0), floor=1e-9)
    yield HardCase("rank-deficient equilibrium", "cubes without friction", slippery_cubes, expected=1.0)
    square = partial(cells, ["aaaa"] * 4 + ["####"])
    for name, labels in (("all dry", every(True)), ("all inner", every(False)), ("alternating", alternating)):
        yield HardCase("labelling", name, square, labels)


def is_near(value: float, case: HardCase, expected: float) -> bool:
    return math.isclose(value, expected, rel_tol=case.rel, abs_tol=case.floor + 1e-12)


WIDE: Final = 1e-6


@dataclass(frozen=True)
class Verdict:
    """What came out of one case, beside what should have; right: True, False, or None where it was left open."""

    case: HardCase
    found: LimitAnalysisResult
    expected: float
    seconds: float

    @property
    def right(self) -> bool | None:
        """None: honestly uncertified."""
        if self.found.status is Status.UNCERTIFIED:
            return None
        if self.found.status is not self.case.status:
            return False
        if self.found.status is not Status.COLLAPSE:
            return True
        return self.found.gap <= WIDE and is_near(self.found.load_factor, self.case, self.expected)


def judge(case: HardCase) -> Verdict:
    assembly = case.make()
    labels = assembly.labels if case.labels is None else case.labels(assembly)
    start = time.process_time()
    found = solve(assembly, labels)
    seconds = time.process_time() - start
    expected = math.nan if case.expected is None else case.expected
    if case.status is Status.COLLAPSE and case.expected is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # badly scaled data is what these cases are about
            expected = stated(assembly, labels, "HIGHS")
    return Verdict(case, found, expected, seconds)


def row_of(verdict: Verdict) -> list[str]:
    found, case = verdict.found, verdict.case
    low, high = found.bracket
    bracket = "" if math.isnan(low) else f"[{low:.9g}, {'∞' if math.isnan(high) else f'{high:.9g}'}]"
    off = abs(found.load_factor - verdict.expected)
    close = f"{off / max(abs(verdict.expected), 1e-3):.0e}" if math.isfinite(off) else ""
    gap = f"{found.gap:.0e}" if math.isfinite(found.gap) else ""
    right = {True: "yes", False: "**no**", None: "left open"}[verdict.right]
    numbers = [str(found.iterations), f"{verdict.seconds:.3g}", " → ".join(found.solve_log)]
    return [case.kind, case.name, str(found.status), bracket, gap, close, right, *numbers]


def main() -> None:
    verdicts = [judge(case) for case in hard_cases()]
    head = "what is hard | which | status | bracket | gap | off by | right | programs | s | route"
    counted = Counter(verdict.right for verdict in verdicts)
    first = sum(len(verdict.found.solve_log) == 1 for verdict in verdicts)
    summary = (
        f"{len(verdicts)} cases: {counted[True]} right, {counted[None]} honestly uncertified, {counted[False]} wrong; "
        f"{first} by the first solve alone. Off by: |λ − expected| over |expected|, or over 1e-3 where that is larger. "
        "Programs: solved in all, with that for standing at λ = 0. Route: an arrow begins a fallback, in brackets what "
        "a solver said that was not `optimal`."
    )
    rows = table(head, [row_of(verdict) for verdict in verdicts])
    write("hard_cases", "# Hard cases", about(__doc__), summary, rows)


if __name__ == "__main__":
    main()
