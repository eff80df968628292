"""What proofs are held against: flow rules and works of mechanisms, a solver that cannot be believed, the prover of the
core beside the batch solver, and limit analysis stated a second time in CVXPY and by extreme rays.

m interfaces, q resultants per interface (docs/method.md (3.1), (4.5)).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import shapely
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import linprog

from cases import ROUTE
from jld_core import Assembly, LimitAnalysis, LimitAnalysisResult, Status, build_assembly, parse_scene, tolerances
from jld_core.batch import batch_solver
from jld_core.fields import bounds
from jld_core.limit import Proof, face_jumps
from jld_core.limit.analysis import ProofAttempt
from jld_core.mechanics import YieldSet, equilibrium_matrix, load_vectors, prescribed_friction, scaling_of, yield_set
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver, RawSolution, Solver


class _Later:
    """CVXPY, loaded when it is first asked for: an eighth of what collecting all tests takes.

    pytest asks each global of a module for names of its own, such as `__test__`.
    """

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(import_module("cvxpy"), name)


cp: Any = _Later()


@dataclass(frozen=True)
class FlowRule:
    """How far each face's jump and force are from its flow rule, both (m,), scaled; 0 is exact.

    margin: least slack of the conditions on the jump (δ ≥ bending + dilation), negative where violated.
    gap: D(J) + F·J ≥ 0, zero where the force works as much as any admissible force could.
    """

    margin: np.ndarray
    gap: np.ndarray


@dataclass(frozen=True)
class WorkBalance:
    """Powers of a mechanism, scene units: of the loads at the upper end of the bracket, and dissipated."""

    external: float
    dissipated: float
    size: float

    @property
    def error(self) -> float:
        """|external − dissipated| over the largest of the powers that make them up."""
        return abs(self.external - self.dissipated) / self.size if self.size > 0.0 else 0.0


def _yield_set(result: LimitAnalysisResult) -> YieldSet:
    """The yield set that a result's forces and mechanism answer to, scaled by `scaling_of` its assembly.

    Under zero dilation the friction is frozen at μN of the result's own forces.
    """
    scaling = scaling_of(result.assembly)
    base = yield_set(result.assembly, scaling, result.model.inner_bending)
    if result.friction == "associative":
        return base
    if result.forces is None:
        raise ValueError("the result holds no forces")
    return prescribed_friction.PrescribedFriction(base, 0.0, result.forces[:, 0] / scaling.face[:, 0])


def flow_rule(result: LimitAnalysisResult) -> FlowRule:
    """How well every face obeys its flow rule: normality, without dilation where the result has none.

    Raises ValueError without forces or mechanism.
    """
    forces, jumps = _scaled(result)
    sets = _yield_set(result)
    gap = sets.dissipation(jumps, result.labels) + np.einsum("ij,ij->i", forces, jumps)
    return FlowRule(sets.margin(jumps, result.labels), gap)


def work_balance(result: LimitAnalysisResult) -> WorkBalance:
    """Power of the loads at λ_hi against what the faces dissipate. Raises ValueError without a mechanism."""
    if result.mechanism is None:
        raise ValueError("the result holds no mechanism")
    assembly, scaling = result.assembly, scaling_of(result.assembly)
    sets = _yield_set(result)
    velocity = result.mechanism[assembly.elements.free].ravel()
    dead, live = load_vectors(assembly)
    pushed, carried = float(result.bracket[1] * (live @ velocity)), float(dead @ velocity)
    jumps = face_jumps(assembly, result.mechanism) * scaling.face
    dissipated = float(sets.dissipation(jumps, result.labels).sum())
    return WorkBalance(pushed + carried, dissipated, max(abs(pushed), abs(carried), abs(dissipated)))


def _scaled(result: LimitAnalysisResult) -> tuple[np.ndarray, np.ndarray]:
    """Scaled forces (m, q), and jumps (m, q) dual to them: their product is a power in scene units over none."""
    if result.mechanism is None or result.forces is None:
        raise ValueError("the result holds no mechanism" if result.mechanism is None else "no forces")
    scaling = scaling_of(result.assembly)
    jumps = face_jumps(result.assembly, result.mechanism) * scaling.face
    return result.forces / scaling.face, jumps


def fields_of(problem: Any, labels: np.ndarray) -> tuple[Any, Any]:
    """Certified fields of stresses and of velocities of a problem under labels; None for what was not certified."""
    return bounds.LowerBound(problem).bound(labels), bounds.UpperBound(problem).bound(labels)


# A solver that cannot be believed, for proofs that must not need it to be.


def holds(found: Any, exact: float, gap: float = np.inf) -> None:
    """A bracket by fields holds the exact value and is no wider than a gap."""
    assert found.lower <= exact * (1 + 1e-9)
    assert found.upper >= exact * (1 - 1e-9)
    assert found.gap <= gap


class Noisy(Solver):
    """A route that spoils the answer of another."""

    name = "noisy"

    def __init__(self, level: float, seed: int) -> None:
        self._route, self._level, self._rng = ClarabelSolver(), level, np.random.default_rng(seed)

    def solve(self, program: ConicProgram) -> RawSolution:
        raw = self._route.solve(program)
        spoil = [v * (1.0 + self._level * self._rng.standard_normal(len(v))) for v in (raw.point, raw.dual)]
        spoil = [v + self._level * self._rng.standard_normal(len(v)) for v in spoil]
        return RawSolution(raw.status, spoil[0], spoil[1], raw.iterations, raw.seconds)


def noisy(analysis: LimitAnalysis, labels: np.ndarray, level: float, seed: int) -> Proof:
    """What is proven of a labelling by a spoilt answer and its repair."""
    attempt = ProofAttempt(analysis, labels)
    attempt.solve_by(Noisy(level, seed), analysis.margin)
    attempt.repair_answer()
    return attempt.proof


# What the compiled batch solver says of labellings, held against the core's own prover and its own way to λ.


LAST_DIGITS = 1e-9
"""What may separate two sums of the same dissipation, relative."""


def lanes_of(analysis: LimitAnalysis, variant: str | None = None, **keys: object) -> batch_solver.BatchSolver:
    """The batch solver for an analysis, as the analysis itself makes it; variant: see `BatchSolver`."""
    opening = analysis.repair.opening()
    velocity = None if opening is None else opening.velocity
    return batch_solver.BatchSolver(
        analysis.template, velocity, load_scale=analysis.load_scale, variant=variant, **keys
    )


def assert_proven(
    analysis: LimitAnalysis, asked: np.ndarray, found: Any, digits: float = LAST_DIGITS, snap: float = 0.0
) -> None:
    """Every bound of labellings (k, m) by the core's own prover, every verdict by `LimitAnalysis.prove`.

    digits: how near the prover's sum of a dissipation must be, relative. snap: what rounding may make of a margin,
    beside the fastest velocity, and friction where that is above 1. At the least this is `tolerances.EXACT`: both sums
    of a jump are rounded, in another order. That the exact margin is not negative is tested by `exact_margin`.
    """
    floor = 1e-3 * analysis.assembly.total_dead / analysis.assembly.total_live / analysis.template.scaling.load
    assert found.forces is not None
    assert found.velocity is not None
    for k, labels in enumerate(asked):
        proof = analysis.prove(labels)
        if np.isfinite(found.low[k]):
            state = analysis.prover.state(np.append(found.forces[k].ravel(), found.low[k]), labels, fixed_load=True)
            near = abs(state.load - found.low[k]) <= 1e-9 * max(1.0, abs(found.low[k]))
            assert (state.admissible and near) or exact(analysis, found.forces[k], found.low[k], labels)
        if np.isfinite(found.high[k]):
            motion = analysis.prover.motion(found.velocity[k], labels)
            # where joints cannot all open, jumps that must be zero are so but for rounding
            confined = analysis.repair.opening() is None
            rough = max(1.0, float(analysis.template.yield_set.associative.friction_of(labels).max()))
            least = max(snap, tolerances.EXACT, 1e-12 * confined) * rough
            assert motion.margin >= -least * abs(motion.velocity).max()
            # what falls may move the live load by next to nothing, which the bound is divided by
            near = max(digits, 1e-9 * confined, 1e-8 * (found.verdict[k] == batch_solver.FALLS))
            assert motion.bound == pytest.approx(found.high[k], rel=near, abs=1e-12)
        if found.verdict[k] == batch_solver.FALLS:
            assert proof.status is Status.UNSTABLE
        elif found.verdict[k] == batch_solver.LOCKED:
            assert proof.status in (Status.LOCKED, Status.UNCERTIFIED)
            ray = analysis.prover.ray(np.append(found.rays[k].ravel(), 1.0), labels)
            assert ray.slack >= -tolerances.ROUNDING
            assert ray.error <= tolerances.ROUNDING
            assert np.isfinite(found.low[k])
            assert np.isinf(found.high[k])
        elif found.verdict[k] == batch_solver.PROVEN:
            assert proof.status is Status.COLLAPSE
            size = max(abs(proof.low), floor)
            assert found.low[k] <= proof.high + 1e-9 * size + 1e-15
            assert found.high[k] >= proof.low - 1e-9 * size - 1e-15
            around = floor if found.low[k] <= 0.0 <= found.high[k] else 0.0
            assert found.high[k] - found.low[k] <= 1e-6 * max(abs(found.low[k]), abs(found.high[k]), around)
        else:
            assert found.verdict[k] == batch_solver.OPEN


def exact_margin(analysis: LimitAnalysis, velocity: np.ndarray, labels: np.ndarray) -> Fraction:
    """Least margin δ − μ|s| − |θ|/bending of planar faces that do not crush, without any rounding, scaled.

    velocity: (3·free,) as returned. Every number of the equilibrium matrix counts as it is stored.
    """
    matrix, sets = analysis.template.matrix.tocsc(), analysis.template.yield_set.associative
    exactly = [Fraction(value) for value in velocity.tolist()]
    data, rows, start = [Fraction(value) for value in matrix.data.tolist()], matrix.indices, matrix.indptr
    jumps = [
        sum((data[k] * exactly[rows[k]] for k in range(start[column], start[column + 1])), Fraction(0))
        for column in range(matrix.shape[1])
    ]
    friction, slides = sets.friction_of(labels), sets.active(labels)[:, 1]
    margins = []
    for face, dry in enumerate(labels.tolist()):
        opening, slip, turn = jumps[3 * face : 3 * face + 3]
        rub = Fraction(float(friction[face])) * abs(slip) if slides[face] else Fraction(0)
        margins.append(opening - rub - abs(turn) / (1 if dry else 3))
    return min(margins)


def exact(analysis: LimitAnalysis, forces: np.ndarray, load: float, labels: np.ndarray) -> bool:
    """Whether forces meet all equations and rows to rounding, at the edge of sets that leave them no room."""
    template = analysis.template
    flat = np.where(template.yield_set.active(labels), forces, 0.0).ravel()
    left = template.matrix @ flat + template.dead + load * template.live
    met = abs(template.matrix) @ abs(flat) + abs(template.dead) + abs(load * template.live)
    largest = max(1.0, float(abs(flat).max()))
    slack = template.yield_set.slack(flat.reshape(forces.shape), labels)
    return bool((abs(left) <= 2e-12 * met + 1e-15 * largest).all() and (slack >= -2e-12 * largest).all())


# What tests of collapse without dilation share: the evidence of a solution, and a block between walls.


def certify(result: LimitAnalysisResult) -> None:
    """All that docs/method.md (4.3) to (4.5) ask of a planar solution, from its own forces and mechanism alone."""
    assembly = result.assembly
    assert result.forces is not None
    assert result.mechanism is not None
    assert result.facts["converged"]
    dead, live = load_vectors(assembly)
    forces, dry = result.forces, result.labels
    left = equilibrium_matrix(assembly) @ forces.ravel() + dead + result.load_factor * live
    assert abs(left).max() <= 1e-9 * max(abs(forces).max(), assembly.total_dead)
    n, v, m = forces.T
    friction, half = assembly.strengths(ROUTE).friction, 0.5 * assembly.interfaces.l1
    largest = n.max()
    assert np.max((abs(v) - friction * n)[dry], initial=0.0) <= 1e-4 * largest
    assert np.max((abs(m) - half * n)[dry], initial=0.0) <= 1e-9 * largest
    opening, slip, turn = face_jumps(assembly, result.mechanism).T
    beyond = opening - half * abs(turn)
    assert beyond[dry].min(initial=0.0) >= -1e-9 * abs(slip).max()
    pressed = dry & (n > 1e-6 * largest)
    assert beyond[pressed].max(initial=0.0) <= 1e-6 * abs(slip).max() or abs(slip).max() < 1e-6 * abs(turn).max()
    gap = n * opening + m * turn + friction * n * abs(slip) + v * slip
    assert gap[dry].min(initial=0.0) >= -1e-4 * largest * abs(slip).max()
    if dry.all():
        dissipated = float((friction * n * abs(slip)).sum())
        assert gap.sum() <= 1e-3 * max(dissipated, 1e-6 * assembly.total_dead)
    assert abs(result.bracket[1] - result.bracket[0]) <= 1e-6 * abs(result.load_factor)


def block(friction: float, live: list[dict[str, Any]], dead: list[dict[str, Any]], walls: int) -> Assembly:
    """A unit cube of weight 1 on the ground, with a fixed wall to the right (1) or on both sides (2)."""
    boxes = {"block": (0, 1, 0, 1), "ground": (-2, 3, -1, 0), "right": (1, 2, 0, 2), "left": (-1, 0, 0, 2)}
    elements = [
        {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], "support": name != "block"}
        for name, (x0, x1, y0, y1) in list(boxes.items())[: 2 + walls]
    ]
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}}
    return build_assembly(
        parse_scene({"elements": elements, "materials": materials, "loads": {"live": live, "dead": dead}})
    )


# The static problem, docs/method.md (2.1), stated a second time, in CVXPY and in scene units, from geometry alone.
#
# Nothing of equilibrium.py, scaling.py or yield_sets.py is used: a fault there cannot hide here.


def reference_problem(
    assembly: Assembly, labels: np.ndarray, bond: np.ndarray | None = None
) -> tuple[cp.Problem, cp.Variable]:
    """max λ for one labelling. Returns the problem and λ; forces are divided by a common weight for the solver.

    bond: (m,) force that dry faces without compressive strength take in tension.

    Conditions of all faces are stated together: CVXPY takes far longer over many small ones than the solver does.
    """
    faces, elements, s = assembly.interfaces, assembly.elements, assembly.strengths(ROUTE)
    # a plain scale, so that the solver's absolute tolerances mean something; nothing else is scaled
    unit = assembly.total_dead / max(len(elements.free), 1) or assembly.total_live
    reach = assembly.size
    count = len(faces)
    n, v, m = (cp.Variable(count) for _ in range(3))  # m is moment / reach
    load = cp.Variable()
    place = {int(element): 3 * position for position, element in enumerate(elements.free)}
    acts = sp.lil_array((3 * len(place), 3 * count))  # forces of faces (all n, all v, all m) → on elements
    length = np.empty(count)
    for k in range(count):
        start, end = faces.polygon[k]
        length[k] = np.hypot(*(end - start))
        direction, across = faces.normal[k], np.array([-faces.normal[k][1], faces.normal[k][0]])
        for element, sign in ((int(faces.a[k]), -1.0), (int(faces.b[k]), 1.0)):
            if element not in place:
                continue
            arm, row = (start + end) / 2 - elements.centroid[element], place[element]
            for column, way in ((k, direction), (count + k, across)):
                acts[row, column], acts[row + 1, column] = sign * way
                acts[row + 2, column] = sign * (arm[0] * way[1] - arm[1] * way[0]) / reach
            acts[row + 2, 2 * count + k] = sign
    size = np.array([1.0, 1.0, reach])
    dead = (assembly.dead[elements.free] / unit / size).ravel()
    live = (assembly.live[elements.free] / assembly.total_live / size).ravel()
    constraints = [acts.tocsr() @ cp.hstack([n, v, m]) + dead + load * live == 0]
    area, half = length * np.asarray(faces.l2) / unit, length / 2 / reach  # area: of a stress, what its force is
    held = np.zeros(count) if bond is None else bond / unit
    dry, crushed = np.asarray(labels, dtype=bool), np.isfinite(np.where(labels, s.crush_dry, s.crush_inner))

    def where(chosen: np.ndarray) -> np.ndarray:
        return np.flatnonzero(chosen)

    if len(k := where(dry)):
        constraints.append(cp.abs(v[k]) <= s.cohesion[k] * area[k] + cp.multiply(s.friction[k], n[k]))
        constraints.append(n[k] >= -held[k])  # which friction alone says of itself
    if len(k := where(dry & crushed)):
        bent, pressed = cp.multiply(1 / half[k], cp.abs(m[k])), cp.square(n[k])
        constraints.append(bent + cp.multiply(1 / (s.crush_dry[k] * area[k]), pressed) <= n[k])
    if len(k := where(dry & ~crushed)):
        constraints.append(cp.abs(m[k]) <= cp.multiply(half[k], n[k] + held[k]))
    if len(k := where(~dry)):
        constraints.append(cp.abs(m[k]) <= cp.multiply(half[k] / 3, n[k] + s.tension[k] * area[k]))
        constraints.append(cp.abs(v[k]) <= s.shear[k] * area[k] + cp.multiply(s.inner_friction[k], n[k]))
    if len(k := where(~dry & crushed)):
        constraints.append(cp.abs(m[k]) <= cp.multiply(half[k] / 3, s.crush_inner[k] * area[k] - n[k]))
    return cp.Problem(cp.Maximize(load), constraints), load


def reference_load_factor(
    assembly: Assembly, labels: np.ndarray, simplex: bool = False, bond: np.ndarray | None = None
) -> float:
    """λ by CVXPY: +inf where it is unbounded, −inf where no λ ≥ 0 is admissible.

    simplex: HiGHS instead of Clarabel, for data that an interior point on an unscaled program gets wrong.
    """
    problem, load = reference_problem(assembly, labels, bond)
    if simplex:
        problem.solve(solver=cp.HIGHS)
    else:
        problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11)
    unit = assembly.total_dead / max(len(assembly.elements.free), 1) or assembly.total_live
    if problem.status in ("infeasible", "infeasible_inaccurate"):
        return -np.inf
    if problem.status in ("unbounded", "unbounded_inaccurate"):
        # a ray of improvement says nothing of whether there is a state to improve
        standing = cp.Problem(cp.Maximize(0), [*problem.constraints, load >= 0])
        standing.solve(solver=cp.CLARABEL)
        return np.inf if standing.status in ("optimal", "optimal_inaccurate") else -np.inf
    value = float(load.value) * unit / assembly.total_live
    return value if value > -1e-9 * unit / assembly.total_live else -np.inf


# Spatial limit analysis stated a second time, in CVXPY and in scene units, from the scene document alone.
#
# Nothing of jld_core is used: frames, areas, torsion lengths, sides of normals and equilibrium are worked out
# here in other ways (centre of pressure as a mean of corners, stress as a linear field, normals by a point in a
# body).


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Face:
    """A plane contact: frame, corners in the frame about the centroid, and its integrals by quadrature."""

    origin: Array
    frame: Array  # rows n, e1, e2
    corners: Array
    rectangle: bool
    area: float
    moments: Array
    torsion: float


def make_face(polygon: Array, normal: Array) -> Face:
    """normal: out of element a."""
    e1 = polygon[1] - polygon[0]
    e1 = e1 - (e1 @ normal) * normal
    e1 /= np.linalg.norm(e1)
    frame = np.array([normal, e1, np.cross(normal, e1)])
    local = (polygon - polygon[0]) @ frame[1:].T
    shape = shapely.Polygon(local)
    centre = np.array(shape.centroid.coords[0])
    height = float(((polygon - polygon[0]) @ normal).mean())
    # points in line belong to the file, not to the shape
    corners = shapely.get_coordinates(shapely.Polygon(local - centre).simplify(1e-6 * np.ptp(local)))[:-1]
    if not shapely.LinearRing(corners).is_ccw:
        corners = corners[::-1]
    keep = [k for k in range(len(corners)) if _bend(corners, k) > 1e-6]
    corners = corners[keep]
    sides = np.roll(corners, -1, axis=0) - corners
    cosines = [
        abs(sides[k - 1] @ sides[k]) / np.prod(np.linalg.norm(sides[[k - 1, k]], axis=1)) for k in range(len(sides))
    ]
    moments, torsion = _integrals(corners)
    return Face(
        origin=polygon[0] + centre @ frame[1:] + height * normal,
        frame=frame,
        corners=corners,
        rectangle=len(corners) == 4 and max(cosines) < 1e-4,
        area=shape.area,
        moments=moments,
        torsion=torsion / shape.area,
    )


def _bend(corners: Array, k: int) -> float:
    one, two = corners[k] - corners[k - 1], corners[(k + 1) % len(corners)] - corners[k]
    return float(abs(one[0] * two[1] - one[1] * two[0]) / (np.linalg.norm(one) * np.linalg.norm(two)))


def _integrals(corners: Array) -> tuple[Array, float]:
    """∫ x xᵀ and ∫ r over a polygon about the origin: signed triangles from there, Gauss points on edges."""
    node, weight = np.polynomial.legendre.leggauss(60)
    node, weight = 0.5 * (node + 1.0), 0.5 * weight
    moments, total = np.zeros((2, 2)), 0.0
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        twice = p[0] * q[1] - p[1] * q[0]
        edge = p + node[:, None] * (q - p)
        moments += twice * 0.25 * np.einsum("k,ki,kj->ij", weight, edge, edge)
        total += twice / 3.0 * float(weight @ np.linalg.norm(edge, axis=1))
    return moments, total


def face_constraints(
    faces: list[Face], f: Any, dry: bool, materials: list[dict[str, float]], kern: bool = False, unit: float = 1.0
) -> list[Any]:
    """Constraints on rows f[k] = (N, V1, V2, M1, M2, MT) of faces alike in label, forces over `unit`.

    Moments are in force × length. materials, one for each face: friction, cohesion (a stress); tension, shear
    (stresses); crush (a stress, if any). All faces are stated together: CVXPY takes far longer over many small
    conditions than the solver does.
    """
    n, v, m1, m2, twist = f[:, 0], f[:, 1:3], f[:, 3], f[:, 4], f[:, 5]
    area = np.array([face.area for face in faces]) / unit
    size = np.array([np.ptp(face.corners, axis=0) for face in faces])
    crush = np.array([material.get("crush", np.inf) for material in materials]) * area
    crushed = np.flatnonzero(np.isfinite(crush))

    def each(key: str) -> Array:
        return np.array([material.get(key, 0.0) for material in materials])

    constraints = []
    if dry:
        rows = [(np.ones(len(face.corners)), *face.corners.T) for face in faces]
        total, x, y = (block_diag(*parts) for parts in zip(*rows, strict=True))
        weight = cp.Variable(total.shape[1], nonneg=True)
        constraints += [total @ weight == n, x @ weight == -m2, y @ weight == m1]
        capacity = each("cohesion") * area + cp.multiply(each("friction"), n)
        for k in crushed:
            # effective rectangle (l1 − 2|x1|)(l2 − 2|x2|) σc ≥ N, multiplied out
            one = size[k, 0] * n[k] - 2.0 * cp.abs(m2[k])
            two = size[k, 1] * n[k] - 2.0 * cp.abs(m1[k])
            stress = cp.Constant(crush[k] / faces[k].area)
            constraints.append(cp.geo_mean(cp.hstack([one, two, stress])) >= n[k])
    else:
        strength = each("tension") * area
        capacity = each("shear") * area + cp.multiply(each("friction"), n)
        blocks = [k for k, face in enumerate(faces) if face.rectangle and not kern]
        others = [k for k in range(len(faces)) if k not in blocks]
        for moment, length in ((m1, size[:, 1] / 6.0), (m2, size[:, 0] / 6.0)) if blocks else ():
            constraints.append(cp.abs(moment[blocks]) <= cp.multiply(n[blocks] + strength[blocks], length[blocks]))
            if len(some := np.intersect1d(blocks, crushed)):
                constraints.append(cp.abs(moment[some]) <= cp.multiply(crush[some] - n[some], length[some]))
        if others:
            slope = cp.Variable((len(others), 2))  # of the stress, times the area
            along, across = slope[:, 0], slope[:, 1]
            second = np.array([faces[k].moments / faces[k].area for k in others])
            for row, moment in enumerate((-m2[others], m1[others])):
                bent = cp.multiply(second[:, row, 0], along) + cp.multiply(second[:, row, 1], across)
                constraints.append(bent == moment)
            owner = np.repeat(np.arange(len(others)), [len(faces[k].corners) for k in others])
            x, y = np.concatenate([faces[k].corners for k in others]).T
            at = np.array(others)[owner]
            stress = n[at] + cp.multiply(x, along[owner]) + cp.multiply(y, across[owner])
            constraints.append(stress >= -strength[at])
            if len(some := np.flatnonzero(np.isfinite(crush[at]))):
                constraints.append(stress[some] <= crush[at][some])
    torsion = np.array([face.torsion for face in faces])
    constraints.append(cp.norm(v, axis=1) + cp.multiply(1.0 / torsion, cp.abs(twist)) <= capacity)
    return constraints


def inside(point: Array, vertices: Array, faces: list[list[int]]) -> bool:
    """Is a point inside a closed surface? By the solid angle of its triangles."""
    total = 0.0
    for face in faces:
        loop = vertices[face]
        for k in range(1, len(loop) - 1):
            a, b, c = loop[[0, k, k + 1]] - point
            la, lb, lc = np.linalg.norm([a, b, c], axis=1)
            volume = a @ np.cross(b, c)
            total += 2.0 * np.arctan2(volume, la * lb * lc + (a @ b) * lc + (b @ c) * la + (c @ a) * lb)
    return abs(total) > 2.0 * np.pi


def load_factor_in_space(document: dict[str, Any], concave: bool = False, kern: bool = False) -> float:
    """Greatest λ of a spatial scene with given interfaces and body loads, faces labelled one by one."""
    elements = {e["id"]: e for e in document["elements"]}
    gravity = document["materials"].get("gravity", 9.81)
    weight = {k: e.get("density", 1.0) * e["volume"] * gravity for k, e in elements.items() if not e["support"]}
    unit = sum(weight.values()) / len(weight)
    body = np.sum([np.array(load["body"], dtype=float) for load in document["loads"]["live"]], axis=0)
    place = {name: 6 * position for position, name in enumerate(weight)}
    kinds: dict[bool, list[tuple[Face, dict[str, float]]]] = {True: [], False: []}
    acts: dict[str, list[Array]] = {"dry": [], "inner": [], "corner": []}  # columns: what one unknown does to elements
    rough: list[float] = []  # friction at each corner
    for entry in document["interfaces"]:
        polygon = np.array(entry["polygon"])
        normal = np.cross(polygon[1] - polygon[0], polygon[-1] - polygon[0])
        normal /= np.linalg.norm(normal)
        a, b = entry["elements"]
        size = float(np.ptp(polygon, axis=0).max())
        probe = polygon.mean(axis=0) + 1e-3 * size * normal
        if inside(probe, np.array(elements[a]["vertices"]), elements[a]["faces"]):
            normal = -normal
        face = make_face(polygon, normal)
        dry = entry.get("label", "dry") == "dry"
        named = document["materials"]["dry" if dry else "inner"]
        material = {
            "friction": named.get("friction_coefficient", 0.0),
            "tension": named.get("tensile_strength", 0.0),
            "shear": named.get("shear_strength", 0.0),
            "cohesion": named.get("cohesion", 0.0),
        }
        if named.get("compressive_strength") is not None:
            material["crush"] = named["compressive_strength"]
        none = np.zeros((3, 3))
        if dry and concave:
            corners = face.origin + face.corners @ face.frame[1:]
            rough += [material["friction"]] * len(corners)
            unknowns = [(corner, face.frame.T, none) for corner in corners]
        else:
            kinds[dry].append((face, material))
            # f = (N, V1, V2, M1, M2, MT): force and couple of each
            couple = face.frame[[1, 2, 0]].T
            unknowns = [(face.origin, np.hstack([face.frame.T, none]), np.hstack([none, couple]))]
        for at, push, couple in unknowns:
            columns = np.zeros((6 * len(weight), push.shape[1]))
            for name, sign in ((a, -1.0), (b, 1.0)):
                if name not in weight:
                    continue
                x, y, z = at - np.array(elements[name]["centroid"])
                cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                columns[place[name] : place[name] + 3] = sign * push
                columns[place[name] + 3 : place[name] + 6] = sign * (cross @ push + couple)
            acts["corner" if dry and concave else "dry" if dry else "inner"].append(columns)
    load = cp.Variable()
    own = np.array(list(weight.values()))[:, None] / unit
    down, pushed = np.zeros((2, len(weight), 6))
    down[:, 2], pushed[:, :3] = -own[:, 0], own * body
    balance = down.ravel() + load * pushed.ravel()
    constraints = []
    for dry, named in ((True, "dry"), (False, "inner")):
        if kinds[dry]:
            f = cp.Variable((len(kinds[dry]), 6))
            faces, materials = zip(*kinds[dry], strict=True)
            constraints += face_constraints(list(faces), f, dry, list(materials), kern, unit)
            balance = balance + np.hstack(acts[named]) @ cp.reshape(f, (f.size,), order="C")
    if rough:
        parts = cp.Variable((len(rough), 3))
        constraints.append(parts[:, 0] >= 0)  # which the cone says only where there is friction
        constraints.append(cp.multiply(np.array(rough), parts[:, 0]) >= cp.norm(parts[:, 1:], axis=1))
        balance = balance + np.hstack(acts["corner"]) @ cp.reshape(parts, (parts.size,), order="C")
    constraints.append(balance == 0)
    problem = cp.Problem(cp.Maximize(load), constraints)
    # Whether the last digit is reached depends on the kernel of the processor. "inaccurate" is what stops short of it,
    # but not of a hundredth of what is compared.
    names = ("gap_abs", "gap_rel", "feas")
    reached = {f"tol_{name}": 1e-10 for name in names} | {f"reduced_tol_{name}": 1e-8 for name in names}
    problem.solve(solver="CLARABEL", **reached)
    assert problem.status in ("optimal", "optimal_inaccurate"), problem.status
    return float(load.value)


# All λ without dilation of a tiny planar assembly, docs/method.md (4.6), by its mechanisms one after another.
#
# A mechanism is a sum of extreme rays of the cone z = H (u, t) ≥ 0, and where forces go with it, y_k z_k = 0, they go
# with each of these rays. So the λ of all solutions are those of two linear programs for each ray on which the live
# load works. Nothing of equilibrium.py, scaling.py, yield sets or of zero_dilation is used: a fault there cannot hide.


_ZERO = 1e-9
_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def loads_without_dilation(assembly: Assembly, labels: np.ndarray) -> list[tuple[float, float]]:
    """Intervals of λ, scene units, whose union is λ of all solutions; labels: (m,) True dry."""
    faces, elements, s = assembly.interfaces, assembly.elements, assembly.strengths(ROUTE)
    count, free, reach = len(faces), elements.free, assembly.size
    force = assembly.total_dead
    live_unit = assembly.total_live
    balance = np.zeros((3 * len(free), 3 * count))
    rows, constants, widths = np.zeros((4 * count, 3 * count)), np.zeros(4 * count), np.zeros(count)
    for k in range(count):
        along = np.array([-faces.normal[k][1], faces.normal[k][0]])
        middle = faces.polygon[k].mean(axis=0)
        for element, sign in ((int(faces.a[k]), -1.0), (int(faces.b[k]), 1.0)):
            for row in np.flatnonzero(free == element):
                arm = (middle - elements.centroid[element]) / reach
                for column, way in ((3 * k, faces.normal[k]), (3 * k + 1, along)):
                    balance[3 * row : 3 * row + 2, column] = sign * way
                    balance[3 * row + 2, column] = sign * (arm[0] * way[1] - arm[1] * way[0])
                balance[3 * row + 2, 3 * k + 2] = sign
        length = float(np.hypot(*(faces.polygon[k][1] - faces.polygon[k][0])))
        area = length * float(faces.l2[k]) / force
        widths[k] = length / reach / (2.0 if labels[k] else 6.0)
        tension, slope, stuck = (
            (0.0, s.friction[k], s.cohesion[k] * area)
            if labels[k]
            else (s.tension[k] * area, s.inner_friction[k], s.shear[k] * area)
        )
        for j, sign in enumerate((1.0, -1.0)):
            rows[4 * k + j, 3 * k], rows[4 * k + j, 3 * k + 2], constants[4 * k + j] = 1.0, -sign / widths[k], tension
            rows[4 * k + 2 + j, 3 * k], rows[4 * k + 2 + j, 3 * k + 1] = slope, -sign
            constants[4 * k + 2 + j] = stuck
    live = (assembly.live[free] / live_unit / [1.0, 1.0, reach]).ravel()
    dead = (assembly.dead[free] / force / [1.0, 1.0, reach]).ravel()
    modes = np.zeros((4 * count, balance.shape[0] + count))
    jumps = balance.T
    for k in range(count):
        modes[4 * k, : len(dead)] = 0.5 * (jumps[3 * k] - jumps[3 * k + 2] * widths[k])
        modes[4 * k + 1, : len(dead)] = 0.5 * (jumps[3 * k] + jumps[3 * k + 2] * widths[k])
        modes[4 * k + 3, : len(dead)] = jumps[3 * k + 1]
        modes[4 * k + 2 : 4 * k + 4, len(dead) + k] = 1.0
    rays = extreme_rays(modes)
    moving = {tuple(np.flatnonzero(modes @ ray > _ZERO)) for ray in rays if ray[: len(dead)] @ live > _ZERO}
    found = []
    for some in sorted(moving):
        pick = list(some)
        ends = []
        for sign in (1.0, -1.0):
            answer = linprog(
                np.append(np.zeros(3 * count), sign),
                A_ub=np.column_stack([-rows, np.zeros(4 * count)]),
                b_ub=constants,
                A_eq=np.block([[balance, live[:, None]], [rows[pick], np.zeros((len(pick), 1))]]),
                b_eq=np.concatenate([-dead, -constants[pick]]),
                bounds=(None, None),
                options=_EXACT,
            )
            ends.append(-sign * np.inf if answer.status == 3 else np.nan if answer.status else float(answer.x[-1]))
        if not np.isnan(ends).any():
            found.append((ends[0] * force / live_unit, ends[1] * force / live_unit))
    return sorted(found)


def extreme_rays(rows: np.ndarray) -> np.ndarray:
    """(k, d) extreme rays of the pointed cone rows x ≥ 0, by the double description method (Motzkin et al. 1953)."""
    rows = rows / np.linalg.norm(rows, axis=1)[:, None]
    width = rows.shape[1]
    first = la.qr(rows.T, pivoting=True)[2][:width]
    rays = np.linalg.inv(rows[first]).T
    done, left = list(first), [k for k in range(len(rows)) if k not in set(first)]
    while left:
        k = left.pop(0)
        value = rays @ rows[k]
        zero = (abs(rays @ rows[done].T) < _ZERO).astype(int)
        above, below = np.flatnonzero(value > _ZERO), np.flatnonzero(value < -_ZERO)
        fresh = []
        for i in above:
            common = zero[below] & zero[i]
            size = common.sum(axis=1)
            # two rays are neighbours where no third lies on all that both lie on
            for j in np.flatnonzero((size >= width - 2) & (((common @ zero.T) == size[:, None]).sum(axis=1) == 2)):
                fresh.append(value[i] * rays[below[j]] - value[below[j]] * rays[i])
        rays = np.vstack([rays[value >= -_ZERO], *fresh])
        rays = rays / np.linalg.norm(rays, axis=1)[:, None]
        done.append(k)
    return rays


# Parts of proofs that no command and no exported name hands on, loaded when asked for.


def formula_of(space: Any, *, listed: bool = True) -> Any:
    """Return a formula of all labellings of a space, before anything is refuted."""
    from jld_explore.drivers import DRIVERS
    from jld_explore.drivers.exact.formula import Formula

    return Formula(space, DRIVERS["exact"](space, list_blocks=listed).context.blocks)


def conflicts_of(relaxation: Any, rows: np.ndarray, threshold: float) -> list[Any]:
    """Return a conflict of each labelling (k, m), None where it may reach the threshold, without the batch solver."""
    from jld_explore.drivers.exact.conflict_generation import conflict_of

    return [conflict_of(relaxation, row, np.ones(len(row), dtype=bool), threshold) for row in rows]


def relaxed_products(
    bounded: Any, region: Any, pairs: np.ndarray, slack: float, *, blocks: bool = False, distance: int | None = None
) -> Any:
    """Return the solved relaxation of λ without dilation with products of pairs; blocks: by matrix blocks."""
    from jld_dilation.certificate import solve_rlt_by_matrix_blocks
    from jld_dilation.rlt_relaxation import RltOptions, solve_rlt

    solve = solve_rlt_by_matrix_blocks if blocks else solve_rlt
    return solve(bounded, region, RltOptions(pairs, slack, 60.0 if blocks else np.inf, distance))


def first_step(bounded: Any, load: float) -> tuple[float, list[str]]:
    """Return what the first step of large scenes proves below a solution, scaled, and its name."""
    from jld_dilation.rlt_relaxation import LowerBoundProblem
    from jld_dilation.sweep import BlockSweep

    problem = LowerBoundProblem(load, 60.0)
    return BlockSweep(bounded, problem).partial_bound(0.0), problem.solve_log


def refutation_of(clauses: list[list[int]]) -> Any:
    """Return the refutation of clauses that a certificate would hold, None where they have a model."""
    from jld_explore.drivers.exact.proof_check import refutation

    return refutation(clauses)


def velocities_with_margin(upper: Any, labels: np.ndarray, margin: float) -> Any:
    """Return the answer of a program of velocity fields whose flow rules have a margin."""
    from jld_core.fields.upper import VelocityProgram

    return VelocityProgram(upper.problem, upper.live, upper.dead, margin).solve(upper.problem.is_dry(labels))
