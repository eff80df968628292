"""Layouts that a design has found, with the bounds that are proven for each."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.build.assemble import cases_of_scene
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError
from jld_core.fields.bounds import governing_bounds
from jld_core.limit import Status
from jld_core.scene import Scene, parse_scene
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.evaluation.field_evaluator import COARSE_RATE, mesh_seconds
from jld_explore.space import search_space
from jld_geometry.convex_cells import vertex_mesh
from jld_geometry.moved_scene import MovedScene
from jld_practice.design.crushing import why_no_fields, with_crushing
from jld_practice.design.options import DesignOptions
from jld_practice.design.outline import Outline
from jld_practice.design.tessellations import Tessellation

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
    """Return the scene in which the labels of a tessellation are searched: faces crush where bounds by fields apply."""
    crushes = scene.dimension == 2 and not why_no_fields(build_assembly(scene))
    return with_crushing(scene) if crushes else scene


def screen(scene: Scene, seed: int, seconds: float, deadline: Deadline) -> Screening:
    """Solve at least one generation of the genetic driver, and more for some time.

    Raises InputError if the limits of the scene cannot be met.
    """
    # A search by this driver with the same seed begins with the same layouts.
    assembly = build_assembly(searched_scene(scene))
    driver = Genetic(search_space(scene, assembly), seed)
    evaluator = evaluator_of(assembly, EvaluatorSettings())
    best, most, count = None, -math.inf, 0
    until = deadline.within(seconds)
    with suppress(DeadlinePassed), deadline.enforced():
        while count == 0 or not until.passed():
            rows = driver.ask()
            if not len(rows):
                break
            found = evaluator.evaluate_all(rows)
            driver.tell(rows, found)
            count += len(found)
            values = [
                math.inf if one.status is Status.LOCKED else one.load_factor if one.status is Status.COLLAPSE else -1.0
                for one in found
            ]
            if (place := int(np.argmax(values))) >= 0 and values[place] >= 0.0 and values[place] > most:
                best, most = rows[place], values[place]
    return Screening(assembly, best, most, count, _search_seconds(assembly))


def _search_seconds(assembly: Assembly) -> float:
    """Return the least time of a search of an assembly, s: its tables, and bounds by fields on two meshes."""
    if assembly.dimension == 3 or why_no_fields(assembly):
        return _TABLES
    corners = sum(len(assembly.elements.shape[element]) - 2 for element in assembly.elements.free)
    return _TABLES + _MESHES * len(assembly.by_case) * mesh_seconds(COARSE_RATE, _TRIANGLES * corners)


Bounds = tuple[float, float]
"""Proven bounds on λ, infinite where nothing is proven."""

NONE: Bounds = (-math.inf, math.inf)


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
        """Lower bound on λ: that by fields if any bound by fields is known, else that by faces.

        It is −inf where nothing is proven.
        """
        return self.faces[0] if self.fields == NONE else self.fields[0]

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
    def most(self) -> float:
        """Lowest known upper estimate of λ: upper bound by fields, or λ by faces if it is lower.

        If λ by faces is unknown, the upper bound by faces takes its place. The result is inf where nothing is known.
        """
        return min(self.fields[1], self.faces[1] if math.isnan(self.load_factor) else self.load_factor)

    def order(self) -> tuple[bool, float]:
        """Return a sort key that ranks trials by λ, those with a lower bound by fields first.

        They are ranked by this bound, the others by `most`, the highest first.
        """
        known = math.isfinite(self.fields[0])
        return not known, -(self.fields[0] if known else self.most)


@dataclass(frozen=True)
class Check:
    """Result of one check of the winning layout."""

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
    searched: dict[str, str] = field(default_factory=dict)
    checks: list[Check] = field(default_factory=list)
    stop: str = "time limit"  # reason why the design ended
    seconds: float = 0.0  # time so far, s

    @property
    def allowed(self) -> list[Trial]:
        """Layouts that keep the limits and are proven to stand, in the order of `Trial.order`."""
        standing = (one for one in self.trials if one.allowed and one.stands)
        return sorted(standing, key=Trial.order)

    @property
    def winner(self) -> Trial | None:
        """First layout of `allowed`, the strongest; None if there is none."""
        return next(iter(self.allowed), None)

    @property
    def usual(self) -> Trial | None:
        """First layout with the stated labels of a tessellation, the usual bond; None without one."""
        return next((one for one in self.trials if one.kind == "stated"), None)


def labelled(scene: Scene, assembly: Assembly, labels: Bits) -> Scene:
    """Return a scene whose own labels are the given ones.

    labels: (m,) True = dry. In space, labels are stated for pairs of elements. Raises InputError where two faces of one
    pair have different labels.
    """
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
    document["elements"] = [{k: v for k, v in one.items() if k != "block"} for one in document["elements"]]
    return parse_scene(document, scene.name)


def faces_of(bracket: tuple[float, float]) -> Bounds:
    """Return a bracket with −inf and inf in place of ends that are not finite."""
    low, high = bracket
    return (low if math.isfinite(low) else -math.inf, high if math.isfinite(high) else math.inf)


def field_bounds(
    assembly: Assembly, labels: Bits, seconds: float, gap: float = 0.05, *, lower_first: bool = True
) -> Bounds:
    """Compute bounds by fields on the governing factor, the least λ / required of all cases.

    labels: (m,) True = dry. Returns (lower, upper) bound, infinite where fields do not apply.
    """
    if why_no_fields(assembly):
        return NONE
    return governing_bounds(assembly, labels, seconds, gap=gap, lower_first=lower_first)


def at_low_friction(scene: Scene, low: float) -> Scene:
    """Return a scene with the friction coefficient of the material of dry joints set to `low`."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"]["dry"].pop("friction_angle", None)
    document["materials"]["dry"]["friction_coefficient"] = low
    return parse_scene(document, scene.name)


def one_case(scene: Scene, number: int) -> Scene:
    """Return a scene whose live and dead loads are those of one load case."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    if scene.loads.has_cases:
        case = cases_of_scene(scene, build_assembly(scene).elements)[number].case
        own = case.model_dump(mode="json", exclude_defaults=True)
        dead = [*document["loads"].get("dead", []), *own.get("dead", [])]
        document["loads"] = {"live": own["live"], "dead": dead}
    return parse_scene(document, scene.name)


def built(trial: Trial) -> Assembly:
    """Build the assembly of a trial's scene."""
    return build_assembly(trial.scene)
