"""Drivers by name: choose the default, and name the search that would prove or narrow a result."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Final

import numpy as np

from jld_core import plugins
from jld_core.arrays import Bits
from jld_core.deadline import Deadline, DeadlinePassed, checkpoint, time_left
from jld_core.errors import ParameterError
from jld_core.limit.case_relaxation import relaxation_of
from jld_core.limit.options import SolveOptions
from jld_core.parameters import near, typed
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.context import PossibleBlocks, possible_blocks
from jld_explore.drivers.exact.driver import Exact, MinimumCount
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.hillclimb import HillClimb
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import operators
from jld_explore.drivers.optuna import Optuna
from jld_explore.drivers.portfolio import Portfolio
from jld_explore.drivers.searcher import Random
from jld_explore.space import feasible
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import SearchSpace

DRIVERS: Final[dict[str, type[Driver]]] = {
    kind.name: kind for kind in (Enumeration, Random, HillClimb, Anneal, Genetic, Portfolio, Optuna, Exact)
}
"""Driver classes of jld by name."""


def driver_kinds() -> dict[str, type[Driver]]:
    """Return all driver classes by name, plug-ins last; InputError for one unusable, or of a taken name."""
    added = plugins.load_all("jld.drivers", tuple(DRIVERS))
    for name, kind in added.items():
        if not (isinstance(kind, type) and issubclass(kind, Driver) and getattr(kind, "name", None) == name):
            raise plugins.refuse_type("jld.drivers", name, f"a subclass of jld_explore.Driver with name = {name!r}")
    return DRIVERS | added


def drivers_with(option: str) -> Iterator[type[Driver]]:
    return (kind for kind in driver_kinds().values() if option in kind.Options.model_fields)


def driver_named(name: str) -> type[Driver]:
    kinds = driver_kinds()
    if name not in kinds:
        raise ParameterError("driver", f"no driver is named {name!r}", near(str(name), kinds))
    return kinds[name]


@typed
def make_driver(name: str, space: SearchSpace, seed: int, **options: Any) -> Driver:
    """Make a driver by its name.

    Parameters
    ----------
    name : str
        A name of `driver_kinds`; "exact" gives `MinimumCount` where `search.require` is set.
    space : SearchSpace
        The search space.
    seed : int
        Seed of the random choices.
    **options
        Options of the driver; None for the default.

    Returns
    -------
    Driver

    Raises
    ------
    InputError
        If no driver has the name, or an option is wrong or another driver's.
    """
    kind = driver_named(name)
    values = {key: value for key, value in options.items() if value is not None}
    for key in values:
        if key not in kind.Options.model_fields:
            others = " or ".join(f'`driver="{kind.name}"`' for kind in drivers_with(key)) or "an option that it has"
            raise ParameterError(key, f"the driver {name} has no such option", others)
    if kind is Exact and space.search.require is not None:
        # with a required load factor the exact driver optimises a count
        return MinimumCount.made(space, seed, values)
    with plugins.guarded("jld.drivers", name):
        return kind.made(space, seed, values)


REACH: Final = 50  # most faces, dry or inner, for which the exact driver is the default

# labellings of the genetic driver, per face of two labels, before a proof by default (docs/notes/tried.md)
STARTED: Final = 60
BOUNDED: Final = 1500  # most faces for which a bound on all labellings is computed: about the time of a few evaluations


def driver_for(
    space: SearchSpace, seed: int, model: SolveOptions, size: int | None, options: Mapping[str, Any], *, bounded: bool
) -> Driver:
    """Make the default driver; size: classes of a small space; bounded: mechanisms bound the objective."""
    # Small spaces are enumerated, those up to REACH faces go to the exact driver, which proves most of them, and larger
    # ones to the portfolio, or to the genetic driver where one mechanism says little about the objective
    # (docs/notes/tried.md).
    if size is not None:
        return make_driver("enumeration", space, seed, **options)
    set_options = {key for key, value in options.items() if value is not None}
    bounded &= space.void is None and model.supports_bounds_over_labellings
    faces = int(space.candidates.sum())
    if bounded and faces <= REACH and all(DRIVERS["exact"] in drivers_with(key) for key in set_options):
        exact = make_driver("exact", space, seed, **options)
        if isinstance(exact, Exact) and not exact.exhaustive:  # otherwise it would enumerate
            if exact.aim == "best":
                exact.begin_with(Genetic(space, seed), STARTED * faces)
            return exact
    by_portfolio = bounded and len(space.search.front.axes) == 1
    by_portfolio &= all(DRIVERS["portfolio"] in drivers_with(key) for key in set_options)
    return make_driver("portfolio" if by_portfolio else "genetic", space, seed, **options)


def bound_of_all(space: SearchSpace, model: SolveOptions) -> float | None:
    """Compute a λ, scene units, that no labelling exceeds by one relaxation; None where there is none."""
    # Associative friction is assumed. The bound also holds for λ without dilation, which associative λ bounds.
    assembly = space.assembly
    dilating = model.dilating
    if space.void is not None or not dilating.supports_bounds_over_labellings or len(assembly.interfaces) > BOUNDED:
        return None
    relaxation = relaxation_of(assembly)
    if relaxation is None:
        return None
    bound = relaxation.bound(space.fixed, space.candidates) * relaxation.unit
    return bound if math.isfinite(bound) else None


def what_would_prove(
    space: SearchSpace, model: SolveOptions, summary: Mapping[str, Any], *, whole: bool, finite: bool
) -> str | None:
    """Name in one line the search that would prove or narrow a result; None if none would."""
    if summary["proven"]:
        return None
    counts, reason = summary["counts_by_status"], summary["stop_reason"]
    uncertified = sum(counts.get(name, 0) for name in ("uncertified", "failed")) - summary["pruned"]
    if summary["unbounded"]:
        return "a locked layout carries any load: a compressive_strength of dry and inner faces gives each a finite λ"
    if model.friction == "zero-dilation":
        return "λ without dilation is not unique, so the best is not proven: the bound is that of associative friction"
    if model.effective_area:
        return "with effective areas nothing is proven of other layouts: the same search without --effective-area is"
    by_exact = summary["driver"] == "exact"
    if uncertified and reason == "exhausted" and (whole or by_exact):
        return f"{uncertified} layouts are uncertified: another --solver may settle them"
    if reason == "exhausted" and whole:
        return "brackets of the best layouts overlap: another --solver may narrow them"
    if finite and reason != "exhausted":
        classes = summary["classes"]
        progress = "" if classes is None else f", {summary['evaluated']} of {classes} classes so far"
        return f"--resume goes on to a proof{progress}"
    if space.void is not None:
        return "where cells may be left out, --driver enumeration proves, where it comes to its end"
    if not model.supports_bounds_over_labellings:
        return "the exact driver has no bounds for this model: --driver enumeration proves, where it comes to its end"
    if by_exact:
        return None  # the exact driver cannot prove more
    faces = int(space.candidates.sum())
    reach = "proves the best" if faces <= REACH else "narrows the bound, and may prove the best"
    return f"--driver exact {reach} ({faces} faces may be dry or inner; it is taken unasked up to {REACH})"


_BATCH: Final = 16  # labellings drawn per batch; the cost of a batch hardly depends on its size
_BATCHES: Final = 4  # batches of random labellings that are tried before a labelling is constructed
_BATCHES_SHARE: Final = 0.2  # largest share of the time left for these batches


def first_layout(space: SearchSpace, seed: int = 0) -> Bits:
    """Return the scene's labelling (1, m), else a random, else a constructed one; (0, m) if there is none."""
    # Few random labellings keep tight limits. One is then constructed from the formula of the limits, which also finds
    # out where no labelling keeps them.
    moves, rng = operators(space), BufferedRandom(np.random.default_rng(seed))
    nothing = np.empty((0, len(space.fixed)), dtype=bool)

    def in_space(rows: Bits) -> Bits:
        """Return the first of some labellings (k, m) that is in the space, if any."""
        for row in canonical(rows, space.group):  # one at a time, as each may take long
            checkpoint()
            if feasible(space, row[None])[0]:
                return np.asarray(row[None])
        return nothing

    with suppress(DeadlinePassed), Deadline(_BATCHES_SHARE * time_left()).enforced():
        rows = space.assembly.labels[None]
        for _ in range(_BATCHES + 1):
            if len(first := in_space(rows)):
                return first
            rows = moves.draw(_BATCH, rng)
    constructed = admissible_layout(space, seed)
    if constructed is not None or space.void is None:
        return nothing if constructed is None else constructed
    while not len(first := in_space(moves.draw(_BATCH, rng))):
        checkpoint()
    return first


