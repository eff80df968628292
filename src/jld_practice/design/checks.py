"""Checks of the winner of a design: fields, low friction, no cuts, virtual experiment, and how it is laid."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.assembly_sequence import assembly_order
from jld_core.assembly_sequence.order import LAID
from jld_core.build import build_assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.files import write_text
from jld_core.models import solve_rigid
from jld_core.scene.units import force_in_words
from jld_explore.report.languages import stronger_cut
from jld_explore.space import search_space
from jld_explore.steps.uncut import most_without_cuts
from jld_practice.design.crushing import why_no_fields
from jld_practice.design.options import LOW_FRICTION
from jld_practice.design.trials import Bounds, Check, Design, Trial, at_low_friction, built, field_bounds, one_case

# Share of the time that is left for each check, in their order
_SHARES: Final = {"laying": 0.2, "by fields": 0.6, "low friction": 0.8, "without cuts": 1.0}

_LEAST: Final = 0.3  # shortest time in which a check is begun, s

_LEAST_EXPERIMENT: Final = 4.0  # shortest time in which a virtual experiment may end, s: its program starts anew


def check_winner(work: Design, until: Deadline, say: Callable[[str], None]) -> list[Check]:
    """Check the winner of a design in five ways, and return the results in order."""
    found = [_timed(work, "laying", _laid, until.within(_SHARES["laying"] * until.remaining()))]
    say(f"check        {found[0].words}")
    # the experiment has a process of its own, beside which bounds by fields are refined
    experiment = _begin_experiment(work, until)
    try:
        later = (("by fields", _by_fields), ("low friction", _at_low_friction), ("without cuts", _without_cuts))
        for name, make in later:
            found.append(_timed(work, name, make, until.within(_SHARES[name] * until.remaining())))
            say(f"check        {found[-1].words}")
        found.insert(1, experiment if isinstance(experiment, Check) else _end_experiment(*experiment, until))
        say(f"check        {found[1].words}")
    finally:
        if not isinstance(experiment, Check):
            with experiment[0] as process:  # its pipes are closed, even of a process that ended while nobody read them
                process.kill()
    return found


def _timed(work: Design, name: str, make: Callable[[Design, Deadline], Check], until: Deadline) -> Check:
    """Return the result of a check, or that no time was left for it."""
    # a first mesh and a first solve end late rather than never
    return Check(name, f"{name}: no time was left") if until.remaining() < _LEAST else make(work, until)


def _winner(work: Design) -> Trial:
    """Return the winner of a design; raise ValueError if there is none."""
    if work.winner is None:
        raise ValueError("the design has no layout to check")
    return work.winner


def _span(bounds: Bounds) -> str:
    """Describe (lower, upper) bounds on λ in words; infinite ones are unproven."""
    low, high = bounds
    if not math.isfinite(low):
        return "no lower bound was found in time"
    return f"{low:.4g} ≤ λ" + (f" ≤ {high:.4g}" if math.isfinite(high) else "")


def _by_fields(work: Design, until: Deadline) -> Check:
    """Refine the bounds on λ by fields of the winner until a deadline."""
    # The winner in `work.trials` is replaced. Where fields do not apply, the check gives the reason.
    winner = _winner(work)
    assembly = built(winner)
    problem = why_no_fields(assembly)
    if problem:
        return Check("by fields", f"blocks that crack anywhere: not checked, {problem}")
    low, high = field_bounds(assembly, assembly.labels, until.remaining())
    best = (max(low, winner.fields[0]), min(high, winner.fields[1]))
    better = replace(winner, fields=best)
    work.trials = [better if one is winner else one for one in work.trials]
    values = {"fields_lo": _number(best[0]), "fields_hi": _number(best[1])}
    return Check("by fields", f"blocks that crack anywhere: {_span(best)}", values)


def _at_low_friction(work: Design, until: Deadline) -> Check:
    """Bound λ of the winner at the low value of friction, by fields or else by faces."""
    # Without a stated friction of dry joints the check says so.
    winner = _winner(work)
    dry = winner.scene.model_dump(mode="json", exclude_defaults=True)["materials"].get("dry") or {}
    value = dry.get("friction_coefficient")
    if value is None and "friction_angle" in dry and isinstance(dry["friction_angle"], float | int):
        low = LOW_FRICTION * float(np.tan(np.radians(dry["friction_angle"])))
    elif isinstance(value, dict):
        low = float(value["low"])
    else:
        return Check("low friction", "low friction: not checked, the scene states no friction to lower")
    scene = at_low_friction(winner.scene, low)
    assembly = build_assembly(scene)
    if why_no_fields(assembly):
        result = solve_rigid(assembly)
        words = f"friction of {low:.3g}: by faces λ = {result.load_factor:.4g} ({result.status})"
        return Check("low friction", words, {"friction": low, "load_factor": _number(result.load_factor)})
    bounds = field_bounds(assembly, assembly.labels, until.remaining())
    values = {"friction": low, "fields_lo": _number(bounds[0]), "fields_hi": _number(bounds[1])}
    return Check("low friction", f"friction of {low:.3g}: by fields {_span(bounds)}", values)


def _without_cuts(work: Design, until: Deadline) -> Check:
    """Compare the winner by faces with the structure without cuts; `uncut_at_most` where the winner is stronger."""
    winner = _winner(work)
    assembly = built(winner)
    high = most_without_cuts(winner.scene, assembly, search_space(winner.scene, assembly))
    if high is None or until.passed():
        return Check("without cuts", "without cuts: not compared")
    if winner.faces[0] > high:
        return Check("without cuts", stronger_cut(high), {"uncut_at_most": high})
    return Check("without cuts", f"without cuts: by faces at most {high:.4g}; the cuts are not proven to gain anything")


def _begin_experiment(work: Design, until: Deadline) -> tuple[subprocess.Popen[str], str, str] | Check:
    """Begin to load the winner in a virtual experiment under its governing load case, in a process of its own.

    Returns the process, a description, and the command with which a user repeats it; or a check that says that no time
    is left.
    """
    winner = _winner(work)
    assembly = built(winner)
    result, names = solve_rigid(assembly), [case.name for case in assembly.cases]
    number = names.index(str(result.governing)) if result.governing in names else 0
    place = work.folder / "experiment.json"
    scene = one_case(winner.scene, number)
    write_text(place, scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
    told = f"virtual experiment{f' of {names[number]!r}' if names else ''}"
    again = f"jld experiment {place}"
    if until.remaining() < _LEAST_EXPERIMENT:
        return Check("experiment", f"{told}: no time was left; {again}")
    command = [sys.executable, "-m", "jld_explore", "experiment", str(place), "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True), told, again


def _end_experiment(process: subprocess.Popen[str], told: str, again: str, until: Deadline) -> Check:
    """Wait for a virtual experiment, and return its result; a failure is reported in the check."""
    try:
        out, errors = process.communicate(timeout=until.remaining())
    except subprocess.TimeoutExpired:
        return Check("experiment", f"{told}: it did not end in time; {again}")
    if process.returncode not in (0, 4):
        return Check("experiment", f"{told}: not run, {errors.strip() or 'it was stopped'}")
    facts: dict[str, Any] = json.loads(out)
    values = {name: facts.get(name) for name in ("collapse_load", "load_factor", "ratio", "stands", "rate_error")}
    if not facts["stands"]:
        return Check("experiment", f"{told}: it does not stand under its dead loads alone", values)
    load = facts["collapse_load"]
    words = f"{told}: it comes down at λ = {load:.4g}" if load is not None else f"{told}: it does not come down"
    return Check("experiment", f"{words}, with brittle cracks and joints that do not dilate", values)


def _laid(work: Design, until: Deadline) -> Check:
    """Find an order in which the blocks of the winner can be laid, and the props it needs."""
    # The check names the blocks that lock one another if there is no order.
    winner = _winner(work)
    assembly: Assembly = built(winner)
    start = LAID[work.options.laid or "translation"][1]
    try:
        with until.enforced():
            sideways = winner.scene.search.assemble_out_of_plane
            found = assembly_order(assembly, assembly.labels, sideways=sideways, start=start)
    except DeadlinePassed:
        return Check("laying", f"order of laying: no time was left; jld assembly {work.folder}")
    if not found.possible:
        names = ", ".join(found.blocks.name(block) for block in found.locked)
        return Check("laying", f"order of laying: none by translations, {names} lock one another", {"possible": False})
    props = max((float(step.stage.props.sum()) for step in found.steps), default=0.0)
    held = (
        "no stage needs a prop" if found.stands else f"props of {force_in_words(props, assembly.units[1])} at the most"
    )
    values = {"possible": True, "steps": len(found.steps), "props": props}
    first = "" if start == "ground" else f" from the {start}"
    return Check("laying", f"order of laying{first}: {len(found.steps)} steps, {held}", values)


def _number(value: float) -> float | None:
    """Return a float as a JSON number, None if it is not finite."""
    return float(value) if math.isfinite(value) else None
