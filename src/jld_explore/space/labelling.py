"""Labellings of all interfaces: packed bits, blocks, slits and canonical forms, many rows at a time.

A **labelling** is a row of m booleans in the order of the assembly's interfaces, True = dry. Its **blocks**
are the components of the element graph through inner faces; supports that share a face are one block from
the start. A **slit** is a dry face with both sides in one block; a labelling without slits is a
**segmentation**. A **class** is the set of images of a labelling under the symmetries of the scene, named by
its smallest member, the **canonical** labelling.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.batch import Graph

Packed = NDArray[np.uint8]
"""Labellings as bits, (k, ceil(m / 8)): rows sort by the first face that differs, inner before dry."""

Words = NDArray[np.uint64]
"""The same as words of 64 bits, (k, w)."""

DRY_LETTER: Final = "d"
INNER_LETTER: Final = "i"
LETTERS: Final = DRY_LETTER + INNER_LETTER
"""Of a labelling as text: letters, as a spreadsheet makes a number of digits."""

_ENTRIES: Final = 1 << 23
"""Entries of one temporary array in `blocks_of`; larger batches are taken in parts."""


def pack(labellings: Bits) -> Packed:
    """Bits of labellings (..., m) in bytes, (..., ceil(m / 8)), the first face in the highest bit."""
    return np.packbits(labellings, axis=-1)


def unpack(packed: Packed, faces: int) -> Bits:
    """Labellings (..., m) of packed rows; faces: m."""
    return np.unpackbits(packed, axis=-1, count=faces).astype(bool)


def keys(labellings: Bits) -> list[bytes]:
    """One hashable key for each row of labellings (k, m); keys sort as the rows do."""
    packed = pack(labellings)
    content, width = packed.tobytes(), packed.shape[1]
    return [content[n : n + width] for n in range(0, len(content), width)] if width else [b""] * len(packed)


def to_string(labelling: Bits) -> str:
    """A labelling (m,) as text, 'd' dry and 'i' inner."""
    return to_strings(np.asarray(labelling)[None])[0]


def to_strings(labellings: Bits) -> list[str]:
    """The texts of labellings (k, m)."""
    width = labellings.shape[1]
    text = np.where(labellings, np.uint8(ord(DRY_LETTER)), np.uint8(ord(INNER_LETTER))).tobytes().decode("ascii")
    return [text[n * width : (n + 1) * width] for n in range(len(labellings))]


def from_string(text: str) -> Bits:
    """The labelling (m,) of a text of 'd' and 'i'. Raises ValueError for any other character."""
    if text.strip(LETTERS):
        raise ValueError(f"a labelling holds {text.strip(LETTERS)[0]!r}; expected 'd' and 'i' only")
    return np.asarray(np.frombuffer(text.encode("ascii"), dtype=np.uint8) == ord(DRY_LETTER))


@dataclass(frozen=True)
class Connectivity:
    """The element graph, laid out for `blocks_of`: arcs into each element, its own first.

    a, b: (m,) elements of each face. touching: (t, 2) pairs of supports that share a face. source, face:
    (arcs,) element an arc comes from, and the face it crosses (m for arcs that are always open).
    start: (n,) where the arcs into each element begin.
    """

    a: Ints
    b: Ints
    touching: Ints
    source: Ints
    face: Ints
    start: Ints

    @cached_property
    def compiled(self) -> Graph:
        """The same graph to the compiled batch solver."""
        return Graph(len(self.start), self.a, self.b, self.touching)


def connectivity(assembly: Assembly) -> Connectivity:
    """The element graph of an assembly, with the supports that touch one another."""
    faces, count = assembly.interfaces, len(assembly.elements)
    touching = np.array(assembly.touching, dtype=np.int64).reshape(-1, 2)
    own = np.arange(count)
    every = np.arange(len(faces))
    open_arcs = np.full(count + 2 * len(touching), len(faces))
    target = np.concatenate([own, touching[:, 0], touching[:, 1], faces.a, faces.b])
    source = np.concatenate([own, touching[:, 1], touching[:, 0], faces.b, faces.a])
    face = np.concatenate([open_arcs, every, every])
    order = np.argsort(target, kind="stable")
    start = np.searchsorted(target[order], own)
    return Connectivity(faces.a, faces.b, touching, source[order], face[order], start)


def blocks_of(graph: Connectivity, labellings: Bits) -> Ints:
    """The block of each element, named by the smallest element index in it.

    labellings: (m,) or (k, m). Returns (n,) or (k, n).
    """
    rows = np.atleast_2d(labellings)
    found = graph.compiled.blocks(rows)
    if found is not None:
        return found[0] if labellings.ndim == 1 else found
    size = max(1, _ENTRIES // max(1, len(graph.source)))
    parts = [_spread(graph, rows[i : i + size]) for i in range(0, max(1, len(rows)), size)]
    blocks = np.concatenate(parts)
    return blocks[0] if labellings.ndim == 1 else blocks


def totals_of(blocks: Ints, elements: Ints, values: Floats) -> Floats:
    """Sums over blocks (k, n) of what some elements (e,) have, (k, n) at the column of each block's name, else zero.

    values: (e,), or (k, e) where they differ from row to row.
    """
    weights = np.broadcast_to(values, (len(blocks), len(elements))).ravel()
    total = np.bincount(_names(blocks, elements), weights, minlength=blocks.size)
    return np.asarray(total.reshape(blocks.shape), dtype=np.float64)


def numbers_of(blocks: Ints, elements: Ints) -> Ints:
    """The same of how many of the elements (e,) each block holds."""
    return np.asarray(np.bincount(_names(blocks, elements), minlength=blocks.size).reshape(blocks.shape))


def _names(blocks: Ints, elements: Ints) -> Ints:
    """(k · e,) the block of each element in each row, by one number among all rows."""
    rows, width = blocks.shape
    return np.asarray((blocks[:, elements] + width * np.arange(rows)[:, None]).ravel())


def _spread(graph: Connectivity, rows: Bits) -> Ints:
    """Smallest index reached: each round looks one face further, then jumps to the name of the name."""
    count = len(graph.start)
    closed = np.zeros((len(rows), rows.shape[1] + 1), dtype=bool)
    closed[:, :-1] = rows
    closed = closed[:, graph.face]
    name = np.broadcast_to(np.arange(count), (len(rows), count)).astype(np.int64)
    while True:
        arriving = np.where(closed, count, name[:, graph.source])
        least = np.minimum.reduceat(arriving, graph.start, axis=1)
        if np.array_equal(least, name):
            return name
        name = np.take_along_axis(least, least, axis=1)


def slits(graph: Connectivity, labellings: Bits) -> Bools:
    """Dry faces with both sides in one block; labellings (m,) or (k, m), the result alike."""
    blocks = blocks_of(graph, labellings)
    return np.asarray(labellings & (blocks[..., graph.a] == blocks[..., graph.b]))


def canonical(labellings: Bits, group: Ints) -> Bits:
    """The smallest image of each row under the group.

    labellings: (k, m); group: (g, m) face permutations, closed under composition, the identity first.
    Returns (k, m).
    """
    best, words = labellings.copy(), as_words(labellings)
    for permutation in group[1:]:
        image = labellings[:, permutation]
        other = as_words(image)
        less = _compare(other, words) < 0
        best[less], words[less] = image[less], other[less]
    return best


def orbit_sizes(labellings: Bits, group: Ints) -> Ints:
    """Number of different images of each row (k, m) under the group (g, m); the multiplicity of its class."""
    words = as_words(labellings)
    fixed = np.ones(len(labellings), dtype=np.int64)
    for permutation in group[1:]:
        fixed += _compare(as_words(labellings[:, permutation]), words) == 0
    return np.asarray(len(group) // fixed)


def representatives(labellings: Bits, group: Ints) -> tuple[Ints, Ints]:
    """Indices (r,) of the rows (k, m) that are canonical, and their orbit sizes (r,)."""
    kept, words = np.arange(len(labellings)), as_words(labellings)
    fixed = np.ones(len(labellings), dtype=np.int64)
    for permutation in group[1:]:
        sign = _compare(as_words(labellings[kept[:, None], permutation]), words)
        stays = sign >= 0
        kept, words, fixed = kept[stays], words[stays], fixed[stays] + (sign[stays] == 0)
    return kept, np.asarray(len(group) // fixed)


def as_words(labellings: Bits) -> Words:
    """Rows (k, m) as 64-bit words (k, w) that compare, the first word first, as the rows do."""
    packed = pack(labellings)
    padded = np.zeros((len(packed), 8 * -(-packed.shape[1] // 8)), dtype=np.uint8)
    padded[:, : packed.shape[1]] = packed
    return padded.view(">u8").astype(np.uint64)


def _compare(first: Words, second: Words) -> NDArray[np.int8]:
    """(k,) −1, 0 or 1 as rows of the first come before, equal or come after rows of the second."""
    sign = np.zeros(len(first), dtype=np.int8)
    for one, two in zip(first.T[::-1], second.T[::-1], strict=True):
        sign = np.where(one < two, -1, np.where(one > two, 1, sign)).astype(np.int8)
    return sign
