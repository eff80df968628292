"""Layouts with all lengths in another unit, for export."""

from __future__ import annotations

from dataclasses import replace

from jld_core.errors import ParameterError
from jld_core.exchange.layout import Layout
from jld_core.scene.units import METRES


def layout_in_unit(layout: Layout, unit: str) -> Layout:
    """Return a layout whose geometry is in another unit of length.

    Weights, forces and labels stay as they are. Scene data for re-import and the analysis are taken from
    `Layout.drawn_from`, the given layout. Raises ParameterError for an unknown unit, of the scene or the given one.
    """
    own = layout.assembly.units[0]
    if unit not in METRES:
        raise ParameterError("unit", f"no unit is named {unit!r}", "one of " + ", ".join(METRES))
    if own not in METRES:
        raise ParameterError(
            "unit", f"lengths of the scene are in {own!r}, which is unknown", "units.length of a scene"
        )
    factor = METRES[own] / METRES[unit]
    if factor == 1.0:
        return layout
    assembly = layout.assembly
    elements = replace(
        assembly.elements,
        centroid=factor * assembly.elements.centroid,
        volume=factor**3 * assembly.elements.volume,
        shape=tuple(factor * shape for shape in assembly.elements.shape),
    )
    faces = assembly.interfaces
    interfaces = replace(
        faces,
        origin=factor * faces.origin,
        l1=factor * faces.l1,
        l2=factor * faces.l2,
        area=factor**2 * faces.area,
        c_t=factor * faces.c_t,
        polygon=tuple(factor * polygon for polygon in faces.polygon),
    )
    scaled = replace(
        assembly,
        units=(unit, assembly.units[1]),
        elements=elements,
        interfaces=interfaces,
        dead_loads=assembly.dead_loads.stretched(factor),
        live_loads=assembly.live_loads.stretched(factor),
        cases=tuple(
            replace(case, dead_loads=case.dead_loads.stretched(factor), live_loads=case.live_loads.stretched(factor))
            for case in assembly.cases
        ),
    )
    return Layout(layout.scene, scaled, layout.labels, layout.result, layout)
