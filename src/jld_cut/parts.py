"""Parts of a cut solid: clearance, boxes, beds, and files that are read again."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from jld_core import Floats, InputError, Ints, checkpoint, files
from jld_core.geometry import unions
from jld_cut.cells import Joint, basis, closed, union
from jld_cut.meshes import (
    as_read,
    as_single,
    as_written,
    doubled_edges,
    kind_of,
    moments,
    obj_text,
    open_edges,
    pieces_of,
    stl_bytes,
    surface_of,
    volume_of,
    write_3mf,
)
from jld_cut.whole import normals_of

_SPLINTER: Final = 1e-6  # of the volume of a part
_LOST: Final = 0.5  # share of its volume that clearance may take of a part
_TRUE: Final = 1e-6  # error of a volume that a file may have
_BEDS: Final = 12  # largest faces that a part may lie on


@dataclass
class Part:
    """Numbered part of a solid."""

    number: int
    cells: list[int]
    exact: Any  # union of its cells
    solid: Any  # the same with clearance
    mass: float
    box: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) sides of its smallest box, ascending
    bed: Floats = field(default_factory=lambda: np.eye(3))  # (3, 3) rotation that lays it on the bed
    open: int = 0  # edges of its file that other than two faces meet at
    step: int = 0
    direction: Floats = field(default_factory=lambda: np.zeros(3))
    marked: bool = False  # number and arrow are engraved
    error: float = 0.0  # of the volume in its file, or of what was cut, whichever is more

    @property
    def watertight(self) -> bool:
        return not self.open and self.error <= _TRUE

    @property
    def fault(self) -> str:
        edges = f"{self.open} edges that other than two faces meet at" if self.open else ""
        volume = f"a volume that differs by {self.error:.1e}" if self.error > _TRUE else ""
        return f"part {self.number} has {' and '.join(word for word in (edges, volume) if word)}"

    @property
    def name(self) -> str:
        return f"part_{self.number:02d}"


def parts_of(cells: list[Any], block: Ints, joints: list[Joint], density: float, clearance: float) -> list[Part]:
    """Return the parts of cells by their blocks (n,), numbered from 1, with clearance at dry joints."""
    names = sorted(set(block.tolist()))
    members = [np.flatnonzero(block == name).tolist() for name in names]
    exact = [union([cells[k] for k in group]) for group in members]
    place = {name: k for k, name in enumerate(names)}
    solids = list(exact)
    done: set[tuple[Any, ...]] = set()
    for joint in joints if clearance > 0.0 else ():
        a, b = place[int(block[joint.a])], place[int(block[joint.b])]
        key = (a, b, *np.round(joint.normal, 9).tolist())
        if a == b or key in done:
            continue
        done.add(key)
        move = 0.5 * clearance * joint.normal
        solids[a] -= exact[b].translate(tuple(-move))
        solids[b] -= exact[a].translate(tuple(move))
    found = []
    for k, (group, whole, solid) in enumerate(zip(members, exact, solids, strict=True)):
        pieces = [one for one in pieces_of(solid) if one.volume() > _SPLINTER * whole.volume()]
        if sum(piece.volume() for piece in pieces) < _LOST * whole.volume():
            problem = f"part {k + 1} is thinner than a clearance of {clearance:g} m leaves whole"
            raise InputError("clearance", problem, "a smaller clearance")
        left = sum(piece.volume() for piece in pieces)
        one = (closed(pieces, left) if solid is not whole else None) or union(pieces)
        found.append(Part(k + 1, group, whole, one, density * whole.volume()))
        cut_to = sum(cells[i].volume() for i in group)
        found[-1].error = max(abs(whole.volume() / cut_to - 1.0), abs(one.volume() / solid.volume() - 1.0))
    return found


def different(parts: list[Part]) -> int:
    """Return how many parts are of different shape: a part and its mirror image are alike."""
    found = np.array([moments(part.exact) for part in parts])
    return len({kind_of(one, float(found[:, 0].max())) for one in found})


def lay(part: Part, fit: Floats, turned: Floats = np.zeros((0, 3, 3))) -> bool:  # noqa: B008
    """Find box and bed of a part; return whether it fits into a box of sides `fit` (3,), ascending.

    turned: (k, 3, 3) rotations that are tried beside those that lay it on a face.
    """
    points, triangles = surface_of(part.exact)
    corners = points[triangles]
    normal, area = normals_of(corners)
    kinds, place = np.unique(np.round(normal / np.maximum(area, 1e-300)[:, None], 4), axis=0, return_inverse=True)
    share = np.bincount(place.reshape(-1), area)
    largest = np.argsort(-share)[:_BEDS].tolist()
    spins = []
    for down, size in [*((kinds[k], float(share[k])) for k in largest), *((axis, 0.0) for axis in np.eye(3))]:
        if np.linalg.norm(down) < 0.5:
            continue
        up = -down / np.linalg.norm(down)
        frame = np.array([*basis(up), up])
        plan = points @ frame[:2].T
        rectangle = shapely.minimum_rotated_rectangle(shapely.MultiPoint(plan))
        ring = shapely.get_coordinates(rectangle)
        first = ring[1] - ring[0]
        # the smallest rectangle may be long where one along the axes is not
        for turn in (float(np.arctan2(first[1], first[0])), 0.0):
            spin = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]) @ frame
            spins.append((size, spin))
    best: tuple[Any, ...] | None = None
    for size, spin in [*spins, *((0.0, one) for one in turned)]:
        sides = np.sort(np.ptp(points @ spin.T, axis=0))
        scale = float((sides / fit).max())
        good = scale <= 1.0 + 1e-6
        key = (good, size if good else -scale, -scale)
        if best is None or key > best[0]:
            best = key, sides, spin, good
    assert best is not None
    _, part.box, part.bed, fits = best
    return bool(fits)


def plain_surface(solid: Any) -> unions.Surface:
    """Return the surface of a solid with each plane region as one face where that keeps its volume, else triangles."""
    checkpoint()
    points, triangles = surface_of(solid)
    try:
        found = unions.union_solids([points], [triangles.tolist()])
    except (shapely.errors.GEOSException, InputError, ValueError):  # regions that touch themselves
        found = None
    if found is not None:
        fans = np.array([(f[0], f[k], f[k + 1]) for f in found.faces for k in range(1, len(f) - 1)])
        held = [volume_of(found.points, corners) for corners in (fans, np.array(found.triangles))]
        if not len(open_edges(fans)) and np.allclose(held, volume_of(points, triangles), rtol=1e-6, atol=0.0):
            return found
    faces = tuple((a, b, c) for a, b, c in triangles.tolist())
    return unions.Surface(points, faces, faces)


def write_parts(folder: Path, parts: list[Part], unit: float) -> None:
    """Write each part as STL and OBJ where it stands and as STL on its bed, and all as one 3MF; read STL again."""
    for name in ("parts", "bed"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    surfaces = []
    for part in parts:
        points, triangles = as_written(part.solid, unit)
        path = folder / "parts" / f"{part.name}.stl"
        path.write_bytes(stl_bytes(points, triangles))
        again = as_read(path.read_bytes())
        part.error = max(part.error, abs(unit**3 * volume_of(*again) / part.solid.volume() - 1.0))
        part.open = doubled_edges(*again)
        files.write_text(folder / "parts" / f"{part.name}.obj", obj_text(points, triangles, part.name))
        turned = points @ part.bed.T
        lying = as_single(turned - turned.min(axis=0), triangles)
        (folder / "bed" / f"{part.name}.stl").write_bytes(stl_bytes(*lying))
        surfaces.append((part.name, points * (1e3 * unit), triangles))
    write_3mf(folder / "parts.3mf", surfaces)
