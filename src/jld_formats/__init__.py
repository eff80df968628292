"""File formats of other programs (group ``jld.formats``).

- `COMPAS`: assemblies of COMPAS
- `COMPAS_DEM`: block models of compas_dem
- `GLTF`: pictures in space
- `IFC`: building models
- `RHINO`: files of Rhino
- `STEP`: solids of CAD programs
- `THREE_DEC`: commands of 3DEC
- `VTK`: grids for ParaView
"""

from __future__ import annotations

from typing import Final

from jld_core.exchange import Format, formats

__all__ = ["COMPAS", "COMPAS_DEM", "GLTF", "IFC", "RHINO", "STEP", "THREE_DEC", "VTK"]

_NAMED: Final = (*formats.OUTLINES, "thickness", "name")

_WEIGHED: Final = (*formats.OUTLINES, *formats.WEIGHTS, "thickness", "elements.support")

COMPAS: Final = Format(
    "compas",
    ".json",
    formats.by("jld_formats.read_dem", "read_compas"),
    ("json",),
    write=formats.of_text("jld_formats.write_compas", "compas_text"),
    cells=(2, 3),
    members=False,
    keeps=formats.OF_BLOCKS,
    keeps_of_cells=("interfaces",),
    whole=frozenset({(3, True)}),
    labels=frozenset({(2, True), (3, True)}),
)
COMPAS_DEM: Final = Format(
    "compas_dem",
    ".json",
    write=formats.of_text("jld_formats.write_dem", "dem_text"),
    cells=(2, 3),
    analysed=True,
    members=False,
    keeps=(*_WEIGHED, *formats.FORCES, "loads.cases.name"),
)
GLTF: Final = Format(
    "gltf",
    ".glb",
    write=formats.of_text("jld_formats.write_vtk", "gltf_bytes"),
    cells=(2, 3),
    unit="metres",
    analysed=True,
    keeps=_NAMED,
)
IFC: Final = Format(
    "ifc",
    ".ifc",
    formats.by("jld_formats.read_ifc", "read_ifc"),
    ("ifc",),
    "ifcopenshell",
    formats.by("jld_formats.write_ifc", "write_ifc"),
    cells=(2, 3),
    unit="any",
    analysed=True,
    keeps=_NAMED,
)
RHINO: Final = Format(
    "3dm",
    ".3dm",
    formats.by("jld_formats.read_rhino", "read_rhino"),
    ("3dm",),
    "rhino3dm",
    formats.by("jld_formats.write_rhino", "write_rhino"),
    cells=(3,),
    unit="any",
    analysed=True,
    keeps=formats.OF_BLOCKS,
    whole=formats.PLANAR | {(3, True)},
    labels=formats.PLANAR,
)
STEP: Final = Format(
    "step",
    ".step",
    formats.by("jld_formats.read_step", "read_step"),
    ("step", "stp", "p21"),
    write=formats.of_text("jld_formats.write_step", "step_text"),
    cells=(2, 3),
    unit="any",
    keeps=(*_NAMED, "elements.support"),
)
THREE_DEC: Final = Format(
    "3dec",
    ".dat",
    write=formats.of_text("jld_formats.write_step", "command_text"),
    members=False,
    keeps=(*_WEIGHED, "name", "materials.gravity"),
)
VTK: Final = Format("vtk", ".vtu", write=formats.by("jld_formats.write_vtk", "write_vtk"), analysed=True, keeps=_NAMED)
