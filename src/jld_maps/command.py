"""Provide `jld map`: λ over values of a scene, as a table and a picture."""

from __future__ import annotations

import json
import math
import os
import time
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import pandas as pd
import typer
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jld_core import Assembly, Floats, ParameterError, build_assembly, error_context, files, load_scene
from jld_core.scene import units
from jld_explore.cli import options, streams
from jld_explore.report import csv_of
from jld_explore.space import from_string
from jld_maps.grid import ANGLE, MOST, Grid, borders, sweep
from jld_views import figures, look

_HATCHES: Final = ("", "//", "..", "\\\\", "xx", "--", "oo", "++")
_MOST: Final = len(_HATCHES)  # regions with a name of their own
_OTHER: Final = "other"
_POWERS: Final = {(1, 0): "{f}", (0, 1): "{l}", (1, 1): "{f}·{l}", (1, -1): "{f}/{l}", (1, -2): "{f}/{l}²"}


def label_of(key: str, names: tuple[str, str]) -> str:
    last = key.split(".")[-1].split("[")[0]
    if key == ANGLE or last.endswith("friction_angle"):
        return f"{key} [°]"
    unit = _POWERS.get(units.QUANTITIES.get(last, (0, 0)))
    return f"{key} [{unit.format(l=names[0], f=names[1])}]" if unit else key


