"""Scene files: keys, reading, validation and error messages.

- `BodyLoad`: load on all free elements, as a multiple of their weight
- `CellCracks`: cracks along the faces of finer rigid cells
- `Contact`: interface stated in the scene
- `CrackModel`: type of a crack model
- `Dry`: material of dry joints
- `DryFace`: joint values for the faces between two elements
- `Element`: rigid element
- `FaceMaterial`: material of the faces between two elements
- `FieldCracks`: cracks anywhere, by stress and velocity fields
- `Grid`: planar grid of cells
- `Inner`: material of inner faces (potential cracks)
- `InnerFace`: inner-face values for the faces between two elements
- `Materials`: weights and strengths
- `PointLoad`: force and moment on one element
- `Scene`: validated scene file
- `Search`: candidates, limits and objectives of a search
- `at_low`: return the scene with the low values of its materials
- `cracks_in_words`: return a crack model in words
- `cracks_to_json`: return a crack model as in a scene file
- `lies_within_apex`: refuse a tensile strength beyond the apex of the friction cone
- `load_scene`: read and validate a scene file
- `parse_cracks`: return the crack model that the option --cracks names
- `parse_scene`: validate a scene given as a dictionary
"""

from __future__ import annotations

from jld_core.scene.cracks import (
    CellCracks,
    CrackModel,
    FieldCracks,
    cracks_in_words,
    cracks_to_json,
    parse_cracks,
)
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
    "CellCracks",
    "Contact",
    "CrackModel",
    "Dry",
    "DryFace",
    "Element",
    "FaceMaterial",
    "FieldCracks",
    "Grid",
    "Inner",
    "InnerFace",
    "Materials",
    "PointLoad",
    "Scene",
    "Search",
    "at_low",
    "cracks_in_words",
    "cracks_to_json",
    "lies_within_apex",
    "load_scene",
    "parse_cracks",
    "parse_scene",
]
