"""Searches and moves of a design by faces: with the crushing that blocks show by fields."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Deadline, InputError, Route
from jld_core.build import build_assembly
from jld_core.fields import bounds, problem
from jld_core.scene import Scene, parse_scene
from jld_practice.design.aligned import TriangleStresses


def uniaxial_strength(scene: Scene) -> float:
    """Return the stress at which blocks fail in uniaxial compression, docs/method.md (9.1)."""
    # 2 c (μi + √(1 + μi²)), c and μi of inner faces, or the compressive strength if less
    material = problem.material_of(build_assembly(scene))
    sheared = 2.0 * material.shear * (material.friction + math.hypot(1.0, material.friction))
    return min(sheared, material.crushing)


def why_no_fields(assembly: Assembly) -> str:
    """Return why bounds by fields do not apply to a structure; "" where they do."""
    try:
        problem.require_planar_fields(assembly)
    except InputError as error:
        return error.problem
    return ""


def with_crushing(scene: Scene, share: float = 1.0) -> Scene:
    """Return a planar scene whose faces crush at a share of the uniaxial strength of its blocks."""
    # By faces a hinge is a point, which carries any force. Where blocks crack anywhere it needs a width, and a layout
    # that is chosen without it may lose half of its load factor. A lower compressive strength of the scene stays.
    strength = share * uniaxial_strength(scene)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    for name in ("dry", "inner"):
        material: dict[str, Any] = document["materials"].setdefault(name, {})
        given = material.get("compressive_strength")
        low = given.get("nominal", strength) if isinstance(given, dict) else given
        material["compressive_strength"] = strength if low is None else min(strength, float(low))
    return parse_scene(document, scene.name)


def with_materials_of(scene: Scene, stated: Scene) -> Scene:
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"] = stated.model_dump(mode="json", exclude_defaults=True)["materials"]
    return parse_scene(document, scene.name)


_ROUTE: Final = Route("the stresses of an uncut body")

# Shares of the tensile strength that are tried: a weak body shows its thrust, but may not stand
_TENSION: Final = (0.1, 1.0)

_TRIANGLES: Final = 600  # number of triangles from which on a mesh is fine enough, as cells are several triangles wide


def stresses_of_body(assembly: Assembly, until: Deadline | None = None) -> TriangleStresses:
    """Compute the stresses of an uncut body under its governing load case at collapse."""
    # Stresses are those of the lower bound by fields, of a body with a tenth of its tensile strength: its compression
    # is the thrust that joints have to carry. If none is found, the strength is as stated.
    strengths = assembly.strengths(_ROUTE)
    for share in _TENSION:
        weak = assembly.with_strengths(replace(strengths, tension=share * strengths.tension))
        found = [_refined(case, until) for case in weak.by_case]
        # the case with the least lower bound governs
        lower = [one.lower / factor for one, factor in zip(found, assembly.required.tolist(), strict=True)]
        stresses = found[int(np.argmin([low if np.isfinite(low) else np.inf for low in lower]))].stresses
        if stresses is not None:
            mesh = stresses.mesh
            return TriangleStresses(mesh.points, mesh.simplices, stresses.stress.mean(axis=1))
    raise InputError("", "no stresses of the uncut body keep equilibrium with the loads", "a stronger stone")


def _refined(assembly: Assembly, until: Deadline | None) -> bounds.FieldBounds:
    """Return the bounds by fields of a structure under one load case, with their stresses."""
    refinement = bounds.FieldRefinement(assembly, assembly.labels, lower_first=True)
    found = refinement.step()
    while not refinement.ended and refinement.simplices <= _TRIANGLES and not (until is not None and until.passed()):
        found = refinement.step(False)
    return found
