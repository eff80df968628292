"""Check proofs over boxes exactly, docs/method.md (11.7), sharing only the reading of scenes with the search."""

from __future__ import annotations

import time
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np

from jld_core import Assembly, Floats, InputError, Route, Scene, build_assembly, parse_scene
from jld_geometry.box_certificate import KEY, BoxClaim, Leaf, Node, Split, read
from jld_geometry.box_structure import BoxStructure, Loads, Polynomial, add, is_at_least_zero, product

_ROUTE: Final = Route("certificates of boxes")

Velocity = tuple[Fraction, Fraction, Fraction]  # exact velocity (ux, uy, ω) about the origin of coordinates

_STILL: Velocity = (Fraction(0), Fraction(0), Fraction(0))  # velocity of elements that do not move


@dataclass(frozen=True)
class VerifiedBox:
    """Result of a successful check: no position in the box carries a λ above `claim.bound`."""

    claim: BoxClaim  # statement of the certificate
    scene: Scene  # scene that the certificate holds
    boxes: int  # number of boxes with a mechanism of their own
    size: int  # size of the file, bytes
    seconds: float  # time of the check, s


def is_box_certificate(path: Path) -> bool:
    """Return whether a file begins like the certificate of a proof over a box."""
    try:
        with path.open("rb") as file:
            return file.read(len(KEY) + 16).lstrip().startswith(f'{{"{KEY}"'.encode())
    except (OSError, ValueError):
        return False


def verify_box(path: Path, scene: Scene | None = None) -> VerifiedBox:
    """Check a certificate of `jld move --prove`; InputError for the first thing that does not hold."""
    start = time.perf_counter()
    claim, nodes = read(path)
    held = parse_scene(claim.scene, str(path))
    if scene is not None:
        _require_same(scene, held, str(path))
    try:
        boxes = check_boxes(held, claim, nodes)
    except InputError as error:
        raise error.within(str(path)) from None
    return VerifiedBox(claim, held, boxes, path.stat().st_size, time.perf_counter() - start)


def _require_same(scene: Scene, held: Scene, path: str) -> None:
    """Raise InputError unless two scenes are the same structure and loads, to 1e-9."""
    one, other = build_assembly(scene), build_assembly(held)
    if one.elements.ids != other.elements.ids or _numbers(one).shape != _numbers(other).shape:
        same = False
    else:
        same = np.allclose(_numbers(one), _numbers(other), rtol=1e-9, atol=1e-9)
    if not same:
        raise InputError(path, f"it is of another scene ({held.name!r})", f"a certificate of {scene.name!r}")


def _numbers(assembly: Assembly) -> Floats:
    """Return geometry, loads, friction and labels of an assembly as one vector."""
    # Lengths are relative to the size of the structure, and loads to the largest one.
    elements, faces, size = assembly.elements, assembly.interfaces, assembly.size
    loads = [load for case in assembly.by_case for load in (case.dead, case.live)]
    largest = np.array([abs(load).max(initial=0.0) for load in loads])
    scaled = [load / (most or 1.0) for load, most in zip(loads, largest.tolist(), strict=True)]
    parts = [elements.centroid / size, elements.volume, faces.origin / size, faces.l1, largest, *scaled]
    parts += [assembly.strengths(_ROUTE).friction, assembly.required]
    parts += [one.astype(float) for one in (faces.a, faces.b, assembly.labels)]
    return np.concatenate([part.ravel() for part in parts])


def check_boxes(scene: Scene, claim: BoxClaim, nodes: list[Node]) -> int:
    """Check the tree of a certificate; return its number of boxes with a mechanism."""
    checker = _Checker(BoxStructure(scene, claim), claim)
    start = [Fraction(low) for low, _ in claim.box], [Fraction(high) for _, high in claim.box]
    open_boxes, leaves = [start], 0
    for number, node in enumerate(nodes, 1):
        if not open_boxes:
            raise InputError(f"node {number}", "the tree ends before it", "one tree")
        low, high = open_boxes.pop()
        if isinstance(node, Leaf):
            checker.check(node, low, high, number)
            leaves += 1
            continue
        open_boxes += _halves(node, low, high, number)
    if open_boxes:
        raise InputError("tree", f"it leaves {len(open_boxes)} boxes without a mechanism", "a tree of the whole box")
    return leaves


def _halves(
    node: Split, low: list[Fraction], high: list[Fraction], number: int
) -> list[tuple[list[Fraction], list[Fraction]]]:
    """Return the upper and the lower half of a box, each as (low, high)."""
    at = Fraction(node.at)
    if not 0 <= node.axis < len(low) or not low[node.axis] < at < high[node.axis]:
        raise InputError(f"node {number}", "it splits outside of its box", "a split inside")
    upper, lower = list(low), list(high)
    upper[node.axis] = lower[node.axis] = at
    return [(upper, high), (low, lower)]


