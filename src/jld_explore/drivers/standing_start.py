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

_FALLEN_FIRST: Final = 64  # layouts of the search itself of which none stands before others are looked at
_LAYOUT_SHARES: Final = (0.25, 4.0)  # layouts looked at for each one of the search, without and with success of late
_JUDGED_AFTER: Final = 256  # layouts looked at after which success is judged
_GAIN: Final = 0.02  # relative loss of the least bond among them that counts as one
_BATCH: Final = 8  # layouts solved between two looks at the deadline
_LARGEST_BOND: Final = 30.0  # largest bond looked at, in dead load per volume times the size of the structure
_STANDS: Final = 1e-5  # bond up to which a layout counts as standing, likewise; its evaluation decides


class StandingStart:
    """Look for layouts that stand, by a driver `search` makes, once a search has found none among its first ones."""

    def __init__(self, space: SearchSpace, search: Callable[[SearchSpace], Driver | None]) -> None:
        self._space, self._search = space, search
        self._driver: Driver | None = None
        self._analyses: list[LimitAnalysis] = []
        self._evaluated, self._layouts_per_evaluation = 0, _LAYOUT_SHARES[1]  # evaluations of the search itself
        self._layouts_due, self._layouts_since = 0.0, 0  # layouts to look at, and those since success was judged
        self._least_bond = self._least_before = math.inf  # least bond, and that when success was judged last
        self._ended = False

    def watch(self, evaluations: Sequence[Evaluation]) -> None:
        """Count evaluations of the search; the first layout that stands, or may, ends the start."""
        self._ended = self._ended or any(evaluation.status is not Status.UNSTABLE for evaluation in evaluations)
        self._evaluated += len(evaluations)
        self._layouts_due += self._layouts_per_evaluation * len(evaluations)

    def rows(self) -> Bits:
        """Return layouts (k, m) that should stand, if there are some among as many as are due."""
        standing = np.empty((0, len(self._space.fixed)), dtype=bool)
        if self._ended:
            self._driver, self._analyses = None, []
        if self._ended or self._evaluated < _FALLEN_FIRST or self._layouts_due < 1.0:
            return standing
        self._driver = driver = self._driver or self._make_driver()
        while driver is not None and self._layouts_due >= 1.0 and not len(standing):
            checkpoint()
            if not len(labellings := driver.ask()):
                driver = None
                break
            standing = self._tell_bonds(driver, labellings)
            self._layouts_due -= len(labellings)
            self._layouts_since += len(labellings)
            if self._layouts_since >= _JUDGED_AFTER or len(standing):  # what should stand and does not is no success
                self._layouts_per_evaluation = _LAYOUT_SHARES[
                    self._least_bond < (1.0 - _GAIN) * self._least_before and not len(standing)
                ]
                self._layouts_since, self._least_before = 0, self._least_bond
        self._ended = driver is None
        return standing

    def _make_driver(self) -> Driver | None:
        """Return a driver of the layouts under a bond; None without dead load, all cells or a batch solver."""
        if self._space.void is not None or not self._space.assembly.total_dead:
            return None
        glued = _glued(self._space.assembly)
        self._analyses = [LimitAnalysis(case) for case in glued.by_case]
        if any(analysis.batch is None for analysis in self._analyses):
            return None
        glued_space = replace(self._space, assembly=glued)
        glued_space.__dict__.update(limits=self._space.limits, laying=self._space.laying)  # loads do not matter to them
        return self._search(glued_space)

    def _tell_bonds(self, driver: Driver, rows: Bits) -> Bits:
        """Tell the driver of labellings (k, m), better for less bond; return those that should stand."""
        bond, cases = self._bonds(rows)
        values = (1.0 / np.maximum(bond, _STANDS)).tolist()
        governing = cases.tolist() if self._analyses[1:] else [-1] * len(rows)
        pairs = zip(values, governing, strict=True)
        driver.tell(rows, [Evaluation(Status.COLLAPSE, score, score, score, governing=case) for score, case in pairs])
        self._least_bond = min(self._least_bond, float(bond.min()))
        return np.asarray(rows[bond <= _STANDS])

    def _bonds(self, labellings: Bits) -> tuple[Floats, Ints]:
        """Return the bond that labellings (k, m) lack, as `_LARGEST_BOND`, and the case that lacks most: (k,)."""
        bonds = np.full((len(self._analyses), len(labellings)), 2.0 * _LARGEST_BOND)
        for bonds_of_case, analysis in zip(bonds, self._analyses, strict=True):
            assert analysis.batch is not None
            parts = []
            for first in range(0, len(labellings), _BATCH):
                checkpoint()
                parts.append(analysis.batch.solve(labellings[first : first + _BATCH]))
            answer = BatchResults.joined(parts)
            bounded = (answer.verdict != FALLS) & np.isfinite(answer.low)
            bonds_of_case[bounded] = _LARGEST_BOND * (1.0 - analysis.template.scaling.load * answer.low[bounded])
            bonds_of_case[answer.verdict == LOCKED] = 0.0
        return bonds.max(axis=0), bonds.argmax(axis=0)


def _glued(assembly: Assembly) -> Assembly:
    """Return an assembly under dead load and a bond of `_LARGEST_BOND`, which a load factor of 1 takes away."""
    # With N + t A in the place of N a bond t of dry faces is a load that pulls both sides of every face together; what
    # inner faces gain by that goes to zero with t. One program gives the least t at which a layout stands.
    elements = assembly.elements
    unit = assembly.total_dead / float(elements.volume[elements.free].sum()) * assembly.size
    pull = bond_pull(assembly, _LARGEST_BOND * unit * assembly.interfaces.area * ~assembly.of_members)
    bond, release = Loads.of_resultants(pull), Loads.of_resultants(-pull)
    dead = list({case.dead.tobytes(): case.dead_loads + bond for case in assembly.by_case}.values())
    cases = tuple(LoadCase(str(k), loads, release) for k, loads in enumerate(dead))
    return replace(
        assembly,
        cases=cases if cases[1:] else (),
        dead_loads=dead[0],
        live_loads=release,
        face_strengths=assembly.face_strengths.without_nominal(),
    )
