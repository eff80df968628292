"""Cut a solid: search, λ on convex cells, order of assembly, parts and their files."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core import Floats, InputError, Ints, ParameterError, files
from jld_cut.cells import Limits
from jld_cut.clock import CHOSEN, DRAWN, FILED, KEYED, Clock
from jld_cut.families import FAMILIES
from jld_cut.fields import Ends, bounds_beside
from jld_cut.keys import Key, Keyed, are_sound, keyed
from jld_cut.meshes import UNITS, manifold3d, read_solid, unit_of
from jld_cut.partitions import BEST, Layouts, frames
from jld_cut.parts import Part, different, lay, mark, parts_of, plain_surface, tenons, write_parts
from jld_cut.picture import figure_of_order, figure_of_parts, steps_of, write_page, write_pages
from jld_cut.scene import Matter, Setting, parse_load, parse_region
from jld_cut.search import Bracket, Family, FineModel, Wish, explore_best, finite, low_of, search_all, weaker
from jld_explore.report import csv_of
from jld_formats import step_of_solids
from jld_views import figures, page_of_study

_FIELDS: Final = 3.0  # time from which bounds by fields have a chance, s
_LAYING: Final = 3.0  # least time for an order of assembly, s
_UNKNOWN, _LAID = 1, 2  # ranks of layouts that fit: time ended before an order of assembly was known, and with one
_USUAL: Final = (0.02, 20.0)  # lengths of solids that pass without a word, m
_FAR: Final = 100.0  # distance from the origin by the size of a solid from which files of parts are moved
_NAMED: Final = 3  # keys that the verdict names
_DRAWING: Final = 7.0  # time that pictures and pages need after them, s
_PAGE: Final = 4.0  # time from which the page of the search is made, s


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
    unit : str or None
        Unit of lengths: mm, cm, m, in or ft; None: that of a 3MF file, else m.
    seconds : float
        Time for all.
    alike : int or None
        Most different shapes of parts; a part and its mirror image are alike.
    keep_whole : tuple of str
        Boxes x0,y0,z0,x1,y1,z1 that no joint meets.
    tenons : bool
        Put a tenon on each joint that a part is laid straight onto, where one fits.
    marks : bool
        Engrave number and arrow.
    keys : bool
        Put tongues, steps or keys in joints on which parts slide where these raise λ.
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
    unit: str | None = None
    seconds: float = 60.0
    alike: int | None = None
    keep_whole: tuple[str, ...] = ()
    tenons: bool = False
    marks: bool = False
    keys: bool = True

    @property
    def scale(self) -> float:
        """Length of the unit, m."""
        if self.unit is not None and self.unit not in UNITS:
            raise ParameterError("unit", f"{self.unit!r} is no unit", ", ".join(UNITS))
        return UNITS[self.unit or "m"]

    def wish(self) -> Wish:
        """Return what the search is asked for, in m and kg; ParameterError for what cannot be used."""
        scale = self.scale
        positive = {
            "require": self.require,
            "seconds": self.seconds,
            "mass": self.mass,
            "parts": self.parts,
            "alike": self.alike,
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
            raise ParameterError("family", f"{', '.join(unknown) or 'none'} is no way to cut", ", ".join(FAMILIES))
        loads = [parse_load(text, scale) for text in self.loads]
        patches = [parse_region("support", text, scale) for text in self.support]
        regions = tuple(parse_region("keep_whole", text, scale) for text in self.keep_whole)
        volume = np.inf if self.mass is None else self.mass / self.matter.density
        limits = Limits(scale * np.sort(np.array(self.fit, dtype=float)), volume, self.cells)
        setting = Setting(self.matter, loads, patches)
        return Wish(
            setting, limits, self.mass, self.require, self.parts, self.families, self.seconds, regions, self.alike
        )


@dataclass
class Chosen:
    """Layout that is written: its parts, order and brackets."""

    family: Family
    fine: FineModel
    coarse: float  # λ on the cells of the family
    bracket: Bracket  # on convex cells
    uncut: Bracket  # the same of the solid in one part
    block: Ints  # (n,) part of each cell
    laying: Any  # order by translations, False where there is none, None where time ended before
    locking: list[int]  # cells of parts that lock one another
    parts: list[Part]
    too_large: list[int]  # parts that do not fit the box
    keys: tuple[Key, ...] = ()
    plain: Chosen | None = None  # the same with plane joints, where there are keys

    @property
    def low(self) -> float:
        """Lower end of the bracket, infinite where no load makes it collapse."""
        return low_of(self.bracket)

    @property
    def rank(self) -> int:
        # whether parts fit and go together
        return 0 if self.too_large or self.laying is False else _UNKNOWN if self.laying is None else _LAID

    @property
    def can_be_laid(self) -> bool | None:
        """Whether an order by translations exists; None where time ended before."""
        return None if self.laying is None else self.laying is not False


def cut(
    path: str | Path,
    options: Options,
    out: str | Path,
    announce: Callable[[str], None] | None = None,
    warn: Callable[[str], None] | None = None,
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
    warn : callable, optional
        Called with each warning, which the summary holds as well.

    Returns
    -------
    dict
        The content of summary.json.

    Raises
    ------
    InputError
        For a solid, options or a folder that cannot be used.
    """
    clock, out, path = Clock(options.seconds), Path(out), Path(path)
    say = announce or (lambda _: None)
    file_unit, warnings = unit_of(path), list[str]()
    options = replace(options, unit=options.unit or file_unit)
    wish, scale = options.wish(), options.scale
    if file_unit and UNITS[file_unit] != scale:
        warnings = [
            f"the file states {file_unit}, the options are read in {options.unit}: 1 {options.unit} is "
            f"{scale / UNITS[file_unit]:.6g} {file_unit} of it"
        ]
    files.require_folder(out)
    if out.exists() and any(out.iterdir()):
        raise InputError(str(out), "the folder is not empty", "a new one")
    solid = read_solid(path, scale if path.suffix.lower() != ".3mf" else 1.0, scale)
    _refuse_small(solid, wish.limits)
    _refuse_thin(solid, scale * options.clearance)
    _refuse_regions(solid, wish)
    moved = _to_origin(solid, scale)
    warnings += [*_size_warnings(solid, options), *_moved_warnings(moved, options)]
    for line in warnings:
        (warn or say)(line)
    families = search_all(solid, path.stem, wish, clock, say)
    out.mkdir(parents=True, exist_ok=True)
    chosen = _choose(families, wish, scale * options.clearance, clock, say)
    with ExitStack() as stack:
        # what slides may carry many times as much with keys, so bounds of others begin at once, and of these after them
        chosen = _with_keys(chosen, wish, scale, options.clearance, clock) if options.keys else chosen
        bracket = _start_field_bounds(chosen, wish, out, clock, stack)
        if chosen.laying is None:  # the search for others had the time of this one
            laying = chosen.fine.order(chosen.block, max(_LAYING, clock.left(KEYED)))
            locking = chosen.fine.locking(chosen.block, _LAYING) if laying is False else []
            chosen = replace(chosen, laying=laying, locking=locking)
        summary = _summary(chosen, families, solid, options) | {"unit": options.unit or "m", "warnings": warnings}
        _write(chosen, summary, out, options, clock, moved)
        summary["by_fields"], why = bracket(clock.left(DRAWN) - _DRAWING) if bracket else (None, "time ended")
    ends = summary["by_fields"] or [None, None]
    summary["fields_reached"] = [
        name for name, end in zip(("lower bound", "upper bound"), ends, strict=True) if end is not None
    ]
    summary["meets"] = carries(summary)
    summary["verdict"] = verdict(summary)
    say(summary["verdict"])
    if why:
        say(f"λ is by cells; by fields it is not known: {why}")
    elif len(summary["fields_reached"]) == 1:
        say(f"by fields only the {summary['fields_reached'][0]} was reached in time")
    _draw(chosen, summary, out, scale, clock)
    summary["left_out"] = clock.left_out
    if clock.left_out:
        say(f"time left out: {', '.join(clock.left_out)}")
    summary["seconds"] = time.time() - clock.start
    files.write_text(out / "summary.json", json.dumps(summary, indent=1) + "\n")
    return summary


