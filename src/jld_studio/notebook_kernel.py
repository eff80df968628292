"""Solve layouts again under the materials that the sliders of a notebook state."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Protocol

import numpy as np

from jld_core import FACTS, Assembly, InputError, Route
from jld_core import assembly as structures
from jld_core.build import build_assembly, build_geometry
from jld_core.limit import SolveOptions
from jld_core.models import CaseAnalysis
from jld_core.scene import Scene, parse_scene, standard
from jld_explore.report import page_contract, page_data
from jld_explore.space import cut, from_string

_ROUTE: Final = Route("sliders of materials", frozenset(FACTS))  # faces with a criterion have none

_KEPT: Final = 8  # number of materials whose analyses are stored

# Field of `Strengths` of each material value that a slider may state
_STRENGTHS: Final = {(one.label, one.key): one.field for one in standard.PARAMETERS}


class Structure(Protocol):
    """Structure whose materials can be changed."""

    materials: dict[str, Any]
    """Its materials, in the form of a scene file."""

    def with_materials(self, materials: Mapping[str, Any]) -> Assembly:
        """Return its assembly under other materials; raise InputError if they are invalid."""


class SceneStructure:
    """Scene whose materials can be changed; its geometry is built once."""

    def __init__(self, scene: Scene) -> None:
        self._document = scene.model_dump(mode="json", exclude_defaults=True)
        self._geometry = build_geometry(scene)
        self.materials: dict[str, Any] = self._document.get("materials", {})

    def with_materials(self, materials: Mapping[str, Any]) -> Assembly:
        """Return the assembly of the scene under other materials; raise InputError if they are invalid."""
        return build_assembly(parse_scene({**self._document, "materials": dict(materials)}), self._geometry)


class AssemblyStructure:
    """Assembly without its scene; a slider's value is the median over faces, which keep their ratio to it."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self.materials: dict[str, Any] = {}
        strengths = assembly.strengths(_ROUTE)
        for (part, key), name in _STRENGTHS.items():
            values = getattr(strengths, name)[: assembly.faces]
            stated = values[np.isfinite(values)]
            if stated.size and float(np.median(stated)) > 0.0:
                self.materials.setdefault(part, {})[key] = float(np.median(stated))

    def with_materials(self, materials: Mapping[str, Any]) -> Assembly:
        """Return the assembly with scaled strengths; raise InputError for a value that is no positive number."""
        assembly = self._assembly
        factors = {}
        for (part, key), name in _STRENGTHS.items():
            usual = self.materials.get(part, {}).get(key)
            if usual is None:
                continue
            value = materials.get(part, {}).get(key, usual)
            if not (isinstance(value, int | float) and np.isfinite(value) and value >= 0.0):
                raise InputError(f"materials.{part}.{key}", f"it is {value!r}", "a number of at least 0")
            factors[name] = float(value) / usual
        faces = np.arange(len(assembly.interfaces)) < assembly.faces
        return replace(assembly, face_strengths=assembly.face_strengths.scaled(factors, faces))


def bonded(assembly: Assembly) -> bool:
    """Return True if dry joints have a bond, which couples strengths and dead loads."""
    return assembly.members.bond is not None


def structure_of(scene: Scene | None, assembly: Assembly) -> Structure:
    """Return the structure of an assembly whose materials can be changed."""
    if scene is None or assembly.has_low_values:
        return AssemblyStructure(assembly)
    found = SceneStructure(scene)
    values = [value for part in ("dry", "inner") for value in found.materials.get(part, {}).values()]
    plain = all(isinstance(value, int | float) for value in values)
    return found if plain else AssemblyStructure(assembly)


class LayoutSolver:
    """Solver of layouts of one structure under changing materials.

    structure: structure with its materials. model: model of all solves.
    """

    def __init__(self, structure: Structure, model: SolveOptions | None = None) -> None:
        self._structure, self._model = structure, model
        self._kept: OrderedDict[str, CaseAnalysis] = OrderedDict()

    def solve(self, letters: object, materials: object) -> page_contract.Solution:
        """Solve a layout (letters d, i and v) under materials of a scene file; return what a page draws."""
        if not isinstance(materials, dict):
            raise InputError("materials", "they are no JSON object", "materials as in a scene file")
        name = json.dumps(materials, sort_keys=True)
        if name not in self._kept:
            self._kept[name] = CaseAnalysis(self._structure.with_materials(materials), self._model)
        self._kept.move_to_end(name)
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        analysis = self._kept[name]
        count = analysis.assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip("div"):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d, i or v")
        if "v" in letters:
            rest, labels = cut(analysis.assembly, letters)
            return page_data.within(
                page_data.solution_of(CaseAnalysis(rest, self._model).solve(labels)), analysis.assembly, letters
            )
        return page_data.solution_of(analysis.solve(structures.with_members(analysis.assembly, from_string(letters))))
