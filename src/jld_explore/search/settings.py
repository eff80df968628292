"""Settings of a search: model and objective, budget, parallel work, method, output."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Literal

from jld_core import plugins
from jld_core.errors import ParameterError
from jld_core.limit.options import SolveOptions
from jld_core.parameters import documented, near, require_field_types, setting
from jld_explore.drivers.base import Driver
from jld_explore.evaluation.cases import OwnObjective

OBJECTIVES: Final = ("associative", "zero-dilation", "zero-dilation-floor", "experiment", "reliability")
"""What a search maximises: λ with associative friction; without dilation the lowest λ found, or a proven bound below
it (-floor); what a virtual experiment carries; or the reliability index of the best layouts by λ."""

Objective = str | OwnObjective
"""An objective of jld or of a plug-in by name, or a function of an evaluation, the assembly and the labels."""

SMALL: Final = 20_000  # default of `SearchMethod.small`: number of classes up to which a space is enumerated by default
_RELIABLE: Final = 10  # layouts ranked by reliability where this is the objective and no number is given

# Processor time, s, for the lower bound of one labelling where this bound is the objective
_BOUND_SECONDS: Final = 20.0


@documented
@dataclass(frozen=True)
class ModelSettings:
    """Model of a search, and the objective that the search maximises."""

    model: SolveOptions = setting(SolveOptions(), "Model whose λ is maximised.")
    robust: bool = setting(False, "Use the low values of materials; λ at nominal values is stated as well.")
    experiment: int | None = setting(None, "Test the best K layouts in the virtual experiment; adds a column.", min=1)
    by_experiment: bool = setting(False, "Search by so many experiments at the end, default 500, from the best by λ.")
    own_objective: OwnObjective | None = setting(None, "Function that replaces λ, see `explore`.")
    check_fields: int = setting(10, "Check the best K by faces with stress fields, 0 for none.", min=0)
    reliability: int | None = setting(
        None, "Rank the best K by their reliability index; default 10 as objective.", min=1
    )

    def maximising(self, objective: Objective) -> ModelSettings:
        """Return the settings with another objective.

        Parameters
        ----------
        objective : str or callable
            Its name, or a function of an evaluation, the assembly and the labels.

        Returns
        -------
        ModelSettings

        Raises
        ------
        InputError
            If no objective has that name.
        """
        if callable(objective):
            return replace(self, own_objective=objective, by_experiment=False)
        if objective not in OBJECTIVES:
            return self.maximising(_plugin(objective))
        if objective.startswith("zero"):
            seconds = _BOUND_SECONDS if objective == "zero-dilation-floor" else 0.0
            model = replace(self.model, friction="zero-dilation", range=True, floor_seconds=seconds)
        else:
            model = replace(self.model.dilating, floor_seconds=self.model.floor_seconds)
        ranked = self.reliability or _RELIABLE if objective == "reliability" else self.reliability
        tested = objective == "experiment"
        return replace(self, model=model, by_experiment=tested, own_objective=None, reliability=ranked)


def _plugin(objective: object) -> OwnObjective:
    """Return the function of an objective that a plug-in brings; InputError for an unknown name."""
    points = plugins.entry_points("jld.objectives")
    if not isinstance(objective, str) or objective not in points:
        names = [*OBJECTIVES, *points]
        remedy = near(objective, names) if isinstance(objective, str) else ", ".join(names)
        raise ParameterError("objective", f"no objective is named {objective!r}", f"{remedy} or a function")
    function: OwnObjective = plugins.load("jld.objectives", objective)
    if not callable(function):
        raise plugins.refuse_type("jld.objectives", objective, "a function of (evaluation, assembly, labels)")
    return function


@documented
@dataclass(frozen=True)
class BudgetSettings:
    """Limits at which a search ends."""

    budget: int | None = setting(None, "Most layouts evaluated; those equal by symmetry count once.", min=1)
    seconds: float | None = setting(None, "Time limit, s.", min=0.0)

    def __post_init__(self) -> None:
        require_field_types(self)
        if self.budget is not None and self.budget < 1:
            raise ParameterError("budget", f"{self.budget} is no number of layouts", "a whole number from 1")
        if self.seconds is not None and not self.seconds >= 0.0:
            raise ParameterError("seconds", f"{self.seconds:g} is no time limit", "seconds, at least 0")


@documented
@dataclass(frozen=True)
class ParallelSettings:
    """Workers on which labellings are evaluated."""

    jobs: int = setting(1, "Worker processes.", min=1)
    cluster: str | None = setting(None, "URL of a dask scheduler, tcp://host:8786, whose workers evaluate layouts.")

    def __post_init__(self) -> None:
        require_field_types(self)
        if self.jobs < 1:
            raise ParameterError("jobs", f"{self.jobs} is no number of processes", "a whole number from 1")


@documented
@dataclass(frozen=True)
class SearchMethod:
    """Driver of a search, which decides the labellings to try and their order."""

    driver: str | Driver | None = setting(None, "Search driver; default: one that proves where the proof is in reach.")
    options: dict[str, Any] = setting(dict, "Options of a named driver.")
    seed: int = setting(0, "Seed of the driver.", min=0)
    small: int = setting(
        SMALL, "Classes up to which a space is counted, and enumerated if no driver is named; 0 omits the count."
    )

    def __post_init__(self) -> None:
        require_field_types(self)


@documented
@dataclass(frozen=True)
class OutputSettings:
    """Files that a search writes, and checks before it begins."""

    resume: bool = setting(False, "Continue the search in the folder.")
    pictures: bool | Literal["all"] = setting(
        True, 'Page, front and best layout; "all": distribution, frequency of dry faces and convergence too.'
    )
    certificate: Path | None = setting(None, "File for the proof of the exact driver; jld verify checks it.")
    strict: bool = setting(False, "Treat plausibility warnings as errors.")
    csv: bool = setting(False, "Write results.csv for more than 20 000 layouts too.")


Part = ModelSettings | BudgetSettings | ParallelSettings | SearchMethod | OutputSettings
"""Settings of one concern."""


@documented
@dataclass(frozen=True)
class ExploreSettings(OutputSettings, SearchMethod, ParallelSettings, BudgetSettings, ModelSettings):
    """Settings of a search: all fields of the five concerns.

    Make it from keywords, as in `ExploreSettings(driver="exact", seconds=60)`, or from parts by `of`.
    """

    def __post_init__(self) -> None:
        BudgetSettings.__post_init__(self)
        ParallelSettings.__post_init__(self)

    @classmethod
    def of(cls, *parts: Part) -> ExploreSettings:
        """Return the settings made of parts; a concern without a part has its defaults.

        Parameters
        ----------
        *parts : ModelSettings, BudgetSettings, ParallelSettings, SearchMethod or OutputSettings
            Settings of one concern each.
        """
        return cls(**{field.name: getattr(part, field.name) for part in parts for field in fields(part)})

    def maximising(self, objective: Objective) -> ExploreSettings:
        """Return a copy of the settings with another objective.

        Arguments and errors are those of `ModelSettings.maximising`.
        """
        part = ModelSettings(**{field.name: getattr(self, field.name) for field in fields(ModelSettings)})
        changed = part.maximising(objective)
        return replace(self, **{field.name: getattr(changed, field.name) for field in fields(ModelSettings)})