def _start_field_bounds(
    chosen: Chosen, wish: Wish, out: Path, clock: Clock, stack: ExitStack
) -> Callable[[float], tuple[Ends | None, str]] | None:
    """Begin bounds by fields in another process; return a function that waits for them, None without time."""
    # bounds by fields beside all that follows
    seconds, name = clock.left(DRAWN) - _DRAWING, chosen.fine.document["name"]
    if seconds < _FIELDS:
        clock.left_out.append("bounds by fields")
        return None
    bodies = [part.exact for part in chosen.parts]
    return stack.enter_context(bounds_beside(name, chosen.family.cutting, bodies, wish.setting, out, seconds))


def _size_warnings(solid: Any, options: Options) -> list[str]:
    """Return a warning about a solid of a size that is hardly meant, with its mass and a likely unit."""
    box = np.array(solid.bounding_box())
    size, mass = float((box[3:] - box[:3]).max()), options.matter.density * solid.volume()
    if _USUAL[0] <= size <= _USUAL[1]:
        return []
    read = options.unit or "m"
    likely = min(UNITS, key=lambda unit: abs(np.log(size / options.scale * UNITS[unit])))
    suggestion = f"; in {likely} it is {size / options.scale * UNITS[likely]:.3g} m: --unit {likely}"
    text = f"the solid is {size:.4g} m long and weighs {mass:.3g} kg, with lengths in {read}"
    return [text + (suggestion if likely != read else "")]


