"""Every published value beside ours: docs/validation.md.

Closed forms and values that somebody else published, each with its source, computed here at default settings. The
difference is relative. A row that misses its tolerance is an error of the tests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from studies.families import semicircular_arch
from studies.scenes import ring_arch, stacked_cubes

from benchmarks.common import ROOT, about, table
from jld_core import LimitAnalysis, Scene, build_assembly, load_scene, parse_scene, solve
from jld_core.geometry.polygons import rectangle_torsion_length
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.space import search_space

PAGE: Final = ROOT / "docs" / "validation.md"
FERRIS: Final = "Ferris & Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209–224, recomputed by two linear programs"
COCCHETTI: Final = "Cocchetti & Rizzi, Frattura ed Integrità Strutturale 51 (2020) 356–375, Table 3"
PAPER: Final = "Iannuzzo et al. 2024, section 3.2"

END: Final = """

The allowed difference is what the digits of the source, or the number of voussoirs, leave. Without dilation λ is not
one number, so published local minima are no check; what is checked there is each solution's own evidence
([zero dilation](guide/zero_dilation.md)). The paper's flat arch (its section 3.3) is not in this table, as its layout
is not published. Independent programs on random scenes, and brackets against one another, are in `tests/validation`.
"""


@dataclass(frozen=True)
class Check:
    """One value. tolerance: relative difference that its source allows; find: ours."""

    what: str
    source: str
    expected: float
    tolerance: float
    find: Callable[[], float]


def _wall(number: int) -> float:
    return solve(build_assembly(load_scene(ROOT / "scenes" / f"ferris_tinloi_{number}.json"))).load_factor


def _least(scene: Callable[[float], Scene], low: float, high: float, width: float = 1e-7) -> float:
    """Least thickness at which an arch stands, by bisection."""
    while high - low > width:
        middle = 0.5 * (low + high)
        assembly = build_assembly(scene(middle))
        stands = LimitAnalysis(assembly).stands(assembly.labels)
        low, high = (low, middle) if stands else (middle, high)
    return high


def _cubes(count: int, bending: Any = "uncoupled", direction: float | None = None, **keys: Any) -> float:
    scene = stacked_cubes(count, direction=direction, **keys)
    return solve(build_assembly(scene), inner_bending=bending).load_factor


def _column(blocks: int, friction: float) -> float:
    rows = ["ab"[k % 2] for k in range(blocks)] + ["#"]
    document = {
        "grid": {"cell": [1.0, 1.0], "rows": rows},
        "materials": {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}},
        "loads": {"live": [{"body": [1, 0]}]},
    }
    return solve(build_assembly(parse_scene(document))).load_factor


def _segmentations(size: int) -> float:
    document = {
        "grid": {"cell": [1.0, 1.0], "rows": ["a" * size] * size + ["#" * size]},
        "materials": {
            "density": 1.0,
            "dry": {"friction_coefficient": 0.5},
            "inner": {"tensile_strength": 1.0, "shear_strength": 1.0},
        },
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"symmetry": "none"},
    }
    scene = parse_scene(document)
    return float(Enumeration(search_space(scene, build_assembly(scene))).count().labellings)


def checks() -> list[Check]:
    """All of them, in the order of the page."""
    walls = {
        1: 0.6428590033,
        2: 0.5799986113,
        3: 0.4036941035,
        4: 0.3319483952,
        5: 0.2396425252,
        6: 0.3478245642,
    }
    found = [Check(f"dry wall {k}, μ 0.65: λ", FERRIS, value, 1e-9, partial(_wall, k)) for k, value in walls.items()]
    found += [
        Check(
            "semicircular arch, weight on the centreline, μ > 0.395832: least t/R (120 voussoirs)",
            COCCHETTI,
            0.107426,
            1e-3,
            lambda: _least(lambda t: semicircular_arch(120, t, 0.6), 0.05, 0.2),
        ),
        Check(
            "semicircular arch, true weight of the ring, radial cuts: least t/R (60 blocks)",
            "Milankovitch 1907",
            0.1075,
            2e-3,
            lambda: _least(lambda t: ring_arch(60, t, 2.0), 0.05, 0.2, 1e-6),
        ),
        Check(
            "the same, vertical cuts",
            "Makris & Alexakis, Archive of Applied Mechanics 83 (2013)",
            0.1095,
            1e-2,
            lambda: _least(lambda t: ring_arch(60, t, 2.0, "vertical"), 0.05, 0.2, 1e-6),
        ),
        Check(
            "one block on an inner base, τA/W = 0.2: λ = τA/W",
            PAPER,
            0.2,
            1e-9,
            lambda: _cubes(1, friction=0.5, tension=1.0, shear=0.2, base="inner"),
        ),
        Check(
            "two cubes, σtA/W = 0.2: inner opening, λ = (1 + σtA/W)/3",
            PAPER,
            0.4,
            1e-9,
            lambda: _cubes(2, friction=0.7, tension=0.2, shear=1.0),
        ),
        Check(
            "two cubes, σtA/W = 0.8: base rocking, λ = 1/2",
            PAPER,
            0.5,
            1e-9,
            lambda: _cubes(2, friction=0.7, tension=0.8, shear=1.0),
        ),
        Check(
            "two cubes at 45°, σt = 0, uncoupled bending: λ = √2/3",
            "closed form, docs/method.md (2.5)",
            np.sqrt(2.0) / 3.0,
            1e-8,
            lambda: _cubes(2, direction=np.pi / 4, friction=1.0, tension=0.0, shear=5.0),
        ),
        Check(
            "the same by the kern: λ = √2/6",
            "closed form, docs/method.md (2.6)",
            np.sqrt(2.0) / 6.0,
            1e-8,
            lambda: _cubes(2, "kern", np.pi / 4, friction=1.0, tension=0.0, shear=5.0),
        ),
        Check("column of four cubes, μ 0.7: λ = b/(4h)", "closed form", 0.25, 1e-9, lambda: _column(4, 0.7)),
        Check("column of four cubes, μ 0.2: λ = μ", "closed form", 0.2, 1e-9, lambda: _column(4, 0.2)),
        Check(
            "torsion length of the unit square",
            "closed form, docs/method.md (1.5): (√2 + asinh 1)/6",
            (np.sqrt(2.0) + np.arcsinh(1.0)) / 6.0,
            1e-12,
            lambda: float(rectangle_torsion_length(np.ones(1), np.ones(1))[0]),
        ),
        *(
            Check(f"segmentations of {n} × {n} cells", "brute force", value, 0.0, partial(_segmentations, n))
            for n, value in ((2, 12.0), (3, 1434.0))
        ),
    ]
    return found


def page(pairs: list[tuple[Check, float]]) -> str:
    """The page, from checks and what was found."""
    head = ["quantity", "source", "expected", "ours", "difference", "allowed"]
    rows = []
    for check, value in pairs:
        apart = abs(value - check.expected) / abs(check.expected)
        given = [f"{check.expected:.10g}", f"{value:.10g}", f"{apart:.0e}" if apart > 1e-13 else "0"]
        rows.append([check.what, check.source, *given, f"{check.tolerance:.0e}" if check.tolerance else "0"])
    return (
        "# Validation\n\nWritten by `python -m benchmarks.validation`. "
        + about(__doc__).replace(" A row", "\nA row")
        + "\n\n"
        + table(head, rows)
        + END
    )


def main() -> None:
    """Compute all and write the page."""
    text = page([(check, check.find()) for check in checks()])
    print(text)
    Path(PAGE).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
