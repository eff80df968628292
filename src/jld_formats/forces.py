"""Parser of forces written as text: `10 kN`, `F1 = 2,5 kN`, `1 t`, `3 kN; -4 kN`."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core import Floats, InputError, Ints
from jld_core.scene import units

# Alternative spellings of units in drawings with capital letters; mN and T are ambiguous and refused
_SPELLINGS: Final = {"KN": "kN", "kn": "kN", "n": "N", "DAN": "daN", "KG": "kg", "kips": "kip", "LBF": "lbf"}

# Expected text, for error messages
_EXPECTED: Final = f'a number with one of {", ".join(units.NEWTONS)}, as "F1 = 2.5 kN", or two as "3 kN; -4 kN"'

# Pattern of a number with decimal point or decimal comma
_DECIMAL: Final = r"[-+]?(?:\d+(?:\.\d*|,\d+)?|[.,]\d+)(?:[eE][-+]?\d+)?"

# Pattern of one force: optional name, number, optional unit, optional "per length or area"
_FORCE: Final = re.compile(
    rf"(?:(?P<name>[^\W\d][\w.]*)\s*[=:]\s*)?(?P<number>{_DECIMAL})\s*(?P<unit>[^\W\d]+)?(?P<per>\s*/\s*[^\W\d]\w*(?:[²³]|\^\d)?)?"
)

# Pattern of "per length or area": unit of length, and the power 2
_PER: Final = re.compile(r"\s*/\s*([^\W\d]+?)(\^?2|²)?")

_THOUSANDS: Final = re.compile(r"[-+]?\d{1,3},\d{3}(?!\d)")  # pattern of a number whose comma may separate thousands

_COMPONENT: Final = re.compile(r"[FPQV]?_?([XYZ])", re.IGNORECASE)  # pattern of names of components, such as Fx or Q_y

_BETWEEN: Final = re.compile(r"\s*(?:;|,(?=\s|[-+]|[^\W\d]))\s*")  # pattern of the separator of two forces


@dataclass(frozen=True)
class WrittenForce:
    values: tuple[float, ...]  # one magnitude, or the two components fx and fy, in the requested force unit
    components: bool  # True if the values are components. One value with False is a magnitude without direction.
    has_unit: bool  # True if the text names a unit
    # for a load per length or area: metres in its unit of length, and 1 or 2. None for a force.
    per: tuple[float, int] | None = None


def parse_force(text: str, unit: str = "N", *, distributed: bool = False, dimension: int = 2) -> WrittenForce:
    """Parse a text that states a force: one number with or without a unit, or one for each component.

    A name with ``=`` or ``:`` may stand before a number; ``Fx``, ``Fy`` and ``Fz`` name components. A comma inside a
    number is a decimal comma. Numbers are separated by a semicolon, or by a comma with a blank or a sign behind it.
    unit: of the result, and of numbers without one. distributed: accept one load per length or area, as ``10 kN/m``.
    InputError for other words, unknown units, a comma that may separate thousands, and too few or too many components.

    Examples
    --------
    >>> parse_force("F1 = 2,5 kN").values
    (2500.0,)
    >>> parse_force("Fx = 3 kN; Fy = -4 kN", "kN").values
    (3.0, -4.0)
    """
    parts: list[tuple[str, float, bool]] = []
    position = 0
    stripped = text.strip()
    if distributed and (single := _FORCE.fullmatch(stripped)) and single["per"] and single["unit"]:
        length = _PER.fullmatch(single["per"])
        if length is None or length[1] not in units.METRES:
            raise _refusal(text, f"no unit of length is named {single['per'].strip(' /')!r}")
        _, value, _ = _part(single, text, unit, distributed=True)
        return WrittenForce(
            (value,), components=False, has_unit=True, per=(units.METRES[length[1]], 2 if length[2] else 1)
        )
    while position < len(stripped) or not parts:
        if parts:
            gap = _BETWEEN.match(stripped, position)
            position = gap.end() if gap else position
        match = _FORCE.match(stripped, position) if not parts or gap else None
        if match is None:
            remaining = stripped[position:].strip() or "nothing"
            raise _refusal(text, f"{remaining!r} is no part of a force" if parts else "it is no force")
        parts.append(_part(match, text, unit))
        position = match.end()
    return _join_components(parts, text, dimension)


def is_force(text: str) -> bool:
    """Return True if a text begins as a force does: with a number, or a component such as Fx = 3 kN."""
    return bool(re.match(r"\s*([-+.]?\d|[FPQV]?_?[XYZ]\s*=)", text, re.IGNORECASE))


def refuse_mixed(texts: Sequence[tuple[str, str]]) -> None:
    """Raise InputError where one of the texts with their layers has a decimal comma, and a point may mean thousands."""
    comma = next((text for _, text in texts if re.search(r"\d,\d", text)), None)
    for layer, text in texts if comma is not None else ():
        if re.search(r"(?<![\d.,])\d{1,3}\.\d{3}(?!\d)", text):
            problem = f"the point in {text!r} may separate thousands, as {comma!r} has a decimal comma"
            raise InputError(f"layer {layer!r}", problem, "one sign for decimals, and none for thousands")


def states_force(text: str) -> bool:
    """Return True for a text that is a force, or a load per length or area, with its unit."""
    try:
        return parse_force(text, distributed=True).has_unit
    except InputError:
        return False


def closest_first(
    lines: Ints, texts: Ints, distances: Floats, reach: float, names: Sequence[tuple[str, str]]
) -> dict[int, int]:
    """Match lines and texts (k,), closest pair first; InputError where equal distances share a line or text."""
    order = np.lexsort((texts, lines, distances))
    pairs = list(zip(lines[order].tolist(), texts[order].tolist(), distances[order].tolist(), strict=True))
    text_of_line: dict[int, int] = {}
    used: set[int] = set()
    for position, (line, text, distance) in enumerate(pairs):
        if line in text_of_line or text in used:
            continue
        for other, rival, beyond in itertools.islice(pairs, position + 1, None):
            if beyond > distance + reach:
                break
            if (other == line) != (rival == text) and other not in text_of_line and rival not in used:
                layer, words = names[text]
                partner = "two lines" if rival == text else f"the same line as the text {names[rival][1]!r}"
                problem = f"the text {words!r} is equally far from {partner}"
                raise InputError(f"layer {layer!r}", problem, "each text nearer to the line that it belongs to")
        text_of_line[line] = text
        used.add(text)
    return text_of_line


def _part(match: re.Match[str], text: str, unit: str, *, distributed: bool = False) -> tuple[str, float, bool]:
    """Parse a match of `_FORCE`: name or "", value in `unit`, whether it has a unit."""
    number, unit_name = match["number"], match["unit"]
    if match["per"] and not distributed:
        problem = f"{match['number']} {unit_name or ''}{match['per'].strip()} is a load per length or area"
        raise _refusal(text, problem, "a line along the edge that it acts on, or a force")
    if _THOUSANDS.fullmatch(number):
        raise _refusal(text, f"the comma in {number!r} may separate thousands or decimals", "a point for decimals")
    value = float(number.replace(",", "."))
    if not math.isfinite(value):
        raise _refusal(text, "its number is out of range")
    if unit_name is None:
        return match["name"] or "", value, False
    name = _SPELLINGS.get(unit_name, unit_name)
    if name not in units.NEWTONS:
        raise _refusal(text, f"no unit of force is named {unit_name!r}")
    target = _SPELLINGS.get(unit, unit)
    if target not in units.NEWTONS:
        raise _refusal(text, f"no unit of force is named {unit!r}, that of the scene", "a number alone")
    return (match["name"] or "", value if name == target else value * units.NEWTONS[name] / units.NEWTONS[target], True)


def _join_components(parts: list[tuple[str, float, bool]], text: str, dimension: int) -> WrittenForce:
    """Combine parsed numbers into one magnitude or all components of a force."""
    if len(parts) > dimension:
        raise _refusal(text, f"it has {len(parts)} numbers")
    axes = [match[1].casefold() if (match := _COMPONENT.fullmatch(name)) else "" for name, _, _ in parts]
    if len({has_unit for _, _, has_unit in parts}) > 1:
        raise _refusal(text, "not all of its numbers have a unit")
    values = [value for _, value, _ in parts]
    if "z" in axes and dimension == 2:
        raise _refusal(text, "a force in the plane has no component along z")
    if any(axes):
        if "" in axes or len(set(axes)) < len(axes):
            raise _refusal(text, "some of its numbers name no component, or the same one")
        by_axis = dict(zip(axes, values, strict=True))
        values = [by_axis.get(axis, 0.0) for axis in "xyz"[:dimension]]
    elif len(values) not in (1, dimension):
        raise _refusal(text, f"it has {len(values)} numbers for {dimension} components")
    return WrittenForce(tuple(values), len(values) > 1, parts[0][2])


def _refusal(text: str, problem: str, expected: str = _EXPECTED) -> InputError:
    return InputError(f"the text {text!r}", problem, expected)
