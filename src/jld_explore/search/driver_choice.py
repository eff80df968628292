"""Choose the driver and the number of jobs of a search, and say why a search found no layout."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError
from jld_core.models import require_memory
from jld_core.scene.cracks import FieldCracks
from jld_core.threads import memory_limit
from jld_explore.drivers import Driver, make_driver
from jld_explore.drivers.choice import REACH, driver_for
from jld_explore.drivers.enumeration import Enumeration, size_up_to
from jld_explore.drivers.field_exact import FieldExact
from jld_explore.drivers.registry import driver_named
from jld_explore.search.settings import ExploreSettings
from jld_explore.space import SearchSpace

CLASSES: Final = "classes (layouts, those alike by symmetry once)"
"""Term "classes" with its explanation, used where it first appears."""

_SAYING: Final = 1.0  # longest time to find out which stage of laying falls first, for a message, s

COUNTING: Final = 0.06
"""Share of the remaining time for counting the classes of a space; a slower count means that the space is large."""


def choose_driver(
    space: SearchSpace,
    settings: ExploreSettings,
    deadline: Deadline | None = None,
    *,
    many: bool = False,
    cracks_by_fields: FieldCracks | None = None,
) -> tuple[Driver, int | None]:
    """Return the driver, and the number of classes of a small space; many: no proof by faces alone unless named."""
    wanted = settings.driver
    if isinstance(wanted, str):
        driver_named(wanted)
    # A driver chosen by name needs the size of the space for progress reports only. Spaces beyond the reach of a proof
    # are hardly ever small, and the genetic driver comes to the end of those that are.
    quick = isinstance(wanted, str) and wanted != Enumeration.name
    quick |= wanted is None and int(space.candidates.sum()) > REACH
    deadline = Deadline() if deadline is None else deadline
    known = None
    with suppress(DeadlinePassed), deadline.within(COUNTING * deadline.remaining()).enforced():
        known = size_up_to(space, settings.small, quick=quick) if settings.small else None
    if known == 0:
        raise nothing_found(space)
    if isinstance(wanted, Driver):
        return wanted, known
    if wanted is None:
        several = settings.experiment is not None or settings.reliability is not None
        many = many or settings.by_experiment or several or settings.own_objective is not None
        make: Callable[[], Driver] = partial(
            driver_for, space, settings.seed, settings.model, known, settings.options, many=many
        )
    elif wanted == FieldExact.name and cracks_by_fields is not None:
        make = partial(FieldExact.to_gap, cracks_by_fields.gap, space, settings.seed, settings.options)
    else:
        make = partial(make_driver, wanted, space, settings.seed, **settings.options)
    try:
        with deadline.enforced():  # The exact driver prepares for its space, in a share of the time left.
            return make(), known
    except DeadlinePassed:
        return make(), known


def nothing_found(space: SearchSpace, seconds: float | None = None) -> InputError:
    """Return the InputError for a search without any layout; it says whether the space is proven empty."""
    where, problem, remedy = "search", "no labelling satisfies the constraints", "constraints that some labelling meets"
    if seconds is not None:
        problem = "no layout that satisfies the constraints was found"
    open_question = "" if seconds is None else f" within {seconds:.3g} s, nor a proof that there is none"
    if space.laying is not None and space.laying.refused:
        standing = space.search.assemble == "standing"
        wish = "stands at every stage without props" if standing else "can be laid"
        where = "search.assemble"
        within = "" if seconds is None else f" of {space.laying.refused} that were looked at"
        aside = space.assembly.dimension == 2 and not space.search.assemble_out_of_plane
        remedy = "assemble_out_of_plane, or no such limit" if aside else "no such limit"
        remedy = '"translation", with centring' if standing else remedy
        problem = f"no layout{within} {wish}"
        if seconds is None and space.laying.undecided:
            problem = f"no layout was found that {wish}"
            open_question = f", and for {space.laying.undecided} of them the search for an order stopped at its limit"
        farthest = space.laying.words_of_farthest(_SAYING) if standing else None
        if farthest is not None:
            open_question += f"; the one that gets farthest falls at {farthest}"
    return InputError(where, problem + open_question, remedy if seconds is None else f"{remedy}, or more seconds")


def affordable_settings(assembly: Assembly, settings: ExploreSettings, said: list[str]) -> ExploreSettings:
    """Return settings with as many jobs as memory allows, with messages; InputError for too little."""
    effort = require_memory(assembly)
    jobs = max(1, min(settings.jobs, int(memory_limit() / effort.memory))) if settings.jobs > 1 else 1
    if jobs < settings.jobs:
        said.append(f"jobs: {jobs} of {settings.jobs}, as each takes some {effort.memory / 1e9:.1f} GB of memory")
    if effort.long is not None:
        limit = "" if settings.seconds is None else "; the time limit may be passed by that"
        said.append(f"{effort.long}{limit}")
    return replace(settings, jobs=jobs)
