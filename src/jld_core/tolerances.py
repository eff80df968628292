"""Tolerances that bound a result: dimensionless, each with the reason for its size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

GAP: Final = 1e-6
"""Relative width of the bracket that is aimed at (default of --gap)."""


ALONE: Final = 1e-7
"""Largest width of a bracket, relative to λ, at which a batch-solver result for one labelling is accepted.

In space the batch solver reaches 3e-8, others 1e-8.
"""


DIGITS: Final = 1e-9
"""Relative width of a bracket above which one labelling is solved again: λ depends on position and order within it."""


@dataclass(frozen=True)
class Precision:
    """Accuracy that an interior-point method should reach on a scaled program."""

    residual: float  # largest residual of equations and largest duality gap, dimensionless
    # scaled distance from the boundary of every yield set, and opening of every joint. It makes a solution with such a
    # residual admissible after projection.
    margin: float


LINEAR: Final = Precision(residual=1e-12, margin=1e-12)
"""Planar programs; docs/notes/tried.md has the cost of other values."""

FRICTION_CONES: Final = Precision(residual=1e-11, margin=1e-10)
"""Spatial programs; the residual that solvers reach (1e-10) would exceed a smaller margin."""

CRUSHING: Final = Precision(residual=1e-9, margin=1e-9)
"""Programs with cones of compressive strength; forces are large and solvers do not reach smaller residuals."""

CRUSHING_WIDTH: Final = 3e-8
"""Relative width of a bracket above which a crushable scene is solved again, with refinement and a smaller margin."""

ROUNDING: Final = 1e-12
"""Largest value of a jump or force that is zero by construction, relative to its vector, in floating point."""

EXACT: Final = 3e-14
"""Largest relative violation of a yield condition by a ray, self-stress or jump that meets it but for rounding.

Friction this close to 45° counts as 45°.
"""

CONTACT: Final = 1e-7
"""Largest gap, offset and misalignment of two faces that touch, relative to the shorter edge."""

ON_OUTLINE: Final = 10.0 * CONTACT
"""Largest distance from an outline, relative to the size of the structure, at which a point lies on it."""

SNAP: Final = 1e-4
"""Default of a scene's "tolerance": gaps and overlaps up to it are closed, relative to the shortest edge."""

NEAR: Final = 1e-2
"""Gap between faces that are not joined, relative to the shorter edge, below which a warning is given."""

WEDGE: Final = 3.5e-2
"""Opening at the far end of faces that touch at one end, relative to the shorter one, that gives a warning: 2°."""

OVERLAP: Final = 1e-7
"""Area shared by two elements, relative to the smaller one, above which they overlap."""

SYMMETRY: Final = 1e-8
"""Largest distance between a mirrored or rotated element and the element that it maps to, relative to the size of the
scene.
"""

GAP_FLOOR: Final = 1e-3
"""Share of total weight / total live load below which a load factor counts as zero in a relative width, docs/method.md
(3.13).
"""

PROVEN: Final = 1e-6
"""Relative distance of a bound from the best value found at which that value is proven optimal. It equals `GAP`,
because neither value is known more accurately.
"""

COMPLEMENTARITY: Final = 1e-3
"""Largest complementarity gap over the dissipation of a converged run without dilation, docs/method.md (4.3)."""

VIOLATION: Final = 1e-4
"""Largest (|V| − μN)⁺ over the largest N of a converged run without dilation. The forces finally reported are
admissible exactly.
"""

DILATION: Final = 1e-6
"""Largest dilation of a compressed face over the largest slip of a converged run without dilation. Solvers reach it,
and real joints are rougher.
"""

SETTLED: Final = 1e-6
"""Largest relative difference of λ between the last two programs of a converged run without dilation."""

FIXED_POINT: Final = 1e-8
"""Change of x / (l/2) and of c_T,e / c_T at which effective areas count as fixed, docs/method.md (2.14). Its effect on
λ is smaller than `GAP`.
"""

DECIMALS: Final = 1e-9
"""Relative slack of inclusive limits on weights and lengths of blocks, for the rounding of sums of decimal numbers."""

SUMMATION: Final = 1e-14
"""Share of the sum of terms by which a stored bound is raised, because sums in another order round differently."""

FACE: Final = 1e-5
"""Largest gap between two touching faces of polyhedra, relative to the smaller face. It also bounds the deviation of a
given contact from a plane, and of a contact from a rectangle, relative to its size. The value is above the error of
single-precision coordinates (6e-8 of a coordinate, about 1e-6 of a face) and far below any real joint.
"""
