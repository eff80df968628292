"""Solve one scene for the labels, materials and loads that the page requests."""

from __future__ import annotations

import json
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.build.assemble import build_geometry
from jld_core.errors import InputError
from jld_core.models.case_analysis import CaseAnalysis
from jld_core.scene import Scene, parse_scene
from jld_core.scene.cracks import FieldCracks
from jld_core.sub_assembly import faces_of, with_members
from jld_explore.report.page_data import loads_of, solution_of
from jld_explore.space import LETTERS, SearchSpace, from_string, search_space
from jld_explore.space.reasons import reasons_against
from jld_explore.studio.field_brackets import FieldBrackets

KEPT: Final = 16
"""Number of cached assemblies; the cache key contains all changes except labels."""

CHANGEABLE: Final = ("materials", "loads")
"""Parts of a scene besides labels that a page may change; the geometry is fixed."""


@dataclass(frozen=True)
class ScenarioCache:
    """Scene with the materials and loads of one state of the page, ready to be solved.

    Attributes
    ----------
    scene : Scene
        Scene with these materials and loads.
    assembly : Assembly
        Its assembly.
    space : SearchSpace or None
        Its search space, None if the scene cannot be searched.
    solver : CaseAnalysis
        Its solver.
    """

    scene: Scene
    assembly: Assembly
    space: SearchSpace | None
    solver: CaseAnalysis


class StudioSession:
    """Solver of labellings of one scene under changing materials and loads; thread-safe.

    Parameters
    ----------
    scene : Scene
        Scene of the studio; its geometry is fixed.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
        self._kept: OrderedDict[str, ScenarioCache] = OrderedDict()
        self._turn = threading.RLock()
        self._brackets = FieldBrackets()
        self._geometry = build_geometry(scene)
        self._first: ScenarioCache | None = None
        self._first = self.setup({})

    def setup(self, changes: Mapping[str, Any]) -> ScenarioCache:
        """Return the scene with changed materials and loads, ready to be solved.

        changes: new values of the keys "materials" and "loads"; {} for the scene itself. The last few are stored.
        Raises InputError for another key, or an invalid scene.
        """
        for key in changes:
            if key not in CHANGEABLE:
                raise InputError(key, "the studio does not change it", " or ".join(CHANGEABLE))
        name = json.dumps(changes, sort_keys=True)
        with self._turn:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
            scene = parse_scene({**self.document, **changes}) if changes else self.scene
            assembly = build_assembly(scene, self._geometry)
            made = self._kept[name] = ScenarioCache(
                scene, assembly, self._space(scene, assembly), CaseAnalysis(assembly)
            )
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return made

    def _space(self, scene: Scene, assembly: Assembly) -> SearchSpace | None:
        """Return the search space; only changed weights require a new one."""
        if self._first is not None and np.array_equal(assembly.elements.weight, self._first.assembly.elements.weight):
            return self._first.space
        try:
            return search_space(scene, assembly)
        except InputError:
            return None  # the scene cannot be searched but can still be solved

    def labels(self, letters: object) -> Bits:
        """Convert letters d and i, one per face, to labels (m,), True = dry.

        Raises InputError for anything else.
        """
        assembly = self.setup({}).assembly
        count = assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip(LETTERS):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d or i")
        return with_members(assembly, from_string(letters))

    def solve(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Solve a labelling under changed materials and loads, and return JSON data for the page.

        letters: d and i, one per face. changes: as in `setup`. The entries are "solution", "loads", "against" (why a
        search would not admit the labelling, None without a search space) and "seconds". Raises InputError for invalid
        arguments.
        """
        start = time.perf_counter()
        setup = self.setup(changes)
        labels = self.labels(letters)
        found = setup.solver.solve(labels)
        solved = time.perf_counter()
        against = None if setup.space is None else reasons_against(setup.space, labels)
        return {
            "solution": solution_of(found),
            "loads": loads_of(setup.assembly),
            "against": against,
            "seconds": {"solve": solved - start, "total": time.perf_counter() - start},
        }

    def fields(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return bounds by fields on λ of a labelling, refined by one mesh at each call.

        letters, changes: as in `solve`. The entries are those of `FieldBrackets.step`.
        """
        setup, cracks = self.setup(changes), self.scene.cracks
        gap = cracks.gap if isinstance(cracks, FieldCracks) else FieldCracks(kind="fields").gap
        return self._brackets.step(setup.assembly, self.labels(letters), gap)

    def scene_with(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the scene file of a labelling under changed materials and loads, as a document.

        letters, changes: as in `solve`. Labels are written by pairs of elements. Raises InputError if a scene file
        cannot hold them, for instance where two faces of a pair differ.
        """
        setup, labels = self.setup(changes), self.labels(letters)
        document = setup.scene.model_dump(mode="json", exclude_defaults=True)
        ids, faces = setup.assembly.elements.ids, faces_of(setup.assembly).interfaces
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
