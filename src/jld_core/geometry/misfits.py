"""Geometry that is nearly right, in words: what overlaps, and what nearly touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from jld_core.arrays import Floats
from jld_core.errors import InputError

_NAMED: Final = 10  # pairs that a complaint names
_SHOWN: Final = 3  # pairs that a warning names


@dataclass(frozen=True)
class Overlap:
    """Two elements that share an area or a volume: how deep, length, and where, (d,)."""

    a: str
    b: str
    depth: float
    place: Floats


@dataclass(frozen=True)
class NearMiss:
    """Two elements, by index, with faces that nearly touch: how far apart, length, and where, (d,).

    angle: where the faces touch at one end and open towards the other, between them, degrees; else 0.
    """

    a: int
    b: int
    gap: float
    place: Floats
    angle: float = 0.0


def refuse_overlaps(pairs: Sequence[Overlap], expected: str) -> None:
    """Raise InputError naming all pairs, up to ten, with depth and place; nothing where there is none."""
    if not pairs:
        return
    named = [f"by {pair.depth:.3g} at ({_point(pair.place)})" for pair in pairs]
    first = pairs[0]
    rest = [f"{p.a!r} and {p.b!r} {how}" for p, how in zip(pairs[1:_NAMED], named[1:_NAMED], strict=True)]
    more = len(pairs) - _NAMED
    problem = f"they overlap {named[0]}" + ("; so do " + ", ".join(rest) if rest else "")
    problem += f" and {more} more pairs" if more > 0 else ""
    deepest = max(pair.depth for pair in pairs)
    raise InputError(
        f"elements {first.a!r} and {first.b!r}", problem, f'{expected}, or a "tolerance" above {deepest:.2g}'
    )


def words_of(misses: Sequence[NearMiss], ids: Sequence[str], unit: str) -> tuple[str, ...]:
    """A sentence on faces that nearly touch, with their number and the first places; none where there are none."""
    if not misses:
        return ()
    shown = ", ".join(f"{ids[m.a]!r} and {ids[m.b]!r} {_gap(m, unit)}" for m in misses[:_SHOWN])
    widest = max(miss.gap for miss in misses)
    count = (
        f"{len(misses)} pairs of faces nearly touch and are"
        if len(misses) > 1
        else "a pair of faces nearly touches and is"
    )
    more = ", …" if len(misses) > _SHOWN else ""
    return (f'{count} not joined: {shown}{more}; "tolerance": {1.1 * widest:.2g} closes such gaps',)


def _gap(miss: NearMiss, unit: str) -> str:
    """Say how wide a gap is and where: between faces side by side, or of a joint that opens from one end."""
    if miss.angle > 0.0:
        return f"touch at one end and open by {miss.gap:.3g} {unit} ({miss.angle:.2g}°) at ({_point(miss.place)})"
    return f"are {miss.gap:.3g} {unit} apart at ({_point(miss.place)})"


def _point(place: Floats) -> str:
    """Coordinates, with digits enough to tell elements apart far from the origin."""
    return ", ".join(f"{value:.{5 if abs(value) < 1e4 else 10}g}" for value in place)
