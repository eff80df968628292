"""Operate on labellings: packed bits, blocks, slits and canonical forms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import DRY, Assembly, LoadCase, with_members, without
from jld_core.batch.rows import Graph
from jld_core.errors import InputError, ParameterError
from jld_core.parameters import require_kind
from jld_core.scene import PointLoad
from jld_core.scene.loads import FaceLoad
from jld_core.scene.schema import Scene
from jld_core.strengths import Strengths

# labellings as bits, (k, ceil(m / 8)); rows sort by the first face that differs, inner before dry
Packed = NDArray[np.uint8]

Words = NDArray[np.uint64]  # labellings as words of 64 bits, (k, w); rows sort as `Packed` rows do

DRY_LETTER: Final = "d"
INNER_LETTER: Final = "i"
# letters of a labelling as text; a spreadsheet would convert digits to a number
LETTERS: Final = DRY_LETTER + INNER_LETTER
_ENTRIES: Final = 1 << 23  # largest number of entries of a temporary array in `blocks_of`; larger batches are split


def pack(labellings: Bits) -> Packed:
    """Pack labellings (..., m) to bits (..., ceil(m / 8)), the first face in the highest bit."""
    return np.packbits(labellings, axis=-1)


def unpack(packed: Packed, faces: int) -> Bits:
    """Unpack bits to labellings.

    Parameters
    ----------
    packed : (..., ceil(m / 8)) uint8 array
        Packed labels.
    faces : int
        Number m of faces.

    Returns
    -------
    (..., m) bool array
        Labels, True = dry.
    """
    return np.unpackbits(packed, axis=-1, count=faces).astype(bool)


def keys(labellings: Bits) -> list[bytes]:
    """Return one hashable key per labelling; keys sort as the rows do.

    Parameters
    ----------
    labellings : (k, m) bool array
        Labels, True = dry.

    Returns
    -------
    list of bytes
        Packed rows.
    """
    packed = pack(labellings)
    content, width = packed.tobytes(), packed.shape[1]
    return [content[n : n + width] for n in range(0, len(content), width)] if width else [b""] * len(packed)


def to_string(labelling: Bits) -> str:
    """Convert a labelling to text, 'd' for dry and 'i' for inner.

    Parameters
    ----------
    labelling : (m,) bool array
        Labelling.

    Returns
    -------
    str
        m letters.
    """
    if np.ndim(labelling) != 1:
        raise ParameterError(
            "labelling", f"an array of shape {np.shape(labelling)} is given", "one label per interface"
        )
    return to_strings(np.asarray(labelling)[None])[0]


def to_strings(labellings: Bits) -> list[str]:
    """Convert labellings (k, m) to texts, 'd' for dry and 'i' for inner."""
    width = labellings.shape[1]
    text = letters_of(labellings).tobytes().decode("ascii")
    return [text[n * width : (n + 1) * width] for n in range(len(labellings))]


def letters_of(labellings: Bits) -> NDArray[np.uint8]:
    """Return the letter of each label of labellings (k, m) as ASCII codes (k, m)."""
    return np.where(labellings, np.uint8(ord(DRY_LETTER)), np.uint8(ord(INNER_LETTER)))


def from_string(text: str) -> Bits:
    """Convert a text of 'd' and 'i' to a labelling.

    Parameters
    ----------
    text : str
        m letters.

    Returns
    -------
    (m,) bool array
        Labels, True = dry.

    Raises
    ------
    InputError
        If the text holds any other letter.
    """
    require_kind("text", text, str)
    if text.strip(LETTERS):
        raise ParameterError("text", f"a labelling holds {text.strip(LETTERS)[0]!r}", "'d' and 'i' only")
    return np.asarray(np.frombuffer(text.encode("ascii"), dtype=np.uint8) == ord(DRY_LETTER))


@dataclass(frozen=True)
class Connectivity:
    """Element graph as arcs into each element, its own arc first, for `blocks_of`."""

    # a, b: (m,) elements of each face
    a: Ints
    b: Ints
    touching: Ints  # (t, 2) pairs of supports that share a face
    source: Ints  # (arcs,) element from which an arc comes
    face: Ints  # (arcs,) face that an arc crosses; m for arcs that are always open
    start: Ints  # (n,) position of the first arc into each element

    @cached_property
    def compiled(self) -> Graph:
        return Graph(len(self.start), self.a, self.b, self.touching)


def connectivity(assembly: Assembly) -> Connectivity:
    """Build the element graph of an assembly, with arcs between supports that touch."""
    faces, count = assembly.interfaces, len(assembly.elements)
    touching = np.array(assembly.touching, dtype=np.int64).reshape(-1, 2)
    elements = np.arange(count)
    all_faces = np.arange(len(faces))
    open_arcs = np.full(count + 2 * len(touching), len(faces))
    target = np.concatenate([elements, touching[:, 0], touching[:, 1], faces.a, faces.b])
    source = np.concatenate([elements, touching[:, 1], touching[:, 0], faces.b, faces.a])
    face = np.concatenate([open_arcs, all_faces, all_faces])
    order = np.argsort(target, kind="stable")
    start = np.searchsorted(target[order], elements)
    return Connectivity(faces.a, faces.b, touching, source[order], face[order], start)


def blocks_of(graph: Connectivity, labellings: Bits) -> Ints:
    """Compute the block of each element, named by its smallest element: (n,), or (k, n) for labellings (k, m)."""
    rows = np.atleast_2d(labellings)
    compiled = graph.compiled.blocks(rows)
    if compiled is not None:
        return compiled[0] if labellings.ndim == 1 else compiled
    size = max(1, _ENTRIES // max(1, len(graph.source)))
    parts = [_spread(graph, rows[i : i + size]) for i in range(0, max(1, len(rows)), size)]
    blocks = np.concatenate(parts)
    return blocks[0] if labellings.ndim == 1 else blocks


def totals_of(blocks: Ints, elements: Ints, values: Floats) -> Floats:
    """Sum values (e,) or (k, e) of elements (e,) over blocks (k, n), at the column of each name, else 0."""
    weights = np.broadcast_to(values, (len(blocks), len(elements))).ravel()
    total = np.bincount(_names(blocks, elements), weights, minlength=blocks.size)
    return np.asarray(total.reshape(blocks.shape), dtype=np.float64)


def numbers_of(blocks: Ints, elements: Ints) -> Ints:
    """Count the given elements (e,) in each block (k, n), at the column of its name, else 0."""
    return np.asarray(np.bincount(_names(blocks, elements), minlength=blocks.size).reshape(blocks.shape))


def _names(blocks: Ints, elements: Ints) -> Ints:
    """Return (k · e,) block of each element (e,) in each row, numbered over all rows."""
    rows, width = blocks.shape
    return np.asarray((blocks[:, elements] + width * np.arange(rows)[:, None]).ravel())


def _spread(graph: Connectivity, rows: Bits) -> Ints:
    """Compute blocks by propagating the smallest index along open arcs, with pointer jumping."""
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
    """Return the dry faces (m,) whose two sides are in one block."""
    blocks = blocks_of(graph, labellings)
    return np.asarray(labellings & (blocks[..., graph.a] == blocks[..., graph.b]))


def canonical(labellings: Bits, group: Ints) -> Bits:
    """Return the smallest image (k, m) of each labelling under a group (g, m), the identity first."""
    best, words = labellings.copy(), as_words(labellings)
    for permutation in group[1:]:
        image = labellings[:, permutation]
        other = as_words(image)
        less = _compare(other, words) < 0
        best[less], words[less] = image[less], other[less]
    return best


def orbit_sizes(labellings: Bits, group: Ints) -> Ints:
    """Return the number (k,) of different images of each labelling under a group (g, m)."""
    words = as_words(labellings)
    fixed = np.ones(len(labellings), dtype=np.int64)
    for permutation in group[1:]:
        fixed += _compare(as_words(labellings[:, permutation]), words) == 0
    return np.asarray(len(group) // fixed)


def representatives(labellings: Bits, group: Ints) -> tuple[Ints, Ints]:
    """Return the rows (r,) of labellings that are canonical, and their orbit sizes (r,)."""
    canonical_rows, words = np.arange(len(labellings)), as_words(labellings)
    fixed = np.ones(len(labellings), dtype=np.int64)
    for permutation in group[1:]:
        sign = _compare(as_words(labellings[canonical_rows[:, None], permutation]), words)
        stays = sign >= 0
        canonical_rows, words, fixed = canonical_rows[stays], words[stays], fixed[stays] + (sign[stays] == 0)
    return canonical_rows, np.asarray(len(group) // fixed)


def as_words(labellings: Bits) -> Words:
    """Pack labellings (k, m) into 64-bit words (k, w) that sort as the rows do, first word first."""
    packed = pack(labellings)
    padded = np.zeros((len(packed), 8 * -(-packed.shape[1] // 8)), dtype=np.uint8)
    padded[:, : packed.shape[1]] = packed
    return padded.view(">u8").astype(np.uint64)


def _compare(first: Words, second: Words) -> NDArray[np.int8]:
    """Return (k,) −1, 0 or 1 if rows of the first sort before, equal to or after the second."""
    sign = np.zeros(len(first), dtype=np.int8)
    for a, b in zip(first.T[::-1], second.T[::-1], strict=True):
        sign = np.where(a < b, -1, np.where(a > b, 1, sign)).astype(np.int8)
    return sign


LETTER: Final = "v"  # letter of a face beside a cell that is left out
_LETTERS: Final = LETTERS + LETTER  # all letters of a labelling as text, with void cells


@dataclass(frozen=True)
class Void:
    """Cells that may be left out: a dry face to the sink keeps a cell, an inner one omits it."""

    real: Assembly  # structure without the sink, with m faces and n elements
    cells: Ints  # (c,) elements that may be left out, in the order of their faces to the sink

    def gone(self, labellings: Bits) -> Bools:
        """Return (k, n) mask of the elements that labellings (k, m + c) leave out."""
        gone = np.zeros((len(labellings), len(self.real.elements)), dtype=bool)
        gone[:, self.cells] = ~labellings[:, len(self.real.interfaces) :]
        return gone

    def texts(self, labellings: Bits) -> list[str]:
        """Return the text of each labelling (k, m + c), one letter for each of the m faces."""
        faces, gone = self.real.interfaces, self.gone(labellings)
        beside = gone[:, faces.a] | gone[:, faces.b]
        plain = to_strings(labellings[:, : len(faces)])
        return [
            "".join(LETTER if void else letter for letter, void in zip(text, row, strict=True))
            for text, row in zip(plain, beside.tolist(), strict=True)
        ]


def is_labelling(text: object, faces: int) -> bool:
    """Return whether an object is a text of one letter d, i or v for each of some faces."""
    return isinstance(text, str) and len(text) == faces and not text.strip(_LETTERS)


def of_texts(texts: Sequence[str], faces: int) -> tuple[Bits, Bools]:
    """Return the labels (k, m) of texts, True = dry, and which faces (k, m) are beside a cell that is left out."""
    letters = np.frombuffer("".join(texts).encode("ascii"), dtype=np.uint8).reshape(len(texts), faces)
    return letters == ord(DRY_LETTER), letters == ord(LETTER)


def beside_nothing(text: str) -> Bools:
    """Return the faces (m,) beside a cell that is left out."""
    return np.asarray(np.frombuffer(text.encode("ascii"), dtype=np.uint8) == ord(LETTER))


def dry_of(text: str) -> Bits:
    """Convert the letters of a labelling to a mask of dry faces (m,); faces with v are not dry."""
    if text.strip(_LETTERS):
        raise ValueError(f"a labelling holds {text.strip(_LETTERS)[0]!r}; expected 'd', 'i' and 'v' only")
    return from_string(text.replace(LETTER, INNER_LETTER))


def omitted(assembly: Assembly, text: str) -> Bools:
    """Return the elements (n,) that a labelling leaves out: free ones all of whose faces have a v."""
    void = beside_nothing(text)
    faces = assembly.interfaces
    solid = np.zeros(len(assembly.elements), dtype=bool)
    solid[faces.a[~void]] = solid[faces.b[~void]] = True
    return ~solid & ~assembly.elements.support & bool(void.any())


def cut(assembly: Assembly, text: str) -> tuple[Assembly, Bits]:
    """Return the structure without the cells that a labelling leaves out, and its labels.

    Raises ValueError if the text holds a letter other than d, i and v.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    text : str
        Labelling; v: left out.

    Returns
    -------
    (Assembly, (m,) array of bool)
        Remaining structure, the given one if the text has no v; and labels of its interfaces, True = dry.
    """
    labels = with_members(assembly, dry_of(text))
    if LETTER not in text:
        return assembly, labels
    remaining, faces = without(assembly, omitted(assembly, text))
    return remaining, labels[faces]


def void_of(scene: Scene, assembly: Assembly) -> Void | None:
    """Return the cells that a scene's search may leave out, or None; InputError where it cannot."""
    void, elements = scene.search.void, assembly.elements
    if void is None:
        return None
    for key, is_set in (
        ("segmentation", not scene.search.segmentation),
        ("assemble", scene.search.assemble is not None),
    ):
        if is_set:
            raise InputError("search.void", f"it is given together with search.{key}", "searches of blocks without it")
    assembly.members.refuse("a search that leaves cells out")
    cases = scene.loads.cases or []
    lists = [
        scene.loads.dead,
        scene.loads.live or [],
        *(entries for case in cases for entries in (case.dead, case.live)),
    ]
    if scene.fill is not None:
        raise InputError("search.void", "fill rests on all elements", "a scene without fill, or no void cells")
    if scene.loads.moving or any(isinstance(entry, FaceLoad) for entries in lists for entry in entries):
        raise InputError("search.void", "a load moves or acts on faces", "loads on elements, or no void cells")
    loaded = {entry.element for entries in lists for entry in entries if isinstance(entry, PointLoad)}
    if void.cells == "all":
        chosen = [k for k in elements.free.tolist() if elements.ids[k] not in loaded]
    else:
        for position, name in enumerate(void.cells):
            where = f"search.void.cells[{position}]"
            if name not in elements.index or elements.support[elements.index[name]]:
                fault = "is a support" if name in elements.index else "names no element"
                raise InputError(where, f"{name!r} {fault}", "the id of a free element")
            if name in loaded:
                raise InputError(where, f"{name!r} carries a load", "an element that no load names")
        chosen = sorted({elements.index[name] for name in void.cells})
    if not chosen:
        raise InputError("search.void.cells", "no cell may be left out", "ids of free elements that no load names")
    return Void(assembly, np.array(chosen, dtype=np.int64))


