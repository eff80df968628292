"""Joints that move: derivatives of λ by geometry, optimisation, shapes of joints, bounds over boxes.

- `BoxStructure`: structure of a claim over a box
- `EqualShapes`: equations that keep pairs of outlines equal
- `FieldMesh`: mesh whose nodes follow the vertices of joints
- `FieldSearch`: search over positions by fields
- `GeometrySearch`: search for the best positions of joints
- `Incline`: joint turned about the middle of its face
- `Key`: trapezoidal key in the middle of a face
- `MovedScene`: planar scene whose vertices move
- `Sine`: sine wave along a face
- `TrustRegion`: parameters of the trust region
- `box_claim`: claim and nodes of a certificate
- `boxes`: claims and trees of boxes, their exact check and their files
- `check_boxes`: check the tree of a certificate
- `check_proof`: check a proof by exact arithmetic
- `equal_corners`: pair equal outlines corner by corner
- `explore_and_move`: alternate between labels and joints
- `move_by_fields`: move joints where blocks may crack anywhere
- `move_joints`: move joints to optimise the objective of "move"
- `prove_box`: best geometry in a box, and a bound on all
- `shape_joints`: best parameters of a shape of all joints
- `shaped_scene`: scene whose dry faces have a shape
- `spatial_mesh`: vertices that a spatial assembly shares
- `verify_box`: check a certificate of `jld move --prove`
- `vertex_mesh`: vertices that a planar assembly shares
- `write_box_certificate`: write a certificate for `jld verify`
- `write_moved`: write the files of moved layouts
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_geometry import boxes
    from jld_geometry.box_bound import box_claim, check_proof, prove_box, write_box_certificate
    from jld_geometry.boxes import BoxStructure, check_boxes, verify_box
    from jld_geometry.convex_cells import EqualShapes, equal_corners, vertex_mesh
    from jld_geometry.field_search import FieldMesh, FieldSearch, move_by_fields
    from jld_geometry.joint_shapes import Incline, Key, Sine, shape_joints, shaped_scene
    from jld_geometry.moved_scene import MovedScene, spatial_mesh
    from jld_geometry.moved_search import explore_and_move, write_moved
    from jld_geometry.search import GeometrySearch, TrustRegion, move_joints

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
    "boxes",
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
        "search": ["move_joints", "GeometrySearch", "TrustRegion"],
    },
    submodules=["boxes"],
)
