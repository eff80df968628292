"""Provide `jld map`: λ over values of a scene, as a table and a picture."""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from jld_core import ParameterError, build_assembly, error_context, files, load_scene
from jld_explore.cli import options, streams
from jld_explore.report import csv_of
from jld_maps.borders import borders
from jld_maps.grid import MOST, Grid
from jld_maps.picture import figure_of_layouts, figure_of_map
from jld_maps.sweep import sweep
from jld_views import figures


def map_(
    scene: options.SceneFile,
    over: Annotated[
        list[str], typer.Option("--over", help="KEY=FROM:TO:N; up to 1e6 points in all; may be given again.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for map.csv, borders.csv and map.png.")],
    explore: Annotated[bool, typer.Option("--explore", help="Search the strongest layout at each point.")] = False,
    fields: Annotated[bool, typer.Option("--fields", help="Also bound λ by fields at each point.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="Time for each search or bounds by fields, s.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads or processes; default: one per core.")] = None,
    as_json: options.AsJson = False,
) -> None:
    """Map λ and the kind of mechanism over values of a scene.

    --over materials.inner.shear_strength=0:2e5:60 takes 60 values. FROM and TO may have units, as in "0 kPa:9 kPa:60".
    Entries of lists are named as in loads.live[0].force[1]; loads.angle turns all live loads (degrees).
    """
    files.require_folder(out)
    start = time.perf_counter()
    given = load_scene(scene)
    grid = dict(_axis(text) for text in over)
    if (count := math.prod(map(len, grid.values()))) > MOST:
        raise ParameterError("over", f"it asks for {count} points", f"at most {MOST}")
    if len(grid) < len(over):
        raise ParameterError("over", "a key is given twice", "each key once")
    with error_context(scene):
        points = Grid(given, grid)
        jobs = jobs or os.cpu_count() or 1
        table = sweep(given, points.axes, explore=explore, jobs=jobs, fields=fields, seconds=seconds)
        took = time.perf_counter() - start
        edges = None if explore or len(grid) > 2 or given.cracks != "faces" else borders(given, points.axes, table)
        assembly = build_assembly(given) if explore else points.assembly(points.middle)
    out.mkdir(parents=True, exist_ok=True)
    files.write_text(out / "map.csv", csv_of(table))
    if edges is not None:
        files.write_text(out / "borders.csv", csv_of(edges))
    figures.save_figure(figure_of_map(table, points.axes, assembly, edges), out / "map.png")
    layouts = figure_of_layouts(table, assembly) if explore else None
    if layouts is not None:
        figures.save_figure(layouts, out / "layouts.png")
    told = _told(table, took)
    streams.say(
        json.dumps(told, indent=1) if as_json else "\n".join(f"{key:<12} {value}" for key, value in told.items())
    )


def _axis(text: str) -> tuple[str, list[Any]]:
    """Return a key and its values of an option KEY=FROM:TO:N."""
    key, _, rest = text.partition("=")
    parts = rest.split(":")
    problem = ParameterError("over", f"{text!r} is no range of values", "KEY=FROM:TO:N, such as loads.angle=0:90:10")
    if not key or len(parts) != 3 or not parts[2].strip().isdigit() or int(parts[2]) < 1:
        raise problem
    ends, names = [], []
    for part in parts[:2]:
        number = part.strip().split(" ")[0].rstrip("°abcdfghijklmnopqrstuvwxyzABCDFGHIJKLMNOPQRSTUVWXYZ/³²·%")
        try:
            ends.append(float(number))
        except ValueError:
            raise problem from None
        names.append(part.strip()[len(number) :].strip())
    named = [one for one in names if one]
    if not all(map(math.isfinite, ends)) or len(set(named)) > 1 or (len(named) == 1 and ends[names.index("")] != 0.0):
        raise problem
    count = int(parts[2])
    if count > MOST:
        raise ParameterError("over", f"it asks for {count} points", f"at most {MOST}")
    values = np.linspace(ends[0], ends[1], count).tolist()
    return key.strip(), [f"{value!r} {named[0]}" for value in values] if named else values


def _told(table: Any, took: float) -> dict[str, Any]:
    """Return the facts of a map."""
    value = table["load_factor"].to_numpy(dtype=float)
    known = value[np.isfinite(value)]
    kinds = table["labelling" if "labelling" in table else "mechanism"].value_counts()
    return {
        "points": len(table),
        "load_factor": [float(known.min()), float(known.max())] if len(known) else None,
        "proven": int(table["proven"].sum()),
        "regions": {str(name or "none"): int(count) for name, count in kinds.items()},
        "seconds": took,
    }
