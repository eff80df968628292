"""Proof of the best geometry in a box: branch and bound over positions, both sides proven."""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError, ParameterError
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.models import solve_rigid
from jld_core.scene import Scene
from jld_core.scene.move import Move
from jld_core.threads import one_thread
from jld_geometry.box_bound import BoxBound, BoxProblem
from jld_geometry.limits import loads_that_move
from jld_geometry.moved_scene import MovedScene
from jld_geometry.variables import variables_of
from jld_geometry.vertex_mesh import vertex_mesh

_MOST: Final = 4  # largest number of parameters of a box

_NARROW: Final = 1e-6  # width of a box, relative to the whole, below which it is not split again


@dataclass
class BoxNode:
    """Node of the tree of a branch and bound over positions.

    bound: bound on λ of all positions in its box; inf where none was proven, −inf where no position stands. motion: (n,
    3) velocities (ux, uy, ω) of all elements about their centroids, in a mechanism that proves it. case: position of
    the load case of the mechanism. axis, at: parameter along which the box is split, and where; axis −1 for a leaf.
    halves: lower and upper half; empty for a leaf.
    """

    bound: float
    motion: Floats | None
    case: int
    axis: int = -1
    at: float = 0.0
    halves: list[BoxNode] = field(default_factory=list)


@dataclass(frozen=True)
class ProvenBox:
    """Best geometry in a box of positions, with bounds on λ of all of them.

    scene: scene at the best position found. before: analysis of the scene as it is. after: analysis at the best
    position. load_factor: proven lower bound on λ at the best position; with load cases the governing factor. bound:
    proven upper bound on λ of every position in the box; inf where none was proven. proven: True if `load_factor` and
    `bound` agree within the gap asked for. gap: relative distance of `load_factor` and `bound`. boxes: number of boxes
    bounded. seconds: time, s. parameters: (p,) best position in the box, lengths from the start. low, high: (p,) least
    and greatest parameters of the box, lengths. places: (v, 2) positions of all vertices at the best position. moved:
    (v, 2) displacements of all vertices from the start. tree: tree of boxes with the mechanisms that prove `bound`.
    stated: scene at the start, with stated interfaces. directions: (p, v, 2) movements of all vertices by each
    parameter. centroids: (n, 2) points about which the motions of the tree turn, length.
    """

    scene: Scene
    before: LimitAnalysisResult
    after: LimitAnalysisResult
    load_factor: float
    bound: float
    proven: bool
    gap: float
    boxes: int
    seconds: float
    parameters: Floats
    low: Floats
    high: Floats
    places: Floats
    moved: Floats
    tree: BoxNode
    stated: Scene
    directions: Floats
    centroids: Floats


