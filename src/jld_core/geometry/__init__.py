"""Polygons, polyhedra, and where they touch. Knows no Assembly."""

from __future__ import annotations

from jld_core.geometry.congruence import Shape, congruent, shape_numbers
from jld_core.geometry.misfits import NearMiss, Overlap, refuse_overlaps, words_of
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
from jld_core.geometry.snapping_solids import SnappedSolids, snap_solids
from jld_core.geometry.spatial_contacts import (
    SpatialContact,
    find_spatial_contacts,
    given_normals,
    near_pairs,
    near_solids,
    spatial_interfaces,
)
from jld_core.geometry.unions import Region, Surface, extrude, region_of, union_outlines, union_solids

__all__ = [
    "Faces",
    "Facets",
    "NearMiss",
    "Overlap",
    "PlanarContact",
    "Region",
    "Shape",
    "Snapped",
    "SnappedSolids",
    "SpatialContact",
    "Surface",
    "check_overlaps",
    "check_polygons",
    "congruent",
    "extrude",
    "facets_of",
    "find_planar_contacts",
    "find_spatial_contacts",
    "given_normals",
    "merge_points",
    "near_misses",
    "near_pairs",
    "near_solids",
    "planar_interfaces",
    "rectangle_torsion_length",
    "refuse_overlaps",
    "region_of",
    "shape_numbers",
    "snap_paths",
    "snap_polygons",
    "snap_solids",
    "solids",
    "spatial_interfaces",
    "straight",
    "union_outlines",
    "union_solids",
    "without_repeats",
    "words_of",
]
