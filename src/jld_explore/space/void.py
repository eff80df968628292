"""Represent cells that may be left out by one more support, the sink, and faces of zero size to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import DRY, Assembly, LoadCase, with_members, without
from jld_core.errors import InputError
from jld_core.scene import PointLoad, Scene
from jld_core.scene.loads import FaceLoad
from jld_core.strengths import Strengths
from jld_explore.space.labelling import INNER_LETTER, LETTERS, from_string, to_strings

LETTER: Final = "v"  # letter of a face beside a cell that is left out

_LETTERS: Final = LETTERS + LETTER  # all letters of a labelling as text, with void cells


@dataclass(frozen=True)
class Void:
    """Cells that may be left out: a dry face to the sink keeps a cell, an inner one omits it."""

    real: Assembly  # structure without the sink, with m faces and n elements
    cells: Ints  # (c,) elements that may be left out, in the order of their faces to the sink

    def gone(self, labellings: Bits) -> Bools:
        """Return (k, n) mask of the elements that labellings (k, m + c) leave out."""
        found = np.zeros((len(labellings), len(self.real.elements)), dtype=bool)
        found[:, self.cells] = ~labellings[:, len(self.real.interfaces) :]
        return found

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
    rest, kept = without(assembly, omitted(assembly, text))
    return rest, labels[kept]


def void_of(scene: Scene, assembly: Assembly) -> Void | None:
    """Return the cells that a scene's search may leave out, or None; InputError where it cannot."""
    asked, elements = scene.search.void, assembly.elements
    if asked is None:
        return None
    for key, odd in (("segmentation", not scene.search.segmentation), ("assemble", scene.search.assemble is not None)):
        if odd:
            raise InputError("search.void", f"it is given together with search.{key}", "searches of blocks without it")
    assembly.members.refuse("a search that leaves cells out")
    cases = scene.loads.cases or []
    lists = [scene.loads.dead, scene.loads.live or [], *(part for case in cases for part in (case.dead, case.live))]
    if scene.fill is not None:
        raise InputError("search.void", "fill rests on all elements", "a scene without fill, or no void cells")
    if scene.loads.moving or any(isinstance(entry, FaceLoad) for part in lists for entry in part):
        raise InputError("search.void", "a load moves or acts on faces", "loads on elements, or no void cells")
    loaded = {entry.element for part in lists for entry in part if isinstance(entry, PointLoad)}
    if asked.cells == "all":
        chosen = [k for k in elements.free.tolist() if elements.ids[k] not in loaded]
    else:
        for place, name in enumerate(asked.cells):
            where = f"search.void.cells[{place}]"
            if name not in elements.index or elements.support[elements.index[name]]:
                what = "is a support" if name in elements.index else "names no element"
                raise InputError(where, f"{name!r} {what}", "the id of a free element")
            if name in loaded:
                raise InputError(where, f"{name!r} carries a load", "an element that no load names")
        chosen = sorted({elements.index[name] for name in asked.cells})
    if not chosen:
        raise InputError("search.void.cells", "no cell may be left out", "ids of free elements that no load names")
    return Void(assembly, np.array(chosen, dtype=np.int64))


def with_sink(void: Void) -> Assembly:
    """Return the assembly with the sink as last element and its faces as last faces."""
    real, cells = void.real, void.cells
    elements, faces, d = real.elements, real.interfaces, real.dimension
    middle = elements.centroid.mean(axis=0)
    sink = len(elements)
    more = replace(
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

    def longer(values: Floats) -> Floats:
        """Return values (m, ...) with zeros appended for the faces to the sink."""
        return np.concatenate([values, np.zeros((count, *values.shape[1:]), dtype=values.dtype)])

    places = elements.centroid[cells]
    grown = replace(
        faces,
        a=np.concatenate([faces.a, cells]),
        b=np.concatenate([faces.b, np.full(count, sink)]),
        origin=np.vstack([faces.origin, places]),
        polygon=(*faces.polygon, *(np.repeat(place[None], 2, axis=0) for place in places)),
        rectangle=np.append(faces.rectangle, np.zeros(count, dtype=bool)),
        **{name: longer(getattr(faces, name)) for name in ("normal", "e1", "e2", "l1", "l2", "area", "c_t")},
    )

    cases: tuple[LoadCase, ...] = tuple(
        replace(case, dead_loads=case.dead_loads.padded(), live_loads=case.live_loads.padded()) for case in real.cases
    )
    return replace(
        real,
        elements=more,
        interfaces=grown,
        face_strengths=real.face_strengths.joined(Strengths(*np.zeros((7, count)))),
        dead_loads=real.dead_loads.padded(),
        live_loads=real.live_loads.padded(),
        labels=np.concatenate([real.labels, np.full(count, DRY)]),
        cases=cases,
        sink=sink,
    )
