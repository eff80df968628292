"""Tilting tables: angles of the best layouts of a search, and the objective of the layout that tilts furthest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from jld_core import Assembly, Bits, InputError
from jld_core.limit import Model
from jld_core.models import solve_by_elements
from jld_core.models.tilting import directions, tilt_facts
from jld_explore.evaluation import Evaluation
from jld_explore.report import Exploration
from jld_explore.space import from_string
from jld_explore.steps.step import Step, StepContext, with_entries

_BEST: Final = 10  # layouts whose angles are found after a search


def angle(assembly: Assembly, labels: Bits, model: Model | None = None) -> tuple[float, float]:
    """Return bounds on the angle, degrees, to which a layout tilts; of load cases that tilt the least, NaN: unknown."""
    found = solve_by_elements(assembly, labels, model)
    ends = [one.facts["tilt_bracket"] for one in (found, *found.cases.values()) if "tilt_bracket" in one.facts]
    low, high = zip(*ends, strict=True)
    return tuple(math.nan if None in end else min(end) for end in (low, high))  # type: ignore[return-value]


def furthest(evaluation: Evaluation, assembly: Assembly, labels: Bits) -> float:
    """Return the proven angle to which a layout tilts, for `--objective tilt_angle`."""
    if not directions(assembly):
        raise InputError("objective", "nothing is tilted", '"tilt" among the live loads')
    low = angle(assembly, labels)[0]
    return low if math.isfinite(low) else 0.0


def _row(entry: tuple[Any, tuple[float, float]]) -> tuple[Any, Mapping[str, Any]]:
    """Return a row and the facts of its angle."""
    return entry[0], tilt_facts(entry[1])


class Tilting(Step):
    """Angles of the best layouts, in degrees: columns of their rows, and of the best an entry of the summary."""

    name = "tilt_angle"

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        """Return the angles of the best layouts by their rows."""
        rows = done.results.head(_BEST)
        layouts = zip(rows.index, rows["labelling"], rows["status"], strict=True)
        return {
            row: angle(done.assembly, from_string(text), context.settings.model)
            for row, text, status in layouts
            if status == "collapse" and not context.deadline.passed()
        }

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        """Return the search with angles, if its scene is tilted."""
        if not directions(done.assembly) or context.settings.model.by_fields is not None:
            return done
        found = self.entries(done, context)
        table = {row: [facts["tilt_angle"], *facts["tilt_bracket"]] for row, facts in map(_row, found.items())}
        best = max(found.values(), default=(math.nan, math.nan), key=lambda ends: (not math.isnan(ends[0]), ends))
        columns = {
            name: [table.get(row, [None] * 3)[place] for row in done.results.index]
            for place, name in enumerate(("tilt_angle", "tilt_lo", "tilt_hi"))
        }
        return with_entries(done, tilt_facts(best), columns)
