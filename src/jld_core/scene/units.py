"""Units of force and length, and numbers as text with a unit: `"10 kN"`, `"2 kN/m²"`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from jld_core import plugins
from jld_core.errors import InputError
from jld_core.scene.complaints import shown
from jld_core.scene.standard import STRESS_KEYS

GRAVITY: Final = 9.81
"""Acceleration that converts a mass in a text to a force, m/s²: the default of `materials.gravity`."""

# Newtons per unit of force; for a unit of mass, its weight. Pound-force by NIST SP 811, appendix B.8.
NEWTONS: Final = {
    "N": 1.0,
    "daN": 10.0,
    "kN": 1e3,
    "MN": 1e6,
    "kg": GRAVITY,
    "t": 1e3 * GRAVITY,
    "g": 1e-3 * GRAVITY,
    "lb": 0.45359237 * GRAVITY,
    "kgf": 9.80665,
    "lbf": 4.4482216152605,
    "kip": 4448.2216152605,
}

MASSES: Final = frozenset({"kg", "t", "g", "lb"})  # units of mass among those of force
METRES: Final = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "km": 1e3, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
"""Metres per unit of length."""

_PASCALS: Final = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5}  # pascals per unit of stress


def force_in_words(value: float, unit: str) -> str:
    """Write a force with its unit, in kN where four digits in the unit would need an exponent."""
    text = f"{value:.4g} {unit}"
    return f"{value * NEWTONS[unit] / NEWTONS['kN']:.4g} kN" if "e+" in text and unit in NEWTONS else text


_Powers = tuple[int, int]  # powers of force and length of a quantity
_FORCE: Final[_Powers] = (1, 0)
_LENGTH: Final[_Powers] = (0, 1)
_MOMENT: Final[_Powers] = (1, 1)
STRESS: Final[_Powers] = (1, -2)
_LINE: Final[_Powers] = (1, -1)
_DENSITY: Final[_Powers] = (1, -3)

# One correct text for each quantity, for error messages
_EXAMPLES: Final = {
    _FORCE: "10 kN",
    _LENGTH: "1.2 m",
    _MOMENT: "3 kN·m",
    STRESS: "2 kN/m²",
    _LINE: "2 kN/m",
    _DENSITY: '2000 kg/m³" or "20 kN/m³',
}

# Keys of a scene whose numbers may be texts, and powers of force and length of what they hold.
QUANTITIES: Final[dict[str, _Powers]] = {
    **dict.fromkeys(("force", "weight", "tension", "compression", "prestress", "shear"), _FORCE),
    **dict.fromkeys(
        ("at", "width", "path", "distance", "along", "patch", "thickness", "level", "cell", "tolerance"), _LENGTH
    ),
    "moment": _MOMENT,
    "line": _LINE,
    "density": _DENSITY,
    **dict.fromkeys(("pressure", "traction", "surcharge", "reference_strength", *STRESS_KEYS), STRESS),
}

_SPREAD: Final = ("nominal", "low", "mean")  # keys of an object that stands for one number

# What a criterion may call the unit of a parameter
_WORDS: Final = {"force": _FORCE, "length": _LENGTH, "moment": _MOMENT, "stress": STRESS, "density": _DENSITY}

# Pattern of a number and its unit
_TEXT: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.].*?)?\s*")

# Pattern of one factor of a unit, with the sign before it and its power
_FACTOR: Final = re.compile(r"([*·/]?)\s*([A-Za-z]+)(?:\^?(-?\d|²|³))?\s*")
USUAL_GRAVITY: Final = (1.0, 25.0)  # least and greatest usual acceleration of gravity, m/s²


@dataclass(frozen=True)
class UnitSystem:
    """Units of a scene in SI, newtons and metres; None for a unit of unknown name."""

    force: float | None
    length: float | None
    gravity: float

    @classmethod
    def named(cls, force: str, length: str, gravity: float = GRAVITY) -> UnitSystem:
        return cls(NEWTONS.get(force), METRES.get(length), gravity)

    @property
    def known(self) -> bool:
        return self.force is not None and self.length is not None

    def si(self, powers: tuple[int, int]) -> float:
        """Return the size in SI of a quantity with powers of force and length; units must be known."""
        assert self.force is not None
        assert self.length is not None
        return self.force ** powers[0] * self.length ** powers[1]

    @property
    def acceleration(self) -> float:
        """Return gravity in m/s²; its number is in m/s² where that is usual, else in the unit of length."""
        scaled = self.gravity * (self.length or 1.0)
        plausible = [value for value in (self.gravity, scaled) if USUAL_GRAVITY[0] <= value <= USUAL_GRAVITY[1]]
        return plausible[0] if plausible else self.gravity

    @property
    def density(self) -> float:
        """Return the kg/m³ of a density of 1: what it weighs, over gravity in m/s²; 1 without gravity."""
        return self.gravity * self.si(_DENSITY) / self.acceleration if self.gravity else self.si(_DENSITY)


def with_numbers(document: dict[str, Any]) -> dict[str, Any]:
    """Convert the texts with units in a scene to numbers in its units, without copying unchanged lists."""
    units = _names_of(document)
    return {
        key: value if key == "units" else _convert(value, units, key, QUANTITIES.get(key))
        for key, value in document.items()
    }


# Keys of `search` and of `search.limits` that hold forces, lengths and masses
_LIMITS: Final = {"block_weight": _FORCE, "block_extent": _LENGTH}
_MASSES: Final = ("block_mass", "mass", "largest_block_mass")
_SAWN: Final = ("sawn_length", "dry_length")  # in space areas


def in_units(document: dict[str, Any], units: dict[str, str], dimension: int) -> dict[str, Any]:
    """Return a scene's materials, loads and search in units of other names, gravity in m/s²; all units are known."""
    old = system_of(document)
    new = UnitSystem.named(units["force"], units["length"], old.acceleration)

    def factor(powers: _Powers | None) -> float:
        if powers == _DENSITY:
            return old.density / new.density
        return 1.0 if powers is None else old.si(powers) / new.si(powers)

    def converted(value: Any, table: dict[str, float], scale: float = 1.0) -> Any:
        if isinstance(value, list):
            return [converted(item, table, scale) for item in value]
        if isinstance(value, dict):
            of_parameters = {name: factor(powers) for name, powers in powers_of(value.get("criterion")).items()}
            return {
                key: converted(
                    item,
                    of_parameters if key == "parameters" else table,
                    scale if key in _SPREAD else table.get(key, 1.0),
                )
                for key, item in value.items()
            }
        number = isinstance(value, float | int) and not isinstance(value, bool)
        return value * scale if number and scale != 1.0 else value

    factors = {key: factor(powers) for key, powers in QUANTITIES.items()}
    materials = {key: factors[key] for key in ("density", "reference_strength", *STRESS_KEYS)}
    limits = {key: factor(powers) for key, powers in _LIMITS.items()}
    limits |= dict.fromkeys(_MASSES, factor(_DENSITY) * factor((0, 3)))
    limits |= dict.fromkeys(_SAWN, factor((0, dimension - 1)))
    tables = {
        "materials": materials | {"gravity": old.acceleration / old.gravity if old.gravity else 1.0},
        "loads": factors,
        "search": limits,
    }
    return document | {part: converted(document[part], tables[part]) for part in tables if part in document}