def figure_of_map(
    table: pd.DataFrame, axes: Mapping[str, list[Any]], assembly: Assembly, borders: pd.DataFrame | None = None
) -> Figure:
    """Draw a map over its first two keys of several values, or the only one, at the middle of the others."""
    keys = [key for key in axes if len(axes[key]) > 1][:2] or list(axes)[:1]
    fixed = {key: values[(len(values) - 1) // 2] for key, values in axes.items() if key not in keys}
    rows = table
    for key, value in fixed.items():
        rows = rows[rows[key] == value]
    layouts = "labelling" in table
    figure = Figure(figsize=((7.5 if len(keys) == 1 else 11.0), 5.2), dpi=110)
    FigureCanvasAgg(figure)
    if len(keys) == 1:
        _curve(figure.add_axes((0.1, 0.26, 0.86, 0.64)), rows, keys[0], assembly)
    else:
        left, right = figure.add_axes((0.07, 0.26, 0.36, 0.64)), figure.add_axes((0.57, 0.26, 0.36, 0.64))
        grid = [np.array(axes[key], dtype=float) for key in keys]
        _contours(figure, left, grid, rows["load_factor"].to_numpy(dtype=float))
        _regions(right, grid, _kinds(rows), "strongest layout" if layouts else "mechanism")
        if borders is not None and len(borders):
            right.plot(borders[keys[0]].astype(float), borders[keys[1]].astype(float), ".", color=look.INK, ms=2)
        for ax in (left, right):
            ax.set_xlabel(label_of(keys[0], assembly.units), fontsize=9)
            ax.set_ylabel(label_of(keys[1], assembly.units), fontsize=8 if len(keys[1]) < 30 else 7)
            ax.locator_params(axis="x", nbins=6)
            ax.tick_params(labelsize=8)
    fixed_words = [f"{key} = {value}" for key, value in fixed.items()]
    figure.suptitle(", ".join([f"{assembly.name}: {len(table)} points", *fixed_words]), fontsize=11)
    return figure


def _layouts(rows: pd.DataFrame) -> pd.Series:
    """Name the strongest layouts A, B, … by how often they are the strongest."""
    order = rows["labelling"].value_counts().index
    names = {letters: f"layout {chr(65 + k) if k < 26 else k + 1}" for k, letters in enumerate(order)}
    return rows["labelling"].map(names).fillna("none")


def _kinds(rows: pd.DataFrame) -> Any:
    """Return what regions show (k,): the strongest layouts, or mechanisms, or the status where there is none."""
    if "labelling" in rows:
        return _layouts(rows).to_numpy(dtype=object)
    return np.where(rows["mechanism"] == "", rows["status"], rows["mechanism"])


def _curve(ax: Axes, rows: pd.DataFrame, key: str, assembly: Assembly) -> None:
    """Draw λ over one key, on the ranges of mechanisms."""
    x, y = (rows[name].to_numpy(dtype=float) for name in (key, "load_factor"))
    kind = _layouts(rows) if "labelling" in rows else rows["mechanism"].where(rows["mechanism"] != "", rows["status"])
    names = _few(kind.to_numpy(dtype=object))
    middle = 0.5 * (x[1:] + x[:-1])
    ends = np.concatenate([x[:1], middle, x[-1:]])
    for k, name in enumerate(dict.fromkeys(names)):
        for j in np.flatnonzero(names == name):
            ax.axvspan(
                ends[j], ends[j + 1], fc=look.TINTS[k % len(look.TINTS)], hatch=_HATCHES[k % _MOST], ec="#FFFFFF", lw=0
            )
    (line,) = ax.plot(x, y, color=look.INK, lw=1.6, label="λ by faces")
    handles: list[Any] = [line]
    if "fields_lo" in rows:
        low, high = (rows[name].to_numpy(dtype=float) for name in ("fields_lo", "fields_hi"))
        handles.append(ax.fill_between(x, low, high, color=look.PRESS, alpha=0.4, lw=0, label="λ by fields"))
    ax.set_xlabel(label_of(key, assembly.units), fontsize=9)
    ax.set_ylabel("load factor λ", fontsize=9)
    _legend(ax, list(dict.fromkeys(names)), handles)


def _contours(figure: Figure, ax: Axes, grid: list[Floats], values: Floats) -> None:
    field = np.ma.masked_invalid(values.reshape(len(grid[0]), len(grid[1])).T)
    if field.count() and np.ptp(field.compressed()) > 0.0:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a level may lie outside
            contours = ax.contourf(*grid, field, levels=12, cmap="viridis")
            lines = ax.contour(*grid, field, levels=contours.levels, colors="#FFFFFF", linewidths=0.6)
        ax.clabel(lines, fontsize=7)
        bar = figure.colorbar(contours, cax=figure.add_axes((0.44, 0.26, 0.012, 0.64)))
        bar.ax.tick_params(labelsize=7)
    ax.set_title("load factor λ", fontsize=10)


def _few(kinds: Any) -> Any:
    """Return kinds with the rarest beyond `_MOST` as one."""
    names, counts = np.unique(kinds.astype(str), return_counts=True)
    frequent = names[np.argsort(-counts, kind="stable")][: _MOST if len(names) <= _MOST else _MOST - 1]
    return np.where(np.isin(kinds.astype(str), frequent), kinds, _OTHER)


def _regions(ax: Axes, grid: list[Floats], kinds: Any, title: str) -> None:
    """Draw regions of equal kinds, each with its name where it is widest."""
    field = _few(kinds).reshape(len(grid[0]), len(grid[1])).T
    names = list(dict.fromkeys(field.ravel().tolist()))
    names.sort(key=lambda name: -int((field == name).sum()))
    number = np.vectorize(names.index)(field)
    edges = [np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]) for x in grid]
    colours = ListedColormap([look.TINTS[k % len(look.TINTS)] for k in range(len(names))])
    ax.pcolormesh(*edges, number, cmap=colours, vmin=-0.5, vmax=len(names) - 0.5, rasterized=True)
    for k, name in enumerate(names):
        mask = field == name
        if _HATCHES[k] and min(mask.shape) > 1:
            hatched = ax.contourf(*grid, mask.astype(float), levels=[0.5, 1.5], colors="none", hatches=[_HATCHES[k]])
            hatched.set_edgecolor("#A9A9A9")
            hatched.set_linewidth(0.0)
        row, column, wide = _widest(mask)
        if mask.sum() >= 0.04 * mask.size and wide > 0.03 * len(name) * mask.shape[1] / 2:
            box = {"fc": "#FFFFFF", "ec": "none", "alpha": 0.85, "pad": 1.5}
            ax.text(grid[0][column], grid[1][row], name, ha="center", va="center", fontsize=8, bbox=box)
    ax.set_title(title, fontsize=10)
    _legend(ax, names)


