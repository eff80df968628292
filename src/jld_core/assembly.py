"""Assembly: rigid elements and the interfaces between them, as frozen arrays.

Two words before any other: an **element** is a rigid cell or block, a vertex of the graph; an **interface**
is a plane contact of two elements, an edge of it. A **label** is what an interface is: ``DRY`` (a joint:
no tension, Mohr–Coulomb friction) or ``INNER`` (a crack plane with finite strength).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.linalg import components
from jld_core.notebook_repr import NotebookRepr

DRY: Final = True
INNER: Final = False


@dataclass(frozen=True)
class Elements:
    """Struct of arrays over n elements; d is 2 (planar) or 3 (spatial), lengths and forces in scene units.

    ids: names. blocks: the scene's block names, None where none is given. support: (n,) True where
    equilibrium is not written. centroid: (n, d). volume: (n,) (planar: area × thickness). weight: (n, d)
    self-weight as a force. shape: per element its boundary, planar (k, 2) counter-clockwise, spatial the
    (k, 3) vertices. faces: per element the vertex indices of each face, outward (planar: empty). gravity: magnitude of
    the acceleration that weights were made with.
    """

    ids: tuple[str, ...]
    blocks: tuple[str | None, ...]
    support: Bools
    centroid: Floats
    volume: Floats
    weight: Floats
    shape: tuple[Floats, ...]
    faces: tuple[tuple[tuple[int, ...], ...], ...] = ()
    gravity: float = 9.81

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: Ints) -> Elements:
        """Some of them (k,), in that order."""
        numbers = {name: getattr(self, name)[rows] for name in ("support", "centroid", "volume", "weight")}
        return Elements(
            ids=tuple(self.ids[k] for k in rows),
            blocks=tuple(self.blocks[k] for k in rows),
            shape=tuple(self.shape[k] for k in rows),
            faces=tuple(self.faces[k] for k in rows) if self.faces else (),
            gravity=self.gravity,
            **numbers,
        )

    @cached_property
    def index(self) -> dict[str, int]:
        """Position of each element by its id."""
        return {name: position for position, name in enumerate(self.ids)}

    @cached_property
    def free(self) -> Ints:
        """Indices of the elements whose equilibrium is written."""
        return np.flatnonzero(~self.support)

    @cached_property
    def mass(self) -> Floats:
        """(n,) weight over gravity: kilograms in metres and newtons; zeros without gravity."""
        weight = np.linalg.norm(self.weight, axis=1)
        return weight / self.gravity if self.gravity else np.zeros(len(self))

    @cached_property
    def lower(self) -> Floats:
        """(n, d) lower corner of each element's bounding box."""
        return np.array([shape.min(axis=0) for shape in self.shape])

    @cached_property
    def upper(self) -> Floats:
        """(n, d) upper corner of each element's bounding box."""
        return np.array([shape.max(axis=0) for shape in self.shape])


@dataclass(frozen=True)
class Interfaces:
    """Struct of arrays over m interfaces; the normal runs from element a to element b.

    a, b: (m,) element indices. origin: (m, d) centroid. normal, e1, e2: (m, d) unit frame, e1 = normal
    turned +90° in the plane; e2 is empty in planar scenes. l1, l2: (m,) sizes along e1 and e2 (planar:
    length and thickness). area: (m,). c_t: (m,) torsion length c_T (planar: zeros). rectangle: (m,) True
    where the polygon is a rectangle along e1, e2. polygon: per interface (k, d) corner points.
    """

    a: Ints
    b: Ints
    origin: Floats
    normal: Floats
    e1: Floats
    e2: Floats
    l1: Floats
    l2: Floats
    area: Floats
    c_t: Floats
    rectangle: Bools
    polygon: tuple[Floats, ...]

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: Ints) -> Interfaces:
        """Some of them (k,), in that order."""
        arrays = {name: values[rows] for name, values in vars(self).items() if name != "polygon"}
        return Interfaces(**arrays, polygon=tuple(self.polygon[k] for k in rows))


@dataclass(frozen=True)
class Strengths:
    """Struct of arrays over m interfaces: what each would be made of as dry and as inner, scene units.

    friction: coefficient μ of dry faces. tension, shear: σt and τ of inner ones, stress. crush_dry, crush_inner:
    compressive strength, stress, inf where none is given. cohesion: of dry faces, stress; inner_friction: μ of inner
    ones; both 0 where none is given. A material the scene does not name is NaN.
    """

    friction: Floats
    tension: Floats
    shear: Floats
    crush_dry: Floats
    crush_inner: Floats
    cohesion: Floats
    inner_friction: Floats

    def take(self, rows: Ints) -> Strengths:
        """Those of some interfaces (k,), in that order."""
        return Strengths(**{name: values[rows] for name, values in vars(self).items()})


Points = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
"""Places and vectors of point forces."""


@dataclass(frozen=True)
class LoadCase:
    """One load case: dead and live loads as those of `Assembly`, the dead ones with all that is common.

    required: factor that its λ is divided by, so that 1 is just enough.
    """

    name: str
    dead: Floats
    live: Floats
    required: float = 1.0
    live_points: Points = ()


