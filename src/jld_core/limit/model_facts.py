"""Facts of special models beside λ, by named fields: zero dilation and effective areas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ZeroDilation:
    """Evidence that a solution without dilation was found, and the range of such solutions.

    λ is not unique without dilation. The fields from `lowest_found` on are None unless the range was computed
    (`range=True`). Load factors are in scene units.

    Attributes
    ----------
    associative_load_factor : float or None
        λ with associative friction: the only upper bound on every solution. None where there is none.
    friction_violation : float or None
        max(|V| − μN)⁺ / max N over dry faces; None if no solution was found.
    complementarity_gap : float or None
        Complementarity gap divided by the dissipation; None if no solution was found.
    dilation : float or None
        Largest opening of faces in compression divided by the largest slip; None if no solution was found.
    converged : bool
        True if the search ended with a solution.
    iterations : int
        Number of programs solved in the search.
    lowest_found, highest_found : float or None
        Lowest and highest λ of certified solutions.
    solutions_found : int or None
        Number of certified solutions with different λ.
    lowest_proven : float or None
        Proven lower bound on λ of all solutions with λ ≥ 0; None without a bound above zero.
    lowest_bound : float or None
        Highest lower bound, which may depend on a solver.
    bound_tolerance : float or None
        Relative tolerance to which `lowest_bound` depends on a solver.
    proven : bool or None
        True if `lowest_bound` is proven.
    closed : bool or None
        True if `lowest_bound` meets `lowest_found` within 1e-6.
    """

    associative_load_factor: float | None
    friction_violation: float | None
    complementarity_gap: float | None
    dilation: float | None
    converged: bool
    iterations: int
    lowest_found: float | None = None
    highest_found: float | None = None
    solutions_found: int | None = None
    lowest_proven: float | None = None
    lowest_bound: float | None = None
    bound_tolerance: float | None = None
    proven: bool | None = None
    closed: bool | None = None

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> ZeroDilation | None:
        """Return the evidence in the facts of a result; None for associative friction.

        Parameters
        ----------
        facts : mapping of str to object
            Facts of the model, as in the JSON output and in `LimitAnalysisResult.facts`.
        """
        if "complementarity_gap" not in facts:
            return None
        named = {name: facts[name] for name in cls.__dataclass_fields__ if name in facts}
        return cls(**named, iterations=facts["zero_dilation_iterations"])


@dataclass(frozen=True)
class EffectiveAreas:
    """Agreement of the torsion limits of dry faces with their areas in compression.

    Attributes
    ----------
    change : float or None
        Largest change of effective areas from those assumed in the proof to those under the forces found. It is the
        change of c_T,e / c_T or of x / c_T, see docs/method.md (2.14); 0 at a proven fixed point. None without forces.
    load_factor_whole_faces : float or None
        λ with torsion on whole faces, scene units; None where there is none.
    """

    change: float | None
    load_factor_whole_faces: float | None

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> EffectiveAreas | None:
        """Return the convergence in the facts of a result; None without effective areas.

        Parameters
        ----------
        facts : mapping of str to object
            Facts of the model, as in the JSON output.
        """
        if "effective_area" not in facts:
            return None
        areas = facts["effective_area"]
        return cls(None if areas is None else areas["fixed_point"], facts.get("load_factor_whole_faces"))
