"""Rank the best layouts of a search by their reliability index."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Deadline, ParameterError, Scene, Status, files
from jld_explore import Exploration, ExploreSettings, Step, StepContext, with_entries
from jld_explore.report import csv_of
from jld_explore.space import from_string

FILE: Final = "reliability.csv"  # table of reliability indices in a results folder

# Keys of an analysis that become columns of the table
_KEPT: Final = ("beta_form", "beta_monte_carlo", "probability", "failures", "samples", "undecided")

COLUMNS: Final = ("row", "labelling", "load_factor", *_KEPT)

SAMPLES: Final = 10_000  # samples of each layout: less than `jld reliability` draws, since it ranks alone

_SHARE: Final = 0.25  # share of a time limit that is kept back for the ranking


class ReliabilityStep(Step):
    name = "reliability"

    def wanted(self, settings: ExploreSettings) -> bool:
        return settings.reliability is not None

    def refuse(self, scene: Scene, assembly: Assembly, settings: ExploreSettings) -> None:
        for name, is_set in (
            ("objective", settings.model.friction != "associative" or settings.own_objective is not None),
            ("robust", settings.robust),
            ("contact", settings.model.contact != "convex"),
            ("effective_area", settings.model.effective_area),
            ("inner_bending", settings.model.inner_bending != "uncoupled"),
            ("cracks", scene.cracks != "faces"),
            ("search.void", scene.search.void is not None),
        ):
            if is_set:
                problem = "reliability supports rigid faces and associative friction only"
                raise ParameterError(name, problem, "its default")
        from jld_practice.reliability import random_structure

        random_structure(scene)

    def seconds(self, settings: ExploreSettings) -> float:
        return _SHARE * (settings.seconds or 0.0)

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        rows, count = _ranked(done, context.settings, context.deadline)
        return {
            "layouts": rows,
            "left_out": count - len(rows),
            "best_labelling": rows[0]["labelling"] if rows else None,
        }

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        import pandas as pd  # slow to import and needed for tables only

        entries = self.entries(done, context)
        files.write_text(done.folder / FILE, csv_of(pd.DataFrame(entries["layouts"])))
        by_labelling = {row["labelling"]: row for row in entries["layouts"]}
        rows = [by_labelling.get(str(labelling), {}) for labelling in done.results["labelling"]]
        columns = {
            name: np.array([row.get(name) for row in rows], dtype=float) for name in ("beta_form", "beta_monte_carlo")
        }
        return with_entries(done, {self.name: entries}, columns)


def _ranked(done: Exploration, settings: ExploreSettings, deadline: Deadline) -> tuple[list[dict[str, Any]], int]:
    """Return rows of the best layouts, most reliable first, and how many were to be ranked."""
    from jld_practice.reliability import ReliabilityOptions, analyse, random_structure

    structure = random_structure(done.scene)
    options = ReliabilityOptions(samples=SAMPLES, seed=settings.seed, jobs=settings.jobs)
    ranked = done.results[done.results["status"] == str(Status.COLLAPSE)].head(settings.reliability or 0)
    rows: list[dict[str, Any]] = []
    for number, (labelling, load) in enumerate(zip(ranked["labelling"], ranked["load_factor"], strict=True), 1):
        if rows and deadline.passed():
            break
        facts = analyse(structure, from_string(str(labelling)), options).to_json()
        own = (number, str(labelling), float(load), *(facts[key] for key in _KEPT))
        rows.append(dict(zip(COLUMNS, own, strict=True)))
    rows.sort(key=lambda row: (-_index(row), row["row"]))
    return rows, len(ranked)


def _index(row: dict[str, Any]) -> float:
    """Return the index that ranks a layout, by simulation or of first order; inf where no sample fails."""
    for name in ("beta_monte_carlo", "beta_form"):
        if row[name] is not None:
            return float(row[name])
    return -np.inf if row["probability"] == 1.0 else np.inf
