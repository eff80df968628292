"""Coverage of reliability intervals: how often the exact probability of random systems lies in the 95 % interval.

Run ``python -m benchmarks.reliability_coverage``. Three kinds of systems of 1 to 12 mechanisms, p from 1e-2 to 1e-8:
linear mechanisms of variables of their own, p = 1 − Π Φ(β_i); linear mechanisms of two common variables, p by the
integral of exp(−r²/2) over all directions with the distance r of the failure surface; and scenes of blocks that slide
(random friction each) or overturn (random push each), p = 1 − Π (1 − p_i).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from scipy.stats import norm

from benchmarks.common import about, table, write
from jld_core import parse_scene
from jld_core.arrays import Floats
from jld_practice.reliability import (
    GoverningBounds,
    Limit,
    ReliabilityOptions,
    Variables,
    analyse,
    estimate,
    random_structure,
)
from jld_practice.reliability.analysis import Reliability

SAMPLES: Final = 20_000
"""Samples of every system."""

SYSTEMS: Final = {"own variables": 80, "common variables": 60, "blocks that slide or overturn": 60}
"""Number of systems of each kind."""


@dataclass(frozen=True)
class Planes:
    """Limit function of linear mechanisms, with bounds of samples; values of its variables are 1 + u."""

    slopes: Floats
    sides: Floats
    required: float = 0.0

    @property
    def variables(self) -> Variables:
        """Return the variables, of mean and deviation 1."""
        count = self.slopes.shape[1]
        return Variables(("",) * count, np.ones(count), np.ones(count), np.zeros(count, dtype=bool))

    @property
    def bounds(self) -> Any:
        """Return what `SampleBounds` is for a layout."""

        def of(values: Floats, required: float = 0.0) -> GoverningBounds:
            found = (self.sides - (values - 1.0) @ self.slopes.T).min(axis=1)
            return GoverningBounds(found, found)

        return SimpleNamespace(of=of, batched=False, structure=SimpleNamespace(variables=self.variables))

    def at(self, point: Floats) -> Limit:
        """Return value and gradient at a point."""
        values = self.sides - self.slopes @ point
        chosen = int(np.argmin(values))
        return Limit(float(values[chosen]), -self.slopes[chosen])


def probabilities(dice: np.random.Generator) -> Floats:
    """Return the probability of each of 1 to 12 mechanisms of a system; the largest is 1e-2 to 1e-8."""
    largest, count = 10.0 ** dice.uniform(-8.0, -2.0), int(dice.integers(1, 13))
    return np.asarray(largest * 10.0 ** np.append(0.0, -dice.uniform(0.0, 2.0, count - 1)))


def of_own_variables(dice: np.random.Generator, options: ReliabilityOptions) -> tuple[Reliability, float]:
    """Return the analysis of a system whose mechanisms have variables of their own, and its probability."""
    p = probabilities(dice)
    each = int(dice.integers(1, 6))
    slopes = np.zeros((len(p), each * len(p)))
    for k in range(len(p)):
        one = dice.standard_normal(each)
        slopes[k, each * k : each * (k + 1)] = one / np.linalg.norm(one)
    function: Any = Planes(slopes, -norm.ppf(p))
    return estimate(function, function.variables, options), -math.expm1(float(np.log1p(-p).sum()))


def of_common_variables(dice: np.random.Generator, options: ReliabilityOptions) -> tuple[Reliability, float]:
    """Return the analysis of a system whose mechanisms share two variables, and its probability."""
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
    document = {
        "elements": elements,
        "materials": {"dry": {"friction_coefficient": 9.0}, "faces": faces},
        "loads": {"live": live},
    }
    structure = random_structure(parse_scene(document))
    return analyse(structure, structure.assembly.labels, options), -math.expm1(float(np.log1p(-p).sum()))


MAKERS: Final = {"own variables": of_own_variables, "common variables": of_common_variables}
MAKERS["blocks that slide or overturn"] = of_blocks


def main() -> None:
    """Analyse all systems and write the table."""
    rows, begin, inside_of_all = [], time.perf_counter(), 0
    for number, (kind, count) in enumerate(SYSTEMS.items()):
        within, factors, errors, below, above = 0, [], [], 0, 0
        for k in range(count):
            dice = np.random.default_rng([number, k])
            found, exact = MAKERS[kind](dice, ReliabilityOptions(samples=SAMPLES, seed=k))
            (low, high), estimate_ = found.simulation.interval, found.simulation.probability
            within += low <= exact <= high
            below, above = below + (high < exact), above + (low > exact)
            factors.append(high / exact)
            errors.append(abs(math.log10(max(estimate_, 1e-300) / exact)))
        inside_of_all += within
        far = f"{np.median(factors):.2f}, {np.quantile(factors, 0.95):.2f}"
        rows.append([kind, f"{count}", f"{within / count:.1%}", f"{above}, {below}", far, f"{np.median(errors):.4f}"])
    total = sum(SYSTEMS.values())
    rows.append(["all", f"{total}", f"{inside_of_all / total:.1%}", "", "", ""])
    head = ["mechanisms", "systems", "exact p inside", "interval above, below", "upper end over p: median, 95 %"]
    head += ["error of log10 p, median"]
    text = f"{SAMPLES} samples each; {time.perf_counter() - begin:.0f} s."
    write("reliability_coverage", "\n\n".join(["# Coverage of reliability", about(__doc__), table(head, rows), text]))


if __name__ == "__main__":
    main()
