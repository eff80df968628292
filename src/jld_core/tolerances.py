"""Every tolerance of the package: dimensionless, each with the reason for its size."""

from __future__ import annotations

from typing import Final

GAP: Final = 1e-6
"""Width of the bracket, relative, above which a result is called `uncertified` (default of --gap)."""

SOLVER: Final = 1e-11
"""Residual and gap asked of the interior-point route, on the scaled program; see benchmarks/tolerance.py."""

MARGIN: Final = 1e-11
"""Distance kept from the boundary of every yield set, and opening kept at every joint, in the scaled program.
It is of the size of the solver's residual, so that what comes back is admissible after projection."""

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
