"""The strongest segmentation, proven: incumbents by the genetic driver, bounds by mixed-integer programs.

What is trusted: every λ reported comes from a limit analysis with its own bracket. The upper bound over the whole
space is the branch-and-bound bound of the solver, whose rows and integrality hold to the tolerances in `milp`; a
program asked for λ above the incumbent by `_STEP` and found infeasible bounds λ by that.

Spaces the programs do not cover (spatial scenes, slits, blocks that hold supports, compressive strengths of joints,
normal forces without a bound, too many possible blocks) are enumerated, which proves the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core.assembly import Bits
from jld_core.bracket import load_floor
from jld_core.errors import InputError
from jld_core.program import Template
from jld_core.solvers.status import Status
from jld_explore.candidates import SearchSpace
from jld_explore.constraints import counts
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluator import Evaluation
from jld_explore.exact.caps import open_caps, tighten
from jld_explore.exact.formulations import Builder, Caps, Formulation
from jld_explore.exact.milp import INF, Outcome, run
from jld_explore.exact.polyominoes import Polyominoes, is_member, polyominoes
from jld_explore.labelling import blocks_of, canonical

_STEP: Final = 5e-7
"""How far above the incumbent, relative, the programs look: half of what counts as proven."""

PROVEN: Final = 1e-6
"""Relative distance of bound and incumbent at which the optimum is proven."""

_SEARCH: Final = 30
"""Labellings evaluated before the programs, for each face that can change."""

_SMALL: Final = 2
"""Elements in the largest block up to which blocks carry their own forces."""

_ROUNDS: Final = 3
"""Rounds of bounds on normal forces where faces carry them; blocks with forces of their own need but one."""


@dataclass(frozen=True)
class Best:
    """What is known of the labellings with one count, or of all (count None); λ in scene units.

    load_factor: best found, NaN where none. bound: proven upper bound, −inf where nothing stands or there is
    nothing, inf where nothing is known.
    """

    count: int | None
    load_factor: float
    bound: float

    @property
    def proven(self) -> bool:
        """Nothing is better by more than PROVEN, relative."""
        if self.bound == -math.inf:
            return True
        if not (math.isfinite(self.bound) and math.isfinite(self.load_factor)):
            return False
        size = max(abs(self.bound), abs(self.load_factor))
        return bool(self.bound - self.load_factor <= PROVEN * size)


class Exact(Driver):
    """Branch and bound over segmentations. aim: "best", or "front": the best for every value of the scene's count."""

    name = "exact"
    remembers = True

    def __init__(self, space: SearchSpace, seed: int, aim: str = "best") -> None:
        if aim not in ("best", "front"):
            raise InputError("--aim", f"there is no aim {aim!r}", "best or front")
        self.space, self.seed, self.aim = space, seed, aim
        count = space.search.front.count
        if aim == "front" and count == "dry_length":
            raise InputError("search.front.count", "dry_length has no exact front", "dry_faces or blocks")
        self.template = Template(space.assembly)
        self._scale = self.template.scaling.load
        self._floor = load_floor(self.template)
        self._blocks = self._possible()
        self._builder = Builder(self.template, space, self._blocks) if self._blocks is not None else None
        self._everything = Enumeration(space) if self._blocks is None else None
        self._genetic = Genetic(space, seed, aims=2 if aim == "front" else 1)
        self._left = _SEARCH * int(space.candidates.sum())
        self._known: dict[bytes, tuple[float, float, int]] = {}
        self._searching = True
        self._excluded: list[Bits] = []
        self._targets: list[int | None] = [None]
        self._listed = aim == "best"
        self.found: dict[int | None, Best] = {None: Best(None, math.nan, math.inf)}
        self.nodes = 0
        self.programs = 0
        self._deadline: float | None = None
        self._pulse: Callable[[], None] = lambda: None

    def _possible(self) -> Polyominoes | None:
        strengths = self.template.assembly.strengths
        if self.template.assembly.dimension != 2 or np.isfinite(strengths.crush_dry).any():
            return None
        return polyominoes(self.space)

    @property
    def settings(self) -> dict[str, Any]:
        return {"aim": self.aim}

    @property
    def bound(self) -> float | None:
        """Proven upper bound on λ over the whole space, scene units; None where there is none yet."""
        best = self.found[None]
        return best.bound if math.isfinite(best.bound) else None

    @property
    def finished(self) -> bool:
        """All that was aimed at is proven."""
        return self._everything is None and not self._targets and all(best.proven for best in self.found.values())

    @property
    def working(self) -> bool:
        """See `Driver.working`."""
        return self._everything is None and bool(self._targets)

    def attend(self, deadline: float | None, pulse: Callable[[], None]) -> None:
        """See `Driver.attend`."""
        # what was found last must still be evaluated
        self._deadline = None if deadline is None else deadline - 0.3
        self._pulse = pulse

    def recall(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take incumbents (k, m) from a study that is gone on with."""
        self._learn(labellings, evaluations)

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        if self._everything is not None:
            return self._everything.ask(limit)
        if self._left > 0:
            found = self._genetic.ask(self._left if limit is None else min(limit, self._left))
            self._left = self._left - len(found) if len(found) else 0
            if len(found):
                return found
        self._searching = False
        while self._targets and not self._late:
            proposed = self._pursue(self._targets[0])
            if proposed is not None:
                return proposed
            if self._everything is not None:
                return self._everything.ask(limit)
        return np.empty((0, len(self.space.fixed)), dtype=bool)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        if self._everything is not None:
            self._everything.tell(labellings, evaluations)
            return
        if self._searching:
            self._genetic.tell(labellings, evaluations)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        tally = counts(self.space.assembly, labellings, self.space.graph)
        number = tally.blocks if self.space.search.front.count == "blocks" else tally.dry_faces
        for labels, found, count in zip(labellings, evaluations, number.tolist(), strict=True):
            low = found.low if found.status is Status.COLLAPSE else -math.inf
            high = found.high if found.status is Status.COLLAPSE else -math.inf
            if found.status in (Status.LOCKED, Status.UNCERTIFIED, Status.FAILED):
                high = math.inf
            self._known[np.packbits(labels).tobytes()] = (low, high, count)
        for target, best in self.found.items():
            low = self._incumbent(target)
            if math.isfinite(low) and not best.load_factor >= low:
                self.found[target] = replace(best, load_factor=low)

    def _incumbent(self, target: int | None) -> float:
        fitting = (low for low, _, count in self._known.values() if target is None or count == target)
        return max(fitting, default=-math.inf)

    @property
    def _late(self) -> bool:
        return self._deadline is not None and time.perf_counter() >= self._deadline

    # --- one target -------------------------------------------------------------------------------------

    def _pursue(self, target: int | None) -> Bits | None:
        """Go on with a target: a labelling to be evaluated, (1, m), or None when it is settled or time is up."""
        assert self._builder is not None
        assert self._blocks is not None
        best = self.found[target]
        if best.proven:
            self._settle(target, best)
            return None
        low = self._incumbent(target)
        least = low + _STEP * max(abs(low), self._floor) if math.isfinite(low) else 0.0
        caps = tighten(
            self._builder, open_caps(len(self.space.fixed), least / self._scale), self._rounds, lambda: self._late
        )
        if caps is None:
            self._give_way()
            return None
        ceiling = least if math.isfinite(low) else -math.inf
        if caps.most <= caps.least:
            self._settle(target, replace(best, bound=self._with_excluded(ceiling, target)))
            return None
        bound = min(best.bound, caps.most * self._scale)
        self.found[target] = replace(best, bound=bound)
        if self._late:
            return None
        form = self._formulation(caps, target)
        outcome = self._run(form, target, max(least, 0.0))
        if outcome.status == "infeasible":
            self._settle(target, replace(self.found[target], bound=self._with_excluded(ceiling, target)))
            return None
        if outcome.point is None:
            if not self._late:
                raise RuntimeError("the solver stopped for a reason of its own")
            return None
        chosen = np.flatnonzero(outcome.point[list(form.x)] > 0.5)
        labels = self._blocks.labelling(self.space, chosen)
        if not is_member(self.space, labels):
            raise RuntimeError("the solver chose a labelling outside the space")
        labels = np.asarray(canonical(labels[None], self.space.group)[0])
        if np.packbits(labels).tobytes() in self._known:
            # within tolerances of the program it seems to reach more than it does: rule it out
            self._excluded.append(labels)
            return None
        proposed: Bits = labels[None]
        return proposed

    @property
    def _rounds(self) -> int:
        assert self._blocks is not None
        largest = max((len(members) for members in self._blocks.members), default=0)
        return 1 if largest <= _SMALL else _ROUNDS

    def _formulation(self, caps: Caps, target: int | None) -> Formulation:
        assert self._builder is not None
        assert self._blocks is not None
        form = self._builder.pieces(caps) if self._rounds == 1 else self._builder.faces(caps)
        program = form.program
        if target is not None:
            free = float(self.space.assembly.free_faces.sum())
            by_blocks = self.space.search.front.count == "blocks"
            value = float(target) if by_blocks else free - target
            program.bound_row(form.blocks_row if by_blocks else form.dry_row, value, value)
        index = {inside_of: p for p, inside_of in enumerate(self._blocks.members)}
        for labels in self._excluded:
            for image in np.unique(labels[self.space.group], axis=0):
                members = self._members(image)
                columns = [form.x[index[block]] for block in members]
                program.row(columns, [1.0] * len(columns), -INF, len(columns) - 1.0)
        return form

    def _members(self, labels: Bits) -> list[tuple[int, ...]]:
        names = blocks_of(self.space.graph, labels)
        free = self.space.assembly.elements.free
        return [tuple(free[names[free] == name].tolist()) for name in np.unique(names[free])]

    def _run(self, form: Formulation, target: int | None, least: float) -> Outcome:
        def stop(bound: float) -> bool:
            if abs(bound) < INF:
                self._lower(target, max(bound * self._scale, least))
            self._pulse()
            return self._late

        outcome = run(form.program.load(), stop=stop)
        self.nodes += outcome.nodes
        self.programs += 1
        if outcome.status == "optimal":
            self._lower(target, max(outcome.bound * self._scale, least))
        return outcome

    def _lower(self, target: int | None, bound: float) -> None:
        best = self.found[target]
        bound = self._with_excluded(bound, target)
        if bound < best.bound:
            self.found[target] = replace(best, bound=bound)

    def _with_excluded(self, bound: float, target: int | None) -> float:
        """A bound on all but the labellings ruled out, made one on those as well."""
        for labels in self._excluded:
            _, high, count = self._known[np.packbits(labels).tobytes()]
            if target is None or count == target:
                bound = max(bound, high)
        return bound

    def _settle(self, target: int | None, best: Best) -> None:
        """Close a target; the best labelling of all says which counts are worth a look."""
        self.found[target] = best
        self._targets.remove(target)
        if not self._listed:
            self._listed = True
            for count in self._counts():
                low = self._incumbent(count)
                known = low if math.isfinite(low) else math.nan
                self.found[count] = Best(count, known, best.bound)
                self._targets.append(count)

    def _counts(self) -> list[int]:
        """Values that the count of the front may take."""
        search, assembly = self.space.search, self.space.assembly
        if search.front.count == "blocks":
            (low, high), most = search.blocks, len(assembly.elements.free)
        else:
            (low, high), most = search.dry_faces, int(assembly.free_faces.sum())
        return list(range(low or 0, (most if high is None else min(high, most)) + 1))

    def _give_way(self) -> None:
        """Normal forces have no bound here: look at every labelling instead."""
        self._everything = Enumeration(self.space)
        self._targets = []


def front(driver: Exact) -> list[dict[str, Any]]:
    """The proven front of a driver: count, load_factor, bound, proven; counts nothing stands at are left out."""
    rows: list[dict[str, Any]] = []
    for count, best in driver.found.items():
        if count is None or (math.isnan(best.load_factor) and best.bound == -math.inf):
            continue
        known = None if math.isnan(best.load_factor) else best.load_factor
        bound = best.bound if math.isfinite(best.bound) else None
        rows.append({"count": count, "load_factor": known, "bound": bound, "proven": best.proven})
    return sorted(rows, key=lambda row: int(row["count"]))


__all__ = ["PROVEN", "Best", "Exact", "front"]
