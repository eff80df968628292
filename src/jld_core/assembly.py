"""Assembly: rigid elements, members, and the interfaces between them, as frozen arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.errors import InputError, ParameterError
from jld_core.linalg import components
from jld_core.linalg.factors import summed
from jld_core.loads import Loads, resultants
from jld_core.notebook_repr import NotebookRepr
from jld_core.parameters import require_kind
from jld_core.scene.units import UnitSystem
from jld_core.strengths import FaceStrengths, Route, Strengths

if TYPE_CHECKING:
    from jld_core.scene.cracks import CrackModel


def _no_faces() -> Ints:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Members:
    """Ties, tendons and pins of an assembly, in scene units.

    A member whose force may vary has an inner interface of its own after those of the geometry, without bending and
    torsion. N, its compression beyond the prestress, and V of a pin act at the points that stand here.
    """

    # names, kinds: names, and "tie", "tendon", "pin", or "fill" for the horizontal pressure of fill
    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    # (k,) interface of each member; −1 for a constant force, which only loads the assembly
    face: Ints = field(default_factory=_no_faces)
    elements: tuple[Ints, ...] = ()  # elements to which each member is fixed, in order
    points: tuple[Floats, ...] = ()  # points of these elements
    # (k, d) unit vector of each member from its first point to the next
    axis: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    # tension, compression, shear, prestress: (k,) capacities, and prestress: the tension that always acts; forces
    tension: Floats = field(default_factory=lambda: np.zeros(0))
    compression: Floats = field(default_factory=lambda: np.zeros(0))
    shear: Floats = field(default_factory=lambda: np.zeros(0))
    prestress: Floats = field(default_factory=lambda: np.zeros(0))
    # (f,) tensile strength times area of the faces as dry joints; None where no joint has any. N of the program is the
    # normal force plus this.
    bond: Floats | None = None
    # (n, q) part of the dead loads that is prestress and bond; None where there is none
    self_stress: Floats | None = None

    def __len__(self) -> int:
        return len(self.names)

    def __bool__(self) -> bool:
        return bool(self.names)

    @property
    def axial(self) -> Bools:
        """Return a mask (k,) of members whose axial force may vary."""
        return np.asarray((self.tension > self.prestress) | (self.compression > 0.0))

    def push(self, member: int) -> tuple[Ints, Floats, Floats]:
        """Return elements (r,), points (r, d) and forces (r, d), in balance, of a unit compression in a member."""
        elements, points = self.elements[member], self.points[member]
        if self.kinds[member] == "pin":
            centre = np.broadcast_to(points.mean(axis=0), points.shape)
            return elements, centre, np.array([-self.axis[member], self.axis[member]])
        segments = np.diff(points, axis=0)
        directions = segments / np.linalg.norm(segments, axis=1)[:, None]
        forces = np.zeros_like(points)
        forces[:-1] -= directions
        forces[1:] += directions
        return elements, points, forces

    @cached_property
    def ends(self) -> Ints | None:
        """Return the two elements (k, 2) of each member; None if some member has more elements."""
        for elements in self.elements:
            if len(np.unique(elements)) > 2:
                return None
        pairs = [(elements[0], elements[np.flatnonzero(elements != elements[0])[0]]) for elements in self.elements]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    def joined(self, group: Ints, faces_kept: Ints) -> Members:
        """Return the members after elements joined to groups (n,), with the remaining interfaces `faces_kept` (k,)."""
        new_face = {int(face): number for number, face in enumerate(faces_kept)}
        rows = [k for k, face in enumerate(self.face.tolist()) if face in new_face]
        return replace(
            self.take(rows),
            face=np.array([new_face[int(self.face[k])] for k in rows], dtype=np.int64),
            elements=tuple(group[self.elements[k]] for k in rows),
        )

    def __add__(self, other: Members) -> Members:
        """Return the members of both, without interfaces, bond and self-stress."""

        def joined(name: str) -> Floats:
            return np.concatenate([getattr(self, name), getattr(other, name)])

        return Members(
            names=self.names + other.names,
            kinds=self.kinds + other.kinds,
            face=np.full(len(self) + len(other), -1, dtype=np.int64),
            elements=self.elements + other.elements,
            points=self.points + other.points,
            axis=np.concatenate([members.axis for members in (self, other) if len(members)] or [self.axis]),
            tension=joined("tension"),
            compression=joined("compression"),
            shear=joined("shear"),
            prestress=joined("prestress"),
        )

    def take(self, rows: list[int]) -> Members:
        arrays = {name: getattr(self, name)[rows] for name in ("face", "axis", "tension", "compression", "shear")}
        return Members(
            names=tuple(self.names[k] for k in rows),
            kinds=tuple(self.kinds[k] for k in rows),
            elements=tuple(self.elements[k] for k in rows),
            points=tuple(self.points[k] for k in rows),
            prestress=self.prestress[rows],
            **arrays,
        )

    def refuse(self, what: str) -> None:
        """Raise InputError for members, fill or bonded joints, which the computation `what` does not model."""
        if "fill" in self.kinds:
            problem = f"{what} does not model its variable pressure"
            raise InputError("fill", problem, 'a scene without fill, or with "active" and "passive" 0')
        if self.names:
            raise InputError("members", f"{what} does not model them ({self.names[0]!r})", "a scene without members")
        if self.bond is not None:
            where = "materials.dry.tensile_strength"
            raise InputError(where, f"{what} does not model it", "joints without tensile strength")


DRY: Final = True
"""Label of a joint."""
INNER: Final = False
"""Label of a potential crack plane."""


@dataclass(frozen=True)
class Elements:
    """Arrays over n rigid elements, in scene units; d is 2 (planar) or 3 (spatial).

    Parameters
    ----------
    ids : tuple of str
        Names.
    blocks : tuple of str or None
        The scene's block names, None where none is given.
    support : (n,) array of bool
        True for supports, which do not move; they have no equations of equilibrium.
    centroid : (n, d) array
        Centroids.
    volume : (n,) array
        Volumes; planar: area × thickness.
    weight : (n, d) array
        Self-weight as a force.
    shape : tuple of array
        Boundary of each element: planar (k, 2), counter-clockwise; spatial the (k, 3) vertices.
    faces : tuple
        Vertex indices of each face of each element, outward; empty in the plane.
    gravity : float
        Magnitude of the acceleration from which the weights were computed.
    stated : tuple of frozenset of str
        Which of "weight", "volume" and "centroid" the scene states for each element; () for none.
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
    stated: tuple[frozenset[str], ...] = ()

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: Ints) -> Elements:
        numbers = {name: getattr(self, name)[rows] for name in ("support", "centroid", "volume", "weight")}
        return Elements(
            ids=tuple(self.ids[k] for k in rows),
            blocks=tuple(self.blocks[k] for k in rows),
            shape=tuple(self.shape[k] for k in rows),
            faces=tuple(self.faces[k] for k in rows) if self.faces else (),
            gravity=self.gravity,
            stated=tuple(self.stated[k] for k in rows) if self.stated else (),
            **numbers,
        )

    @cached_property
    def index(self) -> dict[str, int]:
        """Return the position of each element in these arrays, by its id."""
        return {name: position for position, name in enumerate(self.ids)}

    def named(self, name: str, where: str, expected: str, support: bool | None = None) -> int:
        # an InputError gives the three ids most like an unknown one, of supports or of free elements alone
        if name not in self.index:
            fixed = self.support.tolist()
            ids = [key for key, is_support in zip(self.ids, fixed, strict=True) if support in (None, is_support)]
            similar = get_close_matches(name, ids, 3, 0.5) or ids[:3]
            raise InputError(where, f"no element is named {name!r}", f"{expected}, such as {', '.join(similar)}")
        return self.index[name]

    @cached_property
    def free(self) -> Ints:
        """Return the indices (k,) of the elements that are no supports, ascending."""
        return np.flatnonzero(~self.support)

    @cached_property
    def fixed_weight(self) -> Bools:
        """Return a mask (n,) of elements whose body forces do not grow with their outline."""
        return np.array([bool(values & {"weight", "volume"}) for values in self.stated or (frozenset(),) * len(self)])

    @cached_property
    def fixed_centroid(self) -> Bools:
        """Return a mask (n,) of elements whose centroid does not follow their outline."""
        return np.array(["centroid" in values for values in self.stated or (frozenset(),) * len(self)])

    @cached_property
    def mass(self) -> Floats:
        """Return weight over gravity (n,), kilograms in metres and newtons; zeros without gravity."""
        weight = np.linalg.norm(self.weight, axis=1)
        return weight / self.gravity if self.gravity else np.zeros(len(self))

    @cached_property
    def lower(self) -> Floats:
        """Return the lower corners (n, d) of bounding boxes."""
        return np.array([shape.min(axis=0) for shape in self.shape])

    @cached_property
    def upper(self) -> Floats:
        """Return the upper corners (n, d) of bounding boxes."""
        return np.array([shape.max(axis=0) for shape in self.shape])

    @cached_property
    def size(self) -> float:
        """Return the largest side of the bounding box of all elements, to which tolerances refer."""
        return float(np.max(self.upper.max(axis=0) - self.lower.min(axis=0)))


