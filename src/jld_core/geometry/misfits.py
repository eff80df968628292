"""Overlaps and near misses of elements, and their messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from jld_core.arrays import Floats
from jld_core.errors import InputError

_NAMED: Final = 10  # largest number of pairs named in an error message
_SHOWN: Final = 3  # largest number of pairs named in a warning


@dataclass(frozen=True)
class Overlap:
    """Two elements that share an area or a volume.

    a, b: names of the elements. depth: depth of the overlap, length. place: (d,) a point of the overlap.
    """

    a: str
    b: str
    depth: float
    place: Floats


@dataclass(frozen=True)
class NearMiss:
    """Two elements with faces that nearly touch.

    a, b: indices of the elements. gap: largest distance of the faces, length. place: (d,) a point between them.
    angle: between faces that touch at one end and open towards the other, degrees; else 0.
    """

    a: int
    b: int
    gap: float
    place: Floats
    angle: float = 0.0


def refuse_overlaps(pairs: Sequence[Overlap], expected: str) -> None:
    """Raise InputError if elements overlap, naming up to ten pairs with depth and place.

    pairs: overlaps found; nothing happens where there are none. expected: remedy, for the message.
    """
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
    """Describe near misses in one sentence, with their number and the first places.

    misses: near misses. ids: names of the elements. unit: unit of length.
    """
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
    """Describe width and place of a gap, or of a joint that opens from one end."""
    if miss.angle > 0.0:
        return f"touch at one end and open by {miss.gap:.3g} {unit} ({miss.angle:.2g}°) at ({_point(miss.place)})"
    return f"are {miss.gap:.3g} {unit} apart at ({_point(miss.place)})"


def _point(place: Floats) -> str:
    """Format the coordinates (d,) of a point, with more digits far from the origin."""
    return ", ".join(f"{value:.{5 if abs(value) < 1e4 else 10}g}" for value in place)
