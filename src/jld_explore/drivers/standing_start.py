"""Start of a search none of whose layouts stands: a search for the least bond that lets a layout stand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, LoadCase
from jld_core.batch.batch_solver import FALLS, LOCKED, BatchResults
from jld_core.build.materials import bond_pull
from jld_core.deadline import checkpoint
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import Status
from jld_core.loads import Loads
from jld_explore.drivers.base import Driver
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space.search_space import SearchSpace

_FIRST: Final = 64  # layouts of the search itself of which none stands before others are looked at
_SHARES: Final = (0.25, 4.0)  # layouts looked at for each one of the search, without and with success of late
_STRETCH: Final = 256  # layouts looked at after which success is judged
_GAIN: Final = 0.02  # relative loss of the least bond among them that counts as one
_LANES: Final = 8  # layouts solved between two looks at the deadline
_MOST: Final = 30.0  # largest bond looked at, in dead load per volume times the size of the structure
_NONE: Final = 1e-5  # bond up to which a layout counts as standing, likewise; its evaluation decides


class StandingStart:
    """Look for layouts that stand, by a driver `search` makes, once a search has found none among its first ones."""

    def __init__(self, space: SearchSpace, search: Callable[[SearchSpace], Driver | None]) -> None:
        self._space, self._search = space, search
        self._driver: Driver | None = None
        self._analyses: list[LimitAnalysis] = []
        self._fallen, self._due, self._looked, self._share = 0, 0.0, 0, _SHARES[1]
        self._least = self._before = math.inf  # least bond, and that when success was judged last
        self._over = False

    def watch(self, evaluations: Sequence[Evaluation]) -> None:
        """Count evaluations of the search; the first layout that stands, or may, ends the start."""
        self._over = self._over or any(one.status is not Status.UNSTABLE for one in evaluations)
        self._fallen += len(evaluations)
        self._due += self._share * len(evaluations)

    def rows(self) -> Bits:
        """Return layouts (k, m) that should stand, if there are some among as many as are due."""
        found = np.empty((0, len(self._space.fixed)), dtype=bool)
        if self._over:
            self._driver, self._analyses = None, []
        if self._over or self._fallen < _FIRST or self._due < 1.0:
            return found
        self._driver = driver = self._driver or self._made()
        while driver is not None and self._due >= 1.0 and not len(found):
            checkpoint()
            if not len(asked := driver.ask()):
                driver = None
                break
            found = self._told(driver, asked)
            self._due, self._looked = self._due - len(asked), self._looked + len(asked)
            if self._looked >= _STRETCH or len(found):  # what should stand and does not is no success
                self._share = _SHARES[self._least < (1.0 - _GAIN) * self._before and not len(found)]
                self._looked, self._before = 0, self._least
        self._over = driver is None
        return found

    def _made(self) -> Driver | None:
        """Return a driver of the layouts under a bond; None without dead load, all cells or a batch solver."""
        if self._space.void is not None or not self._space.assembly.total_dead:
            return None
        glued = _glued(self._space.assembly)
        self._analyses = [LimitAnalysis(case) for case in glued.by_case]
        if any(one.batch is None for one in self._analyses):
            return None
        own = replace(self._space, assembly=glued)
        own.__dict__.update(limits=self._space.limits, laying=self._space.laying)  # loads do not matter to them
        return self._search(own)

    def _told(self, driver: Driver, rows: Bits) -> Bits:
        """Tell the driver of labellings (k, m), better for less bond; return those that should stand."""
        bond, cases = self._bonds(rows)
        values = (1.0 / np.maximum(bond, _NONE)).tolist()
        governing = cases.tolist() if self._analyses[1:] else [-1] * len(rows)
        pairs = zip(values, governing, strict=True)
        driver.tell(rows, [Evaluation(Status.COLLAPSE, one, one, one, governing=case) for one, case in pairs])
        self._least = min(self._least, float(bond.min()))
        return np.asarray(rows[bond <= _NONE])

    def _bonds(self, labellings: Bits) -> tuple[Floats, Ints]:
        """Return the bond that labellings (k, m) lack, in the unit of `_MOST`, and the case that lacks most: (k,)."""
        found = np.full((len(self._analyses), len(labellings)), 2.0 * _MOST)
        for own, analysis in zip(found, self._analyses, strict=True):
            assert analysis.batch is not None
            parts = []
            for first in range(0, len(labellings), _LANES):
                checkpoint()
                parts.append(analysis.batch.solve(labellings[first : first + _LANES]))
            answer = BatchResults.joined(parts)
            known = (answer.verdict != FALLS) & np.isfinite(answer.low)
            own[known] = _MOST * (1.0 - analysis.template.scaling.load * answer.low[known])
            own[answer.verdict == LOCKED] = 0.0
        return found.max(axis=0), found.argmax(axis=0)


def _glued(assembly: Assembly) -> Assembly:
    """Return an assembly under dead load and a bond of `_MOST`, which a load factor of 1 takes away."""
    # With N + t A in the place of N a bond t of dry faces is a load that pulls both sides of every face together; what
    # inner faces gain by that goes to zero with t. One program gives the least t at which a layout stands.
    elements = assembly.elements
    unit = assembly.total_dead / float(elements.volume[elements.free].sum()) * assembly.size
    pull = bond_pull(assembly, _MOST * unit * assembly.interfaces.area * ~assembly.of_members)
    bond, release = Loads.of_resultants(pull), Loads.of_resultants(-pull)
    dead = list({case.dead.tobytes(): case.dead_loads + bond for case in assembly.by_case}.values())
    cases = tuple(LoadCase(str(k), one, release) for k, one in enumerate(dead))
    return replace(
        assembly,
        cases=cases if cases[1:] else (),
        dead_loads=dead[0],
        live_loads=release,
        face_strengths=assembly.face_strengths.without_nominal(),
    )
