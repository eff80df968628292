"""What is modelled, and by which way: what a result, an evaluator and the settings of a search carry along."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from jld_core import tolerances
from jld_core.errors import InputError
from jld_core.mechanics import InnerBending
from jld_core.solvers import Solver, require_solver

Friction = Literal["associative", "zero-dilation"]
Contacts = Literal["convex", "concave"]
Condense = Literal["auto", "on", "off"]

FLOOR_SECONDS: Final = 60.0
"""Processor time for the bound below every λ without dilation, by default."""

_WORDS: Final = {"friction": Friction, "contact": Contacts, "inner_bending": InnerBending, "condense": Condense}


@dataclass(frozen=True)
class SolveOptions:
    """What is modelled, as on the command line; spatial choices change nothing in planar scenes.

    friction: "associative", or "zero-dilation" (sliding without uplift, λ not unique: chapter 4 of docs/method.md).
    range: of zero dilation the lowest and the highest λ that are found, and a bound below; floor_seconds: of processor
    time for that bound, 0 for none.
    contact: "convex" (resultants at the centre of pressure) or "concave" (point contacts at the corners of dry
    faces). effective_area: torsion about the area that is really pressed, by iteration. inner_bending: "paper"
    (uncoupled) or "kern" (elastic edge stress). condense: rigid blocks, cracked on demand ("auto": where inner
    faces are very strong). solver: of the first attempt, by name or handed in; repairs and auxiliary programs have
    their own. gap: width of the bracket above which a result is uncertified.

    Raises InputError for a choice that has no such value, or two that do not go together.
    """

    friction: Friction = "associative"
    range: bool = False
    floor_seconds: float = FLOOR_SECONDS
    contact: Contacts = "convex"
    effective_area: bool = False
    inner_bending: InnerBending = "paper"
    condense: Condense = "auto"
    solver: str | Solver = "auto"
    gap: float = tolerances.GAP

    def __post_init__(self) -> None:
        for key, words in _WORDS.items():
            value, allowed = getattr(self, key), get_args(words)
            if value not in allowed:
                option = key.replace("_", "-")
                raise InputError(f"--{option}", f"no {key.replace('_', ' ')} is named {value!r}", " or ".join(allowed))
        if self.range and self.friction != "zero-dilation":
            raise InputError("--range", "λ of associative friction is one number", "--friction zero-dilation with it")
        if self.effective_area and self.contact == "concave":
            raise InputError("--effective-area", "points have no area", "--contact convex with it")
        if not self.floor_seconds >= 0.0:
            raise InputError("--floor-seconds", f"{self.floor_seconds:g} is no time", "seconds, 0 for no bound")
        if not 0.0 < self.gap < math.inf:
            raise InputError("--gap", f"{self.gap:g} is no width", "a number above 0")
        if isinstance(self.solver, str):
            require_solver(self.solver)

    @property
    def modular(self) -> bool:
        """Is λ that of associative friction on whole faces as they are, of which bounds on many labellings speak?"""
        same = SolveOptions(condense=self.condense, solver=self.solver, gap=self.gap)
        return self == same

    @property
    def by_floor(self) -> bool:
        """Whether a search goes by the bound below every λ without dilation: where it is given time for one."""
        return self.range and self.floor_seconds > 0.0

    def facts(self) -> dict[str, Any]:
        """The fields as plain values, a solver that was handed in by its name."""
        solver = self.solver if isinstance(self.solver, str) else self.solver.name
        return {**{key: value for key, value in self.__dict__.items() if key != "solver"}, "solver": solver}