class _Names(NamedTuple):
    """Names of the units of a scene, and its number for gravity."""

    force: str
    length: str
    gravity: float

    @property
    def system(self) -> UnitSystem:
        return UnitSystem.named(*self)


def system_of(document: dict[str, Any]) -> UnitSystem:
    return _names_of(document).system


def _names_of(document: dict[str, Any]) -> _Names:
    units = document.get("units")
    names = units if isinstance(units, dict) else {}
    return _Names(str(names.get("force", "N")), str(names.get("length", "m")), _gravity(document.get("materials")))


def _gravity(materials: Any) -> float:
    """Return the size of gravity in unvalidated materials, or the default."""
    value = materials.get("gravity", GRAVITY) if isinstance(materials, dict) else GRAVITY
    parts = value if isinstance(value, list) else [value]
    numbers = [part for part in parts if isinstance(part, int | float) and math.isfinite(part)]
    return math.hypot(*numbers) if len(numbers) == len(parts) else GRAVITY


def _convert(value: Any, units: _Names, where: str, powers: _Powers | None) -> Any:
    """Convert the texts under keys of `QUANTITIES` in a value to numbers, recursively."""
    if isinstance(value, str) and powers is not None:
        return _number(value, units, where, powers)
    if isinstance(value, list) and powers is None and not any(isinstance(item, dict) for item in value):
        return value  # coordinates: most of a large scene
    if isinstance(value, list):
        return [_convert(item, units, f"{where}[{index}]", powers) for index, item in enumerate(value)]
    if isinstance(value, dict):
        converted = {
            key: _convert(item, units, f"{where}.{key}", powers if key in _SPREAD else QUANTITIES.get(key))
            for key, item in value.items()
            if key != "parameters"
        }
        if "parameters" in value:
            parameters, criterion = value["parameters"], value.get("criterion")
            converted["parameters"] = _of_criterion(parameters, criterion, units, f"{where}.parameters")
        return converted
    return value