def with_sink(void: Void) -> Assembly:
    """Return the assembly with the sink as last element and its faces as last faces."""
    real, cells = void.real, void.cells
    elements, faces, d = real.elements, real.interfaces, real.dimension
    middle = elements.centroid.mean(axis=0)
    sink = len(elements)
    with_sink_element = replace(
        elements,
        ids=(*elements.ids, ""),
        blocks=(*elements.blocks, None),
        support=np.append(elements.support, True),
        centroid=np.vstack([elements.centroid, middle]),
        volume=np.append(elements.volume, 0.0),
        weight=np.vstack([elements.weight, np.zeros(d)]),
        shape=(*elements.shape, middle[None]),
        faces=(*elements.faces, ()) if elements.faces else (),
        stated=(*elements.stated, frozenset()) if elements.stated else (),
    )
    count = len(cells)

    def padded(values: Floats) -> Floats:
        """Return values (m, ...) with zeros appended for the faces to the sink."""
        return np.concatenate([values, np.zeros((count, *values.shape[1:]), dtype=values.dtype)])

    centroids = elements.centroid[cells]
    with_sink_faces = replace(
        faces,
        a=np.concatenate([faces.a, cells]),
        b=np.concatenate([faces.b, np.full(count, sink)]),
        origin=np.vstack([faces.origin, centroids]),
        polygon=(*faces.polygon, *(np.repeat(centroid[None], 2, axis=0) for centroid in centroids)),
        rectangle=np.append(faces.rectangle, np.zeros(count, dtype=bool)),
        **{name: padded(getattr(faces, name)) for name in ("normal", "e1", "e2", "l1", "l2", "area", "c_t")},
    )

    cases: tuple[LoadCase, ...] = tuple(
        replace(case, dead_loads=case.dead_loads.padded(), live_loads=case.live_loads.padded()) for case in real.cases
    )
    return replace(
        real,
        elements=with_sink_element,
        interfaces=with_sink_faces,
        face_strengths=real.face_strengths.joined(Strengths(*np.zeros((7, count)))),
        dead_loads=real.dead_loads.padded(),
        live_loads=real.live_loads.padded(),
        labels=np.concatenate([real.labels, np.full(count, DRY)]),
        cases=cases,
        sink=sink,
    )
