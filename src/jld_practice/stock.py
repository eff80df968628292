"""Place stones in stock cuboids, and bound the least number of cuboids."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from jld_core.errors import ParameterError
from jld_practice.making import Stone, factor_to

if TYPE_CHECKING:
    import pandas as pd

_FITS: Final = 1e-9  # excess of a side, relative to the stock, up to which a stone fits


@dataclass(frozen=True)
class Placed:
    """Stone in a stock cuboid; lengths in the unit of the scene.

    stone: number of the stone. cuboid: number of the stock cuboid, from 1. corner: (float, float, float) corner of the
    stone's own cuboid nearest to the corner of the stock. sides: (float, float, float) sides of the stone's own cuboid
    along those of the stock.
    """

    stone: int
    cuboid: int
    corner: tuple[float, float, float]
    sides: tuple[float, float, float]


@dataclass(frozen=True)
class Stock:
    """Stones placed in equal stock cuboids.

    size: (float, float, float) sides of a stock cuboid, in the unit of the scene. placed: place of every stone.
    cuboids: number of stock cuboids. least: number of cuboids that no cutting of these stones goes below, whatever
    their places. volume: volume of all stones.
    """

    size: tuple[float, float, float]
    placed: tuple[Placed, ...]
    cuboids: int
    least: int
    volume: float

    @property
    def waste(self) -> float:
        """Return the share of the stock that is lost."""
        return 1.0 - self.volume / (self.cuboids * math.prod(self.size))

    @property
    def least_waste(self) -> float:
        """Return the share of the stock that any cutting of these stones loses."""
        return 1.0 - self.volume / (self.least * math.prod(self.size))


def stock_of(
    stones: list[Stone], size: tuple[float, float, float], kerf: float = 0.0, said: tuple[float, str] = (1.0, "")
) -> Stock:
    """Place the smallest cuboids of stones in stock cuboids by guillotine cuts.

    Each cut passes through a whole piece. Stones are placed from the largest to the smallest, in the free piece that
    they fill best, turned about the axes as they fit (guillotine cuts; the least leftover side decides). stones: of one
    layout. size: sides of a stock cuboid. kerf: width of a cut. All are lengths in the unit of the scene. said: factor
    to the unit of messages, and its name after a space. Raises ParameterError if a size is wrong or a stone does not
    fit.
    """
    if not all(0.0 < side < math.inf for side in size):
        raise ParameterError("stock", "a side is not above 0", "three sides above 0, as 1.2,0.8,0.3")
    if not math.isfinite(math.prod(size)):
        raise ParameterError("stock", "the volume of a cuboid is out of range", "shorter sides")
    if not 0.0 <= kerf < min(size):
        raise ParameterError(
            "kerf", "it is no width of a cut in this stock", "a width from 0 to below the sides of the stock"
        )
    free: list[tuple[int, tuple[float, ...], tuple[float, ...]]] = []
    placed, count = [], 0
    for stone in sorted(stones, key=lambda one: (-one.stock, one.number)):
        place = _best(stone, free)
        if place is None:
            count += 1
            free.append((count, (0.0, 0.0, 0.0), tuple(size)))
            place = _best(stone, free)
        if place is None:
            factor, unit = said
            own, stated = (" × ".join(f"{factor * side:.4g}" for side in one) + unit for one in (stone.size, size))
            problem = f"stone {stone.number} of {own} does not fit into {stated}"
            raise ParameterError("stock", problem, "larger cuboids, or a search with smaller blocks")
        index, sides3 = place
        cuboid, corner, room = free.pop(index)
        placed.append(Placed(stone.number, cuboid, _three(corner), _three(sides3)))
        free += [(cuboid, *rest) for rest in _rest(corner, room, sides3, kerf)]
    volume = sum(stone.volume for stone in stones)
    return Stock(size, tuple(placed), count, least_number([one.volume for one in stones], math.prod(size)), volume)


def least_number(volumes: list[float], stock: float) -> int:
    """Return the least number of cuboids that any cutting of stones needs, by their volumes.

    Bound L2 of Martello and Toth (1990, Discrete Applied Mathematics 28, 59-70): for each k, stones above stock − k
    need a cuboid each, and none above half fits beside another. volumes: of the stones. stock: volume of one cuboid.
    """
    sizes = np.sort(np.array(volumes) / stock)[::-1] if volumes else np.zeros(0)
    found = math.ceil(float(sizes.sum()) - _FITS)
    for k in (0.0, *(float(one) for one in np.unique(sizes[sizes <= 0.5]))):
        alone = sizes > 1.0 - k + _FITS
        large = (sizes > 0.5 + _FITS) & ~alone
        small = (sizes >= k) & (sizes <= 0.5 + _FITS)
        left = float(sizes[small].sum()) - (float(large.sum()) - float(sizes[large].sum()))
        found = max(found, int(alone.sum()) + int(large.sum()) + max(0, math.ceil(left - _FITS)))
    return found


def _three(values: tuple[float, ...]) -> tuple[float, float, float]:
    """Return three numbers as a tuple of three."""
    return values[0], values[1], values[2]


def _best(
    stone: Stone, free: list[tuple[int, tuple[float, ...], tuple[float, ...]]]
) -> tuple[int, tuple[float, ...]] | None:
    """Return the free piece that a stone fills best, and its sides there; None if none fits.

    free: cuboid number, corner and sides of each piece. The piece with the smallest least leftover wins.
    """
    a, b, c = stone.size
    turns = dict.fromkeys([(a, b, c), (a, c, b), (b, a, c), (b, c, a), (c, a, b), (c, b, a)])
    best: tuple[tuple[float, ...], int, tuple[float, ...]] | None = None
    for index, (_, _, room) in enumerate(free):
        for sides in turns:
            over = sorted(have - side for have, side in zip(room, sides, strict=True))
            if over[0] >= -_FITS * max(room) and (best is None or (*over, index) < (*best[0], best[1])):
                best = (tuple(over), index, sides)
    return None if best is None else (best[1], best[2])


def _rest(
    corner: tuple[float, ...], room: tuple[float, ...], sides: tuple[float, ...], kerf: float
) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the pieces (corner, sides) that remain beside a stone at a piece's corner.

    Cuts pass through the whole piece: the first one where the most is left over.
    """
    found = []
    at, size = list(corner), list(room)
    for axis in sorted(range(3), key=lambda k: -(room[k] - sides[k])):
        left = size[axis] - sides[axis] - kerf
        if left > _FITS * room[axis]:
            start, whole = list(at), list(size)
            start[axis] += sides[axis] + kerf
            whole[axis] = left
            found.append((tuple(start), tuple(whole)))
        size[axis] = sides[axis]
    return found


