"""Which driver is taken when none is named, and what would prove or narrow what another one found: one rule.

A space that is known to hold few classes is enumerated. One of at most `REACH` faces that may be dry or inner is given
to the exact driver, which proves such spaces within seconds, whatever the size of blocks and the strength of the
material; of somewhat larger ones it proves most, but not those of weak material or of beams (`benchmarks/reach.py`
measures it). Larger ones are searched by the genetic driver, which proves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from jld_core.limit import FLOOR_SECONDS, SolveOptions, relaxation_of
from jld_explore.drivers.base import Driver
from jld_explore.drivers.registry import DRIVERS, make_driver, owners
from jld_explore.space import SearchSpace

REACH: Final = 50
"""Faces that may be dry or inner up to which the exact driver is taken unasked."""

BOUNDED: Final = 1500
"""Faces of a structure up to which a bound on all labellings takes about as long as a few evaluations."""


def driver_for(
    space: SearchSpace, seed: int, model: SolveOptions, known: int | None, options: Mapping[str, Any], *, many: bool
) -> Driver:
    """A driver for a space where none is named.

    known: classes of the space where it is small, else None. options: of drivers, by name, None where not given; one
    that only another driver has decides. many: as many good layouts as can be are wanted, not the best alone.
    """
    if known is not None:
        return make_driver("enumeration", space, seed, **options)
    given = {key for key, value in options.items() if value is not None}
    own = all(DRIVERS["exact"] in owners(key) for key in given)
    if space.void is None and own and not many and model.modular and int(space.candidates.sum()) <= REACH:
        exact = make_driver("exact", space, seed, **options)
        if not exact.exhaustive:  # else it has no bounds for this scene and would enumerate
            return exact
    return make_driver("genetic", space, seed, **options)


def bound_of_all(space: SearchSpace, model: SolveOptions) -> float | None:
    """λ that no labelling of a space exceeds, scene units, by one relaxation of all faces; None where none is known.

    It bounds λ without dilation as well, which associative λ does.
    """
    assembly = space.assembly
    dilating = replace(model, friction="associative", range=False, floor_seconds=FLOOR_SECONDS)
    if space.void is not None or not dilating.modular or len(assembly.interfaces) > BOUNDED:
        return None
    relaxation = relaxation_of(assembly)
    if relaxation is None:
        return None
    bound = relaxation.bound(space.fixed, space.candidates) * relaxation.unit
    return bound if math.isfinite(bound) else None


def what_would_prove(
    space: SearchSpace, model: SolveOptions, summary: Mapping[str, Any], *, whole: bool, finite: bool
) -> str | None:
    """One line on what would prove or narrow what a search found; None where nothing is left to prove.

    summary: of the study so far. whole: the driver sees all classes, where it is not stopped. finite: its end is near
    enough to be waited for.
    """
    if summary["proven"]:
        return None
    tally, reason = summary["counts_by_status"], summary["stop_reason"]
    open_ones = sum(tally.get(name, 0) for name in ("uncertified", "failed")) - summary["pruned"]
    if summary["unbounded"]:
        return "a locked layout carries any load: a compressive_strength of dry and inner faces gives each a finite λ"
    if model.friction == "zero-dilation":
        return "λ without dilation is not unique, so the best is not proven: the bound is that of associative friction"
    if model.effective_area:
        return "with effective areas nothing is proven of other layouts: the same search without --effective-area is"
    by_exact = summary["driver"] == "exact"
    if open_ones and reason == "exhausted" and (whole or by_exact):
        return f"{open_ones} layouts are uncertified: a wider --gap or another --solver may settle them"
    if finite and reason != "exhausted":
        left = "" if summary["classes"] is None else f", {summary['evaluated']} of {summary['classes']} classes so far"
        return f"--resume goes on to a proof{left}"
    if space.void is not None:
        return "where cells may be left out, --driver enumeration proves, where it comes to its end"
    if not model.modular:
        return "the exact driver has no bounds for this model: --driver enumeration proves, where it comes to its end"
    if by_exact:
        return None  # it has done what it can
    faces = int(space.candidates.sum())
    reach = "proves the best" if faces <= REACH else "narrows the bound, and may prove the best"
    return f"--driver exact {reach} ({faces} faces may be dry or inner; it is taken unasked up to {REACH})"
