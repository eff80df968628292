"""Cut a solid: search, truth on convex cells, order of assembly, parts and their files."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely

from jld_core import Deadline, DeadlinePassed, Floats, InputError, Ints, Layout, ParameterError, files, plugins
from jld_cut.cells import Limits
from jld_cut.families import FAMILIES
from jld_cut.loads import parse_load, parse_region
from jld_cut.meshes import read_solid
from jld_cut.parts import Part, lay, parts_of, write_parts
from jld_cut.picture import figure_of_order, figure_of_parts
from jld_cut.scene import Matter, Setting
from jld_cut.search import Family, Truth, Wish, anneal, candidates, cut_ways, prove
from jld_explore import Exploration
from jld_explore.report import csv_of
from jld_explore.space import from_string
from jld_formats import export
from jld_views import page_of_study

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}


@dataclass(frozen=True)
class Options:
    """What parts must fit and carry, and how they are made.

    Attributes
    ----------
    fit : (3,) tuple of float
        Sides of the box that each part must fit in, in the unit of the file.
    loads : tuple of str
        Loads as "FX,FY,FZ", "FX,FY,FZ@x0,y0,z0,x1,y1,z1" or "body:X,Y,Z", N.
    mass : float or None
        Largest mass of a part, kg.
    parts : int or None
        Largest number of parts.
    require : float
        Load factor that the parts must carry.
    support : tuple of str
        Boxes x0,y0,z0,x1,y1,z1 whose faces are held; none for what lies on the ground.
    matter : Matter
        Density and strengths.
    clearance : float
        Gap of joints, in the unit of the file.
    families : tuple of str
        Ways to cut that are tried.
    cells : int
        Cells that a way to cut aims at.
    unit : str
        Unit of the file: mm, cm, m, in or ft.
    seconds : float
        Time for all.
    seed : int
        Seed of random choices.
    """

    fit: tuple[float, float, float]
    loads: tuple[str, ...]
    mass: float | None = None
    parts: int | None = None
    require: float = 1.0
    support: tuple[str, ...] = ()
    matter: Matter = field(default_factory=Matter)
    clearance: float = 0.0
    families: tuple[str, ...] = tuple(FAMILIES)
    cells: int = 24
    unit: str = "m"
    seconds: float = 60.0
    seed: int = 0

    def wish(self) -> Wish:
        """Return what the search is asked for, in m and kg; ParameterError for what cannot be used."""
        if self.unit not in UNITS:
            raise ParameterError("unit", f"{self.unit!r} is no unit", ", ".join(UNITS))
        scale = UNITS[self.unit]
        positive = {
            "require": self.require,
            "seconds": self.seconds,
            "mass": self.mass,
            "parts": self.parts,
            "cells": self.cells,
        }
        for name, value in [*positive.items(), *(("fit", side) for side in self.fit)]:
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ParameterError(name, f"{value:g} is too small", "a number above 0")
        if not 0.0 <= self.clearance < min(self.fit):
            raise ParameterError("clearance", f"{self.clearance:g} is no gap of joints", "a small part of a side")
        if not self.loads:
            raise ParameterError("load", "no load is given", 'a force such as "0,0,-1000", N, or body:X,Y,Z')
        unknown = [name for name in self.families if name not in FAMILIES]
        if unknown or not self.families:
            raise ParameterError("families", f"{', '.join(unknown) or 'none'} is no way to cut", ", ".join(FAMILIES))
        loads = [parse_load(text, scale) for text in self.loads]
        patches = [parse_region("support", text, scale) for text in self.support]
        volume = np.inf if self.mass is None else self.mass / self.matter.density
        limits = Limits(scale * np.sort(np.array(self.fit, dtype=float)), volume, self.cells)
        setting = Setting(self.matter, loads, patches)
        return Wish(setting, limits, self.mass, self.require, self.parts, self.families, self.seconds, self.seed)


@dataclass
class Chosen:
    """Layout that is written: its parts, order and brackets."""

    family: Family
    fine: Truth
    run: Exploration
    coarse: float
    bracket: tuple[float | None, float | None]  # on convex cells
    uncut: tuple[float | None, float | None]
    block: Ints
    layout: Layout
    laying: Any
    parts: list[Part]
    too_large: list[int]  # parts that do not fit the box

    @property
    def can_be_laid(self) -> bool | None:
        """Whether an order by translations exists; None where time ended before."""
        return None if self.laying is None else not self.laying.locked


def cut(
    path: str | Path, options: Options, out: str | Path, announce: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Cut a solid of a file to numbered parts, and write them with tables and pictures into a folder.

    Parameters
    ----------
    path : str or Path
        STL, OBJ or 3MF file of one closed solid.
    options : Options
        What parts must fit and carry.
    out : str or Path
        New or empty folder.
    announce : callable, optional
        Called with a line on what was done.

    Returns
    -------
    dict
        The content of summary.json.

    Raises
    ------
    InputError
        For a solid, options or a folder that cannot be used.
    """
    start, out, path = time.perf_counter(), Path(out), Path(path)
    say = announce or (lambda _: None)
    wish = options.wish()
    scale = UNITS[options.unit]
    files.require_folder(out)
    if out.exists() and any(out.iterdir()):
        raise InputError(str(out), "the folder is not empty", "a new one")
    solid = read_solid(path, scale if path.suffix.lower() != ".3mf" else 1.0)
    _refuse_thin(solid, scale * options.clearance)
    out.mkdir(parents=True, exist_ok=True)

    def left(share: float) -> float:
        """Return a share of the time that is left, s."""
        return share * (options.seconds - (time.perf_counter() - start))

    families = cut_ways(solid, path.stem, wish, say)
    anneal(families, out, wish, left(0.45), say)

    def write(proved: bool) -> dict[str, Any]:
        """Write the best so far; a run that is stopped later leaves it."""
        end = time.perf_counter() + left(0.4)
        chosen = _choose(families, wish, scale * options.clearance, end, say)
        summary = _summary(chosen, families, solid, options)
        _write(chosen, summary, out, scale)
        if proved:
            summary["by_fields"] = _by_fields(chosen, out, left(0.8))
            _draw(chosen, summary, out, left(0.8))
        summary["seconds"] = time.perf_counter() - start
        files.write_text(out / "summary.json", json.dumps(summary, indent=1) + "\n")
        return summary

    say(write(False)["verdict"])
    prove(families, out, wish, left(0.6), say)
    summary = write(True)
    say(summary["verdict"])
    return summary