def stock_table(stock: Stock, own: str, unit: str) -> pd.DataFrame:
    """Return where each stone lies in its stock cuboid: one row per stone.

    own: unit of length of the scene. unit: of the table. Columns are cuboid, stone, and corner and side along each axis
    of the cuboid.
    """
    import pandas as pd  # slow to import and needed for tables only

    factor = factor_to(unit, own)
    rows = [
        {"cuboid": one.cuboid, "stone": one.stone}
        | {f"at_{k}_{unit}": factor * value for k, value in enumerate(one.corner, 1)}
        | {f"side_{k}_{unit}": factor * value for k, value in enumerate(one.sides, 1)}
        for one in sorted(stock.placed, key=lambda one: (one.cuboid, one.stone))
    ]
    return pd.DataFrame(rows).map(lambda x: float(f"{x:.12g}") if isinstance(x, float) else x)


def words_of_stock(stock: Stock) -> str:
    """Describe in one line the number of cuboids, the waste, and bounds on both."""
    proven = "the least number" if stock.cuboids == stock.least else f"any cutting needs {stock.least} or more"
    least = "" if stock.cuboids == stock.least else f", at least {100.0 * stock.least_waste:.3g} % in any case"
    return (
        f"{stock.cuboids} stock cuboid{'s' * (stock.cuboids != 1)}, {proven}; waste {100.0 * stock.waste:.3g} %{least}"
    )
