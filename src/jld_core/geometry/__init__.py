"""Geometry of elements: polygons, polyhedra, contact detection, snapping and congruence.

- `Faces`: faces of one polyhedron, as loops of vertex indices
- `Outlines`: factory of the outlines of blocks of one assembly
- `area_of`: return the polygons of a plane region
- `area_vector`: return the area vector of a plane polygon
- `facets_of`: compute the plane facets of polyhedra
- `find_planar_contacts`: find the straight contacts of polygons
- `find_spatial_contacts`: find the plane contacts of polyhedra
- `merge_points`: number points, merging those within a tolerance
- `moment_about`: compute arm × force in the plane or in space
- `near_pairs`: find pairs of boxes that touch or overlap
- `reach_of`: return half the largest distance at which two corners of blocks coincide
- `snap_solids`: close gaps between polyhedra
- `solids`: orient faces outward and compute volumes and centroids of polyhedra
- `spun`: compute spin × arm in the plane or in space
"""

from __future__ import annotations

from jld_core.geometry.clean_regions import area_of
from jld_core.geometry.outlines import Outlines, reach_of
from jld_core.geometry.planar_contacts import find_planar_contacts
from jld_core.geometry.polyhedra import Faces, facets_of, solids
from jld_core.geometry.snapping import snap_solids
from jld_core.geometry.spatial_contacts import find_spatial_contacts, merge_points, near_pairs
from jld_core.geometry.vectors import area_vector, moment_about, spun

__all__ = [
    "Faces",
    "Outlines",
    "area_of",
    "area_vector",
    "facets_of",
    "find_planar_contacts",
    "find_spatial_contacts",
    "merge_points",
    "moment_about",
    "near_pairs",
    "reach_of",
    "snap_solids",
    "solids",
    "spun",
]