def admissible_layout(space: SearchSpace, seed: int = 0) -> Bits | None:
    """Construct a labelling (1, m) with all cells; None if the space has none."""
    # Where cells may be left out only labellings with all cells are sought.
    low, high = space.search.block_cells
    least, most = max(1, int(low or 1)), len(space.assembly.elements.free) if high is None else int(high)
    for cells in [*range(least, most), None]:
        subspace = space.part_of_blocks(cells)
        blocks = possible_blocks(subspace)
        if blocks is None and cells is not None:
            continue
        labelling = _construct(subspace, blocks, space, seed)
        if labelling is not None or subspace is space:
            return labelling
    return None if space.void is not None else _construct(space, None, space, seed)


def _construct(subspace: SearchSpace, blocks: PossibleBlocks | None, space: SearchSpace, seed: int) -> Bits | None:
    """Return a labelling (1, m) of part of a space from its formula; None if it is empty."""
    # `blocks` are the possible blocks of the part, if they are listed.
    formula = Formula(subspace, blocks, partial=True)
    shapes = [bounds for count, bounds in subspace.limits.on_counts if count.kinds]
    if blocks is not None and shapes:
        formula.limit_kinds(subspace.limits.block_shapes.kinds(blocks.members).tolist(), shapes[0])
    preferred_labels = _preferred(space, seed)
    while (labels := formula.next(preferred=next(preferred_labels))) is not None:
        row = canonical(labels[None], space.group)
        if feasible(space, row)[0]:
            return row
        formula.forbid(np.arange(len(labels)), labels)
    return None


def _preferred(space: SearchSpace, seed: int) -> Iterator[Bits]:
    """Yield preferred labels (m,) without end: those of the scene, then random ones."""
    rng = np.random.default_rng(seed)
    yield space.assembly.labels
    while True:
        checkpoint()
        yield rng.random(len(space.fixed)) < rng.random()
