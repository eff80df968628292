"""Yield surfaces that a scene states as data: `materials.inner.surface` and `materials.dry.surface`.

- `Surface`: criterion "surface" of inner and of dry faces, made of parts that all hold
"""

from jld_surfaces.surface import Surface

__all__ = ["Surface"]