def _to_origin(solid: Any, scale: float) -> Floats:
    """Return by how much files of parts are moved, m, in whole units: single precision holds few digits far away."""
    box = np.array(solid.bounding_box())
    if np.abs(box).max() <= _FAR * (box[3:] - box[:3]).max():
        return np.zeros(3)
    return -scale * np.floor(box[:3] / scale)


def _moved_warnings(moved: Floats, options: Options) -> list[str]:
    vector = ", ".join(f"{value + 0.0:.12g}" for value in moved / options.scale)
    where = f"STL, OBJ and 3MF files are moved by ({vector}) {options.unit or 'm'}"
    return [f"the solid stands far from the origin: {where}, as they have single precision"] if moved.any() else []


def _refuse_regions(solid: Any, wish: Wish) -> None:
    """Raise ParameterError for a box to be kept whole in which nothing lies, or more than a part may be."""
    for region in wish.whole:
        assert region.box is not None
        low, high = region.box[:3], region.box[3:]
        content = solid ^ manifold3d().Manifold.cube(tuple(high - low)).translate(tuple(low))
        box = ",".join(f"{value:.6g}" for value in region.box)
        if content.volume() <= 0.0:
            raise ParameterError("keep_whole", f"nothing of the solid lies in {box} m", "a box around some of it")
        most = min(wish.limits.volume, float(wish.limits.fit.prod()))
        if content.volume() > most * (1 + 1e-6):
            problem = f"in {box} m lie {content.volume():.4g} m³ of the solid, and a part holds {most:.4g} m³ at most"
            raise ParameterError("keep_whole", problem, "a smaller box, or larger parts")


def _refuse_small(solid: Any, limits: Limits) -> None:
    """Raise InputError for a box, or a mass, that more parts than there may be cells would be needed for."""
    box = np.array(solid.bounding_box())
    needed = {
        "fit": max(solid.volume() / limits.fit.prod(), (box[3:] - box[:3]).max() / np.linalg.norm(limits.fit)),
        "mass": solid.volume() / limits.volume,
    }
    for name, number in needed.items():
        if number > limits.cells:
            problem = (
                f"the solid makes at least {int(np.ceil(number))} such parts, and {limits.cells} cells are the most"
            )
            raise ParameterError(name, problem, "larger parts, or another unit of the file")


