"""Model and solver options that results, evaluators and search settings share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from jld_core import tolerances
from jld_core.errors import ParameterError
from jld_core.mechanics import InnerBending
from jld_core.solvers import Solver, require_solver

Friction = Literal["associative", "zero-dilation"]
"""Friction model of dry faces: flow rule associated with the yield sets, or sliding without uplift."""
Contacts = Literal["convex", "concave"]
"""Contact model of dry faces: resultants at the centre of pressure, or point contacts at the corners."""
Condense = Literal["auto", "on", "off"]
"""When uncracked blocks are modelled as rigid bodies; "auto" does so where inner faces are very strong."""

FLOOR_SECONDS: Final = 60.0
"""Default processor time, in seconds, for the lower bound on λ over all non-dilatant solutions."""

_WORDS: Final = {"friction": Friction, "contact": Contacts, "inner_bending": InnerBending, "condense": Condense}
"""Allowed values of each option that takes one of several words."""


@dataclass(frozen=True)
class SolveOptions:
    """Options of the model and of the solver, named as on the command line.

    Options of spatial models have no effect in planar scenes.

    Parameters
    ----------
    friction : {"associative", "zero-dilation"}
        "zero-dilation": sliding without uplift, λ not unique (docs/method.md, chapter 4).
    range : bool
        Compute the lowest and the highest λ found with zero dilation, and a lower bound on all of them.
    floor_seconds : float
        Processor time for that lower bound, seconds; 0 omits the bound.
    contact : {"convex", "concave"}
        "convex": resultants at the centre of pressure. "concave": point contacts at the corners of dry faces.
    effective_area : bool
        Base torsion on the area in compression, by iteration (docs/method.md (2.14), (2.15)).
    inner_bending : {"uncoupled", "kern"}
        "uncoupled": uncoupled bending. "kern": elastic edge stress (docs/method.md (2.5), (2.6)).
    condense : {"auto", "on", "off"}
        Model blocks as rigid and crack them on demand; "auto": where inner faces are very strong.
    solver : str or Solver
        Solver of the first attempt, by name or as an object. Repairs and auxiliary programs use their own solvers.
    gap : float
        Relative width of the bracket above which a result is uncertified.

    Raises
    ------
    InputError
        If the value of an option is not allowed, or if two options exclude each other.
    """

    friction: Friction = "associative"
    range: bool = False
    floor_seconds: float = FLOOR_SECONDS
    contact: Contacts = "convex"
    effective_area: bool = False
    inner_bending: InnerBending = "uncoupled"
    condense: Condense = "auto"
    solver: str | Solver = "auto"
    gap: float = tolerances.GAP

    def __post_init__(self) -> None:
        for key, words in _WORDS.items():
            value, allowed = getattr(self, key), get_args(words)
            if value not in allowed:
                raise ParameterError(key, f"no {key.replace('_', ' ')} is named {value!r}", " or ".join(allowed))
        if self.range and self.friction != "zero-dilation":
            raise ParameterError(
                "range", "λ of associative friction is one number", '`friction="zero-dilation"` with it'
            )
        if self.effective_area and self.contact == "concave":
            raise ParameterError(
                "effective_area", "point contacts have no effective area", '`contact="convex"` with it'
            )
        if not self.floor_seconds >= 0.0:
            raise ParameterError(
                "floor_seconds", f"{self.floor_seconds:g} is no number of seconds", "seconds, 0 for no bound"
            )
        if not 0.0 < self.gap < math.inf:
            raise ParameterError("gap", f"{self.gap:g} is no relative width", "a number above 0")
        if isinstance(self.solver, str):
            require_solver(self.solver)

    @property
    def supports_bounds_over_labellings(self) -> bool:
        """Return True if λ is that of associative friction on whole faces.

        All other model options must have their default values. Bounds over many labellings hold only under these
        options.
        """
        same = SolveOptions(condense=self.condense, solver=self.solver, gap=self.gap)
        return self == same

    @property
    def ranks_by_lower_bound(self) -> bool:
        """Return True if a search ranks by the lower bound over all non-dilatant solutions.

        Requires `range` and a positive `floor_seconds`.
        """
        return self.range and self.floor_seconds > 0.0

    def facts(self) -> dict[str, Any]:
        """Return the fields as plain values, with a solver object replaced by its name.

        Returns
        -------
        dict of str to object
            One entry for each field.
        """
        solver = self.solver if isinstance(self.solver, str) else self.solver.name
        return {**{key: value for key, value in self.__dict__.items() if key != "solver"}, "solver": solver}
