"""What follows a search: steps that add entries to its summary and columns to its results, and the runner of all."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

from jld_core import plugins
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.scene.schema import Scene
from jld_explore.report.columns import require_own_columns
from jld_explore.report.folder import save_tables
from jld_explore.report.reading import FIELD_PICTURE, Exploration
from jld_explore.report.tables import Summary
from jld_explore.search.settings import ExploreSettings
from jld_explore.space.search_space import SearchSpace


@dataclass(frozen=True)
class StepContext:
    """What a step may use beside the finished search.

    Attributes
    ----------
    space : SearchSpace
        The search space.
    settings : ExploreSettings
        The settings.
    deadline : Deadline
        After it nothing long is begun.
    """

    space: SearchSpace
    settings: ExploreSettings
    deadline: Deadline


class Step(ABC):
    """What follows a search (abstract base class of the group ``jld.steps``).

    A subclass defines `entries`, which go into summary.json; one that adds columns to results overrides `run`.

    Attributes
    ----------
    name : str
        Key in summary.json.
    """

    name: ClassVar[str]

    def wanted(self, settings: ExploreSettings) -> bool:
        """Return whether the settings ask for the step; by default always."""
        return True

    def refuse(self, scene: Scene, assembly: Assembly, settings: ExploreSettings) -> None:  # noqa: B027
        """Raise InputError before the search if the step cannot follow it."""

    def seconds(self, settings: ExploreSettings) -> float:
        """Return the part of the time limit that is kept back for the step, s."""
        return 0.0

    @abstractmethod
    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        """Return what the summary holds under the name of the step, as JSON data."""

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        """Return the search with what the step adds; nothing is written."""
        return with_entries(done, {self.name: dict(self.entries(done, context))})


def with_entries(
    done: Exploration, entries: Mapping[str, Any], columns: Mapping[str, Any] | None = None
) -> Exploration:
    """Return a search with further entries of its summary and columns of its results; nothing is written.

    Parameters
    ----------
    done : Exploration
        Finished search.
    entries : Mapping of str to Any
        Entries of the summary.
    columns : Mapping of str to Any, optional
        Columns of the results.

    Returns
    -------
    Exploration
        Search with both.
    """
    results = done.results.assign(**columns) if columns else done.results
    return replace(done, results=results, summary=Summary.of({**done.summary.facts, **entries}))


def steps_of(settings: ExploreSettings, scene: Scene, assembly: Assembly, own: Iterable[Step] = ()) -> list[Step]:
    """Return the steps that settings ask for: own ones, then those of packages by name; or InputError."""
    require_own_columns()
    steps = list(own)
    for name, kind in plugins.load_all("jld.steps").items():
        if not (isinstance(kind, type) and issubclass(kind, Step) and getattr(kind, "name", None) == name):
            raise plugins.refuse_type("jld.steps", name, f"a subclass of jld_explore.Step with name = {name!r}")
        if name in Summary.__dataclass_fields__:
            raise plugins.refuse_type("jld.steps", name, "another name: every summary has an entry of this one")
        with plugins.guarded("jld.steps", name):
            steps.append(kind())
    wanted = []
    for step in steps:
        with plugins.guarded("jld.steps", getattr(step, "name", "")):
            if step.wanted(settings):
                step.refuse(scene, assembly, settings)
                wanted.append(step)
    return wanted


def run_steps(done: Exploration, steps: Iterable[Step], context: StepContext) -> Exploration:
    """Run steps in order, and write what they change after each, so that a killed one loses itself alone."""
    for step in steps:
        with plugins.guarded("jld.steps", getattr(step, "name", "")):
            done = save_tables(step.run(done, context), done, csv=context.settings.csv)
    return done


LATENESS: Final = (2.0, 0.05)
"""Time by which a command may pass its time limit: seconds, or a share of the limit if that is larger."""

TABLES: Final = 0.2
"""Share of `lateness` until which shapes of blocks are counted for tables."""

PAGE: Final = 0.5
"""Share of `lateness` until which layouts are solved for the page."""

PICTURES: Final = 0.85
"""Share of `lateness` at which the last picture is finished; the process ends in the remainder."""

# Share of `lateness` at which the tables of a search without pictures are written: others go on with them
_TABLES_ALONE: Final = 0.3

_WRITING: Final = 1.0  # processor time of tables and page of a small search, s

# Further processor time for each face, s: tables of blocks and the drawing on the page grow with the structure
_WRITING_FACE: Final = 2e-4

_PICTURES: Final = 1.0  # processor time of all pictures of a small search, s, imports included

_FIELDS: Final = 0.05  # share of a time limit in which bounds by fields are refined for a picture

_MOST_KEPT: Final = 0.5  # largest share of a time limit that is kept back

BUSY: Final = 6.0
"""Largest factor by which a busy machine may prolong the writing."""


def lateness(seconds: float | None) -> float:
    """Return the time by which a command may pass its time limit `seconds`, s."""
    return max(LATENESS[0], LATENESS[1] * (seconds or 0.0))


def later(deadline: Deadline, settings: ExploreSettings, share: float) -> Deadline:
    """Return a deadline that is later than a time limit, by a share of `lateness`."""
    return deadline.earlier(-share * lateness(settings.seconds))


def busy_factor(clock: float, processor: float) -> float:
    """Return the factor by which a busy machine prolongs work.

    Parameters
    ----------
    clock, processor : float
        Time by the clock and processor time of the same work, s.

    Returns
    -------
    float
        1 to `BUSY`.
    """
    return min(max(1.0, clock / max(processor, 1e-9)), BUSY)


def field_seconds(limit: float | None) -> float:
    """Return the time in which bounds by fields are refined for a picture, s."""
    return FIELD_PICTURE if limit is None else min(FIELD_PICTURE, _FIELDS * limit)


def search_deadline(deadline: Deadline, settings: ExploreSettings, assembly: Assembly, *, fields: bool) -> Deadline:
    """Return the deadline of the search itself, which leaves time to write tables, page and pictures."""
    if settings.seconds is None:
        return deadline
    # What has been done so far tells how much longer writing takes on a busy machine.
    busy = busy_factor(deadline.elapsed(), time.process_time())
    expected, share = busy * (_WRITING + _WRITING_FACE * assembly.faces), _TABLES_ALONE
    if settings.pictures:
        expected, share = expected + busy * _PICTURES, PICTURES
        expected += field_seconds(settings.seconds) if fields else 0.0
    kept = max(0.0, expected - share * lateness(settings.seconds))
    return deadline.earlier(min(kept, _MOST_KEPT * settings.seconds))
