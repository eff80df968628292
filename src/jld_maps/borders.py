"""Borders between the mechanisms of a map."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core import Scene, Status, load_scene
from jld_maps.grid import Grid, Swept, points_of

_HALVINGS: Final = 6  # halvings of the distance of two points of a grid before λ is extrapolated
_NEAR: Final = 1e-3  # share of that distance to the second point of a side at the edge of the map


def borders(structure: Any, grid: Any, table: pd.DataFrame, labels: Any = None) -> pd.DataFrame:
    """Find points on the borders between the mechanisms of a map.

    Between neighbours of different mechanisms the distance is halved by the mechanism in the middle. λ is then
    extrapolated from both sides; the border is where both meet.

    Parameters
    ----------
    structure : str, Path, dict or Scene
        Scene.
    grid : dict
        Values of the keys of the map, numbers.
    table : pandas.DataFrame
        Result of `sweep` over this grid.
    labels : (m,) array or str, optional
        As in `sweep`.

    Returns
    -------
    pandas.DataFrame
        Columns: the keys; `one` and `other`, the mechanisms below and above along the key `along`; `load_factor`. Empty
        where more than strengths and loads depends on the keys.

    Raises
    ------
    InputError
        As `sweep`.
    """
    scene = structure if isinstance(structure, Scene) else load_scene(structure)
    axes = Grid(scene, points_of(grid)).axes
    names = np.where(table["status"] == str(Status.COLLAPSE), table["mechanism"], "").reshape(
        [*map(len, axes.values())]
    )
    parts = []
    for axis, key in enumerate(axes):
        first, second = (np.moveaxis(names, axis, 0)[cut] for cut in (slice(None, -1), slice(1, None)))
        edges = np.argwhere((first != second) & (first != "") & (second != ""))
        if len(edges):
            places = np.insert(edges[:, 1:], axis, edges[:, 0], axis=1)
            found = _along(scene, axes, key, places, labels)
            if found is not None:
                parts.append(found)
    columns = [*axes, "along", "one", "other", "load_factor"]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def _along(scene: Scene, axes: dict[str, list[Any]], key: str, places: Any, labels: Any) -> pd.DataFrame | None:
    """Find the borders on edges of a grid along a key; places: (e, axes) the lower ends of the edges."""
    axis, values = list(axes).index(key), np.array(axes[key], dtype=float)
    # one assembly for each value of the map and between its ends; where states lie on a line, none for further values
    every = np.unique([*values, 0.5 * (values[0] + values[-1])])
    points = Grid(scene, axes | {key: every.tolist()})
    states = points.states()
    whole = None if states is None else Swept(points, states, labels, uncut=False)
    if states is None or whole is None or not whole.batched:
        return None
    linear = states.linear(axis, every)

    def at(x: Any) -> dict[str, Any]:
        """Return the columns of `sweep` at values (e,) of the key, or several for each edge."""
        own, swept = np.tile(places.astype(float), (len(x) // len(places), 1)), whole
        if linear:
            own[:, axis] = np.interp(x, every, np.arange(len(every)))
        else:
            all_x, where = np.unique(np.concatenate([x, values[:2]]), return_inverse=True)
            further = Grid(scene, axes | {key: all_x.tolist()})
            swept = Swept(further, further.states(), labels, uncut=False)  # type: ignore[arg-type]
            own[:, axis] = where[: len(x)]
        return swept.all(own, 1)

    low, high = values[places[:, axis]], values[places[:, axis] + 1]
    name = at(low)["mechanism"]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = at(middle)["mechanism"] == name
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    step = high - low
    # the second point of each side stays within the map, where values are known to make sense
    before = np.where(low - step < values.min(), low + _NEAR * step, low - step)
    after = np.where(high + step > values.max(), high - _NEAR * step, high + step)
    each = at(np.concatenate([before, low, high, after]))
    ends = [{key: one[k * len(low) : (k + 1) * len(low)] for key, one in each.items()} for k in range(4)]
    far, near, other, beyond = (one["load_factor"].copy() for one in ends)
    far[(before > low) & (ends[0]["mechanism"] != name)] = np.nan
    beyond[(after < high) & (ends[3]["mechanism"] != ends[2]["mechanism"])] = np.nan
    slopes = (near - far) / (low - before), (beyond - other) / (after - high)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = low + (other - near - slopes[1] * step) / (slopes[0] - slopes[1])
    fits = np.isfinite(x) & (x >= low - step) & (x <= high + step)
    x = np.where(fits, x, 0.5 * (low + high))
    table = {one: np.array(axes[one], dtype=object)[places[:, k]] for k, one in enumerate(axes)}
    table |= {key: x, "along": key, "one": ends[1]["mechanism"], "other": ends[2]["mechanism"]}
    between = 0.5 * (ends[1]["load_factor"] + ends[2]["load_factor"])
    return pd.DataFrame(table | {"load_factor": np.where(fits, near + slopes[0] * (x - low), between)})
