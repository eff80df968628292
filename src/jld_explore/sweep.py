"""Load factors over a grid of values of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jld_core import plugins
from jld_core.assembly import Assembly, Labels
from jld_core.parameters import typed
from jld_core.scene.schema import Scene

if TYPE_CHECKING:
    import pandas as pd


@typed
def sweep(
    scene: str | Path | Mapping[str, Any] | Scene | Callable[..., Scene | Mapping[str, Any] | Assembly],
    grid: Mapping[str, Any],
    labels: Labels | None = None,
    explore: bool = False,
    jobs: int = 1,
    *,
    fields: bool = False,
    seconds: float | None = None,
) -> pd.DataFrame:
    """Compute λ over a grid of values of a scene.

    Parameters
    ----------
    scene : str, Path, dict, Scene or callable
        Scene, or a function that makes the scene of one point: it takes the keys of the grid as keywords, or, with one
        parameter of another name, all of them as a dict.
    grid : dict
        Values of each key of the scene, such as ``{"materials.dry.friction_coefficient": [0.2, 0.4]}``; entries of
        lists as in ``loads.live[0].force[1]``. Numbers are in scene units, texts have a unit. `loads.angle` turns all
        live loads, degrees. At most 1e6 points.
    labels : (m,) array or str, optional
        Labels as in `solve`. Default: those of the scene.
    explore : bool
        Search the strongest layout at each point.
    jobs : int
        Number of threads, or of processes where points are solved one by one.
    fields : bool
        Also bound λ by fields.
    seconds : float, optional
        Time for each search, or for the bounds by fields of each point, s.

    Returns
    -------
    pandas.DataFrame
        One row per point: the keys, then `load_factor`, `bracket_lo`, `bracket_hi`, `status`, `mechanism` (its kind in
        words), `proven`, and `uncut`, an upper bound on λ of the structure without cuts. With `fields` also `fields_lo`
        and `fields_hi`, with `explore` also `labelling`.

    Raises
    ------
    InputError
        If a key does not exist, nothing depends on it, or a scene of the grid cannot be used.

    Examples
    --------
    >>> table = sweep("scenes/flat_beam_arch.json", {"materials.dry.friction_angle": [20, 25, 30]})
    >>> table["load_factor"]
    """
    table: pd.DataFrame = plugins.part("sweep")(scene, grid, labels, explore, jobs, fields=fields, seconds=seconds)
    return table