class _Search:
    """Branch and bound over the positions of one structure; keeps the best position tried."""

    def __init__(self, scene: Scene, assembly: Assembly, labels: Bits) -> None:
        if assembly.dimension != 2:
            raise ParameterError("prove", "it bounds planar structures alone", "a planar scene")
        assembly.members.refuse("a bound over positions")
        loads_that_move(scene)
        if scene.cracks != "faces":
            raise ParameterError("prove", "it bounds λ of blocks that crack along faces alone", '"cracks": "faces"')
        if assembly.has_low_values:
            raise ParameterError("prove", "it bounds λ at nominal values of materials", "no `robust` layout")
        move = scene.move or Move()
        mesh = vertex_mesh(assembly)
        variables = variables_of(assembly, labels, mesh, move, named=True)
        basis = variables.basis
        if move.ties == "equal-shapes":
            problem = 'the ties "equal-shapes" are not linear in the positions'
            raise ParameterError("prove", problem, '"mirror-x" or lists of points')
        if move.maximise != "load_factor":
            raise ParameterError("prove", f'it bounds λ, not "{move.maximise}"', '"maximise": "load_factor"')
        if not np.isnan(variables.centre).all():
            raise ParameterError("prove", "vertices on circles do not move along lines", '"along" with directions')
        if basis.shape[1] > _MOST:
            problem = f"{basis.shape[1]} parameters are too many to bound"
            raise ParameterError("prove", problem, f'at most {_MOST}: name vertices in "along", or tie them')
        jacobian = variables.jacobian(np.zeros(variables.count))
        self.count = basis.shape[1]
        self.directions = np.asarray((jacobian @ basis).T.reshape(self.count, -1, 2))
        self.mesh, self.labels = mesh, labels
        self.moved = MovedScene(scene, assembly, labels, mesh)
        self.problems = [BoxProblem(case, labels, mesh, self.directions) for case in assembly.by_case]
        self.required = assembly.required
        self.boxes = 0
        self.best: tuple[float, Floats, LimitAnalysisResult] | None = None

    def bound(self, low: Floats, high: Floats) -> BoxBound:
        """Bound the governing load factor over a box: the least bound of all load cases.

        low, high: (p,) ends of the box, lengths. The bound of each case is divided by its required load factor.
        """
        self.boxes += 1
        found = [one.bound(low, high) for one in self.problems]
        values = [one.value / factor for one, factor in zip(found, self.required, strict=True)]
        least = int(np.argmin(values))
        return BoxBound(values[least], found[least].velocity, least)

    def node(self, bound: BoxBound) -> BoxNode:
        """Make a leaf of the tree from a bound, with the velocities of all elements."""
        motion = None if bound.velocity is None else self.problems[bound.case].motion(bound.velocity)
        return BoxNode(bound.value, motion, bound.case)

    def places(self, parameters: Floats) -> Floats:
        """Return the positions (v, 2) of all vertices at parameters (p,), lengths."""
        return np.asarray(self.mesh.places + np.einsum("p,pvd->vd", parameters, self.directions))

    def try_position(self, parameters: Floats) -> LimitAnalysisResult | None:
        """Analyse the scene at parameters (p,), and keep the position if its λ is the best so far.

        None where no valid scene has this position.
        """
        try:
            assembly = build_assembly(self.moved.at(self.places(parameters)))
        except InputError:
            return None
        result = solve_rigid(assembly, self.labels)
        low = math.inf if result.status is Status.LOCKED else result.bracket[0]
        if result.status in (Status.COLLAPSE, Status.LOCKED) and (self.best is None or low > self.best[0]):
            self.best = (low, parameters, result)
        return result

    def split(self, low: Floats, high: Floats, whole: Floats) -> tuple[int, list[tuple[BoxBound, Floats, Floats]]]:
        """Halve a box along the parameter for which the larger bound of both halves is least.

        low, high: (p,) ends of the box. whole: (p,) size of the first box; all are lengths. Parameters along which the
        box is relatively narrow are not tried. Returns the parameter, and for each half its bound, low (p,) and high
        (p,).
        """
        choices = []
        wide = np.flatnonzero((high - low) / whole >= 0.25 * ((high - low) / whole).max())
        for axis in wide.tolist():
            middle = 0.5 * (low[axis] + high[axis])
            halves = []
            for from_, to in ((low[axis], middle), (middle, high[axis])):
                one, other = low.copy(), high.copy()
                one[axis], other[axis] = from_, to
                halves.append((self.bound(one, other), one, other))
            values = sorted(half[0].value for half in halves)
            choices.append((values[1], values[0], axis, halves))
        return min(choices, key=lambda choice: choice[:3])[2:]


