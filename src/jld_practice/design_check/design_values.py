"""Design values of materials and members: characteristic values by partial factors."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import Any, Final

from jld_core import InputError, Scene, parse_scene
from jld_core.scene import design, standard, uncertain

_CAPACITIES: Final = ("tension", "compression", "shear")  # keys of members that their factor divides


LOW_FRACTILE: Final = 0.05
"""Probability of values below the characteristic one of a strength, EN 1990, 4.2(3)."""

HIGH_FRACTILE: Final = 0.98
"""Probability of values below the characteristic one of a live load, EN 1990, 4.1.2(7) with note 2."""

SMALL_VARIATION: Final = 0.1
"""Largest coefficient of variation at which permanent actions count by their means, EN 1990, 4.1.2(3) with note."""


def at_design_values(scene: Scene, factors: design.PartialFactors, prestress: float) -> Scene:
    """Return the scene with design values of strengths, friction, capacities and prestress.

    A tendon without a stated capacity keeps its prestress alone.
    """
    # Loads and weights become characteristic values.
    if scene.fill is not None:
        raise InputError("fill", "the design check has no partial factors of soil", "loads in the place of it")
    document = scene.model_dump(mode="json", exclude_defaults=True)
    materials = document.get("materials", {})
    parts = [materials, *materials.get("faces", [])]
    values = [part[key] for part in parts for key in ("dry", "inner") if part.get(key)]
    own = [
        value.get("criterion", standard.SURFACE)
        for value in values
        if "criterion" in value or standard.SURFACE in value
    ]
    if own:
        problem = f'the design check has no partial factors of the criterion "{own[0]}"'
        raise InputError("materials", problem, "standard strengths in place of it")
    for entry in [*values, *document.get("interfaces", [])]:
        for key in standard.STRESS_KEYS:
            _apply(entry, key, lambda value: value / factors.strength)
        for name in ("friction", "inner_friction"):
            _apply(entry, f"{name}_coefficient", lambda value: value / factors.friction)
            _apply(entry, f"{name}_angle", lambda value: _angle(value, factors.friction))
    for member in document.get("members", []):
        for key in _CAPACITIES:
            _apply(member, key, lambda value: value / factors.members)
        _apply(member, "prestress", lambda value: value * prestress)
    _put_loads(document, scene)
    return parse_scene(document, f"the scene at design values of {factors.name}")


def _apply(entry: dict[str, Any], key: str, change: Callable[[float], float]) -> None:
    value = entry.get(key)
    if value is not None:
        entry[key] = change(characteristic(value) if isinstance(value, dict) else value)


def _put_loads(document: dict[str, Any], scene: Scene) -> None:
    """Replace loads and weights with uncertainty by their characteristic values; a permanent action may vary little."""
    for path, value in list(uncertain.uncertain_values(scene)):
        if path[0] not in ("loads", "elements") and path[-1] != "density":
            continue
        size = value.size if isinstance(value, uncertain.UncertainVector) else value
        live = "live" in path or "moving" in path or "pushes" in path
        if not live and size.cov > SMALL_VARIATION:
            problem = f"its coefficient of variation is {size.cov:g}, and EN 1990, 4.1.2(2) asks for two values"
            raise InputError(uncertain.in_words(path), problem, f"at most {SMALL_VARIATION:g}, or a number alone")
        share = fractile(size, HIGH_FRACTILE) / float(size) if live else 1.0
        owner: Any = document
        for key in path[:-1]:
            owner = owner[key]
        owner[path[-1]] = (
            [share * one for one in value] if isinstance(value, uncertain.UncertainVector) else share * float(value)
        )


def characteristic(value: dict[str, Any]) -> float:
    """Return the characteristic value of a strength, EN 1990, 4.2(3)."""
    if not uncertain.is_uncertain(value):
        return float(value["low"])
    return max(
        0.0, fractile(uncertain.Uncertain(float(value["mean"]), float(value["cov"]), value["kind"]), LOW_FRACTILE)
    )


def fractile(value: uncertain.Uncertain, probability: float) -> float:
    """Return the value whose size is not exceeded with a probability; its sign is that of the mean."""
    score = NormalDist().inv_cdf(probability)
    if value.kind == "normal":
        return float(value) * (1.0 + score * value.cov)
    spread = math.sqrt(math.log1p(value.cov**2))
    return float(value) * math.exp(score * spread - 0.5 * spread**2)


def _angle(degrees: float, factor: float) -> float:
    """Return the angle, degrees, whose tangent is that of an angle over a factor."""
    return math.degrees(math.atan(math.tan(math.radians(degrees)) / factor))
