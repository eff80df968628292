"""Maps of λ over values of a scene.

- `borders`: points on the borders between the mechanisms of a map
- `sweep`: λ over a grid of values of a scene
"""

from jld_maps.grid import borders, sweep

__all__ = ["borders", "sweep"]
