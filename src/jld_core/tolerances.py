"""Every tolerance of the package: dimensionless, each with the reason for its size."""

from __future__ import annotations

from typing import Final

GAP: Final = 1e-6
"""Width of the bracket, relative, above which a result is called `uncertified` (default of --gap)."""

LINEAR: Final = 1e-12
"""Residual and gap asked of the interior-point route on a scaled linear program, and at once the distance kept
from the boundary of every yield set and the opening kept at every joint: what comes back with a residual of
this size is admissible after projection. See benchmarks/tolerance.py for what other sizes cost."""

CONIC: Final = 1e-9
"""The same on a scaled second-order cone program, where smaller residuals are not reached."""

ROUNDING: Final = 1e-12
"""What a jump or a force that is zero by construction may show in floating point, relative to its vector."""

CONTACT: Final = 1e-7
"""Gap, offset and misalignment, relative to the shorter edge, at which two faces still touch."""

OVERLAP: Final = 1e-7
"""Area shared by two elements, relative to the smaller one, above which they overlap."""

SYMMETRY: Final = 1e-8
"""Distance, relative to the size of the scene, within which a mirrored or turned element falls on another."""

GAP_FLOOR: Final = 1e-3
"""Share of total weight / total live load below which a load factor counts as zero in a relative width."""

FACE: Final = 1e-5
"""Gap between two faces of polyhedra, relative to the smaller of the two, at which they still touch; deviation
of a given contact from a plane, and of a contact from a rectangle, relative to its size. It stands above
what single-precision coordinates leave (6e-8 of a coordinate, so some 1e-6 of a face) and far below any real
joint."""
