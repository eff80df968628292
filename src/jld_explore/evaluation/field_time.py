"""Estimate the processor time of bounds by fields from the number of triangles of a mesh.

The time of a mesh is a rate times a power of its number of triangles. The power was measured once, for both fields on
walls of 9 to 108 cells and their refined meshes. Meshes of 36, 192, 1 081 and 3 315 triangles took 0.03, 0.15, 1.2 and
5.3 s. The time grows with the power 1.1 below 500 triangles, and with 1.3 above 1 500.
"""

from __future__ import annotations

from typing import Final

TIME_POWER: Final = 1.3
"""Power of the number of triangles that the time of a mesh grows with.

The power of large meshes; from a small mesh it overestimates the time of a large one.
"""


def time_rate(seconds: float, triangles: float) -> float:
    """Return the rate of time of bounds by fields, from a mesh whose time is known.

    The time of a mesh is this rate times the power `TIME_POWER` of its number of triangles.

    seconds: processor time of the mesh, s. triangles: number of triangles of the mesh.
    """
    return float(seconds / triangles**TIME_POWER)


def mesh_seconds(rate: float, triangles: float) -> float:
    """Return the expected processor time of bounds by fields on a mesh.

    rate: rate from `time_rate`, s. triangles: number of triangles of the mesh.
    """
    return float(rate * triangles**TIME_POWER)


COARSE_RATE: Final = time_rate(0.024, 60)
"""Rate of both bounds on a coarsest mesh, s; a mesh of 60 triangles takes 24 ms of processor time."""