def _of_criterion(parameters: Any, name: Any, units: _Names, where: str) -> Any:
    """Convert the texts in parameters of a criterion by the units that it names, or by their keys."""
    texts = isinstance(parameters, dict) and any(isinstance(value, str) for value in parameters.values())
    powers = powers_of(name) if texts else {}
    if not powers:
        return _convert(parameters, units, where, None)
    return {key: _convert(item, units, f"{where}.{key}", powers.get(key)) for key, item in parameters.items()}


def powers_of(name: Any) -> dict[str, _Powers | None]:
    """Return what the parameters of a criterion are, by the words that it has for their units."""
    is_criterion = isinstance(name, str) and name in plugins.entry_points("jld.criteria")
    parameters = getattr(plugins.load("jld.criteria", name), "parameters", ()) if is_criterion else ()
    return {} if isinstance(parameters, type) else {p.name: _WORDS.get(p.unit) for p in parameters}


def _number(text: str, units: _Names, where: str, powers: _Powers) -> float:
    """Convert a text with a number and a unit to a number in the units of the scene."""
    expected = f'a number, or a text such as "{_EXAMPLES[powers]}"'
    match = _TEXT.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise InputError(where, f"{shown(text)} is no number with a unit", expected)
    number, unit = float(match[1]), match[2]
    if unit is None:
        return number
    for name, sizes in zip(units[:2], (NEWTONS, METRES), strict=True):
        if name not in sizes:
            raise InputError(where, f"no unit is named {name!r}, one of the scene", "a number alone")
    # the unit is a product of factors "/name²": its size in SI units, and its powers of force and length
    size, force, length, has_mass = 1.0, 0, 0, False
    position = 0
    while position < len(unit):
        factor = _FACTOR.match(unit, position)
        unit_of_factor = None if factor is None else _unit(factor[2])
        if factor is None or unit_of_factor is None or (factor[1] == "/" and position == 0):
            raise InputError(where, f"no unit is named {unit!r}", expected)
        power = {"²": 2, "³": 3, None: 1}.get(factor[3]) or int(factor[3])
        power = -power if factor[1] == "/" else power
        size_of_factor, (force_power, length_power) = unit_of_factor
        size *= size_of_factor**power
        has_mass = has_mass or factor[2] in MASSES
        force, length = force + power * force_power, length + power * length_power
        position = factor.end()
    if (force, length) != powers:
        raise InputError(where, f"{unit!r} is no unit of this quantity", expected)
    if powers != _DENSITY:
        return number * size / units.system.si(powers)
    # a mass per volume is a weight under standard gravity here; a weight per volume is divided by the scene's gravity
    if has_mass:
        return number * size / GRAVITY / units.system.density
    if units.gravity == 0.0:
        raise InputError(where, f"without gravity {text.strip()!r} is no density", "a mass per volume")
    return number * size / (units.gravity * units.system.si(_DENSITY))


def _unit(name: str) -> tuple[float, _Powers] | None:
    """Return the size of a unit in N and m, and its powers of force and length; None for an unknown unit."""
    # A force and a length may stand together, as in kNm.
    if name in NEWTONS:
        return NEWTONS[name], _FORCE
    if name in METRES:
        return METRES[name], _LENGTH
    if name in _PASCALS:
        return _PASCALS[name], STRESS
    for force in NEWTONS:
        if name.startswith(force) and name[len(force) :] in METRES:
            return NEWTONS[force] * METRES[name[len(force) :]], _MOMENT
    return None
