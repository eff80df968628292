"""Whole fronts proven with less shared between their points than is, for the table of fronts in `benchmarks.exact`."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from unittest.mock import patch

from jld_core import Scene, build_assembly
from jld_explore import ExploreSettings, explore
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.formula import Formula
from jld_explore.space import count_named, search_space
from jld_explore.space.limits import Range


class Apart(Exact):
    """Proves every point of a front by itself: what ruled out labellings of one is forgotten at the next."""

    forgotten = 0

    def _settle(self, target: int | None) -> None:
        super()._settle(target)
        self.forgotten += len(self._state.conflicts)
        self._state.clear()
        self._formula, self._said = None, (0, 0)


class Fixed(Formula):
    """A formula of one count, which clauses say instead of what is assumed."""

    def aim(self, threshold: float, count: int | Range | None = None) -> None:
        if isinstance(count, int):
            self._between(count_named(self.space.search.front.count), Range.of((count, count), whole=True))
        super().aim(threshold)


class Anew(Exact):
    """Proves with a formula of its own for every count and every λ aimed at, as was done before they shared one."""

    def _begin(self, target: int | None) -> None:
        self._formula, self._said = Fixed(self.space, self._blocks), (0, 0)
        super()._begin(target)


def front_by(kind: type[Exact], scene: Scene, most: float) -> tuple[Exact, float]:
    """A whole front proven by a driver, and the processor's seconds, `most` at the most."""
    driver = kind(search_space(scene, build_assembly(scene)), aim="front")
    settings = ExploreSettings(jobs=1, pictures=False, seconds=most)
    with tempfile.TemporaryDirectory() as folder, patch("time.perf_counter", time.process_time):
        facts = explore(scene, Path(folder) / "out", settings, driver=driver).summary.facts
    return driver, facts["seconds"]
