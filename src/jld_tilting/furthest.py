"""Angles of layouts on a tilting table, and the proof that none tilts further.

A search of the scene whose gravity is turned by the furthest angle, under live load along the tangent, proves that
every layout falls. Where one stands it tilts further, and is tried next.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, InputError, Model, Scene, Status, solve
from jld_core.scene import cracks
from jld_explore import Evaluation, Exploration, ExploreSettings, Step, StepContext, explore, with_entries
from jld_explore.space import cut

Bracket = tuple[float, float]  # bounds on an angle, degrees; NaN where one is unknown
_BEST: Final = 10  # layouts whose angles are found after a search
_TRIES: Final = 6  # searches of turned scenes
_SECONDS: Final = 30.0  # most time of each
_BEYOND: Final = 1e-4  # degrees above the furthest at which every layout is to fall
_CARRY: Final = (str(Status.COLLAPSE), str(Status.LOCKED))  # a locked layout may fall beyond 90 degrees


def furthest(evaluation: Evaluation, assembly: Assembly, labels: Bits) -> float:
    """Return the proven angle, degrees, to which a layout tilts: the least of load cases that tilt.

    Parameters
    ----------
    evaluation : Evaluation
        Not used: λ alone says the angle only with friction alone.
    assembly : Assembly
        Structure.
    labels : (m,) bool array
        Labels, True = dry.

    Returns
    -------
    float
        Angle, 0 where the layout falls at once or nothing is known.

    Raises
    ------
    InputError
        Nothing tilts.
    """
    if not _tilts(assembly):
        raise InputError("objective", "nothing is tilted", '"tilt" among the live loads')
    low = _angle(assembly, labels, Model())[0]
    return low if math.isfinite(low) else 0.0


def _tilts(assembly: Assembly) -> bool:
    return assembly.scene is not None and assembly.scene.loads.tilts


def _angle(assembly: Assembly, labels: Bits, model: Model) -> Bracket:
    """Return the bracket of a layout, of load cases that tilt the least one."""
    result = solve(assembly, labels, model)
    ends = [
        solved.facts["tilt_bracket"] for solved in (result, *result.cases.values()) if "tilt_bracket" in solved.facts
    ]
    low, high = zip(*ends, strict=True)
    return tuple(math.nan if None in end else min(end) for end in (low, high))  # type: ignore[return-value]


def turned(scene: Scene, degrees: float) -> dict[str, Any]:
    """Return a tilted scene whose gravity is turned instead, with live load along the tangent."""
    document = scene.model_dump(mode="json", exclude_defaults=True)
    gravity = np.asarray(scene.materials.gravity, dtype=float)
    if not gravity.ndim:
        gravity = np.append(np.zeros(scene.dimension - 1), -gravity)
    size = float(np.linalg.norm(gravity))
    towards = np.array(scene.loads.live[0].tilt.towards, dtype=float)  # type: ignore[index, union-attr]
    frame = np.array([gravity / size, towards / np.linalg.norm(towards)])
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    document["materials"] = {**document["materials"], "gravity": (size * (cos * frame[0] + sin * frame[1])).tolist()}
    document["loads"] = {"live": [{"body": (cos * frame[1] - sin * frame[0]).tolist()}]}
    search = document.get("search", {})  # any layout that stands counts, whatever it carries along the tangent
    document["search"] = {key: value for key, value in search.items() if key not in ("require", "front")}
    return document


class Tilting(Step):
    """Angles of the best layouts, in degrees, and of small scenes the layout that tilts furthest, with proof.

    Attributes
    ----------
    name : str
        Key in summary.json.
    """

    name = "tilt_angle"

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        """Return what the summary holds.

        Parameters
        ----------
        done : Exploration
            Finished search.
        context : StepContext
            Settings and deadline.

        Returns
        -------
        dict
            Angle and bracket of the layout that tilts furthest, its labelling, and what none is proven to pass.
        """
        return self._entries_and_angles(done, context)[0]

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        """Return the search with angles, if its scene is tilted.

        Parameters
        ----------
        done : Exploration
            Finished search.
        context : StepContext
            Settings and deadline.

        Returns
        -------
        Exploration
            Search with entries and columns.
        """
        if not _tilts(done.assembly) or isinstance(done.scene.cracks, cracks.FieldCracks):
            return done
        entries, angles = self._entries_and_angles(done, context)
        ends = [angles.get(text, (math.nan, math.nan)) for text in done.results["labelling"]]
        low, high = np.array(ends).reshape(-1, 2).T
        return with_entries(done, entries, {"tilt_angle": 0.5 * (low + high), "tilt_lo": low, "tilt_hi": high})

    def _entries_and_angles(self, done: Exploration, context: StepContext) -> tuple[dict[str, Any], dict[str, Bracket]]:
        """Return facts of the layout that tilts furthest, and the angle of each."""
        rows, model, angles = done.results.head(_BEST), context.settings.model, dict[str, Bracket]()
        for text, status in zip(rows["labelling"], rows["status"], strict=True):
            if status in _CARRY and not context.deadline.passed():
                angles[text] = _angle(*cut(done.assembly, text), model)
        bound = _bound(done, context, angles)
        solved = {text: ends for text, ends in angles.items() if not math.isnan(sum(ends))}
        if not solved:
            return {"tilt_angle": None, "tilt_bracket": [None, None]}, angles
        best = max(solved, key=lambda text: solved[text])
        low, high = solved[best]
        facts = {"tilt_angle": 0.5 * (low + high), "tilt_bracket": [low, high]}
        return {**facts, "tilt_labelling": best, "tilt_bound": bound}, angles


def _bound(done: Exploration, context: StepContext, angles: dict[str, Bracket]) -> float | None:
    """Return the angle, degrees, that no layout is proven to pass; better ones than those of `angles` are added."""
    scene, settings = done.scene, context.settings
    if not done.summary.proven or scene.loads.has_cases or not np.any(scene.materials.gravity):
        return None
    if scene.search.assemble is not None:  # blocks are laid under the scene's own gravity
        return None
    for _ in range(_TRIES):
        if context.deadline.passed():
            return None
        high = max((ends[1] for ends in angles.values()), default=math.nan)
        if not high < 180.0:
            return None
        seconds = min(_SECONDS, context.deadline.remaining())
        search = ExploreSettings(seconds=seconds, pictures=False, check_fields=0, jobs=settings.jobs)
        search = replace(search, model=settings.model, robust=settings.robust)
        exploration = explore(turned(scene, high + _BEYOND), settings=search)
        rows = exploration.results
        standing = rows.loc[rows["status"].isin(_CARRY) & rows["stands_at_zero"].ne(False), "labelling"]
        if standing.empty:
            return high + _BEYOND if exploration.summary.proven else None
        text = str(standing.iloc[0])
        if text in angles:
            return None
        angles[text] = _angle(*cut(done.assembly, text), settings.model)
    return None
