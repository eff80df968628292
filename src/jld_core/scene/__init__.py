"""The scene file: its keys, how it is read, and what is said of a wrong one.

- `BodyLoad`: weight times a vector on all elements
- `Contact`: an interface given by hand
- `Dry`: material of joints
- `DryFace`: its values for the faces between two elements
- `Element`: one rigid element
- `FaceMaterial`: material of the faces between two elements
- `Grid`: planar cells
- `Inner`: material of crack planes
- `InnerFace`: its values for the faces between two elements
- `Materials`: weights and strengths
- `PointLoad`: a force on one element
- `Scene`: a scene file, validated
- `Search`: what may be relabelled
- `at_low`: the scene with the low values of its materials
- `lies_within_apex`: refuse a tensile strength that friction cuts off
- `load_scene`: file → Scene
- `parse_scene`: dictionary → Scene
"""

from __future__ import annotations

from jld_core.scene.reading import at_low, load_scene, parse_scene
from jld_core.scene.schema import (
    BodyLoad,
    Contact,
    Dry,
    DryFace,
    Element,
    FaceMaterial,
    Grid,
    Inner,
    InnerFace,
    Materials,
    PointLoad,
    Scene,
    lies_within_apex,
)
from jld_core.scene.search import Search

__all__ = [
    "BodyLoad",
    "Contact",
    "Dry",
    "DryFace",
    "Element",
    "FaceMaterial",
    "Grid",
    "Inner",
    "InnerFace",
    "Materials",
    "PointLoad",
    "Scene",
    "Search",
    "at_low",
    "lies_within_apex",
    "load_scene",
    "parse_scene",
]