@dataclass(frozen=True)
class Interfaces:
    """Arrays over m interfaces; the normal points from element a to element b."""

    # a, b: (m,) elements on both sides
    a: Ints
    b: Ints
    origin: Floats  # (m, d) centroids
    # normal, e1, e2: (m, d) unit frame. In the plane e1 is the normal turned by +90° and e2 is empty.
    normal: Floats
    e1: Floats
    e2: Floats
    # l1, l2: (m,) sizes along e1 and e2; planar: length and thickness
    l1: Floats
    l2: Floats
    area: Floats  # (m,) areas
    c_t: Floats  # (m,) torsion lengths c_T; planar: zeros
    rectangle: Bools  # (m,) True where the polygon is a rectangle along e1, e2
    polygon: tuple[Floats, ...]  # corner points of each interface

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: Ints) -> Interfaces:
        arrays = {name: values[rows] for name, values in vars(self).items() if name != "polygon"}
        return Interfaces(**arrays, polygon=tuple(self.polygon[k] for k in rows))

    def between(self, first: int, second: int) -> Ints:
        """Return the interfaces of two elements with each other."""
        forward, backward = (self.a == first) & (self.b == second), (self.a == second) & (self.b == first)
        return np.flatnonzero(forward | backward)


@dataclass(frozen=True)
class LoadCase:
    """One load case of an assembly: its loads, and the load factor required under them.

    Parameters
    ----------
    name : str
        Name.
    dead_loads, live_loads : Loads
        Loads as those of `Assembly`; the dead load includes the part that is common to all cases.
    required : float
        Required load factor; λ is divided by it, so that 1 is just enough.
    place : (str, float), optional
        Of a moving load: its name and direction, and the distance of its first axle along the path.
    """

    name: str
    dead_loads: Loads
    live_loads: Loads
    required: float = 1.0
    place: tuple[str, float] | None = None


