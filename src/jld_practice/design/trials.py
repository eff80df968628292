"""Layouts that a design has found, the bounds proven for each, and checks of the winner."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import (
    Assembly,
    Bits,
    Deadline,
    DeadlinePassed,
    InputError,
    Scene,
    Status,
    build_assembly,
    files,
    parse_scene,
)
from jld_core.build import cases_of_scene
from jld_core.fields import governing_bounds
from jld_core.limit import number
from jld_core.models import solve_rigid
from jld_core.scene import units
from jld_explore import most_without_cuts, search_space
from jld_explore.drivers import Genetic
from jld_explore.evaluation import EvaluatorSettings, evaluator_of, field_evaluator
from jld_explore.report import words
from jld_geometry import MovedScene, vertex_mesh
from jld_practice.design.options import LOW_FRICTION, DesignOptions, Outline
from jld_practice.design.tessellations import Tessellation, why_no_fields, with_crushing
from jld_practice.laying import assembly_order
from jld_practice.laying.order import LAID

_TABLES: Final = 1.0  # time of a short search and its tables, s

_TRIANGLES: Final = 2.5  # triangles of a coarsest mesh, as a multiple of those that the corners of the cells alone need

_MESHES: Final = 2.0  # time of bounds by fields, as a multiple of that of the coarsest mesh


@dataclass(frozen=True)
class Screening:
    """Strongest of a few layouts of a tessellation."""

    assembly: Assembly  # assembly that was searched
    labels: Bits | None  # (m,) labels of the strongest layout, True = dry; None if none was found that stands
    load_factor: float  # λ of this layout, −inf without one
    count: int  # number of layouts solved
    # least time of a search of this tessellation that is worth its while, with bounds by fields on λ of its best, s
    search_seconds: float


def searched_scene(scene: Scene) -> Scene:
    """Return the scene of a search of labels: faces crush where bounds by fields apply."""
    crushes = scene.dimension == 2 and not why_no_fields(build_assembly(scene))
    return with_crushing(scene) if crushes else scene


def screen(scene: Scene, seed: int, seconds: float, deadline: Deadline) -> Screening:
    """Solve at least one generation of the genetic driver, and more for some time."""
    # A search by this driver with the same seed begins with the same layouts.
    assembly = build_assembly(searched_scene(scene))
    driver = Genetic(search_space(scene, assembly), seed)
    evaluator = evaluator_of(assembly, EvaluatorSettings())
    best, load_factor, count = None, -math.inf, 0
    until = deadline.within(seconds)
    with suppress(DeadlinePassed), deadline.enforced():
        while count == 0 or not until.passed():
            rows = driver.ask()
            if not len(rows):
                break
            evaluations = evaluator.evaluate_all(rows)
            driver.tell(rows, evaluations)
            count += len(evaluations)
            # layouts that do not stand, or have no proven λ, are below all others
            values = [
                math.inf
                if evaluation.status is Status.LOCKED
                else evaluation.load_factor
                if evaluation.status is Status.COLLAPSE
                else -1.0
                for evaluation in evaluations
            ]
            strongest = int(np.argmax(values))
            if values[strongest] >= 0.0 and values[strongest] > load_factor:
                best, load_factor = rows[strongest], values[strongest]
    return Screening(assembly, best, load_factor, count, _search_seconds(assembly))


def _search_seconds(assembly: Assembly) -> float:
    """Return the least time of a search, s: its tables, and bounds by fields on two meshes."""
    if assembly.dimension == 3 or why_no_fields(assembly):
        return _TABLES
    triangles = sum(len(assembly.elements.shape[element]) - 2 for element in assembly.elements.free)
    return _TABLES + _MESHES * len(assembly.by_case) * field_evaluator.mesh_seconds(
        field_evaluator.COARSE_RATE, _TRIANGLES * triangles
    )


Bounds = tuple[float, float]  # proven bounds on λ, infinite where nothing is proven

UNPROVEN: Bounds = (-math.inf, math.inf)


@dataclass(frozen=True)
class Trial:
    """One labelling of one tessellation, with its bounds on λ."""

    tessellation: str  # name of the tessellation
    # "stated": labels that the tessellation states. "searched": best of a search of labels. "moved": labels searched
    # and joints moved.
    kind: str
    scene: Scene  # scene whose own labels are the layout
    load_factor: float  # λ by faces, NaN where unknown
    # faces, fields: proven bounds on λ: with cracks along faces, and with cracks anywhere in the blocks;
    # infinite where unproven
    faces: Bounds
    fields: Bounds
    words: str  # how it was found
    allowed: bool = True  # True if it keeps the limits of the options. A stated layout may break them.

    @property
    def proven(self) -> float:
        """Lower bound on λ: by fields if any is known, else by faces; −inf where nothing is proven."""
        return self.faces[0] if self.fields == UNPROVEN else self.fields[0]

    @property
    def by_faces(self) -> str:
        """Text for λ by faces; of locked layouts, which have none, for its lower bound."""
        if self.faces[1] < 0.0:
            return "does not stand"
        if math.isfinite(self.load_factor):
            return f"λ = {self.load_factor:.4g} by faces"
        return f"λ ≥ {self.faces[0]:.4g} by faces" if math.isfinite(self.faces[0]) else "λ by faces unknown"

    @property
    def stands(self) -> bool:
        """True if the upper bound by fields and the higher of both lower bounds on λ are ≥ 0."""
        return self.fields[1] >= 0.0 and max(self.fields[0], self.faces[0]) >= 0.0

    @property
    def upper_estimate(self) -> float:
        """Lowest known upper estimate of λ: upper bound by fields, or λ by faces if lower; inf if unknown."""
        return min(self.fields[1], self.faces[1] if math.isnan(self.load_factor) else self.load_factor)

    def order(self) -> tuple[bool, float]:
        """Return a sort key: by lower bound by fields, then those without one by `upper_estimate`."""
        bounded = math.isfinite(self.fields[0])
        return not bounded, -(self.fields[0] if bounded else self.upper_estimate)


@dataclass(frozen=True)
class Check:
    name: str
    words: str  # outcome, in a sentence
    values: dict[str, Any] = field(default_factory=dict)  # numbers for summary.json


@dataclass
class Design:
    """State of a design run, which can be written to disk at any time."""

    options: DesignOptions  # options that the user states
    outline: Outline  # outline to be cut, with the values assumed
    folder: Path  # results folder
    tessellations: list[Tessellation] = field(default_factory=list)  # all tessellations, also those that do not fit
    trials: list[Trial] = field(default_factory=list)  # all layouts found
    # strongest of a few layouts of each tessellation, by its name
    screened: dict[str, Screening] = field(default_factory=dict)
    # labels of the best layouts of the search of each tessellation, the best first
    layouts: dict[str, list[Bits]] = field(default_factory=dict)
    # outcome of the search of each tessellation, in words, by its name
    search_words: dict[str, str] = field(default_factory=dict)
    checks: list[Check] = field(default_factory=list)
    stop: str = "time limit"  # reason why the design ended
    seconds: float = 0.0  # time so far, s

    @property
    def ranked(self) -> list[Trial]:
        """Layouts that keep the limits and are proven to stand, ordered."""
        standing = (trial for trial in self.trials if trial.allowed and trial.stands)
        return sorted(standing, key=Trial.order)

    @property
    def winner(self) -> Trial | None:
        return next(iter(self.ranked), None)

    @property
    def usual(self) -> Trial | None:
        """First layout with the stated labels of a tessellation, the usual bond; None without one."""
        return next((trial for trial in self.trials if trial.kind == "stated"), None)


def labelled(scene: Scene, assembly: Assembly, labels: Bits) -> Scene:
    """Return a scene that states the labels (m,), in space by pairs of elements."""
    if assembly.dimension == 2:
        mesh = vertex_mesh(assembly)
        return MovedScene(scene, assembly, labels, mesh).at(mesh.places)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    ids, faces = assembly.elements.ids, assembly.interfaces
    pairs: dict[tuple[str, str], bool] = {}
    for a, b, dry in zip(faces.a.tolist(), faces.b.tolist(), labels.tolist(), strict=True):
        pair = (ids[a], ids[b])
        if pairs.setdefault(pair, dry) != dry:
            raise InputError(
                f"faces between {pair[0]!r} and {pair[1]!r}", "their labels differ", "one label for a pair"
            )
    dry_pairs = [list(pair) for pair, dry in pairs.items() if dry]
    inner_pairs = [list(pair) for pair, dry in pairs.items() if not dry]
    document["labels"] = {"dry": dry_pairs, "inner": inner_pairs}
    document["elements"] = [{k: v for k, v in entry.items() if k != "block"} for entry in document["elements"]]
    return parse_scene(document, scene.name)


def faces_of(bracket: tuple[float, float]) -> Bounds:
    """Return a bracket with −inf and inf in place of ends that are not finite."""
    low, high = bracket
    return (low if math.isfinite(low) else -math.inf, high if math.isfinite(high) else math.inf)


def field_bounds(
    assembly: Assembly, labels: Bits, seconds: float, gap: float = 0.05, *, lower_first: bool = True
) -> Bounds:
    """Compute bounds by fields on the governing factor, infinite where fields do not apply."""
    if why_no_fields(assembly):
        return UNPROVEN
    return governing_bounds(assembly, labels, seconds, gap=gap, lower_first=lower_first)


def low_friction(scene: Scene) -> float | None:
    """Return the low coefficient of friction of dry joints, else a share of the nominal one; None if none is stated."""
    dry = scene.model_dump(mode="json", exclude_defaults=True)["materials"].get("dry") or {}
    key = "friction_coefficient" if "friction_coefficient" in dry else "friction_angle"
    stated = dry.get(key)
    if stated is None:
        return None
    forms: dict[str, Any] = stated if isinstance(stated, dict) else {"mean": stated}
    value, share = (forms["low"], 1.0) if "low" in forms else (forms["mean"], LOW_FRICTION)
    return share * (float(value) if key == "friction_coefficient" else math.tan(math.radians(value)))


def with_friction(scene: Scene, coefficient: float) -> Scene:
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"]["dry"].pop("friction_angle", None)
    document["materials"]["dry"]["friction_coefficient"] = coefficient
    return parse_scene(document, scene.name)


def one_case(scene: Scene, number: int) -> Scene:
    """Return a scene whose live and dead loads are those of one load case."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    if scene.loads.has_cases:
        case = cases_of_scene(scene, build_assembly(scene).elements)[number].case
        loads_of_case = case.model_dump(mode="json", exclude_defaults=True)
        dead = [*document["loads"].get("dead", []), *loads_of_case.get("dead", [])]
        document["loads"] = {"live": loads_of_case["live"], "dead": dead}
    return parse_scene(document, scene.name)


