"""Choose the driver and the number of jobs of a search, and say why a search found no layout."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError, ParameterError
from jld_core.models import require_cracks
from jld_core.models.costs import require_memory
from jld_core.models.rigid_blocks import require_model
from jld_core.scene.cracks import FieldCracks
from jld_core.scene.schema import Scene
from jld_core.strengths import Route
from jld_core.threads import memory_limit
from jld_explore.drivers import make_driver
from jld_explore.drivers.base import Driver
from jld_explore.drivers.choice import REACH, driver_for, driver_named
from jld_explore.drivers.enumeration import Enumeration, size_up_to
from jld_explore.drivers.exact.certifying import check_certifiable
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.field_exact import FieldExact
from jld_explore.search.settings import ExploreSettings
from jld_explore.space.search_space import SearchSpace

CLASSES: Final = "classes (layouts, those alike by symmetry once)"
"""Term "classes" with its explanation, used where it first appears."""

_STAGE_SECONDS: Final = 1.0  # longest time to find out which stage of laying falls first, for a message, s
_MAKING_SECONDS: Final = 1.0  # time to make a driver once the time of a search is over, s

# Share of the remaining time for counting the classes of a space; a slower count means that the space is large.
COUNTING: Final = 0.06


def choose_driver(
    space: SearchSpace,
    settings: ExploreSettings,
    deadline: Deadline | None = None,
    *,
    bounded: bool = True,
    cracks_by_fields: FieldCracks | None = None,
) -> tuple[Driver, int | None]:
    """Return the driver, and the number of classes of a small space; bounded: mechanisms bound the objective."""
    # They bound no objective of the user, no experiment and no reliability.
    driver = settings.driver
    if isinstance(driver, str):
        driver_named(driver)
    # A driver chosen by name needs the size of the space for progress reports only. Spaces beyond the reach of a proof
    # are hardly ever small, and the genetic driver comes to the end of those that are.
    quick_count = isinstance(driver, str) and driver != Enumeration.name
    quick_count |= driver is None and int(space.candidates.sum()) > REACH
    deadline = Deadline() if deadline is None else deadline
    class_count = None
    with suppress(DeadlinePassed), deadline.within(COUNTING * deadline.remaining()).enforced():
        class_count = size_up_to(space, settings.small, quick=quick_count) if settings.small else None
    if class_count == 0:
        raise no_layout_error(space)
    if isinstance(driver, Driver):
        return driver, class_count
    if driver is None:
        ranked_otherwise = settings.experiment is not None or settings.reliability is not None
        bounded &= not (settings.by_experiment or ranked_otherwise or settings.own_objective is not None)
        make: Callable[[], Driver] = partial(
            driver_for, space, settings.seed, settings.model, class_count, settings.options, bounded=bounded
        )
    elif driver == FieldExact.name and cracks_by_fields is not None:
        make = partial(FieldExact.to_gap, cracks_by_fields.gap, space, settings.seed, settings.options)
    else:
        make = partial(make_driver, driver, space, settings.seed, **settings.options)
    # The exact driver prepares for its space in a share of the time left. Where none is left it is made once more, in
    # a second: preparation ends by itself within its share.
    for limit in (deadline, Deadline(_MAKING_SECONDS)):
        with suppress(DeadlinePassed), limit.enforced():
            return make(), class_count
    raise no_layout_error(space, settings.seconds)


def no_layout_error(space: SearchSpace, seconds: float | None = None) -> InputError:
    """Return the InputError for a search without any layout; it says whether the space is proven empty."""
    where, problem, remedy = "search", "no labelling satisfies the constraints", "constraints that some labelling meets"
    if seconds is not None:
        problem = "no layout that satisfies the constraints was found"
    open_question = "" if seconds is None else f" within {seconds:.3g} s, nor a proof that there is none"
    if space.laying is not None and space.laying.refused:
        standing = space.search.assemble == "standing"
        demand = "stands at every stage without props" if standing else "can be laid"
        where = "search.assemble"
        among = "" if seconds is None else f" of {space.laying.refused} that were looked at"
        in_plane = space.assembly.dimension == 2 and not space.search.assemble_out_of_plane
        remedy = "assemble_out_of_plane, or no such limit" if in_plane else "no such limit"
        remedy = '"translation", with centring' if standing else remedy
        problem = f"no layout{among} {demand}"
        if seconds is None and space.laying.undecided:
            problem = f"no layout was found that {demand}"
            open_question = f", and for {space.laying.undecided} of them the search for an order stopped at its limit"
        farthest = space.laying.words_of_farthest(_STAGE_SECONDS) if standing else None
        if farthest is not None:
            open_question += f"; the one that gets farthest falls at {farthest}"
    return InputError(where, problem + open_question, remedy if seconds is None else f"{remedy}, or more seconds")


def affordable_settings(assembly: Assembly, settings: ExploreSettings, messages: list[str]) -> ExploreSettings:
    """Return settings with as many jobs as memory allows, with messages; InputError for too little."""
    cost = require_memory(assembly)
    jobs = max(1, min(settings.jobs, int(memory_limit() / cost.memory))) if settings.jobs > 1 else 1
    if jobs < settings.jobs:
        messages.append(f"jobs: {jobs} of {settings.jobs}, as each takes some {cost.memory / 1e9:.1f} GB of memory")
    if cost.long is not None:
        limit = "" if settings.seconds is None else "; the time limit may be passed by that"
        messages.append(f"{cost.long}{limit}")
    return replace(settings, jobs=jobs)


# Why a driver with conflicts of single faces refuses other crack models
_SHARED: Final = (
    "proves by mechanisms at faces with a label each, and by cells or fields one label holds for many cracks"
)
_ROUTE: Final = Route("the virtual experiment")


def refuse_together(scene: Scene, settings: ExploreSettings, assembly: Assembly) -> None:
    """Raise InputError for settings that exclude each other or do not support the loads."""
    # With `strict` it is also raised for the first warning of the assembly.
    if assembly.warnings and settings.strict:
        raise InputError("", assembly.warnings[0], "a scene without warnings, or `strict=False`")
    refuse_beside_cracks(scene, settings, assembly)
    if settings.certificate is not None and settings.robust:
        raise ParameterError("certificate", "it proves λ at one value of each strength", "a search with `robust=False`")
    if settings.model.ranks_by_lower_bound and assembly.dimension == 3:
        raise ParameterError("objective", "spatial scenes have no bound without dilation", "zero-dilation")
    if settings.certificate is not None and settings.by_experiment:
        raise ParameterError("certificate", "an experiment is no proof", '`objective="associative"`')
    if settings.by_experiment or settings.experiment is not None:
        assembly.strengths(_ROUTE)  # refuses what experiments would refuse after the search has begun
    refuse_beside_own_objective(scene, settings)


def refuse_beside_own_objective(scene: Scene, settings: ExploreSettings) -> None:
    """Raise InputError for settings that exclude an objective of the user; nothing is refused without one."""
    # Such settings need bounds on λ, or rank by something else.
    if settings.own_objective is None:
        return
    driver = settings.driver
    proves = driver.modular if isinstance(driver, Driver) else driver == Exact.name
    for name, is_set in (
        ("`driver`", proves),
        ("`certificate`", settings.certificate is not None),
        ("`robust`", settings.robust),
        ("`experiment`", settings.experiment is not None),
        ("search.void", scene.search.void is not None),
        ("search.require", scene.search.require is not None),
    ):
        if is_set:
            raise ParameterError("objective", f"{name} needs λ, and the objective is a function", "one of both")


def refuse_beside_cracks(scene: Scene, settings: ExploreSettings, assembly: Assembly) -> None:
    """Raise InputError for settings that cracks by cells or by fields exclude."""
    # Scenes that crack along faces alone pass.
    if scene.cracks == "faces":
        return
    fields = isinstance(scene.cracks, FieldCracks)
    for option, is_set in (
        ("certificate", settings.certificate is not None),
        ("experiment", settings.experiment is not None or settings.by_experiment),
        ("objective", settings.own_objective is not None and fields),
        ("search.void", scene.search.void is not None),
        ("search.assemble", scene.search.assemble == "standing"),
    ):
        if is_set:
            raise ParameterError(
                option, "it supports cracks by faces only", 'a search without it, or "cracks": "faces"'
            )
    if isinstance(settings.driver, str) and settings.driver == Exact.name and not fields:
        raise ParameterError("driver", f"{Exact.name} {_SHARED}", 'another driver, or "cracks": "faces"')
    if fields and assembly.dimension == 3:
        raise ParameterError(
            "cracks", "one layout in space takes minutes by fields", "a search by faces, then solve by fields"
        )
    require_cracks(assembly, settings.model)


def refuse_unfit(scene: Scene, assembly: Assembly, settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError if driver, model, experiment or certificate do not fit the structure."""
    # If a certificate is requested, also restrict the exact driver to proofs that a certificate can hold.
    if driver.modular and scene.cracks != "faces":
        raise ParameterError("driver", f"{driver.name} {_SHARED}", "another driver")
    if isinstance(driver, FieldExact) and not isinstance(scene.cracks, FieldCracks):
        raise ParameterError("driver", "FieldExact proves by fields, and the scene cracks otherwise", "`Exact`")
    if driver.modular and not replace(settings.model, friction="associative").supports_bounds_over_labellings:
        raise ParameterError(
            "driver", f"{driver.name} has no bounds for this model", "convex contact on whole faces, uncoupled bending"
        )
    space = driver.space
    dry = (space.candidates | space.fixed) & (space.assembly.interfaces.b != space.assembly.sink)
    require_model(space.assembly, settings.model, dry)
    if settings.certificate is not None:
        check_certifiable(driver, settings.model, scene)


def refuse_beside_void(settings: ExploreSettings, driver: Driver) -> None:
    """Raise InputError for options that need a single structure if cells may be left out."""
    for option, is_set in (
        ("experiment", settings.experiment is not None or settings.by_experiment),
        ("driver", driver.modular),
    ):
        if is_set:
            raise ParameterError(option, "it needs one structure, and search.void leaves cells out", "a search without")
