"""Loads that change with the shape of their element."""

from __future__ import annotations

from dataclasses import dataclass

from jld_core.arrays import Floats, Ints


@dataclass(frozen=True)
class ShapeLoads:
    """Parts of the loads on n elements that change with the shapes of the elements.

    All are forces in scene units. A force may do both: self-weight by density grows with the volume and acts at the
    centroid.

    Attributes
    ----------
    dead_growing, live_growing : (n, d) arrays
        Forces that are proportional to the volume.
    dead_riding, live_riding : (n, d) arrays
        Forces that act at the centroid and move with it.
    pressed : bool
        True if pressure acts on faces, so that loads also change in ways that the arrays do not hold.
    """

    dead_growing: Floats
    dead_riding: Floats
    live_growing: Floats
    live_riding: Floats
    pressed: bool = False

    def growing(self, load_factor: float) -> Floats:
        """Return the forces (n, d) proportional to the volume: dead + load factor × live."""
        return self.dead_growing + load_factor * self.live_growing

    def riding(self, load_factor: float) -> Floats:
        """Return the forces (n, d) that move with the centroid: dead + load factor × live."""
        return self.dead_riding + load_factor * self.live_riding

    def take(self, rows: Ints) -> ShapeLoads:
        """Return the loads on the elements of the indices `rows` (k,), in this order."""
        return ShapeLoads(
            self.dead_growing[rows],
            self.dead_riding[rows],
            self.live_growing[rows],
            self.live_riding[rows],
            self.pressed,
        )
