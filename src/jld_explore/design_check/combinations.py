"""Combinations of partial factors of permanent actions, and structures under design loads."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly, LoadCase, Points
from jld_core.scene.design import PartialFactors

Effect = Literal["unfavourable", "favourable", "parts"]
"""Which of both factors of a permanent action counts; "parts" where each of its parts has its own."""

_BOTH: Final[tuple[Effect, Effect]] = ("unfavourable", "favourable")

_ROUNDING: Final = 1e-12
"""Stated dead load over all dead load on an element up to which it is rounding of the self-weight."""


@dataclass(frozen=True)
class Combination:
    """Choice between the factors of each permanent action.

    Attributes
    ----------
    self_weight, dead, prestressing : {"unfavourable", "favourable"}
        Factors that are taken for self-weight, stated dead loads and prestress.
    heavier : tuple of str
        Parts of permanent loads with the unfavourable factor, where parts are individual actions; others have the
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
    stated = any(bool(np.any(_stated(assembly, case.dead))) for case in cases)
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
    weight, stress = _weights(assembly), assembly.members.self_stress
    own = np.zeros_like(assembly.dead) if stress is None else stress

    def dead_of(dead: Floats) -> Floats:
        """Return a dead load (n, q) with factors; prestress and bond keep theirs."""
        return chosen["self_weight"] * weight + chosen["dead"] * _stated(assembly, dead) + own

    def points_of(points: Points) -> Points:
        """Return point forces multiplied by the factor of live loads."""
        return tuple((at, tuple(factors.live * part for part in force)) for at, force in points)

    cases = tuple(
        replace(
            case,
            dead=dead_of(case.dead),
            live=factors.live * case.live,
            live_points=points_of(case.live_points),
            shape_loads=None,
        )
        for case in assembly.cases
    )
    return replace(
        assembly,
        elements=replace(assembly.elements, weight=chosen["self_weight"] * assembly.elements.weight),
        dead=dead_of(assembly.dead),
        live=factors.live * assembly.live,
        live_points=points_of(assembly.live_points),
        shape_loads=None,
        cases=cases,
    )


def _loads(assembly: Assembly) -> tuple[LoadCase, ...]:
    """Return the load cases; the single load of a structure without cases is one."""
    return assembly.cases or (LoadCase("", assembly.dead, assembly.live),)


def _weights(assembly: Assembly) -> Floats:
    """Return the self-weights (n, q) as generalised forces, zero on supports."""
    found = np.zeros_like(assembly.dead)
    free = assembly.elements.free
    found[free, : assembly.dimension] = assembly.elements.weight[free]
    return found


def _stated(assembly: Assembly, dead: Floats) -> Floats:
    """Return a dead load (n, q) without self-weight, prestress, bond and rounding errors."""
    weight, stress = _weights(assembly), assembly.members.self_stress
    own = weight if stress is None else weight + stress
    rest = dead - own
    size = np.abs(dead) + np.abs(own)
    size = np.maximum(size, size.max(axis=1, keepdims=True))
    rest[np.abs(rest) <= _ROUNDING * size] = 0.0
    return np.asarray(rest)
