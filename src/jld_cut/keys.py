"""Joints on which the parts of the strongest layout slide, as tongues, steps and keys where these raise λ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any, Final

import numpy as np
import shapely

from jld_core import DeadlinePassed, Floats, InputError, Ints
from jld_cut.cells import SPLIT, Cutting, basis, joints_of, sections, sides_of, unique_planes
from jld_cut.meshes import as_written, doubled_edges, manifold3d, pieces_of, surface_of
from jld_cut.partitions import Bounds
from jld_cut.parts import Part
from jld_cut.scene import Setting, scene_of
from jld_cut.search import Bracket, Family, FineModel, low_of, weaker

KINDS: Final = ("tongue", "step", "key")  # a rib across the joint, half of the joint, a block in its middle
_GAIN: Final = 1.05  # of λ, from which a key stays: more faces alone bear some more torsion
_BETTER: Final = 1.01  # the same of one kind of key over another
_ROUNDS: Final = 3  # mechanisms whose joints are keyed, one after the other
_WIDTH: Final = 1 / 3  # of a tongue or a key by the length of its joint along the slip
_DEPTH: Final = 1 / 6  # of a key, by the same
_BEHIND: Final = 0.3  # most of what lies behind the joint that a key goes into
_LONG: Final = 1.5  # ratio of its sides from which a joint is keyed along them, or the share of its box that it fills
_FULL: Final = 0.85
_LEAST: Final = 0.02  # slip of a face of a joint that is keyed by the largest movement of all
_OPENS: Final = 1.05  # most opening of a joint that slides, by that of its friction or by its slip
_SLIDES: Final = 0.5  # share of the area of a joint that slides


@dataclass(frozen=True)
class Key:
    """Key of one part that goes into another one."""

    kind: str
    on: int  # number of the part that bears it
    into: int
    at: Floats  # (3,) in its joint
    along: Floats  # (3,) way on which `into` slid over `on`

    def told(self) -> str:
        return f"{self.kind} of part {self.on} into {self.into}"


@dataclass(frozen=True)
class Slide:
    """Joint of two parts that slides: `above` moves along a direction over `below`."""

    below: int
    above: int
    plane: Floats  # (4,) normal from `below` to `above`, offset
    region: Any  # in the frame of the plane
    along: Floats  # (3,) area × slip

    def ends(self, up: bool) -> tuple[int, int]:
        """Return the part with the key, then the other; up: it is on `below`."""
        return (self.below, self.above) if up else (self.above, self.below)


def slides(family: Family, block: Ints, friction: float) -> list[Slide]:
    """Return the joints between parts (n,) that slide in the mechanism on convex cells, the largest slip first."""
    fine, cutting = family.fine, family.cutting
    assembly, jumps = fine.jumps(block)
    if jumps is None or not np.isfinite(jumps).all() or not jumps.any():
        return []
    faces = assembly.interfaces
    slip = faces.e1 * jumps[:, 1, None] + faces.e2 * jumps[:, 2, None]
    # a joint that slides opens by its friction, one that turns about an edge by more
    size = np.linalg.norm(slip, axis=1)
    sliding = jumps[:, 0] <= _OPENS * max(1.0, friction) * size
    sliding &= size > _LEAST * np.linalg.norm(jumps[:, :3], axis=1).max()
    # cells of supports belong to no part
    part = np.append(block[fine.of], np.full(len(assembly.elements) - len(fine.of), -1))
    first, second, origins = part[faces.a], part[faces.b], np.asarray(faces.origin)
    slides_found = []
    for plane in unique_planes(cutting.planes, cutting.size):
        in_plane = (np.abs(origins @ plane[:3] - plane[3]) < 1e-6 * cutting.size) & (
            np.abs(faces.normal @ plane[:3]) > 1 - 1e-6
        )
        regions: dict[tuple[int, int], list[Any]] = {}
        for a, b, region in sections(cutting.cells, plane, cutting.size):
            regions.setdefault((int(block[a]), int(block[b])), []).append(region)
        for (below, above), pieces in regions.items():
            of_pair = in_plane & (((first == below) & (second == above)) | ((first == above) & (second == below)))
            sliding_faces = of_pair & sliding
            if below == above or faces.area[sliding_faces].sum() <= _SLIDES * faces.area[of_pair].sum():
                continue
            sign = np.where(first[sliding_faces] == below, 1.0, -1.0)
            along = (sign * faces.area[sliding_faces]) @ slip[sliding_faces]
            slides_found.append(Slide(below, above, plane, shapely.union_all(pieces), along))
    return sorted(slides_found, key=lambda slide: -float(np.linalg.norm(slide.along)))


def _direction(region: Any, along: Floats) -> Floats:
    """Return the direction (2,) of the side of a region nearest to a slip (2,); that of the slip for a round one."""
    along = along / np.linalg.norm(along)
    ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(region))
    sides = np.diff(ring[:3], axis=0)
    size = np.linalg.norm(sides, axis=1)
    if size.max() < _LONG * size.min() and region.area < _FULL * size.prod():
        return np.asarray(along)
    sides = sides / size[:, None]
    best = sides[np.argmax(np.abs(sides @ along))]
    return np.asarray(best * np.sign(best @ along))


def _median(plan: Any) -> float:
    """Return the first coordinate that halves the area of a region."""
    low, bottom, high, top = plan.bounds
    ends = [low, high]
    for _ in range(40):
        middle = sum(ends) / 2
        ends[int(shapely.clip_by_rect(plan, low, bottom, middle, top).area > plan.area / 2)] = middle
    return float(sum(ends) / 2)


def _tool(slide: Slide, kind: str, up: bool, cells: list[Any], size: float) -> tuple[Any, list[Floats]]:
    """Return the body within which the cells of one part become a key of the other, and the planes of its sides."""
    sign = 1.0 if up else -1.0
    normal, offset = sign * slide.plane[:3], sign * slide.plane[3]
    frame = basis(slide.plane[:3])
    along = _direction(slide.region, frame @ slide.along) @ frame
    across = np.cross(normal, along)
    plan = shapely.transform(slide.region, lambda at: at @ frame @ np.column_stack([along, across]))
    low, high = np.array(plan.bounds).reshape(2, 2)
    behind = max(float((surface_of(cell)[0] @ normal).max()) for cell in cells) - offset
    # as of a rectangle of the same width and area
    length, reach = np.array([plan.area / (high[1] - low[1]), high[1] - low[1]]), 0.1 * size
    depth = min(_DEPTH * length[0], _BEHIND * behind)
    middle = np.array([_median(plan), plan.centroid.y])
    start, end = middle - _WIDTH * length / 2, middle + _WIDTH * length / 2
    if kind != "key":
        start[1], end[1] = low[1] - reach, high[1] + reach
    if kind == "step":
        # the part that moves pushes before it what the other one keeps
        start[0], end[0] = (low[0] - reach, middle[0]) if not up else (middle[0], high[0] + reach)
    # from a little behind the joint, where the part has nothing: rounding would leave a sheet
    back = 1e-3 * depth
    sides = (*(end - start), depth + back)
    body = manifold3d().Manifold.cube(tuple(sides)).translate((*start, offset - back))
    planes = [np.array([*axis, corner[k]]) for k, axis in enumerate((along, across)) for corner in (start, end)]
    planes.append(np.array([*normal, offset + depth]))
    return body.transform(np.column_stack([along, across, normal, np.zeros(3)])), planes


def _keyed_cells(
    cells: list[Any], block: Ints, slide: Slide, kind: str, up: bool, size: float
) -> tuple[list[Any], Ints, list[Floats]] | None:
    """Give what lies within a key from one part to the other; None where the joint has no room for it."""
    on, into = slide.ends(up)
    tool, planes = _tool(slide, kind, up, [c for c, name in zip(cells, block, strict=True) if name == into], size)
    bodies: list[Any] = []
    owners: list[int] = []
    count = 0
    for cell, name in zip(cells, block.tolist(), strict=True):
        keyed = []
        for piece in pieces_of(cell ^ tool) if name == into else []:
            base = shapely.union_all(sides_of(piece, slide.plane, size))
            if piece.volume() < 1e-9 * size**3 or base.area < 1e-9 * size**2:
                continue
            behind = (surface_of(piece)[0] @ slide.plane[:3] - slide.plane[3]) * (1.0 if up else -1.0)
            outside = base.difference(slide.region.buffer(1e-7 * size)).area
            if behind.min() < -1e-7 * size or outside > 1e-9 * size**2:
                return None
            keyed.append(piece)
        remainder = cell
        for piece in keyed:
            remainder = remainder - piece
        pieces = [piece for piece in pieces_of(remainder) if piece.volume() > 1e-12 * size**3] if keyed else [cell]
        bodies += [*pieces, *keyed]
        owners += [name] * len(pieces) + [on] * len(keyed)
        count += len(keyed)
    volume = sum(cell.volume() for cell in cells)
    if not count or abs(sum(body.volume() for body in bodies) - volume) > 1e-9 * volume:
        return None
    return bodies, np.array(owners, dtype=np.int64), planes


@dataclass(frozen=True)
class Keyed:
    """Layout with keys in the joints on which it slid."""

    family: Family
    block: Ints
    bracket: Bracket
    keys: tuple[Key, ...]


def variants(family: Family, block: Ints, sliding: list[Slide], setting: Setting, least: float) -> Iterator[Keyed]:
    """Yield layouts that carry more than `least`, with keys of one kind and side in all joints that have the room."""
    number = {name: k + 1 for k, name in enumerate(sorted(set(block.tolist())))}
    for kind, up in product(KINDS, (True, False)):
        cells, names, planes, keys = family.cutting.cells, block, list[Floats](), list[Key]()
        for slide in sliding:
            keyed_cells = _keyed_cells(cells, names, slide, kind, up, family.cutting.size)
            if keyed_cells is None:
                continue
            on, into = slide.ends(up)
            middle = np.array(slide.region.centroid.coords[0]) @ basis(slide.plane[:3])
            at, sign = middle + slide.plane[3] * slide.plane[:3], 1.0 if up else -1.0
            keys.append(Key(kind, number[on], number[into], at, sign * slide.along))
            cells, names, planes = keyed_cells[0], keyed_cells[1], [*planes, *keyed_cells[2]]
        if not keys:
            continue
        cutting = Cutting(family.cutting.solid, cells, [*family.cutting.planes, *planes])
        joints = joints_of(cells, cutting.planes, cutting.size, SPLIT)
        try:
            document = scene_of(family.document["name"], cutting, joints, setting, SPLIT, cutting.planes)
            coarse = float(Bounds(document, few=True)(names[None])[0][0])
        except InputError:  # splinters may leave joints that no face bears out
            continue
        if coarse <= least:
            continue
        variant = replace(family, cutting=cutting, joints=joints, document=document)
        variant.fine = FineModel(variant, setting, few=True)
        bracket = weaker(variant.fine.solve(names), coarse)
        if low_of(bracket) > least and not (variant.fine.coarse and not family.fine.coarse):
            yield Keyed(variant, names, bracket, tuple(keys))


def keyed(family: Family, block: Ints, low: float, setting: Setting, sound: Callable[[Keyed], bool]) -> Keyed | None:
    """Return the layout with the keys that raise λ most of those that are sound, round by round; None for no gain.

    What was found stays where a deadline ends the search.
    """
    best, least = Keyed(family, block, (low, None, False), ()), _GAIN * low
    friction = float(np.tan(np.radians(setting.matter.friction_angle)))
    try:
        for _ in range(_ROUNDS):
            before, limit = best, least
            sliding = slides(before.family, before.block, friction)
            for variant in variants(before.family, before.block, sliding, setting, least):
                if low_of(variant.bracket) > limit and sound(variant):
                    limit = _BETTER * low_of(variant.bracket)
                    best = replace(variant, keys=(*before.keys, *variant.keys))
            if best is before:
                break
            least = _GAIN * low_of(best.bracket)
    except DeadlinePassed:
        pass
    return best if best.keys else None


def are_sound(parts: list[Part], unit: float) -> bool:
    """Return whether parts are one closed piece each, in their files too, and overlap nowhere."""
    for part in parts:
        if len(pieces_of(part.exact)) > 1 or doubled_edges(*as_written(part.solid, unit)):
            return False
    least = 1e-9 * min(part.exact.volume() for part in parts)
    return all((first.solid ^ second.solid).volume() <= least for first, second in combinations(parts, 2))
