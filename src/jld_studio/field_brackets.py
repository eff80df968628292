"""Bounds by fields on λ of the layouts that the page shows, refined one mesh per request."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, InputError
from jld_core.fields import bounds as fields_bounds
from jld_core.fields import problem as fields_problem
from jld_core.limit import governing, number
from jld_core.models import by_fields

SECONDS: Final = 2.0
"""Time within which the bracket of a layout is refined, s of work; no mesh is begun that is expected to end later."""

STEP: Final = 0.6
"""Longest expected time of one mesh, s: a change of the page waits for the mesh that is being solved."""

LARGEST: Final = 3000
"""Triangles of the coarsest mesh above which nothing is bounded: both bounds would take longer than `SECONDS`."""

KEPT: Final = 8
"""Number of layouts whose refinement is kept, so that a layout that is shown again goes on where it stopped."""


class FieldBracket:
    """Bounds by fields on λ of one layout under all cases, step by step to `gap`; InputError if not by hand."""

    def __init__(self, assembly: Assembly, labels: Bits, gap: float) -> None:
        self._assembly = assembly
        fields_problem.require_planar_fields(assembly)
        self._cases = [fields_bounds.FieldRefinement(case, labels, gap=gap) for case in assembly.by_case]
        largest = max(case.simplices for case in self._cases)
        if largest > LARGEST:
            raise InputError("cracks", f"{largest} triangles are too many to follow by hand", "the command `jld solve`")
        self._bounds: list[fields_bounds.FieldBounds | None] = [None] * len(self._cases)

    def step(self) -> dict[str, Any]:
        """Solve one more mesh in time: bracket, cases, status, triangles, seconds, and `more`."""
        # The mesh belongs to a load case without bounds, or else to the one with the least lower bound over its
        # required factor.
        case = self._next()
        if case is not None:
            self._bounds[case] = self._cases[case].step()
        known = [bounds for bounds in self._bounds if bounds is not None]
        found = governing(
            [by_fields.case_bounds_of(bounds) for bounds in known], self._assembly.required.tolist()[: len(known)]
        )
        ready = len(known) == len(self._bounds)
        return {
            "bracket": [number(found.low) if ready else None, number(found.high)],
            "cases": [[None, None] if one is None else [number(one.lower), number(one.upper)] for one in self._bounds],
            "status": str(found.status),
            "triangles": sum(bounds.simplices for bounds in known),
            "seconds": self._spent,
            "more": self._next() is not None,
        }

    @property
    def _spent(self) -> float:
        """Return the processor time of all meshes, s."""
        return sum(bounds.seconds for bounds in self._bounds if bounds is not None)

    def _next(self) -> int | None:
        """Return the load case whose next mesh is solved; None if all ended or time is too short."""
        for case, bounds in enumerate(self._bounds):
            if bounds is None:
                return case
        lower = [math.inf if one is None else one.lower for one in self._bounds]
        for case in np.argsort(np.array(lower) / self._assembly.required, kind="stable").tolist():
            refinement = self._cases[case]
            wait = refinement.expected - refinement.spent
            if not refinement.ended and wait <= STEP and self._spent + wait <= SECONDS:
                return int(case)
        return None


class FieldBrackets:
    """Store of the `FieldBracket` of each of the last layouts shown; thread-safe.

    One mesh is solved at a time.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, bytes], tuple[Assembly, FieldBracket]] = OrderedDict()
        self._turn = threading.Lock()

    def step(self, assembly: Assembly, labels: Bits, gap: float) -> dict[str, Any]:
        """Solve one more mesh of a layout, as `FieldBracket.step`, or return `refused` with the reason."""
        key = (id(assembly), labels.tobytes())
        with self._turn:
            try:
                if key not in self._kept:
                    # the assembly is kept beside its bracket, so that its id stays its own
                    self._kept[key] = (assembly, FieldBracket(assembly, labels, gap))
                self._kept.move_to_end(key)
                while len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
                return self._kept[key][1].step()
            except InputError as error:
                return {"refused": str(error), "more": False}
