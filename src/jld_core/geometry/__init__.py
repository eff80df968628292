"""Geometry of elements: polygons, polyhedra, contact detection, snapping and congruence.

- `Faces`: faces of one polyhedron, as loops of vertex indices
- `across`: return two axes of a plane that form a right-handed frame with its normal
- `area_of`: return the polygons of a plane region
- `area_vector`: return the area vector of a plane polygon
- `facets_of`: compute the plane facets of polyhedra
- `merge_points`: number points, merging those within a tolerance
- `moment_about`: compute arm × force in the plane or in space
- `outlines`: outlines of blocks: boundary of the union of elements, aspect ratio, re-entrant corners
- `planar_contacts`: contacts of polygons, found or stated
- `polyhedra`: plane facets, volumes and distances of polyhedra
- `snapping`: vertices that nearly meet, moved together
- `solids`: orient faces outward and compute volumes and centroids of polyhedra
- `spatial_contacts`: contacts of polyhedra
- `spun`: compute spin × arm in the plane or in space
- `stated_fit`: how well faces that a scene states fit its elements
- `unions`: union of the cells of one block, as one outline or one closed surface
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.geometry.clean_regions import area_of
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
    {
        "vectors": ["across"],
    },
    submodules=["outlines", "planar_contacts", "polyhedra", "snapping", "spatial_contacts", "stated_fit", "unions"],
)
