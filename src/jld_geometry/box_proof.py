"""Write certificates of proofs over boxes of positions, and check them independently."""

from __future__ import annotations

import math
import time
from fractions import Fraction
from pathlib import Path
from typing import Final

from jld_core._version import __version__
from jld_core.errors import InputError
from jld_geometry.box_bound import BoxNode, ProvenBox
from jld_geometry.box_certificate import BoxClaim, Leaf, Node, Split, write
from jld_geometry.boxes import check_boxes

# Claimed bound above the one of the search, relative: rounding of its sums and of the load factors required
_RELATIVE_SLACK: Final = 1e-9


def box_claim(done: ProvenBox) -> tuple[BoxClaim, list[Node]]:
    """Return the claim of the certificate of a proof over a box, and the tree of its proof.

    Result: scene, box and bound, which is raised by a little for rounding; and the nodes of the tree, each before its
    halves. Raises InputError if no finite bound was proven.
    """
    nodes = list(_nodes(done.tree, done))
    places = done.places - done.moved
    directions = tuple(
        tuple(
            (tuple(place.tolist()), tuple(way.tolist())) for place, way in zip(places, motion, strict=True) if way.any()
        )
        for motion in done.directions
    )
    claim = BoxClaim(
        scene=done.stated.model_dump(mode="json", exclude_defaults=True),
        bound=done.bound + _RELATIVE_SLACK * abs(done.bound),
        box=tuple(zip(done.low.tolist(), done.high.tolist(), strict=True)),
        directions=directions,
        parameters=tuple(done.parameters.tolist()),
        load_factor=done.load_factor,
        made_by=f"jld {__version__}",
    )
    return claim, nodes


def _nodes(tree: BoxNode, done: ProvenBox) -> list[Node]:
    """Return the nodes of a tree, each before its halves.

    Raises InputError if a leaf has no mechanism, or if no finite bound was proven.
    """
    found: list[Node] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if node.halves:
            found.append(Split(node.axis, node.at))
            waiting += node.halves[::-1]
            continue
        if node.motion is None or not math.isfinite(done.bound):
            raise InputError("certificate", "no bound was proven", "a smaller box, or more time")
        found.append(_leaf(node, done))
    return found


def _leaf(node: BoxNode, done: ProvenBox) -> Leaf:
    """Return the leaf of a certificate for a node with a mechanism, without rounding."""
    # Velocities are about the origin, as integers over a power of two.
    assert node.motion is not None
    exact = {}
    for element, (motion, centre) in enumerate(zip(node.motion.tolist(), done.centroids.tolist(), strict=True)):
        if any(motion):
            ux, uy, turn = (Fraction(value) for value in motion)
            x, y = (Fraction(value) for value in centre)
            exact[element] = (ux + turn * y, uy - turn * x, turn)
    digits = max((value.denominator.bit_length() - 1 for three in exact.values() for value in three), default=0)
    moves = {element: tuple(int(value * (1 << digits)) for value in three) for element, three in exact.items()}
    return Leaf(node.case, digits, moves)


def write_box_certificate(done: ProvenBox, path: Path) -> None:
    """Write the certificate of a proof over a box of positions, for `jld verify`.

    Raises InputError: no finite bound was proven.
    """
    claim, nodes = box_claim(done)
    write(path, claim, nodes)


def check_proof(done: ProvenBox) -> tuple[bool | None, float, str]:
    """Check a proof over a box of positions by exact arithmetic.

    Result: True if the bound is verified in every box of the tree, False if not, None if no bound was proven; time of
    the check, s; and the reason for False or None, "" for True.
    """
    start = time.perf_counter()
    try:
        claim, nodes = box_claim(done)
    except InputError as error:
        return None, time.perf_counter() - start, error.problem
    try:
        check_boxes(done.stated, claim, nodes)
    except InputError as error:
        return False, time.perf_counter() - start, f"{error.where}: {error.problem}"
    return True, time.perf_counter() - start, ""
