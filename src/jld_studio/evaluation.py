"""Answer requests of other programs with a whole scene: λ, forces and mechanism."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from jld_core import InputError, build_assembly, one_thread, parse_scene, solve
from jld_core import assembly as structures
from jld_explore.space import LETTERS, from_string, to_string

KEYS = ("scene", "labelling")
"""Entries of a request."""


@one_thread()
def evaluate(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Solve a scene as another program states it, and return JSON data."""
    start = time.perf_counter()
    unknown = sorted(set(asked) - set(KEYS))
    if unknown:
        raise InputError(unknown[0], "the request has no such entry", " or ".join(KEYS))
    if not isinstance(asked.get("scene"), dict):
        raise InputError("scene", "it is no JSON object", "a scene document")
    assembly = build_assembly(parse_scene(asked["scene"], ""))
    labels = assembly.labels
    letters = asked.get("labelling")
    if letters is not None:
        count = assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip(LETTERS):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d or i")
        labels = structures.with_members(assembly, from_string(letters))
    result = solve(assembly, labels)
    found, elements = result.to_json(), result.assembly.elements
    found["labelling"] = to_string(labels[: assembly.faces])
    found["centroids"] = dict(zip(elements.ids, elements.centroid.tolist(), strict=True))
    found["seconds"] = {**found["seconds"], "answer": time.perf_counter() - start}
    return found
