"""Design values of the materials and members of a scene: characteristic values by partial factors."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from jld_core.scene.design import PartialFactors
from jld_core.scene.reading import parse_scene
from jld_core.scene.schema import Scene

_STRENGTHS: Final = ("tensile_strength", "shear_strength", "compressive_strength", "cohesion")
"""Keys that the factor of strengths divides."""

_CAPACITIES: Final = ("tension", "compression", "shear")
"""Keys of members that their factor divides."""


def at_design_values(scene: Scene, factors: PartialFactors, prestress: float) -> Scene:
    """Return the scene with design values of strengths, friction, capacities and prestress.

    Loads and weights keep their characteristic values.

    Parameters
    ----------
    scene : Scene
        Scene with characteristic values; of nominal and low values, both are converted.
    factors : PartialFactors
        Partial factors.
    prestress : float
        Factor of the prestress of members.

    Returns
    -------
    Scene
        Scene at design values. A tendon that states no capacity keeps none but its prestress.

    Raises
    ------
    InputError
        The design values contradict one another, such as a prestress beyond the design tension.
    """
    document = scene.model_dump(mode="json", exclude_defaults=True)
    materials = document.get("materials", {})
    parts = [materials, *materials.get("faces", [])]
    values = [part[key] for part in parts for key in ("dry", "inner") if part.get(key)]
    for entry in [*values, *document.get("interfaces", [])]:
        for key in _STRENGTHS:
            _apply(entry, key, lambda value: value / factors.strength)
        for name in ("friction", "inner_friction"):
            _apply(entry, f"{name}_coefficient", lambda value: value / factors.friction)
            _apply(entry, f"{name}_angle", lambda value: _angle(value, factors.friction))
    for member in document.get("members", []):
        for key in _CAPACITIES:
            _apply(member, key, lambda value: value / factors.members)
        _apply(member, "prestress", lambda value: value * prestress)
    return parse_scene(document, f"the scene at design values of {factors.name}")


def _apply(entry: dict[str, Any], key: str, change: Callable[[float], float]) -> None:
    """Change a value in place, or both the nominal and the low one; do nothing where it is absent."""
    value = entry.get(key)
    if isinstance(value, dict):
        entry[key] = {name: change(number) for name, number in value.items()}
    elif value is not None:
        entry[key] = change(value)


def _angle(degrees: float, factor: float) -> float:
    """Return the angle, degrees, whose tangent is that of an angle over a factor."""
    return math.degrees(math.atan(math.tan(math.radians(degrees)) / factor))