def built(trial: Trial) -> Assembly:
    return build_assembly(trial.scene)


# Share of the time that is left for each check, in their order
_SHARES: Final = {"laying": 0.2, "by fields": 0.6, "low friction": 0.8, "without cuts": 1.0}

_LEAST: Final = 0.3  # shortest time in which a check is begun, s

_TOLD: Final = (0, 4)  # exit codes of an experiment that prints its result: done, and uncertified

_LEAST_EXPERIMENT: Final = 4.0  # shortest time in which a virtual experiment may end, s: its program starts anew


def check_winner(work: Design, until: Deadline, say: Callable[[str], None]) -> list[Check]:
    """Run the checks of the best layout, and report each at once."""
    checks = [_timed(work, "laying", _laid, until.within(_SHARES["laying"] * until.remaining()))]
    say(f"check        {checks[0].words}")
    # the experiment has a process of its own, beside which bounds by fields are refined
    experiment = _begin_experiment(work, until)
    try:
        later = (("by fields", _by_fields), ("low friction", _check_low_friction), ("without cuts", _without_cuts))
        for name, make in later:
            checks.append(_timed(work, name, make, until.within(_SHARES[name] * until.remaining())))
            say(f"check        {checks[-1].words}")
        checks.insert(1, experiment if isinstance(experiment, Check) else _end_experiment(experiment, until))
        say(f"check        {checks[1].words}")
    finally:
        if not isinstance(experiment, Check):
            # its pipes are closed, even of a process that ended while nobody read them
            with experiment.process as process:
                process.kill()
    return checks


