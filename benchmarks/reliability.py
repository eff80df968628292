"""Reliability: closed forms by both methods, and the time of samples of a layout of 88 faces.

Run ``python -m benchmarks.reliability``. A sliding block has the limit state μ W − H. Its index is known for normal and
for lognormal friction and push. The wall of 88 faces has shared values, or values of each face on its own.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from scipy.stats import norm

from benchmarks.common import about, table, write
from benchmarks.scenes import LARGE, stones
from jld_core import build_assembly, parse_scene
from jld_core.arrays import Bits, Floats
from jld_core.batch.library import described
from jld_core.limit.analysis import LimitAnalysis
from jld_explore import search_space
from jld_explore.drivers import make_driver
from jld_practice.reliability import (
    GoverningBounds,
    Limit,
    ReliabilityOptions,
    Variables,
    analyse,
    estimate,
    random_structure,
)
from jld_practice.reliability.monte_carlo import Reliability
from jld_practice.reliability.structure import RandomStructure

SAMPLES: Final = 100_000  # samples of every row
WEIGHT: Final = 2000.0 * 9.81  # weight of the sliding block, N


def vary(mean: Any, cov: float, kind: str = "lognormal", **more: Any) -> dict[str, Any]:
    return {"mean": mean, "cov": cov, "kind": kind, **more}


def block(kind: str, push: float) -> dict[str, Any]:
    elements = [
        {"id": "ground", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
        {"id": "block", "polygon": [[0, 0], [2, 0], [2, 1], [0, 1]], "weight": WEIGHT},
    ]
    live = [{"element": "block", "force": vary([push, 0.0], 0.2, kind), "at": [1.0, 0.1]}]
    return stones(elements, live, {"friction_coefficient": vary(0.6, 0.1, kind)})


def exact(kind: str, push: float) -> float:
    """Return the index of the sliding block: Hasofer and Lind (1974); Rackwitz and Fiessler (1978)."""
    resistance = 0.6 * WEIGHT
    if kind == "normal":
        return (resistance - push) / math.hypot(0.1 * resistance, 0.2 * push)
    one, two = math.log(1.01), math.log(1.04)
    return (math.log(resistance / push) - 0.5 * (one - two)) / math.sqrt(one + two)


def wall(each: bool) -> dict[str, Any]:
    """Return the wall of 88 faces with lognormal friction, strengths and loads. each: faces have their own values."""
    scene = LARGE["planar 88 faces"]()
    document = scene if isinstance(scene, dict) else scene.model_dump(mode="json", exclude_defaults=True)
    own: dict[str, Any] = {"each": True} if each else {}
    document["materials"] |= {
        "density": vary(1400.0, 0.05, "normal"),
        "dry": {"friction_coefficient": vary(0.6, 0.1, **own)},
        "inner": {"tensile_strength": vary(2e5, 0.2, **own), "shear_strength": vary(2e4, 0.2)},
    }
    document["loads"]["live"] = [{"element": name, "force": vary([0.0, -1.0], 0.2)} for name in ("c3r0", "c4r0")]
    return dict(document)


def of_wall(each: bool, share: float) -> str:
    """Return the row of the strongest of 40 random layouts. share: required λ over that of the means."""
    scene = parse_scene(wall(each))
    assembly = build_assembly(scene)
    layouts = make_driver("random", search_space(scene, assembly), 1).ask(40)
    analysis = LimitAnalysis(assembly)
    assert analysis.batch is not None
    low = analysis.batch.solve(layouts).low
    best = int(np.argmax(low))
    structure = random_structure(scene)
    required = share * float(low[best]) * analysis.template.scaling.load
    return row_of(f"88 faces, {len(structure.variables)} variables", "–", structure, layouts[best], required)


def row_of(name: str, known: str, structure: RandomStructure, labels: Bits, required: float = 1.0) -> str:
    """The row of one layout. known: its index in closed form."""
    clock, processor = time.perf_counter(), time.process_time()
    found = analyse(structure, labels, ReliabilityOptions(required, SAMPLES, 0, 2))
    times = f"{time.process_time() - processor:.1f} ({time.perf_counter() - clock:.1f})"
    of, kink = found.simulation, ", at a kink" if found.form.kink else ""
    betas = f"{known} | {found.form.beta:.4f} | {of.beta or math.nan:.4f}"
    return f"{name}{kink} | {betas} | {of.failures} | {of.resolved}, {of.undecided} | {times}"


def write_table() -> None:
    rows = []
    for kind, push in itertools.product(("normal", "lognormal"), (6000.0, 9000.0)):
        structure, name = random_structure(parse_scene(block(kind, push))), f"sliding block, {kind}, {push:g} N"
        rows.append(row_of(name, f"{exact(kind, push):.4f}", structure, structure.assembly.labels))
    rows += [of_wall(each, share) for each in (False, True) for share in (0.65, 0.45)]
    head = "structure | β exact | β first order | β simulation | failures | solved again, undecided | "
    head += "processor s (clock)"
    text = f"{SAMPLES} samples each, two threads. {described().capitalize()}."
    write("reliability", "# Reliability", about(__doc__), table(head, rows), text)


SAMPLES_OF_SYSTEM: Final = 20_000  # samples of every system


@dataclass(frozen=True)
class Planes:
    """Limit function of linear mechanisms, with bounds of samples; values of its variables are 1 + u."""

    slopes: Floats
    sides: Floats
    required: float = 0.0

    @property
    def variables(self) -> Variables:
        count = self.slopes.shape[1]
        return Variables(("",) * count, np.ones(count), np.ones(count), np.zeros(count, dtype=bool))

    @property
    def bounds(self) -> Any:
        def of(values: Floats, required: float = 0.0) -> GoverningBounds:
            found = (self.sides - (values - 1.0) @ self.slopes.T).min(axis=1)
            return GoverningBounds(found, found)

        return SimpleNamespace(of=of, batched=False, structure=SimpleNamespace(variables=self.variables))

    def at(self, point: Floats) -> Limit:
        values = self.sides - self.slopes @ point
        chosen = int(np.argmin(values))
        return Limit(float(values[chosen]), -self.slopes[chosen])


def probabilities(dice: np.random.Generator) -> Floats:
    largest, count = 10.0 ** dice.uniform(-8.0, -2.0), int(dice.integers(1, 13))
    return np.asarray(largest * 10.0 ** np.append(0.0, -dice.uniform(0.0, 2.0, count - 1)))


def of_own_variables(dice: np.random.Generator, options: ReliabilityOptions) -> tuple[Reliability, float]:
    p = probabilities(dice)
    each = int(dice.integers(1, 6))
    slopes = np.zeros((len(p), each * len(p)))
    for k in range(len(p)):
        one = dice.standard_normal(each)
        slopes[k, each * k : each * (k + 1)] = one / np.linalg.norm(one)
    function: Any = Planes(slopes, -norm.ppf(p))
    return estimate(function, function.variables, options), -math.expm1(float(np.log1p(-p).sum()))


def of_common_variables(dice: np.random.Generator, options: ReliabilityOptions) -> tuple[Reliability, float]:
    p = probabilities(dice)
    angle = dice.uniform(0.0, 2.0 * math.pi, len(p))
    slopes, sides = np.column_stack([np.cos(angle), np.sin(angle)]), -norm.ppf(p)
    way = 2.0 * math.pi * (np.arange(400_000) + 0.5) / 400_000
    ahead = np.cos(way[:, None] - angle) / sides
    exact = float(np.exp(-0.5 / np.maximum(ahead.max(axis=1), 1e-3) ** 2).mean())
    function: Any = Planes(slopes, sides)
    return estimate(function, function.variables, options), exact


def of_blocks(dice: np.random.Generator, options: ReliabilityOptions) -> tuple[Reliability, float]:
    """Return the analysis of blocks side by side, and the probability that one of them slides or overturns."""
    p = probabilities(dice)
    spread = math.sqrt(math.log1p(0.1**2))
    far = 4 * len(p)
    elements: list[dict[str, Any]] = [{"id": "g", "support": True, "polygon": [[-1, -1], [far, -1], [far, 0], [-1, 0]]}]
    faces, live = [], []
    for k, one in enumerate(p.tolist()):
        share = math.exp(norm.ppf(one) * spread - 0.5 * spread**2)
        slides, left = bool(dice.integers(2)), 4 * k
        corners = [[left, 0], [left + 2, 0], [left + 2, 1], [left, 1]]
        elements.append({"id": f"b{k}", "polygon": corners, "weight": 1.0})
        # It slides at μ W = 0.4 under a push of 0.4 at its foot; it overturns under 1 at its top
        friction = {"mean": 0.4 / share, "cov": 0.1, "kind": "lognormal"} if slides else 9.0
        most = math.exp(-norm.ppf(one) * spread - 0.5 * spread**2)
        push = [0.4, 0.0] if slides else {"mean": [1.0 / most, 0.0], "cov": 0.1, "kind": "lognormal"}
        faces.append({"between": ["g", f"b{k}"], "dry": {"friction_coefficient": friction}})
        live.append({"element": f"b{k}", "force": push, "at": [left + 1, 0.01 if slides else 1.0]})
    structure = random_structure(parse_scene(stones(elements, live, 9.0, faces=faces)))
    return analyse(structure, structure.assembly.labels, options), -math.expm1(float(np.log1p(-p).sum()))


SYSTEMS: Final = {  # how a system of each kind is made, and how many of them
    "own variables": (of_own_variables, 80),
    "common variables": (of_common_variables, 60),
    "blocks that slide or overturn": (of_blocks, 60),
}


def write_coverage() -> None:
    """Coverage of the interval: how often the exact probability of random systems lies in the 95 % interval.

    Three kinds of systems of 1 to 12 mechanisms, p from 1e-2 to 1e-8: linear mechanisms of variables of their own,
    p = 1 − Π Φ(β_i); linear mechanisms of two common variables, p by the integral of exp(−r²/2) over all directions
    with the distance r of the failure surface; and scenes of blocks that slide (random friction each) or overturn
    (random push each), p = 1 − Π (1 − p_i).
    """
    rows, begin, inside_of_all = [], time.perf_counter(), 0
    for number, (kind, (make, count)) in enumerate(SYSTEMS.items()):
        within, factors, errors, below, above = 0, [], [], 0, 0
        for k in range(count):
            dice = np.random.default_rng([number, k])
            found, exact = make(dice, ReliabilityOptions(samples=SAMPLES_OF_SYSTEM, seed=k))
            (low, high), estimate_ = found.simulation.interval, found.simulation.probability
            within += low <= exact <= high
            below, above = below + (high < exact), above + (low > exact)
            factors.append(high / exact)
            errors.append(abs(math.log10(max(estimate_, 1e-300) / exact)))
        inside_of_all += within
        far = f"{np.median(factors):.2f}, {np.quantile(factors, 0.95):.2f}"
        rows.append([kind, f"{count}", f"{within / count:.1%}", f"{above}, {below}", far, f"{np.median(errors):.4f}"])
    total = sum(count for _, count in SYSTEMS.values())
    rows.append(["all", f"{total}", f"{inside_of_all / total:.1%}", "", "", ""])
    head = "mechanisms | systems | exact p inside | interval above, below | upper end over p: median, 95 % | "
    head += "error of log10 p, median"
    text = f"{SAMPLES_OF_SYSTEM} samples each; {time.perf_counter() - begin:.0f} s."
    write("reliability_coverage", "# Coverage of reliability", about(write_coverage.__doc__), table(head, rows), text)


if __name__ == "__main__":
    write_table()
    write_coverage()
