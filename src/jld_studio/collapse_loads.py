"""State the live loads at collapse, λ times each, in readable units: N, kN, kN/m."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from jld_core import Assembly
from jld_core.limit import LimitAnalysisResult
from jld_core.scene import FillLoad, Scene, loads, units

METRIC: Final = ("MN", "kN", "N")
"""Units of force among which a number chooses the largest in which it is at least 1."""


def collapse_loads(scene: Scene, assembly: Assembly, result: LimitAnalysisResult) -> list[list[str]]:
    """State λ times every live load: for each case one text per live entry, as "11.9 kN", "" without λ.

    None if moving.
    """
    results = result.cases or {"": result}
    return texts_of_loads(scene, assembly, {name: one.load_factor for name, one in results.items()})


def texts_of_loads(scene: Scene, assembly: Assembly, factors: Mapping[str, float | None]) -> list[list[str]]:
    """State a factor times every live load of each case, by its name, as `collapse_loads`."""
    several = scene.loads.has_cases
    entries = {case.name: case.live for case in scene.loads.cases or []} if several else {"": scene.loads.live or []}
    weight = float(np.linalg.norm(assembly.elements.weight[assembly.elements.free], axis=1).sum())
    return [
        [_text(entry, scene, weight, factor) for entry in entries.get(name if several else "", [])]
        for name, factor in factors.items()
    ]


def texts_of_bounds(scene: Scene, assembly: Assembly, brackets: Sequence[Sequence[float | None]]) -> list[list[str]]:
    """State bounds on λ times every live load of each load case, "8.2 kN to 10.6 kN"."""
    # Where one bound is missing or not above 0, the other one is named alone.
    names = [case.name for case in assembly.cases] or [""]
    low, high = (
        texts_of_loads(scene, assembly, {name: one[end] for name, one in zip(names, brackets, strict=True)})
        for end in (0, 1)
    )
    found = []
    for least, most, (bottom, top) in zip(low, high, brackets, strict=True):
        if top is not None and top <= 0.0:
            found.append([""] * len(most))
        elif bottom is None or bottom <= 0.0:
            found.append([text and f"at most {text}" for text in most])
        elif top is None:
            found.append([text and f"at least {text}" for text in least])
        else:
            found.append([one if one == two else f"{one} to {two}" for one, two in zip(least, most, strict=True)])
    return found


def _text(entry: loads.LoadEntry, scene: Scene, weight: float, factor: float | None) -> str:
    """State λ times one live load. weight: of all free elements together. factor: λ, or none."""
    if factor is None or not np.isfinite(factor):
        return ""
    force, length = scene.units.force, scene.units.length
    if isinstance(entry, loads.BodyLoad):
        return _size(factor * weight * float(np.linalg.norm(entry.body)), force)
    if isinstance(entry, FillLoad):
        return _size(factor * entry.weight, force)
    if isinstance(entry, loads.FaceLoad):
        ends = entry.ends[:1] if entry.ends[0] == entry.ends[1] else entry.ends
        stress = _range([factor * end for end in ends], force, f"/{length}²")
        if scene.dimension == 3:
            return stress
        return f"{_range([factor * scene.plane_thickness * end for end in ends], force, f'/{length}')} ({stress})"
    parts = []
    if entry.force is not None:
        parts.append(_size(factor * float(np.linalg.norm(entry.force)), force))
    if np.any(entry.moment):
        parts.append(_size(factor * float(np.linalg.norm(entry.moment)), force, f"·{length}"))
    return " and ".join(parts)


def _range(values: Sequence[float], unit: str, behind: str) -> str:
    """State one force, or two as a range. behind: text after the unit, such as "/m"."""
    return " to ".join(_size(value, unit, behind) for value in values)


def _size(value: float, unit: str, behind: str = "") -> str:
    """State a force with four digits, metric ones in a unit that fits their size."""
    if unit in METRIC:
        newtons = value * units.NEWTONS[unit]
        unit = next((name for name in METRIC if abs(newtons) >= units.NEWTONS[name]), unit)
        value = newtons / units.NEWTONS[unit]
    return f"{value:.4g} {unit}{behind}".replace("-", "−")
