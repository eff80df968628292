"""Scene files: keys, reading, validation and error messages.

- `PointLoad`: force and moment on one element
- `Scene`: validated scene file
- `Search`: candidates, limits and objectives of a search
- `load_scene`: read and validate a scene file
- `parse_cracks`: return the crack model that the option --cracks names
- `parse_scene`: validate a scene given as a dictionary
"""

from __future__ import annotations

from jld_core.scene.cracks import parse_cracks
from jld_core.scene.loads import PointLoad
from jld_core.scene.reading import load_scene, parse_scene
from jld_core.scene.schema import Scene
from jld_core.scene.search import Search

__all__ = [
    "PointLoad",
    "Scene",
    "Search",
    "load_scene",
    "parse_cracks",
    "parse_scene",
]
