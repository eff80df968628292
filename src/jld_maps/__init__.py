"""Maps of λ over values of a scene.

- `borders`: points on the borders between the mechanisms of a map
- `sweep`: λ over a grid of values of a scene
"""

from jld_maps.borders import borders
from jld_maps.grid import sweep

__all__ = ["borders", "sweep"]
