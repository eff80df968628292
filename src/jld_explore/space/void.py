"""Cells that may be left out: a third label, stated by the first two.

A search that may leave cells out works on the assembly with one more support, the **sink**, and a face of no size from
every such cell to it: dry, the cell stays; inner, it is of the sink's block and left out. So what is left out is a
block like others, and operators, symmetry and records need no third label. Nothing is ever solved with the sink: `cut`
gives the structure without the cells. In tables a face beside a cell that is left out has the letter v.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import DRY, Assembly, LoadCase, Strengths, without
from jld_core.errors import InputError
from jld_core.scene import PointLoad, Scene
from jld_explore.space.labelling import INNER_LETTER, LETTERS, from_string, to_strings

LETTER: Final = "v"
"""Of a face beside a cell that is left out."""

_LETTERS: Final = LETTERS + LETTER


@dataclass(frozen=True)
class Void:
    """What may be left out. real: the structure itself. cells: (c,) elements, in the order of their faces."""

    real: Assembly
    cells: Ints

    def gone(self, labellings: Bits) -> Bools:
        """(k, n) elements of the structure that labellings (k, m + c) leave out."""
        found = np.zeros((len(labellings), len(self.real.elements)), dtype=bool)
        found[:, self.cells] = ~labellings[:, len(self.real.interfaces) :]
        return found

    def texts(self, labellings: Bits) -> list[str]:
        """Letters of labellings (k, m + c), one for each of the m faces."""
        faces, gone = self.real.interfaces, self.gone(labellings)
        beside = gone[:, faces.a] | gone[:, faces.b]
        plain = to_strings(labellings[:, : len(faces)])
        return [
            "".join(LETTER if void else letter for letter, void in zip(text, row, strict=True))
            for text, row in zip(plain, beside.tolist(), strict=True)
        ]


def is_labelling(text: object, faces: int) -> bool:
    """Whether something is the letters of a labelling of so many faces."""
    return isinstance(text, str) and len(text) == faces and not text.strip(_LETTERS)


def beside_nothing(text: str) -> Bools:
    """(m,) faces that the letters of a labelling say to lie beside a cell that is left out."""
    return np.asarray(np.frombuffer(text.encode("ascii"), dtype=np.uint8) == ord(LETTER))


def dry_of(text: str) -> Bits:
    """(m,) True where the letters d, i and v of a labelling say dry; what lies beside nothing is not.

    Raises ValueError for other letters.
    """
    if text.strip(_LETTERS):
        raise ValueError(f"a labelling holds {text.strip(_LETTERS)[0]!r}; expected 'd', 'i' and 'v' only")
    return from_string(text.replace(LETTER, INNER_LETTER))


def omitted(assembly: Assembly, text: str) -> Bools:
    """(n,) elements that the letters (m,) of a labelling leave out: free ones whose every face is beside nothing."""
    void = beside_nothing(text)
    faces = assembly.interfaces
    solid = np.zeros(len(assembly.elements), dtype=bool)
    solid[faces.a[~void]] = solid[faces.b[~void]] = True
    return ~solid & ~assembly.elements.support & bool(void.any())


def cut(assembly: Assembly, text: str) -> tuple[Assembly, Bits]:
    """The structure that a labelling (m letters) leaves, and its labels. Raises ValueError for other letters."""
    labels = dry_of(text)
    if LETTER not in text:
        return assembly, labels
    rest, kept = without(assembly, omitted(assembly, text))
    return rest, labels[kept]


def void_of(scene: Scene, assembly: Assembly) -> Void | None:
    """What a scene's search may leave out, None where nothing.

    Raises InputError: ids that are none of free elements, cells that carry a load of their own, faces between two of
    them that are fixed dry, a search that leaves nothing to chance, or one that void cells are not made for.
    """
    asked, elements = scene.search.void, assembly.elements
    if asked is None:
        return None
    for key, odd in (("segmentation", not scene.search.segmentation), ("assemble", scene.search.assemble is not None)):
        if odd:
            raise InputError("search.void", f"it stands beside search.{key}", "searches of blocks without it")
    cases = scene.loads.cases or []
    lists = [scene.loads.dead, scene.loads.live or [], *(part for case in cases for part in (case.dead, case.live))]
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
    """The assembly that is searched: the sink is its last element, and the faces to it are its last."""
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
    )
    count = len(cells)

    def longer(values: Floats) -> Floats:
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

    def stretched(strengths: Strengths) -> Strengths:
        return replace(strengths, **{name: longer(values) for name, values in vars(strengths).items()})

    def padded(loads: Floats) -> Floats:
        return np.vstack([loads, np.zeros(loads.shape[1])])

    cases: tuple[LoadCase, ...] = tuple(
        replace(case, dead=padded(case.dead), live=padded(case.live)) for case in real.cases
    )
    return replace(
        real,
        elements=more,
        interfaces=grown,
        strengths=stretched(real.strengths),
        nominal=None if real.nominal is None else stretched(real.nominal),
        dead=padded(real.dead),
        live=padded(real.live),
        labels=np.concatenate([real.labels, np.full(count, DRY)]),
        cases=cases,
        sink=sink,
    )
