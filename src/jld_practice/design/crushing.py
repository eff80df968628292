"""Searches and moves of a design by faces: with the crushing that blocks show by fields."""

from __future__ import annotations

import math
from typing import Any

from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.fields.material import material_of
from jld_core.fields.requirements import require_fields
from jld_core.scene import Scene, parse_scene


def uniaxial_strength(scene: Scene) -> float:
    """Return the stress at which the blocks of a planar scene fail in uniaxial compression.

    It follows from (9.1) of docs/method.md: 2 c (μi + √(1 + μi²)), with c the shear strength and μi the friction of
    inner faces, or the compressive strength if that is less. Raises InputError as `material_of` does.
    """
    material = material_of(build_assembly(scene))
    sheared = 2.0 * material.cohesion * (material.friction + math.hypot(1.0, material.friction))
    return min(sheared, material.crushing)


def why_no_fields(assembly: Assembly) -> str:
    """Return the reason why bounds by fields do not apply to a structure; "" where they do."""
    try:
        require_fields(assembly)
    except InputError as error:
        return error.problem
    return ""


def with_crushing(scene: Scene, share: float = 1.0) -> Scene:
    """Return a planar scene whose faces crush at a share of the uniaxial strength of its blocks.

    By faces a hinge is a point, which carries any force. Where blocks crack anywhere it needs a width, and a layout
    that is chosen without it may lose half of its load factor. A lower compressive strength of the scene stays. Raises
    InputError as `uniaxial_strength` does.
    """
    strength = share * uniaxial_strength(scene)
    document = scene.model_dump(mode="json", exclude_defaults=True)
    for name in ("dry", "inner"):
        material: dict[str, Any] = document["materials"].setdefault(name, {})
        given = material.get("compressive_strength")
        low = given.get("nominal", strength) if isinstance(given, dict) else given
        material["compressive_strength"] = strength if low is None else min(strength, float(low))
    return parse_scene(document, scene.name)


def with_materials_of(scene: Scene, stated: Scene) -> Scene:
    """Return a scene with the materials of another one.

    stated: scene whose materials are taken.
    """
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["materials"] = stated.model_dump(mode="json", exclude_defaults=True)["materials"]
    return parse_scene(document, scene.name)