@one_thread()
def prove_box(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    box: tuple[Floats, Floats] | float,
    *,
    gap: float = 1e-3,
    seconds: float = math.inf,
    progress: Callable[[float, float, int], None] | None = None,
) -> ProvenBox:
    """Find the best geometry in a box of positions, and prove a bound on λ of all of them.

    scene: planar scene; its key "move" states the vertices that move, at most four after ties. labels: (m,) True = dry.
    box: largest distance from the start, or least and largest distances of each parameter, length. gap: relative
    distance of both bounds at which the search ends. seconds: time limit, s. progress: called with the best λ, the
    bound and the number of boxes. Raises InputError: the structure is not of dry joints alone, the box has more than
    four parameters or turns a cell over, or no position that was tried stands.

    docs/method.md (11.7).
    """
    began = time.perf_counter()
    search = _Search(scene, assembly, labels)
    low, high = _ends(box, search.count)
    for problem in search.problems:
        problem.require_valid(low, high)
    before = search.try_position(np.zeros(search.count)) if ((low <= 0.0) & (high >= 0.0)).all() else None
    before = before or solve_rigid(assembly, labels)
    tree = search.node(search.bound(low, high))
    bound = _branch(search, tree, low, high, gap, began + seconds, progress)
    if search.best is None:
        raise InputError("move", "no position in the box that was tried stands", "another box, or a scene that stands")
    value, parameters, after = search.best
    bound = float(max(bound, value))
    width = _gap(value, bound)
    places = search.places(parameters)
    return ProvenBox(
        scene=search.moved.at(places),
        before=before,
        after=after,
        load_factor=value,
        bound=bound,
        proven=bool(width <= gap),
        gap=width,
        boxes=search.boxes,
        seconds=time.perf_counter() - began,
        parameters=parameters,
        low=low,
        high=high,
        places=places,
        moved=places - search.mesh.places,
        tree=tree,
        stated=search.moved.at(search.mesh.places),
        directions=search.directions,
        centroids=assembly.elements.centroid,
    )


def _ends(box: tuple[Floats, Floats] | float, count: int) -> tuple[Floats, Floats]:
    """Return the ends low and high (p,) of a box; raise ParameterError for a wrong box."""
    if isinstance(box, tuple):
        low, high = (np.asarray(end, dtype=float) for end in box)
        if len(low) != count or len(high) != count:
            problem = f"{len(low)} pairs of ends are given for {count} parameters"
            raise ParameterError("prove", problem, f"{count} pairs low,high, or one length for all")
    else:
        low, high = np.full(count, -float(box)), np.full(count, float(box))
    if not (low < high).all():
        raise ParameterError("prove", "the box has no width", "ends low,high with low < high, or a length above 0")
    return low, high


def _gap(value: float, bound: float) -> float:
    """Return the distance of `bound` from `value`, relative to the larger; 0 if not above."""
    if bound <= value:
        return 0.0
    return math.inf if not math.isfinite(bound) else (bound - value) / max(abs(value), abs(bound))


def _branch(
    search: _Search,
    tree: BoxNode,
    low: Floats,
    high: Floats,
    gap: float,
    deadline: float,
    progress: Callable[[float, float, int], None] | None,
) -> float:
    """Split the box of largest bound until the gap is closed or time is up.

    Returns a bound on all positions in the box. low, high: (p,) of the whole box, lengths. deadline: time of
    `time.perf_counter`, s. progress: called with the best λ, the bound and the number of boxes. tree: root with the
    bound of the whole box, to which halves are added. Boxes below a least width are not split. The middle of each box
    is tried as a position.
    """
    whole = high - low
    heap = [(-tree.bound, 0, low, high, tree)]
    number, closed = 0, -math.inf
    while heap:
        value, _, one, other, node = heap[0]
        best = -math.inf if search.best is None else search.best[0]
        bound = max(-value, closed)
        if progress is not None:
            progress(best, bound, search.boxes)
        if (search.best is not None and _gap(best, bound) <= gap) or time.perf_counter() > deadline:
            return bound
        heapq.heappop(heap)
        search.try_position(0.5 * (one + other))
        if ((other - one) / whole).max() < _NARROW:
            closed = max(closed, -value)
            continue
        node.axis, halves = search.split(one, other, whole)
        node.at = float(halves[1][1][node.axis])
        for half, start, end in halves:
            # a bound of the whole holds for its parts
            child = search.node(half) if half.value <= node.bound else BoxNode(node.bound, node.motion, node.case)
            node.halves.append(child)
            if child.bound > -math.inf:
                number += 1
                heapq.heappush(heap, (-child.bound, number, start, end, child))
        node.motion = None  # its halves have their own
    return closed
