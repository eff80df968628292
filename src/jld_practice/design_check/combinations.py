"""Combinations of partial factors of permanent actions, and structures under design loads."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly, LoadCase
from jld_core.loads import Loads
from jld_core.scene.design import PartialFactors
from jld_core.strengths import Route

ROUTE: Final = Route("the design check")
"""Reader of strengths: partial factors are known for the standard ones alone."""

Effect = Literal["unfavourable", "favourable", "parts"]
"""Which of both factors of a permanent action counts; "parts" where each of its parts has its own."""

_BOTH: Final[tuple[Effect, Effect]] = ("unfavourable", "favourable")

# Stated dead load over all dead load on an element up to which it is rounding of the self-weight
_ROUNDING: Final = 1e-12


@dataclass(frozen=True)
class Combination:
    """Choice between the factors of each permanent action.

    self_weight, dead, prestressing: factors that are taken for self-weight, stated dead loads and prestress. heavier:
    parts of permanent loads with the unfavourable factor, where parts are individual actions; others have the
    favourable one.
    """

    self_weight: Effect
    dead: Effect
    prestressing: Effect
    heavier: tuple[str, ...] = ()

    def factors(self, partial: PartialFactors) -> dict[str, float]:
        """Return the factor of each permanent action by its name."""
        names = ("self_weight", "dead", "prestressing")
        return {name: getattr(partial, name)[getattr(self, name) == "unfavourable"] for name in names}


def combinations_of(assembly: Assembly, factors: PartialFactors) -> list[Combination]:
    """Return the combinations that differ for a structure, all actions unfavourable first.

    An action that is absent, or whose two factors are equal, is not varied. λ is a concave function of dead loads, so
    that no factor between both ends gives a smaller λ. Stated dead loads of all load cases are one action.
    """
    cases = _loads(assembly)
    weights = bool(np.any(assembly.elements.weight[assembly.elements.free]))
    stated = any(_stated(assembly, case.dead_loads) for case in cases)
    present = {
        "self_weight": weights,
        "dead": stated,
        "prestressing": bool(np.any(assembly.members.prestress)),
    }
    if factors.by_parts:
        effects = _BOTH if present["prestressing"] and len(set(factors.prestressing)) > 1 else _BOTH[:1]
        return [Combination("parts", "parts", effect) for effect in effects]
    varied = {name: there and len(set(getattr(factors, name))) > 1 for name, there in present.items()}
    choices = [_BOTH if varied[name] else _BOTH[:1] for name in present]
    return [
        Combination(self_weight, dead, prestressing) for self_weight, dead, prestressing in itertools.product(*choices)
    ]


def at_design_loads(assembly: Assembly, factors: PartialFactors, combination: Combination) -> Assembly:
    """Return a structure whose loads are multiplied by partial factors.

    assembly: structure with design values of materials and prestress. factors: partial factors of the chosen set.
    combination: choice of favourable or unfavourable factors of self-weight and dead loads. Body loads remain shares of
    the characteristic weight.
    """
    chosen = combination.factors(factors)

    def dead_of(dead: Loads) -> Loads:
        """Return a dead load with factors."""
        stated = chosen["dead"] * _stated(assembly, dead)
        return replace(stated, body=stated.body + chosen["self_weight"] * _weights(assembly))

    cases = tuple(
        replace(case, dead_loads=dead_of(case.dead_loads), live_loads=factors.live * case.live_loads)
        for case in assembly.cases
    )
    return replace(
        assembly,
        elements=replace(assembly.elements, weight=chosen["self_weight"] * assembly.elements.weight),
        dead_loads=dead_of(assembly.dead_loads),
        live_loads=factors.live * assembly.live_loads,
        cases=cases,
    )


def _loads(assembly: Assembly) -> tuple[LoadCase, ...]:
    """Return the load cases; the single load of a structure without cases is one."""
    return assembly.cases or (LoadCase("", assembly.dead_loads, assembly.live_loads),)


def _weights(assembly: Assembly) -> Floats:
    """Return the self-weights (n, d), zero on supports."""
    return np.where(assembly.elements.support[:, None], 0.0, assembly.elements.weight)


def _stated(assembly: Assembly, dead: Loads) -> Loads:
    """Return a dead load without self-weight and its rounding errors."""
    weight = _weights(assembly)
    rest = dead.body - weight
    rest[np.abs(rest) <= _ROUNDING * np.abs(weight)] = 0.0
    return replace(dead, body=rest)