def _refuse_thin(solid: Any, clearance: float) -> None:
    """Raise InputError for a solid that a gap of joints leaves nothing of."""
    if clearance:
        share = min((solid ^ solid.translate(tuple(clearance * axis))).volume() for axis in np.eye(3)) / solid.volume()
        if share < 0.5:
            raise ParameterError("clearance", f"the solid is too thin for gaps of {clearance:g} m", "a smaller gap")


def _choose(families: list[Family], wish: Wish, clearance: float, clock: Clock, say: Callable[[str], None]) -> Chosen:
    """Return the strongest layout on convex cells of the fewest parts that carry, fit and can be laid."""
    best: Chosen | None = None
    end = clock.at(CHOSEN)
    numbers = sorted({n for family in families for n, layouts in family.found.of.items() if len(layouts.low)})
    carrying = [n for n in numbers if max(_top(family, n) for family in families) >= wish.require * (1 - 1e-6)]
    for parts in carrying or numbers[-1:]:
        for family, block, coarse, bracket in _best_layouts(families, parts, wish, clock, say):
            if best and time.time() > end and not family.fine.order(block, 0.0):
                continue
            # an order that is not known yet leaves time for those of others
            layout = _make_layout(family, block, coarse, bracket, wish, clearance, (time.time() + end) / 2)
            best = layout if best is None or layout.rank > best.rank else best
            if layout.rank == _LAID:
                break
        if best and best.rank >= _UNKNOWN and best.low >= wish.require * (1 - 1e-6):
            return best
        if time.time() > end:
            break
    assert best is not None
    return best


def _top(family: Family, parts: int) -> float:
    layouts = family.found.of.get(parts)
    return -np.inf if layouts is None or not len(layouts.low) else float(layouts.low[0])


def _best_layouts(
    families: list[Family], parts: int, wish: Wish, clock: Clock, say: Callable[[str], None]
) -> list[tuple[Family, Ints, float, Bracket]]:
    """Return the layouts of one number of parts that are best on the cells, the strongest on convex cells first."""
    judged: list[tuple[float, float, tuple[Family, Ints, float, Bracket]]] = []
    end = clock.at(CHOSEN)
    for family in sorted(families, key=lambda family: -_top(family, parts)):
        if not np.isfinite(_top(family, parts)) and _top(family, parts) < 0:
            continue
        if not family.fine:
            make = partial(FineModel, family, wish.setting)
            title = f"λ of {family.name} on {len(family.cutting.cells)} cells that crack"
            family.fine = clock.run(title, CHOSEN, make) if judged else make()
        if not family.fine or (judged and time.time() > end):
            continue
        layouts, count = family.found.of[parts], 0
        for block, coarse in _to_judge(family, layouts, end):
            if judged and (count and time.time() > end):
                break
            bracket = family.fine.known[block.tobytes()] = weaker(family.fine.solve(block), coarse)
            judged.append((low_of(bracket), coarse, (family, block, coarse, bracket)))
            count += 1
        say(f"{family.name:<8} {family.fine.cells} cells whose inner faces may crack: {count} layouts of {parts} parts")
    judged.sort(key=lambda entry: entry[:2], reverse=True)
    return [entry for _, _, entry in judged]


def _to_judge(family: Family, layouts: Layouts, end: float) -> Iterator[tuple[Ints, float]]:
    """Yield the best layouts: those with an order, those not known to lock, or else the best."""
    ranked, count, later = list(zip(layouts.blocks, layouts.low.tolist(), strict=True)), 0, list[tuple[Ints, float]]()
    half = (time.time() + end) / 2
    for block, coarse in ranked:
        if count == BEST or (count + len(later) and time.time() > half):
            break
        laying = family.fine.order(block, _LAYING)
        if laying:
            count += 1
            yield block, coarse
        elif laying is None:
            later.append((block, coarse))
    yield from later[: BEST - count] or (() if count else ranked[:1])


