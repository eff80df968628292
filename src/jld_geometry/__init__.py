"""Joints that move: derivatives of λ by geometry, optimisation, shapes of joints, bounds over boxes.

- `BoxStructure`: structure of a claim: exact outlines, joints, and loads of every case
- `EqualShapes`: equations that keep pairs of outlines equal, by squared distances of corners
- `FieldMesh`: mesh of one load case whose nodes are affine functions of the vertices of joints
- `FieldSearch`: search over positions of joints for the largest λ of blocks that may crack anywhere
- `GeometrySearch`: search for the best positions of the joints of one structure, by variables z (k,)
- `Incline`: joint turned about the middle of its face
- `Key`: trapezoidal key in the middle of a face; lengths relative to the face
- `MovedScene`: planar scene whose vertices, and points that name them, move; all else stays
- `Sine`: sine wave along a face
- `TrustRegion`: parameters of the trust region, lengths relative to the mean edge of the structure
- `box_claim`: return the claim of a certificate, its bound raised for rounding, and its nodes, each before its halves
- `check_boxes`: check the tree of a certificate; return its number of boxes with a mechanism
- `check_proof`: check a proof by exact arithmetic: whether it holds, None without one; seconds; and a reason
- `equal_corners`: pair equal outlines corner by corner: the first of each kind that changes with every other
- `explore_and_move`: alternate between a search of labels and the optimisation of joints, docs/method.md chapter 11
- `move_by_fields`: move joints to raise λ of blocks that may crack anywhere, docs/method.md (11.9); unproven
- `move_joints`: move joints to optimise the objective of the key "move", docs/method.md (11.6)
- `prove_box`: find the best geometry in a box of positions, and prove a bound on λ of all of them
- `shape_joints`: find the parameters of a shape, the same for all joints, with the largest λ by faces
- `shaped_scene`: return a scene whose dry faces have a shape, with stated interfaces
- `spatial_mesh`: find the vertices that the elements and interfaces of a spatial assembly share
- `verify_box`: check a certificate of `jld move --prove`; InputError for the first thing that does not hold
- `vertex_mesh`: find the vertices that the elements and interfaces of a planar assembly share
- `write_box_certificate`: write the certificate of a proof over a box of positions, for `jld verify`
- `write_moved`: write table, scene, picture and page of moved layouts; return the entry "moved"
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_geometry.box_bound import box_claim, check_proof, prove_box, write_box_certificate
    from jld_geometry.boxes import BoxStructure, check_boxes, verify_box
    from jld_geometry.convex_cells import EqualShapes, equal_corners, vertex_mesh
    from jld_geometry.field_search import FieldMesh, FieldSearch, move_by_fields
    from jld_geometry.joint_shapes import Incline, Key, Sine, shape_joints, shaped_scene
    from jld_geometry.moved_scene import MovedScene, spatial_mesh
    from jld_geometry.moved_search import explore_and_move, write_moved
    from jld_geometry.optimise import move_joints
    from jld_geometry.search import GeometrySearch, TrustRegion

__all__ = [
    "BoxStructure",
    "EqualShapes",
    "FieldMesh",
    "FieldSearch",
    "GeometrySearch",
    "Incline",
    "Key",
    "MovedScene",
    "Sine",
    "TrustRegion",
    "box_claim",
    "check_boxes",
    "check_proof",
    "equal_corners",
    "explore_and_move",
    "move_by_fields",
    "move_joints",
    "prove_box",
    "shape_joints",
    "shaped_scene",
    "spatial_mesh",
    "verify_box",
    "vertex_mesh",
    "write_box_certificate",
    "write_moved",
]

export_lazily(
    __name__,
    {
        "box_bound": ["box_claim", "check_proof", "prove_box", "write_box_certificate"],
        "boxes": ["BoxStructure", "check_boxes", "verify_box"],
        "convex_cells": ["EqualShapes", "equal_corners", "vertex_mesh"],
        "field_search": ["FieldMesh", "FieldSearch", "move_by_fields"],
        "joint_shapes": ["Incline", "Key", "Sine", "shape_joints", "shaped_scene"],
        "moved_scene": ["MovedScene", "spatial_mesh"],
        "moved_search": ["explore_and_move", "write_moved"],
        "optimise": ["move_joints"],
        "search": ["GeometrySearch", "TrustRegion"],
    },
)
