"""Geometry of elements: polygons, polyhedra, contact detection, snapping and congruence.

- `Faces`: faces of one polyhedron, as loops of vertex indices
- `Facets`: plane facets of all elements, as a struct of arrays
- `Kinds`: register that numbers outlines by shape
- `Outline`: boundary of one block
- `Outlines`: factory of the outlines of blocks of one assembly
- `PlanarContact`: straight contact of two polygons
- `Region`: plane area with holes
- `Snapped`: paths after snapping
- `SpatialContact`: plane contact of two polyhedra
- `Surface`: closed surface with plane faces and triangles
- `across`: return two axes of a plane
- `area_of`: return the polygons of a plane region
- `area_vector`: return the area vector of a plane polygon
- `check_overlaps`: refuse convex polyhedra that share a volume
- `check_polygons`: refuse polygons that are not simple, have no area or overlap
- `extrude`: extrude a plane region to a closed surface
- `facets_of`: compute the plane facets of polyhedra
- `find_planar_contacts`: find the straight contacts of polygons
- `find_spatial_contacts`: find the plane contacts of polyhedra
- `fit_of_line`: measure the misfit of a stated straight contact
- `fit_of_polygon`: measure the misfit of a stated plane contact
- `frame`: return an orthonormal frame that starts with given vectors
- `given_normals`: compute the normals of stated plane contacts
- `judge_fit`: refuse a poor fit of a stated contact, or return a warning
- `merge_points`: number points, merging those within a tolerance
- `moment_about`: compute arm × force in the plane or in space
- `near_misses`: find edges of polygons that nearly touch
- `near_pairs`: find pairs of boxes that touch or overlap
- `near_solids`: find facets of polyhedra that nearly touch
- `planar_interfaces`: compute frames and sizes of straight contacts
- `reach_of`: return the distance within which two corners of blocks coincide
- `rectangle_torsion_length`: compute c_T of rectangles
- `refuse_crossing`: refuse a stated contact whose outline crosses itself
- `refuse_repeated`: refuse contacts that are stated twice
- `region_of`: convert a shapely polygon to a `Region`
- `shape_numbers`: number outlines by shape, from 1 by first appearance
- `snap_paths`: close gaps between open and closed paths
- `snap_polygons`: close gaps and overlaps between polygons
- `snap_solids`: close gaps between polyhedra
- `solids`: orient faces outward and compute volumes and centroids of polyhedra
- `spatial_interfaces`: compute frames and sections of plane contacts
- `spun`: compute spin × arm in the plane or in space
- `straight`: remove the corners of an outline that lie in straight edges
- `union_outlines`: unite polygons to regions, ordered from left to right
- `union_solids`: compute the outer surface of touching polyhedra
- `without_repeats`: remove consecutive repeated corners of outlines
- `words_of`: describe near misses in one sentence
"""

from __future__ import annotations

from jld_core.geometry.congruence import Kinds, shape_numbers
from jld_core.geometry.misfits import words_of
from jld_core.geometry.outlines import Outline, Outlines, reach_of
from jld_core.geometry.overlapping_solids import check_overlaps
from jld_core.geometry.overlay import area_of
from jld_core.geometry.planar_contacts import (
    PlanarContact,
    check_polygons,
    find_planar_contacts,
    near_misses,
    planar_interfaces,
    without_repeats,
)
from jld_core.geometry.polygons import rectangle_torsion_length
from jld_core.geometry.polyhedra import Faces, Facets, facets_of, solids
from jld_core.geometry.snapping import Snapped, merge_points, snap_paths, snap_polygons, straight
from jld_core.geometry.snapping_solids import snap_solids
from jld_core.geometry.spatial_contacts import (
    SpatialContact,
    find_spatial_contacts,
    near_pairs,
    near_solids,
)
from jld_core.geometry.spatial_interfaces import spatial_interfaces
from jld_core.geometry.stated_contacts import given_normals
from jld_core.geometry.stated_fit import fit_of_line, fit_of_polygon, judge_fit, refuse_crossing, refuse_repeated
from jld_core.geometry.unions import Region, Surface, extrude, region_of, union_outlines, union_solids
from jld_core.geometry.vectors import across, area_vector, frame, moment_about, spun

__all__ = [
    "Faces",
    "Facets",
    "Kinds",
    "Outline",
    "Outlines",
    "PlanarContact",
    "Region",
    "Snapped",
    "SpatialContact",
    "Surface",
    "across",
    "area_of",
    "area_vector",
    "check_overlaps",
    "check_polygons",
    "extrude",
    "facets_of",
    "find_planar_contacts",
    "find_spatial_contacts",
    "fit_of_line",
    "fit_of_polygon",
    "frame",
    "given_normals",
    "judge_fit",
    "merge_points",
    "moment_about",
    "near_misses",
    "near_pairs",
    "near_solids",
    "planar_interfaces",
    "reach_of",
    "rectangle_torsion_length",
    "refuse_crossing",
    "refuse_repeated",
    "region_of",
    "shape_numbers",
    "snap_paths",
    "snap_polygons",
    "snap_solids",
    "solids",
    "spatial_interfaces",
    "spun",
    "straight",
    "union_outlines",
    "union_solids",
    "without_repeats",
    "words_of",
]
