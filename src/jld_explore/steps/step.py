"""What follows a search: steps that add entries to its summary and columns to its results, and the runner of all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from jld_core import plugins
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.scene import Scene
from jld_explore.report import Exploration
from jld_explore.report.folder import save_tables
from jld_explore.report.summary import Summary
from jld_explore.search.settings import ExploreSettings
from jld_explore.space import SearchSpace


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
    steps = list(own)
    for name, kind in plugins.load_all("jld.steps").items():
        if not (isinstance(kind, type) and issubclass(kind, Step) and getattr(kind, "name", None) == name):
            raise plugins.refuse_type("jld.steps", name, f"a subclass of jld_explore.Step with name = {name!r}")
        steps.append(kind())
    wanted = [step for step in steps if step.wanted(settings)]
    for step in wanted:
        step.refuse(scene, assembly, settings)
    return wanted


def run_steps(done: Exploration, steps: Iterable[Step], context: StepContext) -> Exploration:
    """Run steps in order, and write what they change after each, so that a killed one loses itself alone."""
    for step in steps:
        done = save_tables(step.run(done, context), done, csv=context.settings.csv)
    return done