def _make_layout(
    family: Family,
    block: Ints,
    coarse: float,
    bracket: Bracket,
    wish: Wish,
    clearance: float,
    end: float,
    plain: Chosen | None = None,
) -> Chosen:
    """Return a layout with its parts, their order and its brackets; `plain` is the same without keys."""
    # coarse: λ on the cells of the family. end: time of the clock until which an order is sought, with a least time.
    parts = parts_of(family.cutting.cells, block, family.joints, wish.setting.matter.density, clearance)
    rotations = frames(family.normals)
    large = [part.number for part in parts if not lay(part, wish.limits.fit, rotations)]
    laying = family.fine.order(block, max(_LAYING, end - time.time()))
    locking = family.fine.locking(block, max(_LAYING, end - time.time())) if laying is False else []
    uncut = plain.uncut if plain else family.fine.solve(np.zeros(len(family.cutting.cells), dtype=np.int64))
    return Chosen(
        family=family,
        fine=family.fine,
        coarse=coarse,
        bracket=bracket,
        uncut=uncut,
        block=block,
        laying=laying,
        locking=locking,
        parts=parts,
        too_large=large,
        plain=plain,
    )


def _with_keys(chosen: Chosen, wish: Wish, scale: float, clearance: float, clock: Clock) -> Chosen:
    """Return a layout with keys in the joints on which its parts slide, where these raise λ and the parts are sound."""
    if not np.isfinite(chosen.low) or not chosen.laying:
        return chosen
    layouts: dict[bytes, Chosen] = {}

    def sound(variant: Keyed) -> bool:
        try:
            layout = _make_layout(
                variant.family,
                variant.block,
                chosen.coarse,
                variant.bracket,
                wish,
                scale * clearance,
                clock.at(KEYED),
                chosen,
            )
        except InputError:  # clearance takes too much of a key
            return False
        layouts[variant.block.tobytes()] = layout
        return bool(layout.laying) and not layout.too_large and are_sound(layout.parts, scale)

    best = clock.run(
        "keys", KEYED, lambda: keyed(chosen.family, chosen.block, chosen.low, wish.setting, sound), least=1.0
    )
    if clock.left(KEYED) <= 0.0 and "keys" not in clock.left_out:
        clock.left_out.append("further keys")
    return chosen if best is None else replace(layouts[best.block.tobytes()], keys=best.keys)


def _summary(chosen: Chosen, families: list[Family], solid: Any, options: Options) -> dict[str, Any]:
    """Return the content of summary.json."""
    low, high, locked = chosen.bracket
    result, parts = chosen.family.found, len(chosen.parts)
    volumes = [cell.volume() for cell in chosen.family.cutting.cells]
    box = np.array([part.box for part in chosen.parts])
    return {
        "parts": parts,
        "load_factor": low,
        "bracket": [low, high],
        "locked": locked,
        "keys": [
            {"kind": key.kind, "on": key.on, "into": key.into, "at": key.at.tolist(), "told": key.told()}
            for key in chosen.keys
        ],
        "load_factor_without_keys": finite((chosen.plain or chosen).low),
        "only_crushing": not locked and chosen.coarse == np.inf and options.matter.compressive is not None,
        "load_factor_of_cells": finite(chosen.coarse),
        "proven": result.proven(parts),
        "bound": finite(result.bound(parts)),
        "bound_by": result.kind(parts),
        "layouts": sum(layouts.solved for layouts in result.of.values()),
        "uncut": list(chosen.uncut[:2]),
        "require": options.require,
        "fits": not chosen.too_large,
        "too_large": chosen.too_large,
        "coarse_truth": chosen.fine.coarse,
        "faulty_files": [],
        "can_be_laid": chosen.can_be_laid,
        "locked_parts": [part.number for part in chosen.parts if set(part.cells) & set(chosen.locking)],
        "family": chosen.family.name,
        "families": [_facts(family, parts, options.require) for family in families],
        "front": _front(families),
        "volume": solid.volume(),
        "volume_error": abs(sum(volumes) - solid.volume()) / solid.volume(),
        "largest_box": (box.max(axis=0) / options.scale).tolist(),
        "largest_mass": max(part.mass for part in chosen.parts),
        "different_parts": different(chosen.parts),
    }