def _timed(work: Design, name: str, make: Callable[[Design, Deadline], Check], until: Deadline) -> Check:
    # a first mesh and a first solve end late rather than never
    return Check(name, f"{name}: no time was left") if until.remaining() < _LEAST else make(work, until)


def _winner(work: Design) -> Trial:
    if work.winner is None:
        raise ValueError("the design has no layout to check")
    return work.winner


def _span(bounds: Bounds) -> str:
    """Describe bounds on λ in words; infinite ones are unproven."""
    low, high = bounds
    if not math.isfinite(low):
        return "no lower bound was found in time"
    return f"{low:.4g} ≤ λ" + (f" ≤ {high:.4g}" if math.isfinite(high) else "")


def _by_fields(work: Design, until: Deadline) -> Check:
    # The winner in `work.trials` is replaced. Where fields do not apply, the check gives the reason.
    winner = _winner(work)
    assembly = built(winner)
    problem = why_no_fields(assembly)
    if problem:
        return Check("by fields", f"blocks that crack anywhere: not checked, {problem}")
    low, high = field_bounds(assembly, assembly.labels, until.remaining())
    best = (max(low, winner.fields[0]), min(high, winner.fields[1]))
    better = replace(winner, fields=best)
    work.trials = [better if trial is winner else trial for trial in work.trials]
    values = {"fields_lo": number(best[0]), "fields_hi": number(best[1])}
    return Check("by fields", f"blocks that crack anywhere: {_span(best)}", values)