def _refuse_thin(solid: Any, clearance: float) -> None:
    """Raise InputError for a solid that a gap of joints leaves nothing of."""
    if clearance:
        left = min((solid ^ solid.translate(tuple(clearance * axis))).volume() for axis in np.eye(3)) / solid.volume()
        if left < 0.5:
            raise InputError("clearance", f"the solid is too thin for gaps of {clearance:g} m", "a smaller gap")


def _choose(families: list[Family], wish: Wish, clearance: float, end: float, say: Callable[[str], None]) -> Chosen:
    """Return the strongest layout on convex cells among the best that fit and can be laid."""
    judged: list[tuple[tuple[Any, ...], Any]] = []
    uncut: tuple[float | None, float | None] = (None, None)
    for family in families[:2]:
        best = candidates(family)
        if not best or (family.key[:2] > families[0].key[:2]):
            continue
        family.truth = family.truth or Truth(family, wish.setting)
        truth: Truth = family.truth
        uncut = truth.solve(np.zeros(len(family.cutting.cells), dtype=np.int64)) if uncut == (None, None) else uncut
        count = 0
        for run, labelling, coarse in best:
            if judged and time.perf_counter() > end:
                break
            layout = Layout(run.scene, run.assembly, from_string(labelling))
            block = layout.block_of[: len(family.cutting.cells)]
            bracket = truth.solve(block)
            low = np.inf if bracket[1] is None and bracket[0] is not None else bracket[0] or -np.inf
            judged.append(((low, coarse), (family, truth, run, labelling, coarse, bracket, block)))
            count += 1
        say(f"{family.name:<8} {truth.cells} cells whose inner faces may crack, {count} of {len(best)} layouts")
    judged.sort(key=lambda one: one[0], reverse=True)
    made = None
    for _, (family, truth, run, labelling, coarse, bracket, block) in judged:
        layout = Layout(run.scene, run.assembly, from_string(labelling))
        laying = _order(layout, max(3.0, end - time.perf_counter()))
        parts = parts_of(family.cutting.cells, block, family.joints, wish.setting.matter.density, clearance)
        large = [part.number for part in parts if not lay(part, wish.limits.fit)]
        tried = Chosen(family, truth, run, coarse, bracket, uncut, block, layout, laying, parts, large)
        if not large and tried.can_be_laid is not False:
            return tried
        made = made or tried
    assert made is not None
    return made