@dataclass(frozen=True)
class Assembly(NotebookRepr):
    """One structure, its loads and its materials, before any labelling is chosen.

    Attributes
    ----------
    name : str
        Name.
    dimension : int
        2 (planar) or 3 (spatial).
    units : (str, str)
        Units of length and force.
    elements, interfaces : Elements, Interfaces
        Rigid elements, and their plane contacts.
    face_strengths : FaceStrengths
        Strengths of all interfaces under both labels, whose numbers `strengths` hands to the routes that know them.
    dead_loads, live_loads : Loads
        Loads as they act. Dead ones hold self-weight; prestress and bond are part of the members.
    labels : (m,) bool array
        Labels that the scene gives, True = dry.
    moved : float
        Largest distance by which a corner was moved to close gaps and overlaps, length.
    sink : int
        Element for the cells that a search leaves out (`jld_explore.space.labelling`); −1 where it is solved.
    warnings : tuple of str
        Plausibility warnings, one sentence each.
    notes : tuple of str
        What results leave out of the scene, one sentence each.
    cases : tuple of LoadCase
        Load cases if there are several; the loads are those of the first. Solvers use `by_case`.
    touching : tuple of (int, int)
        Pairs of supports that share a face; both belong to one block.
    members : Members
        Ties, tendons, pins and pressures of fill; their interfaces are the last ones.
    fill : tuple of (k, 2) arrays
        Outlines of fill, for drawing.
    cracks : "faces", CellCracks or FieldCracks
        Along which planes blocks crack, which `solve` obeys.
    scene : Scene or None
        Scene of which it was built; cells are cut from it.
    """

    shown_by: ClassVar[str] = "jld_views.notebook:AssemblyView"

    name: str
    dimension: int
    units: tuple[str, str]
    elements: Elements
    interfaces: Interfaces
    face_strengths: FaceStrengths
    dead_loads: Loads
    live_loads: Loads
    labels: Bits
    moved: float = 0.0
    sink: int = -1
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    cases: tuple[LoadCase, ...] = ()
    touching: tuple[tuple[int, int], ...] = ()
    members: Members = field(default_factory=Members)
    fill: tuple[Floats, ...] = ()
    cracks: CrackModel = "faces"
    scene: Any = field(default=None, repr=False)

    def __repr__(self) -> str:
        kind = "planar" if self.dimension == 2 else "spatial"
        return f"Assembly({self.name!r}, {kind}, {len(self.elements)} elements, {len(self.interfaces)} interfaces)"

    @property
    def freedoms(self) -> int:
        """Return the number q of resultants per face and equations per element, 3 or (space) 6."""
        return 3 if self.dimension == 2 else 6

    @property
    def resultants(self) -> tuple[str, ...]:
        """Return the names of the q resultants on a face."""
        return ("N", "V", "M") if self.dimension == 2 else ("N", "V1", "V2", "M1", "M2", "MT")

    @cached_property
    def dead(self) -> Floats:
        """Return the dead loads about centroids (n, 3) or (n, 6), with prestress and bond, scene units."""
        total, self_stress = resultants(self.dead_loads, self.elements), self.members.self_stress
        return total if self_stress is None else summed(total, self_stress)

    @cached_property
    def live(self) -> Floats:
        """Return the live loads about centroids: (n, 3) planar (fx, fy, m) or (n, 6) spatial (f, m), scene units."""
        return resultants(self.live_loads, self.elements)

    @property
    def kilograms(self) -> float | None:
        """Return the kilograms of a mass of 1 in its units; None where these have no known names."""
        system = UnitSystem.named(self.units[1], self.units[0], self.elements.gravity)
        return system.density * system.si((0, 3)) if system.known else None

    @property
    def pressed(self) -> bool:
        """Return True if a load acts on part of a face, and so changes where the face moves."""
        return bool(self.dead_loads.tractions or self.live_loads.tractions)

    @cached_property
    def by_case(self) -> tuple[Assembly, ...]:
        if not self.cases:
            return (self,)
        alone = replace(self, cases=())
        return tuple(
            replace(alone, name=f"{self.name}: {c.name}", dead_loads=c.dead_loads, live_loads=c.live_loads)
            for c in self.cases
        )

    def strengths(self, route: Route, labels: Bits | None = None) -> Strengths:
        """Return the strengths of all interfaces for a route, perhaps under one labelling (m,).

        Raise InputError for a fact that it does not know.
        """
        return self.face_strengths.numbers(route, ~self.of_members, labels, self.pair)

    def with_strengths(self, strengths: Strengths) -> Assembly:
        """Return the structure with other strengths, and without low values."""
        return replace(self, face_strengths=self.face_strengths.with_numbers(strengths))

    @property
    def has_low_values(self) -> bool:
        return self.face_strengths.has_low_values

    @cached_property
    def at_nominal(self) -> Assembly:
        """Return the structure at nominal strengths; itself without low values."""
        return replace(self, face_strengths=self.face_strengths.at_nominal()) if self.has_low_values else self

    @property
    def required(self) -> Floats:
        """Return the required load factors (c,) of the load cases; 1 without load cases."""
        return np.array([case.required for case in self.cases]) if self.cases else np.ones(1)

    @cached_property
    def of_members(self) -> Bools:
        """Return a mask (m,) of the interfaces of members, which are inner under every labelling."""
        return np.isin(np.arange(len(self.interfaces)), self.members.face)

    @cached_property
    def faces(self) -> int:
        """Return the number of faces: interfaces with a label, before those of members."""
        return len(self.interfaces) - int(np.count_nonzero(self.of_members))

    @cached_property
    def free_faces(self) -> Bools:
        """Return a mask (m,) of interfaces between two free elements, without those of members."""
        support, faces = self.elements.support, self.interfaces
        return ~(support[faces.a] | support[faces.b] | self.of_members)

    @property
    def face_sizes(self) -> Floats:
        """Return the sizes (m,) of the interfaces: lengths, in space areas, scene units."""
        return self.interfaces.l1 if self.dimension == 2 else self.interfaces.area

    def pair(self, face: int) -> str:
        """Return the ids of the two elements of a face, for messages."""
        return "–".join(self.elements.ids[side[face]] for side in (self.interfaces.a, self.interfaces.b))

    @cached_property
    def size(self) -> float:
        return self.elements.size

    @cached_property
    def total_dead(self) -> float:
        """Return the sum of magnitudes of dead forces on free elements, without prestress, bond."""
        dead = resultants(self.dead_loads, self.elements)
        return float(np.linalg.norm(dead[self.elements.free, : self.dimension], axis=1).sum())

    @cached_property
    def total_live(self) -> float:
        """Return a live force that scales λ: the larger of Σ|forces| and Σ|moments| / `size`."""
        live = self.live[self.elements.free]
        forces = float(np.linalg.norm(live[:, : self.dimension], axis=1).sum())
        return max(forces, float(np.linalg.norm(live[:, self.dimension :], axis=1).sum()) / self.size)


