"""Keys of the design check, and named sets of partial factors with their sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from jld_core.errors import InputError, ParameterError
from jld_core.scene.part import Part, Positive

FactorPair = Annotated[list[Positive], Field(min_length=2, max_length=2)]
"""Partial factors of one kind of permanent action: favourable, unfavourable."""

DEFAULT_SET: Final = "EN 1996-1-1"  # set of partial factors where neither the scene nor the caller names one
EQUILIBRIUM: Final = "EN 1990 EQU"  # set of partial factors of static equilibrium


class DesignFactors(Part):
    """Partial factors that a scene states itself; absent ones are those of its set.

    Pairs are [favourable, unfavourable]; strength, friction and members are divisors.
    """

    self_weight: Annotated[FactorPair | None, Field(description="[favourable, unfavourable]")] = None
    dead: Annotated[FactorPair | None, Field(description="[favourable, unfavourable]")] = None
    prestressing: Annotated[FactorPair | None, Field(description="[favourable, unfavourable]")] = None
    live: Positive | None = None
    strength: Positive | None = None
    friction: Positive | None = None
    members: Positive | None = None


class Design(Part):
    """Partial factors of the design check, with classes of EN 1996-1-1.

    set: name of a set, or of an own one whose factors stand in `factors`.
    """

    set: Annotated[str, Field(min_length=1, description="the name of a set of partial factors")] = DEFAULT_SET
    units: Literal["I", "II"] = "II"
    mortar: Literal["designed", "prescribed"] = "prescribed"
    execution: Annotated[int, Field(ge=1, le=5, description="a whole number from 1 to 5")] = 5
    factors: DesignFactors = DesignFactors()

    @model_validator(mode="after")
    def _known_or_complete(self) -> Self:
        """Check that an own set states its actions, and that favourable factors are not larger."""
        factors = self.factors
        if self.set not in _NAMED and (factors.self_weight is None or factors.live is None):
            names = ", ".join(_NAMED)
            problem = f"no set is named {self.set!r}, and no own one is stated"
            raise InputError(".set", problem, f'one of {names}, or "factors" with "self_weight" and "live"')
        for name in ("self_weight", "dead", "prestressing"):
            pair = getattr(factors, name)
            if pair is not None and pair[0] > pair[1]:
                raise InputError(f".factors.{name}", f"{pair[0]:g} exceeds {pair[1]:g}", "[favourable, unfavourable]")
        return self


@dataclass(frozen=True)
class PartialFactors:
    """Partial factors of a design check.

    Pairs are (favourable, unfavourable); strength, friction and members are divisors. clauses: source of each factor by
    attribute.
    """

    name: str
    self_weight: tuple[float, float]
    dead: tuple[float, float]
    prestressing: tuple[float, float]
    live: float
    strength: float
    friction: float
    members: float
    clauses: Mapping[str, str]

    @property
    def by_parts(self) -> bool:
        """Return True if parts of permanent loads are individual actions, EN 1990, 6.4.3.1(4)."""
        return self.name == EQUILIBRIUM

    def to_json(self) -> dict[str, object]:
        document: dict[str, object] = {"set": self.name}
        for field in fields(self)[1:-1]:
            value = getattr(self, field.name)
            numbers = list(value) if isinstance(value, tuple) else value
            document[field.name] = {"factor": numbers, "source": self.clauses[field.name]}
        return document


STATED: Final = "stated in the scene"
UNREDUCED: Final = "not in this set"
_ACTIONS: Final = ("self_weight", "dead", "live")  # factors that EN 1990 states


def _of_actions(name: str, table: str, permanent: tuple[float, float], live: float) -> PartialFactors:
    """Return the set of one table of EN 1990, with material values unreduced."""
    clauses = dict.fromkeys(_ACTIONS, table)
    clauses["prestressing"] = "EN 1992-1-1, 2.4.2.2(1) and (2)"
    clauses |= dict.fromkeys(("strength", "friction", "members"), UNREDUCED)
    return PartialFactors(name, permanent, permanent, (1.0, 1.3), live, 1.0, 1.0, 1.0, clauses)


# Sets of partial factors by name; those of EN 1996-1-1 for materials are added by `partial_factors`
_NAMED: Final[dict[str, PartialFactors]] = {
    one.name: one
    for one in (
        # EN 1990:2002 + A1:2005, recommended values for persistent situations: STR by eq. (6.10), and EQU
        _of_actions("EN 1990", "EN 1990, Table A1.2(B), eq. (6.10)", (1.0, 1.35), 1.5),
        _of_actions(EQUILIBRIUM, "EN 1990, Table A1.2(A), eq. (6.10)", (0.9, 1.1), 1.5),
        _of_actions("EN 1996-1-1", "EN 1990, Table A1.2(B), eq. (6.10)", (1.0, 1.35), 1.5),
    )
}

# γM of masonry by category of units and mortar, for classes 1 to 5: EN 1996-1-1:2005, 2.4.3(1), note, rows A to C
_MASONRY: Final = {
    ("I", "designed"): (1.5, 1.7, 2.0, 2.2, 2.5),
    ("I", "prescribed"): (1.7, 2.0, 2.2, 2.5, 2.7),
    ("II", "designed"): (2.0, 2.2, 2.5, 2.7, 3.0),
    ("II", "prescribed"): (2.0, 2.2, 2.5, 2.7, 3.0),
}

_STEEL: Final = 1.15  # γM of reinforcing and prestressing steel: EN 1996-1-1:2005, 2.4.3(1), note, row E


def partial_factors(design: Design | None, name: str | None = None) -> PartialFactors:
    """Return the partial factors of a design check; raise ParameterError of `set` if no set has this name."""
    design = design or Design()
    set_name = design.set if name is None else name
    if set_name not in _NAMED and set_name != design.set:
        raise ParameterError("set", f"no set of partial factors is named {set_name!r}", "one of " + ", ".join(_NAMED))
    factors = _NAMED.get(set_name) or replace(_of_actions(set_name, STATED, (1.0, 1.0), 1.0), prestressing=(1.0, 1.0))
    if set_name not in _NAMED:
        factors = replace(factors, clauses={**factors.clauses, "prestressing": UNREDUCED})
    if set_name == "EN 1996-1-1":
        factors = _with_masonry(factors, design)
    stated = {key: value for key, value in design.factors.model_dump().items() if value is not None}
    if set_name not in _NAMED and "dead" not in stated:
        stated["dead"] = stated["self_weight"]
    numbers: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in stated.items()}
    return replace(factors, **numbers, clauses={**factors.clauses, **dict.fromkeys(stated, STATED)})


def _with_masonry(factors: PartialFactors, design: Design) -> PartialFactors:
    """Return a set with γM of masonry and of steel by EN 1996-1-1."""
    gamma = _MASONRY[design.units, design.mortar][design.execution - 1]
    table = "EN 1996-1-1, 2.4.3(1)"
    clauses = {**factors.clauses, "strength": table, "friction": f"{table} and 3.6.2(3), fv as a whole"}
    clauses["members"] = f"{table}, row E"
    return replace(factors, strength=gamma, friction=gamma, members=_STEEL, clauses=clauses)