@dataclass(frozen=True)
class Assembly(NotebookRepr):
    """One structure, its loads and its materials, before any labelling is chosen.

    dead, live: (n, 3) planar (fx, fy, m) or (n, 6) spatial (f, m), about each element's centroid, scene
    units; dead holds self-weight and is never scaled by λ. labels: (m,) the labels the scene itself gives.
    live_points: places and vectors of the live point forces, for drawing. moved: farthest that a corner was moved to
    close gaps and overlaps, length. sink: element that stands for what a search leaves out (docs of `space.void`), −1
    in all that is solved. warnings: what is possible and hardly meant, a sentence each. cases: the load
    cases of a scene that has several; dead and live are then those of the first, and what solves asks for
    `by_case`. touching: pairs of supports that share a face, which are of one block. nominal: where strengths are the
    low values of materials, the nominal ones. In a notebook it shows what is modelled.
    """

    name: str
    dimension: int
    units: tuple[str, str]
    elements: Elements
    interfaces: Interfaces
    strengths: Strengths
    dead: Floats
    live: Floats
    labels: Bits
    live_points: Points = ()
    moved: float = 0.0
    sink: int = -1
    warnings: tuple[str, ...] = ()
    cases: tuple[LoadCase, ...] = ()
    touching: tuple[tuple[int, int], ...] = ()
    nominal: Strengths | None = None

    def __repr__(self) -> str:
        kind = "planar" if self.dimension == 2 else "spatial"
        return f"Assembly({self.name!r}, {kind}, {len(self.elements)} elements, {len(self.interfaces)} interfaces)"

    @property
    def freedoms(self) -> int:
        """Equations per element and resultants per interface: 3 planar, 6 spatial."""
        return 3 if self.dimension == 2 else 6

    @property
    def resultants(self) -> tuple[str, ...]:
        """Names of the resultants of a face, in their order."""
        return ("N", "V", "M") if self.dimension == 2 else ("N", "V1", "V2", "M1", "M2", "MT")

    @cached_property
    def by_case(self) -> tuple[Assembly, ...]:
        """This structure under each of its load cases alone, in their order; itself where there is one load only."""
        if not self.cases:
            return (self,)
        return tuple(
            replace(
                self,
                name=f"{self.name}: {case.name}",
                dead=case.dead,
                live=case.live,
                live_points=case.live_points,
                cases=(),
            )
            for case in self.cases
        )

    @cached_property
    def at_nominal(self) -> Assembly:
        """This structure at the nominal values of its materials; itself where it has no others."""
        return self if self.nominal is None else replace(self, strengths=self.nominal, nominal=None)

    @property
    def required(self) -> Floats:
        """(c,) factor that the λ of each load case is divided by."""
        return np.array([case.required for case in self.cases]) if self.cases else np.ones(1)

    @cached_property
    def free_faces(self) -> Bools:
        """(m,) True where the interface joins two free elements."""
        support = self.elements.support
        faces = self.interfaces
        return ~(support[faces.a] | support[faces.b])

    @property
    def face_sizes(self) -> Floats:
        """(m,) how large faces are where joints are measured: lengths in the plane, areas in space, scene units."""
        return self.interfaces.l1 if self.dimension == 2 else self.interfaces.area

    def pair(self, face: int) -> str:
        """Ids of the two elements of a face, for complaints."""
        return f"{self.elements.ids[self.interfaces.a[face]]}–{self.elements.ids[self.interfaces.b[face]]}"

    @cached_property
    def size(self) -> float:
        """Largest side of the bounding box, the length that geometric tolerances refer to."""
        return float(np.max(self.elements.upper.max(axis=0) - self.elements.lower.min(axis=0)))

    @cached_property
    def total_dead(self) -> float:
        """Sum of the magnitudes of the dead forces on free elements."""
        return float(np.linalg.norm(self.dead[self.elements.free, : self.dimension], axis=1).sum())

    @cached_property
    def total_live(self) -> float:
        """Sum of the magnitudes of the live forces on free elements; of moments / size where those are larger.

        Forces may cancel to a couple on each element, and what rounding leaves of them is no scale.
        """
        live = self.live[self.elements.free]
        forces = float(np.linalg.norm(live[:, : self.dimension], axis=1).sum())
        return max(forces, float(np.linalg.norm(live[:, self.dimension :], axis=1).sum()) / self.size)


def without(assembly: Assembly, gone: Bools) -> tuple[Assembly, Ints]:
    """What is left of an assembly without some elements (n,), and the faces (k,) that are left."""
    rows = np.flatnonzero(~gone)
    place = np.cumsum(~gone) - 1
    faces = assembly.interfaces
    kept = np.flatnonzero(~(gone[faces.a] | gone[faces.b]))
    rest = faces.take(kept)
    cases = tuple(replace(case, dead=case.dead[rows], live=case.live[rows]) for case in assembly.cases)
    left = replace(
        assembly,
        elements=assembly.elements.take(rows),
        interfaces=replace(rest, a=place[rest.a], b=place[rest.b]),
        strengths=assembly.strengths.take(kept),
        nominal=None if assembly.nominal is None else assembly.nominal.take(kept),
        dead=assembly.dead[rows],
        live=assembly.live[rows],
        labels=assembly.labels[kept],
        cases=cases,
        touching=tuple((int(place[a]), int(place[b])) for a, b in assembly.touching),
        sink=-1,
    )
    return left, kept


def blocks_of(assembly: Assembly, labels: Bits, joined: tuple[Ints, Ints] | None = None) -> Ints:
    """(n,) the block of each element, numbered by their first elements: what inner faces join.

    labels: (m,) True dry. joined: (k,) and (k,) elements that are of one block whatever the labels, besides supports
    that touch. An element glued to a support belongs to the support's block.
    """
    inner, touching = ~np.asarray(labels, dtype=bool), np.array(assembly.touching, dtype=np.int64).reshape(-1, 2)
    one = np.concatenate([assembly.interfaces.a[inner], touching[:, 0]])
    other = np.concatenate([assembly.interfaces.b[inner], touching[:, 1]])
    if joined is not None:
        one, other = np.concatenate([one, joined[0]]), np.concatenate([other, joined[1]])
    return components(len(assembly.elements), one, other)