def blocks_of(assembly: Assembly, labels: Bits, joined: tuple[Ints, Ints] | None = None) -> Ints:
    """Return the block of each element under a labelling.

    Elements joined by inner faces form a block, numbered by its first element; so do those glued to a support.

    Parameters
    ----------
    assembly : Assembly
        Elements, interfaces and touching supports.
    labels : (m,) bool array
        True = dry.
    joined : two (k,) int arrays, optional
        Pairs of elements that are of one block whatever the labels, in addition to touching supports.

    Returns
    -------
    (n,) int array
        Number of the block of each element, from 0.
    """
    if not isinstance(assembly, Assembly) or np.shape(labels) != assembly.labels.shape:
        require_kind("assembly", assembly, Assembly)
        raise ParameterError("labels", "their number is wrong", f"{len(assembly.labels)} labels, one per interface")
    inner, touching = ~np.asarray(labels, dtype=bool), np.array(assembly.touching, dtype=np.int64).reshape(-1, 2)
    first = np.concatenate([assembly.interfaces.a[inner], touching[:, 0]])
    second = np.concatenate([assembly.interfaces.b[inner], touching[:, 1]])
    if joined is not None:
        first, second = np.concatenate([first, joined[0]]), np.concatenate([second, joined[1]])
    return components(len(assembly.elements), first, second)


