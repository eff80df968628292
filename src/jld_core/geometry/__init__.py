"""Polygons, polyhedra, and where they touch; outlines of blocks, and which are alike.

- `Faces`: faces of polyhedra
- `Facets`: plane facets of all elements, as arrays
- `Kinds`: outlines numbered by their shape as they come: each is compared with one of every kind so far
- `Outline`: one block's boundary
- `Outlines`: outlines of blocks of one assembly
- `PlanarContact`: a straight contact of two polygons
- `Region`: a plane area
- `Snapped`: paths after snapping
- `SpatialContact`: a plane contact of two polyhedra
- `Surface`: a closed surface
- `across`: axes of a plane
- `area_of`: what of a plane region has an area
- `area_vector`: of a plane polygon, along its normal
- `check_overlaps`: refuse polyhedra that share a volume
- `check_polygons`: refuse polygons that are not simple or cover one another
- `extrude`: an area in the plane → a solid
- `facets_of`: polyhedra → plane facets
- `find_planar_contacts`: where polygons touch
- `find_spatial_contacts`: where polyhedra touch
- `fit_of_line`: misfit of a stated straight contact and an element
- `fit_of_polygon`: misfit of a stated plane contact and an element
- `frame`: an orthonormal frame from its first vectors
- `given_normals`: normals of contacts that are given
- `judge_fit`: refuse a poor fit of a stated contact, or warn
- `merge_points`: points within a tolerance, as one
- `moment_about`: arm × force, in the plane or in space
- `near_misses`: edges that nearly touch
- `near_pairs`: boxes that touch or overlap
- `near_solids`: facets that nearly touch
- `planar_interfaces`: frames and sizes of straight contacts
- `reach_of`: distance within which corners of blocks of an assembly are one
- `rectangle_torsion_length`: c_T of rectangles
- `refuse_crossing`: refuse stated contacts whose outline crosses itself
- `refuse_repeated`: refuse contacts that are stated twice
- `region_of`: a polygon of shapely → Region
- `shape_numbers`: number of the shape of each entry, from 1 by first appearance
- `snap_paths`: close gaps between open and closed paths
- `snap_polygons`: close gaps and overlaps between polygons
- `snap_solids`: close gaps between polyhedra
- `solids`: polyhedra with faces outward, volumes and centroids
- `spatial_interfaces`: frames and sections of plane contacts
- `spun`: turn × arm, likewise
- `straight`: an outline without the corners in straight edges
- `union_outlines`: what polygons cover together, in parts from left to right
- `union_solids`: the outer surface of polyhedra that touch along parts of their faces
- `without_repeats`: outlines without corners given twice
- `words_of`: a sentence on faces that nearly touch
"""

from __future__ import annotations

from jld_core.geometry.congruence import Kinds, shape_numbers
from jld_core.geometry.misfits import words_of
from jld_core.geometry.outlines import Outline, Outlines, reach_of
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
from jld_core.geometry.polyhedra import Faces, Facets, check_overlaps, facets_of, solids
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
