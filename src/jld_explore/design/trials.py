"""Layouts that a design has found, with what is proven about each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.fields import bounds_by_fields
from jld_core.fields.requirements import require_fields
from jld_core.geometry_optimisation.moved_scene import MovedScene
from jld_core.geometry_optimisation.vertex_mesh import vertex_mesh
from jld_core.scene import Scene, parse_scene
from jld_explore.design.options import DesignOptions
from jld_explore.design.outline import Outline
from jld_explore.design.tessellations import Tessellation

Bounds = tuple[float, float]
"""Proven bounds on λ, infinite where nothing is proven."""

NONE: Bounds = (-math.inf, math.inf)


@dataclass(frozen=True)
class Trial:
    """One layout of one tessellation.

    Attributes
    ----------
    tessellation : str
        Name of the tessellation.
    kind : {"stated", "searched", "moved"}
        Layout that the tessellation states, best of a search of labels, or one whose joints were moved.
    scene : Scene
        Scene whose own labels are the layout.
    load_factor : float
        λ by faces, NaN where unknown.
    faces, fields : (float, float)
        Bounds on λ by faces, and by fields with blocks that crack anywhere.
    words : str
        How it was found.
    """

    tessellation: str
    kind: str
    scene: Scene
    load_factor: float
    faces: Bounds
    fields: Bounds
    words: str

    @property
    def proven(self) -> float:
        """Load factor that is proven: by fields where these apply, else by faces."""
        return self.fields[0] if math.isfinite(self.fields[0]) else self.faces[0]

    @property
    def most(self) -> float:
        """Load factor that the layout can carry at most, as far as is known; inf where nothing is."""
        return min(self.fields[1], self.faces[1] if math.isnan(self.load_factor) else self.load_factor)

    def order(self) -> tuple[bool, float]:
        """Return the key by which trials are ranked: those with a bound by fields first, the strongest first."""
        return not math.isfinite(self.fields[0]), -self.proven


@dataclass(frozen=True)
class Check:
    """One check of the winner.

    Attributes
    ----------
    name : str
        What was checked.
    words : str
        Outcome, in a sentence.
    values : dict
        Numbers for summary.json.
    """

    name: str
    words: str
    values: dict[str, Any] = field(default_factory=dict)


@dataclass
class Design:
    """State of a design, complete at every time that it is written.

    Attributes
    ----------
    options : DesignOptions
        What was asked.
    outline : Outline
        The outline, with what was assumed.
    folder : Path
        Results folder.
    tessellations : list of Tessellation
        All tessellations, also those that do not fit.
    trials : list of Trial
        All layouts found.
    searched : dict of str to str
        What the search of each tessellation ended with, by its name.
    checks : list of Check
        Checks of the winner.
    stop : str
        Why the design ended.
    seconds : float
        Time so far, s.
    """

    options: DesignOptions
    outline: Outline
    folder: Path
    tessellations: list[Tessellation] = field(default_factory=list)
    trials: list[Trial] = field(default_factory=list)
    searched: dict[str, str] = field(default_factory=dict)
    checks: list[Check] = field(default_factory=list)
    stop: str = "time limit"
    seconds: float = 0.0

    @property
    def allowed(self) -> list[Trial]:
        """Layouts that keep the limits, the strongest first."""
        return sorted((one for one in self.trials if one.kind != "stated"), key=Trial.order)

    @property
    def winner(self) -> Trial | None:
        """Strongest layout that keeps the limits; None if there is none."""
        return next(iter(self.allowed), None)

    @property
    def usual(self) -> Trial | None:
        """Layout that the first tessellation states: the usual bond."""
        return next((one for one in self.trials if one.kind == "stated"), None)


def labelled(scene: Scene, assembly: Assembly, labels: Bits) -> Scene:
    """Return a scene whose own labels are those of a layout.

    labels: (m,) True = dry. Raises InputError where two faces of one pair of spatial elements have different labels.
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


def field_bounds(assembly: Assembly, labels: Bits, seconds: float, gap: float = 0.05) -> Bounds:
    """Return bounds on the governing λ by fields in about some seconds, infinite where fields do not apply."""
    if why_no_fields(assembly):
        return NONE
    cases, required = assembly.by_case, assembly.required.tolist()
    deadline = Deadline(seconds)
    low, high = [], []
    for k, (case, factor) in enumerate(zip(cases, required, strict=True)):
        share = 0.5 * deadline.remaining() / (len(cases) - k)
        found = bounds_by_fields(case, labels, gap=gap, seconds=share)
        low.append(found.lower / factor)
        high.append(found.upper / factor)
    while deadline.remaining() > 0.1 * seconds:
        # the case with the least lower bound governs what is proven
        worst = int(np.argmin(low))
        if high[worst] - low[worst] <= gap * abs(high[worst]):
            break
        again = bounds_by_fields(cases[worst], labels, gap=gap, seconds=deadline.remaining())
        better = max(low[worst], again.lower / required[worst])
        high[worst] = min(high[worst], again.upper / required[worst])
        if better <= low[worst]:
            break
        low[worst] = better
        if int(np.argmin(low)) == worst:
            break
    return min(low), min(high)


def why_no_fields(assembly: Assembly) -> str:
    """Return why λ of a structure cannot be bounded by fields, empty where it can."""
    try:
        require_fields(assembly)
    except InputError as error:
        return error.problem
    return ""


def at_low_friction(scene: Scene, low: float) -> Scene:
    """Return a scene with another friction of all its joints."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"]["dry"].pop("friction_angle", None)
    document["materials"]["dry"]["friction_coefficient"] = low
    return parse_scene(document, scene.name)


def one_case(scene: Scene, number: int) -> Scene:
    """Return a scene with one of its load cases as the live load, from 0."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    cases = document["loads"].pop("cases", None)
    if cases:
        case = cases[number]
        document["loads"]["live"] = case.get("live", [])
        document["loads"]["dead"] = [*document["loads"].get("dead", []), *case.get("dead", [])]
    return parse_scene(document, scene.name)


def mass_and_shapes(assembly: Assembly, scene: Scene) -> tuple[int, float, int]:
    """Return the number of blocks, the largest mass and the number of shapes of a scene's own layout."""
    from jld_core.exchange import Layout

    blocks = [one for one in Layout(scene, assembly, assembly.labels).blocks if one.cells]
    return len(blocks), max(one.mass for one in blocks), len({one.shape for one in blocks})


def built(trial: Trial) -> Assembly:
    """Return the assembly of a trial."""
    return build_assembly(trial.scene)