def without(assembly: Assembly, removed: Bools) -> tuple[Assembly, Ints]:
    """Remove elements (n,) with their interfaces and loads; return the rest (`sink` = −1) and the interfaces kept (k,).

    Supports that touch a support must stay.
    """
    rows = np.flatnonzero(~removed)
    new_index = np.cumsum(~removed) - 1
    faces = assembly.interfaces
    faces_kept = np.flatnonzero(~(removed[faces.a] | removed[faces.b]))
    interfaces = faces.take(faces_kept)
    cases = tuple(
        replace(case, dead_loads=case.dead_loads.take(rows), live_loads=case.live_loads.take(rows))
        for case in assembly.cases
    )
    remaining = replace(
        assembly,
        elements=assembly.elements.take(rows),
        interfaces=replace(interfaces, a=new_index[interfaces.a], b=new_index[interfaces.b]),
        face_strengths=assembly.face_strengths.take(faces_kept),
        dead_loads=assembly.dead_loads.take(rows),
        live_loads=assembly.live_loads.take(rows),
        labels=assembly.labels[faces_kept],
        cases=cases,
        touching=tuple((int(new_index[a]), int(new_index[b])) for a, b in assembly.touching),
        sink=-1,
    )
    return remaining, faces_kept


def faces_of(assembly: Assembly) -> Assembly:
    """Return an assembly without the interfaces of members, for what draws or lists faces."""
    # The members stay, as constant forces. The result serves no analysis.
    rows = np.arange(assembly.faces)
    if len(rows) == len(assembly.interfaces):
        return assembly
    return replace(
        assembly,
        interfaces=assembly.interfaces.take(rows),
        face_strengths=assembly.face_strengths.take(rows),
        labels=assembly.labels[rows],
        members=replace(assembly.members, face=np.full(len(assembly.members), -1)),
    )


