"""Settings of the interior point of the batch solver, pass by pass."""

from __future__ import annotations

from typing import Any, Final

from jld_core.batch import library

LARGE: Final = 200
"""Faces of a planar assembly from which on `LARGE_TRIES` apply.

Of 512 layouts of 278 faces, 128 of 946 and 64 of 2 016, `LARGE_TRIES` proves 493, 124 and 53 in its first pass and all
but 0, 1 and 0 at last, with 15.6, 21.7 and 31 iterations for one; `TRIES` took 17.1 at 278 faces. Source:
benchmarks/batch_solver.py.
"""
NARROW: Final = 1000
"""Faces of a planar assembly from which on bounds use half the lanes of AVX-512.

Workspaces of eight labellings no longer fit into the cache. Half the lanes take 1.2 times the time of all at 278 faces,
1.0 times at 946, and 0.7 to 0.9 times at 1 225, 1 431 and 2 016. Source: benchmarks/batch_solver.py,
walls of other sizes.
"""
DRY_SHARES: Final = (0.0, 1.0)
"""Range of the share of dry faces of the random labellings whose mean solution gives the starting point."""
LARGE_DRY_SHARES: Final = (0.5, 1.0)
"""That range for planar assemblies of `LARGE` faces and more.

Random labels join the elements of a large assembly to few blocks below a share of one half, and λ then is far above
that of layouts. Iterations of the first pass: 20.2 instead of 23.6 at 946 faces, 27.1 instead of 30.3 at 2 016 (layouts
in blocks of four); 26.0 instead of 26.8 and 28.7 instead of 30.0 (random labels of any share); 30.9 instead of 29.7 and
34.2 instead of 33.5 (less than a third dry). Source: benchmarks/batch_solver.py.
"""
SAMPLES: Final = 32
"""Random labellings whose mean solution gives the starting point."""
FEW_SAMPLES: Final = 8
"""The same for planar assemblies of `NARROW` faces and more, and spatial ones of `LARGE` faces and more.

There each takes as long as a layout. With 32, 16, 8 and none a layout takes 31.2, 30.5, 29.3 and 31.8 iterations at
2 016 faces, 21.8, 22.4, 22.5 and 22.3 at 946, and 15.8, 16.2, 16.2 and 17.7 at 278. Source: benchmarks/batch_solver.py.
"""

# Defaults of `library.Try`; `JldTry` in interface.py defines each field
_FIRST: Final[dict[str, Any]] = {
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
TRIES: Final = (
    library.Try(**_FIRST | {"endless": 1e4}, most=28),
    library.Try(**_FIRST | {"aim": -1.0, "press": 1e-2}, most=28),
    library.Try(**_FIRST | {"aim": 0.0, "target": 1e-6, "margin": 0.0}, most=28),
    library.Try(**_FIRST | {"proximal": 1e-6, "margin": 1e-11, "active": 1e-5, "first": 0.9, "jumps": 1e-9}, most=40),
    library.Try(**_FIRST | {"proximal": 1e-4, "margin": 1e-9, "active": 1e-3, "first": 0.9, "near": 1e-4}, most=60),
)
"""Settings of the successive passes over the open labellings, planar. Passes 2 and 3 look for a ray of unbounded load
and for an admissible state on the boundary. Source: measured in benchmarks/batch_solver.py.
"""
# Settings of a pass that begins where the last one has ended, with equilibrium restored to the last digit
_RESUMED: Final = _FIRST | {"resumes": 1, "apart": 1, "most": 16}
LARGE_TRIES: Final = (
    library.Try(**_FIRST | {"endless": 1e4, "proximal": 1e-8, "margin": 1e-9, "most": 40}),
    TRIES[1],
    library.Try(**_RESUMED | {"proximal": 1e-11}),
    library.Try(**_RESUMED | {"proximal": 1e-10}),
    library.Try(**_RESUMED | {"proximal": 1e-11, "margin": 3e-11}),
    library.Try(**_FIRST | {"proximal": 1e-7, "margin": 1e-8, "first": 0.9, "last": 0.95, "apart": 1, "most": 60}),
    library.Try(**_RESUMED | {"proximal": 1e-10}),
    library.Try(**_RESUMED | {"proximal": 1e-11}),
    TRIES[2],
)
"""Settings of the passes over large planar assemblies. A small proximal term follows forces that drift long, and
rounding of many elements needs a larger margin. What a pass leaves open it has nearly solved, so the next one begins
where it ended. Upper bounds need exact jumps, since each is weighed with strengths far above the weight of an element:
hence the small proximal terms and margins of these passes. Pass 5 begins anew with shorter steps and a larger margin,
which keep slacks apart. Source: measured in benchmarks/batch_solver.py.
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
cone. Source: measured in benchmarks/batch_solver.py.
"""


def narrow(dimension: int, faces: int) -> bool:
    """Return True if bounds use half the lanes of AVX-512. dimension: 2 or 3. faces: number of interfaces."""
    return dimension == 2 and faces >= NARROW


def samples(dimension: int, faces: int) -> int:
    """Return the number of random labellings that give the starting point.

    dimension: 2 or 3. faces: number of interfaces.
    """
    return FEW_SAMPLES if faces >= (NARROW if dimension == 2 else LARGE) else SAMPLES


def dry_shares(dimension: int, faces: int) -> tuple[float, float]:
    """Return the range of the share of dry faces of the labellings that give the starting point.

    dimension: 2 or 3. faces: number of interfaces.
    """
    return LARGE_DRY_SHARES if dimension == 2 and faces >= LARGE else DRY_SHARES


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
