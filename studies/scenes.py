"""Scenes of the studies: their geometry and materials, with the source where there is one."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core import Scene, parse_scene
from jld_core.arrays import Floats
from jld_samples import box


def stacked_cubes(
    count: int, *, friction: float, tension: float, shear: float, base: str = "dry", direction: float | None = None
) -> Scene:
    """Unit cubes of unit weight on top of one another on a slab, under a horizontal body load.

    count: cubes. friction: of the base where it is "dry". tension, shear: σt A/W and τA/W of the faces between the
    cubes, which are inner, and of the base where it is "inner". direction: of the load, radians from x about z, in a
    spatial scene; None makes a planar one under a load along x.
    Source: Iannuzzo et al. 2024, section 3.2.
    """
    elements: list[dict[str, Any]]
    if direction is None:
        elements = [{"id": f"b{k}", "polygon": [[0, k], [1, k], [1, k + 1], [0, k + 1]]} for k in range(count)]
        elements.append({"id": "ground", "polygon": [[-0.5, -0.3], [1.5, -0.3], [1.5, 0], [-0.5, 0]], "support": True})
        along = [1.0, 0.0]
    else:
        elements = [box(f"b{k}", (0, 0, k), (1, 1, k + 1)) for k in range(count)]
        elements.append(box("ground", (-0.5, -0.5, -0.3), (1.5, 1.5, 0), support=True))
        along = [float(np.cos(direction)), float(np.sin(direction)), 0.0]
    inner = [[f"b{k}", f"b{k + 1}"] for k in range(count - 1)]
    return parse_scene(
        {
            "name": f"{count} cubes on a {base} base",
            "units": {"length": "cube side", "force": "weight of a cube"},
            "elements": elements,
            "materials": {
                "density": 1.0,
                "gravity": 1.0,
                "dry": {"friction_coefficient": friction},
                "inner": {"tensile_strength": tension, "shear_strength": shear},
            },
            "loads": {"live": [{"body": along}]},
            "labels": {"inner": inner + ([["b0", "ground"]] if base == "inner" else [])},
        }
    )


def _springings(inner: float, outer: float) -> list[dict[str, Any]]:
    """Supports under both ends of a semicircular arch."""
    depth = outer - inner
    return [
        {
            "id": name,
            "polygon": [[side * inner, 0.0], [side * outer, 0.0], [side * outer, -depth], [side * inner, -depth]],
            "support": True,
        }
        for name, side in (("right", 1.0), ("left", -1.0))
    ]


def ring_arch(pieces: int, thickness: float, friction: float, cuts: str = "radial", fine: int = 12) -> Scene:
    """A semicircular arch under the true weight of its ring, cut radially or vertically.

    pieces: blocks; thickness: over the radius of the centreline, which is the unit of length; friction: coefficient;
    cuts: "radial" (equal angles) or "vertical" (equal angles of the points where the cuts meet the centreline);
    fine: chords per block along the arcs. Density and gravity 1, horizontal body load.
    """
    inner, outer = 1.0 - thickness / 2.0, 1.0 + thickness / 2.0
    angles = np.linspace(0.0, np.pi, pieces + 1)
    elements: list[dict[str, Any]] = []
    for k in range(pieces):
        first, last = float(angles[k]), float(angles[k + 1])
        lower, upper = (_arc(inner, first, last, fine), _arc(outer, first, last, fine))
        if cuts == "vertical":
            right, left = float(np.cos(first)), float(np.cos(last))
            right = outer if k == 0 else right
            left = -outer if k == pieces - 1 else left
            lower, upper = (_arc(r, *_angles_over(r, left, right), fine) for r in (inner, outer))
        outline = np.concatenate([lower[::-1], upper])
        keep = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1) > 1e-9
        elements.append({"id": f"v{k}", "polygon": outline[keep].tolist()})
    return parse_scene(
        {
            "name": f"semicircular arch, {cuts} cuts, {pieces} blocks",
            "units": {"length": "R", "force": "ρgR³"},
            "elements": elements + _springings(inner, outer),
            "materials": {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}},
            "loads": {"live": [{"body": [1.0, 0.0]}]},
        }
    )


def _arc(radius: float, first: float, last: float, chords: int) -> Floats:
    """(chords + 1, 2) points of an arc about the origin, angles in radians."""
    angles = np.linspace(first, last, chords + 1)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _angles_over(radius: float, left: float, right: float) -> tuple[float, float]:
    """Angles of the upper half circle between two abscissae, from right to left."""
    ends = np.arccos(np.clip(np.array([right, left]) / radius, -1.0, 1.0))
    return float(ends[0]), float(ends[1])


def polar_grid_arch(
    rings: int, sectors: int, thickness: float, live: list[dict[str, Any]], search: dict[str, Any] | None = None
) -> Scene:
    """A semicircular arch of candidate cells in polar coordinates, R = 1 m at the centreline, 0.2 m deep.

    rings, sectors: cells across and along the arch; cell "r{ring}s{sector}", ring 0 the innermost, sector 0 at the
    right springing; chords for arcs. thickness: m. live: load entries. search: as in a scene file. Stone of
    2000 kg/m³, dry 30°, σt = τ = 0.2 MPa.
    """
    radii = np.linspace(1.0 - thickness / 2.0, 1.0 + thickness / 2.0, rings + 1)
    angles = np.linspace(0.0, np.pi, sectors + 1)
    elements: list[dict[str, Any]] = []
    for ring in range(rings):
        for sector in range(sectors):
            first, last = float(angles[sector]), float(angles[sector + 1])
            inner, outer = (_arc(float(r), first, last, 1) for r in radii[ring : ring + 2])
            elements.append({"id": f"r{ring}s{sector}", "polygon": [*inner[::-1].tolist(), *outer.tolist()]})
    return parse_scene(
        {
            "name": f"semicircular arch of {rings} × {sectors} cells",
            "elements": elements + _springings(float(radii[0]), float(radii[-1])),
            "thickness": 0.2,
            "materials": {
                "density": 2000,
                "dry": {"friction_angle": 30},
                "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
            },
            "loads": {"live": live},
            "search": search or {},
        }
    )


def t_block(tension: float, shear: float, load: str = "arm", rigid: bool = False) -> Scene:
    """A T of five cells of 0.1 m on a dry base: three cells on top, two below their middle; four inner faces.

    tension, shear: σt and τ, Pa. load: "arm", a vertical force on the tip of the right arm, or "top", a horizontal
    one at the middle of the top. rigid: the same outline as a single element. 1400 kg/m³, dry 30°, 0.1 m deep.
    Source: after Figure 1 of Iannuzzo et al. 2024; the measures are ours.
    """
    cells = {"left": (0, 2), "middle": (1, 2), "right": (2, 2), "stem": (1, 1), "foot": (1, 0)}
    elements: list[dict[str, Any]] = [
        {"id": name, "polygon": [[0.1 * (x + i), 0.1 * (y + j)] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]}
        for name, (x, y) in cells.items()
    ]
    if rigid:
        grid = [(1, 0), (2, 0), (2, 2), (3, 2), (3, 3), (0, 3), (0, 2), (1, 2)]
        elements = [{"id": "block", "polygon": [[0.1 * x, 0.1 * y] for x, y in grid]}]
    ground = [[0.0, -0.05], [0.3, -0.05], [0.3, 0.0], [0.0, 0.0]]
    held = ("right", [0.3, 0.3], [0, -1]) if load == "arm" else ("middle", [0.15, 0.25], [1, 0])
    faces = [["left", "middle"], ["middle", "right"], ["middle", "stem"], ["stem", "foot"]]
    return parse_scene(
        {
            "name": "T block, rigid" if rigid else "T block of five elements",
            "elements": [*elements, {"id": "ground", "polygon": ground, "support": True}],
            "thickness": 0.1,
            "materials": {
                "density": 1400,
                "dry": {"friction_angle": 30},
                "inner": {"tensile_strength": tension, "shear_strength": shear},
            },
            "loads": {"live": [{"element": "block" if rigid else held[0], "at": held[1], "force": held[2]}]},
            "labels": {} if rigid else {"inner": faces},
        }
    )


def leonardo_flat_arch(
    friction: float = float(np.tan(np.radians(30.0))),
    tension: float = 2e6,
    shear: float = 2e5,
    search: dict[str, Any] | None = None,
    abutments: bool = False,
) -> Scene:
    """An interlocking flat arch of five blocks with a T in the middle, on two bearings; cells of 0.1 m.

    friction: coefficient; tension, shear: σt and τ, Pa; search: as in a scene file. 1400 kg/m³; three vertical forces,
    λ N each, on top of the three upper cells of the T. The arch rests on dry bearings of three cells, 0.3 m apart, and
    is free to slide, so that its thrust is what friction on them gives; with abutments it is held between two fixed
    walls instead, and no bearings.
    Source: after section 3.3 of Iannuzzo et al. 2024; its layout is not at hand, this one is ours.
    """
    rows = ["#aabTTTcdd#", "#aabbTccdd#"] if abutments else ["aabTTTcdd", "aabbTccdd", "###...###"]
    top, first = 0.1 * len(rows), 4 if abutments else 3
    columns = range(first, first + 3)
    live = [{"element": f"c{k}r0", "force": [0, -1], "at": [0.1 * k + 0.05, top]} for k in columns]
    return parse_scene(
        {
            "name": "interlocking flat arch after Leonardo",
            "grid": {"cell": [0.1, 0.1], "thickness": 0.1, "rows": rows},
            "materials": {
                "density": 1400,
                "dry": {"friction_coefficient": friction},
                "inner": {"tensile_strength": tension, "shear_strength": shear},
            },
            "loads": {"live": live},
            "search": search or {},
        }
    )


def wall_with_opening(rows: list[str], friction: float = 0.75, search: dict[str, Any] | None = None) -> Scene:
    """A wall of cells 0.4 m long, 0.3 m high and thick under a horizontal body load; 2000 kg/m³, σt = τ = 0.2 MPa.

    rows: as in a scene file, "." in the opening. friction: coefficient. search: as in a scene file.
    """
    return parse_scene(
        {
            "name": "wall with an opening",
            "grid": {"cell": [0.4, 0.3], "thickness": 0.3, "rows": rows},
            "materials": {
                "density": 2000,
                "dry": {"friction_coefficient": friction},
                "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
            },
            "loads": {"live": [{"body": [1, 0]}]},
            "search": search or {},
        }
    )


def corner(
    courses: int, direction: float, bond: str | None = "interlocking", search: dict[str, Any] | None = None
) -> Scene:
    """A corner of two walls of three cells each on a slab, cells 0.3 m, one course of five cells upon another.

    direction: of a horizontal body load, radians from the wall along x about z. bond: "interlocking" (the corner
    stone lies in one wall and in the other by turns), "plain" (always in the wall along x: a straight joint), or None
    (every cell its own block). search: as in a scene file. 2000 kg/m³, dry μ = 0.6, σt = τ = 0.2 MPa.
    """
    path = [(2, 0), (1, 0), (0, 0), (0, 1), (0, 2)]
    pairs = {"x": ("a", "b", "b", "c", "c"), "y": ("a", "a", "b", "b", "c")}
    elements: list[dict[str, Any]] = []
    for k in range(courses):
        for place, (i, j) in enumerate(path):
            low = (0.3 * i, 0.3 * j, 0.3 * k)
            keys: dict[str, Any] = {}
            if bond is not None:
                turn = "x" if bond == "plain" or k % 2 == 0 else "y"
                keys = {"block": f"{pairs[turn][place]}{k}"}
            high = (0.3 * (i + 1), 0.3 * (j + 1), 0.3 * (k + 1))
            elements.append(box(f"p{place}k{k}", low, high, **keys))
    elements.append(box("ground", (-0.3, -0.3, -0.15), (1.2, 1.2, 0.0), support=True))
    return parse_scene(
        {
            "name": f"corner of {courses} courses, {bond or 'cells'}",
            "elements": elements,
            "materials": {
                "density": 2000,
                "dry": {"friction_coefficient": 0.6},
                "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
            },
            "loads": {"live": [{"body": [float(np.cos(direction)), float(np.sin(direction)), 0.0]}]},
            "search": search or {},
        }
    )
