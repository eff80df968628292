"""Scene files: keys, reading, validation and error messages.

- `BodyLoad`: load on all free elements, as a multiple of their weight
- `Contact`: interface stated in the scene
- `Dry`: material of dry joints
- `DryFace`: joint values for the faces between two elements
- `Element`: rigid element
- `FaceMaterial`: material of the faces between two elements
- `Grid`: planar grid of cells
- `Inner`: material of inner faces (potential cracks)
- `InnerFace`: inner-face values for the faces between two elements
- `Materials`: weights and strengths
- `PointLoad`: force and moment on one element
- `Scene`: validated scene file
- `Search`: candidates, limits and objectives of a search
- `at_low`: return the scene with the low values of its materials
- `lies_within_apex`: refuse a tensile strength beyond the apex of the friction cone
- `load_scene`: read and validate a scene file
- `parse_scene`: validate a scene given as a dictionary
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
