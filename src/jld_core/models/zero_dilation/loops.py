"""Bounds on slides from loops of blocks: the other faces of a loop limit each slide.

Around a loop of two, three or four blocks that touch one after the other, the jumps of the faces sum to zero. One
slide is therefore a sum over the modes of the other faces, s = Σ c_k z_k. All z are ≥ 0, and some mechanism of every
solution has one of the two slides of each face equal to zero, hence

    s⁺ ≤ Σ c_k⁺ z_k,    s⁻ ≤ Σ c_k⁻ z_k                                               docs/method.md (4.7)

Without these forms, a program over products permits large values of both slides of a face at once, multiplied by
different forces. The difference of those forces appears in no equation of equilibrium, and walls with openings had no
bound above zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations, product
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly

# Relative residual up to which a sum equals its slide; also the size of coefficients that are rounding
_NOTHING: Final = 1e-9

# Largest coefficient, relative to that of the slide; larger ones come from nearly parallel faces and bound little
_LARGE: Final = 1e3

Loop = tuple[int, ...]
"""Numbers of the faces of one loop."""


def loops_of(assembly: Assembly, rates: Floats) -> Floats:
    """Return coefficients (2e, 4m) of sums of mode rates around loops, ≥ 0 in solutions.

    There are two rows for each face of each loop, docs/method.md (4.7). They bound the slides s⁺ and s⁻ of the face by
    the modes of the other faces, provided one slide of each face is zero. The difference of both rows is the identity
    of the loop, which is zero up to rounding. Faces whose slip is no such sum have no rows. rates: (4m, w) mode rates
    as forms of w velocities.
    """
    jumps = _jumps(rates)
    rows = []
    for loop in face_loops(assembly):
        for face in loop:
            others = np.array([other for other in loop if other != face])
            table = jumps[others].reshape(3 * len(others), -1)
            used = np.flatnonzero((table != 0.0).any(axis=0) | (jumps[face, 2] != 0.0))
            slide = jumps[face, 2, used]
            found = np.linalg.lstsq(table[:, used].T, slide, rcond=None)[0]
            size = np.linalg.norm(slide)
            if np.linalg.norm(found @ table[:, used] - slide) > _NOTHING * size or abs(found).max() > _LARGE:
                continue
            shares = np.zeros(len(rates))
            found = np.where(abs(found) < _NOTHING, 0.0, found).reshape(-1, 3)
            for other, (first, second, slip) in zip(others, found, strict=True):
                shares[4 * other : 4 * other + 4] = first, second, -slip, slip
            pair = np.maximum([shares, -shares], 0.0)
            pair[0, 4 * face + 3] = pair[1, 4 * face + 2] = -1.0
            rows.append(pair)
    return np.vstack([np.zeros((0, len(rates))), *rows])


def has_opening(assembly: Assembly) -> bool:
    """Return True if the assembly has an opening, a hole between its blocks and supports.

    An opening is a loop of blocks that loops of two to four faces do not span, counting faces modulo 2.
    """
    between = _between(assembly)
    cycles = len(between) - _rank((1 << a) ^ (1 << b) for a, b in between)
    return _rank(sum(1 << face for face in loop) for loop in face_loops(assembly)) < cycles


def _rank(rows: Iterable[int]) -> int:
    """Return the rank modulo 2 of binary rows, each given as the bits of one integer."""
    kept: dict[int, int] = {}
    for row in rows:
        while row and row.bit_length() in kept:
            row ^= kept[row.bit_length()]
        if row:
            kept[row.bit_length()] = row
    return len(kept)


def _between(assembly: Assembly) -> list[tuple[int, int]]:
    """Return a pair of node numbers for each face, the lower first.

    All supports are node 0; another element is the node of its index plus 1.
    """
    number = np.where(assembly.elements.support, 0, 1 + np.arange(len(assembly.elements)))
    sides = np.sort(np.column_stack([number[assembly.interfaces.a], number[assembly.interfaces.b]]), axis=1)
    return [(a, b) for a, b in sides.tolist()]


def face_loops(assembly: Assembly) -> Iterator[Loop]:
    """Yield every loop of two to four faces around blocks in contact, as tuples of faces.

    Loops of four blocks that a face shortens are left out. All supports count as one block.
    """
    between: dict[tuple[int, int], list[int]] = {}
    near: dict[int, set[int]] = {}
    for face, (a, b) in enumerate(_between(assembly)):
        between.setdefault((a, b), []).append(face)
        near.setdefault(a, set()).add(b)
        near.setdefault(b, set()).add(a)
    for both in between.values():
        yield from combinations(both, 2)
    for ring in _rings(near):
        choices = [between[min(a, b), max(a, b)] for a, b in zip(ring, (*ring[1:], ring[0]), strict=True)]
        yield from product(*choices)


def _rings(near: dict[int, set[int]]) -> Iterator[tuple[int, ...]]:
    """Yield the blocks of each loop of three blocks, and of each loop of four without a chord.

    A chord is a contact of opposite blocks. near: for each block the blocks in contact with it.
    """
    for a in sorted(near):
        later = sorted(b for b in near[a] if b > a)
        for b, c in combinations(later, 2):
            if c in near[b]:
                yield a, b, c
            else:
                yield from ((a, b, d, c) for d in sorted(near[b] & near[c]) if d > a and d not in near[a])


def _jumps(rates: Floats) -> Floats:
    """Return two hinge rates and the slip of each face as forms (m, 3, w) of velocities.

    rates: (4m, w) of modes, four per face.
    """
    of_face = rates.reshape(len(rates) // 4, 4, -1)
    return np.stack([of_face[:, 0], of_face[:, 1], of_face[:, 3] - of_face[:, 2]], axis=1)
