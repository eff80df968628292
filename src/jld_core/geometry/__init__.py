"""Geometry of elements: polygons, polyhedra, contact detection, snapping and congruence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.geometry.outlines import area_of
from jld_core.geometry.polyhedra import Faces, facets_of, solids
from jld_core.geometry.spatial_contacts import merge_points
from jld_core.geometry.vectors import area_vector, moment_about, spun
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.geometry import outlines, planar_contacts, polyhedra, snapping, spatial_contacts, stated_fit, unions
    from jld_core.geometry.vectors import across

__all__ = [
    "Faces",
    "across",
    "area_of",
    "area_vector",
    "facets_of",
    "merge_points",
    "moment_about",
    "outlines",
    "planar_contacts",
    "polyhedra",
    "snapping",
    "solids",
    "spatial_contacts",
    "spun",
    "stated_fit",
    "unions",
]

export_lazily(
    __name__,
    {"vectors": ["across"]},
    submodules=["outlines", "planar_contacts", "polyhedra", "snapping", "spatial_contacts", "stated_fit", "unions"],
)
