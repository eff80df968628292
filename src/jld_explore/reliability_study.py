"""Rank the best layouts of a search by their reliability index."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core.deadline import Deadline
from jld_core.errors import ParameterError
from jld_core.files import write_text
from jld_core.limit import Status
from jld_core.scene import Scene
from jld_explore.reliability.analysis import ReliabilityOptions, analyse
from jld_explore.reliability.structure import random_structure
from jld_explore.report import Exploration, Summary, csv_of
from jld_explore.report.result_files import write_results
from jld_explore.settings import ExploreSettings
from jld_explore.space import from_string

FILE: Final = "reliability.csv"
"""Name of the table of reliability indices in a results folder."""

_KEPT: Final = ("beta_form", "beta_monte_carlo", "probability", "failures", "samples", "undecided")
"""Keys of an analysis that become columns of the table."""

COLUMNS: Final = ("row", "labelling", "load_factor", *_KEPT)
"""Columns of the table."""

SAMPLES: Final = 10_000
"""Samples of each layout: less than `jld reliability` draws, since it ranks alone."""

_SHARE: Final = 0.25
"""Share of a time limit that is kept back for the ranking."""


def refuse_beside_reliability(scene: Scene, settings: ExploreSettings) -> None:
    """Raise InputError for settings or scenes without a ranking by reliability."""
    if settings.reliability is None:
        return
    for name, asked in (
        ("objective", settings.model.friction != "associative" or settings.own_objective is not None),
        ("robust", settings.robust),
        ("contact", settings.model.contact != "convex"),
        ("effective_area", settings.model.effective_area),
        ("inner_bending", settings.model.inner_bending != "uncoupled"),
        ("cracks", scene.cracks != "faces"),
        ("search.void", scene.search.void is not None),
    ):
        if asked:
            raise ParameterError(name, "reliability supports rigid faces and associative friction only", "its default")
    random_structure(scene)


def kept_back(settings: ExploreSettings) -> float:
    """Return the part of the time limit that is kept back for the ranking, s; 0 without one."""
    return 0.0 if settings.reliability is None else _SHARE * (settings.seconds or 0.0)


def add_reliability(done: Exploration, settings: ExploreSettings, deadline: Deadline) -> Exploration:
    """Compute the reliability of the best layouts of a search, and add it to its files.

    Parameters
    ----------
    done : Exploration
        Finished search.
    settings : ExploreSettings
        Settings of the search; `reliability` is the number of layouts, `seed` that of the samples.
    deadline : Deadline
        Time after which no layout is begun; the first is always computed.

    Returns
    -------
    Exploration
        The search with columns `beta_form` and `beta_monte_carlo`, and a summary of the ranking.
    """
    structure = random_structure(done.scene)
    options = ReliabilityOptions(samples=SAMPLES, seed=settings.seed, jobs=settings.jobs)
    ranked = done.results[done.results["status"] == str(Status.COLLAPSE)].head(settings.reliability or 0)
    rows: list[dict[str, Any]] = []
    for number, (labelling, load) in enumerate(zip(ranked["labelling"], ranked["load_factor"], strict=True), 1):
        if rows and deadline.passed():
            break
        told = analyse(structure, from_string(str(labelling)), options).to_json()
        own = (number, str(labelling), float(load), *(told[key] for key in _KEPT))
        rows.append(dict(zip(COLUMNS, own, strict=True)))
    rows.sort(key=lambda row: (-_index(row), row["row"]))
    return _written(done, rows, len(ranked))


def _index(row: dict[str, Any]) -> float:
    """Return the index that ranks a layout, by simulation or of first order.

    It is +inf where no sample fails.
    """
    for name in ("beta_monte_carlo", "beta_form"):
        if row[name] is not None:
            return float(row[name])
    return -np.inf if row["probability"] == 1.0 else np.inf


def _written(done: Exploration, rows: list[dict[str, Any]], asked: int) -> Exploration:
    """Write the table, the results and the summary; return the search with both.

    rows: of the table, most reliable first. asked: layouts that were to be ranked.
    """
    import pandas as pd  # slow to import and needed for tables only

    by_labelling = {row["labelling"]: row for row in rows}
    columns = {
        name: [by_labelling[one][name] if one in by_labelling else None for one in done.results["labelling"]]
        for name in ("beta_form", "beta_monte_carlo")
    }
    results = done.results.assign(**{name: np.array(values, dtype=float) for name, values in columns.items()})
    facts = {
        "layouts": rows,
        "left_out": asked - len(rows),
        "best_labelling": rows[0]["labelling"] if rows else None,
    }
    found = replace(done, results=results, summary=Summary.of({**done.summary.facts, "reliability": facts}))
    write_results(done.folder, results)
    write_text(done.folder / FILE, csv_of(pd.DataFrame(rows)))
    write_text(done.folder / "summary.json", json.dumps(found.summary.to_json(), indent=1))
    return found
