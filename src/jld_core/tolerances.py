"""Every tolerance that bounds a result: dimensionless, each with the reason for its size.

What steers a method and leaves the proof of its answer to these, such as residuals asked of an auxiliary program or
steps of a repair, stands where it is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

GAP: Final = 1e-6
"""Width of the bracket, relative, above which a result is called `uncertified` (default of --gap)."""


ALONE: Final = 1e-7
"""Width of a bracket beside λ up to which the batch solver's answer to one labelling alone stands: solvers leave 1e-8
in
space, the batch solver 3e-8 (benchmarks/results/lanes_single.md)."""


@dataclass(frozen=True)
class Precision:
    """What is asked of an interior-point route on a scaled program.

    residual: its residual and gap. margin: distance kept from the boundary of every yield set and opening kept
    at every joint, so that what comes back with such a residual is admissible after projection.
    """

    residual: float
    margin: float


LINEAR: Final = Precision(residual=1e-12, margin=1e-12)
"""Planar programs: see benchmarks/tolerance.py for what other sizes cost."""

FRICTION_CONES: Final = Precision(residual=1e-11, margin=1e-10)
"""Spatial programs: at smaller margins the residual that is reached (1e-10) outweighs them."""

CRUSHING: Final = Precision(residual=1e-9, margin=1e-9)
"""Programs with cones of compressive strength, where forces are large and smaller residuals are not reached."""

CRUSHING_WIDTH: Final = 3e-8
"""Relative width of a bracket above which a crushable scene is solved once more, with refinement and less margin."""

ROUNDING: Final = 1e-12
"""What a jump or a force that is zero by construction may show in floating point, relative to its vector."""

VERTEX_ROUNDING: Final = 1e-13
"""The same at a vertex of a linear program, whose equations hold exactly: jumps below it, relative to the largest
velocity, are zero."""

CONTACT: Final = 1e-7
"""Gap, offset and misalignment, relative to the shorter edge, at which two faces still touch."""

SNAP: Final = 1e-4
"""Default of a scene's "tolerance", relative to the shortest edge: gaps and overlaps up to it are closed."""

NEAR: Final = 1e-2
"""Gap, relative to the shorter edge, below which faces that are not joined are worth a warning."""

WEDGE: Final = 3.5e-2
"""Opening at the far end of faces that touch at one end, relative to the shorter one, that is worth a warning: 2°."""

OVERLAP: Final = 1e-7
"""Area shared by two elements, relative to the smaller one, above which they overlap."""

SYMMETRY: Final = 1e-8
"""Distance, relative to the size of the scene, within which a mirrored or turned element falls on another."""

GAP_FLOOR: Final = 1e-3
"""Share of total weight / total live load below which a load factor counts as zero in a relative width."""

PROVEN: Final = 1e-6
"""Relative distance of a bound from the best found at which the best is proven to be the best: as wide as `GAP`, since
neither is known better."""

COMPLEMENTARITY: Final = 1e-3
"""Largest complementarity gap over the dissipation of a run without dilation that converged, docs/method.md (4.3)."""

VIOLATION: Final = 1e-4
"""Largest (|V| − μN)⁺ over the largest N of such a run; what is reported at the end is admissible exactly."""

DILATION: Final = 1e-6
"""Largest dilation of a pressed face over the largest slip of such a run: solvers reach it, real joints are rougher."""

SETTLED: Final = 1e-6
"""Difference of λ between the last two programs of such a run, relative."""

FIXED_POINT: Final = 1e-8
"""Change of x / (l/2) and of c_T,e / c_T at which effective areas count as fixed, docs/method.md (2.14): below
what moves λ within `GAP`."""

DECIMALS: Final = 1e-9
"""Relative slack of inclusive limits on weights and lengths of blocks: what sums of decimal numbers may be off."""

SUMMATION: Final = 1e-14
"""Share of the terms of a stored bound by which it is raised: sums in another order round differently."""

FACE: Final = 1e-5
"""Gap between two faces of polyhedra, relative to the smaller of the two, at which they still touch; deviation
of a given contact from a plane, and of a contact from a rectangle, relative to its size. It stands above
what single-precision coordinates leave (6e-8 of a coordinate, so some 1e-6 of a face) and far below any real
joint."""