def _facts(family: Family, parts: int, require: float) -> dict[str, Any]:
    """Return what a family found: of its own fewest parts, and the strongest of at most so many parts."""
    result = family.found
    fewest = next((n for n in sorted(result.of) if _top(family, n) >= require * (1 - 1e-6)), None)
    judged = [low for n in range(1, parts + 1) for low in _judged_load_factors(family, n)]
    return {
        "name": family.name,
        "cells": len(family.cutting.cells),
        "joints": len(family.joints),
        "sets": result.sets,
        "evaluated": sum(layouts.solved for layouts in result.of.values()),
        "parts": fewest,
        "load_factor_of_cells": None if fewest is None else finite(_top(family, fewest)),
        "proven": fewest is not None and result.proven(fewest),
        "bound": None if fewest is None else finite(result.bound(fewest)),
        "load_factor": finite(max(judged)) if judged else None,
        "locked": bool(judged) and max(judged) == np.inf,
        "problem": result.problem or None,
    }


def _judged_load_factors(family: Family, parts: int) -> list[float]:
    """Return λ of the layouts of one number of parts that were judged on convex cells."""
    layouts, brackets = family.found.of.get(parts), {} if family.fine is None else family.fine.known
    keys = [] if layouts is None else [block.tobytes() for block in layouts.blocks]
    return [low_of(brackets[key]) for key in keys if key in brackets]


def _front(families: list[Family]) -> list[dict[str, Any]]:
    """Return the strongest layout of each number of parts on the cells of all families."""
    rows = []
    for parts in sorted({n for family in families for n in family.found.of}):
        best = max(families, key=lambda family: _top(family, parts))
        if _top(best, parts) >= 0.0:
            row = {"parts": parts, "load_factor_of_cells": finite(_top(best, parts)), "family": best.name}
            judged = _judged_load_factors(best, parts)
            proven = all(family.found.proven(parts) for family in families)
            bound = finite(max(family.found.bound(parts) for family in families))
            rows.append(
                row | {"load_factor": finite(max(judged)) if judged else None, "proven": proven, "bound": bound}
            )
    return rows


def verdict(summary: dict[str, Any]) -> str:
    """Say what the parts carry, beside what, and what is unproven or faulty."""
    count = f"{summary['parts']} parts" if summary["parts"] > 1 else "1 part"
    carry, low = _carried_in_words(summary), summary["bracket"][0]
    keys = summary.get("keys") or []
    if keys:
        more = f" and {len(keys) - _NAMED} more" if len(keys) > _NAMED else ""
        key_list = ", ".join(key["told"] for key in keys[:_NAMED]) + more
        carry += f"; with keys where parts slid ({key_list}; {summary['load_factor_without_keys']:.3g} without)"
    start, end = summary["uncut"]
    uncut = "any multiple" if start is not None and end is None else "unknown" if start is None else f"{start:.3g}"
    text = f"{count} {carry}; uncut {uncut}"
    if summary.get("only_crushing"):
        text += "; only crushing limits it"
    fields_high = (summary.get("by_fields") or (None, None))[1]
    above = low is not None and start is not None and end is not None and low > start * (1 + 1e-3)
    # where fields refute λ by cells, nothing is above the uncut solid
    if above and (fields_high is None or fields_high >= low):
        text += " (a dry joint opens over its whole depth, an uncut section cracks at its elastic limit)"
    text += _proof_in_words(summary) if summary.get("proven") else _bound_in_words(summary)
    if low is not None and not summary["meets"]:
        text += f"; {summary['require']:g} was asked"
    if summary["too_large"]:
        text += "; parts that do not fit the box: " + ", ".join(str(k) for k in summary["too_large"])
    if summary["coarse_truth"]:
        text += "; this is λ of the cells of the search, since no finer scene was valid: inner cracks are few"
    if summary["faulty_files"]:
        text += "; not watertight: " + ", ".join(summary["faulty_files"])
    if summary["can_be_laid"] is None:
        text += "; time ended before an order of assembly was found"
    if summary["can_be_laid"] is False:
        text += "; parts " + ", ".join(str(k) for k in summary["locked_parts"]) + " lock one another"
    return text + "."


