"""Options of a design, and the keys that they set in the scene of an outline."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, fields
from typing import Any, Final, Literal

from jld_core.errors import InputError, ParameterError
from jld_core.exchange import ImportOptions
from jld_core.exchange.forces import parse_force
from jld_practice.design.loaded_edges import EXTRADOS, SIDES, points_of
from jld_practice.laying.order import LAID

LEAST_SECONDS: Final = 10.0
"""Shortest time limit, s: program start, reading, one solve and the page take some seconds."""

LOW_FRICTION: Final = 0.8
"""Share of the friction that the winner is checked at, where no low value is given."""

READING: Final = (
    *("thickness", "tolerance", "unit", "up"),
    *("layer", "skip", "hole", "support", "load_layer", "dry", "inner"),
)
"""Options of reading a file that is no scene."""

_PLACES: Final = 50  # largest number of places of a load; each is a load case


@dataclass(frozen=True)
class DesignOptions:
    """Limits, loads, materials and resources that a user states for a design.

    None keeps the value of the outline's file.
    """

    block_mass: float | None = None  # largest mass of a block, kg with m and N
    shapes: int | None = None  # largest number of different blocks, that is, of moulds
    load: str | None = None  # force that acts downwards, as "10 kN"; each place is a load case
    # part of the outline on which the load acts: "top", "bottom", "left", "right", "extrados" (the largest arc that is
    # round upwards), or two points of an edge as "X,Y,X,Y"
    along: str = "top"
    places: str = "1"  # number of places of the load at equal distances, or their shares of the length, as "0.25,0.5"
    # length over which the load is spread; None for a tenth of the length that it acts along
    width: float | None = None
    push: float | None = None  # horizontal load to either side, as a share of the weight; each side is a load case
    # friction, friction_low: friction coefficient of joints, and the low value at which the winner is checked
    friction: float | None = None
    friction_low: float | None = None
    # density, tension, shear: density, tensile and shear strength of the stone, in the units of the scene (kg/m³, Pa)
    density: float | None = None
    tension: float | None = None
    shear: float | None = None
    thickness: float | None = None  # out-of-plane thickness of a drawing
    # how a file that is no scene is read, as in `ImportOptions`
    tolerance: float | None = None
    unit: str | None = None
    up: Literal["y", "z"] | None = None
    layer: tuple[str, ...] = ()
    skip: tuple[str, ...] = ()
    hole: tuple[str, ...] = ()
    support: tuple[str, ...] = ()
    load_layer: tuple[str, ...] = ()
    dry: tuple[str, ...] = ()
    inner: tuple[str, ...] = ()
    # name of one of `LAID`: keep to layouts that can be laid, from a side or from the springings, or whose every stage
    # stands
    laid: str | None = None
    seconds: float = 300.0  # time limit of the whole design, s
    jobs: int = os.cpu_count() or 1  # number of worker processes
    seed: int = 0  # seed of searches and of random cells

    def __post_init__(self) -> None:
        for name in ("block_mass", "push", "friction", "friction_low", "density", "tension", "shear", "width"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ParameterError(name, f"{value:g} is wrong", "a number above 0")
        if self.shapes is not None and self.shapes < 1:
            raise ParameterError("shapes", f"{self.shapes} is no number of shapes", "a whole number from 1")
        if not self.seconds >= LEAST_SECONDS:
            problem = f"{self.seconds:g} s are too short to cut and solve anything"
            raise ParameterError("seconds", problem, f"at least {LEAST_SECONDS:g}; a wall takes some minutes")
        if self.jobs < 1:
            raise ParameterError("jobs", f"{self.jobs} is no number of processes", "a whole number from 1")
        if self.along not in (*SIDES, EXTRADOS) and points_of(self.along) is None:
            wish = f"{', '.join(SIDES)}, {EXTRADOS}, or two points X,Y,X,Y of an edge"
            raise ParameterError("along", f"{self.along!r} is no part of an outline", wish)
        if self.along != "top" and self.load is None:
            raise ParameterError("along", "no force acts there", "`load` with a force as well")
        if self.laid is not None and self.laid not in LAID:
            raise ParameterError("laid", f"{self.laid!r} is no order", "one of " + ", ".join(LAID))
        self._check_friction()
        self.shares()
        self.force("N")
        _ = self.reading

    def _check_friction(self) -> None:
        """Raise ParameterError if the low friction exceeds the nominal one, or stands without it."""
        if self.friction_low is not None and self.friction is None:
            raise ParameterError("friction_low", "it is given without `friction`", "both values")
        if self.friction_low is not None and self.friction is not None and self.friction_low > self.friction:
            problem = f"{self.friction_low:g} is above the friction, {self.friction:g}"
            raise ParameterError("friction_low", problem, "a value at most that of `friction`")

    def shares(self) -> list[float]:
        """Return where the load acts, as ascending shares (0 to 1) of the loaded length.

        Raises ParameterError for an invalid text, too many places, or a share outside (0, 1).
        """
        # A number of places gives the middles of as many equal parts.
        text = self.places.strip()
        try:
            if text.isdigit():
                count = int(text)
                found = [(k + 0.5) / count for k in range(count)]
            else:
                found = sorted(float(part) for part in text.split(","))
        except ValueError:
            found = []
        if not 1 <= len(found) <= _PLACES or not all(0.0 < share < 1.0 for share in found):
            wish = f"a number of places up to {_PLACES}, or shares of the length between 0 and 1, as 0.25,0.5"
            raise ParameterError("places", f"{self.places!r} is wrong", wish)
        return found

    def force(self, unit: str) -> float | None:
        """Return the magnitude of the downward load in a unit of force; None if no load is stated.

        Raises ParameterError for a text that is not one positive force.
        """
        if self.load is None:
            return None
        try:
            written = parse_force(self.load, unit)
        except InputError as error:
            raise ParameterError("load", error.problem, error.expected) from None
        if written.components or not written.values[0] > 0.0:
            raise ParameterError("load", f"{self.load!r} is no force downwards", 'one number above 0, as "10 kN"')
        return written.values[0]

    @property
    def reading(self) -> ImportOptions:
        """Return the options of reading a file that is no scene."""
        shared = {name: getattr(self, name) for name in READING if name != "load_layer"}
        return ImportOptions(load=self.load_layer, seconds=self.seconds, **shared)

    def given(self) -> dict[str, Any]:
        """Return the values by name of those options that differ from their defaults."""
        return {
            one.name: getattr(self, one.name)
            for one in fields(self)
            if getattr(self, one.name) != one.default and getattr(self, one.name) not in ((), None)
        }