def _widest(mask: Any) -> tuple[int, int, int]:
    """Return the middle and length of the longest run of a mask (rows, columns) in the row nearest to its middle."""
    rows, columns = np.nonzero(mask)
    row = int(rows[np.argmin(abs(rows - np.median(rows)))])
    of_row = columns[rows == row]
    runs = np.split(of_row, np.flatnonzero(np.diff(of_row) > 1) + 1)
    longest = max(runs, key=len)
    return row, int(longest[len(longest) // 2]), len(longest)


def _legend(ax: Axes, names: list[str], drawn: Sequence[Any] = ()) -> None:
    handles: list[Any] = [
        Patch(fc=look.TINTS[k % len(look.TINTS)], hatch=_HATCHES[k % _MOST], ec="#A9A9A9", lw=0.4, label=name)
        for k, name in enumerate(names)
    ]
    ax.legend(
        handles=[*drawn, *handles], loc="upper right", bbox_to_anchor=(1.0, -0.13), ncols=2, fontsize=8, frameon=False
    )


def figure_of_layouts(table: pd.DataFrame, assembly: Assembly) -> Figure | None:
    """Draw the layouts that are the strongest somewhere, most often first, at most six."""
    names = _layouts(table)
    texts = table["labelling"].dropna().value_counts().index[:6]
    if not len(texts):
        return None
    figure, axes = figures.figure_for(assembly, len(texts), 3)
    for ax, text in zip(axes, texts, strict=True):
        figures.draw_assembly(ax, assembly, from_string(text), plain=True)
        of_layout = names[table["labelling"] == text]
        ax.set_title(f"{of_layout.iloc[0]}: strongest at {len(of_layout)} of {len(table)}", fontsize=9)
    figures.finish(figure, axes, "strongest layouts", 3)
    return figure


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
    parsed = load_scene(scene)
    grid = dict(_axis(text) for text in over)
    if (count := math.prod(map(len, grid.values()))) > MOST:
        raise ParameterError("over", f"it asks for {count} points", f"at most {MOST}")
    if len(grid) < len(over):
        raise ParameterError("over", "a key is given twice", "each key once")
    with error_context(scene):
        points = Grid(parsed, grid)
        jobs = jobs or os.cpu_count() or 1
        table = sweep(parsed, points.axes, explore=explore, jobs=jobs, fields=fields, seconds=seconds)
        took = time.perf_counter() - start
        edges = None if explore or len(grid) > 2 or parsed.cracks != "faces" else borders(parsed, points.axes, table)
        assembly = build_assembly(parsed) if explore else points.assembly(points.middle)
    out.mkdir(parents=True, exist_ok=True)
    files.write_text(out / "map.csv", csv_of(table))
    if edges is not None:
        files.write_text(out / "borders.csv", csv_of(edges))
    figures.save_figure(figure_of_map(table, points.axes, assembly, edges), out / "map.png")
    layouts = figure_of_layouts(table, assembly) if explore else None
    if layouts is not None:
        figures.save_figure(layouts, out / "layouts.png")
    facts = _told(table, took)
    streams.say(
        json.dumps(facts, indent=1) if as_json else "\n".join(f"{key:<12} {value}" for key, value in facts.items())
    )


def _axis(text: str) -> tuple[str, list[Any]]:
    """Return a key and its values of an option KEY=FROM:TO:N."""
    key, _, text_of_values = text.partition("=")
    parts = text_of_values.split(":")
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
    words = [name for name in names if name]
    if not all(map(math.isfinite, ends)) or len(set(words)) > 1 or (len(words) == 1 and ends[names.index("")] != 0.0):
        raise problem
    count = int(parts[2])
    if count > MOST:
        raise ParameterError("over", f"it asks for {count} points", f"at most {MOST}")
    values = np.linspace(ends[0], ends[1], count).tolist()
    return key.strip(), [f"{value!r} {words[0]}" for value in values] if words else values


def _told(table: Any, took: float) -> dict[str, Any]:
    value = table["load_factor"].to_numpy(dtype=float)
    finite = value[np.isfinite(value)]
    kinds = table["labelling" if "labelling" in table else "mechanism"].value_counts()
    return {
        "points": len(table),
        "load_factor": [float(finite.min()), float(finite.max())] if len(finite) else None,
        "proven": int(table["proven"].sum()),
        "regions": {str(name or "none"): int(count) for name, count in kinds.items()},
        "seconds": took,
    }