def _proof_in_words(summary: dict[str, Any]) -> str:
    """Return in words what no other layout of the cells of a complete search does."""
    of_cells, bound = summary.get("load_factor_of_cells"), summary.get("bound")
    below = of_cells is not None and bound is not None and of_cells < bound * (1 - 1e-3)
    cells = "them" if summary["meets"] else "these cells"
    last = f"exceeds {bound:.3g} on {cells}, whether it goes together or not" if below else f"is stronger on {cells}"
    # of fewer parts it is known that none carry what was asked, which says nothing where no parts do
    first = "no fewer parts of these cells do, and no layout of as many" if summary["meets"] else ""
    joints = " with plane joints," if summary.get("keys") else ""
    return f";{joints} {first or 'no layout of as many parts or fewer'} {last}"


def _bound_in_words(summary: dict[str, Any]) -> str:
    """Return in words what bounds λ of the layouts of a search that proved nothing stronger impossible."""
    bound = summary.get("bound")
    by = {"branches": "a bound on all that were not solved", "joints": "a bound with each joint open or whole"}
    if bound is None:
        return "; not proven, and nothing bounds λ of other layouts of these cells"
    joints, kind = " with plane joints" if summary.get("keys") else "", by[summary["bound_by"]]
    return f"; not proven: no layout of as many parts of these cells{joints} exceeds {bound:.3g} ({kind})"


def _state_steps(chosen: Chosen) -> None:
    """Set step and direction of laying of each part."""
    names = [int(chosen.block[part.cells[0]]) for part in chosen.parts]
    index_of = {name: k for k, name in enumerate(names)}
    for number, step in enumerate(chosen.laying.steps if chosen.laying else (), 1):
        for block in step.blocks:
            elements = np.asarray(chosen.laying.blocks.elements(block))
            elements = elements[elements < len(chosen.fine.of)]
            if len(elements):
                part = chosen.parts[index_of[int(chosen.block[chosen.fine.of[elements[0]]])]]
                part.step, part.direction = number, -np.asarray(step.direction, dtype=float)


def _write(chosen: Chosen, summary: dict[str, Any], out: Path, options: Options, clock: Clock, moved: Floats) -> None:
    """Write parts, their table and the scene; what has no time is left out and noted by the clock."""
    scale = options.scale
    _state_steps(chosen)
    if options.tenons:
        gap = scale * options.clearance
        fit = scale * np.sort(np.array(options.fit))
        summary["tenons"] = clock.run(
            "tenons", KEYED, lambda: tenons(chosen.parts, chosen.block, chosen.family.joints, gap, fit, scale)
        )
    if options.marks:
        for part in chosen.parts:
            clock.run(f"number on part {part.number}", FILED, partial(mark, part, scale))
        summary["marked"] = [part.number for part in chosen.parts if part.marked]
    write_parts(out, chosen.parts, scale, moved)
    summary["watertight"] = all(part.watertight for part in chosen.parts)
    summary["faulty_files"] = [part.fault for part in chosen.parts if not part.watertight]
    summary["file_error"] = max(part.error for part in chosen.parts)
    files.write_text(out / "parts.csv", csv_of(table_of(chosen.parts, scale, chosen.keys)))

    def step_file() -> None:
        solids = [(part.name, False, plain_surface(part.exact)) for part in chosen.parts]
        size = max(float(part.box.max()) for part in chosen.parts)
        files.write_text(out / "parts.step", step_of_solids(chosen.fine.document["name"], "m", size, solids))
        for solid in solids:
            files.write_text(out / "parts" / f"{solid[0]}.step", step_of_solids(solid[0], "m", size, [solid]))

    clock.run("parts.step", FILED, step_file)
    files.write_text(out / "scene.json", json.dumps(chosen.fine.scene(chosen.block)) + "\n")


