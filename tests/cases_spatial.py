"""Polyhedra and spatial scenes for tests, made of prisms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cases import dry_and_inner
from jld_core import Assembly, build_assembly, parse_scene

Document = dict[str, Any]
Array = NDArray[np.float64]

IRREGULAR = np.array([[0.0, 0.0], [2.0, -0.3], [3.1, 1.0], [1.5, 2.2], [-0.4, 1.3]])
TRIANGLE = np.array([[0.0, 0.0], [3.0, 0.4], [0.7, 2.0]])
ELL = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])
OBLONG = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.8], [0.0, 0.8]])


def prism(
    name: str, outline: ArrayLike, low: float, high: float, turn: ArrayLike | None = None, **keys: Any
) -> Document:
    """A vertical prism over a counter-clockwise outline; turn: rotation (3, 3) of the whole."""
    flat = np.asarray(outline, dtype=float)
    k = len(flat)
    points = np.concatenate([np.column_stack([flat, np.full(k, z)]) for z in (low, high)])
    if turn is not None:
        points = points @ np.asarray(turn).T
    sides = [[i, (i + 1) % k, (i + 1) % k + k, i + k] for i in range(k)]
    faces = [list(range(k))[::-1], list(range(k, 2 * k)), *sides]
    return {"id": name, "vertices": points.tolist(), "faces": faces, **keys}


def box(name: str, low: ArrayLike, high: ArrayLike, turn: ArrayLike | None = None, **keys: Any) -> Document:
    """A box between two corners."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return prism(name, [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], z0, z1, turn, **keys)


def split(element: Document) -> Document:
    """The same element with every face cut into triangles."""
    faces = [[face[0], face[i], face[i + 1]] for face in element["faces"] for i in range(1, len(face) - 1)]
    return {**element, "faces": faces}


def scene(elements: list[Document], **keys: Any) -> Document:
    """A document: friction 0.7, strong glue, sideways body load unless said otherwise."""
    materials = dry_and_inner(1.0, 0.7, 0.5, 0.8, gravity=1.0)
    return {
        "elements": elements,
        "materials": {**materials, **keys.pop("materials", {})},
        "loads": {"live": keys.pop("live", [{"body": [1, 0, 0]}])},
        **keys,
    }


def assembly(elements: list[Document], **keys: Any) -> Assembly:
    return build_assembly(parse_scene(scene(elements, **keys)))


def stools(outlines: list[Array], height: float = 1.5, **keys: Any) -> Assembly:
    """Prisms side by side on one slab: as many interfaces as outlines, nothing else touching."""
    shift, elements = 0.0, []
    for position, outline in enumerate(outlines):
        placed = outline + np.array([shift - outline[:, 0].min(), 0.0])
        elements.append(prism(f"p{position}", placed, 0.0, height))
        shift += float(np.ptp(outline[:, 0])) + 1.0
    elements.append(box("slab", [-5, -5, -1], [shift + 5, 8, 0], support=True))
    return assembly(elements, **keys)


def wall(rows: int, columns: int, wythes: int = 2, turn: ArrayLike | None = None) -> list[Document]:
    """Running bond, wythes out of step, on a wide slab."""
    length, width, height = 0.2, 0.1, 0.06
    elements = []
    for r in range(rows):
        for w in range(wythes):
            ends = np.arange(columns + 1) * length
            if (r + w) % 2:
                ends = np.concatenate([[0.0], ends[:-1] + 0.5 * length, [columns * length]])
            for c in range(len(ends) - 1):
                low = [ends[c], w * width, r * height]
                elements.append(box(f"b{r}.{w}.{c}", low, [ends[c + 1], (w + 1) * width, (r + 1) * height], turn))
    high = [columns * length + 1.0, wythes * width + 1.0, 0.0]
    elements.append(box("slab", [-1.0, -1.0, -0.3], high, turn, support=True))
    return elements


def rotation(x: float, y: float, z: float) -> Array:
    """Rotation (3, 3) by angles about x, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([x, y, z]), np.sin([x, y, z])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


SPATIAL: dict[str, Callable[[], Assembly]] = {
    # one structure for each spatial yield set that the batch solver knows
    "stools": lambda: stools([OBLONG, OBLONG[::-1] * 0.9]),
    "running bond": lambda: assembly(wall(2, 2)),
    "rough bond": lambda: assembly(
        wall(2, 1),
        materials={
            "dry": {"friction_coefficient": 0.4, "cohesion": 0.2},
            "inner": {"tensile_strength": 0.3, "shear_strength": 0.5, "friction_coefficient": 0.8},
        },
    ),
    "turned bond": lambda: assembly(
        wall(3, 1, 1, turn=rotation(0.3, -0.2, 0.5)),
        loads={"live": [{"body": [0.3, 1, 0.2]}]},
    ),
}
SPATIAL |= {
    "hulls": lambda: stools([IRREGULAR, TRIANGLE, ELL]),
    "kern bond": SPATIAL["rough bond"],
    "pressed bond": lambda: assembly(wall(2, 1), loads={"live": [{"body": [0.1, 0, -1]}]}),
    "slippery bond": lambda: assembly(wall(2, 1), materials={"dry": {"friction_coefficient": 0.0}}),
}
