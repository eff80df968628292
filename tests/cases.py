"""Small planar grids that between them meet every status and every way to a proof."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core import Assembly, Scene, build_assembly, parse_scene
from jld_core.strengths import Route

Document = dict[str, Any]
ROOT_CELL = 0.1
ROUTE = Route("a test")
"""Who asks for strengths of faces."""


def dry_and_inner(density: float, friction: float, tension: float, shear: float, **keys: Any) -> Document:
    """The key "materials" of dry joints with friction and inner faces with two strengths; keys: gravity."""
    inner = {"tensile_strength": tension, "shear_strength": shear}
    return {"density": density, **keys, "dry": {"friction_coefficient": friction}, "inner": inner}


def grid_document(
    rows: list[str],
    *,
    tension: float = 2e4,
    shear: float = 2e4,
    friction: float = 0.75,
    live: list[Document] | None = None,
    crush_dry: float | None = None,
    crush_inner: float | None = None,
    cohesion: float = 0.0,
    inner_friction: float = 0.0,
    **search: Any,
) -> Document:
    """A scene document: cells of 0.1 m, 1400 kg/m³, horizontal body load unless said otherwise."""
    dry: Document = {"friction_coefficient": friction}
    inner: Document = {"tensile_strength": tension, "shear_strength": shear}
    if crush_dry is not None:
        dry["compressive_strength"] = crush_dry
    if crush_inner is not None:
        inner["compressive_strength"] = crush_inner
    if cohesion:
        dry["cohesion"] = cohesion
    if inner_friction:
        inner["friction_coefficient"] = inner_friction
    document: Document = {
        "name": "grid",
        "grid": {"cell": [ROOT_CELL, ROOT_CELL], "thickness": 0.1, "rows": rows},
        "materials": {"density": 1400, "dry": dry, "inner": inner},
        "loads": {"live": live or [{"body": [1, 0]}]},
    }
    if search:
        document["search"] = search
    return document


def all_inner(document: Document, default: str = "inner", **labels: Any) -> Document:
    """The document with all faces inner, those to supports too; with another default, or in `dry`, they stay."""
    built = build_assembly(parse_scene({**document, "labels": {"default": default, **labels}}))
    names, faces, support = built.elements.ids, built.interfaces, built.elements.support
    dry = [set(pair) for pair in labels.get("dry", [])]
    held = [[names[a], names[b]] for a, b in zip(faces.a, faces.b, strict=True) if support[a] or support[b]]
    held = [pair for pair in held if default == "inner" and set(pair) not in dry]
    return {**document, "labels": {"default": default, **labels, "inner": held}}


def grid_scene(rows: list[str], **kwargs: Any) -> Scene:
    """The same, validated."""
    return parse_scene(grid_document(rows, **kwargs))


def grid_assembly(rows: list[str], **kwargs: Any) -> Assembly:
    """The same, as an assembly."""
    return build_assembly(grid_scene(rows, **kwargs))


def every_layout(space: Any) -> Any:
    """All labellings (k, m) of a search space, as enumeration lists them."""
    from jld_explore.drivers import make_driver  # which tests of the core do not load

    none = np.empty((0, len(space.fixed)), dtype=bool)
    return np.concatenate([none, *(rows for rows, _ in make_driver("enumeration", space, 0).batches())])


DOWN = [{"element": "c2r0", "force": [0, -1]}]
CASES: dict[str, tuple[list[str], Document]] = {
    "wall": (["aaaa", "aaaa", "aaaa", "####"], {}),
    "beam": (["aaaaa", "aaaaa", "#...#"], {"live": DOWN}),
    "arch": (["#aaaaa#", "#aaaaa#"], {"live": DOWN}),
    "weak arch": (["#aaaaa#", "#aaaaa#"], {"tension": 1e3, "shear": 1e3, "live": DOWN}),
    "crushable arch": (["#aaaaa#", "#aaaaa#"], {"crush_dry": 5e4, "crush_inner": 5e4, "live": DOWN}),
    "arch with crushable joints": (["#aaaaa#", "#aaaaa#"], {"crush_dry": 5e4, "live": DOWN}),
    "crushable wall": (["aaaa", "aaaa", "aaaa", "####"], {"crush_dry": 1e4, "crush_inner": 1e5}),
    "no friction": (["aaa", "aaa", "###"], {"friction": 0.0}),
    "no shear strength": (["aaa", "aaa", "###"], {"shear": 0.0}),
    "no tensile strength": (["aaa", "aaa", "###"], {"tension": 0.0}),
    "overhang": (["aaaa", "a...", "#..."], {"live": [{"body": [0, -1]}]}),
    "lifted": (["aaa", "aaa", "###"], {"live": [{"body": [0, 1]}]}),
    "pressed": (["aaa", "aaa", "###"], {"live": [{"body": [0, -1]}]}),
    "very strong": (["aaa", "aaa", "###"], {"tension": 1e9, "shear": 1e9}),
    "mortar": (["aaa", "aaa", "###"], {"cohesion": 2e3, "friction": 0.4, "live": [{"body": [1, 0.4]}]}),
    "rough cracks": (["aaaa", "aaaa", "####"], {"inner_friction": 1.1, "tension": 4e3, "shear": 6e3, "friction": 0.5}),
    "rough arch": (["#aaaaa#", "#aaaaa#"], {"inner_friction": 0.6, "cohesion": 1e3, "crush_inner": 5e5, "live": DOWN}),
    "cantilever": (["#aaa", "#aaa"], {"tension": 3e5, "shear": 3e5, "live": [{"body": [0, -1]}]}),
}
