"""Design values of materials and members: characteristic values by partial factors."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import Any, Final

from jld_core.errors import InputError
from jld_core.scene.design import PartialFactors
from jld_core.scene.reading import parse_scene
from jld_core.scene.schema import Scene
from jld_core.scene.uncertain import is_uncertain

_STRENGTHS: Final = ("tensile_strength", "shear_strength", "compressive_strength", "cohesion")
"""Keys that the factor of strengths divides."""

_CAPACITIES: Final = ("tension", "compression", "shear")
"""Keys of members that their factor divides."""


_FRACTILE: Final = 0.05
"""Probability of values below the characteristic one of a strength, EN 1990, 4.2(3)."""


def at_design_values(scene: Scene, factors: PartialFactors, prestress: float) -> Scene:
    """Return the scene with design values of strengths, friction, capacities and prestress.

    Loads and weights keep their characteristic values.

    Parameters
    ----------
    scene : Scene
        Scene with characteristic values. Of nominal and low values, both are converted; of values with uncertainty, the
        5 % fractile. Loads and weights with uncertainty count by their means.
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
        The design values contradict one another, such as a prestress beyond the design tension; or the scene has fill.
    """
    if scene.fill is not None:
        raise InputError("fill", "the design check has no partial factors of soil", "loads in the place of it")
    document = scene.model_dump(mode="json", exclude_defaults=True)
    materials = document.get("materials", {})
    parts = [materials, *materials.get("faces", [])]
    values = [part[key] for part in parts for key in ("dry", "inner") if part.get(key)]
    own = [value["criterion"] for value in values if "criterion" in value]
    if own:
        problem = f'the design check has no partial factors of the criterion "{own[0]}"'
        raise InputError("materials", problem, "standard strengths in place of it")
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
    """Change a value in place, or both nominal and low one; do nothing if it is absent.

    A value with uncertainty becomes its characteristic value first, a prestress its mean.
    """
    value = entry.get(key)
    if isinstance(value, dict) and is_uncertain(value):
        value = float(value["mean"]) if key == "prestress" else characteristic(value)
    if isinstance(value, dict):
        entry[key] = {name: change(number) for name, number in value.items()}
    elif value is not None:
        entry[key] = change(value)


def characteristic(value: dict[str, Any]) -> float:
    """Return the 5 % fractile of a value with uncertainty, at least 0.

    value: object {"mean", "cov", "kind"}. Source: EN 1990, 4.2(3), with known coefficient of variation.
    """
    mean, cov, fractile = float(value["mean"]), float(value["cov"]), NormalDist().inv_cdf(_FRACTILE)
    if value["kind"] == "normal":
        return max(0.0, mean * (1.0 + fractile * cov))
    spread = math.sqrt(math.log1p(cov**2))
    return mean * math.exp(fractile * spread - 0.5 * spread**2)


def _angle(degrees: float, factor: float) -> float:
    """Return the angle, degrees, whose tangent is that of an angle over a factor."""
    return math.degrees(math.atan(math.tan(math.radians(degrees)) / factor))