def _order(layout: Layout, seconds: float) -> Any:
    """Return an order of laying by translations; None where it takes too long."""
    try:
        with Deadline(seconds).enforced():
            return plugins.part("assembly_order")(layout.assembly, layout.labels)
    except DeadlinePassed:
        return None


def _summary(chosen: Chosen, families: list[Family], solid: Any, options: Options) -> dict[str, Any]:
    """Return the facts of a cut solid."""
    exact = [one for one in chosen.family.found if one.summary.driver == "exact"]
    last = exact[-1].summary if exact else None
    low, high = chosen.bracket
    coarse = chosen.coarse if np.isfinite(chosen.coarse) else None
    # the bound of the exact search holds for all layouts of so many parts on these cells
    proven = bool(last and last.proven and (last.best is None or coarse is None or coarse >= last.best * (1 - 1e-4)))
    volumes = [cell.volume() for cell in chosen.family.cutting.cells]
    box = np.array([part.box for part in chosen.parts])
    summary: dict[str, Any] = {
        "parts": len(chosen.parts),
        "load_factor": low,
        "bracket": [low, high],
        "locked": low is not None and high is None,
        "load_factor_of_cells": coarse,
        "proven": proven,
        "bound": None if last is None else last.bound,
        "uncut": list(chosen.uncut),
        "require": options.require,
        "meets": low is not None and low >= options.require * (1 - 1e-6),
        "fits": not chosen.too_large,
        "too_large": chosen.too_large,
        "coarse_truth": chosen.fine.coarse,
        "faulty_files": [],
        "can_be_laid": chosen.can_be_laid,
        "locked_parts": [int(b) for b in chosen.laying.locked] if chosen.can_be_laid is False else [],
        "family": chosen.family.name,
        "families": {
            one.name: {
                "cells": len(one.cutting.cells),
                "joints": len(one.joints),
                "parts": None if not len(one.rows()) else int(one.rows().iloc[0]["blocks"]),
                "load_factor": _best(one),
                "evaluated": sum(run.summary.evaluated for run in one.found),
                "proven": any(run.summary.proven for run in one.found if run.summary.driver == "exact"),
                "bound": next((r.summary.bound for r in reversed(one.found) if r.summary.driver == "exact"), None),
                "problem": one.error or None,
            }
            for one in families
        },
        "front": [
            {"parts": int(row["blocks"]), "load_factor": float(row["load_factor"])}
            for _, row in chosen.family.found[0].front.iterrows()
            if np.isfinite(row["load_factor"])
        ],
        "volume": solid.volume(),
        "volume_error": abs(sum(volumes) - solid.volume()) / solid.volume(),
        "largest_box": (box.max(axis=0) / UNITS[options.unit]).tolist(),
        "largest_mass": max(part.mass for part in chosen.parts),
    }
    summary["verdict"] = verdict(summary)
    return summary


def _best(family: Family) -> float | None:
    rows = family.rows()
    return None if not len(rows) or not np.isfinite(rows.iloc[0]["strength"]) else float(rows.iloc[0]["strength"])


def verdict(summary: dict[str, Any]) -> str:
    """Return one sentence on what parts carry."""
    many = f"{summary['parts']} parts" if summary["parts"] > 1 else "1 part"
    low = summary["bracket"][0]
    if summary["locked"]:
        carry = "carry any multiple of your load by dry joints and inner strength (only crushing would limit it)"
    elif low is None:
        carry = "have no proven load factor"
    else:
        carry = f"carry at least {low:.3g} times your load"
    start, end = summary["uncut"]
    whole = "any multiple" if start is not None and end is None else "unknown" if start is None else f"{start:.3g}"
    told = f"{many} {carry}; uncut {whole}"
    if low is not None and not summary["meets"]:
        told += f"; {summary['require']:g} was asked"
    if summary["too_large"]:
        told += "; parts that do not fit the box: " + ", ".join(str(k) for k in summary["too_large"])
    if summary["coarse_truth"]:
        told += "; this is λ of the cells of the search, since no finer scene was valid: inner cracks are few"
    if summary["faulty_files"]:
        told += "; not watertight: " + ", ".join(summary["faulty_files"])
    if summary["can_be_laid"] is None:
        told += "; time ended before an order of assembly was found"
    if summary["can_be_laid"] is False:
        told += "; parts " + ", ".join(str(k) for k in summary["locked_parts"]) + " lock one another"
    return "; ".join([told, *summary.get("warnings", ())]) + "."