def with_members(assembly: Assembly, labels: Bits) -> Bits:
    """Return labels of faces, followed by inner for the interfaces of members."""
    if assembly.faces == len(assembly.interfaces):
        return labels
    extended = np.full((*labels.shape[:-1], len(assembly.interfaces)), INNER)
    extended[..., : assembly.faces] = labels[..., : assembly.faces]
    return extended


# One labelling: m letters d and i, or m values True or 1 (dry) and False or 0 (inner).
Labels = str | ArrayLike

_LETTERS: Final = {"d": True, "i": False}  # labels by their letters, as in results.csv


def labels_of(assembly: Assembly, labels: Labels | None) -> Bits:
    """Return one labelling as a checked bool array (m,), default that of the scene; raise InputError for wrong ones."""
    if labels is None:
        return assembly.labels
    return with_members(assembly, checked_labels(labels, assembly, "labels"))


def _values(labels: Labels) -> NDArray[np.generic]:
    """Return labels as an array of numbers, truth values or letters, unchecked."""
    if isinstance(labels, str):
        return np.array(list(labels), dtype="U1")
    try:
        return np.asarray(labels)
    except ValueError:  # rows of different lengths
        return np.asarray(labels, dtype=object)


def checked_labels(labels: Labels, assembly: Assembly, parameter: str) -> Bits:
    """Return labels as truth values, (m,) or with those of members; raise InputError for a wrong number or value."""
    values, faces = _values(labels), assembly.faces
    expected = f"{faces} labels, one per interface: True, 1 or d = dry; False, 0 or i = inner"
    # labels of an evaluation also cover the interfaces of members
    if values.ndim != 1 or len(values) not in (faces, len(assembly.interfaces)):
        count = f"{len(values)} labels" if values.ndim == 1 else f"an array of shape {values.shape}"
        raise ParameterError(parameter, f"{count} are given" if values.ndim == 1 else f"{count} is given", expected)
    if values.dtype == np.bool_:
        return np.asarray(values, dtype=bool)
    items: Sequence[object] = values.tolist()
    for position, item in enumerate(items):
        if item not in ((*_LETTERS,) if isinstance(item, str) else (0, 1)):
            raise ParameterError(parameter, f"label {position} is {item!r}", expected)
    return np.array([_LETTERS[item] if isinstance(item, str) else bool(item) for item in items], dtype=bool)