def _draw(chosen: Chosen, summary: dict[str, Any], out: Path, scale: float, clock: Clock) -> None:
    """Write the pages and pictures that time leaves, and the page of the search."""
    parts, verdict, steps = chosen.parts, summary["verdict"], steps_of(chosen.parts)
    keys = ("parts", "load_factor", "load_factor_of_cells", "family", "proven", "bound")
    front = (
        ["parts", "λ", "λ of the cells", "cut by", "proven", "no layout of the cells exceeds"],
        [[_cell_text(row[key]) for key in keys] for row in summary["front"]],
    )
    table = table_of(parts, scale, chosen.keys)[
        ["part", "mass", "volume", "size_x", "size_y", "size_z", "step", "keys"]
    ]
    cutting = list(table.columns), [[_cell_text(value) for value in row] for row in table.to_numpy(dtype=object)]
    write_page(parts, verdict, front, cutting, out / "parts.html")
    start = time.time()
    figures.save_figure(figure_of_parts(parts, verdict), out / "parts.png")
    seconds = time.time() - start
    if steps:
        expected = seconds * (1 + len(steps) / 4)

        def order() -> None:
            figures.save_figure(figure_of_order(parts, steps), out / "order.png")

        clock.run("order.png", DRAWN, order, expected)
        seconds += expected
    clock.run("parts.pdf", DRAWN, lambda: write_pages(parts, verdict, front, cutting, out / "parts.pdf"), seconds)
    plain, seconds_left = chosen.plain or chosen, clock.left(DRAWN)

    def page() -> None:
        exploration = explore_best(plain.family, plain.block, out / "search", seconds_left / 3)
        page_of_study.write_report(exploration, out, patience=seconds_left / 3)

    clock.run("report.html", DRAWN, page, _PAGE)


def _cell_text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "–" if value is None or value != value else f"{value:.5g}" if isinstance(value, float) else str(value)


def _carried_in_words(summary: dict[str, Any]) -> str:
    """Return what parts carry in words, by the model that knows more."""
    low = low_of((*summary["bracket"], summary["locked"]))
    least, most = summary.get("by_fields") or (None, None)
    anywhere, between = "with cracks anywhere in them", "with cracks between cells"
    if summary["locked"]:
        carry, of_cells = f"any multiple of your load {between} (only crushing would limit it)", f"any {between}"
    elif low == -np.inf:
        return "have no proven load factor"
    else:
        carry, of_cells = f"at least {low:.3g} times your load {between}", f"{low:.3g} {between}"
    # blocks that crack anywhere carry no more; where that bound is lower, cells had too few faces to crack along
    if most is not None and most < low:
        start = "" if least is None else f"at least {least:.3g} and "
        return f"carry {start}at most {most:.3g} times your load {anywhere} ({of_cells}, where few faces can crack)"
    if least is not None:
        return f"carry at least {least:.3g} times your load {anywhere} ({of_cells})"
    return f"carry {carry}" + ("" if most is None else f", and at most {most:.3g} {anywhere}")


def carries(summary: dict[str, Any]) -> bool:
    """Tell whether parts carry what was required, by fields where these decide."""
    required, (least, most) = summary["require"] * (1 - 1e-6), summary["by_fields"] or (None, None)
    low = low_of((*summary["bracket"], summary["locked"]))
    return bool((low >= required or (least is not None and least >= required)) and (most is None or most >= required))


def table_of(parts: list[Part], scale: float, keys: tuple[Key, ...] = ()) -> pd.DataFrame:
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
        row |= {"keys": "; ".join(f"{key.kind} into {key.into}" for key in keys if key.on == part.number) or None}
        row |= {"bed": " ".join(f"{value:.9g}" for value in _flat(part.bed)), "cells": len(part.cells)}
        rows.append(row)
    return pd.DataFrame(rows)


def _flat(matrix: Floats) -> list[float]:
    return [float(value) + 0.0 for value in matrix.ravel()]
