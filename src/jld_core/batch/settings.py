"""Settings of the interior point of the batch solver, pass by pass."""

from __future__ import annotations

from typing import Final

from jld_core.batch import library

LARGE: Final = 300
"""Faces of a planar assembly from which on `LARGE_TRIES` apply.

At 276 faces both settings take the same time. Of 64 layouts of 946 and of 2 016 faces `TRIES` proves 54 and 31 in its
first pass, `LARGE_TRIES` 61 and 56. Source: tests/core/test_batch_solver.py and benchmarks/lanes.py.
"""

_FIRST: Final[dict[str, float]] = {
    "proximal": 1e-5,
    "margin": 1e-10,
    "target": 1e-8,
    "active": 1e-4,
    "first": 0.95,
    "last": 0.99,
    "near": 0.1,
    "relax": 1e-3,
    "jumps": 1e-8,
    "aim": 1.0,
    "press": 0.0,
    "endless": 1e300,
}
"""Defaults of `library.Try`; `JldTry` in interface.py defines each field."""
TRIES: Final = (
    library.Try(**_FIRST | {"endless": 1e4}, most=28),
    library.Try(**_FIRST | {"aim": -1.0, "press": 1e-2}, most=28),
    library.Try(**_FIRST | {"aim": 0.0, "target": 1e-6, "margin": 0.0}, most=28),
    library.Try(**_FIRST | {"proximal": 1e-6, "margin": 1e-11, "active": 1e-5, "first": 0.9, "jumps": 1e-9}, most=40),
    library.Try(**_FIRST | {"proximal": 1e-4, "margin": 1e-9, "active": 1e-3, "first": 0.9, "near": 1e-4}, most=60),
)
"""Settings of the successive passes over the open labellings, planar. Passes 2 and 3 look for a ray of unbounded load
and for an admissible state on the boundary. Source: measured in benchmarks/lanes.py.
"""
LARGE_TRIES: Final = (
    library.Try(**_FIRST | {"endless": 1e4, "proximal": 1e-8, "margin": 1e-9}, most=40),
    TRIES[1],
    library.Try(**_FIRST | {"proximal": 1e-11, "jumps": 1e-11}, most=60),
    library.Try(**_FIRST | {"proximal": 1e-13, "jumps": 1e-12}, most=60),
    TRIES[2],
    library.Try(**_FIRST, most=40),
    *TRIES[3:],
)
"""Settings of the passes over large planar assemblies. A small proximal term follows forces that drift long, and
rounding of many elements needs a larger margin. Passes 3 and 4 look for jumps that are exact enough for an upper bound:
each is weighed with strengths far above the weight of an element. Source: measured in benchmarks/lanes.py.
"""

SPATIAL_TRIES: Final = tuple(
    library.Try(**_FIRST | {"target": 3e-8, "jumps": 1e-7, "near": 1e-2} | more)
    for more in (
        {"endless": 1e4, "most": 28},
        {"aim": -1.0, "press": 1e-2, "most": 28},
        {"proximal": 1e-6, "margin": 1e-11, "first": 0.9, "most": 40},
        {"proximal": 1e-4, "most": 60},
    )
)
"""Settings of the successive passes over the open labellings, spatial. No pass looks for states on the boundary of a
cone. Source: measured in benchmarks/lanes.py.
"""


def tries_of(dimension: int, faces: int, parabolas: bool) -> tuple[library.Try, ...]:
    """Return the settings of each pass over the labellings that are still open.

    dimension: 2 or 3. faces: number of interfaces. parabolas: True if some face crushes along a parabola, which passes
    for rays and for states on the boundary do not support.
    """
    if dimension == 3:
        usual = SPATIAL_TRIES
    else:
        usual = LARGE_TRIES if faces >= LARGE else TRIES
    return tuple(one for one in usual if one.aim > 0.0) if parabolas else usual