class _Checker:
    """Checker of the mechanisms of one claim."""

    def __init__(self, structure: BoxStructure, claim: BoxClaim) -> None:
        self._structure, self._bound = structure, Fraction(claim.bound)

    def check(self, leaf: Leaf, low: list[Fraction], high: list[Fraction], number: int) -> None:
        """Raise InputError unless a mechanism proves the bound for all positions of a box."""
        structure, unit = self._structure, 1 << leaf.digits
        if not 0 <= leaf.case < len(structure.cases) or not leaf.moves.keys() <= structure.free:
            raise InputError(
                f"node {number}", "it names a load case or element that is not there", "those of the scene"
            )
        moves = {
            k: (Fraction(ux, unit), Fraction(uy, unit), Fraction(turn, unit))
            for k, (ux, uy, turn) in leaf.moves.items()
        }
        if not self._opens(moves, low, high):
            problem = "in its mechanism a joint closes, or slides without opening, somewhere in the box"
            raise InputError(f"node {number}", problem, "a mechanism that holds in the whole box")
        dead, live, required = structure.cases[leaf.case]
        spent, work = self._power(dead, moves, low, high), self._power(live, moves, low, high)
        count = structure.parameters
        balance = dict(spent)
        add(balance, work, self._bound * required)
        below = is_at_least_zero(work, count, 3, strictly=True) and is_at_least_zero(balance, count, 3)
        falls = is_at_least_zero(spent, count, 3, strictly=True) and is_at_least_zero(work, count, 3)
        if not (below or falls):
            raise InputError(f"node {number}", "its mechanism lets positions carry more than the bound", "a proof")

    def _opens(self, moves: dict[int, Velocity], low: list[Fraction], high: list[Fraction]) -> bool:
        """Return whether no joint resists a mechanism, at any position in the box."""
        # A joint does not resist if it opens at both ends by at least friction times the slip.
        structure, none = self._structure, (0,) * self._structure.parameters
        for joint in structure.joints:
            jump = [b - a for a, b in zip(moves.get(joint.a, _STILL), moves.get(joint.b, _STILL), strict=True)]
            if not any(jump):
                continue
            (x0, y0), (x1, y1) = ends = [structure.place(end, low, high) for end in joint.ends]
            along: tuple[Polynomial, Polynomial] = (dict(x1), dict(y1))
            add(along[0], x0, -1)
            add(along[1], y0, -1)
            for x, y in ends:
                speed: tuple[Polynomial, Polynomial] = ({none: jump[0]}, {none: jump[1]})
                add(speed[0], y, -jump[2])
                add(speed[1], x, jump[2])
                # components of the speed along the normal (e_y, −e_x) and along the joint e, times its length
                normal = product(along[1], speed[0])
                add(normal, product(along[0], speed[1]), -1)
                slide = product(along[0], speed[0])
                add(slide, product(along[1], speed[1]))
                for sign in (-1, 1):
                    total = dict(normal)
                    add(total, slide, sign * joint.friction)
                    if not is_at_least_zero(total, structure.parameters, 2):
                        return False
        return True

    def _power(self, loads: Loads, moves: dict[int, Velocity], low: list[Fraction], high: list[Fraction]) -> Polynomial:
        """Return the power of loads under a mechanism over a box, as a polynomial."""
        none = (0,) * self._structure.parameters
        total: Polynomial = {none: Fraction(0)}
        for element, (ux, uy, turn) in moves.items():
            force = loads.per_area.get(element)
            if force is not None and any(force):
                area, first_x, first_y = self._structure.moments(element, low, high)
                add(total, area, force[0] * ux + force[1] * uy)
                add(total, first_y, -turn * force[0])
                add(total, first_x, turn * force[1])
        for element, force, (x, y), moment in loads.points:
            ux, uy, turn = moves.get(element, _STILL)
            total[none] += force[0] * (ux - turn * y) + force[1] * (uy + turn * x) + moment * turn
        return total


def box_facts(done: VerifiedBox) -> dict[str, object]:
    """Return the outcome of a successful check as JSON data."""
    claim = done.claim
    return {
        "scene": done.scene.name,
        "bound": claim.bound,
        "found": claim.load_factor,
        "box": [list(ends) for ends in claim.box],
        "parameters": None if claim.parameters is None else list(claim.parameters),
        "boxes": done.boxes,
        "bytes": done.size,
        "seconds": done.seconds,
    }


def box_words(done: VerifiedBox) -> str:
    """Describe the outcome of a successful check for the terminal."""
    claim = done.claim
    box = " × ".join(f"[{low:.6g}, {high:.6g}]" for low, high in claim.box)
    lines = [
        f"verified: no position of the joints of {done.scene.name!r} in {box} carries more than λ = {claim.bound:.9g}",
        f"  by mechanisms for {done.boxes} boxes, in {done.size / 1e3:.0f} kB, checked in {done.seconds:.2f} s",
    ]
    if claim.load_factor is not None and claim.parameters is not None:
        where = ", ".join(f"{value:.6g}" for value in claim.parameters)
        lines.append(f"  found (by the search; not part of what is checked): λ = {claim.load_factor:.9g} at {where}")
    return "\n".join(lines)
