"""Solve one scene for labels, materials, loads and vertices that the page requests."""

from __future__ import annotations

import json
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, InputError, one_thread
from jld_core import assembly as structures
from jld_core.build import build_assembly, build_geometry
from jld_core.models import CaseAnalysis
from jld_core.scene import Scene, parse_scene
from jld_core.scene import cracks as scene_cracks
from jld_explore.report import columns, page_data
from jld_explore.space import LETTERS, SearchSpace, from_string, reasons_against, search_space
from jld_geometry.moved_scene import MovedScene
from jld_studio.collapse_loads import collapse_loads, texts_of_bounds
from jld_studio.field_brackets import FieldBrackets
from jld_studio.joint_vertices import JointVertices

KEPT: Final = 16
"""Number of cached assemblies; the cache key contains all changes except labels."""

SPACES: Final = 4
"""Number of cached search spaces; the key contains limits and weights."""

CHANGEABLE: Final = ("materials", "loads", "search", "vertices")
"""Parts of a scene besides labels that a page may change; "vertices" are those of joints of planar scenes."""

_SCENE: Final = "scene"  # name of the scene in messages, which a key of the page does not have


@dataclass(frozen=True)
class ScenarioCache:
    """Scene of one state of the page, with all objects that solve it."""

    scene: Scene  # scene with these materials, loads and vertices
    assembly: Assembly
    space: SearchSpace | None  # search space of the scene, None if the scene cannot be searched, or joints were moved
    refusal: InputError | None  # why the scene cannot be searched
    solver: CaseAnalysis  # solver of all load cases of the scene


