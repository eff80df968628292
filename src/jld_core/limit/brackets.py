"""Compare brackets of λ: widths, contradictions, and the load below which differences are negligible."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core import tolerances
from jld_core.assembly import Assembly
from jld_core.mechanics.scaling import reference_load


def relative_width(low: float, high: float, load_scale: float) -> float:
    """Compute the relative width of a bracket, docs/method.md (3.13).

    The width is divided by max(|low|, |high|, load_scale).

    Parameters
    ----------
    low, high : float
        Bounds on λ, in any one unit; NaN or infinite where missing.
    load_scale : float
        λ below which differences are negligible, in the same unit (see `load_scale`).

    Returns
    -------
    float
        Relative width; inf where a bound is missing.
    """
    if not (np.isfinite(low) and np.isfinite(high)):
        return np.inf
    size = max(abs(low), abs(high), load_scale)
    return (high - low) / size if size > 0.0 else float(high > low)


def exceeds(low: float, bound: float, load_scale: float) -> bool:
    """Return whether a proven lower bound on λ contradicts an upper bound.

    The difference must exceed the proof tolerance.

    Parameters
    ----------
    low : float
        Proven lower bound on λ.
    bound : float
        Upper bound on λ, may be infinite.
    load_scale : float
        λ below which differences are negligible, in the unit of the bounds.

    Returns
    -------
    bool
        True if low − bound exceeds `tolerances.PROVEN` times the largest of |low|, |bound| and `load_scale`.
    """
    return low - bound > tolerances.PROVEN * max(abs(low), abs(bound) if np.isfinite(bound) else 0.0, load_scale)


def crossed(low: Any, high: Any, least: float = 1.0) -> Any:
    """Return whether lower bounds exceed upper bounds by more than rounding.

    In that case neither bound is reliable.

    low, high: bounds, NaN where there is none. least: size below which rounding is not relative; 1 for scaled bounds.
    Result: True where the bounds contradict each other; False where one is NaN.
    """
    return low - high > 10.0 * tolerances.ROUNDING * np.maximum(np.maximum(abs(low), abs(high)), least)


def apart(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Return True if two brackets of the same λ are disjoint.

    one, other: (float, float) lower and upper bound in any one unit; NaN or infinite where unknown. Result: True if the
    lower bound of either exceeds the upper bound of the other by more than rounding.
    """
    return bool(crossed(one[0], other[1], 0.0) or crossed(other[0], one[1], 0.0))


def load_scale(assembly: Assembly) -> float:
    """Compute the load factor below which differences are negligible.

    It is 1e-3 · total weight / total live load. Without weight, `reference_load` takes its place.

    Parameters
    ----------
    assembly : Assembly
        Structure; of several load cases the least value over the required factor counts.

    Returns
    -------
    float
        Load factor in scene units.
    """
    each = zip(assembly.by_case, assembly.required.tolist(), strict=True)
    return float(min(tolerances.GAP_FLOOR * reference_load(one) / one.total_live / required for one, required in each))
