"""Model and solver options that results, evaluators and search settings share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np

from jld_core import tolerances
from jld_core.errors import ParameterError
from jld_core.mechanics import InnerBending
from jld_core.parameters import require_field_types
from jld_core.scene.cracks import CrackModel, FieldCracks, cracks_of, cracks_to_json
from jld_core.solvers import Solver, require_solver

Friction = Literal["associative", "zero-dilation"]
"""Friction model of dry faces: flow rule associated with the yield sets, or sliding without uplift."""
Contacts = Literal["convex", "concave"]
"""Contact model of dry faces: resultants at the centre of pressure, or point contacts at the corners."""
Condense = Literal["auto", "on", "off"]
"""When uncracked blocks are modelled as rigid bodies; "auto" does so where inner faces are very strong."""

FLOOR_SECONDS: Final = 60.0
"""Default processor time, in seconds, for the lower bound on λ over all non-dilatant solutions."""

FIELD_SECONDS: Final = 60.0
"""Default time for the bounds of one load case by fields, s. No mesh is begun that is not expected to end in it."""

# Allowed values of each option that takes one of several words
_WORDS: Final = {"friction": Friction, "contact": Contacts, "inner_bending": InnerBending, "condense": Condense}


@dataclass(frozen=True)
class Model:
    """How a structure is modelled and solved: crack model, friction, contact, bending, solver.

    Fields are named as on the command line. Options of spatial models have no effect in planar scenes.

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
        Relative width of the bracket to aim at. By fields that of `cracks` stands for the default.
    cracks : "faces", "cells:A", "fields", "fields:GAP", crack model or None
        Along which planes blocks crack: the faces drawn, faces of cells of size A (length), or anywhere, to the
        relative width GAP of the bracket. None: as the scene says.
    seconds : float or None
        Time after which nothing further is tried, for each load case, s. None: 60 by fields, else no limit.

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
    cracks: CrackModel | str | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        if self.cracks is not None:
            object.__setattr__(self, "cracks", cracks_of(self.cracks))
        for key, words in _WORDS.items():
            value, allowed = getattr(self, key), get_args(words)
            if value not in allowed:
                raise ParameterError(key, f"no {key.replace('_', ' ')} is named {value!r}", " or ".join(allowed))
        require_field_types(self)
        if self.range and self.friction != "zero-dilation":
            raise ParameterError(
                "range", "λ of associative friction is one number", '`friction="zero-dilation"` with it'
            )
        if self.effective_area and self.contact == "concave":
            raise ParameterError(
                "effective_area", "point contacts have no effective area", '`contact="convex"` with it'
            )
        if not (_is_number(self.floor_seconds) and self.floor_seconds >= 0.0):
            raise ParameterError(
                "floor_seconds", f"{_shown(self.floor_seconds)} is no number of seconds", "seconds, 0 for no bound"
            )
        if not (_is_number(self.gap) and 0.0 < self.gap < math.inf):
            raise ParameterError("gap", f"{_shown(self.gap)} is no relative width", "a number above 0")
        if self.seconds is not None and not (_is_number(self.seconds) and self.seconds >= 0.0):
            raise ParameterError("seconds", f"{_shown(self.seconds)} is no time", "seconds, at least 0")
        if isinstance(self.solver, str):
            require_solver(self.solver)

    @property
    def supports_bounds_over_labellings(self) -> bool:
        """Return True if λ of rigid elements is that of associative friction on whole faces.

        Bounds over many labellings hold only under these options.
        """
        return not self.beyond_whole_faces

    @property
    def beyond_whole_faces(self) -> dict[str, Any]:
        """Return the options that differ from associative friction on whole faces, by name."""
        plain = ("friction", "range", "floor_seconds", "contact", "effective_area", "inner_bending")
        return {name: getattr(self, name) for name in plain if getattr(self, name) != getattr(Model, name)}

    @property
    def by_fields(self) -> FieldCracks | None:
        """Return the crack model with the gap asked for where blocks crack by fields, else None."""
        if not isinstance(self.cracks, FieldCracks):
            return None
        return self.cracks if self.gap == tolerances.GAP else FieldCracks(kind="fields", gap=self.gap)

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
            One entry for each field that is not None.
        """
        solver = self.solver if isinstance(self.solver, str) else self.solver.name
        found = {name: value for name, value in vars(self).items() if value is not None}
        return found | {"solver": solver} | ({"cracks": cracks_to_json(cracks_of(self.cracks))} if self.cracks else {})


SolveOptions = Model
"""Name of `Model` before version 0.4."""


def _is_number(value: object) -> bool:
    """Return True for a real number, and False for truth values and other objects."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _shown(value: object) -> str:
    """Return a number in short, and any other object as Python writes it."""
    return f"{value:g}" if _is_number(value) else repr(value)