class StudioSession:
    """Solver of labellings of one scene, whose materials, loads, limits and joints may change, not its elements."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
        self._kept: OrderedDict[str, ScenarioCache] = OrderedDict()
        self._turn = threading.RLock()
        self._brackets = FieldBrackets()
        self._geometry = build_geometry(scene)
        self._spaces: OrderedDict[tuple[str, bytes], SearchSpace | InputError] = OrderedDict()
        found = _joints(scene, self.setup({}).assembly)
        self.joints = found if isinstance(found, JointVertices) else None
        self._fixed = found if isinstance(found, InputError) else None
        self._mover: tuple[str, MovedScene] | None = None

    def setup(self, changes: Mapping[str, Any]) -> ScenarioCache:
        """Return the scene with changed materials, loads and vertices, ready to be solved."""
        for key in changes:
            if key not in CHANGEABLE:
                raise InputError(key, "the studio does not change it", " or ".join(CHANGEABLE))
        name = json.dumps(changes, sort_keys=True)
        with self._turn:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
            scene, moved = self._changed(changes)
            assembly = build_assembly(scene, None if moved else self._geometry)
            # a search admits by weights and shapes, which take longer to look at than a drag may last
            found = None if moved else self._space(scene, assembly)
            space, refusal = (None, found) if isinstance(found, InputError) else (found, None)
            made = self._kept[name] = ScenarioCache(scene, assembly, space, refusal, CaseAnalysis(assembly))
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return made

    def _changed(self, changes: Mapping[str, Any]) -> tuple[Scene, bool]:
        """Return the scene with changes as in `setup`, and True if its vertices moved."""
        plain = {key: value for key, value in changes.items() if key != "vertices"}
        scene = parsed({**self.document, **plain}) if plain else self.scene
        if not changes.get("vertices"):
            return scene, False
        joints = self._movable()
        places, name = joints.placed(changes["vertices"]), json.dumps(plain, sort_keys=True)
        if self._mover is None or self._mover[0] != name:
            self._mover = name, joints.mover(scene, self.setup({}).assembly.labels)
        return self._mover[1].at(places), True

    def edited(self, changes: Mapping[str, Any], part: object) -> dict[str, Any]:
        """Return the new value of a changed part as in a scene file, with numbers for texts.

        InputError names its key.
        """
        if part not in CHANGEABLE[:3]:
            raise InputError("part", f"there is no {str(part)[:40]!r}", ", ".join(CHANGEABLE[:3]))
        setup = self.setup(changes)
        if part == "search" and setup.refusal is not None:
            raise setup.refusal
        found: dict[str, Any] = setup.scene.model_dump(mode="json", exclude_defaults=True).get(str(part), {})
        return found

    def _movable(self) -> JointVertices:
        """Return the vertices that may move; raise InputError, which says why, if there are none."""
        if self.joints is None:
            problem = "no vertex of this scene moves" + (f" ({self._fixed})" if self._fixed else "")
            raise InputError("vertices", problem, "a planar scene with joints that may move")
        return self.joints

    def _space(self, scene: Scene, assembly: Assembly) -> SearchSpace | InputError:
        """Return the search space of a scene, or why there is none; the scene can still be solved."""
        # A space is used again unless limits or weights differ.
        key = scene.search.model_dump_json(), assembly.elements.weight.tobytes()
        if key not in self._spaces:
            try:
                self._spaces[key] = search_space(scene, assembly)
            except InputError as error:
                self._spaces[key] = error
        self._spaces.move_to_end(key)
        while len(self._spaces) > SPACES:
            self._spaces.popitem(last=False)
        return self._spaces[key]

    def labels(self, letters: object) -> Bits:
        """Convert letters d and i, one per face, to labels (m,), True = dry."""
        assembly = self.setup({}).assembly
        count = assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip(LETTERS):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d or i")
        return structures.with_members(assembly, from_string(letters))

    @one_thread()
    def solve(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Solve a labelling (letters d and i) under changes, and return JSON data for the page.

        "against", reasons why a search would not admit it, and "candidates", faces that it chooses, are None without a
        space, "unsearched" says why.
        """
        start = time.perf_counter()
        setup = self.setup(changes)
        labels = self.labels(letters)
        found = setup.solver.solve(labels)
        solved = time.perf_counter()
        space, count = setup.space, setup.assembly.faces
        against = None if space is None else reasons_against(space, labels)
        return {
            "solution": page_data.solution_of(found),
            "cases": page_data.cases_of(setup.assembly),
            "loads": page_data.loads_of(setup.assembly),
            "collapse": collapse_loads(setup.scene, setup.assembly, found),
            "bodies": _bodies(setup.assembly),
            "against": against,
            "candidates": None if space is None else space.candidates[:count].tolist(),
            "unsearched": None if setup.refusal is None else str(setup.refusal),
            "seconds": {"solve": solved - start, "total": time.perf_counter() - start},
        }

    def improve(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Move joints by some steps of `jld move` from a state of the page."""
        setup, joints = self.setup(changes), self._movable()
        places = joints.placed(changes.get("vertices") or {})
        return joints.improved(setup.scene, setup.assembly, self.labels(letters), places)

    def fields(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return bounds by fields on λ of a labelling, refined by one mesh at each call."""
        setup, cracks = self.setup(changes), self.scene.cracks
        gap = (
            cracks.gap if isinstance(cracks, scene_cracks.FieldCracks) else scene_cracks.FieldCracks(kind="fields").gap
        )
        found = self._brackets.step(setup.assembly, self.labels(letters), gap)
        if "cases" in found:
            found["collapse"] = texts_of_bounds(setup.scene, setup.assembly, found["cases"])
        return found

    def scene_with(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the scene file of a state of the page as a document."""
        setup, labels = self.setup(changes), self.labels(letters)
        if changes.get("vertices"):
            joints = self._movable()
            scene, _ = self._changed({key: value for key, value in changes.items() if key != "vertices"})
            moved = joints.scene(scene, labels, joints.placed(changes["vertices"]))
            return moved.model_dump(mode="json", exclude_defaults=True)
        document = setup.scene.model_dump(mode="json", exclude_defaults=True)
        ids, faces = setup.assembly.elements.ids, structures.faces_of(setup.assembly).interfaces
        pairs: dict[tuple[str, str], set[bool]] = {}
        for a, b, dry in zip(faces.a, faces.b, labels[: len(faces)].tolist(), strict=True):
            pairs.setdefault((ids[a], ids[b]), set()).add(dry)
        mixed = [pair for pair, found in pairs.items() if len(found) > 1]
        if mixed:
            raise InputError("labels", f"the faces between {mixed[0][0]} and {mixed[0][1]} differ", "one label a pair")
        for contact in document.get("interfaces", []):
            contact.pop("label", None)
        document["labels"] = {
            "dry": [list(pair) for pair, found in pairs.items() if found == {True}],
            "inner": [list(pair) for pair, found in pairs.items() if found == {False}],
        }
        written = build_assembly(parse_scene(document))
        if not np.array_equal(written.labels, labels):
            raise InputError("labels", "this scene cannot hold these labels", "labels that no other key overrides")
        return document


def parsed(document: dict[str, Any]) -> Scene:
    """Return the scene of a document."""
    try:
        return parse_scene(document, _SCENE)
    except InputError as error:
        raise InputError(error.where.removeprefix(f"{_SCENE}: "), error.problem, error.expected) from None


def _joints(scene: Scene, assembly: Assembly) -> JointVertices | InputError | None:
    """Return the vertices of a scene that may move, or why none may; None in space."""
    if assembly.dimension != 2:
        return None
    try:
        return JointVertices(scene, assembly)
    except InputError as error:
        return error  # the page then has no such tool


def _bodies(assembly: Assembly) -> dict[str, Any]:
    """Return "centroids" and "weights" of all elements, as `structure_of` has them."""
    elements = assembly.elements
    weight = np.linalg.norm(elements.weight, axis=1)
    return {"centroids": columns.rounded(elements.centroid), "weights": columns.rounded(weight, columns.DIGITS)}