def _write(chosen: Chosen, summary: dict[str, Any], out: Path, scale: float) -> None:
    """Write parts, table, order and pictures."""
    names = [int(chosen.block[part.cells[0]]) for part in chosen.parts]
    place = {name: k for k, name in enumerate(names)}
    for number, step in enumerate(chosen.laying.steps if chosen.laying else (), 1):
        for block in step.blocks:
            elements = np.asarray(chosen.laying.blocks.elements(block))
            elements = elements[elements < len(chosen.block)]
            if len(elements):
                part = chosen.parts[place[int(chosen.block[elements[0]])]]
                part.step, part.direction = number, -np.asarray(step.direction, dtype=float)
    write_parts(out, chosen.parts, scale)
    summary["watertight"] = all(part.watertight for part in chosen.parts)
    summary["faulty_files"] = [part.fault for part in chosen.parts if not part.watertight]
    summary["verdict"] = verdict(summary)
    summary["file_error"] = max(part.error for part in chosen.parts)
    files.write_text(out / "parts.csv", csv_of(table_of(chosen.parts, scale)))
    try:
        export(chosen.layout, "step", out / "parts.step")
    except (InputError, shapely.errors.GEOSException) as error:
        summary["warnings"] = [f"parts.step was not written: {error}"]
    summary["verdict"] = verdict(summary)
    files.write_text(out / "scene.json", json.dumps(chosen.fine.scene(chosen.block)) + "\n")


def _draw(chosen: Chosen, summary: dict[str, Any], out: Path, seconds: float) -> None:
    """Write the pictures, and the page, whose slider pulls the parts apart."""
    figure_of_parts(chosen.parts, summary["verdict"], out / "parts.png")
    if chosen.can_be_laid:
        figure_of_order(chosen.parts, out / "order.png")
    page_of_study.write_report(chosen.run, out, patience=max(1.0, seconds - 3.0))


def _by_fields(chosen: Chosen, out: Path, seconds: float) -> list[float | None] | None:
    """Return the bracket of λ by fields from a process that the clock ends; None where it did not finish."""
    if not chosen.fine.convex or seconds < 5.0:
        return None
    order = [sys.executable, "-m", "jld_explore", "solve", str(out / "scene.json"), "--cracks", "fields:0.1", "--json"]
    try:
        done = subprocess.run(order, capture_output=True, timeout=seconds, check=False)
        found = json.loads(done.stdout)["bracket"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        return None
    return [None if end is None else float(end) for end in found]


def table_of(parts: list[Part], scale: float) -> pd.DataFrame:
    """Return the cutting list: one row a part, lengths in the unit of the file."""
    rows = []
    for part in parts:
        low = np.array(part.exact.bounding_box())[:3] / scale
        row: dict[str, Any] = {"part": part.number, "file": f"parts/{part.name}.stl", "mass": part.mass}
        row |= {"volume": part.exact.volume() / scale**3, "volume_with_clearance": part.solid.volume() / scale**3}
        row |= {f"size_{k}": float(side) / scale for k, side in zip("xyz", part.box[::-1], strict=True)}
        row |= {f"at_{k}": float(value) for k, value in zip("xyz", low, strict=True)}
        row |= {"watertight": part.watertight, "step": part.step or None}
        row |= {f"comes_{k}": float(value) + 0.0 for k, value in zip("xyz", part.direction, strict=True)}
        row |= {"bed": " ".join(f"{value:.9g}" for value in _flat(part.bed)), "cells": len(part.cells)}
        rows.append(row)
    return pd.DataFrame(rows)


def _flat(matrix: Floats) -> list[float]:
    return [float(value) + 0.0 for value in matrix.ravel()]
