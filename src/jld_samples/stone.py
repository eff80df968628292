"""Common parts of all samples: material, loads, checks of options, and swept elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Floats, InputError, ParameterError, Scene, parameters, parse_scene


@dataclass(frozen=True)
class Stone:
    """Material of a sample.

    Attributes
    ----------
    density : float
        Density, kg/m³.
    friction : float
        Friction coefficient of dry joints.
    tension : float
        Tensile strength σt of inner faces, Pa.
    shear : float
        Shear strength τ of inner faces, Pa.
    """

    density: float = 2000.0
    friction: float = 0.6
    tension: float = 2e5
    shear: float = 2e5

    def __post_init__(self) -> None:
        parameters.require_field_types(self)


MOST: Final = 100_000  # largest number of elements of a sample
LOADS: Final = ("push", "crown", "quarter")
"""Names of the live loads.

push: horizontal body load. crown, quarter: 1 N downwards on the upper side of the highest element at that place.
"""


def check(**values: float) -> None:
    """Raise InputError for a dimension that is not a finite number above 0."""
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise ParameterError(name, f"{float(value):g} is wrong", "a number above 0")


def count(least: int, **values: int) -> None:
    """Raise InputError for a number of parts below `least` or above `MOST`."""
    for name, value in values.items():
        if not least <= value <= MOST:
            raise ParameterError(name, f"{value} is wrong", f"a number from {least} to {MOST}")


def cap(elements: float) -> None:
    """Raise InputError if a sample would have more than `MOST` elements, before it is made."""
    if elements > MOST:
        raise InputError("jld new", f"that would be {elements:.3g} elements", f"at most {MOST}")


def choose(option: str, value: str, allowed: Sequence[str]) -> None:
    if value not in allowed:
        raise ParameterError(option, f"{value!r} is unknown", "one of " + ", ".join(allowed))


def scene_of(
    name: str, elements: list[dict[str, Any]], stone: Stone, load: str, *, depth: float | None = None
) -> Scene:
    choose("load", load, LOADS)
    spatial = "vertices" in elements[0]
    document: dict[str, Any] = {
        "name": name,
        "elements": elements,
        "materials": materials(stone),
        "loads": {"live": _live(elements, load, spatial)},
    }
    if depth is not None and not spatial:
        document["thickness"] = depth
    return parse_scene(document, name)


def materials(stone: Stone) -> dict[str, Any]:
    return {
        "density": stone.density,
        "dry": {"friction_coefficient": stone.friction},
        "inner": {"tensile_strength": stone.tension, "shear_strength": stone.shear},
    }


def _live(elements: list[dict[str, Any]], load: str, spatial: bool) -> list[dict[str, Any]]:
    if load == "push":
        return [{"body": [1.0, 0.0, 0.0] if spatial else [1.0, 0.0]}]
    shapes = [np.array(e["vertices" if spatial else "polygon"]) for e in elements]
    free = [k for k, e in enumerate(elements) if not e.get("support")]
    low = np.min([shapes[k].min(axis=0) for k in free], axis=0)
    high = np.max([shapes[k].max(axis=0) for k in free], axis=0)
    middle = 0.5 * (low + high)
    x = middle[0] if load == "crown" else low[0] + 0.25 * (high[0] - low[0])
    point = np.array([x, *middle[1:]])

    # planar: the highest element at x; spatial: the element nearest to the place in plan, then the highest
    def worth(k: int) -> tuple[float, float]:
        """Return the distance of an element from the place in plan, and its negative height."""
        aside = np.abs(shapes[k].mean(axis=0) - point)[:-1].max()
        return round(float(aside), 9), -float(shapes[k][:, -1].max())

    within = [k for k in free if shapes[k][:, 0].min() <= x + 1e-9 and shapes[k][:, 0].max() >= x - 1e-9]
    chosen = min(within or free, key=lambda k: (*(worth(k)[::-1] if not spatial else worth(k)), k))
    top = float(shapes[chosen][:, -1].max())
    if not spatial:
        top = _top_at(shapes[chosen], float(x))
    foot = [float(x), top] if not spatial else [*map(float, shapes[chosen].mean(axis=0)[:2]), top]
    return [{"element": elements[chosen]["id"], "force": [0.0, 0.0, -1.0] if spatial else [0.0, -1.0], "at": foot}]


def _top_at(outline: Floats, x: float) -> float:
    """Return the largest y at which an upright line at x meets a polygon (k, 2)."""
    # Where rounding puts x just beside the polygon, the nearest corner counts.
    x = float(np.clip(x, outline[:, 0].min(), outline[:, 0].max()))
    begin, end = outline, np.roll(outline, -1, axis=0)
    low, high = np.minimum(begin[:, 0], end[:, 0]), np.maximum(begin[:, 0], end[:, 0])
    met = (low <= x) & (x <= high)
    wide = met & (high > low)
    share = (x - begin[wide, 0]) / (end[wide, 0] - begin[wide, 0])
    heights = begin[wide, 1] + share * (end[wide, 1] - begin[wide, 1])
    upright = met & ~wide
    return float(np.concatenate([heights, begin[upright, 1], end[upright, 1]]).max())


def box(name: str, low: Sequence[float], high: Sequence[float], **keys: Any) -> dict[str, Any]:
    """Make a spatial box element between two corners.

    Parameters
    ----------
    name : str
        Id of the element.
    low, high : (3,) sequence of float
        Corners, scene units.
    **keys : Any
        Further keys of the element, such as `support`.

    Returns
    -------
    dict
        Entry of "elements" in a scene.
    """
    ends = (low, high)
    corners = [[ends[i][0], ends[j][1], ends[k][2]] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return {"id": name, "vertices": [[float(v) for v in corner] for corner in corners], "faces": faces, **keys}


def swept(name: str, sections: Floats, **keys: Any) -> dict[str, Any]:
    """Make a spatial element through consecutive plane sections (k, 4, 3), corners in one order, with plane sides."""
    number = len(sections)
    faces = [[3, 2, 1, 0], [4 * (number - 1) + i for i in range(4)]]
    for k in range(number - 1):
        a, b = 4 * k, 4 * (k + 1)
        faces += [[a + i, a + (i + 1) % 4, b + (i + 1) % 4, b + i] for i in range(4)]
    return {"id": name, "vertices": sections.reshape(-1, 3).tolist(), "faces": faces, **keys}


def steps(parts: int, offset: bool) -> list[tuple[int, ...]]:
    """Return the half-step stations along a ring of 2·parts half steps that each part spans, two of them."""
    # With `offset`, parts begin half a part later, and the first and the last are half as long.
    if not offset:
        return [(2 * k, 2 * k + 1, 2 * k + 2) for k in range(parts)]
    return [(0, 1), *((2 * k - 1, 2 * k, 2 * k + 1) for k in range(1, parts)), (2 * parts - 1, 2 * parts)]
