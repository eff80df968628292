"""Geometric factor of safety (Heyman): thickness over the least thickness at which a structure stands."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits, InputError, Model, ParameterError, Scene, build_assembly, parse_scene
from jld_core.mechanics import require_materials
from jld_core.models import limit_analysis
from jld_maps.middle import Middles, middles_of

_TOLERANCE: Final = 1e-6  # relative width of the bracket to aim at
_FIRST: Final = ((1.0, 2.0, 4.0, 8.0), tuple(0.5**k for k in range(11)))  # scales tried where it falls, and stands
_PARTS: Final = (0.5, 0.4, 0.6, 0.25, 0.75)  # of a bracket, tried in turn where it is not decided whether it stands


@dataclass(frozen=True)
class GeometricSafety:
    """Thickness of a structure over its least one, as a bracket; NaN for an end that is not proven."""

    factor: tuple[float, float]
    # least scale of the thickness: it falls at the first, and stands at the second
    scale: tuple[float, float]
    thickness: tuple[float, float]  # least and largest thickness, scene units
    across: str  # what is scaled

    def to_json(self) -> dict[str, Any]:
        ends = [None if math.isnan(one) else one for one in self.factor]
        least = [None if math.isnan(one) else one for one in self.scale]
        return {"factor": ends, "least_scale": least, "thickness": list(self.thickness), "across": self.across}

    def __str__(self) -> str:
        low, high = self.factor
        if math.isnan(high):
            return f"above {low:.6g}" if low == low else "unknown"
        return f"below {high:.6g}" if math.isnan(low) else f"{0.5 * (low + high):.6g} in [{low:.9g}, {high:.9g}]"


def geometric_safety(scene: Scene, labels: Bits, model: Model) -> GeometricSafety:
    """Compute the geometric factor of safety of one labelling under its dead loads.

    The structure is scaled across its middle line or surface; volumes and weights from a density follow. Raises
    InputError where it has no such line or surface, or for a model that is not of rigid elements with dilation.
    """
    assembly = build_assembly(scene)
    if (model.cracks or assembly.cracks) != "faces":
        raise ParameterError(
            "geometric", "thickness is scaled of blocks that crack along their faces", "cracks by faces"
        )
    if model.friction != "associative" or model.effective_area or model.contact != "convex":
        raise ParameterError("geometric", "it is for friction with dilation on whole faces", "no other model")
    middles = middles_of(assembly)
    document = _document(scene, assembly)

    def stands(scale: float) -> bool | None:
        try:
            other = build_assembly(parse_scene(_scaled(document, middles, assembly, scale)))
        except InputError:
            if scale == 1.0:
                raise
            return None  # what is too thick overlaps, what is too thin has no joints left
        orders = [np.lexsort(_pairs(one)) for one in (assembly, other)]
        if not np.array_equal(*(_pairs(one)[:, order] for one, order in zip((assembly, other), orders, strict=True))):
            raise InputError("elements", "other faces touch where the thickness is scaled", "blocks with whole joints")
        own = np.empty_like(labels)
        own[orders[1]] = labels[orders[0]]
        require_materials(other, own, ~own)
        found = [limit_analysis(case, model, single_labelling=True).stands(own) for case in other.by_case]
        return False if False in found else None if None in found else True

    fall, stand = math.nan, math.nan
    first = stands(1.0)
    for scale in _FIRST[bool(first)]:
        found = first if scale == 1.0 else stands(scale)
        if found is None:
            break
        fall, stand = (fall, scale) if found else (scale, stand)
        if found != first:
            break
    while stand - fall > _TOLERANCE * stand:
        for part in _PARTS:
            middle = fall + part * (stand - fall)
            if (found := stands(middle)) is not None:
                break
        if found is None:
            break
        fall, stand = (fall, middle) if found else (middle, stand)
    return GeometricSafety((1.0 / stand, 1.0 / fall), (fall, stand), middles.thickness, middles.across)


def _pairs(assembly: Assembly) -> Any:
    """Return the larger and smaller element (2, m) of each face."""
    ends = np.stack([assembly.interfaces.a, assembly.interfaces.b])
    return np.stack([ends.max(axis=0), ends.min(axis=0)])


def _document(scene: Scene, assembly: Assembly) -> dict[str, Any]:
    """Return a scene of elements under its dead loads: live loads, which have places, become one force."""
    document = scene.model_dump(mode="json", exclude_unset=True)
    grid, elements = document.pop("grid", None), assembly.elements
    if grid is not None:
        document["thickness"] = grid.get("thickness", 1.0)
        document["elements"] = [
            {"id": name, "polygon": [], "support": bool(one)}
            for name, one in zip(elements.ids, elements.support, strict=True)
        ]
    loads, force = document["loads"], [1.0, *[0.0] * (assembly.dimension - 1)]
    live = [{"element": elements.ids[elements.free[0]], "force": force}]
    cases = [{**case, "live": live} for case in loads.get("cases", ()) if case.get("dead")]
    own = {"cases": cases} if cases else {"live": live}
    document["loads"] = own | ({"dead": loads["dead"]} if "dead" in loads else {})
    for name in ("labels", "search", "move", "settlements"):
        document.pop(name, None)
    return document


def _scaled(document: dict[str, Any], middles: Middles, assembly: Assembly, scale: float) -> dict[str, Any]:
    """Return a scene with its thickness scaled."""
    changed, elements = deepcopy(document), assembly.elements
    for k, (entry, points) in enumerate(zip(changed["elements"], elements.shape, strict=True)):
        key = "polygon" if assembly.dimension == 2 else "vertices"
        entry[key] = middles.scaled(k, points, scale).tolist()
        if elements.faces:
            entry["faces"] = [list(face) for face in elements.faces[k]]
        if "volume" in entry:
            entry["volume"] *= scale
    for entry in changed.get("interfaces") or ():
        free = next(k for k in map(elements.index.__getitem__, entry["elements"]) if not elements.support[k])
        entry["polygon"] = middles.scaled(free, np.array(entry["polygon"]), scale).tolist()
    return changed