def _check_low_friction(work: Design, until: Deadline) -> Check:
    """Bound λ of the winner at the low value of friction, by fields or else by faces."""
    winner = _winner(work)
    low = low_friction(winner.scene)
    if low is None:
        return Check("low friction", "low friction: not checked, the scene states no friction to lower")
    assembly = build_assembly(with_friction(winner.scene, low))
    if why_no_fields(assembly):
        result = solve_rigid(assembly)
        words = f"friction of {low:.3g}: by faces λ = {result.load_factor:.4g} ({result.status})"
        return Check("low friction", words, {"friction": low, "load_factor": number(result.load_factor)})
    bounds = field_bounds(assembly, assembly.labels, until.remaining())
    values = {"friction": low, "fields_lo": number(bounds[0]), "fields_hi": number(bounds[1])}
    return Check("low friction", f"friction of {low:.3g}: by fields {_span(bounds)}", values)


def _without_cuts(work: Design, until: Deadline) -> Check:
    """Compare the winner by faces with the structure without cuts."""
    winner = _winner(work)
    assembly = built(winner)
    high = most_without_cuts(winner.scene, assembly, search_space(winner.scene, assembly))
    if high is None or until.passed():
        return Check("without cuts", "without cuts: not compared")
    if winner.faces[0] > high:
        return Check("without cuts", words.STRONGER_CUT.format(high=f"{high:.4g}"), {"uncut_at_most": high})
    return Check("without cuts", f"without cuts: by faces at most {high:.4g}; the cuts are not proven to gain anything")


@dataclass(frozen=True)
class Experiment:
    """Virtual experiment that runs in a process of its own."""

    process: subprocess.Popen[str]
    title: str  # what is tried, in words
    command: str  # command that repeats it


def _begin_experiment(work: Design, until: Deadline) -> Experiment | Check:
    """Load the winner in a virtual experiment, in a process; or return a check without time."""
    winner = _winner(work)
    assembly = built(winner)
    result, names = solve_rigid(assembly), [case.name for case in assembly.cases]
    number = names.index(str(result.governing)) if result.governing in names else 0
    file = work.folder / "experiment.json"
    scene = one_case(winner.scene, number)
    files.write_text(file, scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
    title = f"virtual experiment{f' of {names[number]!r}' if names else ''}"
    remedy = f"jld experiment {file}"
    if until.remaining() < _LEAST_EXPERIMENT:
        return Check("experiment", f"{title}: no time was left; {remedy}")
    command = [sys.executable, "-m", "jld_explore", "experiment", str(file), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return Experiment(process, title, remedy)


def _end_experiment(experiment: Experiment, until: Deadline) -> Check:
    """Wait for a virtual experiment, and return its result; a failure is reported in the check."""
    process, title = experiment.process, experiment.title
    try:
        out, errors = process.communicate(timeout=until.remaining())
    except subprocess.TimeoutExpired:
        return Check("experiment", f"{title}: it did not end in time; {experiment.command}")
    if process.returncode not in _TOLD:
        return Check("experiment", f"{title}: not run, {errors.strip() or 'it was stopped'}")
    facts: dict[str, Any] = json.loads(out)
    values = {name: facts.get(name) for name in ("collapse_load", "load_factor", "ratio", "stands", "rate_error")}
    if not facts["stands"]:
        return Check("experiment", f"{title}: it does not stand under its dead loads alone", values)
    load = facts["collapse_load"]
    words = f"{title}: it comes down at λ = {load:.4g}" if load is not None else f"{title}: it does not come down"
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
            order = assembly_order(assembly, assembly.labels, sideways=sideways, start=start)
    except DeadlinePassed:
        return Check("laying", f"order of laying: no time was left; jld assembly {work.folder}")
    if not order.possible:
        names = ", ".join(order.blocks.name(block) for block in order.locked)
        return Check("laying", f"order of laying: none by translations, {names} lock one another", {"possible": False})
    props = max((float(step.stage.props.sum()) for step in order.steps), default=0.0)
    words = (
        "no stage needs a prop"
        if order.stands
        else f"props of {units.force_in_words(props, assembly.units[1])} at the most"
    )
    values = {"possible": True, "steps": len(order.steps), "props": props}
    first = "" if start == "ground" else f" from the {start}"
    return Check("laying", f"order of laying{first}: {len(order.steps)} steps, {words}", values)
